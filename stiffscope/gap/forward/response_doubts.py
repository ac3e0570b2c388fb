"""Channels of measured responses that differ from the model by a gain or a sign alone.

A robot that is softer or heavier than its model changes a response differently below and above a
resonance. A factor common to all lines is a unit, a calibration or a reversed sensor.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.responses.checks import SETTINGS as CHECKS
from stiffscope.responses.checks import find_resonances, name_response

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from stiffscope.gap.forward.response_model import ComparedResponses
    from stiffscope.responses.model import Response
    from stiffscope.runtime.types import Flags


@dataclass(frozen=True)
class ChannelSettings:
    """When a response differs by a gain or a sign.

    Attributes
    ----------
    gain
        Least median difference of the levels, dB: a factor of 2.
    spread
        Largest interquartile range of that difference, dB.
    turned
        Least share of lines with a phase that is nearer to the opposite of the model's.
    sides
        Least share of lines on either side of a resonance.
    falls
        Largest median motion above the resonance, relative to that below it: less, and inertia
        decides above it, as stiffness does below.
    """

    gain: float = 6.0
    spread: float = 2.0
    turned: float = 0.9
    sides: float = 0.3
    falls: float = 0.5


SETTINGS = ChannelSettings()


def find_channel_doubts(
    compared: ComparedResponses, settings: ChannelSettings = SETTINGS
) -> list[str]:
    """Return doubts on gains and signs against the model, a line each."""
    doubts = list[str]()
    pairs = zip(
        compared.measured.responses, compared.predicted.receptances, strict=True
    )
    for response, predicted in pairs:
        heard = find_heard_lines(response, predicted)
        if heard.any() and _spans_resonance(response, heard, settings):
            ratio = response.receptance[heard] / predicted[heard]
            doubts += _doubt_ratio(name_response(response), ratio, settings)
    return doubts


def find_heard_lines(response: Response, predicted: NDArray[np.complex128]) -> Flags:
    """Return flags (n,) of lines with a measured and a predicted motion that is not noise."""
    heard = (np.abs(response.receptance) > 0.0) & (np.abs(predicted) > 0.0)
    if response.coherence is not None:
        heard &= response.coherence >= CHECKS.silent
    return heard


def _spans_resonance(
    response: Response, heard: Flags, settings: ChannelSettings
) -> bool:
    """Return whether the lines show stiffness below and inertia above a resonance."""
    lines = response.frequency[heard]
    size = np.abs(response.receptance[heard])
    for peak in response.frequency[find_resonances(response)]:
        below: Flags = np.less(lines, peak)
        share = float(np.mean(below))
        if not settings.sides <= share <= 1.0 - settings.sides:
            continue
        if np.median(size[~below]) <= settings.falls * np.median(size[below]):
            return True
    return False


def _doubt_ratio(
    name: str, ratio: NDArray[np.complex128], settings: ChannelSettings
) -> Iterator[str]:
    levels = 20.0 * np.log10(np.abs(ratio))
    low, middle, high = np.percentile(levels, [25.0, 50.0, 75.0]).tolist()
    if abs(middle) >= settings.gain and high - low <= settings.spread:
        factor = 10.0 ** (middle / 20.0)
        yield (
            f"{name}: {factor:.3g} times the model's on both sides of a resonance: "
            "a unit or a calibration?"
        )
    turned = float(np.mean(ratio.real < 0.0))
    if turned >= settings.turned:
        yield (
            f"{name}: opposite to the model's at {100 * turned:.0f} % of the lines: "
            "is a direction reversed?"
        )
