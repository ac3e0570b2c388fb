"""Elimination order of an elastic network, found once for a mechanism at home.

Unbranched chains become one connection with compliance C and free directions N. A connection is
stiffened if it has compliance in all directions outside N, else it is folded: the node at its end
takes its coordinates. Nodes between stiffnesses are eliminated. Bodies of three or more ends are
kept.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations
from typing import TYPE_CHECKING, Any, TypeAlias
from weakref import WeakKeyDictionary

import numpy as np

from stiffscope.vjm.model.checks import GROUND
from stiffscope.vjm.model.screws import Frame
from stiffscope.vjm.model.semidefinite import (
    inverse,
    multiply_transposed,
    pivot,
    projector,
)
from stiffscope.vjm.network.network import (
    END,
    Element,
    Places,
    list_elements,
    list_nodes,
    map_links,
    moves_with,
)

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    from stiffscope.vjm.kinematics.linkage import Linkage
    from stiffscope.vjm.model.mechanism import Mechanism
    from stiffscope.vjm.model.screws import Array

ROUNDING = 1e-10  # relative remainder of a motion that is entirely free
RIGID = 1e-13  # relative pivot below which a constrained direction is rigid
_LOST = 1e-12  # relative pivot, times the smallest one before it, that may be rounding
Members: TypeAlias = "tuple[tuple[Element, float], ...]"


@dataclass(frozen=True, eq=False)
class Connection:
    """Elements in series from node ``start`` to ``end``; -1 marks an element passed in reverse.

    ``anchor``: node whose body carries the connection's axes; ``origin`` (3,): their origin at
    home. In its own axes, ``constant``: stiffness (6, 6), and ``columns``: factors, then free
    directions (6, m) of its members, if they are independent of the pose.
    """

    start: str
    end: str
    members: Members
    anchor: str
    origin: Array
    constant: Array | None = None
    columns: Array | None = None
    bare: bool = True
    """Whether nothing else was attached to its inner nodes."""

    formable: bool | None = None
    """Whether it can be stiffened; None if not yet tried."""

    def reverse(self) -> Connection:
        """Return the connection from its end to its start."""
        turned = tuple((e, -s) for e, s in reversed(self.members))
        return replace(self, start=self.end, end=self.start, members=turned)

    @property
    def inner(self) -> tuple[str, ...]:
        """Nodes between its members, from the start."""
        return tuple(e.second if s > 0.0 else e.first for e, s in self.members[:-1])

    def frame(self, where: Places) -> Frame:
        """Return the connection's frame relative to M."""
        return Frame(
            where.rotation[self.anchor],
            where.point(self.anchor, self.origin) - where.tool,
        )

    def flexible(self, where: Places) -> tuple[Array, Array]:
        """Return factor F (n or 1, 6, r) and free directions N (n or 1, 6, k) at M, base axes."""
        factors, free = zip(*(where.columns(e) for e, _ in self.members), strict=True)
        return stack_columns(factors), stack_columns(free)


@dataclass(frozen=True, eq=False)
class Fold:
    """Step that eliminates a node with stiffnesses to ``neighbours``.

    It moves as its flexible ``connection``, if it has one, lets it; without one it is free.
    """

    node: str
    neighbours: tuple[str, ...]
    connection: Connection | None = None


Step: TypeAlias = "Connection | Fold"
"""A connection is stiffened: turned into a stiffness between its nodes."""


@dataclass(frozen=True, eq=False)
class Order:
    """Elimination order of a mechanism's network, found at home.

    ``left``: connections that no step could remove, between ``kept`` nodes.
    """

    mechanism: Mechanism
    elements: tuple[Element, ...]
    length: float
    steps: tuple[Step, ...]
    left: tuple[Connection, ...]
    kept: tuple[str, ...]
    linkage: Linkage
    independent: dict[str, tuple[Array, NDArray[np.intp]]] = field(
        default_factory=dict[Any, Any]
    )
    """Cached scale and independent rows at home of saddle-point systems, by their use."""

    @cached_property
    def constant(self) -> list[tuple[Connection, Array]]:
        """Stiffened connections with constant stiffness, and that stiffness in their axes."""
        stiff = [step for step in self.steps if isinstance(step, Connection)]
        return [(c, c.constant) for c in stiff if c.constant is not None]

    @cached_property
    def moving(self) -> list[Element]:
        """Elements of all connections but those with constant stiffness."""
        steps = [s if isinstance(s, Connection) else s.connection for s in self.steps]
        members = [
            c for c in (*steps, *self.left) if c is not None and c.constant is None
        ]
        return [e for c in members for e, _ in c.members]

    @cached_property
    def unstiffened_order(self) -> Order:
        """Order without stiffening, for networks with an infinite stiffness."""
        return _Planner(self.mechanism, self.linkage).order(stiffen=False)


_orders: WeakKeyDictionary[Mechanism, Order] = WeakKeyDictionary()


def find_order(mechanism: Mechanism, linkage: Linkage) -> Order:
    """Return the cached elimination order of a mechanism."""
    if mechanism not in _orders:
        _orders[mechanism] = _Planner(mechanism, linkage).order()
    return _orders[mechanism]


def places_at_home(mechanism: Mechanism) -> Places:
    """Return the places of all nodes at home."""
    nodes = list_nodes(mechanism)
    still: dict[str, Array] = dict.fromkeys(nodes, np.eye(3)[None])
    here: dict[str, Array] = dict.fromkeys(nodes, np.zeros((1, 3)))
    return Places(still, here, mechanism.tool.at[None])


class _Planner:
    def __init__(self, mechanism: Mechanism, linkage: Linkage) -> None:
        self.mechanism = mechanism
        self.linkage = linkage
        self.length = linkage.length
        self.links = map_links(linkage)
        self.home = places_at_home(mechanism)
        self.elements = list_elements(mechanism)
        self.flexible = [
            _connection(e.first, e.second, ((e, 1.0),)) for e in self.elements
        ]
        self.shared = {
            node for e in self.elements if e.group for node in (e.first, e.second)
        }
        self.stiff: dict[
            frozenset[str], None
        ] = {}  # ordered, so that runs are reproducible
        self.nodes = [n for n in list_nodes(mechanism) if n not in {GROUND, END}]
        self.steps: list[Step] = []
        self.attached: set[str] = (
            set()
        )  # nodes from which, or to which, others were eliminated

    def order(self, *, stiffen: bool = True) -> Order:
        while True:
            self._merge()
            if self._prune():
                continue
            if not stiffen:
                break
            tried = [
                self._try_connection(c) if c.formable is None else c
                for c in self.flexible
            ]
            self.flexible = [c for c in tried if not c.formable]
            for c in (c for c in tried if c.formable):
                self.steps.append(c)
                self.stiff[frozenset((c.start, c.end))] = None
            if not self._take_out():
                break
        steps = tuple(self.steps)
        left = tuple(self.flexible)
        remaining = tuple(self.nodes)
        return Order(
            self.mechanism,
            self.elements,
            self.length,
            steps,
            left,
            remaining,
            self.linkage,
        )

    def _find_connections(self, node: str) -> list[Connection]:
        return [c for c in self.flexible if node in {c.start, c.end}]

    def _neighbours(self, node: str) -> list[str]:
        return [next(iter(pair - {node})) for pair in self.stiff if node in pair]

    def _merge(self) -> None:
        """Join the two connections at a node that has no others."""
        for node in list(self.nodes):
            here = self._find_connections(node)
            if len(here) != 2 or node in self.shared or self._neighbours(node):
                continue
            a, b = here
            a = a if a.end == node else a.reverse()
            b = b if b.start == node else b.reverse()
            if a.start == b.end:  # in parallel
                continue
            self.flexible = [c for c in self.flexible if c not in here]
            whole = _connection(a.start, b.end, a.members + b.members)
            self.flexible.append(
                replace(whole, bare=a.bare and b.bare and node not in self.attached)
            )
            self.nodes.remove(node)

    def _prune(self) -> bool:
        """Fold a dead end, which carries only its own loads and may be singular; else False."""
        for node in self.nodes:
            here = self._find_connections(node)
            if (
                len(here) == 1
                and node not in self.shared
                and not self._neighbours(node)
            ):
                self._take(node)
                return True
        return False

    def _take_out(self) -> bool:
        """Eliminate or fold the node with the fewest neighbours; False if none is ready."""
        alone = [node for node in self.nodes if len(self._find_connections(node)) <= 1]
        ready = [node for node in alone if node not in self.shared]
        if ready:
            self._take(min(ready, key=lambda node: len(self._neighbours(node))))
        return bool(ready)

    def _take(self, node: str) -> None:
        """Eliminate or fold a node with at most one flexible connection."""
        around = self._neighbours(node)
        connection = None
        here = self._find_connections(node)
        self.flexible = [c for c in self.flexible if c not in here]
        if here:
            connection = here[0] if here[0].end == node else here[0].reverse()
        self.steps.append(Fold(node, tuple(around), connection))
        if connection and around:
            around = list(dict.fromkeys([*around, connection.start]))
        self.attached.update(around, [connection.start] if connection else [])
        left = [pair for pair in self.stiff if node not in pair]
        self.stiff = dict.fromkeys(
            [*left, *(frozenset(pair) for pair in combinations(around, 2))]
        )
        self.nodes.remove(node)

    def _try_connection(self, c: Connection) -> Connection:
        """Find out whether a connection can be stiffened, and whether its stiffness is constant."""
        factor, free = c.flexible(self.home)
        if factor.shape[2] + free.shape[2] < 6:
            return replace(c, formable=False)
        k, formable = form_stiffness(factor, free, self.length)
        if formable and all(
            moves_with(e, self.links[c.anchor], self.links) for e, _ in c.members
        ):
            frame = c.frame(self.home)
            anchor_link = self.links[c.anchor]
            apart = [e for e, _ in c.members if self.links[e.carrier] != anchor_link]
            still = all(
                e.joint and e.joint.type.driven is not None and not e.factor.size
                for e in apart
            )
            columns = frame.inverse_adjoint() @ stack_columns([factor, free])
            k = frame.adjoint().mT @ k @ frame.adjoint()
            return replace(
                c, constant=k, columns=columns[0] if still else None, formable=True
            )
        return replace(c, formable=formable)


def _connection(start: str, end: str, members: Members) -> Connection:
    """Create a connection whose axes are fixed to its first elastic body."""
    body = next(
        (e for e, _ in members if e.joint is None and e.factor.shape[1]), members[0][0]
    )
    return Connection(
        start,
        end,
        members,
        body.carrier,
        body.at,
        formable=False if body.group else None,
    )


def stack_columns(blocks: Iterable[Array]) -> Array:
    """Concatenate columns (n or 1, d, r) of blocks."""
    parts = list(blocks)
    parts = [b for b in parts if b.shape[2]] or parts[:1]
    return parts[0] if len(parts) == 1 else _concatenate(parts, -1)


def stack_rows(blocks: Iterable[Array]) -> Array:
    """Concatenate rows (n or 1, r, c) of blocks."""
    return _concatenate(list(blocks), 1)


def _concatenate(parts: list[Array], axis: int) -> Array:
    n = max(map(len, parts))
    parts = [b if len(b) == n else np.broadcast_to(b, (n, *b.shape[1:])) for b in parts]
    return np.concatenate(parts, axis=axis)


def form_stiffness(factor: Array, free: Array, length: float) -> tuple[Array, bool]:
    """Return the stiffness (n, 6, 6) of F Fᵀ with free directions N, and whether it is finite.

    With P the projector onto N's complement, ``K = P (P C P + s (I - P))⁻¹ P``, lengths scaled.

    Parameters
    ----------
    factor
        Factor F (n, 6, k) of the compliance.
    free
        Free directions (n, 6, f).
    length
        Characteristic length (m) that scales rotations to translations.
    """
    scale = np.array([1.0 / length] * 3 + [1.0] * 3)[:, None]
    f = factor * scale
    p = np.eye(6)[None]
    rank = np.zeros(1)
    if free.shape[2]:
        p, rank = projector(free * scale)
        p = p * (rank < 6.0)[:, None, None]
        size = np.einsum("nij,nij->nj", f, f)
        f = p @ f
        f = f * (np.einsum("nij,nij->nj", f, f) > ROUNDING**2 * size)[:, None]
    core = multiply_transposed(f.mT)
    mean = np.where(
        rank < 6.0, np.einsum("nii->n", core) / np.maximum(6.0 - rank, 1.0), 1.0
    )
    core = core + mean[:, None, None] * (np.eye(6) - p)
    half, pivots = pivot(core, RIGID)
    least = np.minimum.accumulate(np.clip(pivots[:, :-1], _LOST, 1.0), axis=1)
    finite = bool((pivots > RIGID).all() and (pivots[:, 1:] * least > _LOST).all())
    return multiply_transposed(half @ p * scale[:, 0]), finite


def fit_free_motions(free: Array, length: float) -> Array:
    """Return the map (n, k, 6) from a twist to nearest coordinates of free directions (n, 6, k)."""
    scale = np.array([1.0 / length] * 3 + [1.0] * 3)
    unit = free * scale[:, None]
    return inverse(multiply_transposed(unit)) @ unit.mT * scale
