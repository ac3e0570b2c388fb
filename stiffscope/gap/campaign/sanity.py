"""Sanity checks of readings by a rough prediction: units, signs, steps, stuck channels, outliers.

Suspected units, signs and steps are also candidate causes of a diagnosis.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.gap.campaign.kinds import KINDS
from stiffscope.gap.effects.effect import Doubts
from stiffscope.gap.effects.instruments import INSTRUMENT, ROTATION, TRANSLATION
from stiffscope.vjm.kinematics.configurations import limit_drives

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    from stiffscope.gap.campaign.campaign import Campaign
    from stiffscope.gap.campaign.kinds.kind import Kind
    from stiffscope.gap.effects.effect import Row
    from stiffscope.runtime.types import Array, Flags, Indices
    from stiffscope.vjm.kinematics.configurations import Configurations
    from stiffscope.vjm.model.mechanism import Mechanism


@dataclass(frozen=True)
class SanitySettings:
    """When readings are doubted before any diagnosis."""

    least: int = 4
    """Fewest readings of a channel that are checked."""
    unit: float = 30.0
    """Ratio to the model, either way, that suggests a wrong unit: robots are not that soft."""
    shown: int = 5
    """Most rows in a remark."""
    agree: float = 0.8
    """Least net fraction of readings with the sign of the model, or correlation."""
    same: float = 3.0
    """Largest ratio to the model of deviations that are not due to geometric errors."""
    sized: float = 0.1
    """Of the largest prediction: smaller ones do not show unit and sign."""
    jump: float = 8.0
    """Standard deviations of the scatter: least size of a step or an outlier."""
    beyond: float = 0.9
    """Least share of the readings on either side of a step that are beyond its middle."""
    apart: float = 1.5
    """Least ratio of an outlier to the largest other reading."""
    far: float = 1000.0
    """Least ratio of an invalid reading to the model and half of its channel."""
    rare: float = 0.1
    """Largest fraction of outliers in a channel."""
    side: int = 3
    """Least readings on either side of a step."""
    own: float = 0.1
    """Least share of these, or of a step, that what else varies does not follow."""
    alike: float = 1e-9
    """Relative size below which columns are one: rounding."""
    rounded: float = 1e-5
    """Rad or m: poses in tables are rounded."""


SANITY = SanitySettings()


DEGREES = 180.0 / np.pi


@dataclass(frozen=True)
class ReadingRemark:
    """A doubt about the readings of one instrument, or about the poses."""

    doubt: str
    """"unit", "sensor-sign", "sensor-step", "constant", "copied", "outlier", "contradiction",
    "no-load", "few", "range", "place", "wrench" or "frame"."""
    instrument: str
    """Name of the instrument, load or drive; empty if all are meant."""
    where: tuple[str, ...]
    """Files and lines."""
    text: str


def inspect_readings(campaign: Campaign, predicted: Array) -> tuple[ReadingRemark, ...]:
    """Compare readings with a rough prediction and with each other.

    Parameters
    ----------
    campaign
        The campaign with n readings; empty values are ignored.
    predicted
        Nominal prediction (n,), SI, accurate to a factor of ten; NaN if there is none.

    Returns
    -------
    tuple of ReadingRemark
        Remarks by channel; empty if nothing is doubtful.
    """
    remarks = [*_inspect_loads(campaign), *_find_far(campaign, predicted)]
    remarks += _find_contradictions(campaign)
    far = {remark.instrument for remark in remarks if remark.doubt == "outlier"}
    channels = [(name, rows) for name, rows in _channels(campaign) if name not in far]
    looks = _look_at_all(campaign, channels, predicted)
    for (name, rows), look in zip(channels, looks, strict=True):
        remarks += _inspect_channel(campaign, predicted, name, rows, look)
    return (*remarks, *_find_copied(campaign, channels))


def inspect_ranges(
    c: Campaign, mechanism: Mechanism, configurations: Configurations
) -> tuple[ReadingRemark, ...]:
    """Return a remark on the first reading at a pose beyond the range of a drive, if there is one.

    Parameters
    ----------
    c
        The campaign with p poses.
    mechanism
        The nominal robot with the ranges of its drives.
    configurations
        The robot at the p poses, reached whatever the ranges.
    """
    limited = limit_drives(configurations, mechanism, SANITY.rounded)
    rows = np.flatnonzero(~limited.valid[c.pose])
    if not len(rows):
        return ()
    pose = int(c.pose[rows[0]])
    where = c.where(int(rows[0]))
    first = (
        f"{where}, the first of {len(rows)} such readings" if len(rows) > 1 else where
    )
    text = f"{first}: {limited.reason(pose)}: are the poses in m and rad?"
    return (
        ReadingRemark(
            "range", mechanism.drives[int(limited.culprit[pose])].name, (where,), text
        ),
    )


def _channels(c: Campaign, least: int = SANITY.least) -> Iterator[tuple[str, Indices]]:
    """Yield instruments with their rows of one kind with a value, if at least ``least``."""
    key = np.column_stack([c.channel, c.kind])
    for channel, kind in np.unique(key, axis=0).tolist():
        rows = np.flatnonzero((key == (channel, kind)).all(axis=1) & ~np.isnan(c.value))
        if len(rows) >= least:
            yield _name_channel(c, int(rows[0])), rows


def _name_channel(c: Campaign, row: int) -> str:
    kind = _kind_of(c, row)
    return kind.plural if kind.instrument else c.what(row)


def _kind_of(c: Campaign, row: int) -> Kind:
    return KINDS[int(c.kind[row])]


def _inspect_loads(c: Campaign) -> Iterator[ReadingRemark]:
    """Yield remarks on zero loads and on too few readings."""
    read = np.flatnonzero(~np.isnan(c.value))
    if 0 < len(read) < SANITY.least - 1:
        have = "1 reading has" if len(read) == 1 else f"{len(read)} readings have"
        text = f"{have} a value: too few for a diagnosis"
        yield ReadingRemark("few", "", (c.where(int(read[0])),), text)
    for k, load in enumerate(c.loads):
        rows = np.flatnonzero(c.load == k)
        if len(rows) and not np.nan_to_num(c.wrench[rows]).any():
            text = f"load {load.name} has no force or moment in any of its {len(rows)} readings"
            yield ReadingRemark("no-load", load.name, (c.where(int(rows[0])),), text)


def _find_far(c: Campaign, predicted: Array) -> Iterator[ReadingRemark]:
    """Yield remarks on rows far beyond the model and half of their channel, however short."""
    for name, rows in _channels(c, 2):
        size = np.abs(c.value[rows])
        model = np.abs(predicted[rows])
        usual = max(
            float(np.sort(size)[(len(rows) - 1) // 2]),
            float(np.nan_to_num(model).max()),
        )
        far = size > SANITY.far * usual
        if c.is_displacement[rows[0]] and usual and far.any():
            yield _name_rows(c, name, rows[far])


def _find_contradictions(c: Campaign) -> Iterator[ReadingRemark]:
    """Yield a remark on each channel with contradictory values in one session, pose and load."""
    key = np.column_stack([c.pose, c.load, c.session, np.nan_to_num(c.wrench)])
    for name, rows in _channels(c, 2):
        group = np.unique(key[rows], axis=0, return_inverse=True)[1].ravel()
        order = rows[np.lexsort([c.value[rows], group])]
        group = np.sort(group)
        first = np.searchsorted(
            group, group
        )  # index of the least value of each row's group
        apart = c.value[order] - c.value[order[first]]
        sigma = np.nan_to_num(c.sigma[order])
        size = np.maximum(np.abs(c.value[order]), np.abs(c.value[order[first]]))
        known = apart[apart > 0]
        sound = np.maximum(
            SANITY.jump * sigma,
            SANITY.jump * np.median(known) if len(known) >= SANITY.least else 0.0,
        )
        bad = (apart > sound) & (apart > 0.5 * size)
        if bad.any():
            k = int(np.argmax(apart * bad))
            two = sorted((int(order[first[k]]), int(order[k])))
            read = " and ".join(f"{c.value[row]:.4g} at {c.where(row)}" for row in two)
            text = f"{name} reads {read}, at one pose and load: is one of them wrong?"
            yield ReadingRemark(
                "contradiction", name, tuple(c.where(row) for row in two), text
            )


def _inspect_channel(
    c: Campaign, predicted: Array, name: str, rows: Indices, look: _Look | None
) -> Iterator[ReadingRemark]:
    kind = _kind_of(c, int(rows[0]))
    value = c.value[rows]
    model = predicted[rows]
    known = bool(np.isfinite(model).all())
    varies = not known or np.ptp(model) > SANITY.sized * np.abs(model).max()
    if not np.ptp(value) and varies and not kind.is_steady:
        read = f"{name} reads {value[0]:g} in all {len(rows)} {kind.name}s"
        text = f"{read}: is it stuck?"
        yield ReadingRemark("constant", name, (c.where(int(rows[0])),), text)
        return
    if not known or not model.any():
        return
    if look is not None:
        yield from _compare(c, name, rows, look)
    if not kind.is_positive:
        yield from _find_breaks(c, name, rows, _columns(c, rows, model))
    elif (model > 0).all():
        yield from _name_outliers(c, name, rows, _centre(np.log(value / model)))


@dataclass(frozen=True)
class _Look:
    """Comparison of a channel with its model."""

    factor: float
    """Apparent factor on its numbers: a power of ten, or degrees per radian; NaN if undecided."""
    ratio: float
    """Median ratio of its readings to the model's, without signs."""
    sign: float
    """Apparent sign 1 or -1; 0 if undecided."""
    against: float
    """Fraction of its readings with the opposite sign."""


def _look_at_all(
    c: Campaign, channels: Iterable[tuple[str, Indices]], predicted: Array
) -> list[_Look | None]:
    """Return unit and sign of each channel; for the sign, deflections precede deviations."""
    out: list[_Look | None] = []
    signed: set[int] = set()
    for _, rows in channels:  # deflections before deviations
        value = c.value[rows]
        model = predicted[rows]
        channel = int(c.channel[rows[0]])
        look = _look_at(c, rows, value, model) if _is_comparable(value, model) else None
        if look is not None and look.sign and c.is_difference[rows[0]]:
            signed.add(channel)
        elif look is not None and channel in signed:
            look = replace(look, sign=0.0)
        out.append(look)
    return out


def _is_comparable(value: Array, model: Array) -> bool:
    return bool(np.isfinite(model).all() and model.any() and np.ptp(value))


def _look_at(c: Campaign, rows: Indices, value: Array, model: Array) -> _Look | None:
    """Return unit and sign from deflections, or from the variation of deviations over poses.

    They must vary as much: geometric errors may exceed the weight's effect and resemble it.
    """
    kind = _kind_of(c, int(rows[0]))
    if kind.shows_rest:
        value = value - np.median(value)
        model = model - np.median(model)
    sized = np.abs(model) > SANITY.sized * np.abs(model).max()
    if sized.sum() < SANITY.least:
        return None
    agree = float(np.mean(np.sign(value[sized] * model[sized])))
    ratio = float(np.median(np.abs(value[sized] / model[sized])))
    within = 1.0 / SANITY.unit < ratio < SANITY.unit
    same = 1.0 / SANITY.same < ratio < SANITY.same
    size = float(np.linalg.norm(value) * np.linalg.norm(model))
    varies = (
        len(value) >= 2 * SANITY.least
        and abs(float(value @ model)) > SANITY.agree * size
    )
    alike = abs(agree) > SANITY.agree and (kind.is_difference or (same and varies))
    factor = np.nan
    if (not kind.is_displacement or alike) and ratio > 0.0:
        turns = bool(c.direction[rows[0]] >= 3) and kind.is_displacement
        known = [
            10.0 ** round(np.log10(ratio)),
            *([DEGREES, 1.0 / DEGREES] if turns else []),
        ]
        nearest = min(known, key=lambda each: abs(np.log(ratio / each)))
        factor = 1.0 if within else nearest
    sign = float(np.sign(agree)) if alike and kind.is_displacement else 0.0
    return _Look(factor, ratio, sign, float(np.mean(value[sized] * model[sized] < 0)))


def _compare(
    c: Campaign, name: str, rows: Indices, look: _Look
) -> Iterator[ReadingRemark]:
    """Yield remarks on unit and sign."""
    where = (c.where(int(rows[0])),)
    if np.isfinite(look.factor) and look.factor != 1.0:
        ten = round(np.log10(look.factor))
        size = (
            f"1e{ten}" if np.isclose(look.factor, 10.0**ten) else f"{look.factor:.3g}"
        )
        text = f"{name} reads about {size} times the model: wrong unit?"
        yield ReadingRemark("unit", name, where, text)
    if look.sign < 0.0:
        kind = _kind_of(c, int(rows[0]))
        text = f"{name} opposes the model in {look.against:.0%} of its {kind.plural}"
        yield ReadingRemark("sensor-sign", name, where, f"{text}: is it reversed?")


def find_doubts(campaign: Campaign, predicted: Array) -> Doubts:
    """Return doubts by comparing deflections and deviations with a prediction, merged if common.

    Parameters
    ----------
    campaign
        The campaign with n readings.
    predicted
        Nominal prediction (n,) of each.
    """
    c = campaign
    value = np.array(campaign.value)
    factors: dict[str, float] = {}
    signs: dict[str, float] = {}
    steps: dict[str, tuple[Row, float, bool]] = {}
    turning: dict[str, bool] = {}
    channels = [
        (name, rows) for name, rows in _channels(c) if c.is_displacement[rows[0]]
    ]
    channels = [
        (name, rows)
        for name, rows in channels
        if _is_comparable(c.value[rows], predicted[rows])
    ]
    names = [c.instruments[int(c.channel[rows[0]])] for _, rows in channels]
    for name, (_, rows) in zip(names, channels, strict=True):
        turning[name] = bool(c.direction[rows[0]] >= 3)
        step = _find_jump(
            c.value[rows], _columns(c, rows, predicted[rows]), c.pose[rows]
        )
        if step is not None:
            row = int(rows[step[0]])
            usual = float(np.sqrt(np.mean(predicted[rows] ** 2)))
            steps.setdefault(
                name, ((int(c.file[row]), int(c.line[row])), usual, turning[name])
            )
            value[rows[step[0] :]] -= step[1]  # which may hide a sign
    for name, look in zip(
        names, _look_at_all(replace(c, value=value), channels, predicted), strict=True
    ):
        if look is not None and np.isfinite(look.factor):
            factors.setdefault(name, look.factor)
        if look is not None and look.sign:
            signs.setdefault(name, look.sign)
    family = set(turning) - {sensor.name for sensor in c.sensors} or set(turning)
    rotations = {name for name in family if turning[name]}
    families = {
        INSTRUMENT: family,
        TRANSLATION: family - rotations,
        ROTATION: rotations,
    }
    return Doubts(_gather(factors, families), tuple(_gather(signs, families)), steps)


def _gather(
    seen: Mapping[str, float], families: Mapping[str, set[str]]
) -> dict[str, float]:
    """Return values other than one by instrument, or by family if its members agree."""
    out = dict[str, float]()
    left = dict(seen)
    for family, members in families.items():
        values = {left[name] for name in members & set(left)}
        if len(values) == 1 and len(members & set(left)) > 1 and values != {1.0}:
            out[family] = values.pop()
            left = {name: value for name, value in left.items() if name not in members}
    return out | {name: value for name, value in left.items() if value != 1.0}


def _columns(c: Campaign, rows: Indices, model: Array) -> Array:
    """Return orthonormal columns (r, m) that span prediction, wrench and a constant."""
    columns = np.column_stack(
        [model, np.nan_to_num(c.wrench[rows]), np.ones(len(rows))]
    )
    columns = columns[:, np.abs(columns).max(axis=0) > 0]
    left, size, _ = np.linalg.svd(
        columns / np.abs(columns).max(axis=0), full_matrices=False
    )
    return left[:, size > SANITY.alike * size[0]]


def _fit_robustly(value: Array, columns: Array) -> tuple[Array, Array]:
    """Return coefficients (m,) of columns (r, m) in a robust fit of values (r,), and residuals (r,)."""
    solve: Any = np.linalg.lstsq
    weight = np.ones(len(value))
    left = np.asarray(value, dtype=float)
    rounding = max(1e-15 * float(np.abs(value).max()), 1e-300)
    fit = np.zeros(columns.shape[1])
    for _ in range(30):
        fit = solve(columns * weight[:, None], value * weight, rcond=SANITY.alike)[0]
        left = np.asarray(value - columns @ fit, dtype=float)
        weight = np.sqrt(1.0 / (1.0 + (left / max(2.0 * _spread(left), rounding)) ** 2))
    return fit, left


def _spread(values: Array) -> float:
    """Return a robust standard deviation of values (n,)."""
    return 1.4826 * float(np.median(np.abs(values - np.median(values))))


def _centre(values: Array) -> Array:
    return values - np.median(values)


def _find_breaks(
    c: Campaign, name: str, rows: Indices, columns: Array
) -> Iterator[ReadingRemark]:
    """Yield remarks on a step from one row on, and on outlying rows besides."""
    step = _find_jump(c.value[rows], columns, c.pose[rows])
    if step is not None:
        place, jump = step
        where = c.where(int(rows[place]))
        unit = "rad" if c.direction[rows[0]] >= 3 else "m"
        text = f"{name} jumps by {jump:.2g} {unit} at {where} and stays there: has it slipped?"
        yield ReadingRemark("sensor-step", name, (where,), text)
        columns = np.column_stack(
            [columns, np.heaviside(np.arange(len(rows)) - place, 1.0)]
        )
    yield from _name_outliers(
        c, name, rows, _centre(_fit_robustly(c.value[rows], columns)[1])
    )


def _find_jump(
    value: Array, columns: Array, poses: Indices
) -> tuple[int, float] | None:
    """Return the index and size of a jump of values (r,) at poses (r,); None if there is none.

    It is fitted together with orthonormal columns (r, m). All readings at one pose, before or after
    the others, may differ by a fault of the robot there.
    """
    count = len(value)
    if count < 2 * (SANITY.side + 1):
        return None
    left = _fit_robustly(value, columns)[1]
    clipped = np.clip(_centre(left), -10 * _spread(left), 10 * _spread(left))
    clipped = clipped - columns @ (columns.T @ clipped)
    before = np.arange(SANITY.side, count - SANITY.side + 1)
    pull, shared = (
        np.cumsum(doubt[::-1], axis=0)[::-1][before] for doubt in (clipped, columns)
    )
    remaining = (
        count - before - np.sum(shared**2, axis=1)
    )  # of a step, what the columns do not follow
    place = int(
        before[
            np.argmax(
                pull**2
                / remaining.clip(min=SANITY.own * np.minimum(before, count - before))
            )
        ]
    )
    fit, rest = _fit_robustly(
        value, np.column_stack([columns, np.heaviside(np.arange(count) - place, 1.0)])
    )
    jump = float(fit[-1])
    if abs(jump) <= SANITY.jump * _spread(rest):
        return None
    apart = (
        min(np.mean(rest[:place] / jump <= 0.5), np.mean(rest[place:] / jump > -0.5))
        >= SANITY.beyond
    )
    visited = min(len(np.unique(poses[:place])), len(np.unique(poses[place:])))
    return (
        (place, jump)
        if apart and (visited > 1 or poses[place - 1] == poses[place])
        else None
    )


def _name_outliers(
    c: Campaign, name: str, rows: Indices, left: Array
) -> Iterator[ReadingRemark]:
    """Yield a remark on the few outlying rows of a scatter (r,) about zero."""
    sigma = np.nan_to_num(c.sigma[rows]) / np.where(
        c.relative[rows], np.abs(c.value[rows]), 1.0
    )
    far = _stand_apart(np.abs(left), SANITY.jump * np.maximum(_spread(left), sigma))
    if (
        not 0 < far.sum() <= max(1, SANITY.rare * len(rows))
        or len(rows) < 3 * SANITY.least
    ):
        return
    yield _name_rows(c, name, rows[np.flatnonzero(far)[np.argsort(-np.abs(left[far]))]])


def _stand_apart(size: Array, limit: Array) -> Flags:
    """Return which of sizes (r,) are beyond a limit (r,) and no tail of smaller ones.

    A robot's fault that depends on pose or load, such as friction, has a long tail, which fades
    into the usual readings: as it falls, at least as many are between half the limit and the
    limit as beyond. What is misread may be of any size, so that few of it are there.
    """
    far = size > limit
    fading = int((~far & (size > 0.5 * limit)).sum()) >= int(far.sum())
    while fading and far.any():
        apart = far & (size > SANITY.apart * size[~far].max(initial=0.0))
        if (apart == far).all():
            break
        far = apart
    return far


def _name_rows(c: Campaign, name: str, rows: Indices) -> ReadingRemark:
    """Return a remark on outlying rows."""
    where = tuple(c.where(int(row)) for row in rows)
    more = f" and {len(where) - SANITY.shown} more" if len(where) > SANITY.shown else ""
    text = f"{name} is an outlier among its readings at {', '.join(where[: SANITY.shown])}{more}"
    return ReadingRemark("outlier", name, where, text)


def _find_copied(
    c: Campaign, channels: list[tuple[str, Indices]]
) -> Iterator[ReadingRemark]:
    """Yield remarks on channels with exactly the readings of another."""
    known: dict[bytes, str] = {}
    for name, rows in channels:
        key = c.value[rows].tobytes()
        other = known.setdefault(key, name)
        if other != name and np.ptp(c.value[rows]):
            text = f"{name} repeats the readings of {other} exactly: is it a copy?"
            yield ReadingRemark("copied", name, (c.where(int(rows[0])),), text)
