"""Text of a robot file from a model: bodies, joints, drives and tool, with comments for people."""

from __future__ import annotations

import fnmatch
import json
import re
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.errors import InputError, naming, require, suggest
from stiffscope.robot.file import quantities as q
from stiffscope.robot.file.copies import SIX
from stiffscope.robot.file.parse import place_of
from stiffscope.robot.reader import read_robot
from stiffscope.runtime.reading import show_path

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence
    from pathlib import Path

    from stiffscope.imports.simulator_model import (
        ModelBody,
        ModelJoint,
        SimulatorModel,
    )

_DRIVABLE = {
    "revolute": q.TORSION,
    "prismatic": q.STIFFNESS,
    "cylindrical": q.STIFFNESS,
}
_HEAD = """# Imported from {file}: geometry, masses, joints and their ranges at its home; SI, base axes of the source.
#
# Fill in what a simulator's model does not say:
#   - drives: give each driven joint a stiffness, by hand below or with --drive JOINT=STIFFNESS; a joint without one
#     moves freely. Gains, springs and damping of the source stand beside its joints as comments, none is taken.
#   - elastic bodies: all bodies are rigid here. To let one bend, describe it as a part ([parts.NAME], shape "rod",
#     "plate", "step" or "matrix"), replace its mass and centre by part, base, tip and y, and let its joints stand on
#     its ends, "BODY.base" and "BODY.tip". The points where a body's joints stand are written beside it.
#   - bearings: compliance = {{ radial = "...", axial = "...", tilting = "..." }} of a joint.
"""


def check_text(path: str | Path, out: Path, text: str, what: str) -> None:
    """Raise InputError, at the source's ``path``, unless a robot can be read from its file's text."""
    try:
        read_robot(out, text)
    except InputError as error:
        got = "one with " + re.sub(rf"^{re.escape(str(out))}:\d+: ", "", str(error))
        raise InputError(
            f"{show_path(path)}: expected {what} of a robot, got {got}"
        ) from error


def driven(model: SimulatorModel, drives: Sequence[str]) -> dict[str, str]:
    """Return drive stiffnesses as texts, by joint; names may be patterns ("leg*/base").

    Raises InputError for an unknown joint or invalid stiffness.
    """
    joints = {joint.name: joint for joint in model.joints}
    able = [name for name, joint in joints.items() if joint.kind in _DRIVABLE]
    stiffnesses = {}
    for text in drives:
        where = place_of("--drive", text)
        name, equals, value = (piece.strip() for piece in text.partition("="))
        expected = 'JOINT=STIFFNESS such as "joint1=25 kN*m/rad"'
        require(equals, where, expected, f'"{text}"')
        named = [name] if name in able else fnmatch.filter(able, name)
        if not named:
            what = f"a joint that turns or slides ({', '.join(able)})"
            raise InputError(
                f'{where}: expected {what}, got "{name}"{suggest(name, able)}'
            )
        for joint in named:
            with naming(where):
                q.to_si(number_or_text(value), _DRIVABLE[joints[joint].kind])
            first = joint not in stiffnesses
            require(first, where, "one stiffness of each joint", f"two of {joint}")
        stiffnesses |= dict.fromkeys(named, to_toml(number_or_text(value)))
    return stiffnesses


def number_or_text(value: str) -> float | str:
    """Return a text as a number if it is one."""
    try:
        return float(value)
    except ValueError:
        return value


def robot_text(
    model: SimulatorModel,
    file: str,
    drives: dict[str, str],
    head: str = _HEAD,
    parts: Sequence[str] = (),
) -> str:
    """Return the text of a robot file.

    ``drives``: stiffness of each driven joint, as TOML; ``head``: header with ``{file}`` for the
    source's name; ``parts``: lines of the parts of elastic bodies, and of groups.
    """
    lines = [head.format(file=file).rstrip()]
    lines += [f"# Note: {note}." for note in model.notes]
    lines += ["", f"name = {to_toml(model.name)}", "", *parts]
    for body in model.bodies:
        lines += [*_body_lines(body, model.joints), ""]
    for joint in model.joints:
        lines += [*_joint_lines(joint, drives), ""]
    lines += [
        "[tool]",
        f"body = {to_toml(model.tool_body)}",
        f"at = {vector_text(model.tool_at)}",
    ]
    lines.append(f"pose = {to_toml(list(model.pose))}")
    size = float(np.linalg.norm(model.gravity))
    if size > 0:
        direction = vector_text(model.gravity / size)
        lines += [
            "",
            "[gravity]",
            f"acceleration = {_number(size)}",
            f"direction = {direction}",
        ]
    place = dict(zip("xyz", map(float, model.tool_at), strict=True))
    at_home = [_number(place.get(coordinate, 0.0)) for coordinate in model.pose]
    lines += ["", "[poses]", f"home = [{', '.join(at_home)}]", ""]
    return "\n".join(lines)


def _body_lines(body: ModelBody, joints: Iterable[ModelJoint]) -> Iterator[str]:
    yield f"[bodies.{toml_key(body.name)}]" + (f"   # {body.note}" if body.note else "")
    if body.part:
        yield f"part = {to_toml(body.part)}"
        yield f"at = {vector_text(body.centre)}"
        yield f"x = {vector_text(body.axes[:, 0])}"
        yield f"y = {vector_text(body.axes[:, 1])}"
        return
    if body.mass:
        yield f"mass = {_number(body.mass)}"
        yield f"centre = {vector_text(body.centre)}"
        if np.abs(body.inertia).max() > 1e-14:
            yield f"inertia = {vector_text(body.inertia[SIX])}"
    for joint in joints:
        if body.name in {joint.first, joint.second}:
            yield f"# {joint.name} stands at {vector_text(joint.at)}"


def _joint_lines(joint: ModelJoint, drives: dict[str, str]) -> Iterator[str]:
    yield f"[joints.{toml_key(joint.name)}]" + (
        f"   # {joint.note}" if joint.note else ""
    )
    yield f"between = {to_toml([joint.first, joint.second])}"
    yield f"type = {to_toml(joint.kind)}"
    yield f"at = {vector_text(joint.at)}"
    for key in ("axis", "axis2"):
        direction = getattr(joint, key)
        if direction is not None:
            yield f"{key} = {vector_text(direction)}"
    if joint.kind in _DRIVABLE:
        limits = (
            f", range = [{', '.join(map(_number, joint.range))}]" if joint.range else ""
        )
        gain = _number(joint.gain) if joint.gain > 0 else "..."
        if joint.name in drives:
            yield f"drive = {{ stiffness = {drives[joint.name]}{limits} }}"
        else:
            why = "gain kp of the source" if joint.gain > 0 else "if it is driven"
            yield f'# drive = {{ stiffness = "{gain} {_DRIVABLE[joint.kind].unit}"{limits} }}   # {why}'
    if joint.dynamics:
        listed = ", ".join(
            f"{word} {_number(value)}" for word, value in joint.dynamics.items()
        )
        yield f"# the source has {listed} here (SI), not taken"


def toml_key(name: str) -> str:
    """Format a name as a TOML key, quoted if necessary."""
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else to_toml(name)


def to_toml(value: object) -> str:
    """Format a text, number or list of texts as TOML, the same as in JSON."""
    return json.dumps(value, ensure_ascii=False)


def _number(value: float) -> str:
    return f"{value + 0.0:.15g}"


def vector_text(values: np.ndarray) -> str:
    """Format components as a TOML list."""
    size = np.abs(values)
    rounded = np.where(size <= 1e-13 * size.max(), 0.0, values)
    return f"[{', '.join(map(_number, rounded.tolist()))}]"
