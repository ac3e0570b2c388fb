"""Stiffness under weight against the full potential energy, and the sizes of the literal reading."""

import numpy as np
import pytest

from stiffscope.vjm.analysis import sag, stiffness
from stiffscope.vjm.biglide import Biglide, link_angle
from stiffscope.vjm.elastic import Parallel, Passive, Series, Spring, Weight, revolute, spherical
from stiffscope.vjm.gravity import exact_stiffness, load_hessian
from stiffscope.vjm.reduction import as_stiffness
from stiffscope.vjm.screws import Frame, rotation, rotation_of
from tests.robots import DRIVE, GEOMETRY, euler_bernoulli, published_slider, random_compliance
from tests.vjm import energy


@pytest.mark.parametrize("z", [0.30, 0.40, 0.50])
def test_exact_stiffness_is_the_hessian_of_the_energy_at_the_loaded_equilibrium(z, rng):
    link, slider = random_compliance(rng, euler_bernoulli()), random_compliance(rng, published_slider())
    robot = Biglide(GEOMETRY, link, slider, DRIVE, 1.95, 7.93)
    pose = np.array([[0.0, 0.0, z]])
    q = float(link_angle(GEOMETRY, pose)[0])
    hessian, droop = energy.tangent_stiffness(energy.Biglide(GEOMETRY, link, slider, DRIVE, 1.95, 7.93, q, 9.81))
    plain, exact = stiffness(robot, pose)[0], stiffness(robot, pose, gravity="exact")[0]
    size = np.sqrt(np.outer(np.diagonal(plain), np.diagonal(plain)))
    change = np.abs((exact - plain) / size).max()
    assert change > 1e-5
    assert np.abs((exact - hessian) / size).max() < 2e-3 * change
    assert np.allclose(sag(robot, pose)[0], droop, atol=5e-3 * np.abs(droop).max())


def test_without_weight_nothing_changes(robot):
    pose = [[0.03, 0.0, 0.38]]
    assert np.allclose(stiffness(robot, pose, gravity="exact", g=0.0), stiffness(robot, pose), rtol=1e-9, atol=0.1)


def test_literal_reading_is_smaller_still(robot):
    pose = [[0.0, 0.0, 0.35]]
    plain, literal = stiffness(robot, pose)[0], stiffness(robot, pose, gravity="literal")[0]
    change = np.abs(np.diagonal(literal) / np.diagonal(plain) - 1.0)
    assert 1e-7 < change.max() < 1e-5


def test_load_hessian_is_the_second_derivative_of_the_work():
    force, lever, step = np.array([3.0, -2.0, 5.0]), np.array([0.1, 0.4, -0.2]), 1e-4

    def work(angles):
        turn = np.eye(3)
        for axis, angle in zip(np.eye(3), angles, strict=True):
            turn = turn @ rotation(axis, angle)
        return force @ turn @ lever

    basis = step * np.eye(3)
    second = [[(work(a + b) - work(a - b) - work(b - a) + work(-a - b)) / (4 * step**2) for b in basis] for a in basis]
    assert np.allclose(load_hessian(force, lever)[3:, 3:], second, atol=1e-6)
    assert not load_hessian(force, lever)[:3].any()


def test_a_tight_string_is_stiff_sideways():
    """Two struts in line, each too short by a misfit: together 2 T/l across, without any weight."""
    length, stiffness, tension = 0.5, 1e7, 1000.0

    def strut(name, side):
        short = -tension / stiffness * side * np.eye(6)[0]
        foot = spherical(f"{name}.foot", Frame(translation=-side * length * np.eye(3)[0]))
        spring = Spring(f"{name}.spring", np.diag([1 / stiffness, 0, 0, 0, 0, 0]), offset=short)
        return Series(name, (foot, spring, spherical(f"{name}.tip")))

    hold = Spring("hold", np.diag([1.0, 1, 1, 1e-6, 1e-6, 1e-6]))
    k = exact_stiffness(Parallel("string", (strut("left", 1.0), strut("right", -1.0), hold)), 0.0)
    across = 2 * tension / length
    assert np.diagonal(k) == pytest.approx([2 * stiffness + 1, across + 1, across + 1, 1e6, 1e6, 1e6], rel=2e-4)


def test_a_universal_joint_is_two_revolutes(rng):
    """One joint of two directions, or two joints of one: the same robot, under its weight too."""
    springs = [random_compliance(rng, np.diag([1e-6] * 3 + [1e-5] * 3)) for _ in range(3)]
    places = [Frame(rotation_of(rng.normal(size=3)), 0.3 * rng.normal(size=3)) for _ in range(4)]

    def robot(joints):
        leg = (
            Spring("a", springs[0], places[0]),
            Weight("mass", 3.0, places[1]),
            Series("joint", joints, places[2]),
            Spring("b", springs[1], places[3]),
        )
        return Parallel("robot", (Series("leg", leg), Spring("c", springs[2])))

    y, z = np.eye(3)[1:]
    one = robot((Passive("universal", np.eye(6)[:, 4:]),))
    two = robot((revolute("first", y), revolute("second", z)))
    plain, exact = as_stiffness(one), exact_stiffness(one)
    size = np.sqrt(np.outer(np.diagonal(plain), np.diagonal(plain)))
    change = np.abs((exact - plain) / size).max()
    assert change > 1e-6
    assert np.abs((exact - exact_stiffness(two)) / size).max() < 1e-4 * change
