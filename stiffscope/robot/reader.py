"""Reading of robot files: parse, override, evaluate, validate; errors name file, line, field."""

from __future__ import annotations

import copy
from typing import TYPE_CHECKING

from stiffscope.errors import FieldError, InputError, require
from stiffscope.robot.checks import check_robot
from stiffscope.robot.file.copies import make_copies
from stiffscope.robot.file.evaluate import evaluate, evaluate_value
from stiffscope.robot.file.override import apply_overrides, assign, check_unit
from stiffscope.robot.file.parse import Source, parse_text
from stiffscope.robot.file.validate import check_top, validate
from stiffscope.robot.library import find_robot, robot_names
from stiffscope.runtime import reading

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from stiffscope.robot.file.description import RobotFile


def load_robot(
    name_or_path: str | Path,
    overrides: Sequence[str] = (),
    tolerance: str | None = None,
) -> RobotFile:
    """Load and check a robot file.

    Parameters
    ----------
    name_or_path
        Path, or name of a robot in `data/robots` ("biglide").
    overrides
        As `--set`: "slider.thickness=25mm", "leg1.motor.drive.stiffness=2e7", "parameters.a=0.2".
        Overrides of a body also change its copies; overrides of a copy change that copy only.
    tolerance
        As in `--tolerance` ("0.1 %", "1e-3"): replaces the file's tolerance of all experiments.

    Returns
    -------
    RobotFile
        Immutable, in SI units.

    Raises
    ------
    InputError
        If the file is invalid; the message names file, line, field, what was expected and found.

    Examples
    --------
    >>> robot = load_robot("biglide", ["slider.thickness=25mm"])
    >>> robot.parts["slider"].thickness  # m
    0.025
    """
    path = find_robot(name_or_path)
    text = reading.read_text(path, "a robot file in TOML")
    return read_robot(path, text, overrides, tolerance)


def load_robot_of(
    file: Path, robot: str, overrides: Sequence[str] = (), tolerance: str | None = None
) -> RobotFile:
    """Load a robot named in another file: a robot file relative to its folder, or a bundled robot.

    Parameters
    ----------
    file
        Study or job; errors outside the robot file name its keys `robot`, `set` or `tolerance`.
    robot
        Name or path, as written there.
    overrides, tolerance
        See `load_robot`.

    Raises
    ------
    FieldError
        If the robot does not exist, or an override matches nothing in it.
    InputError
        If the robot file itself is invalid; the message names its line.
    """
    beside = file.parent / robot
    bundled = robot in robot_names() and not beside.is_file()
    try:
        return load_robot(robot if bundled else beside, overrides, tolerance)
    except InputError as error:
        if not bundled and beside.is_file() and str(error).startswith(f"{beside}:"):
            raise
        option = str(error).partition(" ")[0]
        key = {"--tolerance": "tolerance", "--set": "set"}.get(option, "robot")
        raise FieldError((key,), str(error)) from error


def read_robot(
    path: Path, text: str, overrides: Sequence[str] = (), tolerance: str | None = None
) -> RobotFile:
    """Read a robot from text, as `load_robot` does from a file.

    Parameters
    ----------
    path
        File named in messages; paths in the text are relative to it.
    text
        Text of the robot file.
    overrides
        Changes of the file, as in `--set`.
    tolerance
        Relative accuracy of the experiments, such as "1 %"; by default as in the file.
    """
    require(
        not isinstance(overrides, str),
        "overrides",
        'a list such as ["slider.thickness=25mm"]',
        f'"{overrides}"',
    )
    data = parse_text(path, text)
    source = Source(path, text, tuple(overrides))
    with source.refusing():
        check_top(data)
        written = copy.deepcopy(data) if overrides else {}
        changes, of_copies = apply_overrides(data, source, tolerance)
        data, values, tolerances = evaluate(data)
        copied = make_copies(data)
        source.origins.update((name, origin.name) for name, origin in copied.items())
        for change in changes:
            owner = source.origins.get(change.key[1], change.key[1])
            check_unit(change, written, owner)
        for override in of_copies:
            value = evaluate_value(override.value, values, override.key)
            assign(data, override.key, value, override.text)
        return check_robot(validate(data, source, values, tolerances, copied))
