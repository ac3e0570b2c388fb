"""Report of `diagnose`: verdict, robot coloured by share of gap, effects, alternatives, checks."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.gap.show import tables as gap_tables
from stiffscope.gap.show import text
from stiffscope.gap.show.figures import chart_readings
from stiffscope.gap.show.response_lines import name_lines
from stiffscope.report.page import Lead, Section
from stiffscope.report.robot_view import unit_wrenches
from stiffscope.report.run_report import SHARE
from stiffscope.report.terminal import Shown, record_shown

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stiffscope.experiments.assembly import Assembled
    from stiffscope.gap.inference.diagnosis import Diagnosis
    from stiffscope.report.page import Figure, RobotView
    from stiffscope.report.run_report import Draft
    from stiffscope.vjm.kinematics.configurations import Configurations

MOST_POSES = 60  # most poses in the view; those with the largest residuals are kept
FIGURES = {
    "waterfall": (
        "The gap: the nominal model, with each effect, at poses held out, noise",
        "bars of the gap in % rms: the nominal model, with each effect, held out, noise",
    ),
    "corner": (
        "Posterior of the parameters: histograms, and contours of 50 % and 95 %",
        "joint posterior of the parameters: a histogram of each, contours of each pair",
    ),
    "residuals": (
        "Residuals over noise by pose and direction, before and with the effects",
        "two maps of residuals over noise, poses by directions: before, with the effects",
    ),
    "readings": (
        "Measured readings against their prediction, before and with the effects",
        "measured against predicted readings, a panel for each kind of reading",
    ),
    "predictive": (
        "Residuals at poses held out, over their predictive standard deviation",
        "histogram of residuals at poses held out, and the normal distribution predicted",
    ),
    "signatures": (
        "Correlation between signatures of effects; 1: indistinguishable from these readings",
        "matrix of the correlations between the signatures of the effects",
    ),
}
"""Captions and text alternatives of the figures."""


def write_diagnosis_report(
    report: Draft,
    diagnosis: Diagnosis,
    *,
    title: str,
    facts: Sequence[str],
    view: RobotView | None = None,
) -> None:
    """Write the report of a diagnosis to its output folder, with the SVG figures found there.

    Parameters
    ----------
    report, diagnosis
        Output folder, and diagnosis to report.
    title, facts
        Heading, and facts about the campaign and the model.
    view
        Rotatable view of the robot from `share_view`.
    """

    def figures(stem: str) -> list[Figure]:
        return report.figures({f"{stem}.svg": FIGURES[stem]})

    following = text.next_step(diagnosis)
    with record_shown() as gap:
        gap_tables.show_gap(diagnosis)
    with record_shown() as alternatives:
        gap_tables.show_alternatives(diagnosis)
        gap_tables.show_nearest_signatures(diagnosis)
    charts = chart_readings(diagnosis, next(iter(figures("readings")), None))
    where = _lines(text.describe_location(diagnosis.where))
    checks = _lines([*text.checks(diagnosis), *diagnosis.remarks])
    numbers = ("diagnosis.json", "posterior.nc")
    sections = [
        Section("Where the gap lies", where, figures("residuals"), view=view),
        Section("Effects", _effects(diagnosis), figures("corner"), files=numbers),
        Section(
            "Gap", gap, figures("waterfall"), charts=charts, files=("readings.csv",)
        ),
        *_responses(report, diagnosis),
        Section("Alternatives", alternatives, figures("signatures")),
        Section("What to measure next", _lines([following] if following else [])),
        Section("Checks", checks, figures("predictive")),
    ]
    doubt = text.warning(diagnosis)
    lead = Lead(text.sentence(diagnosis), diagnosis.verdict, doubt)
    report.write(title, facts, sections, lead)


def share_view(
    report: Draft,
    assembled: Assembled,
    diagnosis: Diagnosis,
    configurations: Configurations,
) -> RobotView | None:
    """Return the coloured robot at the campaign's poses, worst first; None without ``robot.png``.

    Parameters
    ----------
    report, assembled
        Output folder with ``robot.png``, and robot with its parts' matrices.
    diagnosis, configurations
        Diagnosis of the campaign, and configurations at the campaign's poses.
    """
    still = report.figure(
        "robot.png", "", "the robot, its components coloured by share of the gap"
    )
    if still is None:
        return None
    where = diagnosis.where
    mechanism = assembled.mechanism
    shown = where.pose[: len(configurations)]  # set-ups of responses come after them
    sizes = np.sqrt(np.nanmean(np.square(np.array(shown, dtype=float)), axis=1))
    chosen = np.argsort(-np.nan_to_num(sizes))[:MOST_POSES]
    configurations = configurations[chosen]
    part = text.shares(assembled.robot, diagnosis)
    cases = [
        [
            replace(c, note=f"residuals {sizes[k]:.3g} σ rms; {c.note}", shares=part)
            for c in each
        ]
        for k, each in zip(
            chosen, unit_wrenches(mechanism, configurations), strict=True
        )
    ]
    names = [where.pose_names[k] for k in chosen]
    caption = "The robot at the campaign's poses, largest residual first, coloured by shares of the gap."
    return report.turn_robot(
        configurations, names, cases, caption, still, quantity=SHARE, start=0
    )


def _responses(report: Draft, diagnosis: Diagnosis) -> list[Section]:
    """Return the section on frequency responses, if there are any."""
    if not diagnosis.responses:
        return []
    with record_shown() as modes:
        gap_tables.show_modes(diagnosis)
    drawn = {
        f"{name_lines(k)}.svg": (
            f"{name}: levels (m/N), and below them residuals over the noise, before and after",
            f"levels and residuals of the responses of {name} over frequency",
        )
        for k, name in enumerate(diagnosis.responses)
    }
    figures = report.figures(drawn)
    return [Section("Frequency responses", modes, figures, files=("modes.csv",))]


def _effects(diagnosis: Diagnosis) -> list[Shown]:
    with record_shown() as tables:
        gap_tables.show_drives(diagnosis)
        if diagnosis.effects:
            gap_tables.show_effects(diagnosis, details=True)
    lines = []
    for e in diagnosis.effects:
        if e.confused_with:
            others = ", ".join(map(text.label, e.confused_with))
            chance = e.group_probability
            present = f"; one is present, probability {text.certainty(chance)}."
            end = present if chance > 0 else "."
            pair = f"{text.name(e.effect, e.place)} from {others}"
            lines.append(f"These readings cannot distinguish {pair}{end}")
    if diagnosis.possible:
        lines.append(f"Possible: {'; '.join(text.possible(diagnosis))}")
    return [*tables, *_lines(lines)]


def _lines(lines: Sequence[str]) -> list[Shown]:
    return [Shown(line[:1].upper() + line[1:]) for line in lines]
