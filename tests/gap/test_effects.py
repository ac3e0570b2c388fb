"""Every registered effect gives every fact: a new one is an error until all is said."""

from dataclasses import replace

import numpy as np
import pytest

from stiffscope.errors import InputError
from stiffscope.gap.effects.effect import Doubts, Setting
from stiffscope.gap.effects.vocabulary import (
    EFFECTS,
    KINDS,
    apply_effect,
    find_candidates,
)
from stiffscope.lab.blind.sizes import SIZES
from stiffscope.lab.faults import KNOWN
from stiffscope.robot.mechanism_of import mechanism_of
from stiffscope.robot.nominal import NominalRobot
from stiffscope.robot.part_matrices import part_matrices
from stiffscope.robot.reader import load_robot
from tests.robots import nominal_robot

UNITS = {"1", "m", "rad", "kg", "K", "N", "N·m", "m/N", "rad/(N·m)", "rad/m", "rad/N"}
UNITS |= {"Pa", "1/(N·m)", "N/m³", "SI", ""}
WITHOUT_LAB = {
    "geometry": "many joint axes and zeros, which the laboratory has singly",
}
DOUBTS = Doubts(
    {"gauge": 1e3},
    ("gauge",),
    {"gauge": ((0, 4), 1e-4, False)},
    (("x", "y"),),
)
SPRUNG = nominal_robot("limb1.link1.joint_a.spring=40 N*m/rad")
SETTING = Setting(
    SPRUNG,
    sensors={"gauge": True},
    doubts=DOUBTS,
    load_values=((10.0, "N"), (20.0, "N"), (30.0, "N")),
    points={"7": True},
    channels={"7.x": "7", "7.y": "7", "8.x": "8"},
)
DELTA = load_robot("delta")
BEAMS = NominalRobot(mechanism_of(DELTA, part_matrices(DELTA, "beam")), DELTA)
CANDIDATES = tuple(
    (robot, c)
    for robot in (SPRUNG, BEAMS)
    for c in find_candidates(replace(SETTING, robot=robot))
)


def own_candidates(kind):
    return [(robot, c) for robot, c in CANDIDATES if isinstance(c.action, kind)]


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.word)
def test_an_effect_says_everything(kind):
    own = [c for _, c in own_candidates(kind)]
    assert own, "no place on a robot with drives, springs, elastic bodies and sensors"
    assert kind.__doc__
    for parameter in kind.parameters:
        assert parameter.unit in UNITS
        assert np.isfinite(parameter.size)
        assert parameter.size > 0.0
        assert parameter.low < parameter.high
    for c in own:
        assert c.place
        assert len(c.names) == len(c.units) == len(c.plausible or c.names)
        assert len(c.scale) == len(c.one_sided)
        assert all(np.isfinite(c.scale))
        assert min(c.scale, default=1.0) > 0.0
        assert sum(c.groups) in {0, len(c.scale)}
        assert c.action.influence(np.zeros(len(c.scale))) is not None


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.word)
def test_an_effect_is_a_fault_of_the_laboratory(kind):
    if kind.word in WITHOUT_LAB:
        assert kind.word not in KNOWN
        return
    assert kind.word in KNOWN
    assert kind.word in SIZES
    planted = {*KNOWN[kind.word].names}
    known = {p.name for p in kind.parameters if len(kind.parameters) < 21}
    assert known <= planted or kind.word == "part-dimension"


def test_the_laboratory_has_no_fault_that_is_no_effect():
    assert {*KNOWN} == {*SIZES} == {kind.word for kind in KINDS} - {*WITHOUT_LAB}


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.word)
def test_an_effect_is_adopted_or_refused_by_name(kind):
    robot, c = own_candidates(kind)[0]
    values = (
        c.physical(0.1 * np.array(c.scale)) if not c.parts else 0.1 * np.array(c.scale)
    )
    parameters = dict(zip(c.parts or c.names, values.tolist(), strict=True))
    if kind.adoptable:
        adopted = apply_effect(robot, c.effect, c.place, parameters)
        assert adopted.mechanism is not robot.mechanism or not c.scale
    else:
        with pytest.raises(InputError, match=f"{c.effect} @ {c.place}: "):
            apply_effect(robot, c.effect, c.place, parameters)


def test_words_and_precedence_are_an_effects_own():
    words = [word for kind in KINDS for word in (kind.word, *kind.also)]
    assert sorted(words) == sorted(EFFECTS)
    order = [kind.precedence for kind in KINDS]
    assert len({*order}) == len(order)


def test_only_what_readings_doubt_is_a_cause_without_parameters():
    calm = replace(SETTING, doubts=Doubts())
    plain = {c.effect for c in find_candidates(calm) if not c.scale}
    assert plain == {"gravity"}
