"""Whether stated probabilities are what they say: a reliability table over answers whose truth is known."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

TENTHS = 10


@dataclass(frozen=True)
class ReliabilityRow:
    """Effects whose stated probability lies in one tenth."""

    low: float
    high: float
    count: int
    stated: float
    """Mean of the stated probabilities."""
    there: float
    """Share of the effects that were at work."""
    error: float
    """Standard error of that share, if the stated probabilities are right."""

    @property
    def off(self) -> float:
        """Distance between stated and found, in points of a hundred."""
        return 100.0 * abs(self.stated - self.there)


def statements(diagnosis: Mapping[str, Any], truth: Iterable[str]) -> list[tuple[float, bool]]:
    """Every probability that a diagnosis.json states of an effect, and whether that is true.

    An effect with a group states the group's probability: that it or one of those it is confused with is at work.

    Parameters
    ----------
    diagnosis
        The content of a diagnosis.json.
    truth
        Effects at work, as `effect @ place`.

    """
    true = set(truth)
    out: list[tuple[float, bool]] = []
    for effect in diagnosis["effects"]:
        group = {f"{effect['effect']} @ {effect['place']}", *effect["confused_with"]}
        stated = effect["group_probability"] if effect["confused_with"] else effect["probability"]
        out.append((float(stated), bool(group & true)))
    possible = diagnosis.get("possible", [])
    return out + [(float(p["probability"]), f"{p['effect']} @ {p['place']}" in true) for p in possible]


def reliability(stated: Iterable[tuple[float, bool]]) -> tuple[ReliabilityRow, ...]:
    """Table of stated probabilities against what was there, by tenths; empty tenths are left out."""
    pairs = np.array([(p, float(there)) for p, there in stated]).reshape(-1, 2)
    tenth = np.minimum((pairs[:, 0] * TENTHS).astype(np.int64), TENTHS - 1)
    rows: list[ReliabilityRow] = []
    for k in np.unique(tenth):
        p, there = pairs[tenth == k].T
        error = float(np.sqrt(np.sum(p * (1.0 - p)))) / len(p)
        rows.append(ReliabilityRow(k / TENTHS, (k + 1) / TENTHS, len(p), float(p.mean()), float(there.mean()), error))
    return tuple(rows)
