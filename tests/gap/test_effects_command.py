"""A robot file carries the effects that it has adopted, and every command uses them."""

import numpy as np
import pytest

from stiffscope.errors import InputError
from stiffscope.experiments.assembly import assemble
from stiffscope.robot.library import find_robot
from stiffscope.robot.reader import load_robot
from stiffscope.vjm.statics.analysis import stiffness

pytestmark = pytest.mark.slow

TEXT = find_robot("biglide").read_text(encoding="utf-8")
BASE = 'effect = "base-compliance"\nplace = "base"'
SLIDERS = 'effect = "slider-compliance"\nplace = "sliders"'
ADOPTED = (
    'effect = "actuator-stiffness"\nplace = "limb1"\nparameters = { factor = 0.8 }'
)
SOFT_DRIVE = f"""
[[effects]]
{ADOPTED}
provenance = {{ campaign = "c" }}
"""


@pytest.fixture
def assembled(tmp_path):
    def from_text(text):
        path = tmp_path / "robot.toml"
        path.write_text(text, encoding="utf-8")
        return assemble(load_robot(path), "published")

    return from_text


def test_adopted_effects_change_the_robot_in_their_order(assembled):
    at = [[0.05, 0.02, 0.4]]
    plain, soft, softer = (
        stiffness(assembled(TEXT + n * SOFT_DRIVE), at)[0] for n in (0, 1, 2)
    )
    x = [np.linalg.inv(k)[0, 0] for k in (plain, soft, softer)]
    drive = (
        1 / 12.7e6
    )  # the two limbs share the force along x, so limb 1's drive has a part of it
    assert 0 < x[1] - x[0] < 0.25 * drive
    assert (x[2] - x[1]) / (x[1] - x[0]) == pytest.approx(
        (1 / 0.64 - 1 / 0.8) / 0.25, rel=0.05
    )


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            '"actuator-stiffness"',
            '"actuator"',
            "effects[0]: effect: expected one of gravity, payload",
        ),
        (
            '"limb1"',
            '"limb3"',
            "effects[0]: actuator-stiffness, place: expected one of stage, limb1, limb2, limbs, drives, got 'limb3'",
        ),
        (
            "factor",
            "faktor",
            "effects[0]: actuator-stiffness: expected parameters factor, got faktor",
        ),
        ("0.8", '"0.8 m"', "effects[0].parameters.factor: expected a number"),
        ('"actuator-stiffness"', '"backlash"', "effects"),
        (
            "factor = 0.8",
            "",
            "effects[0]: actuator-stiffness @ limb1: expected parameters factor, got none",
        ),
        (
            "0.8",
            "-0.8",
            "effects[0]: actuator-stiffness @ limb1, factor: expected more than 0, got -0.8",
        ),
        (
            ADOPTED,
            f"{BASE}\nparameters = {{ x = -1e-6 }}",
            "base: diagonal entries must not be negative",
        ),
        (
            ADOPTED,
            f"{SLIDERS}\nparameters = {{ c11 = -1e-9 }}",
            'bodies."limb1.slider".compliance: diagonal entries must not be negative',
        ),
    ],
)
def test_what_no_robot_can_carry_is_refused(assembled, old, new, message):
    with pytest.raises(InputError, match=r"robot\.toml") as refused:
        assembled(TEXT + SOFT_DRIVE.replace(old, new))
    assert message in str(refused.value)
