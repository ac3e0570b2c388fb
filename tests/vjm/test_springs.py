"""Springs in passive joints: a flexure-jointed hexapod against dense models, one joint in closed form."""

from dataclasses import replace

import numpy as np
import pytest

from stiffscope.errors import InputError
from stiffscope.vjm.kinematics.configurations import configure, configure_drives
from stiffscope.vjm.kinematics.mobility import mobility
from stiffscope.vjm.model.bodies import Body
from stiffscope.vjm.model.joints import Drive, Joint
from stiffscope.vjm.model.mechanism import Mechanism, Tool
from stiffscope.vjm.statics.analysis import analyse, sag, stiffness
from stiffscope.vjm.statics.yielding import deflection
from stiffscope.vjm.vibration.modes import frequencies, modes
from tests.vjm import dense_modes, oracle
from tests.vjm.files import CHECKED, read, serial_arm
from tests.vjm.potential import Potential

X, Y, Z = np.eye(3)
POSES = CHECKED["stewart"]["poses"]


def flexures(spring=35.0, weight=1.0):
    """The checked hexapod with springs in all its universal and ball joints, and a platform with inertia."""
    m = read("stewart")
    bodies: list[Body] = []
    for b in m.bodies:
        if b.name == "platform":
            bodies.append(
                replace(
                    b, mass=8.0, centre=m.tool.at, inertia=np.diag([0.1, 0.12, 0.2])
                )
            )
        else:
            centre = m.joint(f"{b.name.split('.')[0]}.drive").at
            bodies.append(
                replace(b, mass=0.3, centre=centre, inertia=np.diag([2e-3, 2e-3, 1e-4]))
            )
    joints = [
        replace(j, spring=spring) if j.kind in {"universal", "spherical"} else j
        for j in m.joints
    ]
    return replace(
        m, bodies=tuple(bodies), joints=tuple(joints), gravity=weight * m.gravity
    )


def off(a, b):
    """Largest difference of two matrices over the roots of the products of the second's diagonal."""
    return np.abs((a - b) / np.sqrt(np.outer(np.diagonal(b), np.diagonal(b)))).max()


def test_stiffness_and_frequencies_of_a_flexure_hexapod_are_those_of_dense_models():
    m = flexures()
    found = analyse(m, POSES)
    assert (found.mobility == 0).all()
    for pose, k, hertz in zip(POSES, found.matrix, frequencies(m, POSES), strict=True):
        dense = oracle.solve(oracle.Bodies(m).close(pose, 4))[0]
        assert off(k, dense) < 1e-8
        assert off(stiffness(read("stewart"), [pose])[0], dense) > 1e-6
        assert hertz == pytest.approx(
            dense_modes.frequencies(m, pose)[: len(hertz)], rel=1e-9
        )
    shares = deflection(m, POSES, [1.0, 2, 3, 0.1, 0.2, 0.3]).shares
    assert {name for name in shares if name.endswith((".foot", ".head"))}
    assert sum(shares.values()) == pytest.approx(1.0, abs=1e-9)


@pytest.mark.extended
def test_springs_away_from_rest_load_the_hexapod_as_its_potential_energy_says():
    m = flexures(2000.0, 100.0)
    pose = POSES[1]
    hessian, droop = Potential(oracle.Bodies(m).close(pose, 4)).tangent_stiffness()
    plain = stiffness(m, [pose])[0]
    exact = stiffness(m, [pose], gravity="exact")[0]
    assert sag(m, [pose])[0] == pytest.approx(
        droop, rel=0.0, abs=2e-2 * np.abs(droop).max()
    )
    assert off(exact, hessian) < 1e-3 * off(plain, hessian)
    assert off(plain, hessian) > 1e-5


def lever(**spring):
    """A lever of 0.5 m about y that a passive hinge carries, a drive at its end that pushes a slide along z."""
    bodies = (Body("lever", 2.0, np.array([0.5, 0.0, 0.0])),)
    joints = (Joint("hinge", "ground", "lever", "revolute", np.zeros(3), Y, **spring),)
    return Mechanism(
        bodies,
        joints,
        Tool("lever", [0.5, 0.0, 0.0], ("z",)),
        np.array([0.0, 0, -10.0]),
    )


def test_a_sprung_hinge_in_closed_form():
    m = lever(spring=40.0, rest=0.1)
    found = analyse(m, [[0.0]])
    compliance = found.compliance[0]
    assert compliance[4, 4] == pytest.approx(1 / 40)
    assert compliance[2, 2] == pytest.approx(0.25 / 40)
    assert sag(m, [[0.0]])[0, 4] == pytest.approx(0.1 + 2.0 * 10.0 * 0.5 / 40.0)
    angle = 0.2  # about y, where the tool is at z = -0.5 sin(angle)
    away = sag(m, [[-0.5 * np.sin(angle)]])[0, 4]
    assert away == pytest.approx(
        (0.1 - angle) + 2.0 * 10.0 * 0.5 * np.cos(angle) / 40.0
    )
    inertia = 2.0 * 0.25
    assert modes(m, [[0.0]], 1).frequencies[0, 0] == pytest.approx(
        np.sqrt(40.0 / inertia) / (2 * np.pi)
    )


def test_a_spring_is_no_constraint_of_the_motion():
    free = lever()
    sprung = lever(spring=40.0)
    assert mobility(free).dof == mobility(sprung).dof == 1
    assert len(mobility(free).loose) == 1
    assert not mobility(sprung).loose  # though no drive holds it
    poses = [[0.0], [-0.2]]
    assert np.array_equal(configure(free, poses).tool, configure(sprung, poses).tool)
    assert analyse(sprung, [[0.0]]).mobility[0] == 0
    with pytest.raises(InputError, match="moves freely"):
        analyse(free, [[0.0]])


def test_a_spring_in_series_with_a_drive_is_the_drive_of_both():
    """A serial arm whose last drive is a spring instead: the same compliance at every configuration."""
    m = serial_arm()
    last = m.drives[-1]
    passive = replace(last, drive=None, spring=last.drive.stiffness)
    other = replace(m, joints=tuple(passive if j is last else j for j in m.joints))
    where = configure_drives(m, np.full((1, len(m.drives)), 0.1))
    assert np.allclose(
        stiffness(m, where),
        stiffness(other, replace(where, mechanism=other)),
        rtol=1e-10,
    )


@pytest.mark.parametrize(
    ("kind", "more", "message"),
    [
        ("planar", {"spring": 3.0}, "got a planar one"),
        ("revolute", {"spring": 3.0, "drive": Drive(2.0)}, "expected a passive joint"),
        ("revolute", {"spring": -1.0}, "expected a stiffness above 0"),
        (
            "spherical",
            {"spring": 1.0, "rest": 0.1},
            "rest: expected a displacement of a revolute or prismatic joint",
        ),
    ],
)
def test_springs_that_cannot_be(kind, more, message):
    with pytest.raises(InputError, match=message):
        Joint("j", "ground", "b", kind, np.zeros(3), X, Y, **more)
