"""Frequency response against a dense solution, the static compliance and one mass on a spring."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import eigh

from stiffscope.errors import InputError
from stiffscope.vjm.kinematics.configurations import configure
from stiffscope.vjm.model.bodies import Body, member
from stiffscope.vjm.model.dynamics import Dynamics
from stiffscope.vjm.model.joints import Drive, Joint
from stiffscope.vjm.model.mechanism import Mechanism, Tool
from stiffscope.vjm.statics.analysis import stiffness
from stiffscope.vjm.vibration.coordinates import PointMass
from stiffscope.vjm.vibration.frequency_response import (
    Port,
    expand_ports,
    frequency_response,
    keep_modes_below,
    superpose_modes,
)
from tests.robots import GEOMETRY, pose_at
from tests.vjm import dense_modes
from tests.vjm.files import biglide, serial_arm
from tests.vjm.test_modes import framed, rigid_hexapod

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


K1 = 5e6  # N/m, of the drive
K2 = 2e6  # N/m, between the bodies
M1 = 3.0  # kg
M2 = 7.0


def two_bodies():
    slide = Joint(
        "slide", "ground", "near", "prismatic", [0, 0, 0], [1, 0, 0], drive=Drive(K1)
    )
    spring = Joint(
        "spring", "near", "far", "prismatic", [0.2, 0, 0], [1, 0, 0], spring=K2
    )
    bodies = Body("near", M1, [0, 0, 0]), Body("far", M2, [0.3, 0, 0])
    return Mechanism(bodies, (slide, spring), Tool("near", [0.0, 0, 0], ("x",)))


ENDS = [Port(node, np.zeros(3), np.eye(6)[0]) for node in ("near", "far")]
PAIRS = [(0, 0), (0, 1), (1, 0), (1, 1)]


@pytest.mark.parametrize("drives", ["held", "free"])
@pytest.mark.parametrize("sensor", [0.0, 0.4])
def test_two_bodies_and_a_spring_by_hand(drives, sensor):
    m = two_bodies()
    masses = [PointMass("far", np.array([0.3, 0.1, 0.0]), sensor)]
    modal = expand_ports(
        m, configure(m, [[0.0]]), ENDS, drives=drives, masses=masses[: sensor > 0]
    )
    stiffness = np.array([[(drives == "held") * K1 + K2, -K2], [-K2, K2]])
    mass = np.diag([M1, M2 + sensor])
    w = 2 * np.pi * HERTZ
    expected = np.linalg.inv(stiffness - w[:, None, None] ** 2 * mass)
    found = superpose_modes(modal, PAIRS, HERTZ, damping=0.0)
    assert found.reshape(2, 2, -1) == pytest.approx(
        expected.transpose(1, 2, 0), rel=1e-10
    )


def test_each_mode_has_its_damping():
    m = two_bodies()
    ratios = np.array([0.01, 0.06])
    squares, shapes = eigh([[K1 + K2, -K2], [-K2, K2]], np.diag([M1, M2]))
    w = 2 * np.pi * HERTZ
    below = (
        squares[:, None] - w**2 + 2j * ratios[:, None] * w * np.sqrt(squares)[:, None]
    )
    expected = np.einsum("ic,jc,cf->ijf", shapes, shapes, 1.0 / below)
    modal = expand_ports(m, configure(m, [[0.0]]), ENDS)
    found = superpose_modes(modal, PAIRS, HERTZ, damping=ratios)
    assert found.reshape(2, 2, -1) == pytest.approx(expected, rel=1e-10)


LENGTH = 0.7  # m
BENDING = 450.0  # EI, N·m²
LINEAR = 1.2  # kg/m


def slender_beam(pieces=80, modes=30):
    """An Euler-Bernoulli beam, free in the plane x z: many elements condensed on its ends and clamped modes."""
    size = LENGTH / pieces
    area = LINEAR / 7850.0
    element = dense_modes.frame_mass(size, area, 0.0)
    bend = np.array([[12, 6, -12, 6], [6, 4, -6, 2], [-12, -6, 12, -6], [6, 2, -6, 4]])
    unit = np.array([1.0, size, 1.0, size])
    bend = bend * np.outer(unit, unit) * BENDING / size**3
    bending = np.ix_([1, 5, 7, 11], [1, 5, 7, 11])  # y and its slope
    count = 2 * (pieces + 1)
    k = np.zeros((count, count))
    m = np.zeros((count, count))
    for i in range(pieces):
        at = slice(2 * i, 2 * i + 4)
        k[at, at] += bend
        m[at, at] += element[bending]
    ends = np.r_[0:2, count - 2 : count]
    inner = np.arange(2, count - 2)
    squares, shapes = eigh(
        k[np.ix_(inner, inner)],
        m[np.ix_(inner, inner)],
        subset_by_index=[0, modes - 1],
    )
    basis = np.zeros((count, 4 + modes))
    basis[ends, :4] = np.eye(4)
    basis[inner, :4] = -np.linalg.solve(k[np.ix_(inner, inner)], k[np.ix_(inner, ends)])
    basis[inner, 4:] = shapes
    condensed = basis.T @ m @ basis
    # the plane of the beam is that of y and the rotation about z of its part axes
    place = np.r_[1, 5, 7, 11, 12 : 12 + modes]
    whole = np.zeros((12 + modes, 12 + modes))
    whole[:12, :12] = dense_modes.frame_mass(LENGTH, area, 1e-9)
    whole[np.ix_(place, place)] = condensed
    matrix = np.diag([1e-9, 0.0, 1e-9, 1e-5, 1e-5, 0.0])
    bent = np.ix_([1, 5], [1, 5])
    matrix[bent] = (
        np.array([[LENGTH**3 / 3, LENGTH**2 / 2], [LENGTH**2 / 2, LENGTH]]) / BENDING
    )
    beam = member(
        "beam", [0, 0, 0], [LENGTH, 0, 0], matrix, y=[0, 0, 1], mass=LINEAR * LENGTH
    )
    dynamics = Dynamics(whole, squares)
    return replace(beam, elastic=replace(beam.elastic, dynamics=dynamics))


def test_free_beam_with_a_tip_mass_as_in_closed_form():
    table = Joint("table", "ground", "carrier", "prismatic", [0, 0, 0], [1, 0, 0])
    table = replace(table, drive=Drive(1e6))
    plane = Joint("plane", "carrier", "beam.base", "planar", [0, 0, 0], [0, 1, 0])
    m = Mechanism(
        (Body("carrier", 1.0, [0, 0, 0]), slender_beam()),
        (table, plane),
        Tool("carrier", [0.0, 0, 0], ("x",)),
    )
    tip = 0.35  # kg
    ends = [
        Port("beam.base", np.zeros(3), np.eye(6)[2]),
        Port("beam.tip", np.array([LENGTH, 0, 0]), np.eye(6)[2]),
    ]
    masses = [PointMass("beam.tip", np.array([LENGTH, 0, 0]), tip)]
    modal = expand_ports(m, configure(m, [[0.0]]), ends, masses=masses)
    hertz = np.array([12.0, 55.0, 160.0, 250.0])
    found = superpose_modes(modal, [(0, 0), (0, 1)], hertz, damping=0.0)
    for k, f in enumerate(hertz):
        w = 2 * np.pi * f
        b = (LINEAR * w**2 / BENDING) ** 0.25
        c, s, ch, sh = (g(b * LENGTH) for g in (np.cos, np.sin, np.cosh, np.sinh))
        inertia = tip * w**2 / (BENDING * b**3)
        # deflection A cos + B sin + C cosh + D sinh: moments are zero at both ends, the shear is the
        # unit force at x = 0 and moves the mass at x = L
        rows = [
            [-1, 0, 1, 0],
            [0, -1, 0, 1],
            [-c, -s, ch, sh],
            [
                s + inertia * c,
                -c + inertia * s,
                sh + inertia * ch,
                ch + inertia * sh,
            ],
        ]
        shape = np.linalg.solve(rows, [0, 1 / (BENDING * b**3), 0, 0])
        expected = shape @ [1, 0, 1, 0], shape @ [c, s, ch, sh]
        assert found[:, k] == pytest.approx(np.array(expected), rel=1e-6)


def test_many_pairs_of_a_hexapod_with_a_sensor_are_those_of_a_dense_solution(rng):
    m = rigid_hexapod(rng)
    pose = m.tool.home
    sensor = 0.06  # kg
    at = np.array([0.05, -0.08, 0.28])
    places = [("platform", at), ("platform", m.tool.at), ("leg1.upper", np.zeros(3))]
    ends = [(node, where, rng.normal(size=6)) for node, where in places]
    modal = expand_ports(
        m,
        configure(m, [pose]),
        [Port(*end) for end in ends],
        masses=[PointMass("platform", at, sensor)],
    )
    hertz = [30.0, 200.0, 411.0]
    pairs = [(i, j) for i in range(3) for j in range(3)]
    found = superpose_modes(modal, pairs, hertz, damping=0.0)
    body = next(b for b in m.bodies if b.name == "platform")
    total = body.mass + sensor
    centre = (body.mass * body.centre + sensor * at) / total
    heavier = replace(body, mass=total, centre=centre, inertia=about(body, at, sensor))
    bodies = tuple(heavier if b is body else b for b in m.bodies)
    with_sensor = replace(m, bodies=bodies)
    for (i, j), response in zip(pairs, found, strict=True):
        expected = dense_modes.receptance(with_sensor, pose, ends[i], ends[j], hertz)
        assert response.real == pytest.approx(expected, rel=1e-6)
    assert found.reshape(3, 3, -1) == pytest.approx(
        found.reshape(3, 3, -1).transpose(1, 0, 2), rel=1e-12
    )


def about(body, at, mass):
    """Inertia of a body with a point mass about their common centre (parallel axes)."""
    way = at - body.centre
    reduced = body.mass * mass / (body.mass + mass)
    return body.inertia + reduced * ((way @ way) * np.eye(3) - np.outer(way, way))


def test_modes_above_the_band_follow_statically(rng):
    m = framed(biglide(), rng, 2)
    found = configure(m, pose_at(GEOMETRY, 0.7, 0.05))
    ends = [Port(None, m.tool.at, e) for e in np.eye(6)]
    modal = expand_ports(m, found, ends)
    pairs = [(i, i) for i in range(6)]
    limit = 10 * modal.frequencies[0]
    short = keep_modes_below(modal, limit)
    slow = [1e-3]
    assert superpose_modes(short, pairs, slow) == pytest.approx(
        superpose_modes(modal, pairs, slow), rel=1e-9
    )
    band = np.linspace(0.1, 0.2, 5) * limit
    error = superpose_modes(short, pairs, band) - superpose_modes(modal, pairs, band)
    part = modal.displacement**2
    above = modal.frequencies > limit
    rest = (part[:, above] / modal.stiffness[above]).sum(axis=1)
    assert (np.abs(error) <= 1.1 * (band / limit) ** 2 * rest[:, None]).all()


@pytest.mark.parametrize("wrong", [1.0, [0.01, -0.1], []])
def test_damping_out_of_range_is_refused(wrong):
    m = two_bodies()
    modal = expand_ports(m, configure(m, [[0.0]]), ENDS)
    with pytest.raises(InputError, match="damping: expected a ratio"):
        superpose_modes(modal, PAIRS, HERTZ, damping=wrong)
    with pytest.raises(InputError, match="expected a body or an end of one"):
        expand_ports(
            m,
            configure(m, [[0.0]]),
            ENDS,
            masses=[PointMass("lost", np.zeros(3), 1.0)],
        )


@pytest.mark.parametrize("derivative", [0, 1, 2])
def test_an_exponential_window_damps_as_in_the_time_domain(derivative):
    stiffness = 4e5
    mass = 2.5
    ratio = 0.02
    slide = Joint("slide", "ground", "car", "prismatic", [0, 0, 0], [1, 0, 0])
    m = Mechanism(
        (Body("car", mass, [0.3, 0, 0]),),
        (replace(slide, drive=Drive(stiffness)),),
        Tool("car", [0.0, 0, 0], ("x",)),
    )
    decay = 1.0 / 0.05
    modal = expand_ports(
        m, configure(m, [[0.0]]), [Port("car", np.zeros(3), np.eye(6)[0])]
    )
    hertz = np.array([20.0, 64.0, 90.0])
    found = superpose_modes(modal, [(0, 0)], hertz, ratio, decay=decay)[0]
    natural = np.sqrt(stiffness / mass)
    pole = natural * (-ratio + 1j * np.sqrt(1.0 - ratio**2))
    time = np.linspace(0.0, 1.0, 400_001)
    # impulse response, its derivatives, and the impulse that an acceleration begins with
    impulse = (pole**derivative * np.exp(pole * time) / pole.imag / mass).imag
    start = 1.0 / mass if derivative == 2 else 0.0
    for f, value in zip(hertz, found, strict=True):
        line = 2j * np.pi * f
        seen = np.trapezoid(impulse * np.exp(-(decay + line) * time), time) + start
        assert value * (line + decay) ** derivative == pytest.approx(seen, rel=1e-5)
