"""What an effect is: where it may act, its parameters with their priors, and what it changes.

An effect is a small frozen class in a module of its own; its instance acts at one place. Internal parameters are those
of a fit, zero without the effect, such that readings are as linear in them as can be (``u = 1/factor - 1`` for a
stiffness factor); physical parameters are those of the vocabulary. One function of the internal parameters, the
effect's `influence`, serves to build the robot that has the effect, to predict readings, and to differentiate both.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar, NamedTuple

import numpy as np

from stiffscope.robot.nominal import NominalRobot, Place
from stiffscope.runtime.types import Array
from stiffscope.vjm.mechanism import Change

__all__ = [  # all that an effect's module needs
    "ADDED", "FACTOR", "FREE", "GROWTH", "KNOWN", "STIFFNESS_FACTOR", "UNNAMED", "Array", "Candidate", "Candidates",
    "Changes", "Doubts", "Effect", "Influence", "NominalRobot", "Parameter", "Payload", "Place", "Row", "Setting",
]  # fmt: skip

Changes = dict[str, Change]
"""Changes by the element's name, in its own axes."""
KNOWN = 3.0
"""Standard uncertainties of a stated mass by which the true one differs at most."""
Conversion = tuple[Callable[[Any], Any], Callable[[Any], Any]]
"""Physical parameters of internal ones, and the way back."""

FREE = (-np.inf, np.inf)
ADDED = (0.0, np.inf)
"""Bounds of what can only be added: a compliance, a dead zone."""
FACTOR = (-0.8, 50.0)
"""Bounds of ``1/factor - 1`` or ``factor - 1``: nothing becomes infinitely stiff."""
STIFFNESS_FACTOR: Conversion = (lambda u: 1.0 / (1.0 + u), lambda factor: 1.0 / factor - 1.0)
"""Factor on a stiffness whose compliance grows by ``1 + u``."""
GROWTH: Conversion = (lambda growth: 1.0 + growth, lambda factor: factor - 1.0)
"""Factor on what grows by a relative amount."""


def _keep(values: Array) -> Array:
    return values


UNNAMED = "unknown"
"""Effect of a nuisance pattern, for which the vocabulary has no word."""


@dataclass(frozen=True)
class Candidate:
    """An effect at a place that may explain a gap, with k parameters and what is known of them before the data.

    Internal parameters (k,) are those of the fit, zero without the effect; physical ones are those of the vocabulary.
    """

    effect: str
    place: str
    names: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    scale: tuple[float, ...] = ()
    """Prior size of the internal parameters: a unit that follows from the robot, about which they have heavy tails."""
    plausible: tuple[tuple[float, float], ...] = ()
    """Plausible range of each physical parameter."""
    bounds: tuple[float, float] = (-np.inf, np.inf)
    """Range of every internal parameter that can be computed."""
    physical: Callable[[Array], Array] = _keep
    """Physical parameters (k,) of internal ones."""
    internal: Callable[[Array], Array] = _keep
    """Internal parameters (k,) of physical ones."""
    component: str = ""
    """Part of the machine that it blames, if it is one."""
    aliases: tuple[str, ...] = ()
    """Other names, as `effect @ place`, for this effect at this place."""
    twins: tuple[str, ...] = ()
    """Other effects, as `effect @ place`, with the very same signature in the readings."""
    stated: bool = False
    """True where the prior size is a stated tolerance: a standard uncertainty, without heavy tails."""
    groups: tuple[int, ...] = ()
    """How many internal parameters share each unknown size, in their order; by default all share one."""
    parts: tuple[str, ...] = ()
    """Names of the internal parameters, `JOINT.NAME`, where the physical ones only sum them up."""
    part_units: tuple[str, ...] = ()
    couplings: int = 0
    """How many of the last internal parameters couple the others: these have either sign."""
    flexible: bool = False
    """True where it can follow almost anything, so that it says nothing about noise."""
    pattern: str = ""
    """Of a nuisance pattern: what it is, wherever it acts."""
    like: str = ""
    """Of a nuisance pattern: the word whose fault it is, at a place where the word cannot be."""
    swarming: bool = False
    """True for patterns of which there are so many that together they would follow noise."""
    members: tuple[str, ...] = ()
    """The elements that it changes."""
    action: Any = None
    """What it does (an `Effect` on robots); only the forward model looks inside."""

    @property
    def name(self) -> str:
        """`effect @ place`."""
        return f"{self.effect} @ {self.place}"

    @property
    def signature_of(self) -> tuple[str, ...]:
        """All effects with its signature, itself first."""
        return (self.name, *self.twins)

    @property
    def positive(self) -> bool:
        """Whether no internal parameter but couplings can be negative: an added compliance, a dead zone."""
        return self.bounds[0] == 0.0

    @property
    def one_sided(self) -> tuple[bool, ...]:
        """Which internal parameters cannot be negative."""
        return tuple(self.positive and k < len(self.scale) - self.couplings for k in range(len(self.scale)))

    @property
    def is_nuisance(self) -> bool:
        """Whether it is a nuisance pattern."""
        return self.effect == UNNAMED

    @property
    def simple(self) -> bool:
        """Whether it has a word, and can do little else than what the word says."""
        return not (self.is_nuisance or self.flexible or self.couplings)


Candidates = Iterator[Candidate]


class Parameter(NamedTuple):
    """A physical parameter, SI, with the prior size of its internal one (see `Candidate`) and its plausible range."""

    name: str
    unit: str
    size: float = 1.0
    low: float = -np.inf
    high: float = np.inf


@dataclass(frozen=True)
class Payload:
    """A mass that a body carries: kg, and its first moments (3,) in kg·m about ``at`` (3,), both at home."""

    body: str
    at: Array
    mass: float
    moments: Array


Row = tuple[int, int]
"""A row of readings: number of its file, line in it."""


@dataclass(frozen=True)
class Doubts:
    """What the readings of a campaign's instruments look like beside its model, by instrument."""

    units: Mapping[str, float] = field(default_factory=dict[str, float])
    """Factor that the numbers seem to be multiplied with."""
    signs: tuple[str, ...] = ()
    """Instruments that seem to be reversed."""
    steps: Mapping[str, tuple[Row, float, bool]] = field(default_factory=dict[str, Any])
    """From which row on they seem to have slipped, how large their readings are, m or rad, and whether in rad."""


@dataclass(frozen=True)
class Influence:
    """What an effect changes in a robot and in the instruments that read it."""

    elements: Changes = field(default_factory=dict[str, Change])
    """Added compliance of elements, motion of their unloaded ends."""
    payloads: tuple[Payload, ...] = ()
    weight: bool = False
    """Whether the robot's own weight acts."""
    dead_zones: Mapping[str, float] = field(default_factory=dict[str, float])
    """Half-width of a drive's dead zone, m or rad, by its joint."""
    turns: Mapping[str, Array] = field(default_factory=dict[str, Any])
    """Small rotation (3,) of what an instrument shows."""
    gains: Mapping[str, float] = field(default_factory=dict[str, float])
    """Relative growth of what an instrument shows."""
    force_gain: float = 0.0
    """Relative growth of the applied wrench over the stated one."""
    factors: Mapping[str, float] = field(default_factory=dict[str, float])
    """What the numbers of an instrument are multiplied with: another unit, the other sign."""
    jumps: Mapping[str, tuple[Row, float]] = field(default_factory=dict[str, Any])
    """From which row on the numbers of an instrument are larger, and by how much, m or rad."""


def _stiff(_part: str) -> bool:
    return False


@dataclass(frozen=True)
class Setting:
    """Where effects may act: a robot, and how it is read. Without the latter, what can be adopted."""

    robot: NominalRobot
    compliance: tuple[float, float] = (1.0, 1.0)
    """The robot's own at M, m/N and rad/(N·m): the units of what is added elsewhere."""
    turning: Mapping[str, bool] = field(default_factory=dict[str, bool])
    """Whether a rigid body turns against gravity from pose to pose; by default it does."""
    tool_is_read: bool = True
    """Whether an instrument at M reads anything."""
    sensors: Mapping[str, bool] = field(default_factory=dict[str, bool])
    """By sensor, whether it reads displacements."""
    suspect: Callable[[str], bool] = _stiff
    """Whether virtual experiments on a part, which take time, are worth while."""
    doubts: Doubts = field(default_factory=Doubts)

    @cached_property
    def length(self) -> float:
        """Largest distance of two joints, or of the tool from one, m."""
        mechanism = self.robot.mechanism
        points = np.array([*(joint.at for joint in mechanism.joints), mechanism.tool.at])
        return float(np.linalg.norm(points[:, None] - points, axis=2).max()) or 1.0

    @cached_property
    def mass(self) -> float:
        """Mass of all bodies, kg; one where none is known."""
        return sum(body.mass for body in self.robot.mechanism.bodies) or 1.0

    def in_robots_units(self, parameters: Sequence[Parameter]) -> tuple[Parameter, ...]:
        """Parameters whose sizes and ranges are shares of the robot's own compliance, length or mass."""
        units = {"m/N": self.compliance[0], "rad/(N·m)": self.compliance[1], "m": self.length, "kg": self.mass}
        own = [(p, units.get(p.unit, 1.0)) for p in parameters]
        return tuple(p._replace(size=unit * p.size, low=unit * p.low, high=unit * p.high) for p, unit in own)


class Effect:
    """An effect at a place."""

    word: ClassVar[str]
    parameters: ClassVar[tuple[Parameter, ...]] = ()
    precedence: ClassVar[int]
    """Order in the vocabulary; of effects that no reading distinguishes the first gives its name."""
    also: ClassVar[tuple[str, ...]] = ()
    """Other words for the same effect."""
    conversion: ClassVar[Conversion | None] = None
    """Of a single factor."""
    bounds: ClassVar[tuple[float, float]] = FREE
    """Range of every internal parameter that can be computed."""
    adoptable: ClassVar[bool] = False
    """Whether a robot file can carry it."""
    blames: ClassVar[bool] = False
    """Whether it says that an element, where it acts on one alone, is not as modelled."""
    of_matrix: ClassVar[bool] = False
    """Whether it changes what a part's whole matrix may change, too."""

    @classmethod
    def candidates(cls, setting: Setting) -> Candidates:
        """The effect wherever it may act, sets before single elements."""
        raise NotImplementedError

    def influence(self, values: Array) -> Influence:
        """What it changes, by internal parameters (k,)."""
        raise NotImplementedError

    @classmethod
    def refusal(cls, robot: NominalRobot, place: str) -> str:
        """Why no robot file can carry it; empty where one can."""
        del robot
        return "" if cls.adoptable else f"{cls.word} @ {place}: no part of the robot; correct the readings instead"

    def make_candidate(self, place: Place, parameters: Sequence[Parameter] | None = None, **more: Any) -> Candidate:
        """Return this effect as a candidate.

        Parameters
        ----------
        place
            Where it acts.
        parameters
            Those at this place; by default all of the effect's.
        more
            Fields of the candidate that differ from those of its kind.

        """
        given = self.parameters if parameters is None else parameters
        physical, internal = self.conversion or (_keep, _keep)
        fields: dict[str, Any] = {
            "effect": self.word,
            "units": tuple(p.unit for p in given),
            "scale": tuple(float(p.size) for p in given),
            "bounds": self.bounds,
            "physical": physical,
            "internal": internal,
            "component": place.sole if self.blames else "",
            "aliases": tuple(f"{self.word} @ {other}" for other in place.others),
        }
        return Candidate(
            place=place.name,
            names=tuple(p.name for p in given),
            plausible=tuple((float(p.low), float(p.high)) for p in given),
            members=place.members,
            action=self,
            **(fields | more),
        )
