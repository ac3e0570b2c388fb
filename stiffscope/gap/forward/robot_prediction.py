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
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.gap.campaign.quantities import DEFLECTION, DEVIATION, FIRST_FREQUENCY, FREQUENCY, PUSH, STIFFNESS
from stiffscope.gap.forward.mechanics import Payload
from stiffscope.robot.effects import Change, MechanicalEffect, along_drive

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from stiffscope.gap.campaign.campaign import Campaign
    from stiffscope.gap.forward.forward_model import Candidate, Parameters
    from stiffscope.gap.forward.mechanics import ElasticState, RobotAtPoses
    from stiffscope.robot.effects import Changes

    Array = NDArray[np.floating[Any]]
    Codes = NDArray[np.int64]
    Flags = NDArray[np.bool_]

_STEP = 1e-4  # of a parameter's prior size, for derivatives of what an effect does to an element
_ZERO_FORCE = 1e-6  # of the largest force: what rounding leaves in a drive that carries none
INSTRUMENT = "instrument"


@dataclass(frozen=True)
class Pattern:
    """A nuisance pattern that is known by its derivatives (n, k) of the readings alone."""

    columns: Callable[[RobotPrediction], Array]


@dataclass(frozen=True)
class Laden:
    """A payload: the body, a point (3,) of it, and the directions (k, 3) at home of its first moments."""

    body: str
    at: Array
    directions: Array

    def payload(self, values: Sequence[float]) -> Payload:
        """The payload of internal parameters (1 + k,): mass and first moments."""
        moments = np.array(values[1:]) @ self.directions if len(values) > 1 else np.zeros(3)
        return Payload(self.body, self.at, float(values[0]), moments)


@dataclass(frozen=True)
class RobotPrediction:
    """The robot with effects at the campaign's poses; everything is evaluated where it is asked for."""

    campaign: Campaign
    at: RobotAtPoses
    weighted: bool
    """Whether the nominal model carries the robot's weight."""
    parameters: Parameters

    @cached_property
    def _internal(self) -> dict[str, Array]:
        return {candidate.name: np.array(values) for candidate, values in self.parameters}

    def _first(self, name: str) -> float:
        values = self._internal.get(name)
        return 0.0 if values is None else float(values[0])

    @cached_property
    def gravity(self) -> float:
        """Gravity that acts on the robot, m/s²."""
        return self.at.robot.acceleration if self.weighted or "gravity @ robot" in self._internal else 0.0

    @cached_property
    def elastic(self) -> ElasticState:
        """The robot with the mechanical effects and the payloads."""
        found = [(candidate.action, values) for candidate, values in self.parameters]
        changes = [a.changes(np.array(v)) for a, v in found if isinstance(a, MechanicalEffect)]
        return self.at.state(changes, [a.payload(v) for a, v in found if isinstance(a, Laden)])

    @cached_property
    def _moving(self) -> Flags:
        """(n,) whether a reading is a deflection or a deviation."""
        return self.campaign.kind <= DEVIATION

    @cached_property
    def compliance(self) -> Array:
        """True compliance (p, 6, 6) at M."""
        return self.elastic.compliance

    @property
    def force_scale(self) -> float:
        """True wrench over stated wrench."""
        return 1.0 + self._first(f"force-scale @ {INSTRUMENT}")

    @cached_property
    def applied(self) -> Array:
        """What acts (n, cases) behind every deflection and deviation, on the terminals; zero for other readings."""
        c, at = self.campaign, self.at
        out = np.zeros((len(c), at.cases))
        wrench = self.force_scale * np.nan_to_num(c.wrench)
        for load in range(-1, len(c.loads)):
            mine = (c.kind == DEFLECTION) & (c.load == load)
            out[mine, at.load_cases(load) if load >= 0 else slice(0, 6)] = wrench[mine]
        still = c.kind == DEVIATION
        out[still] = self._dead
        return out

    def instrument(self, sensor: int) -> Array:
        """Matrix (6, 6) from a true motion to what an instrument shows: a sensor, or (-1) that at M."""
        place = self.place_of(sensor)
        x, y, z = self._internal.get(f"instrument-misalignment @ {place}", np.zeros(3))
        if sensor >= 0 and place != INSTRUMENT:
            own = self._internal.get(f"instrument-misalignment @ {INSTRUMENT}", np.zeros(3))
            x, y, z = np.array([x, y, z]) + (own if not self.at_tool.any() else 0.0)
        scale = 1.0 + self._first(f"displacement-scale @ {place}")
        if sensor >= 0 and not self.at_tool.any():
            scale *= 1.0 + self._first(f"displacement-scale @ {INSTRUMENT}")
        turn = np.eye(3) + np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        return scale * np.kron(np.eye(2), turn)

    def place_of(self, sensor: int) -> str:
        """Name of an instrument as effects have it."""
        return INSTRUMENT if sensor < 0 else self.campaign.sensors[sensor].name

    @cached_property
    def at_tool(self) -> Flags:
        """(n,) whether a reading is that of the instrument at M, stiffnesses included, frequencies not."""
        c = self.campaign
        return (c.sensor < 0) & (c.kind < FREQUENCY)

    @cached_property
    def axis(self) -> Array:
        """(n, 6) direction of motion that a reading looks in: translation and rotation."""
        c = self.campaign
        out = np.eye(6)[c.direction]
        for k in range(len(c.sensors)):
            out[c.sensor == k] = self._looks(k)
        return out

    def _looks(self, sensor: int) -> Array:
        """Direction of motion (6,) that a sensor looks in."""
        s = self.campaign.sensors[sensor]
        return np.concatenate([np.zeros(3), s.direction] if s.rotates else [s.direction, np.zeros(3)])

    @cached_property
    def twist(self) -> Array:
        """True motion (n, 6) of what every deflection and deviation looks at: M, or a sensor's point."""
        c = self.campaign
        out = np.zeros((len(c), 6))
        for k in range(-1, len(c.sensors)):
            mine = np.flatnonzero(self._moving & (c.sensor == k))
            if mine.size:
                out[mine] = self._motion(k, mine)
        return out

    def _motion(self, k: int, rows: Codes) -> Array:
        """True motion (m, 6) of what a sensor, or (-1) the instrument at M, looks at behind some readings (m,)."""
        c = self.campaign
        sensor = c.sensors[k] if k >= 0 else None
        motion = self.elastic.tool if sensor is None else self.elastic.sensed(sensor)
        out = np.einsum("nij,nj->ni", motion[c.pose[rows]], self.applied[rows])
        still = c.kind[rows] == DEVIATION
        if still.any():
            out[still] += self.elastic.displaced(sensor)[c.pose[rows[still]]]
        return out

    def seen_by(self, channel: int, rows: Codes) -> Array:
        """What one instrument and direction would show (m,) of what some deflections and deviations (m,) are of."""
        count = len(self.campaign.sensors)
        k, axis = (channel, self._looks(channel)) if channel < count else (-1, np.eye(6)[channel - count])
        return self._motion(k, rows) @ (axis @ self.instrument(k))

    @cached_property
    def _shown_stiffness(self) -> Array:
        """Stiffness (p, 6, 6) as stated wrench over what the instrument shows."""
        return np.linalg.inv(self._shown_compliance)

    @cached_property
    def _shown_compliance(self) -> Array:
        return self.instrument(-1) @ self.compliance * self.force_scale

    @cached_property
    def sense(self) -> Array:
        """What is read (n, cases), on the terminals, signs as in ``a · D b``."""
        c, at = self.campaign, self.at
        out = np.zeros((len(c), at.cases))
        for k in range(-1, len(c.sensors)):
            mine = np.flatnonzero(self._moving & (c.sensor == k))
            if k < 0:
                out[mine, :6] = self.axis[mine] @ self.instrument(k)
            elif mine.size:
                gain = float(np.cbrt(np.linalg.det(self.instrument(k)[:3, :3])))
                out[mine, at.sensor_case(k)] = gain
        stiff = np.flatnonzero(c.kind == STIFFNESS)
        if stiff.size:
            rows = self._shown_stiffness[c.pose[stiff], c.direction[stiff]]
            out[stiff, :6] = -rows @ self.instrument(-1)
        push = np.flatnonzero(c.kind == PUSH)
        if push.size:
            out[push, :6] = -self.axis[push] @ self.instrument(-1) * self._entries(self._pushes)[push, None]
        return out

    @cached_property
    def drive(self) -> Array:
        """What is applied (n, cases), on the terminals, as in ``a · D b``: for stiffnesses what makes the motion."""
        c = self.campaign
        out = self.applied.copy()
        stiff = np.flatnonzero(c.kind == STIFFNESS)
        if stiff.size:
            out[stiff, :6] = self._shown_stiffness[c.pose[stiff], :, c.direction[stiff]] * self.force_scale
        push = np.flatnonzero(c.kind == PUSH)
        if push.size:
            out[push, :6] = self.axis[push] * self._entries(self._pushes)[push, None] * self.force_scale
        return out

    @cached_property
    def _pushes(self) -> Array:
        """Diagonal matrices (p, 6, 6) of 1/C_ii as the instrument shows it."""
        diagonal = np.einsum("pii->pi", self._shown_compliance)
        return np.eye(6) / np.where(diagonal == 0.0, np.inf, diagonal)[:, None, :]

    def felt(self, name: str) -> tuple[Array, Array]:
        """Wrenches (n, 6) on an element, own axes, by what is read and by what is applied: ``W a`` and ``W b``."""
        known = self._felt.get(name)
        if known is None:
            at = self.elastic.transmitted(name)
            pose = self.campaign.pose
            pair: list[Array] = []
            for (first, which), each in zip(self.at.distinct, (self.sense, self.drive), strict=True):
                pair.append((at[pose[first]] @ each[first][..., None])[which, :, 0])
            if self._mode[0].size:  # δf = -w · δC w / (8 π² f)
                which, shaken, mode = self._mode
                pair[0][which] = pair[1][which] = wrench = self.elastic.swung(name)[shaken, :, mode]
                pair[0][which] = -wrench / (8.0 * np.pi**2 * self.elastic.frequencies[shaken, mode])[:, None]
            known = self._felt[name] = (pair[0], pair[1])
        return known

    @cached_property
    def at_terminals(self) -> tuple[Array, Array]:
        """Twists (n, 6) of the tool by what is read and by what is applied: what a spring at M feels of either."""
        tool, pose = self.elastic.tool, self.campaign.pose
        pair = [np.einsum("nij,nj->ni", tool[pose], each) for each in (self.sense, self.drive)]
        return pair[0], pair[1]

    @cached_property
    def _felt(self) -> dict[str, tuple[Array, Array]]:
        return {}

    def _entries(self, matrices: Array) -> Array:
        """Diagonal entry (n,) of matrices (p, 6, 6) that each reading looks at."""
        c = self.campaign
        return matrices[c.pose, c.direction, c.direction]

    @cached_property
    def robot_reads(self) -> Array:
        """What every reading (n,) would be by the robot, its loads and its instruments, but for lost motion."""
        c = self.campaign
        out = np.zeros(len(c))
        for k in range(-1, len(c.sensors)):
            mine = self._moving & (c.sensor == k)
            if mine.any():
                out[mine] = np.einsum("ni,ij,nj->n", self.axis[mine], self.instrument(k), self.twist[mine])
        if (c.kind == STIFFNESS).any():
            out = np.where(c.kind == STIFFNESS, self._entries(self._shown_stiffness), out)
        if (c.kind == PUSH).any():
            out = np.where(c.kind == PUSH, self._entries(self._pushes), out)
        return out + self._at_modes(self.elastic.frequencies) if (c.kind == FREQUENCY).any() else out

    @cached_property
    def plain(self) -> Array:
        """What every reading (n,) would be by the robot, its loads and its instruments."""
        out = self.robot_reads
        for candidate, values in self.parameters:
            if candidate.effect == "backlash" and values[0] != 0.0:
                out = out + values[0] * self.dead_zone(str(candidate.action))
        return out

    def resting(self, name: str) -> Array:
        """Wrench (n, 6) on an element at every reading's pose when nothing is applied, own axes."""
        carried = self.elastic.transmitted(name) @ self._dead
        return carried[self.campaign.pose]

    @cached_property
    def _dead(self) -> Array:
        """What always acts (cases,), on the terminals."""
        out = np.zeros(self.at.cases)
        out[self.at.weight_case : self.at.weight_case + 2] = self.gravity, 1.0
        return out

    def drive_force(self, drive: str) -> Array:
        """Force or moment (n,) that a drive carries under what is applied; zero for other readings."""
        axis = along_drive(self.at.robot.driven[drive])
        return np.where(self._moving, self.felt(drive)[1] @ axis, 0.0)

    def by_drive(self, drive: str) -> Array:
        """Change (n,) of every reading for a shift of one metre (or a turn of one radian) in a drive."""
        axis = along_drive(self.at.robot.driven[drive])
        return np.where(self._moving, self.felt(drive)[0] @ axis, 0.0)

    def dead_zone(self, drive: str) -> Array:
        """Change (n,) of every reading per metre of backlash: towards the force that the drive carries."""
        return self.towards(self.drive_force(drive)) * self.by_drive(drive)

    def towards(self, force: Array) -> Array:
        """Signs (n, ...) of forces (n, ...) behind deflections and deviations, rounding apart; zero for other readings.

        What rounding leaves is judged beside the largest of a kind: a weight may be many times the forces applied.
        """
        kind = self.campaign.kind.reshape(-1, *(1,) * (force.ndim - 1))
        return sum((_sign(np.where(kind == each, force, 0.0)) for each in (DEFLECTION, DEVIATION)), np.zeros(()))

    @property
    def values(self) -> Array:
        """What every reading (n,) would be, with nuisance patterns, the weight's share of stiffness, and zeros."""
        return self._values

    @cached_property
    def _values(self) -> Array:
        out = self.plain
        if "gravity @ robot" in self._internal:
            out = out + np.where(self._moving, 0.0, self._weight())
        for candidate, values in self.parameters:
            if isinstance(candidate.action, Pattern):
                out = out + candidate.action.columns(self) @ np.array(values)
        return out + self._zero_of(self.campaign.value - out)

    @cached_property
    def _zeros(self) -> tuple[NDArray[np.int64], Array] | None:
        """Group (n,) of readings that share an unknown zero, -1 for none, and weights (n,); None without any."""
        c = self.campaign
        free = np.array([s.zero == "session" for s in c.sensors] + [False])[c.sensor] & self._moving
        if not free.any():
            return None
        group = np.full(len(c), -1)
        key = np.stack([c.sensor, c.session], axis=1)[free]
        group[free] = np.unique(key, axis=0, return_inverse=True)[1].ravel()
        weight = np.where(np.isnan(c.sigma), 1.0, c.sigma**-2.0)
        for k in range(group.max() + 1):  # stated and unknown uncertainties do not mix
            mine = group == k
            if np.isnan(c.sigma[mine]).any():
                weight[mine] = 1.0
        return group, weight

    def _zero_of(self, change: Array) -> Array:
        """The best zeros' share (n,) in a change (n,) of readings: the weighted mean over those that share a zero."""
        if self._zeros is None:
            return np.zeros(len(change))
        group, weight = self._zeros
        mine = group >= 0
        total = np.bincount(group[mine], weight[mine] * change[mine])
        return np.where(mine, (total / np.bincount(group[mine], weight[mine]))[group], 0.0)

    def _without_zeros(self, columns: Array) -> Array:
        """Columns (n, k) with the unknown zeros projected out."""
        if self._zeros is None or not columns.shape[1]:
            return columns
        return columns - np.stack([self._zero_of(column) for column in columns.T], axis=1).reshape(columns.shape)

    def columns(self, candidate: Candidate) -> Array:
        """Derivatives (n, k) of every reading by a candidate's internal parameters."""
        key = candidate.name, candidate.scale, id(candidate.action)
        if key not in self._columns:
            self._columns[key] = candidate, self._derivatives(candidate)  # the action lives as long as its id
        return self._columns[key][1]

    @cached_property
    def _columns(self) -> dict[tuple[str, tuple[float, ...], int], tuple[Candidate, Array]]:
        return {}

    def _derivatives(self, candidate: Candidate) -> Array:
        match candidate.action:
            case MechanicalEffect() as action:
                here = self._internal.get(candidate.name, np.zeros(0))
                if len(here) != len(candidate.scale):  # absent, or there with fewer or more parameters
                    here = np.zeros(len(candidate.scale))
                steps = _STEP * np.diag(candidate.scale)
                out = np.stack([self._mechanical(action, here, step) for step in steps], axis=1)
            case Laden() as action:
                out = self._laden(action)
                if (self.campaign.kind == FREQUENCY).any():
                    out = out + self._swing_of_payload(action)
                out = out[:, : len(candidate.scale)]
            case Pattern() as pattern:
                out = pattern.columns(self)
            case _:
                out = self._columns_by_name(candidate)
        return self._without_zeros(out)

    def _columns_by_name(self, candidate: Candidate) -> Array:
        """Derivatives of backlash and of the instruments."""
        match candidate.effect:
            case "backlash":
                return self.dead_zone(str(candidate.action))[:, None]
            case "displacement-scale":
                signs = np.array([1.0, 1.0, -1.0, -1.0, 0.0])[self.campaign.kind]
                gain = 1.0 + self._first(candidate.name)
                return (signs * self.plain * self._shown_by(candidate.place) / gain)[:, None]
            case "force-scale":
                return (np.array([1.0, 0.0, -1.0, -1.0, 0.0])[self.campaign.kind] * self.plain)[:, None] / (
                    self.force_scale
                )
            case "instrument-misalignment":
                return self._misalignment(self._shown_by(candidate.place))
            case _:
                return np.zeros((len(self.campaign), 0))

    def _shown_by(self, place: str) -> Flags:
        """Which readings (n,) an instrument shows; that at M stands for all where there are only sensors."""
        c = self.campaign
        if place == INSTRUMENT:
            return self.at_tool if self.at_tool.any() else (c.sensor >= 0)
        names = [sensor.name for sensor in c.sensors]
        return c.sensor == (names.index(place) if place in names else len(names))

    def step(self, candidate: Candidate) -> Array:
        """Change (n,) of the readings when the robot's own weight acts: the one effect without parameters."""
        if candidate.effect != "gravity":
            return np.zeros(len(self.campaign))
        change = self._weight()
        return change - self._zero_of(change)

    def _weight(self) -> Array:
        """Change (n,) of the readings when the robot's own weight acts."""
        c = self.campaign
        out = np.zeros(len(c))
        still = np.flatnonzero(c.kind == DEVIATION)
        for k in range(-1, len(c.sensors)):
            mine = still[c.sensor[still] == k]
            if not mine.size:
                continue
            motion = self.elastic.tool if k < 0 else self.elastic.sensed(c.sensors[k])
            twist = self.at.robot.acceleration * motion[c.pose[mine], :, self.at.weight_case]
            out[mine] = np.einsum("ni,ij,nj->n", self.axis[mine], self.instrument(k), twist)
        if (c.kind == STIFFNESS).any():
            out = np.where(c.kind == STIFFNESS, self._entries(self.at.weight_stiffness), out)
        if (c.kind == PUSH).any():
            with_weight = np.linalg.inv(np.linalg.inv(self._shown_compliance) + self.at.weight_stiffness)
            diagonal = np.einsum("pii->pi", with_weight)[c.pose, c.direction]
            out = np.where(c.kind == PUSH, 1.0 / diagonal - self._entries(self._pushes), out)
        return out

    def _mechanical(self, effect: MechanicalEffect, here: Array, step: Array) -> Array:
        """Derivative (n,) along a step of internal parameters, by the wrenches that the changed elements carry."""
        out = np.zeros(len(self.campaign))
        for name, slope in _slopes(effect.changes(here + step), effect.changes(here - step), 2.0 * step.sum()).items():
            read, applied = self.felt(name)
            if slope.compliance is not None:
                out += np.einsum("ni,ni->n", read @ slope.compliance, applied)
            if slope.offset is not None:
                out += np.where(self.campaign.still, read @ slope.offset, 0.0)
        return out

    def _laden(self, action: Laden) -> Array:
        """Derivatives (n, 1 + k) of readings by a payload's mass and first moments: its weight along what is read."""
        c, per_unit = self.campaign, np.eye(1 + len(action.directions))
        wrenches = self.elastic.weights([action.payload(tuple(values)) for values in per_unit])
        along = self.elastic.moved(action.body, wrenches)  # (p, cases, 1 + k)
        return np.where(c.still[:, None], np.einsum("nc,nck->nk", self.sense, along[c.pose]), 0.0)

    def _swing_of_payload(self, action: Laden) -> Array:
        """Derivatives (n, 1 + k) of natural frequencies by a payload's mass and first moments."""
        v, w = np.split(self.elastic.swing(action.body, action.at), 2, axis=1)
        rotation = self.at.configurations.frame(action.body)[0][self.at.shaken]
        turned: list[Array] = [np.cross(w, (rotation @ axis)[..., None], axis=1) for axis in action.directions]
        rates: list[Array] = [np.square(v).sum(axis=1), *(2.0 * (v * each).sum(axis=1) for each in turned)]
        f = self.elastic.frequencies
        return np.stack([self._at_modes(-0.5 * f * rate) for rate in rates], axis=1)

    def _at_modes(self, values: Array) -> Array:
        """Values (s, c) by pose and mode as the readings of frequencies (n,) have them; zero for others."""
        out = np.zeros(len(self.campaign))
        which, pose, mode = self._mode
        out[which] = values[pose, mode]
        return out

    @cached_property
    def _mode(self) -> tuple[Codes, Codes, Codes]:
        """Readings of natural frequencies, each one's place among the poses with such, and its mode from 0."""
        c = self.campaign
        which = np.flatnonzero(c.kind == FREQUENCY)
        return which, np.searchsorted(self.at.shaken, c.pose[which]), c.quantity[which] - FIRST_FREQUENCY

    def _misalignment(self, shown: Flags) -> Array:
        c = self.campaign
        columns: list[Array] = []
        for axis in np.eye(3):
            turn = np.kron(np.eye(2), np.cross(axis, np.eye(3)).T)
            out = np.zeros(len(c))
            for k in range(-1, len(c.sensors)):
                mine = np.flatnonzero(shown & self._moving & (c.sensor == k))
                if mine.size:
                    gain = float(np.cbrt(np.linalg.det(self.instrument(k)[:3, :3])))
                    out[mine] = gain * np.einsum("ni,ij,nj->n", self.axis[mine], turn, self.twist[mine])
            back = (
                turn @ np.linalg.inv(self.instrument(-1)) * float(np.cbrt(np.linalg.det(self.instrument(-1)[:3, :3])))
            )
            stiff = c.kind == STIFFNESS
            if stiff.any() and shown[stiff].any():
                out = np.where(stiff, self._entries(-self._shown_stiffness @ back), out)
            push = c.kind == PUSH
            if push.any() and shown[push].any():
                change = np.einsum("pii->pi", back @ self._shown_compliance)[c.pose, c.direction]
                out = np.where(push, -(self._entries(self._pushes) ** 2) * change, out)
            columns.append(out)
        return np.stack(columns, axis=1)

    def applied_motion(self, moments: Array) -> Array:
        """Deflection (n,) by further moments (n, 3) where the wrench of each acts; zero for other kinds of reading."""
        c = self.campaign
        out = np.zeros(len(c))
        for load in range(-1, len(c.loads)):
            cases = self.at.load_cases(load) if load >= 0 else slice(0, 6)
            for k in range(-1, len(c.sensors)):
                mine = np.flatnonzero((c.kind == DEFLECTION) & (c.load == load) & (c.sensor == k))
                if mine.size:
                    motion = self.elastic.tool if k < 0 else self.elastic.sensed(c.sensors[k])
                    twist = np.einsum("nij,nj->ni", motion[c.pose[mine], :, cases][..., 3:], moments[mine])
                    out[mine] = np.einsum("ni,ni->n", self.axis[mine], twist)
        return out


def _sign(force: Array) -> Array:
    largest = max(float(np.abs(force).max(initial=0.0)), 1e-6)
    return np.where(np.abs(force) > _ZERO_FORCE * largest, np.sign(force), 0.0)


def _slopes(ahead: Changes, behind: Changes, step: float) -> Changes:
    """Derivatives of what an effect does to each element."""

    def slope(a: Array | None, b: Array | None) -> Array | None:
        return None if a is None or b is None else (a - b) / step

    return {
        name: Change(slope(a.compliance, behind[name].compliance), slope(a.offset, behind[name].offset))
        for name, a in ahead.items()
    }
