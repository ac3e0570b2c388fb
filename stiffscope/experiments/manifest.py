"""Manifest of a run: software, inputs, times and reused results."""

from __future__ import annotations

import datetime as dt
import os
import platform
import sys
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from stiffscope.experiments import part_order
from stiffscope.runtime import output
from stiffscope.runtime.cache import library_version
from stiffscope.runtime.json_text import encodable, to_json
from stiffscope.runtime.reading import file_digest

if TYPE_CHECKING:
    from pathlib import Path

    from stiffscope.robot.file.description import RobotFile

LIBRARIES = (*part_order.LIBRARIES, "pyvista", "vtk", "matplotlib", "pydantic", "pint")


@dataclass
class Manifest:
    """Record of a command, collected while it runs and finally written to the output folder."""

    sources: dict[str, Any] = field(default_factory=dict)
    """Robot file with its SHA-256 and its `--set` changes, and SHA-256 of further files by name."""
    results: dict[str, dict[str, Any]] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)
    started: dt.datetime = field(default_factory=lambda: dt.datetime.now(dt.UTC))

    def note(
        self, result: str, *, key: str, reused: bool, seconds: float, **more: Any
    ) -> None:
        """Record a result's cache key, whether it was reused, and the time it took."""
        self.results[result] = {
            "reused": reused,
            "seconds": round(seconds, 3),
            "key": key,
            **more,
        }

    def measure_elapsed(self) -> float:
        """Return the seconds since the command began."""
        return (dt.datetime.now(dt.UTC) - self.started).total_seconds()

    def write(self, folder: Path) -> None:
        """Write manifest.json to a folder; the list of files is added when the folder is staged."""
        seconds = {**self.seconds, "total": self.measure_elapsed()}
        versions = {name: library_version(name) for name in LIBRARIES}
        content = {
            "made_by": output.MAKER,
            "version": library_version("stiffscope"),
            "command": sys.argv[1:],
            "started": self.started.isoformat(timespec="seconds"),
            "seconds": {name: round(value, 3) for name, value in seconds.items()},
            **self.sources,
            "results": self.results,
            "versions": {"python": sys.version.split()[0], **versions},
            "machine": {"system": platform.system(), "processor": platform.machine()},
        }
        (folder / output.MANIFEST).write_text(
            encodable(to_json(content), "utf-8"), encoding="utf-8"
        )


def manifest_of(robot: RobotFile | None, *inputs: Path) -> Manifest:
    """Start a manifest of a robot and further input files, named relative to a common folder."""
    sources: dict[str, Any] = {}
    if robot is not None:
        changed = list(robot.source.overrides)
        sha256 = file_digest(robot.path)
        sources["robot"] = {"file": str(robot.path), "sha256": sha256, "set": changed}
    if inputs:
        whole = [path.absolute() for path in inputs]
        folder = os.path.commonpath([path.parent for path in whole])
        names = (path.relative_to(folder).as_posix() for path in whole)
        sources["inputs"] = dict(zip(names, map(file_digest, whole), strict=True))
    return Manifest(sources)
