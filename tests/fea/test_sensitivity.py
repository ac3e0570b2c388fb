"""Derivatives of parts: closed forms, laws of scale, differences on moved meshes."""

import dataclasses

import numpy as np
import pytest

from stiffscope.cad import link, slider
from stiffscope.cad.materials import CFRP_TUBE, STEEL
from stiffscope.cad.solid import build
from stiffscope.errors import InputError
from stiffscope.fea.design_velocity import DesignVelocity, moved_along
from stiffscope.fea.run import run_experiment, specimen_of
from stiffscope.fea.sensitivity import part_sensitivity
from stiffscope.fea.settings import Settings
from stiffscope.fea.solution import solve_specimen
from stiffscope.fea.specimen import mesh_specimen, shape_error

pytestmark = pytest.mark.slow

LENGTH = 0.2
RADIUS = 0.01
ORDER = np.array(
    [[1] * 3 + [2] * 3] * 3 + [[2] * 3 + [3] * 3] * 3
)  # of a compliance in an inverse length


def sensitivity(parameters, settings, material=STEEL):
    part = build(parameters, material)
    experiment = run_experiment(specimen_of(part, settings), settings)

    def variant(name):
        return lambda value: build(
            dataclasses.replace(parameters, **{name: value}), material
        )

    dimensions = {
        name: (value, variant(name)) for name, value in parameters.lengths().items()
    }
    return part, experiment, part_sensitivity(experiment, part, settings, dimensions)


@pytest.fixture(scope="module")
def rod():
    return sensitivity(
        link.LinkParameters(LENGTH, RADIUS), Settings(layers=1, size=0.010)
    )


@pytest.mark.extended
def test_rod_in_tension_torsion_and_bending_has_the_derivatives_of_the_closed_form(rod):
    _, experiment, found = rod
    e = 211e9
    g = 81e9
    area = np.pi * RADIUS**2
    second = np.pi * RADIUS**4 / 4
    by_length = found.derivatives["length"].compliance
    assert by_length[0, 0] == pytest.approx(1 / (e * area), rel=1e-3)
    assert by_length[3, 3] == pytest.approx(1 / (2 * g * second), rel=1e-3)
    assert by_length[5, 5] == pytest.approx(1 / (e * second), rel=1e-3)
    assert by_length[1, 5] == pytest.approx(LENGTH / (e * second), rel=5e-3)
    by_radius = RADIUS * found.derivatives["radius"].compliance
    c = experiment.compliance
    assert by_radius[0, 0] / c[0, 0] == pytest.approx(-2, abs=0.01)
    assert by_radius[3, 3] / c[3, 3] == pytest.approx(-4, abs=0.01)
    assert by_radius[5, 5] / c[5, 5] == pytest.approx(-4, abs=0.02)
    assert found.derivatives["radius"].mass == pytest.approx(
        7850 * 2 * np.pi * RADIUS * LENGTH, rel=3e-4
    )
    assert found.derivatives["length"].centre == pytest.approx([0.5, 0, 0], abs=1e-5)


@pytest.mark.long
def test_laws_of_scale(rod):
    """C ~ 1/E at a fixed E/G; with all lengths 1/s, 1/s², 1/s³; weight's sag as s² and s, masses as s³ and s⁵."""
    _, experiment, found = rod
    by = found.derivatives
    c = experiment.compliance
    size = np.sqrt(np.outer(c.diagonal(), c.diagonal()))
    moduli = sum(
        by[name].value * by[name].compliance
        for name in ("youngs_modulus", "shear_modulus")
    )
    np.testing.assert_allclose(moduli / size, -c / size, atol=1e-4)
    lengths = [by["length"], by["radius"]]
    np.testing.assert_allclose(
        sum(d.value * d.compliance for d in lengths) / size,
        -ORDER * c / size,
        atol=5e-4,
    )
    sag = sum(d.value * d.self_weight for d in lengths)
    weight = experiment.self_weight
    assert sag[1, 1] == pytest.approx(2 * weight[1, 1], rel=2e-3)
    assert sag[1, 5] == pytest.approx(weight[1, 5], rel=2e-3)
    assert by["density"].self_weight[1, 1] * 7850 == pytest.approx(
        weight[1, 1], rel=2e-3
    )
    mass = (
        sum(d.value * d.condensed_mass for d in lengths).diagonal()
        / experiment.condensed_mass.diagonal()[:12]
    )
    np.testing.assert_allclose(mass, [3, 3, 3, 5, 5, 5] * 2, rtol=0.02)


@pytest.mark.long
@pytest.mark.parametrize(
    "settings", [Settings(interface="distributed", foundation=5e12), Settings()]
)
def test_derivatives_are_differences_on_the_mesh_moved_along(settings):
    settings = dataclasses.replace(settings, size=0.02, layers=1)
    parameters = link.LinkParameters(0.04, 0.012, bore=0.012)
    part, experiment, found = sensitivity(parameters, settings, CFRP_TUBE)
    specimen, size, h = (
        specimen_of(part, settings),
        experiment.compliance.diagonal(),
        2e-3,
    )
    velocities = DesignVelocity(experiment.mesh, part)

    def compliance(change, mesh, material=CFRP_TUBE, foundation=settings.foundation):
        one = dataclasses.replace(specimen, elasticity=material.elasticity(), **change)
        return solve_specimen(
            one, mesh, settings.interface, "direct", foundation
        ).compliance

    def differences(name, value):
        for sign in (1, -1):
            if name in parameters.lengths():
                moved = build(
                    dataclasses.replace(parameters, **{name: value * 1.001}), CFRP_TUBE
                )
                velocity = velocities.measure_velocity(moved, value * 1e-3)
                mesh = dataclasses.replace(
                    experiment.mesh,
                    points=experiment.mesh.points + sign * h * value * velocity,
                )
                tip = np.array(
                    [parameters.length + (name == "length") * sign * h * value, 0, 0]
                )
                yield compliance({"loaded": ((specimen.loaded[0][0], tip),)}, mesh)
            elif name == "foundation":
                yield compliance({}, experiment.mesh, foundation=value * (1 + sign * h))
            else:
                material = dataclasses.replace(
                    CFRP_TUBE, **{name: value * (1 + sign * h)}
                )
                yield compliance({}, experiment.mesh, material)

    assert len(found.derivatives) == 9 + (settings.foundation is not None)
    assert not found.notes
    for name in (
        "radius",
        "axial_shear_modulus",
        *(["foundation"] if settings.foundation else ["length"]),
    ):
        derivative = found.derivatives[name]
        up, down = differences(name, derivative.value)
        expected = (up - down).diagonal() / (2 * h) / size
        got, bound = (
            m.diagonal() * derivative.value / size
            for m in (derivative.compliance, derivative.error)
        )
        assert (
            np.abs(got - expected) < bound + 2e-3 * np.abs(expected) + 2e-5
        ).all(), (name, got, expected, bound)


@pytest.mark.long
def test_features_that_meet_or_vanish_have_no_derivative(rod):
    part, experiment, _ = rod
    other = build(slider.SliderParameters())
    with pytest.raises(InputError, match="faces change"):
        DesignVelocity(experiment.mesh, part).measure_velocity(other, 1e-4)


@pytest.mark.extended
def test_a_mesh_moves_along_with_a_small_change_and_not_with_a_large_one(rod):
    part, experiment, _ = rod
    settings = Settings(layers=1, size=0.010)

    def changed(share):
        return build(link.LinkParameters(LENGTH * share, RADIUS * share))

    moved = run_experiment(
        changed(1.03), settings, near=(part, experiment.mesh), whole=False
    )
    assert np.array_equal(moved.mesh.cells, experiment.mesh.cells)
    size = np.sqrt(
        np.outer(experiment.compliance.diagonal(), experiment.compliance.diagonal())
    )
    scaled = experiment.compliance * 1.03 ** -ORDER.astype(float)
    np.testing.assert_allclose(moved.compliance / size, scaled / size, atol=2e-4)
    assert moved.relative_bound < 1.5 * experiment.relative_bound
    assert moved_along(experiment.mesh, part, changed(1.4)) is None
    assert moved_along(experiment.mesh, part, build(slider.SliderParameters())) is None
    anew = run_experiment(
        changed(1.03), settings, near=(changed(1.4), experiment.mesh), whole=False
    )  # the mesh is none of its
    assert not np.array_equal(anew.mesh.cells, experiment.mesh.cells)
    assert (np.abs(anew.compliance - moved.compliance) < anew.error + moved.error).all()


FILLETED = slider.SliderParameters(
    0.06,
    0.09,
    0.012,
    rib_count=1,
    rib_thickness=0.012,
    rib_height=0.012,
    rib_length=0.04,
    fillet=0.004,
)


@pytest.mark.extended
def test_the_mesh_of_a_filleted_slider_follows_its_cad_whatever_changes():
    """Where a fillet is tangent to plate and rib, nodes belong to both faces and go with the line between them."""
    part = build(FILLETED)
    settings = Settings()
    mesh = mesh_specimen(specimen_of(part, settings))
    velocities = DesignVelocity(mesh, part)
    before = shape_error(specimen_of(part, settings), mesh)
    for name, value in FILLETED.lengths().items():
        changed = build(dataclasses.replace(FILLETED, **{name: value * 1.0003}))
        velocity = velocities.measure_velocity(changed, value * 3e-4)
        assert np.linalg.norm(velocity, axis=1).max() < 2.5, (
            name
        )  # of a fillet's corner: √2 + 1
        larger = build(dataclasses.replace(FILLETED, **{name: value * 1.02}))
        moved = moved_along(mesh, part, larger)
        assert moved is not None, name
        assert shape_error(specimen_of(larger, settings), moved) < 2 * before + 1e-5, (
            name
        )


@pytest.mark.long
def test_a_filleted_slider_is_subject_to_the_laws_of_scale():
    """Euler's theorem for a homogeneous function: Σ p ∂C/∂p over all lengths is less its order times C."""
    _, experiment, found = sensitivity(FILLETED, Settings())
    assert not found.notes
    c = experiment.compliance
    lengths = [found.derivatives[name] for name in FILLETED.lengths()]
    size = np.sqrt(np.outer(c.diagonal(), c.diagonal()))
    np.testing.assert_allclose(
        sum(d.value * d.compliance for d in lengths) / size,
        -ORDER * c / size,
        atol=2e-3,
    )
    assert sum(d.value * d.mass for d in lengths) == pytest.approx(
        3 * experiment.mass, rel=1e-4
    )
