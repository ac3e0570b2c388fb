"""Where the first answer's time goes: processor seconds by stage of a command from an empty cache.

``python -m tests.benchmarks.first_answer``. Each process of the command counts its own stages: a
``sitecustomize`` of a temporary folder wraps the functions below when their modules are imported.
A stage's seconds are without those of stages inside it.
"""

from __future__ import annotations

import importlib.machinery
import os
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from functools import wraps
from pathlib import Path
from typing import Any

COMMANDS = {
    "compliance link": ["compliance", "biglide", "--part", "link"],
    "compliance slider": ["compliance", "biglide", "--part", "slider"],
    "run biglide": ["run", "biglide"],
}
STAGES = {  # module: functions by stage
    "stiffscope.experiments.part_order": {"PartOrder.build": "solid"},
    "stiffscope.cad.part": {"surface": "tessellation"},
    "stiffscope.fea.run": {"specimen_of": "solid", "_statics": "error bar, masses"},
    "stiffscope.fea.mesh": {"_run_ftetwild": "mesher", "tetrahedralize": "fins"},
    "stiffscope.fea.snap": {"snap": "snapping"},
    "stiffscope.fea.refine": {"grade": "grading"},
    "stiffscope.fea.specimen": {"shape_error": "snapping"},
    "stiffscope.fea.elasticity": {"assemble": "quadratic stiffness"},
    "stiffscope.fea.cubic_space": {"enrich": "cubic space"},
    "stiffscope.fea.multigrid": {"prepare": "factorization"},
    "stiffscope.fea.cubic": {
        "cubic_problem": "cubic space",
        "solve_cubic": "cubic solution",
        "weigh_energies": "error bar, masses",
    },
    "stiffscope.fea.dynamics": {
        "compute_dynamics": "modes, weight",
        "condense_mass": "error bar, masses",
    },
    "stiffscope.fea.experiment": {"Experiment.save": "files"},
    "stiffscope.experiments.making": {"_write": "files"},
    "stiffscope.experiments.experiments": {"_read": "files"},
    "stiffscope.report.drawing.part": {"part_pictures": "pictures of parts"},
    "stiffscope.report.drawing.robot": {"robot": "pictures of the robot"},
    "stiffscope.statics.show.maps": {"_draw_map": "map"},
    "stiffscope.report.run_report": {"write_run_report": "page"},
}
TRANSPARENT = {"stiffscope", "encodings", "importlib", "runpy", "__main__"}


class Clock:
    """Stages of a process, each without those inside it, appended to a file when they end."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.stack = ["other work"]
        self.at = 0.0
        self.spent: dict[str, float] = defaultdict(float)
        self.switch("start of Python")

    def switch(self, name: str | None = None) -> None:
        """Count the time since the last call, and enter a stage, or leave the innermost."""
        now = time.process_time()
        self.spent[self.stack[-1]] += now - self.at
        self.at = now
        if name is None:
            self.stack.pop()
        else:
            self.stack.append(name)

    def write(self) -> None:
        with self.path.open("a") as file:
            for name, seconds in self.spent.items():
                file.write(f"{os.getpid()}\t{name}\t{seconds}\n")
        self.spent.clear()

    def wrap(self, function: Any, stage: str) -> Any:
        @wraps(function)
        def timed(*arguments: Any, **named: Any) -> Any:
            self.switch(stage)
            try:
                return function(*arguments, **named)
            finally:
                self.switch()
                self.write()

        return timed


class Finder:
    """Finds modules as usual, and counts the time of their execution."""

    def __init__(self, clock: Clock) -> None:
        self.clock = clock

    def find_spec(self, name: str, path: Any = None, target: Any = None) -> Any:
        spec = importlib.machinery.PathFinder.find_spec(name, path, target)
        if spec is None or spec.loader is None:
            return spec
        loader = spec.loader
        package = name.partition(".")[0]
        for method in ("create_module", "exec_module"):
            setattr(
                loader, method, self.counted(getattr(loader, method), name, package)
            )
        return spec

    def counted(self, execute: Any, name: str, package: str) -> Any:
        clock = self.clock

        def run(subject: Any) -> Any:
            inside = clock.stack[-1]
            third = package not in TRANSPARENT
            if third and inside.startswith("import ") and inside != "import stiffscope":
                return execute(subject)
            clock.switch(f"import {package}")
            try:
                return execute(subject)
            finally:
                if name in STAGES and execute.__name__ == "exec_module":
                    hook(clock, subject, STAGES[name])
                clock.switch()
                clock.write()

        return run


def hook(clock: Clock, module: Any, stages: dict[str, str]) -> None:
    """Wrap functions and methods of a module."""
    for path, stage in stages.items():
        owner, (*outer, name) = module, path.split(".")
        for each in outer:
            owner = getattr(owner, each)
        setattr(owner, name, clock.wrap(getattr(owner, name), stage))


def install(path: str) -> None:
    """Count this process's stages."""
    import atexit

    clock = Clock(Path(path))
    clock.switch()
    sys.meta_path.insert(0, Finder(clock))  # pyright: ignore[reportArgumentType]
    clock.write()

    def finish() -> None:
        clock.switch("other work")
        clock.write()

    atexit.register(finish)


def measure(words: list[str]) -> tuple[dict[str, float], float, float]:
    """Return processor seconds by stage, in total, and seconds by the clock."""
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "log"
        here = Path(__file__)
        (Path(folder) / "sitecustomize.py").write_text(
            "import sys\n"
            f"sys.path.insert(0, {str(here.parent)!r})\n"
            f"import {here.stem}\n"
            "sys.path.pop(0)\n"
            f"{here.stem}.install({str(log)!r})\n"
        )
        environment = {
            **os.environ,
            "PYTHONPATH": folder,
            "STIFFSCOPE_CACHE": str(Path(folder) / "cache"),
        }
        if words[0] == "run":
            words = [*words, "--out", str(Path(folder) / "out")]
        before, begun = os.times(), time.perf_counter()
        done = subprocess.run(
            [sys.executable, "-m", "stiffscope", *words],
            env=environment,
            cwd=folder,
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode:
            raise SystemExit(done.stderr)
        wall, after = time.perf_counter() - begun, os.times()
        total = sum(after[2:4]) - sum(before[2:4])
        spent: dict[str, float] = defaultdict(float)
        for line in log.read_text().splitlines():
            _, name, seconds = line.split("\t")
            spent[name] += float(seconds)
    return spent, total, wall


if __name__ == "__main__":
    for name in sys.argv[1:] or COMMANDS:
        spent, total, wall = measure(COMMANDS[name])
        print(f"\n{name}: {total:.2f} s of a processor, {wall:.2f} s by the clock")
        left = total - sum(spent.values())
        rows = sorted(spent.items(), key=lambda row: -row[1])
        for stage, seconds in [*rows, ("not counted", left)]:
            if abs(seconds) > 0.03:
                print(f"  {stage:28s} {seconds:6.2f}")
