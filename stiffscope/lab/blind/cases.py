"""Blind cases: campaigns with withheld faults, stored in a seal that only the scorer opens."""

from __future__ import annotations

import base64
import json
import zlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from stiffscope.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from stiffscope.lab.plans import Style

SEAL = "seal.txt"


@dataclass(frozen=True)
class Fault:
    """A fault of the true machine, named as in the vocabulary or in `OUTSIDE`."""

    effect: str
    place: str
    parameters: dict[str, float]

    @property
    def name(self) -> str:
        """`effect @ place`."""
        return f"{self.effect} @ {self.place}"


@dataclass(frozen=True)
class BlindCase:
    """The withheld faults of one campaign, and the style of its measurements."""

    kind: str
    seed: int
    faults: tuple[Fault, ...] = ()
    style: Style = "tool"


def seal(folder: Path, cases: Sequence[BlindCase]) -> None:
    """Write the withheld faults in an encoded file."""
    content = [
        {
            "kind": case.kind,
            "seed": case.seed,
            "measured": case.style,
            "planted": [[p.effect, p.place, p.parameters] for p in case.faults],
        }
        for case in cases
    ]
    packed = base64.b85encode(zlib.compress(json.dumps(content).encode()))
    (folder / SEAL).write_bytes(packed + b"\n")


def unseal(folder: Path) -> list[BlindCase]:
    """Return the withheld faults. Raises InputError if the seal is missing or broken."""
    try:
        content: list[dict[str, Any]] = json.loads(
            zlib.decompress(base64.b85decode((folder / SEAL).read_bytes().strip()))
        )
    except (OSError, ValueError, zlib.error) as error:
        message = f"expected the seal that `stiffscope blind` wrote ({error})"
        raise InputError(f"{folder / SEAL}: {message}") from error
    faults = [tuple(Fault(*planted) for planted in case["planted"]) for case in content]
    return [
        BlindCase(case["kind"], case["seed"], planted, case.get("measured", "tool"))
        for case, planted in zip(content, faults, strict=True)
    ]
