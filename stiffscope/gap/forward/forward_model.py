"""Interface of forward models to inference: predicted readings, derivatives and noise.

Two models implement it: `robot_model` (a nominal robot) and `column_model` (predictions stored
in the campaign). Inference uses only this interface.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from stiffscope.gap.effects.effect import UNNAMED, Candidate

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from stiffscope.gap.campaign.campaign import Campaign
    from stiffscope.runtime.types import Array, Flags, Indices

__all__ = [
    "UNNAMED",
    "Candidate",
    "ForwardModel",
    "Noise",
    "Parameters",
    "Prediction",
    "Trial",
]

Parameters = tuple[tuple[Candidate, tuple[float, ...]], ...]
"""A set of effects with their internal parameters."""


@dataclass(frozen=True)
class Noise:
    """Noise of n readings, and which of them are used.

    The standard deviation of a reading is ``sigma``, multiplied by a common unknown factor if
    ``scaled``; ``factors`` is a grid of that factor with a uniform prior.
    """

    sigma: Array
    used: Flags
    """(n,) False for gross outliers."""
    scaled: Flags
    """(n,) whether sigma is multiplied by the common factor."""
    factors: Array
    """Grid (m,) of the common factor."""
    remarks: tuple[str, ...] = ()
    freedom: float = np.inf
    """Degrees of freedom from which sigma was estimated; infinite if it is known."""


class Prediction(Protocol):
    """Predicted readings for one set of effects."""

    @property
    def values(self) -> Array:
        """Predicted readings (n,)."""
        ...

    def columns(self, candidate: Candidate) -> Array:
        """Return the derivatives (n, k) with respect to a candidate's internal parameters."""
        ...

    def step(self, candidate: Candidate) -> Array:
        """Return the change (n,) of the values by a candidate without parameters."""
        ...


def join_columns(prediction: Prediction, candidates: Iterable[Candidate]) -> Array:
    """Return the derivatives (n, k) with respect to the internal parameters of all candidates."""
    none = np.zeros((len(prediction.values), 0))
    return np.hstack([none, *(prediction.columns(c) for c in candidates)])


@dataclass(frozen=True)
class Trial:
    """Possible next readings as a forward model, in groups that are read together."""

    model: ForwardModel
    sigma: Array
    """Expected noise (n,)."""
    group: Indices
    """Number (n,) of the measurement that a reading belongs to."""


@dataclass(frozen=True)
class Displaced:
    """Instruments that a prediction finds elsewhere than stated, against their uncertainty."""

    remarks: tuple[str, ...] = ()
    """A sentence on each."""
    left: Array | None = None
    """Readings (n,) less those of the instruments as found; None without such instruments."""


class ForwardModel(Protocol):
    """A nominal model of a campaign's readings, with candidate effects."""

    @property
    def campaign(self) -> Campaign:
        """The campaign with its readings."""
        ...

    @property
    def coarse(self) -> ForwardModel | None:
        """A model of the same effects by smoother readings, in which a search starts; None: itself."""
        ...

    @property
    def library(self) -> tuple[Candidate, ...]:
        """Effects that may explain the gap, including nuisance patterns."""
        ...

    @property
    def most_effects(self) -> int:
        """Most effects with parameters in a diagnosis; more would fit almost anything."""
        ...

    @property
    def tried(self) -> tuple[tuple[Candidate, ...], ...]:
        """Sets of effects that are always fitted, besides those built by the search."""
        ...

    def admits(self, candidates: Sequence[Candidate]) -> bool:
        """Return whether the search may combine these effects."""
        ...

    def predict(self, parameters: Parameters = ()) -> Prediction:
        """Predict readings with these effects. Raises InputError outside the assemblable range."""
        ...

    def doubt_again(self, parameters: Parameters) -> ForwardModel | None:
        """Return the model with other faults of instruments that a prediction shows, if any."""
        ...

    def find_equilibria(
        self, parameters: Parameters, rest: Array | None = None
    ) -> ForwardModel | None:
        """Return the model at the equilibria reached with these effects, if readings show them.

        rest: part of the readings (n,), in their units, that the difference must equal in size.
        """
        ...

    def find_displaced(self, parameters: Parameters = ()) -> Displaced:
        """Return instruments found elsewhere than stated with these effects."""
        ...

    def noise(self) -> Noise:
        """Return noise and gross outliers of the readings."""
        ...

    def trial(self, sigma: Array) -> Trial:
        """Return possible next readings, given noise ``sigma`` (n,) of the campaign's readings."""
        ...

    def remarks(self, noise: Noise, unexplained: Array) -> tuple[str, ...]:
        """Return remarks on residuals (n,) without effects, in standard deviations."""
        ...
