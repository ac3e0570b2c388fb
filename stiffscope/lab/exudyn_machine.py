# pyright: reportMissingImports=false, reportArgumentType=false
# (EXUDYN is an extra, and its stubs are incomplete)
"""A second laboratory: the machine with its faults in EXUDYN, read from EXUDYN's own equilibria.

Faults are planted in bodies, springs and joints of a multibody model; each reading is the
difference of two equilibria under finite displacements, with laws of play, friction and hardening
in the springs. Of our own laboratory it shares what is drawn: faults, poses as commanded, the
instrument and its noise.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.errors import InputError
from stiffscope.lab.closure import spring_state
from stiffscope.lab.machine import (
    BASE,
    DRIVEN,
    FREE,
    GROUND,
    TOOL,
    NoEquilibriumError,
)
from stiffscope.lab.nonlinear import lost_motion
from stiffscope.lab.rotations import both_parts, turn, vector_of

try:
    import exudyn
    from exudyn import itemInterface as items  # noqa: N813 (a module)

    from stiffscope.exports.exudyn_robot import Robot
except ImportError as error:
    raise InputError(
        "--machine exudyn: expected the package exudyn; `pip install exudyn`"
    ) from error

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from stiffscope.lab.closure import Located
    from stiffscope.lab.machine import Body, Joint, Machine, Slot
    from stiffscope.lab.rotations import Array

_RIGID = 1e4  # of the stiffest spring: a rigid direction with play, or that mixes axes
_FAR = 0.1  # m or rad: no deflection
_IDLE = 1.0  # N·m/rad, on motions that nothing resists
_FORCES = (
    1e-6,
    1e7,
    5000,
)  # N or N·m: least and greatest of a law's table, and their number
_NEARLY_NONE = 1e-9
SMOOTH = ("hardening", "stiffening")
"""Laws without a corner. On others Newton's method does not converge: the rest of their spring is
moved to where the equilibrium obeys them."""


def are_smooth(slots: Sequence[Slot]) -> bool:
    """Return whether Newton's method converges on all laws."""
    return all(slot.law in SMOOTH for slot in slots)


class FaultyRobot(Robot):
    """A machine of the laboratory in EXUDYN at one pose, as commanded, with its faults.

    Parameters
    ----------
    machine
        The machine with its faults.
    located
        The sound machine's configuration at the poses.
    k
        Index of the pose.
    """

    def __init__(self, machine: Machine, located: Located, k: int) -> None:
        self.machine = machine
        self.located = located.some([k])
        super().__init__(_tabulate(machine, self.located), "pose")

    def add_joint(self, name: str, joint: Any) -> None:
        """Add a joint with its actual axis, points, bearing and drive."""
        if isinstance(joint, dict):  # a mount
            super().add_joint(name, joint)
            return
        frames = self.located.frames
        ends = [self.machine.carrier(n) for n in (joint.first, joint.second)]
        first, second = (
            BASE if n == GROUND else n for n in (joint.first, joint.second)
        )
        turns = [frames.rotation[end][0] for end in ends]
        real = joint.real_joint
        relative = (turns[0] @ joint.axes).T @ turns[1] @ joint.axes
        slid = np.zeros(3)
        free = [i for i in FREE[joint.kind] if i < 3]
        slid[free] = _apart(joint, frames, ends)[free]
        if joint.drive is not None:
            drive = joint.drive
            commanded = (
                self.located.drives[name][0] * (1.0 + drive.pitch) + drive.offset
            )
            if joint.kind == "revolute":
                relative = turn(np.array([commanded, 0.0, 0.0]))
            else:
                slid[0] = commanded
        axes = turns[0] @ real.axes
        place = frames.point(ends[0], real.at_first)[0]
        there = frames.point(ends[1], real.at_second)[0]
        # the spring acts where its bearing is: the other body's point has slid there
        if joint.slides_in_first:
            there = there - axes @ slid
        else:
            place = place + axes @ slid
        start = (first, place, axes)
        end = (second, there, turns[1] @ real.axes @ relative.T)
        slots = [slot for slot in self.machine.slots if slot.element == name]
        self.connect(name, start, end, *self._yielding(joint, axes, turns[1], slots))
        for slot in slots:
            self.add_slot(slot, joint, start, end)
        if joint.spring:
            self.add_joint_spring(joint, ends, start, end)

    def _yielding(
        self, joint: Joint, axes: Array, turned: Array, slots: Sequence[Slot]
    ) -> tuple[Array, Array]:
        """Return a joint's compliance and its free motions, with those of its slots."""
        compliance = joint.compliance
        driven = DRIVEN.get(joint.kind) if joint.drive is not None else None
        motions = [np.eye(6)[i] for i in FREE[joint.kind] if i != driven]
        if joint.kind == "universal":
            motions[1] = np.concatenate([np.zeros(3), axes.T @ turned @ joint.axis2])
        for slot in slots:
            motions.append(np.eye(6)[slot.direction])
            compliance = compliance.copy()
            compliance[slot.direction] = compliance[:, slot.direction] = 0.0
        return compliance, np.array(motions).T.reshape(6, -1)

    def add_slot(self, slot: Slot, joint: Joint, start: Any, end: Any) -> None:
        """Add the spring of one direction: with its law, or with a rest that play moves."""
        i = slot.direction
        name = f"{slot.element} slot {i}"
        if name in self.springs:
            return
        rigid = self.model["rigid"]
        soft = max(float(joint.compliance[i, i]), 1.0 / rigid)
        if not are_smooth(self.machine.slots):
            stiffness = np.zeros((6, 6))
            stiffness[i, i] = 1.0 / soft
            self.stiffest = max(self.stiffest, 1.0 / soft)
            self.add_spring(name, start, end, stiffness=stiffness)
        else:
            same = [s for s in self.machine.slots if s.element == slot.element]
            same = [s for s in same if s.direction == i]
            law = partial(_force, *_tabulate_law(same, soft))
            self.add_curve(name, start, end, i, law, 1.0 / soft)

    def slot_forces(self) -> Array:
        """Return the force (s,) in every slot at the last equilibrium."""
        kinds = (
            exudyn.OutputVariableType.ForceLocal,
            exudyn.OutputVariableType.TorqueLocal,
        )
        out = []
        for slot in self.machine.slots:
            number = self.springs[f"{slot.element} slot {slot.direction}"]
            parts = [self.mbs.GetObjectOutput(number, kind) for kind in kinds]
            out.append(np.concatenate(parts)[slot.direction])
        return np.array(out)

    def move_rests(self, lost: Array) -> None:
        """Move the rest of each slot's spring by its lost motion (s,)."""
        rests: dict[str, Array] = {}
        for slot, size in zip(self.machine.slots, lost, strict=True):
            rest = rests.setdefault(
                f"{slot.element} slot {slot.direction}", np.zeros(6)
            )
            rest[slot.direction] += size
        for name, rest in rests.items():
            self.mbs.SetObjectParameter(self.springs[name], "offset", rest)

    def add_joint_spring(
        self, joint: Joint, ends: Sequence[str], start: Any, end: Any
    ) -> None:
        """Add the springs of a passive joint's free motions."""
        frames = self.located.frames
        rows, away = spring_state(joint.drawn_joint, frames, ends[0], ends[1])
        stiffness = joint.spring * rows[0].T @ rows[0]
        name = f"{joint.name} spring"
        self.add_spring(name, start, end, stiffness=stiffness, offset=-away[0])

    def add_tool(self) -> None:
        """Mark M, and add the weights of elastic bodies, payloads and the cable chain."""
        super().add_tool()
        machine = self.machine
        frames = self.located.frames
        for node, at, wrench in self._weights():
            place = frames.point(machine.carrier(node), at)[0]
            marker = self.marker(node, place, np.eye(3))
            for kind, part in (
                (items.LoadForceVector, wrench[:3]),
                (items.LoadTorqueVector, wrench[3:]),
            ):
                number = self.mbs.AddLoad(kind(markerNumber=marker, loadVector=part))
                self.dead.append((number, part))
        if machine.cable.any():
            tool = self.tool
            start = ("ground", tool, np.eye(3))
            stiffness = np.diag(np.concatenate([machine.cable, np.zeros(3)]))
            slack = np.concatenate([machine.at - tool, np.zeros(3)])
            end = (machine.tool, tool, np.eye(3))
            self.add_spring("cable", start, end, stiffness=stiffness, offset=slack)

    def _weights(self) -> list[tuple[str, Array, Array]]:
        """Return node, home point and wrench of each weight that no rigid body has."""
        self.dead: list[tuple[Any, Array]] = []
        machine = self.machine
        out = [
            (load.node, load.centre, load.wrench(machine.gravity))
            for load in machine.payloads
        ]
        for body in machine.bodies.values():
            if len(body.nodes) == 1 or not machine.weighted:
                continue
            axes = self.located.frames.rotation[body.name][0] @ body.axes
            for node, at, end in zip(body.nodes, body.places, body.ends, strict=True):
                out.append(
                    (node, at, both_parts(axes) @ end @ axes.T @ machine.gravity)
                )
        return out

    def set_gravity(self, share: float) -> None:
        """Let a share of all weights act."""
        super().set_gravity(share)
        for number, wrench in self.dead:
            self.mbs.SetLoadParameter(number, "loadVector", share * wrench)

    def settled(self, sensors: Sequence[tuple[str, Array]]) -> Array:
        """Return the displacements (s, 6), from the pose, of points of nodes in equilibrium."""
        initial = exudyn.ConfigurationType.Initial
        start = self.mbs.systemData.GetODE2Coordinates(initial)
        try:
            self.solve()
        except exudyn.SolverError as error:
            raise NoEquilibriumError(
                "pose: expected an equilibrium in EXUDYN, got none"
            ) from error
        moved = [self.displacement(node, at) for node, at in sensors]
        out = np.array(moved).reshape(-1, 6)
        self.mbs.systemData.SetODE2Coordinates(start, initial)
        if np.abs(out).max(initial=0.0) > _FAR:
            raise NoEquilibriumError(
                "pose: expected small displacements in EXUDYN, got large ones"
            )
        return out

    def displacement(self, node: str, home: Array) -> Array:
        """Return the displacement (6,) of a node's home point from the pose."""
        if node in {GROUND, "ground"}:
            return np.zeros(6)
        carrier = self.carriers[node]
        frames = self.located.frames
        place = home if carrier == BASE else frames.point(self._frame(node), home)[0]
        kind = exudyn.OutputVariableType
        number = self.nodes[node]
        moved = self.mbs.GetNodeOutput(number, kind.Displacement)
        turned = np.reshape(self.mbs.GetNodeOutput(number, kind.RotationMatrix), (3, 3))
        arm = place - self.places[node]
        return np.concatenate([moved + turned @ arm - arm, vector_of(turned)])

    def _frame(self, node: str) -> str:
        return self.machine.carrier(self.machine.tool if node == TOOL else node)

    def add_hook(self, node: str, at: Array) -> tuple[Any, Any]:
        """Add a load of zero at a node's home point; return the numbers of force and moment."""
        place = self.located.frames.point(self._frame(node), at)[0]
        marker = self.marker(node, place, np.eye(3))
        numbers = [
            self.mbs.AddLoad(kind(markerNumber=marker, loadVector=np.zeros(3)))
            for kind in (items.LoadForceVector, items.LoadTorqueVector)
        ]
        self.mbs.Assemble()
        return numbers[0], numbers[1]


def _apart(joint: Joint, frames: Any, ends: Sequence[str]) -> Array:
    """Return how far (3,) a drawn joint's second point is from its first, in its axes."""
    axes = frames.rotation[ends[0]][0] @ joint.axes
    drawn = [frames.point(end, joint.at)[0] for end in ends]
    return axes.T @ (drawn[1] - drawn[0])


def _tabulate_law(slots: Sequence[Slot], compliance: float) -> tuple[Array, Array]:
    """Return deflections and forces (n,) of a spring with the lost motion of its slots.

    Between them the law is straight, to 1e-5 of a force.
    """
    forces = np.geomspace(*_FORCES)
    way = np.concatenate([-forces[::-1], [-_NEARLY_NONE, 0.0, _NEARLY_NONE], forces])
    moved = compliance * way
    for slot in slots:
        moved = moved + lost_motion(slot, way)[0]
    return moved, way


def _force(moved: Array, forces: Array, deflection: float) -> float:
    """Return the force at a deflection."""
    return float(np.interp(deflection, moved, forces))


def _tabulate(machine: Machine, located: Located) -> dict[str, Any]:
    """Return the tables of `Robot`: bodies, joints and mounts."""
    frames = located.frames
    home = {"turned": np.zeros(3), "moved": np.zeros(3)}
    placed = {
        name: {
            "turned": _whole_vector(frames.rotation[name][0]),
            "moved": frames.position[name][0],
        }
        for name in machine.bodies
    }
    placed[BASE] = home
    placed[TOOL] = placed[machine.carrier(machine.tool)]
    rigid = {BASE: _rigid(0.0, np.zeros(3)), TOOL: _rigid(0.0, machine.at)}
    elastic = {}
    offsets = {}
    for name, body in machine.bodies.items():
        if len(body.nodes) == 1:
            mass = body.mass if machine.weighted else 0.0
            rigid[name] = _rigid(mass, body.centre)
            continue
        elastic[name] = _elastic(body)
        parts = body.offset.reshape(-1, 6)
        if len(parts) == 1:
            offsets[name] = parts[0]
        else:
            offsets.update(zip(body.nodes[1:], parts, strict=True))
    joints: dict[str, Any] = {"<base> mount": _mount("ground", BASE, machine.base)}
    joints.update(machine.joints)
    joints["<tool> mount"] = _mount(machine.tool, TOOL, machine.platform, machine.at)
    stiffest = max(
        (joint.drive.stiffness for joint in machine.joints.values() if joint.drive),
        default=1e8,
    )
    points = np.array([joint.at for joint in machine.joints.values()])
    return {
        "gravity": machine.gravity,
        "tool": {"body": TOOL, "at": machine.at},
        "length": float(np.ptp(points, axis=0).max()) or 1.0,
        "rigid": _RIGID * max(stiffest, 1e6),
        "idle": _IDLE,
        "poses": {
            "pose": {
                "frames": placed,
                "offsets": offsets,
                "idle": _idle(machine, located),
            }
        },
        "rigid_bodies": rigid,
        "elastic_bodies": elastic,
        "joints": joints,
    }


def _whole_vector(rotation: Array) -> Array:
    """Return the rotation vector (3,) of any rotation."""
    return vector_of(rotation[None])[0]


def _rigid(mass: float, centre: Array) -> dict[str, Any]:
    return {"mass": mass, "centre": centre, "inertia": np.zeros((3, 3))}


def _elastic(body: Body) -> dict[str, Any]:
    ends = (node.removeprefix(f"{body.name}.") for node in body.nodes)
    return {
        "ends": dict(zip(ends, body.places, strict=True)),
        "axes": body.axes,
        "compliance": body.compliance,
        "mass": 0.0,
        "condensed_mass": None,
        "mode_squares": [],
    }


def _mount(
    first: str, second: str, compliance: Array, at: Array | None = None
) -> dict[str, Any]:
    return {
        "kind": "fixed",
        "free": [],
        "driven": None,
        "between": [first, second],
        "at": np.zeros(3) if at is None else at,
        "bearer": second,
        "axes": np.eye(3),
        "compliance": compliance,
        "drive": None,
        "spring": None,
        "law": None,
    }


def _idle(machine: Machine, located: Located) -> Mapping[str, Array]:
    """Return, by joint, the axes of bodies between two balls, about which they spin."""
    out = {}
    joints = list(machine.joints.values())
    for name in machine.bodies:
        held = [j for j in joints if name in map(machine.carrier, (j.first, j.second))]
        balls = [j for j in held if j.kind == "spherical" and not j.spring]
        if len(held) == len(balls) == 2:
            ends = [located.frames.point(name, joint.at)[0] for joint in balls]
            axis = ends[1] - ends[0]
            out[balls[0].name] = axis / np.linalg.norm(axis)
    return out
