"""Codes compared as whole processes: ``python -m tests.benchmarks.codes '{"code": "CalculiX", ...}'``.

A job solves a stored mesh ("mesh": a path) or goes from the CAD by our mesher ("size": times the default, "layers"),
and prints its compliance. ``measured`` starts it and samples the memory of its whole process tree.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from functools import cached_property
from unittest import mock

import numpy as np

from tests.benchmarks import calculix

PARAMETERS = {
    "link": {},
    "slider": {},
    "ribbed slider": {"rib_count": 4, "fillet": 0.003, "hole_count": 3},
}


@dataclass(frozen=True, eq=False)
class Problem:
    """A mesh (see ``TetMesh``), its clamped and its rigid CAD faces, the reference point, the material; SI."""

    points: np.ndarray
    cells: np.ndarray
    facets: np.ndarray
    facet_face: np.ndarray
    clamped: np.ndarray
    loaded: np.ndarray
    point: np.ndarray
    youngs_modulus: float
    poisson: float
    density: float

    @cached_property
    def mesh(self):
        """The mesh, with its views for scikit-fem."""
        from stiffscope.fea.mesh import TetMesh

        return TetMesh(self.points, self.cells, self.facets, self.facet_face)

    def nodes(self, faces):
        """Nodes on CAD faces."""
        return self.mesh.nodes_of(frozenset(faces.tolist()))

    @property
    def elasticity(self):
        """(6, 6) Pa."""
        from tests.fea.shapes import isotropic

        return isotropic(
            self.youngs_modulus, self.youngs_modulus / 2 / (1 + self.poisson)
        )

    def supported(self, kind="rigid"):
        """The constraints and the loads of the clamp and a coupling."""
        from stiffscope.fea.couplings import Coupling, support, unit_loads

        couplings = (Coupling(frozenset(self.loaded.tolist()), self.point, kind),)
        supports = support(self.mesh, self.nodes(self.clamped), couplings)
        return supports, unit_loads(self.mesh, supports, couplings)


def build(name):
    """Build the part."""
    from stiffscope.cad import link, slider, solid

    if name == "link":
        return solid.build(link.LinkParameters())
    return solid.build(slider.SliderParameters(**PARAMETERS[name]))


def meshed(name, factor=1.0, layers=1):
    """From the CAD to a Problem, as ours does."""
    from stiffscope.cad.part import mass_properties
    from stiffscope.fea.mesh import default_size
    from stiffscope.fea.run import specimen_of
    from stiffscope.fea.settings import Settings
    from stiffscope.fea.specimen import mesh_specimen

    part = build(name)
    size = factor * default_size(
        mass_properties(part).volume, sum(face.area for face in part.faces)
    )
    mesh = mesh_specimen(
        specimen_of(part, Settings(size=size)),
        size=size,
        layers=layers,
        time_limit=1800,
    )
    face = part.loaded[0]
    return Problem(
        mesh.points,
        mesh.cells,
        mesh.facets,
        mesh.facet_face,
        np.array(sorted(part.clamped)),
        np.array(sorted(face.faces)),
        np.asarray(face.reference_point),
        part.material.youngs_modulus,
        part.material.poisson,
        part.material.density,
    )


def load(path):
    """A stored Problem."""
    with np.load(path) as held:
        return Problem(
            **{
                name: values if values.ndim else values.item()
                for name, values in held.items()
            }
        )


def for_calculix(problem):
    """The problem as CalculiX's model data."""
    return calculix.model(
        problem.points,
        problem.cells,
        problem.nodes(problem.clamped),
        ((problem.nodes(problem.loaded), problem.point),),
        problem.youngs_modulus,
        problem.poisson,
        problem.density,
    )


def in_calculix(problem, job):
    """CalculiX with SPOOLES on "threads" threads."""
    text = for_calculix(problem) + calculix.unit_loads(len(problem.points))
    with tempfile.TemporaryDirectory() as folder:
        return calculix.compliance(
            folder, text, os.environ | {"OMP_NUM_THREADS": str(job.get("threads", 1))}
        )


def in_ours(problem, job):
    """Our quadratic elements, with quadrature of the order "order" in curved ones."""
    from stiffscope.fea import elasticity as fea_elasticity

    with mock.patch.object(fea_elasticity, "CURVED_ORDER", job.get("order", 4)):
        return tied(problem, fea_elasticity.assemble(problem.mesh, problem.elasticity))


def in_mfem(problem, job):
    """Stiffness by MFEM's elasticity integrator; rigid face and solution as in ours.

    MFEM has no rigid bodies, and its wheel brings no direct solver.
    """
    import mfem.ser as mfem
    from scipy.sparse import csr_array
    from scipy.spatial import KDTree

    with tempfile.NamedTemporaryFile("w", suffix=".vtk") as file:
        count = len(problem.points)
        cells = problem.cells
        file.write(
            f"# vtk DataFile Version 3.0\npart\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS {count} double\n"
        )
        np.savetxt(file, problem.points, "%.17g")
        file.write(f"CELLS {len(cells)} {11 * len(cells)}\n")
        np.savetxt(file, np.column_stack([np.full(len(cells), 10), cells]), "%d")
        file.write(f"CELL_TYPES {len(cells)}\n" + "24\n" * len(cells))
        file.flush()
        mesh = mfem.Mesh(file.name, 1, 0)
    where = (
        mesh.GetNodes().GetDataArray().reshape(3, -1).T
    )  # MFEM keeps the components one after the other
    off, node = KDTree(where).query(problem.points)
    if off.max() > 0 or len(np.unique(node)) != count:
        raise RuntimeError("MFEM's nodes are not the mesh's")
    space = mfem.FiniteElementSpace(
        mesh, mfem.H1_FECollection(2, 3), 3, mfem.Ordering.byVDIM
    )
    shear = problem.youngs_modulus / 2 / (1 + problem.poisson)
    lame = 2 * shear * problem.poisson / (1 - 2 * problem.poisson)
    coefficients = mfem.ConstantCoefficient(lame), mfem.ConstantCoefficient(shear)
    form = mfem.BilinearForm(space)
    integrator = mfem.ElasticityIntegrator(*coefficients)
    if "order" in job:
        integrator.SetIntRule(
            mfem.IntRules.Get(mfem.Geometry.TETRAHEDRON, job["order"])
        )
    form.AddDomainIntegrator(integrator)
    form.Assemble()
    form.Finalize()
    held = form.SpMat()
    shape = (3 * count, 3 * count)
    stiffness = csr_array(
        (held.GetDataArray(), held.GetJArray(), held.GetIArray()), shape=shape
    )
    order = (3 * node[:, None] + np.arange(3)).reshape(-1)
    return tied(problem, stiffness[order][:, order])


def tied(problem, stiffness):
    """Compliance of an assembled stiffness with the clamp, the rigid face and the solver of ours."""
    from stiffscope.fea.multigrid import prepare

    supports, loads = problem.supported()
    return loads.T @ prepare(problem.mesh, stiffness, supports).solve(loads)


CODES = {"ours": in_ours, "CalculiX": in_calculix, "MFEM": in_mfem}


def command(job):
    """What starts a process for a job."""
    return [sys.executable, "-m", "tests.benchmarks.codes", json.dumps(job)]


def solved(job):
    """What a job finds: compliance and degrees of freedom, and of a whole experiment its bound."""
    if job["code"] == "experiment":
        from stiffscope.fea.run import run_experiment
        from stiffscope.fea.settings import Settings

        done = run_experiment(build(job["part"]), Settings(**job.get("settings", {})))
        return {
            "compliance": done.compliance.tolist(),
            "dofs": done.unknowns,
            "bound": done.relative_bound,
            "note": done.note,
        }
    if job["code"] == "mesh":
        np.savez(
            job["mesh"],
            **asdict(meshed(job["part"], job.get("size", 1.0), job.get("layers", 1))),
        )
        return {}
    with tempfile.TemporaryDirectory() as folder:
        path = job.get("mesh") or f"{folder}/mesh.npz"
        if (
            "mesh" not in job
        ):  # by a process that ends, so that the CAD kernel's memory does not add to the solver's
            subprocess.run(
                command(job | {"code": "mesh", "mesh": path}),
                check=True,
                stdout=subprocess.DEVNULL,
            )
        problem = load(path)
    return {
        "compliance": CODES[job["code"]](problem, job).tolist(),
        "dofs": 3 * len(problem.points),
    }


def measured(**job):
    """What the job finds, "seconds" of processor of the whole tree and "megabytes", its peak (sampled each 20 ms).

    Processor time hardly depends on what else the machine does. Resident memory is added up over the tree, so what
    processes share counts more than once.
    """
    import psutil

    before = os.times()
    with (
        tempfile.TemporaryFile("w+") as says,
        tempfile.TemporaryFile("w+") as complains,
    ):
        process = subprocess.Popen(command(job), stdout=says, stderr=complains)
        root = psutil.Process(process.pid)
        peak = 0
        while process.poll() is None:
            held = 0
            for one in (root, *children(root)):
                try:
                    held += one.memory_info().rss
                except psutil.Error:
                    continue
            peak = max(peak, held)
            time.sleep(0.02)
        after = os.times()
        for stream in (says, complains):
            stream.seek(0)
        if process.returncode:
            raise RuntimeError(f"{job}: {complains.read()[-800:]}")
        answer = json.loads(says.read().strip().splitlines()[-1])
    seconds = (
        after.children_user
        + after.children_system
        - before.children_user
        - before.children_system
    )
    return answer | {
        "compliance": np.array(answer["compliance"]),
        "seconds": seconds,
        "megabytes": peak / 1e6,
    }


def children(process):
    import psutil

    try:
        return process.children(recursive=True)
    except psutil.Error:
        return []


if __name__ == "__main__":
    print(json.dumps(solved(json.loads(sys.argv[1]))))
