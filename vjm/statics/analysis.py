"""Stiffness, sag and deflection of a mechanism at many poses, in chunks.

Poses (n, k) have a column for each coordinate of ``tool.pose``; existing configurations may replace
them. Numbers are NaN if a pose is out of reach; ``configure(mechanism, poses).require_valid()``
raises.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import repeat
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from stiffscope.errors import InputError, check_word
from stiffscope.vjm.elements.laws import find_laws
from stiffscope.vjm.kinematics.configurations import (
    CHUNK,
    Configurations,
    check_poses,
    configure,
    configure_chunks,
)
from stiffscope.vjm.kinematics.datasets import Labelled, make_dataset
from stiffscope.vjm.network.condensation import InfiniteStiffnessError, condense_network
from stiffscope.vjm.network.loading import Loads
from stiffscope.vjm.network.network import END, list_elements, place_nodes
from stiffscope.vjm.network.order import find_order, stack_columns
from stiffscope.vjm.statics.equilibrium import (
    find_equilibrium,
    map_segments,
    solve_condensed,
    solve_unstiffened,
    tool_stiffness,
)
from stiffscope.vjm.statics.prestress import (
    loaded_compliance,
    loaded_stiffness,
    own_loads,
)
from stiffscope.vjm.statics.singularity import (
    characteristic_length,
    count_freedoms,
    invert_stiffness,
    is_ill_conditioned,
    nearly_rigid,
    rigid_wrenches,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    import xarray as xr
    from numpy.typing import ArrayLike, NDArray

    from stiffscope.vjm.kinematics.configurations import Poses
    from stiffscope.vjm.kinematics.datasets import Variables
    from stiffscope.vjm.model.mechanism import Mechanism
    from stiffscope.vjm.model.screws import Array
    from stiffscope.vjm.network.network import Places
    from stiffscope.vjm.network.order import Order

    Work = Callable[[Order, Places], Array]

Gravity = Literal["none", "exact"]
_ROUNDING = 1e-12  # of a unit wrench, squared: what is not rigid
_SINGLY = 256  # poses of doubtful stiffness that are solved one by one if need be
_BLOCK = 16 * CHUNK  # poses analysed at a time: intermediate results of some megabytes
_FAR = 0.1  # rad or relative length: sag beyond which linearization is invalid
_BALANCED = (
    1e-5  # of a unit wrench on the tool: along a free motion, beyond rounded geometry
)
_UNKNOWN = np.full((1, 6, 6), np.nan)


@dataclass(frozen=True, eq=False, repr=False)
class Stiffness(Labelled):
    """Static analysis of a mechanism at n poses, at M in base axes; NaN if a pose is out of reach.

    ``matrix`` (n, 6, 6) in N/m, N, N·m/rad, NaN if infinite in some direction; ``compliance`` (n,
    6, 6), its inverse, NaN if the tool moves freely; ``rigid``: unit wrenches (k, 6) at each pose
    without deflection, but for what weight bends to second order; ``sag`` (n, 6) in m, rad;
    ``mobility`` (n,): number of free directions; ``inverse_condition`` (n,): smallest over largest
    principal stiffness (0: singular or rigid).
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
    def alone(self) -> Array:
        """Stiffness 1/C_ii (n, 6) of each direction with all others free: a push; NaN if rigid."""
        soft = np.einsum("nii->ni", self.compliance)
        out = 1.0 / np.where(soft > 0.0, soft, np.nan)
        counts = np.array([len(wrenches) for wrenches in self.rigid], dtype=int)
        for count in set(counts.tolist()) - {0}:
            rows = np.flatnonzero(counts == count)
            rigid = np.array([self.rigid[k] for k in rows])
            within = np.square(np.linalg.qr(rigid.mT)[0]).sum(
                axis=2
            )  # of each unit wrench
            out[rows] = np.where(within < 1.0 - _ROUNDING, out[rows], np.nan)
        return out

    @property
    def nearly_rigid(self) -> NDArray[np.bool_]:
        """Directions (n, 6) that are rigid, or stiffer than the others by a million.

        None where the compliance is unknown, as the tool moves freely.
        """
        known = np.asarray(np.isfinite(self.compliance).all(axis=(1, 2)))
        rigid_directions = nearly_rigid(self.alone, self.configurations.linkage.length)
        return rigid_directions & known[:, None]

    @property
    def finite(self) -> Array:
        """Stiffness (n, 6, 6); if infinite, 1/C_ii: each direction with all others free."""
        out = self.matrix.copy()
        stuck = np.flatnonzero([len(wrenches) for wrenches in self.rigid])
        alone = self.alone[stuck]
        out[stuck] = np.where(np.eye(6, dtype=bool), alone[:, None], np.nan)
        return out

    @property
    def valid(self) -> NDArray[np.bool_]:
        """Whether the poses are within reach (n,)."""
        return self.configurations.valid

    def to_xarray(self) -> xr.Dataset:
        """Return stiffness, compliance, sag and mobility by pose, twist and wrench; SI."""
        soft = self.compliance
        variables: Variables = {
            "stiffness": (
                ("pose", "wrench", "twist"),
                self.matrix,
                "N/m, N/rad, N, N·m/rad",
            ),
            "compliance": (
                ("pose", "twist", "wrench"),
                soft,
                "m/N, rad/N, 1/N, rad/(N·m)",
            ),
            "sag": (("pose", "twist"), self.sag, "m, rad"),
            "mobility": (("pose",), self.mobility, "1"),
            "inverse_condition": (("pose",), self.inverse_condition, "1"),
        }
        return make_dataset(self.configurations, variables)


def stiffness(
    mechanism: Mechanism, poses: Poses, *, gravity: Gravity = "none"
) -> Array:
    """Return the tool stiffness at many poses.

    Parameters
    ----------
    mechanism
        Mechanism; its geometry must match given configurations.
    poses
        Tool poses (n, k) in m and rad, or configurations.
    gravity
        ``"exact"``: tangent stiffness under own weight and offsets; NaN if there is no equilibrium.

    Returns
    -------
    Array
        (n, 6, 6) at M in base axes, N/m, N, N·m/rad; NaN if a pose is out of reach.

    Raises
    ------
    InputError
        If poses have another shape, or if the stiffness is infinite; ``compliance`` is then finite.

    Examples
    --------
    >>> import stiffscope as ss
    >>> machine = ss.assemble(ss.load_robot("biglide"), "published")
    >>> k = ss.stiffness(machine, [[0, 0, 0.34748]])[0]
    >>> (k.diagonal()[:3] / 1e6).round(2)  # N/um
    array([23.84,  1.97, 12.4 ])
    """
    check_word("gravity", gravity, get_args(Gravity))
    return map_chunks(mechanism, poses, (6, 6), _find_stiffness, gravity)


def compliance(
    mechanism: Mechanism, poses: Poses, *, gravity: Gravity = "none"
) -> Array:
    """Return the tool compliance at many poses; of rank below six if only drives are compliant.

    Parameters
    ----------
    mechanism, poses, gravity
        As for ``stiffness``.

    Returns
    -------
    Array
        (n, 6, 6) at M in base axes, m/N, 1/N, rad/(N·m); NaN if out of reach or moving freely.
    """
    check_word("gravity", gravity, get_args(Gravity))
    both = map_chunks(mechanism, poses, (6, 13), _find_matrices, gravity)
    return _complete_compliance(both[..., :6], both[..., 6:12])[0]


def batches(
    mechanism: Mechanism,
    poses: ArrayLike,
    *,
    gravity: Gravity = "none",
    size: int = 65536,
) -> Iterator[tuple[slice, Array]]:
    """Yield slices of poses (n, k) and their stiffness (m, 6, 6), ``size`` poses at a time.

    Parameters
    ----------
    mechanism, poses, gravity
        As for ``stiffness``, without configurations.
    size
        Poses per batch; more take more memory.
    """
    points = check_poses(mechanism, poses)
    for start in range(0, len(points), size):
        rows = slice(start, start + size)
        yield rows, stiffness(mechanism, points[rows], gravity=gravity)


def sag(mechanism: Mechanism, poses: Poses) -> Array:
    """Return the linear displacement of the tool under the mechanism's own weight and offsets.

    Parameters
    ----------
    mechanism, poses
        As for ``stiffness``.

    Returns
    -------
    Array
        Twist (n, 6) at M in base axes, m and rad; NaN if a pose is out of reach.

    Raises
    ------
    InputError
        If the tool moves freely.

    Examples
    --------
    >>> import stiffscope as ss
    >>> machine = ss.assemble(ss.load_robot("biglide"), "published")
    >>> (1e6 * ss.sag(machine, [[0, 0, 0.34748]])[0, 2]).round(0)  # um along z, which points down
    np.float64(11.0)
    """

    def work(order: Order, where: Places) -> Array:
        return find_equilibrium(order, where, own_loads(order, where)).twist[..., 0]

    return map_chunks(mechanism, poses, (6,), work)


def analyse(
    mechanism: Mechanism, poses: Poses, *, gravity: Gravity = "none"
) -> Stiffness:
    """Compute stiffness, compliance, mobility and (with gravity) sag at tool poses.

    Parameters
    ----------
    mechanism, poses
        As for ``stiffness``.
    gravity
        ``"exact"``: under own weight and offsets. If there is no equilibrium nearby, the stiffness
        is the unloaded one, and the sag is NaN. What is rigid without weight is so with it.

    Returns
    -------
    Stiffness
        Results at every pose; if the stiffness is infinite, the compliance and rigid directions.

    Examples
    --------
    >>> import stiffscope as ss
    >>> machine = ss.assemble(ss.load_robot("biglide"), "published")
    >>> state = ss.analyse(machine, [[0, 0, 0.34748]], gravity="exact")
    >>> (1e6 * state.sag[0, 2]).round(2)  # um along z, which points down
    np.float64(11.05)
    """
    check_word("gravity", gravity, get_args(Gravity))
    configurations = configure(mechanism, poses)
    n = len(configurations)
    matrix = np.empty((n, 6, 6))
    yielding = np.empty((n, 6, 6))
    sagged = np.empty((n, 6))
    inverse_condition = np.empty(n)
    free = np.empty(n, dtype=np.int_)
    rigid: list[Array] = []
    for start in range(0, n, _BLOCK):
        rows = slice(start, start + _BLOCK)
        some = configurations if n <= _BLOCK else configurations[rows]
        found = _analyse_block(mechanism, some, gravity)
        arrays = (matrix, yielding, sagged, free, inverse_condition)
        for array, part in zip(arrays, found[:-1], strict=True):
            array[rows] = part
        rigid += found[-1]
    return Stiffness(
        configurations, matrix, sagged, free, inverse_condition, yielding, tuple(rigid)
    )


def _analyse_block(
    mechanism: Mechanism, configurations: Configurations, gravity: Gravity
) -> tuple[Array, Array, Array, NDArray[np.int_], Array, list[Array]]:
    """Return stiffness, compliance, sag, free directions, inverse condition, rigid wrenches."""
    both = map_chunks(mechanism, configurations, (6, 13), _find_unloaded, gravity)
    matrix = both[..., :6]
    yielding, free, inverse_condition = _complete_compliance(matrix, both[..., 6:12])
    stuck = np.asarray(~np.isfinite(matrix).all(axis=(1, 2)))
    plain = yielding
    sagged = np.zeros((len(configurations), 6))
    if gravity != "none":
        loaded = _analyse_weight(mechanism, configurations, matrix, yielding)
        sagged = loaded[..., 12]
        still = np.isnan(loaded[:, :1, 12:])
        matrix = np.where(still, matrix, loaded[..., :6])
        yielding = np.where(still, yielding, loaded[..., 6:12])
        yielding, free, inverse_condition = _complete_compliance(matrix, yielding)
        plain = np.where(
            stuck[:, None, None], plain, yielding
        )  # weight bends what is rigid, little
    stuck = configurations.valid & (stuck | ~np.isfinite(matrix).all(axis=(1, 2)))
    matrix[stuck] = np.nan
    free[stuck] = 0
    inverse_condition[stuck] = 0.0
    rigid: list[Array] = list(repeat(np.zeros((0, 6)), len(configurations)))
    length = configurations.linkage.length
    element_compliance = own_compliance(mechanism, length)
    for k, wrenches in zip(
        np.flatnonzero(stuck),
        rigid_wrenches(plain[stuck], length, element_compliance),
        strict=True,
    ):
        rigid[k] = wrenches
    return matrix, yielding, sagged, free, inverse_condition, rigid


def _complete_compliance(
    matrix: Array, yielding: Array
) -> tuple[Array, NDArray[np.int_], Array]:
    """Return compliances (n, 6, 6), number of free directions and inverse condition number (n,)."""
    free = np.full(len(matrix), 6)
    inverse_condition = np.full(len(matrix), np.nan)
    known = np.isfinite(matrix).all(axis=(1, 2))
    free[known], inverse_condition[known] = count_freedoms(matrix[known])
    free[np.isfinite(yielding).all(axis=(1, 2))] = 0  # what has a compliance is held
    completed = np.where(np.isnan(yielding), invert_stiffness(matrix, free), yielding)
    return completed, free, inverse_condition


def _analyse_weight(
    mechanism: Mechanism,
    configurations: Configurations,
    unloaded: Array,
    yielding: Array,
) -> Array:
    """Return stiffness, compliance and sag (n, 6, 13) under weights, if they are known without.

    All are NaN if the tool moves freely, if no equilibrium is found, or if weights turn it by more than
    a tenth of a radian or move it by more than a tenth of its characteristic length.
    """
    out = np.full((len(unloaded), 6, 13), np.nan)
    loose = bool(
        find_laws(mechanism)
    )  # weights may hold motions that are free without them
    firm = np.flatnonzero(
        configurations.valid & (loose | np.isfinite(yielding).all(axis=(1, 2)))
    )
    both = map_chunks(mechanism, configurations[firm], (6, 13), _find_matrices, "exact")
    size = np.ones((len(firm), 6))
    size[:, :3] = configurations.linkage.length
    known = np.isfinite(unloaded[firm]).all(axis=(1, 2)) & (not loose)
    size[known, :3] = characteristic_length(unloaded[firm[known]])[:, None]
    small = (np.abs(both[..., 12]) < _FAR * size).all(axis=1) & ~np.isnan(
        both[..., :12]
    ).all(axis=(1, 2))
    out[firm[small]] = both[small]
    return out


def stiffness_error(mechanism: Mechanism, poses: Poses) -> Array:
    """Return bounds (n, 6, 6) on the error of the stiffness at M from those of body compliances.

    To first order ``δK = -Σ (A K)ᵀ δC (A K)`` with A the wrench on a body per unit wrench at M.
    Errors of equal parts are correlated: absolute values add. NaN if the stiffness is infinite.
    """
    return _propagate_errors(mechanism, poses, tool_stiffness)


def compliance_error(mechanism: Mechanism, poses: Poses) -> Array:
    """Return bounds (n, 6, 6) on the error of the compliance at M: ``δC = Σ Aᵀ δC A``, as `stiffness_error`."""
    return _propagate_errors(mechanism, poses, lambda _: np.eye(6)[None])


def _propagate_errors(
    mechanism: Mechanism, poses: Poses, find_loads: Callable[[Any], Array]
) -> Array:
    """Return ``Σ |A F|ᵀ δC |A F|`` (n, 6, 6) with the loads F (m, 6, 6) at M."""
    elastic = ((b.name, b.elastic) for b in mechanism.bodies if b.elastic is not None)
    bars = {name: each.error for name, each in elastic if each.error is not None}

    def work(order: Order, where: Places) -> Array:
        try:
            state = condense_network(order, where)
            loads = find_loads(state)
        except InfiniteStiffnessError:
            return _UNKNOWN
        response = solve_condensed(state, Loads(6, {END: loads}))
        out = np.zeros_like(loads)
        for name, bar in bars.items():
            carried = np.abs(response.find_wrench(mechanism.rows(name)))
            out = out + carried.mT @ bar @ carried
        return out

    return map_chunks(mechanism, poses, (6, 6), work)


def own_compliance(mechanism: Mechanism, length: float) -> float:
    """Return the largest compliance of a mechanism's elements, 1/(N·m), with a length as unit."""
    scale = np.array([1.0 / length] * 3 + [1.0] * 3)
    sizes = [0.0]
    for element in list_elements(mechanism):
        scaled = element.factor * scale[:, None]
        sizes.append(float(np.square(scaled).sum()))
    return max(sizes)


def _find_stiffness(order: Order, where: Places, gravity: Gravity) -> Array:
    """Return the stiffness (n, 6, 6)."""
    if gravity != "none":
        return _at_weight(order, where, loaded_stiffness, 7)[..., :6]
    tool_matrices = tool_stiffness(condense_network(order, where))
    if not is_ill_conditioned(tool_matrices, order.length).any():
        return tool_matrices
    return _find_matrices(order, where, gravity)[..., :6]


def _at_weight(order: Order, where: Places, work: Work, columns: int) -> Array:
    """Return what is found (n, 6, columns) under own weight, with drives' laws linearized there."""
    if not find_laws(order.mechanism):
        return work(order, where)
    return map_segments(order, where, own_loads(order, where), (6, columns), work)[
        ..., 0
    ]


def _find_matrices(order: Order, where: Places, gravity: Gravity) -> Array:
    """Return stiffness, compliance, sag (n, 6, 13); NaN if infinite or left to inversion."""
    if gravity == "exact" and find_laws(order.mechanism):
        return _at_weight(
            order, where, lambda some, there: _find_matrices(some, there, gravity), 13
        )
    loaded = gravity == "exact"
    still = np.zeros((1, 6, 1))
    try:
        matrices = (
            loaded_stiffness(order, where)
            if loaded
            else tool_stiffness(condense_network(order, where))
        )
    except InfiniteStiffnessError:
        return _invert_compliance(order, where, gravity)
    out = stack_columns(
        [matrices[..., :6], _UNKNOWN, matrices[..., 6:] if loaded else still]
    )
    known = np.isfinite(out[..., :6]).all(axis=(1, 2))
    doubtful = np.zeros(len(out), dtype=bool)
    doubtful[known] = is_ill_conditioned(out[known, :, :6], order.length)
    if not doubtful.any():
        return out
    out = np.array(np.broadcast_to(out, (len(where.tool), 6, 13)))
    doubted = np.flatnonzero(np.broadcast_to(doubtful, len(out)))
    single = doubted if len(doubted) <= _SINGLY else doubted[:0]
    for part in (doubted, *([k] for k in single)):  # all at once, else one by one
        try:
            out[part] = _invert_compliance(order, where.some(np.array(part)), gravity)
        except InputError:  # its tool moves freely: the stiffness is right
            continue
        if part is doubted:
            break
    return out


def _invert_compliance(order: Order, where: Places, gravity: Gravity) -> Array:
    """Return compliances, their inverses and sag as ``_find_matrices``; NaN where rigid."""
    if gravity == "exact":
        tool_compliance = loaded_compliance(order, where)
    else:
        loads = Loads(6, {END: np.eye(6)[None]}, balanced=_BALANCED)
        unit = solve_unstiffened(order, where, loads).twist
        tool_compliance = stack_columns([0.5 * (unit + unit.mT), np.zeros((1, 6, 1))])
    matrix = np.full((len(tool_compliance), 6, 6), np.nan)
    yielding = tool_compliance[..., :6]
    known = np.flatnonzero(np.isfinite(yielding).all(axis=(1, 2)))
    element_compliance = own_compliance(order.mechanism, order.length)
    rigid = rigid_wrenches(yielding[known], order.length, element_compliance)
    firm = known[[not len(wrenches) for wrenches in rigid]]
    matrix[firm] = _invert_scaled(yielding[firm])
    return np.concatenate([matrix, tool_compliance], axis=2)


def _invert_scaled(matrices: Array) -> Array:
    """Return the inverses of compliances (n, 6, 6), scaled to a unit diagonal to keep digits."""
    root: Array = np.sqrt(np.einsum("nii->ni", matrices))
    scale: Array = 1.0 / (root[:, :, None] * root[:, None, :])
    out: Array = np.linalg.inv(matrices * scale) * scale
    return 0.5 * (out + out.mT)


def _find_unloaded(order: Order, where: Places, gravity: Gravity) -> Array:
    """Return ``_find_matrices`` without loads; zero stiffness if only weight holds the tool."""
    try:
        return _find_matrices(order, where, "none")
    except InputError:
        if gravity == "none" or not find_laws(order.mechanism):
            raise
        return stack_columns([np.zeros((1, 6, 6)), _UNKNOWN, np.zeros((1, 6, 1))])


def map_chunks(
    mechanism: Mechanism,
    poses: Poses,
    entries: tuple[int, ...],
    work: Callable[..., Array],
    *more: Any,
) -> Array:
    """Apply work to configurations in chunks; only the result grows with their number."""
    if isinstance(poses, Configurations):
        n = len(poses)
        chunks = (
            poses[i : i + CHUNK] if n > CHUNK else poses
            for i in range(0, max(n, 1), CHUNK)
        )
    else:
        points = check_poses(mechanism, poses)
        n = len(points)
        chunks = configure_chunks(mechanism, points)
    out = np.full((n, *entries), np.nan)
    at = 0
    for chunk in chunks:
        rows = slice(at, at + len(chunk))
        at += len(chunk)
        good = chunk if chunk.valid.all() else chunk[chunk.valid]
        if len(good):
            order = find_order(mechanism, good.linkage)
            where = place_nodes(good)
            out[rows][chunk.valid] = work(order, where, *more)
    return out
