"""Eigenvalue problem of a mechanism's vibration, ``K v = ω² M v`` about the unloaded state.

With a shift s this is ``M v = μ (K + s M) v``, ``ω² = 1/μ - s``. Massless directions have μ = 0 and
follow statically, free motions have ω = 0; neither requires a rank decision. A null-space basis of
the constraints closes the loops.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np

from stiffscope.errors import check_word
from stiffscope.vjm.model.subspaces import RANK
from stiffscope.vjm.network.network import place_nodes
from stiffscope.vjm.vibration.coordinates import (
    add_point_mass,
    form_coordinates,
)

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from stiffscope.vjm.kinematics.configurations import Configurations
    from stiffscope.vjm.model.mechanism import Mechanism
    from stiffscope.vjm.model.screws import Array
    from stiffscope.vjm.vibration.coordinates import (
        Coordinates,
        PointMass,
    )

Drives = Literal["held", "free"]
NOTHING = 1e-12  # of a scaled matrix's diagonal: zero stiffness or inertia
_ROUNDED = 1e-18  # of the largest: stiffness of a free motion, the square of a strain's rounding


@dataclass(eq=False)
class Pencil:
    """``K v = ω² M v`` at n poses; ``basis`` (n or 1, size, d) maps to ``system`` coordinates."""

    system: Coordinates
    basis: Array
    stiffness: Array
    mass: Array

    @cached_property
    def shift(self) -> float:
        """Squared angular frequency of the order of the lowest, (rad/s)²."""
        k, m = (np.einsum("nii->ni", a)[0] for a in (self.stiffness, self.mass))
        both = (k > _ROUNDED * k.max(initial=0.0)) & (m > 0.0)
        return float((k[both] / m[both]).min()) if both.any() else 1.0

    @cached_property
    def scale(self) -> Array:
        """Units (d,) in which the diagonal of K + s M is one at the first pose."""
        diagonal = np.einsum("nii->ni", self.shifted_stiffness)[0]
        return 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))

    @property
    def shifted_stiffness(self) -> Array:
        """K + s M (n, d, d)."""
        return self.stiffness + self.shift * self.mass

    @cached_property
    def empty_motions(self) -> Array:
        """Motions (d, k) at the first pose with neither stiffness nor inertia, scaled units."""
        matrix = self.shifted_stiffness[0] * np.outer(self.scale, self.scale)
        values, vectors = np.linalg.eigh(matrix)
        return vectors[:, values < NOTHING]

    def regular(self) -> Array:
        """Return K + s M (n, d, d) in scaled units, regularized on ``empty_motions``."""
        scaled = self.shifted_stiffness * np.outer(self.scale, self.scale)
        return scaled + self.empty_motions @ self.empty_motions.T

    def all_vectors(self) -> tuple[Array, Array]:
        """Return all μ (d,) of the first pose, descending, and vectors (d, d), scaled units."""
        lower = np.asarray(np.linalg.cholesky(self.regular()[0]), dtype=float)
        half = np.linalg.inv(lower)
        mass = self.mass[0] * np.outer(self.scale, self.scale)
        values, turned = np.linalg.eigh(half @ mass @ half.T)
        return values[::-1], half.T @ turned[:, ::-1]

    def some(self, index: NDArray[np.intp]) -> Pencil:
        """Return the pencil at some poses, with shift and units of the first of them."""
        basis = self.basis if len(self.basis) == 1 else self.basis[index]
        return Pencil(
            self.system.some(index), basis, self.stiffness[index], self.mass[index]
        )


def form_pencils(
    mechanism: Mechanism,
    configurations: Configurations,
    drives: Drives = "held",
    masses: Sequence[PointMass] = (),
) -> Iterator[tuple[Pencil, NDArray[np.intp]]]:
    """Yield pencils of reachable configurations, each with the indices of its configurations.

    Parameters
    ----------
    mechanism
        Bodies, joints, tool and gravity of the robot.
    configurations
        Configurations; unreachable ones are skipped.
    drives
        Drives are springs ("held") or move freely ("free").
    masses
        Added to bodies, such as those of accelerometers.
    """
    check_word("drives", drives, get_args(Drives))
    free = [j.name for j in mechanism.drives] if drives == "free" else []
    shaken = mechanism
    if free:
        shaken = replace(
            mechanism, joints=tuple(replace(j, drive=None) for j in mechanism.joints)
        )
    system = form_coordinates(
        shaken, place_nodes(configurations), configurations.linkage.length, free
    )
    for mass in masses:
        add_point_mass(system, mass)
    stiffness = system.stiffness
    mass = system.mass
    everything = np.arange(len(configurations))
    if not system.constraints:
        yield Pencil(system, np.eye(system.size)[None], stiffness, mass), everything
        return
    jacobian = system.jacobian()
    size = np.linalg.norm(jacobian[0], axis=0)
    unit = 1.0 / np.where(size > 0.0, size, 1.0)
    _, values, rows = np.linalg.svd(jacobian * unit)
    ranks = (values > RANK * values[:, :1]).sum(axis=1)
    for rank in np.unique(ranks):
        some = np.flatnonzero(ranks == rank)
        basis = unit[:, None] * rows[some, rank:].mT
        reduced = [basis.mT @ a[some] @ basis for a in (stiffness, mass)]
        yield Pencil(system.some(some), basis, *reduced), some
