"""What does not make a mechanism is refused by name, as the robot file spells it."""

from dataclasses import replace

import numpy as np
import pytest

from stiffscope.errors import InputError
from stiffscope.vjm.model.bodies import Body, member
from stiffscope.vjm.model.checks import BASE, TOOL, axes_along, check_compliance
from stiffscope.vjm.model.joints import Drive, Joint
from stiffscope.vjm.model.mechanism import Change, Mechanism, Tool
from stiffscope.vjm.statics.analysis import stiffness
from tests.vjm.files import biglide

C = np.diag([1e-9, 1e-8, 1e-8, 1e-7, 1e-7, 1e-7])


def arm(**changes):
    parts = {
        "bodies": (
            member("leg1.arm", [0, 0, 0], [1, 0, 0], C, mass=1.0),
            Body("hand", 1.0, [1, 0, 0]),
        ),
        "joints": (
            Joint(
                "leg1.motor",
                "ground",
                "leg1.arm.base",
                "revolute",
                [0, 0, 0],
                [0, 2, 0],
                drive=Drive(1e4),
            ),
            Joint("wrist", "leg1.arm.tip", "hand", "fixed", [1, 0, 0]),
        ),
        "tool": Tool("hand", [1, 0, 0], ("x",)),
    }
    return Mechanism(**(parts | changes))


def test_a_mechanism_knows_its_elements():
    m = arm()
    assert m.elements == (BASE, "leg1.motor", "wrist", "leg1.arm", TOOL)
    assert [j.name for j in m.drives] == ["leg1.motor"]
    assert m.joints[0].axes[:, 0] == pytest.approx([0, 1, 0])


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Body("a", 1.0), r"bodies\.a\.centre: expected the centre of mass"),
        (lambda: Body("ground"), r"bodies\.ground: expected a name of its own"),
        (
            lambda: Body("a", -1.0),
            r"bodies\.a\.mass: expected a mass of at least 0 kg, got -1",
        ),
        (
            lambda: member("a.b", [0, 0, 0], [0, 0, 0], C),
            r'bodies\."a\.b"\.x: expected a direction',
        ),
        (
            lambda: member("a", [0, 0, 0], [1, 0, 0], C, y=[2, 0, 0]),
            r"bodies\.a\.y: expected a direction other than x",
        ),
        (
            lambda: member("a", [0, 0, 0], [1, 0, 0], -C),
            r"bodies\.a\.compliance: diagonal entries must not be negative",
        ),
        (
            lambda: Joint("j", "a", "b", "hinge", [0, 0, 0]),
            r"joints\.j\.type: expected one of fixed, revolute",
        ),
        (
            lambda: Joint("j", "a", "b", "revolute", [0, 0, 0]),
            r"joints\.j\.axis: expected a direction",
        ),
        (
            lambda: Joint("j", "a", "b", "revolute", [0, 0, 0], [0, 0, 0]),
            r"joints\.j\.axis: expected a direction",
        ),
        (
            lambda: Joint("j", "a", "b", "universal", [0, 0, 0], [0, 0, 1]),
            r"joints\.j\.axis2: expected a direction",
        ),
        (
            lambda: Joint("j", "a", "b", "universal", [0, 0, 0], [0, 0, 1], [0, 0, 2]),
            r"joints\.j\.axis2: expected a direction other than axis",
        ),
        (
            lambda: Joint("j", "a", "b", "spherical", [0, 0, 0], drive=Drive(1.0)),
            r"joints\.j\.drive: expected a revolute, prismatic, cylindrical joint",
        ),
        (
            lambda: Joint(
                "j", "a", "b", "revolute", [0, 0, 0], [0, 0, 1], drive=Drive(0.0)
            ),
            r"joints\.j\.drive\.stiffness: expected a stiffness above 0",
        ),
        (
            lambda: Joint(
                "j",
                "a",
                "b",
                "revolute",
                [0, 0, 0],
                [0, 0, 1],
                drive=Drive(1.0, 2.0, 1.0),
            ),
            r"joints\.j\.drive\.range: expected its low end first",
        ),
        (
            lambda: Tool("a", [0, 0, 0], ("x", "u")),
            r"tool\.pose: expected some of x, y, z, rx, ry, rz",
        ),
        (
            lambda: arm(tool=Tool("foot", [0, 0, 0], ("x",))),
            r"tool\.body: expected a body .*leg1\.arm\.tip.*'foot'",
        ),
        (
            lambda: arm(tool=Tool("leg1.arm", [0, 0, 0], ("x",))),
            r"tool\.body: expected an end of the elastic body",
        ),
        (
            lambda: arm(joints=arm().joints[1:]),
            r'bodies\."leg1\.arm": expected joints that connect it with the ground',
        ),
        (
            lambda: arm(bodies=(*arm().bodies, Body("wrist"))),
            r"joints\.wrist: expected a name of its own, got that of bodies\.wrist",
        ),
        (
            lambda: arm(
                joints=(
                    *arm().joints,
                    Joint("x", "leg1.arm.tip", "leg1.arm.base", "fixed", [0, 0, 0]),
                )
            ),
            r"joints\.x\.between: expected two bodies",
        ),
    ],
)
def test_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()


def test_bodies_and_joints_may_be_called_base_and_tool():
    """Each against the same mechanism with other names; compliances of the base and the tool are something else."""
    m = arm(tool=Tool("hand", [1, 0, 0], ("z",)))
    named = Mechanism(
        (replace(m.bodies[0], name="tool"), replace(m.bodies[1], name="base")),
        (
            replace(m.joints[0], second="tool.base"),
            replace(m.joints[1], name="hand", first="tool.tip", second="base"),
        ),
        replace(m.tool, body="base"),
    )
    both = {BASE: Change(C), TOOL: Change(2 * C)}
    assert np.array_equal(stiffness(named, [0.1]), stiffness(m, [0.1]))
    assert np.array_equal(
        stiffness(named.change_elements(both), [0.1]),
        stiffness(m.change_elements(both), [0.1]),
    )


def test_changes_add_up_and_leave_the_original():
    m = arm()
    soft = m.change_elements(
        {
            "leg1.arm": Change(C),
            "wrist": Change(offset=np.ones(6)),
            BASE: Change(C),
            TOOL: Change(C),
        }
    )
    soft = soft.change_elements(
        {"leg1.arm": Change(C), "wrist": Change(offset=np.ones(6))}
    )
    assert np.allclose(soft.body("leg1.arm").elastic.compliance, 3 * C)
    assert np.allclose(soft.joint("wrist").offset, 2.0)
    assert np.allclose(m.body("leg1.arm").elastic.compliance, C)
    with pytest.raises(
        InputError, match=r"elements: expected one of <base>, leg1\.motor"
    ):
        m.change_elements({"arm": Change(C)})
    with pytest.raises(InputError, match="tool: diagonal entries must not be negative"):
        m.change_elements({TOOL: Change(-C)})


def test_axes_follow_the_next_base_axis_by_default():
    assert np.allclose(
        axes_along([0, 3, 0]), np.array([[0, 1, 0], [0, 0, 1], [1, 0, 0]]).T
    )
    turned = axes_along([1, 0, 0], [0, 1, 5])
    assert np.allclose(turned.T @ turned, np.eye(3))
    assert turned[1, 1] > 0


def test_a_mechanism_may_be_copied():
    m = biglide()
    assert replace(m, gravity=np.zeros(3)).joints is m.joints


def test_a_coupling_with_a_direction_that_does_not_yield_is_refused():
    matrix = np.diag([1e-8, 1e-8, 1e-8, 1e-7, 1e-7, 0.0])
    assert check_compliance(matrix, "tool", semidefinite=True)[5, 5] == 0.0
    assert np.array_equal(
        check_compliance(1e-190 * matrix, "tool", semidefinite=True), 1e-190 * matrix
    )
    matrix[3, 5] = matrix[5, 3] = -3e-9
    with pytest.raises(InputError, match="tool: not positive definite"):
        check_compliance(matrix, "tool", semidefinite=True)
