"""Base classes of effects: places, parameters with priors, and changes of the robot.

Each effect is a frozen dataclass in its own module; an instance acts at one place. A fit uses
internal parameters, zero without the effect and chosen so that readings are nearly linear in them
(``u = 1/factor - 1`` for a stiffness factor); the vocabulary states physical ones. `influence`, a
function of the internal ones, is used to build the robot, to predict readings and to differentiate.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar, NamedTuple

import numpy as np

from stiffscope.robot.nominal import NominalRobot, Place
from stiffscope.runtime.types import Array
from stiffscope.vjm.model.mechanism import Change, Mechanism

__all__ = [  # names that effect modules import
    "ADDED",
    "FACTOR",
    "FREE",
    "GROWTH",
    "KNOWN",
    "STIFFNESS_FACTOR",
    "UNNAMED",
    "Array",
    "Candidate",
    "Candidates",
    "Changes",
    "Doubts",
    "Effect",
    "Influence",
    "Knee",
    "NominalRobot",
    "Parameter",
    "Payload",
    "Place",
    "Preload",
    "Row",
    "Setting",
]

Changes = dict[str, Change]
"""Changes by element name, in the element's own axes."""
KNOWN = 3.0
"""Largest deviation of a true mass from the stated one, in standard uncertainties."""
Conversion = tuple[Callable[[Any], Any], Callable[[Any], Any]]
"""Functions from internal to physical parameters and back."""

FREE = (-np.inf, np.inf)
ADDED = (0.0, np.inf)
"""Bounds of parameters that cannot be negative, such as an added compliance or a dead zone."""
FACTOR = (-0.8, 50.0)
"""Bounds of ``1/factor - 1`` or ``factor - 1``, which exclude infinite stiffness."""
STIFFNESS_FACTOR: Conversion = (
    lambda u: 1.0 / (1.0 + u),
    lambda factor: 1.0 / factor - 1.0,
)
"""Conversion of a stiffness factor, where the compliance is multiplied by ``1 + u``."""
GROWTH: Conversion = (lambda growth: 1.0 + growth, lambda factor: factor - 1.0)
"""Conversion of a factor with its relative change as internal parameter."""


def _keep(values: Array) -> Array:
    return values


UNNAMED = "unknown"
"""Effect name of nuisance patterns, which are not in the vocabulary."""


@dataclass(frozen=True)
class Candidate:
    """An effect at a place that may explain a gap, with k parameters and their priors.

    A fit uses the internal parameters (k,), zero without the effect; users state the physical ones.
    """

    effect: str
    place: str
    names: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    scale: tuple[float, ...] = ()
    """Prior scale of the internal parameters, derived from the robot; the prior has heavy tails."""
    plausible: tuple[tuple[float, float], ...] = ()
    """Plausible range of each physical parameter."""
    possible: tuple[tuple[float, float], ...] = ()
    """Range of each beyond which it is no cause; empty: the plausible one. Between the two, the
    `sums` are reported in its place."""
    bounds: tuple[float, float] = (-np.inf, np.inf)
    """Computable range of every internal parameter."""
    physical: Callable[[Array], Array] = _keep
    """Function from internal to physical parameters (k,)."""
    internal: Callable[[Array], Array] = _keep
    """Function from physical to internal parameters (k,)."""
    component: str = ""
    """Part of the machine that the effect blames, if a single one."""
    aliases: tuple[str, ...] = ()
    """Other names of this effect at this place, as `effect @ place`."""
    twins: tuple[tuple[Candidate, float], ...] = ()
    """Other effects with the same signature, and their internal parameter over this one's."""
    odds: float = 1.0
    """Factor on the prior odds of this form of the effect."""
    guessed: bool = False
    """True if the robot file says that all its values are guesses: that they differ is expected."""
    stated: bool = False
    """True if the prior size is a stated tolerance: a standard uncertainty, without heavy tails."""
    groups: tuple[int, ...] = ()
    """Numbers of consecutive internal parameters that share an unknown size; by default all do."""
    parts: tuple[str, ...] = ()
    """Names of the internal parameters, `JOINT.NAME`, if the physical ones only summarize them."""
    part_units: tuple[str, ...] = ()
    couplings: int = 0
    """Number of trailing internal parameters that couple the others; these may have either sign."""
    sums: tuple[tuple[str, str, tuple[float, ...]], ...] = ()
    """Name, unit and coefficients (k,) of sums of the internal parameters that readings show
    where they do not show the physical ones: the moments of a mass whose place is open."""
    flexible: bool = False
    """True if it can fit almost anything; such effects are not used to estimate noise."""
    pattern: str = ""
    """Kind of a nuisance pattern, independent of its place."""
    spell: Callable[[Array], str] | None = None
    """Words for a nuisance pattern by its fitted parameters, where their sign is free."""
    like: str = ""
    """Effect that a nuisance pattern resembles, at a place where that effect is not defined."""
    swarming: bool = False
    """True for patterns so numerous that together they would fit noise."""
    members: tuple[str, ...] = ()
    """Names of the elements that it changes."""
    weighs: bool = False
    """True if it only acts where the robot's weight does."""
    merges: bool = True
    """True if it may be the twin of another effect."""
    assumed: bool = False
    """True if it is assumed present for the estimate of noise."""
    imitates: bool = False
    """True if doubts about instruments are raised again without it."""
    joins_noise: bool = True
    """True if the estimate of noise fits it together with all others."""
    gives_way: bool = False
    """True if that estimate leaves it out first where all together would fit anything."""
    rests_in: str = ""
    """Effect in whose dead zone of the same element it may be no more than the place of rest."""
    action: Any = None
    """Action of the candidate (an `Effect` on robots); only the forward model uses it."""

    @property
    def name(self) -> str:
        """`effect @ place`."""
        return f"{self.effect} @ {self.place}"

    @property
    def signature_of(self) -> tuple[str, ...]:
        """Names of all effects with the same signature, its own first."""
        return (self.name, *(twin.name for twin, _ in self.twins))

    @property
    def positive(self) -> bool:
        """Whether all internal parameters except couplings are non-negative."""
        return self.bounds[0] == 0.0

    @property
    def one_sided(self) -> tuple[bool, ...]:
        """Flags (k,) of the internal parameters that cannot be negative."""
        return (self.positive,) * (len(self.scale) - self.couplings) + (
            False,
        ) * self.couplings

    @property
    def is_nuisance(self) -> bool:
        """Whether it is a nuisance pattern."""
        return self.effect == UNNAMED

    def describe(self, values: Sequence[float]) -> str:
        """Return the place, or a nuisance pattern in the words of what was found."""
        return self.place if self.spell is None else self.spell(np.array(values))

    @property
    def simple(self) -> bool:
        """Whether it is a known effect with parameters, without couplings, and not flexible."""
        return bool(self.scale) and not (
            self.is_nuisance or self.flexible or self.couplings
        )


Candidates = Iterator[Candidate]


class Parameter(NamedTuple):
    """A physical parameter, SI, with the prior size of its internal one and its plausible range."""

    name: str
    unit: str
    size: float = 1.0
    low: float = -np.inf
    high: float = np.inf


@dataclass(frozen=True)
class Payload:
    """A mass on a body, kg, with first moments (3,), kg·m, about ``at`` (3,), in the home pose.

    A constant ``force`` (3,), N, base axes, pulls at the same point, such as that of a cable.
    The weight of a mass ``carried``, kg, is taken off, as by a spring; its inertia stays.
    ``inertia`` (3, 3), kg·m², is that about its own centre, home axes; zero of a point mass.
    """

    body: str
    at: Array
    mass: float
    moments: Array
    force: Array = field(default_factory=lambda: np.zeros(3))
    carried: float = 0.0
    inertia: Array = field(default_factory=lambda: np.zeros((3, 3)))


class Knee(NamedTuple):
    """Load of a drive, N or N·m, and the growth of its compliance below and beyond it."""

    load: float
    below: float
    beyond: float

    def bend(self, force: Array) -> Array:
        """Return what is added to forces (n,): those by which a linear drive would yield as much more."""
        small = np.clip(force, -self.load, self.load)
        return self.below * small + self.beyond * (force - small)


class Preload(NamedTuple):
    """Force, N or N·m, that holds a drive to a side of its gap beside the weight.

    reach: change of it by which its effect on readings, which step, is differentiated.
    """

    force: float
    reach: float


Row = tuple[int, int]
"""A row of readings: file number and line number."""


@dataclass(frozen=True)
class Doubts:
    """Suspected instrument faults of a campaign, from comparing readings with the model."""

    units: Mapping[str, float] = field(default_factory=dict[str, float])
    """Apparent factor on the readings, by instrument."""
    signs: tuple[str, ...] = ()
    """Instruments with an apparently reversed sign."""
    steps: Mapping[str, tuple[Row, float, bool]] = field(default_factory=dict[str, Any])
    """First row after an apparent slip, size of the readings, m or rad, and whether rad."""
    swaps: tuple[tuple[str, str], ...] = ()
    """Pairs of columns that seem to be exchanged."""

    @property
    def key(self) -> tuple[frozenset[Any], ...]:
        """What is doubted: units, signs, rows of slips, and exchanged columns."""
        slips = ((name, row) for name, (row, _, _) in self.steps.items())
        return (
            frozenset(self.units),
            frozenset(self.signs),
            frozenset(slips),
            frozenset(self.swaps),
        )


@dataclass(frozen=True)
class Influence:
    """Changes that an effect makes to a robot and its instruments."""

    elements: Changes = field(default_factory=dict[str, Change])
    """Added compliance of elements and displacement of their unloaded ends."""
    payloads: tuple[Payload, ...] = ()
    weight: bool = False
    """Whether the robot's own weight acts."""
    carried: float = 0.0
    """Share of the weight of the whole robot that springs carry, as its payloads say in kg."""
    dead_zones: Mapping[str, float] = field(default_factory=dict[str, float])
    """Half-width of a drive's dead zone, m or rad, by joint."""
    preloads: Mapping[str, Preload] = field(default_factory=dict[str, Any])
    """What holds drives with a dead zone to a side, by joint; of others each reading starts in the
    middle."""
    turns: Mapping[str, Array] = field(default_factory=dict[str, Any])
    """Small rotation (3,) of an instrument's readings."""
    gains: Mapping[str, float] = field(default_factory=dict[str, float])
    """Relative gain error of an instrument."""
    force_gain: float = 0.0
    """Relative excess of the applied wrench over the stated one."""
    factors: Mapping[str, float] = field(default_factory=dict[str, float])
    """Factor on the numbers of an instrument: a wrong unit or a reversed sign."""
    jumps: Mapping[str, tuple[Row, float]] = field(default_factory=dict[str, Any])
    """First row after a jump of an instrument and the size of the jump, m or rad."""
    frictions: Mapping[str, float] = field(default_factory=dict[str, float])
    """Force or torque that holds a drive before it moves, N or N·m, by joint."""
    knees: Mapping[str, Knee] = field(default_factory=dict[str, Any])
    """Loads at which the stiffness of drives changes, by joint."""
    leak: Array | None = None
    """Shares (3, 3) of the true force's components that the force sensor adds to others."""
    load_gains: Mapping[float, float] = field(default_factory=dict[float, float])
    """Relative excess of the applied loads of one stated size, N or N·m, by that size."""
    swaps: tuple[tuple[str, str], ...] = ()
    """Pairs of exchanged columns."""
    sensor_masses: Mapping[str, float] = field(default_factory=dict[str, float])
    """Further mass, kg, of what is screwed to points of responses, by point."""
    response_gains: Mapping[str, float] = field(default_factory=dict[str, float])
    """Relative excess of measured motions over the true ones, by channel of responses."""


@dataclass(frozen=True)
class Setting:
    """A robot and how it is measured; by default, only effects that it can adopt are candidates."""

    robot: NominalRobot
    compliance: tuple[float, float] = (1.0, 1.0)
    """Compliance of the robot at M, m/N and rad/(N·m): scale of added compliances."""
    turning: Mapping[str, bool] = field(default_factory=dict[str, bool])
    """Whether a rigid body rotates relative to gravity between poses; by default it does."""
    tool_is_read: bool = True
    """Whether there are readings at M."""
    sensors: Mapping[str, bool] = field(default_factory=dict[str, bool])
    """Whether a sensor reads displacements, by name."""
    suspect: Callable[[str], bool] = lambda _: False
    """Whether the (slow) virtual experiments on a part are worthwhile."""
    doubts: Doubts = field(default_factory=Doubts)
    tool_is_used: bool = True
    """Whether there are readings or loads at M."""
    tool_turns: bool = True
    """Whether rotations of the unloaded tool are read at M."""
    forces: tuple[bool, bool, bool] = (True, True, True)
    """Whether a force is applied along x, y, z."""
    load_values: tuple[tuple[float, str], ...] = ()
    """Sizes of the applied loads and their unit, where there are at least three."""
    drive_forces: Mapping[str, float] = field(default_factory=dict[str, float])
    """Largest force or torque that the applied loads exert on each drive, N or N·m."""
    points: Mapping[str, bool] = field(default_factory=dict[str, bool])
    """Whether the mass of the sensor at a point of responses is stated, by point."""
    channels: Mapping[str, str] = field(default_factory=dict[str, str])
    """Point of each channel of responses: a direction in which motion is measured."""

    @property
    def shows_inertia(self) -> bool:
        """Whether responses show masses, whatever they weigh."""
        return bool(self.points)

    @cached_property
    def length(self) -> float:
        """Largest distance of two joints, or of the tool from one, m."""
        return find_length(self.robot.mechanism)

    @cached_property
    def mass(self) -> float:
        """Mass of all bodies, kg; one where none is known."""
        return sum(body.mass for body in self.robot.mechanism.bodies) or 1.0

    def in_robots_units(self, parameters: Sequence[Parameter]) -> tuple[Parameter, ...]:
        """Return parameters whose sizes and ranges are shares of the robot's own, by unit."""
        soft, loose = self.compliance
        units = {"m/N": soft, "rad/(N·m)": loose, "m": self.length, "kg": self.mass}
        own = ((p, units.get(p.unit, 1.0)) for p in parameters)
        return tuple(
            Parameter(*p[:2], *(unit * value for value in p[2:])) for p, unit in own
        )


def find_length(mechanism: Mechanism) -> float:
    """Return the largest distance of two joints, or of the tool from one, m."""
    points = np.array([*(joint.at for joint in mechanism.joints), mechanism.tool.at])
    return float(np.linalg.norm(points[:, None] - points, axis=2).max()) or 1.0


_FACTS = (
    "weighs",
    "merges",
    "assumed",
    "imitates",
    "joins_noise",
    "gives_way",
    "rests_in",
)
"""Facts of an effect that all its candidates share."""


class Effect(ABC):
    """Base class of effects; an instance acts at one place."""

    word: ClassVar[str]
    parameters: ClassVar[tuple[Parameter, ...]] = ()
    precedence: ClassVar[int]
    """Order in the vocabulary; indistinguishable effects are named after the first."""
    also: ClassVar[tuple[str, ...]] = ()
    """Other names of the same effect."""
    conversion: ClassVar[Conversion | None] = None
    """Conversion of a single factor."""
    bounds: ClassVar[tuple[float, float]] = FREE
    """Computable range of every internal parameter."""
    adoptable: ClassVar[bool] = False
    """Whether a robot file may contain it."""
    blames: ClassVar[bool] = False
    """Whether it blames its element if it acts on a single one."""
    linear: ClassVar[bool] = False
    """Whether its changes are proportional to its internal parameters: steps are taken only once."""
    of_matrix: ClassVar[bool] = False
    """Whether it changes a part's compliance matrix."""
    weighs: ClassVar[bool] = False
    """Whether it only acts where the robot's weight does."""
    merges: ClassVar[bool] = True
    """Whether it may be the twin of another effect, named after that."""
    assumed: ClassVar[bool] = False
    """Whether it is assumed present for the estimate of noise, as readings raised the doubt."""
    imitates: ClassVar[bool] = False
    """Whether it follows faults of the robot, so that doubts are raised again without it."""
    joins_noise: ClassVar[bool] = True
    """Whether the estimate of noise fits it together with all others."""
    gives_way: ClassVar[bool] = False
    """Whether that estimate leaves it out first where all together would fit anything."""
    rests_in: ClassVar[str] = ""
    """Effect in whose dead zone of the same element it may be no more than the place of rest."""

    @classmethod
    def candidates(cls, setting: Setting) -> Candidates:
        """Yield the effect at every possible place, sets before single elements."""
        raise NotImplementedError

    @abstractmethod
    def influence(self, values: Array) -> Influence:
        """Return the changes for internal parameters (k,)."""

    @classmethod
    def refusal(cls, robot: NominalRobot, place: str) -> str:
        """Return why a robot file cannot contain it; empty if it can."""
        del robot
        reason = (
            f"{cls.word} @ {place}: no part of the robot; correct the readings instead"
        )
        return "" if cls.adoptable else reason

    def make_candidate(
        self, place: Place, parameters: Sequence[Parameter] | None = None, **more: Any
    ) -> Candidate:
        """Return this effect as a candidate.

        Parameters
        ----------
        place
            Where it acts.
        parameters
            Parameters at this place; by default all of the effect's.
        more
            Fields of the candidate that override the defaults.
        """
        given = self.parameters if parameters is None else parameters
        physical, internal = self.conversion or (_keep, _keep)
        fields: dict[str, Any] = {
            "effect": self.word,
            "place": place.name,
            "names": tuple(p.name for p in given),
            "units": tuple(p.unit for p in given),
            "scale": tuple(float(p.size) for p in given),
            "plausible": tuple((float(p.low), float(p.high)) for p in given),
            "bounds": self.bounds,
            "physical": physical,
            "internal": internal,
            "component": place.sole if self.blames else "",
            "aliases": tuple(f"{self.word} @ {other}" for other in place.others),
            "members": place.members,
            **{fact: getattr(self, fact) for fact in _FACTS},
        }
        return Candidate(action=self, **(fields | more))
