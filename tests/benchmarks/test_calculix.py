"""CalculiX beside ours: the same mesh, clamp, rigid face and six loads; then the way to 0.1 % of true error.

``pytest -m benchmark -s tests/benchmarks/test_calculix.py``. CalculiX runs the six loads as steps of one job on all
cores, with the BLAS it finds (set LD_LIBRARY_PATH to OpenBLAS's folder to tune it). The second table gives CalculiX
the mesh that its quadratic elements need for 0.1 %, from our mesher, graded at the singular edges as ours is: both pay
for the same CAD, import and meshing; ours then solves on its coarser mesh.
"""

import json
import os
import subprocess
import sys
import tempfile
import time

import numpy as np
import pytest

from cad import link, slider
from fea.elasticity import assemble
from fea.interfaces import Port, support, unit_loads
from fea.multigrid import prepare
from fea.specimen import Specimen, mesh_specimen
from tests.benchmarks import calculix

pytestmark = [
    pytest.mark.benchmark,
    pytest.mark.skipif(calculix.ccx() is None, reason="CalculiX is missing (Debian: calculix-ccx)"),
]
PARTS = {
    "link": lambda: link.build(link.LinkParameters()),
    "slider": lambda: slider.build(slider.SliderParameters()),
    "ribbed slider": lambda: slider.build(slider.SliderParameters(rib_count=4, fillet=0.003, hole_count=3)),
}
TARGET = 1e-3
OURS = """
import json, resource, sys, time
import numpy as np
began = time.perf_counter()
from tests.benchmarks.test_calculix import PARTS
from fea.experiment import Settings, run_experiment
e = run_experiment(PARTS[sys.argv[1]](), Settings(**json.loads(sys.argv[2])))
peak = max(resource.getrusage(w).ru_maxrss for w in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)) / 1e3
print(json.dumps({"c": e.compliance.tolist(), "seconds": time.perf_counter() - began, "peak": peak,
                  "dofs": 3 * len(e.mesh.points), "bound": e.relative_bound, "note": e.note, "stages": e.seconds}))
"""


def ours(name, **settings):
    """Run ours as a process of its own, imports and all."""
    began = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-c", OURS, name, json.dumps(settings)], capture_output=True, text=True, check=True
    )
    answer = json.loads(done.stdout.strip().splitlines()[-1])
    answer["seconds"] = time.perf_counter() - began
    return answer


def meshed(part, size=None, layers=1):
    from cad.part import mass_properties, project, surface
    from fea.experiment import CHORD, TURN
    from fea.mesh import default_size

    volume = mass_properties(part).volume
    size = size or default_size(volume, sum(face.area for face in part.faces))
    specimen = Specimen(
        part.name,
        surface(part, CHORD * size, TURN),
        lambda face, points: project(part, face, points),
        part.material.elasticity(),
        part.clamped,
        tuple((face.faces, face.reference_point) for face in part.loaded),
        volume,
    )
    return mesh_specimen(specimen, size=size, layers=layers), size


def in_calculix(part, mesh, *, perturbation=False):
    clamped, loaded = mesh.nodes_of(part.clamped), mesh.nodes_of(part.loaded[0].faces)
    text = calculix.deck(
        mesh, part.material.youngs_modulus, part.material.poisson, clamped, loaded,
        part.loaded[0].reference_point, perturbation=perturbation,
    )  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        return calculix.run(folder, text, os.environ | {"OMP_NUM_THREADS": str(os.cpu_count())})


def quadratic(part, mesh):
    """Compliance of the quadratic elements in ours, and its seconds."""
    began = time.perf_counter()
    ports = (Port(mesh.facets_of(part.loaded[0].faces), part.loaded[0].reference_point, "rigid"),)
    supports = support(mesh, mesh.nodes_of(part.clamped), ports)
    stiffness = assemble(mesh, part.material.elasticity())
    solve = prepare(mesh, stiffness, supports).solve
    loads = unit_loads(mesh.points, supports, ports)
    return loads.T @ solve(loads), time.perf_counter() - began


def significant(matrix):
    scale = np.sqrt(matrix.diagonal())
    return np.abs(matrix) > 0.01 * np.outer(scale, scale)


@pytest.mark.parametrize("name", PARTS)
def test_same_mesh_same_answer(name, monkeypatch):
    """All 36 entries, with CalculiX's four quadrature points in curved elements, where ours takes eleven."""
    monkeypatch.setattr("fea.elasticity.CURVED_ORDER", 2)
    part = PARTS[name]()
    mesh, _ = meshed(part)
    mine, seconds = quadratic(part, mesh)
    theirs = in_calculix(part, mesh)
    scale = np.sqrt(np.outer(mine.diagonal(), mine.diagonal()))
    worst = np.abs((mine - theirs.compliance) / scale).max()
    for i in range(6):
        print(" | ".join(f"{mine[i, j]: .6e} {theirs.compliance[i, j]: .6e}" for j in range(6)))
    print(
        f"| {name} | {3 * len(mesh.points)} | {seconds:.1f} s | {theirs.seconds:.1f} s, {theirs.megabytes:.0f} MB | "
        f"largest difference of 36 entries {worst:.0e} |",
        flush=True,
    )
    assert worst < 1e-5


@pytest.mark.parametrize("name", PARTS)
def test_time_to_a_tenth_of_a_percent(name):
    """True error: against a finer solution with three layers, of all significant entries."""
    finer = np.array(ours(name, tolerance=2.5e-4, time_limit=300)["c"])
    large = significant(finer)
    mine = best = None
    for settings in ({}, {"tolerance": 3e-3}, {"tolerance": TARGET}):
        mine = ours(name, **settings)
        off = np.abs(np.array(mine["c"])[large] / finer[large] - 1).max()
        print(f"ours {settings}: {off:.1e} true, {mine['bound']:.1e} bound, {mine['seconds']:.1f} s, "
              f"{mine['peak']:.0f} MB, {mine['dofs']} dofs {mine['note']}", flush=True)  # fmt: skip
        if best is None and off <= TARGET:
            best = (off, mine["seconds"], mine["peak"], mine["dofs"])
    part = PARTS[name]()
    _, size = meshed(part)
    for factor, layers in ((1, 1), (1, 2), (0.7, 2), (0.7, 3), (0.5, 3), (0.35, 3)):
        began = time.perf_counter()
        mesh, _ = meshed(part, size * factor, layers)
        meshing = time.perf_counter() - began
        theirs = in_calculix(part, mesh)
        off = np.abs(theirs.compliance[large] / finer[large] - 1).max()
        total = meshing + theirs.seconds
        print(f"CalculiX {factor} x size, {layers} layers: {off:.1e} true, {total:.1f} s ({meshing:.1f} s meshing), "
              f"{theirs.megabytes:.0f} MB, {3 * len(mesh.points)} dofs", flush=True)  # fmt: skip
        if off <= TARGET or total > 200:
            break
    print(f"| {name} | ours {best} | CalculiX {off:.1e}, {total:.1f} s, {theirs.megabytes:.0f} MB |", flush=True)
