"""Plan of readings for a question, as data and as terminal tables."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from stiffscope.gap.planning import ENOUGH
from stiffscope.report.numbers import coordinates, pose_values
from stiffscope.report.terminal import show_line, show_table

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stiffscope.gap.planning import Answered, Proposal

_SHOWN = 12


def plan_json(proposal: Proposal) -> dict[str, Any]:
    """Return the plan with its expected evidence."""
    return {
        "sensors": [sensor.name for sensor in proposal.plan.sensors],
        "loads": [hook.name for hook in proposal.plan.hooks],
        "enough": ENOUGH,
        "pairs": [
            {
                "first": pair.first, "second": pair.second, "ln_odds": pair.log_odds, "hidden": list(pair.hidden),
                "asked": pair.asked,
            }
            for pair in proposal.pairs
        ],
    }  # fmt: skip


def show_plan(proposal: Proposal, names: Sequence[str]) -> None:
    """Print the readings and the distinguished pairs; ``names``: coordinates of a pose."""
    plan = proposal.plan
    rows: list[list[str]] = []
    for pose, values in enumerate(plan.poses):
        for pull, (hook, force) in enumerate(plan.pulls):
            here = (plan.settings[:, :2] == (pose, pull)).all(axis=1)
            read = ", ".join(plan.sensors[k].name for k in plan.settings[here, 2])
            load = f"{plan.hooks[hook].name} {', '.join(f'{f:g}' for f in force)}" if hook >= 0 else "none"
            rows += [[pose_values(values, names), load, read]] if here.any() else []
    show_table("Readings", [[coordinates(names)], ["load, N", "sensors"]], rows, prose=("sensors",))
    asked = [pair for pair in proposal.pairs if pair.asked]
    _show_pairs("The question: expected ln-odds if the first is true", asked)
    _show_pairs("Against other causes: the smallest", [pair for pair in proposal.pairs if not pair.asked])


def _show_pairs(title: str, pairs: Sequence[Answered]) -> None:
    rows = [[p.first, p.second, f"{p.log_odds:.3g}", ", ".join(p.hidden)] for p in pairs[:_SHOWN]]
    if rows:
        show_table(title, [["true", "instead"], ["ln-odds", "unresolved"]], rows, prose=("true", "instead"))
    if len(pairs) > _SHOWN:
        show_line(f"and {len(pairs) - _SHOWN} more: see --json")
