"""Doubtful readings are named by instrument and row, and sound ones are not."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stiffscope.gap.campaign.quantities import DEVIATION
from stiffscope.gap.campaign.readings import load_campaign
from stiffscope.gap.campaign.sanity import (
    _find_jump,
    _stand_apart,
    find_doubts,
    inspect_readings,
)
from stiffscope.gap.campaigns import (
    Case,
    configure_case,
    inspect_case,
    open_case,
    predict_roughly,
)
from stiffscope.gap.forward.robot_model import RobotModel
from stiffscope.lab.blind.cases import BlindCase
from stiffscope.lab.blind.drawing import draw_case, prepare_case
from stiffscope.lab.blind.laboratory import BlindRobot, Lab
from stiffscope.lab.measuring import Noise, measure, write_readings
from stiffscope.robot.library import find_robot
from stiffscope.robot.mechanism_of import mechanism_of
from stiffscope.robot.nominal import NominalRobot
from stiffscope.robot.part_matrices import part_matrices
from stiffscope.robot.reader import load_robot

pytestmark = pytest.mark.slow

WITHHELD = Path(__file__).parents[2] / "data" / "withheld"
OF_NUMBERS = {"unit", "sensor-sign", "sensor-step"}


@pytest.fixture(scope="module")
def labs():
    found = {}

    def lab(name):
        if name not in found:
            robot = load_robot(name)
            parts = part_matrices(robot, "beam")
            found[name] = Lab(
                BlindRobot(
                    NominalRobot(mechanism_of(robot, parts), robot), parts, "beam"
                ),
                12,
            )
        return found[name]

    return lab


def read(lab, case, number, folder, noise=None):
    """A campaign of the laboratory, and what is roughly predicted."""
    machine, plan, located, rng = prepare_case(case, number, lab)
    readings = measure(machine, plan, noise or Noise(), rng, located)
    robot = lab.robot.nominal.robot
    write_readings(
        readings,
        folder,
        robot=lab.robot.reference,
        pose=machine.pose,
        components="beam",
    )
    campaign = load_campaign(folder, robot)
    return campaign, predict_roughly(Case("case", folder, campaign, robot))


def doubts(campaign, predicted):
    return {(r.doubt, r.instrument) for r in inspect_readings(campaign, predicted)}


def channel(campaign, name, kind=0):
    return np.flatnonzero(
        [
            campaign.what(k) == name and campaign.kind[k] == kind
            for k in range(len(campaign))
        ]
    )


@pytest.mark.extended_for("delta-gauges-gauge4")
@pytest.mark.parametrize(
    ("robot", "style", "name"),
    [("five-bar", "tool", "dx"), ("delta", "gauges", "gauge4")],
)
def test_what_is_wrong_with_one_instrument_is_named(robot, style, name, labs, tmp_path):
    sound, predicted = read(labs(robot), BlindCase("none", 3, (), style), 0, tmp_path)
    assert doubts(sound, predicted) == set()
    rows = channel(sound, name)

    def changed(change):
        value = np.array(sound.value)
        value[rows] = change(value[rows])
        return inspect_readings(replace(sound, value=value), predicted)

    def one(doubt, change):
        (remark,) = changed(change)
        assert (remark.doubt, remark.instrument) == (doubt, name)
        return remark.where

    one("unit", lambda v: v * 1e3)
    one("unit", lambda v: v * 1e-3)
    one("sensor-sign", lambda v: -v)
    one("constant", lambda v: np.full(len(v), v[0]))
    for first in (0.1, 0.3, 0.5, 0.85):
        later = np.arange(len(rows)) >= int(first * len(rows))
        where = one("sensor-step", lambda v, later=later: v + 3e-4 * later)
        assert where == (sound.where(int(rows[later][0])),)
    first = sound.pose[rows] == sound.pose[rows[0]]
    assert {r.doubt for r in changed(lambda v: v + 3e-4 * first)} == {
        "outlier"
    }  # a fault of the robot there?
    slipped = np.array(sound.value)
    slipped[rows] = 3e-4 * (np.arange(len(rows)) >= 20) - slipped[rows]  # and reversed
    found = find_doubts(replace(sound, value=slipped), predicted)
    instrument = sound.instruments[sound.channel[rows[0]]]
    assert (list(found.steps), found.signs) == ([instrument], (instrument,))
    bad = [7, 30]
    where = one(
        "outlier", lambda v: v + np.where(np.isin(np.arange(len(v)), bad), 3e-4, 0.0)
    )
    assert set(where) == {sound.where(int(rows[k])) for k in bad}


def test_deflections_settle_the_sign_of_an_instrument(labs, tmp_path):
    """Deviations that vary against the model, by errors of the geometry, do not reverse a gauge that yields with it."""
    sound, predicted = read(
        labs("five-bar"), BlindCase("none", 3, (), "tool"), 0, tmp_path
    )
    rows = np.flatnonzero(sound.kind == DEVIATION)
    value = np.array(sound.value)
    value[rows] = -value[rows]
    assert (
        not {r.doubt for r in inspect_readings(replace(sound, value=value), predicted)}
        & OF_NUMBERS
    )
    assert not find_doubts(replace(sound, value=value), predicted).signs
    alone = replace(sound, value=np.where(sound.kind == DEVIATION, value, np.nan))
    assert find_doubts(alone, predicted).signs


def test_the_end_of_a_long_tail_is_no_outlier():
    """Of sound readings, where a fault depends on the pose: one stands 8.0 times the spread out, the next 7.5 times."""
    case = open_case(WITHHELD / "campaign-005")
    assert inspect_readings(case.campaign, predict_roughly(case)) == ()


def test_what_smaller_readings_lead_up_to_does_not_stand_apart():
    """A tail that falls up to 20 times the spread is a robot's; 20 and 15 beside at most 8 are two outliers."""
    usual = [1.0, 3.0, 4.5, 5.0, 6.0, 7.0, 8.0]
    tail = np.array([*usual, 9.0, 11.0, 15.0, 20.0])
    alone = np.array([*usual, 15.0, 20.0])
    assert not _stand_apart(tail, np.full(len(tail), 8.0)).any()
    assert (_stand_apart(alone, np.full(len(alone), 8.0)) == (alone > 8.0)).all()


@pytest.mark.parametrize("seed", range(5))
def test_outliers_of_all_sizes_are_named_though_each_leads_up_to_the_next(seed):
    """Three of a hundred readings are misread by up to 60 times the noise; of a falling tail none is."""
    rng = np.random.default_rng(seed)
    size = np.abs(rng.standard_normal(600))
    wild = rng.choice(600, 18, replace=False)
    size[wild] = np.geomspace(6.0, 60.0, 18)  # each a seventh more than the one before
    limit = np.full(600, 8.0)
    assert (_stand_apart(size, limit) == (size > 8.0)).all()
    falling = 1.05 * rng.standard_exponential(4000)
    assert not _stand_apart(falling, np.full(4000, 8.0)).any()


def test_a_copied_channel_is_named(labs, tmp_path):
    sound, predicted = read(
        labs("delta"), BlindCase("none", 3, (), "gauges"), 0, tmp_path
    )
    value = np.array(sound.value)
    value[channel(sound, "gauge2")] = value[channel(sound, "gauge1")]
    copied = [
        r
        for r in inspect_readings(replace(sound, value=value), predicted)
        if r.doubt == "copied"
    ]
    assert ["gauge2 repeats the readings of gauge1" in r.text for r in copied] == [True]


FEW = """robot = "delta"
modelled = ["gravity"]
readings = "readings.csv"
[sensors.g]
measures = "displacement"
body = "platform"
at = ["60 mm", "20 mm", "-1054 mm"]
direction = [1, 0, 0]
[loads.hook]
body = "platform"
at = [0, 0, "-1124 mm"]
"""
ROWS = [
    "0,0,-1.064,hook,1,g,1e-5,1e-6,a",
    "0.1,0,-1.064,hook,1,g,1.1e-5,1e-6,a",
    "0,0.1,-1.064,hook,1,g,9e-6,1e-6,a",
]


@pytest.mark.parametrize(
    ("rows", "doubt", "text"),
    [
        ([*ROWS, ROWS[0].replace("1e-5", "1.2e-5")], None, ""),
        (
            [*ROWS, "0.1,0.1,-1.064,hook,1,g,5,1e-6,a"],
            "outlier",
            "g is an outlier among its readings at readings.csv:5",
        ),
        (
            [*ROWS, ROWS[0].replace("1e-5", "-1e-5")],
            "contradiction",
            "g reads 1e-05 at readings.csv:2 and -1e-05 at readings.csv:5, at one pose and load",
        ),
        (
            [
                *(row.replace("hook,1", "hook,0") for row in ROWS),
                ROWS[0].replace("hook", ""),
            ],
            "no-load",
            "load hook has no force or moment in any of its 3 readings",
        ),
        (ROWS[:1], "few", "1 reading has a value: too few for a diagnosis"),
    ],
)
def test_a_small_table_is_doubted(tmp_path, rows, doubt, text):
    (tmp_path / "campaign.toml").write_text(FEW)
    (tmp_path / "readings.csv").write_text(
        "\n".join(["x,y,z,load,fx,sensor,value,sigma,session", *rows])
    )
    case = open_case(tmp_path)
    found = inspect_readings(case.campaign, predict_roughly(case))
    assert [remark.doubt for remark in found] == ([doubt] if doubt else [])
    assert all(text in remark.text for remark in found)


@pytest.mark.parametrize(
    ("angles", "line"),
    [((0, 0.08727, -0.0872), 0), ((0, 0.2, 0.3), 3), ((-0.1, 0, 0), 2)],
)
def test_the_first_reading_beyond_the_range_of_a_drive_is_named(angles, line, tmp_path):
    """Of a Delta whose second motor may turn 5 degrees, 0.0873 rad; the columns are the drives' own positions."""
    text = (
        find_robot("delta")
        .read_text()
        .replace('"-45 deg", "75 deg"', '"-5 deg", "5 deg"')
    )
    (tmp_path / "mine.toml").write_text(text)
    (tmp_path / "campaign.toml").write_text(FEW.replace('"delta"', '"mine.toml"'))
    rows = [f"0,{angle},0,hook,1,g,1e-5,1e-6,a" for angle in angles]
    names = ",".join(f"q:leg{k}.motor" for k in (1, 2, 3))
    (tmp_path / "readings.csv").write_text(
        "\n".join([f"{names},load,fx,sensor,value,sigma,session", *rows])
    )
    case = open_case(tmp_path)
    found = [r for r in inspect_case(case, configure_case(case)) if r.doubt == "range"]
    assert [(r.instrument, r.where) for r in found] == (
        [("leg2.motor", (f"readings.csv:{line}",))] if line else []
    )
    position = np.degrees(angles[line - 2])
    text = f'"leg2.motor": {position:.6g} deg is outside its range -5 to 5 deg: are the poses in m and rad?'
    assert all(text in r.text for r in found)
    model = RobotModel(
        case.campaign,
        NominalRobot(mechanism_of(case.robot, part_matrices(case.robot)), case.robot),
    )
    said = model.remarks(model.noise(), np.zeros(3))
    assert [r for r in said if "range" in r] == [r.text for r in found]


def test_a_stuck_or_empty_plan_is_no_doubt(labs, tmp_path):
    sound, predicted = read(labs("five-bar"), BlindCase("none", 3), 0, tmp_path)
    assert (
        inspect_readings(replace(sound, value=np.full(len(sound), np.nan)), predicted)
        == ()
    )


@pytest.mark.extended
@pytest.mark.parametrize("cases", [5, pytest.param(20, marks=pytest.mark.long)])
def test_faults_of_the_robot_raise_no_doubts_of_its_instruments(cases, labs, tmp_path):
    """Of drawn cases at most one channel in a hundred is doubted, never for its unit, sign or constancy."""
    seen = 0
    raised = []
    for name in ("five-bar", "delta"):
        for number in range(cases):
            case = draw_case(number, 8, labs(name))
            campaign, predicted = read(
                labs(name), case, number, tmp_path / f"{name}{number}"
            )
            seen += len(
                np.unique(np.column_stack([campaign.channel, campaign.kind]), axis=0)
            )
            if (
                case.kind != "outside"
                and not {fault.effect for fault in case.faults} & OF_NUMBERS
            ):
                raised += [
                    (name, number, case.faults, r)
                    for r in inspect_readings(campaign, predicted)
                ]
    assert not [
        each
        for each in raised
        if each[3].doubt in {"unit", "sensor-sign", "constant", "copied"}
    ]
    assert len(raised) <= 0.01 * seen, [(each[:3], each[3].text) for each in raised]


def test_a_few_readings_that_the_fit_reproduces_leave_no_scatter(tmp_path):
    bundled = Path(__file__).parents[2] / "data" / "campaigns" / "gauges"
    for file in bundled.iterdir():
        lines = file.read_text(encoding="utf-8").splitlines(keepends=True)
        (tmp_path / file.name).write_text(
            "".join(lines[:13] if file.suffix == ".csv" else lines), encoding="utf-8"
        )
    case = open_case(str(tmp_path))
    predicted = predict_roughly(case)
    values = [case.campaign.value, predicted, 1e-9 * predicted + 1e-6]
    assert not any(
        find_doubts(replace(case.campaign, value=value), predicted).steps
        for value in values
    )


def test_a_jump_is_found_beside_what_resembles_it():
    """A prediction that is larger in the second half follows half of a jump there."""
    rng = np.random.default_rng(2)
    late = np.arange(60) >= 30
    columns = np.linalg.qr(
        np.column_stack([rng.standard_normal(60) + 2.0 * late, np.ones(60)])
    )[0]
    value = columns @ [5.0, 1.0] + 0.3 * late + 0.01 * rng.standard_normal(60)
    place, jump = _find_jump(value, columns, np.arange(60))
    assert place == 30
    assert jump == pytest.approx(0.3, abs=0.02)
    assert _find_jump(value - 0.3 * late, columns, np.arange(60)) is None
