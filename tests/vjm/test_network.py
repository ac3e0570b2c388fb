"""Elastic networks: laws, random mechanisms against the dense oracle, checked figures."""

import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from stiffscope.errors import InputError
from stiffscope.vjm.kinematics.configurations import configure
from stiffscope.vjm.kinematics.linkage import Linkage
from stiffscope.vjm.model.bodies import Body, member
from stiffscope.vjm.model.checks import TOOL
from stiffscope.vjm.model.joints import Drive, Joint
from stiffscope.vjm.model.mechanism import Change, Mechanism, Tool
from stiffscope.vjm.network.condensation import condense_network
from stiffscope.vjm.network.order import find_order, places_at_home
from stiffscope.vjm.statics.analysis import batches, sag, stiffness, stiffness_error
from stiffscope.vjm.statics.equilibrium import solve_loads, tool_stiffness
from stiffscope.vjm.statics.prestress import own_loads
from stiffscope.vjm.statics.singularity import count_freedoms, principal
from stiffscope.vjm.statics.yielding import Load, respond
from tests.robots import (
    GEOMETRY,
    euler_bernoulli,
    published_slider,
    random_compliance,
    random_poses,
)
from tests.vjm import direct_stiffness, oracle
from tests.vjm.files import CHECKED, biglide, read, serial_arm

SIX = ("x", "y", "z", "rx", "ry", "rz")


def off(a, b):
    """Largest difference over sqrt(K_ii K_jj)."""
    size = np.sqrt(np.abs(np.einsum("...ii->...i", b)))
    return float(
        np.abs(
            (a - b) / np.maximum(size[..., :, None] * size[..., None, :], 1e-300)
        ).max()
    )


def at_home(m):
    return tool_stiffness(
        condense_network(find_order(m, Linkage(m, "drives")), places_at_home(m))
    )[0]


@pytest.mark.parametrize("name", CHECKED)
def test_checked_figures(name):
    known = CHECKED[name]
    m = read(name)
    assert off(stiffness(m, known["poses"]), np.array(known["stiffness"])) < 1e-8
    expected = np.array(known["sag"])
    assert (
        np.abs(sag(m, known["poses"]) - expected).max() < 1e-3 * np.abs(expected).max()
    )


@pytest.mark.parametrize("name", CHECKED)
def test_the_dense_oracle_agrees_to_rounding(name):
    m = read(name)
    poses = CHECKED[name]["poses"]
    for k, droop, pose in zip(stiffness(m, poses), sag(m, poses), poses, strict=True):
        bodies = oracle.Bodies(m).close(pose)
        expected, twist, _ = oracle.solve(bodies, oracle.weights(bodies))
        assert off(k, expected) < 1e-10
        assert np.allclose(droop, twist, rtol=0.0, atol=1e-9 * np.abs(twist).max())


def test_stewart_compliance_is_the_published_one():
    """tdehaeze, stewart-simscape, org/dynamics-study.org."""
    m = read("stewart")
    c = np.linalg.inv(stiffness(m, m.tool.home)[0])
    assert np.diagonal(c) == pytest.approx(
        [4.75e-8, 4.75e-8, 2.099e-8, 5.1863e-6, 5.1863e-6, 1.7073e-6], rel=1e-4
    )
    assert c[0, 4] == pytest.approx(3.2093e-7, rel=1e-4)


def test_biglide_agrees_with_33_explicit_freedoms(rng):
    link = random_compliance(rng, euler_bernoulli())
    slider = random_compliance(rng, published_slider())
    m = biglide(link, slider)
    poses = random_poses(rng, 20)
    expected = [
        direct_stiffness.biglide(GEOMETRY, link, slider, 1.27e7, p) for p in poses
    ]
    assert off(stiffness(m, poses), np.array(expected)) < 1e-8


def test_hexapod_is_its_jacobian():
    """J^T k J with the struts' Plücker lines, at a rotated pose."""
    m = read("stewart")
    pose = np.array([0.004, -0.003, 0.138, 0.05, -0.08, 0.03])
    found = configure(m, pose)
    rows = []
    for k in range(1, 7):
        (foot, head) = (m.joint(f"strut{k}.{end}").at for end in ("foot", "head"))
        r, p = found.frame("platform")
        head = r[0] @ head + p[0]
        along = (head - foot) / np.linalg.norm(head - foot)
        rows.append(np.concatenate([along, np.cross(head - pose[:3], along)]))
    j = np.array(rows)
    assert off(stiffness(m, pose)[0], 2e7 * j.T @ j) < 1e-11


def test_serial_arm_is_its_jacobian():
    """J C J^T with rigid links, axes carried by the joints before them."""
    m = serial_arm(elastic=False)
    pose = np.array([0.85, 0.1, 1.1, 0.1, 0.05, -0.1])
    found = configure(m, pose).require_valid()
    c = np.zeros((6, 6))
    for joint in m.joints:
        r, p = (
            (np.eye(3), np.zeros(3))
            if joint.first == "ground"
            else (a[0] for a in found.frame(joint.first))
        )
        axis = r @ joint.axes[:, 0]
        at = r @ joint.at + p
        screw = np.concatenate([np.cross(axis, pose[:3] - at), axis])
        c += np.outer(screw, screw) / joint.drive.stiffness
    assert off(stiffness(m, pose)[0], np.linalg.inv(c)) < 1e-11


def two_links(rng, **kinds):
    points = rng.normal(size=(3, 3))
    parts = [random_compliance(rng, np.diag([1e-8] * 3 + [1e-7] * 3)) for _ in range(2)]
    bodies = [
        member("a", points[0], points[1], parts[0]),
        member("b", points[1], points[2], parts[1]),
    ]
    return points, parts, bodies


def placed(body, compliance, tool):
    """Compliance of a body's tip seen from the tool point, base axes."""
    e = body.elastic
    r = np.kron(np.eye(2), e.axes)
    lever = oracle.skew(tool - e.tip)
    carry = np.block([[np.eye(3), -lever], [np.zeros((3, 3)), np.eye(3)]])
    return carry @ r @ compliance @ r.T @ carry.T


def test_series_adds_compliances(rng):
    points, parts, bodies = two_links(rng)
    joints = (
        Joint("one", "ground", "a.base", "fixed", points[0]),
        Joint("two", "a.tip", "b.base", "fixed", points[1]),
    )
    m = Mechanism(tuple(bodies), joints, Tool("b.tip", points[2], ("x",)))
    expected = sum(placed(b, c, points[2]) for b, c in zip(bodies, parts, strict=True))
    assert off(np.linalg.inv(at_home(m)), expected) < 1e-9


def test_parallel_adds_stiffnesses(rng):
    points, parts, bodies = two_links(rng)
    joints = (
        Joint("one", "ground", "a.base", "fixed", points[0]),
        Joint("two", "ground", "b.base", "fixed", points[1]),
        Joint("three", "a.tip", "plate", "fixed", points[1]),
        Joint("four", "b.tip", "plate", "fixed", points[2]),
    )
    m = Mechanism((*bodies, Body("plate")), joints, Tool("plate", np.zeros(3), ("x",)))
    expected = sum(
        np.linalg.inv(placed(b, c, np.zeros(3)))
        for b, c in zip(bodies, parts, strict=True)
    )
    assert off(at_home(m), expected) < 1e-9


def random_mechanism(seed):
    """A random graph of bodies: tree and loops, all kinds of joints, bearings, drives, offsets, masses."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(2, 7))
    bodies = []
    ends = ["ground"]
    for k in range(count):
        if rng.random() < 0.6:
            a = rng.normal(size=3)
            c = random_compliance(rng, np.diag([1e-8] * 3 + [1e-7] * 3))
            bodies.append(
                member(f"b{k}", a, a + rng.normal(size=3), c, mass=float(rng.random()))
            )
        else:
            bodies.append(Body(f"b{k}", float(rng.random()), rng.normal(size=3)))
    joints = []
    grown = ["ground"]

    def joint(name, first, second):
        kind = str(
            rng.choice(
                [
                    "fixed",
                    "revolute",
                    "prismatic",
                    "cylindrical",
                    "universal",
                    "spherical",
                    "planar",
                ]
            )
        )
        drive = (
            Drive(float(10 ** rng.uniform(6, 8)))
            if kind in ("revolute", "prismatic", "cylindrical")
            else None
        )
        drive = drive if rng.random() < 0.7 else None
        bearing = (
            random_compliance(rng, np.diag([1e-9] * 3 + [1e-8] * 3))
            if rng.random() < 0.4
            else None
        )
        offset = 1e-4 * rng.normal(size=6) if rng.random() < 0.3 else None
        axes = (rng.normal(size=3), rng.normal(size=3))
        return Joint(
            name, first, second, kind, rng.normal(size=3), *axes, drive, bearing, offset
        )

    for k, body in enumerate(bodies):
        nodes = list(body.nodes)
        rng.shuffle(nodes)
        joints.append(joint(f"j{k}", str(rng.choice(grown)), nodes[0]))
        grown += nodes
        ends = nodes
    for k in range(int(rng.integers(1, 6))):
        first, second = rng.choice(len(grown), 2, replace=False)
        pair = grown[first], grown[second]
        if len({p.split(".")[0] for p in pair}) == 2:
            joints.append(joint(f"loop{k}", *pair))
    grip = Change(np.diag([1e-8] * 3 + [1e-7] * 3)) if rng.random() < 0.7 else Change()
    tool = Tool(ends[-1], rng.normal(size=3), SIX)
    return Mechanism(tuple(bodies), tuple(joints), tool, rng.normal(size=3), grip=grip)


@pytest.mark.parametrize(
    "block", [0, 1, 2, *(pytest.param(k, marks=pytest.mark.long) for k in (3, 4))]
)
def test_random_mechanisms_against_the_dense_oracle(block):
    """Stiffness, and the sag where nothing moves freely; unit-free comparison, singular stiffness included."""
    compared = sagged = 0
    for seed in range(60 * block, 60 * block + 60):
        m = random_mechanism(seed)
        order = find_order(m, Linkage(m, "drives"))
        bodies = oracle.Bodies(m)
        try:
            k = tool_stiffness(condense_network(order, places_at_home(m)))[0]
        except InputError:  # infinite stiffness
            continue
        expected, twist, _ = oracle.solve(bodies, oracle.weights(bodies), offsets=True)
        size = np.sqrt(
            np.abs(np.diagonal(expected))
            + 1e-6 * np.abs(np.diagonal(expected)).max()
            + 1.0
        )
        assert np.abs((k - expected) / np.outer(size, size)).max() < 1e-6, seed
        compared += 1
        if count_freedoms(expected)[0] > 0:
            continue
        try:
            weight = replace(
                own_loads(order, places_at_home(m)), balanced=1e-6
            )  # friction holds no more
            response = solve_loads(order, places_at_home(m), weight)
        except InputError:  # something moves freely under its weight
            assert np.isnan(twist).all(), seed
            continue
        assert np.allclose(
            response.twist[0, :, 0],
            twist,
            rtol=0.0,
            atol=1e-5 * np.abs(twist).max() + 1e-13,
        ), seed
        sagged += 1
    assert compared > 40
    assert sagged > 5


def test_where_the_base_stands_does_not_matter(rng):
    """The whole robot turned and moved: the same stiffness in turned axes."""
    m = read("linear-delta")
    pose = np.array(CHECKED["linear-delta"]["poses"][1])
    turn = oracle.expm(rng.normal(size=3))
    move = rng.normal(size=3)
    joints = tuple(
        replace(
            j,
            at=turn @ j.at + move,
            axis=None if j.axis is None else turn @ j.axis,
            axis2=None if j.axis2 is None else turn @ j.axis2,
        )
        for j in m.joints
    )
    bodies = tuple(
        replace(b, centre=turn @ b.centre + move)
        if b.elastic is None
        else replace(
            b,
            elastic=replace(
                b.elastic,
                places=b.elastic.places @ turn.T + move,
                axes=turn @ b.elastic.axes,
            ),
        )
        for b in m.bodies
    )
    turned = Mechanism(
        bodies,
        joints,
        Tool("platform", turn @ m.tool.at + move, ("x", "y", "z")),
        turn @ m.gravity,
    )
    there = turn @ pose + move
    both = np.kron(np.eye(2), turn)
    assert (
        off(both.T @ stiffness(turned, there)[0] @ both, stiffness(m, pose)[0]) < 1e-10
    )
    assert np.allclose(
        both.T @ sag(turned, there)[0], sag(m, pose)[0], rtol=0.0, atol=1e-15
    )


def test_what_is_put_in_comes_out_as_energy(rng):
    m = biglide()
    poses = random_poses(rng, 5)
    state = respond(m, poses, np.eye(6))
    stored = sum(e.energy for e in state.elements.values())
    assert np.allclose(stored, 0.5 * np.einsum("nii->ni", state.twist), rtol=1e-9)
    assert np.allclose(
        state.twist, np.swapaxes(state.twist, -1, -2), rtol=0.0, atol=1e-18
    )


def test_a_force_anywhere_is_what_the_reciprocal_theorem_says(rng):
    """Betti: the twist of a body under a wrench at the tool, and of the tool under a wrench at the body."""
    m = read("braced-gantry")
    pose = [[0.0]]
    body = "left"
    at = m.body("left").centre
    tool = respond(m, pose, np.eye(6))
    there = [
        respond(m, pose, np.zeros(6), loads=(Load(body, w, at),)).twist[0, :, 0]
        for w in np.eye(6)
    ]
    lever = at - np.array([0.0, 0.01, 0.9])
    carry = np.block([[np.eye(3), -oracle.skew(lever)], [np.zeros((3, 3)), np.eye(3)]])
    moved = carry @ tool.nodes[body][0]
    assert np.allclose(moved, np.array(there), rtol=1e-9, atol=1e-18)


def test_redundant_constraints_and_idle_motions_are_ordinary():
    """A rod between two balls spins idly; a second one beside it adds; a third rigid tie adds no trouble."""
    tip = np.array([1.0, 0, 0])
    rods = []
    for k, y in enumerate((0.1, -0.1)):
        rods.append(
            member(
                f"rod{k}",
                [0, y, 0],
                [1, y, 0],
                np.diag([1e-8, 1e-6, 1e-6, 1e-5, 1e-5, 1e-5]),
            )
        )
    joints = [Joint("guide", "ground", "plate", "prismatic", tip, [1, 0, 0])]
    for k, rod in enumerate(rods):
        joints.append(
            Joint(f"rod{k}.a", "ground", f"rod{k}.base", "spherical", rod.elastic.base)
        )
        joints.append(
            Joint(f"rod{k}.b", f"rod{k}.tip", "plate", "spherical", rod.elastic.tip)
        )
    grip = Change(np.diag([1e-9] * 3 + [1e-8] * 3))
    m = Mechanism(
        (*rods, Body("plate")), tuple(joints), Tool("plate", tip, ("x",)), grip=grip
    )
    k = at_home(m)
    assert k[0, 0] == pytest.approx(1 / (1e-9 + 0.5e-8), rel=1e-9)
    assert np.diagonal(k)[1:] == pytest.approx([1e9] * 2 + [1e8] * 3, rel=1e-9)


def test_rigid_loops_are_constraints():
    """Parallelograms of rigid rods: the limit of ever stiffer ones."""
    m = read("linear-delta").change_elements(
        {TOOL: Change(np.diag([1e-8] * 3 + [1e-7] * 3))}
    )

    def links(factor):
        bodies = tuple(
            b
            if b.elastic is None
            else replace(
                b, elastic=replace(b.elastic, compliance=factor * b.elastic.compliance)
            )
            for b in m.bodies
        )
        return stiffness(replace(m, bodies=bodies), CHECKED["linear-delta"]["poses"])

    rigid = links(0.0)
    assert off(links(1e-9), rigid) < 1e-6


def test_infinite_stiffness_is_refused_by_name():
    guide = Joint(
        "guide", "ground", "sled", "prismatic", [0, 0, 0], [1, 0, 0], drive=Drive(1e6)
    )
    m = Mechanism((Body("sled"),), (guide,), Tool("sled", [0, 0, 0.1], ("x",)))
    with pytest.raises(
        InputError, match=r"infinite stiffness in a direction, through .*guide"
    ):
        stiffness(m, [[0.0]])


def test_a_free_tool_has_a_mobility_and_no_deflection():
    """A rod held by a ball turns about it in three ways."""
    rod = member("rod", [0, 0, 0], [1, 0, 0], euler_bernoulli(1.0))
    ball = Joint("ball", "ground", "rod.base", "spherical", [0, 0, 0])
    m = Mechanism((rod,), (ball,), Tool("rod.tip", [1, 0, 0], ("rx", "ry", "rz")))
    k = at_home(m)
    assert count_freedoms(k)[0] == 3
    for twist in principal(k)[1][:, :3].T:
        assert np.allclose(twist[:3], np.cross(twist[3:], [1, 0, 0]), atol=1e-9)
    with pytest.raises(InputError, match="moves freely in 3 direction"):
        respond(m, np.zeros(3), [0, 0, 1.0, 0, 0, 0])


def test_error_bars_bound_what_parts_may_be_off(rng):
    bar = 0.01 * np.sqrt(
        np.outer(np.diagonal(euler_bernoulli()), np.diagonal(euler_bernoulli()))
    )
    m, poses = biglide(), random_poses(rng, 3)

    def with_links(change, error):
        bodies = tuple(
            replace(
                b,
                elastic=replace(
                    b.elastic, compliance=b.elastic.compliance + change, error=error
                ),
            )
            if "link" in b.name
            else b
            for b in m.bodies
        )
        return replace(m, bodies=bodies)

    bound = stiffness_error(with_links(0.0, bar), poses)
    softer = stiffness(
        with_links(1e-3 * np.diag(np.diagonal(bar)), None), poses
    ) - stiffness(m, poses)
    assert (np.abs(softer) <= 1.001e-3 * bound + 1e-6).all()
    assert np.abs(softer).max() > 1e-5 * bound.max()


def test_batches_are_the_whole(rng):
    m = biglide()
    poses = random_poses(rng, 50)
    parts = list(batches(m, poses, size=20))
    assert [s.stop - s.start for s, _ in parts] == [20, 20, 20]
    assert np.allclose(
        np.concatenate([k for _, k in parts]), stiffness(m, poses), rtol=1e-9, atol=1e-4
    )


def test_wrenches_carry_the_offsets_through_indeterminate_loops():
    """Self-stress of a misfit: an overlong link of the Biglide, against the oracle, element by element."""
    m = biglide().change_elements(
        {"limb1.link2": Change(offset=np.array([1e-4, 0, 0, 0, 0, 0]))}
    )
    pose = [0.02, 0.0, 0.38]
    bodies = oracle.Bodies(m).close(pose, 4)
    _, twist, wrenches = oracle.solve(bodies, offsets=True)
    state = respond(m, pose, np.zeros(6), misfit=1.0)
    assert np.allclose(
        state.twist[0, :, 0], twist, rtol=0.0, atol=1e-8 * np.abs(twist).max()
    )
    largest = max(np.abs(w).max() for w in wrenches.values())
    for name, wrench in wrenches.items():
        ours = state.elements[name].wrench
        assert np.allclose(ours[0, :, 0], wrench, rtol=0.0, atol=1e-8 * largest), name


@pytest.mark.extended
def test_every_run_condenses_in_the_same_order():
    """Whatever the seed of Python's hashes: else the last digits of a result change from run to run."""
    code = (
        "from tests.vjm.files import biglide; from stiffscope.vjm.network.order import find_order\n"
        "from stiffscope.vjm.kinematics.linkage import Linkage\n"
        "m = biglide(); o = find_order(m, Linkage(m, 'drives'))\n"
        "print([(type(s).__name__, getattr(s, 'node', ''), getattr(s, 'neighbours', '')) for s in o.steps])"
    )
    said = {
        subprocess.run(
            [sys.executable, "-c", code],
            check=True,
            capture_output=True,
            env={**os.environ, "PYTHONHASHSEED": seed},
        ).stdout
        for seed in "12"
    }
    assert len(said) == 1
