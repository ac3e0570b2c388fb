"""The Biglide as a structure of bodies: its true configuration, and its response to loads there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.errors import InputError
from stiffscope.gap.lab.structure import GROUND, Connection, Structure, lever

if TYPE_CHECKING:
    from stiffscope.gap.lab.machine import Dimensions, Machine
    from stiffscope.gap.lab.structure import Array

OUTWARD = (-1.0, 1.0)  # direction of x that leads outward, limb 1 and limb 2
DRIVES = ("limb1", "limb2", "stage")
A_RANGE = (0.20, 0.55)  # m, distance of a carriage from O
_REVOLUTE = np.array([False, False, False, False, True, False])
_FIXED = np.zeros(6, dtype=bool)


@dataclass(frozen=True)
class Configuration:
    """True configuration of the machine when it is commanded to poses (n, 3)."""

    tool: Array
    """(n, 3) M of the rigid machine with its geometry errors."""
    angles: Array
    """(n, 2) q of both limbs."""
    lengths: Array
    """(2,) mean length of a limb's links."""
    half_width: float


def command(dimensions: Dimensions, poses: Array) -> Array:
    """Return the carriage distances a₁, a₂ and stage y (n, 3) that the controller sends for poses (n, 3)."""
    x, y, z = poses.T
    s = (z - dimensions.l1 - dimensions.l2) / dimensions.L
    c = np.sqrt(np.where((s > 0) & (s < 1), 1 - s**2, np.nan))
    reach = dimensions.L * c + dimensions.l
    return np.stack([reach - x, reach + x, y], axis=1)


def locate(machine: Machine, poses: Array) -> Configuration:
    """Return the configuration of the rigid machine for poses (n, 3); link errors enter by their mean over a limb.

    Raises InputError for a pose that it cannot reach.
    """
    dims = machine.dimensions
    sent = command(dims, poses)
    if not np.all((sent[:, :2] >= A_RANGE[0] - 1e-9) & (sent[:, :2] <= A_RANGE[1] + 1e-9)):
        raise InputError(f"pose: expected carriages within {A_RANGE[0]} to {A_RANGE[1]} m of the middle")
    a = sent[:, :2] * (1 + machine.rail_pitch) + [machine.drives[0].offset, machine.drives[1].offset]
    lengths = dims.L + machine.length_error.mean(axis=1)
    half = dims.l + machine.width_error
    span = a.sum(axis=1) - 2 * half
    across = (span**2 + lengths[0] ** 2 - lengths[1] ** 2) / (2 * span)
    depth = np.sqrt(lengths[0] ** 2 - across**2)
    q = np.stack([np.arctan2(depth, across), np.arctan2(depth, span - across)], axis=1)
    x = -a[:, 0] + across + half
    tool = np.stack([x, sent[:, 2] + machine.drives[2].offset, depth + dims.l1 + dims.l2], axis=1)
    return Configuration(tool, q, lengths, half)


BASE, STAGE, PLATFORM, TOOL, BODIES = 0, 1, 18, 19, 20


def carriage(limb: int) -> int:
    """Return the body number of a limb's carriage; then come its slider's far end, its links (near, far)."""
    return 2 + 8 * limb


def link_bodies(limb: int, link: int) -> tuple[int, int]:
    """Return the body numbers of a link's clamped and loaded ends."""
    near = carriage(limb) + 2 + 2 * link
    return near, near + 1


def link_axes(angle: Array, limb: int) -> Array:
    """Return link frames (n, 3, 3): R(y, −q) for limb 1, R(y, q − π) for limb 2."""
    turn = -angle if limb == 0 else angle - np.pi
    c, s = np.cos(turn), np.sin(turn)
    out = np.zeros((len(angle), 3, 3))
    out[:, 0, 0], out[:, 0, 2], out[:, 1, 1] = c, s, 1.0
    out[:, 2, 0], out[:, 2, 2] = -s, c
    return out


def joints_b(machine: Machine, configuration: Configuration, limb: int) -> Array:
    """Return the points B_ij (3, n, 3)."""
    dims, side = machine.dimensions, -OUTWARD[limb]
    middle = configuration.tool + np.array([-side * configuration.half_width, 0, -dims.l2])
    offsets = np.array([[-side * dims.h, 0, 0], [side * dims.h, dims.d, 0], [side * dims.h, -dims.d, 0]])
    return middle[None] + offsets[:, None]


def _limb(machine: Machine, configuration: Configuration, limb: int) -> list[Connection]:
    n, tag = len(configuration.tool), f"limb{limb + 1}"
    world = np.broadcast_to(np.eye(3), (n, 3, 3))
    axes = link_axes(configuration.angles[:, limb], limb)
    along = configuration.lengths[limb] * axes[:, :, 0]
    ends = joints_b(machine, configuration, limb)
    a = configuration.tool + np.array([OUTWARD[limb] * configuration.half_width, 0, -machine.dimensions.l2]) - along
    o = a - [0, 0, machine.dimensions.l1]
    yields = np.diag([1 / machine.drives[limb].stiffness, *machine.guides[limb][1:]])
    body = carriage(limb)
    out = [
        Connection(f"{tag}.drive", STAGE, body, o, world, yields, _FIXED),
        Connection(f"{tag}.slider", body, body + 1, a, world, machine.sliders[limb], _FIXED),
    ]
    for j in range(3):
        near, far = link_bodies(limb, j)
        name, (first, last) = f"{tag}.link{j + 1}", machine.bearings[limb, j]
        start = ends[j] - along
        out += [
            Connection(f"{name}.joint_a", body + 1, near, start, axes, np.diag(first), _REVOLUTE),
            Connection(name, near, far, ends[j], axes, machine.links[limb, j], _FIXED),
            Connection(f"{name}.joint_b", far, PLATFORM, ends[j], axes, np.diag(last), _REVOLUTE),
        ]
    return out


def build(machine: Machine, configuration: Configuration) -> Structure:
    """Return the machine's structure in its true configuration."""
    n = len(configuration.tool)
    world = np.broadcast_to(np.eye(3), (n, 3, 3))
    origin = np.zeros((n, 3))
    stage = origin + np.stack([np.zeros(n), configuration.tool[:, 1], np.zeros(n)], axis=1)
    guide = np.diag(machine.stage_guide)
    guide[1, 1] = 1 / machine.drives[2].stiffness
    connections = [
        Connection("base", GROUND, BASE, origin, world, np.diag(machine.base), _FIXED),
        Connection("stage.drive", BASE, STAGE, stage, world, guide, _FIXED),
        *_limb(machine, configuration, 0),
        *_limb(machine, configuration, 1),
        Connection("tool", PLATFORM, TOOL, configuration.tool, world, np.diag(machine.platform), _FIXED),
    ]
    if np.any(machine.cable):
        slack = machine.cable == 0
        yields = np.diag(1 / np.where(slack, np.inf, machine.cable))
        chain = Connection("cable", GROUND, PLATFORM, configuration.tool, world, yields, slack)
        connections.append(chain)
    return Structure(BODIES, connections)


@dataclass(frozen=True)
class Response:
    """Linear response to loads at the tool point; n poses, three drives."""

    shift: Array
    """(n, 6) rigid geometric error: true minus commanded pose."""
    compliance: Array
    """(n, 6, 6)."""
    dead: Array
    """(n, 6) twist under its own loads and offsets."""
    by_drive: Array
    """(n, 6, 3) twist for a unit of lost motion in each drive."""
    force: Array
    """(n, 3, 6) drive forces for unit wrenches."""
    dead_force: Array
    """(n, 3)."""
    force_by_drive: Array
    """(n, 3, 3)."""


def _weights(machine: Machine, configuration: Configuration, structure: Structure) -> Array:
    """Return the weights: a uniform link hangs on both ends, which gives its exact stretch wL/2EA."""
    down = np.array([0, 0, machine.acceleration, 0, 0, 0])
    total = np.zeros(structure.matrix.shape[:2])
    if machine.gravity:
        total += structure.load(PLATFORM, configuration.tool, machine.platform_mass * down)
        for limb in range(2):
            along = configuration.lengths[limb] * link_axes(configuration.angles[:, limb], limb)[:, :, 0]
            for j, end in enumerate(joints_b(machine, configuration, limb)):
                near, far = link_bodies(limb, j)
                total += structure.load(near, end - along, 0.5 * machine.link_mass * down)
                total += structure.load(far, end, 0.5 * machine.link_mass * down)
    if machine.payload_mass:
        at = configuration.tool + machine.payload_centre
        total += structure.load(PLATFORM, at, machine.payload_mass * down)
    return total


def _offset_loads(machine: Machine, poses: Array, structure: Structure) -> Array:
    total = np.zeros(structure.matrix.shape[:2])
    for limb in range(2):
        mean = machine.length_error[limb].mean()
        for j in range(3):
            kappa, length = machine.bow[limb, j], machine.dimensions.L
            rest = [machine.length_error[limb, j] - mean, 0, kappa * length**2 / 2, 0, -kappa * length, 0]
            total += structure.offset_load(f"limb{limb + 1}.link{j + 1}", np.array(rest))
    if np.any(machine.cable):
        pull = np.zeros((len(poses), 6))
        pull[:, :3] = -(poses - [0, 0, 0.35])
        total += structure.offset_load("cable", pull)
    return total


def respond(machine: Machine, poses: Array) -> Response:
    """Return the linear response of the machine, in its true configuration, to everything that can load it."""
    configuration = locate(machine, poses)
    structure = build(machine, configuration)
    n = len(poses)
    units = [structure.load(TOOL, configuration.tool, unit) for unit in np.eye(6)]
    dead = _weights(machine, configuration, structure) + _offset_loads(machine, poses, structure)
    names = [f"{name}.drive" for name in DRIVES]
    slots = [0, 0, 1]
    lost = [structure.offset_load(name, np.eye(6)[slot]) for name, slot in zip(names, slots, strict=True)]
    solution = structure.solve(np.stack([*units, dead, *lost], axis=2))
    twist = structure.twist(solution, TOOL, configuration.tool)
    force = np.empty((n, 3, 10))
    for k, (name, slot) in enumerate(zip(names, slots, strict=True)):
        stretch = structure.relative(solution, name)[:, slot]
        stretch[:, 7 + k] -= 1.0
        force[:, k] = machine.drives[k].stiffness * stretch
    shift = np.zeros((n, 6))
    shift[:, :3] = configuration.tool - poses
    return Response(
        shift=shift,
        compliance=twist[:, :, :6],
        dead=twist[:, :, 6],
        by_drive=twist[:, :, 7:],
        force=force[:, :, :6],
        dead_force=force[:, :, 6],
        force_by_drive=force[:, :, 7:],
    )


def stiffness(machine: Machine, poses: Array) -> Array:
    """Return the Cartesian stiffness (n, 6, 6) at M, axes {O}, without loads or instrument."""
    return np.asarray(np.linalg.inv(respond(machine, poses).compliance), dtype=np.float64)


def carry(points: Array, wrenches: Array) -> Array:
    """Return wrenches (n, 6) that act at `points` (3,) off M, restated at M."""
    return np.einsum("ji,nj->ni", lever(points[None])[0], wrenches)
