"""Effects planted in the true machine: each word of the shared vocabulary, and faults that it has no word for."""

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
    return np.array([parameters.get(axis, 0.0) for axis in AXES])


def _gravity(machine: Machine, _place: str, _parameters: Parameters) -> Machine:
    return replace(machine, gravity=True)


def _payload(machine: Machine, _place: str, parameters: Parameters) -> Machine:
    centre = _axes(parameters)[:3]
    return replace(machine, payload_mass=machine.payload_mass + parameters["mass"], payload_centre=centre)


def _actuator(machine: Machine, place: str, parameters: Parameters) -> Machine:
    factor = parameters["factor"]
    return _drives(machine, place, lambda d: replace(d, stiffness=d.stiffness * factor))


def _joints(machine: Machine, _place: str, parameters: Parameters) -> Machine:
    radial, axial, tilting = (parameters.get(k, 0.0) for k in ("radial", "axial", "tilting"))
    added = np.array([radial, axial, radial, tilting, 0.0, tilting])
    return replace(machine, bearings=machine.bearings + added)


def _link_stiffness(machine: Machine, place: str, parameters: Parameters) -> Machine:
    factor = np.where(_which_links(place) > 0, parameters["factor"], 1.0)
    return replace(machine, links=machine.links / factor[:, :, None, None])


def _rigid_ends(machine: Machine, _place: str, parameters: Parameters) -> Machine:
    """Replace each link by its own section over the length that bends, seen from B_ij behind the clamped end."""
    clamped, length = parameters["length"], machine.dimensions.L
    if not 0 <= clamped < length / 2:
        raise InputError(f"rigid-ends, length: expected 0 to {length / 2:g} m, found {clamped:g}")
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


def _guides(machine: Machine, _place: str, parameters: Parameters) -> Machine:
    lateral, vertical, angular = (parameters.get(k, 0.0) for k in ("lateral", "vertical", "angular"))
    added = np.array([0.0, lateral, vertical, angular, angular, angular])
    return replace(machine, guides=machine.guides + added)


def _base(machine: Machine, _place: str, parameters: Parameters) -> Machine:
    return replace(machine, base=machine.base + _axes(parameters))


def _platform(machine: Machine, _place: str, parameters: Parameters) -> Machine:
    return replace(machine, platform=machine.platform + _axes(parameters))


def _backlash(machine: Machine, place: str, parameters: Parameters) -> Machine:
    return _drives(machine, place, lambda d: replace(d, backlash=d.backlash + parameters["half_width"]))


def _encoder(machine: Machine, place: str, parameters: Parameters) -> Machine:
    return _drives(machine, place, lambda d: replace(d, offset=d.offset + parameters["offset"]))


def _length(machine: Machine, place: str, parameters: Parameters) -> Machine:
    return replace(machine, length_error=machine.length_error + parameters["error"] * _which_links(place))


def _thermal(machine: Machine, _place: str, parameters: Parameters) -> Machine:
    growth = machine.expansion * parameters["temperature"] * machine.dimensions.L
    return replace(machine, length_error=machine.length_error + growth)


def _instrument(machine: Machine, **changes: Any) -> Machine:
    return replace(machine, instrument=replace(machine.instrument, **changes))


def _misalignment(machine: Machine, _place: str, parameters: Parameters) -> Machine:
    return _instrument(machine, rotation=machine.instrument.rotation + _axes(parameters)[3:])


def _displacement_scale(machine: Machine, _place: str, parameters: Parameters) -> Machine:
    return _instrument(machine, scale=machine.instrument.scale * parameters["factor"])


def _force_scale(machine: Machine, _place: str, parameters: Parameters) -> Machine:
    return _instrument(machine, force=machine.instrument.force * parameters["factor"])


_KNOWN: dict[str, Injector] = {
    "gravity": _gravity,
    "payload": _payload,
    "actuator-stiffness": _actuator,
    "joint-compliance": _joints,
    "link-stiffness": _link_stiffness,
    "rigid-ends": _rigid_ends,
    "slider-compliance": _sliders,
    "guide-compliance": _guides,
    "base-compliance": _base,
    "platform-compliance": _platform,
    "backlash": _backlash,
    "encoder-offset": _encoder,
    "link-length": _length,
    "thermal": _thermal,
    "instrument-misalignment": _misalignment,
    "displacement-scale": _displacement_scale,
    "force-scale": _force_scale,
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


def _stage_guide(machine: Machine, _place: str, parameters: Parameters) -> Machine:
    return replace(machine, stage_guide=machine.stage_guide + _axes(parameters))


def _cable(machine: Machine, _place: str, parameters: Parameters) -> Machine:
    return replace(machine, cable=machine.cable + _axes(parameters))


def _hardening(machine: Machine, place: str, parameters: Parameters) -> Machine:
    return _drives(machine, place, lambda d: replace(d, hardening=parameters["cubic"]))


def _friction(machine: Machine, place: str, parameters: Parameters) -> Machine:
    return _drives(machine, place, lambda d: replace(d, friction=parameters["force"]))


def _bow(machine: Machine, place: str, parameters: Parameters) -> Machine:
    return replace(machine, bow=machine.bow + parameters["curvature"] * _which_links(place))


def _pitch(machine: Machine, _place: str, parameters: Parameters) -> Machine:
    return replace(machine, rail_pitch=machine.rail_pitch + parameters["relative"])


def _width(machine: Machine, _place: str, parameters: Parameters) -> Machine:
    return replace(machine, width_error=machine.width_error + parameters["error"])


def _drift(machine: Machine, _place: str, parameters: Parameters) -> Machine:
    return _instrument(machine, drift=machine.instrument.drift + _axes(parameters))


def _gain_drift(machine: Machine, _place: str, parameters: Parameters) -> Machine:
    return _instrument(machine, gain_drift=parameters["relative"])


def _crosstalk(machine: Machine, place: str, parameters: Parameters) -> Machine:
    matrix = machine.instrument.crosstalk.copy()
    source, sink = place.split("->")
    matrix[AXES.index(sink), AXES.index(source)] += parameters["share"]
    return _instrument(machine, crosstalk=matrix)


def _quantum(machine: Machine, _place: str, parameters: Parameters) -> Machine:
    return _instrument(machine, quantum=_axes(parameters))


def _application(machine: Machine, _place: str, parameters: Parameters) -> Machine:
    return _instrument(machine, application=_axes(parameters)[:3])


def _bad_session(machine: Machine, _place: str, parameters: Parameters) -> Machine:
    return _instrument(machine, bad_session=parameters["relative"])


_BEARINGS = tuple(f"{link}.{end}" for link in LINKS for end in ("joint_a", "joint_b"))
_CROSSINGS = tuple(f"{a}->{b}" for a in AXES for b in AXES if a != b)

OUTSIDE: dict[str, tuple[tuple[str, ...], tuple[str, ...], Injector]] = {
    "one-soft-slider": (("limb1", "limb2"), ("factor",), _soft_slider),
    "one-loose-bearing": (_BEARINGS, ("radial",), _loose_bearing),
    "one-soft-guide": (("limb1", "limb2"), ("angular",), _soft_guide),
    "stage-guide": (("stage",), AXES, _stage_guide),
    "cable-chain": (("platform",), AXES[:3], _cable),
    "hardening-drive": (("limb1", "limb2", "limbs", "stage"), ("cubic",), _hardening),
    "drive-friction": (("limb1", "limb2", "limbs", "stage"), ("force",), _friction),
    "bowed-link": (("links", *LINKS), ("curvature",), _bow),
    "screw-pitch": (("limbs",), ("relative",), _pitch),
    "platform-width": (("platform",), ("error",), _width),
    "drifting-sensor": (("instrument",), AXES, _drift),
    "gain-drift": (("instrument",), ("relative",), _gain_drift),
    "cross-talk": (_CROSSINGS, ("share",), _crosstalk),
    "coarse-converter": (("instrument",), AXES, _quantum),
    "wrench-off-centre": (("instrument",), AXES[:3], _application),
    "bad-session": (("instrument",), ("relative",), _bad_session),
}
"""Faults that the vocabulary has no word for: places, parameters, and how each is planted."""


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
        raise InputError(f"effect: expected one of {valid}, found {effect!r}")
    if place not in places:
        raise InputError(f"{effect}, place: expected one of {', '.join(places)}, found {place!r}")
    strange = [name for name in parameters if name not in names]
    if strange:
        raise InputError(f"{effect}, {strange[0]}: expected one of {', '.join(names) or 'no parameters'}")
    if len(names) == 1 and names[0] not in parameters:
        raise InputError(f"{effect}, {names[0]}: expected this parameter")
    bad = [name for name, value in parameters.items() if not np.isfinite(value)]
    if bad or any(parameters.get(name, 1.0) <= 0 for name in ("factor",)):
        raise InputError(f"{effect}, {(bad or ['factor'])[0]}: expected a finite number, a factor above 0")
    return injector(machine, place, parameters)
