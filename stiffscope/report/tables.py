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
from stiffscope.vjm.model.mechanism import DIAGONAL

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from stiffscope.experiments.assembly import Assembled
    from stiffscope.vjm.statics.analysis import Stiffness
    from stiffscope.vjm.vibration.modes import Modes

SIX = (DIAGONAL[:3], DIAGONAL[3:])
COUPLINGS = ("K_15", "K_24")
SAG = ("|sag| µm", "sag z µm")
PUSH = "1/C_ii"
PUSH_WORDS = f"{PUSH}: a push along one direction with all others free; K_ii holds them"


def sources(assembled: Assembled) -> str:
    """Return the sources of the parts' matrices in a few words."""
    return ", ".join(map(": ".join, assembled.sources.items())) or "rigid parts"


def show_stiffness(
    names: Sequence[str],
    state: Stiffness,
    bars: Any | None = None,
    *,
    title: str = "Stiffness at M",
) -> None:
    """Show the diagonal of K, two couplings and the sag at each pose.

    Parameters
    ----------
    names, state
        Names of n poses, and stiffness there.
    bars : (n, 6, 6)
        95 % bounds on the stiffness, propagated from the parts' experiments.
    title
        Title above the table.
    """
    pose = state.configurations.mechanism.tool.pose
    sags = np.any(state.sag)
    factor, units = _scale(_shown_diagonals(state))
    bounds = np.zeros_like(state.matrix) if bars is None else bars
    rows: list[Sequence[str]] = []
    stuck = state.nearly_rigid
    for i, name in enumerate(names):
        matrix = state.matrix[i]
        bound = bounds[i]
        sag = 1e6 * state.sag[i, :3]
        sunk = [f"{np.linalg.norm(sag):.2f}", f"{sag[2]:z.2f}"] if sags else ["", ""]
        place = pose_values(state.poses[i], pose)
        alone = [
            "rigid" if rigid else f"{value / factor:.4f}"
            for value, rigid in zip(state.alone[i], stuck[i], strict=True)
        ]
        if stuck[i].any() or len(state.rigid[i]):  # K has no digits that say anything
            rows.append((name, place, *alone, "", "", *sunk))
            continue
        shown = np.where(find_resolved(matrix, bound), matrix, np.nan) / factor
        rows.append(
            (name, place, *format_cells(_diagonal_and_couplings(shown), ".4f"), *sunk)
        )
        if bars is not None:
            spread = (f"{v:.2g}" for v in _diagonal_and_couplings(bound / factor))
            rows.append(("", "± 95 %", *spread, "", ""))
        if np.isfinite(state.compliance[i]).all():
            rows.append(("", PUSH, *alone, "", "", "", ""))
    where = coordinates(pose)
    groups = (("pose", where), *SIX, (*COUPLINGS, *SAG))
    show_table(
        f"{title} ({units})", groups, rows, prose=(where,) if len(pose) > 3 else ()
    )
    told = f"  {PUSH_WORDS}\n"
    if stuck.any():
        told = f"  rigid: infinite, or stiffer than the others by 10⁶; there only {PUSH} is shown\n"
    show_line(told)
    explain_zeros(rows)


def show_full_matrices(
    names: Sequence[str],
    state: Stiffness,
    bars: Any | None = None,
    soft_bars: Any | None = None,
) -> None:
    """Show K and C (6, 6) at each pose with 95 % bounds; only C if a direction is rigid.

    Parameters
    ----------
    names, state
        Names of n poses, and stiffness there.
    bars, soft_bars : (n, 6, 6)
        95 % bounds on the stiffness and on the compliance.
    """
    scale = np.full((6, 6), 1e-3)
    scale[:3, :3] = 1e-6
    bounds, soft = (
        np.zeros_like(state.matrix) if bound is None else bound
        for bound in (bars, soft_bars)
    )
    for i, name in enumerate(names):
        if not len(state.rigid[i]):
            rows = _with_bounds(state.matrix[i], bounds[i], scale, WRENCH)
            title = f"K at {name}, N/µm, N/mrad = N·m/mm, N·m/mrad"
            show_table(title, (("",), TWIST[:3], TWIST[3:]), rows)
        rows = _with_bounds(state.compliance[i], soft[i], np.float64(1e6), TWIST)
        title = f"C at {name}, µm/N, µm/(N·m), µrad/N, µrad/(N·m)"
        show_table(title, (("",), WRENCH[:3], WRENCH[3:]), rows)


def _with_bounds(
    matrix: np.ndarray,
    bound: np.ndarray,
    scale: np.ndarray | np.float64,
    names: Sequence[str],
) -> list[Sequence[str]]:
    clear = find_resolved(matrix, bound)
    value = matrix * scale
    spread = bound * scale

    def cell(at: tuple[int, int]) -> str:
        words = (
            f"{value[at]:.5g} ± {spread[at]:.2g}" if spread[at] else f"{value[at]:.5g}"
        )
        return words if clear[at] else ZERO

    return [(name, *(cell((i, j)) for j in range(6))) for i, name in enumerate(names)]


def _shown_diagonals(state: Stiffness) -> np.ndarray:
    """Return diagonal matrices (n, 6, 6) of what is shown of each pose, NaN if rigid."""
    plain = np.einsum("nii->ni", state.finite)
    stuck = state.nearly_rigid
    alone = np.where(stuck, np.nan, state.alone)
    shown = np.where(stuck.any(axis=1, keepdims=True), alone, plain)
    return np.einsum("ni,ij->nij", shown, np.eye(6))


def _scale(stiffness: Any) -> tuple[float, str]:
    """Return a power of 1000 that suits the smallest diagonal stiffness, and its units."""
    diagonals = np.abs(np.diagonal(stiffness, axis1=1, axis2=2))
    notable = diagonals > NEGLIGIBLE * np.nanmax(diagonals, initial=0.0)
    least = np.min(diagonals, where=notable, initial=np.inf)
    powers = ((1e6, "10⁶ "), (1e3, "10³ "))
    factor, power = next(
        (exponent for exponent in powers if least >= 0.1 * exponent[0]), (1.0, "")
    )
    return factor, f"{power}N/m, {power}N·m/rad, {power}N"


def _diagonal_and_couplings(matrix: np.ndarray) -> list[float]:
    return [*np.diag(matrix), matrix[0, 4], matrix[1, 3]]


MOST_YIELDING = 8  # components listed


def show_yielding(names: Sequence[str], shares: Mapping[str, Any]) -> None:
    """Show what yields most under a push at M: shares (n,) by component, the largest first."""
    order = sorted(shares.items(), key=lambda item: -float(np.max(item[1])))
    listed = order[:MOST_YIELDING]
    rows = [(part, *(f"{100 * v:z.1f}" for v in share)) for part, share in listed]
    if len(order) > len(listed):
        rest = np.sum([share for _, share in order[MOST_YIELDING:]], axis=0)
        others = f"{len(order) - len(listed)} others"
        rows.append((others, *(f"{100 * v:z.1f}" for v in rest)))
    groups = (("component",), *((name,) for name in names))
    show_table("What yields most under pushes along x, y and z at M, %", groups, rows)


def show_deflection(
    names: Sequence[str],
    twist: Any,
    shares: Mapping[str, Any],
    wrench: str = "",
    error: Any = 0.0,
) -> None:
    """Show tool deflections (n, 6), m and rad, with bounds, and energy shares (n,) by component.

    Parameters
    ----------
    names, twist
        Names (n,) of the poses, and deflections (n, 6), m and rad.
    shares
        Share (n,) of the strain energy, by component.
    wrench, error
        Wrench as text, and 95 % bounds (n, 6) on the deflections; 0 if unknown.
    """
    groups = (("pose",), ("x µm", "y µm", "z µm"), ("rx µrad", "ry µrad", "rz µrad"))
    halves = np.abs(twist).reshape(-1, 2, 3).max(axis=2)
    greatest = np.maximum(halves, 1e-3 * halves.max(axis=1, keepdims=True))
    rounding = NEGLIGIBLE * np.repeat(greatest, 3, axis=1)
    shown = np.where(np.abs(twist) > np.fmax(rounding, error), twist, 0.0)
    each = zip(names, 1e6 * shown, strict=True)
    rows = [(name, *(f"{value:.4g}" for value in row)) for name, row in each]
    show_table("Deflection at M" + (wrench and f" under {wrench} N, N·m"), groups, rows)
    order = sorted(shares.items(), key=lambda item: -float(np.max(item[1])))
    parts = [(part, *(f"{100 * v:z.2f}" for v in share)) for part, share in order]
    groups = (("component",), *((name,) for name in names))
    show_table("Strain energy by component, %", groups, parts)


def show_modes(names: Sequence[str], vibration_modes: Modes, title: str) -> None:
    """Show natural frequencies with bounds at each pose, and the elements with most strain energy.

    Parameters
    ----------
    names, vibration_modes, title
        Names (n,) of the poses, modes there, and title of the table.
    """
    rows: list[Sequence[str]] = []
    for i, name in enumerate(names):
        for k, (hertz, bound) in enumerate(
            zip(vibration_modes.frequencies[i], vibration_modes.error[i], strict=True)
        ):
            if not np.isfinite(hertz):
                continue
            shares = (
                (share[i, k], element)
                for element, share in vibration_modes.energy.items()
            )
            most = sorted(shares, key=lambda each: -each[0])[:3]
            said = ", ".join(
                f"{element} {100 * s:.0f} %" for s, element in most if s > 0.005
            )
            spread = f"{bound:.2g}" if bound else ""
            rows.append(
                (
                    "" if k else name,
                    str(k + 1),
                    f"{hertz:.5g}",
                    spread,
                    said or "moves freely",
                )
            )
    groups = (("pose",), ("mode", "Hz", "± mesh error"), ("strain energy",))
    show_table(title, groups, rows, prose=("strain energy",))
    for remark in vibration_modes.remarks:
        show_line(remark)


def show_change(
    names: Sequence[str],
    old: Any,
    new: Any,
    overrides: Sequence[str],
    bars: Sequence[Any | None] = (None, None),
) -> None:
    """Show the diagonals of stiffness before and after `--set`.

    Parameters
    ----------
    names, old, new
        Names (n,) of the poses, stiffnesses (n, 6, 6) there before and after.
    overrides
        Overrides as given with `--set`.
    bars
        95 % bounds (n, 6, 6) on the stiffness before and after; None if unknown.
    """
    factor, units = _scale(old)
    rows = []
    for i, name in enumerate(names):
        before = np.diag(old[i])
        after = np.diag(new[i])
        for label, each, bar in zip(
            ("before", "now"), (before, after), bars, strict=True
        ):
            rows.append(
                (
                    name if label == "before" else "",
                    label,
                    *(f"{v / factor:z.4f}" for v in each),
                )
            )
            if bar is not None:
                rows.append(
                    ("", "± 95 %", *(f"{v / factor:.2g}" for v in np.diag(bar[i])))
                )
        rows.append(
            ("", "change", *(f"{100 * share:+z.2f} %" for share in after / before - 1))
        )
    title = f"Changed: {', '.join(overrides)} ({units.rpartition(',')[0]})"
    show_table(title, (("pose", ""), *SIX), rows)


def show_masses(before: float, now: float) -> None:
    """Show the mass of the solids before and after a change, kg."""
    share = f" ({100 * (now / before - 1):+.2f} %)" if before else ""
    text = f"{before:.5g} kg before, {now:.5g} kg now{share}"
    show_line(f"  Mass of solids and rigid bodies: {text}")
