"""How the robot yields under a load: the platform's twist, who contributes how much, and backlash in the drives."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.errors import InputError
from stiffscope.vjm.checks import checked_poses
from stiffscope.vjm.elastic import Node, Spring, edited, named
from stiffscope.vjm.reduction import assembled
from stiffscope.vjm.response import respond

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import ArrayLike

    from stiffscope.vjm.analysis import Robot
    from stiffscope.vjm.screws import Array

_STEPS = 100
_SETTLED = 1e-12  # of a gap, or of the largest force
_ALONE = 1e-12  # of a drive's stiffness, below which what others hold against its shift is rounding
_LARGEST = 1e100  # N or N·m; its square is still a number


@dataclass(frozen=True)
class Deflection:
    """``twist`` (n, 6) of the platform at M in m, rad; ``energy`` (n,) in J; each component's share (n,) of it."""

    twist: Array
    energy: Array
    shares: dict[str, Array]


def deflection(robot: Robot, poses: ArrayLike, wrench: ArrayLike) -> Deflection:
    """Deflection under a wrench (6,) or (n, 6) in N, N·m at M. The shares of strain energy sum to 1 at every pose.

    Raises InputError for an unreachable pose, a wrench of another shape, or a tool that moves freely.
    """
    points = checked_poses(poses)
    load = _checked_wrench(wrench, len(points))
    response = respond(robot.tree(points), load[..., None])
    twist = np.broadcast_to(response.twist[..., 0], (len(points), 6))
    energy = 0.5 * np.einsum("ni,ni->n", load, twist)
    shares: dict[str, Array] = {}
    for name, element in response.elements.items():
        if isinstance(element.node, Spring) and not element.node.rigid:
            stored = 0.5 * np.einsum("...ic,...ic->...", element.wrench, element.twist)
            shares[name] = np.broadcast_to(stored, (len(points),)) / np.where(energy > 0.0, energy, 1.0)
    return Deflection(twist, energy, shares)


def deflection_with_backlash(robot: Robot, poses: ArrayLike, wrench: ArrayLike, gaps: Mapping[str, float]) -> Array:
    """Twist (n, 6) at M under a wrench (6,) or (n, 6), with dead zones in drives, from the middle of each gap.

    ``gaps`` gives half-widths in m by drive (``limb1.actuator``). A drive shifts by the half-width towards the force it
    carries; where the others would take its force off it before that, it hangs free inside its gap. Raises as
    ``deflection``, and for a name that is no drive's.
    """
    points = checked_poses(poses)
    load = _checked_wrench(wrench, len(points))
    tree = robot.tree(points)
    names = list(gaps)
    stiff = np.array([_stiffness(named(tree, name)) for name in names])
    half = np.array([gaps[name] for name in names], dtype=float)
    if not ((half >= 0.0) & np.isfinite(half)).all():
        msg = f"backlash: expected half-widths of at least 0 m, got {dict(gaps)}"
        raise InputError(msg)
    loaded = respond(tree, load[..., None])
    if not names:
        return loaded.twist[..., 0]
    force = np.zeros((len(points), len(names)))
    for i, name in enumerate(names):
        force[:, i] = _along(tree, name, loaded.elements[name].wrench)[..., 0]
    influence = np.zeros((len(points), len(names), len(names)))  # force of drive i per shift of drive j
    carried = np.zeros((len(points), 6, len(names)))  # twist of the tool per shift of drive j
    for j, name in enumerate(names):
        shifted = assembled(edited(tree, name, _shifted), loads=True)
        state = respond(shifted, np.zeros((6, 1)), misfit=True)
        carried[..., j] = state.twist[..., 0]
        for i, other in enumerate(names):
            influence[:, i, j] = _along(tree, other, state.elements[other].wrench)[..., 0]
    shift = _settled(force, influence, half, stiff)
    return loaded.twist[..., 0] + np.einsum("nij,nj->ni", carried, shift)


def load_deflection(
    robot: Robot, pose: ArrayLike, wrench: ArrayLike, factors: ArrayLike, gaps: Mapping[str, float]
) -> Array:
    """Twists (m, 6) at one pose under ``factors`` (m,) times a wrench (6,): the curve that a load test records."""
    scale = np.asarray(factors, dtype=float)
    poses = np.repeat(checked_poses(pose), len(scale), axis=0)
    return deflection_with_backlash(robot, poses, scale[:, None] * np.asarray(wrench, dtype=float), gaps)


def _checked_wrench(wrench: ArrayLike, n: int) -> Array:
    load = np.asarray(wrench, dtype=float)
    if load.shape not in ((6,), (n, 6)) or not (np.abs(load) < _LARGEST).all():
        msg = f"wrench: expected finite (6,) or ({n}, 6) forces and moments in N, N·m, got {load.tolist()}"
        raise InputError(msg)
    return np.broadcast_to(load, (n, 6))


def _direction(node: Node) -> Array:
    """Unit twist (6,) of a drive: the one direction in which its spring yields."""
    values, vectors = np.linalg.eigh(node.compliance if isinstance(node, Spring) else np.zeros((6, 6)))
    if values.ndim != 1 or not values[-1] > 0.0 or values[-2] > 1e-12 * values[-1]:
        msg = f"{node.name}: expected a drive, a spring that yields in one direction"
        raise InputError(msg)
    vector = vectors[:, -1]
    return vector * np.sign(vector[np.argmax(np.abs(vector))])


def _stiffness(drive: Node) -> float:
    """Stiffness of a drive along its direction, N/m."""
    direction = _direction(drive)
    return 1.0 / float(direction @ drive.compliance @ direction) if isinstance(drive, Spring) else 0.0


def _shifted(node: Node) -> Node:
    direction = _direction(node)
    return replace(node, offset=direction) if isinstance(node, Spring) else node


def _along(tree: Node, name: str, wrench: Array) -> Array:
    """Force (..., c) of a drive along its direction."""
    return np.einsum("i,...ic->...c", _direction(named(tree, name)), wrench)


def _settled(force: Array, influence: Array, half: Array, stiffness: Array) -> Array:
    """Shifts (n, k) with ``|s| ≤ half`` that stand at the end of the gap towards the force left, or leave none.

    The box-constrained minimum of ``½ sᵀ(-H)s - fᵀs`` by active sets, in units of the gaps; H is negative semidefinite,
    and where it is rounding beside the drives' ``stiffness`` (k,) nobody takes a drive's force off it.
    """
    pull, back = force * half, -0.5 * (influence + np.swapaxes(influence, -1, -2)) * np.outer(half, half)
    least = np.where(half > 0.0, _ALONE * stiffness * half**2, 1.0)
    shift: Array = np.zeros_like(pull)
    side: Array = np.zeros_like(pull)  # the end of the gap that a drive is held at
    for _ in range(_STEPS + 10 * len(half)):
        left = pull - np.einsum("nij,nj->ni", back, shift)
        free = side == 0.0
        among: Array = np.eye(len(half)) * np.where(free, least, 1.0)[:, None, :]
        among = among + back * (free[:, :, None] & free[:, None, :])
        step = np.einsum("nij,nj->ni", np.linalg.inv(among), left * free)
        room = np.divide(np.sign(step) - shift, step, out=np.full_like(step, np.inf), where=step != 0.0)
        reach = room.min(axis=1, keepdims=True, initial=1.0)
        at_end = room <= reach
        side = np.where(at_end, np.sign(step), side)
        shift = np.where(at_end, side, shift + reach * step)
        still = ~at_end.any(axis=1) & (np.abs(step) < _SETTLED).all(axis=1)
        inward = left * side
        worst = inward.argmin(axis=1)
        freed = still & (inward.min(axis=1) < -_SETTLED * np.abs(pull).max(axis=1))
        if (still & ~freed).all():
            return shift * half
        side[freed, worst[freed]] = 0.0
    msg = "backlash: no equilibrium of the drives was found within their gaps"
    raise InputError(msg)
