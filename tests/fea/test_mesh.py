from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from stiffscope.cad import slider
from stiffscope.cad.solid import build
from stiffscope.fea.geometry import centroid, jacobian_range, volume
from stiffscope.fea.mesh import (
    MeshError,
    boundary_facets,
    check_time,
    expected_elements,
    tetrahedralize,
)
from stiffscope.fea.refine import bisect, grade
from stiffscope.fea.run import run_experiment, specimen_of
from stiffscope.fea.settings import Settings
from stiffscope.fea.singular import fixed_exponent, free_exponent, singular_edges
from stiffscope.fea.specimen import (
    _best_mesh,
    face_areas,
    interface_error,
    mesh_specimen,
)
from tests.fea.shapes import box
from tests.validation import parts

pytestmark = pytest.mark.slow


def changed(surface, **changes):
    return SimpleNamespace(**{**vars(surface), **changes})


def test_curved_mesh_has_the_volume_and_the_areas_of_the_solid(stub):
    specimen, mesh = stub
    assert volume(mesh.points, mesh.cells) == pytest.approx(specimen.volume, rel=2e-5)
    areas = [face.area for face in specimen.surface.faces]
    assert face_areas(mesh, 3) == pytest.approx(areas, rel=3e-4)
    assert jacobian_range(mesh.points[mesh.cells]).min() > 0.002
    assert mesh.pulled_back == 0


def test_corner_nodes_are_on_the_cylinder(stub):
    _, mesh = stub
    corners = mesh.points[np.unique(mesh.facets_of(frozenset({2}))[:, :3])]
    assert np.hypot(corners[:, 1], corners[:, 2]) == pytest.approx(0.0125, abs=1e-10)


def test_grading_keeps_the_shape_and_conforms(stub):
    _, mesh = stub
    edges, _ = singular_edges(mesh, [frozenset({0}), frozenset({1})])
    graded = grade(mesh, edges, layers=2, ratio=0.25)
    assert len(graded.cells) > 1.2 * len(mesh.cells)
    assert volume(graded.points, graded.cells) == pytest.approx(
        volume(mesh.points, mesh.cells), rel=1e-12
    )
    assert face_areas(graded, 3) == pytest.approx(face_areas(mesh, 3), rel=1e-6)
    assert len(boundary_facets(graded.cells[:, :4])[0]) == len(graded.facets)
    assert jacobian_range(graded.points[graded.cells]).min() > 0.002
    assert len(np.unique(np.round(graded.points, 12), axis=0)) == len(graded.points)


def test_bisecting_random_edges_conforms(stub, rng):
    _, mesh = stub
    edges = np.unique(np.sort(mesh.cells[:, [0, 3]], axis=1), axis=0)
    some = edges[rng.random(len(edges)) < 0.3]
    cut = bisect(mesh, some, rng.uniform(0.3, 0.7, len(some)))
    assert volume(cut.points, cut.cells) == pytest.approx(
        volume(mesh.points, mesh.cells), rel=1e-12
    )
    assert len(boundary_facets(cut.cells[:, :4])[0]) == len(cut.facets)


def test_singular_edges_are_held_borders_and_re_entrant_ones(stub):
    _, mesh = stub
    assert len(singular_edges(mesh, [])[0]) == 0
    edges, exponents = singular_edges(mesh, [frozenset({0})])
    assert mesh.points[edges, 0] == pytest.approx(0, abs=1e-12)
    assert np.hypot(*mesh.points[np.unique(edges), 1:].T) == pytest.approx(
        0.0125, abs=1e-10
    )
    at_right_angle = fixed_exponent(np.array([np.pi / 2])).item()
    assert np.median(exponents) == pytest.approx(at_right_angle, abs=0.03)
    assert exponents == pytest.approx(
        at_right_angle, abs=0.12
    )  # flat triangles lean by up to 15 degrees


def test_exponents_are_williamss():
    assert free_exponent(np.radians([180, 270, 360])) == pytest.approx(
        [1, 0.5445, 0.5], abs=1e-4
    )
    assert fixed_exponent(np.radians([45, 90, 180, 360])) == pytest.approx(
        [1, 0.7112, 0.5, 0.25], abs=1e-4
    )
    angles = np.radians(np.arange(60, 142))
    kappa = 1.8
    power = fixed_exponent(angles)
    right = (kappa + 1) ** 2 / 4 - (power * np.sin(angles)) ** 2
    assert kappa * np.sin(power * angles) ** 2 == pytest.approx(right, abs=1e-6)
    assert (np.diff(fixed_exponent(np.radians(np.arange(150, 361)))) < 0).all()


@pytest.mark.extended
def test_a_traction_is_singular_where_it_ends_in_a_plane_only():
    part = parts.strip()
    mesh = mesh_specimen(
        specimen_of(part, Settings(interface="distributed")), rigid=False
    )
    edges, exponents = singular_edges(mesh, [part.clamped], [part.loaded[0].faces])
    at_end = mesh.points[edges, 0].min(axis=1) > 0.03
    assert np.abs(mesh.points[edges[at_end], 1]) == pytest.approx(0.015, abs=1e-9)
    assert (exponents[at_end] == 1).all()
    assert exponents[~at_end] == pytest.approx(0.7112, abs=1e-4)


def test_an_interface_out_of_place_or_lost_is_an_error(stub):
    specimen, mesh = stub
    area, shift = interface_error(specimen, mesh)
    assert area < 1e-4
    assert shift < 1e-4
    moved = replace(mesh, points=mesh.points + np.array([0, 1e-3, 0]))
    assert interface_error(specimen, moved)[1] == pytest.approx(
        1e-3 / np.sqrt(np.pi * 0.0125**2), rel=1e-3
    )
    lost = replace(mesh, facet_face=np.where(mesh.facet_face == 1, 2, mesh.facet_face))
    assert interface_error(specimen, lost) == (np.inf, np.inf)


def test_a_mesh_without_an_interface_is_made_again_however_late(stub, monkeypatch):
    specimen, mesh = stub
    lost = replace(mesh, facet_face=np.where(mesh.facet_face == 1, 2, mesh.facet_face))
    meshes = [lost, mesh]
    monkeypatch.setattr(
        "stiffscope.fea.specimen.tetrahedralize", lambda **_: (mesh.points, mesh.cells)
    )
    monkeypatch.setattr("stiffscope.fea.specimen.snap", lambda *_: meshes.pop(0))
    found = _best_mesh(
        specimen=specimen,
        size=0.01,
        envelope=1e-4,
        time_limit=60.0,
        threads=1,
        patience=0.0,
    )
    assert found is mesh


@pytest.mark.extended
@pytest.mark.parametrize(
    ("patch", "area"), [(parts.strip, 0.03 * 0.02), (parts.disc, np.pi * 0.008**2)]
)
def test_a_patch_imprinted_on_a_plane_ends_at_its_border(patch, area):
    part = patch()
    ((loaded,),) = (interface.faces for interface in part.loaded)
    mesh = mesh_specimen(specimen_of(part, Settings()))
    assert face_areas(mesh, len(part.faces))[loaded] == pytest.approx(area, rel=3e-5)
    assert centroid(mesh.points[mesh.facets_of(frozenset({loaded}))]) == pytest.approx(
        [0.06, 0, 0], abs=1e-6
    )


def test_surfaces_that_cannot_be_filled_are_refused():
    surface = box(0.1, 0.1, 0.1).surface
    with pytest.raises(MeshError, match="not closed"):
        tetrahedralize(changed(surface, triangles=surface.triangles[1:]), 0.03, 1e-4)
    with pytest.raises(MeshError, match="inward"):
        tetrahedralize(
            changed(surface, triangles=surface.triangles[:, ::-1]), 0.03, 1e-4
        )
    with pytest.raises(MeshError, match="finite"):
        tetrahedralize(changed(surface, vertices=surface.vertices * np.nan), 0.03, 1e-4)
    with pytest.raises(MeshError, match="do not exist"):
        tetrahedralize(changed(surface, triangles=surface.triangles + 1), 0.03, 1e-4)
    with pytest.raises(MeshError, match="positive"):
        tetrahedralize(surface, 0.03, -1e-4)


def test_a_mesher_that_takes_too_long_is_killed():
    with pytest.raises(MeshError, match=r"within 0.2 s"):
        tetrahedralize(box(0.085, 0.32, 0.02).surface, 0.0005, 1e-5, time_limit=0.2)


@pytest.mark.parametrize(
    ("lengths", "said"),
    [
        ({"size": 1e-4}, "size"),
        ({"size": 1.0}, "size"),
        ({"envelope": 0.1}, "envelope"),
    ],
)
def test_lengths_that_are_no_meshs_are_refused_at_once(lengths, said):
    with pytest.raises(
        MeshError,
        match=rf"slider.mesh.{said}: expected .* mm to .* mm for this part, got ",
    ):
        run_experiment(
            build(slider.SliderParameters(), name="slider"), Settings(**lengths)
        )


@pytest.mark.long
def test_a_pad_lower_than_the_first_envelope_keeps_its_area():
    part = build(slider.SliderParameters(pad_height=2e-4))
    mesh = run_experiment(part).mesh
    loaded = sorted(part.loaded[0].faces)
    assert face_areas(mesh, len(part.faces))[loaded] == pytest.approx(
        [part.faces[k].area for k in loaded], rel=1e-3
    )


def test_the_number_of_tetrahedra_and_their_time_are_estimated(caplog):
    """A slider of 28,000 takes 38 s of a processor to solve: neither refused nor doubted within 80 s."""
    specimen = specimen_of(build(slider.SliderParameters()), Settings())
    made = len(mesh_specimen(specimen, size=0.012).cells)
    assert (
        0.6 < expected_elements(specimen.surface, specimen.volume, 0.012) / made < 1.7
    )
    check_time(28_000, 80.0, "", meshed=True)
    assert not caplog.messages
