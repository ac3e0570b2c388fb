"""Doubts on responses of a chain of two masses on springs, whose responses are known in closed form."""

import re
from dataclasses import replace

import numpy as np
import pytest

from stiffscope.responses.checks import (
    find_doubts,
    find_resonances,
    find_static_stiffness,
)
from stiffscope.responses.model import Direction, Response

K = np.array([[3e6, -1e6], [-1e6, 1e6]])  # N/m
M = np.diag([10.0, 4.0])  # kg
HERTZ = np.arange(1.0, 160.0, 0.25)


def receptance(damping=0.02):
    """(2, 2, f): modes of the pencil, each with the same damping ratio."""
    squares, shapes = np.linalg.eigh(
        np.diag(M.diagonal() ** -0.5) @ K @ np.diag(M.diagonal() ** -0.5)
    )
    shapes = np.diag(M.diagonal() ** -0.5) @ shapes
    omega = 2 * np.pi * HERTZ
    out = np.zeros((2, 2, len(HERTZ)), dtype=complex)
    for square, shape in zip(squares, shapes.T, strict=True):
        below = square - omega**2 + 2j * damping * omega * np.sqrt(square)
        out += np.outer(shape, shape)[..., None] / below
    return out, np.sqrt(squares) / (2 * np.pi)


H, MODES = receptance()


def measured(force, motion, values=None, **more):
    values = H[force - 1, motion - 1] if values is None else values
    given = {"coherence": None, "quantity": "receptance", "source": "test", **more}
    return Response(
        Direction(str(force), 2), Direction(str(motion), 2), HERTZ, values, **given
    )


ALL = [measured(1, 1), measured(1, 2), measured(2, 1), measured(2, 2)]


def test_sound_responses_give_no_doubt_and_their_resonances():
    assert find_doubts(ALL) == []
    for response in ALL:
        assert HERTZ[find_resonances(response)] == pytest.approx(MODES, abs=0.5)


@pytest.mark.parametrize("point", [1, 2])
@pytest.mark.parametrize("start", [1.0, 8.0])
def test_the_static_stiffness_lies_in_its_interval(point, start):
    response = measured(point, point)
    kept = start <= HERTZ
    response = replace(
        response, frequency=HERTZ[kept], receptance=response.receptance[kept]
    )
    static = find_static_stiffness(response)
    true = 1.0 / np.linalg.inv(K)[point - 1, point - 1]
    assert abs(static.stiffness - true) < static.spread < 0.2 * true
    assert static.band[0] == start
    assert find_static_stiffness(measured(1, 2)) is None


def test_a_band_above_the_first_resonance_shows_no_static_stiffness():
    kept = 1.05 * MODES[0] < HERTZ
    response = measured(1, 1)
    above = replace(
        response, frequency=HERTZ[kept], receptance=response.receptance[kept]
    )
    assert find_static_stiffness(above) is None


OMEGA = 2 * np.pi * HERTZ
WRONG = {
    "accelerance taken for receptance": (
        -(OMEGA**2),
        r"is it receptance, as stated .*f\^2\.\d",
    ),
    "mobility taken for receptance": (
        1j * OMEGA,
        r"is it receptance, as stated .*f\^1\.\d",
    ),
    "receptance taken for accelerance": (
        -1.0 / OMEGA**2,
        r"is it receptance, as stated .*f\^-\d",
    ),
    "reversed sign": (-1.0, "is the sign of force or motion reversed"),
}


@pytest.mark.parametrize("factor", WRONG)
def test_a_wrong_quantity_or_sign_shows_at_a_driving_point(factor):
    change, message = WRONG[factor]
    (doubt,) = find_doubts([measured(1, 1, change * H[0, 0])])
    assert "driving point" in doubt
    assert re.search(message, doubt)


def test_a_sensor_that_looks_against_the_force_is_no_reversed_sign():
    response = measured(1, 1, -H[0, 0])
    assert find_doubts([replace(response, motion=Direction("1", 2, -1))]) == []


def test_gain_of_one_sensor_breaks_reciprocity():
    (doubt,) = find_doubts([measured(1, 2, 1.5 * H[0, 1]), measured(2, 1)])
    assert "not reciprocal, 40 % apart" in doubt


def test_poor_coherence_and_too_few_lines_at_a_resonance_are_doubts():
    coherence = np.where(np.abs(HERTZ - MODES[0]) < 2, 0.5, 0.99)
    (doubt,) = find_doubts([measured(1, 1, coherence=coherence)])
    assert "coherence below 0.8" in doubt
    few = slice(None, None, 12)
    response = measured(1, 1)
    coarse = replace(
        response, frequency=HERTZ[few], receptance=response.receptance[few]
    )
    assert any("narrower than 3 lines" in doubt for doubt in find_doubts([coarse]))


def test_noise_has_no_resonances():
    """Lines of noise alone rise and fall by tens of dB; coherence tells that none of it is heard."""
    rng = np.random.default_rng(8)
    hertz = np.arange(5.0, 305.0, 0.5)
    clean = 1.0 / (1.0 - (hertz / 150.0) ** 2 + 0.02j * hertz / 150.0)
    noise = 0.6 * (150.0 / hertz) ** 4  # of an accelerometer, at low frequencies
    parts = rng.standard_normal((2, 5, len(hertz))) * noise
    hits = clean + parts[0] + 1j * parts[1]
    mean = hits.mean(axis=0)
    coherence = np.abs(mean) ** 2 / np.mean(np.abs(hits) ** 2, axis=0)
    ends = Direction("1", 2), Direction("1", 2)
    heard = Response(*ends, hertz, mean, coherence, "receptance", "tap")
    assert hertz[find_resonances(heard)] == pytest.approx([150.0], abs=1.0)
    deaf = Response(*ends, hertz, mean, None, "receptance", "tap")
    assert len(find_resonances(deaf)) > 3
