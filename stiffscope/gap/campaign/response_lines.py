"""Lines of measured responses as readings: those that tell, with their scatter.

A few lines about each resonance carry nearly everything. Far from the right robot, a model's
resonances lie many half-power widths beside the measured ones, and lines tell no direction: local
means over a relative width w of measured and predicted lines alike change smoothly with the robot.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.gap.campaign.campaign import NO_LINE
from stiffscope.gap.campaign.kinds import CODE_ALONG, number_of
from stiffscope.gap.campaign.kinds.responses import RESPONSE
from stiffscope.responses.checks import fill_noise, find_resonances

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from stiffscope.gap.campaign.campaign import Campaign
    from stiffscope.gap.campaign.measured_responses import MeasuredResponses
    from stiffscope.responses.model import Response
    from stiffscope.runtime.types import Array, Complex, Indices


@dataclass(frozen=True)
class LineSettings:
    """Which lines are used.

    Attributes
    ----------
    spread
        Spacing of lines over their distance from the nearest resonance.
    wide
        Spacing of local means, over their width.
    floor
        Error of local means, relative to their size: of what their linearization leaves.
    reach
        Of a local mean, in widths.
    least_damping
        Ratio below which lines are not spaced closer.
    rounding
        Least scatter of a line over the largest response there: what symmetry makes zero.
    """

    spread: float = 0.5
    wide: float = 0.7
    floor: float = 0.01
    reach: float = 3.0
    least_damping: float = 1e-4
    rounding: float = 1e-5


SETTINGS = LineSettings()


@dataclass(frozen=True, eq=False)
class ResponseBlock:
    """r responses of one set-up with the same lines, as m readings each: real, then imaginary.

    Attributes
    ----------
    measured
        The set-up; its responses are those of the block.
    frequency
        Lines (f,) to predict, Hz.
    mean
        Local means (m, f) of lines; None: each line is a reading.
    value
        Complex readings (r, m), m/N.
    sigma
        Standard deviation (r, m) of the real and of the imaginary part.
    noise
        The same (r, f) of the lines.
    damping
        Damping ratio of the measured resonances.
    """

    measured: MeasuredResponses
    frequency: Array
    mean: Array | None
    value: Complex
    sigma: Array
    noise: Array
    damping: float

    def __len__(self) -> int:
        """Return the number of real readings."""
        return 2 * self.value.size

    def read(self, lines: Complex) -> Complex:
        """Return readings (r, m, ...) of lines (r, f, ...)."""
        if self.mean is None:
            return lines
        parts = np.ascontiguousarray(lines).reshape(*lines.shape[:2], -1)
        means = self.mean @ parts.view(np.float64)  # real products take half the work
        shape = len(lines), len(self.mean), *lines.shape[2:]
        return means.view(np.complex128).reshape(shape)

    @cached_property
    def weight(self) -> Array:
        """Inverse standard deviations (r, m)."""
        return 1.0 / self.sigma


def stack_parts(values: Complex) -> Array:
    """Return real readings (2 r m, ...) of complex ones (r, m, ...)."""
    flat = values.reshape(values.shape[0] * values.shape[1], *values.shape[2:])
    return np.concatenate([flat.real, flat.imag])


def read_lines(
    measured: MeasuredResponses, width: float = 0.0, settings: LineSettings = SETTINGS
) -> tuple[ResponseBlock, ...]:
    """Return the lines of a set-up that tell, or their local means.

    Responses that are zero at every line are left out (`find_silent`).

    Parameters
    ----------
    measured
        Responses of one set-up.
    width
        Standard deviation of the window of a local mean, relative to frequency; 0: lines.
    """
    blocks = list[ResponseBlock]()
    heard = [response for response in measured.responses if response.receptance.any()]
    for responses in _group_by_lines(heard):
        selected = replace(measured, responses=tuple(responses))
        scatter = np.array([measured.scatter[response] for response in responses])
        level = np.max([np.abs(response.receptance) for response in responses], axis=0)
        scatter = np.maximum(scatter, settings.rounding * level)
        damping = max(selected.find_damping(), settings.least_damping)
        find = _find_means if width else _find_lines
        blocks.append(find(selected, scatter, damping, width, settings))
    return tuple(blocks)


def find_silent(measured: MeasuredResponses) -> tuple[str, ...]:
    """Return a remark on each response of a set-up that is zero at every line."""
    return tuple(
        f"{response.source}: response {response.force} to {response.motion} is zero at every line: "
        "left out"
        for response in measured.responses
        if not response.receptance.any()
    )


def _group_by_lines(responses: Sequence[Response]) -> list[list[Response]]:
    """Return responses with the same lines together."""
    groups: dict[bytes, list[Response]] = {}
    for response in responses:
        groups.setdefault(response.frequency.tobytes(), []).append(response)
    return list(groups.values())


def _find_lines(
    measured: MeasuredResponses,
    scatter: Array,
    damping: float,
    width: float,
    settings: LineSettings,
) -> ResponseBlock:
    """Return lines thinned to half the half-power width, and less away from resonances."""
    del width
    responses = measured.responses
    hertz = responses[0].frequency
    lines = _thin(hertz, hertz[find_peaks(responses)], damping, settings.spread)
    value = np.array([response.receptance[lines] for response in responses])
    return ResponseBlock(
        measured=measured,
        frequency=hertz[lines],
        mean=None,
        value=value,
        sigma=scatter[:, lines],
        noise=scatter[:, lines],
        damping=damping,
    )


def _find_means(
    measured: MeasuredResponses,
    scatter: Array,
    damping: float,
    width: float,
    settings: LineSettings,
) -> ResponseBlock:
    """Return local means of lines that are spaced by half the half-power width at most."""
    responses = measured.responses
    hertz = responses[0].frequency
    lines = _thin(hertz, hertz, damping, 0.0)
    hertz = hertz[lines]
    value = np.array([response.receptance[lines] for response in responses])
    count = max(int(np.ceil(np.log(hertz[-1] / hertz[0]) / width / settings.wide)), 1)
    ends = float(hertz[0]), float(hertz[-1])
    centres: Array = np.geomspace(*ends, num=count + 1)
    away = (hertz - centres[:, None]) / (width * centres[:, None])
    spacing = np.gradient(hertz) if len(hertz) > 1 else np.ones(1)
    mean = np.exp(-0.5 * away**2) * (np.abs(away) <= settings.reach) * spacing
    total = mean.sum(axis=1, keepdims=True)
    mean = (mean / np.where(total > 0.0, total, 1.0))[total[:, 0] > 0.0]
    noise = np.sqrt(scatter[:, lines] ** 2 @ mean.T**2)
    size = np.abs(value) @ mean.T
    return ResponseBlock(
        measured=measured,
        frequency=hertz,
        mean=mean,
        value=value @ mean.T,
        sigma=np.hypot(noise, settings.floor * size),
        noise=scatter[:, lines],
        damping=damping,
    )


def find_peaks(responses: Sequence[Response]) -> Indices:
    """Return the lines with a resonance in the rms level of all responses."""
    sizes = [fill_noise(response) for response in responses]
    levels = [size / np.median(size[size > 0.0]) for size in sizes if size.any()]
    if not levels:
        return np.zeros(0, dtype=np.int64)
    size = np.sqrt(np.mean(np.square(levels), axis=0))
    whole = replace(responses[0], receptance=size.astype(complex), coherence=None)
    return find_resonances(whole)


def _thin(hertz: Array, peaks: Array, damping: float, spread: float) -> Indices:
    """Return indices of lines not closer than ``damping`` times their frequency.

    Away from the peaks, the spacing is ``spread`` times the distance to the nearest one.
    """
    if not len(peaks):
        peaks = hertz
        spread = 0.0
    right = np.searchsorted(peaks, hertz).clip(max=len(peaks) - 1)
    left = (right - 1).clip(min=0)
    away = np.minimum(np.abs(peaks[right] - hertz), np.abs(hertz - peaks[left]))
    needed = np.maximum(damping * hertz, spread * away)
    chosen = list[int]()
    last = -np.inf
    for k, (line, step) in enumerate(zip(hertz.tolist(), needed.tolist(), strict=True)):
        if line - last >= step * (1.0 - 1e-9):
            chosen.append(k)
            last = line
    return np.array(chosen, dtype=np.int64)


def join_responses(campaign: Campaign, blocks: Sequence[ResponseBlock]) -> Campaign:
    """Return a campaign with the lines of responses as further readings, at poses of their own.

    Without readings, the campaign's poses only place the robot: those of the responses replace them.
    """
    if not blocks:
        return campaign
    setups = list(dict.fromkeys(block.measured.setup.name for block in blocks))
    read = campaign if len(campaign) else _drop_poses(campaign)
    first = len(read.poses)
    columns: dict[str, list[NDArray[Any]]] = {}

    def add(**values: NDArray[Any]) -> None:
        for key, value in values.items():
            columns.setdefault(key, []).append(value)

    for block in blocks:
        measured = block.measured
        name = measured.setup.name
        lines = block.value.shape[1]
        axes = np.array([response.motion.axis for response in measured.responses])
        code = CODE_ALONG[number_of(RESPONSE)][np.tile(np.repeat(axes, lines), 2)]
        n = len(code)
        add(
            pose=np.full(n, first + setups.index(name)),
            quantity=code,
            value=stack_parts(block.value),
            sigma=np.tile(block.sigma.ravel(), 2),
            wrench=np.full((n, 6), np.nan),
            session=np.zeros(n, dtype=np.int64),
            file=np.full(n, len(campaign.files) + setups.index(name)),
            line=np.full(n, NO_LINE),
            sensor=np.full(n, -1),
            load=np.full(n, -1),
        )
    joined = {
        key: np.concatenate([getattr(campaign, key), *parts])
        for key, parts in columns.items()
    }
    unstated = np.full((len(setups), read.poses.shape[1]), np.nan)
    files = {block.measured.setup.name: block.measured.setup.file for block in blocks}
    expected = campaign.expected
    if expected is not None:
        more = np.zeros(len(joined["value"]) - len(expected))
        expected = np.concatenate([expected, more])
    return replace(
        campaign,
        poses=np.concatenate([read.poses, unstated]),
        pose_names=(*read.pose_names, *setups),
        session_names=campaign.session_names or ("",),
        files=(*campaign.files, *files.values()),
        expected=expected,
        **joined,
    )


def _drop_poses(campaign: Campaign) -> Campaign:
    """Return a campaign without its poses."""
    return replace(campaign, poses=campaign.poses[:0], pose_names=())


def place_at_responses(
    campaign: Campaign, responses: Sequence[MeasuredResponses]
) -> Campaign:
    """Return a campaign without readings at the poses of its responses."""
    configurations = [measured.configuration for measured in responses]
    axes = configurations[0].mechanism.tool.commanded_axes
    poses = np.array([pose.tool[0, axes] for pose in configurations])
    names = tuple(measured.setup.name for measured in responses)
    return replace(campaign, poses=poses, pose_names=names)
