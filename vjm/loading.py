"""Loads on a condensed network, carried to the tool, and recovery of what every element carries."""

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
from stiffscope.vjm.order import stack_rows
from stiffscope.vjm.semidefinite import pivot

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stiffscope.vjm.condensation import Condensed
    from stiffscope.vjm.joints import Law
    from stiffscope.vjm.network import Element, Places
    from stiffscope.vjm.order import Connection
    from stiffscope.vjm.screws import Array

_FREE = 1e-12  # relative pivot of the tool's stiffness taken as rounding
HELD = 1e12  # value of `balanced` if friction holds all motions that do not move the tool
_SLIGHT = 1e-2  # of a load: friction limit along a motion that does not move the tool
_BALANCED = 1e-6  # of a load: tolerance along a free motion of the tool


@dataclass(eq=False)
class Loads:
    """``cases`` of wrenches (n or 1, 6, c) on nodes at M, base axes, and offsets in element axes.

    ``balanced``: fraction of a load allowed along an idle motion. ``HELD`` once nodes are bent: the
    friction of its balls holds a rod whose weight then acts off the line through them.
    """

    cases: int
    nodes: dict[str, Array] = field(default_factory=dict[Any, Any])
    offsets: dict[str, Array] = field(default_factory=dict[Any, Any])
    balanced: float = _SLIGHT


@dataclass(eq=False)
class ChainLoads:
    """Loads along a connection, at M in base axes."""

    connection: Connection
    carried: list[Array]
    """Wrenches (n or 1, 6, c) on each member's end by the loads on the nodes after it, from the start: first all."""
    moved: list[Array | None]
    """Twists (n or 1, 6, c) of each member by its offset."""
    offset: Array
    """Twist (n or 1, 6, c) of its end relative to its start from its members' offsets."""


@dataclass(eq=False)
class CondensedLoads:
    """Condensed loads: ``forces`` (n or 1, 6, c) on remaining nodes, and data kept by each step."""

    loads: Loads
    forces: dict[str, Array]
    kept: list[Any] = field(default_factory=list[Any])

    def add(self, node: str, wrench: Array) -> None:
        """Add a wrench to a node."""
        self.forces[node] = self.forces[node] + wrench if node in self.forces else wrench

    def force(self, node: str) -> Array:
        """Return the wrench on a node so far."""
        return self.forces.get(node, np.zeros((1, 6, self.loads.cases)))


@dataclass(eq=False)
class ElementState:
    """State of an element in c cases.

    At M in base axes: ``across`` (n, 6, c), twist of its second node relative to its first, and
    ``carried`` (n, 6, c), wrench on its second node's side.
    """

    element: Element
    where: Places
    carried: Array
    across: Array
    rates: Array
    """Motions (n, k, c) along its free directions."""
    strained: Array | None = None
    """Strain part of ``across``, if it shares coordinates: its wrench does not determine it."""

    deflection: Array | None = None
    law: Law | None = None
    """Law of a nonlinear drive, with its deflection (n, c)."""

    @cached_property
    def wrench(self) -> Array:
        """Wrench (n, 6, c) that it carries, at its own point in its own axes."""
        return self.where.adjoint(self.element).mT @ self.carried

    @cached_property
    def twist(self) -> Array:
        """Twist (n, 6, c) across the element, at its point in its axes."""
        return self.where.frame(self.element).inverse_adjoint() @ self.across

    @property
    def motions(self) -> Array:
        """Motions (n, k, c) along its joint's free directions, including those with springs."""
        joint = self.element.joint
        if joint is None or joint.spring is None:
            return self.rates
        if joint.kind in DRIVEN:
            along = DRIVEN[joint.kind]
            return self.wrench[:, along : along + 1] / joint.spring
        factor = self.where.factor(self.element)[..., -self.element.sprung :]
        return factor.mT @ self.wrench / np.sqrt(joint.spring)

    @cached_property
    def energy(self) -> Array:
        """Strain energy (n, c), J; of elements with shared coordinates only the sum counts."""
        if self.strained is not None:
            return 0.5 * np.einsum("nic,nic->nc", self.carried, self.strained)
        stress = self.where.factor(self.element).mT @ self.wrench
        energy = 0.5 * np.einsum("nrc,nrc->nc", stress, stress)
        if self.law is not None and self.deflection is not None:  # replaces the linear spring's
            force = self.law.force(self.deflection)
            energy = energy - 0.5 * force**2 / self.law.slopes[0] + self.law.energy(self.deflection)
        return energy


@dataclass(eq=False)
class Response:
    """Tool ``twist`` (n, 6, c) at M in base axes, m and rad, with nodes and elements.

    ``nodes``: twists (n, 6, c) at M in base axes; ``elements``: state of every element by name.
    """

    where: Places
    twist: Array
    nodes: dict[str, Array] = field(default_factory=dict[Any, Any])
    elements: dict[str, ElementState] = field(default_factory=dict[Any, Any])

    def find_wrench(self, rows: Sequence[str]) -> Array:
        """Return wrenches (n, 6m, c) on m elements, each at its point in its axes."""
        return stack_rows([self.elements[name].wrench for name in rows])

    @property
    def energies(self) -> dict[str, Array]:
        """Strain energy (n, c) in J of every compliant joint and body."""
        out: dict[str, Array] = {}
        for name, state in self.elements.items():
            if state.element.factor.shape[1]:
                whole = state.element.group or name
                out[whole] = out[whole] + state.energy if whole in out else state.energy
        return out


def condense_loads(state: Condensed, loads: Loads) -> CondensedLoads:
    """Carry loads through all condensation steps."""
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
    """Return twice the energy (n or 1, c, c) of loads, not offsets, with remaining nodes fixed."""
    out: Array = np.zeros((1, load.loads.cases, load.loads.cases))
    for gone, kept in zip(state.gone, load.kept, strict=True):
        if isinstance(gone, Folded):
            y: Array = kept[1]
            out = out + y.mT @ gone.core @ y
            continue
        stresses: list[Array] = []
        if isinstance(gone, Eliminated):
            stresses += [] if kept is None else [kept]
        elif any(w.any() for w in kept[0].carried):
            for (e, _), carried in zip(gone.connection.members, kept[0].carried, strict=True):
                factor = state.where.columns(e)[0]
                if factor.shape[2]:
                    stresses.append(factor.mT @ (kept[1] + carried))
        for stress in stresses:
            out = out + stress.mT @ stress
    return out


def recover_response(
    state: Condensed,
    load: CondensedLoads,
    ends: dict[str, Array],
    left: Sequence[tuple[ChainLoads, Array, Array, Array]] = (),
) -> Response:
    """Recover all node twists (n, 6, c) and element states from those of the remaining nodes.

    ``left``: connections that were not, by their loads, with their wrench, twist across and rates.
    """
    out = Response(state.where, ends[END], ends)
    for along, wrench, span, rates in left:
        (e, sign), where = along.connection.members[0], state.where
        if e.group:  # its own wrench alone does not tell how it strains
            strained = sign * (span - along.offset)
            out.elements[e.name] = ElementState(e, where, sign * wrench, sign * span, rates[:, :0], strained)
        else:
            _follow_connection(out, along, wrench, span, rates)
    for gone, own in zip(reversed(state.gone), reversed(load.kept), strict=True):
        match gone:
            case Stiff():
                along, preload = own
                span = out.nodes[gone.connection.end] - out.nodes[gone.connection.start]
                _follow_connection(out, along, gone.stiffness @ span + preload, span, gone)
            case Eliminated():
                moved = np.zeros((1, 6, 1)) if own is None else own
                for c, reach in zip(gone.step.neighbours, gone.reach, strict=True):
                    moved = moved + reach @ out.nodes[c]
                out.nodes[gone.step.node] = gone.half.mT @ moved
            case Folded():
                along, y, force = own
                _recover_folded(gone, along, y, force, out)
    return out


def solve_tool(stiffness: Array, wrench: Array) -> Array:
    """Return the twist (n, 6, c) of a stiffness (n or 1, 6, 6) under wrenches (n or 1, 6, c).

    Raises InputError if a wrench acts along a free direction.
    """
    half, pivots = pivot(stiffness, _FREE)
    twist = half.mT @ (half @ wrench)
    if (pivots <= _FREE).any():
        left = np.abs(stiffness @ twist - wrench)
        if (left > _BALANCED * np.abs(wrench).max(axis=1, keepdims=True)).any():
            count = int((pivots <= _FREE).sum(axis=1).max())
            raise InputError(
                f"the tool moves freely in {count} direction(s): ask for its mobility, not for its deflection"
            )
    return twist


def chain_loads(state: Condensed, load: CondensedLoads, connection: Connection) -> ChainLoads:
    """Collect loads and offsets along a connection."""
    total: Array = np.zeros((1, 6, load.loads.cases))
    each: list[Array] = [total]
    for node in reversed(connection.inner):
        if node in load.forces:
            total = total + load.forces[node]
        each.insert(0, total)
    offsets = load.loads.offsets
    moved: list[Array | None] = [
        state.where.adjoint(e) @ (sign * offsets[e.name]) if e.name in offsets else None
        for e, sign in connection.members
    ]
    offset: Array = sum((twist for twist in moved if twist is not None), np.zeros((1, 6, load.loads.cases)))
    return ChainLoads(connection, each, moved, offset)


def _load_stiff(state: Condensed, gone: Stiff, load: CondensedLoads) -> tuple[ChainLoads, Array]:
    c = gone.connection
    along = chain_loads(state, load, c)
    preload: Array = np.zeros((1, 6, load.loads.cases))
    if along.offset.any():
        preload = preload - gone.stiffness @ along.offset
    if any(w.any() for w in along.carried):
        preload = preload + _hold_end(state, gone, along, load.loads.balanced)
    load.add(c.end, -preload)
    load.add(c.start, preload + along.carried[0])
    return along, preload


def _hold_end(state: Condensed, gone: Stiff, along: ChainLoads, balanced: float) -> Array:
    """Return the wrench (n, 6, c) that holds a connection's end under loads on its inner nodes.

    ``w = w₀ - K (τ + C w₀)`` with Nᵀ w₀ = -ν, the loads along the free directions.
    """
    connection, where = gone.connection, state.where
    columns = [where.columns(e) for e, _ in connection.members]
    hold: Array = np.zeros((1, 6, 1))
    if gone.fit is not None:
        work = stack_rows([free.mT @ wrench for (_, free), wrench in zip(columns, along.carried, strict=True)])
        hold = -gone.fit.mT @ work
        if balanced < HELD:
            left = np.abs(connection.flexible(where)[1].mT @ hold + work)
            if (left > balanced * np.abs(work).max(axis=(1, 2), keepdims=True)).any():
                _refuse([e.name for e, _ in connection.members])
    tau: Array = np.zeros((1, 6, 1))
    for (factor, _), wrench in zip(columns, along.carried, strict=True):
        if factor.shape[2]:
            tau = tau + factor @ (factor.mT @ (wrench + hold))
    return hold - gone.stiffness @ tau


def _load_eliminated(gone: Eliminated, load: CondensedLoads) -> Array | None:
    force = load.forces.pop(gone.step.node, None)
    if force is None:
        return None
    push = gone.half @ force
    _check_balance((gone.step.node,), gone.half, gone.own, force, load.loads.balanced)
    for c, reach in zip(gone.step.neighbours, gone.reach, strict=True):
        load.add(c, reach.mT @ push)
    return push


def _load_folded(state: Condensed, gone: Folded, load: CondensedLoads) -> tuple[ChainLoads, Array, Array]:
    connection = gone.step.connection
    along = chain_loads(state, load, connection)
    force = load.force(gone.step.node)
    drive = gone.columns.mT @ (force - gone.own @ along.offset)
    if any(w.any() for w in along.carried):
        drive = drive + project_loads(along, gone.columns)
    y = gone.half.mT @ (gone.half @ drive)
    names = [e.name for e, _ in connection.members]
    _check_balance(names, gone.half, gone.core, drive, load.loads.balanced)
    moved = along.offset + gone.columns @ y  # twist of the node where all others stand still
    load.add(connection.start, force + along.carried[0])
    for c, stiffness in gone.around.items():
        share = stiffness.mT @ moved
        load.add(c, share)
        load.add(connection.start, -share)
    return along, y, force


def project_loads(along: ChainLoads, columns: Array) -> Array:
    """Project loads on a connection's inner nodes onto its coordinates, (n, m, c)."""
    out: list[Array] = []
    at = 0
    sizes = [e.factor.shape[1] for e, _ in along.connection.members]
    sizes += [e.free.shape[1] for e, _ in along.connection.members]
    for size, wrench in zip(sizes, along.carried * 2, strict=True):
        out.append(columns[:, :, at : at + size].mT @ wrench)
        at += size
    return stack_rows(out)


def _check_balance(names: Sequence[str], half: Array, matrix: Array, load: Array, balanced: float) -> None:
    """Refuse a load along a direction that a generalized inverse dropped."""
    if balanced >= HELD or not (np.einsum("nii->ni", half) == 0.0).any():
        return
    left = np.abs(load - matrix @ (half.mT @ (half @ load)))
    if (left > balanced * np.abs(load).max(axis=(1, 2), keepdims=True) + 1e-300).any():
        _refuse(names)


def _refuse(names: Sequence[str]) -> None:
    raise InputError(f"{', '.join(names)}: moves freely under its load, there is no equilibrium")


def _recover_folded(gone: Folded, along: ChainLoads, own: Array, force: Array, out: Response) -> None:
    nodes, start, y, wrench = out.nodes, out.nodes[gone.step.connection.start], own, force
    for c, stiffness in gone.around.items():
        y = y + gone.share @ (stiffness @ (nodes[c] - start))
    span = gone.columns @ y + along.offset
    node = nodes[gone.step.node] = start + span
    for c, stiffness in gone.around.items():
        wrench = wrench + stiffness @ (nodes[c] - node)
    count = sum(e.factor.shape[1] for e, _ in gone.step.connection.members)
    _follow_connection(out, along, wrench, span, y[:, count:])


def _follow_connection(out: Response, loads: ChainLoads, wrench: Array, span: Array, rates: Array | Stiff) -> None:
    """Members and nodes of a connection whose end, moved by ``span``, carries ``wrench``.

    ``rates`` (n, k, c) of its free motions; of a stiffened one these follow from ``span``.
    """
    connection, nothing = loads.connection, np.zeros((1, 6, span.shape[2]))
    wrenches: list[Array] = []
    elastic: list[Array | None] = []
    for (e, _), carried, moved in zip(connection.members, loads.carried, loads.moved, strict=True):
        w, (f, _), part = wrench, out.where.columns(e), moved
        if carried.any():
            w = wrench + carried
        if f.shape[2]:
            part = f @ (f.mT @ w)
            part = part if moved is None else part + moved
        wrenches.append(w)
        elastic.append(part)
    if isinstance(rates, Stiff):
        rest = span - sum(part for part in elastic if part is not None)
        rates = nothing[:, :0] if rates.fit is None else rates.fit @ rest
    node, at, ends = out.nodes[connection.start], 0, (*connection.inner, None)
    for (e, sign), w, part, end in zip(connection.members, wrenches, elastic, ends, strict=True):
        free, across = out.where.columns(e)[1], nothing if part is None else part
        rate = rates[:, at : at + free.shape[2]]
        at += free.shape[2]
        if free.shape[2]:
            across = across + free @ rate
        out.elements[e.name] = ElementState(e, out.where, sign * w, sign * across, sign * rate)
        if end is not None:
            node = out.nodes[end] = node + across
