"""One algebra for series, parallel, passive joints and loads: a tree of elements reduced to one connection.

A connection with a free end obeys ``t = t₀ + C w + N q``, ``Nᵀ w + n₀ = 0`` (compliance form); a parallel group adds
its members in stiffness form ``w = K t + p``. A singular K is never inverted: what stands in series with it uses
``(I + K C)⁻¹ K``, and free directions are eliminated from K.

Loads ``t₀``, ``n₀``, ``p`` and the total load ``T`` (the wrench on the base is ``w + T``) have a column for a unit of
gravity along each axis of the node, so that they stay constant in a moving frame, and a fourth for lack of fit;
without loads they have no columns.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, reduce
from typing import TYPE_CHECKING, TypeAlias, overload

import numpy as np

from stiffscope.errors import InputError
from stiffscope.vjm.elastic import Parallel, Passive, Series, Spring, Weight
from stiffscope.vjm.screws import Frame, skew

if TYPE_CHECKING:
    from stiffscope.vjm.elastic import Node
    from stiffscope.vjm.screws import Array

_IDLE = 1e-9  # relative size below which a free direction adds nothing to those before it
_I, _J = np.triu_indices(3)
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

    @cached_property
    def regained(self) -> Array:
        """Motion ``q`` (..., k, 6) of the free directions that comes nearest to a twist of the end."""
        free_t = np.swapaxes(self.free, -1, -2)
        return released(free_t @ self.free) @ free_t


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


@dataclass(frozen=True)
class Leaf:
    """A spring, joint or weight; ``form`` at its group's origin in its group's axes."""

    node: Spring | Passive | Weight
    form: Flexible


@dataclass(frozen=True)
class Chain:
    """A series with its members reduced and joined; ``form`` at its group's origin in its group's axes."""

    node: Series
    form: Flexible | Stiff
    members: tuple[Assembly, ...]
    joined: Joined


@dataclass(frozen=True)
class Bundle:
    """A parallel group with its members, and each one's stiffness form at the group's own origin."""

    node: Parallel
    form: Stiff
    members: tuple[Assembly, ...]
    shares: tuple[Stiff, ...]


Assembly: TypeAlias = Leaf | Chain | Bundle


def reduced(node: Node, *, loads: bool = False) -> Flexible | Stiff:
    """A tree as one connection, at its parent's origin in its parent's axes. Eqs. (1) to (5), corrected."""
    return assembled(node, loads=loads).form


def as_stiffness(node: Node) -> Array:
    """Stiffness (..., 6, 6) of a robot at its tool. Raises InputError where it would be infinite."""
    return _stiffened(reduced(node), node.name).stiffness


def assembled(node: Node, *, loads: bool = False) -> Assembly:
    """A tree reduced from its leaves, every step kept."""
    if isinstance(node, Series):
        members = tuple(assembled(m, loads=loads) for m in node.members)
        joined = _joined(members, 4 if loads else 0)
        return Chain(node, _placed(_closed(joined), node.frame), members, joined)
    if isinstance(node, Parallel):
        # stiffened in its own axes, where least depends on the pose, and only then placed
        here = tuple(assembled(replace(m, frame=Frame()), loads=loads) for m in node.members)
        shares = _placed_together([_stiffened(m.form, m.node.name) for m in here], [m.frame for m in node.members])
        members = tuple(_at(m, n.frame) for m, n in zip(here, node.members, strict=True))
        return Bundle(node, _placed(reduce(_beside, shares), node.frame), members, shares)
    return Leaf(node, _leaf(node, 4 if loads else 0))


def _placed_together(forms: list[Stiff], frames: list[Frame]) -> tuple[Stiff, ...]:
    """Members of a parallel group at its origin; those alike but for their place are rotated once."""
    rotated: list[tuple[Stiff, Array | None, Stiff]] = []
    shares: list[Stiff] = []
    for form, frame in zip(forms, frames, strict=True):
        known = [r for f, axes, r in rotated if axes is frame.rotation and _alike(f, form)]
        turned = known[0] if known else _placed(form, Frame(frame.rotation))
        rotated.append((form, frame.rotation, turned))
        shares.append(_placed(turned, Frame(translation=frame.translation)))
    return tuple(shares)


def _alike(a: Stiff, b: Stiff) -> bool:
    """Whether two forms that do not depend on the pose are the same."""
    pairs = ((a.stiffness, b.stiffness), (a.preload, b.preload), (a.load, b.load))
    return all(x.ndim == y.ndim == 2 and np.array_equal(x, y) for x, y in pairs)


def _at(member: Assembly, frame: Frame) -> Assembly:
    return replace(member, node=replace(member.node, frame=frame))


def _beside(a: Stiff, b: Stiff) -> Stiff:
    return Stiff(a.stiffness + b.stiffness, a.preload + b.preload, a.load + b.load)


def _leaf(node: Spring | Passive | Weight, cases: int) -> Flexible:
    """Compliance form of a leaf, at its group's origin; a leaf has only one of compliance, free directions and load."""
    rigid, none = np.zeros((6, 6)), np.zeros((6, cases))
    frame, locked, no_constraint = node.frame, np.zeros((6, 0)), np.zeros((0, cases))
    if isinstance(node, Passive):
        free = node.directions if frame.identity else frame.adjoint() @ node.directions
        return Flexible(rigid, free, none, np.zeros((free.shape[-1], cases)), none)
    if isinstance(node, Spring):
        if node.rigid:
            return Flexible(rigid, locked, none, no_constraint, none)
        there = frame.adjoint()
        compliance = node.compliance
        if not frame.identity:
            compliance = _congruence(np.swapaxes(there, -1, -2), compliance, frame)
        offset = none
        if cases and node.offset is not None:
            misfit = there @ node.offset[..., None]
            offset = np.concatenate([np.zeros((*misfit.shape[:-1], 3)), misfit], axis=-1)
        return Flexible(compliance, locked, offset, no_constraint, none)
    if not cases:
        return Flexible(rigid, locked, none, no_constraint, none)
    force = node.mass * np.eye(3, 4)
    load = np.concatenate([np.broadcast_to(force, (*frame.origin().shape, 4)), skew(frame.origin()) @ force], axis=-2)
    return Flexible(rigid, locked, none, no_constraint, load)


@overload
def _placed(form: Stiff, frame: Frame) -> Stiff: ...
@overload
def _placed(form: Flexible | Stiff, frame: Frame) -> Flexible | Stiff: ...
def _placed(form: Flexible | Stiff, frame: Frame) -> Flexible | Stiff:
    """A form of a child, at its parent's origin in its parent's axes."""
    if frame.identity:
        return form
    back = frame.inverse_adjoint()
    back_t = np.swapaxes(back, -1, -2)
    turn = _load_axes(frame, form.load.shape[-1])
    load = back_t @ form.load @ turn
    if isinstance(form, Stiff):
        return Stiff(_congruence(back, form.stiffness, frame), back_t @ form.preload @ turn, load)
    there = frame.adjoint()
    compliance = _congruence(np.swapaxes(there, -1, -2), form.compliance, frame)
    return Flexible(compliance, there @ form.free, there @ form.offset @ turn, form.constraint @ turn, load)


def _load_axes(frame: Frame, cases: int) -> Array:
    """Gravity along the parent's axes seen from the child's, and lack of fit unchanged; (..., 4, 4) or nothing."""
    if not cases:
        return np.zeros((0, 0))
    turn = np.zeros((*frame.matrix().shape[:-2], 4, 4))
    turn[..., :3, :3] = np.swapaxes(frame.matrix(), -1, -2)
    turn[..., 3, 3] = 1.0
    return turn


def _congruence(a: Array, k: Array, frame: Frame) -> Array:
    """``Aᵀ K A`` for the A of a frame, the cheapest way: where one factor holds for all poses it is a plain product."""
    if a.ndim == 2 and k.ndim == 3:
        return (k.reshape(-1, 36) @ np.kron(a, a)).reshape(-1, 6, 6)
    if k.ndim == 2 and frame.rotation is None and frame.translation is not None:
        terms = _shift_terms(k, transposed=bool(a[..., 3:, :3].any()))
        p = frame.translation
        features = np.concatenate([np.ones((*p.shape[:-1], 1)), p, p[..., _I] * p[..., _J]], axis=-1)
        return (features @ terms).reshape(*p.shape[:-1], 6, 6)
    return np.swapaxes(a, -1, -2) @ k @ a


def _shift_terms(k: Array, *, transposed: bool) -> Array:
    """Coefficients (10, 36) of ``Aᵀ K A`` over 1, p and the products p_i p_j, for A = I ∓ S(p) in its corner."""
    slopes = np.zeros((3, 6, 6))
    slopes[:, :3, 3:] = -skew(np.eye(3))
    if transposed:
        slopes = -np.swapaxes(slopes, -1, -2)
    first = k @ slopes
    first = first + np.swapaxes(first, -1, -2)
    second = np.swapaxes(slopes, -1, -2)[:, None] @ k @ slopes[None]
    second = np.where((_I == _J)[:, None, None], second[_I, _J], second[_I, _J] + second[_J, _I])
    return np.concatenate([k[None], first, second]).reshape(10, 36)


def _joined(members: tuple[Assembly, ...], cases: int) -> Joined:
    """Members of a series brought to its tip: each carries its own loads and those of all members after it."""
    compliance, offset, load = np.zeros((6, 6)), np.zeros((6, cases)), np.zeros((6, cases))
    free: list[Array] = []
    constraint: list[Array] = []
    stiff: list[Stiff] = []
    for member in reversed(members):
        form = member.form
        if isinstance(form, Stiff):
            stiff.append(Stiff(form.stiffness, form.preload - load, form.load))
        elif not (isinstance(member.node, Spring) and member.node.rigid):
            if not isinstance(member.node, Passive | Weight):
                compliance = compliance + form.compliance
                offset = offset + form.offset + form.compliance @ load
            if form.free.shape[-1]:
                free.append(form.free)
                constraint.append(form.constraint + np.swapaxes(form.free, -1, -2) @ load)
        load = load + form.load
    flexible = Flexible(compliance, _stacked(free, -1, (6, 0)), offset, _stacked(constraint, -2, (0, cases)), load)
    return Joined(flexible, tuple(stiff))


def _closed(parts: Joined) -> Flexible | Stiff:
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
    k, p = member.stiffness, member.preload
    if p.shape[-1]:
        p = p - k @ flexible.offset
    if flexible.compliance.ndim == 2:
        return _behind_few(k, p, _factored(flexible.compliance))
    share = np.linalg.inv(np.eye(6) + k @ flexible.compliance)
    return share @ k, share @ p


def _factored(compliance: Array) -> Array:
    """F (6, r) of a compliance F Fᵀ that holds for all poses; r is its rank, 1 for a drive."""
    values, vectors = np.linalg.eigh(compliance)
    keep = values > 1e-15 * values[-1]
    return vectors[:, keep] * np.sqrt(values[keep])


def _behind_few(k: Array, p: Array, factor: Array) -> tuple[Array, Array]:
    """``(I + K F Fᵀ)⁻¹ [K, p]`` by the small matrix ``I + Fᵀ K F``."""
    pull = k @ factor
    small = np.linalg.inv(np.eye(factor.shape[1]) + factor.T @ pull)
    share = pull @ small
    return k - share @ np.swapaxes(pull, -1, -2), p - share @ (factor.T @ p)


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


def _stiffened(form: Flexible | Stiff, name: str) -> Stiff:
    """Stiffness form: the wrenches that the free directions leave, ``w = Z α``, ``K = Z (Zᵀ C Z)⁻¹ Zᵀ``.

    Raises InputError where a direction that is not free has no compliance, so that K would be infinite.
    """
    if isinstance(form, Stiff):
        return form
    carries = _carried(form.free)
    core = np.swapaxes(carries, -1, -2) @ form.compliance @ carries
    idle = np.asarray(~carries.any(axis=-2))  # exactly: what rounding leaves would stiffen or soften what does carry
    inverse = _inverse(core + idle[..., None] * np.eye(6), name)
    stiffness = _symmetric(carries @ inverse @ np.swapaxes(carries, -1, -2))
    held = -np.swapaxes(form.regained, -1, -2) @ form.constraint
    return Stiff(stiffness, held - stiffness @ (form.offset + form.compliance @ held), form.load)


def _carried(free: Array) -> Array:
    """Orthonormal wrenches that free directions (..., 6, k) leave, as columns (..., 6, 6); the others are zero."""
    k = free.shape[-1]
    if k == 0:
        return np.eye(6)
    size = np.linalg.norm(free, axis=-2, keepdims=True)
    u, reach, _ = np.linalg.svd(free / np.where(size > 0.0, size, 1.0))
    keep = np.ones((*free.shape[:-2], 6))
    keep[..., : reach.shape[-1]] = reach <= _IDLE * reach[..., :1]
    return u * keep[..., None, :]


def released(matrix: Array) -> Array:
    """Inverse of a positive semidefinite (..., k, k); directions without stiffness carry nothing and are dropped."""
    scaling = unit_diagonal(matrix)
    values, vectors = np.linalg.eigh(matrix * scaling)
    inverse = np.divide(1.0, values, out=np.zeros_like(values), where=values > _IDLE)
    return (vectors * inverse[..., None, :]) @ np.swapaxes(vectors, -1, -2) * scaling


def unit_diagonal(matrix: Array) -> Array:
    """Factors (..., k, k) that scale a positive semidefinite matrix to a diagonal of ones; zero where it has a zero."""
    scale = np.sqrt(np.einsum("...ii->...i", matrix).clip(min=0.0))
    unit = np.divide(1.0, scale, out=np.zeros_like(scale), where=scale > 0.0)
    return unit[..., :, None] * unit[..., None, :]


def _inverse(core: Array, name: str) -> Array:
    """Inverse of a compliance that must be positive definite: no pivot may vanish, whichever comes last."""
    problem = f"{name}: rigid in a direction that must yield; give it a compliance or a passive joint there"
    try:
        inverse = np.linalg.inv(core)
    except np.linalg.LinAlgError:
        raise InputError(problem) from None
    pivots = 1.0 / (np.einsum("...ii->...i", core) * np.einsum("...ii->...i", inverse))
    if not (pivots > _RIGID).all():
        raise InputError(problem)
    return inverse


def _symmetric(matrix: Array) -> Array:
    return 0.5 * (matrix + np.swapaxes(matrix, -1, -2))


def _stacked(blocks: list[Array], axis: int, empty: tuple[int, int]) -> Array:
    """Concatenate the last two axes of blocks whose stacks may differ."""
    filled = [b for b in blocks if b.shape[axis]]
    if not filled:
        return np.zeros(empty)
    stack = np.broadcast_shapes(*(b.shape[:-2] for b in filled))
    return np.concatenate([np.broadcast_to(b, (*stack, *b.shape[-2:])) for b in filled], axis=axis)
