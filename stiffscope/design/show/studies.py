"""Output of a study as tables, pictures, HTML page and files: its designs, and the best of them."""

from __future__ import annotations

from collections import Counter
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.design.show.sensitivities import quantity
from stiffscope.design.verdicts import find_bounds, find_nearest, judge_convergence
from stiffscope.errors import say_count
from stiffscope.report.figures import (
    AFTER,
    BEFORE,
    EFFECT,
    NOISE,
    new_figure,
    save_figures,
)
from stiffscope.report.numbers import choose_unit
from stiffscope.report.page import Chart, Section, Series
from stiffscope.report.terminal import Shown, show_line, show_table
from stiffscope.runtime.formats import TABLE_FORMATS, write_table

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from stiffscope.design.making import Design
    from stiffscope.design.studies import Study
    from stiffscope.design.study_file import StudyFile
    from stiffscope.report.page import Figure as PageFigure
    from stiffscope.report.run_report import Draft

TABLE = "designs"
MOST_ROWS = 20  # best designs shown; the CSV table has all
MOST_LISTED = 500  # designs in the page's table
MOST_DRAWN = 2000  # designs in a picture, besides the best
COLOURS = {"feasible": AFTER, "infeasible": NOISE, "failed": NOISE}
CAPTIONS = {
    "pareto": "Objectives of all designs; a line connects the best",
    "progress": "The objective by design, in order of evaluation",
    "parallel": "Every design as a line through its parameters and responses, the best in colour",
}


def write_study(study: Study, folder: Path) -> None:
    """Write the table in every format, and the pictures."""
    columns = {str(name): each for name, each in study.table.items()}
    write_table(columns, folder / TABLE, TABLE_FORMATS)
    figures = {"pareto": _front, "progress": _progress, "parallel": _parallel}
    save_figures(folder, {stem: partial(draw, study) for stem, draw in figures.items()})


def write_study_page(study: Study, report: Draft) -> None:
    """Write the page with the shown tables, the folder's pictures and the manifest."""
    stem = "pareto" if len(study.file.goals) > 1 else "progress"
    words = {
        name: {f"{name}.png": (CAPTIONS[name], CAPTIONS[name])}
        for name in (stem, "parallel")
    }
    still, parallel = map(report.figures, words.values())
    facts = [
        f"method {study.file.method}",
        say_count(len(study.designs), "design"),
        "files in SI units",
    ]
    sections = [
        Section(
            "Designs", report.shown, files=[TABLE + suffix for suffix in TABLE_FORMATS]
        ),
        Section(
            "Every design",
            [_list_designs(study)],
            charts=[_chart_designs(study, *still)],
        ),
        Section("Parameters and responses", (), parallel),
    ]
    report.write(
        f"{study.file.path.stem}: a study of {study.file.robot.name}", facts, sections
    )


def _list_designs(study: Study) -> Shown:
    """Return a table with one design per row, at most `MOST_LISTED`, the best first."""
    file = study.file
    states = study.outcomes.states.astype(object)
    names = (
        "design",
        *(v.name for v in file.variables),
        *(r.name for r in file.responses),
        "state",
    )
    states[list(study.best)] = "best"
    order = list(dict.fromkeys([*study.best, *range(len(study.designs))]))[:MOST_LISTED]
    present = tuple((*row, "present") for row in _present_rows(study))
    more = len(study.designs) - len(order)
    ends = f"the best first; {TABLE}.csv has {more} more"
    title = f"The first {len(order)} designs, {ends}" if more else "All designs"
    rows = tuple((*_row(study, k), states[k]) for k in order)
    return Shown(title, names, (*present, *rows), folded=True)


def _chart_designs(study: Study, still: PageFigure | None = None) -> Chart:
    """Return a chart of all responses and parameters; a click on a point finds its row."""
    table = study.table
    goals = [_column(study, goal.response) for goal in study.file.goals]
    order = [
        *goals,
        *(
            response.column
            for response in (*study.file.responses, *study.file.variables)
        ),
    ]
    columns: dict[str, Any] = {"design": table["design"].astype(str).to_numpy()}
    axes = {"design, number": table["design"].to_numpy()} if len(goals) < 2 else {}
    for name in dict.fromkeys(order):
        values = table[name].to_numpy()
        (title, _, unit) = name.rstrip("]").partition(" [")
        if values.dtype.kind not in "fi":
            columns[name] = values
            continue
        factor, shown = choose_unit(unit, values[np.isfinite(values)])
        axes[title if shown in {"", "1"} else f"{title}, {shown}"] = values / factor
    columns |= axes
    groups = [
        (word, np.setdiff1d(some, study.best)) for word, some in _group_by_state(study)
    ]
    groups.append(("best", np.array(study.best[:MOST_DRAWN], dtype=int)))
    series = []
    for word, some in groups:
        if len(some):
            colour, size = (EFFECT, 10) if word == "best" else (COLOURS[word], 6)
            shown = {name: values[some] for name, values in columns.items()}
            series.append(Series(word, colour, shown, size=size))
    x, *y = axes
    caption = "All designs; click a point to find its row in the table."
    return Chart(series, [x, *y], [*y, x], caption, still)


def study_json(study: Study) -> dict[str, Any]:
    """Return a study for JSON output: one row per design, SI; missing values are null."""
    table = study.table
    nearest = find_nearest(study)
    (converged, how) = judge_convergence(study)
    limits = find_bounds(study)
    bounds = [
        {"parameter": b.variable.name, "end": b.end, "designs": b.count} for b in limits
    ]
    return {
        "study": study.file.path,
        "method": study.file.method,
        "columns": list(table.columns),
        "rows": table.astype(object).to_numpy().tolist(),
        "present": study.present
        and {
            "values": dict(
                zip(
                    [v.name for v in study.file.variables],
                    study.present.values,
                    strict=True,
                )
            ),
            "responses": dict(
                zip(
                    [r.name for r in study.file.responses],
                    study.present.responses,
                    strict=True,
                )
            ),
            "reason": study.present.reason,
        },
        "best": [k + 1 for k in study.best],
        "converged": converged,
        "search": list(how),
        "bounds": bounds,
        "nearest": nearest
        and {
            "design": nearest.design + 1,
            "constraint": nearest.limit.text,
            "value": nearest.found,
        },
    }


def show_study(study: Study) -> None:
    """Show the best designs, the number feasible, reasons of failures and remarks on the search."""
    file = study.file
    states = Counter(study.outcomes.states.tolist())
    counts = ", ".join(f"{states[word]} {word}" for word in COLOURS if word in states)
    nearest = find_nearest(study)
    chosen = study.best or ([nearest.design] if nearest else range(len(study.designs)))
    rows = [_row(study, k) for k in chosen[:MOST_ROWS]]
    rows = [*_present_rows(study), *rows]
    groups = [
        ("design",),
        [v.name for v in file.variables],
        [r.name for r in file.responses],
    ]
    goals = ", ".join(
        f"{'least' if g.sign > 0 else 'greatest'} {g.response}" for g in file.goals
    )
    what = "Nearest design" if nearest else "Designs"
    if study.best and goals:
        what = f"Best designs ({goals})"
    limits = (
        f" with {', '.join(limit.text for limit in file.limits)}" if file.limits else ""
    )
    show_table(f"{what}{limits}", groups, rows)
    more = len(chosen) - MOST_ROWS
    if more > 0:
        show_line(f"  {more} more in {TABLE}.csv")
    show_line(f"  {say_count(len(study.designs), 'design')}: {counts}")
    for line in _describe_search(study):
        show_line(f"  {line}")
    for reason, count in Counter(study.designs.reasons.values()).most_common(3):
        show_line(f"  failed{f' ({count})' if count > 1 else ''}: {reason}")


def _describe_search(study: Study) -> list[str]:
    """Return lines on infeasibility, convergence of the search and parameters at their bounds."""
    lines: list[str] = []
    nearest = find_nearest(study)
    (converged, how) = judge_convergence(study)
    if nearest is not None:
        unit = next(
            r.unit for r in study.file.responses if r.name == nearest.limit.response
        )
        limit = nearest.limit
        found = quantity(nearest.found, unit, 4)
        has = f"design {nearest.design + 1}, has {limit.response} {found}, wanted {limit.text}"
        lines.append(f"No design is feasible: the nearest, {has}")
        designs_made = int((~study.outcomes.failed).sum())
        lines += [
            f"{limit.text}: met by {count or 'none'} of {designs_made} designs"
            for limit, count in zip(study.file.limits, nearest.met, strict=True)
        ]
    elif len(study.designs) and study.outcomes.failed.all():
        lines.append("No design is feasible: all failed")
    if how:
        word = "converged" if converged else "did not converge: allow more designs"
        lines.append(f"the search {word} ({'; '.join(how)})")
    for margin in find_bounds(study):
        value = margin.variable.low if margin.end == "lower" else margin.variable.high
        shown = quantity(value, margin.variable.unit) if value is not None else ""
        many = len(study.best) > 1
        which = (
            f"{margin.count} of {len(study.best)} best designs"
            if many
            else "the best design"
        )
        bound = f"{margin.end} bound, {shown}"
        lines.append(
            f"{margin.variable.name} of {which} is at its {bound}: widen the range"
        )
    return lines


def _row(study: Study, index: int) -> list[str]:
    return _design_row(study.file, study.designs[index], str(index + 1))


def _present_rows(study: Study) -> list[list[str]]:
    """Return the row of the present design, if it was computed."""
    if study.present is None:
        return []
    return [_design_row(study.file, study.present, "0, as it is")]


def _design_row(file: StudyFile, design: Design, name: str) -> list[str]:
    values = [
        value if isinstance(value, str) else quantity(value, v.unit)
        for v, value in zip(file.variables, design.values, strict=True)
    ]
    pairs = zip(design.responses, file.responses, strict=True)
    return [
        name,
        *values,
        *(quantity(value, r.unit, 5) for value, r in pairs),
    ]


def _choose_drawn(study: Study) -> np.ndarray:
    """Return the indices of the designs to draw: successful ones, evenly thinned, and the best."""
    successful = np.flatnonzero(~study.outcomes.failed)
    thin = successful[:: max(1, -(-len(successful) // MOST_DRAWN))]
    return np.union1d(thin, np.array(study.best[:MOST_DRAWN], dtype=thin.dtype))


def _front(study: Study) -> Figure | None:
    """Draw the first two objectives of all designs; None below two objectives."""
    goals = study.file.goals
    if len(goals) < 2:
        return None
    drawn = new_figure(7.5, 5.5, f"{study.file.path.stem}: objectives of the designs")
    axes = drawn.subplots()
    values = study.outcomes.objectives * [goal.sign for goal in goals]
    for word, some in _group_by_state(study):
        colour = COLOURS[word]
        axes.plot(*values[some, :2].T, "o", ms=4, color=colour, alpha=0.6, label=word)
    mark = "o-" if len(goals) == 2 else "o"
    axes.plot(*values[list(study.best), :2].T, mark, ms=5, color=EFFECT, label="best")
    here = [_present_value(study, goal.response) for goal in goals[:2]]
    axes.plot(
        [here[0]], [here[1]], "s", ms=8, mfc="none", color=BEFORE, label="present"
    )
    for set_label, goal in zip((axes.set_xlabel, axes.set_ylabel), goals, strict=False):
        words = f"{_column(study, goal.response)}, {'less' if goal.sign > 0 else 'more'} is better"
        set_label(words, parse_math=False)
    _tidy(axes)
    return drawn


def _group_by_state(study: Study) -> list[tuple[str, np.ndarray]]:
    """Return the indices of the designs to draw by state."""
    drawn = _choose_drawn(study)
    states = study.outcomes.states
    groups = [
        (word, drawn[states[drawn] == word]) for word in ("infeasible", "feasible")
    ]
    return [(word, some) for word, some in groups if len(some)]


def _progress(study: Study) -> Figure | None:
    """Draw a single objective by design; None for several objectives."""
    if len(study.file.goals) != 1:
        return None
    (goal,) = study.file.goals
    drawn = new_figure(7.5, 4.5, f"{study.file.path.stem}: {goal.response}")
    axes = drawn.subplots()
    values = goal.sign * study.outcomes.objectives[:, 0]
    for word, some in _group_by_state(study):
        axes.plot(some + 1, values[some], "o", ms=4, color=COLOURS[word], label=word)
    best = np.array(study.best, dtype=int)
    if len(best):
        axes.plot(best + 1, values[best], "o", ms=9, color=EFFECT, label="best")
    here = _present_value(study, goal.response)
    if np.isfinite(here):
        axes.axhline(here, color=BEFORE, lw=1.0, ls="--", label="present design")
    axes.set_xlabel("design")
    axes.set_ylabel(_column(study, goal.response), parse_math=False)
    _tidy(axes)
    return drawn


def _present_value(study: Study, response: str) -> float:
    """Return a response of the present design, SI; NaN if it was not computed."""
    if study.present is None:
        return np.nan
    names = [each.name for each in study.file.responses]
    return study.present.responses[names.index(response)]


def _column(study: Study, response: str) -> str:
    return next(each.column for each in study.file.responses if each.name == response)


def _parallel(study: Study) -> Figure | None:
    """Draw parallel coordinates: parameters and responses, each scaled from minimum to maximum."""
    done = _choose_drawn(study).tolist()
    states = study.outcomes.states
    if not done:
        return None
    shown: list[Any] = [*study.file.variables, *study.file.responses]
    columns = [
        *zip(*(study.designs.values[k] for k in done), strict=True),
        *study.designs.responses[done].T.tolist(),
    ]
    drawn = new_figure(
        max(7.5, 1.5 * len(columns)),
        5.0,
        f"{study.file.path.stem}: parameters and responses",
    )
    axes = drawn.subplots()
    heights = np.array([_heights(values) for values in columns])
    best = set(study.best)
    for column, k in enumerate(done):
        style: Any = {"color": COLOURS[states[k]], "lw": 0.6, "zorder": 1, "alpha": 0.5}
        if k in best:
            style = {"color": EFFECT, "lw": 1.6, "zorder": 3, "alpha": 0.9}
        axes.plot(heights[:, column], **style)
    for place, (each, values) in enumerate(zip(shown, columns, strict=True)):
        axes.axvline(place, color=BEFORE, lw=0.8)
        marked = [(-0.06, min(values)), (1.03, max(values))]
        if isinstance(values[0], str):
            marked = {
                (at + 0.02, word)
                for at, word in zip(heights[place], values, strict=True)
            }
        for height, value in marked:
            text = value if isinstance(value, str) else quantity(value, each.unit, 4)
            style = {
                "bbox": {"facecolor": "white", "edgecolor": "none", "pad": 1.0},
                "parse_math": False,
            }
            axes.text(place, height, text, ha="center", fontsize=7, **style)
    names = [design.name for design in shown]
    axes.set_xticks(range(len(shown)), names, fontsize=8, rotation=20, parse_math=False)
    axes.set_yticks([])
    axes.set_ylim(-0.1, 1.1)
    axes.spines[["top", "right", "left", "bottom"]].set_visible(False)
    return drawn


def _heights(values: Sequence[Any]) -> np.ndarray:
    """Return numbers, or indices of words, scaled from 0 to 1."""
    words = any(isinstance(value, str) for value in values)
    numbers = (
        np.unique([*map(str, values)], return_inverse=True)[1]
        if words
        else np.array(values)
    )
    spread = np.ptp(numbers)
    return (numbers - numbers.min()) / spread if spread else np.full(len(numbers), 0.5)


def _tidy(axes: Axes) -> None:
    axes.legend(frameon=False)
    axes.ticklabel_format(useMathText=True, scilimits=(-3, 5))
    axes.grid(color="#e3e7eb", lw=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
