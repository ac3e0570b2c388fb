import numpy as np
import pytest

from stiffscope.errors import InputError
from stiffscope.fea.cubic import cubic_compliance, cubic_values, element_energies, enlarge
from stiffscope.fea.elasticity import assemble, isotropic, strains
from stiffscope.fea.interfaces import KINDS, Port, rigid_modes, support, unit_loads
from stiffscope.fea.multigrid import largest_eigenvalue, prepare
from stiffscope.fea.shape import NODES, quadrature, shape_values, volume
from tests.fea.shapes import CLAMPED, LOADED, STEEL


def respond(specimen, mesh, kind="rigid", solver="direct", elasticity=STEEL):
    ports = (Port(mesh.facets_of(LOADED), specimen.loaded[0][1], kind),)
    supports = support(mesh, mesh.nodes_of(CLAMPED), ports)
    stiffness = assemble(mesh, elasticity)
    prepared = prepare(mesh, stiffness, supports, solver)
    loads = unit_loads(mesh.points, supports, ports)
    return supports, ports, prepared, loads, prepared.solve(loads)


def test_assembly_is_scikit_fems(stub):
    from skfem import Basis, ElementTetP2, ElementVector, MeshTet2
    from skfem.models.elasticity import lame_parameters, linear_elasticity

    _, mesh = stub
    young, poisson = 211e9, 211 / 162 - 1
    theirs = MeshTet2(mesh.points.T, mesh.cells.T)
    basis = Basis(theirs, ElementVector(ElementTetP2()), intorder=4)
    matrix = linear_elasticity(*lame_parameters(young, poisson)).assemble(basis)
    ours = assemble(mesh, STEEL)
    assert np.sort(matrix.diagonal()) == pytest.approx(np.sort(ours.diagonal()), rel=1e-3)
    assert matrix.diagonal().sum() == pytest.approx(ours.diagonal().sum(), rel=1e-4)


def test_rigid_motion_costs_nothing_and_constant_strain_is_exact(stub, rng):
    _, mesh = stub
    root = rng.normal(size=(6, 6))
    elasticity = 1e11 * (root @ root.T + 6 * np.eye(6))  # fully anisotropic
    stiffness = assemble(mesh, elasticity)
    modes = rigid_modes(mesh.points, np.zeros(3)).reshape(-1, 6)
    assert np.abs(stiffness @ modes).max() < 1e-8 * np.abs(stiffness.data).max() * np.abs(modes).max()
    gradient = rng.normal(size=(3, 3))
    motion = (mesh.points @ gradient.T).reshape(-1)
    e = (gradient + gradient.T) / 2
    strain = np.array([e[0, 0], e[1, 1], e[2, 2], 2 * e[1, 2], 2 * e[0, 2], 2 * e[0, 1]])
    energy = strain @ elasticity @ strain * volume(mesh.points, mesh.cells)
    assert motion @ (stiffness @ motion) == pytest.approx(energy, rel=1e-6)
    local = motion.reshape(-1, 3, 1)[mesh.cells[:5]]
    assert strains(mesh.points[mesh.cells[:5]], local, NODES)[..., 0, :] == pytest.approx(
        np.broadcast_to(strain, (5, 10, 6)), abs=1e-9
    )


def test_cubic_gradients_are_derivatives():
    at, step = quadrature(4)[0], 1e-6
    _, slopes = cubic_values(at)
    for k in range(3):
        shift = step * np.eye(3)[k]
        numeric = (cubic_values(at + shift)[0] - cubic_values(at - shift)[0]) / (2 * step)
        assert slopes[:, :, k] == pytest.approx(numeric, abs=1e-8)
    assert cubic_values(NODES)[0] == pytest.approx(0, abs=1e-15)
    assert shape_values(NODES)[0] == pytest.approx(np.eye(10), abs=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_the_cubic_solution_is_softer_in_every_direction(stub, kind):
    specimen, mesh = stub
    supports, ports, solver, loads, quadratic = respond(specimen, mesh, kind)
    lower = loads.T @ quadratic
    space = enlarge(mesh, STEEL)
    cubic, gained = cubic_compliance(mesh, space, supports, ports, solver, loads, quadratic, 1e-6)
    scale = np.sqrt(np.outer(lower.diagonal(), lower.diagonal()))
    assert np.linalg.eigvalsh((cubic - lower) / scale).min() > -1e-9
    assert np.abs((cubic - lower) / scale).max() < 0.05
    gained[: len(loads)] -= quadratic
    energies, whole = element_energies(mesh, space, supports, gained, np.ones(len(mesh.cells)))
    assert energies.sum(axis=0) == pytest.approx(whole.diagonal(), rel=1e-9)
    assert np.abs((whole - (cubic - lower)) / scale).max() < 1e-3 * np.abs((cubic - lower) / scale).max()
    quick, _ = cubic_compliance(mesh, space, supports, ports, solver, loads, quadratic)
    assert np.abs((quick - cubic) / scale).max() < 0.02 * np.abs((cubic - lower) / scale).max()


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("poisson", [0.3, 0.49])
def test_multigrid_agrees_with_a_factorization(stub, kind, poisson, caplog):
    specimen, mesh = stub
    elasticity = isotropic(2e11, 2e11 / (2 + 2 * poisson))
    *_, loads, motion = respond(specimen, mesh, kind, elasticity=elasticity)
    *_, other = respond(specimen, mesh, kind, "multigrid", elasticity)
    expected = loads.T @ motion
    scale = np.sqrt(np.outer(expected.diagonal(), expected.diagonal()))
    assert np.abs((loads.T @ other - expected) / scale).max() < 1e-5  # first order in the error of the motion
    assert not caplog.records


def test_one_eigenvalue_far_above_the_others_is_seen():
    """So nearly flat elements have them; conjugate gradients then failed on what power steps had made of it."""
    spectrum = np.append(np.linspace(0, 2.6, 70_000), 3.6)
    seen = largest_eigenvalue(lambda motion: (spectrum * motion)[:, None], len(spectrum))
    assert seen == pytest.approx(3.6, rel=0.01)


def test_interfaces_that_overlap_are_refused(stub):
    specimen, mesh = stub
    port = Port(mesh.facets_of(LOADED), specimen.loaded[0][1], "rigid")
    with pytest.raises(InputError, match="rigid face"):
        support(mesh, mesh.nodes_of(CLAMPED), (port, port))
