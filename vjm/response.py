"""What every element of a robot carries and how far it moves, for wrenches at the tool and for loads inside."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.errors import InputError
from stiffscope.vjm.elastic import Passive, Weight
from stiffscope.vjm.reduction import (
    Bundle,
    Chain,
    Leaf,
    Stiff,
    assembled,
    behind_springs,
    free_motion,
    in_series,
    reduced,
    released,
    unit_diagonal,
)
from stiffscope.vjm.screws import Frame

if TYPE_CHECKING:
    from stiffscope.vjm.elastic import Node, Spring
    from stiffscope.vjm.reduction import Assembly, Flexible, Joined
    from stiffscope.vjm.screws import Array


_FREE = 1e-12  # least eigenvalue of a stiffness scaled to a diagonal of ones, below which it is rounding


@dataclass(frozen=True)
class _State:
    """What a group knows of a member: its own frame seen from M, wrench, twist and load in its own axes.

    ``base`` (..., 6, c): twist of the body that the member stands on, seen from M.
    """

    frame: Frame
    wrench: Array
    twist: Array
    load: Array
    base: Array


@dataclass(frozen=True)
class Element:
    """State of a spring, joint or weight under c cases, worked out where it is asked for."""

    node: Spring | Passive | Weight
    group: _State

    @cached_property
    def frame(self) -> Frame:
        """Its place, seen from M."""
        return self.group.frame.then(self.node.frame)

    @cached_property
    def wrench(self) -> Array:
        """Wrench (..., 6, c) carried by its end, at its own origin in its own axes."""
        return np.swapaxes(self.node.frame.adjoint(), -1, -2) @ self.group.wrench

    @cached_property
    def twist(self) -> Array:
        """Twist (..., 6, c) of its end against its base, at its own origin in its own axes."""
        return self.node.frame.inverse_adjoint() @ self.group.twist

    @property
    def base(self) -> Array:
        """Twist (..., 6, c) of the body it stands on, seen from M."""
        return self.group.base


@dataclass(frozen=True)
class Response:
    """``twist`` (..., 6, c) of the tool under ``wrench`` (..., 6, c), and the state of every element by name."""

    wrench: Array
    twist: Array
    elements: dict[str, Element]


def respond(
    robot: Node | Assembly, wrench: Array, *, gravity: float | Array = 0.0, misfit: float | Array = 0.0
) -> Response:
    """Equilibrium of a robot, as a tree or as assembled with loads, under wrenches (..., 6, c) at M in axes {O}.

    ``gravity`` in m/s² along +z loads every weight; every spring's offset acts ``misfit`` times. Both are one for all
    or one a case (c,). Raises InputError where the tool can move freely, and for a name that stands twice.
    """
    whole = robot if isinstance(robot, Leaf | Chain | Bundle) else assembled(robot, loads=True)
    load = np.zeros((4, wrench.shape[-1]))
    load[2], load[3] = gravity, misfit
    twist = _end_twist(whole.form, wrench, load)
    elements: dict[str, Element] = {}
    _spread(whole, _State(Frame(), wrench, twist, load, np.zeros_like(twist)), elements)
    return Response(wrench, twist, elements)


def tool_twist(tree: Node, *, gravity: float = 0.0, misfit: bool = False) -> Array:
    """Twist (..., 6) of the unloaded tool under the robot's own weights and misfits. Raises as ``respond``."""
    load = np.array([0.0, 0.0, gravity, float(misfit)])[:, None]
    return _end_twist(reduced(tree, loads=True), np.zeros((6, 1)), load)[..., 0]


def _end_twist(form: Flexible | Stiff, wrench: Array, load: Array) -> Array:
    if isinstance(form, Stiff):
        if (np.linalg.eigvalsh(form.stiffness * unit_diagonal(form.stiffness))[..., 0] <= _FREE).any():
            msg = "the tool moves freely in at least one direction: ask for its mobility, not for its deflection"
            raise InputError(msg)
        return np.linalg.solve(form.stiffness, wrench - form.preload @ load)
    if form.free.shape[-1]:
        count = int(np.linalg.matrix_rank(form.free).max())
        msg = f"the tool moves freely in {count} directions: a chain with passive joints must be closed"
        raise InputError(msg)
    return form.compliance @ wrench + form.offset @ load


def _spread(whole: Assembly, group: _State, elements: dict[str, Element]) -> None:
    """Carry wrench and twist from the end of a node down to every element."""
    match whole:
        case Leaf():
            if whole.node.name in elements:
                msg = f"{whole.node.name}: two elements have this name; expected one name for each"
                raise InputError(msg)
            elements[whole.node.name] = Element(whole.node, group)
        case Chain():
            _spread_chain(whole, _entered(whole.node.frame, group), elements)
        case Bundle():
            state = _entered(whole.node.frame, group)
            for member, share in zip(whole.members, whole.shares, strict=True):
                wrench = share.stiffness @ state.twist + share.preload @ state.load
                _spread(member, replace(state, wrench=wrench), elements)


def _entered(frame: Frame, outer: _State) -> _State:
    """State in the axes of a group that stands at ``frame``."""
    if frame.identity:
        return outer
    load = outer.load
    if frame.rotation is not None:
        gravity = np.swapaxes(frame.rotation, -1, -2) @ load[..., :3, :]
        misfit = np.broadcast_to(load[..., 3:, :], (*gravity.shape[:-2], 1, gravity.shape[-1]))
        load = np.concatenate([gravity, misfit], axis=-2)
    wrench = np.swapaxes(frame.adjoint(), -1, -2) @ outer.wrench
    return _State(outer.frame.then(frame), wrench, frame.inverse_adjoint() @ outer.twist, load, outer.base)


def _spread_chain(whole: Chain, state: _State, elements: dict[str, Element]) -> None:
    """Members of a series: their twists add up to the whole, each carries the loads of those after it."""
    q, across = _shares(whole.joined, state.wrench, state.twist, state.load)
    ahead = state.wrench  # wrench on the end of the member at hand
    steps: list[tuple[Assembly, Array, Array | None]] = []
    for member in reversed(whole.members):
        form = member.form
        if isinstance(form, Stiff):
            steps.append((member, ahead, across.pop(0)))
        else:
            k = form.free.shape[-1]
            steps.append((member, ahead, _step(member, form, ahead, q[..., :k, :], state.load)))
            q = q[..., k:, :]
        if not isinstance(member, Leaf) or isinstance(member.node, Weight):
            ahead = ahead + form.load @ state.load
    base, still = state.base, np.zeros_like(state.twist)
    for member, at_end, step in reversed(steps):
        _spread(member, replace(state, wrench=at_end, twist=still if step is None else step, base=base), elements)
        if step is not None:
            base = base + (step if state.frame.identity else state.frame.adjoint() @ step)


def _step(member: Assembly, form: Flexible, wrench: Array, q: Array, load: Array) -> Array | None:
    """Twist across a flexible member of a series; None where it cannot move."""
    if isinstance(member, Leaf):
        if isinstance(member.node, Passive):
            return form.free @ q
        if isinstance(member.node, Weight) or member.node.rigid:
            return None
        if member.node.offset is None:
            return form.compliance @ wrench
    return form.compliance @ wrench + form.free @ q + form.offset @ load


def _shares(parts: Joined, wrench: Array, twist: Array, load: Array) -> tuple[Array, list[Array]]:
    """Motion q (..., k, c) of the free directions of a series, and the twist across each stiff member, tip first."""
    flexible = parts.flexible
    known = flexible.compliance @ wrench + flexible.offset @ load
    if not parts.stiff:
        return flexible.regained @ (twist - known), []
    q, rest = np.zeros((0, 1)), twist - known
    if flexible.free.shape[-1]:
        stiffness, preload = behind_springs(in_series(parts.stiff), flexible)
        pull, release, slack = free_motion(stiffness, preload, flexible)
        q = release @ (np.swapaxes(pull, -1, -2) @ twist + slack @ load)
        rest = rest - flexible.free @ q
    across: list[Array] = []
    stiff = list(parts.stiff)
    while len(stiff) > 1:
        first, others = stiff[0], in_series(tuple(stiff[1:]))
        release = released(first.stiffness + others.stiffness)
        share = release @ (others.stiffness @ rest + (others.preload - first.preload) @ load)
        across.append(share)
        rest = rest - share
        stiff.pop(0)
    return q, [*across, rest]
