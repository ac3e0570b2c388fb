"""A bracket with three interfaces: one unsupported stiffness on all of them, whichever is at rest."""

import numpy as np
import pytest
from build123d import Box, Cylinder, Pos

from stiffscope.cad.faces import FaceSelector
from stiffscope.cad.solid import part_of
from stiffscope.errors import InputError
from stiffscope.fea.experiment import load_experiment
from stiffscope.fea.rigid import rigid_twists
from stiffscope.fea.run import run_experiment
from stiffscope.fea.settings import Settings

pytestmark = pytest.mark.slow

PADS = {"left": (-25, -15), "right": (-25, 15), "motor": (25, 0)}


def bracket(*order):
    """A plate with three pads of 8 mm radius, its interfaces in an order: the first is at rest."""
    solid = Box(80, 60, 10)
    for x, y in PADS.values():
        solid += Pos(x, y, 7) * Cylinder(8, 4)
    tops = {
        name: [FaceSelector(position=(x / 1e3, y / 1e3, 0.009))]
        for name, (x, y) in PADS.items()
    }
    return part_of(
        solid, name="bracket", interfaces={name: tops[name] for name in order}
    )


@pytest.fixture(scope="module", params=["rigid", "distributed"])
def tested(request):
    return run_experiment(bracket(*PADS), Settings(interface=request.param))


def ordered(experiment, names=tuple(PADS)):
    """Stiffness, bounds and mass with the interfaces in another order."""
    rows = np.concatenate(
        [6 * experiment.interfaces.index(name) + np.arange(6) for name in names]
    )
    each = experiment.stiffness, experiment.stiffness_error, experiment.mass_matrix
    return [matrix[np.ix_(rows, rows)] for matrix in each]


@pytest.mark.extended
def test_the_stiffness_is_symmetric_semidefinite_and_free_of_rigid_motions(tested):
    rigid = rigid_twists(tested.places, tested.places[0])
    scale = np.sqrt(tested.stiffness.diagonal())
    assert tested.interfaces == tuple(PADS)
    assert np.array_equal(tested.stiffness, tested.stiffness.T)
    assert (
        np.abs(tested.stiffness @ rigid / scale[:, None]).max()
        < 1e-9 * np.abs(scale[:, None] * rigid).max()
    )
    free = np.linalg.eigvalsh(tested.stiffness / np.outer(scale, scale))
    assert np.abs(free[:6]).max() < 1e-9 < free[6]
    assert (rigid.T @ tested.mass_matrix @ rigid)[:3, :3] == pytest.approx(
        tested.mass * np.eye(3), abs=1e-9
    )


@pytest.mark.extended
def test_any_interface_may_be_at_rest():
    """All rigid: the same body, another factorization on another mesh."""
    one, other = (
        run_experiment(bracket(*order), whole=False)
        for order in (PADS, ("motor", "right", "left"))
    )
    (k, error, mass) = ordered(one)
    (again, bound, weight) = ordered(other)
    assert np.abs(one.places[[2, 1, 0]] - other.places).max() < 1e-6
    scale = np.sqrt(np.outer(k.diagonal(), k.diagonal()))
    assert (np.abs(k - again) <= error + bound + 1e-4 * scale).all()
    assert (error / scale).max() < 0.02
    assert mass == pytest.approx(weight, abs=2e-3 * np.abs(mass).max())


@pytest.mark.extended_for("distributed", "rigid")
def test_a_blocks_compliance_is_the_two_ended_experiments(tested):
    """The third interface unloaded: of even tractions it is not there at all; a rigid one stiffens its own face."""
    pair = run_experiment(
        bracket("left", "motor"), Settings(interface=tested.interface), whole=False
    )
    block = tested.full_compliance[6:, 6:]
    scale = np.sqrt(np.outer(block.diagonal(), block.diagonal()))
    off = np.abs(block - pair.compliance)
    assert (
        off
        <= tested.full_error[6:, 6:]
        + pair.error
        + (0.01 if tested.interface == "rigid" else 0) * scale
    ).all()
    held = tested.stiffness[12:, 12:] - tested.stiffness[12:, 6:12] @ np.linalg.solve(
        tested.stiffness[6:12, 6:12], tested.stiffness[6:12, 12:]
    )
    assert np.linalg.inv(held) == pytest.approx(block, abs=1e-9 * scale.max())


@pytest.mark.extended
def test_each_interface_has_a_coupling_of_its_own():
    """One pad evenly loaded, the other rigid: between all rigid and all even, each for its own face."""
    tops = {
        name: [FaceSelector(position=(x / 1e3, y / 1e3, 0.009))]
        for name, (x, y) in PADS.items()
    }
    solid = bracket(*PADS).solid
    mixed = part_of(
        solid, name="bracket", interfaces=tops, couplings={"motor": "distributed"}
    )
    found = run_experiment(mixed, Settings(interface="rigid"), whole=False)
    rigid, even = (
        run_experiment(
            bracket(*PADS),
            Settings(interface=kind),
            near=(mixed, found.mesh),
            whole=False,
        )
        for kind in ("rigid", "distributed")
    )
    assert all(
        np.allclose(e.mesh.points, found.mesh.points) for e in (rigid, even)
    )  # the mesher's scatter is left out
    own, stiff, soft = (e.full_compliance.diagonal() for e in (found, rigid, even))
    gap = soft - stiff
    tilt = slice(3, 5)
    even_tilt = slice(9, 11)
    assert (np.abs(own - stiff)[tilt] < 0.4 * gap[tilt]).all()
    assert (np.abs(own - soft)[even_tilt] < 0.4 * gap[even_tilt]).all()


@pytest.mark.extended_for("distributed")
def test_names_and_matrices_are_kept(tested, tmp_path):
    tested.save(tmp_path / "bracket.npz")
    again = load_experiment(tmp_path / "bracket.npz", fields=False)
    assert again.interfaces == tested.interfaces
    assert np.array_equal(again.stiffness, tested.stiffness)
    assert np.array_equal(again.stiffness_error, tested.stiffness_error)
    assert len(again.displacement) == 0


def test_one_interface_is_not_enough():
    with pytest.raises(
        InputError, match=r"bracket\.interfaces: expected two or more, got \['left'\]"
    ):
        bracket("left")
