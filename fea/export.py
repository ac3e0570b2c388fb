"""Export to other programs: VTU files of mesh and fields, and superelements."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.sax.saxutils import escape

import numpy as np
from scipy.io import mmwrite
from scipy.linalg import block_diag

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from stiffscope.fea.experiment import Experiment
    from stiffscope.fea.mesh import Floats, TetMesh

WRENCHES = ("fx", "fy", "fz", "mx", "my", "mz")
FIRST_SCALAR = 1001  # number of the first mode in Nastran files


VTU_HELP = """\
Part {part}, clamped; points in m, in the axes of the part. displacement_*: m, von_mises_*: Pa,
for a unit of fx fy fz (N), mx my mz (N m) at each of the reference_points, with _1, _2 where there are several."""


def write_vtu(experiment: Experiment, path: Path | str) -> Path:
    """Write the mesh with displacement (m) and stress (Pa) per unit wrench as VTU; return the path.

    Boundary triangles are a second cell block; the cell field ``face`` is their CAD face, -1 for
    tetrahedra. Field data ``reference_points``: where wrenches act. A comment: units, axes, loads.
    """
    path = Path(path)
    fields = {}
    several = len(experiment.displacement) > 6
    for k, motion in enumerate(experiment.displacement):
        name = WRENCHES[k % 6] + (f"_{k // 6 + 1}" if several else "")
        fields[f"displacement_{name}"] = motion
        fields[f"von_mises_{name}"] = experiment.von_mises[k]
    write_fields(experiment.mesh, path, fields)
    # meshio neither writes field data nor reads texts, hence the comment
    points = " ".join(f"{x:.17g}" for x in experiment.reference_points.ravel())
    head = (
        f"<!--{VTU_HELP.format(part=escape(experiment.part).replace('--', '- -'))}-->\n<FieldData>"
        f'<DataArray type="Float64" Name="reference_points" NumberOfComponents="3" '
        f'NumberOfTuples="{len(experiment.reference_points)}" format="ascii">{points}</DataArray></FieldData>\n'
    )
    before, grid, after = path.read_bytes().partition(b"<UnstructuredGrid>\n")
    path.write_bytes(before + grid + head.encode() + after)
    return path


def write_fields(mesh: TetMesh, path: Path, fields: Mapping[str, np.ndarray]) -> None:
    """Write a mesh with nodal fields and the CAD faces of its boundary as VTU.

    Parameters
    ----------
    mesh
        Mesh of n nodes.
    path
        File to write.
    fields : (n, ...)
        Nodal values by name.
    """
    cells: list[Any] = [("tetra10", mesh.cells), ("triangle6", mesh.facets)]
    faces = [
        np.full(len(mesh.cells), -1, dtype=np.int64),
        mesh.facet_face.astype(np.int64),
    ]
    import meshio

    meshio.Mesh(
        mesh.points, cells, point_data=dict(fields), cell_data={"face": faces}
    ).write(path, file_format="vtu")


SUPERELEMENT_HELP = """\
Superelement of the part {part} (interfaces {interface}); SI: N, m, kg, rad, s.
Order of rows and columns: for each node below its six degrees of freedom (ux, uy, uz, rx, ry, rz), small rotations,
in the axes of the part; then {modes} modal coordinates, which vanish in statics. M a + K u = f.
Node 0 is the clamped interface as a rigid body. The matrices are free (six rigid-body motions are the null space of K):
fix node 0 by leaving out its six rows and columns. Weight: f = M t g with the translations t of all nodes.
The stiffness of the modal coordinates is diagonal (squared angular frequencies with all nodes held, rad^2/s^2).
Nodes, x y z in m:
{nodes}"""


@dataclass(frozen=True)
class Superelement:
    """A part or robot reduced to its nodes and modes.

    Attributes
    ----------
    stiffness, mass : (6n + k, 6n + k) for node twists, then for k modal coordinates.
    nodes : (n, 3) m; for a part the clamp, then the loaded interfaces.
    """

    stiffness: Floats
    mass: Floats
    nodes: Floats


def free_superelement(experiment: Experiment) -> Superelement:
    """Return the superelement of the unsupported part.

    The clamp moves rigidly with node 0 and only relative motion strains the part, so the stiffness
    is exact. Node 0 is ``clamp_point``; with an elastic foundation it is the ground.
    """
    stiffness = np.asarray(
        block_diag(experiment.stiffness, np.diag(experiment.mode_squares)),
        dtype=np.float64,
    )
    return Superelement(stiffness, experiment.condensed_mass, experiment.places)


def write_superelement(experiment: Experiment, path: Path | str) -> list[Path]:
    """Write the free superelement in the formats of `write_matrices`; return the paths.

    ``path.npz`` also holds ``mode_squares``. Node 0 is the clamp.
    """
    superelement = free_superelement(experiment)
    text = SUPERELEMENT_HELP.format(
        part=experiment.part,
        interface=experiment.interface,
        modes=len(experiment.mode_squares),
        nodes=node_lines(superelement.nodes, experiment.interfaces),
    )
    return write_matrices(
        superelement, path, text, mode_squares=experiment.mode_squares
    )


def node_lines(nodes: Floats, names: Sequence[str]) -> str:
    """Return one line per node (m, 3): number, name, x y z in m."""
    rows = enumerate(zip(names, nodes, strict=True))
    return "\n".join(
        f"{k} {name} {x:.9g} {y:.9g} {z:.9g}" for k, (name, (x, y, z)) in rows
    )


def write_matrices(
    superelement: Superelement, path: Path | str, text: str, **arrays: Floats
) -> list[Path]:
    """Write a superelement in formats for other codes; return the paths.

    ``path.npz`` contains ``stiffness``, ``mass``, ``nodes``, the ``arrays`` and ``help``, a text on
    row order and units, which is a comment in the others: ``path.stiffness.mtx``, ``path.mass.mtx``
    (Matrix Market), ``path.bdf`` (Nastran DMIG). This package is not needed to read them.

    Parameters
    ----------
    superelement
        Superelement.
    path
        File path without suffix.
    text
        Text on row order and units.
    **arrays
        Additional arrays for the npz file.
    """
    base = Path(path)
    base = base.with_suffix("") if base.suffix in (".npz", ".mtx") else base
    archive = base.with_name(base.name + ".npz")
    bulk = base.with_name(base.name + ".bdf")
    matrices = {"stiffness": superelement.stiffness, "mass": superelement.mass}
    content: dict[str, Any] = {
        "nodes": superelement.nodes,
        "help": np.array(text),
        **matrices,
        **arrays,
    }
    np.savez(archive, **content)
    bulk.write_text(
        _write_dmig(
            superelement.stiffness, superelement.mass, superelement.nodes, text
        ),
        encoding="ascii",
        errors="replace",
    )
    written = [archive, bulk]
    for name, matrix in matrices.items():
        written.append(base.with_name(f"{base.name}.{name}.mtx"))
        with written[-1].open("wb") as file:
            mmwrite(file, matrix, comment=text, symmetry="symmetric", precision=15)
    return written


def _write_dmig(stiffness: Floats, mass: Floats, nodes: Floats, comment: str) -> str:
    """Return bulk data of KPART and MPART: real, double precision, symmetric, large fields.

    Parameters
    ----------
    stiffness, mass : (6m + k, 6m + k) for six components of m nodes, then for k modes.
    nodes : (m, 3) m; grid points 1 to m. Modes are scalar points from ``FIRST_SCALAR``.
    """
    lines = [f"$ {line}" for line in comment.splitlines()]
    for number, node in enumerate(nodes, start=1):
        x, y, z = (f"{value:16.9E}" for value in node)
        lines += [f"GRID*   {number:16d}{'':16}{x}{y}", f"*       {z}"]
    count = len(stiffness) - 6 * len(nodes)
    lines += [f"SPOINT  {FIRST_SCALAR + k:8d}" for k in range(count)]
    places = [
        (number, component)
        for number in range(1, len(nodes) + 1)
        for component in range(1, 7)
    ]
    places += [(FIRST_SCALAR + k, 0) for k in range(count)]
    for name, matrix in (("KPART", stiffness), ("MPART", mass)):
        lines.append(
            f"DMIG    {name:8}{0:8d}{6:8d}{2:8d}{0:8d}"
        )  # symmetric, double precision
        for column, (point, component) in enumerate(places):
            rows = [row for row in np.flatnonzero(matrix[:, column]) if row >= column]
            if not rows:
                continue
            lines.append(f"DMIG*   {name:16}{point:16d}{component:16d}")
            for row in rows:
                lines.append(
                    f"*       {places[row][0]:16d}{places[row][1]:16d}{matrix[row, column]:16.9E}"
                )
    return "\n".join(lines) + "\n"
