"""VTU files of mesh and fields, for ParaView."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from fea.experiment import Experiment

WRENCHES = ("fx", "fy", "fz", "mx", "my", "mz")


def write_vtu(experiment: Experiment, path: Path | str) -> Path:
    """Write the quadratic mesh with displacement (m) and von Mises stress (Pa) for each unit wrench; return the path.

    Boundary triangles come as a second block of cells; the cell field ``face`` holds their CAD face, -1 inside.
    """
    import meshio

    path = Path(path)
    mesh = experiment.mesh
    fields = {}
    for k, (motion, stress) in enumerate(zip(experiment.displacement, experiment.von_mises, strict=True)):
        port = "" if len(experiment.displacement) == 6 else f"_{k // 6 + 1}"
        name = WRENCHES[k % 6] + port
        fields[f"displacement_{name}"] = motion
        fields[f"von_mises_{name}"] = stress
    cells: list[Any] = [("tetra10", mesh.cells), ("triangle6", mesh.facets)]
    faces = [np.full(len(mesh.cells), -1, dtype=np.int64), mesh.facet_face.astype(np.int64)]
    meshio.Mesh(mesh.points, cells, point_data=fields, cell_data={"face": faces}).write(path, file_format="vtu")
    return path
