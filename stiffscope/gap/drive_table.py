"""The resulting stiffness of every drive, with everything that was found."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from stiffscope.errors import InputError
from stiffscope.gap.effects.drives import ActuatorStiffness
from stiffscope.gap.effects.elements import along_drive
from stiffscope.gap.forward.joint_model import JointModel
from stiffscope.gap.forward.robot_model import RobotModel
from stiffscope.gap.inference.diagnosis import DriveStiffness

if TYPE_CHECKING:
    from stiffscope.gap.effects.effect import Array
    from stiffscope.gap.inference.findings import Findings
    from stiffscope.gap.inference.hypothesis import Hypothesis

_SEEN = 0.5  # relative standard uncertainty of a compliance below which a drive is seen
_STEP = 1e-6  # of an internal parameter


def list_drives(
    findings: Findings, joint: Hypothesis, left: float
) -> dict[str, DriveStiffness]:
    """Return each drive's stiffness with the effects of a hypothesis, by joint.

    Compliances add: a drive that is softened by itself and by its set has both.

    Parameters
    ----------
    findings
        The search; empty without a robot.
    joint
        Hypothesis that was fitted.
    left
        Factor on covariances, as of the reported parameters.
    """
    model = findings.model
    if not isinstance(model, RobotModel | JointModel):
        return {}
    out: dict[str, DriveStiffness] = {}
    spreads = _find_spreads(findings, model, joint)
    for name, drive in model.nominal.driven.items():
        law = drive.drive
        if law is None or not np.isfinite(law.stiffness) or law.stiffness <= 0.0:
            continue
        stated = float(law.stiffness)
        growth, slopes = _find_growth(joint, name, stated, along_drive(drive))
        alone = spreads.get(name, float("inf"))
        if alone > _SEEN * (1.0 + growth):
            out[name] = DriveStiffness(stated, stated, float("nan"), seen=False)
            continue
        spread = alone
        if slopes.any():
            spread = float(np.sqrt(max(slopes @ joint.covariance @ slopes, 0.0)))
        value = stated / (1.0 + growth)
        sigma = np.sqrt(left) * value * spread / (1.0 + growth)
        if sigma > _SEEN * value:
            out[name] = DriveStiffness(stated, stated, float("nan"), seen=False)
            continue
        out[name] = DriveStiffness(stated, value, float(sigma), seen=True)
    return out


def _find_growth(
    joint: Hypothesis,
    name: str,
    stated: float,
    axis: Array,
) -> tuple[float, Array]:
    """Return the relative growth of a drive's compliance, and derivatives (k,) by all parameters."""
    growth = 0.0
    slopes: list[Array] = []
    for candidate, given in joint.parameters:
        values = np.array(given)
        own = np.zeros(len(values))
        softens = candidate.effect == ActuatorStiffness.word
        if softens and name in candidate.members:

            def grow(u: Array, act=candidate.action) -> float:
                change = act.influence(u).elements[name].compliance
                return stated * float(axis @ change @ axis)

            growth += grow(values)
            steps = _STEP * np.eye(len(values))
            own[:] = [
                (grow(values + step) - grow(values - step)) / (2.0 * _STEP)
                for step in steps
            ]
        slopes.append(own)
    return growth, np.concatenate([np.zeros(0), *slopes])


def _find_spreads(
    findings: Findings, model: RobotModel | JointModel, joint: Hypothesis
) -> dict[str, float]:
    """Return the standard uncertainty of each drive's relative compliance, all of them free."""
    known = ActuatorStiffness.candidates(model.setting)
    singles = [c for c in known if len(c.members) == len(c.scale) == 1]
    try:
        prediction = model.predict(joint.parameters)
    except InputError:
        return {}
    used = findings.used_readings
    columns = [prediction.columns(c)[:, 0] / findings.sigma for c in singles]
    others = joint.mark(lambda c: c.effect != ActuatorStiffness.word)
    beside = findings.slopes(joint)[:, others] * joint.known.scales[others]
    whole = np.column_stack([np.zeros((len(used), 0)), *columns, beside])[used]
    covariance = np.linalg.inv(whole.T @ whole + np.eye(whole.shape[1]))
    spreads = np.sqrt(np.diagonal(covariance))
    return {c.members[0]: float(s) for c, s in zip(singles, spreads, strict=False)}
