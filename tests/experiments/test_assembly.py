"""Robots of any parts: their matrices, masses and bounds reach the mechanism, and what does not fit is refused."""

from shutil import copyfile

import numpy as np
import pytest

from stiffscope.design.sensitivity import robot_sensitivity
from stiffscope.errors import InputError
from stiffscope.experiments.assembly import (
    assemble,
    assemble_robots,
    at_named_poses,
    check_reach,
    check_solids,
    deflection_bars,
    stiffness_bars,
    stiffness_json,
)
from stiffscope.robot.reader import load_robot, read_robot
from stiffscope.runtime.workshop import workshop
from stiffscope.vjm.statics.analysis import stiffness
from stiffscope.vjm.statics.yielding import deflection
from tests.experiments.one_part import (
    DEPTH,
    DRIVE,
    LENGTH,
    MATRIX,
    PLATE,
    ROD,
    STEP,
    WIDTH,
    one_part,
    write_bar,
)

pytestmark = pytest.mark.slow

NAME = "bar 1"
DRIVEN = np.diag([1 / DRIVE, 0, 0, 0, 0, 0])


def assembled(robot, components=None):
    with workshop() as shop:
        return assemble_robots({"now": robot}, components, shop)["now"]


@pytest.fixture(scope="module")
def stepped(tmp_path_factory):
    folder = tmp_path_factory.mktemp("stepped")
    write_bar(folder / "bar.step", shift=0.1)  # wherever the file's origin is
    return assembled(one_part(folder, STEP))


@pytest.mark.extended
def test_a_step_file_s_solid_yields_and_weighs(stepped):
    """In series with its drive; its weight acts all along it."""
    part = stepped.matrices[NAME]
    result = stepped.results[NAME]
    assert stepped.sources == {NAME: "step"}
    assert result.facts["axes"].startswith("those of the STEP file")
    assert part.compliance[0, 0] == pytest.approx(
        LENGTH / (211e9 * DEPTH * WIDTH), rel=0.03
    )
    assert part.mass == pytest.approx(
        LENGTH * DEPTH * WIDTH * stepped.robot.material(NAME).density, rel=1e-6
    )
    state = at_named_poses(stepped, stepped.robot.poses)
    compliance = np.linalg.inv(state.matrix[0])
    np.testing.assert_allclose(
        compliance, part.compliance + DRIVEN, rtol=1e-6, atol=1e-12
    )
    hanging = -9.81 * result.experiment.self_weight[2].reshape(2, 3)
    size = np.abs(hanging).max(
        axis=1, keepdims=True
    )  # what is zero by symmetry is so but for the mesh's
    np.testing.assert_allclose(
        state.sag[0].reshape(2, 3) / size, hanging / size, rtol=0, atol=2e-3
    )
    assert set(stiffness_json(state)) == {
        "poses",
        "tool",
        "stiffness",
        "compliance",
        "rigid",
        "sag",
        "mobility",
        "convention",
    }


def test_bounds_of_the_part_are_bounds_of_the_robot(stepped):
    """The part carries the whole wrench: |δK| ≤ |K| |δC| |K|, and a deflection's bound holds for any such δC."""
    error = stepped.matrices[NAME].error
    poses = [[LENGTH]]
    k = stiffness(stepped.mechanism, poses)[0]
    bars = stiffness_bars(stepped, poses)
    np.testing.assert_allclose(bars[0], np.abs(k) @ error @ np.abs(k), rtol=1e-9)
    twist = deflection(stepped.mechanism, poses, [0, 0, 100, 0, 0, 0]).twist
    off = np.linalg.inv(np.linalg.inv(k) + 1e-3 * error) @ twist[0] - [
        0,
        0,
        100,
        0,
        0,
        0,
    ]
    assert (
        np.abs(np.linalg.solve(k, off))
        <= 1.1e-3 * deflection_bars(stepped, poses, twist)[0] + 1e-18
    ).all()
    np.testing.assert_allclose(
        deflection_bars(stepped, poses, twist)[0], 100.0 * error[:, 2], rtol=1e-6
    )
    assert set(stiffness_json(at_named_poses(stepped, stepped.robot.poses), bars)) >= {
        "error"
    }


def test_a_body_is_as_long_as_its_step_file_s_solid(stepped, tmp_path):
    copyfile(stepped.robot.path.with_name("bar.step"), tmp_path / "bar.step")
    message = r"robot\.toml:13: bodies\.arm\.tip: expected a tip 60 mm from the base, .* of bar\.step .*, got 61 mm"
    with pytest.raises(InputError, match=message):
        assembled(one_part(tmp_path, STEP, length=61.0))
    with pytest.raises(InputError, match=message):
        check_solids(one_part(tmp_path, STEP, length=61.0))
    check_solids(one_part(tmp_path, STEP))


def test_faces_that_a_step_file_has_not_are_named_by_file_and_line(stepped, tmp_path):
    copyfile(stepped.robot.path.with_name("bar.step"), tmp_path / "bar.step")
    robot = one_part(tmp_path, f'{STEP}\nclamped = [{{ kind = "cylinder" }}]')
    message = r'robot\.toml:9: parts\."bar 1"\.clamped: no face has kind = cylinder.* `stiffscope faces \S*bar\.step`'
    for refuse in (assembled, check_solids):
        with pytest.raises(InputError, match=message):
            refuse(robot)


def test_a_parameter_that_changes_a_step_file_s_length_is_not_ranked(stepped):
    found = robot_sensitivity(
        read_robot(
            stepped.robot.path,
            stepped.robot.source.text.replace(
                '["60.0 mm", 0, 0]\ny', '["= L", 0, 0]\ny'
            )
            + '\n[parameters]\nL = "60 mm"\n',
        ),
        np.array([[LENGTH]]),
        None,
        stepped.results,
    )
    assert "parameters.L" not in [row.parameter.name for row in found.rows]
    assert "expected the length of bar.step" in found.notes["parameters.L"]


@pytest.mark.extended
def test_a_mass_that_only_cad_knows_is_tested_for(tmp_path):
    robot = one_part(
        tmp_path,
        f'{PLATE}\nhole_count = 2\nhole_diameter = "8 mm"\ncompliance = "beam"\nmesh = {{ size = "20 mm" }}',
    )
    made = assembled(robot)
    volume = 0.06 * 0.09 * 0.01 - 2 * np.pi * 0.004**2 * 0.01
    assert made.sources == {NAME: "beam"}
    assert made.mechanism.body("arm").mass == pytest.approx(
        volume * robot.material(NAME).density, rel=1e-6
    )
    assert stiffness_bars(made, [[LENGTH]]) is None
    assert deflection_bars(made, [[LENGTH]], np.ones((1, 6))) == 0.0


def test_parts_of_a_matrix_have_no_experiment_and_may_have_bounds(tmp_path):
    made = assembled(
        one_part(tmp_path, f"{MATRIX}\nerror = {[[1e-10] * 6] * 6}"), "fea"
    )
    assert (made.sources, made.results) == ({NAME: "matrix"}, {})
    assert made.mechanism.body("arm").mass == 0.08
    assert stiffness_bars(made, [[LENGTH]])[0, 1, 1] == pytest.approx(1e8 * 1e-10 * 1e8)
    doubled = assemble(made.robot, {NAME: 2 * made.matrices[NAME].compliance})
    assert 1 / stiffness(doubled, [[LENGTH]])[0, 1, 1] == pytest.approx(2e-8)


@pytest.mark.parametrize(
    ("components", "message"),
    [
        ({NAME: np.eye(3)}, "components: bar 1: expected a 6x6"),
        ({NAME: -np.eye(6)}, "components: bar 1: diagonal"),
        ({"bar": "beam"}, "expected parts among bar 1, got 'bar'"),
        ({NAME: "beam"}, "expected a matrix for bar 1, a matrix part, got 'beam'"),
        ("fem", "expected fea, beam, published or a matrix, got 'fem'"),
    ],
)
def test_components_that_cannot_be(tmp_path, components, message):
    with pytest.raises(InputError, match=message):
        assemble(one_part(tmp_path, MATRIX), components)


def test_a_plate_without_a_published_matrix_is_named(tmp_path):
    with pytest.raises(
        InputError,
        match=r'robot\.toml:\d+: parts\."bar 1"\.published: expected the name of a matrix',
    ):
        assemble(one_part(tmp_path, PLATE), "published")


def test_pads_apart_make_no_robot(tmp_path):
    robot = one_part(
        tmp_path,
        f'{PLATE}\nmass = 0\npads = "apart"\npad_spacing = "30 mm"\npad_width = "20 mm"\npad_height = "5 mm"',
        65,
    )
    with pytest.raises(
        InputError, match=r'robot\.toml:\d+: parts\."bar 1"\.pads: expected "together"'
    ):
        assemble(robot, "fea")
    assert assembled(robot, "beam").results == {}


def test_a_pose_out_of_reach_is_named_before_any_work(tmp_path):
    robot = one_part(tmp_path, ROD)
    check_reach(robot, robot.poses)
    with pytest.raises(InputError, match=r"^far: .*slide"):
        check_reach(robot, {"near": (0.07,), "far": (0.2,)})


@pytest.mark.parametrize(
    "name", ["biglide", "delta", "five-bar", "orthoglide", "serial-arm", "stewart"]
)
def test_every_robot_that_comes_along_is_assembled_and_stands(name):
    robot = load_robot(name)
    made = assembled(robot, "published" if name == "biglide" else "beam")
    state = at_named_poses(made, robot.poses)
    assert state.valid.all()
    assert (np.linalg.eigvalsh(state.matrix) > 0).all()
    assert (np.abs(state.sag) < 1e-2).all()
