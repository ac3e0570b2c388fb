"""The search for effects, repeated where what it found shows more to doubt."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from stiffscope.gap.inference.findings import search_once
from stiffscope.gap.inference.lack_of_fit import lack_of_fit
from stiffscope.runtime.threads import in_one_thread

if TYPE_CHECKING:
    from stiffscope.gap.forward.forward_model import ForwardModel
    from stiffscope.gap.inference.findings import Findings
    from stiffscope.runtime.types import Progress


@in_one_thread
def find(model: ForwardModel, progress: Progress | None = None) -> Findings:
    """Search for the effects and nuisance patterns that explain a model's campaign.

    Faults of instruments that show only beside what was found are searched for once more, and
    all effects at the equilibria reached where first order leaves a rest of that size.
    """
    found = _find_with_doubts(model, progress)
    known = found.fit_effects(found.best.words)
    if not lack_of_fit(found, known):
        return found
    closest = min(found.hypotheses, key=found.chi2)  # beside a discrepancy much is left
    rest = np.where(found.used_readings, closest.residual, 0.0)
    rest = rest * found.problem.noise.sigma
    exact = found.model.find_equilibria(found.best.parameters, rest)
    if exact is None:
        return found
    return max(found, _find_with_doubts(exact, progress), key=_weigh)


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
