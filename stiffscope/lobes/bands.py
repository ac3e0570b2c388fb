"""Bands of the stable depth, from the bounds of frequencies, damping and cutting force.

All are taken as independent and log-normal: a relative 95 % bound e is a standard deviation of
ln(1 + e) / 1.96 of the logarithm. Frequencies change by stiffness: mode shapes are kept.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from stiffscope.lobes.limits import Limits
    from stiffscope.lobes.response import ToolResponse
    from stiffscope.runtime.types import Array

NORMAL = 1.959964  # 97.5 % quantile of the normal distribution


def spread(bound: Array) -> Array:
    """Return the standard deviation of the logarithm for relative 95 % bounds."""
    return np.log1p(bound) / NORMAL


def relative_error(limits: Limits, response: ToolResponse, force_error: float) -> Array:
    """Return the 95 % half width (n, …) of ln(depth).

    Parameters
    ----------
    limits
        Limits (n, …) of the response at n poses.
    response
        Response of the tool, with the bounds of its frequencies and damping ratios.
    force_error
        Relative 95 % bound of the cutting force.
    """
    shape = (len(response), *[1] * (limits.depth.ndim - 1), -1)
    rate = spread(response.frequency_error).reshape(shape)
    ratio = spread(response.damping_error).reshape(shape)
    variance = (limits.relative_change(limits.by_rate) * rate) ** 2
    variance = variance + (limits.relative_change(limits.by_damping) * ratio) ** 2
    whole = variance.sum(axis=-1) + spread(np.array(force_error)) ** 2
    return NORMAL * np.sqrt(whole)
