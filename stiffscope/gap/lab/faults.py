"""Faults injected into the true machine: each word of the vocabulary, and faults that it has no word for."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.errors import InputError
from stiffscope.gap.lab.machine import MIRROR, beam, section_of
from stiffscope.gap.lab.structure import lever
from stiffscope.gap.quantities import AXES
from stiffscope.robot.vocabulary import LINKS, VOCABULARY

if TYPE_CHECKING:
    from stiffscope.gap.lab.machine import Machine
    from stiffscope.gap.lab.structure import Array

Parameters = Mapping[str, float]
Injector = Callable[["Machine", str, Parameters], "Machine"]

_DRIVE = {"limb1": (0,), "limb2": (1,), "stage": (2,), "limbs": (0, 1)}


def _drives(machine: Machine, place: str, change: Callable[[Any], Any]) -> Machine:
    first, second, stage = machine.drives
    changed = [change(d) if k in _DRIVE[place] else d for k, d in enumerate((first, second, stage))]
    return replace(machine, drives=(changed[0], changed[1], changed[2]))


def _which_links(place: str) -> Array:
    """Return weights (2, 3): one for each link that a place means."""
    chosen = [place in {"links", name} for name in LINKS]
    return np.array(chosen, dtype=np.float64).reshape(2, 3)


def _axes(parameters: Parameters) -> Array:
    return _named(parameters, *AXES)


def _links(machine: Machine, place: str, changed: Callable[[Array], Array]) -> Machine:
    links = np.where(_which_links(place)[:, :, None, None] > 0, changed(machine.links), machine.links)
    return replace(machine, links=links)


def _rigid_ends(machine: Machine, _place: str, parameters: Parameters) -> Machine:
    """Replace each link by its own section over the length that bends, seen from B_ij behind the clamped end."""
    clamped, length = parameters["length"], machine.dimensions.L
    if not 0 <= clamped < length / 2:
        raise InputError(f"rigid-ends, length: expected 0 to {length / 2:g} m, got {clamped:g}")
    links = np.empty_like(machine.links)
    carry = lever(np.array([[clamped, 0, 0]]))[0]
    for place in np.ndindex(2, 3):
        section = section_of(machine.links[place], length)
        rest = machine.links[place] - beam(length, section)
        links[place] = carry @ beam(length - 2 * clamped, section) @ carry.T + rest
    return replace(machine, links=links)


def _sliders(machine: Machine, _place: str, parameters: Parameters) -> Machine:
    if "factor" in parameters:
        return replace(machine, sliders=machine.sliders * parameters["factor"])
    full = np.zeros((6, 6))
    for name, value in parameters.items():
        i, j = int(name[1]) - 1, int(name[2]) - 1
        full[i, j] = full[j, i] = value
    return replace(machine, sliders=np.stack([full, MIRROR @ full @ MIRROR]))


def _longer(machine: Machine, place: str, error: float) -> Machine:
    return replace(machine, length_error=machine.length_error + error * _which_links(place))


def _named(parameters: Parameters, *names: str) -> Array:
    """Parameters in this order; zero for a name that is empty or left out."""
    return np.array([parameters.get(name, 0.0) for name in names])


def _instrument(machine: Machine, **changes: Any) -> Machine:
    return replace(machine, instrument=replace(machine.instrument, **changes))


_KNOWN: dict[str, Injector] = {
    "gravity": lambda m, _, _v: replace(m, gravity=True),
    "payload": lambda m, _, v: replace(m, payload_mass=m.payload_mass + v["mass"], payload_centre=_axes(v)[:3]),
    "actuator-stiffness": lambda m, place, v: _drives(
        m, place, lambda d: replace(d, stiffness=d.stiffness * v["factor"])
    ),
    "joint-compliance": lambda m, _, v: replace(
        m, bearings=m.bearings + _named(v, "radial", "axial", "radial", "tilting", "", "tilting")
    ),
    "link-stiffness": lambda m, place, v: _links(m, place, lambda links: links / v["factor"]),
    "rigid-ends": _rigid_ends,
    "slider-compliance": _sliders,
    "guide-compliance": lambda m, _, v: replace(
        m, guides=m.guides + _named(v, "", "lateral", "vertical", "angular", "angular", "angular")
    ),
    "base-compliance": lambda m, _, v: replace(m, base=m.base + _axes(v)),
    "platform-compliance": lambda m, _, v: replace(m, platform=m.platform + _axes(v)),
    "backlash": lambda m, place, v: _drives(m, place, lambda d: replace(d, backlash=d.backlash + v["half_width"])),
    "encoder-offset": lambda m, place, v: _drives(m, place, lambda d: replace(d, offset=d.offset + v["offset"])),
    "link-length": lambda m, place, v: _longer(m, place, v["error"]),
    "thermal": lambda m, place, v: _longer(m, place, m.expansion * v["temperature"] * m.dimensions.L),
    "instrument-misalignment": lambda m, _, v: _instrument(m, rotation=m.instrument.rotation + _axes(v)[3:]),
    "displacement-scale": lambda m, _, v: _instrument(m, scale=m.instrument.scale * v["factor"]),
    "force-scale": lambda m, _, v: _instrument(m, force=m.instrument.force * v["factor"]),
}


def _soft_slider(machine: Machine, place: str, parameters: Parameters) -> Machine:
    sliders = machine.sliders.copy()
    sliders[_DRIVE[place][0]] *= parameters["factor"]
    return replace(machine, sliders=sliders)


def _loose_bearing(machine: Machine, place: str, parameters: Parameters) -> Machine:
    link, end = place.rsplit(".", 1)
    at = (*divmod(LINKS.index(link), 3), ("joint_a", "joint_b").index(end))
    bearings = machine.bearings.copy()
    bearings[at] += [parameters["radial"], 0, parameters["radial"], 0, 0, 0]
    return replace(machine, bearings=bearings)


def _soft_guide(machine: Machine, place: str, parameters: Parameters) -> Machine:
    guides = machine.guides.copy()
    guides[_DRIVE[place][0], 3:] += parameters["angular"]
    return replace(machine, guides=guides)


def _crosstalk(machine: Machine, place: str, parameters: Parameters) -> Machine:
    matrix = machine.instrument.crosstalk.copy()
    source, sink = place.split("->")
    matrix[AXES.index(sink), AXES.index(source)] += parameters["share"]
    return _instrument(machine, crosstalk=matrix)


_EACH_DRIVE = ("limb1", "limb2", "limbs", "stage")
_BEARINGS = tuple(f"{link}.{end}" for link in LINKS for end in ("joint_a", "joint_b"))
_CROSSINGS = tuple(f"{a}->{b}" for a in AXES for b in AXES if a != b)

OUTSIDE: dict[str, tuple[tuple[str, ...], tuple[str, ...], Injector]] = {
    "one-soft-slider": (("limb1", "limb2"), ("factor",), _soft_slider),
    "one-loose-bearing": (_BEARINGS, ("radial",), _loose_bearing),
    "one-soft-guide": (("limb1", "limb2"), ("angular",), _soft_guide),
    "stage-guide": (("stage",), AXES, lambda m, _, v: replace(m, stage_guide=m.stage_guide + _axes(v))),
    "cable-chain": (("platform",), AXES[:3], lambda m, _, v: replace(m, cable=m.cable + _axes(v))),
    "hardening-drive": (
        _EACH_DRIVE,
        ("cubic",),
        lambda m, place, v: _drives(m, place, lambda d: replace(d, hardening=v["cubic"])),
    ),
    "drive-friction": (
        _EACH_DRIVE,
        ("force",),
        lambda m, place, v: _drives(m, place, lambda d: replace(d, friction=v["force"])),
    ),
    "bowed-link": (
        ("links", *LINKS),
        ("curvature",),
        lambda m, place, v: replace(m, bow=m.bow + v["curvature"] * _which_links(place)),
    ),
    "screw-pitch": (("limbs",), ("relative",), lambda m, _, v: replace(m, rail_pitch=m.rail_pitch + v["relative"])),
    "platform-width": (("platform",), ("error",), lambda m, _, v: replace(m, width_error=m.width_error + v["error"])),
    "drifting-sensor": (("instrument",), AXES, lambda m, _, v: _instrument(m, drift=m.instrument.drift + _axes(v))),
    "gain-drift": (("instrument",), ("relative",), lambda m, _, v: _instrument(m, gain_drift=v["relative"])),
    "cross-talk": (_CROSSINGS, ("share",), _crosstalk),
    "coarse-converter": (("instrument",), AXES, lambda m, _, v: _instrument(m, quantum=_axes(v))),
    "wrench-off-centre": (("instrument",), AXES[:3], lambda m, _, v: _instrument(m, application=_axes(v)[:3])),
    "bad-session": (("instrument",), ("relative",), lambda m, _, v: _instrument(m, bad_session=v["relative"])),
}
"""Faults that the vocabulary has no word for: places, parameters, and how each is injected."""


def inject(machine: Machine, effect: str, place: str, parameters: Parameters) -> Machine:
    """Return the machine with one effect more; parameters that are left out of a group are zero.

    Raises InputError for a name that neither the vocabulary nor `OUTSIDE` has, listing what would be valid.
    """
    if effect in VOCABULARY:
        places, names = VOCABULARY[effect].places, tuple(n for n, _ in VOCABULARY[effect].parameters)
        injector = _KNOWN[effect]
    elif effect in OUTSIDE:
        places, names, injector = OUTSIDE[effect]
    else:
        valid = ", ".join([*VOCABULARY, *OUTSIDE])
        raise InputError(f"effect: expected one of {valid}, got {effect!r}")
    if place not in places:
        raise InputError(f"{effect}, place: expected one of {', '.join(places)}, got {place!r}")
    strange = [name for name in parameters if name not in names]
    if strange:
        raise InputError(f"{effect}, {strange[0]}: expected one of {', '.join(names) or 'no parameters'}")
    if len(names) == 1 and names[0] not in parameters:
        raise InputError(f"{effect}, {names[0]}: expected this parameter")
    bad = [name for name, value in parameters.items() if not np.isfinite(value)]
    if bad or any(parameters.get(name, 1.0) <= 0 for name in ("factor",)):
        raise InputError(f"{effect}, {(bad or ['factor'])[0]}: expected a finite number, a factor above 0")
    return injector(machine, place, parameters)
