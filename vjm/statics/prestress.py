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

from dataclasses import dataclass, replace
from functools import cached_property, reduce
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.errors import InputError
from stiffscope.vjm.model.checks import GROUND, spell_name
from stiffscope.vjm.model.screws import rotation_of, skew
from stiffscope.vjm.model.semidefinite import inverse
from stiffscope.vjm.network.condensation import (
    condense_loads,
    condense_network,
    store_energy,
)
from stiffscope.vjm.network.loading import HELD, Loads
from stiffscope.vjm.network.network import END, Places, free_directions, lump_masses
from stiffscope.vjm.network.order import stack_columns, stack_rows
from stiffscope.vjm.network.strain import find_offsets, find_remaining_offsets
from stiffscope.vjm.statics.equilibrium import (
    solve_condensed,
    solve_loads,
    tool_stiffness,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from stiffscope.vjm.model.dynamics import Masses
    from stiffscope.vjm.model.mechanism import Mechanism
    from stiffscope.vjm.model.screws import Array
    from stiffscope.vjm.network.condensation import Condensed
    from stiffscope.vjm.network.loading import ElementState, Response
    from stiffscope.vjm.network.network import Element
    from stiffscope.vjm.network.order import Order

    Push = Callable[[Places, NDArray[np.bool_]], dict[str, Array]]

_SMALL = (
    1e-4  # rad or relative length: displacement beyond which equilibrium is refined
)
_SETTLED = 1e-7
_LOST = 10.0  # rad or relative length: step beyond which an equilibrium is given up
_STEPS = 12
_STILL = np.zeros((1, 6, 6))  # six cases with the tool at rest
_NONE = np.zeros((1, 1, 1))
_SLOW = (
    3e-4  # of the motions, as root energy; less changes the stiffness by below 1e-10
)


def own_loads(order: Order, where: Places) -> Loads:
    """The mechanism's own weight, its offsets, and springs that are not at rest: one case."""
    return Loads(1, _find_weights(order, where), find_offsets(order, where))


def _find_weights(order: Order, where: Places) -> dict[str, Array]:
    gravity = order.mechanism.gravity
    masses = lump_masses(order.mechanism, where) if gravity.any() else {}
    return {node: mass.weight(gravity) for node, mass in masses.items()}


def loaded_stiffness(order: Order, where: Places) -> Array:
    """Return stiffness at M in base axes under own weight and offsets, and the sag, (n, 6, 7).

    The sag is that of small displacements; the stiffness is taken at the equilibrium of finite
    ones, and is NaN where none is found. Raises InputError where the tool moves freely.
    """
    bent = bend_network(order, where)
    matrix, slack = _tangent(order, bent.there, where)
    slack = slack & bent.found
    if slack.any():
        matrix[slack] = _tangent(
            order, bent.there.some(slack), where.some(slack), thorough=True
        )[0]
    matrix[~bent.found] = np.nan
    return stack_columns([matrix, bent.sag[..., None]])


@dataclass(frozen=True, eq=False)
class Bent:
    """Equilibrium places ``there`` under own loads, if ``found`` (n,); linear ``sag`` (n, 6)."""

    there: Places
    sag: Array
    found: NDArray[np.bool_]


def bend_network(
    order: Order,
    where: Places,
    small: float = _SMALL,
    push: Push | None = None,
) -> Bent:
    """Equilibrium under dead loads and offsets: a linear step, and more where displacements are not ``small``.

    Parameters
    ----------
    order
        Elimination order of the network.
    where
        Places of all nodes at n configurations.
    small
        Rad, or of the mechanism's length, up to which one step is enough; smaller costs more steps.
    push
        Function of the places of some configurations and their flags (n,) that returns
        wrenches (m, 6, 1) on nodes at M, base axes; default: own weight.

    Raises
    ------
    InputError
        A joint that slides and turns has its bearing on the first body.
    """
    _check_bearings(order)
    n = len(where.tool)
    push = push or (lambda there, _: _find_weights(order, there))
    uncached = replace(where)  # what it caches is not kept
    every = np.ones(n, dtype=np.bool_)
    first = Loads(1, push(where, every), find_offsets(order, where))
    moved = solve_loads(order, uncached, first, "nodes")
    there = bend_places(where, moved)
    size = _find_size(moved, order.length)
    far = size > small
    going = far & ~(size > _LOST)
    rest = where.some(going)
    bent = there.some(going)
    left = size[going]
    for _ in range(_STEPS):
        if not going.any():
            break
        lack = find_remaining_offsets(order, bent, rest)
        remaining = Loads(1, push(bent, going), lack, balanced=HELD)
        step = solve_loads(order, bent, remaining, "nodes")
        bent = bend_places(bent, step)
        last = left
        left = _find_size(step, order.length)
        size[going] = left
        # what runs away has no equilibrium, and its numbers would overflow
        stays = ~(left > _LOST)
        if not stays.all():
            going[going] = stays
            rest = rest.some(stays)
            bent = bent.some(stays)
            left = left[stays]
            last = last[stays]
        # the next step, estimated
        if not (left * np.minimum(left / last, 1.0) > _SETTLED).any():
            break
    if going.any():
        there = bent if going.all() else there.replace_some(going, bent)
    return Bent(
        there, np.broadcast_to(moved.twist[..., 0], (n, 6)), ~(size > _SMALL) | ~far
    )


def _check_bearings(order: Order) -> None:
    """Refuse bearings on the first body of joints that turn, too: the axes of neither body do.

    Their motions would be bearing, slides, rotations, with slides along axes that the bearing tilts.
    """
    for e in order.elements:
        joint = e.joint
        if joint is not None and joint.is_on_first and not e.is_mirrored:
            raise InputError(
                f'{spell_name("joints", joint.name)}.carried_by: expected "second" for a '
                f"{joint.kind} joint at equilibria of finite displacements (exact gravity), "
                'got "first"'
            )


def _tangent(
    order: Order, there: Places, rest: Places, *, thorough: bool = False
) -> tuple[Array, NDArray[np.bool_]]:
    """Return the tangent stiffness (n, 6, 6) at bent places, and where (n,) it needs ``thorough``.

    ``thorough``: iterate internal motions to convergence instead of taking their first order.
    """
    state = condense_network(order, there)
    carried = solve_condensed(
        state, _remaining_loads(order, there, rest), wanted="wrenches"
    )
    work = SecondOrder(carried, order.mechanism)
    unit = Motion.of(
        solve_condensed(state, Loads(6, balanced=HELD), np.eye(6)[None], "nodes")
    )
    stiffness = tool_stiffness(state)
    change, slack = _relax(state, work, unit, stiffness, thorough=thorough)
    n = len(there.tool)
    return np.array(np.broadcast_to(stiffness + change, (n, 6, 6))), np.broadcast_to(
        slack, n
    )


def loaded_compliance(order: Order, where: Places) -> Array:
    """Return tool compliance under own weight and offsets, and the sag, as ``loaded_stiffness``.

    For stiffnesses that are infinite in some direction. With X the motions for unit wrenches on the
    tool and H the Hessian of the second-order work, X changes by δ with ``H₀ δ = -H (X + δ)``.
    """
    bent = bend_network(order, where, 0.0)
    there = bent.there
    carried = solve_loads(order, there, _remaining_loads(order, there, where))
    work = SecondOrder(carried, order.mechanism)
    unit = Motion.of(
        solve_loads(order, there, Loads(6, {END: np.eye(6)[None]}, balanced=HELD))
    )
    change = _settle_motions(
        work, unit, lambda loads: solve_loads(order, there, loads), held=False
    )
    matrix = unit.nodes[END] + change.nodes[END]
    matrix = np.where(bent.found[:, None, None], 0.5 * (matrix + matrix.mT), np.nan)
    return stack_columns([matrix, bent.sag[..., None]])


def _relax(
    state: Condensed,
    work: SecondOrder,
    unit: Motion,
    stiffness: Array,
    *,
    thorough: bool,
) -> tuple[Array, NDArray[np.bool_]]:
    """Return the stiffness change (n, 6, 6) by second-order work, and where it must be thorough.

    With H the Hessian of that work and X the motions for unit tool twists, X changes by δ with
    ``H₀ δ = -H (X + δ)``. The stationary stiffness changes by ``Xᵀ H X - δᵀ H₀ δ`` for the first δ,
    whose relative energy bounds the rest, and by ``Xᵀ H (X + δ)`` for the last.
    """
    if thorough:
        relaxed = _settle_motions(
            work, unit, lambda loads: solve_condensed(state, loads, _STILL)
        )
        middle, own = (
            work.differentiate(m)[0] for m in (unit.plus(relaxed, 0.5), relaxed)
        )
        return middle - 0.25 * own, np.zeros(1, dtype=bool)
    square, wrenches = work.differentiate(unit)
    loads = Loads(6, wrenches, balanced=HELD)
    if state.order.left:
        held = solve_condensed(state, loads, _STILL).nodes
        stored = sum(
            (w.mT @ held[node] for node, w in wrenches.items()), np.zeros((1, 6, 6))
        )
    else:
        stored = store_energy(state, condense_loads(state, loads))
    slack = np.einsum("nii->ni", stored) > _SLOW**2 * np.einsum("nii->ni", stiffness)
    return square - 0.5 * (stored + stored.mT), slack.any(axis=1)


def _settle_motions(
    work: SecondOrder,
    unit: Motion,
    solve: Callable[[Loads], Response],
    *,
    held: bool = True,
) -> Motion:
    """Iterate the change δ of six motions X, ``H₀ δ = -H (X + δ)``; ``held``: the tool rests."""
    change = unit.plus(unit, -1.0)
    for _ in range(_STEPS):
        loads = Loads(
            6, work.differentiate(unit.plus(change, 1.0), held=held)[1], balanced=HELD
        )
        before = change
        change = Motion.of(solve(loads))
        if (change.plus(before, -1.0).size <= _SETTLED * unit.size).all():
            break
    return change


def _remaining_loads(order: Order, there: Places, rest: Places) -> Loads:
    nodes = _find_weights(order, there)
    return Loads(1, nodes, find_remaining_offsets(order, there, rest), balanced=HELD)


def _find_size(moved: Response, length: float) -> Array:
    """Return the largest rotation, or relative translation, of any node (n,)."""
    moves = np.abs(stack_rows(moved.nodes.values())[..., 0])
    return (moves * np.tile(np.repeat([1.0 / length, 1.0], 3), len(moved.nodes))).max(
        axis=1
    )


def bend_places(where: Places, response: Response) -> Places:
    """Move every node by its twist of the first case."""
    rotation = dict(where.rotation)
    position = dict(where.position)
    for node, twist in response.nodes.items():
        if node == GROUND:
            continue
        v = twist[:, :3, 0]
        turn = rotation_of(twist[:, 3:, 0])
        rotation[node] = turn @ where.rotation[node]
        arm = where.position[node] - where.tool
        position[node] = where.tool + v + np.einsum("nij,nj->ni", turn, arm)
    tool = where.tool + response.nodes[END][:, :3, 0]
    return Places(rotation, position, tool, rigid=False)


@dataclass(eq=False)
class Motion:
    """Six motions of a network.

    Node twists (n, 6, 6) at M in base axes; for elements that rotate by strain and freely, their
    rotations (n, k, 6) about the axes of ``list_axes``, which their twist does not tell apart.
    """

    nodes: dict[str, Array]
    turns: dict[str, Array]

    @classmethod
    def of(cls, response: Response) -> Motion:
        """Those of a response's cases."""
        out = cls(response.nodes, {})
        for name, state in response.elements.items():
            e = state.element
            if e.is_split:
                factor = state.where.factor(e)
                free_count = e.factor.shape[1] - e.sprung
                stress = factor.mT @ state.wrench
                strained = factor[:, 3:, :free_count] @ stress[:, :free_count]
                out.turns[name] = stack_rows(
                    [strained, stress[:, free_count:], state.rates]
                )
        return out

    @property
    def size(self) -> Array:
        """Largest of all nodes' twists (n,)."""
        sizes = (np.abs(twists).max(axis=(1, 2)) for twists in self.nodes.values())
        return reduce(np.maximum, sizes)

    def plus(self, other: Motion, times: float) -> Motion:
        """Return the sum with ``times`` the other."""
        nodes: dict[str, Array] = {
            k: u + times * other.nodes[k] for k, u in self.nodes.items()
        }
        turns: dict[str, Array] = {
            k: u + times * other.turns[k] for k, u in self.turns.items()
        }
        return Motion(nodes, turns)


@dataclass(eq=False)
class SecondOrder:
    """Second-order work of what a response of one case carries, and of the weights."""

    response: Response
    mechanism: Mechanism

    @cached_property
    def _masses(self) -> dict[str, Masses]:
        heavy = self.mechanism.gravity.any()
        return lump_masses(self.mechanism, self.response.where) if heavy else {}

    @cached_property
    def _turns(self) -> list[tuple[Element, Array, Array]]:
        """Elements with ``Motion.turns``, half the Hessian by these, and the map to wrenches."""
        states = (s for s in self.response.elements.values() if s.element.is_split)
        return [(s.element, *order_rotations(s)) for s in states]

    def differentiate(
        self, motion: Motion, *, held: bool = True
    ) -> tuple[Array, dict[str, Array]]:
        """Return twice the second-order work (n, 6, 6), and minus its gradient (n, 6, 6) on nodes.

        ``held``: no wrench on the tool.
        """
        on_nodes: dict[str, Array] = {}

        def add(node: str, wrench: Array, sum_up: np.ufunc = np.add) -> None:
            have = on_nodes.get(node, _NONE)
            on_nodes[node] = sum_up(
                have, wrench, out=have if have.shape == wrench.shape else None
            )

        # no matrix is kept: memory takes longer than products
        for state in self.response.elements.values():
            e = state.element
            count = e.factor.shape[1] + e.free.shape[1]
            if not count:
                continue
            half = bracket(0.5 * state.carried[..., 0])
            first = motion.nodes[e.first]
            second = motion.nodes[e.second]
            add(e.first, half @ second, np.subtract)
            add(e.second, half @ first)
            if count > 1:
                work = differentiate_order(state) @ (second - first)
                add(e.first, work)
                add(e.second, work, np.subtract)
        gravity = self.mechanism.gravity
        for node, m in self._masses.items():
            work = lever_work(m.mass * gravity, m.moment[:, :, None] * gravity)
            add(node, work @ motion.nodes[node])
        square: Array = np.zeros((1, 6, 6))
        for node, wrench in on_nodes.items():
            square = square - motion.nodes[node].mT @ wrench
        for e, hessian, back in self._turns:
            work = hessian @ motion.turns[e.name]
            square = square + motion.turns[e.name].mT @ work
            add(e.first, back @ work)
            add(e.second, back @ work, np.subtract)
        still = {GROUND, END} if held else {GROUND}
        return square, {
            node: wrench for node, wrench in on_nodes.items() if node not in still
        }


def differentiate_order(state: ElementState) -> Array:
    """Return the Hessian (n, 6, 6) of the work for the order of an element's motions, by its twist.

    The work is ``-½ Σ_{a<b} w·[s_a, s_b] y_a y_b``: slides, spring, rotations.
    """
    e = state.element
    arm = state.where.frame(e).origin()
    force = state.carried[:, :3, 0]
    if e.is_mirrored:
        force = -force
    out = lever_work(force, arm[:, :, None] * force[:, None])
    if e.is_ordered and not e.is_split:
        hessian, back = order_rotations(state)
        out[:, 3:, 3:] += back[:, 3:] @ hessian @ back[:, 3:].mT
    return out


def order_rotations(state: ElementState) -> tuple[Array, Array]:
    """Return half the Hessian (n, k, k) by ordered rotations, and the map (n, 6, k) to wrenches."""
    # seen from the second body, wrench and motions are opposite
    side = -0.5 if state.element.is_mirrored else 0.5
    hessian = skew(side * state.wrench[:, 3:, 0])
    moment = state.where.frame(state.element).matrix()
    if state.element.joint is not None:
        axes = list_axes(state)
        few = axes.shape[1] < 4
        back = axes.mT
        hessian = axes @ hessian @ back
        moment = moment @ (
            back @ inverse(axes @ back) if few else inverse(back @ axes) @ back
        )
    k: Array = np.arange(hessian.shape[1], dtype=float)
    whole = np.concatenate([np.zeros_like(moment), moment], axis=1)
    return hessian * np.sign(k - k[:, None]), whole


def list_axes(state: ElementState) -> Array:
    """Return axes (n or 1, k, 3) of a joint's ordered rotations: its spring's, then its own."""
    e = state.element
    axes = [np.eye(3)[None]] if e.factor.shape[1] > e.sprung else []
    sprung = [state.where.factor(e)[:, 3:, -e.sprung :].mT] if e.sprung else []
    free = [free_directions(e, state.where)[:, 3:].mT] if e.free.shape[1] else []
    return stack_rows([*axes, *sprung, *free])


def lever_work(force: Array, lever: Array) -> Array:
    """Return the Hessian (n, 6, 6) of ``½ f·(ω × (v + ω × r))`` for f (n or none, 3), r fᵀ (n, 3, 3)."""
    out = np.zeros((len(lever), 6, 6))
    skew(0.5 * force, out[:, :3, 3:])
    skew(-0.5 * force, out[:, 3:, :3])
    work = np.einsum("nii->n", lever)[:, None, None]
    out[:, 3:, 3:] = 0.5 * (lever + lever.mT) - work * np.eye(3)
    return out


def bracket(wrench: Array) -> Array:
    """Return B (n, 6, 6) with ``uᵀ B v = -w·[u, v]`` for twists u, v and a wrench w (n, 6)."""
    out = np.zeros((len(wrench), 6, 6))
    skew(wrench[:, :3], out[:, :3, 3:])
    skew(wrench[:, :3], out[:, 3:, :3])
    skew(wrench[:, 3:], out[:, 3:, 3:])
    return out
