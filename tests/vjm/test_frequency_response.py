"""Frequency response against a dense solution, the static compliance and one mass on a spring."""

import numpy as np
import pytest

from stiffscope.errors import InputError
from stiffscope.vjm.kinematics.configurations import configure
from stiffscope.vjm.model.bodies import Body
from stiffscope.vjm.model.joints import Drive, Joint
from stiffscope.vjm.model.mechanism import Mechanism, Tool
from stiffscope.vjm.statics.analysis import stiffness
from stiffscope.vjm.vibration.frequency_response import Port, frequency_response
from tests.robots import GEOMETRY, pose_at
from tests.vjm import dense_modes
from tests.vjm.files import biglide, serial_arm
from tests.vjm.test_modes import framed

HERTZ = np.array([3.0, 40.0, 91.0, 260.0, 777.0])


@pytest.mark.parametrize("name", ["biglide", "serial arm"])
def test_response_is_that_of_a_dense_solution(name, rng):
    if name == "biglide":
        m = framed(biglide(), rng, 2)
        pose = pose_at(GEOMETRY, 0.7, 0.05)
        first = "platform"
        second = "limb1.link2.tip"
    else:
        m = framed(serial_arm(), rng)
        pose = [0.85, 0.1, 1.1, 0.1, 0.05, -0.1]
        first = "link6.tip"
        second = "link3.tip"
    ends = [(node, rng.normal(size=3), rng.normal(size=6)) for node in (first, second)]
    expected = dense_modes.receptance(m, pose, *ends, HERTZ)
    found = frequency_response(
        m, configure(m, pose), *(Port(*end) for end in ends), HERTZ, damping=0.0
    )
    assert found.real == pytest.approx(expected, rel=1e-6)
    back = frequency_response(
        m, configure(m, pose), *(Port(*end) for end in reversed(ends)), HERTZ
    )
    assert back == pytest.approx(
        frequency_response(m, configure(m, pose), *(Port(*end) for end in ends), HERTZ)
    )


def test_slow_response_is_the_compliance(rng):
    m = framed(biglide(), rng, 2)
    pose = pose_at(GEOMETRY, 0.7, 0.05)
    c = np.linalg.inv(stiffness(m, pose)[0])
    tool = [Port(None, m.tool.at, e) for e in np.eye(6)]
    for i, j in ((0, 0), (2, 4), (5, 5)):
        slow = frequency_response(m, configure(m, pose), tool[i], tool[j], [1e-3])[0]
        assert slow.real == pytest.approx(
            c[j, i], rel=1e-6, abs=1e-9 * np.sqrt(c[i, i] * c[j, j])
        )


def test_a_damped_mass_on_a_spring():
    slide = Joint(
        "slide", "ground", "car", "prismatic", [0, 0, 0], [1, 0, 0], drive=Drive(4e6)
    )
    m = Mechanism(
        (Body("car", 2.5, [0.3, 0, 0]),), (slide,), Tool("car", [0.1, 0, 0], ("x",))
    )
    found = configure(m, [[0.1]])
    port = Port("car", np.zeros(3), np.eye(6)[0])
    w = 2 * np.pi * HERTZ
    expected = 1.0 / (4e6 - 2.5 * w**2 + 2j * 0.03 * w * np.sqrt(4e6 * 2.5))
    assert frequency_response(
        m, found, port, port, HERTZ, damping=0.03
    ) == pytest.approx(expected)
    free = frequency_response(m, found, port, port, HERTZ, damping=0.03, drives="free")
    assert free == pytest.approx(-1.0 / (2.5 * w**2))
    for wrong, message in (([0.0], "above 0 Hz"), (HERTZ, "damping: expected")):
        with pytest.raises(InputError, match=message):
            frequency_response(m, found, port, port, wrong, damping=1.5)
