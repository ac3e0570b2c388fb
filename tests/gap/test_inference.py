"""Inference on linear models, where everything can be had a second way."""

from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np
import pytest

from stiffscope.gap.diagnose import conclude
from stiffscope.gap.forward.forward_model import Noise
from stiffscope.gap.forward.noise import noise_of
from stiffscope.gap.inference.averaging import mix_intervals
from stiffscope.gap.inference.diagnosis import to_json
from stiffscope.gap.inference.evidence import (
    Errors,
    constrained_minima,
    eliminate,
    errors_of,
    log_evidences,
    marginalize,
    posterior,
)
from stiffscope.gap.inference.find import find
from stiffscope.gap.inference.fitting import Problem
from stiffscope.gap.inference.hypothesis import forms_of
from stiffscope.gap.inference.lack_of_fit import lack_of_fit
from stiffscope.gap.inference.posterior_samples import draw_samples, write_posterior
from stiffscope.gap.inference.priors import (
    Spreads,
    spread_groups,
    spread_priors,
)
from stiffscope.gap.inference.search import Search
from stiffscope.gap.inference.settings import FIT, PRIORS, VERDICT
from stiffscope.gap.inference.verdict import shares
from tests.gap.synthetic import LinearModel, LinearPrediction, linear_model

pytestmark = pytest.mark.slow

SIZES = np.array(FIT.sizes)


def planted(model, **sizes):
    """The model with readings that carry effects, `e3=(0.2,)`, in internal parameters."""
    value = np.array(model.campaign.value)
    for key, u in sizes.items():
        value = value + model.signatures[f"effect-{key[1:]} @ place"] @ np.array(u)
    return replace(model, campaign=replace(model.campaign, value=value))


def alone(scale):
    """The prior of an effect whose size is known."""
    return Spreads(np.atleast_2d(scale), np.zeros(1))


def covariance_of(model, noise, size):
    """Of the readings in sigmas, written out: within each pose and direction a common part and one with the value."""
    c = model.campaign
    together = (c.pose[:, None] == c.pose) & (c.quantity[:, None] == c.quantity)
    mean = np.sqrt([np.mean(c.value[c.quantity == q] ** 2) for q in c.quantity])
    common = np.outer(mean, mean) + np.outer(c.value, c.value)
    return np.eye(len(c)) + size**2 * np.where(together, common, 0.0) / np.outer(
        noise.sigma, noise.sigma
    )


def test_a_discrepancy_is_the_same_for_readings_that_repeat_one_another():
    """Where it followed their scatter, a scale of 0.63 "explained" half of the noise of readings taken four times."""
    model = linear_model(np.random.default_rng(2), poses=3, loads=2, effects=1)
    c = model.campaign
    n = len(model.campaign)
    rows = np.tile(np.arange(n), 4)
    arrays = {
        name: getattr(c, name)[rows]
        for name in (
            "pose",
            "wrench",
            "quantity",
            "sigma",
            "session",
            "file",
            "sensor",
            "load",
        )
    }
    scattered = c.value[rows] + c.sigma[rows] * np.random.default_rng(
        3
    ).standard_normal(4 * n)
    many = replace(c, **arrays, value=scattered, line=np.arange(4 * n))
    errors = errors_of(
        many,
        Noise(many.sigma, np.ones(4 * n, bool), np.zeros(4 * n, bool), np.ones(1)),
        -4.0,
    )
    assert errors.shape.reshape(4, n, 2) == pytest.approx(
        np.broadcast_to(errors.shape[:n], (4, n, 2))
    )


def test_evidence_with_a_discrepancy_is_that_of_the_joint_gaussian():
    rng = np.random.default_rng(1)
    model = linear_model(rng, poses=3, loads=2, effects=2, parameters=(2,))
    noise = model.noise()
    errors = errors_of(model.campaign, noise, -4.0)
    x = (
        np.hstack([model.signatures[c.name] for c in model.library])
        / noise.sigma[:, None]
    )
    y = (model.campaign.value - model.nominal) / noise.sigma + x @ [0.5, -0.2, 0.3, 0.1]
    scale = np.array([1.0, 2.0, 0.5, 1.0])
    logs = []
    means = []
    for size, prior in zip(errors.sizes, [0.0, *[-4.0 - np.log(5)] * 5], strict=True):
        v = covariance_of(model, noise, size)
        whole = v + x @ np.diag(scale**2) @ x.T
        logs.append(
            prior - 0.5 * (np.linalg.slogdet(whole)[1] + y @ np.linalg.solve(whole, y))
        )
        means.append(np.diag(scale**2) @ x.T @ np.linalg.solve(whole, y))
    found = posterior(
        errors, y, x, [alone(scale[:2]), alone(scale[2:])], np.zeros(4, bool)
    )
    assert found.log_evidence == pytest.approx(np.logaddexp.reduce(logs))
    assert found.plain == pytest.approx(logs[0])
    assert found.mean == pytest.approx(
        np.exp(logs - np.logaddexp.reduce(logs)) @ np.array(means)
    )


def test_readings_far_more_certain_than_others_leave_inner_products_definite():
    """What the discrepancy takes away is nearly all of a reading's weight there: a difference would be rounding."""
    model = linear_model(np.random.default_rng(3), poses=4, loads=2, effects=4)
    sigma = np.where(model.campaign.quantity == 4, 1e-16, 1e-6)
    noise = replace(model.noise(), sigma=sigma)
    errors = errors_of(model.campaign, noise, -4.0)
    x = np.hstack([model.signatures[c.name] for c in model.library]) / sigma[:, None]
    x = np.column_stack([x, x @ np.linspace(1.0, 2.0, x.shape[1])])
    made = errors.project(x)
    for gram in errors.inner(made, made):
        values = np.linalg.eigvalsh(gram)
        assert values[0] > -1e-13 * values[-1]
    priors = [spread_priors(np.ones(1), np.zeros(1, bool), SIZES)] * x.shape[1]
    found = posterior(errors, x[:, 0], x, priors, np.zeros(len(priors), bool))
    assert np.linalg.eigvalsh(found.covariance)[0] > 0.0


def test_parameters_that_are_summed_over_leave_the_gaussian_of_the_readings():
    rng = np.random.default_rng(7)
    x = rng.standard_normal((9, 4))
    y = rng.standard_normal(9)
    scales = np.array([0.3, 2.0, 1.0, 40.0])
    all_of = np.column_stack([x, y])
    gone = np.array([True, True, False, True, False])
    left, log = eliminate((all_of.T @ all_of)[None], gone, scales[gone[:4]])
    whole = (
        np.eye(9) + x[:, gone[:4]] @ np.diag(scales[gone[:4]] ** 2) @ x[:, gone[:4]].T
    )
    assert left[0] == pytest.approx(
        all_of[:, ~gone].T @ np.linalg.solve(whole, all_of[:, ~gone])
    )
    assert log == pytest.approx(-0.5 * np.linalg.slogdet(whole)[1])
    left, log = eliminate(
        np.full((1, 3, 3), 1e20), gone[1:4], np.ones(2)
    )  # two that are one, the prior lost in them
    assert np.isfinite(left).all()
    assert np.isfinite(log).all()
    x = 1e3 * np.linspace(-1.0, 1.0, 90)[:, None] ** np.arange(
        61
    )  # hardly independent, of sizes over many decades
    gone = np.append(rng.permutation(60) < 40, False)
    inner = x.T @ x
    scales = 10.0 ** rng.choice([-3.0, 9.0], 40)
    share = marginalize(inner[None, gone][:, :, gone], scales)[0](
        inner[None, :, gone]
    )  # from the columns gone, too
    left, _ = eliminate(inner[None], gone, scales)
    for found, least in (
        (left[0, :-1, :-1], 0.0),
        (inner - share[0] @ share[0].T, -1e-15 * inner.trace()),
    ):
        assert np.abs(found - found.T).max() < 1e-12 * np.diagonal(found).max()
        assert np.linalg.eigvalsh(found)[0] > least


def test_prior_sizes_are_averaged_effect_by_effect():
    """Against the sum over all pairs of sizes."""
    model = linear_model(
        np.random.default_rng(2), poses=4, loads=3, effects=2, parameters=(1, 2)
    )
    noise = model.noise()
    x = (
        np.hstack([model.signatures[c.name] for c in model.library])
        / noise.sigma[:, None]
    )
    y = (model.campaign.value - model.nominal) / noise.sigma + x @ [0.05, 1.0, 2.0]
    errors = errors_of(model.campaign, noise, -4.0)
    free = np.zeros(3, bool)
    priors = [spread_priors(np.ones(k), free[:k], SIZES) for k in (1, 2)]
    logs = [
        posterior(errors, y, x, [alone(a), alone(b)], free).log_evidence + wa + wb
        for a, wa in zip(priors[0].scales, priors[0].log_weight, strict=True)
        for b, wb in zip(priors[1].scales, priors[1].log_weight, strict=True)
    ]
    assert posterior(errors, y, x, priors, free).log_evidence == pytest.approx(
        np.logaddexp.reduce(logs), abs=0.05
    )


@pytest.mark.parametrize("unit", [1.0, 2.4])
def test_a_size_that_many_errors_have_in_common_is_summed_over_whatever_its_unit(unit):
    """Against the readings' own normal density, summed over two thousand sizes: the unit only shifts the grid."""
    rng = np.random.default_rng(41)
    x = 3.0 * rng.standard_normal((300, 60))
    free = np.zeros(60, bool)
    y = x @ (0.3 * rng.standard_normal(60)) + rng.standard_normal(300)
    noise = Noise(np.ones(300), np.ones(300, bool), np.zeros(300, bool), np.ones(1))
    errors = Errors(
        noise,
        np.zeros(300, int),
        np.zeros((300, 2)),
        np.zeros(0),
        np.ones(1),
        np.zeros(1),
        np.zeros(1),
    )
    values, vectors = np.linalg.eigh(x @ x.T)
    sizes = np.geomspace(1e-3, 1e3, 2001)
    whole = 1.0 + (unit * sizes[:, None]) ** 2 * values.clip(min=0.0)
    logs = -0.5 * (np.log(whole) + (vectors.T @ y) ** 2 / whole).sum(axis=1)
    logs -= np.log(np.cosh(np.log(sizes))) + np.log(
        (1.0 / np.cosh(np.log(sizes))).sum()
    )
    known = posterior(
        errors, y, x, spread_groups(np.full(60, unit), free, (60,), SIZES), free
    )
    assert known.log_evidence == pytest.approx(
        np.logaddexp.reduce(logs), abs=1.0
    )  # -33 on the coarse grid


@pytest.mark.parametrize("count", [1, 2, 3, 6])
def test_priors_have_a_weight_of_one_and_tails_in_proportion(count):
    prior = spread_priors(np.full(count, 2.0), np.ones(count, bool), SIZES)
    assert np.logaddexp.reduce(prior.log_weight) == pytest.approx(0.0)
    whole = prior.scales[: len(SIZES)]
    assert whole == pytest.approx(2.0 * np.repeat(SIZES[:, None], count, axis=1))
    assert prior.log_weight[0] - prior.log_weight[2] == pytest.approx(
        np.log(SIZES[0] / SIZES[2]), abs=0.01
    )
    few = prior.scales[len(SIZES) :] > 1e-3 * prior.scales[len(SIZES) :].max(
        axis=1, keepdims=True
    )
    assert (count == 1) == (not len(few))
    assert not few.all(axis=1).any()
    shares = np.exp(prior.log_weight[len(SIZES) :])
    per_size = [shares[few.sum(axis=1) == c].sum() for c in np.unique(few.sum(axis=1))]
    assert per_size == pytest.approx(
        [PRIORS.sparse / max(len(per_size), 1)] * len(per_size)
    )


def test_what_one_of_three_parameters_explains_costs_hardly_more_than_an_effect_of_one():
    """A bearing that only tilts, of which two other parameters are zero, against a drive of the same signature."""
    model = linear_model(np.random.default_rng(2), poses=6, effects=1, parameters=(3,))
    errors = errors_of(model.campaign, model.noise(), -4.0)
    x = model.signatures["effect-0 @ place"] / 1e-6
    y = (model.campaign.value - model.nominal) / 1e-6 + 3.0 * x[:, 0]
    up = np.ones(3, bool)
    one = posterior(
        errors, y, x[:, :1], [spread_priors(np.ones(1), up[:1], SIZES)], up[:1]
    )
    three = posterior(errors, y, x, [spread_priors(np.ones(3), up, SIZES)], up)
    whole = posterior(errors, y, x, [spread_priors(np.ones(3), ~up, SIZES)], up)
    assert (
        one.log_evidence - three.log_evidence
        < 4.0
        < one.log_evidence - whole.log_evidence
    )
    assert np.abs(three.mean[1:]).max() < 1e-3
    assert (
        three.covariance[1, 1] > 1e-10
    )  # that another parameter is exactly zero is not certain


def test_scores_to_first_order_are_those_of_the_fit_where_the_model_is_linear():
    model = planted(
        linear_model(np.random.default_rng(3)), e2=(0.2, 0.1, -0.1), e4=(0.3, 0.2)
    )
    problem = Problem(model, model.noise())
    first = problem.fit([model.library[2]], np.zeros(3))
    for start in list(Search(problem).score_extensions(first, problem.nominal))[::4]:
        assert problem.fit(start.candidates, start.values).evidence == pytest.approx(
            start.evidence, abs=1.5
        )


def test_minima_are_those_of_all_combinations_of_bounds():
    rng = np.random.default_rng(4)
    root = rng.standard_normal((40, 5, 3))
    a = np.swapaxes(root, 1, 2) @ root
    b = rng.standard_normal((40, 3))
    positive = np.array([True, False, True])
    u, _ = constrained_minima(a, b, positive)
    for matrix, pull, found in zip(a, b, u, strict=True):
        best = np.inf
        for held in ([], [0], [2], [0, 2]):
            free = [k for k in range(3) if k not in held]
            v = np.zeros(3)
            v[free] = np.linalg.solve(matrix[np.ix_(free, free)], pull[free])
            if (v[positive] >= 0).all():
                best = min(best, 0.5 * v @ matrix @ v - pull @ v)
        assert (found[positive] >= 0).all()
        assert 0.5 * found @ matrix @ found - pull @ found == pytest.approx(
            best, rel=0.05, abs=1e-9
        )


@pytest.mark.extended
def test_four_effects_are_found_with_shares_that_add_up():
    model = planted(
        linear_model(np.random.default_rng(5)),
        e0=(0.4,),
        e5=(0.2, 0.1, -0.2),
        e9=(-0.3,),
        e13=(0.2, 0.2),
    )
    found = find(model)
    diagnosis = conclude(found)
    assert diagnosis.verdict == "identified"
    assert {e.effect for e in diagnosis.effects} == {
        "effect-0",
        "effect-5",
        "effect-9",
        "effect-13",
    }
    assert sum(e.share for e in diagnosis.effects) == pytest.approx(1.0)
    assert [e.share for e in diagnosis.effects] == sorted(
        (e.share for e in diagnosis.effects), reverse=True
    )
    names = [c.name for c in found.best.candidates]
    x = {n: model.signatures[n] / 1e-6 for n in names}
    y = (model.campaign.value - model.nominal) / 1e-6

    def explained(chosen):
        columns = np.hstack([np.zeros((len(y), 1)), *(x[n] for n in chosen)])
        left = y - columns @ np.linalg.lstsq(columns, y, rcond=None)[0]
        return y @ y - left @ left

    gains = dict.fromkeys(names, 0.0)
    for order in permutations(names):
        for k, n in enumerate(order):
            gains[n] += explained(order[: k + 1]) - explained(order[:k])
    total = sum(gains.values())
    assert shares(found, found.best) == pytest.approx(
        {n: g / total for n, g in gains.items()}, rel=0.02
    )  # beside priors


@pytest.mark.parametrize("seed", range(4))
def test_an_alternative_leaves_what_least_squares_leave(seed):
    """Beside a large discrepancy a gain of all readings followed details: it left 1.7 times the gap."""
    model = linear_model(np.random.default_rng(seed), effects=4, parameters=(1,))
    columns = model.signatures | {"effect-1 @ place": model.nominal[:, None]}
    model = planted(
        replace(model, signatures=columns), e0=(0.5,), e3=(0.2 * (seed % 2),)
    )
    c = model.campaign
    rest = c.value - model.nominal
    diagnosis = conclude(
        find(replace(model, campaign=replace(c, sigma=1e-2 * c.sigma)))
    )
    assert len(diagnosis.alternatives) > 1
    left = [(a.effect, a.gap_after) for a in diagnosis.alternatives]
    if (
        len(diagnosis.effects) > 1
    ):  # else what it leaves alone is what the reported values leave
        left += [(e.effect, e.gap_after) for e in diagnosis.effects]
    for effect, gap in left:
        x = columns[f"{effect} @ place"][:, 0]
        least = np.linalg.norm(rest - x * (x @ rest) / (x @ x)) / np.linalg.norm(
            c.value
        )
        assert gap <= diagnosis.gap.nominal * (1.0 + 1e-9)
        assert gap == pytest.approx(100.0 * least, rel=1e-6)


@dataclass(frozen=True)
class EquilibriumModel(LinearModel):
    """Readings that first order lacks a part of; the equilibria reached have it."""

    second: np.ndarray | None = None

    def find_equilibria(self, _, rest=None):
        shown = 2.0 * np.linalg.norm(self.second) >= np.linalg.norm(rest)
        return (
            replace(self, nominal=self.nominal + self.second, second=0.0 * self.second)
            if shown and self.second.any()
            else None
        )


def test_second_order_that_an_effect_imitates_is_not_that_effect():
    """What another effect would do a little of: first order fits it, equilibria need none."""
    model = linear_model(np.random.default_rng(6))
    imitated = 0.03 * model.signatures["effect-3 @ place"][:, 0]
    facts = {**vars(planted(model, e0=(0.5,), e3=(0.03,))), "second": imitated}
    curved = EquilibriumModel(**facts)
    first = conclude(find(planted(model, e0=(0.5,), e3=(0.03,))))
    assert {e.effect for e in first.effects} == {"effect-0", "effect-3"}
    found = conclude(find(curved))
    assert found.verdict == "identified"
    assert {e.effect for e in found.effects} == {"effect-0"}
    larger = conclude(find(replace(curved, second=imitated / 3.0)))
    assert {e.effect for e in larger.effects} == {"effect-0", "effect-3"}


def test_a_certain_effect_is_not_hidden_by_a_doubtful_one():
    """The second is worth about its prior odds: whatever becomes of it, the first is identified."""
    model = linear_model(np.random.default_rng(6))
    for size in (0.004, 0.006, 0.008, 0.01):
        diagnosis = conclude(find(planted(model, e0=(0.5,), e3=(size,))))
        assert diagnosis.verdict == "identified"
        assert diagnosis.effects[0].effect == "effect-0"
        named = {e.effect for e in diagnosis.effects} | {
            p.effect for p in diagnosis.possible
        }
        assert (
            named <= {"effect-0", "effect-3"}
            or max(p.probability for p in diagnosis.possible) < 0.5
        )


@pytest.mark.extended
def test_one_known_and_one_unknown_cause_are_partly_explained():
    """The unknown one changes z alone, from pose to pose; the known one's interval holds what was planted."""
    inside = []
    for seed in range(8):
        rng = np.random.default_rng([7, seed])
        model = planted(linear_model(rng), e0=(0.3,), e5=(0.2, 0.1, -0.2))
        c = model.campaign
        unknown = (
            0.1
            * rng.standard_normal(10)[c.pose]
            * np.where(c.quantity == 2, c.value, 0.0)
        )
        diagnosis = conclude(
            find(replace(model, campaign=replace(c, value=c.value + unknown)))
        )
        assert diagnosis.verdict == "partly"
        assert {e.effect for e in diagnosis.effects} >= {"effect-0", "effect-5"}
        assert max(diagnosis.where.left, key=diagnosis.where.left.get) == "z"
        assert diagnosis.gap.left > 0.0
        interval = (
            next(e for e in diagnosis.effects if e.effect == "effect-0")
            .parameters["p0"]
            .interval
        )
        inside.append(interval[0] <= 0.3 <= interval[1])
    assert sum(inside) >= 6


@pytest.mark.extended
def test_readings_that_scatter_more_than_stated_have_wider_intervals():
    inside = []
    for seed in range(8):
        rng = np.random.default_rng([9, seed])
        sizes = {"e0": (0.3,), "e5": (0.2, 0.1, -0.2)}
        model = planted(linear_model(rng, effects=8), **sizes)
        c = model.campaign
        scattered = c.value + 2.0 * c.sigma * rng.standard_normal(len(c))
        diagnosis = conclude(find(replace(model, campaign=replace(c, value=scattered))))
        assert diagnosis.verdict == "partly"
        found = {
            e.effect.replace("effect-", "e"): e.parameters.values()
            for e in diagnosis.effects
        }
        for effect, values in sizes.items():
            ends = (parameter.interval for parameter in found[effect])
            inside += [
                low <= value <= high
                for (low, high), value in zip(ends, values, strict=True)
            ]
    assert np.mean(inside) > 0.75  # 0.5 by the stated noise alone


def lawful(diagnosis):
    """A verdict never contradicts its own numbers."""
    data = to_json(diagnosis)
    gap = data["gap"]
    verdict = data["verdict"]
    effects = data["effects"]
    certain = [e for e in effects if e["group_probability"] >= 0.9]
    n = len(diagnosis.samples.used)
    few = any("too few" in r for r in diagnosis.remarks)
    at_noise = gap["explained"] <= 1.2 * gap["noise"] * (1.0 + 3.0 / np.sqrt(2.0 * n))
    beyond = gap["explained"] > gap["noise"]
    assert not effects or verdict == "ambiguous" or gap["explained"] < gap["nominal"]
    assert gap["left"] == pytest.approx(
        np.sqrt(max(gap["explained"] ** 2 - gap["noise"] ** 2, 0.0))
    )
    assert not effects or sum(e["share"] for e in effects) == pytest.approx(1.0)
    assert all(len(e["confused_with"]) <= 2 for e in effects)
    assert all(
        e["probability"] <= e["group_probability"] + 1e-9 <= 1.0 + 2e-9 for e in effects
    )
    assert not {(p["effect"], p["place"]) for p in data["possible"]} & {
        (e["effect"], e["place"]) for e in effects
    }
    for p in (p for e in effects for p in e["parameters"].values()):
        assert p["interval"][0] <= p["value"] <= p["interval"][1]
    match verdict:
        case "identified":
            assert effects
            assert certain == effects
            assert at_noise
        case "partly":
            assert effects
            assert certain == effects
            assert beyond
            assert sum(data["where"]["left"].values()) == pytest.approx(1.0)
        case "ambiguous":
            assert few or not certain
            assert at_noise or few
        case "unexplained":
            assert not effects
            assert beyond
            assert gap["explained"] == gap["nominal"]
        case "no-gap":
            assert not effects
            assert at_noise
        case _:
            pytest.fail(verdict)


@pytest.mark.extended_for("9")
@pytest.mark.parametrize("seed", range(10))
def test_verdicts_agree_with_their_numbers_and_copies_change_nothing(seed):
    """Random campaigns, from none to four effects of any size, with an unknown cause or without, and twice over."""
    rng = np.random.default_rng([8, seed])
    model = linear_model(
        rng, poses=int(rng.integers(1, 9)), loads=int(rng.integers(2, 7)), effects=12
    )
    chosen = rng.permutation(12)[: seed % 5]
    sizes = {
        f"e{k}": 10.0 ** rng.uniform(-2.5, 0.0) * rng.standard_normal((1, 2, 3)[k % 3])
        for k in chosen
    }
    model = planted(model, **sizes)
    c = model.campaign
    if seed % 3 == 2:
        unknown = (
            10.0 ** rng.uniform(-2.0, -0.5)
            * rng.standard_normal((9, 6))[c.pose, c.quantity]
            * c.value
        )
        model = replace(model, campaign=replace(c, value=c.value + unknown))
    once = conclude(find(model))
    lawful(once)
    rows = np.tile(np.arange(len(c)), 2)
    doubled = {
        k: getattr(model.campaign, k)[rows]
        for k in (
            "pose",
            "wrench",
            "quantity",
            "value",
            "sigma",
            "session",
            "file",
            "line",
        )
    }
    copies = replace(
        model,
        campaign=replace(model.campaign, **doubled),
        nominal=model.nominal[rows],
        signatures={name: x[rows] for name, x in model.signatures.items()},
    )
    twice = conclude(find(copies))
    lawful(twice)
    assert twice.verdict == once.verdict
    assert [e.effect for e in twice.effects] == [e.effect for e in once.effects]
    assert [e.probability for e in twice.effects] == pytest.approx(
        [e.probability for e in once.effects], abs=1e-6
    )


def test_readings_twice_with_rounding_are_no_lack_of_fit():
    """Sixty rows twice, not to the last digit: correlated residuals, but no more of them than noise."""
    for seed in range(6):
        rng = np.random.default_rng([9, seed])
        model = planted(linear_model(rng, poses=2, loads=5, effects=8), e0=(0.5,))
        rows = np.tile(np.arange(60), 2)
        c = model.campaign
        doubled = {
            k: getattr(c, k)[rows]
            for k in (
                "pose",
                "wrench",
                "quantity",
                "value",
                "sigma",
                "session",
                "file",
                "line",
            )
        }
        doubled["value"] = doubled["value"] * (1.0 + 1e-9 * rng.standard_normal(120))
        again = replace(
            model,
            campaign=replace(c, **doubled),
            nominal=model.nominal[rows],
            signatures={name: x[rows] for name, x in model.signatures.items()},
        )
        diagnosis = conclude(find(again))
        lawful(diagnosis)
        if diagnosis.gap.explained <= 1.05 * diagnosis.gap.noise:
            assert diagnosis.verdict == "identified"


def test_the_prior_matters_where_the_readings_say_little():
    model = linear_model(np.random.default_rng(10))
    strong = conclude(find(planted(model, e0=(0.5,))))
    assert [s.verdict for s in strong.sensitivity] == ["identified"] * 4
    found = find(planted(model, e0=(0.02,)))
    p = found.compute_probability("effect-0 @ place")
    more, less = (
        found.under(replace(found.problem, odds=f * found.problem.odds))
        for f in (10.0, 0.1)
    )
    assert (
        more.compute_probability("effect-0 @ place")
        > p
        > less.compute_probability("effect-0 @ place")
    )


def test_the_posterior_meets_a_full_disk_as_any_file_does(tmp_path):
    """HDF5 itself would say something else of its own, or end the process."""
    resource = pytest.importorskip("resource")
    diagnosis = conclude(
        find(planted(linear_model(np.random.default_rng(11)), e0=(0.4,)))
    )
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (65536, limits[1]))
    try:
        with pytest.raises(OSError, match="File too large"):
            write_posterior(tmp_path / "posterior.nc", diagnosis.samples)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)


def test_the_posterior_opens_in_arviz(tmp_path):
    diagnosis = conclude(
        find(planted(linear_model(np.random.default_rng(11)), e0=(0.4,), e4=(0.2, 0.1)))
    )
    path = tmp_path / "posterior.nc"
    write_posterior(path, diagnosis.samples)
    try:
        import arviz

        data = arviz.from_netcdf(path)
        groups = {
            name: data[name]
            for name in ("posterior", "posterior_predictive", "observed_data")
        }
        assert set(data.groups()) == set(groups)
    except ModuleNotFoundError:
        import xarray

        groups = {
            name: xarray.open_dataset(path, group=name, engine="h5netcdf")
            for name in ("posterior", "posterior_predictive", "observed_data")
        }
    for effect in diagnosis.effects:
        for name, p in effect.parameters.items():
            draws = groups["posterior"][f"{effect.effect} @ {effect.place}: {name}"]
            assert draws.dims == ("chain", "draw")
            assert float(draws.mean()) == pytest.approx(p.value, abs=0.1 * p.sigma)
            assert float(draws.std()) == pytest.approx(p.sigma, rel=0.1)
            assert np.quantile(draws, [0.025, 0.975]) == pytest.approx(
                p.interval, abs=0.2 * p.sigma
            )
    observed = groups["observed_data"]["value"]
    predicted = groups["posterior_predictive"]["value"]
    low, high = np.quantile(predicted, [0.025, 0.975], axis=(0, 1))
    assert np.mean(
        (low <= observed.values) & (observed.values <= high)
    ) == pytest.approx(0.95, abs=0.04)
    assert diagnosis.held_out_check.inside_95 == pytest.approx(0.95, abs=0.04)


@pytest.mark.long
def test_evidence_agrees_with_nested_sampling():
    """Of one effect of two parameters and of none, with a prior of one size: their ln-odds by dynesty."""
    dynesty = pytest.importorskip("dynesty")
    from scipy.stats import norm

    model = planted(
        linear_model(
            np.random.default_rng(13), poses=4, loads=3, effects=2, parameters=(2,)
        ),
        e0=(0.05, 0.0),
    )
    noise = model.noise()
    problem = Problem(model, noise, sizes=np.ones(1))
    errors = problem.errors
    x = model.signatures["effect-0 @ place"] / noise.sigma[:, None]
    y = (model.campaign.value - model.nominal) / noise.sigma
    inverses = [
        np.linalg.inv(covariance_of(model, noise, size)) for size in errors.sizes
    ]

    def log_likelihood(u):
        r = y - x @ u
        return np.logaddexp.reduce(
            [
                w - 0.5 * r @ v @ r
                for w, v in zip(errors.log_weight, inverses, strict=True)
            ]
        )

    sampler = dynesty.NestedSampler(
        log_likelihood, norm.ppf, 2, nlive=600, rstate=np.random.default_rng(1)
    )
    sampler.run_nested(print_progress=False, dlogz=0.01)
    nested = sampler.results.logz[-1] - log_likelihood(np.zeros(2))
    one = problem.fit([model.library[0]], np.zeros(2)).known.log_evidence
    none = problem.fit((), np.zeros(0)).known.log_evidence
    assert one - none == pytest.approx(
        nested, abs=4.0 * sampler.results.logzerr[-1] + 0.05
    )


def twin(model, name, **others):
    """The model in which other effects have the very signature of one, and one that has its columns among its own."""
    own = next(c for c in model.library if c.name == name)
    named = (twin.split(" @ ") for twin in others.pop("twins", ()))
    alike = tuple(
        (replace(own, effect=effect, place=place), 1.0) for effect, place in named
    )
    changed = replace(own, twins=alike, **others)
    signatures = model.signatures | {
        other.name: model.signatures[name] for other, _ in alike
    }
    library = tuple(changed if c.name == name else c for c in model.library)
    return replace(model, library=library, signatures=signatures)


@pytest.mark.parametrize(
    ("count", "verdict"), [(0, "identified"), (4, "identified"), (8, "ambiguous")]
)
def test_effects_of_one_signature_share_its_probability(count, verdict):
    """Four more make a group of five that is certain; eight more make one of which six are not."""
    model = twin(
        linear_model(np.random.default_rng(12)),
        "effect-0 @ place",
        twins=tuple(f"twin-{k} @ place" for k in range(count)),
        aliases=("effect-0 @ here",),
    )
    diagnosis = conclude(find(planted(model, e0=(0.5,))))
    assert diagnosis.verdict == verdict
    (effect,) = diagnosis.effects
    assert effect.probability == pytest.approx(1.0 / (1 + count), abs=1e-3)
    assert effect.group_probability == pytest.approx(
        min(6, 1 + count) / (1 + count), abs=1e-3
    )
    assert effect.confused_with == (
        tuple(f"twin-{k} @ place" for k in range(min(count, 5))) or ("effect-0 @ here",)
    )
    others = {f"{p.effect} @ {p.place}" for p in diagnosis.possible}
    assert others == {f"twin-{k} @ place" for k in range(5, count)}


@pytest.mark.parametrize("widest", [100.0, 5.0])
@pytest.mark.parametrize("rate", [0.1, 20.0, -20.0])
def test_a_twin_is_as_likely_as_where_it_stands_by_itself(rate, widest):
    """Its parameter is as many times the other's, at most plausible or beyond: its odds follow its own prior."""
    model = planted(
        linear_model(np.random.default_rng(12), effects=6, parameters=(1,)), e0=(0.5,)
    )
    other = replace(model.library[0], effect="other", plausible=((-widest, widest),))
    model = replace(
        model,
        signatures=model.signatures
        | {other.name: model.signatures["effect-0 @ place"] / rate},
    )
    apart = find(replace(model, library=(*model.library, other)))
    merged = find(
        replace(
            model,
            library=(
                replace(model.library[0], twins=((other, rate),)),
                *model.library[1:],
            ),
        )
    )
    one, two = (
        next(h.evidence for h in apart.hypotheses if h.names == {c.name})
        for c in (model.library[0], other)
    )
    weights = merged.problem.weigh_twins(merged.best.candidates[0], merged.best)
    assert np.log(weights[1] / weights[0]) == pytest.approx(two - one, abs=0.1)
    assert merged.best.evidence == pytest.approx(np.logaddexp(one, two), abs=0.1)


@pytest.mark.parametrize(("alike", "verdict"), [(1, "identified"), (12, "ambiguous")])
def test_prior_odds_alone_identify_nothing(alike, verdict):
    """A word that may be at sixty places does at some of them what another does that may be at one alone.

    One such place is of the group: what odds make unlikely is named; twelve are more than a group holds.
    """
    rng = np.random.default_rng(12)
    model = linear_model(rng, effects=6, parameters=(1,))
    many = linear_model(rng, effects=60, parameters=(1,))
    crowd = [replace(c, effect="crowd", place=c.effect) for c in many.library]
    signatures = {c.name: many.signatures[f"{c.place} @ place"] for c in crowd}
    signatures |= {c.name: model.signatures["effect-0 @ place"] for c in crowd[:alike]}
    model = replace(
        model,
        library=(*model.library, *crowd),
        signatures=model.signatures | signatures,
    )
    diagnosis = conclude(find(planted(model, e0=(0.5,))))
    assert (diagnosis.verdict, [e.effect for e in diagnosis.effects]) == (
        verdict,
        ["effect-0"],
    )
    assert diagnosis.effects[0].probability == pytest.approx(
        60 / (60 + alike), abs=0.01
    )
    others = [c.name for c in crowd[:alike]]
    assert set(diagnosis.effects[0].confused_with) <= {*others}
    assert len(diagnosis.effects[0].confused_with) == min(alike, 5)
    assert (verdict == "ambiguous") == any(
        "fits about as well as effect-0 @ place" in r for r in diagnosis.remarks
    )


def test_what_stands_in_the_place_of_another_effect_is_in_no_group_but_its_own():
    """Two effects with rivals: one with three twins, one with an effect of its own."""
    model = linear_model(np.random.default_rng(24), parameters=(1,))
    model = replace(
        model,
        signatures=model.signatures
        | {"effect-10 @ place": model.signatures["effect-0 @ place"]},
    )
    twins = tuple(f"twin-{k} @ place" for k in range(3))
    found = find(
        twin(planted(model, e0=(0.2,), e1=(0.4,)), "effect-1 @ place", twins=twins)
    )
    assert found.group("effect-1 @ place").others == twins
    (other,) = found.best.names - {"effect-1 @ place"}
    assert {other, *found.group(other).others} == {
        "effect-0 @ place",
        "effect-10 @ place",
    }


def test_a_word_is_as_likely_as_another_at_however_many_places():
    """Of two effects with one signature, one may be at a single place, and the other at seven."""
    model = linear_model(np.random.default_rng(12))
    spread = [f"effect-{k} @ place" for k in range(10, 16)]
    model = twin(model, "effect-0 @ place", twins=("many @ here",))
    library = tuple(
        replace(c, effect="many", place=c.effect) if c.name in spread else c
        for c in model.library
    )
    signatures = {
        c.name: model.signatures[old.name]
        for c, old in zip(library, model.library, strict=True)
    }
    found = find(
        planted(replace(model, library=library, signatures=signatures), e0=(0.5,))
    )
    assert found.compute_probability("effect-0 @ place") == pytest.approx(
        7 / 8, abs=1e-3
    )
    assert found.compute_probability("many @ here") == pytest.approx(1 / 8, abs=1e-3)


def unnamed(model, numbers):
    """The model in which some effects are patterns of one kind."""
    names = {f"effect-{k} @ place": f"unknown @ pattern {k}" for k in numbers}
    library = tuple(
        replace(
            c,
            effect="unknown",
            place=names[c.name].partition(" @ ")[2],
            pattern="pattern",
        )
        if c.name in names
        else c
        for c in model.library
    )
    signatures = {
        names.get(name, name): columns for name, columns in model.signatures.items()
    }
    return replace(model, library=library, signatures=signatures)


@pytest.mark.parametrize(("size", "verdict"), [(0.5, "partly"), (5.0, "identified")])
def test_what_is_certain_beside_a_certain_pattern_is_part_of_the_answer(size, verdict):
    """A pattern within the noise that the fit alone sees; beside a large gap it may be the model's own error."""
    model = planted(
        linear_model(np.random.default_rng(22), parameters=(1,)),
        e0=(size,),
        e7=(0.025,),
    )
    found = find(unnamed(model, [7]))
    diagnosis = conclude(found)
    assert found.best.names == {"effect-0 @ place", "unknown @ pattern 7"}
    assert not lack_of_fit(found, found.fit_effects(found.best.words))
    assert diagnosis.verdict == verdict
    assert [e.effect for e in diagnosis.effects] == ["effect-0"]
    assert (
        "the readings follow pattern 7, outside the known effects" in diagnosis.remarks
    )


@pytest.mark.parametrize(
    ("main", "verdict"), [(True, "ambiguous"), (False, "identified")]
)
def test_a_pattern_that_may_stand_in_the_place_of_an_effect_is_of_its_group(
    main, verdict
):
    """One of five patterns has the signature of an effect, of one beside a larger one or of that itself."""
    model = linear_model(np.random.default_rng(23), parameters=(1,))
    model = replace(
        model,
        signatures=model.signatures
        | {"effect-10 @ place": model.signatures["effect-0 @ place"]},
    )
    diagnosis = conclude(
        find(
            unnamed(
                planted(model, e0=(0.2,), e1=(0.1 if main else 0.4,)), range(10, 15)
            )
        )
    )
    assert diagnosis.verdict == verdict
    known = {e.effect: e for e in diagnosis.effects}
    assert known["effect-0"].confused_with == ("unknown @ pattern 10",)
    assert known["effect-0"].probability < 0.9 < known["effect-0"].group_probability
    assert not known["effect-1"].confused_with
    assert any(
        r.startswith("pattern 10 would explain the readings nearly as well")
        for r in diagnosis.remarks
    )


def test_what_is_likelier_without_a_word_is_not_named():
    """Two patterns, each a kind of its own, have the signature of the smaller of two effects."""
    model = linear_model(np.random.default_rng(23), effects=24, parameters=(1,))
    same = dict.fromkeys(
        ["effect-10 @ place", "effect-11 @ place"], model.signatures["effect-0 @ place"]
    )
    model = unnamed(
        planted(
            replace(model, signatures=model.signatures | same), e0=(0.2,), e1=(0.4,)
        ),
        [10, 11],
    )
    library = tuple(
        replace(c, pattern=c.place) if c.is_nuisance else c for c in model.library
    )
    found = find(replace(model, library=library))
    assert found.compute_probability("effect-0 @ place") < 0.5
    assert found.group("effect-0 @ place").probability > 0.9
    assert [e.effect for e in conclude(found).effects] == ["effect-1"]


@pytest.mark.parametrize("merged", [False, True])
def test_a_part_entry_by_entry_takes_no_place_of_others_in_a_group(merged):
    """A matrix does as well as the plain factor that bears its name too; two others do, but for a little noise.

    Factor and matrix are one cause, as likely as another, also where a drive has the factor's signature.
    """
    model = linear_model(np.random.default_rng(31), parameters=(1,))
    own = model.signatures["effect-0 @ place"]
    rough = np.random.default_rng(32).standard_normal((len(own), 4))
    signatures = model.signatures | {
        "matrix @ place": np.hstack([own, 1e-7 * rough[:, :2]]),
        "effect-1 @ place": own + 2.2e-7 * rough[:, 3:],
        "effect-2 @ place": own + 2.3e-7 * rough[:, 3:],
    }
    plain = replace(model.library[0], aliases=("matrix @ place",))
    matrix = replace(
        plain,
        effect="matrix",
        names=tuple("abc"),
        units=("1",) * 3,
        scale=(1.0,) * 3,
        aliases=(),
        plausible=3 * plain.plausible,
        flexible=True,
    )
    if merged:
        plain = replace(
            model.library[0], twins=((replace(plain, effect="factor"), 1.0),)
        )
    model = replace(
        model, signatures=signatures, library=(plain, matrix, *model.library[1:])
    )
    found = find(planted(model, e0=(0.5,)))
    assert [*map(sorted, (h.names for h in found.hypotheses[:4]))] == [
        ["effect-0 @ place"],
        ["matrix @ place"],
        ["effect-1 @ place"],
        ["effect-2 @ place"],
    ]
    odds = Problem(model, model.noise()).odds_of
    assert odds(plain).sum() + odds(matrix).sum() == pytest.approx(
        (1 + merged) * odds(model.library[3]).sum()
    )
    assert found.probability[3] > 0.02
    group = found.group("effect-0 @ place")
    names = "factor @ place", "effect-1 @ place", "effect-2 @ place"
    assert group.others == (names[:2] if merged else names[1:])
    assert group.probability > 0.9  # with the matrix


def test_a_group_has_the_likeliest_of_what_readings_do_not_tell_apart():
    """A twin has half of the odds that it and the effect have in common; two others fit a little less well."""
    model = linear_model(np.random.default_rng(31), parameters=(1,))
    rough = 1.3e-7 * np.random.default_rng(32).standard_normal((len(model.nominal), 1))
    alike = {
        f"effect-{k} @ place": model.signatures["effect-0 @ place"] + rough
        for k in (1, 2)
    }
    model = twin(
        replace(model, signatures=model.signatures | alike),
        "effect-0 @ place",
        twins=("twin-0 @ place",),
    )
    found = find(planted(model, e0=(0.5,)))
    assert (
        found.probability[0] / 4.0 < found.probability[1] < found.probability[0] / 2.0
    )
    assert found.group("effect-0 @ place").others[0] == "twin-0 @ place"


def test_a_main_cause_that_is_not_settled_is_ambiguous():
    """A small effect beside a large one that has any of eight names explains too little to be certain."""
    model = linear_model(np.random.default_rng(13), parameters=(1,))
    model = twin(
        model, "effect-0 @ place", twins=tuple(f"twin-{k} @ place" for k in range(7))
    )
    large, small = (
        conclude(find(planted(model, e0=(u,), e1=(v,))))
        for u, v in ((0.5, 0.05), (0.05, 0.5))
    )
    assert large.verdict == "ambiguous"
    assert {e.effect for e in large.effects} == {"effect-0", "effect-1"}
    assert small.verdict == "partly"
    assert {e.effect for e in small.effects} == {"effect-1"}


@pytest.mark.parametrize(("size", "certain"), [(0.02, False), (0.08, True)])
def test_what_explains_less_than_a_twentieth_is_not_certain(size, certain):
    """Of 0.5 and 0.02 of two effects, the second moves readings by 4 % of the gap, however clearly it is seen."""
    model = linear_model(np.random.default_rng(21), parameters=(1,))
    found = conclude(find(planted(model, e0=(0.5,), e1=(size,))))
    assert (
        {e.effect for e in found.effects} == {"effect-0", "effect-1"}
        if certain
        else {"effect-0"}
    )
    assert found.verdict == ("identified" if certain else "partly")
    (own,) = next(
        e for e in found.effects if e.effect == "effect-0"
    ).parameters.values()
    assert own.value == pytest.approx(0.5, abs=4 * own.sigma)
    if not certain:
        (small,) = (p for p in found.possible if p.effect == "effect-1")
        assert small.probability > 0.9
        assert any("effect-1" in r and "less than 5 %" in r for r in found.remarks)


@pytest.mark.parametrize(("size", "certain"), [(0.3, False), (1.0, True)])
def test_an_effect_beside_a_rest_is_judged_by_the_gap_not_its_square(size, certain):
    """Two effects on loads of their own, of 5 and `size`, and a rest: of what is left, squares add up.

    The second moves readings by 14 % of the gap, or by 4 %; its share of χ² is 2 %, or 0.2 %.
    """
    rng = np.random.default_rng(23)
    model = linear_model(rng, parameters=(1,))
    even = np.argmax(model.campaign.wrench != 0.0, axis=1) % 2 == 0
    signatures = dict(model.signatures)
    for name, own in (("effect-0 @ place", even), ("effect-1 @ place", ~even)):
        signatures[name] = signatures[name] * own[:, None]
    model = planted(replace(model, signatures=signatures), e0=(5.0,), e1=(size,))
    sigma = model.campaign.sigma
    value = model.campaign.value + 2.0 * sigma * rng.standard_normal(len(sigma))
    model = replace(model, campaign=replace(model.campaign, value=value))
    found = find(model)
    assert lack_of_fit(found, found.fit_effects(model.library[:2]))
    moved = [
        np.linalg.norm(each * signatures[f"effect-{k} @ place"][:, 0] / sigma)
        for k, each in enumerate((5.0, size))
    ]
    rest = 2.0 * np.sqrt(len(sigma))
    part = (np.hypot(moved[1], rest) - rest) / np.linalg.norm([*moved, rest])
    assert (part > VERDICT.explains) == certain
    answer = conclude(found)
    assert answer.verdict == "partly"
    assert ("effect-1" in {e.effect for e in answer.effects}) == certain


def test_an_answer_that_knows_of_a_further_cause_is_not_complete():
    """The second adds a tenth to χ², as errors of a model may, but is seen beyond doubt all the same."""
    model = linear_model(np.random.default_rng(21), parameters=(1,))
    found = conclude(find(planted(model, e0=(2.0,), e1=(0.02,))))
    (small,) = (p for p in found.possible if p.effect == "effect-1")
    assert small.probability > 0.9
    assert found.gap.chi2_per_reading[1] < 1.4
    assert found.verdict == "partly"
    assert {e.effect for e in found.effects} == {"effect-0"}
    (own,) = found.effects[0].parameters.values()
    assert own.value == pytest.approx(2.0, abs=3 * own.sigma)


@pytest.mark.parametrize(("knee", "certain"), [(0.02, False), (0.5, True)])
def test_a_detail_that_explains_little_does_not_decide_between_causes(knee, certain):
    """A drive that is softer, or softer beyond a load: the latter has a parameter more."""
    model = linear_model(np.random.default_rng(22), parameters=(1, 2))
    signatures = dict(model.signatures)
    detailed = signatures["effect-1 @ place"]
    signatures["effect-0 @ place"] = detailed[:, :1]
    library = tuple(
        replace(c, members=("drive",)) if c.effect in {"effect-0", "effect-1"} else c
        for c in model.library
    )
    model = replace(model, library=library, signatures=signatures)
    found = conclude(find(planted(model, e1=(2.0, 2.0 * knee))))
    assert [e.effect for e in found.effects] == ["effect-1"]
    assert found.verdict == ("identified" if certain else "ambiguous")
    beside = found.effects[0].confused_with
    assert ("effect-0 @ place" in beside) == (not certain)
    assert found.effects[0].probability > 0.9 or not certain


@pytest.mark.parametrize(("offset", "named"), [(0.3, False), (1.0, True)])
def test_an_offset_within_a_drive_s_play_may_be_where_it_rests(offset, named):
    model = linear_model(np.random.default_rng(23), parameters=(1,))
    facts = {
        "effect-0": {"members": ("drive",)},
        "effect-1": {"members": ("drive",), "rests_in": "effect-0"},
    }
    library = tuple(replace(c, **facts.get(c.effect, {})) for c in model.library)
    model = replace(model, library=library)
    found = conclude(find(planted(model, e0=(0.5,), e1=(offset,))))
    names = {e.effect for e in found.effects}
    assert names == ({"effect-0", "effect-1"} if named else {"effect-0"})
    assert found.verdict == ("identified" if named else "partly")
    assert named or any("rests in its gap" in r for r in found.remarks)


@pytest.mark.parametrize("together", [True, False])
def test_readings_far_off_under_one_load_at_several_poses_are_no_slips(together):
    """A machine beyond a knee: one sensor, one load, three poses; or three slips anywhere."""
    rng = np.random.default_rng(24)
    model = linear_model(rng, effects=3)
    c = model.campaign
    applied = np.argmax(c.wrench > 0.0, axis=1)
    one = np.flatnonzero((applied == 2) & (c.quantity == 1) & (c.pose < 3))
    rows = one if together else rng.choice(len(c), len(one), replace=False)
    value = np.array(c.value)
    value[rows] += 40.0 * c.sigma[rows]
    noise = noise_of(replace(model, campaign=replace(c, value=value)))
    assert noise.used[rows].all() == together
    assert noise.used.sum() >= len(c) - len(rows)


@pytest.mark.extended
def test_what_is_adopted_is_certain_and_fitted_without_the_rest():
    """Of three effects the third is hardly likelier than not: the others are what least squares say without it."""
    model = linear_model(np.random.default_rng(6), parameters=(1,))
    left_out = set()
    for size in (0.0155, 0.016, 0.0165):
        own = planted(model, e0=(0.5,), e1=(0.03,), e3=(size,))
        found = conclude(find(own))
        sure = found.adoptable
        left_out |= {e.effect for e in sure.left_out}
        names = [e.effect for e in sure.effects]
        assert {e.effect for e in found.effects} <= set(names)
        assert all(e.probability >= 0.9 for e in sure.effects)
        assert all(e.probability < 0.9 for e in sure.left_out)
        columns = [own.signatures[f"{name} @ place"][:, 0] for name in names]
        rest = own.campaign.value - own.nominal
        least = np.linalg.lstsq(np.column_stack(columns), rest, rcond=None)[0]
        values = [e.parameters["p0"].value for e in sure.effects]
        assert values == pytest.approx(least, rel=0.02)
        assert "adoptable" not in to_json(found)
    assert left_out == {"effect-3"}


def test_an_effect_that_comes_in_two_sizes_keeps_the_one_that_was_found():
    """Beside an effect that is not certain it has two parameters; alone, one would do."""
    model = linear_model(np.random.default_rng(14), parameters=(1,))
    rng = np.random.default_rng(15)
    extra, rest = 1e-5 * rng.standard_normal((2, len(model.campaign)))
    signatures = model.signatures | {
        "effect-5 @ place": np.column_stack(
            [model.signatures["effect-5 @ place"], extra]
        ),
        "effect-1 @ place": (extra + rest)[:, None],
    }
    one = next(c for c in model.library if c.effect == "effect-5")
    two = replace(
        one,
        names=("p0", "p1"),
        units=("1", "1"),
        scale=2 * one.scale,
        plausible=2 * one.plausible,
    )
    model = replace(model, signatures=signatures, library=(*model.library, two))
    model = twin(
        model, "effect-1 @ place", twins=tuple(f"twin-{k} @ place" for k in range(4))
    )
    found = find(planted(model, e1=(-0.1,), e5=(0.5, 0.1)))
    assert forms_of(found.best.candidates) == {
        ("effect-1 @ place", 1),
        ("effect-5 @ place", 2),
    }
    alone = next(h for h in found.hypotheses if h.names == {"effect-5 @ place"})
    assert forms_of(alone.candidates) == {("effect-5 @ place", 1)}
    diagnosis = conclude(found)
    (effect,) = (e for e in diagnosis.effects if e.effect == "effect-5")
    values = [p.value for p in effect.parameters.values()]
    assert values == pytest.approx(
        [0.5, 0.1], abs=4.0 * max(p.sigma for p in effect.parameters.values())
    )


@pytest.mark.parametrize("first", [True, False])
def test_a_value_that_is_not_plausible_hides_no_other_cause_that_does_as_well(first):
    """A second effect does the same with a hundred times the value, beyond its range; alone it explains nothing."""
    model = linear_model(np.random.default_rng(5), effects=6, parameters=(1,))
    own = model.library[0]
    heavy = replace(own, effect="heavy", scale=(100.0,), plausible=((0.0, 5.0),))
    model = replace(
        model,
        library=(heavy, *model.library) if first else (*model.library, heavy),
        signatures=model.signatures | {heavy.name: 0.01 * model.signatures[own.name]},
    )
    told = planted(model, e0=(0.5,))
    diagnosis = conclude(find(told))
    assert (diagnosis.verdict, [e.effect for e in diagnosis.effects]) == (
        "identified",
        ["effect-0"],
    )
    assert diagnosis.effects[0].probability == pytest.approx(1 / 1.01, abs=5e-3)
    assert (
        diagnosis.effects[0].confused_with == ()
    )  # a hundredth of the odds is none to name
    alone = conclude(
        find(
            replace(
                told,
                library=(heavy, *model.library[2:-1]) if first else model.library[1:],
            )
        )
    )
    assert alone.verdict == "unexplained"
    assert any("not plausible" in remark for remark in alone.remarks)


@pytest.mark.parametrize(
    "kind",
    [
        {"flexible": True},
        {"couplings": 3},
        {"effect": "unknown", "pattern": "six waves"},
    ],
)
def test_what_follows_almost_anything_does_not_hide_a_simpler_set(kind):
    """Six parameters stand for two effects, and many effects are like the third: the simple set is off the beam."""
    model = linear_model(np.random.default_rng(4), effects=21, parameters=(1,))
    signatures = dict(model.signatures)
    flexible = replace(
        model.library[20],
        names=tuple("abcdef"),
        units=("1",) * 6,
        scale=(1.0,) * 6,
        plausible=((-9.0, 9.0),) * 6,
        **kind,
    )
    of = [signatures[c.name] for c in model.library]
    for k in range(3, 18):
        signatures[model.library[k].name] = of[2] + 0.3 * of[k]
    signatures[flexible.name] = np.hstack(
        [of[0], of[1], of[20], of[19], of[18], 0.5 * (of[3] + of[4])]
    )
    model = replace(
        model, signatures=signatures, library=(*model.library[:20], flexible)
    )
    best = find(planted(model, e0=(0.3,), e1=(0.3,), e2=(0.2,))).best
    assert best.names == {f"effect-{k} @ place" for k in range(3)}


@pytest.mark.parametrize("coupled", [0.0, 0.4, -0.4])
def test_evidence_of_what_cannot_be_negative_is_an_integral_above_zero(coupled):
    """By cubature, from far below zero to far above. A factor of 2 for each free parameter made six that show nothing
    eight times as likely as none."""
    gram = np.array([[1.0, coupled], [coupled, 0.7]])
    edges = np.linspace(0.0, 12.0, 2401)
    u = 0.5 * (edges[1:] + edges[:-1])
    first, second = np.meshgrid(u, u, indexing="ij")
    for pull in (
        [-3.0, -2.0],
        [-1.0, 0.5],
        [0.1, -0.1],
        [0.5, 3.0],
        [4.0, 6.0],
        [0.0, 0.0],
    ):
        core = gram + np.eye(2)
        cost = (
            core[0, 0] * first**2
            + 2.0 * core[0, 1] * first * second
            + core[1, 1] * second**2
        )
        integrand = np.exp(-0.5 * cost + pull[0] * first + pull[1] * second)
        exact = np.log(
            4.0 / (2.0 * np.pi) * integrand.sum() * (edges[1] - edges[0]) ** 2
        )
        found = log_evidences(
            gram[None],
            np.array([pull]),
            np.zeros(1),
            np.zeros(1),
            np.ones((1, 2)),
            np.array([True, True]),
        )[0]
        assert found.item() == pytest.approx(exact, abs=0.15 if coupled else 1e-4)


def test_a_parameter_that_readings_hardly_show_keeps_to_its_prior():
    """Values of the widest prior with uncertainties of the likeliest were 8 of these from the truth."""
    model = linear_model(np.random.default_rng(4), effects=1, parameters=(2,))
    noise = (model.campaign.value - model.nominal) / model.campaign.sigma
    along = noise / np.linalg.norm(noise)
    aside = np.random.default_rng(5).standard_normal(len(noise))
    aside -= along * (along @ aside)
    share = 2.0 / np.linalg.norm(
        noise
    )  # a column of unit length by which the noise is two
    column = share * along + np.sqrt(1.0 - share**2) * aside / np.linalg.norm(aside)
    (name,) = model.signatures
    shown = np.column_stack(
        [model.signatures[name][:, 0], 0.2 * column * model.campaign.sigma]
    )
    found = find(planted(replace(model, signatures={name: shown}), e0=(1.0, 0.0)))
    (value, beside) = found.best.values
    sigma = np.sqrt(np.diagonal(found.best.covariance))
    assert value == pytest.approx(1.0, abs=3.0 * sigma[0])
    assert abs(beside) < sigma[1]


def test_an_effect_of_one_sign_starts_from_what_it_explains_without_a_discrepancy():
    """A discrepancy takes up what it shares with the readings themselves; what is left has the other sign."""
    model = linear_model(np.random.default_rng(4), effects=1, parameters=(1,))
    effect = replace(model.library[0], bounds=(0.0, np.inf))
    value = model.campaign.value
    beside = 3e-6 * np.random.default_rng(5).standard_normal(len(value))
    column = value - 6.0 * beside
    model = replace(
        model,
        library=(effect,),
        signatures={effect.name: column[:, None]},
        nominal=-beside,
    )
    problem = Problem(model, model.noise())
    none = problem.fit((), np.zeros(0))
    (start,) = Search(problem).score_extensions(none, problem.library_at(none))
    assert start.values[0] == pytest.approx(
        column @ (value + beside) / (column @ column), rel=1e-3
    )


@dataclass(frozen=True)
class CurvedModel(LinearModel):
    """A linear model whose readings follow powers of its one effect's parameter, each its own."""

    def predict(self, parameters=()):
        u = parameters[0][1][0] if parameters else 0.0
        name = self.library[0].name
        column = self.signatures[name]
        power = np.linspace(0.5, 1.0, len(self.nominal))
        values = self.nominal + column[:, 0] * ((1.0 + u) ** power - 1.0) / power
        return LinearPrediction(
            values, {name: column * ((1.0 + u) ** (power - 1.0))[:, None]}
        )


def test_a_fit_from_afar_ends_where_one_from_nearby_does():
    """What the start leaves looks like a discrepancy, which must not weigh the readings at the end."""
    model = linear_model(
        np.random.default_rng(5), poses=6, loads=6, effects=1, parameters=(1,)
    )
    (effect,) = (replace(c, bounds=(-0.9, 100.0)) for c in model.library)
    model = CurvedModel(
        model.campaign,
        model.nominal,
        {effect.name: 20.0 * model.signatures[effect.name]},
        (effect,),
    )
    noise = model.campaign.value - model.nominal
    value = model.predict(((effect, (8.0,)),)).values + noise
    model = replace(model, campaign=replace(model.campaign, value=value))
    problem = Problem(model, model.noise())
    near = problem.fit([effect], np.array([8.0]))
    afar = problem.fit([effect], np.array([4.0]), target=near.evidence)
    assert afar.converged
    assert afar.values == pytest.approx(
        near.values, abs=0.05 * float(near.covariance[0, 0] ** 0.5)
    )


@dataclass(frozen=True)
class ProductModel(LinearModel):
    """Many errors, all multiplied by one gain: ``nominal + (1 + g) X u``."""

    def predict(self, parameters=()):
        many, gain = self.library
        given = {c.name: np.array(values) for c, values in parameters}
        u = given.get(many.name, np.zeros(len(many.scale)))
        g = float(given.get(gain.name, [0.0])[0])
        x = self.signatures[many.name]
        columns = {many.name: (1.0 + g) * x, gain.name: (x @ u)[:, None]}
        return LinearPrediction(self.nominal + (1.0 + g) * (x @ u), columns)


@pytest.mark.parametrize("size", [0.3, 3.0])
def test_a_gain_on_what_is_found_promises_no_smaller_errors(size):
    """To first order it makes all errors vanish, for which a tiny prior size would be the likeliest.

    It explains nothing: ln of its evidence is its prior odds and Occam's factor, -5 to -20 (180 and -60,000 before).
    """
    rng = np.random.default_rng(4)
    model = linear_model(rng, poses=10, loads=8, effects=2, parameters=(40, 1))
    many, gain = model.library
    many = replace(many, parts=many.names)
    gain = replace(gain, scale=(0.05,), plausible=((-0.3, 0.4),), bounds=(-0.8, 50.0))
    model = ProductModel(model.campaign, model.nominal, model.signatures, (many, gain))
    value = model.campaign.value + model.signatures[many.name] @ (
        size * rng.standard_normal(40)
    )
    problem = Problem(
        replace(model, campaign=replace(model.campaign, value=value)), model.noise()
    )
    alone, both = (
        problem.fit(chosen, np.zeros(k))
        for chosen, k in (((many,), 40), ((many, gain), 41))
    )
    assert -20.0 < both.evidence - alone.evidence < -5.0
    assert problem.reweigh(both) == pytest.approx(both.evidence)


def test_what_a_fit_leaves_is_what_its_parameters_leave():
    """To first order, and at a bound, it would be what the model does not say, or cannot."""
    model = linear_model(
        np.random.default_rng(5), poses=6, loads=6, effects=1, parameters=(1,)
    )
    (effect,) = (replace(c, bounds=(-0.9, 2.0)) for c in model.library)
    model = CurvedModel(model.campaign, model.nominal, model.signatures, (effect,))
    noise = model.campaign.value - model.nominal
    for truth in (0.5, 1.9, 3.0):
        value = model.predict(((effect, (truth,)),)).values + noise
        problem = Problem(
            replace(model, campaign=replace(model.campaign, value=value)), model.noise()
        )
        fit = problem.fit([effect], np.zeros(1))
        predicted = model.predict(fit.parameters).values
        assert fit.residual == pytest.approx(
            (value - predicted) / model.campaign.sigma, abs=1e-9
        )
        assert (fit.short > FIT.margin) == (truth > 2.0)


def test_units_of_parameters_change_neither_what_is_held_out_nor_what_is_drawn():
    """A compliance of 1e-9 m/N beside a mass of kilograms: rounding took directions away that readings show well."""
    model = planted(
        linear_model(
            np.random.default_rng(6), poses=4, loads=3, effects=2, parameters=(1,)
        ),
        e0=(1,),
        e1=(1,),
    )
    small, large = model.library
    tiny = replace(small, scale=(1e-9,), plausible=((-1e-7, 1e-7),))
    signatures = model.signatures | {small.name: 1e9 * model.signatures[small.name]}
    held_out = []
    spread = []
    for each in (model, replace(model, library=(tiny, large), signatures=signatures)):
        found = find(each)
        assert len(found.best.names) == 2
        held_out.append(found.held_out_residual(found.best))
        samples = draw_samples(
            found, [(found.best, 1.0)], found.best.candidates, held_out[0]
        ).parameters
        draws = np.stack([samples[f"{c.name}: p0"].ravel() for c in (small, large)])
        spread.append(np.corrcoef(draws)[0, 1])
        sigma = [
            np.sqrt(np.diagonal(found.best.covariance))[found.best.candidates.index(c)]
            for c in each.library
        ]
        assert draws.std(axis=1) == pytest.approx(sigma, rel=0.1)
    assert held_out[0] == pytest.approx(held_out[1])
    assert spread[0] == pytest.approx(spread[1], abs=0.1)


def test_a_parameter_taken_for_zero_has_the_interval_that_the_readings_leave_it():
    """One of three shows well, so that the others fit as zero; they are as uncertain as in least squares, nearly."""
    model = linear_model(np.random.default_rng(2), effects=2, parameters=(3,))
    first = replace(model.library[0], bounds=(0.0, np.inf))
    columns = model.signatures[first.name] * [1.0, 0.02, 0.02]
    model = replace(
        model,
        library=(first, *model.library[1:]),
        signatures=model.signatures | {first.name: columns},
    )
    (effect,) = conclude(find(planted(model, e0=(1.0, 0.1, 0.1)))).effects
    own = columns / model.campaign.sigma[:, None]
    sigma = np.sqrt(np.diagonal(np.linalg.inv(own.T @ own)))
    for k in (1, 2):
        fit = effect.parameters[f"p{k}"]
        assert fit.value < 1e-6
        assert fit.interval[0] <= 0.1 <= fit.interval[1]
        assert fit.interval[1] > 1.5 * sigma[k]


def test_parallel_columns_far_above_their_prior_are_fitted():
    """Forces in GN for N: no prior counts beside the readings, and their products are singular."""
    model = linear_model(np.random.default_rng(3), effects=1, parameters=(2,))
    columns = 1e11 * model.signatures["effect-0 @ place"][:, [0, 0]]
    model = planted(
        replace(model, signatures={"effect-0 @ place": columns}), e0=(0.2, 0.1)
    )
    fit = Problem(model, model.noise()).fit(model.library, np.zeros(2))
    assert sum(fit.values) == pytest.approx(0.3, rel=1e-6)


def test_the_interval_of_competing_hypotheses_is_that_of_draws_from_all():
    mean = np.array([0.0, 3.0, 1.0])
    sigma = np.array([1.0, 0.5, 2.0])
    weight = np.array([0.5, 0.3, 0.2])
    rng = np.random.default_rng(0)
    source = rng.choice(3, 200_000, p=weight)
    drawn = mean[source] + sigma[source] * rng.standard_normal(200_000)
    ends = np.stack([mean - 1.96 * sigma, mean + 1.96 * sigma], axis=1)
    assert mix_intervals(ends, weight) == pytest.approx(
        np.quantile(drawn, [0.025, 0.975]), abs=0.03
    )


def test_what_no_reading_shows_of_many_errors_is_said():
    """Of four errors two show by their sum alone, and one in no reading."""
    model = linear_model(np.random.default_rng(19), parameters=(4,))
    first = model.library[0]
    columns = model.signatures["effect-0 @ place"].copy()
    columns[:, 1] = columns[:, 0]
    columns[:, 3] = 0.0
    many = replace(
        first, parts=("a.y", "a.z", "b.y", "b.z"), part_units=("m",) * 4, groups=(4,)
    )
    model = replace(
        model,
        library=(many, *model.library[1:]),
        signatures=model.signatures | {"effect-0 @ place": columns},
    )
    found = conclude(find(planted(model, e0=(0.3, 0.2, 0.4, 0.0))))
    assert [e.effect for e in found.effects] == ["effect-0"]
    text = "effect-0 @ place: readings show 2 combinations of its 4 errors, and nothing of b.z"
    assert text in found.remarks


def test_a_pose_is_held_out_of_the_fit_that_is_reported():
    """Two effects and an unknown rest, five times as large at one pose: each by the posterior of the others."""
    rng = np.random.default_rng(103)
    model = linear_model(rng, poses=6, loads=2, effects=6, parameters=(6,), rough=0.05)
    c = model.campaign
    names = list(model.signatures)
    weight = np.where(c.pose == 0, 5.0, 1.0)
    signatures = {name: x * weight[:, None] for name, x in model.signatures.items()}
    value = c.value + sum(
        signatures[name] @ rng.choice([-1.0, 1.0], 6) for name in names[:2]
    )
    value = value + 6e-6 * weight * rng.standard_normal(len(c.pose))
    model = replace(model, campaign=replace(c, value=value), signatures=signatures)
    found = find(model)
    best = found.best
    assert found.problem.errors.sizes[np.argmax(best.known.settings)] > 0.0
    left = found.held_out_residual(best)
    for pose in range(6):
        here = c.pose == pose
        noise = replace(found.problem.noise, used=found.problem.noise.used & ~here)
        mean = (
            Problem(model, noise)
            .posterior(best.candidates, best.linear, best.slopes)
            .mean
        )
        assert left[here] == pytest.approx(best.linear[here] - best.slopes[here] @ mean)
    assert left @ left < 0.1 * found.chi2(found.none)
