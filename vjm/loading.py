"""Loads on a condensed network: carried to the tool step by step; what every element carries, recovered from there."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.errors import InputError
from stiffscope.vjm.checks import GROUND
from stiffscope.vjm.condensation import Eliminated, Folded, Stiff
from stiffscope.vjm.joints import DRIVEN
from stiffscope.vjm.network import END
from stiffscope.vjm.semidefinite import pivot

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stiffscope.vjm.condensation import Condensed
    from stiffscope.vjm.joints import Law
    from stiffscope.vjm.network import Element, Places
    from stiffscope.vjm.order import Connection
    from stiffscope.vjm.screws import Array

_FREE = 1e-12  # relative pivot of the tool's stiffness that is rounding
HELD = 1e12  # `balanced` where friction holds whatever motion does not move the tool
_SLIGHT = 1e-2  # of a load, that friction may hold along a motion which does not move the tool
_BALANCED = 1e-6  # of a load, that may be left along a free motion of the tool


@dataclass(eq=False)
class Loads:
    """``cases`` of wrenches (n or 1, 6, c) on nodes at M in base axes, and of elements' offsets in their own axes.

    ``balanced``: share of a load that may be left along an idle motion. ``HELD`` once nodes are bent: a rod between
    balls whose weight then acts beside the line through them is held by their friction.
    """

    cases: int
    nodes: dict[str, Array] = field(default_factory=dict[Any, Any])
    offsets: dict[str, Array] = field(default_factory=dict[Any, Any])
    balanced: float = _SLIGHT


@dataclass(eq=False)
class ChainLoads:
    """Loads along a connection: at M in base axes."""

    connection: Connection
    carried: list[Array]
    """Wrenches (n or 1, 6, c) on each member's end by the loads on the nodes after it, from the start."""
    total: Array
    """Of all loads on its inner nodes (n or 1, 6, c)."""
    offset: Array
    """Twist (n or 1, 6, c) of its end against its start by its members' offsets."""


@dataclass(eq=False)
class CondensedLoads:
    """Loads that were carried to the nodes left: ``forces`` (n or 1, 6, c) on them, and what each step has kept."""

    loads: Loads
    forces: dict[str, Array]
    kept: list[Any] = field(default_factory=list[Any])

    def add(self, node: str, wrench: Array) -> None:
        """Add a wrench on a node."""
        self.forces[node] = self.forces[node] + wrench if node in self.forces else wrench

    def force(self, node: str) -> Array:
        """Wrench on a node so far."""
        return self.forces.get(node, np.zeros((1, 6, self.loads.cases)))


@dataclass(eq=False)
class ElementState:
    """An element under c cases.

    ``across`` (n, 6, c): twist of its second node against its first; ``carried`` (n, 6, c): wrench on its second node's
    side; both at M in base axes.
    """

    element: Element
    where: Places
    carried: Array
    across: Array
    rates: Array
    """(n, k, c): motion along each of its free directions."""
    strained: Array | None = None
    """What of ``across`` is strain, where the element shares its coordinates and its own wrench alone does not tell."""

    deflection: Array | None = None
    law: Law | None = None
    """Of a drive that is not linear its law, and its deflection (n, c)."""

    @cached_property
    def wrench(self) -> Array:
        """Wrench (n, 6, c) that it carries, at its own point in its own axes."""
        return np.swapaxes(self.where.adjoint(self.element), -1, -2) @ self.carried

    @cached_property
    def twist(self) -> Array:
        """Twist (n, 6, c) across it, at its own point in its own axes."""
        return self.where.frame(self.element).inverse_adjoint() @ self.across

    @property
    def motions(self) -> Array:
        """Motion (n, k, c) along each free direction of its joint, those that springs resist among them."""
        joint = self.element.joint
        if joint is None or joint.spring is None:
            return self.rates
        if joint.kind in DRIVEN:
            along = DRIVEN[joint.kind]
            return self.wrench[:, along : along + 1] / joint.spring
        factor = self.where.factor(self.element)[..., -self.element.sprung :]
        return np.swapaxes(factor, -1, -2) @ self.wrench / np.sqrt(joint.spring)

    @cached_property
    def energy(self) -> Array:
        """Strain energy (n, c) in J; of elements that share theirs the sum of all is the body's."""
        if self.strained is not None:
            return 0.5 * np.einsum("nic,nic->nc", self.carried, self.strained)
        stress = np.swapaxes(self.where.factor(self.element), -1, -2) @ self.wrench
        energy = 0.5 * np.einsum("nrc,nrc->nc", stress, stress)
        if self.law is not None and self.deflection is not None:  # in place of the linear spring's
            force = self.law.force(self.deflection)
            energy = energy - 0.5 * force**2 / self.law.slopes[0] + self.law.energy(self.deflection)
        return energy


@dataclass(eq=False)
class Response:
    """``twist`` (n, 6, c) of the tool at M in base axes, m and rad, and all that leads to it.

    ``nodes``: twists (n, 6, c) of every node at M in base axes; ``elements``: the state of every element by name.
    """

    where: Places
    twist: Array
    nodes: dict[str, Array] = field(default_factory=dict[Any, Any])
    elements: dict[str, ElementState] = field(default_factory=dict[Any, Any])

    def find_wrench(self, rows: Sequence[str]) -> Array:
        """Wrenches (n, 6m, c) that m elements carry, each at its own point in its own axes."""
        return stack_rows([self.elements[name].wrench for name in rows])

    @property
    def energies(self) -> dict[str, Array]:
        """Strain energy (n, c) in J of every joint and body that yields."""
        out: dict[str, Array] = {}
        for name, state in self.elements.items():
            if state.element.factor.shape[1]:
                whole = state.element.group or name
                out[whole] = out[whole] + state.energy if whole in out else state.energy
        return out


def condense_loads(state: Condensed, loads: Loads) -> CondensedLoads:
    """Carry loads through every step of the condensation."""
    out = CondensedLoads(loads, {node: w for node, w in loads.nodes.items() if node != GROUND})
    for gone in state.gone:
        match gone:
            case Stiff():
                out.kept.append(_load_stiff(state, gone, out))
            case Eliminated():
                out.kept.append(_load_eliminated(gone, out))
            case Folded():
                out.kept.append(_load_folded(state, gone, out))
    return out


def store_energy(state: Condensed, load: CondensedLoads) -> Array:
    """Twice the energy (n or 1, c, c) that loads store while the nodes left stand still; none of them an offset."""
    out: Array = np.zeros((1, load.loads.cases, load.loads.cases))
    for gone, kept in zip(state.gone, load.kept, strict=True):
        if isinstance(gone, Folded):
            y: Array = kept[1]
            out = out + np.swapaxes(y, -1, -2) @ gone.core @ y
            continue
        stresses: list[Array] = []
        if isinstance(gone, Eliminated):
            stresses += [] if kept is None else [kept]
        elif any(w.any() for w in kept[0].carried):
            for (e, _), carried in zip(gone.connection.members, kept[0].carried, strict=True):
                factor = state.where.columns(e)[0]
                if factor.shape[2]:
                    stresses.append(np.swapaxes(factor, -1, -2) @ (kept[1] + carried))
        for stress in stresses:
            out = out + np.swapaxes(stress, -1, -2) @ stress
    return out


def recover_response(
    state: Condensed,
    load: CondensedLoads | None,
    ends: dict[str, Array],
    left: Sequence[tuple[Connection, ChainLoads | None, Array, Array, Array]] = (),
    mix: Array | None = None,
) -> Response:
    """Twists (n, 6, c) of all nodes and states of all elements from those of the nodes that were not condensed.

    ``left``: connections that were not, with their loads, wrench, twist across and rates. ``mix`` (c₀, c): how much of
    each of the carried load cases is in each of these.
    """
    out = Response(state.where, ends[END], ends)
    walk = _Walk(state, load, out, mix)
    for connection, along, wrench, span, rates in left:
        if connection.members[0][0].group:
            walk.follow_shared(*connection.members[0], wrench, span)
        else:
            walk.follow_connection(connection, along, wrench, span, rates)
    kept = load.kept if load else [None] * len(state.gone)
    for gone, own in zip(reversed(state.gone), reversed(kept), strict=True):
        match gone:
            case Stiff():
                c = gone.connection
                span = out.nodes[c.end] - out.nodes[c.start]
                wrench = gone.stiffness @ span
                if own:
                    wrench = wrench + walk.mix_cases(own[1])
                walk.follow_connection(c, own[0] if own else None, wrench, span, gone)
            case Eliminated():
                moved = walk.mix_cases(own) if own is not None else np.zeros((1, 6, 1))
                for c, reach in zip(gone.step.neighbours, gone.reach, strict=True):
                    moved = moved + reach @ out.nodes[c]
                out.nodes[gone.step.node] = np.swapaxes(gone.half, -1, -2) @ moved
            case Folded():
                _recover_folded(gone, own, walk)
    return out


def solve_tool(stiffness: Array, wrench: Array) -> Array:
    """Twist (n, 6, c) of a stiffness (n or 1, 6, 6) under wrenches (n or 1, 6, c).

    Raises InputError where a wrench acts along a free direction.
    """
    half, pivots = pivot(stiffness, _FREE)
    twist = np.swapaxes(half, -1, -2) @ (half @ wrench)
    if (pivots <= _FREE).any():
        left = np.abs(stiffness @ twist - wrench)
        if (left > _BALANCED * np.abs(wrench).max(axis=1, keepdims=True)).any():
            count = int((pivots <= _FREE).sum(axis=1).max())
            raise InputError(
                f"the tool moves freely in {count} direction(s): ask for its mobility, not for its deflection"
            )
    return twist


def chain_loads(state: Condensed, load: CondensedLoads, connection: Connection) -> ChainLoads:
    """Loads and offsets along a connection."""
    total: Array = np.zeros((1, 6, load.loads.cases))
    each: list[Array] = [total]
    for node in reversed(connection.inner):
        if node in load.forces:
            total = total + load.forces[node]
        each.insert(0, total)
    offset: Array = np.zeros((1, 6, load.loads.cases))
    for e, sign in connection.members:
        if e.name in load.loads.offsets:
            offset = offset + state.where.adjoint(e) @ (sign * load.loads.offsets[e.name])
    return ChainLoads(connection, each, total, offset)


def _load_stiff(state: Condensed, gone: Stiff, load: CondensedLoads) -> tuple[ChainLoads, Array]:
    c = gone.connection
    along = chain_loads(state, load, c)
    preload: Array = np.zeros((1, 6, load.loads.cases))
    if along.offset.any():
        preload = preload - gone.stiffness @ along.offset
    if any(w.any() for w in along.carried):
        preload = preload + _hold_end(state, gone, along, load.loads.balanced)
    load.add(c.end, -preload)
    load.add(c.start, preload + along.total)
    return along, preload


def _hold_end(state: Condensed, gone: Stiff, along: ChainLoads, balanced: float) -> Array:
    """Wrench (n, 6, c) that holds the end of a connection under the loads on its inner nodes.

    ``w = w₀ - K (τ + C w₀)`` with Nᵀ w₀ = -ν, what the loads would do along the free directions.
    """
    connection, where = gone.connection, state.where
    hold: Array = np.zeros((1, 6, 1))
    if gone.fit is not None:
        work = stack_rows(
            [
                np.swapaxes(where.columns(e)[1], -1, -2) @ wrench
                for (e, _), wrench in zip(connection.members, along.carried, strict=True)
            ]
        )
        hold = -np.swapaxes(gone.fit, -1, -2) @ work
        if balanced < HELD:
            left = np.abs(np.swapaxes(connection.flexible(where)[1], -1, -2) @ hold + work)
            if (left > balanced * np.abs(work).max(axis=(1, 2), keepdims=True)).any():
                _refuse([e.name for e, _ in connection.members])
    tau: Array = np.zeros((1, 6, 1))
    for (e, _), wrench in zip(connection.members, along.carried, strict=True):
        factor = where.columns(e)[0]
        if factor.shape[2]:
            tau = tau + factor @ (np.swapaxes(factor, -1, -2) @ (wrench + hold))
    return hold - gone.stiffness @ tau


def _load_eliminated(gone: Eliminated, load: CondensedLoads) -> Array | None:
    force = load.forces.pop(gone.step.node, None)
    if force is None:
        return None
    push = gone.half @ force
    _check_balance((gone.step.node,), gone.half, gone.own, force, load.loads.balanced)
    for c, reach in zip(gone.step.neighbours, gone.reach, strict=True):
        load.add(c, np.swapaxes(reach, -1, -2) @ push)
    return push


def _load_folded(state: Condensed, gone: Folded, load: CondensedLoads) -> tuple[ChainLoads, Array, Array]:
    connection = gone.step.connection
    along = chain_loads(state, load, connection)
    force = load.force(gone.step.node)
    drive = np.swapaxes(gone.columns, -1, -2) @ (force - gone.own @ along.offset)
    if any(w.any() for w in along.carried):
        drive = drive + project_loads(along, gone.columns)
    y = np.swapaxes(gone.half, -1, -2) @ (gone.half @ drive)
    names = [e.name for e, _ in connection.members]
    _check_balance(names, gone.half, gone.core, drive, load.loads.balanced)
    moved = along.offset + gone.columns @ y  # twist of the node where all others stand still
    load.add(connection.start, force + along.total)
    for c, stiffness in gone.around.items():
        share = np.swapaxes(stiffness, -1, -2) @ moved
        load.add(c, share)
        load.add(connection.start, -share)
    return along, y, force


def project_loads(along: ChainLoads, columns: Array) -> Array:
    """What the loads on a connection's inner nodes do along its coordinates, (n, m, c)."""
    out: list[Array] = []
    at = 0
    sizes = [e.factor.shape[1] for e, _ in along.connection.members]
    sizes += [e.free.shape[1] for e, _ in along.connection.members]
    for size, wrench in zip(sizes, along.carried * 2, strict=True):
        out.append(np.swapaxes(columns[:, :, at : at + size], -1, -2) @ wrench)
        at += size
    return stack_rows(out)


def stack_rows(blocks: list[Array]) -> Array:
    """Concatenate rows (n or 1, r, c) of blocks."""
    n = max(len(b) for b in blocks)
    return np.concatenate([np.broadcast_to(b, (n, *b.shape[1:])) for b in blocks], axis=1)


def _check_balance(names: Sequence[str], half: Array, matrix: Array, load: Array, balanced: float) -> None:
    """Refuse a load along a direction that a generalized inverse has dropped."""
    if balanced >= HELD or not (np.einsum("nii->ni", half) == 0.0).any():
        return
    left = np.abs(load - matrix @ (np.swapaxes(half, -1, -2) @ (half @ load)))
    if (left > balanced * np.abs(load).max(axis=(1, 2), keepdims=True) + 1e-300).any():
        _refuse(names)


def _refuse(names: Sequence[str]) -> None:
    raise InputError(f"{', '.join(names)}: moves freely under its load, there is no equilibrium")


def _recover_folded(gone: Folded, own: tuple[ChainLoads, Array, Array] | None, walk: _Walk) -> None:
    nodes, connection = walk.out.nodes, gone.step.connection
    start = nodes[connection.start]
    y: Array = walk.mix_cases(own[1]) if own else np.zeros((1, gone.columns.shape[2], 1))
    for c, stiffness in gone.around.items():
        y = y + gone.share @ (stiffness @ (nodes[c] - start))
    span = gone.columns @ y
    if own:
        span = span + walk.mix_cases(own[0].offset)
    node = start + span
    wrench: Array = walk.mix_cases(own[2]) if own else np.zeros_like(node)
    for c, stiffness in gone.around.items():
        wrench = wrench + stiffness @ (nodes[c] - node)
    nodes[gone.step.node] = node
    count = sum(e.factor.shape[1] for e, _ in connection.members)
    walk.follow_connection(connection, own[0] if own else None, wrench, span, y[:, count:])


@dataclass(eq=False)
class _Walk:
    """Carries wrenches and twists along connections into a response."""

    state: Condensed
    load: CondensedLoads | None
    out: Response
    mix: Array | None

    def mix_cases(self, cases: Array) -> Array:
        """The carried cases (n, k, c₀) as these cases have them."""
        return cases if self.mix is None else cases @ self.mix

    def follow_connection(
        self, connection: Connection, loads: ChainLoads | None, wrench: Array, span: Array, rates: Array | Stiff
    ) -> None:
        """Members and nodes of a connection whose end, moved by ``span``, carries ``wrench``.

        ``rates`` (n, k, c) of its free motions; of a stiffened one these follow from ``span``.
        """
        where = self.state.where
        offsets = self.load.loads.offsets if self.load else {}
        wrenches: list[Array] = []
        elastic: list[Array | None] = []
        columns: list[Array] = []
        for k, (e, sign) in enumerate(connection.members):
            w = wrench
            if loads is not None and loads.carried[k].any():
                w = wrench + self.mix_cases(loads.carried[k])
            part = None
            f, free = where.columns(e)
            if f.shape[2]:
                part = f @ (np.swapaxes(f, -1, -2) @ w)
            if e.name in offsets:
                offset = where.adjoint(e) @ self.mix_cases(sign * offsets[e.name])
                part = offset if part is None else part + offset
            wrenches.append(w)
            elastic.append(part)
            columns.append(free)
        if isinstance(rates, Stiff):
            rest = span - sum(part for part in elastic if part is not None)
            rates = np.zeros((1, 0, 1)) if rates.fit is None else rates.fit @ rest
        node, at = self.out.nodes[connection.start], 0
        inner = connection.inner
        for k, ((e, sign), w, part, free) in enumerate(
            zip(connection.members, wrenches, elastic, columns, strict=True)
        ):
            across: Array = np.zeros((1, 6, w.shape[2])) if part is None else part
            rate: Array = np.zeros((1, 0, w.shape[2]))
            if free.shape[2]:
                rate = rates[:, at : at + free.shape[2]]
                at += free.shape[2]
                across = across + free @ rate
            self.out.elements[e.name] = ElementState(e, where, sign * w, sign * across, sign * rate)
            if part is not None or free.shape[2]:
                node = node + across
            if k < len(inner):
                self.out.nodes[inner[k]] = node

    def follow_shared(self, e: Element, sign: float, wrench: Array, span: Array) -> None:
        """An element whose own wrench alone does not tell how it strains: all of its twist but the offset."""
        strained, offset = span, self.load.loads.offsets.get(e.name) if self.load else None
        if offset is not None:
            strained = span - self.state.where.adjoint(e) @ self.mix_cases(sign * offset)
        none: Array = np.zeros((1, 0, wrench.shape[2]))
        self.out.elements[e.name] = ElementState(e, self.state.where, sign * wrench, sign * span, none, sign * strained)
