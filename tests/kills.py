"""Seeded kills of a command, or of a process that it started, and the judge of what they leave.

`python -m tests.kills [COUNT] [SEED]` kills COUNT commands (40), and prints each case; its exit code is 1 if one of
them is wrong.
"""

from __future__ import annotations

import contextlib
import itertools
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import psutil

from stiffscope.cli.main import STOPPED
from stiffscope.data import FOLDER
from tests.experiments.one_part import PLATE, ROBOT, STEP, write_bar

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

HOWS = (signal.SIGKILL, signal.SIGTERM)
LONGEST = 900  # s that a command may take on a busy machine
TRUE = re.compile(r"stiffscope: .*(was ended by SIG|workers? ended at it)")
"""What a command may say if another process of it was killed twice."""
KEPT = re.compile(
    r"stiffscope: stopped; [1-9]\d* finished designs are kept in out\.designs, the same .*\n$"
)
"""What a study may say if it was stopped."""

STUDY = """\
robot = "plate.toml"
method = "grid"
[parameters]
"bar 1.thickness" = { range = ["9 mm", "12 mm"], steps = 3 }
[responses]
stiffness = "K_tx"
"""
JOB = 'robot = "biglide"\ncomponents = "beam"\npath = "path.csv"\nstep = "5 mm"\n'
PATH = "x,y,z,fz\n0,0,0.35,-100\n0.02,0,0.35,-50\n"
ARM = """\
<robot name="arm"><link name="base"/><link name="tool"><inertial><mass value="1"/><origin xyz="0 0 0.1"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j" type="revolute"><parent link="base"/><child link="tool"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>
"""

_OUT = ("--out", "out", "--quiet")
_POSE = ("--at", "0,0,350 mm", "--components", "published", *_OUT)
BLIND = ("blind", "five-bar", "--components", "beam", "--campaigns", "2", *_OUT)
COMPLIANCE = (
    "compliance",
    "biglide",
    "--part",
    "link",
    "--superelement",
    "out",
    "--json",
    "a.json",
    "--quiet",
)
COMMANDS = {
    "run": ("run", "bar.toml", *_OUT),
    "study": ("study", "study.toml", *_OUT),
    "diagnose": ("diagnose", "known", "--adopt", "new.toml", *_OUT),
    "check": ("check", "bar.toml", *_OUT),
    "run-published": ("run", "biglide", "--components", "published", *_OUT),
    "check-delta": ("check", "delta", *_OUT),
    "map": ("map", "biglide", "--components", "published", "--points", "5", *_OUT),
    "compliance": COMPLIANCE,
    "modes": ("modes", "biglide", *_POSE),
    "frf": (
        "frf",
        "biglide",
        "--from",
        "platform:0,0,0:z",
        "--to",
        "platform:0,0,0:z",
        *_POSE,
    ),
    "deflection": ("deflection", "biglide", "--wrench", "0,0,100,0,0,0", *_POSE),
    "stiffness": ("stiffness", "delta", "--json", "a.json", "--quiet"),
    "sensitivity": ("sensitivity", "biglide", *_POSE),
    "path": ("path", "job.toml", "--compensate", *_OUT),
    "interfaces": ("interfaces", "biglide", "--part", "link", *_OUT),
    "campaign-check": ("campaign", "check", "c", *_OUT),
    "campaign-new": ("campaign", "new", "biglide", "--out", "new", "--quiet"),
    "diagnose-c": ("diagnose", "c", *_OUT),
    "blind": BLIND,
    "audit": ("audit", "--json", "a.json", "--quiet"),
    "compare": ("compare", "biglide", "--part", "link", "--json", "a.json", "--quiet"),
    "new": ("new", "delta", "new.toml", "--quiet"),
    "import": ("import", "arm.urdf", "--out", "new.toml", "--quiet"),
}
OFTEN = ("run", "study", "diagnose", "check")
MADE = ("out", "new", "new.toml", "a.json")
"""What they write: the first is replaced as a whole, the next two never."""
MESHED = {
    "run": 0.01,
    "study": 0.01,
    "interfaces": 0.1,
    "compliance": 0.01,
    "compare": 0.01,
}
"""How close other meshes' numbers are; 1e-9 without meshes."""
HEADER = """\
robot = "biglide"
modelled = ["gravity"]
components = "published"
readings = "readings.csv"
ignore = ["note"]
units = { value = "um", sigma = "um", z = "mm" }

[sensors.gauge]
measures = "displacement"
body = "platform"
at = ["75 mm", 0, 0.33]
direction = [0, 0, 1]
against = "ground"
zero = "session"

[loads.hook]
body = "platform"
at = [0, 0, 0.35]
"""
READINGS = """\
x,y,z,load,fx,fz,sensor,quantity,value,sigma,session,note
0,0,350,,100,0,,dx,4.2,1,a,first
0,0,350,hook,0,-100,gauge,,-3.5,1,a,
0.01,0,400,,0,0,,ez,11,,b,
0.01,0,400,,,,gauge,,0.5,2,b,last
"""
WHOM = ("main", "child", "mesher")
"""The command; a process that it started; one that such a process started."""


def write_inputs(folder: Path) -> None:
    """What the commands read, and a file of the user's."""
    shutil.copytree(FOLDER / "withheld" / "campaign-001", folder / "known")
    plate = f'{PLATE}\nmesh = {{ size = "20 mm" }}'
    (folder / "bar.toml").write_text(ROBOT.format(part=STEP, length=60.0))
    (folder / "plate.toml").write_text(ROBOT.format(part=plate, length=60.0))
    write_bar(folder / "bar.step")
    (folder / "study.toml").write_text(STUDY)
    (folder / "job.toml").write_text(JOB)
    (folder / "path.csv").write_text(PATH)
    (folder / "arm.urdf").write_text(ARM)
    (folder / "c").mkdir()
    (folder / "c" / "campaign.toml").write_text(HEADER)
    (folder / "c" / "readings.csv").write_text(READINGS)
    (folder / "notes.txt").write_text("mine")


def stiffscope(*words: str, folder: Path, **more) -> subprocess.Popen:
    """Start a command in a folder, in a session of its own, with a cache and temporary files beside it."""
    environment = {
        **os.environ,
        "STIFFSCOPE_CACHE": str(folder / "cache"),
        "TMPDIR": str(folder / "tmp"),
    }
    (folder / "tmp").mkdir(exist_ok=True)
    command = [sys.executable, "-m", "stiffscope", *words, "--quiet"]
    return subprocess.Popen(
        command,
        cwd=folder,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
        **more,
    )


def in_session(leader: int) -> list[str]:
    """Command lines of the living processes of a session."""
    found = []
    for place in Path("/proc").glob("[0-9]*"):
        try:
            state, _, _, session = (
                (place / "stat").read_text().rpartition(")")[2].split()[:4]
            )
            if int(session) == leader and state != "Z":
                found.append((place / "cmdline").read_text().replace("\0", " "))
        except OSError:
            continue
    return found


def left_alive(leader: int, seconds: float = 2.0) -> list[str]:
    """What of a session lives some seconds later."""
    ends = time.monotonic() + seconds
    while (left := in_session(leader)) and time.monotonic() < ends:
        time.sleep(0.1)
    return left


ENDS = {".png": b"IEND\xaeB`\x82", ".gif": b";", ".html": b"</html>"}  # of a whole file


VARIES = re.compile(
    r'"(seconds|mesh|cached|error|volume|key)": (\{[^{}]*\}|\[[^"{}]*\]|[^,{}\[\]]+)'
)
"""What other meshes of the same part, or other times, make other."""


def results_in(folder: Path, made: str, *, meshed: bool = False) -> dict[str, str]:
    """Every file that was made but pictures, which a busy machine leaves out; the text of those without times.

    Pictures and pages are whole. Of meshed parts the text of the robot's figures alone, which each mesh has alike.
    """
    texts: dict[str, str] = {}
    for path in sorted([folder / made, *(folder / made).rglob("*")]):
        if path.suffix in ENDS:
            assert path.read_bytes().rstrip().endswith(ENDS[path.suffix]), path
        if path.is_file() and path.suffix not in {".png", ".gif"}:
            plain = path.suffix in {".csv", ".json", ".toml"} and path.name not in {
                "manifest.json",
                "scores.json",
            }
            plain = plain and not (
                meshed and path.suffix == ".json" and path.name != "stiffness.json"
            )
            text = path.read_text(encoding="utf-8") if plain else ""
            texts[path.relative_to(folder).as_posix()] = VARIES.sub("", text)
    return texts


NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e[+-]?\d+)?(?![\w.])")


def same(ours: dict[str, str], theirs: dict[str, str], close: float) -> None:
    """Assert the same files with the same words and, but for rounding or another mesh, the same numbers."""
    assert set(ours) == set(theirs), sorted({*ours} ^ {*theirs})
    for name, text in ours.items():
        assert NUMBER.sub("#", text) == NUMBER.sub("#", theirs[name]), name
        one, other = (
            np.array(NUMBER.findall(each), dtype=float) for each in (text, theirs[name])
        )
        assert np.allclose(
            one, other, rtol=close, atol=close * np.abs(other).max(initial=0)
        ), name


def _below(leader: psutil.Process) -> dict[str, list[psutil.Process]]:
    """The processes that may be killed, by `WHOM`."""
    with contextlib.suppress(psutil.NoSuchProcess):
        children = leader.children()
        found = {
            "main": [leader],
            "child": children,
            "mesher": [each for one in children for each in one.children()],
        }
        return {whom: list(filter(_is_ours, found[whom])) for whom in WHOM}
    return {}


def _is_ours(process: psutil.Process) -> bool:
    """Return whether a process lives and is of this package: one that draws also asks `xset`."""
    with contextlib.suppress(psutil.NoSuchProcess):
        return any("stiffscope" in word for word in process.cmdline())
    return False


def kill_one(
    process: subprocess.Popen, whom: str, moment: float, chance: random.Random
) -> str:
    """Kill a process of a command at a moment (s) or, if there is none yet, as soon as there is; what was done."""
    leader = psutil.Process(process.pid)
    time.sleep(moment)
    while process.poll() is None:
        for victim in _below(leader).get(whom, [])[:1]:
            how = chance.choice(HOWS)
            with contextlib.suppress(psutil.NoSuchProcess):
                name = " ".join(victim.cmdline())[-60:]
                victim.send_signal(how)
                return f"{how.name} to {whom} ({name})"
        time.sleep(0.005)
    return ""


@dataclass
class Bench:
    """A folder where a command ran to its end, to compare others with."""

    folder: Path
    words: tuple[str, ...]
    scheduler: tuple[str, ...] = ()
    seen: dict[str, float] = field(
        init=False, default_factory=dict
    )  # how long (s) there was whom one may kill

    def __post_init__(self) -> None:
        self.folder.mkdir()
        write_inputs(self.folder)
        begun = time.monotonic()
        process = self.start(self.folder)
        while process.poll() is None:
            there = [
                whom
                for whom, found in _below(psutil.Process(process.pid)).items()
                if found
            ]
            self.seen.update(dict.fromkeys(there, time.monotonic() - begun))
            time.sleep(0.02)
        assert process.returncode == 0, process.communicate()[1]

    def start(self, folder: Path) -> subprocess.Popen:
        return stiffscope(*self.words, *self.scheduler, folder=folder)

    def run(self, folder: Path) -> tuple[int, str]:
        process = self.start(folder)
        said = process.communicate(timeout=LONGEST)[1].decode()
        return process.returncode, said

    def kill(
        self,
        seed: int,
        whom: str,
        act: Callable[..., str] = kill_one,
        latest: float = 0.8,
    ) -> tuple[str, list[str]]:
        """Kill in a folder of its own, sooner if the command ended first; what was done, and what is wrong after it."""
        chance = random.Random(seed)  # noqa: S311
        with tempfile.TemporaryDirectory(dir=self.folder.parent) as name:
            folder = Path(name)
            write_inputs(folder)
            # with a former output little may be left to do: in vain at first, a case is soon tried without
            former = (self.folder / "out").exists() and chance.random() < latest * 0.6
            if former:
                shutil.copytree(self.folder / "out", folder / "out")
            inputs = {path: path.read_bytes() for path in folder.glob("*.*")}
            process = self.start(folder)
            moment = chance.uniform(0, latest) * self.seen.get(whom, self.seen["main"])
            done = act(process, whom, moment, chance)
            said = process.communicate(timeout=LONGEST)[1].decode()
            if whom == "main" and process.returncode == 0:
                done = ""  # its work was done
            wrong = [f"alive: {each}" for each in left_alive(process.pid)]
            main = whom == "main" and bool(done)
            wrong += self._judge_words(said, process.returncode, main)
            wrong += ["an input changed"] * any(
                path.read_bytes() != held for path, held in inputs.items()
            )
            wrong += self._judge_folder(
                folder, former=former, killed="KILL" in done and main
            )
            wrong += self._judge_again(folder)
        return (
            (done, wrong) if done or wrong else self.kill(seed, whom, act, latest / 2)
        )

    @staticmethod
    def _judge_words(said: str, code: int, main: bool) -> list[str]:
        """What was said must be true: nothing if all went well or nobody was left to say it."""
        stopped = (
            main
            and code == 1
            and (said.strip() == f"stiffscope: {STOPPED}" or KEPT.match(said))
        )
        silent = not said.strip() and (code == 0 or (main and code < 0))
        other = (
            code == 1 and not main and len(said.splitlines()) == 1 and TRUE.match(said)
        )
        return (
            [] if stopped or silent or other else [f"exit code {code}: {said.strip()}"]
        )

    def _judge_folder(self, folder: Path, *, former: bool, killed: bool) -> list[str]:
        """What is there is whole, and what was there before is there."""
        wrong = []
        beside = [each.name for each in folder.glob(".out.*")]
        if (
            former
            and not (folder / "out").exists()
            and not any(".replaced-" in each for each in beside)
        ):
            wrong.append("the former output is lost")
        left = (
            {each.name for each in folder.iterdir()}
            - {"cache", "tmp", "out.designs", *MADE}
            - {each.name for each in self.folder.iterdir()}
        )
        left |= {f"tmp/{each.name}" for each in (folder / "tmp").iterdir()}
        wrong += [f"left behind: {sorted(left)}"] * bool(left and not killed)
        there = [made for made in MADE if (folder / made).exists()]
        return wrong + self._differences(folder, there, "half-written: ")

    def _judge_again(self, folder: Path) -> list[str]:
        """The same command again ends well, with the same figures, and clears what the killed one left."""
        shutil.rmtree(folder / "new", ignore_errors=True)
        (folder / "new.toml").unlink(missing_ok=True)
        code, said = self.run(folder)
        wrong = [f"again: exit code {code}: {said.strip()}"] * bool(
            code or said.strip()
        )
        left = {each.name for each in folder.iterdir()} ^ {
            each.name for each in self.folder.iterdir()
        }
        left -= {"cache"}  # a run that found another's output may need none
        left |= {
            each.name
            for aside in ("tmp", "cache/aside")
            for each in (folder / aside).glob("*")
        }
        wrong += [f"again: left behind or missing: {sorted(left)}"] * bool(left)
        return wrong or self._differences(folder, MADE, "again: ")

    def _differences(self, folder: Path, made: Sequence[str], said: str) -> list[str]:
        """Differences of what was made from what the command that was not killed made."""
        try:
            for each in made:
                close = MESHED.get(self.words[0])
                ours, theirs = (
                    results_in(place, each, meshed=bool(close))
                    for place in (folder, self.folder)
                )
                same(ours, theirs, close or 1e-9)
        except AssertionError as error:
            return [f"{said}{error}"]
        return []


def kill_worker(workers: Any) -> Callable[..., str]:
    """Return an act that kills a worker of a Dask cluster, whoever it works for."""

    def act(
        process: subprocess.Popen, whom: str, moment: float, chance: random.Random
    ) -> str:
        time.sleep(moment)
        while process.poll() is None:
            nanny = chance.choice(list(workers.values()))
            if (
                nanny.process and nanny.process.status.name == "running"
            ):  # whoever dies at its start is not replaced
                os.kill(nanny.pid, signal.SIGKILL)
                return f"SIGKILL to {whom}"
            time.sleep(0.005)
        return ""

    return act


def kill_commands(
    folder: Path, count: int, seed: int
) -> Iterator[tuple[str, str, list[str]]]:
    """Kill commands in turn: yield what was run, what was done, what is wrong."""
    benches = {name: Bench(folder / name, COMMANDS[name]) for name in OFTEN}
    for number in range(seed, seed + count):
        bench = benches[name := OFTEN[number % len(OFTEN)]]
        yield (
            name,
            *bench.kill(
                number, sorted(bench.seen)[number // len(OFTEN) % len(bench.seen)]
            ),
        )


def kill_workers(
    folder: Path, count: int, seed: int
) -> Iterator[tuple[str, str, list[str]]]:
    """As `kill_commands`, for workers of a study on a Dask scheduler."""
    from distributed import LocalCluster

    os.environ["STIFFSCOPE_CACHE"] = str(folder / "workers")
    with LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=":0"
    ) as local:
        bench = Bench(
            folder / "dask", COMMANDS["study"], ("--scheduler", local.scheduler_address)
        )
        for number in range(seed, seed + count):
            shutil.rmtree(folder / "workers", ignore_errors=True)
            yield "study", *bench.kill(number, "worker", kill_worker(local.workers))


def main() -> None:
    """Print each case; end with exit code 1 if one is wrong."""
    given = [int(word) for word in sys.argv[1:]]
    count, seed = (*given, *(40, 0)[len(given) :])
    bad = 0
    with tempfile.TemporaryDirectory() as folder:
        cases = (
            kill_workers(Path(folder), count // 8, seed),
            kill_commands(Path(folder), count - count // 8, seed),
        )
        for words, done, wrong in itertools.chain(*cases):
            bad += bool(wrong)
            sys.stdout.write(f"{words}: {done}: {'; '.join(wrong) or 'well'}\n")
            sys.stdout.flush()
    sys.exit(bool(bad))


if __name__ == "__main__":
    main()
