"""Stiffness maps of any robot as files and pictures."""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

from stiffscope.errors import InputError
from stiffscope.notebook.objects import stiffness_map as picture
from stiffscope.report.figures import new_figure, save_figure
from stiffscope.robot.mechanism_of import mechanism_of
from stiffscope.robot.part_matrices import part_matrices
from stiffscope.robot.reader import load_robot
from stiffscope.statics.maps import (
    PRINCIPAL,
    StiffnessVolume,
    Wanted,
    map_robot,
    map_stiffness,
    map_volume,
    to_dataset,
    write_map,
)
from stiffscope.statics.show.maps import (
    Panel,
    _fill,
    _limits,
    _mark,
    draw_map,
    held_text,
    pick_slices,
    scalar_panels,
    stiffness_panels,
    stiffness_title,
)
from stiffscope.vjm.kinematics.configurations import configure
from stiffscope.vjm.statics.analysis import sag, stiffness
from tests.vjm.test_rigid_directions import PLANAR_2R

NAMES = ("K_tx", "K_ty", "K_tz", "K_rx", "K_ry", "K_rz")


@pytest.fixture(scope="module")
def stewart():
    robot = load_robot("stewart")
    return robot, mechanism_of(robot, part_matrices(robot, "beam"))


def test_netcdf_is_what_the_robot_says(tmp_path):
    robot = load_robot("biglide")
    mechanism = mechanism_of(robot, part_matrices(robot, "published"))
    found = map_robot(robot, mechanism, 9, "exact")
    write_map(found, tmp_path, "the title")
    with xr.open_dataset(tmp_path / "map.nc") as file:
        assert (file.title, set(file.coords)) == ("the title", {"x", "y", "z"})
        assert all(
            variable.attrs["units"] and variable.attrs["long_name"]
            for variable in file.variables.values()
        )
        units = {
            name: file[name].units
            for name in ("x", "K_tz", "K_rz_loaded", "sag_z", "sag_rx")
        }
        assert units == {
            "x": "m",
            "K_tz": "N m-1",
            "K_rz_loaded": "N m rad-1",
            "sag_z": "m",
            "sag_rx": "rad",
        }
        assert file["z"].positive == "down"
        assert np.isnan(file["K_tx"].isel(x=0, z=0))  # out of reach
        here = file.isel(x=4, z=5)
        pose = [[float(here.x), float(here.y), float(here.z)]]
        for end, matrix in (
            ("", stiffness(mechanism, pose)),
            ("_loaded", stiffness(mechanism, pose, gravity="exact")),
        ):
            assert [float(here[name + end]) for name in NAMES] == pytest.approx(
                np.diag(matrix[0]), rel=1e-9
            )
        assert float(here["sag_z"]) == pytest.approx(
            sag(mechanism, pose)[0, 2], rel=1e-3
        )
        assert xr.Dataset.identical(file.load(), to_dataset(found, "the title"))


def test_the_name_of_a_pose_at_the_edge_is_beside_no_colour_bar(stewart):
    robot, mechanism = stewart
    z = robot.poses["home"][2]
    found = map_stiffness(mechanism, {"x": (-0.02, 0.02), "z": (z - 0.01, z + 0.01)}, 3)
    axes = new_figure(4.0, 3.0, "").subplots()
    axes.set_xlim(-20.0, 20.0)
    _mark(
        axes,
        found,
        {"far right": (0.02, 0, z, 0, 0, 0), "far left": (-0.02, 0, z, 0, 0, 0)},
    )
    assert [text.get_horizontalalignment() for text in axes.texts] == ["right", "left"]


def test_an_angle_against_a_length_at_another_pose(stewart, tmp_path):
    robot, mechanism = stewart
    at = (0.01, 0.0, robot.poses["home"][2], 0.0, 0.0, 0.1)
    found = map_stiffness(mechanism, {"z": (0.27, 0.3), "ry": (-0.1, 0.1)}, 4, at=at)
    write_map(found, tmp_path)
    assert held_text(found) == ", x = 10 mm, y = 0 mm, rx = 0 deg, rz = 5.7296 deg"
    with xr.open_dataset(tmp_path / "map.nc") as file:
        assert (file["K_tx"].dims, file["ry"].units, float(file["rz"])) == (
            ("ry", "z"),
            "rad",
            0.1,
        )
        here = file.isel(z=1, ry=3)
        pose = [0.01, 0.0, float(here.z), 0.0, float(here.ry), 0.1]
        matrix = stiffness(mechanism, pose)[0]
        assert [float(here[name]) for name in NAMES] == pytest.approx(
            np.diag(matrix), rel=1e-9
        )
    assert picture(
        mechanism, {"z": (0.27, 0.3), "ry": (-0.1, 0.1)}, 3, at
    ).png.startswith(b"\x89PNG")


def test_a_map_says_what_stays_where_poses_leave_a_choice():
    robot = load_robot("serial-arm")
    mechanism = mechanism_of(robot, part_matrices(robot, "beam"))
    arm = replace(mechanism, tool=replace(mechanism.tool, pose=("x", "y", "z")))
    x, y, z = arm.tool.home
    found = map_stiffness(arm, {"x": (x, x + 0.02), "y": (y, y + 0.02)}, 2)
    away = configure(arm, [x + 0.01, y + 0.02, z]).require_valid()
    moves = zip(
        [*(each.name for each in arm.drives), "rx", "ry", "rz"],
        [*away.drives[0], *away.tool[0, 3:]],
        strict=True,
    )
    still = [name for name, value in moves if abs(value) < 1e-12]
    assert len(still) == 3  # six drives for three coordinates
    assert held_text(found) == f", z = {1e3 * z:.5g} mm" + "".join(
        f", {name} as at home" for name in still
    )


@pytest.mark.parametrize(
    ("ranges", "message"),
    [
        ({"x": (0.0, 0.1)}, "expected two of x, y, z, rx, ry, rz, got x"),
        (
            {"x": (0.0, 0.1), "u": (0.0, 1.0)},
            "expected two of x, y, z, rx, ry, rz, got x, u",
        ),
        ({"x": (5.0, 6.0), "y": (5.0, 6.0)}, "no pose is within reach"),
    ],
)
def test_what_cannot_be_mapped_is_refused(stewart, ranges, message):
    with pytest.raises(InputError, match=message):
        map_stiffness(stewart[1], ranges, 3)


@pytest.mark.filterwarnings("error")
def test_a_map_says_what_is_rigid(tmp_path):
    """A planar arm yields in its plane only: along x and y, about z, by 1/C_ii."""
    x, y = PLANAR_2R.tool.home
    ranges = {"x": (x - 0.02, x + 0.02), "y": (y - 0.02, y + 0.02)}
    found = map_volume(
        PLANAR_2R,
        ranges,
        3,
        gravity="exact",
        wanted=Wanted(tuple(PRINCIPAL), (0, 0, 1)),
    ).maps[0]
    assert (
        stiffness_title(found)
        == "stiffness at M (diagonal of K; 1/C_ii where a direction is rigid)"
    )
    assert pick_slices(StiffnessVolume("", np.zeros(1), (found,))) == [found]
    write_map(found, tmp_path)
    assert len((tmp_path / "map.csv").read_text().splitlines()) == 1 + 9
    assert "1/C_ii" in to_dataset(found)["K_tx_loaded"].long_name
    draw_map(
        found,
        [*stiffness_panels(found), *scalar_panels(found)],
        {},
        "",
        tmp_path / "map.svg",
    )
    drawn = (tmp_path / "map.svg").read_text()
    assert drawn.count(">rigid<") == 6  # z, rx, ry; best, condition, along z
    assert "QuadMesh" not in drawn  # one path each pose, 23 MB of them


def test_a_few_stiff_poses_do_not_swallow_the_colours():
    values = np.linspace(1.0, 2.0, 400).reshape(20, 20)
    assert _limits(values) == (1.0, 2.0, False)
    values[0, :3] = 50.0
    low, high, clipped = _limits(values)
    assert clipped
    assert 1.0 < low < high < 2.0


@pytest.mark.parametrize(
    ("spread", "constant"), [(0.0, True), (6e-5, True), (2e-3, False)]
)
def test_a_constant_is_called_so_and_has_no_range_of_colours(stewart, spread, constant):
    found = map_robot(*stewart, 5, "none")
    values = 8.0 * (1.0 + spread * np.linspace(0.0, 1.0, 25).reshape(5, 5))
    figure = new_figure(4.0, 4.0, "")
    axes = figure.add_subplot()
    _fill(axes, found, Panel("$K_{tz}$ (N/µm)", values))
    texts = [text.get_text() for text in axes.texts if "constant" in text.get_text()]
    assert bool(texts) == constant
    if constant:
        told = "constant: 8" if not spread else "constant: 8.0002\n± 0.003 %"
        assert texts == [told]
        assert not axes.child_axes  # no colour bar


def test_a_figure_is_written_alike_every_time(tmp_path):
    for name in ("one.svg", "other.svg"):
        figure = new_figure(2.0, 2.0, "stiffness")
        figure.subplots().imshow(np.eye(3))
        save_figure(figure, tmp_path / name)
    assert (tmp_path / "one.svg").read_bytes() == (tmp_path / "other.svg").read_bytes()
