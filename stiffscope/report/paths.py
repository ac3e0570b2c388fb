"""Results along a tool path: tables, figures, CSV, JSON and the HTML page."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
import pyarrow.csv

from stiffscope.design.path.course import BLOCK
from stiffscope.experiments.experiments import EXPERIMENT
from stiffscope.fea.export import write_fields
from stiffscope.report import page
from stiffscope.report.figures import AFTER, BEFORE, new_figure, save_figures
from stiffscope.report.pictures import draw, optional_pictures
from stiffscope.report.run_report import AT_M, ENERGY
from stiffscope.report.terminal import show_facts, show_line, show_table

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from matplotlib.figure import Figure

    from stiffscope.design.path.along import Along, Compensated
    from stiffscope.design.path.stress import PartStress
    from stiffscope.report.robot_view import Case
    from stiffscope.report.run_report import Draft
    from stiffscope.vjm.kinematics import Configurations

_STRESS = ("body", "part", "material", "von_mises", "at", "factor")
_TWIST = ("dx", "dy", "dz", "drx", "dry", "drz")
_MOST_DRAWN = 4000
_MOST_TOLD = 12


def path_columns(state: Along) -> dict[str, np.ndarray]:
    """Return columns (n,) of `path.csv`, SI: length, time, pose, tool error, bound, drive loads."""
    columns = {"s": state.length}
    if state.time is not None:
        columns["t"] = state.time
    columns |= {name: state.path.values[:, k] for k, name in enumerate(state.path.columns)}
    columns |= dict(state.path.free)
    columns |= {name: state.error[:, k] for k, name in enumerate(_TWIST)}
    columns |= {name: state.parts[name] for name in ("normal", "along", "binormal")}
    columns["error"] = state.bound
    return columns | {name: state.forces[:, k] for k, name in enumerate(state.drives)}


def path_json(state: Along, after: Compensated | None, stresses: Sequence[PartStress] = ()) -> dict[str, Any]:
    """Return the results of a path for JSON output."""
    k = state.worst
    answer: dict[str, Any] = {
        "job": state.job.file.name, "robot": state.job.robot.name, "points": len(state.path),
        "length": state.length[-1], "rms": _rms(state), "columns": path_columns(state),
        "worst": {
            "line": int(state.path.lines[k]), "s": state.length[k], "error": state.error[k], "size": state.size[k],
            "normal": state.parts["normal"][k], "along": state.parts["along"][k],
            "binormal": state.parts["binormal"][k], "bound": state.bound[k],
            "shares": {name: share[k] for name, share in state.shares.items()},
            "drives": dict(zip(state.drives, state.forces[k], strict=True)),
            "stress": [{key: getattr(each, key) for key in _STRESS} for each in stresses],
        },
        "frequencies": {"s": state.length[state.stations], "first": state.first},
    }  # fmt: skip
    if state.cutting is not None:
        answer["process"] = vars(state.cutting)
    if state.freed is not None and state.job.section.free is not None:
        answer["free"] = {"least": state.job.section.free.least, "fixed": state.freed.fixed, **_gain(state)}
    if after is not None:
        answer["compensated"] = {
            "before": _rms(state), "after": float(np.sqrt((after.left**2).sum(axis=1).mean())),
            "largest": float(np.abs(after.left).max()), "refused": [list(each) for each in after.refused],
        }  # fmt: skip
    return answer


def _gain(state: Along) -> dict[str, dict[str, float]]:
    """Return greatest and rms error, m, for the best constant and the chosen free coordinates."""
    freed, acting = state.freed, ~state.path.rapid
    if freed is None:
        return {}
    some = acting if acting.any() else ~acting
    each = {"single": freed.before[some], "chosen": freed.error[some]}
    return {name: {"greatest": float(e.max()), "rms": float(np.sqrt((e**2).mean()))} for name, e in each.items()}


def _rms(state: Along) -> float:
    return float(np.sqrt((state.size**2).mean()))


def write_csv(state: Along, file: Path) -> None:
    """Write one row per point, in blocks."""
    columns = path_columns(state)
    schema = pa.schema([(name, pa.float64()) for name in columns])
    with pyarrow.csv.CSVWriter(file, schema) as writer:
        for start in range(0, len(state.path), BLOCK):
            some = slice(start, start + BLOCK)
            writer.write(pa.table({name: np.ascontiguousarray(each[some]) for name, each in columns.items()}, schema))


def show_path(state: Along, after: Compensated | None, stresses: Sequence[PartStress] = ()) -> None:
    """Print the greatest error and its causes, process, drive loads and the compensated error."""
    k, parts = state.worst, state.parts
    acting = ~state.path.rapid
    at = f"line {state.path.lines[k]} of {state.job.path_file.name}, s = {1e3 * state.length[k]:,.1f} mm"
    facts = [
        ("path", f"{len(state.path):,} points, {1e3 * state.length[-1]:,.1f} mm"),
        ("error of the tool", f"rms {_mm(_rms(state))}, greatest {_mm(state.size[k])} ± {_mm(state.bound[k])}"),
        ("greatest at", at),
        ("there", ", ".join(f"{name} {_mm(each[k])}" for name, each in parts.items())),
    ]
    if state.cutting is not None:
        cut = state.cutting
        forces = f"feed {cut.feed:.4g} N, across {cut.across:.4g} N, axial {cut.axial:.4g} N, {cut.power:.4g} W"
        chip = f"{1e3 * cut.chip:.4g} mm; tooth passing {cut.tooth_passing:.4g} Hz"
        facts += [("process", forces), ("mean chip", chip)]
    if state.freed is not None:
        gain = {key: f"rms {_mm(each['rms'])}, greatest {_mm(each['greatest'])}" for key, each in _gain(state).items()}
        facts.append((f"free: {', '.join(state.freed.values)}", f"{gain['chosen']}; held still {gain['single']}"))
    known = state.first[np.isfinite(state.first)]
    if known.size:
        facts.append(("first frequency", f"{known.min():.4g} to {known.max():.4g} Hz along the path"))
    show_facts(f"Path {state.job.path_file.name} on {state.job.robot.name}", facts)
    shares = sorted(state.shares.items(), key=lambda each: -each[1][k])
    rows = [
        (name, f"{100 * share[k]:.1f}", f"{100 * float(share[acting].mean() if acting.any() else share.mean()):.1f}")
        for name, share in shares if share[k] > 5e-4
    ]  # fmt: skip
    show_table("Share of the strain energy (%)", [["element"], ["at the greatest error", "mean of the path"]], rows)
    least = 1e-12 * np.abs(state.forces).max(initial=0.0)  # smaller values are rounding errors
    rows = [
        (name, *(f"{0.0 if abs(end) < least else end:.4g}" for end in (force.min(), force.max())), unit)
        for name, force, unit in zip(state.drives, state.forces.T, state.units, strict=True)
    ]
    show_table("Drive loads", [["drive"], ["least", "greatest", "unit"]], rows)
    if stresses:
        rows = [
            (each.body, f"{1e-6 * each.von_mises:.3g}", ", ".join(f"{1e3 * x:z.1f}" for x in each.at), each.material,
             "" if each.factor is None else f"{each.factor:.3g}")
            for each in stresses
        ]  # fmt: skip
        show_table(
            "Greatest von Mises stress, at the greatest error",
            [["body"], ["MPa"], ["x, y, z in the part (mm)"], ["material"], ["yield strength over stress"]], rows,
        )  # fmt: skip
    if after is not None:
        _show_compensation(state, after)


def _show_compensation(state: Along, after: Compensated) -> None:
    left = np.abs(after.left).max(axis=0)
    names = state.job.robot.tool.pose
    worst = ", ".join(
        f"{name} {value:.2g} {'m' if len(name) == 1 else 'rad'}" for name, value in zip(names, left, strict=True)
    )
    show_line(f"Compensated: the error of {_mm(_rms(state))} rms is reduced to at most {worst}.")
    for line, why in after.refused[:_MOST_TOLD]:
        show_line(f"  line {line} keeps its command: {why}")
    if len(after.refused) > _MOST_TOLD:
        show_line(f"  and {len(after.refused) - _MOST_TOLD} more lines")


def _mm(value: float) -> str:
    return f"{1e3 * value:.4g} mm"


def draw_path(state: Along, after: Compensated | None, folder: Path) -> None:
    """Write path (coloured by error) and error (over length of the path) as PNG and SVG."""
    save_figures(folder, {"path": lambda: _draw_map(state), "error": lambda: _draw_error(state, after)})


def write_stress(stresses: Sequence[PartStress], folder: Path) -> None:
    """Write stress.vtu and draw stress.png for the most stressed part at the greatest error."""
    for each in stresses[:1]:
        mesh = each.tested.experiment.mesh
        field = folder / "stress.vtu"
        write_fields(mesh, field, {"displacement": each.displacement, "von_mises": each.stress})
        node = int(np.argmin(np.linalg.norm(mesh.points - each.at, axis=1)))
        title = f"{each.body} ({each.material}) at the greatest error: {1e-6 * each.von_mises:.3g} MPa"
        with optional_pictures():
            draw(
                "stressed_part", folder / "stress.png", experiment=each.tested.folder / EXPERIMENT, field=field,
                node=node, title=title,
            )  # fmt: skip


def _thinned(n: int) -> np.ndarray:
    return np.unique(np.linspace(0, n - 1, min(n, _MOST_DRAWN)).round().astype(int))


def _draw_map(state: Along) -> Figure:
    from matplotlib.ticker import MaxNLocator
    from mpl_toolkits.mplot3d.art3d import Line3DCollection

    some = _thinned(len(state.path))
    points = 1e3 * state.tool[some, :3]
    drawn = new_figure(7.5, 5.6, f"{state.job.robot.name}: error of the tool along {state.job.path_file.name}")
    axes: Any = drawn.add_subplot(projection="3d")
    lines = Line3DCollection(np.stack([points[:-1], points[1:]], axis=1), cmap="viridis", linewidths=2.0)
    lines.set_array(1e3 * state.size[some][1:])
    axes.add_collection3d(lines)
    worst = 1e3 * state.tool[state.worst, :3]
    axes.scatter(*worst, color="#b3372f", s=30, depthshade=False, label="greatest error")
    axes.legend(frameon=False, loc="upper left")
    low, high = points.min(axis=0), points.max(axis=0)
    least = 0.05 * float((high - low).max())
    spans = np.maximum(high - low, least)
    middle = 0.5 * (low + high)
    for name, k in zip("xyz", range(3), strict=True):
        getattr(axes, f"set_{name}lim")(middle[k] - 0.5 * spans[k], middle[k] + 0.5 * spans[k])
        getattr(axes, f"set_{name}label")(f"{name} (mm)")
        getattr(axes, f"{name}axis").set_major_locator(MaxNLocator(max(1, round(6 * spans[k] / spans.max()))))
    axes.set_box_aspect(spans / spans.max())
    drawn.colorbar(lines, ax=axes, shrink=0.7, pad=0.1, label="size of the error (mm)")
    return drawn


def _draw_error(state: Along, after: Compensated | None) -> Figure:
    some = _thinned(len(state.path))
    length = 1e3 * state.length[some]
    drawn = new_figure(8.0, 5.2 if after is None else 6.6, f"{state.job.robot.name}: error of the tool over length")
    rows = drawn.subplots(2 if after is None else 3, 1, sharex=True, squeeze=False)[:, 0]
    low, high = (1e3 * (state.size + sign * state.bound)[some] for sign in (-1, 1))
    rows[0].fill_between(length, low, high, color=BEFORE, alpha=0.2, lw=0)
    rows[0].plot(length, 1e3 * state.size[some], color=BEFORE, lw=1.2)
    rows[0].set_ylabel("size (mm)")
    for name, colour in (("normal", "#3b7dbf"), ("along", "#d9822b"), ("binormal", "#5b9a68")):
        rows[1].plot(length, 1e3 * state.parts[name][some], lw=1.2, color=colour, label=name)
    rows[1].set_ylabel("component (mm)")
    rows[1].legend(frameon=False, ncol=3, loc="lower right", bbox_to_anchor=(1.0, 0.97))
    if after is not None:
        rows[2].semilogy(length, 1e3 * np.maximum(after.after.size[some], 1e-15), color=AFTER, lw=1.2)
        rows[2].set_ylabel("compensated (mm)")
    rows[-1].set_xlabel("length along the path (mm)")
    for axes in rows:
        axes.grid(color="#e3e7eb", lw=0.6)
        axes.spines[["top", "right"]].set_visible(False)
    return drawn


def _chart_error(state: Along, after: Compensated | None) -> page.Chart:
    """Return an interactive chart of error over length, before and after compensation."""
    some = _thinned(len(state.path))
    series = []
    for name, colour, each in (("as commanded", BEFORE, state), ("compensated", AFTER, after and after.after)):
        if each is not None:
            errors = {"size": each.size, **each.parts}
            columns = {"line": [str(line) for line in np.asarray(state.path.lines)[some]]}
            columns |= {"length, mm": 1e3 * state.length[some]}
            columns |= {f"{word}, mm": 1e3 * values[some] for word, values in errors.items()}
            columns |= {f"{axis}, mm": 1e3 * state.tool[some, k] for k, axis in enumerate("xyz")}
            series.append(page.Series(name, colour, columns, size=3))
    _, *shown = series[0].columns
    return page.Chart(series, [shown[0], *shown[5:]], shown[1:5], "Error at every point.", joined=True)


def write_path_page(
    report: Draft, state: Along, after: Compensated | None, found: Configurations, cases: list[list[Case]]
) -> None:
    """Write report.html: the path, error over length, and the robot at the greatest error.

    Parameters
    ----------
    report
        Output folder with the pictures, and the tables.
    state, after
        The path, and its compensated commands, if any.
    found, cases
        Configuration at the greatest error, and the loads to show there.
    """
    still = report.figure("deflection_1.png", "The robot at the greatest error.", "the robot deformed")
    said = "Von Mises stress of the part where it is greatest, at the greatest error."
    hot = report.figures({"stress.png": (said, "stress of a part")})
    drawn = report.figures(
        {
            "path.png": ("The path, coloured by the size of the tool's error.", "path in three dimensions"),
            "error.svg": ("Error of the tool over the length of the path.", "error over length"),
        }
    )
    caption = f"The robot at the greatest error, under all its loads, components coloured by their {ENERGY}."
    view = report.turn_robot(found, ["greatest error"], cases, caption, still)
    charts = [_chart_error(state, after)]
    sections = [
        page.Section("The path", report.shown, drawn, charts=charts, files=("path.csv",)),
        page.Section("The robot at the greatest error", figures=hot, view=view),
    ]
    facts = [f"robot: {state.job.robot.name}", f"job: {state.job.file.name}", AT_M]
    report.write(f"{state.job.robot.name}: {state.job.path_file.name}", facts, sections)
