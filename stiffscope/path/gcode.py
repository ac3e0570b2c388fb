"""ISO G-code: lines and arcs of a program as points, and points written back (ISO 6983-1).

G0 to G3 with I J K or R, G17 to G19, G20 and G21, G90 and G91, F. Words without motion are kept.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.errors import InputError, require
from stiffscope.runtime.reading import read_text

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from stiffscope.runtime.types import Array, Flags, Indices

MOST_BYTES = 1 << 28
MOST_POINTS = 1_000_000
INCH = 25.4e-3
_WORD = re.compile(r"([A-Z])\s*([-+]?(?:\d+\.?\d*|\.\d+))")
_EXPONENT = re.compile(r"[A-Z]\s*[-+]?[\d.]*\dE[-+]?\d+(?![\d.])")
_COMMENT = re.compile(r"\([^)]*\)|;.*")
_MODES = re.compile(
    r"(?i)(?<![A-Z(])(G\s*(0?[0-3]|1[789]|2[01]|9[01])(?![\d.])|F\s*[\d.]+)\s*"
)
"""Feeds, units and modes, which the points of a written program set."""
_PLANES = {17: (0, 1, 2), 18: (2, 0, 1), 19: (1, 2, 0)}
_MOVES = (0, 1, 2, 3)
_KNOWN = {
    *_MOVES,
    *_PLANES,
    4,
    20,
    21,
    28,
    30,
    40,
    43,
    49,
    53,
    54,
    61,
    64,
    80,
    90,
    91,
    94,
}
_POINTS = {
    61.1,
    64.1,
    91.1,
}  # decimal codes without effect: arc centres are always relative
_CALLS = {97, 98}  # M codes that call subprograms
_SUPPORTED = "G0 to G3, G17 to G21, G90, G91 and others that do not move the tool"


@dataclass(frozen=True, eq=False)
class Program:
    """Points (n, 3) of a program, m, program axes; the path starts at the first.

    ``rapid`` (n,): moves by G0; ``feed`` (n,): m/s (NaN before any F); ``line`` (n,): line index in
    the file. ``text``: lines of the file; ``moving``: indices of lines with motion.
    """

    points: Array
    rapid: Flags
    feed: Array
    line: Indices
    text: tuple[str, ...]
    moving: frozenset[int]


@dataclass
class _State:
    at: Array = field(default_factory=lambda: np.zeros(3))
    move: int = 0
    plane: int = 17
    unit: float = 1e-3
    absolute: bool = True
    feed: float = np.nan


def read_program(path: Path, step: float) -> Program:
    """Read a program.

    Parameters
    ----------
    path
        Program file.
    step
        Largest distance of points on lines and arcs, m; a smaller step gives more points.

    Raises
    ------
    InputError
        A word is invalid, an arc does not close, or a motion code is not supported.
    """
    text = tuple(read_text(path, "a program in G-code", MOST_BYTES).splitlines())
    state = _State()
    rows: list[tuple[Array, bool, float, int]] = []
    for number, line in enumerate(text):
        for point in _read_line(state, line, f"{path.name}:{number + 1}", step):
            rows.append((point, state.move == 0, state.feed, number))
            if len(rows) > MOST_POINTS:
                often = f"one at least every {1e3 * step:g} mm: step"
                most = f"expected at most {MOST_POINTS:,} points ({often})"
                raise InputError(f"{path.name}:{number + 1}: {most}, got more")
    require(
        rows, path.name, "lines that move the tool (G0 to G3 with X, Y or Z)", "none"
    )
    points, rapid, feed, line = map(np.array, zip(*rows, strict=True))
    return Program(
        points=points,
        rapid=rapid,
        feed=feed,
        line=line,
        text=text,
        moving=frozenset(line.tolist()),
    )


def _read_line(state: _State, line: str, here: str, step: float) -> Iterator[Array]:
    """Yield the points of a line's move; the last is its end."""
    bare = _COMMENT.sub("", line).strip().upper()
    if not bare or bare.startswith(("%", "/")):
        return
    words = _read_words(bare, here)
    values = {
        letter: float(number) for letter, number in words if letter not in "GMNTSOH"
    }
    for letter, number in words:
        _set_mode(state, letter, float(number), here)
    if "F" in values:
        state.feed = values["F"] * state.unit / 60.0
    if ("G", 4.0) in ((letter, float(number)) for letter, number in words):
        return  # a dwell: X is a time
    axes = [letter for letter in "XYZ" if letter in values]
    for letter in "ABCUVW":
        turned = values.get(letter, 0.0)
        got = f"{letter}{turned:g}"
        require(not turned, f"{here}: {letter}", "moves in X, Y and Z alone", got)
    if not axes and not (state.move > 1 and {"I", "J", "K"} & set(values)):
        return
    end = state.at.copy()
    for letter in axes:
        k = "XYZ".index(letter)
        end[k] = values[letter] * state.unit + (0.0 if state.absolute else end[k])
    if state.move < 2:
        yield from _divide(state.at, end, step if state.move else np.inf)
    else:
        yield from _arc(state, end, values, here, step)
    state.at = end


def _read_words(bare: str, here: str) -> list[tuple[str, str]]:
    """Return letters and numbers of a line. Raises InputError for what is ambiguous or no word."""
    words = _WORD.findall(bare)
    rest = _WORD.sub("", bare).strip()
    require(not rest, here, "words such as G1 X10.5 F200", f"{rest[:20]!r}")
    for raised in _EXPONENT.findall(bare)[:1]:
        where = f"{here}: {raised[0]}"
        raise InputError(
            f"{where}: expected a number without an exponent, got {raised}"
        )
    known: dict[str, str] = {}
    for letter, number in words:
        alone = letter not in known or letter in "GM"
        got = f"{letter}{known.get(letter)} and {letter}{number}"
        require(alone, f"{here}: {letter}", "one word of a letter", got)
        known[letter] = number
    feed = known.get("F", "1")
    require(float(feed) > 0.0, f"{here}: F", "a feed above 0", f"F{feed}")
    return words


def _set_mode(state: _State, letter: str, code: float, here: str) -> None:
    """Set a mode by its G code; raise InputError for unsupported motion and subprogram calls."""
    known = int(code)
    require(
        not (letter == "M" and code in _CALLS),
        f"{here}: M{code:g}",
        "a program without calls of others",
        "one",
    )
    if letter != "G":
        return
    where = f"{here}: G{code:g}"
    supported = known in _KNOWN and (code == known or code in _POINTS)
    require(supported, where, _SUPPORTED, f"G{code:g}")
    machine_axes = "moves in the program's own axes"
    require(known not in {28, 30, 53}, where, machine_axes, "one in the machine's")
    if known in _MOVES:
        state.move = known
    elif known in _PLANES:
        state.plane = known
    elif known in {20, 21}:
        state.unit = INCH if known == 20 else 1e-3
    elif code in {90, 91}:
        state.absolute = known == 90


def _divide(start: Array, end: Array, step: float) -> Iterator[Array]:
    count = max(1, int(np.ceil(float(np.linalg.norm(end - start)) / step - 1e-9)))
    for k in range(1, count):
        yield start + (end - start) * (k / count)
    yield end


def _arc(
    state: _State, end: Array, values: dict[str, float], here: str, step: float
) -> Iterator[Array]:
    """Yield the points of an arc or helix: G2 clockwise, G3 counter-clockwise about the normal."""
    a, b, c = _PLANES[state.plane]
    start = state.at
    sense = -1.0 if state.move == 2 else 1.0
    if "R" in values:
        radius = values["R"] * state.unit
        centre = _centre_of(start[[a, b]], end[[a, b]], radius, sense, here)
    else:
        offset = np.array([values.get(letter, 0.0) * state.unit for letter in "IJK"])
        centre = (start + offset)[[a, b]]
    one = start[[a, b]] - centre
    two = end[[a, b]] - centre
    radius = float(np.linalg.norm(one))
    other = float(np.linalg.norm(two))
    require(
        radius >= 1e-9 and abs(radius - other) <= max(1e-5, 2e-3 * radius),
        here,
        "an arc whose ends are as far from its centre",
        f"{1e3 * radius:g} mm and {1e3 * other:g} mm",
    )
    begin = np.arctan2(one[1], one[0])
    turn = sense * float(
        np.mod(sense * (np.arctan2(two[1], two[0]) - begin), 2.0 * np.pi)
    )
    if abs(turn) < 1e-9:
        turn = sense * 2.0 * np.pi
    length = float(np.hypot(radius * turn, end[c] - start[c]))
    count = max(
        int(np.ceil(max(length / step - 1e-9, abs(turn) / np.deg2rad(10.0)))), 1
    )
    for k in range(1, count):
        point = start + (end - start) * k / count
        angle = begin + turn * k / count
        point[[a, b]] = centre + radius * np.array([np.cos(angle), np.sin(angle)])
        yield point
    yield end


def _centre_of(one: Array, two: Array, radius: float, sense: float, here: str) -> Array:
    """Return the centre (2,) of an arc from its radius; if negative, of the longer arc."""
    chord = two - one
    half = 0.5 * float(np.linalg.norm(chord))
    require(
        0.0 < half <= abs(radius) * (1.0 + 1e-6),
        f"{here}: R",
        f"a radius of at least half of the chord, {1e3 * half:g} mm",
        f"{1e3 * radius:g} mm",
    )
    rise = np.sqrt(max(radius**2 - half**2, 0.0)) * np.sign(radius) * sense
    return 0.5 * (one + two) + rise * np.array([-chord[1], chord[0]]) / (2.0 * half)


def program_text(program: Program, points: Array) -> str:
    """Return a program with other points as straight lines; lines without motion are kept.

    Parameters
    ----------
    program
        Program from `read_program`.
    points
        New points (n, 3), m, program axes.

    Returns
    -------
    str
        Program in mm with absolute coordinates; reading it gives these points.
    """
    by_line: dict[int, list[int]] = {}
    for k, line in enumerate(program.line.tolist()):
        by_line.setdefault(line, []).append(k)
    out = ["G21 G90"]
    feed = np.nan
    for number, text in enumerate(program.text):
        if number not in by_line:
            out.append(_MODES.sub("", text))
            continue
        words = _WORD.findall(_COMMENT.sub("", text).upper())
        other = " ".join(f"{a}{b}" for a, b in words if a in "MST")
        if other:
            out.append(other)
        for k in by_line[number]:
            place = zip("XYZ", 1e3 * points[k] + 0.0, strict=True)
            words = [f"{axis}{value:.12g}" for axis, value in place]
            if program.feed[k] != feed and np.isfinite(program.feed[k]):
                words.append(f"F{6e4 * program.feed[k]:.15g}")
            out.append(" ".join([f"G{0 if program.rapid[k] else 1}", *words]))
            feed = program.feed[k]
    return "\n".join(out) + "\n"
