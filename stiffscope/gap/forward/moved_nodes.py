"""Derivatives of loaded readings by small motions of the network's nodes (docs/theory.md, (8.2a)).

A reading ``a · D b`` is the stationary value of ``Σ w_a · e_b``, with the wrenches w in the elements and
the twists e across them under the loads a and b. A node that is moved changes it only through what
is fixed to that node: an element whose frame moves by a twist ξ changes it by
``w_a · [ξ, e_b] + w_b · [ξ, e_a]``, a force f on a node that rotates by ω, whose point moves by δ, by
``ω_a · (δ × f_b) + ω_b · (δ × f_a)``.

Twists and wrenches are at M in base axes. Directions of forces and gauges do not turn with bodies.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator

    from stiffscope.gap.forward.robot_readings import RobotReadings
    from stiffscope.runtime.types import Array
    from stiffscope.vjm.network.loading import ElementState
    from stiffscope.vjm.network.network import Element

Pair = tuple["Array", "Array"]
"""Twists or wrenches (n, 6) of every reading under its loads a and b."""


def cross(a: Array, b: Array) -> Array:
    """Return the cross products (n, 3) of vectors (n, 3); NumPy's own takes longer for few."""
    after = [1, 2, 0]
    before = [2, 0, 1]
    return a[:, after] * b[:, before] - a[:, before] * b[:, after]


@dataclass(frozen=True)
class AxisRates:
    """Derivatives of readings by the place of an element's axes on its nodes, base axes."""

    bearer: str
    shift: Array
    """By a shift (n, 3) of its point on the bearer."""
    turns: tuple[tuple[str, Array], ...]
    """Nodes, and derivatives (n, 3) by the rotation of the axes on each."""


@dataclass(frozen=True)
class MotionRates:
    """Derivatives of readings by twists (n, 6) of nodes, and by the places of elements' axes."""

    nodes: dict[str, Array]
    axes: dict[str, AxisRates]


def find_motion_rates(readings: RobotReadings) -> MotionRates:
    """Return the derivatives of readings by motions of nodes, and of axes on their nodes.

    The loads are held. Without what the motion itself shows of an unloaded robot; zero for modes of
    vibration.

    Parameters
    ----------
    readings
        The robot with its effects.
    """
    nodes: dict[str, Array] = {}
    axes: dict[str, AxisRates] = {}
    state = readings.elastic_state
    places = state.places
    pose = readings.campaign.pose

    def add(node: str, by_twist: Array) -> None:
        nodes[node] = nodes[node] + by_twist if node in nodes else by_twist

    def lever(point: Array) -> Array:
        away = point - places.tool
        return np.broadcast_to(away, (len(readings.campaign.poses), 3))[pose]

    states = list(state.element_states)
    twists = readings.at_each_load([each.across for each in states])
    wrenches = readings.at_each_load([each.carried for each in states])
    for each, across, carried in zip(states, twists, wrenches, strict=True):
        element = each.element
        arm = lever(places.point(element.bearer, element.at))
        shift = np.zeros((len(pose), 3))
        turns: list[tuple[str, Array]] = []
        for carrier, part in _split_by_carrier(each, readings, across):
            along, about = _turn_frame(part, carried)
            shift = shift + along
            turns.append((carrier, about - cross(arm, along)))
        axes[element.name] = AxisRates(element.bearer, shift, tuple(turns))
        add(element.bearer, np.hstack([shift, cross(arm, shift)]))
        if element.joint is None and element.factor.shape[1]:
            bent = _bend_frame(readings, element, across, carried, arm)
            turns = [*turns, (element.second, bent), (element.first, -bent)]
        for carrier, about in turns:
            add(carrier, np.hstack([0.0 * about, about]))
    for push in state.pushes():
        turned = readings.at_loads(state.node(push.node)[:, 3:])
        forces = readings.at_loads(push.force, push.cases)
        along = cross(forces[1], turned[0]) + cross(forces[0], turned[1])
        add(push.carrier, np.hstack([along, cross(lever(push.point), along)]))
    return MotionRates(nodes, axes)


def _split_by_carrier(
    state: ElementState, readings: RobotReadings, across: Pair
) -> Iterator[tuple[str, Pair]]:
    """Yield parts of the twists across an element by the node in whose axes they are constant.

    The last axis about which a joint turns is on its second body.
    """
    element = state.element
    late = find_late_motion(state)
    if late is None:
        yield element.carrier, across
        return
    part = readings.at_loads(late)
    yield element.second, part
    yield element.carrier, (across[0] - part[0], across[1] - part[1])


def _bend_frame(
    readings: RobotReadings, element: Element, across: Pair, carried: Pair, arm: Array
) -> Array:
    """Return the derivatives (n, 3) by the rotation of an elastic body's second node from its first.

    Its rotations about x, y, z succeed each other: the first turns the axes of those after it.
    """
    places = readings.elastic_state.places
    frame = places.axes(element.carrier, element.axes)
    frame = frame[readings.campaign.pose] if len(frame) > 1 else frame
    bent = np.zeros((len(arm), 3))
    for twist, wrench in ((across[1], carried[0]), (across[0], carried[1])):
        moment = wrench[:, 3:] - cross(arm, wrench[:, :3])
        (_, y, z) = np.einsum("nji,nj->in", frame, twist[:, 3:])
        (by_x, by_y, by_z) = np.einsum("nji,nj->in", frame, moment)
        bent[:, 0] += y * by_z - z * by_y
        bent[:, 1] += z * by_x
    return (frame @ bent[..., None])[..., 0]


def find_late_motion(state: ElementState) -> Array | None:
    """Return the twist (n, 6, c) about an axis on the second body of a joint; None without one."""
    element = state.element
    joint = element.joint
    if joint is None or joint.type.is_steady or joint.type.is_ball:
        return None
    factor, free = state.where.columns(element)
    turning = np.flatnonzero(element.free[3:].any(axis=0))
    if turning.size:
        last = turning[-1]
        return free[..., last : last + 1] @ state.rates[:, last : last + 1]
    if joint.cross and element.sprung:
        column = factor[..., -1:]
        return column @ (column.mT @ state.carried)
    return None


def _turn_frame(across: Pair, carried: Pair) -> Pair:
    """Return the derivatives (n, 3) and (n, 3) by the twist of an element's frame."""
    along = np.zeros((len(across[0]), 3))
    about = np.zeros((len(across[0]), 3))
    for twist, wrench in ((across[1], carried[0]), (across[0], carried[1])):
        shift, turn = np.split(twist, 2, axis=1)
        force, moment = np.split(wrench, 2, axis=1)
        along += cross(turn, force)
        about += cross(shift, force) + cross(turn, moment)
    return along, about
