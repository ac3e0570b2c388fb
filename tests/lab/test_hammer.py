"""The laboratory's hammer: a dense model beside the library's modes, noise as coherence says, and its files."""

from dataclasses import replace

import numpy as np
import pytest
import pyuff

from stiffscope.errors import InputError
from stiffscope.gap.campaign.measured_responses import load_responses
from stiffscope.gap.campaign.response_lines import stack_parts
from stiffscope.gap.campaigns import open_case, rough_mechanism
from stiffscope.gap.diagnose import forward_model
from stiffscope.gap.effects.vocabulary import apply_effect
from stiffscope.gap.forward.response_model import predict_responses
from stiffscope.lab.closure import locate
from stiffscope.lab.faults import inject
from stiffscope.lab.hammer import (
    HammerNoise,
    HammerPlan,
    record,
    space_lines,
    strike,
    triaxial,
    write_responses,
)
from stiffscope.lab.machine import machine_of
from stiffscope.lab.response import Spot
from stiffscope.responses.model import Direction, Response
from stiffscope.responses.scatter import find_scatter
from stiffscope.responses.uff import read_uff
from stiffscope.responses.uff_writing import write_uff
from stiffscope.robot.nominal import NominalRobot
from stiffscope.robot.part_matrices import part_matrices
from stiffscope.robot.reader import load_robot

DAMPING = np.array([0.01])
ROBOTS = {
    "biglide": ("published", "limb1.slider.tip", 60.0),
    "stewart": ("beam", "strut1.upper.tip", 270.0),
    "five-bar": ("beam", "left.outer.tip", 85.0),
}


def hammer(name, count=201):
    """Machine, plan and configuration of a robot hit twice, with two triaxial accelerometers."""
    components, node, lowest = ROBOTS[name]
    robot = load_robot(name)
    machine = machine_of(robot, part_matrices(robot, components))
    (body,) = (b for b in machine.bodies.values() if node in b.nodes)
    end = body.places[body.nodes.index(node)]
    points = {
        "1": Spot(machine.tool, np.round(machine.at + np.array([0.03, 0.04, 0.02]), 4)),
        "7": Spot(node, np.round(end + np.array([0.01, 0.0, 0.02]), 4)),
    }
    plan = HammerPlan(
        poses=np.array([list(robot.poses.values())[-1]]),
        points=points,
        hits=(Direction("1", 2), Direction("7", 1, -1)),
        motions=(*triaxial("1"), *triaxial("7")),
        hertz=space_lines(0.3 * lowest, 6.0 * lowest, count),
        about=lowest,
    )
    return machine, plan, locate(machine, plan.poses), components


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "denser"), [*((name, "") for name in ROBOTS), ("stewart", "platform")]
)
def test_a_struck_machine_is_that_of_the_library(name, denser, tmp_path):
    machine, plan, located, components = hammer(name)
    factor = {"factor": 1.3}
    planted = inject(machine, "mass", denser, factor) if denser else machine
    true = strike(planted, plan, located, DAMPING)
    silent = record(true, plan, HammerNoise(0.0, 0.0), np.random.default_rng(1))
    pose = list(machine.robot.poses)[-1]
    write_responses(
        tmp_path,
        plan,
        silent,
        robot=name,
        names={"tap": pose},
        components=components,
    )
    case = open_case(tmp_path)
    mechanism = rough_mechanism(case.robot, components)
    if denser:
        nominal = NominalRobot(mechanism, case.robot)
        mechanism = apply_effect(nominal, "mass", denser, factor).mechanism
    (measured,) = load_responses(tmp_path, case.campaign, case.robot, mechanism)
    predicted = predict_responses(mechanism, measured, DAMPING[0])
    size = np.abs(true).max()
    for ours, theirs in zip(
        predicted.receptances, true.reshape(-1, len(plan.hertz)), strict=True
    ):
        assert ours == pytest.approx(theirs, abs=1e-6 * size)


@pytest.mark.slow
def test_the_scatter_of_lines_is_that_of_the_hits():
    """Lines that noise makes small by chance are no better known than their neighbours."""
    machine, plan, located, _ = hammer("biglide", 601)
    true = strike(machine, plan, located, DAMPING)
    noise = HammerNoise(0.02, 0.003)
    (rows,) = record(true, plan, noise, np.random.default_rng(3))
    for response, exact in zip(rows, true.reshape(-1, len(plan.hertz)), strict=True):
        if np.abs(exact).max() < 1e-6 * np.abs(true).max():
            continue  # zero by symmetry
        scatter = find_scatter(response, plan.averages)
        off = np.abs(response.receptance - exact) / scatter
        assert 0.5 < np.mean(off**2) / 2.0 < 1.2


def response(quantity, coherence, hertz):
    rng = np.random.default_rng(4)
    return Response(
        force=Direction("1", 2),
        motion=Direction("12", 0, -1),
        frequency=hertz,
        receptance=rng.normal(size=len(hertz)) + 1j * rng.normal(size=len(hertz)),
        coherence=coherence,
        quantity=quantity,
        source="tap",
    )


@pytest.mark.parametrize("quantity", ["receptance", "mobility", "accelerance"])
def test_what_is_written_is_read_by_pyuff_and_by_us(quantity, tmp_path):
    hertz = 2.5 + 0.25 * np.arange(40)
    coherence = np.linspace(0.1, 1.0, 40)
    given = response(quantity, coherence, hertz)
    places = {"1": np.array([0.1, -0.2, 1.5]), "12": np.zeros(3)}
    path = tmp_path / "a.uff"
    write_uff(path, [given], places, "a title")
    (ours,) = read_uff(path).responses
    assert not read_uff(path).remarks
    assert (ours.force, ours.motion, ours.quantity) == (
        given.force,
        given.motion,
        quantity,
    )
    assert ours.frequency == pytest.approx(hertz, rel=1e-12)
    assert ours.receptance == pytest.approx(given.receptance, rel=1e-6)
    assert ours.coherence == pytest.approx(coherence, rel=1e-6)
    file = pyuff.UFF(str(path))
    assert file.get_set_types().tolist() == [164, 15, 58, 58]
    units, nodes, theirs, beside = file.read_sets()
    assert units["length"] == units["force"] == 1.0
    assert (nodes["x"], nodes["z"]) == (
        pytest.approx([0.1, 0.0]),
        pytest.approx([1.5, 0.0]),
    )
    rate = {"receptance": 0, "mobility": 1, "accelerance": 2}[quantity]
    assert theirs["x"] == pytest.approx(hertz, rel=1e-12)
    assert theirs["data"] == pytest.approx(
        given.receptance * (2j * np.pi * hertz) ** rate, rel=1e-6
    )
    assert (theirs["rsp_node"], theirs["rsp_dir"]) == (12, -1)
    assert (theirs["ref_node"], theirs["ref_dir"]) == (1, 3)
    assert beside["data"] == pytest.approx(coherence, rel=1e-6)


def test_uneven_lines_are_not_written(tmp_path):
    uneven = response("receptance", None, np.array([1.0, 2.0, 3.1]))
    with pytest.raises(InputError, match="tap: expected evenly spaced lines"):
        write_uff(tmp_path / "a.uff", [uneven], {})


@pytest.mark.slow
@pytest.mark.parametrize("ratio", [0.003, 0.01, 0.04])
def test_damping_beyond_the_band_pulls_no_line(ratio, tmp_path):
    """Modes just above the band have a damping of their own, which is no other stiffness."""
    machine, plan, located, components = hammer("five-bar", 301)
    below = plan.hertz <= 450.0  # the fifth mode is at 541 Hz
    plan = replace(plan, hertz=plan.hertz[below])
    damping = np.array([*[0.01] * 4, ratio])
    true = strike(machine, plan, located, damping)
    rows = record(true, plan, HammerNoise(), np.random.default_rng(6))
    pose = list(machine.robot.poses)[-1]
    names = {"tap": pose}
    write_responses(
        tmp_path, plan, rows, robot="five-bar", names=names, components=components
    )
    case = open_case(tmp_path)
    mechanism = rough_mechanism(case.robot, components)
    responses = load_responses(tmp_path, case.campaign, case.robot, mechanism)
    model = forward_model(case.campaign, NominalRobot(mechanism, case.robot), responses)
    (state,) = model.predict().states
    (block,) = model.blocks
    lines = np.searchsorted(plan.hertz, block.frequency - 1e-6)
    exact = true.reshape(-1, len(plan.hertz))[:, lines]
    ideal = replace(state, block=replace(block, value=exact))
    left = (stack_parts(exact) - ideal.values) / np.tile(block.sigma.ravel(), 2)
    # what the priors of damping leave: it was 260 and 2577 with the usual one beyond the band
    assert np.sum(left**2) < 8.0


@pytest.mark.slow
def test_a_gain_scales_the_responses_of_its_channels_alone():
    machine, plan, located, _ = hammer("biglide", 21)
    true = strike(machine, plan, located, DAMPING)
    for place, scaled in (
        ("hammer", [True] * 6),
        ("7", [False] * 3 + [True] * 3),
        ("1.y", [False, True, *[False] * 4]),
    ):
        wrong = inject(machine, "response-gain", place, {"factor": 1.3})
        found = strike(wrong, plan, located, DAMPING)
        factor = np.where(scaled, 1.3, 1.0)[:, None]
        assert found == pytest.approx(factor * true, rel=1e-12, abs=0.0)
