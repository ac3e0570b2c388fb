"""Where the gap lies, by direction, pose and component, and which effects look alike in these readings."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import numpy as np
from scipy.optimize import nnls  # pyright: ignore[reportMissingTypeStubs, reportUnknownVariableType]

from stiffscope.gap.inference.diagnosis import Where
from stiffscope.gap.inference.residuals import by_direction, by_pose, by_sensor

if TYPE_CHECKING:
    from collections.abc import Iterator

    from stiffscope.gap.forward.forward_model import Candidate
    from stiffscope.gap.inference.findings import Findings
    from stiffscope.gap.inference.hypothesis import Hypothesis
    from stiffscope.runtime.types import Array


_SHOWN = 1e-3  # least share of a component


def locate_residuals(found: Findings, reported: Hypothesis, *, beyond: bool) -> Where:
    """Where the nominal model's residuals lie, and where a hypothesis leaves them; ``beyond`` the noise or not."""
    c = found.campaign
    before, after = (np.where(found.used_readings, found.residual(h), 0.0) for h in (found.none, reported))
    return Where(
        by_direction(c, before),
        component_shares(found),
        c.pose_names,
        by_pose(c, before),
        by_pose(c, after),
        by_direction(c, after) if beyond else {},
        by_sensor(c, before),
        by_sensor(c, after) if beyond else {},
    )


def component_shares(found: Findings) -> dict[str, float]:
    """Each component's share of the gap.

    The residuals are approximated by the non-negative combination of what each component alone would explain of them.
    """
    r = found.residual(found.none)[found.used_readings]
    parts: dict[str, Array] = {}
    for candidate, columns in _nominal_columns(found):
        if not candidate.component:
            continue
        x = columns[found.used_readings] * np.array(candidate.scale)
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
    singles = [(c, x) for c, x in _nominal_columns(found) if len(c.scale) == 1 and not c.is_nuisance]
    if not singles:
        return (), ()
    x = np.hstack([columns for _, columns in singles])
    size = np.linalg.norm(x, axis=0)
    x = x / np.where(size > 0.0, size, 1.0)
    return tuple(c.name for c, _ in singles), tuple(tuple(row) for row in np.abs(x.T @ x).tolist())


def _nominal_columns(found: Findings) -> Iterator[tuple[Candidate, Array]]:
    """Every effect that has parameters with its derivatives (n, k) of the nominal model, in standard deviations."""
    library = found.problem.nominal
    whitening = (found.problem.noise.sigma / found.sigma)[:, None]
    for candidate, here in zip(library.candidates, library.columns, strict=True):
        if candidate.scale:
            yield candidate, library.values[:, here] * whitening
