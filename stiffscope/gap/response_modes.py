"""Modes of each set-up of responses, measured, before and after, and the gap in dB and Hz.

A measured mode is a maximum of the rms level of all responses of a set-up; its shape is the vector
of their values there. Measured and computed modes are paired by shape (MAC), never by order.

References
----------
D. J. Ewins, Modal Testing, 2nd ed., Research Studies Press 2000, sect. 4.3, 5.4 (MAC).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import linear_sum_assignment

from stiffscope.gap.campaign.response_lines import find_peaks
from stiffscope.gap.forward.joint_model import JointModel
from stiffscope.gap.inference.diagnosis import ResponseModes, SetupModes
from stiffscope.gap.inference.residuals import AbsoluteGap

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from stiffscope.gap.forward.response_state import ResponseState
    from stiffscope.gap.inference.findings import Findings
    from stiffscope.gap.inference.hypothesis import Hypothesis
    from stiffscope.runtime.types import Array, Complex

_FAR = 2.0  # ratio of frequencies of modes that are not paired
_DECIBEL = 20.0 / np.log(10.0)


@dataclass(frozen=True)
class _Levels:
    """Differences of levels (m,), dB, and their noise."""

    before: Array
    after: Array
    noise: Array


def describe_responses(
    found: Findings, reported: Hypothesis
) -> tuple[dict[str, SetupModes], dict[str, AbsoluteGap]]:
    """Return the modes of each set-up, and the absolute gaps of lines (dB) and modes (Hz).

    Parameters
    ----------
    found
        The search; nothing is returned without responses.
    reported
        Hypothesis whose effects are reported.
    """
    model = found.model
    if not isinstance(model, JointModel):
        return {}, {}
    setups = dict[str, SetupModes]()
    levels = list[_Levels]()
    pairs = zip(
        model.predict().states, model.predict(reported.parameters).states, strict=True
    )
    for before, after in pairs:
        name = before.block.measured.setup.name
        own = _compare_levels(before, after)
        levels.append(own)
        rows = tuple(_pair_modes(before, after))
        known = setups.get(name)
        sizes = _rms(own.before), _rms(own.after), _rms(own.noise)
        if known is None:
            setups[name] = SetupModes(rows, *sizes)
    return setups, _find_gaps(levels, setups)


def _compare_levels(before: ResponseState, after: ResponseState) -> _Levels:
    """Return differences of levels at the lines that are more than noise."""
    block = before.block
    size = np.abs(block.value)
    heard = size > 2.0 * block.sigma
    level = np.log(np.where(heard, size, 1.0))
    first, last = (
        _DECIBEL * (np.log(np.abs(block.read(state.lines)[heard])) - level[heard])
        for state in (before, after)
    )
    noise = _DECIBEL * (block.sigma / np.where(heard, size, 1.0))[heard]
    return _Levels(first, last, noise)


def _pair_modes(before: ResponseState, after: ResponseState) -> Iterator[ResponseModes]:
    """Yield the measured modes with the computed ones of the same shape."""
    responses = before.block.measured.responses
    peaks = find_peaks(responses)
    hertz = responses[0].frequency[peaks]
    shapes = np.array([response.receptance[peaks] for response in responses])
    sides = [_match(hertz, shapes, state) for state in (before, after)]
    for k, frequency in enumerate(hertz.tolist()):
        (first, mac_before, _), (last, mac_after, ratio) = (side[k] for side in sides)
        yield ResponseModes(frequency, first, last, ratio, mac_before, mac_after)


def _match(
    hertz: Array, shapes: Complex, state: ResponseState
) -> list[tuple[float, float, float]]:
    """Return frequency, MAC and damping ratio of the computed mode of each measured one; NaN if none."""
    force, motion = state.pairs.T
    inside = np.isfinite(state.frequencies)
    parts = (state.ports[force] * state.ports[motion])[:, inside]
    own = state.frequencies[inside]
    ratios = state.damping[inside]
    product = np.abs(shapes.conj().T @ parts) ** 2
    size = np.sum(np.abs(shapes) ** 2, axis=0)[:, None] * np.sum(parts**2, axis=0)
    mac = np.divide(product, size, out=np.zeros_like(product), where=size > 0.0)
    apart = np.abs(np.log(own.clip(min=1e-300) / hertz[:, None]))
    mac = np.where(apart <= np.log(_FAR), mac, 0.0)
    out = [(float("nan"), float("nan"), float("nan"))] * len(hertz)
    # of equal shapes, the nearer frequency
    rows, columns = linear_sum_assignment(0.1 * apart.clip(max=1.0) - mac)
    for row, column in zip(rows.tolist(), columns.tolist(), strict=True):
        if mac[row, column] > 0.0:
            found = own[column], mac[row, column], ratios[column]
            out[row] = tuple(map(float, found))  # type: ignore[assignment]
    return out


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else float("nan")


def _find_gaps(
    levels: Sequence[_Levels], setups: dict[str, SetupModes]
) -> dict[str, AbsoluteGap]:
    """Return the gaps of lines in dB, and of modes in Hz and relative."""
    nan = float("nan")
    joined = [
        _rms(np.concatenate([getattr(each, side) for each in levels]))
        for side in ("before", "after", "noise")
    ]
    out = {"response": AbsoluteGap("dB", joined[0], joined[1], nan, joined[2])}
    rows = [
        (mode.measured, mode.before, mode.after)
        for setup in setups.values()
        for mode in setup.modes
        if np.isfinite([mode.before, mode.after]).all()
    ]
    if rows:
        measured, before, after = np.array(rows).T
        sizes = _rms(before - measured), _rms(after - measured)
        shares = _rms(before / measured - 1.0), _rms(after / measured - 1.0)
        out["frequency"] = AbsoluteGap("Hz", *sizes, nan, nan)
        out["frequency_relative"] = AbsoluteGap("1", *shares, nan, nan)
    return out
