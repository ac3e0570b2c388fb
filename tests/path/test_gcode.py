"""G-code as points and back, and mean cutting forces."""

from __future__ import annotations

import numpy as np
import pytest

from stiffscope.errors import InputError
from stiffscope.path.cutting import mill, specific_force
from stiffscope.path.gcode import program_text, read_program

PROGRAM = """%
(a comment)
G21 G90 G17
G0 X0 Y0 Z5
G1 Z-1 F300 M3 S2000
F600
G1 X10
G3 X20 Y10 I0 J10
G2 X30 Y20 R10
G91 G1 X-5 Y-5
G90 G18 G2 X20 Z1 I-2.5 K1
G20 G1 X1 F20
M30
"""


def test_gcode_written_and_read_again_is_the_same_path(tmp_path):
    (tmp_path / "a.nc").write_text(PROGRAM)
    one = read_program(tmp_path / "a.nc", 1e-3)
    (tmp_path / "b.nc").write_text(program_text(one, one.points))
    two = read_program(tmp_path / "b.nc", np.inf)
    np.testing.assert_allclose(two.points, one.points, atol=1e-12)
    np.testing.assert_array_equal(two.rapid, one.rapid)
    np.testing.assert_allclose(two.feed[1:], one.feed[1:], rtol=1e-12)
    assert one.points[-1] == pytest.approx([0.0254, 0.015, 0.001])
    ends = {int(line): point for line, point in zip(one.line, one.points, strict=True)}
    assert ends[7] == pytest.approx([0.020, 0.010, -0.001])
    arc = one.points[one.line == 7]
    np.testing.assert_allclose(
        np.linalg.norm(arc[:, :2] - [0.010, 0.010], axis=1), 0.010, rtol=1e-9
    )


@pytest.mark.parametrize("plane", ["G17", "G18", "G19"])
@pytest.mark.parametrize("sense", ["G2", "G3"])
@pytest.mark.parametrize(("modes", "unit"), [("G21 G90", 1e-3), ("G20 G91", 25.4e-3)])
def test_arcs_run_round_their_centre_in_every_plane(
    plane, sense, modes, unit, tmp_path
):
    """A quarter by I J K, the same by R, the other three quarters by a negative R, and a full circle."""
    first, second = {"G17": "XY", "G18": "ZX", "G19": "YZ"}[plane]
    a, b = ("XYZ".index(axis) for axis in (first, second))
    offset = "IJK"[a]
    turn = 1.0 if sense == "G3" else -1.0
    end = f"{first}{0 if 'G90' in modes else -3} {second}{3.0 * turn}"  # from (3, 0) round 0 to (0, ± 3)

    def points(arc):
        (tmp_path / "a.nc").write_text(
            f"N1 {modes} F600 (start)\nn2 g1 {first}3.\nN30{plane}{sense}{arc};end\n"
        )
        program = read_program(tmp_path / "a.nc", 0.2 * unit)
        (tmp_path / "b.nc").write_text(program_text(program, program.points))
        again = read_program(tmp_path / "b.nc", np.inf)
        np.testing.assert_allclose(again.points, program.points, atol=1e-9)
        found = program.points[program.line == program.line[-1]] / unit
        found = np.vstack(
            (program.points[program.line != program.line[-1]][-1:] / unit, found)
        )
        assert np.ptp(np.delete(found, [a, b], axis=1)) < 1e-12
        flat = found[:, [a, b]]
        np.testing.assert_allclose(
            np.linalg.norm(np.diff(flat, axis=0), axis=1).max(), 0.2, rtol=0.05
        )
        return flat, turn * np.unwrap(np.arctan2(flat[:, 1], flat[:, 0]))

    for arc in (f"{end}{offset}-3", f"{end}R3"):
        flat, angle = points(arc)
        np.testing.assert_allclose(np.hypot(*flat.T), 3.0, rtol=1e-9)
        assert angle[-1] - angle[0] == pytest.approx(np.pi / 2)
        assert (np.diff(angle) > 0).all()
    flat, angle = points(f"{offset}-3")
    np.testing.assert_allclose(np.hypot(*flat.T), 3.0, rtol=1e-9)
    assert angle[-1] - angle[0] == pytest.approx(2 * np.pi)
    flat, _ = points(f"{end}R-3")
    np.testing.assert_allclose(np.hypot(*(flat - [3.0, 3.0 * turn]).T), 3.0, rtol=1e-9)
    assert np.linalg.norm(np.diff(flat, axis=0), axis=1).sum() == pytest.approx(
        3.0 * 1.5 * np.pi, rel=1e-3
    )


def test_a_dwell_moves_nothing(tmp_path):
    (tmp_path / "a.nc").write_text("G21\nG1 X10 F600\nG4 X2.5\nG1 X20\n")
    assert read_program(tmp_path / "a.nc", np.inf).points[:, 0] == pytest.approx(
        [0.010, 0.020]
    )


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("G1 X1 Y@", "a.nc:2: expected words"),
        ("G2 X10 Y0 I3 J0", "a.nc:2: expected an arc whose ends"),
        ("G2 X10 Y0 R2", "a.nc:2: R: expected a radius"),
        ("G1 X1 A5", "a.nc:2: A: expected moves in X, Y and Z"),
        ("G28", "a.nc:2: G28"),
        ("G81 X1 Z-3", "a.nc:2: G81"),
        ("G90.1", "a.nc:2: G90.1"),
        ("M98 P1000", "a.nc:2: M98"),
        ("G1 X1e1", "a.nc:2: X: expected a number without an exponent, got X1E1"),
        (
            "G1 Y-2.5E+1 F200",
            r"a.nc:2: Y: expected a number without an exponent, got Y-2.5E\+1",
        ),
        ("G1 X1 Y2 X9", "a.nc:2: X: expected one word of a letter, got X1 and X9"),
        ("G1 X1 F0", "a.nc:2: F: expected a feed above 0, got F0"),
        ("F-10", "a.nc:2: F: expected a feed above 0, got F-10"),
    ],
)
def test_what_no_path_is_read_from_is_refused(line, message, tmp_path):
    (tmp_path / "a.nc").write_text(f"G21\n{line}\n")
    with pytest.raises(InputError, match=message):
        read_program(tmp_path / "a.nc", 1e-3)


def test_an_extruder_s_word_is_no_exponent(tmp_path):
    (tmp_path / "a.nc").write_text("G21 G90\nG1X10Y5E0.5F600\nG1 X20 E2\n")
    assert read_program(tmp_path / "a.nc", np.inf).points[:, 0] == pytest.approx(
        [0.010, 0.020]
    )


@pytest.mark.parametrize("climb", [True, False])
@pytest.mark.parametrize("width", [2e-3, 7e-3, 10e-3])
def test_mean_milling_forces_are_those_of_the_teeth_over_a_turn(climb, width):
    kc1 = 2.22e9
    mc = 0.14
    radial = 0.3
    teeth = 3
    depth = 2e-3
    feed = 0.012
    speed = 50.0
    found = mill(
        kc1,
        mc,
        diameter=10e-3,
        teeth=teeth,
        speed=speed,
        feed=feed,
        depth=depth,
        width=width,
        climb=climb,
        radial=radial,
    )
    per_tooth = feed / (teeth * speed)
    angle = (np.arange(400_000) + 0.5) * (
        2 * np.pi / 400_000
    )  # of one tooth, clockwise from the left of the feed
    left = 5e-3 * np.cos(angle)
    cutting = (angle < np.pi) & (
        (left < -5e-3 + width) if climb else (left > 5e-3 - width)
    )
    chip = np.where(cutting, per_tooth * np.sin(angle), 0.0)
    mean_chip = chip[cutting].mean()
    assert found.chip == pytest.approx(mean_chip, rel=1e-4)
    kt = specific_force(kc1, mc, mean_chip)
    tangential = kt * depth * chip
    inward = radial * kt * depth * chip
    along_feed = -tangential * np.cos(angle) - inward * np.sin(angle)
    across = tangential * np.sin(angle) - inward * np.cos(angle)
    assert found.feed == pytest.approx(teeth * along_feed.mean(), rel=1e-3, abs=1e-3)
    assert found.across == pytest.approx(teeth * across.mean(), rel=1e-3)
    assert found.torque == pytest.approx(teeth * tangential.mean() * 5e-3, rel=1e-3)


def test_power_of_face_milling_is_that_of_a_published_example():
    """Mitsubishi Materials, Technical information, Formulae for cutting power: tool steel, a cutter of 250 mm.

    80 m/min, 12 teeth, 2 mm by 80 mm, 280 mm/min, kc = 1800 MPa: 101.91 rpm, 0.228 mm a tooth, 1.68 kW at an
    efficiency of 0.8. Its table has kc = 2030 and 1580 MPa at 0.1 and 0.6 mm a tooth; Kienzle's law through both has
    1800, 1750 and 1700 at 0.2, 0.3 and 0.4 mm within 3 %.
    """
    speed = 80.0 / 60.0 / (np.pi * 0.25)
    assert 60.0 * speed == pytest.approx(101.91, rel=1e-3)
    cut = {
        "diameter": 0.25,
        "teeth": 12,
        "speed": speed,
        "feed": 0.28 / 60.0,
        "depth": 2e-3,
        "width": 80e-3,
    }
    assert cut["feed"] / (12 * speed) == pytest.approx(0.228e-3, rel=5e-3)
    assert mill(1800e6, 0.0, **cut).power / 0.8 == pytest.approx(1680.0, rel=3e-3)
    mc = np.log(2030.0 / 1580.0) / np.log(6.0)
    kc1 = 1580e6 * 0.6**mc
    for tooth, kc in ((0.2e-3, 1800e6), (0.3e-3, 1750e6), (0.4e-3, 1700e6)):
        assert specific_force(kc1, mc, tooth) == pytest.approx(kc, rel=0.03)


def test_power_is_that_of_the_teeth_in_the_cut_with_the_mean_chip():
    """The textbook's way (Dietrich, Tschätsch, Praxis der Zerspanungstechnik, 11th ed. 2014): S235, a 3 mm end mill.

    ``h = 360° / (π φ) · a_e / D · f_z``, ``F = a_p h kc1 h^-mc`` a tooth, ``P = F v_c z φ / 360°``; mm, N, m/min.
    """
    arc = np.degrees(np.arccos(1.0 - 2.0 * 0.25 / 3.0))
    chip = 360.0 / (np.pi * arc) * 0.25 / 3.0 * 0.1
    power = 3.0 * chip * 1780.0 * chip**-0.17 * (200.0 / 60.0) * 2 * arc / 360.0
    speed = 200.0 / 60.0 / (np.pi * 3e-3)
    feed = 2 * 0.1e-3 * speed
    found = mill(
        1780e6,
        0.17,
        diameter=3e-3,
        teeth=2,
        speed=speed,
        feed=feed,
        depth=3e-3,
        width=0.25e-3,
    )
    assert (1e3 * found.chip, found.power) == pytest.approx((chip, power), rel=1e-9)
