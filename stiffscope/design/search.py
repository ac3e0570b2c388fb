"""Search methods of a study, which choose the next designs; reproducible by the seed.

A design is a point of the unit cube, one coordinate per variable. Methods request several at once
if possible, to keep workers busy. Global: Sobol, Latin hypercube, grid (SciPy), NSGA-II (Optuna).
Local: COBYQA (SciPy), a derivative-free trust-region method with constraints, from the best points.
"""

from __future__ import annotations

import itertools
import math
import warnings
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from itertools import repeat
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from stiffscope.design.outcomes import FEASIBLE
from stiffscope.errors import say_count

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from stiffscope.design.outcomes import Outcomes
    from stiffscope.design.study_file import StudyFile, Variable

STARTS = 2  # parallel local searches
GLOBAL = 0.4  # share of the designs sampled before the local searches
FIRST_STEP = 0.1
LAST_STEP = 1e-5  # trust-region radius over the ranges
APART = 0.2  # minimum distance between starts of local searches, over the ranges
POPULATION = (
    8,
    40,
)  # limits of the NSGA-II population, otherwise a tenth of the designs
BLOCK = 1024  # Sobol points drawn at once

Point = tuple[float, ...]


class Evaluate(Protocol):
    """Evaluates designs; callable from any thread."""

    def __call__(self, points: Iterable[Point], origin: str) -> Outcomes:
        """Return outcomes of lazily drawn points in order; the table lists their ``origin``."""
        ...

    def end(self) -> None:
        """Stop: start no more designs and cancel running ones."""
        ...


@dataclass(frozen=True)
class Ending:
    """End of a search: whether it converged (None if unknown), and a line on each of its parts."""

    converged: bool | None = None
    how: tuple[str, ...] = ()


def search(
    study: StudyFile, evaluate: Evaluate, part: tuple[int, int] = (1, 1)
) -> Ending:
    """Evaluate all designs of a study with its method; of a sweep only share i of n.

    Parameters
    ----------
    study, evaluate
        Study file, and what evaluates designs.
    part
        (i, n): share i of n of a sweep.
    """
    if study.method not in SWEEPS:
        return _SEARCHES[study.method](study, evaluate)
    origin, draw = SWEEPS[study.method]
    evaluate(itertools.islice(draw(study), part[0] - 1, None, part[1]), origin)
    return Ending()


def _draw_grid(study: StudyFile) -> Iterator[Point]:
    shares: list[list[float]] = []
    for v in study.variables:
        n = len(v.levels)
        middles = [(k + 0.5) / n for k in range(n)]
        shares.append(
            middles if v.low is None else [k / max(1, n - 1) for k in range(n)]
        )
    return itertools.product(*shares)


def _draw_hypercube(study: StudyFile) -> Iterator[Point]:
    from scipy.stats import qmc

    cube = qmc.LatinHypercube(
        len(study.variables), rng=np.random.default_rng(study.seed)
    )
    return map(tuple, cube.random(study.designs).tolist())


def _draw_sobol(study: StudyFile, count: int = 0) -> Iterator[Point]:
    from scipy.stats import qmc

    points = qmc.Sobol(len(study.variables), rng=np.random.default_rng(study.seed))
    left = count or study.designs
    while left > 0:
        block = points.random(min(BLOCK, 1 << max(0, math.ceil(math.log2(left)))))[
            :left
        ]
        yield from map(tuple, block.tolist())
        left -= len(block)


SWEEPS: dict[str, tuple[str, Callable[[StudyFile], Iterator[Point]]]] = {
    "grid": ("grid", _draw_grid),
    "latin-hypercube": ("Latin hypercube", _draw_hypercube),
    "sobol": ("Sobol", _draw_sobol),
}
"""Methods with independent designs: their name in the table, and the function for their points."""


def _find_optimum(study: StudyFile, evaluate: Evaluate) -> Ending:
    """Evaluate Sobol points, then search locally from the best; hold variables without a range."""
    moved = [k for k, v in enumerate(study.variables) if v.low is not None]
    few = max(2, round(GLOBAL * study.designs)) if moved else study.designs
    points = list(_draw_sobol(study, few))
    outcomes = evaluate(points, "Sobol")
    least = 2 * len(moved) + 3
    left = study.designs - few  # least: for the first model of a local search
    starts = _choose_starts(points, outcomes, study.variables)[: max(1, left // least)]
    left //= max(1, len(starts))
    if not moved or not starts:
        return Ending()
    if left < least:
        return Ending(
            False,
            (f"a local search takes at least {least} designs, and {left} were left",),
        )
    scale = float(np.nanmedian(np.abs(outcomes.objectives[:, 0]))) or 1.0

    def refine(number: int, k: int) -> tuple[tuple[float, float], bool, str]:
        name = f"local search {number}"
        make = partial(evaluate, origin=name)
        best, converged, count = _refine(
            points[k], moved, scale, left, lambda x: make([x])
        )
        how = "its steps were still larger"
        if converged:
            how = f"its steps fell below {LAST_STEP:g} of the ranges"
        return best, converged, f"{name}: {how} after {say_count(count, 'design')}"

    pool = ThreadPoolExecutor(len(starts))
    try:
        tasks = [pool.submit(refine, n, k) for n, k in enumerate(starts, 1)]
        ends = [task.result() for task in tasks]
    except BaseException:
        evaluate.end()
        raise
    finally:
        pool.shutdown()
    return Ending(min(ends)[1], tuple(how for *_, how in ends))


def _choose_starts(
    points: list[Point], outcomes: Outcomes, variables: Sequence[Variable]
) -> list[int]:
    """Return the best points far from each other; different choices always count as far."""

    def far(i: int, k: int) -> bool:
        pairs = list(zip(variables, points[i], points[k], strict=True))
        other = (
            v.find_level(a) != v.find_level(b) for v, a, b in pairs if v.low is None
        )
        return any(other) or max(abs(a - b) for _, a, b in pairs) > APART

    chosen: list[int] = []
    excess = np.where(outcomes.feasible, 0.0, outcomes.excess)
    for k in np.lexsort((outcomes.objectives[:, 0], excess)).tolist():
        if (
            len(chosen) < STARTS
            and not outcomes.failed[k]
            and all(far(k, i) for i in chosen)
        ):
            chosen.append(k)
    return chosen


def _refine(
    start: Point,
    moved: list[int],
    scale: float,
    most: int,
    make: Callable[[Point], Outcomes],
) -> tuple[tuple[float, float], bool, int]:
    """Search locally with ``most`` designs; return (excess, objective), converged and count."""
    from scipy.optimize import Bounds, NonlinearConstraint, minimize

    best = (math.inf, math.inf)

    def evaluate(x: np.ndarray) -> Outcomes:
        nonlocal best
        point = list(start)
        for k, value in zip(moved, np.clip(x, 0.0, 1.0), strict=True):
            point[k] = float(value)
        design = make(tuple(point))
        if not design.failed[0]:
            excess = 0.0 if design.feasible[0] else float(design.excess[0])
            best = min(best, (excess, float(design.objectives[0, 0])))
        return design

    begin = np.array([start[k] for k in moved])
    limits: Any = NonlinearConstraint(
        lambda x: evaluate(x).violations[0], -math.inf, 0.0
    )
    constraints = [limits] if evaluate(begin).violations.size else []
    options = {
        "maxfev": most,
        "initial_tr_radius": FIRST_STEP,
        "final_tr_radius": LAST_STEP,
        "feasibility_tol": FEASIBLE,
    }
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a start at a bound, designs that failed
        design = minimize(
            lambda x: evaluate(x).objectives[0, 0] / scale,
            begin,
            method="COBYQA",
            bounds=Bounds(0.0, 1.0),
            constraints=constraints,
            options=options,
        )
    return best, design.status == 0, int(design.nfev)


def _find_front(study: StudyFile, evaluate: Evaluate) -> Ending:
    """Run NSGA-II with Sobol points as first generation; failed designs are not selected."""
    import optuna

    optuna.logging.set_verbosity(optuna.logging.WARNING)
    size = min(max(study.designs // 10, POPULATION[0]), POPULATION[1], study.designs)
    kinds: dict[str, Any] = {}
    for v in study.variables:
        kinds[v.name] = optuna.distributions.FloatDistribution(0.0, 1.0)
        if v.low is None:
            kinds[v.name] = optuna.distributions.IntDistribution(0, len(v.levels) - 1)
    with warnings.catch_warnings():
        warnings.simplefilter(
            "ignore", optuna.exceptions.ExperimentalWarning
        )  # since 2022
        crossover = optuna.samplers.nsgaii.SBXCrossover()
    sampler = optuna.samplers.NSGAIISampler(
        population_size=size,
        crossover=crossover,
        seed=study.seed,
    )
    least: Any = list(repeat("minimize", len(study.goals)))
    asked = optuna.create_study(directions=least, sampler=sampler)
    for point in _draw_sobol(study, size):
        shares = zip(study.variables, point, strict=True)
        asked.enqueue_trial(
            {
                v.name: share if v.low is not None else v.find_level(share)
                for v, share in shares
            }
        )
    for generation, begin in enumerate(range(0, study.designs, size), 1):
        trials = [asked.ask(kinds) for _ in range(min(size, study.designs - begin))]
        points = [
            tuple(
                t.params[v.name]
                if v.low is not None
                else (t.params[v.name] + 0.5) / len(v.levels)
                for v in study.variables
            )
            for t in trials
        ]
        outcomes = evaluate(points, f"generation {generation}")
        for k, trial in enumerate(trials):
            if outcomes.failed[k]:
                asked.tell(trial, state=optuna.trial.TrialState.FAIL)
            else:
                violations = outcomes.violations[k].tolist()
                for limit, violation in zip(study.limits, violations, strict=True):
                    trial.set_constraint(limit.text, violation - FEASIBLE)
                asked.tell(trial, outcomes.objectives[k].tolist())
    return Ending()


_SEARCHES = {"optimum": _find_optimum, "pareto": _find_front}
