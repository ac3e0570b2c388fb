"""Blind cases: campaigns with withheld faults on any robot, and the seal that only the scorer opens."""

from __future__ import annotations

import base64
import json
import zlib
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.errors import InputError
from stiffscope.gap.forward.forward_model import word_of
from stiffscope.gap.lab.faults import ENTRIES, KNOWN, OUTSIDE, acts_on, bearing_words, inject, is_uniform
from stiffscope.gap.lab.machine import machine_of
from stiffscope.gap.lab.measuring import Noise, measure, true_readings
from stiffscope.gap.lab.plans import Workspace, draw_plan, workspace
from stiffscope.gap.lab.signatures import Signatures, apart, closest, spanned
from stiffscope.gap.lab.writing import write_readings
from stiffscope.robot.library import robot_names
from stiffscope.robot.part_dimensions import part_parameters, vanishing, with_parameter
from stiffscope.robot.part_matrices import part_matrices, part_sources
from stiffscope.robot.reader import load_robot
from stiffscope.robot.vocabulary import FORMER_WORDS

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from stiffscope.gap.lab.closure import Located
    from stiffscope.gap.lab.machine import Machine
    from stiffscope.gap.lab.measuring import Plan, Readings
    from stiffscope.gap.lab.plans import Style
    from stiffscope.gap.lab.rotations import Array
    from stiffscope.robot.effects import NominalRobot

KINDS = ("single", "single", "single", "pair", "pair", "triple", "triple", "none", "outside", "outside")
"""What is drawn in turn, so that a share of each is in every ten."""
STYLES: tuple[Style, ...] = ("tool", "gauges", "tool", "gauges", "tool", "sag")
"""What is measured, ten campaigns each in turn."""
SEAL = "seal.txt"

_LIKE = (8.075e-8, 1.346e-6)  # m/N, rad/(N·m): the scale of the robot at which the sizes of faults below hold
_BY_COUNT = ("none", "single", "pair", "triple")
_ATTEMPTS = 24  # at one more fault
_SERIES = 6  # of up to so many faults
_VISIBLE = 8.0  # standard deviations, of all readings together, by which a fault must stand out
_ALIKE = 4.0  # standard deviations, of all readings together, that nobody tells apart
_SAME = 1e-4  # of a signature, that may be left when another is fitted to it that no readings tell apart
_TURN = 1e-3  # rad, or of a scale: for derivatives
_IMITATORS = 3  # effects of the vocabulary that together may do what one outside of it does
_TWINS = 2  # other effects that the named group of a true one has room for
_POOL = 72  # poses of a robot from which a campaign takes its own
_SEED = 20  # of that pool
_RELATIVE = {"actuator-stiffness": 0.2, "link-stiffness": 0.15}  # compliance that a fault of size one adds
_ALL_DRIVES, _ALL_JOINTS, _ALL_BODIES = "drives", "joints", "robot"
_INSTRUMENT = "instrument"
_OF_INSTRUMENTS = {
    "instrument-misalignment": tuple({axis: _TURN} for axis in ("rx", "ry", "rz")),
    "displacement-scale": ({"factor": 1.0 + _TURN},),
    "force-scale": ({"factor": 1.0 + _TURN},),
}
"""Small steps of their parameters."""
_OF_SENSORS = {"instrument-misalignment", "displacement-scale"}


@dataclass(frozen=True)
class Fault:
    """A fault of the true machine, in the words of the vocabulary or of `OUTSIDE`."""

    effect: str
    place: str
    parameters: dict[str, float]

    @property
    def name(self) -> str:
        """`effect @ place`."""
        return f"{self.effect} @ {self.place}"


@dataclass(frozen=True)
class BlindCase:
    """What is withheld of one campaign, and what is measured in it."""

    kind: str
    seed: int
    faults: tuple[Fault, ...] = ()
    style: Style = "tool"


@dataclass(frozen=True)
class BlindRobot:
    """A robot whose campaigns are drawn.

    Attributes
    ----------
    nominal : the model that is diagnosed with, and its file.
    parts : matrix and mass of every part that is used, as `PartMatrix`.
    components : source of these matrices, as a campaign's header names it.
    """

    nominal: NominalRobot
    parts: Mapping[str, Any]
    components: str

    @property
    def name(self) -> str:
        """As its file has it."""
        return self.nominal.robot.name

    @property
    def reference(self) -> str:
        """How a campaign names it: a robot that comes along, or the path of its file."""
        path = self.nominal.robot.path
        return path.stem if path.stem in robot_names() and load_robot(path.stem).path == path else str(path.resolve())


class Lab:
    """A robot in the virtual lab: its sound machine, and where it can be measured."""

    def __init__(self, robot: BlindRobot, poses: int = _POOL) -> None:
        self.robot = robot
        file = robot.nominal.robot
        machine = machine_of(file, robot.parts)
        for effect in file.effects:  # which the model carries, and so does the machine
            machine = inject(machine, effect.effect, effect.place, effect.parameters)
        self.sound = machine
        self._steps: dict[str, dict[str, Array]] = {}
        self._words: dict[tuple[str, ...], dict[str, tuple[str, str]]] = {}
        self.workspace: Workspace = workspace(machine, poses, np.random.default_rng(_SEED))

    def with_faults(self, faults: Sequence[Fault]) -> Machine:
        """The machine with faults."""
        machine = self.sound
        for fault in faults:
            parameters = fault.parameters
            if fault.effect == "part-dimension":
                parameters = self._part_of(fault.place, parameters["value"])
            machine = inject(machine, fault.effect, fault.place, parameters)
        return machine

    def _part_of(self, place: str, value: float) -> dict[str, float]:
        """Entries of a part's compliance where one of its dimensions has another value."""
        part, key = place.rsplit(".", 1)
        other = with_parameter(self.robot.nominal.robot, part, key, value)
        compliance = part_matrices(other, self.robot.components)[part].compliance
        return _entries_of(compliance)

    def places(self, effect: str, sensors: Sequence[str] = ()) -> tuple[str, ...]:
        """Where an effect may act: elements and sets of them, each set once, or the instrument and its sensors."""
        file, machine = self.robot.nominal.robot, self.sound
        fixed = {
            "base-compliance": ("base",), "platform-compliance": ("tool",), "cable-chain": ("tool",),
            "force-scale": (_INSTRUMENT,), **dict.fromkeys(_OF_SENSORS, (_INSTRUMENT, *sensors)),
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
        if effect == "part-compliance":  # one matrix for bodies of one part
            places = tuple(p for p in places if len({machine.bodies[n].part for n in machine.members(p)}) == 1)
        return places

    def _takes(self, effect: str, name: str) -> bool:
        """Whether an effect may act on an element."""
        if not acts_on(self.sound, effect, name):
            return False
        joint, body = self.sound.joints.get(name), self.sound.bodies.get(name)
        if joint is not None and effect in {"joint-play", "stiffening-joint", "loose-bolt"}:
            return joint.drive is None
        if joint is not None and effect == "joint-compliance":  # that of a driven slide is its guide's
            return joint.drive is None or joint.kind != "prismatic"
        if body is not None and effect == "rigid-ends":
            return is_uniform(body)
        if body is not None and effect == "thermal":
            return body.expansion != 0.0
        return True

    def _dimensions(self) -> tuple[str, ...]:
        """Dimensions and constants of the material of parts whose matrix follows from them by beam theory."""
        file = self.robot.nominal.robot
        sources = part_sources(file, self.robot.components)
        return tuple(
            f"{part}.{key}"
            for part, source in sources.items()
            if isinstance(source, str) and source == "beam"
            for key in part_parameters(file, part)
        )

    def words(self) -> tuple[str, ...]:
        """Effects of the vocabulary that this robot can have."""
        foreign = {"gravity", *FORMER_WORDS}
        if not self.sound.gravity.any():
            foreign.add("payload")
        return tuple(effect for effect in KNOWN if effect not in foreign and self.places(effect))

    def everywhere(self, sensors: tuple[str, ...] = ()) -> dict[str, tuple[str, str]]:
        """All effects of the vocabulary at all their places, by their canonical names."""
        if sensors not in self._words:
            listed = [(effect, place) for effect in self.words() for place in self.places(effect, sensors)]
            self._words[sensors] = {self.canonical(f"{effect} @ {place}"): (effect, place) for effect, place in listed}
        return self._words[sensors]

    def softer(self, effect: str, place: str) -> dict[str, Array]:
        """Compliance that a small step of an effect's parameter adds to each body at a place."""
        if effect not in {"part-dimension", "link-stiffness", "rigid-ends"}:
            return {}
        name = f"{effect} @ {place}"
        if name not in self._steps:
            members = self.sound.members(place.rsplit(".", 1)[0] if effect == "part-dimension" else place)
            step = {
                "part-dimension": lambda: {"value": _other_dimension(self, place, 0.1)},
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
        """One name for all names of an effect at a place: groups, parts and elements may mean the same set."""
        effect, place = word_of(name), name.partition(" @ ")[2]
        if effect == "platform-compliance":
            place = "tool"
        members = self.sound.members(place)
        return f"{effect} @ {', '.join(sorted(members)) or place}"

    def size(self, drive: str) -> float:
        """Lever by which a drive moves the tool, m per rad; one for a sliding drive."""
        joint = self.sound.joints[drive]
        if joint.kind != "revolute":
            return 1.0
        away = self.sound.at - joint.at_first
        return max(0.05, float(np.linalg.norm(np.cross(joint.axes[:, 0], away))))


def draw(number: int, seed: int, lab: Lab) -> BlindCase:
    """The case of this number in a series: its kind in turn, its effects and their sizes by chance.

    What is drawn can be answered, if anything can: readings show every effect beside the others, whatever the
    parameters of these, and no more than two words of the vocabulary with as few parameters do the same to them.
    Where chance finds fewer such faults than wanted, the case is of the kind that these make, and nothing is planted
    where it finds none: in the sag of a hexapod no compliance shows, and six faults of a strut's length are alike.
    """
    rng = np.random.default_rng([seed, number])
    kind = KINDS[number % len(KINDS)]
    style = STYLES[number // len(KINDS) % len(STYLES)]
    if kind == "none":
        return BlindCase(kind, seed, (), style)
    if kind == "outside":
        names = [name for name in OUTSIDE if lab_has_outside(lab, name)]
        return BlindCase(kind, seed, (_outside(names[int(rng.integers(len(names)))], rng, lab, style),), style)
    judge = _Judge(BlindCase(kind, seed, (), style), number, lab)
    turn = number // len(KINDS) * 3 + number % len(KINDS)  # singles take one word after the other
    wanted, faults = _BY_COUNT.index(kind), ()
    for _ in range(_SERIES):
        faults = max(faults, _drawn(wanted, turn, rng, judge), key=len)
        if len(faults) == wanted:
            break
    return BlindCase(_BY_COUNT[len(faults)], seed, faults, style)


def _drawn(count: int, turn: int, rng: np.random.Generator, judge: _Judge) -> tuple[Fault, ...]:
    """So many faults of different words, or fewer, that can be told; a single one of the word whose turn it is."""
    lab = judge.lab
    words = lab.words()
    faults: tuple[Fault, ...] = ()
    for _ in range(count):
        left = [word for word in words if word not in {fault.effect for fault in faults}]
        for attempt in range(_ATTEMPTS if count > 1 else max(_ATTEMPTS, 3 * len(left))):
            word = left[(turn + attempt // 3) % len(left)] if count == 1 else _some(rng, left)
            tried = (*faults, _known(word, rng, lab, judge.sensors))
            if judge.decidable(tried):
                faults = tried
                break
        else:
            break
    return faults


def imitated(case: BlindCase, number: int, lab: Lab) -> bool:
    """Whether a few effects of the vocabulary do to the readings what a case's fault outside of it does.

    What these leave of its signature is less than what a fault must stand out by to be drawn. Of a fault that only
    shows in noisy readings, as a coarse converter's, nothing is known here: it is not imitated.
    """
    size, left = _Judge(case, number, lab).distance(case.faults[0])
    return left < _VISIBLE <= size


class _Judge:
    """Whether readings without noise tell the faults of a case from all else that could be named."""

    def __init__(self, case: BlindCase, number: int, lab: Lab) -> None:
        self.lab = lab
        _, self._plan, self._located, _ = prepared(case, number, lab)
        self._sound = self._shown(())
        self._known = Signatures(lab.sound, self._plan, self._located, self._sound, Noise())
        self.sensors = tuple(sensor.name for sensor in self._plan.sensors)
        self._own: dict[str, Array] = {}
        self._spans: dict[str, Array] = {}
        self._vain: dict[str, bool] = {}

    def _shown(self, faults: Sequence[Fault]) -> Readings:
        return true_readings(self.lab.with_faults(faults), self._plan, self._located)

    def _signature(self, fault: Fault) -> Array:
        """What a fault alone changes in the readings (r,), over their noise."""
        key = repr(fault)
        if key not in self._own:
            self._own[key] = (self._shown((fault,)).value - self._sound.value) / self._known.sigma
        return self._own[key]

    def _columns(self, fault: Fault) -> Array:
        """What a fault's effect can do to the readings (r, k), whatever its parameters."""
        columns = self._alone(fault.effect, fault.place)
        if columns is not None:
            return np.hstack([columns, self._signature(fault)[:, None]])
        if fault.name not in self._spans:
            kept = {"mass": fault.parameters["mass"]}  # of a payload, whose centre shows by it
            each = [replace(fault, parameters=kept | {name: value}) for name, value in fault.parameters.items()]
            self._spans[fault.name] = np.stack([self._signature(one) for one in each], axis=1)
        return self._spans[fault.name]

    def _alone(self, effect: str, place: str) -> Array | None:
        if effect in _OF_INSTRUMENTS:
            return np.stack([self._signature(Fault(effect, place, step)) for step in _OF_INSTRUMENTS[effect]], axis=1)
        return self._known.of(effect, place, self.lab.softer(effect, place))

    @cached_property
    def _everything(self) -> dict[str, Array]:
        """Columns (r, k) of all effects of the vocabulary, at all places where they have some."""
        found: dict[str, Array] = {}
        for name, (effect, place) in self.lab.everywhere(self.sensors).items():
            if (columns := self._alone(effect, place)) is not None:
                found[name] = columns
        return found

    def decidable(self, faults: Sequence[Fault]) -> bool:
        """Whether every one of the faults shows beside the others, and has few others like it; see `draw`."""
        if any(self._hopeless(fault) for fault in faults):
            return False
        for fault in reversed(faults):  # the last is the one that is new
            signature = self._signature(fault)
            others = [self._columns(other) for other in faults if other is not fault]
            beside = spanned(np.hstack([np.zeros((len(signature), 0)), *others]))
            left = apart(signature[:, None], beside)[:, 0]
            if np.linalg.norm(left) < _VISIBLE or len(self._alike(fault, left, beside)) > _TWINS:
                return False
        return True

    def distance(self, fault: Fault) -> tuple[float, float]:
        """Norms of a fault's signature, and of what the closest effects of the vocabulary leave of it, one by one."""
        left = self._signature(fault)
        size, basis = float(np.linalg.norm(left)), np.zeros((len(left), 0))
        columns = list(self._everything.values())
        for _ in range(_IMITATORS):
            if not columns or not np.linalg.norm(left) >= _VISIBLE:
                break
            spans = [spanned(apart(each, basis)) for each in columns]
            best = max(spans, key=lambda span: float(np.linalg.norm(span.T @ left)))
            basis = np.hstack([basis, best])
            left = apart(left[:, None], best)[:, 0]
        return size, float(np.linalg.norm(left))

    def _hopeless(self, fault: Fault) -> bool:
        """Whether no readings of this kind show a fault, or tell it from others, whatever its size."""
        if fault.name not in self._vain:
            columns = self._alone(fault.effect, fault.place)
            vain = columns is not None and not columns.any()
            if columns is not None and not vain and columns.shape[1] == 1:
                large = columns[:, 0] * (_ALIKE / _SAME / np.linalg.norm(columns))
                vain = len(self._alike(fault, large, np.zeros((len(large), 0)))) > _TWINS
            self._vain[fault.name] = vain
        return self._vain[fault.name]

    def _alike(self, fault: Fault, left: Array, beside: Array) -> set[str]:
        """Other effects that do the same to readings as a fault, with no more parameters at work than it has.

        left: (r,) what the other faults of its campaign leave of its signature; beside: (r, k) an orthonormal basis of
        what these can do.
        """
        found: set[str] = set()
        own = self.lab.canonical(fault.name)
        for name, columns in self._everything.items():
            if name == own:
                continue
            if word_of(name) == "part-compliance" and fault.effect != "part-compliance":  # entries follow a stiffness
                continue
            if closest(left, apart(columns, beside), len(fault.parameters)) < _ALIKE:
                found.add(name)
        return found


def _between(rng: np.random.Generator, low: float, high: float) -> float:
    """A size between two, its logarithm uniform."""
    return low * (high / low) ** rng.random()


def _some(rng: np.random.Generator, choices: Sequence[str]) -> str:
    return choices[int(rng.integers(0, len(choices)))]


def _known(effect: str, rng: np.random.Generator, lab: Lab, sensors: Sequence[str]) -> Fault:
    """A fault of the vocabulary: a place by chance, a size between small and large as this robot goes."""
    place = _some(rng, lab.places(effect, sensors))
    size = _between(rng, 0.3, 3.0)
    sign = 1.0 if rng.random() < 0.5 else -1.0
    soft, bend = (now / like for now, like in zip(_scale(lab), _LIKE, strict=True))
    members = lab.sound.members(place)
    if effect in _RELATIVE:
        return Fault(effect, place, {"factor": 1 / (1 + _RELATIVE[effect] * size)})
    if effect in {"displacement-scale", "force-scale"}:
        return Fault(effect, place, {"factor": 1 + sign * 0.02 * size})
    if effect == "part-compliance":
        return Fault(effect, place, _another_matrix(lab, members[0], size, rng))
    if effect == "part-dimension":
        return Fault(effect, place, {"value": _other_dimension(lab, place, sign * min(size, 2.0))})
    if effect == "payload":
        offset = {k: float(rng.uniform(-0.1, 0.1)) for k in ("x", "y", "z")}
        return Fault(effect, place, {"mass": 3.0 * size / max(1.0, soft), **offset})
    lever = max((lab.size(name) for name in members), default=1.0) if effect in {"backlash", "encoder-offset"} else 1.0
    length = float(np.mean([lab.sound.bodies[n].length for n in members])) if effect == "rigid-ends" else 0.0
    scale: Any = {
        "joint-compliance": {"radial": 3e-9 * soft, "axial": 3e-9 * soft, "tilting": 1e-6 * bend},
        "guide-compliance": {"lateral": 4e-9 * soft, "vertical": 4e-9 * soft, "angular": 8e-8 * bend},
        "base-compliance": _diagonal(8e-9 * soft, 8e-8 * bend),
        "platform-compliance": _diagonal(8e-9 * soft, 8e-8 * bend),
        "rigid-ends": {"length": 0.04 * length}, "backlash": {"half_width": 8e-6 / lever},
        "encoder-offset": {"offset": sign * 5e-5 / lever}, "link-length": {"error": sign * 3e-5},
        "thermal": {"temperature": sign * 4.0}, "instrument-misalignment": dict.fromkeys(("rx", "ry", "rz"), 0.015),
    }[effect]  # fmt: skip
    if effect == "joint-compliance":
        scale = {word: scale[word] for word in bearing_words([lab.sound.joints[name] for name in members])}
    return Fault(effect, place, {name: s * float(rng.uniform(0.2, 1.0)) * size for name, s in scale.items()})


def _scale(lab: Lab) -> tuple[float, float]:
    return lab.workspace.scale.linear, lab.workspace.scale.angular


def _diagonal(linear: float, angular: float) -> dict[str, float]:
    return {**dict.fromkeys(("x", "y", "z"), linear), **dict.fromkeys(("rx", "ry", "rz"), angular)}


def _another_matrix(lab: Lab, body: str, size: float, rng: np.random.Generator) -> dict[str, float]:
    """Entries of a part that is softer, and more so in some directions than in others."""
    stretch = np.diag(np.sqrt(1.0 + 0.8 * size * rng.uniform(0.2, 1.0, 6)))
    compliance = stretch @ lab.sound.bodies[body].compliance @ stretch
    return _entries_of(compliance)


def _entries_of(compliance: Array) -> dict[str, float]:
    """A compliance (6, 6) by the names of its entries."""
    return {name: float(compliance[int(name[1]) - 1, int(name[2]) - 1]) for name in ENTRIES}


def _other_dimension(lab: Lab, place: str, size: float) -> float:
    """Another value of a dimension: of a tube's radius or bore, one that makes its wall thinner or thicker.

    A modulus that no material has with the other one is turned to the other side of the nominal.
    """
    part, key = place.rsplit(".", 1)
    robot = lab.robot.nominal.robot
    nominal, unit = part_parameters(robot, part)[key]
    beyond = vanishing(robot, part, key)
    usual = 0.04 if unit == "m" and not beyond else 0.12
    value, other = (round(beyond + (nominal - beyond) * (1 + usual * s), 7) for s in (size, -size))
    try:
        with_parameter(robot, part, key, value)
    except InputError:
        return other
    return value


def _outside_places(lab: Lab, effect: str, channels: Sequence[str]) -> tuple[str, ...]:
    if effect == "cross-talk":
        return tuple(f"{a}->{b}" for a in channels for b in channels if a != b)
    if effect in {"drifting-sensor", "gain-drift", "coarse-converter", "wrench-off-centre", "bad-session"}:
        return (_INSTRUMENT,)
    return lab.places(effect)


def lab_has_outside(lab: Lab, effect: str) -> bool:
    """Whether a robot can have a fault outside the vocabulary that readings may show."""
    if effect == "screw-pitch":
        return any(lab.sound.joints[n].kind == "prismatic" for p in lab.places(effect) for n in lab.sound.members(p))
    return effect != "bowed-link" and bool(_outside_places(lab, effect, ("x", "y")))


def _outside(effect: str, rng: np.random.Generator, lab: Lab, style: Style) -> Fault:
    channels = [f"gauge{k + 1}" for k in range(5)] if style == "gauges" else ["x", "y", "z", "rx", "ry", "rz"]
    place = _some(rng, _outside_places(lab, effect, channels))
    size = _between(rng, 0.5, 3.0)
    soft = _scale(lab)[0] / _LIKE[0]
    scale = lab.workspace.scale
    members = lab.sound.members(place)
    stiffest = max(
        (d.stiffness for n in members if n in lab.sound.joints and (d := lab.sound.joints[n].drive)), default=1.0
    )
    lever = max((lab.size(name) for name in members if name in lab.sound.joints), default=1.0)
    bearing = 1e-8 * soft
    one = {
        # at the force that a lab applies a hardening drive has lost about a tenth of its deflection, as at 3e16 N/m³
        "hardening-drive": {"cubic": 2.4 * size * stiffest**3 / (10.0 * (scale.force * lever) ** 2)},
        "drive-friction": {"force": 0.08 * size * scale.force * lever},
        "stiffening-joint": {"radial": bearing * size, "knee": 0.2 * bearing * size * scale.force},
        "joint-play": {"radial": 4e-6 * size}, "loose-bolt": {"opening": bearing * size},
        "screw-pitch": {"relative": 1e-4 * size}, "larger-body": {"relative": 1e-3 * size},
        "gain-drift": {"relative": 0.05 * size}, "cross-talk": {"share": 0.03 * size},
        "bad-session": {"relative": 0.03 * size},
        "drifting-sensor": {"displacement": 4e-6 * size, "rotation": 1.5e-5 * size},
        "coarse-converter": {"displacement": 4e-6 * size, "rotation": 1.5e-5 * size},
    }  # fmt: skip
    if effect in one:
        return Fault(effect, place, one[effect])
    scales = {"cable-chain": 3e4 / soft, "wrench-off-centre": 0.004}[effect]
    return Fault(effect, place, {name: float(rng.uniform(0.3, 1.0)) * size * scales for name in ("x", "y", "z")})


def prepared(case: BlindCase, number: int, lab: Lab) -> tuple[Machine, Plan, Located, np.random.Generator]:
    """The true machine of a case, what is measured on it, and the noise to come."""
    rng = np.random.default_rng([case.seed, number, 1])
    sessions = 3 if any(fault.effect == "bad-session" for fault in case.faults) else 1
    plan, located = draw_plan(lab.workspace, rng, case.style, sessions=sessions)
    return lab.with_faults(case.faults), plan, located, rng


def write_case(folder: Path, number: int, case: BlindCase, lab: Lab) -> None:
    """Write the campaign of a case into a folder, without a word of what is in it."""
    machine, plan, located, rng = prepared(case, number, lab)
    readings = measure(machine, plan, Noise(), rng, located)
    robot = lab.robot
    write_readings(readings, folder, robot=robot.reference, pose=machine.pose, components=robot.components)


def seal(folder: Path, cases: Sequence[BlindCase]) -> None:
    """Write what is withheld where nobody reads it by accident."""
    content = [
        {
            "kind": case.kind,
            "seed": case.seed,
            "planted": [[p.effect, p.place, p.parameters] for p in case.faults],
            "measured": case.style,
        }
        for case in cases
    ]
    packed = base64.b85encode(zlib.compress(json.dumps(content).encode()))
    (folder / SEAL).write_bytes(packed + b"\n")


def unseal(folder: Path) -> list[BlindCase]:
    """What is withheld. Raises InputError for a seal that is missing or broken."""
    try:
        content: list[dict[str, Any]] = json.loads(
            zlib.decompress(base64.b85decode((folder / SEAL).read_bytes().strip()))
        )
    except (OSError, ValueError, zlib.error) as error:
        raise InputError(f"{folder / SEAL}: expected the seal that `stiffscope blind` wrote ({error})") from error
    return [
        BlindCase(c["kind"], c["seed"], tuple(Fault(*p) for p in c["planted"]), c.get("measured", "tool"))
        for c in content
    ]
