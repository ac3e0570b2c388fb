"""Solution of the supported stiffness: two levels beside a factorization, and a million degrees of freedom.

``pytest -m benchmark -s tests/benchmarks/test_solvers.py``. PARDISO is measured where pypardiso is installed.
"""

import json
import subprocess
import sys
import time
from importlib.util import find_spec

import numpy as np
import pytest

from stiffscope.fea.couplings import dofs_of
from stiffscope.fea.elasticity import assemble
from stiffscope.fea.multigrid import prepare
from tests.benchmarks.codes import meshed

pytestmark = pytest.mark.benchmark
LARGE = """
import json, resource, sys, time
from stiffscope.fea.run import run_experiment
from stiffscope.fea.settings import Settings
from tests.benchmarks.codes import build
e = run_experiment(build("slider"), Settings(size=float(sys.argv[1]), time_limit=600))
print(json.dumps({"dofs": 3 * len(e.mesh.points), "unknowns": e.unknowns, "seconds": e.seconds,
                  "peak": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9, "bound": e.relative_bound}))
"""


def test_a_million_degrees_of_freedom_within_8_gb():
    done = subprocess.run([sys.executable, "-c", LARGE, "0.0029"], capture_output=True, text=True, check=True)
    found = json.loads(done.stdout.strip().splitlines()[-1])
    print(
        f"\n| slider | {found['dofs']:,} | {found['unknowns']:,} | mesh {found['seconds']['mesh']:.0f} s | "
        f"solution {found['seconds']['solve']:.0f} s | {found['peak']:.1f} GB | bound {found['bound']:.1e} |"
    )
    assert found["dofs"] > 1e6
    assert found["peak"] < 8


def factorized_by_pardiso(stiffness, supports, loads):
    """Factor and solve with MKL, the loaded face distributed so that no coordinates are condensed."""
    from pypardiso import PyPardisoSolver
    from scipy.sparse import csr_matrix, triu

    free = dofs_of(supports.free)
    solver = PyPardisoSolver(mtype=2)
    upper = csr_matrix(triu(stiffness[free][:, free], format="csr"))
    solver.factorize(upper)
    return solver.solve(upper, np.asfortranarray(loads))


@pytest.mark.parametrize(("name", "factor"), [("link", 1.0), ("slider", 1.0), ("slider", 0.45)])
def test_two_levels_beside_a_factorization(name, factor):
    problem = meshed(name, factor)
    stiffness = assemble(problem.mesh, problem.elasticity)
    supports, loads = problem.supported("distributed")
    ways = {"two levels": lambda: prepare(problem.mesh, stiffness, supports, "multigrid").solve(loads)}
    if find_spec("pypardiso"):
        ways["PARDISO"] = lambda: factorized_by_pardiso(stiffness, supports, loads)
    ways["SuperLU"] = lambda: prepare(problem.mesh, stiffness, supports, "direct").solve(loads)
    answers = {}
    for way, solve in ways.items():
        began = time.perf_counter()
        answers[way] = loads.T @ solve()
        print(
            f"\n| {name} | {3 * len(problem.points):,} | {way} | {time.perf_counter() - began:.2f} s |",
            end="",
            flush=True,
        )
    scale = np.sqrt(np.outer(answers["SuperLU"].diagonal(), answers["SuperLU"].diagonal()))
    for answer in answers.values():
        assert np.abs((answer - answers["SuperLU"]) / scale).max() < 1e-5
