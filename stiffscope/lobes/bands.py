"""Bands of the stable depth, from the bounds of frequencies, damping and cutting force.

All are taken as independent and log-normal: a relative 95 % bound e is a standard deviation of
ln(1 + e) / 1.96 of the logarithm. Frequencies change by stiffness: mode shapes are kept.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from stiffscope.lobes.limits import Limits
    from stiffscope.lobes.methods import Method
    from stiffscope.lobes.response import ToolResponse
    from stiffscope.runtime.types import Array

NORMAL = 1.959964  # 97.5 % quantile of the normal distribution
BENT = 1.1  # of interrupted cuts: chosen, as 92 % of planted machines lie within one


def spread(bound: Array) -> Array:
    """Return the standard deviation of the logarithm for relative 95 % bounds."""
    return np.log1p(bound) / NORMAL


def relative_error(
    limits: Limits, response: ToolResponse, force_error: float, method: Method
) -> Array:
    """Return the 95 % half width (n, …) of ln(depth).

    Parameters
    ----------
    limits
        Limits (n, …) of the response at n poses.
    response
        Response of the tool, with the bounds of its frequencies and damping ratios.
    force_error
        Relative 95 % bound of the cutting force.
    method
        Of the limits; those of all harmonics vary less linearly.
    """
    shape = (len(response), *[1] * (limits.depth.ndim - 1), -1)
    rate = spread(response.frequency_error).reshape(shape)
    ratio = spread(response.damping_error).reshape(shape)
    variance = (limits.relative_change(limits.by_rate) * rate) ** 2
    variance = variance + (limits.relative_change(limits.by_damping) * ratio) ** 2
    whole = variance.sum(axis=-1) + spread(np.array(force_error)) ** 2
    factor = BENT if method == "all-harmonics" else 1.0
    return factor * NORMAL * np.sqrt(whole)
