"""What a robot with given effects would read, and how every reading changes with every effect's parameters.

Every reading is ``a · D b``: D the generalized compliance between terminals, b what is applied (a wrench, the weight,
payloads), a what is read. A change δC of an element changes it by ``(W a) · δC (W b)``, W the wrenches that the
element carries under unit loads at the terminals; an unloaded motion t of the element by ``(W a) · t``. A stiffness
K_ii is read so with ``a = -K e_i``, ``b = K e_i``; a push 1/C_ii with ``a = -e_i/C_ii``, ``b = e_i/C_ii``; a natural
frequency f with ``W b`` the wrench in its mode of unit modal mass, ``a = -b / (8 π² f)``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.effects.elements import along_drive
from stiffscope.gap.campaign.quantities import (
    DEFLECTION,
    DEVIATION,
    FIRST_FREQUENCY,
    FREQUENCY,
    POSITION,
    PUSH,
    STIFFNESS,
)
from stiffscope.gap.forward.instrument_readings import InstrumentReadings
from stiffscope.vjm.laws import settle

if TYPE_CHECKING:
    from collections.abc import Callable

    from stiffscope.gap.forward.elastic_state import ElasticState
    from stiffscope.gap.forward.robot_at_poses import RobotAtPoses
    from stiffscope.gap.forward.setup import Placed, Projection
    from stiffscope.runtime.types import Array, Flags, Indices

_ZERO_FORCE = 1e-6  # of the largest force: what rounding leaves in a drive that carries none


@dataclass(frozen=True)
class RobotReadings(InstrumentReadings):
    """The robot with effects at the campaign's poses; everything is evaluated where it is asked for."""

    sound: ElasticState
    """The robot without effects."""
    weighted: bool
    """Whether the nominal model carries the robot's weight."""

    @property
    def robot_at_poses(self) -> RobotAtPoses:
        """The nominal robot at the campaign's poses."""
        return self.sound.at

    @cached_property
    def heavier(self) -> bool:
        """Whether an effect is the robot's weight, which its nominal model lacks."""
        return any(influence.weight for influence in self.influences)

    @cached_property
    def gravity(self) -> float:
        """Gravity that acts on the robot, m/s²."""
        return self.robot_at_poses.robot.acceleration if self.weighted or self.heavier else 0.0

    @cached_property
    def elastic_state(self) -> ElasticState:
        """The robot with the effects on its elements and the payloads."""
        found = self.influences
        return self.sound.change_elements(
            [each.elements for each in found if each.elements],
            [payload for each in found for payload in each.payloads],
        )

    @cached_property
    def is_motion(self) -> Flags:
        """(n,) whether a reading is of a motion."""
        return self.campaign.is_motion

    @cached_property
    def compliance(self) -> Array:
        """True compliance (p, 6, 6) at M."""
        return self.elastic_state.compliance

    @cached_property
    def force_scale(self) -> float:
        """True wrench over stated wrench."""
        return float(np.prod([1.0 + each.force_gain for each in self.influences]))

    @cached_property
    def applied_loads(self) -> Array:
        """What acts (n, cases) behind every reading of a motion, on the terminals; zero for other readings."""
        c, at = self.campaign, self.robot_at_poses
        out = np.zeros((len(c), at.cases))
        wrench = self.force_scale * np.nan_to_num(c.wrench)
        for load in range(-1, len(c.loads)):
            mine = (c.kind != DEVIATION) & c.is_motion & (c.load == load)
            out[mine, at.load_cases(load) if load >= 0 else slice(0, 6)] = wrench[mine]
        out[c.shows_rest] += self._dead
        return out

    @cached_property
    def axis(self) -> Array:
        """(n, 6) direction of motion that a reading looks in: translation and rotation."""
        c = self.campaign
        out = np.eye(6)[c.direction]
        for k in range(len(c.sensors)):
            out[c.sensor == k] = self.look(k)
        if self.placed_instruments is not None:
            out[self.robot_at_poses.instruments.rows] = self.placed_instruments.looks
        return out

    @cached_property
    def placed_instruments(self) -> Placed | None:
        """Instruments that read positions and distances; None where there are none."""
        instruments = self.robot_at_poses.instruments
        if not len(instruments.rows):
            return None
        points, turns = self.robot_at_poses.targets(self.elastic_state.places)
        moved, turned = np.split(self.twist[instruments.rows], 2, axis=1)
        turns = turns + np.cross(turned[:, None], turns, axisb=1, axisc=1)
        return instruments.place(points + moved, turns, self.robot_at_poses.instruments_start)

    @cached_property
    def projection(self) -> Projection:
        """What is unknown of the instruments."""
        return (
            self.robot_at_poses.instruments.zeros
            if self.placed_instruments is None
            else self.placed_instruments.projection
        )

    @cached_property
    def twist(self) -> Array:
        """True motion (n, 6) of what every reading of one looks at: M, or a sensor's point.

        Of the target of a position or distance without that by errors of the geometry.
        """
        c = self.campaign
        out = np.zeros((len(c), 6))
        for k in range(-1, len(c.sensors)):
            mine = np.flatnonzero(self.is_motion & (c.sensor == k))
            if mine.size:
                out[mine] = self._motion(k, mine)
        return out

    def _motion(self, k: int, rows: Indices) -> Array:
        """True motion (m, 6) of what a sensor, or (-1) the instrument at M, looks at behind some readings (m,)."""
        c = self.campaign
        sensor = c.sensors[k] if k >= 0 else None
        motion = self.elastic_state.tool if sensor is None else self.elastic_state.move_sensor(sensor)
        out = np.einsum("nij,nj->ni", motion[c.pose[rows]], self.applied_loads[rows])
        still = c.kind[rows] == DEVIATION
        if still.any():
            out[still] += self.elastic_state.displace_sensor(sensor)[c.pose[rows[still]]]
        return out

    def seen_by(self, channel: int, rows: Indices) -> Array:
        """What one instrument and direction would show (m,) of what some deflections and deviations (m,) are of."""
        count = len(self.campaign.sensors)
        k, axis = (channel, self.look(channel)) if channel < count else (-1, np.eye(6)[channel - count])
        return self._motion(k, rows) @ (axis @ self.instrument(k))

    @cached_property
    def shown_stiffness(self) -> Array:
        """Stiffness (p, 6, 6) as stated wrench over what the instrument shows."""
        return np.linalg.inv(self.shown_compliance)

    @cached_property
    def shown_compliance(self) -> Array:
        """Compliance (p, 6, 6) as what the instrument shows over the stated wrench."""
        return self.instrument(-1) @ self.compliance * self.force_scale

    @cached_property
    def sense(self) -> Array:
        """What is read (n, cases), on the terminals, signs as in ``a · D b``."""
        c, at = self.campaign, self.robot_at_poses
        out = np.zeros((len(c), at.cases))
        for k in range(-1, len(c.sensors)):
            mine = np.flatnonzero(self.is_motion & (c.sensor == k))
            if k < 0:
                out[mine, :6] = self.axis[mine] @ self.instrument(k)
            elif mine.size and c.sensors[k].absolute:
                out[mine, at.sensor_cases(k)] = self.axis[mine]
            elif mine.size:
                out[mine, at.sensor_cases(k)] = self.gain(k)
        stiff = np.flatnonzero(c.kind == STIFFNESS)
        if stiff.size:
            rows = self.shown_stiffness[c.pose[stiff], c.direction[stiff]]
            out[stiff, :6] = -rows @ self.instrument(-1)
        push = np.flatnonzero(c.kind == PUSH)
        if push.size:
            out[push, :6] = -self.axis[push] @ self.instrument(-1) * self.entries(self.pushes)[push, None]
        return out

    @cached_property
    def drive(self) -> Array:
        """What is applied (n, cases), on the terminals, as in ``a · D b``: for stiffnesses what makes the motion."""
        c = self.campaign
        out = self.applied_loads.copy()
        stiff = np.flatnonzero(c.kind == STIFFNESS)
        if stiff.size:
            out[stiff, :6] = self.shown_stiffness[c.pose[stiff], :, c.direction[stiff]] * self.force_scale
        push = np.flatnonzero(c.kind == PUSH)
        if push.size:
            out[push, :6] = self.axis[push] * self.entries(self.pushes)[push, None] * self.force_scale
        return out

    @cached_property
    def pushes(self) -> Array:
        """Diagonal matrices (p, 6, 6) of 1/C_ii as the instrument shows it."""
        diagonal = np.einsum("pii->pi", self.shown_compliance)
        return np.eye(6) / np.where(diagonal == 0.0, np.inf, diagonal)[:, None, :]

    def find_wrenches(self, name: str) -> tuple[Array, Array]:
        """Wrenches (n, 6) on an element, own axes, by what is read and by what is applied: ``W a`` and ``W b``."""
        return self._find_pair(name, self.elastic_state.transmit_wrenches, self.elastic_state.load_modes)

    def find_motions(self, name: str) -> tuple[Array, Array]:
        """Motions (n, k) along a joint's free directions by what is read and by what is applied."""
        return self._find_pair(f"{name} ", self.elastic_state.transmit_motions, self.elastic_state.move_modes)

    def _find_pair(
        self, name: str, transmit: Callable[[str], Array], sway: Callable[[str], Array]
    ) -> tuple[Array, Array]:
        known = self._known_wrenches.get(name)
        if known is None:
            at = transmit(name.strip())
            pose = self.campaign.pose
            pair: list[Array] = []
            for (first, which), each in zip(
                self.robot_at_poses.distinct_readings, (self.sense, self.drive), strict=True
            ):
                pair.append((at[pose[first]] @ each[first][..., None])[which, :, 0])
            if self._mode[0].size:  # δf = -w · δC w / (8 π² f)
                which, shaken, mode = self._mode
                pair[0][which] = pair[1][which] = moved = sway(name.strip())[shaken, :, mode]
                pair[0][which] = -moved / (8.0 * np.pi**2 * self.elastic_state.frequencies[shaken, mode])[:, None]
            known = self._known_wrenches[name] = (pair[0], pair[1])
        return known

    @cached_property
    def at_terminals(self) -> tuple[Array, Array]:
        """Twists (n, 6) of the tool by what is read and by what is applied: what a spring at M feels of either."""
        tool, pose = self.elastic_state.tool, self.campaign.pose
        pair = [np.einsum("nij,nj->ni", tool[pose], each) for each in (self.sense, self.drive)]
        return pair[0], pair[1]

    @cached_property
    def _known_wrenches(self) -> dict[str, tuple[Array, Array]]:
        return {}

    def entries(self, matrices: Array) -> Array:
        """Diagonal entry (n,) of matrices (p, 6, 6) that each reading looks at."""
        c = self.campaign
        return matrices[c.pose, c.direction, c.direction]

    @cached_property
    def robot_reads(self) -> Array:
        """What every reading (n,) would be by the robot, its loads and its instruments, but for lost motion."""
        c = self.campaign
        out = np.zeros(len(c))
        for k in range(-1, len(c.sensors)):
            mine = self.is_motion & (c.sensor == k)
            if mine.any():
                out[mine] = np.einsum("ni,ij,nj->n", self.axis[mine], self.instrument(k), self.twist[mine])
        if self.placed_instruments is not None:
            rows = self.robot_at_poses.instruments.rows
            out[rows] = self.placed_instruments.seen - (0.0 if c.expected is None else c.expected[rows])
        if (c.kind == STIFFNESS).any():
            out = np.where(c.kind == STIFFNESS, self.entries(self.shown_stiffness), out)
        if (c.kind == PUSH).any():
            out = np.where(c.kind == PUSH, self.entries(self.pushes), out)
        return out + self.at_modes(self.elastic_state.frequencies) if (c.kind == FREQUENCY).any() else out

    @cached_property
    def plain_readings(self) -> Array:
        """What every reading (n,) would be by the robot, its loads and its instruments."""
        out = self.robot_reads
        if self.robot_at_poses.laws:
            out = out + self._lost_by_laws
        for influence in self.influences:
            for drive, width in influence.dead_zones.items():
                out = out + width * self.dead_zone(drive)
        return out

    @cached_property
    def _lost_by_laws(self) -> Array:
        """What readings (n,) are more by drives that are not linear, each from no force in the middle of its gap."""
        at = self.robot_at_poses
        forces = np.stack([self.drive_force(name) for name in at.laws], axis=1)
        forces = np.where(self.find_signs(forces) == 0.0, 0.0, forces)
        stiffness = np.array([law.slopes[0] for law in at.laws.values()])
        shifts = settle(list(at.laws.values()), stiffness, forces, at.law_influence[self.campaign.pose]).shift
        return sum((shifts[:, k] * self.by_drive(name) for k, name in enumerate(at.laws)), np.zeros(len(forces)))

    def find_rest_wrench(self, name: str) -> Array:
        """Wrench (n, 6) on an element at every reading's pose when nothing is applied, own axes."""
        carried = self.elastic_state.transmit_wrenches(name) @ self._dead
        return carried[self.campaign.pose]

    @cached_property
    def _dead(self) -> Array:
        """What always acts (cases,), on the terminals."""
        out = np.zeros(self.robot_at_poses.cases)
        out[self.robot_at_poses.weight_case : self.robot_at_poses.weight_case + 2] = self.gravity, 1.0
        return out

    def drive_force(self, drive: str) -> Array:
        """Force or moment (n,) that a drive carries under what is applied; zero for other readings."""
        axis = along_drive(self.robot_at_poses.robot.driven[drive])
        return np.where(self.is_motion, self.find_wrenches(drive)[1] @ axis, 0.0)

    def by_drive(self, drive: str) -> Array:
        """Change (n,) of every reading for a shift of one metre (or a turn of one radian) in a drive."""
        axis = along_drive(self.robot_at_poses.robot.driven[drive])
        return np.where(self.is_motion, self.find_wrenches(drive)[0] @ axis, 0.0)

    def dead_zone(self, drive: str) -> Array:
        """Change (n,) of every reading per metre of backlash: towards the force that the drive carries."""
        return self.find_signs(self.drive_force(drive)) * self.by_drive(drive)

    def find_signs(self, force: Array) -> Array:
        """Signs (n, ...) of forces (n, ...) behind deflections and deviations, rounding apart; zero for other readings.

        What rounding leaves is judged beside the largest of a kind: a weight may be many times the forces applied.
        """
        kind = self.campaign.kind.reshape(-1, *(1,) * (force.ndim - 1))
        return sum(
            (_sign(np.where(kind == each, force, 0.0)) for each in (DEFLECTION, DEVIATION, POSITION)), np.zeros(())
        )

    @cached_property
    def weight(self) -> Array:
        """Change (n,) of the readings when the robot's own weight acts, but for unknown zeros."""
        c = self.campaign
        out = np.zeros(len(c))
        still = np.flatnonzero(c.shows_rest)
        for k in range(-1, len(c.sensors)):
            mine = still[c.sensor[still] == k]
            if not mine.size:
                continue
            motion = self.elastic_state.tool if k < 0 else self.elastic_state.move_sensor(c.sensors[k])
            twist = self.robot_at_poses.robot.acceleration * motion[c.pose[mine], :, self.robot_at_poses.weight_case]
            out[mine] = np.einsum("ni,ij,nj->n", self.axis[mine], self.instrument(k), twist)
        if (c.kind == STIFFNESS).any():
            out = np.where(c.kind == STIFFNESS, self.entries(self.robot_at_poses.weight_stiffness), out)
        if (c.kind == PUSH).any():
            with_weight = np.linalg.inv(np.linalg.inv(self.shown_compliance) + self.robot_at_poses.weight_stiffness)
            diagonal = np.einsum("pii->pi", with_weight)[c.pose, c.direction]
            out = np.where(c.kind == PUSH, 1.0 / diagonal - self.entries(self.pushes), out)
        return out

    def at_modes(self, values: Array) -> Array:
        """Values (s, c) by pose and mode as the readings of frequencies (n,) have them; zero for others."""
        out = np.zeros(len(self.campaign))
        which, pose, mode = self._mode
        out[which] = values[pose, mode]
        return out

    @cached_property
    def _mode(self) -> tuple[Indices, Indices, Indices]:
        """Readings of natural frequencies, each one's place among the poses with such, and its mode from 0."""
        c = self.campaign
        which = np.flatnonzero(c.kind == FREQUENCY)
        return which, np.searchsorted(self.robot_at_poses.shaken, c.pose[which]), c.quantity[which] - FIRST_FREQUENCY

    def applied_motion(self, moments: Array) -> Array:
        """Deflection (n,) by further moments (n, 3) where the wrench of each acts; zero for other kinds of reading."""
        c = self.campaign
        out = np.zeros(len(c))
        for load in range(-1, len(c.loads)):
            cases = self.robot_at_poses.load_cases(load) if load >= 0 else slice(0, 6)
            for k in range(-1, len(c.sensors)):
                applied = c.is_motion & (c.kind != DEVIATION)
                mine = np.flatnonzero(applied & (c.load == load) & (c.sensor == k))
                if mine.size:
                    motion = self.elastic_state.tool if k < 0 else self.elastic_state.move_sensor(c.sensors[k])
                    twist = np.einsum("nij,nj->ni", motion[c.pose[mine], :, cases][..., 3:], moments[mine])
                    out[mine] = np.einsum("ni,ni->n", self.axis[mine], twist)
        return out


def _sign(force: Array) -> Array:
    largest = max(float(np.abs(force).max(initial=0.0)), 1e-6)
    return np.where(np.abs(force) > _ZERO_FORCE * largest, np.sign(force), 0.0)
