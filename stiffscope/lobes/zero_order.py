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

from itertools import permutations
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.lobes.limits import Limits, join_limits

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stiffscope.lobes.engagement import Engagement
    from stiffscope.lobes.response import ToolResponse
    from stiffscope.runtime.types import Array, Complex

_BROAD = 60  # frequencies spread over the range of all modes
_SHARP = np.sinh(
    np.linspace(-4.5, 4.5, 37)
)  # half widths of a resonance, to 45 of them
_ZOOMS = 9  # each takes a quarter of the interval
_SPLITS = 8  # of an interval of frequencies, at a time
_SETTLE = 14  # secant steps of a crossing
_STEP = 1e-6  # relative step of a derivative by frequency
_CHUNK = 128  # poses at a time


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


def depth_scale(response: ToolResponse, cut: Engagement) -> Array:
    """Return 1 / (2 max |λ|) (n,), m: no depth of the mean coefficients below it chatters."""
    values = eigenvalues(response, cut, frequency_grid(response))
    most = np.abs(values).max(axis=(1, 2))
    return np.where(most > 0.0, 0.5 / np.where(most > 0.0, most, 1.0), np.inf)


def find_critical(
    response: ToolResponse,
    cut: Engagement,
    speeds: tuple[float, float] = (0.0, np.inf),
) -> Limits:
    """Return the limits at the worst speed of a range, at each pose.

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
    return join_limits(parts)


def _find_critical(
    response: ToolResponse, cut: Engagement, speeds: tuple[float, float]
) -> Limits:
    n = len(response)
    grid = frequency_grid(response)
    values = eigenvalues(response, cut, grid)
    real = _within(values, grid, cut, speeds)
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
        delays = np.broadcast_to(1.0 / (cut.teeth * ends), (n, len(ends)))
        others, rates = _find_lobes(response, cut, delays, grid)
        least = others.argmin(axis=1)
        beyond = others[poses, least] < depth
        depth = np.where(beyond, others[poses, least], depth)
        omega = np.where(beyond, rates[poses, least], omega)
    value = mode_total(response, cut, omega[:, None])[:, 0]
    turn = 2.0 * np.angle(value) + np.pi
    soonest = omega / (cut.teeth * speeds[1])
    lobe = np.ceil((soonest - turn) / (2.0 * np.pi)).clip(min=0.0)
    delay = (turn + 2.0 * np.pi * lobe) / omega
    described = _describe(response, cut, depth[:, None], omega[:, None], delay[:, None])
    return described.reshape(n)


def _describe(
    response: ToolResponse, cut: Engagement, depth: Array, omega: Array, delay: Array
) -> Limits:
    """Return limits (n, s) at frequencies ω and tooth periods, with the changes modes make.

    λ is stationary in its eigenvectors, so that it changes by the terms of the modes alone:
    ``∂ln H / ∂ln ω_k = -2 ω_k (ω_k + iζω) H`` and ``∂ln H / ∂ln ζ_k = -2iζ ω_k ω H``.
    """
    terms = mode_terms(response, cut, omega)
    modal = response.modal(omega)
    share = terms / mode_total(response, cut, omega)[..., None]
    rates = response.rates[:, None]
    damping = response.damping[:, None]
    at = omega[..., None]
    total = np.abs(terms.real).sum(axis=-1, keepdims=True)
    wave = np.exp(-1j * omega * delay)
    apart = 1.0 - wave
    # d ln(1 - exp(-iωτ)) by ln(1/τ)
    by_speed = -1j * omega * delay * wave / np.where(apart != 0.0, apart, 1.0)
    return Limits(
        depth=depth,
        speed=1.0 / (cut.teeth * delay),
        omega=omega,
        shares=terms.real / np.where(total > 0.0, total, 1.0),
        slope=_find_slope(response, cut, omega, delay),
        by_rate=-2.0 * rates * (rates + 1j * damping * at) * modal * share,
        by_damping=-2j * damping * rates * at * modal * share,
        by_speed=by_speed,
    )


def _find_slope(
    response: ToolResponse, cut: Engagement, omega: Array, delay: Array
) -> Array:
    """Return the ratio (n, s) of real and imaginary part of d ln((1 - exp(-iωτ)) λ) / dω.

    With it, ω follows a change of the response at a speed that stays.
    """
    step = _STEP * omega
    below = mode_total(response, cut, omega - step)
    above = mode_total(response, cut, omega + step)
    logarithm = np.log(above / below) / (2.0 * step)
    wave = np.exp(-1j * omega * delay)
    apart = 1.0 - wave
    rate = logarithm + 1j * delay * wave / np.where(apart != 0.0, apart, 1.0)
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


def find_coupling(response: ToolResponse, cut: Engagement) -> Array:
    """Return the depth (n,), m, from which the modes alone are unstable; infinite without such.

    Mode coupling: no wave is left by the tooth before, so that ``b λ = 1`` at the limit.
    """
    values = follow(eigenvalues(response, cut, frequency_grid(response)))
    before = values[:, :-1]
    after = values[:, 1:]
    crossing = before.imag * after.imag < 0.0
    step = np.where(crossing, before.imag - after.imag, 1.0)
    at = before.real + (after.real - before.real) * before.imag / step
    most = np.where(crossing, at, 0.0).max(axis=(1, 2))
    return np.where(most > 0.0, 1.0 / np.where(most > 0.0, most, 1.0), np.inf)


def mode_terms(response: ToolResponse, cut: Engagement, omega: Array) -> Complex:
    """Return the terms (n, s, m) of the largest Re λ at ω (n, s) by mode, complex.

    With that of the static remainder they add up to λ.
    """
    by_mode, still = response.looped(cut)
    modal = response.modal(omega)
    matrix = np.einsum("nsm,nmij->nsij", modal, by_mode) + still[:, None]
    values: Complex
    values, right = np.linalg.eig(matrix)
    best = values.real.argmax(axis=-1)[..., None]
    left = np.take_along_axis(np.linalg.pinv(right), best[..., None], axis=-2)[
        ..., 0, :
    ]
    vector = np.take_along_axis(right, best[..., None, :], axis=-1)[..., 0]
    seen = np.einsum("nsi,nmij->nsmj", left, by_mode)
    return modal * np.einsum("nsmj,nsj->nsm", seen, vector)


def mode_total(response: ToolResponse, cut: Engagement, omega: Array) -> Complex:
    """Return the λ (n, s) with the largest real part at ω (n, s), rad/s."""
    values = eigenvalues(response, cut, omega)
    best = values.real.argmax(axis=-1)[..., None]
    return np.take_along_axis(values, best, axis=-1)[..., 0]


def zero_order_limits(response: ToolResponse, cut: Engagement, speeds: Array) -> Limits:
    """Return the limits (n, s) at spindle speeds; infinite depths without a limit.

    Parameters
    ----------
    response
        Response of the tool at n poses.
    cut
        Engagement of the cutter.
    speeds
        Spindle speeds (s,), the same at each pose, or (n, s), rev/s.
    """
    n = len(response)
    delays = 1.0 / (cut.teeth * np.asarray(speeds, dtype=float))
    delays = np.broadcast_to(delays, (n, delays.shape[-1]))
    parts = list[Limits]()
    for start in range(0, n, _CHUNK):
        some = slice(start, start + _CHUNK)
        grid = frequency_grid(response[some])
        depth, omega = _find_lobes(response[some], cut, delays[some], grid)
        parts.append(_describe(response[some], cut, depth, omega, delays[some]))
    return join_limits(parts)


def _find_lobes(
    response: ToolResponse, cut: Engagement, delays: Array, grid: Array
) -> tuple[Array, Array]:
    """Return stable depths (n, s), m, and the frequencies (n, s) of chatter there, rad/s.

    At tooth periods τ (n, s), s, and on frequencies (n, f), rad/s.
    """
    depth = np.empty(delays.shape)
    omega = np.empty(delays.shape)
    values = follow(eigenvalues(response, cut, grid))
    for k, branches in enumerate(values):
        one = response[k : k + 1]
        depth[k], omega[k] = _cross_lobes(one, cut, grid[k], branches, delays[k])
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
    branch, place = np.nonzero(alive)
    before = values[place, branch]
    after = values[place + 1, branch]
    turn = 2.0 * np.angle(before) + np.pi
    # within an interval the argument is continuous, also beyond half a turn
    swing = 2.0 * np.angle(after * before.conj())
    start = np.multiply.outer(delays, omega[place]) - turn  # (s, intervals)
    rise = np.multiply.outer(delays, omega[place + 1] - omega[place]) - swing
    lobe = np.floor(start / (2.0 * np.pi))
    next_lobe = np.floor((start + rise) / (2.0 * np.pi))
    speed, where = np.nonzero(lobe != next_lobe)
    level = 2.0 * np.pi * np.maximum(lobe, next_lobe)[speed, where]
    below = start[speed, where] - level
    over = rise[speed, where]
    share = -below / over
    height = before[where].real + share * (after - before)[where].real
    # the highest crossing at each speed: first by height, then by speed
    order = np.lexsort((height, speed))
    last = np.append(np.diff(speed[order]) > 0, True)
    chosen = order[last[: len(order)]]
    chosen = chosen[height[chosen] > 0.0]
    depth = np.full(len(delays), np.inf)
    frequency = np.full(len(delays), omega[-1])
    at = speed[chosen]
    on = place[where[chosen]]
    near = before[where[chosen]] + share[chosen] * (after - before)[where[chosen]]
    ends = [below[chosen], below[chosen] + over[chosen]]
    between = omega[on], omega[on + 1]
    exact, settled = _settle(
        response, cut, delays[at], level[chosen], between, ends, near
    )
    depth[at] = 0.5 / exact
    frequency[at] = settled
    return depth, frequency


def _settle(
    response: ToolResponse,
    cut: Engagement,
    delays: Array,
    goal: Array,
    between: tuple[Array, Array],
    misses: Sequence[Array],
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
