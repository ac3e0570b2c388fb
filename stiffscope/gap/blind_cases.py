"""Blind cases: campaigns with withheld faults, and the seal that only the scorer opens."""

from __future__ import annotations

import base64
import json
import zlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.errors import InputError
from stiffscope.gap.campaign_io import write_campaign
from stiffscope.gap.lab.faults import OUTSIDE, inject
from stiffscope.gap.lab.machine import biglide
from stiffscope.gap.lab.measuring import Noise, default_plan, measure
from stiffscope.gap.quantities import AXES
from stiffscope.robot.vocabulary import VOCABULARY

if TYPE_CHECKING:
    from pathlib import Path

KINDS = ("single", "single", "single", "pair", "pair", "none", "outside", "outside")
"""What is drawn in turn, so that a share of each is in every eight."""
SEAL = "seal.txt"


@dataclass(frozen=True)
class Fault:
    """A fault of the true machine, in the words of the vocabulary or of `OUTSIDE`."""

    effect: str
    place: str
    parameters: dict[str, float]

    @property
    def name(self) -> str:
        """`effect @ place`."""
        return f"{self.effect} @ {self.place}"


@dataclass(frozen=True)
class BlindCase:
    """What is withheld of one campaign."""

    kind: str
    seed: int
    faults: tuple[Fault, ...] = ()


def draw(number: int, seed: int) -> BlindCase:
    """The campaign of this number in a series: its kind in turn, its effects and their sizes by chance."""
    rng = np.random.default_rng([seed, number])
    kind = KINDS[number % len(KINDS)]
    words = [e for e in VOCABULARY if e != "gravity"]
    if kind == "none":
        return BlindCase(kind, seed)
    if kind == "outside":
        names = [name for name in OUTSIDE if name not in {"bowed-link", "bad-session"}]
        return BlindCase(kind, seed, (_outside(names[int(rng.integers(len(names)))], rng),))
    if kind == "single":
        word = words[(number // len(KINDS) * 3 + number % len(KINDS)) % len(words)]
        return BlindCase(kind, seed, (_known(word, rng),))
    first, second = (int(k) for k in rng.permutation(len(words))[:2])
    return BlindCase(kind, seed, (_known(words[first], rng), _known(words[second], rng)))


def _between(rng: np.random.Generator, low: float, high: float) -> float:
    """A size between two, its logarithm uniform."""
    return low * (high / low) ** rng.random()


def _known(effect: str, rng: np.random.Generator) -> Fault:
    term = VOCABULARY[effect]
    place = term.places[int(rng.integers(0, len(term.places)))]
    size = _between(rng, 0.3, 3.0)  # small and large
    sign = 1.0 if rng.random() < 0.5 else -1.0
    factor = {"actuator-stiffness": 1 / (1 + 0.2 * size), "link-stiffness": 1 / (1 + 0.15 * size),
              "slider-compliance": 1 + 0.8 * size, "displacement-scale": 1 + sign * 0.02 * size,
              "force-scale": 1 + sign * 0.02 * size}  # fmt: skip
    if effect in factor:
        return Fault(effect, place, {"factor": factor[effect]})
    share = {name: float(rng.uniform(0.2, 1.0)) * size for name, _ in term.parameters}
    scale = {"joint-compliance": (3e-9, 3e-9, 1e-6), "guide-compliance": (4e-9, 4e-9, 8e-8),
             "base-compliance": (8e-9,) * 3 + (8e-8,) * 3, "platform-compliance": (8e-9,) * 3 + (8e-8,) * 3,
             "rigid-ends": (0.02,), "backlash": (8e-6,), "encoder-offset": (sign * 5e-5,),
             "link-length": (sign * 3e-5,),
             "thermal": (sign * 4.0,), "instrument-misalignment": (0.015,) * 3}  # fmt: skip
    if effect == "payload":
        offset = {k: float(rng.uniform(-0.1, 0.1)) for k in ("x", "y", "z")}
        return Fault(effect, place, {"mass": 3.0 * size, **offset})
    names = [name for name, _ in term.parameters]
    return Fault(effect, place, {name: s * share[name] for name, s in zip(names, scale[effect], strict=True)})


def _outside(effect: str, rng: np.random.Generator) -> Fault:
    places, names, _ = OUTSIDE[effect]
    place = places[int(rng.integers(len(places)))]
    size = _between(rng, 0.5, 3.0)
    one = {"one-soft-slider": 1 + 1.5 * size, "one-loose-bearing": 4e-9 * size, "one-soft-guide": 8e-8 * size,
           "hardening-drive": 3e16 * size, "drive-friction": 40.0 * size, "screw-pitch": 1e-4 * size,
           "platform-width": 5e-5 * size, "gain-drift": 0.05 * size, "cross-talk": 0.03 * size}  # fmt: skip
    if effect in one:
        return Fault(effect, place, {names[0]: one[effect]})
    scale = {"stage-guide": (5e-9,) * 3 + (8e-8,) * 3, "cable-chain": (3e4,) * 3,
             "drifting-sensor": (5e-6,) * 3 + (2e-5,) * 3,
             "coarse-converter": (5e-6,) * 3 + (2e-5,) * 3, "wrench-off-centre": (0.004,) * 3}[effect]  # fmt: skip
    chosen = {name: float(rng.uniform(0.3, 1.0)) * size * s for name, s in zip(names, scale, strict=False)}
    return Fault(effect, place, {k: v for k, v in chosen.items() if k in AXES})


def write_case(folder: Path, number: int, case: BlindCase) -> None:
    """Write the campaign of a case into a folder, without a word of what is in it."""
    rng = np.random.default_rng([case.seed, number, 1])
    machine = biglide()
    for fault in case.faults:
        machine = inject(machine, fault.effect, fault.place, fault.parameters)
    campaign = measure(machine, default_plan(machine, rng), Noise(), rng)
    write_campaign(campaign, folder)


def seal(folder: Path, cases: list[BlindCase]) -> None:
    """Write what is withheld where nobody reads it by accident."""
    content = [
        {"kind": case.kind, "seed": case.seed, "planted": [[p.effect, p.place, p.parameters] for p in case.faults]}
        for case in cases
    ]
    packed = base64.b85encode(zlib.compress(json.dumps(content).encode()))
    (folder / SEAL).write_bytes(packed + b"\n")


def unseal(folder: Path) -> list[BlindCase]:
    """What is withheld. Raises InputError for a seal that is missing or broken."""
    try:
        content: list[dict[str, Any]] = json.loads(
            zlib.decompress(base64.b85decode((folder / SEAL).read_bytes().strip()))
        )
    except (OSError, ValueError, zlib.error) as error:
        raise InputError(f"{folder / SEAL}: expected the seal that `stiffscope blind` wrote ({error})") from error
    return [BlindCase(c["kind"], c["seed"], tuple(Fault(*p) for p in c["planted"])) for c in content]
