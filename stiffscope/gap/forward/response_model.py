"""Predicted frequency responses of a robot at the points and directions of measured ones."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.responses.model import DERIVATIVES
from stiffscope.vjm.vibration.coordinates import PointMass
from stiffscope.vjm.vibration.frequency_response import (
    Port,
    expand_ports,
    superpose_modes,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray

    from stiffscope.gap.campaign.measured_responses import MeasuredResponses
    from stiffscope.responses.model import Response
    from stiffscope.vjm.model.mechanism import Mechanism
    from stiffscope.vjm.vibration.frequency_response import ModalPorts


@dataclass(frozen=True, eq=False)
class ResponsePrediction:
    """Modes of a robot as it was hit, and its responses.

    Attributes
    ----------
    modal
        Modes, with a port for each point and direction.
    receptances
        Predicted receptance at the lines of each measured response, in their order, as an
        exponential window would show it.
    """

    modal: ModalPorts
    receptances: tuple[NDArray[np.complex128], ...]


@dataclass(frozen=True, eq=False)
class ComparedResponses:
    """Responses of one set-up, measured and predicted."""

    measured: MeasuredResponses
    predicted: ResponsePrediction
    damping: float


def predict_responses(
    mechanism: Mechanism, measured: MeasuredResponses, damping: ArrayLike
) -> ResponsePrediction:
    """Predict the responses of a mechanism at the points and lines of measured ones.

    Parameters
    ----------
    mechanism
        The robot, in the same configurations as that of the measured responses.
    measured
        Points, directions, lines, window, drives, and masses of sensors.
    damping
        Modal damping ratios, as for `superpose_modes`.

    Raises
    ------
    InputError
        If a point moves freely without inertia.
    """
    ends = [
        end
        for response in measured.responses
        for end in (response.force, response.motion)
    ]
    directions = list(dict.fromkeys(ends))
    ports = [
        Port(
            measured.point(end.point).body,
            measured.places[end.point],
            measured.find_direction(end),
        )
        for end in directions
    ]
    masses = [
        PointMass(point.body, measured.places[point.name], point.mass)
        for point in measured.setup.points
        if point.mass
    ]
    modal = expand_ports(
        mechanism,
        measured.configuration,
        ports,
        drives=measured.setup.drives,
        masses=masses,
    )
    receptances: dict[int, NDArray[np.complex128]] = {}
    for alike in _group_by_lines(measured.responses):
        responses = [measured.responses[k] for k in alike]
        pairs = [
            (directions.index(response.force), directions.index(response.motion))
            for response in responses
        ]
        hertz = responses[0].frequency
        values = superpose_modes(modal, pairs, hertz, damping, decay=measured.decay)
        for k, response, value in zip(alike, responses, values, strict=True):
            receptances[k] = value * _window_factor(response, measured.decay)
    ordered = tuple(receptances[k] for k in range(len(measured.responses)))
    return ResponsePrediction(modal, ordered)


def _group_by_lines(responses: Sequence[Response]) -> list[list[int]]:
    """Return the indices of responses with the same lines."""
    groups: dict[bytes, list[int]] = {}
    for k, response in enumerate(responses):
        groups.setdefault(response.frequency.tobytes(), []).append(k)
    return list(groups.values())


def _window_factor(response: Response, decay: float) -> NDArray[np.complex128]:
    """Return what the receptance of a windowed motion is to the windowed receptance, (f,).

    The window acts on the measured motion: of an acceleration it gives ``s² H(s)`` at
    ``s = i ω + decay``, which reading divides by ``(i ω)²``.
    """
    line = 2j * np.pi * response.frequency
    return ((line + decay) / line) ** DERIVATIVES[response.quantity]
