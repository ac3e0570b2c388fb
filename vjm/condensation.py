"""Condensation of an elastic network to its tool: one order for a mechanism, batched over poses.

All twists and wrenches of nodes stand at M in base axes, so that members in series add their compliances C and collect
their free directions N, and members in parallel add their stiffnesses. Chains without branches become one connection
(C, N). Where what it does not leave free has compliance, it is stiffened, ``K = Z (Zᵀ C Z)⁻¹ Zᵀ``; else it is folded: the
node at its end takes its coordinates. Nodes are eliminated by Schur complements. What only constrains itself in rigid
loops is solved with its constraints as multipliers (``stiffscope.vjm.saddle``). No singular matrix is inverted.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, TypeAlias
from weakref import WeakKeyDictionary

import numpy as np

from stiffscope.errors import InputError
from stiffscope.vjm.mechanism import GROUND, spelled
from stiffscope.vjm.network import END, Element, Places, elements_of, free_directions, link_of, moves_with, nodes_of
from stiffscope.vjm.screws import Frame
from stiffscope.vjm.semidefinite import half_inverse, inverse, pivoted, projector

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from stiffscope.vjm.linkage import Linkage
    from stiffscope.vjm.mechanism import Mechanism
    from stiffscope.vjm.screws import Array

ROUNDING = 1e-10  # of a motion, that is left of it where all of it is free
RIGID = 1e-13  # relative pivot below which a constrained direction has no compliance at all
BALANCED = 1e-6  # of a load, that may be left along a free motion
Members: TypeAlias = "tuple[tuple[Element, float], ...]"


@dataclass(frozen=True, eq=False)
class Connection:
    """Elements in series from node ``start`` to ``end``; -1 marks one that is passed from its second node.

    ``anchor``: node whose body carries the connection's own axes, ``origin`` (3,) their origin at home.
    ``constant``: its stiffness (6, 6) in its own axes where no pose changes it.
    """

    start: str
    end: str
    members: Members
    anchor: str
    origin: Array
    constant: Array | None = None
    formable: bool = False
    still: tuple[Array, ...] = ()
    """Adjoints of the members to the connection's own axes, where no pose changes them."""

    def reversed(self) -> Connection:
        """The same from its end to its start."""
        turned = tuple((e, -s) for e, s in reversed(self.members))
        return replace(self, start=self.end, end=self.start, members=turned, still=self.still[::-1])

    @property
    def inner(self) -> tuple[str, ...]:
        """Nodes between its members, from the start."""
        return tuple(e.second if s > 0.0 else e.first for e, s in self.members[:-1])

    def frame(self, where: Places) -> Frame:
        """Its own axes, seen from M."""
        return Frame(where.rotation[self.anchor], where.point(self.anchor, self.origin) - where.tool)

    def adjoints(self, where: Places) -> Sequence[Array]:
        """Carry each member's twist (n or 1, 6, 6) to the connection's own axes."""
        if self.still and where.rigid:
            return self.still
        r = np.swapaxes(where.rotation[self.anchor], -1, -2)
        p = where.point(self.anchor, self.origin)
        out: list[Array] = []
        for e, _ in self.members:
            away = (r @ (where.point(e.second, e.at) - p)[..., None])[..., 0]
            out.append(Frame(r @ where.rotation[e.carrier] @ e.axes, away).adjoint())
        return out

    def flexible(self, where: Places) -> tuple[Array, Array]:
        """Factor F (n or 1, 6, r) of its compliance and free directions N (n or 1, 6, k), in its own axes."""
        factors, free = [np.zeros((1, 6, 0))], [np.zeros((1, 6, 0))]
        for (e, _), carry in zip(self.members, self.adjoints(where), strict=True):
            if e.factor.shape[1]:
                factors.append(carry @ where.factor(e))
            if e.free.shape[1]:
                free.append(carry @ free_directions(e, where))
        return stacked(factors), stacked(free)


@dataclass(frozen=True, eq=False)
class Stiffen:
    """A connection turned into a stiffness between its nodes."""

    connection: Connection


@dataclass(frozen=True, eq=False)
class Eliminate:
    """A node between stiffnesses alone."""

    node: str
    neighbours: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Fold:
    """A node at the end of one connection that is no stiffness; what else is at it are stiffnesses."""

    connection: Connection
    neighbours: tuple[str, ...]

    @property
    def node(self) -> str:
        """The node that goes."""
        return self.connection.end


Step: TypeAlias = "Stiffen | Eliminate | Fold"


@dataclass(frozen=True, eq=False)
class Order:
    """What a mechanism's network is condensed by, found at home.

    ``left``: connections that no step could take, between ``kept`` nodes.
    """

    mechanism: Mechanism
    elements: tuple[Element, ...]
    length: float
    steps: tuple[Step, ...]
    left: tuple[Connection, ...]
    kept: tuple[str, ...]


_orders: WeakKeyDictionary[Mechanism, Order] = WeakKeyDictionary()


def order_of(mechanism: Mechanism, linkage: Linkage) -> Order:
    """The order of a mechanism, found once."""
    if mechanism not in _orders:
        _orders[mechanism] = _Planner(mechanism, linkage).order()
    return _orders[mechanism]


def home(mechanism: Mechanism) -> Places:
    """Every node as it is at home."""
    nodes = nodes_of(mechanism)
    return Places(
        dict.fromkeys(nodes, np.eye(3)[None]), dict.fromkeys(nodes, np.zeros((1, 3))), mechanism.tool.at[None]
    )


class _Planner:
    def __init__(self, mechanism: Mechanism, linkage: Linkage) -> None:
        self.mechanism = mechanism
        self.length = linkage.length
        self.links = link_of(linkage)
        self.home = home(mechanism)
        self.elements = elements_of(mechanism)
        self.flexible = [self._connection(e.first, e.second, ((e, 1.0),)) for e in self.elements]
        self.stiff: set[frozenset[str]] = set()
        self.nodes = [n for n in nodes_of(mechanism) if n not in {GROUND, END}]
        self.steps: list[Step] = []

    def order(self) -> Order:
        while True:
            self._merge()
            for c in [c for c in self.flexible if c.formable]:
                self.flexible.remove(c)
                self.steps.append(Stiffen(c))
                self.stiff.add(frozenset((c.start, c.end)))
            if not self._take_out():
                break
        return Order(
            self.mechanism, self.elements, self.length, tuple(self.steps), tuple(self.flexible),
            tuple(self.nodes),
        )  # fmt: skip

    def _at(self, node: str) -> list[Connection]:
        return [c for c in self.flexible if node in {c.start, c.end}]

    def _neighbours(self, node: str) -> list[str]:
        return [next(iter(pair - {node})) for pair in self.stiff if node in pair]

    def _merge(self) -> None:
        """Join two connections at a node where nothing else is."""
        for node in list(self.nodes):
            here = self._at(node)
            if len(here) != 2 or self._neighbours(node):
                continue
            a, b = here
            a = a if a.end == node else a.reversed()
            b = b if b.start == node else b.reversed()
            if a.start == b.end:  # side by side
                continue
            self.flexible = [c for c in self.flexible if c not in here]
            self.flexible.append(self._connection(a.start, b.end, a.members + b.members))
            self.nodes.remove(node)

    def _take_out(self) -> bool:
        """Eliminate or fold the node with the fewest neighbours; False where none can go."""
        ready: list[tuple[int, int, str]] = []
        for k, node in enumerate(self.nodes):
            if len(self._at(node)) <= 1:
                ready.append((len(self._neighbours(node)), k, node))
        if not ready:
            return False
        node = min(ready)[2]
        neighbours = self._neighbours(node)
        here = self._at(node)
        around = set(neighbours)
        if here:
            (c,) = here
            c = c if c.end == node else c.reversed()
            self.steps.append(Fold(c, tuple(neighbours)))
            self.flexible = [f for f in self.flexible if f not in here]
            around |= {c.start} if neighbours else set()
        else:
            self.steps.append(Eliminate(node, tuple(neighbours)))
        self.stiff = {pair for pair in self.stiff if node not in pair}
        self.stiff |= {frozenset((a, b)) for a in around for b in around if a != b}
        self.nodes.remove(node)
        return True

    def _connection(self, start: str, end: str, members: Members) -> Connection:
        """A connection, its own axes, and whether and how it can be stiffened."""
        body = next((e for e, _ in members if e.joint is None and e.factor.shape[1]), members[0][0])
        anchor, origin = body.carrier, body.at
        made = Connection(start, end, members, anchor, origin)
        factor, free = made.flexible(self.home)
        whole = factor.shape[2] + free.shape[2] >= 6
        k, formable = stiffened(factor, free, self.length) if whole else (np.zeros((1, 6, 6)), False)
        constant = formable and all(moves_with(e, self.links[anchor], self.links) for e, _ in members)
        if constant:
            return replace(made, constant=k, formable=True, still=tuple(made.adjoints(self.home)))
        return replace(made, formable=formable)


def stacked(blocks: Iterable[Array]) -> Array:
    """Concatenate columns (n or 1, 6, r) of blocks."""
    parts = list(blocks)
    n = max(len(b) for b in parts)
    return np.concatenate([np.broadcast_to(b, (n, *b.shape[1:])) for b in parts], axis=-1)


def stiffened(factor: Array, free: Array, length: float) -> tuple[Array, bool]:
    """Stiffness (n, 6, 6) of a compliance F Fᵀ with free directions N, and whether it is finite everywhere.

    With P the projector onto the wrenches that N leaves, ``K = P (P C P + s (I - P))⁻¹ P``, lengths scaled.
    """
    scale = np.array([1.0 / length] * 3 + [1.0] * 3)[:, None]
    f = factor * scale
    p, rank = np.eye(6)[None], np.zeros(1)
    if free.shape[2]:
        p, rank = projector(free * scale)
        p = np.where((rank < 6.0)[:, None, None], p, 0.0)
        size = np.linalg.norm(f, axis=1, keepdims=True)
        f = p @ f
        f = np.where(np.linalg.norm(f, axis=1, keepdims=True) > ROUNDING * size, f, 0.0)
    core = f @ np.swapaxes(f, -1, -2)
    mean = np.where(rank < 6.0, np.einsum("nii->n", core) / np.maximum(6.0 - rank, 1.0), 1.0)
    core = core + mean[:, None, None] * (np.eye(6) - p)
    half, pivots = pivoted(core, RIGID)
    half = half @ p * scale[:, 0]
    return np.swapaxes(half, -1, -2) @ half, bool((pivots > RIGID).all())


@dataclass(eq=False)
class Loads:
    """``cases`` of wrenches (n or 1, 6, c) on nodes at M in base axes, and of elements' offsets in their own axes."""

    cases: int
    nodes: dict[str, Array] = field(default_factory=dict[Any, Any])
    offsets: dict[str, Array] = field(default_factory=dict[Any, Any])


@dataclass(eq=False)
class Condensed:
    """A network condensed to ground and tool.

    ``stiffness`` (n or 1, 6, 6) at M in base axes; ``load`` (n, 6, c): what the internal loads are worth at the tool.
    ``done``: what each step leaves to be recovered.
    """

    order: Order
    where: Places
    loads: Loads | None
    pairs: dict[tuple[str, str], Array] = field(default_factory=dict[Any, Any])
    forces: dict[str, Array] = field(default_factory=dict[Any, Any])
    done: list[Any] = field(default_factory=list[Any])

    def pair(self, a: str, b: str) -> Array:
        """Stiffness G (n or 1, 6, 6) between two nodes: b's twist times it is a force on a."""
        if (a, b) in self.pairs:
            return self.pairs[a, b]
        return np.swapaxes(self.pairs[b, a], -1, -2)

    def add(self, a: str, b: str, stiffness: Array) -> None:
        """Put one more stiffness between two nodes."""
        if (b, a) in self.pairs:
            self.pairs[b, a] = self.pairs[b, a] + np.swapaxes(stiffness, -1, -2)
        elif (a, b) in self.pairs:
            self.pairs[a, b] = self.pairs[a, b] + stiffness
        else:
            self.pairs[a, b] = stiffness

    def load(self, node: str, wrench: Array) -> None:
        """Add a wrench (n or 1, 6, c) on a node."""
        self.forces[node] = self.forces[node] + wrench if node in self.forces else wrench

    def force(self, node: str) -> Array:
        """Wrench on a node so far."""
        cases = self.loads.cases if self.loads else 0
        return self.forces.get(node, np.zeros((1, 6, cases)))


def condensed(order: Order, where: Places, loads: Loads | None = None) -> Condensed:
    """Condense a network; with ``loads``, all that their response needs is kept."""
    state = Condensed(order, where, loads)
    if loads is not None:
        for node, wrench in loads.nodes.items():
            state.load(node, wrench)
    for step in order.steps:
        match step:
            case Stiffen():
                _stiffen(state, step.connection)
            case Eliminate():
                _eliminate(state, step)
            case Fold():
                _fold(state, step)
    return state


def own_stiffness(connection: Connection, where: Places, length: float, *, rigid: bool = True) -> Array:
    """Stiffness (n or 1, 6, 6) of a connection in its own axes. Raises InputError where it would be infinite."""
    if connection.constant is not None and rigid:
        return connection.constant
    k, finite = stiffened(*connection.flexible(where), length)
    if not finite:
        names = ", ".join(e.name for e, _ in connection.members)
        raise InputError(f"{names}: infinite stiffness in a constrained direction; expected a compliance there")
    return k


@dataclass(eq=False)
class Chain:
    """A connection under loads: ``frame`` its own axes seen from M, wrenches (n or 1, 6, c) at M in base axes."""

    connection: Connection
    carried: list[Array]  # on each member's end by the loads on the nodes after it, from the start
    total: Array  # of all loads on its inner nodes
    offset: Array  # twist (n or 1, 6, c) of its end against its start by the members' offsets


def chain(state: Condensed, connection: Connection) -> Chain:
    """Loads and offsets along a connection."""
    loads = state.loads
    assert loads is not None  # noqa: S101
    total: Array = np.zeros((1, 6, loads.cases))
    carried: list[Array] = [total]
    for node in reversed(connection.inner):
        total = total + state.force(node)
        carried.insert(0, total)
    offset: Array = np.zeros((1, 6, loads.cases))
    for e, sign in connection.members:
        if e.name in loads.offsets:
            offset = offset + state.where.adjoint(e) @ (sign * loads.offsets[e.name])
    return Chain(connection, carried, total, offset)


def _stiffen(state: Condensed, connection: Connection) -> None:
    where = state.where
    own = own_stiffness(connection, where, state.order.length, rigid=where.rigid)
    back = connection.frame(where).inverse_adjoint()
    back_t = np.swapaxes(back, -1, -2)
    stiffness = back_t @ own @ back
    state.add(connection.start, connection.end, stiffness)
    if state.loads is None:
        return
    along = chain(state, connection)
    preload = preload_of(state, connection, along, own)
    state.load(connection.end, -preload)
    state.load(connection.start, preload + along.total)
    state.done.append((along, stiffness, preload))


def preload_of(state: Condensed, connection: Connection, along: Chain, own: Array) -> Array:
    """Wrench (n, 6, c) at M that holds the ends of a connection together under its loads and offsets."""
    back = connection.frame(state.where).inverse_adjoint()
    back_t = np.swapaxes(back, -1, -2)
    preload = -back_t @ (own @ (back @ along.offset))
    if any(c.any() for c in along.carried):
        preload = preload + back_t @ _held(state, connection, along, own)
    return preload


def _held(state: Condensed, connection: Connection, along: Chain, own: Array) -> Array:
    """Wrench (n, 6, c) that holds the end of a connection under the loads on its inner nodes, in its own axes.

    ``w = w₀ - K (τ + C w₀)`` with Nᵀ w₀ = -ν, what the loads would do along the free directions.
    """
    where = state.where
    forth = np.swapaxes(connection.frame(where).adjoint(), -1, -2)
    tau, free, nu = np.zeros((1, 6, 1)), [np.zeros((1, 6, 0))], []
    whole = np.zeros((1, 6, 6))
    for (e, _), carry, load in zip(connection.members, connection.adjoints(where), along.carried, strict=True):
        here = forth @ load
        if e.factor.shape[1]:
            f = carry @ where.factor(e)
            compliance = f @ np.swapaxes(f, -1, -2)
            whole = whole + compliance
            tau = tau + compliance @ here
        if e.free.shape[1]:
            n = carry @ free_directions(e, where)
            free.append(n)
            nu.append(np.swapaxes(n, -1, -2) @ here)
    if not nu:
        return -own @ tau
    directions = stacked(free)
    rows = max(len(v) for v in nu)
    nu = np.concatenate([np.broadcast_to(v, (rows, *v.shape[1:])) for v in nu], axis=-2)
    held = -np.swapaxes(regained(directions, state.order.length), -1, -2) @ nu
    left = np.abs(np.swapaxes(directions, -1, -2) @ held + nu)
    if (left > BALANCED * np.abs(nu).max(axis=(1, 2), keepdims=True)).any():
        _refuse([e.name for e, _ in connection.members])
    return held - own @ (tau + whole @ held)


def regained(free: Array, length: float) -> Array:
    """Coordinates (n, k, 6) of the free directions (n, 6, k) nearest to a twist, lengths scaled."""
    scale = np.array([1.0 / length] * 3 + [1.0] * 3)
    unit = free * scale[:, None]
    unit_t = np.swapaxes(unit, -1, -2)
    return inverse(unit_t @ unit) @ unit_t * scale


def _eliminate(state: Condensed, step: Eliminate) -> None:
    node = step.node
    around = [state.pair(node, c) for c in step.neighbours]
    own = sum(around, np.zeros((1, 6, 6)))
    half = half_inverse(own)
    reach = [half @ g for g in around]
    force = state.forces.pop(node, None)
    push = None if force is None else half @ force
    if push is not None:
        _check_balance((node,), half, own, force)
    for i, a in enumerate(step.neighbours):
        back = np.swapaxes(reach[i], -1, -2)
        if push is not None:
            state.load(a, back @ push)
        for j in range(i):
            state.add(a, step.neighbours[j], back @ reach[j])
    for c in step.neighbours:
        _drop(state, node, c)
    if state.loads is not None:
        state.done.append((half, reach, push))


def _fold(state: Condensed, step: Fold) -> None:
    connection, node, start = step.connection, step.connection.end, step.connection.start
    where = state.where
    factor, free = connection.flexible(where)
    carry = connection.frame(where).adjoint()
    b = carry @ stacked([factor, free])
    around = {c: state.pair(node, c) for c in step.neighbours}
    own = sum(around.values(), np.zeros((1, 6, 6)))
    d = np.swapaxes(b, -1, -2) @ own @ b
    r = factor.shape[2]
    d = d + np.diag([1.0] * r + [0.0] * (b.shape[2] - r))
    half = half_inverse(d) @ np.swapaxes(b, -1, -2)  # (n, m, 6)
    others = [c for c in step.neighbours if c != start]
    reach = {c: half @ around[c] for c in others}
    everything = sum(reach.values(), np.zeros((1, half.shape[-2], 6)))
    for i, c in enumerate(others):
        back = np.swapaxes(reach[c], -1, -2)
        state.add(c, start, np.swapaxes(around[c], -1, -2) - back @ everything)
        for other in others[:i]:
            state.add(c, other, back @ reach[other])
    for c in step.neighbours:
        _drop(state, node, c)
    if state.loads is None:
        return
    along = chain(state, connection)
    force = state.force(node)
    pull: list[Array] = []
    for kind in ("factor", "free"):
        for (e, _), at, load in zip(connection.members, connection.adjoints(where), along.carried, strict=True):
            columns = where.factor(e) if kind == "factor" else free_directions(e, where)
            if columns.shape[2]:
                pull.append(np.swapaxes(carry @ at @ columns, -1, -2) @ load)
    weight = half_inverse(d)
    drive = weight @ _rows(pull, state.loads.cases) if pull else np.zeros((1, 0, state.loads.cases))
    y = np.swapaxes(weight, -1, -2) @ (half @ (force - own @ along.offset) + drive)
    names = [e.name for e, _ in connection.members]
    _check_balance(
        names,
        weight,
        d,
        np.swapaxes(b, -1, -2) @ (force - own @ along.offset) + (_rows(pull, state.loads.cases) if pull else 0.0),
    )
    moved = along.offset + b @ y  # twist of the node where all others stand still
    state.load(start, force + along.total)
    for c in step.neighbours:
        share = np.swapaxes(around[c], -1, -2) @ moved
        state.load(c, share)
        state.load(start, -share)
    state.done.append((along, b, np.swapaxes(weight, -1, -2) @ half, y, around, force))


def _check_balance(names: Sequence[str], half: Array, matrix: Array, load: Array) -> None:
    """Refuse a load along a direction that a generalized inverse has dropped."""
    if not (np.einsum("nii->ni", half) == 0.0).any():
        return
    left = np.abs(load - matrix @ (np.swapaxes(half, -1, -2) @ (half @ load)))
    size = np.abs(load).max(axis=(1, 2), keepdims=True)
    if (left > BALANCED * size + 1e-300).any():
        _refuse(names)


def _refuse(names: Sequence[str]) -> None:
    raise InputError(f"{', '.join(names)}: moves freely under its load, there is no equilibrium")


def _rows(blocks: list[Array], cases: int) -> Array:
    n = max(len(b) for b in blocks)
    return np.concatenate([np.broadcast_to(b, (n, b.shape[1], cases)) for b in blocks], axis=1)


def _drop(state: Condensed, a: str, b: str) -> None:
    state.pairs.pop((a, b), None)
    state.pairs.pop((b, a), None)


def tool_stiffness(state: Condensed) -> Array:
    """Stiffness (n or 1, 6, 6) at M in base axes. Raises InputError where it would be infinite."""
    order = state.order
    if order.left:
        from stiffscope.vjm.saddle import saddle_unit

        return saddle_unit(state)[0]
    if (GROUND, END) in state.pairs or (END, GROUND) in state.pairs:
        return state.pair(END, GROUND)
    return np.zeros((1, 6, 6))


__all__ = ["Condensed", "Connection", "Loads", "Order", "condensed", "order_of", "spelled", "tool_stiffness"]
