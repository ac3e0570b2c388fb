"""Sheets and needles: filled exactly, every triangle on its face, and as stiff as a cantilever is."""

import time

import numpy as np
import pytest
from build123d import Axis, Box, Cylinder, Pos, Rot, fillet

from stiffscope.cad.solid import part_of
from stiffscope.fea.extrusion import mesh_extrusion
from stiffscope.fea.mesh import MeshError, default_size, expected_elements, tet_volumes
from stiffscope.fea.run import run_experiment, specimen_of
from stiffscope.fea.settings import Settings
from stiffscope.fea.specimen import mesh_specimen, shape_error

pytestmark = pytest.mark.slow


def whole(solid):
    return specimen_of(part_of(solid), Settings())


def filled(specimen):
    return mesh_extrusion(
        specimen.surface, specimen.extrusion, specimen.held_faces, specimen.project
    )


@pytest.mark.parametrize(
    "solid",
    [
        Box(100, 50, 0.5),
        Box(100, 50, 0.5) - Pos(20, 5, 0) * Cylinder(6, 1),
        Box(1000, 2, 2),
    ],
)
def test_a_sheet_or_needle_is_filled(solid):
    specimen = whole(solid)
    surface = specimen.surface
    mesh = filled(specimen)
    volumes = tet_volumes(mesh.points, mesh.cells)
    assert (volumes > 0).all()
    corners = surface.vertices[
        surface.triangles
    ]  # divergence theorem: another way to the volume of the same polyhedron
    enclosed = (
        np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6
    )
    assert volumes.sum() == pytest.approx(enclosed, rel=1e-6)
    assert set(mesh.tags) == set(range(len(surface.faces)))
    small = default_size(specimen.volume, sum(face.area for face in surface.faces))
    assert len(mesh.cells) < max(12_000, 8.5 * specimen.volume / small**3)


def test_other_solids_are_for_the_general_mesher():
    assert whole(Box(100, 50, 10)).extrusion is None


def tube(radius, wall, length):
    return Rot(0, 90, 0) * (
        Cylinder(radius, length) - Cylinder(radius - wall, length + 2)
    )


@pytest.mark.parametrize(("radius", "wall"), [(12.5, 1), (12.5, 0.5), (100, 0.5)])
def test_a_thin_walled_tube_is_filled_with_long_flat_elements(radius, wall):
    specimen = whole(tube(radius, wall, 500))
    mesh = filled(specimen)
    volumes = tet_volumes(mesh.points, mesh.cells)
    assert (volumes > 0).all()
    assert volumes.sum() == pytest.approx(
        np.pi * (radius**2 - (radius - wall) ** 2) * 500e-9, rel=0.03
    )
    assert set(mesh.tags) == set(range(len(specimen.surface.faces)))
    assert len(mesh.cells) < 10_000


def eccentric(radius, bore, offset, length):
    return Rot(0, 90, 0) * (
        Cylinder(radius, length) - Pos(offset, 0, 0) * Cylinder(bore, length + 2)
    )


def test_a_wall_that_is_thinner_on_one_side_is_followed_there_too():
    specimen = whole(eccentric(12.5, 11.5, 0.7, 250))
    assert shape_error(specimen, mesh_specimen(specimen)) < 1e-3


def test_a_tube_with_too_many_elements_is_refused_before_they_are_made():
    begun = time.perf_counter()
    specimen = whole(tube(30, 0.5, 300))
    with pytest.raises(
        MeshError, match=r"^mesh\.time_limit: expected a part that is done in time"
    ):
        mesh_specimen(specimen, size=1e-3)
    assert time.perf_counter() - begun < 30  # some seconds; minutes where all are made


@pytest.mark.long
def test_a_thin_walled_tube_is_as_stiff_as_theory_says():
    """Within the bound and what both rigid ends add: no contraction over the length in which end effects decay."""
    part = part_of(tube(12.5, 1, 250))
    (radius, inner, length) = (0.0125, 0.0115, 0.25)
    found = run_experiment(part, Settings(), whole=False)
    modulus = part.material.youngs_modulus
    shear = part.material.elasticity()[3, 3]
    area = np.pi * (radius**2 - inner**2)
    second = np.pi / 4 * (radius**4 - inner**4)
    theory = {
        0: length / modulus / area,
        3: length / shear / 2 / second,
        4: length / modulus / second,
    }
    held = 2 * 0.3**2 * np.sqrt(radius * 0.001) / length
    for index, value in theory.items():
        assert (
            abs(found.compliance[index, index] / value - 1)
            < found.error[index, index] / value + held
        )
    assert found.relative_bound < 0.005


@pytest.mark.long
def test_a_tube_with_an_eccentric_bore_is_as_stiff_as_theory_says():
    radius = 0.0125
    bore = 0.011
    offset = 0.001
    length = 0.25
    part = part_of(eccentric(12.5, 11, 1, 250))
    found = run_experiment(part, Settings(), whole=False)
    modulus = part.material.youngs_modulus
    outer = np.pi * radius**2
    inner = np.pi * bore**2
    centre = -inner * offset / (outer - inner)
    across = (outer * radius**2 - inner * bore**2) / 4
    along = across + outer * centre**2 - inner * (offset - centre) ** 2
    theory = {
        0: length / modulus / (outer - inner),
        4: length / modulus / along,
        5: length / modulus / across,
    }
    for index, value in theory.items():
        assert (
            abs(found.compliance[index, index] / value - 1)
            < found.error[index, index] / value + 0.003
        )  # rigid ends
    assert found.relative_bound < 0.005


def test_thin_plane_walls_get_larger_elements_and_no_others():
    sheet = whole(Box(60, 20, 0.2) + Pos(-29.9, 0, 10) * Box(0.2, 20, 20))
    tube = whole(Rot(0, 90, 0) * (Cylinder(10, 80) - Cylinder(9.8, 80)))
    assert sheet.flatness == 2
    assert tube.flatness == 1
    assert whole(Box(60, 20, 5)).flatness == 1


def test_rounds_that_the_mesher_leaves_out_are_not_expected_to_cost_elements():
    plain = Box(200, 100, 50)
    rounded = [
        fillet(plain.edges().filter_by(Axis.X), radius) for radius in (0.05, 0.1)
    ]
    expected = [
        expected_elements(
            specimen.surface,
            specimen.volume,
            default_size(specimen.volume, specimen.area),
        )
        for specimen in map(whole, (plain, *rounded))
    ]
    assert max(expected) < 10 * expected[0]


def test_a_strip_bends_as_beam_theory_says():
    length = 0.06
    width = 0.0015
    thickness = 0.0003
    modulus = 211e9
    found = run_experiment(part_of(Box(60, 1.5, 0.3)), Settings())
    expected = length**3 / (3 * modulus * width * thickness**3 / 12)
    material = part_of(Box(60, 1.5, 0.3)).material
    expected *= modulus / material.youngs_modulus
    assert found.compliance[2, 2] == pytest.approx(expected, rel=0.01)
    assert found.error[2, 2] < 0.01 * found.compliance[2, 2]


@pytest.mark.long
def test_a_bent_sheet_gets_flat_elements_and_bounds_that_hold():
    solid = Box(60, 20, 0.2) + Pos(-29.9, 0, 10) * Box(0.2, 20, 20)
    usual, coarse = (
        run_experiment(part_of(solid), Settings(size=size)) for size in (None, 3e-3)
    )
    apart = np.abs(usual.compliance - coarse.compliance).diagonal()
    bound = (usual.error + coarse.error).diagonal()
    assert (apart <= bound).all()
    assert len(usual.mesh.cells) < 20_000
    assert usual.relative_bound < 0.01


def test_what_would_take_far_longer_than_its_limit_is_refused_before_it_is_meshed():
    plate = Box(100, 60, 20) - [
        Pos(-40 + 80 * i / 11, -22 + 44 * j / 5, 0) * Cylinder(1.5, 40)
        for i in range(12)
        for j in range(6)
    ]
    begun = time.process_time()
    with pytest.raises(
        MeshError,
        match=r"mesh\.time_limit: expected .* tetrahedra.* s are left; remove small holes",
    ):
        run_experiment(part_of(plate), Settings(time_limit=120))
    assert time.process_time() - begun < 20  # most of it the CAD kernel's
