"""The verified figures of the corrected mechanics, and what the paper prints (Tables 5 and 6, Eq. 30)."""

import numpy as np
import pytest

from stiffscope.biglide.audit import (
    findings_on_paper,
    matrix_findings,
    principal_findings,
    rms_findings,
)
from stiffscope.biglide.published_model import published_model
from stiffscope.vjm.statics.analysis import sag, stiffness
from stiffscope.vjm.statics.yielding import respond
from tests.robots import GEOMETRY, euler_bernoulli, nominal_robot, pose_at, robot_of

ENTRIES = ((0, 0), (1, 1), (2, 2), (3, 3), (4, 4), (5, 5), (0, 4), (1, 3))
TABLE = {  # K in 1e6 at x = y = 0; the last row with a rigid slider
    (36, True): (
        23.82111,
        1.96743,
        12.574307,
        1.464912,
        0.141031,
        2.819319,
        0.922902,
        0.325959,
    ),
    (66, True): (
        17.883256,
        1.96691,
        90.215325,
        3.442252,
        0.699246,
        0.759309,
        2.918568,
        0.494572,
    ),
    (36, False): (
        24.63093,
        1.969098,
        13.001783,
        1.495549,
        0.147504,
        2.874351,
        0.868302,
        0.318888,
    ),
}


@pytest.fixture(scope="module")
def paper():
    nominal = nominal_robot()
    return published_model(nominal.mechanism, nominal.robot.parameters)


def at(degrees):
    return pose_at(GEOMETRY, np.radians(degrees))


@pytest.mark.parametrize(("degrees", "slider"), TABLE)
def test_stiffness_table(robot, degrees, slider):
    machine = robot if slider else robot_of(euler_bernoulli(), np.zeros((6, 6)))
    matrix = stiffness(machine, at(degrees))[0] / 1e6
    assert np.allclose([matrix[e] for e in ENTRIES], TABLE[degrees, slider], atol=6e-7)
    for i, j in ENTRIES:
        matrix[i, j] = matrix[j, i] = 0.0
    assert np.abs(matrix).max() < 1e-11


def test_sag_and_thrust(robot):
    assert sag(robot, [0, 0, 0.35])[0, 2] * 1e6 == pytest.approx(10.78, abs=0.005)
    assert sag(robot, [at(35.8), at(64.3)])[:, 2] * 1e6 == pytest.approx(
        [11.049, 1.814], abs=2e-3
    )
    state = respond(robot, at(36), np.zeros(6), gravity=1.0)
    thrust = (7.93 / 2 + 3 * 1.95 / 2) * 9.81 / np.tan(np.radians(36))
    assert state.elements["limb1.actuator"].wrench[0, 0, 0] == pytest.approx(
        -thrust, rel=1e-9
    )  # inward
    assert thrust == pytest.approx(93, abs=0.5)


@pytest.mark.parametrize(
    ("degrees", "ppm"),
    [
        (35.8, (-4.3, 0.6, 156.8, 69.7, 232.6, -31.5)),
        (64.3, (-6.3, 0.5, 33.9, 5.7, 40.5, -15.8)),
    ],
)
def test_gravity_in_parts_per_million(robot, degrees, ppm):
    plain, exact = (
        np.diagonal(stiffness(robot, at(degrees), gravity=g)[0])
        for g in ("none", "exact")
    )
    assert np.allclose((exact / plain - 1) * 1e6, ppm, atol=0.06)


def test_bounds(robot, paper):
    assert paper.rotational_bound == pytest.approx(4.383e6, rel=2e-4)
    bounds = paper.bounds(np.radians([20, 36, 66]))
    assert np.allclose(bounds[:, :2], [[2.54e7, 1.9691e6]] * 3, rtol=1e-4)
    inside = stiffness(robot, [at(q) for q in (20, 36, 66)])
    assert (np.diagonal(inside, axis1=1, axis2=2) < bounds).all()


@pytest.mark.parametrize(
    ("degrees", "printed"),
    [
        (35.8, (25.40, 1.9691, 3681, 1.480, 20.92, 2.891)),
        (64.3, (25.40, 1.9691, 1536.7, 3.455, 8.99, 0.881)),
    ],
)
def test_reading_r1(paper, degrees, printed):
    assert np.allclose(
        np.diagonal(paper.reading_r1(np.radians(degrees))) / 1e6, printed, rtol=6e-4
    )


def test_audit_names_what_cannot_be(paper):
    rows = {
        "without_gravity": [20.664, 1.969, 3684, 1.538, 16.279, 2.883],
        "experiment": [22.568, 2.198, 4039, 1.687, 17.888, 3.155],
    }
    rows = {name: [1e6 * v for v in values] for name, values in rows.items()}
    found = {
        f.entry: f.verdict
        for f in principal_findings(paper, "Table 5", np.radians(35.8), rows)
    }
    assert "reading R1" in found["K_tz without_gravity"]
    assert "exceeds its bound 287-fold" in found["K_tz without_gravity"]
    assert found["K_ty without_gravity"].startswith("correct")
    assert "exceeds its bound by 12 %" in found["K_ty experiment"]
    assert "no reading" in found["K_tx without_gravity"]
    rms = {
        f.entry: f.verdict for f in rms_findings("Q1", {"without_gravity": 9.043}, rows)
    }
    assert rms == {"RMS without_gravity at Q1 (%)": "the root mean square"}
    matrix = np.diag([21.862, 1.969, 4015.669, 1.5, 17.337, 3.079]) * 1e6
    entries = {
        f.entry for f in matrix_findings(paper, "Eq. (30a)", np.radians(35.8), matrix)
    }
    assert {"K11", "K15", "K24", "K66"} <= entries


def test_every_published_number_has_its_finding():
    found = findings_on_paper(nominal_robot().robot, None)
    sources = [f.source for f in found]
    assert {
        name: sources.count(name) for name in ("Eq. (29)", "Table 5", "Table 6", "text")
    } == {
        "Eq. (29)": 8,
        "Table 5": 21,
        "Table 6": 21,
        "text": 4,
    }
    assert sources.count("Eq. (30a)") == sources.count("Eq. (30b)") > 8
    assert all(
        "beam formula, to its last digit" in f.verdict
        for f in found
        if f.source == "Eq. (29)"
    )
