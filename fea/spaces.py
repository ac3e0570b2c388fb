"""Function spaces on a mesh: quadratic element, cubic enrichment, and bases on cells and faces."""

# pyright: reportAssignmentType=false, reportAttributeAccessIssue=false, reportIncompatibleMethodOverride=false, reportOptionalOperand=false, reportOptionalSubscript=false, reportReturnType=false
# (scikit-fem declares its types loosely)

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import csr_array
from skfem import Basis, ElementTetP2, FacetBasis, MeshTet2
from skfem.element import DiscreteField, Element, ElementH1
from skfem.mapping import Mapping, MappingAffine, MappingIsoparametric
from skfem.quadrature import get_quadrature
from skfem.refdom import RefTet, RefTri

if TYPE_CHECKING:
    from collections.abc import Iterator

    from stiffscope.fea.mesh import Floats, Ints, TetMesh

CHUNK = 20_000  # elements of a basis, which holds all functions at all points
GRADIENTS = np.vstack([-np.ones(3), np.eye(3)])  # of barycentric coordinates


class ElementTetCubic(ElementH1):
    """Hierarchical cubics λ_a λ_b (λ_a − λ_b) of the six edges and λ_a λ_b λ_c of the four faces.

    With ``ElementTetP2`` they span all cubics. They vanish at its nodes, so its coefficients remain
    nodal values.

    References
    ----------
    B. Szabó and I. Babuška, Finite Element Analysis, Wiley, 1991.
    """

    edge_dofs = 1
    facet_dofs = 1
    maxdeg = 3
    dofnames = ("u", "u")
    doflocs = np.vstack(
        [RefTet.p.T[RefTet.edges].mean(axis=1), RefTet.p.T[RefTet.facets].mean(axis=1)]
    )
    refdom = RefTet

    def lbasis(self, X: Floats, i: int) -> tuple[Floats, Floats]:
        """Return value and reference gradient of function ``i`` of ten at reference points X."""
        b = np.stack([1 - X.sum(axis=0), *X])
        if i < 6:
            p, q = RefTet.edges[i]
            x = b[p]
            y = b[q]
            slopes = {p: y * (2 * x - y), q: x * (x - 2 * y)}
            value = x * y * (x - y)
        elif i < 10:
            p, q, r = RefTet.facets[i - 6]
            value = b[p] * b[q] * b[r]
            slopes = {p: b[q] * b[r], q: b[p] * b[r], r: b[p] * b[q]}
        else:
            self._index_error()
        return value, sum(
            np.multiply.outer(GRADIENTS[k], slope) for k, slope in slopes.items()
        )

    def orient(self, mapping: Mapping, i: int, tind: Ints | None = None) -> Ints:
        """Return the signs (m,) of function ``i``: edges run from lower to higher vertex."""
        t = mapping.mesh.t if tind is None else mapping.mesh.t[:, tind]
        if i >= 6:
            return np.ones(t.shape[1], dtype=int)
        a, b = RefTet.edges[i]
        return np.where(t[a] < t[b], 1, -1)

    def gbasis(
        self, mapping: Mapping, X: Floats, i: int, tind: Ints | None = None
    ) -> tuple[DiscreteField]:
        """Return the oriented function ``i`` in the elements ``tind``."""
        (field,) = super().gbasis(mapping, X, i, tind)
        sign = self.orient(mapping, i, tind)[:, None]
        return (DiscreteField(value=np.asarray(field) * sign, grad=field.grad * sign),)


def tabulate(at: Floats) -> tuple[Floats, Floats]:
    """Return values (q, 20) and gradients (3, q, 20) of the quadratic, then the cubic functions."""
    elements = ElementTetP2(), ElementTetCubic()
    values, slopes = zip(
        *(element.lbasis(at, i) for element in elements for i in range(10)), strict=True
    )
    return np.stack(values, axis=1), np.stack(slopes, axis=2)


def _groups(mesh: TetMesh) -> tuple[tuple[Ints, Mapping], ...]:
    """Return the straight-sided and the curved elements with their mappings."""
    curved = mesh.is_curved
    straight = np.flatnonzero(~curved), MappingAffine(mesh.grid)
    return straight, (np.flatnonzero(curved), mesh.grid.mapping())


def integrate_cells(
    mesh: TetMesh, rules: tuple[tuple[Floats, Floats], ...], size: int
) -> Iterator[tuple[Ints, int, Floats, Floats]]:
    """Yield chunks of straight-sided, then of curved elements, with their quadrature.

    Parameters
    ----------
    rules : points (3, q) and weights (q,) on the reference element, straight-sided and curved.
    size : most elements in a chunk.

    Returns
    -------
    Elements (c,), number of their rule, ∂ξ_r/∂x_k (3, 3, c, q), and weights (c, q), m³.
    """
    for number, ((chosen, mapping), (at, weights)) in enumerate(
        zip(_groups(mesh), rules, strict=True)
    ):
        for start in range(0, len(chosen), size):
            cells = chosen[start : start + size]
            volumes = np.abs(mapping.detDF(at, tind=cells)) * weights
            yield cells, number, mapping.invDF(at, tind=cells), volumes


def sum_matrix(places: Ints, count: int) -> csr_array:
    """Return the matrix (count, places.size) that sums contributions at places 0 to count - 1."""
    entries = np.ones(places.size), (places.reshape(-1), np.arange(places.size))
    return csr_array(entries, shape=(count, places.size))


def cell_bases(
    mesh: TetMesh, element: Element, straight: int, curved: int
) -> Iterator[Basis]:
    """Yield bases of straight-sided and of curved elements, with these quadrature orders, in chunks."""
    for (chosen, mapping), order in zip(_groups(mesh), (straight, curved), strict=True):
        for start in range(0, len(chosen), CHUNK):
            cells = chosen[start : start + CHUNK]
            options = {"intorder": order, "disable_doflocs": True}
            yield Basis(mesh.grid, element, mapping=mapping, elements=cells, **options)


def face_basis(
    mesh: TetMesh, element: Element, faces: frozenset[int], order: int
) -> FacetBasis:
    """Return the basis on the boundary facets of CAD faces.

    Parameters
    ----------
    mesh, element
        Mesh, and finite element of the basis.
    faces
        Indices of the CAD faces.
    order
        Order of the quadrature.
    """
    facets = np.concatenate([mesh.grid.boundaries[str(face)] for face in sorted(faces)])
    rule = get_quadrature(RefTri, order)
    mapping = _FacetMapping(mesh.grid, facets, rule[0])
    return FacetBasis(
        mesh.grid,
        element,
        mapping=mapping,
        quadrature=rule,
        facets=facets,
        disable_doflocs=True,
    )


class _FacetMapping(MappingIsoparametric):
    """Mapping with known reference points of the facets' quadrature points.

    scikit-fem's Newton iteration for them need not converge in nearly flat curved elements.
    """

    def __init__(self, grid: MeshTet2, facets: Ints, points: Floats) -> None:
        super().__init__(grid, grid.elem(), grid.bndelem)
        corners = grid.facets[:, facets]  # (3, k)
        local = (grid.t[None][:, :, grid.f2t[0, facets]] == corners[:, None]).argmax(
            axis=1
        )
        weights = np.vstack([1 - points.sum(axis=0), points])  # (3, q)
        self._inside = np.einsum("ick,cq->ikq", RefTet.p[:, local], weights)

    def invF(self, x: Floats, tind: Ints | None = None, **_: float) -> Floats:
        """Return the reference points (3, k, q), for any arguments."""
        del x, tind
        return self._inside
