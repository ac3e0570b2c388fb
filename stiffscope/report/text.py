"""A diagnosis in words and numbers with units, for the terminal and for the page alike."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np

    from stiffscope.gap.diagnosis import Diagnosis, Effect, NextMeasurement, Parameter, Where

DIRECTIONS = ("x", "y", "z", "rx", "ry", "rz")
_PREFIXES = ((1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n"), (1e-12, "p"))


def sentence(diagnosis: Diagnosis) -> str:
    """The verdict in one plain sentence."""
    gap = diagnosis.gap
    shrinks = (
        f"the gap shrinks from {percent(gap.nominal)} to {percent(gap.explained)} rms "
        f"({percent(gap.held_out)} at poses held out, noise {percent(gap.noise)})"
    )
    if diagnosis.verdict == "no-gap":
        sizes = f"{percent(gap.nominal)} rms, noise {percent(gap.noise)}"
        return f"No gap: model and readings agree within the noise ({sizes})."
    if diagnosis.verdict == "unexplained":
        place = _mostly(diagnosis.where)
        return (
            f"Unexplained: no effect that is known here accounts for the gap of {percent(gap.nominal)} rms "
            f"(noise {percent(gap.noise)}); it lies mostly in {place}."
        )
    named = " and ".join(_with_size(effect) for effect in diagnosis.effects) or "no effect"
    if diagnosis.verdict == "ambiguous":
        others = _rivals(diagnosis)
        return f"Ambiguous: {named} fits, but these readings cannot tell it from {others}; with it {shrinks}."
    return f"Identified: {named}; {shrinks}."


def percent(value: float) -> str:
    """A share in % with three digits."""
    return "unknown" if not math.isfinite(value) else f"{value:.3g} %"


def name(effect: str, place: str) -> str:
    """An effect and its place as people say them: actuator stiffness (limb1)."""
    return " + ".join(
        f"{what.replace('-', ' ')} ({where})"
        for what, where in zip(effect.split(" + "), place.split(" + "), strict=True)
    )


def _with_size(effect: Effect) -> str:
    first = next(iter(effect.parameters.items()), None)
    if first is None or len(effect.parameters) > 3:
        return name(effect.effect, effect.place)
    sizes = ", ".join(f"{key} {quantity(p)}" for key, p in effect.parameters.items())
    return f"{name(effect.effect, effect.place)}, {sizes}"


def _rivals(diagnosis: Diagnosis) -> str:
    named = {f"{e.effect} @ {e.place}" for e in diagnosis.effects}
    confused = dict.fromkeys(other for effect in diagnosis.effects for other in effect.confused_with)
    near = [f"{a.effect} @ {a.place}" for a in diagnosis.alternatives if a.probability > 0.02]
    others = [other for other in (confused or dict.fromkeys(near)) if other not in named]
    said = [name(*other.split(" @ ", 1)) if other.count(" @ ") == 1 else other for other in others[:4]]
    return ", ".join(said) + (" and others" if len(others) > 4 else "") or "no effect at all"


def _mostly(where: Where) -> str:
    most = sorted(where.direction, key=lambda axis: -where.direction[axis])[:2]
    return " and ".join(f"{axis} ({100 * where.direction[axis]:.0f} %)" for axis in most) or "no single direction"


def quantity(parameter: Parameter) -> str:
    """Value ± σ with two digits of σ, in the unit's own multiple: "5.00 ± 0.12 nm/N"."""
    factor, unit = _multiple(parameter)
    value, sigma = parameter.value / factor, parameter.sigma / factor
    if not (math.isfinite(sigma) and sigma > 0):
        return f"{value:.4g}{unit}"
    digits = max(1 - math.floor(math.log10(sigma)), 0)
    return f"{value:.4g} ± {sigma:.2g}{unit}" if digits > 9 else f"{value:.{digits}f} ± {sigma:.{digits}f}{unit}"


def beside(parameter: Parameter, nominal: float | None) -> str:
    """What the model has for a parameter, in the same unit; nothing where it has nothing."""
    factor, unit = _multiple(parameter)
    return "" if nominal is None else f"{nominal / factor:.4g}{unit}"


def _multiple(parameter: Parameter) -> tuple[float, str]:
    """Factor and unit that suit a parameter's size."""
    unit = parameter.unit
    if unit == "1":
        return 1.0, ""
    if unit.split("/")[0] not in {"m", "rad"}:
        return 1.0, f" {unit}"
    greatest = max(abs(parameter.value), parameter.sigma if math.isfinite(parameter.sigma) else 0.0)
    factor, prefix = next(((f, p) for f, p in _PREFIXES if greatest >= f), _PREFIXES[-1 if greatest else 0])
    return factor, f" {prefix}{unit}"


def chance(probability: float) -> str:
    """A probability; what is next to nothing is said to be so."""
    return f"{probability:.2g}" if probability >= 1e-6 else "< 1e-6"


def nominal_value(effect: str, parameter: str, slider: np.ndarray | None) -> float | None:
    """What the model under test has for a parameter: 1 for a factor, the slider's own entry, otherwise nothing."""
    if parameter == "factor":
        return 1.0
    if effect == "slider-compliance" and slider is not None:
        return float(slider[int(parameter[1]) - 1, int(parameter[2]) - 1])
    return None


def steps(diagnosis: Diagnosis) -> Sequence[tuple[str, float]]:
    """The waterfall: label and gap in % rms, from the model as it is down to the noise."""
    if diagnosis.steps:
        return diagnosis.steps
    gap = diagnosis.gap
    alone = [(f"{e.effect} @ {e.place}", e.gap_after) for e in diagnosis.effects]
    together = [("together", gap.explained)] if len(alone) > 1 else []
    return [("nominal", gap.nominal), *alone, *together, ("held out", gap.held_out), ("noise", gap.noise)]


def what_next(step: NextMeasurement) -> str:
    """The next measurement as an instruction."""
    place = f"at pose {step.pose}" if step.pose else ""
    if step.position is not None:
        place = f"at M = ({', '.join(f'{1e3 * c:.4g}' for c in step.position)}) mm"
    action = f"read {step.quantity} {place}" if step.quantity else f"measure {place}"
    if step.wrench is not None and any(step.wrench):
        parts = zip(("fx", "fy", "fz", "mx", "my", "mz"), step.wrench, ("N",) * 3 + ("N·m",) * 3, strict=True)
        action += " under " + ", ".join(f"{axis} = {value:.4g} {unit}" for axis, value, unit in parts if value)
    elif step.wrench is not None:
        action += " without load, against the commanded pose"
    return f"{action}: separates {' from '.join(step.separates)} (expected ln-odds {step.expected_gain:.3g})"


def located(where: Where) -> list[str]:
    """Where the gap lies: by direction, by component, and the worst poses."""
    lines = ["by direction: " + ", ".join(f"{axis} {100 * s:.0f} %" for axis, s in where.direction.items() if s > 5e-3)]
    shares = sorted(where.component.items(), key=lambda item: -item[1])
    if shares:
        lines.append("by component: " + ", ".join(f"{part} {100 * s:.0f} %" for part, s in shares[:6] if s > 5e-3))
    sizes = [math.sqrt(sum(v * v for v in row if math.isfinite(v))) for row in where.pose]
    worst = sorted(range(len(sizes)), key=lambda k: -sizes[k])[:3]
    if len(sizes) > 1:
        lines.append("worst poses: " + ", ".join(where.pose_names[k] for k in worst))
    return lines
