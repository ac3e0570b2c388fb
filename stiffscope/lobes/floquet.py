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

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields
from functools import cache, cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from stiffscope.lobes.limits import Limits, join_limits
from stiffscope.runtime.processors import processors

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from stiffscope.lobes.engagement import Engagement
    from stiffscope.lobes.response import ToolResponse
    from stiffscope.runtime.types import Array, Complex, Flags, Indices

Result = TypeVar("Result")

_LEAST_POINTS = 4  # of a panel, beyond those by which modes vibrate in it
_PER_TURN = 3.0  # further points per vibration of the fastest mode that matters
_MOST_POINTS = 60
_BROAD = 24  # values of μ on half the circle
_SHARP = np.array([-8.0, -3.0, -1.0, 0.0, 1.0, 3.0, 8.0])  # half widths of a resonance
_STEEP = 10  # intervals that are refined in a round
_PARTS = 4  # of an interval
_ROUNDS = 5
_FLAT = 1.0 - np.cos(1.2)  # of 1 - cos of a phase: not refined any more
_HIGH = 500.0  # end of the search, of 1 / (2 max |λ|)
_SAFE = 0.8  # of the depth 1 / max |λ| at the angles, as peaks between them are higher
_APART = 1.1  # ratio of depths that are tried first,
_DEPTHS = 24  # how many are tried later, up to one that is unstable,
_APART_LAST = 1.03  # and the ratio at the end of a thorough search
_HALVINGS = 3
_NEWTON = 4
_POLISH = 4  # steps to the exact crossing
_WITHIN = 0.1  # relative change of the depth by polishing, at most
_NEAR = 0.5  # the same from a guess
_SETTLED = 1e-4  # last step of an angle, rad: of a crossing that was found,
_EXACT = 1e-9  # and of one that needs no more
_AGREE = 0.02  # relative difference of guesses that lead to the same crossing
_DESCENTS = 3  # from one crossing to another below,
_BEYOND = 2.0  # or from a depth above guesses that lead to none, relative
_BELOW = 32  # stable depths up to a limit,
_ALMOST = 0.985  # and the last of them
_ABOVE = 1.015  # of a limit: depth that must be unstable
_BESIDE = np.array([-0.1, -0.03, -0.01, 0.0, 0.01, 0.03, 0.1])  # rad
_STEP = 1e-5  # relative, of derivatives by frequency and damping
_CHUNK = 48  # pairs of pose and speed at a time
_CACHED = 20_000  # determinants at a time
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

    def __getitem__(self, some: Indices | Flags) -> Loop:
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


@dataclass(frozen=True, eq=False)
class Curve:
    """det(1 - b Λ(exp iθ)) of p pairs at t angles, as polynomials of the depth b over a scale.

    Attributes
    ----------
    theta
        Angles (p, t), ascending from 0 to π.
    coefficients
        Coefficients (p, k, t), of the powers 0 to k - 1.
    radius
        Bounds (p, t) of the largest |λ|, by the scale.
    """

    theta: Array
    coefficients: Complex
    radius: Array

    def __getitem__(self, some: Indices | Flags) -> Curve:
        """Return the curves of some pairs."""
        return Curve(self.theta[some], self.coefficients[some], self.radius[some])

    @property
    def stable(self) -> Array:
        """Depth (p,) below which no multiplier can be outside the circle: |b λ| < 1 everywhere."""
        depth: Array = _SAFE / np.maximum(self.radius.max(axis=1), 1e-300)
        return depth

    def at(self, depth: Array) -> tuple[Array, Array]:
        """Return the real and imaginary parts (p, d, t) of the determinants at depths (p, d)."""
        powers = depth[..., None] ** np.arange(self.coefficients.shape[1])
        # powers are real: both parts come from one product
        parts = np.concatenate([self.coefficients.real, self.coefficients.imag], axis=2)
        values = powers @ parts
        count = self.theta.shape[1]
        return values[..., :count], values[..., count:]

    def find_crossing(self, low: Array, high: Array) -> tuple[Array, Array]:
        """Return the depth (p,) between two at which a multiplier crosses, and its angle (p,).

        Between both depths the phase jumps where the multiplier crosses the circle. There the
        coefficients are taken as linear between two angles, and Newton's method finds the depth and
        the share of the way at which the determinant vanishes.
        """
        pairs = np.arange(len(low))
        real, imag = self.at(np.stack([low, high], axis=1))
        ends = real + 1j * imag
        turns = np.angle(ends[..., 1:] * ends[..., :-1].conj())
        jump = np.abs(np.diff(turns, axis=1))[:, 0].argmax(axis=1)
        begin = self.coefficients[pairs, :, jump]
        change = self.coefficients[pairs, :, jump + 1] - begin
        depth = 0.5 * (low + high)
        share = np.full(len(low), 0.5)
        for _ in range(_NEWTON):
            value: Complex = np.zeros(len(low), dtype=complex)
            by_depth = value
            by_share = value
            for first, step in zip(begin.T[::-1], change.T[::-1], strict=True):
                by_depth = by_depth * depth + value
                value = value * depth + first + share * step
                by_share = by_share * depth + step
            # value + by_depth·Δb + by_share·Δs = 0, both real
            area = (by_depth.conj() * by_share).imag
            area = np.where(area == 0.0, np.inf, area)
            depth = depth - (value.conj() * by_share).imag / area
            share = share + (value.conj() * by_depth).imag / area
            depth = depth.clip(low, high)
            share = share.clip(0.0, 1.0)
        start = self.theta[pairs, jump]
        return depth, start + share * (self.theta[pairs, jump + 1] - start)

    def refine(self, loop: Loop, scale: Array, bend: Array) -> Curve:
        """Return the curve with more angles, in the intervals (p, t - 1) of greatest bend."""
        steep = np.argpartition(-bend, _STEEP - 1, axis=1)[:, :_STEEP]
        low = np.take_along_axis(self.theta, steep, axis=1)
        high = np.take_along_axis(self.theta, steep + 1, axis=1)
        part = np.linspace(0.0, 1.0, _PARTS + 1)[1:-1]
        more = low[..., None] + (high - low)[..., None] * part
        finer = _characteristic(loop, more.reshape(len(scale), -1), scale)
        theta = np.concatenate([self.theta, finer.theta], axis=1)
        order = np.argsort(theta, axis=1, kind="stable")
        both = np.concatenate([self.coefficients, finer.coefficients], axis=2)
        radius = np.concatenate([self.radius, finer.radius], axis=1)
        return Curve(
            theta=np.take_along_axis(theta, order, axis=1),
            coefficients=np.take_along_axis(both, order[:, None], axis=2),
            radius=np.take_along_axis(radius, order, axis=1),
        )


@dataclass(frozen=True, eq=False)
class Turns:
    """How determinants turn around zero as μ runs along the half circle, at d depths of p pairs.

    Attributes
    ----------
    depth
        Depths (p, d), ascending.
    unstable
        How many multipliers (p, d) lie outside the unit circle.
    bend
        1 - cos of the greatest change of phase (p, t - 1) between two angles, at depths up to the
        first unstable one.
    below
        The same without the last two of these depths, between which a multiplier crosses.
    """

    depth: Array
    unstable: Indices
    bend: Array
    below: Array

    def __getitem__(self, some: Flags) -> Turns:
        """Return the turns of some pairs."""
        return Turns(
            self.depth[some], self.unstable[some], self.bend[some], self.below[some]
        )

    @property
    def first(self) -> Indices:
        """Index (p,) of the first unstable depth, d if there is none."""
        return _find_first(self.unstable)

    def find_top(self, high: Array) -> Array:
        """Return the first unstable depth (p,), or the highest if there is none."""
        first = self.first
        found = first < self.depth.shape[1]
        there = self.depth[np.arange(len(first)), np.where(found, first, 0)]
        return np.where(found, there, high)


@dataclass(frozen=True, eq=False)
class Crossing:
    """Where a multiplier of each of p pairs crosses the unit circle.

    Attributes
    ----------
    depth
        Depths b (p,), m: 1/b is an eigenvalue of Λ.
    angle
        Angles θ (p,) of the multipliers.
    right, left
        Eigenvectors (p, a) of Λ.
    settled
        Whether (p,) Newton's method ended there.
    """

    depth: Array
    angle: Array
    right: Complex
    left: Complex
    settled: Flags


def is_stable(
    response: ToolResponse, cut: Engagement, speed: float, depth: float
) -> bool:
    """Return whether a cut is stable at one pose, speed (rev/s) and depth (m)."""
    loop = _form_loop(response, cut, np.array([speed]))
    scale = np.array([depth])
    curve = _characteristic(loop, _angles(loop, response), scale)
    one = np.ones((1, 1))
    turns = _follow(curve, one)
    for _ in range(_ROUNDS):
        curve = curve.refine(loop, scale, turns.bend)
        turns = _follow(curve, one)
    return not turns.unstable[0, 0]


def interrupted_depths(
    response: ToolResponse, cut: Engagement, speeds: Array, scale: Array, most: Array
) -> Array:
    """Return the depths (n,), m, of `interrupted_limits` to about a hundredth.

    They are infinite where they exceed ``most`` (n,), m.
    """

    def search(some: Indices) -> Array:
        loop = _form_loop(response[some], cut, speeds[some])
        curve = _characteristic(loop, _angles(loop, response[some]), scale[some])
        high = np.minimum(most[some] / scale[some], _HIGH)
        depth = np.full(len(some), np.inf)
        asked = np.flatnonzero(curve.stable < high)
        if asked.size:
            depth[asked], _ = _search(
                loop[asked], curve[asked], scale[some][asked], high[asked]
            )
        return depth * scale[some]

    known = np.flatnonzero(np.isfinite(scale))
    groups = [known[some] for some in _group_alike(response[known], cut, speeds[known])]
    out = np.full(len(speeds), np.inf)
    for some, depth in zip(groups, _in_threads(search, groups), strict=True):
        out[some] = depth
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

    def find(some: Indices) -> Limits:
        guesses = None if near is None else (near[0][some], near[1][some])
        return _find_limits(response[some], cut, speeds[some], scale[some], guesses)

    groups = list(_group_alike(response, cut, speeds))
    limits = join_limits(_in_threads(find, groups))
    return limits[np.argsort(np.concatenate(groups), kind="stable")]


def _in_threads(
    function: Callable[[Indices], Result], groups: Sequence[Indices]
) -> list[Result]:
    """Return a function's results for groups of pairs, worked out by all processors."""
    with ThreadPoolExecutor(processors()) as pool:
        return list(pool.map(function, groups))


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
    theta = _angles(loop, response)
    depth = np.full(len(speeds), np.inf)
    angle = np.ones(len(speeds))
    if near is not None:
        guess, omega = near
        turned = _fold(omega * loop.delay[:, None])
        depth, angle = _descend(loop, theta, guess, turned)
    rest = np.flatnonzero(np.isfinite(scale) & np.isinf(depth))
    if rest.size:
        part = loop[rest]
        size = scale[rest]
        curve = _characteristic(part, theta[rest], size)
        high = np.full(len(rest), _HIGH)
        found, angle[rest] = _search(part, curve, size, high, thorough=True)
        depth[rest] = found * size
    known = np.isfinite(scale) & np.isfinite(depth)
    crossing = _polish(loop, np.where(known, depth, 1.0), angle)
    return _describe(loop, response, speeds, crossing, known)


def _descend(
    loop: Loop, theta: Array, near: Array, turned: Array
) -> tuple[Array, Array]:
    """Return limits (p,), m, from guesses (p, k) of depths, m, and angles; and their angles (p,).

    A crossing next to a guess is the limit if no multiplier is outside the circle below. If some is,
    the crossing where it leaves is the next guess; so it is below a depth beyond all guesses where
    none leads to a crossing. Limits that are not found are infinite.
    """
    depth, angle = _settle(loop, near, turned)
    highest = np.where(np.isfinite(near), near, -np.inf).max(axis=1)
    asked = np.flatnonzero(np.isfinite(depth) | (highest > 0.0))
    for _ in range(_DESCENTS):
        if not asked.size:
            break
        crossing = np.isfinite(depth[asked])
        start = np.where(crossing, depth[asked], _BEYOND * highest[asked])
        lower, at, least = _find_lower(
            loop[asked], theta[asked], start, angle[asked], crossing
        )
        depth[asked] = lower
        below = np.isfinite(lower) & ~least
        asked = asked[below]
        depth[asked], angle[asked] = _settle(
            loop[asked], lower[below][:, None], at[below][:, None]
        )
        asked = asked[np.isfinite(depth[asked])]
    depth[asked] = np.inf
    return depth, angle


def _settle(loop: Loop, near: Array, turned: Array) -> tuple[Array, Array]:
    """Return the least crossing (p,), m, next to guesses (p, k), and its angle.

    It is infinite where there is none.
    """
    depth = np.full(len(near), np.inf)
    angle = turned[:, 0].copy()
    for k in range(near.shape[1]):
        start = near[:, k]
        known = np.isfinite(start)
        if k > 0:  # guesses that agree lead to the same crossing
            known &= np.isinf(depth) | (np.abs(start / near[:, 0] - 1.0) > _AGREE)
        some = np.flatnonzero(known)
        if not some.size:
            continue
        with np.errstate(invalid="ignore", over="ignore"):
            found = _polish(loop[some], start[some], turned[some, k], within=_NEAR)
        lower = found.settled & (found.depth < depth[some])
        depth[some[lower]] = found.depth[lower]
        angle[some[lower]] = found.angle[lower]
    return depth, angle


def _find_lower(
    loop: Loop, theta: Array, depth: Array, angle: Array, crossing: Flags
) -> tuple[Array, Array, Flags]:
    """Return where multipliers leave the circle first below depths (p,), m, and near angles (p,).

    Depths, angles, and whether the depth is the limit itself: one at which a multiplier crosses as
    stated, with none outside the circle below, and some beyond. The depth is infinite where none is
    outside beyond, either.
    """
    beside = (angle[:, None] + _BESIDE).clip(0.0, np.pi)
    theta = np.sort(np.concatenate([theta, beside], axis=1), axis=1)
    curve = _characteristic(loop, theta, depth)
    below = np.geomspace(np.minimum(curve.stable, _ALMOST), _ALMOST, _BELOW, axis=1)
    above = np.full((len(below), 1), _ABOVE)
    tried = np.concatenate([below, above], axis=1)
    turns = _follow(curve, tried)
    lower = np.full(len(depth), np.inf)
    at = angle.copy()
    least = np.zeros(len(depth), dtype=bool)

    def decide(some: Indices, part: Curve, last: Turns) -> None:
        least[some] = (last.first == _BELOW) & crossing[some]
        less = (last.first <= _BELOW) & ~least[some]
        if less.any():
            share, at[some[less]] = _locate(part[less], last[less])
            lower[some[less]] = share * depth[some[less]]

    # angles near the crossing are dense; others may be too few
    steep = (turns.first == _BELOW) & (turns.below >= _FLAT).any(axis=1)
    decide(np.flatnonzero(~steep), curve[~steep], turns[~steep])
    if steep.any():
        finer = curve[steep].refine(loop[steep], depth[steep], turns.below[steep])
        decide(np.flatnonzero(steep), finer, _follow(finer, tried[steep]))
    lower[least] = depth[least]
    return lower, at, least


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
    centre = _fold(poles.imag)
    width = np.minimum(-poles.real, 0.5)
    sharp = (centre[..., None] + width[..., None] * _SHARP).reshape(len(poles), -1)
    sharp = np.abs(sharp)  # a resonance reaches across the real axis
    sharp = np.where(sharp > np.pi, 2.0 * np.pi - sharp, sharp).clip(0.0, np.pi)
    spread = np.broadcast_to(np.linspace(0.0, np.pi, _BROAD), (len(poles), _BROAD))
    return np.sort(np.concatenate([spread, sharp], axis=1), axis=1)


def _fold(turned: Array) -> Array:
    """Return the angles from 0 to π of multipliers that turned so far, or of their conjugates."""
    within = np.mod(turned, 2.0 * np.pi)
    return np.minimum(within, 2.0 * np.pi - within)


def _search(
    loop: Loop, curve: Curve, scale: Array, high: Array, *, thorough: bool = False
) -> tuple[Array, Array]:
    """Return the least unstable depth (p,) over the scale, infinite if none, and its angle (p,).

    Depths up to the highest (p,) are searched. Angles are added until the phase of the determinant
    turns little between any two, at all depths up to the first unstable one. Then, in a thorough
    search, depths are tried more densely, as islands of instability may lie below.
    """
    depth = np.full(len(scale), np.inf)
    angle = np.ones(len(scale))
    active = np.arange(len(scale))
    tried = _spread(curve.stable, high, _APART)
    for left in reversed(range(_ROUNDS)):
        turns = _follow(curve, tried)
        top = turns.find_top(high[active])
        settled = (turns.bend < _FLAT).all(axis=1) | (left == 0)
        if settled.any():
            some = active[settled]
            part = curve[settled]
            last = turns[settled]
            if thorough:
                part, last = _search_islands(
                    loop[some], part, scale[some], top[settled]
                )
            depth[some], angle[some] = _locate(part, last)
        if settled.all():
            break
        rest = ~settled
        active = active[rest]
        curve = curve[rest].refine(loop[active], scale[active], turns.bend[rest])
        low = np.minimum(curve.stable, top[rest])
        tried = np.geomspace(low, top[rest], _DEPTHS, axis=1)
    return depth, angle


def _search_islands(
    loop: Loop, curve: Curve, scale: Array, top: Array
) -> tuple[Curve, Turns]:
    """Return how a curve turns at dense depths up to the highest (p,), with more angles if need be."""
    tried = _spread(curve.stable, top, _APART_LAST)
    turns = _follow(curve, tried)
    if (turns.below >= _FLAT).any():
        curve = curve.refine(loop, scale, turns.below)
        turns = _follow(curve, tried)
    return curve, turns


def _locate(curve: Curve, turns: Turns) -> tuple[Array, Array]:
    """Return the least unstable depth (p,), infinite if none, and the angle of its multiplier."""
    first = turns.first
    pairs = np.arange(len(first))
    found = first < turns.depth.shape[1]
    high = turns.depth[pairs, np.where(found, first, -1)]
    low = turns.depth[pairs, np.maximum(first - 1, 0)]
    low = np.where(first == 0, np.minimum(curve.stable, high), low)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        bad = _follow(curve, middle[:, None]).unstable[:, 0] > 0
        high = np.where(bad, middle, high)
        low = np.where(bad, low, middle)
    depth, angle = curve.find_crossing(low, high)
    return np.where(found, depth, np.inf), angle


def _spread(low: Array, high: Array, apart: float) -> Array:
    """Return depths (p, d) from low to high (p,), no further apart than by a ratio."""
    low = np.minimum(low, high)
    count = int(np.ceil(np.log((high / low).max(initial=1.0)) / np.log(apart)))
    return np.geomspace(low, high, count + 2, axis=1)


def _follow(curve: Curve, depth: Array) -> Turns:
    """Return how the determinants of a curve turn at depths (p, d).

    A few pairs are done at a time, so that their values stay in the processor's cache.
    """
    size = depth.shape[1] * curve.theta.shape[1]
    few = max(1, _CACHED // size)
    parts = list[Turns]()
    for start in range(0, len(depth), few):
        some = np.arange(start, min(start + few, len(depth)))
        parts.append(_follow_few(curve[some], depth[some]))
    return Turns(
        *[
            np.concatenate([getattr(part, field.name) for part in parts])
            for field in fields(Turns)
        ]
    )


def _follow_few(curve: Curve, depth: Array) -> Turns:
    """Return the turns of a few pairs.

    Multipliers outside the circle are minus the turns around it: twice the passages over the
    negative real axis on its half, and one if the determinant at μ = -1 is negative.
    """
    real, imag = curve.at(depth)
    imag[..., [0, -1]] = 0.0  # but for rounding
    # the product of each determinant and the conjugate of that before
    along = real[..., 1:] * real[..., :-1] + imag[..., 1:] * imag[..., :-1]
    across = imag[..., 1:] * real[..., :-1] - real[..., 1:] * imag[..., :-1]
    above = imag >= 0.0
    before = above[..., :-1]
    after = above[..., 1:]
    down = before & ~after & (across > 0.0)
    up = ~before & after & (across < 0.0)
    passed = np.count_nonzero(down, axis=-1) - np.count_nonzero(up, axis=-1)
    unstable = -(2 * passed + (real[..., -1] < 0.0))
    length = np.sqrt(along**2 + across**2)
    bend = 1.0 - along / np.maximum(length, 1e-300)
    order = np.arange(depth.shape[1]) - _find_first(unstable)[:, None]
    bend[order > 0] = 0.0
    most = bend.max(axis=1)
    bend[order >= -1] = 0.0
    return Turns(depth=depth, unstable=unstable, bend=most, below=bend.max(axis=1))


def _find_first(unstable: Indices) -> Indices:
    """Return the index (p,) of the first unstable depth, d if there is none."""
    some = unstable > 0
    return np.where(some.any(axis=1), some.argmax(axis=1), some.shape[1])


def _characteristic(loop: Loop, theta: Array, scale: Array) -> Curve:
    """Return det(1 - b Λ) at angles (p, t), in powers of b over a scale (p,), m.

    On few points from the traces of powers (Newton's identities), which is far faster than
    eigenvalues, and exact enough as only depths up to the first unstable one are asked for.
    """
    matrix = loop.matrix(theta) * scale[:, None, None, None]
    size = matrix.shape[-1]
    if size > _FEW:
        values: Complex = np.linalg.eigvals(matrix).astype(complex)
        order = np.argsort(-np.abs(values), axis=-1)[..., :_FEW]
        values = np.take_along_axis(values, order, axis=-1)
        return Curve(theta, _expand(values), np.abs(values[..., 0]))
    powers = [matrix]
    while 2 * len(powers) < size:
        powers.append(powers[-1] @ matrix)
    traces = [np.einsum("ptaa->pt", power) for power in powers]
    for k in range(len(powers) + 1, size + 1):
        half = k // 2
        product = np.einsum("ptab,ptba->pt", powers[k - half - 1], powers[half - 1])
        traces.append(product)
    out = np.empty((size + 1, *theta.shape), dtype=complex)
    out[0] = 1.0
    for k in range(1, size + 1):
        out[k] = -traces[k - 1]
        for j in range(1, k):
            out[k] -= out[k - j] * traces[j - 1]
        out[k] /= k
    # no eigenvalue exceeds the k-th root of the norm of the k-th power
    last = powers[-1].reshape(*theta.shape, -1).view(float)
    square = np.einsum("pti,pti->pt", last, last)
    coefficients = np.ascontiguousarray(out.swapaxes(0, 1))
    return Curve(theta, coefficients, square ** (0.5 / len(powers)))


def _expand(values: Complex) -> Complex:
    """Return the coefficients (p, k + 1, t) of Π (1 - b λ) for eigenvalues λ (p, t, k)."""
    p, t, highest = values.shape
    out = np.zeros((p, highest + 1, t), dtype=complex)
    out[:, 0] = 1.0
    for k in range(highest):
        out[:, 1 : k + 2] -= values[:, None, :, k] * out[:, : k + 1]
    return out


def _polish(
    loop: Loop, depth: Array, angle: Array, within: float = _WITHIN
) -> Crossing:
    """Return the crossings next to depths (p,), m, and angles (p,).

    Two-sided Rayleigh quotients and Newton's method for a vanishing imaginary part.
    """
    pairs = np.arange(len(angle))
    identity = np.eye(loop.prompt.shape[-1])
    value: Complex = 1.0 / depth + 0j
    begin = value.real
    step = np.zeros(len(angle))
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
        if np.abs(step).max(initial=0.0) < _EXACT:
            break
    near = np.abs(value.real / begin - 1.0) < within
    return Crossing(
        depth=1.0 / np.where(near, value.real, begin),
        angle=np.where(near, here, angle),
        right=right,
        left=left,
        settled=near & (np.abs(step) < _SETTLED),
    )


def _describe(
    loop: Loop,
    response: ToolResponse,
    speeds: Array,
    crossing: Crossing,
    found: Flags,
) -> Limits:
    """Return the limits with the changes that modes make to them; infinite where none is found.

    λ is stationary in its eigenvectors, so that it changes by the terms of the modes alone.
    """
    left = crossing.left
    right = crossing.right
    angle = crossing.angle
    depth = crossing.depth
    rates = response.rates
    damping = response.damping
    terms = _mode_terms(loop, rates, damping, crossing)
    norm = np.einsum("pa,pa->p", left, right)
    factor = (1.0 - np.exp(-1j * angle)) / norm
    value = 1.0 / depth + 0j
    by_rate = _mode_terms(loop, rates * (1.0 + _STEP), damping, crossing) - terms
    by_damping = _mode_terms(loop, rates, damping * (1.0 + _STEP), crossing) - terms
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
    crossing: Crossing,
) -> Complex:
    """Return the terms (p, m) of leftᵀ Λ right / (1 - 1/μ) at a crossing, by mode."""
    left = crossing.left
    right = crossing.right
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
    inverse = np.exp(-1j * crossing.angle)[:, None]
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
