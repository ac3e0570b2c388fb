"""Reading of campaign folders: header, tables, keys and values, and check against the robot."""

from __future__ import annotations

import logging
import math
import os
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.errors import InputError, expecting, require, say_count
from stiffscope.gap.campaign import keys as of_rows
from stiffscope.gap.campaign import quantities as of
from stiffscope.gap.campaign.campaign import Campaign
from stiffscope.gap.campaign.campaign_header import load_header
from stiffscope.gap.campaign.keys import (
    LABEL,
    OPTIONAL,
    coordinates_of,
    readings_in_si,
)
from stiffscope.gap.campaign.kinds import KINDS, by_code
from stiffscope.gap.campaign.kinds.motions import MOVED
from stiffscope.gap.campaign.quantities import AXES, WRENCH, kind_of, label_pose
from stiffscope.robot.file.description import ENDS, GROUND
from stiffscope.robot.file.quantities import show_value, to_si
from stiffscope.runtime.reading import open_file
from stiffscope.runtime.reading import show_path as shown_path
from stiffscope.runtime.table import check_marks, numbers, read_table

if TYPE_CHECKING:
    from pathlib import Path

    from stiffscope.gap.campaign.campaign import Array
    from stiffscope.gap.campaign.campaign_header import Header
    from stiffscope.gap.campaign.keys import Keys
    from stiffscope.robot.file.description import RobotFile
    from stiffscope.runtime.table import Table

log = logging.getLogger(__name__)
MOST_POSES = 2_000  # a diagnosis needs 0.02 s and 0.1 MB for each
_BLIND = 30.0  # times the largest reading: an uncertainty in another unit
_DEGREES = math.degrees(1.0), "deg"
_MILLIMETRES = 1e3, "mm"
_MOST_WORK = (
    2e10  # readings times the square of their instruments' unknowns: ten seconds
)


def load_campaign(
    folder: Path, robot: RobotFile | None = None, *, planned: bool = False
) -> Campaign:
    """Load the campaign in a folder.

    Parameters
    ----------
    folder
        A folder with a campaign.toml and its tables.
    robot
        The campaign's robot: named poses are looked up, and poses, sensors and loads are checked
        against it by `match_robot`. By default nothing is checked.
    planned
        Whether values may be missing (NaN), as in a plan with readings still to be taken.

    Returns
    -------
    Campaign
        Readings in the order of files and lines, SI.

    Raises
    ------
    InputError
        With the file, line and column, and what was expected.
    """
    header = load_header(folder)
    _check_files(folder, header)
    read = [
        _read_readings(folder / name, header, planned=planned)
        for name in header.readings
    ]
    if not read:
        return Campaign.without_readings(
            header.robot,
            header.modelled,
            header.components,
            sensors=header.sensors,
            loads=header.loads,
            frames=header.frames,
            responses=header.responses,
            units=header.units,
            source=header.source,
        )
    parts = [keys for keys, _, _ in read]
    first = parts[0]
    coordinates = dict.fromkeys(" ".join(part.coordinates) for part in parts)
    header.source.require(
        len(coordinates) == 1,
        ("readings",),
        "all files with the same columns of the pose",
        " and ".join(coordinates),
    )
    names, pose, poses = _number_poses(parts)
    labels = [label for part in parts for label in part.sessions]
    sessions = {label: i for i, label in enumerate(dict.fromkeys(labels))}
    predictions: dict[str, Array] = {}
    if header.predictions is not None:
        predictions = _read_predictions(folder / header.predictions, header, parts)
    campaign = Campaign(
        robot=header.robot,
        modelled=header.modelled,
        components=header.components,
        pose_names=names,
        poses=np.array(poses),
        pose=np.array(pose),
        wrench=np.concatenate([part.wrench for part in parts]),
        quantity=np.concatenate([part.quantity for part in parts]),
        value=np.concatenate([value for _, value, _ in read]),
        sigma=np.concatenate([sigma for _, _, sigma in read]),
        session_names=tuple(sessions),
        session=np.array([sessions[label] for label in labels]),
        files=header.readings,
        file=np.repeat(np.arange(len(parts)), [len(part.place) for part in parts]),
        line=np.array([line for part in parts for line in part.table.lines]),
        predictions=predictions,
        coordinates=AXES[:3] if first.coordinates == LABEL else first.coordinates,
        sensors=header.sensors,
        sensor=np.concatenate([part.sensor for part in parts]),
        loads=header.loads,
        load=np.concatenate([part.load for part in parts]),
        frames=header.frames,
        responses=header.responses,
        units=header.units,
        source=header.source,
    )
    _check_some(campaign)
    return campaign if robot is None else match_robot(campaign, robot)


def _check_files(folder: Path, header: Header) -> None:
    """Raise InputError, with the key, for a table that is not a file, or is one of the others."""
    named = [("readings", name) for name in header.readings]
    named += (
        [("predictions", header.predictions)] if header.predictions is not None else []
    )
    for key, name in named:
        what = "a table (.csv, .tsv, .xlsx)"
        try:
            open_file(folder / name, what).close()
        except InputError as error:
            message = str(error).removeprefix(f"{shown_path(folder / name)}: ")
            raise header.source.refuse(
                (key,), f"{message} ({shown_path(name)})"
            ) from error
        got = f'a name that ends with "/" ({shown_path(name)})'
        header.source.require(not name.endswith("/"), (key,), what, got)
    known: dict[str, str] = {}
    for name in header.readings:
        first = known.setdefault(os.path.realpath(folder / name), name)
        got = f"{show_value(first)} and {show_value(name)}, the same file"
        header.source.require(first == name, ("readings",), "different ones", got)


def _check_some(c: Campaign) -> None:
    """Raise InputError if all readings are zero (no gap in percent), or no deflection is loaded."""
    if not len(c):
        return
    moved = c.is_difference
    require(
        c.robot is None or not moved.any() or c.wrench[moved].any(),
        f"{c.where(int(np.argmax(moved)))}: fx",
        "a wrench other than zero",
        f"none in {int(moved.sum()):,} deflections",
    )
    none = (np.abs(c.value) < MOVED.least) & ~c.relative
    require(
        not none.all(),
        f"{c.where(0)}: value",
        "readings other than zero",
        f"none in {len(c):,} rows",
    )


def _read_readings(
    path: Path, header: Header, *, planned: bool
) -> tuple[Keys, Array, Array]:
    """Return the keys, values and uncertainties (n,) of a table."""
    bare = header.predictions is not None
    table = read_table(
        path,
        partial(of_rows.check_readings_columns, bare=bare),
        header.ignore,
        headings=header.columns,
        together=True,
    )
    with table.tell_together():
        return _read_rows(table, header, planned=planned)
    raise AssertionError("faults are raised")


def _read_rows(
    table: Table, header: Header, *, planned: bool
) -> tuple[Keys, Array, Array]:
    """Return the keys, values and uncertainties (n,) of a table's rows."""
    bare = header.predictions is not None
    check_marks(
        table, [name for name in table.columns if name not in {*OPTIONAL, *LABEL}]
    )
    of_rows.check_units(header, table)
    keys = of_rows.read_keys(table, header, bare=bare)
    value = numbers(table, "value", empty=planned, expected="a finite reading in SI")
    value = readings_in_si(table, header, "value", value, keys.quantity)
    kind = kind_of(keys.quantity)
    for called in dict.fromkeys(
        reading_kind.called for reading_kind in KINDS if reading_kind.is_positive
    ):
        alike = by_code(lambda each, called=called: each.called == called)
        wrong = alike[keys.quantity] & (value <= 0)
        table.refuse_where(wrong, "value", f"a positive {called}")
    lengths = np.array(
        [s.measures == "distance" and s.zero == "none" for s in header.sensors]
        + [False]
    )
    table.refuse_where(
        lengths[keys.sensor] & (value < 0), "value", "a distance of at least 0"
    )
    expected = "a positive number, or an empty cell if unknown"
    sigma = numbers(table, "sigma", empty=True, expected=expected)
    table.refuse_where(sigma <= 0, "sigma", expected)
    sigma = readings_in_si(table, header, "sigma", sigma, keys.quantity)
    if "value" in header.units and "sigma" not in header.units:
        in_unit = f'`units = {{ sigma = "{header.units["value"]}" }}` of campaign.toml'
        expected = (
            f"an uncertainty in SI below {_BLIND:g} times the readings, or {in_unit}"
        )
        for each in np.unique(kind):
            size = np.nan_to_num(np.abs(value[kind == each])).max()
            table.refuse_where(
                (kind == each) & (sigma > _BLIND * size) & (size > 0.0),
                "sigma",
                expected,
            )
    return keys, value, sigma


def _number_poses(
    parts: list[Keys],
) -> tuple[tuple[str, ...], list[int], list[list[float]]]:
    """Return names of the distinct poses, the pose index of each row, and coordinates."""
    places = [place for part in parts for place in part.place]
    index = {place: i for i, place in enumerate(dict.fromkeys(places))}
    pose = [index[place] for place in places]
    if parts[0].coordinates == LABEL:
        return (
            tuple(str(place[0]) for place in index),
            pose,
            [[np.nan] * 3 for _ in index],
        )
    names = tuple(label_pose(parts[0].coordinates, place) for place in index)
    return names, pose, [list(place) for place in index]


def _read_predictions(
    path: Path, header: Header, parts: list[Keys]
) -> dict[str, Array]:
    """Return the predicted values (n,) of all readings by each model of a table."""
    table = read_table(path, of_rows.check_predictions_columns, header.ignore)
    expected = parts[0].coordinates
    require(
        coordinates_of(table.columns, bare=True) == expected,
        f"{table.name}:1",
        f"the readings' own key columns ({' '.join(expected)})",
    )
    require(
        "sigma" not in table.columns,
        f"{table.name}:1: sigma",
        "predictions, which have no sigma",
    )
    keys = of_rows.read_keys(table, header, bare=True)
    models = [
        n for n in table.columns if n not in {*expected, *WRENCH, *OPTIONAL, *AXES}
    ]
    check_marks(table, [*WRENCH, *AXES, *models])
    read = partial(numbers, table, expected="a finite predicted value in SI")
    convert = partial(
        readings_in_si, table, header, quantity=keys.quantity, unit_of="value"
    )
    columns = {name: read(name) for name in models}
    values = np.stack([convert(name, each) for name, each in columns.items()], axis=1)
    by_session = "session" in table.columns
    row_of: dict[tuple[Any, ...], int] = {}
    for row, key in enumerate(keys.identities(sessions=by_session)):
        first = row_of.setdefault(key, row)
        if np.any(values[first] != values[row]):
            line = table.lines[first]
            raise table.fail(
                row, "value", f"the prediction already given on line {line}"
            )
    picked: list[int] = []
    for part in parts:
        for row, key in enumerate(part.identities(sessions=by_session)):
            if key not in row_of:
                raise part.table.fail(
                    row, expected[0], f"a reading that {table.name} predicts"
                )
            picked.append(row_of[key])
    idle = len(row_of) - len(set(picked))
    if idle:
        log.warning("%s: %d predictions have no reading", table.name, idle)
    return {name: values[picked, k] for k, name in enumerate(models)}


def match_robot(campaign: Campaign, robot: RobotFile) -> Campaign:
    """Return the campaign checked against the robot, with named poses looked up in its file.

    Raises
    ------
    InputError
        For too many poses or sessions, unknown poses, columns that are not the robot's coordinates, and sensors
        and loads that are not on its bodies.
    """
    _check_bodies(campaign, robot)
    campaign = _state_weight(campaign, robot)
    if not len(campaign):
        names = tuple(robot.tool.pose)
        poses = (
            campaign.poses if len(campaign.pose_names) else np.zeros((0, len(names)))
        )
        return replace(campaign, poses=poses, coordinates=names)
    first = campaign.where(int(np.argmax(campaign.pose >= MOST_POSES)))
    require(
        len(campaign.poses) <= MOST_POSES,
        f"{first}: {campaign.coordinates[0]}",
        f"at most {MOST_POSES:,} different poses",
        "more; leave some out, a few dozen tell as much",
    )
    loose = [s.zero == "session" for s in campaign.sensors] + [
        f.per == "session" for f in campaign.frames
    ] * 6
    most = int((_MOST_WORK / len(campaign)) ** 0.5) // max(sum(loose), 1)
    unknown = say_count(sum(loose), "unknown")
    require(
        not any(loose) or len(campaign.session_names) <= most,
        f"{campaign.where(int(np.argmax(campaign.session >= most)))}: session",
        f"at most {say_count(most, 'session')}, each with {unknown} of instruments",
        "more",
    )
    if not np.isnan(campaign.poses).any():
        return _label_drives(_order_columns(campaign, robot), robot)
    known = f"{robot.name}'s poses {', '.join(robot.known_poses)}"
    unknown = [
        f"{campaign.where(int(np.argmax(campaign.pose == k)))}: pose: expected one of {known}, got {name!r}"
        for k, name in enumerate(campaign.pose_names)
        if name not in robot.known_poses
    ]
    if unknown:
        raise InputError(unknown[0], unknown[1:])
    poses = np.array([robot.known_poses[name] for name in campaign.pose_names])
    return replace(campaign, poses=poses, coordinates=tuple(robot.tool.pose))


def _state_weight(campaign: Campaign, robot: RobotFile) -> Campaign:
    """Return the campaign with what the nominal model carries: weight acts on every machine."""
    if campaign.modelled is not None:
        return campaign
    return replace(campaign, modelled=("gravity",) if robot.gravity else ())


def _label_drives(campaign: Campaign, robot: RobotFile) -> Campaign:
    """Label poses of drives in mm and degrees, which only the robot tells apart."""
    names = campaign.coordinates
    if not names[0].startswith(of.JOINT):
        return campaign
    linear = {n for n in names if robot.dimension_of(n).unit == "m"}
    shown_in = {n: _MILLIMETRES if n in linear else _DEGREES for n in names}
    labels = (label_pose(names, pose, shown_in) for pose in campaign.poses.tolist())
    return replace(campaign, shown_in=shown_in, pose_names=tuple(labels))


def _order_columns(campaign: Campaign, robot: RobotFile) -> Campaign:
    """Put the coordinates in the robot's order."""
    given = campaign.coordinates
    pose = tuple(robot.tool.pose)
    joints = tuple(f"{of.JOINT}{name}" for name in robot.drives())
    wanted = next(
        (names for names in (pose, joints) if names and set(names) == set(given)), None
    )
    if wanted is None:
        valid = joints if given[0].startswith(of.JOINT) else pose
        wrong = next(
            name for name in (*given, *valid) if (name in given) != (name in valid)
        )
        expected = f"{' '.join(pose)}, or {' '.join(joints)}, got {' '.join(given)}"
        where = f"{campaign.files[0]}:1: {wrong}"
        command = f"the coordinates that command {robot.name}"
        raise InputError(f"{where}: expected {command}: {expected}")
    for name in [name for name in wanted if name in campaign.units]:
        unit = campaign.units[name]
        dimension = robot.dimension_of(name)
        refuse = partial(campaign.refuse, ("units", name))
        expected = f"a unit of {dimension.noun}"
        with expecting(refuse, expected, ValueError, got=show_value(unit)):
            to_si(f"1 {unit}", dimension)
    order = [given.index(name) for name in wanted]
    return replace(campaign, poses=campaign.poses[:, order], coordinates=wanted)


def _check_bodies(campaign: Campaign, robot: RobotFile) -> None:
    """Raise InputError for sensors and loads not on a body, and sensors on the measured body."""
    known = robot.nodes()

    def check(name: str, *key: str, moves: bool) -> None:
        valid = [node for node in known if not (moves and node == GROUND)]
        what = f"a body or an end of one ({', '.join(valid)})"
        campaign.require(name in valid, key, what, show_value(name))

    for sensor in campaign.sensors:
        section = sensor.target or sensor.name
        check(sensor.body, "sensors", section, "body", moves=False)
        if sensor.inside is not None:
            check(
                f"{known[sensor.body]}.{ENDS[1]}",
                "sensors",
                section,
                "body",
                moves=False,
            )
        check(sensor.against, "sensors", section, "against", moves=False)
        turns = sensor.body == GROUND and sensor.measures == "rotation"
        campaign.require(
            sensor.body != sensor.against or turns,
            ("sensors", section, "against"),
            f"another body than {sensor.body}",
            "the same",
        )
    for load in campaign.loads:
        check(load.body, "loads", load.name, "body", moves=True)
