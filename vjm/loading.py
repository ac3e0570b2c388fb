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
    chain,
    condensed,
    regained,
    stacked,
    tool_stiffness,
)
from stiffscope.vjm.mechanism import GROUND
from stiffscope.vjm.network import END, free_directions
from stiffscope.vjm.semidefinite import pivoted

if TYPE_CHECKING:
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
        return np.swapaxes(self.where.frame(self.element).adjoint(), -1, -2) @ self.carried

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

        moved, states = saddle_response(state)
    else:
        stiffness = tool_stiffness(state)
        moved, states = {GROUND: np.zeros((1, 6, loads.cases)), END: yielded(stiffness, state.force(END))}, []
    out = Response(where, moved[END], moved)
    for along, carried, span, rates in states:
        _walk(state, out, along, carried, span, rates)
    for step, kept in zip(reversed(order.steps), reversed(state.done), strict=True):
        match step:
            case Stiffen():
                _recover_stiff(state, out, kept)
            case Eliminate():
                _recover_eliminated(out, step, kept)
            case Fold():
                _recover_folded(state, out, step, kept)
    for c in order.loops:
        _recover_loop(state, out, chain(state, c))
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


def _recover_stiff(state: Condensed, out: Response, kept: tuple[Chain, Array, Array]) -> None:
    along, stiffness, preload = kept
    c = along.connection
    span = out.nodes[c.end] - out.nodes[c.start]
    _walk(state, out, along, stiffness @ span + preload, span, None)


def _recover_eliminated(out: Response, step: Eliminate, kept: tuple[Array, list[Array], Array | None]) -> None:
    half, reach, push = kept
    moved: Array | float = 0.0 if push is None else push
    for c, r in zip(step.neighbours, reach, strict=True):
        moved = moved + r @ out.nodes[c]
    out.nodes[step.node] = np.swapaxes(half, -1, -2) @ moved


def _recover_folded(
    state: Condensed, out: Response, step: Fold, kept: tuple[Chain, Array, Array, Array, dict[str, Array], Array]
) -> None:
    along, b, share, y, around, force = kept
    start = out.nodes[step.connection.start]
    for c in step.neighbours:
        y = y + share @ (around[c] @ (out.nodes[c] - start))
    span = along.offset + b @ y
    node = start + span
    wrench = force
    for c in step.neighbours:
        wrench = wrench + around[c] @ (out.nodes[c] - node)
    out.nodes[step.node] = node
    count = sum(e.factor.shape[1] for e, _ in step.connection.members)
    _walk(state, out, along, wrench, span, y[:, count:])


def _recover_loop(state: Condensed, out: Response, along: Chain) -> None:
    """A connection from a node to itself carries only what its misfits and the loads on its nodes make of it."""
    c = along.connection
    start = out.nodes[c.start]
    factor, free = c.flexible(state.where)
    zero = np.zeros_like(start)
    if factor.shape[2] + free.shape[2] >= 6:
        from stiffscope.vjm.condensation import own_stiffness, preload_of

        own = own_stiffness(c, state.where, state.order.length, rigid=False)
        _walk(state, out, along, preload_of(state, c, along, own) + zero, zero, None)
    else:
        _walk(state, out, along, zero, zero, None)


def _walk(state: Condensed, out: Response, along: Chain, wrench: Array, span: Array, rates: Array | None) -> None:
    """Carry wrench and twist along a connection whose end, moved by ``span``, carries ``wrench``."""
    c, where = along.connection, state.where
    carried = [wrench + load for load in along.carried]
    elastic: list[Array] = []
    columns: list[Array] = []
    for (e, sign), w in zip(c.members, carried, strict=True):
        carry = where.frame(e).adjoint()
        f = carry @ where.factor(e)
        part = f @ (np.swapaxes(f, -1, -2) @ w) if f.shape[2] else np.zeros((1, 6, 1))
        if state.loads is not None and e.name in state.loads.offsets:
            part = part + carry @ (sign * state.loads.offsets[e.name])
        elastic.append(part)
        columns.append(carry @ free_directions(e, where) if e.free.shape[1] else np.zeros((1, 6, 0)))
    if rates is None:
        free = stacked(columns)
        rest = span - sum(elastic, np.zeros((1, 6, 1)))
        rates = regained(free, state.order.length) @ rest if free.shape[2] else np.zeros((1, 0, 1))
    node, at = out.nodes[c.start], 0
    for k, ((e, sign), w, part, free) in enumerate(zip(c.members, carried, elastic, columns, strict=True)):
        rate = rates[:, at : at + free.shape[2]]
        at += free.shape[2]
        across = part + free @ rate
        across = np.broadcast_to(across, np.broadcast_shapes(across.shape, w.shape))
        out.elements[e.name] = ElementState(e, where, sign * w, sign * across, sign * rate)
        node = node + across
        if k < len(c.members) - 1:
            out.nodes[c.inner[k]] = node
