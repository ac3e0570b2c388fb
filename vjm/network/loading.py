"""Loads on an elastic network, and the response of its nodes and elements to them."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property, reduce
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from stiffscope.vjm.network.network import END
from stiffscope.vjm.network.order import stack_rows

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stiffscope.vjm.model.joints import Law
    from stiffscope.vjm.model.screws import Array
    from stiffscope.vjm.network.network import Element, Places
    from stiffscope.vjm.network.order import Connection

Wanted = Literal["all", "nodes", "wrenches"]
HELD = (
    1e12  # value of `balanced` if friction holds all motions that do not move the tool
)
_SLIGHT = 1e-2  # of a load: friction limit along a motion that does not move the tool


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
class CondensedLoads:
    """Loads carried through a condensation: ``forces`` (n or 1, 6, c) on the remaining nodes.

    ``recovery``: what each step needs to recover its part of the response.
    """

    loads: Loads
    forces: dict[str, Array]
    recovery: list[Any] = field(default_factory=list[Any])

    def add(self, node: str, wrench: Array) -> None:
        """Add a wrench to a node."""
        self.forces[node] = (
            self.forces[node] + wrench if node in self.forces else wrench
        )

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

    @property
    def motions(self) -> Array:
        """Motions (n, k, c) along its joint's free directions, including those with springs."""
        joint = self.element.joint
        if joint is None or joint.spring is None:
            return self.rates
        along = joint.type.driven
        if along is not None:
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
        if (
            self.law is not None and self.deflection is not None
        ):  # replaces the linear spring's
            force = self.law.force(self.deflection)
            energy = (
                energy
                - 0.5 * force**2 / self.law.slopes[0]
                + self.law.energy(self.deflection)
            )
        return energy


@dataclass(eq=False)
class Response:
    """Twists (n, 6, c) of ``nodes`` at M in base axes, m and rad, and states of ``elements``."""

    where: Places
    nodes: dict[str, Array]
    elements: dict[str, ElementState] = field(default_factory=dict[Any, Any])
    wanted: Wanted = "all"
    """What to recover: nodes without most elements, or elements' wrenches without their motions."""

    @property
    def twist(self) -> Array:
        """Twist (n, 6, c) of the tool."""
        return self.nodes[END]

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


@dataclass(eq=False)
class ChainLoads:
    """Loads along a connection, at M in base axes.

    ``carried``: wrenches (n or 1, 6, c) on each member's end by the loads on the nodes after it,
    from the start, where it is that of all; ``moved``: twists (n or 1, 6, c) of each member by its
    offset, and ``offset`` their sum.
    """

    connection: Connection
    where: Places
    carried: list[Array]
    loaded: list[bool]
    """Whether ``carried`` is not zero."""

    moved: list[Array | None]
    offset: Array

    def project(self, kinds: tuple[int, ...] = (0, 1)) -> Array:
        """Return inner loads (n, k, c) along its strains (kind 0), then its free motions (1)."""
        columns = [self.where.columns(e) for e, _ in self.connection.members]
        members = list(zip(columns, self.carried, self.loaded, strict=True))
        return stack_rows(
            c[kind].mT @ w if loaded else np.zeros((1, c[kind].shape[2], w.shape[2]))
            for kind in kinds
            for c, w, loaded in members
        )

    def follow(
        self,
        out: Response,
        wrench: Array,
        span: Array,
        rates: Array | None,
        fit: Array | None = None,
    ) -> None:
        """Recover members and inner nodes; the end moved by ``span`` carries ``wrench``.

        ``rates`` (n, k, c) of the free motions; else by ``fit`` (n, k, 6) to the strainless twist.
        """
        nothing = np.zeros((1, 6, span.shape[2]))
        members = self.connection.members
        inner = zip(self.carried, self.loaded, strict=True)
        wrenches = [wrench + w if loaded else wrench for w, loaded in inner]
        if out.wanted == "wrenches" and self.connection.bare:
            for (e, sign), w in zip(members, wrenches, strict=True):
                out.elements[e.name] = ElementState(
                    e, out.where, sign * w, nothing, nothing[:, :0]
                )
            return
        strained: list[Array | None] = []
        for (e, _), w, moved in zip(members, wrenches, self.moved, strict=True):
            f = out.where.columns(e)[0]
            part = f @ (f.mT @ w) if f.shape[2] else None
            strained.append(
                moved if part is None else part if moved is None else part + moved
            )
        if rates is None:
            left = reduce(
                np.subtract, (part for part in strained if part is not None), span
            )
            rates = nothing[:, :0] if fit is None else fit @ left
        node = out.nodes[self.connection.start]
        at = 0
        ends = (*self.connection.inner, None)
        for (e, sign), w, part, end in zip(
            members, wrenches, strained, ends, strict=True
        ):
            wanted = out.wanted != "nodes" or e.is_split
            if end is None and not wanted:
                break
            free = out.where.columns(e)[1]
            across = nothing if part is None else part
            rate = rates[:, at : at + free.shape[2]]
            at += free.shape[2]
            if free.shape[2]:
                across = across + free @ rate
            if wanted:
                state = (w, across, rate) if sign > 0.0 else (-w, -across, -rate)
                out.elements[e.name] = ElementState(e, out.where, *state)
            if end is not None:
                node = out.nodes[end] = node + across


def chain_loads(
    where: Places, load: CondensedLoads, connection: Connection
) -> ChainLoads:
    """Collect loads and offsets along a connection."""
    none: Array = np.zeros((1, 6, load.loads.cases))
    total = none
    offset = none
    offsets = load.loads.offsets
    each: list[Array] = [none]
    loaded = [False]
    for node in reversed(connection.inner):
        if node in load.forces:
            total = load.forces[node] if total is none else total + load.forces[node]
        each.insert(0, total)
        loaded.insert(0, bool(total.any()))
    moved: list[Array | None] = []
    for e, sign in connection.members:
        twist = (
            where.adjoint(e) @ (sign * offsets[e.name]) if e.name in offsets else None
        )
        moved.append(twist)
        if twist is not None:
            offset = twist if offset is none else offset + twist
    return ChainLoads(
        connection=connection,
        where=where,
        carried=each,
        loaded=loaded,
        moved=moved,
        offset=offset,
    )
