"""Superelements of files as parts of robots: what was written is what is read."""

import numpy as np
import pytest
from scipy.io import mmwrite

from stiffscope.errors import InputError
from stiffscope.fea.export import Superelement, node_lines, write_matrices
from stiffscope.robot.mechanism_of import mechanism_of
from stiffscope.robot.part_matrices import part_matrices
from stiffscope.robot.reader import read_robot
from stiffscope.vjm.model.screws import shift
from stiffscope.vjm.statics.analysis import sag, stiffness
from stiffscope.vjm.vibration.modes import frequencies

NODES = {
    "foot": [0.0, 0.0, 0.0],
    "left arm": [0.1, 0.05, 0.02],
    "motor": [0.12, -0.04, 0.123456789012345],
}
TEXT = """
[parts.frame]
shape = "matrix"
FILE
[bodies.frame]
part = "frame"
[joints.foot]
between = ["ground", "frame.foot"]
type = "fixed"
at = [0, 0, 0]
[joints.motor]
between = ["frame.motor", "arm"]
type = "revolute"
at = [0.12, -0.04, 0.123456789012345]
axis = [1, 0, 0]
drive = { stiffness = "24 kN*m/rad" }
[bodies.arm]
mass = "1 kg"
centre = [0.12, -0.04, 0.123456789012345]
[tool]
body = "frame.left arm"
at = [0.1, 0.05, 0.02]
pose = ["rx"]
[gravity]
direction = [0, 0, -1]
"""


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """A random superelement of three interfaces and two modes, in all forms."""
    rng = np.random.default_rng(3)
    places = np.array(list(NODES.values()))
    relative = np.zeros((12, 18))
    for k in (1, 2):
        relative[6 * k - 6 : 6 * k, 6 * k : 6 * k + 6] = np.eye(6)
        relative[6 * k - 6 : 6 * k, :6] = -shift(places[k])
    half = rng.normal(size=(12, 12)) * np.tile([1e4] * 3 + [1e3] * 3, 2)
    k = np.zeros((20, 20))
    m = rng.normal(size=(20, 20)) * 0.1
    k[:18, :18] = relative.T @ (half.T @ half + 1e6 * np.eye(12)) @ relative
    k[18:, 18:] = np.diag([4e6, 9e6])
    m = m @ m.T + np.diag([1.0] * 18 + [0.5] * 2)
    k = 0.5 * (k + k.T)
    path = tmp_path_factory.mktemp("superelement")
    text = f"A frame.\nNodes, x y z in m:\n{node_lines(places, list(NODES))}"
    write_matrices(
        Superelement(k, m, places),
        path / "frame",
        text,
        mode_squares=np.array([4e6, 9e6]),
    )
    return path, k, m


def plain_lines(k):
    places = ", ".join(f'"{name}" = {list(place)}' for name, place in NODES.items())
    return f"interfaces = {{ {places} }}\nstiffness = {k[:18, :18].tolist()}\n"


def robot_of(path, line):
    return read_robot(path / "robot.toml", TEXT.replace("FILE", line))


@pytest.mark.parametrize(
    ("file", "exact"),
    [("frame.npz", 1e-15), ("frame.stiffness.mtx", 1e-12), ("frame.bdf", 1e-9)],
)
def test_what_is_written_is_read(written, file, exact):
    path, k, m = written
    part = robot_of(path, f'file = "{file}"').parts["frame"]
    assert part.interface_names == tuple(NODES)
    assert np.array(list(part.interfaces.values())) == pytest.approx(
        np.array(list(NODES.values())), rel=1e-8
    )
    assert (
        np.abs(np.array(part.stiffness) - k[:18, :18]).max() <= exact * np.abs(k).max()
    )
    assert np.abs(np.array(part.mass_matrix) - m).max() <= exact * np.abs(m).max()
    assert part.mode_squares == pytest.approx((4e6, 9e6), rel=exact)


def test_a_robot_is_the_same_by_any_form(written):
    path, k, m = written
    lines = [
        f"{plain_lines(k)}mass_matrix = {m.tolist()}\nmode_squares = [4e6, 9e6]",
        *(f'file = "{name}"' for name in ("frame.npz", "frame.stiffness.mtx")),
    ]
    answers = []
    for line in lines:
        robot = robot_of(path, line)
        mechanism = mechanism_of(robot, part_matrices(robot))
        answers.append(
            (
                stiffness(mechanism, [[0.0]]),
                sag(mechanism, [[0.0]]),
                frequencies(mechanism, [[0.0]], 4),
            )
        )
    for other in answers[1:]:
        for one, same in zip(answers[0], other, strict=True):
            assert same == pytest.approx(one, rel=1e-7, abs=1e-9 * np.abs(one).max())


@pytest.mark.parametrize("squares", [[4e6, -9e6], [4e6, 9e6, 1e7], [4e6]])
def test_each_mode_has_a_square_above_zero(written, squares):
    path, k, m = written
    with pytest.raises(
        InputError,
        match=r"parts.frame.mode_squares: expected 2 above 0, for the mass matrix's rows",
    ):
        robot_of(
            path,
            f"{plain_lines(k)}mass_matrix = {m.tolist()}\nmode_squares = {squares}",
        )
    with pytest.raises(
        InputError, match=r"parts.frame.mode_squares: expected 0 above 0"
    ):
        robot_of(path, f"{plain_lines(k)}mode_squares = {squares}")


def test_an_npz_file_has_a_name_for_each_node(written, tmp_path):
    held = dict(np.load(written[0] / "frame.npz"))
    np.savez(tmp_path / "two.npz", **(held | {"nodes": held["nodes"][:2]}))
    with pytest.raises(
        InputError,
        match=r"parts.frame.file: expected 3 nodes, as its help names, got 2",
    ):
        robot_of(tmp_path, 'file = "two.npz"')
    with pytest.raises(
        InputError,
        match=r"parts\.frame\.interfaces: expected 3, as the file has nodes, got 1",
    ):
        robot_of(written[0], 'file = "frame.npz"\ninterfaces = { foot = [0, 0, 0] }')
    np.savez(
        tmp_path / "weightless.npz",
        **{name: each for name, each in held.items() if name != "mass"},
    )
    with pytest.raises(
        InputError,
        match=r"parts\.frame\.file: expected a mass matrix beside \d+ modes, got stiffness",
    ):
        robot_of(tmp_path, 'file = "weightless.npz"')


def test_others_need_names(written, tmp_path):
    _, k, _ = written
    mmwrite(tmp_path / "k.mtx", k[:18, :18], symmetry="symmetric", precision=15)
    with pytest.raises(
        InputError,
        match=r"robot.toml:4: parts.frame.file: expected interfaces beside a file",
    ):
        robot_of(tmp_path, 'file = "k.mtx"')
    places = ", ".join(f'"{name}" = {place}' for name, place in NODES.items())
    part = robot_of(
        tmp_path, f'file = "k.mtx"\ninterfaces = {{ {places} }}\nmass = "2 kg"'
    ).parts["frame"]
    assert (
        np.abs(np.array(part.stiffness) - k[:18, :18]).max() < 1e-12 * np.abs(k).max()
    )


@pytest.mark.parametrize(
    ("line", "message"),
    [
        (
            'file = "none.npz"',
            "parts.frame.file: expected a file of a superelement, got none",
        ),
        ('file = "robot.txt"', "parts.frame.file: expected a file of a superelement"),
        (
            'file = "frame.npz"\nstiffness = [[1.0]]',
            "parts.frame.stiffness: expected none beside a file",
        ),
    ],
)
def test_what_is_no_superelement_is_refused(written, line, message):
    (written[0] / "robot.txt").write_text("nothing")
    with pytest.raises(InputError, match=message):
        robot_of(written[0], line)
