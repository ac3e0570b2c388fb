"""Direct stiffness method: six dofs for each node, a multiplier for each constrained direction.

A node's dofs are its twist about the origin of the base axes. An element connects two nodes at a
point in its own axes; in its constrained directions H, the relative motion of the second node is
t₀ + C λ under the wrench λ. The system for a stack of poses (leading axis n) is

    [[0, Bᵀ], [B, -C]] (u, λ) = (f, t₀),  B = H J,

with J from dofs to the element's relative motion. Idle motions and redundant constraints make it
singular but consistent: it is solved with a small diagonal shift and iterative refinement.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.linalg import (  # pyright: ignore[reportMissingTypeStubs]
    lu_factor,  # pyright: ignore[reportUnknownVariableType]
    lu_solve,  # pyright: ignore[reportUnknownVariableType]
)

from stiffscope.errors import InputError
from stiffscope.lab.rotations import lever

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stiffscope.lab.rotations import Array

GROUND = -1
_SHIFT = 1e-9  # of the scaled diagonal
_REFINED = 12  # most refinement steps
_MET = 1e-12  # relative residual of the system
_LOOSE = 1e-6  # relative residual above which there is no equilibrium


@dataclass(frozen=True)
class Element:
    """An element that connects node `first` to m others, usually one."""

    name: str
    first: int
    second: tuple[int, ...]
    carry: Array
    """Transform (n, 6m, 6) of a twist about the origin to its own points and axes."""
    held: Array
    """Constrained directions (n, r, 6m)."""
    compliance: Array
    """Compliance (6m, 6m) in its axes."""
    misfit: Array
    """Motion (n, 6m) of the others against the first, from their unloaded position."""


class Structure:
    """An assembled and factorized structure; read-only."""

    def __init__(self, nodes: int, elements: Sequence[Element]) -> None:
        self._elements = {e.name: e for e in elements}
        self._dofs = 6 * nodes
        self._rows: dict[str, slice] = {}
        size = self._dofs
        for e in elements:
            self._rows[e.name] = slice(size, size + e.held.shape[1])
            size += e.held.shape[1]
        n = len(elements[0].carry)
        self._matrix = np.zeros((n, size, size))
        for e in elements:
            row = self._rows[e.name]
            self._matrix[:, row, row] = (
                -e.held @ e.compliance @ np.swapaxes(e.held, 1, 2)
            )
            blocks = [(e.first, -e.held @ e.carry)]
            for k, node in enumerate(e.second):
                own = slice(6 * k, 6 * k + 6)
                blocks.append((node, e.held[:, :, own] @ e.carry[:, own]))
            for node, block in blocks:
                if node != GROUND:
                    at = slice(6 * node, 6 * node + 6)
                    self._matrix[:, row, at] += block
                    self._matrix[:, at, row] += np.swapaxes(block, 1, 2)
        self._scale = self._scales(elements, size)
        shift = _SHIFT * np.where(np.arange(size) < self._dofs, 1.0, -1.0)
        scaled = self._matrix * self._scale[:, None] * self._scale
        self._factors: list[Any] = [lu_factor(one + np.diag(shift)) for one in scaled]
        self._scaled = scaled

    def _scales(self, elements: Sequence[Element], size: int) -> Array:
        """Return scales (size,) that normalize twists, wrenches and compliances."""
        soft = np.concatenate([np.diag(e.compliance).reshape(-1, 6) for e in elements])
        forces = soft[:, :3]
        moments = soft[:, 3:]
        linear = float(np.median(forces[forces > 0.0])) if forces.any() else 1e-8
        angular = (
            float(np.median(moments[moments > 0.0])) if moments.any() else 10.0 * linear
        )
        out = np.ones(size)
        one = np.concatenate(
            [np.full(3, np.sqrt(linear)), np.full(3, np.sqrt(angular))]
        )
        out[: self._dofs] = np.tile(one, self._dofs // 6)
        for e in elements:
            out[self._rows[e.name]] = 1.0 / (
                np.abs(e.held[0]) @ np.tile(one, len(e.second))
            )
        return out

    @property
    def size(self) -> tuple[int, int]:
        """Numbers of poses and unknowns."""
        return self._matrix.shape[0], self._matrix.shape[1]

    def load(self, node: int, points: Array, wrench: Array) -> Array:
        """Return the right-hand side (n, size) of a wrench (6,) or (n, 6) at a node's points."""
        out = np.zeros(self.size)
        there = np.broadcast_to(wrench, (len(points), 6))[..., None]
        out[:, 6 * node : 6 * node + 6] = (np.swapaxes(lever(points), 1, 2) @ there)[
            ..., 0
        ]
        return out

    def rest(self, name: str, twist: Array) -> Array:
        """Return the right-hand side (n, size) of a rest twist (6m,) or (n, 6m), own axes."""
        e = self._elements[name]
        out = np.zeros(self.size)
        twists = np.broadcast_to(twist, (len(out), e.held.shape[2]))
        out[:, self._rows[name]] = np.einsum("nij,nj->ni", e.held, twists)
        return out

    def misfits(self) -> Array:
        """Return the right-hand side (n, size) of all elements' deviations from rest."""
        out = np.zeros(self.size)
        for name, e in self._elements.items():
            out += self.rest(name, -e.misfit)
        return out

    def solve(self, right: Array) -> Array:
        """Return twists about the origin and multipliers for right-hand sides, all (n, size, k).

        Raises InputError if something moves freely under its load.
        """
        scaled = self._scale[:, None] * right
        out = np.zeros_like(scaled)
        size = np.maximum(np.abs(scaled).max(axis=1, keepdims=True), 1e-300)
        left = scaled
        for _ in range(_REFINED):
            parts: list[Array] = [
                lu_solve(f, b) for f, b in zip(self._factors, left, strict=True)
            ]
            out = out + np.stack(parts)
            left = scaled - self._scaled @ out
            if (np.abs(left) < _MET * size).all():
                break
        if not (np.abs(left) < _LOOSE * size).all():
            message = "expected a machine that holds its tool there, got one that moves freely"
            raise InputError(f"pose: {message}")
        return self._scale[:, None] * out

    def twist(self, solution: Array, node: int) -> Array:
        """Return the twists (n, 6, k) of a node about the origin."""
        if node == GROUND:
            return np.zeros((len(solution), 6, solution.shape[2]))
        return solution[:, 6 * node : 6 * node + 6]

    def wrench(self, solution: Array, name: str) -> Array:
        """Return the wrench (n, 6m, k) in an element, in its own axes."""
        return (
            np.swapaxes(self._elements[name].held, 1, 2) @ solution[:, self._rows[name]]
        )
