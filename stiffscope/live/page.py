"""Live view of a robot: its sliders, and the results for their values, rendered for a page."""

from __future__ import annotations

import base64
import io
import itertools
import os
import re
from contextlib import suppress
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
import numpy as np
from PIL import Image

from stiffscope.cad.materials import MATERIALS
from stiffscope.errors import InputError, expecting, require, say_count
from stiffscope.experiments.assembly import (
    at_named_poses,
    deflection_bars,
    stiffness_bars,
)
from stiffscope.gap.forward.robot_model import RobotModel
from stiffscope.gap.show.campaign import marks
from stiffscope.lobes.chatter import judge, named_axes
from stiffscope.lobes.show import show_limits
from stiffscope.report import page, tables
from stiffscope.report.numbers import WRENCH, coordinates
from stiffscope.report.pictures import PictureError, open_drawing
from stiffscope.report.robot_scene import scene
from stiffscope.report.robot_view import robot_view, unit_wrenches, wrench_cases
from stiffscope.report.run_report import ENERGY, GEOMETRY, Draft
from stiffscope.report.terminal import record_shown, show_line, show_table
from stiffscope.robot.file.part_sections import ParametricPart, SolidPart
from stiffscope.robot.file.quantities import shown_unit
from stiffscope.robot.mechanism_of import rigid_mechanism
from stiffscope.robot.nominal import NominalRobot
from stiffscope.robot.parameters import parameters
from stiffscope.runtime.output import scratch_folder
from stiffscope.statics.maps import map_robot
from stiffscope.statics.show.maps import UNITS
from stiffscope.vjm.kinematics.configurations import configure
from stiffscope.vjm.model.mechanism import DIAGONAL
from stiffscope.vjm.statics.yielding import deflection
from stiffscope.vjm.vibration.modes import modes

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from stiffscope.experiments.assembly import Assembled
    from stiffscope.gap.campaigns import Case
    from stiffscope.path.job import Job
    from stiffscope.report.terminal import Shown
    from stiffscope.robot.file.description import RobotFile
    from stiffscope.vjm.kinematics.configurations import Configurations

SHOWN = {
    "m": (1e3, "mm"),
    "rad": (180.0 / np.pi, "deg"),
    "N/m": (1e-6, "N/µm"),
    "Pa": (1e-9, "GPa"),
    "N*m/rad": (1e-3, "kN·m/rad"),
    "1": (1.0, ""),
    "N": (1.0, "N"),
    "N*m": (1.0, "N·m"),
}
"""Factor from the SI unit to the unit shown, and its name; other units stay SI."""
LENGTHS = {
    "m",
    "1",
    "rad",
}  # linear from half to twice the value; others are logarithmic
TURN = np.radians(30.0)
SHIFT = 0.25  # rad, share of the robot's size: range of poses without [map]
FORCE = 1000.0
MOMENT = 100.0  # N, N·m
POINTS = 21  # points of a map along each coordinate
MODES = 3
MOST_COUNTED = 8  # holes or ribs that can be chosen at least
MOST_READINGS = 40
NEAR = "sensor, residuals up to 3 σ rms"
FAR = "sensor, residuals beyond 3 σ rms"
MARKS = {NEAR: "#2f7d6b", FAR: "#c2255c"}


@dataclass(frozen=True)
class Slider:
    """A number that the page can change.

    Attributes
    ----------
    name : parameter of the robot file as in `--set`, pose coordinate or load component.
    group : "pose", "load", or the section of the robot file.
    value, low, high : current value and limits, SI.
    scale, unit : factor from SI to the unit shown, and its name.
    decades : whether the scale is logarithmic.
    """

    name: str
    group: str
    value: float
    low: float
    high: float
    scale: float
    unit: str
    decades: bool = False


@dataclass(frozen=True)
class Choice:
    """A whole number or word of a part that the page can change.

    Attributes
    ----------
    name : parameter of the robot file as in `--set`.
    group : section of the robot file.
    value, values : value of the file, and all that can be chosen.
    """

    name: str
    group: str
    value: int | str
    values: tuple[int | str, ...]


@dataclass(frozen=True)
class Setting:
    """Slider values, SI: changed values of the robot file by name, pose (k,) and load (6,)."""

    values: Mapping[str, float | str]
    pose: tuple[float, ...]
    load: tuple[float, ...]


def find_sliders(robot: RobotFile) -> list[Slider]:
    """Return sliders for the pose's coordinates, the load's components and the robot's numbers."""
    mechanism = rigid_mechanism(robot)
    places = np.array([joint.at for joint in mechanism.joints] + [mechanism.tool.at])
    reach = float(np.ptp(places, axis=0).max())
    swept: dict[str, Any] = {} if robot.map is None else dict(robot.map.ranges())
    start = next(iter(robot.poses.values()), tuple(mechanism.tool.home))
    out: list[Slider] = []
    for name, value in zip(mechanism.tool.pose, start, strict=True):
        unit, way = ("rad", TURN) if name.startswith("r") else ("m", SHIFT * reach)
        low, high = swept.get(name, (value - way, value + way))
        ends = float(min(low, high, value)), float(max(low, high, value))
        out.append(Slider(name, "pose", float(value), *ends, *SHOWN[unit]))
    for k, name in enumerate(WRENCH):
        most, unit = (FORCE, "N") if k < 3 else (MOMENT, "N*m")
        out.append(Slider(name, "load", 0.0, -most, most, *SHOWN[unit]))
    for parameter in parameters(robot):
        scale, unit = SHOWN.get(parameter.unit, (1.0, parameter.unit.replace("*", "·")))
        by = (
            2.0
            if parameter.unit in LENGTHS or parameter.name.startswith("materials.")
            else 10.0
        )
        low, high = sorted((parameter.value / by, parameter.value * by))
        group = (
            parameter.name.split(".")[0]
            if parameter.key[0] != "parts"
            else f"part {parameter.key[1]}"
        )
        decades = by > 2.0 and low > 0.0
        out.append(
            Slider(
                name=parameter.name,
                group=group,
                value=parameter.value,
                low=low,
                high=high,
                scale=scale,
                unit=unit,
                decades=decades,
            )
        )
    return out


def find_choices(robot: RobotFile) -> list[Choice]:
    """Return the counts of holes and ribs of parametric parts, and the materials of solids."""
    out: list[Choice] = []
    for name, part in robot.parts.items():
        if not isinstance(part, SolidPart):
            continue
        group = f"part {name}"
        known = tuple(dict.fromkeys([part.material, *robot.materials, *MATERIALS]))
        out.append(Choice(f"{name}.material", group, part.material, known))
        if isinstance(part, ParametricPart):
            for key, value in part.dimensions().items():
                if isinstance(value, int):
                    most = max(2 * value, MOST_COUNTED)
                    out.append(
                        Choice(f"{name}.{key}", group, value, tuple(range(most + 1)))
                    )
    return out


def free_name(robot: RobotFile) -> str:
    """Return a name under which the robot can be kept in the working folder."""
    stem = re.sub(r"[^\w-]+", "-", robot.name).strip("-") or "robot"
    names = (f"{stem}-{number}.toml" for number in itertools.count(1))
    return next(name for name in names if not os.path.lexists(name))


def read_setting(robot: RobotFile, asked: Any) -> Setting:
    """Read a setting from a message of the page. Raise InputError if it is malformed."""
    sizes = {"pose": len(robot.tool.pose), "load": 6}
    choices = {choice.name: choice.values for choice in find_choices(robot)}
    expected = "values, a pose and a load as numbers"
    malformed = TypeError, KeyError, ValueError, AttributeError
    with expecting("", expected, *malformed, got=str(asked)[:200]):
        values = dict(asked["values"])
        chosen = {n: v for n, v in values.items() if v in choices.get(n, ())}
        numbers = {n: float(v) for n, v in values.items() if n not in chosen}
        lists = {name: tuple(float(c) for c in asked[name]) for name in sizes}
    given = [*numbers.values(), *lists["pose"], *lists["load"]]
    require(np.isfinite(given).all(), "", "finite numbers")
    for name, size in sizes.items():
        count = len(lists[name])
        require(count == size, name, f"{size} numbers", count)
    return Setting({**numbers, **chosen}, **lists)


def answer(
    assembled: Assembled, setting: Setting, job: Job | None = None
) -> dict[str, Any]:
    """Return a robot's results at a pose under a load: tables as HTML and motions of its nodes.

    Parameters
    ----------
    assembled, setting
        The robot with the setting's values, and the setting.
    job
        Job whose stable depth of cut is shown too.

    Raises
    ------
    InputError
        The pose is out of reach.
    """
    mechanism = assembled.mechanism
    state = at_named_poses(assembled, {"now": setting.pose})
    configurations = state.configurations.require_valid()
    load = np.array(setting.load)
    with record_shown() as shown:
        tables.show_stiffness(["now"], state, stiffness_bars(assembled, configurations))
        if load.any():
            bent = deflection(mechanism, configurations, load)
            bars = deflection_bars(assembled, configurations, bent.twist)
            words = ", ".join(f"{c:g}" for c in load)
            tables.show_deflection(["now"], bent.twist, bent.shares, words, bars)
        with suppress(InputError):  # without masses
            sounds = modes(mechanism, configurations, MODES)
            tables.show_modes(["now"], sounds, "Natural frequencies, drives held")
        if job is not None:
            limits = judge(
                job, assembled, configurations, named_axes(job, configurations.tool)
            )
            show_limits(["now"], limits)
    view = robot_view(
        {}, configurations, ["now"], _cases(assembled, configurations, load)
    )
    return {"tables": as_html(shown), "view": view}


def _cases(
    assembled: Assembled, configurations: Configurations, load: Any
) -> list[Any]:
    """Return the load of the sliders, if any, and the unit wrenches."""
    units = unit_wrenches(assembled.mechanism, configurations)
    if not load.any():
        return units
    push_cases = wrench_cases(
        assembled.mechanism, configurations, {"slider load": load}
    )
    return [[*first, *others] for first, others in zip(push_cases, units, strict=True)]


def draw_maps(assembled: Assembled) -> str:
    """Return maps of K's diagonal over the range of `[map]` as HTML; "" without `[map]`."""
    robot = assembled.robot
    if robot.map is None:
        return ""
    stiffness_map = map_robot(robot, assembled.mechanism, POINTS, "none")
    shades = mpl.colormaps["cividis"]
    drawn: list[dict[str, Any]] = []
    for k, (name, (unit, factor)) in enumerate(zip(DIAGONAL, UNITS, strict=True)):
        values = factor * stiffness_map.stiffness[:, :, k]
        low = np.nanmin(values)
        high = np.nanmax(values)
        share = np.nan_to_num((values - low) / (high - low or 1.0))
        colours = (255 * shades(share)).astype(np.uint8)
        colours[np.isnan(values), 3] = 0
        out = io.BytesIO()
        Image.fromarray(colours if stiffness_map.down else colours[::-1]).save(
            out, "PNG"
        )
        source = f"data:image/png;base64,{base64.b64encode(out.getvalue()).decode()}"
        drawn.append(
            {"name": name, "range": f"{low:.3g} to {high:.3g} {unit}", "source": source}
        )
    swept = (
        ("across", stiffness_map.across, stiffness_map.columns),
        ("down" if stiffness_map.down else "up", stiffness_map.up, stiffness_map.rows),
    )
    axes = "; ".join(
        f"{way} {coordinates([name])} from {factor * ends[0]:.4g} to {factor * ends[-1]:.4g}"
        for way, name, ends in swept
        for factor in shown_unit(name)[:1]
    )
    return page.templates().get_template("live_maps.html").render(maps=drawn, axes=axes)


def compare_readings(case: Case, assembled: Assembled) -> dict[str, Any]:
    """Return readings and a robot's predictions, newest first, as HTML, and the sensors' marks."""
    read = case.campaign.select(np.flatnonzero(~np.isnan(case.campaign.value)))
    model = RobotModel(read, NominalRobot(assembled.mechanism, assembled.robot))
    campaign = model.campaign
    predicted = model.predict().values
    left = campaign.value - predicted
    size = np.linalg.norm(campaign.value)
    with record_shown() as shown:
        gap = 100 * np.linalg.norm(left) / size if size else 0.0
        show_line(
            f"{say_count(len(campaign), 'reading')}; gap {gap:.3g} % rms, before fitting"
        )
        rows = []
        for i in range(len(campaign))[: -MOST_READINGS - 1 : -1]:
            name = campaign.pose_names[campaign.pose[i]]
            sigma = campaign.sigma[i]
            numbers = (
                f"{campaign.value[i]:.5g}",
                f"{predicted[i]:.5g}",
                f"{left[i]:.3g}",
            )
            ratio = f"{left[i] / sigma:.2f}" if sigma > 0.0 else ""
            rows.append((name, campaign.what(i), *numbers, ratio))
        columns = ("pose", "reads", "measured", "predicted", "residual", "in sigma")
        show_table("Newest readings, SI", (columns,), rows)
    sure = campaign.sigma > 0.0
    of = [sure & (campaign.sensor == k) for k in range(len(campaign.sensors))]
    sizes = [left[mine] / campaign.sigma[mine] for mine in of]
    drawn = [
        mark
        for mark in marks(campaign, assembled.mechanism)
        if mark["kind"] == "sensor"
    ]
    return {"readings": as_html(shown), "marks": list(map(_mark, drawn, sizes))}


def _mark(arrow: Mapping[str, Any], sizes: np.ndarray) -> dict[str, Any]:
    """Return a sensor's mark for the viewer, coloured by its residuals over their uncertainty."""
    rms = float(np.sqrt(np.mean(np.square(sizes)))) if len(sizes) else np.nan
    kind = "sensor without readings" if np.isnan(rms) else FAR if rms > 3.0 else NEAR
    words = f"{arrow['name']}: {say_count(len(sizes), 'reading')}"
    words += "" if np.isnan(rms) else f", residuals {rms:.3g} σ rms"
    place = {name: np.round(arrow[name], 9).tolist() for name in ("at", "direction")}
    look = {"kind": kind, "colour": MARKS.get(kind, "#8a949e")}
    return {"node": arrow["node"], **place, "words": words, **look}


def view_html(
    assembled: Assembled, setting: Setting, draw_now: Callable[..., None]
) -> str:
    """Return the rotatable robot with its solids as HTML; "" if this machine cannot draw.

    Parameters
    ----------
    assembled, setting
        Robot, and its pose and load; an unreachable pose is replaced by home.
    draw_now
        Drawing function from `stiffscope.report.pictures.open_drawing`.
    """
    mechanism = assembled.mechanism
    configurations = configure(mechanism, [setting.pose])
    if not configurations.valid.all():
        configurations = configure(mechanism, [mechanism.tool.home])
    drawn = scene(assembled.robot, mechanism)
    with scratch_folder() as folder:
        try:
            draw_now("robot", folder, pictures=[], geometry=GEOMETRY, **drawn)
        except PictureError:
            return ""
        cases = _cases(assembled, configurations, np.array(setting.load))
        caption = f"Components coloured by their {ENERGY}."
        view = Draft(folder).turn_robot(configurations, ["now"], cases, caption)
    return page.templates().get_template("live_view.html").render(view=view)


def first_view_html(robot: RobotFile) -> str:
    """Return the robot with its solids, before any experiment, as HTML; "" if it cannot be drawn."""
    mechanism = rigid_mechanism(robot)
    start = next(iter(robot.known_poses.values()))
    configurations = configure(mechanism, [start])
    with scratch_folder() as folder, open_drawing() as draw_now:
        drawn = scene(robot, mechanism)
        try:
            draw_now("robot", folder, pictures=[], geometry=GEOMETRY, **drawn)
        except PictureError:
            return ""
        caption = "The robot; its stiffness follows."
        view = Draft(folder).turn_robot(configurations, ["now"], [[]], caption)
    return page.templates().get_template("live_view.html").render(view=view)


def render_page(
    robot: RobotFile, sliders: Sequence[Slider], campaign: Path | None
) -> str:
    """Return the page of the live view; its results arrive through the web socket."""
    choices = find_choices(robot)
    groups: dict[str, list[Slider | Choice]] = {}
    for slider in (*sliders, *choices):
        groups.setdefault(slider.group, []).append(slider)
    given = {
        "title": f"{robot.name}: live",
        "groups": groups,
        "sliders": list(map(asdict, sliders)),
        "choices": list(map(asdict, choices)),
        "free_name": free_name(robot),
        "campaign": campaign.name if campaign else "",
    }
    return page.templates().get_template("live.html").render(given).lstrip()


def as_html(shown: Sequence[Shown]) -> str:
    """Return tables as HTML."""
    return (
        page.templates().get_template("notebook.html").render(lines=shown, figures=())
    )
