"""Stability of an interrupted cut, with all harmonics of its coefficients.

A perturbation that is multiplied by μ from tooth to tooth, x(t + τ) = μ x(t), thickens the chip of a
tooth that entered s before by ``h(s) = n(s)·(x(s) - x(s - τ)) = b (1 - 1/μ) ∫ n(s)·Γ_μ(s - s') c(s')
h(s') ds'``. Γ_μ adds the responses to all teeth: a mode with the pole p contributes ``exp(p t) z /
(1 - z)``, ``z = exp(p τ) / μ``, and its own impulse response for t > 0. The integral becomes a matrix
Λ(μ) on a few points of the engagement, and the cut is stable if ``det(1 - b Λ(μ))`` does not encircle
zero as μ runs around the unit circle (Nyquist). Few teeth and small radial depths, where the
zero-order solution fails, need the fewest points.

References
----------
T. Insperger, G. Stépán, Semi-Discretization for Time-Delay Systems, Springer 2011 (Floquet theory of
delayed systems); S. D. Merdol, Y. Altintas, Multi frequency solution of chatter stability for low
immersion milling, J. Manuf. Sci. Eng. 126, 2004 (all harmonics).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from stiffscope.lobes.engagement import Engagement
    from stiffscope.lobes.response import ToolResponse
    from stiffscope.runtime.types import Array, Complex, Indices

_LEAST_POINTS = 5  # of a panel, beyond those by which modes vibrate in it
_PER_TURN = 4.0  # further points per vibration of the fastest mode that matters
_MOST_POINTS = 60
_MATTERS = 0.01  # of the largest static response: modes that set the number of points
_BROAD = 32  # values of μ on half the circle
_SHARP = np.sinh(np.linspace(-4.5, 4.5, 11))  # half widths of a resonance
_TURN = 0.5  # rad of the determinant's phase, above which points are added
_PARTS = 4  # of an interval
_TRIALS = 48  # depths of a first search
_LOW, _HIGH = 0.02, 60.0  # their range, of the zero-order limit over the speeds
_HALVINGS = 12
_ROUNDS = 6
_SAME = 1e-3  # change of a depth by finer points


@dataclass(frozen=True, eq=False)
class Loop:
    """Λ(μ) = (1 - 1/μ) (prompt + left diag(z / (1 - z) exp(-p τ)) right) on a points.

    ``decay`` (2m,): exp(p τ) of the modes' poles and their conjugates.
    """

    prompt: Array
    left: Array
    right: Array
    decay: Array

    def eigenvalues(self, theta: Array) -> Complex:
        """Return the eigenvalues (t, a) at multipliers exp(iθ), θ (t,)."""
        inverse = np.exp(-1j * theta)  # 1 / μ
        middle = inverse[:, None] / (1.0 - self.decay * inverse[:, None])
        later = (self.left * middle[:, None]) @ self.right.T
        factor = (1.0 - inverse)[:, None, None]
        return np.linalg.eigvals(factor * (self.prompt + later)).astype(complex)


@dataclass(frozen=True, eq=False)
class Circle:
    """Eigenvalues (t, a) of Λ at multipliers exp(iθ), θ (t,) from 0 to π, for one speed."""

    loop: Loop
    theta: Array
    values: Complex

    def refined(self, depth: float) -> Circle:
        """Return it with more points where the determinant turns fast at a depth, m."""
        turns = np.abs(self._turns(np.array(depth)))
        coarse = np.flatnonzero(turns > _TURN)
        if not coarse.size:
            return self
        start = self.theta[coarse]
        step = self.theta[coarse + 1] - start
        share = np.linspace(0.0, 1.0, _PARTS + 1)[1:-1]
        more = (start[:, None] + step[:, None] * share).ravel()
        theta = np.concatenate([self.theta, more])
        values = np.concatenate([self.values, self.loop.eigenvalues(more)])
        order = np.argsort(theta)
        return Circle(self.loop, theta[order], values[order])

    def unstable(self, depth: Array) -> Array:
        """Return how many multipliers (…,) lie outside the unit circle at depths (…,), m."""
        turned = self._turns(depth).sum(axis=-1)
        return np.rint(-turned / np.pi).astype(int)

    def _turns(self, depth: Array) -> Array:
        """Return the changes (…, t - 1) of the determinant's phase between points, rad."""
        factors = 1.0 - np.asarray(depth)[..., None, None] * self.values
        whole = factors[..., 0]
        for k in range(1, factors.shape[-1]):  # a product: its phase is all that counts
            whole = whole * factors[..., k]
            whole = whole / np.maximum(np.abs(whole), 1e-300)
        return np.angle(whole[..., 1:] * whole[..., :-1].conj())


@cache
def _panel(count: int) -> tuple[Array, Array, Array, Array]:
    """Return nodes and weights (m,) on 0 to 1, and points ξ, weights (q,) of partial integrals.

    `_partial` has the node polynomials there.
    """
    nodes, weights = np.polynomial.legendre.leggauss(count)
    inner, inner_weights = np.polynomial.legendre.leggauss(count + 6)
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


def circle(response: ToolResponse, cut: Engagement, speed: float) -> Circle:
    """Return the eigenvalues of Λ on the unit circle at one pose and speed.

    Parameters
    ----------
    response
        Response of the tool at one pose.
    cut
        Engagement of the cutter.
    speed
        Spindle speed, rev/s.
    """
    delay = 1.0 / (cut.teeth * speed)
    window = (cut.end - cut.start) / (2.0 * np.pi * speed)
    rates = response.rates[0]
    ratio = response.damping[0]
    shapes = response.shapes[0]
    static = (shapes**2).sum(axis=0) / rates**2
    matters = static > _MATTERS * static.max()
    poles = -ratio * rates + 1j * rates * np.sqrt(1.0 - ratio**2)
    base, weights, panels = _place_nodes(delay, window, rates[matters].max())
    copies = _copy_nodes(base, panels, delay, window)
    which = np.concatenate([index for index, _ in copies])
    turn = np.concatenate([np.full(len(index), turns) for index, turns in copies])
    angle = cut.start + 2.0 * np.pi * speed * (base[which] + turn * delay)
    normal = cut.normal(angle)
    force = cut.force(angle)
    seen = normal @ shapes  # (a, m)
    loaded = force @ shapes
    causal = _causal(base, weights, panels, poles)  # (m, s, s)
    prompt = np.einsum("am,mab,bm->ab", seen, causal[:, which][:, :, which], loaded)
    # a static remainder acts at once on all teeth that are in the workpiece
    together = which[:, None] == which
    prompt += np.where(together, normal @ response.remainder[0] @ force.T, 0.0)
    both = np.concatenate([poles, poles.conj()])
    sign = np.concatenate([0.5j / -poles.imag, 0.5j / poles.imag])
    at = base[which]
    left = np.tile(seen, 2) * np.exp(both * at[:, None])  # (a, 2m)
    remaining = np.exp(both * (delay - at[:, None]))
    right = np.tile(loaded, 2) * remaining * weights[which][:, None] * sign
    loop = Loop(prompt, left, right, np.exp(both * delay))
    theta = _angles(poles, delay)
    return Circle(loop, theta, loop.eigenvalues(theta))


def _place_nodes(
    delay: float, window: float, fastest: float
) -> tuple[Array, Array, list[slice]]:
    """Return nodes and weights over one tooth period, s, and the panels that divide it.

    Panels end where a tooth leaves, so that the same teeth cut within a panel.
    """
    rest = window - delay * np.floor(window / delay + 1e-9)
    ends = [0.0, max(rest, 0.0)]
    if window > delay * (1.0 - 1e-9):
        ends.append(delay)
    nodes = list[np.ndarray]()
    weights = list[np.ndarray]()
    panels = list[slice]()
    first = 0
    for low, high in pairwise(ends):
        length = high - low
        if length <= 1e-9 * delay:
            continue
        turns = fastest * length / (2.0 * np.pi)
        count = min(_LEAST_POINTS + int(np.ceil(_PER_TURN * turns)), _MOST_POINTS)
        x, w, _, _ = _panel(count)
        nodes.append(low + length * x)
        weights.append(length * w)
        panels.append(slice(first, first + count))
        first += count
    return np.concatenate(nodes), np.concatenate(weights), panels


def _copy_nodes(
    base: Array, panels: list[slice], delay: float, window: float
) -> list[tuple[Indices, int]]:
    """Return the nodes of each tooth in the workpiece: indices, and periods since it entered."""
    copies = list[tuple["Indices", int]]()
    for panel in panels:
        middle = 0.5 * (base[panel][0] + base[panel][-1])
        teeth = int(np.floor((window - middle) / delay)) + 1
        for turns in range(teeth):
            copies.append((np.arange(panel.start, panel.stop), turns))
    return copies


def _causal(base: Array, weights: Array, panels: list[slice], poles: Complex) -> Array:
    """Return ∫ g(s_i - s') ℓ_j(s') ds' over s' < s_i (m, s, s) for the impulse responses g."""
    out = np.zeros((len(poles), len(base), len(base)))
    for panel in panels:
        count = panel.stop - panel.start
        x, _, inner, inner_weights = _panel(count)
        length = weights[panel].sum()
        since = length * x[:, None] * (1.0 - inner)  # (i, q)
        partial = length * x[:, None] * inner_weights
        within = _impulse(since, poles) * partial
        out[:, panel, panel] = np.einsum("miq,iqj->mij", within, _partial(count))
        later = slice(panel.stop, len(base))
        passed = base[later][:, None] - base[panel]
        out[:, later, panel] = _impulse(passed, poles) * weights[panel]
    return out


def _impulse(time: Array, poles: Complex) -> Array:
    """Return the impulse responses (m, …) of modes of unit mass."""
    at: Complex = np.multiply.outer(poles, time)
    rate = poles.imag.reshape(-1, *[1] * np.ndim(time))
    return np.exp(at.real) * np.sin(at.imag) / rate


def _angles(poles: Complex, delay: float) -> Array:
    """Return angles of μ from 0 to π: evenly spread, and dense at each mode's own multiplier."""
    turned = np.mod(poles.imag * delay, 2.0 * np.pi)
    centre = np.where(turned > np.pi, 2.0 * np.pi - turned, turned)
    width = np.minimum(-poles.real * delay, 0.5)
    sharp = (centre[:, None] + width[:, None] * _SHARP).ravel()
    sharp = np.abs(sharp)  # a resonance reaches across the real axis
    sharp = np.where(sharp > np.pi, 2.0 * np.pi - sharp, sharp)
    spread = np.linspace(0.0, np.pi, _BROAD)
    return np.unique(np.concatenate([spread, sharp.clip(0.0, np.pi)]))


def is_stable(
    response: ToolResponse, cut: Engagement, speed: float, depth: float
) -> bool:
    """Return whether a cut is stable at one pose, speed (rev/s) and depth (m)."""
    around = circle(response, cut, speed)
    for _ in range(_ROUNDS):
        around = around.refined(depth)
    return not around.unstable(np.array(depth))


def interrupted_depth(
    response: ToolResponse, cut: Engagement, speeds: Array, scale: Array
) -> Array:
    """Return the stable depths of cut (n, s), m, with all harmonics; infinite if beyond the search.

    Depths above the limit may be stable again; they are not offered.

    Parameters
    ----------
    response
        Response of the tool at n poses.
    cut
        Engagement of the cutter.
    speeds
        Spindle speeds (s,), rev/s.
    scale
        Depth (n,), m, of which 0.02 to 60 times are searched: the zero-order limit.
    """
    out = np.full((len(response), len(speeds)), np.inf)
    shares = np.geomspace(_LOW, _HIGH, _TRIALS)
    for k in range(len(response)):
        if not np.isfinite(scale[k]):
            continue
        trials = scale[k] * shares
        for j, speed in enumerate(speeds):
            around = circle(response[k : k + 1], cut, float(speed))
            out[k, j] = _find_depth(around, trials)
    return out


def _find_depth(around: Circle, trials: Array) -> float:
    """Return the least unstable depth, m, on points that are refined there."""
    depth = _first_unstable(around, trials)
    for _ in range(_ROUNDS):
        before = depth
        finer = around.refined(depth if np.isfinite(depth) else float(trials[-1]))
        if finer is around:
            break
        around = finer
        depth = _first_unstable(around, trials)
        if abs(depth - before) <= _SAME * before:
            break
    return depth


def _first_unstable(around: Circle, trials: Array) -> float:
    """Return the least unstable depth, m, from trials, refined; infinite if all are stable."""
    bad = np.flatnonzero(around.unstable(trials) > 0)
    if not bad.size:
        return np.inf
    high = trials[bad[0]]
    low = trials[bad[0] - 1] if bad[0] else 0.0
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        if around.unstable(np.array(middle)) > 0:
            high = middle
        else:
            low = middle
    return float(0.5 * (low + high))
