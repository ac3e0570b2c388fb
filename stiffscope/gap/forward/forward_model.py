"""What inference needs of a forward model: readings predicted for a set of effects, their derivatives, their noise.

Two models implement this: `robot_model` (a nominal robot) and `column_model` (predictions
that the campaign brings along). Inference knows nothing else of either.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from stiffscope.effects.effect import UNNAMED, Candidate

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stiffscope.gap.campaign.campaign import Campaign
    from stiffscope.runtime.types import Array, Flags, Indices

__all__ = ["UNNAMED", "Candidate", "ForwardModel", "Noise", "Parameters", "Prediction", "Trial"]

Parameters = tuple[tuple[Candidate, tuple[float, ...]], ...]
"""A set of effects with their internal parameters."""


@dataclass(frozen=True)
class Noise:
    """Noise of n readings and which of them are used.

    A reading's standard deviation is ``sigma``, times one common unknown factor where ``scaled``; ``factors`` is a grid
    of that factor, equally likely a priori.
    """

    sigma: Array
    used: Flags
    """(n,) False: a gross outlier."""
    scaled: Flags
    """(n,) whether the common factor multiplies its sigma."""
    factors: Array
    """(m,)."""
    remarks: tuple[str, ...] = ()

    def weigh_residuals(self, factor: float) -> Array:
        """Weights (n,) of residuals in units of ``sigma`` for a value of the common factor."""
        return np.where(self.scaled, 1.0 / factor, 1.0)


class Prediction(Protocol):
    """Readings predicted for one set of effects."""

    @property
    def values(self) -> Array:
        """What every reading (n,) would be."""
        ...

    def columns(self, candidate: Candidate) -> Array:
        """Derivatives (n, k) of the values by a candidate's internal parameters."""
        ...

    def step(self, candidate: Candidate) -> Array:
        """Change (n,) of the values where a candidate without parameters acts."""
        ...


@dataclass(frozen=True)
class Trial:
    """Readings that could be taken next, as a forward model, in groups that are read together."""

    model: ForwardModel
    sigma: Array
    """(n,) expected noise."""
    group: Indices
    """(n,) which measurement a reading belongs to."""


class ForwardModel(Protocol):
    """A nominal model of a campaign's readings and the effects that it may lack."""

    @property
    def campaign(self) -> Campaign:
        """The readings."""
        ...

    @property
    def library(self) -> tuple[Candidate, ...]:
        """Effects that may explain the gap, nuisance patterns included."""
        ...

    @property
    def most_effects(self) -> int:
        """Effects with parameters at most that a diagnosis may name: more can follow almost anything."""
        ...

    @property
    def tried(self) -> tuple[tuple[Candidate, ...], ...]:
        """Sets of effects that are fitted in any case, beside those that the search builds one by one."""
        ...

    def admits(self, candidates: Sequence[Candidate]) -> bool:
        """Whether the search may build this set of effects."""
        ...

    def predict(self, parameters: Parameters = ()) -> Prediction:
        """Readings with these effects. Raises InputError where the parameters leave what can be assembled."""
        ...

    def noise(self) -> Noise:
        """Noise and gross outliers of the readings."""
        ...

    def trial(self, sigma: Array) -> Trial:
        """Readings that could be taken next, where those of the campaign have noise ``sigma`` (n,)."""
        ...

    def remarks(self, noise: Noise, unexplained: Array) -> tuple[str, ...]:
        """What the model itself says of its residuals (n,) without effects, in standard deviations."""
        ...
