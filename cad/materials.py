"""Linear elastic materials with sources (docs/theory.md, section 6.1). SI; fibres along x."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.cad.checks import number, require
from stiffscope.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray


def _check(material: Material | TransverselyIsotropic, *positive: str) -> None:
    """Raise InputError unless all values are finite numbers, and some of them positive."""
    for field in fields(material):
        if field.name not in {"name", "source"}:
            number(
                f"materials.{material.name}.{field.name}", getattr(material, field.name)
            )
    for name in positive:
        value = getattr(material, name)
        require(
            value > 0, f"materials.{material.name}.{name}", "more than 0", f"{value:g}"
        )


@dataclass(frozen=True)
class Material:
    """Isotropic linear elastic material.

    Parameters
    ----------
    name
        Key in the table of materials.
    youngs_modulus, shear_modulus
        Pa.
    density
        kg/m³.
    expansion
        Coefficient of linear thermal expansion, 1/K.
    source
        Source of the values.

    Raises
    ------
    InputError
        If a value is not finite, the elasticity is not positive definite, or there is no density.
    """

    name: str
    youngs_modulus: float
    shear_modulus: float
    density: float
    expansion: float = 0.0
    source: str = ""

    def __post_init__(self) -> None:
        _check(self, "youngs_modulus", "shear_modulus", "density")
        ratio = self.poisson
        typical = f"{self.youngs_modulus / 2.6e9:.3g} GPa"
        valid = f"more than {self.youngs_modulus / 3e9:.4g} GPa (Poisson's ratio, here {ratio:.3g},"
        valid += f" is in (-1, 0.5); typically {typical})"
        field = f"materials.{self.name}.shear_modulus"
        require(-1 < ratio < 0.5, field, valid, f"{self.shear_modulus / 1e9:.4g} GPa")

    @property
    def poisson(self) -> float:
        """Poisson's ratio, E / 2G - 1."""
        return self.youngs_modulus / (2 * self.shear_modulus) - 1

    def elasticity(self) -> NDArray[np.float64]:
        """Return (6, 6) elasticity, Pa: Voigt order xx yy zz yz xz xy, engineering shear strain."""
        lame = (
            self.youngs_modulus
            * self.poisson
            / ((1 + self.poisson) * (1 - 2 * self.poisson))
        )
        stiffness = np.diag([2 * self.shear_modulus] * 3 + [self.shear_modulus] * 3)
        stiffness[:3, :3] += lame
        return stiffness


@dataclass(frozen=True)
class TransverselyIsotropic:
    """Transversely isotropic linear elastic material: fibres along x, isotropic in the y-z plane.

    The shear modulus of the y-z plane is ``transverse_modulus / 2 / (1 + transverse_poisson)``.

    Parameters
    ----------
    name
        Key in the table of materials.
    axial_modulus, transverse_modulus
        Young's moduli along x and in the y-z plane, Pa.
    axial_shear_modulus
        Shear modulus between x and the y-z plane, Pa.
    axial_poisson
        Transverse contraction for strain along x.
    transverse_poisson
        Contraction in the y-z plane for strain in it.
    density
        kg/m³.
    axial_expansion, transverse_expansion
        Coefficients of linear thermal expansion, 1/K.
    source
        Source of the values.

    Raises
    ------
    InputError
        If a value is not finite, the elasticity is not positive definite, or there is no density.
    """

    name: str
    axial_modulus: float
    transverse_modulus: float
    axial_shear_modulus: float
    axial_poisson: float
    transverse_poisson: float
    density: float
    axial_expansion: float = 0.0
    transverse_expansion: float = 0.0
    source: str = ""

    def __post_init__(self) -> None:
        _check(
            self,
            "axial_modulus",
            "transverse_modulus",
            "axial_shear_modulus",
            "density",
        )
        field = f"materials.{self.name}"
        across = self.transverse_poisson
        between = "a number between -1 and 1"
        require(-1 < across < 1, f"{field}.transverse_poisson", between, f"{across:g}")
        along = self.axial_poisson
        largest = math.sqrt(
            self.axial_modulus / self.transverse_modulus * (1 - across) / 2
        )
        between = f"a number between {-largest:.4g} and {largest:.4g}"
        between += " (else the elasticity matrix is not positive definite)"
        require(abs(along) < largest, f"{field}.axial_poisson", between, f"{along:g}")

    @property
    def youngs_modulus(self) -> float:
        """Young's modulus along x, for beam theory."""
        return self.axial_modulus

    @property
    def shear_modulus(self) -> float:
        """Shear modulus between x and the y-z plane, for beam theory."""
        return self.axial_shear_modulus

    @property
    def expansion(self) -> float:
        """Coefficient of linear thermal expansion along x, 1/K."""
        return self.axial_expansion

    def elasticity(self) -> NDArray[np.float64]:
        """Return (6, 6) elasticity, Pa: Voigt order xx yy zz yz xz xy, engineering shear strain."""
        along = 1 / self.axial_modulus
        across = 1 / self.transverse_modulus
        compliance = np.diag([along, across, across] + [0.0] * 3)
        compliance[0, 1:3] = compliance[1:3, 0] = -self.axial_poisson * along
        compliance[1, 2] = compliance[2, 1] = -self.transverse_poisson * across
        compliance[3, 3] = 2 * (1 + self.transverse_poisson) * across
        compliance[4, 4] = compliance[5, 5] = 1 / self.axial_shear_modulus
        stiffness = np.linalg.inv(compliance)
        return (stiffness + stiffness.T) / 2


AnyMaterial = Material | TransverselyIsotropic

STEEL = Material(
    name="steel",
    youngs_modulus=211e9,
    shear_modulus=81e9,
    density=7850.0,
    expansion=11.7e-6,
    source="E, G: Table 4 of Guan et al. (2023), see docs/theory.md, section 1. "
    "Density and expansion: handbook values of "
    "structural steel (EN 1991-1-1, ASM). The published link of 1.95 kg would need 7945 kg/m3",
)
ALUMINIUM_7075 = Material(
    name="aluminium-7075",
    youngs_modulus=71.7e9,
    shear_modulus=26.9e9,
    density=2810.0,
    expansion=23.6e-6,
    source="7075-T6: ASM Handbook vol. 2 (1990), Alcoa data sheet",
)
ALUMINIUM_6082 = Material(
    name="aluminium-6082",
    youngs_modulus=70e9,
    shear_modulus=27e9,
    density=2700.0,
    expansion=23e-6,
    source="EN AW-6082 (AlMgSi1): EN 1999-1-1, 3.2.5, design values of wrought aluminium alloys",
)
CAST_IRON = Material(
    name="cast-iron",
    youngs_modulus=110e9,
    shear_modulus=110e9 / 2.52,
    density=7200.0,
    expansion=11.7e-6,
    source="grey iron EN-GJL-250, EN 1561 annex A: E 103-118 GPa, Poisson 0.26, expansion 20-400 C",
)
DUCTILE_IRON = Material(
    name="ductile-iron",
    youngs_modulus=169e9,
    shear_modulus=169e9 / 2.55,
    density=7100.0,
    expansion=12.5e-6,
    source="spheroidal iron EN-GJS-400-15, EN 1563 annex: E 169 GPa, Poisson 0.275, expansion 20-400 C",
)
TITANIUM = Material(
    name="titanium",
    youngs_modulus=113.8e9,
    shear_modulus=44e9,
    density=4430.0,
    expansion=8.6e-6,
    source="Ti-6Al-4V (grade 5), annealed: ASM, Materials Properties Handbook: Titanium Alloys (1994)",
)
CFRP_TUBE = TransverselyIsotropic(
    name="cfrp-tube",
    axial_modulus=126e9,
    transverse_modulus=11e9,
    axial_shear_modulus=6.6e9,
    axial_poisson=0.28,
    transverse_poisson=0.4,
    density=1580.0,
    axial_expansion=-1e-6,
    transverse_expansion=26e-6,
    source="AS4/3501-6, 60 % fibres, all along the tube: Soden, Hinton and Kaddour, Compos. Sci. Technol. 58 (1998) "
    "1011, table 2; density: maker's data. Angle plies are stiffer in torsion and softer in tension: define your own",
)

_METALS = (STEEL, ALUMINIUM_7075, ALUMINIUM_6082, CAST_IRON, DUCTILE_IRON, TITANIUM)
MATERIALS: dict[str, AnyMaterial] = {
    metal.name: metal for metal in (*_METALS, CFRP_TUBE)
}
DESIGNATIONS = {
    "AlMgSi1": "aluminium-6082",
    "EN AW-6082": "aluminium-6082",
    "EN AW-7075": "aluminium-7075",
    "EN-GJL-250": "cast-iron",
    "EN-GJS-400-15": "ductile-iron",
    "Ti-6Al-4V": "titanium",
    "TiAl6V4": "titanium",
}
"""Designations of materials in CAD and standards, and their names here."""


def material(name: str, own: Mapping[str, AnyMaterial] | None = None) -> AnyMaterial:
    """Return a material by name: of ``own``, or else of `MATERIALS`; InputError lists the names."""
    known = MATERIALS | dict(own or {})
    if name not in known:
        raise InputError(f"material: expected one of {', '.join(known)}, got {name!r}")
    return known[name]
