"""Contents of ``report.html`` for `run`, `modes`, `map`, `deflection`, `check` and tables."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.report import page
from stiffscope.report.page import RobotView, Section
from stiffscope.report.robot_scene import pose_text
from stiffscope.report.robot_view import mode_cases, robot_view, unit_wrenches
from stiffscope.report.tables import sources
from stiffscope.report.terminal import Shown
from stiffscope.runtime import output
from stiffscope.vjm.kinematics import configure

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from stiffscope.experiments.assembly import Assembled
    from stiffscope.report.page import Figure, Lead
    from stiffscope.report.robot_view import Case
    from stiffscope.robot.inspection import Inspection
    from stiffscope.vjm.kinematics import Configurations
    from stiffscope.vjm.modes import Modes

REPORT, GEOMETRY = "report.html", "geometry.json"
ENERGY = "share of the strain energy"
STILLS = 6  # embedded pictures of modes; the viewer has all of them


def write_run_report(
    folder: Path, assembled: Assembled, parts: Sequence[Shown], robot: Sequence[Shown], *, watched: str = ""
) -> None:
    """Write the report of a run: tables of the parts and the robot, and pictures from the folder.

    ``watched`` names this run for a page that reloads; see `stiffscope.report.page.write_page`.

    Parameters
    ----------
    folder
        Folder to write to.
    assembled
        Robot with its parts' matrices.
    parts
        Tables of the parts, as the terminal showed them.
    robot
        Tables of the robot, as the terminal showed them.
    watched
        Name of this state of a reloading page; empty for a static page.

    """
    poses = assembled.robot.poses
    found = configure(assembled.mechanism, list(poses.values()))
    view = _wrench_view(folder, assembled, found, list(poses))
    kinds = "compliance.json", "experiment.npz", "fields.vtu", "{}.step", "{}.stl"
    of_parts = [f"{name}/{kind.format(name)}" for name in assembled.results for kind in kinds]
    sections = [
        Section("The robot under load", view=view),
        Section("Stiffness", robot, _robot_figures(folder, assembled), files=("stiffness.json", "matrices.npz")),
        Section("Parts", parts, _part_figures(folder, assembled) if parts else (), files=of_parts),
    ]
    _write(folder, assembled, "stiffness", sections, watched)


def write_modes_report(
    folder: Path, assembled: Assembled, names: Sequence[str], found: Modes, tables: Sequence[Shown]
) -> None:
    """Write the report of natural frequencies: the shown table and animated mode shapes.

    Parameters
    ----------
    folder
        Folder to write to.
    assembled
        Robot with its parts' matrices.
    names
        Names of the poses (n,).
    found
        Modes to show.
    tables
        Tables as the terminal showed them.

    """
    stills = [_mode_figure(file) for file in sorted(folder.glob("mode_*.png"))[:STILLS]]
    view = turn_robot(
        folder, found.configurations, names, mode_cases(found), choice="mode", quantity=ENERGY,
        caption=f"The robot in its mode shapes, components coloured by their {ENERGY}.",
        still=stills[0] if stills else None,
    )  # fmt: skip
    sections = [
        Section("Mode shapes", view=view),
        Section("Natural frequencies", tables, stills, files=("modes.json",)),
    ]
    _write(folder, assembled, "natural frequencies", sections)


def write_map_report(folder: Path, assembled: Assembled, titles: Mapping[str, str]) -> None:
    """Write the report of a map: its figures, and the robot at its poses.

    Parameters
    ----------
    folder
        Folder to write to.
    assembled
        Robot with its parts' matrices.
    titles
        Titles of the figures by file stem.

    """
    robot, mechanism = assembled.robot, assembled.mechanism
    poses: dict[str, Any] = dict(robot.poses) or {"home": mechanism.tool.home}
    view = _wrench_view(folder, assembled, configure(mechanism, list(poses.values())), list(poses))
    figures = [
        page.figure(folder / f"{stem}.png", title[:1].upper() + title[1:], f"map: {title}")
        for stem, title in titles.items()
    ]
    sections = [Section("Maps", (), figures), Section("The robot under load", view=view)]
    _write(folder, assembled, "stiffness over the workspace", sections)


def write_deflection_report(
    folder: Path, assembled: Assembled, names: Sequence[str], found: Configurations, cases: list[list[Case]],
    tables: Sequence[Shown],
) -> None:  # fmt: skip
    """Write the report of a deflection: the shown table and the robot under one wrench per pose.

    Parameters
    ----------
    folder
        Folder to write to.
    assembled
        Robot with its parts' matrices.
    names
        Names of the poses (n,).
    found
        Configurations at the poses.
    cases
        Wrenches to show, by pose.
    tables
        Tables as the terminal showed them.

    """
    words = "the robot deformed, coloured by the " + ENERGY
    captions = {
        f"deflection_{k}.png": (f"The robot at {name} under {case.label}", f"{words}, at {name}")
        for k, (name, (case,)) in enumerate(zip(names, cases, strict=True), 1)
    }
    said = "force over deflection; loading and unloading coincide"
    captions["force_over_deflection.png"] = "Force over deflection", said
    stills = page.figures(folder, captions)
    view = turn_robot(
        folder, found, names, cases, choice="load", quantity=ENERGY,
        caption=f"The robot under the wrench at M, components coloured by their {ENERGY}.",
        still=stills[0] if stills else None,
    )  # fmt: skip
    sections = [
        Section("The robot under load", view=view),
        Section("Deflection", tables, stills),
    ]
    _write(folder, assembled, "deflection", sections)


def write_check_report(folder: Path, found: Inspection, tables: Sequence[Shown]) -> None:
    """Write the report of a checked robot file: the robot at its poses and the shown tables.

    Parameters
    ----------
    folder
        Folder to write to.
    found
        Inspection to show.
    tables
        Tables as the terminal showed them.

    """
    reached = [k for k, pose in enumerate(found.poses) if pose.is_reached]
    names = [found.poses[k].name for k in reached]
    still = folder / f"robot_{names[0]}.png" if names else folder
    view = None
    if found.configurations is None or not still.is_file():
        (folder / GEOMETRY).unlink(missing_ok=True)
    else:
        view = turn_robot(
            folder, found.configurations[np.array(reached)], names, [[] for _ in reached], choice="load",
            quantity=ENERGY, caption="The robot at home and at the poses of its file; no stiffness computed.",
            still=page.figure(still, "", f"the robot at {names[0]}"),
        )  # fmt: skip
    sections = [
        Section("The robot", view=view),
        Section("Contents of the robot file", tables, files=("check.json",)),
    ]
    facts = ["bodies are rigid here", "SI units in base axes {O}"]
    write_report(folder, f"{found.robot.name}: contents of its file", facts, sections)


def write_report(
    folder: Path, title: str, facts: Sequence[str], sections: Sequence[Section], lead: Lead | None = None, *,
    watched: str = "",
) -> None:  # fmt: skip
    """Write ``report.html``: the sections, and the provenance of the folder.

    Parameters
    ----------
    folder
        Output folder with its manifest.
    title, facts, sections, lead, watched
        As in `stiffscope.report.page.write_page`.

    """
    there = [replace(s, files=[name for name in s.files if (folder / name).is_file()]) for s in sections]
    page.write_page(folder / REPORT, title, facts, [*there, origin(folder)], lead, watched=watched)


def _wrench_view(folder: Path, assembled: Assembled, found: Configurations, names: Sequence[str]) -> RobotView | None:
    drawn = next((name for name in names if (folder / f"robot_{name}.png").exists()), None)
    still = None
    if drawn is not None:
        still = page.figure(folder / f"robot_{drawn}.png", f"The robot at {drawn}.", f"the robot at {drawn}")
    return turn_robot(
        folder, found, names, unit_wrenches(assembled.mechanism, found), choice="load", quantity=ENERGY,
        caption=f"The robot under unit wrenches at M, components coloured by their {ENERGY}.",
        still=still,
    )  # fmt: skip


def turn_robot(
    folder: Path, found: Configurations, names: Sequence[str], cases: list[list[Case]], *, choice: str, quantity: str,
    caption: str, still: Figure | None, start: int = 100,
) -> RobotView | None:  # fmt: skip
    """Return a rotatable robot from the solids drawn to the folder; None if nothing was drawn.

    Parameters
    ----------
    folder
        Folder with ``geometry.json``, which is deleted.
    found, names, cases, choice, quantity
        As in `stiffscope.report.robot_view.robot_view`; modes are animated.
    caption, still
        Caption and still picture.
    start
        Initial deformation, in percent of the default exaggeration.

    """
    source = folder / GEOMETRY
    if not source.exists():
        return None
    geometry = json.loads(source.read_text())
    source.unlink()
    data = robot_view(geometry, found, names, cases, choice=choice, quantity=quantity, moving=choice == "mode")
    words = f"the robot in three dimensions: arrow keys rotate it; choose pose, {choice} and deformation below"
    return RobotView(data, caption, words, still, start)


def _mode_figure(file: Path) -> Figure:
    pose, number = file.stem.removeprefix("mode_").rsplit("_", 1)
    words = f"the robot deformed in mode {number} at {pose}, coloured by the {ENERGY}"
    return page.figure(file, f"Mode {number} at {pose}", words)


def _robot_figures(folder: Path, assembled: Assembled) -> list[Figure]:
    captions = {
        f"robot_{name}.png": (
            f"The robot at {name}: {pose_text(assembled.mechanism, pose)}",
            f"the robot at {name}, its parts in colours, joints dark, drives red",
        )
        for name, pose in assembled.robot.poses.items()
    }
    captions["map.png"] = (
        "Stiffness at M (diagonal of K) over the workspace, under the robot's own weight",
        "six maps of the translational and rotational stiffness",
    )
    return page.figures(folder, captions)


def _part_figures(folder: Path, assembled: Assembled) -> list[Figure]:
    captions: dict[str, tuple[str, str]] = {}
    for name in assembled.results:
        captions[f"{name}/loads.png"] = (
            f"The {name} under each unit wrench: displacement and von Mises stress",
            f"twelve pictures of the {name} deformed, coloured by magnitude",
        )
        captions[f"{name}/mesh.png"] = (
            f"Mesh of the {name}, its clamped and loaded faces in colour",
            f"the {name} in tetrahedra, from both ends",
        )
    return page.figures(folder, captions)


def origin(folder: Path) -> Section:
    """Return the manifest as tables: command, robot file, keys and times of results, versions."""
    held = json.loads((folder / output.MANIFEST).read_text(encoding="utf-8"))
    robot: dict[str, Any] = held.get("robot", {})
    facts = {
        "command": "stiffscope " + " ".join(held["command"]),
        "started": held["started"],
        "seconds": ", ".join(f"{name} {value:g}" for name, value in held["seconds"].items()),
        "robot file": robot.get("file", ""),
        "SHA-256": robot.get("sha256", ""),
        "changed by --set": ", ".join(robot.get("set", [])),
        "machine": " ".join(held["machine"].values()),
    }
    results = [
        (name, "reused" if each["reused"] else "computed", f"{each['seconds']:.1f}", each["key"])
        for name, each in held["results"].items()
    ]
    versions = {held["made_by"]: held["version"], **held["versions"]}
    tables = [Shown("Run", ("", "value"), tuple((k, v) for k, v in facts.items() if v), frozenset({"value"}))]
    if results:
        columns = ("result", "", "seconds", "key")
        tables.append(Shown("Results", columns, tuple(results), frozenset({"key"})))
    rows = tuple((name, str(version)) for name, version in versions.items())
    return Section("Provenance", [*tables, Shown("Versions", ("program or library", "version"), rows)])


def _write(folder: Path, assembled: Assembled, what: str, sections: list[Section], watched: str = "") -> None:
    robot = assembled.robot
    weight = ", ".join(f"{g:z.4g}" for g in assembled.mechanism.gravity)
    facts = [
        f"parts: {sources(assembled)}",
        "SI units at the tool point M in base axes {O}",
        f"gravity ({weight}) m/s²",
    ]
    write_report(folder, f"{robot.name}: {what}", facts, sections, watched=watched)
