"""Craig-Bampton mass of an elastic body, on its ends and a few modes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.errors import InputError, require
from stiffscope.vjm.model.screws import Frame, shift, skew

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from stiffscope.vjm.model.screws import Array

_SYMMETRY = 1e-6  # relative
_INDEFINITE = -1e-6  # relative eigenvalue of a condensed mass beyond rounding


@dataclass(frozen=True, eq=False)
class Dynamics:
    """Inertia of an elastic body.

    ``mass`` (6n + k, 6n + k), ``squares`` (k,) with bounds ``error`` (k,).

    Coordinates are the twists of its n ends, at their places, and k mass-normalized fixed-interface
    modes, part axes; ``squares`` are the modes' squared angular frequencies, rad²/s². Its stiffness
    does not couple ends and modes.

    References
    ----------
    R. R. Craig and M. C. C. Bampton, "Coupling of substructures for dynamic analyses", AIAA Journal
    6 (1968) 1313.
    """

    mass: Array
    squares: Array
    error: Array | None = None

    def __post_init__(self) -> None:
        m = np.asarray(self.mass, dtype=float)
        squares = np.asarray(self.squares, dtype=float)
        ends = max(2, (len(m) - squares.size) // 6) if m.ndim else 2
        size = 6 * ends + squares.size
        shaped = squares.ndim == 1 and m.shape == (size, size)
        require(
            shaped and np.isfinite(m).all() and np.isfinite(squares).all(),
            "dynamics",
            f"finite ({size}, {size}) and ({squares.size},)",
            m.shape,
        )
        least = squares.min(initial=np.inf)
        what = "squared frequencies above 0"
        require(least > 0.0, "dynamics", what, f"{least:.6g}")
        got = squares.shape if self.error is None else np.shape(self.error)
        require(got == squares.shape, "dynamics", f"error {squares.shape}", got)
        diagonal = np.diagonal(m).clip(min=0.0)
        require(
            (
                np.abs(m - m.T)
                <= _SYMMETRY * np.sqrt(np.outer(diagonal, diagonal)) + 1e-300
            ).all(),
            "dynamics",
            "a symmetric condensed mass",
        )
        object.__setattr__(self, "mass", 0.5 * (m + m.T))
        object.__setattr__(self, "squares", squares)
        _ = self.factor

    @cached_property
    def factor(self) -> Array:
        """Γ (r, 6n + k) with ``ΓᵀΓ`` the mass; InputError if it is indefinite."""
        expected = "a positive semidefinite condensed mass"
        return factor_semidefinite(self.mass, f"dynamics: expected {expected}")

    @cached_property
    def load(self) -> Array:
        """Wrenches (6n, 3) at the ends for unit accelerations of the part along x, y, z."""
        size = self.ends_size
        return sum(
            (self.mass[:size, k : k + 3] for k in range(0, size, 6)),
            np.zeros((size, 3)),
        )

    @property
    def total(self) -> float:
        """Mass in kg."""
        return float(
            sum(np.trace(self.load[k : k + 3]) for k in range(0, self.ends_size, 6))
            / 3.0
        )

    @property
    def ends_size(self) -> int:
        """6n: number of coordinates that are end twists."""
        return len(self.mass) - self.squares.size

    def move_ends(self, *ways: ArrayLike) -> Dynamics:
        """Return the inertia for displaced ends, each by a vector (3,) in part axes."""
        carry = np.eye(len(self.mass))
        for k, way in enumerate(ways):
            carry[6 * k : 6 * k + 6, 6 * k : 6 * k + 6] = shift(
                -np.asarray(way, dtype=float)
            )
        return Dynamics(carry.T @ self.mass @ carry, self.squares, self.error)

    def scale_density(self, factor: float) -> Dynamics:
        """Return the inertia for ``factor`` times the density; modes are normalized again."""
        unit = np.repeat([np.sqrt(factor), 1.0], [self.ends_size, self.squares.size])
        error = None if self.error is None else self.error / factor
        return Dynamics(self.mass * np.outer(unit, unit), self.squares / factor, error)


def factor_semidefinite(matrix: Array, message: str) -> Array:
    """Return Γ (r, m) with ``ΓᵀΓ`` the matrix (m, m); raise InputError if it is indefinite."""
    diagonal = np.sqrt(np.diagonal(matrix).clip(min=0.0))
    unit = np.where(diagonal > 0.0, diagonal, 1.0)
    values, vectors = np.linalg.eigh(matrix / np.outer(unit, unit))
    if values[0] < _INDEFINITE * max(values[-1], 1e-300):
        raise InputError(
            f"{message}, got the relative eigenvalue {values[0] / values[-1]:.3g}"
        )
    keep = values > 1e-15 * max(values[-1], 1e-300)
    return (vectors[:, keep] * np.sqrt(values[keep])).T * unit


@dataclass(frozen=True, eq=False)
class Masses:
    """Mass in kg on a node, and its first moment Σ m r (n or 1, 3), about a point in some axes.

    ``rest`` (n or 1, 6, 3): wrench for unit accelerations, that no mass on the node would give.
    """

    mass: float
    moment: Array
    rest: Array | None = None

    def weight(self, gravity: Array) -> Array:
        """Wrench (n or 1, 6, 1) under an acceleration (3,)."""
        out = np.empty((len(self.moment), 6, 1))
        out[:, 3:, 0] = self.moment @ skew(gravity)
        out[:, :3, 0] = self.mass * gravity
        return out if self.rest is None else out + (self.rest @ gravity)[..., None]

    def place(self, rotation: Array, away: Array) -> Masses:
        """Express it in axes where its own are turned (n or 1, 3, 3), its point ``away`` (n or 1, 3)."""
        rest = self.rest
        if rest is not None:
            back = Frame(rotation, away).inverse_adjoint()
            rest = back.mT @ rest @ rotation.mT
        moment = np.einsum("nij,nj->ni", rotation, self.moment) + self.mass * away
        return Masses(self.mass, moment, rest)


def split_load(load: Array) -> Masses:
    """Return the mass on a lever that best gives wrenches (6, 3) per acceleration, and the rest."""
    mass = float(np.trace(load[:3])) / 3.0
    half = 0.5 * (load[3:] - load[3:].T)
    moment = np.array([half[2, 1], half[0, 2], half[1, 0]])
    rest = load - np.concatenate([mass * np.eye(3), skew(moment)])
    return Masses(mass, moment[None], rest[None])
