"""Diagnosis of a campaign as plain dataclasses, and its JSON form."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING, Any, cast

from stiffscope.gap.inference.residuals import AbsoluteGap
from stiffscope.runtime.brief import describe_briefly
from stiffscope.runtime.formats import to_dataframe

if TYPE_CHECKING:
    import pandas as pd  # pyright: ignore[reportMissingTypeStubs]

    from stiffscope.gap.inference.posterior_samples import Samples
    from stiffscope.runtime.types import Array, Complex


@dataclass(frozen=True)
class Parameter:
    """A fitted parameter with its standard uncertainty, SI; NaN where readings do not determine it."""

    value: float
    sigma: float
    unit: str
    plausible: bool = True
    interval: tuple[float, float] = (math.nan, math.nan)
    """95 % credible interval."""
    nominal: float | None = None
    """Value in the model; None if it has none."""


@dataclass(frozen=True)
class Effect:
    """An effect of the set that explains the gap."""

    effect: str
    place: str
    probability: float
    gap_after: float
    """Gap left by this effect alone, % rms."""
    parameters: dict[str, Parameter] = field(default_factory=dict[str, Parameter])
    confused_with: tuple[str, ...] = ()
    """Indistinguishable effects, as `effect @ place`, including nuisance patterns."""
    share: float = math.nan
    """Shapley share of the explained misfit; the shares of all effects sum to 1."""
    group_probability: float = math.nan
    """Probability that this effect or one of `confused_with` is present."""
    errors: dict[str, Parameter] = field(default_factory=dict[str, Parameter])
    """Individual small errors by name, if `parameters` summarize them, the largest first."""


@dataclass(frozen=True)
class DriveStiffness:
    """Stiffness of a drive with everything that was found, N/m or N·m/rad."""

    stated: float
    value: float
    sigma: float
    """Standard uncertainty; NaN if the readings do not show the drive."""
    seen: bool


@dataclass(frozen=True)
class Adoptable:
    """What a robot file may take over: all causes that are certain, with values that need no others."""

    effects: tuple[Effect, ...]
    drives: dict[str, DriveStiffness]
    """Resulting stiffness of each drive with these, by joint."""
    left_out: tuple[Effect, ...] = ()
    """Effects fitted jointly with the named ones that are not certain."""


@dataclass(frozen=True)
class ResponseModes:
    """A measured mode with the computed ones of the same shape; NaN without one."""

    measured: float
    """Frequency, Hz."""
    before: float
    """Of the nominal model, Hz."""
    after: float
    """With the effects found, Hz."""
    zeta: float
    """Damping ratio, as fitted with these."""
    mac_before: float
    """Modal assurance criterion, 0 to 1, of the shapes at the points."""
    mac_after: float


@dataclass(frozen=True, eq=False)
class ResponseLines:
    """One response at its lines ``hertz`` (f,), m/N: measured, nominal, with the effects found."""

    name: str
    hertz: Array
    measured: Complex
    before: Complex
    after: Complex
    noise: Array
    """Standard deviation (f,) of the real, and of the imaginary part."""


@dataclass(frozen=True)
class SetupModes:
    """Modes of one set-up of responses, and rms differences of its levels, dB."""

    modes: tuple[ResponseModes, ...]
    before: float
    after: float
    noise: float
    lines: tuple[ResponseLines, ...] = ()
    """Not in JSON."""


@dataclass(frozen=True)
class Possible:
    """An effect that may be present, without certainty."""

    effect: str
    place: str
    probability: float


@dataclass(frozen=True)
class Alternative:
    """An effect that was considered but is not part of the diagnosis."""

    effect: str
    place: str
    probability: float
    gap_after: float
    why_not: str


@dataclass(frozen=True)
class Gap:
    """Gap between model and measurement, % rms, and χ² per reading before and after."""

    nominal: float
    explained: float
    held_out: float
    noise: float
    chi2_per_reading: tuple[float, float]
    left: float = math.nan
    """Remaining gap beyond the noise, % rms: sqrt(explained² - noise²)."""
    discrepancy: float = math.nan
    """Inferred size of another unknown cause, % of the readings; 0 without evidence for one."""
    absolute: dict[str, AbsoluteGap] = field(default_factory=dict[str, AbsoluteGap])
    """By kind: displacement, rotation, position, distance, (rotational) stiffness, frequency."""


@dataclass(frozen=True)
class Where:
    """Shares of the nominal model's residuals; each dictionary sums to one."""

    direction: dict[str, float]
    component: dict[str, float] = field(default_factory=dict[str, float])
    pose_names: tuple[str, ...] = ()
    rows: tuple[str, ...] = ()
    """File and line of the first reading at each pose; "" at one without readings."""
    pose: tuple[tuple[float, ...], ...] = ()
    """Rms residuals over sigma by pose and direction (x y z rx ry rz); NaN if not read."""
    unexplained: tuple[tuple[float, ...], ...] = ()
    """As `pose`, with the diagnosed effects."""
    left: dict[str, float] = field(default_factory=dict[str, float])
    """By direction, with the diagnosed effects; empty if these reduce the gap to the noise."""
    sensor: dict[str, float] = field(default_factory=dict[str, float])
    """By sensor and by axis at M."""
    left_by_sensor: dict[str, float] = field(default_factory=dict[str, float])
    """As `sensor`, with the diagnosed effects; empty if these reduce the gap to the noise."""


@dataclass(frozen=True)
class NextMeasurement:
    """Proposed next measurement, and the explanations that it distinguishes."""

    separates: tuple[str, ...]
    expected_gain: float
    """Expected ln-odds between these explanations."""
    position: dict[str, float] | None = None
    """Commanded coordinates by name, m and rad; None if poses are labels."""
    label: str | None = None
    """Drives' coordinates of the position in mm and degrees."""
    wrench: tuple[float, ...] | None = None
    pose: str | None = None
    quantity: str | None = None
    sensors: tuple[str, ...] | None = None
    """Sensors to read, unless the quantity is read at M."""
    load: str | None = None
    """Load point, unless M is loaded."""
    new: dict[str, dict[str, Any]] | None = None
    """Sensors and load points that the campaign lacks, by name, as in campaign.toml."""


@dataclass(frozen=True)
class Sensitivity:
    """Verdict under another prior."""

    prior: str
    """Prior quantity that is ten times larger or smaller."""
    verdict: str
    probability: dict[str, float] = field(default_factory=dict[str, float])
    """Probability of every named effect, as `effect @ place`."""


@dataclass(frozen=True)
class HeldOut:
    """Check of readings predicted by effects fitted without their pose."""

    inside_95: float
    """Fraction of readings within their 95 % predictive interval."""
    chi2_per_reading: float
    """χ² per reading with the predictive standard deviation."""


@dataclass(frozen=True)
class Diagnosis:
    """Verdict, gap, effects, alternatives, location of the gap and next measurement."""

    __repr__ = describe_briefly

    verdict: str
    """identified, partly, ambiguous, unexplained or no-gap."""
    gap: Gap
    effects: tuple[Effect, ...]
    alternatives: tuple[Alternative, ...]
    where: Where
    next_measurement: NextMeasurement | None = None
    why_no_next: str = ""
    """Why no reading is proposed for causes that these readings do not distinguish."""
    remarks: tuple[str, ...] = ()
    steps: tuple[tuple[str, float], ...] = ()
    """Gap in % rms: nominal, after each effect alone, after all, held out, and by noise alone."""
    signature_correlation: tuple[tuple[str, ...], tuple[tuple[float, ...], ...]] = (
        (),
        (),
    )
    """Effects and signature correlations (1: indistinguishable from these readings)."""
    possible: tuple[Possible, ...] = ()
    """Effects that are merely possible besides the named ones."""
    responses: dict[str, SetupModes] = field(default_factory=dict[str, SetupModes])
    """Modes of each set-up of frequency responses, by name."""
    drives: dict[str, DriveStiffness] = field(default_factory=dict[str, DriveStiffness])
    """Resulting stiffness of each drive, by joint; set and member multiplied out."""
    sensitivity: tuple[Sensitivity, ...] = ()
    held_out_check: HeldOut | None = None
    samples: Samples | None = field(default=None, repr=False, compare=False)
    """Posterior samples, for `posterior.nc` and the figures."""
    beside: tuple[Effect, ...] = ()
    """Uncertain effects fitted jointly with the named ones; "unknown" for nuisance patterns."""
    adoptable: Adoptable | None = field(default=None, repr=False, compare=False)
    """Not in JSON."""

    def to_pandas(self) -> pd.DataFrame:
        """Return named effects, one row per parameter: value, sigma, 95 % interval, unit; SI."""
        rows = [
            (
                e.effect,
                e.place,
                e.probability,
                e.share,
                name,
                p.value,
                p.sigma,
                *p.interval,
                p.unit,
            )
            for e in self.effects
            for name, p in e.parameters.items()
        ]
        columns = (
            "effect",
            "place",
            "probability",
            "share",
            "parameter",
            "value",
            "sigma",
            "low",
            "high",
            "unit",
        )
        table = {column: [row[k] for row in rows] for k, column in enumerate(columns)}
        return to_dataframe(table)


def to_json(diagnosis: Diagnosis) -> dict[str, Any]:
    """Return the diagnosis as plain data for `diagnosis.json`; missing numbers are null."""
    alone = {k: replace(each, lines=()) for k, each in diagnosis.responses.items()}
    data = asdict(replace(diagnosis, samples=None, adoptable=None, responses=alone))
    for each in data["responses"].values():
        del each["lines"]
    for key in ("steps", "signature_correlation", "samples", "adoptable"):
        del data[key]
    data["gap"]["unit"] = "% rms"
    data["where"]["poses"] = data["where"].pop("pose_names")
    step = data["next_measurement"]
    if step is not None:
        position: dict[str, Any] = step.pop("position") or {}
        known = {key: value for key, value in step.items() if value is not None}
        data["next_measurement"] = position | known
    return _to_plain(data)


def _to_plain(value: Any) -> Any:
    """Convert tuples to lists and non-finite numbers to None."""
    match value:
        case dict():
            return {
                key: _to_plain(item)
                for key, item in cast("dict[str, Any]", value).items()
            }
        case list() | tuple():
            return [_to_plain(item) for item in cast("list[Any]", value)]
        case float():
            return value if math.isfinite(value) else None
        case _:
            return value
