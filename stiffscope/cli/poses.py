"""Poses of a command: tool poses of `--at`, drive positions of `--joints`, or the file's poses."""

from __future__ import annotations

import logging
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from stiffscope.errors import InputError, naming, require, suggest
from stiffscope.robot.file import quantities as q
from stiffscope.robot.mechanism_of import configured_poses, rigid_mechanism
from stiffscope.vjm.kinematics.configurations import configure_drives, start_note

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stiffscope.robot.file.description import RobotFile
    from stiffscope.vjm.kinematics.configurations import Configurations


log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Asked:
    """Reachable poses with the texts or names by which they were requested."""

    names: tuple[str, ...]
    configurations: Configurations


def find_poses(robot: RobotFile, at: Sequence[str], joints: Sequence[str]) -> Asked:
    """Return the poses of `--at` or `--joints`; without either, those of the robot file.

    No part matrices are needed. Raise InputError for an invalid or unreachable pose.

    Parameters
    ----------
    robot
        Robot file.
    at
        Tool poses as text: names of poses, or coordinates such as "0,0,350 mm".
    joints
        Displacements of drives from home as text, e.g. "leg1.motor=10 deg"; excludes ``at``.
    """
    require(
        not (at and joints),
        "--joints",
        "either poses with --at or drives with --joints",
        "both",
    )
    names = tuple(joints or at or robot.poses)
    mechanism = rigid_mechanism(robot)
    if joints:
        configurations = configure_drives(
            mechanism, [_displacements(robot, text) for text in joints]
        )
    else:
        configurations = configured_poses(
            robot, mechanism, [_coordinates(robot, text) for text in names]
        )
    for index, name in enumerate(names):
        if not configurations.valid[index]:
            reason = configurations.refusal(index)
            if name in robot.poses and not (at or joints):
                raise robot.refuse(("poses", name), reason)
            bare = name not in robot.known_poses and not re.search(r"\d *[a-z]", name)
            hint = "; numbers without a unit are m and rad" if bare else ""
            raise InputError(f"{name}: {reason}{hint}")
    note = "" if joints else start_note(mechanism)
    if note:
        log.warning("%s", note)
    return Asked(names, configurations)


def _coordinates(robot: RobotFile, text: str) -> tuple[float, ...]:
    """Return a pose, m and rad, from its name or coordinates."""
    if text in robot.known_poses:
        return robot.known_poses[text]
    pose = robot.tool.pose
    examples = {"z": "350 mm", **dict.fromkeys(("rx", "ry", "rz"), "10 deg")}
    example = ",".join(examples.get(name, "0") for name in pose)
    names = f" or a pose of {robot.path}: {', '.join(robot.known_poses)}"
    with naming(f"--at {text}", f'{",".join(pose).upper()} such as "{example}"{names}'):
        return q.several(text, *map(robot.dimension_of, pose))


def _displacements(robot: RobotFile, text: str) -> list[float]:
    """Return displacements of all drives from home, m and rad; unnamed drives stay at home."""
    drives = robot.drives()
    given: dict[str, float] = {}
    for word in text.split(","):
        name, equals, value = (piece.strip() for piece in word.partition("="))
        spellings = (name, f"joints.{name}", name.removeprefix("joints."))
        name = next((spelling for spelling in spellings if spelling in drives), name)
        form = f'DRIVE=POSITION,… such as "{" ".join(drives[:1])}=10 mm"'
        require(equals, f"--joints {text}", form, f'"{word}"')
        if name not in drives or name in given:
            guess = "" if name in given else suggest(name, drives)
            expected = f"expected each of {', '.join(drives)} once"
            raise InputError(f'--joints {text}: {expected}, got "{name}"{guess}')
        with naming(f"--joints {text}: {name}"):
            (given[name],) = q.several(value, robot.dimension_of(f"q:{name}"))
    return [given.get(name, 0.0) for name in drives]
