"""Campaigns: measured data as arrays, checked cell by cell."""

from __future__ import annotations

import logging
import tomllib
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from gap.table import Table, check_columns, numbers, read_table
from gap.vocabulary import COMPONENTS, DEFLECTION, QUANTITIES, STIFFNESS, VOCABULARY, WRENCH
from stiffscope import InputError

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    Codes = NDArray[np.int64]

log = logging.getLogger(__name__)

POSITION = ("x", "y", "z")
_KEYS = ("robot", "modelled", "components", "readings", "predictions")


def _no_models() -> dict[str, Array]:
    return {}


@dataclass(frozen=True)
class Campaign:
    """What a lab hands over; n readings at p poses, SI, axes of {O}. All arrays are read-only."""

    robot: str | None
    """A robot the project knows, or a robot file's path as written; None with predictions."""
    modelled: tuple[str, ...]
    components: str
    pose_names: tuple[str, ...]
    poses: Array
    """(p, 3) commanded tool points; NaN where poses are labels."""
    pose: Codes
    """(n,) which pose."""
    wrench: Array
    """(n, 6) stated wrench at M; NaN for stiffness readings, zero for deviations."""
    quantity: Codes
    """(n,) position in `QUANTITIES`."""
    value: Array
    sigma: Array
    """(n,) standard uncertainty; NaN: unknown."""
    session_names: tuple[str, ...]
    session: Codes
    """(n,) which session."""
    files: tuple[str, ...]
    file: Codes
    """(n,) which file a reading came from."""
    line: Codes
    """(n,) on which line it stands."""
    predictions: dict[str, Array] = field(default_factory=_no_models)
    """Predicted values (n,): the model under test under `value`, its rivals under their columns' names."""

    def __len__(self) -> int:
        """Return the number of readings."""
        return len(self.value)

    @property
    def kind(self) -> Codes:
        """(n,) 0 deflection, 1 deviation, 2 stiffness."""
        return self.quantity // 6

    @property
    def direction(self) -> Codes:
        """(n,) 0 to 5: x y z rx ry rz."""
        return self.quantity % 6

    def where(self, reading: int) -> str:
        """Return the file and line of one reading."""
        return f"{self.files[self.file[reading]]}, line {self.line[reading]}"


def _frozen(values: Any, kind: type[np.float64] | type[np.int64]) -> Any:
    array = np.array(values, dtype=kind)
    array.setflags(write=False)
    return array


@dataclass(frozen=True)
class _Header:
    robot: str | None
    modelled: tuple[str, ...]
    components: str
    readings: tuple[str, ...]
    predictions: str | None


def load_campaign(folder: Path) -> Campaign:
    """Return the campaign in a folder.

    Raises InputError that names the file, the line, the column and what was expected.
    """
    header = _load_header(folder)
    bare = header.predictions is not None
    parts = [_load_readings(folder / name, bare=bare) for name in header.readings]
    if len({part.labelled for part in parts}) > 1:
        raise InputError("campaign.toml, readings: expected all files with x y z, or all with pose")
    names, pose, poses = _number_poses(parts)
    labels = [label for part in parts for label in part.sessions]
    sessions = {label: i for i, label in enumerate(dict.fromkeys(labels))}
    columns = {
        "wrench": np.concatenate([part.wrench for part in parts]),
        "value": np.concatenate([part.value for part in parts]),
        "sigma": np.concatenate([part.sigma for part in parts]),
    }
    quantity = np.concatenate([part.quantity for part in parts])
    predictions: dict[str, Array] = {}
    if header.predictions is not None:
        predictions = _load_predictions(folder / header.predictions, parts)
    return Campaign(
        robot=header.robot,
        modelled=header.modelled,
        components=header.components,
        pose_names=names,
        poses=_frozen(poses, np.float64),
        pose=_frozen(pose, np.int64),
        quantity=_frozen(quantity, np.int64),
        session_names=tuple(sessions),
        session=_frozen([sessions[label] for label in labels], np.int64),
        files=header.readings,
        file=_frozen([i for i, part in enumerate(parts) for _ in part.value], np.int64),
        line=_frozen([line for part in parts for line in part.table.lines], np.int64),
        predictions={name: _frozen(values, np.float64) for name, values in predictions.items()},
        **{name: _frozen(values, np.float64) for name, values in columns.items()},
    )


def _load_header(folder: Path) -> _Header:
    path = folder / "campaign.toml"
    if not folder.is_dir():
        raise InputError(f"{folder}: expected a campaign folder with a campaign.toml")
    try:
        data = tomllib.loads(path.read_bytes().decode("utf-8-sig"))
    except OSError:
        raise InputError(f"{folder}: expected a campaign.toml in this folder") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"campaign.toml: expected TOML, found {error}") from None
    unknown = [key for key in data if key not in _KEYS]
    if unknown:
        raise InputError(f"campaign.toml, {unknown[0]}: expected one of {', '.join(_KEYS)}")
    robot, predictions = _text(data, "robot"), _text(data, "predictions")
    if (robot is None) == (predictions is None):
        raise InputError("campaign.toml: expected either robot or predictions, one of the two")
    components = _text(data, "components") or "fea"
    if components not in COMPONENTS:
        raise InputError(f"campaign.toml, components: expected one of {', '.join(COMPONENTS)}, found {components!r}")
    modelled = _texts(data.get("modelled", []), "modelled")
    strange = [name for name in modelled if name not in VOCABULARY]
    if strange:
        valid = ", ".join(VOCABULARY)
        raise InputError(f"campaign.toml, modelled: expected effects among {valid}, found {strange[0]!r}")
    listed = data.get("readings")
    readings = _texts([listed] if isinstance(listed, str) else listed, "readings")
    if not readings or len(set(readings)) < len(readings):
        raise InputError("campaign.toml, readings: expected one file name or a list of different ones")
    return _Header(robot, modelled, components, readings, predictions)


def _text(data: dict[str, Any], key: str) -> str | None:
    value = data.get(key)
    if key in data and (not isinstance(value, str) or not value.strip()):
        raise InputError(f"campaign.toml, {key}: expected a text, found {value!r}")
    return value


def _texts(value: Any, key: str) -> tuple[str, ...]:
    if not isinstance(value, list) or not all(isinstance(v, str) and v for v in cast("list[Any]", value)):
        raise InputError(f"campaign.toml, {key}: expected a list of texts, found {value!r}")
    return tuple(cast("list[str]", value))


@dataclass(frozen=True)
class _Rows:
    """The key columns and values of one file."""

    table: Table
    labelled: bool
    place: tuple[tuple[Any, ...], ...]
    wrench: Array
    quantity: Codes
    sessions: tuple[str, ...]
    value: Array
    sigma: Array


_CODE = {name: code for code, name in enumerate(QUANTITIES)}


def _quantity(table: Table) -> Codes:
    cells = table.columns["quantity"]
    try:
        return np.array([_CODE[cell] for cell in cells], dtype=np.int64)
    except KeyError:
        row = next(i for i, cell in enumerate(cells) if cell not in _CODE)
        raise table.fail(row, "quantity", f"one of {' '.join(QUANTITIES)}") from None


def _place(table: Table, *, labelled: bool) -> tuple[tuple[Any, ...], ...]:
    if labelled:
        cells = table.columns["pose"]
        if "" in cells:
            raise table.fail(cells.index(""), "pose", "the label of a pose")
        return tuple((cell,) for cell in cells)
    columns = [np.round(numbers(table, name, expected="a finite number of metres"), 12) for name in POSITION]
    return tuple(zip(*(column.tolist() for column in columns), strict=True))


def _wrench(table: Table, quantity: Codes) -> Array:
    """Return the wrenches (n, 6): given for deflections, empty for stiffness, zero or empty for deviations."""
    kind = quantity // 6
    out = np.full((len(quantity), 6), np.nan)
    if not any(name in table.columns for name in WRENCH):
        if (kind == DEFLECTION).any():
            row = int(np.argmax(kind == DEFLECTION))
            raise table.fail(row, "fx", "a wrench for a deflection (columns fx fy fz mx my mz)")
    else:
        for k, name in enumerate(WRENCH):
            column = numbers(table, name, empty=True, expected="a finite number or, for stiffness, an empty cell")
            given = ~np.isnan(column)
            wrong = (kind == DEFLECTION) & ~given
            if wrong.any():
                raise table.fail(int(np.argmax(wrong)), name, "a finite number: a deflection needs its wrench")
            wrong = (kind == STIFFNESS) & given
            if wrong.any():
                raise table.fail(int(np.argmax(wrong)), name, "an empty cell: a stiffness reading has no wrench")
            wrong = (kind == STIFFNESS - 1) & given & (column != 0)
            if wrong.any():
                raise table.fail(int(np.argmax(wrong)), name, "0: a deviation is read on the unloaded platform")
            out[:, k] = column
    out[kind == STIFFNESS - 1] = 0.0
    return out


def _columns(table: Table, *, bare: bool) -> tuple[bool, list[str]]:
    """Return whether poses are labels, and the key columns."""
    labelled = bare and "pose" in table.columns
    place = ["pose"] if labelled else list(POSITION)
    return labelled, [*place, *WRENCH, "quantity"]


def _check_wrench_columns(table: Table) -> None:
    missing = [name for name in WRENCH if name not in table.columns]
    if 0 < len(missing) < len(WRENCH):
        raise InputError(f"{table.name}, line 1, column {missing[0]}: expected this column, it is missing")


def _load_readings(path: Path, *, bare: bool) -> _Rows:
    table = read_table(path)
    labelled, keys = _columns(table, bare=bare)
    required = [key for key in keys if key not in WRENCH]
    check_columns(table, [*required, "value", "sigma"], [*keys, "value", "sigma", "session"])
    _check_wrench_columns(table)
    quantity = _quantity(table)
    value = numbers(table, "value", expected="a finite reading in SI")
    soft = (quantity // 6 == STIFFNESS) & (value <= 0)
    if soft.any():
        raise table.fail(int(np.argmax(soft)), "value", "a positive stiffness")
    sigma = numbers(table, "sigma", empty=True, expected="a positive number, or an empty cell if unknown")
    wrong = sigma <= 0
    if wrong.any():
        raise table.fail(int(np.argmax(wrong)), "sigma", "a positive number, or an empty cell if unknown")
    sessions = table.columns.get("session", ("",) * len(value))
    place, wrench = _place(table, labelled=labelled), _wrench(table, quantity)
    return _Rows(table, labelled, place, wrench, quantity, sessions, value, sigma)


def _number_poses(parts: list[_Rows]) -> tuple[tuple[str, ...], list[int], list[list[float]]]:
    places = [place for part in parts for place in part.place]
    index = {place: i for i, place in enumerate(dict.fromkeys(places))}
    pose = [index[place] for place in places]
    if parts[0].labelled:
        return tuple(str(place[0]) for place in index), pose, [[np.nan] * 3 for _ in index]
    names = tuple(f"({x:g}, {y:g}, {z:g})" for x, y, z in index)
    return names, pose, [list(place) for place in index]


def _keys(rows: _Rows, *, sessions: bool) -> list[tuple[Any, ...]]:
    wrench = [tuple(w) for w in np.nan_to_num(np.round(rows.wrench, 9)).tolist()]
    labels = rows.sessions if sessions else ("",) * len(wrench)
    return list(zip(rows.place, wrench, rows.quantity.tolist(), labels, strict=True))


def _load_predictions(path: Path, parts: list[_Rows]) -> dict[str, Array]:
    table = read_table(path)
    labelled, keys = _columns(table, bare=True)
    if labelled != parts[0].labelled:
        wanted = "pose" if parts[0].labelled else "x y z"
        raise InputError(f"{table.name}, line 1: expected the readings' own key columns ({wanted})")
    if "sigma" in table.columns:
        raise InputError(f"{table.name}, line 1, column sigma: expected predictions, which have no sigma")
    check_columns(table, [*[key for key in keys if key not in WRENCH], "value"], list(table.columns))
    _check_wrench_columns(table)
    models = [name for name in table.columns if name not in {*keys, "session", *POSITION}]
    quantity = _quantity(table)
    values = {name: numbers(table, name, expected="a finite predicted value in SI") for name in models}
    stacked = np.stack([values[name] for name in models], axis=1)
    sessions = table.columns.get("session", ("",) * len(quantity))
    place, wrench = _place(table, labelled=labelled), _wrench(table, quantity)
    rows = _Rows(table, labelled, place, wrench, quantity, sessions, stacked, stacked[:, 0])
    by_session = "session" in table.columns
    found: dict[tuple[Any, ...], int] = {}
    for row, key in enumerate(_keys(rows, sessions=by_session)):
        first = found.setdefault(key, row)
        if np.any(stacked[first] != stacked[row]):
            raise table.fail(row, "value", f"the prediction already given on line {table.lines[first]}")
    picked: list[int] = []
    for part in parts:
        for row, key in enumerate(_keys(part, sessions=by_session)):
            if key not in found:
                message = f"a reading that {table.name} predicts"
                raise part.table.fail(row, "pose" if labelled else "x", message)
            picked.append(found[key])
    idle = len(found) - len(set(picked))
    if idle:
        log.warning("%s: %d predictions have no reading", table.name, idle)
    return {name: stacked[picked, k] for k, name in enumerate(models)}
