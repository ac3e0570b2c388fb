"""Stiffness under load against the Hessian of the full potential energy, and the figures of the method."""

from dataclasses import replace

import numpy as np
import pytest

from stiffscope.biglide.literal import Behind, literal_stiffness, load_hessian
from stiffscope.cli.main import _guarded
from stiffscope.errors import InputError
from stiffscope.robot.mechanism_of import mechanism_of
from stiffscope.robot.part_matrices import part_matrices
from stiffscope.robot.reader import load_robot
from stiffscope.vjm.kinematics.configurations import configure
from stiffscope.vjm.model.bodies import Body, member
from stiffscope.vjm.model.dynamics import Dynamics
from stiffscope.vjm.model.joints import Drive, Joint
from stiffscope.vjm.model.mechanism import Change, Mechanism, Tool
from stiffscope.vjm.model.screws import rotation
from stiffscope.vjm.network.network import END, place_nodes
from stiffscope.vjm.network.order import find_order
from stiffscope.vjm.network.strain import find_remaining_offsets
from stiffscope.vjm.statics.analysis import analyse, sag, stiffness
from stiffscope.vjm.statics.equilibrium import solve_loads
from stiffscope.vjm.statics.prestress import bend_network, bend_places, own_loads
from stiffscope.vjm.statics.slender import find_thrusts
from tests.robots import (
    GEOMETRY,
    euler_bernoulli,
    pose_at,
    published_slider,
    random_compliance,
)
from tests.vjm import energy, oracle
from tests.vjm.dense_modes import frame_mass
from tests.vjm.files import CHECKED, biglide, read, serial_arm
from tests.vjm.potential import Potential, by_angular_velocity


def compared(m, hessian, droop, pose):
    """Change of stiffness by the loads, and how far it is from the Hessian's, over sqrt(K_ii K_jj)."""
    plain = stiffness(m, pose)[0]
    exact = stiffness(m, pose, gravity="exact")[0]
    size = np.sqrt(np.outer(np.diagonal(plain), np.diagonal(plain)))
    assert np.allclose(
        sag(m, pose)[0], droop, rtol=0.0, atol=5e-3 * np.abs(droop).max()
    )
    return np.abs((exact - plain) / size).max(), np.abs((exact - hessian) / size).max()


def with_frames(m):
    """The mechanism with the consistent mass of a uniform frame element on every elastic body."""
    bodies = []
    for b in m.bodies:
        if b.elastic is not None and b.mass:
            length = float(np.linalg.norm(b.elastic.tip - b.elastic.base))
            mass = frame_mass(length, 1e-3, 1e-7, b.mass / (1e-3 * length))
            bodies.append(
                replace(
                    b, elastic=replace(b.elastic, dynamics=Dynamics(mass, np.zeros(0)))
                )
            )
        else:
            bodies.append(b)
    return replace(m, bodies=tuple(bodies))


def shipped_delta():
    """Rods between balls whose weight acts with moments on both ends."""
    robot = load_robot("delta")
    return mechanism_of(robot, part_matrices(robot))


@pytest.mark.parametrize(
    ("robot", "pose", "weight"),
    [
        (lambda: with_frames(serial_arm()), [0.85, 0.1, 1.1, 0.1, 0.05, -0.1], 10.0),
        pytest.param(
            lambda: with_frames(read("linear-delta")),
            CHECKED["linear-delta"]["poses"][1],
            3.0,
            marks=pytest.mark.long,
        ),
        (serial_arm, [0.85, 0.1, 1.1, 0.1, 0.05, -0.1], 1.0),
        pytest.param(
            lambda: read("linear-delta"),
            CHECKED["linear-delta"]["poses"][1],
            1.0,
            marks=pytest.mark.long,
        ),
        (lambda: read("stewart"), CHECKED["stewart"]["poses"][1], 100.0),
        pytest.param(shipped_delta, [0.0, 0.0, -0.9], 1.0, marks=pytest.mark.long),
    ],
    ids=[
        "serial arm of frames",
        "linear-delta of frames",
        "serial arm",
        "linear-delta",
        "stewart",
        "shipped delta",
    ],
)
def test_exact_stiffness_is_the_hessian_of_the_potential_energy(robot, pose, weight):
    m = robot()
    m = replace(m, gravity=weight * m.gravity)
    hessian, droop = Potential(oracle.Bodies(m).close(pose, 4)).tangent_stiffness()
    change, left = compared(m, hessian, droop, pose)
    assert change > 1e-5
    assert left < 1e-3 * change


def test_bearings_of_balls_yield_under_load_as_the_potential_energy_says():
    m = read("stewart")
    balls = {
        j.name: Change(np.diag([3e-8, 1e-8, 2e-8, 0, 0, 0]))
        for j in m.joints
        if j.kind == "spherical"
    }
    m = replace(m.change_elements(balls), gravity=100.0 * m.gravity)
    pose = CHECKED["stewart"]["poses"][1]
    hessian, droop = Potential(oracle.Bodies(m).close(pose, 4)).tangent_stiffness()
    change, left = compared(m, hessian, droop, pose)
    assert change > 1e-5
    assert left < 1e-3 * change


def locked(m, end):
    """Rods that balls at one end let spin no more: these turn about two axes across the rod instead."""
    joints = []
    for j in m.joints:
        if j.kind == "spherical" and j.name.endswith(end):
            rod = m.body(j.name.removesuffix(end)).elastic
            along = (rod.tip - rod.base) / np.linalg.norm(rod.tip - rod.base)
            first = np.cross(along, [0.3, 0.2, 1.0])
            j = replace(j, kind="universal", axis=first, axis2=np.cross(along, first))  # noqa: PLW2901
        joints.append(j)
    return replace(m, joints=tuple(joints))


@pytest.mark.parametrize("frame", [False, True])
def test_spinning_rods_with_coupled_compliances_carry_their_weight(rng, frame):
    """Nobody holds their spin; locking it at either end changes little beside what the weight does."""
    m = shipped_delta()
    bodies = []
    for b in m.bodies:
        if "rod" in b.name:
            elastic = replace(
                b.elastic, compliance=random_compliance(rng, b.elastic.compliance)
            )
            held = elastic if frame else replace(elastic, dynamics=None)
            bodies.append(replace(b, elastic=held))
        else:
            bodies.append(b)
    m = replace(m, bodies=tuple(bodies))
    poses = [[0.1, 0.05, -0.85], [0.0, 0.0, -0.9]]
    plain = stiffness(m, poses)
    spinning = analyse(m, poses, gravity="exact")
    size = np.sqrt(np.einsum("nii,njj->nij", plain, plain))
    change = np.abs((spinning.matrix - plain) / size).max()
    assert change > 1e-4
    for end in (".top", ".end"):
        held = analyse(locked(m, end), poses, gravity="exact")
        assert np.abs((held.matrix - spinning.matrix) / size).max() < 0.2 * change
        assert np.allclose(
            held.sag, spinning.sag, rtol=0.0, atol=0.02 * np.abs(held.sag).max()
        )


def test_weight_acts_as_the_part_condenses_it(rng):
    """A cantilever's tip sinks by w L⁴ / 8EI and turns by w L³ / 6EI; half at either end it would be w L⁴ / 6EI."""
    length = 0.8
    mass = 3.0
    c = euler_bernoulli(length, 0.01)
    dynamics = Dynamics(
        frame_mass(length, 1e-3, 1e-7, mass / (1e-3 * length)), np.zeros(0)
    )
    rod = member(
        "rod", [0, 0, 0], [0, length, 0], c, y=[0, 0, 1], mass=mass, dynamics=dynamics
    )
    slide = Joint(
        "slide",
        "ground",
        "rod.base",
        "prismatic",
        [0, 0, 0],
        [0, 1, 0],
        drive=Drive(1e12),
    )
    m = Mechanism(
        (rod,),
        (slide,),
        Tool("rod.tip", [0, length, 0], ("y",)),
        np.array([0, 0, -9.81]),
    )
    down = mass / length * 9.81 * c[4, 4] / length  # w / EI
    assert sag(m, [length])[0, [2, 3]] == pytest.approx(
        [-down * length**4 / 8, -down * length**3 / 6], rel=1e-9
    )


def test_moments_that_no_lever_gives_act_in_full(rng):
    """Any condensed mass: wrenches on both ends are its rows for a common acceleration."""
    m = serial_arm()
    pose = [0.85, 0.1, 1.1, 0.1, 0.05, -0.1]
    factor = rng.normal(size=(12, 12))
    link = m.body("link3")
    heavy = replace(
        link,
        elastic=replace(
            link.elastic, dynamics=Dynamics(0.1 * factor @ factor.T, np.zeros(0))
        ),
    )
    changed = replace(
        m, bodies=tuple(heavy if b is link else replace(b, mass=0.0) for b in m.bodies)
    )
    bodies = oracle.Bodies(changed).close(pose, 4)
    r, p = bodies.of("link3.base")
    axes = r @ link.elastic.axes
    e = link.elastic
    falling = np.tile(np.concatenate([axes.T @ m.gravity, np.zeros(3)]), 2)
    wrench = heavy.elastic.dynamics.mass @ falling
    loads = {}
    for node, at, w in zip(
        link.nodes, (e.base, e.tip), np.split(wrench, 2), strict=True
    ):
        force = axes @ w[:3]
        moment = axes @ w[3:]
        loads[node] = np.concatenate([force, moment + np.cross(r @ at + p, force)])
    assert sag(changed, pose)[0] == pytest.approx(
        oracle.solve(bodies, loads)[1], rel=1e-8
    )


def test_lack_of_fit_prestresses_as_the_potential_energy_says():
    """A Delta whose rods are long by 5 µm or short: no weight, only the loops against each other."""
    m = read("linear-delta")
    off = {
        f"leg{k}.rod{j}": Change(offset=np.r_[5e-6 * (-1) ** (k + j), np.zeros(5)])
        for k in (1, 2, 3)
        for j in (1, 2)
    }
    m = replace(m.change_elements(off), gravity=np.zeros(3))
    pose = CHECKED["linear-delta"]["poses"][1]
    hessian, droop = Potential(oracle.Bodies(m).close(pose, 4)).tangent_stiffness()
    change, left = compared(m, hessian, droop, pose)
    assert change > 1e-5
    assert left < 1e-4 * change


@pytest.mark.parametrize("z", [pytest.param(0.30, marks=pytest.mark.long), 0.50])
def test_biglide_is_the_hessian_of_its_own_potential(z, rng):
    """Weights at the tool alone: the energy of ``tests.vjm.energy`` puts a link's elsewhere."""
    link = random_compliance(rng, euler_bernoulli())
    slider = random_compliance(rng, published_slider())
    m = biglide(link, slider, link_mass=0.0, platform_mass=7.93)
    q = float(np.arcsin((z - GEOMETRY.l1 - GEOMETRY.l2) / GEOMETRY.L))
    hessian, droop = energy.tangent_stiffness(
        energy.Biglide(GEOMETRY, link, slider, 1.27e7, 0.0, 7.93, q, 9.81)
    )
    change, left = compared(
        m, by_angular_velocity(hessian, droop), droop, [0.0, 0.0, z]
    )
    assert change > 1e-5
    assert left < 1e-3 * change


@pytest.mark.parametrize(
    ("q", "ppm", "down"),
    [
        (35.8, [-4.3, 0.6, 156.8, 69.7, 232.6, -31.5], 11.049),
        (64.3, [-6.3, 0.5, 33.9, 5.7, 40.5, -15.8], 1.814),
    ],
)
def test_method_figures_with_weights_half_at_either_end(q, ppm, down):
    m = biglide()
    pose = pose_at(GEOMETRY, np.radians(q))
    loaded = analyse(m, pose, gravity="exact")
    plain = stiffness(m, pose)
    change = 1e6 * (np.diagonal(loaded.matrix[0]) / np.diagonal(plain[0]) - 1.0)
    assert change == pytest.approx(ppm, abs=0.06)
    assert 1e6 * loaded.sag[0, 2] == pytest.approx(down, abs=1.2e-3)


def test_without_loads_nothing_changes():
    m = replace(biglide(), gravity=np.zeros(3))
    pose = [0.03, 0.0, 0.38]
    assert np.allclose(
        stiffness(m, pose, gravity="exact"), stiffness(m, pose), rtol=1e-9, atol=0.1
    )


def test_a_pendulum_that_falls_over_has_the_unloaded_stiffness_and_no_sag():
    def standing(stiffness):
        bearing = np.diag([1e-8, 1e-8, 1e-8, 0.0, 1e-7, 1e-7])
        joint = Joint(
            "j",
            "ground",
            "rod",
            "revolute",
            [0, 0, 0],
            [0, 1, 0],
            drive=Drive(stiffness),
            compliance=bearing,
        )
        rod = Body("rod", 100.0, [0.02, 0, 1])
        tool = Tool("rod", [0.02, 0, 1], ("x",))
        return Mechanism((rod,), (joint,), tool, np.array([0, 0, -9.81]))

    soft, firm = (
        analyse(standing(k * 981.0), [[0.02]], gravity="exact") for k in (0.9, 20.0)
    )
    assert np.isnan(soft.sag).all()
    assert np.allclose(soft.matrix, stiffness(standing(0.9 * 981.0), [[0.02]]))
    assert firm.sag[0, 4] == pytest.approx(0.02 / 20.0)


def test_a_tight_string_is_stiff_sideways():
    """Two struts in line, each too short by a misfit: together 2 T/l across, without any weight."""
    length = 0.5
    axial = 1e7
    tension = 1000.0
    bodies = [Body("knot")]
    joints = []
    off = {}
    for side in (1.0, -1.0):
        name = f"strut{side:+.0f}"
        foot = [side * length, 0, 0]
        bodies.append(
            member(
                name,
                foot,
                [0, 0, 0],
                np.diag([1 / axial, 1e-9, 1e-9, 1e-9, 1e-9, 1e-9]),
            )
        )
        joints += [
            Joint(f"{name}.foot", "ground", f"{name}.base", "spherical", foot),
            Joint(f"{name}.tip", f"{name}.tip", "knot", "spherical", [0, 0, 0]),
        ]
        off[name] = Change(offset=np.r_[-tension / axial, np.zeros(5)])
    bodies.append(
        member("hold", [0, 0, 0], [0, 0, 1], np.diag([1.0, 1, 1, 1e-6, 1e-6, 1e-6]))
    )
    joints += [
        Joint("hold.foot", "ground", "hold.base", "fixed", [0, 0, 0]),
        Joint("hold.end", "hold.tip", "knot", "fixed", [0, 0, 0]),
    ]
    bodies[-1] = replace(
        bodies[-1], elastic=replace(bodies[-1].elastic, places=np.zeros((2, 3)))
    )
    m = Mechanism(
        tuple(bodies), tuple(joints), Tool("knot", [0, 0, 0], ("x",))
    ).change_elements(off)
    from stiffscope.vjm.kinematics.linkage import Linkage
    from stiffscope.vjm.network.order import find_order, places_at_home
    from stiffscope.vjm.statics.prestress import loaded_stiffness

    k = loaded_stiffness(find_order(m, Linkage(m, "drives")), places_at_home(m))[
        0, :, :6
    ]
    across = 2 * tension / length
    assert np.diagonal(k) == pytest.approx(
        [2 * axial + 1, across + 1, across + 1, 1e6, 1e6, 1e6], rel=2e-4
    )


@pytest.mark.parametrize(
    "turn", [0.25 * np.pi, 0.5 * np.pi, np.nextafter(0.5 * np.pi, 2.0)]
)
def test_a_base_that_is_turned_turns_the_robot_and_its_weight(turn):
    """Up to a quarter turn, whose cosine may be exactly zero: the same robot with its weight turned back."""
    m = biglide()
    pose = [[0.0, 0.0, 0.35]]
    r = rotation([0.0, 1.0, 0.0], turn)
    whole = np.kron(np.eye(2), r)
    found = stiffness(
        m.change_elements({"<base>": Change(offset=np.r_[0, 0, 0, 0, turn, 0])}),
        pose,
        gravity="exact",
    )
    expected = (
        whole
        @ stiffness(replace(m, gravity=r.T @ m.gravity), pose, gravity="exact")[0]
        @ whole.T
    )
    size = np.sqrt(np.outer(np.diagonal(expected), np.diagonal(expected)))
    assert np.abs((found[0] - expected) / size).max() < 1e-8


def test_a_universal_joint_is_two_revolutes():
    """One joint of two axes, or two of one with a cross between: the same robot, under its weight too."""
    m = replace(read("linear-delta"), gravity=np.array([3.0, -2.0, 300.0]))
    bodies = list(m.bodies)
    joints = []
    for j in m.joints:
        if j.kind != "universal" or not j.name.startswith("leg1"):
            joints.append(j)
            continue
        bodies.append(Body(f"{j.name}.cross"))
        joints.append(
            Joint(f"{j.name}.1", j.first, f"{j.name}.cross", "revolute", j.at, j.axis)
        )
        joints.append(
            Joint(f"{j.name}.2", f"{j.name}.cross", j.second, "revolute", j.at, j.axis2)
        )
    two = replace(m, bodies=tuple(bodies), joints=tuple(joints))
    pose = CHECKED["linear-delta"]["poses"][1]
    plain = stiffness(m, pose)[0]
    one = stiffness(m, pose, gravity="exact")[0]
    size = np.sqrt(np.outer(np.diagonal(plain), np.diagonal(plain)))
    change = np.abs((one - plain) / size).max()
    assert change > 1e-5
    assert (
        np.abs((one - stiffness(two, pose, gravity="exact")[0]) / size).max()
        < 1e-4 * change
    )


def two_guides(rng, carrier, exchanged=False, kind="prismatic"):
    """A heavy table, with a head that lifts, on a guide whose table may be named first."""
    ends = ["table", "ground"] if exchanged else ["ground", "table"]
    factor = rng.normal(size=(6, 6)) * np.c_[[0, 1e-4, 1e-4, 1e-3, 1e-3, 1e-3]]
    if kind != "prismatic":
        factor[3] = 0.0
    lack = np.array([0.0, 1e-3, 2e-3, 0.0, 2e-3, -1e-3])
    way = Joint(
        "way",
        *ends,
        kind,
        [0.02, 0, 0.05],
        [1, 0.2, 0.1],
        drive=Drive(2e5),
        compliance=factor @ factor.T,
        offset=-lack if exchanged else lack,
        carried_by=carrier,
    )
    lift = Joint(
        "lift",
        "table",
        "head",
        "prismatic",
        [0.1, 0, 0.1],
        [0.1, 0, 1],
        drive=Drive(3e5),
        compliance=0.5 * way.compliance,
    )
    bodies = (
        Body("table", 30.0, [0.1, 0.05, 0.1]),
        Body("head", 30.0, [0.2, 0.1, 0.3]),
    )
    tool = Tool("head", [0.25, 0.1, 0.3], ("x", "z"))
    return Mechanism(bodies, (way, lift), tool, np.array([1.0, 2.0, -9.81]))


def beside_a_shaft(machine):
    """The machine with a second shaft beside its first, which holds the rotation about it."""
    way = replace(machine.joints[0], name="shaft", at=[0, 0.3, 0], drive=None)
    way = replace(way, offset=None)
    return replace(machine, joints=(*machine.joints, way))


def test_a_bearing_on_the_first_body_is_that_of_a_guide_whose_bodies_are_exchanged():
    """Who is named first is a name: what stays on the ground does so under either."""
    poses = [[0.25, 0.3], [0.65, 0.3], [0.65, 0.5]]
    machines = [
        two_guides(np.random.default_rng(3), *case)
        for case in [("first", False), ("second", True), ("second", False)]
    ]
    first, exchanged, second = (analyse(m, poses, gravity="exact") for m in machines)
    assert first.matrix == pytest.approx(exchanged.matrix, rel=1e-7, abs=1e-2)
    assert first.sag == pytest.approx(exchanged.sag, rel=1e-9, abs=1e-12)
    assert first.sag[0] == pytest.approx(second.sag[0], rel=1e-9, abs=1e-12)
    assert np.abs(first.sag[1:] - second.sag[1:]).max() > 1e-4
    plain = stiffness(machines[0], poses)
    assert np.abs(first.matrix / plain - 1.0).max() > 1e-4


@pytest.mark.parametrize("stroke", [0.0, 0.4])
def test_a_rail_that_tilts_in_its_bearing_on_the_ground(stroke):
    """Energy ½ k δ² + ½ κ θ² - W (L + δ) sin θ: the rail's weight W, L beyond the bearing, slips by δ."""
    length = 0.25 + stroke
    drive = 2e4
    tilting = 5e3
    weight = 150.0
    bearing = np.diag([0.0, 0.0, 0.0, 0.0, 1.0 / tilting, 0.0])
    way = Joint(
        "way",
        "ground",
        "rail",
        "prismatic",
        [0, 0, 0],
        [1, 0, 0],
        drive=Drive(drive),
        compliance=bearing,
        carried_by="first",
    )
    m = Mechanism(
        (Body("rail", weight / 9.81, [0.25, 0, 0]),),
        (way,),
        Tool("rail", [0.25, 0, 0], ("x",)),
        np.array([0, 0, -9.81]),
    )
    slip = 0.0
    angle = 0.0
    for _ in range(60):
        angle = weight * (length + slip) * np.cos(angle) / tilting
        slip = weight * np.sin(angle) / drive
    reach = length + slip
    c, s = np.cos(angle), np.sin(angle)
    hessian = [
        [drive, -weight * c],
        [-weight * c, tilting + weight * reach * s],
    ]
    motion = np.array([[c, -reach * s], [-s, -reach * c], [0.0, 1.0]])  # x z ry
    expected = motion @ np.linalg.solve(hessian, motion.T)
    state = analyse(m, [[length]], gravity="exact")
    chosen = np.ix_([0, 2, 4], [0, 2, 4])
    assert angle > 5e-3
    assert state.compliance[0][chosen] == pytest.approx(expected, rel=1e-6, abs=1e-13)
    linear = weight * length / tilting
    assert state.sag[0, [2, 4]] == pytest.approx([-length * linear, linear], rel=1e-9)


@pytest.mark.parametrize("kind", ["prismatic", "cylindrical"])
def test_second_steps_are_small_wherever_the_bearing_is(kind):
    """Newton's steps are squared, at the second body's point as at the first's."""
    machine = two_guides(np.random.default_rng(3), "first", kind=kind)
    if kind != "prismatic":
        machine = beside_a_shaft(machine)
    at = configure(machine, [[0.65, 0.3]])
    order = find_order(machine, at.linkage)
    rest = place_nodes(at)
    there = rest
    sizes = []
    loads = own_loads(order, rest)
    for _ in range(3):
        step = solve_loads(order, there, loads, "nodes")
        sizes.append(max(np.abs(twist).max() for twist in step.nodes.values()))
        there = bend_places(there, step)
        lack = find_remaining_offsets(order, there, rest)
        loads = replace(own_loads(order, there), offsets=lack)
    assert sizes[0] > 1e-3
    assert sizes[1] < 3.0 * sizes[0] ** 2
    assert sizes[2] < 1e-2 * sizes[1]


def test_exact_gravity_refuses_bearings_on_the_first_body_of_what_slides_and_turns():
    machine = two_guides(np.random.default_rng(3), "first", kind="cylindrical")
    machine = beside_a_shaft(machine)
    with pytest.raises(InputError, match=r'joints.way.carried_by: expected "second"'):
        analyse(machine, [[0.65, 0.3]], gravity="exact")


def test_the_literal_reading_is_smaller_still():
    m = biglide()
    pose = [[0.0, 0.0, 0.35]]
    down = m.gravity
    tool = m.tool.at
    behind = {}
    for i in (1, 2):
        carried = [Behind(0.5 * 7.93 * down, "platform", tool)]
        for j in (1, 2, 3):
            name = f"limb{i}.link{j}"
            e = m.body(name).elastic
            carried.append(Behind(1.95 * down, f"{name}.base", 0.5 * (e.base + e.tip)))
            behind[name] = [Behind(7.93 / 6.0 * down, "platform", tool)]
        behind[f"limb{i}.slider"] = carried
    change = (
        np.diagonal(literal_stiffness(m, pose, behind)[0])
        / np.diagonal(stiffness(m, pose)[0])
        - 1.0
    )
    assert 1e-7 < np.abs(change).max() < 1e-5


def test_load_hessian_is_the_second_derivative_of_the_work():
    force, lever, step = np.array([3.0, -2.0, 5.0]), np.array([0.1, 0.4, -0.2]), 1e-4

    def work(angles):
        turn = np.eye(3)
        for axis, angle in zip(np.eye(3), angles, strict=True):
            turn = turn @ rotation(axis, angle)
        return force @ turn @ lever

    basis = step * np.eye(3)
    second = [
        [
            (work(a + b) - work(a - b) - work(b - a) + work(-a - b)) / (4 * step**2)
            for b in basis
        ]
        for a in basis
    ]
    assert np.allclose(load_hessian(force, lever)[3:, 3:], second, atol=1e-6)
    assert not load_hessian(force, lever)[:3].any()


@pytest.mark.parametrize("hung", [False, True])
def test_thrust_of_a_slender_rod_is_told_beside_eulers_load(tmp_path, caplog, hung):
    """A rod of length L and bending stiffness EI, clamped at one end, buckles under π² EI / 4 L²."""
    end = -0.5 if hung else 0.5
    file = tmp_path / "upright.toml"
    file.write_text(f"""
name = "upright"
[gravity]
acceleration = 9.81
direction = [0, 0, -1]
[materials.light]
youngs_modulus = "210 GPa"
shear_modulus = "80 GPa"
density = 1e-3
[parts.column]
shape = "rod"
length = "500 mm"
radius = "3 mm"
bore = "0 mm"
material = "light"
[bodies.rod]
part = "column"
base = [0.1, 0, 0]
tip = [0.1, 0, {end}]
[bodies.block]
mass = "5 kg"
centre = [0.1, 0, {end}]
[joints.slide]
between = ["ground", "rod.base"]
type = "prismatic"
at = [0, 0, 0]
axis = [1, 0, 0]
drive = {{ stiffness = 1e12 }}
[joints.clamp]
between = ["rod.tip", "block"]
type = "fixed"
at = [0.1, 0, {end}]
[tool]
body = "block"
at = [0.1, 0, {end}]
pose = ["x"]
[poses]
home = [0.1]
""")
    robot = load_robot(file)
    machine = mechanism_of(robot, part_matrices(robot, "beam"))
    ((name, (force, share)),) = find_thrusts(machine, machine.tool.home[None]).items()
    euler = np.pi**2 * 210e9 * np.pi * 0.003**4 / 4 / (4 * 0.5**2)
    assert (name, force) == (
        "rod",
        pytest.approx(5 * 9.81 if hung else -5 * 9.81, rel=1e-6),
    )
    assert share == pytest.approx(5 * 9.81 / euler, rel=0.01)
    assert (
        _guarded(["stiffness", str(file), "--gravity", "exact", "--components", "beam"])
        == 0
    )
    kind, effect = ("tension", "straightens") if hung else ("compression", "bends")
    assert (
        f"rod carries 49.1 N of {kind}, 37 % of its buckling load: that this {effect} it is left out"
        in caplog.text
    )


def test_thrust_of_short_bodies_is_far_from_buckling_them():
    machine = biglide()
    found = find_thrusts(machine, machine.tool.home[None])
    assert {"limb1.link1", "limb2.link3"} <= set(found)
    assert max(share for _, share in found.values()) < 2e-3


def test_what_runs_away_is_given_up_and_leaves_the_others():
    """Of loads of 20 N and of up to 1e60 N at an arm, the small one has an equilibrium, as it has alone."""
    m = serial_arm()
    poses = np.array([[0.85, 0.1, 1.1, 0.1, 0.05, -0.1]] * 4)
    force = np.zeros((4, 6, 1))
    force[:, 2, 0] = [1e60, 20.0, 1e6, 1e8]

    def bend(chosen):
        at = configure(m, poses[chosen])
        order = find_order(m, at.linkage)
        loads = force[chosen]
        return bend_network(
            order, place_nodes(at), push=lambda _, some: {END: loads[some]}
        )

    together = bend([0, 1, 2, 3])
    alone = bend([1])
    assert together.found.tolist() == [False, True, False, False]
    assert alone.found.all()
    for node, position in alone.there.position.items():
        there = together.there.position[node]
        assert there[1 % len(there)] == pytest.approx(position[0], rel=1e-12)
