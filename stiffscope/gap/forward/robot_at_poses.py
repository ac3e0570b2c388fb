"""The nominal robot at a campaign's poses; readings and loads are columns of one equilibrium.

The terminals are six unit wrenches at M, six at the point of each load, a unit load at each sensor
(opposite on its mount), the robot's own weight and payloads. One equilibrium under all gives
the generalized compliance between any two, and the wrenches in every element: the adjoint solution
for any change of that element.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.errors import InputError
from stiffscope.gap.campaign.kinds import KINDS, MODE_OF
from stiffscope.gap.campaign.kinds.kind import NO_MODE
from stiffscope.gap.campaign.quantities import AXES, JOINT
from stiffscope.gap.effects.effect import find_length
from stiffscope.gap.effects.elements import along_drive, without_ranges
from stiffscope.gap.forward.inner_points import inner_point
from stiffscope.gap.forward.instrument_state import Instruments
from stiffscope.gap.forward.terminals import (
    Push,
    push_payload,
    unit_wrenches,
    wrenches_at,
)
from stiffscope.vjm.elements.laws import find_laws, without_laws
from stiffscope.vjm.kinematics.configurations import configure, configure_drives
from stiffscope.vjm.model.checks import GROUND
from stiffscope.vjm.network.condensation import condense_network
from stiffscope.vjm.network.loading import Loads, Response
from stiffscope.vjm.network.network import (
    END,
    FOOT,
    list_elements,
    lump_masses,
    place_nodes,
)
from stiffscope.vjm.network.order import find_order
from stiffscope.vjm.statics.analysis import stiffness
from stiffscope.vjm.statics.equilibrium import (
    solve_condensed,
    solve_dislocations,
    solve_loads,
)

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from stiffscope.gap.campaign.campaign import Campaign, Sensor
    from stiffscope.gap.campaign.kinds.kind import Predictor
    from stiffscope.gap.effects.effect import Effect, Payload
    from stiffscope.gap.forward.instrument_state import InstrumentState
    from stiffscope.gap.forward.steps import Steps
    from stiffscope.robot.nominal import NominalRobot
    from stiffscope.runtime.types import Array, Flags, Indices
    from stiffscope.vjm.kinematics.configurations import Configurations
    from stiffscope.vjm.model.joints import Law
    from stiffscope.vjm.model.mechanism import Mechanism
    from stiffscope.vjm.network.condensation import Condensed
    from stiffscope.vjm.network.network import Places

_TOOL = slice(0, 6)
FEW = 8  # most changed elements without a new condensation
_CUTS = 2000  # most cached responses, poses times elements


@dataclass(frozen=True)
class RobotAtPoses:
    """The nominal robot at a campaign's poses (p, k), with its sensors and loads."""

    robot: NominalRobot
    campaign: Campaign

    @cached_property
    def is_displaced(self) -> bool:
        """Whether the nominal model contains geometric errors or springs."""
        elements = list_elements(self.mechanism)
        return any(
            e.is_displaced or e.sprung or (e.joint and e.joint.spring) for e in elements
        )

    @cached_property
    def rest(self) -> Places:
        """Nodes at the poses."""
        return place_nodes(self.configurations)

    @cached_property
    def _condensed_network(self) -> Condensed:
        return condense_network(
            find_order(self.mechanism, self.configurations.linkage), self.rest
        )

    @cached_property
    def response(self) -> Response:
        """Equilibrium under unit loads at all terminals."""
        loads = self.unit_loads(self.rest, self.mechanism, ())
        return solve_condensed(self._condensed_network, loads)

    def cut(self, name: str) -> Response:
        """Return the equilibrium for unit twists, own axes, of an element's ends from the first."""
        if name not in self._cuts:
            self._make_room(self._cuts)
            self._cuts[name] = solve_dislocations(
                self._condensed_network, self.mechanism, name
            )
        return self._cuts[name]

    @cached_property
    def _cuts(self) -> dict[str, Response]:
        return {}

    def moved_by(self, name: str, nodes: Sequence[str]) -> Array:
        """Return the twists (p, 6 nodes, 6m) of nodes for unit twists of an element's ends.

        Kept as the equilibria of `cut` are.
        """
        key = name, *nodes
        if key not in self._moved:
            self._make_room(self._moved)
            cut = self.cut(name).nodes
            shape = len(self.campaign.poses), 6
            each = [np.broadcast_to(cut[k], (*shape, cut[k].shape[-1])) for k in nodes]
            self._moved[key] = np.concatenate(each, axis=1)
        return self._moved[key]

    @cached_property
    def _moved(self) -> dict[tuple[str, ...], Array]:
        return {}

    @cached_property
    def _rows_of_poses(self) -> Indices | None:
        return _group_evenly(self.campaign.pose, len(self.campaign.poses))

    @cached_property
    def _rows_of_distinct(self) -> tuple[Indices | None, ...]:
        """Representative readings (p, r) of `distinct_readings`, as places among them."""
        pose = self.campaign.pose
        count = len(self.campaign.poses)
        return tuple(
            _group_evenly(pose[few], count) for few, _ in self.distinct_readings
        )

    def load_distinct(self, columns: Array, every: tuple[Array, Array]) -> list[Array]:
        """Return products (n, k) of a pose's columns (p or 1, k, c) and loads (n, c) of readings.

        The loads are those of sense and drive: equal ones of `distinct_readings` are taken once.
        """
        pose = self.campaign.pose
        out: list[Array] = []
        ways = zip(self.distinct_readings, self._rows_of_distinct, every, strict=True)
        for (few, which), rows, given in ways:
            loads = given[few]
            used = np.flatnonzero(loads.any(axis=0))
            loads = loads[:, used]
            at = columns[..., used]
            if len(at) == 1:
                found = loads @ at[0].T
            elif rows is None:
                found = (at[pose[few]] @ loads[..., None])[..., 0]
            else:
                found = np.empty((len(few), at.shape[1]))
                each = loads[rows] @ np.swapaxes(at, -1, -2)
                found[rows.ravel()] = each.reshape(found.shape)
            out.append(found[which])
        return out

    def multiply_by_pose(self, rates: Array, matrices: Array) -> Array:
        """Return products (n, m) of a row (n, k) of every reading and its pose's matrix (p, k, m)."""
        rows = self._rows_of_poses
        if rows is None:
            return (rates[:, None] @ matrices[self.campaign.pose])[:, 0]
        out = np.empty((len(rates), matrices.shape[-1]))
        out[rows.ravel()] = (rates[rows] @ matrices).reshape(out.shape)
        return out

    def _make_room(self, held: dict[Any, Any]) -> None:
        """Drop the oldest of what is held by element, which is large, until one more is allowed."""
        while len(held) >= self._most_cuts:
            del held[next(iter(held))]

    @property
    def _most_cuts(self) -> int:
        return max(FEW, _CUTS // len(self.campaign.poses))

    @cached_property
    def _owners(self) -> dict[str, str]:
        """Name of the joint or body of each element of the network."""
        return {e.name: e.group or e.name for e in list_elements(self.mechanism)}

    def displace(self, offsets: Mapping[str, Array]) -> Response | None:
        """Return the nominal robot's motions for offsets (n or 1, 6, 1) of elements, to first order.

        None where equilibria of so many elements are not kept.
        """
        names = dict.fromkeys(self._owners.get(name, "") for name in offsets)
        if len(names) > self._most_cuts or "" in names:
            return None
        nodes: dict[str, Array] = {}
        for name in names:
            rows = self.mechanism.rows(name)
            still = np.zeros((1, 6, 1))
            parts = np.broadcast_arrays(*(offsets.get(row, still) for row in rows))
            twist = np.concatenate(parts, axis=1)
            for node, moved in self.cut(name).nodes.items():
                part = moved @ twist
                nodes[node] = nodes[node] + part if node in nodes else part
        return Response(self.rest, nodes)

    @cached_property
    def linear_steps(self) -> dict[int, tuple[Effect, Steps]]:
        """Steps of linear effects, by their ids."""
        return {}

    @cached_property
    def mechanism(self) -> Mechanism:
        """The robot with linear drives of unlimited range, as errors may exceed their ranges."""
        return without_ranges(without_laws(self.robot.mechanism))

    @cached_property
    def length(self) -> float:
        """Largest distance of two joints, or of the tool from one, m."""
        return find_length(self.mechanism)

    @cached_property
    def laws(self) -> dict[str, Law]:
        """Laws of nonlinear drives."""
        return find_laws(self.robot.mechanism)

    def find_displacement(self, name: str) -> Array:
        """Return the displacement (p, k) of a passive joint from its spring's rest position."""
        joint = self.mechanism.joint(name)
        away = self.configurations.coordinates(name)
        return (away @ joint.axes if joint.type.is_ball else away) - joint.rest

    @cached_property
    def law_influence(self) -> Array:
        """Force (p, k, k) of each nonlinear drive per unit shift of each."""
        driven = self.robot.driven
        rows = {name: along_drive(driven[name]) for name in self.laws}
        out = np.empty((len(self.campaign.poses), len(rows), len(rows)))
        for i, name in enumerate(rows):
            for j, shifted in enumerate(rows):
                out[:, i, j] = (
                    rows[name] @ self.cut(shifted).elements[name].wrench @ rows[shifted]
                )
        return out

    @cached_property
    def configurations(self) -> Configurations:
        """The robot at its poses. Raises InputError for an unreachable pose."""
        c = self.campaign
        at_poses = configure_robot(self.mechanism, c.coordinates, c.poses)
        bad = np.flatnonzero(~at_poses.valid)
        if bad.size:
            raise self._out_of_reach(int(bad[0]), at_poses)
        return at_poses

    def _out_of_reach(self, pose: int, configurations: Configurations) -> InputError:
        """Return an error with the line and column of a pose, and the unit probably intended."""
        c = self.campaign
        where = c.where(int(np.argmax(c.pose == pose)))
        points = np.array([joint.at for joint in self.mechanism.joints])
        size = float(np.ptp(points, axis=0).max() + np.abs(points).max())
        joints = self.mechanism.joints
        turning = {f"{JOINT}{joint.name}" for joint in joints if joint.turns}
        beyond: dict[str, tuple[float, float, str, str]] = {}
        for name, value in zip(c.coordinates, c.poses[pose].tolist(), strict=True):
            turns = name in AXES[3:] or name in turning
            limit, units = (
                (2.0 * np.pi, ("rad", "deg")) if turns else (5.0 * size, ("m", "mm"))
            )
            beyond[name] = abs(value) / limit, value, *units
        name = max(beyond, key=lambda each: beyond[each][0])
        times, value, unit, other = beyond[name]
        if times > 1.0:
            meant = f'in {other}, as `units = {{ "{name}" = "{other}" }}` of campaign.toml says?'
            return InputError(
                f"{where}: {name}: expected {unit}, got {value:g}: {meant}"
            )
        field = (
            ", ".join(c.coordinates) if c.pose_names[pose].startswith("(") else "pose"
        )
        got = f"{c.pose_names[pose]}: {configurations.reason(pose)}"
        return InputError(
            f"{where}: {field}: expected a pose that the robot reaches, got {got}"
        )

    @cached_property
    def instruments(self) -> Instruments:
        """Unknowns of the instruments."""
        return Instruments(self.campaign)

    @cached_property
    def instruments_start(self) -> tuple[InstrumentState, Array]:
        """Instruments fitted to the rigid robot as commanded, and the weights of the readings."""
        return self.instruments.start(*self.targets(self.rest))

    def targets(self, where: Places) -> tuple[Array, Array]:
        """Return target points (a, 3) of positions and distances, and body rotations (a, 3, 3)."""
        c = self.campaign
        rows = self.instruments.rows
        points = np.zeros((len(rows), 3))
        turns = np.zeros((len(rows), 3, 3))
        for k, sensor in enumerate(c.sensors):
            rows_of = np.flatnonzero(c.sensor[rows] == k)
            if rows_of.size:
                body = FOOT if sensor.body == GROUND else sensor.body
                count = len(c.poses)
                pose = c.pose[rows[rows_of]]
                there = where.point(body, np.array(sensor.at))
                points[rows_of] = np.broadcast_to(there, (count, 3))[pose]
                turns[rows_of] = np.broadcast_to(where.rotation[body], (count, 3, 3))[
                    pose
                ]
        return points, turns

    @property
    def cases(self) -> int:
        """Number of terminals: M, loads, sensors, weight, payloads."""
        return self._sensor_cases[-1].stop + 2

    @cached_property
    def _sensor_cases(self) -> list[slice]:
        """Terminals of the loads, then of each sensor: one, or six shared by a target."""
        out = [slice(6, 6 + 6 * len(self.campaign.loads))]
        targets = dict[str, slice]()
        for sensor in self.campaign.sensors:
            end = max(each.stop for each in out)
            columns = slice(end, end + (6 if sensor.absolute else 1))
            name = sensor.target or sensor.name
            out.append(
                targets.setdefault(name, columns) if sensor.absolute else columns
            )
        return [*out, slice(6, max(each.stop for each in out))]

    def load_cases(self, load: int) -> slice:
        """Return the columns of the six wrench components of a load, or (-1) at M."""
        return slice(6 + 6 * load, 12 + 6 * load)

    @cached_property
    def distinct_readings(self) -> tuple[tuple[Indices, Indices], ...]:
        """Representative readings (m,) of equal sense and equal drive at a pose; indices (n,)."""
        c = self.campaign
        moving = c.is_motion
        large = np.where(moving, 0, 1 + c.quantity)
        apart = np.where(
            c.is_absolute, c.session, 0
        )  # instruments that are set up again
        axis = np.where(moving, c.direction, 0)
        senses = np.stack([c.pose, apart, c.channel, axis, large], axis=1)
        wrench = np.unique(np.nan_to_num(c.wrench), axis=0, return_inverse=True)[
            1
        ].ravel()
        drives = np.stack([c.pose, c.kind, c.load, wrench, large], axis=1)
        out: list[tuple[Indices, Indices]] = []
        for key in (senses, drives):
            _, first, which = np.unique(
                key, axis=0, return_index=True, return_inverse=True
            )
            out.append((first, which.ravel()))
        return tuple(out)

    def sensor_cases(self, sensor: int) -> slice:
        """Return the column of a sensor, or the six of a target."""
        return self._sensor_cases[1 + sensor]

    @property
    def weight_case(self) -> int:
        """Column of the robot's weight under gravity of 1 m/s²; the payloads' column follows."""
        return self.cases - 2

    @cached_property
    def used_loads(self) -> Flags:
        """Flags (cases,) of the unit loads used: supported ones at M, and applied ones of loads.

        For loads on the tool's body, also the moments of forces that act beside their points.
        """
        c = self.campaign
        out = np.ones(self.cases, dtype=np.bool_)
        for k, load in enumerate(c.loads):
            acts = (np.nan_to_num(c.wrench[c.load == k]) != 0.0).any(axis=0)
            if self._firm and acts[:3].any():
                acts[:3] = True  # a leak of the force sensor has the others
            if self._firm and load.body == self.mechanism.tool.body:
                acts[3:] |= [acts[:3][np.arange(3) != axis].any() for axis in range(3)]
            out[self.load_cases(k)] = acts
        if not self._firm:
            read = np.unique(c.direction[(c.sensor < 0) & c.is_displacement])
            applied = (np.nan_to_num(c.wrench[c.load < 0]) != 0.0).any(axis=0)
            out[_TOOL] = np.isin(np.arange(6) // 3, read // 3) | applied
        return out

    @cached_property
    def _firm(self) -> bool:
        """Whether the tool supports every wrench at M."""
        first = self.configurations[:1]
        order = find_order(self.mechanism, first.linkage)
        try:
            solve_loads(order, place_nodes(first), Loads(6, {END: np.eye(6)[None]}))
        except InputError:
            return False
        return True

    def unit_loads(
        self,
        where: Places,
        mechanism: Mechanism,
        payloads: Sequence[Payload],
        *,
        weighs: bool = True,
    ) -> Loads:
        """Return all terminals as loads (n or 1, 6, cases) on nodes, at M in base axes."""
        nodes: dict[str, Array] = {}
        for push in self.pushes(where, mechanism, payloads, weighs=weighs):
            node = push.node
            count = len(push.wrench)
            if node not in nodes or len(nodes[node]) < count:
                known = nodes.get(node, np.zeros((1, 6, self.cases)))
                nodes[node] = np.array(np.broadcast_to(known, (count, 6, self.cases)))
            nodes[node][..., push.cases] += push.wrench
        for wrench in nodes.values():
            wrench[..., ~self.used_loads] = 0.0
        return Loads(self.cases, nodes)

    def pushes(
        self,
        where: Places,
        mechanism: Mechanism,
        payloads: Sequence[Payload],
        *,
        weighs: bool = True,
    ) -> Iterator[Push]:
        """Yield the wrenches on nodes by all terminals."""
        c = self.campaign

        def at_point(
            node: str, wrench: Array, cases: slice, body: str, home: Array
        ) -> Push:
            node, body = (FOOT if name == GROUND else name for name in (node, body))
            return Push(node, wrench, cases, body, where.point(body, home))

        yield at_point(END, np.eye(6)[None], _TOOL, END, mechanism.tool.at)
        for k, load in enumerate(c.loads):
            wrench = wrenches_at(where, load.body, load.at)
            home = np.array(load.at)
            yield at_point(load.body, wrench, self.load_cases(k), load.body, home)
        for k, sensor in enumerate(c.sensors):
            if self.sensor_cases(k) in [self.sensor_cases(j) for j in range(k)]:
                continue  # another channel of one target
            push = wrenches_at(where, sensor.body, sensor.at) @ unit_wrenches(sensor)
            home = np.array(sensor.at)
            for node, wrench in _share_out(where, mechanism, sensor, push):
                yield at_point(node, wrench, self.sensor_cases(k), sensor.body, home)
        per_unit = mechanism.gravity / (self.robot.acceleration or np.inf)
        weight = slice(self.weight_case, self.weight_case + 1)
        for node, mass in (
            lump_masses(mechanism, where).items() if per_unit.any() else ()
        ):
            centre = where.tool + mass.moment / (mass.mass or np.inf)
            yield Push(node, mass.weight(per_unit), weight, node, centre)
        gravity = float(weighs) * mechanism.gravity
        others = slice(self.weight_case + 1, self.weight_case + 2)
        for payload in payloads:
            yield from push_payload(payload, where, gravity, others)

    @cached_property
    def weight_stiffness(self) -> Array:
        """Change (p, 6, 6) of the stiffness at M by the robot's own weight."""
        configurations = self.configurations
        return stiffness(self.mechanism, configurations, gravity="exact") - stiffness(
            self.mechanism, configurations
        )

    @cached_property
    def shaken(self) -> Indices:
        """Poses with readings of modes of vibration."""
        c = self.campaign
        return np.unique(c.pose[MODE_OF[c.quantity] != NO_MODE])

    @cached_property
    def predictors(self) -> tuple[tuple[Predictor, Indices], ...]:
        """What predicts the readings, with the rows (m,) of which it does."""
        kind = self.campaign.kind
        served: dict[Predictor, list[int]] = {}
        numbers: list[int] = np.unique(kind).tolist()
        for number in numbers:
            predictor = KINDS[number].predictor
            if predictor is not None:
                served.setdefault(predictor, []).append(number)
        return tuple(
            (predictor, np.flatnonzero(np.isin(kind, own)))
            for predictor, own in served.items()
        )


def _group_evenly(pose: Indices, count: int) -> Indices | None:
    """Return the rows (p, r) of each of so many poses if all have as many; else None."""
    if not len(pose) or len(pose) % count:
        return None
    rows = np.argsort(pose, kind="stable").reshape(count, -1)
    return rows if (pose[rows] == np.arange(count)[:, None]).all() else None


def configure_robot(
    mechanism: Mechanism, names: Sequence[str], poses: Array
) -> Configurations:
    """Return configurations at poses (p, k) of tool coordinates or driven joints, `q:JOINT`."""
    if tuple(names) == tuple(mechanism.tool.pose):
        return configure(mechanism, poses)
    order = [list(names).index(f"{JOINT}{joint.name}") for joint in mechanism.drives]
    return configure_drives(mechanism, poses[:, order])


def _share_out(
    where: Places, mechanism: Mechanism, sensor: Sensor, push: Array
) -> list[tuple[str, Array]]:
    """Return the wrenches (n or 1, 6, k) at M on nodes that do the work of a push at a sensor from its mount."""
    mount = [(sensor.against, -push)] if sensor.against != GROUND else []
    inner = inner_point(mechanism, sensor)
    if inner is None:
        return [(sensor.body, push), *mount]
    on_tip = np.swapaxes(inner.spread(where), -1, -2) @ push
    return [(inner.base, push - on_tip), (inner.tip, on_tip), *mount]
