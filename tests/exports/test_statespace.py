"""State-space models against frequency responses, by the readers that will use them."""

import numpy as np
import pytest
import scipy.io
import scipy.signal

import stiffscope as ss
from stiffscope.exports.statespace import form_state_space, list_points
from stiffscope.exports.targets.statespace import TARGET
from stiffscope.vjm.kinematics.configurations import configure
from stiffscope.vjm.vibration.frequency_response import Port, frequency_response

pytestmark = pytest.mark.slow

HERTZ = np.geomspace(5.0, 1500.0, 60)


def of_file(name, components):
    robot = ss.load_robot(name)
    mechanism = ss.assemble(robot, components)
    pose = next(iter(robot.poses.values()))
    return mechanism, configure(mechanism, [list(pose)])


def port(mechanism, number):
    node, at = list(list_points(mechanism).values())[number // 6]
    return Port(node, at, np.eye(6)[number % 6])


def respond(model, source, target):
    """Return C (jw - A)^-1 B + D of one input and output."""
    size = np.eye(len(model.a))
    column = model.b[:, source]
    states = [np.linalg.solve(2j * np.pi * f * size - model.a, column) for f in HERTZ]
    return np.array(states) @ model.c[target] + model.d[target, source]


@pytest.mark.parametrize(
    ("name", "components"), [("biglide", "published"), ("delta", "beam")]
)
def test_the_matrices_have_the_frequency_response_of_frf(name, components):
    mechanism, found = of_file(name, components)
    model = form_state_space(mechanism, found)
    for source, target in ((2, 2), (8, 2), (1, 7)):
        ports = port(mechanism, source), port(mechanism, target)
        want = frequency_response(mechanism, found, *ports, HERTZ)
        got = respond(model, source, target)
        assert np.abs(got - want).max() < 1e-9 * np.abs(want).max()


def test_scipy_integrates_a_step_to_the_closed_form():
    mechanism, found = of_file("biglide", "published")
    model = form_state_space(mechanism, found, highest=300.0)
    system = scipy.signal.StateSpace(
        model.a, model.b[:, [2]], model.c[[2]], model.d[[2]][:, [2]]
    )
    time = np.linspace(0.0, 0.1, 400)
    got = scipy.signal.lsim(system, np.ones(400), time)[1]
    omega = 2.0 * np.pi * model.frequencies
    count = len(omega)
    gain = model.c[2, :count] * model.b[count:, 2] / omega
    damped = omega * np.sqrt(1.0 - model.damping**2)
    phase = damped * time[:, None]
    lag = model.damping * omega / damped
    decay = np.exp(-model.damping * omega * time[:, None])
    part = 1.0 - decay * (np.cos(phase) + lag * np.sin(phase))
    want = part @ gain + model.d[2, 2]
    assert np.abs(got - want).max() < 1e-9 * np.abs(want).max()


def test_python_control_finds_the_same_response():
    control = pytest.importorskip("control")
    mechanism, found = of_file("biglide", "published")
    model = form_state_space(mechanism, found)
    system = control.ss(model.a, model.b, model.c, model.d)
    got = system(2j * np.pi * HERTZ)[2, 2]
    want = respond(model, 2, 2)
    assert np.abs(got - want).max() < 1e-9 * np.abs(want).max()


def test_what_vibrates_above_the_highest_frequency_follows_statically():
    mechanism, found = of_file("biglide", "published")
    whole = form_state_space(mechanism, found)
    few = form_state_space(mechanism, found, highest=300.0)
    assert few.frequencies.max() <= 300.0
    static = [m.d - m.c @ np.linalg.solve(m.a, m.b) for m in (whole, few)]
    assert np.allclose(*static, rtol=0.0, atol=1e-12 * np.abs(static[0]).max())


def test_names_say_which_force_moves_what():
    mechanism, found = of_file("biglide", "published")
    model = form_state_space(mechanism, found)
    assert model.inputs[:6] == tuple(
        f"tool.{f}" for f in ("fx", "fy", "fz", "mx", "my", "mz")
    )
    assert model.outputs[2] == "tool.z"
    assert model.b.shape == (len(model.a), len(model.inputs))


def test_files_hold_the_same_matrices(tmp_path):
    from stiffscope.cli.main import main

    out = tmp_path / "out"
    call = ["export", "biglide", "--to", TARGET.name, "--out", str(out), "--quiet"]
    with pytest.raises(SystemExit) as end:
        main([*call, "--components", "published", "--at", "Q1"])
    assert not end.value.code
    matlab = scipy.io.loadmat(out / "Q1.mat")
    numpy = np.load(out / "Q1.npz")
    for key in "ABCD":
        assert np.array_equal(matlab[key], numpy[key])
    assert np.array_equal(numpy["damping"], np.full(len(numpy["A"]) // 2, 0.01))
