"""Natural frequencies against a dense model of their own, textbook beams, and the laws of vibration."""

from dataclasses import replace

import numpy as np
import pytest

from stiffscope.cad.cross_sections import circle
from stiffscope.errors import InputError
from stiffscope.fea.beam import timoshenko
from stiffscope.robot.beam_dynamics import beam_dynamics
from stiffscope.vjm.model.bodies import Body, member
from stiffscope.vjm.model.dynamics import Dynamics
from stiffscope.vjm.model.joints import Drive, Joint
from stiffscope.vjm.model.mechanism import Mechanism, Tool
from stiffscope.vjm.vibration.modes import frequencies, modes
from tests.robots import GEOMETRY, euler_bernoulli, pose_at, random_poses
from tests.vjm import dense_modes
from tests.vjm.files import CHECKED, biglide, read, serial_arm
from tests.vjm.test_rigid_directions import PLANAR_2R


def inertia(rng, size):
    """A random inertia that a body can have."""
    points = rng.normal(size=(6, 3)) * size
    return sum((p @ p) * np.eye(3) - np.outer(p, p) for p in points)


def framed(m, rng, modal=0):
    """The mechanism with frame elements' consistent masses on its elastic bodies, and inertias on its rigid ones."""
    bodies = []
    for b in m.bodies:
        if b.elastic is None:
            centre = m.tool.at if b.centre is None else b.centre
            bodies.append(
                replace(
                    b, mass=b.mass or 1.5, centre=centre, inertia=inertia(rng, 0.05)
                )
            )
            continue
        length = max(float(np.linalg.norm(b.elastic.tip - b.elastic.base)), 0.1)
        mass = dense_modes.frame_mass(length, 5e-4, 2e-8)
        squares = (2 * np.pi * np.linspace(150.0, 900.0, modal)) ** 2
        whole = np.zeros((12 + modal, 12 + modal))
        whole[:12, :12] = mass
        coupled = rng.normal(size=(12, modal)) * np.sqrt(np.diagonal(mass))[:, None]
        whole[12:, 12:] = np.eye(modal)
        whole[12:, :12] = 0.1 * coupled.T
        whole[:12, 12:] = 0.1 * coupled
        whole[:12, :12] += 0.01 * coupled @ coupled.T
        bodies.append(
            replace(b, elastic=replace(b.elastic, dynamics=Dynamics(whole, squares)))
        )
    return replace(m, bodies=tuple(bodies))


def rigid_hexapod(rng):
    """A platform on six rigid legs of two bodies each, all with inertia, drives as springs: a simulator's model."""
    m = read("stewart")
    bodies = [Body("platform", 4.0, m.tool.at, inertia(rng, 0.1))]
    joints = []
    for k in range(1, 7):
        foot, drive, head = (
            m.joint(f"strut{k}.{end}") for end in ("foot", "drive", "head")
        )
        for name, at in (("lower", foot.at), ("upper", head.at)):
            bodies.append(Body(f"leg{k}.{name}", 0.3, at, inertia(rng, 0.02)))
        joints += [
            Joint(
                foot.name,
                "ground",
                f"leg{k}.lower",
                "universal",
                foot.at,
                foot.axis,
                foot.axis2,
            ),
            Joint(
                drive.name,
                f"leg{k}.lower",
                f"leg{k}.upper",
                "prismatic",
                drive.at,
                drive.axis,
                drive=drive.drive,
            ),
            Joint(head.name, f"leg{k}.upper", "platform", "spherical", head.at),
        ]
    return Mechanism(tuple(bodies), tuple(joints), m.tool, m.gravity)


def five_bar(rng):
    """A planar robot of four rigid bars in revolute joints: overconstrained in space."""
    a = np.array([0.12, 0, 0])
    b = np.array([0.2, 0.21, 0])
    tool = np.array([0.0, 0.47, 0])
    mirror = np.diag([-1.0, 1, 1])
    bodies = []
    joints = []
    for side, turn in (("right", np.eye(3)), ("left", mirror)):
        for bar, ends in (("inner", (a, b)), ("outer", (b, tool))):
            bodies.append(
                Body(
                    f"{side}.{bar}",
                    0.8,
                    turn @ np.mean(ends, axis=0),
                    inertia(rng, 0.04),
                )
            )
        axis = [0, 0, 1]
        joints += [
            Joint(
                f"{side}.motor",
                "ground",
                f"{side}.inner",
                "revolute",
                turn @ a,
                axis,
                drive=Drive(5e3),
            ),
            Joint(
                f"{side}.elbow",
                f"{side}.inner",
                f"{side}.outer",
                "revolute",
                turn @ b,
                axis,
            ),
        ]
    joints.append(Joint("wrist", "right.outer", "left.outer", "revolute", tool, axis))
    return Mechanism(tuple(bodies), tuple(joints), Tool("left.outer", tool, ("x", "y")))


def spinning_legs(rng):
    """The same on a ball at either end: every leg spins idly, with inertia."""
    m = rigid_hexapod(rng)
    balls = [
        replace(j, kind="spherical", axis=None, axis2=None)
        if j.kind == "universal"
        else j
        for j in m.joints
    ]
    return replace(m, joints=tuple(balls))


HEXAPOD = [0.01, -0.02, 0.01, 0.1, -0.05, 0.2]
ROBOTS = {
    "hexapod, rigid legs": (rigid_hexapod, lambda m: m.tool.home + HEXAPOD),
    "hexapod, legs that spin": (spinning_legs, lambda m: m.tool.home),
    "serial arm, frames": (
        lambda rng: framed(serial_arm(), rng),
        lambda _: [0.85, 0.1, 1.1, 0.1, 0.05, -0.1],
    ),
    "serial arm, rigid": (
        lambda rng: framed(serial_arm(elastic=False), rng),
        lambda m: m.tool.home,
    ),
    "biglide, frames": (
        lambda rng: framed(biglide(), rng),
        lambda _: pose_at(GEOMETRY, 0.7, 0.05, 0.02),
    ),
    "biglide, frames with modes": (
        lambda rng: framed(biglide(), rng, 3),
        lambda _: pose_at(GEOMETRY, 0.7, 0.05, 0.1),
    ),
    "biglide, half at either end": (
        lambda _: biglide(),
        lambda _: pose_at(GEOMETRY, 1.0),
    ),
    "linear delta": (
        lambda rng: framed(read("linear-delta"), rng, 2),
        lambda _: CHECKED["linear-delta"]["poses"][1],
    ),
    "braced gantry": (
        lambda rng: framed(read("braced-gantry"), rng),
        lambda _: CHECKED["braced-gantry"]["poses"][1],
    ),
    "five-bar": (five_bar, lambda _: [0.05, 0.43]),
}


@pytest.mark.parametrize("drives", ["held", "free"])
@pytest.mark.parametrize("name", ROBOTS)
def test_frequencies_are_those_of_a_dense_model(name, drives, rng):
    make, pose_of = ROBOTS[name]
    m = make(rng)
    pose = pose_of(m)
    expected = dense_modes.frequencies(m, pose, drives=drives)
    found = frequencies(m, pose, 10, drives=drives)[0]
    found = found[np.isfinite(found)]
    elastic = expected[expected > 0.0]
    moving = found[found > 0.0]
    assert len(moving) >= min(4, len(elastic))
    assert moving == pytest.approx(
        elastic[: len(moving)], rel=1e-5
    )  # the dense model rounds by some 1e-6
    free = 0 if drives == "held" else len(m.drives)
    assert (found == 0.0).sum() == min(free, 10)
    assert (expected == 0.0).sum() >= free  # idle motions besides


def test_many_poses_have_the_modes_of_each(rng):
    """Subspace iteration over poses, and every pose by itself in full."""
    m = framed(biglide(), rng, 4)
    poses = np.vstack([random_poses(rng, 30), [[2.0, 0.0, 0.4]]])
    whole = modes(m, poses, 6)
    assert np.isnan(whole.frequencies[-1]).all()
    for k in range(0, 30, 7):
        one = modes(m, poses[k], 6)
        assert whole.frequencies[k] == pytest.approx(one.frequencies[0], rel=1e-10)
        assert np.allclose(
            whole.tool[k], one.tool[0], atol=1e-5 * np.abs(one.tool).max()
        )
    assert np.array_equal(frequencies(m, poses, 6)[:30], whole.frequencies[:30])
    assert sum(whole.energy.values())[:30] == pytest.approx(np.ones((30, 6)))


@pytest.mark.parametrize("radius", [0.002, 0.02])
def test_a_beam_has_its_textbook_frequencies(radius):
    """A clamped rod: (β L)² sqrt(EI / ρ A L⁴), β L = 1.8751, 4.6941, 7.8548, where slender; axially sqrt(E/ρ) / 4 L."""
    e = 211e9
    g = 81e9
    density = 7850.0
    section = circle(radius)
    dynamics = beam_dynamics([(0.4, section), (0.6, section)], e, g, density, 14)
    assert dynamics.total == pytest.approx(density * section.area)
    rod = member(
        "rod", [0, 0, 0], [1, 0, 0], timoshenko(1.0, section, e, g), dynamics=dynamics
    )
    slide = Joint(
        "slide",
        "ground",
        "rod.base",
        "prismatic",
        [0, 0, 0],
        [1, 0, 0],
        drive=Drive(1e15),
    )
    m = Mechanism((rod,), (slide,), Tool("rod.tip", [1, 0, 0], ("x",)))
    found = modes(m, [[1.0]], 20)
    if radius < 0.01:
        bending = np.array([1.875104, 4.694091, 7.854757]) ** 2
        bending *= np.sqrt(e * section.bending_y / (density * section.area)) / (
            2 * np.pi
        )
        assert found.frequencies[0, :6] == pytest.approx(
            np.repeat(bending, 2), rel=2e-4
        )
    else:
        axial = np.sqrt(e / density) / 4
        nearest = found.frequencies[
            0, np.nanargmin(np.abs(found.frequencies[0] - axial))
        ]
        assert nearest == pytest.approx(
            axial, rel=5e-3
        )  # one axial mode between its ends


def test_more_mass_lowers_and_more_stiffness_raises_every_frequency(rng):
    m = framed(serial_arm(), rng)
    pose = [0.85, 0.1, 1.1, 0.1, 0.05, -0.1]
    before = frequencies(m, pose, 8)[0]
    link = m.body("link3")
    heavier = replace(
        link,
        elastic=replace(
            link.elastic, dynamics=link.elastic.dynamics.scale_density(1.3)
        ),
    )
    softer = replace(
        link, elastic=replace(link.elastic, compliance=1.3 * link.elastic.compliance)
    )
    for changed in (heavier, softer):
        after = frequencies(
            replace(m, bodies=tuple(changed if b is link else b for b in m.bodies)),
            pose,
            8,
        )[0]
        assert (after <= before * (1 + 1e-12)).all()
        assert after[0] < before[0] * (1 - 1e-4)


def test_error_bars_are_what_a_change_of_the_parts_does(rng):
    m, pose = framed(biglide(), rng), pose_at(GEOMETRY, 0.7, 0.05)
    bound = np.zeros((6, 6))
    bound[4, 4] = 1e-5 * m.body("limb1.link1").elastic.compliance[4, 4]

    def with_links(change, error=None):
        return replace(
            m,
            bodies=tuple(
                replace(
                    b,
                    elastic=replace(
                        b.elastic, compliance=b.elastic.compliance + change, error=error
                    ),
                )
                if "link" in b.name
                else b
                for b in m.bodies
            ),
        )

    found = modes(with_links(0.0, bound), pose, 6)
    after = frequencies(with_links(bound), pose, 6)
    assert found.frequencies - after == pytest.approx(found.error, rel=2e-3, abs=1e-9)
    sign = rng.choice([-1.0, 1.0], size=(6, 6))
    full = 1e-5 * np.abs(m.body("limb1.link1").elastic.compliance)
    found = modes(with_links(0.0, full), pose, 6)
    after = frequencies(
        with_links(np.triu(sign * full) + np.triu(sign * full, 1).T), pose, 6
    )
    assert (np.abs(found.frequencies - after) <= found.error).all()
    assert not modes(m, pose, 6).error.any()


def test_error_bars_count_the_parts_own_modes(rng):
    """A change of their squares by their bounds does what the error bar says, to first order."""
    m, pose = framed(biglide(), rng, 3), pose_at(GEOMETRY, 0.7, 0.05)

    def with_squares(change, told):
        return replace(
            m,
            bodies=tuple(
                b
                if b.elastic is None
                else replace(
                    b,
                    elastic=replace(
                        b.elastic,
                        dynamics=Dynamics(
                            b.elastic.dynamics.mass,
                            (1 - change) * b.elastic.dynamics.squares,
                            told * b.elastic.dynamics.squares,
                        ),
                    ),
                )
                for b in m.bodies
            ),
        )

    found = modes(with_squares(0.0, 1e-6), pose, 12)
    after = frequencies(with_squares(1e-6, 0.0), pose, 12)
    assert found.error.max() > 1e-7 * found.frequencies.max()
    assert found.frequencies - after == pytest.approx(found.error, rel=2e-3, abs=1e-9)


def test_idle_motions_are_named_and_bodies_without_inertia():
    m = read("braced-gantry")
    found = modes(m, m.tool.home, 4)
    assert "spins between" in found.remarks[0]
    assert (found.frequencies > 0.0).all()
    arm = serial_arm(elastic=False)
    bare = replace(arm, bodies=tuple(replace(b, mass=0.0) for b in arm.bodies))
    with pytest.raises(
        InputError,
        match=r"bodies\.link1, .*: expected a mass on a body that can move, got none",
    ):
        modes(bare, arm.tool.home)
    flange = replace(arm, bodies=(*arm.bodies[:-1], replace(arm.bodies[-1], mass=0.0)))
    with pytest.raises(
        InputError,
        match=r"bodies\.link6: expected a mass and inertia to move freely, got none",
    ):
        modes(flange, arm.tool.home, drives="free")
    assert (
        modes(flange, arm.tool.home, 3).frequencies > 0.0
    ).all()  # held, it follows statically
    (few,) = modes(flange, arm.tool.home, 8).remarks
    assert "all else is rigid or has no inertia (without mass: bodies.link6" in few
    with pytest.raises(InputError, match="count: expected at least 1"):
        modes(arm, arm.tool.home, 0)


def test_directions_that_are_rigid_do_not_lack_inertia():
    assert modes(PLANAR_2R, PLANAR_2R.tool.home).remarks == (
        "2 modes, not 6: all else is rigid",
    )


def test_a_mass_on_a_spring():
    slide = Joint(
        "slide", "ground", "car", "prismatic", [0, 0, 0], [1, 0, 0], drive=Drive(4e6)
    )
    m = Mechanism(
        (Body("car", 2.5, [0.3, 0, 0]),), (slide,), Tool("car", [0.1, 0, 0], ("x",))
    )
    found = modes(m, [[0.1], [0.2]], 1)
    assert found.frequencies[:, 0] == pytest.approx(np.sqrt(4e6 / 2.5) / (2 * np.pi))
    assert found.tool[0, :, 0] == pytest.approx([1 / np.sqrt(2.5), 0, 0, 0, 0, 0])
    assert found.energy["slide"][:, 0] == pytest.approx(1.0)
    assert modes(m, [[0.1]], 1, drives="free").frequencies[0, 0] == 0.0


def test_a_bar_that_spins_with_hardly_any_inertia_leaves_the_modes_of_the_rest():
    """Two carriages in line with a bar between balls move as one mass; its spin is idle."""
    way = np.array([0.6, 0.48, 0.64])
    ends = {"one": np.array([0.1, 0.2, 0.3]), "two": np.array([0.313, -0.127, 0.411])}
    along = ends["two"] - ends["one"]
    along = along / np.linalg.norm(along)
    thin = 1e-3 * (np.eye(3) - (1.0 - 1e-9) * np.outer(along, along))
    bodies = [Body(name, 2.0, at, 1e-3 * np.eye(3)) for name, at in ends.items()]
    bodies.append(Body("bar", 1.0, 0.5 * (ends["one"] + ends["two"]), thin))
    joints = [
        Joint(f"way-{name}", "ground", name, "prismatic", at, way)
        for name, at in ends.items()
    ]
    joints[0] = replace(joints[0], drive=Drive(4e6))
    joints += [Joint(f"ball-{n}", n, "bar", "spherical", at) for n, at in ends.items()]
    m = Mechanism(tuple(bodies), tuple(joints), Tool("two", ends["two"], ("x",)))
    found = modes(m, m.tool.home, 3)
    expected = np.sqrt(4e6 / 5.0) / (2 * np.pi)
    assert found.frequencies[0, 0] == pytest.approx(expected, rel=1e-9)
    assert np.isnan(found.frequencies[0, 1:]).all()
    assert found.remarks[-1] == "1 mode, not 3: all else is rigid"


def test_a_matrix_part_has_half_of_its_mass_at_either_end():
    c = euler_bernoulli(0.4, 0.01)
    rod = member("rod", [0, 0, 0], [0.4, 0, 0], c, mass=3.0)
    slide = Joint(
        "slide",
        "ground",
        "rod.base",
        "prismatic",
        [0, 0, 0],
        [1, 0, 0],
        drive=Drive(1e15),
    )
    m = Mechanism((rod,), (slide,), Tool("rod.tip", [0.4, 0, 0], ("x",)))
    expected = np.sqrt(1.0 / (c[1, 1] * 1.5)) / (2 * np.pi)
    assert frequencies(m, [[0.4]], 2)[0] == pytest.approx([expected, expected])
