"""Nuisance patterns: faults that the vocabulary has no word for. Where one wins, nothing known explains the gap.

They keep a wrong name from being given with confidence, and say in plain words what the readings look like instead.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.gap.forward_model import UNNAMED, Candidate
from stiffscope.gap.quantities import AXES, STIFFNESS
from stiffscope.gap.robot_prediction import Pattern
from stiffscope.robot.effects import RADIAL, Change, MechanicalEffect, added_diagonal, softer
from stiffscope.robot.vocabulary import LINKS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from numpy.typing import NDArray

    from stiffscope.gap.robot_prediction import RobotPrediction
    from stiffscope.robot.effects import Changes, NominalRobot

    Array = NDArray[np.floating[Any]]

_FULL_FORCE = 0.2  # share of the largest force in a drive from which its friction is overcome
_SPRING = 1e6  # N/m: a spring towards the frame, times the parameter


def nuisance_patterns(nominal: NominalRobot) -> tuple[Candidate, ...]:
    """Unnamed faults of single parts, of the surroundings, and of the instrument in time."""
    return (
        *_parts(nominal),
        *(_unnamed(p, (scale,) * count, Pattern(read)) for p, (count, scale, read) in _PATTERNS.items()),
    )


def _parts(nominal: NominalRobot) -> Iterator[Candidate]:
    eye = np.eye(6)
    for limb in ("limb1", "limb2"):
        slider, (carriage,) = f"{limb}.slider", nominal.elements(limb)
        yield _part(f"one slider alone, {limb}", (0.5,), partial(softer, nominal, [slider]), component=slider)
        yield _part(f"one carriage alone, {limb}", (5e-9, 5e-9, 1e-7, 1e-7, 1e-7),
                    partial(added_diagonal, [carriage], eye[1:]))  # fmt: skip
    for link in LINKS:
        for joint in (f"{link}.joint_a", f"{link}.joint_b"):
            yield _part(f"one bearing alone, {joint}", (5e-9,), partial(added_diagonal, [joint], RADIAL[None]))
        yield _part(f"a bowed link, {link}", (1e-4,), partial(_bowed, nominal.link_length, [link]))
    yield _part("bowed links", (1e-4,), partial(_bowed, nominal.link_length, LINKS))
    stage = nominal.elements("stage")
    yield _part("the guide of the stage", (1e-8,) * 3 + (1e-7,) * 3, partial(added_diagonal, stage, eye))


def _part(
    place: str, scale: tuple[float, ...], changes: Callable[[Array], Changes], *, component: str = ""
) -> Candidate:
    action = MechanicalEffect(UNNAMED, place, (), (), changes)
    return _unnamed(place, scale, action, component)


def _unnamed(place: str, scale: tuple[float, ...], action: object, component: str = "") -> Candidate:
    names, units = tuple(f"p{k + 1}" for k in range(len(scale))), ("",) * len(scale)
    free = ((-np.inf, np.inf),) * len(scale)
    return Candidate(UNNAMED, place, names, units, scale, free, component=component, action=action)


def _bowed(length: float, names: Sequence[str], values: Array) -> Changes:
    """Links of a uniform curvature: the free end rises by ``κ L²/2`` and turns by ``κ L``."""
    end = values[0] * np.array([0.0, 0.0, length**2 / 2.0, 0.0, -length, 0.0])
    return {name: Change(offset=end) for name in names}


def _by_direction(prediction: RobotPrediction, size: Array) -> Array:
    """Columns (n, 6): ``size`` (n,) in the direction read."""
    c = prediction.campaign
    return np.where(c.kind != STIFFNESS, size, 0.0)[:, None] * np.eye(6)[c.direction]


def _time(prediction: RobotPrediction) -> Array:
    """0 at the first reading of the campaign, 1 at the last."""
    c = prediction.campaign
    order = np.lexsort((c.line, c.file))
    time = np.empty(len(c))
    time[order] = np.linspace(0.0, 1.0, len(c))
    return time


def _drift(prediction: RobotPrediction) -> Array:
    return _by_direction(prediction, _time(prediction))


def _zero(prediction: RobotPrediction) -> Array:
    return _by_direction(prediction, np.ones(len(prediction.campaign)))


def _gain_drift(prediction: RobotPrediction) -> Array:
    return (_time(prediction) * prediction.plain)[:, None]


def _gains(prediction: RobotPrediction) -> Array:
    return _by_direction(prediction, prediction.plain)


def _session_gains(prediction: RobotPrediction) -> Array:
    session = prediction.campaign.session
    return ((session == session.max()) * prediction.plain)[:, None]


def _crosstalk(prediction: RobotPrediction) -> Array:
    c = prediction.campaign
    pairs = [(sink, source) for sink in range(len(AXES)) for source in range(len(AXES)) if source != sink]
    shown = [(c.direction == sink) & (c.kind != STIFFNESS) for sink, _ in pairs]
    return np.stack(
        [np.where(here, prediction.twist[:, source], 0.0) for here, (_, source) in zip(shown, pairs, strict=True)],
        axis=1,
    )


def _off_centre(prediction: RobotPrediction) -> Array:
    """The wrench acts beside M: its force has moments about it."""
    c = prediction.campaign
    force = np.nan_to_num(c.wrench[:, :3])
    moments = [np.concatenate([np.zeros((len(c), 3)), np.cross(axis, force)], axis=1) for axis in np.eye(3)]
    return np.stack([prediction.applied_twist(wrench) for wrench in moments], axis=1)


def _pitch(prediction: RobotPrediction) -> Array:
    """Lead-screw pitch error of the two sliding drives, and a platform wider than its drawing."""
    x, centre = prediction.campaign.poses[:, 0], prediction.at.drive_centre()
    first, second = (prediction.by_drive(drive) for drive in ("limb1", "limb2"))
    pitch = (centre - x)[:, None] * first + (centre + x)[:, None] * second
    return np.stack([prediction.change(dead=pitch), prediction.change(dead=first + second)], axis=1)


def _tether(prediction: RobotPrediction) -> Array:
    """Springs from the frame to the platform, slack in the middle: they stiffen, and pull back, along x, y, z."""
    c, compliance = prediction.campaign, prediction.compliance
    columns: list[Array] = []
    middle = c.poses.mean(axis=0)
    for k in range(3):
        pull = np.zeros((len(c.poses), 6))
        pull[:, k] = -_SPRING * (c.poses[:, k] - middle[k])
        stiffer = -_SPRING * compliance[:, :, k, None] * compliance[:, None, k, :]
        twist = np.einsum("nij,nj->ni", stiffer[c.pose], np.nan_to_num(c.wrench))
        columns.append(prediction.change(twist, None, stiffer))
        columns.append(prediction.change(dead=np.einsum("pij,pj->pi", compliance, pull)))
    return np.stack(columns, axis=1)


def _friction(prediction: RobotPrediction) -> Array:
    """Drives that lose a fixed force to their guides: less motion, by a fixed amount towards the force."""
    columns: list[Array] = []
    for drive in ("limb1", "limb2", "stage"):
        applied, _ = prediction.drive_forces(drive)
        size = np.abs(applied).max(initial=0.0)
        lost = np.clip(applied / max(_FULL_FORCE * size, 1e-9), -1.0, 1.0)
        columns.append(prediction.change(lost[:, None] * prediction.by_drive(drive)[prediction.campaign.pose]))
    return np.stack(columns, axis=1)


_PATTERNS: dict[str, tuple[int, float, Callable[[RobotPrediction], Array]]] = {
    "a drift of the readings in time": (6, 5e-6, _drift),
    "a drift of the gain in time": (1, 0.05, _gain_drift),
    "a gain of its own in every direction": (6, 0.05, _gains),
    "a gain of its own in a session": (1, 0.05, _session_gains),
    "cross-talk between directions": (30, 0.05, _crosstalk),
    "a wrench that acts beside M": (3, 0.01, _off_centre),
    "errors that grow along the rail": (2, 1e-3, _pitch),
    "a stiffness towards the frame, growing with the distance": (6, 0.01, _tether),
    "a zero of its own in every direction": (6, 1e-5, _zero),
    "less motion at small loads": (3, 1e-5, _friction),
}
"""Place, number of parameters, prior size, derivatives of the readings."""
