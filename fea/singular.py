"""Singular edges, their exponents, and the error that cubic elements leave there.

Around an edge displacements go as r^λ: M. L. Williams, J. Appl. Mech. 19 (1952) 526, for plane strain.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from stiffscope.fea.mesh import sides_between

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stiffscope.fea.mesh import Floats, Ints, TetMesh

SHARP = 0.35  # rad beyond the straight angle from which a re-entrant edge counts
KOLOSOV = 3 - 4 * 0.3  # of plane strain; at a right angle λ is 0.76 to 0.64 for Poisson's ratios of 0.2 to 0.45
BRANCH = np.radians(142.0)  # beyond which λ is complex at a fixed edge


def singular_edges(
    mesh: TetMesh, fixed: Sequence[frozenset[int]], loaded: Sequence[frozenset[int]] = ()
) -> tuple[Ints, Floats]:
    """Return (e, 2) vertex pairs along singular edges and (e,) their exponents λ.

    Singular are the borders of fixed faces, re-entrant edges, and the borders of loaded faces unless they are at an
    edge of the solid: there displacements go as r log r, and λ is 1.

    Parameters
    ----------
    fixed, loaded : sets of CAD faces that cannot deform, and of those under tractions.
    """
    facets = mesh.facets[:, :3]
    a, b, c = (mesh.points[facets[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    pairs, left, right = sides_between(facets)
    turn = np.linalg.norm(np.cross(normals[left], normals[right]), axis=1)
    turn = np.arctan2(turn, np.einsum("ij,ij->i", normals[left], normals[right]))
    rise = np.einsum("ij,ij->i", normals[left], (a + b + c)[right] - (a + b + c)[left])
    inside = np.maximum(np.pi + np.where(rise > 0, turn, -turn), 0.1)  # angle of the material around the edge
    parted = mesh.facet_face[left] != mesh.facet_face[right]
    border = _differ(mesh, fixed, left, right)
    reentrant = ~border & parted & (inside > np.pi + SHARP)
    jump = ~border & ~reentrant & _differ(mesh, loaded, left, right) & (inside > np.pi - SHARP)
    exponents = fixed_exponent(inside[border]), free_exponent(inside[reentrant]), np.ones(int(jump.sum()))
    return np.vstack([pairs[which] for which in (border, reentrant, jump)]), np.concatenate(exponents)


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


def fixed_exponent(inside: Floats) -> Floats:
    """Return λ (its real part) where a fixed side meets a free one; 0.711 at a right angle, 0.5 in a plane, at most 1.

    κ sin² λω = (κ + 1)² / 4 - λ² sin² ω, with Kolosov's κ; by Newton's method from that of two right angles.
    """
    inside = np.asarray(inside, dtype=float)
    power = np.where(inside < BRANCH, 1.12 / inside, np.pi / 2 / inside + 0.1j / inside)
    for _ in range(40):
        sine = np.sin(inside)
        value = KOLOSOV * np.sin(power * inside) ** 2 - (KOLOSOV + 1) ** 2 / 4 + (power * sine) ** 2
        slope = KOLOSOV * inside * np.sin(2 * power * inside) + 2 * power * sine**2
        power = power - value / slope
    return np.minimum(np.real(power), 1.0)


def remaining_ratio(exponent: Floats) -> Floats:
    """Return the error of cubics at an edge relative to the quadratic-to-cubic difference: energies fall as p^(-4λ).

    I. Babuška and M. Suri, RAIRO Modél. Math. Anal. Numér. 21 (1987) 199.
    """
    return 1 / (1.5 ** (4 * exponent) - 1)


def remaining_at_edges(mesh: TetMesh, fixed: Sequence[frozenset[int]], loaded: Sequence[frozenset[int]] = ()) -> Floats:
    """Return (m,) ``remaining_ratio`` of the elements that touch a singular edge, its largest value; 0 elsewhere.

    Parameters
    ----------
    fixed, loaded : sets of CAD faces that cannot deform, and of those under tractions.
    """
    edges, exponents = singular_edges(mesh, fixed, loaded)
    at_node = np.zeros(len(mesh.points))
    np.maximum.at(at_node, edges.reshape(-1), np.repeat(remaining_ratio(exponents), 2))
    return at_node[mesh.cells[:, :4]].max(axis=1)
