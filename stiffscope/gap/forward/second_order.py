"""Motions at the equilibrium that is reached, less their first order at the command.

A robot that yields by an angle θ carries its load at a lever that has turned by θ, so first order
errs by a share θ of a motion. Readings that show this are taken at the exact equilibrium under
dead loads (`vjm.statics.prestress.bend_network`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.errors import InputError
from stiffscope.gap.campaign.quantities import DEVIATION
from stiffscope.gap.forward.elastic_state import measure_motion
from stiffscope.gap.forward.terminals import find_weight, wrenches_at
from stiffscope.vjm.model.checks import GROUND
from stiffscope.vjm.network.network import END, FOOT, lump_masses
from stiffscope.vjm.network.order import find_order
from stiffscope.vjm.statics.prestress import bend_network

if TYPE_CHECKING:
    from stiffscope.gap.forward.robot_readings import RobotReadings
    from stiffscope.runtime.types import Array, Flags, Indices
    from stiffscope.vjm.network.network import Places


@dataclass(frozen=True)
class SecondOrderSettings:
    """When readings are taken at the equilibrium reached; both err on the side of doing so."""

    visible: float = 1.0
    """Standard deviations: largest estimated second order of a campaign's readings beyond which
    equilibria are found; below, it adds less than `lack_of_fit.MODEL_NOISE` allows to the noise."""
    slight: float = 0.1
    """Standard deviations: estimate below which a single reading is left at first order; it adds
    half a percent to the reading's scatter."""
    unstated: float = 1e-3
    """Noise over the rms of readings of its kind where none is stated: a good gauge's."""
    converged: float = 1e-9
    """Rad, or of the robot's length: displacements beyond which equilibrium is iterated."""


SETTINGS = SecondOrderSettings()


def find_second_order(readings: RobotReadings, linear: Array) -> Array:
    """Return the motions (n, 6) of readings at equilibrium less those of first order.

    Zero where they are far below the noise, and where no equilibrium is found.

    Parameters
    ----------
    readings
        The robot with its effects.
    linear
        Motions (n, 6) of first order.
    """
    out = np.zeros((len(readings.campaign), 6))
    estimate = _estimate(readings, linear)
    if not estimate.max(initial=0.0) > SETTINGS.visible:
        return out
    rows = np.flatnonzero(estimate > SETTINGS.slight)
    try:
        out[rows] = _Equilibria(readings, rows).difference
    except (InputError, np.linalg.LinAlgError):
        return out
    return out


def shows_second_order(
    readings: RobotReadings, motions: Array, rest: Array | None = None
) -> bool:
    """Return whether readings would show the second order of motions (n, 6), and as much as a rest.

    rest: part of the readings (n,), in their units, that the second order must equal; None: nothing.
    """
    estimate = _estimate(readings, motions)
    if not estimate.max(initial=0.0) > SETTINGS.visible:
        return False
    if rest is None:
        return True
    left = float(np.linalg.norm(rest / readings.expected_noise))
    return float(np.linalg.norm(estimate)) >= left


def _estimate(readings: RobotReadings, linear: Array) -> Array:
    """Return the expected second order (n,) of readings of motions over their noise."""
    c = readings.campaign
    length = readings.length
    turn = _turn(linear, length)
    apart = readings.is_motion & ~c.shows_rest
    if readings.weighs and apart.any():
        for k, mine in readings.by_sensor(apart):
            rest = readings.elastic_state.move_sensor(k) @ readings.rest_loads
            turn[mine] += _turn(rest, length)[c.pose[mine]]
    shift = np.linalg.norm(linear[:, :3], axis=1)
    size = turn * np.where(c.direction >= 3, turn, shift)
    return np.where(readings.is_motion, size / readings.expected_noise, 0.0)


def _turn(twist: Array, length: float) -> Array:
    """Return the angle (n,) of a twist (n, 6), at least that of a lever of the robot's length."""
    shift, turn = np.split(twist, 2, axis=1)
    return np.maximum(
        np.linalg.norm(turn, axis=1), np.linalg.norm(shift, axis=1) / length
    )


@dataclass(frozen=True)
class _Equilibria:
    """Equilibria of some readings (m,), each under its loads and, for deflections, at rest."""

    readings: RobotReadings
    rows: Indices

    @cached_property
    def _cells(self) -> tuple[Array, Indices, Indices]:
        """Distinct states (s, 8) of pose, load and wrench; those of readings (m,) and at rest."""
        r = self.readings
        c = r.campaign
        wrench = r.force_scale * r.true_wrench[self.rows]
        pulled = c.kind[self.rows] != DEVIATION
        named = np.column_stack([c.pose[self.rows], c.load[self.rows]])
        keys: Array = np.hstack([named.astype(float), wrench])
        keys[~pulled, 1:] = 0.0
        rest = np.zeros_like(keys)
        rest[:, 0] = keys[:, 0]
        every = np.concatenate([keys, rest])
        states, which = np.unique(every, axis=0, return_inverse=True)
        loaded, unloaded = np.split(which.ravel().astype(np.int64), 2)
        return states, loaded, unloaded

    @cached_property
    def places(self) -> Places:
        """Nodes at the equilibrium of each state. Raises InputError if there is none."""
        r = self.readings
        state = r.elastic_state
        mechanism = state.mechanism
        order = find_order(mechanism, r.at.configurations.linkage)
        cells = self._cells[0]
        pose = cells[:, 0].astype(np.int64)
        rest = r.at.rest.some(pose)

        def push(where: Places, chosen: Flags) -> dict[str, Array]:
            return self._find_loads(where, cells[chosen])

        bent = bend_network(order, rest, SETTINGS.converged, push)
        if not bent.found.all():
            raise InputError("no equilibrium under these loads")
        return bent.there

    def _find_loads(self, where: Places, cells: Array) -> dict[str, Array]:
        """Return the dead loads (s, 6, 1) on nodes of some states (s, 8) at displaced places."""
        r = self.readings
        mechanism = r.elastic_state.mechanism
        nodes: dict[str, Array] = {}

        def add(node: str, wrench: Array) -> None:
            node = FOOT if node == GROUND else node
            nodes[node] = nodes[node] + wrench if node in nodes else wrench

        force = cells[:, 2:, None]
        at_tool = cells[:, 1] < 0
        add(END, np.where(at_tool[:, None, None], force, 0.0))
        for k, load in enumerate(r.campaign.loads):
            forces = np.where((cells[:, 1] == k)[:, None, None], force, 0.0)
            if forces.any():
                add(load.body, wrenches_at(where, load.body, load.at) @ forces)
        if r.weighs:
            gravity = mechanism.gravity
            for node, mass in lump_masses(mechanism, where).items():
                add(node, mass.weight(gravity))
        weight = float(r.weighs) * mechanism.gravity
        for payload in r.elastic_state.payloads:
            add(payload.body, find_weight(payload, where, weight)[..., None])
        return nodes

    @property
    def difference(self) -> Array:
        """Motions (m, 6) less those of first order."""
        r = self.readings
        c = r.campaign
        states, loaded, unloaded = self._cells
        state = r.elastic_state
        pose = states[:, 0].astype(np.int64)
        rest = r.at.rest.some(pose)
        out = np.zeros((len(self.rows), 6))
        where = np.full(len(c), -1)
        where[self.rows] = np.arange(len(self.rows))
        chosen = np.zeros(len(c), dtype=np.bool_)
        chosen[self.rows] = True
        for k, mine in r.by_sensor(chosen):
            here = where[mine]
            exact = measure_motion(r.campaign, r.at.mechanism, k, self.places, rest)
            exact = np.broadcast_to(exact, (len(states), 6))
            linear = np.einsum(
                "nij,nj->ni", state.move_sensor(k)[c.pose[mine]], r.applied_loads[mine]
            )
            away = exact[loaded[here]] - linear
            deflects = c.is_difference[mine]
            displaced = state.displace_sensor(k)[c.pose[mine]]
            before = np.where(deflects[:, None], exact[unloaded[here]], displaced)
            out[here] = away - before
        return out
