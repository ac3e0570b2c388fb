"""What a bad day brings: mutated files, killed commands, full disks. One law for all of them."""

from __future__ import annotations

import math
import os
import random
import re
import signal
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
from tests.kills import (
    BLIND,
    COMMANDS,
    COMPLIANCE,
    HEADER,
    READINGS,
    Bench,
    in_session,
    left_alive,
    stiffscope,
)

pytestmark = pytest.mark.slow

ROBOTS = {
    path.name: path.read_text(encoding="utf-8")
    for path in sorted((FOLDER / "robots").glob("*.toml"))
}
HOSTILE = (
    "1e308",
    "-1e308",
    "1e-308",
    "nan",
    "inf",
    "-0.0",
    "0",
    "[]",
    "{}",
    '""',
    '"= a"',
    '"= 9**9**9**9"',
    '"1 kg*9**9**9"',
    '"1 m^9^9"',
    "true",
    "9" * 5000,
    "[" * 200 + "]" * 200,
    '"\\u0000"',
    '"' + "x" * 3000 + '"',
    '"1e999 mm"',
    "'\x7f'",
    "2000-01-01",
    '"../../etc/passwd"',
    '"= sqrt(-1)"',
    '"= 1/0"',
)
LAW = settings(deadline=None, suppress_health_check=list(HealthCheck), database=None)


@st.composite
def mutants(draw: st.DrawFn) -> str:
    """A robot file with a few lines gone, doubled, swapped, with hostile values or letters."""
    lines = draw(st.sampled_from(list(ROBOTS.values()))).split("\n")
    for _ in range(draw(st.integers(1, 3))):
        at = draw(st.integers(0, len(lines) - 1))
        other = draw(st.integers(0, len(lines) - 1))
        kind = draw(
            st.sampled_from(
                ("value", "value", "gone", "double", "swap", "letter", "number")
            )
        )
        if kind == "value" and "=" in lines[at]:
            lines[at] = (
                f"{lines[at].partition('=')[0]}= {draw(st.sampled_from(HOSTILE))}"
            )
        elif kind == "gone":
            lines[at] = ""
        elif kind == "double":
            lines.insert(at, lines[at])
        elif kind == "swap":
            lines[at], lines[other] = lines[other], lines[at]
        elif kind == "letter" and lines[at]:
            place = draw(st.integers(0, len(lines[at]) - 1))
            lines[at] = (
                lines[at][:place]
                + draw(st.characters(codec="utf-8"))
                + lines[at][place + 1 :]
            )
        elif kind == "number":
            digits = [k for k, letter in enumerate(lines[at]) if letter.isdecimal()]
            if digits:
                place = draw(st.sampled_from(digits))
                lines[at] = (
                    lines[at][:place]
                    + draw(st.sampled_from(("1e300", "1e-300", "-7", "0")))
                    + lines[at][place + 1 :]
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
            poses = np.array(
                [value for pose in robot.poses.values() for value in pose], dtype=float
            )
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


CELLS = (
    "",
    " ",
    "nan",
    "inf",
    "-1e308",
    "1e308",
    "1e-308",
    "9" * 5000,
    "0x10",
    "1_0",
    "1,5",
    '"',
    "hook",
    "gauge",
    "dx",
    "\0",
    "\u202e",
    "x" * 3000,
    "=1+1",
    "350 mm",
    "-0",
    "\t",
    ";",
    "\ud800",
)


@st.composite
def mutated_campaigns(draw: st.DrawFn) -> tuple[str, str]:
    """A campaign.toml and its readings with a few lines, cells or letters changed."""
    header = HEADER.split("\n")
    rows = READINGS.split("\n")
    for _ in range(draw(st.integers(1, 3))):
        lines = draw(st.sampled_from((header, rows, rows)))
        at = draw(st.integers(0, len(lines) - 1))
        kind = draw(
            st.sampled_from(("value", "value", "value", "gone", "double", "letter"))
        )
        if kind == "value" and lines is header:
            lines[at] = (
                f"{lines[at].partition('=')[0]}= {draw(st.sampled_from(HOSTILE))}"
            )
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
            lines[at] = (
                lines[at][:place]
                + draw(st.characters(codec="utf-8"))
                + lines[at][place + 1 :]
            )
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
            assert re.search(
                r"^(\S*/)?(campaign\.toml|readings\.csv)(:\d+)?: ", str(refused)
            )
            assert "\n" not in str(refused)
        else:
            c = case.campaign
            assert len(c) > 0
            for values in (
                c.value,
                c.poses,
                c.wrench[c.kind == 0],
                c.sigma[~np.isnan(c.sigma)],
            ):
                assert np.isfinite(values).all()
    assert sorted(each.name for each in folder.iterdir()) == [
        "campaign.toml",
        "readings.csv",
    ]
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
    [
        ".".join(["a"] * 300_000) + " = 1",
        f"[{'.'.join(['a'] * 300_000)}]",
        '"a".' * 100_000 + "a = 1",
        "a" * 1_000_000,
    ],
)
def test_a_file_is_read_in_time_that_grows_with_its_size(text):
    begun = time.perf_counter()
    with pytest.raises(
        InputError, match=r"^r\.toml:2: expected (keys of at most 30 names|valid TOML)"
    ):
        read_robot(Path("r.toml"), f"# first\n{text}\n")
    assert (
        time.perf_counter() - begun < 30
    )  # under a second; far more where it grows faster than the file


KILLS = 6  # of each command


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
@pytest.mark.long
@pytest.mark.parametrize("name", COMMANDS)
def test_kills_at_random_moments_lose_and_leave_nothing(tmp_path, name):
    bench = Bench(tmp_path / "clean", COMMANDS[name])
    cases = [bench.kill(seed, "main") for seed in range(KILLS)]
    assert [case for case in cases if case[1]] == []


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
@pytest.mark.parametrize(
    ("name", "whom"),
    [
        pytest.param("run", "mesher", marks=pytest.mark.extended),
        pytest.param("study", "child", marks=pytest.mark.long),
        pytest.param("check", "child", marks=pytest.mark.extended),
    ],
)
def test_a_kill_loses_and_leaves_nothing(tmp_path, name, whom):
    assert Bench(tmp_path / "clean", COMMANDS[name]).kill(3, whom)[1] == []


@pytest.mark.extended_for(
    "blind-9", "compliance-15", "compliance-2", "compliance-9", "blind-2"
)
@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
@pytest.mark.parametrize("words", [COMPLIANCE, BLIND], ids=lambda words: words[0])
def test_a_command_that_is_stopped_leaves_no_child_and_says_one_line(
    tmp_path, words, how
):
    process = stiffscope(*words, folder=tmp_path)
    ends = time.monotonic() + 60
    while (
        len(in_session(process.pid)) < 3 and time.monotonic() < ends
    ):  # itself, the tracker of resources, a worker
        time.sleep(0.001)
    (os.killpg if how == signal.SIGINT else os.kill)(
        process.pid, how
    )  # Ctrl-C reaches the whole group
    _, errors = process.communicate(timeout=60)
    assert not left_alive(
        process.pid, 20.0
    )  # 2 s on a machine that has nothing else to do
    if how == signal.SIGKILL:
        assert b"Warning" not in errors
    else:
        assert errors.strip() == b"stiffscope: stopped; nothing half-written is left"
        assert not list((tmp_path / "tmp").iterdir())
        assert {each.name for each in tmp_path.iterdir()} <= {
            "cache",
            "tmp",
            "out.cases",
        }


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
            content = (
                content[:at]
                + chance.choice((b"1.E+300", b"-1.", b"#9999", b"$"))
                + content[at:]
            )
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
    counts = Counter(
        step_obeys(tmp_path / "mutant.step", box, chance) for chance in chances
    )
    assert sorted(each.name for each in tmp_path.iterdir()) == ["mutant.step"]
    assert counts["read"] > 100
    assert counts["refused"] > 100
