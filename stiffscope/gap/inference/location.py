"""Location of the gap by direction, pose and component, and correlation of signatures."""

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
    """Locate residuals of the nominal model and of a hypothesis; ``beyond``: above the noise."""
    c = found.campaign
    used = found.used_readings
    before, after = (
        np.where(used, found.residual(h), 0.0) for h in (found.none, reported)
    )
    return Where(
        direction=by_direction(c, before),
        component=component_shares(found, reported),
        pose_names=c.pose_names,
        rows=c.find_pose_rows(),
        pose=by_pose(c, before),
        unexplained=by_pose(c, after),
        left=by_direction(c, after) if beyond else {},
        sensor=by_sensor(c, before),
        left_by_sensor=by_sensor(c, after) if beyond else {},
    )


def component_shares(found: Findings, reported: Hypothesis) -> dict[str, float]:
    """Return each component's share of the gap.

    The residuals are approximated by a non-negative combination of the best fits of each component: of those
    that a hypothesis reports first, as others may have the same signature.
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
    gains: dict[str, float] = {}
    named = {c.component for c in reported.candidates} & parts.keys()
    for names in filter(None, (named, parts.keys() - named)):
        group = {name: part for name, part in parts.items() if name in names}
        columns = np.stack(list(group.values()), axis=1)
        mix = cast("Array", nnls(columns, r)[0])
        gains |= zip(group, (mix * np.sum(columns**2, axis=0)).tolist(), strict=True)
        r = r - columns @ mix
    total = sum(gains.values())
    return {name: gain / total for name, gain in gains.items() if gain > _SHOWN * total}


def signature_correlation(
    found: Findings,
) -> tuple[tuple[str, ...], tuple[tuple[float, ...], ...]]:
    """Return effects of one parameter and their signature correlation (1: indistinguishable)."""
    known = ((c, x) for c, x in _nominal_columns(found) if not c.is_nuisance)
    singles = [(c, x) for c, x in known if len(c.scale) == 1]
    if not singles:
        return (), ()
    x = np.hstack([columns for _, columns in singles])
    size = np.linalg.norm(x, axis=0)
    x = x / np.where(size > 0.0, size, 1.0)
    return tuple(c.name for c, _ in singles), tuple(
        tuple(row) for row in np.abs(x.T @ x).tolist()
    )


def _nominal_columns(found: Findings) -> Iterator[tuple[Candidate, Array]]:
    """Yield each effect with parameters and its nominal derivatives (n, k) over sigma."""
    library = found.problem.nominal
    whitening = (found.problem.noise.sigma / found.sigma)[:, None]
    for candidate, here in zip(library.candidates, library.columns, strict=True):
        if candidate.scale:
            yield candidate, library.values[:, here] * whitening
