"""Derivatives of robots beside closed forms and energies; tolerances of a robot file."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import tomlkit

from stiffscope.cad.materials import STEEL
from stiffscope.design.sensitivity import robot_sensitivity
from stiffscope.errors import InputError
from stiffscope.experiments.robot_files import robot_document
from stiffscope.robot.beam_dynamics import beam_dynamics
from stiffscope.robot.library import robot_names
from stiffscope.robot.mechanism_of import mechanism_of
from stiffscope.robot.parameters import parameters
from stiffscope.robot.part_matrices import beam_compliance, beam_segments, part_matrices
from stiffscope.robot.reader import load_robot
from stiffscope.vjm.statics import analysis as statics
from stiffscope.vjm.statics.yielding import deflection

pytestmark = pytest.mark.slow

POSE = [[0.03, 0.02, 0.3475]]


def rows(found):
    return {row.parameter.name: row for row in found.rows}


def test_stewart_has_the_derivatives_of_its_closed_form():
    """K = 2 k of the three directions at the cube's centre, 1/k = 1/k_drive + lengths over E A (see the file)."""
    robot = load_robot("stewart", ["parameters.M=0"])
    names = (
        "upper.radius",
        "lower.bore",
        "materials.steel.youngs_modulus",
        *(f"strut{i}.drive.drive.stiffness" for i in (1, 2)),
    )
    found = robot_sensitivity(
        robot, np.array([[0, 0, *robot.tool.at[2:], 0, 0, 0]]), "beam", names=names
    )
    drive = 4e7
    e = 211e9
    length = 0.16
    lower = np.pi * (0.025**2 - 0.015**2)
    upper = np.pi * 0.01**2
    compliance = 1 / drive + length / e * (1 / lower + 1 / upper)
    stiffness = found.at.stiffness[0]
    assert np.trace(stiffness[:3, :3]) == pytest.approx(6 / compliance, rel=1e-3)
    shares = {
        "upper.radius": 2 * length / (e * upper) / compliance,
        "materials.steel.youngs_modulus": length
        / e
        * (1 / lower + 1 / upper)
        / compliance,
        "lower.bore": -2 * length / (e * lower**2) * np.pi * 0.015**2 / compliance,
    }
    for name, share in shares.items():
        row = rows(found)[name]
        got = (
            np.trace(row.by.stiffness[0, :3, :3])
            * row.parameter.value
            / np.trace(stiffness[:3, :3])
        )
        assert got == pytest.approx(share, rel=2e-3), name
    both = [rows(found)[f"strut{i}.drive.drive.stiffness"] for i in (1, 2)]
    got = (
        sum(np.trace(row.by.stiffness[0, :3, :3]) for row in both)
        * drive
        / np.trace(stiffness[:3, :3])
    )
    assert got == pytest.approx(1 / drive / compliance, rel=2e-3)


def test_biglide_follows_drives_by_their_share_of_the_energy_and_masses_in_proportion():
    """d ln C / d ln k of a spring is less its share of the strain energy, under each wrench by itself."""
    robot = load_robot("biglide")
    found = robot_sensitivity(
        robot,
        np.array(POSE),
        "published",
        names=("parameters.K_ac", "link.mass", "platform.mass"),
    )
    mechanism = mechanism_of(robot, part_matrices(robot, "published"))
    row = rows(found)["parameters.K_ac"]
    stiffness = found.at.stiffness[0]
    compliance = np.linalg.inv(stiffness)
    change = -compliance @ row.by.stiffness[0] @ compliance * row.parameter.value
    for i in range(6):
        shares = deflection(mechanism, np.array(POSE), np.eye(6)[i]).shares
        driven = sum(float(np.squeeze(shares[name])) for name in robot.drives())
        assert change[i, i] / compliance[i, i] == pytest.approx(-driven, abs=1e-6)
    sags = [rows(found)[name] for name in ("link.mass", "platform.mass")]
    np.testing.assert_allclose(
        sum(s.by.sag * s.parameter.value for s in sags),
        found.at.sag,
        rtol=1e-6,
        atol=1e-14,
    )
    f1 = sum(s.by.frequency * s.parameter.value for s in sags)
    assert f1 == pytest.approx(
        -0.5 * found.at.frequency, rel=1e-3
    )  # the platform's inertia is given by itself


class Beam:
    """Beam theory in the place of a virtual experiment, and of its derivatives."""

    def __init__(self, robot, name):
        material = robot.material(name)
        segments = beam_segments(robot, name)
        made = beam_dynamics(
            segments, material.youngs_modulus, material.shear_modulus, material.density
        )
        length = sum(each for each, _ in segments)
        self.compliance, self.error, self.mass = (
            beam_compliance(robot, name),
            np.zeros((6, 6)),
            made.total,
        )
        self.experiment = SimpleNamespace(
            condensed_mass=made.mass,
            mode_squares=made.squares,
            mode_squares_error=None,
            clamp_point=np.zeros(3),
            reference_points=np.array([[length, 0, 0]]),
        )


def derivative(name, key, value, override):
    up, down = (
        Beam(load_robot("biglide", [f"{override}={value * (1 + h)!r}"]), name)
        for h in (1e-5, -1e-5)
    )
    step = 2e-5 * value
    return SimpleNamespace(
        full_compliance=(up.compliance - down.compliance) / step,
        full_error=0.01 * np.abs(up.compliance - down.compliance) / step,
        mass=(up.mass - down.mass) / step,
        condensed_mass=(up.experiment.condensed_mass - down.experiment.condensed_mass)[
            :12, :12
        ]
        / step,
        reference_points=(
            up.experiment.reference_points - down.experiment.reference_points
        )
        / step,
        clamp_point=np.zeros(3),
    )


@pytest.mark.extended_for("stewart")
@pytest.mark.parametrize("name", robot_names())
def test_what_can_be_varied_can_be_set(name):
    """Every number that a sensitivity lists, by its name there, as `--set` takes it."""
    robot = load_robot(name)
    for each in parameters(robot):
        changed = load_robot(name, [f"{each.name}={0.999 * each.value!r}"])
        found = {other.name: other.value for other in parameters(changed)}
        assert found[each.name] == pytest.approx(0.999 * each.value, rel=1e-12)
        assert (
            each.set_to(robot, 0.999 * each.value).source.changed.keys()
            == changed.source.changed.keys()
        )


def test_a_constant_of_a_built_in_material_is_set_alone(tmp_path):
    """The others stay those of the material, in this robot and in its saved file."""
    robot = load_robot("stewart", ["materials.steel.youngs_modulus=200 GPa"])
    assert robot.materials["steel"] == replace(STEEL, youngs_modulus=200e9)
    saved = tmp_path / "softer.toml"
    saved.write_text(tomlkit.dumps(robot_document(robot, saved)))
    assert load_robot(saved).materials == robot.materials
    both = load_robot(
        "stewart",
        ["materials.steel.youngs_modulus=2e11", "materials.steel.density=8e3"],
    )
    assert both.materials["steel"] == replace(STEEL, youngs_modulus=2e11, density=8e3)
    with pytest.raises(
        InputError, match=r"materials\.steel\.stiffness: expected a known key"
    ):
        load_robot("stewart", ["materials.steel.stiffness=1"])


@pytest.mark.extended
def test_derivatives_of_parts_reach_the_robot_as_the_parts_themselves_would():
    """Beam theory handed over as experiments and derivatives gives what beam theory gives in closed form."""
    overrides = ["slider.mass=cad", "link.mass=cad"]
    robot = load_robot("biglide", overrides)
    names = {
        "link": {"length": 0.5, "radius": 0.0125},
        "slider": {"depth": 0.085, "width": 0.32, "thickness": 0.02},
    }
    constants = {"youngs_modulus": 211e9, "shear_modulus": 81e9, "density": 7850.0}
    known = {
        name: {
            key: derivative(name, key, value, f"{name}.{key}")
            for key, value in lengths.items()
        }
        | {
            key: derivative(name, key, value, f"materials.steel.{key}")
            for key, value in constants.items()
        }
        for name, lengths in names.items()
    }
    beams = {name: Beam(robot, name) for name in names}
    some = {f"{name}.{key}" for name, lengths in names.items() for key in lengths} - {
        "slider.width"
    }
    some |= {f"materials.steel.{key}" for key in constants} | {"parameters.K_ac"}
    exact = robot_sensitivity(robot, np.array(POSE), "beam", names=some)
    found = robot_sensitivity(robot, np.array(POSE), "fea", beams, known, some)
    assert {row.parameter.name for row in found.rows} == some
    np.testing.assert_allclose(
        found.at.stiffness, exact.at.stiffness, rtol=1e-9, atol=1e-3
    )
    assert found.at.mass == pytest.approx(exact.at.mass)
    assert not found.notes
    scale = np.sqrt(np.outer(*[np.diagonal(exact.at.stiffness[0])] * 2))
    for one, two in zip(found.rows, exact.rows, strict=True):
        value = two.parameter.value
        name = two.parameter.name
        off = (one.by.stiffness - two.by.stiffness)[0] * value / scale
        assert np.abs(off).max() < 1e-5, name
        np.testing.assert_allclose(
            one.by.sag * value,
            two.by.sag * value,
            atol=1e-4 * np.abs(exact.at.sag).max(),
        )
        off = (one.by.frequency - two.by.frequency) * value
        assert abs(off) < one.error.frequency * value + 1e-3 * exact.at.frequency, name
        assert one.by.mass == pytest.approx(two.by.mass, rel=1e-4, abs=1e-9)
    bars = rows(found)["link.radius"]
    assert (
        np.abs(bars.error.stiffness[0]).diagonal()
        > 5e-3 * np.abs(bars.by.stiffness[0]).diagonal()
    ).all()
    assert not rows(found)["parameters.K_ac"].error.stiffness.any()


def test_a_tolerance_leaves_the_nominal_value_and_scatters_the_robot():
    robot = load_robot(
        "biglide", ["link.radius=12.5 mm ± 0.1 mm", "parameters.K_ac=12.7 N/um +- 2 %"]
    )
    plain = load_robot("biglide")
    assert robot.part("link") == plain.part("link")
    assert robot.parameters["K_ac"] == plain.parameters["K_ac"]
    assert robot.tolerances[("parts", "link", "radius")] == pytest.approx(1e-4)
    found = robot_sensitivity(
        robot, np.array(POSE), "published", names=("link.radius", "parameters.K_ac")
    )
    given = rows(found)["link.radius"], rows(found)["parameters.K_ac"]
    squares = (given[0].by.stiffness * 1e-4) ** 2 + (
        given[1].by.stiffness * 0.02 * 12.7e6
    ) ** 2
    np.testing.assert_allclose(found.scatter().stiffness, np.sqrt(squares), rtol=1e-9)
    assert (
        robot_sensitivity(plain, np.array(POSE), "published", names=()).scatter()
        is None
    )


@pytest.mark.parametrize("text", ["20 mm ± 1 N", "20 mm ± ", "20 mm ± -1 mm", "± 1 mm"])
def test_what_is_no_tolerance_is_refused_by_field(text):
    with pytest.raises(
        InputError, match=r"slider\.thickness: expected a quantity with its tolerance"
    ):
        load_robot("biglide", [f"slider.thickness={text}"])


def test_statics_agree_with_a_robot_assembled_anew():
    """A tenth of a per cent more of the links' radius and of what they follow: second order apart."""
    values = {"link.radius": 0.0125, "parameters.d": 0.07, "link.length": 0.5}
    found = robot_sensitivity(
        load_robot("biglide"), np.array(POSE), "beam", names=values
    )
    for name, value in values.items():
        other = load_robot("biglide", [f"{name}={value * 1.001!r}"])
        moved = statics.stiffness(
            mechanism_of(other, part_matrices(other, "beam")), np.array(POSE)
        )
        linear = found.at.stiffness + 1e-3 * value * rows(found)[name].by.stiffness
        scale = np.sqrt(np.outer(*[np.diagonal(moved[0])] * 2))
        assert np.abs((moved - linear)[0] / scale).max() < 2e-5, name
