"""Derivatives of a part by its parameters; ``stiffscope.fea.sensitivity`` computes them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from stiffscope.fea.mesh import Floats


@dataclass(frozen=True, eq=False)
class Derivative:
    """Derivatives of a part by one parameter, SI, per SI unit of the parameter.

    Attributes
    ----------
    value, unit : value and unit of the parameter.
    full_compliance, full_error : (6n, 6n) compliance of all n loaded interfaces together, each at
        its reference point, which moves with the part; and its 95 % bounds.
    self_weight, self_weight_error : (3, 6) first interface's twist for 1 m/s² on x, y, z; bounds.
    mass, centre : mass, kg; centre of mass (3,), m.
    condensed_mass : (6(1+n), 6(1+n)) mass on the twists of clamp and interfaces.
    reference_points, clamp_point : (n, 3) and (3,) positions of these points, m.
    """

    value: float
    unit: str
    full_compliance: Floats
    full_error: Floats
    self_weight: Floats
    self_weight_error: Floats
    mass: float
    centre: Floats
    condensed_mass: Floats
    reference_points: Floats
    clamp_point: Floats

    @property
    def compliance(self) -> Floats:
        """Derivative (6, 6) of the first interface's compliance."""
        return self.full_compliance[:6, :6]

    @property
    def error(self) -> Floats:
        """95 % bounds (6, 6) of ``compliance``."""
        return self.full_error[:6, :6]


@dataclass(frozen=True, eq=False)
class PartSensitivity:
    """Derivatives of a part by parameter; reasons for missing ones (``notes``); stage times, s."""

    part: str
    derivatives: dict[str, Derivative]
    notes: dict[str, str] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)
