"""Tables of a robot: stiffness, deflection, modes, changes by overrides, audit."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.report.numbers import (
    NEGLIGIBLE,
    TWIST,
    WRENCH,
    ZERO,
    coordinates,
    find_resolved,
    pose_values,
)
from stiffscope.report.part_tables import explain_zeros, format_cells
from stiffscope.report.terminal import show_line, show_table
from stiffscope.vjm.mechanism import DIAGONAL

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from stiffscope.biglide.audit import Finding
    from stiffscope.experiments.assembly import Assembled
    from stiffscope.vjm.modes import Modes
    from stiffscope.vjm.statics import Stiffness

SIX = (DIAGONAL[:3], DIAGONAL[3:])
COUPLINGS = ("K_15", "K_24")
SAG = ("|sag| µm", "sag z µm")


def sources(assembled: Assembled) -> str:
    """Return the sources of the parts' matrices in a few words."""
    return ", ".join(f"{part}: {source}" for part, source in assembled.sources.items()) or "rigid parts"


def show_stiffness(
    names: Sequence[str], state: Stiffness, bars: Any | None = None, *, title: str = "Stiffness at M"
) -> None:
    """Show the diagonal of K, two couplings and the sag at each pose.

    Parameters
    ----------
    names
        Names of the n poses.
    state
        Stiffness at the poses.
    bars : (n, 6, 6)
        95 % bounds on the stiffness, propagated from the parts' experiments.
    title
        Title above the table.
    """
    pose = state.configurations.mechanism.tool.pose
    sags = np.any(state.sag)
    factor, units = _scale(state.finite)
    rows: list[Sequence[str]] = []
    for i, name in enumerate(names):
        matrix = np.asarray(state.matrix[i])
        bound = np.zeros((6, 6)) if bars is None else np.asarray(bars[i])
        shown = np.where(find_resolved(matrix, bound), matrix, np.nan) / factor
        sag = state.sag[i]
        sunk = [f"{1e6 * np.linalg.norm(sag[:3]):.2f}", f"{1e6 * sag[2]:z.2f}"] if sags else ["", ""]
        place = pose_values(state.poses[i], pose)
        if len(state.rigid[i]):  # stiffness with all other directions free, if the tool yields
            alone = np.diag(np.asarray(state.finite[i]) / factor)
            cells = [*("rigid" if np.isnan(v) else f"{v:.4f}" for v in alone), "", ""]
            rows.append((name, place, *cells, *sunk))
            continue
        rows.append((name, place, *format_cells(_diagonal_and_couplings(shown), ".4f"), *sunk))
        if bars is not None:
            spread = (f"{v:.2g}" for v in _diagonal_and_couplings(bound / factor))
            rows.append(("", "± 95 %", *spread, "", ""))
    where = coordinates(pose)
    groups = (("pose", where), *SIX, (*COUPLINGS, *SAG))
    show_table(f"{title} ({units})", groups, rows, prose=(where,) if len(pose) > 3 else ())
    if any(len(each) for each in state.rigid):
        show_line("  rigid: K is infinite; the other entries are 1/C_ii, with all other directions free\n")
    explain_zeros(rows)


def show_full_matrices(names: Sequence[str], state: Stiffness, bars: Any | None = None) -> None:
    """Show K and C (6, 6) at each pose with 95 % bounds; only C if a direction is rigid.

    Parameters
    ----------
    names
        Names of the n poses.
    state
        Stiffness at the poses.
    bars : (n, 6, 6)
        95 % bounds on the stiffness; those of C are ``|C| |δK| |C|`` to first order.
    """
    scale = np.full((6, 6), 1e-3)
    scale[:3, :3] = 1e-6
    for i, name in enumerate(names):
        compliance = np.asarray(state.compliance[i])
        bound = np.zeros((6, 6)) if bars is None else np.asarray(bars[i])
        spread = np.abs(compliance) @ bound @ np.abs(compliance)
        if not len(state.rigid[i]):
            rows = _with_bounds(np.asarray(state.matrix[i]), bound, scale, WRENCH)
            show_table(f"K at {name}, N/µm, N/mrad = N·m/mm, N·m/mrad", (("",), TWIST[:3], TWIST[3:]), rows)
        rows = _with_bounds(compliance, spread, np.full((6, 6), 1e6), TWIST)
        show_table(f"C at {name}, µm/N, µm/(N·m), µrad/N, µrad/(N·m)", (("",), WRENCH[:3], WRENCH[3:]), rows)


def _with_bounds(matrix: np.ndarray, bound: np.ndarray, scale: np.ndarray, names: Sequence[str]) -> list[Sequence[str]]:
    clear = find_resolved(matrix, bound)

    def cell(i: int, j: int) -> str:
        value, spread = matrix[i, j] * scale[i, j], bound[i, j] * scale[i, j]
        return (f"{value:.5g} ± {spread:.2g}" if spread else f"{value:.5g}") if clear[i, j] else ZERO

    return [(name, *(cell(i, j) for j in range(6))) for i, name in enumerate(names)]


def _scale(stiffness: Any) -> tuple[float, str]:
    """Return a power of 1000 that suits the smallest diagonal stiffness, and its units."""
    diagonals = np.abs(np.diagonal(stiffness, axis1=1, axis2=2))
    least = np.min(diagonals, where=diagonals > NEGLIGIBLE * np.nanmax(diagonals, initial=0.0), initial=np.inf)
    factor, power = next(((f, p) for f, p in ((1e6, "10⁶ "), (1e3, "10³ ")) if least >= 0.1 * f), (1.0, ""))
    return factor, f"{power}N/m, {power}N·m/rad, {power}N"


def _diagonal_and_couplings(matrix: np.ndarray) -> list[float]:
    return [*np.diag(matrix), matrix[0, 4], matrix[1, 3]]


def show_deflection(
    names: Sequence[str], twist: Any, shares: Mapping[str, Any], wrench: str = "", error: Any = 0.0
) -> None:
    """Show tool deflections (n, 6), m and rad, with bounds, and energy shares (n,) by component.

    Parameters
    ----------
    names
        Names of the poses (n,).
    twist
        Deflections (n, 6), m and rad.
    shares
        Share (n,) of the strain energy, by component.
    wrench
        Wrench as text.
    error
        95 % bounds of the same shape; 0 if unknown.
    """
    groups = (("pose",), ("x µm", "y µm", "z µm"), ("rx µrad", "ry µrad", "rz µrad"))
    halves = np.abs(twist).reshape(-1, 2, 3)
    greatest = np.maximum(halves.max(axis=2, keepdims=True), 1e-3 * halves.max(axis=(1, 2), keepdims=True))
    rounding = NEGLIGIBLE * np.broadcast_to(greatest, halves.shape).reshape(-1, 6)
    shown = np.where(np.abs(twist) > np.maximum(rounding, error), twist, 0.0)
    rows = [(name, *(f"{1e6 * v:.4g}" for v in row)) for name, row in zip(names, shown, strict=True)]
    show_table("Deflection at M" + (wrench and f" under {wrench} N, N·m"), groups, rows)
    order = sorted(shares.items(), key=lambda item: -float(np.max(item[1])))
    parts = [(part, *(f"{100 * v:z.2f}" for v in share)) for part, share in order]
    show_table("Strain energy by component, %", (("component",), *((name,) for name in names)), parts)


def show_modes(names: Sequence[str], found: Modes, title: str) -> None:
    """Show natural frequencies with bounds at each pose, and the elements with most strain energy.

    Parameters
    ----------
    names
        Names of the poses (n,).
    found
        Modes to show.
    title
        Title.
    """
    rows: list[Sequence[str]] = []
    for i, name in enumerate(names):
        for k, (hertz, bound) in enumerate(zip(found.frequencies[i], found.error[i], strict=True)):
            if not np.isfinite(hertz):
                continue
            shares = {element: float(share[i, k]) for element, share in found.energy.items()}
            most = sorted(shares, key=lambda element: -shares[element])[:3]
            said = ", ".join(f"{element} {100 * shares[element]:.0f} %" for element in most if shares[element] > 0.005)
            spread = f"{bound:.2g}" if bound else ""
            rows.append(("" if k else name, str(k + 1), f"{hertz:.5g}", spread, said or "moves freely"))
    groups = (("pose",), ("mode", "Hz", "± mesh error"), ("strain energy",))
    show_table(title, groups, rows, prose=("strain energy",))
    for remark in found.remarks:
        show_line(remark)


def show_change(names: Sequence[str], old: Any, new: Any, overrides: Sequence[str]) -> None:
    """Show the diagonals of stiffness (n, 6, 6) before and after `--set`.

    Parameters
    ----------
    names
        Names of the poses (n,).
    old
        Stiffnesses (n, 6, 6) before.
    new
        Stiffnesses (n, 6, 6) after.
    overrides
        Overrides as given with `--set`.
    """
    factor, units = _scale(old)
    rows = []
    for i, name in enumerate(names):
        before, after = np.diag(old[i]), np.diag(new[i])
        rows.append((name, "before", *(f"{v / factor:z.4f}" for v in before)))
        rows.append(("", "now", *(f"{v / factor:z.4f}" for v in after)))
        rows.append(("", "change", *(f"{100 * (b / a - 1):+z.2f} %" for a, b in zip(before, after, strict=True))))
    show_table(f"Changed: {', '.join(overrides)} ({units.rpartition(',')[0]})", (("pose", ""), *SIX), rows)


def show_findings(title: str, findings: Sequence[Finding]) -> None:
    """Show published and correct numbers with a verdict on each."""
    groups = (("entry",), ("published", "as published (R1)", "correct", "bound"), ("verdict",))
    rows = [
        (f.entry, *(_number(v) for v in (f.published, f.as_published, f.correct, f.bound)), f.verdict) for f in findings
    ]
    show_table(title, groups, rows, prose=("verdict",))


def _number(value: float | None) -> str:
    return "" if value is None or not np.isfinite(value) else f"{value:z.5g}"
