"""Rotations and transforms of twists for stacks of poses; twists are (v, ω), wrenches (f, m)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

_PARALLEL = 1e-9


def skew(r: Array) -> Array:
    """Return S(r) (..., 3, 3) with S(r) a = r × a."""
    out = np.zeros((*r.shape, 3))
    x, y, z = r[..., 0], r[..., 1], r[..., 2]
    out[..., 0, 1], out[..., 0, 2] = -z, y
    out[..., 1, 0], out[..., 1, 2] = z, -x
    out[..., 2, 0], out[..., 2, 1] = -y, x
    return out


def turn(vector: Array) -> Array:
    """Return the rotation (..., 3, 3) of a rotation vector (..., 3)."""
    angle = np.linalg.norm(vector, axis=-1)[..., None, None]
    s = skew(vector)
    near = np.maximum(angle, 1e-12)
    return np.eye(3) + np.sinc(angle / np.pi) * s + 2.0 * (np.sin(near / 2.0) / near) ** 2 * (s @ s)


def vector_of(rotation: Array) -> Array:
    """Return the rotation vectors (..., 3) of rotations by less than π."""
    half = 0.5 * (rotation - np.swapaxes(rotation, -1, -2))
    s = np.stack([half[..., 2, 1], half[..., 0, 2], half[..., 1, 0]], axis=-1)
    sine = np.linalg.norm(s, axis=-1)
    angle = np.arctan2(sine, 0.5 * (np.trace(rotation, axis1=-2, axis2=-1) - 1.0))
    return s * np.where(sine > _PARALLEL, angle / np.where(sine > _PARALLEL, sine, 1.0), 1.0)[..., None]


def rates_of_vector(vector: Array) -> Array:
    """Return the map (..., 3, 3) of angular velocity to the rate of a rotation vector."""
    angle = np.linalg.norm(vector, axis=-1)[..., None, None]
    s = skew(vector)
    large = np.where(angle < 1e-3, 1.0, angle)
    exact = 1.0 / large**2 - (1.0 + np.cos(large)) / (2.0 * large * np.sin(large))
    return np.eye(3) - 0.5 * s + np.where(angle < 1e-3, 1.0 / 12.0 + angle**2 / 720.0, exact) * (s @ s)


def lever(points: Array) -> Array:
    """Return the map (..., 6, 6) of a twist about the origin to points (..., 3): v + ω × r."""
    out = np.broadcast_to(np.eye(6), (*points.shape[:-1], 6, 6)).copy()
    out[..., :3, 3:] = -skew(points)
    return out


def transform_to(axes: Array, points: Array) -> Array:
    """Return the map (..., 6, 6) of a twist about the origin to axes at points (..., 3)."""
    return both_parts(np.swapaxes(axes, -1, -2)) @ lever(points)


def both_parts(rotation: Array) -> Array:
    """Return the matrix (..., 6, 6) that rotates both vectors of a twist or wrench."""
    out = np.zeros((*rotation.shape[:-2], 6, 6))
    out[..., :3, :3] = out[..., 3:, 3:] = rotation
    return out


def about_x(angle: Array) -> Array:
    """Return rotations (..., 3, 3) about x by angles (...)."""
    return turn(angle[..., None] * np.eye(3)[0])


def axes_along(x: Array, y: Array | None = None) -> Array:
    """Return axes (3, 3) as columns: x along `x`, y nearest to `y` or the next base axis."""
    along = x / np.linalg.norm(x)
    side = np.eye(3)[(int(np.argmax(np.abs(along))) + 1) % 3] if y is None else y
    normal = np.cross(along, side)
    normal = normal / np.linalg.norm(normal)
    return np.column_stack([along, np.cross(normal, along), normal])
