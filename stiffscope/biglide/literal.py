"""Published ``K_θ - K_G`` (docs/theory.md 5.3): each elastic body softened separately by its loads.

It serves the audit only; ``stiffscope.vjm.prestress`` models a loaded mechanism correctly.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.vjm.condensation import condense_network
from stiffscope.vjm.equilibrium import tool_stiffness
from stiffscope.vjm.kinematics import configure
from stiffscope.vjm.network import place_nodes
from stiffscope.vjm.order import find_order

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import ArrayLike

    from stiffscope.vjm.mechanism import Mechanism
    from stiffscope.vjm.screws import Array


@dataclass(frozen=True, eq=False)
class Behind:
    """Force (3,) in N, base axes, on an elastic body, at point ``at`` (3,) of a node at home."""

    force: Array
    node: str
    at: Array


def literal_stiffness(mechanism: Mechanism, poses: ArrayLike, behind: Mapping[str, Sequence[Behind]]) -> Array:
    """Return the stiffness (n, 6, 6) at M with ``K_θ - K_G`` for each elastic body in ``behind``.

    Raises InputError for a pose out of reach.
    """
    found = configure(mechanism, poses).require_valid()
    order, where = find_order(mechanism, found.linkage), place_nodes(found)
    softened: dict[str, Array] = {}
    for e in order.elements:
        if e.name not in behind:
            continue
        frame = where.frame(e)
        to_own = np.swapaxes(frame.matrix(), -1, -2)
        hessian = np.zeros((1, 6, 6))
        for load in behind[e.name]:
            away = where.point(load.node, load.at) - where.tool - frame.origin()
            lever = (to_own @ away[..., None])[..., 0]
            hessian = hessian + load_hessian(to_own @ load.force, lever)
        c = np.linalg.solve(np.eye(6) - e.compliance @ hessian, e.compliance)
        softened[e.name] = np.linalg.cholesky(0.5 * (c + np.swapaxes(c, -1, -2)))
    return tool_stiffness(condense_network(order, replace(where, rigid=False, softened=softened)))


def load_hessian(force: Array, lever: Array) -> Array:
    """Return the Hessian (..., 6, 6), Tx to Rz, of the work of a force at a lever, both (..., 3).

    ``H_ab = f_b r_a - (f·r) δ_ab`` for a ≤ b in the rotational block, symmetric, zero elsewhere.
    """
    block = lever[..., :, None] * force[..., None, :]
    block = block - np.einsum("...i,...i", force, lever)[..., None, None] * np.eye(3)
    upper = np.triu(block)
    hessian = np.zeros((*block.shape[:-2], 6, 6))
    hessian[..., 3:, 3:] = upper + np.swapaxes(np.triu(block, 1), -1, -2)
    return hessian
