"""Design velocity: motion of mesh nodes with the CAD surface per change of a part parameter.

Vertices of the solid move first, then nodes on its edges, on its faces, and inside: each level is
extended harmonically from the previous one, then projected on the changed solid. Faces correspond
in order.

References
----------
K. K. Choi and N. H. Kim, Structural Sensitivity Analysis and Optimization 1: Linear Systems,
Springer, 2005, chapter 6.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from math import factorial
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import coo_array, csr_array, eye_array

from stiffscope.cad.part import Part, project
from stiffscope.errors import InputError
from stiffscope.fea.geometry import jacobian_range
from stiffscope.fea.mesh import EDGES, Floats, Ints, TetMesh, sides_between
from stiffscope.fea.snap import FLATTEST, ROUNDS, Target, alternate, places_of
from stiffscope.fea.solvers import factorize_matrix

if TYPE_CHECKING:
    from collections.abc import Callable

MOST_STRAIN = 1.3  # largest stretch of an element of a moved mesh
FARTHEST = 100.0  # steps that a face centroid may move; beyond, it is another face
UNBOUNDED = 1e-12  # of the Laplacian's mean diagonal, added so that unconnected nodes stay in place


class DesignVelocity:
    """Design velocities of one mesh; Laplacians are factorized once for all parameters.

    Parameters
    ----------
    mesh : mesh of the part.
    part : part as meshed.
    """

    def __init__(self, mesh: TetMesh, part: Part) -> None:
        self.mesh = mesh
        self.part = part
        points = mesh.points
        corners = mesh.facets[:, :3]
        count = len(points)
        pairs = np.unique(
            corners.reshape(-1) * len(part.faces) + np.repeat(mesh.facet_face, 3)
        )
        faces = np.bincount(pairs // len(part.faces), minlength=count)
        ends, left, right = sides_between(corners)
        creases = ends[mesh.facet_face[left] != mesh.facet_face[right]]
        inner = np.isin(np.arange(count), mesh.cells[:, :4]) & (faces == 0)
        self._levels = (
            (np.flatnonzero(faces > 2), lambda given: given),
            (np.flatnonzero(faces == 2), _extension(points, creases, faces == 2)),
            (np.flatnonzero(faces == 1), _extension(points, corners, faces == 1)),
        )  # nodes of a level, and the extension to them from all previous ones
        self._inside = _extension(points, mesh.cells[:, :4], inner)
        ends_of_mids = np.zeros((count, 2), dtype=int)
        ends_of_mids[mesh.cells[:, 4:]] = mesh.cells[:, :4][:, EDGES]
        self._mids = np.unique(mesh.cells[:, 4:])
        self._ends = ends_of_mids[self._mids]
        self._size = float(np.linalg.norm(np.ptp(points, axis=0)))
        is_round = np.array([face.kind != "plane" for face in part.faces])
        self._round = np.unique(mesh.facets[is_round[mesh.facet_face], 3:])
        self._base = self._move_onto(part, points, np.unique(mesh.facets))

    def measure_velocity(self, changed: Part, step: float) -> Floats:
        """Return nodal velocities (n, 3) by a parameter, from the part with it ``step`` larger.

        Raises
        ------
        InputError : if the changed part has other faces.
        """
        _check_same(self.part, changed, step)
        velocity = np.zeros_like(self._base)
        for nodes, extend in self._levels:
            moved = self._move_onto(
                changed, self._base + step * extend(velocity), nodes
            )
            velocity[nodes] = (moved - self._base)[nodes] / step
        velocity = self._inside(velocity)
        velocity[self._mids] = velocity[self._ends].mean(axis=1)
        moved = self._move_onto(changed, self._base + step * velocity, self._round)
        velocity[self._round] = (moved - self._base)[self._round] / step
        return velocity

    def _move_onto(self, part: Part, points: Floats, nodes: Ints) -> Floats:
        """Project some of the points onto all faces of a part that they belong to.

        Between tangent faces, onto their common edge: alternating projections converge slowly.
        """
        borders = list(part.smooth_borders.values())
        count = len(part.faces)
        closest = partial(project, part, borders=borders)
        target = Target(closest, self._size, count, tuple(part.smooth_borders))
        node, place = places_of(self.mesh.facets, self.mesh.facet_face, target)
        on_face = np.isin(node, nodes)
        moved = points.copy()
        alternate(moved, node[on_face], place[on_face], target, ROUNDS)
        return moved


def moved_along(mesh: TetMesh, part: Part, changed: Part) -> TetMesh | None:
    """Move the mesh of a part to a part with other dimensions; None if remeshing is better.

    No element may be stretched or compressed by more than ``MOST_STRAIN`` in any direction, and none
    may become flatter than curved elements may be, or are here, by more than that. The caller checks
    whether the mesh matches the changed part's shape.
    """
    try:
        points = mesh.points + DesignVelocity(mesh, part).measure_velocity(
            changed, 1.0
        )  # one step
    except InputError:
        return None
    corners = [
        nodes[mesh.cells[:, 1:4]] - nodes[mesh.cells[:, :1]]
        for nodes in (mesh.points, points)
    ]
    stretches = np.linalg.svd(np.linalg.solve(corners[0], corners[1]), compute_uv=False)
    before, after = (
        jacobian_range(nodes[mesh.cells]).min() for nodes in (mesh.points, points)
    )
    whole = (
        np.linalg.det(corners[1]).min() > 0
        and after > min(before, FLATTEST) / MOST_STRAIN
    )
    if not whole or stretches.max() > MOST_STRAIN or stretches.min() < 1 / MOST_STRAIN:
        return None
    return replace(mesh, points=points)


def _check_same(part: Part, changed: Part, step: float) -> None:
    """Raise InputError unless the faces, seams and interfaces of two parts correspond in order."""
    same = (
        [face.kind for face in part.faces] == [face.kind for face in changed.faces]
        and list(part.smooth_borders) == list(changed.smooth_borders)
        and part.clamped == changed.clamped
        and [one.faces for one in part.loaded] == [one.faces for one in changed.loaded]
    )
    if same:
        shifts = [
            a.centroid - b.centroid
            for a, b in zip(part.faces, changed.faces, strict=True)
        ]
        same = float(np.linalg.norm(shifts, axis=1).max()) < FARTHEST * abs(step)
    if not same:
        raise InputError(
            f"{part.name}: its faces change with a step of {step * 1e3:g} mm: no derivative"
        )


def _extension(
    points: Floats, simplices: Ints, wanted: np.ndarray
) -> Callable[[Floats], Floats]:
    """Return a function that extends values (n, 3) harmonically to the wanted nodes (n,).

    Parameters
    ----------
    simplices : (m, d + 1) segments, triangles or tetrahedra with straight sides.
    """
    inner = np.flatnonzero(wanted)
    if not len(inner):
        return lambda given: given
    rows = _laplacian(points, simplices)[inner]
    matrix = rows[:, inner]
    least = UNBOUNDED * matrix.diagonal().mean() * eye_array(len(inner))
    solve = factorize_matrix(csr_array(matrix + least))

    def fill_inside(given: Floats) -> Floats:
        values = given.copy()
        values[inner] = 0.0
        values[inner] = solve(-(rows @ values))
        return values

    return fill_inside


def _laplacian(points: Floats, simplices: Ints) -> csr_array:
    """Return the Laplacian (n, n) of linear functions on simplices (m, d + 1) of dimension d."""
    count = len(points)
    corners = simplices.shape[1]
    sides = points[simplices[:, 1:]] - points[simplices[:, :1]]  # (m, d, 3)
    gram = sides @ np.swapaxes(sides, 1, 2)
    size = np.sqrt(np.maximum(np.linalg.det(gram), 0)) / factorial(corners - 1)
    reference = np.vstack([-np.ones(corners - 1), np.eye(corners - 1)])
    local = size[:, None, None] * (reference @ np.linalg.inv(gram) @ reference.T)
    rows = np.repeat(simplices, corners, axis=1).reshape(-1)
    columns = np.tile(simplices, corners).reshape(-1)
    return csr_array(
        coo_array((local.reshape(-1), (rows, columns)), shape=(count, count))
    )
