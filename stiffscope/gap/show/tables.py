"""Terminal output of a diagnosis: the verdict as a sentence, then tables."""

from __future__ import annotations

import math
from dataclasses import astuple
from typing import TYPE_CHECKING

from stiffscope.gap.effects.drives import ActuatorStiffness
from stiffscope.gap.show import text
from stiffscope.report.numbers import percent
from stiffscope.report.terminal import show_line, show_table

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from stiffscope.gap.inference.diagnosis import Diagnosis

MOST_PAIRS = 10


def show_diagnosis(diagnosis: Diagnosis) -> None:
    """Show the whole diagnosis."""
    show_line(f"\n{text.sentence(diagnosis)}\n", "bold")
    doubt = text.warning(diagnosis)
    if doubt:
        show_line(f"{doubt}\n", "bold red")
    show_drives(diagnosis)
    if diagnosis.effects:
        show_effects(diagnosis)
    show_gap(diagnosis)
    show_modes(diagnosis)
    show_alternatives(diagnosis)
    _show_list("Possible", text.possible(diagnosis))
    _show_list("Where", text.describe_location(diagnosis.where))
    following = text.next_step(diagnosis)
    _show_list("Next", [following] if following else [])
    _show_list("Checks", text.checks(diagnosis))
    _show_list("Remarks", diagnosis.remarks)
    show_line("")


def show_nearest_signatures(diagnosis: Diagnosis) -> None:
    """Show the pairs of effects with the most similar signatures in these readings."""
    names, rows = diagnosis.signature_correlation
    pairs = (
        (rows[i][j], names[j], names[i]) for i in range(len(names)) for j in range(i)
    )
    nearest = sorted(pairs, reverse=True)[:MOST_PAIRS]
    cells = [
        (text.label(one), text.label(other), f"{value:.3f}")
        for value, one, other in nearest
    ]
    groups = (("effect", "and"), ("correlation",))
    if cells:
        show_table("Most similar signatures (1: indistinguishable)", groups, cells)


def _show_list(title: str, lines: Sequence[str]) -> None:
    if lines:
        show_line(title, "bold")
    for line in lines:
        show_line(f"  {line}")


def show_modes(diagnosis: Diagnosis) -> None:
    """Show the modes of each set-up of responses: measured, before and after, paired by shape."""
    groups = (
        ("measured Hz",),
        ("before Hz", "after Hz"),
        ("zeta %",),
        ("MAC before", "MAC after"),
    )
    for name, setup in diagnosis.responses.items():
        rows = [
            (
                f"{mode.measured:.4g}",
                _show_known(mode.before, ".4g"),
                _show_known(mode.after, ".4g"),
                _show_known(100.0 * mode.zeta, ".2g"),
                _show_known(mode.mac_before, ".2f"),
                _show_known(mode.mac_after, ".2f"),
            )
            for mode in setup.modes
        ]
        if rows:
            show_table(f"Modes of {name}, paired by shape", groups, rows)
        show_line(
            f"lines of {name}: {setup.before:.2g} dB rms before, "
            f"{setup.after:.2g} dB after, noise {setup.noise:.2g} dB"
        )


def write_modes(path: Path, diagnosis: Diagnosis) -> None:
    """Write the modes of all set-ups of responses as CSV: Hz, ratios; empty if unknown."""
    lines = ["setup,measured,before,after,zeta,mac_before,mac_after"]
    for name, setup in diagnosis.responses.items():
        for mode in setup.modes:
            values = (_show_known(value, ".6g") for value in astuple(mode))
            lines.append(",".join([name, *values]))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _show_known(value: float, form: str) -> str:
    return "" if math.isnan(value) else format(value, form)


def show_drives(diagnosis: Diagnosis) -> None:
    """Show each drive's stiffness with everything that was found, where drives are effects."""
    if not any(e.effect == ActuatorStiffness.word for e in diagnosis.effects):
        return
    groups = (("joint",), ("stated, N·m/rad or N/m", "resulting ± 1 σ", "ratio"))
    show_table("Drives", groups, text.drives(diagnosis), prose=("resulting ± 1 σ",))


def show_effects(diagnosis: Diagnosis, *, details: bool = False) -> None:
    """Show effects and parameters; details add intervals and ratios to the model's values."""
    more = ("95 % interval", "ratio", "deviation / σ", "remark") if details else ()
    shown = ("parameter", "value ± 1 σ", "model")
    groups = (("effect @ place",), ("probability", "share", "gap alone"), shown, more)
    rows: list[Sequence[str]] = []
    for effect in diagnosis.effects:
        share = f"{100 * effect.share:.3g} %" if math.isfinite(effect.share) else ""
        name = f"{effect.effect} @ {effect.place}"
        chance = text.certainty(effect.probability)
        first = (name, chance, share, percent(effect.gap_after))
        for k, parameter in enumerate(text.parameters(effect) or [("none", *[""] * 6)]):
            rows.append(
                (*(("",) * 4 if k else first), *parameter[: len(shown) + len(more)])
            )
    show_table("Effects", groups, rows, prose=("effect @ place",))


def show_gap(diagnosis: Diagnosis) -> None:
    """Show the gap before, after and at held-out poses, and the noise."""
    gap = diagnosis.gap
    groups = (
        ("",),
        ("before", "after", "held out", "noise"),
        ("χ² per reading before", "after"),
    )
    sizes = (gap.nominal, gap.explained, gap.held_out, gap.noise)
    percents = [percent(v) if math.isfinite(v) else "" for v in sizes]
    rows = [("rms", *percents, *(f"{v:.4g}" for v in gap.chi2_per_reading))]
    rows += [
        (f"{name}, rms", *sizes, "", "")
        for name, sizes in text.absolute_sizes(gap).items()
    ]
    if not math.isfinite(gap.held_out):  # nothing can be held out at one pose
        groups = (groups[0], ("before", "after", "noise"), groups[2])
        rows = [(*row[:3], *row[4:]) for row in rows]
    show_table("Gap", groups, rows)


def show_alternatives(diagnosis: Diagnosis) -> None:
    """Show the hypotheses that were considered but rejected, if any."""
    if not diagnosis.alternatives:
        return
    groups = (("effect @ place",), ("probability", "gap after", "why not"))
    rows = []
    for a in diagnosis.alternatives:
        pairs = zip(a.effect.split(" + "), a.place.split(" + "), strict=True)
        name = " + ".join(map(" @ ".join, pairs))
        rows.append(
            (name, text.probability(a.probability), percent(a.gap_after), a.why_not)
        )
    show_table("Alternatives", groups, rows, prose=("effect @ place", "why not"))
