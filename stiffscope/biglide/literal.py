"""Published ``K_θ - K_G`` (docs/theory.md 5.3): each elastic body softened separately by its loads.

It serves the audit and `--gravity literal` of the Biglide only; ``stiffscope.vjm.statics.prestress`` models
a loaded mechanism correctly.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.errors import require
from stiffscope.vjm.kinematics.configurations import configure
from stiffscope.vjm.network.condensation import condense_network
from stiffscope.vjm.network.network import place_nodes
from stiffscope.vjm.network.order import find_order
from stiffscope.vjm.statics.equilibrium import tool_stiffness

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import ArrayLike

    from stiffscope.vjm.model.mechanism import Mechanism
    from stiffscope.vjm.model.screws import Array


LIMBS = {f"limb{i}": tuple(f"limb{i}.link{j}" for j in (1, 2, 3)) for i in (1, 2)}


@dataclass(frozen=True, eq=False)
class Behind:
    """Force (3,) in N, base axes, on an elastic body, at point ``at`` (3,) of a node at home."""

    force: Array
    node: str
    at: Array


def literal_gravity(mechanism: Mechanism, poses: ArrayLike) -> Array:
    """Return the Biglide's published stiffness (n, 6, 6) at M under gravity (docs/theory.md 5.3).

    Each link carries a sixth of the platform's weight at M; each slider carries half of it, and its
    links' weights at their middles. Raises InputError for another robot or a pose out of reach.
    """
    require_biglide(mechanism)
    bodies = {body.name: body for body in mechanism.bodies}
    tool = mechanism.tool
    platform = mechanism.gravity * bodies["platform"].mass
    behind: dict[str, list[Behind]] = {}
    for limb, links in LIMBS.items():
        carried = behind[f"{limb}.slider"] = [
            Behind(platform / 2.0, tool.body, tool.at)
        ]
        for link in (bodies[name] for name in links):
            behind[link.name] = [Behind(platform / 6.0, tool.body, tool.at)]
            ends = () if link.elastic is None else link.elastic.places
            weight = link.mass * mechanism.gravity
            carried.append(Behind(weight, link.nodes[0], np.mean(ends, axis=0)))
    return literal_stiffness(mechanism, poses, behind)


def require_biglide(mechanism: Mechanism) -> None:
    """Raise InputError if a mechanism lacks a body of the published equations."""
    elastic = {body.name for body in mechanism.bodies if body.elastic is not None}
    needed = {f"{limb}.slider" for limb in LIMBS}.union(*LIMBS.values())
    require(
        needed <= elastic and "platform" in {body.name for body in mechanism.bodies},
        "--gravity literal",
        "the Biglide, whose paper has it; none or exact serve any robot",
    )


def literal_stiffness(
    mechanism: Mechanism, poses: ArrayLike, behind: Mapping[str, Sequence[Behind]]
) -> Array:
    """Return the stiffness (n, 6, 6) at M with ``K_θ - K_G`` for each elastic body in ``behind``.

    Raises InputError for a pose out of reach.
    """
    configurations = configure(mechanism, poses).require_valid()
    order = find_order(mechanism, configurations.linkage)
    where = place_nodes(configurations)
    softened = replace(where, rigid=False)
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
        factor = where.adjoint(e) @ np.linalg.cholesky(
            0.5 * (c + np.swapaxes(c, -1, -2))
        )
        softened.seen[e.name] = e, factor, where.columns(e)[1]
    return tool_stiffness(condense_network(order, softened))


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
