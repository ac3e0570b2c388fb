"""Lost motion by play, friction, hardening and loose bolts, in equilibrium with the forces."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stiffscope.lab.machine import Slot
    from stiffscope.lab.rotations import Array

_NO_FORCE = 1e-6  # rounding error of a zero force over the largest force
_TIED = 1e-6  # relative to a drive's stiffness: free motion below
_ITERATIONS = 300
_HALVED = 60  # iterations after which steps are halved


def settle(
    slots: Sequence[Slot], coupling: Array, force: Array, *, gaps: bool
) -> Array:
    """Return the lost motion (n, s) of slots under forces (n, s), including its own reaction.

    A slot with play is at the end of its gap towards its force; if that would reverse the force, it
    is inside the gap at the point of zero force.

    Parameters
    ----------
    slots
        The s slots.
    coupling
        Force (n, s, s) in every slot per unit of lost motion in each.
    force
        Forces (n, s) without lost motion.
    gaps
        Whether play is included; otherwise only the smooth laws are.
    """
    out = np.zeros_like(force)
    if not slots:
        return out
    own = np.minimum(np.einsum("nkk->nk", coupling), 0.0)
    none = rounding_force(force)
    for iteration in range(_ITERATIONS):
        carried = force + np.einsum("nkl,nl->nk", coupling, out)
        carried[np.abs(carried) < none] = 0.0
        following = np.zeros_like(out)
        for k, slot in enumerate(slots):
            if slot.law == "play":
                if gaps:
                    following[:, k] = _in_gap(slot, out[:, k], carried[:, k], own[:, k])
            elif slot.law == "friction" and not gaps:
                continue  # a robot at rest is relaxed: friction holds what is applied to it
            else:
                value, slope = lost_motion(slot, carried[:, k])
                following[:, k] = out[:, k] + (value - out[:, k]) / (
                    1.0 - slope * own[:, k]
                )
        step = following - out
        if float(np.abs(step).max()) < 1e-15:
            break
        out = out + (step if iteration < _HALVED else 0.5 * step)
    return out


def rounding_force(force: Array) -> float:
    """Return the force, N or N·m, below which a force is only rounding."""
    return _NO_FORCE * max(1.0, float(np.abs(force).max(initial=0.0)))


def _in_gap(slot: Slot, shift: Array, force: Array, own: Array) -> Array:
    tied = own < -_TIED * (slot.stiffness if np.isfinite(slot.stiffness) else 1e7)
    endless = np.where(force == 0.0, 0.0, np.copysign(np.inf, force))
    free = np.divide(force, -own, out=endless, where=tied)
    return np.clip(shift + free, -slot.size, slot.size)


def lost_motion(slot: Slot, force: Array) -> tuple[Array, Array]:
    """Return a slot's deflection beyond the linear one at forces (n,), and its derivative."""
    k = slot.stiffness
    match slot.law:
        case "hardening":
            e = force / k
            for _ in range(60):
                e = e - (k * e + slot.size * e**3 - force) / (k + 3 * slot.size * e**2)
            return e - force / k, 1.0 / (k + 3 * slot.size * e**2) - 1.0 / k
        case "curve":
            x, f = np.array([(0.0, 0.0), *slot.points]).T
            part = np.clip(
                np.searchsorted(f, np.abs(force), side="right"), 1, len(f) - 1
            )
            softness = (np.diff(x) / np.diff(f))[part - 1]
            e = x[part - 1] + softness * (np.abs(force) - f[part - 1])
            return np.copysign(e, force) - force / k, softness - 1.0 / k
        case "friction":
            sticks = np.abs(force) < slot.size
            return -np.clip(force, -slot.size, slot.size) / k, np.where(
                sticks, -1.0 / k, 0.0
            )
        case "one-sided":
            return slot.size * np.maximum(force, 0.0), np.where(
                force > 0.0, slot.size, 0.0
            )
        case "stiffening":
            e = np.cbrt(slot.size * force * slot.knee**2)
            for _ in range(60):
                square = (e / slot.knee) ** 2
                e = e - (e * (1 + square) - slot.size * force) / (1 + 3 * square)
            return e, slot.size / (1 + 3 * (e / slot.knee) ** 2)
        case _:
            return np.zeros_like(force), np.zeros_like(force)
