"""Stiffness, sag and deflection of any mechanism at many poses, a chunk at a time.

Poses (n, k) have a column for each coordinate of ``tool.pose``; configurations that were found before serve as well.
Where a pose is out of reach its numbers are NaN; ``configure(mechanism, poses).require_valid()`` refuses it by name.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from stiffscope.errors import InputError
from stiffscope.vjm.condensation import InfiniteStiffnessError, condense_network
from stiffscope.vjm.datasets import Labelled, make_dataset
from stiffscope.vjm.equilibrium import find_equilibrium, map_segments, solve_condensed, solve_loads, tool_stiffness
from stiffscope.vjm.kinematics import CHUNK, Configurations, check_poses, configure, configure_chunks
from stiffscope.vjm.laws import find_laws
from stiffscope.vjm.loading import Loads
from stiffscope.vjm.network import END, place_nodes
from stiffscope.vjm.order import find_order, stack_columns
from stiffscope.vjm.prestress import loaded_compliance, loaded_stiffness, own_loads
from stiffscope.vjm.singularity import characteristic_length, count_freedoms, invert_stiffness, rigid_wrenches

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    import xarray as xr
    from numpy.typing import ArrayLike, NDArray

    from stiffscope.vjm.mechanism import Mechanism
    from stiffscope.vjm.network import Places
    from stiffscope.vjm.order import Order
    from stiffscope.vjm.screws import Array

Gravity = Literal["none", "exact"]
_ROUNDING = 1e-12  # of the largest compliance
_FAR = 0.1  # rad, and of its own length, that weights may move the tool; beyond this, linearization is invalid


@dataclass(frozen=True, eq=False, repr=False)
class Stiffness(Labelled):
    """What a mechanism does at n poses, at M in base axes; NaN where a pose is out of reach.

    ``matrix`` (n, 6, 6) in N/m, N, N·m/rad, NaN where it is infinite in some direction; ``compliance`` (n, 6, 6), its
    inverse, NaN where the tool moves freely; ``rigid``: wrenches (k, 6) of unit size at each pose along which the tool
    does not yield; ``sag`` (n, 6) in m, rad; ``mobility`` (n,): free directions left; ``inverse_condition`` (n,):
    smallest over largest principal stiffness, lengths scaled (0 is singular, or rigid).
    """

    configurations: Configurations
    matrix: Array
    sag: Array
    mobility: NDArray[np.int_]
    inverse_condition: Array
    compliance: Array
    rigid: tuple[Array, ...]

    @property
    def poses(self) -> Array:
        """Commanded coordinates (n, k)."""
        return self.configurations.poses

    @property
    def tool(self) -> Array:
        """Tool poses (n, 6): x y z in m, rotation vector from home in rad."""
        return self.configurations.tool

    @property
    def finite(self) -> Array:
        """The stiffness (n, 6, 6), or where that is infinite 1/C_ii, of each direction with all others free."""
        alone = np.einsum("nii->ni", self.compliance)
        yielding = alone > _ROUNDING * np.where(np.isnan(alone), 0.0, alone).max(axis=1, keepdims=True)
        single = np.where(yielding, 1.0 / np.where(yielding, alone, 1.0), np.nan)
        diagonal = np.where(np.eye(6, dtype=bool), single[:, None], np.nan)
        infinite = np.array([len(each) > 0 for each in self.rigid], dtype=bool)
        return np.where(infinite[:, None, None], diagonal, self.matrix)

    @property
    def valid(self) -> NDArray[np.bool_]:
        """Which poses are within reach (n,)."""
        return self.configurations.valid

    def to_xarray(self) -> xr.Dataset:
        """Return stiffness, compliance, sag and mobility with names along pose, twist and wrench; SI."""
        variables: dict[str, tuple[Sequence[str], Any, str]] = {
            "stiffness": (("pose", "wrench", "twist"), self.matrix, "N/m, N/rad, N, N·m/rad"),
            "compliance": (("pose", "twist", "wrench"), self.compliance, "m/N, rad/N, 1/N, rad/(N·m)"),
            "sag": (("pose", "twist"), self.sag, "m, rad"),
            "mobility": (("pose",), self.mobility, "1"),
            "inverse_condition": (("pose",), self.inverse_condition, "1"),
        }
        return make_dataset(self.configurations, variables)


def stiffness(mechanism: Mechanism, poses: ArrayLike | Configurations, *, gravity: Gravity = "none") -> Array:
    """Stiffness of the tool at many poses.

    Parameters
    ----------
    mechanism
        What yields; its geometry must be that of the configurations, where these are given.
    poses
        Tool poses (n, k) in m and rad, or configurations.
    gravity
        ``"exact"``: tangent stiffness under own weight and offsets; NaN where there is no equilibrium.

    Returns
    -------
    Array
        (n, 6, 6) at M in base axes, N/m, N, N·m/rad; NaN where a pose is out of reach.

    Raises
    ------
    InputError
        For poses of another shape, and for infinite stiffness, of which ``compliance`` is the finite side.

    Examples
    --------
    >>> import stiffscope as ss
    >>> machine = ss.assemble(ss.load_robot("biglide"), "published")
    >>> k = ss.stiffness(machine, [[0, 0, 0.34748]])[0]
    >>> (k.diagonal()[:3] / 1e6).round(2)  # N/um
    array([23.84,  1.97, 12.4 ])
    """
    return _map_chunks(mechanism, poses, (6, 6), lambda order, where: _find_stiffness(order, where, gravity)[..., :6])


def compliance(mechanism: Mechanism, poses: ArrayLike | Configurations, *, gravity: Gravity = "none") -> Array:
    """Compliance of the tool at many poses; that of an arm whose drives alone yield has a rank below six.

    Parameters
    ----------
    mechanism, poses, gravity
        As for ``stiffness``.

    Returns
    -------
    Array
        (n, 6, 6) at M in base axes, m/N, 1/N, rad/(N·m); NaN where a pose is out of reach or the tool moves freely.
    """
    both = _map_chunks(mechanism, poses, (6, 13), lambda order, where: _find_matrices(order, where, gravity))
    return _complete_compliance(both[..., :6], both[..., 6:12])[0]


def batches(
    mechanism: Mechanism, poses: ArrayLike, *, gravity: Gravity = "none", size: int = 65536
) -> Iterator[tuple[slice, Array]]:
    """Yield which poses (n, k) and their stiffness (m, 6, 6), ``size`` at a time: for more than memory should hold.

    Parameters
    ----------
    mechanism
        Bodies, joints, tool and gravity of the robot.
    poses
        Tool poses (n, k), SI.
    gravity
        Whether and how the robot's own weight stiffens it.
    size
        Poses at a time; more take more memory.

    """
    points = check_poses(mechanism, poses)
    for start in range(0, len(points), size):
        some = slice(start, start + size)
        yield some, stiffness(mechanism, points[some], gravity=gravity)


def sag(mechanism: Mechanism, poses: ArrayLike | Configurations) -> Array:
    """Displacement of the tool under the mechanism's own weight and offsets, small displacements.

    Parameters
    ----------
    mechanism, poses
        As for ``stiffness``.

    Returns
    -------
    Array
        Twist (n, 6) at M in base axes, m and rad; NaN where a pose is out of reach.

    Raises
    ------
    InputError
        Where the tool moves freely.

    Examples
    --------
    >>> import stiffscope as ss
    >>> machine = ss.assemble(ss.load_robot("biglide"), "published")
    >>> (1e6 * ss.sag(machine, [[0, 0, 0.34748]])[0, 2]).round(0)  # um along z, which points down
    np.float64(11.0)
    """

    def work(order: Order, where: Places) -> Array:
        return find_equilibrium(order, where, own_loads(order, where)).twist[..., 0]

    return _map_chunks(mechanism, poses, (6,), work)


def analyse(mechanism: Mechanism, poses: ArrayLike | Configurations, *, gravity: Gravity = "none") -> Stiffness:
    """Stiffness, compliance, mobility and (with gravity) sag at tool poses.

    Parameters
    ----------
    mechanism, poses
        As for ``stiffness``.
    gravity
        ``"exact"``: under own weight and offsets. Where weights find no equilibrium near by, the stiffness is the one
        without them, and the sag is NaN.

    Returns
    -------
    Stiffness
        What the mechanism does at every pose; where its stiffness is infinite, its compliance and what is rigid.

    Examples
    --------
    >>> import stiffscope as ss
    >>> machine = ss.assemble(ss.load_robot("biglide"), "published")
    >>> state = ss.analyse(machine, [[0, 0, 0.34748]], gravity="exact")
    >>> (1e6 * state.sag[0, 2]).round(2)  # um along z, which points down
    np.float64(11.05)
    """
    found = poses if isinstance(poses, Configurations) else configure(mechanism, poses)
    n = len(found)
    both = _map_chunks(mechanism, found, (6, 13), lambda order, where: _find_unloaded(order, where, gravity))
    matrix = both[..., :6]
    yielding, free, inverse_condition = _complete_compliance(matrix, both[..., 6:12])
    sagged = np.zeros((n, 6))
    if gravity != "none":
        loaded = _analyse_weight(mechanism, found, matrix, yielding)
        sagged, still = loaded[..., 12], np.isnan(loaded[:, :1, 12:])
        matrix, yielding = np.where(still, matrix, loaded[..., :6]), np.where(still, yielding, loaded[..., 6:12])
        yielding, free, inverse_condition = _complete_compliance(matrix, yielding)
    stuck = found.valid & ~np.isfinite(matrix).all(axis=(1, 2))
    free[stuck], inverse_condition[stuck] = 0, 0.0
    length = found.linkage.length
    rigid = tuple(
        rigid_wrenches(c, length) if out else np.zeros((0, 6)) for c, out in zip(yielding, stuck, strict=True)
    )
    return Stiffness(found, matrix, sagged, free, inverse_condition, yielding, rigid)


def _complete_compliance(matrix: Array, yielding: Array) -> tuple[Array, NDArray[np.int_], Array]:
    """Compliance (n, 6, 6), also of known stiffnesses; number of free directions and inverse condition number (n,)."""
    free, inverse_condition = np.full(len(matrix), 6), np.full(len(matrix), np.nan)
    known = np.isfinite(matrix).all(axis=(1, 2))
    free[known], inverse_condition[known] = count_freedoms(matrix[known])
    return np.where(np.isnan(yielding), invert_stiffness(matrix, free), yielding), free, inverse_condition


def _analyse_weight(mechanism: Mechanism, found: Configurations, unloaded: Array, yielding: Array) -> Array:
    """Stiffness, compliance and sag (n, 6, 13) under weights, where they are known without.

    All are NaN where the tool moves freely, and where the weights would turn it by more than a tenth of a radian or
    move it by more than a tenth of its characteristic length.
    """
    out = np.full((len(unloaded), 6, 13), np.nan)
    loose = bool(find_laws(mechanism))  # weights may hold what moves freely without them
    firm = np.flatnonzero(found.valid & (loose | np.isfinite(yielding).all(axis=(1, 2))))
    both = _map_chunks(mechanism, found[firm], (6, 13), lambda order, where: _find_matrices(order, where, "exact"))
    size = np.ones((len(firm), 6))
    size[:, :3] = found.linkage.length
    known = np.isfinite(unloaded[firm]).all(axis=(1, 2)) & (not loose)
    size[known, :3] = characteristic_length(unloaded[firm[known]])[:, None]
    small = (np.abs(both[..., 12]) < _FAR * size).all(axis=1)
    out[firm[small]] = both[small]
    return out


def stiffness_error(mechanism: Mechanism, poses: ArrayLike | Configurations) -> Array:
    """Bound (n, 6, 6) on the error of the stiffness at M from the bounds on the compliances of its elastic bodies.

    To first order ``δK = -Σ (A K)ᵀ δC (A K)`` with A the wrench on a body under unit wrenches at M. Equal parts are off
    together: absolute values add. NaN where the stiffness is infinite.
    """
    bars = {b.name: b.elastic.error for b in mechanism.bodies if b.elastic is not None and b.elastic.error is not None}

    def work(order: Order, where: Places) -> Array:
        try:
            state = condense_network(order, where)
            matrix = tool_stiffness(state)
        except InfiniteStiffnessError:
            return np.full((1, 6, 6), np.nan)
        response, out = solve_condensed(state, Loads(6, {END: matrix})), np.zeros_like(matrix)
        for name, bar in bars.items():
            carried = np.abs(response.find_wrench(mechanism.rows(name)))
            out = out + carried.mT @ bar @ carried
        return out

    return _map_chunks(mechanism, poses, (6, 6), work)


def _find_stiffness(order: Order, where: Places, gravity: Gravity) -> Array:
    """Stiffness and, with gravity, sag (n, 6, 7)."""
    if gravity == "none":
        return stack_columns([tool_stiffness(condense_network(order, where)), np.zeros((1, 6, 1))])
    return _at_weight(order, where, loaded_stiffness, 7)


def _at_weight(order: Order, where: Places, work: Callable[[Order, Places], Array], columns: int) -> Array:
    """What is found (n, 6, columns) under own weight, of the linear robots that drives with laws make of theirs."""
    if not find_laws(order.mechanism):
        return work(order, where)
    own = own_loads(order, where)
    return map_segments(order, where, own, (6, columns), lambda linear, there, _: work(linear, there))[..., 0]


def _find_matrices(order: Order, where: Places, gravity: Gravity) -> Array:
    """Stiffness, compliance and sag (n, 6, 13); NaN where infinite, and where it is the stiffness's inverse to take."""
    if gravity == "exact" and find_laws(order.mechanism):
        return _at_weight(order, where, lambda linear, there: _find_matrices(linear, there, gravity), 13)
    try:
        found = _find_stiffness(order, where, gravity)
        return np.concatenate([found[..., :6], np.full((len(found), 6, 6), np.nan), found[..., 6:]], axis=2)
    except InfiniteStiffnessError:
        if gravity == "exact":
            found = loaded_compliance(order, where)
        else:
            unit = solve_loads(order, where, Loads(6, {END: np.eye(6)[None]})).twist
            found = stack_columns([0.5 * (unit + unit.mT), np.zeros((1, 6, 1))])
    matrix, yielding = np.full((len(found), 6, 6), np.nan), found[..., :6]
    firm = [k for k, c in enumerate(yielding) if np.isfinite(c).all() and not len(rigid_wrenches(c, order.length))]
    matrix[firm] = np.linalg.inv(yielding[firm])
    return np.concatenate([matrix, found], axis=2)


def _find_unloaded(order: Order, where: Places, gravity: Gravity) -> Array:
    """``_find_matrices`` without loads; a tool that is loose there and held under weight has no stiffness."""
    try:
        return _find_matrices(order, where, "none")
    except InputError:
        if gravity == "none" or not find_laws(order.mechanism):
            raise
        return np.concatenate([np.zeros((1, 6, 6)), np.full((1, 6, 6), np.nan), np.zeros((1, 6, 1))], axis=2)


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
        good = found if found.valid.all() else found[found.valid]
        if len(good):
            out[some][found.valid] = work(find_order(mechanism, good.linkage), place_nodes(good))
    return out
