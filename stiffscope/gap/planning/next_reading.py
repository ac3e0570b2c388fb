"""The next reading: what would distinguish the causes that a campaign's readings do not."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.errors import InputError
from stiffscope.gap.campaign.writing import describe_sensor
from stiffscope.gap.forward.forward_model import Trial
from stiffscope.gap.forward.robot_model import RobotModel
from stiffscope.gap.inference.settings import GROUPS
from stiffscope.gap.planning.candidates import offer_readings, plan_campaign
from stiffscope.gap.planning.experiment_design import next_measurement

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from stiffscope.gap.campaign.campaign import Campaign
    from stiffscope.gap.inference.diagnosis import Effect, NextMeasurement
    from stiffscope.gap.inference.findings import Findings
    from stiffscope.gap.inference.hypothesis import Hypothesis

_RIVALS = 4  # most hypotheses, and most twins, that a further reading is to separate from the best


def find_next(
    findings: Findings, effects: Sequence[Effect], *, is_open: bool = False
) -> tuple[NextMeasurement | None, str]:
    """Return the next measurement, and where none distinguishes the causes of a group, why.

    The loads and instruments of the campaign come first, at any pose. Those that a plan offers (gauges on
    other bodies, hooks) are tried for a group.

    Parameters
    ----------
    findings, effects
        Result of a search, and the effects named.
    is_open
        Whether the verdict itself is open; otherwise there is a group if effects are confused.
    """
    best = findings.best
    limit = GROUPS.competing * findings.probability[0]
    rivals = [h for h, p in findings.ranked if h is not best and p >= limit][:_RIVALS]
    rivals += [
        twin for twin, _ in zip(_exchange_twins(best), range(_RIVALS), strict=False)
    ]
    rivals.sort(key=lambda h: best.names <= h.names)  # extensions last
    step = (
        next_measurement(findings.model.trial(findings.sigma), best, rivals)
        if rivals
        else None
    )
    if step or not (is_open or any(effect.confused_with for effect in effects)):
        return step, ""
    aliases = {name for c in best.candidates for name in c.aliases}
    if not is_open and all(
        aliases.issuperset(effect.confused_with) for effect in effects
    ):
        named = (e for e in effects if e.confused_with)
        same = dict.fromkeys(
            word
            for e in named
            for word in (f"{e.effect} @ {e.place}", *e.confused_with)
        )
        return (
            None,
            f"no reading distinguishes {' and '.join(same)}: names of the same change",
        )
    none = "none of this campaign's instruments and loads is expected to distinguish them at any pose"
    if not rivals or not isinstance(findings.model, RobotModel):
        return None, none if rivals else ""
    nominal = findings.model.nominal
    try:
        campaign = replace(
            plan_campaign(nominal, offer_readings(nominal)),
            modelled=findings.campaign.modelled,
        )
        trial = Trial(
            replace(findings.model, campaign=campaign),
            campaign.sigma,
            np.arange(len(campaign)),
        )
        step = next_measurement(trial, best, rivals)
    except InputError:  # e.g. effects too large for a planned pose
        return None, none
    if step is None:
        bodies = dict.fromkeys(sensor.body for sensor in campaign.sensors)
        return None, f"{none}, nor are gauges on {', '.join(bodies)}"
    return replace(step, new=_describe_new(campaign, step)), ""


def _describe_new(
    campaign: Campaign, step: NextMeasurement
) -> dict[str, dict[str, Any]]:
    """Return the sensors and the load point of a reading as sections of campaign.toml, by name."""
    sensors = (s for s in campaign.sensors if s.name in (step.sensors or ()))
    loads = (hook for hook in campaign.loads if hook.name == step.load)
    return {
        s.name: describe_sensor(s.measures, s.body, s.at, s.direction) for s in sensors
    } | {hook.name: {"body": hook.body, "at": list(hook.at)} for hook in loads}


def _exchange_twins(best: Hypothesis) -> Iterator[Hypothesis]:
    """Yield the hypothesis with each effect replaced by each of its twins, of the same readings."""
    for k, (candidate, values) in enumerate(best.parameters):
        for twin, rate in candidate.twins:
            scales = np.where(best.mark(lambda c, own=candidate: c is own), rate, 1.0)
            spread = best.covariance * np.outer(scales, scales)
            known = replace(best.known, find_covariance=lambda spread=spread: spread)
            signature = (twin, (rate * values[0],))
            yield replace(
                best,
                parameters=(*best.parameters[:k], signature, *best.parameters[k + 1 :]),
                known=known,
            )
