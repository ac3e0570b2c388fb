"""Stiffness of a robot at many poses: each stance once, in chunks of the stack; mobility, sag."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, Protocol

import numpy as np
from numpy.polynomial.chebyshev import chebvander

from stiffscope.errors import InputError
from stiffscope.vjm.biglide import Biglide
from stiffscope.vjm.checks import checked_poses
from stiffscope.vjm.gravity import STANDARD, exact_stiffness, literal_tree
from stiffscope.vjm.reduction import as_stiffness
from stiffscope.vjm.response import tool_twist

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.typing import ArrayLike, NDArray

    from stiffscope.vjm.elastic import Node
    from stiffscope.vjm.screws import Array

Gravity = Literal["none", "literal", "exact"]
CHUNK = 2048  # poses; what is at work stays within the processor's cache
_FEW = 1024  # poses, below which a series costs more than it spares
_DEGREE = 24  # of a series along a robot's only parameter
_ALIKE = 3e-12  # what it may be off, as a share of the largest entry of the same unit
_FREE = 1e-9  # relative principal stiffness below which a direction is free
_NEAR = 1e-6  # and below which the pose is near singular
_LENGTHS = 1e-3, 10.0  # m, of a robot's own length; beyond, its rotations or translations are but rounding
_FAR = 0.1  # rad, and of its own length, that weights may move the tool; beyond, nothing linear tells where it is


class Robot(Protocol):
    """Anything that gives its elastic tree at tool points (n, 3)."""

    def tree(self, poses: ArrayLike) -> Node:
        """The elastic robot seen from its tool."""
        ...

    def stance(self, poses: ArrayLike) -> Array:
        """What of the tool points (n, 3) the tree depends on, (n, k): poses of one stance are worked out once.

        Raises InputError for an unreachable pose. Where k is 1 the tree's numbers are taken to be piecewise smooth.
        """
        ...


@dataclass(frozen=True)
class Stiffness:
    """What a robot does at n poses, at M in axes {O}.

    ``matrix`` (n, 6, 6) in N/m, N, N·m/rad; ``sag`` (n, 6) in m, rad; ``mobility`` (n,): free directions left;
    ``reserve`` (n,): smallest over largest principal stiffness, lengths scaled by the robot's own (0 is singular).
    """

    poses: Array
    matrix: Array
    sag: Array
    mobility: NDArray[np.int_]
    reserve: Array


def stiffness(robot: Robot, poses: ArrayLike, *, gravity: Gravity = "none", g: float = STANDARD) -> Array:
    """Stiffness (n, 6, 6) at tool points (n, 3) in m, at M in axes {O}. Raises InputError for an unreachable pose."""
    if gravity == "none":
        return _over(robot, poses, (6, 6), lambda p: as_stiffness(robot.tree(p)))
    if gravity == "exact":
        return _over(robot, poses, (6, 6), lambda p: exact_stiffness(robot.tree(p), g))
    if not isinstance(robot, Biglide):
        msg = "gravity 'literal' is the paper's K_θ - K_G and stands for the Biglide only; 'exact' serves any robot"
        raise InputError(msg)
    return _over(robot, poses, (6, 6), lambda p: as_stiffness(literal_tree(robot, p, g)))


def batches(
    robot: Robot, poses: ArrayLike, *, gravity: Gravity = "none", g: float = STANDARD, size: int = 65536
) -> Iterator[tuple[slice, Array]]:
    """Yield which poses (n, 3) and their stiffness (m, 6, 6), ``size`` at a time: for more than memory should hold."""
    points = checked_poses(poses)
    for start in range(0, len(points), size):
        some = slice(start, start + size)
        yield some, stiffness(robot, points[some], gravity=gravity, g=g)


def sag(robot: Robot, poses: ArrayLike, *, g: float = STANDARD) -> Array:
    """Twist (n, 6) of the platform under the robot's own weight and misfits. Raises where the tool moves freely."""
    return _over(robot, poses, (6,), lambda p: tool_twist(robot.tree(p), gravity=g, misfit=True))


def analyse(robot: Robot, poses: ArrayLike, *, gravity: Gravity = "none", g: float = STANDARD) -> Stiffness:
    """Stiffness, mobility and (with gravity) sag at tool points (n, 3) in m.

    Where weights find no equilibrium near by, the stiffness is the one without them, and the sag is NaN.
    """
    points = checked_poses(poses)
    matrix, droop = stiffness(robot, points), np.zeros((len(points), 6))
    if gravity != "none":
        loaded, droop = under_weight(robot, points, matrix, gravity=gravity, g=g)
        matrix = np.where(np.isnan(droop[:, :1, None]), matrix, loaded)
    return Stiffness(points, matrix, droop, *mobility(matrix))


def under_weight(
    robot: Robot, points: Array, unloaded: Array, *, gravity: Gravity, g: float = STANDARD
) -> tuple[Array, Array]:
    """Stiffness (n, 6, 6) and sag (n, 6) under weights at points whose ``unloaded`` stiffness (n, 6, 6) is known.

    Both are NaN where the tool moves freely, or where the weights would turn it by more than a tenth of a radian or
    move it by more than a tenth of its own length.
    """
    matrix, droop = np.full_like(unloaded, np.nan), np.full((len(points), 6), np.nan)
    firm = np.flatnonzero(mobility(unloaded)[0] == 0)
    if firm.size:
        sagged = sag(robot, points[firm], g=g)
        size = np.ones((len(firm), 6))
        size[:, :3] = own_length(unloaded[firm])[:, None]
        small = (np.abs(sagged) < _FAR * size).all(axis=1)
        firm = firm[small]
        droop[firm] = sagged[small]
    if firm.size:
        matrix[firm] = stiffness(robot, points[firm], gravity=gravity, g=g)
    return matrix, droop


def principal(matrix: Array) -> tuple[Array, Array]:
    """Eigenvalues (..., 6), ascending, and directions of stiffnesses scaled to the robot's own length and stiffness, so
    that no unit decides.
    """
    force = np.einsum("...ii->...", matrix[..., :3, :3]) / 3.0
    scale = np.ones(matrix.shape[:-1])
    scale[..., 3:] = own_length(matrix)[..., None]
    unit = matrix / (scale[..., :, None] * scale[..., None, :]) / np.where(force > 0.0, force, 1.0)[..., None, None]
    values, vectors = np.linalg.eigh(unit)
    return values, vectors / scale[..., :, None]


def own_length(matrix: Array) -> Array:
    """Length (...) in m that makes the mean rotational entry of stiffnesses (..., 6, 6) equal to the translational."""
    force, moment = (np.einsum("...ii->...", block) for block in (matrix[..., :3, :3], matrix[..., 3:, 3:]))
    return np.sqrt(moment.clip(min=0.0) / np.where(force > 0.0, force, 1.0)).clip(*_LENGTHS)


def mobility(matrix: Array) -> tuple[NDArray[np.int_], Array]:
    """Free directions (...,) of stiffnesses (..., 6, 6), and the smallest over the largest principal stiffness."""
    values, _ = principal(matrix)
    ratio = values / np.where(values[..., -1:] > 0.0, values[..., -1:], 1.0)
    return np.sum(np.abs(ratio) < _FREE, axis=-1), np.clip(ratio[..., 0], 0.0, None)


def softest(matrix: Array) -> Array:
    """Twist (..., 6) of unit size along the least principal stiffness: the free direction near a singular pose."""
    return principal(matrix)[1][..., :, 0]


def singular_note(matrix: Array) -> str | None:
    """What to tell of a pose at or near a singularity, or None; for one stiffness (6, 6)."""
    count, reserve = mobility(matrix)
    if not count and reserve > _NEAR:
        return None
    twist = softest(matrix)
    direction = ", ".join(f"{v:+.3g}" for v in np.where(np.abs(twist) < _NEAR * np.abs(twist).max(), 0.0, twist))
    state = f"the tool moves freely in {int(count)} direction(s)" if count else "near a singular pose"
    if principal(matrix)[0][0] < -_NEAR:
        state = "unstable, the loads overturn it"
    return f"{state}: softest twist ({direction}), reserve {float(reserve):.2g}"


def _over(robot: Robot, poses: ArrayLike, entries: tuple[int, ...], work: Callable[[Array], Array]) -> Array:
    """Work on distinct stances only; on a few of them where one number makes a stance and a series tells the rest."""
    points = checked_poses(poses)
    stances = robot.stance(points)
    first, again = _distinct(stances)

    def each(some: Array) -> Array:  # of a tree that holds for all poses, too
        return np.broadcast_to(work(some), (len(some), *entries))

    if stances.shape[1] == 1:
        return _along(points[first], stances[first, 0], each)[again]
    return _chunked(points[first], each)[again]


def _along(points: Array, stance: Array, work: Callable[[Array], Array]) -> Array:
    """Work at points (n, 3) of a stance (n,), ascending, that is one number: by a series where one holds."""
    if len(points) < _FEW:
        return _chunked(points, work)
    unit = (2.0 * stance - stance[0] - stance[-1]) / (stance[-1] - stance[0])
    told = _told(points, unit, work)
    if told is None:
        middle = int(np.searchsorted(unit, 0.0))
        halves = slice(middle), slice(middle, None)
        return np.concatenate([_along(points[half], stance[half], work) for half in halves])
    return told


def _told(points: Array, unit: Array, work: Callable[[Array], Array]) -> Array | None:
    """Work by a Chebyshev series along ``unit`` (n,), -1 to 1, fitted at some points; None where others belie it."""
    nodes = np.cos(np.linspace(0.0, np.pi, 4 * _DEGREE + 1)).clip(max=unit[-1])
    some = np.unique(np.searchsorted(unit, nodes))
    if len(some) < 3 * _DEGREE:
        return None
    known = work(points[some])
    flat = known.reshape(len(some), -1)
    series = np.linalg.lstsq(chebvander(unit[some[::2]], _DEGREE), flat[::2])[0]
    off = np.abs(chebvander(unit[some[1::2]], _DEGREE) @ series - flat[1::2])
    if not (off <= _ALIKE * _size(known[1::2]).reshape(off.shape)).all():
        return None
    return _chunked(unit, lambda u: chebvander(u, _DEGREE) @ series).reshape(len(points), *known.shape[1:])


def _size(values: Array) -> Array:
    """Largest of the entries that have an entry's unit, in each of stacked screws (n, 6) or matrices (n, 6, 6)."""
    size = np.abs(values)
    for axis in range(1, size.ndim):
        halves = [np.broadcast_to(h.max(axis, keepdims=True), h.shape) for h in np.split(size, 2, axis)]
        size = np.concatenate(halves, axis)
    return size


def _distinct(rows: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Where each distinct row (n, k) first stands, and which of them every row is; a sixth of np.unique's time."""
    order = np.lexsort(rows.T) if rows.shape[1] else np.arange(len(rows))
    ordered = rows[order]
    fresh = np.ones(len(rows), dtype=bool)
    fresh[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    again = np.empty(len(rows), dtype=np.intp)
    again[order] = np.cumsum(fresh) - 1
    return order[fresh], again


def _chunked(rows: Array, work: Callable[[Array], Array]) -> Array:
    """Work on some rows at a time: memory grows with the result alone."""
    first = work(rows[:CHUNK])
    out = np.empty((len(rows), *first.shape[1:]))
    out[:CHUNK] = first
    for start in range(CHUNK, len(rows), CHUNK):
        out[start : start + CHUNK] = work(rows[start : start + CHUNK])
    return out
