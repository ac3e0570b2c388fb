"""A direct-stiffness frame of rigid bodies: global assembly, explicit freedoms, multipliers.

Every body has six dofs, its twist (v, ω) about the origin of the world axes. A connection joins two bodies
at a point in its own axes; each of its six directions is free, rigid or elastic. All is one system

    [[K, Gᵀ], [G, 0]] (u, λ) = (f, g)

solved for a stack of geometries at once (leading axis n). Nothing is taken from the virtual-joint model.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    Flags = NDArray[np.bool_]

GROUND = -1
_ROW_SCALE = 1e8  # N/m: brings the multipliers' rows to the size of the stiffness rows


def lever(points: Array) -> Array:
    """Return the matrices that carry a twist about the origin to points (n, 3): v + ω × r; (n, 6, 6)."""
    out = np.broadcast_to(np.eye(6), (len(points), 6, 6)).copy()
    x, y, z = points.T
    out[:, 0, 4], out[:, 0, 5] = z, -y
    out[:, 1, 3], out[:, 1, 5] = -z, x
    out[:, 2, 3], out[:, 2, 4] = y, -x
    return out


@dataclass(frozen=True)
class Connection:
    """What joins body `first` to body `second` at `points` (n, 3) in `axes` (n, 3, 3, columns).

    compliance: (6, 6) or (n, 6, 6); a zero row and column is a rigid direction, the rest is positive.
    free: (6,) directions that transmit nothing.
    """

    name: str
    first: int
    second: int
    points: Array
    axes: Array
    compliance: Array
    free: Flags


def _stiffness(compliance: Array, free: Flags, name: str) -> tuple[Flags, Array]:
    """Return the elastic directions and the stiffness (n, k, k) of their block.

    Raises InputError where that block is not positive definite.
    """
    stack = compliance if compliance.ndim == 3 else compliance[None]
    elastic: Flags = ~free & np.any(stack != 0.0, axis=(0, 2))
    block = stack[:, elastic][:, :, elastic]
    try:
        np.linalg.cholesky(block)
    except np.linalg.LinAlgError:
        message = f"{name}: expected a symmetric compliance that is positive in each direction that yields"
        raise InputError(message) from None
    return elastic, np.asarray(np.linalg.inv(block), dtype=np.float64)


def _relative(connection: Connection) -> Array:
    """Return what maps a body's twist about the origin to the connection's point and axes; (n, 6, 6)."""
    turn = np.zeros((len(connection.points), 6, 6))
    back = np.swapaxes(connection.axes, 1, 2)
    turn[:, :3, :3] = back
    turn[:, 3:, 3:] = back
    return turn @ lever(connection.points)


class Structure:
    """An assembled frame, ready to be loaded. Built once from its connections and read-only after that."""

    def __init__(self, bodies: int, connections: Sequence[Connection]) -> None:
        self.connections = tuple(connections)
        self._by_name = {c.name: c for c in self.connections}
        self._maps = {c.name: _relative(c) for c in self.connections}
        self._elastic = {c.name: _stiffness(c.compliance, c.free, c.name) for c in self.connections}
        n = max(len(c.points) for c in self.connections)
        self._dofs = 6 * bodies
        rows: dict[str, slice] = {}
        size = self._dofs
        for c in self.connections:
            count = int(np.count_nonzero(self._rigid(c)))
            rows[c.name] = slice(size, size + count)
            size += count
        self._rows = rows
        self.matrix = np.zeros((n, size, size))
        for c in self.connections:
            self._add(c)

    def _rigid(self, c: Connection) -> Flags:
        return ~c.free & ~self._elastic[c.name][0]

    def _sides(self, c: Connection) -> list[tuple[float, slice]]:
        pairs = ((-1.0, c.first), (1.0, c.second))
        return [(sign, slice(6 * body, 6 * body + 6)) for sign, body in pairs if body != GROUND]

    def _add(self, c: Connection) -> None:
        elastic, stiffness = self._elastic[c.name]
        soft = self._maps[c.name][:, elastic]
        hard = _ROW_SCALE * self._maps[c.name][:, self._rigid(c)]
        row = self._rows[c.name]
        block = np.swapaxes(soft, 1, 2) @ stiffness @ soft
        for sign, at in self._sides(c):
            self.matrix[:, row, at] += sign * hard
            self.matrix[:, at, row] += sign * np.swapaxes(hard, 1, 2)
            for other, where in self._sides(c):
                self.matrix[:, at, where] += sign * other * block

    def load(self, body: int, points: Array, wrench: Array) -> Array:
        """Return the right-hand side (n, size) of a wrench (6,) or (n, 6) on a body at points (n, 3)."""
        out = np.zeros(self.matrix.shape[:2])
        at_origin = np.swapaxes(lever(points), 1, 2) @ np.broadcast_to(wrench, (len(points), 6))[..., None]
        out[:, 6 * body : 6 * body + 6] = at_origin[..., 0]
        return out

    def offset_load(self, name: str, rest: Array) -> Array:
        """Return the right-hand side (n, size) of a connection that rests at a twist (6,) or (n, 6)."""
        c = self._by_name[name]
        out = np.zeros(self.matrix.shape[:2])
        full = np.broadcast_to(rest, (len(out), 6))
        elastic, stiffness = self._elastic[name]
        out[:, self._rows[name]] = _ROW_SCALE * full[:, self._rigid(c)]
        push = np.swapaxes(self._maps[name][:, elastic], 1, 2) @ stiffness @ full[:, elastic, None]
        for sign, at in self._sides(c):
            out[:, at] += sign * push[..., 0]
        return out

    def solve(self, right: Array) -> Array:
        """Return the bodies' twists and multipliers (n, size, k) for right-hand sides (n, size, k)."""
        return np.asarray(np.linalg.solve(self.matrix, right), dtype=np.float64)

    def twist(self, solution: Array, body: int, points: Array) -> Array:
        """Return twists (n, 6, k) of a body at points (n, 3)."""
        return lever(points) @ solution[:, 6 * body : 6 * body + 6]

    def relative(self, solution: Array, name: str) -> Array:
        """Return twists (n, 6, k) of a connection's second body relative to its first, in its axes."""
        c = self._by_name[name]
        moved = sum(sign * solution[:, at] for sign, at in self._sides(c))
        return self._maps[name] @ moved

    def stiffness(self, name: str) -> tuple[Flags, Array]:
        """Return which directions of a connection are elastic (6,), and their stiffness (n or 1, k, k)."""
        return self._elastic[name]
