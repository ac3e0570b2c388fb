"""A STEP file's solid with named interfaces, from the robot file to the robot."""

import numpy as np
import pytest
from build123d import Box, Cylinder, Pos, export_step

from stiffscope.errors import InputError
from stiffscope.experiments.assembly import assemble_robots, stiffness_bars
from stiffscope.experiments.orders import build_part
from stiffscope.robot.inspection import inspect_robot
from stiffscope.robot.reader import read_robot
from stiffscope.runtime.workshop import workshop
from stiffscope.vjm.model.screws import shift
from stiffscope.vjm.statics.analysis import sag, stiffness

pytestmark = pytest.mark.slow

PADS = {"left": (-25, -15), "right": (-25, 15), "motor": (25, 0)}
TEXT = """
name = "bracketed"
[parts.bracket]
shape = "step"
file = "bracket.step"
material = "steel"
mesh.tolerance = "5 %"
interfaces.left = { position = ["-25 mm", "-15 mm", "9 mm"] }
interfaces.right = [{ position = ["-25 mm", "15 mm", "9 mm"] }]
interfaces.motor = { position = ["25 mm", 0, "9 mm"] }
[bodies.frame]
part = "bracket"
at = [0, 0, "100 mm"]
y = [0, 1, 0]
[joints.left]
between = ["ground", "frame.left"]
type = "fixed"
at = ["-25 mm", "-15 mm", "109 mm"]
[joints.right]
between = ["ground", "frame.right"]
type = "revolute"
axis = [0, 0, 1]
at = ["-25 mm", "15 mm", "109 mm"]
[joints.motor]
between = ["frame.motor", "arm"]
type = "revolute"
at = ["25 mm", 0, "109 mm"]
axis = [0, 0, 1]
drive = { stiffness = "24 kN*m/rad" }
[bodies.arm]
[tool]
body = "arm"
at = ["25 mm", 0, "150 mm"]
pose = ["rz"]
[gravity]
direction = [0, 0, -1]
[poses]
home = [0]
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("bracket")
    solid = Box(80, 60, 10)
    for x, y in PADS.values():
        solid += Pos(x, y, 7) * Cylinder(8, 4)
    export_step(solid, path / "bracket.step")
    return path


@pytest.mark.extended
def test_every_interface_is_a_node_of_the_robot(folder):
    """Both supports held but for a turn of one: the block of the experiment's stiffness, in series with the drive."""
    robot = read_robot(folder / "robot.toml", TEXT)
    assert robot.ends("frame") == tuple(PADS)
    assert not [line for line in inspect_robot(robot).remarks if "stands" in line]
    with workshop() as shop:
        made = assemble_robots({"robot": robot}, None, shop)["robot"]
    experiment = made.results["bracket"].experiment
    solid = made.results["bracket"].solid
    planes = {
        name: experiment.mesh.nodes_of(frozenset(faces))
        for name, faces in solid["faces"].items()
    }
    middles = {
        name: 1e3 * experiment.mesh.points[nodes].mean(axis=0)
        for name, nodes in planes.items()
    }
    assert middles == {
        name: pytest.approx((*place, 9.0), abs=0.5) for name, place in PADS.items()
    }
    assert experiment.interfaces == tuple(PADS)
    free = np.r_[11, 12:18]  # the right end's rz, then the motor's twist
    held = np.linalg.inv(experiment.stiffness[np.ix_(free, free)])[1:, 1:]
    held[5, 5] += 1 / 24e3
    carry = shift([0.0, 0.0, 0.041])
    expected = np.linalg.inv(carry @ held @ carry.T)
    found = stiffness(made.mechanism, [[0.0]])[0]
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert np.abs((found - expected) / scale).max() < 1e-6
    assert (stiffness_bars(made, [[0.0]]) > 0.0).all()
    assert made.mechanism.body("frame").mass == pytest.approx(experiment.mass, rel=1e-3)
    load = (
        np.concatenate(
            [
                experiment.mass_matrix[6 * k : 6 * k + 6, 2::6].sum(axis=1)
                for k in range(3)
            ]
        )
        * -9.81
    )
    moved = np.linalg.inv(experiment.stiffness[np.ix_(free, free)]) @ load[free]
    assert sag(made.mechanism, [[0.0]])[0, 2] == pytest.approx(
        (shift([0, 0, 0.041]) @ moved[1:])[2], rel=1e-6
    )


REFUSED = {
    (
        "interfaces.motor = {",
        "clamped = [{ index = 0 }]\ninterfaces.motor = {",
    ): "parts.bracket.clamped: expected none",
    (
        '"9 mm"] }\ninterfaces.right',
        '"9 mm"], colour = 3 }\ninterfaces.right',
    ): "parts.bracket.interfaces.left.*colour",
    ("frame.motor", "frame.tip"): "expected a body or an end of one",
    (
        'at = [0, 0, "100 mm"]\ny',
        "base = [0, 0, 0]\ny",
    ): "bodies.frame.base: expected a known key",
}


@pytest.mark.parametrize("change", REFUSED)
def test_what_cannot_be_is_refused_by_line(folder, change):
    assert change[0] in TEXT
    with pytest.raises(InputError, match=REFUSED[change]):
        read_robot(folder / "robot.toml", TEXT.replace(*change, 1))


def test_faces_that_are_not_there_are_refused_by_interface(folder):
    text = TEXT.replace('"15 mm", "9 mm"] }]', '"15 mm", "30 mm"] }]')
    with pytest.raises(
        InputError, match=r"robot.toml:9: parts.bracket.interfaces.right: "
    ):
        build_part(read_robot(folder / "robot.toml", text), "bracket")
