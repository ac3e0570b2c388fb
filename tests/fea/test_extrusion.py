"""Sheets and needles: filled exactly, every triangle on its face, and as stiff as a cantilever is."""

import numpy as np
import pytest
from build123d import Box, Cylinder, Pos

from stiffscope.cad.solid import part_of
from stiffscope.fea.experiment import run_experiment, specimen_of
from stiffscope.fea.extrusion import flat_mesh
from stiffscope.fea.mesh import default_size, tet_volumes
from stiffscope.fea.settings import Settings


def surface_of(solid):
    specimen = specimen_of(part_of(solid), Settings())
    return specimen.surface, frozenset[int]().union(*specimen.interfaces), specimen


@pytest.mark.parametrize(
    "solid", [Box(100, 50, 0.5), Box(100, 50, 0.5) - Pos(20, 5, 0) * Cylinder(6, 1), Box(1000, 2, 2)]
)
def test_a_sheet_or_needle_is_filled(solid):
    surface, interfaces, specimen = surface_of(solid)
    mesh = flat_mesh(surface, interfaces)
    volumes = tet_volumes(mesh.points, mesh.cells)
    assert (volumes > 0).all()
    corners = surface.vertices[
        surface.triangles
    ]  # divergence theorem: another way to the volume of the same polyhedron
    enclosed = np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6
    assert volumes.sum() == pytest.approx(enclosed, rel=1e-6)
    assert set(mesh.tags) == set(range(len(surface.faces)))
    small = default_size(specimen.volume, sum(face.area for face in surface.faces))
    assert len(mesh.cells) < max(12_000, 8.5 * specimen.volume / small**3)


def test_other_solids_are_for_the_general_mesher():
    surface, interfaces, _ = surface_of(Box(100, 50, 10))
    assert flat_mesh(surface, interfaces) is None


def test_a_strip_bends_as_beam_theory_says():
    length, width, thickness, modulus = 0.06, 0.0015, 0.0003, 211e9
    found = run_experiment(part_of(Box(60, 1.5, 0.3)), Settings())
    expected = length**3 / (3 * modulus * width * thickness**3 / 12)
    material = part_of(Box(60, 1.5, 0.3)).material
    expected *= modulus / material.youngs_modulus
    assert found.compliance[2, 2] == pytest.approx(expected, rel=0.01)
    assert found.error[2, 2] < 0.01 * found.compliance[2, 2]
