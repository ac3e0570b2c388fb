"""Condensation of an elastic network to its tool, batched over poses.

All nodal twists and wrenches refer to M in base axes: members in series add compliances C and
collect free directions N, members in parallel add stiffnesses ``K = Z (Zᵀ C Z)⁻¹ Zᵀ``. Nodes are
eliminated by Schur complements, in the order of ``stiffscope.vjm.network.order``; parts stiff only through
rigid loops are solved with multipliers (``stiffscope.vjm.network.saddle``). No singular matrix is inverted.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property, reduce
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.errors import InputError
from stiffscope.vjm.kinematics.linkage import FEW
from stiffscope.vjm.model.checks import GROUND
from stiffscope.vjm.model.screws import Frame
from stiffscope.vjm.model.semidefinite import half_inverse, multiply_transposed
from stiffscope.vjm.network.loading import HELD, CondensedLoads, chain_loads
from stiffscope.vjm.network.order import (
    Connection,
    fit_free_motions,
    form_stiffness,
    stack_columns,
)

if TYPE_CHECKING:
    from collections.abc import Container, Iterator
    from typing import TypeAlias

    from stiffscope.vjm.model.screws import Array
    from stiffscope.vjm.network.loading import ChainLoads, Loads, Response
    from stiffscope.vjm.network.network import Places
    from stiffscope.vjm.network.order import Fold, Order

    Stiffened: TypeAlias = tuple[Connection, Array]


class InfiniteStiffnessError(InputError):
    """A stiffness is infinite in some direction; the compliance is still defined."""


@dataclass(eq=False)
class Stiff:
    """A stiffened connection and its stiffness (n or 1, 6, 6) at M in base axes."""

    connection: Connection
    where: Places
    length: float
    stiffness: Array

    @cached_property
    def free(self) -> Array:
        """Free directions (n or 1, 6, k) at M in base axes."""
        return stack_columns(
            self.where.columns(e)[1] for e, _ in self.connection.members
        )

    @cached_property
    def fit(self) -> Array | None:
        """Least-squares map (n, k, 6) from a twist to free coordinates; None without any."""
        return fit_free_motions(self.free, self.length) if self.free.shape[2] else None

    def carry(self, load: CondensedLoads) -> tuple[ChainLoads, Array]:
        """Carry loads to its ends; return them, and the wrench (n, 6, c) that holds the end."""
        along = chain_loads(self.where, load, self.connection)
        preload: Array = np.zeros((1, 6, load.loads.cases))
        spans = [along.offset] if along.offset.any() else []
        if any(along.loaded):
            preload, strains = self._hold_end(along, load.loads.balanced)
            spans += strains
        if spans:
            preload = preload - self.stiffness @ reduce(np.add, spans)
        if spans or any(along.loaded):
            load.add(self.connection.end, -preload)
            load.add(self.connection.start, preload + along.carried[0])
        return along, preload

    def _hold_end(
        self, along: ChainLoads, balanced: float
    ) -> tuple[Array, list[Array]]:
        """Return a wrench w₀ (n, 6, c) on the end in balance with inner loads, and the strains.

        The wrench that holds the end is ``w₀ - K (τ + C w₀)`` with Nᵀ w₀ = -ν, the loads along N.
        """
        members = self.connection.members
        where = self.where
        hold: Array = np.zeros((1, 6, 1))
        if self.fit is not None:
            work = along.project((1,))
            hold = -self.fit.mT @ work
            if balanced < HELD:
                left = np.abs(self.free.mT @ hold + work)
                if (
                    left > balanced * np.abs(work).max(axis=(1, 2), keepdims=True)
                ).any():
                    _refuse([e.name for e, _ in members])
        strains: list[Array] = []
        for (e, _), wrench, loaded in zip(
            members, along.carried, along.loaded, strict=True
        ):
            factor = where.columns(e)[0]
            if factor.shape[2]:
                strains.append(
                    factor @ (factor.mT @ (wrench + hold if loaded else hold))
                )
        return hold, strains

    def recover(self, factors: tuple[ChainLoads, Array], out: Response) -> None:
        """Recover its members and inner nodes from its ends."""
        along, preload = factors
        span = out.nodes[self.connection.end] - out.nodes[self.connection.start]
        along.follow(out, self.stiffness @ span + preload, span, None, self.fit)

    def stresses(self, factors: tuple[ChainLoads, Array]) -> Iterator[Array]:
        """Yield strains (n, k, c) with its ends fixed, whose squares are twice the energy."""
        along, preload = factors
        for (e, _), carried in zip(self.connection.members, along.carried, strict=True):
            factor = self.where.columns(e)[0]
            if any(along.loaded) and factor.shape[2]:
                yield factor.mT @ (preload + carried)


@dataclass(eq=False)
class Folded:
    """An eliminated node, moved from the start of its connection by ``columns · y``.

    ``half`` W with WᵀW an inverse of the coordinates' stiffness ``core``; ``around``: stiffness to
    each neighbour, ``own`` their sum; ``reach``: W columnsᵀ times those of all except the start.
    Without a connection the node is free: y is its twist.
    """

    step: Fold
    where: Places
    columns: Array | None
    core: Array
    half: Array
    around: dict[str, Array]
    own: Array
    reach: dict[str, Array]

    @property
    def start(self) -> str:
        """The node that it moves from."""
        return GROUND if self.step.connection is None else self.step.connection.start

    def carry(
        self, load: CondensedLoads
    ) -> tuple[ChainLoads | None, Array, Array] | None:
        """Carry loads to its neighbours; return them, W times those on y, and that on the node."""
        force = load.force(self.step.node)
        connection = self.step.connection
        along = None
        names = [self.step.node]
        drive = force
        if connection is None or self.columns is None:
            if self.step.node not in load.forces:
                return None
        else:
            names = [e.name for e, _ in connection.members]
            along = chain_loads(self.where, load, connection)
            if not (
                self.step.node in load.forces or any(along.loaded) or along.offset.any()
            ):
                return along, np.zeros((1, self.half.shape[1], load.loads.cases)), force
            load.add(self.start, force + along.carried[0])
            if along.offset.any():
                drive = drive - self.own @ along.offset
            drive = self.columns.mT @ drive
            if any(along.loaded):
                drive = drive + along.project()
        push = self.half @ drive
        moved = self.half.mT @ push
        self._check_balance(names, moved, drive, load.loads.balanced)
        if along is not None and self.columns is not None:
            moved = along.offset + self.columns @ moved
        for c, stiffness in self.around.items():
            share = stiffness.mT @ moved
            load.add(c, share)
            if along is not None:
                load.add(self.start, -share)
        return along, push, force

    def _check_balance(
        self, names: list[str], moved: Array, load: Array, balanced: float
    ) -> None:
        """Refuse a load (n, m, c) along a direction that the generalized inverse dropped."""
        if balanced >= HELD or not (np.einsum("nii->ni", self.half) == 0.0).any():
            return
        left = np.abs(load - self.core @ moved)
        if (
            left > balanced * np.abs(load).max(axis=(1, 2), keepdims=True) + 1e-300
        ).any():
            _refuse(names)

    def recover(
        self, factors: tuple[ChainLoads | None, Array, Array] | None, out: Response
    ) -> None:
        """Recover the node, and its connection, from its neighbours."""
        along, y, wrench = factors or (None, np.zeros((1, 1, 1)), np.zeros((1, 6, 1)))
        start = out.nodes[self.start]
        for c, reach in self.reach.items():
            y = y + reach @ (out.nodes[c] if along is None else out.nodes[c] - start)
        moved = self.half.mT @ y
        if along is None or self.columns is None:
            out.nodes[self.step.node] = moved
            return
        span = self.columns @ moved + along.offset
        node = out.nodes[self.step.node] = start + span
        for c, stiffness in self.around.items():
            wrench = wrench + stiffness @ (out.nodes[c] - node)
        count = sum(e.factor.shape[1] for e, _ in along.connection.members)
        along.follow(out, wrench, span, moved[:, count:])

    def stresses(
        self, factors: tuple[ChainLoads | None, Array, Array] | None
    ) -> Iterator[Array]:
        """Yield numbers (n, k, c) whose squares are twice the energy with its neighbours fixed."""
        if factors is not None:
            yield factors[1]


@dataclass(eq=False)
class Condensed:
    """A network condensed to ground, tool and irremovable nodes: stiffnesses by node pair."""

    order: Order
    where: Places
    pairs: dict[tuple[str, str], Array] = field(default_factory=dict[Any, Any])
    gone: list[Any] = field(default_factory=list[Any])
    """Stiffened connections (``Stiff``) and eliminated nodes (``Folded``), in order."""

    def pair(self, a: str, b: str) -> Array:
        """Return G (n or 1, 6, 6) between two nodes: G times b's twist is a force on a."""
        return self.pairs[a, b] if (a, b) in self.pairs else self.pairs[b, a].mT

    def add(self, a: str, b: str, stiffness: Array) -> None:
        """Add a stiffness (n or 1, 6, 6) between two nodes."""
        pair, k = (
            ((b, a), stiffness.mT) if (b, a) in self.pairs else ((a, b), stiffness)
        )
        self.pairs[pair] = self.pairs[pair] + k if pair in self.pairs else k


def condense_network(order: Order, where: Places) -> Condensed:
    """Condense a network. Raises InfiniteStiffnessError if a connection is infinitely stiff."""
    state = Condensed(order, where)
    prepared: dict[Connection, Array] = {}
    if where.rigid:
        prepared.update(_carry_constants(order, where))
    if len(where.tool) <= FEW:
        where.evaluate(order.moving if where.rigid else order.elements)
        prepared.update(_stiffen_alike(order, where, prepared))
    for step in order.steps:
        if isinstance(step, Connection):
            state.gone.append(_stiffen(state, step, prepared.get(step)))
        else:
            state.gone.append(_fold(state, step))
    return state


def condense_loads(state: Condensed, loads: Loads) -> CondensedLoads:
    """Carry loads through all condensation steps."""
    out = CondensedLoads(
        loads, {node: w for node, w in loads.nodes.items() if node != GROUND}
    )
    if state.where.rigid:
        _carry_columns(state.order, state.where)
    for gone in state.gone:
        out.recovery.append(gone.carry(out))
    return out


def recover_response(state: Condensed, load: CondensedLoads, out: Response) -> Response:
    """Recover all nodes and elements from the remaining ones, in place."""
    for gone, needed in zip(reversed(state.gone), reversed(load.recovery), strict=True):
        gone.recover(needed, out)
    return out


def store_energy(state: Condensed, load: CondensedLoads) -> Array:
    """Return twice the energy (n or 1, c, c) of loads, not offsets, with remaining nodes fixed."""
    out: Array = np.zeros((1, load.loads.cases, load.loads.cases))
    for gone, needed in zip(state.gone, load.recovery, strict=True):
        for stress in gone.stresses(needed):
            out = out + multiply_transposed(stress)
    return out


def _carry_constants(order: Order, where: Places) -> Iterator[Stiffened]:
    """Yield the constant connections and their stiffnesses at M in base axes."""
    n = len(where.tool)
    connections = [c for c, _ in order.constant]
    turned = [where.rotation[c.anchor] for c in connections]
    moved = [where.position[c.anchor] for c in connections]
    if not turned or n > FEW or any(len(values) != n for values in (*turned, *moved)):
        for c, constant in order.constant:
            back = c.frame(where).inverse_adjoint()
            yield c, back.mT @ constant @ back
        return
    rotation = np.array(turned)  # batched: for few poses call overhead dominates
    origins = np.array([c.origin for c in connections])[:, None, :, None]
    place = Frame(rotation, (rotation @ origins)[..., 0] + moved - where.tool)
    back = place.inverse_adjoint()
    constants = np.array([constant for _, constant in order.constant])
    yield from zip(connections, back.mT @ constants @ back, strict=True)


def _carry_columns(order: Order, where: Places) -> None:
    """Place columns that are constant in a connection's axes with it, not one by one."""
    for c, _ in order.constant:
        if c.columns is not None and c.members[0][0].name not in where.seen:
            whole = (
                c.frame(where).adjoint().reshape(-1, 6) @ c.columns
            )  # one product, not n
            placed = whole.reshape(-1, *c.columns.shape)
            r = 0
            k = sum(e.factor.shape[1] for e, _ in c.members)
            for e, _ in c.members:
                after = r + e.factor.shape[1], k + e.free.shape[1]
                where.seen[e.name] = (
                    e,
                    placed[..., r : after[0]],
                    placed[..., k : after[1]],
                )
                r, k = after


def _stiffen_alike(
    order: Order, where: Places, prepared: Container[Connection]
) -> Iterator[Stiffened]:
    """Stiffen others of as many columns at once: for few poses call overhead dominates."""
    alike: dict[tuple[int, ...], list[tuple[Connection, Array, Array]]] = {}
    for c in order.steps:
        if isinstance(c, Connection) and c not in prepared:
            factor, free = c.flexible(where)
            if len(factor) == len(free):
                alike.setdefault((factor.shape[2], free.shape[2]), []).append(
                    (c, factor, free)
                )
    for some in alike.values():
        connections, factors, free = zip(*some, strict=True)
        columns = np.concatenate(factors), np.concatenate(free)
        stiffness, finite = form_stiffness(*columns, order.length)
        if finite:
            yield from zip(connections, np.split(stiffness, len(some)), strict=True)


def _stiffen(
    state: Condensed, connection: Connection, stiffness: Array | None
) -> Stiff:
    if stiffness is None:
        columns = connection.flexible(state.where)
        stiffness, finite = form_stiffness(*columns, state.order.length)
        if not finite:
            names = ", ".join(e.name for e, _ in connection.members)
            fault = "infinite stiffness in a constrained direction; expected a compliance there"
            raise InfiniteStiffnessError(f"{names}: {fault}")
    state.add(connection.start, connection.end, stiffness)
    return Stiff(connection, state.where, state.order.length, stiffness)


def _fold(state: Condensed, step: Fold) -> Folded:
    """Eliminate a node's twist, or its coordinates from the start of its connection."""
    connection = step.connection
    columns = None
    start = None
    around = {c: state.pair(step.node, c) for c in step.neighbours}
    core = direct = sum(around.values(), np.zeros((1, 6, 6)))
    if connection is not None:
        start = connection.start
        factor, free = connection.flexible(state.where)
        columns = stack_columns([factor, free])
        core = columns.mT @ direct @ columns
        np.einsum("nii->ni", core)[:, : factor.shape[2]] += 1.0  # unit springs
    half = half_inverse(core)
    pull = half if columns is None else half @ columns.mT  # (n, m, 6)
    reach: dict[str, Array] = {
        c: pull @ stiffness for c, stiffness in around.items() if c != start
    }
    if start is not None:
        everything = sum(reach.values(), np.zeros((1, pull.shape[-2], 6)))
        for c, mine in reach.items():
            state.add(c, start, around[c].mT - mine.mT @ everything)
    for other, c in combinations(reach, 2):
        state.add(c, other, reach[c].mT @ reach[other])
    for c in step.neighbours:
        state.pairs.pop((step.node, c), None)
        state.pairs.pop((c, step.node), None)
    return Folded(
        step=step,
        where=state.where,
        columns=columns,
        core=core,
        half=half,
        around=around,
        own=direct,
        reach=reach,
    )


def _refuse(names: list[str]) -> None:
    raise InputError(
        f"{', '.join(names)}: moves freely under its load, there is no equilibrium"
    )
