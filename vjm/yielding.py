"""How a mechanism yields under a load: the tool's twist, who contributes how much, and backlash in the drives."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.errors import InputError
from stiffscope.vjm.equilibrium import solve_loads
from stiffscope.vjm.kinematics import Configurations, configure
from stiffscope.vjm.loading import Loads
from stiffscope.vjm.network import END, place_nodes
from stiffscope.vjm.order import find_order

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import ArrayLike

    from stiffscope.vjm.joints import Joint
    from stiffscope.vjm.mechanism import Mechanism
    from stiffscope.vjm.screws import Array

_STEPS = 100
_SETTLED = 1e-12  # of a gap, or of the largest force
_ALONE = 1e-12  # of a drive's stiffness, below which what others hold against its shift is rounding
_LARGEST = 1e100  # N or N·m; its square is still a number


@dataclass(frozen=True, eq=False)
class Deflection:
    """``twist`` (n, 6) of the tool at M in m, rad; ``energy`` (n,) in J; each element's share (n,) of it."""

    twist: Array
    energy: Array
    shares: dict[str, Array]


def deflection(mechanism: Mechanism, poses: ArrayLike | Configurations, wrench: ArrayLike) -> Deflection:
    """Deflection under a wrench (6,) or (n, 6) in N, N·m at M. The shares of strain energy sum to 1 at every pose.

    Raises InputError for a pose out of reach, a wrench of another shape, or a tool that moves freely.
    """
    found = _find(mechanism, poses)
    load = _check_wrench(wrench, len(found))
    order = find_order(mechanism, found.linkage)
    response = solve_loads(order, place_nodes(found), Loads(1, {END: load[..., None]}))
    twist = np.broadcast_to(response.twist[..., 0], (len(found), 6))
    energy = 0.5 * np.einsum("ni,ni->n", load, twist)
    shares: dict[str, Array] = {
        name: np.broadcast_to(each[:, 0], (len(found),)) / np.where(energy > 0.0, energy, 1.0)
        for name, each in response.energies.items()
    }
    return Deflection(twist, energy, shares)


def deflection_with_backlash(
    mechanism: Mechanism, poses: ArrayLike | Configurations, wrench: ArrayLike, gaps: Mapping[str, float]
) -> Array:
    """Twist (n, 6) at M under a wrench (6,) or (n, 6), with dead zones in drives, from the middle of each gap.

    ``gaps`` gives half-widths in m or rad by driven joint. A drive shifts by the half-width towards the force it
    carries; where the others would take its force off it before that, it hangs free inside its gap. Raises as
    ``deflection``, and for a name that is no drive's.
    """
    found = _find(mechanism, poses)
    n = len(found)
    load = _check_wrench(wrench, n)
    drives = [_drive(mechanism, name) for name in gaps]
    half = np.array([gaps[j.name] for j in drives], dtype=float)
    if not ((half >= 0.0) & np.isfinite(half)).all():
        raise InputError(f"backlash: expected half-widths of at least 0, got {dict(gaps)}")
    cases = 1 + len(drives)
    applied = np.zeros((n, 6, cases))
    applied[..., 0] = load
    loads = Loads(cases)
    along = {j.name: 3 if j.kind == "revolute" else 0 for j in drives}
    for k, j in enumerate(drives):
        shift = np.zeros((1, 6, cases))
        shift[0, along[j.name], k + 1] = 1.0
        loads.offsets[j.name] = shift
    loads.nodes[END] = applied
    state = solve_loads(find_order(mechanism, found.linkage), place_nodes(found), loads)
    twist = np.broadcast_to(state.twist, (n, 6, cases))
    if not drives:
        return twist[..., 0]
    forces = np.stack(
        [np.broadcast_to(state.elements[j.name].wrench[:, along[j.name]], (n, cases)) for j in drives], axis=1
    )
    stiff = np.array([1.0 / _find_drive_compliance(j, along[j.name]) for j in drives])
    shift = _settle(forces[..., 0], forces[..., 1:], half, stiff)
    return twist[..., 0] + np.einsum("nij,nj->ni", twist[..., 1:], shift)


def _find(mechanism: Mechanism, poses: ArrayLike | Configurations) -> Configurations:
    return (poses if isinstance(poses, Configurations) else configure(mechanism, poses)).require_valid()


def _check_wrench(wrench: ArrayLike, n: int) -> Array:
    load = np.asarray(wrench, dtype=float)
    if load.shape not in ((6,), (n, 6)) or not (np.abs(load) < _LARGEST).all():
        raise InputError(f"wrench: expected finite (6,) or ({n}, 6) forces and moments in N, N·m, got {load.tolist()}")
    return np.broadcast_to(load, (n, 6))


def _drive(mechanism: Mechanism, name: str) -> Joint:
    drives = {j.name: j for j in mechanism.drives}
    if name not in drives:
        raise InputError(f"backlash: expected a drive, one of {', '.join(drives) or 'none'}, got {name!r}")
    return drives[name]


def _find_drive_compliance(joint: Joint, component: int) -> float:
    """Compliance of a driven joint along its drive."""
    bearing = 0.0 if joint.compliance is None else float(joint.compliance[component, component])
    return bearing + (1.0 / joint.drive.stiffness if joint.drive is not None else 0.0)


def _settle(force: Array, influence: Array, half: Array, stiffness: Array) -> Array:
    """Shifts (n, k) with ``|s| ≤ half`` that stand at the end of the gap towards the force left, or leave none.

    The box-constrained minimum of ``½ sᵀ(-H)s - fᵀs`` by active sets, in units of the gaps; H is negative semidefinite,
    and where it is rounding beside the drives' ``stiffness`` (k,) nobody takes a drive's force off it.
    """
    pull, back = force * half, -0.5 * (influence + np.swapaxes(influence, -1, -2)) * np.outer(half, half)
    least = np.where(half > 0.0, _ALONE * stiffness * half**2, 1.0)
    shift: Array = np.zeros_like(pull)
    side: Array = np.zeros_like(pull)  # the end of the gap that a drive is held at
    for _ in range(_STEPS + 10 * len(half)):
        left = pull - np.einsum("nij,nj->ni", back, shift)
        free = side == 0.0
        among: Array = np.eye(len(half)) * np.where(free, least, 1.0)[:, None, :]
        among = among + back * (free[:, :, None] & free[:, None, :])
        step = np.einsum("nij,nj->ni", np.linalg.inv(among), left * free)
        room = np.divide(np.sign(step) - shift, step, out=np.full_like(step, np.inf), where=step != 0.0)
        reach = room.min(axis=1, keepdims=True, initial=1.0)
        at_end = room <= reach
        side = np.where(at_end, np.sign(step), side)
        shift = np.where(at_end, side, shift + reach * step)
        still = ~at_end.any(axis=1) & (np.abs(step) < _SETTLED).all(axis=1)
        inward = left * side
        worst = inward.argmin(axis=1)
        freed = still & (inward.min(axis=1) < -_SETTLED * np.abs(pull).max(axis=1))
        if (still & ~freed).all():
            return shift * half
        side[freed, worst[freed]] = 0.0
    msg = "backlash: no equilibrium of the drives was found within their gaps"
    raise InputError(msg)
