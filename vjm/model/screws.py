"""Screws: twists, wrenches and frames.

The one convention of the project: a twist is (v, ω), a wrench is (f, m), both at a named point and
in named axes, SI units, float64. A stack of poses is the leading axis: ``(n, 6, 6)``; an array
without it holds for every pose.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array: TypeAlias = NDArray[np.floating[Any]]

CONVENTION = {
    "order": "x y z rx ry rz: twist (v, omega) in m, rad; wrench (f, m) in N, N m",
    "point": "tool point M",
    "axes": "base axes {O}",
    "units": "SI",
}
"""The convention in words, written into result files."""

HALF_TURN = np.diag([-1.0, -1.0, 1.0, -1.0, -1.0, 1.0])
"""Half turn about z; the opposite part's compliance is ``HALF_TURN @ C @ HALF_TURN``."""


def skew(r: ArrayLike, out: Array | None = None) -> Array:
    """Return S(r), with ``S(r) @ a = r × a``, of vectors (..., 3); ``out``: zeros to write into."""
    r = np.asarray(r, dtype=float)
    s = np.zeros((*r.shape, 3)) if out is None else out
    s[..., 0, 1] = -r[..., 2]
    s[..., 0, 2] = r[..., 1]
    s[..., 1, 0] = r[..., 2]
    s[..., 1, 2] = -r[..., 0]
    s[..., 2, 0] = -r[..., 1]
    s[..., 2, 1] = r[..., 0]
    return s


def shift(r: ArrayLike) -> Array:
    """Return the twist transform ``[[I, -S(r)], [0, I]]`` from P to P + r; (..., 3) to (..., 6, 6).

    Wrenches transform with its inverse transpose.
    """
    return Frame(translation=-np.asarray(r, dtype=float)).adjoint()


def rotation(axis: ArrayLike, angle: ArrayLike) -> Array:
    """Return rotations (..., 3, 3) about a unit axis (3,) by angles (...) in rad (Rodrigues)."""
    s = skew(axis)
    angle = np.asarray(angle, dtype=float)[..., None, None]
    return np.eye(3) + np.sin(angle) * s + (1.0 - np.cos(angle)) * (s @ s)


@dataclass(frozen=True)
class Frame:
    """Pose of a child frame in its parent: ``p_parent = rotation @ p_child + translation``.

    Either part may be a stack over poses. ``None`` means no rotation or no translation.
    """

    rotation: Array | None = None  # (..., 3, 3)
    translation: Array | None = None  # (..., 3) m

    def matrix(self) -> Array:
        """Return the rotation as a matrix, (..., 3, 3)."""
        return np.eye(3) if self.rotation is None else self.rotation

    def origin(self) -> Array:
        """Return the translation as a vector, (..., 3) m."""
        return np.zeros(3) if self.translation is None else self.translation

    def adjoint(self) -> Array:
        """Return the twist transform ``[[R, S(p)R], [0, R]]`` from child to parent, (..., 6, 6)."""
        r = self.matrix()
        moment = None if self.translation is None else skew(self.translation) @ r
        return _blocks(r, moment)

    def inverse_adjoint(self) -> Array:
        """Carry a twist from the parent to the child: ``[[Rᵀ, -RᵀS(p)], [0, Rᵀ]]``, (..., 6, 6)."""
        rt = self.matrix().mT
        moment = None if self.translation is None else -(rt @ skew(self.translation))
        return _blocks(rt, moment)

    def point(self, p: Array) -> Array:
        """Transform a point (..., 3) from the child's to the parent's coordinates."""
        turned = p if self.rotation is None else (self.rotation @ p[..., None])[..., 0]
        return turned if self.translation is None else turned + self.translation


def rotation_of(vector: Array) -> Array:
    """Return the rotation matrix (..., 3, 3) of a rotation vector (..., 3) in rad."""
    angle = np.sqrt(np.einsum("...i,...i->...", vector, vector))[..., None, None]
    s = skew(vector)
    half = np.sinc(angle / (2.0 * np.pi))
    return np.eye(3) + half * np.cos(0.5 * angle) * s + 0.5 * half**2 * (s @ s)


def _blocks(diagonal: Array, corner: Array | None) -> Array:
    shape = (
        diagonal.shape
        if corner is None
        else np.broadcast_shapes(diagonal.shape, corner.shape)
    )
    out = np.zeros((*shape[:-2], 6, 6))
    out[..., :3, :3] = diagonal
    out[..., 3:, 3:] = diagonal
    if corner is not None:
        out[..., :3, 3:] = corner
    return out
