"""Deflection, its energy, and backlash."""

from dataclasses import replace

import numpy as np
import pytest

from stiffscope.vjm.model.bodies import Body, member
from stiffscope.vjm.model.joints import Drive, Joint
from stiffscope.vjm.model.mechanism import Mechanism, Tool
from stiffscope.vjm.statics.analysis import stiffness
from stiffscope.vjm.statics.yielding import deflection
from tests.robots import random_poses
from tests.vjm.files import biglide


def test_deflection_is_compliance_times_load_and_its_shares_are_all(rng):
    m = biglide()
    poses = random_poses(rng, 6)
    wrench = rng.normal(size=(6, 6))
    found = deflection(m, poses, wrench)
    expected = np.linalg.solve(stiffness(m, poses), wrench[..., None])[..., 0]
    assert np.allclose(found.twist, expected, rtol=1e-8)
    assert np.allclose(sum(found.shares.values()), 1.0, rtol=1e-9)


def sled(second=None):
    """A sled on one drive, or held by two against each other."""
    c = np.diag([1e-9, 1e-8, 1e-8, 1e-7, 1e-7, 1e-7])
    bodies = [Body("nut"), member("rod", [0, 0, 0], [1, 0, 0], c)]
    joints = [
        Joint(
            "drive",
            "ground",
            "nut",
            "prismatic",
            [0, 0, 0],
            [1, 0, 0],
            drive=Drive(1e6),
        ),
        Joint("bolt", "nut", "rod.base", "fixed", [0, 0, 0]),
    ]
    if second:
        bodies += [Body("nut2"), member("rod2", [2, 0, 0], [1, 0, 0], c, y=[0, 1, 0])]
        joints += [
            Joint(
                "drive2",
                "ground",
                "nut2",
                "prismatic",
                [2, 0, 0],
                [1, 0, 0],
                drive=Drive(second),
            ),
            Joint("bolt2", "nut2", "rod2.base", "fixed", [2, 0, 0]),
            Joint("bolt3", "rod2.tip", "rod.tip", "fixed", [1, 0, 0]),
        ]
    return Mechanism(tuple(bodies), tuple(joints), Tool("rod.tip", [1, 0, 0], ("x",)))


def push_with_backlash(m, half, forces):
    """Displacement along x under forces along it, the half of its lost motion in the first drive."""
    first, *others = m.joints
    joints = (replace(first, drive=first.drive.add_backlash(2.0 * half)), *others)
    wrenches = np.outer(forces, np.eye(6)[0])
    return deflection(
        replace(m, joints=joints), [[1.0]] * len(wrenches), wrenches
    ).twist[:, 0]


@pytest.mark.parametrize("force", [-50.0, 50.0])
def test_one_drive_shifts_by_its_gap_towards_the_load(force):
    (moved,) = push_with_backlash(sled(), 1e-4, [force])
    assert moved == pytest.approx(
        force * (1e-6 + 1e-9) + np.sign(force) * 1e-4, rel=1e-9
    )


def test_a_drive_in_its_gap_leaves_the_load_to_the_other():
    """Two drives side by side: a small load is carried by the one without a gap alone."""
    small, *large = push_with_backlash(sled(2e6), 1e-3, [1.0, 0.0, 1e4, 2e4])
    assert small == pytest.approx(1 / 2e6 + 1e-9, rel=1e-9)
    both = 1 / (1e6 / (1 + 1e-3) + 2e6 / (1 + 2e-3))
    assert np.diff(large)[1] == pytest.approx(1e4 * both, rel=1e-9)
    assert large[0] == 0.0
