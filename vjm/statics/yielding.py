"""Deflection of a mechanism under load: tool twist, energy shares and load curves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.errors import InputError, require
from stiffscope.vjm.kinematics.configurations import configure
from stiffscope.vjm.kinematics.datasets import Labelled, make_dataset
from stiffscope.vjm.model.checks import GROUND
from stiffscope.vjm.network.condensation import condense_network
from stiffscope.vjm.network.loading import Loads, Response
from stiffscope.vjm.network.network import END, FOOT, place_nodes
from stiffscope.vjm.network.order import find_order
from stiffscope.vjm.statics.equilibrium import (
    find_equilibrium,
    map_segments,
    tool_stiffness,
)
from stiffscope.vjm.statics.prestress import own_loads

if TYPE_CHECKING:
    from collections.abc import Sequence

    import xarray as xr
    from numpy.typing import ArrayLike

    from stiffscope.vjm.kinematics.configurations import Configurations, Poses
    from stiffscope.vjm.kinematics.datasets import Variables
    from stiffscope.vjm.model.mechanism import Mechanism
    from stiffscope.vjm.model.screws import Array

_LARGEST = 1e100  # N or N·m; its square is finite


@dataclass(frozen=True, eq=False, repr=False)
class Deflection(Labelled):
    """Tool ``twist`` (n, 6) at M, m, rad; ``energy`` (n,), J; each element's share (n,) of it."""

    twist: Array
    energy: Array
    shares: dict[str, Array]
    configurations: Configurations

    def to_xarray(self) -> xr.Dataset:
        """Return twist, strain energy and shares, labelled by pose, twist and element; SI."""
        variables: Variables = {
            "twist_at_M": (("pose", "twist"), self.twist, "m, rad"),
            "energy": (("pose",), self.energy, "J"),
            "share": (("element", "pose"), np.array(list(self.shares.values())), "1"),
        }
        return make_dataset(self.configurations, variables, element=list(self.shares))


@dataclass(frozen=True, eq=False)
class Load:
    """A dead load on a node, in base axes, N and N·m.

    ``wrench`` (6,) or (n, 6) at the point ``at`` (3,) of the body at home.
    """

    node: str
    wrench: Array
    at: Array


def respond(
    mechanism: Mechanism,
    poses: Poses,
    wrench: ArrayLike,
    *,
    loads: Sequence[Load] = (),
    gravity: float | ArrayLike = 0.0,
    misfit: float | ArrayLike = 0.0,
) -> Response:
    """Find the equilibrium under wrenches (6,), (6, c) or (n, 6, c) at M in base axes.

    Parameters
    ----------
    loads
        Dead loads on bodies, in every case.
    gravity, misfit
        Multiples of the mechanism's own weight, and of its offsets: one, or one for each case (c,).

    Raises
    ------
    InputError
        For a pose out of reach, a load on no body, and where the tool moves freely under its load.
    """
    configurations = configure(mechanism, poses).require_valid()
    applied = np.asarray(wrench, dtype=float)
    if applied.ndim < 3:
        applied = np.atleast_2d(applied.T).T[None]
    n, six, cases = applied.shape
    require(
        six == 6 and n in {1, len(configurations)} and np.isfinite(applied).all(),
        "wrench",
        f"finite (6,), (6, c) or ({len(configurations)}, 6, c)",
        f"shape {np.shape(wrench)}",
    )
    order = find_order(mechanism, configurations.linkage)
    where = place_nodes(configurations)
    weight, times = (
        np.broadcast_to(np.asarray(x, dtype=float), (cases,)) for x in (gravity, misfit)
    )
    weights = own_loads(order, where)
    nodes: dict[str, Array] = {
        k: w * weight for k, w in weights.nodes.items() if weight.any()
    }
    for load in loads:
        node = FOOT if load.node == GROUND else load.node
        require(
            node in where.rotation, "load", "a body or an end of one", f"{load.node!r}"
        )
        wrench = np.atleast_2d(np.asarray(load.wrench, dtype=float))[
            ..., None
        ] * np.ones(cases)
        carry = where.wrenches(node, np.asarray(load.at, dtype=float))
        nodes[node] = nodes.get(node, 0.0) + carry @ wrench
    nodes[END] = nodes.get(END, 0.0) + applied
    offsets: dict[str, Array] = {
        k: t * times for k, t in weights.offsets.items() if times.any()
    }
    out = find_equilibrium(order, where, Loads(cases, nodes, offsets))
    out.nodes[END] = np.array(
        np.broadcast_to(out.twist, (len(configurations), 6, cases))
    )
    return out


def deflection(mechanism: Mechanism, poses: Poses, wrench: ArrayLike) -> Deflection:
    """Return the deflection under a wrench (6,) or (n, 6), N, N·m, at M; energy shares sum to 1.

    Raises InputError for a pose out of reach, a wrench of another shape, or a tool that is free.

    Parameters
    ----------
    mechanism
        Bodies, joints, tool and gravity of the robot.
    poses
        Tool poses (n, k) in SI, or configurations at them.
    wrench
        Force and moment (6,) or (n, 6) at the tool point M, N and N·m.

    Returns
    -------
    Deflection
        Twist of the tool (n, 6) in m and rad, and each element's share of the strain energy.

    Examples
    --------
    >>> import stiffscope as ss
    >>> machine = ss.assemble(ss.load_robot("biglide"), "published")
    >>> found = ss.deflection(machine, [[0, 0, 0.34748]], [0, 0, -1000, 0, 0, 0])
    >>> (1e6 * found.twist[0, 2]).round(1)  # um
    np.float64(-80.7)
    """
    configurations = configure(mechanism, poses).require_valid()
    n = len(configurations)
    response = respond(mechanism, configurations, _check_wrench(wrench, n)[..., None])
    twist = response.twist[..., 0]
    stored = {
        name: np.broadcast_to(e[:, 0], (n,)) for name, e in response.energies.items()
    }
    energy = sum(stored.values(), np.zeros(n))
    whole = np.where(energy > 0.0, energy, 1.0)
    return Deflection(
        twist, energy, {name: e / whole for name, e in stored.items()}, configurations
    )


@dataclass(frozen=True, eq=False)
class LoadCurve:
    """``twist`` (n, 6, s) and tangent ``stiffness`` (n, 6, 6, s) at M under ``load`` × ``wrench``.

    The stiffness is NaN if infinite in some direction, and 0 if the tool moves freely.
    """

    wrench: Array
    load: Array
    twist: Array
    stiffness: Array


def find_load_curve(
    mechanism: Mechanism, poses: Poses, wrench: ArrayLike, load: ArrayLike
) -> LoadCurve:
    """Return deflection and tangent stiffness along a load path; no law has hysteresis.

    Parameters
    ----------
    mechanism, poses, wrench
        As for ``deflection``.
    load
        (s,) factors of the wrench.

    Raises
    ------
    InputError
        As ``deflection``.
    """
    configurations = configure(mechanism, poses).require_valid()
    n = len(configurations)
    times = np.asarray(load, dtype=float)
    order = find_order(mechanism, configurations.linkage)
    where = place_nodes(configurations)
    loads = Loads(len(times), {END: _check_wrench(wrench, n)[..., None] * times})
    twist = np.broadcast_to(
        find_equilibrium(order, where, loads).twist, (n, 6, len(times))
    )
    tangent = map_segments(
        order,
        where,
        loads,
        (6, 6),
        lambda some, there: tool_stiffness(condense_network(some, there)),
    )
    return LoadCurve(np.asarray(wrench, dtype=float), times, twist, tangent)


def _check_wrench(wrench: ArrayLike, n: int) -> Array:
    load = np.asarray(wrench, dtype=float)
    if load.shape not in ((6,), (n, 6)) or not (np.abs(load) < _LARGEST).all():
        expected = f"finite (6,) or ({n}, 6) forces and moments in N, N·m"
        raise InputError(f"wrench: expected {expected}, got {load.tolist()}")
    return np.broadcast_to(load, (n, 6))
