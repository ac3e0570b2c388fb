"""Laws of drives: force as a function of deflection, a straight line the special case, and their equilibrium.

A law is odd and piecewise straight: nothing within half the backlash, then a slope from each point on. Beside a linear
spring k₀ in its place a drive lies apart by the shift ``s = θ - F/k₀``; the rest of the robot is linear, so that its
forces are ``F = F₀ + H s``, and equilibrium is the minimum of a convex function of the shifts of the few drives with a
law. On its segment every drive is a linear one with an offset (`linearize`), by which all else is found.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

import numpy as np

from stiffscope.errors import InputError
from stiffscope.vjm.joints import DRIVEN, Drive

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from stiffscope.vjm.joints import Law
    from stiffscope.vjm.mechanism import Mechanism
    from stiffscope.vjm.screws import Array

_STEPS = 200
_SETTLED, _NEARLY = 1e-13, 1e-9  # of the largest force
_ROUNDING = 1e-14  # of the steepest slope times a shift
_ALONE = 1e-14  # of the steepest slope: what holds a drive within its gap where nothing else does


def find_laws(mechanism: Mechanism) -> dict[str, Law]:
    """Laws of the drives that are not linear, by joint."""
    return {j.name: j.drive.law for j in mechanism.drives if j.drive is not None and j.drive.law is not None}


def without_laws(mechanism: Mechanism) -> Mechanism:
    """The mechanism with a linear spring in place of every law: the slope with which it begins."""
    return _with_drives(mechanism, {name: (law.slopes[0], 0.0) for name, law in find_laws(mechanism).items()})


def linearize(mechanism: Mechanism, segments: Sequence[int]) -> Mechanism:
    """The mechanism with every law on one of its segments, by number: 0 in the gap, ±1, ±2, … from there."""
    pairs = zip(find_laws(mechanism).items(), segments, strict=True)
    return _with_drives(mechanism, {name: law.line(segment) for (name, law), segment in pairs})


_linear: WeakKeyDictionary[Mechanism, dict[Any, Mechanism]] = WeakKeyDictionary()


def _with_drives(mechanism: Mechanism, lines: Mapping[str, tuple[float, float]]) -> Mechanism:
    """Linear springs of stiffness k, unloaded at an offset, in some drives; kept, since its order is found once."""
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
                own[DRIVEN[joint.kind]] += offset
                drive = Drive(slope, joint.drive.low, joint.drive.high) if slope else None
                joints[i] = replace(joint, drive=drive, offset=own if own.any() else None)
        known[key] = replace(mechanism, joints=tuple(joints))
    return known[key]


@dataclass(frozen=True, eq=False)
class Settled:
    """Equilibrium (m, k) of drives with laws: ``shift`` beside their linear springs, ``force``, ``deflection``."""

    shift: Array
    force: Array
    deflection: Array


def settle(laws: Sequence[Law], stiffness: Array, force: Array, influence: Array) -> Settled:
    """Equilibrium of drives with laws in a robot that is linear beside them.

    Parameters
    ----------
    laws
        k of them.
    stiffness
        (k,) of the linear springs in their place, N/m or N·m/rad.
    force
        (m, k) that each drive carries with those springs.
    influence
        (m, k, k) force of each drive for a unit of shift in each, symmetric, no positive eigenvalue.

    Raises
    ------
    InputError
        Where no equilibrium is found.
    """
    steep = np.array([2.0 * law.slopes.max() for law in laws])  # beside it every shift grows with the force
    change = 1.0 / steep - 1.0 / stiffness
    size = len(laws)
    back = np.linalg.inv(np.eye(size) - influence * change)
    pull, tie = (back @ force[..., None])[..., 0], -back @ influence
    values, axes = np.linalg.eigh(0.5 * (tie + tie.mT))
    tie = (axes * values.clip(min=0.0)[..., None, :]) @ axes.mT  # rounding pushes no drive apart
    curves = [law.subtract_spring(k) for law, k in zip(laws, steep.tolist(), strict=True)]
    shift: Array = np.zeros_like(pull)
    whole = np.maximum(np.abs(pull).max(axis=1, keepdims=True), 1e-300)
    for _ in range(_STEPS):
        left = pull - (tie @ shift[..., None])[..., 0] - _values(curves, shift)
        open_ = (np.abs(left) > _SETTLED * whole).any(axis=1)
        if not open_.any():
            break
        slopes = np.stack([c.slope(shift[:, j]) for j, c in enumerate(curves)], axis=1)
        matrix = tie + np.eye(size) * np.maximum(slopes, _ALONE * steep)[:, None]
        step = np.linalg.solve(matrix, left[..., None])[..., 0]
        reach = _search(curves, shift, step, pull, tie)
        if not (reach[open_] > 0.0).any():  # all that is left is rounding
            break
        shift = np.where(open_[:, None], shift + reach[:, None] * step, shift)
    rounding = _ROUNDING * steep * np.abs(shift)
    left = np.abs(pull - (tie @ shift[..., None])[..., 0] - _values(curves, shift))
    if (left > _NEARLY * whole + rounding.max(axis=1, keepdims=True)).any():
        raise InputError("drives: no equilibrium was found with their curves and backlash")
    carried = _values(curves, shift)
    return Settled(shift + carried * change, carried, shift + carried / steep)


def _values(curves: Sequence[Any], shift: Array) -> Array:
    return np.stack([c.force(shift[:, j]) for j, c in enumerate(curves)], axis=1)


def _search(curves: Sequence[Law], shift: Array, step: Array, pull: Array, tie: Array) -> Array:
    """How far (m,) along a step the energy is least: exactly, between the corners that the step passes."""
    corners = [np.concatenate([-c.starts, c.starts]) for c in curves]
    some = [
        np.divide(
            c - shift[:, j, None], step[:, j, None], out=np.ones((len(shift), len(c))), where=step[:, j, None] != 0
        )
        for j, c in enumerate(corners)
    ]
    at = np.concatenate([np.zeros((len(shift), 1)), np.ones((len(shift), 1)), *some], axis=1)
    at = np.sort(np.where(at > 0.0, at, 0.0), axis=1)
    at = np.concatenate([at, 2.0 * at[:, -1:] + 1.0], axis=1)
    slope = np.zeros_like(at)
    for j, c in enumerate(curves):
        there = shift[:, j, None] + at * step[:, j, None]
        slope += step[:, j, None] * (c.force(there) - pull[:, j, None])
    start = (step * (tie @ shift[..., None])[..., 0]).sum(axis=1, keepdims=True)
    slope += start + at * (step * (tie @ step[..., None])[..., 0]).sum(axis=1, keepdims=True)
    last = np.minimum((slope < 0.0).sum(axis=1), at.shape[1] - 1)  # the slope grows along the step
    first = np.maximum(last - 1, 0)
    rows = np.arange(len(at))
    a, b, fa, fb = at[rows, first], at[rows, last], slope[rows, first], slope[rows, last]
    rise = np.where(fb > fa, fb - fa, np.inf)
    return np.maximum(a - fa * (b - a) / rise, 0.0)


def find_segments(laws: Sequence[Law], deflection: Array) -> NDArray[np.intp]:
    """The segment (m, k) of every law at deflections (m, k)."""
    return np.stack([law.segment(deflection[:, j]) for j, law in enumerate(laws)], axis=1)
