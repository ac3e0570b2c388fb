"""Stiffness, sag and deflection of any mechanism at many poses, a chunk at a time.

Poses (n, k) have a column for each coordinate of ``tool.pose``; configurations that were found before serve as well.
Where a pose is out of reach its numbers are NaN; ``configure(mechanism, poses).required()`` refuses it by name.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from stiffscope.errors import InputError
from stiffscope.vjm.checks import GROUND
from stiffscope.vjm.condensation import condense_network
from stiffscope.vjm.equilibrium import solve_condensed, solve_loads, tool_stiffness
from stiffscope.vjm.kinematics import CHUNK, Configurations, check_poses, configure, configure_chunks
from stiffscope.vjm.loading import Loads, Response
from stiffscope.vjm.network import END, FOOT, lump_masses, place_nodes
from stiffscope.vjm.order import find_order
from stiffscope.vjm.prestress import loaded_stiffness, own_loads
from stiffscope.vjm.singularity import characteristic_length, count_freedoms

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from numpy.typing import ArrayLike, NDArray

    from stiffscope.vjm.mechanism import Mechanism
    from stiffscope.vjm.network import Places
    from stiffscope.vjm.order import Order
    from stiffscope.vjm.screws import Array

Gravity = Literal["none", "exact"]
_FAR = 0.1  # rad, and of its own length, that weights may move the tool; beyond this, linearization is invalid


@dataclass(frozen=True, eq=False)
class Stiffness:
    """What a mechanism does at n poses, at M in base axes; NaN where a pose is out of reach.

    ``matrix`` (n, 6, 6) in N/m, N, N·m/rad; ``sag`` (n, 6) in m, rad; ``mobility`` (n,): free directions left;
    ``inverse_condition`` (n,): smallest over largest principal stiffness, lengths scaled (0 is singular).
    """

    configurations: Configurations
    matrix: Array
    sag: Array
    mobility: NDArray[np.int_]
    inverse_condition: Array

    @property
    def poses(self) -> Array:
        """Commanded coordinates (n, k)."""
        return self.configurations.poses

    @property
    def tool(self) -> Array:
        """Tool poses (n, 6): x y z in m, rotation vector from home in rad."""
        return self.configurations.tool

    @property
    def valid(self) -> NDArray[np.bool_]:
        """Which poses are within reach (n,)."""
        return self.configurations.valid


@dataclass(frozen=True, eq=False)
class Load:
    """A dead load on a node: ``wrench`` (6,) or (n, 6) in N, N·m, base axes, at the body's home point ``at`` (3,)."""

    node: str
    wrench: Array
    at: Array


def stiffness(mechanism: Mechanism, poses: ArrayLike | Configurations, *, gravity: Gravity = "none") -> Array:
    """Stiffness (n, 6, 6) at M in base axes, N/m, N, N·m/rad; NaN where a pose is out of reach.

    Parameters
    ----------
    mechanism
        What yields; its geometry must be that of the configurations, where these are given.
    poses
        Tool poses (n, k) in m and rad, or configurations.
    gravity
        ``"exact"``: tangent stiffness under own weight and offsets; NaN where there is no equilibrium.

    Raises
    ------
    InputError
        For poses of another shape, and for infinite stiffness.
    """
    work = _plain if gravity == "none" else _exact
    return _map_chunks(mechanism, poses, (6, 6), work)


def batches(
    mechanism: Mechanism, poses: ArrayLike, *, gravity: Gravity = "none", size: int = 65536
) -> Iterator[tuple[slice, Array]]:
    """Yield which poses (n, k) and their stiffness (m, 6, 6), ``size`` at a time: for more than memory should hold."""
    points = check_poses(mechanism, poses)
    for start in range(0, len(points), size):
        some = slice(start, start + size)
        yield some, stiffness(mechanism, points[some], gravity=gravity)


def sag(mechanism: Mechanism, poses: ArrayLike | Configurations) -> Array:
    """Twist (n, 6) of the tool under the mechanism's own weight and offsets, small displacements, m and rad.

    Raises InputError where the tool moves freely.
    """

    def work(order: Order, where: Places) -> Array:
        return solve_loads(order, where, own_loads(order, where, mechanism.gravity)).twist[..., 0]

    return _map_chunks(mechanism, poses, (6,), work)


def analyse(mechanism: Mechanism, poses: ArrayLike | Configurations, *, gravity: Gravity = "none") -> Stiffness:
    """Stiffness, mobility and (with gravity) sag at tool poses (n, k).

    Where weights find no equilibrium near by, the stiffness is the one without them, and the sag is NaN.
    """
    found = poses if isinstance(poses, Configurations) else configure(mechanism, poses)
    matrix, sagged = stiffness(mechanism, found), np.zeros((len(found), 6))
    if gravity != "none":
        bent, sagged = analyse_weight(mechanism, found, matrix)
        matrix = np.where(np.isnan(sagged[:, :1, None]), matrix, bent)
    free, inverse_condition = np.full(len(found), 6), np.full(len(found), np.nan)
    free[found.valid], inverse_condition[found.valid] = count_freedoms(matrix[found.valid])
    return Stiffness(found, matrix, sagged, free, inverse_condition)


def analyse_weight(mechanism: Mechanism, found: Configurations, unloaded: Array) -> tuple[Array, Array]:
    """Stiffness (n, 6, 6) and sag (n, 6) under weights where the ``unloaded`` stiffness (n, 6, 6) is known.

    Both are NaN where the tool moves freely, and where the weights would turn it by more than a tenth of a radian or
    move it by more than a tenth of its characteristic length.
    """
    matrix, sagged = np.full_like(unloaded, np.nan), np.full((len(unloaded), 6), np.nan)
    firm = np.flatnonzero(found.valid)
    firm = firm[count_freedoms(unloaded[firm])[0] == 0]
    both = _map_chunks(mechanism, found[firm], (6, 7), _exact_and_sag)
    size = np.ones((len(firm), 6))
    size[:, :3] = characteristic_length(unloaded[firm])[:, None]
    small = (np.abs(both[..., 6]) < _FAR * size).all(axis=1)
    matrix[firm[small]], sagged[firm[small]] = both[small, :, :6], both[small, :, 6]
    return matrix, sagged


def respond(
    mechanism: Mechanism,
    poses: ArrayLike | Configurations,
    wrench: ArrayLike,
    *,
    loads: Sequence[Load] = (),
    gravity: float | ArrayLike = 0.0,
    misfit: float | ArrayLike = 0.0,
) -> Response:
    """Equilibrium under wrenches (6,), (6, c) or (n, 6, c) at M in base axes, and what every element carries.

    Parameters
    ----------
    loads
        Dead loads on bodies, in every case.
    gravity, misfit
        How many times the mechanism's own weight, and its offsets, act; one for all cases or one a case (c,).

    Raises
    ------
    InputError
        For a pose out of reach, a load on no body, and where the tool moves freely under its load.
    """
    found = (poses if isinstance(poses, Configurations) else configure(mechanism, poses)).required()
    applied = np.asarray(wrench, dtype=float)
    applied = applied[None, :, None] if applied.ndim == 1 else applied[None] if applied.ndim == 2 else applied
    cases = applied.shape[2]
    if applied.shape[1] != 6 or len(applied) not in {1, len(found)} or not np.isfinite(applied).all():
        raise InputError(f"wrench: expected finite (6,), (6, c) or ({len(found)}, 6, c), got shape {np.shape(wrench)}")
    order, where = find_order(mechanism, found.linkage), place_nodes(found)
    all_loads = Loads(cases)
    weight = np.broadcast_to(np.asarray(gravity, dtype=float), (cases,))
    if weight.any():
        for node, m in lump_masses(mechanism, where).items():
            all_loads.nodes[node] = m.weight(mechanism.gravity) * weight
    times = np.broadcast_to(np.asarray(misfit, dtype=float), (cases,))
    for e in order.elements:
        if e.offset is not None and times.any():
            all_loads.offsets[e.name] = e.offset[None, :, None] * times
    for load in loads:
        node = FOOT if load.node == GROUND else load.node
        if node not in where.rotation:
            raise InputError(f"load: expected a body or an end of one, got {load.node!r}")
        at_tool = np.atleast_2d(np.asarray(load.wrench, dtype=float)).copy()
        lever = where.point(node, np.asarray(load.at, dtype=float)) - where.tool
        moment = at_tool[:, 3:] + np.cross(lever, at_tool[:, :3])
        force = np.broadcast_to(at_tool[:, :3], moment.shape)
        whole = np.concatenate([force, moment], axis=1)[..., None] * np.ones(cases)
        all_loads.nodes[node] = all_loads.nodes.get(node, np.zeros((1, 6, 1))) + whole
    all_loads.nodes[END] = all_loads.nodes.get(END, np.zeros((1, 6, 1))) + applied
    return solve_loads(order, where, all_loads)


def stiffness_error(mechanism: Mechanism, poses: ArrayLike | Configurations) -> Array:
    """Bound (n, 6, 6) on the error of the stiffness at M from the bounds on the compliances of its elastic bodies.

    To first order ``δK = -Σ (A K)ᵀ δC (A K)`` with A the wrench on a body under unit wrenches at M. Equal parts are off
    together: absolute values add.
    """
    bars = {b.name: b.elastic.error for b in mechanism.bodies if b.elastic is not None and b.elastic.error is not None}

    def work(order: Order, where: Places) -> Array:
        state = condense_network(order, where)
        matrix = tool_stiffness(state)
        elements = solve_condensed(state, Loads(6, {END: matrix})).elements
        out = np.zeros_like(matrix)
        for name, bar in bars.items():
            carried = np.abs(elements[name].wrench)
            out = out + np.swapaxes(carried, -1, -2) @ bar @ carried
        return out

    return _map_chunks(mechanism, poses, (6, 6), work)


def _plain(order: Order, where: Places) -> Array:
    return tool_stiffness(condense_network(order, where))


def _exact(order: Order, where: Places) -> Array:
    return loaded_stiffness(order, where, order.mechanism.gravity)[0]


def _exact_and_sag(order: Order, where: Places) -> Array:
    matrix, sagged = loaded_stiffness(order, where, order.mechanism.gravity)
    return np.concatenate([matrix, sagged[..., None]], axis=2)


def _map_chunks(
    mechanism: Mechanism,
    poses: ArrayLike | Configurations,
    entries: tuple[int, ...],
    work: Callable[[Order, Places], Array],
) -> Array:
    """Work on a chunk of configurations at a time; memory grows with the result alone."""
    if isinstance(poses, Configurations):
        n = len(poses)
        chunks = (poses[i : i + CHUNK] if n > CHUNK else poses for i in range(0, max(n, 1), CHUNK))
    else:
        points = check_poses(mechanism, poses)
        n, chunks = len(points), configure_chunks(mechanism, points)
    out = np.full((n, *entries), np.nan)
    at = 0
    for found in chunks:
        some = slice(at, at + len(found))
        at += len(found)
        if found.valid.all():
            if len(found):
                out[some] = work(find_order(mechanism, found.linkage), place_nodes(found))
        elif found.valid.any():
            good = found[found.valid]
            out[some][found.valid] = work(find_order(mechanism, good.linkage), place_nodes(good))
    return out
