"""Terminal wrenches of loads, sensors, weights and inertia on nodes, at M in base axes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.vjm.model.checks import GROUND
from stiffscope.vjm.model.screws import Frame
from stiffscope.vjm.network.network import FOOT

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from stiffscope.gap.campaign.campaign import Sensor
    from stiffscope.gap.effects.effect import Payload
    from stiffscope.runtime.types import Array
    from stiffscope.vjm.model.mechanism import Mechanism
    from stiffscope.vjm.network.network import Places

_HELD_MOMENT = 1e-9  # relative rounding error of a moment


@dataclass(frozen=True)
class Push:
    """A wrench on a node for each of some terminals, at M in base axes."""

    node: str
    wrench: Array
    """Wrench (n or 1, 6, k) for unit loads."""
    cases: slice
    """Its k terminals."""
    carrier: str
    """Node with which the point moves on which its forces act."""
    point: Array
    """That point (n or 1, 3), base axes, m."""

    @property
    def force(self) -> Array:
        """Force (n or 1, 3, k) for unit loads."""
        return self.wrench[:, :3]


def unit_wrenches(sensor: Sensor) -> Array:
    """Return the unit wrench (6, 1) conjugate to a sensor's reading; (6, 6) for a target."""
    return np.eye(6) if sensor.absolute else sensor.along[:, None]


def wrenches_at(where: Places, node: str, home: Sequence[float] | Array) -> Array:
    """Return ``[[I, 0], [S(r), I]]`` (n or 1, 6, 6): wrench at M per unit wrench at a point."""
    return where.wrenches(FOOT if node == GROUND else node, np.array(home))


def find_weight(payload: Payload, where: Places, gravity: Array) -> Array:
    """Return the wrench (n, 6) of a payload's weight and pull at M in base axes."""
    one, other = push_payload(payload, where, gravity, slice(1))
    return (one.wrench + other.wrench)[..., 0]


def push_payload(
    payload: Payload, where: Places, gravity: Array, cases: slice
) -> Iterator[Push]:
    """Yield the forces of a payload: its pull and weight, and the pair of its first moments."""
    arm = where.rotation[payload.body] @ payload.moments
    at = where.point(payload.body, payload.at)
    of_mass = (payload.mass - payload.carried) * gravity + payload.force
    for point, force in ((at, of_mass - gravity), (at + arm, gravity)):
        lever = point - where.tool
        pushed = np.broadcast_to(force, lever.shape)
        wrench = np.hstack([pushed, np.cross(lever, pushed)])[..., None]
        yield Push(payload.body, wrench, cases, payload.body, point)


def find_inertial_forces(
    mechanism: Mechanism, where: Places, shapes: Mapping[str, Array]
) -> dict[str, Array]:
    """Return wrenches ``M v`` (n, 6, c) on nodes at M in base axes for node twists v (n, 6, c).

    Elastic bodies contribute their condensed mass, without internal modes.
    """
    out: dict[str, Array] = {}

    def add(node: str, wrench: Array) -> None:
        out[node] = out[node] + wrench if node in out else wrench

    def move_node(node: str, at: Array, axes: Array) -> tuple[Array, Array]:
        """Return the adjoint (n, 6, 6) of a node's axes at a point, and its twist (n, 6, c)."""
        frame = Frame(where.rotation[node] @ axes, where.point(node, at) - where.tool)
        back = frame.inverse_adjoint()
        return back, back @ shapes[node]

    for body in mechanism.bodies:
        if body.elastic is None:
            whole = np.kron(np.diag([1.0, 0.0]), body.mass * np.eye(3))
            whole[3:, 3:] = (
                0.0 if body.inertia is None else 0.5 * (body.inertia + body.inertia.T)
            )
            if whole.any():
                centre = np.zeros(3) if body.centre is None else body.centre
                back, twist = move_node(body.name, centre, np.eye(3))
                add(body.name, np.swapaxes(back, -1, -2) @ (whole @ twist))
            continue
        elastic = body.elastic
        places = zip(body.nodes, elastic.places, strict=True)
        ends = [move_node(node, at, elastic.axes) for node, at in places]
        if elastic.dynamics is None:
            mass = np.diag(
                np.tile(np.repeat([body.mass / len(ends), 0.0], 3), len(ends))
            )
        else:
            factor = elastic.dynamics.factor[:, : 6 * len(ends)]
            mass = factor.T @ factor
        forces = mass @ np.concatenate(
            np.broadcast_arrays(*(twist for _, twist in ends)), axis=1
        )
        shares = np.split(forces, len(ends), axis=1)
        for node, (back, _), force in zip(body.nodes, ends, shares, strict=True):
            add(node, np.swapaxes(back, -1, -2) @ force)
    return out
