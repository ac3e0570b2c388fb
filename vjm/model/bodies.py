"""Rigid and elastic bodies; an elastic one has two or more ends, each a node of the mechanism."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.errors import InputError, expecting, require
from stiffscope.vjm.model.checks import (
    assign,
    axes_along,
    check_array,
    check_compliance,
    check_name,
    check_vector,
    spell_name,
)
from stiffscope.vjm.model.dynamics import (
    Dynamics,
    Masses,
    factor_semidefinite,
    split_load,
)
from stiffscope.vjm.model.screws import shift

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import ArrayLike

    from stiffscope.vjm.model.screws import Array

_ORTHONORMAL = 1e-9
_BALANCED = 1e-6  # of a stiffness: tolerance of rigid-motion forces and of asymmetry


@dataclass(frozen=True, eq=False)
class Elastic:
    """Elasticity of a body: its compliance and the places of its n ends.

    ``compliance`` (6m, 6m), m = n - 1, of the ends in part axes with the first clamped; ``error``
    (6m, 6m): bounds on it; ``places`` (n, 3) of the ends, m; ``axes`` (3, 3): part axes as columns,
    in base axes; ``ends``: names; ``offset`` (6m,): twists of unloaded ends from the first (lack of
    fit, heat); ``dynamics``: inertia; without it, the ends share the body's mass equally.
    """

    compliance: Array
    places: Array
    axes: Array
    error: Array | None = None
    offset: Array | None = None
    dynamics: Dynamics | None = None
    ends: tuple[str, ...] = ("base", "tip")

    @property
    def base(self) -> Array:
        """Place (3,) of the first end."""
        return self.places[0]

    @property
    def tip(self) -> Array:
        """Place (3,) of the last end."""
        return self.places[-1]


@dataclass(frozen=True, eq=False)
class Body:
    """A rigid body, or an elastic one with two or more ends.

    ``mass`` in kg; at the ``centre`` (3,) of a rigid body, distributed by the ``dynamics`` of an
    elastic one. ``inertia`` (3, 3) about the centre, base axes, kg·m².
    """

    name: str
    mass: float = 0.0
    centre: Array | None = None
    inertia: Array | None = None
    elastic: Elastic | None = None

    def __post_init__(self) -> None:
        here = check_name("bodies", self.name)
        require(
            0.0 <= self.mass < np.inf,
            f"{here}.mass",
            "a mass of at least 0 kg",
            self.mass,
        )
        if self.centre is not None:
            assign(
                self,
                "centre",
                check_vector(self.centre, f"{here}.centre", "a position in m"),
            )
        elif self.mass > 0.0 and self.elastic is None:
            raise InputError(
                f"{here}.centre: expected the centre of mass beside a mass, got none"
            )
        if self.inertia is not None:
            inertia = check_array(self.inertia, (3, 3), f"{here}.inertia", "an inertia")
            message = f"{here}.inertia: expected a positive semidefinite inertia"
            _ = factor_semidefinite(0.5 * (inertia + inertia.T), message)
            assign(self, "inertia", inertia)
        if self.elastic is not None:
            assign(self, "elastic", _check_elastic(self.elastic, here))

    @property
    def nodes(self) -> tuple[str, ...]:
        """Nodes to which joints can be attached."""
        if self.elastic is None:
            return (self.name,)
        return tuple(f"{self.name}.{end}" for end in self.elastic.ends)

    @cached_property
    def masses(self) -> dict[str, Masses]:
        """Masses of its nodes at home, about the origin; ends without ``dynamics`` share alike."""
        elastic = self.elastic
        centre = np.zeros(3) if self.centre is None else self.centre
        ends = dict(
            zip(
                self.nodes, [centre] if elastic is None else elastic.places, strict=True
            )
        )
        if elastic is not None and elastic.dynamics is not None:
            axes = elastic.axes[None]
            loads = np.split(elastic.dynamics.load, len(ends))
            pairs = zip(ends.items(), loads, strict=True)
            return {
                node: split_load(load).place(axes, at[None])
                for (node, at), load in pairs
            }
        share = self.mass / len(ends)
        return {
            node: Masses(share, share * at[None]) for node, at in ends.items() if share
        }


def member(
    name: str,
    base: ArrayLike,
    tip: ArrayLike,
    compliance: ArrayLike,
    *,
    y: ArrayLike | None = None,
    mass: float = 0.0,
    error: ArrayLike | None = None,
    dynamics: Dynamics | None = None,
) -> Body:
    """Create an elastic body with two ends, ``NAME.base`` and ``NAME.tip``.

    Parameters
    ----------
    name
        Unique name of the body.
    base, tip
        Places (3,) in m of its ends at home, base axes. Part axes have x from base to tip.
    compliance
        (6, 6) of the tip, clamped at the base, in part axes at the tip; larger values are softer.
    y
        Direction (3,) near the part's y; by default the base axis after the one nearest to x.
    mass
        In kg; half of it acts at each end if ``dynamics`` is None.
    error
        Bounds (6, 6) on the entries of the compliance; by default none.
    dynamics
        Inertia referred to these ends.

    Returns
    -------
    Body
        The body; raises InputError if the compliance is invalid.
    """
    here = spell_name("bodies", name)
    start = check_vector(base, f"{here}.base", "a position in m")
    end = check_vector(tip, f"{here}.tip", "a position in m")
    axes = axes_along(end - start, y, here)
    bound = None if error is None else np.asarray(error, dtype=float)
    soft = np.asarray(compliance, dtype=float)
    places = np.array([start, end])
    return Body(
        name, mass, elastic=Elastic(soft, places, axes, bound, dynamics=dynamics)
    )


def superelement_body(
    name: str,
    interfaces: Mapping[str, ArrayLike],
    stiffness: ArrayLike,
    *,
    at: ArrayLike = (0.0, 0.0, 0.0),
    axes: ArrayLike | None = None,
    mass: float = 0.0,
    mass_matrix: ArrayLike | None = None,
    mode_squares: ArrayLike = (),
) -> Body:
    """Create an elastic body, nodes ``NAME.INTERFACE``, from its interfaces' unsupported stiffness.

    Parameters
    ----------
    name
        Unique name of the body.
    interfaces
        Places (3,) in m of its n interfaces in part axes, by name, in the matrix's order.
    stiffness
        (6n, 6n), N/m, N, N·m/rad, part axes: twists to wrenches, singular to rigid motions.
    at, axes
        Place (3,) of the part's origin at home, and its axes as columns (3, 3), default the base's.
    mass
        In kg; the interfaces share it equally if ``mass_matrix`` is None.
    mass_matrix
        (6n + k, 6n + k) in the same order, followed by k fixed-interface modes; kg, kg·m, kg·m².
    mode_squares
        (k,) squared angular frequencies of these modes, rad²/s²; none by default.

    Returns
    -------
    Body
        The body; raises InputError for a wrong shape or a stiffness that is not unsupported.
    """
    here = spell_name("bodies", name)
    names = tuple(interfaces)
    require(len(names) >= 2, f"{here}.interfaces", "two or more", list(names))
    points = ((f"{here}.interfaces.{end}", place) for end, place in interfaces.items())
    local = np.array(
        [check_vector(place, field, "a position in m") for field, place in points]
    )
    size = 6 * len(names)
    k = check_array(stiffness, (size, size), f"{here}.stiffness", "a stiffness")
    compliance = _clamp_first(k, local, f"{here}.stiffness")
    turn = (
        np.eye(3) if axes is None else check_array(axes, (3, 3), f"{here}.axes", "axes")
    )
    dynamics = None
    squares = np.asarray(mode_squares, dtype=float)
    modes = 0 if mass_matrix is None else max(0, len(np.asarray(mass_matrix)) - size)
    require(
        squares.shape == (modes,) and (squares > 0.0).all(),
        f"{here}.mode_squares",
        f"{modes} above 0, for the mass matrix's rows beyond the interfaces'",
        squares.tolist(),
    )
    if mass_matrix is not None:
        whole = size + modes
        inertia = check_array(
            mass_matrix, (whole, whole), f"{here}.mass_matrix", "a mass matrix"
        )
        dynamics = Dynamics(inertia, squares)
        mass = dynamics.total
    places = local @ turn.T + check_vector(at, f"{here}.at", "a position in m")
    elastic = Elastic(compliance, places, turn, dynamics=dynamics, ends=names)
    return Body(name, mass, elastic=elastic)


def rigid_motions(places: Array) -> Array:
    """Return twists (6n, 6) of points (n, 3) under rigid motions of the first point."""
    return np.vstack([shift(place - places[0]) for place in places])


def _clamp_first(stiffness: Array, places: Array, here: str) -> Array:
    """Clamp the first interface of a stiffness (6n, 6n); return the compliance (6m, 6m)."""
    scale = np.sqrt(np.diagonal(stiffness).clip(min=0.0))
    size = np.outer(scale, scale)
    least = np.diagonal(stiffness).min()
    require(least > 0.0, here, "diagonal entries above 0", f"{least:.6g}")
    require(
        (np.abs(stiffness - stiffness.T) <= _BALANCED * size).all(),
        here,
        "a symmetric matrix",
    )
    rigid = rigid_motions(places)
    cost = (np.abs(stiffness @ rigid) / (size @ np.abs(rigid))).max()
    require(
        cost <= _BALANCED,
        here,
        "one whose rigid motions cost nothing",
        f"a relative cost of {cost:.2g}",
    )
    unit = (stiffness / size)[6:, 6:]
    expected = "one that only rigid motions leave unloaded"
    with expecting(here, expected, np.linalg.LinAlgError, got="another"):
        root = np.linalg.inv(np.linalg.cholesky(0.5 * (unit + unit.T)))
    return (root.T @ root) / size[6:, 6:]


def _check_elastic(elastic: Elastic, here: str) -> Elastic:
    axes = check_array(elastic.axes, (3, 3), f"{here}.axes", "axes")
    off = np.abs(axes.T @ axes - np.eye(3)).max()
    if off > _ORTHONORMAL or np.linalg.det(axes) < 0.0:
        raise InputError(
            f"{here}.axes: expected orthonormal columns x, y, z, got {axes.tolist()}"
        )
    m = len(elastic.ends) - 1
    named = f"{here}.compliance"
    compliance = check_compliance(elastic.compliance, named, semidefinite=True, ends=m)
    places = check_array(elastic.places, (m + 1, 3), f"{here}.places", "positions in m")
    error = elastic.error
    offset = elastic.offset
    if error is not None:
        error = check_array(error, (6 * m, 6 * m), f"{here}.error", "error")
    if offset is not None:
        offset = check_array(offset, (6 * m,), f"{here}.offset", "offset")
    return Elastic(
        compliance=compliance,
        places=places,
        axes=axes,
        error=error,
        offset=offset,
        dynamics=elastic.dynamics,
        ends=elastic.ends,
    )
