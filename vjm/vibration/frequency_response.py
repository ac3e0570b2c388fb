"""Frequency response of a mechanism at a pose by modal superposition."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.errors import InputError
from stiffscope.runtime.threads import in_one_thread
from stiffscope.vjm.vibration.modal_model import solve_all_modes

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray

    from stiffscope.vjm.kinematics.configurations import Configurations
    from stiffscope.vjm.model.mechanism import Mechanism
    from stiffscope.vjm.model.screws import Array
    from stiffscope.vjm.vibration.coordinates import PointMass
    from stiffscope.vjm.vibration.pencil import Drives

_STATIC = (
    1e7  # times the band: frequencies of modes that follow statically, to rounding
)


@dataclass(frozen=True, eq=False)
class Port:
    """A point of force or response: ``direction`` (6,) at a node's home point ``at`` (3,).

    ``direction``: force and moment, or displacement and rotation, base axes. Node None is the tool.
    """

    node: str | None
    at: Array
    direction: Array


@dataclass(frozen=True, eq=False)
class ModalPorts:
    """Modes of a mechanism at a pose, and what ports do in them.

    ``mass`` (c,) and ``stiffness`` (c,) of every mode, one of them above zero: a mode without mass
    follows statically, one without stiffness is a free motion; ``displacement`` (p, c) of p ports.
    """

    mass: Array
    stiffness: Array
    displacement: Array
    shift: float
    """Squared angular frequency of the order of the lowest, (rad/s)²."""

    @property
    def frequencies(self) -> Array:
        """Natural frequencies (c,), Hz: 0 of free motions, infinite of massless ones."""
        squares = np.divide(
            self.stiffness,
            self.mass,
            out=np.full_like(self.mass, np.inf),
            where=self.mass > 0.0,
        )
        return np.sqrt(squares) / (2.0 * np.pi)


@in_one_thread
def expand_ports(
    mechanism: Mechanism,
    configurations: Configurations,
    ports: Sequence[Port],
    *,
    drives: Drives = "held",
    masses: Sequence[PointMass] = (),
) -> ModalPorts:
    """Return all modes at one configuration, and the displacement of ports in each.

    Parameters
    ----------
    mechanism, configurations, drives
        As for `frequency_response`.
    ports
        Points and directions of forces and responses.
    masses
        Of sensors on the structure.

    Raises
    ------
    InputError
        If a port has no body or moves freely without inertia.
    """
    modal = solve_all_modes(mechanism, configurations, drives=drives, masses=masses)
    moved = [
        np.asarray(port.direction, dtype=float) @ modal.displace(port.node, port.at)
        for port in ports
    ]
    shown = np.array(moved).reshape(len(ports), len(modal.mass))
    return ModalPorts(modal.mass, modal.stiffness, shown, modal.shift)


def keep_modes_below(modal: ModalPorts, frequency: float) -> ModalPorts:
    """Return the modes up to a frequency in Hz; those above follow statically (residual term).

    The error of a receptance is ``(f / frequency)²`` of the contribution of the modes above.
    """
    above = modal.frequencies > frequency
    return replace(modal, mass=np.where(above, 0.0, modal.mass))


def superpose_modes(
    modal: ModalPorts,
    pairs: ArrayLike,
    frequencies: ArrayLike,
    damping: ArrayLike = 0.01,
    *,
    decay: float = 0.0,
) -> NDArray[np.complex128]:
    """Return receptances (r, f) of pairs of ports: complex displacement per unit force.

    ``H = Σ φ_target φ_source / (k + s² m + 2 ζ s √(k m))`` over all modes, at ``s = i ω + decay``.

    Parameters
    ----------
    modal
        Modes and ports, from `expand_ports`.
    pairs
        (r, 2) ports of the force and of the motion, indices.
    frequencies
        (f,) in Hz, above 0.
    damping
        Modal damping ratio of all modes, or (d,) of the modes in the order of
        ``modal.frequencies``, free motions included; further modes have the last value.
    decay
        Of an exponential window ``exp(-decay t)`` on the impulse response, 1/s: it damps all modes
        more.

    Returns
    -------
    ndarray
        (r, f), in m/N, m/(N·m), rad/N or rad/(N·m).

    Raises
    ------
    InputError
        If a frequency or a damping ratio is out of range.

    References
    ----------
    D. J. Ewins, Modal Testing, 2nd ed., Research Studies Press 2000, sect. 2.5.
    """
    hertz = np.asarray(frequencies, dtype=float)
    if hertz.ndim != 1 or not ((hertz > 0.0) & np.isfinite(hertz)).all():
        raise InputError("frequencies: expected numbers above 0 Hz")
    ratios = np.atleast_1d(np.asarray(damping, dtype=float))
    if not (ratios.size and ((ratios >= 0.0) & (ratios < 1.0)).all()):
        raise InputError(
            f"damping: expected a ratio of at least 0 and below 1, got {damping}"
        )
    count = len(modal.mass)
    ratio = ratios[np.minimum(np.arange(count), len(ratios) - 1)]
    source, target = np.asarray(pairs, dtype=int).reshape(-1, 2).T
    part = modal.displacement[source] * modal.displacement[target]  # (r, c)
    omega = 2.0 * np.pi * hertz
    static = modal.frequencies > _STATIC * hertz.max(initial=0.0)
    rest = (part[:, static] / modal.stiffness[static]).sum(axis=1)
    used = ~static & (part != 0.0).any(axis=0)
    stiffness = modal.stiffness[used, None]
    mass = modal.mass[used, None]
    resistance = 2.0 * ratio[used, None] * np.sqrt(stiffness * mass)
    # real and imaginary part of 1 / (reactance + i loss), (c, f): half the work of complex numbers
    reactance = stiffness + (decay**2 - omega**2) * mass + decay * resistance
    loss = omega * (2.0 * decay * mass + resistance)
    inverse = 1.0 / (reactance**2 + loss**2)
    real = rest[:, None] + part[:, used] @ (reactance * inverse)
    return real - 1j * (part[:, used] @ (loss * inverse))


def frequency_response(
    mechanism: Mechanism,
    configurations: Configurations,
    source: Port,
    target: Port,
    frequencies: ArrayLike,
    *,
    damping: ArrayLike = 0.01,
    drives: Drives = "held",
) -> NDArray[np.complex128]:
    """Return the receptance: complex displacement at one port per unit force at another.

    For many pairs of ports, `expand_ports` once and `superpose_modes` share one solution.

    Parameters
    ----------
    mechanism, configurations
        Mechanism, and one configuration of it.
    source, target
        Ports of the force and of the response.
    frequencies
        (f,) in Hz, above 0.
    damping
        Modal damping ratios, as for `superpose_modes`.
    drives
        As for `modes`.

    Returns
    -------
    ndarray
        (f,), in m/N, m/(N·m), rad/N or rad/(N·m). Massless motions are static.

    Raises
    ------
    InputError
        If a port has no body or moves freely without inertia, or a value is out of range.
    """
    modal = expand_ports(mechanism, configurations, (source, target), drives=drives)
    return superpose_modes(modal, [(0, 1)], frequencies, damping)[0]
