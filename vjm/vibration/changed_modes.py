"""Modes of a mechanism with changed elements and masses, in terms of those of the unchanged one.

With the flexibility F, motions follow forces f and the inertial loads of the masses by
``x = F (f - s² M x)``. An element of added compliance D changes F to

    F' = F + X E Xᵀ,    E = D (1 - K D)⁻¹,

with the motions X by unit dislocations of the element, and the wrenches K in it by these. In the
basis of the unchanged robot's inertial loads, A = Bᵀ F' B = L Lᵀ is a small matrix, and added
masses R Σ Rᵀ (Σ: signs) are further columns of B. Modes are the eigenvectors of ``Lᵀ Σ L``
(docs/theory.md, section 11.7).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.errors import InputError
from stiffscope.vjm.model.screws import shift
from stiffscope.vjm.network.condensation import condense_network
from stiffscope.vjm.network.order import find_order
from stiffscope.vjm.statics.equilibrium import solve_dislocations

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from stiffscope.vjm.model.screws import Array
    from stiffscope.vjm.network.condensation import Condensed
    from stiffscope.vjm.network.loading import Response
    from stiffscope.vjm.vibration.modal_model import ModalModel

_ROUNDED = 1e-6  # of a point's motion: free motions beside it
_EMPTY = 1e-13  # of the largest eigenvalue: rounding
_FREE = 1e-9  # of the lowest squared frequency: stiffness of a free motion
_BEYOND = (
    1e-9  # of a dislocation's motion of masses: what no nominal motion has; rounding
)


@dataclass(frozen=True, eq=False)
class AddedInertia:
    """Inertia (6, 6) added to a node, about its home point ``at`` (3,), in base axes."""

    node: str
    at: Array
    inertia: Array


@dataclass(frozen=True, eq=False)
class Terminal:
    """A node's home point: its twists (6, c) in the unchanged modes, and by dislocations."""

    modal: Array
    cuts: Array
    """Twists (6, k) under unit dislocations of the changed elements."""


@dataclass(eq=False)
class SoundModes:
    """All modes of an unchanged mechanism with held drives, and its response to dislocations.

    Free motions that nothing at the points of interest notices, such as that of a rod about its own
    axis, are held by springs: `moves_freely` tells whether a point does.
    """

    modal: ModalModel
    _cuts: dict[str, Response] = field(default_factory=dict[str, Any])
    _moved: dict[str, Array] = field(default_factory=dict[str, Any])
    _twists: dict[Any, Array] = field(default_factory=dict[Any, Any])
    _dislocated: dict[Any, Array] = field(default_factory=dict[Any, Any])

    @cached_property
    def free(self) -> NDArray[np.bool_]:
        """Modes (c,) with mass that nothing holds."""
        return self.modal.squares < _FREE * self.modal.shift

    def moves_freely(self, node: str, at: Array) -> bool:
        """Return whether a node's home point moves in free motions."""
        unit = np.sqrt(np.where(self.modal.mass > 0.0, self.modal.mass, np.inf))
        moved = np.abs(self.displace(node, at)) / unit
        return bool((moved[:, self.free].max(initial=0.0)) > _ROUNDED * moved.max())

    @cached_property
    def moving(self) -> NDArray[np.intp]:
        """Modes (m,) with mass that is more than rounding."""
        return np.flatnonzero(_EMPTY * self.modal.squares < self.modal.shift)

    @cached_property
    def flexibility(self) -> Array:
        """Flexibilities (c,) of the modes."""
        held = self.modal.shift * self.modal.mass
        return 1.0 / np.where(self.free, held, self.modal.stiffness)

    @cached_property
    def kept(self) -> Array:
        """Share (m,) of the modes in a static dislocation that is kept: none of free motions."""
        return np.where(self.free[self.moving], 0.0, 1.0)

    @cached_property
    def _condensed(self) -> Condensed:
        modal = self.modal
        order = find_order(modal.mechanism, modal.configuration.linkage)
        return condense_network(order, modal.system.where)

    def cut(self, name: str) -> Response:
        """Return the static response to unit twists, own axes, of an element's ends from the first."""
        if name not in self._cuts:
            mechanism = self.modal.mechanism
            self._cuts[name] = solve_dislocations(self._condensed, mechanism, name)
        return self._cuts[name]

    @cached_property
    def rates(self) -> Array:
        """Rates (r, m) of all masses in the modes of unit modal mass."""
        vectors = self.modal.vectors[:, self.moving] / np.sqrt(
            self.modal.mass[self.moving]
        )
        rows = self.modal.system.inertias
        return np.vstack([row.matrix[0] @ vectors[row.columns] for row in rows])

    def _move_masses(self, name: str) -> Array:
        """Return the rates (r, k) of all masses by static unit dislocations of an element."""
        if name not in self._moved:
            moved = self.cut(name).nodes
            each = [
                sum(wrench[0].T @ moved[node][0] for node, wrench in carried.items())
                for carried in self.modal.system.carriers
            ]
            self._moved[name] = np.vstack(each)
        return self._moved[name]

    def _share(self, name: str) -> Array:
        """Return the share (m, k) of the modes in static dislocations of an element."""
        return self.rates.T @ self._move_masses(name)

    def move_masses(self, name: str) -> Array:
        """Return the rates (r, k) of all masses by unit dislocations of an element."""
        lost = (1.0 - self.kept)[:, None] * self._share(name)
        return self._move_masses(name) - self.rates @ lost

    def displace(self, node: str, at: Array) -> Array:
        """Return twists (6, c) of a node's home point in the modes, base axes."""
        key = node, tuple(np.asarray(at, dtype=float).tolist())
        if key not in self._twists:
            self._twists[key] = self.modal.displace(node, at)
        return self._twists[key]

    def dislocate(self, names: Sequence[str], node: str, at: Array) -> Array:
        """Return twists (6, k) of a node's home point under unit dislocations of elements."""
        out = [np.zeros((6, 0)), *(self._dislocate(name, node, at) for name in names)]
        return np.hstack(out)

    def _dislocate(self, name: str, node: str, at: Array) -> Array:
        key = name, node, tuple(np.asarray(at, dtype=float).tolist())
        if key not in self._dislocated:
            where = self.modal.system.where
            carry = shift(where.point(node, np.asarray(at, dtype=float)) - where.tool)
            moved = carry[0] @ self.cut(name).nodes[node][0]
            if self.free.any():
                lost = (1.0 - self.kept)[:, None] * self._share(name)
                unit = np.sqrt(self.modal.mass[self.moving])
                moved = moved - (self.displace(node, at)[:, self.moving] / unit) @ lost
            self._dislocated[key] = moved
        return self._dislocated[key]

    def rows(self, names: Sequence[str]) -> list[str]:
        """Return the network elements of some elements."""
        return [row for name in names for row in self.modal.mechanism.rows(name)]

    def resist(self, names: Sequence[str], others: Sequence[str]) -> Array:
        """Return wrenches (6m, k) in elements under unit dislocations of others."""
        rows = self.rows(names)
        out = [np.zeros((6 * len(rows), 0))]
        for other in others:
            wrench = self.cut(other).find_wrench(rows)[0]
            out.append(wrench)
        return np.hstack(out)


@dataclass(eq=False)
class ChangedModes:
    """Modes of a mechanism with added compliance of elements, and added inertia.

    A motion is the sum of a static part, with flexibilities ``static`` (k,), and of d modes of
    unit stiffness. Raises InputError if a changed mass is not positive.
    """

    sound: SoundModes
    compliances: Mapping[str, Array]
    inertias: Sequence[AddedInertia] = ()

    @cached_property
    def names(self) -> list[str]:
        """Changed elements."""
        return list(self.compliances)

    @cached_property
    def _yield(self) -> Array:
        """E (k, k): twists of dislocation per unit wrench of the unchanged robot."""
        blocks = list(self.compliances.values())
        size = sum(len(block) for block in blocks)
        added = np.zeros((size, size))
        at = 0
        for block in blocks:
            here = slice(at, at + len(block))
            added[here, here] = block
            at += len(block)
        resist = self.sound.resist(self.names, self.names)
        out = np.linalg.solve((np.eye(size) - resist @ added).T, added.T).T
        return 0.5 * (out + out.T)

    def terminal(self, node: str, at: Array) -> Terminal:
        """Return what moves a node's home point."""
        return Terminal(
            self.sound.displace(node, at), self.sound.dislocate(self.names, node, at)
        )

    def _flex(self, one: Terminal, other: Terminal) -> Array:
        """Return the changed flexibility between two terminals, rows by rows."""
        return (one.modal * self.sound.flexibility) @ other.modal.T + (
            one.cuts @ self._yield @ other.cuts.T
        )

    @cached_property
    def _beyond(self) -> Array:
        """Rates (r, q) of masses that the unchanged robot cannot have, and dislocations give."""
        sound = self.sound
        if not self.names:
            return np.zeros((len(sound.rates), 0))
        moved = np.hstack([sound.move_masses(name) for name in self.names])
        rest = moved - sound.rates @ (sound.rates.T @ moved)
        rest = rest - sound.rates @ (sound.rates.T @ rest)
        size = np.linalg.norm(moved, axis=0)
        rest = rest[:, size > 0.0] / size[size > 0.0]
        left, values, _ = np.linalg.svd(rest, full_matrices=False)
        return left[:, values > _BEYOND]

    @cached_property
    def _turned(self) -> list[tuple[Array, Array]]:
        """Of each added inertia: factors (k, 6) of its motions, and signs (k,)."""
        out: list[tuple[Array, Array]] = []
        for added in self.inertias:
            values, vectors = np.linalg.eigh(added.inertia)
            significant = np.abs(values) > _EMPTY * np.abs(values).max()
            turn = vectors[:, significant] * np.sqrt(np.abs(values[significant]))
            out.append((turn.T, np.sign(values[significant])))
        return out

    @cached_property
    def _masses(self) -> tuple[Terminal, Array]:
        """Functionals of all inertial loads, and their signs (n,)."""
        sound = self.sound
        moving = sound.moving
        count = len(moving)
        beyond = self._beyond
        modal = np.zeros((count + beyond.shape[1], len(sound.modal.mass)))
        modal[np.arange(count), moving] = np.sqrt(sound.modal.mass[moving])
        basis = np.hstack([sound.rates, beyond])
        each = [np.zeros((basis.shape[1], 0))]
        each += [basis.T @ sound.move_masses(name) for name in self.names]
        cuts = np.hstack(each)
        signs: list[Array] = [np.ones(basis.shape[1])]
        for added, (turn, sign) in zip(self.inertias, self._turned, strict=True):
            here = self.terminal(added.node, added.at)
            modal = np.vstack([modal, turn @ here.modal])
            cuts = np.vstack([cuts, turn @ here.cuts])
            signs.append(sign)
        return Terminal(modal, cuts), np.concatenate(signs)

    @cached_property
    def _eigen(self) -> tuple[Array, Array, Array]:
        """``L⁻¹`` (l, n) of the loads, ``L`` (n, l), both turned to the modes; and m (l,)."""
        loads, signs = self._masses
        values, vectors = np.linalg.eigh(self._flex(loads, loads))
        significant = values > _EMPTY * values[-1]
        root = np.sqrt(values[significant])
        lower = vectors[:, significant] * root
        inverse = (vectors[:, significant] / root).T
        if (signs > 0.0).all():
            return inverse, lower, values[significant]
        mass, turn = np.linalg.eigh(lower.T @ (signs[:, None] * lower))
        if mass[0] < -_EMPTY * mass[-1]:
            raise InputError("mass: expected more than nothing, got less")
        heavy = mass > _EMPTY * mass[-1]
        return turn[:, heavy].T @ inverse, lower @ turn[:, heavy], mass[heavy]

    @property
    def mass(self) -> Array:
        """Modal masses (d,), of unit stiffness."""
        return self._eigen[2]

    @property
    def stiffness(self) -> Array:
        """Modal stiffnesses (d,): one."""
        return np.ones(len(self.mass))

    @cached_property
    def _soft(self) -> tuple[Array, Array]:
        """Eigenvalues (k,) and vectors (k, k) of E."""
        return np.linalg.eigh(self._yield)

    @property
    def static(self) -> Array:
        """Flexibilities (k,) of the static part; what the modes have is taken off."""
        return np.concatenate(
            [self.sound.flexibility, self._soft[0], -np.ones(len(self.mass))]
        )

    def displace(self, node: str, at: Array) -> tuple[Array, Array]:
        """Return twists (6, k) of a node's home point in the static part, (6, d) in modes."""
        here = self.terminal(node, at)
        loads, _ = self._masses
        moving = self._flex(here, loads) @ self._eigen[0].T
        return np.hstack([here.modal, here.cuts @ self._soft[1], moving]), moving

    def find_wrenches(
        self, name: str, points: Sequence[tuple[str, Array, Array]]
    ) -> tuple[Array, Array]:
        """Return wrenches in an element, own axes, under forces and inertial loads.

        Parameters
        ----------
        points
            Node, home point (3,) and wrench (6,) there in base axes, of p forces.

        Returns
        -------
            Wrenches (6m, p) under the forces, and (6m, d) per unit ``-s²`` times amplitudes.
        """
        sound = self.sound
        across = sound.resist([name], self.names) @ self._yield
        forces: list[Array] = []
        for node, at, wrench in points:
            own = sound.dislocate([name], node, at).T @ wrench
            forces.append(own + across @ (self.terminal(node, at).cuts.T @ wrench))
        loads, signs = self._masses
        basis = np.hstack([sound.rates, self._beyond])
        own = [sound.move_masses(name).T @ basis]
        for added, (turn, _) in zip(self.inertias, self._turned, strict=True):
            moved = sound.dislocate([name], added.node, added.at)
            own.append(moved.T @ turn.T)
        inertial = (np.hstack(own) + across @ loads.cuts.T) * signs
        return np.array(forces).T, inertial @ self._eigen[1]
