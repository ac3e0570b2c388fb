"""Cross-sections of beams in closed form: areas, second moments, torsion, shear and warping."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, tanh

import numpy as np

from stiffscope.errors import InputError

CORNER = (
    0.559  # sharp corner's share of a wall square in shear flow, by conformal mapping
)


@dataclass(frozen=True)
class Section:
    """A cross-section.

    Attributes
    ----------
    area : m².
    bending_y, bending_z : second moments of area about y and z, m⁴.
    torsion : torsion constant J, m⁴; the torque is G J times the twist per metre.
    shear_y, shear_z : shear coefficients κ for forces along y and z.
    shear_centre : y of the shear centre from the centroid, m; on the y axis by symmetry.
    warping : warping constant C_w, m⁶, of open sections; see ``restrained_torsion``.
    """

    area: float
    bending_y: float
    bending_z: float
    torsion: float
    shear_y: float
    shear_z: float
    shear_centre: float = 0.0
    warping: float = 0.0


def circle(radius: float, bore: float = 0.0, poisson: float = 0.3) -> Section:
    """Return a circle or tube of given radii (m), with Cowper's shear coefficient (1966).

    Parameters
    ----------
    radius
        Outer radius, m.
    bore
        Inner radius, m; 0 for a solid bar.
    poisson
        Poisson's ratio; only affects shear.

    Raises
    ------
    InputError : unless 0 <= bore < radius.
    """
    if not 0 <= bore < radius < np.inf:
        got = f"bore {bore} m and radius {radius} m"
        raise InputError(f"section: expected 0 <= bore < radius, got {got}")
    ratio = (bore / radius) ** 2
    second = pi * (radius**4 - bore**4) / 4
    shear = 6 * (1 + poisson) * (1 + ratio) ** 2
    shear /= (7 + 6 * poisson) * (1 + ratio) ** 2 + (20 + 12 * poisson) * ratio
    return Section(pi * (radius**2 - bore**2), second, second, 2 * second, shear, shear)


def rectangle(width: float, height: float, poisson: float = 0.3) -> Section:
    """Return a rectangle, width along y, height along z (m): Saint-Venant torsion, Cowper shear.

    Parameters
    ----------
    width
        Outer size along y, m.
    height
        Outer size along z, m.
    poisson
        Poisson's ratio; only affects shear.

    Raises
    ------
    InputError : if a side is not positive.
    """
    if not (0 < width < np.inf and 0 < height < np.inf):
        got = f"width {width} m and height {height} m"
        raise InputError(f"section: expected positive sides, got {got}")
    second = width * height**3 / 12, height * width**3 / 12
    shear = 10 * (1 + poisson) / (12 + 11 * poisson)
    return Section(
        width * height, *second, saint_venant_torsion(width, height), shear, shear
    )


def box(width: float, height: float, wall: float, poisson: float = 0.3) -> Section:
    """Return a rectangular tube, width along y, height along z (m): Bredt torsion, Cowper shear.

    Parameters
    ----------
    width
        Outer size along y, m.
    height
        Outer size along z, m.
    wall
        Wall thickness, m.
    poisson
        Poisson's ratio; only affects shear.

    Raises
    ------
    InputError : if the walls leave no hole.
    """
    _check_walls(min(width, height) / 2, wall)
    inner_width = width - 2 * wall
    inner_height = height - 2 * wall
    middle = (width - wall, height - wall)
    slope = 3 + poisson
    ratios = middle[1] / middle[0], middle[0] / middle[1]
    around = 2 * sum(middle) / wall - 4 * (1 - CORNER)
    bredt = 4 * (middle[0] * middle[1]) ** 2 / around
    return Section(
        area=width * height - inner_width * inner_height,
        bending_y=(width * height**3 - inner_width * inner_height**3) / 12,
        bending_z=(height * width**3 - inner_height * inner_width**3) / 12,
        torsion=bredt
        + 2 * sum(middle) * wall**3 / 3,  # torsion of the walls themselves
        shear_y=_cowper(
            m=ratios[0], n=ratios[0], width=10, first=slope, second=3.0, poisson=poisson
        ),
        shear_z=_cowper(
            m=ratios[1], n=ratios[1], width=10, first=slope, second=3.0, poisson=poisson
        ),
    )


def i_section(
    width: float, height: float, flange: float, web: float, poisson: float = 0.3
) -> Section:
    """Return an I-section, flange width along y, overall height along z (m).

    Cowper's shear along the web; flanges as rectangles across it; torsion by El Darwish and
    Johnston.

    Parameters
    ----------
    width
        Outer size along y, m.
    height
        Outer size along z, m.
    flange
        Thickness of the flanges, m.
    web
        Thickness of the web, m.
    poisson
        Poisson's ratio; only affects shear.

    Raises
    ------
    InputError : if a flange or the web leaves no room.
    """
    _check_walls(height / 2, flange)
    _check_walls(width, web)
    inside = height - 2 * flange
    middle = height - flange
    area = 2 * width * flange + inside * web
    bending_z = (2 * flange * width**3 + inside * web**3) / 12
    ratio = web / flange
    flanges = 10 * (1 + poisson) / (12 + 11 * poisson)
    disc = flange + web**2 / (4 * flange)
    flange_ratio = 2 * width * flange / (middle * web)
    slopes = (1 + 8 * poisson / 6, 1 + 1.5 * poisson)
    torsion = (2 * width * flange**3 + inside * web**3) / 3 - 0.42 * flange**4
    return Section(
        area=area,
        bending_y=(width * height**3 - (width - web) * inside**3) / 12,
        bending_z=bending_z,
        torsion=torsion + 2 * (-0.042 + 0.2204 * ratio - 0.0725 * ratio**2) * disc**4,
        shear_y=flanges * 2 * width * flange / area,
        shear_z=_cowper(flange_ratio, width / middle, 30, *slopes, poisson),
        warping=bending_z * middle**2 / 4,
    )


def channel(width: float, height: float, flange: float, web: float) -> Section:
    """Return a channel, flange width along +y from the web's outer side, height along z (m).

    Shear from the energy of Jourawski's shear flow in the walls' middle lines; torsion by El
    Darwish and Johnston.

    Parameters
    ----------
    width
        Outer size along y, m.
    height
        Outer size along z, m.
    flange
        Thickness of the flanges, m.
    web
        Thickness of the web, m.

    Raises
    ------
    InputError : if a flange or the web leaves no room.
    """
    _check_walls(height / 2, flange)
    _check_walls(width, web)
    inside = height - 2 * flange
    h = height - flange
    b = width - web / 2
    area = 2 * width * flange + inside * web
    back = (2 * width**2 * flange + inside * web**2) / (2 * area)
    bending_y = (width * height**3 - (width - web) * inside**3) / 12
    bending_z = (2 * flange * width**3 + inside * web**3) / 3 - area * back**2
    thin = 2 * flange * b + web * h  # area of the middle lines
    c = (
        b**2 * flange / thin
    )  # from the web's middle line to the centroid of the middle lines
    corner = flange * b * h / 2
    along_web = (corner**2 * h + corner * web * h**3 / 6 + web**2 * h**5 / 120) / web
    along_web += flange * h**2 * b**3 / 6
    a = b - c
    turn = flange * b * (b / 2 - c)
    across = 2 * flange * (a**2 * b**3 / 3 - a * b**4 / 4 + b**5 / 20) + turn**2 * h / (
        3 * web
    )
    about_y = web * h**3 / 12 + flange * b * h**2 / 2
    about_z = flange * b**3 / 6 + 2 * flange * b * (b / 2 - c) ** 2 + web * h * c**2
    walls = 6 * b * flange + h * web
    eccentricity = 3 * b**2 * flange / walls
    ratio = web / flange
    disc = 2 * (web + flange - (2 * web * flange) ** 0.5)
    torsion = (2 * width * flange**3 + inside * web**3) / 3 - 0.42 * flange**4
    return Section(
        area=area,
        bending_y=bending_y,
        bending_z=bending_z,
        torsion=torsion + 2 * (-0.0908 + 0.2621 * ratio - 0.0945 * ratio**2) * disc**4,
        shear_y=about_z**2 / (across * area),
        shear_z=about_y**2 / (along_web * area),
        shear_centre=-(back - web / 2 + eccentricity),
        warping=flange * b**3 * h**2 / 12 * (3 * b * flange + 2 * h * web) / walls,
    )


def _check_walls(room: float, wall: float) -> None:
    if not 0 < wall < room < np.inf:
        raise InputError(f"section: expected walls thinner than {room} m, got {wall} m")


def _cowper(
    m: float, n: float, width: float, first: float, second: float, poisson: float
) -> float:
    """Return Cowper's coefficient (J. Appl. Mech. 33, 1966, 335) of a box or I along its webs.

    Parameters
    ----------
    m, n : ratios of flange to web area and of width to height, of the middle lines.
    width, first, second : coefficients of the term n² (first m + second m²).
    """
    shape = (
        12
        + 72 * m
        + 150 * m**2
        + 90 * m**3
        + poisson * (11 + 66 * m + 135 * m**2 + 90 * m**3)
    )
    shape += width * n**2 * (first * m + second * m**2)
    return 10 * (1 + poisson) * (1 + 3 * m) ** 2 / shape


def saint_venant_torsion(width: float, height: float) -> float:
    """Return a rectangle's torsion constant, m⁴ (Timoshenko, Goodier, Theory of Elasticity, 109)."""
    a = max(width, height)
    b = min(width, height)
    series = sum(tanh(n * pi * a / (2 * b)) / n**5 for n in range(1, 60, 2))
    return a * b**3 / 3 * (1 - 192 * b / (pi**5 * a) * series)
