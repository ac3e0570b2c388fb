"""Link and slider: closed forms, axes, held and loaded faces, and what is refused."""

import dataclasses
import math

import numpy as np
import pytest
from build123d import Box

from stiffscope.cad.link import LinkParameters
from stiffscope.cad.materials import (
    CFRP_TUBE,
    MATERIALS,
    Material,
    TransverselyIsotropic,
    material,
)
from stiffscope.cad.part import Part, mass_properties, project, surface
from stiffscope.cad.slider import SliderParameters
from stiffscope.cad.solid import build
from stiffscope.errors import InputError

pytestmark = pytest.mark.slow

FULL = SliderParameters(
    rib_count=3,
    fillet=0.004,
    hole_count=4,
    hole_pitch=0.05,
    pad_height=0.005,
    pads="apart",
)
RIB = (
    0.010 * 0.015 * 0.070 + math.pi / 2 * 0.005**2 * 0.015
)  # a bar with a half-round nose
VOLUMES = {
    LinkParameters(): math.pi * 0.0125**2 * 0.5,
    LinkParameters(bore=0.01, fitting_radius=0.02, fitting_length=0.03): math.pi
    * (0.0125**2 * 0.44 + 0.02**2 * 0.06 - 0.005**2 * 0.5),
    SliderParameters(): 0.085 * 0.32 * 0.02,
    SliderParameters(
        rib_count=3, hole_count=4, hole_pitch=0.05, pad_height=0.005
    ): 0.085 * 0.32 * 0.02
    + 3 * RIB
    - 4 * math.pi * 0.0045**2 * 0.02
    + 3 * 0.005 * 0.03 * 0.02,
}


def made(parameters: LinkParameters | SliderParameters) -> Part:
    return build(parameters)


@pytest.mark.parametrize("parameters", VOLUMES)
def test_volume_has_its_closed_form(
    parameters: LinkParameters | SliderParameters,
) -> None:
    assert mass_properties(made(parameters)).volume == pytest.approx(
        VOLUMES[parameters], rel=1e-9
    )


def test_each_face_edge_and_vertex_counts_once() -> None:
    from stiffscope.cad import kernel

    solid = Box(1, 2, 3).wrapped
    assert [
        len(items(solid)) for items in (kernel.faces, kernel.edges, kernel.vertices)
    ] == [6, 12, 8]


def test_link_has_the_inertia_of_a_rod_and_its_axes() -> None:
    part = build(LinkParameters())
    mass = 7850 * math.pi * 0.0125**2 * 0.5
    across = 0.0125**2 / 4 + 0.5**2 / 12
    properties = mass_properties(part)
    assert properties.mass == pytest.approx(mass)
    assert properties.centre == pytest.approx([0.25, 0, 0], abs=1e-12)
    assert properties.inertia == pytest.approx(
        mass * np.diag([0.0125**2 / 2, across, across]), abs=1e-12
    )
    held = part.faces[min(part.clamped)]
    (loaded,) = part.loaded
    assert held.axis == pytest.approx([-1, 0, 0])
    assert held.centroid == pytest.approx([0, 0, 0], abs=1e-12)
    assert part.faces[min(loaded.faces)].axis == pytest.approx([1, 0, 0])
    assert loaded.reference_point == pytest.approx([0.5, 0, 0])


def test_slider_is_even_about_y_and_loads_each_pad() -> None:
    part = build(FULL)
    assert mass_properties(part).centre[1] == pytest.approx(0, abs=1e-12)
    assert [one.name for one in part.loaded] == ["link1", "link2", "link3"]
    for one, y in zip(part.loaded, (0, 0.07, -0.07), strict=True):
        (face,) = one.faces
        assert part.faces[face].centroid == pytest.approx(
            one.reference_point, abs=1e-12
        )
        assert one.reference_point == pytest.approx([0.09, y, 0], abs=1e-12)
    assert max(face.centroid[2] for face in part.faces) == pytest.approx(
        0.025
    )  # ribs hang below, z down


def test_slider_can_be_held_in_its_bolt_holes() -> None:
    part = build(
        SliderParameters(hole_count=4, clamp="holes", rib_count=1, rib_thickness=0.009)
    )
    assert len(part.clamped) == 4
    assert {part.faces[i].kind for i in part.clamped} == {"cylinder"}
    assert [part.faces[i].radius for i in part.clamped] == pytest.approx([0.0045] * 4)


@pytest.mark.parametrize(
    "parameters", [LinkParameters(bore=0.005), SliderParameters(), FULL]
)
def test_surface_is_closed_outward_and_on_the_solid(
    parameters: LinkParameters | SliderParameters,
) -> None:
    part = made(parameters)
    skin = surface(part)
    corners = skin.vertices[skin.triangles]
    volume = (
        np.einsum("ij,ij", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6
    )
    assert volume == pytest.approx(mass_properties(part).volume, rel=0.1)
    assert set(skin.face_of_triangle) == set(range(len(part.faces)))
    for face in part.faces:
        nodes = skin.vertices[
            np.unique(skin.triangles[skin.face_of_triangle == face.index])
        ]
        assert project(part, face.index, nodes) == pytest.approx(nodes, abs=1e-12)


def test_projection_in_closed_form_is_the_kernels() -> None:
    from stiffscope.cad import kernel

    part = build(FULL)
    rng = np.random.default_rng(1)
    for face in part.faces:
        if face.kind == "plane":
            continue
        near = face.centroid + rng.normal(scale=1e-4, size=(5, 3))
        exact = (
            kernel.closest_under(kernel.faces(part.solid)[face.index], near * 1e3)
            * 1e-3
        )
        inside = np.linalg.norm(project(part, face.index, near) - near, axis=1)
        assert (inside <= np.linalg.norm(exact - near, axis=1) + 1e-9).all()
        again = project(part, face.index, exact)
        assert again == pytest.approx(exact, abs=1e-9)


@pytest.mark.parametrize(
    ("there", "unused"),
    [
        (LinkParameters(), {"fitting_radius": 0.0125, "fitting_length": 0.03}),
        (
            SliderParameters(hole_count=2),
            {"rib_height": 0.02, "rib_pitch": 0.05, "pad_width": 0.04},
        ),
        (
            SliderParameters(rib_count=1),
            {"hole_diameter": 0.01, "hole_offset": 0.02, "rib_pitch": 0.05},
        ),
    ],
)
def test_numbers_of_absent_features_do_not_count(
    there: LinkParameters | SliderParameters, unused: dict
) -> None:
    other = dataclasses.replace(there, **unused)
    volumes = [mass_properties(made(one)).volume for one in (there, other)]
    assert volumes[0] == pytest.approx(volumes[1], rel=1e-12)
    assert there.present() == other.present() == there


@pytest.mark.parametrize(
    "full", [FULL, LinkParameters(bore=0.005, fitting_radius=0.02, fitting_length=0.03)]
)
def test_numbers_of_present_features_count(
    full: LinkParameters | SliderParameters,
) -> None:
    assert full.present() == full


@pytest.mark.parametrize(
    ("kind", "values", "field", "hint"),
    [
        (LinkParameters, {"length": 0.0}, "link.length", "0.01 mm to"),
        (LinkParameters, {"radius": -0.01}, "link.radius", "0.01 mm to"),
        (LinkParameters, {"radius": math.nan}, "link.radius", "finite"),
        (LinkParameters, {"length": math.inf}, "link.length", "finite"),
        (
            LinkParameters,
            {"bore": 0.025},
            "link.bore",
            "up to 24 mm (the link's is 25 mm)",
        ),
        (
            LinkParameters,
            {"fitting_radius": 0.02},
            "link.fitting_length",
            "0.5 mm to 249.5 mm",
        ),
        (SliderParameters, {"thickness": 20.5}, "slider.thickness", "20000 mm"),
        (SliderParameters, {"rib_count": -1}, "slider.rib_count", "whole number"),
        (SliderParameters, {"rib_count": 40}, "slider.rib_count", "at most 30 ribs"),
        (
            SliderParameters,
            {"rib_count": 3, "rib_pitch": 0.2},
            "slider.rib_pitch",
            "154.5 mm",
        ),
        (
            SliderParameters,
            {"rib_count": 3, "rib_length": 0.09},
            "slider.rib_length",
            "84.5 mm",
        ),
        (
            SliderParameters,
            {"rib_count": 3, "fillet": 0.015},
            "slider.fillet",
            "14.5 mm",
        ),
        (SliderParameters, {"fillet": 0.001}, "slider.fillet", "0 without ribs"),
        (
            SliderParameters,
            {"hole_count": 4, "hole_pitch": 0.009},
            "slider.hole_pitch",
            "9.5 mm to",
        ),
        (
            SliderParameters,
            {"hole_count": 4, "hole_offset": 0.003},
            "slider.hole_offset",
            "5 mm to 80 mm",
        ),
        (
            SliderParameters,
            {"hole_count": 3, "rib_count": 3},
            "slider.hole_pitch",
            "from a rib's centre plane",
        ),
        (SliderParameters, {"clamp": "holes"}, "slider.clamp", "'face'"),
        (
            SliderParameters,
            {"pad_height": 0.01, "pad_spacing": 0.16},
            "slider.pad_spacing",
            "159.5 mm",
        ),
        (
            SliderParameters,
            {"pad_height": 0.01, "pad_width": 0.08},
            "slider.pad_width",
            "69.5 mm",
        ),
    ],
)
def test_impossible_shape_is_refused_by_name(
    kind: type, values: dict, field: str, hint: str
) -> None:
    with pytest.raises(InputError) as refused:
        kind(**values)
    message = str(refused.value)
    assert message.startswith(f"{field}: expected ")
    assert hint in message
    assert "\n" not in message


@pytest.mark.parametrize("name", MATERIALS)
def test_materials_are_stable_and_sourced(name: str) -> None:
    chosen = material(name)
    assert chosen.source
    compliance = np.linalg.inv(chosen.elasticity())
    assert np.linalg.eigvalsh(chosen.elasticity()).min() > 0
    assert compliance[0, 0] == pytest.approx(1 / chosen.youngs_modulus)
    assert compliance[5, 5] == pytest.approx(1 / chosen.shear_modulus)


def test_impossible_materials_are_refused() -> None:
    with pytest.raises(
        InputError, match=r"materials\.odd\.shear_modulus: expected more than 70 GPa"
    ):
        Material("odd", 210e9, 60e9, 7850.0)
    with pytest.raises(InputError, match=r"materials\.odd\.density"):
        Material("odd", 210e9, 81e9, 0.0)
    with pytest.raises(InputError, match=r"materials\.odd\.axial_poisson"):
        TransverselyIsotropic("odd", 10e9, 100e9, 5e9, 0.4, 0.3, 1600.0)
    with pytest.raises(InputError, match=r"expected one of steel, .*, got 'stel'"):
        material("stel")
    assert isinstance(CFRP_TUBE, TransverselyIsotropic)
