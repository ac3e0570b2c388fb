"""One algebra for series, parallel, passive joints and loads: a tree of elements reduced to one connection.

A connection with a free end obeys ``t = t₀ + C w + N q``, ``Nᵀ w + n₀ = 0`` (compliance form); a parallel group adds
its members in stiffness form ``w = K t + p``. A singular K is never inverted: what stands in series with it uses
``(I + K C)⁻¹ K``, and free directions are eliminated from K.

Loads ``t₀``, ``n₀``, ``p`` and the total load ``T`` (the wrench on the base is ``w + T``) have a column for a unit of
gravity along each axis of the node, so that they stay constant in a moving frame, and a fourth for lack of fit;
without loads they have no columns.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce
from typing import TYPE_CHECKING, overload

import numpy as np

from stiffscope import InputError
from vjm.elastic import Parallel, Passive, Series, Spring

if TYPE_CHECKING:
    from vjm.elastic import Node, Weight
    from vjm.screws import Array, Frame

_IDLE = 1e-9  # relative size below which a free direction adds nothing to those before it
_RIGID = 1e-14  # relative pivot below which a constrained direction has no compliance at all


@dataclass(frozen=True)
class Flexible:
    """Compliance form: ``compliance`` C (..., 6, 6), ``free`` N (..., 6, k), ``offset`` t₀ (..., 6, c),
    ``constraint`` n₀ (..., k, c), ``load`` T (..., 6, c).
    """

    compliance: Array
    free: Array
    offset: Array
    constraint: Array
    load: Array


@dataclass(frozen=True)
class Stiff:
    """Stiffness form: ``stiffness`` K (..., 6, 6), may be singular; ``preload`` p and ``load`` T (..., 6, c)."""

    stiffness: Array
    preload: Array
    load: Array


@dataclass(frozen=True)
class Joined:
    """Members of a series brought to its tip: its springs and joints as one, and each stiff member (tip first)."""

    flexible: Flexible
    stiff: tuple[Stiff, ...]


def reduced(node: Node, *, loads: bool = False) -> Flexible | Stiff:
    """A tree as one connection, at its parent's origin in its parent's axes. Eqs. (1) to (5), corrected."""
    return placed(own_form(node, loads=loads), node.frame)


def own_form(node: Node, *, loads: bool) -> Flexible | Stiff:
    """A tree as one connection, at its own origin in its own axes."""
    match node:
        case Series():
            return closed(joined(node, loads=loads))
        case Parallel():
            members = [placed(stiffened(own_form(m, loads=loads), m.name), m.frame) for m in node.members]
            return reduce(
                lambda a, b: Stiff(a.stiffness + b.stiffness, a.preload + b.preload, a.load + b.load), members
            )
        case _:
            return _leaf(node, 4 if loads else 0)


def _leaf(node: Spring | Passive | Weight, cases: int) -> Flexible:
    rigid, locked = np.zeros((6, 6)), np.zeros((6, 0))
    none, no_constraint = np.zeros((6, cases)), np.zeros((0, cases))
    if isinstance(node, Passive):
        k = node.directions.shape[-1]
        return Flexible(rigid, node.directions, none, np.zeros((k, cases)), none)
    if isinstance(node, Spring):
        offset = none
        if cases and node.offset is not None:
            offset = np.concatenate([np.zeros((*node.offset.shape, 3)), node.offset[..., None]], axis=-1)
        return Flexible(node.compliance, locked, offset, no_constraint, none)
    return Flexible(rigid, locked, none, no_constraint, node.mass * np.eye(6, cases) * (np.arange(cases) < 3))


@overload
def placed(form: Stiff, frame: Frame) -> Stiff: ...
@overload
def placed(form: Flexible | Stiff, frame: Frame) -> Flexible | Stiff: ...
def placed(form: Flexible | Stiff, frame: Frame) -> Flexible | Stiff:
    """A form of a child, at its parent's origin in its parent's axes."""
    if frame.identity:
        return form
    back = frame.inverse_adjoint()
    back_t = np.swapaxes(back, -1, -2)
    if not form.load.shape[-1]:
        turn = np.zeros((0, 0))
    else:  # gravity of the parent's axes seen from the child's
        turn = np.zeros((*frame.matrix().shape[:-2], 4, 4))
        turn[..., :3, :3] = np.swapaxes(frame.matrix(), -1, -2)
        turn[..., 3, 3] = 1.0
    load = back_t @ form.load @ turn
    if isinstance(form, Stiff):
        return Stiff(back_t @ form.stiffness @ back, back_t @ form.preload @ turn, load)
    there = frame.adjoint()
    compliance = there @ form.compliance @ np.swapaxes(there, -1, -2)
    return Flexible(compliance, there @ form.free, there @ form.offset @ turn, form.constraint @ turn, load)


def joined(series: Series, *, loads: bool) -> Joined:
    """Members of a series brought to its tip: each carries its own loads and those of all members after it."""
    cases = 4 if loads else 0
    compliance, offset, load = np.zeros((6, 6)), np.zeros((6, cases)), np.zeros((6, cases))
    free: list[Array] = []
    constraint: list[Array] = []
    stiff: list[Stiff] = []
    for member in reversed(series.members):
        if isinstance(member, Spring) and member.rigid:
            continue
        form = reduced(member, loads=loads)
        if isinstance(form, Stiff):
            stiff.append(Stiff(form.stiffness, form.preload - load, form.load))
        else:
            compliance = compliance + form.compliance
            offset = offset + form.offset + form.compliance @ load
            free.append(form.free)
            constraint.append(form.constraint + np.swapaxes(form.free, -1, -2) @ load)
        load = load + form.load
    flexible = Flexible(compliance, _stacked(free, -1, (6, 0)), offset, _stacked(constraint, -2, (0, cases)), load)
    return Joined(flexible, tuple(stiff))


def closed(parts: Joined) -> Flexible | Stiff:
    """The joined members of a series as one connection."""
    if not parts.stiff:
        return parts.flexible
    flexible = parts.flexible
    stiffness, preload = behind_springs(in_series(parts.stiff), flexible)
    if flexible.free.shape[-1]:
        pull, release, slack = free_motion(stiffness, preload, flexible)
        preload = preload - pull @ (release @ slack)
        stiffness = stiffness - pull @ release @ np.swapaxes(pull, -1, -2)
    return Stiff(_symmetric(stiffness), preload, flexible.load)


def behind_springs(member: Stiff, flexible: Flexible) -> tuple[Array, Array]:
    """K and p of a stiff member in series with springs: ``(I + K C)⁻¹ K``, never an inverse of K."""
    right = np.concatenate([member.stiffness, member.preload - member.stiffness @ flexible.offset], axis=-1)
    solved = np.linalg.solve(np.eye(6) + member.stiffness @ flexible.compliance, right)
    return solved[..., :6], solved[..., 6:]


def free_motion(stiffness: Array, preload: Array, flexible: Flexible) -> tuple[Array, Array, Array]:
    """Free directions in series with (K, p) move by ``q = X⁺ (Nᵀ K t + s)``; returns ``K N``, ``X⁺`` and s."""
    pull = stiffness @ flexible.free
    release = released(np.swapaxes(flexible.free, -1, -2) @ pull)
    return pull, release, np.swapaxes(flexible.free, -1, -2) @ preload + flexible.constraint


def in_series(members: tuple[Stiff, ...]) -> Stiff:
    """Stiff members one after the other, their loads already carried: ``K₁ (K₁ + K₂)⁻¹ K₂``."""

    def pair(a: Stiff, b: Stiff) -> Stiff:
        share = a.stiffness @ released(a.stiffness + b.stiffness)
        return Stiff(_symmetric(share @ b.stiffness), a.preload + share @ (b.preload - a.preload), a.load + b.load)

    return reduce(pair, members)


def stiffened(form: Flexible | Stiff, name: str) -> Stiff:
    """Stiffness form: the wrenches that the free directions leave, ``w = Z α``, ``K = Z (Zᵀ C Z)⁻¹ Zᵀ``.

    Raises InputError where a direction that is not free has no compliance, so that K would be infinite.
    """
    if isinstance(form, Stiff):
        return form
    carries = carried(form.free)
    core = np.swapaxes(carries, -1, -2) @ form.compliance @ carries
    unused = 1.0 - np.einsum("...ij,...ij->...j", carries, carries)
    inverse = _inverse(core + unused[..., None] * np.eye(6), name)
    stiffness = _symmetric(carries @ inverse @ np.swapaxes(carries, -1, -2))
    held = -form.free @ (released(np.swapaxes(form.free, -1, -2) @ form.free) @ form.constraint)
    return Stiff(stiffness, held - stiffness @ (form.offset + form.compliance @ held), form.load)


def carried(free: Array) -> Array:
    """Orthonormal wrenches that free directions (..., 6, k) leave, as columns (..., 6, 6); the others are zero."""
    k = free.shape[-1]
    if k == 0:
        return np.eye(6)
    q, r = np.linalg.qr(free, mode="complete")
    pivots = np.abs(np.diagonal(r, axis1=-2, axis2=-1))
    idle = pivots <= _IDLE * np.linalg.norm(free, axis=-2)[..., : pivots.shape[-1]]
    keep = np.ones((*free.shape[:-2], 6))
    keep[..., : pivots.shape[-1]] = idle
    return q * keep[..., None, :]


def released(matrix: Array) -> Array:
    """Inverse of a positive semidefinite (..., k, k); directions without stiffness carry nothing and are dropped."""
    scale = np.sqrt(np.einsum("...ii->...i", matrix).clip(min=0.0))
    unit = np.divide(1.0, scale, out=np.zeros_like(scale), where=scale > 0.0)
    scaling = unit[..., :, None] * unit[..., None, :]
    values, vectors = np.linalg.eigh(matrix * scaling)
    inverse = np.divide(1.0, values, out=np.zeros_like(values), where=values > _IDLE)
    return (vectors * inverse[..., None, :]) @ np.swapaxes(vectors, -1, -2) * scaling


def _inverse(core: Array, name: str) -> Array:
    """Inverse of a compliance that must be positive definite."""
    scale = np.sqrt(np.einsum("...ii->...i", core).clip(min=np.finfo(float).tiny))
    unit = core / (scale[..., :, None] * scale[..., None, :])
    try:
        pivots = np.einsum("...ii->...i", np.linalg.cholesky(unit)) ** 2
    except np.linalg.LinAlgError:
        pivots = np.zeros(1)
    if not pivots.min() > _RIGID:
        msg = (
            f"{name}: rigid in a direction in which it stands parallel to others; "
            "give it a positive definite compliance or a passive joint there"
        )
        raise InputError(msg)
    return np.linalg.inv(core)


def _symmetric(matrix: Array) -> Array:
    return 0.5 * (matrix + np.swapaxes(matrix, -1, -2))


def _stacked(blocks: list[Array], axis: int, empty: tuple[int, int]) -> Array:
    """Concatenate the last two axes of blocks whose stacks may differ."""
    filled = [b for b in blocks if b.shape[axis]]
    if not filled:
        return np.zeros(empty)
    stack = np.broadcast_shapes(*(b.shape[:-2] for b in filled))
    return np.concatenate([np.broadcast_to(b, (*stack, *b.shape[-2:])) for b in filled], axis=axis)
