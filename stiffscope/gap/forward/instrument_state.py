"""Unknowns of a campaign's instruments: poses of frames, positions of targets, and zeros.

These nuisance parameters v are marginalized for every hypothesis: ``y = f + N v + noise`` with a
normal prior of v, both weighted so that ``N = U s Vᵀ``. The marginal likelihood of a residual r is
that of ``r - U (1 - 1/sqrt(1 + s²)) Uᵀ r``. Unobservable components of v have s = 0 and no share.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, cast

import numpy as np
from scipy.special import chdtri  # pyright: ignore[reportMissingTypeStubs, reportUnknownVariableType]

from stiffscope.gap.forward.placing import find_frame, find_outlying
from stiffscope.vjm.model.screws import rotation_of

if TYPE_CHECKING:
    from collections.abc import Iterator

    from stiffscope.gap.campaign.campaign import Campaign, Sensor
    from stiffscope.runtime.types import Array, Flags, Indices

_WIDE = 1e5  # m, rad: prior of unknowns
_USUAL = 1e-5  # m, rad: default noise relative to a prior
_STEPS = 50  # Gauss-Newton steps
_HALVINGS = 12
_SETTLED = 1e-4  # standard deviations: largest change of predictions by the last step
_RANK = 1e-12  # relative to the largest singular value: unobservable below
_CERTAIN = 1e5  # singular value above which the prior is negligible
_HIDDEN = 1e-6  # fraction of a column regarded as rounding
_PASSES = 6  # passes over outliers
_UNLIKELY = {k: float(chdtri(k, 1e-3)) for k in (3, 6)}
# χ² of the deviation of a target or a frame from where it is stated: one in a thousand


@dataclass(frozen=True)
class InstrumentState:
    """State of the instruments: f frames, t targets, z zeros."""

    rotation: Array
    """Axes (f, 3, 3) of the frames in {O}."""
    origin: Array
    """Origins (f, 3) of the frames."""
    away: Array
    """Offsets (t, 3) of targets from their stated positions, home axes, m."""
    zero: Array
    """Zeros (z,)."""

    def move(self, step: Array) -> InstrumentState:
        """Return the state after a step (6 f + 3 t + z,): frames shift and turn, others shift."""
        f = len(self.origin)
        t = len(self.away)
        frames = step[: 6 * f].reshape(f, 6)
        away = step[6 * f : 6 * f + 3 * t].reshape(t, 3)
        return InstrumentState(
            rotation_of(frames[:, 3:]) @ self.rotation,
            self.origin + frames[:, :3],
            self.away + away,
            self.zero + step[6 * f + 3 * t :],
        )


@dataclass(frozen=True)
class Projection:
    """Low-rank projection ``left @ right`` of changes of readings onto the unknowns."""

    left: Array
    """Left factor (n, r)."""
    right: Array
    """Right factor (r, n)."""

    def share(self, change: Array) -> Array:
        """Return the unknowns' share of changes (n,) or (n, k)."""
        return self.left @ (self.right @ change)

    def without(self, columns: Array) -> Array:
        """Return changes (n, k) without that share; columns fully absorbed become exactly zero."""
        if not len(self.right) or not columns.size:
            return columns
        out = columns - self.share(columns)
        return out * (np.abs(out).max(axis=0) > _HIDDEN * np.abs(columns).max(axis=0))


@dataclass(frozen=True)
class AbsoluteReadings:
    """Readings of positions and distances for one prediction of the robot."""

    setup: InstrumentState
    seen: Array
    """Readings (a,) with targets and zeros as stated."""
    looks: Array
    """Measured direction (a, 6) of body motion at the stated target point; base axes."""
    projection: Projection
    left: Array
    """Readings (a,) less those of the instruments as they were fitted."""


@dataclass(frozen=True)
class Instruments:
    """Unknowns of a campaign's instruments, and the readings that depend on them."""

    campaign: Campaign

    @cached_property
    def rows(self) -> Indices:
        """Rows (a,) of position and distance readings."""
        return np.flatnonzero(self.campaign.is_absolute)

    @cached_property
    def _looks(self) -> tuple[Array, Flags]:
        """Measured axes (a, 3) in their frames, and whether each reading is a distance (a,)."""
        c = self.campaign
        which: list[Sensor] = [c.sensors[int(k)] for k in c.sensor[self.rows]]
        axes = np.array([s.direction for s in which], dtype=float).reshape(-1, 3)
        return axes, np.array([s.measures == "distance" for s in which], dtype=np.bool_)

    @cached_property
    def _frame(self) -> tuple[Indices, list[int]]:
        """Instrument setup (a,) of each reading, and the frame of each setup."""
        c = self.campaign
        names = [frame.name for frame in self.campaign.frames]
        code = [names.index(s.frame) if s.absolute else -1 for s in c.sensors]
        own = np.array(code or [-1])[c.sensor[self.rows]]
        anew = np.array([frame.per == "session" for frame in c.frames] or [False])[own]
        key = np.column_stack([own, np.where(anew, c.session[self.rows], 0)])
        found, which = np.unique(key, axis=0, return_inverse=True)
        return which.ravel(), found[:, 0].tolist()

    @cached_property
    def _spreads(self) -> dict[str, float]:
        """Uncertainty of each target whose place is uncertain, m."""
        each = (
            (s.target or s.name, s.at_sigma * s.absolute) for s in self.campaign.sensors
        )
        return {name: size for name, size in each if size > 0.0}

    @cached_property
    def _loose(self) -> tuple[Indices, Array]:
        """Uncertain target (a,) of each reading, -1 for none; uncertainties (t,) of the targets."""
        c = self.campaign
        known = self._spreads
        names = [s.target or s.name for s in c.sensors]
        code = [list(known).index(name) if name in known else -1 for name in names]
        return np.array(code or [-1])[c.sensor[self.rows]], np.array(
            list(known.values())
        )

    @cached_property
    def _zeros(self) -> Indices:
        """Index (n,) of each reading's unknown zero, -1 for none."""
        c = self.campaign
        unknown = np.array([s.zero == "session" for s in c.sensors] + [False])
        free = unknown[c.sensor] & c.is_motion
        out = np.full(len(c), -1)
        if free.any():
            key = np.stack([c.sensor, c.session], axis=1)[free]
            out[free] = np.unique(key, axis=0, return_inverse=True)[1].ravel()
        return out

    @cached_property
    def _prior(self) -> tuple[Array, Flags]:
        """Prior standard deviations (m,) of all unknowns, and whether the mean is stated."""
        frames = [self.campaign.frames[k] for k in self._frame[1]]
        places = [
            (_WIDE,) * 6 if f.pose is None else f.sigma or (0.0,) * 6 for f in frames
        ]
        stated = np.repeat([f.pose is not None for f in frames], 6)
        zeros = np.full(self._zeros.max(initial=-1) + 1, _WIDE)
        sigma = np.concatenate(
            [np.zeros(0), *places, np.repeat(self._loose[1], 3), zeros]
        )
        return sigma, np.concatenate(
            [stated, np.ones(len(sigma) - len(stated))]
        ).astype(np.bool_)

    @cached_property
    def _weight(self) -> Array:
        """Inverse noise (n,); if not stated, that of the same kind, or a default."""
        c = self.campaign
        sigma = np.array(c.sigma)
        like = c.kind_numbers
        for group in np.unique(like[np.isnan(sigma)]):
            mine = like == group
            known = sigma[mine & ~np.isnan(sigma)]
            sigma[mine & np.isnan(sigma)] = np.median(known) if known.size else _USUAL
        return 1.0 / sigma

    def _linearize(
        self, setup: InstrumentState, points: Array, turns: Array
    ) -> tuple[Array, Array, Array]:
        """Return predictions (a,), directions (a, 3) and derivatives (n, m) by the unknowns."""
        c = self.campaign
        rows = self.rows
        (axes, ranged) = self._looks
        f = len(setup.origin)
        t = len(setup.away)
        out = np.zeros((len(c), len(self._prior[0])))
        free = np.flatnonzero(self._zeros >= 0)
        out[free, 6 * f + 3 * t + self._zeros[free]] = 1.0
        if not len(rows):
            return np.zeros(0), np.zeros((0, 3)), out
        frame = self._frame[0]
        target = self._loose[0]
        loose = np.flatnonzero(target >= 0)
        away = points + self._levers(setup, turns) - setup.origin[frame]
        length = np.linalg.norm(away, axis=1)
        along = np.einsum("nij,nj->ni", setup.rotation[frame], axes)
        direction = np.where(
            ranged[:, None], away / np.where(length, length, 1.0)[:, None], along
        )
        seen = cast(
            "Array", np.where(ranged, length, np.einsum("ni,ni->n", along, away))
        )
        by_frame = np.concatenate([-direction, np.cross(direction, away)], axis=1)
        out[rows[:, None], 6 * frame[:, None] + np.arange(6)] = by_frame
        by_target = np.einsum("nji,nj->ni", turns[loose], direction[loose])
        out[rows[loose][:, None], 6 * f + 3 * target[loose][:, None] + np.arange(3)] = (
            by_target
        )
        zero = self._zeros[self.rows]
        return (
            seen + np.where(zero >= 0, np.append(setup.zero, 0.0)[zero], 0.0),
            direction,
            out,
        )

    def look(self, setup: InstrumentState, points: Array, turns: Array) -> Array:
        """Return positions and distances (a,) of targets (a, 3) on bodies rotated by (a, 3, 3)."""
        return self._linearize(setup, points, turns)[0]

    def project(self, columns: Array, weight: Array) -> Projection:
        """Return the projection onto the unknowns; readings (n,) of zero weight do not count."""
        scaled = columns * self._prior[0]
        u, s, v = _factors(scaled * weight[:, None])
        left = np.where(s < _CERTAIN, 1.0 / np.sqrt(1.0 + s**2), 0.0)
        factor = (1.0 - left) / np.where(s > 0.0, s, 1.0)
        return Projection(scaled @ (v.T * factor), u.T * weight)

    @cached_property
    def zeros(self) -> Projection:
        """Projection for a campaign whose only unknowns are zeros."""
        columns = self._linearize(self._nowhere, np.zeros((0, 3)), np.zeros((0, 3, 3)))[
            2
        ]
        return self.project(columns, self._weight)

    @property
    def _nowhere(self) -> InstrumentState:
        f = len(self._frame[1])
        t = len(self._loose[1])
        z = int(self._zeros.max(initial=-1)) + 1
        return InstrumentState(
            np.tile(np.eye(3), (f, 1, 1)),
            np.zeros((f, 3)),
            np.zeros((t, 3)),
            np.zeros(z),
        )

    @cached_property
    def measured_values(self) -> Array:
        """Measured positions and distances (a,)."""
        c = self.campaign
        return c.value[self.rows] + (
            0.0 if c.expected is None else c.expected[self.rows]
        )

    def start(self, points: Array, turns: Array) -> tuple[InstrumentState, Array]:
        """Return instruments estimated without a guess, and weights (n,), zero for outliers.

        Parameters
        ----------
        points
            (a, 3) target of each position and distance for the robot as commanded.
        turns
            (a, 3, 3) rotation of its body from home.
        """
        setup = self._stated_setup()
        weight = np.array(self._weight)
        own = weight[self.rows]
        ranged = self._looks[1]
        read = self.measured_values
        for k, which in enumerate(self._frame[1]):
            if self.campaign.frames[which].pose is None:
                mine = np.flatnonzero(self._frame[0] == k)
                found = find_frame(
                    self._triples(mine), ranged[mine], points[mine], read[mine]
                )
                setup.rotation[k], setup.origin[k] = found
        for _ in range(_PASSES):
            weight[self.rows] = own
            setup = self.fit(points, turns, setup, weight)
            left = read - self._linearize(setup, points, turns)[0]
            again = np.where(find_outlying(left), 0.0, self._weight[self.rows])
            if np.array_equal(again, own):
                break
            own = again
        return setup, weight

    def _stated_setup(self) -> InstrumentState:
        """Return the setup as stated in the campaign."""
        out = self._nowhere
        for k, which in enumerate(self._frame[1]):
            pose = self.campaign.frames[which].pose
            if pose is not None:
                out.rotation[k] = rotation_of(np.array(pose[3:]))
                out.origin[k] = pose[:3]
        return out

    def _triples(self, mine: Indices) -> Indices:
        """Return rows (k, 3) of simultaneous x, y and z readings of one target."""
        c = self.campaign
        rows = self.rows[mine]
        names = [s.target for s in c.sensors]
        target = np.array([names.index(name) for name in names])[c.sensor[rows]]
        key = np.column_stack([c.pose, c.session, c.load, np.nan_to_num(c.wrench)])[
            rows
        ]
        group = np.unique(np.column_stack([target, key]), axis=0, return_inverse=True)[
            1
        ].ravel()
        found = np.full((group.max(initial=-1) + 1, 3), -1)
        placed = np.flatnonzero(~self._looks[1][mine])
        found[group[placed], c.direction[rows[placed]]] = placed
        return found[(found >= 0).all(axis=1)]

    def fit(
        self, points: Array, turns: Array, setup: InstrumentState, weight: Array
    ) -> InstrumentState:
        """Return the best-fitting instruments by damped Gauss-Newton from an initial setup."""
        sigma, stated = self._prior
        own = weight[self.rows]
        start = self._stated_setup()
        seen, _, columns = self._linearize(setup, points, turns)
        left = (self.measured_values - seen) * own
        mean = self._offset(setup, start)
        for _ in range(_STEPS):
            u, s, v = _factors(columns[self.rows] * own[:, None] * sigma)
            whole = v.T @ ((s * (u.T @ left) + s**2 * (v @ mean)) / (s**2 + 1.0)) - mean
            cost = left @ left + np.sum(mean[stated] ** 2)
            for share in 0.5 ** np.arange(_HALVINGS):
                trial = setup.move(share * sigma * whole)
                seen, _, ahead = self._linearize(trial, points, turns)
                after = (self.measured_values - seen) * own
                there = self._offset(trial, start)
                if after @ after + np.sum(there[stated] ** 2) <= cost * (1.0 + 1e-12):
                    break
            else:
                return setup
            moved = np.abs(after - left).max(initial=0.0)
            setup = trial
            left = after
            columns = ahead
            mean = there
            if moved < _SETTLED:
                break
        return setup

    def _offset(self, setup: InstrumentState, start: InstrumentState) -> Array:
        """Return deviations (m,) from stated values in prior standard deviations; 0 if unknown."""
        sigma, stated = self._prior
        turns = setup.rotation @ np.swapaxes(start.rotation, -1, -2)
        i = [2, 0, 1]
        j = [1, 2, 0]
        small = 0.5 * (turns[:, i, j] - turns[:, j, i])
        frames = np.concatenate([setup.origin - start.origin, small], axis=1)
        every = np.concatenate([frames.ravel(), setup.away.ravel(), setup.zero])
        return np.divide(
            every, sigma, out=np.zeros(len(sigma)), where=stated & (sigma > 0.0)
        )

    def place(
        self, points: Array, turns: Array, start: tuple[InstrumentState, Array]
    ) -> AbsoluteReadings:
        """Fit the instruments to one prediction.

        Parameters
        ----------
        points, turns
            (a, 3), (a, 3, 3) target points and rotations of their bodies.
        start
            InstrumentState and weights for the robot as commanded.
        """
        setup = self.fit(points, turns, *start)
        seen, direction, columns = self._linearize(setup, points, turns)
        left = self.measured_values - seen
        seen = seen - columns[self.rows] @ (
            self._offset(setup, self._stated_setup()) * self._prior[0]
        )
        looks = np.concatenate(
            [direction, np.cross(self._levers(setup, turns), direction)], axis=1
        )
        return AbsoluteReadings(
            setup, seen, looks, self.project(columns, start[1]), left
        )

    def find_displaced(self, setup: InstrumentState) -> Iterator[str]:
        """Yield frames and targets that are farther from where they are stated than is likely.

        Their deviations over their uncertainties are a χ² each, of three or six.
        """
        away = self._offset(setup, self._stated_setup())
        frames, targets = np.split(away, [6 * len(setup.origin)])
        named = [self.campaign.frames[k].name for k in self._frame[1]]
        for name, each in zip(named, frames.reshape(-1, 6), strict=True):
            if each @ each > _UNLIKELY[6]:
                size = float(np.linalg.norm(each))
                yield (
                    f"{name} is found {size:.3g} standard uncertainties from where it is "
                    "stated"
                )
        count = len(setup.away)
        rows = targets[: 3 * count].reshape(-1, 3)
        for name, each, shift in zip(self._spreads, rows, setup.away, strict=True):
            if each @ each > _UNLIKELY[3]:
                size = float(np.linalg.norm(each))
                yield (
                    f"{name} is found {1e3 * np.linalg.norm(shift):.3g} mm from where it is "
                    f"stated, {size:.3g} times its uncertainty"
                )

    def _levers(self, setup: InstrumentState, turns: Array) -> Array:
        """Return vectors (a, 3) from stated to actual target positions, base axes."""
        away = np.concatenate([setup.away, np.zeros((1, 3))])[self._loose[0]]
        return np.einsum("nij,nj->ni", turns, away)


def _factors(columns: Array) -> tuple[Array, Array, Array]:
    """Return the singular value decomposition of columns (n, m), without rounding."""
    u, s, v = np.linalg.svd(columns, full_matrices=False)
    keep = s > _RANK * s.max(initial=0.0)
    return u[:, keep], s[keep], v[keep]
