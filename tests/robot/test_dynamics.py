"""Where the condensed masses of a robot's parts come from, and how they reach its bodies."""

from types import SimpleNamespace

import numpy as np
import pytest

from stiffscope.robot.beam_dynamics import beam_dynamics
from stiffscope.robot.mechanism_of import mechanism_of
from stiffscope.robot.part_matrices import beam_compliance, beam_segments, part_matrices
from stiffscope.robot.reader import load_robot
from stiffscope.vjm.vibration.modes import frequencies

POSE = [[0.03, 0.0, 0.4]]


def test_an_experiment_is_as_good_as_the_beam_that_it_is():
    """Condensed on points off the body's ends, of another density: the same robot as by beam theory."""
    robot = load_robot("biglide")
    steel = robot.material("link")
    dynamics = beam_dynamics(
        beam_segments(robot, "link"),
        steel.youngs_modulus,
        steel.shear_modulus,
        2 * steel.density,
    )
    away = np.array([0.01, 0.02, -0.03])
    experiment = SimpleNamespace(
        condensed_mass=dynamics.move_ends(away, np.zeros(3)).mass,
        mode_squares=dynamics.squares,
        mode_squares_error=None,
        clamp_point=np.array([0.1, 0.2, 0.3]) + away,
        reference_points=np.array([[0.6, 0.2, 0.3]]),
    )
    compliance = beam_compliance(robot, "link")
    results = {
        "link": SimpleNamespace(
            compliance=compliance, error=1e-5 * abs(compliance), experiment=experiment
        )
    }
    components = {"link": "fea", "slider": "beam"}
    tested = mechanism_of(robot, part_matrices(robot, components, results))
    beams = mechanism_of(robot, part_matrices(robot, "beam"))
    assert frequencies(tested, POSE, 8) == pytest.approx(
        frequencies(beams, POSE, 8), rel=1e-9
    )
    assert tested.body("limb1.link1").elastic.dynamics.total == pytest.approx(1.95)


def test_a_part_without_a_mass_or_with_a_published_matrix_has_no_condensed_mass():
    robot = load_robot("biglide")
    assert (
        part_matrices(robot, "beam")["slider"].dynamics is None
    )  # its mass is 0 in the file
    assert part_matrices(robot, "published")["link"].dynamics is None
    given = mechanism_of(robot, part_matrices(robot, "published"))
    assert given.body("limb1.link1").elastic.dynamics is None


@pytest.mark.parametrize("angle", [0.4, 1.1])
def test_a_round_part_may_be_turned_about_its_axis(angle, tmp_path):
    """Modes of a round part come in pairs; half of one would stiffen it in one direction."""
    text = load_robot("serial-arm").source.text
    along = np.deg2rad(70.0)
    side = np.array([-np.sin(along), 0.0, np.cos(along)])
    across = np.cos(angle) * np.array([0.0, 1.0, 0.0]) + np.sin(angle) * side
    ends = 'tip  = ["= x_E", 0, "= z_E"]\n'
    assert ends + "y    = [0, 1, 0]" in text
    turned = tmp_path / "turned.toml"
    turned.write_text(
        text.replace(ends + "y    = [0, 1, 0]", f"{ends}y = {across.tolist()}")
    )
    found = []
    for name in ("serial-arm", turned):
        robot = load_robot(name)
        mechanism = mechanism_of(robot, part_matrices(robot, "beam"))
        found.append(frequencies(mechanism, [mechanism.tool.home], 12))
    assert found[1] == pytest.approx(found[0], rel=1e-9)
