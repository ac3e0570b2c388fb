"""What no order of chains and eliminations takes: connections that are rigid in directions in which they close loops.

Node twists u, coordinates y of the connections (unit springs and free motions, ``B = [F N]``) and their wrenches w as
multipliers make one saddle-point system, ``[[K, 0, Aᵀ], [0, D, -Bᵀ], [A, -B, 0]]``. Redundant constraints and idle
motions make it singular; what is independent at home is solved for, and the rest verified at every pose.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from scipy.linalg import qr

from stiffscope.errors import InputError
from stiffscope.vjm.condensation import Chain, chain, condensed, home, stacked
from stiffscope.vjm.mechanism import GROUND
from stiffscope.vjm.network import END, free_directions

if TYPE_CHECKING:
    from stiffscope.vjm.condensation import Condensed
    from stiffscope.vjm.screws import Array

_RANK = 1e-10
_CONSISTENT = 1e-7  # of a right-hand side, that a solution may leave


@dataclass(eq=False)
class System:
    """The saddle-point matrix (n, s, s), the places of node twists in it, and of each connection's y and w."""

    matrix: Array
    nodes: dict[str, slice]
    coordinates: list[slice]
    wrenches: list[slice]
    columns: list[Array]  # B (n or 1, 6, m) of each connection at M in base axes


Left: TypeAlias = "list[tuple[Chain, Array, Array, Array]]"
"""For each connection left: its loads, its wrench, the twist across it, and its rates."""


def saddle_unit(state: Condensed) -> tuple[Array, dict[str, Array], Left]:
    """Stiffness (n or 1, 6, 6) at M in base axes; twists of the kept nodes, and connections, under unit tool twists.

    Raises InputError where the stiffness would be infinite.
    """
    system = _system(state)
    tool = system.nodes[END]
    inner = np.r_[tool.stop : system.matrix.shape[-1]]
    m = system.matrix
    coupling = m[:, inner, tool]
    moved, good = _solved(state, m[:, inner[:, None], inner], -coupling, "stiffness")
    if not good:
        names = ", ".join(e.name for c in state.order.left for e, _ in c.members)
        raise InputError(
            f"the tool has infinite stiffness in a direction, through {names}: expected a compliance there"
        )
    k = m[:, tool, tool] + np.swapaxes(coupling, -1, -2) @ moved
    unit = np.concatenate([np.broadcast_to(np.eye(6), (len(moved), 6, 6)), moved], axis=1)
    still = Chain(state.order.left[0], [], np.zeros((1, 6, 6)), np.zeros((1, 6, 6)))
    chains = [Chain(c, [], still.total, still.offset) for c in state.order.left]
    return 0.5 * (k + np.swapaxes(k, -1, -2)), *_recovered(system, chains, unit)


def saddle_response(state: Condensed) -> tuple[dict[str, Array], Left]:
    """Twists of the kept nodes and connections under the loads. Raises InputError where the tool moves freely."""
    system = _system(state)
    loads = state.loads
    cases = loads.cases if loads else 0
    chains = [chain(state, c) for c in state.order.left]
    n = max([len(system.matrix), *(len(f) for f in state.forces.values()), *(len(c.total) for c in chains)])
    right = np.zeros((n, system.matrix.shape[-1], cases))
    for node, place in system.nodes.items():
        right[:, place] += state.force(node)
    for along, y, w, b in zip(chains, system.coordinates, system.wrenches, system.columns, strict=True):
        c = along.connection
        if c.start in system.nodes:
            right[:, system.nodes[c.start]] += along.total
        right[:, w] += along.offset
        right[:, y] += _pull(state, along, b)
    found, good = _solved(state, system.matrix, right, "response")
    if not good:
        raise InputError("the tool, or a body, moves freely under its load: ask for its mobility, not its deflection")
    return _recovered(system, chains, found)


def loaded_unit(state: Condensed) -> tuple[Array, dict[str, Array], Left]:
    """``saddle_unit`` with one case more, before the unit twists: the equilibrium under the loads."""
    stiffness, unit, across = saddle_unit(state)
    moved, carried = saddle_response(state)

    def both(a: Array, b: Array) -> Array:
        n = max(len(a), len(b))
        return np.concatenate([np.broadcast_to(x, (n, *x.shape[1:])) for x in (a, b)], axis=2)

    ends = {node: both(moved[node], unit[node]) for node in moved}
    left = [
        (a[0], *(both(x, y) for x, y in zip(a[1:], b[1:], strict=True))) for a, b in zip(carried, across, strict=True)
    ]
    return stiffness, ends, left


def _recovered(system: System, chains: list[Chain], found: Array) -> tuple[dict[str, Array], Left]:
    moved = {node: found[:, place] for node, place in system.nodes.items()}
    moved[GROUND] = np.zeros((1, 6, found.shape[2]))
    states: Left = []
    for along, y, w in zip(chains, system.coordinates, system.wrenches, strict=True):
        c = along.connection
        count = sum(e.factor.shape[1] for e, _ in c.members)
        states.append((along, found[:, w], moved[c.end] - moved[c.start], found[:, y][:, count:]))
    return moved, states


def _pull(state: Condensed, along: Chain, b: Array) -> Array:
    """What the loads on a connection's inner nodes do along its coordinates, (n, m, c)."""
    out: list[Array] = []
    at, where = 0, state.where
    sizes = [e.factor.shape[1] for e, _ in along.connection.members]
    sizes += [free_directions(e, where).shape[2] for e, _ in along.connection.members]
    for size, load in zip(sizes, along.carried * 2, strict=True):
        out.append(np.swapaxes(b[:, :, at : at + size], -1, -2) @ load)
        at += size
    rows = max(len(o) for o in out)
    return np.concatenate([np.broadcast_to(o, (rows, *o.shape[1:])) for o in out], axis=1)


def _system(state: Condensed) -> System:
    """Assemble the matrix; the tool's twist comes first."""
    order, where = state.order, state.where
    nodes: dict[str, slice] = {}
    at = 0
    for node in (END, *order.kept):
        nodes[node] = slice(at, at + 6)
        at += 6
    columns, coordinates, wrenches = [], [], []
    counts: list[int] = []
    for c in order.left:
        factor, free = c.flexible(where)
        columns.append(c.frame(where).adjoint() @ stacked([factor, free]))
        counts.append(factor.shape[2])
        coordinates.append(slice(at, at + columns[-1].shape[2]))
        at += columns[-1].shape[2]
    for _ in order.left:
        wrenches.append(slice(at, at + 6))
        at += 6
    n = max([1, *(len(b) for b in columns), *(len(k) for k in state.pairs.values())])
    m = np.zeros((n, at, at))
    for (a, b), k in state.pairs.items():
        for i, j, part in ((a, b, k), (b, a, np.swapaxes(k, -1, -2))):
            if i in nodes:
                m[:, nodes[i], nodes[i]] += part
                if j in nodes:
                    m[:, nodes[i], nodes[j]] -= part
    for c, y, w, b, r in zip(order.left, coordinates, wrenches, columns, counts, strict=True):
        m[:, np.arange(y.start, y.start + r), np.arange(y.start, y.start + r)] = 1.0
        m[:, y, w] = -np.swapaxes(b, -1, -2)
        m[:, w, y] = -b
        for node, sign in ((c.end, 1.0), (c.start, -1.0)):
            if node in nodes:
                m[:, w, nodes[node]] = m[:, nodes[node], w] = sign * np.eye(6)
    return System(m, nodes, coordinates, wrenches, columns)


def _solved(state: Condensed, matrix: Array, right: Array, use: str) -> tuple[Array, bool]:
    """Solution (n, s, c) of a symmetric system that may be singular, and whether all of it holds."""
    scale, keep = _independent(state, use)
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
        turned = np.swapaxes(vectors, -1, -2) @ rest
        out[bad] = vectors @ (np.where(kept, 1.0 / np.where(kept, values, 1.0), 0.0)[..., None] * turned)
        left = np.abs(some @ out[bad] - rest).max(axis=(1, 2))
        if not (left <= _CONSISTENT * np.broadcast_to(size, n)[bad]).all():
            return out, False
    return out * scale[:, None], True


def _independent(state: Condensed, use: str) -> tuple[Array, Array]:
    """Scale of rows and columns at home, and which of them are independent there."""
    cache: dict[str, tuple[Array, Array]] = state.order.__dict__.setdefault("_independent", {})
    if use not in cache:
        at_home = condensed(state.order, home(state.order.mechanism))
        system = _system(at_home)
        scale = _scale(at_home, system)
        m = system.matrix[0]
        if use == "stiffness":
            m, scale = m[6:, 6:], scale[6:]
        _, r, order = qr(m * (scale[:, None] * scale), pivoting=True)
        pivots = np.abs(np.diagonal(r))
        cache[use] = scale, np.sort(order[: int((pivots > _RANK * pivots[0]).sum())])
    return cache[use]


def _scale(state: Condensed, system: System) -> Array:
    """Units in which stiffnesses, and lengths of the mechanism, are about one."""
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
