"""A robot file that carries what a diagnosis found, with everything in it that it had before."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stiffscope.errors import InputError
from stiffscope.experiments.assembly import assemble
from stiffscope.gap.adoption import adopt, check_target
from stiffscope.gap.inference.diagnosis import (
    Adoptable,
    Diagnosis,
    Effect,
    Gap,
    Parameter,
    Where,
)
from stiffscope.robot.library import find_robot
from stiffscope.robot.nominal import NominalRobot
from stiffscope.robot.reader import load_robot
from stiffscope.vjm.statics.analysis import stiffness
from tests.experiments.one_part import STEP, one_part

SOFT = Effect(
    "actuator-stiffness",
    "limb1",
    0.98765,
    0.1,
    {"factor": Parameter(0.8, 0.0123456, "1")},
)
SCALE = Effect(
    "force-scale", "instrument", 0.9, 0.1, {"factor": Parameter(1.1, 0.01, "1")}
)


def diagnosis(*effects, verdict="identified"):
    return Diagnosis(
        verdict, Gap(5.0, 1.0, 1.1, 0.9, (30.0, 1.0)), effects, (), Where({"x": 1.0})
    )


@pytest.fixture
def robot():
    return load_robot("biglide")


def adopted(target, robot, found):
    bare = NominalRobot(assemble(robot, "published"), robot)
    return adopt(target, robot, bare, found, campaign="c", components="published")


def test_the_file_carries_the_effect_its_source_and_the_parts_matrices(tmp_path, robot):
    with pytest.raises(
        InputError,
        match="nothing is adopted: force-scale @ instrument: no part of the robot",
    ):
        adopted(tmp_path / "a.toml", robot, diagnosis(SOFT, SCALE))
    rival = "joint-compliance @ limb1.link1.joint_a"
    adopted(
        tmp_path / "a.toml", robot, diagnosis(replace(SOFT, confused_with=(rival,)))
    )
    now = load_robot(tmp_path / "a.toml")
    (effect,) = now.effects
    assert (effect.effect, effect.place, effect.parameters) == (
        "actuator-stiffness",
        "limb1",
        {"factor": 0.8},
    )
    assert effect.provenance["gap_before"] == 5.0
    assert effect.provenance["confused_with"] == [rival]
    assert effect.provenance["sigma"] == {"factor": 0.01235}
    assert [now.part(name).compliance for name in ("link", "slider")] == [
        "published"
    ] * 2
    text = (tmp_path / "a.toml").read_text()
    kept = [
        line
        for line in find_robot("biglide").read_text().splitlines()
        if not line.startswith("compliance")
    ]
    assert set(kept) <= set(text.splitlines())
    pose = [[0.05, 0.02, 0.4]]
    before, after = (
        np.linalg.inv(stiffness(assemble(each, "published"), pose)[0])[0, 0]
        for each in (robot, now)
    )
    assert 0 < after - before < 0.25 / 12.7e6  # the two limbs share the force along x
    adopted(tmp_path / "b.toml", now, diagnosis(SOFT))
    assert len(load_robot(tmp_path / "b.toml").effects) == 2


def test_only_what_is_certain_is_written(tmp_path, robot):
    known = diagnosis(SOFT, verdict="partly")
    link = replace(SOFT, effect="link-stiffness", place="limb2.link1", probability=0.6)
    alone = replace(SOFT, parameters={"factor": Parameter(0.7, 0.02, "1")})
    found = replace(
        known, beside=(link,), adoptable=Adoptable((alone,), {}, left_out=(link,))
    )
    adopted(tmp_path / "a.toml", robot, found)
    (effect,) = load_robot(tmp_path / "a.toml").effects
    assert (effect.effect, effect.parameters) == (SOFT.effect, {"factor": 0.7})


def test_weight_that_springs_carry_is_adopted_alone(tmp_path, robot):
    factor = {"factor": Parameter(0.4, 0.01, "1")}
    carried = Effect("mass", "robot", 1.0, 0.1, factor)
    heavier = Effect("mass", "platform", 1.0, 0.1, factor)
    with pytest.raises(InputError, match="mass @ robot: beside mass @ platform, which"):
        adopted(tmp_path / "a.toml", robot, diagnosis(carried, heavier))


def test_files_that_a_robot_names_are_named_from_the_new_place(tmp_path):
    (tmp_path / "deep").mkdir()
    one_part(tmp_path, STEP)
    text = (tmp_path / "robot.toml").read_text() + '\n[bodies.cap]\nmesh = "cap.stl"\n'
    joint = (
        '[joints.bolt]\nbetween = ["arm.tip", "cap"]\ntype = "fixed"\nat = [0, 0, 0]\n'
    )
    (tmp_path / "robot.toml").write_text(text + joint)
    (tmp_path / "cap.stl").touch()
    robot = load_robot(tmp_path / "robot.toml")
    gravity = Effect("gravity", "robot", 0.9, 0.1)
    adopt(
        tmp_path / "deep" / "new.toml",
        robot,
        None,
        diagnosis(gravity),
        campaign="c",
        components="fea",
    )
    now = load_robot(tmp_path / "deep" / "new.toml")
    assert (now.part("bar 1").file, now.bodies["cap"].mesh) == (
        "../bar.step",
        "../cap.stl",
    )
    assert now.carries("gravity")


def test_nothing_is_adopted_without_an_identified_mechanical_effect(tmp_path, robot):
    for found, message in (
        (diagnosis(SOFT, verdict="ambiguous"), "the verdict is ambiguous"),
        (diagnosis(SCALE), "nothing is adopted: force-scale @ instrument"),
    ):
        with pytest.raises(InputError, match=message):
            adopted(tmp_path / "a.toml", robot, found)
    assert not list(tmp_path.iterdir())


def test_what_must_not_be_overwritten(tmp_path, robot):
    (tmp_path / "text.toml").write_text("nothing")
    for target, message in (
        (
            tmp_path,
            "--adopt: .*: expected a file that is not there yet, got one that is",
        ),
        (tmp_path / "no" / "a.toml", "--adopt: .*no/a.toml: cannot be written"),
        (Path(robot.path), "expected a file that is not there yet"),
        (tmp_path / "text.toml", "expected a file that is not there yet"),
    ):
        with pytest.raises(InputError, match=message):
            check_target(target, robot)
    with pytest.raises(InputError, match="predictions instead of one"):
        check_target(tmp_path / "a.toml", None)
    check_target(tmp_path / "a.toml", robot)
