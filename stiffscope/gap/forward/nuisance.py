"""Nuisance patterns: unnamed faults. If one fits best, no known effect explains the gap.

They prevent confident wrong diagnoses and describe what the readings look like.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from itertools import repeat
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.gap.campaign.quantities import AXES
from stiffscope.gap.effects.effect import FREE, UNNAMED, Candidate
from stiffscope.gap.effects.elements import ElementEffect, along_drive
from stiffscope.gap.forward.robot_prediction import Gain, Pattern
from stiffscope.vjm.model.mechanism import Change

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from stiffscope.gap.effects.effect import Changes
    from stiffscope.gap.forward.robot_at_poses import RobotAtPoses
    from stiffscope.gap.forward.robot_readings import RobotReadings
    from stiffscope.runtime.types import Array, Indices
    from stiffscope.vjm.model.joints import Joint


_SPRING = 1e6  # N/m: spring to the frame per unit parameter
_LIKE_FORCE = (
    100.0  # N or N·m: joint load at which parameters equal deformations, m or rad
)
_MOST_SESSIONS = 6
_MOST_CROSSED = 12  # most instruments and directions


def nuisance_patterns(nominal: RobotReadings) -> tuple[Candidate, ...]:
    """Return unnamed faults of parts, surroundings, joints and instruments."""
    at = nominal.at
    swarm = (
        replace(p, swarming=True) for p in (*_play_of(at), *_stiffening_of(nominal))
    )
    return (*_parts(at), *_readings(at), *_crossings(at), *_sizes(at), *swarm)


def _parts(at: RobotAtPoses) -> Iterator[Candidate]:
    """Bodies that are bowed."""
    nominal = at.robot
    soft = {name for name in nominal.links if nominal.compliances[name].any()}
    for part in nominal.robot.parts:
        bodies = nominal.robot.bodies_of(part)
        for names in (bodies, *((name,) for name in bodies if len(bodies) > 1)):
            if names and soft.issuperset(names):
                lengths = {name: nominal.length(name) for name in names}
                place = (
                    f"bowed bodies, {part}"
                    if len(names) > 1
                    else f"a bowed body, {', '.join(names)}"
                )
                yield _make_unnamed(
                    place, (1e-4,), ElementEffect(partial(_bow, lengths)), "bowed"
                )


def _readings(at: RobotAtPoses) -> Iterator[Candidate]:
    """Yield faults of instruments, loads, drives and surroundings visible in displacements."""
    drives = list(at.robot.driven)
    c = at.campaign
    read = np.unique(c.channel[c.is_displacement])
    sessions = len(c.session_names)
    channels = len(read)
    middle = at.configurations.tool[:, :3].mean(axis=0)
    apart = partial(_by_channel, read)
    yield _make_unnamed(
        "a drift of the gain in time", (0.05,), Gain(lambda p: _time(p)[:, None])
    )
    if not channels:
        return
    drift = Pattern(lambda p: _time(p)[:, None] * apart(p))
    yield _make_unnamed(
        "a drift of the readings in time", tuple(repeat(5e-6, channels)), drift
    )
    yield _make_unnamed(
        "a gain of its own in every direction",
        tuple(repeat(0.05, channels)),
        Gain(apart),
    )
    if sessions > 1 and sessions <= _MOST_SESSIONS:
        last = Gain(
            lambda p: np.where(p.campaign.session == c.session.max(), 1.0, 0.0)[:, None]
        )
        yield _make_unnamed("a gain of its own in a session", (0.05,), last)
        loops = "hysteresis between sessions of loading and unloading"
        yield _make_unnamed(loops, tuple(repeat(0.05, sessions)), Pattern(_hysteresis))
    yield _make_unnamed(
        "a wrench that acts beside its point", (0.01,) * 3, Pattern(_off_centre)
    )
    if drives:
        pitch = Pattern(partial(_pitch, at.configurations.drives.mean(axis=0)))
        yield _make_unnamed(
            "errors that grow along the rail", tuple(repeat(1e-3, len(drives))), pitch
        )
    if at.used_loads[:6].all():
        springs = "a stiffness towards the frame, growing with the distance"
        away = "a force away from the frame, growing with the distance"
        tether = _make_unnamed(springs, (0.01,) * 6, Pattern(partial(_tether, middle)))
        yield replace(tether, spell=partial(_spell, springs, away))
    yield _make_unnamed(
        "a zero of its own in every direction",
        tuple(repeat(1e-5, channels)),
        Pattern(apart),
    )


def _crossings(at: RobotAtPoses) -> Iterator[Candidate]:
    """Yield cross-talk between directions at M and sensors with readings."""
    c = at.campaign
    read: list[int] = np.unique(c.channel[c.is_displacement]).tolist()
    at_tool = range(len(c.sensors), len(c.sensors) + len(AXES))
    sources = {*read, *(at_tool if set(read).intersection(at_tool) else ())}
    names = [
        name + (" at M" if k in at_tool else "") for k, name in enumerate(c.instruments)
    ]
    for sink in read if len(sources) <= _MOST_CROSSED else ():
        for source in sorted(sources - {sink}):
            place = f"cross-talk from {names[source]} into {names[sink]}"
            crossed = Pattern(partial(_crosstalk, sink, source))
            yield _make_unnamed(place, (0.05,), crossed, "cross-talk")


def _sizes(at: RobotAtPoses) -> Iterator[Candidate]:
    """Yield rigid bodies larger or smaller than drawn."""
    for body in at.mechanism.bodies if at.campaign.shows_rest.any() else ():
        held = tuple(j for j in at.mechanism.joints if body.name in (j.first, j.second))
        if body.elastic is None and len(held) > 1:
            middle = (
                np.mean([j.at for j in held], axis=0)
                if body.centre is None
                else body.centre
            )
            size = Pattern(partial(_stretch, body.name, middle, held))
            yield _make_unnamed(
                f"a body of another size, {body.name}", (3e-4,) * 3, size, "size"
            )


def _play_of(at: RobotAtPoses) -> Iterator[Candidate]:
    """Yield radial play of passive joints, analogous to backlash of drives."""
    for place, axes in _places(at, _passive(at)):
        play = _make_unnamed(
            f"play at {place}", (1e-5,) * 2, Pattern(partial(_play, axes)), "play"
        )
        held = f"motion held back at {place}"
        spell = partial(_spell, play.place, held)
        yield replace(play, like="backlash", members=tuple(axes), spell=spell)


def _spell(grown: str, shrunk: str, values: Array) -> str:
    """Return one of two texts by the sign of what patterns add together."""
    return grown if float(np.sum(values)) >= 0.0 else shrunk


def _spell_curve(place: str, size: Array, values: Array) -> str:
    """Return whether a place yields less or more in proportion under large loads.

    size: columns' norms (2,) of the force's cube root, which is steep at small loads, and square.
    """
    small, large = values * size
    return f"{'stiffening' if small >= large else 'softening'} at {place}"


def _stiffening_of(nominal: RobotReadings) -> Iterator[Candidate]:
    """Yield nonlinear stiffening of passive joints (across their axes) and drives."""
    at = nominal.at
    known = nominal.campaign.sigma
    weight = 1.0 / np.where(np.isnan(known), 1.0, known)[:, None]
    along = {
        name: np.abs(along_drive(joint)) for name, joint in at.robot.driven.items()
    }
    for place, axes in (*_places(at, _passive(at)), *_places(at, along)):
        straight, curved = np.split(weight * _make_yielding(axes, nominal), [1], axis=1)
        shares = (straight.T @ curved) / max(float(np.sum(straight**2)), 1e-300)
        stiffening = Pattern(partial(_make_stiffening, axes, shares))
        size = np.linalg.norm(curved - straight @ shares, axis=0)
        curve = _make_unnamed(
            f"stiffening at {place}", (1e-5,) * 2, stiffening, "stiffening"
        )
        spell = partial(_spell_curve, place, size)
        yield replace(curve, members=tuple(axes), spell=spell)


def _places(
    at: RobotAtPoses, axes: Mapping[str, Array]
) -> Iterator[tuple[str, dict[str, Array]]]:
    """Yield places of joints with axes (6,) whose faults displacements may show, with the axes."""
    read = at.campaign.is_displacement.any()
    for place in at.robot.places(
        name for name, along in axes.items() if read and along.any()
    ):
        yield place.name, {name: axes[name] for name in place.members}


def _passive(at: RobotAtPoses) -> dict[str, Array]:
    """Return passive joints with flags (6,) of translations held across their axes; all without."""
    passive = [j for j in at.mechanism.joints if j.drive is None]
    held = {
        j.name: [k for k in j.held_components[0] if k > 0 or j.axis is None]
        for j in passive
    }
    return {
        name: np.isin(np.arange(6), axes).astype(np.float64)
        for name, axes in held.items()
    }


def _make_unnamed(
    place: str, scale: tuple[float, ...], action: object, kind: str = ""
) -> Candidate:
    names = tuple(f"p{k + 1}" for k in range(len(scale)))
    count = len(scale)
    return Candidate(
        effect=UNNAMED,
        place=place,
        names=names,
        units=tuple(repeat("", count)),
        scale=scale,
        plausible=tuple(repeat(FREE, count)),
        pattern=kind or place,
        imitates=True,
        action=action,
    )


def _bow(lengths: Mapping[str, float], values: Array) -> Changes:
    """Bend bodies by a uniform curvature: the free end rises by ``κ L²/2`` and turns by ``κ L``."""
    return {
        name: Change(
            offset=values[0] * np.array([0.0, 0.0, length**2 / 2.0, 0.0, -length, 0.0])
        )
        for name, length in lengths.items()
    }


def _stretch(
    body: str, middle: Array, held: Sequence[Joint], prediction: RobotReadings
) -> Array:
    """Return columns (n, 3) of a rigid body stretched along home x, y, z about its middle (3,)."""
    c = prediction.campaign
    where = prediction.at.rest
    columns = np.zeros((len(c), 3))
    for joint in held:
        axes = where.rotation[joint.first] @ joint.axes
        away = (
            np.swapaxes(axes, -1, -2)
            @ where.rotation[body]
            @ np.diag(joint.at - middle)
        )
        away = np.broadcast_to(
            away if body == joint.first else -away, (len(c.poses), 3, 3)
        )
        force = prediction.find_wrenches(joint.name)[0][:, :3]
        columns += np.einsum("ni,nik->nk", force, away[c.pose])
    return np.where(c.shows_rest[:, None], columns, 0.0)


def _by_channel(read: Indices, prediction: RobotReadings) -> Array:
    """Return columns (n, k): 1 for readings of each of the instruments and directions read (k,)."""
    c = prediction.campaign
    size = np.where(c.is_displacement, 1.0, 0.0)
    return size[:, None] * (c.channel[:, None] == read)


def _time(prediction: RobotReadings) -> Array:
    """Return normalized time (n,): 0 at the first reading of the campaign, 1 at the last."""
    c = prediction.campaign
    order = np.lexsort((c.line, c.file))
    time = np.empty(len(c))
    time[order] = np.linspace(0.0, 1.0, len(c))
    return time


def _hysteresis(prediction: RobotReadings) -> Array:
    """Return Rayleigh loops ``(a² - x²)/a`` by session; a is the largest like reading."""
    c = prediction.campaign
    x = prediction.plain_readings
    loaded = c.is_difference
    key = np.stack([c.pose, c.channel, c.load], axis=1)
    group = np.unique(key, axis=0, return_inverse=True)[1].ravel()
    largest = np.zeros(group.max() + 1)
    np.maximum.at(largest, group[loaded], np.abs(x[loaded]))
    a = np.where(largest[group] > 0.0, largest[group], 1.0)
    loop = np.where(loaded, np.sign(x) * np.maximum(a**2 - x**2, 0.0) / a, 0.0)
    return loop[:, None] * np.eye(len(c.session_names))[c.session]


def _crosstalk(sink: int, source: int, prediction: RobotReadings) -> Array:
    """Return a column with the source channel's signal in readings of the sink channel."""
    c = prediction.campaign
    rows = np.flatnonzero((c.channel == sink) & c.is_displacement)
    column = np.zeros((len(c), 1))
    column[rows, 0] = prediction.seen_by(source, rows)
    return column


def _off_centre(prediction: RobotReadings) -> Array:
    """Return columns of a wrench that acts beside its point, so that its force has moments."""
    force = np.nan_to_num(prediction.campaign.wrench[:, :3])
    moments = (np.cross(axis, force) for axis in np.eye(3))
    return np.column_stack(
        [prediction.applied_motion(np.hstack([0.0 * m, m])) for m in moments]
    )


def _pitch(start: Array, prediction: RobotReadings) -> Array:
    """Return columns of pitch errors of drives, zero at the mean drive position (d,)."""
    c = prediction.campaign
    at = prediction.at
    away = (at.configurations.drives - start)[c.pose]
    moved = np.column_stack([prediction.by_drive(drive) for drive in at.robot.driven])
    return np.where(c.shows_rest[:, None], away * moved, 0.0)


def _tether(middle: Array, prediction: RobotReadings) -> Array:
    """Return columns (stiffening, pull) of springs to the frame in x, y, z, slack at (3,)."""
    c = prediction.campaign
    columns: list[Array] = []
    read, applied = prediction.at_terminals
    places = prediction.at.configurations.tool[:, :3]
    for k in range(3):
        columns.append(
            -_SPRING * read[:, k] * np.where(c.shows_rest, 0.0, applied[:, k])
        )
        pull = -_SPRING * (places[:, k] - middle[k])
        columns.append(np.where(c.shows_rest, read[:, k] * pull[c.pose], 0.0))
    return np.stack(columns, axis=1)


def _play(across: Mapping[str, Array], prediction: RobotReadings) -> Array:
    """Return columns of play towards the force: round, and separate along each axis."""
    columns = np.zeros((len(prediction.campaign), 2))
    for name, axes in across.items():
        read, force = (wrench * axes for wrench in prediction.find_wrenches(name))
        signs = prediction.find_signs(force)
        size = np.linalg.norm(force, axis=1, keepdims=True)
        unit = force / np.where(size > 0.0, size, 1.0)
        round_gap = np.where(signs.any(axis=1, keepdims=True), unit, 0.0)
        columns += np.stack(
            [np.sum(read * array, axis=1) for array in (round_gap, signs)], axis=1
        )
    return columns


def _make_stiffening(
    axes: Mapping[str, Array], shares: Array, prediction: RobotReadings
) -> Array:
    """Return nonlinear deformation less shares (1, 2) of the linear one, a known effect."""
    straight, curved = np.split(_make_yielding(axes, prediction), [1], axis=1)
    return curved - straight @ shares


def _make_yielding(across: Mapping[str, Array], prediction: RobotReadings) -> Array:
    """Return deformation (n, 3) by force, its cube root and its square, beyond that at rest."""
    c = prediction.campaign
    columns = np.zeros((len(c), 3))
    still = c.shows_rest[:, None]
    for name, axes in across.items():
        read, force = (wrench * axes for wrench in prediction.find_wrenches(name))
        rest = (
            np.where(still, 0.0, prediction.find_rest_wrench(name) * axes) / _LIKE_FORCE
        )
        whole = rest + force / _LIKE_FORCE
        squares = whole * np.abs(whole) - rest * np.abs(rest)
        steps = [whole - rest, np.cbrt(whole) - np.cbrt(rest), squares]
        columns += np.stack([np.sum(read * step, axis=1) for step in steps], axis=1)
    return np.where(c.is_displacement[:, None], columns, 0.0)
