"""Every type of joint and every kind of bearing says all that others ask of it."""

import inspect
import pickle

import numpy as np
import pytest

from stiffscope.files.keys import all_keys
from stiffscope.report.drawing.solids import _joints
from stiffscope.robot.file.element_sections import ELEMENTS
from stiffscope.robot.file.part_sections import PARAMETRIC
from stiffscope.robot.file.sections import JOINTS
from stiffscope.vjm.kinematics.linkage import find_free_coordinates
from stiffscope.vjm.model.joints import JOINT_TYPES, Drive, Joint
from stiffscope.vjm.model.screws import rotation

ANGLES = (0.3, -0.4, 0.5)
SHIFT = np.array([0.01, 0.02, -0.03])


def example(kind: str, **further) -> Joint:
    """A joint with as many axes as its type needs."""
    directions = {"axis": [0.0, 0.0, 1.0], "axis2": [1.0, 0.0, 0.0]}
    needed = dict(list(directions.items())[: JOINT_TYPES[kind].needed_axes])
    return Joint("j", "ground", "body", kind, np.zeros(3), **needed, **further)


@pytest.mark.parametrize("kind", JOINT_TYPES)
def test_a_type_of_joint_says_all_that_is_asked_of_it(kind):
    made = JOINT_TYPES[kind]
    joint = example(kind)
    section = JOINTS[kind]
    assert joint.type is section.describes is made
    assert inspect.getdoc(section) == made.about
    assert all(
        row.means for row in all_keys()["robot"][f'[joints.NAME], type = "{kind}"']
    )
    held = [k + 3 * turns for turns in (0, 1) for k in joint.held_components[turns]]
    assert sorted((*held, *made.free)) == list(range(6))
    assert ("drive" in section.model_fields) == (made.driven in made.free)
    assert ("spring" in section.model_fields) == made.is_uniform
    assert "axis" in section.model_fields or not made.needed_axes
    if made.driven is not None:
        assert example(kind, drive=Drive(1e6)).driven == made.free.index(made.driven)
        assert made.turns == (made.driven > 2)
    scene = {"name": "j", "kind": kind, "first": "ground", "second": "body"}
    scene |= {"at": joint.at, "axis": joint.axis, "axis2": joint.axis2, "driven": False}
    drawn = list(_joints([scene], {"j": (0.01, 0.02)}, 1.0))
    assert bool(drawn) == bool(made.symbol) == bool(made.free)


@pytest.mark.parametrize("kind", JOINT_TYPES)
def test_coordinates_are_the_motions_in_the_order_of_the_free_components(kind):
    """The second body is moved along and about the joint's own axes, one motion at a time."""
    joint = example(kind)
    free = joint.type.free
    for column, component in enumerate(free):
        axis = joint.axes[:, component % 3]
        turns = component > 2
        across = rotation(axis, ANGLES[column]) if turns else np.eye(3)
        gap = np.zeros(3) if turns else axis * SHIFT[column]
        found = find_free_coordinates(joint, across[None], gap[None])
        value = ANGLES[column] if turns else SHIFT[column]
        expected = value * np.eye(len(free))[column]
        if joint.type.is_ball:  # base axes
            expected = value * axis
        assert found[0] == pytest.approx(expected, abs=1e-12)


def test_every_kind_of_bearing_is_documented():
    titles = [title for title in all_keys()["robot"] if title.startswith("bearing of")]
    for kind, model in ELEMENTS.items():
        assert inspect.getdoc(model)
        assert sum(kind in title for title in titles) == 1


def test_sections_cross_to_other_processes_by_name():
    """Classes that cross by value would be changed by what comes back."""
    for section in (*JOINTS.values(), *PARAMETRIC.values()):
        assert pickle.loads(pickle.dumps(section)) is section  # noqa: S301
