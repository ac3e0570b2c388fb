"""Measured frequency responses of a campaign beside the nominal robot's: data, tables, pictures."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.gap.forward.response_doubts import (
    find_channel_doubts,
    find_heard_lines,
)
from stiffscope.report.figures import save_figures
from stiffscope.report.page import Section
from stiffscope.report.pictures import optional_pictures
from stiffscope.report.robot_scene import place_robot, pose_text, scene
from stiffscope.report.terminal import show_line, show_list, show_table
from stiffscope.responses.checks import (
    find_resonances,
    find_static_stiffness,
)
from stiffscope.responses.scatter import find_scatter
from stiffscope.responses.show import direction_json, draw_responses, show_static
from stiffscope.vjm.model.mechanism import COORDINATES

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from stiffscope.gap.campaign.measured_responses import MeasuredResponses
    from stiffscope.gap.forward.response_model import ComparedResponses
    from stiffscope.report.run_report import Draft
    from stiffscope.responses.model import Direction, Response
    from stiffscope.robot.file.description import RobotFile
    from stiffscope.vjm.model.mechanism import Mechanism

MOST_LISTED = 8  # frequencies in a table


def responses_json(compared: ComparedResponses) -> dict[str, Any]:
    """Return one set-up as plain data, SI."""
    measured = compared.measured
    setup = measured.setup
    rows = []
    pairs = zip(measured.responses, compared.predicted.receptances, strict=True)
    for response, predicted in pairs:
        static = find_static_stiffness(response)
        coherence = response.coherence
        rows.append(
            {
                "force": direction_json(response.force),
                "motion": direction_json(response.motion),
                "quantity": response.quantity,
                "band": [float(response.frequency[0]), float(response.frequency[-1])],
                "lines": len(response.frequency),
                "coherence": None if coherence is None else float(np.median(coherence)),
                "resonances": response.frequency[find_resonances(response)].tolist(),
                "gap": _find_gap(response, predicted, setup.averages),
                "static_stiffness": None if static is None else static.stiffness,
                "static_spread": None if static is None else static.spread,
                "static_band": None if static is None else list(static.band),
            }
        )
    last = max(float(response.frequency[-1]) for response in measured.responses)
    modes = compared.predicted.modal.frequencies
    return {
        "file": setup.file,
        "pose": measured.configuration.tool[0].tolist(),
        "drives": setup.drives,
        "averages": setup.averages,
        "points": {
            point.name: {
                "body": point.body,
                "at": measured.places[point.name].tolist(),
                "mass": point.mass,
            }
            for point in setup.points
        },
        "responses": rows,
        "modes": modes[modes <= last].tolist(),
        "damping": compared.damping,
        "doubts": [*measured.doubts, *find_channel_doubts(compared)],
        "remarks": list(measured.remarks),
    }


def _find_gap(
    response: Response, predicted: NDArray[np.complex128], averages: int
) -> float | None:
    """Return the rms difference of the levels, dB, over the lines that are not noise.

    A predicted level is at least that of the noise, as at nodes of modes, where it is zero.
    """
    heard = find_heard_lines(response, predicted)
    if not heard.any():
        return None
    least = np.maximum(np.abs(predicted), find_scatter(response, averages))
    levels = 20.0 * np.log10(np.abs(response.receptance[heard]) / least[heard])
    return float(np.sqrt(np.mean(levels**2)))


def show_responses(name: str, facts: Mapping[str, Any]) -> None:
    """Print one set-up returned by `responses_json`."""
    show_line(
        f"Responses {name}: {facts['file']}, drives {facts['drives']}, "
        f"{facts['averages']} averages",
        "bold",
    )
    points = [
        (
            point,
            place["body"],
            ", ".join(f"{value:.4g}" for value in place["at"]),
            _show_mass(place["mass"]),
        )
        for point, place in facts["points"].items()
    ]
    show_table("Points", (("point",), ("body", "at, m", "sensor g")), points)
    rows = []
    for row in facts["responses"]:
        coherence = row["coherence"]
        low, high = row["band"]
        rows.append(
            (
                f"{_name(row['motion'])} / {_name(row['force'])}",
                f"{low:.4g} to {high:.4g}",
                str(row["lines"]),
                "" if coherence is None else f"{coherence:.3f}",
                "" if row["gap"] is None else f"{row['gap']:.1f}",
                _list(row["resonances"]),
            )
        )
    columns = (
        ("motion / force",),
        ("band Hz", "lines", "coherence", "gap dB"),
        ("resonances Hz",),
    )
    show_table("Measured", columns, rows, prose=("resonances Hz",))
    show_static(
        [
            (f"{_name(row['force'])}", row["force"]["axis"], _gather_static(row))
            for row in facts["responses"]
        ]
    )
    show_line(f"The model's modes: {_list(facts['modes'])} Hz")
    show_line(f"drawn with a damping ratio of {100 * facts['damping']:.2g} %")
    if facts["doubts"]:
        show_list("Doubts", facts["doubts"])
    for remark in facts["remarks"]:
        show_line(remark, "yellow")


def _gather_static(row: Mapping[str, Any]) -> dict[str, Any] | None:
    """Return the static stiffness of a row; see `static_json`."""
    if row["static_stiffness"] is None:
        return None
    return {
        "value": row["static_stiffness"],
        "spread": row["static_spread"],
        "band": row["static_band"],
    }


def _show_mass(mass: float | None) -> str:
    if mass is None:
        return "unknown"
    return f"{1e3 * mass:g}" if mass else ""


def _name(direction: Mapping[str, Any]) -> str:
    sign = "-" if direction["sign"] < 0 else "+"
    return f"{direction['point']}:{sign}{direction['axis']}"


def _list(frequencies: Sequence[float]) -> str:
    shown = ", ".join(f"{hertz:.4g}" for hertz in frequencies[:MOST_LISTED])
    more = len(frequencies) - MOST_LISTED
    return (f"{shown} and {more} more" if more > 0 else shown) or "none"


def name_files(index: int) -> tuple[str, str]:
    """Return the stems of the pictures of a set-up: its points and its responses."""
    return f"points_{index + 1}", f"responses_{index + 1}"


def draw_compared(
    draw: Callable[..., None] | None,
    robot: RobotFile,
    compared: Sequence[ComparedResponses],
    folder: Path,
) -> None:
    """Draw the points on the robot, and measured and predicted responses, of each set-up.

    Parameters
    ----------
    draw
        Drawing function from `stiffscope.report.pictures.open_drawing`; None: no robot is drawn.
    robot
        Robot file.
    compared
        Set-ups.
    folder
        Folder to write to.
    """
    for k, each in enumerate(compared):
        points, curves = name_files(k)
        measured = each.measured
        title = f"{measured.setup.name}: receptances, measured and predicted"

        def figure(each: ComparedResponses = each, title: str = title) -> Any:
            responses = each.measured.responses
            return draw_responses(title, responses, each.predicted.receptances)

        save_figures(folder, {curves: figure})
        if draw is None:
            continue
        found = measured.configuration
        mechanism = found.mechanism
        place = pose_text(
            mechanism, found.tool[0, mechanism.tool.commanded_axes].tolist()
        )
        picture = {
            "file": f"{points}.png",
            "title": f"{robot.name}, points of {measured.setup.name} at {place}",
            "moves": place_robot(found, 0).moves,
            "names": True,
        }
        with optional_pictures():
            draw(
                "robot",
                folder,
                pictures=[picture],
                marks=_mark_points(measured, mechanism),
                **scene(robot, mechanism),
            )


def _mark_points(
    measured: MeasuredResponses, mechanism: Mechanism
) -> list[dict[str, Any]]:
    """Return an arrow for each direction of force and motion, as `drawing.robot` takes them."""
    known = {node for body in mechanism.bodies for node in body.nodes}
    forces = dict.fromkeys(each.force for each in measured.responses)
    motions = dict.fromkeys(each.motion for each in measured.responses)
    marks = list[dict[str, Any]]()
    for kind, ends in (("load", forces), ("sensor", motions)):
        for end in ends:
            along = measured.find_direction(end)
            node = measured.point(end.point).body
            if node in known:
                marks.append(
                    {
                        "kind": kind,
                        "name": _label(end, kind),
                        "node": node,
                        "at": measured.places[end.point],
                        "direction": along[:3] if end.axis < 3 else along[3:],
                    }
                )
    return marks


def _label(end: Direction, kind: str) -> str:
    return (
        f"{'hit' if kind == 'load' else 'motion'} {end.point} {COORDINATES[end.axis]}"
    )


def write_section(report: Draft, facts: Mapping[str, Any]) -> list[Section]:
    """Return a section of the page for each set-up, with its pictures."""
    sections = []
    for k, name in enumerate(facts):
        points, curves = name_files(k)
        drawn = report.figures(
            {
                f"{points}.png": (
                    "Where the robot is hit and where motions are measured",
                    "the robot, with arrows at hits and sensors",
                ),
                f"{curves}.svg": (
                    "Measured and predicted receptance (m/N), phase and coherence; dots: resonances",
                    "measured and predicted responses over frequency",
                ),
            }
        )
        sections.append(Section(f"Responses {name}", (), drawn))
    return sections
