"""Modes of changed robots from those of the unchanged one, beside modes solved anew."""

import numpy as np
import pytest

from stiffscope.gap.campaigns import rough_mechanism
from stiffscope.gap.effects.effect import Payload
from stiffscope.gap.effects.elements import add_payloads, change_elements
from stiffscope.gap.forward.response_state import spread_inertia
from stiffscope.robot.reader import load_robot
from stiffscope.vjm.kinematics.configurations import configure
from stiffscope.vjm.model.checks import BASE
from stiffscope.vjm.model.mechanism import Change
from stiffscope.vjm.vibration.changed_modes import (
    AddedInertia,
    ChangedModes,
    SoundModes,
)
from stiffscope.vjm.vibration.modal_model import SolvedModes, solve_all_modes

CASES = {
    "stewart": ("strut2.drive", "strut1.head", "platform"),
    "delta": ("leg1.motor", "leg2.arm", "platform"),
    "orthoglide": ("legx.motor", "legy.rod1", "platform"),
    "serial-arm": ("J2", "upper", "flange"),
    "biglide": ("limb1.actuator", "limb2.slider", "platform"),
}
HALVED = {"biglide"}
"""Links with half their mass at each end, whose rotations have none."""


def respond(modes, node, at, square):
    """Compliance (6, 6) of a node's home point at ``s²``."""
    still, moved = modes.displace(node, at)
    flexible = 1.0 / (modes.stiffness + square * modes.mass)
    return (still * modes.static) @ still.T + (moved * flexible) @ moved.T


def agree(found, expected, tolerance=1e-8):
    unit = np.sqrt(np.abs(np.diagonal(expected, axis1=-2, axis2=-1)).max(axis=0))
    assert found / np.outer(unit, unit) == pytest.approx(
        expected / np.outer(unit, unit), abs=tolerance * 10, rel=tolerance
    )


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("grown", [0.4, -0.3])
def test_modes_of_changes_are_those_solved_anew(name, grown, rng):
    drive, other, body = CASES[name]
    robot = load_robot(name)
    nominal = rough_mechanism(robot, "published" if name in HALVED else None)
    pose = list(robot.poses.values())[1]
    found = configure(nominal, [pose])
    sound = SoundModes(solve_all_modes(nominal, found))
    at = nominal.tool.at + np.array([0.03, -0.02, 0.05])
    (joint,) = (j for j in nominal.joints if j.name == drive)
    along = np.zeros((6, 6))
    k = {"revolute": 3, "prismatic": 0}[joint.type.name]
    along[k, k] = grown / joint.drive.stiffness
    root = rng.normal(size=(6, 6)) * np.repeat([3e-6, 3e-5], 3)[:, None]
    changes = {drive: along, other: root @ root.T}
    changes[BASE] = np.diag([1e-9, 2e-9, 1e-9, 1e-7, 1e-7, 2e-7])
    centre = next(b.centre for b in nominal.bodies if b.name == body)
    at = at if grown > 0.0 else np.zeros(3) if centre is None else centre
    away = 0.2 * np.array([0.01, 0.02, 0.0]) * (grown > 0.0)
    payload = Payload(body, at, 0.2 * grown, away)
    mechanism = add_payloads(
        change_elements(nominal, {n: Change(c) for n, c in changes.items()}), [payload]
    )
    solved = SolvedModes(solve_all_modes(mechanism, found))
    where = sound.modal.system.where
    inertia = AddedInertia(body, at, spread_inertia(payload, where))
    changed = ChangedModes(sound, changes, [inertia])
    tool = nominal.tool.body
    lowest = (2 * np.pi * 5.0) ** 2
    for square in (-lowest, -400.0 * lowest):
        agree(respond(changed, tool, at, square), respond(solved, tool, at, square))
    points = [(tool, at, np.eye(6)[k]) for k in (0, 2, 4)]
    for element in (drive, other, BASE):
        ours, theirs = (
            acting(modes, element, points, tool, at, -lowest)
            for modes in (changed, solved)
        )
        size = np.abs(theirs).max()
        assert ours == pytest.approx(theirs, rel=1e-6, abs=1e-8 * size)


def acting(modes, element, points, tool, at, square):
    """Wrenches in an element under unit forces at ``s²``, with the inertial loads."""
    static, inertial = modes.find_wrenches(element, points)
    _, moved = modes.displace(tool, at)
    forces = np.array([wrench for _, _, wrench in points])
    amplitude = (moved.T @ forces.T) / (modes.stiffness + square * modes.mass)[:, None]
    return static - square * inertial @ amplitude
