"""What a bad day brings: mutated files, killed commands, full disks. One law for all of them."""

from __future__ import annotations

import math
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import time
import warnings
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from stiffscope.cad.step import write_step
from stiffscope.data import FOLDER
from stiffscope.errors import InputError
from stiffscope.gap.campaigns import configure_case, open_case
from stiffscope.robot.reader import read_robot
from stiffscope.runtime.executor import LateError, WorkerError

ROBOTS = {path.name: path.read_text(encoding="utf-8") for path in sorted((FOLDER / "robots").glob("*.toml"))}
HOSTILE = (
    "1e308", "-1e308", "1e-308", "nan", "inf", "-0.0", "0", "[]", "{}", '""', '"= a"', '"= 9**9**9**9"',
    '"1 kg*9**9**9"',
    '"1 m^9^9"', "true", "9" * 5000, "[" * 200 + "]" * 200, '"\\u0000"', '"' + "x" * 3000 + '"', '"1e999 mm"', "'\x7f'",
    "2000-01-01", '"../../etc/passwd"', '"= sqrt(-1)"', '"= 1/0"',
)  # fmt: skip
LAW = settings(deadline=None, suppress_health_check=list(HealthCheck), database=None)


@st.composite
def mutants(draw: st.DrawFn) -> str:
    """A robot file with a few lines gone, doubled, swapped, with hostile values or letters."""
    lines = draw(st.sampled_from(list(ROBOTS.values()))).split("\n")
    for _ in range(draw(st.integers(1, 3))):
        at, other = draw(st.integers(0, len(lines) - 1)), draw(st.integers(0, len(lines) - 1))
        kind = draw(st.sampled_from(("value", "value", "gone", "double", "swap", "letter", "number")))
        if kind == "value" and "=" in lines[at]:
            lines[at] = f"{lines[at].partition('=')[0]}= {draw(st.sampled_from(HOSTILE))}"
        elif kind == "gone":
            lines[at] = ""
        elif kind == "double":
            lines.insert(at, lines[at])
        elif kind == "swap":
            lines[at], lines[other] = lines[other], lines[at]
        elif kind == "letter" and lines[at]:
            place = draw(st.integers(0, len(lines[at]) - 1))
            lines[at] = lines[at][:place] + draw(st.characters(codec="utf-8")) + lines[at][place + 1 :]
        elif kind == "number":
            digits = [k for k, letter in enumerate(lines[at]) if letter.isdecimal()]
            if digits:
                place = draw(st.sampled_from(digits))
                lines[at] = (
                    lines[at][:place] + draw(st.sampled_from(("1e300", "1e-300", "-7", "0"))) + lines[at][place + 1 :]
                )
    return "\n".join(lines)


def obeys(text: str) -> None:
    """A robot of finite numbers, or one line that names the file; soon, and without a warning."""
    begun = time.perf_counter()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            robot = read_robot(Path("mutant.toml"), text)
        except InputError as refused:
            assert str(refused).startswith("mutant.toml"), refused
            assert "\n" not in str(refused), refused
        else:
            poses = np.array([value for pose in robot.poses.values() for value in pose], dtype=float)
            assert np.isfinite(poses).all()
    assert time.perf_counter() - begun < 20


@settings(LAW, max_examples=25)
@given(mutants())
def test_a_mutated_robot_file_is_read_or_refused_in_one_line(text):
    obeys(text)


@pytest.mark.long
@settings(LAW, max_examples=2000)
@given(mutants())
def test_thousands_of_mutated_robot_files(text):
    obeys(text)


HEADER = """\
robot = "biglide"
modelled = ["gravity"]
components = "published"
readings = "readings.csv"
ignore = ["note"]
units = { value = "um", z = "mm" }

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
CELLS = (
    "", " ", "nan", "inf", "-1e308", "1e308", "1e-308", "9" * 5000, "0x10", "1_0", "1,5", '"', "hook", "gauge", "dx",
    "\0", "\u202e", "x" * 3000, "=1+1", "350 mm", "-0", "\t", ";", "\ud800",
)  # fmt: skip


@st.composite
def mutated_campaigns(draw: st.DrawFn) -> tuple[str, str]:
    """A campaign.toml and its readings with a few lines, cells or letters changed."""
    header, rows = HEADER.split("\n"), READINGS.split("\n")
    for _ in range(draw(st.integers(1, 3))):
        lines = draw(st.sampled_from((header, rows, rows)))
        at = draw(st.integers(0, len(lines) - 1))
        kind = draw(st.sampled_from(("value", "value", "value", "gone", "double", "letter")))
        if kind == "value" and lines is header:
            lines[at] = f"{lines[at].partition('=')[0]}= {draw(st.sampled_from(HOSTILE))}"
        elif kind == "value":
            cells = lines[at].split(",")
            cells[draw(st.integers(0, len(cells) - 1))] = draw(st.sampled_from(CELLS))
            lines[at] = ",".join(cells)
        elif kind == "gone":
            del lines[at]
        elif kind == "double":
            lines.insert(at, lines[at])
        elif lines[at]:
            place = draw(st.integers(0, len(lines[at]) - 1))
            lines[at] = lines[at][:place] + draw(st.characters(codec="utf-8")) + lines[at][place + 1 :]
        if not lines:
            lines.append("")
    return "\n".join(header), "\n".join(rows)


def campaign_obeys(folder: Path, header: str, rows: str) -> None:
    """A campaign of finite numbers on the robot that it names, or one line that names its file and line."""
    begun = time.perf_counter()
    for name, text in (("campaign.toml", header), ("readings.csv", rows)):
        (folder / name).write_bytes(text.encode("utf-8", "surrogatepass"))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            case = open_case(folder)
            configure_case(case)
        except InputError as refused:
            assert re.search(r"^(\S*/)?(campaign\.toml|readings\.csv)(:\d+)?: ", str(refused))
            assert "\n" not in str(refused)
        else:
            c = case.campaign
            assert len(c) > 0
            for values in (c.value, c.poses, c.wrench[c.kind == 0], c.sigma[~np.isnan(c.sigma)]):
                assert np.isfinite(values).all()
    assert sorted(each.name for each in folder.iterdir()) == ["campaign.toml", "readings.csv"]
    assert time.perf_counter() - begun < 20


def test_the_campaign_that_is_mutated_is_valid(tmp_path):
    campaign_obeys(tmp_path, HEADER, READINGS)
    assert len(open_case(tmp_path).campaign) == 4


@settings(LAW, max_examples=30)
@given(mutated_campaigns())
def test_a_mutated_campaign_is_read_or_refused_in_one_line(tmp_path_factory, texts):
    campaign_obeys(tmp_path_factory.mktemp("mutant"), *texts)


@pytest.mark.long
@settings(LAW, max_examples=2000)
@given(mutated_campaigns())
def test_thousands_of_mutated_campaigns(tmp_path_factory, texts):
    campaign_obeys(tmp_path_factory.mktemp("mutant"), *texts)


@pytest.mark.parametrize(
    "text",
    [".".join(["a"] * 300_000) + " = 1", f"[{'.'.join(['a'] * 300_000)}]", '"a".' * 100_000 + "a = 1", "a" * 1_000_000],
)
def test_a_file_is_read_in_time_that_grows_with_its_size(text):
    begun = time.perf_counter()
    with pytest.raises(InputError, match=r"^r\.toml:2: expected (keys of at most 30 names|valid TOML)"):
        read_robot(Path("r.toml"), f"# first\n{text}\n")
    assert time.perf_counter() - begun < 30  # under a second; far more where it grows faster than the file


def stiffscope(*words: str, folder: Path, **more) -> subprocess.Popen:
    environment = {**os.environ, "STIFFSCOPE_CACHE": str(folder / "cache"), "TMPDIR": str(folder / "tmp")}
    (folder / "tmp").mkdir(exist_ok=True)
    command = [sys.executable, "-m", "stiffscope", *words]
    return subprocess.Popen(
        command, cwd=folder, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        start_new_session=True, **more,
    )  # fmt: skip


def in_session(leader: int) -> list[str]:
    """Command lines of the living processes of a session."""
    found = []
    for place in Path("/proc").glob("[0-9]*"):
        try:
            state, _, _, session = (place / "stat").read_text().rpartition(")")[2].split()[:4]
            if int(session) == leader and state != "Z":
                found.append((place / "cmdline").read_text().replace("\0", " "))
        except OSError:
            continue
    return found


def killed_at_random(folder: Path, words: tuple[str, ...], latest: float, chance: random.Random) -> float | None:
    """Kill a command at a random moment: nothing of it lives two seconds later. Seconds that it took if it ended."""
    begun = time.monotonic()
    process = stiffscope(*words, folder=folder)
    took = None
    try:
        process.wait(chance.uniform(0.2, latest))
        took = time.monotonic() - begun
    except subprocess.TimeoutExpired:
        process.send_signal(chance.choice((signal.SIGKILL, signal.SIGTERM)))
    process.communicate(timeout=60)
    ends = time.monotonic() + 2
    while (left := in_session(process.pid)) and time.monotonic() < ends:
        time.sleep(0.1)
    assert not left
    return took


_POSE = ("--at", "0,0,350 mm", "--components", "published", "--out", "out", "--quiet")
BLIND = ("blind", "five-bar", "--components", "beam", "--campaigns", "2", "--out", "out", "--quiet")
COMMANDS = (
    ("run", "biglide", "--components", "published", "--out", "out", "--quiet"),
    ("check", "delta", "--out", "out", "--quiet"),
    ("map", "biglide", "--components", "published", "--points", "5", "--out", "out", "--quiet"),
    ("compliance", "biglide", "--part", "link", "--superelement", "out", "--json", "a.json", "--quiet"),
    ("modes", "biglide", *_POSE),
    ("frf", "biglide", "--from", "platform:0,0,0:z", "--to", "platform:0,0,0:z", *_POSE),
    ("deflection", "biglide", "--wrench", "0,0,100,0,0,0", *_POSE),
    ("stiffness", "delta", "--json", "a.json", "--quiet"),
    ("sensitivity", "biglide", *_POSE),
    ("study", "study.toml", "--out", "out", "--quiet"),
    ("path", "job.toml", "--out", "out", "--compensate", "--quiet"),
    ("interfaces", "biglide", "--part", "link", "--out", "out", "--quiet"),
    ("campaign", "check", "c", "--out", "out", "--quiet"),
    ("campaign", "new", "biglide", "--out", "new", "--quiet"),
    ("diagnose", "c", "--out", "out", "--quiet"),
    ("diagnose", "known", "--adopt", "new.toml", "--out", "out", "--quiet"),
    BLIND,
    ("audit", "--json", "a.json", "--quiet"),
    ("compare", "biglide", "--part", "link", "--json", "a.json", "--quiet"),
    ("new", "delta", "new.toml", "--quiet"),
    ("import", "arm.urdf", "--out", "new.toml", "--quiet"),
)
STUDY = """\
robot = "five-bar"
method = "grid"
components = "beam"
[parameters]
"inner.radius" = { range = ["16 mm", "18 mm"], steps = 3 }
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
KILLS = 6  # of each command


ENDS = {".png": b"IEND\xaeB`\x82", ".gif": b";", ".html": b"</html>"}  # of a whole file


def results_in(folder: Path) -> dict[str, str]:
    """Every file of an output folder but pictures, which a busy machine leaves out; the text of those without times.

    Pictures and pages are whole.
    """
    texts: dict[str, str] = {}
    for path in sorted(folder.rglob("*")):
        if path.suffix in ENDS:
            assert path.read_bytes().rstrip().endswith(ENDS[path.suffix]), path
        if path.is_file() and path.suffix not in {".png", ".gif"}:
            plain = path.suffix in {".csv", ".json"} and path.name not in {"manifest.json", "scores.json"}
            texts[path.relative_to(folder).as_posix()] = path.read_text(encoding="utf-8") if plain else ""
    return texts


NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e[+-]?\d+)?(?![\w.])")


def same(ours: dict[str, str], theirs: dict[str, str], close: float) -> None:
    """Assert the same files with the same words and, but for rounding or another mesh, the same numbers."""
    assert set(ours) == set(theirs)
    for name, text in ours.items():
        assert NUMBER.sub("#", text) == NUMBER.sub("#", theirs[name]), name
        one, other = (np.array(NUMBER.findall(each), dtype=float) for each in (text, theirs[name]))
        assert np.allclose(one, other, rtol=close, atol=close * np.abs(other).max(initial=0)), name


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
@pytest.mark.long
@pytest.mark.parametrize(
    "words", COMMANDS, ids=lambda words: "-".join(words[: 1 + (words[0] in {"campaign", "diagnose"})])
)
def test_kills_at_random_moments_lose_and_leave_nothing(tmp_path, words):
    chance = random.Random(7)  # noqa: S311
    clean, spoilt = tmp_path / "clean", tmp_path / "spoilt"
    for folder in (clean, spoilt):
        (folder / "c").mkdir(parents=True)
        (folder / "c" / "campaign.toml").write_text(HEADER)
        (folder / "c" / "readings.csv").write_text(READINGS)
        shutil.copytree(FOLDER / "withheld" / "campaign-001", folder / "known")
        (folder / "study.toml").write_text(STUDY)
        (folder / "job.toml").write_text(JOB)
        (folder / "path.csv").write_text(PATH)
        (folder / "arm.urdf").write_text(ARM)
        (folder / "notes.txt").write_text("mine")
    begun = time.monotonic()
    first = stiffscope(*words, folder=clean)
    _, errors = first.communicate(timeout=900)
    assert first.returncode == 0, errors
    latest, killed = time.monotonic() - begun, 0
    while killed < KILLS:  # what ends before its kill is the quicker by what its forerunners left in the cache
        took = killed_at_random(spoilt, words, latest, chance)
        latest, killed = (latest, killed + 1) if took is None else (max(took, 0.3), killed)
        for path in (spoilt / "new.toml", spoilt / "new"):  # these are whole or absent, and never replaced
            if path.is_dir():
                same(results_in(path), results_in(clean / "new"), 0.0)
                shutil.rmtree(path)
            elif path.exists():
                assert path.read_bytes() == (clean / "new.toml").read_bytes()
                path.unlink()
    done = stiffscope(*words, folder=spoilt)
    _, errors = done.communicate(timeout=900)
    assert done.returncode == 0, errors
    assert (spoilt / "notes.txt").read_text() == "mine"
    assert {each.name for each in spoilt.iterdir()} == {each.name for each in clean.iterdir()}
    assert not [each.name for each in (spoilt / "tmp").iterdir()]
    close = 0.1 if words[0] == "interfaces" else 1e-9  # other meshes have other numbers of elements, too
    same(results_in(spoilt / "out"), results_in(clean / "out"), close)


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
@pytest.mark.parametrize("words", [COMMANDS[3], BLIND], ids=lambda words: words[0])
def test_a_command_that_is_stopped_leaves_no_child_and_says_one_line(tmp_path, words, how):
    process = stiffscope(*words, folder=tmp_path)
    ends = time.monotonic() + 60
    while len(in_session(process.pid)) < 3 and time.monotonic() < ends:  # itself, the tracker of resources, a worker
        time.sleep(0.001)
    (os.killpg if how == signal.SIGINT else os.kill)(process.pid, how)  # Ctrl-C reaches the whole group
    _, errors = process.communicate(timeout=60)
    ends = time.monotonic() + 20  # 2 s on a machine that has nothing else to do
    while (left := in_session(process.pid)) and time.monotonic() < ends:
        time.sleep(0.05)
    assert not left
    if how == signal.SIGKILL:
        assert b"Warning" not in errors
    else:
        assert errors.strip() == b"stiffscope: stopped; nothing half-written is left"
        assert not list((tmp_path / "tmp").iterdir())
        assert {each.name for each in tmp_path.iterdir()} <= {"cache", "tmp", "out.cases"}


@pytest.fixture(scope="module")
def box(tmp_path_factory) -> bytes:
    from build123d import Box

    from stiffscope.cad.solid import part_of

    path = tmp_path_factory.mktemp("box") / "box.step"
    write_step(part_of(Box(20, 10, 5), name="box"), path)
    return path.read_bytes()


def step_obeys(path: Path, content: bytes, chance: random.Random) -> str:
    """A mutated STEP file is a finite solid, "read", or "refused" in one line with its name."""
    from stiffscope.cad.part import mass_properties
    from stiffscope.cad.step import read_step

    for _ in range(chance.randint(1, 3)):
        at = chance.randrange(200, len(content) - 40)
        kind = chance.choice(("byte", "gone", "number"))
        if kind == "byte":
            content = content[:at] + bytes([chance.randrange(256)]) + content[at + 1 :]
        elif kind == "gone":
            content = content[:at] + content[at + chance.randint(1, 80) :]
        else:
            content = content[:at] + chance.choice((b"1.E+300", b"-1.", b"#9999", b"$")) + content[at:]
    path.write_bytes(content)
    try:
        part = read_step(path, time_limit=30.0)
    except InputError as refused:
        assert "\n" not in str(refused)
        assert path.stem in str(refused)
        return "refused"
    assert math.isfinite(mass_properties(part).mass)
    return "read"


@pytest.mark.long
def test_a_mutated_step_file_is_read_or_refused_in_one_line(tmp_path, box):
    for number in range(3):
        step_obeys(tmp_path / "mutant.step", box, random.Random(number))  # noqa: S311


def do_in_fork(function, *arguments, name: str, limit: float) -> None:
    """As `do_alone` with the reader of STEP files, whose imports take most of its time."""
    from stiffscope.cad import kernel_files, part, validity

    assert kernel_files
    assert validity
    assert part
    said = arguments[-1].with_name("said")
    child = os.fork()
    if not child:
        code = 1
        try:
            signal.alarm(math.ceil(limit))
            function(*arguments)
            code = 0
        except InputError as error:
            said.write_text(str(error))
            code = 2
        finally:
            os._exit(code)
    ended = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    if ended == -signal.SIGALRM:
        raise LateError(name, "", limit)
    if ended == 2:
        raise InputError(said.read_text())
    if ended:
        raise WorkerError(f"{name}: its process ended without an answer", ended)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="forks")
@pytest.mark.long
def test_thousands_of_mutated_step_files(tmp_path, box, monkeypatch):
    monkeypatch.setattr("stiffscope.cad.step.do_alone", do_in_fork)
    chances = map(random.Random, range(2000))
    counts = Counter(step_obeys(tmp_path / "mutant.step", box, chance) for chance in chances)
    assert sorted(each.name for each in tmp_path.iterdir()) == ["mutant.step"]
    assert counts["read"] > 100
    assert counts["refused"] > 100
