"""The nominal robot of a diagnosis: mechanism, robot file, and places where effects may act."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.robot.part_dimensions import is_beam
from stiffscope.vjm.elements.laws import without_laws
from stiffscope.vjm.network.network import list_elements

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from stiffscope.robot.file.description import RobotFile
    from stiffscope.robot.part_dimensions import PartDimension
    from stiffscope.runtime.types import Array
    from stiffscope.vjm.model.bodies import Elastic
    from stiffscope.vjm.model.joints import Joint
    from stiffscope.vjm.model.mechanism import Mechanism


_ALONG = (
    1e-9  # permitted offset of a body's end from its x axis, relative to its length
)


@dataclass(frozen=True)
class Place:
    """A name for one or more elements, and other names for the same elements."""

    name: str
    members: tuple[str, ...] = ()
    others: tuple[str, ...] = ()

    @property
    def sole(self) -> str:
        """Its only element; empty if it has several."""
        return self.members[0] if len(self.members) == 1 else ""


@dataclass(frozen=True)
class NominalRobot:
    """A mechanism and its robot file, where effects look up places and materials."""

    mechanism: Mechanism
    robot: RobotFile
    tested: Mapping[str, Callable[[], tuple[PartDimension, ...]]] = field(
        default_factory=dict
    )
    """By part, what gives its parameters by virtual experiments: made where they are asked for."""

    @cached_property
    def beams(self) -> tuple[str, ...]:
        """Parts whose matrix equals that of beam theory."""
        two = (
            name for name, part in self.robot.parts.items() if not part.interface_names
        )
        robot = self.robot
        sources = self.elastic_sources
        used = ((part, body) for part in two for body in robot.bodies_of(part)[:1])
        return tuple(
            part
            for part, body in used
            if is_beam(robot, part, sources[body].compliance)
        )

    @property
    def acceleration(self) -> float:
        """Magnitude of the gravitational acceleration, m/s²."""
        return float(np.linalg.norm(self.mechanism.gravity))

    @cached_property
    def compliances(self) -> Mapping[str, Array]:
        """Compliance (6, 6) of each element, own axes and point; (6m, 6m) with m + 1 ends."""
        by_name = {
            e.name: e.compliance for e in list_elements(without_laws(self.mechanism))
        }
        return by_name | {
            name: elastic.compliance for name, elastic in self.elastic_sources.items()
        }

    @cached_property
    def elastic_sources(self) -> Mapping[str, Elastic]:
        """Elastic properties of each elastic body."""
        return {
            b.name: b.elastic for b in self.mechanism.bodies if b.elastic is not None
        }

    @cached_property
    def links(self) -> tuple[str, ...]:
        """Elastic bodies that have a length: two ends, on the x axis."""
        two = (
            name
            for name, elastic in self.elastic_sources.items()
            if len(elastic.ends) == 2
        )
        off = ((name, np.abs(self.growth(name)[1:]).max()) for name in two)
        return tuple(name for name, most in off if most <= _ALONG * self.length(name))

    def length(self, body: str) -> float:
        """Return the length of a two-ended elastic body, m."""
        elastic = self.elastic_sources[body]
        return float(np.linalg.norm(elastic.tip - elastic.base))

    def growth(self, body: str) -> Array:
        """Return end motions (6m,) relative to the first end per unit uniform strain; part axes."""
        elastic = self.elastic_sources[body]
        away = (elastic.places[1:] - elastic.places[0]) @ elastic.axes
        return np.hstack([away, np.zeros_like(away)]).ravel()

    def part_of(self, body: str) -> str:
        """Return the part of an elastic body; the body's own name if it has its own matrix."""
        section = self.robot.bodies.get(body)
        return getattr(section, "part", body)

    def expansion(self, body: str) -> float | None:
        """Return the linear thermal expansion of a body's material, 1/K; None without material."""
        part = getattr(self.robot.bodies.get(body), "part", None)
        material = None if part is None else self.robot.material(part)
        return None if material is None else material.expansion

    def factor(self, drive: str) -> float:
        """Return the factor within which a drive's stiffness is known; 1 without a tolerance."""
        joint = self.driven[drive]
        stiffness = np.inf if joint.drive is None else joint.drive.stiffness
        return float(
            np.exp(self._tolerance("joints", drive, "drive", "stiffness") / stiffness)
        )

    def mass_sigma(self, body: str) -> float:
        """Return the standard uncertainty of a body's mass, kg; infinite without a tolerance."""
        return self._tolerance("bodies", body, "mass") or np.inf

    def _tolerance(self, section: str, name: str, *keys: str) -> float:
        """Return the tolerance of a value in the file, SI; 0 if none is given."""
        copied = self.robot.copied.get(name)
        name = name if copied is None else copied.name
        return self.robot.tolerances.get((section, name, *keys), 0.0)

    @cached_property
    def driven(self) -> Mapping[str, Joint]:
        """Joints with a drive."""
        return {joint.name: joint for joint in self.mechanism.drives}

    def places(self, fit: Iterable[str]) -> tuple[Place, ...]:
        """Return the sets and single elements with all members in ``fit``; sets come first.

        `drives` and `joints` are reduced to members in ``fit``. Names of the same elements give one
        place, named by group, part or element; a single drive or joint of several by element.
        """
        able = dict.fromkeys(fit)
        robot = self.robot
        sets = ((name, robot.members(name)) for name in (*robot.groups, *robot.parts))
        named = [(name, members) for name, members in sets if able.keys() >= {*members}]
        whole = {name: robot.members(name) for name in ("drives", "joints")}
        whole = {
            name: members for name, members in whole.items() if name not in robot.groups
        }
        fitting = {
            name: tuple(m for m in members if m in able)
            for name, members in whole.items()
        }
        lone = [
            name
            for name, members in fitting.items()
            if len(members) == 1 < len(whole[name])
        ]
        named += [
            (name, members) for name, members in fitting.items() if name not in lone
        ]
        named += [(name, (name,)) for name in able]
        named += [(name, fitting[name]) for name in lone]
        alike: dict[frozenset[str], dict[str, tuple[str, ...]]] = {}
        for name, members in named:
            if members:
                alike.setdefault(frozenset(members), {}).setdefault(name, members)
        first = ((*names, next(iter(names.values()))) for names in alike.values())
        return tuple(
            Place(name, members, tuple(others)) for name, *others, members in first
        )

    def __reduce__(self) -> tuple[Any, ...]:
        given = {
            item.name: getattr(self.robot, item.name) for item in fields(self.robot)
        }
        plain = {
            name: dict(value)
            for name, value in given.items()
            if isinstance(value, Mapping)
        }
        robot = replace(self.robot, **plain)  # read-only mappings do not pickle
        return NominalRobot, (
            self.mechanism,
            robot,
        )  # experiments belong to this process
