"""Arms of fewer than six elastic directions: compliance is that of their Jacobian, and what is rigid is told."""

import numpy as np
import pytest

from stiffscope.errors import InputError
from stiffscope.report.robot_view import unit_wrenches
from stiffscope.vjm.kinematics.configurations import configure, configure_drives
from stiffscope.vjm.model.bodies import Body
from stiffscope.vjm.model.joints import Drive, Joint
from stiffscope.vjm.model.mechanism import Mechanism, Tool
from stiffscope.vjm.model.screws import rotation
from stiffscope.vjm.statics.analysis import analyse, compliance, sag, stiffness
from stiffscope.vjm.statics.singularity import rigid_note, singular_note
from stiffscope.vjm.statics.yielding import deflection, respond
from stiffscope.vjm.vibration.modes import modes

SIX = ("x", "y", "z", "rx", "ry", "rz")


def arm(axes, places, tool, pose, gravity=(0, 0, 0), stiff=2e4):
    """A serial arm of revolute drives; each link has its mass halfway to the next joint."""
    bodies = []
    joints = []
    before = "ground"
    ends = [*places[1:], tool]
    for k, (axis, at, end) in enumerate(zip(axes, places, ends, strict=True)):
        centre = 0.5 * (np.array(at, dtype=float) + end)
        bodies.append(Body(f"link{k}", 2.0 + k, centre))
        joints.append(
            Joint(
                f"j{k}",
                before,
                f"link{k}",
                "revolute",
                at,
                axis,
                drive=Drive(stiff * (1 + k)),
            )
        )
        before = f"link{k}"
    return Mechanism(tuple(bodies), tuple(joints), Tool(before, tool, pose), gravity)


def moved(m, q):
    """Axes, places and mass centres of the arm's joints at displacements q, and its tool: a product of exponentials."""
    turn = np.eye(3)
    shift = np.zeros(3)
    axes = []
    places = []
    centres = []
    for j, b, angle in zip(m.joints, m.bodies, q, strict=True):
        axes.append(turn @ j.axis)
        places.append(turn @ j.at + shift)
        r = rotation(j.axis, angle)
        shift = turn @ (j.at - r @ j.at) + shift
        turn = turn @ r
        centres.append(turn @ b.centre + shift)
    return np.array(axes), np.array(places), np.array(centres), turn @ m.tool.at + shift


def jacobian(m, q):
    axes, places, _, tool = moved(m, q)
    return np.vstack([np.cross(axes, tool - places).T, axes.T])


def own_compliance(m, q):
    j = jacobian(m, q)
    return j @ np.diag([1.0 / joint.drive.stiffness for joint in m.joints]) @ j.T


def weight_torques(m, q):
    axes, places, centres, _ = moved(m, q)
    out = np.zeros(len(q))
    for i, body in enumerate(m.bodies):
        for k in range(i + 1):
            out[k] += np.cross(axes[k], centres[i] - places[k]) @ (
                body.mass * m.gravity
            )
    return out


PLANAR_2R = arm(
    [[0, 0, 1]] * 2,
    [[0, 0, 0], [0.3, 0, 0]],
    [0.3, 0.25, 0],
    ("x", "y"),
    gravity=(0, -9.81, 0),
)
SPATIAL_3R = arm(
    [[0, 0, 1], [0, 1, 0], [0, 1, 0]],
    [[0, 0, 0], [0, 0, 0.4], [0.35, 0, 0.6]],
    [0.6, 0, 0.3],
    ("x", "y", "z"),
    gravity=(0, 0, -9.81),
)
WRISTED = arm(
    [[0, 0, 1], [0, 1, 0], [0, 1, 0], [1, 0, 0], [0, 1, 0], [1, 0, 0]],
    [
        [0, 0, 0],
        [0, 0, 0.4],
        [0.35, 0, 0.6],
        [0.5, 0, 0.6],
        [0.7, 0, 0.6],
        [0.75, 0, 0.6],
    ],
    [0.85, 0, 0.6],
    SIX,
    gravity=(0, 0, -9.81),
)


@pytest.mark.parametrize(("m", "rank"), [(PLANAR_2R, 2), (SPATIAL_3R, 3)])
def test_compliance_of_an_arm_of_drives(m, rank, rng):
    q = rng.uniform(-0.4, 0.4, (4, len(m.joints)))
    found = configure_drives(m, q)
    known = np.array([own_compliance(m, each) for each in q])
    assert np.allclose(
        compliance(m, found), known, rtol=1e-9, atol=1e-12 * np.abs(known).max()
    )
    state = analyse(m, found)
    assert np.isnan(state.matrix).all()
    assert np.allclose(
        state.compliance, known, rtol=1e-9, atol=1e-12 * np.abs(known).max()
    )
    assert state.mobility.tolist() == [0] * 4
    for each, directions in zip(known, state.rigid, strict=True):
        assert directions.shape == (6 - rank, 6)
        assert np.abs(each @ directions.T).max() < 1e-12 * np.abs(each).max()
        assert np.allclose(np.linalg.norm(directions, axis=1), 1.0)
    wrench = rng.normal(size=6)
    assert np.allclose(
        deflection(m, found, wrench).twist,
        known @ wrench,
        atol=1e-12 * np.abs(known).max(),
    )


def test_rigid_directions_of_a_planar_arm_are_out_of_its_plane():
    (rigid,) = analyse(PLANAR_2R, PLANAR_2R.tool.home[None]).rigid
    for axis in np.eye(6)[2:5]:
        assert np.abs(np.abs(rigid) - axis).max(axis=1).min() < 1e-12


def test_a_rigid_force_is_told_with_its_line():
    """A force through the only axis of a boom turns nothing; the same force at its tip does."""
    m = arm([(0, 0, 1)], [(0, 0, 0)], (0.6, 0, 0), ("rz",))
    note = rigid_note(analyse(m, np.zeros((1, 1))).rigid[0])
    assert "5 directions" in note
    assert "force along y, its line (-600, 0, 0) mm away" in note
    assert "force along x, force" in note


@pytest.mark.parametrize("m", [PLANAR_2R, SPATIAL_3R])
def test_weight_on_an_arm_of_drives(m, rng):
    """Sag to first order; the tangent compliance is that of the energy's Hessian by joint angles at equilibrium."""
    q = rng.uniform(-0.4, 0.4, len(m.joints))
    k = np.array([j.drive.stiffness for j in m.joints])
    found = configure_drives(m, q)
    assert np.allclose(
        sag(m, found)[0],
        jacobian(m, q) @ (weight_torques(m, q) / k),
        rtol=1e-9,
        atol=1e-14,
    )
    bent = q.copy()
    for _ in range(50):
        bent = q + weight_torques(m, bent) / k
    step = 1e-5
    slope = [
        weight_torques(m, bent + step * e) - weight_torques(m, bent - step * e)
        for e in np.eye(len(q))
    ]
    hessian = np.diag(k) - np.transpose(slope) / (2 * step)
    j = jacobian(m, bent)
    known = j @ np.linalg.solve(hessian, j.T)
    exact = compliance(m, found, gravity="exact")[0]
    plain = compliance(m, found)[0]
    assert np.abs(exact - known).max() < 1e-4 * np.abs(exact - plain).max()
    state = analyse(m, found, gravity="exact")
    assert np.allclose(state.compliance[0], exact, rtol=1e-12)
    assert np.allclose(state.sag[0], sag(m, found)[0])


def test_a_straight_wrist_is_rigid_in_one_direction_and_regular_elsewhere(rng):
    q = np.vstack([np.zeros(6), rng.uniform(0.2, 0.5, (3, 6))])
    found = configure_drives(WRISTED, q)
    state = analyse(WRISTED, found)
    for each, c, k, rigid in zip(
        q, state.compliance, state.matrix, state.rigid, strict=True
    ):
        known = own_compliance(WRISTED, each)
        assert np.allclose(c, known, rtol=1e-9, atol=1e-12 * np.abs(known).max())
        if each.any():
            assert np.allclose(k @ known, np.eye(6), atol=1e-8)
            assert rigid.shape == (0, 6)
        else:
            assert np.isnan(k).all()
            assert rigid.shape[0] == 1


def test_weight_bends_a_rigid_direction_but_frees_none():
    """A straight wrist that sags is rigid as without weight; 1/C_ii of both differ as the geometry does, by the sag."""
    found = configure_drives(WRISTED, np.zeros((1, 6)))
    plain, loaded = (analyse(WRISTED, found, gravity=g) for g in ("none", "exact"))
    assert np.abs(loaded.sag).max() > 1e-4
    assert (loaded.mobility[0], len(loaded.rigid[0])) == (0, 1)
    assert np.allclose(loaded.rigid[0], plain.rigid[0])
    (a,), (b,) = (
        np.diagonal(each.finite, axis1=1, axis2=2) for each in (plain, loaded)
    )
    assert np.allclose(
        a, 1.0 / np.diag(own_compliance(WRISTED, np.zeros(6))), rtol=1e-9
    )
    assert np.allclose(b, a, rtol=10 * np.abs(loaded.sag).max())


def test_a_direction_that_rigid_parts_hold_stays_rigid_under_weight():
    state = analyse(PLANAR_2R, PLANAR_2R.tool.home[None], gravity="exact")
    assert np.isnan(np.diagonal(state.finite[0])).tolist() == [
        False,
        False,
        True,
        True,
        True,
        False,
    ]


@pytest.mark.parametrize("gravity", ["none", "exact"])
@pytest.mark.parametrize("bend", [3e-5, 1e-4, 1e-3])
def test_a_nearly_straight_wrist_is_nearly_rigid_not_free(bend, gravity):
    found = configure_drives(WRISTED, bend * np.eye(6)[4:5])
    state = analyse(WRISTED, found, gravity=gravity)
    known = own_compliance(WRISTED, bend * np.eye(6)[4])
    assert state.mobility[0] == 0
    assert np.allclose(
        state.compliance[0],
        known,
        atol=(1e-6 if gravity == "none" else 0.01) * np.abs(known).max(),
    )
    note = rigid_note(state.rigid[0]) or singular_note(state.matrix[0])
    assert (
        "rigid: force along y, its line (-850" in note
        or "rigid in 1 direction: force along y" in note
    )


def test_a_tool_that_joints_fix_is_rigid_in_all_directions_at_every_pose():
    bodies = Body("upper", 1.0, [0.1, 0, 0]), Body("fore", 0.5, [0.2, 0.1, 0])
    joints = (
        Joint("j1", "ground", "upper", "fixed", [0, 0, 0]),
        Joint("j2", "upper", "fore", "fixed", [0.2, 0, 0]),
    )
    m = Mechanism(
        bodies, joints, Tool("fore", [0.2, 0.2, 0], ("x", "y")), (0, -9.81, 0)
    )
    poses = np.array([m.tool.home, m.tool.home])
    for gravity in ("none", "exact"):
        assert [len(each) for each in analyse(m, poses, gravity=gravity).rigid] == [
            6,
            6,
        ]
    assert [len(each) for each in unit_wrenches(m, configure(m, poses))] == [6, 6]
    with pytest.raises(
        InputError, match="bodies: expected a mass on a body that can move, got none"
    ):
        modes(m, poses)


def test_stiffness_alone_is_still_refused_where_it_is_infinite():
    with pytest.raises(Exception, match="infinite stiffness in a direction"):
        stiffness(PLANAR_2R, PLANAR_2R.tool.home[None])


def test_compliance_of_a_regular_robot_is_the_inverse_of_its_stiffness(rng):
    from tests.robots import random_poses
    from tests.vjm.files import biglide

    m = biglide()
    poses = random_poses(rng, 3)
    state = analyse(m, poses)
    assert np.allclose(state.compliance @ state.matrix, np.eye(6), atol=1e-8)
    assert [len(r) for r in state.rigid] == [0, 0, 0]
    assert configure(m, poses).valid.all()


def grow(bodies, joints, name, axes, places, stiff, mass=0.0):
    """Add a limb of drives on the ground."""
    for k, (axis, at, drive) in enumerate(zip(axes, places, stiff, strict=True)):
        before = f"{name}.{k - 1}" if k else "ground"
        bodies.append(Body(f"{name}.{k}", mass, np.add(at, [0.03, -0.02, 0.05])))
        joints.append(
            Joint(
                f"j{name}.{k}",
                before,
                f"{name}.{k}",
                "revolute",
                at,
                axis,
                drive=Drive(drive),
            )
        )


def drawn(rng, foot, n):
    """Axes, places and drives of a limb as import finds them: along x, y or z, some at one place, some in line."""
    steps = (
        np.round(rng.uniform(-0.3, 0.3, (n, 3)), 2)
        * rng.integers(0, 2, (n, 3))
        * (rng.random((n, 1)) > 0.35)
    )
    return (
        np.eye(3)[rng.integers(3, size=n)],
        foot + np.cumsum(steps, axis=0),
        10 ** rng.uniform(3.5, 6.0, n),
    )


NEARLY_SINGULAR = (
    np.eye(3)[[0, 2, 1, 2, 2, 2]],
    [
        [0.2, 0, 0],
        [0.2, -0.24, 0],
        [0.2, -0.44, -0.19],
        [0.2, -0.49, -0.19],
        [0.2, -0.49, -0.19],
        [0.19, -0.62, -0.19],
    ],
    [
        28387.074512532316,
        28763.85643927954,
        39843.81882724293,
        173105.20765387506,
        96211.99462260895,
        9859.115580209454,
    ],
)  # of rank five but for rounding


@pytest.mark.extended
def test_limbs_off_the_path_to_the_tool_change_nothing(rng):
    """They hold up their own weight alone; one nearly singular among them, and as the tool's arm."""
    for trial in range(30):
        limb = (
            NEARLY_SINGULAR if trial < 5 else drawn(rng, np.array([0.0, 0.2, 0.5]), 6)
        )
        bodies = []
        joints = []
        grow(bodies, joints, "arm", *limb, mass=2.0)
        tool = Tool("arm.5", np.add(limb[1][-1], [0.1, 0.0, 0.05]), ("x", "y", "z"))
        chain = Mechanism(tuple(bodies), tuple(joints), tool, (0, 0, -9.81))
        grow(bodies, joints, "leg", *NEARLY_SINGULAR, mass=5.0)
        for side, n in (("left", 6), ("right", 4)):
            grow(
                bodies,
                joints,
                side,
                *drawn(rng, np.array([0.3, 0.0, 0.4]), n),
                mass=1.0,
            )
        whole = Mechanism(tuple(bodies), tuple(joints), tool, (0, 0, -9.81))
        q = rng.uniform(-0.3, 0.3, (5, len(joints))) * np.array(
            [[0], [1e-6], [1e-4], [1], [1]]
        )
        found = configure_drives(whole, q)
        own = configure_drives(chain, q[:, :6])
        known = np.array([own_compliance(chain, each) for each in q[:, :6]])
        size = np.abs(known).max(axis=(1, 2), keepdims=True)
        assert (np.abs(analyse(whole, found).compliance - known) < 1e-6 * size).all(), (
            trial
        )
        a, b = (
            analyse(m, f, gravity="exact") for m, f in ((whole, found), (chain, own))
        )
        assert (np.abs(a.compliance - b.compliance) < 1e-6 * size).all(), trial
        assert np.allclose(a.sag, b.sag, rtol=1e-9, atol=1e-12), trial
        assert np.isfinite(respond(whole, found, np.eye(6), gravity=1.0).twist).all()


NEARLY = [
    ([0, 0, 1], [0.07, 0, 0.08]),
    ([0, 1, 0], [0.02, 0, 0.15]),
    ([0, 1, 0], [0.015, 0, -0.15]),
    ([0, 0, 1], [0.056, 0, -0.05]),
    ([0, 1, 0], [0.015, 0, 0.015]),
]


@pytest.mark.parametrize("gravity", ["none", "exact"])
@pytest.mark.parametrize("off", [1e-3, 1e-4, 1e-5, 2.65e-6, 1e-6, 1e-7, 1e-9, 0.0])
def test_an_axis_typed_with_few_digits_frees_nothing(off, gravity):
    """C = J diag(1/k) J^T, whatever the condition of K; what is stiffer by a million is nearly rigid."""
    axes = [axis for axis, _ in NEARLY] + [[off, 0, 1]]
    places = [at for _, at in NEARLY] + [[-0.025, 0, -0.13]]
    m = arm(
        axes,
        places,
        [-0.025, 0, -0.34],
        ("x", "y", "z", "rx", "ry"),
        (0, 0, -9.81),
        stiff=1e4,
    )
    found = configure_drives(m, np.zeros((1, 6)))
    state = analyse(m, found, gravity=gravity)
    known = own_compliance(m, np.zeros(6))
    within = 1e-12 if gravity == "none" else 1e-2
    assert np.allclose(
        state.compliance[0], known, rtol=0, atol=within * np.abs(known).max()
    )
    assert state.mobility[0] == 0
    told = rigid_note(state.rigid[0]) or singular_note(
        state.matrix[0], state.compliance[0]
    )
    assert "free" not in (told or "")
    assert ("rigid" in (told or "")) == (off < 2e-3)
    if gravity == "none":
        alone = 1.0 / np.diag(known)
        sure = np.diag(known) > 1e-10 * np.diag(known).max()
        assert np.allclose(state.alone[0][sure], alone[sure], rtol=1e-9)
        assert state.nearly_rigid[0].tolist() == [
            False,
            False,
            False,
            off < 1e-3,
            False,
            False,
        ]
        twist = deflection(m, found, [10.0, -3, 2, 0.1, 0.2, 0.3]).twist[0]
        assert np.allclose(
            twist,
            known @ [10.0, -3, 2, 0.1, 0.2, 0.3],
            atol=1e-11 * np.abs(known).max(),
        )
    else:
        expected = jacobian(m, np.zeros(6)) @ (
            weight_torques(m, np.zeros(6))
            / np.array([j.drive.stiffness for j in m.joints])
        )
        assert np.allclose(state.sag[0], expected, rtol=1e-9, atol=1e-13)


def test_a_drive_between_bodies_that_are_fixed_gives_no_stiffness_below_zero():
    """Trunk, thigh and shank are each fixed to the ground; the hinges between them move nothing."""
    bodies = tuple(Body(name, 1.0, [0.1, 0, 0]) for name in ("trunk", "thigh", "shank"))
    held = tuple(
        Joint(f"{body.name}.held", "ground", body.name, "fixed", [0.1, 0, 0.3])
        for body in bodies
    )
    hinges = tuple(
        Joint(
            f"{one}-{other}",
            one,
            other,
            "revolute",
            [0.1, 0, height],
            [0, 1, 0],
            drive=Drive(1000.0),
        )
        for one, other, height in (("trunk", "thigh", 0.5), ("thigh", "shank", 0.3))
    )
    m = Mechanism(bodies, held + hinges, Tool("shank", [0.1, 0, 0.3], SIX))
    state = analyse(m, m.tool.home[None])
    assert state.nearly_rigid.all()
    assert not (state.alone <= 0.0).any()
    assert len(state.rigid[0]) == 6


@pytest.mark.parametrize("drives", [(), (1e5,)])
def test_the_one_pose_of_what_cannot_move_is_an_empty_one(drives):
    """Drives hold what would move, or a weld does; [] is where it stands."""
    kind = ("prismatic", [1, 0, 0]) if drives else ("fixed", None)
    drive = {"drive": Drive(*drives)} if drives else {}
    joint = Joint(
        "only",
        "ground",
        "body",
        kind[0],
        [0, 0, 0],
        kind[1],
        compliance=None if drives else 1e-6 * np.eye(6),
        **drive,
    )
    m = Mechanism(
        (Body("body", 2.0, [0, 0, 0]),),
        (joint,),
        Tool("body", [0, 0, 0.1], ()),
        (0, -9.81, 0),
    )
    found = configure(m, np.zeros((3, 0)))
    assert found.valid.tolist() == [True] * 3
    assert found.poses.shape == (3, 0)
    soft = analyse(m, found).compliance[:, 0, 0]
    assert np.allclose(soft, 1e-5 if drives else 1e-6 * (1 + 0.01))


def test_a_tool_that_moves_freely_is_not_rigid():
    """A slide without a drive: no compliance exists, and nothing is called rigid."""
    joint = Joint(
        "slide",
        "ground",
        "body",
        "prismatic",
        [0, 0, 0],
        [1, 0, 0],
        compliance=np.diag([0, 1e-8, 1e-8, 1e-6, 1e-6, 1e-6]),
    )
    m = Mechanism(
        (Body("body", 1.0, [0, 0, 0]),), (joint,), Tool("body", [0, 0, 0.1], ("x",))
    )
    state = analyse(m, m.tool.home[None])
    assert state.mobility.tolist() == [1]
    assert not state.nearly_rigid.any()


@pytest.mark.parametrize("slope", [1e-3, 0.1])
def test_a_wedge_that_nothing_holds_frees_the_tool_however_flat_it_is(slope):
    """The wedge slides by s, the tool follows by slope times s: a force along z meets nothing."""
    slide = {"kind": "prismatic", "at": [0, 0, 0]}
    joints = (
        Joint("drive", "ground", "base", axis=[0, 1, 0], drive=Drive(1e6), **slide),
        Joint("way", "base", "wedge", axis=[1, 0, 0], **slide),
        Joint("lift", "base", "tool", axis=[0, 0, 1], **slide),
        Joint("flank", "wedge", "tool", axis=[1, 0, slope], **slide),
    )
    bodies = (Body("base"), Body("wedge"), Body("tool"))
    m = Mechanism(bodies, joints, Tool("tool", [0.1, 0, 0], ("y",)))
    with pytest.raises(InputError, match="moves freely"):
        analyse(m, m.tool.home[None])
