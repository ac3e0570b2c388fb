"""Derivatives of readings by an effect's changes of elements, loads, dead zones and instruments.

A change δC of an element's compliance changes a reading by ``(W a) · δC (W b)``, a motion t of its
unloaded end by ``(W a) · t``, and a load by its work along the sensed motion (`robot_readings`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from stiffscope.gap.campaign.kinds import numbers_by_code
from stiffscope.gap.effects.effect import Payload
from stiffscope.gap.effects.elements import along_drive
from stiffscope.vjm.model.checks import GROUND
from stiffscope.vjm.model.screws import skew
from stiffscope.vjm.network.network import FOOT

if TYPE_CHECKING:
    from stiffscope.gap.forward.robot_readings import RobotReadings
    from stiffscope.gap.forward.steps import Step, Steps
    from stiffscope.runtime.types import Array

_SIGNS = numbers_by_code(lambda kind: kind.gain_sign)
_FORCE_SIGNS = numbers_by_code(lambda kind: kind.force_sign)


def find_slopes(prediction: RobotReadings, steps: Steps) -> Array:
    """Return the derivatives (n, k) of readings with respect to k parameters of one effect.

    Parameters
    ----------
    prediction
        The robot with its effects.
    steps
        The effect's changes by small steps of its parameters.
    """
    out = _of_elements(prediction, steps)
    for k, step in enumerate(steps.each):
        out[:, k] += _of_others(prediction, step)
    return out


def _of_others(prediction: RobotReadings, step: Step) -> Array:
    """Return derivatives (n,) by payloads, dead zones and instruments."""
    c = prediction.campaign
    (ahead, behind, width) = step
    out = np.zeros(len(c))
    for more, less in zip(ahead.payloads, behind.payloads, strict=True):
        mass = (more.mass - less.mass) / width
        moments = (more.moments - less.moments) / width
        force = (more.force - less.force) / width
        carried = (more.carried - less.carried) / width
        inertia = (more.inertia - less.inertia) / width
        rate = Payload(more.body, more.at, mass, moments, force, carried, inertia)
        out += _of_payload(prediction, rate)
    out += _of_dead_zones(prediction, step)
    for drive, knee in ahead.knees.items():
        other = behind.knees[drive]
        change = prediction.bent_by(drive, knee) - prediction.bent_by(drive, other)
        out += change / width
    for drive, size in ahead.frictions.items():
        now = sum(each.frictions.get(drive, 0.0) for each in prediction.influences)
        half = 0.5 * (size - behind.frictions[drive])
        near = max(half, half - now)  # forward where the drive has none
        changes = [
            prediction.yield_to_friction(drive, near + s * half) for s in (1, -1)
        ]
        out += (changes[0] - changes[1]) / width
    for name, turn in ahead.turns.items():
        out += _of_turn(prediction, name, (turn - behind.turns[name]) / width)
    for name, gain in ahead.gains.items():
        rate = (gain - behind.gains[name]) / width / prediction.gain_of(name)
        out += (
            rate
            * _SIGNS[c.quantity]
            * prediction.plain_readings
            * prediction.shown_by(name)
        )
    wrench = prediction.true_wrench
    if ahead.leak is not None and behind.leak is not None:
        rate = (ahead.leak - behind.leak) / width
        moment = np.zeros_like(wrench[:, 3:])
        out -= prediction.applied_motion(np.hstack([wrench[:, :3] @ rate.T, moment]))
    for value, growth in ahead.load_gains.items():
        now = 0.5 * (growth + behind.load_gains[value])
        rate = (growth - behind.load_gains[value]) / width / (1.0 + now)
        share = rate * prediction.has_size(value)[:, None]
        out += prediction.applied_motion(share * wrench)
    if ahead.force_gain != behind.force_gain:
        rate = (ahead.force_gain - behind.force_gain) / width / prediction.force_scale
        out += rate * (
            _FORCE_SIGNS[c.quantity] * prediction.plain_readings
            + prediction.pushed_targets
        )
    return out


def _of_elements(prediction: RobotReadings, steps: Steps) -> Array:
    """Return derivatives (n, k) from the wrenches in the changed elements."""
    c = prediction.campaign
    out = np.zeros((len(c), len(steps.each)))
    still = np.where(c.shows_rest, 1.0, 0.0)[:, None]
    for name in steps.elements:
        mine, rates = steps.find_rates(name, "spring")
        if len(mine):
            read_along, moved = prediction.find_motions(name)
            away = prediction.at.find_displacement(name)[c.pose]
            out[:, mine] -= (
                np.einsum("nk,nk->n", read_along, moved + still * away)[:, None] * rates
            )
            continue
        read, applied = prediction.find_wrenches(name)
        mine, rates = steps.find_rates(name, "compliance")
        if len(mine):
            applied = _relieve(prediction, name, applied)
            work = (read[:, :, None] * applied[:, None, :]).reshape(len(c), -1)
            out[:, mine] += work @ rates.reshape(len(mine), -1).T
        mine, rates = steps.find_rates(name, "offset")
        if len(mine):
            out[:, mine] += still * read @ rates.T
            out[:, mine] += _of_moved_nodes(prediction, name, rates.T[None])
        mine, rates = steps.find_rates(name, "misalignment")
        if len(mine):
            apart = _turn_about(prediction, name)
            turned = read[:, None] @ apart[c.pose]
            out[:, mine] += still * turned[:, 0] @ rates.T
            out[:, mine] += _of_moved_nodes(prediction, name, apart @ rates.T)
            out[:, mine] += _of_moved_axis(prediction, name, rates.T)
    return out


def _relieve(prediction: RobotReadings, name: str, wrench: Array) -> Array:
    """Return the wrenches (n, 6) on an element without what friction beside its spring holds."""
    if not any(name in each.frictions for each in prediction.influences):
        return wrench
    axis = along_drive(prediction.at.robot.driven[name])
    return wrench - prediction.held_by(name)[:, None] * axis


def _of_moved_nodes(prediction: RobotReadings, name: str, ends: Array) -> Array:
    """Return derivatives (n, k) of loaded readings by twists (p or 1, 6m, k) of unloaded ends.

    Own axes.
    """
    by_end = prediction.find_end_rates(name)
    twists = ends[prediction.campaign.pose] if len(ends) > 1 else ends
    return (by_end[:, None] @ twists)[:, 0]


def _of_moved_axis(prediction: RobotReadings, name: str, twists: Array) -> Array:
    """Return derivatives (n, k) of loaded readings by twists (6, k) of a joint's axis, own axes."""
    places = prediction.elastic_state.places
    element = prediction.at.response.elements[name].element
    pose = prediction.campaign.pose

    def on_node(node: str, vectors: Array) -> Array:
        turned = places.axes(node, element.axes) @ vectors
        return turned[pose] if len(turned) > 1 else turned

    rates = prediction.motion_rates.axes[name]
    shifts = on_node(rates.bearer, twists[:3])
    out = (rates.shift[:, None] @ shifts)[:, 0]
    for node, by_turn in rates.turns:
        out += (by_turn[:, None] @ on_node(node, twists[3:]))[:, 0]
    return out


def _turn_about(prediction: RobotReadings, name: str) -> Array:
    """Return twists (p, 6, 6) between a joint's unloaded ends, own axes, per twist of its axis.

    ``1 - Ad(G)``, with the displacement G of the second body relative to the first, from home.
    """
    where = prediction.elastic_state.places
    joint = prediction.at.mechanism.joint(name)
    first, second = (
        FOOT if node == GROUND else node for node in (joint.first, joint.second)
    )
    back = np.swapaxes(where.rotation[first] @ joint.axes, -1, -2)
    turn = back @ where.rotation[second] @ joint.axes
    away = where.point(second, joint.at) - where.point(first, joint.at)
    slid = (back @ away[..., None])[..., 0]
    out = np.zeros((max(len(turn), len(slid)), 6, 6))
    out[:, :3, :3] = out[:, 3:, 3:] = np.eye(3) - turn
    out[:, :3, 3:] = -skew(slid)
    if joint.is_on_first:  # about the bearing's point, from which the second's has slid
        out[:, :3] += skew(slid) @ out[:, 3:]
    return np.broadcast_to(out, (len(prediction.campaign.poses), 6, 6))


def _of_dead_zones(prediction: RobotReadings, step: Step) -> Array:
    """Return derivatives (n,) by dead zones, and by what holds drives to a side of them."""
    (ahead, behind, width) = step
    out = np.zeros(len(prediction.campaign))
    for drive, size in ahead.dead_zones.items():
        held = ahead.preloads.get(drive)
        force = None if held is None else held.force
        more = size - behind.dead_zones[drive]
        out += more / width * prediction.dead_zone(drive, force)
        if held is not None:
            # readings step with a preload: of a range of it, the mean slope
            rate = size * (held.force - behind.preloads[drive].force) / width
            ends = [held.force + side * held.reach for side in (1.0, -1.0)]
            change = [prediction.dead_zone(drive, each) for each in ends]
            out += rate * (change[0] - change[1]) / (2.0 * held.reach)
    return out


def _of_payload(prediction: RobotReadings, payload: Payload) -> Array:
    """Return derivatives (n,) by a payload's weight, and by its inertia for frequencies."""
    c = prediction.campaign
    elastic = prediction.elastic_state
    weight = elastic.weights([payload], weighs=prediction.weighs)
    along = elastic.work_on_node(payload.body, weight)[..., 0]  # (p, cases)
    work = np.einsum("nc,nc->n", prediction.sense, along[c.pose])
    return prediction.ask(
        lambda predictor, rows: predictor.load(prediction, rows, payload, work[rows])
    )


def _of_turn(prediction: RobotReadings, name: str, rate: Array) -> Array:
    """Return derivatives (n,) by a rotation (3,) of a named instrument."""
    c = prediction.campaign
    shown = prediction.shown_by(name)
    turn = np.kron(np.eye(2), np.cross(rate, np.eye(3)).T)
    out = np.zeros(len(c))
    for predictor, rows in prediction.at.predictors:
        turned = rows[shown[rows]]
        if turned.size:
            out[turned] = predictor.turn(prediction, turned, turn)
    return out
