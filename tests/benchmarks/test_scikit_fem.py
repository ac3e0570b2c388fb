"""Plain scikit-fem and SciPy on the same mesh: what ours saves by batching, and whether all 36 entries agree.

``pytest -m benchmark -s tests/benchmarks/test_scikit_fem.py``. Wall times of assembly and of factor and six loads.
"""

import time

import numpy as np
import pytest

from fea.elasticity import assemble
from fea.interfaces import Port, support, unit_loads
from fea.multigrid import prepare
from tests.benchmarks.test_calculix import PARTS, meshed

pytestmark = pytest.mark.benchmark


def plain(mesh, material):
    """Stiffness by scikit-fem's own form and default quadrature, its nodes put in our order."""
    from skfem import Basis, ElementTetP2, ElementVector, MeshTet2
    from skfem.models.elasticity import lame_parameters, linear_elasticity

    vertices = np.unique(mesh.cells[:, :4])
    new = np.full(len(mesh.points), -1)
    new[vertices] = np.arange(len(vertices))
    new[np.setdiff1d(np.arange(len(mesh.points)), vertices)] = np.arange(len(vertices), len(mesh.points))
    points = np.empty_like(mesh.points)
    points[new] = mesh.points
    grid = MeshTet2(points.T, new[mesh.cells].T)
    basis = Basis(grid, ElementVector(ElementTetP2()))
    matrix = linear_elasticity(*lame_parameters(material.youngs_modulus, material.poisson)).assemble(basis)
    where = np.empty((len(mesh.points), 3), dtype=int)
    local = basis.element_dofs.T.reshape(-1, 10, 3)
    where[mesh.cells] = local
    order = where.reshape(-1)
    return matrix.tocsr()[order][:, order]


@pytest.mark.parametrize("name", ["link", "slider"])
def test_plain_scikit_fem_gives_the_same_answer_later(name):
    part = PARTS[name]()
    mesh, _ = meshed(part)
    ports = (Port(mesh.facets_of(part.loaded[0].faces), part.loaded[0].reference_point, "rigid"),)
    supports = support(mesh, mesh.nodes_of(part.clamped), ports)
    loads = unit_loads(mesh.points, supports, ports)
    answers = []
    for code, build, solver in (
        ("scikit-fem, SciPy", lambda: plain(mesh, part.material), "splu"),
        ("ours", lambda: assemble(mesh, part.material.elasticity()), "auto"),
    ):
        began = time.perf_counter()
        stiffness = build()
        assembled = time.perf_counter()
        solve = prepare(mesh, stiffness, supports, solver).solve
        answers.append(loads.T @ solve(loads))
        solved = time.perf_counter()
        print(f"| {name} | {code} | {3 * len(mesh.points)} | assembly {assembled - began:.2f} s | "
              f"solution {solved - assembled:.2f} s |", flush=True)  # fmt: skip
    scale = np.sqrt(np.outer(answers[1].diagonal(), answers[1].diagonal()))
    worst = np.abs((answers[0] - answers[1]) / scale).max()
    print(f"largest difference of 36 entries {worst:.0e}")
    assert worst < 2e-3
