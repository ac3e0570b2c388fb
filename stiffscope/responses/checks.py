"""What measured responses show of themselves: resonances, doubts, and static stiffness.

A driving point of a passive structure absorbs power at every frequency, so the imaginary part of its
receptance is never positive (phase 0 to -180°). A linear structure is reciprocal.

References
----------
D. J. Ewins, Modal Testing, 2nd ed., Research Studies Press 2000, sect. 2.7, 3.8, 4.3.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import median_filter

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from stiffscope.responses.model import Response
    from stiffscope.runtime.types import Array, Flags, Indices


@dataclass(frozen=True)
class CheckSettings:
    """Limits beyond which a response is doubted.

    Attributes
    ----------
    prominence
        Of a resonance above its surroundings, factor; 6 dB.
    most_peaks
        Resonances listed.
    filled
        Level over the noise of a single hit to which dips are filled, before resonances are sought.
    around
        Lines over which noise is taken as the same.
    coherence
        Least coherence at a resonance: below, noise or leakage shapes the peak.
    silent
        Coherence below which a line, or the median of a response, is noise.
    active
        Largest share of lines at which a driving point gives power.
    phase
        Sine of the phase error that channels may have; 3°.
    floor
        Magnitude, relative to the median, below which noise decides the phase.
    reciprocal
        Largest median difference of a pair of reciprocal responses, relative.
    narrow
        Least lines within the half-power width of a resonance: below, leakage rounds the peak.
    slope
        Deviation of a slope d ln|H| / d ln f from a whole number that still counts as it.
    static
        Highest frequency, relative to the first resonance, at which a response is nearly static.
    least_lines
        Least lines to judge a slope or a stiffness from.
    """

    prominence: float = 2.0
    most_peaks: int = 12
    filled: float = 2.0
    around: int = 11
    coherence: float = 0.8
    silent: float = 0.5
    active: float = 0.05
    phase: float = 0.05
    floor: float = 0.03
    reciprocal: float = 0.2
    narrow: int = 3
    slope: float = 0.4
    static: float = 0.4
    least_lines: int = 5


SETTINGS = CheckSettings()


@dataclass(frozen=True)
class StaticStiffness:
    """Static stiffness at a driving point, from lines below its first resonance.

    Attributes
    ----------
    stiffness, spread
        N/m (N·m/rad of rotations), and half the 95 % interval.
    band
        Lowest and highest frequency used, Hz.
    """

    stiffness: float
    spread: float
    band: tuple[float, float]


def find_resonances(response: Response, settings: CheckSettings = SETTINGS) -> Indices:
    """Return the indices of the lines with a resonance, by frequency.

    A resonance is a maximum of the receptance's magnitude that is more than noise.
    """
    from scipy.signal import find_peaks  # brings scipy.stats: a second of every command

    levels = np.log(np.maximum(fill_noise(response, settings), 1e-300))
    height = np.log(settings.prominence)
    peaks, about = find_peaks(levels, prominence=height)
    prominences = about["prominences"]
    if response.coherence is not None:
        heard = response.coherence[peaks] >= settings.silent
        peaks = peaks[heard]
        prominences = prominences[heard]
    highest = np.argsort(-prominences)[: settings.most_peaks]
    return np.sort(peaks[highest]).astype(np.int64)


def fill_noise(response: Response, settings: CheckSettings = SETTINGS) -> Array:
    """Return the magnitudes (n,) of a response with all dips filled to the noise.

    Coherence γ² tells that of a single hit, ``|H| √((1 - γ²)/(2 γ²))`` of real and imaginary part. Without
    it, these are the magnitudes.
    """
    size = np.abs(response.receptance)
    if response.coherence is None:
        return size
    heard = response.coherence.clip(1e-3, 1.0)
    noise = settings.filled * size * np.sqrt((1.0 - heard) / (2.0 * heard))
    return np.hypot(size, median_filter(noise, settings.around, mode="nearest"))


def find_damping(
    response: Response, settings: CheckSettings = SETTINGS
) -> list[tuple[float, float]]:
    """Return frequency, Hz, and damping ratio of the resonances by their half-power width.

    Resonances narrower than ``narrow`` lines are left out. Close modes widen each other, so that
    the ratios are estimates.
    """
    found = list[tuple[float, float]]()
    size = np.abs(response.receptance)
    for peak in find_resonances(response, settings):
        above = size >= size[peak] / np.sqrt(2.0)
        low, high = _run_around(above, int(peak))
        if high - low + 1 < settings.narrow or low == 0 or high == len(size) - 1:
            continue
        hertz = float(response.frequency[peak])
        lines = response.frequency
        # the half-power points lie, on average, half a line beyond the run
        width = 0.5 * (lines[high] + lines[high + 1] - lines[low] - lines[low - 1])
        found.append((hertz, float(0.5 * width / hertz)))
    return found


def find_static_stiffness(
    response: Response, settings: CheckSettings = SETTINGS
) -> StaticStiffness | None:
    """Return the static stiffness that a driving point shows inside its band; None if none.

    Below the first resonance, at ``r = f / f1``, the receptance of undamped modes lies between
    ``C`` (all higher modes far away) and ``C / (1 - r²)`` (this mode alone). The interval covers
    both, and the scatter of the lines.
    """
    peaks = find_resonances(response, settings)
    if not response.is_driving_point or not len(peaks):
        return None
    first = response.frequency[peaks[0]]
    used = response.frequency < settings.static * first
    if response.coherence is not None:
        used &= response.coherence >= settings.coherence
    if used.sum() < settings.least_lines:
        return None
    ratio = response.frequency[used] / first
    sign = response.force.sign * response.motion.sign
    upper = sign * response.receptance[used].real
    lower = upper * (1.0 - ratio**2)
    if (upper <= 0.0).any():
        return None  # falls with frequency, or drifts: nothing static in the band
    middle = 0.5 * (np.median(lower) + np.median(upper))
    scatter = 1.96 * np.std(0.5 * (lower + upper)) / np.sqrt(len(ratio))
    spread = 0.5 * (np.median(upper) - np.median(lower)) + scatter
    band = (float(response.frequency[used][0]), float(response.frequency[used][-1]))
    return StaticStiffness(float(1.0 / middle), float(spread / middle**2), band)


def find_doubts(
    responses: Sequence[Response], settings: CheckSettings = SETTINGS
) -> list[str]:
    """Return doubts on measured responses, a line each."""
    doubts = list[str]()
    heard = [r for r in responses if _median_coherence(r) >= settings.silent]
    for response in responses:
        if response not in heard:
            coherence = _median_coherence(response)
            name = name_response(response)
            doubts.append(
                f"{name}: nothing but noise (median coherence {coherence:.2f})"
            )
    for response in heard:
        doubts += _doubt_peaks(response, settings)
        if response.is_driving_point:
            doubts += _doubt_driving_point(response, settings)
    doubts += _doubt_reciprocity(heard, settings)
    return doubts


def _median_coherence(response: Response) -> float:
    """Return the median coherence; 1 if unknown."""
    return 1.0 if response.coherence is None else float(np.median(response.coherence))


def name_response(response: Response) -> str:
    """Return "7:-x / 1:+z": motion over force."""
    return f"{response.motion} / {response.force}"


def _doubt_peaks(response: Response, settings: CheckSettings) -> Iterator[str]:
    """Yield doubts on the lines at the resonances."""
    name = name_response(response)
    frequency = response.frequency
    size = np.abs(response.receptance)
    poor = list[str]()
    narrow = list[str]()
    for peak in find_resonances(response, settings):
        hertz = f"{frequency[peak]:.4g} Hz"
        if response.coherence is not None:
            coherence = float(response.coherence[peak])
            if coherence < settings.coherence:
                poor.append(f"{hertz} ({coherence:.2f})")
        above = size >= size[peak] / np.sqrt(2.0)
        low, high = _run_around(above, int(peak))
        if high - low + 1 < settings.narrow:
            narrow.append(hertz)
    if poor:
        yield (
            f"{name}: coherence below {settings.coherence:g} at resonances: {', '.join(poor)}"
        )
    if narrow:
        yield (
            f"{name}: resonances narrower than {settings.narrow} lines, so that leakage may lower "
            f"them: {', '.join(narrow)}"
        )


def _run_around(flags: Flags, at: int) -> tuple[int, int]:
    """Return the first and the last index of the run of true flags around an index."""
    ends = np.flatnonzero(~flags)
    before = ends[ends < at]
    after = ends[ends > at]
    low = int(before[-1]) + 1 if len(before) else 0
    high = int(after[0]) - 1 if len(after) else len(flags) - 1
    return low, high


def _doubt_driving_point(response: Response, settings: CheckSettings) -> Iterator[str]:
    """Yield a doubt if a driving point gives power, with the likely reason.

    A wrong quantity turns all phases by a multiple of 90°, a reversed sign by 180°. Both give the
    same phases if the quantity is wrong by two derivatives; the slope below the first resonance
    tells which: a receptance is level there, an accelerance rises with the square of f.
    """
    sign = response.force.sign * response.motion.sign
    values = sign * response.receptance
    size = np.abs(values)
    clear = size > settings.floor * np.median(size)
    least = settings.phase * size[clear]
    active = float(np.mean(values.imag[clear] > least))
    if active <= settings.active:
        return
    name = name_response(response)
    told = f"{name}: driving point with a phase outside 0 to -180° at {100 * active:.0f} % of its lines"
    slope = _find_slope(response, settings)
    turned = {
        turns: float(np.mean((values * 1j**turns).imag[clear] > least))
        for turns in (1, 2, 3)
    }
    turns = min(turned, key=lambda key: turned[key])
    if turned[turns] > settings.active:
        yield told
        return
    if turns == 2 and (slope is None or abs(slope) < settings.slope):
        yield f"{told}: is the sign of force or motion reversed?"
        return
    likely = (
        ""
        if slope is None
        else f" (below its first resonance it goes as f^{slope:.1f})"
    )
    yield f"{told}: is it {response.quantity}, as stated{likely}?"


def _find_slope(response: Response, settings: CheckSettings) -> float | None:
    """Return d ln|H| / d ln f below the first resonance; None if too few lines are there."""
    peaks = find_resonances(response, settings)
    if not len(peaks):
        return None
    used = response.frequency < settings.static * response.frequency[peaks[0]]
    if used.sum() < settings.least_lines:
        return None
    size: Array = np.log(np.abs(response.receptance[used]))
    return float(np.polyfit(np.log(response.frequency[used]), size, 1)[0])


def _doubt_reciprocity(
    responses: Sequence[Response], settings: CheckSettings
) -> Iterator[str]:
    """Yield a doubt for each pair that is not reciprocal."""
    by_ends = {
        (r.force.point, r.force.axis, r.motion.point, r.motion.axis): r
        for r in responses
    }
    for (point, axis, seen, way), one in by_ends.items():
        other = by_ends.get((seen, way, point, axis))
        if other is None or (point, axis) >= (seen, way):
            continue
        shared = np.intersect1d(one.frequency, other.frequency)
        if len(shared) < settings.least_lines:
            continue
        first, second = (
            each.receptance[np.isin(each.frequency, shared)]
            * (each.force.sign * each.motion.sign)
            for each in (one, other)
        )
        mean = 0.5 * (np.abs(first) + np.abs(second))
        apart = float(np.median(np.abs(first - second) / mean))
        if apart > settings.reciprocal:
            yield (
                f"{name_response(one)} and {name_response(other)}: not reciprocal, "
                f"{100 * apart:.0f} % apart (median)"
            )
