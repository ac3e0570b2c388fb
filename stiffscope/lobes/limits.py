"""Limits of the depth of cut, and how they change with the machine's modes."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from stiffscope.runtime.types import Array, Complex


@dataclass(frozen=True, eq=False)
class Limits:
    """Depths of cut below which no vibration grows.

    A change of the machine changes the eigenvalue λ of the cut by g = d ln λ; at a speed that
    stays, the frequency of chatter follows, and ``d ln depth = -Re g + slope · Im g``.

    Attributes
    ----------
    depth
        Depth (…,), m; infinite without a limit.
    speed
        Spindle speed (…,) at which it holds, rev/s.
    omega
        Frequency (…,) of chatter there, rad/s.
    shares
        Share (…, m) of each mode in Re λ; negative for modes that act against it.
    slope
        Ratio (…,) of real and imaginary part of the change of ln λ with the frequency.
    by_rate, by_damping
        g (…, m) by ln ω_k and ln ζ_k.
    by_speed
        g (…,) by the logarithm of the speed.
    """

    depth: Array
    speed: Array
    omega: Array
    shares: Array
    slope: Array
    by_rate: Complex
    by_damping: Complex
    by_speed: Complex

    def __len__(self) -> int:
        """Return the length of the first axis."""
        return len(self.depth)

    def __getitem__(self, some: Any) -> Limits:
        """Return some limits."""
        return Limits(*(getattr(self, field.name)[some] for field in fields(self)))

    def reshape(self, *shape: int) -> Limits:
        """Return the same limits with another shape."""
        depths = self.depth.ndim
        values = (getattr(self, field.name) for field in fields(self))
        return Limits(*(each.reshape(*shape, *each.shape[depths:]) for each in values))

    def relative_change(self, change: Complex) -> Array:
        """Return d ln depth (…, …) for changes g = d ln λ (…, …)."""
        slope = self.slope.reshape(
            *self.slope.shape, *[1] * (np.ndim(change) - self.slope.ndim)
        )
        return slope * change.imag - change.real


def join_limits(parts: list[Limits]) -> Limits:
    """Return several stacks of limits as one."""
    if len(parts) == 1:
        return parts[0]
    names = [field.name for field in fields(Limits)]
    return Limits(
        *(np.concatenate([getattr(part, name) for part in parts]) for name in names)
    )


def pick_limits(first: Limits, second: Limits, use_second: Array) -> Limits:
    """Return the second limits where told, else the first."""
    values = list[Any]()
    for field in fields(Limits):
        ours = getattr(first, field.name)
        theirs = getattr(second, field.name)
        choice = use_second.reshape(
            *use_second.shape, *[1] * (ours.ndim - use_second.ndim)
        )
        values.append(np.where(choice, theirs, ours))
    return Limits(*values)
