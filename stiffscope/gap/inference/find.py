"""The search for effects, repeated where what it found shows more to doubt."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from stiffscope.gap.inference.findings import search_once
from stiffscope.gap.inference.lack_of_fit import lack_of_fit
from stiffscope.gap.inference.settings import SEARCH
from stiffscope.runtime.threads import in_one_thread

if TYPE_CHECKING:
    from stiffscope.gap.forward.forward_model import Candidate, ForwardModel
    from stiffscope.gap.inference.findings import Findings
    from stiffscope.gap.inference.hypothesis import Hypothesis
    from stiffscope.runtime.types import Array, Progress


@in_one_thread
def find(model: ForwardModel, progress: Progress | None = None) -> Findings:
    """Search for the effects and nuisance patterns that explain a model's campaign.

    Faults of instruments that show only beside what was found are searched for once more, and
    all effects at the equilibria reached where the second order is as large as a rest or an effect.
    """
    found = _find_with_doubts(model, progress)
    part = _least_explained(found)
    if part is None:
        return found
    exact = found.model.find_equilibria(found.best.parameters, part)
    if exact is None:
        return found
    return max(found, _find_with_doubts(exact, progress), key=_weigh)


def _least_explained(found: Findings) -> Array | None:
    """Return the part (n,) of the readings, in their units, that the second order may explain as well.

    A share of what is left, or the contribution of the slightest effect; None without either.
    """
    noise = found.problem.noise.sigma
    known = found.fit_effects(found.best.words)
    if lack_of_fit(found, known):
        # beside a discrepancy much is left
        closest = min(found.hypotheses, key=found.chi2)
        rest = np.where(found.used_readings, closest.residual, 0.0)
        return SEARCH.comparable * rest * noise
    best = found.best
    # effects without parameters are there or not, and never slight
    with_sizes = (effect for effect in best.words if effect.scale)
    contributions = [_contribution(best, effect) for effect in with_sizes]
    if not contributions:
        return None
    slightest = min(contributions, key=lambda change: float(np.linalg.norm(change)))
    return np.where(found.used_readings, slightest, 0.0) * noise


def _contribution(hypothesis: Hypothesis, effect: Candidate) -> Array:
    """Return what an effect of a set changes in the readings (n,), over the noise, to first order."""
    own = hypothesis.mark(lambda c: c is effect)
    return hypothesis.slopes[:, own] @ hypothesis.values[own]


def _find_with_doubts(model: ForwardModel, progress: Progress | None) -> Findings:
    found = search_once(model, progress)
    again = model.doubt_again(found.best.parameters)
    if again is None:
        return found
    other = search_once(again, progress)
    return max(found, other, key=lambda each: each.best.evidence - each.none.evidence)


def _weigh(found: Findings) -> float:
    """Return the ln evidence of a search's best set, with the volume of its noise."""
    noise = found.problem.noise
    return found.best.evidence - float(np.log(noise.sigma[noise.used]).sum())
