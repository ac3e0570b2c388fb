"""Projection on a face's surface: closed-form if possible, else by the CAD kernel."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from stiffscope.cad import kernel
from stiffscope.cad.faces import FaceGeometry

if TYPE_CHECKING:
    from stiffscope.cad.kernel import Shape, Solid

Floats = NDArray[np.float64]


def project_points(solid: "Solid", face: FaceGeometry, points: Floats) -> Floats:
    """Return the points (n, 3) of a surface closest to `points` (n, 3), in m.

    Planes and round surfaces are unbounded, others bounded by the face's parameter range.

    Parameters
    ----------
    solid
        Solid of the CAD kernel, mm.
    face
        Face on the surface.
    points
        Points (n, 3), m.
    """
    if face.kind == "plane":
        return points - np.outer((points - face.origin) @ face.axis, face.axis)
    if face.kind == "sphere":
        return face.origin + face.radius * _directions(points - face.origin, np.array([0.0, 0.0, 1.0]))
    if face.kind in {"cylinder", "cone", "torus"}:
        return _on_round(face, points)
    return kernel.closest_under(kernel.faces(solid)[face.index], points * 1e3) * 1e-3


def project_on_shape(shape: "Shape", points: Floats) -> Floats:
    """Return the points (n, 3) of a shape closest to `points` (n, 3), in m."""
    return np.array([kernel.closest(shape, point) for point in points * 1e3]).reshape(-1, 3) * 1e-3


def _on_round(face: FaceGeometry, points: Floats) -> Floats:
    """Project in the half plane through the axis, in which the surface is a line or a circle."""
    lever = points - face.origin
    height = lever @ face.axis  # (n,)
    across = lever - np.outer(height, face.axis)
    distance = np.linalg.norm(across, axis=1)
    perpendicular = np.cross(face.axis, np.eye(3)[np.argmin(np.abs(face.axis))])
    outward = _directions(across, perpendicular / np.linalg.norm(perpendicular))
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
    """Normalize vectors (n, k); a zero vector becomes `otherwise` (k,)."""
    lengths = np.linalg.norm(vectors, axis=1)
    units = np.tile(otherwise, (len(vectors), 1))
    units[lengths > 0] = vectors[lengths > 0] / lengths[lengths > 0, None]
    return units
