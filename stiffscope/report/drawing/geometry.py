"""Solids of a robot as numbers for a page's viewer: distinct meshes, and the bodies using them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

import numpy as np

from stiffscope.report.drawing.solids import upright
from stiffscope.report.drawing.surfaces import SHARP, sharp_edges
from stiffscope.report.numbers import base64_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    import pyvista as pv
    from numpy.typing import NDArray

    from stiffscope.report.drawing.solids import Solid

    Floats = NDArray[np.float64]

# Most triangles of a mesh and in total; smaller meshes than the last are not decimated. Without a
# graphics card a browser needs about 50 µs per triangle.
TRIANGLES = 6_000
ALL_TRIANGLES = 24_000
FEWEST = 400


def pack_solids(solids: Sequence[Solid], up: Floats, reach: float) -> dict[str, Any]:
    """Return the data of a page's viewer at home: `meshes`, `solids`, vertical and size.

    A mesh has points (float32, m), faces (uint32), normals (int8, times 127) and point pairs of its
    sharp edges, in base64. A solid shows it at ``axes x + base`` and moves with its ``nodes``.
    """
    shapes: list[pv.PolyData] = []
    placed: list[dict[str, Any]] = []
    for solid in solids:
        points = np.asarray(solid.surface.points, float)
        axes = np.eye(3) if solid.axes is None else np.asarray(solid.axes, float)
        base = (
            points.mean(axis=0) if solid.base is None else np.asarray(solid.base, float)
        )
        shape = solid.surface.copy()
        shape.points = local = (points - base) @ axes  # equal for all copies
        alike = (
            k
            for k, other in enumerate(shapes)
            if len(local) == other.n_points
            and np.allclose(shape.points, other.points, rtol=0.0, atol=1e-6)
        )
        k = next(alike, len(shapes))
        if k == len(shapes):
            shapes.append(shape)
        placed.append(
            {
                "mesh": k,
                "element": solid.element,
                "colour": solid.colour,
                "nodes": list(solid.nodes),
                "axes": axes.ravel().tolist(),
                "base": base.tolist(),
                "length": solid.length,
            }
        )
    drawn = sum(shapes[solid["mesh"]].n_cells for solid in placed)
    share = min(1.0, ALL_TRIANGLES / max(drawn, 1))
    meshes = []
    for shape in shapes:
        limit = max(FEWEST, min(TRIANGLES, round(share * shape.n_cells)))
        fewer = (
            shape
            if shape.n_cells <= limit
            else shape.decimate(1.0 - limit / shape.n_cells)
        )
        meshes.append(_mesh(cast("pv.PolyData", fewer)))
    turned = upright(up).ravel().tolist()
    return {"meshes": meshes, "solids": placed, "upright": turned, "reach": reach}


def _mesh(shape: pv.PolyData) -> dict[str, str]:
    """Return a surface with separate normals at sharp edges, in base64."""
    lines = sharp_edges(shape)
    split: Any = {"split_vertices": True, "feature_angle": SHARP}
    pairs = np.asarray(lines.lines).reshape(-1, 3)[:, 1:]
    smooth: Any = shape.compute_normals(cell_normals=False, **split)
    return {
        "points": base64_of(smooth.points),
        "normals": base64_of(np.round(127.0 * np.asarray(smooth["Normals"])), "i1"),
        "faces": base64_of(smooth.regular_faces, "<u4"),
        "edges": base64_of(np.asarray(lines.points)[pairs]),
    }
