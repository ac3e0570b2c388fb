"""Principal stiffness, free directions and closeness to a singularity."""

from __future__ import annotations

import warnings
from itertools import repeat
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.errors import say_count
from stiffscope.vjm.model.subspaces import name_directions

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from stiffscope.vjm.model.screws import Array
    from stiffscope.vjm.model.subspaces import Direction

_FREE = 1e-9  # of the fourth principal stiffness: a smaller one is free
_LOST = 1e-12  # of the largest principal stiffness: rounding
_RIGID = 1e-12  # of the robot's own compliance: a direction of less is rigid
_STIFF = (
    1e6  # ratio of principal stiffnesses beyond which digits of the soft ones are lost
)
_ROUNDED = 1e-14  # of the tool's largest compliance: less is rounding
_ROUNDING = 1e-9  # of a wrench's largest component
_NEAR = 1e-6  # relative principal stiffness below which a pose is near singular
_SHORT = 1e-6  # m from the tool to a line that passes through it, but for rounding
_LENGTHS = 1e-3, 10.0  # m, bounds of a robot's characteristic length; beyond, rounding


def principal(matrix: Array) -> tuple[Array, Array]:
    """Return ascending eigenvalues (..., 6) and directions of stiffnesses (..., 6, 6).

    Scaled by the robot's characteristic length and stiffness, hence unit-independent.
    """
    force = np.einsum("...ii->...", matrix[..., :3, :3])[..., None, None] / 3.0
    scale = np.ones(matrix.shape[:-1])
    scale[..., 3:] = characteristic_length(matrix)[..., None]
    unit = (
        matrix
        / (scale[..., :, None] * scale[..., None, :])
        / np.where(force > 0.0, force, 1.0)
    )
    values, vectors = np.linalg.eigh(unit)
    return values, vectors / scale[..., :, None]


def characteristic_length(matrix: Array) -> Array:
    """Return the length (...) in m that equates mean rotational and translational stiffness."""
    diagonal = np.einsum("...ii->...i", matrix)
    force = diagonal[..., :3].sum(axis=-1)
    moment = diagonal[..., 3:].sum(axis=-1)
    return np.sqrt(moment.clip(min=0.0) / np.where(force > 0.0, force, 1.0)).clip(
        *_LENGTHS
    )


def count_freedoms(matrix: Array) -> tuple[NDArray[np.int_], Array]:
    """Return the number of free directions and the inverse condition number (0 is singular).

    Judged by the fourth principal stiffness: up to two may be nearly infinite.
    """
    values, _ = principal(matrix)
    size = np.sort(np.abs(values))
    largest = np.where(values[..., -1:] > 0.0, values[..., -1:], 1.0)
    least = np.maximum(_FREE * size[..., 3:4], _LOST * largest)
    return np.sum(size < least, axis=-1), np.clip(values / largest, 0.0, None)[..., 0]


def nearly_rigid(alone: Array, length: float) -> NDArray[np.bool_]:
    """Return which of stiffnesses 1/C_ii (n, 6) are beyond those of the others, by a million.

    They are nearly rigid, and their digits say nothing. NaN is rigid. ``length`` (m) scales rotations.
    """
    scaled = alone * np.repeat([1.0, length**-2.0], 3)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # all of a row may be NaN
        usual = np.nanmedian(scaled, axis=1, keepdims=True)
    return np.isnan(alone) | (scaled > _STIFF * usual)


def is_ill_conditioned(matrix: Array, length: float) -> NDArray[np.bool_]:
    """Return where stiffnesses (n, 6, 6) are so different by direction that digits are lost.

    There the compliance is to be found by itself, not as the inverse of the stiffness; a direction
    without stiffness may be free, or so soft beside the others. ``length`` (m) scales rotations.
    """
    scale = np.repeat([1.0, 1.0 / length], 3)
    values = np.abs(np.linalg.eigvalsh(matrix * np.outer(scale, scale)))
    largest = values.max(axis=-1)
    return (largest > 0.0) & (largest > _STIFF * values.min(axis=-1))


def rigid_wrenches(
    compliance: Array, length: float, element_compliance: float = 0.0
) -> tuple[Array, ...]:
    """Return unit wrenches (k, 6) that do not deflect each of compliances (n, 6, 6).

    Each has a component that the others lack.

    Parameters
    ----------
    compliance
        Compliances (n, 6, 6) of the tool.
    length
        Scales rotations, m.
    element_compliance
        Largest compliance of the robot's elements, with ``length`` as unit, 1/(N·m); by default
        that of the tool. A tool that is rigid in all directions has rounding alone.
    """
    scale = np.repeat([1.0 / length, 1.0], 3)
    values, vectors = np.linalg.eigh(compliance * np.outer(scale, scale))
    largest = values[:, -1:].clip(min=1e-300)
    least = np.maximum(_RIGID * (element_compliance or largest), _ROUNDED * largest)
    counts = np.sum(values <= least, axis=1)
    out: list[Array] = list(repeat(np.zeros((0, 6)), len(compliance)))
    for count in set(counts.tolist()) - {0}:
        some = np.flatnonzero(counts == count)
        null = vectors[some][..., :count]
        rows = _independent_rows(null)
        wrenches = (
            null @ np.linalg.inv(np.take_along_axis(null, rows[..., None], axis=1))
        ).mT * scale
        size = np.abs(wrenches)
        wrenches[size < _ROUNDING * size.max(axis=2, keepdims=True)] = 0.0
        wrenches /= np.linalg.norm(wrenches, axis=2, keepdims=True)
        for k, each in zip(some, wrenches, strict=True):
            out[k] = each
    return tuple(out)


def _independent_rows(bases: Array) -> NDArray[np.int_]:
    """Return k rows (n, k), ascending, in which bases (n, 6, k) are regular, by QR with pivoting."""
    left = bases.copy()
    chosen = np.zeros((len(bases), bases.shape[2]), dtype=int)
    for step in range(bases.shape[2]):
        chosen[:, step] = np.square(left).sum(axis=2).argmax(axis=1)
        pivot = np.take_along_axis(left, chosen[:, step, None, None], axis=1)
        left -= left @ pivot.mT @ pivot / np.square(pivot).sum(axis=2, keepdims=True)
    return np.sort(chosen, axis=1)


def invert_stiffness(matrix: Array, free: NDArray[np.int_]) -> Array:
    """Return compliances (n, 6, 6); NaN if a direction (n,) is free or the stiffness is unknown."""
    out = np.full_like(matrix, np.nan)
    known = np.isfinite(matrix).all(axis=(1, 2)) & (free == 0)
    out[known] = np.linalg.inv(matrix[known])
    return 0.5 * (out + out.mT)


def rigid_note(rigid: Array) -> str | None:
    """Describe wrenches (k, 6) along which the tool is rigid; None if there are none."""
    if not len(rigid):
        return None
    rest = "its stiffness is infinite, see its compliance"
    many = say_count(len(rigid), "direction")
    return f"the tool is rigid in {many}: {_name_wrenches(rigid)}; {rest}"


def _name_wrenches(wrenches: Array) -> str:
    """Return the directions that wrenches (k, 6) span."""
    space = np.linalg.qr(wrenches.T)[0]
    return ", ".join(
        _name_rigid(direction)
        for direction in name_directions(space, "force", "moment", 1.0)
    )


def _name_rigid(direction: Direction) -> str:
    """Return a rigid direction with the way from the tool to the line of its force."""
    offset = np.zeros(3) if direction.offset is None else direction.offset
    if np.linalg.norm(offset) < _SHORT:
        return str(direction)
    return f"{direction}, its line ({', '.join(f'{1e3 * d + 0.0:.4g}' for d in offset.round(9))}) mm away"


def singular_note(matrix: Array, compliance: Array | None = None) -> str | None:
    """Describe a stiffness (6, 6) at or near a singularity; None if it is regular.

    ``compliance``: its inverse (6, 6), if known: nothing is free then, whatever K's condition.
    """
    if not np.isfinite(matrix).all():
        return None
    if compliance is not None and np.isfinite(compliance).all():
        count = 0
        values, vectors = _principal_of_compliance(compliance)
        inverse_condition = values[0] / values[-1]
        usual = np.sqrt(values[2] * values[3])
        stiff = values[-1] * values[0] > usual**2
    else:
        count, inverse_condition = count_freedoms(matrix)
        values, vectors = principal(matrix)
        stiff = values[0] * values[-1] > values[3] ** 2
    if not count and inverse_condition > _NEAR:
        return None
    rest = f"inverse condition number {inverse_condition:.2g}"
    if not count and stiff:
        return f"near a singular pose, nearly rigid: {_name_wrenches((matrix @ vectors[:, -1:]).T)}; {rest}"
    twist = vectors[:, 0]
    size = np.abs(vectors[:, 0])
    softest = ", ".join(
        f"{v:+.3g}" for v in np.where(size < _NEAR * size.max(), 0.0, twist)
    )
    state = (
        f"the tool moves freely in {say_count(int(count), 'direction')}"
        if count
        else "near a singular pose"
    )
    if values[0] < -max(_NEAR * values[3], _LOST):
        state = "unstable, the loads overturn it"
    return f"{state}: softest twist ({softest}), {rest}"


def _principal_of_compliance(compliance: Array) -> tuple[Array, Array]:
    """Return ascending principal stiffnesses (6,) and twists (6, 6) of a compliance (6, 6).

    Scaled by the length that equates mean compliances, which no rigid direction spoils.
    """
    diagonal = np.diag(compliance)
    length = np.sqrt(
        max(diagonal[:3].sum(), 0.0) / max(diagonal[3:].sum(), 1e-300)
    ).clip(*_LENGTHS)
    scale = np.repeat([1.0 / length, 1.0], 3)
    unit = compliance * np.outer(scale, scale)
    soft, vectors = np.linalg.eigh(unit)
    floor = np.finfo(float).eps * np.abs(soft).max()
    sizes = np.where(np.abs(soft) > floor, soft, floor)
    order = np.argsort(1.0 / sizes)
    return (1.0 / sizes)[order] * np.abs(soft).max(), vectors[:, order] / scale[:, None]
