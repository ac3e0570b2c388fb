"""Forward model of a nominal robot: the vocabulary's effects with their priors, nuisance patterns, readings to come."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.gap.forward_model import Candidate, Trial
from stiffscope.gap.mechanics import RobotAtPoses
from stiffscope.gap.noise import noise_of
from stiffscope.gap.nuisance import nuisance_patterns
from stiffscope.gap.quantities import AXES, DEFLECTION, DEVIATION, STIFFNESS
from stiffscope.gap.robot_prediction import RobotPrediction
from stiffscope.robot.effects import factor_of, growth_of, mechanical_effects
from stiffscope.robot.vocabulary import VOCABULARY

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from stiffscope.gap.campaign import Campaign
    from stiffscope.gap.forward_model import Noise, Parameters
    from stiffscope.robot.effects import MechanicalEffect, NominalRobot

    Array = NDArray[np.floating[Any]]

FORCE, MOMENT = 500.0, 100.0  # N, N·m: the range of loads where the campaign shows none
DISPLACEMENT, ROTATION = 1e-6, 5e-6  # m, rad: the instrument where the campaign shows none
SIGNIFICANT = 3.0  # standard deviations
_FACTORS = (-0.8, 50.0)  # bounds of what is 1/factor - 1 or factor - 1: nothing becomes infinitely stiff
_ADDED = (0.0, np.inf)  # bounds of an added compliance, a dead zone


@dataclass(frozen=True)
class Prior:
    """Prior sizes of internal parameters, plausible ranges of physical ones, bounds."""

    scale: tuple[float, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    bounds: tuple[float, float] = (-np.inf, np.inf)


PRIORS = {
    "actuator-stiffness": Prior((0.2,), (0.2,), (2.0,), _FACTORS),
    "joint-compliance": Prior((2e-9, 2e-9, 1e-6), (0.0,) * 3, (1e-6, 1e-6, 1e-3), _ADDED),
    "link-stiffness": Prior((0.2,), (0.2,), (2.0,), _FACTORS),
    "rigid-ends": Prior((0.02,), (0.0,), (0.15,), _ADDED),
    "slider-compliance": Prior((0.5,), (0.2,), (20.0,), _FACTORS),
    "guide-compliance": Prior((5e-9, 5e-9, 1e-7), (0.0,) * 3, (1e-6, 1e-6, 1e-4), _ADDED),
    "base-compliance": Prior((1e-8,) * 3 + (1e-7,) * 3, (0.0,) * 6, (1e-6,) * 3 + (1e-5,) * 3, _ADDED),
    "platform-compliance": Prior((1e-8,) * 3 + (1e-7,) * 3, (0.0,) * 6, (1e-6,) * 3 + (1e-5,) * 3, _ADDED),
    "backlash": Prior((1e-5,), (0.0,), (1e-3,), _ADDED),
    "encoder-offset": Prior((2e-4,), (-5e-3,), (5e-3,)),
    "link-length": Prior((1e-4,), (-3e-3,), (3e-3,)),
    "thermal": Prior((10.0,), (-60.0,), (100.0,)),
    "instrument-misalignment": Prior((0.01,) * 3, (-0.1,) * 3, (0.1,) * 3),
    "displacement-scale": Prior((0.05,), (0.7,), (1.4,), _FACTORS),
    "force-scale": Prior((0.05,), (0.7,), (1.4,), _FACTORS),
}


def robot_candidates(nominal: NominalRobot) -> tuple[Candidate, ...]:
    """Every effect of the vocabulary at every place of a robot."""
    mass, first_moments = (0.0, 50.0), ((-0.5, 0.5),) * 3
    names, units = zip(*VOCABULARY["payload"].parameters, strict=True)
    payload = Candidate("payload", "platform", names, units, (3.0, 0.3, 0.3), (mass, *first_moments))
    instrument = [_by_name(effect, "instrument") for effect in ("instrument-misalignment", "displacement-scale")]
    return (
        Candidate("gravity", "robot"),
        replace(payload, physical=_centre_of_mass, internal=_first_moments),
        Candidate("payload", "platform", names[:1], units[:1], (3.0,), (mass,)),
        *(_mechanical(effect) for effect in mechanical_effects(nominal)),
        *(_by_name("backlash", place) for place in VOCABULARY["backlash"].places),
        *(replace(candidate, component="instrument") for candidate in instrument),
        _by_name("force-scale", "instrument"),
    )


def _by_name(effect: str, place: str) -> Candidate:
    """A candidate that `RobotPrediction` knows by its name."""
    names, units = zip(*VOCABULARY[effect].parameters, strict=True)
    prior = PRIORS[effect]
    plausible = tuple(zip(prior.low, prior.high, strict=True))
    candidate = Candidate(effect, place, names, units, prior.scale, plausible, prior.bounds)
    return replace(candidate, physical=factor_of, internal=growth_of) if names == ("factor",) else candidate


def _mechanical(effect: MechanicalEffect) -> Candidate:
    entries = effect.names[0] == "c11"
    count = len(effect.names)
    prior = Prior((1.0,) * count, (-1e-3,) * count, (1e-3,) * count) if entries else PRIORS[effect.effect]
    return Candidate(
        effect.effect,
        effect.place,
        effect.names,
        effect.units,
        prior.scale,
        tuple(zip(prior.low, prior.high, strict=True)),
        prior.bounds,
        effect.physical,
        effect.internal,
        component=_component(effect),
        flexible=entries,
        action=effect,
    )


def _component(effect: MechanicalEffect) -> str:
    """The part that an effect blames, where it blames a single one or a group that stands for itself."""
    if effect.effect == "actuator-stiffness" and effect.place != "limbs":
        return f"{effect.place}.actuator"
    single_link = effect.effect == "link-stiffness" and effect.place != "links"
    added = effect.effect in {"joint-compliance", "guide-compliance", "base-compliance", "platform-compliance"}
    return effect.place if single_link or added else ""


def _centre_of_mass(values: Array) -> Array:
    """Mass and centre of mass of a payload; its height is not in the readings."""
    mass = values[0] if abs(values[0]) > 1e-9 else 1e-9
    return np.array([values[0], values[1] / mass, values[2] / mass, 0.0])


def _first_moments(values: Array) -> Array:
    """Mass and first moments of a payload."""
    return np.array([values[0], values[0] * values[1], values[0] * values[2]])


@dataclass(frozen=True)
class RobotModel:
    """A campaign on its nominal robot."""

    campaign: Campaign
    nominal: NominalRobot
    without: str = ""
    """An effect that is left out of the library."""
    most_effects: int = 5
    tried: tuple[tuple[Candidate, ...], ...] = ()
    prior_sizes: Array = field(default_factory=lambda: np.geomspace(0.03, 10.0, 6))

    @property
    def library(self) -> tuple[Candidate, ...]:
        """The vocabulary's effects, without those that the nominal model carries, and nuisance patterns."""
        return self._library

    @cached_property
    def _library(self) -> tuple[Candidate, ...]:
        gone = {self.without, "gravity" if self._weighted else ""}
        known = (c for c in robot_candidates(self.nominal) if c.effect not in gone)
        return (*known, *nuisance_patterns(self.nominal))

    @property
    def _weighted(self) -> bool:
        return "gravity" in self.campaign.modelled

    @cached_property
    def _at(self) -> RobotAtPoses:
        return RobotAtPoses(self.nominal, self.campaign.poses)

    def admits(self, candidates: Sequence[Candidate]) -> bool:
        """One of each name: some effects come with fewer or more parameters."""
        return len({c.name for c in candidates}) == len(candidates)

    def predict(self, parameters: Parameters = ()) -> RobotPrediction:
        """Readings with these effects. Raises InputError where the parameters leave what can be assembled."""
        return RobotPrediction(self.campaign, self._at, self._weighted, parameters)

    def noise(self) -> Noise:
        """Noise and gross outliers, as the joint fit of all effects shows them."""
        return noise_of(self)

    def trial(self, sigma: Array) -> Trial:
        """Every wrench along an axis at its largest, and none, at tool points all over the workspace."""
        c = self.campaign
        poses = self._at.workspace(float(np.median(c.poses[:, 1])))
        loads = np.nan_to_num(c.wrench[c.kind == DEFLECTION])
        seen = np.abs(loads).max(axis=0) if len(loads) else np.zeros(6)
        size = seen if seen.any() else np.array([FORCE] * 3 + [MOMENT] * 3)
        wrenches = np.vstack([np.zeros(6), np.diag(size)])
        n = len(poses) * len(wrenches) * 6
        wrench = np.tile(np.repeat(wrenches, 6, axis=0), (len(poses), 1))
        direction = np.tile(np.arange(6), n // 6)
        still = ~wrench.any(axis=1)
        trial = replace(
            c,
            pose_names=tuple(str(k) for k in range(len(poses))),
            poses=poses,
            pose=np.repeat(np.arange(len(poses)), n // len(poses)),
            wrench=wrench,
            quantity=6 * np.where(still, DEVIATION, DEFLECTION) + direction,
            value=np.zeros(n),
            sigma=np.ones(n),
            session=np.zeros(n),
            file=np.zeros(n),
            line=np.arange(n),
        )
        return Trial(replace(self, campaign=trial), self._displacement_noise(sigma)[direction], np.arange(n) // 6)

    def _displacement_noise(self, sigma: Array) -> Array:
        """Noise of a displacement in each direction (6,), as the campaign's own readings have it."""
        c = self.campaign
        out = np.array([DISPLACEMENT] * 3 + [ROTATION] * 3)
        for group, half in ((slice(0, 3), c.direction < 3), (slice(3, 6), c.direction >= 3)):
            mine = half & (c.kind <= DEVIATION)
            if mine.any():
                out[group] = np.median(sigma[mine])
        return out

    def remarks(self, noise: Noise, unexplained: Array) -> tuple[str, ...]:
        """Readings of stiffness above what any such machine can have, and gravity where it cannot be the cause."""
        return (*self._beyond_bounds(noise), *self._too_weak(noise, unexplained))

    def _beyond_bounds(self, noise: Noise) -> list[str]:
        c = self.campaign
        stiff = np.flatnonzero((c.kind == STIFFNESS) & noise.used)
        if not len(stiff):
            return []
        limit = self._at.stiffness_bounds()[c.pose[stiff], c.direction[stiff]]
        over = (c.value[stiff] - limit) / noise.sigma[stiff] > SIGNIFICANT
        if not over.any():
            return []
        axes = ", ".join(sorted({f"k{AXES[d]}" for d in c.direction[stiff[over]]}))
        worst = float((c.value[stiff] / limit)[over].max())
        excess = f"{axes} exceed what the machine can have, up to {worst:.3g} times"
        return [f"{excess}: no added compliance or weight cures that"]

    def _too_weak(self, noise: Noise, unexplained: Array) -> list[str]:
        """Gravity of known size that would have to be many times stronger than it is."""
        if self._weighted:
            return []
        step = self.predict().step(Candidate("gravity", "robot"))
        column = (step / noise.sigma)[noise.used]
        size = float(column @ column)
        if size <= 0.0:
            return []
        strength = float(column @ unexplained[noise.used]) / size
        if not abs(strength) > SIGNIFICANT * max(1.0, 1.0 / np.sqrt(size)):
            return []
        return [
            f"gravity would have to be {strength:.3g} times what it is to explain the gap best, so it is not the cause"
        ]
