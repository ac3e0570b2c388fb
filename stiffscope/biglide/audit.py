"""Audit of the published numbers: as published, correct, and against bounds (docs/theory.md 10)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.biglide.published_model import published_model
from stiffscope.fea.beam import euler_bernoulli, polar
from stiffscope.robot.mechanism_of import mechanism_of
from stiffscope.robot.part_matrices import (
    beam_compliance,
    part_matrices,
    read_published,
)
from stiffscope.vjm.model.mechanism import DIAGONAL
from stiffscope.vjm.statics.analysis import stiffness

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stiffscope.biglide.published_model import PublishedModel
    from stiffscope.robot.file.description import RobotFile

_EXPLAINED = 5e-3  # relative; the reading explains K_ty, K_tz and K_rz to 0.3 %
_LAST_DIGIT = (
    500.0  # N/m, N·m/rad: half the last printed digit of stiffnesses (K_tz: times 1e3)
)
_LAST_COMPLIANCE_DIGIT = 5e-13  # half the last printed digit of compliances
_ROWS = ("without_gravity", "with_gravity", "experiment")


@dataclass(frozen=True)
class Finding:
    """One published entry, SI: printed value, value by reading R1, correct value, and bound."""

    source: str
    entry: str
    published: float
    as_published: float | None
    correct: float
    bound: float | None
    verdict: str


def findings_on_paper(robot: RobotFile, solid: np.ndarray | None) -> list[Finding]:
    """Recompute the published numbers: compliance, stiffnesses, a comparison and RMS figures.

    Parameters
    ----------
    robot
        The paper's robot.
    solid
        Compliance (6, 6) of its slider by virtual experiment, SI; None to skip this comparison.

    Returns
    -------
    list of Finding
        One finding for each published number.
    """
    matrices = part_matrices(robot, "published")
    model = published_model(mechanism_of(robot, matrices), robot.parameters)
    beam = beam_compliance(
        robot, "slider", lambda n, of, *e: euler_bernoulli(n, polar(of), *e)
    )
    findings = compliance_findings(
        "Eq. (29)", matrices["slider"].compliance, beam, solid
    )
    printed = read_published("stiffness")
    for source, point in (("Eq. (30a)", "P1"), ("Eq. (30b)", "P2")):
        matrix = np.array(printed[point]["stiffness"]) * printed["unit"]
        findings += matrix_findings(
            model, source, math.radians(printed[point]["q_deg"]), matrix
        )
    principal = read_published("principal_stiffness")
    rms: list[Finding] = []
    for source, point in (("Table 5", "Q1"), ("Table 6", "Q2")):
        table = principal[point]
        rows: dict[str, Sequence[float]] = {
            row: [value * principal["unit"] for value in table[row]] for row in _ROWS
        }
        findings += principal_findings(
            model, source, math.radians(table["q_deg"]), rows
        )
        percent = {
            row: values[point] for row, values in principal["rms_percent"].items()
        }
        rms += rms_findings(point, percent, rows)
    return findings + rms


def principal_findings(
    model: PublishedModel, source: str, q: float, rows: dict[str, Sequence[float]]
) -> list[Finding]:
    """Judge Tables 5 and 6: six principal stiffnesses, SI, by row, at a link angle ``q`` in rad.

    The rows are ``without_gravity``, ``with_gravity`` and ``experiment``. The printed change due to
    weight is compared with the correct one too.
    """
    pose = model.dimensions.tool_point(q)
    recomputed = np.diagonal(model.reading_r1(q)).tolist()
    plain = np.diagonal(stiffness(model.mechanism, pose)[0]).tolist()
    loaded = np.diagonal(stiffness(model.mechanism, pose, gravity="exact")[0]).tolist()
    bounds = model.bounds(q)[0].tolist()
    findings: list[Finding] = []
    for row, values in rows.items():
        correct = plain if row == "without_gravity" else loaded
        for k, name in enumerate(DIAGONAL):
            rounding = _LAST_DIGIT * (1e3 if name == "K_tz" else 1.0)
            printed = _Printed(source, f"{name} {row}", values[k], rounding)
            reading = None
            note = "a measurement"
            if row == "without_gravity":
                reading = recomputed[k]
                note = None
            elif row == "with_gravity":
                change = values[k] / rows["without_gravity"][k] - 1.0
                right = f"{loaded[k] / plain[k] - 1.0:+.4%} correctly"
                note = f"weight changes it by {change:+.2%} in print, {right}"
            findings.append(printed.judge(reading, correct[k], bounds[k], note))
        twisting = _Printed(
            source, f"K_rx + K_rz {row}", values[3] + values[5], 2.0 * _LAST_DIGIT
        )
        both = correct[3] + correct[5]
        findings.append(twisting.judge(None, both, model.rotational_bound, "a sum"))
    return findings


def matrix_findings(
    model: PublishedModel, source: str, q: float, published: np.ndarray
) -> list[Finding]:
    """Judge printed stiffnesses on and above the diagonal, except entries that are rightly zero."""
    recomputed = model.reading_r1(q)
    correct = stiffness(
        model.mechanism, model.dimensions.tool_point(q), gravity="exact"
    )[0]
    size = np.sqrt(np.outer(np.diagonal(correct), np.diagonal(correct)))
    correct = np.where(np.abs(correct) < 1e-6 * size, 0.0, correct)
    bounds = model.bounds(q)[0]
    findings: list[Finding] = []
    for i, j in np.argwhere(np.triu((published != 0.0) | (correct != 0.0))).tolist():
        printed = _Printed(
            source, f"K{i + 1}{j + 1}", float(published[i, j]), _LAST_DIGIT
        )
        bound = float(bounds[i]) if i == j else None
        findings.append(
            printed.judge(float(recomputed[i, j]), float(correct[i, j]), bound)
        )
    return findings


def compliance_findings(
    source: str, published: np.ndarray, beam: np.ndarray, solid: np.ndarray | None
) -> list[Finding]:
    """Judge the printed compliance by Euler-Bernoulli theory (torsion: I_y + I_z) and a solid's."""
    findings: list[Finding] = []
    for i, j in np.argwhere(np.triu(published)).tolist():
        printed = float(published[i, j])
        theory = float(beam[i, j])
        correct = float(solid[i, j]) if solid is not None else float("nan")
        is_beam = abs(printed - theory) <= max(
            _LAST_COMPLIANCE_DIGIT, _EXPLAINED * abs(theory)
        )
        verdict = "no beam formula gives it"
        if is_beam:
            verdict = "a beam formula, to its last digit, not FEA"
        if solid is not None:
            verdict += f"; the solid's is {correct / printed:.3g} x"
        entry = f"C{i + 1}{j + 1}"
        findings.append(
            Finding(
                source=source,
                entry=entry,
                published=printed,
                as_published=theory,
                correct=correct,
                bound=None,
                verdict=verdict,
            )
        )
    return findings


def rms_findings(
    point: str, printed: dict[str, float], rows: dict[str, Sequence[float]]
) -> list[Finding]:
    """Compare printed RMS figures in % with ``sqrt(Σe²)/6`` and the true RMS ``sqrt(Σe²/6)``."""
    measured = np.array(rows["experiment"])
    findings: list[Finding] = []
    for row, value in printed.items():
        errors = (np.array(rows[row]) - measured) / measured
        size = float(np.sqrt(np.sum(errors**2)))
        sixth = 100.0 * size / 6.0
        rms = 100.0 * size / np.sqrt(6.0)
        if _off(value, rms) < _EXPLAINED:
            verdict = "the root mean square"
        elif _off(value, sixth) < _EXPLAINED:
            verdict = f"sqrt(Σe²)/6, not the root mean square, which is {rms:.3g} %"
        else:
            verdict = "not explained"
        entry = f"RMS {row} at {point} (%)"
        findings.append(
            Finding(
                source="text",
                entry=entry,
                published=value,
                as_published=sixth,
                correct=float(rms),
                bound=None,
                verdict=verdict,
            )
        )
    return findings


@dataclass(frozen=True)
class _Printed:
    """A published entry and half a unit of its last printed digit."""

    source: str
    entry: str
    value: float
    rounding: float

    def judge(
        self,
        as_published: float | None,
        correct: float,
        bound: float | None,
        note: str | None = None,
    ) -> Finding:
        """Return the finding; a ``note`` is appended to its verdict."""
        notes: list[str] = []
        if bound is not None and self.value - self.rounding > bound:
            over = self.value / bound
            size = f"{over:.3g}-fold" if over > 2.0 else f"by {_percent(over - 1.0)}"
            notes.append(f"exceeds its bound {size}")
        if self._is(correct):
            notes.append(f"correct, to {_percent(_off(self.value, correct))}")
        else:
            if as_published is not None and self._is(as_published):
                digits = "its last digit"
                if abs(self.value - as_published) > self.rounding:
                    digits = _percent(_off(self.value, as_published))
                notes.append(f"reading R1, to {digits}")
            elif as_published is not None:
                notes.append("no reading explains it")
            times = f"{self.value / correct:.3g} x the correct value" if correct else ""
            notes.append(times or "correctly zero")
        if note:
            notes.append(note)
        verdict = "; ".join(notes)
        return Finding(
            source=self.source,
            entry=self.entry,
            published=self.value,
            as_published=as_published,
            correct=correct,
            bound=bound,
            verdict=verdict,
        )

    def _is(self, reference: float) -> bool:
        within = abs(self.value - reference) <= self.rounding
        return within or _off(self.value, reference) < _EXPLAINED


def _off(value: float, reference: float) -> float:
    return abs(value - reference) / abs(reference) if reference else float("inf")


def _percent(fraction: float) -> str:
    return f"{100.0 * fraction:.2g} %"
