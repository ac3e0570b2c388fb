"""Element-by-element products with the stiffness of the cubic functions, which is not assembled.

If the quadratic problem is factorized, element blocks are kept and nodes can be eliminated.
"""

from __future__ import annotations

from functools import cache, partial
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import bsr_array, csr_array

from stiffscope.fea.couplings import Supports, dofs_of
from stiffscope.fea.solvers import Solve, in_portions, on_all_cores
from stiffscope.fea.spaces import sum_matrix

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stiffscope.fea.cubic_space import Cubic, Group
    from stiffscope.fea.mesh import Floats, Ints


def apply_by_elements(
    space: Cubic, supports: Supports, free: Ints, springs: csr_array | None
) -> Solve:
    """Return the product with the enriched stiffness, element by element."""
    batches = space.batches()
    owners = [np.concatenate([chunk.elements for chunk in batch]) for batch in batches]
    scatters = [sum_matrix(space.cells[elements], space.count) for elements in owners]
    high = dofs_of(free)
    base = 3 * space.base

    def apply(coordinates: Floats) -> Floats:
        loads = coordinates.shape[1]
        motion = expand(space, supports, free, coordinates).reshape(-1, 3, loads)
        forces = np.zeros((space.count, 3 * loads))
        for batch, scatter in zip(batches, scatters, strict=True):
            forces += scatter @ element_forces(space, batch, motion).reshape(
                -1, 3 * loads
            )
        if springs is not None:
            forces += springs @ motion.reshape(-1, 3 * loads)
        forces = forces.reshape(-1, loads)
        return np.vstack([supports.restrict(forces[:base]), forces[high]])

    return in_portions(apply)


def apply_by_blocks(
    space: Cubic,
    supports: Supports,
    free: Ints,
    stiffness: csr_array,
    springs: csr_array | None,
    solve: Solve,
) -> tuple[Solve, Solve]:
    """Return products with the enriched stiffness, and with that of cubics with eliminated nodes.

    With A in blocks of nodes and cubics the latter is A₂₂ − A₂₁ A₁₁⁻¹ A₁₂. The elements' A₁₂ and
    A₂₂ are kept, 14 kB each: factorized meshes are small enough.
    """
    chunks = [chunk for batch in space.batches() for chunk in batch]
    blocks = on_all_cores(partial(_stiffness, space), chunks)
    cells = [space.cells[chunk.elements] for chunk in chunks]
    across = [block[:, :30].swapaxes(1, 2) for block in blocks]
    every, starts = np.concatenate(cells), np.cumsum([0, *map(len, cells)])
    base = space.base
    count = space.count
    held = free - space.base
    on_all, on_cubics = (
        sum_matrix(every, count),
        sum_matrix(every[:, 10:] - base, count - base),
    )
    nodes_of = [at[:, :10] for at in cells]
    cubics_of = [at[:, 10:] - base for at in cells]
    bedding = (csr_array((count, count)) if springs is None else springs)[:, base:]

    @cache
    def scratch(
        width: int, loads: int
    ) -> Floats:  # tens of megabytes, slow to allocate anew
        return np.empty((len(every), width, loads))

    def sum_forces(
        blocks: list[Floats], motion: Floats, places: list[Ints], scatter: csr_array
    ) -> Floats:
        """Return the elements' forces (functions, 3 loads) for motion (functions, 3, loads)."""
        loads = motion.shape[2]
        local = scratch(blocks[0].shape[1], loads)

        def fill(block: Floats, at: Ints, start: int) -> None:
            np.matmul(
                block,
                motion[at].reshape(-1, 30, loads),
                out=local[start : start + len(at)],
            )

        on_all_cores(fill, blocks, places, starts[:-1])
        return scatter @ local.reshape(-1, 3 * loads)

    def push(coordinates: Floats) -> tuple[Floats, Floats]:
        """Return the forces due to motion of the cubics, on nodes and on cubics."""
        loads = coordinates.shape[1]
        high = np.zeros((count - base, 3, loads))
        high[held] = coordinates.reshape(-1, 3, loads)
        forces = sum_forces(blocks, high, cubics_of, on_all)
        if springs is not None:
            forces += bedding @ high.reshape(-1, 3 * loads)
        return supports.restrict(forces[:base].reshape(-1, loads)), forces[base:][
            held
        ].reshape(-1, loads)

    def pull(coordinates: Floats) -> Floats:
        """Return the forces on the cubics due to motion of the nodes."""
        loads = coordinates.shape[1]
        low = supports.expand(coordinates).reshape(-1, 3, loads)
        forces = sum_forces(across, low, nodes_of, on_cubics)
        return (forces + bedding[:base].T @ low.reshape(-1, 3 * loads))[held].reshape(
            -1, loads
        )

    def apply(coordinates: Floats) -> Floats:
        split = len(coordinates) - 3 * len(free)
        nodes = supports.restrict(stiffness @ supports.expand(coordinates[:split]))
        cubics = pull(coordinates[:split])
        if coordinates[split:].any():
            pushed = push(coordinates[split:])
            nodes = nodes + pushed[0]
            cubics = cubics + pushed[1]
        return np.vstack([nodes, cubics])

    def eliminated(coordinates: Floats) -> Floats:
        nodes, cubics = push(coordinates)
        return cubics - pull(solve(nodes))

    return apply, eliminated


def invert_blocks(space: Cubic, free: Ints, springs: csr_array | None) -> bsr_array:
    """Return the inverses of the cubics' own 3 x 3 blocks."""
    diagonal = np.zeros((space.count, 9))
    for batch in space.batches():
        for chunk in batch:
            pairs = np.einsum("rpa,spa->prsa", *[chunk.table[..., 10:]] * 2)
            blocks = _contract(chunk, pairs).transpose(0, 3, 1, 2).reshape(-1, 9)
            np.add.at(diagonal, space.cells[chunk.elements, 10:].reshape(-1), blocks)
    diagonal = diagonal[free].reshape(-1, 3, 3)
    if springs is not None:
        diagonal += springs.diagonal()[free][:, None, None] * np.eye(3)
    steps = np.arange(len(free) + 1)
    return bsr_array((np.linalg.inv(diagonal), steps[:-1], steps))


def _stiffness(space: Cubic, chunk: Group) -> Floats:
    """Return element forces (c, 60, 30) on all functions for displacements of the cubics."""
    pairs = np.einsum("rpa,spb->prsab", chunk.table, chunk.table[..., 10:])
    blocks = _contract(chunk, pairs).transpose(0, 3, 1, 4, 2)  # (c, 20, 3, 10, 3)
    sign = space.signs[chunk.elements]
    return (
        blocks * sign[:, :, None, None, None] * sign[:, None, None, 10:, None]
    ).reshape(-1, 60, 30)


def _contract(chunk: Group, pairs: Floats) -> Floats:
    """Return element stiffness (c, 3, 3, …) for pairs (p, 3, 3, …) of reference gradients."""
    kept, points = chunk.elasticity.shape[:2]
    if points == 1:
        pairs = pairs.sum(axis=0, keepdims=True)
    law = chunk.elasticity.reshape(kept, points, 3, 3, 3, 3).transpose(
        0, 3, 5, 1, 2, 4
    )  # [i, j, p, r, s]
    contracted = law.reshape(9 * kept, -1) @ pairs.reshape(9 * points, -1)
    return contracted.reshape(kept, 3, 3, *pairs.shape[3:])


def expand(space: Cubic, supports: Supports, free: Ints, coordinates: Floats) -> Floats:
    """Return coefficients (3 count, loads) of all functions from free coordinates (c + 3w, loads).

    Parameters
    ----------
    space
        Cubic functions on the mesh.
    supports
        Supports: clamped nodes and rigid couplings.
    free
        Indices of the unconstrained functions.
    coordinates
        Unconstrained coordinates (c + 3w, loads).
    """
    split = 3 * len(supports.free) + supports.tie.shape[1]
    motion = np.zeros((3 * space.count, coordinates.shape[1]))
    motion[: 3 * space.base] = supports.expand(coordinates[:split])
    motion[dofs_of(free)] = coordinates[split:]
    return motion


def element_forces(space: Cubic, batch: Sequence[Group], motion: Floats) -> Floats:
    """Return element forces (m, 20, 3, loads) on functions for motions (count, 3, loads).

    Parameters
    ----------
    space
        Cubic functions on the mesh.
    batch
        Groups of m elements.
    motion
        Coefficients (count, 3, loads) of all functions.
    """
    loads = motion.shape[2]
    starts = np.cumsum([0, *(len(chunk.elements) for chunk in batch)])
    local = np.empty((starts[-1], 20, 3, loads))

    def fill(chunk: Group, start: int) -> None:
        points = chunk.table.shape[1]
        table = chunk.table.reshape(3 * points, 20)
        c = len(chunk.elements)
        sign = space.signs[chunk.elements].T[:, :, None, None]
        given = (motion[space.cells[chunk.elements].T] * sign).reshape(
            20, -1
        )  # (20, c 3 loads)
        slope = (
            (table @ given).reshape(3, points, c, 3, loads).transpose(2, 1, 0, 3, 4)
        )  # (c, p, r, i, loads)
        stress = chunk.elasticity @ slope.reshape(c, points, 9, loads)
        stress = (
            stress.reshape(c, points, 3, 3, loads)
            .transpose(2, 1, 0, 3, 4)
            .reshape(3 * points, -1)
        )
        local[start : start + c] = (
            (table.T @ stress).reshape(20, c, 3, loads) * sign
        ).transpose(1, 0, 2, 3)

    on_all_cores(fill, batch, starts[:-1])
    return local
