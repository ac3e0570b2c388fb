"""Edges where stresses are singular, how strongly, and what elements of higher order still miss there.

Around an edge displacements go as r^λ: M. L. Williams, J. Appl. Mech. 19 (1952) 526, for plane strain.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from fea.mesh import Floats, Ints, TetMesh

SHARP = 0.35  # rad beyond the straight angle from which a re-entrant edge counts
KOLOSOV = 3 - 4 * 0.3  # of plane strain; Poisson's ratio matters little


def singular_edges(
    mesh: TetMesh, held: Sequence[frozenset[int]], loaded: Sequence[frozenset[int]] = ()
) -> tuple[Ints, Floats]:
    """Return (e, 2) vertex pairs at borders of held faces and at re-entrant edges, and (e,) their exponents λ.

    Parameters
    ----------
    held : CAD faces that cannot deform, set by set.
    loaded : those under tractions; where one ends in a smooth surface, displacements go as r log r, and λ is 1.
    """
    facets = mesh.facets[:, :3]
    a, b, c = (mesh.points[facets[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    pairs = np.sort(facets[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    order = np.lexsort((pairs[:, 1], pairs[:, 0]))  # a closed surface: each side is there twice
    left, right = order[0::2] // 3, order[1::2] // 3
    turn = np.linalg.norm(np.cross(normals[left], normals[right]), axis=1)
    turn = np.arctan2(turn, np.einsum("ij,ij->i", normals[left], normals[right]))
    rise = np.einsum("ij,ij->i", normals[left], (a + b + c)[right] - (a + b + c)[left])
    inside = np.pi + np.where(rise > 0, turn, -turn)  # angle of the material around the edge
    parted = mesh.facet_face[left] != mesh.facet_face[right]
    border = _differ(mesh, held, left, right)
    reentrant = ~border & parted & (inside > np.pi + SHARP)
    jump = ~border & ~reentrant & _differ(mesh, loaded, left, right) & (inside > np.pi - SHARP)
    exponents = held_exponent(inside[border]), free_exponent(inside[reentrant]), np.ones(int(jump.sum()))
    return np.vstack([pairs[order[0::2]][which] for which in (border, reentrant, jump)]), np.concatenate(exponents)


def _differ(mesh: TetMesh, sets: Sequence[frozenset[int]], left: Ints, right: Ints) -> np.ndarray:
    """Return (e,) whether the boundary triangles on the two sides of each edge are of different sets of faces."""
    owner = np.zeros(len(mesh.facets), dtype=np.int64)
    for number, faces in enumerate(sets, start=1):
        owner[np.isin(mesh.facet_face, list(faces))] = number
    return owner[left] != owner[right]


def free_exponent(inside: Floats) -> Floats:
    """Return λ of a re-entrant edge with free sides: the root of sin λω + λ sin ω = 0; 0.545 at ω = 270°."""
    power = np.full(np.shape(inside), 0.5)
    for _ in range(60):
        power = (power + (np.pi - np.arcsin(np.clip(-power * np.sin(inside), 0, 1))) / inside) / 2
    return power


def held_exponent(inside: Floats) -> Floats:
    """Return λ (its real part) where a held side meets a free one; 0.711 at a right angle, 0.5 in a plane, at most 1.

    κ sin² λω = (κ + 1)² / 4 - λ² sin² ω, with Kolosov's κ.
    """
    power = np.full(np.shape(inside), 0.6, dtype=complex)
    for _ in range(60):
        square = ((KOLOSOV + 1) ** 2 / 4 - (power * np.sin(inside)) ** 2) / KOLOSOV
        power = (power + np.arcsin(np.sqrt(square)) / inside) / 2
    return np.minimum(np.real(power), 1.0)


def still_missing(exponent: Floats) -> Floats:
    """Return what cubics lack at an edge, in parts of what they gain on quadratics: energies fall as p^(-4λ).

    I. Babuška and M. Suri, RAIRO Modél. Math. Anal. Numér. 21 (1987) 199.
    """
    return 1 / (1.5 ** (4 * exponent) - 1)


def missing_at_edges(mesh: TetMesh, held: Sequence[frozenset[int]], loaded: Sequence[frozenset[int]] = ()) -> Floats:
    """Return (m,) ``still_missing`` of the elements that touch a singular edge, at its strongest, and 0 elsewhere.

    Parameters
    ----------
    held, loaded : CAD faces that cannot deform, and those under tractions, set by set.
    """
    edges, exponents = singular_edges(mesh, held, loaded)
    at_node = np.zeros(len(mesh.points))
    np.maximum.at(at_node, edges.reshape(-1), np.repeat(still_missing(exponents), 2))
    return at_node[mesh.cells[:, :4]].max(axis=1)
