"""Paths: the error along a path of an arm whose Jacobian is written here, compensation."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import meshio
import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from stiffscope.cli.main import cli
from stiffscope.design.studies import study
from stiffscope.errors import InputError
from stiffscope.experiments.assembly import assemble_robots
from stiffscope.path.along import along, compensate, respond_at_worst
from stiffscope.path.course import find_axes
from stiffscope.path.cutting import mill
from stiffscope.path.job import Motion, load_job
from stiffscope.path.show import path_columns, show_path, write_stress
from stiffscope.path.stress import find_stresses
from stiffscope.report.robot_view import read_cases
from stiffscope.runtime.workshop import workshop
from stiffscope.vjm.kinematics.configurations import configure
from stiffscope.vjm.statics.yielding import respond
from tests.experiments.one_part import ROBOT, ROD
from tests.vjm import oracle
from tests.vjm.files import CHECKED

pytestmark = pytest.mark.slow

STIFFNESS = np.array([9e3, 6e3, 2e3])  # N·m/rad
JOINTS = np.array([[0.0, 0.0], [0.4, 0.0], [0.4, 0.3]])  # m, at home
TOOL = np.array([0.6, 0.3])


def _arm(folder, extra=""):
    lines = ['name = "planar"']
    bodies = ["ground", "one", "two", "hand"]
    lines += [f"[bodies.{name}]" for name in bodies[1:]]
    for k, (place, stiffness) in enumerate(zip(JOINTS, STIFFNESS, strict=True)):
        lines += [
            f"[joints.q{k}]",
            f'between = ["{bodies[k]}", "{bodies[k + 1]}"]',
            'type = "revolute"',
        ]
        lines += [
            f"at = [{place[0]}, {place[1]}, 0]",
            "axis = [0, 0, 1]",
            f"drive = {{ stiffness = {stiffness} }}",
        ]
    lines += [
        "[tool]",
        'body = "hand"',
        f"at = [{TOOL[0]}, {TOOL[1]}, 0]",
        'pose = ["x", "y", "rz"]',
        extra,
    ]
    (folder / "arm.toml").write_text("\n".join(lines))


def _job(folder, path, process="", **more):
    _arm(folder)
    lines = [
        'robot = "arm.toml"',
        f'path = "{path}"',
        *(f"{key} = {value}" for key, value in more.items()),
        process,
    ]
    (folder / "job.toml").write_text("\n".join(lines))
    job = load_job(folder / "job.toml")
    with workshop() as shop:
        return job, assemble_robots({"robot": job.robot}, None, shop)["robot"]


def _planar_jacobian(pose):
    """(3, 3) of x, y, rz by the drives, from the closed kinematics of three revolute joints."""
    lengths = np.array([0.4, 0.3, np.hypot(*(TOOL - JOINTS[2]))])
    home = np.array([0.0, np.pi / 2, 0.0])  # directions of the links
    x, y, turn = pose
    last = home[2] + turn
    wrist = np.array([x, y]) - lengths[2] * np.array([np.cos(last), np.sin(last)])
    cosine = (wrist @ wrist - lengths[0] ** 2 - lengths[1] ** 2) / (
        2 * lengths[0] * lengths[1]
    )
    elbow = np.arccos(cosine)
    first = np.arctan2(wrist[1], wrist[0]) - np.arctan2(
        lengths[1] * np.sin(elbow), lengths[0] + lengths[1] * cosine
    )
    places = [np.zeros(2), lengths[0] * np.array([np.cos(first), np.sin(first)]), wrist]
    return np.array([[-(y - p[1]), x - p[0], 1.0] for p in places]).T


def _planar_compliance(pose):
    jacobian = _planar_jacobian(pose)
    return jacobian @ np.diag(1 / STIFFNESS) @ jacobian.T


def _line_table(folder, n=40):
    s = np.linspace(0.0, 1.0, n)
    poses = np.column_stack((600 + 40 * s, 300 - 60 * s**2, 10 * s))
    forces = np.column_stack((50 + 10 * s, -80 * s, 3 * s))
    rows = ["x,y,rz,feed,fx,fy,mz"] + [
        ",".join(f"{v:.12g}" for v in (*p, 600, *f))
        for p, f in zip(poses, forces, strict=True)
    ]
    (folder / "line.csv").write_text("\n".join(rows))
    return poses * [1e-3, 1e-3, np.pi / 180], forces


UNITS = '{ x = "mm", y = "mm", rz = "deg", feed = "mm/min" }'


def _tangents(poses):
    """Derivatives (n, 2) by the length of the chords, second order inside (numpy's gradient)."""
    steps = np.linalg.norm(np.diff(poses[:, :2], axis=0), axis=1)
    return np.gradient(poses[:, :2], np.concatenate([[0.0], np.cumsum(steps)]), axis=0)


def test_the_error_is_what_the_jacobian_of_the_arm_gives(tmp_path):
    poses, forces = _line_table(tmp_path)
    job, made = _job(tmp_path, "line.csv", units=UNITS)
    found = along(job, made)
    expected = np.array(
        [_planar_compliance(p) @ f for p, f in zip(poses, forces, strict=True)]
    )
    np.testing.assert_allclose(
        found.error[:, [0, 1, 5]], expected, rtol=1e-6, atol=1e-12
    )
    tangent = _tangents(poses)[5]
    assert found.parts["along"][5] == pytest.approx(
        expected[5, :2] @ tangent / np.linalg.norm(tangent), rel=1e-9
    )
    steps = np.linalg.norm(np.diff(poses[:, :2], axis=0), axis=1)
    np.testing.assert_allclose(found.time[1:], np.cumsum(steps) / 0.01, rtol=1e-9)


def test_another_robot_may_take_the_place_of_the_jobs(tmp_path):
    """With drives half as stiff the error is twice as large."""
    _line_table(tmp_path)
    job, made = _job(tmp_path, "line.csv", units=UNITS)
    text = (tmp_path / "arm.toml").read_text()
    for k in STIFFNESS:
        text = text.replace(f"stiffness = {k}", f"stiffness = {0.5 * k}")
    (tmp_path / "soft.toml").write_text(text)
    soft = load_job(job.file, tmp_path / "soft.toml")
    with workshop() as shop:
        other = assemble_robots({"robot": soft.robot}, None, shop)["robot"]
    np.testing.assert_allclose(
        along(soft, other).error[:, :3], 2.0 * along(job, made).error[:, :3], atol=1e-12
    )


def test_a_study_takes_the_error_along_a_path(tmp_path):
    poses, forces = _line_table(tmp_path)
    job, _ = _job(tmp_path, "line.csv", units=UNITS)
    (tmp_path / "study.toml").write_text(
        'robot = "arm.toml"\nmethod = "grid"\n[parameters]\n'
        f'"q2.drive.stiffness" = {{ range = ["{STIFFNESS[2]} N*m/rad", "{2 * STIFFNESS[2]} N*m/rad"], steps = 2 }}\n'
        f'[responses]\nmost = {{ of = "error", path = "{job.file.name}" }}\n'
        f'normal = {{ of = "2*normal", path = "{job.file.name}", take = "rms", unit = "m" }}\n'
    )
    made = study(tmp_path / "study.toml")
    for design, factor in zip(made.designs, (1.0, 0.5), strict=True):
        compliance = np.diag(np.array([1.0, 1.0, factor]) / STIFFNESS)
        jacobians = [_planar_jacobian(p) for p in poses]
        error = np.array(
            [
                (j @ compliance @ j.T @ f)[:2]
                for j, f in zip(jacobians, forces, strict=True)
            ]
        )
        tangent = _tangents(poses)
        across = (
            error[:, 0] * tangent[:, 1] - error[:, 1] * tangent[:, 0]
        ) / np.linalg.norm(tangent, axis=1)
        assert design.responses[0] == pytest.approx(
            np.linalg.norm(error, axis=1).max(), rel=1e-6
        )
        assert design.responses[1] == pytest.approx(
            2.0 * np.sqrt(np.mean(across**2)), rel=1e-6
        )


def test_a_payload_weighs_where_it_hangs(tmp_path):
    poses, _ = _line_table(tmp_path, 8)
    (tmp_path / "line.csv").write_text(
        "x,y,rz\n" + "\n".join(",".join(map(str, p)) for p in poses.tolist())
    )
    job, made = _job(
        tmp_path, "line.csv", "payload = { mass = 4, centre = [0.65, 0.3, 0] }"
    )
    made = replace(
        made, mechanism=replace(made.mechanism, gravity=np.array([0.0, -9.0, 0.0]))
    )
    arms = 0.05 * np.cos(poses[:, 2])
    loads = [[0.0, -36.0, -36.0 * arm] for arm in arms]
    expected = [
        _planar_compliance(p) @ load for p, load in zip(poses, loads, strict=True)
    ]
    state = along(job, made)
    np.testing.assert_allclose(
        state.error[:, [0, 1, 5]], expected, rtol=1e-6, atol=1e-12
    )
    torques = _planar_jacobian(poses[state.worst]).T @ loads[state.worst]
    ((drawn,),) = read_cases(respond_at_worst(state, made)[1], {"process": np.zeros(6)})
    stored = torques**2 / STIFFNESS
    np.testing.assert_allclose(
        [drawn.shares[f"q{k}"] for k in range(3)], stored / stored.sum(), rtol=1e-6
    )


def test_the_compensated_commands_bring_the_tool_where_it_should_be(tmp_path):
    _line_table(tmp_path)
    job, made = _job(tmp_path, "line.csv", units=UNITS)
    before = along(job, made)
    after = compensate(made, before)
    assert before.size.max() > 1e-3
    assert np.abs(after.left).max() < 1e-8 * before.size.max()
    after.path.write(tmp_path / "compensated.csv")
    table = np.loadtxt(tmp_path / "compensated.csv", delimiter=",", skiprows=1)
    reached = table * [1e-3, 1e-3, np.pi / 180]
    np.testing.assert_allclose(reached, after.path.values, rtol=1e-12)


def test_a_path_tells_numbers_and_no_rounding_noise(tmp_path, capsys):
    _line_table(tmp_path)
    job, made = _job(tmp_path, "line.csv", units=UNITS)
    before = along(job, made)
    show_path(before, compensate(made, before), ())
    assert "falls to less than 1 nm and 1 nrad" in capsys.readouterr().out
    columns = path_columns(before)
    twist = np.abs(np.stack([columns[name] for name in ("dx", "dy", "dz")]))
    assert not ((twist > 0.0) & (twist < 1e-12 * twist.max())).any()


@pytest.mark.parametrize("name", ["linear-delta", "braced-gantry"])
def test_paths_of_a_delta_and_a_gantry_are_those_of_an_independent_code(name, tmp_path):
    """All bodies' constraints by least squares, then one system of all nodes, under weight and force."""
    robot = Path(__file__).parents[1] / "vjm" / "robots" / f"{name}.toml"
    force = np.array([40.0, -25.0, -60.0])
    ends = np.array(CHECKED[name]["poses"])
    wanted = ends[0] + np.array([[0.1], [1.0]]) * (ends[1] - ends[0])
    head = ["x", "y", "z"][: wanted.shape[1]]
    np.savetxt(
        tmp_path / "a.csv",
        np.column_stack((wanted, np.tile(force, (2, 1)))),
        "%.15g",
        ",",
        header=",".join([*head, "fx", "fy", "fz"]),
        comments="",
    )
    (tmp_path / "job.toml").write_text(f'robot = "{robot}"\npath = "a.csv"')
    job = load_job(tmp_path / "job.toml")
    with workshop() as shop:
        made = assemble_robots({"robot": job.robot}, None, shop)["robot"]

    def predict(pose):
        bodies = oracle.Bodies(made.mechanism).close(pose, 4)
        turn, moved = bodies.of(made.mechanism.tool.body)
        tool = turn @ made.mechanism.tool.at + moved
        loads = oracle.weights(bodies) | {
            "<tool>": np.concatenate([force, np.cross(tool, force)])
        }
        return tool, oracle.solve(bodies, loads)[1][:3]

    before = along(job, made)
    with threadpool_limits(1):
        expected = np.array([predict(pose)[1] for pose in wanted])
        reached = np.sum(predict(compensate(made, before).path.values[1]), axis=0)
    np.testing.assert_allclose(
        before.error[:, :3], expected, rtol=0.0, atol=1e-6 * np.abs(expected).max()
    )
    left = (reached - before.tool[1, :3])[: len(head)]
    assert np.abs(left).max() < 1e-6 * np.abs(expected).max()


def test_a_free_turn_is_nowhere_worse_than_the_best_of_72_fixed_ones_and_smooth(
    tmp_path,
):
    poses, _ = _line_table(tmp_path)
    force = np.array([50.0, -80.0, 0.0])
    rows = [
        ",".join(f"{v:.12g}" for v in (1e3 * p[0], 1e3 * p[1], 0.0, 50.0, -80.0))
        for p in poses
    ]
    (tmp_path / "line.csv").write_text("\n".join(["x,y,rz,fx,fy", *rows]))
    free = '[free]\nspindle = ["-100 deg", "100 deg"]'
    job, made = _job(tmp_path, "line.csv", free, units='{ x = "mm", y = "mm" }')
    found = along(job, made)

    tangent = _tangents(poses)
    normal = (
        np.column_stack((-tangent[:, 1], tangent[:, 0]))
        / np.linalg.norm(tangent, axis=1)[:, None]
    )

    def error(turn):
        each = zip(poses, np.broadcast_to(turn, len(poses)), strict=True)
        moved = np.array(
            [(_planar_compliance((*p[:2], a)) @ force)[:2] for p, a in each]
        )
        return np.abs(np.einsum("ni,ni->n", moved, normal))

    with np.errstate(invalid="ignore"):
        fixed = [error(turn) for turn in np.deg2rad(np.arange(-100.0, 101.0, 5.0))]
    best = min((each for each in fixed if np.isfinite(each).all()), key=np.max)
    turns = found.free_choice.values["spindle"]
    chosen = error(turns)
    np.testing.assert_allclose(
        np.abs(found.parts["normal"]), chosen, rtol=1e-6, atol=1e-10
    )
    assert (chosen <= best * (1 + 1e-5)).all()
    assert (chosen**2).sum() < 0.99 * (best**2).sum()
    inner = np.abs(turns) < np.deg2rad(99.9)  # a kink where it reaches its range
    smooth = inner[:-2] & inner[1:-1] & inner[2:]
    assert np.abs(np.diff(turns, 2)[smooth]).max() < np.deg2rad(6.0)
    np.testing.assert_allclose(found.path.values[:, 2], turns, atol=1e-12)
    after = compensate(made, found)
    assert np.abs(after.left).max() < 1e-8 * found.size.max()


@pytest.mark.extended
def test_no_fixed_turn_of_a_six_axis_arm_is_better_anywhere_than_the_one_that_is_chosen(
    tmp_path,
):
    """Horizontal tool; half a turn is left out, where the two ways round lead to two configurations."""
    s = np.linspace(0.0, 1.0, 31)
    places = np.column_stack((0.58 + 0.01 * s, 0.08 + 0.06 * s, 0.14 + 0.05 * s**2))
    table = np.column_stack((places, np.zeros_like(places)))
    np.savetxt(
        tmp_path / "p.csv",
        table,
        delimiter=",",
        header="x,y,z,rx,ry,rz",
        comments="",
        fmt="%.12g",
    )
    (tmp_path / "job.toml").write_text(
        'robot = "serial-arm"\ncomponents = "beam"\npath = "p.csv"\naxis = [-1, 0, 0]\ngravity = "none"\n'
        'process.force = { across = 60 }\n[free]\nspindle = ["-180 deg", "180 deg"]'
    )
    job = load_job(tmp_path / "job.toml")
    with workshop() as shop:
        made = assemble_robots({"robot": job.robot}, "beam", shop)["robot"]
    found = along(job, made)

    fixed = []
    normal = found.axes.normal
    for turns in np.split(
        np.deg2rad(np.arange(-175.0, 180.0, 5.0)), [36]
    ):  # so few that each is reached from home
        each = np.outer(np.repeat(turns, len(s)), [-1.0, 0.0, 0.0])
        state = configure(
            made.mechanism, np.column_stack((np.tile(places, (len(turns), 1)), each))
        )
        wrench = np.tile(
            np.concatenate([60.0 * normal, np.zeros_like(places)], axis=1),
            (len(turns), 1),
        )
        moved = respond(
            made.mechanism, state[state.valid], wrench[state.valid, :, None]
        ).twist[:, :3, 0]
        error = np.full((len(turns), len(s), 1), np.inf)
        error.reshape(-1)[state.valid] = np.abs(
            (moved * np.tile(normal, (len(turns), 1))[state.valid]).sum(axis=1)
        )
        jumps = (
            np.abs(np.diff(state.drives.reshape(len(turns), len(s), -1), axis=1)).max(
                axis=(1, 2)
            )
            > 0.8
        )
        fixed += list(error[~jumps, :, 0])
    best = min(fixed, key=np.max)
    assert (found.free_choice.error <= best * (1 + 1e-5)).all()
    np.testing.assert_allclose(
        np.abs(found.parts["normal"]), found.free_choice.error, rtol=1e-9
    )
    assert np.abs(np.diff(found.free_choice.values["spindle"], 2)).max() < np.deg2rad(
        4.0
    )


def test_a_turntable_turns_path_and_forces_with_the_workpiece():
    turn = Motion("table", (0.0, 0.0, 1.0), (0.1, 0.0, 0.0), (-4.0, 4.0), 1.0)
    tool, turned = turn.place(
        np.array([[0.3, 0.0, 0.5, 0.0, 0.0, 0.2]]), np.array([np.pi / 2])
    )
    np.testing.assert_allclose(
        tool, [[0.1, 0.2, 0.5, 0.0, 0.0, np.pi / 2 + 0.2]], atol=1e-12
    )
    np.testing.assert_allclose(turned[0] @ [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], atol=1e-12)


def test_the_path_by_joints_is_the_path_by_poses(tmp_path):
    _line_table(tmp_path, 8)
    job, made = _job(tmp_path, "line.csv", units=UNITS)
    state = along(job, made)
    drives = np.concatenate([found.drives for found in _configurations(job, made)])
    header = ",".join(["q:q0", "q:q1", "q:q2", "fx", "fy", "mz"])
    np.savetxt(
        tmp_path / "q.csv",
        np.column_stack((drives, state.wrench[:, [0, 1, 5]])),
        delimiter=",",
        header=header,
        comments="",
        fmt="%.16g",
    )
    other, _ = _job(tmp_path, "q.csv")
    np.testing.assert_allclose(
        along(other, made).error, state.error, rtol=1e-9, atol=1e-15
    )


def test_the_side_of_a_plunge_is_the_same_whatever_the_last_digits():
    job = SimpleNamespace(
        section=SimpleNamespace(axis=(0.0, 0.0, 1.0)),
        path=SimpleNamespace(rapid=np.zeros(3, dtype=bool)),
        path_file=Path("p.nc"),
    )
    tool = np.zeros((3, 6))
    tool[1:, 2] = -0.01
    tool[2, 0] = 0.02
    sides = [find_axes(job, tool + tilt).normal[0] for tilt in 1e-17 * np.eye(6)[3:5]]
    assert np.allclose(sides[0], sides[1])


def test_tangents_of_a_closed_circle_are_those_of_the_circle():
    """Uneven steps too: to second order; at even steps exactly, first and last point alike."""
    for turn in (
        np.linspace(0.0, 2 * np.pi, 61),
        2 * np.pi * np.linspace(0, 1, 400) ** 1.2,
    ):
        tool = np.zeros((len(turn) + 2, 6))
        angle = np.concatenate([turn[:1], turn, turn[-1:]])  # it rests at both ends
        tool[:, :2] = 0.1 * np.column_stack((np.cos(angle), np.sin(angle)))
        job = SimpleNamespace(
            section=SimpleNamespace(axis=(0.0, 0.0, 1.0)),
            path=SimpleNamespace(rapid=np.zeros(len(angle), dtype=bool)),
            path_file=Path("p.nc"),
        )
        found = find_axes(job, tool).along
        exact = np.column_stack((-np.sin(angle), np.cos(angle)))
        within = 1e-12 if len(turn) == 61 else 2e-4
        np.testing.assert_allclose(found[:, :2], exact, atol=within)
        np.testing.assert_allclose(found[0], found[-1], atol=1e-12)


def test_a_cut_looks_along_the_cut_and_not_along_the_rapid_move_beside_it():
    job = SimpleNamespace(
        section=SimpleNamespace(axis=(0.0, 0.0, 1.0)),
        path=SimpleNamespace(rapid=np.array([True, True, False, False, True])),
        path_file=Path("p.nc"),
    )
    tool = np.zeros((5, 6))
    tool[:, :2] = [[0, 9], [0, 0], [1, 0], [2, 0], [2, 9]]
    found = find_axes(job, tool).along
    np.testing.assert_allclose(found[2:4, :2], [[1, 0], [1, 0]], atol=1e-12)


def test_the_feed_follows_from_times_and_where_the_tool_goes(tmp_path):
    """Commanded by joints, whose coordinates are no lengths."""
    _line_table(tmp_path, 8)
    job, made = _job(tmp_path, "line.csv", units=UNITS)
    state = along(job, made)
    drives = np.concatenate([found.drives for found in _configurations(job, made)])
    table = np.column_stack((drives, state.time))
    np.savetxt(
        tmp_path / "q.csv",
        table,
        delimiter=",",
        header="q:q0,q:q1,q:q2,t",
        comments="",
        fmt="%.16g",
    )
    size = "diameter = 0.01, teeth = 2, speed = 50, depth = 1e-3, width = 5e-3"
    cut = f"[process]\nmilling = {{ kc1 = 1e9, mc = 0.2, {size} }}"
    timed, _ = _job(tmp_path, "q.csv", cut)
    assert along(timed, made).cutting.chip == pytest.approx(
        mill(
            1e9,
            0.2,
            diameter=0.01,
            teeth=2,
            speed=50.0,
            feed=0.01,
            depth=1e-3,
            width=5e-3,
        ).chip,
        rel=1e-9,
    )


def test_the_time_of_rapid_moves_is_not_known(tmp_path):
    (tmp_path / "a.nc").write_text("G21 F600\nG1 X602 Y305\nG0 X606\nG1 X610\n")
    job, made = _job(tmp_path, "a.nc", step=1.0)
    assert along(job, made).time is None


def _configurations(job, made):
    from stiffscope.path.course import configure_path

    return configure_path(job, made, job.path)


def test_a_long_path_is_read_to_its_end(tmp_path):
    _arm(tmp_path)
    rows = np.tile([TOOL[0], TOOL[1], 0.0], (200_010, 1))
    np.savetxt(
        tmp_path / "long.csv",
        rows,
        delimiter=",",
        header="x,y,rz",
        comments="",
        fmt="%g",
    )
    (tmp_path / "job.toml").write_text('robot = "arm.toml"\npath = "long.csv"')
    assert len(load_job(tmp_path / "job.toml").path) == 200_010


@pytest.mark.parametrize(
    ("text", "lines"),
    [
        ("x,y,rz\n0.6,0.3,0\n0.61,0.3,0\n", [2, 3]),
        ('"x", "y","rz"\n\n0.6,0.3, 0\n"0.61",0.3,0\n', [3, 4]),
    ],
)
def test_a_table_names_its_lines_whether_it_holds_only_numbers_or_not(
    text, lines, tmp_path
):
    _arm(tmp_path)
    (tmp_path / "a.csv").write_text(text)
    (tmp_path / "job.toml").write_text('robot = "arm.toml"\npath = "a.csv"')
    path = load_job(tmp_path / "job.toml").path
    assert list(path.lines) == lines
    np.testing.assert_array_equal(path.values, [[0.6, 0.3, 0.0], [0.61, 0.3, 0.0]])


def test_the_command_writes_the_path_and_says_where_it_is_worst(tmp_path, capfd):
    _line_table(tmp_path)
    _job(tmp_path, "line.csv", "[process]\nforce = { across = 30 }", units=UNITS)
    arguments = [
        "path",
        str(tmp_path / "job.toml"),
        "--out",
        str(tmp_path / "out"),
        "--compensate",
        "--json",
        str(tmp_path / "a.json"),
    ]
    cli(arguments, standalone_mode=False)
    answer = json.loads((tmp_path / "a.json").read_text())
    header = (
        (tmp_path / "out" / "path.csv")
        .read_text()
        .splitlines()[0]
        .replace('"', "")
        .split(",")
    )
    assert header == [
        "s",
        "t",
        "x",
        "y",
        "rz",
        "dx",
        "dy",
        "dz",
        "drx",
        "dry",
        "drz",
        "normal",
        "along",
        "binormal",
        "error",
        "q0",
        "q1",
        "q2",
    ]
    assert sum(answer["worst"]["shares"].values()) == pytest.approx(1.0)
    assert answer["compensated"]["after"] < 1e-8
    told = capfd.readouterr().out
    assert "Compensated" in told
    assert "± 0 mm" not in told  # beam theory has no bound


MILLING = """robot = "arm.toml"
path = "line.csv"
process.milling = {{material = "{material}", speed = "{speed}", diameter = 0.01, teeth = 2, depth = 1e-3, width = 1e-3}}
"""
CUT = MILLING.format(material="C45E", speed="9 rpm").rstrip().removesuffix("}")


@pytest.mark.parametrize(
    ("job", "message"),
    [
        (
            MILLING.format(material="cheese", speed="9 rpm"),
            r"job\.toml:3: process\.milling\.material: expected a mat",
        ),
        (MILLING.format(material="C45E", speed="9 rad/s"), "rotational speed"),
        (
            'robot = "arm.toml"\npath = "line.csv"\nunits = { x = "kg" }',
            r"job\.toml:3: units\.x: expected a unit",
        ),
        (
            'robot = "arm.toml"\npath = "none.csv"',
            r"job\.toml:2: path: .*none\.csv: expected a table",
        ),
        (
            'robot = "arm.toml"\npath = "line.csv"\nfree.spindle = ["9 deg", "-9 deg"]',
            r"job\.toml:3: free\.spindle: expected a lower and a higher value",
        ),
        ('robot = "arm.toml"\npath = "line.csv"\nspeed = 3', "expected a known key"),
        ('robot = "nobody"\npath = "line.csv"', r"job\.toml:1: robot"),
        (
            'robot = "arm.toml"\npath = "line.csv"\nprocess.force = { across = "1e30 N" }',
            "across: .* beyond 1e",
        ),
        (
            MILLING.format(material='C45E", kc1 = "2000 N/mm^2', speed="9 rpm"),
            r"kc1: expected none beside material, got one",
        ),
        (
            MILLING.format(material="C45E", speed="9 rpm").replace(
                'material = "C45E"', 'kc1 = "2 GPa", mc = 2'
            ),
            r"milling\.mc: expected less than 1, got 2",
        ),
        (
            MILLING.format(material="C45E", speed="9 rpm").replace(
                'material = "C45E"', "kc1 = 2000, mc = 0.2"
            ),
            r"milling\.kc1: expected a specific cutting force such as .*, got 2000, which is below 1e\+06 Pa",
        ),
        (
            MILLING.format(material="C45E", speed="3000 rpm").replace("0.01", "10"),
            r"process\.milling: expected pi .* diameter .* speed of at most 200 m/s, got 1571 m/s",
        ),
        (
            MILLING.format(material="C45E", speed="9 rpm").replace(
                "line.csv", "rapid.nc"
            ),
            r"rapid\.nc: expected a move that cuts \(G1 to G3\), got rapid moves alone",
        ),
        (
            MILLING.format(material="C45E", speed="fast rpm"),
            r"speed: expected a rotational .*, got \"fast rpm\"",
        ),
        (
            CUT + ", climb = 1 }",
            r"job\.toml:3: process\.milling\.climb: expected true or false, got 1",
        ),
        (
            CUT + ', lead = "900 deg" }',
            r"milling\.lead: expected an entering angle .* beyond 1\.57",
        ),
        (
            CUT + ", radial = 300 }",
            r"milling\.radial: expected a ratio of forces .*, got 300, which is beyond 10",
        ),
        (
            CUT.replace("teeth = 2", "teeth = 9000000") + " }",
            r"milling\.teeth: expected 1 to 1000, got 9000000",
        ),
        (
            'robot = "arm.toml"\npath = "line.csv"\nyield_strength = { Steel = "235 MPa" }',
            r"job\.toml:3: yield_strength\.Steel: expected a material .*did you mean \"steel\"",
        ),
        (
            'robot = "arm.toml"\npath = "line.csv"\nunits = { X = "mm" }',
            r"job\.toml:3: units\.X: expected a column of line\.csv .* got \"X\"",
        ),
        (
            'robot = "arm.toml"\npath = "a.nc"\nunits = { x = "in" }',
            r"toml:3: units: expected none beside a program",
        ),
        (
            'robot = "arm.toml"\npath = "line.csv"\nat = [0, 0, 0]',
            r"job\.toml:3: at: expected none beside a table",
        ),
        (
            'robot = "arm.toml"\npath = "both.csv"',
            r"both\.csv:1: expected a column feed or a column t",
        ),
        (
            'robot = "arm.toml"\npath = "far.csv"',
            r"far\.csv:2: fx: expected at most 1e\+06",
        ),
        (
            'robot = "arm.toml"\npath = "a.nc"\nstep = "1 pm"',
            r"a\.nc:2: expected at most 1,000,000 points",
        ),
        (
            'robot = "arm.toml"\npath = "a.nc"\n'
            + MILLING.format(material="C45E", speed="9 rpm").partition('csv"')[2],
            r"a\.nc:2: feed: expected a feed",
        ),
    ],
)
def test_a_job_that_is_none_is_refused(job, message, tmp_path):
    _arm(tmp_path)
    _line_table(tmp_path)
    (tmp_path / "both.csv").write_text(
        "x,y,rz,t,feed\n0.6,0.3,0,0,0.1\n0.61,0.3,0,1,0.1\n"
    )
    (tmp_path / "far.csv").write_text("x,y,rz,fx\n0.6,0.3,0,1e30\n0.61,0.3,0,1\n")
    (tmp_path / "a.nc").write_text("G21 G0 X600 Y300\nG1 X610\n")
    (tmp_path / "rapid.nc").write_text("G21 G0 X600 Y300\nG0 X610\n")
    (tmp_path / "job.toml").write_text(job)
    with pytest.raises(InputError, match=message):
        along(tmp_path / "job.toml")


@pytest.mark.slow
def test_stress_in_a_rod_is_that_of_a_bar_under_thrust_and_moment(tmp_path):
    """A round rod of 6 mm radius, x along it: N / A + M r / I, the same at every section between its ends."""
    text = ROBOT.format(part=ROD, length=60.0)
    (tmp_path / "one.toml").write_text(text)
    (tmp_path / "a.csv").write_text("x,fx,my\n0.060,1000,2\n0.061,1000,2\n")
    head = 'robot = "one.toml"\npath = "a.csv"\ngravity = "none"\nyield_strength = { steel = "235 MPa" }'
    (tmp_path / "job.toml").write_text(head)
    job = load_job(tmp_path / "job.toml")
    with workshop() as shop:
        made = assemble_robots({"robot": job.robot}, None, shop)["robot"]
    state = along(job, made)
    (found,) = find_stresses(state, made, respond_at_worst(state, made)[1])
    expected = 1000.0 / (np.pi * 6e-3**2) + 2.0 * 6e-3 / (np.pi * 6e-3**4 / 4.0)
    assert found.von_mises == pytest.approx(expected, rel=0.02)
    assert found.factor == pytest.approx(235e6 / found.von_mises)
    assert found.at[2] == pytest.approx(6e-3, rel=0.05)
    write_stress((found,), tmp_path)
    field = meshio.read(tmp_path / "stress.vtu")
    bar = 1000.0 / (np.pi * 6e-3**2) + 2.0 * field.points[:, 2] / (
        np.pi * 6e-3**4 / 4.0
    )
    middle = np.abs(field.points[:, 0] - 0.03) < 0.01
    np.testing.assert_allclose(
        field.point_data["von_mises"][middle], np.abs(bar[middle]), atol=0.03 * expected
    )
    assert (tmp_path / "stress.png").stat().st_size > 10_000
