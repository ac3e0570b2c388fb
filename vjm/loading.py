"""What every element of a mechanism carries and how far every node moves, under wrenches at the tool or at any body."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.errors import InputError
from stiffscope.vjm.condensation import (
    Chain,
    Condensed,
    Eliminate,
    Fold,
    Loads,
    Stiffen,
    condensed,
    regained,
    stacked,
    tool_stiffness,
)
from stiffscope.vjm.mechanism import GROUND
from stiffscope.vjm.network import END, free_directions
from stiffscope.vjm.semidefinite import pivoted

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stiffscope.vjm.condensation import Order
    from stiffscope.vjm.network import Element, Places
    from stiffscope.vjm.screws import Array

_FREE = 1e-12  # relative pivot of the tool's stiffness that is rounding
_BALANCED = 1e-6  # of a load, that may be left where the tool moves freely


@dataclass(eq=False)
class ElementState:
    """An element under c cases: ``across`` (n, 6, c), twist of its second node against its first, and ``carried``
    (n, 6, c), wrench on its second node's side, both at M in base axes.
    """

    element: Element
    where: Places
    carried: Array
    across: Array
    rates: Array
    """(n, k, c): motion along each of its free directions."""

    @cached_property
    def wrench(self) -> Array:
        """Wrench (n, 6, c) that it carries, at its own point in its own axes."""
        return np.swapaxes(self.where.adjoint(self.element), -1, -2) @ self.carried

    @cached_property
    def twist(self) -> Array:
        """Twist (n, 6, c) across it, at its own point in its own axes."""
        return self.where.frame(self.element).inverse_adjoint() @ self.across

    @cached_property
    def energy(self) -> Array:
        """Strain energy (n, c) in J."""
        stress = self.element.factor.T @ self.wrench
        return 0.5 * np.einsum("nrc,nrc->nc", stress, stress)


@dataclass(eq=False)
class Response:
    """``twist`` (n, 6, c) of the tool at M in base axes, m and rad, and all that leads to it.

    ``nodes``: twists (n, 6, c) of every node at M in base axes; ``elements``: the state of every element by name.
    """

    where: Places
    twist: Array
    nodes: dict[str, Array] = field(default_factory=dict[Any, Any])
    elements: dict[str, ElementState] = field(default_factory=dict[Any, Any])


def loaded(order: Order, where: Places, wrench: Array, loads: Loads) -> Response:
    """Equilibrium under wrenches (n or 1, 6, c) at M, and loads on nodes and offsets (which this changes in no way).

    Raises InputError where the tool moves freely under its load.
    """
    nodes = {node: w for node, w in loads.nodes.items() if node != GROUND}
    nodes[END] = nodes[END] + wrench if END in nodes else wrench
    state = condensed(order, where, Loads(loads.cases, nodes, loads.offsets))
    if order.left:
        from stiffscope.vjm.saddle import saddle_response

        return recovered(state, *saddle_response(state))
    ends = {GROUND: np.zeros((1, 6, loads.cases)), END: yielded(tool_stiffness(state), state.force(END))}
    return recovered(state, ends)


def recovered(
    state: Condensed,
    ends: dict[str, Array],
    left: Sequence[tuple[Chain, Array, Array, Array]] = (),
    mix: Array | None = None,
) -> Response:
    """Twists (n, 6, c) of all nodes and states of all elements from those of the nodes that were not condensed.

    ``left``: connections that were not, with wrench, twist across and rates. ``mix`` (c₀, c): how much of each of the
    condensed load cases is in each of these.
    """
    out = Response(state.where, ends[END], ends)
    cases = state.loads.cases if state.loads else 0
    share = np.eye(cases) if mix is None else mix
    for along, carried, span, rates in left:
        _walk(state, out, along, carried, span, rates, share)
    for step, kept in zip(reversed(state.order.steps), reversed(state.done), strict=True):
        match step:
            case Stiffen():
                along, stiffness, preload = kept
                span = out.nodes[along.connection.end] - out.nodes[along.connection.start]
                _walk(state, out, along, stiffness @ span + preload @ share, span, None, share)
            case Eliminate():
                _recover_eliminated(out, step, kept, share)
            case Fold():
                _recover_folded(state, out, step, kept, share)
    return out


def yielded(stiffness: Array, wrench: Array) -> Array:
    """Twist (n, 6, c) of a stiffness (n or 1, 6, 6) under wrenches (n or 1, 6, c).

    Raises InputError where a wrench acts along a free direction.
    """
    half, pivots = pivoted(stiffness, _FREE)
    twist = np.swapaxes(half, -1, -2) @ (half @ wrench)
    if (pivots <= _FREE).any():
        left = np.abs(stiffness @ twist - wrench)
        if (left > _BALANCED * np.abs(wrench).max(axis=1, keepdims=True)).any():
            count = int((pivots <= _FREE).sum(axis=1).max())
            raise InputError(
                f"the tool moves freely in {count} direction(s): ask for its mobility, not for its deflection"
            )
    return twist


def _recover_eliminated(
    out: Response, step: Eliminate, kept: tuple[Array, list[Array], Array | None], share: Array
) -> None:
    half, reach, push = kept
    moved = np.zeros((1, 6, 1)) if push is None else push @ share
    for c, r in zip(step.neighbours, reach, strict=True):
        moved = moved + r @ out.nodes[c]
    out.nodes[step.node] = np.swapaxes(half, -1, -2) @ moved


def _recover_folded(
    state: Condensed,
    out: Response,
    step: Fold,
    kept: tuple[Chain, Array, Array, Array, dict[str, Array], Array],
    share: Array,
) -> None:
    along, b, weight, y, around, force = kept
    start = out.nodes[step.connection.start]
    y = y @ share
    for c in step.neighbours:
        y = y + weight @ (around[c] @ (out.nodes[c] - start))
    span = along.offset @ share + b @ y
    node = start + span
    wrench = force @ share
    for c in step.neighbours:
        wrench = wrench + around[c] @ (out.nodes[c] - node)
    out.nodes[step.node] = node
    count = sum(e.factor.shape[1] for e, _ in step.connection.members)
    _walk(state, out, along, wrench, span, y[:, count:], share)


def _walk(
    state: Condensed, out: Response, along: Chain, wrench: Array, span: Array, rates: Array | None, share: Array
) -> None:
    """Carry wrench and twist along a connection whose end, moved by ``span``, carries ``wrench``."""
    c, where = along.connection, state.where
    carried = [wrench + load @ share if load.any() else wrench for load in along.carried]
    elastic: list[Array | None] = []
    columns: list[Array] = []
    for (e, sign), w in zip(c.members, carried, strict=True):
        part = None
        if e.factor.shape[1]:
            f = where.adjoint(e) @ where.factor(e)
            part = f @ (np.swapaxes(f, -1, -2) @ w)
        if state.loads is not None and e.name in state.loads.offsets:
            offset = where.adjoint(e) @ (sign * state.loads.offsets[e.name] @ share)
            part = offset if part is None else part + offset
        elastic.append(part)
        columns.append(where.adjoint(e) @ free_directions(e, where) if e.free.shape[1] else np.zeros((1, 6, 0)))
    if rates is None and any(n.shape[2] for n in columns):
        rest = span - sum(part for part in elastic if part is not None)
        rates = regained(stacked(columns), state.order.length) @ rest
    node, at = out.nodes[c.start], 0
    for k, ((e, sign), w, part, free) in enumerate(zip(c.members, carried, elastic, columns, strict=True)):
        across = np.zeros((1, 6, w.shape[2])) if part is None else part
        rate = np.zeros((1, 0, w.shape[2]))
        if rates is not None and free.shape[2]:
            rate = rates[:, at : at + free.shape[2]]
            at += free.shape[2]
            across = across + free @ rate
        out.elements[e.name] = ElementState(e, where, sign * w, sign * across, sign * rate)
        if part is not None or free.shape[2]:
            node = node + across
        if k < len(c.members) - 1:
            out.nodes[c.inner[k]] = node
