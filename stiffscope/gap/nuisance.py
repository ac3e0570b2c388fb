"""Patterns that the vocabulary has no word for: where one of them wins, the answer is that nothing known explains it.

They keep a wrong name from being given with confidence, and say in plain words what the readings look like instead.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.gap.effects import UNKNOWN, Change, Changes, Effect, Nominal
from stiffscope.gap.vocabulary import AXES, DEFLECTION, LINKS, STIFFNESS

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from stiffscope.gap.state import State

    Array = NDArray[np.floating[Any]]


def rivals() -> tuple[Effect, ...]:
    """Unnamed faults of single parts, of the frame of reference, and of the instrument in time."""
    eye = np.eye(6)
    out: list[Effect] = []
    for limb in (1, 2):
        out.append(_part(f"one slider alone, limb{limb}", (0.5,), _scaled(f"limb{limb}.slider")))
        out.append(_part(f"one carriage alone, limb{limb}", (5e-9, 5e-9, 1e-7, 1e-7, 1e-7),
                         _added([f"limb{limb}.carriage"], eye[1:])))  # fmt: skip
    radial = np.array([[1.0, 0, 1, 0, 0, 0]])
    for link in LINKS:
        for end in ("joint_a", "joint_b"):
            name = f"{link}.{end}"
            out += [_part(f"one bearing alone, {name}", (5e-9,), _added([name], radial))]
        out.append(_part(f"a bowed link, {link}", (1e-4,), _bowed([link])))
    out.append(_part("bowed links", (1e-4,), _bowed(LINKS)))
    out.append(_part("the guide of the stage", (1e-8,) * 3 + (1e-7,) * 3, _added(["stage.guide"], eye)))
    reads: dict[str, tuple[int, float, Callable[[State], Array]]] = {
        "a drift of the readings in time": (6, 5e-6, _drift),
        "a drift of the gain in time": (1, 0.05, _gain_drift),
        "a gain of its own in every direction": (6, 0.05, _gains),
        "a gain of its own in a session": (0, 0.05, _session_gains),
        "cross-talk between directions": (30, 0.05, _crosstalk),
        "a wrench that acts beside M": (3, 0.01, _beside),
        "errors that grow along the rail": (2, 1e-3, _pitch),
        "a stiffness towards the frame, growing with the distance": (6, 0.01, _tether),
        "a zero of its own in every direction": (6, 1e-5, _zero),
        "less motion at small loads": (3, 1e-5, _friction),
    }
    for place, (count, scale, columns) in reads.items():
        names = tuple(f"p{k + 1}" for k in range(max(count, 1)))
        many = len(names)
        out.append(
            Effect(
                UNKNOWN, place, names, ("",) * many, (scale,) * many, (-np.inf,) * many, (np.inf,) * many, reads=columns
            )
        )
    return tuple(out)


def _part(place: str, scale: tuple[float, ...], acts: Callable[[Array, Nominal], Changes]) -> Effect:
    names = tuple(f"p{k + 1}" for k in range(len(scale)))
    many = len(scale)
    return Effect(UNKNOWN, place, names, ("",) * many, scale, (-np.inf,) * many, (np.inf,) * many, acts=acts)


def _scaled(name: str) -> Callable[[Array, Nominal], Changes]:
    return lambda u, nominal: {name: Change(nominal.springs[name].compliance * u[0])}


def _added(names: list[str], pattern: Array) -> Callable[[Array, Nominal], Changes]:
    return lambda values, _nominal: {name: Change(np.diag(values @ pattern)) for name in names}


def _bowed(names: list[str] | tuple[str, ...]) -> Callable[[Array, Nominal], Changes]:
    def acts(values: Array, nominal: Nominal) -> Changes:
        length = nominal.length
        end = values[0] * np.array([0.0, 0.0, length**2 / 2.0, 0.0, -length, 0.0])
        return {name: Change(offset=end) for name in names}

    return acts


def _by_direction(state: State, size: Array) -> Array:
    """Columns (n, 6): ``size`` (n,) in the direction read."""
    c = state.bench.campaign
    return np.where(c.kind != STIFFNESS, size, 0.0)[:, None] * np.eye(6)[c.direction]


def _time(state: State) -> Array:
    """0 at the first reading of the campaign, 1 at the last."""
    c = state.bench.campaign
    order = np.lexsort((c.line, c.file))
    time = np.empty(len(c))
    time[order] = np.linspace(0.0, 1.0, len(c))
    return time


def _drift(state: State) -> Array:
    return _by_direction(state, _time(state))


def _zero(state: State) -> Array:
    return _by_direction(state, np.ones(len(state.bench.campaign)))


def _gain_drift(state: State) -> Array:
    return (_time(state) * state.plain)[:, None]


def _gains(state: State) -> Array:
    return _by_direction(state, state.plain)


def _session_gains(state: State) -> Array:
    last = state.bench.campaign.session == state.bench.campaign.session.max()
    return (last * state.plain)[:, None]


def _crosstalk(state: State) -> Array:
    c = state.bench.campaign
    columns: list[Array] = []
    for sink in range(len(AXES)):
        for source in range(len(AXES)):
            if source != sink:
                here = (c.direction == sink) & (c.kind != STIFFNESS)
                columns.append(np.where(here, state.moved[:, source], 0.0))
    return np.stack(columns, axis=1)


def _beside(state: State) -> Array:
    c = state.bench.campaign
    columns: list[Array] = []
    for axis in np.eye(3):
        wrench = np.concatenate([np.zeros((len(c), 3)), np.cross(axis, np.nan_to_num(c.wrench[:, :3]))], axis=1)
        twist = np.einsum("nij,nj->ni", state.compliance[c.pose], wrench)
        columns.append(np.where(c.kind == DEFLECTION, twist[np.arange(len(c)), c.direction], 0.0))
    return np.stack(columns, axis=1)


def _pitch(state: State) -> Array:
    """Slides that stand off in proportion to their way, and a platform wider than it should be."""
    c = state.bench.campaign
    nothing = np.zeros((len(c), 6))
    outward = {"limb1": -1.0, "limb2": 1.0}
    way = {"limb1": 0.375 - c.poses[:, 0], "limb2": 0.375 + c.poses[:, 0]}
    growing = sum((outward[p] * way[p][:, None] * state.by_drive(p) for p in outward), np.zeros((len(c.poses), 6)))
    wider = sum((outward[p] * state.by_drive(p) for p in outward), np.zeros((len(c.poses), 6)))
    return np.stack([state.reading(nothing, growing, None), state.reading(nothing, wider, None)], axis=1)


def _tether(state: State) -> Array:
    """Springs from the frame to the platform, slack in the middle: pull back along x, y, z, and stiffen."""
    c = state.bench.campaign
    columns: list[Array] = []
    middle = c.poses.mean(axis=0)
    per_newton = 1e6  # a spring of 1 N/µm times the parameter
    for k in range(3):
        pull = np.zeros((len(c.poses), 6))
        pull[:, k] = -per_newton * (c.poses[:, k] - middle[k])
        dead = np.einsum("pij,pj->pi", state.compliance, pull)
        stiffer = -per_newton * state.compliance[:, :, k, None] * state.compliance[:, None, k, :]
        twist = np.einsum("nij,nj->ni", stiffer[c.pose], np.nan_to_num(c.wrench))
        columns.append(state.reading(twist, 0.0 * dead, stiffer))
        columns.append(state.reading(0.0 * twist, dead, None))
    return np.stack(columns, axis=1)


def _friction(state: State) -> Array:
    """Drives that lose a fixed force to their guides: less motion, by a fixed amount towards the force."""
    nothing = np.zeros_like(state.dead)
    columns: list[Array] = []
    for place in ("limb1", "limb2", "stage"):
        applied, _ = state.drive_force(place)
        size = np.abs(applied).max(initial=0.0)
        shift = np.clip(applied / max(0.2 * size, 1e-9), -1.0, 1.0)
        columns.append(state.reading(shift[:, None] * state.by_drive(place)[state.bench.campaign.pose], nothing, None))
    return np.stack(columns, axis=1)
