"""Campaign folders read: tables as arrays, checked cell by cell."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.errors import InputError
from stiffscope.gap.campaign.campaign import AT_TOOL, Campaign
from stiffscope.gap.campaign.campaign_header import load_header
from stiffscope.gap.campaign.quantities import (
    AXES,
    DEFLECTION,
    DEVIATION,
    FREQUENCY,
    JOINT,
    KINDS,
    MOST_MODES,
    PUSH,
    QUANTITIES,
    STIFFNESS,
    WRENCH,
)
from stiffscope.gap.campaign.table import Table, check_columns, numbers, read_table
from stiffscope.robot.file.quantities import FORCE, LENGTH, MOMENT, NUMBER, Dimension, shown, to_si
from stiffscope.runtime.reading import open_file
from stiffscope.runtime.reading import shown as shown_path

if TYPE_CHECKING:
    from collections.abc import Collection
    from pathlib import Path

    from numpy.typing import NDArray

    from stiffscope.gap.campaign.campaign_header import Header
    from stiffscope.robot.file.description import RobotFile

    Array = NDArray[np.float64]
    Codes = NDArray[np.int64]

log = logging.getLogger(__name__)

# Limits of what robots show; `least` is that of a standard uncertainty: no instrument is finer.
_LENGTH, _ANGLE = Dimension("a displacement", "m", "um", 1e-14, 10.0), Dimension("a rotation", "rad", "urad", 1e-14, 10)
_STIFF = Dimension("a stiffness", "N/m", "N/um", 1e-6, 1e18)
_TURNED = Dimension("a rotational stiffness", "N*m/rad", "N*m/mrad", 1e-6, 1e18)
_OFTEN = Dimension("a frequency", "Hz", "Hz", 1e-9, 1e12)
_MEASURED = {  # by kind, of a translation and of a rotation
    DEFLECTION: (_LENGTH, _ANGLE),
    DEVIATION: (_LENGTH, _ANGLE),
    STIFFNESS: (_STIFF, _TURNED),
    PUSH: (_STIFF, _TURNED),
    FREQUENCY: (_OFTEN, _OFTEN),
}
_PLACE, _TURN = Dimension("a length", "m", "mm", most=LENGTH.most), Dimension("an angle", "rad", "deg", most=1e4)
_WRENCH = Dimension("a force", "N", "N", most=FORCE.most), Dimension("a moment", "N*m", "N*mm", most=MOMENT.most)
MOST_POSES = 2_000  # a diagnosis evaluates the robot anew at each: 0.02 s and 0.1 MB
_SHOWN_QUANTITIES = (*QUANTITIES[: QUANTITIES.index("f1")], "f1", "...", f"f{MOST_MODES}")


def load_campaign(folder: Path, robot: RobotFile | None = None, *, planned: bool = False) -> Campaign:
    """Return the campaign in a folder.

    Parameters
    ----------
    folder
        A folder with a campaign.toml and its tables.
    robot
        The robot that the campaign is of: poses by name are looked up, and poses, sensors and loads are checked
        against it, as `on_robot` does.
    planned
        Whether values may be missing, NaN: a plan of readings that are not all taken yet.

    Raises
    ------
    InputError
        Names the file, the line, the column and what was expected.

    """
    header = load_header(folder)
    bare = header.predictions is not None
    _check_files(folder, header)
    parts = [_load_readings(folder / name, header, bare=bare, planned=planned) for name in header.readings]
    if len({part.coordinates for part in parts}) > 1:
        first, other = (" ".join(p.coordinates) for p in (parts[0], next(_others(parts))))
        message = f"expected all files with the same columns of the pose, got {first} and {other}"
        raise header.source.refuse(("readings",), message)
    names, pose, poses = _number_poses(parts)
    labels = [label for part in parts for label in part.sessions]
    sessions = {label: i for i, label in enumerate(dict.fromkeys(labels))}
    predictions: dict[str, Array] = {}
    if header.predictions is not None:
        predictions = _load_predictions(folder / header.predictions, header, parts)
    campaign = Campaign(
        robot=header.robot,
        modelled=header.modelled,
        components=header.components,
        pose_names=names,
        poses=np.array(poses),
        pose=np.array(pose),
        wrench=np.concatenate([part.wrench for part in parts]),
        quantity=np.concatenate([part.quantity for part in parts]),
        value=np.concatenate([part.value for part in parts]),
        sigma=np.concatenate([part.sigma for part in parts]),
        session_names=tuple(sessions),
        session=np.array([sessions[label] for label in labels]),
        files=header.readings,
        file=np.repeat(np.arange(len(parts)), [len(part.value) for part in parts]),
        line=np.array([line for part in parts for line in part.table.lines]),
        predictions=predictions,
        coordinates=AXES[:3] if parts[0].labelled else parts[0].coordinates,
        sensors=header.sensors,
        sensor=np.concatenate([part.sensor for part in parts]),
        loads=header.loads,
        load=np.concatenate([part.load for part in parts]),
        source=header.source,
    )
    _check_some(campaign)
    return campaign if robot is None else on_robot(campaign, robot)


def _check_files(folder: Path, header: Header) -> None:
    """Refuse a table that is no file, by the key that names it."""
    named = [("readings", name) for name in header.readings]
    named += [("predictions", header.predictions)] if header.predictions is not None else []
    for key, name in named:
        try:
            open_file(folder / name, "a table (.csv, .tsv, .xlsx)").close()
        except InputError as error:
            message = str(error).removeprefix(f"{shown_path(folder / name)}: ")
            raise header.source.refuse((key,), f"{message} ({shown_path(name)})") from error


def _check_some(c: Campaign) -> None:
    """Refuse readings that are all zero: a gap in percent of them is none."""
    none = (np.abs(c.value) < _LENGTH.least) & ~c.relative
    if len(c) and none.all():
        raise InputError(f"{c.where(0)}: value: expected readings other than zero, got none in {len(c):,} rows")


def _others(parts: list[_Rows]) -> Any:
    return (part for part in parts if part.coordinates != parts[0].coordinates)


def on_robot(campaign: Campaign, robot: RobotFile) -> Campaign:
    """The campaign with poses by name looked up in the robot's file, all of it checked against the robot.

    Raises
    ------
    InputError
        Too many poses, poses that are none of the robot's, columns that are not its coordinates, sensors and loads on
        no body of it.

    """
    _check_bodies(campaign, robot)
    if len(campaign.poses) > MOST_POSES:
        row = int(np.argmax(campaign.pose >= MOST_POSES))
        raise InputError(
            f"{campaign.where(row)}: {campaign.coordinates[0]}: expected at most {MOST_POSES:,} different poses, "
            "got more; leave some out, a few dozen tell as much"
        )
    wanted = robot.tool.pose
    if not np.isnan(campaign.poses).any():
        joints = tuple(f"{JOINT}{name}" for name in robot.drives())
        if set(campaign.coordinates) == set(wanted):
            return _reordered(campaign, wanted)
        if joints and set(campaign.coordinates) == set(joints):
            return _reordered(campaign, joints)
        strange = [name for name in campaign.coordinates if name not in {*wanted, *joints}]
        lacking = joints if campaign.coordinates[0].startswith(JOINT) else wanted
        lacking = [*strange, *(name for name in lacking if name not in campaign.coordinates)]
        valid = f"{' '.join(wanted)}, or {' '.join(joints)}"
        raise InputError(
            f"{campaign.files[0]}:1: {lacking[0]}: expected the coordinates that command {robot.name}: {valid}, "
            f"got {' '.join(campaign.coordinates)}"
        )
    unknown = [k for k, name in enumerate(campaign.pose_names) if name not in robot.poses]
    if unknown:
        row = int(np.flatnonzero(campaign.pose == unknown[0])[0])
        known = ", ".join(robot.poses) or "(none)"
        name = campaign.pose_names[unknown[0]]
        raise InputError(f"{campaign.where(row)}: pose: expected one of {robot.name}'s [poses] {known}, got {name!r}")
    poses = np.array([robot.poses[name] for name in campaign.pose_names])
    return replace(campaign, poses=poses, coordinates=tuple(wanted))


def _reordered(campaign: Campaign, wanted: tuple[str, ...]) -> Campaign:
    if campaign.coordinates == tuple(wanted):
        return campaign
    order = [campaign.coordinates.index(name) for name in wanted]
    return replace(campaign, poses=campaign.poses[:, order], coordinates=tuple(wanted))


def _check_bodies(campaign: Campaign, robot: RobotFile) -> None:
    from stiffscope.robot.file.description import GROUND, nodes

    known = nodes(robot.bodies)

    def check(name: str, *key: str, moves: bool) -> None:
        if name not in known or (moves and name == GROUND):
            valid = ", ".join(node for node in known if not (moves and node == GROUND))
            raise campaign.refuse(key, f"expected a body or an end of one ({valid}), got {shown(name)}")

    for sensor in campaign.sensors:
        check(sensor.body, "sensors", sensor.name, "body", moves=False)
        check(sensor.against, "sensors", sensor.name, "against", moves=False)
        if known[sensor.body] == known[sensor.against] and sensor.body == sensor.against:
            key = "sensors", sensor.name, "against"
            raise campaign.refuse(key, f"expected another body than {sensor.body}, got the same")
    for load in campaign.loads:
        check(load.body, "loads", load.name, "body", moves=True)


@dataclass(frozen=True)
class _Rows:
    """The key columns and values of one file."""

    table: Table
    coordinates: tuple[str, ...]
    """Columns of the pose: "pose" where it is a label."""
    place: tuple[tuple[Any, ...], ...]
    wrench: Array
    quantity: Codes
    sensor: Codes
    load: Codes
    sessions: tuple[str, ...]
    value: Array
    sigma: Array

    @property
    def labelled(self) -> bool:
        return self.coordinates == ("pose",)


_CODE = {name: code for code, name in enumerate(QUANTITIES)}


def _column(table: Table, name: str) -> tuple[str, ...]:
    return table.columns.get(name) or ("",) * len(table.lines)


def _codes(cells: tuple[str, ...], known: dict[str, int], table: Table, column: str, expected: str) -> Codes:
    """Codes (n,) of names; `AT_TOOL` for empty cells. Raises InputError for a name that is not known."""
    known = {"": AT_TOOL, **known}
    try:
        return np.array([known[cell] for cell in cells], dtype=np.int64)
    except KeyError:
        row = next(i for i, cell in enumerate(cells) if cell not in known)
        raise table.fail(row, column, expected) from None


def _measured(table: Table, header: Header, applied: Array) -> tuple[Codes, Codes]:
    """Quantity and sensor (n,) of every row; ``applied`` (n, 6): its wrench, NaN in empty cells."""
    names = [sensor.name for sensor in header.sensors]
    shown = f"one of {' '.join(_SHOWN_QUANTITIES)}"
    quantity = _codes(_column(table, "quantity"), _CODE, table, "quantity", shown)
    listed = f"one of campaign.toml's [sensors] {' '.join(names) or '(none)'}"
    sensor = _codes(_column(table, "sensor"), {n: k for k, n in enumerate(names)}, table, "sensor", listed)
    both = (quantity >= 0) & (sensor >= 0)
    if both.any():
        raise table.fail(int(np.argmax(both)), "sensor", "an empty cell beside a quantity: one of the two a row")
    none = (quantity < 0) & (sensor < 0)
    if none.any():
        row = int(np.argmax(none))
        raise table.fail(row, "quantity" if "quantity" in table.columns else "sensor", shown if not names else listed)
    kinds = {name: k for k, name in enumerate(KINDS[:2])}
    kind = _codes(_column(table, "kind"), kinds, table, "kind", "deflection or deviation")
    wrong = (kind >= 0) & (quantity >= 0) & (kind != quantity // 6)
    if wrong.any():
        raise table.fail(int(np.argmax(wrong)), "kind", "an empty cell beside a quantity, which says its kind")
    loaded = (np.nan_to_num(applied) != 0.0).any(axis=1)
    kind = np.where(kind >= 0, kind, np.where(loaded, DEFLECTION, DEVIATION))
    axis = np.array([s.axis for s in header.sensors] or [0])[np.maximum(sensor, 0)]
    return np.where(sensor >= 0, 6 * kind + axis, quantity), sensor


def _place(table: Table, coordinates: tuple[str, ...], header: Header) -> tuple[tuple[Any, ...], ...]:
    if coordinates == ("pose",):
        cells = table.columns["pose"]
        if "" in cells:
            raise table.fail(cells.index(""), "pose", "the label of a pose")
        return tuple((cell,) for cell in cells)
    columns: list[list[float]] = []
    for name in coordinates:
        unit = "metres" if name in AXES[:3] else "radians" if name in AXES else "metres or radians"
        values = numbers(table, name, expected=f"a finite number of {unit}")
        values = values * _factor(header, name, _of_pose(name))
        _check_most(table, name, values, _of_pose(name)[0])
        columns.append(np.round(values, 12).tolist())
    return tuple(zip(*columns, strict=True))


def _of_pose(name: str) -> tuple[Dimension, ...]:
    return (_PLACE,) if name in AXES[:3] else (_TURN,) if name in AXES else (_PLACE, _TURN)


def _factor(header: Header, column: str, dimensions: tuple[Dimension, ...]) -> float:
    """What one of a column's unit is in SI. Raises InputError for a unit that measures none of ``dimensions``."""
    unit = header.units.get(column)
    if unit is None:
        return 1.0
    for dimension in dimensions:
        try:
            return to_si(f"1 {unit}", dimension)
        except ValueError:
            continue
    expected = " or ".join(f'{d.noun} such as "{d.example}"' for d in dimensions)
    raise header.source.refuse(("units", column), f"expected a unit of {expected}, got {shown(unit)}")


def _applied(table: Table, header: Header) -> Array:
    """Wrenches (n, 6) as the cells have them; NaN in empty cells, zero in columns that are not there."""
    out = np.zeros((len(table.lines), 6))
    given = [name in table.columns for name in WRENCH]
    for k, name in enumerate(WRENCH):
        if given[k]:
            column = numbers(table, name, empty=True, expected="a finite number or an empty cell")
            out[:, k] = column * _factor(header, name, _WRENCH[k // 3 : k // 3 + 1])
            _check_most(table, name, out[:, k], _WRENCH[k // 3])
    empty = np.isnan(out[:, given]).all(axis=1) if any(given) else np.ones(len(out), dtype=np.bool_)
    out[empty] = np.nan
    return out


def _wrench(table: Table, applied: Array, quantity: Codes, sensor: Codes, load: Codes) -> Array:
    """Return the wrenches (n, 6): given for deflections, NaN for stiffness and frequency, zero for deviations."""
    kind = np.minimum(quantity // 6, FREQUENCY)
    nothing = (np.nan_to_num(applied) == 0.0).all(axis=1)
    if not any(name in table.columns for name in WRENCH) and ((kind == DEFLECTION) & (sensor < 0)).any():
        row = int(np.argmax((kind == DEFLECTION) & (sensor < 0)))
        raise table.fail(row, "fx", "a wrench for a deflection (columns fx fy fz mx my mz)")
    lacking = (kind == DEFLECTION) & (sensor < 0) & nothing
    for k, name in enumerate(WRENCH):
        wrong = lacking & np.isnan(applied[:, k])
        if wrong.any() and name in table.columns:
            raise table.fail(int(np.argmax(wrong)), name, "a finite number: a deflection needs its wrench")
        given = ~np.isnan(applied[:, k]) & (name in table.columns)
        wrong = (kind >= STIFFNESS) & given
        if wrong.any():
            which = str(KINDS[int(kind[int(np.argmax(wrong))])]).replace("push", "stiffness")
            raise table.fail(int(np.argmax(wrong)), name, f"an empty cell: a {which} reading has no wrench")
        wrong = (kind == DEVIATION) & given & (applied[:, k] != 0)
        if wrong.any():
            raise table.fail(int(np.argmax(wrong)), name, "0: a deviation is read on the unloaded platform")
    wrong = (load >= 0) & (kind != DEFLECTION) & ~((kind == DEVIATION) & nothing)
    if wrong.any():
        raise table.fail(int(np.argmax(wrong)), "load", "an empty cell: only a deflection has a load")
    out = np.nan_to_num(applied)
    out[kind >= STIFFNESS] = np.nan
    return out


def _keys_of(header: Collection[str], *, bare: bool) -> tuple[str, ...]:
    """Return the columns of the pose that a header has, or those of a position where it has none."""
    places = [name for name in header if name in AXES or name.startswith(JOINT)]
    if "pose" in header and (bare or not places):
        return ("pose",)
    return tuple(sorted(places, key=lambda n: AXES.index(n) if n in AXES else len(AXES))) or AXES[:3]


_OPTIONAL = ("session", "sensor", "quantity", "load", "kind")


def _check(name: str, header: list[str], *, bare: bool, others: Collection[str]) -> None:
    place = _keys_of(header, bare=bare)
    measured = () if "sensor" in header else ("quantity",)
    required = [*place, *measured, *(c for c in others if c not in _OPTIONAL)]
    valid = [*place, *WRENCH, *_OPTIONAL, *others] if "sigma" in others else header
    check_columns(name, header, required, dict.fromkeys(valid))


def _in_si(
    table: Table, header: Header, column: str, values: Array, quantity: Codes, sensor: Codes, *, named: str = ""
) -> Array:
    """Values (n,) of a column in SI; NaN stays. `named`: whose unit they have, if not the column's own.

    Raises InputError for a row that measures something else, or more or finer than anything can.
    """
    named = named or column
    unit = header.units.get(named)
    out = np.array(values)
    kind = np.minimum(quantity // 6, FREQUENCY)
    turns = quantity % 6 // 3
    for key in {(int(k), int(t)) for k, t in zip(kind, turns, strict=True)}:
        mine = (kind == key[0]) & (turns == key[1])
        dimension = _MEASURED[key[0]][key[1]]
        try:
            with np.errstate(over="ignore"):  # what overflows is refused below
                out[mine] *= to_si(f"1 {unit}", dimension) if unit else 1.0
        except ValueError:
            _check_unit(header, str(unit), named)
            row = int(np.argmax(mine))
            measured = "sensor" if sensor[row] >= 0 else "quantity"
            message = f"a reading that is measured in {unit}, as campaign.toml says of {named}, not {dimension.noun}"
            raise table.fail(row, measured, message) from None
        _check_most(table, column, np.where(mine, out, 0.0), dimension)
        fine = mine & (out < dimension.least) & (out > 0.0)
        if column == "sigma" and fine.any():
            raise table.fail(
                int(np.argmax(fine)), column, f"an uncertainty of at least {dimension.least:g} {dimension.unit}"
            )
    return out


def _check_most(table: Table, column: str, values: Array, dimension: Dimension) -> None:
    """Refuse values (n,), SI, that no robot has."""
    beyond = np.abs(values) > dimension.most
    if beyond.any():
        limit = f"{dimension.noun} of at most {dimension.most:g} {dimension.unit}"
        unit = f' (another unit than SI is named in campaign.toml: units = {{ {column} = "{dimension.example}" }})'
        raise table.fail(int(np.argmax(beyond)), column, limit + unit)


def _check_unit(header: Header, unit: str, column: str) -> None:
    known = [d for pair in _MEASURED.values() for d in pair]
    for dimension in (*known, NUMBER):
        try:
            to_si(f"1 {unit}", dimension)
        except ValueError:
            continue
        return
    raise header.source.refuse(("units", column), f'expected a unit such as "um", "urad" or "N/um", got {shown(unit)}')


def _check_units(header: Header, table: Table) -> None:
    known = {*AXES, *WRENCH, "value", "sigma"}
    for column in header.units:
        if column not in known and not column.startswith(JOINT):
            valid = ", ".join((*AXES, *WRENCH, "value", "sigma", "q:JOINT"))
            raise header.source.refuse(("units", column), f"expected a column among {valid}")
        if column not in table.columns and column in {"value", "sigma"}:
            raise InputError(f"{table.name}:1: {column}: expected this column, got none")


def _load_readings(path: Path, header: Header, *, bare: bool, planned: bool) -> _Rows:
    check = partial(_check, bare=bare, others=("value", "sigma", "session"))
    table = read_table(path, check, header.ignore)
    _check_units(header, table)
    coordinates = _keys_of(table.columns, bare=bare)
    applied = _applied(table, header)
    quantity, sensor = _measured(table, header, applied)
    value = numbers(table, "value", empty=planned, expected="a finite reading in SI")
    value = _in_si(table, header, "value", value, quantity, sensor)
    soft = (quantity // 6 >= STIFFNESS) & (value <= 0)
    if soft.any():
        row = int(np.argmax(soft))
        what = "frequency" if quantity[row] // 6 >= FREQUENCY else "stiffness"
        raise table.fail(row, "value", f"a positive {what}")
    sigma = numbers(table, "sigma", empty=True, expected="a positive number, or an empty cell if unknown")
    wrong = sigma <= 0
    if wrong.any():
        raise table.fail(int(np.argmax(wrong)), "sigma", "a positive number, or an empty cell if unknown")
    sigma = _in_si(table, header, "sigma", sigma, quantity, sensor)
    sessions = table.columns.get("session", ("",) * len(value))
    load = _load(table, header)
    wrench = _wrench(table, applied, quantity, sensor, load)
    place = _place(table, coordinates, header)
    return _Rows(table, coordinates, place, wrench, quantity, sensor, load, sessions, value, sigma)


def _load(table: Table, header: Header) -> Codes:
    names = [load.name for load in header.loads]
    listed = f"one of campaign.toml's [loads] {' '.join(names) or '(none)'}, or an empty cell for M"
    return _codes(_column(table, "load"), {n: k for k, n in enumerate(names)}, table, "load", listed)


def _number_poses(parts: list[_Rows]) -> tuple[tuple[str, ...], list[int], list[list[float]]]:
    places = [place for part in parts for place in part.place]
    index = {place: i for i, place in enumerate(dict.fromkeys(places))}
    pose = [index[place] for place in places]
    if parts[0].labelled:
        return tuple(str(place[0]) for place in index), pose, [[np.nan] * 3 for _ in index]
    names = tuple(f"({', '.join(f'{value:g}' for value in place)})" for place in index)
    return names, pose, [list(place) for place in index]


def _keys(rows: _Rows, *, sessions: bool) -> list[tuple[Any, ...]]:
    wrench = [tuple(w) for w in np.nan_to_num(np.round(rows.wrench, 9)).tolist()]
    labels = rows.sessions if sessions else ("",) * len(wrench)
    codes = (rows.quantity.tolist(), rows.sensor.tolist(), rows.load.tolist())
    return list(zip(rows.place, wrench, *codes, labels, strict=True))


def _load_predictions(path: Path, header: Header, parts: list[_Rows]) -> dict[str, Array]:
    table = read_table(path, partial(_check, bare=True, others=("value",)), header.ignore)
    coordinates = _keys_of(table.columns, bare=True)
    if coordinates != parts[0].coordinates:
        raise InputError(f"{table.name}:1: expected the readings' own key columns ({' '.join(parts[0].coordinates)})")
    if "sigma" in table.columns:
        raise InputError(f"{table.name}:1: sigma: expected predictions, which have no sigma")
    models = [name for name in table.columns if name not in {*coordinates, *WRENCH, *_OPTIONAL, *AXES}]
    applied = _applied(table, header)
    quantity, sensor = _measured(table, header, applied)
    found = {name: numbers(table, name, expected="a finite predicted value in SI") for name in models}
    values = [_in_si(table, header, name, v, quantity, sensor, named="value") for name, v in found.items()]
    stacked = np.stack(values, axis=1)
    sessions = table.columns.get("session", ("",) * len(quantity))
    load = _load(table, header)
    place, wrench = _place(table, coordinates, header), _wrench(table, applied, quantity, sensor, load)
    rows = _Rows(table, coordinates, place, wrench, quantity, sensor, load, sessions, stacked, stacked[:, 0])
    by_session = "session" in table.columns
    row_of: dict[tuple[Any, ...], int] = {}
    for row, key in enumerate(_keys(rows, sessions=by_session)):
        first = row_of.setdefault(key, row)
        if np.any(stacked[first] != stacked[row]):
            raise table.fail(row, "value", f"the prediction already given on line {table.lines[first]}")
    picked: list[int] = []
    for part in parts:
        for row, key in enumerate(_keys(part, sessions=by_session)):
            if key not in row_of:
                message = f"a reading that {table.name} predicts"
                raise part.table.fail(row, part.coordinates[0], message)
            picked.append(row_of[key])
    idle = len(row_of) - len(set(picked))
    if idle:
        log.warning("%s: %d predictions have no reading", table.name, idle)
    return {name: stacked[picked, k] for k, name in enumerate(models)}
