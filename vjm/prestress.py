"""Tangent stiffness of a mechanism that carries loads: the Hessian of its potential energy at the loaded equilibrium.

The network is bent by its loads (every node by its own twist), condensed again, and the second-order work of what it
carries is added. A closed kinematic pair of nodes i, j with coordinates y along ordered screws s obeys
``log(exp(-u_i) exp(u_j)) = log Π exp(s_a y_a)``; to second order both sides are Lie brackets (Baker, Campbell,
Hausdorff), so that a carried wrench w contributes ``-½ w·[u_i, u_j] - ½ Σ_{a<b} w·[s_a, s_b] y_a y_b``, and a weight
f at a lever r contributes ``-½ f·(ω × (v + ω × r))``. All internal motions are stationary, so that theirs need no
correction.

Of a joint, slides come first, then its bearing and drive, then its rotations; of an elastic body Tx Ty Tz Rx Ry Rz.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.vjm.checks import GROUND
from stiffscope.vjm.condensation import condense_network
from stiffscope.vjm.equilibrium import solve_held, solve_loads, tool_stiffness
from stiffscope.vjm.loading import HELD, Loads, condense_loads, recover_response, solve_tool, stack_rows
from stiffscope.vjm.network import END, Places, free_directions, lump_masses
from stiffscope.vjm.order import stack_columns
from stiffscope.vjm.saddle import saddle_loaded_unit
from stiffscope.vjm.screws import rotation_of, skew
from stiffscope.vjm.strain import find_offsets, find_remaining_offsets

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from stiffscope.vjm.condensation import Condensed
    from stiffscope.vjm.loading import ElementState, Response
    from stiffscope.vjm.mechanism import Mechanism
    from stiffscope.vjm.order import Order
    from stiffscope.vjm.screws import Array

_SMALL = 1e-4  # rad, or of the mechanism's length: displacements beyond which the linear equilibrium is improved
_SETTLED = 1e-7
_STEPS = 12
_SLIGHT = 1e-2  # of the motions, that they change by second-order work; one step gives that to 1e-6


def own_loads(order: Order, where: Places, gravity: Array) -> Loads:
    """The mechanism's own weight under ``gravity`` (3,), its offsets, and springs that are not at rest: one case.

    Parameters
    ----------
    order
        Order in which the network is condensed.
    where
        Places of all nodes at n configurations.
    gravity
        Acceleration (3,) in base axes, m/s².

    """
    nodes = (
        {node: m.weight(gravity) for node, m in lump_masses(order.mechanism, where).items()} if gravity.any() else {}
    )
    return Loads(1, nodes, find_offsets(order, where))


def loaded_stiffness(order: Order, where: Places, gravity: Array) -> tuple[Array, Array]:
    """Stiffness (n, 6, 6) at M in base axes under the mechanism's own weight and offsets, and its sag (n, 6).

    The sag is that of small displacements; the stiffness is taken at the equilibrium of finite ones, and is NaN where
    none is found. Raises InputError where the tool moves freely.

    Parameters
    ----------
    order
        Order in which the network is condensed.
    where
        Places of all nodes at n configurations.
    gravity
        Acceleration (3,) in base axes, m/s².

    """
    bent = bend_network(order, where, gravity)
    matrix, share = _tangent(order, bent.there, where, gravity)
    slack = (share > _SLIGHT) & bent.found
    if slack.any():
        matrix[slack] = _tangent(order, bent.there.some(slack), where.some(slack), gravity, thorough=True)[0]
    matrix[~bent.found] = np.nan
    return matrix, bent.sag


@dataclass(frozen=True, eq=False)
class Bent:
    """Nodes ``there`` at equilibrium under own loads, where it was ``found`` (n,), and the ``sag`` (n, 6) of small ones."""

    there: Places
    sag: Array
    found: NDArray[np.bool_]


def bend_network(order: Order, where: Places, gravity: Array, small: float = _SMALL) -> Bent:
    """Equilibrium under own weight and offsets: a linear step, and more where displacements are not ``small``.

    Parameters
    ----------
    order
        Order in which the network is condensed.
    where
        Places of all nodes at n configurations.
    gravity
        Acceleration (3,) in base axes, m/s².
    small
        Rad, or of the mechanism's length, up to which one step is enough; smaller costs more steps.

    """
    moved = solve_loads(order, where, own_loads(order, where, gravity))
    n = len(where.tool)
    there, size = bend_places(where, moved), find_size(moved, order.length)
    far = size > small
    if far.any():
        rest, bent = where.some(far), there.some(far)
        for _ in range(_STEPS):
            step = solve_loads(order, bent, _remaining_loads(order, bent, rest, gravity))
            bent, left = bend_places(bent, step), find_size(step, order.length)
            if not (left > _SETTLED).any():
                break
        size[far] = left  # pyright: ignore[reportPossiblyUnboundVariable]
        there = bent if far.all() else there.replace_some(far, bent)
    return Bent(there, np.broadcast_to(moved.twist[..., 0], (n, 6)), ~(size > _SMALL) | ~far)


def _tangent(
    order: Order, there: Places, rest: Places, gravity: Array, *, thorough: bool = False
) -> tuple[Array, Array]:
    """Tangent stiffness (n, 6, 6) at bent places, and the share (n,) by which internal motions change.

    ``thorough``: internal motions to convergence, not to first order.
    """
    state = condense_network(order, there)
    load = condense_loads(state, _remaining_loads(order, there, rest, gravity))
    if order.left:
        stiffness, ends, left = saddle_loaded_unit(state, load)
    else:
        stiffness, left = tool_stiffness(state), []
        unit = np.broadcast_to(np.eye(6), (len(stiffness), 6, 6))
        end = np.concatenate([solve_tool(stiffness, load.force(END)), unit], axis=2)
        ends = {GROUND: np.zeros((1, 6, 7)), END: end}
    work = SecondOrder(recover_response(state, load, ends, left, mix=np.eye(1, 7)), order.mechanism, gravity)
    change, share = _relax(state, work, thorough=thorough)
    n = len(there.tool)
    return np.array(np.broadcast_to(stiffness + change, (n, 6, 6))), np.broadcast_to(share, n)


def loaded_compliance(order: Order, where: Places, gravity: Array) -> tuple[Array, Array]:
    """Compliance (n, 6, 6) of the tool under own weight and offsets, and its sag (n, 6), as ``loaded_stiffness``.

    It serves where the stiffness is infinite in some direction. With X the motions for unit wrenches on the tool and H
    the Hessian of the second-order work, these change by δ where ``H₀ δ = -H (X + δ)``.

    Parameters
    ----------
    order
        Order in which the network is condensed.
    where
        Places of all nodes at n configurations.
    gravity
        Acceleration (3,) in base axes, m/s².

    """
    bent = bend_network(order, where, gravity, 0.0)
    there = bent.there
    loads = _remaining_loads(order, there, where, gravity)
    mix = np.eye(1, 7)
    nodes: dict[str, Array] = {node: wrench @ mix for node, wrench in loads.nodes.items()}
    nodes[END] = nodes.get(END, np.zeros((1, 6, 7))) + np.eye(6, 7, 1)
    offsets: dict[str, Array] = {name: offset @ mix for name, offset in loads.offsets.items()}
    response = solve_loads(order, there, Loads(7, nodes, offsets, balanced=HELD))
    work = SecondOrder(response, order.mechanism, gravity)
    unit = whole = Motion.select_cases(response, slice(1, 7))
    for _ in range(_STEPS):
        loads = Loads(6, work.loads(whole, held=False), balanced=HELD)
        before, whole = whole, unit.plus(Motion.select_cases(solve_loads(order, there, loads), slice(0, 6)), 1.0)
        if (whole.plus(before, -1.0).size <= _SETTLED * unit.size).all():
            break
    matrix = whole.nodes[END]
    matrix = np.where(bent.found[:, None, None], 0.5 * (matrix + _t(matrix)), np.nan)
    return matrix, bent.sag


def _relax(state: Condensed, work: SecondOrder, *, thorough: bool) -> tuple[Array, Array]:
    """Change (n, 6, 6) of the stiffness by the second-order work, and the share (n,) by which internal motions change.

    With H the Hessian of that work and X the motions for unit twists of the tool, these change by δ where
    ``H₀ δ = -H (X + δ)``; the stiffness, being stationary, by ``Xᵀ H X + δᵀ H X + δᵀ H δ`` for the first such δ, and by
    ``Xᵀ H (X + δ)`` for the last.
    """
    unit = Motion.select_cases(work.response, slice(1, 7))
    relaxed = Motion.select_cases(solve_held(state, Loads(6, work.loads(unit), balanced=HELD)), slice(0, 6))
    share = relaxed.size / unit.size
    last = 0.75
    for _ in range(_STEPS if thorough else 0):
        last = -0.25
        loads = Loads(6, work.loads(unit.plus(relaxed, 1.0)), balanced=HELD)
        before, relaxed = relaxed, Motion.select_cases(solve_held(state, loads), slice(0, 6))
        if (relaxed.plus(before, -1.0).size < _SETTLED * unit.size).all():
            break
    half = work.half(unit.plus(relaxed, 0.5)) + last * work.half(relaxed)
    return half + np.swapaxes(half, -1, -2), share


def _remaining_loads(order: Order, there: Places, rest: Places, gravity: Array) -> Loads:
    nodes = own_loads(order, there, gravity).nodes
    return Loads(1, nodes, find_remaining_offsets(order, there, rest), balanced=HELD)


def find_size(moved: Response, length: float) -> Array:
    """Largest rotation, or translation over the mechanism's length, of any node (n,)."""
    unit = np.repeat([1.0 / length, 1.0], 3)
    n = len(moved.twist)
    sizes = [np.abs(u[..., 0] * unit).max(axis=1) for u in moved.nodes.values()]
    return np.max([np.broadcast_to(size, n) for size in sizes], axis=0)


def bend_places(where: Places, response: Response) -> Places:
    """Every node moved by its own twist of the first case."""
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

    Twists (n, 6, 6) of nodes at M in base axes; for elements that move in more than one way their twist, the rotations
    (n, 3, 6) of their springs, and their rates (n, k, 6), in their own axes.
    """

    nodes: dict[str, Array]
    twist: dict[str, Array]
    sprung: dict[str, Array]
    rates: dict[str, Array]

    @classmethod
    def select_cases(cls, response: Response, some: slice) -> Motion:
        """The cases ``some`` of a response."""
        out = cls({node: u[..., some] for node, u in response.nodes.items()}, {}, {}, {})
        for name, state in response.elements.items():
            e = state.element
            if e.factor.shape[1] + e.free.shape[1] > 1:
                out.twist[name] = state.twist[..., some]
                if e.group:  # no free motions: all of its twist is strain
                    out.sprung[name] = out.twist[name][:, 3:]
                    out.rates[name] = state.rates[..., some]
                    continue
                factor = state.where.factor(e)
                stress = np.swapaxes(factor, -1, -2) @ state.wrench[..., some]
                own = factor.shape[2] - e.sprung
                out.sprung[name] = factor[:, 3:, :own] @ stress[:, :own]
                out.rates[name] = stack_rows([stress[:, own:], state.rates[..., some]])
        return out

    @property
    def size(self) -> Array:
        """Largest of all nodes' twists (n,)."""
        sizes = [np.abs(u).max(axis=(1, 2)) for u in self.nodes.values()]
        return np.max(np.broadcast_arrays(*sizes), axis=0)

    def plus(self, other: Motion, times: float) -> Motion:
        """Its sum with ``times`` the other."""
        keys = ("nodes", "twist", "sprung", "rates")
        mine, theirs = ([getattr(m, key) for key in keys] for m in (self, other))
        return Motion(*({k: a[k] + times * b[k] for k in a} for a, b in zip(mine, theirs, strict=True)))


@dataclass(eq=False)
class SecondOrder:
    """Second-order work of what the first case of a response carries, and of the weights."""

    response: Response
    mechanism: Mechanism
    gravity: Array

    @cached_property
    def _moving_elements(self) -> list[ElementState]:
        """Elements whose nodes do not move as one."""
        states = self.response.elements.values()
        return [s for s in states if s.element.factor.shape[1] + s.element.free.shape[1]]

    @cached_property
    def _weights(self) -> dict[str, tuple[Array, Array]]:
        """For every node with mass the matrices of ``f·(ω × v)`` (3, 3) and of ``f·(ω × (ω × r))`` (n, 3, 3)."""
        out: dict[str, tuple[Array, Array]] = {}
        for node, m in lump_masses(self.mechanism, self.response.where).items() if self.gravity.any() else ():
            lever = m.moment[:, :, None] * self.gravity
            block = 0.5 * (lever + _t(lever)) - np.einsum("nii->n", lever)[:, None, None] * np.eye(3)
            out[node] = skew(m.mass * self.gravity), block
        return out

    def half(self, motion: Motion) -> Array:
        """Half (n, 6, 6) of the second-order work over six motions, not symmetric."""
        total: Array = np.zeros((1, 6, 6))
        for state in self._moving_elements:
            e = state.element
            first, second = motion.nodes[e.first], motion.nodes[e.second]
            total = total + 0.5 * _t(first) @ (bracket(state.carried[..., 0]) @ second)
            if e.name in motion.twist:
                total = total + self._sum_brackets(state, motion)
        for node, (force, block) in self._weights.items():
            v, spin = np.split(motion.nodes[node], 2, axis=1)
            total = total + 0.5 * _t(spin) @ (force @ v - block @ spin)
        return total

    def loads(self, motion: Motion, *, held: bool = True) -> dict[str, Array]:
        """Wrenches (n, 6, 6) on nodes that do what the second-order work does: minus its gradient at six motions.

        ``held``: none on the tool.
        """
        out: dict[str, Array] = {}
        still = {GROUND, END} if held else {GROUND}

        def add(node: str, wrench: Array) -> None:
            if node not in still:
                out[node] = out[node] + wrench if node in out else wrench

        for state in self._moving_elements:
            e = state.element
            matrix = bracket(state.carried[..., 0])
            add(e.first, -0.5 * matrix @ motion.nodes[e.second])
            add(e.second, -0.5 * _t(matrix) @ motion.nodes[e.first])
            if e.name in motion.twist:
                own = self._ordered_wrench(state, motion)
                wrench = _t(state.where.frame(e).inverse_adjoint()) @ own
                add(e.first, wrench)
                add(e.second, -wrench)
        for node, (force, block) in self._weights.items():
            v, spin = np.split(motion.nodes[node], 2, axis=1)
            moment = block @ spin - 0.5 * force @ v
            push = np.broadcast_to(0.5 * force @ spin, moment.shape)
            add(node, np.concatenate([push, moment], axis=1))
        return out

    def _parts(self, state: ElementState, motion: Motion) -> tuple[list[Array], list[Array]]:
        """Rotations (n, 3, 6) of an element in their order, and their axes (n or 1, 3); own axes."""
        e = state.element
        parts: list[Array] = []
        axes: list[Array] = []
        if e.joint is not None and e.joint.kind == "spherical":  # turns along one geodesic: no order
            return parts, axes
        if e.factor.shape[1] > e.sprung:
            parts += [motion.sprung[e.name] * row[:, None] for row in np.eye(3)]
            axes += list(np.eye(3)[:, None])
        free = stack_columns(
            [state.where.factor(e)[..., e.factor.shape[1] - e.sprung :], free_directions(e, state.where)]
        )
        parts += [free[:, 3:, k, None] * motion.rates[e.name][:, None, k] for k in range(free.shape[2])]
        axes += [free[:, 3:, k] for k in range(free.shape[2])]
        return parts, axes

    def _sum_brackets(self, state: ElementState, motion: Motion) -> Array:
        """``-½ Σ_{a<b} w·[s_a, s_b] y_a y_b`` in the element's own axes: its slides, its spring, its rotations."""
        twist = motion.twist[state.element.name]
        force, moment = state.wrench[:, :3, 0], state.wrench[:, 3:, 0]
        out = 0.5 * _t(twist[:, :3]) @ (skew(force) @ twist[:, 3:])
        if not moment.any():
            return out
        turned, before = skew(moment), np.zeros((1, 3, 6))
        for part in self._parts(state, motion)[0]:
            out = out + 0.5 * _t(before) @ (turned @ part)
            before = before + part
        return out

    def _ordered_wrench(self, state: ElementState, motion: Motion) -> Array:
        """Wrench (n, 6, 6) whose work along the element's own motions is the gradient of ``_ordered``."""
        twist = motion.twist[state.element.name]
        force, moment = skew(state.wrench[:, :3, 0]), skew(state.wrench[:, 3:, 0])
        push = 0.5 * force @ twist[:, 3:]
        turn = -0.5 * force @ twist[:, :3]  # of the force along any rotation
        parts, axes = self._parts(state, motion)
        if not moment.any() or not axes:
            return np.concatenate([push, turn], axis=1)
        whole = sum(parts, np.zeros((1, 3, 6)))
        before: Array = np.zeros((1, 3, 6))
        rows: list[Array] = []
        for part, axis in zip(parts, axes, strict=True):
            after = whole - before - part
            rows.append(axis[:, None] @ (0.5 * moment @ (after - before)))
            before = before + part
        n = max(len(r) for r in rows)
        work = np.concatenate([np.broadcast_to(r, (n, 1, 6)) for r in rows], axis=1)
        along = np.stack(np.broadcast_arrays(*axes), axis=1)  # (n, k, 3)
        return np.concatenate([push, turn + np.linalg.pinv(along) @ work], axis=1)


def bracket(wrench: Array) -> Array:
    """Matrix (n, 6, 6) B with ``uᵀ B v = -w·[u, v]`` for twists u, v and a wrench w (n, 6)."""
    out = np.zeros((len(wrench), 6, 6))
    out[:, :3, 3:] = out[:, 3:, :3] = skew(wrench[:, :3])
    out[:, 3:, 3:] = skew(wrench[:, 3:])
    return out


def _t(a: Array) -> Array:
    return np.swapaxes(a, -1, -2)
