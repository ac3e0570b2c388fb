"""Methods of a study: which designs are tried next, given those before; the same designs every time, by the seed.

A design is a point of the unit cube, a coordinate for each variable. A method asks for several at once where it can,
so that workers have something to do. Global: Sobol's points, a Latin hypercube, a grid (SciPy); NSGA-II (Optuna).
Local: COBYQA (SciPy), a derivative-free trust-region method for bounds and constraints, from the best few points.
"""

from __future__ import annotations

import itertools
import math
import warnings
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from stiffscope.design.study_file import StudyFile, Variable

STARTS = 2  # local searches side by side
GLOBAL = 0.4  # of an optimum's designs: sampled before the local searches
FIRST_STEP, LAST_STEP = 0.1, 1e-5  # trust-region radius of a local search, shares of the ranges
APART = 0.2  # shares of the ranges between the points that local searches start from
FEASIBLE = 1e-6  # relative violation of a constraint that rounding and the local search may leave
POPULATION = (8, 40)  # of a generation of NSGA-II, and a tenth of the designs in between

Point = tuple[float, ...]


@dataclass(frozen=True)
class Outcome:
    """What became of a design: objectives to be made small, relative violations of the limits, None where it failed."""

    objectives: tuple[float, ...] | None
    violations: tuple[float, ...] = ()

    @property
    def excess(self) -> float:
        """Largest violation, 0 where all limits hold; infinite for a failed design."""
        return math.inf if self.objectives is None else max(0.0, *self.violations, 0.0)

    @property
    def feasible(self) -> bool:
        """Whether all limits hold."""
        return self.excess <= FEASIBLE


class Evaluate(Protocol):
    """What makes designs: their outcomes in order, from any thread."""

    def __call__(self, points: Sequence[Point], origin: str) -> list[Outcome]:
        """Make designs; ``origin`` says in the table what asked for them."""
        ...


def search(study: StudyFile, evaluate: Evaluate) -> None:
    """Have all designs of a study made, by its method."""
    _METHODS[study.method](study, evaluate)


def _grid(study: StudyFile, evaluate: Evaluate) -> None:
    shares = [[(k + 0.5) / len(v.levels) if v.low is None else k / max(1, len(v.levels) - 1)
               for k in range(len(v.levels))] for v in study.variables]  # fmt: skip
    evaluate(list(itertools.product(*shares)), "grid")


def _latin_hypercube(study: StudyFile, evaluate: Evaluate) -> None:
    from scipy.stats import qmc

    sample = qmc.LatinHypercube(len(study.variables), rng=np.random.default_rng(study.seed)).random(study.designs)
    evaluate(_points(sample), "Latin hypercube")


def _sobol(study: StudyFile, evaluate: Evaluate) -> None:
    evaluate(_sobol_points(study, study.designs), "Sobol")


def _sobol_points(study: StudyFile, count: int) -> list[Point]:
    from scipy.stats import qmc

    points = qmc.Sobol(len(study.variables), rng=np.random.default_rng(study.seed))
    return _points(points.random_base2(max(0, math.ceil(math.log2(count))))[:count])


def _points(sample: np.ndarray) -> list[Point]:
    return [tuple(map(float, row)) for row in sample]


def _optimum(study: StudyFile, evaluate: Evaluate) -> None:
    """Sobol's points, then local searches from the best of them, what has no range being held."""
    moved = [k for k, v in enumerate(study.variables) if v.low is not None]
    few = max(2, round(GLOBAL * study.designs)) if moved else study.designs
    points = _sobol_points(study, few)
    outcomes = evaluate(points, "Sobol")
    starts = _starts(points, outcomes, study.variables)
    left = (study.designs - few) // max(1, len(starts))
    least = 2 * len(moved) + 3  # designs of a local search's first model
    if not moved or not starts or left < least:
        return
    finite = [outcome.objectives[0] for outcome in outcomes if outcome.objectives]
    scale = float(np.median(np.abs(finite))) or 1.0
    with ThreadPoolExecutor(len(starts)) as pool:
        searches = [
            pool.submit(_refine, points[k], moved, scale, left, _single(evaluate, f"local search {n}"))
            for n, k in enumerate(starts, 1)
        ]
        for each in searches:
            each.result()


def _single(evaluate: Evaluate, origin: str) -> Callable[[Point], Outcome]:
    return lambda point: evaluate([point], origin)[0]


def _starts(points: list[Point], outcomes: list[Outcome], variables: Sequence[Variable]) -> list[int]:
    """The best points that are not near one another; other values of a choice are never near."""

    def rank(k: int) -> tuple[float, float]:
        excess = outcomes[k].excess if not outcomes[k].feasible else 0.0
        return excess, (outcomes[k].objectives or (math.inf,))[0]

    def apart(i: int, k: int) -> bool:
        other = any(
            v.low is None and v.at(a) != v.at(b) for v, a, b in zip(variables, points[i], points[k], strict=True)
        )
        return other or max(abs(a - b) for a, b in zip(points[i], points[k], strict=True)) > APART

    chosen: list[int] = []
    for k in sorted((k for k, outcome in enumerate(outcomes) if outcome.objectives), key=rank):
        if len(chosen) < STARTS and all(apart(k, i) for i in chosen):
            chosen.append(k)
    return chosen


def _refine(start: Point, moved: list[int], scale: float, most: int, made: Callable[[Point], Outcome]) -> None:
    """Search around a point; ``most``: designs."""
    from scipy.optimize import Bounds, NonlinearConstraint, minimize

    def outcome(x: np.ndarray) -> Outcome:
        point = list(start)
        for k, value in zip(moved, np.clip(x, 0.0, 1.0), strict=True):
            point[k] = float(value)
        return made(tuple(point))

    def objective(x: np.ndarray) -> float:
        found = outcome(x).objectives
        return math.nan if found is None else found[0] / scale

    limits = len(made(start).violations)

    def violations(x: np.ndarray) -> list[float]:
        found = outcome(x)
        return [math.nan] * limits if found.objectives is None else list(found.violations)

    constraints: list[Any] = [NonlinearConstraint(violations, -math.inf, 0.0)] if limits else []
    options = {
        "maxfev": most,
        "initial_tr_radius": FIRST_STEP,
        "final_tr_radius": LAST_STEP,
        "feasibility_tol": FEASIBLE,
    }
    begin = np.array([start[k] for k in moved])
    bounds = Bounds(0.0, 1.0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a start at a bound, designs that failed
        minimize(objective, begin, method="COBYQA", bounds=bounds, constraints=constraints, options=options)


def _pareto(study: StudyFile, evaluate: Evaluate) -> None:
    """NSGA-II, its first generation Sobol's points; failed designs have no place in a generation."""
    import optuna

    optuna.logging.set_verbosity(optuna.logging.WARNING)
    size = min(max(study.designs // 10, POPULATION[0]), POPULATION[1], study.designs)
    kinds: dict[str, Any] = {
        v.name: optuna.distributions.FloatDistribution(0.0, 1.0)
        if v.low is not None
        else optuna.distributions.IntDistribution(0, len(v.levels) - 1)
        for v in study.variables
    }
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)  # since 2022
        crossover = optuna.samplers.nsgaii.SBXCrossover()
    sampler = optuna.samplers.NSGAIISampler(population_size=size, crossover=crossover, seed=study.seed)
    least: Any = ["minimize"] * len(study.goals)
    asked = optuna.create_study(directions=least, sampler=sampler)
    for point in _sobol_points(study, size):
        asked.enqueue_trial(
            {v.name: share if v.low is not None else min(int(share * len(v.levels)), len(v.levels) - 1)
             for v, share in zip(study.variables, point, strict=True)}
        )  # fmt: skip
    for generation, begin in enumerate(range(0, study.designs, size), 1):
        trials = [asked.ask(kinds) for _ in range(min(size, study.designs - begin))]
        points = [
            tuple(
                t.params[v.name] if v.low is not None else (t.params[v.name] + 0.5) / len(v.levels)
                for v in study.variables
            )
            for t in trials
        ]
        for trial, outcome in zip(trials, evaluate(points, f"generation {generation}"), strict=True):
            if outcome.objectives is None:
                asked.tell(trial, state=optuna.trial.TrialState.FAIL)
            else:
                for limit, violation in zip(study.limits, outcome.violations, strict=True):
                    trial.set_constraint(limit.text, violation - FEASIBLE)
                asked.tell(trial, list(outcome.objectives))


_METHODS: dict[str, Callable[[StudyFile, Evaluate], None]] = {
    "grid": _grid,
    "latin-hypercube": _latin_hypercube,
    "sobol": _sobol,
    "optimum": _optimum,
    "pareto": _pareto,
}


def front(outcomes: Sequence[Outcome]) -> list[bool]:
    """Whether each design is feasible and no other feasible one is as good in all objectives and better in one."""
    some = [k for k, outcome in enumerate(outcomes) if outcome.feasible and outcome.objectives]
    values = np.array([outcomes[k].objectives for k in some], dtype=float)
    best = [False] * len(outcomes)
    for row, k in enumerate(some):
        better = (values <= values[row]).all(axis=1) & (values < values[row]).any(axis=1)
        best[k] = not better.any()
    return best
