"""Solutions of a condensed network: tool stiffness, and equilibrium under loads.

Connections that condensation cannot remove are solved as a saddle-point system.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.errors import InputError, say_count
from stiffscope.vjm.elements.laws import find_laws, linearize, settle, without_laws
from stiffscope.vjm.model.checks import GROUND
from stiffscope.vjm.model.semidefinite import pivot
from stiffscope.vjm.network.condensation import (
    InfiniteStiffnessError,
    condense_loads,
    condense_network,
    recover_response,
)
from stiffscope.vjm.network.loading import Loads, Response
from stiffscope.vjm.network.network import END
from stiffscope.vjm.network.order import find_order
from stiffscope.vjm.network.saddle import saddle_stiffness, solve_saddle
from stiffscope.vjm.statics.singularity import is_ill_conditioned

if TYPE_CHECKING:
    from collections.abc import Callable

    from stiffscope.vjm.model.mechanism import Mechanism
    from stiffscope.vjm.model.screws import Array
    from stiffscope.vjm.network.condensation import Condensed
    from stiffscope.vjm.network.loading import ElementState, Wanted
    from stiffscope.vjm.network.network import Places
    from stiffscope.vjm.network.order import Order

_FREE = 1e-12  # relative pivot of the tool's stiffness taken as rounding
_BALANCED = 1e-6  # of a load: tolerance along a free motion of the tool
_ROUNDING = 1e-12  # of a drive's wrench: a force taken as zero


def tool_stiffness(state: Condensed) -> Array:
    """Return the stiffness (n or 1, 6, 6) at M, base axes. Raises InfiniteStiffnessError."""
    if state.order.left:
        return saddle_stiffness(state)
    if (GROUND, END) in state.pairs or (END, GROUND) in state.pairs:
        return state.pair(END, GROUND)
    return np.zeros((1, 6, 6))


def solve_loads(
    order: Order, where: Places, loads: Loads, wanted: Wanted = "all"
) -> Response:
    """Solve the equilibrium under loads on nodes, including the tool, and offsets.

    Raises InputError if something moves freely under its load.

    Parameters
    ----------
    order
        Elimination order of the network.
    where
        Places of all nodes at n configurations.
    loads
        Wrenches on nodes and imposed offsets, c cases.
    wanted
        What to recover of nodes and elements; less takes less time.
    """
    try:
        state = condense_network(order, where)
    except InfiniteStiffnessError:
        return solve_unstiffened(order, where, loads, wanted)
    if not order.left and is_ill_conditioned(tool_stiffness(state), order.length).any():
        with suppress(InputError):  # else its tool moves freely, and the loads may not
            return solve_unstiffened(order, where, loads, wanted)
    return solve_condensed(state, loads, wanted=wanted)


def solve_unstiffened(
    order: Order, where: Places, loads: Loads, wanted: Wanted = "all"
) -> Response:
    """Do as ``solve_loads`` without any stiffness, which may be infinite or ill-conditioned."""
    state = condense_network(order.unstiffened_order, where)
    return solve_condensed(state, loads, wanted=wanted)


def find_equilibrium(order: Order, where: Places, loads: Loads) -> Response:
    """Solve ``solve_loads`` with the drives' laws, one equilibrium per case.

    Also raises InputError if no equilibrium is found.

    Parameters
    ----------
    order
        Elimination order of the network.
    where
        Places of all nodes at n configurations.
    loads
        Wrenches on nodes and imposed offsets, c cases.
    """
    laws = find_laws(order.mechanism)
    if not laws:
        return solve_loads(order, where, loads)
    count = len(laws)
    c = loads.cases
    nodes = {name: _pad(w, count) for name, w in loads.nodes.items()}
    offsets = {name: _pad(t, count) for name, t in loads.offsets.items()}
    along = {name: order.mechanism.joint(name).type.driven or 0 for name in laws}
    for k, (name, component) in enumerate(along.items()):
        unit = np.zeros((1, 6, c + count))
        unit[0, component, c + k] = 1.0
        offsets[name] = offsets.get(name, np.zeros((1, 6, 1))) + unit
    linear = find_order(without_laws(order.mechanism), order.linkage)
    found = solve_loads(linear, where, Loads(c + count, nodes, offsets, loads.balanced))
    rows = [
        _force_along(found.elements[name].wrench, i, order.length)
        for name, i in along.items()
    ]
    n = max(len(found.twist), *map(len, rows))
    forces = np.stack([np.broadcast_to(row, (n, c + count)) for row in rows], axis=1)
    stiffness = np.array([law.slopes[0] for law in laws.values()])
    pull = np.swapaxes(forces[..., :c], 1, 2).reshape(n * c, count)
    settled = settle(
        list(laws.values()), stiffness, pull, np.repeat(forces[..., c:], c, axis=0)
    )
    shift = np.swapaxes(settled.shift.reshape(n, c, count), 1, 2)
    deflection = np.swapaxes(settled.deflection.reshape(n, c, count), 1, 2)

    def mix(cases: Array) -> Array:
        return (
            cases[..., :c] + cases[..., c:] @ shift
            if cases.shape[-1] == c + count
            else cases
        )

    elements: dict[str, ElementState] = {}
    for name, e in found.elements.items():
        strained = None if e.strained is None else mix(e.strained)
        mixed = {key: mix(getattr(e, key)) for key in ("carried", "across", "rates")}
        elements[name] = replace(e, **mixed, strained=strained)
    for k, (name, law) in enumerate(laws.items()):
        elements[name] = replace(elements[name], deflection=deflection[:, k], law=law)
    return Response(
        where, {node: mix(twist) for node, twist in found.nodes.items()}, elements
    )


def _force_along(wrench: Array, component: int, length: float) -> Array:
    """Return a component (n, c) of wrenches (n, 6, c), with rounding set to zero."""
    unit = np.repeat([length, 1.0] if component > 2 else [1.0, 1.0 / length], 3)
    size = np.abs(wrench * unit[:, None]).max(axis=1)
    return np.where(
        np.abs(wrench[:, component]) > _ROUNDING * size, wrench[:, component], 0.0
    )


def map_segments(
    order: Order,
    where: Places,
    loads: Loads,
    entries: tuple[int, ...],
    work: Callable[[Order, Places], Array],
) -> Array:
    """Map ``work`` over the robots, linearized by their drives' laws: (n, *entries, c) for c cases.

    NaN if the robot moves freely.

    Parameters
    ----------
    order, where, loads
        As for ``solve_loads``.
    entries
        Shape of the result for each pose and case.
    work
        Function of a linear order and the places of some poses.
    """
    laws = find_laws(order.mechanism)
    equilibrium = find_equilibrium(order, where, loads)
    n = len(where.tool)
    out = np.full((n, *entries, loads.cases), np.nan)
    for case in range(loads.cases):
        segments = np.zeros((n, len(laws)), dtype=np.intp)
        for k, (name, law) in enumerate(laws.items()):
            segments[:, k] = law.segment(
                np.broadcast_to(_deflection(equilibrium, name)[:, case], n)
            )
        rows, which = np.unique(segments, axis=0, return_inverse=True)
        for k, row in enumerate(rows.tolist()):
            members = np.flatnonzero(which.ravel() == k)
            linear = find_order(linearize(order.mechanism, row), order.linkage)
            with suppress(InputError):
                out[members, ..., case] = work(linear, where.some(members))
    return out


def _deflection(response: Response, name: str) -> Array:
    deflection = response.elements[name].deflection
    return np.zeros((1, 1)) if deflection is None else deflection


def _pad(cases: Array, more: int) -> Array:
    return np.pad(cases, ((0, 0), (0, 0), (0, more)))


def solve_condensed(
    state: Condensed, loads: Loads, tool: Array | None = None, wanted: Wanted = "all"
) -> Response:
    """Do as ``solve_loads`` when condensed; the tool is free, or held at a twist (n or 1, 6, c)."""
    load = condense_loads(state, loads)
    if state.order.left:
        return recover_response(state, load, solve_saddle(state, load, tool))
    if tool is None:
        tool = _solve_tool(tool_stiffness(state), load.force(END))
    ends = {GROUND: np.zeros((1, 6, loads.cases)), END: tool}
    return recover_response(state, load, Response(state.where, ends, wanted=wanted))


def solve_dislocations(state: Condensed, mechanism: Mechanism, name: str) -> Response:
    """Return the response to unit twists, own axes, of an element's ends from the first.

    Parameters
    ----------
    state
        The condensed network.
    mechanism
        Its mechanism.
    name
        A joint or a body of m + 1 ends: 6m cases.
    """
    rows = mechanism.rows(name)
    unit: Array = np.eye(6 * len(rows)).reshape(len(rows), 1, 6, -1)
    slips = Loads(6 * len(rows), {}, dict(zip(rows, unit, strict=True)))
    return solve_condensed(state, slips)


def _solve_tool(stiffness: Array, wrench: Array) -> Array:
    """Return the twist (n, 6, c) of a stiffness (n or 1, 6, 6) under wrenches (n or 1, 6, c).

    Raises InputError if a wrench acts along a free direction.
    """
    half, pivots = pivot(stiffness, _FREE)
    twist = half.mT @ (half @ wrench)
    if (pivots <= _FREE).any():
        left = np.abs(stiffness @ twist - wrench)
        if (left > _BALANCED * np.abs(wrench).max(axis=1, keepdims=True)).any():
            count = int((pivots <= _FREE).sum(axis=1).max())
            what = "ask for its mobility, not for its deflection"
            many = say_count(count, "direction")
            raise InputError(f"the tool moves freely in {many}: {what}")
    return twist
