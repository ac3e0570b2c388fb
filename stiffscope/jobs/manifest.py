"""The manifest of a run: what made these files, from what, how long it took, and what was reused."""

from __future__ import annotations

import datetime as dt
import platform
import sys
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import stiffscope
from stiffscope import files

if TYPE_CHECKING:
    from pathlib import Path

LIBRARIES = (
    *("build123d", "cadquery-ocp-novtk", "pytetwild", "scikit-fem", "numpy", "scipy"),
    *("pyvista", "vtk", "matplotlib", "pydantic", "pint"),
)


@dataclass
class Manifest:
    """Gathered while a command runs, written at its end into the output folder."""

    command: list[str]
    robot: str | None = None
    robot_sha256: str | None = None
    overrides: list[str] = field(default_factory=list)
    inputs: dict[str, str] = field(default_factory=dict)
    """SHA-256 of further files that went in, by name."""
    results: dict[str, dict[str, Any]] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)
    started: dt.datetime = field(default_factory=lambda: dt.datetime.now(dt.UTC))

    def note(self, result: str, *, key: str, reused: bool, seconds: float, **more: Any) -> None:
        """Say of one result its cache key, whether it was reused, and the time it took now."""
        self.results[result] = {"reused": reused, "seconds": round(seconds, 3), "key": key, **more}

    def write(self, folder: Path) -> None:
        """Write manifest.json into a folder; the staging of the folder adds the list of its files."""
        from stiffscope.jobs.cache import library_version

        robot = {"file": self.robot, "sha256": self.robot_sha256, "set": self.overrides}
        ended = dt.datetime.now(dt.UTC)
        content = {
            "made_by": files.MAKER,
            "version": stiffscope.__version__,
            "command": self.command,
            "started": self.started.isoformat(timespec="seconds"),
            "seconds": {
                **{k: round(v, 3) for k, v in self.seconds.items()},
                "total": round((ended - self.started).total_seconds(), 3),
            },
            **({"robot": robot} if self.robot else {}),
            **({"inputs": self.inputs} if self.inputs else {}),
            "results": self.results,
            "versions": {"python": sys.version.split()[0], **{name: library_version(name) for name in LIBRARIES}},
            "machine": {"system": platform.system(), "processor": platform.machine()},
        }
        (folder / files.MANIFEST).write_text(files.to_json(content), encoding="utf-8")
