"""Readings of a machine from EXUDYN's equilibria, for the blind check."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.lab.exudyn_machine import FaultyRobot, are_smooth
from stiffscope.lab.machine import TOOL
from stiffscope.lab.measuring import (
    find_stiffness,
    make_mixing,
    read_channel,
    true_wrench,
)
from stiffscope.lab.nonlinear import settle
from stiffscope.lab.response import tool_spot

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stiffscope.lab.closure import Located
    from stiffscope.lab.machine import Machine, Slot
    from stiffscope.lab.measuring import Plan, Sensor
    from stiffscope.lab.rotations import Array

    Loads = Sequence[tuple[str, Array]]

_HELD = 1e-2  # of a load: force up to which a drive stays in the middle of its gap
_IDLE = 1e-4  # the same of the robot's weight, which finite displacements turn a little
_STEP = 1e-7  # m or rad: lost motion by which the slots' coupling is found
_UNIT = np.array([10.0, 10.0, 10.0, 1.0, 1.0, 1.0])  # N and N·m: of stiffnesses at M
_NOTHING = (("", np.zeros(6)),)


class ExudynBench:
    """A machine at the poses of a plan, read from equilibria in EXUDYN.

    Parameters
    ----------
    machine
        The machine with its faults.
    plan
        Poses, loads and instruments.
    located
        The sound machine's configuration at the poses.
    channels
        Sensors to read.
    """

    def __init__(
        self,
        machine: Machine,
        plan: Plan,
        located: Located,
        channels: tuple[Sensor, ...],
    ) -> None:
        self.machine = machine
        self.plan = plan
        self.channels = channels
        self.points = [(node, s.at) for s in channels for node in (s.node, s.against)]
        self.robots = [
            FaultyRobot(machine, located, k) for k in range(len(located.closed))
        ]
        hooks = {"": tool_spot(machine), **plan.hooks}
        self.hooks = {
            name: [robot.add_hook(hook.node, hook.at) for robot in self.robots]
            for name, hook in hooks.items()
        }
        self.slots = () if are_smooth(machine.slots) else machine.slots
        self.couplings = [self._couple(robot) for robot in self.robots]

    def deflect(self, loads: Loads) -> Array:
        """Return deflections (p, m, c): loaded less unloaded.

        What plays or rubs starts in the middle of its gap, relaxed: it answers to the load alone.
        """
        true = self._true(loads)
        slots = self.slots
        moved = self._positions(true, 1.0, slots, gaps=False)
        moved = moved - self._positions(_NOTHING, 1.0, slots, gaps=False)
        if any(slot.law in {"play", "friction"} for slot in slots):
            open_gaps = self._positions(true, 0.0, slots)
            moved = moved + open_gaps - self._positions(true, 0.0, slots, gaps=False)
        return self._read(moved)

    def displace(self, loads: Loads) -> Array:
        """Return displacements (p, m, c) under loads and weight from where it is commanded."""
        # friction holds no weight of a robot at rest
        slots = [
            replace(slot, size=0.0) if slot.law == "friction" else slot
            for slot in self.slots
        ]
        moved = self._positions(self._true(loads), 1.0, slots)
        if not self.plan.sensors:
            moved = moved + self._misplaced_tool()
        return self._read(moved)

    def stiffness(self) -> Array:
        """Return stiffness diagonals or pushes (p, 6) at M."""
        loads = [("", sign * unit) for sign in (1, -1) for unit in np.diag(_UNIT)]
        seen = self._read(self._positions(loads, 0.0)).swapaxes(1, 2)
        unit = 0.5 * (seen[..., :6] - seen[..., 6:]) / _UNIT
        return find_stiffness(self.machine, self.plan, unit)

    def _weight(self) -> float:
        """Return the weight of all bodies, N."""
        mass = sum(body.mass for body in self.machine.bodies.values())
        return mass * float(np.linalg.norm(self.machine.gravity))

    def _true(self, loads: Loads) -> list[tuple[str, Array]]:
        instrument = self.machine.instrument
        return [(name, true_wrench(instrument, wrench)) for name, wrench in loads]

    def _misplaced_tool(self) -> Array:
        """Return what the tool's wrong place adds (p, 1, 2c, 6) to the readings at M."""
        out = np.zeros((len(self.robots), 1, len(self.points), 6))
        for k, robot in enumerate(self.robots):
            turned = robot.turn(TOOL)
            out[k, :, ::2] = (self.machine.shift.reshape(2, 3) @ turned.T).ravel()
        return out

    def _read(self, moved: Array) -> Array:
        """Return what the channels show (p, m, c) of points' displacements (p, m, 2c, 6)."""
        instrument = self.machine.instrument
        relative = moved[..., ::2, :] - moved[..., 1::2, :]
        shown = [
            read_channel(instrument, s, relative[..., k, :].swapaxes(1, 2))
            for k, s in enumerate(self.channels)
        ]
        return np.stack(shown, axis=-1) @ make_mixing(instrument, self.channels).T

    def _couple(self, robot: FaultyRobot) -> Array:
        """Return the force (s, s) in every slot for unit lost motion in each."""
        count = len(self.slots)
        out = np.zeros((count, count))
        if not count:
            return out
        robot.set_gravity(0.0)
        for k, step in enumerate(_STEP * np.eye(count)):
            for sign in (1.0, -1.0):
                robot.move_rests(sign * step)
                robot.settled(())
                out[:, k] += sign * robot.slot_forces() / (2.0 * _STEP)
        robot.move_rests(np.zeros(count))
        return out

    def _positions(
        self,
        loads: Loads,
        weight: float,
        slots: Sequence[Slot] = (),
        *,
        gaps: bool = True,
    ) -> Array:
        """Return displacements (p, m, s, 6) from the pose under loads and a share of weights.

        slots: laws that are obeyed; with or without gaps: play and friction.
        """
        out = []
        for k, robot in enumerate(self.robots):
            robot.set_gravity(weight)
            unit = np.repeat([1.0, robot.model["length"]], 3)
            row = []
            for name, wrench in loads:
                held = _IDLE * self._weight()
                if weight == 0.0:
                    held = _HELD * float(np.abs(wrench / unit).max())
                self._load(robot, k, name, wrench)
                row.append(self._settle(robot, k, slots, held, gaps=gaps))
                self._load(robot, k, name, np.zeros(6))
            out.append(row)
        return np.array(out)

    def _settle(
        self,
        robot: FaultyRobot,
        k: int,
        slots: Sequence[Slot],
        held: float,
        *,
        gaps: bool,
    ) -> Array:
        """Return the displacements (s, 6) of the points, with the slots' laws obeyed.

        held: force (N) up to which a drive stays in the middle of its gap.
        """
        moved = robot.settled(self.points)
        if not slots:
            return moved
        lever = [1.0 if s.direction < 3 else robot.model["length"] for s in slots]
        force = robot.slot_forces()
        force = np.where(np.abs(force) > held * np.array(lever), force, 0.0)
        lost = settle(slots, self.couplings[k][None], force[None], gaps=gaps)[0]
        robot.move_rests(lost)
        moved = robot.settled(self.points)
        robot.move_rests(np.zeros(len(slots)))
        return moved

    def _load(self, robot: FaultyRobot, k: int, name: str, wrench: Array) -> None:
        force, torque = self.hooks[name][k]
        robot.mbs.SetLoadParameter(force, "loadVector", wrench[:3])
        robot.mbs.SetLoadParameter(torque, "loadVector", wrench[3:])
