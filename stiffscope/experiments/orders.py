"""Orders of virtual experiments: all inputs of a part's experiment, cache key, part to test."""

from __future__ import annotations

import dataclasses
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from stiffscope.cad.solid import GREATEST_X, LEAST_X, build
from stiffscope.cad.step import read_step
from stiffscope.errors import InputError, check_kind, require
from stiffscope.fea.settings import Settings
from stiffscope.robot.file.description import RobotFile
from stiffscope.robot.file.part_sections import ParametricPart, SolidPart, StepPart
from stiffscope.runtime.cache import code_version, digest
from stiffscope.runtime.reading import MOST_BYTES, file_digest

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from stiffscope.cad.faces import FaceSelector
    from stiffscope.cad.materials import AnyMaterial
    from stiffscope.cad.part import Part
    from stiffscope.cad.solid import Placement, SolidParameters

LIBRARIES = (
    "cadquery-ocp-novtk",
    "pytetwild",
    "scikit-fem",
    "numpy",
    "scipy",
)
FORM = 8  # format version of cached experiments


@dataclass(frozen=True)
class StepOrder:
    """A STEP file's solid as a part: content, faces (default: least and greatest x), axes."""

    path: Path  # absolute, for workers in other folders
    sha256: str
    given: str = field(
        default="", compare=False
    )  # path as the user gave it, for messages
    clamped: tuple[FaceSelector, ...] = LEAST_X
    loaded: tuple[FaceSelector, ...] = GREATEST_X
    interfaces: tuple[tuple[str, tuple[FaceSelector, ...]], ...] = ()
    couplings: tuple[tuple[str, str], ...] = ()
    placement: Placement | None = None
    reference_point: tuple[float, float, float] | None = None
    chosen: int | str | None = None  # of several solids
    shape: ClassVar[str] = "step"
    axes: ClassVar[str] = (
        "those of the STEP file, or of the frame chosen in it; twist (v, omega) and wrench (f, m) "
        "at the loaded faces' reference point"
    )

    def lengths(self) -> dict[str, float]:
        """Return the dimensions that can vary: none."""
        return {}


@dataclass(frozen=True)
class PartOrder:
    """All inputs of a part's virtual experiment; the label is used in messages only.

    The solid comes from dimensions or from a STEP file.
    """

    name: str
    solid: SolidParameters | StepOrder
    material: AnyMaterial
    settings: Settings
    label: str = field(default="", compare=False)

    @property
    def step(self) -> StepOrder | None:
        """STEP file of the solid; None if the solid is parametric."""
        return self.solid if isinstance(self.solid, StepOrder) else None

    @property
    def shape(self) -> str:
        """Kind of solid: "rod", "plate", "box", ... or "step"."""
        return self.solid.shape

    @property
    def axes(self) -> str:
        """Part axes and reference point, in words."""
        return self.solid.axes

    def key(self) -> str:
        """Return the cache key: hash of shape, material, settings, STEP file's content and code."""
        solid = (
            dataclasses.replace(self.step, path=Path(), given="")
            if self.step
            else self.solid
        )
        plain = {"solid": solid, "material": self.material, "settings": self.settings}
        return digest(
            {
                "name": self.name,
                "shape": self.shape,
                "form": FORM,
                **{name: dataclasses.asdict(each) for name, each in plain.items()},
                "code": code_version(("stiffscope.cad", "stiffscope.fea"), LIBRARIES),
            }
        )

    def moves_from(self, other: PartOrder) -> bool:
        """Return whether another order's mesh can be morphed: same shape and mesh settings."""
        one, two = (
            dataclasses.replace(o.settings, foundation=None) for o in (self, other)
        )
        return self.step is None and self.shape == other.shape and one == two

    def build(self) -> Part:
        """Build the part: its parametric shape, or the solid of a STEP file."""
        if not isinstance(self.solid, StepOrder):
            return build(self.solid, self.material, self.name)
        step = self.solid
        try:
            return read_step(
                step.path,
                name=self.name,
                material=self.material,
                clamped=step.clamped,
                loaded=step.loaded,
                interfaces=dict(step.interfaces) or None,
                couplings=dict(step.couplings),
                placement=step.placement,
                reference_point=step.reference_point,
                chosen=step.chosen,
            )
        except InputError as error:
            text = str(error).replace("faces FILE", f"faces {step.path}")
            raise InputError(text.replace(str(step.path), step.given)) from error


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
