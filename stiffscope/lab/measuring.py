"""Readings of the virtual machine: plan, nonlinear response, instrument, noise and campaign."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import partial
from itertools import product
from typing import TYPE_CHECKING, Any, Literal, Protocol

import numpy as np

from stiffscope.gap.campaign.quantities import KINDS, WRENCH
from stiffscope.gap.campaign.writing import (
    describe_sensor,
    number_cells,
    write_campaign,
)
from stiffscope.lab.closure import COORDINATES, locate
from stiffscope.lab.machine import GROUND, TOOL
from stiffscope.lab.nonlinear import settle
from stiffscope.lab.response import Response, Spot, respond, tool_spot
from stiffscope.lab.rotations import lever, skew

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from stiffscope.lab.closure import Located
    from stiffscope.lab.machine import Instrument, Machine
    from stiffscope.lab.rotations import Array

    Codes = NDArray[np.int64]
    Measures = Literal["displacement", "rotation"]
    Mechanics = Literal["own", "exudyn"]

MEASURES: tuple[Measures, ...] = ("displacement", "rotation")


@dataclass(frozen=True)
class Sensor:
    """A sensor at a point (3,) of a node, home coordinates, with its direction in base axes."""

    name: str
    measures: Measures
    node: str
    at: Array
    direction: Array
    against: str = GROUND


@dataclass(frozen=True)
class Plan:
    """Readings in order: all loads at a pose, its deviation, its stiffness; then the next pose."""

    poses: Array
    """Commanded poses (p, k), m and rad."""
    loads: tuple[tuple[str, Array], ...]
    """Point of each load, a name of `hooks` or "" for M, and its wrench (6,), N and N·m."""
    hooks: Mapping[str, Spot] = field(default_factory=dict[str, Spot])
    sensors: tuple[Sensor, ...] = ()
    """Sensors to read; if empty, the tool's pose at M is read."""
    deviations: bool = True
    stiffness: Literal["", "k", "p"] = ""
    """Read diagonals of the stiffness matrix at M ("k") or pushes ("p")."""
    sessions: int = 1
    frame: tuple[Array, Array] | None = None
    """Axes (3, 3) as columns and origin (3,), in {O}, of an instrument that reads positions.

    Its sensors are x, y and z of each target in turn, displacements along the base's axes.
    """

    def channels(self, machine: Machine) -> tuple[Sensor, ...]:
        """Return the sensors, or those equivalent to the tool's pose."""
        if self.sensors:
            return self.sensors
        axes = dict(zip("xyz", np.eye(3), strict=True))
        move, turn = (
            partial(Sensor, measures=what, node=TOOL, at=tool_spot(machine).at)
            for what in MEASURES
        )
        return tuple(
            (turn if n[0] == "r" else move)(n, direction=axes[n[-1]])
            for n in COORDINATES
        )


@dataclass(frozen=True)
class Noise:
    """Noise of readings; sigma in the file is its standard deviation unless `stated` differs."""

    displacement: float = 1e-6
    """Standard deviation of displacements, m."""
    rotation: float = 5e-6
    """Standard deviation of rotations, rad."""
    stiffness: float = 0.01
    """Relative standard deviation of stiffnesses."""
    spread: float = 0.0
    """Log-normal spread of the sigma of readings."""
    outliers: float = 0.0
    """Fraction of gross outliers, 20 to 100 sigma."""
    missing: float = 0.0
    """Fraction of missing rows."""
    stated: float | None = 1.0
    """Factor on the sigma stated in the file; None if sigma is not stated."""
    shuffle: bool = False


@dataclass(frozen=True)
class Readings:
    """Recorded readings (n,) of a plan."""

    plan: Plan
    channels: tuple[Sensor, ...]
    pose: Codes
    load: Codes
    """Index into the plan's loads; -1 for none."""
    kind: Codes
    """Index into `RECORDED`."""
    channel: Codes
    value: Array
    sigma: Array
    """Stated standard deviation; NaN if not stated."""
    session: Codes

    def some(self, rows: Codes) -> Readings:
        """Return the selected readings, in the given order."""
        names = ("pose", "load", "kind", "channel", "value", "sigma", "session")
        return replace(self, **{name: getattr(self, name)[rows] for name in names})

    @property
    def turns(self) -> Codes:
        """1 for readings (n,) of rotations, else 0."""
        each = np.array(
            [sensor.measures == "rotation" for sensor in self.channels], dtype=np.int64
        )
        return each[self.channel]

    def shows(self, place: str) -> NDArray[np.bool_]:
        """Return flags (n,) of a channel's readings; of "instrument" all that are displayed."""
        named = np.array(
            [place in {"instrument", sensor.name} for sensor in self.channels]
        )
        return named[self.channel] & self.is_displayed

    @property
    def is_displayed(self) -> NDArray[np.bool_]:
        """Flags (n,) of readings that a display shows, with its drift, steps and digits."""
        return np.array([each.is_displayed for each in RECORDED])[self.kind]


def true_readings(
    machine: Machine,
    plan: Plan,
    located: Located | None = None,
    mechanics: Mechanics = "own",
) -> Readings:
    """Return the noise-free readings of a machine.

    Those of positions are displacements from the drawn positions, loaded or not; see `measure`.
    Raises InputError for poses that the machine cannot reach.

    Parameters
    ----------
    machine
        The real machine, with its faults.
    plan
        Poses, loads and instruments.
    located
        Configuration of the machine at the plan's poses, if already known.
    mechanics
        Of this laboratory, or of EXUDYN.
    """
    channels = plan.channels(machine)
    found = locate(machine, plan.poses) if located is None else located
    open_bench = _open_exudyn if mechanics == "exudyn" else _open_linear
    bench = open_bench(machine, plan, found, channels)
    p = len(plan.poses)
    c = len(channels)
    planned = [k for k, each in enumerate(RECORDED) if each.is_planned(plan)]
    blocks = [(k, RECORDED[k].measure(bench)) for k in planned]
    keys: list[Codes] = []
    names = [sensor.name for sensor in channels]
    order = _swap_channels(machine.instrument, names)
    blocks = [(k, shown[:, :, order] if k < 2 else shown) for k, shown in blocks]
    for kind, shown in blocks:  # (p, loads, channels)
        loads = range(shown.shape[1]) if RECORDED[kind].is_loaded else (-1,)
        every = [*product(range(p), loads, (kind,), range(c))]
        keys.append(np.array(every, dtype=np.int64).reshape(-1, 4).T)
    value = np.concatenate([shown.ravel() for _, shown in blocks])
    pose, load, kinds, channel = np.concatenate(keys, axis=1)
    order = np.argsort(pose, kind="stable")
    session = (np.arange(len(order)) * plan.sessions) // len(order)
    unknown = np.full(len(value), np.nan)
    codes = (pose, load, kinds, channel, value, unknown)
    rows = Readings(plan, channels, *codes, np.zeros_like(pose)).some(order)
    rows = replace(rows, session=session)
    value = _drift(machine.instrument, rows)
    for name, (
        line,
        jump,
    ) in machine.instrument.steps.items():  # the first readings are on line 2
        value = value + jump * (rows.shows(name) & (np.arange(len(value)) + 2 >= line))
    return replace(rows, value=_find_factors(machine.instrument, rows) * value)


def _swap_channels(instrument: Instrument, names: Sequence[str]) -> list[int]:
    """Return the channels (c,) whose numbers stand in the place of each."""
    order = list(range(len(names)))
    for first, second in instrument.swaps:
        if first in names and second in names:
            i = names.index(first)
            j = names.index(second)
            order[i], order[j] = order[j], order[i]
    return order


def _gains(machine: Machine, response: Response, channels: tuple[Sensor, ...]) -> Array:
    """Return the readings (n, c, cases) of each channel for the response's cases."""
    rows: list[Array] = []
    for sensor in channels:
        there = lever(response.true.point(sensor.node, sensor.at))
        relative = there @ (
            response.twists[sensor.node] - response.twists[sensor.against]
        )
        rows.append(read_channel(machine.instrument, sensor, relative))
    return make_mixing(machine.instrument, channels) @ np.stack(rows, axis=1)


def read_channel(instrument: Instrument, sensor: Sensor, twist: Array) -> Array:
    """Return the readings (n, …) of a sensor for twists (n, 6, …) at its point."""
    part = twist[:, :3] if sensor.measures == "displacement" else twist[:, 3:]
    along = sensor.direction
    for place in ("instrument", sensor.name):
        turned = np.eye(3) + skew(instrument.rotations.get(place, np.zeros(3)))
        along = instrument.scales.get(place, 1.0) * along @ turned
    return np.einsum("i,ni...->n...", along, part)


def make_mixing(instrument: Instrument, channels: tuple[Sensor, ...]) -> Array:
    """Return the cross-talk matrix (c, c) of the channels."""
    names = [sensor.name for sensor in channels]
    out = np.eye(len(names))
    for source, sink, share in instrument.crosstalk:
        if source in names and sink in names:
            out[names.index(sink), names.index(source)] += share
    return out


def true_wrench(instrument: Instrument, stated: Array) -> Array:
    """Return the true wrench (…, 6) at the stated point for a stated wrench."""
    out: Array = instrument.force * stated
    for first, second in instrument.swaps:
        if first in WRENCH:
            columns = [WRENCH.index(first), WRENCH.index(second)]
            out[..., columns] = out[..., columns[::-1]]
    size = np.linalg.norm(stated[..., :3], axis=-1, keepdims=True)
    for value, factor in instrument.weights.items():
        out = np.where(np.isclose(size, float(value.split()[0])), factor * out, out)
    mixing = np.linalg.inv(np.eye(3) + instrument.leak)
    out = np.concatenate([out[..., :3] @ mixing.T, out[..., 3:]], axis=-1)
    moment = np.cross(instrument.application, out[..., :3])
    return np.concatenate([out[..., :3], out[..., 3:] + moment], axis=-1)


def _apply(
    machine: Machine,
    plan: Plan,
    loads: Sequence[tuple[str, Array]],
    shape: tuple[int, int],
) -> Array:
    """Return the cases (p, m, cases) of true wrenches; shape: poses and cases."""
    first = {name: 6 * (k + 1) for k, name in enumerate(plan.hooks)} | {"": 0}
    cases = np.zeros((shape[0], len(loads), shape[1]))
    for k, (name, wrench) in enumerate(loads):
        cases[:, k, first[name] : first[name] + 6] = true_wrench(
            machine.instrument, wrench
        )
    return cases


def _settle_slots(
    machine: Machine, response: Response, force: Array, *, gaps: bool, held: bool = True
) -> Array:
    """Return the lost motion (p, m, slots) at slot forces (p, m, slots); see `settle`.

    held: whether friction holds; it does not hold the weight of a robot at rest.
    """
    p, m, s = force.shape
    own = response.force[:, None, :, response.dead + 1 :]
    coupling = np.broadcast_to(own, (p, m, s, s)).reshape(p * m, s, s)
    slots = [
        replace(slot, size=0.0) if slot.law == "friction" and not held else slot
        for slot in machine.slots
    ]
    lost = settle(slots, coupling, force.reshape(p * m, s), gaps=gaps)
    return lost.reshape(p, m, s)


def _deflections(
    machine: Machine,
    plan: Plan,
    response: Response,
    seen: Array,
    loads: Sequence[tuple[str, Array]],
) -> Array:
    """Return deflections (p, m, c): loaded minus unloaded."""
    cases = _apply(machine, plan, loads, seen.shape[::2])
    if machine.slots:
        force = np.einsum("nsc,nmc->nms", response.force, cases)
        dead = np.broadcast_to(response.force[:, None, :, response.dead], force.shape)
        lost = partial(_settle_slots, machine, response)
        smooth = lost(force + dead, gaps=False) - lost(dead, gaps=False)
        gap = lost(force, gaps=True) - lost(force, gaps=False)
        cases[:, :, response.dead + 1 :] = smooth + gap
    return np.einsum("nkc,nmc->nmk", seen, cases)


def _displacements(
    machine: Machine,
    plan: Plan,
    response: Response,
    channels: tuple[Sensor, ...],
    seen: Array,
    loads: Sequence[tuple[str, Array]],
) -> Array:
    """Return displacements (p, m, c) of the machine under loads from where it is commanded."""
    cases = _apply(machine, plan, loads, seen.shape[::2])
    cases[:, :, response.dead] = 1.0
    force = np.einsum("nsc,nmc->nms", response.force, cases)
    cases[:, :, response.dead + 1 :] = _settle_slots(
        machine, response, force, gaps=True, held=False
    )
    rigid: list[Array] = []
    for s in channels:
        moved = response.shift(Spot(s.node, s.at)) - response.shift(
            Spot(s.node, s.at), s.against
        )
        if not plan.sensors:
            turned = response.nominal.rotation[TOOL]
            moved = moved + (machine.shift.reshape(2, 3) @ turned.mT).reshape(-1, 6)
        rigid.append(read_channel(machine.instrument, s, moved))
    shift = np.stack(rigid, axis=1) @ make_mixing(machine.instrument, channels).T
    return shift[:, None] + np.einsum("nkc,nmc->nmk", seen, cases)


def find_stiffness(machine: Machine, plan: Plan, seen: Array) -> Array:
    """Return stiffness diagonals or pushes (p, 6): stated wrench over measured displacement."""
    shown = seen[:, :, :6] @ true_wrench(machine.instrument, np.eye(6)).T
    if plan.stiffness == "p":
        return 1.0 / np.einsum("nii->ni", shown)
    return np.einsum("nii->ni", np.linalg.inv(shown))


class Bench(Protocol):
    """A machine at the poses of a plan, as some mechanics has it."""

    @property
    def plan(self) -> Plan:
        """Poses, loads and instruments."""
        ...

    def deflect(self, loads: Sequence[tuple[str, Array]]) -> Array:
        """Return deflections (p, m, c) under loads: loaded minus unloaded."""
        ...

    def displace(self, loads: Sequence[tuple[str, Array]]) -> Array:
        """Return displacements (p, m, c) under loads from where the machine is commanded."""
        ...

    def stiffness(self) -> Array:
        """Return stiffness diagonals or pushes (p, 6) at M."""
        ...


@dataclass(frozen=True)
class LinearBench:
    """A machine with its linear response at the poses of a plan."""

    machine: Machine
    plan: Plan
    response: Response
    channels: tuple[Sensor, ...]
    seen: Array
    """Readings (p, c, cases) of each channel for the response's cases."""

    def deflect(self, loads: Sequence[tuple[str, Array]]) -> Array:
        """Return deflections (p, m, c) under loads: loaded minus unloaded."""
        return _deflections(self.machine, self.plan, self.response, self.seen, loads)

    def displace(self, loads: Sequence[tuple[str, Array]]) -> Array:
        """Return displacements (p, m, c) under loads from where the machine is commanded."""
        where = self.machine, self.plan, self.response
        return _displacements(*where, self.channels, self.seen, loads)

    def stiffness(self) -> Array:
        """Return stiffness diagonals or pushes (p, 6) at M."""
        return find_stiffness(self.machine, self.plan, self.seen)


def _open_linear(
    machine: Machine, plan: Plan, located: Located, channels: tuple[Sensor, ...]
) -> Bench:
    spots = [tool_spot(machine), *plan.hooks.values()]
    response = respond(machine, located, spots)
    seen = _gains(machine, response, channels)
    return LinearBench(machine, plan, response, channels, seen)


def _open_exudyn(
    machine: Machine, plan: Plan, located: Located, channels: tuple[Sensor, ...]
) -> Bench:
    from stiffscope.lab.exudyn_bench import ExudynBench

    return ExudynBench(machine, plan, located, channels)


@dataclass(frozen=True, kw_only=True)
class Recorded:
    """What the laboratory records of a kind of readings. No fact has a default."""

    name: str
    letter: Callable[[Plan], str]
    """First letter of its quantities at M."""
    is_planned: Callable[[Plan], bool]
    measure: Callable[[Bench], Array]
    """Function that returns the noise-free readings (p, m, c) under m loads."""
    is_loaded: bool
    """Whether it is read under each load of the plan; else once a pose."""
    wrench: float
    """Wrench components in the table where it is not read under loads."""
    is_displayed: bool
    """Whether a display shows it, with its drift, steps and digits."""
    gain_sign: float
    """Exponent, 1 or -1, with which it follows the gain of its instrument."""
    is_positive: bool
    scatter: Callable[[Noise, Array, Array], Array]
    """Standard deviations (n,) by noise, values (n,) and those of displacements (n,)."""


def _measure_under_loads(bench: Bench) -> Array:
    if bench.plan.frame:
        return bench.displace(bench.plan.loads)
    return bench.deflect(bench.plan.loads)


DEFLECTED = Recorded(
    name="deflection",
    letter=lambda _: "d",
    is_planned=lambda plan: bool(plan.loads),
    measure=_measure_under_loads,
    is_loaded=True,
    wrench=np.nan,
    is_displayed=True,
    gain_sign=1.0,
    is_positive=False,
    scatter=lambda _noise, _value, usual: usual,
)
DEVIATED = Recorded(
    name="deviation",
    letter=lambda _: "e",
    is_planned=lambda plan: plan.deviations,
    measure=lambda bench: bench.displace([("", np.zeros(6))]),
    is_loaded=False,
    wrench=0.0,
    is_displayed=True,
    gain_sign=1.0,
    is_positive=False,
    scatter=lambda _noise, _value, usual: usual,
)
STIFF = Recorded(
    name="stiffness",
    letter=lambda plan: plan.stiffness,
    is_planned=lambda plan: plan.stiffness != "",
    measure=lambda bench: bench.stiffness()[:, None],
    is_loaded=False,
    wrench=np.nan,
    is_displayed=False,
    gain_sign=-1.0,
    is_positive=True,
    scatter=lambda noise, value, _usual: noise.stiffness * np.abs(value),
)

RECORDS: dict[str, tuple[Recorded, ...]] = {
    "deflection": (DEFLECTED,),
    "deviation": (DEVIATED,),
    "stiffness": (STIFF,),
    "push": (STIFF,),  # as the plan says
    "frequency": (),  # no modal test is simulated
    "response": (),  # the same
    "position": (DEFLECTED, DEVIATED),  # displacements, until `measure` adds places
}
"""What the laboratory records for each kind of a campaign; none if it does not measure it."""
if set(RECORDS) != set(KINDS):
    unsaid = ", ".join(sorted(set(RECORDS) ^ set(KINDS)))
    raise TypeError(f"the laboratory does not say how it measures kinds: {unsaid}")
RECORDED = tuple(dict.fromkeys(each for own in RECORDS.values() for each in own))


def _drift(instrument: Instrument, rows: Readings) -> Array:
    """Return the values (n,) read with an instrument that drifts during the campaign."""
    time = np.linspace(0.0, 1.0, len(rows.value))
    last = rows.session == rows.session.max()
    gain = (1 + instrument.gain_drift * time) * np.where(
        last, 1 + instrument.bad_session, 1.0
    )
    drift = np.array(instrument.drift)[rows.turns]
    sign = np.array([each.gain_sign for each in RECORDED])[rows.kind]
    # a product and a quotient, since a power rounds
    seen = np.where(sign < 0, rows.value / gain, rows.value * gain)
    return np.where(rows.is_displayed, seen + drift * time, seen)


def _find_factors(instrument: Instrument, rows: Readings) -> Array:
    """Return the factors (n,) on the recorded numbers."""
    out = np.ones(len(rows.value))
    for name, factor in instrument.factors.items():
        out = np.where(rows.shows(name), factor * out, out)
    return out


def sigma_of(rows: Readings, noise: Noise) -> Array:
    """Return the standard deviations (n,) of the readings."""
    sigma = np.array([noise.displacement, noise.rotation])[rows.turns]
    for k, each in enumerate(RECORDED):
        sigma = np.where(rows.kind == k, each.scatter(noise, rows.value, sigma), sigma)
    return sigma


def measure(
    machine: Machine,
    plan: Plan,
    noise: Noise,
    rng: np.random.Generator,
    located: Located | None = None,
    mechanics: Mechanics = "own",
) -> Readings:
    """Return the readings of a machine, with noise, as a lab would deliver them.

    Raises InputError for poses that the machine cannot reach.

    Parameters
    ----------
    machine, plan, located, mechanics
        As for `true_readings`.
    noise
        Noise of each kind of reading.
    rng
        Random generator of the noise.
    """
    rows = true_readings(machine, plan, located, mechanics)
    instrument = machine.instrument
    n = len(rows.value)
    sigma = sigma_of(rows, noise) * np.abs(_find_factors(instrument, rows))
    sigma = sigma * np.exp(noise.spread * rng.standard_normal(n))
    value = rows.value + sigma * rng.standard_normal(n)
    step = np.array(instrument.quantum)[rows.turns]
    coarse = (step > 0) & rows.is_displayed
    value = np.where(
        coarse, np.round(value / np.where(coarse, step, 1.0)) * step, value
    )
    wild = rng.random(n) < noise.outliers
    value = value + np.where(
        wild, sigma * rng.uniform(20, 100, n) * rng.choice([-1, 1], n), 0.0
    )
    positive = np.array([each.is_positive for each in RECORDED])[rows.kind]
    value = np.where(positive, np.maximum(np.abs(value), 1.0), value)
    if plan.frame is not None:  # rows: x, y, z of each target
        axes, origin = plan.frame
        at = drawn_targets(machine, plan, located)[
            rows.pose[::3], rows.channel[::3] // 3
        ]
        value = ((at + value.reshape(-1, 3) - origin) @ axes).ravel()
    stated = np.full(n, np.nan) if noise.stated is None else noise.stated * sigma
    kept = np.flatnonzero(rng.random(n) >= noise.missing)
    if noise.shuffle:
        kept = rng.permutation(kept)
    return replace(rows, value=value, sigma=stated).some(kept)


def drawn_targets(machine: Machine, plan: Plan, located: Located | None) -> Array:
    """Return the drawn positions (p, t, 3) of a plan's targets."""
    frames = (located or locate(machine, plan.poses)).frames
    targets = plan.sensors[::3]
    return np.stack(
        [frames.point(machine.carrier(s.node), s.at) for s in targets], axis=1
    )


def write_readings(
    readings: Readings,
    folder: Path,
    *,
    robot: str,
    pose: Sequence[str],
    modelled: Sequence[str] = ("gravity",),
    components: str = "published",
) -> None:
    """Write a campaign folder.

    Parameters
    ----------
    readings
        The readings with their plan.
    folder
        Created if absent.
    robot, modelled, components
        Header fields: nominal robot, effects included in its model, source of its parts' matrices.
    pose
        Names of the pose columns.
    """
    plan = readings.plan
    header: dict[str, Any] = {
        "robot": robot,
        "modelled": list(modelled),
        "components": components,
    }
    if plan.frame is None:
        header["sensors"] = {
            s.name: describe_sensor(
                s.measures, s.node, s.at, s.direction, against=s.against
            )
            for s in plan.sensors
        }
    else:
        header["frames"] = {"tracker": {"pose": "unknown"}}
        seen = {"measures": "position", "frame": "tracker"}
        targets = {
            s.name.partition(".")[0]: {"body": s.node, "at": s.at.tolist()}
            for s in plan.sensors
        }
        header["sensors"] = {name: {**seen, **where} for name, where in targets.items()}
    hooks = plan.hooks.items()
    header["loads"] = {
        name: {"body": spot.node, "at": spot.at.tolist()} for name, spot in hooks
    }
    columns = {
        name: number_cells(plan.poses[readings.pose, k]) for k, name in enumerate(pose)
    }
    if plan.hooks:
        columns["load"] = [
            plan.loads[k][0] if k >= 0 else "" for k in readings.load.tolist()
        ]
    wrench = np.full((len(readings.value), 6), np.nan)
    for k, (_, stated) in enumerate(plan.loads):
        wrench[readings.load == k] = stated
    for k, each in enumerate(RECORDED):
        if not each.is_loaded:
            wrench[readings.kind == k] = each.wrench
    columns |= {name: number_cells(wrench[:, k]) for k, name in enumerate(WRENCH)}
    names = [sensor.name for sensor in readings.channels]
    if plan.sensors:
        columns["sensor"] = [names[k] for k in readings.channel.tolist()]
        if plan.frame is None:
            kinds: list[int] = readings.kind.tolist()
            columns["kind"] = [RECORDED[k].name for k in kinds]
    else:
        letters = [each.letter(plan) for each in RECORDED]
        codes = zip(readings.kind.tolist(), readings.channel.tolist(), strict=True)
        columns["quantity"] = [
            letters[kind] + names[channel] for kind, channel in codes
        ]
    columns |= {
        "value": number_cells(readings.value),
        "sigma": number_cells(readings.sigma),
    }
    if plan.sessions > 1:
        columns["session"] = [f"day {k + 1}" for k in readings.session.tolist()]
    write_campaign(folder, header, columns)
