"""Drawing of faults: random places, and random sizes scaled to the robot."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.lab.blind.cases import Fault
from stiffscope.lab.blind.laboratory import entries_of, other_dimension
from stiffscope.lab.closure import COORDINATES
from stiffscope.lab.faults import INSTRUMENT, bearing_words
from stiffscope.lab.instrument_faults import ROTATIONS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stiffscope.lab.blind.laboratory import Lab
    from stiffscope.lab.plans import Style

_LIKE = 8.075e-8  # m/N: compliance of the robot for which these sizes are given
_SOFT = 0.6  # least stiffness factor with other faults
_SLIGHT = 0.95  # largest
_OWN = {
    True: (0.02, 3.0),
    False: (0.02, 0.3),
}  # bearing over robot compliance, alone or not


def choose(rng: np.random.Generator, choices: Sequence[str]) -> str:
    """Return a random choice."""
    return choices[int(rng.integers(0, len(choices)))]


def _draw_size(rng: np.random.Generator, low: float, high: float) -> float:
    """Draw a log-uniform size between two limits."""
    return low * (high / low) ** rng.random()


@dataclass(frozen=True)
class _Draw:
    """A place where a fault is drawn, with its relative size, 0.3 to 3, and its sign."""

    rng: np.random.Generator
    lab: Lab
    place: str
    members: tuple[str, ...]
    size: float
    sign: float
    alone: bool

    @property
    def lever(self) -> float:
        """Largest lever of its drives on the tool, m per rad; one for linear drives."""
        joints = self.lab.sound.joints
        return max(
            (self.lab.drive_lever(n) for n in self.members if n in joints), default=1.0
        )

    @property
    def force(self) -> float:
        """Force or torque of its drives under a load of the lab, N or N·m."""
        return self.lab.workspace.scale.force * self.lever

    @property
    def length(self) -> float:
        """Mean length of its bodies, m."""
        bodies = self.lab.sound.bodies
        lengths = [bodies[name].length for name in self.members if name in bodies]
        return float(np.mean(lengths or [0.0]))

    @property
    def reach(self) -> float:
        """Distance of the tool from the farthest joint, m."""
        machine = self.lab.sound
        away = [
            np.linalg.norm(machine.at - j.at_first) for j in machine.joints.values()
        ]
        return float(max(away, default=1.0))


Sizes = Callable[[_Draw], dict[str, float]]


def draw_known(
    effect: str,
    rng: np.random.Generator,
    lab: Lab,
    sensors: Sequence[str],
    *,
    alone: bool = True,
) -> Fault:
    """Draw a known fault.

    Parameters
    ----------
    effect
        A known effect that the robot can have.
    rng
        Random generator of place, size and sign.
    lab
        The robot in the lab; a softer or larger one gets larger faults.
    sensors
        Names of the sensors that may be faulty.
    alone
        Whether its size is drawn over decades, as that of an only fault in readings: responses
        show faults that shift their modes by up to a fifth.

    Returns
    -------
    Fault
        The fault with its parameters, SI.
    """
    place = choose(rng, lab.places(effect, sensors))
    size = _draw_size(rng, 0.3, 3.0)
    sign = 1.0 if rng.random() < 0.5 else -1.0
    members = tuple(lab.sound.members(place))
    draw = _Draw(
        rng=rng,
        lab=lab,
        place=place,
        members=members,
        size=size,
        sign=sign,
        alone=alone,
    )
    return Fault(effect, place, SIZES[effect](draw))


def _weaken(softest: float) -> Sizes:
    """Return the draw of a stiffness factor, which may be as small as this if it is alone."""
    return lambda d: {
        "factor": _draw_size(d.rng, softest if d.alone else _SOFT, _SLIGHT)
    }


def _vary(share: float) -> Sizes:
    """Return the draw of a factor near one."""
    return lambda d: {"factor": 1 + d.sign * share * d.size}


def _yield_in(*names: str) -> Sizes:
    """Return the draw of added compliances relative to the robot's; of a bearing those it has."""

    def draw(d: _Draw) -> dict[str, float]:
        scale = d.lab.workspace.scale
        own = [
            _draw_size(d.rng, *_OWN[d.alone]) * unit
            for unit in (scale.linear, scale.angular)
        ]
        joints = d.lab.sound.joints
        held = names or bearing_words([joints[name] for name in d.members])
        return {
            name: own[name in _TURNING] * float(d.rng.uniform(0.2, 1.0))
            for name in held
        }

    return draw


def _scatter(one: Sizes) -> Sizes:
    """Return the draw of parameters that are each a random share of their size."""
    return lambda d: {
        name: s * float(d.rng.uniform(0.2, 1.0)) * d.size for name, s in one(d).items()
    }


def _draw_payload(d: _Draw) -> dict[str, float]:
    offset = {k: float(d.rng.uniform(-0.1, 0.1)) for k in COORDINATES[:3]}
    softness = max(1.0, d.lab.workspace.scale.linear / _LIKE)
    return {"mass": 3.0 * d.size / softness, **offset}


def _draw_slip(d: _Draw) -> dict[str, float]:
    return {"jump": 2e-4 * d.sign * d.size, "row": float(d.rng.integers(*_LINES))}


def _draw_unit(d: _Draw) -> dict[str, float]:
    return {"factor": _UNITS[int(d.rng.integers(0, len(_UNITS)))]}


def _draw_part(d: _Draw) -> dict[str, float]:
    return _draw_matrix(d.lab, d.members[0], d.size, d.rng)


def _draw_dimension(d: _Draw) -> dict[str, float]:
    return {"value": other_dimension(d.lab, d.place, d.sign * min(d.size, 2.0))}


def _draw_knee(d: _Draw) -> dict[str, float]:
    """A preload that half of the lab's loads exceed, and half the stiffness or twice beyond."""
    load = d.force * float(d.rng.uniform(0.15, 0.5))
    return {"load": load, "factor": (1 + 0.5 * d.size) ** d.sign}


def _draw_leak(d: _Draw) -> dict[str, float]:
    others = [name for name in ("fx", "fy", "fz") if name != d.place]
    return {n: d.sign * 0.04 * d.size * float(d.rng.uniform(0.2, 1.0)) for n in others}


def _nothing(_: _Draw) -> dict[str, float]:
    return {}


_TURNING = {"tilting", "angular", "roll", "pitch", "yaw", *COORDINATES[3:]}
_UNITS = (1e3, 1e-3)
_LINES = (100, 500)  # range of rows at which a gauge slips
SIZES: dict[str, Sizes] = {
    "gravity": _nothing,
    "payload": _draw_payload,
    "mass": lambda d: {"factor": (1 + 0.2 * d.size) ** d.sign},
    "response-gain": lambda d: {"factor": (1 + 0.2 * d.size) ** d.sign},
    "sensor-mass": lambda d: {"mass": 0.04 * d.size},
    "actuator-stiffness": _weaken(0.1),
    "link-stiffness": _weaken(0.2),
    "joint-stiffness": _scatter(lambda _: {"factor": 3.0}),
    "joint-compliance": _yield_in(),
    "guide-compliance": _yield_in("lateral", "vertical", "roll", "pitch", "yaw"),
    "base-compliance": _yield_in(*COORDINATES),
    "platform-compliance": _yield_in(*COORDINATES),
    "part-compliance": _draw_part,
    "part-dimension": _draw_dimension,
    "rigid-ends": _scatter(lambda d: {"length": 0.04 * d.length}),
    "link-length": _scatter(lambda d: {"error": d.sign * 3e-5}),
    "thermal": _scatter(lambda d: {"temperature": d.sign * 4.0}),
    "joint-axis": _scatter(
        lambda d: {"y": 1e-4, "z": d.sign * 1e-4, "ry": 3e-4, "rz": d.sign * 3e-4}
    ),
    "encoder-offset": _scatter(lambda d: {"offset": d.sign * 5e-5 / d.lever}),
    "backlash": _scatter(lambda d: {"half_width": 8e-6 / d.lever}),
    "friction": _scatter(lambda d: {"force": 0.08 * d.force}),
    "preload-loss": _draw_knee,
    "tool-offset": _scatter(
        lambda d: dict.fromkeys(COORDINATES[:3], d.sign * 0.01 * d.reach)
    ),
    "instrument-misalignment": _scatter(lambda _: dict.fromkeys(ROTATIONS, 0.015)),
    "displacement-scale": _vary(0.02),
    "force-scale": _vary(0.02),
    "unit": _draw_unit,
    "sensor-sign": _nothing,
    "sensor-step": _draw_slip,
    "column-swap": _nothing,
    "force-cross-talk": _draw_leak,
    "load-value": _vary(0.05),
}
"""Draws of the parameters of every known effect of the laboratory."""


def _draw_matrix(
    lab: Lab, body: str, size: float, rng: np.random.Generator
) -> dict[str, float]:
    """Return the entries of a part softened by random factors in each direction."""
    stretch = np.diag(np.sqrt(1.0 + 0.8 * size * rng.uniform(0.2, 1.0, 6)))
    return entries_of(stretch @ lab.sound.bodies[body].compliance @ stretch)


HAMMERED_OUTSIDE = ("cable-chain",)
"""Effects outside the vocabulary that are drawn for hammer tests."""
_OF_INSTRUMENT = {
    "drifting-sensor",
    "gain-drift",
    "coarse-converter",
    "wrench-off-centre",
    "bad-session",
}


def _outside_places(lab: Lab, effect: str, channels: Sequence[str]) -> tuple[str, ...]:
    if effect == "cross-talk":
        return tuple(f"{a}->{b}" for a in channels for b in channels if a != b)
    return (INSTRUMENT,) if effect in _OF_INSTRUMENT else lab.places(effect)


def can_have(lab: Lab, effect: str, style: Style) -> bool:
    """Return whether a robot can have an outside fault that readings of a style may show."""
    if style == "hammer" and effect not in HAMMERED_OUTSIDE:
        return False
    if style == "tracker" and effect in {*_OF_INSTRUMENT, "cross-talk"} - {
        "wrench-off-centre"
    }:
        return False
    if effect == "screw-pitch":
        members = [
            name for place in lab.places(effect) for name in lab.sound.members(place)
        ]
        return any(lab.sound.joints[name].kind == "prismatic" for name in members)
    return effect != "bowed-link" and bool(_outside_places(lab, effect, ("x", "y")))


def draw_outside(
    effect: str, rng: np.random.Generator, lab: Lab, style: Style
) -> Fault:
    """Draw a fault outside the vocabulary.

    Parameters
    ----------
    effect
        A name of `OUTSIDE` that the robot can have.
    rng
        Random generator of place and size.
    lab
        The robot in the lab.
    style
        Style of the measurements, which determines the channels.

    Returns
    -------
    Fault
        The fault with its parameters, SI.
    """
    channels = [f"gauge{k + 1}" for k in range(5)] if style == "gauges" else COORDINATES
    place = choose(rng, _outside_places(lab, effect, channels))
    size = _draw_size(rng, 0.5, 3.0)
    scale = lab.workspace.scale
    joints = lab.sound.joints
    soft = scale.linear / _LIKE
    members = [name for name in lab.sound.members(place) if name in joints]
    stiffest = max(
        (drive.stiffness for n in members if (drive := joints[n].drive)), default=1.0
    )
    lever = max((lab.drive_lever(name) for name in members), default=1.0)
    bearing = 1e-8 * soft
    force = scale.force * lever
    one = {
        # under a lab's force a hardening drive loses a tenth of its deflection, as at 3e16 N/m³
        "hardening-drive": {"cubic": 2.4 * size * stiffest**3 / (10.0 * force**2)},
        "stiffening-joint": {
            "radial": bearing * size,
            "knee": 0.2 * bearing * size * scale.force,
        },
        "joint-play": {"radial": 4e-6 * size},
        "loose-bolt": {"opening": bearing * size},
        "screw-pitch": {"relative": 1e-4 * size},
        "larger-body": {"relative": 1e-3 * size},
        "gain-drift": {"relative": 0.05 * size},
        "cross-talk": {"share": 0.03 * size},
        "bad-session": {"relative": 0.03 * size},
        "drifting-sensor": {"displacement": 4e-6 * size, "rotation": 1.5e-5 * size},
        "coarse-converter": {"displacement": 4e-6 * size, "rotation": 1.5e-5 * size},
    }
    if effect in one:
        return Fault(effect, place, one[effect])
    hose = 3e4 / soft if style != "hammer" else 0.1 / scale.linear
    largest = size * {"cable-chain": hose, "wrench-off-centre": 0.004}[effect]
    shares = {name: float(rng.uniform(0.3, 1.0)) for name in COORDINATES[:3]}
    return Fault(
        effect, place, {name: share * largest for name, share in shares.items()}
    )
