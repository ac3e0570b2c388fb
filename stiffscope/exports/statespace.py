"""Linear state-space model of a robot at a pose, in modal coordinates."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.errors import InputError
from stiffscope.exports.dynamics_checks import check_dynamics
from stiffscope.vjm.model.mechanism import COORDINATES
from stiffscope.vjm.vibration.frequency_response import Port, expand_ports

if TYPE_CHECKING:
    from stiffscope.vjm.kinematics.configurations import Configurations
    from stiffscope.vjm.model.mechanism import Mechanism
    from stiffscope.vjm.model.screws import Array

DAMPING = 0.01
"""Damping ratio of every mode, that of `frf`."""
WRENCH = ("fx", "fy", "fz", "mx", "my", "mz")
_STATIC = 1e6  # of the lowest frequency: what vibrates above follows statically
_FREE = 1e-9  # of `shift`: squared frequency of a free motion, beyond rounding


@dataclass(frozen=True, eq=False)
class StateSpace:
    """``x' = A x + B u``, ``y = C x + D u`` at a pose; SI, base axes.

    Attributes
    ----------
    a, b, c, d
        (2m, 2m), (2m, u), (y, 2m), (y, u). The state is the modes' displacements times their angular
        frequencies (free motions: as they are), then their rates.
    inputs, outputs
        Names such as ``tool.fz`` (N, N·m) and ``tool.z`` (m, rad).
    frequencies, damping
        (m,) undamped, Hz, and damping ratios.
    """

    a: Array
    b: Array
    c: Array
    d: Array
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    frequencies: Array
    damping: Array


def list_points(mechanism: Mechanism) -> dict[str, tuple[str | None, Array]]:
    """Return node and home point of forces and motions: M, bodies' centres, elastic bodies' tips."""
    out: dict[str, tuple[str | None, Array]] = {"tool": (None, mechanism.tool.at)}
    for body in mechanism.bodies:
        if body.elastic is not None:
            for node, at in zip(body.nodes[1:], body.elastic.places[1:], strict=True):
                out[node] = (node, at)
        elif body.centre is not None and body.mass:
            out[body.name] = (body.name, body.centre)
    return out


def form_state_space(
    mechanism: Mechanism,
    configurations: Configurations,
    *,
    damping: float = DAMPING,
    highest: float | None = None,
) -> StateSpace:
    """Return the linear model of a robot at one configuration.

    Parameters
    ----------
    mechanism
        The robot; its drives hold their commands as springs.
    configurations
        One configuration.
    damping
        Damping ratio of every mode.
    highest
        Frequency in Hz above which modes follow statically, in D; by default a million times the
        lowest one.

    Returns
    -------
    StateSpace
        Forces at named points to motions at the same points.

    Raises
    ------
    InputError
        A named point moves freely without inertia, nothing has a mass, or nothing yields.

    References
    ----------
    D. J. Ewins, Modal Testing, 2nd ed., Research Studies Press 2000, sect. 2.5.
    """
    check_dynamics(mechanism)
    points = list_points(mechanism)
    ports = [
        Port(node, at, np.eye(6)[k]) for node, at in points.values() for k in range(6)
    ]
    modal = expand_ports(mechanism, configurations, ports)
    moving = modal.mass > 0.0
    squares = np.full(len(modal.mass), np.inf)
    squares[moving] = modal.stiffness[moving] / modal.mass[moving]
    squares = np.where(squares < _FREE * modal.shift, 0.0, squares)
    elastic = squares[(squares > 0.0) & np.isfinite(squares)]
    if not elastic.size:
        raise InputError(
            "bodies: expected a mass on a body that can move, got none; give one a mass"
        )
    limit = _STATIC * np.sqrt(elastic.min())
    if highest is not None:
        limit = min(limit, 2.0 * np.pi * highest)
    modes_kept = np.flatnonzero(squares <= limit**2)
    modes_kept = modes_kept[np.argsort(squares[modes_kept], kind="stable")]
    omega = np.sqrt(squares[modes_kept])
    shape = modal.displacement[:, modes_kept] / np.sqrt(modal.mass[modes_kept])
    # what follows statically is a compliance in D
    rest = np.setdiff1d(np.arange(len(squares)), modes_kept)
    rest = rest[modal.stiffness[rest] > 0.0]
    static = modal.displacement[:, rest]
    m = len(modes_kept)
    zero = np.zeros((m, m))
    # displacements times frequencies are of the size of rates, which keeps A well scaled
    scale = np.where(omega > 0.0, omega, 1.0)
    rates = np.hstack([-np.diag(omega**2 / scale), -np.diag(2.0 * damping * omega)])
    return StateSpace(
        a=np.vstack([np.hstack([zero, np.diag(scale)]), rates]),
        b=np.vstack([np.zeros((m, len(ports))), shape.T]),
        c=np.hstack([shape / scale, np.zeros((len(ports), m))]),
        d=static / modal.stiffness[rest] @ static.T,
        inputs=tuple(f"{name}.{f}" for name in points for f in WRENCH),
        outputs=tuple(f"{name}.{x}" for name in points for x in COORDINATES),
        frequencies=omega / (2.0 * np.pi),
        damping=np.full(m, damping),
    )
