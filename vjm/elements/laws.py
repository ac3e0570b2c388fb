"""Force-deflection laws of drives, and the equilibrium of drives that have them.

A law is odd and piecewise linear: no force within half the backlash, then one slope for each
segment. Relative to a linear spring k₀ in its place a drive is shifted by ``s = θ - F/k₀``. The
rest of the robot is linear, so the forces are ``F = F₀ + H s``, and the shifts at equilibrium
minimize a convex function. On each segment a drive is linear with an offset (`linearize`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

import numpy as np

from stiffscope.errors import InputError
from stiffscope.vjm.model.joints import Drive

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from stiffscope.vjm.model.joints import Law
    from stiffscope.vjm.model.mechanism import Mechanism
    from stiffscope.vjm.model.screws import Array

_STEPS = 200
_SETTLED = 1e-13
_NEARLY = 1e-9  # of the largest force
_ROUNDING = 1e-14  # of the steepest slope times a shift
_ALONE = 1e-14  # of the steepest slope: regularizes a drive within its backlash


def find_laws(mechanism: Mechanism) -> dict[str, Law]:
    """Return the laws of the nonlinear drives, by joint."""
    drives = ((j.name, j.drive) for j in mechanism.joints if j.drive is not None)
    return {name: drive.law for name, drive in drives if drive.law is not None}


def without_laws(mechanism: Mechanism) -> Mechanism:
    """Return the mechanism with every law replaced by a linear spring of its initial slope."""
    laws = find_laws(mechanism).items()
    return _with_drives(mechanism, {name: (law.slopes[0], 0.0) for name, law in laws})


def linearize(mechanism: Mechanism, segments: Sequence[int]) -> Mechanism:
    """Return the mechanism with every law on a given segment: 0 in the backlash, then ±1, ±2, …."""
    pairs = zip(find_laws(mechanism).items(), segments, strict=True)
    return _with_drives(
        mechanism, {name: law.line(segment) for (name, law), segment in pairs}
    )


_linear: WeakKeyDictionary[Mechanism, dict[Any, Mechanism]] = WeakKeyDictionary()


def _with_drives(
    mechanism: Mechanism, lines: Mapping[str, tuple[float, float]]
) -> Mechanism:
    """Replace some drives by springs of stiffness k, unloaded at an offset; cached."""
    if not lines:
        return mechanism
    known = _linear.setdefault(mechanism, {})
    key = tuple(lines.items())
    if key not in known:
        joints = list(mechanism.joints)
        for i, joint in enumerate(joints):
            if joint.name in lines and joint.drive is not None:
                slope, offset = lines[joint.name]
                own = np.zeros(6) if joint.offset is None else joint.offset.copy()
                own[joint.type.driven] += offset
                drive = (
                    Drive(slope, joint.drive.low, joint.drive.high) if slope else None
                )
                joints[i] = replace(
                    joint, drive=drive, offset=own if own.any() else None
                )
        known[key] = replace(mechanism, joints=tuple(joints))
    return known[key]


@dataclass(frozen=True, eq=False)
class Settled:
    """Equilibrium (m, k) of drives: ``shift`` from linear springs, ``force``, ``deflection``."""

    shift: Array
    force: Array
    deflection: Array


def settle(
    laws: Sequence[Law], stiffness: Array, force: Array, influence: Array
) -> Settled:
    """Find the equilibrium of drives with laws in a robot that is otherwise linear.

    Parameters
    ----------
    laws
        k laws.
    stiffness
        (k,) stiffnesses of the linear springs that replace the laws, N/m or N·m/rad.
    force
        (m, k) drive forces with those springs.
    influence
        (m, k, k) drive forces for a unit shift of each drive; symmetric, negative semidefinite.

    Raises
    ------
    InputError
        If no equilibrium is found.
    """
    steep = np.array([2.0 * law.slopes.max() for law in laws])  # stiffer than every law
    change = 1.0 / steep - 1.0 / stiffness
    size = len(laws)
    back = np.linalg.inv(np.eye(size) - influence * change)
    pull = (back @ force[..., None])[..., 0]
    tie = -back @ influence
    values, axes = np.linalg.eigh(0.5 * (tie + tie.mT))
    tie = (
        axes * values.clip(min=0.0)[..., None, :]
    ) @ axes.mT  # rounding pushes no drive apart
    curves = [
        law.add_compliance(-1.0 / k)
        for law, k in zip(laws, steep.tolist(), strict=True)
    ]
    shift: Array = np.zeros_like(pull)
    whole = np.maximum(
        np.abs(pull).max(axis=1, keepdims=True), 1e-100
    )  # squares of less vanish
    for _ in range(_STEPS):
        left = pull - (tie @ shift[..., None])[..., 0] - _values(curves, shift)
        open_ = (np.abs(left) > _SETTLED * whole).any(axis=1)
        if not open_.any():
            break
        slopes = np.stack([c.slope(shift[:, j]) for j, c in enumerate(curves)], axis=1)
        matrix = tie + np.eye(size) * np.maximum(slopes, _ALONE * steep)[:, None]
        step = np.linalg.solve(matrix, left[..., None])[..., 0]
        reach = _search(curves, shift, step, pull, tie)
        if not (reach[open_] > 0.0).any():  # only rounding is left
            break
        shift = np.where(open_[:, None], shift + reach[:, None] * step, shift)
    rounding = _ROUNDING * steep * np.abs(shift)
    left = np.abs(pull - (tie @ shift[..., None])[..., 0] - _values(curves, shift))
    if (left > _NEARLY * whole + rounding.max(axis=1, keepdims=True)).any():
        raise InputError(
            "drives: no equilibrium was found with their curves and backlash"
        )
    carried = _values(curves, shift)
    return Settled(shift + carried * change, carried, shift + carried / steep)


def _values(curves: Sequence[Any], shift: Array) -> Array:
    return np.stack([c.force(shift[:, j]) for j, c in enumerate(curves)], axis=1)


def _search(
    curves: Sequence[Law], shift: Array, step: Array, pull: Array, tie: Array
) -> Array:
    """Return the step length (m,) of least energy: an exact search between the laws' corners."""
    corners: list[Array] = [np.tile([0.0, 1.0], (len(shift), 1))]
    for j, c in enumerate(curves):
        gap = np.concatenate([-c.starts, c.starts]) - shift[:, j, None]
        way = step[:, j, None]
        corners.append(np.divide(gap, way, out=np.ones_like(gap), where=way != 0.0))
    at = np.sort(np.concatenate(corners, axis=1).clip(min=0.0), axis=1)
    at = np.concatenate([at, 2.0 * at[:, -1:] + 1.0], axis=1)
    slope = np.zeros_like(at)
    for j, c in enumerate(curves):
        there = shift[:, j, None] + at * step[:, j, None]
        slope += step[:, j, None] * (c.force(there) - pull[:, j, None])
    start = (step * (tie @ shift[..., None])[..., 0]).sum(axis=1, keepdims=True)
    slope += start + at * (step * (tie @ step[..., None])[..., 0]).sum(
        axis=1, keepdims=True
    )
    last = np.minimum(
        (slope < 0.0).sum(axis=1), at.shape[1] - 1
    )  # the slope is increasing
    first = np.maximum(last - 1, 0)
    rows = np.arange(len(at))
    a = at[rows, first]
    b = at[rows, last]
    fa = slope[rows, first]
    fb = slope[rows, last]
    rise = np.where(fb > fa, fb - fa, np.inf)
    return np.maximum(a - fa * (b - a) / rise, 0.0)
