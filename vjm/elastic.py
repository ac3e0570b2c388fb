"""The elements that a robot is composed of.

A robot at given poses is a tree of named nodes. Leaves are 6-dof springs, passive joints and weights; groups are
``Series`` (from base to tip) and ``Parallel``. Every node stands in its group's coordinates by a ``Frame``; what has no
stack axis does not depend on the pose and is reduced once (``stiffscope.vjm.reduction``).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from stiffscope.errors import InputError
from stiffscope.vjm.checks import checked_compliance
from stiffscope.vjm.screws import Frame

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from stiffscope.vjm.screws import Array

HERE = Frame()
_ORTHONORMAL = 1e-9


@dataclass(frozen=True)
class Spring:
    """A 6-dof virtual spring: its end moves by ``compliance @ wrench`` against its base, plus ``offset``.

    ``compliance`` (..., 6, 6), symmetric, may be singular or zero; ``offset`` (..., 6) is the twist of the unloaded end
    (lack of fit, heat, encoder error). Both at the frame's origin, in its axes. Raises InputError, as all elements do,
    for another shape, what is not finite, and what holds for all poses and is asymmetric or indefinite.
    """

    name: str
    compliance: Array
    frame: Frame = HERE
    offset: Array | None = None

    def __post_init__(self) -> None:
        _check_array(self.compliance, self.name, "a compliance (..., 6, 6)", self.compliance.shape[-2:] == (6, 6))
        if self.compliance.ndim == 2 and self.compliance.any():
            object.__setattr__(self, "compliance", checked_compliance(self.compliance, self.name, semidefinite=True))
        if self.offset is not None:
            _check_array(self.offset, self.name, "an offset (..., 6)", self.offset.shape[-1:] == (6,))
        _check_place(self)

    @property
    def rigid(self) -> bool:
        """True where the spring neither yields nor moves: a place at which an edit may put something."""
        return self.offset is None and self.compliance.size > 0 and not self.compliance.any()


@dataclass(frozen=True)
class Passive:
    """A passive joint: its end moves freely along the columns of ``directions`` (..., 6, k), twists in its frame."""

    name: str
    directions: Array
    frame: Frame = HERE

    def __post_init__(self) -> None:
        _check_array(self.directions, self.name, "free directions (..., 6, k)", self.directions.shape[-2:-1] == (6,))
        _check_place(self)


@dataclass(frozen=True)
class Weight:
    """A mass in kg fixed to the body at this place of a series, its centre at the frame's origin."""

    name: str
    mass: float
    frame: Frame = HERE

    def __post_init__(self) -> None:
        if not 0.0 <= self.mass < np.inf:
            msg = f"{self.name}: expected a mass of at least 0 kg, got {self.mass}"
            raise InputError(msg)
        _check_place(self)


@dataclass(frozen=True)
class Series:
    """Members from base to tip, each fixed to the end of the one before."""

    name: str
    members: tuple[Node, ...]
    frame: Frame = HERE

    def __post_init__(self) -> None:
        _check_place(self)


@dataclass(frozen=True)
class Parallel:
    """Members that connect the same two bodies."""

    name: str
    members: tuple[Node, ...]
    frame: Frame = HERE

    def __post_init__(self) -> None:
        _check_place(self)


Node: TypeAlias = "Spring | Passive | Weight | Series | Parallel"


def _check_array(array: Array, name: str, expected: str, fits: bool) -> None:
    if not fits:
        msg = f"{name}: expected {expected}, got shape {array.shape}"
        raise InputError(msg)
    if not np.isfinite(array).all():
        msg = f"{name}: expected {expected} of finite numbers, got {array[~np.isfinite(array)][0]}"
        raise InputError(msg)


def _check_place(node: Node) -> None:
    """Frames of a stack are taken as they are; a group needs members."""
    rotation, translation = node.frame.rotation, node.frame.translation
    if (
        rotation is not None
        and rotation.ndim == 2
        and not np.allclose(rotation @ rotation.T, np.eye(3), rtol=0.0, atol=_ORTHONORMAL)
    ):
        msg = f"{node.name}: expected a frame with a rotation (3, 3), orthonormal, got {rotation.tolist()}"
        raise InputError(msg)
    if translation is not None:
        _check_array(translation, node.name, "a frame with a translation (..., 3)", translation.shape[-1:] == (3,))
    if isinstance(node, Series | Parallel) and not node.members:
        msg = f"{node.name}: expected at least one member"
        raise InputError(msg)


def _check_unit(vector: Array, name: str, what: str) -> None:
    """Raise InputError unless an axis, or one half of a twist, is of unit length."""
    if not (np.abs(np.linalg.norm(vector.reshape(-1, 3), axis=1) - 1.0) < _ORTHONORMAL).any():
        msg = f"{name}: expected {what} of length 1, got {vector.tolist()}"
        raise InputError(msg)


def drive(name: str, stiffness: float, direction: Array, offset: float = 0.0) -> Spring:
    """Scalar spring of ``stiffness`` in N/m along the unit twist ``direction`` (6,); ``offset`` in m moves its zero.

    A drive that turns, in N·m/rad, has a twist of unit rotation.
    """
    if not 0.0 < stiffness < np.inf:
        msg = f"{name}: a drive's stiffness must be positive, got {stiffness}"
        raise InputError(msg)
    _check_unit(direction, name, "a direction")
    return Spring(name, np.outer(direction, direction) / stiffness, offset=direction * offset if offset else None)


def revolute(name: str, axis: Array, frame: Frame = HERE) -> Passive:
    """Passive revolute joint about the unit ``axis`` (3,) through the frame's origin."""
    _check_unit(axis, name, "an axis")
    return Passive(name, np.concatenate([np.zeros(3), axis])[:, None], frame)


def spherical(name: str, frame: Frame = HERE) -> Passive:
    """Passive spherical joint at the frame's origin."""
    return Passive(name, np.eye(6)[:, 3:], frame)


def leaves(node: Node) -> Iterator[Spring | Passive | Weight]:
    """Springs, joints and weights of a tree, from base to tip."""
    if isinstance(node, Series | Parallel):
        for member in node.members:
            yield from leaves(member)
    else:
        yield node


def named(node: Node, name: str) -> Node:
    """The node of a tree with this name. Raises InputError where there is none."""
    found: list[Node] = []

    def take(hit: Node) -> Node:
        found.append(hit)
        return hit

    edited(node, name, take)
    return found[0]


def edited(node: Node, name: str, change: Callable[[Node], Node]) -> Node:
    """The tree with its node ``name`` replaced by ``change(node)``; a tree is never changed in place."""
    tree, hits = _edited(node, name, change)
    if not hits:
        msg = f"no element {name!r} in {node.name!r}; it has {', '.join(sorted(leaf.name for leaf in leaves(node)))}"
        raise InputError(msg)
    return tree


def _edited(node: Node, name: str, change: Callable[[Node], Node]) -> tuple[Node, int]:
    if node.name == name:
        return change(node), 1
    if not isinstance(node, Series | Parallel):
        return node, 0
    pairs = [_edited(member, name, change) for member in node.members]
    hits = sum(hit for _, hit in pairs)
    return (replace(node, members=tuple(member for member, _ in pairs)), hits) if hits else (node, 0)
