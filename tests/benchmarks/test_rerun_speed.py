"""What a change costs: a cold command beside the import of the CAD library, and a watched run beside both, in one run.

Ratios of wall time count where nothing else runs; processor time, printed beside, says more on a shared machine.
"""

import json
import os
import re
import subprocess
import sys
import threading
import time

import pytest

from stiffscope.robot.library import find_robot

pytestmark = [
    pytest.mark.benchmark,
    pytest.mark.skipif(sys.platform == "win32", reason="processor time of children"),
]
SIZE = "slider.thickness=21.3mm"
DRIVE = (r'"12\.7 N/um"', '"13 N/um"')
THICKNESS = (r'"20 mm"      # z', '"22 mm"      # z')  # as in the robot's file


def timed(*words):
    """Wall and processor seconds of a Python process and its children."""
    before = os.times()
    begun = time.perf_counter()
    subprocess.run([sys.executable, *words], check=True, capture_output=True)
    after = os.times()
    spent = (
        after.children_user
        + after.children_system
        - before.children_user
        - before.children_system
    )
    return time.perf_counter() - begun, spent


def test_cold_compliance_beside_the_import_of_build123d(tmp_path, monkeypatch):
    monkeypatch.setenv("STIFFSCOPE_CACHE", str(tmp_path / "cache"))
    timed("-c", "import build123d")  # once for the disk's sake
    alone = timed("-c", "import build123d")
    answer = tmp_path / "slider.json"
    cold = timed(
        "-m",
        "stiffscope",
        "compliance",
        "biglide",
        "--part",
        "slider",
        "--set",
        SIZE,
        "--json",
        str(answer),
    )
    seconds = json.loads(answer.read_text())["seconds"]
    solution = seconds["mesh"] + seconds["solve"]
    share = (cold[0] - solution) / alone[0]
    print(f"\nimport build123d {alone[0]:.2f} s ({alone[1]:.2f} s of processor)")
    print(
        f"cold compliance {cold[0]:.2f} s ({cold[1]:.2f} s of processor), mesh and solution {solution:.2f} s of it"
    )
    print(f"the rest is {share:.2f} of the import")


class Watch:
    """A watched run of a copy of the Biglide."""

    def __init__(self, folder):
        self.file = folder / "robot.toml"
        self.file.write_text(find_robot("biglide").read_text())
        words = [
            sys.executable,
            "-u",
            "-m",
            "stiffscope",
            "run",
            str(self.file),
            "--out",
            str(folder / "out"),
            "--watch",
        ]
        self.process = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
        self.lines = []
        threading.Thread(
            target=lambda: self.lines.extend(self.process.stdout), daemon=True
        ).start()

    def until_shown(self, count):
        """Wait until the stiffness has been shown so many times."""
        for _ in range(30_000):
            shown = [line for line in self.lines if "Ctrl-C ends" in line]
            if len(shown) >= count:
                return float(re.match(r"[\d.]+", shown[-1])[0])
            time.sleep(0.02)
        raise TimeoutError

    def save(self, pattern, text, count):
        """Seconds from saving a change to the new stiffness on the terminal."""
        begun = time.perf_counter()
        self.file.write_text(re.sub(pattern, text, self.file.read_text(), count=1))
        self.until_shown(count)
        return time.perf_counter() - begun


def test_watched_changes(tmp_path, monkeypatch):
    monkeypatch.setenv("STIFFSCOPE_CACHE", str(tmp_path / "cache"))
    watch = Watch(tmp_path)
    try:
        watch.until_shown(1)
        time.sleep(20)  # until the page is drawn
        drive = watch.save(*DRIVE, 2)
        time.sleep(10)
        slider = watch.save(*THICKNESS, 3)
    finally:
        watch.process.kill()
    cold = timed(
        "-m",
        "stiffscope",
        "compliance",
        "biglide",
        "--part",
        "slider",
        "--set",
        "slider.thickness=22.5mm",
    )
    print(
        f"\nsaved to shown: drive {drive:.2f} s, slider {slider:.2f} s; cold compliance {cold[0]:.2f} s"
    )
