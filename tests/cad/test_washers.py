"""Washers around the bolt holes of a solid as it is, from a STEP file."""

import numpy as np
import pytest
from build123d import Box, Cylinder, Plane, Pos, export_step

from stiffscope.cad.faces import FaceSelector
from stiffscope.cad.solid import part_of
from stiffscope.cad.step import read_step
from stiffscope.errors import InputError

pytestmark = pytest.mark.slow

UP = (0, 0, 1)
DOWN = (0, 0, -1)


def drilled():
    """A plate of 80 x 60 x 10 mm with holes of 8 mm at x = -15 and 15 mm, the second of 10 mm, and one in its side."""
    return (
        Box(80, 60, 10)
        - Pos(-15, 0) * Cylinder(4, 20)
        - Pos(15, 0) * Cylinder(5, 20)
        - side()
    )


def side():
    return Plane.YZ * Pos(10, 0, 40) * Cylinder(2, 20)


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    path = tmp_path_factory.mktemp("step") / "plate.step"
    export_step(drilled(), path)
    return path


def areas(part, faces):
    return sum(part.faces[index].area for index in faces)


def test_annuli_are_faces_of_their_own_and_the_rest_stays(file):
    """By hand: pi/4 (18² - 8²) mm² on top; the underside, chosen whole, loses its own washer alone."""
    part = read_step(
        file,
        interfaces={
            "under": [FaceSelector(kind="plane", normal=DOWN)],
            "left": [FaceSelector(washer=0.018, normal=UP, radius=0.004)],
            "right": [FaceSelector(washer=0.02, position=(0.015, 0, 0.005))],
            "below": [FaceSelector(washer=0.016, normal=DOWN, position="max x")],
            "end": [FaceSelector(washer=0.006, normal=(1, 0, 0))],
        },
    )
    under = part.clamped
    (left, right, below, end) = part.loaded
    ring = {"left": (18, 8), "right": (20, 10), "below": (16, 10), "end": (6, 4)}
    for one in (left, right, below, end):
        outer, inner = ring[one.name]
        assert areas(part, one.faces) == pytest.approx(
            np.pi / 4 * (outer**2 - inner**2) * 1e-6, rel=1e-9
        )
        assert {part.faces[index].kind for index in one.faces} == {"plane"}
    assert left.reference_point == pytest.approx([-0.015, 0, 0.005], abs=1e-9)
    assert below.reference_point == pytest.approx([0.015, 0, -0.005], abs=1e-9)
    whole = 80 * 60 - np.pi * (4**2 + 5**2) - np.pi / 4 * (16**2 - 10**2)
    assert areas(part, under) == pytest.approx(whole * 1e-6, rel=1e-9)


def test_one_selector_takes_all_holes_and_the_faces_numbers_are_those_listed(file):
    sound = part_of(drilled())
    part = read_step(
        file,
        clamped=[FaceSelector(index=sorted(sound.clamped))],
        loaded=[FaceSelector(washer=0.018, normal=UP)],
    )
    (loaded,) = part.loaded
    assert len(loaded.faces) == 2
    assert areas(part, part.clamped) == pytest.approx(600e-6)
    assert areas(part, loaded.faces) == pytest.approx(
        np.pi / 4 * (2 * 18**2 - 8**2 - 10**2) * 1e-6, rel=1e-9
    )


@pytest.mark.extended
@pytest.mark.parametrize(
    ("selector", "message"),
    [
        (
            {"washer": 0.018, "radius": 0.006},
            "no round hole of a plane face has radius = 6 mm, washer = 18 mm; there are radii 2 mm, 4 mm, 5 mm",
        ),
        (
            {"washer": 0.008, "radius": 0.004},
            "plate.loaded: expected a washer wider than its hole of 8 mm, got 8 mm",
        ),
        (
            {"washer": 0.062, "radius": 0.004},
            r"expected washers within their face and apart, got one of 62 mm at \(-15, ",
        ),
        (
            {"washer": 0.032, "normal": UP},
            r"expected washers within their face and apart, got one of 32 mm at \(15, ",
        ),
        ({"washer": -0.01}, "selector.washer: expected a positive length, got -0.01"),
    ],
)
def test_washers_that_do_not_fit_are_refused(file, selector, message):
    with pytest.raises(InputError, match=message):
        read_step(file, loaded=[FaceSelector(**selector)])
