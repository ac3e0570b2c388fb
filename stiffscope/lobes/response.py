"""Response of the tool to forces at it, as modes with a static remainder, at many poses."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.errors import InputError
from stiffscope.vjm.statics.analysis import compliance
from stiffscope.vjm.vibration.modes import modes

if TYPE_CHECKING:
    from collections.abc import Callable

    from stiffscope.lobes.engagement import Engagement
    from stiffscope.lobes.holder import HolderModes
    from stiffscope.runtime.types import Array, Complex, Flags
    from stiffscope.vjm.kinematics.configurations import Configurations
    from stiffscope.vjm.model.mechanism import Mechanism
    from stiffscope.vjm.vibration.modes import Modes

MODES = 12  # modes kept; the rest responds statically
_AWAY = (
    1e7  # rad/s: frequency that fills the place of a missing mode, whose shape is zero
)
_MATTERS = 0.01  # of the largest peak of a mode
_NOWHERE = 1e-6  # of the largest: static remainder that is rounding


@dataclass(frozen=True, eq=False)
class ToolResponse:
    """Receptance of the tool's translation at n poses in the axes of the cut, as m modes.

    ``G(ω) = Σ φ φᵀ / (ω_k² - ω² + 2 i ζ_k ω_k ω) + remainder``

    Attributes
    ----------
    squares
        ω_k² (n, m), (rad/s)².
    damping
        Damping ratios ζ_k (n, m).
    shapes
        Mass-normalized φ (n, 3, m), 1/√kg.
    remainder
        Static compliance of all other modes (n, 3, 3), m/N.
    frequency_error, damping_error
        Relative 95 % bounds (n, m) of ω_k and ζ_k.
    """

    squares: Array
    damping: Array
    shapes: Array
    remainder: Array
    frequency_error: Array
    damping_error: Array
    origin: Array | None = None
    """Share (n, a, m) of the robot's and then the holder's own modes in each; None: the robot's."""

    def __len__(self) -> int:
        """Return the number of poses."""
        return len(self.squares)

    def __getitem__(self, some: Any) -> ToolResponse:
        """Return the response at some poses, as a stack."""
        return ToolResponse(
            squares=self.squares[some],
            damping=self.damping[some],
            shapes=self.shapes[some],
            remainder=self.remainder[some],
            frequency_error=self.frequency_error[some],
            damping_error=self.damping_error[some],
            origin=None if self.origin is None else self.origin[some],
        )

    @property
    def rates(self) -> Array:
        """ω_k (n, m), rad/s."""
        return np.sqrt(self.squares)

    @property
    def matters(self) -> Flags:
        """Whether modes (n, m) respond by more than a hundredth of the largest peak."""
        peak = (self.shapes**2).sum(axis=1) / (self.squares * self.damping)
        flags: Flags = peak > _MATTERS * peak.max(axis=1, keepdims=True)
        return flags

    @property
    def static(self) -> Array:
        """Static compliance (n, 3, 3), m/N."""
        by_mode = self.shapes / self.squares[:, None]
        return by_mode @ self.shapes.mT + self.remainder

    def modal(self, omega: Array) -> Complex:
        """Return the modal receptances (n, f, m) at ω (n, f), rad/s."""
        square = self.squares[:, None]
        friction = 2.0 * (self.damping * self.rates)[:, None]
        at = omega[..., None]
        return 1.0 / (square - at**2 + 1j * friction * at)

    def receptance(self, omega: Array) -> Array:
        """Return G (n, f, 3, 3) at ω (n, f), rad/s."""
        each = self.modal(omega)
        return (
            np.einsum("nfm,nim,njm->nfij", each, self.shapes, self.shapes)
            + self.remainder[:, None]
        )

    def looped(self, cut: Engagement) -> tuple[Array, Array]:
        """Return G times the mean of a cut by modes (n, m, d, d), and of the remainder (n, d, d).

        Displacements along z are left out (d = 2) where they leave the chip as it is.
        """
        d = 2 if cut.planar else 3
        seen = self.shapes[:, :d]
        loaded = np.einsum("njm,ji->nmi", self.shapes, cut.mean[:, :d])
        by_mode = np.einsum("nim,nmj->nmij", seen, loaded)
        return by_mode, self.remainder[:, :d] @ cut.mean[:, :d]


def tool_response(
    mechanism: Mechanism,
    found: Configurations,
    axes: Array,
    damping: Callable[[Array], tuple[Array, Array]],
) -> tuple[ToolResponse, Modes]:
    """Return the tool's response at n configurations, drives held, and the robot's modes.

    Parameters
    ----------
    mechanism, found
        Mechanism with masses, and its configurations.
    axes
        Rows (n, 3, 3): feed, normal and spindle, base axes.
    damping
        Function from frequencies (n, m), Hz, to damping ratios and their relative 95 % bounds.

    Raises
    ------
    InputError
        If the robot has no masses, or the tool moves freely.
    """
    shaken = modes(mechanism, found, MODES)
    hertz = shaken.frequencies
    soft = compliance(mechanism, found)[:, :3, :3]
    if not np.isfinite(soft).all() or (hertz == 0.0).any():
        raise InputError("tool: expected one that its drives hold, got free motions")
    known = np.isfinite(hertz)
    squares = np.where(known, (2.0 * np.pi * hertz) ** 2, _AWAY**2)
    shapes = np.where(known[:, None], shaken.tool[:, :3], 0.0)
    turned = axes @ shapes
    static = np.einsum("nim,njm->nij", turned / squares[:, None], turned)
    remainder = find_remainder(axes @ soft @ axes.mT - static, soft)
    ratio, doubt = damping(np.where(known, hertz, 1.0))
    error = np.where(known, shaken.error / np.where(known, hertz, 1.0), 0.0)
    response = ToolResponse(
        squares=squares,
        damping=ratio,
        shapes=turned,
        remainder=remainder,
        frequency_error=error,
        damping_error=doubt,
    )
    return response, shaken


def find_remainder(matrix: Array, scale: Array) -> Array:
    """Return the static remainder (n, 3, 3) from the compliance that modes leave.

    It is symmetric, and without negative eigenvalues, which are rounding next to ``scale``.
    """
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.mT))
    least = _NOWHERE * np.linalg.norm(scale, axis=(1, 2))[:, None]
    kept = np.where(values > least, values, 0.0)
    return np.einsum("nik,nk,njk->nij", vectors, kept, vectors)


def couple_holder(robot: ToolResponse, holder: HolderModes) -> ToolResponse:
    """Return the response at the tip of a tool in its holder, mounted at the robot's tool point.

    Receptance coupling in modal coordinates: each mode of the holder, clamped at its flange, is a
    mass on a spring along its axis, so that the tip's mass reacts on the robot. Between the modes
    of the coupled system damping is taken as proportional.

    Parameters
    ----------
    robot
        Response of the robot at the flange.
    holder
        Modes of the clamped holder at its tip.

    References
    ----------
    T. L. Schmitz, R. R. Donaldson, Predicting high-speed machining dynamics by substructure
    analysis, CIRP Annals 49, 2000, 303-308.
    """
    squares = holder.squares
    damping = holder.damping
    stiffness = holder.stiffness
    n, m = robot.squares.shape
    k = len(squares)
    # tip displacement along a mode's direction: shape of unit modal mass
    own = np.sqrt(squares[:, None] / stiffness)  # (k, 3)
    size = np.linalg.norm(own, axis=1)
    mass = 1.0 / size**2  # moving mass at the tip, kg
    way = own / size[:, None]
    # the holder's mass moves with the robot's modes plus its own deflection
    driven = np.einsum("ki,nim->nkm", way, robot.shapes)
    total = m + k
    inertia = np.tile(np.eye(total), (n, 1, 1))
    inertia[:, :m, :m] += np.einsum("k,nka,nkb->nab", mass, driven, driven)
    mixed = np.einsum("k,nka->nak", np.sqrt(mass), driven)
    inertia[:, :m, m:] = mixed
    inertia[:, m:, :m] = mixed.mT
    held = np.concatenate([robot.squares, np.tile(squares, (n, 1))], axis=1)
    ratio = np.concatenate([robot.damping, np.tile(damping, (n, 1))], axis=1)
    friction = 2.0 * ratio * np.sqrt(held)
    half = np.linalg.inv(np.linalg.cholesky(inertia))
    values, turned = np.linalg.eigh(half @ (held[:, :, None] * half.mT))
    vectors = half.mT @ turned
    moved = np.concatenate(
        [robot.shapes, np.tile(own.T, (n, 1, 1))], axis=2
    )  # (n, 3, m + k)
    damped = np.einsum("nai,na,nai->ni", vectors, friction, vectors)
    weight = np.einsum("nai,na,nai->nai", vectors, held, vectors)
    share = weight / weight.sum(axis=1, keepdims=True)
    own_doubt = np.tile(robot.damping_error.max(axis=1, keepdims=True), (1, k))
    doubts = np.concatenate([robot.damping_error, own_doubt], axis=1)
    errors = np.concatenate([robot.frequency_error, np.zeros((n, k))], axis=1)
    return replace(
        robot,
        squares=values,
        damping=damped / (2.0 * np.sqrt(values)),
        shapes=moved @ vectors,
        remainder=robot.remainder + np.diag(holder.remainder),
        frequency_error=np.einsum("nai,na->ni", share, errors),
        damping_error=np.einsum("nai,na->ni", share, doubts),
        origin=share,
    )
