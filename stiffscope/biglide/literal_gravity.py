"""Published gravity model of the Biglide (docs/theory.md 5.3): ``K_θ - K_G`` of loaded bodies."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from stiffscope.biglide.literal import Behind, literal_stiffness
from stiffscope.errors import InputError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from stiffscope.vjm.bodies import Body
    from stiffscope.vjm.mechanism import Mechanism
    from stiffscope.vjm.screws import Array

LIMBS = {f"limb{i}": tuple(f"limb{i}.link{j}" for j in (1, 2, 3)) for i in (1, 2)}


def literal_gravity(mechanism: Mechanism, poses: ArrayLike) -> Array:
    """Return the Biglide's published stiffness (n, 6, 6) at M under gravity (docs/theory.md 5.3).

    Each link carries a sixth of the platform's weight at M; each slider carries half of it, and its
    links' weights at their middles. Raises InputError for another robot or a pose out of reach.
    """
    require_biglide(mechanism)
    bodies = {body.name: body for body in mechanism.bodies}
    platform = mechanism.gravity * bodies["platform"].mass
    behind: dict[str, list[Behind]] = {}
    for limb, links in LIMBS.items():
        behind[f"{limb}.slider"] = [_at_tool(mechanism, platform / 2.0)]
        for link in links:
            behind[link] = [_at_tool(mechanism, platform / 6.0)]
            behind[f"{limb}.slider"].append(_at_middle(bodies[link], mechanism.gravity))
    return literal_stiffness(mechanism, poses, behind)


def require_biglide(mechanism: Mechanism) -> None:
    """Raise InputError if a mechanism lacks a body of the published equations."""
    elastic = {body.name for body in mechanism.bodies if body.elastic is not None}
    needed = {*(f"{limb}.slider" for limb in LIMBS), *(link for links in LIMBS.values() for link in links)}
    if not needed <= elastic or "platform" not in {body.name for body in mechanism.bodies}:
        raise InputError("--gravity literal: expected the Biglide, whose paper has it; none or exact serve any robot")


def _at_tool(mechanism: Mechanism, force: Array) -> Behind:
    return Behind(force, mechanism.tool.body, mechanism.tool.at)


def _at_middle(link: Body, gravity: Array) -> Behind:
    ends = () if link.elastic is None else link.elastic.places
    return Behind(link.mass * gravity, link.nodes[0], np.mean(ends, axis=0))
