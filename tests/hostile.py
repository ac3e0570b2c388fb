"""Seeded mutations of valid files, and the judge of what a command makes of them.

`python -m tests.hostile_families FAMILY COUNT [SEED] [--read]` prints each case of a family that is wrong (and each
that is answered).
"""

from __future__ import annotations

import contextlib
import io
import json
import logging
import os
import random
import re
import resource
import signal
import sys
import tempfile
import time
import traceback
import zipfile
from dataclasses import dataclass
from pathlib import Path

from stiffscope.cli.main import main

SECONDS = 10
MEMORY = 2 << 30
VALUES = (
    "nan",
    "inf",
    "-inf",
    "0",
    "-1",
    "1e308",
    "1e-308",
    "-1e30",
    "true",
    '""',
    "[]",
    "{}",
    '"5 kg"',
    '"3 rad"',
    '"7 N"',
    '"-20 mm"',
    '"0 mm"',
    '"1e9 m"',
    '"nan mm"',
    '"5 furlong"',
    '"no such name"',
    '"= nothing"',
    '"= 1/0"',
    '"= 1e999"',
    '"a\\nb"',
    '"\\u001b[31mred"',
    '"' + "x" * 3000 + '"',
    "1979-05-27",
    '["1 mm"]',
    '"../../../etc/passwd"',
    '"ground"',
    '"1,5 mm"',
    '"1.000,5 mm"',
    '"\u22125 mm"',
    '"5 Nm"',
)
NUMBERS = (
    "nan",
    "inf",
    "-1",
    "0",
    "1e308",
    "1e-300",
    "-1e9",
    "1e9",
    "007",
    "1,5",
    "x",
    "1.000",
    "1 000",
    "\u22121",
)
UNITS = (
    "mm",
    "um",
    "m",
    "kg",
    "g",
    "N",
    "N*m",
    "N/um",
    "kN*m/rad",
    "deg",
    "rad",
    "um/N",
    "rad/(N*m)",
    "%",
    "Hz",
    "Pa",
)
HARMLESS = "a spelling of the same"
REFUSAL = re.compile(r"stiffscope: [^:]+(?P<line>:\d+)?: .*expected .+")


def mutate(rng: random.Random, data: bytes, suffix: str) -> tuple[bytes, str]:
    """A file's content with one thing wrong, and what that is."""
    if suffix == ".xlsx":
        return _mutate_workbook(rng, data)
    broken = rng.random()
    if broken < 0.03:
        at = rng.randrange(len(data))
        return data[:at], f"truncated at {at}"
    if broken < 0.06:
        at = rng.randrange(len(data))
        return data[:at] + rng.choice((b"\xff", b"\x00", b"\xe9", b"\x1b[2J")) + data[
            at:
        ], f"a byte at {at}"
    if broken < 0.07:
        return data.decode().encode("utf-16"), "UTF-16"
    if broken < 0.1 and suffix != ".step":
        return rng.choice(
            (b"\xef\xbb\xbf" + data, data.replace(b"\n", b"\r\n"), data + b"\n\n")
        ), HARMLESS
    lines = data.decode().split("\n")
    unlike = {
        line: k
        for k, line in enumerate(lines)
        if line.strip() and not line.lstrip().startswith("#")
    }
    at = rng.choice(list(unlike.values()))  # STEP repeats many lines that mean little
    old = lines[at]
    lines[at : at + 1] = _mutate_line(rng, old, suffix, lines)
    return "\n".join(lines).encode(
        "utf-8", "surrogatepass"
    ), f"{at + 1}: {old!r} -> {lines[at][:120]!r}"


def _mutate_line(  # noqa: PLR0911 (one for each kind)
    rng: random.Random, line: str, suffix: str, lines: list[str]
) -> list[str]:
    names = sorted(
        set(
            re.findall(
                r'(?<==\s")\w[\w.]*(?=")|(?<=")\w[\w.]+(?=")|(?<=\.)\w+(?=\])',
                "\n".join(lines),
            )
        )
    )
    kind = rng.choice(
        (
            "value",
            "value",
            "number",
            "number",
            "unit",
            "name",
            "name",
            "key",
            "gone",
            "twice",
            "letter",
        )
    )
    key, is_value, _ = line.partition("=")
    if kind == "gone":
        return [""]
    if kind == "twice":
        return [line, line]
    if kind == "value" and suffix == ".toml" and is_value and not line.startswith("["):
        return [f"{key}= {rng.choice(VALUES)}"]
    if kind == "unit" and (
        found := _choose(rng, r"(?<=\d )[a-zA-Z*/()^0-9]+(?=[\" ])", line)
    ):
        return [line[: found.start()] + rng.choice(UNITS) + line[found.end() :]]
    if (
        kind == "name"
        and names
        and (found := _choose(rng, r'(?<=")[A-Za-z][^"]*(?=")', line))
    ):
        alike = (
            found[0] + "x",
            found[0].upper(),
            found[0] + " ",
            found[0].replace("a", "\u0430").replace("e", "\u0435"),
        )
        other = rng.choice(
            (rng.choice(names), "nobody", "a\\nb", "a\\u001b[31m", "ground", "", *alike)
        )
        return [line[: found.start()] + other + line[found.end() :]]
    if kind == "key" and (
        found := _choose(rng, r"[A-Za-z_]\w*(?=\s*=)|(?<=<)\w+", line)
    ):
        return [
            line[: found.start()]
            + rng.choice((found[0] + "x", rng.choice(names or ["x"])))
            + line[found.end() :]
        ]
    if kind == "letter":
        at = rng.randrange(len(line))
        return [line[:at] + rng.choice('x"[]{}=,.<>\x00\u202e') + line[at + 1 :]]
    found = _choose(rng, r"-?\d+(\.\d*)?(e-?\d+)?", line)
    if found:
        return [line[: found.start()] + rng.choice(NUMBERS) + line[found.end() :]]
    found = _choose(rng, r'(?<=")[^"]+(?=")|(?<=,)[^,]+', line)
    if found:
        return [
            line[: found.start()]
            + rng.choice(("", "5 kg", "nan", "x"))
            + line[found.end() :]
        ]
    return [""]


def _choose(rng: random.Random, pattern: str, line: str) -> re.Match[str] | None:
    found = list(re.finditer(pattern, line))
    return rng.choice(found) if found else None


def _mutate_workbook(rng: random.Random, data: bytes) -> tuple[bytes, str]:
    kind = rng.random()
    if kind < 0.1:
        at = rng.randrange(len(data))
        return data[:at] + rng.choice(
            (b"", bytes([data[at] ^ 255]) + data[at + 1 :])
        ), f"bytes from {at}"
    with zipfile.ZipFile(io.BytesIO(data)) as book:
        files = {name: book.read(name) for name in book.namelist()}
    name = (
        rng.choice(sorted(files))
        if kind < 0.3
        else rng.choice([each for each in sorted(files) if "sheet1" in each])
    )
    if kind < 0.2:
        del files[name]
        said = f"{name} gone"
    else:
        cells = files[name].replace(b"><", b">\n<")
        files[name], said = mutate(rng, cells, ".xml")
        said = f"{name}: {said}"
    whole = io.BytesIO()
    with zipfile.ZipFile(whole, "w") as book:
        for each, content in files.items():
            book.writestr(each, content)
    return whole.getvalue(), said


@dataclass(frozen=True)
class Family:
    """Valid files, those that are mutated, and the command that reads them (in their folder)."""

    files: dict[str, bytes]
    mutated: tuple[str, ...]
    arguments: tuple[str, ...]
    before: tuple[
        str, ...
    ] = ()  # run first, to import what the command needs; by default the command itself


@dataclass(frozen=True)
class Case:
    """What a command made of a mutated file: its exit code, its words, its answer, and what is wrong with it."""

    seed: int
    change: str
    code: int
    said: str
    answer: str
    wrong: str


def warm(family: Family) -> Case:
    """The files as they are; what the command imports for them stays in this process, for all that are forked of it."""
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        for name, data in family.files.items():
            Path(name).write_bytes(data)
        with contextlib.suppress(SystemExit), contextlib.redirect_stdout(io.StringIO()):
            main(list(family.before or family.arguments))
    logging.getLogger().handlers.clear()  # which hold this process's standard error
    return run(family, None)


def run(family: Family, seed: int | None) -> Case:
    """One case in a process of its own, forked from this one; the files as they are where there is no seed."""
    with tempfile.TemporaryDirectory() as folder:
        for name, data in family.files.items():
            (Path(folder) / name).write_bytes(data)
        change = "none"
        if seed is not None:
            rng = random.Random(seed)  # noqa: S311
            name = rng.choice(family.mutated)
            data, change = mutate(rng, family.files[name], Path(name).suffix)
            (Path(folder) / name).write_bytes(data)
            change = f"{name}: {change}"
        begun = time.monotonic()
        process = os.fork()
        if not process:
            _answer(folder, family.arguments)
        _, status, used = os.wait4(process, 0)
        taken = time.monotonic() - begun
        code = os.waitstatus_to_exitcode(status)
        said = (Path(folder) / "stderr").read_text(errors="replace")
        made = {path.name for path in Path(folder).iterdir()} - {
            *family.files,
            "stdout",
            "stderr",
        }
        made -= (
            {"out.json"} if family.arguments[0] == "check" else set()
        )  # which reports what it then refuses
        answer = Path(folder) / "out.json"
        answer = answer.read_text() if answer.exists() else ""
    wrong = _judge(code, said, answer, made) or (
        "refused" if code and HARMLESS in change else ""
    )
    if taken > SECONDS and used.ru_utime + used.ru_stime > SECONDS:
        wrong = wrong or f"{taken:.0f} s"
    if used.ru_maxrss << 10 > MEMORY:
        wrong = wrong or f"{used.ru_maxrss >> 10} MiB"
    return Case(-1 if seed is None else seed, change, code, said, answer, wrong)


def _answer(folder: str, arguments: tuple[str, ...]) -> None:
    """Run a command in a folder, its words in files beside what it reads; never returns."""
    code = 70
    try:
        os.chdir(folder)
        for number, name in ((1, "stdout"), (2, "stderr")):
            os.dup2(os.open(name, os.O_WRONLY | os.O_CREAT), number)
        sys.stdout, sys.stderr = os.fdopen(1, "w"), os.fdopen(2, "w")
        signal.alarm(6 * SECONDS)
        resource.setrlimit(resource.RLIMIT_AS, (4 * MEMORY, 4 * MEMORY))
        main(list(arguments))
    except SystemExit as end:
        code = int(end.code or 0)
    except BaseException:  # noqa: BLE001 (whatever it is, it is wrong)
        traceback.print_exc()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


def _judge(code: int, said: str, answer: str, made: set[str]) -> str:  # noqa: PLR0911 (one for each law)
    if code not in (0, 2):
        return f"exit code {code}"
    if "Traceback" in said or "unexpected" in said:
        return "traceback"
    if re.search(r"[^\x20-\x7e\n\u00a0-\uffff]", said) or "\u202e" in said:
        return "control characters on the terminal"
    if code == 0:
        return "not JSON" if answer and not _is_json(answer) else ""
    left = [each for each in made if not each.startswith("parts")]
    if left:
        return f"left behind: {left}"
    if len(said.splitlines()) != 1:
        return f"{len(said.splitlines())} lines"
    form = REFUSAL.match(said)
    return (
        ("" if form["line"] or "toml" not in said.split(":")[1] else "no line")
        if form
        else "not in the form"
    )


def _is_json(text: str) -> bool:
    def refuse(word: str) -> None:
        raise ValueError(word)

    try:
        json.loads(text, parse_constant=refuse)
    except ValueError:
        return False
    return True
