import numpy as np
import pytest

from stiffscope.cad.cross_sections import circle, rectangle, saint_venant_torsion
from stiffscope.errors import InputError
from stiffscope.fea.beam import euler_bernoulli, polar, timoshenko

pytestmark = pytest.mark.slow

E = 211e9
G = 81e9


def test_torsion_of_rectangles_is_timoshenko_and_goodiers_table():
    # Theory of Elasticity, art. 109: k1 in J = k1 a b^3 for a/b = 1, 2, 10
    for ratio, k1 in ((1, 0.1406), (2, 0.229), (10, 0.312)):
        assert saint_venant_torsion(ratio, 1) == pytest.approx(k1 * ratio, rel=2e-3)
    assert saint_venant_torsion(0.3, 0.02) == saint_venant_torsion(0.02, 0.3)


def test_published_slider_is_the_plate_with_iy_plus_iz():
    # method.md: Eq. (29) is Euler-Bernoulli for 85 x 320 x 20 mm with torsion constant Iy + Iz
    section = rectangle(0.32, 0.02)
    published = euler_bernoulli(0.085, polar(section), E, G)
    assert published[3, 3] == pytest.approx(19e-9, rel=0.02)
    assert published[1, 1] == pytest.approx(0.018e-9, rel=0.02)
    honest = timoshenko(0.085, section, E, G)
    assert honest[3, 3] == pytest.approx(1.3e-6, rel=0.02)
    assert honest[1, 1] == pytest.approx(0.21e-9, rel=0.1)


def test_a_beam_in_two_pieces_is_the_beam():
    section = circle(0.0125, 0.004)
    whole, half = (timoshenko(length, section, E, G) for length in (0.5, 0.25))
    shift = np.eye(6)
    shift[1, 5] = 0.25
    shift[2, 4] = -0.25  # the first half's end twist, carried to the tip
    assert half + shift @ half @ shift.T == pytest.approx(whole, rel=1e-12)


def test_a_tube_is_a_circle_less_a_circle():
    outer = circle(0.02)
    inner = circle(0.015)
    tube = circle(0.02, 0.015)
    assert tube.area == pytest.approx(outer.area - inner.area)
    assert tube.torsion == pytest.approx(outer.torsion - inner.torsion)
    assert tube.shear_y < outer.shear_y


@pytest.mark.parametrize(
    "bad",
    [lambda: circle(0.01, 0.01), lambda: rectangle(0, 1), lambda: circle(float("nan"))],
)
def test_impossible_sections_are_refused(bad):
    with pytest.raises(InputError):
        bad()


def test_links_compliance_is_near_beam_theory(link):
    beam = timoshenko(0.5, circle(0.0125, poisson=E / (2 * G) - 1), E, G)
    diagonal = link.compliance.diagonal() / beam.diagonal()
    assert (
        (diagonal > 0.996) & (diagonal < 1.0005)
    ).all()  # the clamp restrains contraction: 0.1 to 0.3 % stiffer
