"""Stability of a cut whose coefficients are their mean: the zero-order solution.

With the mean A of Σ c nᵀ over the tooth period τ, the tool vibrates at ω on the limit where an
eigenvalue λ of G(iω) A satisfies ``b (1 - exp(-iωτ)) λ = 1``. Hence ``b = 1 / (2 Re λ)`` and
``ωτ = 2 arg λ + (2k + 1) π``. Constant coefficients (turning, a slot by four teeth or more) are
exact.

References
----------
Y. Altintas, E. Budak, Analytical prediction of stability lobes in milling, CIRP Annals 44, 1995.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from itertools import permutations
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from stiffscope.lobes.engagement import Engagement
    from stiffscope.lobes.response import ToolResponse
    from stiffscope.runtime.types import Array, Complex

_BROAD = 60  # frequencies spread over the range of all modes
_SHARP = np.sinh(
    np.linspace(-4.5, 4.5, 37)
)  # half widths of a resonance, to 45 of them
_ZOOMS = 9  # each takes a quarter of the interval
_SPLITS = 8  # of an interval of frequencies, at a time
_SETTLE = 6  # secant steps of a crossing
_STEP = 1e-6  # relative step of a derivative by frequency
_CHUNK = 128  # poses at a time


@dataclass(frozen=True, eq=False)
class Critical:
    """Limits at n poses that hold at any speed of a range.

    Attributes
    ----------
    depth
        Depth of cut (n,), m, below which no speed chatters; infinite without a limit.
    omega
        Frequency (n,) of chatter there, rad/s.
    shares
        Share (n, m) of each mode in Re λ there; negative for modes that act against it.
    slope
        ``d ln depth = -Re g + slope · Im g`` (n,) for a change of the response with g = d ln λ, at
        the speed of the limit.
    coupling
        Depth (n,), m, from which the modes alone are unstable, without a wave left by the tooth
        before; infinite without such.
    """

    depth: Array
    omega: Array
    shares: Array
    slope: Array
    coupling: Array

    def relative_change(self, change: Complex) -> Array:
        """Return d ln depth (n, …) for changes g = d ln λ (n, …)."""
        slope = self.slope.reshape(-1, *[1] * (np.ndim(change) - 1))
        return slope * change.imag - change.real


def frequency_grid(response: ToolResponse) -> Array:
    """Return frequencies (n, f), rad/s, ascending: dense at each resonance."""
    rates = response.rates
    known = np.abs(response.shapes).max(axis=1) > 0.0
    low = np.where(known, rates, np.inf).min(axis=1)
    high = np.where(known, rates, 0.0).max(axis=1)
    share = np.linspace(0.0, 1.0, _BROAD)
    broad = 0.1 * low[:, None] * (20.0 * high / low)[:, None] ** share
    widths = np.minimum(response.damping[..., None] * _SHARP, 3.0)
    sharp = rates[..., None] * np.where(widths > -0.9, 1.0 + widths, np.exp(widths))
    sharp = np.where(known[..., None], sharp, broad[:, None, :1])
    return np.sort(np.concatenate([broad, sharp.reshape(len(rates), -1)], axis=1))


def eigenvalues(response: ToolResponse, cut: Engagement, omega: Array) -> Complex:
    """Return λ (n, f, d), m²/N·Pa = m, of G(iω) A at ω (n, f), rad/s; not ordered."""
    by_mode, still = response.looped(cut)
    n, m, d, _ = by_mode.shape
    flat = by_mode.reshape(n, m, d * d)
    looped = response.modal(omega) @ flat + still.reshape(n, 1, d * d)
    matrix = looped.reshape(n, -1, d, d)
    if d == 2:
        half = 0.5 * (matrix[..., 0, 0] + matrix[..., 1, 1])
        apart = 0.5 * (matrix[..., 0, 0] - matrix[..., 1, 1])
        root = np.sqrt(apart**2 + matrix[..., 0, 1] * matrix[..., 1, 0])
        return np.stack([half + root, half - root], axis=-1)
    return np.linalg.eigvals(matrix).astype(complex)


def follow(values: Complex) -> Complex:
    """Return eigenvalues (n, f, d) ordered so that each varies continuously along f."""
    n, f, d = values.shape
    orders = [list(order) for order in permutations(range(d))]
    out = values.copy()
    if d == 2:  # swaps accumulate
        steps = np.abs(np.diff(out, axis=1)).sum(axis=2)
        crossed = np.abs(out[:, 1:, ::-1] - out[:, :-1]).sum(axis=2)
        turns = np.cumsum(crossed < steps, axis=1) % 2 == 1
        out[:, 1:][turns] = out[:, 1:][turns][:, ::-1]
        return out
    for k in range(1, f):
        ways = np.stack([out[:, k][:, order] for order in orders], axis=1)
        best = np.abs(ways - out[:, None, k - 1]).sum(axis=2).argmin(axis=1)
        out[:, k] = ways[np.arange(n), best]
    return out


def find_critical(
    response: ToolResponse,
    cut: Engagement,
    speeds: tuple[float, float] = (0.0, np.inf),
) -> Critical:
    """Return the depth of cut that is stable at any speed of a range, at each pose.

    Parameters
    ----------
    response
        Response of the tool at n poses.
    cut
        Engagement of the cutter.
    speeds
        Slowest and fastest speed, rev/s; by default all.
    """
    parts = [
        _find_critical(response[start : start + _CHUNK], cut, speeds)
        for start in range(0, len(response), _CHUNK)
    ]
    return join_criticals(parts)


def join_criticals(parts: list[Critical]) -> Critical:
    """Return the limits of several stacks of poses as one."""
    if len(parts) == 1:
        return parts[0]
    names = [field.name for field in fields(Critical)]
    return Critical(
        *(np.concatenate([getattr(part, name) for part in parts]) for name in names)
    )


def _find_critical(
    response: ToolResponse, cut: Engagement, speeds: tuple[float, float]
) -> Critical:
    n = len(response)
    grid = frequency_grid(response)
    values = eigenvalues(response, cut, grid)
    real = _within(values, grid, cut, speeds)
    coupling = _find_coupling(follow(values))
    poses = np.arange(n)
    best = real.argmax(axis=1)
    low = grid[poses, np.maximum(best - 1, 0)]
    high = grid[poses, np.minimum(best + 1, grid.shape[1] - 1)]
    share = np.linspace(0.0, 1.0, _SPLITS + 1)
    inner = grid
    for _ in range(_ZOOMS):
        inner = low[:, None] + (high - low)[:, None] * share
        real = _within(eigenvalues(response, cut, inner), inner, cut, speeds)
        best = real.argmax(axis=1)
        low = inner[poses, np.maximum(best - 1, 0)]
        high = inner[poses, np.minimum(best + 1, _SPLITS)]
    omega = inner[poses, best]
    most = real[poses, best]
    depth = np.where(most > 0.0, 0.5 / np.where(most > 0.0, most, 1.0), np.inf)
    # at the ends of the range a lobe may be narrower than any grid of frequencies
    ends = np.array([speed for speed in speeds if 0.0 < speed < np.inf])
    if ends.size:
        others, rates = _find_lobes(response, cut, ends, grid)
        least = others.argmin(axis=1)
        beyond = others[poses, least] < depth
        depth = np.where(beyond, others[poses, least], depth)
        omega = np.where(beyond, rates[poses, least], omega)
    shares = _mode_shares(response, cut, omega)
    slope = _find_slope(response, cut, omega, speeds)
    return Critical(depth, omega, shares, slope, coupling)


def _find_slope(
    response: ToolResponse, cut: Engagement, omega: Array, speeds: tuple[float, float]
) -> Array:
    """Return the ratio (n,) of real and imaginary part of d ln((1 - exp(-iωτ)) λ) / dω.

    With it, ω follows a change of the response at a speed that stays.
    """
    step = _STEP * omega
    beside = np.stack([omega - step, omega, omega + step], axis=1)
    values = follow(eigenvalues(response, cut, beside))
    best = values[:, 1].real.argmax(axis=1)
    value = values[np.arange(len(omega)), :, best]
    logarithm = np.log(value[:, 2] / value[:, 0]) / (2.0 * step)
    turn = 2.0 * np.angle(value[:, 1]) + np.pi
    fast = cut.teeth * speeds[1]
    lobe = np.ceil((omega / fast - turn) / (2.0 * np.pi)).clip(min=0.0)
    delay = (turn + 2.0 * np.pi * lobe) / omega
    wave = np.exp(-1j * turn)
    rate = logarithm + 1j * delay * wave / (1.0 - wave)
    return rate.real / np.where(rate.imag != 0.0, rate.imag, 1.0)


def _within(
    values: Complex, omega: Array, cut: Engagement, speeds: tuple[float, float]
) -> Array:
    """Return the largest Re λ (n, f) of which a lobe lies in the range of speeds, else 0."""
    slow, fast = speeds
    turn = 2.0 * np.angle(values) + np.pi
    first = 0.0
    if np.isfinite(fast):
        soonest = omega / (cut.teeth * fast)
        first = np.ceil((soonest[..., None] - turn) / (2.0 * np.pi)).clip(min=0.0)
    within = np.full(values.shape, True)
    if slow > 0.0:
        latest = omega / (cut.teeth * slow)
        within = np.floor((latest[..., None] - turn) / (2.0 * np.pi)) >= first
    return np.where(within, values.real, 0.0).max(axis=2)


def _find_coupling(values: Complex) -> Array:
    """Return the least 1/λ (n,) where a branch λ (n, f, d) crosses the positive real axis."""
    before = values[:, :-1]
    after = values[:, 1:]
    crossing = before.imag * after.imag < 0.0
    step = np.where(crossing, before.imag - after.imag, 1.0)
    at = before.real + (after.real - before.real) * before.imag / step
    most = np.where(crossing, at, 0.0).max(axis=(1, 2))
    return np.where(most > 0.0, 1.0 / np.where(most > 0.0, most, 1.0), np.inf)


def mode_terms(response: ToolResponse, cut: Engagement, omega: Array) -> Complex:
    """Return the terms (n, m) of the largest Re λ at ω (n,) by mode, complex; they add up to λ.

    Because λ is stationary in its eigenvectors, dλ is the sum of the terms' own changes.
    """
    by_mode, still = response.looped(cut)
    modal = response.modal(omega[:, None])[:, 0]
    matrix = np.einsum("nm,nmij->nij", modal, by_mode) + still
    values: Complex
    values, right = np.linalg.eig(matrix)
    best = values.real.argmax(axis=1)
    poses = np.arange(len(values))
    left = np.linalg.pinv(right)[poses, best]
    vector = right[poses, :, best]
    return modal * np.einsum("ni,nmij,nj->nm", left, by_mode, vector)


def mode_total(response: ToolResponse, cut: Engagement, omega: Array) -> Complex:
    """Return the λ (n,) with the largest real part at ω (n,), rad/s."""
    values = eigenvalues(response, cut, omega[:, None])[:, 0]
    best = values.real.argmax(axis=1)
    return values[np.arange(len(values)), best]


def _mode_shares(response: ToolResponse, cut: Engagement, omega: Array) -> Array:
    terms = mode_terms(response, cut, omega).real
    total = np.abs(terms).sum(axis=1, keepdims=True)
    return terms / np.where(total > 0.0, total, 1.0)


def zero_order_depth(
    response: ToolResponse, cut: Engagement, speeds: Array, grid: Array | None = None
) -> Array:
    """Return the stable depths of cut (n, s), m, at spindle speeds; infinite without a limit.

    Parameters
    ----------
    response
        Response of the tool at n poses.
    cut
        Engagement of the cutter.
    speeds
        Spindle speeds (s,), rev/s.
    grid
        Frequencies (n, f), rad/s, by default `frequency_grid`.
    """
    omega = frequency_grid(response) if grid is None else grid
    return _find_lobes(response, cut, speeds, omega)[0]


def _find_lobes(
    response: ToolResponse, cut: Engagement, speeds: Array, grid: Array
) -> tuple[Array, Array]:
    """Return stable depths (n, s), m, and the frequencies (n, s) of chatter there, rad/s."""
    delays = 1.0 / (cut.teeth * np.asarray(speeds, dtype=float))
    depth = np.empty((len(response), len(delays)))
    omega = np.empty(depth.shape)
    for start in range(0, len(response), _CHUNK):
        some = slice(start, start + _CHUNK)
        values = follow(eigenvalues(response[some], cut, grid[some]))
        for k, branches in enumerate(values, start):
            one = response[k : k + 1]
            depth[k], omega[k] = _cross_lobes(one, cut, grid[k], branches, delays)
    return depth, omega


def _cross_lobes(
    response: ToolResponse,
    cut: Engagement,
    omega: Array,
    values: Complex,
    delays: Array,
) -> tuple[Array, Array]:
    """Return the least depth (s,) at which a branch λ (f, d) meets a lobe, by delay τ (s,), s.

    And the frequency (s,), rad/s, of chatter there.
    """
    real = values.real.T  # (d, f)
    size = np.abs(values).T
    alive = (real[:, :-1] > 0.0) | (real[:, 1:] > 0.0)
    alive &= (size[:, :-1] > 0.0) & (size[:, 1:] > 0.0)
    turn = 2.0 * np.angle(values.T) + np.pi
    # within an interval the argument is continuous, also beyond half a turn
    swing = 2.0 * np.angle(values.T[:, 1:] * values.T[:, :-1].conj())
    start = (omega[:-1] * delays[:, None])[:, None] - turn[:, :-1]  # (s, d, f - 1)
    rise = (np.diff(omega) * delays[:, None])[:, None] - swing
    lobe = np.floor(start / (2.0 * np.pi))
    next_lobe = np.floor((start + rise) / (2.0 * np.pi))
    crossed = alive & (lobe != next_lobe)
    level = 2.0 * np.pi * np.maximum(lobe, next_lobe)
    share = (level - start) / np.where(crossed, rise, 1.0)
    between = real[:, :-1] + share * (real[:, 1:] - real[:, :-1])
    height = np.where(crossed, between, 0.0).reshape(len(delays), -1)
    best = height.argmax(axis=1)
    speeds = np.arange(len(delays))
    found = height[speeds, best] > 0.0
    branch, place = np.unravel_index(best, alive.shape)
    t = share.reshape(len(delays), -1)[speeds, best]
    goal = level.reshape(len(delays), -1)[speeds, best]
    low = omega[place]
    high = omega[place + 1]
    near = values[place, branch] + t * (
        values[place + 1, branch] - values[place, branch]
    )
    below = start[speeds, branch, place] - goal
    ends: list[Array] = [below, below + rise[speeds, branch, place]]
    exact, settled = _settle(response, cut, delays, goal, (low, high), ends, near)
    most = np.where(found, exact, 1.0)
    return np.where(found, 0.5 / most, np.inf), settled


def _settle(
    response: ToolResponse,
    cut: Engagement,
    delays: Array,
    goal: Array,
    between: tuple[Array, Array],
    misses: list[Array],
    near: Complex,
) -> tuple[Array, Array]:
    """Return Re λ and ω (s,) where ωτ - 2 arg λ - π reaches its goal, by regula falsi."""
    low, high = between
    below, above = misses
    value = near
    omega = low
    for _ in range(_SETTLE):
        apart = np.where(above != below, above - below, 1.0)
        omega = low - below * (high - low) / apart
        both = eigenvalues(response, cut, omega[None])[0]
        which = np.abs(both - value[:, None]).argmin(axis=1)
        value = both[np.arange(len(both)), which]
        miss = omega * delays - 2.0 * np.angle(value) - np.pi - goal
        miss -= 4.0 * np.pi * np.round(miss / (4.0 * np.pi))  # of the argument's branch
        same = np.sign(miss) == np.sign(below)
        low, high = np.where(same, omega, low), np.where(same, high, omega)
        above = np.where(same, 0.5 * above, miss)
        below = np.where(same, miss, 0.5 * below)
    return np.maximum(value.real, 1e-300), omega
