"""Laws of the elastic algebra, over many random elements."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from stiffscope.errors import InputError
from stiffscope.vjm.analysis import mobility, singular_note, softest
from stiffscope.vjm.elastic import HERE, Parallel, Passive, Series, Spring, Weight, drive, edited, revolute, spherical
from stiffscope.vjm.reduction import as_stiffness, reduced
from stiffscope.vjm.response import respond, tool_twist
from stiffscope.vjm.screws import Frame, rotation, rotation_of, shift, skew
from tests.robots import euler_bernoulli, random_compliance

vectors = arrays(np.float64, 3, elements=st.floats(-1.0, 1.0))
seeds = st.integers(0, 2**32 - 1)


def spring(rng, name="spring", frame=HERE):
    return Spring(name, random_compliance(rng, euler_bernoulli()), frame)


def place(rng):
    return Frame(rotation_of(rng.normal(size=3)), rng.normal(size=3))


def stiffness_of(element):
    """Inverted in its own axes, then carried: inverting what was carried loses six digits."""
    carry = np.linalg.inv(element.frame.adjoint())
    return carry.T @ np.linalg.inv(element.compliance) @ carry


@given(vectors, vectors)
def test_shifts_compose_and_invert(a, b):
    assert np.allclose(shift(a) @ shift(b), shift(a + b))
    assert np.allclose(shift(a) @ shift(-a), np.eye(6))


@given(vectors, vectors, vectors)
def test_power_does_not_depend_on_the_frame(turn, move, force):
    frame = Frame(rotation_of(turn), move)
    twist, wrench = np.arange(6.0), np.concatenate([force, move])
    moved = frame.inverse_adjoint().T @ wrench
    assert np.isclose(moved @ (frame.adjoint() @ twist), wrench @ twist)
    assert np.allclose(frame.adjoint() @ frame.inverse_adjoint(), np.eye(6))


@given(vectors, st.floats(-3, 3))
def test_rotations_are_orthogonal_and_exponentials(turn, angle):
    axis = np.array([0.0, 1.0, 0.0])
    assert np.allclose(rotation(axis, angle), rotation_of(angle * axis))
    assert np.allclose(rotation_of(turn) @ rotation_of(turn).T, np.eye(3))
    assert np.allclose(skew(turn) @ turn, 0.0)


@given(seeds)
@settings(max_examples=30)
def test_series_adds_compliances_and_parallel_adds_stiffnesses(seed):
    rng = np.random.default_rng(seed)
    a, b = spring(rng, "a", place(rng)), spring(rng, "b", place(rng))
    ca, cb = (s.frame.adjoint() @ s.compliance @ s.frame.adjoint().T for s in (a, b))
    assert np.allclose(reduced(Series("s", (a, b))).compliance, ca + cb, rtol=1e-9)
    assert np.allclose(as_stiffness(Parallel("p", (a, b))), stiffness_of(a) + stiffness_of(b), rtol=1e-7)


@given(seeds)
@settings(max_examples=30)
def test_a_group_moved_as_a_whole_is_seen_from_another_point(seed):
    rng = np.random.default_rng(seed)
    members = (spring(rng, "a"), revolute("r", np.array([0.0, 1.0, 0.0]), place(rng)), spring(rng, "b", place(rng)))
    frame = place(rng)
    here = as_stiffness(Parallel("p", (Series("s", members), spring(rng, "c"))))
    rng = np.random.default_rng(seed)
    members = (spring(rng, "a"), revolute("r", np.array([0.0, 1.0, 0.0]), place(rng)), spring(rng, "b", place(rng)))
    place(rng)
    there = as_stiffness(Parallel("p", (Series("s", members), spring(rng, "c")), frame))
    assert np.allclose(there, frame.inverse_adjoint().T @ here @ frame.inverse_adjoint(), rtol=1e-7)


@given(seeds)
@settings(max_examples=30)
def test_free_directions_lie_in_the_null_space_also_behind_springs(seed):
    rng = np.random.default_rng(seed)
    joint = revolute("r", np.array([0.0, 1.0, 0.0]), place(rng))
    tip = joint.frame.adjoint() @ joint.directions
    chain = Series("s", (spring(rng, "a", place(rng)), joint, spring(rng, "b", place(rng))))
    k = as_stiffness(chain)
    scale = np.abs(k).max()
    assert np.allclose(k @ tip, 0.0, atol=1e-9 * scale)
    assert mobility(k)[0] == 1
    assert "moves freely in 1 direction" in singular_note(k)


def _tripod(rng):
    """Three struts that meet at the tool: it turns freely there, wherever its legs start."""
    axis = np.zeros((6, 6))
    axis[0, 0] = 1e-8
    legs = []
    for i in range(3):
        feet = Frame(rotation_of(rng.normal(size=3)), np.zeros(3))
        foot = spherical(f"foot{i}", Frame(translation=np.array([-0.5, 0.0, 0.0])))
        legs.append(Series(f"leg{i}", (foot, Spring(f"rod{i}", axis), spherical(f"tip{i}")), feet))
    return Parallel("tripod", tuple(legs))


def test_a_tool_that_turns_freely_has_mobility_and_no_deflection(rng):
    for _ in range(20):
        tripod = replace(_tripod(rng), frame=Frame(translation=rng.normal(size=3)))
        k = as_stiffness(tripod)
        assert mobility(k)[0] == 3
        assert np.abs(softest(k)).max() < 100.0
        with pytest.raises(InputError, match="moves freely"):
            respond(tripod, np.eye(6)[:, 3:4])


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Spring("s", np.eye(3)), r"s: expected a compliance \(..., 6, 6\), got shape \(3, 3\)"),
        (lambda: Spring("s", np.eye(6) + np.eye(6, k=1)), "s: not symmetric"),
        (lambda: Spring("s", -np.eye(6)), "s: diagonal entries must not be negative"),
        (lambda: Spring("s", np.full((2, 6, 6), np.nan)), "s: .* of finite numbers, got nan"),
        (lambda: Spring("s", np.eye(6), offset=np.ones(3)), "s: expected an offset"),
        (lambda: Spring("s", np.eye(6), Frame(2.0 * np.eye(3))), "s: .*orthonormal"),
        (lambda: Passive("p", np.ones(6)), "p: expected free directions"),
        (lambda: Weight("w", -1.0), "w: expected a mass"),
        (lambda: revolute("r", np.array([0.0, 2.0, 0.0])), "r: expected an axis of length 1"),
        (lambda: drive("d", 1e6, 2.0 * np.eye(6)[0]), "d: expected a direction of length 1"),
        (lambda: Parallel("g", ()), "g: expected at least one member"),
        (lambda: respond(Series("g", (Spring("s", np.eye(6)),) * 2), np.eye(6)), "s: two elements have this name"),
    ],
)
def test_what_is_no_element_is_refused_by_name(make, message):
    with pytest.raises(InputError, match=message):
        make()


@given(seeds)
@settings(max_examples=20)
def test_groups_in_series_agree_with_one_condensation(seed):
    """Two singular parallel groups and a spring in series: as one system with its inner bodies condensed."""
    rng = np.random.default_rng(seed)

    def loose(name):
        legs = tuple(
            Series(f"{name}{i}", (spring(rng, f"{name}{i}k", place(rng)), spherical(f"{name}{i}j", place(rng))))
            for i in range(2)
        )
        return Parallel(name, legs)

    first, second, link = loose("f"), loose("s"), spring(rng, "link", place(rng))
    k1, between, k2 = as_stiffness(first), stiffness_of(link), as_stiffness(second)
    k = as_stiffness(Series("whole", (first, link, second)))
    inner = np.block([[k1 + between, -between], [-between, between + k2]])
    out = np.vstack([np.zeros((6, 6)), -k2])
    condensed = k2 - out.T @ np.linalg.solve(inner, out)
    assert np.allclose(k, condensed, atol=1e-6 * np.abs(condensed).max())


@given(seeds)
@settings(max_examples=20)
def test_rigid_limit_and_idle_joints(seed):
    rng = np.random.default_rng(seed)
    a, b = spring(rng, "a"), spring(rng, "b", place(rng))
    firm = as_stiffness(Parallel("p", (Series("s", (a, Spring("rigid", np.zeros((6, 6))))), b)))
    assert np.allclose(firm, as_stiffness(Parallel("p", (a, b))))
    twice = revolute("r", np.array([0.0, 1.0, 0.0])), revolute("again", np.array([0.0, 1.0, 0.0]))
    once = as_stiffness(Parallel("p", (Series("s", (a, twice[0])), b)))
    idle = as_stiffness(Parallel("p", (Series("s", (a, *twice)), b)))
    assert np.allclose(once, idle, rtol=1e-8)


@given(seeds)
@settings(max_examples=20)
def test_reciprocity_and_superposition_of_loads_inside(seed):
    """What a misfit moves the tool by is what the tool's unit wrenches carry there (Betti)."""
    rng = np.random.default_rng(seed)
    leg = Series("leg", (spring(rng, "a", place(rng)), Weight("w", 3.0, place(rng)), spring(rng, "b", place(rng))))
    tree = Parallel("p", (leg, spring(rng, "c")))
    carried = respond(tree, np.eye(6)).elements["b"].wrench
    misfit = rng.normal(size=6) * 1e-6
    moved = tool_twist(edited(tree, "b", lambda n: Spring(n.name, n.compliance, n.frame, misfit)), misfit=True)
    assert np.allclose(moved, carried.T @ misfit, rtol=1e-8, atol=1e-18)
    both = tool_twist(tree, gravity=9.81)
    assert np.allclose(both, 9.81 * tool_twist(tree, gravity=1.0))
    weight = respond(tree, np.zeros((6, 1)), gravity=9.81).elements
    ground = sum(weight[n].frame.inverse_adjoint().T @ weight[n].wrench for n in ("a", "c"))
    load = np.concatenate([[0, 0, 29.43], np.cross(weight["w"].frame.origin(), [0, 0, 29.43])])
    assert np.allclose(ground[:, 0], load, atol=1e-9)


def test_a_rigid_parallel_member_is_refused_by_name(rng):
    rigid = Series("strut", (drive("only-x", 1e6, np.eye(6)[0]),))
    with pytest.raises(InputError, match="strut: rigid in a direction"):
        as_stiffness(Parallel("p", (rigid, spring(rng))))


def test_an_unknown_place_is_named_with_those_that_exist(robot):
    with pytest.raises(InputError, match=r"no element 'limb3.actuator'.*limb1.actuator"):
        edited(robot.tree([0, 0, 0.35]), "limb3.actuator", lambda node: node)


def test_an_open_chain_with_joints_has_no_deflection(rng):
    tree = Series("arm", (spring(rng), Passive("slide", np.eye(6)[:, :1])))
    with pytest.raises(InputError, match="moves freely in 1 directions"):
        respond(tree, np.eye(6))


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 0, 1), (0, 2, 1)])
def test_redundant_joints_free_the_same_in_every_order(order):
    joints = (revolute("a", np.eye(3)[1]), revolute("b", np.eye(3)[1]), Passive("slide", np.eye(6)[:, [1]]))
    leg = Series("leg", (Spring("spring", 1e-6 * np.eye(6)), *(joints[k] for k in order)))
    assert np.allclose(as_stiffness(leg), 1e6 * np.diag([1, 0, 1, 1, 0, 1]))
