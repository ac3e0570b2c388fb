"""Notebook output: tables of stiffscope's objects, rotatable robots, pictures and progress bars.

Objects are shown with the tables of the commands; others are listed field by field.
"""

from __future__ import annotations

import dataclasses
import html
import sys
import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.cad.part import mass_properties
from stiffscope.design.show import sensitivities, studies
from stiffscope.errors import InputError, check_kind
from stiffscope.fea.experiment import Experiment
from stiffscope.imports.show import show_import
from stiffscope.report import page, part_tables, tables
from stiffscope.report.figures import save_figures
from stiffscope.report.numbers import coordinates, name_pose, point, pose_values, vector
from stiffscope.report.pictures import draw
from stiffscope.report.run_report import ENERGY, GEOMETRY, Draft
from stiffscope.report.terminal import record_shown, show_line, show_table
from stiffscope.robot.inspection import inspect_robot
from stiffscope.runtime import output
from stiffscope.runtime.output import scratch_folder
from stiffscope.runtime.progress import LISTENERS
from stiffscope.statics.maps import map_stiffness
from stiffscope.statics.show import maps
from stiffscope.statics.show.check import show_check
from stiffscope.vjm.kinematics.configurations import Configurations, configure
from stiffscope.vjm.model.mechanism import Mechanism
from stiffscope.vjm.vibration.modes import Modes

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from stiffscope.cad.part import Part
    from stiffscope.design.sensitivity import Sensitivity
    from stiffscope.design.studies import Study
    from stiffscope.fea.derivatives import PartSensitivity
    from stiffscope.gap.inference.diagnosis import Diagnosis
    from stiffscope.report.page import Figure
    from stiffscope.robot.file.description import RobotFile
    from stiffscope.runtime.types import Progress
    from stiffscope.vjm.statics.analysis import Stiffness
    from stiffscope.vjm.statics.yielding import Deflection

MOST = 20  # most poses shown of a stack
SMALL = 36  # most numbers of an array listed
HEIGHT = 800  # of the rotatable view, pixels
MODES = "Natural frequencies"
PACE = 0.2  # seconds between updates of a progress bar


@dataclass(frozen=True)
class Picture:
    """A PNG shown by a notebook; `save` writes it to a file."""

    png: bytes = dataclasses.field(repr=False)

    def _repr_png_(self) -> bytes:
        return self.png

    def save(self, path: str | Path) -> None:
        """Write the PNG to a file."""
        output.write_bytes(Path(path), self.png)


@dataclass(frozen=True)
class View:
    """A rotatable robot, shown inline by a notebook; `save` writes it to an HTML file."""

    html: str = dataclasses.field(repr=False)

    def _repr_html_(self) -> str:
        style = f'loading="lazy" style="width:100%;height:{HEIGHT}px;border:0"'
        content = (
            f'srcdoc="{html.escape(self.html)}" title="the robot in three dimensions"'
        )
        return f"<iframe {content} {style}></iframe>"

    def save(self, path: str | Path) -> None:
        """Write the page to a self-contained HTML file."""
        output.write_bytes(Path(path), self.html.encode())


def register() -> None:
    """Register tables and progress bars with a running IPython; without one, do nothing.

    Classes are looked up by name when an object is first shown, so they need no HTML code.
    """
    shell = sys.modules["IPython"].get_ipython() if "IPython" in sys.modules else None
    if shell is None:
        return
    formatter = shell.display_formatter.formatters["text/html"]
    for name, show in SHOWN.items():
        module, _, kind = name.rpartition(".")
        formatter.for_type_by_name(
            f"stiffscope.{module}", kind, partial(as_html, show=show)
        )
    if hasattr(shell, "kernel"):  # not if IPython runs in a terminal
        LISTENERS.open_line = open_bar


def as_html(
    shown: Any, show: Callable[[Any], Sequence[Figure] | None] | None = None
) -> str:
    """Return an object's tables and figures as HTML for a notebook."""
    kind = type(shown)
    show = (
        show or SHOWN[f"{kind.__module__.removeprefix('stiffscope.')}.{kind.__name__}"]
    )
    with record_shown() as lines:
        figures = show(shown) or ()
    return (
        page.templates()
        .get_template("notebook.html")
        .render(lines=lines, figures=figures)
    )


def open_bar(name: str) -> Progress:
    """Open a progress bar in the output of a cell; it disappears when the job is done."""
    from IPython.display import HTML, display  # pyright: ignore[reportMissingImports, reportMissingModuleSource]

    bar: Any = None
    last = 0.0

    def report(stage: str, fraction: float) -> None:
        nonlocal bar, last
        now = time.monotonic()
        done = fraction >= 1.0
        if (bar is None and done) or (not done and now - last < PACE):
            return
        last = now
        bar_html = f'<progress value="{fraction:.3f}"></progress>'
        words = f"<label>{html.escape(name)} {bar_html} {html.escape(stage)}</label>"
        shown = HTML("" if done else words)
        if bar is None:
            bar = display(shown, display_id=True)
        else:
            bar.update(shown)

    return report


def deformed(experiment: Experiment) -> Picture:
    """Draw a part under each of its six unit wrenches.

    Raises
    ------
    PictureError
        This machine cannot draw; the message names what is missing.
    """
    check_kind("experiment", experiment, Experiment, "run_experiment")
    with scratch_folder() as folder:
        held = folder / "experiment.npz"
        sheet = folder / "loads.png"
        experiment.save(held)
        draw(
            "part_pictures",
            folder,
            experiment=held,
            title=experiment.part,
            faces={},
            sheet=sheet.name,
        )
        return Picture(sheet.read_bytes())


def stiffness_map(
    mechanism: Mechanism,
    ranges: Mapping[str, tuple[float, float]],
    points: int = 61,
    at: Sequence[float] | None = None,
) -> Picture:
    """Draw the stiffness (diagonal of K) over two coordinates of the tool, without gravity.

    Parameters
    ----------
    mechanism
        Any mechanism.
    ranges
        Two coordinates of its tool pose and the ends of each, m and rad, such as
        ``{"x": (-0.1, 0.1), "z": (0.3, 0.5)}`` or ``robot.map.ranges()`` of a robot file.
    points
        Number of poses along each coordinate.
    at : (k,)
        Pose that fixes the other coordinates, by default home.

    Returns
    -------
    Picture
        PNG shown inline by a notebook.

    Raises
    ------
    InputError
        The ranges are not two coordinates of the tool, or no pose is reachable.
    """
    stiffness = map_stiffness(mechanism, ranges, points, at=at)
    with scratch_folder() as folder:
        target = folder / "map.png"
        maps.draw_map(
            stiffness,
            maps.stiffness_panels(stiffness),
            {},
            maps.stiffness_title(stiffness),
            target,
        )
        return Picture(target.read_bytes())


def view(
    shown: Mechanism | Configurations | Stiffness | Modes,
    robot: RobotFile | None = None,
) -> View:
    """Show a rotatable robot under unit wrenches at M or in its modes, coloured by strain energy.

    Parameters
    ----------
    shown
        Mechanism (at home or at the poses of ``robot``), or a result at poses.
    robot
        Robot file with the parts' shapes; without it, parts are drawn as rods.

    Raises
    ------
    InputError
        A pose is unreachable, or ``shown`` has another type.
    """
    from stiffscope.report.robot_scene import scene
    from stiffscope.report.robot_view import mode_cases, unit_wrenches

    if isinstance(shown, Mechanism):
        poses: Any = robot.poses if robot and robot.poses else {"home": shown.tool.home}
        names = list(poses)
        configurations = configure(shown, list(poses.values())).require_valid()
    else:
        configurations = getattr(shown, "configurations", shown)
        if not isinstance(configurations, Configurations):
            expected = (
                "expected a mechanism, as `assemble` makes it, or what was found of one"
            )
            raise InputError(f"view: {expected}, got {type(shown).__name__}")
        names = _names(configurations)
    mechanism = configurations.mechanism
    choice = "mode" if isinstance(shown, Modes) else "load"
    cases = (
        mode_cases(shown)
        if isinstance(shown, Modes)
        else unit_wrenches(mechanism, configurations)
    )
    with scratch_folder() as folder:
        draw("robot", folder, pictures=[], geometry=GEOMETRY, **scene(robot, mechanism))
        caption = f"Components coloured by their {ENERGY}."
        turned = Draft(folder).turn_robot(
            configurations, names, cases, caption, choice=choice
        )
    template = page.templates().get_template("inline.html")
    return View(template.render(view=turned, title="The robot").lstrip())


def _names(configurations: Configurations) -> list[str]:
    return [
        name_pose(pose, configurations.mechanism.tool.pose)
        for pose in configurations.poses
    ]


def _part(shown: Part) -> None:
    properties = mass_properties(shown)
    rows = [
        ("material", shown.material.name),
        ("faces", str(len(shown.faces))),
        ("clamped", _numbers(shown.clamped)),
    ]
    for interface in shown.loaded:
        place = f"reference point ({point(interface.reference_point)}) mm"
        rows.append(
            (f"loaded: {interface.name}", f"{_numbers(interface.faces)}; {place}")
        )
    rows += [
        ("volume", f"{1e6 * properties.volume:.5g} cm³"),
        ("mass", f"{properties.mass:.5g} kg"),
        ("centre of mass", f"({point(properties.centre.round(9))}) mm"),
    ]
    show_table(f"Part {shown.name}", (("", "value"),), rows, prose=("value",))


def _numbers(faces: Iterable[int]) -> str:
    return f"faces {', '.join(map(str, sorted(faces)))}"


def _mechanism(shown: Mechanism) -> None:
    rows: list[Sequence[str]] = []
    for body in shown.bodies:
        kind = "elastic" if body.elastic else "rigid"
        centre = body.centre
        rows.append(
            (
                body.name,
                kind,
                f"{body.mass:.4g}",
                "" if centre is None else point(centre),
            )
        )
    show_table("Bodies", (("body", "", "mass kg", "centre at home mm"),), rows)
    rows = []
    for j in shown.joints:
        stiffness = f"{j.drive.stiffness:.4g}" if j.drive else ""
        rows.append((j.name, j.kind, j.first, j.second, point(j.at), stiffness))
    columns = ("joint", "kind", "between", "and", "at home mm", "drive N/m or N·m/rad")
    show_table("Joints", (columns,), rows)
    tool = shown.tool
    place = f"tool: {tool.body}, M at ({point(tool.at)}) mm, commanded: {', '.join(tool.pose)}"
    show_line(f"{place}; gravity ({vector(shown.gravity)}) m/s²")


def _configurations(shown: Configurations) -> None:
    place = coordinates(shown.mechanism.tool.pose)
    rows = [
        (
            pose_values(pose, shown.mechanism.tool.pose),
            "yes" if ok else "no",
            shown.reason(k),
        )
        for k, (pose, ok) in enumerate(
            zip(shown.poses[:MOST], shown.valid[:MOST], strict=True)
        )
    ]
    show_table(
        "Configurations", ((place, "reached", "why not"),), rows, prose=("why not",)
    )
    _show_omitted(len(shown.poses))


def _stiffness(shown: Stiffness) -> None:
    names = [field.name for field in dataclasses.fields(shown)]
    first = dataclasses.replace(
        shown, **{name: getattr(shown, name)[:MOST] for name in names}
    )
    tables.show_stiffness([str(k + 1) for k in range(len(first.matrix))], first)
    _show_omitted(len(shown.matrix))


def _deflection(shown: Deflection) -> None:
    names = [f"pose {k + 1}" for k in range(min(len(shown.twist), MOST))]
    part = {element: share[:MOST] for element, share in shown.shares.items()}
    tables.show_deflection(names, shown.twist[:MOST], part)
    _show_omitted(len(shown.twist))


def _part_sensitivity(shown: PartSensitivity) -> None:
    rows = []
    for name, each in shown.derivatives.items():
        numbers = (f"{value:.4g}" for value in (*each.compliance.diagonal(), each.mass))
        rows.append((name, f"{each.value:.5g}", each.unit, *numbers))
    columns = ("parameter", "value", "unit", *(f"C{k}{k}" for k in range(1, 7)), "mass")
    show_table(
        f"Derivatives of the {shown.part} by each parameter, SI", (columns,), rows
    )


def _diagnosis(shown: Diagnosis) -> list[Figure]:
    from stiffscope.gap.show import figures as gap_figures
    from stiffscope.gap.show import tables as gap_tables
    from stiffscope.gap.show.page import FIGURES

    gap_tables.show_diagnosis(shown)
    with scratch_folder() as folder:
        save_figures(folder, {"waterfall": lambda: gap_figures.waterfall(shown)})
        return page.figures(folder, {"waterfall.svg": FIGURES["waterfall"]})


def _fields(shown: Any) -> None:
    """Show every field of a small dataclass, SI."""
    rows = [
        (field.name, _text(getattr(shown, field.name)))
        for field in dataclasses.fields(shown)
    ]
    title = " ".join(
        [type(shown).__name__, *([shown.name] if hasattr(shown, "name") else [])]
    )
    show_table(f"{title}, SI", (("", "value"),), rows, prose=("value",))


def _text(value: Any) -> str:
    if isinstance(value, np.ndarray):
        if value.ndim == 1 and value.size <= SMALL:
            return f"({vector(value, 6)})"
        return f"{' × '.join(map(str, value.shape))} numbers"
    if dataclasses.is_dataclass(value):
        names = [field.name for field in dataclasses.fields(value)]
        return ", ".join(f"{name} {_text(getattr(value, name))}" for name in names)
    if isinstance(value, tuple):
        return ", ".join(map(str, value))
    return (
        f"{value:g}"
        if isinstance(value, float)
        else "–"
        if value in {None, ""}
        else str(value)
    )


def _study(shown: Study) -> None:
    studies.show_study(shown)


def _sensitivity(shown: Sensitivity) -> None:
    sensitivities.show_sensitivity(
        shown, [name_pose(pose, shown.robot.tool.pose) for pose in shown.poses]
    )


def _show_omitted(count: int) -> None:
    if count > MOST:
        show_line(f"and {count - MOST} more poses")


SHOWN: dict[str, Callable[[Any], Sequence[Figure] | None]] = {
    "cad.materials.Material": _fields,
    "cad.materials.TransverselyIsotropic": _fields,
    "cad.part.Part": _part,
    "fea.experiment.Experiment": part_tables.show_experiment,
    "fea.derivatives.PartSensitivity": _part_sensitivity,
    "fea.settings.Settings": _fields,
    "gap.inference.diagnosis.Diagnosis": _diagnosis,
    "design.studies.Study": _study,
    "experiments.comparison.Comparison": part_tables.show_comparison,
    "robot.file.description.RobotFile": lambda shown: show_check(inspect_robot(shown)),
    "imports.import_assembly.Imported": show_import,
    "design.sensitivity.Sensitivity": _sensitivity,
    "vjm.kinematics.configurations.Configurations": _configurations,
    "vjm.model.bodies.Body": _fields,
    "vjm.model.joints.Drive": _fields,
    "vjm.model.joints.Joint": _fields,
    "vjm.model.mechanism.Mechanism": _mechanism,
    "vjm.model.mechanism.Tool": _fields,
    "vjm.vibration.modes.Modes": lambda shown: tables.show_modes(
        _names(shown.configurations), shown, MODES
    ),
    "vjm.statics.analysis.Stiffness": _stiffness,
    "vjm.statics.yielding.Deflection": _deflection,
}
