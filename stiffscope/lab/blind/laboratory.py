"""A robot in the virtual lab: its sound machine, possible faults and workspace."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.errors import InputError
from stiffscope.experiments.assembly import assemble_robots
from stiffscope.gap.effects.vocabulary import word_of
from stiffscope.gap.forward.robot_at_poses import configure_robot
from stiffscope.lab.blind.cases import Fault
from stiffscope.lab.faults import (
    ENTRIES,
    KNOWN,
    OUTSIDE,
    acts_on,
    inject,
    is_uniform,
)
from stiffscope.lab.machine import machine_of
from stiffscope.lab.plans import Workspace, workspace
from stiffscope.robot.library import robot_names
from stiffscope.robot.mechanism_of import rigid_mechanism
from stiffscope.robot.nominal import NominalRobot
from stiffscope.robot.part_dimensions import (
    find_vanishing,
    part_parameters,
    with_parameter,
)
from stiffscope.robot.part_matrices import part_matrices, part_sources
from stiffscope.robot.reader import load_robot
from stiffscope.vjm.kinematics.configurations import find_still, start_note

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from stiffscope.lab.hammer import Ringing
    from stiffscope.lab.machine import Machine
    from stiffscope.lab.measuring import Mechanics
    from stiffscope.lab.rotations import Array
    from stiffscope.robot.file.description import RobotFile
    from stiffscope.runtime.types import Flags
    from stiffscope.runtime.workshop import Workshop

_POOL = 72  # poses of a robot from which campaigns are drawn
_SEED = 20  # seed of that pool
_ALL_DRIVES = "drives"
_ALL_JOINTS = "joints"
_ALL_BODIES = "robot"
OF_POINTS = ("sensor-mass", "response-gain")
"""Known effects at the points of hammer tests."""


@dataclass(frozen=True)
class BlindRobot:
    """A robot whose campaigns are drawn.

    Attributes
    ----------
    nominal : the nominal model used for diagnosis, and its file.
    parts : matrix and mass of every part used, as `PartMatrix`.
    components : source of these matrices, as named in a campaign's header.
    mechanics : laboratory that measures: our own, or EXUDYN's.
    hammered : whether its campaigns are hammer tests.
    """

    nominal: NominalRobot
    parts: Mapping[str, Any]
    components: str
    mechanics: Mechanics = "own"
    hammered: bool = False

    @property
    def name(self) -> str:
        """Name in its file."""
        return self.nominal.robot.name

    @property
    def reference(self) -> str:
        """Name in a campaign: that of a bundled robot, or the path of its file."""
        path = self.nominal.robot.path
        bundled = path.stem in robot_names() and load_robot(path.stem).path == path
        return path.stem if bundled else str(path.resolve())


def blind_robots(
    robots: Sequence[RobotFile],
    components: str | None,
    shop: Workshop,
    mechanics: Mechanics = "own",
    *,
    hammered: bool = False,
) -> list[BlindRobot]:
    """Return the robots with their parts' matrices; raise InputError for one whose home is singular.

    Parameters
    ----------
    robots
        Robot files.
    components
        Source of the matrices of rods and plates; None: published if a part names a published
        matrix, else beam theory, neither of which needs a virtual experiment.
    shop
        Workshop that runs experiments if needed.
    mechanics
        Laboratory that measures.
    hammered
        Whether campaigns are hammer tests.
    """
    out: list[BlindRobot] = []
    for robot in robots:
        note = start_note(rigid_mechanism(robot))
        if note:
            raise InputError(
                f"{robot.path}: expected a regular home, where the laboratory starts; {note}"
            )
        published = any(
            getattr(part, "published", None) for part in robot.parts.values()
        )
        source = components or ("published" if published else "beam")
        made = assemble_robots({robot.name: robot}, source, shop)[robot.name]
        nominal = NominalRobot(made.mechanism, robot)
        out.append(BlindRobot(nominal, made.matrices, source, mechanics, hammered))
    return out


class Lab:
    """A robot in the virtual lab: its sound machine and workspace."""

    def __init__(self, robot: BlindRobot, poses: int = _POOL) -> None:
        self.robot = robot
        file = robot.nominal.robot
        still, kept = map(tuple, find_still(robot.nominal.mechanism))
        machine = replace(machine_of(file, robot.parts), still=still, kept=kept)
        for effect in file.effects:  # which model and machine have in common
            machine = inject(
                machine, word_of(effect.effect), effect.place, effect.parameters
            )
        self.sound = machine
        self._steps: dict[str, dict[str, Array]] = {}
        self.ringing: dict[tuple[str, int], Ringing] = {}
        """Modes with small faults at the poses of hammer tests."""
        self._words: dict[tuple[str, ...], dict[str, tuple[str, str]]] = {}
        self.workspace: Workspace = workspace(
            machine, poses, np.random.default_rng(_SEED), self._is_reached
        )

    def _is_reached(self, poses: Array) -> Flags:
        """Return which poses (n, k) the model reaches from home without passing a singular one."""
        return configure_robot(
            self.robot.nominal.mechanism, self.sound.pose, poses
        ).valid

    def with_faults(self, faults: Sequence[Fault]) -> Machine:
        """Return the machine with faults."""
        machine = self.sound
        for fault in faults:
            parameters = fault.parameters
            if fault.effect == "part-dimension":
                part, key = fault.place.rsplit(".", 1)
                other = with_parameter(
                    self.robot.nominal.robot, part, key, parameters["value"]
                )
                matrices = part_matrices(other, self.robot.components)
                parameters = entries_of(matrices[part].compliance)
            machine = inject(machine, fault.effect, fault.place, parameters)
        return machine

    def places(self, effect: str, sensors: Sequence[str] = ()) -> tuple[str, ...]:
        """Return the places of an effect: elements and distinct sets, or instrument and sensors."""
        file = self.robot.nominal.robot
        machine = self.sound
        where = {**KNOWN, **OUTSIDE}[effect].where
        if where is not None:
            return where(sensors)
        if (
            effect == "part-dimension"
        ):  # and material constants of parts computed by beam theory
            sources = part_sources(file, self.robot.components).items()
            parts = [
                n
                for n, source in sources
                if isinstance(source, str) and source == "beam"
            ]
            return tuple(
                f"{part}.{key}" for part in parts for key in part_parameters(file, part)
            )
        if effect in {"payload", "larger-body"}:
            rigid = [
                name for name, body in machine.bodies.items() if len(body.nodes) == 1
            ]
            return tuple(name for name in rigid if acts_on(machine, effect, name))
        sets = (
            []
            if effect == "backlash"
            else [*file.groups, *file.parts, _ALL_DRIVES, _ALL_JOINTS]
        )
        warm = [_ALL_BODIES] if effect == "thermal" else []
        found: dict[frozenset[str], str] = {}
        for place in [*machine.joints, *machine.bodies, *sets, *warm]:
            members = machine.members(place)
            if members and all(self._takes(effect, name) for name in members):
                found.setdefault(frozenset(members), place)
        places = tuple(found.values())
        if effect != "part-compliance":
            return places
        bodies = {
            place: [machine.bodies[n] for n in machine.members(place)]
            for place in places
        }
        parts = {
            p: {(body.part, len(body.nodes)) for body in each}
            for p, each in bodies.items()
        }
        one = {place: made.pop() for place, made in parts.items() if len(made) == 1}
        return tuple(place for place, (_, ends) in one.items() if ends == 2)

    def _takes(self, effect: str, name: str) -> bool:
        """Return whether an effect may act on an element."""
        if not acts_on(self.sound, effect, name):
            return False
        joint = self.sound.joints.get(name)
        body = self.sound.bodies.get(name)
        if joint is not None and effect in {
            "joint-play",
            "stiffening-joint",
            "loose-bolt",
        }:
            return joint.drive is None
        if (
            joint is not None and effect == "joint-compliance"
        ):  # driven slides have guides
            return joint.drive is None or joint.kind != "prismatic"
        if body is not None and effect == "rigid-ends":
            return is_uniform(body)
        return effect != "thermal" or body is None or body.expansion != 0.0

    def words(self) -> tuple[str, ...]:
        """Return the known effects that this robot can have."""
        foreign = {"gravity"}
        if not (self.sound.gravity.any() or self.robot.hammered):
            foreign |= {"payload", "mass"}  # without weight, only motion shows them
        return tuple(
            effect for effect in KNOWN if effect not in foreign and self.places(effect)
        )

    def everywhere(self, sensors: tuple[str, ...] = ()) -> dict[str, tuple[str, str]]:
        """Return all known effects at all their places, by canonical name."""
        if sensors not in self._words:
            words = dict.fromkeys((*self.words(), *(OF_POINTS if sensors else ())))
            listed = [(e, place) for e in words for place in self.places(e, sensors)]
            self._words[sensors] = {
                self.canonical(f"{e} @ {p}"): (e, p) for e, p in listed
            }
        return self._words[sensors]

    def softer(self, effect: str, place: str) -> dict[str, Array]:
        """Return the compliance added to each body at a place by a small parameter step."""
        name = f"{effect} @ {place}"
        sound = self.sound.bodies
        if name not in self._steps:
            members = self.sound.members(place)
            if effect == "part-dimension":
                members = self.sound.members(place.rsplit(".", 1)[0])
                step = {"value": other_dimension(self, place, 0.1)}
            elif effect == "link-stiffness":
                step = {"factor": 0.99}
            elif effect == "rigid-ends":
                step = {
                    "length": 0.01 * min(sound[member].length for member in members)
                }
            else:
                return {}
            changed = self.with_faults([Fault(effect, place, step)]).bodies
            self._steps[name] = {
                n: changed[n].compliance - sound[n].compliance for n in members
            }
        return self._steps[name]

    def canonical(self, name: str) -> str:
        """Return the canonical name of an effect at a place; different names may mean one set."""
        effect = word_of(name)
        place = name.partition(" @ ")[2]
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
    return {
        name: float(compliance[int(name[1]) - 1, int(name[2]) - 1]) for name in ENTRIES
    }


def other_dimension(lab: Lab, place: str, size: float) -> float:
    """Return another value of a dimension; for a tube's radii, one of another wall thickness.

    A modulus that is inconsistent with the other one is changed in the opposite direction.
    """
    part, key = place.rsplit(".", 1)
    robot = lab.robot.nominal.robot
    nominal, unit = part_parameters(robot, part)[key]
    beyond = find_vanishing(robot, part, key)
    usual = 0.04 if unit == "m" and not beyond else 0.12
    value, other = (
        round(beyond + (nominal - beyond) * (1 + usual * s), 7) for s in (size, -size)
    )
    try:
        with_parameter(robot, part, key, value)
    except InputError:
        return other
    return value
