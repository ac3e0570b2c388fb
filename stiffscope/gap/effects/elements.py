"""Effects on elements of the robot: added compliance and displacement of unloaded ends."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.errors import naming, require
from stiffscope.gap.effects.effect import (
    Array,
    Changes,
    Effect,
    Influence,
    NominalRobot,
)
from stiffscope.vjm.model.mechanism import Change

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from stiffscope.gap.effects.effect import Parameter, Payload, Place
    from stiffscope.vjm.model.joints import Joint
    from stiffscope.vjm.model.mechanism import Mechanism


ALONG: Array = np.eye(6)[0]
"""Translation along an elastic body or along the axis of a joint."""
ABOUT = np.eye(6)[3]
"""Rotation about the axis of a joint."""
ROTATIONS = np.array([0.0, 0, 0, 1, 1, 1])
_HELD_MOMENT = 1e-9  # relative rounding error of a moment of inertia


@dataclass(frozen=True)
class ElementEffect(Effect):
    """An effect that only changes elements, so that a robot file may contain it."""

    adoptable = True

    changes: Callable[[Array], Changes]
    """Function from internal parameters (k,) to changes of elements."""

    def influence(self, values: Array) -> Influence:
        """Return the changes for internal parameters (k,)."""
        return Influence(elements=self.changes(values))


def along_drive(joint: Joint) -> Array:
    """Return the direction (6,) of a drive in its joint's axes: a translation or a rotation."""
    return ABOUT if joint.turns else ALONG


def soften(nominal: NominalRobot, names: Sequence[str], u: Array) -> Changes:
    """Add ``u[0]`` times the nominal compliance; for driven joints, only along the drive.

    Parameters
    ----------
    nominal
        Robot without effects.
    names
        Names of the elements.
    u
        Relative growth of the compliances (1,).
    """
    out: Changes = {}
    for name in names:
        compliance = nominal.compliances[name]
        if name in nominal.driven:
            axis = along_drive(nominal.driven[name])
            compliance = np.outer(axis, axis) * float(axis @ compliance @ axis)
        out[name] = Change(compliance * u[0])
    return out


def pick_patterns(
    found: Mapping[str, Mapping[str, Array]],
    place: Place,
    parameters: Sequence[Parameter],
) -> tuple[list[Parameter], dict[str, Array]]:
    """Return the parameters that some elements have, and each element's patterns (k, 6) of them."""
    own = {name: found[name] for name in place.members}
    known = [p for p in parameters if any(p.name in each for each in own.values())]
    return known, {
        n: np.array([own[n].get(p.name, np.zeros(6)) for p in known]) for n in own
    }


def add_diagonal(patterns: Mapping[str, Array], values: Array) -> Changes:
    """Add diagonal compliances: the parameters (k,) times each element's pattern (k, 6)."""
    return {
        name: Change(np.diag(values @ pattern)) for name, pattern in patterns.items()
    }


def move_ends(directions: Mapping[str, Array], values: Array) -> Changes:
    """Move unloaded ends of elements by the parameter times their own twists (6,)."""
    return {
        name: Change(offset=direction * values[0])
        for name, direction in directions.items()
    }


def change_elements(mechanism: Mechanism, changes: Changes) -> Mechanism:
    """Return the mechanism with changes. Raises InputError for an unknown or indefinite element.

    A change that stiffens a drive acts on it and on its bearing (a ball screw) in proportion to their compliances.
    """
    stiffer: dict[str, Joint] = {}
    bearings = dict(changes)
    for joint in mechanism.joints:
        change = changes.get(joint.name)
        if joint.drive is None or change is None or change.compliance is None:
            continue
        along = joint.type.driven or 0
        rest = change.compliance.copy()
        screw = (
            0.0 if joint.compliance is None else float(joint.compliance[along, along])
        )
        added = float(rest[along, along]) / (1.0 + screw * joint.drive.stiffness)
        rest[along, along] -= added
        if added < 0.0:
            with naming(joint.name):
                stiffer[joint.name] = replace(
                    joint, drive=joint.drive.add_compliance(added)
                )
            bearings[joint.name] = replace(change, compliance=rest)
    if stiffer:
        joints = tuple(stiffer.get(joint.name, joint) for joint in mechanism.joints)
        mechanism = replace(mechanism, joints=joints)
    return mechanism.change_elements(bearings)


def change_robot(mechanism: Mechanism, influence: Influence) -> Mechanism:
    """Return the mechanism with an effect's changes of elements, masses and dead zones."""
    joints = list(mechanism.joints)
    for k, joint in enumerate(joints):
        if joint.drive and (width := influence.dead_zones.get(joint.name)):
            joints[k] = replace(joint, drive=joint.drive.add_backlash(2.0 * width))
        if joint.drive and (knee := influence.knees.get(joint.name)):
            factors = 1.0 / (1.0 + knee.below), 1.0 / (1.0 + knee.beyond)
            joints[k] = replace(joint, drive=joint.drive.bend_at(knee.load, *factors))
    gravity = (1.0 - influence.carried) * mechanism.gravity
    changed = change_elements(
        replace(mechanism, joints=tuple(joints), gravity=gravity), influence.elements
    )
    return add_payloads(changed, influence.payloads)


def add_payloads(mechanism: Mechanism, payloads: Sequence[Payload]) -> Mechanism:
    """Return the mechanism with the payloads, and their own inertia, added to its bodies."""
    bodies = {body.name: body for body in mechanism.bodies}
    for payload in payloads:
        if not payload.mass and not payload.moments.any():
            continue  # a pull has no inertia, nor has weight that is carried
        name = mechanism.carrier(payload.body)
        body = bodies[name]
        centre = np.zeros(3) if body.centre is None else body.centre
        whole = body.mass + payload.mass
        require(whole > 0.0, payload.body, "a mass above 0 kg", f"{whole:g}")
        if body.elastic is not None:
            bodies[name] = replace(body, mass=whole)
            continue
        offset = payload.moments / payload.mass if payload.mass else np.zeros(3)
        away = payload.at + offset - centre
        middle = centre + away * (payload.mass / whole)
        own = np.zeros((3, 3)) if body.inertia is None else body.inertia
        own = own + payload.inertia
        reduced = body.mass * payload.mass / whole
        inertia = own + reduced * (away @ away * np.eye(3) - np.outer(away, away))
        least = np.linalg.eigvalsh(inertia)[0]
        rounding = _HELD_MOMENT * np.abs(inertia).max()
        # a point mass beside a point resists no turn about the line through both
        if least < -rounding or (body.inertia is None and not least > rounding):
            inertia = body.inertia
        bodies[payload.body] = replace(body, mass=whole, centre=middle, inertia=inertia)
    return replace(mechanism, bodies=tuple(bodies.values()))


def without_ranges(mechanism: Mechanism) -> Mechanism:
    """Return the mechanism with unlimited drive ranges."""
    drives = (
        j.drive and replace(j.drive, low=-np.inf, high=np.inf) for j in mechanism.joints
    )
    joints = (
        replace(j, drive=drive)
        for j, drive in zip(mechanism.joints, drives, strict=True)
    )
    return replace(mechanism, joints=tuple(joints))
