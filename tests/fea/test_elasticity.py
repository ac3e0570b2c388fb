from functools import partial

import numpy as np
import pytest
from scipy.sparse import block_array
from skfem import Basis, ElementTetP2, ElementVector, InteriorFacetBasis
from skfem.models.elasticity import lame_parameters, linear_elasticity

from stiffscope.errors import InputError
from stiffscope.fea.couplings import Coupling, support, unit_loads
from stiffscope.fea.cubic import (
    cubic_loads,
    cubic_problem,
    element_energies,
    solve_cubic,
    weigh_energies,
    work,
)
from stiffscope.fea.cubic_products import element_forces
from stiffscope.fea.cubic_space import enrich
from stiffscope.fea.elasticity import assemble, nodal_stresses
from stiffscope.fea.geometry import quadrature, volume
from stiffscope.fea.multigrid import largest_eigenvalue, prepare
from stiffscope.fea.rigid import rigid_modes
from stiffscope.fea.settings import KINDS
from stiffscope.fea.solvers import Solver
from stiffscope.fea.spaces import ElementTetCubic, cell_bases
from tests.fea.shapes import CLAMPED, LOADED, STEEL, isotropic

pytestmark = pytest.mark.slow

LAME = lame_parameters(211e9, 211 / 162 - 1)  # of STEEL


def respond(specimen, mesh, kind="rigid", solver="direct", elasticity=STEEL):
    couplings = (Coupling(LOADED, specimen.loaded[0][1], kind),)
    supports = support(mesh, mesh.nodes_of(CLAMPED), couplings)
    stiffness = assemble(mesh, elasticity)
    prepared = prepare(mesh, stiffness, supports, solver)
    loads = unit_loads(mesh, supports, couplings)
    return supports, couplings, prepared, loads, prepared.solve(loads)


@pytest.mark.extended
def test_the_mesh_is_numbered_as_scikit_fem_numbers_it(stub):
    _, mesh = stub
    assert np.array_equal(mesh.grid.dofs.element_dofs.T, mesh.cells)
    for face in range(3):
        facets = mesh.grid.facets[:, mesh.grid.boundaries[str(face)]]
        assert np.array_equal(
            np.unique(facets), np.unique(mesh.facets_of(frozenset({face}))[:, :3])
        )


def test_the_stiffness_is_that_of_scikit_fems_vector_form(stub):
    _, mesh = stub
    bases = list(cell_bases(mesh, ElementVector(ElementTetP2()), 2, 4))
    expected = sum(linear_elasticity(*LAME).assemble(basis) for basis in bases)
    assert len(bases) == 2
    assert abs(assemble(mesh, STEEL) - expected).max() < 1e-12 * abs(expected).max()


def test_the_cubic_forces_are_those_of_scikit_fems_vector_form(stub, rng):
    """The kernel of the cubic product beside the form, on all functions at once."""
    _, mesh = stub
    space = enrich(mesh, STEEL)
    expected = 0
    pairs = (
        cell_bases(mesh, ElementVector(element), 4, 6)
        for element in (ElementTetP2(), ElementTetCubic())
    )
    for bases in zip(*pairs, strict=True):
        expected = expected + block_array(
            [[linear_elasticity(*LAME).assemble(u, v) for u in bases] for v in bases]
        )
    motion = rng.normal(size=(space.count, 3, 2))
    forces = np.zeros_like(motion)
    for batch in space.batches():
        cells = space.cells[np.concatenate([chunk.elements for chunk in batch])]
        np.add.at(forces, cells, element_forces(space, batch, motion))
    expected = (expected @ motion.reshape(-1, 2)).reshape(motion.shape)
    assert np.abs(forces - expected).max() < 1e-12 * np.abs(expected).max()


def test_rigid_motion_costs_nothing_and_constant_strain_is_exact(stub, rng):
    _, mesh = stub
    root = rng.normal(size=(6, 6))
    elasticity = 1e11 * (root @ root.T + 6 * np.eye(6))  # fully anisotropic
    stiffness = assemble(mesh, elasticity)
    modes = rigid_modes(mesh.points, np.zeros(3)).reshape(-1, 6)
    assert (
        np.abs(stiffness @ modes).max()
        < 1e-8 * np.abs(stiffness.data).max() * np.abs(modes).max()
    )
    gradient = rng.normal(size=(3, 3))
    motion = (mesh.points @ gradient.T).reshape(-1)
    e = (gradient + gradient.T) / 2
    strain = np.array(
        [e[0, 0], e[1, 1], e[2, 2], 2 * e[1, 2], 2 * e[0, 2], 2 * e[0, 1]]
    )
    energy = strain @ elasticity @ strain * volume(mesh.points, mesh.cells)
    assert motion @ (stiffness @ motion) == pytest.approx(energy, rel=1e-6)
    stress = nodal_stresses(mesh, motion[:, None], elasticity)
    assert (
        np.abs(stress[:, 0] - elasticity @ strain).max()
        < 1e-6 * np.abs(elasticity @ strain).max()
    )


def test_cubic_functions_are_continuous_vanish_at_nodes_and_have_their_derivatives(
    stub,
):
    element = ElementTetCubic()
    at = quadrature(4)[0]
    step = 1e-6
    for i in range(10):
        assert element.lbasis(ElementTetP2.doflocs.T, i)[0] == pytest.approx(
            0, abs=1e-15
        )
        for k in range(3):
            shift = step * np.eye(3)[k][:, None]
            numeric = (
                element.lbasis(at + shift, i)[0] - element.lbasis(at - shift, i)[0]
            ) / (2 * step)
            assert element.lbasis(at, i)[1][k] == pytest.approx(numeric, abs=1e-8)
    _, mesh = stub
    grid = mesh.grid
    basis = Basis(mesh.grid, element, intorder=2)
    field = np.random.default_rng(1).normal(size=basis.N)
    volumes = basis.dx / basis.W
    straight = (
        np.ptp(volumes, axis=1) < 1e-9 * volumes[:, 0]
    )  # scikit-fem's inverse map may fail on curved elements
    inner = np.flatnonzero((grid.f2t[1] >= 0) & straight[grid.f2t].all(axis=0))[:200]
    assert len(inner) > 50
    sides = [
        InteriorFacetBasis(grid, element, facets=inner, side=side, intorder=3)
        for side in (0, 1)
    ]
    left, right = (np.asarray(side.interpolate(field).value) for side in sides)
    assert left == pytest.approx(right, abs=1e-9)


@pytest.mark.extended_for("rigid", "distributed")
@pytest.mark.parametrize("kind", KINDS)
def test_the_cubic_solution_is_softer_in_every_direction(stub, kind):
    specimen, mesh = stub
    supports, couplings, solver, loads, quadratic = respond(specimen, mesh, kind)
    lower = loads.T @ quadratic
    space = enrich(mesh, STEEL)
    problem = cubic_problem(mesh, space, supports, solver, assemble(mesh, STEEL))
    tractions = cubic_loads(mesh, space, couplings)[problem.free].reshape(-1, 6)
    force = np.vstack([loads, tractions])
    gained = solve_cubic(problem, force, quadratic, 1e-10)
    cubic = work(problem.apply, force, gained)
    scale = np.sqrt(np.outer(lower.diagonal(), lower.diagonal()))
    approximate = Solver(
        solver.solve, partial(solver.solve)
    )  # so taken, and nothing is eliminated
    other = cubic_problem(mesh, space, supports, approximate, assemble(mesh, STEEL))
    assert other.eliminated is None
    assert problem.eliminated is not None
    gain = np.abs((cubic - lower) / scale).max()
    left = work(other.apply, force, solve_cubic(other, force, quadratic, 1e-6)) - cubic
    assert (
        np.abs(left / scale).max() < 1e-3 * gain
    )  # quadratures of curved elements of other order
    assert np.linalg.eigvalsh((cubic - lower) / scale).min() > -1e-9
    assert gain < 0.05
    gained[: len(loads)] -= quadratic
    energy = gained.T @ problem.apply(gained)
    assert (
        np.abs((energy - (cubic - lower)) / scale).max() < 1e-4 * gain
    )  # sqrt(tolerance), and a reserve
    energies = element_energies(problem, gained)
    whole = weigh_energies(problem, gained, np.ones(len(mesh.cells)))
    assert energies.sum(axis=0) == pytest.approx(whole.diagonal(), rel=1e-9)
    assert np.abs((whole - gained.T @ other.apply(gained)) / scale).max() < 1e-9 * gain
    quick = work(problem.apply, force, solve_cubic(problem, force, quadratic))
    assert (
        np.abs((quick - cubic) / scale).max()
        < 0.02 * np.abs((cubic - lower) / scale).max()
    )


@pytest.mark.extended_for("0.49-distributed")
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("poisson", [pytest.param(0.3, marks=pytest.mark.long), 0.49])
def test_multigrid_agrees_with_a_factorization(stub, kind, poisson, caplog):
    specimen, mesh = stub
    elasticity = isotropic(2e11, 2e11 / (2 + 2 * poisson))
    *_, loads, motion = respond(specimen, mesh, kind, elasticity=elasticity)
    *_, other = respond(specimen, mesh, kind, "multigrid", elasticity)
    expected = loads.T @ motion
    scale = np.sqrt(np.outer(expected.diagonal(), expected.diagonal()))
    assert (
        np.abs((loads.T @ other - expected) / scale).max() < 1e-5
    )  # first order in the error of the motion
    assert not caplog.records


def test_one_eigenvalue_far_above_the_others_is_seen():
    """So nearly flat elements have them; conjugate gradients then failed on what power steps had made of it."""
    spectrum = np.append(np.linspace(0, 2.6, 70_000), 3.6)
    seen = largest_eigenvalue(
        lambda motion: (spectrum * motion)[:, None], len(spectrum)
    )
    assert seen == pytest.approx(3.6, rel=0.01)


def test_interfaces_that_overlap_are_refused(stub):
    specimen, mesh = stub
    coupling = Coupling(LOADED, specimen.loaded[0][1], "rigid")
    with pytest.raises(InputError, match="rigid face"):
        support(mesh, mesh.nodes_of(CLAMPED), (coupling, coupling))


def test_an_unknown_solver_is_refused(stub):
    with pytest.raises(
        InputError, match="solver: expected auto, direct or multigrid, got 'splu'"
    ):
        respond(*stub, solver="splu")
