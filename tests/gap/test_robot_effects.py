"""Mechanical effects: what each changes, whatever its parameters."""

import numpy as np
import pytest

from stiffscope.gap.effects.effect import Setting
from stiffscope.gap.effects.vocabulary import apply_effect, find_candidates
from stiffscope.robot.mechanism_of import mechanism_of
from stiffscope.robot.nominal import NominalRobot
from stiffscope.robot.part_matrices import part_matrices
from stiffscope.robot.reader import read_robot
from tests.experiments.one_part import MATRIX, ROBOT
from tests.robots import nominal_robot


def test_a_part_with_any_entries_stays_positive_definite():
    """Laws of C = L phi(E) L': no change at zero, the entries round trip, and no parameters make energy."""
    robot = nominal_robot()
    rng = np.random.default_rng(4)
    matrices = [
        e for e in find_candidates(Setting(robot)) if e.effect == "part-compliance"
    ]
    assert {len(e.names) for e in matrices} == {8, 21}
    for effect in matrices:
        here = robot.compliances[effect.members[0]]
        assert not effect.action.changes(np.zeros(len(effect.names)))[
            effect.members[0]
        ].compliance.any()
        for size in (0.1, 3.0, 30.0):
            values = size * rng.standard_normal(len(effect.names))
            added = effect.action.changes(values)[effect.members[0]].compliance
            root = np.sqrt(np.diagonal(here))
            assert np.linalg.eigvalsh((here + added) / np.outer(root, root)).min() > 0.0
            assert effect.internal(effect.physical(values)) == pytest.approx(
                values, rel=1e-5, abs=1e-6 * size
            )


@pytest.mark.parametrize("factor", [0.5, 1.5, 3.0, 50.0])
def test_a_factor_on_a_drive_is_one_on_its_screw_too(tmp_path, factor):
    """The compliance along the slide, of its drive and its screw, is divided by the factor."""
    text = (
        ROBOT.format(part=MATRIX, length=60.0)
        + """
[[joints.slide.bearing]]
kind = "linear-guide"
vertical = "300 N/um"
lateral = "200 N/um"
normal = [0, 0, 1]
rails = 2
rail_spacing = "200 mm"
carriages = 2
carriage_spacing = "150 mm"
[[joints.slide.bearing]]
kind = "ball-screw"
diameter = "20 mm"
length = "600 mm"
nut = "300 N/um"
support = "150 N/um"
"""
    )
    robot = read_robot(tmp_path / "robot.toml", text)
    nominal = NominalRobot(mechanism_of(robot, part_matrices(robot, "beam")), robot)
    along = nominal.compliances["slide"][0, 0]
    assert along > 1.1 / nominal.driven["slide"].drive.stiffness
    changed = apply_effect(nominal, "actuator-stiffness", "slide", {"factor": factor})
    assert changed.compliances["slide"][0, 0] == pytest.approx(along / factor, rel=1e-9)
    rest = [
        np.delete(np.delete(each.compliances["slide"], 0, 0), 0, 1)
        for each in (nominal, changed)
    ]
    assert rest[1] == pytest.approx(rest[0], rel=1e-12)


def test_a_passive_slide_is_a_joint_and_a_guide_by_its_own_name(tmp_path):
    """In the set of all joints, of which it is the only slide, it had the set's name."""
    more = """
[bodies.cap]
[bodies.shoe]
[joints.ram]
between = ["arm.tip", "cap"]
type = "prismatic"
at = [0.06, 0, 0]
axis = [0, 1, 0]
[joints.pin]
between = ["cap", "shoe"]
type = "revolute"
at = [0.06, 0, 0]
axis = [0, 0, 1]
"""
    robot = read_robot(
        tmp_path / "robot.toml", ROBOT.format(part=MATRIX, length=60.0) + more
    )
    nominal = NominalRobot(mechanism_of(robot, part_matrices(robot, "beam")), robot)
    effects = find_candidates(Setting(nominal))
    found = {
        (e.effect, e.place): (e.members, e.names) for e in reversed([*effects])
    }  # of two forms the shorter
    ram = ("ram",)
    assert found["guide-compliance", "ram"] == (ram, ("lateral", "vertical", "angular"))
    assert found["joint-compliance", "ram"] == (ram, ("radial", "tilting"))
    assert found["joint-compliance", "joints"][0] == ("ram", "pin")
    assert ("guide-compliance", "joints") not in found
    assert ("joint-compliance", "slide") not in found  # a drive's slide is a guide
