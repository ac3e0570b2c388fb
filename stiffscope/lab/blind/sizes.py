"""Drawing of faults: random places, and random sizes scaled to the robot."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from stiffscope.lab.blind.cases import Fault
from stiffscope.lab.blind.laboratory import INSTRUMENT, entries_of, other_dimension
from stiffscope.lab.closure import COORDINATES
from stiffscope.lab.faults import bearing_words

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stiffscope.lab.blind.laboratory import Lab
    from stiffscope.lab.plans import Style

_LIKE = 8.075e-8  # m/N: compliance of the robot for which these sizes are given
_SOFTEST = {
    "actuator-stiffness": 0.1,
    "link-stiffness": 0.2,
}  # least stiffness factor alone,
_SOFT = 0.6
_SLIGHT = 0.95  # with other faults, and largest factor
_OWN = {
    True: (0.02, 3.0),
    False: (0.02, 0.3),
}  # bearing over robot compliance, alone or not
_SCALES = {"displacement-scale", "force-scale"}


def choose(rng: np.random.Generator, choices: Sequence[str]) -> str:
    """Return a random choice."""
    return choices[int(rng.integers(0, len(choices)))]


def _draw_size(rng: np.random.Generator, low: float, high: float) -> float:
    """Draw a log-uniform size between two limits."""
    return low * (high / low) ** rng.random()


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
        Whether it is the only fault, with a size drawn over decades.

    Returns
    -------
    Fault
        The fault with its parameters, SI.
    """
    place = choose(rng, lab.places(effect, sensors))
    size = _draw_size(rng, 0.3, 3.0)
    sign = 1.0 if rng.random() < 0.5 else -1.0
    members = lab.sound.members(place)
    if effect in _SOFTEST:
        parameters = {
            "factor": _draw_size(rng, _SOFTEST[effect] if alone else _SOFT, _SLIGHT)
        }
    elif effect == "mass":
        parameters = {"factor": (1 + 0.2 * size) ** sign}
    elif effect in _SCALES:
        parameters = {"factor": 1 + sign * 0.02 * size}
    elif effect in _YIELDING:
        scale = lab.workspace.scale
        own = [
            _draw_size(rng, *_OWN[alone]) * unit
            for unit in (scale.linear, scale.angular)
        ]
        names = _YIELDING[effect] or bearing_words(
            [lab.sound.joints[name] for name in members]
        )
        parameters = {
            name: own[name in _TURNING] * float(rng.uniform(0.2, 1.0)) for name in names
        }
    elif effect == "unit":
        parameters = {"factor": _UNITS[int(rng.integers(0, len(_UNITS)))]}
    elif effect == "sensor-step":
        parameters = {"jump": 2e-4 * sign * size, "row": float(rng.integers(*_LINES))}
    elif effect == "part-compliance":
        parameters = _draw_matrix(lab, members[0], size, rng)
    elif effect == "part-dimension":
        parameters = {"value": other_dimension(lab, place, sign * min(size, 2.0))}
    elif effect == "payload":
        offset = {k: float(rng.uniform(-0.1, 0.1)) for k in COORDINATES[:3]}
        parameters = {
            "mass": 3.0 * size / max(1.0, lab.workspace.scale.linear / _LIKE),
            **offset,
        }
    else:
        one = _sizes_of_one(effect, lab, members, sign)
        parameters = {
            name: s * float(rng.uniform(0.2, 1.0)) * size for name, s in one.items()
        }
    return Fault(effect, place, parameters)


_TURNING = {"tilting", "angular", "roll", "pitch", "yaw", *COORDINATES[3:]}
_YIELDING: dict[str, tuple[str, ...]] = {
    "joint-compliance": (),
    "guide-compliance": ("lateral", "vertical", "roll", "pitch", "yaw"),
    "base-compliance": COORDINATES,
    "platform-compliance": COORDINATES,
}
_UNITS = (1e3, 1e-3)
_LINES = (100, 500)  # range of rows at which a gauge slips


def _sizes_of_one(
    effect: str, lab: Lab, members: Sequence[str], sign: float
) -> dict[str, float]:
    """Return the parameters of an effect of unit size."""
    lengths = [
        lab.sound.bodies[name].length for name in members if name in lab.sound.bodies
    ]
    lever = max(
        (lab.drive_lever(n) for n in members if n in lab.sound.joints), default=1.0
    )
    turns: dict[str, float] = dict.fromkeys(COORDINATES[3:], 0.015)
    return {
        "joint-stiffness": {"factor": 3.0},
        "sensor-sign": {},
        "rigid-ends": {"length": 0.04 * float(np.mean(lengths or [0.0]))},
        "joint-axis": {"y": 1e-4, "z": sign * 1e-4, "ry": 3e-4, "rz": sign * 3e-4},
        "backlash": {"half_width": 8e-6 / lever},
        "encoder-offset": {"offset": sign * 5e-5 / lever},
        "link-length": {"error": sign * 3e-5},
        "thermal": {"temperature": sign * 4.0},
        "instrument-misalignment": turns,
    }[effect]


def _draw_matrix(
    lab: Lab, body: str, size: float, rng: np.random.Generator
) -> dict[str, float]:
    """Return the entries of a part softened by random factors in each direction."""
    stretch = np.diag(np.sqrt(1.0 + 0.8 * size * rng.uniform(0.2, 1.0, 6)))
    return entries_of(stretch @ lab.sound.bodies[body].compliance @ stretch)


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
        "drive-friction": {"force": 0.08 * size * force},
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
    largest = size * {"cable-chain": 3e4 / soft, "wrench-off-centre": 0.004}[effect]
    shares = {name: float(rng.uniform(0.3, 1.0)) for name in COORDINATES[:3]}
    return Fault(
        effect, place, {name: share * largest for name, share in shares.items()}
    )
