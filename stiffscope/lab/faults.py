"""Faults injected into the true machine: the known effects, and faults without a name."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.errors import InputError
from stiffscope.lab.closure import COORDINATES
from stiffscope.lab.instrument_faults import (
    ROTATIONS,
    change_instrument,
    leak_channel,
    multiply,
    name_parameters,
    read_pair,
    slip_channel,
    turn_instrument,
)
from stiffscope.lab.machine import DRIVEN, FREE, Payload, Slot
from stiffscope.lab.rotations import lever

if TYPE_CHECKING:
    from stiffscope.lab.instrument_faults import Parameters
    from stiffscope.lab.machine import Body, Joint, Machine
    from stiffscope.lab.rotations import Array

Injector = Callable[["Machine", str, "Parameters"], "Machine"]
Find = Callable[["Machine", str], Mapping[str, Any]]

ENTRIES = tuple(f"c{i}{j}" for i in range(1, 7) for j in range(i, 7))
_COUPLED = ("rxry", "rxrz", "ryrz")
_YIELDING = (*COORDINATES, *_COUPLED)
_UNIFORM = 0.01  # relative tolerance on the entries of a uniform beam


def _joints(machine: Machine, place: str) -> dict[str, Joint]:
    return {n: machine.joints[n] for n in machine.members(place) if n in machine.joints}


def _drives(machine: Machine, place: str) -> dict[str, Joint]:
    return {
        name: joint for name, joint in _joints(machine, place).items() if joint.drive
    }


def _find_elastic(machine: Machine, place: str) -> dict[str, Body]:
    bodies = [machine.bodies[n] for n in machine.members(place) if n in machine.bodies]
    return {body.name: body for body in bodies if len(body.nodes) > 1}


def _find_links(machine: Machine, place: str) -> dict[str, Body]:
    return {
        name: body
        for name, body in _find_elastic(machine, place).items()
        if body.is_link
    }


def _find_rigid(machine: Machine, place: str) -> dict[str, Body]:
    body = machine.bodies.get(place)
    return {place: body} if body is not None and len(body.nodes) == 1 else {}


def _every(find: Find, change: Callable[[Any, Parameters], Any]) -> Injector:
    """Return an injector that changes every joint or body that `find` gives for a place."""
    return lambda machine, place, parameters: machine.change(
        {name: change(each, parameters) for name, each in find(machine, place).items()}
    )


def _driven(change: Callable[[Any, float], Any], parameter: str) -> Injector:
    """Return an injector that changes every drive of a place."""
    return _every(_drives, lambda j, v: replace(j, drive=change(j.drive, v[parameter])))


_bodies = partial(_every, _find_elastic)


def _support(parameters: Parameters) -> Array:
    """Return the compliance (6, 6) of a support: diagonal terms, and couplings such as `rxry`."""
    out = np.diag(name_parameters(parameters, *COORDINATES))
    for name in set(parameters).intersection(_COUPLED):
        i = COORDINATES.index(name[:2])
        j = COORDINATES.index(name[2:])
        out[i, j] = out[j, i] = parameters[name]
    return out


def _soften_bearing(joint: Joint, diagonal: Sequence[float] | Array) -> Joint:
    """Add compliance to a bearing in its constrained directions."""
    held = np.array([i not in FREE[joint.kind] for i in range(6)])
    if joint.kind == "universal":  # its constrained direction is not exactly z
        held[3:] = True
    return replace(
        joint, bearing=joint.bearing + np.diag(np.where(held, diagonal, 0.0))
    )


def bearing_words(joints: Sequence[Joint]) -> tuple[str, ...]:
    """Return the parameters of `joint-compliance` that apply to any of these joints."""
    held = {(i, joint.directed) for joint in joints for i in joint.held_directions}
    words = {
        "radial": any(i < 3 and (i > 0 or not directed) for i, directed in held),
        "axial": (0, True) in held,
        "tilting": any(i > 2 for i, _ in held),
    }
    return tuple(word for word, means in words.items() if means)


def _joint_compliance(joint: Joint, parameters: Parameters) -> Joint:
    radial, axial, tilting = name_parameters(parameters, "radial", "axial", "tilting")
    first = axial if joint.directed else radial
    return _soften_bearing(joint, [first, radial, radial, *[tilting] * 3])


def _guide_compliance(joint: Joint, parameters: Parameters) -> Joint:
    diagonal = name_parameters(
        parameters, "", "lateral", "vertical", "roll", "pitch", "yaw"
    )
    diagonal[3:] += parameters.get("angular", 0.0)
    return _soften_bearing(joint, diagonal) if joint.kind == "prismatic" else joint


def beam(length: float, section: Array) -> Array:
    """Return the compliance (6, 6) at the free end of a uniform cantilever along x.

    section: per metre 1/EA, 1/κGA (y, z), 1/GI_p, 1/EI (y, z); no shear gives docs/theory.md (7.1).
    """
    n, vy, vz, t, by, bz = section * length
    out = np.diag([n, vy + bz * length**2 / 3, vz + by * length**2 / 3, t, by, bz])
    out[1, 5] = out[5, 1] = bz * length / 2
    out[2, 4] = out[4, 2] = -by * length / 2
    return out


def section_of(compliance: Array, length: float) -> Array:
    """Return the uniform section of the cantilever nearest to a compliance (6, 6); see `beam`."""
    n, y, z, t, by, bz = np.diag(compliance) / length
    return np.array([n, y - bz * length**2 / 3, z - by * length**2 / 3, t, by, bz])


def is_uniform(body: Body) -> bool:
    """Return whether a body's compliance is that of a uniform beam of its length."""
    size = np.sqrt(np.diag(body.compliance))
    section = section_of(body.compliance, body.length)
    off = np.abs(body.compliance - beam(body.length, section))
    uniform = (off <= _UNIFORM * np.outer(size, size)).all()
    return bool(uniform and (section * body.length >= -_UNIFORM * size**2).all())


def _rigid_ends(body: Body, parameters: Parameters) -> Body:
    """Return a body of the same section that bends only between rigid ends, at its tip."""
    clamped = parameters["length"]
    length = body.length
    if not 0 <= clamped < length / 2:
        limit = f"0 to {length / 2:g} m"
        raise InputError(f"rigid-ends, length: expected {limit}, got {clamped:g}")
    section = section_of(body.compliance, length)
    carry = lever(np.array([clamped, 0.0, 0.0]))
    short = carry @ beam(length - 2 * clamped, section) @ carry.T
    return replace(body, compliance=body.compliance + short - beam(length, section))


def _part_compliance(body: Body, parameters: Parameters) -> Body:
    if "factor" in parameters:
        return replace(body, compliance=body.compliance * parameters["factor"])
    if len(body.nodes) > 2:
        what = f"a factor for a body of {len(body.nodes)} ends, {body.name}"
        raise InputError(f"part-compliance: expected {what}")
    full = np.zeros((6, 6))
    for name, value in parameters.items():
        i = int(name[1]) - 1
        j = int(name[2]) - 1
        full[i, j] = full[j, i] = value
    return replace(body, compliance=full)


def _grow(body: Body, strain: float) -> Body:
    """Return a uniformly expanded body, with its ends further from the first."""
    away = strain * body.away
    return replace(body, offset=body.offset + np.hstack([away, 0.0 * away]).ravel())


def _payload(machine: Machine, place: str, parameters: Parameters) -> Machine:
    """Add a mass to a rigid body, with its centre relative to M (tool), or to the body's or its joints' centre."""
    node = machine.tool if place == "tool" else place
    joints = [
        joint.at
        for joint in machine.joints.values()
        if node in (joint.first, joint.second)
    ]
    if node == machine.tool:
        origin = machine.at
    elif getattr(machine.robot.bodies[node], "centre", None) is None:
        origin = np.mean(joints, axis=0)
    else:
        origin = machine.bodies[node].centre
    load = Payload(
        node, parameters["mass"], origin + name_parameters(parameters, "x", "y", "z")
    )
    return replace(machine, payloads=(*machine.payloads, load))


def _make_denser(body: Body, parameters: Parameters) -> Body:
    """Scale a body's mass, and its moments of inertia with it."""
    factor = parameters["factor"]
    return replace(body, mass=factor * body.mass, inertia=factor * body.inertia)


def _joint_stiffness(joint: Joint, parameters: Parameters) -> Joint:
    """Scale the spring of a passive joint, or add a stiffness."""
    if joint.drive or joint.kind not in {
        "revolute",
        "prismatic",
        "universal",
        "spherical",
    }:
        return joint
    spring = joint.spring * parameters.get("factor", 1.0) + parameters.get(
        "stiffness", 0.0
    )
    return replace(joint, spring=spring)


def _find_driven(joint: Joint) -> tuple[int, ...]:
    """Return the direction of a joint's drive."""
    return (DRIVEN[joint.kind],) if joint.drive else ()


def _held_across(joint: Joint) -> tuple[int, ...]:
    """Return the translations constrained across a joint's axis; all for a spherical joint."""
    return tuple(
        i for i in joint.held_directions if i < 3 and (i > 0 or not joint.directed)
    )


def _find_opening(joint: Joint) -> tuple[int, ...]:
    """Return the axis along which a joint opens in tension and is closed in compression."""
    return tuple(i for i in joint.held_directions[:1] if i < 3)


def _yield_by(
    law: str, parameter: str, directions: Callable[[Joint], tuple[int, ...]]
) -> Injector:
    """Return an injector of a force law for every joint of a place in some directions."""

    def injector(machine: Machine, place: str, parameters: Parameters) -> Machine:
        size = parameters[parameter]
        knee = parameters.get("knee", np.inf)
        more: list[Slot] = []
        for name, joint in _joints(machine, place).items():
            driven = joint.drive.stiffness if joint.drive else np.inf
            more += [
                Slot(
                    element=name,
                    direction=i,
                    law=law,
                    size=size,
                    stiffness=driven if i == DRIVEN.get(joint.kind) else np.inf,
                    knee=knee,
                )
                for i in directions(joint)
            ]
        return replace(machine, slots=(*machine.slots, *more))

    return injector


def _bow(body: Body, parameters: Parameters) -> Body:
    """Bend a body by a uniform curvature, 1/m: its tip rises by κL²/2 and turns by κL."""
    kappa = parameters["curvature"]
    length = body.length
    bent = kappa * np.array([0, 0, length**2 / 2, 0, -length, 0])
    return replace(body, offset=body.offset + bent)


def _larger_body(machine: Machine, place: str, parameters: Parameters) -> Machine:
    """Enlarge a rigid body: the points of its joints move away from its centre."""
    centre = machine.bodies[place].centre
    strain = parameters["relative"]
    grown: dict[str, Joint] = {}
    for name, joint in machine.joints.items():
        first, second = (
            at + strain * (at - centre) if node == place else at
            for node, at in (
                (joint.first, joint.at_first),
                (joint.second, joint.at_second),
            )
        )
        grown[name] = replace(joint, at_first=first, at_second=second)
    return machine.change(grown)


def _mislay_axis(joint: Joint, parameters: Parameters) -> Joint:
    """Displace a joint's axis perpendicular to the drawn one; that of a slide is only rotated."""
    across = ("", "") if joint.kind == "prismatic" else ("y", "z")
    twist = name_parameters(parameters, "", *across, "", "ry", "rz")
    return (
        replace(joint, misalignment=joint.misalignment + twist)
        if joint.kind in DRIVEN
        else joint
    )


def _allow_only(*places: str) -> Callable[[Machine, str], bool]:
    return lambda _, place: place in places


def _any_joint(holds: Callable[[Joint], Any]) -> Callable[[Machine, str], bool]:
    return lambda machine, place: any(
        holds(joint) for joint in _joints(machine, place).values()
    )


@dataclass(frozen=True)
class Word:
    """A kind of fault: its parameters, its injector, and where it can act."""

    names: tuple[str, ...]
    inject: Injector
    acts_on: Callable[[Machine, str], Any] = lambda _machine, _place: True
    """Whether it can act at a place."""
    where: Callable[[Sequence[str]], tuple[str, ...]] | None = None
    """Its places for given sensors; None: elements and sets of them on which it acts."""
    of_readings: bool = False
    """Whether it changes displacements as they are read, which a tracker's are not."""
    steps: tuple[Mapping[str, float], ...] = ()
    """Small steps of its parameters, for derivatives of readings."""


INSTRUMENT = "instrument"
HAMMER = "hammer"
_TURN = 1e-3  # rad, or relative: step for derivatives


def _at(*places: str) -> Callable[[Sequence[str]], tuple[str, ...]]:
    return lambda _sensors: places


def _at_instruments(sensors: Sequence[str]) -> tuple[str, ...]:
    return (INSTRUMENT, *sensors)


def _at_channels(sensors: Sequence[str]) -> tuple[str, ...]:
    return (INSTRUMENT, *(sensors or COORDINATES))


def _at_single_channels(sensors: Sequence[str]) -> tuple[str, ...]:
    return tuple(sensors or COORDINATES)


def _at_points(points: Sequence[str]) -> tuple[str, ...]:
    """Return the points of a hammer test."""
    return tuple(points)


def _at_gains(points: Sequence[str]) -> tuple[str, ...]:
    """Return hammer, points and channels of a hammer test with triaxial sensors."""
    channels = (f"{point}.{axis}" for point in points for axis in "xyz")
    return (HAMMER, *points, *channels) if points else ()


def _at_pairs(sensors: Sequence[str]) -> tuple[str, ...]:
    """Return pairs of axes, or of components of the force, that may be exchanged."""
    axes = () if sensors else ("x/y", "y/z", "x/z")
    return (*axes, "fx/fy", "fy/fz", "fx/fz")


def _bend_drives(machine: Machine, place: str, parameters: Parameters) -> Machine:
    """Give drives one stiffness up to a load and another beyond it."""
    load = parameters["load"]
    factor = parameters.get("factor", 1.0)
    start = parameters.get("start", 1.0)
    slots: list[Slot] = []
    for name, joint in _drives(machine, place).items():
        if joint.drive is None:
            continue
        k = joint.drive.stiffness
        corner = load / (start * k), load
        far = corner[0] + 100.0 * load / (factor * k), 101.0 * load
        along = DRIVEN[joint.kind]
        slots.append(Slot(name, along, "curve", 0.0, k, points=(corner, far)))
    return replace(machine, slots=(*machine.slots, *slots))


def _leak_force(machine: Machine, place: str, parameters: Parameters) -> Machine:
    """Let a force sensor show shares of one component in the others."""
    leak = machine.instrument.leak.copy()
    leak[:, _FORCES.index(place)] += name_parameters(parameters, *_FORCES)
    return change_instrument(machine, leak=leak)


def _change_weight(machine: Machine, place: str, parameters: Parameters) -> Machine:
    """Make the loads of one stated size, such as "20 N", lighter or heavier."""
    weights = {**machine.instrument.weights, place: parameters["factor"]}
    return change_instrument(machine, weights=weights)


def _swap_columns(machine: Machine, place: str, _: Parameters) -> Machine:
    first, second = place.split("/")
    return change_instrument(
        machine, swaps=(*machine.instrument.swaps, (first, second))
    )


_FORCES = ("fx", "fy", "fz")


def _change_response_gain(machine: Machine, place: str, v: Parameters) -> Machine:
    """Multiply what the hammer, a sensor or one of its channels shows."""
    gains = {**machine.response_gains}
    gains[place] = v["factor"] * gains.get(place, 1.0)
    return replace(machine, response_gains=gains)


KNOWN: dict[str, Word] = {
    "gravity": Word(
        (), lambda m, _, _v: replace(m, weighted=True), _allow_only("robot")
    ),
    "payload": Word(
        ("mass", "x", "y", "z"),
        _payload,
        lambda m, at: at == "tool" or _find_rigid(m, at),
    ),
    "actuator-stiffness": Word(
        ("factor",),
        _driven(lambda d, v: replace(d, stiffness=d.stiffness * v), "factor"),
        _drives,
    ),
    "friction": Word(("force",), _yield_by("friction", "force", _find_driven), _drives),
    "preload-loss": Word(("load", "factor", "start"), _bend_drives, _drives),
    "tool-offset": Word(
        COORDINATES,
        lambda m, _, v: replace(m, shift=m.shift + name_parameters(v, *COORDINATES)),
        _allow_only("tool"),
        where=_at("tool"),
    ),
    "joint-stiffness": Word(
        ("factor", "stiffness"),
        _every(_joints, _joint_stiffness),
        _any_joint(lambda j: j.spring),
    ),
    "backlash": Word(
        ("half_width",), _yield_by("play", "half_width", _find_driven), _drives
    ),
    "encoder-offset": Word(
        ("offset",),
        _driven(lambda d, v: replace(d, offset=d.offset + v), "offset"),
        _drives,
    ),
    "joint-compliance": Word(
        ("radial", "axial", "tilting"), _every(_joints, _joint_compliance), _joints
    ),
    "guide-compliance": Word(
        ("lateral", "vertical", "angular", "roll", "pitch", "yaw"),
        _every(_joints, _guide_compliance),
        _any_joint(lambda j: j.kind == "prismatic"),
    ),
    "joint-axis": Word(
        ("y", "z", "ry", "rz"),
        _every(_joints, _mislay_axis),
        _any_joint(lambda j: j.kind in DRIVEN),
    ),
    "mass": Word(
        ("factor",),
        _every(_find_rigid, _make_denser),
        lambda m, at: any(b.mass for b in _find_rigid(m, at).values()),
        steps=({"factor": 1.0 + _TURN},),
    ),
    "sensor-mass": Word(
        ("mass",),
        lambda m, at, v: replace(m, sensor_masses={**m.sensor_masses, at: v["mass"]}),
        where=_at_points,
    ),
    "response-gain": Word(("factor",), _change_response_gain, where=_at_gains),
    "link-stiffness": Word(
        ("factor",),
        _bodies(lambda b, v: replace(b, compliance=b.compliance / v["factor"])),
        _find_elastic,
    ),
    "part-compliance": Word(
        ("factor", *ENTRIES), _bodies(_part_compliance), _find_elastic
    ),
    "part-dimension": Word(
        ENTRIES,
        _bodies(_part_compliance),
        lambda m, at: _find_elastic(m, at.rsplit(".", 1)[0]),
    ),
    "rigid-ends": Word(("length",), _bodies(_rigid_ends), _find_links),
    "link-length": Word(
        ("error",), _bodies(lambda b, v: _grow(b, v["error"] / b.length)), _find_links
    ),
    "thermal": Word(
        ("temperature",),
        _bodies(lambda b, v: _grow(b, b.expansion * v["temperature"])),
        _find_elastic,
    ),
    "base-compliance": Word(
        _YIELDING,
        lambda m, _, v: replace(m, base=m.base + _support(v)),
        _allow_only("base"),
        where=_at("base"),
    ),
    "platform-compliance": Word(
        _YIELDING,
        lambda m, _, v: replace(m, platform=m.platform + _support(v)),
        _allow_only("tool", "platform"),
        where=_at("tool"),
    ),
    "instrument-misalignment": Word(
        ROTATIONS,
        turn_instrument,
        where=_at_instruments,
        of_readings=True,
        steps=tuple({axis: _TURN} for axis in ROTATIONS),
    ),
    "displacement-scale": Word(
        ("factor",),
        lambda m, at, v: multiply(m, at, v["factor"], "scales"),
        where=_at_instruments,
        of_readings=True,
        steps=({"factor": 1.0 + _TURN},),
    ),
    "unit": Word(
        ("factor",),
        lambda m, at, v: multiply(m, at, v["factor"]),
        where=_at_channels,
        of_readings=True,
    ),
    "sensor-sign": Word(
        (), lambda m, at, _: multiply(m, at, -1.0), where=_at_channels, of_readings=True
    ),
    "sensor-step": Word(
        ("jump", "row"), slip_channel, where=_at_single_channels, of_readings=True
    ),
    "column-swap": Word((), _swap_columns, where=_at_pairs, of_readings=True),
    "force-cross-talk": Word(
        _FORCES,
        _leak_force,
        _allow_only(*_FORCES),
        where=_at(*_FORCES),
        steps=tuple({axis: _TURN} for axis in _FORCES),
    ),
    "load-value": Word(("factor",), _change_weight, where=_at()),
    "force-scale": Word(
        ("factor",),
        lambda m, _, v: change_instrument(m, force=m.instrument.force * v["factor"]),
        _allow_only(INSTRUMENT),
        where=_at(INSTRUMENT),
        steps=({"factor": 1.0 + _TURN},),
    ),
}
"""Known effects except `geometry`; a part's dimension is given as the entries of its new 6x6.

A light weight has no place here, as a plan of the laboratory has loads of one size.
"""

OUTSIDE: dict[str, Word] = {
    "hardening-drive": Word(
        ("cubic",), _yield_by("hardening", "cubic", _find_driven), _drives
    ),
    "stiffening-joint": Word(
        ("radial", "knee"),
        _yield_by("stiffening", "radial", _held_across),
        _any_joint(_held_across),
    ),
    "joint-play": Word(
        ("radial",), _yield_by("play", "radial", _held_across), _any_joint(_held_across)
    ),
    "loose-bolt": Word(
        ("opening",), _yield_by("one-sided", "opening", _find_opening), _joints
    ),
    "cable-chain": Word(
        ("x", "y", "z"),
        lambda m, _, v: replace(m, cable=m.cable + name_parameters(v, "x", "y", "z")),
        _allow_only("tool"),
        where=_at("tool"),
    ),
    "screw-pitch": Word(
        ("relative",),
        _driven(lambda d, v: replace(d, pitch=d.pitch + v), "relative"),
        _drives,
    ),
    "larger-body": Word(("relative",), _larger_body, _find_rigid),
    "bowed-link": Word(("curvature",), _bodies(_bow), _find_links),
    "drifting-sensor": Word(
        ("displacement", "rotation"),
        lambda m, _, v: change_instrument(m, drift=read_pair(v)),
    ),
    "gain-drift": Word(
        ("relative",), lambda m, _, v: change_instrument(m, gain_drift=v["relative"])
    ),
    "cross-talk": Word(("share",), leak_channel),
    "coarse-converter": Word(
        ("displacement", "rotation"),
        lambda m, _, v: change_instrument(m, quantum=read_pair(v)),
    ),
    "wrench-off-centre": Word(
        ("x", "y", "z"),
        lambda m, _, v: change_instrument(
            m, application=name_parameters(v, "x", "y", "z")
        ),
    ),
    "bad-session": Word(
        ("relative",), lambda m, _, v: change_instrument(m, bad_session=v["relative"])
    ),
}
"""Faults that are not in the vocabulary."""


def acts_on(machine: Machine, effect: str, place: str) -> bool:
    """Return whether an effect can act at a place; sensors and channels are not checked.

    Parameters
    ----------
    machine, effect
        The machine, and a name of `KNOWN` or `OUTSIDE`.
    place
        An element, a set of them, or another place of the effect.
    """
    return bool({**KNOWN, **OUTSIDE}[effect].acts_on(machine, place))


def inject(
    machine: Machine, effect: str, place: str, parameters: Parameters
) -> Machine:
    """Return the machine with an effect added.

    Parameters
    ----------
    machine
        The machine so far.
    effect, place
        A name of `KNOWN` or `OUTSIDE`, and where it acts.
    parameters
        Parameters by name, SI; omitted ones of a group are zero.

    Raises
    ------
    InputError
        For a name that is not in `KNOWN` or `OUTSIDE`, listing the valid ones.
    """
    words = {**KNOWN, **OUTSIDE}
    if effect not in words:
        raise InputError(f"effect: expected one of {', '.join(words)}, got {effect!r}")
    word = words[effect]
    if not word.acts_on(machine, place):
        what = f"what it can act on in {machine.robot.name}"
        raise InputError(f"{effect}, place: expected {what}, got {place!r}")
    strange = [name for name in parameters if name not in word.names]
    if strange:
        valid = ", ".join(word.names) or "no parameters"
        raise InputError(f"{effect}, {strange[0]}: expected one of {valid}")
    if len(word.names) == 1 and word.names[0] not in parameters:
        raise InputError(f"{effect}, {word.names[0]}: expected this parameter")
    bad = [name for name, value in parameters.items() if not np.isfinite(value)]
    if bad or parameters.get("factor", 1.0) <= 0:
        raise InputError(
            f"{effect}, {(bad or ['factor'])[0]}: expected a finite number, a factor above 0"
        )
    part = place.rsplit(".", 1)[0] if effect == "part-dimension" else place
    return word.inject(machine, part, parameters)
