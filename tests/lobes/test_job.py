"""Stability of a job's cut: the robot's response, holders, causes, files and refusals."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from stiffscope.cli.main import cli
from stiffscope.design.making import identify
from stiffscope.design.studies import study
from stiffscope.design.study_reading import load_study
from stiffscope.errors import InputError
from stiffscope.experiments.assembly import assemble_robots
from stiffscope.live.page import Setting, answer
from stiffscope.lobes.chatter import (
    critical_along,
    find_lobes,
    respond,
    speed_range,
    stretch_of,
)
from stiffscope.lobes.cutting import cutting_of
from stiffscope.lobes.damping import damping_of, pair_damping
from stiffscope.lobes.engagement import one_direction
from stiffscope.lobes.holder import HolderModes, find_holder_modes
from stiffscope.lobes.levers import find_levers
from stiffscope.lobes.response import couple_holder
from stiffscope.lobes.zero_order import find_critical
from stiffscope.path.cutting import mill
from stiffscope.path.job import load_job
from stiffscope.robot.parameters import parameters
from stiffscope.runtime.workshop import workshop
from stiffscope.vjm.kinematics.configurations import configure
from stiffscope.vjm.statics.analysis import compliance
from stiffscope.vjm.vibration.frequency_response import Port, frequency_response
from tests.lobes.machines import spring_mass

pytestmark = pytest.mark.slow

MILLING = {
    "kt": '"700 N/mm^2"',
    "kr": "0.3",
    "diameter": '"10 mm"',
    "teeth": "4",
    "speed": '"12000 rpm"',
    "depth": '"0.5 mm"',
    "width": '"10 mm"',
}
LOBES = {"damping": "0.03", "points": "40", "speeds": '["6000 rpm", "18000 rpm"]'}
PLACES = ("0.56,0.10", "0.58,0.10", "0.58,0.12")
PATH = "x,y,z,rx,ry,rz,feed\n" + "".join(f"{at},0.15,0,0,0,0.01\n" for at in PLACES)
STUDY = (
    'robot = "serial-arm"\ncomponents = "beam"\nmethod = "grid"\n'
    'parameters = { "joints.J1.drive.stiffness" = { values = ["25 kN*m/rad"] } }\n'
    'responses = { depth = { of = "critical_depth", path = "job.toml" } }\n'
)


def _write(folder, milling=None, lobes=None, robot="serial-arm", path=PATH):
    """Write a job with keys changed, or left out where they are None; return its file."""
    lines = [f'robot = "{robot}"', 'components = "beam"', 'path = "path.csv"']
    sections = {
        "process.milling": MILLING | (milling or {}),
        "lobes": LOBES | (lobes or {}),
    }
    for name, keys in sections.items():
        lines.append(f"[{name}]")
        lines += [f"{key} = {text}" for key, text in keys.items() if text is not None]
    (folder / "path.csv").write_text(path)
    file = folder / "job.toml"
    file.write_text("\n".join(lines) + "\n")
    return file


def _load(file):
    job = load_job(file)
    with workshop() as shop:
        robots = {"robot": job.robot}
        return job, assemble_robots(robots, job.section.components, shop)["robot"]


@pytest.fixture
def arm(tmp_path):
    return _load(_write(tmp_path))


def test_the_response_is_the_robots_own(arm):
    job, made = arm
    stretch = stretch_of(job, made)
    response, _ = respond(made, stretch.found, stretch.axes, damping_of(job, made))
    hertz = np.array([5.0, 21.0, 40.0, 160.0])
    omega = np.tile(2.0 * np.pi * hertz, (len(stretch.points), 1))
    found = response.receptance(omega)
    for k in range(len(stretch.points)):
        ports = [
            Port(None, stretch.tool[k, :3], np.concatenate([axis, np.zeros(3)]))
            for axis in stretch.axes[k]
        ]
        one = stretch.found[np.array([k])]
        # of the pose: home coordinates of M
        ports = [
            Port(None, np.array(made.mechanism.tool.at), port.direction)
            for port in ports
        ]
        for i, target in enumerate(ports):
            for j, source in enumerate(ports):
                full = frequency_response(
                    made.mechanism, one, source, target, hertz, damping=0.03
                )
                scale = np.abs(found[k]).max()
                assert found[k, :, i, j] == pytest.approx(full, abs=2e-3 * scale)
    still = response.receptance(np.full((len(stretch.points), 1), 1e-3))[:, 0]
    soft = stretch.axes @ compliance(made.mechanism, stretch.found)[:, :3, :3]
    soft = soft @ stretch.axes.mT
    assert still.real == pytest.approx(soft, abs=1e-5 * soft.max())


def _one_mode(square, damping, stiffness):
    return HolderModes(
        squares=np.array([square]),
        damping=np.array([damping]),
        stiffness=np.array([[stiffness, np.inf, np.inf]]),
        remainder=np.zeros(3),
    )


def test_a_stiff_holder_changes_nothing_and_a_heavy_one_couples_exactly():
    robot = spring_mass(1e7, 100.0, 0.03)
    stiff = couple_holder(robot, _one_mode((6e7 * np.pi) ** 2, 0.01, 1e12))
    omega = np.array([[600.0, 628.0, 700.0]])
    assert stiff.receptance(omega)[0, :, 0, 0] == pytest.approx(
        robot.receptance(omega)[0, :, 0, 0], rel=1e-4
    )
    # two springs and masses in a row, without damping: G at the tip in closed form
    free = spring_mass(1e7, 100.0, 1e-9)
    stiffness = 4e6
    rate = 2.0 * np.pi * 150.0
    both = couple_holder(free, _one_mode(rate**2, 1e-9, stiffness))
    at = np.array([[300.0, 800.0, 1500.0]])
    own = free.receptance(at)[0, :, 0, 0]
    mass = stiffness / rate**2
    closed = (1.0 + own * stiffness) / (
        stiffness - at[0] ** 2 * mass * (1.0 + own * stiffness)
    )
    assert both.receptance(at)[0, :, 0, 0] == pytest.approx(closed, rel=1e-6)


def test_the_force_of_a_material_is_linearized_at_the_chip_of_the_process(tmp_path):
    given = {"kt": None, "kr": None, "width": '"3 mm"', "material": '"C45E"'}
    job = load_job(_write(tmp_path, given))
    found = cutting_of(job)
    cut = {"diameter": 0.01, "teeth": 4, "speed": 200.0, "depth": 5e-4, "width": 3e-3}
    power = [
        mill(2.22e9, 0.14, feed=0.01 * share, **cut).power for share in (0.999, 1.001)
    ]
    # power over feed, depth and width is force over area; its derivative by the feed
    slope = (power[1] - power[0]) / (0.002 * 0.01 * 5e-4 * 3e-3)
    assert found.cut.stiffness == pytest.approx(slope, rel=1e-5)


@pytest.mark.extended
def test_levers_are_derivatives_of_the_limit(arm):
    job, made = arm
    stretch = stretch_of(job, made)
    cutting = cutting_of(job)
    speeds = speed_range(job, cutting)
    one = np.array([0])

    def limit(assembled):
        found = configure(assembled.mechanism, stretch.found[one].poses)
        response, _ = respond(
            assembled, found, stretch.axes[one], damping_of(job, assembled)
        )
        return found, response, find_critical(response, cutting.cut, speeds)

    found, response, critical = limit(made)
    levers = find_levers(
        made.mechanism,
        found,
        response,
        couple=lambda each: each,
        cut=cutting.cut,
        axes=stretch.axes[0],
        speed=critical.speed[0],
        method="zero-order",
    )
    by_name = {lever.element: lever.per_cent for lever in levers}
    for parameter in parameters(job.robot, "beam"):
        joint, _, key = parameter.name.partition(".")
        if key != "drive.stiffness":
            continue
        depths = []
        for share in (1.001, 0.999):
            robot = parameter.set_to(job.robot, share * parameter.value)
            with workshop() as shop:
                changed = assemble_robots({"robot": robot}, "beam", shop)["robot"]
            depths.append(limit(changed)[2].depth[0])
        change = (depths[0] - depths[1]) / 0.002 / critical.depth[0]
        assert by_name[joint] == pytest.approx(change, abs=0.02)


def test_study_and_path_have_the_same_critical_depth(tmp_path, arm):
    job, made = arm
    depth = critical_along(job, made)
    assert len(depth) == len(job.path)
    (tmp_path / "study.toml").write_text(STUDY)
    table = study(tmp_path / "study.toml").table
    assert float(table["depth [m]"].iloc[0]) == pytest.approx(depth.min(), rel=1e-9)


def test_live_shows_the_stable_depth(arm):
    job, made = arm
    pose = tuple(made.mechanism.tool.home)
    asked = Setting({}, pose, (0.0,) * 6)
    assert "Stable depth of cut" not in str(answer(made, asked)["tables"])
    assert "Stable depth of cut" in str(answer(made, asked, job)["tables"])


def test_the_command_writes_lobes_at_poses_and_along_the_path(tmp_path):
    file = _write(tmp_path)
    out = tmp_path / "out"
    cli(
        ["lobes", str(file), "--at", "home", "--out", str(out), "--quiet"],
        standalone_mode=False,
    )
    found = json.loads((out / "lobes.json").read_text())
    assert found["names"] == ["home"]
    assert np.shape(found["depth"]) == np.shape(found["error"]) == (1, 40)
    assert found["speed"][0] == pytest.approx(6000.0)
    assert sum(found["cause"].values()) == pytest.approx(1.0, abs=1e-6)
    assert found["critical_depth"][0] <= min(found["depth"][0]) * 1.001
    for name in ("lobes.png", "margin.png", "path.csv", "lobes.csv", "report.html"):
        assert (out / name).stat().st_size > 500


def test_measured_damping_is_that_of_the_nearest_mode(tmp_path):
    (tmp_path / "modes.csv").write_text("frequency,zeta\n20,0.05\n200,0.01\n")
    file = _write(tmp_path, lobes={"damping": '"measured"', "measured": '"modes.csv"'})
    job, made = _load(file)
    stretch = stretch_of(job, made)
    response, shaken = respond(made, stretch.found, stretch.axes, damping_of(job, made))
    near = np.where(shaken.frequencies < np.sqrt(20.0 * 200.0), 0.05, 0.01)
    assert response.damping == pytest.approx(near)


@pytest.mark.parametrize(
    ("milling", "lobes", "said"),
    [
        ({}, {"damping": None}, "job.toml:12: lobes.damping: expected a ratio"),
        ({}, {"damping": "0"}, "lobes.damping: expected a damping ratio"),
        ({}, {"damping": '"measured"'}, "expected a table or a campaign"),
        ({"teeth": "0"}, {}, "teeth: expected 1 to 1000"),
        (
            {"width": '"11 mm"'},
            {},
            "width: expected at most the diameter, 10 mm, got 11 mm",
        ),
        ({"material": '"C45E"'}, {}, "material: expected none beside kt, got one"),
        ({"radial": "0.2"}, {}, "radial: expected none beside kr, got one"),
        ({}, {"speeds": '["9000 rpm", "900 rpm"]'}, "speeds: expected a lower and"),
        ({}, {"damp": "0.1"}, "expected a known key (damping, "),
        ({"kt": '"0 N/mm^2"'}, {}, "process.milling.kt: expected"),
        ({"speed": '"0 rpm"'}, {}, "process.milling.speed: expected"),
        ({"depth": '"-1 mm"'}, {}, "process.milling.depth: expected"),
        ({}, {"damping_error": "2"}, "lobes.damping_error: expected"),
    ],
)
def test_bad_input_is_one_line(tmp_path, milling, lobes, said):
    with pytest.raises(InputError) as caught:
        find_lobes(*_load(_write(tmp_path, milling, lobes)))
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)
    assert "job.toml" in str(caught.value)


TURNING = (
    '[process.turning]\nkt = "1500 N/mm^2"\nkr = 0.4\ndiameter = "60 mm"\n'
    'speed = "1200 rpm"\ndepth = "1 mm"\nlead = "75 deg"\n'
)


def _write_turning(folder, text=TURNING):
    file = _write(folder)
    written = file.read_text()
    kept = written.partition("[process.milling]")[0]
    lobes = "[lobes]" + written.partition("[lobes]")[2].partition("speeds")[0]
    file.write_text(kept + text + lobes)
    return file


def test_turning_is_an_edge_in_one_direction(tmp_path):
    job, made = _load(_write_turning(tmp_path))
    cutting = cutting_of(job)
    assert not cutting.cut.interrupted
    found = find_lobes(job, made)
    assert found.method == "zero-order"
    # chip along n, force along c: b = 1 / (2 K max Re(nᵀ G c)) over the range of speeds at least
    stretch = stretch_of(job, made)
    response, _ = respond(made, stretch.found, stretch.axes, damping_of(job, made))
    lead = np.deg2rad(75.0)
    chip = np.array([np.sin(lead), 0.0, -np.cos(lead)])
    force = np.array([0.0, 1.0, 0.0]) / np.sin(lead) - 0.4 * chip / np.sin(lead)
    omega = np.tile(2.0 * np.pi * np.linspace(1.0, 400.0, 40_000), (len(chip), 1))
    soft = np.einsum("i,nfij,j->nf", chip, response.receptance(omega), force)
    least = 0.5 / (1.5e9 * soft.real.max(axis=1))
    assert (found.along.critical.depth > least * 0.999).all()
    assert found.along.critical.depth == pytest.approx(least, rel=0.02)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (('"1 mm"', '"31 mm"'), "turning: depth: expected at most half the diameter"),
        (('"75 deg"', '"0 deg"'), "process.turning.lead: expected"),
        (("kr = 0.4", 'towards = "up"'), "process.turning.towards: expected"),
    ],
)
def test_bad_turning_is_one_line(tmp_path, change, said):
    with pytest.raises(InputError) as caught:
        _load(_write_turning(tmp_path, TURNING.replace(*change)))
    assert said.split(": ")[-1] in str(caught.value)
    assert "\n" not in str(caught.value)


HOLDER = ((900.0, 0.02, 8e6), (1900.0, 0.03, 2e7))  # Hz, ratio, N/m


def _write_holder(folder, sign=1.0):
    """Write a table of the accelerance of a clamped holder, computed from its modes."""
    hertz = np.linspace(200.0, 3000.0, 1400)
    omega = 2.0 * np.pi * hertz
    whole = np.zeros(len(hertz), dtype=complex)
    for frequency, damping, stiffness in HOLDER:
        ratio = hertz / frequency
        whole += 1.0 / (stiffness * (1.0 - ratio**2 + 2j * damping * ratio))
    noise = np.random.default_rng(0).normal(size=(2, len(hertz)))
    whole = whole * (1.0 + 0.01 * (noise[0] + 1j * noise[1])) * -sign * omega**2
    table = np.column_stack([hertz, whole.real, whole.imag])
    np.savetxt(
        folder / "holder.csv",
        table,
        delimiter=",",
        header="frequency,H.re,H.im",
        comments="",
    )


def _measured_holder(channel):
    return (
        '[lobes.responses]\nfile = "holder.csv"\nradial = "1:+x"\n'
        f'channels = {{ H = "{channel}" }}\nquantity = "accelerance"\n'
    )


def test_a_measured_holder_is_that_of_its_modes(tmp_path):
    _write_holder(tmp_path)
    file = _write(tmp_path)
    text = file.read_text()
    stated = "".join(
        f'[[lobes.holder]]\nfrequency = "{f} Hz"\nstiffness = "{k} N/m"\n'
        f'damping = {z}\ndirection = "radial"\n'
        for f, z, k in HOLDER
    )
    file.write_text(text + stated)
    job, made = _load(file)
    expected = critical_along(job, made)
    file.write_text(text + _measured_holder("1:+x"))
    job, made = _load(file)
    assert critical_along(job, made) == pytest.approx(expected, rel=0.02)
    file.write_text(text)
    job, made = _load(file)
    assert critical_along(job, made) != pytest.approx(expected, rel=0.05)


@pytest.mark.parametrize(
    ("channel", "sign"), [("1:+x/1:-x", -1.0), ("1:-x/1:+x", -1.0), ("1:-x", 1.0)]
)
def test_a_holder_may_be_hit_against_its_sensor(tmp_path, channel, sign):
    _write_holder(tmp_path, sign)
    file = _write(tmp_path)
    text = file.read_text()
    file.write_text(text + _measured_holder(channel))
    modes = find_holder_modes(load_job(file))
    rows = [row for row in HOLDER for _ in "xy"]
    assert np.sqrt(modes.squares) / (2.0 * np.pi) == pytest.approx(
        [row[0] for row in rows], rel=0.005
    )
    assert modes.stiffness.min(axis=1) == pytest.approx(
        [row[2] for row in rows], rel=0.05
    )


def test_a_holder_that_moves_against_its_force_is_refused(tmp_path):
    _write_holder(tmp_path, -1.0)
    file = _write(tmp_path)
    text = file.read_text()
    file.write_text(text + _measured_holder("1:+x"))
    with pytest.raises(InputError) as caught:
        find_holder_modes(load_job(file))
    assert "lobes.responses.radial: expected motion along the force" in str(
        caught.value
    )
    assert "holder.csv" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_damping_of_a_hammer_campaign_goes_with_the_shapes():
    # the simulated test of the Biglide (make_tap.py) has 2 % in every mode, but for noise
    job = load_job("examples/pocket/lobes-biglide.toml")
    with workshop() as shop:
        robots = {"robot": job.robot}
        made = assemble_robots(robots, "published", shop)["robot"]
    found = pair_damping(Path("examples/hammer"), made)
    assert found[:4] == pytest.approx(0.02, rel=0.05)


@pytest.mark.parametrize("changed", ["campaign.toml", "tap.uff"])
def test_a_study_depends_on_the_files_of_a_hammer_campaign(tmp_path, changed):
    hammer = tmp_path / "hammer"
    hammer.mkdir()
    (hammer / "campaign.toml").write_text(
        'robot = "serial-arm"\n[responses.tap]\nfile = "tap.uff"\npose = "home"\n'
        'points = { 1 = { body = "tool" } }\n'
    )
    (hammer / "tap.uff").write_text("    -1\n")
    _write(tmp_path, lobes={"damping": '"measured"', "measured": '"hammer"'})
    file = tmp_path / "study.toml"
    file.write_text(STUDY)
    before = identify(load_study(file))
    assert identify(load_study(file)) == before
    with (hammer / changed).open("a") as stream:
        stream.write("\n")
    assert identify(load_study(file)) != before


def test_a_map_holds_what_a_pose_gives(tmp_path):
    file = _write(tmp_path, lobes={"points": "20"})
    arguments = ["lobes", str(file), "--map", "--points", "3", "--quiet"]
    out = tmp_path / "out"
    cli([*arguments, "--out", str(out)], standalone_mode=False)
    lines = (out / "map.csv").read_text().splitlines()
    names = lines[0].split(",")
    row = dict(zip(names, map(float, lines[1].split(",")), strict=True))
    job, made = _load(file)
    home = np.array(made.mechanism.tool.home)
    pose = list(made.mechanism.tool.pose)
    for name in pose:
        home[pose.index(name)] = row.get(name, home[pose.index(name)])
    found = configure(made.mechanism, home[None])
    state = find_lobes(job, made, (("here",), found)).at
    assert row["critical_depth"] == pytest.approx(state.critical.depth[0], rel=1e-6)
    assert row["critical_low"] == pytest.approx(state.critical_low[0], rel=1e-6)
    for name in ("depth.png", "map.nc", "report.html"):
        assert (out / name).stat().st_size > 500


def test_a_job_without_the_section_or_the_milling_is_refused(tmp_path):
    file = Path(_write(tmp_path))
    text = file.read_text()
    for cut_off, said in (
        ("[lobes]", "lobes: expected a section"),
        ("[process", "expected [process.milling]"),
    ):
        kept, _, rest = text.partition(cut_off)
        if cut_off != "[lobes]":
            kept += "[lobes]" + rest.partition("[lobes]")[2]
        file.write_text(kept)
        with pytest.raises(InputError, match=said.replace("[", r"\[")):
            find_lobes(*_load(file))


def test_one_direction_of_an_inclined_edge_is_the_projected_response():
    # turning: chip along n, force along c: b = 1 / (2 K max Re(-nᵀ G c))
    response = spring_mass(2e7, 250.0, 0.02)
    normal = (np.cos(0.5), np.sin(0.5), 0.0)
    force = (-np.cos(0.9), -np.sin(0.9), 0.3)
    found = find_critical(response, one_direction(1.5e9, normal, force))
    turned = np.cos(0.5) * np.cos(0.9)
    expected = 4e7 * 0.02 * 1.02 / (1.5e9 * turned)
    assert found.depth[0] == pytest.approx(expected, rel=1e-9)
