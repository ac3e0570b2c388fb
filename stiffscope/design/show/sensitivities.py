"""Sensitivities of a part and of a robot as tables, bar charts and JSON."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.report.figures import new_figure
from stiffscope.report.numbers import SHOWN_IN
from stiffscope.report.page import Section
from stiffscope.report.tables import PUSH, PUSH_WORDS
from stiffscope.report.terminal import show_line, show_table
from stiffscope.vjm.model.mechanism import DIAGONAL
from stiffscope.vjm.model.screws import CONVENTION

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from matplotlib.figure import Figure

    from stiffscope.design.sensitivity import Row, Sensitivity
    from stiffscope.experiments.experiments import PartResult
    from stiffscope.fea.derivatives import Derivative, PartSensitivity
    from stiffscope.report.run_report import Draft

PUSHES = tuple(f"1/C_{name[2:]}" for name in DIAGONAL)
COMPLIANCES = ("C11", "C22", "C33", "C44", "C55", "C66")
BAR = "#3b7dbf"
BOUND = "#20252b"
LOSS = "#d9822b"
LEAST = 5e-7  # smallest effect shown in a table; finite differences leave errors of about 1e-9
MOST_BARS = 15


def part_json(sensitivity: PartSensitivity, result: PartResult) -> dict[str, Any]:
    """Return a part's derivatives per unit of each parameter for JSON output, SI."""
    names = (
        "value",
        "unit",
        "compliance",
        "error",
        "self_weight",
        "self_weight_error",
        "mass",
        "centre",
    )
    keys: dict[str, str] = dict(zip(names, names, strict=True))
    if len(result.experiment.reference_points) > 1:
        keys |= {"flexibility": "full_compliance", "flexibility_error": "full_error"}
    keys["condensed_mass"] = "condensed_mass"
    parameters = {
        name: {key: getattr(each, held) for key, held in keys.items()}
        for name, each in sensitivity.derivatives.items()
    }
    return {
        "part": sensitivity.part,
        "parameters": parameters,
        "notes": sensitivity.notes,
        "seconds": sensitivity.seconds,
    }


def robot_json(sensitivity: Sensitivity) -> dict[str, Any]:
    """Return a robot's derivatives at n poses and its scatter by tolerances for JSON output, SI."""
    scatter = sensitivity.scatter()
    responses = ("stiffness", "push", "sag", "frequency")
    parameters = {}
    for row in sensitivity.rows:
        parameters[row.parameter.name] = {
            **{
                name: getattr(row.parameter, name)
                for name in ("value", "unit", "tolerance")
            },
            **_responses(row.by),
            **{f"{name}_error": getattr(row.error, name) for name in responses},
            "stiffness_per_kilogram": row.per_kilogram,
        }
    return {
        "poses": sensitivity.poses,
        **_responses(sensitivity.at),
        "parameters": parameters,
        "scatter": None if scatter is None else _responses(scatter),
        "notes": sensitivity.notes,
        "convention": CONVENTION,
    }


def _responses(given: Any) -> dict[str, Any]:
    return {
        name: getattr(given, name)
        for name in ("stiffness", "push", "sag", "frequency", "mass")
    }


def show_part_sensitivity(sensitivity: PartSensitivity, result: PartResult) -> None:
    """Show % of diagonal compliance, of sag by weight and of mass per % of each parameter."""
    for k, interface in enumerate(result.experiment.interfaces[1:]):
        several = len(result.experiment.interfaces) > 2
        _show_at(
            sensitivity,
            result,
            slice(6 * k, 6 * k + 6),
            f" at {interface}" if several else "",
        )
    show_line(
        "  sag: at the loaded face, by own weight along x, y, z; ± 95 % if above one digit."
    )
    show_line(
        "  per kg: the largest gain of an entry of 1/C_ii per kilogram that this adds."
    )
    _show_notes(sensitivity.notes)


def _show_at(
    sensitivity: PartSensitivity, result: PartResult, columns: slice, where: str
) -> None:
    """Show the table of one loaded interface."""
    compliance = result.compliance.diagonal()[columns]
    weight = np.abs(result.experiment.self_weight).max(axis=1)
    at = np.abs(result.experiment.self_weight).argmax(axis=1)
    rows = []
    for name, each in _rank_derivatives(sensitivity, compliance, columns):
        shares = each.value * each.full_compliance.diagonal()[columns] / compliance
        bounds = each.value * each.full_error.diagonal()[columns] / compliance
        sags = each.value * each.self_weight[range(3), at] / weight
        sags *= np.sign(result.experiment.self_weight[range(3), at])
        gain = ""
        if abs(each.mass * each.value) >= 1e-9:
            gains = -each.full_compliance.diagonal()[columns] / compliance / each.mass
            best = int(gains.argmax())
            gain = (
                f"{COMPLIANCES[best]} {100 * gains[best]:+.3g} %"
                if gains[best] >= LEAST
                else ""
            )
        stiff = map(_share, shares, bounds)
        mass = _share(each.value * each.mass / result.experiment.mass)
        rows.append(
            (
                name,
                quantity(each.value, each.unit),
                *stiff,
                *map(_share, sags),
                mass,
                gain,
            )
        )
    halves = COMPLIANCES[:3], COMPLIANCES[3:]
    sag = ("sag x", "sag y", "sag z", "mass")
    groups = [("parameter", "value"), *halves, sag, ("best entry per kg",)]
    show_table(
        f"Sensitivity of the {sensitivity.part}{where}: % per % of each parameter",
        groups,
        rows,
    )


def _rank_derivatives(
    sensitivity: PartSensitivity, compliance: np.ndarray, columns: slice = slice(0, 6)
) -> list[tuple[str, Derivative]]:
    """Return derivatives by name, the greatest effect on the diagonal of an interface first."""

    def effect(item: tuple[str, Derivative]) -> float:
        return np.abs(
            item[1].value * item[1].full_compliance.diagonal()[columns] / compliance
        ).max()

    return sorted(sensitivity.derivatives.items(), key=effect, reverse=True)


def show_sensitivity(sensitivity: Sensitivity, names: Sequence[str]) -> None:
    """Show % of K_ii, 1/C_ii, sag and first frequency per % of each parameter, by pose, sorted."""
    for index, pose in enumerate(names):
        stiffness = np.diagonal(sensitivity.at.stiffness[index])
        sag = sensitivity.at.sag[index, :3]
        rows = []
        for row in rank_rows(sensitivity, index):
            value = row.parameter.value
            along = (
                value * (sag @ row.by.sag[index, :3]) / (sag @ sag)
                if sag.any()
                else np.nan
            )
            share = value / sensitivity.at.frequency[index]
            first = (share * number.frequency[index] for number in (row.by, row.error))
            massive = ["", "", ""]
            if row.per_kilogram is not None:
                gains = np.diagonal(row.per_kilogram[index])[:3] / stiffness[:3]
                counts = np.abs(gains) > LEAST
                none = "·" if counts.any() else ""
                massive = [
                    f"{100 * g:+.3g} %" if told else none
                    for g, told in zip(gains, counts, strict=True)
                ]
            stiff = map(_share, *_diagonals(sensitivity, row, index))
            pushed = map(_share, *_pushes(sensitivity, row, index))
            shown = row.parameter.name, quantity(value, row.parameter.unit)
            rows.append(
                (
                    *shown,
                    *stiff,
                    *pushed,
                    _share(float(along)),
                    _share(*first),
                    *massive,
                )
            )
        per_kilogram = tuple(f"{name} per kg" for name in DIAGONAL[:3])
        groups = [
            ("parameter", "value"),
            DIAGONAL[:3],
            DIAGONAL[3:],
            PUSHES[:3],
            PUSHES[3:],
            ("|sag|", "f1"),
            per_kilogram,
        ]
        show_table(
            f"Sensitivity at {pose}: % of K_ii and {PUSH} per % of each parameter",
            groups,
            rows,
        )
        _show_scatter(sensitivity, index)
    show_line(
        "  per kg: % of K per kilogram that this adds; ± 95 % if above one digit."
    )
    show_line(f"  {PUSH_WORDS}")
    _show_notes(sensitivity.notes)


def rank_rows(sensitivity: Sensitivity, index: int) -> list[Row]:
    """Return rows sorted by their largest effect on K's diagonal at a pose; omit zero effects."""

    def effect(row: Row) -> float:
        on_frequency = (
            row.parameter.value
            * row.by.frequency[index]
            / sensitivity.at.frequency[index]
        )
        return float(
            np.nanmax(
                np.abs([*_diagonals(sensitivity, row, index)[0], 1e-6 * on_frequency])
            )
        )

    rows = (row for row in sensitivity.rows if effect(row) > LEAST * 1e-6)
    return sorted(rows, key=effect, reverse=True)


def _diagonals(sensitivity: Sensitivity, row: Row, index: int) -> np.ndarray:
    """Return the effect of a parameter on K's diagonal at a pose, and its bounds (2, 6)."""
    each = np.array(
        [np.diagonal(number.stiffness[index]) for number in (row.by, row.error)]
    )
    return each * row.parameter.value / np.diagonal(sensitivity.at.stiffness[index])


def _pushes(sensitivity: Sensitivity, row: Row, index: int) -> np.ndarray:
    """Return the effect of a parameter on 1/C_ii at a pose, and its bounds (2, 6)."""
    each = np.array([number.push[index] for number in (row.by, row.error)])
    return each * row.parameter.value / sensitivity.at.push[index]


def _show_scatter(sensitivity: Sensitivity, index: int) -> None:
    scatter = sensitivity.scatter()
    if scatter is None:
        return
    shares = np.diagonal(scatter.stiffness[index]) / np.diagonal(
        sensitivity.at.stiffness[index]
    )
    each = zip(DIAGONAL, shares, strict=True)
    words = ", ".join(f"{name} ± {100 * share:.2g} %" for name, share in each)
    pushes = scatter.push[index] / sensitivity.at.push[index]
    each = zip(PUSHES, pushes, strict=True)
    words += ", " + ", ".join(f"{name} ± {100 * p:.2g} %" for name, p in each)
    more = f", f1 ± {100 * scatter.frequency[index] / sensitivity.at.frequency[index]:.2g} %"
    sag = np.linalg.norm(sensitivity.at.sag[index, :3])
    if sag > 0:
        more += f", |sag| ± {100 * np.linalg.norm(scatter.sag[index, :3]) / sag:.2g} %"
    show_line(
        f"  Tolerances, each taken as 95 % bounds, root sum of squares: {words}{more}"
    )


def _show_notes(notes: dict[str, str]) -> None:
    for name, why in notes.items():
        show_line(f"  {name}: no derivative; {why}")
    show_line("")


_SCALES = {"m": (1e-3, "mm"), "Pa": (1e9, "GPa"), "1": (1.0, "")} | {
    unit: SHOWN_IN[unit][0] for unit in ("N/m", "N·m/rad")
}


def quantity(value: float, unit: str, digits: int = 6) -> str:
    """Return a rounded value as in tables: lengths in mm, stiffnesses in N/µm, moduli in GPa."""
    unit = unit.replace("*", "·")
    factor, shown = _SCALES.get(unit, (1.0, unit))
    return f"{float(f'{value:.{digits}g}') / factor:.6g} {shown}".strip()


def _share(value: float, bound: float = 0.0) -> str:
    """Return a logarithmic derivative, with its bound if larger than half of the last digit."""
    if not np.isfinite(value):
        return "-"
    text = "·" if abs(value) < LEAST else f"{value:+.3f}"
    return f"{text} ± {bound:.3f}" if bound > 5e-4 else text


def write_page(report: Draft, title: str, words: str) -> None:
    """Write ``report.html`` with the shown tables and the folder's chart ``sensitivity.svg``.

    Parameters
    ----------
    report, title
        Folder and tables, and title.
    words
        Description of the chart, its text alternative.
    """
    drawn = report.figures(
        {"sensitivity.svg": (f"{words[0].upper()}{words[1:]} (95 %)", words)}
    )
    sections = [
        Section("Sensitivities", report.shown, drawn, files=("sensitivity.json",))
    ]
    report.write(title, ["derivatives of logarithms: % per %"], sections)


def draw_robot(sensitivity: Sensitivity, pose: str) -> Figure:
    """Draw bars of K_tx at the first pose, named ``pose``: relative and per kilogram."""
    stiffness = sensitivity.at.stiffness[0, 0, 0]
    shares = []
    kilograms = []
    for row in sensitivity.rows:
        share, bound = _diagonals(sensitivity, row, 0)[:, 0]
        if abs(share) > LEAST:
            shares.append((row.parameter.name, share, bound))
            if row.per_kilogram is not None:  # adds mass
                gained = 100 * row.per_kilogram[0, 0, 0] / stiffness
                bound = (
                    100 * row.error.stiffness[0, 0, 0] / abs(row.by.mass) / stiffness
                )
                kilograms.append((row.parameter.name, gained, bound))
    height = 1.6 + 0.32 * min(len(shares), MOST_BARS)
    drawn = new_figure(
        11.0, height, f"{sensitivity.robot.name}: what changes K_tx at {pose}"
    )
    left, right = drawn.subplots(1, 2)
    _bars(
        left,
        sorted(shares, key=lambda bar: -abs(bar[1])),
        "% of K_tx per % of the parameter",
    )
    _bars(
        right,
        sorted(kilograms, key=lambda bar: -abs(bar[1])),
        "% of K_tx per kilogram added",
    )
    return drawn


def draw_part(sensitivity: PartSensitivity, result: PartResult) -> Figure:
    """Draw bars for each diagonal entry of the part's compliance."""
    compliance = result.experiment.compliance.diagonal()
    order = _rank_derivatives(sensitivity, compliance)[:MOST_BARS]
    drawn = new_figure(
        13.0, 2.4 + 0.5 * len(order), f"{sensitivity.part}: what changes its compliance"
    )
    for i, axes in enumerate(drawn.subplots(2, 3, sharey=True).ravel()):
        bars = []
        for name, each in order:
            factor = each.value / compliance[i]
            bars.append(
                (name, factor * each.compliance[i, i], factor * each.error[i, i])
            )
        _bars(axes, bars, f"% of {COMPLIANCES[i]} per %")
    return drawn


def _bars(axes: Any, bars: Iterable[tuple[str, float, float]], label: str) -> None:
    """Draw horizontal bars (name, value, 95 % bound), the first on top."""
    some = list(bars)[:MOST_BARS]
    values, bounds = (np.array([bar[k] for bar in some], dtype=float) for k in (1, 2))
    colours = np.where(values >= 0, BAR, LOSS)
    axes.barh(
        range(len(some)), values, color=colours, xerr=bounds, ecolor=BOUND, capsize=2
    )
    axes.set_yticks(
        range(len(some)), [bar[0] for bar in some], fontsize=8, parse_math=False
    )
    if not axes.yaxis_inverted():
        axes.invert_yaxis()
    axes.axvline(0.0, color="#4b5560", lw=0.8)
    axes.set_xlabel(label)
    axes.locator_params(axis="x", nbins=7)
    axes.grid(axis="x", color="#e3e7eb", lw=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right", "left"]].set_visible(False)
