"""Bodies with named interfaces, from the robot file to the mechanism."""

from pathlib import Path

import numpy as np
import pytest

from stiffscope.errors import InputError
from stiffscope.robot.inspection import inspect_robot
from stiffscope.robot.mechanism_of import mechanism_of
from stiffscope.robot.part_matrices import part_matrices
from stiffscope.robot.reader import read_robot
from stiffscope.vjm.model.screws import shift
from stiffscope.vjm.statics.analysis import stiffness
from tests.robot.test_reader import TEXT, line_with

ROD = """[bodies."leg1.rod"]
part = "strut"
base = ["= 0.18 + a*cos(th)", 0, "= z"]
tip = ["50 mm", 0, "-0.5 m"]
y = [0, 1, 0]
"""
START = np.array(
    [0.18 + 0.22 * np.cos(np.radians(25)), 0, -0.22 * np.sin(np.radians(25))]
)
END = np.array([0.05, 0, -0.5])
LENGTH = float(np.linalg.norm(END - START))


def unsupported():
    """Stiffness (12, 12) of the strut's two ends by its 6x6 at the tip."""
    c = np.array(read_robot(Path("a.toml"), TEXT).parts["strut"].matrix)
    relative = np.hstack([-shift([LENGTH, 0, 0]), np.eye(6)])
    return relative.T @ np.linalg.solve(c, relative)


def with_interfaces(stiffness, more=""):
    """The robot whose rods are parts of two interfaces."""
    part = f"""[parts.star]
shape = "matrix"
interfaces = {{ hub = [0, 0, 0], "out 1" = ["{1e3 * LENGTH!r} mm", 0, 0] }}
stiffness = {np.asarray(stiffness).tolist()}
{more or 'mass = "80 g"'}

"""
    body = f"""[bodies."leg1.rod"]
part = "star"
at = {START.tolist()}
x = {(END - START).tolist()}
"""
    assert ROD in TEXT
    text = (
        TEXT.replace(ROD, body)
        .replace("leg1.rod.base", "leg1.rod.hub")
        .replace("leg1.rod.tip", "leg1.rod.out 1")
    )
    return text.replace("[parts.strut]", f"{part}[parts.strut]")


def test_a_part_of_two_interfaces_is_the_rod_that_it_is(tmp_path):
    """With its copies, which turn: the same compliance and weight of the robot."""
    plain, named = (
        read_robot(tmp_path / "a.toml", text)
        for text in (TEXT, with_interfaces(unsupported()))
    )
    assert named.ends("leg2.rod") == ("hub", "out 1")
    k = [
        stiffness(mechanism_of(each, part_matrices(each)), [[0.01, 0.02, -0.5]])
        for each in (plain, named)
    ]
    assert np.abs(k[0]).max() > 1e5
    np.testing.assert_allclose(k[1], k[0], rtol=1e-6, atol=1e-6 * np.abs(k[0]).max())
    assert inspect_robot(named).masses["leg3.rod"] == pytest.approx(0.08)


def test_a_mass_matrix_gives_the_mass(tmp_path):
    mass = np.kron(
        np.array([[2.0, 1.0], [1.0, 2.0]]) / 6.0, np.diag([3, 3, 3, 0.01, 0.01, 0.01])
    )
    robot = read_robot(
        tmp_path / "a.toml",
        with_interfaces(unsupported(), f"mass_matrix = {mass.tolist()}"),
    )
    assert inspect_robot(robot).masses["leg1.rod"] == pytest.approx(3.0)


ELBOW = 'between = ["leg1.arm.tip"'
REFUSED = {
    ("interfaces = { hub = [0, 0, 0], ", "interfaces = { "): (
        r"parts.star.interfaces: expected two or more",
        "interfaces",
    ),
    ("stiffness = [[", "stiffness = [[1.0, "): (
        r"parts.star.stiffness: expected as many rows",
        "stiffness",
    ),
    ("stiffness = [[", "stiffness = [[-"): (
        r"parts.star.stiffness: expected",
        "stiffness",
    ),
    ('part = "star"', 'part = "star"\nbase = [0, 0, 0]'): (
        r'bodies."leg1.rod".base: expected a known key \(part, at, x, y\)',
        "base = [0, 0, 0]",
    ),
    ("leg1.rod.hub", "leg1.rod.base"): (
        r'expected a body or an end of one .*, got "leg1.rod.base"',
        ELBOW,
    ),
    ("leg1.rod.hub", "leg1.rod"): (
        r'expected an end of the elastic body, "leg1.rod.hub" or "leg1.rod.out 1"',
        ELBOW,
    ),
    ('mass = "80 g"', 'mass = "cad"'): (
        r"parts.star.mass: expected a mass such as",
        'mass = "cad"',
    ),
}


@pytest.mark.parametrize("change", REFUSED)
def test_what_is_no_part_with_interfaces_is_refused(tmp_path, change):
    text = with_interfaces(unsupported())
    assert change[0] in text
    message, at = REFUSED[change]
    text = text.replace(*change, 1)
    with pytest.raises(InputError, match=message) as refused:
        read_robot(tmp_path / "a.toml", text)
    assert str(refused.value).startswith(
        f"{tmp_path / 'a.toml'}:{line_with(at, text)}: "
    )
