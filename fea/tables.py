"""An experiment as a table: each entry of the compliance with its bound and its unit."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from stiffscope.fea.experiment import Experiment

WRENCHES = ("f<sub>x</sub>", "f<sub>y</sub>", "f<sub>z</sub>", "m<sub>x</sub>", "m<sub>y</sub>", "m<sub>z</sub>")
TWISTS = ("v<sub>x</sub>", "v<sub>y</sub>", "v<sub>z</sub>", "ω<sub>x</sub>", "ω<sub>y</sub>", "ω<sub>z</sub>")
UNITS = (("m/N", "m/(N m)"), ("rad/N", "rad/(N m)"))
CELL = 'style="text-align:right;white-space:nowrap"'


def entry(value: float, bound: float) -> str:
    """Return an entry with as many digits as its bound lets stand, and the bound: '4.815e-09 ± 2e-12'."""
    if abs(value) <= bound:
        return f"0 ± {bound:.0e}"
    digits = min(9, max(1, len(f"{abs(value) / max(bound, 1e-12 * abs(value)):.0f}")))
    return f"{value:.{digits}e} ± {bound:.0e}"


def html_table(experiment: Experiment) -> str:
    """Return the (6, 6) compliance at the first interface's reference point as an HTML table."""
    compliance, error = experiment.compliance, experiment.error
    head = "".join(f"<th {CELL}>{name}</th>" for name in WRENCHES)
    rows = []
    for i, twist in enumerate(TWISTS):
        cells = "".join(
            f'<td {CELL} title="{UNITS[i // 3][j // 3]}">{entry(compliance[i, j], error[i, j])}</td>' for j in range(6)
        )
        rows.append(f"<tr><th>{twist}</th>{cells}</tr>")
    point = ", ".join(f"{1e3 * value:.4g}" for value in experiment.reference_point)
    caption = (
        f"{escape(experiment.part)}, {experiment.interface}: twist per unit wrench at ({point}) mm; "
        f"m/N, m/(N m) and rad/N, rad/(N m); largest relative bound {experiment.relative_bound:.2%}"
    )
    note = f"<p>{escape(experiment.note)}</p>" if experiment.note else ""
    return f"<table><caption>{caption}</caption><tr><th></th>{head}</tr>{''.join(rows)}</table>{note}"
