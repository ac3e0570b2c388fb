"""A dimension, a material's constant or the foundation of a part whose matrix follows from them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.effects.effect import ADDED, Array, Candidates, Changes, NominalRobot, Parameter, Place, Setting
from stiffscope.effects.elements import ElementEffect
from stiffscope.errors import InputError
from stiffscope.robot.part_dimensions import beam_dimensions
from stiffscope.vjm.mechanism import Change

if TYPE_CHECKING:
    from stiffscope.robot.part_dimensions import PartDimension


_FOUNDATION_UNIT = 1e-11  # m³/N: internal unit of what a foundation yields, of the size of a bolted contact's
_RIGID = 1e-30  # m³/N: a foundation that does not yield
_SOFTEST_FOUNDATION = 1e8  # N/m³
_RATIOS = (-1.2, 1.2)  # bounds of the logarithm of what is left of a dimension (of a tube's wall) over the nominal
_USUAL, _LEAST, _MOST = 0.1, 0.5, 2.0  # times a dimension: its error, its plausible range


@dataclass(frozen=True)
class Dimension(ElementEffect):
    """A part has another dimension; by the logarithm of its distance from where nothing is left of the part.

    A rigid foundation may yield as a bolted joint does: by what it yields.
    """

    word = "part-dimension"
    precedence = 180
    parameters = (Parameter("value", "SI"),)
    of_matrix = True

    @classmethod
    def candidates(cls, setting: Setting) -> Candidates:
        """Of parts by beam theory, and of those by virtual experiments where these are worth while."""
        robot = setting.robot
        for part in robot.robot.parts:
            if part not in robot.tested or setting.suspect(part):
                yield from find_dimensions(robot, part)

    @classmethod
    def refusal(cls, robot: NominalRobot, place: str) -> str:
        """Only parts by beam theory are made anew where a robot file is read."""
        if place.partition(".")[0] in robot.beams:
            return ""
        return f"part-dimension: set {place} in [parts] of the robot file, in its units"


def find_dimensions(robot: NominalRobot, part: str) -> Candidates:
    """What may be otherwise about a part, where its matrix is that of beam theory or tested."""
    if part in robot.tested:
        known = robot.tested[part]()
    else:
        known = beam_dimensions(robot.robot, part) if part in robot.beams else ()
    for dimension in known:
        members = robot.robot.bodies_of(part)
        value = _Value(dimension, robot.compliances[members[0]], members)
        parameter = Parameter("value", dimension.unit, *value.prior)
        yield Dimension(value.changes).make_candidate(
            Place(dimension.place, members), (parameter,), bounds=ADDED if value.is_rigid else _RATIOS,
            physical=value.physical, internal=value.internal,
        )  # fmt: skip


@dataclass(frozen=True)
class _Value:
    """Value of a part's parameter."""

    of: PartDimension
    nominal: Array
    """Compliance (6, 6) of the part as it is modelled."""
    members: tuple[str, ...]

    @property
    def is_rigid(self) -> bool:
        """Whether it is a foundation that does not yield."""
        return not np.isfinite(self.of.nominal)

    @property
    def prior(self) -> tuple[float, float, float]:
        """Size of the internal parameter, plausible range of the value: a tenth of it (of a tube's wall) is usual."""
        if self.is_rigid:
            return 1.0, _SOFTEST_FOUNDATION, np.inf
        return _USUAL, _LEAST * self.of.nominal, _MOST * self.of.nominal

    def physical(self, values: Array) -> Array:
        """The value (1,), SI, of the internal parameter."""
        if not self.is_rigid:
            return self.of.limit + (self.of.nominal - self.of.limit) * np.exp(values)
        yields = values * _FOUNDATION_UNIT
        return 1.0 / np.where(np.abs(yields) > _RIGID, yields, _RIGID)

    def internal(self, values: Array) -> Array:
        """The internal parameter of a value (1,). Raises InputError for one that leaves nothing of the part."""
        of = self.of
        if self.is_rigid:
            return 1.0 / (values * _FOUNDATION_UNIT)
        ratio = (values - of.limit) / (of.nominal - of.limit)
        if not (ratio > 0.0).all():
            raise InputError(f"{of.place}: expected a value to the other side of {of.limit:g} {of.unit}, "
                             f"where nothing is left of the part, got {values[0]:g} {of.unit}")  # fmt: skip
        return np.log(ratio)

    def changes(self, values: Array) -> Changes:
        """The part's bodies take the compliance that it has with the value."""
        change = Change(self.of.compliance(float(self.physical(values)[0])) - self.nominal)
        return dict.fromkeys(self.members, change)
