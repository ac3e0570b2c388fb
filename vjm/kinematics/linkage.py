"""A mechanism as rigid links: a spanning tree of joints, and cut joints that close loops.

A link's place is its displacement from home, ``x = R x_home + p`` in base axes. A tree joint adds
coordinates (rotations R and translations P along axes, or a rotation vector S); a cut joint adds
equations: the held components of the relative displacement of its two links.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from scipy.cluster.hierarchy import DisjointSet  # pyright: ignore[reportMissingTypeStubs]

from stiffscope.vjm.kinematics.tabulated import Cut, Motion, Table
from stiffscope.vjm.model.checks import GROUND
from stiffscope.vjm.model.screws import rotation_of, skew

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stiffscope.vjm.kinematics.tabulated import LoopEquations
    from stiffscope.vjm.model.joints import Joint
    from stiffscope.vjm.model.mechanism import Mechanism
    from stiffscope.vjm.model.screws import Array

Given = Literal["tool", "drives"]
FEW = 32  # poses, up to which the tabulated form is faster
TOOL_MOTIONS = (*((("P", axis)) for axis in np.eye(3)), ("S", np.zeros(3)))


@dataclass(frozen=True, eq=False)
class LinkFrames:
    """Links at n configurations ``q`` (m, n), placed one by one or, for few poses, all at once.

    Here and in the loop closure the poses are the last axis, elsewhere the first.
    """

    q: Array
    linkage: Linkage
    frames: tuple[list[Array], list[Array]]
    look: LoopEquations | None = None

    @cached_property
    def rotation(self) -> list[Array]:
        """Rotation (3, 3, n or 1) of each frame."""
        if self.look is None:
            return self.frames[0]
        return list(self.look.frames[:, :, :3, :3].transpose(1, 2, 3, 0))

    @cached_property
    def position(self) -> list[Array]:
        """Position (3, n or 1) of each frame."""
        if self.look is None:
            return self.frames[1]
        return list(self.look.frames[:, :, :3, 3].transpose(1, 2, 0))

    def point(self, frame: int, home: Array) -> Array:
        """Return the place (3, n or 1) of a point (3,) of a link."""
        return home @ self.rotation[frame] + self.position[frame]

    @cached_property
    def errors(self) -> Array:
        """Errors (rows, n) of all cut joints: relative lengths, and errors of held rotations."""
        if self.look:
            return self.look.errors
        starts = self.linkage.starts
        out = np.empty((int(starts[-1]), self.q.shape[1]))
        for cut, start in zip(self.linkage.cuts, starts[:-1], strict=True):
            self.linkage.find_errors(cut, self, out[start : start + cut.size])
        return out

    @cached_property
    def twists(self) -> Array:
        """Twists (m, 6, n) for a unit rate of each coordinate, at the origin in base axes."""
        if self.look:
            return self.look.twists.transpose(1, 2, 0)
        out = np.zeros((len(self.q), 6, self.q.shape[1]))
        for m in self.linkage.motions:
            r = self.rotation[m.parent]
            c = m.column
            if m.kind == "P":
                out[c, :3] = (m.sign * m.axis) @ r
                continue
            at = m.point @ r + self.position[m.parent]
            if m.kind == "R":
                out[c, 3:] = (m.sign * m.axis) @ r
                _cross(at, out[c, 3:], out[c, :3])
                continue
            spin = m.sign * (
                r.transpose(2, 0, 1) @ left_jacobian(m.sign * self.q[c : c + 3].T)
            )
            for k in range(3):
                out[c + k, 3:] = spin[..., k].T
                _cross(at, out[c + k, 3:], out[c + k, :3])
        return out


class Linkage:
    """Spanning tree and cut joints of a mechanism with a given tool pose or given drives.

    If the tool is given, three translations x, y, z and a rotation vector connect it to the ground
    in the tree: the coordinates of the pose, as displacements from home.
    """

    def __init__(self, mechanism: Mechanism, given: Given) -> None:
        self.mechanism = mechanism
        self.given: Given = given
        self.link_of, links = _find_links(mechanism)
        self.length = _measure_length(mechanism)
        joints = [j for j in mechanism.joints if not self.welds(j)]
        tree = self._tree(joints, links)
        self.motions: list[Motion] = []
        self.columns: dict[str, list[int]] = {}
        self.frame = {self.link_of[GROUND]: 0}
        self._grow(joints, tree)
        self.size = sum(3 if m.kind == "S" else 1 for m in self.motions)
        paths = self._paths()
        self.cuts = [self._cut(j, paths) for j in joints if j.name not in tree]
        self.starts = np.cumsum([0, *(c.size for c in self.cuts)])
        self.known = self._find_known()
        scale = np.ones(self.size)
        for m in self.motions:
            if m.kind == "P":
                scale[m.column] = self.length
        self.scale = scale

    def welds(self, joint: Joint) -> bool:
        """Return whether fixed joints and elastic bodies connect both bodies of a joint."""
        return self.link_of[joint.first] == self.link_of[joint.second]

    def _tree(self, joints: list[Joint], links: int) -> set[str]:
        """Grow the tree (Kruskal): sprung joints, few unknowns, drives first; cut the freest."""

        def unknown(j: Joint) -> tuple[bool, float, bool]:
            count = sum(3 if kind == "S" else 1 for kind, _ in j.motions)
            known = j.drive is not None and self.given == "drives"
            return j.spring is None, count - known, j.drive is None

        joined: Any = DisjointSet(range(links))
        if self.given == "tool":
            joined.merge(self.link_of[self.mechanism.tool.body], self.link_of[GROUND])
        link = self.link_of
        ordered = sorted(joints, key=unknown)
        return {j.name for j in ordered if joined.merge(link[j.first], link[j.second])}

    def _grow(self, joints: list[Joint], tree: set[str]) -> None:
        """Create frames and motions along the tree, outward from the ground."""
        edges: list[tuple[str, str, str, tuple[tuple[str, Array], ...], Array]] = [
            (j.name, j.first, j.second, j.motions, j.at)
            for j in joints
            if j.name in tree
        ]
        tool = self.mechanism.tool
        if self.given == "tool":
            edges.insert(0, ("", GROUND, tool.body, TOOL_MOTIONS, tool.at))
        count = 0
        frames = 1
        queue = [self.link_of[GROUND]]
        for link in queue:
            for name, *ends, motions, at in edges:
                first, second = (self.link_of[node] for node in ends)
                if name in self.columns or link not in {first, second}:
                    continue
                sign = 1.0 if link == first else -1.0
                sizes = [3 if kind == "S" else 1 for kind, _ in motions]
                begun = [count, *(count + np.cumsum(sizes, dtype=int)).tolist()]
                self.columns[name] = list(range(count, begun[-1]))
                count = begun[-1]
                steps = list(zip(motions, begun, strict=False))
                at_frame = self.frame[link]
                for (kind, axis), column in steps if sign > 0.0 else reversed(steps):
                    self.motions.append(
                        Motion(kind, axis, at, sign, column, at_frame, frames)
                    )
                    at_frame = frames
                    frames = frames + 1
                there = second if link == first else first
                self.frame[there] = at_frame
                queue.append(there)
        self.frames = frames

    def _paths(self) -> list[set[int]]:
        paths: list[set[int]] = [set() for _ in range(self.frames)]
        for m in self.motions:
            columns = range(m.column, m.column + (3 if m.kind == "S" else 1))
            paths[m.child] = paths[m.parent].union(columns)
        return paths

    def _cut(self, joint: Joint, paths: list[set[int]]) -> Cut:
        first, second = (
            self.frame[self.link_of[node]] for node in (joint.first, joint.second)
        )
        ahead = sorted(paths[second] - paths[first])
        behind = sorted(paths[first] - paths[second])
        signs = np.repeat([1.0, -1.0], [len(ahead), len(behind)])
        return Cut(joint, first, second, np.array(ahead + behind, dtype=int), signs)

    def _find_known(self) -> list[int]:
        """Return columns of the given values, in the order of commanded coordinates or drives."""
        if self.given == "tool":
            return [self.columns[""][k] for k in self.mechanism.tool.commanded_axes]
        return self.driven

    @property
    def driven(self) -> list[int]:
        """Columns of the drives in the tree, in the mechanism's order."""
        drives = [j for j in self.mechanism.drives if j.name in self.columns]
        return [self.columns[j.name][j.driven or 0] for j in drives]

    def find_link_frames(self, q: Array) -> LinkFrames:
        """Place links at coordinates (m, n)."""
        if q.shape[1] <= FEW:
            return LinkFrames(q, self, ([], []), self.table.look(q))
        rotation: list[Array] = [np.eye(3)[..., None]] * self.frames
        position: list[Array] = [np.zeros((3, 1))] * self.frames
        for m in self.motions:
            r = rotation[m.parent]
            p = position[m.parent]
            c = m.column
            if m.kind == "P":
                r_out = r
                p_out = p + ((m.sign * m.axis) @ r) * q[c]
            else:
                if m.kind == "R":
                    first, second = m.turning
                    r_out = r + np.matmul(first, r) * np.sin(q[c])
                    r_out += np.matmul(second, r) * (1.0 - np.cos(q[c]))
                else:
                    turn = r.transpose(2, 0, 1) @ rotation_of(m.sign * q[c : c + 3].T)
                    r_out = np.ascontiguousarray(turn.transpose(1, 2, 0))
                p_out = p + m.point @ (r - r_out)
            rotation[m.child] = r_out
            position[m.child] = p_out
        return LinkFrames(q, self, (rotation, position))

    @cached_property
    def table(self) -> Table:
        """Tabulated motions and equations, for few poses."""
        return Table(self.motions, self.cuts, self.length, self.size)

    def name_worst(self, errors: Array) -> str:
        """Return the name of the cut joint with the largest error (rows,)."""
        row = int(np.nan_to_num(np.abs(errors), nan=np.inf).argmax())
        return self.cuts[
            int(np.searchsorted(self.starts, row, side="right")) - 1
        ].joint.name

    def find_errors(self, cut: Cut, placed: LinkFrames, out: Array) -> None:
        """Write the errors (h, n) of a cut joint into ``out``."""
        joint = cut.joint
        held, turns = joint.held_components
        axes = np.matmul(
            joint.axes.T, placed.rotation[cut.first]
        )  # (3, 3, n): component, axis
        gap = placed.point(cut.second, joint.at) - placed.point(cut.first, joint.at)
        second = placed.rotation[cut.second]
        count = len(held)
        out[:count] = (axes[:, held] * gap[:, None]).sum(axis=0) / self.length
        if joint.cross:
            first, other = joint.cross
            a = first @ placed.rotation[cut.first]
            b = other @ second
            out[count] = (a * b).sum(axis=0) - first @ other
        elif len(turns) == 2:
            image = joint.axes[:, 0] @ second
            out[count] = -(axes[:, 2] * image).sum(axis=0)
            out[count + 1] = (axes[:, 1] * image).sum(axis=0)
        elif turns:
            second_axes = np.matmul(joint.axes.T, second)
            for row, (i, j) in enumerate(((1, 2), (2, 0), (0, 1)), count):
                twice = axes[:, j] * second_axes[:, i] - axes[:, i] * second_axes[:, j]
                out[row] = 0.5 * twice.sum(axis=0)

    def wrenches(self, cut: Cut, rows: Sequence[int], placed: LinkFrames) -> Array:
        """Return wrenches (6, rows, n or 1) on the second link that measure some errors.

        At the origin in base axes; a wrench times a twist is the rate of its error.
        """
        joint = cut.joint
        held, turns = joint.held_components
        carrier = placed.rotation[cut.first]
        forces = [held[row] for row in rows if row < len(held)]
        moments = [turns[row - len(held)] for row in rows if row >= len(held)]
        crossed = None
        if moments and joint.cross:
            crossed = (
                joint.cross[1] @ placed.rotation[cut.second],
                joint.cross[0] @ carrier,
            )
        at = placed.point(cut.second, joint.at) if forces else carrier[0]
        n = max(
            carrier.shape[2],
            at.shape[-1],
            1 if crossed is None else crossed[0].shape[-1],
        )
        count = len(forces)
        out = np.zeros((6, len(rows), n))
        if forces:
            out[:3, :count] = np.matmul(joint.axes.T[forces], carrier) / self.length
            _cross(at[:, None], out[:3, :count], out[3:, :count])
        if crossed is not None:
            _cross(*crossed, out[3:, count])
        elif moments:
            out[3:, count:] = np.matmul(joint.axes.T[moments], carrier)
        return out

    def coordinates(self, joint: Joint, q: Array, placed: LinkFrames) -> Array:
        """Return a joint's coordinates (n, f), rad and m, in order, from all coordinates (m, n)."""
        if joint.name in self.columns:
            return q[self.columns[joint.name]].T
        first, second = (
            self.frame[self.link_of[node]] for node in (joint.first, joint.second)
        )
        to_first = placed.rotation[first].transpose(2, 1, 0)
        across = to_first @ placed.rotation[second].transpose(2, 0, 1)
        gap = (placed.point(second, joint.at) - placed.point(first, joint.at)).T
        free_values = find_free_coordinates(
            joint, across, (to_first @ gap[..., None])[..., 0]
        )
        return np.broadcast_to(free_values, (q.shape[1], free_values.shape[-1]))


def _cross(a: Array, b: Array, out: Array) -> None:
    """Write the cross product of vectors (3, n) into ``out``."""
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


def find_free_coordinates(joint: Joint, across: Array, gap: Array) -> Array:
    """Return a joint's coordinates from its second body's displacement relative to its first."""
    if not joint.type.free:
        return np.zeros((len(across), 0))
    if joint.type.is_ball:
        return rotation_vector(across)
    x, y, z = joint.axes.T
    if joint.cross:
        second = joint.cross[1]
        image = across @ second
        back = across.mT @ x
        side = np.cross(x, second)
        first_angle = np.arctan2(image @ side, image @ np.cross(side, x))
        second_angle = np.arctan2(back @ side, back @ np.cross(second, side))
        return np.stack([first_angle, second_angle], axis=-1)
    angle = np.arctan2((across @ y) @ z, (across @ y) @ y)
    along = (gap @ x, gap @ y, gap @ z, angle)
    values = [along[k] for k in joint.type.free]
    return np.stack(np.broadcast_arrays(*values), axis=-1)


def _find_links(mechanism: Mechanism) -> tuple[dict[str, int], int]:
    """Return the rigid link of every node: fixed joints and elastic bodies merge their nodes."""
    names = [GROUND, *(b.name for b in mechanism.bodies)]
    group = {name: k for k, name in enumerate(names)}
    for j in mechanism.joints:
        if j.kind == "fixed":
            a = group[mechanism.carrier(j.first)]
            b = group[mechanism.carrier(j.second)]
            group = {name: a if k == b else k for name, k in group.items()}
    order = {k: i for i, k in enumerate(dict.fromkeys(group.values()))}
    link = {name: order[k] for name, k in group.items()}
    nodes = {node: link[b.name] for b in mechanism.bodies for node in b.nodes}
    return {GROUND: link[GROUND], **nodes}, len(order)


def _measure_length(mechanism: Mechanism) -> float:
    """Return the characteristic length in m: the diagonal of the box around joints and tool."""
    points = np.array([mechanism.tool.at, *(j.at for j in mechanism.joints)])
    return float(np.linalg.norm(np.ptp(points, axis=0))) or 1.0


def rotation_sine(rotation: Array) -> Array:
    """Return the sine of the angle times the axis (..., 3) of rotations (..., 3, 3)."""
    twice = rotation - rotation.mT
    return 0.5 * np.stack(
        [twice[..., 2, 1], twice[..., 0, 2], twice[..., 1, 0]], axis=-1
    )


def rotation_vector(rotation: Array) -> Array:
    """Return the rotation vector (..., 3) in rad, at most π long, of rotations (..., 3, 3)."""
    s = rotation_sine(rotation)
    sine: Array = np.linalg.norm(s, axis=-1)
    cosine = 0.5 * (np.einsum("...ii->...", rotation) - 1.0)
    angle = np.arctan2(sine, cosine)
    near = sine < 1e-4  # no rotation or a half turn: its axis is in the symmetric part
    factor = angle / np.where(sine > 0.0, sine, 1.0)
    factor = np.where(near & (cosine > 0.0), 1.0 + angle**2 / 6.0, factor)
    vector: Array = s * factor[..., None]
    half = near & (cosine < 0.0)
    if half.any():
        r = rotation[half]
        outer = 0.5 * (r + r.mT) + np.eye(3) * (-cosine[half])[..., None, None]
        best = np.argmax(np.einsum("...ii->...i", outer), axis=-1)
        axis = np.take_along_axis(outer, best[..., None, None], axis=-1)[..., 0]
        axis = axis / np.linalg.norm(axis, axis=-1, keepdims=True)
        flip = np.where(np.einsum("...i,...i", axis, s[half]) < 0.0, -1.0, 1.0)
        vector[half] = axis * (flip * angle[half])[..., None]
    return vector


def left_jacobian(vector: Array) -> Array:
    """Return angular velocity, fixed axes, per rate of a rotation vector (..., 3); (..., 3, 3)."""
    square = np.einsum("...i,...i", vector, vector)[..., None, None]
    angle = np.sqrt(square)
    s = skew(vector)
    half = np.sinc(angle / (2.0 * np.pi))
    small = square < 1e-2
    safe = np.where(small, 1.0, angle)
    series = 1.0 / 6.0 - square / 120.0 * (1.0 - square / 42.0 * (1.0 - square / 72.0))
    third = np.where(small, series, (safe - np.sin(safe)) / safe**3)
    return np.eye(3) + 0.5 * half**2 * s + third * (s @ s)
