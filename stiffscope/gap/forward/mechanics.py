"""Mechanics of the nominal robot as a diagnosis needs it: response of what is read to what is applied, at every pose.

What is read and what is applied are columns of one table of terminals: six unit wrenches at M, six at the point of
every load, one unit load at every sensor (opposite on the body that it stands on), the robot's own weight, payloads.
One equilibrium under all of them gives the generalized compliance between any two, and the wrenches by which every
element answers to each: the adjoint of whatever happens to that element.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.errors import InputError
from stiffscope.gap.campaign.quantities import AXES, DEVIATION, FIRST_FREQUENCY, FREQUENCY, JOINT
from stiffscope.robot.effects import changed, without_ranges
from stiffscope.vjm.checks import GROUND
from stiffscope.vjm.condensation import condense_network
from stiffscope.vjm.equilibrium import solve_condensed, solve_loads
from stiffscope.vjm.kinematics import configure, configure_drives
from stiffscope.vjm.linkage import rotation_vector
from stiffscope.vjm.loading import Loads
from stiffscope.vjm.modes import modes
from stiffscope.vjm.network import END, FOOT, list_elements, lump_masses, place_nodes
from stiffscope.vjm.order import find_order
from stiffscope.vjm.prestress import bend_places
from stiffscope.vjm.screws import Frame
from stiffscope.vjm.statics import stiffness
from stiffscope.vjm.strain import find_remaining_offsets

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from stiffscope.gap.campaign.campaign import Campaign, Sensor
    from stiffscope.robot.effects import Changes, NominalRobot
    from stiffscope.vjm.condensation import Condensed
    from stiffscope.vjm.kinematics import Configurations
    from stiffscope.vjm.loading import Response
    from stiffscope.vjm.mechanism import Mechanism
    from stiffscope.vjm.modes import Modes
    from stiffscope.vjm.network import Places
    from stiffscope.vjm.screws import Array as Matrix

    Array = NDArray[np.floating[Any]]
    Flags = NDArray[np.bool_]
    Codes = NDArray[np.int64]

_TOOL = slice(0, 6)
_NEWTON_STEPS = 12
_CLOSED = 1e-5  # rad, or of the mechanism's length: a Newton step after which the next, its square, is nothing
_FEW = 8  # changed elements, up to which a robot is not condensed anew
_CUTS = 2000  # poses times elements whose responses are kept
_HELD_MOMENT = 1e-9  # relative: what rounding leaves of a moment


@dataclass(frozen=True)
class Payload:
    """A mass that a body carries: kg, and its first moments (3,) in kg·m about ``at`` (3,), both at home."""

    body: str
    at: Array
    mass: float
    moments: Array


@dataclass(frozen=True)
class RobotAtPoses:
    """The nominal robot at a campaign's poses (p, k), with its sensors and loads."""

    robot: NominalRobot
    campaign: Campaign

    def state(self, changes: Sequence[Changes] = (), payloads: Sequence[Payload] = ()) -> ElasticState:
        """The robot with changed elements and payloads. Raises InputError if it cannot close."""
        return ElasticState(self, tuple(changes), tuple(payloads)) if changes or payloads else self.sound

    @cached_property
    def sound(self) -> ElasticState:
        """The robot as its model has it."""
        return ElasticState(self, (), ())

    @cached_property
    def displaced(self) -> bool:
        """Whether errors of the geometry are in the model itself."""
        return any(element.offset is not None for element in list_elements(self.mechanism))

    @cached_property
    def rest(self) -> Places:
        """Nodes at its poses."""
        return place_nodes(self.configurations)

    @cached_property
    def _condensed(self) -> Condensed:
        return condense_network(find_order(self.mechanism, self.configurations.linkage), self.rest)

    def under_loads(self) -> Response:
        """Equilibrium under all terminals' unit loads."""
        return solve_condensed(self._condensed, self.unit_loads(self.rest, self.mechanism, ()))

    def cut(self, name: str) -> Response:
        """Equilibrium where an element's ends lie apart by each of six unit twists, in its own axes; unloaded."""
        if name not in self._cuts:
            while len(self._cuts) >= max(_FEW, _CUTS // len(self.campaign.poses)):
                del self._cuts[next(iter(self._cuts))]
            self._cuts[name] = solve_condensed(self._condensed, Loads(6, {}, {name: np.eye(6)[None]}))
        return self._cuts[name]

    @cached_property
    def _cuts(self) -> dict[str, Response]:
        return {}

    @cached_property
    def mechanism(self) -> Mechanism:
        """The robot wherever its drives stand: errors may lead out of their ranges."""
        return without_ranges(self.robot.mechanism)

    @cached_property
    def configurations(self) -> Configurations:
        """The robot at its poses. Raises InputError for one that it cannot reach."""
        c = self.campaign
        found = configured(self.mechanism, c.coordinates, c.poses)
        bad = np.flatnonzero(~found.valid)
        if bad.size:
            raise self._out_of_reach(int(bad[0]), found)
        return found

    def _out_of_reach(self, pose: int, found: Configurations) -> InputError:
        """Error that names line and column of a pose, and a unit that was probably meant."""
        c = self.campaign
        where = c.where(int(np.argmax(c.pose == pose)))
        points = np.array([joint.at for joint in self.mechanism.joints])
        size = float(np.ptp(points, axis=0).max() + np.abs(points).max())
        beyond: dict[str, tuple[float, float, str, str]] = {}
        for name, value in zip(c.coordinates, c.poses[pose].tolist(), strict=True):
            turns = name in AXES[3:] or (
                name.startswith(JOINT) and self.mechanism.joint(name.removeprefix(JOINT)).kind == "revolute"
            )
            limit, units = (2.0 * np.pi, ("rad", "deg")) if turns else (5.0 * size, ("m", "mm"))
            beyond[name] = abs(value) / limit, value, *units
        name = max(beyond, key=lambda each: beyond[each][0])
        times, value, unit, other = beyond[name]
        if times > 1.0:
            meant = f'in {other}, as `units = {{ "{name}" = "{other}" }}` of campaign.toml would say?'
            return InputError(f"{where}: {name}: expected {unit}, got {value:g}: {meant}")
        field = ", ".join(c.coordinates) if c.pose_names[pose].startswith("(") else "pose"
        message = f"expected a pose that the robot reaches, got {c.pose_names[pose]}: {found.reason(pose)}"
        return InputError(f"{where}: {field}: {message}")

    @cached_property
    def cases(self) -> int:
        """Number of terminals: M, loads, sensors, weight, payloads."""
        return 6 + 6 * len(self.campaign.loads) + len(self.campaign.sensors) + 2

    def load_cases(self, load: int) -> slice:
        """Columns of a load's six wrench components."""
        return slice(6 + 6 * load, 12 + 6 * load)

    @cached_property
    def distinct(self) -> tuple[tuple[Codes, Codes], ...]:
        """Readings (m,) that stand for all with the same sense, and the same drive, at the same pose; (n,) which."""
        c = self.campaign
        moving = c.kind <= DEVIATION
        large = np.where(moving, 0, 1 + c.quantity)
        senses = np.stack([c.pose, c.channel, np.where(moving, c.direction, 0), large], axis=1)
        wrench = np.unique(np.nan_to_num(c.wrench), axis=0, return_inverse=True)[1].ravel()
        drives = np.stack([c.pose, c.kind, c.load, wrench, large], axis=1)
        out: list[tuple[Codes, Codes]] = []
        for key in (senses, drives):
            _, first, which = np.unique(key, axis=0, return_index=True, return_inverse=True)
            out.append((first, which.ravel()))
        return tuple(out)

    def sensor_case(self, sensor: int) -> int:
        """Column of a sensor."""
        return 6 + 6 * len(self.campaign.loads) + sensor

    @property
    def weight_case(self) -> int:
        """Column of one m/s² of gravity on the robot's weight; that of the payloads follows."""
        return self.cases - 2

    @cached_property
    def used(self) -> Flags:
        """Which unit loads (cases,) act: those of M that hold the tool, of loads what some reading applies.

        Of loads on the tool's body also the moments that their forces have where they act a little beside their points.
        """
        c = self.campaign
        out = np.ones(self.cases, dtype=np.bool_)
        for k, load in enumerate(c.loads):
            acts = (np.nan_to_num(c.wrench[c.load == k]) != 0.0).any(axis=0)
            if self._firm and load.body == self.mechanism.tool.body:
                acts[3:] |= [acts[:3][np.arange(3) != axis].any() for axis in range(3)]
            out[self.load_cases(k)] = acts
        if not self._firm:
            read = np.unique(c.direction[(c.sensor < 0) & (c.kind <= DEVIATION)])
            applied = (np.nan_to_num(c.wrench[c.load < 0]) != 0.0).any(axis=0)
            out[_TOOL] = np.isin(np.arange(6) // 3, read // 3) | applied
        return out

    @cached_property
    def _firm(self) -> bool:
        """Whether the tool holds every wrench at M."""
        found = self.configurations[:1]
        try:
            solve_loads(find_order(self.mechanism, found.linkage), place_nodes(found), Loads(6, {END: np.eye(6)[None]}))
        except InputError:
            return False
        return True

    def unit_loads(self, where: Places, mechanism: Mechanism, payloads: Sequence[Payload]) -> Loads:
        """All terminals as loads (n or 1, 6, cases) on nodes at M in base axes."""
        c = self.campaign
        nodes: dict[str, Array] = {}

        def add(node: str, wrench: Array, case: int | slice) -> None:
            node = FOOT if node == GROUND else node
            if node not in nodes or len(nodes[node]) < len(wrench):
                known = nodes.get(node, np.zeros((1, 6, self.cases)))
                nodes[node] = np.array(np.broadcast_to(known, (len(wrench), 6, self.cases)))
            nodes[node][..., case] += wrench

        add(END, np.eye(6)[None], _TOOL)
        for k, load in enumerate(c.loads):
            add(load.body, _at(where, load.body, load.at), self.load_cases(k))
        for k, sensor in enumerate(c.sensors):
            unit = _unit(sensor)
            push = _at(where, sensor.body, sensor.at) @ unit
            add(sensor.body, push, self.sensor_case(k))
            if sensor.against != GROUND:
                add(sensor.against, -push, self.sensor_case(k))
        per_unit = mechanism.gravity / (self.robot.acceleration or np.inf)
        for node, mass in lump_masses(mechanism, where).items() if per_unit.any() else ():
            add(node, mass.weight(per_unit)[..., 0], self.weight_case)
        for payload in payloads:
            add(payload.body, _weight_of(payload, where, mechanism.gravity), self.weight_case + 1)
        for wrench in nodes.values():
            wrench[..., ~self.used] = 0.0
        return Loads(self.cases, nodes)

    @cached_property
    def weight_stiffness(self) -> Array:
        """Change (p, 6, 6) of the stiffness at M when the robot's own weight acts."""
        found = self.configurations
        return stiffness(self.mechanism, found, gravity="exact") - stiffness(self.mechanism, found)

    @cached_property
    def shaken(self) -> NDArray[np.intp]:
        """Poses at which natural frequencies were read."""
        c = self.campaign
        return np.unique(c.pose[c.kind == FREQUENCY])


def configured(mechanism: Mechanism, coordinates: Sequence[str], poses: Array) -> Configurations:
    """Configurations at poses (p, k) by tool coordinates, or by displacements of driven joints, `q:JOINT`."""
    if tuple(coordinates) == tuple(mechanism.tool.pose):
        return configure(mechanism, poses)
    order = [list(coordinates).index(f"{JOINT}{joint.name}") for joint in mechanism.drives]
    return configure_drives(mechanism, poses[:, order])


@dataclass(frozen=True)
class ElasticState:
    """A robot with changed elements; everything is evaluated where it is asked for."""

    at: RobotAtPoses
    changes: tuple[Changes, ...]
    payloads: tuple[Payload, ...]
    _known: dict[str, Array] = field(default_factory=dict[str, Any], compare=False)

    @cached_property
    def mechanism(self) -> Mechanism:
        """The robot with its changes. Raises InputError for an element that ends up indefinite."""
        mechanism = self.at.mechanism
        for change in self.changes:
            mechanism = changed(mechanism, change)
        return mechanism

    @cached_property
    def places(self) -> Places:
        """Nodes where errors of the geometry have moved them to: loops closed by Newton steps of the elastic network.

        Raises InputError where they do not close.
        """
        rest = self.at.rest
        if not self._displacing:
            return rest
        order = find_order(self.mechanism, self.at.configurations.linkage)
        offsets = {e.name: e.offset[None, :, None] for e in order.elements if e.offset is not None}
        response = solve_loads(order, rest, Loads(1, {}, offsets))
        there, size = bend_places(rest, response), _size(response, order.length)
        for _ in range(_NEWTON_STEPS):
            if size < _CLOSED:
                return there
            response = solve_loads(order, there, Loads(1, {}, find_remaining_offsets(order, there, rest), balanced=1.0))
            there, size = bend_places(there, response), _size(response, order.length)
        if not size < _CLOSED:
            raise InputError("loop closure: no solution for these geometric errors")
        return there

    @property
    def _displacing(self) -> bool:
        """Whether errors move anything of the unloaded robot."""
        return self.at.displaced or any(c.offset is not None for each in self.changes for c in each.values())

    @cached_property
    def response(self) -> Response:
        """Equilibrium under all terminals' unit loads, of the whole network."""
        where = self.places
        if self is self.at.sound and where is self.at.rest:
            return self.at.under_loads()
        order = find_order(self.mechanism, self.at.configurations.linkage)
        return solve_loads(order, where, self.at.unit_loads(where, self.mechanism, self.payloads))

    @cached_property
    def _response(self) -> Response | Softened:
        return self.response if self._added is None else softened(self.at, self._added)

    @cached_property
    def _added(self) -> dict[str, Array] | None:
        """What few elements yield more than in the sound robot; None where something else is changed too."""
        if self is self.at.sound or self.payloads or self._displacing:
            return None
        added: dict[str, Array] = {}
        for each in self.changes:
            for name, change in each.items():
                if change.compliance is not None and change.compliance.any():
                    added[name] = added.get(name, 0.0) + change.compliance
        if len(added) > _FEW:
            return None
        return added if self.mechanism else None  # which checks that every element yields as it must

    def _at_every_pose(self, value: Matrix) -> Array:
        return np.broadcast_to(value, (len(self.at.campaign.poses), *value.shape[1:]))

    @cached_property
    def tool(self) -> Array:
        """Twist (p, 6, cases) of the tool at M."""
        return self._at_every_pose(self._node(END))

    def _node(self, name: str) -> Array:
        """Twist (n, 6, cases) of a node at M in base axes."""
        known = self._response
        if not isinstance(known, Softened):
            return known.nodes[name]
        if name not in self._nodes:
            self._nodes[name] = known.node(name)
        return self._nodes[name]

    @cached_property
    def _nodes(self) -> dict[str, Array]:
        return {}

    @property
    def compliance(self) -> Array:
        """Compliance (p, 6, 6) at M."""
        return self.tool[..., _TOOL]

    def sensed(self, sensor: Sensor) -> Array:
        """Motion (p, 6, cases) of a sensor's point, and rotation, against the body that it stands on; base axes."""
        where = self.places

        def motion(node: str) -> Array:
            back = np.swapaxes(_at(where, sensor.body, sensor.at), -1, -2)
            return back @ self._node(FOOT if node == GROUND else node)

        across = motion(sensor.body)
        if sensor.against != GROUND:
            across = across - motion(sensor.against)
        return self._at_every_pose(across)

    def weights(self, payloads: Sequence[Payload]) -> Array:
        """Wrenches (p or 1, 6, k) of the weights of payloads, at M in base axes."""
        where, gravity = self.places, self.at.mechanism.gravity
        return np.stack([_weight_of(payload, where, gravity) for payload in payloads], axis=2)

    def moved(self, node: str, wrenches: Array) -> Array:
        """Work (p, cases, k) of wrenches (p or 1, 6, k) on a node along its motion under every terminal's load."""
        return self._at_every_pose(np.swapaxes(self._node(node), -1, -2) @ wrenches)

    def transmitted(self, name: str) -> Array:
        """Wrench (p, 6, cases) on an element for every terminal's unit load, in its own axes."""
        if name not in self._known:
            response = self._response
            wrench = response.wrench(name) if isinstance(response, Softened) else response.elements[name].wrench
            self._known[name] = self._at_every_pose(wrench)
        return self._known[name]

    def displaced(self, sensor: Sensor | None) -> Array:
        """Displacement (p, 6) by errors of the geometry, exactly: translation and rotation vector of M or a sensor."""
        if self.places is self.at.rest:
            return np.zeros((len(self.at.campaign.poses), 6))
        if sensor is None:
            tool = self.at.mechanism.tool
            return self._at_every_pose(self._gone(END, tool.at))
        across = self._gone(sensor.body, np.array(sensor.at))
        if sensor.against == GROUND:
            return self._at_every_pose(across)
        rest, there = self.at.rest, self.places  # the point as it would move with the body that the sensor stands on
        point = rest.point(sensor.body, np.array(sensor.at))
        r0, r1 = rest.rotation[sensor.against], there.rotation[sensor.against]
        home = (np.swapaxes(r0, -1, -2) @ (point - rest.position[sensor.against])[..., None])[..., 0]
        carried = (r1 @ home[..., None])[..., 0] + there.position[sensor.against] - point
        turned = rotation_vector(r1 @ np.swapaxes(r0, -1, -2))
        return self._at_every_pose(across - np.concatenate(np.broadcast_arrays(carried, turned), axis=-1))

    def _gone(self, node: str, home: Array) -> Array:
        """Translation of a point of a node's body and its rotation vector (n, 6), since the nominal pose."""
        rest, there = self.at.rest, self.places
        away = there.point(node, home) - rest.point(node, home)
        turned = rotation_vector(there.rotation[node] @ np.swapaxes(rest.rotation[node], -1, -2))
        n = max(len(away), len(turned))
        return np.concatenate([np.broadcast_to(away, (n, 3)), np.broadcast_to(turned, (n, 3))], axis=1)

    @cached_property
    def _modes(self) -> Modes:
        """Lowest modes at the poses where natural frequencies were read, drives held."""
        at, c = self.at, self.at.campaign
        count = int((c.quantity[c.kind == FREQUENCY] - FIRST_FREQUENCY).max()) + 1
        found = modes(self._laden, at.configurations[at.shaken], count)
        if found.frequencies.shape[1] < count or np.isnan(found.frequencies).any():
            row = int(np.argmax(c.kind == FREQUENCY))
            raise InputError(f"{c.where(row)}: quantity: expected one of the modes that the robot has, got f{count}")
        return found

    @cached_property
    def _laden(self) -> Mechanism:
        return _laden(self.mechanism, self.payloads)

    @property
    def frequencies(self) -> Array:
        """Natural frequencies (s, c) in Hz at the poses where some were read; drives held."""
        return self._modes.frequencies

    @cached_property
    def _swinging(self) -> Response:
        """Equilibrium under the inertial loads ``ω² M v`` of each mode v: what its elements carry at their largest."""
        found, where = self._modes.configurations, place_nodes(self._modes.configurations)
        squares = np.square(2.0 * np.pi * self.frequencies)[:, None]
        forces = inertial_forces(self._laden, where, self._modes.shapes)
        loads = Loads(squares.shape[2], {node: force * squares for node, force in forces.items()}, balanced=1.0)
        return solve_loads(find_order(self.mechanism, found.linkage), where, loads)

    def swung(self, name: str) -> Array:
        """Wrench (s, 6, c) on an element in each mode of a modal mass of 1 kg, in its own axes."""
        wrench = self._swinging.elements[name].wrench
        return np.broadcast_to(wrench, (len(self.at.shaken), *wrench.shape[1:]))

    def swing(self, node: str, home: Array) -> Array:
        """Twist (s, 6, c) of a point of a body in each mode of a modal mass of 1 kg, base axes."""
        where = place_nodes(self._modes.configurations)
        return np.swapaxes(_at(where, node, home), -1, -2) @ self._modes.shapes[node]


@dataclass(frozen=True)
class Softened:
    """Response of a robot some of whose elements yield more than in another, by that other one's responses."""

    sound: Response
    cuts: tuple[Response, ...]
    """Of the elements that yield more, each to unit twists between its ends."""
    slips: tuple[Array, ...]
    """How much more (n, 6, cases) each of them yields."""

    def node(self, name: str) -> Array:
        """Twist (n, 6, cases) of a node at M in base axes."""
        out = self.sound.nodes[name]
        for cut, slip in zip(self.cuts, self.slips, strict=True):
            out = out + cut.nodes[name] @ slip
        return out

    def wrench(self, name: str) -> Array:
        """Wrench (n, 6, cases) that an element carries, at its own point in its own axes."""
        out = self.sound.elements[name].wrench
        for cut, slip in zip(self.cuts, self.slips, strict=True):
            out = out + cut.elements[name].wrench @ slip
        return out


def softened(at: RobotAtPoses, added: Mapping[str, Array]) -> Softened:
    """Response of the sound robot with compliance (6, 6) added to elements.

    An element that carries w and yields ΔC w more acts on the rest as if its ends lay apart by as much:
    ``w = w₀ + K ΔC w`` with the wrenches K by unit twists between its ends (Woodbury's identity).
    """
    sound, names = at.sound.response, list(added)
    if not names:
        return Softened(sound, (), ())
    cuts = tuple(at.cut(name) for name in names)
    before = np.concatenate([sound.elements[name].wrench for name in names], axis=1)
    gains = [np.concatenate([cut.elements[name].wrench for name in names], axis=1) @ added[own]
             for cut, own in zip(cuts, names, strict=True)]  # fmt: skip
    carried = np.linalg.solve(np.eye(6 * len(names)) - np.concatenate(np.broadcast_arrays(*gains), axis=2), before)
    slips = (added[name] @ part for name, part in zip(names, np.split(carried, len(names), axis=1), strict=True))
    return Softened(sound, cuts, tuple(slips))


def _size(response: Response, length: float) -> float:
    """Largest rotation, or translation over a length, of any node."""
    unit = np.repeat([1.0 / length, 1.0], 3)
    return max(float(np.abs(twist[..., 0] * unit).max()) for twist in response.nodes.values())


def _unit(sensor: Sensor) -> Array:
    """Unit wrench (6,) that a sensor's reading is the work of."""
    direction = np.array(sensor.direction)
    return np.concatenate([np.zeros(3), direction] if sensor.rotates else [direction, np.zeros(3)])


def _at(where: Places, node: str, home: Sequence[float] | Array) -> Array:
    """Wrench (n or 1, 6, 6) at M for unit wrenches at a point of a body, base axes: ``[[I, 0], [S(r), I]]``."""
    node = FOOT if node == GROUND else node
    lever = where.point(node, np.array(home)) - where.tool
    out = np.zeros((len(lever), 6, 6))
    out[:] = np.eye(6)
    out[:, 3, 1], out[:, 3, 2] = -lever[:, 2], lever[:, 1]
    out[:, 4, 0], out[:, 4, 2] = lever[:, 2], -lever[:, 0]
    out[:, 5, 0], out[:, 5, 1] = -lever[:, 1], lever[:, 0]
    return out


def inertial_forces(mechanism: Mechanism, where: Places, shapes: Mapping[str, Array]) -> dict[str, Array]:
    """Wrenches ``M v`` (n, 6, c) on nodes at M in base axes for twists v (n, 6, c) of the nodes.

    Of elastic bodies the condensed mass, without that of their own modes.
    """
    out: dict[str, Array] = {}

    def add(node: str, wrench: Array) -> None:
        out[node] = out[node] + wrench if node in out else wrench

    def moved(node: str, at: Array, axes: Array) -> tuple[Array, Array]:
        """Adjoint (n, 6, 6) of a node's own axes at a point, and its twist there (n, 6, c)."""
        frame = Frame(where.rotation[node] @ axes, where.point(node, at) - where.tool)
        back = frame.inverse_adjoint()
        return back, back @ shapes[node]

    for body in mechanism.bodies:
        if body.elastic is None:
            whole = np.kron(np.diag([1.0, 0.0]), body.mass * np.eye(3))
            whole[3:, 3:] = 0.0 if body.inertia is None else 0.5 * (body.inertia + body.inertia.T)
            if whole.any():
                centre = np.zeros(3) if body.centre is None else body.centre
                back, twist = moved(body.name, centre, np.eye(3))
                add(body.name, np.swapaxes(back, -1, -2) @ (whole @ twist))
            continue
        elastic = body.elastic
        ends = [moved(n, at, elastic.axes) for n, at in zip(body.nodes, elastic.places, strict=True)]
        if elastic.dynamics is None:
            mass = np.kron(np.eye(len(ends)), np.kron(np.diag([body.mass / len(ends), 0.0]), np.eye(3)))
        else:
            factor = elastic.dynamics.factor[:, : 6 * len(ends)]
            mass = factor.T @ factor
        forces = mass @ np.concatenate(np.broadcast_arrays(*(twist for _, twist in ends)), axis=1)
        for node, (back, _), force in zip(body.nodes, ends, np.split(forces, len(ends), axis=1), strict=True):
            add(node, np.swapaxes(back, -1, -2) @ force)
    return out


def _weight_of(payload: Payload, where: Places, gravity: Array) -> Array:
    """Wrench (n, 6) of a payload's weight at M in base axes."""
    arm = where.rotation[payload.body] @ payload.moments
    push = np.concatenate([np.broadcast_to(payload.mass * gravity, arm.shape), np.cross(arm, gravity)], axis=1)
    return (_at(where, payload.body, payload.at) @ push[..., None])[..., 0]


def _laden(mechanism: Mechanism, payloads: Sequence[Payload]) -> Mechanism:
    """The mechanism whose bodies have the payloads' masses too, each at a point."""
    bodies = {body.name: body for body in mechanism.bodies}
    for payload in payloads:
        body = bodies[payload.body]
        centre = np.zeros(3) if body.centre is None else body.centre
        whole = body.mass + payload.mass
        if not whole > 0.0:
            raise InputError(f"{payload.body}: expected a mass above 0 kg, got {whole:g}")
        offset = payload.moments / payload.mass if payload.mass else np.zeros(3)
        away = payload.at + offset - centre
        middle = centre + away * (payload.mass / whole)
        own = np.zeros((3, 3)) if body.inertia is None else body.inertia
        reduced = body.mass * payload.mass / whole
        inertia = own + reduced * (away @ away * np.eye(3) - np.outer(away, away))
        heavy = np.linalg.eigvalsh(inertia)[0] > _HELD_MOMENT * np.abs(inertia).max() if inertia.any() else False
        bodies[payload.body] = replace(body, mass=whole, centre=middle, inertia=inertia if heavy else body.inertia)
    return replace(mechanism, bodies=tuple(bodies.values()))
