"""Gain of what measures frequency responses: an accelerometer, one of its directions, or the hammer."""

from __future__ import annotations

from dataclasses import dataclass

from stiffscope.gap.effects.effect import (
    GROWTH,
    Array,
    Candidates,
    Effect,
    Influence,
    Parameter,
    Place,
    Setting,
)

HAMMER = "hammer"
"""Place of a gain of all channels: it is that of the force, the other way round."""


@dataclass(frozen=True)
class ResponseGain(Effect):
    """Factor by which channels of responses show more than the true motion; -1 of a reversed one.

    A wrong calibration or unit scales all lines of a channel, which no change of the robot does.
    """

    word = "response-gain"
    precedence = 162
    merges = False
    parameters = (Parameter("factor", "1", 0.1),)
    conversion = GROWTH

    channels: tuple[str, ...]
    """As `name_channel` names them."""

    @classmethod
    def candidates(cls, setting: Setting) -> Candidates:
        """Yield all channels together, each point with several of them, and each alone."""
        every = setting.channels
        by_point: dict[str, list[str]] = {}
        for channel, point in every.items():
            by_point.setdefault(point, []).append(channel)
        if len(by_point) > 1:
            yield cls(tuple(every)).make_candidate(Place(HAMMER, tuple(every)))
        for point, channels in by_point.items():
            if len(channels) > 1:
                place = Place(point, tuple(channels))
                yield cls(tuple(channels)).make_candidate(place)
        for channel in every:
            yield cls((channel,)).make_candidate(Place(channel))

    def influence(self, values: Array) -> Influence:
        """Return the relative excess of the channels."""
        return Influence(response_gains=dict.fromkeys(self.channels, float(values[0])))
