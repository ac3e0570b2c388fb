"""Orders of the virtual experiments on a robot's parts, as its file sets them."""

from __future__ import annotations

from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stiffscope.errors import InputError, check_kind, require
from stiffscope.experiments.part_order import PartOrder, StepOrder
from stiffscope.fea.settings import Settings
from stiffscope.robot.file.description import RobotFile
from stiffscope.robot.file.part_sections import ParametricPart, SolidPart, StepPart
from stiffscope.runtime.reading import MOST_BYTES, file_digest

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from stiffscope.cad.faces import FaceSelector
    from stiffscope.cad.part import Part
    from stiffscope.cad.solid import SolidParameters


def order_part(
    robot: RobotFile, name: str, step: str | Path | None = None, *, label: str = ""
) -> PartOrder:
    """Return the experiment of a part as set in the robot file, on its own shape or a STEP file.

    Raises InputError if the part does not exist, has no solid, or its solid is infeasible.

    Parameters
    ----------
    robot, name
        Robot file, and name of the part.
    step
        STEP file instead of the part's own shape.
    label
        Name in progress and results; by default that of the part.
    """
    require(
        name in robot.parts,
        "part",
        f"one of {', '.join(robot.parts) or '(none)'}",
        f"{name!r}",
    )
    part = robot.part(name)
    solid = _step_order(robot, name, step) or _dimensions(robot, name)
    material = robot.material(name)
    if material is None:
        expected = "expected the material of the solid"
        raise robot.refuse(("parts", name, "material"), f"{expected}, got none")
    settings = Settings()
    if isinstance(part, SolidPart):
        mesh = part.mesh.model_dump()
        settings = Settings(
            interface=part.interface, foundation=part.foundation, **mesh
        )
    return PartOrder(name, solid, material, settings, label or name)


@contextmanager
def name_lines(robot: RobotFile) -> Iterator[None]:
    """Add file and line to errors of parts, such as "arm.clamped: no face has …"."""
    try:
        yield
    except InputError as error:
        where, _, message = str(error).partition(": ")
        name = max(
            (n for n in robot.parts if where.startswith(f"{n}.")), key=len, default=None
        )
        if name is None:
            raise
        key = where[len(name) + 1 :]
        inner = (
            ("interfaces", key)
            if key in robot.parts[name].interface_names
            else key.split(".")
        )
        raise robot.refuse(("parts", name, *inner), message) from error


def build_part(robot: RobotFile, name: str) -> Part:
    """Build a part of a robot from its parametric shape or its STEP file.

    Parameters
    ----------
    robot
        Robot from `load_robot`.
    name
        Name of the part in the robot file, such as "slider".

    Returns
    -------
    Part
        Solid with material, clamped faces and loaded interfaces, in the part's axes.

    Raises
    ------
    InputError
        If the part does not exist, or its solid cannot be built or read.

    Examples
    --------
    >>> import stiffscope as ss
    >>> ss.build_part(ss.load_robot("biglide"), "slider").material.name
    'steel'
    """
    check_kind("robot", robot, RobotFile, "load_robot")
    with name_lines(robot):
        return order_part(robot, name).build()


def _dimensions(robot: RobotFile, name: str) -> SolidParameters:
    """Return the shape of a parametric part, without parameters of absent features."""
    part = robot.part(name)
    if not isinstance(part, ParametricPart):
        what = 'expected a shape that is a solid, such as "rod" or "step"'
        raise robot.refuse(("parts", name, "shape"), f'{what}, got "{part.shape}"')
    try:
        return part.parameters().present()
    except (
        InputError
    ) as error:  # the message begins with the parameter: "link.bore: expected ..."
        key, _, message = str(error).partition(": ")
        raise robot.refuse(("parts", name, *key.split(".")[1:]), message) from error


def _step_order(
    robot: RobotFile, name: str, given: str | Path | None
) -> StepOrder | None:
    """Return the order of a given STEP file, with the robot file's faces, or of the part's own."""
    part = robot.part(name)
    section = part if isinstance(part, StepPart) else None
    require(given != "", "--step", "a STEP file", "no name")
    path = (
        Path(given)
        if given is not None
        else section and robot.path.parent / section.file
    )
    if path is None:
        return None
    try:
        content = file_digest(path, "a STEP file", MOST_BYTES)
    except InputError as error:
        if given is not None:
            raise
        message = str(error).removeprefix(f"{path}: ")
        raise robot.refuse(("parts", name, "file"), f"{message} ({path})") from error
    if section is None:
        return StepOrder(path.absolute(), content, str(path))
    given_faces = (("clamped", section.clamped), ("loaded", section.loaded))
    chosen = {tag: _select(faces) for tag, faces in given_faces if faces is not None}
    ends = (section.interfaces or {}).items()
    return StepOrder(
        path.absolute(),
        content,
        str(path),
        **chosen,
        placement=section.placement(),
        reference_point=section.reference_point,
        chosen=section.solid,
        interfaces=tuple((end, _select(each.faces)) for end, each in ends),
        couplings=tuple((end, each.interface) for end, each in ends if each.interface),
    )


def _select(faces: Iterable[Any]) -> tuple[FaceSelector, ...]:
    """Return the selectors of faces as written in a robot file."""
    return tuple(face.selector() for face in faces)
