"""Drive stiffness that differs from the stated value."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.gap.effects.effect import (
    ADDED,
    FACTOR,
    FREE,
    STIFFNESS_FACTOR,
    Array,
    Candidates,
    Effect,
    Influence,
    Knee,
    NominalRobot,
    Parameter,
    Place,
    Preload,
    Setting,
)
from stiffscope.gap.effects.elements import (
    ElementEffect,
    along_drive,
    move_ends,
    soften,
)

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from stiffscope.gap.effects.effect import Array, Changes


_MANY = 4  # drives, each of which may have its own factor
_UNUSUAL = 0.01  # odds of that where no tolerance says that drives are guesses


@dataclass(frozen=True)
class ActuatorStiffness(ElementEffect):
    """Factor on the stiffness of drives along their driven directions."""

    word = "actuator-stiffness"
    precedence = 30
    parameters = (Parameter("factor", "1", 1.0, 0.02, 2.0),)
    conversion = STIFFNESS_FACTOR
    bounds = FACTOR
    blames = True

    @classmethod
    def candidates(cls, setting: Setting) -> Candidates:
        """Yield candidates at driven joints."""
        robot = setting.robot
        known = cls.parameters[0]
        for place in robot.places(robot.driven):
            factors = [robot.factor(name) for name in place.members]
            count = len(factors)
            within = max(factors)
            size = within - 1.0 if within > 1.0 else known.size
            low = min(known.low, 1.0 / within)
            high = max(known.high, within)
            prior = known._replace(size=size, low=low, high=high)
            yield cls(partial(soften, robot, place.members)).make_candidate(
                place, (prior,)
            )
            guessed = min(factors) > 1.0
            alone = guessed or not robot.elastic_sources  # nothing else yields
            if (count > 1 and guessed) or count >= _MANY:
                # with priors this wide each drive may have its own factor besides a common one;
                # of many drives, more may be soft than a diagnosis has effects
                each = tuple(
                    prior._replace(name=f"{name}.{known.name}")
                    for name in place.members
                )
                yield cls(partial(_soften_each, robot, place.members)).make_candidate(
                    place,
                    each,
                    odds=1.0 if alone else _UNUSUAL,
                    guessed=guessed,
                    scale=(size,) * (1 + count),
                    groups=(1, count),
                    bounds=FREE,
                    physical=_find_factors,
                    internal=_find_growth,
                )


def _grow(u: Array) -> Array:
    """Return compliance factors (k,): ``1 + e``, or ``1/(1 - e)`` if ``e = u[0] + u[1:] < 0``."""
    e: Array = u[0] + u[1:]
    return np.where(e < 0.0, 1.0 / (1.0 - np.minimum(e, 0.0)), 1.0 + e)


def _find_factors(u: Array) -> Array:
    return 1.0 / _grow(u)


def _find_growth(factors: Array) -> Array:
    """Return the internal parameters (1 + k,) of stiffness factors (k,)."""
    return np.append(0.0, np.where(factors > 1.0, 1.0 - factors, 1.0 / factors - 1.0))


def _soften_each(nominal: NominalRobot, names: Sequence[str], u: Array) -> Changes:
    """Scale the drive compliance of each joint by its own factor (see `_grow`)."""
    more = _grow(u) - 1.0
    return {
        name: soften(nominal, [name], more[k:])[name] for k, name in enumerate(names)
    }


_REACH = 0.05  # of the largest load: change of a preload that readings show
_LEAST = 0.01  # of the usual half-width
_HELD = Parameter("preload", "N", 0.2, -1.0, 1.0)  # relative to the largest load


@dataclass(frozen=True)
class Backlash(Effect):
    """Dead zone of a drive, which shifts from its middle towards the force that it carries.

    Where weight, or a spring beside it, holds the drive to one side, a load moves it across the
    whole gap once it outweighs them, and not before.
    """

    word = "backlash"
    precedence = 140
    merges = False
    adoptable = True
    parameters = (Parameter("half_width", "m", 1e-5, 0.0, 1e-3),)
    bounds = ADDED
    blames = True

    drive: str
    load: float = 0.0
    """Largest applied load, N or N·m, if weight holds the drive to a side."""
    least: float = 0.0
    """Half-width, m or rad, below which no reading shows what holds it there."""

    @classmethod
    def candidates(cls, setting: Setting) -> Candidates:
        """Yield candidates at single drives."""
        driven = setting.robot.driven
        for place in setting.robot.places(driven):
            if place.sole:
                turns = driven[place.sole].turns
                (width,) = cls.parameters
                if not turns:
                    (width,) = setting.in_robots_units([width])
                units = ("rad", "N·m") if turns else ("m", "N")
                yield cls(place.sole).make_candidate(place, [width], units=units[:1])
                load = setting.drive_forces.get(place.sole, 0.0)
                if load and setting.robot.mechanism.gravity.any():
                    effect = cls(place.sole, load, _LEAST * width.size)
                    ends = (load * size for size in _HELD[2:])
                    yield effect.make_candidate(
                        place,
                        [width, Parameter(*_HELD[:2], *ends)],
                        units=units,
                        couplings=1,
                        groups=(1, 1),
                        joins_noise=False,
                    )

    def influence(self, values: Array) -> Influence:
        """Return the dead zone of the drive, and what holds it to a side."""
        zones = {self.drive: float(values[0])}
        if len(values) == 1:
            return Influence(dead_zones=zones)
        reach = _REACH * self.load if values[0] > self.least else np.inf
        held = Preload(float(values[1]), reach)
        return Influence(dead_zones=zones, preloads={self.drive: held})


@dataclass(frozen=True)
class EncoderOffset(ElementEffect):
    """Common offset of drive positions from the commanded ones, along their joints' axes."""

    word = "encoder-offset"
    precedence = 110
    rests_in = Backlash.word
    parameters = (Parameter("offset", "m", 2e-4, -5e-3, 5e-3),)

    @classmethod
    def candidates(cls, setting: Setting) -> Candidates:
        """Yield candidates at driven joints."""
        driven = setting.robot.driven
        for place in setting.robot.places(driven):
            directions = {name: along_drive(driven[name]) for name in place.members}
            turns = all(driven[name].turns for name in place.members)
            effect = cls(partial(move_ends, directions))
            own = cls.parameters if turns else setting.in_robots_units(cls.parameters)
            yield effect.make_candidate(place, own, units=("rad" if turns else "m",))


def _find_loads(setting: Setting, place: Place) -> float:
    """Return the largest applied load on any drive of a place, N or N·m; one where unknown."""
    known = setting.drive_forces
    return max((known.get(name, 0.0) for name in place.members), default=0.0) or 1.0


def _like_places(setting: Setting) -> Iterator[tuple[Place, str]]:
    """Yield loaded drives and sets of one kind, with the unit of their loads."""
    driven = setting.robot.driven
    loads = setting.drive_forces
    for place in setting.robot.places(driven):
        turns = {driven[name].kind == "revolute" for name in place.members}
        loaded = not loads or any(loads.get(name, 0.0) for name in place.members)
        if len(turns) == 1 and loaded:
            yield place, ("N·m" if turns.pop() else "N")


@dataclass(frozen=True)
class Friction(Effect):
    """Force or torque that holds a drive before it moves, beside its spring.

    Loads below it move nothing, and an unloaded drive does not return: loading and unloading
    differ. Loads count in the order of the table (`RobotReadings.load_chains`).
    """

    word = "friction"
    precedence = 142
    gives_way = True
    parameters = (Parameter("force", "N", 0.1, 0.0, 1.0),)
    bounds = ADDED
    blames = True

    drives: tuple[str, ...]

    @classmethod
    def candidates(cls, setting: Setting) -> Candidates:
        """Yield candidates at loaded drives, with sizes relative to their loads."""
        (known,) = cls.parameters
        for place, unit in _like_places(setting):
            load = _find_loads(setting, place)
            prior = known._replace(size=known.size * load, high=known.high * load)
            yield cls(place.members).make_candidate(place, (prior,), units=(unit,))

    def influence(self, values: Array) -> Influence:
        """Return the force that holds each drive."""
        return Influence(frictions=dict.fromkeys(self.drives, float(values[0])))

    @classmethod
    def refusal(cls, robot: NominalRobot, place: str) -> str:
        """Return why a robot file cannot contain it: its drives are elastic."""
        del robot
        return f"{cls.word} @ {place}: drives of a robot file are elastic, without friction"


_MIDDLE = 0.5  # knee over the largest load where an unknown one is sought first


@dataclass(frozen=True)
class PreloadLoss(Effect):
    """Drives with one stiffness up to a load and another beyond it, softer or stiffer."""

    word = "preload-loss"
    precedence = 144
    gives_way = True
    adoptable = True
    parameters = (
        Parameter("load", "N", 0.5, 0.0, 1.0),
        Parameter("factor", "1", 1.0, 0.05, 20.0),
        Parameter("start", "1", 1.0, 0.05, 2.0),  # as of any drive
    )
    bounds = FACTOR
    blames = True

    drives: tuple[str, ...]
    reference: float
    """Load, N or N·m, whose relative change is the first internal parameter."""

    @classmethod
    def candidates(cls, setting: Setting) -> Candidates:
        """Yield a knee in the stiffness of loaded drives, and one that starts otherwise, too."""
        load, *factors = cls.parameters
        for place, unit in _like_places(setting):
            largest = _find_loads(setting, place)
            effect = cls(place.members, _MIDDLE * largest)
            known = [load._replace(high=largest), *factors]
            for count in (2, 3):
                yield effect.make_candidate(
                    place,
                    known[:count],
                    units=(unit, "1", "1")[:count],
                    groups=(1, count - 1),
                    physical=effect.find_law,
                    internal=effect.find_growth,
                )

    def find_law(self, values: Array) -> Array:
        """Return load, factor beyond it, and factor below, for internal parameters (k,)."""
        return np.append(self.reference * (1.0 + values[0]), 1.0 / (1.0 + values[1:]))

    def find_growth(self, law: Array) -> Array:
        """Return internal parameters (k,) for a load and factors on the stiffness."""
        return np.append(law[0] / self.reference - 1.0, 1.0 / law[1:] - 1.0)

    def influence(self, values: Array) -> Influence:
        """Return load and growth of compliance below and beyond it, of each drive."""
        start = float(values[2]) if len(values) > 2 else 0.0
        knee = Knee(self.reference * (1.0 + float(values[0])), start, float(values[1]))
        return Influence(knees=dict.fromkeys(self.drives, knee))

    @classmethod
    def refusal(cls, robot: NominalRobot, place: str) -> str:
        """Return why a robot file cannot contain it: a drive that has a curve of its own."""
        members = next(
            (p.members for p in robot.places(robot.driven) if p.name == place), ()
        )
        drives = (robot.driven[name].drive for name in members)
        if any(drive and drive.law for drive in drives):
            return f"{cls.word} @ {place}: a drive with a curve or backlash of its own"
        return ""
