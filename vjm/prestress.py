"""Tangent stiffness of a mechanism that carries loads: the Hessian of its potential energy at the loaded equilibrium.

The network is bent by its loads (every node by its own twist), condensed again, and the second-order work of what it
carries is added. A closed kinematic pair of nodes i, j with coordinates y along ordered screws s obeys
``log(exp(-u_i) exp(u_j)) = log Π exp(s_a y_a)``; to second order both sides are Lie brackets (Baker, Campbell, Hausdorff),
so that a carried wrench w contributes ``-½ w·[u_i, u_j] - ½ Σ_{a<b} w·[s_a, s_b] y_a y_b``, and a weight f at a lever r
contributes ``-½ f·(ω × (v + ω × r))``. All internal motions are stationary, so that theirs need no correction.

Of a joint, slides come first, then its bearing and drive, then its rotations; of an elastic body Tx Ty Tz Rx Ry Rz.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from stiffscope.vjm.condensation import Loads, condensed, tool_stiffness
from stiffscope.vjm.loading import loaded, recovered, yielded
from stiffscope.vjm.mechanism import GROUND
from stiffscope.vjm.network import END, Places, free_directions, masses
from stiffscope.vjm.saddle import loaded_unit
from stiffscope.vjm.screws import rotation_of, skew
from stiffscope.vjm.strain import remaining_offsets

if TYPE_CHECKING:
    from stiffscope.vjm.condensation import Order
    from stiffscope.vjm.loading import ElementState, Response
    from stiffscope.vjm.mechanism import Mechanism
    from stiffscope.vjm.screws import Array

_SMALL = 3e-5  # rad, or of the mechanism's length: a step beyond which the equilibrium is sought on
_BENDS = 8


def internal_loads(order: Order, where: Places, gravity: Array) -> Loads:
    """The mechanism's own weight under ``gravity`` (3,), and its offsets: one case."""
    nodes = {node: m.weight(gravity) for node, m in masses(order.mechanism, where).items()} if gravity.any() else {}
    return Loads(1, nodes, {e.name: e.offset[None, :, None] for e in order.elements if e.offset is not None})


def loaded_stiffness(order: Order, where: Places, gravity: Array) -> tuple[Array, Array]:
    """Stiffness (n, 6, 6) at M in base axes under the mechanism's own weight and offsets, and its sag (n, 6).

    The sag is that of small displacements; the stiffness is taken at the equilibrium of finite ones, and is NaN where
    none is found. Raises InputError where the tool moves freely.
    """
    moved = loaded(order, where, np.zeros((1, 6, 1)), internal_loads(order, where, gravity))
    sag, there = moved.twist[..., 0], bent(where, moved)
    size = _size(moved, order.length)
    for _ in range(_BENDS):
        if not (size > _SMALL).any():
            break
        moved = loaded(order, there, np.zeros((1, 6, 1)), _remaining(order, there, where, gravity))
        there, size = bent(there, moved), _size(moved, order.length)
    state = condensed(order, there, _remaining(order, there, where, gravity))
    if order.left:
        stiffness, ends, left = loaded_unit(state)
    else:
        stiffness, left = tool_stiffness(state), []
        n = len(stiffness)
        end = np.concatenate([yielded(stiffness, state.force(END)), np.broadcast_to(np.eye(6), (n, 6, 6))], axis=2)
        ends = {GROUND: np.zeros((1, 6, 7)), END: end}
    response = recovered(state, ends, left, mix=np.eye(1, 7))
    half = second_order(response, order.mechanism, gravity)
    whole = stiffness + half + np.swapaxes(half, -1, -2)
    return np.where((size > _SMALL)[:, None, None], np.nan, whole), np.broadcast_to(sag, (len(whole), 6))


def _remaining(order: Order, there: Places, rest: Places, gravity: Array) -> Loads:
    return Loads(1, internal_loads(order, there, gravity).nodes, remaining_offsets(order, there, rest))


def _size(moved: Response, length: float) -> Array:
    """Largest rotation, or translation over the mechanism's length, of any node (n,)."""
    unit = np.repeat([1.0 / length, 1.0], 3)
    n = len(moved.twist)
    sizes = [np.abs(u[..., 0] * unit).max(axis=1) for u in moved.nodes.values()]
    return np.max([np.broadcast_to(size, n) for size in sizes], axis=0)


def bent(where: Places, response: Response) -> Places:
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


def second_order(response: Response, mechanism: Mechanism, gravity: Array) -> Array:
    """Half (n, 6, 6) of the second-order work over unit twists of the tool, not symmetric.

    The first case of the response is what is carried, the other six are unit twists of the tool.
    """
    total: Array = np.zeros((1, 6, 6))
    for state in response.elements.values():
        e = state.element
        motions = e.factor.shape[1] + e.free.shape[1]
        if not motions:  # both nodes move as one
            continue
        first, second = response.nodes[e.first], response.nodes[e.second]
        wrench = state.carried[..., 0]
        total = total + 0.5 * _t(first[..., 1:]) @ (bracket(wrench) @ second[..., 1:])
        if motions > 1:
            total = total + _ordered(state)
    for node, m in masses(mechanism, response.where).items() if gravity.any() else ():
        u = response.nodes[node][..., 1:]
        v, spin = u[:, :3], u[:, 3:]
        lever = m.moment[:, :, None] * gravity
        block = 0.5 * (lever + _t(lever)) - np.einsum("nii->n", lever)[:, None, None] * np.eye(3)
        total = total + 0.5 * _t(spin) @ (skew(m.mass * gravity) @ v - block @ spin)
    return total


def bracket(wrench: Array) -> Array:
    """Matrix (n, 6, 6) B with ``uᵀ B v = -w·[u, v]`` for twists u, v and a wrench w (n, 6)."""
    out = np.zeros((len(wrench), 6, 6))
    out[:, :3, 3:] = out[:, 3:, :3] = skew(wrench[:, :3])
    out[:, 3:, 3:] = skew(wrench[:, 3:])
    return out


def _ordered(state: ElementState) -> Array:
    """``-½ Σ_{a<b} w·[s_a, s_b] y_a y_b`` in the element's own axes: its slides, its spring, its rotations."""
    e = state.element
    wrench, twist = state.wrench, state.twist[..., 1:]
    force, moment = wrench[:, :3, 0], wrench[:, 3:, 0]
    out = 0.5 * _t(twist[:, :3]) @ (skew(force) @ twist[:, 3:])
    if not moment.any():
        return out
    factor = state.where.factor(e)
    sprung = factor @ (_t(factor) @ wrench[..., 1:])
    parts = [sprung[:, 3:] * np.eye(3)[k][:, None] for k in range(3)] if factor.shape[2] else []
    free = free_directions(e, state.where)
    if e.joint is not None and e.joint.kind == "spherical":
        parts.append(state.rates[..., 1:])
    else:
        parts += [free[:, 3:, k, None] * state.rates[:, None, k, 1:] for k in range(free.shape[2])]
    turned = skew(moment)
    before = np.zeros_like(parts[0]) if parts else np.zeros((1, 3, 6))
    for part in parts:
        out = out + 0.5 * _t(before) @ (turned @ part)
        before = before + part
    return out


def _t(a: Array) -> Array:
    return np.swapaxes(a, -1, -2)
