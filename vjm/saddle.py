"""Saddle-point solution of connections that elimination cannot remove, as they are rigid in loops.

Bodies of more than two ends, whose connections share coordinates, are also solved here. Node twists
u, coordinates y of the connections (unit springs and free motions, ``B = [F N]``) and their
wrenches w as multipliers form the system ``[[K, 0, Aᵀ], [0, D, -Bᵀ], [A, -B, 0]]``. Redundant
constraints and idle motions make it singular: rows independent at home are solved, others verified.
"""

# pyright: reportMissingTypeStubs=false, reportUnknownArgumentType=false, reportUnknownMemberType=false, reportUnknownVariableType=false
# (scipy declares few types)

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from scipy.linalg import qr

from stiffscope.errors import InputError
from stiffscope.vjm.checks import GROUND
from stiffscope.vjm.condensation import InfiniteStiffnessError, condense_network
from stiffscope.vjm.loading import chain_loads, project_loads
from stiffscope.vjm.network import END
from stiffscope.vjm.order import places_at_home, stack_columns, stack_rows

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from stiffscope.vjm.condensation import Condensed
    from stiffscope.vjm.loading import ChainLoads, CondensedLoads
    from stiffscope.vjm.screws import Array

_RANK = 1e-10
_CONSISTENT = 1e-7  # of a right-hand side: allowed residual


@dataclass(eq=False)
class System:
    """Saddle-point matrix (n, s, s); slices of node twists and of each connection's y and w."""

    matrix: Array
    nodes: dict[str, slice]
    coordinates: list[slice]
    wrenches: list[slice]
    columns: list[Array]  # B (n or 1, 6, m) of each connection at M in base axes


Left: TypeAlias = "list[tuple[ChainLoads, Array, Array, Array]]"
"""Connections left, by their loads: wrench, twist across and rates."""


def saddle_stiffness(state: Condensed) -> Array:
    """Stiffness (n or 1, 6, 6) at M in base axes. Raises InfiniteStiffnessError where it would be infinite."""
    matrix, tool, inner = _divide(_assemble(state))
    coupling = matrix[:, inner, tool]
    moved, good = _solve(state, matrix[:, inner[:, None], inner], -coupling, "held")
    if not good:
        names = ", ".join(e.name for c in state.order.left for e, _ in c.members)
        raise InfiniteStiffnessError(
            f"the tool has infinite stiffness in a direction, through {names}: expected a compliance there"
        )
    k = matrix[:, tool, tool] + coupling.mT @ moved
    return 0.5 * (k + k.mT)


def saddle_response(state: Condensed, load: CondensedLoads) -> tuple[dict[str, Array], Left]:
    """Return kept nodes' twists and connections under loads. InputError for free motions."""
    system = _assemble(state)
    chains, right = _form_right_side(state, system, load)
    found, good = _solve(state, system.matrix, right, "response", load.loads.balanced)
    if not good:
        raise InputError("the tool, or a body, moves freely under its load: ask for its mobility, not its deflection")
    return _recover(system, chains, found)


def saddle_held(state: Condensed, load: CondensedLoads, twist: Array) -> tuple[dict[str, Array], Left]:
    """``saddle_response`` with the tool held at a twist (n or 1, 6, c)."""
    system = _assemble(state)
    chains, right = _form_right_side(state, system, load)
    matrix, tool, inner = _divide(system)
    rest = right[:, inner] - matrix[:, inner, tool] @ twist
    found, good = _solve(state, matrix[:, inner[:, None], inner], rest, "held", load.loads.balanced)
    if not good:
        raise InputError("a body moves freely under its load: there is no equilibrium")
    return _recover(system, chains, stack_rows([twist, found]))


def _divide(system: System) -> tuple[Array, slice, NDArray[np.intp]]:
    """The matrix, the places of the tool's twist in it, and those of all else."""
    tool = system.nodes[END]
    return system.matrix, tool, np.r_[tool.stop : system.matrix.shape[-1]]


def _form_right_side(state: Condensed, system: System, load: CondensedLoads) -> tuple[list[ChainLoads], Array]:
    """Return loads along the connections, and the right-hand side (n, s, c)."""
    chains = [chain_loads(state, load, c) for c in state.order.left]
    n = max([len(system.matrix), *(len(f) for f in load.forces.values()), *(len(c.carried[0]) for c in chains)])
    right = np.zeros((n, system.matrix.shape[-1], load.loads.cases))
    for node, place in system.nodes.items():
        right[:, place] += load.force(node)
    for along, y, w, b in zip(chains, system.coordinates, system.wrenches, system.columns, strict=True):
        c = along.connection
        if c.start in system.nodes:
            right[:, system.nodes[c.start]] += along.carried[0]
        right[:, w] += along.offset
        right[:, y] += project_loads(along, b)
    return chains, right


def _recover(system: System, chains: Sequence[ChainLoads], found: Array) -> tuple[dict[str, Array], Left]:
    moved = {node: found[:, place] for node, place in system.nodes.items()}
    moved[GROUND] = np.zeros((1, 6, found.shape[2]))
    states: Left = []
    for along, y, w in zip(chains, system.coordinates, system.wrenches, strict=True):
        c = along.connection
        count = sum(e.factor.shape[1] for e, _ in c.members)
        states.append((along, found[:, w], moved[c.end] - moved[c.start], found[:, y][:, count:]))
    return moved, states


def _assemble(state: Condensed) -> System:
    """Assemble the matrix; the tool's twist comes first."""
    order, where = state.order, state.where
    nodes: dict[str, slice] = {}
    at = 0
    for node in (END, *order.kept):
        nodes[node] = slice(at, at + 6)
        at += 6
    columns: list[Array] = []
    coordinates: list[slice] = []
    wrenches: list[slice] = []
    counts: list[int] = []
    shared: dict[str, slice] = {}
    for c in order.left:
        factor, free = c.flexible(where)
        columns.append(stack_columns([factor, free]))
        counts.append(factor.shape[2])
        fresh = slice(at, at + columns[-1].shape[2])
        group = c.members[0][0].group
        coordinates.append(shared.setdefault(group, fresh) if group else fresh)
        at = max(at, coordinates[-1].stop)
    for _ in order.left:
        wrenches.append(slice(at, at + 6))
        at += 6
    n = max([1, *(len(b) for b in columns), *(len(k) for k in state.pairs.values())])
    m = np.zeros((n, at, at))
    _add_stiffnesses(m, state, nodes)
    for c, y, w, b, r in zip(order.left, coordinates, wrenches, columns, counts, strict=True):
        m[:, np.arange(y.start, y.start + r), np.arange(y.start, y.start + r)] = 1.0
        m[:, y, w] = -b.mT
        m[:, w, y] = -b
        for node, sign in ((c.end, 1.0), (c.start, -1.0)):
            if node in nodes:
                m[:, w, nodes[node]] = m[:, nodes[node], w] = sign * np.eye(6)
    return System(m, nodes, coordinates, wrenches, columns)


def _add_stiffnesses(matrix: Array, state: Condensed, nodes: dict[str, slice]) -> None:
    for (a, b), k in state.pairs.items():
        for i, j, part in ((a, b, k), (b, a, k.mT)):
            if i in nodes:
                matrix[:, nodes[i], nodes[i]] += part
                if j in nodes:
                    matrix[:, nodes[i], nodes[j]] -= part


def _solve(
    state: Condensed, matrix: Array, right: Array, use: str, balanced: float = _CONSISTENT
) -> tuple[Array, bool]:
    """Solve a symmetric, possibly singular system (n, s, c); return if consistent, too."""
    scale, keep = _find_independent(state, use)
    m = matrix * (scale[:, None] * scale)
    b = right * scale[:, None]
    n = max(len(m), len(b))
    out = np.zeros((n, *b.shape[1:]))
    try:
        part = np.linalg.solve(m[:, keep[:, None], keep], b[:, keep])
    except np.linalg.LinAlgError:
        part = np.full((n, len(keep), b.shape[2]), np.nan)
    out[:, keep] = part
    size = np.maximum(np.abs(b).max(axis=(1, 2)), 1e-300)
    bad = ~(np.abs(m @ out - b).max(axis=(1, 2)) <= _CONSISTENT * size)
    if bad.any():
        some = np.broadcast_to(m, (n, *m.shape[1:]))[bad]
        rest = np.broadcast_to(b, (n, *b.shape[1:]))[bad]
        values, vectors = np.linalg.eigh(some)
        kept = np.abs(values) > _RANK * np.abs(values).max(axis=1, keepdims=True)
        turned = vectors.mT @ rest
        out[bad] = vectors @ (np.where(kept, 1.0 / np.where(kept, values, 1.0), 0.0)[..., None] * turned)
        left = np.abs(some @ out[bad] - rest).max(axis=(1, 2))
        if not (left <= balanced * np.broadcast_to(size, n)[bad]).all():
            return out, False
    return out * scale[:, None], True


def _find_independent(state: Condensed, use: str) -> tuple[Array, NDArray[np.intp]]:
    """Return scales of rows and columns at home, and the rows independent there; cached."""
    cache = state.order.independent
    if use not in cache:
        at_home = condense_network(state.order, places_at_home(state.order.mechanism))
        system = _assemble(at_home)
        scale = _scale(at_home, system)
        m = system.matrix[0]
        if use == "held":
            m, scale = m[6:, 6:], scale[6:]
        _, r, order = qr(m * (scale[:, None] * scale), pivoting=True)  # pyright: ignore[reportAssignmentType]
        pivots = np.abs(np.diagonal(r))
        first = int((pivots > _RANK * pivots[0]).sum())
        cache[use] = scale, np.sort(np.asarray(order[:first], dtype=np.intp))
    return cache[use]


def _scale(state: Condensed, system: System) -> Array:
    """Return units in which stiffnesses and lengths are of order one."""
    length = state.order.length
    unit = np.repeat([1.0, 1.0 / length], 3)
    sizes = [float(np.abs(np.diagonal(k[0]) * unit**2).max()) for k in state.pairs.values()]
    factors = [e.factor / unit[:, None] for c in state.order.left for e, _ in c.members if e.factor.shape[1]]
    sizes += [1.0 / float((f**2).sum()) for f in factors]
    sizes = [k for k in sizes if k > _RANK * max(sizes)]
    root = np.exp(0.5 * np.mean(np.log(sizes))) if sizes else 1.0
    scale = np.ones(system.matrix.shape[-1])
    for place in system.nodes.values():
        scale[place] = np.repeat([1.0, 1.0 / length], 3) / root
    for place in system.wrenches:
        scale[place] = np.repeat([1.0, length], 3) * root
    for place, b, c in zip(system.coordinates, system.columns, state.order.left, strict=True):
        count = sum(e.factor.shape[1] for e, _ in c.members)
        moved = np.linalg.norm(b[0] * np.repeat([1.0, length], 3)[:, None], axis=0)
        free = np.arange(len(moved)) >= count
        scale[place] = np.where(free, 1.0 / (np.where(moved > 0.0, moved, 1.0) * root), 1.0)
    return scale
