"""The paper recomputed: as published (reading R1), correctly, and against the bounds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.vjm.analysis import stiffness
from stiffscope.vjm.biglide import SIDES, X, Y, pose_at
from stiffscope.vjm.bounds import rotational_bound, stiffness_bounds
from stiffscope.vjm.screws import Frame, rotation, shift

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stiffscope.vjm.biglide import Biglide
    from stiffscope.vjm.screws import Array

DIAGONAL = ("K_tx", "K_ty", "K_tz", "K_rx", "K_ry", "K_rz")
_EXPLAINED = 5e-3  # relative; the reading explains K_ty, K_tz and K_rz to 0.3 %
_LAST_DIGIT = (
    500.0  # N/m, N·m/rad: half of the last digit that Eq. (30) and Tables 5 and 6 print (K_tz: 1e3 times that)
)
_LAST_COMPLIANCE_DIGIT = 5e-13  # and that Eq. (29) prints


@dataclass(frozen=True)
class Finding:
    """One published entry: SI values of what is printed, what reading R1 gives, what is correct, and the bound."""

    source: str
    entry: str
    published: float
    as_published: float | None
    correct: float
    bound: float | None
    verdict: str


def reading_r1(robot: Biglide, q: float) -> Array:
    """Stiffness (6, 6) at M as the paper's equations give it, without gravity, at a link angle ``q`` in rad.

    Eqs. (1) to (5) with ``K_C⁰`` in the bracket of Eq. (1), the Jacobians of Eqs. (19) and (20) for both limbs, a
    pseudo-inverse of the singular K_Pl in Eq. (3), no slider, and Eq. (26) with the right sign.
    """
    parallelogram = _published_parallelogram(robot, q)
    values, vectors = np.linalg.eigh(parallelogram)
    kept = values > 1e-9 * values[-1]
    compliance = (vectors[:, kept] / values[kept]) @ vectors[:, kept].T
    whole = np.zeros((6, 6))
    along_x = np.concatenate([X, np.zeros(3)])
    for i, side in SIDES.items():
        axes = rotation(Y, -q if i == 1 else q - np.pi)
        to_limb = shift([0.0, 0.0, robot.geometry.l2]) @ Frame(axes).adjoint()
        limb = np.outer(along_x, along_x) / robot.drive + to_limb @ compliance @ to_limb.T
        back = shift([-side * robot.geometry.l, 0.0, 0.0])
        whole = whole + back.T @ np.linalg.inv(limb) @ back
    along_y = np.concatenate([Y, np.zeros(3)])
    return np.linalg.inv(np.linalg.inv(whole) + np.outer(along_y, along_y) / robot.drive)


def _published_parallelogram(robot: Biglide, q: float) -> Array:
    """K_Pl (6, 6) of Eqs. (1) and (2) with the Jacobians of Eqs. (19), (20a) and (20b)."""
    g = robot.geometry
    spring = np.linalg.inv(robot.link)
    total = np.zeros((6, 6))
    for arm, foot in ((g.h, 0.0), (-g.h, g.d), (-g.h, -g.d)):
        lever = np.array([arm * np.cos(q), -foot, arm * np.sin(q)])
        back = shift(-lever)  # inverse of J_θ
        passive = np.zeros((6, 2))
        passive[0], passive[4] = lever[2], 1.0
        passive[2] = [-lever[0] - g.L, -lever[0]]
        fixed = back.T @ spring @ back
        pull = fixed @ passive
        total = total + fixed - pull @ np.linalg.inv(passive.T @ pull) @ pull.T
    return total


def principal_findings(robot: Biglide, source: str, q: float, rows: dict[str, Sequence[float]]) -> list[Finding]:
    """Tables 5 and 6: six principal stiffnesses, SI, in rows ``without_gravity``, ``with_gravity`` and ``experiment``.

    ``q``: link angle in rad. The rows of the table are compared with each other too: what weight changes, in print and
    correctly.
    """
    pose = pose_at(robot.geometry, q)
    recomputed = np.diagonal(reading_r1(robot, q)).tolist()
    plain = np.diagonal(stiffness(robot, pose)[0]).tolist()
    loaded = np.diagonal(stiffness(robot, pose, gravity="exact")[0]).tolist()
    bounds = stiffness_bounds(robot, q)[0].tolist()
    findings: list[Finding] = []
    for row, values in rows.items():
        correct = plain if row == "without_gravity" else loaded
        for k, name in enumerate(DIAGONAL):
            printed = _Printed(source, f"{name} {row}", values[k], _LAST_DIGIT * (1e3 if name == "K_tz" else 1.0))
            if row == "without_gravity":
                findings.append(printed.judged(recomputed[k], correct[k], bounds[k]))
            elif row == "with_gravity":
                change = values[k] / rows["without_gravity"][k] - 1.0
                note = f"weight changes it by {change:+.2%} in print, {loaded[k] / plain[k] - 1.0:+.4%} correctly"
                findings.append(printed.judged(None, correct[k], bounds[k], note))
            else:
                findings.append(printed.judged(None, correct[k], bounds[k], "a measurement"))
        twisting = _Printed(source, f"K_rx + K_rz {row}", values[3] + values[5], 2.0 * _LAST_DIGIT)
        findings.append(twisting.judged(None, correct[3] + correct[5], rotational_bound(robot), "a sum"))
    return findings


def matrix_findings(robot: Biglide, source: str, q: float, published: Array) -> list[Finding]:
    """Eq. (30): every entry on and above the diagonal that is not zero both as printed and correctly."""
    recomputed = reading_r1(robot, q)
    correct = stiffness(robot, pose_at(robot.geometry, q), gravity="exact")[0]
    size = np.sqrt(np.outer(np.diagonal(correct), np.diagonal(correct)))
    correct = np.where(np.abs(correct) < 1e-6 * size, 0.0, correct)
    bounds = stiffness_bounds(robot, q)[0]
    findings: list[Finding] = []
    for i, j in zip(*np.triu_indices(6), strict=True):
        if published[i, j] or correct[i, j]:
            printed = _Printed(source, f"K{i + 1}{j + 1}", float(published[i, j]), _LAST_DIGIT)
            bound = float(bounds[i]) if i == j else None
            findings.append(printed.judged(float(recomputed[i, j]), float(correct[i, j]), bound))
    return findings


def compliance_findings(source: str, published: Array, beam: Array, solid: Array | None) -> list[Finding]:
    """Eq. (29): each printed entry beside Euler-Bernoulli theory with I_y + I_z for torsion, and a solid's."""
    findings: list[Finding] = []
    for i, j in zip(*np.triu_indices(6), strict=True):
        if not published[i, j]:
            continue
        printed, theory = float(published[i, j]), float(beam[i, j])
        correct = float(solid[i, j]) if solid is not None else float("nan")
        is_beam = abs(printed - theory) <= max(_LAST_COMPLIANCE_DIGIT, _EXPLAINED * abs(theory))
        verdict = "a beam formula, to its last digit, not FEA" if is_beam else "no beam formula gives it"
        if solid is not None:
            verdict += f"; the solid's is {correct / printed:.3g} x"
        findings.append(Finding(source, f"C{i + 1}{j + 1}", printed, theory, correct, None, verdict))
    return findings


def rms_findings(point: str, printed: dict[str, float], rows: dict[str, Sequence[float]]) -> list[Finding]:
    """RMS figures of the text in %: as printed, ``sqrt(Σe²)/6``, and the root mean square ``sqrt(Σe²/6)``."""
    measured = np.array(rows["experiment"])
    findings: list[Finding] = []
    for row, value in printed.items():
        errors = (np.array(rows[row]) - measured) / measured
        size = float(np.sqrt(np.sum(errors**2)))
        sixth, rms = 100.0 * size / 6.0, 100.0 * size / np.sqrt(6.0)
        if _off(value, rms) < _EXPLAINED:
            verdict = "the root mean square"
        elif _off(value, sixth) < _EXPLAINED:
            verdict = f"sqrt(Σe²)/6, not the root mean square, which is {rms:.3g} %"
        else:
            verdict = "not explained"
        findings.append(Finding("text", f"RMS {row} at {point} (%)", value, sixth, float(rms), None, verdict))
    return findings


@dataclass(frozen=True)
class _Printed:
    """A published entry and half a unit of its last printed digit."""

    source: str
    entry: str
    value: float
    rounding: float

    def judged(
        self, as_published: float | None, correct: float, bound: float | None, note: str | None = None
    ) -> Finding:
        """The finding; ``note`` stands for what a reading of the equations would say where there is none."""
        notes: list[str] = []
        if bound is not None and self.value - self.rounding > bound:
            over = self.value / bound
            size = f"{over:.3g}-fold" if over > 2.0 else f"by {_percent(over - 1.0)}"
            notes.append(f"exceeds its bound {size}")
        if self._is(correct):
            notes.append(f"correct, to {_percent(_off(self.value, correct))}")
        else:
            if as_published is not None and self._is(as_published):
                notes.append(
                    "reading R1, to its last digit" if self._rounds(as_published) else self._near(as_published)
                )
            elif as_published is not None:
                notes.append("no reading explains it")
            notes.append(f"{self.value / correct:.3g} x the correct value" if correct else "correctly zero")
        if note:
            notes.append(note)
        return Finding(self.source, self.entry, self.value, as_published, correct, bound, "; ".join(notes))

    def _rounds(self, reference: float) -> bool:
        return abs(self.value - reference) <= self.rounding

    def _is(self, reference: float) -> bool:
        return self._rounds(reference) or _off(self.value, reference) < _EXPLAINED

    def _near(self, reference: float) -> str:
        return f"reading R1, to {_percent(_off(self.value, reference))}"


def _off(value: float, reference: float) -> float:
    return abs(value - reference) / abs(reference) if reference else float("inf")


def _percent(fraction: float) -> str:
    return f"{100.0 * fraction:.2g} %"
