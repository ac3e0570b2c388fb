"""Limits of a cut by either method: at given speeds, over a range, and at its worst speed."""

from __future__ import annotations

from dataclasses import fields
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from stiffscope.lobes.floquet import interrupted_depths, interrupted_limits
from stiffscope.lobes.limits import Limits
from stiffscope.lobes.zero_order import depth_scale, find_critical, zero_order_limits
from stiffscope.runtime.threads import in_one_thread

if TYPE_CHECKING:
    from stiffscope.lobes.engagement import Engagement
    from stiffscope.lobes.response import ToolResponse
    from stiffscope.runtime.types import Array, Flags, Indices

Method = Literal["zero-order", "all-harmonics"]

_A_LOBE = 6  # speeds for each lobe of the fastest mode, in the search for the worst
_RESONANCE = 1.5  # damping ratios between two speeds, at most
_MOST = 240
# between the speeds of the range that are tried first, and later
_STRIDES = (32, 8, 2, 1)
_ZOOMS = 2
_SPLITS = 4  # speeds in each
_GUIDES = 8  # poses between those of a sweep whose limits are searched without guesses
_STRIDE = 32  # speeds between those of a sweep that are always solved
_SMOOTH = 3e-3  # misfit of ln(depth) from a cubic; cubics on both halves are far closer
_TURN = 0.01  # the same of ln(depth) by its slope at the middle, over the interval
_STRAIGHT = 1e-2  # relative misfit of the frequency of chatter from a line
_FARTHEST = 1.0  # change of ln(depth) from a neighbouring speed in a guess
_SAME_LOBE = 0.1  # relative change of the frequency of chatter


@in_one_thread
def limits_at(
    response: ToolResponse, cut: Engagement, speeds: Array, method: Method
) -> Limits:
    """Return the limits (n, s) of n poses at spindle speeds.

    Parameters
    ----------
    response, cut
        Response of the tool, and engagement.
    speeds
        Spindle speeds (s,), the same at each pose, or (n, s), rev/s.
    method
        Zero order, or all harmonics for interrupted cuts.
    """
    if method == "zero-order":
        return zero_order_limits(response, cut, speeds)
    n = len(response)
    speeds = np.broadcast_to(speeds, (n, np.shape(speeds)[-1]))
    pose = np.repeat(np.arange(n), speeds.shape[1])
    scale = depth_scale(response, cut)
    found = interrupted_limits(response[pose], cut, speeds.ravel(), scale[pose])
    return found.reshape(*speeds.shape)


@in_one_thread
def sweep_limits(
    response: ToolResponse, cut: Engagement, speeds: Array, method: Method
) -> Limits:
    """Return the limits (n, s) of n poses at ascending spindle speeds (s,), rev/s.

    With all harmonics speeds are interpolated where the limit varies smoothly: intervals are
    halved until their middle lies on the cubic that depths and slopes at both ends give.
    """
    count = len(speeds)
    if method == "zero-order" or count <= 2 * _STRIDE:
        return limits_at(response, cut, speeds, method)
    scale = depth_scale(response, cut)
    knots = np.unique(np.append(np.arange(0, count, _STRIDE), count - 1))
    whole = _Sweep(response, cut, speeds, scale)
    whole.solve_knots(knots)
    pose = np.repeat(np.arange(len(response)), len(knots) - 1)
    low = np.tile(knots[:-1], len(response))
    high = np.tile(knots[1:], len(response))
    while len(pose):
        wide = high - low > 1
        pose, low, high = pose[wide], low[wide], high[wide]
        middle = (low + high) // 2
        whole.solve(pose, middle, whole.guess_between(pose, middle, low, high))
        smooth = whole.is_smooth(pose, low, middle, high)
        whole.interpolate(pose[smooth], low[smooth], middle[smooth])
        whole.interpolate(pose[smooth], middle[smooth], high[smooth])
        pose = np.tile(pose[~smooth], 2)
        low = np.concatenate([low[~smooth], middle[~smooth]])
        high = np.concatenate([middle[~smooth], high[~smooth]])
    return whole.limits


class _Sweep:
    """Limits (n, s) that are filled speed by speed."""

    limits: Limits

    def __init__(
        self, response: ToolResponse, cut: Engagement, speeds: Array, scale: Array
    ) -> None:
        self.response = response
        self.cut = cut
        self.speeds = speeds
        self.scale = scale
        n, m = response.squares.shape
        one = np.zeros((n, len(speeds)))
        each = np.zeros((n, len(speeds), m))
        self.limits = Limits(
            depth=one.copy(),
            speed=one + speeds,
            omega=one.copy(),
            shares=each.copy(),
            slope=one.copy(),
            by_rate=each.astype(complex),
            by_damping=each.astype(complex),
            by_speed=one.astype(complex),
        )

    def solve_knots(self, knots: Indices) -> None:
        """Compute the limits of all poses at some places: of some poses first, which guide others."""
        known = np.unique(
            np.append(np.arange(0, len(self.response), _GUIDES), len(self.response) - 1)
        )
        self.solve(np.repeat(known, len(knots)), np.tile(knots, len(known)))
        while len(known) < len(self.response):
            gaps = np.flatnonzero(np.diff(known) > 1)
            low, high = known[gaps], known[gaps + 1]
            middle = (low + high) // 2
            place = np.tile(knots, len(middle))
            ends = np.repeat(low, len(knots)), np.repeat(high, len(knots))
            near = self._guess_beside(place, *ends)
            self.solve(np.repeat(middle, len(knots)), place, near)
            known = np.sort(np.concatenate([known, middle]))

    def solve(
        self, pose: Indices, place: Indices, near: tuple[Array, Array] | None = None
    ) -> None:
        """Compute the limits of some pairs of pose and speed, which may lie near guesses."""
        if not len(pose):
            return
        some = interrupted_limits(
            self.response[pose], self.cut, self.speeds[place], self.scale[pose], near
        )
        for field in fields(Limits):
            getattr(self.limits, field.name)[pose, place] = getattr(some, field.name)

    def _guess_beside(
        self, place: Indices, low: Indices, high: Indices
    ) -> tuple[Array, Array]:
        """Return depths and frequencies (n, 2) of two poses at a place, or those between them."""
        depth = np.stack([self.limits.depth[end, place] for end in (low, high)], axis=1)
        omega = np.stack([self.limits.omega[end, place] for end in (low, high)], axis=1)
        alike = np.abs(omega[:, 1] / omega[:, 0] - 1.0) < _SAME_LOBE
        depth[alike] = np.sqrt(depth.prod(axis=1, keepdims=True))[alike]
        omega[alike] = omega.mean(axis=1, keepdims=True)[alike]
        return depth, omega

    def guess_between(
        self, pose: Indices, place: Indices, low: Indices, high: Indices
    ) -> tuple[Array, Array]:
        """Return depths and frequencies (n, 2) of a pose that follow from two other places."""
        depth = list[np.ndarray]()
        omega = list[np.ndarray]()
        for end in (low, high):
            way = np.log(self.speeds[place] / self.speeds[end])
            change = (self._rise(pose, end) * way).clip(-_FARTHEST, _FARTHEST)
            depth.append(self.limits.depth[pose, end] * np.exp(change))
            omega.append(self.limits.omega[pose, end])
        alike = np.abs(omega[1] / omega[0] - 1.0) < _SAME_LOBE
        span = self.speeds[high] - self.speeds[low]
        share = (self.speeds[place] - self.speeds[low]) / span
        between = omega[0] + share * (omega[1] - omega[0])
        omega = [np.where(alike, between, each) for each in omega]
        return np.stack(depth, axis=1), np.stack(omega, axis=1)

    def _rise(self, pose: Indices, place: Indices) -> Array:
        """Return d ln depth / d ln speed (n,)."""
        slope = self.limits.slope[pose, place]
        change = self.limits.by_speed[pose, place]
        return slope * change.imag - change.real

    def _between(
        self, pose: Indices, place: Indices, low: Indices, high: Indices
    ) -> Array:
        """Return ln(depth) (n,) of the cubic by depths and slopes at both ends."""
        width = np.log(self.speeds[high] / self.speeds[low])
        share = np.log(self.speeds[place] / self.speeds[low]) / width
        rest = 1.0 - share
        begin = np.log(self.limits.depth[pose, low])
        end = np.log(self.limits.depth[pose, high])
        inner = share * rest**2 * self._rise(pose, low)
        inner -= share**2 * rest * self._rise(pose, high)
        with np.errstate(invalid="ignore"):
            ends = begin * rest**2 * (1.0 + 2.0 * share)
            ends = ends + end * share**2 * (1.0 + 2.0 * rest)
        return ends + inner * width

    def _slope_between(
        self, pose: Indices, place: Indices, low: Indices, high: Indices
    ) -> Array:
        """Return the change (n,) of ln(depth) over the interval by the cubic's slope at a place."""
        width = np.log(self.speeds[high] / self.speeds[low])
        share = np.log(self.speeds[place] / self.speeds[low]) / width
        with np.errstate(invalid="ignore"):
            step = np.log(self.limits.depth[pose, high] / self.limits.depth[pose, low])
        begin = self._rise(pose, low) * (1.0 - share) * (1.0 - 3.0 * share)
        end = self._rise(pose, high) * share * (3.0 * share - 2.0)
        return 6.0 * share * (1.0 - share) * step + width * (begin + end)

    def is_smooth(
        self, pose: Indices, low: Indices, middle: Indices, high: Indices
    ) -> Flags:
        """Return whether the middle and its slope lie on the cubic between both ends."""
        at = self.speeds
        share = (at[middle] - at[low]) / (at[high] - at[low])
        depth = self.limits.depth
        with np.errstate(invalid="ignore", divide="ignore"):
            apart = np.log(depth[pose, middle]) - self._between(pose, middle, low, high)
            turn = self._rise(pose, middle) * np.log(at[high] / at[low])
            turn = turn - self._slope_between(pose, middle, low, high)
        endless = np.isinf(depth[pose, low]) & np.isinf(depth[pose, high])
        endless &= np.isinf(depth[pose, middle])
        # two lobes that meet within differ in the frequency of chatter
        omega = self.limits.omega
        begin = omega[pose, low]
        between = begin + share * (omega[pose, high] - begin)
        alike = np.abs(omega[pose, middle] / between - 1.0) < _STRAIGHT
        alike &= np.abs(omega[pose, high] / begin - 1.0) < _SAME_LOBE
        smooth = (np.abs(apart) < _SMOOTH) & (np.abs(turn) < _TURN)
        return endless | (alike & smooth)

    def interpolate(self, pose: Indices, low: Indices, high: Indices) -> None:
        """Fill the speeds between two that are known, linearly; depths by the cubic."""
        for step in range(1, _STRIDE):
            some = low + step < high
            if not some.any():
                return
            where = pose[some], (low + step)[some]
            begin = pose[some], low[some]
            end = pose[some], high[some]
            at = self.speeds
            share = (at[where[1]] - at[begin[1]]) / (at[end[1]] - at[begin[1]])
            for field in fields(Limits):
                values: Any = getattr(self.limits, field.name)
                weight = share.reshape(-1, *[1] * (values.ndim - 2))
                if field.name == "depth":
                    endless = np.isinf(values[begin])  # and so is the end
                    some_depth = np.exp(self._between(*where, begin[1], end[1]))
                    values[where] = np.where(endless, np.inf, some_depth)
                else:
                    values[where] = (1.0 - weight) * values[begin]
                    values[where] += weight * values[end]


@in_one_thread
def worst_limits(
    response: ToolResponse,
    cut: Engagement,
    ends: tuple[float, float],
    method: Method,
) -> Limits:
    """Return the limits (n,) at the worst speed of a range, rev/s, at each pose.

    With all harmonics the range is sampled, and then more finely around its least depth.
    """
    if method == "zero-order":
        return find_critical(response, cut, ends)
    n = len(response)
    poses = np.arange(n)
    scale = depth_scale(response, cut)
    fastest = response.rates[response.matters].max() / (2.0 * np.pi)
    sharpest = response.damping[response.matters].min()
    dense = 1.0 / (_RESONANCE * sharpest)
    dense = max(dense, _A_LOBE * fastest / (cut.teeth * ends[0]))
    count = int(np.clip(dense * np.log(ends[1] / ends[0]), 8, _MOST))
    speeds = np.geomspace(*ends, count)
    apart = speeds[1] / speeds[0]
    speed = np.full(n, ends[0])
    depth = np.full(n, np.inf)

    def look(tried: Array) -> None:
        """Take over the speeds (n, s) that are worse than those before."""
        flat = tried.ravel()
        most = np.repeat(depth, tried.shape[1])
        pose = np.repeat(poses, tried.shape[1])
        found = interrupted_depths(response[pose], cut, flat, scale[pose], most)
        found = found.reshape(tried.shape)
        least = found.argmin(axis=1)
        worse = found[poses, least] < depth
        depth[worse] = found[poses, least][worse]
        speed[worse] = tried[poses, least][worse]

    # what is known of some speeds spares a search of all depths at the others
    rest = np.arange(count)
    for stride in _STRIDES:
        some = rest[rest % stride == 0]
        rest = rest[rest % stride != 0]
        if some.size:
            look(np.broadcast_to(speeds[some], (n, len(some))))
    for _ in range(_ZOOMS):
        step = apart ** np.linspace(-1.0, 1.0, _SPLITS + 2)[1:-1]
        look((speed[:, None] * step).clip(*ends))
        apart **= 2.0 / (_SPLITS + 1)
    return interrupted_limits(response, cut, speed, scale)
