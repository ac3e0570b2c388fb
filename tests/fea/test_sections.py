"""Sections of beams: closed forms against Saint-Venant's warping function, and solids against the beams."""

import numpy as np
import pytest
from skfem import Basis, BilinearForm, ElementQuad2, LinearForm, MeshQuad, solve
from skfem.helpers import dot, grad

from stiffscope.cad.cross_sections import box, channel, circle, i_section
from stiffscope.cad.materials import STEEL
from stiffscope.cad.part import mass_properties
from stiffscope.cad.shapes import SHAPES
from stiffscope.cad.solid import build
from stiffscope.errors import InputError
from stiffscope.fea.beam import restrained_torsion, timoshenko
from stiffscope.fea.run import run_experiment
from stiffscope.fea.settings import Settings

pytestmark = pytest.mark.slow

E = STEEL.youngs_modulus
G = STEEL.shear_modulus
LENGTH = 0.3
TUBE = {"radius": 0.02, "wall": 0.004}
BOX = {"width": 0.04, "height": 0.06, "wall": 0.004}
FLANGED = {"width": 0.04, "height": 0.06, "flange": 0.006, "web": 0.005}
SECTIONS = {
    "tube": (TUBE, lambda radius, wall: circle(radius, radius - wall, STEEL.poisson)),
    "box": (BOX, lambda **size: box(**size, poisson=STEEL.poisson)),
    "i": (FLANGED, lambda **size: i_section(**size, poisson=STEEL.poisson)),
    "channel": (FLANGED, channel),
}


def quads(outline):
    """Rectangular elements, six through every wall, inside the borders of a section with upright sides."""
    corners = np.array([point for loop in outline for point in loop])
    axes = []
    for values in (np.unique(corners[:, axis].round(12)) for axis in range(2)):
        count = np.clip(
            np.ceil(4 * np.diff(values) / np.diff(values).min()), 6, 30
        ).astype(int)
        ends = zip(values[:-1], values[1:], count, strict=True)
        axes.append(
            np.unique(
                np.concatenate([np.linspace(a, b, n + 1) for a, b, n in ends]).round(12)
            )
        )
    mesh = MeshQuad.init_tensor(*axes)
    y, z = mesh.p[:, mesh.t].mean(axis=1)
    inside = np.zeros(len(y), dtype=bool)
    for loop in outline:
        for (ya, za), (yb, zb) in zip(loop, loop[1:] + loop[:1], strict=True):
            inside ^= ((za > z) != (zb > z)) & (y < (ya if ya == yb else np.inf))
    return mesh.restrict(np.flatnonzero(inside))


def integrals(outline):
    """Area, I_y, I_z, torsion constant, the shear centre's y and the warping constant, by finite elements."""
    basis = Basis(quads(outline), ElementQuad2())
    stiffness = BilinearForm(lambda u, v, _: dot(grad(u), grad(v))).assemble(basis)
    load = LinearForm(lambda v, w: w.x[1] * grad(v)[0] - w.x[0] * grad(v)[1]).assemble(
        basis
    )
    warping = np.zeros(basis.N)
    warping[1:] = solve(stiffness[1:, 1:], load[1:])

    field = np.asarray(basis.interpolate(warping))
    (y, z) = np.asarray(basis.global_coordinates())

    def total(values):
        return float((values * basis.dx).sum())

    area = total(np.ones_like(y))
    second = total(z**2)
    field -= total(field) / area
    centre = -total(field * z) / second
    torsion = total(y**2 + z**2) - load @ warping
    return (
        area,
        second,
        total(y**2),
        torsion,
        centre,
        total(field**2) - centre**2 * second,
    )


@pytest.mark.parametrize("shape", ["box", "i", "channel"])
def test_closed_forms_are_those_of_the_warping_function(shape):
    size, form = SECTIONS[shape]
    section = form(**size)
    area, about_y, about_z, torsion, centre, warping = integrals(
        SHAPES[shape](LENGTH, **size).outline()
    )
    assert section.area == pytest.approx(area, rel=1e-9)
    assert (section.bending_y, section.bending_z) == pytest.approx(
        (about_y, about_z), rel=1e-9
    )
    assert section.torsion == pytest.approx(torsion, rel=0.012)
    assert section.shear_centre == pytest.approx(centre, abs=6e-4)
    assert shape == "box" or section.warping == pytest.approx(warping, rel=0.05)


@pytest.mark.long
@pytest.mark.parametrize("shape", list(SECTIONS))
def test_a_solid_beam_is_as_stiff_as_the_closed_forms_say(shape):
    size, form = SECTIONS[shape]
    section = form(**size)
    part = build(SHAPES[shape](LENGTH, **size))
    assert mass_properties(part).volume == pytest.approx(
        LENGTH * section.area, rel=1e-9
    )
    found = run_experiment(part, Settings(), whole=False)
    beam = timoshenko(LENGTH, section, E, G)
    twist = restrained_torsion(LENGTH, section, E, G)
    scale = np.sqrt(np.outer(beam.diagonal(), beam.diagonal()))
    beam += (twist - LENGTH / (G * section.torsion)) * np.outer(
        *[[0, 0, section.shear_centre, -1, 0, 0]] * 2
    )
    off = np.abs(found.compliance - beam) / scale
    assert off.max() < 0.03, (shape, off.round(4))


def test_impossible_sections_are_refused():
    for wrong in (
        lambda: box(0.04, 0.06, 0.02),
        lambda: i_section(0.04, 0.06, 0.03, 0.005),
    ):
        with pytest.raises(InputError, match="section: expected walls thinner than"):
            wrong()
    with pytest.raises(
        InputError,
        match=r"channel\.web: expected up to 39.5 mm in this section, got 50 mm",
    ):
        SHAPES["channel"](LENGTH, 0.04, 0.06, 0.006, 0.05)
