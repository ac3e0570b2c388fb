"""Modes of each set-up of responses, measured, before and after, and the gap in dB and Hz.

A measured mode is a maximum of the rms level of all responses of a set-up; its shape is the vector
of their values there, and that of a computed mode the vector of predicted values at its frequency.
Measured and computed modes are paired by shape (MAC), never by order.

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

from stiffscope.errors import InputError
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

    from stiffscope.gap.forward.forward_model import Parameters
    from stiffscope.gap.forward.response_state import ResponseState
    from stiffscope.gap.inference.findings import Findings
    from stiffscope.gap.inference.hypothesis import Hypothesis
    from stiffscope.responses.model import Response
    from stiffscope.runtime.types import Array, Complex, Flags

_FAR = 2.0  # ratio of frequencies of modes that are not paired
_APART = 0.25  # MAC that makes up for frequencies 1 apart, in ln
_DECIBEL = 20.0 / np.log(10.0)


@dataclass(frozen=True)
class _Levels:
    """Differences of levels (m,), dB, and their noise."""

    before: Array
    after: Array
    held_out: Array
    noise: Array


def describe_responses(
    found: Findings, reported: Hypothesis
) -> tuple[dict[str, SetupModes], dict[str, AbsoluteGap]]:
    """Return the modes of each set-up, and the absolute gaps of lines (dB) and modes (Hz).

    Beside readings of frequencies, which have the gap "frequency", that of modes is "mode frequency".

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
    sound = _group_by_setup(model.predict().states)
    explained = _group_by_setup(model.predict(reported.parameters).states)
    setups = dict[str, SetupModes]()
    levels = list[_Levels]()
    rows = list[tuple[float, float, float, float]]()
    first = len(model.campaign.pose_names) - len(sound)  # their poses are the last
    for pose, (name, before) in enumerate(sound.items(), start=first):
        after = explained[name]
        without = after
        if reported.parameters:
            parameters = found.find_parameters_without(reported, pose)
            without = _predict_setup(model, parameters, name)
        own = [
            _compare_levels(one, other, third)
            for one, other, third in zip(before, after, without or after, strict=True)
        ]
        if not without:
            own = [replace(each, held_out=np.full(1, np.nan)) for each in own]
        levels += own
        pairs = zip(before, after, strict=True)
        lines = tuple(line for pair in pairs for line in _compare_lines(*pair))
        peaks = _find_measured(before)
        modes = tuple(_pair_modes(peaks, before, after))
        nan = float("nan")
        unseen = [mode.frequency for mode in _list_modes(peaks, without)]
        rows += [
            (mode.measured, mode.before, mode.after, other)
            for mode, other in zip(
                modes, unseen or repeat(nan, len(modes)), strict=True
            )
        ]
        sizes = _sizes(own)
        setups[name] = SetupModes(
            modes, sizes.before, sizes.after, sizes.noise, lines=lines
        )
    beside = "mode " if "frequency" in split_by_kind(found.campaign) else ""
    return setups, _find_gaps(levels, rows, f"{beside}frequency")


def _group_by_setup(
    states: Sequence[ResponseState],
) -> dict[str, list[ResponseState]]:
    """Return the states of each set-up, by name."""
    out = dict[str, "list[ResponseState]"]()
    for state in states:
        out.setdefault(state.block.measured.setup.name, []).append(state)
    return out


def _predict_setup(
    model: JointModel, parameters: Parameters | None, name: str
) -> list[ResponseState]:
    """Return the states of a set-up with these parameters; none if they are not to be had."""
    if parameters is None:
        return []
    try:
        return _group_by_setup(model.predict(parameters).states)[name]
    except InputError:  # beyond what can be assembled
        return []


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


def _compare_levels(
    before: ResponseState, after: ResponseState, without: ResponseState
) -> _Levels:
    """Return differences of levels at the lines that are more than noise.

    A predicted level is at least that of the noise, as at nodes of modes, where it is zero.
    """
    block = before.block
    size = np.abs(block.value)
    heard = size > 2.0 * block.sigma
    level = np.log(np.where(heard, size, 1.0))
    predicted = (
        np.maximum(np.abs(block.read(state.lines)), block.sigma)
        for state in (before, after, without)
    )
    first, last, other = (
        _DECIBEL * (np.log(each) - level)[heard] for each in predicted
    )
    noise = _DECIBEL * (block.sigma / np.where(heard, size, 1.0))[heard]
    return _Levels(first, last, other, noise)


@dataclass(frozen=True, eq=False)
class _Peaks:
    """Measured modes (k,) of a set-up: frequencies, shapes (r, k), and where these were measured."""

    hertz: Array
    shapes: Complex
    heard: Flags


@dataclass(frozen=True)
class _Match:
    """A measured mode and the computed one of the same shape; NaN if there is none."""

    measured: float
    frequency: float
    mac: float
    damping: float


def _pair_modes(
    peaks: _Peaks, before: Sequence[ResponseState], after: Sequence[ResponseState]
) -> Iterator[ResponseModes]:
    """Yield the measured modes with the computed ones of the same shape."""
    pairs = zip(_list_modes(peaks, before), _list_modes(peaks, after), strict=True)
    for first, last in pairs:
        yield ResponseModes(
            first.measured,
            first.frequency,
            last.frequency,
            last.damping,
            first.mac,
            last.mac,
        )


def _find_measured(states: Sequence[ResponseState]) -> _Peaks:
    """Return the measured modes of all blocks of a set-up."""
    responses = [each for state in states for each in state.block.measured.responses]
    spread, measured = _spread_lines(responses)
    peaks = find_peaks(spread)
    hertz = spread[0].frequency[peaks]
    shapes = np.array([response.receptance[peaks] for response in spread])
    return _Peaks(hertz, shapes, measured[:, peaks])


def _list_modes(peaks: _Peaks, states: Sequence[ResponseState]) -> list[_Match]:
    """Return the measured modes, matched with those of states; nothing without states."""
    if not states:
        return []
    found = _match(peaks.hertz, peaks.shapes, peaks.heard, states)
    return [
        _Match(frequency, *own)
        for frequency, own in zip(peaks.hertz.tolist(), found, strict=True)
    ]


def _spread_lines(responses: Sequence[Response]) -> tuple[list[Response], Flags]:
    """Return responses at the lines (f,) of all of them, and where each was measured (r, f).

    Between its own lines a response is interpolated, beyond them it is zero.
    """
    hertz = np.unique(np.concatenate([each.frequency for each in responses]))
    measured = np.array(
        [
            (hertz >= each.frequency[0]) & (hertz <= each.frequency[-1])
            for each in responses
        ]
    )
    pairs = zip(responses, measured, strict=True)
    return [_spread(each, hertz, inside) for each, inside in pairs], measured


def _spread(response: Response, hertz: Array, inside: Flags) -> Response:
    """Return a response at other lines (f,), zero where they are not inside its own."""
    own = response.frequency
    values = np.where(inside, np.interp(hertz, own, response.receptance), 0.0)
    coherence = response.coherence
    if coherence is not None:
        coherence = np.interp(hertz, own, coherence)
    return replace(response, frequency=hertz, receptance=values, coherence=coherence)


def _find_ratios(states: Sequence[ResponseState]) -> Array:
    """Return the damping ratio (c,) of each mode, from the block whose lines show it."""
    ratios = states[0].damping.copy()
    for state in states[1:]:
        lines = state.block.frequency
        own = state.frequencies
        inside = (own >= lines[0]) & (own <= lines[-1])
        ratios[inside] = state.damping[inside]
    return ratios


def _match(
    hertz: Array, shapes: Complex, heard: Flags, states: Sequence[ResponseState]
) -> list[tuple[float, float, float]]:
    """Return frequency, MAC and damping ratio of the computed mode of each measured one; NaN if none.

    Shapes (r, k) are compared where they were measured, ``heard`` (r, k).
    """
    if not len(hertz):
        return []
    modes = states[0].frequencies
    inside = (modes > hertz.min() / _FAR) & (modes < hertz.max() * _FAR)
    own = modes[inside]
    # both as heard at a resonance, with the tails of the modes beside it
    parts = np.concatenate(
        [state.predict_lines(own, usual=state.is_far) for state in states]
    )
    ratios = _find_ratios(states)[inside]
    product = np.abs(shapes.conj().T @ parts) ** 2
    size = np.sum(np.abs(shapes) ** 2, axis=0)[:, None] * (heard.T @ np.abs(parts) ** 2)
    mac = np.divide(product, size, out=np.zeros_like(product), where=size > 0.0)
    apart = np.abs(np.log(own / hertz[:, None]))
    mac = np.where(apart <= np.log(_FAR), mac, 0.0)
    unpaired = math.nan, math.nan, math.nan
    out = list(repeat(unpaired, len(hertz)))
    # of shapes about as alike, the nearer frequency
    rows, columns = linear_sum_assignment(_APART * apart - mac)
    for row, column in zip(rows.tolist(), columns.tolist(), strict=True):
        if mac[row, column] > 0.0:
            found = own[column], mac[row, column], ratios[column]
            out[row] = tuple(map(float, found))  # type: ignore[assignment]
    return out


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else float("nan")


def _sizes(levels: Sequence[_Levels]) -> AbsoluteGap:
    """Return the rms of differences before, after, held out, and by noise."""
    before, after, held_out, noise = (
        _rms(np.concatenate([getattr(each, side) for each in levels]))
        for side in ("before", "after", "held_out", "noise")
    )
    return AbsoluteGap("dB", before, after, held_out, noise)


def _find_gaps(
    levels: Sequence[_Levels],
    modes: Sequence[tuple[float, float, float, float]],
    name: str,
) -> dict[str, AbsoluteGap]:
    """Return the gaps of lines in dB, and of modes, by this name, in Hz and relative.

    modes: frequencies measured, before, after and held out.
    """
    nan = float("nan")
    out = {"response": _sizes(levels)}
    rows = [row for row in modes if np.isfinite(row[:3]).all()]
    if rows:
        measured, *computed = np.array(rows).T
        before, after, without = (_rms(each - measured) for each in computed)
        out[name] = AbsoluteGap("Hz", before, after, without, nan)
        before, after, without = (_rms(each / measured - 1.0) for each in computed)
        out[f"{name}_relative"] = AbsoluteGap("1", before, after, without, nan)
    return out
