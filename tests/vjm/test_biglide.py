"""The Biglide against a direct-stiffness model on another principle, its kinematics, and bad input."""

from dataclasses import replace

import numpy as np
import pytest

from stiffscope.errors import InputError
from stiffscope.report.html import stiffness_html
from stiffscope.vjm.analysis import analyse, stiffness
from stiffscope.vjm.biglide import Biglide, link_angle, pose_at, reachable, slides, tool_point
from stiffscope.vjm.deflection import deflection, load_deflection
from stiffscope.vjm.elastic import Parallel, Series, Spring, drive
from stiffscope.vjm.screws import Frame
from stiffscope.vjm.uncertainty import stiffness_error
from tests.robots import DRIVE, GEOMETRY, euler_bernoulli, published_slider, random_compliance, random_poses
from tests.vjm.direct_stiffness import biglide

MIRROR = np.diag([-1.0, 1.0, 1.0, 1.0, -1.0, -1.0])


def test_agrees_with_direct_stiffness_for_random_full_components(rng):
    poses = random_poses(rng, 200)
    link = random_compliance(rng, euler_bernoulli())
    slider = random_compliance(rng, published_slider())
    ours = stiffness(Biglide(GEOMETRY, link, slider, DRIVE), poses)
    theirs = np.array([biglide(GEOMETRY, link, slider, DRIVE, p) for p in poses])
    assert len(poses) == 200
    assert np.abs((ours - theirs) / scale(theirs)).max() < 1e-11
    large = np.abs(theirs) > 1e-3 * scale(theirs)  # the others are differences of large numbers in both models
    assert np.abs((ours / theirs - 1.0)[large]).max() < 1e-9


def scale(matrix):
    """Size of every entry of stiffnesses (n, 6, 6), by the principal entries of its row and column."""
    return np.sqrt(np.einsum("nii,njj->nij", matrix, matrix))


def test_mirror_poses_have_mirrored_stiffness(robot):
    left, right = stiffness(robot, [[-0.06, 0.1, 0.4], [0.06, 0.1, 0.4]])
    assert np.allclose(left, MIRROR @ right @ MIRROR, rtol=1e-12, atol=1e-4)


def test_kinematics_close(rng):
    poses = random_poses(rng, 100)
    assert np.allclose(tool_point(GEOMETRY, slides(GEOMETRY, poses)), poses, atol=1e-12)
    assert np.allclose(
        [pose_at(GEOMETRY, q, *p[:2]) for q, p in zip(link_angle(GEOMETRY, poses), poses, strict=True)], poses
    )


@pytest.mark.parametrize("gravity", ["none", "literal", "exact"])
def test_many_poses_at_once_agree_with_a_few(robot, rng, gravity):
    poses = random_poses(rng, 4000)
    some = poses[::100]
    alone = stiffness(robot, some, gravity=gravity)
    spread = stiffness(robot, poses, gravity=gravity)[::100]
    repeated = stiffness(robot, np.tile(some, (100, 1)), gravity=gravity)[-len(some) :]
    assert np.abs((spread - alone) / scale(alone)).max() < 1e-10
    assert np.abs((repeated - alone) / scale(alone)).max() < 1e-12


def test_what_no_series_can_follow_is_worked_out(rng):
    class Jagged:
        def stance(self, poses):
            return poses[:, 2:]

        def tree(self, poses):
            return Spring("spring", np.eye(6) * (1.5 + np.sign(poses[:, 2] - 0.3) + np.abs(poses[:, 2]))[:, None, None])

    poses = random_poses(rng, 20_000)
    assert np.allclose(stiffness(Jagged(), poses)[::50], stiffness(Jagged(), poses[::50]), rtol=1e-11)


@pytest.mark.parametrize("gravity", ["none", "literal", "exact"])
def test_no_poses_have_no_stiffness(robot, gravity):
    assert stiffness(robot, np.zeros((0, 3)), gravity=gravity).shape == (0, 6, 6)


def test_a_tree_that_holds_for_all_poses(rng):
    class Fixed:
        def stance(self, poses):
            return poses[:, :0]

        def tree(self, _poses):
            return Spring("spring", 1e-6 * np.eye(6))

    assert np.allclose(stiffness(Fixed(), random_poses(rng, 5)), 1e6 * np.eye(6))


@pytest.mark.parametrize(
    ("pose", "said"),
    [
        ((0.0, 0.0, 0.9), "z must lie between 0.055 and 0.555 m"),
        ((0.3, 0.0, 0.35), "limb1 must stay in"),
        ((0.0, np.nan, 0.35), "finite"),
        ((0.0, 0.35), r"\(n, 3\)"),
    ],
)
def test_bad_poses_are_named(robot, pose, said):
    with pytest.raises(InputError, match=said):
        stiffness(robot, pose)


@pytest.mark.parametrize(
    ("matrix", "said"),
    [
        (np.eye(5), "6x6"),
        (np.diag([1.0, 1, 1, 1, 1, -1]), "negative"),
        (np.eye(6) + np.eye(6, k=1), "not symmetric, C12"),
        (np.ones((6, 6)), "not positive definite"),
        (np.full((6, 6), np.nan), "finite"),
    ],
)
def test_bad_matrices_are_named(robot, matrix, said):
    with pytest.raises(InputError, match=f"link compliance.*{said}"):
        replace(robot, link=matrix)


def test_energy_shares_sum_to_one_and_to_the_work(robot, rng):
    poses = random_poses(rng, 20)
    wrench = rng.normal(size=(20, 6)) * [300, 300, 300, 30, 30, 30]
    state = deflection(robot, poses, wrench)
    assert np.allclose(sum(state.shares.values()), 1.0, atol=1e-12)
    work = 0.5 * np.einsum("ni,nij,nj->n", wrench, np.linalg.inv(stiffness(robot, poses)), wrench)
    assert np.allclose(state.energy, work, rtol=1e-9)


def test_backlash_shifts_by_the_half_width_towards_the_force(robot):
    free = load_deflection(robot, [0, 0, 0.35], [0, 100, 0, 0, 0, 0], [-1, 0, 1], {"stage.actuator": 0.0})
    loose = load_deflection(robot, [0, 0, 0.35], [0, 100, 0, 0, 0, 0], [-1, 0, 1], {"stage.actuator": 5e-5})
    assert np.allclose(loose - free, np.outer([-5e-5, 0, 5e-5], [0, 1, 0, 0, 0, 0]), atol=1e-15)


def test_both_slides_loose_let_the_tool_slide_with_them(robot):
    gaps = {"limb1.actuator": 5e-6, "limb2.actuator": 5e-6}
    tight = load_deflection(robot, [0.02, 0, 0.4], [80, 0, 0, 0, 0, 0], [1.0], {"limb1.actuator": 0.0})
    loose = load_deflection(robot, [0.02, 0, 0.4], [80, 0, 0, 0, 0, 0], [1.0], gaps)
    assert np.allclose(loose - tight, [[5e-6, 0, 0, 0, 0, 0]], atol=1e-15)


def test_redundant_drives_take_up_their_gaps_one_after_the_other():
    """A soft drive beside a stiff one that has the wider gap: the soft one carries alone until it is closed."""
    (soft, stiff), (near, far) = (1e5, 1e9), (1e-5, 3e-5)
    x = np.eye(6)[0]

    class Pair:
        def tree(self, poses):
            rest = np.diag([0.0, *[1e-9] * 5])
            sides = [Series(n, (drive(f"{n}.drive", k, x), Spring(n, rest))) for n, k in (("a", soft), ("b", stiff))]
            return Parallel("pair", tuple(sides), Frame(translation=0.0 * poses))

        def stance(self, poses):
            return poses

    gaps = {"a.drive": near, "b.drive": far}
    moved = load_deflection(Pair(), np.zeros(3), x, [-1.0, 0.0, 1.0, 3.0], gaps)[:, 0]
    alone, both = near + 1 / soft, (3 + soft * near + stiff * far) / (soft + stiff)
    assert moved == pytest.approx([-alone, 0.0, alone, both], rel=1e-8)
    assert load_deflection(Pair(), np.zeros(3), x, [1.0], {})[0, 0] == pytest.approx(1 / (soft + stiff), rel=1e-9)
    with pytest.raises(InputError, match=r"no element 'c\.drive'"):
        load_deflection(Pair(), np.zeros(3), x, [1.0], {"c.drive": near})


def test_analysis_reports_sag_and_mobility(robot):
    state = analyse(robot, [[0, 0, 0.35]], gravity="exact")
    assert state.mobility.tolist() == [0]
    assert state.sag[0, 2] > 1e-5
    assert not analyse(robot, [[0, 0, 0.35]]).sag.any()
    assert "Stiffness at M" in stiffness_html(state)


def test_reachable_agrees_with_what_is_refused(robot, rng):
    points = np.column_stack([rng.uniform(-0.3, 0.3, 300), np.zeros(300), rng.uniform(0.0, 0.6, 300)])
    for point, inside in zip(points, reachable(GEOMETRY, points), strict=True):
        if inside:
            stiffness(robot, point)
        else:
            with pytest.raises(InputError):
                stiffness(robot, point)


def test_component_error_bars_bound_what_they_can_do_to_the_robot(robot, rng):
    """First-order bound against the robot with components moved anywhere within their bars."""
    poses = random_poses(rng, 5)
    bars = [1e-4 * np.sqrt(np.outer(np.diagonal(c), np.diagonal(c))) for c in (robot.link, robot.slider)]
    bound, plain = stiffness_error(robot, poses, *bars), stiffness(robot, poses)
    reached = np.zeros_like(bound)
    for _ in range(40):
        signs = [np.sign(s + s.T) for s in rng.normal(size=(2, 6, 6))]
        moved = replace(robot, link=robot.link + signs[0] * bars[0] / 4, slider=robot.slider + signs[1] * bars[1] / 4)
        change = 4 * np.abs(stiffness(moved, poses) - plain)
        reached = np.maximum(reached, change)
        assert (change <= 1.02 * bound + 1e-6).all()
    assert (np.diagonal(reached, axis1=1, axis2=2) > 0.1 * np.diagonal(bound, axis1=1, axis2=2)).all()
