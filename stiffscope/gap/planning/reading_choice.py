"""Smallest set of readings that distinguishes causes: T-optimum design for many pairs of causes.

The first of two causes is true, with one parameter ``s``. The ln-odds against the second are
``½ s² (|x|² - xᵀ Y (ρ + Yᵀ Y)⁻¹ Yᵀ x)``, with derivatives x and Y over the noise. A further reading
adds ``½ s² e² / (1 + yᵀ (ρ + Yᵀ Y)⁻¹ y)``, with the second's residual e (recursive least squares).

References
----------
Atkinson and Fedorov, Experiments for discriminating between two rival models, Biometrika 62 (1975).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stiffscope.runtime.types import Array, Indices

_LOOSE = 0.01  # prior precision of a rival's parameters in their own units
_WORST = 100  # most pairs added at once, the worst first
_LEAST_GAIN = 1e-9  # least ln-odds gained by a further reading for any pair
_NEW_SETTING = (
    2.0,
    1.0,
    1.0,
)  # effort of a new posture, load or instrument; a reading's is 1


@dataclass
class Pair:
    """A cause with one of its parameters, and a rival that may imitate it."""

    first: str
    second: str
    parameter: str
    own: Array
    """Change (n,) of all available readings by a fault of usual size, in standard deviations."""
    rival: Array
    """Derivatives (n, k) by the rival's parameters in their own units; (n, 0) for no cause."""
    log_odds: float = 0.0
    """Expected ln-odds by the readings chosen so far."""
    _inverse: Array = field(init=False)
    _pull: Array = field(init=False)

    def __post_init__(self) -> None:
        """Start without readings."""
        self.take(())

    def take(self, rows: Sequence[int]) -> None:
        """Use only these readings."""
        count = self.rival.shape[1]
        self._inverse, self._pull, self.log_odds = (
            np.eye(count) / _LOOSE,
            np.zeros(count),
            0.0,
        )
        for row in rows:
            self.add(row)

    def find_gains(self, rows: slice = slice(None)) -> Array:
        """Return the gain of each reading (n,), or of some of them."""
        variance = self.own[rows]
        rival = self.rival[rows]
        left = variance - rival @ (self._inverse @ self._pull)
        return (
            0.5
            * left**2
            / (1.0 + np.einsum("ni,ij,nj->n", rival, self._inverse, rival))
        )

    def add(self, row: int) -> None:
        """Add a reading."""
        self.log_odds += float(self.find_gains(slice(row, row + 1))[0])
        y = self._inverse @ self.rival[row]
        self._inverse = self._inverse - np.outer(y, y) / (1.0 + self.rival[row] @ y)
        self._pull = self._pull + self.own[row] * self.rival[row]


def judge_pairs(pairs: Sequence[Pair], rows: Sequence[int]) -> Array:
    """Return expected ln-odds (p,) of pairs by some readings, vectorized over pairs of a rival."""
    out = np.zeros(len(pairs))
    chosen = np.array(rows, dtype=np.int64)
    together: dict[int, list[int]] = {}
    for number, pair in enumerate(pairs):
        together.setdefault(id(pair.rival), []).append(number)
    for numbers in together.values():
        x = np.stack([pairs[k].own[chosen] for k in numbers], axis=1)
        y = pairs[numbers[0]].rival[chosen]
        pull = y.T @ x
        gram = y.T @ y + _LOOSE * np.eye(y.shape[1])
        followed = np.sum(pull * np.linalg.solve(gram, pull), axis=0)
        out[numbers] = 0.5 * (np.sum(x**2, axis=0) - followed)
    return out


def choose_readings(
    pairs: list[Pair], settings: Indices, enough: float, least: int = 0
) -> list[int]:
    """Choose readings until every pair has enough ln-odds, then drop unnecessary ones.

    Parameters
    ----------
    pairs
        Pairs that the available readings can distinguish; their `log_odds` are updated.
    settings
        Posture, load and instrument (n, 3) of each reading; those already set up cost less.
    enough
        Required ln-odds of every pair.
    least
        Least number of readings.

    Returns
    -------
    list of int
        Rows, in order.
    """
    chosen: list[int] = []
    active: list[
        Pair
    ] = []  # few of many pairs determine the choice; the others are only checked
    while pairs and len(chosen) < len(settings):
        short = [pair for pair in active if pair.log_odds < enough]
        if not short:
            odds = judge_pairs(pairs, chosen)
            worst: list[int] = np.argsort(odds, kind="stable")[:_WORST].tolist()
            short = [pairs[k] for k in worst if odds[k] < enough - _LEAST_GAIN]
            for pair in short:
                pair.take(chosen)
            active += short
        if not short and len(chosen) >= least:
            break
        wanted = [(p, enough - p.log_odds) for p in short] or [
            (p, enough) for p in active
        ]
        gains = (np.minimum(pair.find_gains(), most) for pair, most in wanted)
        worth = sum(gains, np.zeros(len(settings))) / _count_effort(settings, chosen)
        worth[chosen] = -np.inf
        best = int(np.argmax(worth))
        if not worth[best] > _LEAST_GAIN:
            break
        chosen.append(best)
        for pair in active:
            pair.add(best)
    return _drop([active, pairs], chosen, enough, least)


def _count_effort(settings: Indices, chosen: Sequence[int]) -> Array:
    """Return the effort (n,) of each reading, given those chosen."""
    out = np.ones(len(settings))
    for column, price in enumerate(_NEW_SETTING):
        out += price * ~np.isin(settings[:, column], settings[list(chosen), column])
    return out


def _drop(
    judges: list[list[Pair]], chosen: list[int], enough: float, least: int
) -> list[int]:
    """Drop readings that no pair needs, in order of choice; judges: few pairs, then all."""
    remaining = list(chosen)
    needed = [
        (p, np.minimum(judge_pairs(p, remaining), enough) - _LEAST_GAIN) for p in judges
    ]
    for row in chosen:
        rest = [other for other in remaining if other != row]
        if len(remaining) > least and all(
            (judge_pairs(p, rest) >= odds).all() for p, odds in needed
        ):
            remaining = rest
    for pair, odds in zip(judges[-1], judge_pairs(judges[-1], remaining), strict=True):
        pair.log_odds = float(odds)
    return sorted(remaining)
