"""Stability of an interrupted cut, with all harmonics of its coefficients.

A perturbation that is multiplied by μ from tooth to tooth, x(t + τ) = μ x(t), thickens the chip of a
tooth that entered s before by ``h(s) = n(s)·(x(s) - x(s - τ)) = b (1 - 1/μ) ∫ n(s)·Γ_μ(s - s') c(s')
h(s') ds'``. Γ_μ adds the responses to all teeth: a mode with the pole p contributes ``exp(p t) z /
(1 - z)``, ``z = exp(p τ) / μ``, and its own impulse response for t > 0. The integral becomes a matrix
Λ(μ) on a few points of the engagement, and the cut is stable if ``det(1 - b Λ(μ))`` does not encircle
zero as μ runs around the unit circle (Nyquist). The limit is the least depth at which 1/b is an
eigenvalue of Λ there. Few teeth and small radial depths, where the zero-order solution fails, need
the fewest points.

References
----------
T. Insperger, G. Stépán, Semi-Discretization for Time-Delay Systems, Springer 2011 (Floquet theory of
delayed systems); S. D. Merdol, Y. Altintas, Multi frequency solution of chatter stability for low
immersion milling, J. Manuf. Sci. Eng. 126, 2004 (all harmonics).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.lobes.limits import Limits, join_limits

if TYPE_CHECKING:
    from collections.abc import Iterator

    from stiffscope.lobes.engagement import Engagement
    from stiffscope.lobes.response import ToolResponse
    from stiffscope.runtime.types import Array, Complex, Flags, Indices

_LEAST_POINTS = 4  # of a panel, beyond those by which modes vibrate in it
_PER_TURN = 3.0  # further points per vibration of the fastest mode that matters
_MOST_POINTS = 60
_BROAD = 24  # values of μ on half the circle
_SHARP = np.array([-8.0, -3.0, -1.0, 0.0, 1.0, 3.0, 8.0])  # half widths of a resonance
_STEEP = 10  # intervals that are refined in a round
_PARTS = 4  # of an interval
_LOWER = np.geomspace(0.08, 1.0, 12)  # of the depth, at which steep intervals count
_ROUNDS = 4
_SAME = 2e-3  # change of a depth by finer points
_LOW, _HIGH = 0.05, 150.0  # depths of the search, of 1 / (2 max |λ|)
_TRIALS = 72
_AGAIN = np.append(np.geomspace(0.1, 1.02, 24), np.geomspace(1.3, 12.0, 9))
_HALVINGS = 8
_POLISH = 4  # steps to the exact crossing
_WITHIN = 0.1  # relative change of the depth by polishing, at most
_NEAR = 0.5  # the same from a guess
_SETTLED = 1e-6  # imaginary part of 1/b, relative
_BELOW = np.append(np.geomspace(0.08, 0.8, 11), 0.985)  # of a limit: stable depths
_ABOVE = 1.015  # of a limit: depth that must be unstable
_BESIDE = np.array([-0.1, -0.03, -0.01, 0.0, 0.01, 0.03, 0.1])  # rad
_STEP = 1e-5  # relative, of derivatives by frequency and damping
_CHUNK = 48  # pairs of pose and speed at a time
_ALIKE = 0.7  # vibrations in a tooth period, of the most in a chunk
_FEW = 12  # points, up to which traces of powers are exact enough


@dataclass(frozen=True, eq=False)
class Nodes:
    """Points of the engagement, the same for every speed: places in tooth periods.

    Attributes
    ----------
    place, weight
        Places from 0 to 1 and weights (s,) of a quadrature over one tooth period.
    panels
        Parts of the period within which the same teeth cut.
    which
        Place (a,) of each tooth in the workpiece.
    normal, force
        n and c (a, 3) there.
    """

    place: Array
    weight: Array
    panels: tuple[slice, ...]
    which: Indices
    normal: Array
    force: Array


@dataclass(frozen=True, eq=False)
class Loop:
    """Λ(μ) = (1 - 1/μ) (prompt + left diag(z / (1 - z) exp(-p τ)) right) for p pairs of pose and speed.

    Attributes
    ----------
    nodes
        Points of the engagement.
    delay
        Tooth period τ (p,), s.
    poles
        Upper poles (p, m) of the modes, rad/s.
    seen, loaded
        Chip thickness by a mode's coordinate, and force on a mode (p, a, m).
    prompt
        Response (p, a, a) to the forces since the tooth before.
    left, right
        Decaying response to all earlier forces (p, a, 2m), of poles and their conjugates.
    decay
        exp(p τ) (p, 2m).
    """

    nodes: Nodes
    delay: Array
    poles: Complex
    seen: Array
    loaded: Array
    prompt: Array
    left: Complex
    right: Complex
    decay: Complex

    def __getitem__(self, some: Indices) -> Loop:
        """Return the matrices of some pairs."""
        return Loop(
            nodes=self.nodes,
            delay=self.delay[some],
            poles=self.poles[some],
            seen=self.seen[some],
            loaded=self.loaded[some],
            prompt=self.prompt[some],
            left=self.left[some],
            right=self.right[some],
            decay=self.decay[some],
        )

    def matrix(self, theta: Array) -> Complex:
        """Return Λ (p, t, a, a) at multipliers exp(iθ), θ (p, t)."""
        inverse = np.exp(-1j * theta)[..., None]  # 1 / μ
        middle = inverse / (1.0 - self.decay[:, None] * inverse)
        whole = middle @ self.products
        whole += self.prompt.reshape(len(theta), 1, -1)
        whole *= 1.0 - inverse
        return whole.reshape(*theta.shape, *self.prompt.shape[1:])

    @cached_property
    def products(self) -> Complex:
        """Products (p, 2m, a²) of left and right, by pole."""
        each = self.left.mT[..., None] * self.right.mT[:, :, None]
        return each.reshape(*each.shape[:2], -1)

    def slope(self, theta: Array) -> Complex:
        """Return ∂Λ/∂θ (p, a, a) at multipliers exp(iθ), θ (p,)."""
        inverse = np.exp(-1j * theta)[:, None]
        middle = inverse / (1.0 - self.decay * inverse)
        steep = 1.0 / (1.0 - self.decay * inverse) ** 2
        factor = (1.0 - inverse)[..., None]
        both = factor[..., 0] * steep - middle
        by_inverse = (self.left * both[:, None]) @ self.right.mT - self.prompt
        return -1j * inverse[..., None] * by_inverse


def is_stable(
    response: ToolResponse, cut: Engagement, speed: float, depth: float
) -> bool:
    """Return whether a cut is stable at one pose, speed (rev/s) and depth (m)."""
    loop = _form_loop(response, cut, np.array([speed]))
    theta = _angles(loop, response)
    scale = np.array([depth])
    polynomial = _characteristic(loop, theta, scale)
    for _ in range(_ROUNDS):
        theta, polynomial = _refine(loop, theta, polynomial, np.ones(1), scale)
    return not _count_unstable(_determinants(polynomial, np.ones((1, 1))))[0, 0]


def interrupted_depths(
    response: ToolResponse, cut: Engagement, speeds: Array, scale: Array
) -> Array:
    """Return only the depths (n,), m, of `interrupted_limits`, to a thousandth."""
    out = np.empty(len(speeds))
    for some in _group_alike(response, cut, speeds):
        loop = _form_loop(response[some], cut, speeds[some])
        depth, _, size = _search_depth(loop, response[some], scale[some])
        out[some] = depth * size
    return out


def interrupted_limits(
    response: ToolResponse,
    cut: Engagement,
    speeds: Array,
    scale: Array,
    near: tuple[Array, Array] | None = None,
) -> Limits:
    """Return the limits with all harmonics at n poses, infinite if beyond the search.

    Depths above the limit may be stable again; they are not offered.

    Parameters
    ----------
    response
        Response of the tool at n poses.
    cut
        Engagement of the cutter.
    speeds
        Spindle speed (n,) at each pose, rev/s.
    scale
        Depth (n,), m, of which 0.05 to 150 times are searched, as of `depth_scale`.
    near
        Depths (n, k), m, and frequencies (n, k) of chatter, rad/s, near which limits may lie, such
        as those at neighbouring speeds. A limit there counts if all below it is stable; the whole
        range is searched otherwise.
    """
    parts = list[Limits]()
    order = list[np.ndarray]()
    for some in _group_alike(response, cut, speeds):
        hints = None if near is None else (near[0][some], near[1][some])
        parts.append(
            _find_limits(response[some], cut, speeds[some], scale[some], hints)
        )
        order.append(some)
    return join_limits(parts)[np.argsort(np.concatenate(order), kind="stable")]


def _group_alike(
    response: ToolResponse, cut: Engagement, speeds: Array
) -> Iterator[Indices]:
    """Yield the indices of pairs that need about as many points."""
    turns = _find_turns(response, cut, speeds)
    order = np.argsort(-turns, kind="stable")
    start = 0
    while start < len(order):
        alike = turns[order[start:]] > _ALIKE * turns[order[start]] - 0.5
        some = order[start : start + min(int(alike.sum()), _CHUNK)]
        yield some
        start += len(some)


def _find_limits(
    response: ToolResponse,
    cut: Engagement,
    speeds: Array,
    scale: Array,
    near: tuple[Array, Array] | None,
) -> Limits:
    loop = _form_loop(response, cut, speeds)
    guess = np.full(len(speeds), np.inf)
    turn = np.ones(len(speeds))
    if near is not None:
        guess, turn = _approach(loop, response, near)
    far = np.flatnonzero(np.isinf(guess))
    size = np.where(np.isfinite(scale), scale, 1.0)
    depth = guess / size
    angle = turn.copy()
    if far.size:
        depth[far], angle[far], _ = _search_depth(loop[far], response[far], scale[far])
    found = np.isfinite(depth)
    value, angle, right, left = _polish(
        loop, size, np.where(found, depth, 1.0), np.where(found, angle, 1.0)
    )
    return _describe(
        loop,
        response,
        speeds,
        found=found,
        depth=1.0 / value.real,
        angle=angle,
        vectors=(left, right),
    )


def _approach(
    loop: Loop, response: ToolResponse, near: tuple[Array, Array]
) -> tuple[Array, Array]:
    """Return the limit (p,), m, next to one of the guesses, and its angle; infinite if none is.

    No multiplier is outside the circle at four depths up to it, and some is beyond it.
    """
    pairs = np.arange(len(loop.delay))
    depth = np.full((len(pairs), near[0].shape[1]), np.inf)
    angle = np.ones(depth.shape)
    one = np.ones(len(pairs))
    for k in range(depth.shape[1]):
        start = near[0][:, k]
        known = np.isfinite(start)
        turns = np.mod(near[1][:, k] * loop.delay, 2.0 * np.pi)
        turns = np.where(turns > np.pi, 2.0 * np.pi - turns, turns)
        with np.errstate(invalid="ignore", over="ignore"):
            value, angle[:, k], *_ = _polish(
                loop, one, np.where(known, start, 1.0), turns, within=_NEAR
            )
            settled = np.abs(value.imag) < _SETTLED * np.abs(value.real)
        settled &= known & (value.real > 0.0) & (np.abs(value) < np.inf)
        depth[settled, k] = 1.0 / value.real[settled]
    best = depth.argmin(axis=1)
    least = depth[pairs, best]
    there = angle[pairs, best]
    some = np.flatnonzero(np.isfinite(least))
    if not some.size:
        return least, there
    part = loop[some]
    scale = least[some]
    beside = (there[some, None] + _BESIDE).clip(0.0, np.pi)
    theta = np.concatenate([_angles(part, response[some]), beside], axis=1)
    theta = np.sort(theta, axis=1)
    polynomial = _characteristic(part, theta, scale)
    ones = np.ones(len(some))
    theta, polynomial = _refine(part, theta, polynomial, ones, scale)
    around = np.broadcast_to([*_BELOW, _ABOVE], (len(some), len(_BELOW) + 1))
    count = _count_unstable(_determinants(polynomial, around))
    certain = (count[:, :-1] == 0).all(axis=1) & (count[:, -1] > 0)
    least[some[~certain]] = np.inf
    return least, there


def _search_depth(
    loop: Loop, response: ToolResponse, scale: Array
) -> tuple[Array, Array, Array]:
    """Return the least unstable depth (p,) over a size, its angle (p,), and the size (p,), m."""
    known = np.isfinite(scale)
    size = np.where(known, scale, 1.0)
    depth, angle = _search(loop, _angles(loop, response), size)
    return np.where(known, depth, np.inf), angle, size


# --- the matrix -----------------------------------------------------------------


def _form_loop(response: ToolResponse, cut: Engagement, speeds: Array) -> Loop:
    delay = 1.0 / (cut.teeth * speeds)
    poles = _upper_poles(response.rates, response.damping)
    nodes = _place_nodes(cut, float(_find_turns(response, cut, speeds).max()))
    seen = nodes.normal @ response.shapes
    loaded = nodes.force @ response.shapes
    which = nodes.which
    causal = _causal(nodes, poles, delay)[:, :, which][..., which]  # (p, m, a, a)
    prompt = np.einsum("pam,pmab,pbm->pab", seen, causal, loaded)
    # a static remainder acts at once on all teeth that are in the workpiece
    together = which[:, None] == which
    still = nodes.normal @ response.remainder @ nodes.force.T
    prompt = prompt + np.where(together, still, 0.0)
    left, right = _lasting(nodes, poles, delay, seen, loaded)
    both = np.concatenate([poles, poles.conj()], axis=1)
    return Loop(
        nodes=nodes,
        delay=delay,
        poles=poles,
        seen=seen,
        loaded=loaded,
        prompt=prompt,
        left=left,
        right=right,
        decay=np.exp(both * delay[:, None]),
    )


def _find_turns(response: ToolResponse, cut: Engagement, speeds: Array) -> Array:
    """Return how often (p,) the fastest mode that matters vibrates in a tooth period."""
    fastest = np.where(response.matters, response.rates, 0.0).max(axis=1)
    turns: Array = fastest / (2.0 * np.pi * cut.teeth * speeds)
    return turns


def _upper_poles(rates: Array, damping: Array) -> Complex:
    poles: Complex = -damping * rates + 1j * rates * np.sqrt(1.0 - damping**2)
    return poles


def _place_nodes(cut: Engagement, turns: float) -> Nodes:
    """Return the points of a cut for modes that turn so often in a tooth period.

    Panels end where a tooth leaves, so that the same teeth cut within a panel.
    """
    window = cut.immersed  # in tooth periods
    rest = window - np.floor(window + 1e-9)
    ends = [0.0, max(rest, 0.0)]
    if window > 1.0 - 1e-9:
        ends.append(1.0)
    # directions of a tooth turn twice as fast as it does
    turning = turns + 2.0 / cut.teeth
    place = list[np.ndarray]()
    weight = list[np.ndarray]()
    panels = list[slice]()
    which = list[np.ndarray]()
    since = list[np.ndarray]()
    first = 0
    for low, high in pairwise(ends):
        length = high - low
        if length <= 1e-9:
            continue
        count = _LEAST_POINTS + int(np.ceil(_PER_TURN * turning * length))
        count = min(count, _MOST_POINTS)
        x, w, _, _ = _panel(count)
        place.append(low + length * x)
        weight.append(length * w)
        panels.append(slice(first, first + count))
        teeth = int(np.floor(window - low - 0.5 * length)) + 1
        for periods in range(teeth):
            which.append(np.arange(first, first + count))
            since.append(place[-1] + periods)
        first += count
    angle = cut.start + 2.0 * np.pi / cut.teeth * np.concatenate(since)
    return Nodes(
        place=np.concatenate(place),
        weight=np.concatenate(weight),
        panels=tuple(panels),
        which=np.concatenate(which),
        normal=cut.normal(angle),
        force=cut.force(angle),
    )


@cache
def _panel(count: int) -> tuple[Array, Array, Array, Array]:
    """Return nodes and weights (m,) on 0 to 1, and points ξ, weights (q,) of partial integrals.

    `_partial` has the node polynomials there.
    """
    nodes, weights = np.polynomial.legendre.leggauss(count)
    inner, inner_weights = np.polynomial.legendre.leggauss(count + 4)
    return (
        0.5 * (nodes + 1.0),
        0.5 * weights,
        0.5 * (inner + 1.0),
        0.5 * inner_weights,
    )


@cache
def _partial(count: int) -> Array:
    """Return the node polynomials ℓ_j at x_i ξ_q (i, q, j)."""
    nodes, _, inner, _ = _panel(count)
    at = nodes[:, None] * inner
    basis = np.polynomial.legendre.legvander(2.0 * nodes - 1.0, count - 1)
    wanted = np.polynomial.legendre.legvander(2.0 * at - 1.0, count - 1)
    return wanted @ np.linalg.inv(basis)


def _causal(nodes: Nodes, poles: Complex, delay: Array) -> Array:
    """Return ∫ g(s_i - s') ℓ_j(s') ds' over s' < s_i (p, m, s, s) for the impulse responses g."""
    count = len(nodes.place)
    out = np.zeros((*poles.shape, count, count))
    period = delay[:, None, None, None]
    for panel in nodes.panels:
        size = panel.stop - panel.start
        x, _, inner, inner_weights = _panel(size)
        length = nodes.weight[panel].sum()
        since = length * x[:, None] * (1.0 - inner)  # (i, q)
        partial = length * x[:, None] * inner_weights
        within = _impulse(since * period, poles) * partial * period
        out[:, :, panel, panel] = np.einsum("pmiq,iqj->pmij", within, _partial(size))
        later = slice(panel.stop, count)
        passed = nodes.place[later][:, None] - nodes.place[panel]
        weight = nodes.weight[panel] * period
        out[:, :, later, panel] = _impulse(passed * period, poles) * weight
    return out


def _impulse(time: Array, poles: Complex) -> Array:
    """Return the impulse responses (p, m, i, j) of modes of unit mass at times (p, 1, i, j)."""
    at = poles[..., None, None]
    return np.exp(at.real * time) * np.sin(at.imag * time) / at.imag


def _lasting(
    nodes: Nodes, poles: Complex, delay: Array, seen: Array, loaded: Array
) -> tuple[Complex, Complex]:
    """Return factors (p, a, 2m) of the responses to all earlier teeth."""
    both = np.concatenate([poles, poles.conj()], axis=1)[:, None]
    sign = np.concatenate([0.5j / -poles.imag, 0.5j / poles.imag], axis=1)[:, None]
    period = delay[:, None, None]
    at = nodes.place[nodes.which][:, None] * period  # (p, a, 1)
    weight = nodes.weight[nodes.which][:, None] * period
    since: Complex = np.exp(both * at)
    left = since * np.concatenate([seen, seen], axis=2)
    remaining: Complex = np.exp(both * (period - at))
    right = remaining * np.concatenate([loaded, loaded], axis=2) * weight * sign
    return left, right


# --- the search -----------------------------------------------------------------


def _angles(loop: Loop, response: ToolResponse) -> Array:
    """Return angles θ (p, t) of μ from 0 to π, ascending.

    They are evenly spread, and dense at the multipliers of the modes that matter.
    """
    matters = response.matters
    count = int(matters.sum(axis=1).max())
    chosen = np.argsort(~matters, axis=1, kind="stable")[:, :count]
    poles = np.take_along_axis(loop.poles, chosen, axis=1) * loop.delay[:, None]
    turned = np.mod(poles.imag, 2.0 * np.pi)
    centre = np.where(turned > np.pi, 2.0 * np.pi - turned, turned)
    width = np.minimum(-poles.real, 0.5)
    sharp = (centre[..., None] + width[..., None] * _SHARP).reshape(len(poles), -1)
    sharp = np.abs(sharp)  # a resonance reaches across the real axis
    sharp = np.where(sharp > np.pi, 2.0 * np.pi - sharp, sharp).clip(0.0, np.pi)
    spread = np.broadcast_to(np.linspace(0.0, np.pi, _BROAD), (len(poles), _BROAD))
    return np.sort(np.concatenate([spread, sharp], axis=1), axis=1)


def _search(loop: Loop, theta: Array, scale: Array) -> tuple[Array, Array]:
    """Return the least unstable depth (p,) over the scale, infinite if none, and its angle (p,)."""
    polynomial = _characteristic(loop, theta, scale)
    whole = np.geomspace(_LOW, _HIGH, _TRIALS)
    trials = np.broadcast_to(whole, (len(theta), _TRIALS))
    depth, angle = _bracket(polynomial, theta, trials)
    active = np.arange(len(theta))
    for _ in range(_ROUNDS):
        before = depth[active]
        at = np.where(np.isfinite(before), before, _HIGH)
        some = loop[active]
        theta, polynomial = _refine(some, theta, polynomial, at, scale[active])
        # islands of instability below may have been passed over, and that found be none
        after, angle[active] = _bracket(polynomial, theta, at[:, None] * _AGAIN)
        depth[active] = after
        with np.errstate(invalid="ignore"):
            same = (after == before) | (np.abs(after - before) <= _SAME * before)
        if same.all():
            break
        active = active[~same]
        theta = theta[~same]
        polynomial = polynomial[:, ~same]
    return depth, angle


def _refine(
    loop: Loop, theta: Array, polynomial: Complex, depth: Array, scale: Array
) -> tuple[Array, Complex]:
    """Return more angles (p, t) and coefficients: where the phase turns fast at depths (p,)."""
    lower = depth[:, None] * _LOWER  # where islands of instability may lie
    turns = np.abs(_turns(_determinants(polynomial, lower))).max(axis=1)
    steep = np.argsort(-turns, axis=1)[:, :_STEEP]
    low = np.take_along_axis(theta, steep, axis=1)
    high = np.take_along_axis(theta, steep + 1, axis=1)
    share = np.linspace(0.0, 1.0, _PARTS + 1)[1:-1]
    more = low[..., None] + (high - low)[..., None] * share
    more = more.reshape(len(theta), -1)
    both = np.concatenate([theta, more], axis=1)
    order = np.argsort(both, axis=1, kind="stable")
    finer = np.concatenate([polynomial, _characteristic(loop, more, scale)], axis=2)
    return (
        np.take_along_axis(both, order, axis=1),
        np.take_along_axis(finer, order[None], axis=2),
    )


def _characteristic(loop: Loop, theta: Array, scale: Array) -> Complex:
    """Return the coefficients (k, p, t) of det(1 - b Λ) in powers of b / scale.

    On few points from the traces of powers (Newton's identities), which is far faster than
    eigenvalues, and exact enough as only depths up to the first unstable one are asked for.
    """
    matrix = loop.matrix(theta) * scale[:, None, None, None]
    size = matrix.shape[-1]
    if size > _FEW:
        values: Complex = np.linalg.eigvals(matrix).astype(complex)
        order = np.argsort(-np.abs(values), axis=-1)[..., :_FEW]
        return _expand(np.take_along_axis(values, order, axis=-1))
    powers = [matrix]
    while 2 * len(powers) < size:
        powers.append(powers[-1] @ matrix)
    traces = [np.einsum("ptaa->pt", matrix)]
    for k in range(2, size + 1):
        half = k // 2
        traces.append(
            np.einsum("ptab,ptba->pt", powers[k - half - 1], powers[half - 1])
        )
    out = np.empty((size + 1, *theta.shape), dtype=complex)
    out[0] = 1.0
    for k in range(1, size + 1):
        out[k] = -traces[k - 1]
        for j in range(1, k):
            out[k] -= out[k - j] * traces[j - 1]
        out[k] /= k
    return out


def _expand(values: Complex) -> Complex:
    """Return the coefficients (k + 1, p, t) of Π (1 - b λ) for eigenvalues λ (p, t, k)."""
    out = np.zeros((values.shape[-1] + 1, *values.shape[:-1]), dtype=complex)
    out[0] = 1.0
    for k in range(values.shape[-1]):
        out[1 : k + 2] -= values[..., k] * out[: k + 1]
    return out


def _determinants(polynomial: Complex, depth: Array) -> Complex:
    """Return det(1 - b Λ) (p, k, t) at depths (p, k), by Horner's rule."""
    at = depth[..., None]
    out = np.broadcast_to(
        polynomial[-1][:, None], (*depth.shape, polynomial.shape[-1])
    ).copy()
    for coefficient in polynomial[-2::-1]:
        out *= at
        out += coefficient[:, None]
    return out


def _turns(determinants: Complex) -> Array:
    """Return the changes (…, t - 1) of phase between angles, rad."""
    return np.angle(determinants[..., 1:] * determinants[..., :-1].conj())


def _count_unstable(determinants: Complex) -> Indices:
    """Return how many multipliers (…,) lie outside the unit circle.

    Minus the turns of the phase around the circle: twice those that cross the negative real axis
    on its half, and one if the determinant at μ = -1 is negative.
    """
    real = determinants.real
    above = determinants.imag >= 0.0
    above[..., [0, -1]] = True  # real there, but for rounding
    crossed = above[..., 1:] != above[..., :-1]
    index = np.nonzero(crossed)
    after = (*index[:-1], index[-1] + 1)
    first = determinants[index]
    second = determinants[after]
    across = first.real * second.imag - second.real * first.imag
    left = across * (second.imag - first.imag) < 0.0
    turned = np.where(above[index], 1, -1) * left
    count = np.zeros(determinants.shape[:-1], dtype=int)
    np.add.at(count, index[:-1], turned)
    return -(2 * count + (real[..., -1] < 0.0))


def _bracket(polynomial: Complex, theta: Array, trials: Array) -> tuple[Array, Array]:
    """Return the least unstable depth (p,), infinite if none, and the angle of its multiplier.

    ``trials`` (p, k): depths at which multipliers are counted first, ascending.
    """
    pairs = np.arange(len(theta))
    unstable = _count_unstable(_determinants(polynomial, trials)) > 0
    first = unstable.argmax(axis=1)
    found = unstable.any(axis=1)
    high = trials[pairs, first]
    low = np.where(first > 0, trials[pairs, first - 1], 0.0)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        determinants = _determinants(polynomial, middle[:, None])
        bad = _count_unstable(determinants)[:, 0] > 0
        high = np.where(bad, middle, high)
        low = np.where(bad, low, middle)
    # between both depths the phase jumps where the multiplier crosses the circle
    ends = _determinants(polynomial, np.stack([low, high], axis=1))
    jump = np.abs(np.diff(_turns(ends), axis=1))[:, 0].argmax(axis=1)
    before = ends[pairs, 1, jump]
    step = before - ends[pairs, 1, jump + 1]
    share = (before * step.conj()).real / np.maximum(np.abs(step) ** 2, 1e-300)
    start = theta[pairs, jump]
    angle = start + share.clip(0.0, 1.0) * (theta[pairs, jump + 1] - start)
    return np.where(found, 0.5 * (low + high), np.inf), angle


def _polish(
    loop: Loop, scale: Array, depth: Array, angle: Array, within: float = _WITHIN
) -> tuple[Complex, Array, Complex, Complex]:
    """Return the real eigenvalue 1/b (p,), 1/m, its angle (p,) and its vectors (p, a).

    Two-sided Rayleigh quotients and Newton's method for a vanishing imaginary part.
    """
    pairs = np.arange(len(angle))
    identity = np.eye(loop.prompt.shape[-1])
    value: Complex = 1.0 / (scale * depth) + 0j
    begin = value.real
    here = angle
    right: Complex = np.empty(0, dtype=complex)
    left = right
    for _ in range(_POLISH):
        matrix = loop.matrix(here[:, None])[:, 0]
        # dominated by the product of both vectors next to an eigenvalue
        least = 1e-15 * np.abs(matrix).max(axis=(1, 2)) + 1e-300
        away = matrix - (value * (1.0 + 1e-9) + least)[:, None, None] * identity
        inverse = np.linalg.inv(away)
        size = np.abs(inverse)
        right = inverse[pairs, :, size.max(axis=1).argmax(axis=1)]
        left = inverse[pairs, size.max(axis=2).argmax(axis=1)]
        norm = np.einsum("pa,pa->p", left, right)
        value = np.einsum("pa,pab,pb->p", left, matrix, right) / norm
        rate = np.einsum("pa,pab,pb->p", left, loop.slope(here), right) / norm
        step = np.where(rate.imag != 0.0, -value.imag, 0.0)
        step = step / np.where(rate.imag != 0.0, rate.imag, 1.0)
        step = step.clip(-0.3, 0.3)
        here = (here + step).clip(0.0, np.pi)
        value = value + rate * step
    near = np.abs(value.real / begin - 1.0) < within
    return np.where(near, value, begin), np.where(near, here, angle), right, left


def _describe(
    loop: Loop,
    response: ToolResponse,
    speeds: Array,
    *,
    found: Flags,
    depth: Array,
    angle: Array,
    vectors: tuple[Complex, Complex],
) -> Limits:
    """Return the limits with the changes that modes make to them.

    λ is stationary in its eigenvectors, so that it changes by the terms of the modes alone.
    """
    left, right = vectors
    rates = response.rates
    damping = response.damping
    terms = _mode_terms(loop, rates, damping, angle, vectors)
    norm = np.einsum("pa,pa->p", left, right)
    factor = (1.0 - np.exp(-1j * angle)) / norm
    value = 1.0 / depth + 0j
    by_rate = _mode_terms(loop, rates * (1.0 + _STEP), damping, angle, vectors) - terms
    by_damping = (
        _mode_terms(loop, rates, damping * (1.0 + _STEP), angle, vectors) - terms
    )
    share = (factor / value)[:, None]
    turn = np.einsum("pa,pab,pb->p", left, loop.slope(angle), right) / norm / value
    steep = np.abs(turn.imag) > 1e-12 * np.abs(turn.real)
    slope = np.where(steep, turn.real / np.where(steep, turn.imag, 1.0), 0.0)
    real = (terms * share).real
    total = np.abs(real).sum(axis=1, keepdims=True)
    shares = real / np.where(total > 0.0, total, 1.0)
    mode = np.abs(shares).argmax(axis=1)
    near = loop.poles[np.arange(len(mode)), mode].imag
    return Limits(
        depth=np.where(found, depth, np.inf),
        speed=speeds,
        omega=_nearest_harmonic(angle, loop.delay, near),
        shares=shares,
        slope=slope,
        by_rate=by_rate * share / _STEP,
        by_damping=by_damping * share / _STEP,
        # terms are τ² times functions of the poles by τ
        by_speed=-(share * (by_rate / _STEP + 2.0 * terms)).sum(axis=1),
    )


def _mode_terms(
    loop: Loop,
    rates: Array,
    damping: Array,
    angle: Array,
    vectors: tuple[Complex, Complex],
) -> Complex:
    """Return the terms (p, m) of leftᵀ Λ right / (1 - 1/μ), by mode."""
    left, right = vectors
    nodes = loop.nodes
    which = nodes.which
    poles = _upper_poles(rates, damping)
    # forces and chip thicknesses of teeth that cut together act at the same places
    places = len(nodes.place)
    gather = np.zeros((places, len(which)))
    gather[which, np.arange(len(which))] = 1.0
    felt = gather @ (left[..., None] * loop.seen)  # (p, s, m)
    driven = gather @ (right[..., None] * loop.loaded)
    causal = _causal(nodes, poles, loop.delay)
    prompt = np.einsum("psm,pmst,ptm->pm", felt, causal, driven)
    lasting_left, lasting_right = _lasting(
        nodes, poles, loop.delay, loop.seen, loop.loaded
    )
    both = np.concatenate([poles, poles.conj()], axis=1)
    inverse = np.exp(-1j * angle)[:, None]
    middle = inverse / (1.0 - np.exp(both * loop.delay[:, None]) * inverse)
    after = np.einsum("pa,pam->pm", left, lasting_left)
    before = np.einsum("pa,pam->pm", right, lasting_right)
    m = rates.shape[1]
    lasting = after * middle * before
    return prompt + lasting[:, :m] + lasting[:, m:]


def _nearest_harmonic(angle: Array, delay: Array, near: Array) -> Array:
    """Return the frequency (p,), rad/s, of multipliers exp(±iθ) that is nearest to a given one."""
    either = np.stack([angle, -angle])
    turns = np.rint((near * delay - either) / (2.0 * np.pi))
    frequencies = np.abs(either + 2.0 * np.pi * turns) / delay
    best = np.abs(frequencies - near).argmin(axis=0)
    return frequencies[best, np.arange(len(near))]
