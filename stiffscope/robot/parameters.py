"""Numbers of a robot file that a sensitivity or a study may vary."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from stiffscope.robot.file.expressions import is_expression, normalize
from stiffscope.robot.file.override import split
from stiffscope.robot.file.parse import as_written, parse_text
from stiffscope.robot.file.part_sections import ParametricPart
from stiffscope.robot.file.sections import RigidBody
from stiffscope.robot.file.values import unit_of
from stiffscope.robot.part_matrices import part_sources
from stiffscope.robot.reader import read_robot

if TYPE_CHECKING:
    from collections.abc import Iterator

    from stiffscope.cad.materials import AnyMaterial
    from stiffscope.errors import Key
    from stiffscope.robot.file.description import RobotFile
    from stiffscope.robot.file.part_sections import PartSection
    from stiffscope.robot.file.sections import JointSection
    from stiffscope.robot.part_matrices import Components

CONSTANTS = {
    "modulus": "Pa",
    "poisson": "1",
    "density": "kg/m^3",
}  # unit by the last word


@dataclass(frozen=True)
class Parameter:
    """A number of a robot file, not an expression: key, value and unit, SI; tolerance if given."""

    key: Key
    value: float
    unit: str
    tolerance: float | None = None

    @property
    def name(self) -> str:
        """Name as in `--set`."""
        return ".".join(
            map(str, self.key[self.key[0] in {"parts", "joints", "bodies"} :])
        )

    def set_to(self, robot: RobotFile, value: float) -> RobotFile:
        """Return the robot with another value of it; raise InputError if that is invalid."""
        override = f"{'.'.join(map(str, self.key))}={value!r}"
        source = robot.source
        return read_robot(source.path, source.text, [*source.overrides, override])


def parameters(
    robot: RobotFile, components: Components = None
) -> tuple[Parameter, ...]:
    """Return the variable numbers in `[parameters]`, parts, materials, drives, bearings and masses.

    Expressions follow the numbers in them, and copies follow their originals. Zeros are omitted.
    """
    written = parse_text(robot.path, robot.source.text)
    listed = []
    for key, value, unit in _candidates(robot, written, components):
        given = _find_given(robot, written, key)
        if value and not is_expression(given):
            listed.append(Parameter(key, float(value), unit, robot.tolerances.get(key)))
    return tuple(listed)


def _candidates(
    robot: RobotFile, written: dict[str, Any], components: Components
) -> Iterator[tuple[Key, Any, str]]:
    for name, value in written.get("parameters", {}).items():
        yield ("parameters", name), robot.parameters[normalize(name)], unit_of(value)
    yield from _of_parts(robot, components)
    for name, joint in robot.joints.items():
        if name not in robot.copied:
            yield from _of_joint(name, joint)
            yield from _of_bearings(robot, written, name, joint)
    for name, body in robot.bodies.items():
        if isinstance(body, RigidBody) and name not in robot.copied:
            yield ("bodies", name, "mass"), body.mass, "kg"


def _of_parts(
    robot: RobotFile, components: Components
) -> Iterator[tuple[Key, Any, str]]:
    sources = part_sources(robot, components)
    materials: dict[str, AnyMaterial] = {}
    for name, source in sources.items():
        part = robot.parts[name]
        material = robot.material(name)
        if not isinstance(part.mass, str):
            yield ("parts", name, "mass"), part.mass, "kg"
        if not isinstance(source, str) or source not in _computed(part):
            continue
        if isinstance(part, ParametricPart):
            for key, value in part.parameters().lengths().items():
                yield ("parts", name, key), value, "m"
        foundation = getattr(part, "foundation", None)
        if foundation is not None and source in ("fea", "step"):
            yield ("parts", name, "foundation"), foundation, "N/m^3"
        if material is not None:
            materials[material.name] = material
    for material in materials.values():
        yield from _constants(material)


def _computed(part: PartSection) -> set[str]:
    """Return the sources whose matrix follows the part's dimensions."""
    by_formula = (
        isinstance(part, ParametricPart) and part.describes.published == "formula"
    )
    return {"fea", "step", "beam", *(["published"] if by_formula else [])}


def _of_joint(name: str, joint: JointSection) -> Iterator[tuple[Key, Any, str]]:
    drive = getattr(joint, "drive", None)
    bearing = joint.compliance
    if drive is not None and drive.stiffness:
        unit = "N*m/rad" if joint.describes.turns else "N/m"
        yield as_written(("joints", name, "drive", "stiffness")), drive.stiffness, unit
    if getattr(joint, "spring", None) is not None:
        unit = "N*m/rad" if joint.describes.turns else "N/m"
        yield (
            as_written(("joints", name, "spring")),
            getattr(joint, "spring", None),
            unit,
        )
    for key, value in (
        enumerate(bearing) if isinstance(bearing, tuple) else bearing or ()
    ):
        unit = "rad/(N*m)" if key in {"tilting", 3, 4, 5} else "m/N"
        yield as_written(("joints", name, "compliance", key)), value, unit


def _of_bearings(
    robot: RobotFile, written: Any, name: str, joint: JointSection
) -> Iterator[tuple[Key, Any, str]]:
    """Yield the numbers with a unit of a joint's bearings that the file gives."""
    for number, element in enumerate(joint.bearing or ()):
        place = as_written(("joints", name, "bearing"))
        place = (
            (*place, number)
            if isinstance(_find_given(robot, written, place), list)
            else place
        )
        for key, value in element:
            given = _find_given(robot, written, (*place, key))
            if isinstance(value, float) and isinstance(given, str):
                yield (*place, key), value, unit_of(given)


def _constants(material: AnyMaterial) -> Iterator[tuple[Key, Any, str]]:
    """Yield the constants of a material."""
    for field in dataclasses.fields(material):
        unit = CONSTANTS.get(field.name.rpartition("_")[2])
        if unit:
            yield (
                ("materials", material.name, field.name),
                getattr(material, field.name),
                unit,
            )


def _find_given(robot: RobotFile, written: Any, key: Key) -> Any:
    """Return the value of a key as written in the file or set by `--set`; None if missing."""
    if key in robot.source.changed:
        return split(robot.source.changed[key].removeprefix("--set "))[1]
    for part in key:
        try:
            written = written[part]
        except (KeyError, IndexError, TypeError):
            return None
    return written
