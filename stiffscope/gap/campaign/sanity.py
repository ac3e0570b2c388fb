"""Sanity of readings beside a rough prediction: units, signs, steps, constant and copied channels, outliers by row.

What is doubted of units, signs and steps is also what a diagnosis takes for a cause.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.effects.effect import Doubts
from stiffscope.effects.instruments import INSTRUMENT, ROTATION, TRANSLATION
from stiffscope.gap.campaign.quantities import DEFLECTION, DEVIATION, FREQUENCY, KINDS, POSITION, STIFFNESS

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    from stiffscope.effects.effect import Row
    from stiffscope.gap.campaign.campaign import Campaign
    from stiffscope.runtime.types import Array, Flags, Indices

LEAST = 4  # readings of a channel, below which nothing is said of it
UNIT = 30.0  # times the model, or below it: hardly a machine is that far from its model, but a unit is
DEGREES = 180.0 / np.pi
_AGREE = 0.8  # net share of readings with the model's sign, or correlation
_SAME = 3.0  # times the model, up to which deviations may be those that it has, and not those of its geometry
_SIZED = 0.1  # of the largest prediction: below it a reading says nothing of unit and sign
_SHOWN = 5  # rows of a remark
_JUMP = 8.0  # standard deviations of the scatter by which a step or an outlier stands out
_CLEARED = 3.0  # times by which a step's removal must lessen the scatter
_APART = 1.5  # times the largest of the other readings, from which on a reading is an outlier
_FAR = 1000.0  # times the model and half of a channel's readings, from which on a reading is none of its
_RARE = 0.1  # share of a channel's readings that may be called outliers
_SIDE = 3  # readings on either side of a step


@dataclass(frozen=True)
class ReadingRemark:
    """What is doubtful in the readings of one instrument."""

    doubt: str
    """"unit", "sensor-sign", "sensor-step", "constant", "copied", "outlier", "contradiction", "no-load" or "few"."""
    instrument: str
    """Or load; empty where all are meant."""
    where: tuple[str, ...]
    """Files and lines."""
    text: str


def inspect_readings(campaign: Campaign, predicted: Array) -> tuple[ReadingRemark, ...]:
    """Compare readings with a rough prediction and with each other.

    Parameters
    ----------
    campaign
        With n readings; empty values are passed over.
    predicted
        (n,) what the nominal model says of each, SI, right within a factor of ten; NaN where nothing is predicted.

    Returns
    -------
    tuple of ReadingRemark
        Channel by channel; empty where nothing is doubtful.

    """
    found = [*_inspect_loads(campaign), *_find_far(campaign, predicted), *_find_contradictions(campaign)]
    far = {remark.instrument for remark in found if remark.doubt == "outlier"}
    channels = [(name, rows) for name, rows in _channels(campaign) if name not in far]
    looks = _look_at_all(campaign, channels, predicted)
    for (name, rows), look in zip(channels, looks, strict=True):
        found += _inspect_channel(campaign, predicted, name, rows, look)
    return (*found, *_find_copied(campaign, channels))


def _channels(c: Campaign, least: int = LEAST) -> Iterator[tuple[str, Indices]]:
    """Names of instruments with their rows of one kind that have a value, where they are not too few."""
    key = np.column_stack([c.channel, c.kind])
    for channel, kind in np.unique(key, axis=0).tolist():
        rows = np.flatnonzero((key == (channel, kind)).all(axis=1) & ~np.isnan(c.value))
        if len(rows) >= least:
            yield c.what(int(rows[0])) if kind != FREQUENCY else "frequencies", rows


def _inspect_loads(c: Campaign) -> Iterator[ReadingRemark]:
    """Remarks on loads that load nothing, and on readings that are too few."""
    read = np.flatnonzero(~np.isnan(c.value))
    if 0 < len(read) < LEAST - 1:
        have = "1 reading has" if len(read) == 1 else f"{len(read)} readings have"
        yield ReadingRemark("few", "", (c.where(int(read[0])),), f"{have} a value: too few to tell causes apart")
    for k, load in enumerate(c.loads):
        rows = np.flatnonzero(c.load == k)
        if len(rows) and not np.nan_to_num(c.wrench[rows]).any():
            text = f"load {load.name} is no force and no moment in any of its {len(rows)} readings"
            yield ReadingRemark("no-load", load.name, (c.where(int(rows[0])),), text)


def _find_far(c: Campaign, predicted: Array) -> Iterator[ReadingRemark]:
    """Remarks on rows far beyond the model and half of their channel, however short that is."""
    for name, rows in _channels(c, 2):
        size, model = np.abs(c.value[rows]), np.abs(predicted[rows])
        usual = max(float(np.sort(size)[(len(rows) - 1) // 2]), float(np.nan_to_num(model).max()))
        if int(c.kind[rows[0]]) in (DEFLECTION, DEVIATION) and usual and (far := size > _FAR * usual).any():
            yield _name_rows(c, name, rows[far])


def _find_contradictions(c: Campaign) -> Iterator[ReadingRemark]:
    """A remark on each channel that reads quite different values in one session at one pose and load."""
    key = np.column_stack([c.pose, c.load, c.session, np.nan_to_num(c.wrench)])
    for name, rows in _channels(c, 2):
        group = np.unique(key[rows], axis=0, return_inverse=True)[1].ravel()
        order = rows[np.lexsort([c.value[rows], group])]
        group = np.sort(group)
        first = np.searchsorted(group, group)  # of each row's group, its least value
        apart, sigma = c.value[order] - c.value[order[first]], np.nan_to_num(c.sigma[order])
        size = np.maximum(np.abs(c.value[order]), np.abs(c.value[order[first]]))
        sigma *= np.where(c.relative[order], size, 1.0)
        known = apart[apart > 0]
        sound = np.maximum(_JUMP * sigma, _JUMP * np.median(known) if len(known) >= LEAST else 0.0)
        bad = (apart > sound) & (apart > 0.5 * size)
        if bad.any():
            two = sorted((int(order[first[k := int(np.argmax(apart * bad))]]), int(order[k])))
            read = " and ".join(f"{c.value[row]:.4g} at {c.where(row)}" for row in two)
            text = f"{name} reads {read}, at one pose and load: is one of them wrong?"
            yield ReadingRemark("contradiction", name, tuple(c.where(row) for row in two), text)


def _inspect_channel(
    c: Campaign, predicted: Array, name: str, rows: Indices, look: _Look | None
) -> Iterator[ReadingRemark]:
    kind = int(c.kind[rows[0]])
    value, model = c.value[rows], predicted[rows]
    known = bool(np.isfinite(model).all())
    if not np.ptp(value) and (not known or np.ptp(model) > _SIZED * np.abs(model).max()) and kind != FREQUENCY:
        text = f"{name} reads {value[0]:g} in all {len(rows)} {KINDS[kind]}s: is it stuck?"
        yield ReadingRemark("constant", name, (c.where(int(rows[0])),), text)
        return
    if not known or not model.any():
        return
    if look is not None:
        yield from _compare(c, name, rows, look)
    if kind in (DEFLECTION, DEVIATION, POSITION):
        yield from _find_breaks(c, name, rows, _scatter(c, rows, value, model))
    elif (model > 0).all():
        yield from _name_outliers(c, name, rows, _centre(np.log(value / model)))


@dataclass(frozen=True)
class _Look:
    """A channel beside its model."""

    factor: float
    """Power of ten, or degrees for radians, that its numbers seem to be multiplied with; NaN: nothing is said of it."""
    ratio: float
    """Median of its readings over the model's, without signs."""
    sign: float
    """1 or -1; 0: nothing is said of it."""
    against: float
    """Share of its readings that have the other sign."""


def _look_at_all(c: Campaign, channels: Iterable[tuple[str, Indices]], predicted: Array) -> list[_Look | None]:
    """Unit and sign of each channel; of an instrument whose deflections show its sign they alone are heard."""
    out: list[_Look | None] = []
    signed: set[int] = set()
    for _, rows in channels:  # deflections before deviations
        value, model, channel = c.value[rows], predicted[rows], int(c.channel[rows[0]])
        look = _look_at(c, rows, value, model) if _is_comparable(value, model) else None
        if look is not None and look.sign and int(c.kind[rows[0]]) == DEFLECTION:
            signed.add(channel)
        elif look is not None and channel in signed:
            look = replace(look, sign=0.0)
        out.append(look)
    return out


def _is_comparable(value: Array, model: Array) -> bool:
    return bool(np.isfinite(model).all() and model.any() and np.ptp(value))


def _look_at(c: Campaign, rows: Indices, value: Array, model: Array) -> _Look | None:
    """Unit and sign: of deflections by themselves, of deviations by how they vary over the poses, if as much.

    Errors of the geometry may be many times what the weight does, and vary as that by chance.
    """
    kind = int(c.kind[rows[0]])
    if kind in (DEVIATION, POSITION):
        value, model = value - np.median(value), model - np.median(model)
    sized = np.abs(model) > _SIZED * np.abs(model).max()
    if sized.sum() < LEAST:
        return None
    agree = float(np.mean(np.sign(value[sized] * model[sized])))
    ratio = float(np.median(np.abs(value[sized] / model[sized])))
    within = 1.0 / UNIT < ratio < UNIT
    same = 1.0 / _SAME < ratio < _SAME
    alike = abs(agree) > _AGREE and (kind == DEFLECTION or (same and _varies_as_much(value, model)))
    factor = np.nan
    if (kind >= STIFFNESS or alike) and ratio > 0.0:
        turns = bool(c.direction[rows[0]] >= 3) and kind <= DEVIATION
        factor = 1.0 if within else _nearest_factor(ratio, turns=turns)
    sign = float(np.sign(agree)) if alike and kind <= DEVIATION else 0.0
    return _Look(factor, ratio, sign, float(np.mean(value[sized] * model[sized] < 0)))


def _nearest_factor(ratio: float, *, turns: bool) -> float:
    known = [10.0 ** round(np.log10(ratio)), *([DEGREES, 1.0 / DEGREES] if turns else [])]
    return min(known, key=lambda factor: abs(np.log(ratio / factor)))


def _compare(c: Campaign, name: str, rows: Indices, look: _Look) -> Iterator[ReadingRemark]:
    """Remarks on unit and sign."""
    where = (c.where(int(rows[0])),)
    if np.isfinite(look.factor) and look.factor != 1.0:
        ten = round(np.log10(look.factor))
        size = f"1e{ten}" if np.isclose(look.factor, 10.0**ten) else f"{look.factor:.3g}"
        yield ReadingRemark("unit", name, where, f"{name} reads about {size} times the model: is its unit another one?")
    if look.sign < 0.0:
        text = f"{name} reads against the model in {look.against:.0%} of its {KINDS[int(c.kind[rows[0]])]}s"
        yield ReadingRemark("sensor-sign", name, where, f"{text}: is it reversed?")


def find_doubts(campaign: Campaign, predicted: Array) -> Doubts:
    """What deflections and deviations look like beside a prediction: instruments alike are doubted together.

    Parameters
    ----------
    campaign
        With n readings.
    predicted
        (n,) what the nominal model says of each.
    """
    c = campaign
    factors: dict[str, float] = {}
    signs: dict[str, float] = {}
    steps: dict[str, tuple[Row, float, bool]] = {}
    turning: dict[str, bool] = {}
    channels = [(name, rows) for name, rows in _channels(c) if int(c.kind[rows[0]]) <= DEVIATION]
    for (_, rows), look in zip(channels, _look_at_all(c, channels, predicted), strict=True):
        value, model = c.value[rows], predicted[rows]
        if not _is_comparable(value, model):
            continue
        name = c.instruments[int(c.channel[rows[0]])]
        turning[name] = bool(c.direction[rows[0]] >= 3)
        if look is not None and np.isfinite(look.factor):
            factors.setdefault(name, look.factor)
        if look is not None and look.sign:
            signs.setdefault(name, look.sign)
        step = _find_jump(_scatter(c, rows, value, model))
        if step is not None:
            row, usual = int(rows[step[0]]), float(np.sqrt(np.mean(model**2)))
            steps.setdefault(name, ((int(c.file[row]), int(c.line[row])), usual, turning[name]))
    at_tool = {name for name in turning if name not in {sensor.name for sensor in c.sensors}}
    family = at_tool or set(turning)
    families = {
        INSTRUMENT: family,
        TRANSLATION: {name for name in family if not turning[name]},
        ROTATION: {name for name in family if turning[name]},
    }
    units = _gather(factors, families)
    return Doubts(units, tuple(_gather(signs, families)), steps)


def _gather(seen: Mapping[str, float], families: Mapping[str, set[str]]) -> dict[str, float]:
    """What is not one by instrument, or by family where all of whose members that say anything say the same."""
    out, left = dict[str, float](), dict(seen)
    for family, members in families.items():
        values = {left[name] for name in members & set(left)}
        if len(values) == 1 and len(members & set(left)) > 1 and values != {1.0}:
            out[family] = values.pop()
            left = {name: value for name, value in left.items() if name not in members}
    return out | {name: value for name, value in left.items() if value != 1.0}


def _varies_as_much(value: Array, model: Array) -> bool:
    """Whether values (n,) without their median vary as the model's do, with either sign."""
    size = np.linalg.norm(value) * np.linalg.norm(model)
    return len(value) >= 2 * LEAST and bool(abs(float(value @ model)) > _AGREE * size)


def _scatter(c: Campaign, rows: Indices, value: Array, model: Array) -> Array:
    """What a robust fit by prediction, wrench and a constant leaves of readings (r,)."""
    columns = np.column_stack([model, np.nan_to_num(c.wrench[rows]), np.ones(len(rows))])
    columns = columns[:, np.abs(columns).max(axis=0) > 0]
    columns = columns / np.abs(columns).max(axis=0)
    weight = np.ones(len(rows))
    left = np.asarray(value, dtype=float)
    for _ in range(30):
        fit: Any = np.linalg.lstsq(columns * weight[:, None], value * weight, rcond=1e-9)[0]  # pyright: ignore[reportUnknownVariableType]
        left = np.asarray(value - columns @ fit, dtype=float)
        weight = np.sqrt(1.0 / (1.0 + (left / max(2.0 * _spread(left), 1e-300)) ** 2))
    return left


def _spread(values: Array) -> float:
    """Standard deviation of what is normal among values (n,)."""
    return 1.4826 * float(np.median(np.abs(values - np.median(values))))


def _centre(values: Array) -> Array:
    return values - np.median(values)


def _find_breaks(c: Campaign, name: str, rows: Indices, left: Array) -> Iterator[ReadingRemark]:
    """Remarks on a step from one row on, and on single rows beside it."""
    step = _find_jump(left)
    if step is not None:
        place, jump = step
        where, unit = c.where(int(rows[place])), "rad" if c.direction[rows[0]] >= 3 else "m"
        text = f"{name} jumps by {jump:.2g} {unit} at {where} and stays there: has it slipped?"
        yield ReadingRemark("sensor-step", name, (where,), text)
        left = np.where(np.arange(len(left)) >= place, left - jump, left)
    yield from _name_outliers(c, name, rows, _centre(left))


def _find_jump(left: Array) -> tuple[int, float] | None:
    """From where on a scatter (r,) has another level, and by how much; None where it has one."""
    place = _find_step(left)
    if not place:
        return None
    jump = float(np.median(left[place:]) - np.median(left[:place]))
    after = _spread(np.where(np.arange(len(left)) >= place, left - jump, left))
    return (place, jump) if abs(jump) > _JUMP * after and _spread(left) > _CLEARED * after else None


def _find_step(values: Array) -> int:
    """Where values (n,) are best parted into two levels; 0 where they are too few."""
    count = len(values)
    if count < 2 * (_SIDE + 1):
        return 0
    clipped = np.clip(_centre(values), -10 * _spread(values), 10 * _spread(values))
    total = np.cumsum(clipped)[_SIDE - 1 : count - _SIDE]
    before = np.arange(_SIDE, count - _SIDE + 1)
    gain = total**2 / before + (clipped.sum() - total) ** 2 / (count - before)
    return int(before[np.argmax(gain)])


def _name_outliers(c: Campaign, name: str, rows: Indices, left: Array) -> Iterator[ReadingRemark]:
    """A remark on the few rows that stand far out of a scatter (r,) about zero."""
    sigma = np.nan_to_num(c.sigma[rows]) / np.where(c.relative[rows], np.abs(c.value[rows]), 1.0)
    size = np.abs(left)
    usual: Flags = size <= _JUMP * np.maximum(_spread(left), sigma)
    far = ~usual & (size > _APART * size[usual].max(initial=0.0))  # faults of the robot leave long tails
    if not 0 < far.sum() <= max(1, _RARE * len(rows)) or len(rows) < 3 * LEAST:
        return
    yield _name_rows(c, name, rows[np.flatnonzero(far)[np.argsort(-np.abs(left[far]))]])


def _name_rows(c: Campaign, name: str, rows: Indices) -> ReadingRemark:
    """A remark on rows that stand far out."""
    where = tuple(c.where(int(row)) for row in rows)
    more = f" and {len(where) - _SHOWN} more" if len(where) > _SHOWN else ""
    text = f"{name} stands far out of its other readings at {', '.join(where[:_SHOWN])}{more}"
    return ReadingRemark("outlier", name, where, text)


def _find_copied(c: Campaign, channels: list[tuple[str, Indices]]) -> Iterator[ReadingRemark]:
    """Remarks on channels whose readings are those of another, to the last digit."""
    known: dict[bytes, str] = {}
    for name, rows in channels:
        key = c.value[rows].tobytes()
        other = known.setdefault(key, name)
        if other != name and np.ptp(c.value[rows]):
            text = f"{name} has the readings of {other} to the last digit: is it a copy?"
            yield ReadingRemark("copied", name, (c.where(int(rows[0])),), text)
