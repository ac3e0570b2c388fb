"""Cubic functions that enrich a quadratic mesh, and their element stiffness."""

# pyright: reportOptionalSubscript=false
# (scikit-fem declares its types loosely)

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from skfem import Dofs, ElementTetP2
from skfem.quadrature import get_quadrature
from skfem.refdom import RefTet

from stiffscope.fea.elasticity import tensor
from stiffscope.fea.spaces import ElementTetCubic, integrate_cells, tabulate

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stiffscope.fea.mesh import Floats, Ints, TetMesh

CURVED_ORDER = 6
CHUNK = 512
BATCH = 128  # elements per group; groups with results in memory at once


@dataclass(frozen=True)
class Cubic:
    """Enriched space: the mesh's nodes, then the cubics of ``dofs``; stiffness is unassembled.

    Attributes
    ----------
    dofs : scikit-fem's numbering of the cubics.
    cells, signs : (m, 20) functions of each element and their orientations.
    groups : few elements of one quadrature each, with reference gradients and pulled-back elasticity.
    base : number of nodes, which are the first functions.
    """

    dofs: Dofs
    cells: Ints
    signs: Ints
    groups: tuple[Group, ...]
    base: int

    @property
    def count(self) -> int:
        """Number of functions, three degrees of freedom each."""
        return self.base + self.dofs.N

    def batches(self, chosen: np.ndarray | None = None) -> list[Sequence[Group]]:
        """Return elements, or those chosen (m,), in batches of groups that bound memory."""
        chunks = self.groups
        if chosen is not None:
            chosen_cells = [
                (chunk, np.flatnonzero(chosen[chunk.elements])) for chunk in chunks
            ]
            chunks = [
                Group(each.elements[at], each.table, each.elasticity[at])
                for each, at in chosen_cells
                if len(at)
            ]
        return [chunks[k : k + BATCH] for k in range(0, len(chunks), BATCH)]


@dataclass(frozen=True)
class Group:
    """Elements (c,) with reference gradients (3, p, 20); elasticity (c, 1 or p, 9, 9) in N/m.

    With the elasticity pulled back to the reference element, [(r, i), (s, j)], the stiffness is
    Σ_p table[r, p, a] elasticity[(r, i), (s, j)] table[s, p, b].
    """

    elements: Ints
    table: Floats
    elasticity: Floats


def enrich(mesh: TetMesh, elasticity: Floats) -> Cubic:
    """Return the enriched space of a mesh; elasticity (6, 6) in Pa."""
    grid = mesh.grid
    element = ElementTetCubic()
    base = len(mesh.points)
    dofs = Dofs(grid, element)
    cells = np.vstack([grid.dofs.element_dofs, base + dofs.element_dofs]).T
    signs = [np.ones(len(cells), dtype=int)] * 10
    signs += [element.orient(grid.mapping(), i) for i in range(10)]
    straight, at_middle = _straight_rule()
    inside = get_quadrature(RefTet, CURVED_ORDER)
    tables = (straight, tabulate(inside[0])[1])
    rules = (at_middle, inside)
    law = tensor(elasticity)
    groups = []
    for elements, number, inverse, volumes in integrate_cells(mesh, rules, CHUNK):
        pulled = np.einsum(
            "rkcq,ikjl,slcq->cqrisj", inverse, law, inverse, optimize=True
        )
        pulled *= volumes[:, :, None, None, None, None]
        groups.append(
            Group(elements, tables[number], pulled.reshape(*pulled.shape[:2], 9, 9))
        )
    return Cubic(dofs, cells, np.stack(signs, axis=1), tuple(groups), base)


def _straight_rule() -> tuple[Floats, tuple[Floats, Floats]]:
    """Return the table of a straight-sided element, and the point and weight of its elasticity.

    Gradients are quadratic: ten orthonormal modes represent them; integrals are dot products.
    """
    at, weights = get_quadrature(RefTet, 4)
    values = tabulate(at)[0][:, :10].T
    mass = (values * weights) @ values.T
    table = np.linalg.cholesky(mass).T @ tabulate(ElementTetP2.doflocs.T)[1]
    return table, (np.full((3, 1), 0.25), np.ones(1))
