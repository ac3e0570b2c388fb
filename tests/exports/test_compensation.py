"""Compensation tables, read back and applied to the model's own commands."""

import re

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

import stiffscope as ss
from stiffscope.errors import InputError
from stiffscope.exports.compensation import (
    form_compensation,
    grid_text,
    levels,
    plane_table,
)
from stiffscope.vjm.kinematics.configurations import configure
from stiffscope.vjm.statics.analysis import sag

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def delta():
    robot = ss.load_robot("delta")
    mechanism = ss.assemble(robot, "beam")
    poses = np.array(list(robot.poses.values()))
    length = configure(mechanism, poses).linkage.length
    return mechanism, form_compensation(mechanism, poses, length)


def read_grid(text):
    head, *rows = text.strip().split("\n")
    values = np.array([[float(word) for word in row.split(",")] for row in rows])
    return dict(zip(head.split(","), values.T, strict=True))


def test_the_grid_s_corrections_cancel_the_error_of_the_model_s_own_commands(delta):
    mechanism, grid = delta
    table = read_grid(grid_text(grid))
    wanted = np.stack([table[n] for n in "xyz"], axis=1)
    before = np.stack([table[f"d{n}"] for n in "xyz"], axis=1)
    commands = wanted + np.stack([table[f"c{n}"] for n in "xyz"], axis=1)
    left = commands + sag(mechanism, commands)[:, :3] - wanted
    assert np.allclose(before, sag(mechanism, wanted)[:, :3], atol=1e-15)
    assert np.abs(left).max() < 1e-6 * np.abs(before).max()


def test_between_its_points_the_interpolation_error_is_as_stated(delta):
    mechanism, grid = delta
    rng = np.random.default_rng(2)
    low, high = ([line[k] for line in grid.lines] for k in (0, -1))
    points = rng.uniform(low, high, (200, 3))
    commands = points + grid.correct(points)
    left = commands + sag(mechanism, commands)[:, :3] - points
    assert np.linalg.norm(left, axis=1).max() < 1.5 * grid.left
    assert grid.left < 1e-3 * grid.before


def read_plane(text):
    """Read a plane compensation as its controller does: masters' lines and values, m."""
    numbers = {
        key: int(value)
        for key, value in re.findall(r"^kw\.crosscomp2\.(\w+) (-?\d+)", text, re.M)
    }
    assert numbers["unit"] == 1
    sizes = [numbers[f"last_index_master{k}"] + 1 for k in (1, 2)]
    lines = [
        1e-7
        * (
            numbers[f"start_position_master{k + 1}"]
            + numbers["interval"] * np.arange(n)
        )
        for k, n in enumerate(sizes)
    ]
    values = np.full(sizes, np.nan)
    cells = re.findall(r"table\[(\d+)\]\[(\d+)\]\.correction (-?\d+)", text)
    for second, first, count in cells:
        values[int(first), int(second)] = 1e-7 * int(count)
    return lines, values


def test_a_controller_s_planes_bring_the_tool_to_a_tenth_of_a_micrometre(delta):
    mechanism, grid = delta
    for level in levels(grid):
        planes = [read_plane(plane_table(grid, n, level)) for n in grid.axes]
        at = np.stack(np.meshgrid(*planes[0][0], indexing="ij"), axis=-1).reshape(-1, 2)
        wanted = np.column_stack([at, np.full(len(at), grid.lines[2][level])])
        added = [RegularGridInterpolator(*plane)(at) for plane in planes]
        commands = wanted + np.stack(added, axis=1)
        left = commands + sag(mechanism, commands)[:, :3] - wanted
        assert np.abs(left).max() < 0.6e-7


def test_a_robot_that_commands_one_translation_is_sent_to_its_path():
    from tests.exports.test_exudyn import pendulum

    mechanism = pendulum()
    with pytest.raises(InputError, match="stiffscope path JOB --compensate"):
        form_compensation(mechanism, mechanism.tool.home[None], 1.0)
