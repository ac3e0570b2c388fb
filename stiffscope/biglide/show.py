"""Table of the audit."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from stiffscope.report.terminal import show_table

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stiffscope.biglide.audit import Finding


def show_findings(title: str, findings: Sequence[Finding]) -> None:
    """Show published and correct numbers with a verdict on each."""
    groups = (
        ("entry",),
        ("published", "as published (R1)", "correct", "bound"),
        ("verdict",),
    )
    rows = []
    for finding in findings:
        numbers = map(
            _number,
            (finding.published, finding.as_published, finding.correct, finding.bound),
        )
        rows.append((finding.entry, *numbers, finding.verdict))
    show_table(title, groups, rows, prose=("verdict",))


def _number(value: float | None) -> str:
    return "" if value is None or not np.isfinite(value) else f"{value:z.5g}"
