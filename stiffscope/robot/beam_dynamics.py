"""Inertia of a rod or plate by beam theory: consistent mass condensed on ends and lowest modes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import eigh

from stiffscope.fea.beam import timoshenko
from stiffscope.fea.modes import count_whole
from stiffscope.vjm.model.dynamics import Dynamics
from stiffscope.vjm.model.screws import shift

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stiffscope.cad.cross_sections import Section

MODES = 6
_PIECES = (
    24  # approximate number of elements; the sixth clamped frequency is within 0.05 %
)


def beam_dynamics(
    segments: Sequence[tuple[float, Section]],
    youngs_modulus: float,
    shear_modulus: float,
    density: float,
    modes: int = MODES,
) -> Dynamics:
    """Return the mass of a straight beam condensed on its ends and lowest fixed-interface modes.

    Parameters
    ----------
    segments
        Lengths (m) and cross-sections along x, starting at the base.
    youngs_modulus, shear_modulus, density
        Pa, Pa, kg/m³.
    modes
        Number of fixed-interface modes, at least: pairs of a round beam stay whole.

    Returns
    -------
    Dynamics
        On the twists of base and tip at these points; x along the beam.

    References
    ----------
    J. S. Przemieniecki, Theory of Matrix Structural Analysis, McGraw-Hill 1968, sect. 11.3.
    """
    total = sum(length for length, _ in segments)
    pieces = [
        (length / count, section)
        for length, section in segments
        for count in (max(2, round(_PIECES * length / total)),)
        for _ in range(count)
    ]
    size = 6 * (len(pieces) + 1)
    k = np.zeros((size, size))
    m = np.zeros((size, size))
    for i, (length, section) in enumerate(pieces):
        at = slice(6 * i, 6 * i + 12)
        relative = np.hstack([-shift([length, 0.0, 0.0]), np.eye(6)])
        piece = timoshenko(length, section, youngs_modulus, shear_modulus)
        k[at, at] += relative.T @ np.linalg.solve(piece, relative)
        m[at, at] += density * _consistent(length, section)
    ends = np.r_[0:6, size - 6 : size]
    inner = np.arange(6, size - 6)
    follow = np.zeros((size, 12))
    follow[ends] = np.eye(12)
    follow[inner] = -np.linalg.solve(k[np.ix_(inner, inner)], k[np.ix_(inner, ends)])
    inner_matrices = (a[np.ix_(inner, inner)] for a in (k, m))
    squares, shapes = eigh(*inner_matrices)
    modes = count_whole(squares, modes)
    squares = squares[:modes]
    shapes = shapes[:, :modes]
    modal = np.zeros((size, modes))
    modal[inner] = shapes
    basis = np.hstack([follow, modal])
    return Dynamics(basis.T @ m @ basis, squares)


def _consistent(length: float, section: Section) -> np.ndarray:
    """Return a consistent mass (12, 12) at unit density: linear along x, Hermite cubics across."""
    out = np.zeros((12, 12))
    axial = length / 6.0 * np.array([[2.0, 1.0], [1.0, 2.0]])
    out[np.ix_([0, 6], [0, 6])] = section.area * axial
    out[np.ix_([3, 9], [3, 9])] = (section.bending_y + section.bending_z) * axial
    s = -length
    for across, turn, second in ((1, 5, section.bending_z), (2, 4, section.bending_y)):
        s = -s
        translation = np.array(
            [
                [156.0, 22.0 * s, 54.0, -13.0 * s],
                [22.0 * s, 4.0 * s * s, 13.0 * s, -3.0 * s * s],
                [54.0, 13.0 * s, 156.0, -22.0 * s],
                [-13.0 * s, -3.0 * s * s, -22.0 * s, 4.0 * s * s],
            ]
        )
        rotary = np.array(
            [
                [36.0, 3.0 * s, -36.0, 3.0 * s],
                [3.0 * s, 4.0 * s * s, -3.0 * s, -s * s],
                [-36.0, -3.0 * s, 36.0, -3.0 * s],
                [3.0 * s, -s * s, -3.0 * s, 4.0 * s * s],
            ]
        )
        place = [across, turn, across + 6, turn + 6]
        whole = (
            section.area * length / 420.0 * translation
            + second / (30.0 * length) * rotary
        )
        out[np.ix_(place, place)] = whole
    return out
