"""Scatter of the lines of measured responses: what coherence tells, and neighbouring lines.

References
----------
J. S. Bendat, A. G. Piersol, Random Data, 4th ed., Wiley 2010, sect. 9.2 (random errors).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import median_filter

if TYPE_CHECKING:
    from stiffscope.responses.model import Response
    from stiffscope.runtime.types import Array


@dataclass(frozen=True)
class ScatterSettings:
    """How scatter is estimated.

    Attributes
    ----------
    half_width
        Lines on either side of one that a resonance is fitted to.
    smoothed
        Lines over which the level of scatter is taken as the same.
    least_lines
        Lines of a response, of which fewer tell no scatter.
    least, most
        Relative scatter beyond which none is believed; ``least`` also of the median level.
    usual
        Relative scatter where neither coherence nor neighbours tell one.
    """

    half_width: int = 4
    smoothed: int = 31
    least_lines: int = 24
    least: float = 1e-6
    most: float = 10.0
    usual: float = 0.02


SETTINGS = ScatterSettings()
_PARAMETERS = 3  # complex, of a resonance: (a + b x) / (1 + c x)


def find_scatter(
    response: Response, averages: int, settings: ScatterSettings = SETTINGS
) -> Array:
    """Return the standard deviation (n,) of the real, and of the imaginary part of each line.

    Coherence γ² of n averages tells ``σ = |H| √((1 - γ²) / (2 n γ²))`` of a line, up to a factor
    common to all lines that neighbouring lines tell: averages may be stated wrongly. A line of
    exactly zero was not measured: its scatter is the largest level of all lines.

    Parameters
    ----------
    response
        One response, not zero at every line.
    averages
        Averages behind each line.
    """
    size = np.abs(response.receptance)
    known = size > 0.0
    scatter = _estimate(response, averages, settings)
    floor = settings.least * float(np.median(size[known]))
    return np.where(known, np.maximum(scatter, floor), size.max())


def _estimate(response: Response, averages: int, settings: ScatterSettings) -> Array:
    """Return the scatter (n,) of lines in proportion to their size; 0 of a line that is zero."""
    size = np.abs(response.receptance)
    beside = _compare_neighbours(response, settings)
    coherence = response.coherence
    if coherence is None or not (coherence < 1.0).any():
        if beside is None:
            return settings.usual * size
        level = median_filter(beside, settings.smoothed, mode="nearest")
        return np.clip(level, settings.least * size, settings.most * size)
    heard = coherence.clip(1e-3, 1.0 - 1e-9)
    told = np.sqrt((1.0 - heard) / (2.0 * averages * heard))
    told = median_filter(told, 5, mode="nearest")
    if beside is not None:
        known = size > 0.0
        told = told * float(np.median(beside[known] / size[known] / told[known]))
    # a line that noise happens to make small tells no less noise than its neighbours
    level = np.maximum(size, median_filter(size, 5, mode="nearest"))
    return level * np.clip(told, settings.least, settings.most)


def _compare_neighbours(response: Response, settings: ScatterSettings) -> Array | None:
    """Return the scatter (n,) of each line about a resonance through its neighbours.

    ``H (1 + c x) = a + b x`` in the distance x from the line is linear in a, b, c. None if the
    lines are too few.
    """
    values = response.receptance
    n = len(values)
    if n < settings.least_lines:
        return None
    width = 2 * settings.half_width + 1
    start = np.clip(np.arange(n) - settings.half_width, 0, n - width)
    index = start[:, None] + np.arange(width)
    here = values[index]
    x = response.frequency[index] - response.frequency[:, None]
    x = x / np.abs(x).max(axis=1, keepdims=True)
    level = np.abs(here).max(axis=1, keepdims=True)
    here = here / np.where(level > 0.0, level, 1.0)
    columns = np.stack([np.ones_like(here), x + 0j, -here * x], axis=2)
    solved = np.linalg.pinv(columns, rcond=1e-8) @ here[..., None]
    denominator = 1.0 + solved[:, 2] * x
    left = here - (columns @ solved)[..., 0]
    left = left / np.where(np.abs(denominator) > 0.3, denominator, 0.3)
    squares = np.sum(np.abs(left) ** 2, axis=1)
    freedom = 2 * (width - _PARAMETERS)
    return level[:, 0] * np.sqrt(squares / freedom)
