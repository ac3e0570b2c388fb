"""Machine with its faults at commanded poses: unloaded configuration and linear response."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.errors import InputError
from stiffscope.gap.lab.closure import Frames, joint_state, locate, spring_state
from stiffscope.gap.lab.machine import BASE, GROUND, TOOL
from stiffscope.gap.lab.rotations import both_parts, lever, transform_to, turn, vector_of
from stiffscope.gap.lab.structure import Element, Structure

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stiffscope.gap.lab.closure import Located
    from stiffscope.gap.lab.machine import Body, Machine
    from stiffscope.gap.lab.rotations import Array

CABLE = "<cable>"
_SETTLED = 1e-13  # m
_ITERATIONS = 30


@dataclass(frozen=True)
class Spot:
    """A point (3,) fixed to a node, home coordinates."""

    node: str
    at: Array


@dataclass(frozen=True)
class Response:
    """Linear response at n poses. Twists are about the origin; `find_twists` moves them to a spot.

    Cases: six unit wrenches at each spot, permanent loads, and unit lost motion in each slot.
    """

    nominal: Frames
    """Frames of the nodes as assumed by the controller."""
    true: Frames
    """True frames of the nodes without weights."""
    spots: tuple[Spot, ...]
    twists: dict[str, Array]
    """Twists (n, 6, cases) of every node."""
    force: Array
    """Force (n, slots, cases) in every slot."""
    structure: Structure
    solution: Array

    @property
    def dead(self) -> int:
        """Index of the case of permanent loads."""
        return 6 * len(self.spots)

    def wrench(self, name: str) -> Array:
        """Return the wrench (n, 6, cases) in an element, in its own axes."""
        return self.structure.wrench(self.solution, name)

    def find_twists(self, spot: Spot) -> Array:
        """Return the twists (n, 6, cases) of a spot."""
        return lever(self.true.point(spot.node, spot.at)) @ self.twists[spot.node]

    def shift(self, spot: Spot) -> Array:
        """Return the twist (n, 6) of a spot from its assumed to its true pose without weights."""
        moved = self.true.point(spot.node, spot.at) - self.nominal.point(spot.node, spot.at)
        turned = self.true.rotation[spot.node] @ np.swapaxes(self.nominal.rotation[spot.node], -1, -2)
        return np.concatenate([moved, vector_of(turned)], axis=1)


def tool_spot(machine: Machine) -> Spot:
    """Return M."""
    return Spot(TOOL, machine.at)


def respond(machine: Machine, poses: Array | Located, spots: Sequence[Spot]) -> Response:
    """Return the linear response of the machine to wrenches at spots in its true configuration.

    Parameters
    ----------
    machine
        The machine with its faults.
    poses
        Commanded poses (n, k), m and rad, or the sound machine's configuration there.
    spots
        Points where wrenches act.

    Raises
    ------
    InputError
        For an unreachable pose, or one where the machine moves freely.

    """
    located = locate(machine, poses) if isinstance(poses, np.ndarray) else poses
    if not located.closed.all():
        raise InputError("pose: expected poses that the machine reaches with its drives within their ranges")
    nodes = [BASE, *(node for body in machine.bodies.values() for node in body.nodes), TOOL]
    index = {name: k for k, name in enumerate(nodes)} | {GROUND: -1}
    nominal = _frames_of_nodes(machine, located.frames)
    true, structure = _find_equilibrium(machine, located, nominal, index)
    right = [
        structure.load(index[spot.node], true.point(spot.node, spot.at), unit) for spot in spots for unit in np.eye(6)
    ]
    right.append(_apply_weights(machine, structure, true, index))
    right += [structure.rest(slot.element, np.eye(6)[slot.direction]) for slot in machine.slots]
    solution = structure.solve(np.stack(right, axis=2))
    slots = [structure.wrench(solution, slot.element)[:, slot.direction] for slot in machine.slots]
    empty = np.zeros((len(located.closed), 0, solution.shape[2]))
    twists = {name: structure.twist(solution, k) for name, k in index.items()}
    force = np.stack(slots, axis=1) if slots else empty
    return Response(nominal, true, tuple(spots), twists, force, structure, solution)


def _frames_of_nodes(machine: Machine, bodies: Frames) -> Frames:
    carriers = {node: body.name for body in machine.bodies.values() for node in body.nodes}
    carriers |= {BASE: GROUND, GROUND: GROUND, TOOL: carriers[machine.tool]}
    return Frames(
        {node: bodies.rotation[body] for node, body in carriers.items()},
        {node: bodies.position[body] for node, body in carriers.items()},
    )


def _find_equilibrium(
    machine: Machine, located: Located, nominal: Frames, index: dict[str, int]
) -> tuple[Frames, Structure]:
    """Return the frames of nodes in equilibrium with geometric errors, and the structure there."""
    frames = nominal
    structure = Structure(len(index) - 1, _elements(machine, located, frames, index))
    if not _is_distorted(machine):
        return frames, structure
    points = {TOOL: machine.at}  # points that do not move if a rod spins between two balls
    for body in machine.bodies.values():
        points |= dict(zip(body.nodes, body.places if len(body.nodes) > 1 else [body.centre], strict=True))
    for _ in range(_ITERATIONS):
        solution = structure.solve(structure.misfits()[..., None])
        steps = {name: structure.twist(solution, k)[..., 0] for name, k in index.items() if k >= 0}
        moved = [np.abs(lever(frames.point(name, at)) @ steps[name][..., None])[:, :3] for name, at in points.items()]
        frames = frames.move(steps)
        structure = Structure(len(index) - 1, _elements(machine, located, frames, index))
        if max(float(step.max()) for step in moved) < _SETTLED:
            return frames, structure
    raise InputError("pose: expected errors of the geometry with which the loops still close")


def _is_distorted(machine: Machine) -> bool:
    """Return whether its geometry deviates from the drawing."""
    return (
        any(body.offset.any() for body in machine.bodies.values())
        or any((joint.at_first != joint.at_second).any() for joint in machine.joints.values())
        or any(joint.astray.any() for joint in machine.joints.values())
        or any(joint.drive and (joint.drive.offset or joint.drive.pitch) for joint in machine.joints.values())
        or any(joint.spring for joint in machine.joints.values())
        or bool(machine.cable.any())
    )


def _elements(machine: Machine, located: Located, frames: Frames, index: dict[str, int]) -> list[Element]:
    n = len(located.closed)
    everything = np.broadcast_to(np.eye(6), (n, 6, 6))
    world, origin = np.eye(3), np.zeros(3)
    misfit = _offset_between(frames, GROUND, BASE, origin, world)
    out = [Element(BASE, -1, (index[BASE],), everything, everything, machine.base, misfit)]
    for joint in (drawn.real_joint for drawn in machine.joints.values()):
        first, second = (BASE if node == GROUND else node for node in (joint.first, joint.second))
        commanded: Array | float = 0.0
        if joint.drive is not None:
            commanded = located.drives[joint.name] * (1.0 + joint.drive.pitch) + joint.drive.offset
        state = joint_state(joint, frames, first, second, commanded)
        ends = index[first], (index[second],)
        out.append(Element(joint.name, *ends, state.carry, state.held, joint.compliance, state.misfit))
        if joint.spring:
            rows, away = spring_state(joint, frames, first, second)
            soft = np.eye(6) / joint.spring
            out.append(Element(f"{joint.name} spring", *ends, state.carry, rows, soft, away))
    for body in machine.bodies.values():
        if len(body.nodes) == 1:
            continue
        out.append(_element_of_body(body, frames, index))
    node, end = machine.tool, frames.point(TOOL, machine.at)
    axes = frames.rotation[node]
    carry, misfit = transform_to(axes, end), _offset_between(frames, node, TOOL, machine.at, world)
    out.append(Element(TOOL, index[node], (index[TOOL],), carry, everything, machine.platform, misfit))
    if machine.cable.any():
        held = np.flatnonzero(machine.cable)
        yields = np.zeros(6)
        yields[held] = 1.0 / machine.cable[held]
        misfit = np.zeros((n, 6))
        misfit[:, :3] = end - machine.at
        carry = transform_to(np.broadcast_to(np.eye(3), (n, 3, 3)), end)
        rows = np.broadcast_to(np.eye(6)[held], (n, len(held), 6))
        out.append(Element(CABLE, -1, (index[node],), carry, rows, np.diag(yields), misfit))
    return out


def _element_of_body(body: Body, frames: Frames, index: dict[str, int]) -> Element:
    """Return the element of an elastic body, with its other ends against the first."""
    first, *others = body.nodes
    axes = frames.rotation[first] @ body.axes
    carry: list[Array] = []
    misfits: list[Array] = []
    for node, at, offset in zip(others, body.places[1:], np.split(body.offset, len(others)), strict=True):
        misfit = _offset_between(frames, first, node, at, body.axes)
        misfit[:, :3] -= offset[:3]
        misfit[:, 3:] = vector_of(turn(-offset[3:]) @ turn(misfit[:, 3:]))
        carry.append(transform_to(axes, frames.point(node, at)))
        misfits.append(misfit)
    size = 6 * len(others)
    held = np.broadcast_to(np.eye(size), (len(axes), size, size))
    seconds, away = tuple(index[node] for node in others), np.concatenate(misfits, axis=1)
    return Element(body.name, index[first], seconds, np.concatenate(carry, axis=1), held, body.compliance, away)


def _offset_between(frames: Frames, first: str, second: str, at: Array, axes: Array) -> Array:
    """Return the offset (n, 6) of a point (3,) between two nodes, in axes (3, 3) of the first."""
    back = np.swapaxes(frames.rotation[first] @ axes, -1, -2)
    moved = frames.point(second, at) - frames.point(first, at)
    return np.concatenate([(back @ moved[..., None])[..., 0], vector_of(back @ frames.rotation[second] @ axes)], axis=1)


def _apply_weights(machine: Machine, structure: Structure, true: Frames, index: dict[str, int]) -> Array:
    """Return the right-hand side (n, size) of weights; elastic bodies' act at their ends."""
    out = np.zeros(structure.size)
    for body in machine.bodies.values() if machine.weighted else ():
        if len(body.nodes) == 1:
            out += _hang(structure, true, index, body.name, body.centre, body.mass * machine.gravity)
            continue
        for node, at, end in zip(body.nodes, body.places, body.ends, strict=True):
            axes = true.rotation[node] @ body.axes
            wrench = both_parts(axes) @ end @ np.swapaxes(axes, -1, -2) @ machine.gravity
            out += structure.load(index[node], true.point(node, at), wrench)
    for payload in machine.payloads:
        out += _hang(structure, true, index, payload.node, payload.centre, payload.mass * machine.gravity)
    return out


def _hang(structure: Structure, true: Frames, index: dict[str, int], node: str, at: Array, force: Array) -> Array:
    return structure.load(index[node], true.point(node, at), np.concatenate([force, np.zeros(3)]))


def stiffness(machine: Machine, poses: Array) -> Array:
    """Return the Cartesian stiffness (n, 6, 6) at M, base axes, without loads or instrument."""
    tool = tool_spot(machine)
    return np.asarray(np.linalg.inv(respond(machine, poses, [tool]).find_twists(tool)[:, :, :6]), dtype=np.float64)


def sag(machine: Machine, poses: Array) -> Array:
    """Return the twist (n, 6) of M under the weights."""
    tool = tool_spot(machine)
    response = respond(machine, poses, [tool])
    return response.find_twists(tool)[:, :, response.dead]
