"""Stability of a cut: tables, figures, CSV, JSON and the HTML page."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
import pyarrow.csv

from stiffscope.path.course import pick_evenly
from stiffscope.report import page
from stiffscope.report.figures import AFTER, BEFORE, new_figure, save_figures
from stiffscope.report.run_report import AT_M
from stiffscope.report.terminal import show_facts, show_line, show_table
from stiffscope.robot.file.quantities import shown_unit
from stiffscope.statics.maps import write_map
from stiffscope.statics.show.maps import Panel, draw_map

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from stiffscope.lobes.model import Lobes, Stability
    from stiffscope.path.job import Job
    from stiffscope.report.run_report import Draft
    from stiffscope.statics.maps import StiffnessMap

STABLE = "#dcefe6"
UNSTABLE = "#f6e3e0"
CHATTER = "#b3372f"
_MOST_ROWS = 12
_MOST_DRAWN = 4000
_LEAST_SHARE = 0.005
_BEYOND = 1e3  # of the job's depth: margins above it are shown as this


def lobes_json(found: Lobes) -> dict[str, Any]:
    """Return the stability of a cut for JSON output."""
    along = found.along
    cutting = found.cutting
    worst = found.worst
    return {
        "job": found.job.file.name,
        "robot": found.job.robot.name,
        "method": found.method,
        "poses": found.found.poses,
        "names": list(found.names),
        "tool": found.at.tool,
        "speed": 60.0 * found.speeds,
        "depth": _bounded(found.depth),
        "error": _bounded(0.5 * (found.high - found.low)),
        "low": _bounded(found.low),
        "high": _bounded(found.high),
        **_limits_json(found.at),
        "cause": {name: share[worst] for name, share in found.at.shares.items()},
        "causes": found.at.shares,
        "levers": [vars(lever) for lever in found.levers],
        "advised": {
            "speed": 60.0 * found.advised,
            "depth": _bounded(found.advised_depth),
        },
        "process": {
            "speed": 60.0 * cutting.speed,
            "depth": cutting.depth,
            "kt": cutting.cut.stiffness,
            "chip": cutting.chip,
            "immersed": cutting.cut.immersed,
            "ripple": cutting.cut.ripple,
        },
        "path": {
            "s": found.length,
            "line": [found.job.path.lines[k] for k in found.points],
            **_limits_json(along),
            "stable": found.stable,
        },
    }


def _limits_json(state: Stability) -> dict[str, Any]:
    return {
        "critical_depth": _bounded(state.critical.depth),
        "critical_low": _bounded(state.critical_low),
        "critical_high": _bounded(state.critical_high),
        "limit": _bounded(state.limit),
        "coupling": _bounded(state.coupling),
        "chatter": state.chatter,
        "mode": state.mode,
    }


def _bounded(depth: np.ndarray) -> np.ndarray:
    """Return depths with NaN (null) for those without a limit."""
    return np.where(np.isfinite(depth), depth, np.nan)


def write_lobes(found: Lobes, folder: Path) -> None:
    """Write lobes.csv, path.csv and the pictures."""
    rows: dict[str, Any] = {"speed": [], "pose": [], "depth": [], "low": [], "high": []}
    for k, name in enumerate(found.names):
        rows["pose"] += [name] * len(found.speeds)
        rows["speed"].append(60.0 * found.speeds)
        for key, each in (
            ("depth", found.depth),
            ("low", found.low),
            ("high", found.high),
        ):
            rows[key].append(each[k])
    numbers = ("speed", "depth", "low", "high")
    columns = {key: np.concatenate(rows[key]) for key in numbers}
    table = pa.table({"pose": rows["pose"], **columns})
    pyarrow.csv.write_csv(table, folder / "lobes.csv")
    along = found.along
    table = pa.table(
        {
            "s": found.length,
            "x": np.ascontiguousarray(along.tool[:, 0]),
            "y": np.ascontiguousarray(along.tool[:, 1]),
            "z": np.ascontiguousarray(along.tool[:, 2]),
            "limit": along.limit,
            "critical_depth": along.critical.depth,
            "critical_low": along.critical_low,
            "critical_high": along.critical_high,
            "chatter": along.chatter,
            "mode": along.mode,
        }
    )
    pyarrow.csv.write_csv(table, folder / "path.csv")
    figures: dict[str, Callable[[], Figure | None]] = {
        "lobes": lambda: _draw_lobes(found)
    }
    if len(found.points) > 1:
        figures["margin"] = lambda: _draw_margin(found)
    save_figures(folder, figures)


def show_lobes(found: Lobes) -> None:
    """Print verdict, limits at the poses, their causes and what raises them."""
    cutting = found.cutting
    along = found.along
    k = found.worst_point
    line = found.job.path.lines[found.points[k]]
    file = found.job.path_file.name
    cut = cutting.cut
    share = 100.0 * found.stable.mean()
    verdict = "stable along the whole path"
    if share == 0.0:
        verdict = "chatters along the whole path"
    elif share < 100.0:
        verdict = f"chatters on {100.0 - share:.0f} % of the path's points"
    where = f"line {line} of {file}, s = {1e3 * found.length[k]:,.1f} mm"
    speeds = f"{60.0 * found.speeds[0]:.0f} to {60.0 * found.speeds[-1]:.0f} rpm"
    force = f"{1e-6 * cut.stiffness:.4g} N/mm² at a chip of {_mm(cutting.chip)}"
    asked = f"{_mm(cutting.depth)} deep at {60.0 * cutting.speed:.0f} rpm"
    facts = [
        ("cut", f"{asked}: {verdict}"),
        ("stable there", f"{_mm(along.limit[k])} at worst, {where}"),
        ("margin", f"{_times(found.margin[k])} the job's depth"),
        ("stable from", f"{speeds}: {_mm(along.critical.depth.min())}"),
        ("teeth in the cut", f"{cut.immersed:.2f}; method: {found.method}"),
        ("force by chip", force),
    ]
    show_facts(f"Chatter: {file} on {found.job.robot.name}", facts)
    show_limits(found.names, found.at)
    if found.levers:
        _show_levers(found)
    if found.advised.size:
        words = ", ".join(
            f"{60.0 * speed:.0f} rpm ({_mm(depth)})"
            for speed, depth in zip(found.advised, found.advised_depth, strict=True)
        )
        show_line(f"Speeds with the highest stable depth at every pose: {words}.")


MAP_TITLES = {"depth": "depth of cut that is stable at all speeds"}


def show_map(found: StiffnessMap) -> None:
    """Print where in the workspace the critical depth is least and greatest."""
    depth = found.more["critical_depth"].values
    if not np.isfinite(depth).any():
        show_line("No depth of cut chatters anywhere on the map.")
        return
    facts = []
    for words, at in (
        ("least", np.nanargmin(depth)),
        ("greatest", np.nanargmax(depth)),
    ):
        row, column = np.unravel_index(at, depth.shape)
        low = found.more["critical_low"].values[row, column]
        high = found.more["critical_high"].values[row, column]
        mode = found.more["limiting_mode"].values[row, column]
        (across, wide) = shown_unit(found.across)
        (up, tall) = shown_unit(found.up)
        place = f"{found.across} = {across * found.columns[column]:.4g} {wide}"
        place += f", {found.up} = {up * found.rows[row]:.4g} {tall}"
        bounds = f"({_mm(low)} to {_mm(high)}), mode of {mode:.4g} Hz"
        facts.append((words, f"{_mm(depth[row, column])} {bounds}, at {place}"))
    facts.append(("poses", f"{np.isfinite(depth).sum()} with a limit"))
    show_facts("Depth of cut that is stable at all speeds", facts)


def write_depth_map(job: Job, found: StiffnessMap, folder: Path) -> None:
    """Write map.csv, map.nc, map.npz and the picture of the critical depth."""
    title = f"{job.robot.name}: {MAP_TITLES['depth']}"
    write_map(found, folder, title)
    more = found.more
    depth = more["critical_depth"].values
    panels = [
        Panel("stable depth of cut (mm)", 1e3 * depth),
        Panel(
            "95 % band, upwards (%)",
            100.0 * (more["critical_high"].values / depth - 1.0),
        ),
        Panel("frequency of chatter (Hz)", more["chatter"].values),
    ]
    files = folder / "depth.png", folder / "depth.svg"
    draw_map(found, panels, job.robot.poses, title, *files)


def show_limits(names: Sequence[str], state: Stability) -> None:
    """Print the stable depths at poses, with frequency of chatter and limiting mode."""
    rows = []
    for k, name in enumerate(names):
        low = _mm(state.critical_low[k])
        high = _mm(state.critical_high[k])
        rows.append(
            (
                name,
                _mm(state.limit[k]),
                _mm(state.critical.depth[k]),
                f"{low} to {high}",
                f"{state.chatter[k]:.4g}",
                f"{state.mode[k]:.4g}",
                _mm(state.coupling[k]),
            )
        )
    columns = [
        ["pose"],
        ["at the job's speed", "at all speeds", "95 %"],
        ["chatter (Hz)", "mode (Hz)"],
        ["without waves"],
    ]
    show_table("Stable depth of cut", columns, rows)


def _show_levers(found: Lobes) -> None:
    """Print each element's share in the limiting mode, and its effect on the limit."""
    worst = found.worst
    effects = {lever.element: lever for lever in found.levers}
    shares = found.at.shares
    order = sorted(shares, key=lambda name: -shares[name][worst])
    rows = []
    for name in order[:_MOST_ROWS]:
        share = shares[name][worst]
        lever = effects.get(name)
        small = lever is None or abs(lever.per_cent) < _LEAST_SHARE
        if share < _LEAST_SHARE and small:
            continue
        gain = ""
        heavier = ""
        if lever is not None:
            gain = f"{lever.per_cent:+.3g}"
            if np.isfinite(lever.per_kilogram):
                heavier = f"{100.0 * lever.per_kilogram:+.3g}"
        rows.append((name, f"{100.0 * share:.1f}", gain, heavier))
    columns = [
        ["element"],
        ["share of the mode (%)"],
        ["limit by 1 % stiffness (%)", "by 1 kg of it (%)"],
    ]
    show_table(f"What limits the depth at {found.names[worst]}", columns, rows)
    best = found.levers[0]
    if best.per_cent > 0.0:
        words = f"1 % more stiffness of {best.element} raises it most, by {best.per_cent:.3g} %"
        heavier = [each for each in found.levers if each.per_kilogram > 0.0]
        if heavier:
            most = max(heavier, key=lambda lever: lever.per_kilogram)
            gain = 100.0 * most.per_kilogram
            words += f"; of a kilogram, one of {most.element}, by {gain:.3g} %"
        show_line(f"{words}.")


def _mm(depth: float) -> str:
    return f"{1e3 * depth:.4g} mm" if np.isfinite(depth) else "no limit"


def _times(margin: float) -> str:
    return f"{margin:.3g} times" if np.isfinite(margin) else "without limit"


def _draw_lobes(found: Lobes) -> Figure:
    count = len(found.names)
    title = f"{found.job.robot.name}: stable depth of cut over speed"
    drawn = new_figure(8.0, 1.2 + 2.4 * count, title)
    rows = np.atleast_1d(drawn.subplots(count, 1, sharex=True))
    for k, axes in enumerate(rows):
        _draw_lobe(axes, found, k)
    rows[-1].set_xlabel("spindle speed (rpm)")
    handles, labels = rows[0].get_legend_handles_labels()
    drawn.legend(
        handles, labels, frameon=False, ncol=5, loc="outside lower center", fontsize=9
    )
    return drawn


def _draw_lobe(axes: Axes, found: Lobes, k: int) -> None:
    """Draw one pose: stable and unstable side, band, limit and operating point."""
    rpm = 60.0 * found.speeds
    cutting = found.cutting
    depth = 1e3 * found.depth[k]
    known = depth[np.isfinite(depth)]
    least = known.min(initial=1e3 * cutting.depth)
    typical = np.quantile(known, 0.9) if known.size else 1e3 * cutting.depth
    top = max(1.6 * typical, 1.3e3 * cutting.depth)
    log = 1e3 * cutting.depth > 8.0 * typical or top > 40.0 * least
    bottom = 0.4 * min(least, 1e3 * cutting.depth) if log else 0.0
    cap = 100.0 * top
    depth = np.minimum(np.nan_to_num(depth, posinf=cap), cap)
    low = np.minimum(np.nan_to_num(1e3 * found.low[k], posinf=cap), cap)
    high = np.minimum(np.nan_to_num(1e3 * found.high[k], posinf=cap), cap)
    axes.set_facecolor(UNSTABLE)
    axes.fill_between(rpm, bottom, depth, color=STABLE, lw=0, label="stable")
    axes.fill_between(rpm, low, high, color=BEFORE, alpha=0.22, lw=0, label="95 % band")
    axes.plot(rpm, depth, color=AFTER, lw=1.4, label="limit")
    axes.fill_between([], [], [], color=UNSTABLE, label="chatter")
    axes.plot(
        60.0 * cutting.speed,
        1e3 * cutting.depth,
        marker="o",
        ms=7,
        mec="white",
        ls="",
        color=CHATTER if cutting.depth > found.at.limit[k] else AFTER,
        label="the job",
    )
    if log:
        axes.set_yscale("log")
    axes.set_ylim(bottom, top)
    axes.set_xlim(rpm[0], rpm[-1])
    axes.set_ylabel("depth (mm)")
    axes.set_title(found.names[k], loc="left", fontsize=10, parse_math=False)
    axes.spines[["top", "right"]].set_visible(False)


def _draw_margin(found: Lobes) -> Figure:
    """Draw the path from above, coloured by its margin, and limits over length."""
    from matplotlib.collections import LineCollection
    from matplotlib.colors import TwoSlopeNorm

    title = (
        f"{found.job.robot.name}: margin to chatter along {found.job.path_file.name}"
    )
    drawn = new_figure(9.0, 4.6, title)
    left, right = drawn.subplots(1, 2, width_ratios=(1.0, 1.2))
    some = pick_evenly(len(found.points), _MOST_DRAWN)
    points = 1e3 * found.along.tool[some, :3]
    spans = np.ptp(points, axis=0)
    across, up = sorted(np.argsort(-spans, kind="stable")[:2])
    margin = np.log10(np.clip(found.margin[some], 1.0 / _BEYOND, _BEYOND))
    low = min(margin.min(), -0.01)
    high = max(margin.max(), 0.01)
    segments = np.stack(
        [points[:-1][:, [across, up]], points[1:][:, [across, up]]], axis=1
    )
    gaps = np.diff(found.points[some]) <= max(1, np.diff(found.points[some]).min())
    lines = LineCollection(
        list(segments[gaps]),
        cmap="RdYlGn",
        norm=TwoSlopeNorm(0.0, low, high),
        linewidths=2.6,
    )
    lines.set_array(margin[1:][gaps])
    left.add_collection(lines)
    worst = 1e3 * found.along.tool[found.worst_point, :3]
    left.plot(
        worst[across], worst[up], "o", mfc="none", mec=BEFORE, ms=9, label="worst"
    )
    left.autoscale_view()
    left.set_aspect("equal")
    left.set_xlabel(f"{'xyz'[across]} (mm)")
    left.set_ylabel(f"{'xyz'[up]} (mm)")
    above: Any = {"frameon": False, "fontsize": 9, "loc": "lower left"}
    left.legend(bbox_to_anchor=(0.0, 1.0), **above)
    bar = drawn.colorbar(lines, ax=left, shrink=0.8, location="bottom", pad=0.02)
    ticks = np.array([t for t in bar.get_ticks() if low <= t <= high])
    bar.set_ticks(list(ticks), labels=[f"{10**t:.2g}" for t in ticks])
    bar.set_label("stable depth over the job's")
    length = 1e3 * found.length[some]
    along = found.along
    cap = 1e3 * _BEYOND * found.cutting.depth
    limit = np.minimum(1e3 * along.limit[some], cap)
    speed = 60.0 * found.cutting.speed
    right.fill_between(
        length,
        1e3 * along.critical_low[some],
        np.minimum(1e3 * along.critical_high[some], cap),
        color=BEFORE,
        alpha=0.2,
        lw=0,
    )
    right.plot(
        length,
        np.minimum(1e3 * along.critical.depth[some], cap),
        color=BEFORE,
        lw=1.2,
        label="at all speeds, 95 % band",
    )
    right.plot(length, limit, color=AFTER, lw=1.4, label=f"at {speed:.0f} rpm")
    right.axhline(
        1e3 * found.cutting.depth, color=CHATTER, lw=1.2, ls="--", label="the job"
    )
    right.set_yscale("log")
    right.set_xlabel("length along the path (mm)")
    right.set_ylabel("stable depth of cut (mm)")
    right.legend(bbox_to_anchor=(0.0, 1.0), ncols=3, **above)
    right.grid(color="#e3e7eb", lw=0.6)
    right.spines[["top", "right"]].set_visible(False)
    return drawn


def _chart_lobes(found: Lobes) -> page.Chart:
    colours = ("#2f7d6b", "#3b7dbf", "#d9822b", "#8a5aa8", "#b3372f", "#4b5560")
    series = []
    for k, name in enumerate(found.names):
        columns: dict[str, Any] = {"pose": [name] * len(found.speeds)}
        columns["speed, rpm"] = 60.0 * found.speeds
        columns["stable depth, mm"] = 1e3 * found.depth[k]
        columns["lower end, mm"] = 1e3 * found.low[k]
        columns["upper end, mm"] = 1e3 * found.high[k]
        series.append(page.Series(name, colours[k % len(colours)], columns, size=3))
    _, speed, *depths = series[0].columns
    return page.Chart(series, [speed], depths, "Lobes at every pose.", joined=True)


def write_lobes_page(found: Lobes, report: Draft) -> None:
    """Write report.html: verdict, lobes, and the path coloured by its margin.

    Parameters
    ----------
    found
        Stability of the cut.
    report
        Output folder with the pictures, and the tables.
    """
    drawn = report.figures(
        {
            "lobes.png": (
                "Stable depth of cut over speed: green is stable, red chatters; the dot is the job.",
                "stability lobes",
            )
        }
    )
    margin = report.figures(
        {
            "margin.png": (
                "The path, coloured by its margin: green is stable, red chatters.",
                "the path coloured by margin, and stable depth over length",
            )
        }
    )
    sections = [
        page.Section(
            "Will it chatter?",
            report.shown,
            drawn,
            charts=[_chart_lobes(found)],
            files=("lobes.csv", "lobes.json"),
        ),
        page.Section("Along the path", figures=margin, files=("path.csv",)),
    ]
    job = found.job
    facts = [f"robot: {job.robot.name}", f"job: {job.file.name}", AT_M]
    report.write(f"{job.robot.name}: chatter on {job.path_file.name}", facts, sections)
