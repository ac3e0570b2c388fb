"""Condensation of an elastic network to its tool, batched over poses.

All nodal twists and wrenches refer to M in base axes: members in series add compliances C and
collect free directions N, members in parallel add stiffnesses ``K = Z (Zᵀ C Z)⁻¹ Zᵀ``. Nodes are
eliminated by Schur complements, in the order of ``stiffscope.vjm.order``; parts stiff only through
rigid loops are solved with multipliers (``stiffscope.vjm.saddle``). No singular matrix is inverted.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from stiffscope.errors import InputError
from stiffscope.vjm.linkage import FEW
from stiffscope.vjm.order import Eliminate, Fold, Stiffen, fit_free_motions, form_stiffness, stack_columns
from stiffscope.vjm.screws import Frame
from stiffscope.vjm.semidefinite import half_inverse

if TYPE_CHECKING:
    from collections.abc import Iterator

    from stiffscope.vjm.network import Places
    from stiffscope.vjm.order import Connection, Order
    from stiffscope.vjm.screws import Array


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
    def fit(self) -> Array | None:
        """Least-squares map (n, k, 6) from a twist to free coordinates; None without any."""
        free = self.connection.flexible(self.where)[1]
        return fit_free_motions(free, self.length) if free.shape[2] else None


@dataclass(eq=False)
class Eliminated:
    """Eliminated node: ``half`` W, WᵀW an inverse of ``own``; ``reach`` W G of each neighbour."""

    step: Eliminate
    own: Array
    half: Array
    reach: list[Array]


@dataclass(eq=False)
class Folded:
    """A folded node: coordinates ``y = share · force``, twist from the start ``columns · y``.

    ``half`` W with WᵀW an inverse of the coordinates' stiffness ``core``; ``around``: stiffness to
    each neighbour; ``own``: their sum.
    """

    step: Fold
    columns: Array
    core: Array
    half: Array
    share: Array
    around: dict[str, Array]
    own: Array


Gone: TypeAlias = "Stiff | Eliminated | Folded"


@dataclass(eq=False)
class Condensed:
    """A network condensed to ground, tool and irremovable nodes: stiffnesses by node pair."""

    order: Order
    where: Places
    pairs: dict[tuple[str, str], Array] = field(default_factory=dict[Any, Any])
    gone: list[Gone] = field(default_factory=list[Any])

    def pair(self, a: str, b: str) -> Array:
        """Return G (n or 1, 6, 6) between two nodes: G times b's twist is a force on a."""
        if (a, b) in self.pairs:
            return self.pairs[a, b]
        return self.pairs[b, a].mT

    def add(self, a: str, b: str, stiffness: Array) -> None:
        """Add a stiffness between two nodes.

        Parameters
        ----------
        a
            One node.
        b
            The other node.
        stiffness
            Stiffness, SI.
        """
        if (b, a) in self.pairs:
            self.pairs[b, a] = self.pairs[b, a] + stiffness.mT
        elif (a, b) in self.pairs:
            self.pairs[a, b] = self.pairs[a, b] + stiffness
        else:
            self.pairs[a, b] = stiffness

    def drop(self, node: str, neighbours: tuple[str, ...]) -> None:
        """Remove the stiffnesses at an eliminated node."""
        for c in neighbours:
            self.pairs.pop((node, c), None)
            self.pairs.pop((c, node), None)


def condense_network(order: Order, where: Places) -> Condensed:
    """Condense a network. Raises InfiniteStiffnessError if a connection is infinitely stiff."""
    state = Condensed(order, where)
    ready = iter(_carry_constants(order, where) if where.rigid else ())
    for step in order.steps:
        match step:
            case Stiffen():
                state.gone.append(_stiffen(state, step.connection, ready))
            case Eliminate():
                state.gone.append(_eliminate(state, step))
            case Fold():
                state.gone.append(_fold(state, step))
    return state


def _carry_constants(order: Order, where: Places) -> Iterator[Array]:
    """Yield the constant connections' stiffnesses (n or 1, 6, 6) at M in base axes, in order."""
    n = len(where.tool)
    turned = [where.rotation[c.anchor] for c, _ in order.constant]
    moved = [where.position[c.anchor] for c, _ in order.constant]
    if not turned or n > FEW or any(len(each) != n for each in (*turned, *moved)):
        for c, constant in order.constant:
            back = c.frame(where).inverse_adjoint()
            yield back.mT @ constant @ back
        return
    rotation = np.array(turned)  # batched: for few poses call overhead dominates
    origins = np.array([c.origin for c, _ in order.constant])[:, None, :, None]
    back = Frame(rotation, (rotation @ origins)[..., 0] + moved - where.tool).inverse_adjoint()
    yield from back.mT @ np.array([constant for _, constant in order.constant]) @ back


def _stiffen(state: Condensed, connection: Connection, ready: Iterator[Array]) -> Stiff:
    if connection.constant is not None and state.where.rigid:
        stiffness = next(ready)
    else:
        stiffness, finite = form_stiffness(*connection.flexible(state.where), state.order.length)
        if not finite:
            names = ", ".join(e.name for e, _ in connection.members)
            raise InfiniteStiffnessError(
                f"{names}: infinite stiffness in a constrained direction; expected a compliance there"
            )
    state.add(connection.start, connection.end, stiffness)
    return Stiff(connection, state.where, state.order.length, stiffness)


def _eliminate(state: Condensed, step: Eliminate) -> Eliminated:
    around = [state.pair(step.node, c) for c in step.neighbours]
    own = sum(around, np.zeros((1, 6, 6)))
    half = half_inverse(own)
    reach: list[Array] = [half @ g for g in around]
    for i, a in enumerate(step.neighbours):
        for j in range(i):
            state.add(a, step.neighbours[j], reach[i].mT @ reach[j])
    state.drop(step.node, step.neighbours)
    return Eliminated(step, own, half, reach)


def _fold(state: Condensed, step: Fold) -> Folded:
    connection, start = step.connection, step.connection.start
    factor, free = connection.flexible(state.where)
    columns = stack_columns([factor, free])
    around = {c: state.pair(step.node, c) for c in step.neighbours}
    own = sum(around.values(), np.zeros((1, 6, 6)))
    core = columns.mT @ own @ columns
    np.einsum("nii->ni", core)[:, : factor.shape[2]] += 1.0  # unit springs
    half = half_inverse(core)
    pull = half @ columns.mT  # (n, m, 6)
    reach = {c: pull @ around[c] for c in step.neighbours if c != start}
    everything = sum(reach.values(), np.zeros((1, pull.shape[-2], 6)))
    others = list(reach)
    for i, c in enumerate(others):
        back = reach[c].mT
        state.add(c, start, around[c].mT - back @ everything)
        for other in others[:i]:
            state.add(c, other, back @ reach[other])
    state.drop(step.node, step.neighbours)
    return Folded(step, columns, core, half, half.mT @ pull, around, own)
