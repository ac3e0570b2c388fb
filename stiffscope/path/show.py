"""Results along a tool path: tables, figures, CSV, JSON and the HTML page."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.errors import say_count
from stiffscope.experiments.making import EXPERIMENT
from stiffscope.fea.export import write_fields
from stiffscope.path.course import pick_evenly
from stiffscope.report import page
from stiffscope.report.figures import AFTER, BEFORE, new_figure, save_figures
from stiffscope.report.pictures import draw, optional_pictures
from stiffscope.report.run_report import AT_M, ENERGY
from stiffscope.report.terminal import show_facts, show_line, show_table
from stiffscope.runtime.formats import round_off

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path

    from matplotlib.figure import Figure

    from stiffscope.path.along import Along, Compensated
    from stiffscope.path.free_coordinates import FreeChoice
    from stiffscope.path.stress import PartStress
    from stiffscope.report.robot_view import Case
    from stiffscope.report.run_report import Draft
    from stiffscope.vjm.kinematics.configurations import Configurations

_STRESS = ("body", "part", "material", "von_mises", "at", "factor")
_TWIST = ("dx", "dy", "dz", "drx", "dry", "drz")
_PARTS = ("normal", "along", "binormal")
_UNRESOLVED = 1e-9  # m, rad: a compensation that leaves less is told as that
_MOST_DRAWN = 4000
_MOST_TOLD = 12


def path_columns(state: Along) -> dict[str, np.ndarray]:
    """Return columns (n,) of `path.csv`, SI: length, time, pose, tool error, bound, drive loads."""
    columns: dict[str, np.ndarray] = {}

    def add(names: Iterable[str], values: Iterable[np.ndarray]) -> None:
        columns.update(zip(names, round_off(*values), strict=True))

    add(["s"], [state.length])
    if state.time is not None:
        add(["t"], [state.time])
    add(state.path.columns, state.path.values.T)
    for name, values in state.path.free.items():
        add([name], [values])
    add(_TWIST, state.error.T)
    add(_PARTS, [state.parts[name] for name in _PARTS])
    add(["error"], [state.bound])
    add(state.drives, state.forces.T)
    return columns


def path_json(
    state: Along, after: Compensated | None, stresses: Sequence[PartStress]
) -> dict[str, Any]:
    """Return the results of a path for JSON output."""
    k = state.worst
    section = state.job.section
    answer: dict[str, Any] = {
        "job": state.job.file.name,
        "robot": state.job.robot.name,
        "points": len(state.path),
        "length": state.length[-1],
        "rms": _rms(state.size),
        "columns": path_columns(state),
        "worst": {
            "line": int(state.path.lines[k]),
            "s": state.length[k],
            "error": state.error[k],
            "size": state.size[k],
            **{name: each[k] for name, each in state.parts.items()},
            "bound": state.bound[k],
            "shares": {name: share[k] for name, share in state.shares.items()},
            "drives": dict(zip(state.drives, state.forces[k], strict=True)),
            "stress": [
                {key: getattr(stress, key) for key in _STRESS} for stress in stresses
            ],
        },
        "frequencies": {"s": state.length[state.stations], "first": state.first},
    }
    if state.cutting is not None:
        answer["process"] = vars(state.cutting)
    if state.free_choice is not None and section.free is not None:
        fixed = state.free_choice.fixed
        gain = _gain(state.free_choice, state)
        answer["free"] = {"least": section.free.least, "fixed": fixed, **gain}
    if after is not None:
        left = np.linalg.norm(after.left, axis=1)
        answer["compensated"] = {
            "before": _rms(state.size),
            "after": _rms(left),
            "largest": float(np.abs(after.left).max()),
            "refused": list(map(list, after.refused)),
        }
    return answer


def _gain(choice: FreeChoice, state: Along) -> dict[str, dict[str, float]]:
    """Return greatest and rms error, m, for the best constant and the chosen free coordinates."""
    acting = state.path.acting
    errors = ("single", choice.before[acting]), ("chosen", choice.error[acting])
    return {
        name: {"greatest": float(each.max()), "rms": _rms(each)}
        for name, each in errors
    }


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt((values**2).mean()))


def show_path(
    state: Along, after: Compensated | None, stresses: Sequence[PartStress]
) -> None:
    """Print the greatest error and its causes, process, drive loads and the compensated error."""
    k = state.worst
    path = state.path
    file = state.job.path_file.name
    facts = [
        ("path", f"{say_count(len(path), 'point')}, {1e3 * state.length[-1]:,.1f} mm"),
        (
            "error of the tool",
            _two(_rms(state.size), state.size[k])
            + (f" ± {_mm(state.bound[k])}" if state.bound[k] else ""),
        ),
        (
            "greatest at",
            f"line {path.lines[k]} of {file}, s = {1e3 * state.length[k]:,.1f} mm",
        ),
        (
            "there",
            ", ".join(f"{name} {_mm(each[k])}" for name, each in state.parts.items()),
        ),
    ]
    cut = state.cutting
    if cut is not None:
        forces = (
            f"feed {cut.feed:.4g} N, across {cut.across:.4g} N, axial {cut.axial:.4g} N"
        )
        chip = f"{1e3 * cut.chip:.4g} mm; tooth passing {cut.tooth_passing:.4g} Hz"
        facts += [("process", f"{forces}, {cut.power:.4g} W"), ("mean chip", chip)]
    if state.free_choice is not None:
        gain = _gain(state.free_choice, state).values()
        single, chosen = (_two(value["rms"], value["greatest"]) for value in gain)
        facts.append(
            (
                f"free: {', '.join(state.free_choice.values)}",
                f"{chosen}; held still {single}",
            )
        )
    known = state.first[np.isfinite(state.first)]
    if known.size:
        band = f"{known.min():.4g} to {known.max():.4g} Hz along the path"
        facts.append(("first frequency", band))
    show_facts(f"Path {file} on {state.job.robot.name}", facts)
    shares = sorted(state.shares.items(), key=lambda each: -each[1][k])
    rows = [
        (name, f"{100 * share[k]:.1f}", f"{100 * share[path.acting].mean():.1f}")
        for name, share in shares
        if share[k] > 5e-4
    ]
    columns = [["element"], ["at the greatest error", "mean of the path"]]
    show_table("Share of the strain energy (%)", columns, rows)
    least = 1e-12 * np.abs(state.forces).max(
        initial=0.0
    )  # smaller values are rounding errors
    rows = []
    for name, force, unit in zip(
        state.drives, state.forces.T, state.units, strict=True
    ):
        ends = (0.0 if abs(end) < least else end for end in (force.min(), force.max()))
        rows.append((name, *(f"{end:.4g}" for end in ends), unit))
    show_table("Drive loads", [["drive"], ["least", "greatest", "unit"]], rows)
    if stresses:
        rows = []
        for each in stresses:
            place = ", ".join(f"{1e3 * x:z.1f}" for x in each.at)
            factor = "" if each.factor is None else f"{each.factor:.3g}"
            rows.append(
                (
                    each.body,
                    f"{1e-6 * each.von_mises:.3g}",
                    place,
                    each.material,
                    factor,
                )
            )
        columns = [
            ["body"],
            ["MPa"],
            ["x, y, z in the part (mm)"],
            ["material"],
            ["yield strength over stress"],
        ]
        show_table("Greatest von Mises stress, at the greatest error", columns, rows)
    if after is not None:
        _show_compensation(state, after)


def _show_compensation(state: Along, after: Compensated) -> None:
    left = zip(state.job.robot.tool.pose, np.abs(after.left).max(axis=0), strict=True)
    worst = ", ".join(
        f"{name} {most:.2g} {'m' if name in 'xyz' else 'rad'}"
        for name, most in left
        if most >= _UNRESOLVED
    )
    worst = f"at most {worst}" if worst else "less than 1 nm and 1 nrad"
    show_line(
        f"Compensated: the error of {_mm(_rms(state.size))} rms falls to {worst}."
    )
    for line, why in after.refused[:_MOST_TOLD]:
        show_line(f"  line {line} keeps its command: {why}")
    if len(after.refused) > _MOST_TOLD:
        show_line(f"  and {len(after.refused) - _MOST_TOLD} more lines")


def _mm(value: float) -> str:
    return f"{1e3 * value:.4g} mm"


def _two(rms: float, greatest: float) -> str:
    return f"rms {_mm(rms)}, greatest {_mm(greatest)}"


def draw_path(state: Along, after: Compensated | None, folder: Path) -> None:
    """Write path (coloured by error) and error (over length of the path) as PNG and SVG."""
    save_figures(
        folder,
        {"path": lambda: _draw_map(state), "error": lambda: _draw_error(state, after)},
    )


def write_stress(stresses: Sequence[PartStress], folder: Path) -> None:
    """Write stress.vtu and draw stress.png for the most stressed part at the greatest error."""
    for curve in stresses[:1]:
        mesh = curve.tested.experiment.mesh
        field = folder / "stress.vtu"
        write_fields(
            mesh, field, {"displacement": curve.displacement, "von_mises": curve.stress}
        )
        node = int(np.argmin(np.linalg.norm(mesh.points - curve.at, axis=1)))
        stress = f"{1e-6 * curve.von_mises:.3g} MPa"
        title = f"{curve.body} ({curve.material}) at the greatest error: {stress}"
        given = {
            "experiment": curve.tested.folder / EXPERIMENT,
            "field": field,
            "node": node,
        }
        with optional_pictures():
            draw("stressed_part", folder / "stress.png", title=title, **given)


def _draw_map(state: Along) -> Figure:
    from matplotlib.ticker import MaxNLocator
    from mpl_toolkits.mplot3d.art3d import Line3DCollection

    evenly = pick_evenly(len(state.path), _MOST_DRAWN)
    points = 1e3 * state.tool[evenly, :3]
    job = state.job
    drawn = new_figure(
        7.5, 5.6, f"{job.robot.name}: error of the tool along {job.path_file.name}"
    )
    axes: Any = drawn.add_subplot(projection="3d")
    segments = np.stack([points[:-1], points[1:]], axis=1)
    lines = Line3DCollection(segments, cmap="viridis", linewidths=2.0)
    lines.set_array(1e3 * state.size[evenly][1:])
    axes.add_collection3d(lines)
    worst = 1e3 * state.tool[state.worst, :3]
    axes.scatter(
        *worst, color="#b3372f", s=30, depthshade=False, label="greatest error"
    )
    axes.legend(frameon=False, loc="upper left")
    low = points.min(axis=0)
    high = points.max(axis=0)
    spans = np.maximum(high - low, 0.05 * (high - low).max())
    shares = spans / spans.max()
    for name, middle, span, share in zip(
        "xyz", 0.5 * (low + high), spans, shares, strict=True
    ):
        getattr(axes, f"set_{name}lim")(middle - 0.5 * span, middle + 0.5 * span)
        getattr(axes, f"set_{name}label")(f"{name} (mm)")
        getattr(axes, f"{name}axis").set_major_locator(
            MaxNLocator(max(1, round(6 * share)))
        )
    axes.set_box_aspect(shares)
    drawn.colorbar(lines, ax=axes, shrink=0.7, pad=0.1, label="size of the error (mm)")
    return drawn


def _draw_error(state: Along, after: Compensated | None) -> Figure:
    evenly = pick_evenly(len(state.path), _MOST_DRAWN)
    length = 1e3 * state.length[evenly]
    title = f"{state.job.robot.name}: error of the tool over length"
    left = None if after is None else after.after.size[evenly]
    if left is not None and (left < _UNRESOLVED).all():
        left = None
        title += "; compensated: below 1 nm"
    count, height = (2, 5.2) if left is None else (3, 6.6)
    drawn = new_figure(8.0, height, title)
    rows = drawn.subplots(count, 1, sharex=True)
    low, high = (1e3 * (state.size + sign * state.bound)[evenly] for sign in (-1, 1))
    rows[0].fill_between(length, low, high, color=BEFORE, alpha=0.2, lw=0)
    rows[0].plot(length, 1e3 * state.size[evenly], color=BEFORE, lw=1.2)
    rows[0].set_ylabel("size (mm)")
    for name, colour in (
        ("normal", "#3b7dbf"),
        ("along", "#d9822b"),
        ("binormal", "#5b9a68"),
    ):
        rows[1].plot(
            length, 1e3 * state.parts[name][evenly], lw=1.2, color=colour, label=name
        )
    rows[1].set_ylabel("component (mm)")
    rows[1].legend(frameon=False, ncol=3, loc="lower right", bbox_to_anchor=(1.0, 0.97))
    if left is not None:
        left = np.maximum(left, _UNRESOLVED)
        rows[2].semilogy(length, 1e3 * left, color=AFTER, lw=1.2)
        rows[2].set_ylabel("compensated (mm)")
    rows[-1].set_xlabel("length along the path (mm)")
    for axes in rows:
        axes.grid(color="#e3e7eb", lw=0.6)
        axes.spines[["top", "right"]].set_visible(False)
    return drawn


def _chart_error(state: Along, after: Compensated | None) -> page.Chart:
    """Return an interactive chart of error over length, before and after compensation."""
    evenly = pick_evenly(len(state.path), _MOST_DRAWN)
    series = []
    drawn = [("as commanded", BEFORE, state)] + (
        [("compensated", AFTER, after.after)] if after else []
    )
    for name, colour, each in drawn:
        errors = {"size": each.size, **each.parts}
        columns: dict[str, Any] = {
            "line": np.asarray(state.path.lines)[evenly].astype(str)
        }
        columns |= {"length, mm": 1e3 * state.length[evenly]}
        columns |= {
            f"{word}, mm": 1e3 * values[evenly] for word, values in errors.items()
        }
        columns |= {
            f"{axis}, mm": 1e3 * state.tool[evenly, k] for k, axis in enumerate("xyz")
        }
        series.append(page.Series(name, colour, columns, size=3))
    _, length, *y = series[0].columns
    return page.Chart(
        series, [length, *y[4:]], y[:4], "Error at every point.", joined=True
    )


def write_path_page(
    report: Draft,
    state: Along,
    after: Compensated | None,
    configurations: Configurations,
    cases: list[list[Case]],
) -> None:
    """Write report.html: the path, error over length, and the robot at the greatest error.

    Parameters
    ----------
    report
        Output folder with the pictures, and the tables.
    state, after
        The path, and its compensated commands, if any.
    configurations, cases
        Configuration at the greatest error, and the loads to show there.
    """
    here = "The robot at the greatest error"
    still = report.figure("deflection_1.png", f"{here}.", "the robot deformed")
    said = "Von Mises stress of the part where it is greatest, at the greatest error."
    hot = report.figures({"stress.png": (said, "stress of a part")})
    drawn = report.figures(
        {
            "path.png": (
                "The path, coloured by the tool's error.",
                "path in three dimensions",
            ),
            "error.svg": (
                "Error of the tool over the length of the path.",
                "error over length",
            ),
        }
    )
    caption = f"{here}, under all its loads, components coloured by their {ENERGY}."
    view = report.turn_robot(configurations, ["greatest error"], cases, caption, still)
    charts = [_chart_error(state, after)]
    sections = [
        page.Section(
            "The path", report.shown, drawn, charts=charts, files=("path.csv",)
        ),
        page.Section(here, figures=hot, view=view),
    ]
    job = state.job
    facts = [f"robot: {job.robot.name}", f"job: {job.file.name}", AT_M]
    report.write(f"{job.robot.name}: {job.path_file.name}", facts, sections)
