"""Text of a diagnosis with numbers and units, for the terminal and the page."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from stiffscope.gap.forward.forward_model import UNNAMED
from stiffscope.report.numbers import WRENCH, name_pose, percent, point, vector

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stiffscope.gap.inference.diagnosis import (
        Diagnosis,
        Effect,
        Gap,
        NextMeasurement,
        Parameter,
        Where,
    )
    from stiffscope.robot.file.description import RobotFile

DIRECTIONS = ("x", "y", "z", "rx", "ry", "rz")
NOTABLE = (
    3.0  # difference from the model's value, in σ, above which a parameter is marked
)
COVERED = 0.9  # least share of readings held out within their 95 % intervals
_PREFIXES = ((1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n"), (1e-12, "p"))


def sentence(diagnosis: Diagnosis) -> str:
    """Return the verdict in one plain sentence, and whether the noise should be stated."""
    verdict = _tell_verdict(diagnosis)
    if any(remark.endswith("state sigma") for remark in diagnosis.remarks):
        return f"{verdict} These readings do not tell their noise: state sigma."
    return verdict


def _tell_verdict(diagnosis: Diagnosis) -> str:
    gap = diagnosis.gap
    nominal, explained, held_out, noise = gap_sizes(gap)
    others = f"noise {noise}"
    if held_out:
        others = f"{held_out} at poses held out, {others}"
    shrinks = f"the gap shrinks from {nominal} to {explained} rms ({others})"
    if diagnosis.verdict == "no-gap":
        return f"No gap: model and readings agree within the noise ({nominal} rms, noise {noise})."
    if diagnosis.verdict == "unexplained":
        return (
            f"Unexplained: no known effect accounts for the gap of {nominal} rms "
            f"(noise {noise}); it lies mostly in {_largest(diagnosis.where.direction)}."
        )
    sentences = []
    for effect in diagnosis.effects:
        few = effect.parameters.items() if len(effect.parameters) <= 3 else ()
        sizes = (f", {key} {quantity(parameter)}" for key, parameter in few)
        sentences.append("".join([name(effect.effect, effect.place), *sizes]))
    named = " and ".join(sentences) or "no effect"
    if diagnosis.verdict == "ambiguous":
        rivals = f"these readings cannot distinguish it from {_rivals(diagnosis)}"
        return f"Ambiguous: {named} fits, but {rivals}; with it {shrinks}.{_proposal(diagnosis)}"
    if diagnosis.verdict == "partly":
        rest = _largest(diagnosis.where.left or diagnosis.where.direction)
        size = (
            f"{percent(gap.left)} rms beyond" if gap.left > 0.0 else "something within"
        )
        left = f"{size} the noise remains unexplained, mostly in {rest}"
        return f"Partly: {named}; {shrinks}; {left}.{_group(diagnosis)}"
    return f"Identified: {named}; {shrinks}.{_group(diagnosis)}"


def warning(diagnosis: Diagnosis) -> str:
    """Return what casts doubt on all probabilities: too many readings outside their intervals."""
    held = diagnosis.held_out_check
    if held is None or not diagnosis.effects or held.inside_95 >= COVERED:
        return ""
    return (
        f"Only {100 * held.inside_95:.1f} % of the readings at poses held out lie within their "
        "95 % intervals: something is missing, and the probabilities only compare what is known."
    )


def certainty(value: float) -> str:
    """Return a probability with four digits, never as one."""
    return f"{value:.4f}" if value < 0.99995 else "> 0.9999"


def gap_sizes(gap: Gap) -> tuple[str, ...]:
    """Return gap before, after, held out, and noise; in mm or mrad if readings are of one kind.

    Empty at a single pose, at which nothing can be held out.
    """
    known = absolute_sizes(gap)
    if len(known) == len(gap.absolute) == 1:
        return next(iter(known.values()))
    sizes = (gap.nominal, gap.explained, gap.held_out, gap.noise)
    return tuple(percent(v) if math.isfinite(v) else "" for v in sizes)


def absolute_sizes(gap: Gap) -> dict[str, tuple[str, ...]]:
    """Return gap before, after, held out, and noise of each kind of motion, in mm or mrad."""
    sizes: dict[str, tuple[str, ...]] = {}
    for name, each in gap.absolute.items():
        if each.unit in {"m", "rad"}:
            known = (each.before, each.after, each.held_out, each.noise)
            sizes[name] = tuple(
                f"{1e3 * value:.3g} m{each.unit}" if math.isfinite(value) else ""
                for value in known
            )
    return sizes


def _group(diagnosis: Diagnosis) -> str:
    """Return the confusable effects, and the reading that would distinguish them."""
    note = ""
    for effect in diagnosis.effects:
        if effect.confused_with:
            pair = f"{name(effect.effect, effect.place)} from {_list_keys(effect.confused_with)}"
            note += f" These readings cannot distinguish {pair}."
    return note and note + _proposal(diagnosis)


def _proposal(diagnosis: Diagnosis) -> str:
    words = next_step(diagnosis)
    return f" Next: {words}." if words else ""


def _list_keys(keys: Sequence[str], most: int = 3) -> str:
    """Return effects by name, up to three; more as the set that holds them."""
    if len(keys) <= most:
        return ", ".join(map(label, keys))
    words = {key.partition(" @ ")[0] for key in keys}
    if len(words) == 1:
        return f"{next(iter(words)).replace('-', ' ')}: {len(keys)} causes"
    return f"{', '.join(map(label, keys[:most]))} and {len(keys) - most} others"


def name(effect: str, place: str) -> str:
    """Return an effect and its place in words: "actuator stiffness (limb1)"."""
    return " + ".join(
        f"{what.replace('-', ' ')} ({where})"
        for what, where in zip(effect.split(" + "), place.split(" + "), strict=True)
    )


def label(key: str) -> str:
    """Return "actuator-stiffness @ limb1" or a nuisance pattern in words; other text unchanged."""
    effect, _, place = key.partition(" @ ")
    return (
        place
        if effect == UNNAMED
        else name(effect, place)
        if key.count(" @ ") == 1
        else key
    )


def _rivals(diagnosis: Diagnosis) -> str:
    named = {f"{e.effect} @ {e.place}" for e in diagnosis.effects}
    confused = [other for effect in diagnosis.effects for other in effect.confused_with]
    near = [
        f"{a.effect} @ {a.place}"
        for a in diagnosis.alternatives
        if a.probability > 0.02
    ]
    others = [other for other in dict.fromkeys(confused or near) if other not in named]
    return _list_keys(others) or "no effect at all"


def _largest(share: dict[str, float]) -> str:
    largest = sorted(share.items(), key=lambda each: -each[1])[:2]
    return (
        " and ".join(f"{axis} ({100 * s:.0f} %)" for axis, s in largest)
        or "no single direction"
    )


def parameters(effect: Effect) -> list[tuple[str, ...]]:
    """Return a row for each parameter of an effect, empty where there is nothing to say.

    Name, value, model's value, 95 % interval, ratio to the model's value, deviation from it (0 if
    it has none) in standard uncertainties, and a remark if that exceeds `NOTABLE`.
    """
    rows: list[tuple[str, ...]] = []
    for key, p in effect.parameters.items():
        nominal = p.nominal
        (factor, unit) = _multiple(p)
        deviation = (p.value - (nominal or 0.0)) / p.sigma if p.sigma > 0 else math.nan
        low, high = (end / factor for end in p.interval)
        differs = nominal is not None and abs(deviation) > NOTABLE
        rows.append(
            (
                key,
                quantity(p) + ("" if p.plausible else " (not plausible)"),
                "" if nominal is None else f"{nominal / factor:.4g}{unit}",
                f"{low:.4g} to {high:.4g}{unit}" if math.isfinite(high - low) else "",
                f"{p.value / nominal:.4g}" if nominal else "",
                f"{deviation:+.1f}" if math.isfinite(deviation) else "",
                "differs from the model" if differs else "",
            )
        )
    return rows


def quantity(parameter: Parameter) -> str:
    """Return value ± σ with two digits of σ in a suitable unit: "5.00 ± 0.12 nm/N"."""
    if math.isnan(parameter.value):
        return "undetermined"
    factor, unit = _multiple(parameter)
    value = parameter.value / factor
    sigma = parameter.sigma / factor
    if not (math.isfinite(sigma) and sigma > 0):
        return f"{value:.4g}{unit}"
    digits = max(1 - math.floor(math.log10(sigma)), 0)
    if digits > 9:
        return f"{value:.4g} ± {sigma:.2g}{unit}"
    return f"{value:z.{digits}f} ± {sigma:.{digits}f}{unit}"


def _multiple(parameter: Parameter) -> tuple[float, str]:
    """Return factor and unit suitable for a parameter's size."""
    unit = parameter.unit
    if unit == "1":
        return 1.0, ""
    if unit.split("/")[0] not in {"m", "rad"}:
        return 1.0, f" {unit}"
    greatest = max(
        abs(parameter.value), parameter.sigma if math.isfinite(parameter.sigma) else 0.0
    )
    least = _PREFIXES[-1 if greatest else 0]
    factor, prefix = next((start for start in _PREFIXES if greatest >= start[0]), least)
    return factor, f" {prefix}{unit}"


def drives(diagnosis: Diagnosis) -> list[tuple[str, str, str, str]]:
    """Return a row for each drive: joint, stated stiffness, resulting one, and its ratio."""
    rows: list[tuple[str, str, str, str]] = []
    for joint, drive in diagnosis.drives.items():
        stated = f"{drive.stated:.4g}"
        if not drive.seen:
            rows.append((joint, stated, "not seen by these readings", ""))
            continue
        ratio = drive.value / drive.stated
        value = f"{drive.value:.4g} ± {drive.sigma:.2g}"
        rows.append((joint, stated, value, f"{ratio:.3f}"))
    return rows


def probability(value: float) -> str:
    """Return a probability with two digits, or "< 1e-6"."""
    return f"{value:.2g}" if value >= 1e-6 else "< 1e-6"


def possible(diagnosis: Diagnosis) -> list[str]:
    """Return the merely possible effects with their probabilities."""
    return [
        f"{name(p.effect, p.place)}: {probability(p.probability)}"
        for p in diagnosis.possible
    ]


def checks(diagnosis: Diagnosis) -> list[str]:
    """Return checks of the diagnosis: sensitivity to the prior, prediction of held-out poses."""
    lines = [
        f"{s.prior}: {s.verdict}"
        + "".join(
            f", {label(effect)} {probability(p)}" for effect, p in s.probability.items()
        )
        for s in diagnosis.sensitivity
    ]
    held = diagnosis.held_out_check
    unknown = diagnosis.gap.discrepancy
    if held is not None:
        share = f"{100 * held.inside_95:.1f} % of the readings within their 95 % predictive interval"
        lines.append(
            f"poses held out: {share}, χ² per reading {held.chi2_per_reading:.3g}"
        )
    if unknown > 0.01:
        lines.append(f"inferred unknown cause: {percent(unknown)} of the readings")
    return lines


def steps(diagnosis: Diagnosis) -> Sequence[tuple[str, float]]:
    """Return the waterfall: label and gap in % rms, from the nominal model to the noise."""
    if diagnosis.steps:
        return diagnosis.steps
    gap = diagnosis.gap
    effects = [(f"{e.effect} @ {e.place}", e.gap_after) for e in diagnosis.effects]
    if len(effects) > 1:
        effects.append(("together", gap.explained))
    return [
        ("nominal", gap.nominal),
        *effects,
        *([("held out", gap.held_out)] if math.isfinite(gap.held_out) else []),
        ("noise", gap.noise),
    ]


def next_step(diagnosis: Diagnosis) -> str:
    """Return the next measurement, or why there is none for a group; empty without either."""
    step = diagnosis.next_measurement
    return what_next(step) if step else diagnosis.why_no_next


def what_next(step: NextMeasurement) -> str:
    """Return the next measurement as an instruction."""
    place = f"at pose {step.pose}" if step.pose else ""
    if step.position is not None:
        names = tuple(step.position)
        place = f"at {name_pose(step.position.values(), names)}"
        if step.label:
            place = f"at {', '.join(names)} = {step.label.strip('()')}"
    action = f"read {step.quantity} {place}" if step.quantity else f"measure {place}"
    if step.sensors:
        action = f"read {', '.join(step.sensors)} ({step.quantity}) {place}"
    if step.wrench is not None and any(step.wrench):
        components = zip(WRENCH, step.wrench, ("N",) * 3 + ("N·m",) * 3, strict=True)
        words = (
            f"{axis} = {value:.4g} {unit}" for axis, value, unit in components if value
        )
        action += f" under {', '.join(words)}" + (
            f" at {step.load}" if step.load else ""
        )
    elif step.wrench is not None:
        action += " without load, against the commanded pose"
    pair = " from ".join(step.separates)
    action += f": distinguishes {pair} (expected ln-odds {step.expected_gain:.3g})"
    placed = ", ".join(
        f"{key} on {new['body']}{_place(new)}" for key, new in (step.new or {}).items()
    )
    return f"{action}; new here: {placed}" if placed else action


def _place(new: dict[str, Any]) -> str:
    """Return where a sensor or load point is and what it reads along: " at (0, 0, 35 mm) along x"."""
    at = f" at ({point(new['at'])} mm)" if "at" in new else ""
    return at + (f" along {vector(new['direction'], 3)}" if "direction" in new else "")


def shares(robot: RobotFile, diagnosis: Diagnosis) -> dict[str, float]:
    """Return the share of the gap by element; each member of a group gets the whole share."""
    out: dict[str, float] = {}
    solids = {"base": ("ground",), "tool": (robot.tool.body,)}
    for component, share in diagnosis.where.component.items():
        for element in robot.members(component) or solids.get(component, (component,)):
            out[element] = out.get(element, 0.0) + share
    return out


def _name_row(where: Where, number: int) -> str:
    """Return a pose by its label, and where its readings begin."""
    row = where.rows[number] if where.rows else ""
    return f"{where.pose_names[number]} from {row}" if row else where.pose_names[number]


def describe_location(where: Where) -> list[str]:
    """Return where the gap lies: by direction, by component, and the worst poses."""
    largest = sorted(where.component.items(), key=lambda item: -item[1])[:6]
    shares = {
        "by direction": where.direction,
        "by component": dict(largest),
        "left": where.left,
    }
    lines = []
    for words, each in shares.items():
        if each or words == "by direction":
            listed = (
                f"{name} {100 * share:.0f} %"
                for name, share in each.items()
                if share > 5e-3
            )
            lines.append(f"{words}: {', '.join(listed)}")
    sizes = [
        math.sqrt(sum(v * v for v in row if math.isfinite(v))) for row in where.pose
    ]
    worst = sorted(range(len(sizes)), key=lambda k: -sizes[k])[:3]
    if len(sizes) > 1:
        lines.append("worst poses: " + "; ".join(_name_row(where, k) for k in worst))
    return lines
