"""The nominal robot at a campaign's poses, solved once: what every place carries, and what a misfit there sets up.

Places of one serial chain carry the same wrench once it is restated at M, and a misfit anywhere in the chain does the
same. So a chain (not a place) is the unit of this algebra; all its quantities stand at M in axes {O}.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from vjm.elastic import Spring, edited, leaves
from vjm.gravity import STANDARD, exact_stiffness
from vjm.response import respond

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from vjm.analysis import Robot
    from vjm.elastic import Node
    from vjm.response import Response

    Array = NDArray[np.float64]

_SAME = 1e-9
_STEP = 1e-4  # m, central difference over the pose
_ROOM = 20_000  # poses solved in one go


@dataclass(frozen=True)
class Place:
    """A named spring: its chain, its nominal compliance (6, 6), and what carries its twists to M, (p, 6, 6)."""

    name: str
    chain: int
    compliance: Array
    to_tool: Array
    dead: Array
    """(p, 6) wrench that it carries under the robot's own weights, its own axes."""


@dataclass(frozen=True)
class Basis:
    """The nominal robot at poses (p, 3); c chains."""

    robot: Robot
    poses: Array
    places: dict[str, Place]
    compliance: Array
    """(p, 6, 6) of the tool."""
    sag: Array
    """(p, 6) twist of the tool under the robot's own weights."""
    stiffening: Array
    """(p, 6, 6) change of the tool's compliance because the structure carries its weights."""
    carried: Array
    """(p, c, 6, 6) wrench in each chain for unit wrenches at the tool."""
    coupling: Array
    """(p, c, 6, c, 6) wrench in each chain for unit misfits in each."""
    slope: Array
    """(p, 3, 6, 6) change of the tool's compliance with the tool point's x, y, z."""
    carried_slope: Array
    """(p, 3, c, 6, 6)."""

    @property
    def chains(self) -> int:
        """How many."""
        return self.carried.shape[1]


def solve_basis(robot: Robot, poses: Array, *, gravity: float = STANDARD) -> Basis:
    """Return the nominal robot at poses (p, 3). Raises InputError for an unreachable pose or one with free motion."""
    p = len(poses)
    tree = robot.tree(poses)
    unit, sag = _units(tree, p), respond(tree, np.zeros((6, 1)), gravity=gravity)
    springs = [leaf for leaf in leaves(tree) if isinstance(leaf, Spring)]
    restated = {s.name: _at_tool(unit, s.name, p) for s in springs}
    chain_of, heads = _chains([s.name for s in springs], restated)
    places: dict[str, Place] = {}
    for spring in springs:
        element = unit.elements[spring.name]
        dead = np.broadcast_to(sag.elements[spring.name].wrench[..., 0], (p, 6))
        to_tool = np.broadcast_to(element.frame.adjoint(), (p, 6, 6))
        places[spring.name] = Place(spring.name, chain_of[spring.name], np.asarray(spring.compliance), to_tool, dead)
    carried = np.stack([restated[head] for head in heads], axis=1)
    compliance = np.array(np.broadcast_to(unit.twist, (p, 6, 6)))
    slope, carried_slope = _slopes(robot, poses, heads)
    return Basis(
        robot=robot,
        poses=poses,
        places=places,
        compliance=compliance,
        sag=np.array(np.broadcast_to(sag.twist[..., 0], (p, 6))),
        stiffening=np.linalg.inv(exact_stiffness(tree, gravity)) - compliance,
        carried=carried,
        coupling=_coupling(robot, poses, heads, places),
        slope=slope,
        carried_slope=carried_slope,
    )


def _units(tree: Node, p: int) -> Response:
    return respond(tree, np.array(np.broadcast_to(np.eye(6), (p, 6, 6))))


def _at_tool(response: Response, name: str, p: int) -> Array:
    element = response.elements[name]
    back = np.swapaxes(element.frame.inverse_adjoint(), -1, -2)
    return np.array(np.broadcast_to(back @ element.wrench, (p, 6, element.wrench.shape[-1])))


def _chains(names: list[str], restated: dict[str, Array]) -> tuple[dict[str, int], list[str]]:
    """Return each place's chain, and the first place of each chain: what carries the same wrench is one chain."""
    chain: dict[str, int] = {}
    heads: list[str] = []
    for name in names:
        same = (k for k, head in enumerate(heads) if np.abs(restated[name] - restated[head]).max() < _SAME)
        k = next(same, len(heads))
        if k == len(heads):
            heads.append(name)
        chain[name] = k
    return chain, heads


def _offset(value: Array) -> Callable[[Node], Node]:
    def change(node: Node) -> Node:
        return replace(node, offset=value) if isinstance(node, Spring) else node

    return change


def _coupling(robot: Robot, poses: Array, heads: list[str], places: dict[str, Place]) -> Array:
    """Solve six unit misfits at the tool's axes in each chain, six copies of each pose side by side."""
    p, c = len(poses), len(heads)
    out = np.zeros((p, c, 6, c, 6))
    step = max(1, _ROOM // 6)
    for start in range(0, p, step):
        part = slice(start, min(start + step, p))
        m = part.stop - start
        copies = np.repeat(poses[part], 6, axis=0)
        tree = robot.tree(copies)
        for k, head in enumerate(heads):
            own = np.linalg.inv(places[head].to_tool[part])  # columns: units at M in the place's own axes
            offsets = np.swapaxes(own, 1, 2).reshape(6 * m, 6)
            state = respond(edited(tree, head, _offset(offsets)), np.zeros((6, 1)), misfit=True)
            for j, other in enumerate(heads):
                wrench = _at_tool(state, other, 6 * m)[..., 0].reshape(m, 6, 6)
                out[part, j, :, k, :] = np.swapaxes(wrench, 1, 2)
    return out


def _slopes(robot: Robot, poses: Array, heads: list[str]) -> tuple[Array, Array]:
    """Central differences over x, y, z, where the rim of the workspace allows."""
    p, c = len(poses), len(heads)
    slope, carried = np.zeros((p, 3, 6, 6)), np.zeros((p, 3, c, 6, 6))
    for axis, h in enumerate(np.eye(3) * _STEP):
        try:
            states = [_units(robot.tree(poses + side * h), p) for side in (1, -1)]
        except ValueError:
            continue
        twist = [np.broadcast_to(s.twist, (p, 6, 6)) for s in states]
        slope[:, axis] = (twist[0] - twist[1]) / (2 * _STEP)
        sides = [np.stack([_at_tool(s, head, p) for head in heads], axis=1) for s in states]
        carried[:, axis] = (sides[0] - sides[1]) / (2 * _STEP)
    return slope, carried
