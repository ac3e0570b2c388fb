"""A robot condensed on its tool: its stiffness, and its own frequencies where the tool is free."""

import numpy as np
import pytest
import scipy.linalg

from stiffscope.errors import InputError
from stiffscope.vjm.kinematics.configurations import configure
from stiffscope.vjm.model.bodies import Body
from stiffscope.vjm.model.joints import Drive, Joint
from stiffscope.vjm.model.mechanism import Mechanism, Tool
from stiffscope.vjm.statics.analysis import stiffness
from stiffscope.vjm.vibration.superelement import superelement
from tests.vjm import dense_modes
from tests.vjm.test_modes import ROBOTS


def hertz(k, m):
    """Frequencies of K v = ω² M v, Hz."""
    return np.sqrt(scipy.linalg.eigh(k, m, eigvals_only=True)) / (2 * np.pi)


@pytest.mark.parametrize(
    "name", ["hexapod, rigid legs", "serial arm, frames", "biglide, frames with modes"]
)
def test_condensed_robot(name, rng):
    make, pose_of = ROBOTS[name]
    m = make(rng)
    pose = pose_of(m)
    found = configure(m, pose)
    elastic = dense_modes.frequencies(m, pose)
    elastic = elastic[elastic > 0.0]
    with_all = superelement(m, found, 1000)
    default = superelement(m, found)
    k = stiffness(m, found)[0]
    size = np.sqrt(np.diag(k))
    assert np.abs((with_all.stiffness[:6, :6] - k) / np.outer(size, size)).max() <= 1e-9
    exact, few = (hertz(each.stiffness, each.mass)[:6] for each in (with_all, default))
    count = min(6, len(exact), len(elastic))
    assert exact[:count] == pytest.approx(elastic[:count], rel=1e-6)
    assert few[:count] == pytest.approx(elastic[:count], rel=1e-6)


def test_a_tool_that_something_rigid_holds_is_refused():
    slide = Joint(
        "slide", "ground", "table", "prismatic", [0, 0, 0], [1, 0, 0], drive=Drive(1e6)
    )
    m = Mechanism(
        (Body("table", 2.0, [0, 0, 0], np.eye(3)),),
        (slide,),
        Tool("table", [0, 0, 0.1], ("x",)),
    )
    with pytest.raises(InputError, match="six directions"):
        superelement(m, configure(m, [0.0]))
