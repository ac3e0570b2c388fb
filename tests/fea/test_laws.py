"""Laws that hold whatever the part: scaling of lengths and moduli, turned axes, a shifted reference point."""

from dataclasses import replace

import numpy as np
import pytest
from build123d import Box

from stiffscope.cad.materials import Material
from stiffscope.cad.solid import part_of
from stiffscope.fea.mesh import TetMesh
from stiffscope.fea.rigid import rigid_modes
from stiffscope.fea.run import run_experiment
from stiffscope.fea.settings import Settings
from stiffscope.fea.solution import solve_specimen
from stiffscope.fea.specimen import face_areas
from tests.fea.shapes import STEEL

pytestmark = pytest.mark.slow


def respond(specimen, mesh, kind="rigid"):
    """Flexibility of a mesh, its own volume and areas taken for the solid's."""
    return solve_specimen(specimen, mesh, kind, "direct").compliance


@pytest.fixture(scope="module")
def plain(stub):
    """The compliance of the stub by the kind of its interface, each solved once."""
    return {kind: respond(*stub, kind) for kind in ("rigid", "distributed")}


def close(ours, expected):
    scale = np.sqrt(np.outer(expected.diagonal(), expected.diagonal()))
    assert (
        np.abs(ours - expected) <= 2e-5 * scale
    ).all()  # conjugate gradients stop at 1 % of a gain of 0.1 %


def scaled(specimen, mesh, factor):
    faces = tuple(
        type(face)(
            **(
                vars(face)
                | {"area": face.area * factor**2, "origin": face.origin * factor}
            )
        )
        for face in specimen.surface.faces
    )
    surface = type(specimen.surface)(**(vars(specimen.surface) | {"faces": faces}))
    loaded = tuple((chosen, point * factor) for chosen, point in specimen.loaded)
    bigger = replace(
        specimen, surface=surface, loaded=loaded, volume=specimen.volume * factor**3
    )
    return bigger, replace(mesh, points=mesh.points * factor)


KINDS = (
    pytest.param("rigid", marks=pytest.mark.long),
    "distributed",
)  # whose constraints depend on the place too


@pytest.mark.extended
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("factor", [3.7])
def test_lengths_scale_stretch_by_one_and_rotations_by_three_powers(
    stub, plain, kind, factor
):
    s = np.array([1.0] * 3 + [factor] * 3)
    expected = plain[kind] / np.outer(s, s) / factor
    assert np.allclose(
        respond(*scaled(*stub, factor), kind),
        expected,
        rtol=1e-6,
        atol=1e-8 * expected.max(),
    )


@pytest.mark.extended_for("2.5")
@pytest.mark.parametrize("factor", [2.5])
def test_moduli_scale_everything_inversely(stub, plain, factor):
    specimen, mesh = stub
    softer = replace(specimen, elasticity=specimen.elasticity * factor)
    assert np.allclose(respond(softer, mesh) * factor, plain["rigid"], rtol=1e-8)


@pytest.mark.extended
def test_turned_axes_turn_the_compliance(stub, plain, rng):
    specimen, mesh = stub
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    turn *= np.linalg.det(turn)
    loaded = tuple((chosen, turn @ point) for chosen, point in specimen.loaded)
    turned = TetMesh(mesh.points @ turn.T, mesh.cells, mesh.facets, mesh.facet_face)
    both = np.kron(np.eye(2), turn)
    expected = both @ plain["rigid"] @ both.T
    close(respond(replace(specimen, loaded=loaded), turned), expected)


@pytest.mark.parametrize("kind", KINDS)
def test_a_shifted_reference_point_carries_twist_and_wrench(stub, plain, kind, rng):
    """v at p + d is v + ω x d: C' = T C Tᵀ."""
    specimen, mesh = stub
    shift = rng.normal(scale=0.05, size=3)
    moved = replace(
        specimen,
        loaded=tuple((chosen, point + shift) for chosen, point in specimen.loaded),
    )
    carry = np.eye(6)
    carry[:3] = rigid_modes(shift[None], np.zeros(3))[0]
    close(respond(moved, mesh, kind), carry @ plain[kind] @ carry.T)


def test_areas_are_the_cads(stub):
    specimen, mesh = stub
    wanted = [face.area for face in specimen.surface.faces]
    assert face_areas(mesh, 3) == pytest.approx(wanted, rel=2e-3)
    assert specimen.elasticity == pytest.approx(STEEL)


# Axial compliance of a block 10 x 40 x 40 mm between rigid faces, E = 211 GPa, by 27-node hexahedra (6 x 6 x 6 on a
# quarter, graded to the edges, two-point integration of the change of volume), and how far that is from its limit, 1/N.
BONDED = {
    0.3: (2.4236e-11, 1e-14),
    0.45: (1.458e-11, 3e-14),
    0.499: (8.99e-12, 3e-14),
    0.4999: (8.87e-12, 4e-14),
}


@pytest.mark.parametrize(
    "poisson",
    [0.45, *(pytest.param(p, marks=pytest.mark.long) for p in (0.3, 0.499, 0.4999))],
)
def test_a_nearly_incompressible_block_is_within_its_bound(poisson):
    steel = Material("rubberlike", 211e9, 211e9 / 2 / (1 + poisson), 7850.0)
    found = run_experiment(
        part_of(Box(10, 40, 40), material=steel), Settings(), whole=False
    )
    expected, unsure = BONDED[poisson]
    assert abs(found.compliance[0, 0] - expected) <= found.error[0, 0] + unsure
    assert found.error[0, 0] < 0.05 * expected
