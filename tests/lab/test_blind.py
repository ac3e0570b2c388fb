"""The blind check: the withheld campaigns that come along, cases of every robot, the cluster, the scores."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from distributed import LocalCluster
from scipy.spatial.transform import Rotation

from stiffscope.errors import InputError
from stiffscope.gap.campaign.readings import load_campaign
from stiffscope.gap.diagnose import diagnose_campaign
from stiffscope.gap.forward.robot_model import RobotModel
from stiffscope.lab.blind import check as blind
from stiffscope.lab.blind.cases import BlindCase, Fault, unseal
from stiffscope.lab.blind.check import run_blind
from stiffscope.lab.blind.drawing import (
    draw_case,
    is_imitated,
    prepare_case,
    write_case,
)
from stiffscope.lab.blind.laboratory import BlindRobot, Lab, blind_robots
from stiffscope.lab.blind.scores import Outcome, outcome_of, score
from stiffscope.lab.closure import locate
from stiffscope.lab.faults import bearing_words
from stiffscope.lab.measuring import (
    Noise,
    measure,
    sigma_of,
    true_readings,
    write_readings,
)
from stiffscope.lab.signatures import Signatures
from stiffscope.robot.mechanism_of import mechanism_of
from stiffscope.robot.nominal import NominalRobot
from stiffscope.robot.part_matrices import part_matrices
from stiffscope.robot.reader import load_robot, read_robot
from stiffscope.vjm.kinematics.configurations import configure, find_still
from tests.labs import ARM
from tests.robots import nominal_robot

pytestmark = pytest.mark.slow

ROBOT = nominal_robot()
SLOWER = ("biglide", "delta", "orthoglide", "serial-arm", "stewart")
GAUGES = {f"gauge{k}" for k in range(1, 6)}
WITHHELD = Path(__file__).parents[2] / "data" / "withheld"
GANTRY, LINEAR_DELTA = (
    Path(__file__).parents[1] / "vjm" / "robots" / f"{name}.toml"
    for name in ("braced-gantry", "linear-delta")
)
NOTHING = {
    "verdict": "no-gap",
    "effects": [],
    "evidence": 0.0,
    "gap": {"nominal": 1.0, "explained": 1.0, "held_out": 1.0, "noise": 1.0},
}


def blind_robot(name, components="beam"):
    robot = load_robot(name)
    parts = part_matrices(robot, components)
    return BlindRobot(
        NominalRobot(mechanism_of(robot, parts), robot), parts, components
    )


@pytest.fixture(scope="module")
def labs():
    found = {}

    def lab(name):
        if name not in found:
            found[name] = Lab(blind_robot(name), 12)
        return found[name]

    return lab


@pytest.mark.long
def test_the_withheld_campaigns_get_right_answers():
    cases = unseal(WITHHELD)
    right = 0
    for number, case in enumerate(cases):
        diagnosis = diagnose_campaign(
            load_campaign(WITHHELD / f"campaign-{number:03d}"), ROBOT
        )
        truth = {p.name for p in case.faults}
        if case.kind == "none":
            right += diagnosis.verdict == "no-gap"
        elif case.kind == "outside":
            right += diagnosis.verdict != "identified"
        else:
            known = {
                n
                for e in diagnosis.effects
                for n in (f"{e.effect} @ {e.place}", *e.confused_with)
            }
            right += truth <= known
    assert len(cases) == 8
    assert right >= 7


def test_a_laboratory_visits_no_pose_beyond_a_singular_one():
    """A low platform's heads may lie below its feet: the determinant of its six legs has changed its sign there."""
    robot = load_robot(Path(__file__).parents[1] / "vjm" / "robots" / "stewart.toml")
    mechanism = mechanism_of(robot, {})
    lab = Lab(BlindRobot(NominalRobot(mechanism, robot), {}, "beam"), 20)
    feet, heads = (
        np.array([mechanism.joint(f"strut{k}.{end}").at for k in range(1, 7)])
        for end in ("foot", "head")
    )
    home = mechanism.tool.home

    def determinant(pose):
        levers = (heads - home[:3]) @ Rotation.from_rotvec(pose[3:]).as_matrix().T
        legs = pose[:3] + levers - feet
        return np.linalg.det(np.hstack([legs, np.cross(levers, legs)]))

    signs = np.sign([determinant(pose) for pose in lab.workspace.poses])
    assert (signs == np.sign(determinant(home))).all()


@pytest.mark.parametrize("flexure", [False, True])
def test_what_poses_leave_open_stays_at_home_in_the_laboratory_too(flexure):
    """Two drives, or a drive and a flexure, for one coordinate: the model leaves the tool's angle, or the flexure."""
    text = ARM.format(
        kind="revolute", axis="[0, 0, 1]", at="[0.3, 0.2, 0]", pose='["y"]'
    )
    if flexure:
        text = text.replace("drive = { stiffness = 2e5 }", "spring = 2e5")
    robot = read_robot(Path("arm.toml"), text)
    mechanism = mechanism_of(robot, {})
    sound = Lab(BlindRobot(NominalRobot(mechanism, robot), {}, "beam"), 4).sound
    poses = mechanism.tool.home + np.array([[-0.05], [0.0], [0.04]])
    found = locate(sound, poses)
    assert found.closed.all()
    for body in ("upper", "fore"):
        turn, position = configure(mechanism, poses).frame(body)
        assert found.frames.rotation[body] == pytest.approx(turn, abs=1e-9)
        assert found.frames.position[body] == pytest.approx(position, abs=1e-9)
    assert np.abs(found.frames.rotation["upper"] - np.eye(3)).max() > 0.05


def test_what_merely_spins_or_bends_one_way_is_not_held_in_the_laboratory():
    """Struts that slide and spin, as one joint, and a universal joint with springs, of which one motion is left."""
    file = Path(__file__).parents[1] / "vjm" / "robots" / "stewart.toml"
    text = file.read_text().replace('type = "prismatic"', 'type = "cylindrical"')
    hexapod = mechanism_of(read_robot(file, text), {})
    assert not find_still(hexapod)[0]
    text = ARM.format(
        kind="revolute", axis="[0, 0, 1]", at="[0.3, 0.2, 0]", pose='["y", "z"]'
    )
    elbow = 'type = "revolute"\nat = [0.3, 0, 0]\naxis = [0, 0, 1]\ndrive = { stiffness = 2e5 }'
    assert elbow in text
    bent = 'type = "universal"\nat = [0.3, 0, 0]\naxis = [0, 0, 1]\naxis2 = [1, 0, 0]\nspring = 2e5'
    robot = read_robot(Path("arm.toml"), text.replace(elbow, bent))
    mechanism = mechanism_of(robot, {})
    sound = Lab(BlindRobot(NominalRobot(mechanism, robot), {}, "beam"), 4).sound
    assert locate(
        sound, mechanism.tool.home + np.array([[-0.05, 0.02], [0.03, -0.04]])
    ).closed.all()


@pytest.mark.extended
@pytest.mark.parametrize(
    "name", ["five-bar", *(pytest.param(n, marks=pytest.mark.long) for n in SLOWER)]
)
def test_cases_of_any_robot_are_written_and_named(name, labs, tmp_path):
    """One of each kind and way of measuring: its columns, its sensors, places of the robot's own, finite readings."""
    lab = labs(name)
    robot = lab.robot.nominal.robot
    for number, style in (
        (3, "tool"),
        (15, "gauges"),
        (58, "sag"),
        (9, "tool"),
        (63, "tracker"),
    ):
        case = draw_case(number, 4, lab)
        assert case.style == style
        assert case == draw_case(number, 4, lab) != draw_case(number, 5, lab)
        for fault in case.faults:
            assert (
                robot.members(fault.place)
                or fault.place.split(".")[0]
                in {*robot.parts, "base", "tool", "instrument", "robot", *GAUGES}
                or "->" in fault.place
            )
        folder = tmp_path / str(number)
        write_case(folder, number, case, lab)
        header = tomllib.loads((folder / "campaign.toml").read_text())
        assert header["robot"] == name
        rows = [
            line.split(",")
            for line in (folder / "readings.csv").read_text().splitlines()
        ]
        assert tuple(rows[0][: len(robot.tool.pose)]) == tuple(robot.tool.pose)
        targets = {"smr1", "smr2", "smr3"} if style == "tracker" else set()
        assert set(header.get("sensors", {})) == (
            GAUGES if style == "gauges" else targets
        )
        values = np.array([float(row[rows[0].index("value")]) for row in rows[1:]])
        assert np.isfinite(values).all()
        assert len({len(row) for row in rows}) == 1


def test_a_dimension_is_planted_as_the_part_of_that_dimension(labs):
    lab = labs("delta")
    thinner = lab.with_faults(
        [Fault("part-dimension", "rod.radius", {"value": 0.0075})]
    )
    area = np.pi * np.array([0.008**2 - 0.0065**2, 0.0075**2 - 0.0065**2])
    c = [m.bodies["leg3.rod2"].compliance[0, 0] for m in (lab.sound, thinner)]
    assert c[1] / c[0] == pytest.approx(area[0] / area[1])
    assert np.array_equal(
        thinner.bodies["leg1.arm"].compliance, lab.sound.bodies["leg1.arm"].compliance
    )


def test_a_joint_without_an_axis_yields_alike_as_the_model_has_it(labs, tmp_path):
    """Ball joints of a Delta's rods, in the laboratory and in the model of the diagnosis."""
    lab = labs("delta")
    sound = BlindCase("single", 7, (), "gauges")
    machine, plan, located, rng = prepare_case(sound, 0, lab)
    readings = measure(machine, plan, Noise(), rng, located)
    write_readings(
        readings, tmp_path, robot="delta", pose=machine.pose, components="beam"
    )
    model = RobotModel(load_campaign(tmp_path), lab.robot.nominal)
    fault = Fault("joint-compliance", "leg1.rod1.end", {"radial": 2e-7})
    soft = next(c for c in model.library if c.name == fault.name)
    assert (
        soft.names == ("radial",) == bearing_words([lab.sound.joints["leg1.rod1.end"]])
    )
    lab_has = [
        true_readings(m, plan, located).value
        for m in (lab.sound, lab.with_faults([fault]))
    ]
    expected = model.predict(((soft, (2e-7,)),)).values - model.predict().values
    assert lab_has[1] - lab_has[0] == pytest.approx(
        expected, abs=1e-3 * np.abs(expected).max()
    )


@pytest.mark.parametrize(
    ("name", "place"), [("delta", "leg1.motor"), ("five-bar", "left.elbow")]
)
def test_what_a_mislaid_axis_does_is_known_to_the_judge_and_to_the_model(
    name, place, labs, tmp_path
):
    """Of unloaded readings: columns of the laboratory and of the diagnosis against a step in the laboratory."""
    lab = labs(name)
    sound, plan, located, _ = prepare_case(BlindCase("single", 7, (), "tool"), 0, lab)
    rows = true_readings(sound, plan, located)
    judged = Signatures(sound, plan, located, rows, Noise())
    parameters = {"y": 1e-5, "z": -2e-5, "ry": 3e-5, "rz": -1e-5}
    model, change = read_in_the_laboratory(
        name, Fault("joint-axis", place, parameters), tmp_path, lab
    )
    still = model.campaign.shows_rest
    own = (
        judged.find_columns("joint-axis", place, {})
        @ np.array(list(parameters.values()))
        * judged.sigma
    )
    known = next(c for c in model.library if c.name == f"joint-axis @ {place}")
    expected = model.predict().columns(known) @ np.array(
        [parameters[n] for n in known.names]
    )
    assert own[still] == pytest.approx(
        change[still], abs=2e-3 * np.abs(change[still]).max()
    )
    assert expected[still] == pytest.approx(
        change[still], abs=2e-3 * np.abs(change[still]).max()
    )


@pytest.mark.extended_for("15-gauges", "66-tracker")
@pytest.mark.parametrize(
    ("number", "style"), [(0, "tool"), (3, "tool"), (15, "gauges"), (66, "tracker")]
)
def test_what_is_drawn_shows_beside_whatever_the_others_do(number, style, labs):
    """By least squares on the laboratory's own readings, with steps of the others' parameters."""
    lab = labs("five-bar")
    case = draw_case(number, 11, lab)
    assert case.style == style
    sound, plan, located, _ = prepare_case(replace(case, faults=()), number, lab)
    rows = true_readings(sound, plan, located)
    sigma = sigma_of(rows, Noise())

    def seen(fault):
        return (
            true_readings(lab.with_faults([fault]), plan, located).value - rows.value
        ) / sigma

    for fault in case.faults:
        others = [other for other in case.faults if other is not fault]
        steps = [
            replace(o, parameters={**o.parameters, k: 1.1 * v})
            for o in others
            for k, v in o.parameters.items()
        ]
        columns = (
            np.stack([seen(each) for each in (*others, *steps)], axis=1)
            if others
            else np.zeros((len(sigma), 0))
        )
        left = (
            seen(fault) - columns @ np.linalg.lstsq(columns, seen(fault), rcond=1e-9)[0]
        )
        assert np.linalg.norm(left) > 7.5


@pytest.mark.extended_for(
    "tool-biglide",
    "tool-orthoglide",
    "tool-stewart",
    "tracker-delta",
    "gauges-orthoglide",
    "gauges-stewart",
    "tracker-orthoglide",
    "tracker-stewart",
)
@pytest.mark.parametrize("name", ["five-bar", *SLOWER])
@pytest.mark.parametrize("style", ["tool", "gauges", "tracker"])
def test_the_laboratory_plants_whatever_the_model_has_a_share_for(
    name, style, labs, tmp_path
):
    """Every effect at every place: a word's share is divided by its places, of which none may be in vain."""
    lab = labs(name)
    write_case(tmp_path, 0, BlindCase("none", 7, (), style), lab)
    model = RobotModel(load_campaign(tmp_path), lab.robot.nominal)
    known = {
        lab.canonical(each)
        for c in model.library
        if not c.is_nuisance
        for each in c.signature_of
    }
    known = {
        each for each in known if not each.startswith("geometry")
    }  # the laboratory has no such fault yet, nor springs that carry the weight
    known -= {lab.canonical("mass @ robot")}
    assert (
        known
        - set(lab.everywhere(tuple(sensor.name for sensor in model.campaign.sensors)))
        == set()
    )


def test_a_matrix_is_planted_in_bodies_of_one_part(labs):
    lab = labs("five-bar")
    assert "bars" in lab.places("link-stiffness")
    assert set(lab.places("part-compliance")) >= {"inner", "outer", "left.inner"}
    assert "bars" not in lab.places("part-compliance")


def test_rigid_ends_are_planted_in_uniform_bodies(labs):
    """The columns of the gantry's head have the matrix of a longer one."""
    lab = labs(GANTRY)
    assert {
        name for place in lab.places("rigid-ends") for name in lab.sound.members(place)
    } == {"c1", "c2"}


def test_effects_that_the_file_carries_are_in_its_machine():
    robot = blind_robot("five-bar")
    from stiffscope.robot.file.sections import Effect

    soft = Effect(
        effect="actuator-stiffness", place="left.motor", parameters={"factor": 0.5}
    )
    file = replace(robot.nominal.robot, effects=(soft,))
    lab = Lab(
        BlindRobot(NominalRobot(robot.nominal.mechanism, file), robot.parts, "beam"), 4
    )
    assert lab.sound.joints["left.motor"].drive.stiffness == pytest.approx(2500)


@pytest.fixture
def scheduler():
    with LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None
    ) as local:
        yield local.scheduler_address


@pytest.mark.extended
def test_an_interrupted_check_goes_on_and_ends_the_same(
    scheduler, tmp_path, monkeypatch
):
    solved = []

    def answer(robot, folder, left_out):
        solved.append(
            (folder / "campaign.toml").is_file() and not (folder / "seal.txt").exists()
        )
        return NOTHING

    monkeypatch.setattr(blind, "_diagnose", answer)
    robots = [blind_robot("five-bar"), blind_robot("serial-arm")]
    whole = run_blind(tmp_path / "a", robots, 8, 3, scheduler=scheduler)
    assert len(whole.outcomes) == 2 * (
        8 + 3
    )  # three singles each, once more without their effect
    assert all(solved)
    assert whole.false_alarms == 0.0
    assert set(whole.by_robot()) == {"five-bar", "serial-arm"}
    files = {p.name for p in (tmp_path / "a" / "five-bar" / "campaign-000").iterdir()}
    assert files == {
        "campaign.toml",
        "readings.csv",
        "seal.txt",
        "diagnosis.json",
        "diagnosis-without.json",
        "outcome.json",
    }
    run_blind(tmp_path / "b", robots, 4, 3, scheduler=scheduler)
    shutil.rmtree(tmp_path / "b" / "five-bar" / "campaign-002")
    solved.clear()
    again = run_blind(tmp_path / "b", robots, 8, 3, scheduler=scheduler)
    assert (
        len(solved) == 2 * 4 + 2
    )  # the other four of each, and the one that was lost, with and without
    assert again == whole
    kinds = [case.kind for case in unseal(tmp_path / "b" / "serial-arm")]
    assert kinds == [o.kind for o in whole.outcomes[:11] if not o.left_out]
    with pytest.raises(InputError, match="expected the cases of this check"):
        run_blind(tmp_path / "b", robots, 8, 4, scheduler=scheduler)
    names = blind.case_files(tmp_path / "b", robots, 8, 3)
    assert {tmp_path / "b" / name for name in names} == {
        p for p in (tmp_path / "b").rglob("*") if p.is_file()
    }
    mine = tmp_path / "b" / "five-bar" / "campaign-001" / "outcome.json"
    mine.write_text("mine")
    with pytest.raises(
        InputError, match=r"campaign-001/outcome\.json: expected the outcome of a case"
    ):
        run_blind(tmp_path / "b", robots, 8, 3, scheduler=scheduler)
    assert mine.read_text() == "mine"


def test_a_robot_whose_home_is_singular_is_refused():
    text = ARM.format(
        kind="revolute", axis="[0, 0, 1]", pose='["x", "y"]', at="[0.5, 0, 0]"
    )
    straight = read_robot(Path("arm.toml"), text)
    with pytest.raises(
        InputError,
        match=r"^arm\.toml: expected a regular home, .*; home is singular: .*elbow = 5",
    ):
        blind_robots([straight], None, None)


def test_a_folder_for_cases_with_other_files_is_refused(tmp_path):
    (tmp_path / "o.cases").mkdir()
    (tmp_path / "o.cases" / "notes.txt").write_text("mine")
    with pytest.raises(
        InputError,
        match=r"o\.cases: expected a folder for finished cases, got one with other files",
    ):
        run_blind(tmp_path / "o.cases", [blind_robot("five-bar")], 1, 1)
    assert (tmp_path / "o.cases" / "notes.txt").read_text() == "mine"


@pytest.mark.long
def test_a_short_blind_check_scores_itself(tmp_path):
    scores = run_blind(tmp_path, [blind_robot("biglide", "published")], 3, 3, workers=1)
    first = [o for o in scores.outcomes if not o.left_out]
    assert [o.kind for o in first] == ["single"] * 3
    assert (
        json.loads(
            (tmp_path / "biglide" / "campaign-001" / "diagnosis.json").read_text()
        )["verdict"]
        == first[1].verdict
    )
    rows, columns, table = scores.confusion()
    assert sum(map(sum, table)) == 3
    assert (len(table), len(table[0])) == (len(rows), len(columns))


def found(*effects, verdict="identified", possible=()):
    def one(name, probability=0.99, group=(), **parameters):
        effect, place = name.split(" @ ")
        return {
            "effect": effect,
            "place": place,
            "probability": probability,
            "confused_with": list(group),
            "parameters": {
                key: dict(zip(("value", "sigma", "interval"), fit, strict=False))
                for key, fit in parameters.items()
            },
        }

    listed = [one(*args, **kwargs) for args, kwargs in effects]
    return NOTHING | {
        "verdict": verdict,
        "effects": listed,
        "possible": [one(*a, **k) for a, k in possible],
    }


def case_of(*faults, kind="pair"):
    return BlindCase(
        kind,
        1,
        tuple(Fault(*name.split(" @ "), parameters) for name, parameters in faults),
    )


def test_an_answer_is_right_where_each_true_effect_is_in_a_group_of_its_own():
    same = {"e @ all": "e @ a, b", "e @ both": "e @ a, b"}
    case = case_of(("e @ all", {"factor": 0.8}), ("f @ c", {"size": 2.0}))

    def outcome(*effects, **more):
        return outcome_of(
            1, case, found(*effects, **more), lambda name: same.get(name, name)
        )

    itself = (("e @ both",), {"factor": (0.81, 0.002, [0.79, 0.83])})
    other = (("f @ c",), {"size": (2.2, 0.2)})
    assert outcome(itself, other).right
    assert outcome(itself, other).covered == (
        True,
        True,
    )  # the stated interval counts, else 1.96 sigma
    assert outcome(itself, other, verdict="partly").right
    assert outcome(itself, (("g @ d", 0.6, ["f @ c", "h @ d"]), {})).right
    assert outcome(itself, (("g @ d", 0.6, ["f @ c", "h @ d", "i @ d"]), {})).right
    many = ["f @ c", *(f"h @ d{k}" for k in range(5))]
    assert not outcome(itself, (("g @ d", 0.6, many), {})).right  # seven in the group
    assert not outcome(itself).right
    assert not outcome(itself, other, (("g @ d",), {})).right
    assert not outcome(
        (("e @ both", 0.9, ["f @ c"]), {}), (("e @ a",), {})
    ).right  # one name for both, the other wrong
    stated = outcome(
        itself, verdict="partly", possible=[(("f @ c", 0.4), {}), (("g @ d", 0.2), {})]
    ).stated
    assert stated == ((0.99, True), (0.4, True), (0.2, False))


@pytest.mark.extended
def test_a_longer_rail_is_imitated_by_its_drives_and_cross_talk_by_nothing():
    lab = Lab(blind_robot("biglide", "published"), 12)

    def case(*fault):
        return BlindCase("outside", 5, (Fault(*fault),), "tool")

    assert is_imitated(case("larger-body", "rail", {"relative": 2e-3}), 49, lab)
    assert not is_imitated(case("cross-talk", "ry->y", {"share": 0.05}), 28, lab)
    assert not is_imitated(
        case(
            "coarse-converter", "instrument", {"displacement": 4e-6, "rotation": 1e-5}
        ),
        28,
        lab,
    )


def read_in_the_laboratory(robot, fault, folder, lab, style="tool"):
    """The model of a campaign of the sound machine, and what a fault changes in its readings (n,)."""
    machine, plan, located, rng = prepare_case(
        BlindCase("single", 7, (), style), 0, lab
    )
    readings = measure(machine, plan, Noise(), rng, located)
    write_readings(readings, folder, robot=robot, pose=machine.pose, components="beam")
    faulty = lab.with_faults([fault])
    change = (
        true_readings(faulty, plan, located).value
        - true_readings(machine, plan, located).value
    )
    return RobotModel(load_campaign(folder), lab.robot.nominal), change


@pytest.mark.extended_for("biglide-platform")
@pytest.mark.parametrize(
    ("robot", "body"), [("biglide", "platform"), ("delta", "platform")]
)
def test_the_pattern_of_a_larger_body_is_what_the_laboratory_reads(
    robot, body, labs, tmp_path
):
    """Of unloaded readings: how the deflections change with the geometry, a thousandth of a body, is left out."""
    lab = labs(robot) if robot == "delta" else Lab(blind_robot(robot), 12)
    model, change = read_in_the_laboratory(
        robot, Fault("larger-body", body, {"relative": 1e-4}), tmp_path, lab
    )
    pattern = next(
        c for c in model.library if c.place == f"a body of another size, {body}"
    )
    still = model.campaign.shows_rest
    expected = 1e-4 * model.predict().columns(pattern).sum(axis=1)
    assert still.any()
    assert change[still] == pytest.approx(
        expected[still], abs=3e-3 * np.abs(change).max()
    )


POSITIONS = {
    "force-scale @ instrument": {"factor": 0.999},
    "actuator-stiffness @ left.motor": {"factor": 0.999},
    "joint-axis @ wrist": {"y": 1e-6, "z": 2e-6, "ry": 3e-6, "rz": -1e-6},
}


@pytest.mark.parametrize("name", POSITIONS)
def test_positions_in_an_unknown_frame_change_as_the_laboratory_reads(
    name, labs, tmp_path
):
    """Beside motions of the frame. How deflections change with the geometry is left out of the model's columns."""
    lab = labs("five-bar")
    (effect, place) = name.split(" @ ")
    model, change = read_in_the_laboratory(
        "five-bar", Fault(effect, place, POSITIONS[name]), tmp_path, lab, "tracker"
    )
    known = next(c for c in model.library if c.name == name)
    sound, plan, located, _ = prepare_case(
        BlindCase("single", 7, (), "tracker"), 0, lab
    )
    axes, _ = plan.frame
    change = (change.reshape(-1, 3) @ axes).ravel()
    frame = Signatures(
        sound, plan, located, true_readings(sound, plan, located), Noise()
    ).frame
    frame = np.swapaxes(frame.reshape(-1, 3, 6), 1, 2) @ axes
    columns = np.hstack(
        [np.swapaxes(frame, 1, 2).reshape(-1, 6), model.predict().columns(known)]
    )
    values = np.linalg.lstsq(columns, change, rcond=None)[0]
    assert np.linalg.norm(change - columns @ values) < 1e-2 * np.linalg.norm(change)
    expected = [v - 1.0 if n == "factor" else v for n, v in POSITIONS[name].items()]
    assert np.abs(values[6:]) == pytest.approx(np.abs(expected), rel=2e-2)


STIFFENING = Fault("stiffening-joint", "wrist", {"radial": 1e-7, "knee": 1e-5})
HARDENING = Fault("hardening-drive", "leg2.motor", {"cubic": 1e8})
PRELOADED = Fault("stiffening-joint", "leg1.rod1.end", {"radial": 3e-7, "knee": 3e-5})


@pytest.mark.parametrize(
    ("robot", "style", "fault", "pattern", "left"),
    [
        (
            "five-bar",
            "tool",
            Fault("joint-play", "wrist", {"radial": 1e-6}),
            "play at wrist",
            1e-6,
        ),
        ("five-bar", "tool", STIFFENING, "stiffening at wrist", 0.05),
        ("delta", "tool", PRELOADED, "stiffening at leg1.rod1.end", 0.05),
        ("delta", "tool", HARDENING, "stiffening at leg2.motor", 0.1),
        (
            "five-bar",
            "tool",
            Fault("cross-talk", "rx->x", {"share": 0.05}),
            "cross-talk from rx at M into x at M",
            1e-6,
        ),
        (
            "five-bar",
            "gauges",
            Fault("cross-talk", "gauge5->gauge1", {"share": 0.05}),
            "cross-talk from gauge5 into gauge1",
            1e-6,
        ),
    ],
    ids=[
        "play",
        "stiffening",
        "stiffening under weight",
        "hardening drive",
        "cross-talk",
        "cross-talk of gauges",
    ],
)
def test_patterns_follow_what_the_laboratory_reads(
    robot, style, fault, pattern, left, labs, tmp_path
):
    """Stiffening beside the compliance of the joint or its drive, which has a word."""
    model, change = read_in_the_laboratory(robot, fault, tmp_path, labs(robot), style)
    linear = ("joint-compliance", "actuator-stiffness")
    followed = {
        f"unknown @ {pattern}",
        *(f"{effect} @ {fault.place}" for effect in linear),
    }
    columns = np.hstack(
        [
            model.predict().columns(c)
            for c in model.library
            if followed.intersection(c.signature_of)
        ]
    )
    assert np.abs(change).max() > 1e-7
    values = np.linalg.lstsq(columns, change, rcond=None)[0]
    assert np.linalg.norm(change - columns @ values) < left * np.linalg.norm(change)


@pytest.mark.extended
def test_many_patterns_leave_outliers_to_be_seen(labs, tmp_path):
    lab = labs("orthoglide")
    machine, plan, located, rng = prepare_case(
        BlindCase("none", 7, (), "gauges"), 0, lab
    )
    readings = measure(machine, plan, Noise(outliers=0.01), rng, located)
    write_readings(
        readings, tmp_path, robot="orthoglide", pose=machine.pose, components="beam"
    )
    model = RobotModel(load_campaign(tmp_path), lab.robot.nominal)
    assert len(model.campaign) < 2 * sum(len(c.scale) for c in model.library)
    assert 3 <= (~model.noise().used).sum() <= 12


@pytest.mark.parametrize(
    ("robot", "drive"), [("biglide", "stage.actuator"), ("serial-arm", "J6")]
)
@pytest.mark.parametrize("style", ["tool", "gauges", "sag", "tracker"])
def test_the_signature_of_backlash_is_what_the_laboratory_reads(
    robot, drive, style, labs
):
    """A drive that no weight loads has none in sag."""
    lab = labs(robot)
    machine, plan, located, _ = prepare_case(BlindCase("single", 7, (), style), 0, lab)
    rows = true_readings(machine, plan, located)
    signatures = Signatures(machine, plan, located, rows, Noise())
    faulty = lab.with_faults([Fault("backlash", drive, {"half_width": 1e-7})])
    change = (
        true_readings(faulty, plan, located).value - rows.value
    ) / signatures.sigma
    column = 1e-7 * signatures.find_columns("backlash", drive, {})[:, 0]
    assert change == pytest.approx(column, abs=1e-3 * np.abs(change).max() + 1e-6)


@pytest.mark.extended
def test_a_joint_that_yields_in_proportion_does_not_stiffen(labs, tmp_path):
    lab = labs("five-bar")
    case = BlindCase(
        "single",
        31415,
        (Fault("joint-compliance", "wrist", {"radial": 2e-7}),),
        "gauges",
    )
    write_case(tmp_path, 3, case, lab)
    (effect,) = diagnose_campaign(load_campaign(tmp_path), lab.robot.nominal).effects
    assert "joint-compliance @ wrist" in {
        f"{effect.effect} @ {effect.place}",
        *effect.confused_with,
    }


SOFT_AND_TURNED = (
    Fault("actuator-stiffness", "motors", {"factor": 0.805}),
    Fault(
        "part-compliance",
        "right.inner",
        {
            "c11": 1.253e-8,
            "c22": 2.152e-6,
            "c26": 1.394e-5,
            "c33": 2.208e-6,
            "c35": -1.419e-5,
            "c44": 1.544e-4,
            "c55": 1.255e-4,
            "c66": 1.242e-4,
        },
    ),
    Fault(
        "instrument-misalignment",
        "instrument",
        {"rx": 0.0405, "ry": 0.0282, "rz": 0.0114},
    ),
)


@pytest.mark.extended
def test_effects_are_exchanged_in_sets_that_are_nearly_as_good(tmp_path):
    """A part that is softer on both sides, and once more on one, stands for softer drives and a part softer on one."""
    lab = Lab(blind_robot("five-bar"))
    case = BlindCase("triple", 90210, SOFT_AND_TURNED, "tool")
    write_case(tmp_path, 25, case, lab)
    effects = diagnose_campaign(load_campaign(tmp_path), lab.robot.nominal).effects
    assert {(e.effect, e.place) for e in effects} == {
        (fault.effect, fault.place) for fault in SOFT_AND_TURNED
    }


@pytest.mark.extended
def test_play_in_a_passive_joint_is_no_backlash_of_a_drive(labs, tmp_path):
    lab = labs("five-bar")
    case = BlindCase(
        "outside", 31415, (Fault("joint-play", "wrist", {"radial": 5e-6}),), "tool"
    )
    write_case(tmp_path, 9, case, lab)
    found = diagnose_campaign(load_campaign(tmp_path), lab.robot.nominal)
    assert found.verdict == "unexplained"
    assert any("play at wrist" in remark for remark in found.remarks)


@pytest.mark.extended_for(
    "stewart-fault0-strut5.drive",
    "stewart-fault1-strut5.drive",
    "orthoglide-fault2-legz.motor",
)
@pytest.mark.parametrize(
    ("robot", "fault", "drive"),
    [
        (
            "stewart",
            Fault("joint-play", "strut5.head", {"radial": 5e-6}),
            "strut5.drive",
        ),
        (
            "stewart",
            Fault("backlash", "strut5.drive", {"half_width": 5e-6}),
            "strut5.drive",
        ),
        (
            "orthoglide",
            Fault("joint-play", "legz.hinge2", {"radial": 8e-6}),
            "legz.motor",
        ),
    ],
)
def test_play_that_reads_as_backlash_of_a_drive_is_said_to_be_either(
    robot, fault, drive, labs, tmp_path
):
    """That motion is lost is certain, and where it is not: in the drive, or in a joint of its strut."""
    lab = labs(robot)
    case = BlindCase(
        "outside" if fault.effect == "joint-play" else "single", 31415, (fault,), "tool"
    )
    write_case(tmp_path, 9, case, lab)
    found = diagnose_campaign(load_campaign(tmp_path), lab.robot.nominal)
    (effect,) = found.effects
    assert (found.verdict, effect.effect, effect.place) == (
        "ambiguous",
        "backlash",
        drive,
    )
    assert 0 < len(effect.confused_with) < 3
    assert all(name.startswith("unknown @ play at ") for name in effect.confused_with)
    said = [
        r
        for r in found.remarks
        if r.endswith(
            f"would explain the readings nearly as well as backlash @ {drive}"
        )
    ]
    assert len(said) == 1


@pytest.mark.extended
def test_an_offset_that_only_a_heavy_mass_would_bring_is_an_offset(labs, tmp_path):
    """On its inclined rail a cart with 56 kg more would stand as far off: these were one effect, and not plausible."""
    lab = labs(LINEAR_DELTA)
    fault = Fault("encoder-offset", "leg3.slide", {"offset": 3e-5})
    write_case(tmp_path, 10, BlindCase("single", 3, (fault,), "gauges"), lab)
    found = diagnose_campaign(load_campaign(tmp_path), lab.robot.nominal)
    assert (found.verdict, [(e.effect, e.place) for e in found.effects]) == (
        "identified",
        [("encoder-offset", "leg3.slide")],
    )


def test_scores_by_kind_and_calibration():
    def one(
        kind,
        verdict,
        truth=(),
        named=(),
        evidence=50.0,
        stated=(),
        robot="r",
        left_out="",
        imitated=False,
    ):
        return Outcome(
            0,
            kind,
            truth,
            verdict,
            named,
            ((),) * len(named),
            evidence,
            (9, 1, 1, 1),
            (),
            left_out,
            robot,
            "tool",
            stated,
            imitated,
        )

    scores = score(
        [
            one("single", "identified", ("a @ b",), ("a @ b",), stated=((0.97, True),)),
            one("single", "no-gap", ("a @ b",), evidence=3.0),  # too small to be found
            one(
                "triple",
                "partly",
                ("a @ b", "c @ d", "e @ f"),
                ("a @ b",),
                stated=((0.93, True), (0.25, False)),
            ),
            one("none", "identified", (), ("a @ b",), robot="s"),
            one("outside", "identified", ("x @ y",), ("a @ b",), imitated=True),
            one("outside", "partly", ("x @ y",), ("a @ b",)),
            one("single", "identified", ("a @ b",), ("c @ d",), left_out="a"),
        ]
    )
    assert (scores.singles, scores.pairs, scores.triples) == (1.0, None, 0.0)
    assert (
        scores.false_alarms,
        scores.outside,
        scores.distinguishable,
        scores.left_out,
    ) == (1.0, 0.5, 0.0, 1.0)
    assert scores.calibration() == ((0.25, 0.0, 1), (pytest.approx(0.95), 1.0, 2))
    assert scores.by_robot()["s"].singles is None


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_no_worker_outlives_a_killed_parent(tmp_path):
    script = tmp_path / "parent.py"
    script.write_text(
        "import os, time\n"
        "from stiffscope.runtime.executor import Processes\n"
        "if __name__ == '__main__':\n"
        "    with Processes(1) as executor:\n"
        "        print(executor.submit(os.getpid).result(), flush=True)\n"
        "        future = executor.submit(time.sleep, 600)\n"
        "        time.sleep(600)\n"
    )
    with subprocess.Popen(
        [sys.executable, str(script)], stdout=subprocess.PIPE, text=True, cwd=tmp_path
    ) as parent:
        worker = int(parent.stdout.readline())
        parent.send_signal(signal.SIGKILL)
    for _ in range(20):  # two seconds
        try:
            os.kill(worker, 0)
        except ProcessLookupError:
            return
        if (
            Path(f"/proc/{worker}/stat").exists()
            and Path(f"/proc/{worker}/stat").read_text().split()[2] == "Z"
        ):
            return  # ended; nobody has asked for its exit code
        time.sleep(0.1)
    os.kill(worker, signal.SIGKILL)
    pytest.fail("the worker outlived its parent")


def test_a_scheduler_that_does_not_answer_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr("stiffscope.runtime.scheduler.CONNECT", "1s")
    with pytest.raises(
        InputError,
        match="--scheduler: expected the address of a Dask scheduler that answers",
    ):
        run_blind(
            tmp_path, [blind_robot("five-bar")], 1, 1, scheduler="tcp://127.0.0.1:9"
        )


def test_a_case_that_cannot_be_kept_is_told_with_its_place(tmp_path):
    (tmp_path / "biglide").write_text("mine")
    with pytest.raises(
        InputError,
        match=r"biglide/campaign-000: the case cannot be kept \(.+\); finished ones are$",
    ):
        blind._store(tmp_path, blind.Task("biglide", 0, 1), {"outcome.json": "[]"})
