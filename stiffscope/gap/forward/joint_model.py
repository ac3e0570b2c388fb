"""Forward model of a campaign with frequency responses, beside its static readings."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.errors import InputError
from stiffscope.gap.campaign.response_lines import (
    find_silent,
    join_responses,
    read_lines,
)
from stiffscope.gap.effects.masses import Gravity
from stiffscope.gap.effects.vocabulary import find_candidates
from stiffscope.gap.forward.forward_model import Displaced, Noise
from stiffscope.gap.forward.joint_prediction import JointPrediction, SoundSetups
from stiffscope.gap.forward.nuisance import nuisance_patterns
from stiffscope.gap.forward.twins import merge_twins

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stiffscope.gap.campaign.campaign import Campaign
    from stiffscope.gap.campaign.measured_responses import MeasuredResponses
    from stiffscope.gap.campaign.response_lines import ResponseBlock
    from stiffscope.gap.effects.effect import Candidate, Setting
    from stiffscope.gap.forward.forward_model import Parameters, Trial
    from stiffscope.gap.forward.robot_model import RobotModel
    from stiffscope.robot.nominal import NominalRobot
    from stiffscope.runtime.types import Array

WIDTHS = 0.12, 0.5
"""Of local means from which a search starts, relative to frequency: shifts of modes of about
this size are found. Wider means tell less, and are tried where the narrower ones find nothing."""


@dataclass(frozen=True)
class JointModel:
    """Static readings, if any, and responses of one robot.

    Attributes
    ----------
    readings
        Model of the static readings; without any, at the poses of the responses.
    responses
        Measured responses.
    width
        Of local means of lines, relative to frequency; 0: lines.
    known
        Library of effects, where another width has it already.
    sound
        Modes of the nominal robot, where another width has them already.
    """

    readings: RobotModel
    responses: tuple[MeasuredResponses, ...]
    width: float = 0.0
    known: tuple[Candidate, ...] | None = None
    sound: SoundSetups | None = None

    @property
    def nominal(self) -> NominalRobot:
        """The nominal robot."""
        return self.readings.nominal

    @property
    def most_effects(self) -> int:
        """Most effects with parameters in a diagnosis."""
        return self.readings.most_effects

    @property
    def tried(self) -> tuple[tuple[Candidate, ...], ...]:
        """Sets of effects that are always fitted."""
        return self.readings.tried

    @cached_property
    def blocks(self) -> tuple[ResponseBlock, ...]:
        """Lines, or their local means."""
        return tuple(
            block
            for measured in self.responses
            for block in read_lines(measured, self.width)
        )

    @property
    def campaign(self) -> Campaign:
        """Static readings and lines."""
        return self._campaign

    @cached_property
    def _campaign(self) -> Campaign:
        joined = join_responses(self.readings.campaign, self.blocks)
        if not len(joined):
            raise InputError("responses: expected lines other than zero, got none")
        return joined

    @property
    def coarse(self) -> JointModel | None:
        """The same model by local means of lines, in which a search starts; None of the widest."""
        return self._coarse

    @cached_property
    def _coarse(self) -> JointModel | None:
        wider = [width for width in WIDTHS if width > self.width]
        if not wider:
            return None
        known = self.library if self.width else self.known
        return JointModel(self.readings, self.responses, wider[0], known, self._sound)

    @property
    def library(self) -> tuple[Candidate, ...]:
        """Effects that the nominal model lacks, with twins merged, and nuisance patterns."""
        return self._library

    @cached_property
    def _library(self) -> tuple[Candidate, ...]:
        if self.known is not None:
            return self.known
        if not self.width and self.coarse is not None:
            return self.coarse.library
        weighs = self.readings.campaign.is_weighed or not len(self.readings.campaign)
        without = {self.readings.without, Gravity.word if weighs else ""}
        known = tuple(find_candidates(self.setting, without))
        heavy = tuple((c, ()) for c in known if c.effect == Gravity.word)
        patterns = (
            nuisance_patterns(self.readings.predict())
            if len(self.readings.campaign)
            else ()
        )
        return (
            *merge_twins(known, self.predict(), self.predict(heavy)),
            *patterns,
        )

    @cached_property
    def setting(self) -> Setting:
        """Robot and measurement set-up that determine the candidates."""
        points = dict[str, bool]()
        for measured in self.responses:
            for point in measured.setup.points:
                known = points.get(point.name, True)
                points[point.name] = known and point.mass is not None
        channels = {
            response.motion.channel: response.motion.point
            for measured in self.responses
            for response in measured.responses
        }
        return replace(self.readings.setting, points=points, channels=channels)

    def admits(self, candidates: Sequence[Candidate]) -> bool:
        """Return whether the search may combine these effects."""
        return self.readings.admits(candidates)

    def predict(self, parameters: Parameters = ()) -> JointPrediction:
        """Predict readings with these effects. Raises InputError outside the assemblable range."""
        if not parameters:
            return self._nominal
        return JointPrediction(
            self.campaign, self.readings.predict(parameters), self.blocks, self._sound
        )

    @cached_property
    def _nominal(self) -> JointPrediction:
        return JointPrediction(
            self.campaign, self.readings.predict(), self.blocks, self._sound
        )

    @cached_property
    def _sound(self) -> SoundSetups:
        if self.sound is not None:
            return self.sound
        return SoundSetups(self.readings.predict().elastic_state.loaded_mechanism)

    def doubt_again(self, parameters: Parameters) -> JointModel | None:
        """Return the model with other faults of instruments that a prediction shows, if any."""
        if not len(self.readings.campaign):
            return None
        again = self.readings.doubt_again(parameters)
        return None if again is None else JointModel(again, self.responses)

    def find_equilibria(
        self, parameters: Parameters, rest: Array | None = None
    ) -> JointModel | None:
        """Return the model at the equilibria reached with these effects, if readings show them.

        rest: part of the readings (n,) that the difference must equal in size, static ones first.
        """
        count = len(self.readings.campaign)
        if not count:
            return None
        own = None if rest is None else rest[:count]
        exact = self.readings.find_equilibria(parameters, own)
        return None if exact is None else replace(self, readings=exact)

    def find_displaced(self, parameters: Parameters = ()) -> Displaced:
        """Return instruments of the static readings found elsewhere than stated."""
        if not len(self.readings.campaign):
            return Displaced()
        own = self.readings.find_displaced(parameters)
        if own.left is None:
            return own
        predicted = self.predict(parameters).values
        left = self.campaign.value - predicted
        left[: len(own.left)] = own.left
        return Displaced(own.remarks, left)

    def noise(self) -> Noise:
        """Return noise and gross outliers of the readings; lines have neighbours that tell theirs."""
        return self._noise

    @cached_property
    def _noise(self) -> Noise:
        n = len(self.campaign)
        count = len(self.readings.campaign)
        sigma = np.array(self.campaign.sigma)
        used = np.ones(n, dtype=np.bool_)
        scaled = np.zeros(n, dtype=np.bool_)
        if not count:
            return Noise(sigma, used, scaled, np.ones(1))
        own = self.readings.noise()
        sigma[:count] = own.sigma
        used[:count] = own.used
        scaled[:count] = own.scaled
        return replace(own, sigma=sigma, used=used, scaled=scaled)

    def trial(self, sigma: Array) -> Trial:
        """Return possible next readings, given noise ``sigma`` (n,) of the campaign's readings."""
        return self.readings.trial(sigma[: len(self.readings.campaign)])

    def remarks(self, noise: Noise, unexplained: Array) -> tuple[str, ...]:
        """Return remarks on silent responses, and on the static readings' residuals."""
        silent = [text for each in self.responses for text in find_silent(each)]
        count = len(self.readings.campaign)
        if not count:
            return tuple(silent)
        own = replace(
            noise,
            sigma=noise.sigma[:count],
            used=noise.used[:count],
            scaled=noise.scaled[:count],
        )
        return (*silent, *self.readings.remarks(own, unexplained[:count]))
