"""Vibrations of the machine with its faults, by a dense model of all nodes' twists.

Each node has six dofs, its twist about the origin of the base axes. What an element does not let
yield at all is a constraint on them, whose null space is the motions that are left; what yields is
a spring. Of the predictor it shares nothing but the description of the robot.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import (  # pyright: ignore[reportMissingTypeStubs]
    eigh,  # pyright: ignore[reportUnknownVariableType]
    null_space,  # pyright: ignore[reportUnknownVariableType]
)

from stiffscope.lab.response import list_elements, place_nodes
from stiffscope.lab.rotations import lever, transform_to

if TYPE_CHECKING:
    from collections.abc import Mapping

    from stiffscope.lab.closure import Located
    from stiffscope.lab.machine import Body, Machine
    from stiffscope.lab.response import Spot
    from stiffscope.lab.rotations import Array
    from stiffscope.lab.structure import Element

    Modal = tuple[Array, Array, Array]

_METRE = 0.2  # m per rad, in decisions on ranks
_YIELDS = 1e-10  # relative compliance below which a direction is rigid
_FREE = 1e-10  # relative singular value of dependent constraints
_IDLE = 1e-13  # relative energy of a motion with neither stiffness nor mass


@dataclass(frozen=True, eq=False)
class DenseModes:
    """Modes (c,) of a machine at one pose.

    Attributes
    ----------
    mass, stiffness
        Modal masses and stiffnesses (c,), in units of the energy at the frequency of `solve`.
    shapes
        Motions (size, c) of all dofs.
    """

    mass: Array
    stiffness: Array
    shapes: Array

    @property
    def hertz(self) -> Array:
        """Natural frequencies (c,), infinite without mass."""
        heavy = self.mass > _IDLE
        squares = self.stiffness.clip(min=0.0) / np.where(heavy, self.mass, 1.0)
        return np.where(heavy, np.sqrt(squares) / (2.0 * np.pi), np.inf)


class DenseMachine:
    """Stiffness and mass of a machine's free motions at one pose, drives held, unloaded.

    Parameters
    ----------
    machine
        The machine with its faults; laws of its slots are linear, as at rest.
    located
        The sound machine's configuration at that pose.
    points
        Where sensors are, by name, for their masses (default: none).
    """

    def __init__(
        self,
        machine: Machine,
        located: Located,
        points: Mapping[str, Spot] | None = None,
    ) -> None:
        self.frames, self._index = place_nodes(machine, located)
        elements = list_elements(machine, located, self.frames, self._index)
        nodes = 6 * (len(self._index) - 1)
        own = sum(len(body.squares) for body in machine.bodies.values())
        self._size = nodes + own
        rows: list[Array] = []
        k = np.zeros((self._size, self._size))
        for element in elements:
            rigid, stretched = self._split(element)
            rows.append(rigid)
            k += stretched.T @ stretched
        self.basis: Array = null_space(np.vstack(rows), rcond=_FREE)
        m = np.zeros_like(k)
        after = nodes
        for body in machine.bodies.values():
            after = self._add_body(body, k, m, after)
        masses = [(load.node, load.centre, load.mass) for load in machine.payloads]
        for name, mass in machine.sensor_masses.items():
            if points and name in points:
                masses.append((points[name].node, points[name].at, mass))
        for node, at, mass in masses:
            moved = self._move(node, at)[:3]
            m += mass * moved.T @ moved
        self._k = self.basis.T @ k @ self.basis
        self._m = self.basis.T @ m @ self.basis

    def _relative(self, element: Element) -> tuple[Array, Array]:
        """Return an element's motion (r, size) in its held directions, and their units (r,)."""
        held = element.held[0]
        carry = element.carry[0]
        out = np.zeros((len(held), self._size))
        ends = [(element.first, -held @ carry)]
        for k, node in enumerate(element.second):
            part = slice(6 * k, 6 * k + 6)
            ends.append((node, held[:, part] @ carry[part]))
        for node, block in ends:
            if node >= 0:
                out[:, 6 * node : 6 * node + 6] += block
        unit = np.tile([1.0] * 3 + [1.0 / _METRE] * 3, len(element.second))
        return out, np.abs(held) @ unit

    def _split(self, element: Element) -> tuple[Array, Array]:
        """Return an element's motions (r, size) in principal directions that do not yield, and in others.

        The former are constraints. The latter are over the root of their compliance: half their
        square is energy.
        """
        across, unit = self._relative(element)
        held = element.held[0]
        soft = held @ element.compliance @ held.T / np.outer(unit, unit)
        values, vectors = np.linalg.eigh(soft)
        across = across / unit[:, None]
        rigid = values <= _YIELDS * values.max(initial=0.0)
        stretched = (vectors[:, ~rigid] / np.sqrt(values[~rigid])).T @ across
        return vectors[:, rigid].T @ across, stretched

    def _add_body(self, body: Body, k: Array, m: Array, after: int) -> int:
        """Add a body's mass, and its modes from dof ``after`` on; return the next free dof."""
        if len(body.nodes) == 1:
            there = self._move(body.name, body.centre)
            turned = self.frames.rotation[body.name][0]
            inertia = np.zeros((6, 6))
            inertia[:3, :3] = body.mass * np.eye(3)
            inertia[3:, 3:] = turned @ body.inertia @ turned.T
            m += there.T @ inertia @ there
            return after
        ends: list[Array] = []
        for node, at in zip(body.nodes, body.places, strict=True):
            axes = self.frames.rotation[node][0] @ body.axes
            ends.append(self._carry(node, transform_to(axes, self._point(node, at))))
        moved = np.vstack(ends)
        if not len(body.moving):
            share = np.tile([1.0] * 3 + [0.0] * 3, len(ends)) * body.mass / len(ends)
            m += moved.T @ (share[:, None] * moved)
            return after
        count = len(body.squares)
        own = np.zeros((count, self._size))
        own[:, after : after + count] = np.eye(count)
        whole = np.vstack([moved, own])
        m += whole.T @ body.moving @ whole
        k += own.T @ (body.squares[:, None] * own)
        return after + count

    def _point(self, node: str, at: Array) -> Array:
        return self.frames.point(node, np.asarray(at))[0]

    def _carry(self, node: str, transform: Array) -> Array:
        """Return a transform (6, 6) of a node's twist as rows (6, size)."""
        out = np.zeros((6, self._size))
        k = self._index[node]
        if k >= 0:
            out[:, 6 * k : 6 * k + 6] = transform
        return out

    def _move(self, node: str, at: Array) -> Array:
        """Return the twist (6, size) of a node's home point."""
        return self._carry(node, lever(self._point(node, at)))

    def stiffen(self, spot: Spot, stiffness: Array) -> None:
        """Add a spring (3,) between a spot and the ground, unloaded as it is, N/m."""
        moved = self._move(spot.node, spot.at)[:3] @ self.basis
        self._k = self._k + moved.T @ (stiffness[:, None] * moved)

    def solve(self, about: float) -> DenseModes:
        """Return the modes, by frequency; idle motions, without stiffness and mass, are left out.

        Parameters
        ----------
        about
            Frequency, Hz, of the size of the lowest ones.
        """
        square = (2.0 * np.pi * about) ** 2
        whole = self._k + square * self._m
        diagonal = np.diagonal(whole)
        unit = 1.0 / np.sqrt(diagonal.clip(min=1e-12 * diagonal.max()))
        values, vectors = np.linalg.eigh(whole * np.outer(unit, unit))
        kept = values > _IDLE * values[-1]
        root = unit[:, None] * vectors[:, kept] / np.sqrt(values[kept])
        mass, turned = eigh(root.T @ self._m @ root)
        order = np.argsort(-mass, kind="stable")  # heavy modes are slow
        stiffness = 1.0 - square * mass[order]
        return DenseModes(mass[order], stiffness, self.basis @ root @ turned[:, order])

    def find_twist(self, modes: DenseModes, node: str) -> Array:
        """Return the twist (6, c) of a node about the origin in each mode."""
        return self._carry(node, np.eye(6)) @ modes.shapes
