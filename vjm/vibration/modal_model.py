"""All modes of a mechanism at one configuration, and what its nodes and elements do in them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.errors import InputError, require
from stiffscope.vjm.model.screws import shift
from stiffscope.vjm.network.loading import Loads
from stiffscope.vjm.network.network import END
from stiffscope.vjm.network.order import find_order
from stiffscope.vjm.statics.equilibrium import solve_loads
from stiffscope.vjm.vibration.coordinates import sum_squares
from stiffscope.vjm.vibration.pencil import form_pencils

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from stiffscope.vjm.kinematics.configurations import Configurations
    from stiffscope.vjm.model.mechanism import Mechanism
    from stiffscope.vjm.model.screws import Array
    from stiffscope.vjm.network.loading import Response
    from stiffscope.vjm.vibration.coordinates import (
        Coordinates,
        PointMass,
    )
    from stiffscope.vjm.vibration.pencil import Drives

_FREELY = 1e-6  # of a massless free motion: participation of a point
_BALANCED = 1.0  # of a load: inertial loads balance idle motions only together


@dataclass(eq=False)
class ModalModel:
    """c modes of a mechanism at one configuration, of arbitrary normalization.

    Attributes
    ----------
    mechanism, configuration
        The mechanism, and the configuration that it vibrates about.
    system
        Coordinates of the mechanism.
    vectors
        Modes (size, c).
    mass, stiffness
        Of every mode (c,), one of them above zero: a mode without mass follows statically, one
        without stiffness is a free motion.
    idle
        Massless motions (size, k) without stiffness.
    shift
        Squared angular frequency of the order of the lowest, (rad/s)².
    """

    mechanism: Mechanism
    configuration: Configurations
    system: Coordinates
    vectors: Array
    mass: Array
    stiffness: Array
    idle: Array
    shift: float

    @cached_property
    def squares(self) -> Array:
        """Squared angular frequencies (c,), (rad/s)²: infinite of massless modes."""
        out = np.full(len(self.mass), np.inf)
        return np.divide(self.stiffness, self.mass, out=out, where=self.mass > 0.0)

    def displace(self, node: str | None, at: Array) -> Array:
        """Return the twists (6, c) of a node's home point in base axes, in every mode.

        Node None is the tool. InputError if there is no such node, or if the point moves freely
        there, without stiffness and inertia.
        """
        name = END if node is None else node
        require(
            name in self.system.twists,
            "",
            f"a body or an end of one, {', '.join(self.system.twists)}",
            f"{name!r}",
        )
        where = self.system.where
        carry = shift(where.point(name, np.asarray(at, dtype=float)) - where.tool)[0]
        rows = self.system.twists[name]
        moved = carry @ rows.matrix[0]
        out = moved @ self.vectors[rows.columns]
        freely = moved @ self.idle[rows.columns]
        if freely.size and np.abs(freely).max() > _FREELY * np.abs(out).max():
            where = node or "tool"
            raise InputError(
                f"{where}: moves freely there, without stiffness and inertia"
            )
        return out

    def solve_static(
        self, points: Sequence[tuple[str, Array, Array]], modes: NDArray[np.intp]
    ) -> Response:
        """Return the static response to wrenches at points, then to inertial loads ``M v``.

        Parameters
        ----------
        points
            Node, home point (3,), and p wrenches (6, p) there in base axes, of each point.
        modes
            Indices (k,) of the modes v whose inertial loads follow.

        Returns
        -------
        Response
            Of all nodes and elements to the wrenches of all points, in order, and the k loads.

        Raises
        ------
        InputError
            If something moves freely under its load.
        """
        where = self.system.where
        counts = [wrench.shape[1] for _, _, wrench in points]
        total = sum(counts)
        nodes: dict[str, Array] = {}

        def add(node: str, wrench: Array, start: int) -> None:
            known = nodes.setdefault(node, np.zeros((1, 6, total + len(modes))))
            known[..., start : start + wrench.shape[-1]] += wrench

        start = 0
        for (node, at, wrench), count in zip(points, counts, strict=True):
            add(node, where.wrenches(node, at)[0] @ wrench, start)
            start += count
        vectors = self.vectors[:, modes]
        for rows, carried in zip(
            self.system.inertias, self.system.carriers, strict=True
        ):
            rates = rows.matrix[0] @ vectors[rows.columns]
            for node, wrench in carried.items():
                add(node, wrench[0] @ rates, total)
        loads = Loads(total + len(modes), nodes, balanced=_BALANCED)
        order = find_order(self.mechanism, self.configuration.linkage)
        return solve_loads(order, where, loads)


def solve_all_modes(
    mechanism: Mechanism,
    configurations: Configurations,
    *,
    drives: Drives = "held",
    masses: Sequence[PointMass] = (),
) -> ModalModel:
    """Return all modes of a mechanism at the first of some configurations.

    Parameters
    ----------
    mechanism
        Bodies, joints, tool and gravity of the robot.
    configurations
        Configuration.
    drives
        Drives are springs ("held") or move freely ("free").
    masses
        Added to bodies, such as those of sensors.
    """
    ((pencil, _),) = form_pencils(
        mechanism, configurations.require_valid()[:1], drives, masses
    )
    unit = pencil.scale[:, None]
    full = pencil.basis[0] @ (unit * pencil.all_vectors()[1])
    mass = sum_squares(pencil.system.inertias, full[None])[0]
    stiffness = sum_squares(pencil.system.strain_rows, full[None])[0]
    inert = (mass > 0.0) | (stiffness > 0.0)
    return ModalModel(
        mechanism=mechanism,
        configuration=configurations[:1],
        system=pencil.system,
        vectors=full[:, inert],
        mass=mass[inert],
        stiffness=stiffness[inert],
        idle=pencil.basis[0] @ (unit * pencil.empty_motions),
        shift=pencil.shift,
    )


@dataclass(eq=False)
class SolvedModes:
    """Modes of a mechanism as solved: a static part of massless modes, and d modes with mass.

    Attributes
    ----------
    modal
        All modes.
    moving
        Those (d,) with mass.
    """

    modal: ModalModel

    @cached_property
    def moving(self) -> NDArray[np.intp]:
        """Modes (d,) with mass."""
        return np.flatnonzero(self.modal.mass > 0.0)

    @cached_property
    def massless(self) -> NDArray[np.intp]:
        """Modes (k,) without."""
        return np.flatnonzero(self.modal.mass <= 0.0)

    @property
    def mass(self) -> Array:
        """Modal masses (d,)."""
        return self.modal.mass[self.moving]

    @property
    def stiffness(self) -> Array:
        """Modal stiffnesses (d,)."""
        return self.modal.stiffness[self.moving]

    @property
    def static(self) -> Array:
        """Flexibilities (k,) of the static part."""
        return 1.0 / self.modal.stiffness[self.massless]

    def displace(self, node: str, at: Array) -> tuple[Array, Array]:
        """Return twists (6, k) of a node's home point in the static part, (6, d) in modes."""
        twists = self.modal.displace(node, at)
        return twists[:, self.massless], twists[:, self.moving]

    def find_wrenches(
        self, name: str, points: Sequence[tuple[str, Array, Array]]
    ) -> tuple[Array, Array]:
        """Return wrenches in an element, own axes, under p forces and inertial loads.

        Parameters
        ----------
        points
            Node, home point (3,) and wrench (6,) there in base axes, of each force.

        Returns
        -------
            Wrenches (6m, p) under the forces, and (6m, d) per unit ``-s²`` times amplitudes.
        """
        response = self._respond(points)
        wrench = response.find_wrench(self.modal.mechanism.rows(name))[0]
        return wrench[:, : len(points)], wrench[:, len(points) :]

    def find_motions(
        self, name: str, points: Sequence[tuple[str, Array, Array]]
    ) -> tuple[Array, Array]:
        """Return motions (k, p) and (k, d) in a joint's free directions, likewise."""
        motion = self._respond(points).elements[name].motions[0]
        return motion[:, : len(points)], motion[:, len(points) :]

    def _respond(self, points: Sequence[tuple[str, Array, Array]]) -> Response:
        key = tuple((node, *at, *wrench) for node, at, wrench in points)
        if self._static is None or self._static[0] != key:
            columns = [(node, at, wrench[:, None]) for node, at, wrench in points]
            self._static = key, self.modal.solve_static(columns, self.moving)
        return self._static[1]

    _static: tuple[Any, Response] | None = None
