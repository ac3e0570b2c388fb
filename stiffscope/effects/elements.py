"""Effects on elements of the robot: compliance that they add, motion of their unloaded ends."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.effects.effect import Array, Changes, Effect, Influence, NominalRobot
from stiffscope.errors import InputError
from stiffscope.vjm.mechanism import Change

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from stiffscope.effects.effect import Payload
    from stiffscope.vjm.joints import Joint
    from stiffscope.vjm.mechanism import Mechanism


ALONG: Array = np.eye(6)[0]
"""Along an elastic body, or along the axis of a joint."""
ABOUT = np.eye(6)[3]
"""About the axis of a joint."""
ROTATIONS = np.array([0.0, 0, 0, 1, 1, 1])
_HELD_MOMENT = 1e-9  # relative: what rounding leaves of a moment


@dataclass(frozen=True)
class ElementEffect(Effect):
    """An effect that changes elements alone, and that a robot file can therefore carry."""

    adoptable = True

    changes: Callable[[Array], Changes]
    """Changes of elements for internal parameters (k,)."""

    def influence(self, values: Array) -> Influence:
        """What it changes, by internal parameters (k,)."""
        return Influence(elements=self.changes(values))


def along_drive(joint: Joint) -> Array:
    """Direction (6,) in a driven joint's axes that its drive acts along: a slide, or a turn about its axis."""
    return ABOUT if joint.kind == "revolute" else ALONG


def soften(nominal: NominalRobot, names: Sequence[str], u: Array) -> Changes:
    """Compliances of bodies grow by ``u[0]`` times their nominal, those of driven joints along their drives alone.

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


def add_diagonal(patterns: Mapping[str, Array], values: Array) -> Changes:
    """Diagonal compliances, each element's pattern (k, 6) times the parameters (k,), are added."""
    return {name: Change(np.diag(values @ pattern)) for name, pattern in patterns.items()}


def move_ends(directions: Mapping[str, Array], values: Array) -> Changes:
    """Unloaded ends of elements move along their own twists (6,) times the parameter."""
    return {name: Change(offset=direction * values[0]) for name, direction in directions.items()}


def change_elements(mechanism: Mechanism, changes: Changes) -> Mechanism:
    """The mechanism with elements changed. Raises InputError for an unknown element, or one that ends up indefinite.

    A drive that becomes stiffer takes its change itself: what is added to a joint's bearing must not be negative.
    """
    joints, bearings = list(mechanism.joints), dict(changes)
    for k, joint in enumerate(joints):
        change = changes.get(joint.name)
        along = 3 if joint.kind == "revolute" else 0
        if joint.drive is None or change is None or change.compliance is None or change.compliance[along, along] >= 0.0:
            continue
        try:
            joints[k] = replace(joint, drive=joint.drive.add_compliance(float(change.compliance[along, along])))
        except InputError as error:
            raise InputError(f"{joint.name}: {error}") from error
        rest = change.compliance.copy()
        rest[along, along] = 0.0
        bearings[joint.name] = replace(change, compliance=rest)
    stiffer = any(joint is not before for joint, before in zip(joints, mechanism.joints, strict=True))
    return (replace(mechanism, joints=tuple(joints)) if stiffer else mechanism).change_elements(bearings)


def change_robot(mechanism: Mechanism, influence: Influence) -> Mechanism:
    """The mechanism with all that an effect changes in it: its elements, its masses, the dead zones of its drives."""
    zones = influence.dead_zones
    joints = tuple(
        replace(j, drive=j.drive.add_backlash(2.0 * zones[j.name])) if j.drive is not None and zones.get(j.name) else j
        for j in mechanism.joints
    )
    changed = change_elements(replace(mechanism, joints=joints) if zones else mechanism, influence.elements)
    return add_payloads(changed, influence.payloads) if influence.payloads else changed


def add_payloads(mechanism: Mechanism, payloads: Sequence[Payload]) -> Mechanism:
    """The mechanism whose bodies have the payloads' masses too, each at a point."""
    bodies = {body.name: body for body in mechanism.bodies}
    for payload in payloads:
        name = mechanism.carrier(payload.body)
        body = bodies[name]
        centre = np.zeros(3) if body.centre is None else body.centre
        whole = body.mass + payload.mass
        if not whole > 0.0:
            raise InputError(f"{payload.body}: expected a mass above 0 kg, got {whole:g}")
        if body.elastic is not None:
            bodies[name] = replace(body, mass=whole)
            continue
        offset = payload.moments / payload.mass if payload.mass else np.zeros(3)
        away = payload.at + offset - centre
        middle = centre + away * (payload.mass / whole)
        own = np.zeros((3, 3)) if body.inertia is None else body.inertia
        reduced = body.mass * payload.mass / whole
        inertia = own + reduced * (away @ away * np.eye(3) - np.outer(away, away))
        heavy = np.linalg.eigvalsh(inertia)[0] > _HELD_MOMENT * np.abs(inertia).max() if inertia.any() else False
        bodies[payload.body] = replace(body, mass=whole, centre=middle, inertia=inertia if heavy else body.inertia)
    return replace(mechanism, bodies=tuple(bodies.values()))


def without_ranges(mechanism: Mechanism) -> Mechanism:
    """The mechanism with drives that never come to an end."""
    joints = (
        j if j.drive is None else replace(j, drive=replace(j.drive, low=-np.inf, high=np.inf)) for j in mechanism.joints
    )
    return replace(mechanism, joints=tuple(joints))
