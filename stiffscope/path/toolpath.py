"""Tool paths: commanded poses read from a table or a program, and written in the same format."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.errors import FieldError, require
from stiffscope.path.gcode import (
    MOST_POINTS,
    Program,
    program_text,
    read_program,
)
from stiffscope.robot.file import quantities as q
from stiffscope.robot.file.parse import naming_key
from stiffscope.robot.file.tables import one_of
from stiffscope.runtime.formats import TABLE_FORMATS
from stiffscope.runtime.table import (
    Table,
    check_columns,
    check_marks,
    numbers,
    read_table,
)
from stiffscope.vjm.model.mechanism import COORDINATES

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from stiffscope.robot.file.description import RobotFile
    from stiffscope.runtime.types import Array, Flags

WRENCH = ("fx", "fy", "fz", "mx", "my", "mz")
JOINT = "q:"
PROGRAMS = {".nc", ".ngc", ".gcode", ".tap", ".cnc", ".iso", ".mpf"}
MOST_LOAD = 1e6  # N, N·m
_MOST_ROW = 1000  # bytes
_FEED = q.Dimension("a speed", "m/s", "mm/min", most=1e3)
_TIME = q.Dimension("a time", "s", "s", most=1e9)


@dataclass(frozen=True, eq=False)
class ToolPath:
    """Commanded poses in order.

    Attributes
    ----------
    columns
        Coordinates of the robot's pose, or "q:JOINT" for each of its drives.
    values
        Commands (n, k), SI.
    feed, time
        Feed and time (n,), m/s and s, or None.
    wrench
        Wrench (n, 6) at M in base axes, N and N·m, or None.
    rapid
        Whether (n,) the process does not act.
    lines
        Line numbers (n,) in the file.
    """

    columns: tuple[str, ...]
    values: Array
    feed: Array | None
    time: Array | None
    wrench: Array | None
    rapid: Flags
    lines: Sequence[int]
    factors: Mapping[str, float]
    """Factor from each column's unit to SI."""
    program: Program | None = None
    place: tuple[Array, Array] | None = None
    """Origin (3,) and axes (3, 3) of the program in base axes."""
    free: Mapping[str, Array] = field(default_factory=dict)
    """Chosen free coordinates (n,), rad or m."""

    def __len__(self) -> int:
        return len(self.values)

    @property
    def by_joints(self) -> bool:
        """Whether drive positions are commanded instead of poses."""
        return bool(self.columns) and self.columns[0].startswith(JOINT)

    @property
    def acting(self) -> Flags:
        """Where (n,) the process acts; everywhere if it never does."""
        return ~self.rapid | self.rapid.all()

    def command(self, values: Array) -> ToolPath:
        """Return the path with other commands (n, k)."""
        return replace(self, values=values)

    def write(self, path: Path) -> None:
        """Write the commands in their original format with the same key columns and units."""
        if self.program is not None and self.place is not None:
            origin, axes = self.place
            points = self.program.points.copy()
            world = origin + points @ axes.T
            for k, name in enumerate(self.columns):
                if name in COORDINATES[:3]:
                    world[:, COORDINATES.index(name)] = self.values[:, k]
            path.write_text(
                program_text(self.program, (world - origin) @ axes), encoding="utf-8"
            )
            return
        pairs = zip(self.columns, self.values.T, strict=True)
        columns = {name: values / self.factors[name] for name, values in pairs}
        TABLE_FORMATS[".csv"](columns | dict(self.free), path, None)


def read_toolpath(
    path: Path,
    robot: RobotFile,
    units: Mapping[str, str],
    *,
    step: float,
    at: Sequence[float],
    axes: Array,
) -> ToolPath:
    """Read a path.

    Parameters
    ----------
    path
        Program, or table with a column for each coordinate of the robot's pose, or "q:JOINT" for
        each drive, and optional columns feed, t, fx … mz.
    robot
        Robot that follows the path.
    units
        Units by column; the default is SI.
    step
        Largest distance of points of a program, m.
    at, axes
        Origin (3,) and axes (3, 3) of a program in base axes.

    Raises
    ------
    InputError
        A column or number is invalid; the message names file, line and column.
    FieldError
        A unit is invalid.
    """
    if path.suffix.lower() in PROGRAMS:
        require(
            not units,
            ("units",),
            "none beside a program, which states its own (G20, G21)",
            "some",
        )
        return _of_program(path, robot, step, np.array(at, dtype=float), axes)
    pose = tuple(robot.tool.pose)

    def check(name: str, header: list[str]) -> None:
        joints = [column for column in header if column.startswith(JOINT)]
        place = joints or pose
        check_columns(
            name, header, place, dict.fromkeys((*place, *WRENCH, "feed", "t"))
        )
        require(
            len({"feed", "t"} & set(header)) < 2,
            f"{name}:1",
            "a column feed or a column t, from which the feed follows",
            "both",
        )

    table = _read_plain(path, check) or read_table(path, check, most=MOST_POINTS)
    check_marks(table, table.columns)
    columns = tuple(name for name in table.columns if name.startswith(JOINT)) or pose
    for column in sorted(units.keys() - {*columns, *WRENCH, "feed", "t"}):
        with naming_key("units", column):
            one_of(column, table.columns, f"a column of {path.name}")
    factors = {name: _factor(name, units.get(name), robot) for name in table.columns}
    found = {name: numbers(table, name) * factor for name, factor in factors.items()}
    values = np.column_stack([found[name] for name in columns])
    wrench = None
    if any(name in found for name in WRENCH):
        zero = np.zeros(len(values))
        wrench = np.column_stack([found.get(name, zero) for name in WRENCH])
        if (np.abs(wrench) > MOST_LOAD).any():
            row, k = np.argwhere(np.abs(wrench) > MOST_LOAD)[0].tolist()
            raise table.fail(row, WRENCH[k], f"at most {MOST_LOAD:g} N or N·m")
    feed = found.get("feed")
    time = found.get("t")
    if time is not None:
        late = np.concatenate([[False], np.diff(time) <= 0.0])
        table.refuse_where(late, "t", "a later time than the row above")
    if feed is not None:
        table.refuse_where(feed <= 0.0, "feed", "a speed above 0")
    rapid = np.zeros(len(values), dtype=bool)
    return ToolPath(
        columns=columns,
        values=values,
        feed=feed,
        time=time,
        wrench=wrench,
        rapid=rapid,
        lines=table.lines,
        factors=factors,
    )


def _read_plain(path: Path, check: Callable[[str, list[str]], None]) -> Table | None:
    """Read a CSV table with only finite numbers quickly; None for others, left to `read_table`."""
    import pyarrow as pa
    from pyarrow import csv

    text = path.suffix.lower() == ".csv" and path.is_file()
    if not text or path.stat().st_size > MOST_POINTS * _MOST_ROW:
        return None
    parsing = csv.ParseOptions(ignore_empty_lines=False)
    try:
        with csv.open_csv(path, parse_options=parsing) as opened:
            names = opened.schema.names
        kinds = csv.ConvertOptions(
            column_types=dict.fromkeys(names, pa.float64()), null_values=[]
        )
        table = csv.read_csv(path, parse_options=parsing, convert_options=kinds)
    except (pa.ArrowInvalid, OSError, UnicodeDecodeError):
        return None
    columns = {name: table[name].to_numpy() for name in dict.fromkeys(names)}
    plain = len(columns) == table.num_columns and all(
        name == name.strip() for name in names
    )
    finite = plain and all(np.isfinite(column).all() for column in columns.values())
    if not finite or not 0 < table.num_rows <= MOST_POINTS:
        return None
    check(path.name, names)
    return Table(path.name, columns, range(2, table.num_rows + 2))


def _factor(column: str, unit: str | None, robot: RobotFile) -> float:
    """Return the factor from a column's unit to SI. Raise FieldError of the job for an unknown unit."""
    if unit is None:
        return 1.0
    sizes = {
        "feed": _FEED,
        "t": _TIME,
        **dict.fromkeys(WRENCH[:3], q.FORCE),
        **dict.fromkeys(WRENCH[3:], q.MOMENT),
    }
    dimension = sizes.get(column) or robot.dimension_of(column)
    try:
        return q.to_si(f"1 {unit}", dimension)
    except ValueError as error:
        raise FieldError(
            ("units", column),
            f"expected a unit of {dimension.noun}, got {q.show_value(unit)}",
        ) from error


def _of_program(
    path: Path, robot: RobotFile, step: float, at: Array, axes: Array
) -> ToolPath:
    program = read_program(path, step)
    pose = tuple(robot.tool.pose)
    home = dict(zip(COORDINATES, (*robot.tool.at, 0.0, 0.0, 0.0), strict=True))
    world = at + program.points @ axes.T
    places = np.tile(list(home.values()), (len(world), 1))
    places[:, :3] = world
    values = places[:, [COORDINATES.index(name) for name in pose]]
    for k, name in enumerate(COORDINATES[:3]):
        moved = np.abs(world[:, k] - home[name]) > 1e-9
        row = int(np.argmax(moved))
        require(
            name in pose or not moved.any(),
            f"{path.name}:{program.line[row] + 1}",
            f"points that the robot reaches, whose {name} is {1e3 * home[name]:g} mm",
            f"{1e3 * world[row, k]:g} mm (at, x and y place the program)",
        )
    feed = program.feed if np.isfinite(program.feed[~program.rapid]).any() else None
    lines = (program.line + 1).tolist()
    factors = {str(name): 1.0 for name in pose}
    return ToolPath(
        columns=pose,
        values=values,
        feed=feed,
        time=None,
        wrench=None,
        rapid=program.rapid,
        lines=lines,
        factors=factors,
        program=program,
        place=(at, axes),
    )
