"""Mechanical effects of the vocabulary: what each changes in a robot's mechanism.

A mechanical effect adds compliance to named elements or moves their unloaded ends. One function of its internal
parameters says so; it serves both to build the robot that carries the effect and to differentiate it. Internal
parameters are such that the tool's motion is as linear in them as can be (``u = 1/factor - 1`` for a stiffness factor);
physical parameters are those of the vocabulary. The words are those of the Biglide, which its file has as groups.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.errors import InputError
from stiffscope.robot.description import RobotFile
from stiffscope.robot.sections import ElasticBody
from stiffscope.robot.vocabulary import LINKS, VOCABULARY
from stiffscope.vjm.mechanism import BASE, TOOL, Change, Mechanism
from stiffscope.vjm.network import elements_of
from stiffscope.vjm.screws import shift

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from numpy.typing import NDArray

    Array = NDArray[np.floating[Any]]
    Map = Callable[[Array], Array]

ALONG = np.eye(6)[0]
"""Along an elastic body, or along the axis of a joint: outward in the Biglide's drives."""
RADIAL = np.array([0.0, 1, 1, 0, 0, 0])
"""Across the axis of a joint."""
_EACH = np.eye(6)
_JOINT = np.array([RADIAL, ALONG, [0, 0, 0, 0, 1, 1]])  # radial, axial, tilting
_GUIDE = np.array([[0.0, 1, 0, 0, 0, 0], [0, 0, 1, 0, 0, 0], [0, 0, 0, 1, 1, 1]])  # lateral, vertical, angular
_OUTSIDE = {"robot", "instrument"}  # places that are no elements
_ELEMENTS = {"base": BASE, "platform": TOOL}  # places that are elements by another name
_ALL_ENTRIES = tuple((i, j) for i in range(6) for j in range(i, 6))
_SYMMETRIC_PLATE = ((0, 0), (1, 1), (1, 5), (2, 2), (2, 4), (3, 3), (4, 4), (5, 5))  # a part with two symmetry planes
_ENTRY_UNITS = ("m/N", "m/(N·m)", "rad/(N·m)")

Changes = dict[str, Change]
"""Changes by the element's name, in its own axes."""


@dataclass(frozen=True)
class NominalRobot:
    """A mechanism, and the robot file that it is made of, where effects look up places and materials."""

    mechanism: Mechanism
    robot: RobotFile

    @property
    def acceleration(self) -> float:
        """Of gravity, m/s²."""
        return float(np.linalg.norm(self.mechanism.gravity))

    @property
    def expansion(self) -> float:
        """Linear thermal expansion of the links' material along them, 1/K."""
        body = self.robot.bodies[LINKS[0]]
        material = self.robot.material(body.part) if isinstance(body, ElasticBody) else None
        if material is None:
            raise InputError(f"bodies.{LINKS[0]}: expected a part with a material that expands, got none")
        return material.expansion

    @cached_property
    def compliances(self) -> Mapping[str, Array]:
        """Compliance (6, 6) of every element, in its own axes at its own point."""
        return {element.name: element.compliance for element in elements_of(self.mechanism)}

    @property
    def link_length(self) -> float:
        """Length of a link, m."""
        link = self.mechanism.body(LINKS[0]).elastic
        if link is None:
            raise InputError(f"bodies.{LINKS[0]}: expected an elastic body, got a rigid one")
        return float(np.linalg.norm(link.tip - link.base))

    def elements(self, place: str) -> tuple[str, ...]:
        """Names of the elements that a place of the vocabulary means; none where the robot has no such place."""
        return (_ELEMENTS[place],) if place in _ELEMENTS else self.robot.members(place)

    def __reduce__(self) -> tuple[Any, ...]:
        plain = {f.name: getattr(self.robot, f.name) for f in fields(self.robot)}  # read-only mappings do not pickle
        plain = {name: dict(value) if isinstance(value, Mapping) else value for name, value in plain.items()}
        return _restored, (self.mechanism, plain)


def _restored(mechanism: Mechanism, robot: dict[str, Any]) -> NominalRobot:
    return NominalRobot(mechanism, RobotFile(**robot))


def _same(values: Array) -> Array:
    return values


@dataclass(frozen=True)
class MechanicalEffect:
    """A mechanical effect at a place of a nominal robot, with k parameters."""

    effect: str
    place: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    changes: Callable[[Array], Changes]
    """Changes of elements for internal parameters (k,)."""
    physical: Map = field(default=_same)
    """Physical parameters (k,) of internal ones."""
    internal: Map = field(default=_same)
    """Internal parameters (k,) of physical ones."""


def softening_of(factor: Array) -> Array:
    """Relative growth ``u`` of a compliance whose stiffness takes a factor."""
    return 1.0 / factor - 1.0


def stiffness_factor_of(softening: Array) -> Array:
    """Factor on a stiffness whose compliance grows by ``1 + u``."""
    return 1.0 / (1.0 + softening)


def growth_of(factor: Array) -> Array:
    """Relative growth of what takes a factor."""
    return factor - 1.0


def factor_of(growth: Array) -> Array:
    """Factor on what grows by a relative amount."""
    return 1.0 + growth


def softer(nominal: NominalRobot, names: Sequence[str], u: Array) -> Changes:
    """Compliances of elements grow by ``u[0]`` times their nominal."""
    return {name: Change(nominal.compliances[name] * u[0]) for name in names}


def added_diagonal(names: Sequence[str], pattern: Array, values: Array) -> Changes:
    """Diagonal compliances, ``pattern`` (k, 6) times the parameters (k,), are added at elements."""
    return {name: Change(np.diag(values @ pattern)) for name in names}


def moved(names: Sequence[str], direction: Array, values: Array) -> Changes:
    """Unloaded ends of elements move along a twist (6,) times the parameter."""
    return {name: Change(offset=direction * values[0]) for name in names}


def mechanical_effects(nominal: NominalRobot) -> tuple[MechanicalEffect, ...]:
    """Every mechanical effect of the vocabulary, at every place of a robot.

    Raises InputError for a robot that lacks one of the places.
    """
    for name, term in VOCABULARY.items():
        for place in set(term.places) - _OUTSIDE:
            if not nominal.elements(place):
                message = f"expected {place}, a place of the effect {name}, got none such"
                raise nominal.robot.refuse(("groups",), message)
    return tuple(_effects(nominal))


def _effects(nominal: NominalRobot) -> Iterator[MechanicalEffect]:
    def effect(name: str, place: str, changes: Callable[[Array], Changes], *maps: Map) -> MechanicalEffect:
        parameters = VOCABULARY[name].parameters
        if "slider" in name:
            parameters = parameters[:1]
        names, units = zip(*parameters, strict=True)
        return MechanicalEffect(name, place, names, units, changes, *maps)

    def stiffer(name: str, place: str) -> MechanicalEffect:
        return effect(name, place, partial(softer, nominal, nominal.elements(place)), stiffness_factor_of, softening_of)

    def added(name: str, place: str, pattern: Array) -> MechanicalEffect:
        return effect(name, place, partial(added_diagonal, nominal.elements(place), pattern))

    for place in VOCABULARY["actuator-stiffness"].places:
        yield stiffer("actuator-stiffness", place)
    yield added("joint-compliance", "joints", _JOINT)
    for place in VOCABULARY["link-stiffness"].places:
        yield stiffer("link-stiffness", place)
    yield effect("rigid-ends", "links", partial(_clamped_ends, nominal))
    sliders = partial(softer, nominal, nominal.elements("sliders"))
    yield effect("slider-compliance", "sliders", sliders, factor_of, growth_of)
    yield _slider_entries(nominal, _SYMMETRIC_PLATE)
    yield _slider_entries(nominal, _ALL_ENTRIES)
    yield added("guide-compliance", "carriages", _GUIDE)
    yield added("base-compliance", "base", _EACH)
    yield added("platform-compliance", "platform", _EACH)
    for name in ("encoder-offset", "link-length"):
        for place in VOCABULARY[name].places:
            yield effect(name, place, partial(moved, nominal.elements(place), ALONG))
    growth = nominal.expansion * nominal.link_length
    yield effect("thermal", "links", partial(moved, nominal.elements("links"), growth * ALONG))


def _clamped_ends(nominal: NominalRobot, values: Array) -> Changes:
    """Links whose ends are clamped over a length: the uniform section bends over the rest, seen from B_ij."""
    length = nominal.link_length
    clamped = float(np.clip(values[0], -0.2 * length, 0.45 * length))
    span = length - 2.0 * clamped
    to_end = shift([clamped, 0.0, 0.0])
    changes: Changes = {}
    for name in nominal.elements("links"):
        c = nominal.compliances[name]
        rates = np.diagonal(c) / length  # of the nominal uniform section: axial, shear y, z, torsion, bending y, z
        rates[1] -= c[5, 5] * length / 3.0
        rates[2] -= c[4, 4] * length / 3.0
        short, full = _cantilever(span, rates), _cantilever(length, rates)
        changes[name] = Change(to_end @ short @ to_end.T - full)
    return changes


def _cantilever(length: float, rates: Array) -> Array:
    """Compliance (6, 6) at the free end of a uniform beam with these compliances per metre (6,)."""
    c = np.diag(rates * length)
    c[1, 1] += rates[5] * length**3 / 3.0
    c[2, 2] += rates[4] * length**3 / 3.0
    c[1, 5] = c[5, 1] = rates[5] * length**2 / 2.0
    c[2, 4] = c[4, 2] = -rates[4] * length**2 / 2.0
    return c


def _slider_entries(nominal: NominalRobot, pairs: Sequence[tuple[int, int]]) -> MechanicalEffect:
    """Entries of the slider's compliance; internal parameters are multiples of sqrt(C_ii C_jj)."""
    sliders = nominal.elements("sliders")
    compliance = nominal.compliances[sliders[0]]
    root = np.sqrt(np.diagonal(compliance).clip(min=1e-30))
    scale = np.array([root[i] * root[j] for i, j in pairs])
    here = np.array([compliance[pair] for pair in pairs])

    def changes(values: Array) -> Changes:
        added = np.zeros((6, 6))
        for (i, j), value in zip(pairs, values * scale, strict=True):
            added[i, j] = added[j, i] = value
        return dict.fromkeys(sliders, Change(added))

    return MechanicalEffect(
        "slider-compliance",
        "sliders",
        tuple(f"c{i + 1}{j + 1}" for i, j in pairs),
        tuple(_ENTRY_UNITS[(i > 2) + (j > 2)] for i, j in pairs),
        changes,
        lambda values: here + values * scale,
        lambda entries: (entries - here) / scale,
    )


def changed(mechanism: Mechanism, changes: Changes) -> Mechanism:
    """The mechanism with elements changed. Raises InputError for an unknown element, or one that ends up indefinite.

    A drive that becomes stiffer takes its change itself: what is added to a joint's bearing must not be negative.
    """
    joints, bearings = list(mechanism.joints), dict(changes)
    for k, joint in enumerate(joints):
        change = changes.get(joint.name)
        along = 3 if joint.kind == "revolute" else 0
        if joint.drive is None or change is None or change.compliance is None or change.compliance[along, along] >= 0.0:
            continue
        left = 1.0 / joint.drive.stiffness + float(change.compliance[along, along])
        if left <= 0.0:
            raise InputError(f"{joint.name}: expected a drive that yields, got a compliance of {left:.6g}")
        joints[k] = replace(joint, drive=replace(joint.drive, stiffness=1.0 / left))
        rest = change.compliance.copy()
        rest[along, along] = 0.0
        bearings[joint.name] = replace(change, compliance=rest)
    return replace(mechanism, joints=tuple(joints)).changed(bearings)


def adopted(robot: NominalRobot, effect: str, place: str, parameters: Mapping[str, float]) -> NominalRobot:
    """Return the robot that carries a mechanical effect from now on.

    Parameters
    ----------
    robot
        The robot so far; effects that it has adopted before stay.
    effect, place, parameters
        In the words of `VOCABULARY`, SI; parameters that are left out keep their nominal values.

    Raises
    ------
    InputError
        For words that are not in the vocabulary, and for an effect that is none of the robot's.

    """
    if effect == "gravity":
        return robot
    if effect == "payload":
        raise InputError("payload: add its mass to bodies.platform.mass of the robot file")
    known = _named(robot, effect, place, parameters)
    if not parameters:
        raise InputError(f"{effect} @ {place}: expected parameters {', '.join(known.names)}, got none")
    if not parameters.get("factor", 1.0) > 0.0:
        raise InputError(f"{effect} @ {place}, factor: expected more than 0, got {parameters['factor']:g}")
    nominal = known.physical(np.zeros(len(known.names)))
    given = np.array([float(parameters.get(name, value)) for name, value in zip(known.names, nominal, strict=True)])
    changes = known.changes(known.internal(given))
    return replace(robot, mechanism=changed(robot.mechanism, changes))


def _named(robot: NominalRobot, effect: str, place: str, parameters: Mapping[str, float]) -> MechanicalEffect:
    """The effect with the fewest parameters that has these."""
    if effect not in VOCABULARY:
        raise InputError(f"effect: expected one of {', '.join(VOCABULARY)}, got {effect!r}")
    places = VOCABULARY[effect].places
    if place not in places:
        raise InputError(f"{effect}, place: expected one of {', '.join(places)}, got {place!r}")
    placed = [e for e in mechanical_effects(robot) if (e.effect, e.place) == (effect, place)]
    if not placed:
        raise InputError(f"{effect} @ {place}: no part of the robot; correct the readings (or the backlash) instead")
    fitting = [e for e in placed if set(parameters) <= set(e.names)]
    if not fitting:
        raise InputError(
            f"{effect}: expected parameters {', '.join(placed[0].names) or 'none'}, got {', '.join(parameters)}"
        )
    return min(fitting, key=lambda e: len(e.names))


def carried(mechanism: Mechanism, robot: RobotFile) -> Mechanism:
    """The mechanism with the effects that its file has adopted, in their order.

    Raises InputError, with the effect's line in the file, for what is no part of the robot.
    """
    nominal = NominalRobot(mechanism, robot)
    for number, effect in enumerate(robot.effects):
        try:
            nominal = adopted(nominal, effect.effect, effect.place, effect.parameters)
        except InputError as error:
            raise robot.refuse(("effects", number), str(error)) from error
    return nominal.mechanism
