"""Published datasets converted: the robot file has the authors' geometry, the campaign their readings."""

from dataclasses import replace

import numpy as np
import pytest
import yaml
from scipy.io import savemat

from examples.measured import dropbear, hilti
from examples.measured.arm import write_positions
from examples.measured.ladder import fit_ladder
from examples.measured.motoman import ARMS, JOINTS, convert
from stiffscope.gap.campaign.readings import load_campaign, match_robot
from stiffscope.gap.campaigns import diagnose, open_case
from stiffscope.gap.forward.placing import align_points
from stiffscope.robot.mechanism_of import rigid_mechanism
from stiffscope.robot.reader import load_robot
from stiffscope.vjm.kinematics.configurations import configure_drives
from stiffscope.vjm.model.screws import rotation_of


@pytest.mark.parametrize("side", ["left", "right"])
def test_a_dataset_is_converted(side, tmp_path):
    """Twelve postures, each named twice; one is not seen, one is not a number."""
    rng = np.random.default_rng(4)
    arm = ARMS[side]
    angles = np.array([-0.2, 0.8, -0.6, 1.7, 0.3, 1.5]) + rng.uniform(
        -0.3, 0.3, (12, 6)
    )
    turn = rotation_of(np.array([0.2, -2.0, 1.5]))
    origin = np.array([-3.0, 2.0, 1.0])
    seen = (np.array([arm.target_at(each) for each in angles]) - origin) @ turn
    table = np.zeros((12, 26))
    table[:, 0] = np.arange(12)
    table[:, JOINTS[side]] = angles
    table[:, 19:22] = seen
    table[3, 19:22] = 0.0
    table[7, 19:22] = np.nan
    savemat(tmp_path / "d.mat", {"dataset": np.repeat(table, 2, axis=0)})
    found = convert(tmp_path / "d.mat", side, tmp_path / "out")
    assert found["postures"] == 10
    assert found["rms"] < 1e-12
    robot = load_robot(tmp_path / "out" / "fit" / "robot.toml")
    campaign = load_campaign(tmp_path / "out" / "fit", robot)
    assert (len(campaign), len(campaign.poses)) == (24, 8)
    assert len(load_campaign(tmp_path / "out" / "held-out", robot)) == 6
    kept = [k for k in range(12) if k not in (3, 7)]
    assert campaign.value.reshape(-1, 3) == pytest.approx(
        seen[[kept[k] for k in (0, 1, 2, 3, 5, 6, 7, 8)]]
    )
    tool = configure_drives(rigid_mechanism(robot), campaign.poses).tool[:, :3]
    flange = [arm.frames(angles[kept[k]])[-1, :3, 3] for k in (0, 1, 2, 3, 5, 6, 7, 8)]
    assert tool == pytest.approx(
        np.array(flange), abs=1e-8
    )  # the file has nine decimals


def test_an_instrument_is_placed_at_any_rotation():
    rng = np.random.default_rng(1)
    nominal = rng.standard_normal((9, 3))
    turn = rotation_of(np.array([1.0, 2.5, -1.5]))
    found, origin = align_points((nominal - [1.0, 2.0, 3.0]) @ turn, nominal)
    assert found == pytest.approx(turn)
    assert origin == pytest.approx([1.0, 2.0, 3.0])


def _urdf():
    """A chain of three slides, as the authors' file has them, six hinges and a prism; every link weighs 2 kg."""
    names = [
        "base_link",
        "column_middle",
        "column_top",
        *(f"dsr_link{k}" for k in range(1, 7)),
        "prism",
    ]
    rows = [
        *(("prismatic", f"column_{n}_joint", "0 0 1") for n in ("middle", "top")),
        *(
            ("revolute", f"dsr_joint{k}", "0 1 0" if k % 2 else "1 0 0")
            for k in range(1, 7)
        ),
        ("fixed", "prism_calib", "1 0 0"),
    ]
    inertia = '<mass value="2"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/>'
    links = [
        f'<link name="{n}"><inertial>{inertia}</inertial></link>'
        for n in [*names[:-1], "column_pseudo_tip"]
    ]
    chain = zip(
        ["column_prismatic_joint", *(r[1] for r in rows)],
        ["prismatic", *(r[0] for r in rows)],
        ["0 0 1", *(r[2] for r in rows)],
        ["base_link", *names[:-1]],
        ["column_pseudo_tip", *names[1:]],
        strict=True,
    )
    joints = [
        f'<joint name="{n}" type="{kind}"><origin xyz="0 0 0.2"/><parent link="{a}"/><child link="{b}"/>'
        f'<axis xyz="{axis}"/><limit lower="-4" upper="4" effort="1" velocity="1"/></joint>'
        for n, kind, axis, a, b in chain
    ]
    return (
        f'<robot name="r">{"".join(links)}<link name="prism"/>{"".join(joints)}</robot>'
    )


def test_tilts_and_prisms_are_converted(tmp_path):
    """Six postures at one height; an accelerometer that turned with its body reads up in that body's axes."""
    (tmp_path / "datasets").mkdir()
    (tmp_path / "trailblazer.urdf").write_text(_urdf())
    rng = np.random.default_rng(2)
    turns = 1e-4 * np.arange(24.0).reshape(6, 2, 2)  # posture, body, about x and y
    up = np.array(
        [
            [9.81 * rotation_of(np.array([*each, 0.0])).T[:, 2] for each in both]
            for both in turns
        ]
    )
    arms = rng.uniform(-0.5, 0.5, (6, 6))
    prisms = rng.uniform(-1.0, 1.0, (6, 3))
    rows = [
        {
            "joint_states": [2.0, *arms[k].tolist()],
            "tilt_sensor_base_accel": up[k, 0].tolist(),
            "tilt_sensor_column_accel": up[k, 1].tolist(),
            "prism_position": prisms[k].tolist(),
        }
        for k in range(6)
    ]
    station = {"stationing_measurements": rows[:2], "evaluation_measurements": rows[2:]}
    heights = {"column_heights": {2.0: {"solution_spaces": {"a": station}}}}
    (tmp_path / "datasets" / "flat.yaml").write_text(yaml.safe_dump(heights))
    assert hilti.convert(tmp_path, "flat", 2.0, tmp_path / "out") == 6
    robot = load_robot(tmp_path / "out" / "fit" / "robot.toml")
    campaign = load_campaign(tmp_path / "out" / "fit", robot)
    kept = [0, 1, 2, 3, 5]
    read = campaign.value.reshape(5, 7)
    assert read[:, :4] == pytest.approx(
        turns[kept].reshape(5, 4), abs=1e-7
    )  # up to cubes of 2.3 mrad
    assert read[:, 4:] == pytest.approx(prisms[kept])
    assert campaign.poses == pytest.approx(
        np.hstack([np.zeros((5, 2)), arms[kept] - arms[0]])
    )
    assert robot.tolerances[("bodies", "dsr_link3", "mass")] == pytest.approx(0.04)
    assert len(load_campaign(tmp_path / "out" / "held-out", robot)) == 7


def beam_of_elements(pin, count=60):
    """First frequency of the pinned cantilever by Hermite elements, with its nodes at the pin."""
    cut = max(round(count * pin / dropbear.LENGTH), 1)
    nodes = np.concatenate(
        [
            np.linspace(0.0, pin, cut + 1),
            np.linspace(pin, dropbear.LENGTH, count - cut + 1)[1:],
        ]
    )
    stiff, mass = np.zeros((2, 2 * len(nodes), 2 * len(nodes)))
    for k, h in enumerate(np.diff(nodes)):
        at = slice(2 * k, 2 * k + 4)
        s = np.diag([1.0, h, 1.0, h])
        bend = [[12, 6, -12, 6], [6, 4, -6, 2], [-12, -6, 12, -6], [6, 2, -6, 4]]
        move = [[156, 22, 54, -13], [22, 4, 13, -3], [54, 13, 156, -22]]
        move.append([-13, -3, -22, 4])
        stiff[at, at] += s @ np.array(bend) @ s / h**3
        mass[at, at] += s @ np.array(move) @ s * h / 420.0
    free = [k for k in range(2 * len(nodes)) if k not in (0, 1, 2 * cut)]
    chosen = np.ix_(free, free)
    square = np.linalg.eigvals(np.linalg.solve(mass[chosen], stiff[chosen])).real.min()
    wave = dropbear.YOUNG * dropbear.THICKNESS**2 / (12.0 * dropbear.DENSITY)
    return np.sqrt(square * wave) / (2.0 * np.pi)


@pytest.mark.parametrize("pin", [0.048, 0.11, 0.168])
def test_a_pinned_cantilever_vibrates_as_its_elements(pin):
    assert dropbear.first_frequency(pin) == pytest.approx(
        beam_of_elements(pin), rel=1e-6
    )


def test_a_roller_whose_place_is_wrong_is_named(tmp_path):
    """Frequencies of a beam whose roller is 7 mm farther out: converted, diagnosed, judged."""
    places = np.linspace(*dropbear.TRAVEL, dropbear.PLACES)
    true = dropbear.predict(places, {dropbear.PLACE: 7e-3})
    rests = [dropbear.Rest(p, f, 1e-3 * f) for p, f in zip(places, true, strict=True)]
    dropbear.convert(rests, tmp_path)
    found = diagnose(tmp_path)
    assert [effect.place for effect in found.effects] == [dropbear.PLACE]
    change = found.effects[0].parameters["change"]
    assert abs(change.value - 7e-3) < 3.0 * change.sigma


def test_postures_are_labelled_in_degrees(tmp_path):
    """Drives that turn: labels in degrees, to a hundredth, once the robot tells what they are."""
    arm = ARMS["left"]
    home = np.array([-0.2, 0.8, -0.6, 1.7, 0.3, 1.5])
    angles = home + np.radians([[1.0, 2.0, 3.0, -4.0, 5.0, 6.254]])
    seen = np.array([arm.target_at(angles[0])])
    write_positions(arm, tmp_path, home, angles, seen, sigma=1e-5, at_sigma=0.01)
    case = open_case(tmp_path)
    matched = match_robot(case.campaign, case.robot)
    assert matched.pose_names == ("(1, 2, 3, -4, 5, 6.25 deg)",)


def test_the_ladder_ends_where_planted_errors_of_axes_are_found():
    """Positions of an arm with a wrong zero and a wrong axis: zeros leave a rest, axes none."""
    rng = np.random.default_rng(2)
    arm = ARMS["left"]
    home = np.array([-0.2, 0.8, -0.6, 1.7, 0.3, 1.5])
    angles = home + rng.uniform(-0.6, 0.6, (25, 6))
    rows = list(arm.rows)
    rows[1] = (rows[1][0], rows[1][1], rows[1][2] + 1e-3, rows[1][3])
    rows[2] = (*rows[2][:3], rows[2][3] + 2e-3)
    true = replace(arm, rows=tuple(rows))
    seen = np.array([true.target_at(each) for each in angles])
    left = {name: fitted for name, fitted, _ in fit_ladder(arm, angles, seen)}
    assert left["+ zeros"] > 1e-5
    assert left["+ axes"] < 1e-8
