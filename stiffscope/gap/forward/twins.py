"""Effects that no reading distinguishes."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.errors import InputError
from stiffscope.gap.effects.links import LinkStiffness

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stiffscope.gap.effects.effect import Candidate
    from stiffscope.gap.forward.joint_prediction import JointPrediction
    from stiffscope.gap.forward.robot_prediction import RobotPrediction

    Predicted = RobotPrediction | JointPrediction

_MODULUS = ".youngs_modulus"
_SAME = 1e-9  # 1 - |cosine| of signatures below which effects are indistinguishable
_ROUNDING = 1e-10  # relative to the largest reading
_OF_SAG = 1e-3
"""Least change of what only weight shows, relative to the weight's own: below lie errors of
geometry times sag, which derivatives to first order do not carry."""
_OF_ONE_SIZE = 30.0  # largest ratio of the usual changes of readings by two twins


def _shows(candidate: Candidate, prediction: Predicted) -> bool:
    """Return whether parameters of prior size would change any reading beyond rounding."""
    largest = float(np.abs(prediction.plain_readings).max(initial=0.0))
    sizes = np.abs(prediction.columns(candidate)) * np.array(candidate.scale)
    return bool((sizes > _ROUNDING * largest).any())


def _is_factor(first: Candidate, other: Candidate) -> bool:
    """Return whether a modulus of a part is the factor on the stiffness of its bodies."""
    modulus = other.place.endswith(_MODULUS) and other.members == first.members
    return modulus and first.effect == LinkStiffness.word


def _is_shown_by_weight(
    candidate: Candidate, prediction: Predicted, heavy: Predicted
) -> bool:
    """Return whether parameters of prior size would change readings under weight."""
    weight = np.abs(heavy.plain_readings - prediction.plain_readings).max(initial=0.0)
    sizes = np.abs(heavy.columns(candidate)) * np.array(candidate.scale)
    return bool((sizes > _OF_SAG * float(weight)).any() and weight > 0.0)


def merge_twins(
    given: Sequence[Candidate], plain: Predicted, prediction: Predicted
) -> tuple[Candidate, ...]:
    """Merge candidates of one parameter with the same signature as twins of the first.

    Candidates whose usual changes differ strongly are not merged: a usual encoder offset may equal
    an implausible mass. Candidates that change no reading are dropped.

    Parameters
    ----------
    given
        Candidates.
    plain, prediction
        Predictions without what the model lacks, and with the robot's own weight.
    """
    candidates = [
        c
        for c in given
        if not c.scale or _shows(c, plain) or _is_shown_by_weight(c, plain, prediction)
    ]
    singles = [c for c in candidates if len(c.scale) == 1 and c.merges]
    if not singles:
        return tuple(candidates)
    columns = np.hstack([prediction.columns(c) for c in singles])
    if not np.isfinite(columns).all():
        raise InputError(
            "the readings: expected finite derivatives by all effects of the robot"
        )
    weight = 1.0 / np.where(
        np.isnan(prediction.campaign.sigma), 1.0, prediction.campaign.sigma
    )
    columns = columns * weight[:, None]
    size = np.linalg.norm(columns, axis=0)
    unit = columns / np.where(size > 0.0, size, 1.0)
    cosine = unit.T @ unit
    usual = np.log(size.clip(min=1e-300)) + np.log([c.scale[0] for c in singles])
    out = {id(c): c for c in candidates}
    pairs = sorted(
        combinations(enumerate(singles), 2),
        key=lambda pair: not _is_factor(pair[0][1], pair[1][1]),
    )
    for (i, first), (j, other) in pairs:
        same = cosine[i, j] if first.positive or other.positive else abs(cosine[i, j])
        sized = abs(usual[i] - usual[j]) <= np.log(_OF_ONE_SIZE)
        alike = sized and same > 1.0 - _SAME and first.positive == other.positive
        if alike and id(first) in out and id(other) in out:
            known = out[id(first)]
            twin = out.pop(id(other))
            if _is_factor(first, other):
                out[id(first)] = replace(known, aliases=(*known.aliases, other.name))
            else:
                rate = float(np.copysign(size[i] / size[j], cosine[i, j]))
                out[id(first)] = replace(known, twins=(*known.twins, (twin, rate)))
    return tuple(out.values())
