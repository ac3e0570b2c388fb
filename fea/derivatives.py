"""Derivatives of a part by its parameters, as numbers; ``stiffscope.fea.sensitivity`` finds them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from stiffscope.fea.mesh import Floats


@dataclass(frozen=True, eq=False)
class Derivative:
    """Derivatives of a part by one parameter; SI, per SI unit of the parameter.

    Attributes
    ----------
    value, unit : of the parameter.
    full_compliance, full_error : (6n, 6n) of the compliance of all n loaded interfaces together, each at its
        reference point, which moves with the part; and its 95 % bounds.
    self_weight, self_weight_error : (3, 6) of the twist of the first interface for 1 m/s² along x, y, z; its bounds.
    mass, centre : kg; (3,) of the centre of mass, m.
    condensed_mass : (6(1+n), 6(1+n)) of the mass on the twists of clamp and interfaces.
    reference_points, clamp_point : (n, 3) and (3,) of these points, m.
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
        """(6, 6) of the compliance of the first interface."""
        return self.full_compliance[:6, :6]

    @property
    def error(self) -> Floats:
        """(6, 6) 95 % bounds of ``compliance``."""
        return self.full_error[:6, :6]


@dataclass(frozen=True, eq=False)
class PartSensitivity:
    """Derivatives of a part by name of parameter; why some parameters have none (``notes``); seconds of the stages."""

    part: str
    derivatives: dict[str, Derivative]
    notes: dict[str, str] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)
