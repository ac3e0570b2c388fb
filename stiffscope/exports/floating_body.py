"""An elastic body as rigid bodies in a chain, with springs and inertias on their coordinates.

Simulators of rigid bodies have no consistent mass matrix. The body's own mean-axis frame has one: in
it rigid motion and deformation are not coupled by inertia, so that a rigid body with the mass, centre
and inertia of the part is exact, and what remains is the inertia of deformation alone. Springs that
act along linear combinations of a chain's joint coordinates, and inertias along the same
combinations, carry both: the chain has the stiffness and the mass matrix of the superelement.

References
----------
A. A. Shabana, Dynamics of Multibody Systems, 5th ed., 2020, sect. 3.7 and 5.1 (mean axes).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import cholesky, eigh, solve_triangular

from stiffscope.vjm.model.bodies import rigid_motions
from stiffscope.vjm.model.screws import shift

if TYPE_CHECKING:
    from stiffscope.vjm.model.bodies import Body, Elastic
    from stiffscope.vjm.model.dynamics import Dynamics
    from stiffscope.vjm.model.screws import Array

_SEEN = 1e-3  # square root of a mode's share of the mass, below which it moves none
_FLAT = 1e-7  # smallest moment of inertia over mass times squared size
_HELD = 10.0  # of the highest frequency: that of mean axes on what holds them
_EIGENVALUE = 1e-13  # of a compliance with unit diagonal, relative: rigid below


@dataclass(frozen=True, eq=False)
class Springs:
    """Springs ``½ k_i (c_iᵀ x)²`` and inertias ``½ a_i (c_iᵀ ẋ)²`` along joint coordinates x.

    ``directions`` (s, m): rows c_i; ``stiffness`` and ``armature`` (s,), SI.
    """

    directions: Array
    stiffness: Array
    armature: Array


@dataclass(frozen=True, eq=False)
class FloatingBody:
    """An elastic body of n ends as a chain: root end, rigid body of its mass, further ends.

    Attributes
    ----------
    order
        Indices of the ends along the chain, the root first.
    mass, centre, inertia
        Of the rigid body, kg, (3,) m and (3, 3) kg·m² about the centre, in part axes at the root's
        place; zero mass: the chain has no such body.
    end_masses
        (n,) point masses at the ends, in the order of the chain; kg.
    flywheels
        Number of modal coordinates after the last end, which move no mass.
    springs
        On coordinates: six of the rigid body, at its centre, if it has a mass; six of each further
        end, at its place, relative to the body before it in the chain; the modal ones.
    """

    order: tuple[int, ...]
    mass: float
    centre: Array
    inertia: Array
    end_masses: Array
    flywheels: int
    springs: Springs


def elastic_of(body: Body) -> Elastic:
    """Return the elasticity of an elastic body."""
    if body.elastic is None:
        raise TypeError(f"{body.name} is rigid")
    return body.elastic


def float_body(
    body: Body,
    root: int,
    smallest: Array,
    highest: float,
) -> FloatingBody:
    """Return an elastic body as a chain from one of its ends.

    Parameters
    ----------
    body
        Elastic body.
    root
        Index of the end from which the chain starts.
    smallest
        (6,) compliances, m/N and rad/(N·m), for directions in which the body is rigid.
    highest
        Angular frequency, rad/s, below which all coordinates of the chain vibrate.

    Returns
    -------
    FloatingBody
        Of the same compliance and, as far as frequencies below ``highest``, of the same mass matrix.
    """
    elastic = elastic_of(body)
    count = len(elastic.ends)
    order = (root, *(k for k in range(count) if k != root))
    local = (elastic.places - elastic.places[root]) @ elastic.axes
    stiffness = clamped_stiffness(body, root, smallest)
    places = local[list(order)]
    if elastic.dynamics is None:
        centre = np.zeros(3)
        strain = _chain(places, None)
        masses = np.full(count, body.mass / count)
        springs = diagonalize(strain.T @ stiffness @ strain, None, highest)
        return FloatingBody(
            order=order,
            mass=0.0,
            centre=centre,
            inertia=np.zeros((3, 3)),
            end_masses=masses,
            flywheels=0,
            springs=springs,
        )
    return _with_dynamics(elastic.dynamics, order, places, stiffness, highest)


def clamped_stiffness(body: Body, root: int, smallest: Array) -> Array:
    """Return the stiffness (6m, 6m) of all ends but one, which is clamped, in part axes.

    The ends keep the order of the body. Directions in which it is rigid have the ``smallest``
    compliances (6,).
    """
    elastic = elastic_of(body)
    m = len(elastic.ends) - 1
    inner = np.linalg.inv(_fill(elastic.compliance, np.tile(smallest, m)))
    if root == 0:
        return inner
    local = (elastic.places - elastic.places[0]) @ elastic.axes
    carry = np.hstack([-rigid_motions(local)[6:], np.eye(6 * m)])
    whole = carry.T @ inner @ carry
    keep = np.delete(np.arange(6 * m + 6), slice(6 * root, 6 * root + 6))
    return whole[np.ix_(keep, keep)]


def _fill(compliance: Array, smallest: Array) -> Array:
    """Return a compliance with small values in the directions in which it has none."""
    diagonal = np.diagonal(compliance)
    scale = np.sqrt(np.where(diagonal > 0.0, diagonal, smallest))
    unit = compliance / np.outer(scale, scale)
    values, vectors = np.linalg.eigh(0.5 * (unit + unit.T))
    rigid = values < _EIGENVALUE * max(values[-1], 1.0)
    if not rigid.any():
        return compliance
    least = (vectors.T @ np.diag(smallest / scale**2) @ vectors).diagonal()
    values = np.where(rigid, least, values)
    return np.outer(scale, scale) * ((vectors * values) @ vectors.T)


def _chain(places: Array, centre: Array | None) -> Array:
    """Return the twists (6m, c) of all ends but the first, relative to it, for the coordinates.

    ``places`` (n, 3) of the ends, ``centre`` (3,) of the rigid body between the first and the
    second; None if there is no such body.
    """
    joints = places[1:] if centre is None else np.vstack([centre, places[1:]])
    before = len(joints) - len(places) + 1
    out = np.zeros((6 * (len(places) - 1), 6 * len(joints)))
    for row, place in enumerate(places[1:]):
        for column in range(row + before + 1):
            at = slice(6 * row, 6 * row + 6), slice(6 * column, 6 * column + 6)
            out[at] = shift(place - joints[column])
    return out


def _with_dynamics(
    dynamics: Dynamics,
    order: tuple[int, ...],
    places: Array,
    stiffness: Array,
    highest: float,
) -> FloatingBody:
    """Return the chain of a body with a consistent mass and fixed-interface modes."""
    size = dynamics.ends_size
    modes = len(dynamics.squares)
    rows = [np.arange(6 * k, 6 * k + 6) for k in order]
    chosen = np.concatenate([*rows, np.arange(size, size + modes)])
    mass = dynamics.mass[np.ix_(chosen, chosen)]
    # Coordinates: twist of the root with all else rigid, then strains of the ends, then modes.
    carry = np.eye(size + modes)
    carry[:size, :6] = rigid_motions(places)
    mass = carry.T @ mass @ carry
    total, centre, inertia = _rigid_inertia(mass[:6, :6])
    to_centre = shift(centre)
    body_mass: Array = np.zeros((6, 6))
    body_mass[:3, :3] = total * np.eye(3)
    body_mass[3:, 3:] = inertia
    coupled = np.linalg.solve(to_centre.T, mass[:6, 6:])
    mean = np.linalg.solve(
        body_mass, coupled
    )  # motion of the mean axes with strains and modes
    rest = mass[6:, 6:] - mean.T @ body_mass @ mean
    root = cholesky(body_mass)  # upper; root @ mean: motion in units of equal energy
    strains = size - 6
    by_modes = root @ mean[:, strains:]
    left, sizes, right = np.linalg.svd(by_modes)
    seen = int((sizes > _SEEN).sum())
    moved = left.T @ root  # of the rigid body, rows sorted by the modes' shares
    chain = _chain(places, centre)
    free = modes - seen
    coordinates = chain.shape[1] + free
    strain = np.hstack([chain, np.zeros((strains, free))])
    relative = np.zeros((6, coordinates))
    relative[:, :6] = moved
    relative -= moved @ mean[:, :strains] @ strain
    turned = np.zeros((modes, coordinates))
    turned[:seen] = relative[:seen] / sizes[:seen, None]
    turned[seen:, chain.shape[1] :] = np.eye(free)
    modal = right.T @ turned
    stiff = strain.T @ stiffness @ strain
    stiff += modal.T @ (dynamics.squares[:, None] * modal)
    # Mean axes that no mode moves are held to their place among the ends, well above `highest`.
    stiff += (_HELD * highest) ** 2 * relative[seen:].T @ relative[seen:]
    every = np.vstack([strain, modal])
    springs = diagonalize(stiff, every.T @ rest @ every, highest)
    zeros = np.zeros(len(order))
    return FloatingBody(
        order=order,
        mass=total,
        centre=centre,
        inertia=inertia,
        end_masses=zeros,
        flywheels=free,
        springs=springs,
    )


def rigid_inertia(body: Body) -> tuple[float, Array, Array]:
    """Return mass, centre (3,) and inertia (3, 3) about it of a body, base axes at home."""
    elastic = body.elastic
    if elastic is None:
        none = np.zeros((3, 3))
        centre = np.zeros(3) if body.centre is None else body.centre
        return body.mass, centre, none if body.inertia is None else body.inertia
    if not body.mass:
        return 0.0, elastic.places[0], np.zeros((3, 3))
    if elastic.dynamics is None:
        centre = elastic.places.mean(axis=0)
        away = elastic.places - centre
        square = float((away**2).sum()) * np.eye(3)
        return body.mass, centre, body.mass / len(away) * (square - away.T @ away)
    size = elastic.dynamics.ends_size
    motion = rigid_motions((elastic.places - elastic.places[0]) @ elastic.axes)
    whole = motion.T @ elastic.dynamics.mass[:size, :size] @ motion
    mass, centre, inertia = _rigid_inertia(whole)
    axes = elastic.axes
    return mass, elastic.places[0] + axes @ centre, axes @ inertia @ axes.T


def _rigid_inertia(mass: Array) -> tuple[float, Array, Array]:
    """Return mass, centre (3,) and inertia (3, 3) about it of a rigid body's mass matrix (6, 6)."""
    total = float(np.trace(mass[:3, :3])) / 3.0
    moment = 0.5 * (mass[3:, :3] - mass[3:, :3].T)
    centre = np.array([moment[2, 1], moment[0, 2], moment[1, 0]]) / total
    about = np.linalg.inv(shift(centre))
    inertia = (about.T @ mass @ about)[3:, 3:]
    values, vectors = np.linalg.eigh(0.5 * (inertia + inertia.T))
    least = _FLAT * max(values[-1], total * 1e-6)
    return total, centre, (vectors * values.clip(min=least)) @ vectors.T


def diagonalize(stiffness: Array, mass: Array | None, highest: float) -> Springs:
    """Return springs and inertias along common directions; all vibrate below ``highest``, rad/s.

    Inertia in proportion to stiffness, ``K / ω_h²``, makes ``1/ω² + 1/ω_h²`` of every ``1/ω²``: it
    bounds all frequencies and changes neither shapes of modes nor statics.
    """
    scale = np.sqrt(np.diagonal(stiffness))
    factor = cholesky(stiffness / np.outer(scale, scale), lower=True) * scale[:, None]
    inverse_squares = np.zeros(len(stiffness))
    vectors = np.eye(len(stiffness))
    if mass is not None:
        half = solve_triangular(factor, mass, lower=True)
        seen = solve_triangular(factor, half.T, lower=True)
        inverse_squares, vectors = eigh(0.5 * (seen + seen.T))
    directions = (factor @ vectors).T
    largest = np.abs(directions).max(axis=1)
    squares = largest**2
    armature = squares * (inverse_squares.clip(min=0.0) + highest**-2)
    return Springs(directions / largest[:, None], squares, armature)
