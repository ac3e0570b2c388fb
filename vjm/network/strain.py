"""Finite strains of elements whose nodes have moved."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from stiffscope.vjm.kinematics.linkage import find_free_coordinates
from stiffscope.vjm.network.network import euler_angles, euler_axes

if TYPE_CHECKING:
    from stiffscope.vjm.model.joints import Joint
    from stiffscope.vjm.model.screws import Array
    from stiffscope.vjm.network.network import Element, Places
    from stiffscope.vjm.network.order import Order


def find_offsets(order: Order, where: Places) -> dict[str, Array]:
    """Return the offsets (n or 1, 6, 1) of unloaded elements, joint springs and misplaced axes."""
    out: dict[str, Array] = {}
    for e in order.elements:
        lack = np.zeros((1, 6)) if e.offset is None else e.offset[None]
        if e.drawn is not None:
            lack = lack - _strain(e, where, where)
        elif e.joint is not None and e.joint.spring is not None:
            lack = lack - _strain_spring(e, e.joint, where)
        if lack.any():
            out[e.name] = lack[..., None]
    return out


def find_remaining_offsets(
    order: Order, where: Places, rest: Places
) -> dict[str, Array]:
    """Return offsets (n, 6, 1) for a linear step from deformed places to obey every element's law.

    In each element's own axes at its own point. A spring strained by θ of its offset t₀ still has
    t₀ - θ to go.

    Parameters
    ----------
    order
        Elimination order of the network.
    where
        Places of all nodes at n configurations.
    rest
        Places of the unloaded mechanism.
    """
    out: dict[str, Array] = {}
    for e in order.elements:
        strain = _strain(e, where, rest)
        lack = -strain if e.offset is None else e.offset - strain
        if e.joint is None and lack.any():
            lack[:, 3:] = np.einsum(
                "nij,nj->ni", euler_axes(where.turn(e, e.axes)), lack[:, 3:]
            )
        if lack.any():
            out[e.name] = lack[..., None]
    return out


def _strain(e: Element, where: Places, rest: Places) -> Array:
    """Return an element's coordinates Tx Ty Tz Rx Ry Rz (n, 6); a joint's held or driven ones."""
    gap, turn = _relative(e, where)
    n = max(len(gap), len(turn))
    out = np.zeros((n, 6))
    joint = e.joint
    if joint is None:
        out[:, 3:] = euler_angles(turn)
        out[:, :3] = gap
        return out
    held, turns = joint.held_components
    out[:, held] = gap[:, held]
    if joint.cross:
        first, second = joint.cross
        out[:, 3:] = _miss_angle(joint.axes.T @ first, joint.axes.T @ second, turn)
    elif len(turns) == 2:  # direction of the axis on the second body
        out[:, 4] = -turn[:, 2, 0]
        out[:, 5] = turn[:, 1, 0]
    elif turns:
        out[:, 3:] = -euler_angles(turn.mT) if e.is_mirrored else euler_angles(turn)
    if joint.resistance and joint.type.driven is not None:
        before, turned = _relative(e, rest, e.drawn)
        if joint.turns:
            out[:, 3] = euler_angles(turn @ turned.mT)[:, 0]
        else:
            out[:, 0] = gap[:, 0] - before[:, 0]
    if joint.spring is not None:
        out = out + _strain_spring(
            e, joint, where if joint.type.driven is None else rest
        )
    return out


def _strain_spring(e: Element, joint: Joint, where: Places) -> Array:
    """Displacement (n, 6) of a passive joint's free motions from its spring's rest, own axes."""
    back = where.rotation[e.carrier].mT
    gap = (
        back @ (where.point(e.second, e.at) - where.point(e.first, e.at))[..., None]
    )[..., 0]
    away = find_free_coordinates(joint, where.turn(e, np.eye(3)), gap) - joint.rest
    out = np.zeros((len(away), 6))
    if joint.type.is_ball:
        out[:, 3:] = away @ e.axes
    elif joint.cross:
        columns = where.factor(e)[:, 3:, -e.sprung :] * np.sqrt(joint.resistance)
        out[:, 3:] = (columns @ away[..., None])[..., 0]
    else:
        out[:, joint.type.driven] = away[:, 0]
    return out


def _relative(
    e: Element, where: Places, drawn: Joint | None = None
) -> tuple[Array, Array]:
    """Return displacement (n, 3) and rotation (n, 3, 3) of an element's second node from its first.

    In the element's axes, or in those of ``drawn``, the nominal joint, if given. The displacement
    is that of the second node where the bearing is.
    """
    own, at = (e.axes, e.at) if drawn is None else (drawn.axes, drawn.at)
    moved = where.point(e.second, at) - where.point(e.first, at)
    gap: Array = np.einsum("nji,nj->ni", where.axes(e.carrier, own), moved)
    turn = where.turn(e, own)
    if e.bearer == e.first and not e.is_mirrored:
        # the joint's axis has tilted by ω about the point on the second body: d - ω × d
        tilt = np.stack([np.zeros(len(turn)), -turn[:, 2, 0], turn[:, 1, 0]], axis=-1)
        gap -= np.cross(tilt, gap)
    return gap, turn


def _miss_angle(first: Array, rest: Array, turn: Array) -> Array:
    """Return the rotation (n, 3) by which two turned axes (3,) violate their angle."""
    second = turn @ rest
    square = np.cross(second, first)
    off = second @ first - rest @ first
    return square * (off / (square * square).sum(axis=1))[:, None]
