"""The closest point on the surface under a face: closed form where the surface has one, else the kernel's."""

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cad.faces import FaceGeometry

if TYPE_CHECKING:
    from OCP.TopoDS import TopoDS_Face, TopoDS_Solid

Floats = NDArray[np.float64]


def projected(solid: "TopoDS_Solid", face: FaceGeometry, points: Floats) -> Floats:
    """Return the closest points (n, 3) to `points` (n, 3), in m.

    Planes and round surfaces are taken as unbounded, others as ending with their parameter range.
    """
    if face.kind == "plane":
        return points - np.outer((points - face.origin) @ face.axis, face.axis)
    if face.kind == "sphere":
        return face.origin + face.radius * _directions(points - face.origin, np.array([0.0, 0.0, 1.0]))
    if face.kind in {"cylinder", "cone", "torus"}:
        return _on_round(face, points)
    from cad import kernel

    return _on_other(kernel.faces(solid)[face.index], points)


def _on_round(face: FaceGeometry, points: Floats) -> Floats:
    """Project in the half plane through the axis: there the surface is a line or a circle."""
    lever = points - face.origin
    height = lever @ face.axis  # (n,)
    across = lever - np.outer(height, face.axis)
    distance = np.linalg.norm(across, axis=1)
    outward = _directions(across, _perpendicular(face.axis))
    if face.kind == "torus":
        spoke = np.column_stack([distance - face.radius, height])
        spoke = face.minor_radius * _directions(spoke, np.array([1.0, 0.0]))
        distance, height = face.radius + spoke[:, 0], spoke[:, 1]
    else:
        sine, cosine = np.sin(face.half_angle), np.cos(face.half_angle)
        along = (distance - face.radius) * sine + height * cosine
        distance, height = face.radius + along * sine, along * cosine
    return face.origin + np.outer(height, face.axis) + distance[:, None] * outward


def _directions(vectors: Floats, otherwise: Floats) -> Floats:
    """Unit vectors (n, k); a vector of no length takes the direction `otherwise`."""
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.where(lengths > 0, vectors / np.where(lengths > 0, lengths, 1), otherwise)


def _perpendicular(axis: Floats) -> Floats:
    across = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    return across / np.linalg.norm(across)


def _on_other(face: "TopoDS_Face", points: Floats) -> Floats:
    from OCP.BRep import BRep_Tool
    from OCP.BRepTools import BRepTools
    from OCP.GeomAPI import GeomAPI_ProjectPointOnSurf
    from OCP.gp import gp_Pnt

    from cad import kernel

    u0, u1, v0, v1 = BRepTools.UVBounds_s(face)
    search = GeomAPI_ProjectPointOnSurf()
    search.Init(BRep_Tool.Surface_s(face), u0, u1, v0, v1, 1e-9)
    found = np.empty_like(points)
    for i, point in enumerate(points * 1e3):
        search.Perform(gp_Pnt(*point))
        candidates: list[Any] = [kernel.closest(face, point)]  # it has the borders, which have no normal
        if search.NbPoints() > 0:
            candidates.append(kernel.xyz(search.NearestPoint()))
        found[i] = min(candidates, key=lambda candidate: float(np.linalg.norm(candidate - point)))
    return found * 1e-3
