"""Responses of robots with withheld causes: lines and derivatives beside differences, noise, and the cause found.

Responses come from the dense model of ``tests.vjm.dense_modes``, which shares only the description of the robot.
"""

from dataclasses import replace

import numpy as np
import pytest

from stiffscope.gap.campaign.campaign import Campaign
from stiffscope.gap.campaign.measured_responses import MeasuredResponses
from stiffscope.gap.campaign.response_header import MeasuredPoint, ResponseSetup
from stiffscope.gap.campaign.response_lines import read_lines
from stiffscope.gap.campaigns import rough_mechanism
from stiffscope.gap.diagnose import diagnose_campaign
from stiffscope.gap.effects.effect import Payload
from stiffscope.gap.effects.elements import add_payloads, change_elements
from stiffscope.gap.effects.masses import Mass, find_masses
from stiffscope.gap.forward.response_state import (
    MassRate,
    NuisanceSettings,
    ResponseState,
)
from stiffscope.responses.model import Direction, Response
from stiffscope.responses.scatter import find_scatter
from stiffscope.robot.nominal import NominalRobot
from stiffscope.robot.reader import load_robot
from stiffscope.vjm.kinematics.configurations import configure
from stiffscope.vjm.model.checks import BASE
from stiffscope.vjm.model.joints import Drive
from stiffscope.vjm.model.mechanism import Change
from stiffscope.vjm.vibration.coordinates import PointMass
from tests.vjm import dense_modes

NOISE = 0.02
AVERAGES = 5
POINTS = {
    "1": np.array([0.1, 0.05, 0.30]),
    "2": np.array([-0.08, 0.09, 0.31]),
    "3": np.array([-0.02, -0.12, 0.30]),
    "4": np.array([0.03, 0.02, 0.25]),
}
HITS = [Direction("1", 2), Direction("2", 0, -1)]
HERTZ = np.linspace(150.0, 700.0, 551)
POSES = ("home", "tilted")
RATIO = 0.01  # of damping


def superpose(mechanism, pose, hertz, sensors=(), spring=None):
    """Receptances (hits, points, 3, f) of the dense model, with point masses and a spring on the platform."""
    k, m, basis, place, bodies = dense_modes.matrices(mechanism, pose)
    r, p = bodies.of("platform")
    size = len(k)

    def move(at):
        rows = np.zeros((6, size))
        rows[:, place["platform"]] = dense_modes.at_origin(np.eye(3), r @ at + p)
        return rows @ basis

    k = basis.T @ k @ basis
    m = basis.T @ m @ basis
    for at, mass in sensors:
        m += mass * move(at)[:3].T @ move(at)[:3]
    if spring is not None:
        k += move(spring[0]).T @ spring[1] @ move(spring[0])
    root = np.linalg.inv(np.linalg.cholesky(k))
    values, vectors = np.linalg.eigh(root @ m @ root.T)
    shapes = root.T @ vectors
    values = values.clip(min=0.0)
    w = 2.0 * np.pi * hertz
    resistance = 2.0j * RATIO * np.sqrt(values)[:, None] * w
    g = 1.0 / (1.0 - values[:, None] * w**2 + resistance)
    forces = [hit.sign * move(POINTS[hit.point])[hit.axis] @ shapes for hit in HITS]
    moved = [move(at)[:3] @ shapes for at in POINTS.values()]
    return np.einsum("hc,pac,cf->hpaf", np.array(forces), np.array(moved), g)


def measure(nominal, robot, pose, values, rng=None, noise=NOISE):
    """A set-up with the responses of all hits at all points."""
    responses = []
    for hit, by_point in zip(HITS, values, strict=True):
        for point, by_axis in zip(POINTS, by_point, strict=True):
            for axis, clean in enumerate(by_axis):
                shown = clean
                coherence = None
                if rng is not None:
                    size = noise * np.abs(clean) / np.sqrt(2.0)
                    errors = rng.standard_normal((2, len(clean)))
                    shown = clean + size * (errors[0] + 1j * errors[1])
                    coherence = np.full(len(clean), 1.0 / (1.0 + AVERAGES * noise**2))
                response = Response(
                    force=hit,
                    motion=Direction(point, axis),
                    frequency=HERTZ,
                    receptance=shown,
                    coherence=coherence,
                    quantity="receptance",
                    source="test",
                )
                responses.append(response)
    setup = ResponseSetup(
        name=f"tap at {pose}",
        file="tap.uff",
        pose=pose,
        joints={},
        drives="held",
        points=tuple(
            MeasuredPoint(name, "platform", tuple(at.tolist()), 0.0)
            for name, at in POINTS.items()
        ),
        averages=AVERAGES,
        band=None,
        exponential=None,
        axes=(0.0, 0.0, 0.0),
        quantity="receptance",
        factor=1.0,
        channels={},
    )
    found = configure(nominal, [robot.poses[pose]])
    return MeasuredResponses(setup, tuple(responses), POINTS, np.eye(3), found, ())


@pytest.fixture(scope="module")
def stewart():
    robot = load_robot("stewart")
    return robot, rough_mechanism(robot)


def state_of(stewart, hertz, **more):
    """A noise-free state of the hexapod at its tilted pose, hardly damped, at a few lines."""
    robot, nominal = stewart
    values = np.ones((len(HITS), len(POINTS), 3, len(HERTZ)), dtype=complex)
    (block,) = read_lines(measure(nominal, robot, "tilted", values))
    count = len(block.measured.responses)
    few = replace(
        block,
        frequency=hertz,
        value=np.ones((count, len(hertz)), dtype=complex),
        sigma=np.full((count, len(hertz)), 1e9),  # nothing to fit damping to
        noise=np.full((count, len(hertz)), 1e9),
        damping=1e-5,
    )
    exact = NuisanceSettings(static=1e3)  # inertial loads of all modes
    mechanism = more.pop("mechanism", nominal)
    return ResponseState(few, mechanism, settings=exact, **more)


def compare(derived, ahead, behind, step):
    """A derivative beside a central difference of lines."""
    expected = (ahead.lines - behind.lines) / (2.0 * step)
    scale = np.abs(expected).max(axis=0)
    assert np.abs(derived - expected).max() < 1e-3 * scale.max()


LINES = np.array([40.0, 200.0, 310.0, 340.0])


def test_lines_are_those_of_the_dense_model(stewart):
    robot, nominal = stewart
    values = superpose(nominal, robot.poses["tilted"], HERTZ)
    (block,) = read_lines(measure(nominal, robot, "tilted", values))
    state = ResponseState(replace(block, damping=RATIO), nominal)
    assert state.lines == pytest.approx(block.value, rel=1e-5, abs=1e-12)


def test_derivatives_are_differences(stewart):
    _, nominal = stewart
    state = state_of(stewart, LINES)
    at = POINTS["2"]
    for name, component in (("strut2.drive", 0), ("strut1.head", 1), (BASE, 2)):
        change = np.zeros((6, 6))
        change[component, component] = 1.0
        own = state.soften({name: change[None]}, 1)[..., 0]
        step = 1e-14  # m/N, small beside the distance to the next resonance
        sides = [
            state_of(
                stewart,
                LINES,
                mechanism=change_elements(
                    nominal, {name: Change(sign * step * change)}
                ),
            )
            for sign in (2.0, 0.0)
        ]
        compare(own, *sides, step)
    payload = Payload("platform", at, 1.0, np.zeros(3))
    own = state.load([MassRate("platform", at, 1.0, np.zeros(3))], 1)[..., 0]
    sides = [
        state_of(
            stewart,
            LINES,
            mechanism=add_payloads(nominal, [replace(payload, mass=mass)]),
        )
        for mass in (1e-4, -1e-4)
    ]
    compare(own, *sides, 1e-4)
    sides = [
        state_of(stewart, LINES, masses=(PointMass("platform", at, mass),))
        for mass in (2e-4, 0.0)
    ]
    compare(own, *sides, 1e-4)


def test_derivatives_by_the_place_of_a_mass_carry_its_second_moments(stewart):
    _, nominal = stewart

    def carry(moment):
        """A mass of 2 kg whose first moment along x is changed."""
        moments = np.array([0.3 + moment, -0.2, 0.1])
        return Payload("platform", POINTS["2"], 2.0, moments)

    def shake(payload):
        return state_of(stewart, LINES, mechanism=add_payloads(nominal, [payload]))

    step = 1e-4
    rate = MassRate.between(carry(step), carry(-step), 2.0 * step)
    own = shake(carry(0.0)).load([rate], 1)[..., 0]
    compare(own, shake(carry(step)), shake(carry(-step)), step)


def test_a_denser_body_has_more_moments_of_inertia(stewart):
    robot, nominal = stewart
    (heavy,) = find_masses(NominalRobot(nominal, robot))["platform"]
    mass = Mass((heavy,))

    def shake(growth):
        payloads = mass.influence(np.array([growth])).payloads
        return state_of(stewart, LINES, mechanism=add_payloads(nominal, payloads))

    step = 1e-4
    ahead, behind = (mass.influence(np.array([s * step])).payloads for s in (1, -1))
    rate = MassRate.between(ahead[0], behind[0], 2.0 * step)
    own = shake(0.0).load([rate], 1)[..., 0]
    compare(own, shake(step), shake(-step), step)
    bodies = {body.name: body for body in nominal.bodies}
    changed = add_payloads(nominal, mass.influence(np.array([0.3])).payloads)
    denser = {body.name: body for body in changed.bodies}["platform"]
    assert denser.inertia == pytest.approx(1.3 * bodies["platform"].inertia)


def test_a_gain_changes_its_channel_alone(stewart):
    """Also where it is not one: derivatives are differences by relative changes."""
    channels = len(HITS) * len(POINTS) * 3
    gains = np.ones(channels)
    gains[4] = -0.8
    plain = state_of(stewart, LINES)
    state = state_of(stewart, LINES, gains=gains)
    assert state.lines == pytest.approx(gains[:, None] * plain.lines)
    assert state.predict_lines(LINES) == pytest.approx(state.lines)
    change = np.zeros((channels, 1))
    change[4] = 1e-6
    more = state_of(stewart, LINES, gains=gains * (1.0 + change[:, 0]))
    moved = more.lines - state.lines
    shown = state.block.read(moved) * state.block.weight
    expected = state._spread * state.share(shown)
    assert state.amplify(change)[:, 0] == pytest.approx(expected, rel=1e-6, abs=1e-15)


@pytest.mark.parametrize("coherent", [True, False])
def test_neighbouring_lines_tell_their_noise(stewart, rng, coherent):
    robot, nominal = stewart
    values = superpose(nominal, robot.poses["home"], HERTZ)
    measured = measure(nominal, robot, "home", values, rng)
    response = measured.responses[2]
    if not coherent:
        response = replace(response, coherence=None)
    wrong = 3  # stated averages
    told = find_scatter(response, wrong) / np.abs(response.receptance)
    assert np.median(told) == pytest.approx(NOISE / np.sqrt(2.0), rel=0.15)


def test_a_gain_of_a_channel_is_no_error_and_a_shifted_resonance_is(stewart, rng):
    robot, nominal = stewart
    values = superpose(nominal, robot.poses["home"], HERTZ)
    turned = values * (1.0 + 0.02 * rng.standard_normal((2, 4, 3, 1)))
    softer = superpose(soften(nominal, 0.97), robot.poses["home"], HERTZ)
    misfits = []
    for shown in (values, turned, softer):
        (block,) = read_lines(measure(nominal, robot, "home", shown, rng))
        state = ResponseState(block, nominal)
        read = np.concatenate([block.value.ravel().real, block.value.ravel().imag])
        left = (read - state.values) / np.tile(block.sigma.ravel(), 2)
        misfits.append(float(np.mean(left**2)))
    assert misfits[0] < 1.15
    assert misfits[1] < 1.15
    assert misfits[2] > 10.0


def soften(mechanism, factor, drive="strut1.drive"):
    """The mechanism with another stiffness of a drive."""
    joints = tuple(
        replace(j, drive=Drive(factor * j.drive.stiffness)) if j.name == drive else j
        for j in mechanism.joints
    )
    return replace(mechanism, joints=joints)


def diagnose_struck(stewart, rng, mechanism, **more):
    robot, nominal = stewart
    responses = [
        measure(
            nominal,
            robot,
            pose,
            superpose(mechanism, robot.poses[pose], HERTZ, **more),
            rng,
        )
        for pose in POSES
    ]
    return diagnose_campaign(
        Campaign.without_readings(robot.name, coordinates=tuple(robot.tool.pose)),
        NominalRobot(nominal, robot),
        None,
        responses,
    )


@pytest.mark.extended
def test_a_soft_drive_is_named(stewart, rng):
    found = diagnose_struck(stewart, rng, soften(stewart[1], 0.6))
    assert found.verdict in {"identified", "ambiguous"}
    (effect,) = found.effects
    names = {f"{effect.effect} @ {effect.place}", *effect.confused_with}
    assert "actuator-stiffness @ strut1.drive" in names
    if effect.effect == "actuator-stiffness":
        factor = effect.parameters["factor"]
        assert abs(factor.value - 0.6) < 4.0 * factor.sigma


@pytest.mark.extended
@pytest.mark.parametrize("factor", [0.8, -1.0])
def test_a_wrong_gain_or_sign_of_a_channel_is_named(stewart, rng, factor):
    robot, nominal = stewart
    responses = []
    for pose in POSES:
        values = superpose(nominal, robot.poses[pose], HERTZ)
        values[:, 2, 1] *= factor
        responses.append(measure(nominal, robot, pose, values, rng))
    found = diagnose_campaign(
        Campaign.without_readings(robot.name, coordinates=tuple(robot.tool.pose)),
        NominalRobot(nominal, robot),
        None,
        responses,
    )
    assert found.verdict == "identified"
    (effect,) = found.effects
    assert (effect.effect, effect.place) == ("response-gain", "3.y")
    assert effect.parameters["factor"].value == pytest.approx(factor, rel=0.03)


@pytest.mark.extended
def test_an_accelerometer_is_no_softer_robot(stewart, rng):
    found = diagnose_struck(stewart, rng, stewart[1], sensors=[(POINTS["3"], 0.06)])
    (effect,) = found.effects
    assert (effect.effect, effect.place) == ("sensor-mass", "3")
    assert effect.parameters["mass"].value == pytest.approx(0.06, rel=0.03)


@pytest.mark.long
def test_a_hose_gets_no_false_name(stewart, rng):
    hose = np.array([0.1, 0.1, 0.35]), np.diag([3e6, 1e6, 5e6, 0.0, 0.0, 0.0])
    found = diagnose_struck(stewart, rng, stewart[1], spring=hose)
    assert found.verdict == "unexplained"
    assert any("nothing is certain" in remark for remark in found.remarks)
    assert not found.effects
