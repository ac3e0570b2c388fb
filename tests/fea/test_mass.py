"""Mass properties, natural frequencies, own weight and the condensed model, by the laws of mechanics."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.sparse import eye_array, kron
from scipy.sparse.linalg import LinearOperator, eigsh

import stiffscope.fea.dynamics
import stiffscope.fea.solvers
import stiffscope.fea.spaces
from stiffscope.cad.cross_sections import rectangle
from stiffscope.errors import InputError
from stiffscope.fea.beam import timoshenko
from stiffscope.fea.dynamics import compute_dynamics, vibration_of
from stiffscope.fea.experiment import load_experiment
from stiffscope.fea.export import free_superelement
from stiffscope.fea.mass import Mass, rigid_mass, times
from stiffscope.fea.modes import count_whole, lowest_modes, ritz
from stiffscope.fea.rigid import rigid_twists
from stiffscope.fea.run import run_experiment
from stiffscope.fea.settings import Settings
from stiffscope.fea.solution import respond, solve_specimen
from stiffscope.fea.solvers import factorize_matrix
from stiffscope.fea.spaces import ElementTetCubic, cell_bases
from tests.fea.shapes import DENSITY, box, cylinder, isotropic

pytestmark = pytest.mark.slow

E_MODULUS = 211e9
NO_CONTRACTION = isotropic(
    E_MODULUS, E_MODULUS / 2
)  # Poisson's ratio 0: the clamp restrains nothing


def motions(experiment):
    """(6(1+n)+k, 6) a rigid body's unit twists at the clamp, on the coordinates of the condensed model."""
    points = np.vstack([experiment.clamp_point, experiment.reference_points])
    rest = np.zeros((len(experiment.mode_squares), 6))
    return np.vstack([rigid_twists(points, experiment.clamp_point), rest])


def clamped_frequencies(experiment, modes=None):
    """(6,) Hz of the condensed model without its first node, with the first few of its modes."""
    found = free_superelement(experiment)
    end = None if modes is None else 12 + modes
    squares = eigh(
        found.stiffness[6:end, 6:end], found.mass[6:end, 6:end], eigvals_only=True
    )
    return np.sqrt(squares[:6]) / (2 * np.pi)


def levels_of(stub, kind="rigid", solver="direct"):
    return solve_specimen(*stub, kind, solver)


def test_mass_properties_of_a_box_are_exact_and_those_of_a_bar_the_cylinders(
    plate, link
):
    for (
        experiment,
        moments,
        near,
    ) in (  # the bar's curved sides lose 2e-6 of its volume, on one mesh of many 3e-5
        (plate, (0.32**2 + 0.02**2, 0.085**2 + 0.02**2, 0.085**2 + 0.32**2), 1e-6),
        (link, (6 * 0.0125**2, 3 * 0.0125**2 + 0.5**2, 3 * 0.0125**2 + 0.5**2), 1e-4),
    ):
        mass = DENSITY * experiment.cad_volume
        assert experiment.mass == pytest.approx(mass, rel=near)
        assert experiment.centre == pytest.approx(
            experiment.reference_point / 2, abs=max(0.5 * near, 1e-6)
        )
        assert np.diag(experiment.inertia) == pytest.approx(
            mass / 12 * np.array(moments), rel=4 * near
        )


def test_rigid_motion_of_the_condensed_model_has_the_parts_mass_exactly(plate, link):
    for experiment in (plate, link):
        found = motions(experiment).T @ experiment.condensed_mass @ motions(experiment)
        x, y, z = experiment.centre - experiment.clamp_point
        turned = experiment.mass * np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        expected = np.block(
            [[experiment.mass * np.eye(3), -turned], [turned, experiment.inertia]]
        )
        expected[3:, 3:] -= turned @ turned / experiment.mass
        assert np.abs(found - expected).max() < 1e-10 * np.abs(expected).max()


def test_the_cubic_functions_mass_is_that_of_their_moments(stub):
    """∫ρ N_c dV = M 1, and ∫ρ x N_c dV = M x, since the quadratic functions hold 1 and x."""
    _, mesh = stub
    cubics = Mass(mesh, DENSITY).cubics
    expected = 0
    fields = np.hstack([np.ones((len(mesh.points), 1)), mesh.points])
    for basis in cell_bases(mesh, ElementTetCubic(), 5, 8):
        values = np.stack([np.asarray(field[0]) for field in basis.basis])  # (10, m, q)
        at = np.stack(
            [np.ones(values.shape[1:]), *np.asarray(basis.global_coordinates())]
        )
        local = DENSITY * np.einsum("amq,fmq,mq->amf", values, at, basis.dx)
        total = np.zeros((basis.N, 4))
        np.add.at(total, basis.element_dofs, local)
        expected = expected + total
    assert np.abs(cubics @ fields - expected).max() < 1e-9 * np.abs(expected).max()


@pytest.mark.extended
@pytest.mark.parametrize("interface", ["rigid", "distributed"])
def test_modes_are_lanczoss(stub, interface):
    """Clamped, and of the rigid interface held besides: nodes that do not move; ARPACK on the assembled matrices."""
    levels = levels_of(stub, interface)
    system = levels.system
    mass = Mass(stub[1], DENSITY)
    vibration = vibration_of(levels)
    start = np.random.default_rng(2).normal(size=(len(vibration.loads), 12))
    precondition = system.solver.precondition
    squares, modes, _ = lowest_modes(
        vibration.stiffness, vibration.inertia, precondition, start, 6, 1e-10
    )
    assert modes.T @ vibration.inertia(modes) == pytest.approx(np.eye(12), abs=1e-8)
    fixed, motion, _ = vibration.fixed_modes(vibration.precondition(start), 6, 1e-9)
    twists = vibration.loads.T @ motion
    assert (
        np.abs(twists).max()
        < 1e-9 * np.abs(vibration.loads).max() * np.abs(motion).max()
    )
    force = vibration.stiffness(motion) - vibration.inertia(motion) * fixed
    force -= vibration.loads @ (
        vibration.constraint.T @ force
    )  # but for the reactions of the interface
    assert np.abs(force)[:, :6].max() < 1e-3 * np.abs(vibration.stiffness(motion)).max()
    free = system.supports.free_dofs
    inertia = kron(mass.nodes, eye_array(3), format="csr")
    matrices = [matrix[free][:, free].tocsc() for matrix in (system.stiffness, inertia)]
    inverse = LinearOperator(matrices[0].shape, factorize_matrix(matrices[0]))
    lanczos = eigsh(
        matrices[0], 6, matrices[1], sigma=0, OPinv=inverse, return_eigenvectors=False
    )
    found = fixed if interface == "rigid" else squares
    assert found[:6] == pytest.approx(np.sort(lanczos), rel=1e-7)
    assert (fixed[:6] >= squares[:6]).all()


@pytest.mark.extended
def test_a_large_part_is_worked_on_in_portions_with_the_same_result(stub, monkeypatch):
    def results():
        levels = levels_of(stub, solver="multigrid")
        cubics = Mass(levels.system.mesh, DENSITY).cubics
        return (
            cubics.toarray(),
            levels.quadratic,
            levels.cubic,
            compute_dynamics(levels, Settings()).frequencies,
        )

    whole = results()
    monkeypatch.setattr(stiffscope.fea.solvers, "PORTION", 1)
    monkeypatch.setattr(stiffscope.fea.spaces, "CHUNK", 100)
    for all_at_once, one_by_one, near in zip(
        whole, results(), (1e-12, 1e-6, 1e-4, 1e-4), strict=True
    ):
        assert np.abs(one_by_one - all_at_once).max() < near * np.abs(all_at_once).max()


def test_directions_that_depend_on_others_are_left_out(rng):
    vectors = rng.normal(size=(20, 5))
    basis = np.hstack([vectors, vectors @ rng.normal(size=(5, 3))])
    stiffness = np.diag(np.arange(1.0, 21))
    squares, turn = ritz(basis.T @ stiffness @ basis, basis.T @ basis, 8)
    assert squares == pytest.approx(
        eigh(vectors.T @ stiffness @ vectors, vectors.T @ vectors, eigvals_only=True)
    )
    assert (basis @ turn).T @ (basis @ turn) == pytest.approx(np.eye(5), abs=1e-9)


@pytest.mark.extended
def test_a_uniform_bar_rings_as_waves_say():
    """Quarter waves of torsion and of stretch: c / 4L; without contraction a bar's stretch is that of its fibres."""
    length = 0.1
    found = run_experiment(
        cylinder(length, 0.0125, NO_CONTRACTION),
        Settings(size=0.01, interface="distributed"),
    )
    twist, stretch = np.sqrt(np.array([E_MODULUS / 2, E_MODULUS]) / DENSITY) / (
        4 * length
    )
    for exact in (twist, stretch):
        near = np.abs(found.frequencies - exact).argmin()
        assert (
            abs(found.frequencies[near] - exact)
            < found.frequency_error[near] + 1e-5 * exact
        )
        assert found.frequencies[near] == pytest.approx(exact, rel=2e-4)
    assert found.frequencies[:2] == pytest.approx(
        found.frequencies[0], rel=1e-3
    )  # bends alike in all directions


def test_frequencies_are_within_a_thousandth_and_their_bounds(plate, link):
    """Against meshes refined until their own bounds were 4e-5 and 3e-4; clamped, the loaded face rigid."""
    for experiment, exact, least in (
        (link, [72.571, 72.571, 450.999, 450.999, 1246.442, 1246.442], 5e-5),
        (plate, [2326.48, 3695.81, 8790.40, 11850.1, 12173.8, 13009.1], 3e-4),
    ):
        off = np.abs(experiment.frequencies / np.array(exact) - 1)
        assert off.max() < 1e-3
        assert (
            off <= experiment.frequency_error / experiment.frequencies + least
        ).all()
        assert (experiment.frequency_error < 3e-3 * experiment.frequencies).all()


@pytest.mark.long
def test_a_needle_rings_as_a_slender_beam():
    """A thousand times as long as thick: products of its stiffness with its modes are nothing but rounding."""
    found = run_experiment(box(0.5, 5e-4, 5e-4), Settings(size=0.01))
    radius = 5e-4 / np.sqrt(12)
    exact = (
        np.array([1.8751041, 4.6940911]) ** 2
        / (2 * np.pi * 0.5**2)
        * np.sqrt(E_MODULUS / DENSITY)
        * radius
    )
    off = np.abs(found.frequencies[:4] / np.repeat(exact, 2) - 1)
    assert (off <= (found.frequency_error / found.frequencies)[:4] + 1e-4).all()
    assert off.max() < 2e-3


@pytest.mark.extended
@pytest.mark.parametrize(
    "part",
    [box(0.1, 0.03, 0.02), pytest.param(cylinder(0.12, 0.01), marks=pytest.mark.long)],
)
def test_modes_between_held_ends_are_within_their_bounds(part):
    """Against a mesh of half the size."""
    coarse, fine = (
        run_experiment(part, Settings(size=size, modes=6)) for size in (0.02, 0.01)
    )
    off = np.abs(coarse.mode_squares - fine.mode_squares)
    assert (off <= coarse.mode_squares_error + fine.mode_squares_error).all()
    assert (coarse.mode_squares_error < 0.02 * coarse.mode_squares).all()


def test_the_condensed_model_has_the_clamped_frequencies(plate, link):
    for experiment in (plate, link):
        assert 10 <= len(experiment.mode_squares) <= 12
        assert clamped_frequencies(experiment) == pytest.approx(
            experiment.frequencies, rel=3e-3
        )
        static = clamped_frequencies(experiment, 0)
        few = clamped_frequencies(experiment, 6)
        assert (
            static >= few * (1 - 1e-9)
        ).all()  # Rayleigh: what is held back stiffens
        assert (few >= clamped_frequencies(experiment) * (1 - 1e-9)).all()
        modes = experiment.condensed_mass[12:, 12:]
        assert modes == pytest.approx(np.eye(len(modes)), abs=1e-10)
        assert (
            np.linalg.eigvalsh(experiment.condensed_mass / experiment.mass) > 0
        ).all()


def test_modes_are_cut_at_a_gap():
    pairs = np.array([1.0, 1.0, 2.0, 3.0, 3.001, 7.0, 7.0, 7.0, 7.001, 9.0])
    assert [count_whole(pairs, k) for k in range(7)] == [0, 2, 2, 3, 5, 5, 9]
    dense = np.array([1.0, 1.001, 1.002, 1.005, 1.006, 1.007])
    assert count_whole(dense, 1) == 3


@pytest.fixture(scope="module")
def cantilever():
    return run_experiment(box(0.5, 0.02, 0.03, NO_CONTRACTION), Settings(size=0.015))


def test_a_cantilever_sags_under_its_own_weight_as_the_textbook_says(cantilever):
    """w L⁴ / 8EI + w L² / 2κGA across, w L² / 2EA along, w L³ / 6EI of slope."""
    length = 0.5
    section = rectangle(0.02, 0.03, 0.0)
    shear = E_MODULUS / 2
    weight = DENSITY * section.area
    expected = np.zeros((3, 6))
    expected[0, 0] = weight * length**2 / (2 * E_MODULUS * section.area)
    for axis, second, turn, sign in (
        (1, section.bending_z, 5, 1),
        (2, section.bending_y, 4, -1),
    ):
        bending = weight * length**4 / (8 * E_MODULUS * second)
        expected[axis, axis] = bending + weight * length**2 / (
            2 * section.shear_y * shear * section.area
        )
        expected[axis, turn] = sign * weight * length**3 / (6 * E_MODULUS * second)
    scale = np.abs(expected).max(axis=0, keepdims=True) + 1e-30
    large = expected != 0
    assert cantilever.self_weight[large] == pytest.approx(expected[large], rel=2e-3)
    assert (
        np.abs(cantilever.self_weight) <= 1e-3 * scale + cantilever.self_weight_error
    )[~large].all()
    assert (cantilever.self_weight_error[large] < 2e-3 * np.abs(expected[large])).all()


def test_the_condensed_weight_bends_the_part_as_its_body_force_does(
    cantilever, plate, link
):
    """Rigid translations are combinations of the constraint modes, so Guyan's load is the body force's."""
    for experiment in (cantilever, plate, link):
        load = (experiment.condensed_mass @ motions(experiment)[:, :3])[6:12]
        found = (experiment.compliance @ load).T
        lever = np.sqrt(experiment.compliance.diagonal())
        large = (
            np.abs(experiment.self_weight)
            > 1e-2 * lever * (np.abs(experiment.self_weight) / lever).max()
        )
        assert found[large] == pytest.approx(experiment.self_weight[large], rel=1e-3)


def test_a_beams_weight_by_reciprocity_is_its_deflection_line(cantilever):
    """C_ij of the tip's unit force along the beam, ∫ w (x² / 6EI)(3L - x) dx, as beam theory adds it up."""
    section = rectangle(0.02, 0.03, 0.0)
    beam = timoshenko(0.5, section, E_MODULUS, E_MODULUS / 2)
    ratio = cantilever.self_weight[2, 2] / (DENSITY * section.area * 0.5 * beam[2, 2])
    assert ratio == pytest.approx(
        3 / 8, rel=5e-3
    )  # three eighths of the weight at the tip


@pytest.mark.extended
@pytest.mark.parametrize(
    "settings",
    [
        {"interface": "distributed"},
        {"solver": "multigrid", "modes": 0},
        pytest.param({"foundation": 1e12}, marks=pytest.mark.long),
    ],
)
def test_whatever_holds_the_part_its_mass_is_the_same(settings):
    specimen = box(0.1, 0.03, 0.02)
    if "interface" in settings:
        side = frozenset({5}), np.array([0.05, 0.0, 0.01])
        specimen = replace(specimen, loaded=(*specimen.loaded, side))
    found = run_experiment(specimen, Settings(size=0.02, **settings))
    both = motions(found).T @ found.condensed_mass @ motions(found)
    assert both[:3, :3] == pytest.approx(found.mass * np.eye(3), abs=1e-10)
    assert found.mass == pytest.approx(DENSITY * specimen.volume, rel=1e-6)
    assert len(found.condensed_mass) == 6 * (1 + len(specimen.loaded)) + len(
        found.mode_squares
    )
    assert (np.diff(found.frequencies) > 0).all()
    assert (found.frequency_error < 0.03 * found.frequencies).all()


@pytest.mark.extended
def test_the_number_of_modes_is_chosen_directly_or_by_a_frequency(stub, monkeypatch):
    monkeypatch.setattr(stiffscope.fea.dynamics, "MOST_MODES", 16)
    levels = levels_of(stub)
    some = compute_dynamics(levels, Settings(modes=14)).mode_squares
    assert 14 <= len(some) <= 15  # at least as many: the round link's pairs stay whole
    limit = np.sqrt(some[9] * some[8]) ** 0.5 / (2 * np.pi)
    assert (
        len(compute_dynamics(levels, Settings(highest_frequency=limit)).mode_squares)
        == 9
    )
    assert (
        len(compute_dynamics(levels, Settings(highest_frequency=1.0)).mode_squares) == 0
    )
    with pytest.raises(
        InputError,
        match=r"mesh.highest_frequency: expected at most 16 modes below it, that is less",
    ):
        compute_dynamics(levels, Settings(highest_frequency=1e9))


@pytest.mark.parametrize(
    "wrong",
    [
        {"modes": -1},
        {"modes": 1000},
        {"highest_frequency": 0.0},
        {"highest_frequency": 1.0, "modes": 3},
    ],
)
def test_settings_refuse_modes_that_cannot_be(wrong):
    with pytest.raises(InputError, match=next(iter(wrong))):
        Settings(**wrong)


def test_the_mass_is_saved_and_files_without_it_are_refused(plate, tmp_path):
    plate.save(tmp_path / "plate.npz")
    again = load_experiment(tmp_path / "plate.npz")
    assert np.array_equal(again.condensed_mass, plate.condensed_mass)
    assert again.mass == plate.mass
    with np.load(tmp_path / "plate.npz") as held:
        data = {name: held[name] for name in held.files if name != "condensed_mass"}
    np.savez(tmp_path / "old.npz", **data)
    with pytest.raises(InputError, match="not an experiment of this version"):
        load_experiment(tmp_path / "old.npz")


def test_the_mass_of_turned_axes_is_turned(stub, rng):
    _, mesh = stub
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    mass = Mass(mesh, DENSITY).nodes
    here = rigid_mass(mesh.points, mass)
    there = rigid_mass(mesh.points @ turn.T + 0.3, mass)
    assert there.centre == pytest.approx(turn @ here.centre + 0.3)
    assert there.inertia == pytest.approx(turn @ here.inertia @ turn.T, abs=1e-12)
    constant = np.tile(np.eye(3), (len(mesh.points), 1))
    assert constant.T @ times(mass, constant) == pytest.approx(here.mass * np.eye(3))


def test_loads_that_depend_on_those_solved_before(stub):
    """A long part's own weight is almost a force on its end: not a sign of a broken mesh."""
    specimen, mesh = stub
    levels = solve_specimen(specimen, mesh, "rigid", "direct")
    split = len(levels.quadratic)
    again = levels.force @ np.linspace(-1.0, 1.0, 30).reshape(6, 5)
    both = respond(
        levels.system, again, levels.system.solver.solve(again[:split]), levels
    )
    assert both.cubic.shape == (11, 11)
    assert both.cubic[6:, 6:] == pytest.approx(
        again.T @ levels.motion @ np.linspace(-1.0, 1.0, 30).reshape(6, 5), rel=1e-4
    )
