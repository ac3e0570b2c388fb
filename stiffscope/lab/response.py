"""Machine with its faults at commanded poses: unloaded configuration and linear response."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.errors import InputError
from stiffscope.lab.closure import Frames, joint_state, locate, spring_state
from stiffscope.lab.machine import BASE, GROUND, TOOL
from stiffscope.lab.rotations import (
    both_parts,
    lever,
    transform_to,
    turn,
    vector_of,
)
from stiffscope.lab.structure import Element, Structure

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from stiffscope.lab.closure import Located
    from stiffscope.lab.machine import Body, Machine
    from stiffscope.lab.rotations import Array

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

    def shift(self, spot: Spot, carrier: str = "") -> Array:
        """Return the twist (n, 6) of a spot from its assumed to its true pose without weights.

        It is that of a carrier where the spot is assumed, or of its own node.
        """
        node = carrier or spot.node
        place = self.nominal.point(spot.node, spot.at)
        turned = self.true.rotation[node] @ np.swapaxes(
            self.nominal.rotation[node], -1, -2
        )
        arm = (turned @ (place - self.nominal.position[node])[..., None])[..., 0]
        return np.concatenate(
            [arm + self.true.position[node] - place, vector_of(turned)], axis=1
        )


def tool_spot(machine: Machine) -> Spot:
    """Return the tool point, where it really is."""
    return Spot(TOOL, machine.at + machine.shift[:3])


def respond(
    machine: Machine, poses: Array | Located, spots: Sequence[Spot]
) -> Response:
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
        raise InputError(
            "pose: expected poses that the machine reaches with its drives within their ranges",
        )
    nominal, index = place_nodes(machine, located)
    true, structure = _find_equilibrium(machine, located, nominal, index)

    def load(node: str, at: Array, wrench: Array) -> Array:
        return structure.load(index[node], true.point(node, at), wrench)

    right = [load(spot.node, spot.at, unit) for spot in spots for unit in np.eye(6)]
    weights = [load(*each) for each in _find_weights(machine, true)]
    right.append(sum(weights, np.zeros(structure.size)))
    right += [
        structure.rest(slot.element, np.eye(6)[slot.direction])
        for slot in machine.slots
    ]
    solution = structure.solve(np.stack(right, axis=2))
    slots = [
        structure.wrench(solution, slot.element)[:, slot.direction]
        for slot in machine.slots
    ]
    force = np.reshape(slots, (len(slots), *solution[:, 0].shape)).swapaxes(0, 1)
    twists = {name: structure.twist(solution, k) for name, k in index.items()}
    return Response(nominal, true, tuple(spots), twists, force, structure, solution)


def place_nodes(machine: Machine, located: Located) -> tuple[Frames, dict[str, int]]:
    """Return the frames of all nodes as commanded, and the numbers of nodes; the ground's is -1."""
    nodes = [
        BASE,
        *(node for body in machine.bodies.values() for node in body.nodes),
        TOOL,
    ]
    index = {name: k for k, name in enumerate(nodes)} | {GROUND: -1}
    carriers = {
        node: body.name for body in machine.bodies.values() for node in body.nodes
    }
    carriers |= {BASE: GROUND, GROUND: GROUND, TOOL: carriers[machine.tool]}
    rotation = located.frames.rotation
    position = located.frames.position
    nominal = Frames(
        {node: rotation[body] for node, body in carriers.items()},
        {node: position[body] for node, body in carriers.items()},
    )
    return nominal, index


def _find_equilibrium(
    machine: Machine, located: Located, nominal: Frames, index: dict[str, int]
) -> tuple[Frames, Structure]:
    """Return the frames of nodes in equilibrium with geometric errors, and the structure there."""
    frames = nominal
    structure = Structure(
        len(index) - 1, list_elements(machine, located, frames, index)
    )
    if not _is_distorted(machine):
        return frames, structure
    points = {
        TOOL: machine.at
    }  # points that do not move if a rod spins between two balls
    for body in machine.bodies.values():
        places = body.places if len(body.nodes) > 1 else [body.centre]
        points |= dict(zip(body.nodes, places, strict=True))
    for _ in range(_ITERATIONS):
        solution = structure.solve(structure.misfits()[..., None])
        steps = {
            name: structure.twist(solution, k) for name, k in index.items() if k >= 0
        }
        moved = [
            np.abs(lever(frames.point(name, at)) @ steps[name])[:, :3]
            for name, at in points.items()
        ]
        frames = frames.move({name: step[..., 0] for name, step in steps.items()})
        structure = Structure(
            len(index) - 1, list_elements(machine, located, frames, index)
        )
        if max(float(step.max()) for step in moved) < _SETTLED:
            return frames, structure
    raise InputError(
        "pose: expected errors of the geometry with which the loops still close"
    )


def _is_distorted(machine: Machine) -> bool:
    """Return whether its geometry deviates from the drawing."""
    return (
        any(body.offset.any() for body in machine.bodies.values())
        or any(
            (j.at_first != j.at_second).any()
            or j.misalignment.any()
            or j.spring
            or (j.drive and (j.drive.offset or j.drive.pitch))
            for j in machine.joints.values()
        )
        or bool(machine.cable.any())
    )


def list_elements(
    machine: Machine,
    located: Located,
    frames: Frames,
    index: dict[str, int],
) -> list[Element]:
    """Return what connects the nodes of a machine: base, joints, elastic bodies, tool, cable chain."""
    n = len(located.closed)
    everything = np.broadcast_to(np.eye(6), (n, 6, 6))
    world = np.eye(3)
    origin = np.zeros(3)
    misfit = _offset_between(frames, GROUND, BASE, origin, world)
    out = [
        Element(BASE, -1, (index[BASE],), everything, everything, machine.base, misfit)
    ]
    for joint in (drawn.real_joint for drawn in machine.joints.values()):
        first, second = (
            BASE if node == GROUND else node for node in (joint.first, joint.second)
        )
        commanded: Array | float = 0.0
        if joint.drive is not None:
            commanded = (
                located.drives[joint.name] * (1.0 + joint.drive.pitch)
                + joint.drive.offset
            )
        state = joint_state(joint, frames, first, second, commanded)
        ends = (index[first], (index[second],))
        carry = state.carry
        out.append(
            Element(
                joint.name, *ends, carry, state.held, joint.compliance, state.misfit
            )
        )
        if joint.spring:
            rows, away = spring_state(joint, frames, first, second)
            soft = np.eye(6) / joint.spring
            out.append(Element(f"{joint.name} spring", *ends, carry, rows, soft, away))
    elastic = (body for body in machine.bodies.values() if len(body.nodes) > 1)
    out += [_element_of_body(body, frames, index) for body in elastic]
    node = machine.tool
    end = frames.point(TOOL, machine.at)
    ends = (index[node], (index[TOOL],))
    carry = transform_to(frames.rotation[node], end)
    misfit = _offset_between(frames, node, TOOL, machine.at, world)
    out.append(Element(TOOL, *ends, carry, everything, machine.platform, misfit))
    if machine.cable.any():
        held = np.flatnonzero(machine.cable)
        yields = np.zeros(6)
        yields[held] = 1.0 / machine.cable[held]
        misfit = np.pad(end - machine.at, ((0, 0), (0, 3)))
        rows = np.broadcast_to(np.eye(6)[held], (n, len(held), 6))
        out.append(
            Element(
                CABLE, -1, (index[node],), lever(end), rows, np.diag(yields), misfit
            )
        )
    return out


def _element_of_body(body: Body, frames: Frames, index: dict[str, int]) -> Element:
    """Return the element of an elastic body, with its other ends against the first."""
    first, *others = body.nodes
    axes = frames.rotation[first] @ body.axes
    carry: list[Array] = []
    misfits: list[Array] = []
    for node, at, offset in zip(
        others, body.places[1:], body.offset.reshape(-1, 6), strict=True
    ):
        misfit = _offset_between(frames, first, node, at, body.axes)
        misfit[:, :3] -= offset[:3]
        misfit[:, 3:] = vector_of(turn(-offset[3:]) @ turn(misfit[:, 3:]))
        carry.append(transform_to(axes, frames.point(node, at)))
        misfits.append(misfit)
    size = 6 * len(others)
    held = np.broadcast_to(np.eye(size), (len(axes), size, size))
    ends = (index[first], tuple(index[node] for node in others))
    away = np.hstack(misfits)
    return Element(
        body.name, *ends, np.concatenate(carry, axis=1), held, body.compliance, away
    )


def _offset_between(
    frames: Frames, first: str, second: str, at: Array, axes: Array
) -> Array:
    """Return the offset (n, 6) of a point (3,) between two nodes, in axes (3, 3) of the first."""
    back = np.swapaxes(frames.rotation[first] @ axes, -1, -2)
    moved = frames.point(second, at) - frames.point(first, at)
    turned = vector_of(back @ frames.rotation[second] @ axes)
    return np.concatenate([(back @ moved[..., None])[..., 0], turned], axis=1)


def _find_weights(machine: Machine, true: Frames) -> Iterator[tuple[str, Array, Array]]:
    """Yield node, point and wrench of each weight; those of elastic bodies act at their ends."""
    pull = np.concatenate([machine.gravity, np.zeros(3)])
    for payload in machine.payloads:
        yield payload.node, payload.centre, payload.wrench(machine.gravity)
    for body in machine.bodies.values() if machine.weighted else ():
        if len(body.nodes) == 1:
            yield body.name, body.centre, body.mass * pull
            continue
        for node, at, end in zip(body.nodes, body.places, body.ends, strict=True):
            axes = true.rotation[node] @ body.axes
            yield (
                node,
                at,
                both_parts(axes) @ end @ np.swapaxes(axes, -1, -2) @ machine.gravity,
            )
