"""What inference needs of a forward model: readings predicted for a set of effects, their derivatives, their noise.

Two models implement this: `robot_model` (a nominal robot) and `column_model` (predictions
that the campaign brings along). Inference knows nothing else of either.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from stiffscope.robot.vocabulary import FORMER_WORDS

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from stiffscope.gap.campaign.campaign import Campaign

    Array = NDArray[np.floating[Any]]
    Flags = NDArray[np.bool_]

UNNAMED = "unknown"
"""Effect of a nuisance pattern, for which the vocabulary has no word."""


def word_of(name: str) -> str:
    """The effect of an `effect @ place`, by its present word."""
    effect = name.partition(" @ ")[0]
    return FORMER_WORDS.get(effect, effect)


def _same(values: Array) -> Array:
    return values


@dataclass(frozen=True)
class Candidate:
    """An effect at a place that may explain a gap, with k parameters and what is known of them before the data.

    Internal parameters (k,) are those of the fit, zero without the effect; physical ones are those of the vocabulary.
    """

    effect: str
    place: str
    names: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    scale: tuple[float, ...] = ()
    """Prior size of the internal parameters."""
    plausible: tuple[tuple[float, float], ...] = ()
    """Plausible range of each physical parameter."""
    bounds: tuple[float, float] = (-np.inf, np.inf)
    """Range of every internal parameter that can be computed."""
    physical: Callable[[Array], Array] = _same
    """Physical parameters (k,) of internal ones."""
    internal: Callable[[Array], Array] = _same
    """Internal parameters (k,) of physical ones."""
    component: str = ""
    """Part of the machine that it blames, if it is one."""
    aliases: tuple[str, ...] = ()
    """Other names, as `effect @ place`, for this effect at this place."""
    twins: tuple[str, ...] = ()
    """Other effects, as `effect @ place`, with the very same signature in the readings."""
    couplings: int = 0
    """How many of the last internal parameters couple the others: these have either sign."""
    flexible: bool = False
    """True where it can follow almost anything, so that it says nothing about noise."""
    pattern: str = ""
    """Of a nuisance pattern: what it is, wherever it acts."""
    like: str = ""
    """Of a nuisance pattern: the word whose fault it is, at a place where the word cannot be."""
    swarming: bool = False
    """True for patterns of which there are so many that together they would follow noise."""
    action: object = None
    """What it does; only the forward model that made it looks inside."""

    @property
    def name(self) -> str:
        """`effect @ place`."""
        return f"{self.effect} @ {self.place}"

    @property
    def signature_of(self) -> tuple[str, ...]:
        """All effects with its signature, itself first."""
        return (self.name, *self.twins)

    @property
    def positive(self) -> bool:
        """Whether no internal parameter but couplings can be negative: an added compliance, a dead zone."""
        return self.bounds[0] == 0.0

    @property
    def one_sided(self) -> tuple[bool, ...]:
        """Which internal parameters cannot be negative."""
        return tuple(self.positive and k < len(self.scale) - self.couplings for k in range(len(self.scale)))

    @property
    def unnamed(self) -> bool:
        """Whether it is a nuisance pattern."""
        return self.effect == UNNAMED

    @property
    def simple(self) -> bool:
        """Whether it has a word, and can do little else than what the word says."""
        return not (self.unnamed or self.flexible or self.couplings)


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

    def whitening(self, factor: float) -> Array:
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
    group: NDArray[np.int64]
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
    def prior_sizes(self) -> Array:
        """Multiples (s,) of the candidates' prior sizes, equally likely, ascending."""
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
