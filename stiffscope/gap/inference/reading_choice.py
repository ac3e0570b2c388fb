"""The fewest readings that tell causes apart: a T-optimum design for many pairs of causes at once.

Of two causes the first is true, with one parameter ``s``; what the second cannot follow of its readings is
``½ s² (|x|² - xᵀ Y (ρ + Yᵀ Y)⁻¹ Yᵀ x)`` in ln-odds, x and Y their derivatives over the noise. A further reading adds
``½ s² e² / (1 + yᵀ (ρ + Yᵀ Y)⁻¹ y)``, e what the second's best parameters leave of it (recursive least squares).

References
----------
Atkinson and Fedorov, The design of experiments for discriminating between two rival models, Biometrika 62 (1975) 57-70.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stiffscope.runtime.types import Array, Indices

_LOOSE = 0.01  # precision of a rival's parameters, in units of their own: ten units are nothing unusual
_LEAST_GAIN = 1e-9  # ln-odds that a further reading must bring to any pair
_NEW_SETTING = (2.0, 1.0, 1.0)  # effort of a new posture, load or instrument, beside a reading's one


@dataclass
class Pair:
    """A cause by one of its parameters, and a rival that may follow it."""

    first: str
    second: str
    parameter: str
    own: Array
    """(n,) what a fault of the usual size does to all readings that are offered, in standard deviations."""
    rival: Array
    """(n, k) derivatives by the rival's parameters in units of their own; (n, 0) for no cause at all."""
    log_odds: float = 0.0
    """By the readings chosen so far."""
    _inverse: Array = field(init=False)
    _pull: Array = field(init=False)

    def __post_init__(self) -> None:
        """Start without readings."""
        self.reset()

    def reset(self) -> None:
        """Forget all readings."""
        count = self.rival.shape[1]
        self._inverse, self._pull, self.log_odds = np.eye(count) / _LOOSE, np.zeros(count), 0.0

    @property
    def gains(self) -> Array:
        """What each of the readings (n,) would add."""
        left = self.own - self.rival @ (self._inverse @ self._pull)
        return 0.5 * left**2 / (1.0 + np.einsum("ni,ij,nj->n", self.rival, self._inverse, self.rival))

    def add(self, row: int) -> None:
        """Take one of the readings."""
        self.log_odds += float(self.gains[row])
        y = self._inverse @ self.rival[row]
        self._inverse = self._inverse - np.outer(y, y) / (1.0 + self.rival[row] @ y)
        self._pull = self._pull + self.own[row] * self.rival[row]

    def judge(self, rows: Sequence[int]) -> float:
        """Expected ln-odds by some readings."""
        x, y = self.own[list(rows)], self.rival[list(rows)]
        left = x - y @ np.linalg.solve(y.T @ y + _LOOSE * np.eye(y.shape[1]), y.T @ x)
        return 0.5 * float(x @ left)


def choose_readings(pairs: Sequence[Pair], settings: Indices, enough: float, least: int = 0) -> list[int]:
    """Choose readings until every pair has enough ln-odds, then drop those that are not needed.

    Parameters
    ----------
    pairs
        All of which the readings that are offered can bring that far; theirs are those of the choice afterwards.
    settings
        (n, 3) posture, load and instrument of each reading: those that are set up already cost less.
    enough
        Expected ln-odds of every pair.
    least
        Readings at least.

    Returns
    -------
    list of int
        Rows, in order.
    """
    chosen: list[int] = []
    for pair in pairs:
        pair.reset()
    while pairs and len(chosen) < len(settings):
        short = [pair for pair in pairs if pair.log_odds < enough]
        if not short and len(chosen) >= least:
            break
        wanted = [(pair, enough - pair.log_odds) for pair in short] or [(pair, enough) for pair in pairs]
        worth = sum((np.minimum(pair.gains, most) for pair, most in wanted), np.zeros(len(settings)))
        worth = worth / _count_effort(settings, chosen)
        worth[chosen] = -np.inf
        best = int(np.argmax(worth))
        if not worth[best] > _LEAST_GAIN:
            break
        chosen.append(best)
        for pair in pairs:
            pair.add(best)
    return _drop(pairs, chosen, enough, least)


def _count_effort(settings: Indices, chosen: Sequence[int]) -> Array:
    """Effort (n,) of each reading beside those chosen."""
    out = np.ones(len(settings))
    for column, price in enumerate(_NEW_SETTING):
        out += price * ~np.isin(settings[:, column], settings[list(chosen), column])
    return out


def _drop(pairs: Sequence[Pair], chosen: Sequence[int], enough: float, least: int) -> list[int]:
    """Readings without those, the first that were chosen first, that no pair needs."""
    kept = list(chosen)
    for row in chosen:
        if len(kept) <= least:
            break
        rest = [other for other in kept if other != row]
        if all(pair.judge(rest) >= min(enough, pair.log_odds) for pair in pairs):
            kept = rest
    for pair in pairs:
        pair.log_odds = pair.judge(kept)
    return sorted(kept)
