"""The diagnosis of a campaign as plain dataclasses, and the JSON that carries it."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING, Any, cast

from stiffscope.runtime.brief import describe_briefly

if TYPE_CHECKING:
    import pandas as pd  # pyright: ignore[reportMissingTypeStubs]

    from stiffscope.gap.inference.posterior_samples import Samples


def _empty_places() -> dict[str, float]:
    return {}


def _empty_parameters() -> dict[str, Parameter]:
    return {}


@dataclass(frozen=True)
class Parameter:
    """A fitted number with its standard uncertainty, SI."""

    value: float
    sigma: float
    unit: str
    plausible: bool = True
    interval: tuple[float, float] = (math.nan, math.nan)
    """Holds the true value with a probability of 95 %."""
    nominal: float | None = None
    """The model's value; None where it has none."""


@dataclass(frozen=True)
class Effect:
    """One effect of the set that explains the gap."""

    effect: str
    place: str
    probability: float
    gap_after: float
    """% rms left when it alone is added."""
    parameters: dict[str, Parameter] = field(default_factory=_empty_parameters)
    confused_with: tuple[str, ...] = ()
    """Effects, as `effect @ place`, that these readings cannot distinguish from it, nuisance patterns among them."""
    share: float = math.nan
    """Part of the explained misfit that is its own, by Shapley's value; the shares of all effects add up to 1."""
    group_probability: float = math.nan
    """Probability that it or one of what it is confused with is at work."""
    errors: dict[str, Parameter] = field(default_factory=_empty_parameters)
    """Of many small errors, which the parameters sum up, each by its name, the largest in its unit first."""


@dataclass(frozen=True)
class Possible:
    """An effect that may be at work, with nothing certain about it."""

    effect: str
    place: str
    probability: float


@dataclass(frozen=True)
class Alternative:
    """An effect that was considered and is not in the diagnosis."""

    effect: str
    place: str
    probability: float
    gap_after: float
    why_not: str


@dataclass(frozen=True)
class AbsoluteGap:
    """Rms between model and measurement of one kind of scalar reading, in its own unit."""

    unit: str
    before: float
    """Instruments, targets and zeros placed: they are no gap."""
    after: float
    held_out: float
    noise: float


def _empty_kinds() -> dict[str, AbsoluteGap]:
    return {}


@dataclass(frozen=True)
class Gap:
    """% rms between model and measurement, and χ² per reading before and after."""

    nominal: float
    explained: float
    held_out: float
    noise: float
    chi2_per_reading: tuple[float, float]
    left: float = math.nan
    """What is left beyond the noise, % rms: sqrt(explained² - noise²)."""
    discrepancy: float = math.nan
    """Size of an unknown cause beside the effects as inferred, % of the readings; 0 where nothing speaks for one."""
    absolute: dict[str, AbsoluteGap] = field(default_factory=_empty_kinds)
    """By kind of reading: displacement, rotation, position, distance, stiffness, rotational stiffness, frequency."""


@dataclass(frozen=True)
class Where:
    """Shares of the nominal model's residuals; each dictionary adds up to one."""

    direction: dict[str, float]
    component: dict[str, float] = field(default_factory=_empty_places)
    pose_names: tuple[str, ...] = ()
    pose: tuple[tuple[float, ...], ...] = ()
    """Rms of the residuals in standard deviations, pose by direction (x y z rx ry rz); NaN where nothing was read."""
    unexplained: tuple[tuple[float, ...], ...] = ()
    """The same with the diagnosed effects."""
    left: dict[str, float] = field(default_factory=_empty_places)
    """By direction, of what the diagnosed effects leave; empty where they bring the gap to the noise."""
    sensor: dict[str, float] = field(default_factory=_empty_places)
    """By sensor, and by axis at M."""
    left_by_sensor: dict[str, float] = field(default_factory=_empty_places)
    """The same of what the diagnosed effects leave; empty where they bring the gap to the noise."""


@dataclass(frozen=True)
class NextMeasurement:
    """What to read next, and which explanations that separates."""

    separates: tuple[str, ...]
    expected_gain: float
    """Expected ln-odds between them."""
    position: dict[str, float] | None = None
    """Commanded coordinates by name, m and rad; None where poses are labels."""
    wrench: tuple[float, ...] | None = None
    pose: str | None = None
    quantity: str | None = None
    sensors: tuple[str, ...] | None = None
    """The campaign's sensors to read, where it is not a quantity at M."""
    load: str | None = None
    """The campaign's point to load, where it is not M."""


@dataclass(frozen=True)
class Sensitivity:
    """The verdict under another prior."""

    prior: str
    """What is ten times as large or as small."""
    verdict: str
    probability: dict[str, float] = field(default_factory=_empty_places)
    """Of every effect named, as `effect @ place`."""


@dataclass(frozen=True)
class HeldOut:
    """Readings predicted by the effects as fitted without their pose."""

    inside_95: float
    """Share of them within their 95 % predictive interval."""
    chi2_per_reading: float
    """By the predictive standard deviation."""


@dataclass(frozen=True)
class Diagnosis:
    """Verdict, gap, effects and alternatives, location, next measurement."""

    __repr__ = describe_briefly

    verdict: str
    """identified, partly, ambiguous, unexplained or no-gap."""
    gap: Gap
    effects: tuple[Effect, ...]
    alternatives: tuple[Alternative, ...]
    where: Where
    next_measurement: NextMeasurement | None = None
    remarks: tuple[str, ...] = ()
    steps: tuple[tuple[str, float], ...] = ()
    """The gap in % rms before, after each effect alone, together, held out, and by the noise alone."""
    signature_correlation: tuple[tuple[str, ...], tuple[tuple[float, ...], ...]] = ((), ())
    """Effects and the cosine's size between their signatures; 1: indistinguishable from these readings."""
    possible: tuple[Possible, ...] = ()
    """Effects that are merely possible beside the named ones."""
    sensitivity: tuple[Sensitivity, ...] = ()
    held_out_check: HeldOut | None = None
    samples: Samples | None = field(default=None, repr=False, compare=False)
    """Draws from the posterior, for `posterior.nc` and the figures."""
    beside: tuple[Effect, ...] = ()
    """What the parameters were fitted beside without being certain; of the effect "unknown" what has no word."""

    def to_pandas(self) -> pd.DataFrame:
        """Return the named effects, a row for each parameter: value, sigma, unit, ends of the 95 % interval; SI."""
        import pandas as pd  # pyright: ignore[reportMissingTypeStubs]

        rows = [
            (e.effect, e.place, e.probability, e.share, name, p.value, p.sigma, *p.interval, p.unit)
            for e in self.effects
            for name, p in e.parameters.items()
        ]
        columns = "effect", "place", "probability", "share", "parameter", "value", "sigma", "low", "high", "unit"
        return pd.DataFrame(rows, columns=columns)


def to_json(diagnosis: Diagnosis) -> dict[str, Any]:
    """The diagnosis as the plain data of `diagnosis.json`; a number that does not exist is null."""
    data = asdict(replace(diagnosis, samples=None))
    del data["steps"], data["signature_correlation"], data["samples"]
    data["gap"]["unit"] = "% rms"
    data["where"]["poses"] = data["where"].pop("pose_names")
    step = data["next_measurement"]
    if step is not None:
        position: dict[str, Any] = step.pop("position") or {}
        data["next_measurement"] = position | {key: value for key, value in step.items() if value is not None}
    return _to_plain(data)


def _to_plain(value: Any) -> Any:
    """Tuples as lists, numbers that are not finite as None."""
    match value:
        case dict():
            return {key: _to_plain(item) for key, item in cast("dict[str, Any]", value).items()}
        case list() | tuple():
            return [_to_plain(item) for item in cast("list[Any]", value)]
        case float():
            return value if math.isfinite(value) else None
        case _:
            return value
