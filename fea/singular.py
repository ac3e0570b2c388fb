"""Singular edges, their exponents, and the remaining error of cubic elements there.

Near an edge, displacements vary as r^λ: M. L. Williams, J. Appl. Mech. 19 (1952) 526, plane strain.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from stiffscope.fea.mesh import Floats, Ints, TetMesh, sides_between

if TYPE_CHECKING:
    from collections.abc import Sequence

SHARP = 0.35  # rad beyond the straight angle above which an edge is re-entrant
KOLOSOV = (
    3 - 4 * 0.3
)  # plane strain; at a right angle λ is 0.76 to 0.64 for ν from 0.2 to 0.45
BRANCH = np.radians(142.0)  # angle above which λ is complex at a fixed edge


def singular_edges(
    mesh: TetMesh,
    fixed: Sequence[frozenset[int]],
    loaded: Sequence[frozenset[int]] = (),
) -> tuple[Ints, Floats]:
    """Return vertex pairs (e, 2) along singular edges, and their exponents λ (e,).

    Singular edges are borders of fixed faces, re-entrant edges, and borders of loaded faces except
    at edges of the solid: there displacements vary as r log r, and λ is 1.

    Parameters
    ----------
    fixed, loaded : sets of undeformable CAD faces, and of those with tractions.
    """
    facets = mesh.facets[:, :3]
    a, b, c = (mesh.points[facets[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    pairs, left, right = sides_between(facets)
    turn = np.linalg.norm(np.cross(normals[left], normals[right]), axis=1)
    turn = np.arctan2(turn, np.einsum("ij,ij->i", normals[left], normals[right]))
    rise = np.einsum("ij,ij->i", normals[left], (a + b + c)[right] - (a + b + c)[left])
    inside = np.maximum(
        np.pi + np.where(rise > 0, turn, -turn), 0.1
    )  # angle of the material
    parted = mesh.facet_face[left] != mesh.facet_face[right]
    border = _differ(mesh, fixed, left, right)
    reentrant = ~border & parted & (inside > np.pi + SHARP)
    jump = (
        ~border
        & ~reentrant
        & _differ(mesh, loaded, left, right)
        & (inside > np.pi - SHARP)
    )
    kinds = border, reentrant, jump
    exponents = (
        fixed_exponent(inside[border]),
        free_exponent(inside[reentrant]),
        np.ones(jump.sum()),
    )
    return np.vstack([pairs[which] for which in kinds]), np.concatenate(exponents)


def _differ(
    mesh: TetMesh, sets: Sequence[frozenset[int]], left: Ints, right: Ints
) -> np.ndarray:
    """Return whether the triangles beside each edge (e,) belong to different sets of faces."""
    owner = np.zeros(len(mesh.facets), dtype=np.int64)
    for number, faces in enumerate(sets, start=1):
        owner[np.isin(mesh.facet_face, list(faces))] = number
    return owner[left] != owner[right]


def free_exponent(inside: Floats) -> Floats:
    """Return λ of a re-entrant edge with free sides: sin λω + λ sin ω = 0; 0.545 at ω = 270°."""
    power = np.full(np.shape(inside), 0.5)
    for _ in range(60):
        power = (
            power + (np.pi - np.arcsin(np.clip(-power * np.sin(inside), 0, 1))) / inside
        ) / 2
    return power


def fixed_exponent(inside: Floats) -> Floats:
    """Return λ (real part) between a fixed and a free side: 0.711 at a right angle, 0.5 in a plane.

    κ sin² λω = (κ + 1)² / 4 - λ² sin² ω, with Kolosov's κ; Newton's method. At most 1.
    """
    inside = np.asarray(inside, dtype=float)
    power = np.where(inside < BRANCH, 1.12 / inside, np.pi / 2 / inside + 0.1j / inside)
    for _ in range(40):
        sine = np.sin(inside)
        value = (
            KOLOSOV * np.sin(power * inside) ** 2
            - (KOLOSOV + 1) ** 2 / 4
            + (power * sine) ** 2
        )
        slope = KOLOSOV * inside * np.sin(2 * power * inside) + 2 * power * sine**2
        power = power - value / slope
    return np.minimum(np.real(power), 1.0)


def remaining_ratio(exponent: Floats) -> Floats:
    """Return the cubic error at an edge over the quadratic-to-cubic difference: energy ~ p^(-4λ).

    I. Babuška and M. Suri, RAIRO Modél. Math. Anal. Numér. 21 (1987) 199.
    """
    return 1 / (1.5 ** (4 * exponent) - 1)


def remaining_at_edges(
    mesh: TetMesh,
    fixed: Sequence[frozenset[int]],
    loaded: Sequence[frozenset[int]] = (),
) -> Floats:
    """Return the largest ``remaining_ratio`` of elements (m,) at singular edges; 0 elsewhere.

    Parameters
    ----------
    fixed, loaded : sets of undeformable CAD faces, and of those with tractions.
    """
    edges, exponents = singular_edges(mesh, fixed, loaded)
    at_node = np.zeros(len(mesh.points))
    np.maximum.at(at_node, edges.reshape(-1), np.repeat(remaining_ratio(exponents), 2))
    return at_node[mesh.cells[:, :4]].max(axis=1)
