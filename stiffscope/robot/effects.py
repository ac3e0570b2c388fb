"""Mechanical effects at the places of any robot: what each changes in the robot's mechanism.

A mechanical effect adds compliance to named elements or moves their unloaded ends. One function of its internal
parameters says so; it serves both to build the robot that carries the effect and to differentiate it. Internal
parameters are such that the tool's motion is as linear in them as can be (``u = 1/factor - 1`` for a stiffness factor);
physical parameters are those of the vocabulary. Places are the elements of the robot's file, its groups, its parts,
`drives` and `joints`; sets come before single elements, and names for the same elements are one effect.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, partial
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.errors import InputError
from stiffscope.robot.file.description import RobotFile
from stiffscope.robot.file.sections import ElasticBody
from stiffscope.robot.part_dimensions import beam_dimensions, is_beam
from stiffscope.robot.vocabulary import COUPLED, EFFECTS
from stiffscope.vjm.checks import BASE, TOOL
from stiffscope.vjm.mechanism import Change, Mechanism
from stiffscope.vjm.network import list_elements
from stiffscope.vjm.screws import shift

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from numpy.typing import NDArray

    from stiffscope.robot.part_dimensions import PartDimension
    from stiffscope.vjm.bodies import Elastic
    from stiffscope.vjm.joints import Joint

    Array = NDArray[np.floating[Any]]
    Map = Callable[[Array], Array]

ALONG = np.eye(6)[0]
"""Along an elastic body, or along the axis of a joint."""
ABOUT = np.eye(6)[3]
"""About the axis of a joint."""
_RADIAL = np.array([0.0, 1, 1, 0, 0, 0])
_ROTATIONS = np.array([0.0, 0, 0, 1, 1, 1])
_EACH = np.eye(6)
_GUIDE = {"lateral": _EACH[1], "vertical": _EACH[2], "angular": _ROTATIONS}
_ELEMENTS = {"base": (BASE,), "tool": (TOOL,)}  # places that are elements by another name
_ALL_ENTRIES = tuple((i, j) for i in range(6) for j in range(i, 6))
_SYMMETRIC_PLATE = ((0, 0), (1, 1), (1, 5), (2, 2), (2, 4), (3, 3), (4, 4), (5, 5))  # a part with two symmetry planes
_ENTRY_UNITS = ("m/N", "m/(N·m)", "rad/(N·m)")
_ROUNDING = 1e-8  # of the largest yield of a support: what one that does not turn about some axis is given
_PAIRS = tuple(np.array(list(combinations((3, 4, 5), 2))).T)  # rows and columns of the couplings of rotations
_FOUNDATION_UNIT = 1e-11  # m³/N: internal unit of what a foundation yields, of the size of a bolted contact's
_RIGID = 1e-30  # m³/N: a foundation that does not yield
_RIDGE = 1e-9  # relative, by which a compliance is kept positive definite
_NO_COMPLIANCE = 1e-30  # m/N, rad/(N·m): of a direction that does not yield
_UNIFORM = 0.02  # relative, to which a uniform beam's entries agree
_FIRST_FORMAT = {  # words of the first campaign format: effect and place as now, where the robot has such a place
    ("slider-compliance", "sliders"): ("part-compliance", "sliders"),
    ("platform-compliance", "platform"): ("platform-compliance", "tool"),
}


def _no_experiments() -> dict[str, Callable[[], tuple[PartDimension, ...]]]:
    return {}


Changes = dict[str, Change]
"""Changes by the element's name, in its own axes."""


@dataclass(frozen=True)
class Place:
    """A name for one or more elements, and the other names for the very same."""

    name: str
    members: tuple[str, ...]
    others: tuple[str, ...] = ()


@dataclass(frozen=True)
class NominalRobot:
    """A mechanism, and the robot file that it is made of, where effects look up places and materials."""

    mechanism: Mechanism
    robot: RobotFile
    tested: Mapping[str, Callable[[], tuple[PartDimension, ...]]] = field(default_factory=_no_experiments)
    """By part, what gives its parameters by virtual experiments: made where they are asked for."""

    @cached_property
    def beams(self) -> tuple[str, ...]:
        """Parts whose matrix is that of beam theory."""
        found = {part: self.robot.bodies_of(part) for part in self.robot.parts}
        return tuple(
            p for p, bodies in found.items() if bodies and is_beam(self.robot, p, self.elastic[bodies[0]].compliance)
        )

    @property
    def acceleration(self) -> float:
        """Of gravity, m/s²."""
        return float(np.linalg.norm(self.mechanism.gravity))

    @cached_property
    def compliances(self) -> Mapping[str, Array]:
        """Compliance (6, 6) of every element, in its own axes at its own point."""
        return {element.name: element.compliance for element in list_elements(self.mechanism)}

    @cached_property
    def elastic(self) -> Mapping[str, Elastic]:
        """What makes each elastic body elastic."""
        return {body.name: body.elastic for body in self.mechanism.bodies if body.elastic is not None}

    def length(self, body: str) -> float:
        """Length of an elastic body, m."""
        elastic = self.elastic[body]
        return float(np.linalg.norm(elastic.tip - elastic.base))

    def expansion(self, body: str) -> float | None:
        """Linear thermal expansion of an elastic body's material, 1/K; None where its part has no material."""
        section = self.robot.bodies.get(body)
        material = self.robot.material(section.part) if isinstance(section, ElasticBody) else None
        return None if material is None else material.expansion

    @cached_property
    def driven(self) -> Mapping[str, Joint]:
        """Joints with a drive."""
        return {joint.name: joint for joint in self.mechanism.drives}

    def elements(self, place: str) -> tuple[str, ...]:
        """Names of the elements that a place means; none where the robot has no such place."""
        return _ELEMENTS[place] if place in _ELEMENTS else self.robot.members(place)

    def places(self, fit: Iterable[str]) -> tuple[Place, ...]:
        """Sets and single elements, all of whose members are among those that fit; sets come first.

        Of `drives` and `joints`, those members that fit. Several names for the same elements make one place: by a
        group's name, else a part's, else the element's own, which a single one of several drives or joints has first.
        """
        able = dict.fromkeys(fit)
        named: list[tuple[str, tuple[str, ...]]] = []
        for name in (*self.robot.groups, *self.robot.parts):
            members = self.robot.members(name)
            if members and all(each in able for each in members):
                named.append((name, members))
        whole = {name: self.robot.members(name) for name in ("drives", "joints") if name not in self.robot.groups}
        fitting = {name: tuple(each for each in members if each in able) for name, members in whole.items()}
        lone = [name for name, members in fitting.items() if len(members) == 1 < len(whole[name])]
        named += [(name, members) for name, members in fitting.items() if name not in lone]
        named += [(name, (name,)) for name in able]
        named += [(name, fitting[name]) for name in lone]
        by_members: dict[frozenset[str], list[tuple[str, tuple[str, ...]]]] = {}
        for name, members in named:
            if members:
                by_members.setdefault(frozenset(members), []).append((name, members))
        return tuple(
            Place(names[0][0], names[0][1], tuple(dict.fromkeys(n for n, _ in names[1:] if n != names[0][0])))
            for names in by_members.values()
        )

    def __reduce__(self) -> tuple[Any, ...]:
        plain = {f.name: getattr(self.robot, f.name) for f in fields(self.robot)}  # read-only mappings do not pickle
        plain = {name: dict(value) if isinstance(value, Mapping) else value for name, value in plain.items()}
        return _restored, (self.mechanism, plain)  # without experiments, which belong to this process


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
    members: tuple[str, ...] = ()
    """The elements that it changes."""
    others: tuple[str, ...] = ()
    """Other names, as `effect @ place`, for the very same."""


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
    """Compliances of bodies grow by ``u[0]`` times their nominal, those of driven joints along their drives alone."""
    out: Changes = {}
    for name in names:
        if name in nominal.driven:
            axis = along_drive(nominal.driven[name])
            out[name] = Change(np.outer(axis, axis) * float(axis @ nominal.compliances[name] @ axis) * u[0])
        else:
            out[name] = Change(nominal.compliances[name] * u[0])
    return out


def along_drive(joint: Joint) -> Array:
    """Direction (6,) in a driven joint's axes that its drive acts along: a slide, or a turn about its axis."""
    return ABOUT if joint.kind == "revolute" else ALONG


def added_diagonal(patterns: Mapping[str, Array], values: Array) -> Changes:
    """Diagonal compliances, each element's pattern (k, 6) times the parameters (k,), are added."""
    return {name: Change(np.diag(values @ pattern)) for name, pattern in patterns.items()}


def support_compliance(values: Array) -> Array:
    """Compliance (6, 6) of a support: its diagonal (6,), and its rotations' couplings where there are nine values."""
    compliance = np.diag(values[:6])
    if len(values) > 6:
        compliance[_PAIRS] = compliance[_PAIRS[::-1]] = values[6:]
    return compliance


def possible_support(values: Array) -> Array:
    """The nearest values (9,) of which a support can be: none of its rotations is negative, about whatever axis.

    A support that turns about a single axis is at the edge of these: readings put it beyond as often as not.
    """
    size, axes = np.linalg.eigh(support_compliance(values)[3:, 3:])
    turned = np.zeros((6, 6))
    turned[3:, 3:] = (axes * np.maximum(size, _ROUNDING * max(size[-1], 0.0))) @ axes.T
    return np.concatenate([values[:3], turned.diagonal()[3:], turned[_PAIRS]])


def yielding_support(element: str, values: Array) -> Changes:
    """A support yields by six or nine values."""
    possible = possible_support(values) if len(values) > 6 else values
    return {element: Change(support_compliance(possible))}


def moved(directions: Mapping[str, Array], values: Array) -> Changes:
    """Unloaded ends of elements move along their own twists (6,) times the parameter."""
    return {name: Change(offset=direction * values[0]) for name, direction in directions.items()}


def held_patterns(joint: Joint) -> dict[str, Array]:
    """What a joint's bearing yields along, (6,) in the joint's axes, by the words of `joint-compliance`."""
    held, turns = joint.held
    mask = np.zeros(6)
    mask[[*held, *(3 + k for k in turns)]] = 1.0
    axial = ALONG if joint.axis is not None else 0.0 * ALONG
    words = {"radial": _RADIAL + (ALONG - axial), "axial": axial, "tilting": _ROTATIONS}
    return {word: pattern * mask for word, pattern in words.items() if (pattern * mask).any()}


def mechanical_effects(nominal: NominalRobot) -> tuple[MechanicalEffect, ...]:
    """Every mechanical effect at every place of a robot, each set or element under one name; sets come first."""
    return tuple(_effects(nominal))


def _effects(nominal: NominalRobot) -> Iterator[MechanicalEffect]:
    joints = {joint.name: joint for joint in nominal.mechanism.joints}
    bearings = {name: held_patterns(j) for name, j in joints.items() if j.kind != "prismatic" or j.drive is None}
    guides = [name for name, joint in joints.items() if joint.kind == "prismatic"]
    drives, bodies = list(nominal.driven), list(nominal.elastic)

    def effect(
        name: str, place: Place, changes: Callable[[Array], Changes], names: Sequence[str] = (), *maps: Map
    ) -> MechanicalEffect:
        given = {key: unit for key, unit in EFFECTS[name] if not names or key in names}
        others = tuple(f"{name} @ {other}" for other in place.others)
        return MechanicalEffect(name, place.name, tuple(given), tuple(given.values()), changes, *maps,
                                members=place.members, others=others)  # fmt: skip

    for place in nominal.places(drives):
        work = partial(softer, nominal, place.members)
        yield effect("actuator-stiffness", place, work, (), stiffness_factor_of, softening_of)
    for place in nominal.places(bearings):
        words = [w for w in ("radial", "axial", "tilting") if any(w in bearings[m] for m in place.members)]
        patterns = {m: np.array([bearings[m].get(w, np.zeros(6)) for w in words]) for m in place.members}
        yield effect("joint-compliance", place, partial(added_diagonal, patterns), words)
    yield from _of_parts(nominal, bodies, effect)
    for place in nominal.places(guides):
        patterns = dict.fromkeys(place.members, np.array(list(_GUIDE.values())))
        yield effect("guide-compliance", place, partial(added_diagonal, patterns))
    yield from _of_supports(nominal, effect)
    for place in nominal.places(drives):
        directions: dict[str, Array] = {name: along_drive(nominal.driven[name]) for name in place.members}
        yield effect("encoder-offset", place, partial(moved, directions))
    for place in nominal.places(bodies):
        yield effect("link-length", place, partial(moved, dict.fromkeys(place.members, np.array(ALONG))))
    growth = {name: (nominal.expansion(name) or 0.0) * nominal.length(name) for name in bodies}
    warm = [name for name in bodies if growth[name]]
    places = nominal.places(warm)
    if warm and len(warm) > 1 and not any(set(place.members) == set(warm) for place in places):
        places = (Place("robot", tuple(warm)), *places)
    for place in places:
        named = place if set(place.members) != set(warm) else replace(place, others=_with_robot(place))
        grown: dict[str, Array] = {name: growth[name] * ALONG for name in place.members}
        yield effect("thermal", named, partial(moved, grown))


def _with_robot(place: Place) -> tuple[str, ...]:
    return place.others if place.name == "robot" else (*place.others, "robot")


def _of_supports(nominal: NominalRobot, effect: Any) -> Iterator[MechanicalEffect]:
    """Base and tool yield, without and with coupled rotations."""
    tool = replace(Place("tool", (TOOL,)), others=("platform",) if nominal.mechanism.tool.body == "platform" else ())
    for name, place in (("base-compliance", Place("base", (BASE,))), ("platform-compliance", tool)):
        for coupled in ((), COUPLED):
            words = [word for word, _ in EFFECTS[name] if word in coupled or word not in COUPLED]
            found = effect(name, place, partial(yielding_support, place.members[0]), words)
            yield replace(found, physical=possible_support) if coupled else found


def _of_parts(nominal: NominalRobot, bodies: list[str], effect: Any) -> Iterator[MechanicalEffect]:
    """Effects on the compliance of elastic bodies."""
    yielding = [name for name in bodies if nominal.compliances[name].any()]
    uniform = [name for name in yielding if _is_uniform(nominal.compliances[name], nominal.length(name))]
    places = nominal.places(yielding)
    for place in places:
        work = partial(softer, nominal, place.members)
        part = effect("part-compliance", place, work, ("factor",), factor_of, growth_of)
        plain = effect("link-stiffness", place, work, (), stiffness_factor_of, softening_of)
        old = _first_format(part)
        if old is not None:
            yield replace(old, others=(f"link-stiffness @ {place.name}", *old.others))
        else:
            yield replace(plain, others=(*plain.others, f"part-compliance @ {place.name}"))
    for place in nominal.places(uniform):
        yield effect("rigid-ends", place, partial(_clamped_ends, nominal, place.members))
    for place in places:
        alike = len({_body_part(nominal, name) for name in place.members}) == 1
        if not alike:
            continue
        for pairs in (_SYMMETRIC_PLATE, _ALL_ENTRIES) if len(place.members) > 1 else (_SYMMETRIC_PLATE,):
            entries = _entries(nominal, place, pairs)
            yield _first_format(entries) or entries


def _first_format(effect: MechanicalEffect) -> MechanicalEffect | None:
    """The effect in the words of the first format, where it has such."""
    for (old, place), now in _FIRST_FORMAT.items():
        if (effect.effect, effect.place) == now and old != effect.effect:
            return replace(effect, effect=old, place=place, others=(f"{effect.effect} @ {place}", *effect.others))
    return None


def _body_part(nominal: NominalRobot, name: str) -> str:
    section = nominal.robot.bodies.get(name)
    return section.part if isinstance(section, ElasticBody) else name


def _is_uniform(c: Array, length: float) -> bool:
    """Whether a compliance (6, 6) is that of a uniform beam of this length, clamped at its base."""
    bent = (c[5, 5] * length / 2.0, -c[4, 4] * length / 2.0)
    near = all(
        abs(c[i, j] - b) <= _UNIFORM * abs(b) and abs(b) > 0.0 for (i, j), b in zip(((1, 5), (2, 4)), bent, strict=True)
    )
    sheared = (c[1, 1] - c[5, 5] * length**2 / 3.0, c[2, 2] - c[4, 4] * length**2 / 3.0)
    return near and min(sheared) >= -_UNIFORM * min(c[1, 1], c[2, 2])


def _clamped_ends(nominal: NominalRobot, names: Sequence[str], values: Array) -> Changes:
    """Uniform bodies whose ends are clamped over a length: the section bends over the rest, seen from the tip."""
    changes: Changes = {}
    for name in names:
        c, length = nominal.compliances[name], nominal.length(name)
        clamped = float(np.clip(values[0], -0.2 * length, 0.45 * length))
        to_end = shift([clamped, 0.0, 0.0])
        rates = np.diagonal(c) / length  # of the nominal uniform section: axial, shear y, z, torsion, bending y, z
        rates[1] -= c[5, 5] * length / 3.0
        rates[2] -= c[4, 4] * length / 3.0
        short, full = _cantilever(length - 2.0 * clamped, rates), _cantilever(length, rates)
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


def _entries(nominal: NominalRobot, place: Place, pairs: Sequence[tuple[int, int]]) -> MechanicalEffect:
    """Entries of a part's compliance C = L Lᵀ, which becomes L φ(E) Lᵀ: internal parameters are entries of E.

    φ of E's eigenvalues is 1 + e for more compliance and 1/(1 - e) for less, so that no parameters make a part that
    yields energy.
    """
    compliance = nominal.compliances[place.members[0]]
    rows, columns = np.array(pairs).T
    pattern = np.zeros((6, 6))
    pattern[rows, columns] = pattern[columns, rows] = 1.0
    diagonal = np.diagonal(compliance)
    root = np.linalg.cholesky(pattern * compliance + np.diag(_RIDGE * diagonal + _NO_COMPLIANCE))
    back = np.linalg.inv(root)

    def added(values: Array) -> Array:
        inner = np.zeros((6, 6))
        inner[rows, columns] = inner[columns, rows] = values
        e, vectors = np.linalg.eigh(inner)
        growth = np.where(e < 0.0, e / (1.0 - np.minimum(e, 0.0)), e)  # φ - 1
        return root @ (vectors * growth) @ vectors.T @ root.T

    def internal(entries: Array) -> Array:
        change = np.zeros((6, 6))
        change[rows, columns] = change[columns, rows] = entries - compliance[rows, columns]
        growth, vectors = np.linalg.eigh(back @ change @ back.T)
        e = np.where(growth < 0.0, growth / np.maximum(1.0 + growth, _RIDGE), growth)
        return ((vectors * e) @ vectors.T)[rows, columns]

    return MechanicalEffect(
        "part-compliance",
        place.name,
        tuple(f"c{i + 1}{j + 1}" for i, j in pairs),
        tuple(_ENTRY_UNITS[(i > 2) + (j > 2)] for i, j in pairs),
        lambda values: dict.fromkeys(place.members, Change(added(values))),
        lambda values: compliance[rows, columns] + added(values)[rows, columns],
        internal,
        place.members,
        tuple(f"part-compliance @ {other}" for other in place.others),
    )


def dimension_effects(nominal: NominalRobot, part: str) -> tuple[MechanicalEffect, ...]:
    """Effects of a part's dimensions, material and foundation, where its matrix is that of beam theory or tested."""
    if part in nominal.tested:
        return tuple(_dimension(nominal, each) for each in nominal.tested[part]())
    if part in nominal.beams:
        return tuple(_dimension(nominal, each) for each in beam_dimensions(nominal.robot, part))
    return ()


def _dimension(nominal: NominalRobot, of: PartDimension) -> MechanicalEffect:
    """A parameter by the logarithm of its distance from where it vanishes; of a rigid foundation what it yields."""
    members = nominal.robot.bodies_of(of.part)
    here = nominal.compliances[members[0]]
    rigid = not np.isfinite(of.nominal)

    def physical(values: Array) -> Array:
        if not rigid:
            return of.limit + (of.nominal - of.limit) * np.exp(values)
        yields = values * _FOUNDATION_UNIT
        return 1.0 / np.where(np.abs(yields) > _RIGID, yields, _RIGID)

    def internal(values: Array) -> Array:
        if rigid:
            return 1.0 / (values * _FOUNDATION_UNIT)
        ratio = (values - of.limit) / (of.nominal - of.limit)
        if not (ratio > 0.0).all():
            raise InputError(f"{of.place}: expected a value to the other side of {of.limit:g} {of.unit}, "
                             f"where nothing is left of the part, got {values[0]:g} {of.unit}")  # fmt: skip
        return np.log(ratio)

    def changes(values: Array) -> Changes:
        return dict.fromkeys(members, Change(of.compliance(float(physical(values)[0])) - here))

    return MechanicalEffect("part-dimension", of.place, ("value",), (of.unit,), changes, physical, internal, members)


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
    stiffer = any(joint is not before for joint, before in zip(joints, mechanism.joints, strict=True))
    return (replace(mechanism, joints=tuple(joints)) if stiffer else mechanism).changed(bearings)


def without_ranges(mechanism: Mechanism) -> Mechanism:
    """The mechanism with drives that never come to an end."""
    joints = (
        j if j.drive is None else replace(j, drive=replace(j.drive, low=-np.inf, high=np.inf)) for j in mechanism.joints
    )
    return replace(mechanism, joints=tuple(joints))


def adopted(robot: NominalRobot, effect: str, place: str, parameters: Mapping[str, float]) -> NominalRobot:
    """Return the robot that carries a mechanical effect from now on.

    Parameters
    ----------
    robot
        The robot so far; effects that it has adopted before stay.
    effect, place, parameters
        In the words of `EFFECTS`, SI; parameters that are left out keep their nominal values.

    Raises
    ------
    InputError
        For words that are not in the vocabulary, and for an effect that is none of the robot's.

    """
    if effect == "gravity":
        return robot
    if effect == "payload":
        raise InputError(f"payload: add its mass to bodies.{place}.mass of the robot file")
    if effect == "part-dimension" and place.partition(".")[0] not in robot.beams:
        raise InputError(f"part-dimension: set {place} in [parts] of the robot file, in its units")
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
    if effect not in EFFECTS:
        raise InputError(f"effect: expected one of {', '.join(EFFECTS)}, got {effect!r}")
    word = f"{effect} @ {place}"
    known = mechanical_effects(robot)
    if effect == "part-dimension":
        known = tuple(e for part in robot.robot.parts for e in dimension_effects(robot, part))
    placed = [e for e in known if word in (f"{e.effect} @ {e.place}", *e.others)]
    if not placed:
        places = dict.fromkeys(e.place for e in known if e.effect == effect)
        if places:
            raise InputError(f"{effect}, place: expected one of {', '.join(places)}, got {place!r}")
        raise InputError(f"{word}: no part of the robot; correct the readings (or the backlash) instead")
    fitting = [e for e in placed if set(parameters) <= set(e.names)]
    if not fitting:
        raise InputError(
            f"{effect}: expected parameters {', '.join(placed[0].names) or 'none'}, got {', '.join(parameters)}"
        )
    return _in_words_of(effect, min(fitting, key=lambda e: len(e.names)))


def _in_words_of(effect: str, known: MechanicalEffect) -> MechanicalEffect:
    """An effect with the parameters of another word for the same: factors on a compliance and on a stiffness."""
    if known.names != ("factor",) or effect == known.effect:
        return known
    if effect == "link-stiffness":
        return replace(known, effect=effect, physical=stiffness_factor_of, internal=softening_of)
    return replace(known, effect=effect, physical=factor_of, internal=growth_of)


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
