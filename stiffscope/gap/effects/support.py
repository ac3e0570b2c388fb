"""An elastic support below the robot or at its tool, optionally with coupled rotations."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from operator import itemgetter

import numpy as np

from stiffscope.gap.effects.effect import (
    ADDED,
    Array,
    Candidates,
    Changes,
    Parameter,
    Place,
    Setting,
)
from stiffscope.gap.effects.elements import ElementEffect
from stiffscope.vjm.model.checks import BASE, TOOL
from stiffscope.vjm.model.mechanism import Change

_ROUNDING = 1e-8  # least rotational compliance of a support over its largest
_PAIRS = (
    np.array([3, 3, 4]),
    np.array([4, 5, 5]),
)  # rows and columns of coupled rotations
_PER_MOMENT = "rad/(N·m)"


@dataclass(frozen=True)
class Support(ElementEffect):
    """A support yields by six diagonal terms, or as much along all axes and about all axes.

    With nine a moment about one axis turns it about others, too.
    """

    parameters = (
        *(Parameter(name, "m/N", low=0.0) for name in ("x", "y", "z")),
        *(Parameter(name, _PER_MOMENT, low=0.0) for name in ("rx", "ry", "rz")),
        *(Parameter(name, _PER_MOMENT) for name in ("rxry", "rxrz", "ryrz")),
    )
    bounds = ADDED

    @classmethod
    def supports(cls, setting: Setting, place: Place) -> Candidates:
        """Yield the effect without coupled rotations, alike in all directions, and with both."""
        effect = cls(partial(yield_support, place.sole))
        known = setting.in_robots_units(cls.parameters)
        make = partial(effect.make_candidate, place, component=place.name)
        yield make(known[:6])
        alike = tuple(p.size for p in known[:6:3])
        pick = itemgetter(slice(None, None, 3))
        yield make(known[:6], scale=alike, physical=_repeat, internal=pick)
        yield make(known, couplings=3, physical=find_possible)


def _repeat(values: Array) -> Array:
    """Diagonal (6,) of what yields alike along all axes and about all axes (2,)."""
    return np.repeat(values, 3)


def find_compliance(values: Array) -> Array:
    """Return the compliance (6, 6) of a support for two, six or nine values."""
    values = _repeat(values) if len(values) < 6 else values
    compliance = np.diag(values[:6])
    if len(values) > 6:
        compliance[_PAIRS] = compliance[_PAIRS[::-1]] = values[6:]
    return compliance


def find_possible(values: Array) -> Array:
    """Return the nearest values (9,) with a positive semidefinite rotational compliance.

    A support that rotates about a single axis is on the boundary, so noise often puts it beyond.
    """
    size, axes = np.linalg.eigh(find_compliance(values)[3:, 3:])
    turned = np.zeros((6, 6))
    turned[3:, 3:] = (axes * np.maximum(size, _ROUNDING * max(size[-1], 0.0))) @ axes.T
    return np.concatenate([values[:3], turned.diagonal()[3:], turned[_PAIRS]])


def yield_support(element: str, values: Array) -> Changes:
    """Return the change of an element for six or nine values."""
    possible = find_possible(values) if len(values) > 6 else values
    return {element: Change(find_compliance(possible))}


@dataclass(frozen=True)
class BaseCompliance(Support):
    """Elastic support between the ground and everything mounted on it, at the origin."""

    word = "base-compliance"
    precedence = 90

    @classmethod
    def candidates(cls, setting: Setting) -> Candidates:
        """Yield candidates at the base."""
        yield from cls.supports(setting, Place("base", (BASE,)))


_PLATFORM = "platform"  # alias of the tool's place if its body has this name


@dataclass(frozen=True)
class PlatformCompliance(Support):
    """Elastic support between the tool's body and M, at M."""

    word = "platform-compliance"
    precedence = 100

    @classmethod
    def candidates(cls, setting: Setting) -> Candidates:
        """Yield candidates at the tool."""
        others = (_PLATFORM,) if setting.robot.mechanism.tool.body == _PLATFORM else ()
        yield from cls.supports(setting, Place("tool", (TOOL,), others))
