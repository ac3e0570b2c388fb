"""A robot as its file describes it, checked and complete: copies made, expressions evaluated; SI, immutable."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from stiffscope.cad.materials import AnyMaterial, material
from stiffscope.errors import InputError
from stiffscope.robot.file.parse import Source
from stiffscope.robot.file.part_sections import ParametricPart, PartSection
from stiffscope.robot.file.sections import (
    BodySection,
    Effect,
    ElasticBody,
    GravitySection,
    InterfaceBody,
    JointSection,
    MapSection,
    ToolSection,
)
from stiffscope.runtime.brief import describe_briefly

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping

    import numpy as np

    from stiffscope.robot.file.part_sections import Dimensions
    from stiffscope.robot.file.positions import Key

GROUND = "ground"
ENDS = ("base", "tip")


@dataclass(frozen=True)
class Turned:
    """Where a copied body or joint comes from: the name as written, and the rotation (3, 3) from there."""

    name: str
    rotation: np.ndarray


@dataclass(frozen=True)
class RobotFile:
    """A robot file's content. Names are unique among bodies and joints (a joint with a body's name is "joints.NAME").

    `copied` holds those of `[[copies]]`.

    `tolerances`, SI, by key: of the values that are written with one ("20 mm ± 0.1 mm").
    """

    __repr__ = describe_briefly

    name: str
    parts: Mapping[str, PartSection]
    bodies: Mapping[str, BodySection]
    joints: Mapping[str, JointSection]
    tool: ToolSection
    parameters: Mapping[str, float] = field(default_factory=dict)
    groups: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    gravity: GravitySection | None = None
    poses: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    map: MapSection | None = None
    materials: Mapping[str, AnyMaterial] = field(default_factory=dict)
    effects: tuple[Effect, ...] = ()
    copied: Mapping[str, Turned] = field(default_factory=dict)
    tolerances: Mapping[Key, float] = field(default_factory=dict)
    source: Source = field(default_factory=lambda: Source(Path(), ""), compare=False)

    @property
    def path(self) -> Path:
        """The file it was read from."""
        return self.source.path

    def refuse(self, key: Key, message: str) -> InputError:
        """Error for a key, with the `--set` that brought it or its file and line."""
        return self.source.refuse(key, message)

    def carries(self, effect: str) -> bool:
        """Whether it has adopted such an effect."""
        return any(each.effect == effect for each in self.effects)

    def part(self, name: str) -> PartSection:
        """Section of a part."""
        return self.parts[name]

    def dimensions(self, name: str) -> Dimensions:
        """Shape of a parametric part for cad."""
        part = self.parts[name]
        if not isinstance(part, ParametricPart):
            raise TypeError(f"{name} is a {part.shape}, which has no parameters")
        return part.parameters()

    def material(self, name: str) -> AnyMaterial | None:
        """Material of a part: of this file, or of the table in `stiffscope.cad.materials`; a matrix may have none."""
        wanted = getattr(self.parts[name], "material", None)
        return None if wanted is None else material(wanted, self.materials)

    def elastic_bodies(self) -> dict[str, ElasticBody]:
        """The bodies that are made of parts with two ends."""
        return {name: body for name, body in self.bodies.items() if isinstance(body, ElasticBody)}

    def bodies_of(self, part: str) -> tuple[str, ...]:
        """Names of the bodies made of a part."""
        return tuple(name for name, body in self.bodies.items() if getattr(body, "part", None) == part)

    def ends(self, body: str) -> tuple[str, ...]:
        """Names of a body's ends; none of a rigid one."""
        section = self.bodies.get(body)
        if isinstance(section, ElasticBody):
            return ENDS
        return self.parts[section.part].interface_names if isinstance(section, InterfaceBody) else ()

    def nodes(self) -> dict[str, str]:
        """What a joint may stand on: rigid bodies, ends of elastic ones and the ground, each with its body's name."""
        found = {GROUND: GROUND}
        for name in self.bodies:
            found |= {f"{name}.{end}": name for end in self.ends(name)} or {name: name}
        return found

    def drives(self) -> tuple[str, ...]:
        """Names of the driven joints."""
        return tuple(name for name, joint in self.joints.items() if getattr(joint, "drive", None) is not None)

    def members(self, place: str) -> tuple[str, ...]:
        """Names of the bodies and joints that a place means.

        A place is a body or joint, a `[groups]` name, a part (all bodies made of it), "drives" or "joints" (all that
        are not driven); the file's own groups come first. Raises InputError for a name that a body and a joint share.
        """
        if place in self.groups:
            return self.groups[place]
        element = find_element(place, self.bodies, self.joints)
        if element is not None:
            return (element,)
        if place in self.parts:
            return self.bodies_of(place)
        driven = self.drives()
        known = {"drives": driven, "joints": tuple(name for name in self.joints if name not in driven)}
        return known.get(place, ())


def find_element(place: str, bodies: Collection[str], joints: Collection[str]) -> str | None:
    """Body or joint that a place spells, by its name or as "bodies.NAME" or "joints.NAME"; None for neither.

    A joint whose name a body has too is "joints.NAME" throughout. Raises InputError where a place could be either.

    Parameters
    ----------
    place
        Name, or bodies.NAME or joints.NAME.
    bodies
        Names of the bodies.
    joints
        Names of the joints.

    """
    if place in bodies and f"joints.{place}" in joints:
        raise InputError(f'expected bodies.{place} or joints.{place}, got "{place}", which both have')
    if place in bodies or place in joints:
        return place
    section, _, name = place.partition(".")
    return name if name in {"bodies": bodies, "joints": joints}.get(section, ()) else None
