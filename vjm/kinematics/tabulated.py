"""Vectorized motions and equations of a linkage, for few poses, where call overhead dominates.

Every motion is ``1 + a X + b X²`` with X a screw matrix (4, 4); every error of a cut joint is a sum
of one or two terms ``u·(v - w)`` with u, w fixed to its first link and v to its second.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.vjm.model.screws import skew

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from stiffscope.vjm.model.joints import Joint
    from stiffscope.vjm.model.screws import Array

_TINY = 1e-300  # rad²: none
_ONE = np.eye(4)
_AHEAD, _BEHIND = np.array([1, 2, 0]), np.array([2, 0, 1])


@dataclass(frozen=True, eq=False)
class Motion:
    """One motion of a tree joint; ``sign`` is -1 if the tree enters from its second body."""

    kind: str
    axis: Array
    point: Array
    sign: float
    column: int
    parent: int
    child: int

    @cached_property
    def turning(self) -> tuple[Array, Array]:
        """Transposed coefficients (3, 3) of sin and of 1 - cos in the rotation matrix."""
        s = skew(self.axis)
        return (self.sign * s).T, (s @ s).T


@dataclass(frozen=True, eq=False)
class Cut:
    """A cut joint that closes a loop: ``columns`` of the coordinates in the loop, and signs."""

    joint: Joint
    first: int
    second: int
    columns: NDArray[np.intp]
    signs: Array

    @property
    def size(self) -> int:
        """Number of equations."""
        return sum(len(part) for part in self.joint.held_components)


@dataclass(frozen=True, eq=False)
class LoopEquations:
    """Links and equations at n poses; the poses are the leading axis.

    ``frames`` (n, f, 4, 4): displacements from home; ``errors`` (rows, n) of cut joints, lengths
    relative to the mechanism's; at the origin in base axes, ``twists`` (n, m, 6) for unit rates and
    ``wrenches`` (n, rows, 6) that measure errors.
    """

    frames: Array
    errors: Array
    twists: Array
    wrenches: Array


class Table:
    """Pose-independent data of a linkage."""

    def __init__(
        self, motions: Sequence[Motion], cuts: Sequence[Cut], length: float, size: int
    ) -> None:
        generators = np.zeros((len(motions) + 1, 3, 4, 4))
        self.lead = np.array([0, *(motion.column for motion in motions)])
        self.slides = np.array([True, *(m.kind == "P" for m in motions)])[:, None, None]
        parent = np.array([0, *(motion.parent for motion in motions)])
        constants = np.zeros((size, 4, 2))
        coefficients = np.zeros((size, 2, 2))
        frame = np.zeros(size, dtype=int)
        for motion in motions:
            spans = np.eye(3) if motion.kind == "S" else motion.axis[None]
            for k, axis in enumerate(motion.sign * spans):
                column = motion.column + k
                slides = motion.kind == "P"
                if slides:
                    generators[motion.child, k, :3, 3] = axis
                else:
                    generators[motion.child, k, :3, :3] = skew(axis)
                    generators[motion.child, k, :3, 3] = -np.cross(axis, motion.point)
                frame[column] = motion.parent
                constants[column, :3] = np.column_stack([axis, motion.point])
                constants[column, 3, 1] = 1.0
                coefficients[column] = (
                    [[1.0, 0.0], [0.0, 0.0]] if slides else [[0.0, 1.0], [1.0, 0.0]]
                )
        self.balls = np.array([m.child for m in motions if m.kind == "S"], dtype=int)
        self.ball_columns = self.lead[self.balls][:, None] + np.arange(3)
        self.ball_parents = parent[self.balls]
        self.ball_signs = np.array([m.sign for m in motions if m.kind == "S"])[
            :, None, None
        ]
        count = len(self.balls)
        self.turned = np.zeros((size, count))  # which coordinates turn which ball
        self.turned[self.ball_columns, np.arange(count)[:, None]] = 1.0
        spans = np.zeros((size, count, 16))
        spans[self.ball_columns, np.arange(count)[:, None]] = generators[
            self.balls
        ].reshape(count, 3, 16)
        self.generators = spans.reshape(size, 16 * count)
        self.screws = generators[:, 0]
        self.squares = self.screws @ self.screws
        self.ancestors: list[NDArray[np.intp]] = []
        while parent.any():
            self.ancestors.append(parent)
            parent = parent[parent]
        terms = list(_list_terms(cuts, length))
        rows = [row for row, *_ in terms]
        self.home = np.array([const for *_, const in terms])
        self.sums = (np.arange(max(rows, default=-1) + 1)[:, None] == rows).astype(
            float
        )
        self.simple = len(self.sums) == len(terms)
        onto = np.array([v for _, _, _, v, _ in terms]).reshape(-1, 4)
        across = np.zeros((len(terms), 4, 2))
        across[:, :3, 0] = np.array([u for _, _, u, _, _ in terms]).reshape(-1, 3)
        forces = onto[:, 3]  # 1 of lengths, 0 of angles
        across[..., 1] = onto * forces[:, None]
        links = [cut.first for _, cut, *_ in terms] + [
            cut.second for _, cut, *_ in terms
        ]
        self.frame = np.append(frame, np.array(links, dtype=int))
        self.constants = np.concatenate(
            [constants, across, onto[..., None] * [1.0, 0.0]]
        )
        measured = np.zeros((len(terms), 2, 2))
        measured[:, 0, 0] = forces
        measured[:, 1, 1] = 1.0
        self.coefficients = np.concatenate([coefficients, measured])
        self.size = size

    def look(self, q: Array) -> LoopEquations:
        """Return links and equations at coordinates (m, n)."""
        angle = q.take(self.lead, axis=0).T[..., None, None]
        first = np.where(self.slides, angle, np.sin(angle))
        second = 1.0 - np.cos(angle)
        frames: Array = self.screws * first + self.squares * second + _ONE
        rates = _ONE
        if len(self.balls):
            screw = (q.T @ self.generators).reshape(len(angle), -1, 4, 4)
            frames[:, self.balls], rates = _turn_balls(screw, (q * q).T @ self.turned)
        for ancestors in self.ancestors:
            frames = frames.take(ancestors, axis=1) @ frames
        seen: Array = (frames.take(self.frame, axis=1) @ self.constants)[:, :, :3]
        m = self.size
        end = len(self.coefficients)
        along = seen[:, :end, :, 0]
        across = seen[:, m:end, :, 1]
        onto = seen[:, end:, :, 0]
        if len(self.balls):
            turned: Array = frames.take(self.ball_parents, axis=1)[:, :, :3, :3] @ rates
            along[:, self.ball_columns] = self.ball_signs * turned.mT
        at = np.concatenate([seen[:, :m, :, 1], onto], axis=1)
        both = np.concatenate([along, cross(at, along)], axis=2).reshape(
            len(angle), end, 2, 3
        )
        screws = (self.coefficients @ both).reshape(len(angle), end, 6)
        errors: Array = (along[:, m:] * (onto - across)).sum(axis=-1) - self.home
        twists = screws[:, :m]
        wrenches = screws[:, m:]
        if not self.simple:
            errors = errors @ self.sums.T
            wrenches = self.sums @ wrenches
        return LoopEquations(frames, errors.T, twists, wrenches)


def _turn_balls(screw: Array, square: Array) -> tuple[Array, Array]:
    """Return displacements (n, b, 4, 4) by rotation vectors, given as screws and by their squares.

    Also the spins (n, b, 3, 3) for unit rates.
    """
    angle: Array = np.sqrt(square + _TINY)[..., None, None]
    turn: Array = screw @ screw
    sine: Array = np.sin(angle) / angle
    half: Array = 2.0 * (np.sin(0.5 * angle) / angle) ** 2
    third: Array = (1.0 - sine) / (
        angle * angle
    )  # its rounding, times `turn`, is that of 1
    return _ONE + sine * screw + half * turn, (_ONE + half * screw + third * turn)[
        ..., :3, :3
    ]


def _list_terms(
    cuts: Sequence[Cut], length: float
) -> Iterator[tuple[int, Cut, Array, Array, float]]:
    """Yield row number, cut joint, u (3,), v (4,) and constant of every term of all errors."""
    row = 0
    for cut in cuts:
        joint = cut.joint
        (held, turns) = joint.held_components
        (x, y, z) = joint.axes.T
        for k in held:
            yield row, cut, joint.axes[:, k] / length, np.append(joint.at, 1.0), 0.0
            row += 1
        if joint.cross:
            pairs = [[joint.cross]]
        elif len(turns) == 2:
            pairs = [[(-z, x)], [(y, x)]]
        else:
            pairs = [
                [(0.5 * b, a), (-0.5 * a, b)]
                for a, b in ((y, z), (z, x), (x, y))
                if turns
            ]
        for terms in pairs:
            for u, v in terms:
                yield (
                    row,
                    cut,
                    u,
                    np.append(v, 0.0),
                    float(u @ v) if len(terms) == 1 else 0.0,
                )
            row += 1


def cross(a: Array, b: Array) -> Array:
    """Return cross products of vectors (..., 3)."""
    return a.take(_AHEAD, -1) * b.take(_BEHIND, -1) - a.take(_BEHIND, -1) * b.take(
        _AHEAD, -1
    )
