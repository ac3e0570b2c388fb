"""A robot in the virtual lab: its sound machine, possible faults and workspace."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.effects.vocabulary import word_of
from stiffscope.errors import InputError
from stiffscope.gap.blind.cases import Fault
from stiffscope.gap.lab.closure import COORDINATES
from stiffscope.gap.lab.faults import ENTRIES, KNOWN, acts_on, inject, is_uniform
from stiffscope.gap.lab.machine import machine_of
from stiffscope.gap.lab.plans import Workspace, workspace
from stiffscope.robot.library import robot_names
from stiffscope.robot.part_dimensions import find_vanishing, part_parameters, with_parameter
from stiffscope.robot.part_matrices import part_matrices, part_sources
from stiffscope.robot.reader import load_robot

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from stiffscope.gap.lab.machine import Machine
    from stiffscope.gap.lab.rotations import Array
    from stiffscope.robot.nominal import NominalRobot

_POOL = 72  # poses of a robot from which campaigns are drawn
_SEED = 20  # seed of that pool
_ALL_DRIVES, _ALL_JOINTS, _ALL_BODIES = "drives", "joints", "robot"
INSTRUMENT = "instrument"
_OF_SENSORS = {"instrument-misalignment", "displacement-scale"}
_OF_CHANNELS = {"unit", "sensor-sign"}


@dataclass(frozen=True)
class BlindRobot:
    """A robot whose campaigns are drawn.

    Attributes
    ----------
    nominal : the nominal model used for diagnosis, and its file.
    parts : matrix and mass of every part used, as `PartMatrix`.
    components : source of these matrices, as named in a campaign's header.
    """

    nominal: NominalRobot
    parts: Mapping[str, Any]
    components: str

    @property
    def name(self) -> str:
        """Name in its file."""
        return self.nominal.robot.name

    @property
    def reference(self) -> str:
        """Name in a campaign: that of a bundled robot, or the path of its file."""
        path = self.nominal.robot.path
        return path.stem if path.stem in robot_names() and load_robot(path.stem).path == path else str(path.resolve())


class Lab:
    """A robot in the virtual lab: its sound machine and workspace."""

    def __init__(self, robot: BlindRobot, poses: int = _POOL) -> None:
        self.robot = robot
        file = robot.nominal.robot
        machine = machine_of(file, robot.parts)
        for effect in file.effects:  # which model and machine have in common
            machine = inject(machine, word_of(effect.effect), effect.place, effect.parameters)
        self.sound = machine
        self._steps: dict[str, dict[str, Array]] = {}
        self._words: dict[tuple[str, ...], dict[str, tuple[str, str]]] = {}
        self.workspace: Workspace = workspace(machine, poses, np.random.default_rng(_SEED))

    def with_faults(self, faults: Sequence[Fault]) -> Machine:
        """Return the machine with faults."""
        machine = self.sound
        for fault in faults:
            parameters = fault.parameters
            if fault.effect == "part-dimension":
                parameters = self._part_of(fault.place, parameters["value"])
            machine = inject(machine, fault.effect, fault.place, parameters)
        return machine

    def _part_of(self, place: str, value: float) -> dict[str, float]:
        """Return the entries of a part's compliance with another value of a dimension."""
        part, key = place.rsplit(".", 1)
        other = with_parameter(self.robot.nominal.robot, part, key, value)
        compliance = part_matrices(other, self.robot.components)[part].compliance
        return entries_of(compliance)

    def places(self, effect: str, sensors: Sequence[str] = ()) -> tuple[str, ...]:
        """Return the places of an effect: elements and distinct sets, or instrument and sensors."""
        file, machine = self.robot.nominal.robot, self.sound
        fixed = {
            "base-compliance": ("base",), "platform-compliance": ("tool",), "cable-chain": ("tool",),
            "force-scale": (INSTRUMENT,), **dict.fromkeys(_OF_SENSORS, (INSTRUMENT, *sensors)),
            **dict.fromkeys(_OF_CHANNELS, (INSTRUMENT, *(sensors or COORDINATES))),
            "sensor-step": tuple(sensors or COORDINATES),
        }  # fmt: skip
        if effect in fixed:
            return fixed[effect]
        if effect == "part-dimension":
            return self._dimensions()
        if effect in {"payload", "larger-body"}:
            rigid = [name for name, body in machine.bodies.items() if len(body.nodes) == 1]
            return tuple(name for name in rigid if acts_on(machine, effect, name))
        sets = [] if effect == "backlash" else [*file.groups, *file.parts, _ALL_DRIVES, _ALL_JOINTS]
        warm = [_ALL_BODIES] if effect == "thermal" else []
        found: dict[frozenset[str], str] = {}
        for place in [*machine.joints, *machine.bodies, *sets, *warm]:
            members = machine.members(place)
            if members and all(self._takes(effect, name) for name in members):
                found.setdefault(frozenset(members), place)
        places = tuple(found.values())
        if effect == "part-compliance":  # one matrix (6, 6) for bodies of one part
            made_of = {p: {(machine.bodies[n].part, len(machine.bodies[n].nodes)) for n in machine.members(p)}
                       for p in places}  # fmt: skip
            places = tuple(p for p, parts in made_of.items() if len(parts) == 1 and next(iter(parts))[1] == 2)
        return places

    def _takes(self, effect: str, name: str) -> bool:
        """Return whether an effect may act on an element."""
        if not acts_on(self.sound, effect, name):
            return False
        joint, body = self.sound.joints.get(name), self.sound.bodies.get(name)
        if joint is not None and effect in {"joint-play", "stiffening-joint", "loose-bolt"}:
            return joint.drive is None
        if joint is not None and effect == "joint-compliance":  # driven slides have guides
            return joint.drive is None or joint.kind != "prismatic"
        if body is not None and effect == "rigid-ends":
            return is_uniform(body)
        if body is not None and effect == "thermal":
            return body.expansion != 0.0
        return True

    def _dimensions(self) -> tuple[str, ...]:
        """Return the dimensions and material constants of parts computed by beam theory."""
        file = self.robot.nominal.robot
        sources = part_sources(file, self.robot.components)
        return tuple(
            f"{part}.{key}"
            for part, source in sources.items()
            if isinstance(source, str) and source == "beam"
            for key in part_parameters(file, part)
        )

    def words(self) -> tuple[str, ...]:
        """Return the known effects that this robot can have."""
        foreign = {"gravity"} if self.sound.gravity.any() else {"gravity", "payload"}
        return tuple(effect for effect in KNOWN if effect not in foreign and self.places(effect))

    def everywhere(self, sensors: tuple[str, ...] = ()) -> dict[str, tuple[str, str]]:
        """Return all known effects at all their places, by canonical name."""
        if sensors not in self._words:
            listed = [(effect, place) for effect in self.words() for place in self.places(effect, sensors)]
            self._words[sensors] = {self.canonical(f"{effect} @ {place}"): (effect, place) for effect, place in listed}
        return self._words[sensors]

    def softer(self, effect: str, place: str) -> dict[str, Array]:
        """Return the compliance added to each body at a place by a small parameter step."""
        if effect not in {"part-dimension", "link-stiffness", "rigid-ends"}:
            return {}
        name = f"{effect} @ {place}"
        if name not in self._steps:
            members = self.sound.members(place.rsplit(".", 1)[0] if effect == "part-dimension" else place)
            step = {
                "part-dimension": lambda: {"value": other_dimension(self, place, 0.1)},
                "link-stiffness": lambda: {"factor": 0.99},
                "rigid-ends": lambda: {"length": 0.01 * self._shortest(members)},
            }[effect]()
            changed = self.with_faults([Fault(effect, place, step)]).bodies
            sound = self.sound.bodies
            self._steps[name] = {n: changed[n].compliance - sound[n].compliance for n in members}
        return self._steps[name]

    def _shortest(self, members: Sequence[str]) -> float:
        return min(self.sound.bodies[name].length for name in members)

    def canonical(self, name: str) -> str:
        """Return the canonical name of an effect at a place; different names may mean one set."""
        effect, place = word_of(name), name.partition(" @ ")[2]
        if effect == "platform-compliance":
            place = "tool"
        members = self.sound.members(place)
        return f"{effect} @ {', '.join(sorted(members)) or place}"

    def drive_lever(self, drive: str) -> float:
        """Return the lever of a drive on the tool, m per rad; one for a linear drive."""
        joint = self.sound.joints[drive]
        if joint.kind != "revolute":
            return 1.0
        away = self.sound.at - joint.at_first
        return max(0.05, float(np.linalg.norm(np.cross(joint.axes[:, 0], away))))


def entries_of(compliance: Array) -> dict[str, float]:
    """Return a compliance (6, 6) by the names of its entries."""
    return {name: float(compliance[int(name[1]) - 1, int(name[2]) - 1]) for name in ENTRIES}


def other_dimension(lab: Lab, place: str, size: float) -> float:
    """Return another value of a dimension; for a tube's radii, one of another wall thickness.

    A modulus that is inconsistent with the other one is changed in the opposite direction.
    """
    part, key = place.rsplit(".", 1)
    robot = lab.robot.nominal.robot
    nominal, unit = part_parameters(robot, part)[key]
    beyond = find_vanishing(robot, part, key)
    usual = 0.04 if unit == "m" and not beyond else 0.12
    value, other = (round(beyond + (nominal - beyond) * (1 + usual * s), 7) for s in (size, -size))
    try:
        with_parameter(robot, part, key, value)
    except InputError:
        return other
    return value
