"""A robot read from its file: checked, copies made, expressions evaluated; SI, immutable."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from stiffscope.cad.materials import AnyMaterial, material
from stiffscope.errors import InputError, require
from stiffscope.robot.file import sections
from stiffscope.robot.file.parse import Source
from stiffscope.robot.file.quantities import ANGLE, LENGTH
from stiffscope.runtime.brief import describe_briefly

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping

    import numpy as np

    from stiffscope.errors import Key
    from stiffscope.robot.file.part_sections import PartSection
    from stiffscope.robot.file.quantities import Dimension

GROUND = "ground"
ENDS = ("base", "tip")
HOME = "home"  # name of the pose that the file describes


@dataclass(frozen=True)
class Turned:
    """Original of a copied body or joint: its name, and the rotation (3, 3) to the copy."""

    name: str
    rotation: np.ndarray


@dataclass(frozen=True)
class RobotFile:
    """Content of a robot file; a joint named like a body is "joints.NAME", so names are unique.

    `copied`: originals of the bodies and joints made by `[[copies]]`, by name.

    `tolerances`: of values written with a tolerance ("20 mm ± 0.1 mm"), SI, by key.
    """

    __repr__ = describe_briefly

    name: str
    parts: Mapping[str, PartSection]
    bodies: Mapping[str, sections.BodySection]
    joints: Mapping[str, sections.JointSection]
    tool: sections.ToolSection
    parameters: Mapping[str, float] = field(default_factory=dict)
    groups: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    gravity: sections.GravitySection | None = None
    poses: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    map: sections.MapSection | None = None
    materials: Mapping[str, AnyMaterial] = field(default_factory=dict)
    effects: tuple[sections.Effect, ...] = ()
    copied: Mapping[str, Turned] = field(default_factory=dict)
    tolerances: Mapping[Key, float] = field(default_factory=dict)
    source: Source = field(default_factory=lambda: Source(Path(), ""), compare=False)
    home: tuple[float, ...] = field(default=(), compare=False)
    """Pose that the file describes, m and rad; empty until the file is checked."""

    @property
    def path(self) -> Path:
        """Path of the file."""
        return self.source.path

    @property
    def known_poses(self) -> dict[str, tuple[float, ...]]:
        """Poses by name: home, and those of `[poses]`, which may name another one so."""
        return {HOME: self.home, **self.poses}

    def refuse(self, key: Key, message: str) -> InputError:
        """Return an error for a key that names its `--set` override, or file and line."""
        return self.source.refuse(key, message)

    def carries(self, effect: str) -> bool:
        """Return whether the robot has adopted an effect of this kind."""
        return any(known.effect == effect for known in self.effects)

    def part(self, name: str) -> PartSection:
        """Return the section of a part."""
        return self.parts[name]

    def material(self, name: str) -> AnyMaterial | None:
        """Return a part's material, from this file or `stiffscope.cad.materials`, or None."""
        wanted = getattr(self.parts[name], "material", None)
        return None if wanted is None else material(wanted, self.materials)

    def elastic_bodies(self) -> dict[str, sections.ElasticBody]:
        """Return the bodies between a base and a tip, by name."""
        bodies = self.bodies.items()
        return {
            name: body
            for name, body in bodies
            if isinstance(body, sections.ElasticBody)
        }

    def bodies_of(self, part: str) -> tuple[str, ...]:
        """Return the names of the bodies made of a part."""
        bodies = self.bodies.items()
        return tuple(
            name for name, body in bodies if getattr(body, "part", None) == part
        )

    def ends(self, body: str) -> tuple[str, ...]:
        """Return the names of a body's ends; empty if it is rigid."""
        section = self.bodies.get(body)
        if isinstance(section, sections.InterfaceBody):
            return self.parts[section.part].interface_names
        return ENDS if isinstance(section, sections.ElasticBody) else ()

    def nodes(self) -> dict[str, str]:
        """Return the body of each node for joints: rigid bodies, ends of elastic ones, ground."""
        places = {GROUND: GROUND}
        for name in self.bodies:
            places |= {f"{name}.{end}": name for end in self.ends(name)} or {name: name}
        return places

    def drives(self) -> tuple[str, ...]:
        """Return the names of the driven joints."""
        return tuple(
            name for name, joint in self.joints.items() if getattr(joint, "drive", None)
        )

    def dimension_of(self, coordinate: str) -> Dimension:
        """Return what a coordinate of the tool, or of a drive, "q:JOINT", measures: a length or an angle."""
        joint = self.joints.get(coordinate.removeprefix("q:"))
        turns = (
            coordinate in sections.AXES[3:] if joint is None else joint.describes.turns
        )
        return ANGLE if turns else LENGTH

    def members(self, place: str) -> tuple[str, ...]:
        """Return the names of the bodies and joints at a place.

        A place is a name in `[groups]` (searched first), a body or joint, a part (all its bodies),
        "drives" or "joints" (all not driven). Raises InputError if a name is ambiguous.
        """
        if place in self.groups:
            return self.groups[place]
        element = find_element(place, self.bodies, self.joints)
        if element is not None:
            return (element,)
        if place in self.parts:
            return self.bodies_of(place)
        driven = self.drives()
        if place == "joints":
            return tuple(name for name in self.joints if name not in driven)
        return driven if place == "drives" else ()


def find_element(
    place: str, bodies: Collection[str], joints: Collection[str]
) -> str | None:
    """Return the body or joint at a place: NAME, "bodies.NAME" or "joints.NAME"; None if neither.

    A joint named like a body is always "joints.NAME". Raises InputError if a place is ambiguous.

    Parameters
    ----------
    place
        Name, "bodies.NAME" or "joints.NAME".
    bodies
        Names of the bodies.
    joints
        Names of the joints.
    """
    require(
        not (place in bodies and f"joints.{place}" in joints),
        "",
        f"bodies.{place} or joints.{place}",
        f'"{place}", which both have',
    )
    if place in bodies or place in joints:
        return place
    section, _, name = place.partition(".")
    return (
        name if name in {"bodies": bodies, "joints": joints}.get(section, ()) else None
    )
