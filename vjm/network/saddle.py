"""Saddle-point solution of connections that elimination cannot remove, as they are rigid in loops.

Bodies of more than two ends, whose connections share coordinates, are also solved here. Node twists
u, coordinates y of the connections (unit springs and free motions, ``B = [F N]``) and their
wrenches w as multipliers form the system ``[[K, 0, Aᵀ], [0, D, -Bᵀ], [A, -B, 0]]``. Redundant
constraints and idle motions make it singular: rows independent at home are solved, others verified.
"""

# pyright: reportMissingTypeStubs=false, reportUnknownArgumentType=false
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# (scipy declares few types)

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import qr

from stiffscope.errors import InputError
from stiffscope.vjm.model.checks import GROUND
from stiffscope.vjm.network.condensation import InfiniteStiffnessError, condense_network
from stiffscope.vjm.network.loading import ElementState, Response, chain_loads
from stiffscope.vjm.network.network import END
from stiffscope.vjm.network.order import places_at_home, stack_columns, stack_rows

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from stiffscope.vjm.model.screws import Array
    from stiffscope.vjm.network.condensation import Condensed
    from stiffscope.vjm.network.loading import CondensedLoads
    from stiffscope.vjm.network.order import Connection

_RANK = 1e-10
_CONSISTENT = 1e-7  # of a right-hand side: allowed residual


_TOOL = slice(0, 6)  # the tool's twist comes first
_LOOSE = {
    "response": "the tool, or a body, moves freely: drive the joints that should hold it, or ask for its mobility",
    "held": "a body moves freely under its load: there is no equilibrium",
}


@dataclass(eq=False)
class Tie:
    """A connection left: its ``columns`` B (n or 1, 6, m) at M in base axes, and places of y and w.

    The first ``springs`` coordinates have unit springs.
    """

    connection: Connection
    columns: Array
    springs: int
    y: slice
    w: slice


@dataclass(eq=False)
class System:
    """Saddle-point matrix (n, s, s); slices of node twists and of each connection's y and w."""

    matrix: Array
    nodes: dict[str, slice]
    ties: list[Tie]


def saddle_stiffness(state: Condensed) -> Array:
    """Return the stiffness (n or 1, 6, 6) at M, base axes. Raises InfiniteStiffnessError."""
    matrix = _assemble(state).matrix
    coupling = matrix[:, 6:, _TOOL]
    moved, good = _solve(state, matrix[:, 6:, 6:], -coupling, "held")
    if not good:
        names = ", ".join(e.name for c in state.order.left for e, _ in c.members)
        fault = f"in a direction, through {names}: expected a compliance there"
        raise InfiniteStiffnessError(f"the tool has infinite stiffness {fault}")
    k = matrix[:, _TOOL, _TOOL] + coupling.mT @ moved
    return 0.5 * (k + k.mT)


def solve_saddle(
    state: Condensed, load: CondensedLoads, tool: Array | None = None
) -> Response:
    """Return the response of the remaining nodes and connections to condensed loads.

    Parameters
    ----------
    state
        Condensed network with connections left.
    load
        Loads carried through its condensation.
    tool
        Twist (n or 1, 6, c) at which the tool is held; None if it is free.

    Raises
    ------
    InputError
        If the tool, or a body, moves freely.
    """
    system = _assemble(state)
    chains = [chain_loads(state.where, load, tie.connection) for tie in system.ties]
    each = [
        system.matrix,
        *load.forces.values(),
        *(along.carried[0] for along in chains),
    ]
    right = np.zeros((max(map(len, each)), system.matrix.shape[-1], load.loads.cases))
    for node, place in system.nodes.items():
        right[:, place] += load.force(node)
    for along, tie in zip(chains, system.ties, strict=True):
        if along.connection.start in system.nodes:
            right[:, system.nodes[along.connection.start]] += along.carried[0]
        right[:, tie.w] += along.offset
        right[:, tie.y] += along.project()
    matrix = system.matrix
    use = "response"
    if tool is not None:
        use = "held"
        right = right[:, 6:] - matrix[:, 6:, _TOOL] @ tool
        matrix = matrix[:, 6:, 6:]
    solution, good = _solve(state, matrix, right, use, load.loads.balanced)
    if not good:
        raise InputError(_LOOSE[use])
    if tool is not None:
        solution = stack_rows([tool, solution])
    out = Response(
        state.where, {node: solution[:, place] for node, place in system.nodes.items()}
    )
    out.nodes[GROUND] = np.zeros((1, 6, solution.shape[2]))
    for along, tie in zip(chains, system.ties, strict=True):
        span = out.nodes[along.connection.end] - out.nodes[along.connection.start]
        (e, sign) = along.connection.members[0]
        wrench = solution[:, tie.w]
        y = solution[:, tie.y]
        if e.group:  # its own wrench alone does not tell how it strains
            state_of = (
                sign * wrench,
                sign * span,
                y[:, :0],
                sign * (span - along.offset),
            )
            out.elements[e.name] = ElementState(e, state.where, *state_of)
        else:
            along.follow(out, wrench, span, y[:, tie.springs :])
    return out


def _assemble(state: Condensed) -> System:
    order = state.order
    names = (END, *order.kept)
    nodes = {node: slice(6 * k, 6 * k + 6) for k, node in enumerate(names)}
    ties: list[Tie] = []
    shared: dict[str, slice] = {}
    at = 6 * len(names)
    for c in order.left:
        factor, free = c.flexible(state.where)
        columns = stack_columns([factor, free])
        group = c.members[0][0].group
        fresh = slice(at, at + columns.shape[2])
        y = shared.setdefault(group, fresh) if group else fresh
        at = max(at, y.stop)
        ties.append(Tie(c, columns, factor.shape[2], y, slice(0, 0)))
    for tie in ties:
        tie.w = slice(at, at + 6)
        at += 6
    n = max(
        [
            1,
            *(len(tie.columns) for tie in ties),
            *(len(k) for k in state.pairs.values()),
        ]
    )
    m = np.zeros((n, at, at))
    for (a, b), k in state.pairs.items():
        for i, j, part in ((a, b, k), (b, a, k.mT)):
            if i in nodes:
                m[:, nodes[i], nodes[i]] += part
                if j in nodes:
                    m[:, nodes[i], nodes[j]] -= part
    for tie in ties:
        springs = np.arange(tie.y.start, tie.y.start + tie.springs)
        m[:, springs, springs] = 1.0
        m[:, tie.y, tie.w], m[:, tie.w, tie.y] = -tie.columns.mT, -tie.columns
        for node, sign in ((tie.connection.end, 1.0), (tie.connection.start, -1.0)):
            if node in nodes:
                m[:, tie.w, nodes[node]] = m[:, nodes[node], tie.w] = sign * np.eye(6)
    return System(m, nodes, ties)


def _solve(
    state: Condensed,
    matrix: Array,
    right: Array,
    use: str,
    balanced: float = _CONSISTENT,
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
        singular = np.broadcast_to(m, (n, *m.shape[1:]))[bad]
        rest = np.broadcast_to(b, (n, *b.shape[1:]))[bad]
        values, vectors = np.linalg.eigh(singular)
        significant = np.abs(values) > _RANK * np.abs(values).max(axis=1, keepdims=True)
        turned = vectors.mT @ rest
        inverted = np.where(significant, 1.0 / np.where(significant, values, 1.0), 0.0)
        out[bad] = vectors @ (inverted[..., None] * turned)
        left = np.abs(singular @ out[bad] - rest).max(axis=(1, 2))
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
            m = m[6:, 6:]
            scale = scale[6:]
        scaled = m * (scale[:, None] * scale)
        _, r, order = qr(scaled, pivoting=True)  # pyright: ignore[reportAssignmentType]
        pivots = np.abs(np.diagonal(r))
        first = int((pivots > _RANK * pivots[0]).sum())
        cache[use] = scale, np.sort(np.asarray(order[:first], dtype=np.intp))
    return cache[use]


def _scale(state: Condensed, system: System) -> Array:
    """Return units in which stiffnesses and lengths are of order one."""
    length = state.order.length
    unit = np.repeat([1.0, 1.0 / length], 3)
    sizes = [
        float(np.abs(np.diagonal(k[0]) * unit**2).max()) for k in state.pairs.values()
    ]
    elements = [e for c in state.order.left for e, _ in c.members if e.factor.shape[1]]
    sizes += [1.0 / float(((e.factor / unit[:, None]) ** 2).sum()) for e in elements]
    sizes = [k for k in sizes if k > _RANK * max(sizes)]
    root = np.exp(0.5 * np.mean(np.log(sizes))) if sizes else 1.0
    scale = np.ones(system.matrix.shape[-1])
    for place in system.nodes.values():
        scale[place] = np.repeat([1.0, 1.0 / length], 3) / root
    for tie in system.ties:
        scale[tie.w] = np.repeat([1.0, length], 3) * root
        moved = np.linalg.norm(
            tie.columns[0] * np.repeat([1.0, length], 3)[:, None], axis=0
        )
        free = np.arange(len(moved)) >= tie.springs
        scale[tie.y] = np.where(
            free, 1.0 / (np.where(moved > 0.0, moved, 1.0) * root), 1.0
        )
    return scale
