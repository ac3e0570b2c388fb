"""Joint rates of a mechanism at one configuration, and the twists they cause, with rigid bodies."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from stiffscope.vjm.model.checks import GROUND

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from stiffscope.vjm.kinematics.configurations import Configurations
    from stiffscope.vjm.model.joints import Joint
    from stiffscope.vjm.model.mechanism import Mechanism
    from stiffscope.vjm.model.screws import Array

    Way = list[tuple[int, float]]
    Edges = Sequence[tuple[str, str]]


class JointRates:
    """Rates of all joints, rad/s and lengths/s; twists at the mechanism's middle, base axes.

    ``loops``: independent loops, as joint numbers with the sign of traversal.
    """

    def __init__(
        self, mechanism: Mechanism, configurations: Configurations | None, index: int
    ) -> None:
        self.mechanism = mechanism
        self.joints = mechanism.joints
        nodes = (GROUND, *(node for body in mechanism.bodies for node in body.nodes))
        self.place = {node: _place_node(configurations, index, node) for node in nodes}
        self.at = [self._move_point(j.second, j.at) for j in self.joints]
        self.tool = self._move_point(mechanism.tool.body, mechanism.tool.at)
        points = np.array([*self.at, self.tool])
        self.middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
        self.length = float(np.linalg.norm(np.ptp(points, axis=0))) or 1.0
        self.starts = np.cumsum([0, *(len(j.type.free) for j in self.joints)])
        self.screws = [
            self._screws(j, at) for j, at in zip(self.joints, self.at, strict=True)
        ]
        carrier = mechanism.carrier
        self.edges = [(carrier(j.first), carrier(j.second)) for j in self.joints]
        self.paths, chords = span_tree(self.edges)
        self.loops = _close_loops(self.edges, self.paths, chords)

    def _move_point(self, node: str, home: Array) -> Array:
        rotation, position = self.place[node]
        return rotation @ home + position

    def _screws(self, joint: Joint, at: Array) -> Array:
        """Return twists (6, k) of a joint's second body relative to its first for unit rates."""
        first = self.place[joint.first][0]
        second = self.place[joint.second][0]
        arm = (at - self.middle) / self.length
        out: list[Array] = []
        for kind, axis in joint.motions:
            if kind == "S":
                out += [np.concatenate([np.cross(arm, e), e]) for e in np.eye(3)]
            elif kind == "P":
                out.append(np.concatenate([first @ axis, np.zeros(3)]))
            else:
                turned = (second if joint.cross and out else first) @ axis
                out.append(np.concatenate([np.cross(arm, turned), turned]))
        return np.array(out).T if out else np.zeros((6, 0))

    def columns(self, k: int) -> slice:
        """Return a joint's columns among all rates."""
        return slice(int(self.starts[k]), int(self.starts[k + 1]))

    def add_twists(self, way: Iterable[tuple[int, float]]) -> Array:
        """Return the twist (6, m) of a path's end relative to its start."""
        out = np.zeros((6, int(self.starts[-1])))
        for k, sign in way:
            out[:, self.columns(k)] += sign * self.screws[k]
        return out

    def of_body(self, name: str) -> Array:
        """Return the twist (6, m) of a body relative to the ground."""
        return self.add_twists(self.paths[name])

    def bodies(self, loop: Sequence[tuple[int, float]]) -> tuple[str, ...]:
        """Return the bodies of a loop, in order."""
        return tuple(self.edges[k][0 if sign > 0.0 else 1] for k, sign in loop)

    def names(self, indices: Iterable[int]) -> tuple[str, ...]:
        """Return names of joints."""
        return tuple(self.joints[k].name for k in indices)


def _place_node(
    configurations: Configurations | None, index: int, node: str
) -> tuple[Array, Array]:
    """Return a node's displacement from home, ``x = R x_home + p``."""
    if configurations is None:
        return np.eye(3), np.zeros(3)
    rotation, position = configurations.link_frame(
        configurations.linkage.frame[configurations.linkage.link_of[node]]
    )
    return rotation[index if len(rotation) > 1 else 0], position[
        index if len(position) > 1 else 0
    ]


def span_tree(edges: Edges) -> tuple[dict[str, Way], list[int]]:
    """Return breadth-first paths from the ground to all bodies, and the joints outside this tree.

    ``edges``: the two bodies of each joint. A path is joint numbers with signs, -1 if reversed.
    """
    paths = _find_paths(edges, range(len(edges)), GROUND)
    used = {k for path in paths.values() for k, _ in path}
    return paths, [k for k in range(len(edges)) if k not in used]


def _close_loops(edges: Edges, paths: dict[str, Way], chords: list[int]) -> list[Way]:
    """Return one loop per chord, shortest first, through the tree and earlier chords."""
    open_edges = {k for path in paths.values() for k, _ in path}
    out: list[Way] = []
    left = list(chords)
    while left:
        motions: dict[int, Way] = {}
        for k in left:
            first, second = edges[k]
            motions[k] = [
                (k, 1.0),
                *_find_paths(edges, sorted(open_edges), second)[first],
            ]
        best = min(left, key=lambda k: len(motions[k]))
        out.append(motions[best])
        open_edges.add(best)
        left.remove(best)
    return out


def _find_paths(edges: Edges, nodes: Sequence[int], start: str) -> dict[str, Way]:
    """Return breadth-first paths along some edges from a body to all others."""
    ways: dict[str, Way] = {start: []}
    queue = [start]
    for here in queue:
        for k in nodes:
            first, second = edges[k]
            there = second if here == first else first if here == second else None
            if there is not None and there not in ways:
                ways[there] = [*ways[here], (k, 1.0 if here == first else -1.0)]
                queue.append(there)
    return ways
