"""Modes of each set-up of responses, measured, before and after, and the gap in dB and Hz.

A measured mode is a maximum of the rms level of all responses of a set-up; its shape is the vector
of their values there. Measured and computed modes are paired by shape (MAC), never by order.

References
----------
D. J. Ewins, Modal Testing, 2nd ed., Research Studies Press 2000, sect. 4.3, 5.4 (MAC).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import repeat
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import linear_sum_assignment

from stiffscope.gap.campaign.response_lines import find_peaks
from stiffscope.gap.forward.joint_model import JointModel
from stiffscope.gap.inference.diagnosis import (
    ResponseLines,
    ResponseModes,
    SetupModes,
)
from stiffscope.gap.inference.residuals import AbsoluteGap, split_by_kind
from stiffscope.responses.checks import name_response

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from stiffscope.gap.forward.response_state import ResponseState
    from stiffscope.gap.inference.findings import Findings
    from stiffscope.gap.inference.hypothesis import Hypothesis
    from stiffscope.responses.model import Response
    from stiffscope.runtime.types import Array, Complex, Flags

_FAR = 2.0  # ratio of frequencies of modes that are not paired
_DECIBEL = 20.0 / np.log(10.0)


@dataclass(frozen=True)
class _Levels:
    """Differences of levels (m,), dB, and their noise."""

    before: Array
    after: Array
    noise: Array


def describe_responses(
    findings: Findings, reported: Hypothesis
) -> tuple[dict[str, SetupModes], dict[str, AbsoluteGap]]:
    """Return the modes of each set-up, and the absolute gaps of lines (dB) and modes (Hz).

    Beside readings of frequencies, which have the gap "frequency", that of modes is "mode frequency".

    Parameters
    ----------
    findings
        The search; nothing is returned without responses.
    reported
        Hypothesis whose effects are reported.
    """
    model = findings.model
    if not isinstance(model, JointModel):
        return {}, {}
    blocks: dict[str, list[tuple[ResponseState, ResponseState]]] = {}
    pairs = zip(
        model.predict().states, model.predict(reported.parameters).states, strict=True
    )
    for before, after in pairs:
        name = before.block.measured.setup.name
        blocks.setdefault(name, []).append((before, after))
    setups = dict[str, SetupModes]()
    levels = list[_Levels]()
    for name, states in blocks.items():
        own = [_compare_levels(before, after) for before, after in states]
        levels += own
        before, after = zip(*states, strict=True)
        lines = tuple(line for pair in states for line in _compare_lines(*pair))
        setups[name] = SetupModes(
            tuple(_pair_modes(before, after)), *_sizes(own), lines=lines
        )
    beside = "mode " if "frequency" in split_by_kind(findings.campaign) else ""
    return setups, _find_gaps(levels, setups, f"{beside}frequency")


def _compare_lines(
    before: ResponseState, after: ResponseState
) -> Iterator[ResponseLines]:
    """Yield the responses of a block at all their lines."""
    block = before.block
    responses = block.measured.responses
    hertz = responses[0].frequency
    predicted = zip(
        before.predict_lines(hertz), after.predict_lines(hertz), strict=True
    )
    for k, (response, (first, last)) in enumerate(
        zip(responses, predicted, strict=True)
    ):
        # the scatter of used lines, relative to their levels
        noise = np.interp(hertz, block.frequency, block.noise[k])
        name = name_response(response)
        yield ResponseLines(name, hertz, response.receptance, first, last, noise)


def _compare_levels(before: ResponseState, after: ResponseState) -> _Levels:
    """Return differences of levels at the lines that are more than noise.

    A predicted level is at least that of the noise, as at nodes of modes, where it is zero.
    """
    block = before.block
    size = np.abs(block.value)
    heard = size > 2.0 * block.sigma
    level = np.log(np.where(heard, size, 1.0))
    predicted = (
        np.maximum(np.abs(block.read(state.lines)), block.sigma)
        for state in (before, after)
    )
    first, last = (_DECIBEL * (np.log(mode) - level)[heard] for mode in predicted)
    noise = _DECIBEL * (block.sigma / np.where(heard, size, 1.0))[heard]
    return _Levels(first, last, noise)


def _pair_modes(
    before: Sequence[ResponseState], after: Sequence[ResponseState]
) -> Iterator[ResponseModes]:
    """Yield the measured modes of all blocks of a set-up with the computed ones of the same shape."""
    responses = [
        response for state in before for response in state.block.measured.responses
    ]
    spread, measured = _spread_lines(responses)
    peaks = find_peaks(spread)
    hertz = spread[0].frequency[peaks]
    shapes = np.array([response.receptance[peaks] for response in spread])
    heard = measured[:, peaks]
    sides = [_match(hertz, shapes, heard, states) for states in (before, after)]
    for k, frequency in enumerate(hertz.tolist()):
        (first, mac_before, _), (last, mac_after, ratio) = (side[k] for side in sides)
        yield ResponseModes(frequency, first, last, ratio, mac_before, mac_after)


def _spread_lines(responses: Sequence[Response]) -> tuple[list[Response], Flags]:
    """Return responses at the lines (f,) of all of them, and where each was measured (r, f).

    Between its own lines a response is interpolated, beyond them it is zero.
    """
    hertz = np.unique(np.concatenate([response.frequency for response in responses]))
    measured = np.array(
        [
            (hertz >= response.frequency[0]) & (hertz <= response.frequency[-1])
            for response in responses
        ]
    )
    pairs = zip(responses, measured, strict=True)
    return [_spread(each, hertz, inside) for each, inside in pairs], measured


def _spread(response: Response, hertz: Array, inside: Flags) -> Response:
    """Return a response at other lines (f,), zero where they are not inside its own."""
    lines = response.frequency
    values = np.where(inside, np.interp(hertz, lines, response.receptance), 0.0)
    coherence = response.coherence
    if coherence is not None:
        coherence = np.interp(hertz, lines, coherence)
    return replace(response, frequency=hertz, receptance=values, coherence=coherence)


def _find_ratios(states: Sequence[ResponseState]) -> Array:
    """Return the damping ratio (c,) of each mode, from the block whose lines show it."""
    ratios = states[0].damping.copy()
    for state in states[1:]:
        lines = state.block.frequency
        frequencies = state.frequencies
        inside = (frequencies >= lines[0]) & (frequencies <= lines[-1])
        ratios[inside] = state.damping[inside]
    return ratios


def _match(
    hertz: Array, shapes: Complex, heard: Flags, states: Sequence[ResponseState]
) -> list[tuple[float, float, float]]:
    """Return frequency, MAC and damping ratio of the computed mode of each measured one; NaN if none.

    Shapes (r, k) are compared where they were measured, ``heard`` (r, k).
    """
    modes = states[0].frequencies
    inside = np.isfinite(modes)
    products = [
        state.ports[force] * state.ports[motion]
        for state in states
        for force, motion in [state.pairs.T]
    ]
    parts = np.concatenate(products)[:, inside]
    frequencies = modes[inside]
    ratios = _find_ratios(states)[inside]
    product = np.abs(shapes.conj().T @ parts) ** 2
    size = np.sum(np.abs(shapes) ** 2, axis=0)[:, None] * (heard.T @ parts**2)
    mac = np.divide(product, size, out=np.zeros_like(product), where=size > 0.0)
    apart = np.abs(np.log(frequencies.clip(min=1e-300) / hertz[:, None]))
    mac = np.where(apart <= np.log(_FAR), mac, 0.0)
    unpaired = math.nan, math.nan, math.nan
    out = list(repeat(unpaired, len(hertz)))
    # of equal shapes, the nearer frequency
    rows, columns = linear_sum_assignment(0.1 * apart.clip(max=1.0) - mac)
    for row, column in zip(rows.tolist(), columns.tolist(), strict=True):
        if mac[row, column] > 0.0:
            pairs = frequencies[column], mac[row, column], ratios[column]
            out[row] = tuple(map(float, pairs))  # type: ignore[assignment]
    return out


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else float("nan")


def _sizes(levels: Sequence[_Levels]) -> list[float]:
    """Return the rms of differences before, after, and by noise."""
    return [
        _rms(np.concatenate([getattr(level, side) for level in levels]))
        for side in ("before", "after", "noise")
    ]


def _find_gaps(
    levels: Sequence[_Levels], setups: dict[str, SetupModes], name: str
) -> dict[str, AbsoluteGap]:
    """Return the gaps of lines in dB, and of modes, by this name, in Hz and relative."""
    nan = float("nan")
    before, after, noise = _sizes(levels)
    out = {"response": AbsoluteGap("dB", before, after, nan, noise)}
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
        out[name] = AbsoluteGap("Hz", *sizes, nan, nan)
        out[f"{name}_relative"] = AbsoluteGap("1", *shares, nan, nan)
    return out
