"""Tangent stiffness under load: Hessian of the potential energy at the loaded equilibrium.

The network is bent by its loads (every node by its twist) and condensed again; the second-order
work of its wrenches is added. A closed kinematic pair of nodes i, j with coordinates y along
ordered screws s obeys ``log(exp(-u_i) exp(u_j)) = log Π exp(s_a y_a)``. To second order both sides
are Lie brackets (Baker-Campbell-Hausdorff): a carried wrench w contributes
``-½ w·[u_i, u_j] - ½ Σ_{a<b} w·[s_a, s_b] y_a y_b``, a weight f at a lever r
``-½ f·(ω × (v + ω × r))``. Internal motions are stationary and need no correction.

Order of motions: in a joint, slides, bearing and drive, rotations; in an elastic body Tx Ty Tz Rx
Ry Rz.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.vjm.checks import GROUND
from stiffscope.vjm.condensation import condense_loads, condense_network, store_energy
from stiffscope.vjm.equilibrium import solve_condensed, solve_loads, tool_stiffness
from stiffscope.vjm.loading import HELD, Loads
from stiffscope.vjm.network import END, Places, free_directions, lump_masses
from stiffscope.vjm.order import stack_columns, stack_rows
from stiffscope.vjm.screws import rotation_of, skew
from stiffscope.vjm.semidefinite import inverse
from stiffscope.vjm.strain import find_offsets, find_remaining_offsets

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from stiffscope.vjm.condensation import Condensed
    from stiffscope.vjm.loading import ElementState, Response
    from stiffscope.vjm.mechanism import Mechanism
    from stiffscope.vjm.network import Element
    from stiffscope.vjm.order import Order
    from stiffscope.vjm.screws import Array

_SMALL = 1e-4  # rad or relative length: displacement beyond which equilibrium is refined
_SETTLED = 1e-7
_STEPS = 12
_STILL = np.zeros((1, 6, 6))  # six cases with the tool at rest
_SLOW = 3e-4  # of the motions, as root energy; less changes the stiffness by below 1e-10


def own_loads(order: Order, where: Places) -> Loads:
    """The mechanism's own weight, its offsets, and springs that are not at rest: one case."""
    return Loads(1, _find_weights(order, where), find_offsets(order, where))


def _find_weights(order: Order, where: Places) -> dict[str, Array]:
    gravity = order.mechanism.gravity
    masses = lump_masses(order.mechanism, where) if gravity.any() else {}
    return {node: mass.weight(gravity) for node, mass in masses.items()}


def loaded_stiffness(order: Order, where: Places) -> Array:
    """Stiffness at M in base axes under the mechanism's own weight and offsets, and its sag behind it, (n, 6, 7).

    The sag is that of small displacements; the stiffness is taken at the equilibrium of finite ones, and is NaN where
    none is found. Raises InputError where the tool moves freely.
    """
    bent = bend_network(order, where)
    matrix, slack = _tangent(order, bent.there, where)
    slack = slack & bent.found
    if slack.any():
        matrix[slack] = _tangent(order, bent.there.some(slack), where.some(slack), thorough=True)[0]
    matrix[~bent.found] = np.nan
    return stack_columns([matrix, bent.sag[..., None]])


@dataclass(frozen=True, eq=False)
class Bent:
    """Equilibrium places ``there`` under own loads, if ``found`` (n,); linear ``sag`` (n, 6)."""

    there: Places
    sag: Array
    found: NDArray[np.bool_]


def bend_network(order: Order, where: Places, small: float = _SMALL) -> Bent:
    """Equilibrium under own weight and offsets: a linear step, and more where displacements are not ``small``.

    Parameters
    ----------
    order
        Elimination order of the network.
    where
        Places of all nodes at n configurations.
    small
        Rad, or of the mechanism's length, up to which one step is enough; smaller costs more steps.
    """
    moved = solve_loads(order, where, own_loads(order, where))
    n = len(where.tool)
    there, size = bend_places(where, moved), _find_size(moved, order.length)
    far = size > small
    if far.any():
        rest, bent, left = where.some(far), there.some(far), size[far]
        for _ in range(_STEPS):
            step = solve_loads(order, bent, _remaining_loads(order, bent, rest))
            bent, last, left = bend_places(bent, step), left, _find_size(step, order.length)
            if not (left * np.minimum(left / last, 1.0) > _SETTLED).any():  # next step, estimated
                break
        size[far] = left
        there = bent if far.all() else there.replace_some(far, bent)
    return Bent(there, np.broadcast_to(moved.twist[..., 0], (n, 6)), ~(size > _SMALL) | ~far)


def _tangent(order: Order, there: Places, rest: Places, *, thorough: bool = False) -> tuple[Array, NDArray[np.bool_]]:
    """Tangent stiffness (n, 6, 6) at bent places, and where (n,) internal motions change too much for a first order.

    ``thorough``: iterate internal motions to convergence instead of first order.
    """
    state = condense_network(order, there)
    work = SecondOrder(solve_condensed(state, _remaining_loads(order, there, rest)), order.mechanism)
    unit = Motion.of(solve_condensed(state, Loads(6, balanced=HELD), np.eye(6)[None]))
    stiffness = tool_stiffness(state)
    change, slack = _relax(state, work, unit, stiffness, thorough=thorough)
    n = len(there.tool)
    return np.array(np.broadcast_to(stiffness + change, (n, 6, 6))), np.broadcast_to(slack, n)


def loaded_compliance(order: Order, where: Places) -> Array:
    """Compliance of the tool under own weight and offsets, and its sag behind it, (n, 6, 7); as ``loaded_stiffness``.

    It serves where the stiffness is infinite in some direction. With X the motions for unit wrenches on the tool and H
    the Hessian of the second-order work, these change by δ where ``H₀ δ = -H (X + δ)``.
    """
    bent = bend_network(order, where, 0.0)
    there = bent.there
    work = SecondOrder(solve_loads(order, there, _remaining_loads(order, there, where)), order.mechanism)
    unit = Motion.of(solve_loads(order, there, Loads(6, {END: np.eye(6)[None]}, balanced=HELD)))
    change = _settle_motions(work, unit, lambda loads: solve_loads(order, there, loads), held=False)
    matrix = unit.nodes[END] + change.nodes[END]
    matrix = np.where(bent.found[:, None, None], 0.5 * (matrix + matrix.mT), np.nan)
    return stack_columns([matrix, bent.sag[..., None]])


def _relax(
    state: Condensed, work: SecondOrder, unit: Motion, stiffness: Array, *, thorough: bool
) -> tuple[Array, NDArray[np.bool_]]:
    """Change (n, 6, 6) of the stiffness by the second-order work, and where (n,) internal motions change too much.

    With H the Hessian of that work and X the motions for unit tool twists, X changes by δ with
    ``H₀ δ = -H (X + δ)``. The stationary stiffness changes by ``Xᵀ H X - δᵀ H₀ δ`` for the first δ,
    whose relative energy bounds the rest, and by ``Xᵀ H (X + δ)`` for the last.
    """
    if thorough:
        relaxed = _settle_motions(work, unit, lambda loads: solve_condensed(state, loads, _STILL))
        change = work.differentiate(unit.plus(relaxed, 0.5))[0] - 0.25 * work.differentiate(relaxed)[0]
        return change, np.zeros(1, dtype=bool)
    square, wrenches = work.differentiate(unit)
    loads = Loads(6, wrenches, balanced=HELD)
    if state.order.left:
        held = solve_condensed(state, loads, _STILL)
        stored = sum((wrench.mT @ held.nodes[node] for node, wrench in wrenches.items()), np.zeros((1, 6, 6)))
    else:
        stored = store_energy(state, condense_loads(state, loads))
    slack = np.einsum("nii->ni", stored) > _SLOW**2 * np.einsum("nii->ni", stiffness)
    return square - 0.5 * (stored + stored.mT), slack.any(axis=1)


def _settle_motions(
    work: SecondOrder, unit: Motion, solve: Callable[[Loads], Response], *, held: bool = True
) -> Motion:
    """Change δ of six motions X to convergence, where ``H₀ δ = -H (X + δ)``; ``held``: with the tool at rest."""
    change = unit.plus(unit, -1.0)
    for _ in range(_STEPS):
        loads = Loads(6, work.differentiate(unit.plus(change, 1.0), held=held)[1], balanced=HELD)
        before, change = change, Motion.of(solve(loads))
        if (change.plus(before, -1.0).size <= _SETTLED * unit.size).all():
            break
    return change


def _remaining_loads(order: Order, there: Places, rest: Places) -> Loads:
    nodes = _find_weights(order, there)
    return Loads(1, nodes, find_remaining_offsets(order, there, rest), balanced=HELD)


def _find_size(moved: Response, length: float) -> Array:
    """Return the largest rotation, or relative translation, of any node (n,)."""
    unit = np.repeat([1.0 / length, 1.0], 3)
    return np.max(np.broadcast_arrays(*(np.abs(u[..., 0] * unit).max(axis=1) for u in moved.nodes.values())), axis=0)


def bend_places(where: Places, response: Response) -> Places:
    """Move every node by its twist of the first case."""
    rotation, position = dict(where.rotation), dict(where.position)
    for node, twist in response.nodes.items():
        if node == GROUND:
            continue
        v, turn = twist[:, :3, 0], rotation_of(twist[:, 3:, 0])
        rotation[node] = turn @ where.rotation[node]
        arm = where.position[node] - where.tool
        position[node] = where.tool + v + (turn @ arm[..., None])[..., 0]
    tool = where.tool + response.nodes[END][:, :3, 0]
    return Places(rotation, position, tool, rigid=False)


@dataclass(eq=False)
class Motion:
    """Six motions of a network.

    Node twists (n, 6, 6) at M in base axes; for elements with several motions, their twist and
    their rotations (n, k, 6) about the axes of ``list_axes``, in element axes.
    """

    nodes: dict[str, Array]
    twist: dict[str, Array]
    turns: dict[str, Array]

    @classmethod
    def of(cls, response: Response) -> Motion:
        """Those of a response's cases."""
        out = cls(response.nodes, {}, {})
        for name, state in response.elements.items():
            e = state.element
            if e.factor.shape[1] + e.free.shape[1] < 2:
                continue
            twist = out.twist[name] = state.twist
            if e.joint is None:  # no free motions: all of its twist is strain
                out.turns[name] = twist[:, 3:]
                continue
            factor, rates = state.where.factor(e), state.rates
            stress = factor.mT @ state.wrench
            own = factor.shape[2] - e.sprung
            strained = [factor[:, 3:, :own] @ stress[:, :own]] if own and _is_ordered(e) else []
            out.turns[name] = stack_rows([*strained, stress[:, own:], rates])
        return out

    @property
    def size(self) -> Array:
        """Largest of all nodes' twists (n,)."""
        return np.max(np.broadcast_arrays(*(np.abs(u).max(axis=(1, 2)) for u in self.nodes.values())), axis=0)

    def plus(self, other: Motion, times: float) -> Motion:
        """Return the sum with ``times`` the other."""
        keys = ("nodes", "twist", "turns")
        mine, theirs = ([getattr(m, key) for key in keys] for m in (self, other))
        return Motion(*({k: a[k] + times * b[k] for k in a} for a, b in zip(mine, theirs, strict=True)))


def _is_ordered(element: Element) -> bool:
    """Return whether its rotations are successive; a ball joint rotates along one geodesic."""
    return element.joint is None or element.joint.kind != "spherical"


@dataclass(eq=False)
class SecondOrder:
    """Second-order work of what a response of one case carries, and of the weights."""

    response: Response
    mechanism: Mechanism

    @cached_property
    def _brackets(self) -> list[tuple[ElementState, Array]]:
        """Elements that deform, with half the bracket matrix of their wrenches."""
        states = self.response.elements.values()
        moving = [s for s in states if s.element.factor.shape[1] + s.element.free.shape[1]]
        return [(s, 0.5 * bracket(s.carried[..., 0])) for s in moving]

    @cached_property
    def _wrenches(self) -> dict[str, Array]:
        """Wrenches (n, 6) on elements, at their points in their axes."""
        where = self.response.where
        first = ((s.element, s.carried[..., :1]) for s, _ in self._brackets)
        return {e.name: (where.adjoint(e).mT @ carried)[..., 0] for e, carried in first}

    @cached_property
    def _weights(self) -> dict[str, Array]:
        """For every node with mass the matrix (n, 6, 6) of ``½ f·(ω × v)`` and ``½ f·(ω × (ω × r))``."""
        out: dict[str, Array] = {}
        gravity = self.mechanism.gravity
        for node, m in lump_masses(self.mechanism, self.response.where).items() if gravity.any() else ():
            lever = m.moment[:, :, None] * gravity
            matrix = out[node] = np.zeros((len(lever), 6, 6))
            matrix[:, :3, 3:] = 0.5 * skew(m.mass * gravity)
            matrix[:, 3:, :3] = -matrix[:, :3, 3:]
            matrix[:, 3:, 3:] = 0.5 * (lever + lever.mT) - np.einsum("nii->n", lever)[:, None, None] * np.eye(3)
        return out

    @cached_property
    def _orders(self) -> dict[str, tuple[Array, Array]]:
        """Half the Hessian (n, k, k) by an element's ordered rotations, and the map to moments."""
        out: dict[str, tuple[Array, Array]] = {}
        for state, _ in self._brackets:
            e, moment = state.element, self._wrenches[state.element.name][:, 3:]
            if not _is_ordered(e) or e.factor.shape[1] + e.free.shape[1] < 2 or not moment.any():
                continue
            axes = list_axes(state)
            k = axes.shape[1]
            hessian = 0.5 * np.triu(axes @ skew(moment) @ axes.mT, 1)
            hessian = hessian + hessian.mT
            back = axes.mT @ inverse(axes @ axes.mT) if k < 4 else inverse(axes.mT @ axes) @ axes.mT
            out[e.name] = hessian, back
        return out

    def differentiate(self, motion: Motion, *, held: bool = True) -> tuple[Array, dict[str, Array]]:
        """Return twice the second-order work (n, 6, 6), and minus its gradient (n, 6, 6) on nodes.

        ``held``: no wrench on the tool.
        """
        on_nodes: dict[str, Array] = {}

        def add(node: str, wrench: Array) -> None:
            on_nodes[node] = on_nodes[node] + wrench if node in on_nodes else wrench

        for state, matrix in self._brackets:
            e = state.element
            add(e.first, -matrix @ motion.nodes[e.second])
            add(e.second, matrix @ motion.nodes[e.first])
        for node, matrix in self._weights.items():
            add(node, matrix @ motion.nodes[node])
        square: Array = np.zeros((1, 6, 6))
        for node, wrench in on_nodes.items():
            if node != GROUND:
                square = square - motion.nodes[node].mT @ wrench
        for state, _ in self._brackets:
            if state.element.name in motion.twist:
                more, wrench = self._differentiate_own(state, motion)
                square = square + more
                add(state.element.first, wrench)
                add(state.element.second, -wrench)
        still = {GROUND, END} if held else {GROUND}
        return square, {node: wrench for node, wrench in on_nodes.items() if node not in still}

    def _differentiate_own(self, state: ElementState, motion: Motion) -> tuple[Array, Array]:
        """Return the same for the order of an element's motions: slides, spring, rotations.

        The work is ``-½ Σ_{a<b} w·[s_a, s_b] y_a y_b``; the wrench (n, 6, 6), at M, is on its first
        node.
        """
        name, twist = state.element.name, motion.twist[state.element.name]
        force = 0.5 * skew(self._wrenches[name][:, :3])
        push, turn = force @ twist[:, 3:], -force @ twist[:, :3]
        square = twist[:, :3].mT @ push
        square = square + square.mT
        if name in self._orders:
            hessian, back = self._orders[name]
            work = hessian @ motion.turns[name]
            square, turn = square + motion.turns[name].mT @ work, turn + back @ work
        frame = state.where.frame(state.element)
        return square, frame.inverse_adjoint().mT @ np.concatenate([push, turn], axis=1)


def list_axes(state: ElementState) -> Array:
    """Return axes (n or 1, k, 3) of ordered rotations: the spring's three, then the joint's."""
    e = state.element
    sprung = state.where.factor(e)[..., e.factor.shape[1] - e.sprung :]
    own = [np.eye(3)[None]] if e.factor.shape[1] > e.sprung else []
    return stack_rows([*own, stack_columns([sprung, free_directions(e, state.where)])[:, 3:].mT])


def bracket(wrench: Array) -> Array:
    """Return B (n, 6, 6) with ``uᵀ B v = -w·[u, v]`` for twists u, v and a wrench w (n, 6)."""
    out = np.zeros((len(wrench), 6, 6))
    out[:, :3, 3:] = out[:, 3:, :3] = skew(wrench[:, :3])
    out[:, 3:, 3:] = skew(wrench[:, 3:])
    return out
