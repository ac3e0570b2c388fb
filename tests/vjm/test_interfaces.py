"""Bodies of more than two ends: a head once as three beams on a rigid hub, once as one matrix on four interfaces."""

from dataclasses import replace

import numpy as np
import pytest

from stiffscope.vjm.kinematics.configurations import configure
from stiffscope.vjm.model.bodies import Body, member, superelement_body
from stiffscope.vjm.model.checks import axes_along
from stiffscope.vjm.model.joints import Drive, Joint
from stiffscope.vjm.model.mechanism import Mechanism, Tool
from stiffscope.vjm.model.screws import shift
from stiffscope.vjm.statics.analysis import analyse, sag, stiffness, stiffness_error
from stiffscope.vjm.statics.yielding import deflection, respond
from stiffscope.vjm.vibration.modes import modes
from stiffscope.vjm.vibration.superelement import superelement
from tests.robots import euler_bernoulli, random_compliance

POSES = [[0.5, 0.0, 0.0], [0.51, 0.1, -0.05], [0.48, -0.12, 0.2]]
ANGLES = np.radians([0.0, 120.0, 240.0])
HUB, MASS, UP = np.array([0.0, 0.0, 0.5]), 0.6, np.array([0.0, 0.0, 1.0])
TIPS = [HUB + 0.2 * np.array([np.cos(a), np.sin(a), -0.1]) for a in ANGLES]
WRENCH = np.array([30.0, -50.0, 80.0, 4.0, -6.0, 9.0])


def beams():
    rng = np.random.default_rng(5)
    return [random_compliance(rng, euler_bernoulli()) for _ in TIPS]


def across():
    """Relative twist (6, 12) at the tip, part axes, for twists of hub and tip in base axes, of each beam."""
    out = []
    for tip in TIPS:
        turn = np.kron(np.eye(2), axes_along(tip - HUB, UP, "beam").T)
        out.append(turn @ np.hstack([-shift(tip - HUB), np.eye(6)]))
    return out


def robot(*head):
    """A tripod: legs that turn at the ground and slide, on balls under the head."""
    joints = []
    legs = []
    for k, (a, tip) in enumerate(zip(ANGLES, TIPS, strict=True)):
        foot = np.array([0.25 * np.cos(a), 0.25 * np.sin(a), 0.0])
        middle = 0.5 * (foot + tip)
        side = np.array([-np.sin(a), np.cos(a), 0.0])
        legs += [Body(f"lower{k}"), Body(f"upper{k}", 0.2, middle)]
        joints += [
            Joint(
                f"turn{k}",
                "ground",
                f"lower{k}",
                "revolute",
                foot,
                side,
                compliance=np.diag([1e-9] * 3 + [0] * 3),
            ),
            Joint(
                f"slide{k}",
                f"lower{k}",
                f"upper{k}",
                "prismatic",
                middle,
                tip - foot,
                drive=Drive(2e7),
            ),
            Joint(f"ball{k}", f"upper{k}", f"{head_node(head, k)}", "spherical", tip),
        ]
    links = [j for j in head if isinstance(j, Joint)]
    bodies = [*legs, *(b for b in head if isinstance(b, Body))]
    body = "hub" if links else "head.hub"
    tool = Tool(body, HUB, ("z", "rx", "ry"))
    return Mechanism(
        tuple(bodies), (*joints, *links), tool, np.array([0.0, 0.0, -9.81])
    )


def head_node(head, k):
    return (
        f"beam{k}.tip"
        if any(isinstance(each, Joint) for each in head)
        else f"head.{'abc'[k]}"
    )


def of_beams():
    made = [
        member(f"beam{k}", HUB, t, c, y=UP, mass=MASS)
        for k, (t, c) in enumerate(zip(TIPS, beams(), strict=True))
    ]
    welds = [Joint(f"weld{k}", "hub", f"beam{k}.base", "fixed", HUB) for k in range(3)]
    return robot(Body("hub", 1.0, HUB), *made, *welds)


def of_one_matrix(order=("hub", "a", "b", "c"), error=0.0):
    names = ["hub", "a", "b", "c"]
    places = np.array([HUB, *TIPS])
    k = np.zeros((24, 24))
    m = np.zeros((24, 24))
    for i, (relative, c) in enumerate(zip(across(), beams(), strict=True)):
        at = np.r_[:6, 6 * i + 6 : 6 * i + 12]
        k[np.ix_(at, at)] += relative.T @ np.linalg.solve(c, relative)
    for i, mass in enumerate([1.0 + 1.5 * MASS, *[MASS / 2] * 3]):
        m[6 * i : 6 * i + 3, 6 * i : 6 * i + 3] = mass * np.eye(3)
    rows = np.concatenate([6 * names.index(n) + np.arange(6) for n in order])
    ends = {n: places[names.index(n)] - HUB for n in order}
    head = superelement_body(
        "head", ends, k[np.ix_(rows, rows)], at=HUB, mass_matrix=m[np.ix_(rows, rows)]
    )
    bars = error * np.abs(head.elastic.compliance) if error else None
    return robot(replace(head, elastic=replace(head.elastic, error=bars)))


def off(a, b):
    size = np.sqrt(np.einsum("...ii->...i", b))
    return float(np.abs((a - b) / (size[..., :, None] * size[..., None, :])).max())


@pytest.mark.parametrize("order", [("hub", "a", "b", "c"), ("b", "hub", "c", "a")])
def test_one_matrix_is_the_three_beams_that_it_is_made_of(order):
    one = of_one_matrix(order)
    three = of_beams()
    assert off(stiffness(one, POSES), stiffness(three, POSES)) < 1e-9
    droop = sag(three, POSES)
    assert sag(one, POSES) == pytest.approx(
        droop, rel=1e-8, abs=1e-9 * np.abs(droop).max()
    )


def test_the_own_weight_stiffens_both_alike():
    """As the beams' strains are taken at the hub; at another end they differ in the second order."""
    change = [
        analyse(m, POSES, gravity="exact").matrix - stiffness(m, POSES)
        for m in (of_one_matrix(), of_beams())
    ]
    assert np.abs(change[0] - change[1]).max() < 1e-3 * np.abs(change[1]).max()


def test_energies_and_inner_forces_are_those_of_the_beams():
    one, three = (deflection(m, POSES, WRENCH) for m in (of_one_matrix(), of_beams()))
    assert "head" in one.shares
    assert not [name for name in one.shares if name.startswith("head.")]
    assert one.twist == pytest.approx(
        three.twist, rel=1e-8, abs=1e-9 * np.abs(three.twist).max()
    )
    assert one.shares["head"] == pytest.approx(
        sum(three.shares[f"beam{k}"] for k in range(3)), rel=1e-8
    )
    assert sum(one.shares.values()) == pytest.approx(np.ones(len(POSES)), rel=1e-9)
    a, b = (
        respond(m, POSES, WRENCH, gravity=1.0) for m in (of_one_matrix(), of_beams())
    )
    for k in range(3):
        moved = a.nodes[f"head.{'abc'[k]}"]
        expected = b.nodes[f"beam{k}.tip"]
        assert moved == pytest.approx(
            expected, rel=1e-7, abs=1e-8 * np.abs(expected).max()
        )


def test_modes_are_those_of_the_beams():
    one, three = (modes(m, POSES, 6) for m in (of_one_matrix(), of_beams()))
    assert one.frequencies == pytest.approx(three.frequencies, rel=1e-7)
    assert one.energy["head"] == pytest.approx(
        sum(three.energy[f"beam{k}"] for k in range(3)), abs=1e-6
    )


def test_bounds_on_every_entry_reach_the_robot():
    """A hundredth of each entry, to first order: no more than that of the stiffness where the head alone yields."""
    m = of_one_matrix(error=0.01)
    bars = stiffness_error(m, POSES)
    k = stiffness(m, POSES)
    assert (bars > 0.0).all()
    stiffer = replace(m, bodies=tuple(_scaled(b, 1.01) for b in m.bodies))
    assert (np.abs(stiffness(stiffer, POSES) - k) <= 1.02 * bars).all()
    assert (modes(m, POSES, 3).error > 0.0).all()


def _scaled(body, factor):
    if body.elastic is None:
        return body
    return replace(
        body, elastic=replace(body.elastic, compliance=factor * body.elastic.compliance)
    )


def test_the_superelement_of_the_robot_is_the_same():
    one, three = (
        superelement(m, configure(m, POSES[1:2])) for m in (of_one_matrix(), of_beams())
    )
    assert off(one.stiffness[:6, :6], three.stiffness[:6, :6]) < 1e-8
    assert one.mass[:6, :6] == pytest.approx(three.mass[:6, :6], rel=1e-6, abs=1e-6)


def test_a_rigid_head_is_one_rigid_body():
    flexible = of_one_matrix()
    stiff = replace(flexible, bodies=tuple(_scaled(b, 0.0) for b in flexible.bodies))
    nearly = replace(flexible, bodies=tuple(_scaled(b, 1e-11) for b in flexible.bodies))
    assert off(stiffness(nearly, POSES), stiffness(stiff, POSES)) < 1e-6
