"""Joint rates of a mechanism at one configuration, and the twists that they cause, every body rigid."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from stiffscope.vjm.loops import loops, tree
from stiffscope.vjm.mechanism import FREE, GROUND
from stiffscope.vjm.screws import skew

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from stiffscope.vjm.kinematics import Configurations
    from stiffscope.vjm.mechanism import Joint, Mechanism
    from stiffscope.vjm.screws import Array

_COUNT = {"fixed": 0, "revolute": 1, "prismatic": 1, "cylindrical": 2, "universal": 2, "spherical": 3, "planar": 3}


class JointRates:
    """Rates of all joints in their order, rad/s and own lengths/s; twists at the middle of the mechanism, base axes.

    ``loops``: independent loops, as joints by number and the sign in which each is gone through.
    """

    def __init__(self, mechanism: Mechanism, configurations: Configurations | None, index: int) -> None:
        self.mechanism = mechanism
        self.joints = mechanism.joints
        self.place = {node: _placed(configurations, index, node) for node in _nodes(mechanism)}
        self.at = [self._moved(j.second, j.at) for j in self.joints]
        self.tool = self._moved(mechanism.tool.body, mechanism.tool.at)
        points = np.array([*self.at, self.tool])
        self.middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
        self.length = float(np.linalg.norm(np.ptp(points, axis=0))) or 1.0
        self.starts = np.cumsum([0, *(_COUNT[j.kind] for j in self.joints)])
        self.screws = [self._screws(j, at) for j, at in zip(self.joints, self.at, strict=True)]
        self.edges = [(mechanism.carrier(j.first), mechanism.carrier(j.second)) for j in self.joints]
        self.paths, chords = tree(self.edges)
        self.loops = loops(self.edges, self.paths, chords)

    def _moved(self, node: str, home: Array) -> Array:
        rotation, position = self.place[node]
        return rotation @ home + position

    def _screws(self, joint: Joint, at: Array) -> Array:
        """Unit rates of a joint's motions (6, k): twist of its second body against its first."""
        first, second = self.place[joint.first][0], self.place[joint.second][0]
        arm = (at - self.middle) / self.length
        out: list[Array] = []
        for word, (kind, axis) in zip(FREE[joint.kind].split(), joint.motions, strict=True):
            if kind == "S":
                out += [_rotation(arm, e) for e in np.eye(3)]
            elif kind == "P":
                out.append(np.concatenate([first @ axis, np.zeros(3)]))
            else:
                rides = second if joint.kind == "universal" and word == "R1" else first
                out.append(_rotation(arm, rides @ axis))
        return np.array(out).T if out else np.zeros((6, 0))

    def columns(self, k: int) -> slice:
        """Columns of a joint among all rates."""
        return slice(int(self.starts[k]), int(self.starts[k + 1]))

    def along(self, way: Iterable[tuple[int, float]]) -> Array:
        """Twist (6, m) of the end of a way through joints against its start."""
        out = np.zeros((6, int(self.starts[-1])))
        for k, sign in way:
            out[:, self.columns(k)] += sign * self.screws[k]
        return out

    def of_body(self, name: str) -> Array:
        """Twist (6, m) of a body against the ground."""
        return self.along(self.paths[name])

    def bodies(self, loop: Sequence[tuple[int, float]]) -> tuple[str, ...]:
        """The bodies that a loop passes, in its order."""
        return tuple(self.edges[k][0 if sign > 0.0 else 1] for k, sign in loop)

    def names(self, some: Iterable[int]) -> tuple[str, ...]:
        """Joints by name."""
        return tuple(self.joints[k].name for k in some)


def _nodes(mechanism: Mechanism) -> tuple[str, ...]:
    return (GROUND, *(node for body in mechanism.bodies for node in body.nodes))


def _placed(configurations: Configurations | None, index: int, node: str) -> tuple[Array, Array]:
    """Displacement of a node since home, ``x = R x_home + p``."""
    if configurations is None:
        return np.eye(3), np.zeros(3)
    linkage = configurations.linkage
    rotation, position = configurations.link_frame(linkage.frame[linkage.link_of[node]])
    return rotation[index if len(rotation) > 1 else 0], position[index if len(position) > 1 else 0]


def _rotation(arm: Array, axis: Array) -> Array:
    return np.concatenate([skew(arm) @ axis, axis])
