"""A diagnosis on standard output: the verdict in a sentence, then tables."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from stiffscope.report import text
from stiffscope.report.numbers import percent
from stiffscope.report.terminal import show_line, show_table

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np

    from stiffscope.gap.diagnosis import Diagnosis


def show_diagnosis(diagnosis: Diagnosis, slider: np.ndarray | None) -> None:
    """Show the whole diagnosis; `slider` (6, 6) is the compliance in the model, None without a robot."""
    show_line(f"\n{text.sentence(diagnosis)}\n", "bold")
    if diagnosis.effects:
        _show_effects(diagnosis, slider)
    _show_gap(diagnosis)
    if diagnosis.alternatives:
        _show_alternatives(diagnosis)
    _show_list("Possible", text.possible(diagnosis))
    _show_list("Where", text.located(diagnosis.where))
    if diagnosis.next_measurement:
        _show_list("Next", [text.what_next(diagnosis.next_measurement)])
    _show_list("Checks", text.checks(diagnosis))
    _show_list("Remarks", diagnosis.remarks)
    show_line("")


def _show_list(title: str, lines: Sequence[str]) -> None:
    if lines:
        show_line(title, "bold")
    for line in lines:
        show_line(f"  {line}")


def _show_effects(diagnosis: Diagnosis, slider: np.ndarray | None) -> None:
    groups = (("effect @ place",), ("probability", "share", "gap alone"), ("parameter", "value ± 1 σ", "model"))
    rows: list[Sequence[str]] = []
    for effect in diagnosis.effects:
        share = f"{100 * effect.share:.3g} %" if math.isfinite(effect.share) else ""
        first = (f"{effect.effect} @ {effect.place}", f"{effect.probability:.4f}", share, percent(effect.gap_after))
        parameters = [
            (p.name, p.value + ("" if p.plausible else " (not plausible)"), p.nominal)
            for p in text.parameters(effect, slider)
        ]
        for k, parameter in enumerate(parameters or [("none", "", "")]):
            rows.append((*(("",) * 4 if k else first), *parameter))
    show_table("Effects", groups, rows, prose=("effect @ place",))


def _show_gap(diagnosis: Diagnosis) -> None:
    gap = diagnosis.gap
    groups = (("",), ("before", "after", "held out", "noise"), ("χ² per reading before", "after"))
    percents = (percent(v) for v in (gap.nominal, gap.explained, gap.held_out, gap.noise))
    show_table("Gap", groups, [("rms", *percents, *(f"{v:.4g}" for v in gap.chi2_per_reading))])


def _show_alternatives(diagnosis: Diagnosis) -> None:
    groups = (("effect @ place",), ("probability", "gap after", "why not"))
    rows = [
        (
            " + ".join(f"{e} @ {p}" for e, p in zip(a.effect.split(" + "), a.place.split(" + "), strict=True)),
            text.probability(a.probability),
            percent(a.gap_after),
            a.why_not,
        )
        for a in diagnosis.alternatives
    ]
    show_table("Alternatives", groups, rows, prose=("effect @ place", "why not"))
