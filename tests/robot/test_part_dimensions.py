"""Parameters of parts: what their matrices become with them, by theory and through experiments."""

from dataclasses import replace

import numpy as np
import pytest

from stiffscope.cad.cross_sections import box, channel, circle, i_section
from stiffscope.cad.materials import STEEL
from stiffscope.errors import InputError
from stiffscope.fea.beam import timoshenko
from stiffscope.gap.effects.part_dimension import find_dimensions
from stiffscope.gap.effects.vocabulary import apply_effect
from stiffscope.robot.mechanism_of import mechanism_of
from stiffscope.robot.nominal import NominalRobot
from stiffscope.robot.parameters import parameters
from stiffscope.robot.part_dimensions import (
    PartDimension,
    beam_dimensions,
    find_vanishing,
    interpolate_between,
    on_foundation,
    part_parameters,
    with_parameter,
)
from stiffscope.robot.part_matrices import beam_compliance, known_mass, part_matrices
from stiffscope.robot.reader import load_robot
from stiffscope.vjm.statics.analysis import stiffness

BEAM = """
bodies.arm = {{ part = "beam", base = [0, 0, 0], tip = [0.3, 0, 0], y = [0, 1, 0] }}
joints.root = {{ between = ["ground", "arm.base"], type = "fixed", at = [0, 0, 0] }}
tool = {{ body = "arm.tip", at = [0.3, 0, 0], pose = ["x"] }}
[parts.beam]
shape = "{shape}"
material = "steel"
length = 0.3
{dimensions}
"""
FLANGED = {"width": 0.04, "height": 0.06, "flange": 0.006, "web": 0.005}
SECTIONS = {
    "tube": (circle(0.02, 0.016, STEEL.poisson), {"radius": 0.02, "wall": 0.004}),
    "box": (
        box(0.04, 0.06, 0.004, STEEL.poisson),
        {"width": 0.04, "height": 0.06, "wall": 0.004},
    ),
    "i": (i_section(**FLANGED, poisson=STEEL.poisson), FLANGED),
    "channel": (channel(**FLANGED), FLANGED),
}


def test_parameters_are_those_that_the_part_has():
    robot = load_robot("biglide")
    assert set(part_parameters(robot, "link")) == {
        "radius",
        "youngs_modulus",
        "shear_modulus",
    }
    plate = set(part_parameters(robot, "slider"))
    assert plate == {"width", "thickness", "youngs_modulus", "shear_modulus"}
    ribbed = load_robot("biglide", ["slider.rib_count=4"])
    assert {"rib_thickness", "rib_height", "rib_length"} <= set(
        part_parameters(ribbed, "slider")
    )
    assert part_parameters(load_robot("biglide", ["link.bore=10mm"]), "link")[
        "bore"
    ] == (0.01, "m")


@pytest.mark.parametrize("shape", SECTIONS)
def test_a_section_of_a_file_is_its_closed_form(shape, tmp_path):
    """Every dimension of it is a parameter too."""
    section, size = SECTIONS[shape]
    dimensions = "\n".join(f"{key} = {value}" for key, value in size.items())
    file = tmp_path / "beam.toml"
    file.write_text(BEAM.format(shape=shape, dimensions=dimensions))
    robot = load_robot(file)
    steel = robot.material("beam")
    expected = timoshenko(0.3, section, steel.youngs_modulus, steel.shear_modulus)
    assert np.array_equal(beam_compliance(robot, "beam"), expected)
    assert {*size, "youngs_modulus", "shear_modulus"} == {
        each.parameter for each in beam_dimensions(robot, "beam")
    }
    varied = {each.name for each in parameters(robot, "beam")}
    assert {f"beam.{key}" for key in (*size, "length")} <= varied
    assert known_mass(robot, "beam") == pytest.approx(
        steel.density * 0.3 * section.area, rel=1e-12
    )


@pytest.mark.parametrize(
    ("parameter", "entry", "power"),
    [("radius", (1, 1), -4), ("youngs_modulus", (0, 0), -1)],
)
def test_a_matrix_by_theory_changes_with_the_power_of_the_textbook(
    parameter, entry, power
):
    robot = load_robot("biglide")
    (dimension,) = (
        d for d in beam_dimensions(robot, "link") if d.parameter == parameter
    )
    ratio = (
        dimension.compliance(1.1 * dimension.nominal)[entry]
        / beam_compliance(robot, "link")[entry]
    )
    assert np.log(ratio) / np.log(1.1) == pytest.approx(
        power, abs=0.02
    )  # shear yields a little


def test_three_experiments_give_any_value_near_them():
    """Powers and their sums, against the function itself; a foundation by its reciprocal, exactly linear."""
    robot = load_robot("biglide")
    values = (0.02, 0.0188, 0.0212)
    made = [
        beam_compliance(with_parameter(robot, "slider", "thickness", v), "slider")
        for v in values
    ]
    found = interpolate_between(values, made)(0.018)
    exact = beam_compliance(
        with_parameter(robot, "slider", "thickness", 0.018), "slider"
    )
    assert found == pytest.approx(exact, rel=1e-4)


@pytest.mark.parametrize(("parameter", "nominal"), [("radius", 16e-3), ("bore", 26e-3)])
def test_a_thin_wall_is_followed_until_a_third_of_it_is_gone(parameter, nominal):
    """Where the radius changes by a sixteenth; against theory itself."""
    robot = load_robot("five-bar")
    limit = find_vanishing(robot, "inner", parameter)
    values = [limit + (nominal - limit) * share for share in (1.0, 0.9, 1.1)]
    made = [
        beam_compliance(with_parameter(robot, "inner", parameter, v), "inner")
        for v in values
    ]
    thin = limit + (nominal - limit) * 0.67
    exact = beam_compliance(with_parameter(robot, "inner", parameter, thin), "inner")
    found = interpolate_between(values, made, limit)
    assert found(thin) == pytest.approx(exact, rel=4e-3)
    with pytest.raises(InputError, match="nothing is left"):
        found(2.0 * limit - nominal)


def test_what_a_foundation_adds_is_followed_over_all_sizes():
    """A clamp's edge yields by a power of its foundation, its whole area by the reciprocal: their sum, by formula."""
    rigid = np.diag([6.0, 5, 4, 3, 2, 1]) * 1e-9

    def exact(k):
        return rigid + np.diag([1.0, 2, 3, 4, 5, 6]) * 1e-9 * (
            1e11 / k + 0.3 * (1e11 / k) ** 0.7
        )

    at = [1e13, 2e12, 4e11, 8e10, 1.6e10]
    found = on_foundation(rigid, at, [exact(k) for k in at])
    for k in (5e11, 7e10, 2e10):
        assert np.diagonal(found(k)) == pytest.approx(np.diagonal(exact(k)), rel=1e-4)
    assert found(np.inf) == pytest.approx(rigid)
    assert found(1e9) - rigid == pytest.approx(16.0 * (found(1.6e10) - rigid))


def test_a_thinner_part_is_carried_by_the_robot():
    """As the robot file with that dimension would be, for a part by theory and for one by experiments."""
    robot = load_robot("biglide")
    bare = NominalRobot(mechanism_of(robot, part_matrices(robot, "beam")), robot)
    thinner = with_parameter(robot, "slider", "thickness", 0.018)
    expected = stiffness(
        mechanism_of(thinner, part_matrices(thinner, "beam")), [0, 0, 0.35]
    )
    found = apply_effect(bare, "part-dimension", "slider.thickness", {"value": 0.018})
    assert stiffness(found.mechanism, [0, 0, 0.35]) == pytest.approx(
        expected, rel=1e-9, abs=1e-3
    )
    with pytest.raises(
        InputError, match=r"part-dimension, place: expected one of link\.radius"
    ):
        apply_effect(bare, "part-dimension", "slider.height", {"value": 0.018})
    rigid = beam_compliance(robot, "slider")
    soft = np.diag([1e-9] * 6)
    foundation = PartDimension(
        "slider", "foundation", np.inf, "N/m^3", lambda k: rigid + soft * (1e10 / k)
    )
    tested = replace(bare, tested={"slider": lambda: (foundation,)})
    (effect,) = find_dimensions(tested, "slider")
    assert effect.physical(effect.internal(np.array([5e10])))[0] == pytest.approx(5e10)
    change = effect.action.changes(effect.internal(np.array([5e10])))[
        "limb1.slider"
    ].compliance
    assert change == pytest.approx(0.2 * soft, abs=1e-18)
    assert effect.action.changes(np.zeros(1))[
        "limb1.slider"
    ].compliance == pytest.approx(0.0 * soft, abs=1e-20)


def test_moduli_without_a_material_are_refused_and_far_ones_follow_a_power():
    """A polynomial through five values would be off by its fourth power there."""
    values = np.array([1.0, 0.9, 0.95, 1.05, 1.1])
    made = [
        np.diag([v**-1.0 + 2e-4 * np.cos(40.0 * v)] * 6) for v in values
    ]  # as experiments scatter
    found = interpolate_between(values, made, legal=(0.0, 1.2))
    assert found(0.95) == pytest.approx(made[2])
    assert np.diagonal(found(0.5)) == pytest.approx(2.0, rel=0.2)
    with pytest.raises(
        InputError, match=r"^expected a value between 0 and 1.2, got 1.25"
    ):
        found(1.25)


def test_a_foundation_that_adds_nothing_is_as_good_as_rigid():
    rigid = np.diag([6.0, 5, 4, 3, 2, 1]) * 1e-9
    assert on_foundation(rigid, [1e20], [rigid])(1e18) == pytest.approx(rigid)


def test_a_radius_within_the_bore_is_refused_in_its_own_words():
    robot = load_robot("five-bar")
    bare = NominalRobot(mechanism_of(robot, part_matrices(robot, "beam")), robot)
    with pytest.raises(
        InputError,
        match=r"^inner\.radius: expected a value to the other side of 0\.013 m, .* got 0\.01 m",
    ):
        apply_effect(bare, "part-dimension", "inner.radius", {"value": 0.01})
