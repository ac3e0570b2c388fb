"""Tables of a diagnosis and of a blind check on standard output."""

from __future__ import annotations

from typing import TYPE_CHECKING

from stiffscope.report import text as wording
from stiffscope.report.tables import console, new_table

if TYPE_CHECKING:
    import numpy as np

    from stiffscope.gap.diagnosis import Diagnosis


def show_diagnosis(diagnosis: Diagnosis, slider: np.ndarray | None) -> None:
    """The verdict in a sentence, then effects, gap, alternatives, where, what next, remarks."""
    out = console()
    out.print()
    out.print(wording.sentence(diagnosis), style="bold", markup=False, soft_wrap=True)
    out.print()
    if diagnosis.effects:
        _show_effects(diagnosis, slider)
    _show_gap(diagnosis)
    if diagnosis.alternatives:
        _show_alternatives(diagnosis)
    out.print("Where", style="bold")
    for line in wording.located(diagnosis.where):
        out.print(f"  {line}", markup=False, soft_wrap=True)
    if diagnosis.next_measurement:
        out.print("Next", style="bold")
        out.print(f"  {wording.what_next(diagnosis.next_measurement)}", markup=False, soft_wrap=True)
    if diagnosis.remarks:
        out.print("Remarks", style="bold")
        for remark in diagnosis.remarks:
            out.print(f"  {remark}", markup=False, soft_wrap=True)
    out.print()


def _show_effects(diagnosis: Diagnosis, slider: np.ndarray | None) -> None:
    table = new_table("Effects", "effect @ place", "probability", "parameter", "value ± 1 σ", "model", "gap alone")
    for effect in diagnosis.effects:
        first = [f"{effect.effect} @ {effect.place}", f"{effect.probability:.4f}"]
        last = wording.percent(effect.gap_after)
        if not effect.parameters:
            table.add_row(*first, "none", "", "", last)
        for key, parameter in effect.parameters.items():
            nominal = wording.nominal_value(effect.effect, key, slider)
            doubt = "" if parameter.plausible else "  (not plausible)"
            value = wording.quantity(parameter)
            table.add_row(*first, key, value + doubt, wording.beside(parameter, nominal), last)
            first, last = ["", ""], ""
    console().print(table)


def _show_gap(diagnosis: Diagnosis) -> None:
    gap = diagnosis.gap
    columns = ("", "before", "after", "held out", "noise", "χ² per reading before", "after")
    table = new_table("Gap", *columns)
    percents = (wording.percent(v) for v in (gap.nominal, gap.explained, gap.held_out, gap.noise))
    table.add_row("rms", *percents, *(f"{v:.4g}" for v in gap.chi2_per_reading))
    console().print(table)


def _show_alternatives(diagnosis: Diagnosis) -> None:
    table = new_table("Alternatives", "effect @ place", "probability", "gap after")
    table.add_column("why not", justify="left", overflow="fold")
    for a in diagnosis.alternatives:
        place = " + ".join(f"{e} @ {p}" for e, p in zip(a.effect.split(" + "), a.place.split(" + "), strict=True))
        table.add_row(place, wording.chance(a.probability), wording.percent(a.gap_after), a.why_not)
    console().print(table)
