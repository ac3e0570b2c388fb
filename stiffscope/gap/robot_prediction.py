"""What a robot with given effects would read, and how every reading changes with every effect's parameters."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.gap.mechanics import DRIVES
from stiffscope.gap.quantities import DEFLECTION, DEVIATION, STIFFNESS
from stiffscope.robot.effects import Change, MechanicalEffect

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from stiffscope.gap.campaign import Campaign
    from stiffscope.gap.forward_model import Candidate, Parameters
    from stiffscope.gap.mechanics import ElasticState, RobotAtPoses
    from stiffscope.robot.effects import Changes

    Array = NDArray[np.floating[Any]]

_STEP = 1e-4  # of a parameter's prior size, for derivatives of what an effect does to an element
_ZERO_FORCE = 1e-6  # of the largest force: what rounding leaves in a drive that carries none
_PAYLOAD = np.array([[0.0, 0, 1, 0, 0, 0], [0, 0, 0, 0, -1, 0], [0, 0, 0, 1, 0, 0]])  # wrench per kg, kg·m x, kg·m y


@dataclass(frozen=True)
class Pattern:
    """A nuisance pattern that is known by its derivatives (n, k) of the readings alone."""

    columns: Callable[[RobotPrediction], Array]


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
        """The robot with the mechanical effects and the payload."""
        mechanical = [(c.action, v) for c, v in self.parameters if isinstance(c.action, MechanicalEffect)]
        payload = self._internal.get("payload @ platform", np.zeros(0))
        wrench = self.at.robot.acceleration * (payload @ _PAYLOAD[: len(payload)])
        return self.at.state([action.changes(np.array(values)) for action, values in mechanical], wrench)

    @cached_property
    def compliance(self) -> Array:
        """True compliance (p, 6, 6) at M."""
        return self.elastic.compliance

    @cached_property
    def dead(self) -> Array:
        """True deviation (p, 6) of the unloaded tool."""
        elastic = self.elastic
        lost = sum((self._lost_motion(drive)[1] for drive in DRIVES), np.zeros_like(elastic.weight_twist))
        return self.gravity * elastic.weight_twist + elastic.payload_twist + elastic.offset_twist + lost

    def drive_forces(self, drive: str) -> tuple[Array, Array]:
        """Force of a drive under every reading's applied wrench (n,), and under the dead loads at every pose (p,)."""
        c = self.campaign
        per_wrench = self.elastic.drive_force(drive)[c.pose]
        applied = np.einsum("nj,nj->n", per_wrench, np.nan_to_num(c.wrench)) * self.force_scale
        return applied, self.elastic.dead_drive_force(drive, self.gravity)

    def by_drive(self, drive: str) -> Array:
        """Twist (p, 6) of the tool for a shift of one metre in a drive, along its axis."""
        return self.elastic.drive_force(drive)

    def _dead_zone(self, drive: str) -> tuple[Array, Array]:
        """Twist of the tool per metre of backlash: at every reading (n, 6), and unloaded at every pose (p, 6)."""
        slide = self.by_drive(drive)
        applied, dead = (_sign(force)[:, None] for force in self.drive_forces(drive))
        return applied * slide[self.campaign.pose], dead * slide

    def _lost_motion(self, drive: str) -> tuple[Array, Array]:
        """Twist of the tool by backlash, as `_dead_zone`."""
        half_width = self._first(f"backlash @ {drive}")
        if half_width == 0.0:
            return np.zeros((len(self.campaign), 6)), np.zeros((len(self.campaign.poses), 6))
        applied, dead = self._dead_zone(drive)
        return half_width * applied, half_width * dead

    @cached_property
    def instrument(self) -> Array:
        """Matrix (6, 6) from a true twist to what the instrument shows."""
        x, y, z = self._internal.get("instrument-misalignment @ instrument", np.zeros(3))
        turn = np.eye(3) + np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        return (1.0 + self._first("displacement-scale @ instrument")) * np.kron(np.eye(2), turn)

    @property
    def force_scale(self) -> float:
        """True wrench over stated wrench."""
        return 1.0 + self._first("force-scale @ instrument")

    @cached_property
    def twist(self) -> Array:
        """True twist (n, 6) behind every deflection and deviation."""
        c = self.campaign
        out = self.force_scale * np.einsum("nij,nj->ni", self.compliance[c.pose], np.nan_to_num(c.wrench))
        for drive in DRIVES:
            out = out + self._lost_motion(drive)[0]
        return np.where((c.kind == DEVIATION)[:, None], self.dead[c.pose], out)

    @cached_property
    def _shown_stiffness(self) -> Array:
        """Stiffness (p, 6, 6) as stated wrench over what the instrument shows."""
        return np.linalg.inv(self.instrument @ self.compliance) / self.force_scale

    @cached_property
    def plain(self) -> Array:
        """What every reading (n,) would be by the robot, its loads and its instrument."""
        c = self.campaign
        return np.where(c.kind == STIFFNESS, self._entries(self._shown_stiffness), self._read(self.twist))

    @property
    def values(self) -> Array:
        """What every reading (n,) would be, with nuisance patterns and the weight's share of the stiffness."""
        return self._values

    @cached_property
    def _values(self) -> Array:
        out = self.plain
        if "gravity @ robot" in self._internal:
            out = out + np.where(self.campaign.kind == STIFFNESS, self._weight(), 0.0)
        for candidate, values in self.parameters:
            if isinstance(candidate.action, Pattern):
                out = out + candidate.action.columns(self) @ np.array(values)
        return out

    def _read(self, twist: Array, through: Array | None = None) -> Array:
        """What the instrument shows (n,) of twists (n, 6), each in its reading's direction."""
        shown = twist @ (self.instrument if through is None else through).T
        return np.take_along_axis(shown, self.campaign.direction[:, None], axis=1)[:, 0]

    def _entries(self, matrices: Array) -> Array:
        """Diagonal entry (n,) of matrices (p, 6, 6) that each reading looks at."""
        c = self.campaign
        return matrices[c.pose, c.direction, c.direction]

    def change(self, twist: Array | None = None, dead: Array | None = None, compliance: Array | None = None) -> Array:
        """Change (n,) of readings by small changes of true twists (n, 6), of dead ones (p, 6), of C (p, 6, 6)."""
        c = self.campaign
        twist = np.zeros((len(c), 6)) if twist is None else twist
        still = np.zeros((len(c.poses), 6)) if dead is None else dead
        out = self._read(np.where((c.kind == DEVIATION)[:, None], still[c.pose], twist))
        if not (c.kind == STIFFNESS).any():
            return out
        stiff = np.zeros(len(c))
        if compliance is not None:
            shown = self._shown_stiffness
            stiff = self._entries(-shown @ (self.instrument @ compliance * self.force_scale) @ shown)
        return np.where(c.kind == STIFFNESS, stiff, out)

    def columns(self, candidate: Candidate) -> Array:
        """Derivatives (n, k) of every reading by a candidate's internal parameters."""
        match candidate.action:
            case MechanicalEffect() as action:
                here = self._internal.get(candidate.name, np.zeros(len(candidate.scale)))
                steps = _STEP * np.diag(candidate.scale)
                return np.stack([self._mechanical(action, here, step) for step in steps], axis=1)
            case Pattern() as pattern:
                return pattern.columns(self)
            case _:
                return self._columns_by_name(candidate)

    def _columns_by_name(self, candidate: Candidate) -> Array:
        """Derivatives of loads, of backlash, and of the instrument."""
        match candidate.effect:
            case "payload":
                return self._payload()[:, : len(candidate.scale)]
            case "backlash":
                return self.change(*self._dead_zone(candidate.place))[:, None]
            case "displacement-scale":
                return self._scaled([1.0, 1.0, -1.0]) / self.instrument[0, 0]
            case "force-scale":
                return self._scaled([1.0, 0.0, -1.0]) / self.force_scale
            case "instrument-misalignment":
                return self._misalignment()
            case _:
                return np.zeros((len(self.campaign), 0))

    def step(self, candidate: Candidate) -> Array:
        """Change (n,) of the readings when the robot's own weight acts: the one effect without parameters."""
        if candidate.effect != "gravity":
            return np.zeros(len(self.campaign))
        return self._weight()

    def _weight(self) -> Array:
        out = self.change(dead=self.at.robot.acceleration * self.elastic.weight_twist)
        stiff = self.campaign.kind == STIFFNESS
        return np.where(stiff, self._entries(self.at.weight_stiffness), out) if stiff.any() else out

    def _mechanical(self, effect: MechanicalEffect, here: Array, step: Array) -> Array:
        """Derivative (n,) along a step of internal parameters, by the wrenches that the changed elements carry."""
        c, elastic = self.campaign, self.elastic
        dead, compliance = np.zeros((len(c.poses), 6)), np.zeros((len(c.poses), 6, 6))
        for name, slope in _slopes(effect.changes(here + step), effect.changes(here - step), 2.0 * step.sum()).items():
            at = elastic.transmitted(name)
            if slope.compliance is not None:
                carried = np.swapaxes(at, -1, -2) @ slope.compliance
                compliance += carried @ at
                dead += np.einsum("pij,pj->pi", carried, elastic.dead_wrench(name, self.gravity))
            if slope.offset is not None:
                dead += np.einsum("pji,j->pi", at, slope.offset)
        wrench = np.nan_to_num(c.wrench) * self.force_scale
        return self.change(np.einsum("nij,nj->ni", compliance[c.pose], wrench), dead, compliance)

    def _payload(self) -> Array:
        yields = self.compliance - self.elastic.tool_compliance
        wrenches = self.at.robot.acceleration * _PAYLOAD
        return np.stack([self.change(dead=yields @ wrench) for wrench in wrenches], axis=1)

    def _scaled(self, signs: list[float]) -> Array:
        """Readings (n, 1) times a sign for deflection, deviation, stiffness."""
        return (np.array(signs)[self.campaign.kind] * self.plain)[:, None]

    def _misalignment(self) -> Array:
        scale = float(np.cbrt(np.linalg.det(self.instrument[:3, :3])))
        columns: list[Array] = []
        for axis in np.eye(3):
            turn = scale * np.kron(np.eye(2), np.cross(axis, np.eye(3)).T)
            stiff = self._entries(-self._shown_stiffness @ turn @ np.linalg.inv(self.instrument))
            columns.append(np.where(self.campaign.kind == STIFFNESS, stiff, self._read(self.twist, turn)))
        return np.stack(columns, axis=1)

    def applied_twist(self, wrenches: Array) -> Array:
        """Deflection (n,) in each reading's direction under wrenches (n, 6) at M; zero for other kinds of reading."""
        c = self.campaign
        twist = np.einsum("nij,nj->ni", self.compliance[c.pose], wrenches)
        return np.where(c.kind == DEFLECTION, twist[np.arange(len(c)), c.direction], 0.0)


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
