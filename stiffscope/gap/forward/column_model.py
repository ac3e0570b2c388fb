"""Forward model of a campaign with its own predictions.

Its effects are rival models, scales by direction, and parameters of the user's own model, whose
derivatives are columns ``d:NAME[UNIT]`` of the table, or ``d:NAME[UNIT ± SIGMA]`` if it is known so
well.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.gap.campaign.quantities import AXES
from stiffscope.gap.effects.effect import GROWTH
from stiffscope.gap.forward.forward_model import Candidate, Displaced, Noise, Trial

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stiffscope.gap.campaign.campaign import Campaign
    from stiffscope.gap.forward.forward_model import Parameters
    from stiffscope.runtime.types import Array, Flags


PRIOR_SCALE = 0.2  # prior size of a scale minus one
PLAUSIBLE = (0.5, 2.0)
PRIOR_CHANGE = 0.2  # prior rms change of the values by a parameter, over their rms
NOISES = np.geomspace(1e-4, 0.5, 120)  # unknown noise: 0.01 to 50 % of a reading's size
OUTLYING = 6.0  # robust standard deviations
FEW = 0.05  # share of the readings that can be outliers
_MOST_SCALES = 2
_DERIVATIVE = re.compile(
    r"d:\s*(?P<name>[^\[]*[^\[\s])\s*"
    r"(?:\[\s*(?P<unit>[^\]±]*?)\s*(?:±\s*(?P<sigma>[\d.eE+-]+)\s*)?\])?"
)
GROUPS = {
    "all": AXES,
    "translation": AXES[:3],
    "rotation": AXES[3:],
    **{x: (x,) for x in AXES},
}


@dataclass(frozen=True)
class ColumnPrediction:
    """Values of the model under test, or a rival of it, multiplied by scales."""

    values: Array
    base: Array
    """Values (n,) of the model under test, or its rival, without scales and parameters."""
    gain: Array
    """Product (n,) of the scale factors."""
    factors: dict[str, float]
    """Factor of each scale, by name."""

    def columns(self, candidate: Candidate) -> Array:
        """Return the derivatives (n, 1) by a scale factor or a parameter; (n, 0) for a rival."""
        if candidate.effect == "parameter":
            return (candidate.action * self.gain)[:, None]
        if candidate.effect != "scale":
            return np.zeros((len(self.values), 0))
        factor = self.factors.get(candidate.name, 1.0)
        return (self.values * candidate.action / factor)[:, None]

    def step(self, candidate: Candidate) -> Array:
        """Return the change (n,) of the values if a rival replaces the model under test."""
        if candidate.effect != "rival":
            return np.zeros(len(self.values))
        return (candidate.action - self.base) * self.gain


@dataclass(frozen=True)
class ColumnModel:
    """A campaign with predictions; ``value`` holds those of the model under test.

    A rival's action are its values (n,), a scale's flags (n,) of the readings that it multiplies,
    a parameter's the derivatives (n,) of the values.
    """

    campaign: Campaign
    most_effects: int = len(AXES)

    @property
    def coarse(self) -> None:
        """None: a search starts in these readings."""
        return

    @property
    def library(self) -> tuple[Candidate, ...]:
        """Rivals, parameters, and distinguishable scales; scales of the same readings are aliases."""
        return self._library

    @cached_property
    def _library(self) -> tuple[Candidate, ...]:
        values = self.campaign.predictions["value"]
        others: list[Candidate] = []
        for name, column in self.campaign.predictions.items():
            derivative = _DERIVATIVE.fullmatch(name)
            if derivative:
                others.append(_parameter(derivative, column, values))
            elif name != "value":
                others.append(Candidate("rival", name, action=column))
        kept: dict[bytes, tuple[Flags, list[str]]] = {}
        for place, axes in GROUPS.items():
            chosen: Flags = np.isin(
                self.campaign.direction, [AXES.index(axis) for axis in axes]
            )
            if chosen.any():
                kept.setdefault(chosen.tobytes(), (chosen, []))[1].append(place)
        return (*others, *(_scale(chosen, places) for chosen, places in kept.values()))

    @property
    def tried(self) -> tuple[tuple[Candidate, ...], ...]:
        """One scale per direction, combined with each of the models."""
        rivals = [c for c in self.library if c.effect == "rival"]
        axes = tuple(c for c in self.library if c.place in AXES and c.effect == "scale")
        return (
            ((axes, *((rival, *axes) for rival in rivals)))
            if len(axes) > _MOST_SCALES
            else ()
        )

    def admits(self, candidates: Sequence[Candidate]) -> bool:
        """Return whether there are at most one rival and two scales; more would be redundant."""
        effects = [c.effect for c in candidates]
        distinct = len({c.name for c in candidates}) == len(effects)
        return (
            distinct
            and effects.count("rival") <= 1
            and effects.count("scale") <= _MOST_SCALES
        )

    def predict(self, parameters: Parameters = ()) -> ColumnPrediction:
        """Return values (n,) of the model under test, or a rival, multiplied by every scale."""
        base = self.campaign.predictions["value"]
        change = np.zeros(len(self.campaign))
        gain = np.ones(len(self.campaign))
        factors: dict[str, float] = {}
        for candidate, values in parameters:
            if candidate.effect == "rival":
                base = candidate.action
            elif candidate.effect == "parameter":
                change = change + candidate.action * values[0]
            else:
                factors[candidate.name] = 1.0 + values[0]
                gain = np.where(candidate.action, factors[candidate.name] * gain, gain)
        return ColumnPrediction((base + change) * gain, base, gain, factors)

    def doubt_again(self, parameters: Parameters) -> None:
        """Return none: predictions have no instruments."""
        del parameters

    def find_equilibria(
        self, parameters: Parameters, rest: Array | None = None
    ) -> None:
        """Return none: predictions are what they are."""
        del parameters, rest

    def find_displaced(self, parameters: Parameters = ()) -> Displaced:
        """Return none: predictions have no instruments."""
        del parameters
        return Displaced()

    def noise(self) -> Noise:
        """Return the noise: stated, or an unknown factor times the reading or its kind's rms."""
        c = self.campaign
        unknown: Flags = np.isnan(c.sigma)
        like = c.kind_numbers
        mean = np.sqrt(np.bincount(like, c.value**2) / np.maximum(np.bincount(like), 1))
        own = np.where(c.relative, np.abs(c.value), mean[like])
        own = np.where(own > 0, own, max(float(np.abs(c.value).max()), 1e-300))
        sigma = np.where(unknown, own, c.sigma)
        outlier = self._outliers(sigma, unknown)
        remarks = [
            f"left out as an outlier: {c.where(int(i))}"
            for i in np.flatnonzero(outlier)
        ]
        if unknown.any():
            count = int(unknown.sum())
            remarks.insert(
                0, f"{count} readings lack an uncertainty; estimated from residuals"
            )
        return Noise(sigma, ~outlier, unknown, NOISES, tuple(remarks))

    def _outliers(self, sigma: Array, unknown: Flags) -> Flags:
        """Return the readings (n,) that no model fits with any scale of their direction.

        None beside parameters, by which a few readings alone may differ.
        """
        c = self.campaign
        if any(each.effect == "parameter" for each in self.library):
            return np.zeros(len(c), dtype=np.bool_)
        best = np.full(len(c), np.inf)
        for base in c.predictions.values():
            rest = (c.value - base) / sigma
            ratio = base / sigma
            for axis in range(6):
                pick = (c.direction == axis) & (ratio != 0)
                if pick.any():
                    rest[pick] -= ratio[pick] * np.median(rest[pick] / ratio[pick])
            best = np.minimum(best, np.abs(rest))
        spread = 1.4826 * float(np.median(best)) if unknown.any() else 1.0
        far: Flags = best > OUTLYING * max(spread, 1e-12)
        return far if far.sum() <= FEW * len(far) else np.zeros_like(far)

    def trial(self, sigma: Array) -> Trial:
        """Return the campaign's own readings, each repeated once."""
        return Trial(self, sigma, np.arange(len(self.campaign)))

    def remarks(self, noise: Noise, unexplained: Array) -> tuple[str, ...]:  # noqa: ARG002
        """Return no remarks, as predictions contain no physics to check."""
        return ()


def _scale(chosen: Flags, places: list[str]) -> Candidate:
    aliases = tuple(f"scale @ {place}" for place in places[1:])
    physical, internal = GROWTH
    return Candidate(
        effect="scale",
        place=places[0],
        names=("factor",),
        units=("1",),
        scale=(PRIOR_SCALE,),
        plausible=(PLAUSIBLE,),
        bounds=(-0.9, np.inf),
        physical=physical,
        internal=internal,
        aliases=aliases,
        action=chosen,
    )


def _parameter(derivative: re.Match[str], column: Array, values: Array) -> Candidate:
    """Return a parameter of the user's model, by the derivatives (n,) of its values (n,)."""
    sigma = derivative["sigma"]
    usual = float(np.linalg.norm(values) / (np.linalg.norm(column) or np.inf))
    return Candidate(
        "parameter",
        derivative["name"],
        names=("change",),
        units=(derivative["unit"] or "1",),
        scale=(float(sigma) if sigma else PRIOR_CHANGE * usual or 1.0,),
        plausible=((-np.inf, np.inf),),
        stated=bool(sigma),
        action=column,
    )
