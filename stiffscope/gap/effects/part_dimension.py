"""Dimensions, material constants and foundations of parts with a computed compliance matrix."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.errors import InputError
from stiffscope.gap.effects.effect import (
    ADDED,
    Array,
    Candidates,
    Changes,
    NominalRobot,
    Parameter,
    Place,
    Setting,
)
from stiffscope.gap.effects.elements import ElementEffect
from stiffscope.robot.part_dimensions import beam_dimensions
from stiffscope.vjm.model.mechanism import Change

if TYPE_CHECKING:
    from stiffscope.robot.part_dimensions import PartDimension


_FOUNDATION_UNIT = (
    1e-11  # m³/N: internal unit of foundation compliance, that of a bolted contact
)
_RIGID = 1e-30  # m³/N: compliance of a rigid foundation
_SOFTEST_FOUNDATION = 1e8  # N/m³
_RATIOS = (
    -1.2,
    1.2,
)  # bounds of the log ratio of remaining to nominal dimension (tube wall)
_USUAL = 0.1
_LEAST = 0.5
_MOST = 2.0  # relative to the dimension: usual error, plausible range


@dataclass(frozen=True)
class Dimension(ElementEffect):
    """Error of a part's dimension; internally the log of its distance from a vanishing section.

    A rigid foundation may yield like a bolted joint; its internal parameter is that compliance.
    """

    word = "part-dimension"
    precedence = 180
    parameters = (Parameter("value", "SI"),)
    of_matrix = True

    @classmethod
    def candidates(cls, setting: Setting) -> Candidates:
        """Yield candidates of parts by beam theory, or by virtual experiments if worthwhile."""
        robot = setting.robot
        for part in robot.robot.parts:
            if part not in robot.tested or setting.suspect(part):
                yield from find_dimensions(robot, part)

    @classmethod
    def refusal(cls, robot: NominalRobot, place: str) -> str:
        """Return a message unless the part is computed by beam theory when a robot file is read."""
        if place.partition(".")[0] in robot.beams:
            return ""
        return f"part-dimension: set {place} in [parts] of the robot file, in its units"


def find_dimensions(robot: NominalRobot, part: str) -> Candidates:
    """Yield the uncertain dimensions of a part computed by beam theory or virtual experiments."""
    if part in robot.tested:
        known = robot.tested[part]()
    else:
        known = beam_dimensions(robot.robot, part) if part in robot.beams else ()
    members = robot.robot.bodies_of(part)
    for dimension in known:
        value = _Value(dimension, robot.compliances[members[0]], members)
        parameter = Parameter("value", dimension.unit, *value.prior)
        bounds = ADDED if value.is_rigid else _RATIOS
        yield Dimension(value.changes).make_candidate(
            Place(dimension.place, members),
            (parameter,),
            bounds=bounds,
            physical=value.physical,
            internal=value.internal,
        )


@dataclass(frozen=True)
class _Value:
    """Value of a dimension of a part."""

    of: PartDimension
    nominal: Array
    """Nominal compliance (6, 6) of the part."""
    members: tuple[str, ...]

    @property
    def is_rigid(self) -> bool:
        """Whether it is a rigid foundation."""
        return not np.isfinite(self.of.nominal)

    @property
    def prior(self) -> tuple[float, float, float]:
        """Prior size of the internal parameter (usually 10 %) and plausible range of the value."""
        if self.is_rigid:
            return 1.0, _SOFTEST_FOUNDATION, np.inf
        return _USUAL, _LEAST * self.of.nominal, _MOST * self.of.nominal

    def physical(self, values: Array) -> Array:
        """Return the value (1,), SI, for the internal parameter."""
        if not self.is_rigid:
            return self.of.limit + (self.of.nominal - self.of.limit) * np.exp(values)
        yields = values * _FOUNDATION_UNIT
        return 1.0 / np.where(np.abs(yields) > _RIGID, yields, _RIGID)

    def internal(self, values: Array) -> Array:
        """Return the internal parameter of a value (1,). Raises InputError if the part vanishes."""
        of = self.of
        if self.is_rigid:
            return 1.0 / (values * _FOUNDATION_UNIT)
        ratio = (values - of.limit) / (of.nominal - of.limit)
        if not (ratio > 0.0).all():
            limit, got = (f"{length:g} {of.unit}" for length in (of.limit, values[0]))
            expected = (
                f"expected a value to the other side of {limit}, where nothing is left"
            )
            raise InputError(f"{of.place}: {expected}, got {got}")
        return np.log(ratio)

    def changes(self, values: Array) -> Changes:
        """Change the part's bodies to the compliance for this value."""
        change = Change(
            self.of.compliance(float(self.physical(values)[0])) - self.nominal
        )
        return dict.fromkeys(self.members, change)
