"""Principal stiffness, free directions and closeness to a singularity."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from stiffscope.vjm.model.subspaces import name_directions

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from stiffscope.vjm.model.screws import Array
    from stiffscope.vjm.model.subspaces import Direction

_FREE = 1e-9  # of the fourth principal stiffness: a smaller one is free
_LOST = 1e-12  # of the largest principal stiffness: rounding
_RIGID = 1e-10  # relative principal compliance below which a direction is rigid
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


def rigid_wrenches(compliance: Array, length: float) -> tuple[Array, ...]:
    """Return unit wrenches (k, 6) that do not deflect each of compliances (n, 6, 6).

    Each has a component that the others lack. ``length`` scales rotations.
    """
    scale = np.repeat([1.0 / length, 1.0], 3)
    values, vectors = np.linalg.eigh(compliance * np.outer(scale, scale))
    counts = np.sum(values <= _RIGID * values[:, -1:].clip(min=1e-300), axis=1)
    out = [np.zeros((0, 6))] * len(compliance)
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
    return f"the tool is rigid in {len(rigid)} direction(s): {_name_wrenches(rigid)}; {rest}"


def _name_wrenches(wrenches: Array) -> str:
    """Return the directions that wrenches (k, 6) span."""
    space = np.linalg.qr(wrenches.T)[0]
    return ", ".join(
        _name_rigid(each) for each in name_directions(space, "force", "moment", 1.0)
    )


def _name_rigid(direction: Direction) -> str:
    """Return a rigid direction with the way from the tool to the line of its force."""
    offset = np.zeros(3) if direction.offset is None else direction.offset
    if np.linalg.norm(offset) < _SHORT:
        return str(direction)
    return f"{direction}, its line ({', '.join(f'{1e3 * d + 0.0:.4g}' for d in offset.round(9))}) mm away"


def singular_note(matrix: Array) -> str | None:
    """Describe a stiffness (6, 6) at or near a singularity; None if it is regular."""
    if not np.isfinite(matrix).all():
        return None
    count, inverse_condition = count_freedoms(matrix)
    if not count and inverse_condition > _NEAR:
        return None
    values, vectors = principal(matrix)
    rest = f"inverse condition number {inverse_condition:.2g}"
    if not count and values[0] * values[-1] > values[3] ** 2:
        return f"near a singular pose, nearly rigid: {_name_wrenches((matrix @ vectors[:, -1:]).T)}; {rest}"
    twist = vectors[:, 0]
    size = np.abs(vectors[:, 0])
    softest = ", ".join(
        f"{v:+.3g}" for v in np.where(size < _NEAR * size.max(), 0.0, twist)
    )
    state = (
        f"the tool moves freely in {count} direction(s)"
        if count
        else "near a singular pose"
    )
    if values[0] < -max(_NEAR * values[3], _LOST):
        state = "unstable, the loads overturn it"
    return f"{state}: softest twist ({softest}), {rest}"
