"""Every effect of the vocabulary as a small immutable object: what it changes, how large it may be.

A mechanical effect changes named elements of a robot's tree: it adds a compliance, or moves the unloaded end. One
function of its inner parameters says so, and serves both to build the robot that carries it and to differentiate it.
Inner parameters are such that a tool's motion is as linear in them as can be (``u = 1/factor - 1`` for a stiffness).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.errors import InputError
from stiffscope.gap.vocabulary import LINKS, VOCABULARY
from stiffscope.vjm.elastic import Node, Spring, edited
from stiffscope.vjm.screws import HALF_TURN, Frame

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray

    from stiffscope.gap.state import State
    from stiffscope.vjm.biglide import Biglide

    Array = NDArray[np.floating[Any]]

UNKNOWN = "unknown"  # effect of a pattern that the vocabulary has no word for
EXPANSION = 11.7e-6  # 1/K, steel: what `thermal` heats
LIMBS = (1, 2)
_PAIRS = tuple((i, j) for i in range(6) for j in range(i, 6))
_MIRRORED = ((0, 0), (1, 1), (1, 5), (2, 2), (2, 4), (3, 3), (4, 4), (5, 5))  # of a part with two planes of symmetry
_OUTWARD = {"limb1": -1.0, "limb2": 1.0, "stage": 1.0}  # sign of a drive's axis for an offset that is positive outward


@dataclass(frozen=True)
class Change:
    """What an effect does to an element: compliance (6, 6) added, twist (6,) of its unloaded end, in its own axes."""

    compliance: Array | None = None
    offset: Array | None = None


Changes = dict[str, Change]


@dataclass(frozen=True)
class Nominal:
    """What effects need to know of the nominal robot: its springs by name, and the links' length in m."""

    springs: Mapping[str, Spring]
    length: float


@dataclass(frozen=True)
class Effect:
    """One word of the vocabulary at one place.

    ``scale`` (k,): prior size of the inner parameters; ``low`` and ``high`` (k,): what is plausible of the outer ones.
    ``acts``: inner parameters to changes of elements; ``reads``: derivatives (n, k) of the readings themselves; neither
    for loads and the instrument, which ``stiffscope.gap.state`` knows by name.
    """

    effect: str
    place: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    scale: tuple[float, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    acts: Callable[[Array, Nominal], Changes] | None = None
    outer: Callable[[Array, Nominal], Array] | None = None
    inner: Callable[[Array, Nominal], Array] | None = None
    reads: Callable[[State], Array] | None = None
    positive: bool = False
    """True where no inner parameter can be negative: a compliance that is added, a gap."""

    @property
    def name(self) -> str:
        """`effect @ place`."""
        return f"{self.effect} @ {self.place}"

    def outside(self, values: Array, nominal: Nominal) -> Array:
        """Outer parameters (k,), as the vocabulary has them, of inner ones."""
        return self.outer(values, nominal) if self.outer else values

    def inside(self, values: Array, nominal: Nominal) -> Array:
        """Inner parameters (k,) of outer ones."""
        return self.inner(values, nominal) if self.inner else values


def _softer(names: Sequence[str]) -> Callable[[Array, Nominal], Changes]:
    """Compliance of elements grows by u times its nominal."""

    def acts(u: Array, nominal: Nominal) -> Changes:
        return {name: Change(nominal.springs[name].compliance * u[0]) for name in names}

    return acts


def _from_stiffness(u: Array, _nominal: Nominal) -> Array:
    return 1.0 / (1.0 + u)


def _to_stiffness(factor: Array, _nominal: Nominal) -> Array:
    return 1.0 / factor - 1.0


def _from_compliance(u: Array, _nominal: Nominal) -> Array:
    return 1.0 + u


def _to_compliance(factor: Array, _nominal: Nominal) -> Array:
    return factor - 1.0


def _diagonal(names: Sequence[str], pattern: Array) -> Callable[[Array, Nominal], Changes]:
    """Diagonal compliances, ``pattern`` (k, 6) times the parameters, added at elements."""

    def acts(values: Array, _nominal: Nominal) -> Changes:
        return {name: Change(np.diag(values @ pattern)) for name in names}

    return acts


def _moved(names: Sequence[str], direction: Array, size: float = 1.0) -> Callable[[Array, Nominal], Changes]:
    """Unloaded ends of elements move along a twist (6,) by ``size`` times the parameter."""

    def acts(values: Array, _nominal: Nominal) -> Changes:
        return {name: Change(offset=direction * size * values[0]) for name in names}

    return acts


def _heated(values: Array, nominal: Nominal) -> Changes:
    growth = EXPANSION * nominal.length * values[0] * np.eye(6)[0]
    return {name: Change(offset=growth) for name in LINKS}


def _clamped_ends(values: Array, nominal: Nominal) -> Changes:
    """Links whose ends are clamped over a length: the uniform section bends over the rest, seen from B_ij."""
    clamped = float(np.clip(values[0], -0.2 * nominal.length, 0.45 * nominal.length))
    rest = (nominal.length - 2.0 * clamped) / nominal.length
    to_end = Frame(translation=np.array([-clamped, 0.0, 0.0])).adjoint()
    changes: Changes = {}
    for name in LINKS:
        c = nominal.springs[name].compliance
        bend = np.zeros((6, 6))  # of the nominal uniform section
        bend[4, 4], bend[5, 5] = c[4, 4], c[5, 5]
        shear = np.array([c[1, 1] - c[5, 5] * nominal.length**2 / 3.0, c[2, 2] - c[4, 4] * nominal.length**2 / 3.0])
        short = np.diag([c[0, 0], shear[0], shear[1], c[3, 3], c[4, 4], c[5, 5]]) * rest
        span = rest * nominal.length
        short[1, 1] += short[5, 5] * span**2 / 3.0
        short[2, 2] += short[4, 4] * span**2 / 3.0
        short[1, 5] = short[5, 1] = short[5, 5] * span / 2.0
        short[2, 4] = short[4, 2] = -short[4, 4] * span / 2.0
        full = np.diag([c[0, 0], c[1, 1], c[2, 2], c[3, 3], c[4, 4], c[5, 5]])
        full[1, 5] = full[5, 1] = c[5, 5] * nominal.length / 2.0
        full[2, 4] = full[4, 2] = -c[4, 4] * nominal.length / 2.0
        changes[name] = Change(to_end @ short @ to_end.T - full)
    return changes


def _slider_entries(pairs: Sequence[tuple[int, int]]) -> dict[str, Any]:
    """Entries of the slider's compliance moved by multiples of sqrt(C_ii C_jj), and what they then are."""

    def scale(nominal: Nominal) -> Array:
        root = np.sqrt(np.diagonal(nominal.springs["limb1.slider"].compliance).clip(min=1e-30))
        return np.array([root[i] * root[j] for i, j in pairs])

    def here(nominal: Nominal) -> Array:
        return np.array([nominal.springs["limb1.slider"].compliance[p] for p in pairs])

    def acts(values: Array, nominal: Nominal) -> Changes:
        added = np.zeros((6, 6))
        for (i, j), value in zip(pairs, values * scale(nominal), strict=True):
            added[i, j] = added[j, i] = value
        return {"limb1.slider": Change(added), "limb2.slider": Change(HALF_TURN @ added @ HALF_TURN)}

    def outer(values: Array, nominal: Nominal) -> Array:
        return here(nominal) + values * scale(nominal)

    def inner(entries: Array, nominal: Nominal) -> Array:
        return (entries - here(nominal)) / scale(nominal)

    return {"acts": acts, "outer": outer, "inner": inner}


def _slider_matrix(pairs: Sequence[tuple[int, int]]) -> Effect:
    kinds = ("m/N", "m/(N·m)", "rad/(N·m)")
    names = tuple(f"c{i + 1}{j + 1}" for i, j in pairs)
    units = tuple(kinds[(i > 2) + (j > 2)] for i, j in pairs)
    count = len(pairs)
    return Effect(
        "slider-compliance",
        "sliders",
        names,
        units,
        (1.0,) * count,
        (-1e-3,) * count,
        (1e-3,) * count,
        **_slider_entries(pairs),
    )


def _one(effect: str, place: str, scale: float, low: float, high: float, **functions: Any) -> Effect:
    ((name, unit), *_) = VOCABULARY[effect].parameters
    return Effect(effect, place, (name,), (unit,), (scale,), (low,), (high,), **functions)


def _several(
    effect: str, place: str, scales: Sequence[float], low: Sequence[float], high: Sequence[float], **f: Any
) -> Effect:
    names, units = zip(*VOCABULARY[effect].parameters, strict=True)
    return Effect(effect, place, names, units, tuple(scales), tuple(low), tuple(high), **f)


def _stiffer(effect: str, place: str, names: Sequence[str]) -> Effect:
    return _one(effect, place, 0.2, 0.2, 2.0, acts=_softer(names), outer=_from_stiffness, inner=_to_stiffness)


def _mass_alone() -> Effect:
    return Effect("payload", "platform", ("mass",), ("kg",), (3.0,), (0.0,), (50.0,))


def _payload_outer(values: Array, _nominal: Nominal) -> Array:
    mass = values[0] if abs(values[0]) > 1e-9 else 1e-9
    return np.array([values[0], values[1] / mass, values[2] / mass, 0.0])


def _payload_inner(values: Array, _nominal: Nominal) -> Array:
    return np.array([values[0], values[0] * values[1], values[0] * values[2]])


def library() -> tuple[Effect, ...]:
    """Every effect of the vocabulary at every place."""
    x = np.eye(6)[0]
    eye = np.eye(6)
    joints = [f"{link}.{end}" for link in LINKS for end in ("joint_a", "joint_b")]
    carriages = [f"limb{i}.carriage" for i in LIMBS]
    radial_axial_tilting = np.array([[1, 0, 1, 0, 0, 0], [0, 1, 0, 0, 0, 0], [0, 0, 0, 1, 0, 1]], dtype=np.float64)
    guide = np.array([[0, 1, 0, 0, 0, 0], [0, 0, 1, 0, 0, 0], [0, 0, 0, 1, 1, 1]], dtype=np.float64)
    six = [1e-8] * 3 + [1e-7] * 3
    most = [1e-6] * 3 + [1e-5] * 3
    drives = {place: [f"{place}.actuator"] for place in ("stage", "limb1", "limb2")}
    axis = {"stage": eye[1], "limb1": x, "limb2": x}
    effects = [
        Effect("gravity", "robot", (), (), (), (), ()),
        _several("payload", "platform", (3.0, 0.3, 0.3), (0.0, -0.5, -0.5, -0.5), (50.0, 0.5, 0.5, 0.5),
                 outer=_payload_outer, inner=_payload_inner),
        _mass_alone(),
        *(_stiffer("actuator-stiffness", place, names) for place, names in drives.items()),
        _stiffer("actuator-stiffness", "limbs", ["limb1.actuator", "limb2.actuator"]),
        _several("joint-compliance", "joints", (2e-9, 2e-9, 1e-6), (0.0,) * 3, (1e-6, 1e-6, 1e-3),
                 acts=_diagonal(joints, radial_axial_tilting), positive=True),
        _stiffer("link-stiffness", "links", LINKS),
        *(_stiffer("link-stiffness", link, [link]) for link in LINKS),
        _one("rigid-ends", "links", 0.02, 0.0, 0.15, acts=_clamped_ends, positive=True),
        _one("slider-compliance", "sliders", 0.5, 0.2, 20.0, acts=_softer(["limb1.slider", "limb2.slider"]),
             outer=_from_compliance, inner=_to_compliance),
        _slider_matrix(_MIRRORED),
        _slider_matrix(_PAIRS),
        _several("guide-compliance", "carriages", (5e-9, 5e-9, 1e-7), (0.0,) * 3, (1e-6, 1e-6, 1e-4),
                 acts=_diagonal(carriages, guide), positive=True),
        _several("base-compliance", "base", six, (0.0,) * 6, most, acts=_diagonal(["base"], eye), positive=True),
        _several("platform-compliance", "platform", six, (0.0,) * 6, most,
                 acts=_diagonal(["platform"], eye), positive=True),
        *(_one("backlash", place, 1e-5, 0.0, 1e-3, positive=True) for place in drives),
        *(_one("encoder-offset", place, 2e-4, -5e-3, 5e-3, acts=_moved(names, axis[place], _OUTWARD[place]))
          for place, names in drives.items()),
        _one("link-length", "links", 1e-4, -3e-3, 3e-3, acts=_moved(LINKS, x)),
        *(_one("link-length", link, 1e-4, -3e-3, 3e-3, acts=_moved([link], x)) for link in LINKS),
        _one("thermal", "links", 10.0, -60.0, 100.0, acts=_heated),
        _several("instrument-misalignment", "instrument", (0.01,) * 3, (-0.1,) * 3, (0.1,) * 3),
        _one("displacement-scale", "instrument", 0.05, 0.7, 1.4, outer=_from_compliance, inner=_to_compliance),
        _one("force-scale", "instrument", 0.05, 0.7, 1.4, outer=_from_compliance, inner=_to_compliance),
    ]  # fmt: skip
    return tuple(effects)


def nominal_of(robot: Biglide) -> Nominal:
    """What effects need to know of a robot, at its middle."""
    return _nominal(robot, _at_its_middle(robot))


def _at_its_middle(robot: Biglide) -> Node:
    from stiffscope.vjm.biglide import pose_at

    return robot.tree(pose_at(robot.geometry, np.radians(45.0)))


def _nominal(robot: Biglide, tree: Node) -> Nominal:
    from stiffscope.vjm.elastic import leaves

    return Nominal({n.name: n for n in leaves(tree) if isinstance(n, Spring)}, robot.geometry.L)


def changed(tree: Node, changes: Changes) -> Node:
    """The tree with elements changed."""

    def with_change(change: Change) -> Callable[[Node], Node]:
        def edit(node: Node) -> Node:
            if not isinstance(node, Spring):
                raise InputError(f"{node.name}: an effect needs a spring here")
            offset = node.offset
            if change.offset is not None:
                offset = change.offset if offset is None else offset + change.offset
            compliance = node.compliance if change.compliance is None else node.compliance + change.compliance
            return replace(node, compliance=compliance, offset=offset)

        return edit

    for name, change in changes.items():
        tree = edited(tree, name, with_change(change))
    return tree


def effect_named(effect: str, place: str, parameters: Sequence[str] = ()) -> Effect:
    """The effect of the vocabulary with these parameters. Raises InputError with what would be valid."""
    here = [e for e in library() if e.effect == effect]
    if not here:
        raise InputError(f"effect: expected one of {', '.join(VOCABULARY)}, found {effect!r}")
    placed = [e for e in here if e.place == place]
    if not placed:
        raise InputError(f"{effect}, place: expected one of {', '.join(e.place for e in here)}, found {place!r}")
    named = sorted((e for e in placed if set(parameters) <= set(e.names)), key=lambda e: len(e.names))
    if not named:
        raise InputError(
            f"{effect}: expected parameters {', '.join(placed[0].names) or 'none'}, found {', '.join(parameters)}"
        )
    return named[0]


def adopted(robot: Biglide, effect: str, place: str, parameters: Mapping[str, float]) -> Biglide:
    """The robot that carries a mechanical effect from now on. Raises InputError for one that is none of the robot's."""
    if effect == "gravity":
        return robot
    known = effect_named(effect, place, tuple(parameters))
    tree = _at_its_middle(robot)
    nominal = _nominal(robot, tree)
    if effect == "payload":
        raise InputError("payload: add its mass to platform.mass of the robot file")
    if known.acts is None:
        raise InputError(f"{known.name}: no part of the robot; correct the readings (or the backlash) instead")
    if not parameters:
        raise InputError(f"{known.name}: expected parameters {', '.join(known.names)}, found none")
    if not parameters.get("factor", 1.0) > 0.0:
        raise InputError(f"{known.name}, factor: expected more than 0, found {parameters['factor']:g}")
    none = known.outside(np.zeros(len(known.scale)), nominal)
    given = np.array([float(parameters.get(name, value)) for name, value in zip(known.names, none, strict=True)])
    changes = known.acts(known.inside(given, nominal), nominal)
    changed(tree, changes)  # raises for a compliance that is none
    return robot.edited(partial(changed, changes=changes))
