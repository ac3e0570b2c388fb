"""Rotations and transforms of twists for stacks of poses; twists are (v, ω), wrenches (f, m)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation  # pyright: ignore[reportMissingTypeStubs]

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]


def skew(r: Array) -> Array:
    """Return S(r) (..., 3, 3) with S(r) a = r × a."""
    return np.swapaxes(np.cross(r[..., None, :], np.eye(3)), -1, -2)


def turn(vector: Array) -> Array:
    """Return the rotation (..., 3, 3) of a rotation vector (..., 3)."""
    return Rotation.from_rotvec(vector).as_matrix()


def vector_of(rotation: Array) -> Array:
    """Return the rotation vectors (..., 3) of rotations by less than π."""
    return Rotation.from_matrix(rotation).as_rotvec()


def rates_of_vector(vector: Array) -> Array:
    """Return the map (..., 3, 3) of angular velocity to the rate of a rotation vector."""
    angle = np.linalg.norm(vector, axis=-1)[..., None, None]
    s = skew(vector)
    large = np.where(angle < 1e-3, 1.0, angle)
    exact = 1.0 / large**2 - (1.0 + np.cos(large)) / (2.0 * large * np.sin(large))
    square = np.where(angle < 1e-3, 1.0 / 12.0 + angle**2 / 720.0, exact)
    return np.eye(3) - 0.5 * s + square * (s @ s)


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


def axes_along(x: Array, y: Array | None = None) -> Array:
    """Return axes (3, 3) as columns: x along `x`, y nearest to `y` or the next base axis."""
    along = x / np.linalg.norm(x)
    side = np.eye(3)[(int(np.argmax(np.abs(along))) + 1) % 3] if y is None else y
    normal = np.cross(along, side)
    normal = normal / np.linalg.norm(normal)
    return np.column_stack([along, np.cross(normal, along), normal])
