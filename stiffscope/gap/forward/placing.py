"""Initial pose of an instrument from measured points and their nominal positions."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import numpy as np

if TYPE_CHECKING:
    from stiffscope.runtime.types import Array, Flags, Indices

_OUTLYING = 8.0  # robust standard deviations
_PASSES = 6
_FLAT = 1e-6  # relative to the largest extent of points: coplanar below
_LEAST = 3  # fewest points that determine an orientation


def find_outlying(left: Array) -> Flags:
    """Return flags (n,) of outlying residuals."""
    spread = 1.4826 * np.median(np.abs(left)) if len(left) else 0.0
    return np.abs(left) > (_OUTLYING * spread if spread > 0.0 else np.inf)


def find_frame(
    triples: Indices, ranged: Flags, points: Array, read: Array
) -> tuple[Array, Array]:
    """Return axes (3, 3) and origin (3,) of an instrument.

    Parameters
    ----------
    triples
        (k, 3) readings that are simultaneous x, y and z of one target.
    ranged
        (n,) whether readings are distances.
    points
        (n, 3) nominal target positions.
    read
        (n,) readings.
    """
    if len(triples) >= _LEAST or not ranged.any():
        return align_points(read[triples], points[triples[:, 0]])
    return np.eye(3), locate_by_distances(points[ranged], read[ranged])


def align_points(seen: Array, there: Array) -> tuple[Array, Array]:
    """Return the rotation and translation that best align points (k, 3), ignoring outliers.

    References
    ----------
    Kabsch, A solution for the best rotation to relate two sets of vectors, Acta Cryst. A 32 (1976).
    """
    used = np.ones(len(seen), dtype=np.bool_)
    rotation = np.eye(3)
    origin = np.zeros(3)
    for _ in range(_PASSES):
        if not used.any():
            break
        middle = seen[used].mean(axis=0)
        target = there[used].mean(axis=0)
        u, _, v = np.linalg.svd((there[used] - target).T @ (seen[used] - middle))
        rotation = u @ np.diag([1.0, 1.0, np.linalg.det(u @ v)]) @ v
        origin = target - rotation @ middle
        keep = ~find_outlying(
            np.linalg.norm(there - seen @ rotation.T - origin, axis=1)
        )
        if np.array_equal(keep, used):
            break
        used = keep
    return rotation, origin


def locate_by_distances(points: Array, lengths: Array) -> Array:
    """Return the point (3,) at distances (n,) from others (n, 3).

    ``|p|² - 2 p·x + |x|² = d²`` is linear in x and |x|². For coplanar points the upper x is taken.
    """
    middle = points.mean(axis=0)
    p = points - middle
    _, size, axes = np.linalg.svd(p, full_matrices=False)
    solid = size > _FLAT * size[0]
    q = p @ axes[solid].T
    design = np.column_stack([-2.0 * q, np.ones(len(q))])
    right = lengths**2 - np.sum(q**2, axis=1)
    solution = cast("Array", np.linalg.lstsq(design, right, rcond=None)[0])
    x = solution[:-1] @ axes[solid]
    left = max(float(solution[-1] - x @ x), 0.0)
    if not solid.all():
        away = axes[~solid][0]
        x = x + np.sqrt(left) * away * (
            1.0 if away[np.argmax(np.abs(away))] > 0.0 else -1.0
        )
    return middle + x
