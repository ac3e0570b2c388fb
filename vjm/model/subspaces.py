"""Subspaces of twists, wrenches and joint rates: ranks, direct sums and named directions."""

# pyright: reportMissingTypeStubs=false, reportUnknownArgumentType=false
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# (scipy declares few types)

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse.csgraph import connected_components

if TYPE_CHECKING:
    from stiffscope.vjm.model.screws import Array

RANK = 1e-9  # relative singular value below which a direction is free
ZERO = 1e-7  # component of a unit vector taken as zero


@dataclass(frozen=True, eq=False)
class Direction:
    """Twist or wrench by ``kind``, "translation", "rotation" or "screw", and ``axis`` (3,).

    For a redundant constraint: the translation or rotation that is held more than once.
    """

    kind: str
    axis: Array
    pitch: float = 0.0  # m/rad, of a screw
    offset: Array | None = (
        None  # (3,) from the reference to the nearest point of its line, m
    )

    def __str__(self) -> str:
        along = axis_name(self.axis)
        if self.kind == "screw":
            return f"screw about {along}, {1e3 * self.pitch:.3g} mm/rad"
        way = "along" if self.kind in {"translation", "force"} else "about"
        return f"{self.kind} {way} {along}"


def axis_name(axis: Array) -> str:
    """Return a direction as x, -y, or its components."""
    near = int(np.argmax(np.abs(axis)))
    if abs(abs(axis[near]) - 1.0) < 1e-6:
        return "xyz"[near]
    return (
        f"({', '.join(f'{c:.3g}' for c in np.where(np.abs(axis) < 1e-6, 0.0, axis))})"
    )


def split_spaces(matrix: Array) -> tuple[Array, tuple[float, float], Array]:
    """Return left null space, relative singular values (last kept, first dropped), null space."""
    if not matrix.size:
        return np.eye(len(matrix)), (1.0, 0.0), np.eye(matrix.shape[1])
    u, values, vt = np.linalg.svd(matrix)
    r = int(np.sum(values > RANK * values[0]))
    dropped = float(values[r] / values[0]) if r < len(values) else 0.0
    return u[:, r:], (float(values[r - 1] / values[0]), dropped), vt[r:].T


def null_space(matrix: Array) -> Array:
    """Return an orthonormal null space basis (n, k) of a matrix (m, n), entries of order 1."""
    if not matrix.size:
        return np.eye(matrix.shape[1])
    _, values, vt = np.linalg.svd(matrix, full_matrices=len(matrix) < matrix.shape[1])
    return vt[int(np.sum(values > RANK)) :].T


def range_space(matrix: Array) -> Array:
    """Return an orthonormal basis (m, r) of the range of a matrix (m, n) of entries of order 1."""
    if not matrix.size:
        return np.zeros((len(matrix), 0))
    u, values, _ = np.linalg.svd(matrix, full_matrices=False)
    return u[:, values > RANK]


def rank(matrix: Array) -> int:
    """Return the rank of a matrix, relative to its largest singular value."""
    values = np.linalg.svd(matrix, compute_uv=False)
    return int(np.sum(values > RANK * max(values[0], 1e-300))) if values.size else 0


def find_blocks(basis: Array, sizes: list[int]) -> list[tuple[list[int], int]]:
    """Return the independent groups of row blocks in the space ``basis`` (n, k), with dimensions.

    The orthogonal projector onto a space is block diagonal exactly if the space is a direct sum.
    """
    projector = basis @ basis.T
    owner = np.repeat(np.arange(len(sizes)), sizes)
    rows, columns = np.nonzero(np.abs(projector) > ZERO)
    touch = np.zeros((len(sizes), len(sizes)), dtype=bool)
    touch[owner[rows], owner[columns]] = True
    label = connected_components(touch, directed=False)[1]
    groups = [
        np.flatnonzero(label == k)
        for k in dict.fromkeys(label[touch.diagonal()].tolist())
    ]
    sizes_of = np.bincount(owner, projector.diagonal(), len(sizes))
    return [(group.tolist(), round(float(sizes_of[group].sum()))) for group in groups]


def name_directions(
    basis: Array, bound: str, free: str, length: float
) -> list[Direction]:
    """Return directions of a screw space (6, k); line (force, angular velocity) before couple.

    First pure couples (``free``), then lines (``bound``) with the smallest pitch that the couples
    allow.

    Parameters
    ----------
    basis
        Basis (6, k) of the space of screws.
    bound
        Kind of a direction with a line.
    free
        Kind of a couple.
    length
        Characteristic length (m) that scales rotations to translations.
    """
    couples = basis[3:] @ null_space(basis[:3])
    out = [Direction(free, axis) for axis in _align(couples)]
    lines = range_space(basis[:3])
    off = np.eye(3) - range_space(couples) @ range_space(couples).T
    for axis in _align(lines):
        screw = basis @ np.linalg.lstsq(basis[:3], axis, rcond=None)[0]
        pitch = float((off @ screw[3:]) @ (off @ axis))
        if np.linalg.norm(couples.T @ axis) > ZERO:
            pitch = 0.0  # a couple about the same axis removes the pitch
        real = abs(pitch) > 1e-6
        offset = length * np.cross(axis, off @ screw[3:])
        out.append(
            Direction(
                "screw" if real else bound,
                axis,
                pitch * length if real else 0.0,
                offset,
            )
        )
    return out


def _align(space: Array) -> list[Array]:
    """Return an orthonormal basis of a space (3, k), along x, y, z if possible."""
    basis = range_space(space)
    out: list[Array] = []
    while basis.shape[1]:
        shares = np.linalg.norm(basis, axis=1)
        axis = basis @ basis[int(np.flatnonzero(shares > shares.max() - 1e-6)[0])]
        axis = axis / np.linalg.norm(axis)
        out.append(axis)
        basis = range_space(basis - np.outer(axis, axis @ basis))
    order = sorted(range(len(out)), key=lambda k: int(np.argmax(np.abs(out[k]))))
    return [out[k] for k in order]
