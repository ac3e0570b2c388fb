"""Where the gap lies, by direction, pose and component, and which effects look alike in these readings."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

import numpy as np
from scipy.optimize import nnls  # pyright: ignore[reportMissingTypeStubs, reportUnknownVariableType]

from stiffscope.gap.diagnosis import Where
from stiffscope.gap.residuals import by_direction, by_pose

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from stiffscope.gap.findings import Findings
    from stiffscope.gap.forward_model import Candidate

    Array = NDArray[np.floating[Any]]

_SHOWN = 1e-3  # least share of a component


def located(found: Findings) -> Where:
    """Where the nominal model's residuals lie, and where the best hypothesis leaves them."""
    c = found.campaign
    before, after = (np.where(found.used, found.residual(h), 0.0) for h in (found.none, found.best))
    return Where(by_direction(c, before), component_shares(found), c.pose_names, by_pose(c, before), by_pose(c, after))


def component_shares(found: Findings) -> dict[str, float]:
    """Each component's share of the gap.

    The residuals are approximated by the non-negative combination of what each component alone would explain of them.
    """
    prediction = found.model.predict()
    r = found.residual(found.none)[found.used]
    parts: dict[str, Array] = {}
    for candidate in found.model.library:
        if not candidate.component:
            continue
        x = (prediction.columns(candidate) / found.sigma[:, None])[found.used] * np.array(candidate.scale)
        gram = x.T @ x
        ridge = np.eye(len(gram)) * (1e-9 * float(np.trace(gram)) + 1e-12)
        part = x @ np.linalg.solve(gram + ridge, x.T @ r)
        known = parts.get(candidate.component)
        if known is None or part @ part > known @ known:
            parts[candidate.component] = part
    if not parts:
        return {}
    mix = cast("Array", nnls(np.stack(list(parts.values()), axis=1), r)[0])
    gains = {name: float(m * (part @ part)) for (name, part), m in zip(parts.items(), mix, strict=True)}
    total = sum(gains.values())
    return {name: gain / total for name, gain in gains.items() if gain > _SHOWN * total} if total > 0.0 else {}


def signature_correlation(found: Findings) -> tuple[tuple[str, ...], tuple[tuple[float, ...], ...]]:
    """|cosine| between the signatures of single-parameter effects in these readings; 1: indistinguishable."""
    singles: list[Candidate] = [c for c in found.model.library if len(c.scale) == 1 and not c.unnamed]
    if not singles:
        return (), ()
    prediction = found.model.predict()
    x = np.hstack([prediction.columns(c) for c in singles]) / found.sigma[:, None]
    size = np.linalg.norm(x, axis=0)
    x = x / np.where(size > 0.0, size, 1.0)
    return tuple(c.name for c in singles), tuple(tuple(row) for row in np.abs(x.T @ x).tolist())
