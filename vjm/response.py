"""What every element of a robot carries and how far it moves, for wrenches at the tool and for loads inside."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from stiffscope import InputError
from vjm.elastic import Parallel, Series, Spring
from vjm.reduction import (
    Flexible,
    Stiff,
    behind_springs,
    free_motion,
    in_series,
    joined,
    own_form,
    placed,
    reduced,
    released,
    stiffened,
)
from vjm.screws import Frame

if TYPE_CHECKING:
    from vjm.elastic import Node, Passive, Weight
    from vjm.reduction import Joined
    from vjm.screws import Array


@dataclass(frozen=True)
class Element:
    """State of a spring, joint or weight under c cases.

    ``wrench`` (..., 6, c): carried by its end, and ``twist`` (..., 6, c): of its end against its base, both at its
    own origin in its own axes; ``base`` (..., 6, c): twist of the body it stands on, and ``frame``: its place, both
    seen from the tool point M.
    """

    node: Spring | Passive | Weight
    frame: Frame
    wrench: Array
    twist: Array
    base: Array


@dataclass(frozen=True)
class Response:
    """``twist`` (..., 6, c) of the tool under ``wrench`` (..., 6, c), and the state of every element by name."""

    wrench: Array
    twist: Array
    elements: dict[str, Element]


def respond(tree: Node, wrench: Array, *, gravity: float = 0.0, misfit: bool = False) -> Response:
    """Equilibrium of a robot under wrenches (..., 6, c) at M in axes {O}.

    ``gravity`` in m/s² along +z loads every weight, ``misfit`` lets every spring's offset act; both in every case.
    Raises InputError where the tool can move freely.
    """
    form = reduced(tree, loads=True)
    load = np.zeros((4, wrench.shape[-1]))
    load[2], load[3] = gravity, float(misfit)
    twist = _end_twist(form, wrench, load)
    spread = _Spread({})
    spread.node(tree, Frame(), wrench, twist, load, np.zeros_like(twist))
    return Response(wrench, twist, spread.elements)


def tool_twist(tree: Node, *, gravity: float = 0.0, misfit: bool = False) -> Array:
    """Twist (..., 6) of the unloaded tool under the robot's own weights and misfits. Raises as ``respond``."""
    load = np.array([0.0, 0.0, gravity, float(misfit)])[:, None]
    return _end_twist(reduced(tree, loads=True), np.zeros((6, 1)), load)[..., 0]


def _end_twist(form: Flexible | Stiff, wrench: Array, load: Array) -> Array:
    if isinstance(form, Stiff):
        try:
            return np.linalg.solve(form.stiffness, wrench - form.preload @ load)
        except np.linalg.LinAlgError:
            msg = "the tool moves freely in at least one direction: ask for its mobility, not for its deflection"
            raise InputError(msg) from None
    if form.free.shape[-1]:
        msg = f"the tool moves freely in {form.free.shape[-1]} directions: a chain with passive joints must be closed"
        raise InputError(msg)
    return form.compliance @ wrench + form.offset @ load


@dataclass(frozen=True)
class _Spread:
    """Carries wrench and twist from the tool down to every element."""

    elements: dict[str, Element]

    def node(self, node: Node, outer: Frame, wrench: Array, twist: Array, load: Array, base: Array) -> None:
        """One node: ``wrench``, ``twist`` and gravity are its parent's, ``base`` is seen from M."""
        frame = outer
        if not node.frame.identity:
            frame = outer.then(node.frame)
            wrench = np.swapaxes(node.frame.adjoint(), -1, -2) @ wrench
            twist = node.frame.inverse_adjoint() @ twist
            gravity = np.swapaxes(node.frame.matrix(), -1, -2) @ load[..., :3, :]
            misfit = np.broadcast_to(load[..., 3:, :], (*gravity.shape[:-2], 1, gravity.shape[-1]))
            load = np.concatenate([gravity, misfit], axis=-2)
        if isinstance(node, Series):
            self.series(node, frame, wrench, twist, load, base)
        elif isinstance(node, Parallel):
            for member in node.members:
                form = placed(stiffened(own_form(member, loads=True), member.name), member.frame)
                self.node(member, frame, form.stiffness @ twist + form.preload @ load, twist, load, base)
        else:
            self.elements[node.name] = Element(node, frame, wrench, twist, base)

    def series(self, series: Series, frame: Frame, wrench: Array, twist: Array, load: Array, base: Array) -> None:
        """Members of a series: their twists add up to the whole, each carries the loads of those after it."""
        parts = joined(series, loads=True)
        q, across = _shares(parts, wrench, twist, load)
        ahead = wrench  # wrench on the end of the member at hand
        steps: list[tuple[Node, Array, Array]] = []
        for member in reversed(series.members):
            form = reduced(member, loads=True)
            if isinstance(form, Stiff):
                step = across.pop(0)
            else:
                k = form.free.shape[-1]
                step = form.compliance @ ahead + form.free @ q[..., :k, :] + form.offset @ load
                q = q[..., k:, :]
            steps.append((member, ahead, step))
            ahead = ahead + form.load @ load
        to_tool = frame.adjoint()
        for member, at_end, step in reversed(steps):
            self.node(member, frame, at_end, step, load, base)
            base = base + to_tool @ step


def _shares(parts: Joined, wrench: Array, twist: Array, load: Array) -> tuple[Array, list[Array]]:
    """Motion q (..., k, c) of the free directions of a series, and the twist across each stiff member, tip first."""
    flexible = parts.flexible
    known = flexible.compliance @ wrench + flexible.offset @ load
    free_t = np.swapaxes(flexible.free, -1, -2)
    if not parts.stiff:
        return released(free_t @ flexible.free) @ (free_t @ (twist - known)), []
    stiffness, preload = behind_springs(in_series(parts.stiff), flexible)
    pull, release, slack = free_motion(stiffness, preload, flexible)
    q = release @ (np.swapaxes(pull, -1, -2) @ twist + slack @ load)
    rest = twist - known - flexible.free @ q
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
