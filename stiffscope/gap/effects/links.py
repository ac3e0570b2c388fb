"""Errors of a part's 6x6 compliance, entry by entry or by one factor."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from stiffscope.fea.beam import cantilever
from stiffscope.gap.effects.effect import (
    ADDED,
    FACTOR,
    GROWTH,
    STIFFNESS_FACTOR,
    Array,
    Candidates,
    Changes,
    NominalRobot,
    Parameter,
    Setting,
)
from stiffscope.gap.effects.elements import ALONG, ElementEffect, move_ends, soften
from stiffscope.vjm.model.mechanism import Change
from stiffscope.vjm.model.screws import shift

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence


ENTRIES = tuple(f"c{i}{j}" for i in range(1, 7) for j in range(i, 7))
_ALL = tuple((i, j) for i in range(6) for j in range(i, 6))
_SYMMETRIC = (
    (0, 0),
    (1, 1),
    (1, 5),
    (2, 2),
    (2, 4),
    (3, 3),
    (4, 4),
    (5, 5),
)  # in two planes
_UNITS = ("m/N", "m/(N·m)", "rad/(N·m)")
_RIDGE = 1e-9  # relative shift that keeps a compliance positive definite
_NO_COMPLIANCE = 1e-30  # m/N, rad/(N·m): compliance of a rigid direction
_MOST_COMPLIANT = 100.0  # largest compliance of a part over its nominal one
FACTOR_OF_PART = Parameter("factor", "1", 0.5, 0.2, 20.0)


@dataclass(frozen=True)
class PartCompliance(ElementEffect):
    """Change of the compliance of bodies of one part."""

    word = "part-compliance"
    also = ("slider-compliance",)
    named: ClassVar[Mapping[str, str]] = {"sliders": "slider-compliance"}
    """Alternative effect name by place (for the Biglide)."""
    precedence = 45
    parameters = (FACTOR_OF_PART, *(Parameter(entry, "SI") for entry in ENTRIES))
    conversion = GROWTH
    of_matrix = True

    @classmethod
    def candidates(cls, setting: Setting) -> Candidates:
        """Yield candidates at elastic bodies of one part, entry by entry if these have two ends.

        A single factor is yielded only at places in `named`; elsewhere it is `link-stiffness`.
        """
        robot = setting.robot
        for place in robot.places(yielding_bodies(robot)):
            word = cls.named.get(place.name, cls.word)
            names = (
                (place.name, *place.others) if place.name in cls.named else place.others
            )
            others = tuple(f"{cls.word} @ {name}" for name in names)
            if word != cls.word:
                effect = cls(partial(soften, robot, place.members))
                aliases = (f"link-stiffness @ {place.name}", *others)
                more = {"component": place.sole, "bounds": FACTOR, "aliases": aliases}
                yield effect.make_candidate(
                    place, (FACTOR_OF_PART,), effect=word, **more
                )
            here = robot.compliances[next(iter(place.members))]
            if (
                len({robot.part_of(name) for name in place.members}) == 1
                and len(here) == 6
            ):
                for pairs in (_SYMMETRIC, _ALL)[: len(place.members)]:
                    matrix = _Matrix.from_compliance(here, pairs)
                    effect = cls(partial(matrix.changes, place.members))
                    more = {
                        "physical": matrix.physical,
                        "internal": matrix.internal,
                        "aliases": others,
                    }
                    yield effect.make_candidate(
                        place, matrix.parameters, effect=word, flexible=True, **more
                    )


def yielding_bodies(robot: NominalRobot) -> list[str]:
    """Return the names of elastic bodies with non-zero compliance."""
    return [name for name in robot.elastic_sources if robot.compliances[name].any()]


@dataclass(frozen=True)
class _Matrix:
    """Entries of a part's compliance C = L Lᵀ, changed to L φ(E) Lᵀ; E is internal.

    φ maps eigenvalues e of E to 1 + e for more and 1/(1 - e) for less compliance, so that the
    compliance is positive definite for all parameters.
    """

    compliance: Array
    pairs: Sequence[tuple[int, int]]
    root: Array
    """L (6, 6)."""
    back: Array
    """Inverse of L (6, 6)."""

    @classmethod
    def from_compliance(
        cls, compliance: Array, pairs: Sequence[tuple[int, int]]
    ) -> _Matrix:
        """Return the matrix whose free entries are the given index pairs."""
        ridge = np.diag(_RIDGE * np.diagonal(compliance) + _NO_COMPLIANCE)
        root = np.linalg.cholesky(_fill_matrix(pairs, 1.0) * compliance + ridge)
        return cls(compliance, pairs, root, np.linalg.inv(root))

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Entries with plausible ranges; diagonal ones are non-negative, all are bounded."""
        diagonal = np.diagonal(self.compliance)
        high = _MOST_COMPLIANT * np.sqrt(np.outer(diagonal, diagonal))
        low = np.diag(np.diagonal(high)) - high
        names = [f"c{i + 1}{j + 1}" for i, j in self.pairs]
        units = [_UNITS[i // 3 + j // 3] for i, j in self.pairs]
        ranges = self._pick_entries(low), self._pick_entries(high)
        return tuple(map(Parameter, names, units, np.ones(len(names)), *ranges))

    def physical(self, values: Array) -> Array:
        """Return the compliance entries (k,) for internal parameters."""
        return self._pick_entries(self.compliance + self._add_compliance(values))

    def internal(self, entries: Array) -> Array:
        """Return the internal parameters (k,) of compliance entries."""
        change = _fill_matrix(self.pairs, entries - self._pick_entries(self.compliance))
        growth, vectors = np.linalg.eigh(self.back @ change @ self.back.T)
        e = np.where(growth < 0.0, growth / np.maximum(1.0 + growth, _RIDGE), growth)
        return self._pick_entries((vectors * e) @ vectors.T)

    def changes(self, members: Sequence[str], values: Array) -> Changes:
        """Add the same compliance to each of the bodies."""
        return dict.fromkeys(members, Change(self._add_compliance(values)))

    def _add_compliance(self, values: Array) -> Array:
        e, vectors = np.linalg.eigh(_fill_matrix(self.pairs, values))
        growth = np.where(e < 0.0, e / (1.0 - np.minimum(e, 0.0)), e)  # φ - 1
        return self.root @ (vectors * growth) @ vectors.T @ self.root.T

    def _pick_entries(self, matrix: Array) -> Array:
        rows, columns = np.array(self.pairs).T
        return matrix[rows, columns]


def _fill_matrix(pairs: Sequence[tuple[int, int]], values: Array | float) -> Array:
    """Return the symmetric matrix (6, 6) with values at some index pairs, else zero."""
    rows, columns = np.array(pairs).T
    out = np.zeros((6, 6))
    out[rows, columns] = out[columns, rows] = values
    return out


@dataclass(frozen=True)
class LinkStiffness(ElementEffect):
    """Factor on the stiffness of bodies; that of `part-compliance` multiplies the compliance."""

    word = "link-stiffness"
    precedence = 50
    parameters = (Parameter("factor", "1", 1.0, 0.02, 2.0),)
    conversion = STIFFNESS_FACTOR
    bounds = FACTOR
    blames = True
    of_matrix = True

    @classmethod
    def candidates(cls, setting: Setting) -> Candidates:
        """Yield candidates at elastic bodies, except where `part-compliance` names the factor."""
        robot = setting.robot
        for place in robot.places(yielding_bodies(robot)):
            if place.name not in PartCompliance.named:
                candidate = cls(partial(soften, robot, place.members)).make_candidate(
                    place
                )
                names = (
                    f"{PartCompliance.word} @ {name}"
                    for name in (place.name, *place.others)
                )
                yield replace(candidate, aliases=(*candidate.aliases, *names))


@dataclass(frozen=True)
class LinkLength(ElementEffect):
    """Length error of bodies, along their own axes."""

    word = "link-length"
    precedence = 120
    parameters = (Parameter("error", "m", 1e-4, -3e-3, 3e-3),)

    @classmethod
    def candidates(cls, setting: Setting) -> Candidates:
        """Yield candidates at elastic bodies with two ends."""
        for place in setting.robot.places(setting.robot.links):
            effect = cls(partial(move_ends, dict.fromkeys(place.members, ALONG)))
            yield effect.make_candidate(place, setting.in_robots_units(cls.parameters))


_UNIFORM = 0.02  # relative tolerance on the entries of a uniform beam
_LEAST = -0.2
_MOST = 0.45  # range of the clamped length over the body's length


@dataclass(frozen=True)
class RigidEnds(ElementEffect):
    """Length of rigid ends of bodies, which bend only in between."""

    word = "rigid-ends"
    precedence = 70
    parameters = (Parameter("length", "m", 0.02, 0.0, 0.15),)
    bounds = ADDED
    of_matrix = True

    @classmethod
    def candidates(cls, setting: Setting) -> Candidates:
        """Yield candidates at uniform elastic bodies."""
        robot = setting.robot
        links = [name for name in yielding_bodies(robot) if name in robot.links]
        for place in robot.places(name for name in links if _is_uniform(robot, name)):
            effect = cls(partial(_clamp_ends, robot, place.members))
            yield effect.make_candidate(place, setting.in_robots_units(cls.parameters))


def _is_uniform(robot: NominalRobot, name: str) -> bool:
    """Return whether a body's compliance (6, 6) is that of a uniform cantilever of its length."""
    c = robot.compliances[name]
    length = robot.length(name)
    bent = np.array([c[5, 5], -c[4, 4]]) * length / 2.0
    near = (
        bent.all()
        and (np.abs(c[(1, 2), (5, 4)] - bent) <= _UNIFORM * np.abs(bent)).all()
    )
    sheared = c[1, 1] - c[5, 5] * length**2 / 3.0, c[2, 2] - c[4, 4] * length**2 / 3.0
    return bool(near and min(sheared) >= -_UNIFORM * min(c[1, 1], c[2, 2]))


def _clamp_ends(nominal: NominalRobot, names: Sequence[str], values: Array) -> Changes:
    """Return the changes of uniform bodies that bend only between rigid ends, at the tip."""
    changes: Changes = {}
    for name in names:
        c = nominal.compliances[name]
        length = nominal.length(name)
        clamped = float(np.clip(values[0], _LEAST * length, _MOST * length))
        to_end = shift([clamped, 0.0, 0.0])
        rates = (
            np.diagonal(c) / length
        )  # of the section: axial, shear y, z, torsion, bending y, z
        rates[1] -= c[5, 5] * length / 3.0
        rates[2] -= c[4, 4] * length / 3.0
        short = cantilever(length - 2.0 * clamped, rates)
        full = cantilever(length, rates)
        changes[name] = Change(to_end @ short @ to_end.T - full)
    return changes
