"""Solutions of a condensed network: its stiffness at the tool, and equilibrium under loads.

What no step of the condensation could take is solved as a saddle-point system.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from stiffscope.vjm.checks import GROUND
from stiffscope.vjm.condensation import InfiniteStiffnessError, condense_network
from stiffscope.vjm.loading import condense_loads, recover_response, solve_tool
from stiffscope.vjm.network import END
from stiffscope.vjm.saddle import saddle_held, saddle_response, saddle_unit

if TYPE_CHECKING:
    from stiffscope.vjm.condensation import Condensed
    from stiffscope.vjm.loading import Loads, Response
    from stiffscope.vjm.network import Places
    from stiffscope.vjm.order import Order
    from stiffscope.vjm.screws import Array


def tool_stiffness(state: Condensed) -> Array:
    """Stiffness (n or 1, 6, 6) at M in base axes. Raises InfiniteStiffnessError where it would be infinite."""
    if state.order.left:
        return saddle_unit(state)[0]
    if (GROUND, END) in state.pairs or (END, GROUND) in state.pairs:
        return state.pair(END, GROUND)
    return np.zeros((1, 6, 6))


def solve_loads(order: Order, where: Places, loads: Loads) -> Response:
    """Equilibrium under loads on nodes (the tool is one) and offsets.

    Raises InputError where something moves freely under its load.
    """
    try:
        state = condense_network(order, where)
    except InfiniteStiffnessError:
        state = condense_network(order.unstiffened_order, where)
    return solve_condensed(state, loads)


def solve_condensed(state: Condensed, loads: Loads) -> Response:
    """``loaded`` of a network that was condensed before."""
    load = condense_loads(state, loads)
    if state.order.left:
        return recover_response(state, load, *saddle_response(state, load))
    ends = {GROUND: np.zeros((1, 6, loads.cases)), END: solve_tool(tool_stiffness(state), load.force(END))}
    return recover_response(state, load, ends)


def solve_held(state: Condensed, loads: Loads) -> Response:
    """``equilibrium`` with the tool held."""
    load = condense_loads(state, loads)
    still = np.zeros((1, 6, loads.cases))
    if state.order.left:
        return recover_response(state, load, *saddle_held(state, load))
    return recover_response(state, load, {GROUND: still, END: still})
