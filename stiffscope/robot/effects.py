"""Mechanical effects of the vocabulary: what each changes in an elastic robot.

A mechanical effect adds compliance to named elements or moves their unloaded ends. One function of its internal
parameters says so; it serves both to build the robot that carries the effect and to differentiate it. Internal
parameters are such that the tool's motion is as linear in them as can be (``u = 1/factor - 1`` for a stiffness factor);
physical parameters are those of the vocabulary.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.errors import InputError
from stiffscope.robot.vocabulary import LINKS, VOCABULARY
from stiffscope.vjm.biglide import pose_at
from stiffscope.vjm.elastic import Node, Spring, edited, leaves
from stiffscope.vjm.screws import HALF_TURN, shift

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from numpy.typing import NDArray

    from stiffscope.vjm.biglide import Biglide

    Array = NDArray[np.floating[Any]]
    Map = Callable[[Array], Array]

_X, _Y = np.eye(6)[0], np.eye(6)[1]
_EACH = np.eye(6)
_JOINT = np.array([[1.0, 0, 1, 0, 0, 0], [0, 1, 0, 0, 0, 0], [0, 0, 0, 1, 0, 1]])  # radial, axial, tilting
_GUIDE = np.array([[0.0, 1, 0, 0, 0, 0], [0, 0, 1, 0, 0, 0], [0, 0, 0, 1, 1, 1]])  # lateral, vertical, angular
_OUTWARD = {"limb1": -_X, "limb2": _X, "stage": _Y}  # a drive's zero moves this way for a positive offset
_ALL_ENTRIES = tuple((i, j) for i in range(6) for j in range(i, 6))
_SYMMETRIC_PLATE = ((0, 0), (1, 1), (1, 5), (2, 2), (2, 4), (3, 3), (4, 4), (5, 5))  # a part with two symmetry planes
_ENTRY_UNITS = ("m/N", "m/(N·m)", "rad/(N·m)")


@dataclass(frozen=True)
class Change:
    """What an effect does to an element: compliance (6, 6) added, twist (6,) of its unloaded end, in its own axes."""

    compliance: Array | None = None
    offset: Array | None = None


Changes = dict[str, Change]
"""Changes by the element's name."""


@dataclass(frozen=True)
class NominalRobot:
    """An elastic robot, and what effects need to know of its file beside it."""

    elastic: Biglide
    acceleration: float
    """Of gravity, m/s²."""
    expansion: float
    """Linear thermal expansion of the links' material along them, 1/K."""

    @cached_property
    def compliances(self) -> Mapping[str, Array]:
        """Compliance (6, 6) of every spring, in its own axes at its own origin."""
        return {node.name: node.compliance for node in leaves(_mid_tree(self.elastic)) if isinstance(node, Spring)}

    @property
    def link_length(self) -> float:
        """Length of a link, m."""
        return self.elastic.geometry.L


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
    """Every mechanical effect of the vocabulary, at every place of a robot."""
    return tuple(_effects(nominal))


def _effects(nominal: NominalRobot) -> Iterator[MechanicalEffect]:
    def effect(name: str, place: str, changes: Callable[[Array], Changes], *maps: Map) -> MechanicalEffect:
        parameters = VOCABULARY[name].parameters
        if "slider" in name:
            parameters = parameters[:1]
        names, units = zip(*parameters, strict=True)
        return MechanicalEffect(name, place, names, units, changes, *maps)

    def stiffer(name: str, place: str, elements: Sequence[str]) -> MechanicalEffect:
        return effect(name, place, partial(softer, nominal, elements), stiffness_factor_of, softening_of)

    drives = {place: [f"{place}.actuator"] for place in ("stage", "limb1", "limb2")}
    joints = [f"{link}.{end}" for link in LINKS for end in ("joint_a", "joint_b")]
    for place, names in {**drives, "limbs": drives["limb1"] + drives["limb2"]}.items():
        yield stiffer("actuator-stiffness", place, names)
    yield effect("joint-compliance", "joints", partial(added_diagonal, joints, _JOINT))
    links: dict[str, Sequence[str]] = {"links": LINKS, **{link: [link] for link in LINKS}}
    for place, names in links.items():
        yield stiffer("link-stiffness", place, names)
    yield effect("rigid-ends", "links", partial(_clamped_ends, nominal))
    sliders = partial(softer, nominal, ["limb1.slider", "limb2.slider"])
    yield effect("slider-compliance", "sliders", sliders, factor_of, growth_of)
    yield _slider_entries(nominal, _SYMMETRIC_PLATE)
    yield _slider_entries(nominal, _ALL_ENTRIES)
    carriages = ["limb1.carriage", "limb2.carriage"]
    yield effect("guide-compliance", "carriages", partial(added_diagonal, carriages, _GUIDE))
    yield effect("base-compliance", "base", partial(added_diagonal, ["base"], _EACH))
    yield effect("platform-compliance", "platform", partial(added_diagonal, ["platform"], _EACH))
    for place, names in drives.items():
        yield effect("encoder-offset", place, partial(moved, names, _OUTWARD[place]))
    for place, names in links.items():
        yield effect("link-length", place, partial(moved, names, _X))
    growth = nominal.expansion * nominal.link_length
    yield effect("thermal", "links", partial(moved, LINKS, growth * _X))


def _clamped_ends(nominal: NominalRobot, values: Array) -> Changes:
    """Links whose ends are clamped over a length: the uniform section bends over the rest, seen from B_ij."""
    length = nominal.link_length
    clamped = float(np.clip(values[0], -0.2 * length, 0.45 * length))
    span = length - 2.0 * clamped
    to_end = shift([clamped, 0.0, 0.0])
    changes: Changes = {}
    for name in LINKS:
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
    compliance = nominal.compliances["limb1.slider"]
    root = np.sqrt(np.diagonal(compliance).clip(min=1e-30))
    scale = np.array([root[i] * root[j] for i, j in pairs])
    here = np.array([compliance[pair] for pair in pairs])

    def changes(values: Array) -> Changes:
        added = np.zeros((6, 6))
        for (i, j), value in zip(pairs, values * scale, strict=True):
            added[i, j] = added[j, i] = value
        return {"limb1.slider": Change(added), "limb2.slider": Change(HALF_TURN @ added @ HALF_TURN)}

    return MechanicalEffect(
        "slider-compliance",
        "sliders",
        tuple(f"c{i + 1}{j + 1}" for i, j in pairs),
        tuple(_ENTRY_UNITS[(i > 2) + (j > 2)] for i, j in pairs),
        changes,
        lambda values: here + values * scale,
        lambda entries: (entries - here) / scale,
    )


def _mid_tree(robot: Biglide) -> Node:
    return robot.tree(pose_at(robot.geometry, np.radians(45.0)))


def changed(tree: Node, changes: Changes) -> Node:
    """The tree with elements changed. Raises InputError for an element that is no spring, or ends up indefinite."""
    for name, change in changes.items():
        tree = edited(tree, name, partial(_with_change, change=change))
    return tree


def _with_change(node: Node, change: Change) -> Node:
    if not isinstance(node, Spring):
        raise InputError(f"{node.name}: an effect needs a spring here")
    offset = node.offset
    if change.offset is not None:
        offset = change.offset if offset is None else offset + change.offset
    compliance = node.compliance if change.compliance is None else node.compliance + change.compliance
    return replace(node, compliance=compliance, offset=offset)


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
        raise InputError("payload: add its mass to platform.mass of the robot file")
    known = _named(robot, effect, place, parameters)
    if not parameters:
        raise InputError(f"{effect} @ {place}: expected parameters {', '.join(known.names)}, got none")
    if not parameters.get("factor", 1.0) > 0.0:
        raise InputError(f"{effect} @ {place}, factor: expected more than 0, got {parameters['factor']:g}")
    nominal = known.physical(np.zeros(len(known.names)))
    given = np.array([float(parameters.get(name, value)) for name, value in zip(known.names, nominal, strict=True)])
    changes = known.changes(known.internal(given))
    changed(_mid_tree(robot.elastic), changes)  # raises for a compliance that is none
    return replace(robot, elastic=robot.elastic.edited(partial(changed, changes=changes)))


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
