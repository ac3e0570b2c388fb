"""The robot's own weight, if the nominal model lacks it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.gap.effects.effect import (
    ADDED,
    GROWTH,
    KNOWN,
    Array,
    Candidates,
    Effect,
    Influence,
    NominalRobot,
    Parameter,
    Payload,
    Place,
    Setting,
    find_length,
)

if TYPE_CHECKING:
    from stiffscope.runtime.types import Indices
    from stiffscope.vjm.model.bodies import Body
    from stiffscope.vjm.model.mechanism import Mechanism


@dataclass(frozen=True)
class MassSettings:
    """How large and how far out added masses are."""

    none: float = -1.0
    """Relative change to a massless body."""
    heaviest: float = 50.0
    """Largest relative change that is computed."""
    compensated: float = 0.5
    """Usual share of the weight that springs or counterweights carry."""
    stands_out: float = 0.5
    """Of the size of a body: how far a mass on it may stand out."""
    least_size: float = 0.1
    """Of the size of the robot: the same, of a body whose joints coincide."""
    least: float = 1e-9
    """Kg: least mass by which a centre is computed."""


MASSES = MassSettings()


@dataclass(frozen=True)
class Gravity(Effect):
    """Weight of the whole robot, without parameters."""

    word = "gravity"
    precedence = 10
    adoptable = True

    @classmethod
    def candidates(cls, setting: Setting) -> Candidates:
        """Yield one candidate for the whole robot."""
        if setting.robot.mechanism.gravity.any():
            yield cls().make_candidate(Place("robot"))

    def influence(self, values: Array) -> Influence:
        """Return the robot's weight."""
        del values
        return Influence(weight=True)


WHOLE = "robot"
"""Place of what acts on the whole robot."""


@dataclass(frozen=True)
class Mass(Effect):
    """Factor on the stated mass of bodies, at its stated place, and on its moments of inertia.

    It is as if the density were another: a mass mounted on the body is a payload.
    """

    word = "mass"
    precedence = 25
    weighs = True
    adoptable = True
    parameters = (Parameter("factor", "1", 0.2, 0.3, 3.0),)
    conversion = GROWTH
    bounds = (MASSES.none, MASSES.heaviest)
    blames = True

    stated: tuple[Payload, ...]
    """Masses of the bodies as stated in the robot file."""
    carried: bool = False
    """Whether springs carry a share of their weight, which changes no inertia."""

    @classmethod
    def candidates(cls, setting: Setting) -> Candidates:
        """Yield point masses of bodies and sets, within tolerances; none without gravity.

        Springs may carry a share of the whole robot's weight: of that alone, its inertia stays.
        """
        robot = setting.robot
        if not (robot.mechanism.gravity.any() or setting.shows_inertia):
            return
        heavy = find_masses(robot)
        (known,) = cls.parameters
        (low, high) = cls.bounds
        bodies = [body for body in robot.mechanism.bodies if body.mass]
        stated = {body.name: robot.mass_sigma(body.name) / body.mass for body in bodies}
        for place in robot.places(heavy):
            most = KNOWN * max(stated[name] for name in place.members)
            size = min(known.size, most / KNOWN)
            least = max(known.low, 1.0 - most)
            prior = known._replace(
                size=size, low=least, high=min(known.high, 1.0 + most)
            )
            effect = cls(tuple(part for name in place.members for part in heavy[name]))
            bounds = max(low, -most), min(high, most)
            yield effect.make_candidate(
                place, (prior,), bounds=bounds, stated=most < np.inf
            )
        guessed = [name for name in heavy if stated[name] == np.inf]
        every_guessed = len(guessed) == len(heavy) == len(bodies)
        if every_guessed and len(heavy) > 1 and robot.mechanism.gravity.any():
            every = tuple(part for parts in heavy.values() for part in parts)
            yield cls(every, carried=True).make_candidate(
                Place(WHOLE, tuple(heavy)),
                (known._replace(size=MASSES.compensated, low=0.0, high=1.0),),
                bounds=(0.0, 1.0),
                physical=_leave,
                internal=_leave,
            )

    def influence(self, values: Array) -> Influence:
        """Return the changes of mass as payloads, or the weight that is carried."""
        growth = float(values[0])
        if self.carried:
            held = (
                replace(p, mass=0.0, carried=growth * p.mass, inertia=0.0 * p.inertia)
                for p in self.stated
            )
            return Influence(payloads=tuple(held), carried=growth)
        return Influence(
            payloads=tuple(
                replace(p, mass=growth * p.mass, inertia=growth * p.inertia)
                for p in self.stated
            )
        )


def _leave(share: Array) -> Array:
    """Return the share of weight that a compensated share leaves, and the other way round."""
    return 1.0 - np.asarray(share)


def find_masses(robot: NominalRobot) -> dict[str, tuple[Payload, ...]]:
    """Return masses by body: at the centre if rigid, half at each end if elastic (no mass data)."""
    out: dict[str, tuple[Payload, ...]] = {}
    for body in robot.mechanism.bodies:
        if not body.mass or (
            body.elastic is not None and body.elastic.dynamics is not None
        ):
            continue
        centre = np.zeros(3) if body.centre is None else body.centre
        places = [centre] if body.elastic is None else body.elastic.places
        nodes = [body.name] if body.elastic is None else body.nodes
        share = body.mass / len(places)
        stated = body.inertia if body.elastic is None else None
        own = np.zeros((3, 3)) if stated is None else stated
        ends = zip(nodes, places, strict=True)
        out[body.name] = tuple(
            Payload(node, np.array(at), share, np.zeros(3), inertia=own)
            for node, at in ends
        )
    return out


@dataclass(frozen=True)
class AddedMass(Effect):
    """An added mass with first moments along the axes that readings can show."""

    word = "payload"
    precedence = 20
    weighs = True
    adoptable = True
    parameters = (
        Parameter("mass", "kg", 0.2, 0.0, 3.0),
        *(Parameter(x, "m", 0.25, -0.5, 0.5) for x in "xyz"),
    )
    bounds = ADDED

    body: str
    point: Array
    """Point (3,) in the home pose, m."""
    axes: Indices
    """Axes (of x, y, z at home) along which its centre may deviate from the point."""

    @classmethod
    def candidates(cls, setting: Setting) -> Candidates:
        """Yield masses on rigid bodies, with and without first moments; none without gravity.

        If a body's mass has a stated tolerance, only a point mass within that tolerance is yielded.
        """
        mechanism = setting.robot.mechanism
        level = np.sort(np.argsort(np.abs(mechanism.gravity), kind="stable")[:2])
        shown = mechanism.gravity.any() or setting.shows_inertia
        for body in mechanism.bodies if shown else ():
            if body.elastic is None:
                turns = setting.turning.get(body.name, True) or setting.shows_inertia
                axes = np.arange(3) if turns else level
                heavy = cls(body.name, _find_point(mechanism, body), axes)
                place = Place(body.name)
                sigma = setting.robot.mass_sigma(body.name)
                known = sigma < np.inf
                mass, *centre = setting.in_robots_units(cls.parameters)
                mass = mass._replace(
                    size=min(mass.size, sigma), high=min(mass.high, KNOWN * sigma)
                )
                if not known:
                    moments = (mass.size * centre[a].size for a in axes)
                    low, high = find_extent(mechanism, body) - heavy.point
                    within = [
                        p._replace(low=float(a), high=float(b))
                        for p, a, b in zip(centre, low, high, strict=True)
                    ]
                    out = setting.length  # the longest lever of anything mounted on it
                    beyond = [(p.low - out, p.high + out) for p in within]
                    yield heavy.make_candidate(
                        place,
                        (mass, *within),
                        possible=((mass.low, mass.high), *beyond),
                        sums=heavy.list_moments(_find_support(mechanism, body)),
                        scale=(mass.size, *moments),
                        couplings=len(axes),
                        physical=heavy.physical,
                        internal=heavy.internal,
                    )
                bounds = 0.0, KNOWN * sigma
                yield heavy.make_candidate(place, (mass,), bounds=bounds, stated=known)

    def list_moments(
        self, support: Array
    ) -> tuple[tuple[str, str, tuple[float, ...]], ...]:
        """Return the first moments about a support (3,), home axes, as sums of internal parameters."""
        lever = self.point - support
        one = np.eye(len(self.axes))
        return tuple(
            (f"moment_{'xyz'[a]}", "kg·m", (float(lever[a]), *one[k].tolist()))
            for k, a in enumerate(self.axes)
        )

    def influence(self, values: Array) -> Influence:
        """Return the mass, and its first moments if given."""
        moments = np.zeros(3)
        moments[self.axes[: len(values) - 1]] = values[1:]
        return Influence(
            payloads=(Payload(self.body, self.point, float(values[0]), moments),)
        )

    def physical(self, values: Array) -> Array:
        """Return mass and centre of mass (4,) for internal parameters."""
        out = np.zeros(4)
        out[0] = values[0]
        out[1 + self.axes] = values[1:] / (
            values[0] if abs(values[0]) > MASSES.least else MASSES.least
        )
        return out

    def internal(self, values: Array) -> Array:
        """Return mass and first moments for physical parameters (4,)."""
        return np.array([values[0], *(values[0] * values[1 + self.axes])])


def find_extent(mechanism: Mechanism, body: Body) -> Array:
    """Return the least and largest coordinates (2, 3) of a mass on a body, home axes, m.

    A body reaches at least to its joints, its centre and, if it is the tool's, M; what is mounted on
    it stands out by half its size.
    """
    points = [j.at for j in mechanism.joints if body.name in (j.first, j.second)]
    points += [body.centre] if body.centre is not None else []
    points += [mechanism.tool.at] if mechanism.tool.body == body.name else []
    points = points or [np.zeros(3)]
    ends = np.array([np.min(points, axis=0), np.max(points, axis=0)])
    size = float(np.linalg.norm(ends[1] - ends[0]))
    out = max(MASSES.stands_out * size, MASSES.least_size * find_length(mechanism))
    return ends + np.array([[-out], [out]])


def _find_support(mechanism: Mechanism, body: Body) -> Array:
    """Return the point (3,) of the joint that carries a body, or of any of its joints."""
    carried = [j.at for j in mechanism.joints if j.second == body.name]
    others = [j.at for j in mechanism.joints if j.first == body.name]
    return (*carried, *others, np.zeros(3))[0]


def _find_point(mechanism: Mechanism, body: Body) -> Array:
    """Return a body's payload point (3,) at home: M, its centre, or the mean of its joints."""
    if mechanism.tool.body == body.name:
        return mechanism.tool.at
    if body.centre is not None:
        return body.centre
    joints = [j.at for j in mechanism.joints if body.name in (j.first, j.second)]
    return np.mean(joints, axis=0) if joints else np.zeros(3)
