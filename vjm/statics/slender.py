"""How near own weight brings elastic bodies to buckling, which the model leaves out."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from stiffscope.vjm.model.screws import skew
from stiffscope.vjm.statics.analysis import map_chunks
from stiffscope.vjm.statics.equilibrium import find_equilibrium
from stiffscope.vjm.statics.prestress import own_loads

if TYPE_CHECKING:
    from stiffscope.vjm.model.bodies import Elastic
    from stiffscope.vjm.model.mechanism import Mechanism
    from stiffscope.vjm.model.screws import Array
    from stiffscope.vjm.network.network import Places
    from stiffscope.vjm.network.order import Order
    from stiffscope.vjm.statics.analysis import Poses


def find_thrusts(mechanism: Mechanism, poses: Poses) -> dict[str, tuple[float, float]]:
    """Return the axial force of each body with two ends under own weight, where it bends the body most.

    That a body's own axial force bends it (P-Δ) is left out of its stiffness, which is then wrong by about the
    second figure.

    Parameters
    ----------
    mechanism
        Bodies, joints, tool and gravity of the robot.
    poses
        Tool poses (n, k), m and rad, or configurations; those out of reach are left out.

    Returns
    -------
    dict
        By body: the force in N, compression negative, and its size relative to the buckling load of the body
        clamped at its base, to the accuracy of one cubic beam (0.8 %).

    References
    ----------
    Przemieniecki, Theory of Matrix Structural Analysis (1968), ch. 15: geometric stiffness of a beam.
    """
    bodies = {
        b.name: b.elastic
        for b in mechanism.bodies
        if b.elastic is not None and _is_member(b.elastic)
    }
    bends = {name: _bend_by_thrust(elastic) for name, elastic in bodies.items()}

    def work(order: Order, where: Places) -> Array:
        equilibrium = find_equilibrium(order, where, own_loads(order, where))
        out = np.zeros((len(where.tool), len(bodies)))
        for k, (name, elastic) in enumerate(bodies.items()):
            along = (elastic.tip - elastic.base) @ elastic.axes
            out[:, k] = (
                equilibrium.find_wrench(mechanism.rows(name))[:, :3, 0]
                @ along
                / np.linalg.norm(along)
            )
        return out

    forces = map_chunks(mechanism, poses, (len(bodies),), work)
    forces = forces[np.isfinite(forces).all(axis=1)]
    largest = (
        (force[np.argmax(np.abs(force))] for force in forces.T) if len(forces) else ()
    )
    return {
        name: (float(f), float(abs(f) * bends[name]))
        for name, f in zip(bodies, largest, strict=False)
    }


def _is_member(elastic: Elastic) -> bool:
    """Whether a body has two ends at different places."""
    return len(elastic.places) == 2 and bool(np.ptp(elastic.places, axis=0).any())


def _bend_by_thrust(elastic: Elastic) -> float:
    """Return the inverse buckling load of a body clamped at its base, 1/N: of ``C G`` the largest eigenvalue."""
    away = (elastic.tip - elastic.base) @ elastic.axes
    length = float(np.linalg.norm(away))
    along = away / length
    shift = np.hstack([np.eye(3) - np.outer(along, along), np.zeros((3, 3))])
    slope = np.hstack([np.zeros((3, 3)), -skew(along)])
    mixed = shift.T @ slope
    geometric = (
        36.0 * shift.T @ shift
        - 3.0 * length * (mixed + mixed.T)
        + 4.0 * length**2 * slope.T @ slope
    )
    return float(np.linalg.eigvals(elastic.compliance @ geometric).real.max()) / (
        30.0 * length
    )
