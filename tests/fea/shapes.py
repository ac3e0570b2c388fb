"""Solids as plain numbers: the experiments' tests need no CAD kernel."""

from types import SimpleNamespace

import numpy as np

from stiffscope.cad.materials import Material
from stiffscope.fea.specimen import Specimen


def isotropic(youngs_modulus, shear_modulus):
    """The (6, 6) elasticity, Pa."""
    return Material("isotropic", youngs_modulus, shear_modulus, 1.0).elasticity()


STEEL = isotropic(211e9, 81e9)
DENSITY = 7850.0
CLAMPED, LOADED = frozenset({0}), frozenset({1})


def _face(kind, origin, axis, area, radius=0.0):
    origin = np.array(origin, float)
    axis = np.array(axis, float)
    return SimpleNamespace(
        kind=kind, origin=origin, axis=axis, radius=radius, area=area, centroid=origin
    )


def projector(surface):
    def project(face, points):
        shape = surface.faces[face]
        offset = points - shape.origin
        along = np.outer(offset @ shape.axis, shape.axis)
        if shape.kind == "plane":
            return points - along
        across = offset - along
        return (
            shape.origin
            + along
            + across * (shape.radius / np.linalg.norm(across, axis=1))[:, None]
        )

    return project


def _specimen(name, vertices, triangles, tags, faces, volume, tip, elasticity):
    surface = SimpleNamespace(
        vertices=vertices,
        triangles=np.array(triangles),
        face_of_triangle=np.array(tags),
        faces=tuple(faces),
        seams=(),
    )
    loaded = ((LOADED, np.array(tip, float)),)
    return Specimen(
        name, surface, projector(surface), elasticity, CLAMPED, loaded, volume, DENSITY
    )


def box(length, width, height, elasticity=STEEL):
    """A box from x = 0 (clamped) to x = length (loaded at the face's centre), metres."""
    vertices = np.array(
        [[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float
    )
    vertices = vertices * [length, width, height] - [0, width / 2, height / 2]
    quads = [
        (0, 1, 3, 2),
        (4, 6, 7, 5),
        (0, 4, 5, 1),
        (2, 3, 7, 6),
        (0, 2, 6, 4),
        (1, 5, 7, 3),
    ]
    axes = [(-1, 0, 0), (1, 0, 0), (0, -1, 0), (0, 1, 0), (0, 0, -1), (0, 0, 1)]
    areas = [width * height] * 2 + [length * height] * 2 + [length * width] * 2
    triangles = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    faces = [
        _face("plane", vertices[list(q)].mean(0), n, s)
        for q, n, s in zip(quads, axes, areas, strict=True)
    ]
    tags = np.repeat(range(6), 2)
    return _specimen(
        "box",
        vertices,
        triangles,
        tags,
        faces,
        length * width * height,
        (length, 0, 0),
        elasticity,
    )


def cylinder(length, radius, elasticity=STEEL, sides=12):
    """A round bar from x = 0 (clamped) to x = length (loaded at the face's centre), metres."""
    angle = 2 * np.pi * np.arange(sides) / sides
    ring = np.column_stack([0 * angle, radius * np.cos(angle), radius * np.sin(angle)])
    vertices = np.vstack(
        [ring, ring + np.array([length, 0, 0]), [[0, 0, 0], [length, 0, 0]]]
    )
    triangles = []
    tags = []
    for i in range(sides):
        j = (i + 1) % sides
        triangles += [(i, j, sides + j), (i, sides + j, sides + i), (2 * sides, j, i)]
        triangles += [(2 * sides + 1, sides + i, sides + j)]
        tags += [2, 2, 0, 1]
    area = np.pi * radius**2
    faces = [
        _face("plane", (0, 0, 0), (-1, 0, 0), area),
        _face("plane", (length, 0, 0), (1, 0, 0), area),
        _face("cylinder", (0, 0, 0), (1, 0, 0), 2 * np.pi * radius * length, radius),
    ]
    return _specimen(
        "link",
        vertices,
        triangles,
        tags,
        faces,
        area * length,
        (length, 0, 0),
        elasticity,
    )
