"""Readings of a robot with given effects, and their sensitivities to changes of elements.

A reading is ``a · D b``, with the generalized compliance D between terminals, the applied loads b
(wrench, weight, payloads) and the sensed direction a. A change δC of an element changes it by
``(W a) · δC (W b)``, with the element wrenches W per unit terminal load; an unloaded motion t by
``(W a) · t``. A stiffness K_ii has ``a = -K e_i``, ``b = K e_i``; a push 1/C_ii ``a = -e_i/C_ii``,
``b = e_i/C_ii``; a frequency f has ``W b`` the wrench of its unit-mass mode, ``a = -b / (8 π² f)``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.gap.campaign.kinds import MODE_OF
from stiffscope.gap.effects.elements import along_drive
from stiffscope.gap.forward.elastic_state import ElasticState
from stiffscope.gap.forward.instrument_readings import InstrumentReadings
from stiffscope.gap.forward.load_chains import LoadChains, size_loads
from stiffscope.gap.forward.moved_nodes import MotionRates, find_motion_rates
from stiffscope.gap.forward.second_order import (
    SETTINGS,
    find_second_order,
    shows_second_order,
)
from stiffscope.vjm.elements.laws import settle

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from stiffscope.gap.campaign.kinds.kind import Predictor
    from stiffscope.gap.effects.effect import Knee
    from stiffscope.gap.forward.instrument_state import AbsoluteReadings, Projection
    from stiffscope.gap.forward.robot_at_poses import RobotAtPoses
    from stiffscope.runtime.types import Array, Flags, Indices
    from stiffscope.vjm.model.joints import Law

_SAME_LOAD = 1e-5  # relative difference of equal loads
_AT_ONCE = 200_000  # most numbers of a product over all readings
_ZERO_FORCE = 1e-6  # rounding error of zero forces over the largest force


@dataclass(frozen=True)
class RobotReadings(InstrumentReadings):
    """The robot with effects at the campaign's poses; all properties are lazy and cached."""

    sound: ElasticState
    """The robot without effects."""
    weighted: bool
    """Whether the nominal model includes the robot's weight."""
    exact: bool = False
    """Whether motions are those of the equilibrium reached, where that shows."""

    @property
    def at(self) -> RobotAtPoses:
        """The nominal robot at the campaign's poses."""
        return self.sound.at

    @cached_property
    def heavier(self) -> bool:
        """Whether an effect adds the robot's weight, which the nominal model lacks."""
        return any(influence.weight for influence in self.influences)

    @property
    def weighs(self) -> bool:
        """Whether weight acts: a payload's never does where the robot's own does not."""
        return self.weighted or self.heavier

    @cached_property
    def gravity(self) -> float:
        """Gravity acting on the robot, m/s²."""
        return self.at.robot.acceleration if self.weighs else 0.0

    @cached_property
    def elastic_state(self) -> ElasticState:
        """The robot with changed elements and payloads."""
        changes = tuple(each.elements for each in self.influences if each.elements)
        payloads = tuple(
            payload for each in self.influences for payload in each.payloads
        )
        return (
            ElasticState(self.at, changes, payloads, weighs=self.weighs)
            if changes or payloads
            else self.sound
        )

    @cached_property
    def is_motion(self) -> Flags:
        """Flags (n,) of readings of motions."""
        return self.campaign.is_motion

    @cached_property
    def force_scale(self) -> float:
        """Ratio of true to stated wrench."""
        return float(np.prod([1.0 + each.force_gain for each in self.influences]))

    @cached_property
    def true_wrench(self) -> Array:
        """Applied wrenches (n, 6) without a common scale: leaks and weights that differ taken off."""
        out = np.nan_to_num(self.campaign.wrench)
        for each in self.influences:
            if each.leak is not None:
                true = np.linalg.solve(np.eye(3) + each.leak, out[:, :3].T).T
                out = np.hstack([true, out[:, 3:]])
            for value, growth in each.load_gains.items():
                out = out * (1.0 + growth * self.has_size(value))[:, None]
        return out

    def has_size(self, value: float) -> Flags:
        """Return flags (n,) of readings under a load of a stated size, N or N·m."""
        size = size_loads(self.campaign.wrench)
        return np.abs(size - value) <= _SAME_LOAD * value

    @cached_property
    def applied_loads(self) -> Array:
        """Terminal loads (n, cases) of every reading of a motion; zero for other readings."""
        c = self.campaign
        at = self.at
        out = np.zeros((len(c), at.cases))
        wrench = self.force_scale * self.true_wrench
        for load in range(-1, len(c.loads)):
            mine = c.is_loaded & c.is_motion & (c.load == load)
            out[mine, at.load_cases(load)] = wrench[mine]
        out[c.shows_rest] += self.rest_loads
        return out

    @cached_property
    def axis(self) -> Array:
        """Measured direction (n, 6) of each reading: translation and rotation."""
        c = self.campaign
        out = np.eye(6)[c.direction]
        for k, sensor in enumerate(c.sensors):
            out[c.sensor == k] = sensor.along
        if self.placed_instruments is not None:
            out[self.at.instruments.rows] = self.placed_instruments.looks
        return out

    @cached_property
    def placed_instruments(self) -> AbsoluteReadings | None:
        """Instruments that read positions and distances; None if there are none."""
        instruments = self.at.instruments
        if not len(instruments.rows):
            return None
        points, turns = self.at.targets(self.elastic_state.places)
        moved, turned = np.split(self.twist[instruments.rows], 2, axis=1)
        turns = turns + np.cross(turned[:, None], turns, axisb=1, axisc=1)
        return instruments.place(points + moved, turns, self.at.instruments_start)

    @cached_property
    def projection(self) -> Projection:
        """Projection onto the unknowns of the instruments."""
        placed = self.placed_instruments
        return self.at.instruments.zeros if placed is None else placed.projection

    @cached_property
    def twist(self) -> Array:
        """True motion (n, 6) of M or the sensor's point for every reading of a motion.

        For positions and distances, it excludes the motion by geometric errors.
        """
        linear = np.zeros((len(self.campaign), 6))
        for k, mine in self.by_sensor(self.is_motion):
            linear[mine] = self._motion(k, mine)
        return linear + find_second_order(self, linear) if self.exact else linear

    def shows_second_order(self, rest: Array | None) -> bool:
        """Return whether readings would show the difference of equilibrium and first order.

        rest: part of the readings (n,) that the difference must equal in size; None: nothing.
        """
        return shows_second_order(self, self.twist, rest)

    @cached_property
    def length(self) -> float:
        """Largest distance of two joints, or of the tool from one, m."""
        return self.at.length

    @cached_property
    def expected_noise(self) -> Array:
        """Standard uncertainty (n,) of readings; a share of their kind's rms if not stated."""
        c = self.campaign
        like = c.kind_numbers
        mean = np.bincount(like, c.value**2) / np.maximum(np.bincount(like), 1)
        usual = SETTINGS.unstated * np.sqrt(mean)[like]
        return np.where(np.isnan(c.sigma), usual, c.sigma).clip(min=1e-300)

    def _motion(self, k: int, rows: Indices) -> Array:
        """Return the true motion (m, 6) at a sensor, or (-1) at M, for readings (m,)."""
        c = self.campaign
        applied = self.applied_loads[rows]
        used = np.flatnonzero(applied.any(axis=0))
        motion = self.elastic_state.move_sensor(k)[..., used]
        out = (motion[c.pose[rows]] @ applied[:, used, None])[..., 0]
        still = (c.shows_rest & ~c.is_absolute)[rows]
        if still.any():
            out[still] += self.elastic_state.displace_sensor(k)[c.pose[rows[still]]]
        return out

    def seen_by(self, channel: int, rows: Indices) -> Array:
        """Return what a channel would show (m,) for deflections and deviations (m,)."""
        sensors = self.campaign.sensors
        axes = [*(sensor.along for sensor in sensors), *np.eye(6)]
        k = channel if channel < len(sensors) else -1
        return self._motion(k, rows) @ (axes[channel] @ self.instrument(k))

    @cached_property
    def shown_stiffness(self) -> Array:
        """Apparent stiffness (p, 6, 6): stated wrench over shown motion."""
        return np.linalg.inv(self.shown_compliance)

    @cached_property
    def shown_compliance(self) -> Array:
        """Apparent compliance (p, 6, 6): shown motion over stated wrench."""
        return self.instrument(-1) @ self.elastic_state.compliance * self.force_scale

    @cached_property
    def pushed_targets(self) -> Array:
        """Part (n,) of positions and distances that is due to applied wrenches; zero for others."""
        c = self.campaign
        out = np.zeros(len(self.campaign))
        pushes = self.applied_loads - np.where(
            c.shows_rest[:, None], self.rest_loads, 0.0
        )
        for k, sensor in enumerate(c.sensors):
            mine = np.flatnonzero(c.sensor == k)
            if sensor.absolute and mine.size:
                motion = self.elastic_state.move_sensor(k)[c.pose[mine]]
                moved = np.einsum("nij,nj->ni", motion, pushes[mine])
                out[mine] = np.einsum("ni,ni->n", self.axis[mine], moved)
        return out

    @cached_property
    def sense(self) -> Array:
        """Sensed terminal directions a (n, cases), signs as in ``a · D b``."""
        terminals = len(self.campaign), self.at.cases
        return self.ask(
            lambda predictor, rows: predictor.find_sense(self, rows)
        ).reshape(terminals)

    @cached_property
    def drive(self) -> Array:
        """Applied terminal loads b (n, cases) of ``a · D b``; for stiffnesses, of the motion."""
        terminals = len(self.campaign), self.at.cases
        return self.ask(
            lambda predictor, rows: predictor.find_drive(self, rows)
        ).reshape(terminals)

    @cached_property
    def pushes(self) -> Array:
        """Apparent 1/C_ii (n,) at the pose and in the direction of each reading."""
        entries = self.entries(self.shown_compliance)
        return 1.0 / np.where(entries == 0.0, np.inf, entries)

    def find_wrenches(self, name: str) -> tuple[Array, Array]:
        """Return element wrenches (n, 6), own axes, by sense and drive: ``W a`` and ``W b``."""
        state = self.elastic_state
        return self._find_pair(name, state.transmit_wrenches, state.load_modes)

    def find_motions(self, name: str) -> tuple[Array, Array]:
        """Return motions (n, k) in a joint's free directions by sense and drive."""
        state = self.elastic_state
        return self._find_pair(name, state.transmit_motions, state.move_modes)

    def _find_pair(
        self, name: str, transmit: Callable[[str], Array], sway: Callable[[str], Array]
    ) -> tuple[Array, Array]:
        key = name, transmit.__name__
        if key not in self._known_pairs:
            at = transmit(name)
            pose = self.campaign.pose
            pairs = zip(
                self.at.distinct_readings, (self.sense, self.drive), strict=True
            )
            sensed, driven = (
                (at[pose[few]] @ each[few][..., None])[which, :, 0]
                for (few, which), each in pairs
            )
            for predictor, rows in self.at.predictors:
                modal = predictor.find_modal_pair(self, rows, partial(sway, name))
                if modal is not None:
                    sensed[rows], driven[rows] = modal
            self._known_pairs[key] = sensed, driven
        return self._known_pairs[key]

    def at_loads(
        self, columns: Array, cases: slice = slice(None)
    ) -> tuple[Array, Array]:
        """Return twists or wrenches (n, k) under the sense and the drive of every reading.

        Parameters
        ----------
        columns
            Those (p or 1, k, c) for unit loads at c terminals.
        cases
            These terminals.
        """
        every = self.sense[:, cases], self.drive[:, cases]
        sensed, driven = self.at.load_distinct(columns, every)
        return sensed, driven

    def at_each_load(self, columns: Sequence[Array]) -> list[tuple[Array, Array]]:
        """Return `at_loads` of many columns (p or 1, k, c), as many at once as fit a cache."""
        if not columns:
            return []
        most = max(1, _AT_ONCE // (len(self.campaign) * columns[0].shape[1]))
        out: list[tuple[Array, Array]] = []
        for k in range(0, len(columns), most):
            some = columns[k : k + most]
            count = max(map(len, some))
            wide = [np.broadcast_to(c, (count, *c.shape[1:])) for c in some]
            pair = self.at_loads(np.concatenate(wide, axis=1))
            ends = np.cumsum([c.shape[1] for c in some])[:-1]
            sensed, driven = (np.split(each, ends, axis=1) for each in pair)
            out += zip(sensed, driven, strict=True)
        return out

    @cached_property
    def motion_rates(self) -> MotionRates:
        """Derivatives by twists of nodes and of elements' frames, the loads held."""
        return find_motion_rates(self)

    def find_end_rates(self, name: str) -> Array:
        """Return the derivatives (n, 6m) of loaded readings by a twist of an element's unloaded end.

        Own axes. Nodes move as those of the robot without effects: exact for open chains, and a small
        error of a small term where elements share loads.
        """
        if name not in self._known_end_rates:
            nodes = self.at.cut(name).nodes
            every = self._node_rates
            # the ground does not move
            names = [k for k in self.motion_rates.nodes if k in nodes]
            if len(names) < len(self.motion_rates.nodes):
                every = np.hstack([self.motion_rates.nodes[k] for k in names])
            out = self.at.multiply_by_pose(every, self.at.moved_by(name, names))
            self._known_end_rates[name] = out
        return self._known_end_rates[name]

    @cached_property
    def _node_rates(self) -> Array:
        """Derivatives of readings (n, 6 nodes) by twists of all nodes."""
        return np.hstack(list(self.motion_rates.nodes.values()))

    @cached_property
    def _known_end_rates(self) -> dict[str, Array]:
        return {}

    @cached_property
    def at_terminals(self) -> tuple[Array, Array]:
        """Twists (n, 6) of the tool by sense and drive, as a spring at M undergoes them."""
        tool = self.elastic_state.tool
        pose = self.campaign.pose
        pair = [
            np.einsum("nij,nj->ni", tool[pose], each)
            for each in (self.sense, self.drive)
        ]
        return pair[0], pair[1]

    @cached_property
    def _known_pairs(self) -> dict[tuple[str, str], tuple[Array, Array]]:
        return {}

    def entries(self, matrices: Array) -> Array:
        """Return the diagonal entry (n,) of matrices (p, 6, 6) for each reading."""
        c = self.campaign
        return matrices[c.pose, c.direction, c.direction]

    @cached_property
    def robot_reads(self) -> Array:
        """Readings (n,) due to robot, loads and instruments, without lost motion."""
        return self.ask(lambda predictor, rows: predictor.read(self, rows))

    @cached_property
    def plain_readings(self) -> Array:
        """Readings (n,) due to robot, loads and instruments."""
        out = self.robot_reads
        if self.at.laws:
            out = out + self._lost_by_laws
        for influence in self.influences:
            for drive, width in influence.dead_zones.items():
                held = influence.preloads.get(drive)
                shift = self.dead_zone(drive, None if held is None else held.force)
                out = out + width * shift
            for drive, knee in influence.knees.items():
                out = out + self.bent_by(drive, knee)
            for drive in influence.frictions:
                out = out - self._drive_compliance(drive) * self.held_by(drive) * (
                    self.by_drive(drive)
                )
        return out

    def bent_by(self, drive: str, knee: Knee) -> Array:
        """Return the change (n,) of readings by another compliance of a drive below and beyond a load."""
        rest = self.rest_force(drive)
        axis = along_drive(self.at.robot.driven[drive])
        compliance = float(axis @ self.at.robot.compliances[drive] @ axis)
        softer = knee.bend(rest + self.drive_force(drive)) - knee.bend(rest)
        return compliance * softer * self.by_drive(drive)

    def rest_force(self, drive: str) -> Array:
        """Return the force or moment (n,) of a drive at rest, to which that of a deflection adds."""
        axis = along_drive(self.at.robot.driven[drive])
        deflected = self.campaign.is_difference
        return np.where(deflected, self.find_rest_wrench(drive) @ axis, 0.0)

    def held_by(self, drive: str, change: float = 0.0) -> Array:
        """Return the force or moment (n,) that friction, and a change of it, holds in a drive."""
        friction = sum(each.frictions.get(drive, 0.0) for each in self.influences)
        return self._chains.hold(self.drive_force(drive), max(friction + change, 0.0))

    def yield_to_friction(self, drive: str, change: float) -> Array:
        """Return the change (n,) of readings by a change of a drive's friction, N or N·m."""
        more = self.held_by(drive, change) - self.held_by(drive)
        return -self._drive_compliance(drive) * more * self.by_drive(drive)

    @cached_property
    def _chains(self) -> LoadChains:
        return LoadChains(self.campaign)

    def _drive_compliance(self, drive: str) -> float:
        """Return the compliance of a drive with its changes, m/N or rad/(N·m)."""
        axis = along_drive(self.at.robot.driven[drive])
        out = float(axis @ self.at.robot.compliances[drive] @ axis)
        for each in self.influences:
            change = each.elements.get(drive)
            if change is not None and change.compliance is not None:
                out += float(axis @ change.compliance @ axis)
        return out

    @cached_property
    def _lost_by_laws(self) -> Array:
        """Changes (n,) of readings by nonlinear drives, each unloaded in the middle of its gap.

        A curve is followed from the force at rest; a gap is crossed towards the applied force.
        """
        at = self.at
        forces = np.stack([self.drive_force(name) for name in at.laws], axis=1)
        forces = np.where(self.find_signs(forces) == 0.0, 0.0, forces)
        rest = np.stack([self.rest_force(name) for name in at.laws], axis=1)
        laws = list(at.laws.values())
        smooth = [replace(law, starts=law.starts - law.starts[0]) for law in laws]
        shifts = self._settle(laws, forces)
        if rest.any():
            bent = self._settle(smooth, forces + rest) - self._settle(smooth, rest)
            shifts = shifts - self._settle(smooth, forces) + bent
        changes = (shifts[:, k] * self.by_drive(name) for k, name in enumerate(at.laws))
        return sum(changes, np.zeros(len(forces)))

    def _settle(self, laws: Sequence[Law], forces: Array) -> Array:
        """Return the shifts (n, k) of drives with k laws under forces (n, k)."""
        influence = self.at.law_influence[self.campaign.pose]
        slopes = np.array([law.slopes[0] for law in laws])
        return settle(laws, slopes, forces, influence).shift

    def find_rest_wrench(self, name: str) -> Array:
        """Return the unloaded wrench (n, 6) in an element at each reading's pose, own axes."""
        carried = self.elastic_state.transmit_wrenches(name) @ self.rest_loads
        return carried[self.campaign.pose]

    @cached_property
    def rest_loads(self) -> Array:
        """Permanent terminal loads (cases,)."""
        out = np.zeros(self.at.cases)
        out[self.at.weight_case :] = self.gravity, 1.0
        return out

    def drive_force(self, drive: str) -> Array:
        """Return the applied force or moment (n,) in a drive; zero for readings of no motion."""
        axis = along_drive(self.at.robot.driven[drive])
        return np.where(self.is_motion, self.find_wrenches(drive)[1] @ axis, 0.0)

    def by_drive(self, drive: str) -> Array:
        """Return the change (n,) of readings per metre (or radian) of shift in a drive."""
        axis = along_drive(self.at.robot.driven[drive])
        return np.where(self.is_motion, self.find_wrenches(drive)[0] @ axis, 0.0)

    def dead_zone(self, drive: str, preload: float | None = None) -> Array:
        """Return the change (n,) of readings per metre of backlash, towards the drive's force.

        preload: force beside the weight that holds the drive to a side, N or N·m; None: it starts in
        the middle of its gap.
        """
        force = self.drive_force(drive)
        if preload is None:
            return self.find_signs(force) * self.by_drive(drive)
        held = self.rest_force(drive) + preload
        start = np.where(self.campaign.is_difference, self.find_signs(held), 0.0)
        return (self.find_signs(force + held) - start) * self.by_drive(drive)

    def find_signs(self, force: Array) -> Array:
        """Return signs (n, ...) of forces (n, ...), zero within rounding and for other readings.

        Rounding is relative to the largest force of a kind: weights may far exceed applied forces.
        """
        moved = np.where(self.is_motion, self.campaign.kind, -1)
        kind = moved.reshape(-1, *(1,) * (force.ndim - 1))
        kinds = np.unique(moved[moved >= 0]).tolist()
        signs = (_sign(np.where(kind == each, force, 0.0)) for each in kinds)
        return sum(signs, np.zeros(force.shape))

    @cached_property
    def weight(self) -> Array:
        """Change (n,) of the readings by the robot's own weight, except unknown zeros."""
        return self.ask(lambda predictor, rows: predictor.weigh(self, rows))

    def ask(self, question: Callable[[Predictor, Indices], Array]) -> Array:
        """Return the answers (n, ...) of all readings' predictors for their rows (m,)."""
        answers = [
            (rows, question(predictor, rows)) for predictor, rows in self.at.predictors
        ]
        if len(answers) == 1:
            return answers[0][1]
        shape = answers[0][1].shape[1:] if answers else ()
        out = np.zeros((len(self.campaign), *shape))
        for rows, answer in answers:
            out[rows] = answer
        return out

    def find_modes(self, rows: Indices) -> tuple[Indices, Indices]:
        """Return indices (m,) into the poses with readings of modes, and modes (m,) from 0."""
        c = self.campaign
        pose = np.searchsorted(self.at.shaken, c.pose[rows])
        return pose, MODE_OF[c.quantity[rows]]

    def applied_motion(self, wrenches: Array) -> Array:
        """Return deflections (n,) by wrenches (n, 6) added to the applied ones; else zero."""
        c = self.campaign
        applied = self.is_motion & c.is_loaded
        out = np.zeros(len(c))
        for load in range(-1, len(c.loads)):
            cases = self.at.load_cases(load)
            for k, mine in self.by_sensor(applied & (c.load == load)):
                motion = self.elastic_state.move_sensor(k)[c.pose[mine], :, cases]
                twist = np.einsum("nij,nj->ni", motion, wrenches[mine])
                out[mine] = np.einsum(
                    "ni,ij,nj->n", self.axis[mine], self.instrument(k), twist
                )
        return out


def _sign(force: Array) -> Array:
    largest = max(float(np.abs(force).max(initial=0.0)), 1e-6)
    return np.where(np.abs(force) > _ZERO_FORCE * largest, np.sign(force), 0.0)
