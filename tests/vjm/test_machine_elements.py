"""Bearings, guides and screws: published figures, second derivations, limits."""

import numpy as np
import pytest

from stiffscope.errors import InputError
from stiffscope.vjm.elements import machine_elements as me
from stiffscope.vjm.elements.rolling import LINE, hertz_constant, line_constant, settle

STEEL = me.reduced_modulus()
AC = {
    "count": 16,
    "diameter": 22.23e-3,
    "pitch": 125.26e-3,
    "angle": np.radians(40),
    "osculation": (0.5232, 0.5232),
}
DG = {
    "count": 7,
    "diameter": 11.5e-3,
    "pitch": 43.5e-3,
    "angle": 0.0,
    "osculation": (0.52, 0.53),
}
ISO = me.reduced_modulus((210e9, 0.3), (210e9, 0.3))


@pytest.mark.parametrize(
    ("difference", "approach"),
    [
        (0.3204, 0.9761),
        (0.5916, 0.9077),
        (0.7332, 0.8394),
        (0.87366, 0.7169),
        (0.90999, 0.6636),
        (0.9729, 0.4960),
    ],
)
def test_hertz_contacts_are_the_table_of_harris(difference, approach):
    """Dimensionless approach δ* over the curvatures' difference F(ρ) (table 6.1); a ball on a plate in closed form."""
    total = 100.0
    c = hertz_constant(0.5 * total * np.array([1 - difference, 1 + difference]), STEEL)
    assert c ** (-2 / 3) == pytest.approx(
        approach * (1.5 / total / STEEL) ** (2 / 3) * total / 2, rel=1e-3
    )
    r = 0.01
    assert hertz_constant(np.array([1 / r, 1 / r]), STEEL) == pytest.approx(
        4 / 3 * STEEL * r**0.5, rel=1e-6
    )


@pytest.mark.parametrize(
    ("clearance", "wrench", "moved"),
    [
        (0.0, [0, 1000, 0], {1: 15.1101e-6}),
        (0.0, [1000, 0, 0], {0: 133.5381e-6}),
        (1e-5, [0, 1000, 0], {1: 21.223e-6}),
        (1e-5, [1000, 0, 0], {0: 149.1717e-6}),
        (1e-5, [1000, 1000, 0], {0: 146.4603e-6, 1: 19.5923e-6}),
    ],
)
def test_a_deep_groove_bearing_is_that_of_iso_16281(clearance, wrench, moved):
    """By a commercial program: seven balls of 11.5 mm on 43.5 mm, E = 210 GPa (minzhun, ISO16281, its tests)."""
    balls = me.ball_contacts(**DG, modulus=ISO, clearance=clearance)
    twist = settle(balls, np.array([*wrench, 0, 0, 0], dtype=float), 0.02)
    for axis, expected in moved.items():
        assert twist[axis] == pytest.approx(expected, rel=1e-4)


def test_its_tilt_under_a_moment_is_that_of_the_standard():
    balls = me.ball_contacts(**DG, modulus=ISO)
    twist = settle(balls, np.array([0, 0, 0, 0, 1.0, 0]), 0.02)
    assert np.linalg.norm(twist[3:]) == pytest.approx(3.6957e-3, rel=0.015)


def test_an_angular_contact_bearing_under_thrust_is_harris():
    """The 218 under 17,800 N (Harris, example 7.4): contact angle 41.6 degrees; load of a ball F / (Z sin α)."""
    found = me.ball_bearing(
        me.ball_contacts(**AC, modulus=STEEL), np.array([17800.0, 0, 0])
    )
    assert np.degrees(found.angles) == pytest.approx(41.6, abs=0.15)
    assert found.loads == pytest.approx(1676, rel=0.005)


@pytest.mark.parametrize("angle", [25.0, 40.0])
@pytest.mark.parametrize("load", [50.0, 500.0, 2000.0])
def test_an_angular_contact_bearing_is_as_stiff_along_its_axis_as_the_textbooks(
    angle, load
):
    """Axial approach 4.36e-4 Q^(2/3) / (D^(1/3) sin α), mm and N, of a ball's load Q = F / (Z sin α) (Palmgren; Harris
    and Kotzalas 2006, ch. 7), at the loaded contact angle; it names no osculation, 0.52 is the usual one."""
    found = me.ball_bearing(
        me.ball_contacts(16, 0.01, 0.08, np.radians(angle), (0.52,) * 2, STEEL),
        [load, 0.0, 0.0],
    )
    sine = np.sin(found.angles[0])
    approach = 4.36e-7 * (load / (16 * sine)) ** (2 / 3) / (10.0 ** (1 / 3) * sine)
    assert found.stiffness[0, 0] == pytest.approx(1.5 * load / approach, rel=0.04)


@pytest.mark.parametrize(
    "load", [[2000.0, 0, 0], [2000.0, 700.0, 0], [3000.0, -400.0, 900.0]]
)
@pytest.mark.parametrize("balls", [AC, DG])
def test_the_five_stiffnesses_are_the_slope_of_the_loads(balls, load):
    """By differences of the energy; symmetric, and coupled between sideways and tilting."""
    contacts = me.ball_contacts(**balls, modulus=STEEL)
    found = me.ball_bearing(contacts, np.array(load))
    held = [0, 1, 2, 4, 5]
    step = np.repeat([1e-9, 1e-8], 3)
    for j in held:
        h = np.eye(6)[j] * step[j]
        slope = (
            contacts.wrench(found.twist + h) - contacts.wrench(found.twist - h)
        ) / (2 * step[j])
        scale = np.sqrt(np.diag(found.stiffness)[held] * found.stiffness[j, j])
        assert np.abs((slope[held] - found.stiffness[held, j]) / scale).max() < 1e-5
    assert np.linalg.eigvalsh(found.stiffness[np.ix_(held, held)]).min() > 0.0


def test_thrust_alone_has_the_textbooks_sums():
    """At one angle for all balls: k_a = Z (k_n sin² + Q/s cos²), k_r = Z/2 (k_n cos² + Q/s sin²)."""
    contacts = me.ball_contacts(**AC, modulus=STEEL)
    found = me.ball_bearing(contacts, np.array([5000.0, 0, 0]))
    along, pressed, load, size = contacts.state(found.twist)
    k = 1.5 * load[0] / pressed[0]
    turn = load[0] / size[0]
    a = found.angles[0]
    radius = np.linalg.norm(contacts.at[0])
    axial = 16 * (k * np.sin(a) ** 2 + turn * np.cos(a) ** 2)
    radial = 8 * (k * np.cos(a) ** 2 + turn * np.sin(a) ** 2)
    coupled = 8 * radius * (k - turn) * np.sin(a) * np.cos(a)
    assert np.diag(found.stiffness) == pytest.approx(
        [axial, radial, radial, 0, *[axial * radius**2 / 2] * 2]
    )
    assert abs(found.stiffness[1, 5]) == pytest.approx(coupled)
    assert found.stiffness[1, 5] == pytest.approx(-found.stiffness[2, 4])
    assert along.shape == (16, 3)


def test_pairs_are_stiffest_against_tilting_back_to_back():
    contacts = me.ball_contacts(**AC, modulus=STEEL)
    load = np.array([1000.0, 0, 0])
    single, *pairs = (
        me.ball_bearing(contacts, load, how, 0.04)
        for how in ("single", "back-to-back", "face-to-face")
    )
    for pair in pairs:
        assert np.diag(pair.stiffness)[:3] == pytest.approx(
            2 * np.diag(single.stiffness)[:3]
        )
        assert np.abs(pair.stiffness[:3, 3:]).max() < 1e-6 * np.sqrt(
            pair.stiffness[1, 1] * pair.stiffness[5, 5]
        )
    assert pairs[0].stiffness[5, 5] > 2 * pairs[1].stiffness[5, 5]


def test_a_roller_bearing_with_interference_is_its_sum():
    """δ0 all round: Z/2 e c δ0^(e-1) sideways, and l²/12 of it about the middle against tilting."""
    found = me.roller_bearing(20, 0.012, 0.08, -4e-6, np.zeros(3))
    k = 10 * LINE * line_constant(0.012) * (2e-6) ** (LINE - 1)
    assert found.stiffness[1, 1] == pytest.approx(k, rel=1e-9)
    assert found.stiffness[5, 5] == pytest.approx(k * 0.012**2 / 12, rel=2e-3)
    assert found.free == (0, 3)
    crossed = me.crossed_roller(60, 0.008, 0.1, -2e-6, np.zeros(3))
    assert crossed.stiffness[0, 0] == pytest.approx(
        2 * crossed.stiffness[1, 1], rel=1e-9
    )
    assert crossed.stiffness[4, 4] == pytest.approx(
        crossed.stiffness[0, 0] * 0.05**2 / 2, rel=1e-9
    )


def test_carriages_are_the_springs_that_they_are():
    """Two springs k at ±a: 2k and 2ka²; a carriage of balls: 4n k_n sin²α upward, more against rolling back to back."""
    k = 3e8
    guide = me.guide_of_sheet((0, k, 2 * k, 0, 0, 0), (2, 0.2), (2, 0.3), "sheet")
    assert np.diag(guide.stiffness) == pytest.approx(
        [0, 4 * k, 8 * k, 8 * k * 0.1**2, 8 * k * 0.15**2, 4 * k * 0.15**2]
    )
    angle = np.radians(45)
    sizes = (0.02, 0.008, 0.05, 1500.0, STEEL)
    o, x = (
        me.carriage_contacts(12, 0.004, 0.52, angle, *sizes, face_to_face=f)
        for f in (False, True)
    )
    one, other = (me.guide_of_balls(c, (1, 0.0), (1, 0.0)).stiffness for c in (o, x))
    q = 1500.0 / (2 * 12 * np.sin(angle))
    normal = 1.5 * o.constant[0] ** (2 / 3) * q ** (1 / 3)
    assert one[2, 2] == pytest.approx(48 * normal * np.sin(angle) ** 2, rel=1e-9)
    assert (
        one[1, 1]
        == pytest.approx(other[1, 1])
        == pytest.approx(48 * normal * np.cos(angle) ** 2)
    )
    assert one[3, 3] > 5 * other[3, 3]


def test_a_screw_is_its_springs_in_series():
    shaft = 206e9 * np.pi * 0.02**2 / 4 / 0.6
    one = me.ball_screw(0.02, 0.6, 2e8, 3e8)
    assert 1 / one.stiffness[0, 0] == pytest.approx(1 / shaft + 1 / 2e8 + 1 / 3e8)
    both = me.ball_screw(0.02, 0.6, np.inf, np.inf, both_ends=True)
    assert both.stiffness[0, 0] == pytest.approx(4 * shaft)
    assert me.at_load(1e8, 1000.0, 8000.0, 1.5) == pytest.approx(2e8)


def test_what_carries_nothing_is_refused():
    with pytest.raises(InputError, match="load: expected"):
        me.roller_bearing(20, 0.012, 0.08, 1e-6, np.zeros(3))
    with pytest.raises(
        InputError, match="pitch: expected a circle that 16 balls of 30 mm fit on"
    ):
        me.ball_contacts(16, 0.03, 0.1, 0.3, (0.52, 0.53), STEEL)
    with pytest.raises(InputError, match="got a curvature"):
        me.ball_contacts(8, 0.01, 0.1, 0.3, (0.49, 0.53), STEEL)


@pytest.mark.parametrize(("count", "across"), [(8, 0.49), (12, 0.66), (16, 0.74)])
@pytest.mark.parametrize(("length", "load"), [(0.02, 500.0), (0.03, 1000.0)])
def test_a_roller_bearing_under_a_radial_load_is_the_textbooks(
    count, across, length, load
):
    """Along the load 1e9 N^0.9 l^0.8 F^0.1 (SI), across it a share (Friswell et al., Dynamics of Rotating Machines,
    2010, pp. 182-185; the rotordynamics library ROSS computes both so).

    The share is the sum over rollers at angles a, Σ sin²a cos^(1/9)a / Σ cos^(19/9)a. One at 90° carries nothing;
    an approach of 1e-17 of the others', as rounding leaves it, would give it 1 % of their stiffness. The book's
    shares differ by up to 4 %.
    """
    k = me.roller_bearing(count, length, 0.1, 0.0, np.array([0.0, load, 0.0])).stiffness
    assert k[1, 1] == pytest.approx(
        1e9 * count**0.9 * length**0.8 * load**0.1, rel=0.03
    )
    angles = (
        2.0 * np.pi * np.arange(1 - count // 4, count // 4) / count
    )  # without those at 90°
    cosines = np.cos(angles)
    sines = np.sin(angles)
    share = (sines**2 * cosines ** (1 / 9)).sum() / (cosines ** (19 / 9)).sum()
    assert k[2, 2] / k[1, 1] == pytest.approx(share, rel=1e-6)
    assert share == pytest.approx(across, rel=0.04)


@pytest.mark.parametrize("count", [8, 12, 16])
def test_a_ball_bearing_under_a_radial_load_is_the_textbooks(count):
    """Along the load 13e6 N^(2/3) d^(1/3) F^(1/3) (SI, same source), which names no osculation; 0.46 across 8 balls.

    Its shares across 12 and 16 balls, 0.64 and 0.73, are no sums of Hertz contacts, whose limit of many balls is 2/3.
    """
    low, high = (
        me.ball_bearing(
            me.ball_contacts(count, 0.03, 0.24, 0.0, (osculation,) * 2, STEEL),
            np.array([0.0, 500.0, 0.0]),
        ).stiffness
        for osculation in (0.52, 0.515)
    )
    assert (
        low[1, 1]
        < 13e6 * count ** (2 / 3) * 0.03 ** (1 / 3) * 500.0 ** (1 / 3)
        < high[1, 1]
    )
    if count == 8:
        assert low[2, 2] / low[1, 1] == pytest.approx(0.46, rel=0.01)
