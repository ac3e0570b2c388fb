"""Stability of cuts: closed forms, published multipliers, simulations in the time domain."""

import numpy as np
import pytest
from scipy.optimize import brentq

from stiffscope.lobes import floquet
from stiffscope.lobes.bands import relative_error
from stiffscope.lobes.engagement import milling, one_direction, turning
from stiffscope.lobes.floquet import is_stable
from stiffscope.lobes.methods import limits_at, sweep_limits, worst_limits
from stiffscope.lobes.zero_order import (
    find_coupling,
    find_critical,
    zero_order_limits,
)
from tests.lobes.machines import flexible, machine, spring_mass
from tests.lobes.semi_discretization import largest_multiplier
from tests.lobes.simulation import grows

pytestmark = pytest.mark.slow

KT = 1e9
PUSHED = one_direction(KT, (1.0, 0.0, 0.0), (-1.0, 0.0, 0.0))


@pytest.mark.parametrize("damping", [0.001, 0.03, 0.2])
def test_one_degree_of_freedom_has_the_closed_limit(damping):
    # min Re G = -1 / (4 k ζ (1 + ζ)): S. A. Tobias, Machine-Tool Vibration, Blackie 1965
    found = find_critical(spring_mass(1e7, 300.0, damping), PUSHED)
    assert found.depth[0] == pytest.approx(2e7 * damping * (1 + damping) / KT, rel=1e-9)
    assert found.omega[0] == pytest.approx(
        600.0 * np.pi * np.sqrt(1.0 + 2.0 * damping), rel=1e-5
    )


def test_one_degree_of_freedom_has_the_closed_lobes():
    rate = 600.0 * np.pi
    damping = 0.03
    speeds = np.linspace(1000.0, 30000.0, 60) / 60.0
    found = zero_order_limits(spring_mass(1e7, 300.0, damping), PUSHED, speeds).depth[0]

    def receptance(omega):
        return 1e-7 / (1.0 - (omega / rate) ** 2 + 2j * damping * omega / rate)

    for speed, depth in zip(speeds, found, strict=True):
        limits = []
        for lobe in range(40):

            def miss(omega, speed=speed, lobe=lobe):
                turn = 2.0 * np.angle(-receptance(omega)) + np.pi
                return omega / speed - turn - 2.0 * np.pi * lobe

            ends = rate * (1.0 + 1e-9), 20.0 * rate
            if miss(ends[0]) < 0.0 < miss(ends[1]):
                omega = brentq(miss, *ends, xtol=1e-9)
                limits.append(-0.5 / (KT * receptance(omega).real))
        assert depth == pytest.approx(min(limits), rel=2e-3)


@pytest.mark.parametrize("ends", [(60.0, 260.0), (150.0, 156.0), (400.0, 900.0)])
def test_the_least_lobe_is_the_limit_at_all_speeds(ends):
    rng = np.random.default_rng(5)
    cut = milling(teeth=4, width=10e-3, diameter=10e-3, stiffness=7e8)
    for _ in range(5):
        response = flexible(rng)
        lobes = zero_order_limits(response, cut, np.linspace(*ends, 3000)).depth[0]
        found = find_critical(response, cut, ends)
        assert found.depth[0] == pytest.approx(lobes.min(), rel=2e-3)
        assert found.depth[0] <= lobes.min() * (1.0 + 1e-6)


def test_a_slot_by_four_teeth_has_constant_coefficients():
    slot = {"width": 1.0, "diameter": 1.0, "stiffness": 7e8}
    assert milling(teeth=4, **slot).ripple < 1e-12
    assert milling(teeth=2, **slot).interrupted


def test_all_harmonics_of_constant_coefficients_are_the_zero_order_solution():
    cut = milling(teeth=4, width=10e-3, diameter=10e-3, stiffness=7e8)
    response = flexible(np.random.default_rng(8))
    speeds = np.linspace(60.0, 260.0, 12)
    found = limits_at(response, cut, speeds, "all-harmonics")
    plain = zero_order_limits(response, cut, speeds)
    assert found.depth == pytest.approx(plain.depth, rel=1e-4)
    assert found.omega == pytest.approx(plain.omega, rel=1e-4)
    for name in ("by_rate", "by_damping"):
        ours = found.relative_change(getattr(found, name))
        theirs = plain.relative_change(getattr(plain, name))
        assert ours == pytest.approx(theirs, rel=1e-2, abs=1e-2)


@pytest.mark.parametrize("width", [10e-3, 3e-3, 0.5e-3])
@pytest.mark.parametrize("speed", [5000.0 / 60.0, 190.0])
def test_limits_of_interrupted_cuts_are_those_of_semi_discretization(width, speed):
    # machine of Insperger and Stépán: one mode of 922 Hz, 1.1 %, 0.03993 kg along the feed; two
    # teeth, 6e8 and 2e8 N/m²
    response = machine([922.0], 0.011, [[0.03993**-0.5], [0.0], [0.0]])
    cut = milling(teeth=2, width=width, diameter=10e-3, stiffness=6e8, radial=1.0 / 3.0)
    found = limits_at(response, cut, np.array([speed]), "all-harmonics").depth[0, 0]
    radius = [
        largest_multiplier(
            922.0,
            0.011,
            0.03993,
            teeth=2,
            start=cut.start,
            end=cut.end,
            tangential=6e8,
            normal=2e8,
            speed=speed,
            depth=share * found,
        )
        for share in (0.99, 1.01)
    ]
    assert radius[0] < 1.0 < radius[1]


def _points(rng, response, cut, count):
    """Return random cuts further than 5 % from the boundary, and whether they are stable."""
    least = float(find_critical(response, cut).depth[0])
    points = []
    while len(points) < count:
        speed = rng.uniform(30.0, 250.0)
        depth = least * rng.uniform(0.5, 4.0)
        beside = [depth * share for share in (0.95, 0.975, 1.0, 1.025, 1.05)]
        if cut.interrupted:
            stable = {is_stable(response, cut, speed, each) for each in beside}
        else:
            limit = zero_order_limits(response, cut, np.array([speed])).depth[0, 0]
            stable = {bool(each < limit) for each in beside}
        if len(stable) == 1:
            points.append((speed, depth, stable.pop()))
    return points


def check_by_simulation(rng, cut, machines, cuts, simulated):
    """Assert that simulations call stable what the limits of random machines call so.

    ``simulated``: the cut as the simulation takes it, each number for all cuts alike.
    """
    agreed = 0
    told = []
    for _ in range(machines):
        response = flexible(rng)
        points = _points(rng, response, cut, cuts)
        speed, depth, stable = (np.array(each) for each in zip(*points, strict=True))
        alike = {
            name: value if isinstance(value, np.ndarray) else np.full(cuts, value)
            for name, value in simulated.items()
        }
        grown = grows(
            response.rates[0],
            response.damping[0],
            response.shapes[0, :2],
            alike | {"speed": speed, "depth": depth},
        )
        agreed += int((grown != stable).sum())
        told += list(stable)
    assert agreed >= 98
    assert 20 <= sum(told) <= 80


@pytest.mark.extended_for("2-0.0005-True", "3-0.007-True", "4-0.01-True")
@pytest.mark.parametrize(
    ("teeth", "width", "climb"),
    [
        (4, 10e-3, True),
        (3, 7e-3, True),
        pytest.param(2, 0.5e-3, False, marks=pytest.mark.extended),
        pytest.param(2, 0.5e-3, True, marks=pytest.mark.extended),
    ],
)
def test_simulations_in_the_time_domain_agree(teeth, width, climb):
    rng = np.random.default_rng(teeth + int(1e5 * width))
    cut = milling(
        teeth=teeth,
        width=width,
        diameter=10e-3,
        stiffness=7e8,
        radial=0.3,
        climb=climb,
    )
    swept = np.arccos(1.0 - 2.0 * width / 10e-3)
    simulated = {
        "teeth": teeth,
        "start": np.pi - swept if climb else 0.0,
        "end": np.pi if climb else swept,
        "kt": 7e8,
        "kr": 0.3,
    }
    check_by_simulation(rng, cut, machines=5, cuts=20, simulated=simulated)


@pytest.mark.extended
def test_simulations_of_turning_agree():
    rng = np.random.default_rng(1)
    lead = np.deg2rad(75.0)
    cut = turning(stiffness=1e9, radial=0.4, lead=lead, side=-1.0)
    # feed along x, the workpiece passes against y; thrust against the chip's normal
    normal = np.array([np.sin(lead), 0.0])
    force = np.array([-0.4 * np.sin(lead), -1.0]) / np.sin(lead)
    simulated = {"teeth": 1.0, "kt": 1e9, "normal": normal, "force": force}
    check_by_simulation(rng, cut, machines=4, cuts=25, simulated=simulated)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_turning_by_one_mode_has_the_closed_limit(side):
    # one mode along d: λ = (n·d)(d·c) / ..., so that b = 2 k ζ (1 + ζ) / (K (-(n·d)(d·c)))
    lead = np.deg2rad(60.0)
    along = np.array([np.cos(0.4), side * np.sin(0.4), 0.0])
    shape = 600.0 * np.pi / np.sqrt(2e7) * along
    response = machine([300.0], 0.025, shape[:, None])
    cut = turning(stiffness=1.4e9, radial=0.5, lead=lead, side=side)
    found = find_critical(response, cut)
    chip = np.sin(lead) * np.cos(0.4)
    # tangential force along y, thrust against the normal; the edge is longer by 1 / sin κ
    push = (0.5 * np.sin(lead) * np.cos(0.4) - np.sin(0.4)) / np.sin(lead)
    if push > 0.0:
        expected = 4e7 * 0.025 * 1.025 / (1.4e9 * chip * push)
    else:  # positive feedback: the limit is that of the least real part
        expected = 4e7 * 0.025 * 0.975 / (1.4e9 * chip * -push)
    assert found.depth[0] == pytest.approx(expected, rel=1e-6)


def test_lobes_of_a_textbook_shaper_are_as_published():
    # Y. Altintas, Manufacturing Automation, 2nd ed., Cambridge 2012, p. 131: a shaper with two
    # modes 30° and -45° from the cutting direction, Kf = 1000 N/mm². The lobes were published by
    # the Manufacturing Automation Laboratory, University of British Columbia (J. Li, repository
    # leekunhwee/Dynamics, Cutting/Stability/FrequencyDomain/Turning/Two DOF Example/Lobe.png);
    # depths at the bottom of both lobes were read from the picture, whose pixel is 0.22 mm and
    # 33 rpm, to a quarter of a pixel.
    angles = np.deg2rad([30.0, -45.0])
    rates = 2.0 * np.pi * np.array([250.0, 150.0])
    directions = np.stack([np.cos(angles), np.sin(angles), 0.0 * angles])
    response = machine(
        [250.0, 150.0],
        [0.012, 0.01],
        directions * rates / np.sqrt([2.26e8, 2.13e8]),
    )
    cut = one_direction(1e9, (1.0, 0.0, 0.0), (-1.0, 0.0, 0.0))
    for speed, depth in ((8676.0, 7.215e-3), (11865.0, 9.487e-3)):
        speeds = np.linspace(0.9 * speed, 1.1 * speed, 401) / 60.0
        lobes = zero_order_limits(response, cut, speeds).depth[0]
        best = lobes.argmin()
        assert lobes[best] == pytest.approx(depth, rel=0.01)
        assert 60.0 * speeds[best] == pytest.approx(speed, rel=0.01)


@pytest.mark.extended
def test_modes_couple_from_the_same_depth_in_the_time_domain():
    # low-frequency chatter: no wave is left by the tooth before
    across = np.sqrt(0.5) * np.array([[1.0, 1.0], [1.0, -1.0], [0.0, 0.0]])
    response = machine([20.0, 22.0], 0.03, across * 0.3)
    cut = milling(teeth=4, width=10e-3, diameter=10e-3, stiffness=7e8)
    depth = find_coupling(response, cut)[0]
    assert np.isfinite(depth)
    share = np.array([0.9, 0.97, 1.03, 1.1])
    full = np.ones(len(share))
    cuts = {
        "teeth": 4 * full,
        "start": 0.0 * full,
        "end": np.pi * full,
        "kt": 7e8 * full,
        "kr": 0.3 * full,
        "speed": 40.0 * full,
        "depth": depth * share,
    }
    grown = grows(
        response.rates[0],
        response.damping[0],
        response.shapes[0, :2],
        cuts,
        waves=False,
    )
    assert grown.tolist() == [False, False, True, True]
    # the diagonal of the response alone would never couple
    alone = machine([20.0, 22.0], 0.03, np.array([[0.3, 0.0], [0.0, 0.3], [0.0, 0.0]]))
    assert find_coupling(alone, cut)[0] > depth


def test_modes_across_each_other_chatter_without_waves():
    # two equal modes at 45° and 0.1 of frequency apart couple by the tangential force
    across = np.sqrt(0.5) * np.array([[1.0, 1.0], [1.0, -1.0], [0.0, 0.0]])
    response = machine([20.0, 22.0], 0.03, across * 0.3)
    cut = milling(teeth=4, width=10e-3, diameter=10e-3, stiffness=7e8)
    depth = find_coupling(response, cut)[0]
    assert np.isfinite(depth)
    loop = response.shapes[0].T @ cut.mean @ response.shapes[0]
    rates = response.rates[0]

    def fastest(depth):
        system = np.zeros((4, 4))
        system[:2, 2:] = np.eye(2)
        system[2:, :2] = -np.diag(rates**2) + depth * loop
        system[2:, 2:] = -np.diag(2.0 * 0.03 * rates)
        return np.linalg.eigvals(system).real.max()

    assert fastest(0.97 * depth) < 0.0 < fastest(1.03 * depth)


CUTS = {
    "slot": {"teeth": 4, "width": 10e-3},
    "interrupted": {"teeth": 2, "width": 2e-3},
}


def _plant(rng, stated, doubt, shift, force):
    """Return a machine within the bounds of a stated one, and its cutting force over the stated."""
    damping = stated.damping * np.exp(rng.normal(size=doubt.shape) * _spread(doubt))
    rates = stated.rates * np.exp(rng.normal(size=shift.shape) * _spread(shift))
    truth = machine(rates[0] / (2.0 * np.pi), damping, stated.shapes[0])
    return truth, np.exp(rng.normal() * _spread(force))


def _spread(bound):
    return np.log1p(bound) / 1.96


@pytest.mark.extended
@pytest.mark.parametrize("name", CUTS)
def test_bands_hold_95_per_cent_of_planted_machines(name):
    rng = np.random.default_rng(12)
    cut = milling(diameter=10e-3, stiffness=7e8, **CUTS[name])
    method = "all-harmonics" if cut.interrupted else "zero-order"
    ends = (100.0, 300.0)
    inside = []
    at_speed = []
    for _ in range(500):
        plain = flexible(rng)
        doubt = rng.uniform(0.05, 0.5, plain.damping.shape)
        shift = rng.uniform(0.005, 0.05, plain.damping.shape)
        force = rng.uniform(0.0, 0.2)
        stated = machine(
            plain.rates[0] / (2.0 * np.pi),
            plain.damping,
            plain.shapes[0],
            frequency_error=shift,
            damping_error=doubt,
        )
        truth, stiffer = _plant(rng, stated, doubt, shift, force)
        for limits, hits in (
            (lambda each: worst_limits(each, cut, ends, method), inside),
            (
                lambda each: limits_at(each, cut, np.array([200.0]), method)[:, 0],
                at_speed,
            ),
        ):
            found = limits(stated)
            width = relative_error(found, stated, force, method)[0]
            depth = limits(truth).depth[0] / stiffer
            hits.append(abs(np.log(depth / found.depth[0])) < width)
    assert 0.93 <= np.mean(inside) <= 0.97
    assert 0.93 <= np.mean(at_speed) <= 0.97


def test_a_sweep_is_what_each_speed_gives():
    cut = milling(diameter=10e-3, stiffness=7e8, **CUTS["interrupted"])
    response = flexible(np.random.default_rng(2))
    speeds = np.linspace(60.0, 300.0, 200)
    swept = sweep_limits(response, cut, speeds, "all-harmonics")
    alone = limits_at(response, cut, speeds, "all-harmonics")
    assert swept.depth == pytest.approx(alone.depth, rel=5e-3)
    found = worst_limits(response, cut, (60.0, 300.0), "all-harmonics")
    assert found.depth[0] == pytest.approx(alone.depth.min(), rel=2e-3)


@pytest.mark.parametrize("method", ["zero-order", "all-harmonics"])
def test_the_slope_of_the_lobes_is_that_of_their_limits(method):
    cut = milling(diameter=10e-3, stiffness=7e8, **CUTS["interrupted"])
    response = flexible(np.random.default_rng(2))
    speeds = np.array([70.0, 120.0, 210.0])
    step = 1e-4
    found = limits_at(response, cut, speeds, method)
    beside = [
        limits_at(response, cut, speeds * np.exp(sign * step), method).depth
        for sign in (1.0, -1.0)
    ]
    slope = np.log(beside[0] / beside[1]) / (2.0 * step)
    assert found.relative_change(found.by_speed) == pytest.approx(slope, rel=1e-2)


def test_narrow_islands_of_instability_are_found():
    # a serial arm's modes; against a circle of multipliers so dense that none is passed over
    response = machine(
        [18.7, 24.9, 32.2, 112.9, 173.1, 212.4],
        0.03,
        [
            [-0.066, 0.286, -0.429, -0.293, 0.663, 0.703],
            [0.08, 0.496, 0.246, 0.379, 0.709, 0.378],
            [0.0] * 6,
        ],
    )
    # without the island at the first speed the depth is six times as large
    cut = milling(teeth=2, width=2e-3, diameter=10e-3, stiffness=7e8)
    speeds = np.append(292.0, np.random.default_rng(6).uniform(100.0, 300.0, 30))
    found = limits_at(response, cut, speeds, "all-harmonics").depth[0]
    theta = np.linspace(0.0, np.pi, 6000)[None]
    below = np.arange(0.1, 0.97, 0.01)[None]
    for speed, depth in zip(speeds, found, strict=True):
        loop = floquet._form_loop(response, cut, np.array([speed]))
        curve = floquet._characteristic(loop, theta, np.array([depth]))
        assert floquet._follow(curve, below).first == below.size
