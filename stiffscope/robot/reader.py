"""Read a robot file in four passes: parse, override, evaluate, validate; errors name file, line and field."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from stiffscope.errors import InputError
from stiffscope.robot.checks import check_robot
from stiffscope.robot.file.copies import make_copies
from stiffscope.robot.file.evaluate import evaluate, evaluate_value
from stiffscope.robot.file.override import apply_overrides, assign
from stiffscope.robot.file.parse import FieldError, Source, parse_text
from stiffscope.robot.file.validate import check_top, read_pose, validate
from stiffscope.robot.library import find_robot, robot_names
from stiffscope.runtime import reading

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from stiffscope.robot.file.description import RobotFile


def load_robot(name_or_path: str | Path, overrides: Sequence[str] = (), tolerance: str | None = None) -> RobotFile:
    """Load and check a robot file.

    Parameters
    ----------
    name_or_path
        A path, or the name of a robot in `data/robots` ("biglide").
    overrides
        Texts as `--set` takes them: "slider.thickness=25mm", "leg1.motor.drive.stiffness=2e7", "parameters.a=0.2".
        They change what is written: copies of a body follow it, and a copy's own name changes that copy alone.
    tolerance
        Text as `--tolerance` takes it ("0.1 %", "1e-3"): for the experiments on all parts, whatever the file says.

    Returns
    -------
    RobotFile
        Immutable; SI units.

    Raises
    ------
    InputError
        One line that names the file, the line, the field, what was expected and what was found.

    Examples
    --------
    >>> robot = load_robot("biglide", ["slider.thickness=25mm"])
    >>> robot.parts["slider"].thickness  # m
    0.025
    """
    path = find_robot(name_or_path)
    return read_robot(path, reading.read_text(path, "a robot file in TOML"), overrides, tolerance)


def load_robot_of(file: Path, robot: str, overrides: Sequence[str] = (), tolerance: str | None = None) -> RobotFile:
    """Load the robot that another file names: a robot file seen from that file's folder, or a bundled robot.

    Parameters
    ----------
    file
        The study or job; its keys `robot`, `set`, `tolerance` are blamed for what is not the robot file's own fault.
    robot
        Name or path, as it stands there.
    overrides, tolerance
        As `load_robot` takes them.

    Raises
    ------
    FieldError
        There is no such robot, or an override names nothing of it.
    InputError
        The robot file itself is wrong; it names its line.

    """
    beside = file.parent / robot
    bundled = robot in robot_names() and not beside.is_file()
    try:
        return load_robot(robot if bundled else beside, overrides, tolerance)
    except InputError as error:
        if not bundled and beside.is_file() and str(error).startswith(f"{beside}:"):
            raise
        key = {"--tolerance": "tolerance", "--set": "set"}.get(str(error).partition(" ")[0], "robot")
        raise FieldError((key,), str(error)) from error


def read_robot(path: Path, text: str, overrides: Sequence[str] = (), tolerance: str | None = None) -> RobotFile:
    """Read a robot from a text; `path` is what errors call it and what paths in it are relative to. As `load_robot`.

    Parameters
    ----------
    path
        File that messages name.
    text
        Text of the robot file.
    overrides
        Changes of the file, as `--set` has them.
    tolerance
        Relative accuracy wanted of experiments, such as "1 %"; by default the file's.

    """
    data = parse_text(path, text)
    source = Source(path, text, tuple(overrides))
    try:
        check_top(data)
        of_copies = apply_overrides(data, source, tolerance)
        data, values, tolerances = evaluate(data)
        copied = make_copies(data)
        source.origins.update((name, origin.name) for name, origin in copied.items())
        for override in of_copies:
            value = evaluate_value(override.value, values, override.key)
            assign(data, override.key, value, override.text)
        robot = validate(data, source, values, tolerances, copied)
        check_robot(robot)
    except FieldError as error:
        raise source.refuse(error.key, str(error)) from error
    return robot


def pose_of(robot: RobotFile, numbers: Sequence[Any]) -> tuple[float, ...]:
    """A pose given by numbers or texts with units, as `--at` has them. Raises InputError."""
    try:
        return read_pose(list(numbers), robot.tool, ("at",))
    except FieldError as error:
        raise InputError(f"--at: {error}") from error
