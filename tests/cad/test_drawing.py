"""Parametric solids are those that build123d draws, and building them does not import it."""

import subprocess
import sys

import numpy as np
import pytest

from stiffscope.cad.beam import BoxParameters, TubeParameters
from stiffscope.cad.link import LinkParameters
from stiffscope.cad.part import Part, mass_properties
from stiffscope.cad.slider import SliderParameters
from stiffscope.cad.solid import build, part_of

pytestmark = pytest.mark.slow


def drawn_slider():
    from build123d import Align, Box, Cylinder, Pos, fillet

    outwards = (Align.MIN, Align.CENTER, Align.CENTER)
    below = (Align.MIN, Align.CENTER, Align.MIN)
    solid = Box(85, 320, 20, align=outwards)
    for y in (0, 70, -70):
        solid += Pos(85, y, 0) * Box(5, 30, 20, align=outwards)
    for y in (-320 / 3, 0, 320 / 3):
        nose = Pos(70, 0, 0) * Cylinder(5, 15, align=(*outwards[1:], Align.MIN))
        solid += Pos(0, y, 10) * (Box(70, 10, 15, align=below) + nose)
    roots = [
        edge
        for edge in solid.edges()
        if abs((middle := edge.position_at(0.5)).Z - 10) < 1e-6
        and 1e-6 < middle.X < 85 - 1e-6
        and abs(middle.Y) < 160 - 1e-6
    ]
    solid = fillet(roots, 4)
    for y in (-80, 80):
        solid -= Pos(15, y, 0) * Cylinder(4.5, 40)
    return solid


def drawn_link():
    from build123d import Axis, Polygon, revolve

    corners = (0, 5), (0, 20), (30, 20), (30, 12.5), (470, 12.5), (470, 20), (500, 20)
    section = Polygon(*corners, (500, 5), align=None)
    return revolve(section.face(), Axis.X)


def drawn_tube():
    from build123d import Circle, Plane, extrude

    return extrude(Plane.YZ * (Circle(20) - Circle(18)), 300)


def drawn_box():
    from build123d import Plane, Rectangle, extrude

    return extrude(Plane.YZ * (Rectangle(50, 80) - Rectangle(42, 72)), 300)


@pytest.mark.parametrize(
    ("parameters", "draw"),
    [
        (
            SliderParameters(rib_count=3, fillet=0.004, hole_count=2, pad_height=0.005),
            drawn_slider,
        ),
        (
            LinkParameters(bore=0.01, fitting_radius=0.02, fitting_length=0.03),
            drawn_link,
        ),
        (TubeParameters(length=0.3, radius=0.02, wall=0.002), drawn_tube),
        (BoxParameters(length=0.3, width=0.05, height=0.08, wall=0.004), drawn_box),
    ],
)
def test_parametric_solids_are_those_of_build123d(parameters, draw):
    ours, theirs = build(parameters), part_of(draw())
    one, two = mass_properties(ours), mass_properties(theirs)
    np.testing.assert_allclose(one.volume, two.volume, rtol=1e-12)
    np.testing.assert_allclose(one.centre, two.centre, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(one.inertia, two.inertia, rtol=1e-9, atol=1e-12)
    assert faces_of(ours) == faces_of(theirs)


def faces_of(part: Part):
    """Kinds, areas and centroids of the faces, in their order."""
    shown = lambda values: tuple(round(1e9 * value) for value in values)  # noqa: E731
    return sorted((f.kind, *shown([f.area, *f.centroid])) for f in part.faces)


def test_building_a_parametric_part_needs_the_kernel_alone():
    code = (
        "import sys; from stiffscope.cad.solid import build; "
        "from stiffscope.cad.slider import SliderParameters; "
        "build(SliderParameters(rib_count=2, fillet=0.004)); "
        "print('build123d' in sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], check=True, capture_output=True, text=True
    )
    assert done.stdout.strip() == "False"
