"""Export to other programs: VTU files of mesh and fields, and the part as a superelement."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from stiffscope.fea.experiment import Experiment
    from stiffscope.fea.mesh import Floats

WRENCHES = ("fx", "fy", "fz", "mx", "my", "mz")


def write_vtu(experiment: Experiment, path: Path | str) -> Path:
    """Write the quadratic mesh with displacement (m) and von Mises stress (Pa) for each unit wrench; return the path.

    The boundary triangles are a second block of cells; the cell field ``face`` is their CAD face, -1 for tetrahedra.
    """
    import meshio

    path = Path(path)
    mesh = experiment.mesh
    fields = {}
    for k, (motion, stress) in enumerate(zip(experiment.displacement, experiment.von_mises, strict=True)):
        suffix = "" if len(experiment.displacement) == 6 else f"_{k // 6 + 1}"
        name = WRENCHES[k % 6] + suffix
        fields[f"displacement_{name}"] = motion
        fields[f"von_mises_{name}"] = stress
    cells: list[Any] = [("tetra10", mesh.cells), ("triangle6", mesh.facets)]
    faces = [np.full(len(mesh.cells), -1, dtype=np.int64), mesh.facet_face.astype(np.int64)]
    meshio.Mesh(mesh.points, cells, point_data=fields, cell_data={"face": faces}).write(path, file_format="vtu")
    return path


SUPERELEMENT_HELP = """\
Superelement of the part {part} (interfaces {interface}); SI: N/m, N/rad, N m/m, N m/rad.
Row and column order: for each node below its six degrees of freedom (ux, uy, uz, rx, ry, rz), small rotations,
in the axes of the part. The matrix is static condensation (Guyan) on the interfaces: K u = f.
Node 0 is the clamped interface; the matrix is free (six rigid-body motions are its null space), so fix node 0
by leaving out its six rows and columns. Nodes, x y z in m:
{nodes}"""


def free_superelement(experiment: Experiment) -> tuple[Floats, Floats]:
    """Return (6n + 6, 6n + 6) stiffness of the unsupported part, and (n + 1, 3) its nodes: clamp, then interfaces.

    The clamp moves with node 0 as one body and only relative motion strains the part, so this is exact. Node 0 is
    ``clamp_point``; with an elastic foundation it is the ground under it.
    """
    from stiffscope.fea.couplings import rigid_modes

    centre = experiment.clamp_point
    nodes = np.vstack([centre, experiment.reference_points])
    kinematics = np.zeros((len(experiment.reference_points), 6, 6))
    kinematics[:, :3] = rigid_modes(experiment.reference_points, centre)
    kinematics[:, 3:, 3:] = np.eye(3)
    relative = np.hstack(
        [-kinematics.reshape(-1, 6), np.eye(6 * len(kinematics))]
    )  # twists relative to the clamp's body
    stiffness = relative.T @ experiment.superelement @ relative
    return (stiffness + stiffness.T) / 2, nodes


def write_superelement(experiment: Experiment, path: Path | str) -> tuple[Path, Path]:
    """Write the free superelement as ``path.npz`` and as Matrix Market ``path.mtx``; return both paths.

    The npz holds ``stiffness`` (6n + 6, 6n + 6), ``nodes`` (n + 1, 3) in m and ``help``, a text on the order of
    rows and the units, which is the Matrix Market file's comment too. Neither needs this package to be read.
    """
    from scipy.io import mmwrite

    stiffness, nodes = free_superelement(experiment)
    lines = "\n".join(
        f"{k} {'clamped' if not k else 'loaded'} {x:.9g} {y:.9g} {z:.9g}" for k, (x, y, z) in enumerate(nodes)
    )
    text = SUPERELEMENT_HELP.format(part=experiment.part, interface=experiment.interface, nodes=lines)
    base = Path(path)
    base = base.with_suffix("") if base.suffix in (".npz", ".mtx") else base
    archive, matrix = base.with_name(base.name + ".npz"), base.with_name(base.name + ".mtx")
    np.savez(archive, stiffness=stiffness, nodes=nodes, help=np.array(text))
    with matrix.open("wb") as file:
        mmwrite(file, stiffness, comment=text, symmetry="symmetric", precision=15)
    return archive, matrix
