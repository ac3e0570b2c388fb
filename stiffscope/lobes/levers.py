"""Which element raises the stable depth most: changes of the limit at its worst speed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from stiffscope.lobes.methods import limits_at
from stiffscope.lobes.model import Lever
from stiffscope.lobes.response import ToolResponse, find_remainder
from stiffscope.vjm.model.screws import shift
from stiffscope.vjm.network.network import place_nodes
from stiffscope.vjm.vibration.modes import modes, strain_products

if TYPE_CHECKING:
    from collections.abc import Callable

    from stiffscope.lobes.engagement import Engagement
    from stiffscope.lobes.methods import Method
    from stiffscope.runtime.types import Array, Flags
    from stiffscope.vjm.kinematics.configurations import Configurations
    from stiffscope.vjm.model.mechanism import Mechanism
    from stiffscope.vjm.vibration.modes import Modes

_EVERY = 60  # modes, in the space of which the robot is changed
_STEP = 1e-3  # relative change of an element


def find_levers(
    mechanism: Mechanism,
    found: Configurations,
    robot: ToolResponse,
    *,
    couple: Callable[[ToolResponse], ToolResponse],
    cut: Engagement,
    axes: Array,
    speed: float,
    method: Method,
) -> tuple[Lever, ...]:
    """Return the effect of each element's stiffness and of each elastic body's mass.

    With E the products of an element's strains in the modes, and M those of a body's inertia, the
    modes of the changed robot are those of ``diag(ω²) + e E`` against ``1 + e M``: a reanalysis in
    the space of sixty modes.

    Parameters
    ----------
    mechanism, found
        Mechanism, and one configuration.
    robot
        Response of the robot there, without a tool holder.
    couple
        Function that adds the tool holder to a response.
    cut, axes
        Engagement, and axes (3, 3) of the cut.
    speed, method
        Worst spindle speed, rev/s, and method of the limit.

    References
    ----------
    R. L. Fox, M. P. Kapoor, Rates of change of eigenvalues and eigenvectors, AIAA Journal 6, 1968.
    """
    shaken = modes(mechanism, found, _EVERY)
    known = np.isfinite(shaken.frequencies[0])
    squares = (2.0 * np.pi * shaken.frequencies[0][known]) ** 2
    shapes = axes @ shaken.tool[0, :3][:, known]
    count = len(squares)
    stiffer = {
        name: product[0][np.ix_(known, known)]
        for name, product in strain_products(mechanism, found, _EVERY).items()
    }
    heavier = _moving_masses(mechanism, found, shaken, known)
    stiffness = list[np.ndarray]([np.zeros((count, count))])
    inertia = list[np.ndarray]([np.zeros((count, count))])
    for product in stiffer.values():
        for step in (_STEP, -_STEP):
            stiffness.append(step * product)
            inertia.append(np.zeros((count, count)))
    for name, (_, product) in heavier.items():
        for step in (_STEP, -_STEP):
            stiffness.append(step * stiffer[name])
            inertia.append(step * product)
    values, vectors = _solve_changed(squares, np.array(stiffness), np.array(inertia))
    order = np.minimum(np.arange(count), robot.damping.shape[1] - 1)
    still = robot.static[0] - (shapes / squares) @ shapes.T
    n = len(values)
    zeros = np.zeros((n, count))
    changed = ToolResponse(
        squares=values,
        damping=np.tile(robot.damping[0][order], (n, 1)),
        shapes=shapes @ vectors,
        remainder=np.tile(find_remainder(still[None], robot.static), (n, 1, 1)),
        frequency_error=zeros,
        damping_error=zeros,
    )
    limits = limits_at(couple(changed), cut, np.array([speed]), method)
    change = np.log(limits.depth[1::2, 0] / limits.depth[2::2, 0]) / (2.0 * _STEP)
    by_stiffness = dict(zip(stiffer, change, strict=False))
    by_mass = dict(zip(heavier, change[len(stiffer) :], strict=True))
    levers = list[Lever]()
    for name, per_cent in by_stiffness.items():
        per_kilogram = np.nan
        if name in by_mass:
            per_kilogram = float(by_mass[name] / heavier[name][0])
        levers.append(Lever(name, float(per_cent), per_kilogram))
    levers.sort(key=lambda lever: -lever.per_cent)
    return tuple(levers)


def _solve_changed(
    squares: Array, stiffness: Array, inertia: Array
) -> tuple[Array, Array]:
    """Return squares (n, m) and vectors (n, m, m), of unit modal mass, of changed modes."""
    identity = np.eye(len(squares))
    half = np.linalg.inv(np.linalg.cholesky(identity + inertia))
    whole = half @ (np.diag(squares) + stiffness) @ half.mT
    values, turned = np.linalg.eigh(whole)
    return values, half.mT @ turned


def _moving_masses(
    mechanism: Mechanism, found: Configurations, shaken: Modes, known: Flags
) -> dict[str, tuple[float, Array]]:
    """Return mass, kg, and products (m, m) of the inertia in the modes, of elastic bodies.

    The inertia is taken as the mass in equal shares at the ends.
    """
    out: dict[str, tuple[float, Array]] = {}
    where = place_nodes(found)
    for body in mechanism.bodies:
        if body.elastic is None or not body.mass:
            continue
        share = body.mass / len(body.nodes)
        product = np.zeros((known.sum(), known.sum()))
        for node, home in zip(body.nodes, body.elastic.places, strict=True):
            if node in shaken.shapes:  # the others stand
                carry = shift(where.point(node, home) - where.tool)[0]
                moved = (carry @ shaken.shapes[node][0][:, known])[:3]
                product += share * (moved.T @ moved)
        out[body.name] = body.mass, product
    return out
