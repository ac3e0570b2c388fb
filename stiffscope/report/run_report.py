"""Contents of ``report.html`` for `run`, `modes`, `map`, `deflection`, `check` and tables."""

from __future__ import annotations

import json
import shlex
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.report import page
from stiffscope.report.page import RobotView, Section
from stiffscope.report.robot_scene import pose_text
from stiffscope.report.robot_view import mode_cases, robot_view, unit_wrenches
from stiffscope.report.tables import sources
from stiffscope.report.terminal import Shown
from stiffscope.runtime import output
from stiffscope.vjm.kinematics.configurations import configure

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from stiffscope.experiments.assembly import Assembled
    from stiffscope.report.page import Figure, Lead
    from stiffscope.report.robot_view import Case
    from stiffscope.robot.inspection import Inspection
    from stiffscope.vjm.kinematics.configurations import Configurations
    from stiffscope.vjm.vibration.modes import Modes

REPORT = "report.html"
GEOMETRY = "geometry.json"
ENERGY = "share of the strain energy"
SHARE = "share of the gap"
AT_M = "SI units at the tool point M in base axes {O}"
STILLS = 6  # embedded pictures of modes; the viewer has all of them


@dataclass(frozen=True)
class Draft:
    """A report that is not yet written: its output folder, and the tables shown in the terminal."""

    folder: Path
    shown: Sequence[Shown] = ()

    def figures(self, captions: Mapping[str, tuple[str, str]]) -> list[Figure]:
        """Embed the folder's pictures that exist, each with its caption and text alternative."""
        return page.figures(self.folder, captions)

    def figure(self, name: str, caption: str, words: str) -> Figure | None:
        """Embed a picture of the folder, if it exists."""
        return next(iter(self.figures({name: (caption, words)})), None)

    def turn_robot(
        self,
        configurations: Configurations,
        names: Sequence[str],
        cases: Sequence[Sequence[Case]],
        caption: str,
        still: Figure | None = None,
        *,
        start: int = 100,
        **more: str,
    ) -> RobotView | None:
        """Return a rotatable robot from the solids drawn to the folder; None if nothing was drawn.

        Parameters
        ----------
        found, names, cases, **more
            As in `stiffscope.report.robot_view.robot_view`.
        caption, still
            Caption and still picture.
        start
            Initial deformation, in percent of the default exaggeration.
        """
        source = self.folder / GEOMETRY
        if not source.exists():
            return None
        data = robot_view(
            json.loads(source.read_text()), configurations, names, cases, **more
        )
        source.unlink()
        words = "the robot in three dimensions: arrow keys rotate it; choose pose, "
        return RobotView(
            data,
            caption,
            f"{words}{data['choice']} and deformation below",
            still,
            start,
        )

    def write(
        self,
        title: str,
        facts: Sequence[str],
        sections: Sequence[Section],
        lead: Lead | None = None,
        *,
        watched: str = "",
    ) -> None:
        """Write ``report.html``: the sections, and the provenance of the folder.

        Parameters
        ----------
        title, facts, sections, lead, watched
            As in `stiffscope.report.page.write_page`.
        """
        there = []
        for section in sections:
            files = [name for name in section.files if (self.folder / name).is_file()]
            there.append(replace(section, files=files))
        there.append(origin(self.folder))
        page.write_page(
            self.folder / REPORT, title, facts, there, lead, watched=watched
        )

    def write_robot(
        self,
        assembled: Assembled,
        what: str,
        sections: Sequence[Section],
        watched: str = "",
    ) -> None:
        """Write the page of an assembled robot, with the facts common to all of them.

        Parameters
        ----------
        assembled, what
            Robot with its parts' matrices, and what the page is about, for its title.
        sections, watched
            As in `stiffscope.report.page.write_page`.
        """
        weight = ", ".join(f"{g:z.4g}" for g in assembled.mechanism.gravity)
        facts = [f"parts: {sources(assembled)}", AT_M, f"gravity ({weight}) m/s²"]
        self.write(f"{assembled.robot.name}: {what}", facts, sections, watched=watched)


def write_run_report(
    report: Draft, assembled: Assembled, parts: Sequence[Shown], *, watched: str = ""
) -> None:
    """Write the report of a run: tables of the robot and its parts, and pictures from the folder.

    Parameters
    ----------
    report, assembled
        Folder and tables of the robot, and robot with its parts' matrices.
    parts
        Tables of the parts, as the terminal showed them.
    watched
        Name of this state of a reloading page; empty for a static page.
    """
    kinds = "compliance.json", "experiment.npz", "fields.vtu", "{}.step", "{}.stl"
    of_parts = [
        f"{name}/{kind.format(name)}" for name in assembled.results for kind in kinds
    ]
    numbers = "stiffness.json", "matrices.npz"
    pictures = report.figures(_caption_parts(assembled)) if parts else ()
    drawn = report.figures(_caption_robot(assembled))
    sections = [
        _show_loaded(report, assembled, assembled.robot.poses),
        Section("Stiffness", report.shown, drawn, files=numbers),
        Section("Parts", parts, pictures, files=of_parts),
    ]
    report.write_robot(assembled, "stiffness", sections, watched)


def write_modes_report(
    report: Draft, assembled: Assembled, names: Sequence[str], vibration_modes: Modes
) -> None:
    """Write the report of natural frequencies: the shown table and animated mode shapes.

    Parameters
    ----------
    report, assembled
        Folder and tables, and robot with its parts' matrices.
    names, vibration_modes
        Names (n,) of the poses, and modes there.
    """
    captions = {}
    for file in sorted(report.folder.glob("mode_*.png"))[:STILLS]:
        pose, number = file.stem.removeprefix("mode_").rsplit("_", 1)
        words = (
            f"the robot deformed in mode {number} at {pose}, coloured by the {ENERGY}"
        )
        captions[file.name] = f"Mode {number} at {pose}", words
    stills = report.figures(captions)
    caption = f"The robot in its mode shapes, components coloured by their {ENERGY}."
    cases = mode_cases(vibration_modes)
    still = stills[0] if stills else None
    view = report.turn_robot(
        vibration_modes.configurations, names, cases, caption, still, choice="mode"
    )
    sections = [
        Section("Mode shapes", view=view),
        Section("Natural frequencies", report.shown, stills, files=("modes.json",)),
    ]
    report.write_robot(assembled, "natural frequencies", sections)


def write_map_report(
    report: Draft, assembled: Assembled, titles: Mapping[str, str]
) -> None:
    """Write the report of a map: its figures, and the robot at its poses.

    Parameters
    ----------
    report, assembled
        Folder with the figures, and robot with its parts' matrices.
    titles
        Titles of the figures by file stem.
    """
    poses = dict(assembled.robot.poses) or {"home": assembled.mechanism.tool.home}
    captions = {}
    for stem, title in titles.items():
        captions[f"{stem}.png"] = title[:1].upper() + title[1:], f"map: {title}"
    drawn = Section("Maps", (), report.figures(captions))
    sections = [drawn, _show_loaded(report, assembled, poses)]
    report.write_robot(assembled, "stiffness over the workspace", sections)


def write_deflection_report(
    report: Draft,
    assembled: Assembled,
    names: Sequence[str],
    configurations: Configurations,
    cases: list[list[Case]],
) -> None:
    """Write the report of a deflection: the shown table and the robot under one wrench per pose.

    Parameters
    ----------
    report, assembled
        Folder and tables, and robot with its parts' matrices.
    names, configurations, cases
        Names (n,) of the poses, configurations there, and wrenches to show, by pose.
    """
    words = "the robot deformed, coloured by the " + ENERGY
    captions = {
        f"deflection_{k}.png": (
            f"The robot at {name} under {case.label}",
            f"{words}, at {name}",
        )
        for k, (name, (case,)) in enumerate(zip(names, cases, strict=True), 1)
    }
    said = "force over deflection; loading and unloading coincide"
    captions["force_over_deflection.png"] = "Force over deflection", said
    stills = report.figures(captions)
    caption = f"The robot under the wrench at M, components coloured by their {ENERGY}."
    view = report.turn_robot(
        configurations, names, cases, caption, stills[0] if stills else None
    )
    loaded = Section("The robot under load", view=view)
    report.write_robot(
        assembled, "deflection", [loaded, Section("Deflection", report.shown, stills)]
    )


def write_check_report(report: Draft, inspection: Inspection) -> None:
    """Write the report of a checked robot file: the robot at its poses and the shown tables."""
    reached = [k for k, pose in enumerate(inspection.poses) if pose.is_reached]
    names = [inspection.poses[k].name for k in reached]
    at = names[0] if names else ""
    still = report.figure(f"robot_{at}.png", "", f"the robot at {at}")
    view = None
    if inspection.configurations is None or still is None:
        (report.folder / GEOMETRY).unlink(missing_ok=True)
    else:
        caption = (
            "The robot at home and at the poses of its file; no stiffness computed."
        )
        there = inspection.configurations[np.array(reached)]
        view = report.turn_robot(there, names, [[] for _ in reached], caption, still)
    sections = [
        Section("The robot", view=view),
        Section("Contents of the robot file", report.shown, files=("check.json",)),
    ]
    facts = ["bodies are rigid here", "SI units in base axes {O}"]
    report.write(f"{inspection.robot.name}: contents of its file", facts, sections)


def _show_loaded(
    report: Draft, assembled: Assembled, poses: Mapping[str, Any]
) -> Section:
    """Return the section of the robot at poses under unit wrenches."""
    configurations = configure(assembled.mechanism, list(poses.values()))
    captions = {
        f"robot_{n}.png": (f"The robot at {n}.", f"the robot at {n}") for n in poses
    }
    still = next(iter(report.figures(captions)), None)
    caption = (
        f"The robot under unit wrenches at M, components coloured by their {ENERGY}."
    )
    cases = unit_wrenches(assembled.mechanism, configurations)
    view = report.turn_robot(configurations, list(poses), cases, caption, still)
    return Section("The robot under load", view=view)


def _caption_robot(assembled: Assembled) -> dict[str, tuple[str, str]]:
    captions = {}
    for name, pose in assembled.robot.poses.items():
        caption = f"The robot at {name}: {pose_text(assembled.mechanism, pose)}"
        words = f"the robot at {name}, its parts in colours, joints dark, drives red"
        captions[f"robot_{name}.png"] = caption, words
    captions["map.png"] = (
        "Stiffness at M over the workspace, under the robot's own weight",
        "six maps of the translational and rotational stiffness",
    )
    return captions


def _caption_parts(assembled: Assembled) -> dict[str, tuple[str, str]]:
    captions: dict[str, tuple[str, str]] = {}
    for name in assembled.results:
        captions[f"{name}/loads.png"] = (
            f"The {name} under each unit wrench: displacement and von Mises stress",
            f"the {name} deformed by each wrench, coloured by magnitude",
        )
        captions[f"{name}/mesh.png"] = (
            f"Mesh of the {name}, its interfaces in colour",
            f"the {name} in tetrahedra, from two sides",
        )
    return captions


def origin(folder: Path) -> Section:
    """Return the manifest as tables: command, robot file, keys and times of results, versions."""
    held = json.loads((folder / output.MANIFEST).read_text(encoding="utf-8"))
    robot: dict[str, Any] = held.get("robot", {})
    facts = {
        "command": shlex.join(["stiffscope", *held["command"]]),
        "started": held["started"],
        "seconds": ", ".join(
            f"{name} {value:g}" for name, value in held["seconds"].items()
        ),
        "robot file": robot.get("file", ""),
        "SHA-256": robot.get("sha256", ""),
        "changed by --set": ", ".join(robot.get("set", [])),
        "machine": " ".join(held["machine"].values()),
    }
    results = [
        (
            name,
            "reused" if each["reused"] else "computed",
            f"{each['seconds']:.1f}",
            each["key"],
        )
        for name, each in held["results"].items()
    ]
    versions = {held["made_by"]: held["version"], **held["versions"]}
    known = tuple((name, value) for name, value in facts.items() if value)
    tables = [Shown("Run", ("", "value"), known, frozenset({"value"}))]
    if results:
        columns = ("result", "", "seconds", "key")
        tables.append(Shown("Results", columns, tuple(results), frozenset({"key"})))
    rows = tuple((name, str(version)) for name, version in versions.items())
    tables.append(Shown("Versions", ("program or library", "version"), rows))
    return Section("Provenance", tables)
