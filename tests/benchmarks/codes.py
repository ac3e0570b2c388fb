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

import numpy as np

from tests.benchmarks import calculix

PARAMETERS = {"link": {}, "slider": {}, "ribbed slider": {"rib_count": 4, "fillet": 0.003, "hole_count": 3}}


@dataclass(frozen=True, eq=False)
class Problem:
    """Quadratic mesh (VTK order), clamped nodes, triangles of the rigid face, its reference point; SI."""

    points: np.ndarray
    cells: np.ndarray
    clamped: np.ndarray
    facets: np.ndarray
    point: np.ndarray
    youngs_modulus: float
    poisson: float


def build(name):
    """Build the part."""
    from stiffscope.cad import link, slider

    if name == "link":
        return link.build(link.LinkParameters())
    return slider.build(slider.SliderParameters(**PARAMETERS[name]))


def meshed(name, factor=1.0, layers=1):
    """From the CAD to a Problem, as ours does."""
    from stiffscope.cad.part import mass_properties, project, surface
    from stiffscope.fea.experiment import CHORD, TURN
    from stiffscope.fea.mesh import default_size
    from stiffscope.fea.specimen import Specimen, mesh_specimen

    part = build(name)
    volume = mass_properties(part).volume
    size = factor * default_size(volume, sum(face.area for face in part.faces))
    specimen = Specimen(
        name, surface(part, CHORD * size, TURN), lambda face, points: project(part, face, points),
        part.material.elasticity(), part.clamped, tuple((face.faces, face.reference_point) for face in part.loaded),
        volume,
    )  # fmt: skip
    mesh, face = mesh_specimen(specimen, size=size, layers=layers), part.loaded[0]
    return Problem(
        mesh.points, mesh.cells, mesh.nodes_of(part.clamped), mesh.facets_of(face.faces),
        np.asarray(face.reference_point), part.material.youngs_modulus, part.material.poisson,
    )  # fmt: skip


def in_calculix(problem, job):
    """CalculiX with SPOOLES on "threads" threads."""
    text = calculix.deck(
        problem.points, problem.cells, problem.clamped, np.unique(problem.facets), problem.point,
        problem.youngs_modulus, problem.poisson,
    )  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        return calculix.run(folder, text, os.environ | {"OMP_NUM_THREADS": str(job.get("threads", 1))})


def in_ours(problem, job):
    """Our quadratic elements, with quadrature of the order "order" in curved ones."""
    from stiffscope.fea import elasticity as fea_elasticity

    fea_elasticity.CURVED_ORDER = job.get("order", 4)
    shear = problem.youngs_modulus / 2 / (1 + problem.poisson)
    elasticity = fea_elasticity.isotropic(problem.youngs_modulus, shear)
    return tied(problem, fea_elasticity.assemble(problem, elasticity))


def in_mfem(problem, job):
    """Stiffness by MFEM's elasticity integrator; rigid face and solution as in ours.

    MFEM has no rigid bodies, and its wheel brings no direct solver.
    """
    import mfem.ser as mfem
    from scipy.sparse import csr_array
    from scipy.spatial import KDTree

    with tempfile.NamedTemporaryFile("w", suffix=".vtk") as file:
        count, cells = len(problem.points), problem.cells
        file.write(f"# vtk DataFile Version 3.0\npart\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS {count} double\n")
        np.savetxt(file, problem.points, "%.17g")
        file.write(f"CELLS {len(cells)} {11 * len(cells)}\n")
        np.savetxt(file, np.column_stack([np.full(len(cells), 10), cells]), "%d")
        file.write(f"CELL_TYPES {len(cells)}\n" + "24\n" * len(cells))
        file.flush()
        mesh = mfem.Mesh(file.name, 1, 0)
    where = mesh.GetNodes().GetDataArray().reshape(3, -1).T  # MFEM keeps the components one after the other
    off, node = KDTree(where).query(problem.points)
    if off.max() > 0 or len(np.unique(node)) != count:
        raise RuntimeError("MFEM's nodes are not the mesh's")
    space = mfem.FiniteElementSpace(mesh, mfem.H1_FECollection(2, 3), 3, mfem.Ordering.byVDIM)
    shear = problem.youngs_modulus / 2 / (1 + problem.poisson)
    lame = 2 * shear * problem.poisson / (1 - 2 * problem.poisson)
    coefficients = mfem.ConstantCoefficient(lame), mfem.ConstantCoefficient(shear)
    form = mfem.BilinearForm(space)
    integrator = mfem.ElasticityIntegrator(*coefficients)
    if "order" in job:
        integrator.SetIntRule(mfem.IntRules.Get(mfem.Geometry.TETRAHEDRON, job["order"]))
    form.AddDomainIntegrator(integrator)
    form.Assemble()
    form.Finalize()
    held = form.SpMat()
    shape = (3 * count, 3 * count)
    stiffness = csr_array((held.GetDataArray(), held.GetJArray(), held.GetIArray()), shape=shape)
    order = (3 * node[:, None] + np.arange(3)).reshape(-1)
    return tied(problem, stiffness[order][:, order])


def in_scikit_fem(problem, job):
    """Stiffness by scikit-fem's own form and quadrature; rigid face and solution as in ours."""
    del job
    from skfem import Basis, ElementTetP2, ElementVector, MeshTet2
    from skfem.models.elasticity import lame_parameters, linear_elasticity

    vertices = np.unique(problem.cells[:, :4])
    rest = np.setdiff1d(np.arange(len(problem.points)), vertices)
    new = np.empty(len(problem.points), dtype=int)
    new[np.concatenate([vertices, rest])] = np.arange(len(new))
    grid = MeshTet2(problem.points[np.concatenate([vertices, rest])].T, new[problem.cells].T)
    basis = Basis(grid, ElementVector(ElementTetP2()))
    law = lame_parameters(problem.youngs_modulus, problem.poisson)
    stiffness = linear_elasticity(*law).assemble(basis).tocsr()
    order = np.empty((len(problem.points), 3), dtype=int)
    order[problem.cells] = basis.element_dofs.T.reshape(-1, 10, 3)
    return tied(problem, stiffness[order.reshape(-1)][:, order.reshape(-1)])


def tied(problem, stiffness):
    """Compliance of an assembled stiffness with the clamp, the rigid face and the solver of ours."""
    from stiffscope.fea.interfaces import Port, support, unit_loads
    from stiffscope.fea.multigrid import prepare

    ports = (Port(problem.facets, problem.point, "rigid"),)
    supports = support(problem, problem.clamped, ports)
    loads = unit_loads(problem.points, supports, ports)
    return loads.T @ prepare(problem, stiffness, supports).solve(loads)


CODES = {"ours": in_ours, "CalculiX": in_calculix, "MFEM": in_mfem, "scikit-fem": in_scikit_fem}


def command(job):
    """What starts a process for a job."""
    return [sys.executable, "-m", "tests.benchmarks.codes", json.dumps(job)]


def solved(job):
    """What a job finds: compliance and degrees of freedom, and of a whole experiment its bound."""
    if job["code"] == "experiment":
        from stiffscope.fea.experiment import Settings, run_experiment

        done = run_experiment(build(job["part"]), Settings(**job.get("settings", {})))
        return {"compliance": done.compliance.tolist(), "dofs": done.unknowns, "bound": done.relative_bound,
                "note": done.note}  # fmt: skip
    if job["code"] == "mesh":
        np.savez(job["mesh"], **asdict(meshed(job["part"], job.get("size", 1.0), job.get("layers", 1))))
        return {}
    with tempfile.TemporaryDirectory() as folder:
        path = job.get("mesh") or f"{folder}/mesh.npz"
        if "mesh" not in job:  # by a process that ends, so that the CAD kernel's memory does not add to the solver's
            subprocess.run(command(job | {"code": "mesh", "mesh": path}), check=True, stdout=subprocess.DEVNULL)
        with np.load(path) as held:
            problem = Problem(**held)
    return {"compliance": CODES[job["code"]](problem, job).tolist(), "dofs": 3 * len(problem.points)}


def measured(**job):
    """What the job finds, "seconds" of the whole process and "megabytes", the peak of its tree (sampled each 20 ms).

    Resident memory is added up over the tree, so what processes share counts more than once.
    """
    import psutil

    began = time.perf_counter()
    with tempfile.TemporaryFile("w+") as says, tempfile.TemporaryFile("w+") as complains:
        process = subprocess.Popen(command(job), stdout=says, stderr=complains)
        root, peak = psutil.Process(process.pid), 0
        while process.poll() is None:
            held = 0
            for one in (root, *children(root)):
                try:
                    held += one.memory_info().rss
                except psutil.Error:
                    continue
            peak = max(peak, held)
            time.sleep(0.02)
        seconds = time.perf_counter() - began
        for stream in (says, complains):
            stream.seek(0)
        if process.returncode:
            raise RuntimeError(f"{job}: {complains.read()[-800:]}")
        answer = json.loads(says.read().strip().splitlines()[-1])
    return answer | {"compliance": np.array(answer["compliance"]), "seconds": seconds, "megabytes": peak / 1e6}


def children(process):
    import psutil

    try:
        return process.children(recursive=True)
    except psutil.Error:
        return []


if __name__ == "__main__":
    print(json.dumps(solved(json.loads(sys.argv[1]))))
