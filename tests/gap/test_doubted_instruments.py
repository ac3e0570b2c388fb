"""Instruments in another unit, reversed or slipped are causes of a gap, and are not named where they are sound."""

import pytest

from stiffscope.gap.blind.cases import BlindCase, Fault
from stiffscope.gap.blind.drawing import write_case
from stiffscope.gap.blind.laboratory import BlindRobot, Lab
from stiffscope.gap.campaign.readings import load_campaign
from stiffscope.gap.diagnose import diagnose_campaign
from stiffscope.robot.mechanism_of import mechanism_of
from stiffscope.robot.nominal import NominalRobot
from stiffscope.robot.part_matrices import part_matrices
from stiffscope.robot.reader import load_robot

SOFT = Fault("actuator-stiffness", "left.motor", {"factor": 0.8})


@pytest.fixture(scope="module")
def lab():
    robot = load_robot("five-bar")
    parts = part_matrices(robot, "beam")
    return Lab(BlindRobot(NominalRobot(mechanism_of(robot, parts), robot), parts, "beam"), 12)


def diagnose(lab, faults, style, folder):
    write_case(folder, 5, BlindCase("pair", 8, tuple(faults), style), lab)
    found = diagnose_campaign(load_campaign(folder), lab.robot.nominal)
    return found, {(e.effect, e.place): {n: p.value for n, p in e.parameters.items()} for e in found.effects}


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
        assert value == pytest.approx(fault.parameters[name], rel=0.02, abs=6.0 if name == "row" else 0.0)
    if beside:
        assert effects[SOFT.effect, SOFT.place]["factor"] == pytest.approx(0.8, rel=0.02)


@pytest.mark.parametrize(
    "other",
    [Fault("link-length", "left.inner", {"error": 3e-5}), Fault("force-scale", "instrument", {"factor": 1.05})],
    ids=["length", "scale"],
)
def test_a_unit_is_no_gain_that_differs_by_direction(other, lab, tmp_path):
    """Beside two causes: such gains explain all but one of them at once, and a unit changes what the others do."""
    faults = Fault("unit", "gauge3", {"factor": 1e-3}), other, Fault("link-stiffness", "right.outer", {"factor": 0.8})
    found, effects = diagnose(lab, faults, "gauges", tmp_path)
    assert found.verdict == "identified"
    assert set(effects) == {(f.effect, f.place) for f in faults}
