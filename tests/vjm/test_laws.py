"""Drives that are not linear, against a dense Newton's method of its own and closed forms."""

from dataclasses import replace

import numpy as np
import pytest

from stiffscope.errors import InputError
from stiffscope.vjm.model.bodies import Body
from stiffscope.vjm.model.joints import Drive, Joint, Law
from stiffscope.vjm.model.mechanism import Mechanism, Tool
from stiffscope.vjm.statics.analysis import analyse, sag, stiffness
from stiffscope.vjm.statics.yielding import deflection, find_load_curve, respond
from tests.vjm import oracle
from tests.vjm.files import CHECKED, read

POSES = CHECKED["stewart"]["poses"]
CURVE = [[2e-6, 20.0], [8e-6, 140.0]]  # 1e7, then 2e7 N/m
GAP = 4e-6


def hexapod(curve=CURVE, backlash=GAP, spring=None, weight=1.0):
    """The checked hexapod with one law in all its drives; springs in its joints tie the platform to the ground."""
    m = read("stewart")
    joints = []
    for j in m.joints:
        if j.drive is not None:
            law = Law.from_curve(curve, backlash)
            joints.append(replace(j, drive=Drive(law.slopes[0], law=law)))
        else:
            joints.append(replace(j, spring=spring))
    return replace(m, joints=tuple(joints), gravity=weight * m.gravity)


def lost(theta, points, backlash):
    """Force and slope of a curve written anew: interpolated, odd, past half the backlash."""
    x, f = np.array([[0.0, 0.0], *points]).T
    a = np.maximum(np.abs(theta) - backlash / 2, 0.0)
    k = np.minimum(np.searchsorted(x, a, side="right"), len(x) - 1)
    slope = (f[k] - f[k - 1]) / (x[k] - x[k - 1])
    force = f[k - 1] + slope * (a - x[k - 1])
    return np.sign(theta) * force, np.where(np.abs(theta) > backlash / 2, slope, 0.0)


def dense(m, pose, wrench, points=CURVE, backlash=GAP):
    """Equilibrium by Newton's method in the platform's twist alone: legs of one law each, their joints' springs.

    ``J`` and the springs' stiffness are those of the oracle with all drives linear and at two stiffnesses.
    """
    bodies = oracle.Bodies(m).close(pose, 4)
    rows = []
    springs = np.zeros((6, 6))
    for i in range(1, 7):
        foot = m.joint(f"strut{i}.foot")
        head = m.joint(f"strut{i}.head")
        r, p = bodies.of("platform")
        tip = r @ head.at + p
        tool = r @ m.tool.at + p
        along = (tip - foot.at) / np.linalg.norm(tip - foot.at)
        rows.append(np.r_[along, np.cross(tip - tool, along)])
    jacobian = np.array(rows)
    if m.joint("strut1.foot").spring:
        springs = tied(m, pose)
    u = np.linalg.solve(jacobian.T @ jacobian * 1e7 + springs, wrench)
    for _ in range(200):
        force, slope = lost(jacobian @ u, points, backlash)
        left = wrench - springs @ u - jacobian.T @ force
        if np.abs(left).max() < 1e-13 * np.abs(wrench).max():
            break
        u = u + np.linalg.solve(
            springs + jacobian.T @ (slope[:, None] * jacobian) + 1e-9 * np.eye(6), left
        )
    assert np.abs(left).max() < 1e-10 * np.abs(wrench).max()
    return (
        u,
        springs + jacobian.T @ (slope[:, None] * jacobian),
        lost(jacobian @ u, points, backlash)[0],
    )


def tied(m, pose):
    """Stiffness of the joints' springs alone, the drives free, by the oracle."""
    passive = replace(
        m, joints=tuple(replace(j, drive=None) if j.drive else j for j in m.joints)
    )
    return oracle.solve(oracle.Bodies(passive).close(pose, 4))[0]


@pytest.mark.parametrize("size", [0.3, 3.0, 30.0, 300.0])
def test_a_hexapod_of_nonlinear_drives_is_that_of_a_dense_newton_method(size):
    m = hexapod()
    wrench = size * np.array([30.0, -20.0, 50.0, 0.4, -0.2, 0.3])
    curve = find_load_curve(m, POSES, wrench, [1.0])
    found = deflection(m, POSES, wrench)
    assert sum(found.shares.values()) == pytest.approx(1.0, abs=1e-9)
    for k, pose in enumerate(POSES):
        twist, tangent, force = dense(m, pose, wrench)
        assert np.abs(found.twist[k] - twist).max() < 1e-8 * np.abs(twist).max()
        assert (
            np.abs(curve.stiffness[k, :, :, 0] - tangent).max()
            < 1e-8 * np.abs(tangent).max()
        )
        carried = respond(m, [pose], wrench).elements
        axial = [carried[f"strut{i}.drive"].wrench[0, 0, 0] for i in range(1, 7)]
        assert axial == pytest.approx(force, rel=1e-8, abs=1e-8 * np.abs(force).max())


@pytest.mark.extended
def test_equilibrium_under_wrench_weight_and_springs_beside_hanging_drives():
    """Springs hold the platform, some drives hang in a wide gap: forces balance, energy is the work done."""
    gap = 5e-5
    m = hexapod(backlash=gap, spring=2000.0)
    wrench = np.array([30.0, -20.0, 50.0, 1.0, -0.5, 0.2])
    found = respond(m, [POSES[1]], wrench)
    twist, tangent, force = dense(m, POSES[1], wrench, backlash=gap)
    assert 0 < np.count_nonzero(force) < 6
    assert np.abs(found.twist[0, :, 0] - twist).max() < 1e-8 * np.abs(twist).max()
    assert (
        np.abs(
            tangent
            - find_load_curve(m, [POSES[1]], wrench, [1.0]).stiffness[0, :, :, 0]
        ).max()
        < 1e-7 * np.abs(tangent).max()
    )
    path = np.linspace(0.0, 1.0, 2001)
    along = find_load_curve(m, [POSES[1]], wrench, path).twist[0].T @ wrench
    work = np.trapezoid(path, along)
    assert deflection(m, [POSES[1]], wrench).energy[0] == pytest.approx(work, rel=1e-5)


def test_unloading_returns_along_the_way_of_loading():
    there = np.linspace(-1.0, 1.0, 21)
    curve = find_load_curve(
        hexapod(), POSES[:1], [0, 0, 300.0, 0, 0, 0], np.r_[there, there[::-1]]
    )
    z = curve.twist[0, 2]
    stiff = curve.stiffness[0, 2, 2]
    assert z[:21] == pytest.approx(z[21:][::-1], rel=1e-12, abs=1e-18)
    assert z[:21] == pytest.approx(-z[:21][::-1], rel=1e-9, abs=1e-15)
    assert (np.diff(z[:21]) > 0.0).all()
    assert stiff[10] == 0.0  # unloaded within the backlash
    assert stiff[20] == pytest.approx(2.0 * stiff[11])  # the curve's second slope


def test_the_load_curve_of_linear_drives_is_a_straight_line():
    m = read("stewart")
    wrench = np.array([0, 0, 300.0, 0, 0, 0])
    curve = find_load_curve(m, POSES, wrench, [-1.0, 0.5, 1.0])
    full = deflection(m, POSES, wrench).twist
    np.testing.assert_allclose(
        curve.twist, full[..., None] * [-1.0, 0.5, 1.0], atol=1e-15
    )
    tangents = np.moveaxis(curve.stiffness, 3, 0)
    np.testing.assert_allclose(
        tangents, np.broadcast_to(stiffness(m, POSES), tangents.shape), rtol=1e-9
    )


def test_weight_takes_up_the_backlash():
    """Unloaded the tool is loose; under its weight the tangent stiffness is that of the segments where drives stand."""
    m = hexapod(weight=10.0)
    loose = analyse(m, POSES[:1])
    assert loose.mobility[0] == 6
    found = analyse(m, POSES[:1], gravity="exact")
    assert found.mobility[0] == 0
    assert np.isfinite(found.sag).all()
    linear = {
        k: replace(
            m,
            joints=tuple(
                replace(j, drive=Drive(k)) if j.drive else j for j in m.joints
            ),
        )
        for k in (1e7, 2e7)
    }
    bounds = [
        stiffness(linear[k], POSES[:1], gravity="exact")[0, 2, 2] for k in (1e7, 2e7)
    ]
    assert bounds[0] * (1 - 1e-4) <= found.matrix[0, 2, 2] <= bounds[1] * (1 + 1e-4)
    assert found.sag == pytest.approx(sag(m, POSES[:1]), abs=1e-15)


def sled(law):
    joint = Joint(
        "drive",
        "ground",
        "sled",
        "prismatic",
        np.zeros(3),
        np.eye(3)[0],
        drive=Drive(law.slopes[0], law=law),
    )
    return Mechanism(
        (Body("sled", 1.0, np.zeros(3)),), (joint,), Tool("sled", np.zeros(3), ("x",))
    )


@pytest.mark.parametrize("force", [0.0, 1e-9, 5.0, 20.0, 80.0, -300.0])
def test_one_drive_in_closed_form(force):
    law = Law.from_curve(CURVE, GAP)
    moved = deflection(sled(law), [[0.0]], [force, 0, 0, 0, 0, 0]).twist[0, 0]
    at = (
        np.interp(abs(force), [0.0, 20.0, 140.0, 1140.0], [0.0, 2e-6, 8e-6, 58e-6])
        + GAP / 2
    )
    assert moved == pytest.approx(np.sign(force) * at, rel=1e-12)
    assert law.force(np.array([moved]))[0] == pytest.approx(force, rel=1e-9, abs=1e-11)


def test_a_force_that_is_hardly_any_has_an_equilibrium():
    weak = [
        deflection(sled(Law.from_curve(CURVE)), [[0.0]], [force, 0, 0, 0, 0, 0]).twist
        for force in (0, 1e-300)
    ]
    np.testing.assert_allclose(*weak, atol=1e-30)


def test_a_compliance_in_series_adds_to_the_deflection_at_every_force():
    law = Law.from_curve(CURVE, GAP)
    softer = law.add_compliance(3e-8)
    for theta in np.linspace(-1e-4, 1e-4, 11):
        f = law.force(np.array([theta]))
        assert softer.force(theta + 3e-8 * f) == pytest.approx(f, rel=1e-12)
        assert law.energy(np.array([theta]))[0] == pytest.approx(
            np.trapezoid(
                law.force(np.linspace(0, theta, 4001)), np.linspace(0, theta, 4001)
            ),
            rel=1e-5,
        )
    with pytest.raises(InputError, match="expected a drive that yields"):
        law.add_compliance(-1e-6)


def test_a_straight_curve_is_a_linear_drive():
    law = Law.from_curve([[1e-6, 20.0], [3e-6, 60.0]])
    straight = hexapod(curve=[[1e-6, 20.0], [3e-6, 60.0]], backlash=0.0)
    linear = read("stewart")
    assert len(law.slopes) == 1
    wrench = [10.0, 20, 30, 1, 2, 3]
    assert np.allclose(
        deflection(straight, POSES, wrench).twist,
        deflection(linear, POSES, wrench).twist,
        rtol=1e-12,
    )
    for gravity in ("none", "exact"):
        assert np.allclose(
            stiffness(straight, POSES, gravity=gravity),
            stiffness(linear, POSES, gravity=gravity),
            rtol=1e-10,
            atol=1e-6,
        )


@pytest.mark.parametrize("turned", [0.0, 0.7])
@pytest.mark.parametrize("carrier", ["first", "second"])
def test_a_guide_tilts_the_tool_about_the_place_of_the_body_that_carries_it(
    carrier, turned
):
    """1/C = 1/(radial + tilting · lever²); the lever grows by the stroke where the first carries it."""
    radial = 2e-9
    tilting = 3e-7
    lever = 0.25
    axis = np.array([np.cos(turned), np.sin(turned), 0.0])
    stage = Joint(
        "way",
        "ground",
        "table",
        "prismatic",
        [0, 0, 0],
        axis,
        drive=Drive(1e8),
        compliance=np.diag([0.0, radial, radial, tilting, tilting, tilting]),
        carried_by=carrier,
    )
    m = Mechanism((Body("table"),), (stage,), Tool("table", lever * axis, ("x",)))
    strokes = np.array([-0.1, 0.0, 0.3, 0.4, 0.45, 0.5])  # more than are done singly
    state = analyse(m, (lever + strokes)[:, None] * axis[0])
    reach = lever + (strokes if carrier == "first" else 0.0 * strokes)
    expected = 1.0 / (radial + tilting * reach**2)
    assert state.alone[:, 2] == pytest.approx(expected, rel=1e-9)
    assert state.compliance[:, 0, 0] == pytest.approx(
        axis[0] ** 2 / 1e8 + (axis[1] ** 2 * (radial + tilting * reach**2)), rel=1e-9
    )
