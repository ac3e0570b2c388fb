"""Effects that no reading distinguishes."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.effects.backlash import Backlash
from stiffscope.effects.link_stiffness import LinkStiffness
from stiffscope.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stiffscope.effects.effect import Candidate
    from stiffscope.gap.forward.robot_prediction import RobotPrediction
    from stiffscope.runtime.types import Array

_MODULUS = ".youngs_modulus"
_SAME = 1e-9  # 1 - |cosine| of signatures below which effects are indistinguishable
_ROUNDING = 1e-10  # relative to the largest reading
_OF_ONE_SIZE = 30.0  # largest ratio of the usual changes of readings by two twins


def _shows(columns: Array, candidate: Candidate, prediction: RobotPrediction) -> bool:
    """Return whether parameters of prior size would change any reading beyond rounding."""
    largest = float(np.abs(prediction.plain_readings).max(initial=0.0))
    return bool((np.abs(columns) * np.array(candidate.scale) > _ROUNDING * largest).any())


def _is_factor(candidate: Candidate, known: Sequence[Candidate]) -> bool:
    """Return whether a candidate is the modulus of a part that has a stiffness factor."""
    same = [c.members for c in known if c.effect == LinkStiffness.word]
    return candidate.place.endswith(_MODULUS) and candidate.members in same


def merge_twins(candidates: Sequence[Candidate], prediction: RobotPrediction) -> tuple[Candidate, ...]:
    """Merge candidates of one parameter with the same signature as twins of the first.

    Candidates whose usual changes differ strongly are not merged: a usual encoder offset may equal
    an implausible mass. Candidates that change no reading are dropped.
    """
    candidates = [c for c in candidates if not c.scale or _shows(prediction.columns(c), c, prediction)]
    singles = [k for k, c in enumerate(candidates) if len(c.scale) == 1 and c.effect != Backlash.word]
    columns = np.stack([prediction.columns(candidates[k])[:, 0] for k in singles], axis=1) if singles else None
    if columns is None:
        return tuple(candidates)
    if not np.isfinite(columns).all():
        raise InputError("the readings: expected finite derivatives by all effects at the nominal robot")
    weight = 1.0 / np.where(np.isnan(prediction.campaign.sigma), 1.0, prediction.campaign.sigma)
    columns = columns * weight[:, None]
    size = np.linalg.norm(columns, axis=0)
    unit = columns / np.where(size > 0.0, size, 1.0)
    cosine = unit.T @ unit
    usual = np.log(size.clip(min=1e-300)) + np.log([candidates[k].scale[0] for k in singles])
    out: dict[int, Candidate] = dict(enumerate(candidates))
    for i, k in enumerate(singles):
        if k not in out:
            continue
        for j in range(i + 1, len(singles)):
            other = candidates[singles[j]]
            same = cosine[i, j] if candidates[k].positive or other.positive else abs(cosine[i, j])
            if abs(usual[i] - usual[j]) > np.log(_OF_ONE_SIZE):
                continue
            if singles[j] in out and same > 1.0 - _SAME and candidates[k].positive == other.positive:
                if _is_factor(other, candidates):
                    out[k] = replace(out[k], aliases=(*out[k].aliases, other.name))
                else:
                    rate = float(np.copysign(size[i] / size[j], cosine[i, j]))
                    out[k] = replace(out[k], twins=(*out[k].twins, (other, rate)))
                del out[singles[j]]
    return tuple(out.values())
