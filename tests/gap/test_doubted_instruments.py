"""Instruments in another unit, reversed or slipped are causes of a gap, and are not named where they are sound."""

from dataclasses import replace

import numpy as np
import pytest

from stiffscope.gap.campaign.readings import load_campaign
from stiffscope.gap.diagnose import conclude, diagnose_campaign
from stiffscope.gap.forward.robot_model import RobotModel
from stiffscope.gap.inference.find import find
from stiffscope.lab.blind.cases import BlindCase, Fault
from stiffscope.lab.blind.drawing import write_case
from stiffscope.lab.blind.laboratory import BlindRobot, Lab
from stiffscope.robot.mechanism_of import mechanism_of
from stiffscope.robot.nominal import NominalRobot
from stiffscope.robot.part_matrices import part_matrices
from stiffscope.robot.reader import load_robot

pytestmark = pytest.mark.slow

SOFT = Fault("actuator-stiffness", "left.motor", {"factor": 0.8})


@pytest.fixture(scope="module")
def lab():
    robot = load_robot("five-bar")
    parts = part_matrices(robot, "beam")
    return Lab(
        BlindRobot(NominalRobot(mechanism_of(robot, parts), robot), parts, "beam"), 12
    )


def diagnose(lab, faults, style, folder):
    write_case(folder, 5, BlindCase("pair", 8, tuple(faults), style), lab)
    found = diagnose_campaign(load_campaign(folder), lab.robot.nominal)
    return found, {
        (e.effect, e.place): {n: p.value for n, p in e.parameters.items()}
        for e in found.effects
    }


@pytest.mark.extended_for(
    "alone-fault1-tool",
    "alone-fault2-gauges",
    "alone-fault3-tool",
    "alone-fault4-gauges",
    "beside a soft drive-fault0-gauges",
    "beside a soft drive-fault1-tool",
    "beside a soft drive-fault2-gauges",
    "beside a soft drive-fault3-tool",
    "beside a soft drive-fault4-gauges",
    "alone-fault0-gauges",
)
@pytest.mark.parametrize(
    ("fault", "style"),
    [
        (Fault("unit", "gauge4", {"factor": 1e3}), "gauges"),
        (Fault("unit", "instrument", {"factor": 1e3}), "tool"),
        (Fault("sensor-sign", "gauge2", {}), "gauges"),
        (Fault("sensor-sign", "y", {}), "tool"),
        (Fault("sensor-step", "gauge1", {"jump": 2e-4, "row": 300}), "gauges"),
    ],
)
@pytest.mark.parametrize("beside", [(), (SOFT,)], ids=["alone", "beside a soft drive"])
def test_an_instrument_at_fault_is_named(fault, style, beside, lab, tmp_path):
    found, effects = diagnose(lab, (fault, *beside), style, tmp_path)
    assert found.verdict == "identified"
    assert set(effects) == {(f.effect, f.place) for f in (fault, *beside)}
    for name, value in effects[fault.effect, fault.place].items():
        assert value == pytest.approx(
            fault.parameters[name], rel=0.02, abs=6.0 if name == "row" else 0.0
        )
    if beside:
        assert effects[SOFT.effect, SOFT.place]["factor"] == pytest.approx(
            0.8, rel=0.02
        )


@pytest.mark.extended
def test_a_reversed_sensor_is_named_beside_a_wrong_unit(lab, tmp_path):
    """The unit makes the gap hundreds of times as large: the sign is judged by what is left beside it."""
    faults = (
        Fault("sensor-sign", "rz", {}),
        Fault("unit", "x", {"factor": 1e-3}),
    )
    found, effects = diagnose(lab, faults, "tool", tmp_path)
    assert found.verdict == "identified"
    assert set(effects) == {(f.effect, f.place) for f in faults}


@pytest.mark.extended
@pytest.mark.parametrize(
    "other",
    [
        pytest.param(
            Fault("link-length", "left.inner", {"error": 3e-5}), marks=pytest.mark.long
        ),
        Fault("force-scale", "instrument", {"factor": 1.05}),
    ],
    ids=["length", "scale"],
)
def test_a_unit_is_no_gain_that_differs_by_direction(other, lab, tmp_path):
    """Beside two causes: such gains explain all but one of them at once, and a unit changes what the others do."""
    faults = (
        Fault("unit", "gauge3", {"factor": 1e-3}),
        other,
        Fault("link-stiffness", "right.outer", {"factor": 0.8}),
    )
    found, effects = diagnose(lab, faults, "gauges", tmp_path)
    assert found.verdict == "identified"
    assert set(effects) == {(f.effect, f.place) for f in faults}


def test_a_slip_that_other_causes_hide_is_found_beside_them(lab, tmp_path):
    """They move the tool ten times as far as the sensor slips, which shows only once they are fitted."""
    base = Fault("base-compliance", "base", {"rz": 1e-5})
    slip = Fault("sensor-step", "y", {"jump": 2e-5, "row": 200})
    write_case(tmp_path, 5, BlindCase("triple", 8, (slip, SOFT, base), "tool"), lab)
    model = RobotModel(load_campaign(tmp_path), lab.robot.nominal)
    yielding = next(
        c
        for c in model.library
        if c.name == "base-compliance @ base" and len(c.scale) == 6
    )
    drive = next(
        c for c in model.library if c.name == "actuator-stiffness @ left.motor"
    )
    known = (yielding, (0.0, 0.0, 0.0, 0.0, 0.0, 1e-5)), (drive, (1 / 0.8 - 1,))
    again = model.doubt_again(known)
    assert "y" not in model.setting.doubts.steps
    row, _, turns = again.setting.doubts.steps["y"]
    assert (row, turns) == ((0, 201), False)
    step = next(c for c in again.library if c.name == "sensor-step @ y")
    assert again.doubt_again((*known, (step, (2e-5,)))) is None


@pytest.mark.extended
@pytest.mark.parametrize("every", [5, 7, 9])
def test_few_readings_without_sigma_name_their_cause(every, lab, tmp_path):
    """The joint fit of all effects has more columns than there are readings: 70, 50 and 40 of five gauges."""
    write_case(tmp_path, 5, BlindCase("single", 8, (SOFT,), "gauges"), lab)
    whole = load_campaign(tmp_path)
    rows = np.flatnonzero(whole.pose % 4 == 0)
    rows = rows[np.arange(len(rows)) // 5 % every < 2]
    columns = (
        "pose",
        "wrench",
        "quantity",
        "value",
        "session",
        "file",
        "line",
        "sensor",
        "load",
    )
    few = replace(
        whole,
        **{k: getattr(whole, k)[rows] for k in columns},
        sigma=np.full(len(rows), np.nan),
    )
    search = find(RobotModel(few, lab.robot.nominal))
    found = conclude(search)
    assert found.verdict == "identified"
    assert [(e.effect, e.place) for e in found.effects] == [(SOFT.effect, SOFT.place)]
    assert any("state sigma" in remark for remark in found.remarks)
    told = search.sigma / whole.sigma[rows]  # beside the effect that was found
    assert (told > 0.4).all()
    assert (told < 2.0).all()
