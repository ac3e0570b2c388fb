"""The diagnosis of a campaign as plain dataclasses, and the JSON that carries it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

VERDICTS = ("identified", "ambiguous", "unexplained", "no-gap")


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
    """Effects, as `effect @ place`, that these readings cannot distinguish from it."""


@dataclass(frozen=True)
class Alternative:
    """An effect that was considered and is not in the diagnosis."""

    effect: str
    place: str
    probability: float
    gap_after: float
    why_not: str


@dataclass(frozen=True)
class Gap:
    """% rms between model and measurement, and χ² per reading before and after."""

    nominal: float
    explained: float
    held_out: float
    noise: float
    chi2_per_reading: tuple[float, float]


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


@dataclass(frozen=True)
class NextMeasurement:
    """What to read next, and which explanations that separates."""

    separates: tuple[str, ...]
    expected_gain: float
    """Expected ln-odds between them."""
    position: tuple[float, float, float] | None = None
    wrench: tuple[float, ...] | None = None
    pose: str | None = None
    quantity: str | None = None


@dataclass(frozen=True)
class Diagnosis:
    """Verdict, gap, effects and alternatives, location, next measurement."""

    verdict: str
    gap: Gap
    effects: tuple[Effect, ...]
    alternatives: tuple[Alternative, ...]
    where: Where
    next_measurement: NextMeasurement | None = None
    remarks: tuple[str, ...] = ()
    steps: tuple[tuple[str, float], ...] = ()
    """The gap in % rms before, after each effect alone, together, held out, and by the noise alone."""
    signature_correlation: tuple[tuple[str, ...], tuple[tuple[float, ...], ...]] = ((), ())
    """Effects and |cosine| between their signatures; 1: indistinguishable from these readings."""


def _number(value: float) -> float | None:
    return None if value != value or value in {float("inf"), float("-inf")} else float(value)  # noqa: PLR0124


def _grid(rows: tuple[tuple[float, ...], ...]) -> list[list[float | None]]:
    return [[_number(value) for value in row] for row in rows]


def _effect(effect: Effect) -> dict[str, Any]:
    parameters = {
        name: {"value": p.value, "sigma": _number(p.sigma), "unit": p.unit, "plausible": p.plausible}
        for name, p in effect.parameters.items()
    }
    return {
        "effect": effect.effect,
        "place": effect.place,
        "probability": effect.probability,
        "parameters": parameters,
        "gap_after": _number(effect.gap_after),
        "confused_with": list(effect.confused_with),
    }


def _next(step: NextMeasurement | None) -> dict[str, Any] | None:
    if step is None:
        return None
    out: dict[str, Any] = {}
    if step.position is not None:
        out |= dict(zip("xyz", step.position, strict=True))
    if step.wrench is not None:
        out["wrench"] = list(step.wrench)
    out |= {name: v for name, v in (("pose", step.pose), ("quantity", step.quantity)) if v is not None}
    return {**out, "separates": list(step.separates), "expected_gain": _number(step.expected_gain)}


def to_json(diagnosis: Diagnosis) -> dict[str, Any]:
    """The diagnosis as the plain data of `diagnosis.json`; a number that does not exist is null."""
    gap, where = diagnosis.gap, diagnosis.where
    alternatives = [
        {
            "effect": a.effect,
            "place": a.place,
            "probability": a.probability,
            "gap_after": _number(a.gap_after),
            "why_not": a.why_not,
        }
        for a in diagnosis.alternatives
    ]
    return {
        "verdict": diagnosis.verdict,
        "gap": {
            "nominal": _number(gap.nominal),
            "explained": _number(gap.explained),
            "held_out": _number(gap.held_out),
            "noise": _number(gap.noise),
            "unit": "% rms",
            "chi2_per_reading": [_number(chi2) for chi2 in gap.chi2_per_reading],
        },
        "effects": [_effect(effect) for effect in diagnosis.effects],
        "alternatives": alternatives,
        "where": {
            "direction": where.direction,
            "component": where.component,
            "pose": _grid(where.pose),
            "poses": list(where.pose_names),
            "unexplained": _grid(where.unexplained),
        },
        "next_measurement": _next(diagnosis.next_measurement),
        "remarks": list(diagnosis.remarks),
    }
