"""Reduction of a robot at one pose to its tool's twist and fixed-interface modes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.errors import require
from stiffscope.vjm.model.subspaces import RANK
from stiffscope.vjm.network.network import END
from stiffscope.vjm.vibration.pencil import form_pencils

if TYPE_CHECKING:
    from stiffscope.vjm.kinematics.configurations import Configurations
    from stiffscope.vjm.model.mechanism import Mechanism
    from stiffscope.vjm.model.screws import Array
    from stiffscope.vjm.vibration.pencil import Drives

_NOTHING = 1e-12  # of a scaled matrix's largest eigenvalue: zero stiffness or inertia
_FREE = 1e-9  # of the shift: squared angular frequency of a free motion


@dataclass(frozen=True, eq=False)
class ToolSuperelement:
    """A grounded robot reduced to its tool's twist at M (base axes) and k modal coordinates, SI.

    ``stiffness``, ``mass``: (6 + k, 6 + k); ``tool``: M (3,) m at the pose.
    """

    stiffness: Array
    mass: Array
    tool: Array

    @property
    def mode_squares(self) -> Array:
        """Squared angular frequencies (k,) with the tool held, (rad/s)²."""
        return np.diagonal(self.stiffness)[6:]


def superelement(
    mechanism: Mechanism,
    configuration: Configurations,
    modes: int = 6,
    *,
    drives: Drives = "held",
) -> ToolSuperelement:
    """Reduce a robot at one configuration to its tool's twist and to its lowest modes.

    The reduction keeps the lowest ``modes`` frequencies of the robot with its tool free exactly.

    Parameters
    ----------
    mechanism
        Bodies, joints, tool and gravity of the robot.
    configuration
        One configuration of the mechanism.
    modes
        Number of modes kept with the tool held and with the tool free; more modes extend the valid
        frequency range.
    drives
        Drives are springs ("held") or move freely ("free").

    Raises
    ------
    InputError
        If the tool cannot move in all six directions, so that no reduction to it exists.

    References
    ----------
    R. R. Craig, M. C. C. Bampton, Coupling of substructures for dynamic analyses, AIAA Journal 6,
    1968; docs/theory.md, section 11.
    """
    (pencil, _), *_ = form_pencils(mechanism, configuration, drives)
    unit = pencil.scale
    stiffness, mass = (
        a[0] * np.outer(unit, unit) for a in (pencil.stiffness, pencil.mass)
    )
    size = np.repeat([pencil.system.length, 1.0], 3)
    tool = (
        pencil.system.twists[END].apply_to(pencil.basis)[0] * unit / size[:, None]
    )  # (6, d)
    left, values, right = np.linalg.svd(tool)
    require(
        len(values) >= 6 and values[5] > RANK * values[0],
        "tool",
        "one that moves in six directions",
        "one held rigidly",
    )
    apart = np.asarray(right[6:].T, dtype=float)
    follow = right[:6].T / values[:6] @ left.T / size
    held, inert = (apart.T @ a @ apart for a in (stiffness, mass))
    inverse: Array = np.asarray(np.linalg.pinv(held, 1e-13, hermitian=True))  # pyright: ignore[reportUnknownArgumentType]
    static = follow - apart @ inverse @ (apart.T @ stiffness @ follow)
    loose = _lowest(stiffness, mass, pencil.shift, modes)
    added = apart.T @ (
        loose - static @ (size[:, None] * (tool @ loose))
    )  # with the tool held
    wanted = np.linalg.qr(
        np.hstack([_lowest(held, inert, pencil.shift, modes), added])
    )[0]
    condensed = wanted.T @ held @ wanted
    moved = wanted.T @ inert @ wanted
    within = _lowest(condensed, moved, pencil.shift, wanted.shape[1])
    basis = np.hstack([static, apart @ wanted @ within])
    k, m = (0.5 * (a + a.T) for a in (basis.T @ a @ basis for a in (stiffness, mass)))
    k[:6, 6:] = k[6:, :6] = 0.0  # uncoupled by construction
    k[6:, 6:] *= np.eye(len(k) - 6)
    return ToolSuperelement(k, m, configuration.tool[0, :3])


def _lowest(stiffness: Array, mass: Array, shift: float, count: int) -> Array:
    """Return the lowest modes (d, k) of modal mass 1 kg; free motions are omitted."""
    values, vectors = np.linalg.eigh(stiffness + shift * mass)
    stiff = values > _NOTHING * values.max(initial=0.0)
    half = vectors[:, stiff] / np.sqrt(values[stiff])
    weights, turned = np.linalg.eigh(half.T @ mass @ half)  # μ = 1 / (ω² + s)
    moving = (weights > _NOTHING * weights.max(initial=0.0)) & (
        weights < (1.0 - _FREE) / shift
    )
    return ((half @ turned[:, moving]) / np.sqrt(weights[moving]))[:, ::-1][:, :count]
