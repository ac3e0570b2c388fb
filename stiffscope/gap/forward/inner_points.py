"""Motions of points within an elastic body, between its ends, as a beam of even section has them.

A wrench on the tip strains the cross-section at ``x`` by ``c Pᵀ(tip - x) w``, with the compliance ``c``
of a unit of length, and moves the point at ``s`` by the sum of these strains up to it. The body's own
6×6 is that sum over its whole length and gives ``c``, so that bends, twists and their couplings are its
own. Exact for rods and tubes; an interpolation for other bodies. Own weight between the ends is left out.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations_with_replacement
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.errors import InputError
from stiffscope.gap.forward.terminals import wrenches_at
from stiffscope.vjm.model.screws import shift

if TYPE_CHECKING:
    from stiffscope.gap.campaign.campaign import Sensor
    from stiffscope.runtime.types import Array
    from stiffscope.vjm.model.bodies import Elastic
    from stiffscope.vjm.model.mechanism import Mechanism
    from stiffscope.vjm.network.network import Places

_NODES = (
    3  # of Gauss's rule, exact up to the fifth power of x; the sums are of the second
)


@dataclass(frozen=True)
class InnerPoint:
    """A point between the ends of an elastic body.

    ``share`` is its place from the node ``base`` to the node ``tip``, over the length.
    """

    base: str
    tip: str
    elastic: Elastic
    share: float

    def spread(self, where: Places) -> Array:
        """Return its twist (n or 1, 6, 6) per twist of the tip, both from the base.

        All twists are at M in base axes, as those of nodes.
        """
        elastic = self.elastic
        turn = where.rotation[self.base] @ elastic.axes
        axes = np.zeros((*turn.shape[:-2], 6, 6))
        axes[..., :3, :3] = turn
        axes[..., 3:, 3:] = turn
        place = elastic.base + self.share * (elastic.tip - elastic.base)
        at_tip = twists_at(where, self.tip, elastic.tip)
        at_point = twists_at(where, self.base, place)
        local = find_share(elastic, self.share)
        moved = axes @ local @ np.swapaxes(axes, -1, -2) @ at_tip
        return np.linalg.solve(at_point, moved)


def inner_point(mechanism: Mechanism, sensor: Sensor) -> InnerPoint | None:
    """Return the place of a sensor within an elastic body; None if it is on a node."""
    if sensor.inside is None:
        return None
    body = mechanism.body(mechanism.carrier(sensor.body))
    if body.elastic is None or len(body.nodes) != 2:
        expected = "expected a body between a base and a tip"
        raise InputError(f"sensors.{sensor.name}.body: {expected}, got {body.name}")
    base, tip = body.nodes
    return InnerPoint(base, tip, body.elastic, sensor.inside)


def twists_at(where: Places, node: str, home: Array) -> Array:
    """Return the twist (n or 1, 6, 6) of a point of a node per twist of the node at M."""
    return np.swapaxes(wrenches_at(where, node, home), -1, -2)


def find_share(elastic: Elastic, share: float) -> Array:
    """Return the twist (6, 6) of an inner point per twist of the tip, both from the base.

    Each twist is at its own point in the body's axes, m and rad.

    Parameters
    ----------
    elastic
        Elasticity of a body with two ends.
    share
        Place of the point from the base, over the length.
    """
    away = elastic.axes.T @ (elastic.tip - elastic.base)
    length = float(np.linalg.norm(away))
    if not length:
        return share * np.eye(6)
    # in units of the length, so that the equations for c are of one size
    units = np.repeat([length, 1.0], 3)
    whole = elastic.compliance / np.outer(units, units)
    pairs = list(combinations_with_replacement(range(6), 2))
    basis = np.zeros((len(pairs), 6, 6))
    for k, (i, j) in enumerate(pairs):
        basis[k, i, j] = basis[k, j, i] = 1.0
    along = away / length
    terms = np.array([_gather(vector, along, 1.0) for vector in basis])
    local = np.linalg.lstsq(terms.reshape(len(pairs), 36).T, whole.ravel())[0]
    strain = np.tensordot(local, basis, axes=1)
    partial = _gather(strain, along, share)
    return (partial @ np.linalg.inv(whole)) * np.outer(units, 1.0 / units)


def _gather(strain: Array, along: Array, share: float) -> Array:
    """Return the compliance (6, 6) of a point at a share of a beam of unit length to a wrench on its tip."""
    nodes, weights = np.polynomial.legendre.leggauss(_NODES)
    places = 0.5 * share * (nodes + 1.0)
    out = np.zeros((6, 6))
    for x, weight in zip(places, 0.5 * share * weights, strict=True):
        to_point = shift((share - x) * along)
        to_tip = shift((1.0 - x) * along)
        out += weight * to_point @ strain @ to_tip.T
    return out
