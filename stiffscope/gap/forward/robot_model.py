"""Forward model of a nominal robot: predictions, candidate effects and possible next readings."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.gap.campaign.columns import swap_columns
from stiffscope.gap.campaign.kinds import CODE_ALONG
from stiffscope.gap.campaign.readings import match_robot
from stiffscope.gap.campaign.resolution import find_rounding
from stiffscope.gap.campaign.sanity import find_doubts, inspect_ranges
from stiffscope.gap.effects.drives import ActuatorStiffness
from stiffscope.gap.effects.effect import Doubts, Place, Setting
from stiffscope.gap.effects.links import PartCompliance
from stiffscope.gap.effects.masses import Gravity
from stiffscope.gap.effects.vocabulary import find_candidates
from stiffscope.gap.forward.elastic_state import ElasticState
from stiffscope.gap.forward.forward_model import Displaced, Trial, join_columns
from stiffscope.gap.forward.noise import noise_of
from stiffscope.gap.forward.nuisance import nuisance_patterns
from stiffscope.gap.forward.remarks import find_remarks
from stiffscope.gap.forward.robot_at_poses import RobotAtPoses
from stiffscope.gap.forward.robot_prediction import RobotPrediction
from stiffscope.gap.forward.setting import find_setting
from stiffscope.gap.forward.swaps import find_swaps
from stiffscope.gap.forward.trial import plan_trial
from stiffscope.gap.forward.twins import merge_twins

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from stiffscope.gap.campaign.campaign import Campaign
    from stiffscope.gap.effects.effect import Candidate
    from stiffscope.gap.forward.forward_model import Noise, Parameters
    from stiffscope.robot.nominal import NominalRobot
    from stiffscope.runtime.types import Array

_SUSPECT = 0.2  # fraction of squared gap (beyond drives, noise) to test a part
_SIGNIFICANT = 3.0  # standard deviations
_ROUNDING = 1e-10  # relative to the largest reading


@dataclass(frozen=True)
class RobotModel:
    """A campaign with its nominal robot."""

    campaign: Campaign
    nominal: NominalRobot
    without: str = ""
    """An effect excluded from the library."""
    most_effects: int = 5
    tried: tuple[tuple[Candidate, ...], ...] = ()
    exact: bool = False
    """Whether motions are those of the equilibrium reached."""
    doubts: Doubts | None = None
    """Doubts about instruments (default: by the nominal prediction)."""

    def __post_init__(self) -> None:
        """Match poses, sensors and loads to the robot. Raises InputError if they do not.

        Positions and distances are taken relative to those of the rigid robot as commanded.
        """
        campaign = match_robot(self.campaign, self.nominal.robot)
        if campaign.is_absolute.any() and campaign.expected is None:
            at = RobotAtPoses(self.nominal, campaign)
            expected = np.zeros(len(campaign))
            there = at.instruments.look(at.instruments_start[0], *at.targets(at.rest))
            expected[at.instruments.rows] = there
            campaign = replace(
                campaign, value=campaign.value - expected, expected=expected
            )
        object.__setattr__(self, "campaign", campaign)

    @property
    def coarse(self) -> None:
        """None: a search starts in these readings."""
        return

    @property
    def library(self) -> tuple[Candidate, ...]:
        """Effects that the nominal model lacks, with twins merged, and nuisance patterns."""
        return self._library

    @cached_property
    def _library(self) -> tuple[Candidate, ...]:
        without = {self.without, Gravity.word if self._has_gravity else ""}
        known = tuple(find_candidates(self.setting, without))
        heavy = tuple((c, ()) for c in known if c.effect == Gravity.word)
        # drives and masses that only weight would show are tried beside gravity
        return (
            *merge_twins(known, self.predict(), self.predict(heavy)),
            *nuisance_patterns(self.predict()),
        )

    @cached_property
    def setting(self) -> Setting:
        """Robot and measurement setup that determine the candidates."""
        setting = find_setting(self._sound, self._is_suspect)
        forces = {
            name: float(np.abs(self.predict().drive_force(name)).max(initial=0.0))
            for name in self.nominal.driven
        }
        return replace(
            setting,
            drive_forces=forces,
            doubts=self.doubts or self._find_doubts(()),
        )

    def _find_doubts(self, parameters: Parameters) -> Doubts:
        """Return doubts about instruments and columns by a prediction with effects."""
        prediction = self.predict(parameters)
        doubts = find_doubts(self.campaign, prediction.values)
        return replace(doubts, swaps=find_swaps(prediction))

    def doubt_again(self, parameters: Parameters) -> RobotModel | None:
        """Return the model with doubts by a prediction with effects, too; None if there is no other.

        What the nominal robot lacks hides a slip, a sign or a unit.
        """
        sound = tuple(each for each in parameters if not each[0].imitates)
        before = self.setting.doubts
        now = self._find_doubts(sound)
        signs = tuple(dict.fromkeys((*before.signs, *now.signs)))
        swaps = tuple(dict.fromkeys((*before.swaps, *now.swaps)))
        both = Doubts(
            {**now.units, **before.units}, signs, {**before.steps, **now.steps}, swaps
        )
        return None if both.key == before.key else replace(self, doubts=both)

    def find_equilibria(
        self, parameters: Parameters, rest: Array | None = None
    ) -> RobotModel | None:
        """Return the model at the equilibria reached; None where first order is as good, or is so already.

        rest: part of the readings (n,), in their units, that second order must equal in size.
        """
        if self.exact:
            return None
        predictions = (self.predict(), self.predict(parameters))
        shown = any(each.shows_second_order(rest) for each in predictions)
        return replace(self, exact=True) if shown else None

    def _is_suspect(self, part: str) -> bool:
        """Return whether a part's compliance entries explain much of the gap left by drives."""
        members = self.nominal.robot.bodies_of(part)
        known = PartCompliance.candidates(Setting(self.nominal))
        entries = [c for c in known if c.flexible and c.members == members]
        if not entries:
            return False
        own = self._weighed_columns(entries[:1])
        (beside, gap) = self._beside_drives
        columns = own - beside @ (beside.T @ own)
        size = np.linalg.norm(own, axis=0).clip(min=1e-300)
        basis = np.linalg.qr(columns / size)[0]
        explained = float(np.sum((basis.T @ gap) ** 2))
        count = columns.shape[1]
        stated = ~np.isnan(self.campaign.sigma)
        least = (
            count + _SIGNIFICANT * np.sqrt(2.0 * count) if stated.all() else 0.0
        )  # χ² of noise
        return explained > max(
            least, _SUSPECT * (float(gap @ gap) - float(stated.sum()))
        )

    @cached_property
    def _beside_drives(self) -> tuple[Array, Array]:
        """Orthonormal basis (n, k) of soft drives' effects, and the gap (n,) that they leave."""
        known = ActuatorStiffness.candidates(Setting(self.nominal))
        drives = self._weighed_columns(c for c in known if len(c.members) == 1)
        left, size, _ = np.linalg.svd(drives, full_matrices=False)
        basis = left[:, size > _ROUNDING * size.max(initial=0.0)]
        gap = (self.campaign.value - self.predict().values) * self._weight
        return basis, gap - basis @ (basis.T @ gap)

    @cached_property
    def _weight(self) -> Array:
        """Inverse uncertainties (n,) of the readings, or inverse values if none is stated."""
        c = self.campaign
        return 1.0 / np.where(np.isnan(c.sigma), np.abs(c.value) + 1e-300, c.sigma)

    def _weighed_columns(self, candidates: Iterable[Candidate]) -> Array:
        """Return weighted derivatives (n, k) with respect to effects."""
        return join_columns(self.predict(), candidates) * self._weight[:, None]

    @property
    def _has_gravity(self) -> bool:
        return self.campaign.is_weighed

    @cached_property
    def _sound(self) -> ElasticState:
        return ElasticState(RobotAtPoses(self.nominal, self.campaign))

    def admits(self, candidates: Sequence[Candidate]) -> bool:
        """Return whether names are unique, and no effect is part of another's full matrix."""
        if len({c.name for c in candidates}) < len(candidates):
            return False
        matrices = [c.members for c in candidates if c.flexible]
        others = (c for c in candidates if not c.flexible)
        return not any(c.action.of_matrix and c.members in matrices for c in others)

    def predict(self, parameters: Parameters = ()) -> RobotPrediction:
        """Predict readings with these effects. Raises InputError outside the assemblable range."""
        if not parameters:
            return self._nominal
        swaps = [
            pair
            for candidate, values in parameters
            for pair in candidate.action.influence(np.array(values)).swaps
        ]
        campaign = swap_columns(self.campaign, swaps)
        return replace(self._nominal, campaign=campaign, parameters=parameters)

    @cached_property
    def _nominal(self) -> RobotPrediction:
        return RobotPrediction(
            self.campaign, (), self._sound, self._has_gravity, self.exact
        )

    def predict_as(self, kind: int, other: int) -> Array:
        """Return readings (n,) predicted with those of one kind taken for another."""
        c = self.campaign
        quantity = np.where(c.kind == kind, CODE_ALONG[other, c.direction], c.quantity)
        return (
            replace(self, campaign=replace(c, quantity=quantity))
            .predict()
            .plain_readings
        )

    def find_displaced(self, parameters: Parameters = ()) -> Displaced:
        """Return instruments found elsewhere than stated with these effects."""
        prediction = self.predict(parameters)
        placed = prediction.placed_instruments
        if placed is None:
            return Displaced()
        instruments = prediction.at.instruments
        left = self.campaign.value - prediction.values
        left[instruments.rows] = placed.left
        return Displaced(tuple(instruments.find_displaced(placed.setup)), left)

    def noise(self) -> Noise:
        """Return noise and gross outliers from the joint fit of all effects."""
        noise = noise_of(self)
        step = self.steps.max(initial=0.0)
        if not step:
            return noise
        least = self.steps / np.sqrt(12.0)
        remark = f"readings in steps of up to {step:.2g}, which scatter by 0.29 of them"
        stated = ~np.isnan(self.campaign.sigma)
        sigma = np.where(
            stated, np.hypot(noise.sigma, least), np.maximum(noise.sigma, least)
        )
        return replace(noise, sigma=sigma, remarks=(*noise.remarks, remark))

    @cached_property
    def steps(self) -> Array:
        """Steps (n,) of readings, m or rad, whose rounding counts; else zero."""
        return np.sqrt(12.0) * find_rounding(self.campaign)

    def trial(self, sigma: Array) -> Trial:
        """Return possible next readings, given noise ``sigma`` (n,) of the campaign's readings."""
        campaign, noise, group = plan_trial(self.campaign, self.nominal, sigma)
        return Trial(replace(self, campaign=campaign), noise, group)

    def remarks(self, noise: Noise, unexplained: Array) -> tuple[str, ...]:
        """Return remarks on poses beyond a drive's range, stiffness too high or mistaken, and excluded gravity."""
        nominal = self.predict()
        weight = nominal.step(Gravity().make_candidate(Place("robot"))) * (
            not self._has_gravity
        )
        beyond = inspect_ranges(
            self.campaign, self.nominal.mechanism, self._sound.at.configurations
        )
        own = find_remarks(nominal, self.predict_as, noise, unexplained, weight)
        return (*(remark.text for remark in beyond), *own)
