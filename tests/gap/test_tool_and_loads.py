"""Wrong tool points, friction, lost preload, force sensors, weights and columns, against an arm of its own."""

from dataclasses import replace

import numpy as np
import pytest

from stiffscope.errors import InputError
from stiffscope.gap.campaign.readings import load_campaign
from stiffscope.gap.campaigns import diagnose
from stiffscope.gap.effects.vocabulary import apply_effect, find_candidates
from stiffscope.gap.forward.load_chains import LoadChains
from stiffscope.gap.forward.robot_model import RobotModel
from stiffscope.robot.mechanism_of import mechanism_of
from stiffscope.robot.nominal import NominalRobot
from stiffscope.robot.part_matrices import part_matrices
from stiffscope.robot.reader import load_robot
from tests.benchmarks import traps

QUIET = 1e-12  # m


def open_model(folder, table):
    traps.write(folder / "case", table, stated=True)
    robot = load_robot(str(folder / "case" / "robot.toml"))
    mechanism = mechanism_of(robot, part_matrices(robot, "beam"))
    return RobotModel(load_campaign(folder / "case"), NominalRobot(mechanism, robot))


def predict(model, name, parameters):
    known = [
        c
        for c in find_candidates(model.setting)
        if c.name == name and set(parameters) <= set(c.names)
    ]
    candidate = min(known, key=lambda c: len(c.names))
    given = np.array([parameters.get(each, 0.0) for each in candidate.names])
    return model.predict(((candidate, tuple(candidate.internal(given))),)).values


EXACT = {
    "friction @ J2": (
        traps.measure_ladders,
        traps.with_drive(1, friction=8.0),
        {"force": 8.0},
    ),
    "preload-loss @ J2": (
        traps.measure_ladders,
        traps.with_drive(1, knee=30.0, beyond=0.5),
        {"load": 30.0, "factor": 0.5},
    ),
    "backlash @ J2": (  # to a side of which the arm's weight holds it
        traps.measure_loads,
        traps.with_drive(1, gap=1.5e-4),
        {"half_width": 1.5e-4, "preload": 0.0},
    ),
    "tool-offset @ tool": (
        traps.measure_loads,
        traps.OFFSET,
        {"x": 0.03, "z": -0.015},
    ),
}


@pytest.mark.parametrize("name", EXACT)
def test_readings_are_those_of_an_arm_at_its_exact_equilibrium(tmp_path, name):
    """To the second order of the deflections, 1e-3, which the linear model lacks."""
    measure, arm, parameters = EXACT[name]
    table = measure(np.random.default_rng(2), arm, noise=QUIET)
    model = open_model(tmp_path, table)
    seen = model.campaign.value
    without = model.predict().values
    values = predict(model, name, parameters)
    gap = np.abs(seen - without).max()
    assert gap > 1e-5
    assert np.abs(values - seen).max() < 3e-3 * np.abs(seen).max()
    assert np.abs(values - seen).max() < 0.1 * gap


def test_an_unloaded_tool_is_where_its_offset_has_it(tmp_path):
    arm = replace(traps.OFFSET, weight=0.0)
    table = traps.measure_rest(np.random.default_rng(2), arm, noise=QUIET)
    model = open_model(tmp_path, replace(table, modelled="[]"))
    values = predict(model, "tool-offset @ tool", {"x": 0.03, "z": -0.015})
    assert np.abs(values - model.campaign.value).max() < 1e-9


@pytest.mark.extended
@pytest.mark.slow
def test_a_dead_zone_held_to_a_side_by_weight_is_named(tmp_path):
    arm = traps.with_drive(1, gap=1.5e-4)
    table = traps.measure_loads(np.random.default_rng(2), arm)
    traps.write(tmp_path / "case", table, stated=True)
    found = diagnose(tmp_path / "case")
    (effect,) = found.effects
    assert (found.verdict, effect.effect, effect.place) == (
        "identified",
        "backlash",
        "J2",
    )
    width = effect.parameters["half_width"]
    assert abs(width.value - 1.5e-4) < 4 * width.sigma < 1e-5
    held = effect.parameters["preload"]
    assert held.interval[0] < 0.0 < held.interval[1]


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("tool-offset @ tool", (0.02, -0.01, 0.015)),
        ("friction @ J2", (5.0,)),
        ("preload-loss @ J3", (0.3, 0.8)),
        ("preload-loss @ J3", (0.3, 0.8, 0.4)),
        ("force-cross-talk @ fz", (0.05, -0.03)),
        ("load-value @ 60 N", (0.1,)),
    ],
)
def test_derivatives_are_differences_of_predictions(tmp_path, name, values):
    table = traps.measure_ladders(np.random.default_rng(3), traps.SOFT)
    model = open_model(tmp_path, table)
    (candidate,) = (
        c
        for c in find_candidates(model.setting)
        if c.name == name and len(c.scale) == len(values)
    )
    columns = model.predict(((candidate, values),)).columns(candidate)
    for k, step in enumerate(1e-3 * np.array(candidate.scale)):
        ahead, behind = (
            model.predict(
                (
                    (
                        candidate,
                        tuple(np.array(values) + s * step * np.eye(len(values))[k]),
                    ),
                )
            ).values
            for s in (1, -1)
        )
        slope = (ahead - behind) / (2 * step)
        assert np.abs(columns[:, k] - slope).max() < 1e-2 * np.abs(slope).max()


def test_a_spring_beside_friction_carries_less_when_loaded_and_more_when_unloaded(
    tmp_path,
):
    """A ladder 0 … 100 N and back: the play operator, by hand."""
    table = traps.measure_ladders(
        np.random.default_rng(1), traps.Arm(), poses=1, axes=(0,), noise=QUIET
    )
    model = open_model(tmp_path, table)
    chains = LoadChains(model.campaign)
    force = np.repeat([20.0, 40, 60, 80, 100, 80, 60, 40, 20, 0], 3)
    held = chains.hold(force, 30.0)[::3]
    assert held.tolist() == [20.0, 30, 30, 30, 30, 10, -10, -30, -30, -30]


def test_loads_along_another_line_start_from_rest(tmp_path):
    model = open_model(
        tmp_path, traps.measure_loads(np.random.default_rng(1), traps.Arm(), 2)
    )
    held = LoadChains(model.campaign).hold(np.full(len(model.campaign), 5.0), 8.0)
    assert np.all(held == 5.0)


def test_exchanged_columns_are_suspected_and_put_right(tmp_path):
    for words in (("dx", "dy"), ("fx", "fy")):
        rng = np.random.default_rng(4)
        stated = (lambda f: f[[1, 0, 2]]) if words[0] == "fx" else None
        table = traps.measure_loads(rng, traps.Arm(), stated=stated, noise=QUIET)
        if words[0] == "dx":
            table = traps.swap_words(table, *words)
        folder = tmp_path / words[0]
        folder.mkdir()
        model = open_model(folder, table)
        (pair,) = model.setting.doubts.swaps[:1]
        assert "/".join(pair).replace("x/y", "") in {"", "fx/fy"}
        (swap,) = (
            c for c in model.library if c.name == f"column-swap @ {'/'.join(pair)}"
        )
        nominal = model.predict()
        right = model.predict(((swap, ()),)).values
        assert np.abs(right - nominal.values - nominal.step(swap)).max() < 1e-15
        assert np.abs(right - model.campaign.value).max() < 1e-5


def test_what_a_robot_file_can_contain_is_adopted_and_the_rest_refused_by_name(
    tmp_path,
):
    table = traps.measure_loads(np.random.default_rng(1), traps.Arm(), 2)
    nominal = open_model(tmp_path, table).nominal
    knee = apply_effect(nominal, "preload-loss", "J2", {"load": 30.0, "factor": 0.5})
    law = knee.mechanism.joint("J2").drive.law
    assert law.slopes.tolist() == pytest.approx([60e3, 30e3])
    assert law.forces.tolist() == pytest.approx([0.0, 30.0])
    with pytest.raises(InputError, match="preload-loss @ J2: a drive with a curve"):
        apply_effect(knee, "preload-loss", "J2", {"load": 30.0, "factor": 0.5})
    for effect, place in (
        ("friction", "J2"),
        ("force-cross-talk", "fz"),
        ("load-value", "60 N"),
        ("column-swap", "x/y"),
    ):
        with pytest.raises(InputError, match=f"{effect} @ {place}"):
            apply_effect(nominal, effect, place, {})


def test_rounded_readings_scatter_at_least_by_their_step(tmp_path):
    """A dial gauge of 10 µm and sigma of 3 µm: √(3² + 10²/12) µm; a micrometre does not count."""
    rng = np.random.default_rng(5)
    plain = traps.measure_loads(rng, traps.Arm(), 4)
    coarse = traps.round_off(plain)
    fine = traps.change_values(plain, lambda v: np.round(v / 1e-6) * 1e-6)
    for table, sigma, step in (
        (plain, 3e-6, 0),
        (fine, 3e-6, 0),
        (coarse, 4.16e-6, 1e-5),
    ):
        folder = tmp_path / f"{sigma}{step}{id(table)}"
        folder.mkdir()
        model = open_model(folder, table)
        assert model.steps.max() == pytest.approx(step)
        assert model.noise().sigma.max() == pytest.approx(sigma, rel=2e-3)


def test_small_readings_are_no_multiples_of_a_large_step(tmp_path):
    table = traps.measure_loads(np.random.default_rng(5), traps.Arm(), 4)
    tiny = traps.change_values(table, lambda v: 1e-9 * v)
    assert not open_model(tmp_path, tiny).steps.any()


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ((1e-5, 0.0), "stiffening"),
        ((0.0, 1e-5), "softening"),
        ((-1e-5, 0.0), "softening"),
    ],
)
def test_a_pattern_whose_sign_is_free_is_called_after_what_was_found(
    tmp_path, values, said
):
    table = traps.measure_loads(np.random.default_rng(1), traps.Arm(), 2)
    model = open_model(tmp_path, table)
    pattern = next(c for c in model.library if c.place == "stiffening at J2")
    assert pattern.describe(values) == f"{said} at J2"
