"""Bands of the stable depth, from the bounds of frequencies, damping and cutting force.

All are taken as independent and log-normal: a relative 95 % bound e is a standard deviation of
ln(1 + e) / 1.96 of the logarithm. Frequencies change by stiffness: mode shapes are kept.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.lobes.zero_order import (
    frequency_grid,
    mode_terms,
    mode_total,
    zero_order_depth,
)

if TYPE_CHECKING:
    from stiffscope.lobes.engagement import Engagement
    from stiffscope.lobes.response import ToolResponse
    from stiffscope.lobes.zero_order import Critical
    from stiffscope.runtime.types import Array

NORMAL = 1.959964  # 97.5 % quantile of the normal distribution
_DRAWS = 159  # the 4th least and 4th greatest enclose 95 % in expectation
_TAIL = 4
_SEED = 20


def spread(bound: Array) -> Array:
    """Return the standard deviation of the logarithm for relative 95 % bounds."""
    return np.log1p(bound) / NORMAL


def critical_error(
    response: ToolResponse, cut: Engagement, critical: Critical, force_error: float
) -> Array:
    """Return the 95 % half width (n,) of ln(depth) of the limit that holds at any speed.

    λ is stationary in its eigenvectors, so that it changes by the terms of the modes alone:
    ``∂ln H / ∂ln ω_k = -2 ω_k (ω_k + iζω) H`` and ``∂ln H / ∂ln ζ_k = -2iζ ω_k ω H``.

    Parameters
    ----------
    response, cut, critical
        Response of the tool, engagement, and `find_critical` of both.
    force_error
        Relative 95 % bound of the cutting force.
    """
    omega = critical.omega[:, None]
    terms = mode_terms(response, cut, critical.omega)
    modal = response.modal(omega)[:, 0]
    rates = response.rates
    share = terms / mode_total(response, cut, critical.omega)[:, None]
    by_rate = -2.0 * rates * (rates + 1j * response.damping * omega) * modal * share
    by_damping = -2j * response.damping * rates * omega * modal * share
    rate = critical.relative_change(by_rate) * spread(response.frequency_error)
    ratio = critical.relative_change(by_damping) * spread(response.damping_error)
    variance = (rate**2 + ratio**2).sum(axis=1) + spread(np.array(force_error)) ** 2
    return NORMAL * np.sqrt(variance)


def draw_responses(
    response: ToolResponse, count: int, seed: int = _SEED
) -> ToolResponse:
    """Return draws (count,) of the response at one pose within its bounds."""
    rng = np.random.default_rng(seed)
    shape = (count, response.squares.shape[1])
    rate = np.exp(rng.normal(size=shape) * spread(response.frequency_error))
    ratio = np.exp(rng.normal(size=shape) * spread(response.damping_error))
    return replace(
        response,
        squares=response.squares * rate**2,
        damping=np.minimum(response.damping * ratio, 0.95),
        shapes=np.repeat(response.shapes, count, axis=0),
        remainder=np.repeat(response.remainder, count, axis=0),
        frequency_error=np.repeat(response.frequency_error, count, axis=0),
        damping_error=np.repeat(response.damping_error, count, axis=0),
        origin=None,
    )


def depth_band(
    response: ToolResponse, cut: Engagement, speeds: Array, force_error: float
) -> tuple[Array, Array]:
    """Return the 95 % band (s,), (s,) of the zero-order depth at one pose, m, by draws."""
    drawn = draw_responses(response, _DRAWS)
    force = np.random.default_rng(_SEED + 1).normal(size=_DRAWS)
    factor = np.exp(force * spread(np.array(force_error)))
    depth = (
        zero_order_depth(drawn, cut, speeds, frequency_grid(drawn)) / factor[:, None]
    )
    ordered = np.sort(depth, axis=0)
    return ordered[_TAIL - 1], ordered[-_TAIL]
