"""Elastic robot with effects at a campaign's poses: motions and wrenches per unit terminal load."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.errors import InputError
from stiffscope.gap.campaign.kinds import MODE_OF, SPARE_MODES_OF
from stiffscope.gap.effects.elements import add_payloads, change_elements
from stiffscope.gap.forward import robot_at_poses
from stiffscope.gap.forward.inner_points import InnerPoint, inner_point, twists_at
from stiffscope.gap.forward.terminals import (
    find_inertial_forces,
    find_weight,
    wrenches_at,
)
from stiffscope.vjm.kinematics.linkage import rotation_vector
from stiffscope.vjm.model.checks import GROUND
from stiffscope.vjm.network.loading import ElementState, Loads
from stiffscope.vjm.network.network import END, FOOT, place_nodes
from stiffscope.vjm.network.order import find_order, stack_columns
from stiffscope.vjm.network.strain import find_offsets, find_remaining_offsets
from stiffscope.vjm.statics.equilibrium import solve_loads
from stiffscope.vjm.statics.prestress import bend_places
from stiffscope.vjm.vibration.modes import modes

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from stiffscope.gap.campaign.campaign import Campaign, Sensor
    from stiffscope.gap.effects.effect import Changes, Payload
    from stiffscope.gap.forward.robot_at_poses import RobotAtPoses
    from stiffscope.gap.forward.terminals import Push
    from stiffscope.runtime.types import Array
    from stiffscope.vjm.model.mechanism import Mechanism
    from stiffscope.vjm.network.loading import Response
    from stiffscope.vjm.network.network import Places
    from stiffscope.vjm.vibration.modes import Modes

_TOOL = slice(0, 6)
_NEWTON_STEPS = 13
_CLOSED = (
    1e-5  # rad, or relative to the mechanism's length: size of the last Newton step
)
_LOST = 1e3  # likewise: a step after which the loops never close, only overflow


@dataclass(frozen=True)
class ElasticState:
    """A robot with changed elements; all properties are lazy and cached."""

    at: RobotAtPoses
    changes: tuple[Changes, ...] = ()
    payloads: tuple[Payload, ...] = ()
    weighs: bool = True
    """Whether weight acts on the payloads."""
    _nodes: dict[str, Array] = field(default_factory=dict[str, Any], compare=False)
    _wrenches: dict[str, Array] = field(default_factory=dict[str, Any], compare=False)
    _moved: dict[tuple[object, ...], Array] = field(
        default_factory=dict[Any, Any], compare=False
    )

    @cached_property
    def mechanism(self) -> Mechanism:
        """The robot with its changes. Raises InputError for an element that becomes indefinite."""
        mechanism = self.at.mechanism
        for change in self.changes:
            mechanism = change_elements(mechanism, change)
        return mechanism

    @cached_property
    def places(self) -> Places:
        """Nodes displaced by geometric errors; Newton steps of the elastic network close the loops.

        Raises InputError if they do not close.
        """
        rest = self.at.rest
        if not self._is_displaced:
            return rest
        order = find_order(self.mechanism, self.at.configurations.linkage)
        offsets = find_offsets(order, rest)
        if not offsets:
            return rest
        first = self.at.displace(offsets)
        if first is None:
            first = solve_loads(order, rest, Loads(1, {}, offsets), "nodes")
        there = bend_places(rest, first)
        size = _size(first, order.length)
        for _ in range(_NEWTON_STEPS):
            if size < _CLOSED:
                return there
            if not size < _LOST:
                break
            offsets = find_remaining_offsets(order, there, rest)
            step = solve_loads(
                order, there, Loads(1, {}, offsets, balanced=1.0), "nodes"
            )
            there = bend_places(there, step)
            size = _size(step, order.length)
        raise InputError("loop closure: no solution for these geometric errors")

    @property
    def _is_displaced(self) -> bool:
        """Whether geometric errors displace the unloaded robot."""
        changes = (change for elements in self.changes for change in elements.values())
        return self.at.is_displaced or any(c.displaces or c.spring for c in changes)

    @cached_property
    def response(self) -> Response:
        """Equilibrium of the whole network under unit loads at all terminals."""
        where = self.places
        if not self.changes and not self.payloads and where is self.at.rest:
            return self.at.response
        order = find_order(self.mechanism, self.at.configurations.linkage)
        return solve_loads(
            order,
            where,
            self.at.unit_loads(
                where, self.mechanism, self.payloads, weighs=self.weighs
            ),
        )

    @cached_property
    def _response(self) -> Softened:
        added = self._added_compliance
        return (
            Softened(self.response)
            if added is None
            else soften_elements(self.at, added)
        )

    @cached_property
    def _added_compliance(self) -> dict[str, Array] | None:
        """Added compliance of few elements; None if anything else has changed."""
        if not self.changes or self.payloads or self._is_displaced:
            return None
        added: dict[str, Array] = {}
        for each in self.changes:
            for name, change in each.items():
                if change.compliance is not None and change.compliance.any():
                    added[name] = added.get(name, 0.0) + change.compliance
        if len(added) > robot_at_poses.FEW:
            return None
        return added if self.mechanism else None  # checks that every element is valid

    def _at_every_pose(self, value: Array) -> Array:
        return np.broadcast_to(value, (len(self.at.campaign.poses), *value.shape[1:]))

    @cached_property
    def tool(self) -> Array:
        """Twists (p, 6, cases) of the tool at M."""
        return self._at_every_pose(self.node(END))

    def node(self, name: str) -> Array:
        """Return the twists (n, 6, cases) of a node at M in base axes."""
        if name not in self._nodes:
            self._nodes[name] = self._response.node(name)
        return self._nodes[name]

    @property
    def element_states(self) -> Iterator[ElementState]:
        """States of all elements under unit loads at all terminals."""
        return self._response.element_states()

    def pushes(self) -> Iterator[Push]:
        """Yield the wrenches on nodes by all terminals."""
        payloads = self.payloads
        weighs = self.weighs
        return self.at.pushes(self.places, self.mechanism, payloads, weighs=weighs)

    @property
    def compliance(self) -> Array:
        """Compliance (p, 6, 6) at M."""
        return self.tool[..., _TOOL]

    def move_sensor(self, number: int) -> Array:
        """Return motions (p, 6, cases) of M (-1), or a sensor's point from its mount; base axes."""
        if number < 0:
            return self.tool
        sensor = self.at.campaign.sensors[number]
        # channels of one target share its motion
        point = (sensor.body, tuple(sensor.at), sensor.inside, sensor.against)
        if point not in self._moved:
            self._moved[point] = self._move_point(sensor)
        return self._moved[point]

    def _move_point(self, sensor: Sensor) -> Array:
        """Return motions (p, 6, cases) of a sensor's point from its mount; base axes."""
        where = self.places

        def motion(node: str) -> Array:
            back = np.swapaxes(wrenches_at(where, sensor.body, sensor.at), -1, -2)
            return back @ self.node(FOOT if node == GROUND else node)

        across = motion(sensor.body)
        inner = inner_point(self.mechanism, sensor)
        if inner is not None:
            bent = inner.spread(where) @ (self.node(inner.tip) - self.node(inner.base))
            across = across + twists_at(where, inner.base, np.array(sensor.at)) @ bent
        if sensor.against != GROUND:
            across = across - motion(sensor.against)
        return self._at_every_pose(across)

    def weights(self, payloads: Sequence[Payload], *, weighs: bool) -> Array:
        """Return the wrenches (p or 1, 6, k) of payloads' weights and pulls, at M in base axes."""
        where = self.places
        gravity = float(weighs) * self.at.mechanism.gravity
        return np.stack(
            [find_weight(payload, where, gravity) for payload in payloads], axis=2
        )

    def work_on_node(self, node: str, wrenches: Array) -> Array:
        """Return work (p, cases, k) of wrenches (p or 1, 6, k) on a node for each terminal load."""
        return self._at_every_pose(np.swapaxes(self.node(node), -1, -2) @ wrenches)

    def transmit_motions(self, name: str) -> Array:
        """Return motions (p, k, cases) in a joint's free directions per terminal unit load."""
        return self._at_every_pose(self._response.find_motions(name))

    def move_modes(self, name: str) -> Array:
        """Return motions (s, k, c) in a joint's free directions in each mode of 1 kg modal mass."""
        moved = self._inertial_equilibrium.elements[name].motions
        return np.broadcast_to(moved, (len(self.at.shaken), *moved.shape[1:]))

    def transmit_wrenches(self, name: str) -> Array:
        """Return wrenches (p, 6m, cases) on an element's ends but the first, own axes."""
        if name not in self._wrenches:
            wrench = self._response.find_wrench(self.at.mechanism.rows(name))
            self._wrenches[name] = self._at_every_pose(wrench)
        return self._wrenches[name]

    def displace_sensor(self, number: int) -> Array:
        """Return exact shift and rotation (p, 6) of M (-1) or a sensor by geometric errors."""
        at = self.at
        if self.places is at.rest:
            return np.zeros((len(at.campaign.poses), 6))
        moved = measure_motion(at.campaign, at.mechanism, number, self.places, at.rest)
        return self._at_every_pose(moved)

    @cached_property
    def _modes(self) -> Modes:
        """Lowest modes at the poses with frequency readings, drives locked."""
        at = self.at
        c = self.at.campaign
        mode = MODE_OF[c.quantity]
        count = int(mode.max()) + 1
        most = count + int(SPARE_MODES_OF[c.quantity].max())
        vibration_modes = modes(
            self.loaded_mechanism, at.configurations[at.shaken], most
        )
        read = vibration_modes.frequencies[:, :count]
        if read.shape[1] < count or np.isnan(read).any():
            row = int(np.argmax(mode >= 0))
            where = f"{c.where(row)}: quantity"
            raise InputError(
                f"{where}: expected one of the modes that the robot has, got f{count}"
            )
        return vibration_modes

    @cached_property
    def loaded_mechanism(self) -> Mechanism:
        """The robot with its changes and payloads."""
        return add_payloads(self.mechanism, self.payloads)

    @property
    def frequencies(self) -> Array:
        """Natural frequencies (s, c), Hz, at the poses with frequency readings, drives locked."""
        return self._modes.frequencies

    @cached_property
    def _inertial_equilibrium(self) -> Response:
        """Equilibrium under the inertial loads ``ω² M v`` of each mode v, at maximum deflection."""
        configurations = self._modes.configurations
        where = place_nodes(self._modes.configurations)
        squares = np.square(2.0 * np.pi * self.frequencies)[:, None]
        inertia = find_inertial_forces(self.loaded_mechanism, where, self._modes.shapes)
        forces = {node: force * squares for node, force in inertia.items()}
        loads = Loads(squares.shape[2], forces, balanced=1.0)
        return solve_loads(
            find_order(self.mechanism, configurations.linkage), where, loads
        )

    def load_modes(self, name: str) -> Array:
        """Return wrenches (s, 6m, c) on an element, own axes, in each mode of 1 kg modal mass."""
        wrench = self._inertial_equilibrium.find_wrench(self.at.mechanism.rows(name))
        return np.broadcast_to(wrench, (len(self.at.shaken), *wrench.shape[1:]))

    def twist_modes(self, node: str, home: Array) -> Array:
        """Return twists (s, 6, c) of a body point, base axes, in each mode of 1 kg modal mass."""
        where = place_nodes(self._modes.configurations)
        return (
            np.swapaxes(wrenches_at(where, node, home), -1, -2)
            @ self._modes.shapes[node]
        )


@dataclass(frozen=True)
class Softened:
    """Response of a robot with softened elements, in terms of responses of the sound robot."""

    sound: Response
    cuts: tuple[Response, ...] = ()
    """Responses to unit twists between the ends of each softened element."""
    slips: tuple[Array, ...] = ()
    """Additional deformation (n, 6, cases) of each softened element."""

    def node(self, name: str) -> Array:
        """Return the twists (n, 6, cases) of a node at M in base axes."""
        out = self.sound.nodes[name]
        for cut, slip in zip(self.cuts, self.slips, strict=True):
            out = out + cut.nodes[name] @ slip
        return out

    def find_motions(self, name: str) -> Array:
        """Return motions (n, k, cases) in a joint's free directions."""
        out = self.sound.elements[name].motions
        for cut, slip in zip(self.cuts, self.slips, strict=True):
            out = out + cut.elements[name].motions @ slip
        return out

    def element_states(self) -> Iterator[ElementState]:
        """Yield the states of all elements."""
        for name, state in self.sound.elements.items():
            carried, across, rates = state.carried, state.across, state.rates
            for cut, slip in zip(self.cuts, self.slips, strict=True):
                element = cut.elements[name]
                carried = carried + element.carried @ slip
                across = across + element.across @ slip
                rates = rates + element.rates @ slip
            yield ElementState(state.element, state.where, carried, across, rates)

    def find_wrench(self, rows: Sequence[str]) -> Array:
        """Return wrenches (n, 6m, cases) in m elements, each at its own point in its own axes."""
        out = self.sound.find_wrench(rows)
        for cut, slip in zip(self.cuts, self.slips, strict=True):
            out = out + cut.find_wrench(rows) @ slip
        return out


def soften_elements(at: RobotAtPoses, added: Mapping[str, Array]) -> Softened:
    """Return the response of the sound robot with compliance (6m, 6m) added to elements.

    The added deformation ΔC w of an element under wrench w acts like an offset between its ends:
    ``w = w₀ + K ΔC w``, with wrenches K per unit twist between the ends (Woodbury identity).
    """
    sound = at.response
    names = list(added)
    if not names:
        return Softened(sound)
    cuts = tuple(at.cut(name) for name in names)
    rows = [row for name in names for row in at.mechanism.rows(name)]
    gains = [
        cut.find_wrench(rows) @ added[own] for cut, own in zip(cuts, names, strict=True)
    ]
    carried = np.linalg.solve(
        np.eye(6 * len(rows)) - stack_columns(gains), sound.find_wrench(rows)
    )
    ends = np.cumsum([len(added[name]) for name in names])[:-1]
    parts = zip(added.values(), np.split(carried, ends, axis=1), strict=True)
    return Softened(sound, cuts, tuple(compliance @ part for compliance, part in parts))


def measure_motion(
    campaign: Campaign, mechanism: Mechanism, number: int, there: Places, rest: Places
) -> Array:
    """Return exact shift and rotation (n or 1, 6) of M (-1), or a sensor from its mount.

    Parameters
    ----------
    campaign, mechanism
        The sensors, and the tool.
    number
        Index of the sensor, or -1.
    there, rest
        Places of the nodes, displaced and nominal.
    """
    if number < 0:
        return _go(there, rest, END, mechanism.tool.at)
    sensor = campaign.sensors[number]
    body = FOOT if sensor.body == GROUND else sensor.body
    across = _go(there, rest, body, np.array(sensor.at))
    inner = inner_point(mechanism, sensor)
    if inner is not None:
        across = across + _go_within(there, rest, inner, np.array(sensor.at))
    if sensor.against == GROUND:
        return across
    point = rest.point(body, np.array(sensor.at))  # carried by the sensor's mount
    back = np.swapaxes(rest.rotation[sensor.against], -1, -2)
    turn = there.rotation[sensor.against]
    home = back @ (point - rest.position[sensor.against])[..., None]
    carried = (turn @ home)[..., 0] + there.position[sensor.against] - point
    return across - _join(carried, rotation_vector(turn @ back))


def _go(there: Places, rest: Places, node: str, home: Array) -> Array:
    """Return a body point's translation and rotation vector (n, 6) from the nominal pose."""
    away = there.point(node, home) - rest.point(node, home)
    turn = there.rotation[node] @ np.swapaxes(rest.rotation[node], -1, -2)
    return _join(away, rotation_vector(turn))


def _go_within(there: Places, rest: Places, inner: InnerPoint, home: Array) -> Array:
    """Return what displaced ends of an elastic body add (n, 6) to a point (3,) between them."""
    end = inner.elastic.tip
    moved = _go(there, rest, inner.tip, end) - _go(there, rest, inner.base, end)
    at_m = np.linalg.solve(twists_at(rest, inner.tip, end), moved[..., None])
    at_point = twists_at(rest, inner.base, home)
    return (at_point @ inner.spread(rest) @ at_m)[..., 0]


def _join(shift: Array, turn: Array) -> Array:
    """Return six components (n, 6) of shifts (n or 1, 3) and rotations (n or 1, 3)."""
    return np.concatenate(np.broadcast_arrays(shift, turn), axis=-1)


def _size(response: Response, length: float) -> float:
    """Return the largest rotation, or translation over a length, of any node."""
    unit = np.repeat([1.0 / length, 1.0], 3)
    return max(
        float(np.abs(twist[..., 0] * unit).max()) for twist in response.nodes.values()
    )
