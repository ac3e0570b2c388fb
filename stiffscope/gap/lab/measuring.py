"""A campaign measured on the virtual machine: plan, nonlinear response, instrument, noise."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.gap.campaign import Campaign
from stiffscope.gap.lab.assembly import A_RANGE, carry, command, respond
from stiffscope.gap.quantities import DEFLECTION, DEVIATION, STIFFNESS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from stiffscope.gap.lab.assembly import Response
    from stiffscope.gap.lab.machine import Dimensions, Drive, Machine
    from stiffscope.gap.lab.structure import Array

    Codes = NDArray[np.int64]

FORCE, MOMENT = 500.0, 100.0  # N, N·m: what the loading device of the plan can apply

_NO_FORCE = 1e-6  # of the greatest force: what rounding leaves in a drive that carries nothing
_TIED = 10.0  # N/m: a drive whose lost motion meets less resistance than this moves freely


@dataclass(frozen=True)
class Plan:
    """What is read, in this order: all wrenches at a pose, its deviation, its stiffness; then the next pose."""

    poses: Array
    """(p, 3) m."""
    wrenches: Array
    """(m, 6) N, N·m, at M."""
    deviations: bool = True
    stiffness: bool = False
    directions: tuple[int, ...] = (0, 1, 2, 3, 4, 5)
    sessions: int = 1
    repeats: int = 1


@dataclass(frozen=True)
class Noise:
    """What the readings suffer; sigma in the file is its standard deviation unless `stated` says otherwise."""

    displacement: float = 1e-6
    """m."""
    rotation: float = 5e-6
    """rad."""
    stiffness: float = 0.01
    """Relative."""
    spread: float = 0.0
    """Unequal readings: ln-normal spread of their sigma."""
    outliers: float = 0.0
    """Share of gross outliers, 20 to 100 sigma."""
    missing: float = 0.0
    """Share of rows that are lost."""
    stated: float | None = 1.0
    """Factor on the sigma written in the file; None: sigma is not stated."""
    shuffle: bool = False


def workspace(dimensions: Dimensions, count: int, rng: np.random.Generator) -> Array:
    """Return poses (count, 3) spread over the reachable workspace, away from its rim."""
    trial = np.round(rng.uniform([-0.15, -0.25, 0.20], [0.15, 0.25, 0.52], (40 * count + 400, 3)), 4)
    a = command(dimensions, trial)[:, :2]
    inside = (a.min(axis=1) >= A_RANGE[0] + 0.01) & (a.max(axis=1) <= A_RANGE[1] - 0.01)
    return trial[inside][:count]


def default_plan(
    machine: Machine,
    rng: np.random.Generator,
    poses: int = 12,
    wrenches: int = 10,
    *,
    deviations: bool = True,
    stiffness: bool = False,
    sessions: int = 1,
) -> Plan:
    """Return a plan with poses all over the workspace and wrenches along each axis, then in random directions."""
    size = np.array([FORCE] * 3 + [MOMENT] * 3)
    single = np.diag(size)
    mixed = rng.uniform(-1, 1, (max(wrenches - 6, 0), 6)) * size
    loads = np.round(np.vstack([single, mixed])[:wrenches], 3)
    return Plan(workspace(machine.dimensions, poses, rng), loads, deviations, stiffness, sessions=sessions)


def _lost_motion(drive: Drive, force: Array) -> Array:
    """Return what a drive yields beyond its linear stiffness, without backlash, at a force (n,)."""
    linear = force / drive.stiffness
    out = np.zeros_like(force)
    if drive.hardening:
        e = linear.copy()
        for _ in range(50):
            e -= (drive.stiffness * e + drive.hardening * e**3 - force) / (drive.stiffness + 3 * drive.hardening * e**2)
        out += e - linear
    if drive.friction:
        out -= np.clip(force, -drive.friction, drive.friction) / drive.stiffness
    return out


def _settle(machine: Machine, pose: Codes, response: Response, force: Array, *, gaps: bool) -> Array:
    """Return the lost motion (n, 3) of the drives under forces (n, 3), in equilibrium with its own effect.

    With `gaps`, a drive with backlash stands at the end of its dead zone towards its force; where that would turn
    the force round, it hangs free inside the zone at the point of no force.
    """
    width = np.array([d.backlash for d in machine.drives]) if gaps else np.zeros(3)
    coupling = response.force_by_drive[pose]
    own = np.minimum(np.einsum("nkk->nk", coupling), 0.0)
    scale = max(1.0, float(np.abs(force).max())) if force.size else 1.0
    s = np.zeros_like(force)
    for _ in range(100):
        carried = force + np.einsum("nkl,nl->nk", coupling, s)
        carried[np.abs(carried) < _NO_FORCE * scale] = 0.0
        smooth = np.stack([_lost_motion(d, carried[:, k]) for k, d in enumerate(machine.drives)], axis=1)
        endless = np.where(carried == 0.0, 0.0, np.copysign(np.inf, carried))
        free = np.divide(carried, -own, out=endless, where=own < -_TIED)
        step = np.clip(s - smooth + free, -width, width)
        following = smooth + np.where(width > 0, step, 0.0)
        if np.allclose(following, s, rtol=0, atol=1e-15):
            break
        s = following
    return s


def _deflections(machine: Machine, response: Response, pose: Codes, stated: Array) -> Array:
    """Return true deflections (n, 6) under stated wrenches (n, 6): loaded minus unloaded."""
    tool = machine.instrument
    true = carry(tool.application, tool.force * stated)
    move = np.einsum("nij,nj->ni", response.compliance[pose], true)
    force = np.einsum("nkj,nj->nk", response.force[pose], true)
    if not any(d.backlash or d.hardening or d.friction for d in machine.drives):
        return move
    dead = response.dead_force[pose]
    loaded = _settle(machine, pose, response, force + dead, gaps=False)
    unloaded = _settle(machine, pose, response, dead, gaps=False)
    gap = _settle(machine, pose, response, force, gaps=True) - _settle(machine, pose, response, force, gaps=False)
    lost = loaded - unloaded + gap
    return move + np.einsum("nij,nj->ni", response.by_drive[pose], lost)


def _deviations(machine: Machine, response: Response) -> Array:
    """Return true deviations (p, 6) of the unloaded machine from its commands."""
    pose = np.arange(len(response.dead))
    lost = _settle(machine, pose, response, response.dead_force, gaps=True)
    return response.shift + response.dead + np.einsum("nij,nj->ni", response.by_drive, lost)


def _seen(machine: Machine) -> Array:
    """Return the matrix (6, 6) from a true displacement to what the instrument shows."""
    tool = machine.instrument
    x, y, z = tool.rotation
    turn = np.eye(3) + np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    both = np.zeros((6, 6))
    both[:3, :3] = both[3:, 3:] = turn
    return tool.scale * (np.eye(6) + tool.crosstalk) @ both


def _stiffnesses(machine: Machine, response: Response) -> Array:
    """Return the diagonals (p, 6) of stiffness as stated wrench over read displacement."""
    tool = machine.instrument
    at_m = tool.force * carry(tool.application, np.eye(6)).T
    shown = _seen(machine) @ response.compliance @ at_m
    return np.einsum("nii->ni", np.linalg.inv(shown))


@dataclass(frozen=True)
class _Rows:
    """Readings before noise, in the order in which they are taken."""

    pose: Codes
    wrench: Array
    quantity: Codes
    value: Array


def _take(machine: Machine, plan: Plan) -> _Rows:
    response = respond(machine, plan.poses)
    p, m = len(plan.poses), len(plan.wrenches)
    axes = np.array(plan.directions, dtype=np.int64)
    blocks: list[tuple[Codes, Array, Codes, Array]] = []

    def block(kind: int, pose: Codes, wrench: Array, shown: Array) -> None:
        count = len(axes)
        codes = np.tile(6 * kind + axes, len(pose))
        values = shown[:, axes].ravel()
        blocks.append((np.repeat(pose, count), np.repeat(wrench, count, axis=0), codes, values))

    if m:
        pose = np.repeat(np.arange(p), m)
        stated = np.tile(plan.wrenches, (p, 1))
        block(DEFLECTION, pose, stated, _deflections(machine, response, pose, stated) @ _seen(machine).T)
    if plan.deviations:
        shown = _deviations(machine, response) @ _seen(machine).T
        block(DEVIATION, np.arange(p), np.zeros((p, 6)), shown)
    if plan.stiffness:
        block(STIFFNESS, np.arange(p), np.full((p, 6), np.nan), _stiffnesses(machine, response))
    pose, wrench, codes, value = (np.concatenate(parts) for parts in zip(*blocks, strict=True))
    order = np.tile(np.argsort(pose, kind="stable"), plan.repeats)
    return _Rows(pose[order], wrench[order], codes[order], value[order])


def _through_time(machine: Machine, rows: _Rows, session: Codes) -> Array:
    """Return the values as an instrument shows them that changes while the campaign goes on."""
    tool = machine.instrument
    axis = rows.quantity % 6
    time = np.linspace(0.0, 1.0, len(rows.value))
    moving = rows.quantity // 6 != STIFFNESS
    gain = 1 + tool.gain_drift * time
    gain *= np.where(session == session.max(), 1 + tool.bad_session, 1.0)
    return np.where(moving, rows.value * gain + tool.drift[axis] * time, rows.value / gain)


def _sigma(rows: _Rows, noise: Noise, rng: np.random.Generator) -> Array:
    axis, kind = rows.quantity % 6, rows.quantity // 6
    sigma = np.where(axis < 3, noise.displacement, noise.rotation)
    sigma = np.where(kind == STIFFNESS, noise.stiffness * np.abs(rows.value), sigma)
    return sigma * np.exp(noise.spread * rng.standard_normal(len(sigma)))


def measure(
    machine: Machine,
    plan: Plan,
    noise: Noise,
    rng: np.random.Generator,
    *,
    modelled: Sequence[str] = ("gravity",),
    components: str = "published",
) -> Campaign:
    """Return the campaign that a lab would hand over for this machine.

    modelled and components go into its header: what the nominal model is said to carry.
    Raises InputError for poses that the machine cannot reach.
    """
    rows = _take(machine, plan)
    n = len(rows.value)
    session = (np.arange(n) * plan.sessions) // n
    sigma = _sigma(rows, noise, rng)
    value = _through_time(machine, rows, session) + sigma * rng.standard_normal(n)
    step = machine.instrument.quantum[rows.quantity % 6]
    coarse = (step > 0) & (rows.quantity // 6 != STIFFNESS)
    value = np.where(coarse, np.round(value / np.where(coarse, step, 1.0)) * step, value)
    wild = rng.random(n) < noise.outliers
    value = value + np.where(wild, sigma * rng.uniform(20, 100, n) * rng.choice([-1, 1], n), 0.0)
    stiff = rows.quantity // 6 == STIFFNESS
    value = np.where(stiff, np.maximum(np.abs(value), 1.0), value)
    kept = np.flatnonzero(rng.random(n) >= noise.missing)
    if noise.shuffle:
        kept = rng.permutation(kept)
    return _campaign(plan, rows, value, noise, sigma, session, kept, (tuple(modelled), components))


def _campaign(
    plan: Plan,
    rows: _Rows,
    value: Array,
    noise: Noise,
    sigma: Array,
    session: Codes,
    kept: Codes,
    header: tuple[tuple[str, ...], str],
) -> Campaign:
    stated = np.full(len(sigma), np.nan) if noise.stated is None else noise.stated * sigma
    names = tuple(f"({x:g}, {y:g}, {z:g})" for x, y, z in plan.poses)
    labels = tuple(f"day {k + 1}" for k in range(plan.sessions)) if plan.sessions > 1 else ("",)
    return Campaign(
        robot="biglide",
        modelled=header[0],
        components=header[1],
        pose_names=names,
        poses=plan.poses,
        pose=rows.pose[kept],
        wrench=rows.wrench[kept],
        quantity=rows.quantity[kept],
        value=value[kept],
        sigma=stated[kept],
        session_names=labels,
        session=session[kept],
        files=("readings.csv",),
        file=np.zeros(len(kept), dtype=np.int64),
        line=np.arange(2, len(kept) + 2),
    )
