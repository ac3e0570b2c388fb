"""What determines a part's virtual experiment: its order, the order's cache key, and the part built from it."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from stiffscope.cad.solid import GREATEST_X, LEAST_X
from stiffscope.errors import InputError
from stiffscope.jobs.cache import code_version, digest, file_digest

if TYPE_CHECKING:
    from stiffscope.cad.faces import FaceSelector
    from stiffscope.cad.link import LinkParameters
    from stiffscope.cad.materials import AnyMaterial
    from stiffscope.cad.part import Part
    from stiffscope.cad.slider import SliderParameters
    from stiffscope.cad.solid import Placement
    from stiffscope.fea.settings import Settings
    from stiffscope.robot.part_schema import Step
    from stiffscope.robot.schema import PartName, RobotFile

LIBRARIES = ("build123d", "cadquery-ocp-novtk", "pytetwild", "scikit-fem", "numpy", "scipy")
FORM = 4  # of the files of an experiment in the cache; other code reads other forms


@dataclass(frozen=True)
class StepOrder:
    """A solid of a STEP file as a part: content, chosen faces (by default those of least and greatest x), axes."""

    path: Path
    sha256: str
    clamped: tuple[FaceSelector, ...] = LEAST_X
    loaded: tuple[FaceSelector, ...] = GREATEST_X
    placement: Placement | None = None
    reference_point: tuple[float, float, float] | None = None


@dataclass(frozen=True)
class PartOrder:
    """Everything that determines a part's virtual experiment; the label names it in messages only."""

    name: PartName
    shape: LinkParameters | SliderParameters
    material: AnyMaterial
    settings: Settings
    step: StepOrder | None = None
    label: str = field(default="", compare=False)

    def key(self) -> str:
        """Cache key: shape, material, settings, a STEP file's content, and the code that works on them."""
        step = dataclasses.replace(self.step, path=Path()) if self.step else None
        return digest(
            {
                "name": self.name,
                "shape": dataclasses.asdict(step or self.shape),
                "material": dataclasses.asdict(self.material),
                "settings": dataclasses.asdict(self.settings),
                "code": code_version(("stiffscope.cad", "stiffscope.fea"), LIBRARIES),
                "form": FORM,
            }
        )

    def build(self) -> Part:
        """The part itself: its own shape, or the solid of a STEP file."""
        from stiffscope.cad import link, slider
        from stiffscope.cad.step import read_step

        if self.step:
            return read_step(
                self.step.path, name=self.name, material=self.material, clamped=self.step.clamped,
                loaded=self.step.loaded, placement=self.step.placement, reference_point=self.step.reference_point,
            )  # fmt: skip
        if isinstance(self.shape, link.LinkParameters):
            return link.build(self.shape, self.material)
        return slider.build(self.shape, self.material)


def order_part(robot: RobotFile, name: PartName, step: str | Path | None = None, *, label: str = "") -> PartOrder:
    """Order the experiment that a robot file asks for.

    Parameters
    ----------
    robot, name
        The robot, and its part.
    step
        A STEP file to take instead of the part's own shape, or of the one that the robot file names.
    label
        What messages and progress call it; by default the part's name.

    Raises
    ------
    InputError
        The STEP file cannot be read.

    """
    from stiffscope.fea.settings import Settings

    section = robot.part(name)
    settings = Settings(interface=section.interface, foundation=section.foundation, **section.mesh.model_dump())
    solid = _step_order(robot, section.step, step)
    return PartOrder(name, robot.parameters(name).present(), robot.material(name), settings, solid, label or name)


def build_part(robot: RobotFile, name: PartName) -> Part:
    """Build a part of a robot: the robot file's own shape of it, or the STEP file that it names.

    Parameters
    ----------
    robot
        As `load_robot` gives it.
    name
        The part's name in the robot file, such as "slider".

    Returns
    -------
    Part
        The solid with its material, its clamped faces and its loaded interfaces, in the part's axes.

    Raises
    ------
    InputError
        There is no such part, or its solid cannot be built or read.

    """
    from stiffscope.robot.schema import PARTS

    if name not in PARTS:
        raise InputError(f"part: expected one of {', '.join(PARTS)}, got {name!r}")
    return order_part(robot, name).build()


def _step_order(robot: RobotFile, section: Step | None, given: str | Path | None) -> StepOrder | None:
    """A STEP file given on the command line, with the robot file's choice of faces, or the robot file's own."""
    if given is None and section is None:
        return None
    shown = Path(given or section.file)  # type: ignore[union-attr]
    path = shown if given or shown.is_absolute() else robot.path.parent / shown
    try:
        content = file_digest(path)
    except OSError as error:
        raise InputError(f"{shown}: no STEP file can be read there ({error.strerror})") from error
    if section is None:
        return StepOrder(path.absolute(), content)
    tagged = ("clamped", section.clamped), ("loaded", section.loaded)
    chosen = {tag: tuple(face.selector() for face in faces) for tag, faces in tagged if faces is not None}
    return StepOrder(
        path.absolute(), content, **chosen, placement=section.placement(), reference_point=section.reference_point
    )
