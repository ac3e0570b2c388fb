"""Planning of hammer tests: where to hit, and where to listen, to distinguish named causes.

Candidates are points of the bodies, hit along the base axes, with triaxial accelerometers. What is
read are the lines at the lowest modes and half a half-power width beside them, with damping, gain
and phase of each channel unknown.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import compress, product
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.errors import require
from stiffscope.gap.campaign.campaign import Campaign
from stiffscope.gap.campaign.measured_responses import DAMPING, MeasuredResponses
from stiffscope.gap.campaign.response_header import MeasuredPoint, ResponseSetup
from stiffscope.gap.campaign.response_lines import place_at_responses
from stiffscope.gap.campaign.writing import write_campaign
from stiffscope.gap.effects.response_gain import ResponseGain
from stiffscope.gap.forward.joint_model import JointModel
from stiffscope.gap.forward.response_model import predict_responses
from stiffscope.gap.forward.robot_model import RobotModel
from stiffscope.gap.planning.candidates import (
    AMPLE,
    ENOUGH,
    Answered,
    find_touched,
    pair_up,
    read_question,
    summarize,
)
from stiffscope.gap.planning.reading_choice import choose_readings, judge_pairs
from stiffscope.responses.model import Direction, Response
from stiffscope.robot.mechanism_of import configured_poses
from stiffscope.runtime.threads import in_one_thread
from stiffscope.vjm.vibration.modes import modes

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from stiffscope.robot.nominal import NominalRobot
    from stiffscope.runtime.types import Array
    from stiffscope.vjm.kinematics.configurations import Configurations
    from stiffscope.vjm.model.mechanism import Mechanism


@dataclass(frozen=True)
class HitSettings:
    """What a hammer test may use, and how well it reads.

    Attributes
    ----------
    poses
        Most postures.
    on_tool, beside
        Most points on the tool's body that are hit, and further bodies with sensors.
    modes
        Lowest modes that are read; the response has three lines about each.
    averages
        Hits behind each line.
    noise
        Standard deviation of a line over its size.
    floor
        The same over the largest line of all responses at the pose.
    size
        Planned faults in their usual units: smaller than those of static readings, as lines are
        linear in small changes alone.
    low, high
        Band over the lowest and the highest mode read.
    """

    poses: int = 2
    on_tool: int = 3
    beside: int = 3
    modes: int = 7
    averages: int = 5
    noise: float = 0.02
    floor: float = 1e-3
    size: float = 0.03
    low: float = 0.4
    high: float = 1.2


SETTINGS = HitSettings()


@dataclass(frozen=True)
class Tap:
    """A hit at a posture, and the points that listen to it."""

    pose: str
    hit: Direction
    listen: tuple[str, ...]


@dataclass(frozen=True)
class HitProposal:
    """A planned hammer test.

    Attributes
    ----------
    points
        Body and home place (3,) of each point by number.
    taps
        Hits with their sensors.
    bands
        Lowest and highest frequency to measure at each posture, Hz.
    averages
        Hits behind each line.
    pairs
        Causes and how well they are distinguished, those of the question first.
    """

    points: dict[str, tuple[str, tuple[float, float, float]]]
    taps: tuple[Tap, ...]
    bands: dict[str, tuple[float, float]]
    averages: int
    pairs: tuple[Answered, ...]
    stands: dict[str, dict[str, Any]]
    """How the robot stands at each posture, as in a campaign: its pose, or joints."""


@in_one_thread
def propose_hits(
    nominal: NominalRobot,
    question: str,
    own: Sequence[MeasuredResponses] = (),
    settings: HitSettings = SETTINGS,
) -> HitProposal:
    """Find few hits and accelerometers that answer a question.

    Parameters
    ----------
    nominal
        The robot with its parts' matrices.
    question
        As for `propose_plan`.
    own
        A test whose hits and channels are all taken, and no others; by default any of the usual.
    settings
        What may be used.

    Raises
    ------
    InputError
        The question names no possible and observable cause.
    """
    points = _list_points(own) if own else _place_points(nominal, settings)
    if own:
        offered = tuple(
            response
            for measured in own
            for response in _expect_responses(nominal.mechanism, measured, settings)
        )
    else:
        offered = _offer_responses(nominal, points, settings)
    model = _open_model(nominal, offered)
    prediction = model.predict()
    simple = [c for c in model.library if c.simple and len(c.scale) == len(c.names)]
    known = {c.name: c for c in simple if prediction.columns(c).any()}
    sides = read_question(question, known)
    pairs = pair_up(model, known, sides, settings.size)
    rows = _number_rows(model)
    told = list(compress(pairs, judge_pairs(pairs, range(len(rows))) >= AMPLE))
    chosen = choose_readings(told, rows, ENOUGH)
    require(
        chosen, "--ask", "causes that a hammer test can distinguish", f"{question!r}"
    )
    kept = sorted({tuple(row) for row in rows[chosen].tolist()})
    taken = offered if own else _take_responses(offered, kept)
    # what damping and channels follow depends on the responses that are there
    final = JointModel(model.readings, taken, known=model.library)
    left = pair_up(final, known, sides, settings.size)
    odds = judge_pairs(left, range(len(final.campaign)))
    for pair, size in zip(left, odds, strict=True):
        pair.log_odds = float(size)
    enough = [pair for pair in left if pair.log_odds >= ENOUGH]
    asked = {*sides[0], *sides[1]}
    hidden = {id(pair): np.inf for pair in left if pair.log_odds < ENOUGH}
    answers = summarize(left, enough, asked, hidden)
    return _describe(points, taken, answers, settings)


def _place_points(nominal: NominalRobot, settings: HitSettings) -> list[MeasuredPoint]:
    """Return points of the tool's body, M first, then of some other bodies."""
    tool = nominal.mechanism.tool
    joints = [j for j in nominal.mechanism.joints if tool.body in (j.first, j.second)]
    corners = sorted(
        {tuple(np.round(joint.at, 4).tolist()) for joint in joints},
        key=lambda at: -float(np.linalg.norm(np.array(at) - tool.at)),
    )
    places: list[tuple[str, Any]] = [(tool.body, tuple(np.round(tool.at, 4).tolist()))]
    places += [(tool.body, at) for at in corners if at != places[0][1]]
    places = places[: settings.on_tool]
    touched = find_touched(nominal.robot, nominal.mechanism.joints, settings.beside)
    places += [(body, tuple(np.round(at, 4).tolist())) for body, at in touched]
    return [
        MeasuredPoint(str(k), body, at, 0.0) for k, (body, at) in enumerate(places, 1)
    ]


def _offer_responses(
    nominal: NominalRobot, points: Sequence[MeasuredPoint], settings: HitSettings
) -> tuple[MeasuredResponses, ...]:
    """Return the responses of all hits on the tool's body at all points, one hit each."""
    robot = nominal.robot
    mechanism = nominal.mechanism
    named = list(robot.known_poses.items())[: settings.poses]
    body = points[0].body
    hit = [point.name for point in points if point.body == body]
    motions = [Direction(p.name, axis) for p in points for axis in range(3)]
    out: list[MeasuredResponses] = []
    for name, pose in named:
        found = configured_poses(robot, mechanism, [pose])
        if not found.valid[0]:
            continue
        setup = _describe_setup(name, points, settings)
        silent = _listen_nowhere(setup, points, found)
        ends = [Direction(point, axis) for point, axis in product(hit, range(3))]
        pairs = [(force, motion) for force in ends for motion in motions]
        out += _hear(mechanism, silent, pairs, settings)
    require(out, "--ask", "a pose of the robot within reach", "none")
    return tuple(out)


def _expect_responses(
    mechanism: Mechanism, measured: MeasuredResponses, settings: HitSettings
) -> list[MeasuredResponses]:
    """Return what a test that was measured is expected to show at the lines of a plan."""
    pairs = [(each.force, each.motion) for each in measured.responses]
    return _hear(mechanism, measured, pairs, settings)


def _list_points(own: Sequence[MeasuredResponses]) -> list[MeasuredPoint]:
    """Return the points of tests at their home coordinates."""
    points = {
        point.name: replace(point, at=tuple(each.places[point.name].tolist()))
        for each in reversed(own)
        for point in each.setup.points
    }
    return list(points.values())


def _hear(
    mechanism: Mechanism,
    silent: MeasuredResponses,
    pairs: Sequence[tuple[Direction, Direction]],
    settings: HitSettings,
) -> list[MeasuredResponses]:
    """Return the expected responses of pairs of force and motion, hit by hit."""
    hertz = _choose_lines(mechanism, silent.configuration, settings)
    responses = [_be_silent(force, motion, hertz) for force, motion in pairs]
    whole = replace(silent, responses=tuple(responses))
    values = predict_responses(mechanism, whole, DAMPING).receptances
    largest = max(float(np.abs(value).max()) for value in values)
    by_hit = dict[str, list[Response]]()
    for response, value in zip(responses, values, strict=True):
        heard = _measure(response, value, largest, settings)
        by_hit.setdefault(str(response.force), []).append(heard)
    return [replace(whole, responses=tuple(each)) for each in by_hit.values()]


def _describe_setup(
    name: str, points: Sequence[MeasuredPoint], settings: HitSettings
) -> ResponseSetup:
    return ResponseSetup(
        name=name,
        file=f"{name}.uff",
        pose=name,
        joints={},
        drives="held",
        points=tuple(points),
        averages=settings.averages,
        band=None,
        exponential=None,
        axes=(0.0, 0.0, 0.0),
        quantity="accelerance",
        factor=1.0,
        channels={},
    )


def _listen_nowhere(
    setup: ResponseSetup, points: Sequence[MeasuredPoint], found: Configurations
) -> MeasuredResponses:
    return MeasuredResponses(
        setup=setup,
        responses=(),
        places={point.name: np.array(point.at) for point in points},
        axes=np.eye(3),
        configuration=found,
        remarks=(),
    )


def _be_silent(force: Direction, motion: Direction, hertz: Array) -> Response:
    nothing = np.zeros(len(hertz), dtype=np.complex128)
    return Response(force, motion, hertz, nothing, None, "accelerance", "plan")


def _choose_lines(
    mechanism: Mechanism, found: Configurations, settings: HitSettings
) -> Array:
    """Return lines at the lowest modes above zero, and half a half-power width beside them."""
    solved = modes(mechanism, found, count=4 * settings.modes)
    hertz = solved.frequencies[0]
    moving = hertz[np.isfinite(hertz) & (hertz > 1e-6 * np.nanmax(hertz))]
    lowest = moving[: settings.modes]
    lines = [lowest * (1.0 + DAMPING * width) for width in (-1.0, 0.0, 1.0)]
    return np.unique(np.round(np.concatenate(lines), 6))


def _measure(
    response: Response, value: Any, largest: float, settings: HitSettings
) -> Response:
    """Return a response with the coherence that noise would leave."""
    level = np.abs(value)
    noise = 0.5 * ((settings.noise * level) ** 2 + (settings.floor * largest) ** 2)
    whole = level**2 + 2.0 * settings.averages * noise
    return replace(response, receptance=value, coherence=level**2 / whole)


def _open_model(
    nominal: NominalRobot, responses: tuple[MeasuredResponses, ...]
) -> JointModel:
    coordinates = tuple(nominal.robot.tool.pose)
    nothing = Campaign.without_readings(nominal.robot.name, coordinates=coordinates)
    campaign = place_at_responses(nothing, responses)
    # gains of the planned size are those that every channel may have
    readings = RobotModel(campaign, nominal, without=ResponseGain.word)
    return JointModel(readings, responses)


def _number_rows(model: JointModel) -> Any:
    """Return posture, hit, and listening point (n, 3) of each reading."""
    out: list[Any] = []
    setups = [block.measured.setup.name for block in model.blocks]
    for k, block in enumerate(model.blocks):
        names = [p.name for p in block.measured.setup.points]
        ears = [names.index(each.motion.point) for each in block.measured.responses]
        lines = block.value.shape[1]
        ear = np.tile(np.repeat(ears, lines), 2)
        first = np.full(len(ear), setups.index(setups[k]))
        out.append(np.stack([first, np.full(len(ear), k), ear], axis=1))
    return np.concatenate(out)


def _take_responses(
    offered: tuple[MeasuredResponses, ...], kept: Sequence[Sequence[int]]
) -> tuple[MeasuredResponses, ...]:
    """Return the hits that are kept, each with its listening points."""
    out: list[MeasuredResponses] = []
    for k, measured in enumerate(offered):
        names = [p.name for p in measured.setup.points]
        ears = {names[ear] for _, hit, ear in kept if hit == k}
        some = tuple(r for r in measured.responses if r.motion.point in ears)
        if some:
            out.append(replace(measured, responses=some))
    return tuple(out)


def _describe(
    points: Sequence[MeasuredPoint],
    taken: Sequence[MeasuredResponses],
    pairs: Sequence[Answered],
    settings: HitSettings,
) -> HitProposal:
    used = {
        end.point for m in taken for r in m.responses for end in (r.force, r.motion)
    }
    taps: list[Tap] = []
    stands: dict[str, dict[str, Any]] = {}
    bands: dict[str, tuple[float, float]] = {}
    for measured in taken:
        hit = measured.responses[0].force
        ears = dict.fromkeys(r.motion.point for r in measured.responses)
        name = measured.setup.name
        taps.append(Tap(name, hit, tuple(ears)))
        lines = measured.responses[0].frequency
        low = float(f"{settings.low * lines[0]:.2g}")
        setup = measured.setup
        stands[name] = (
            {"joints": dict(setup.joints)}
            if setup.pose is None
            else {"pose": setup.pose}
        )
        bands[name] = low, float(f"{settings.high * lines[-1]:.2g}")
    places = {
        p.name: (p.body, p.at or (0.0, 0.0, 0.0)) for p in points if p.name in used
    }
    return HitProposal(
        places, tuple(taps), bands, settings.averages, tuple(pairs), stands
    )


def write_hits(folder: Path, name: str, proposal: HitProposal) -> None:
    """Write the campaign.toml of a planned hammer test into a folder.

    Parameters
    ----------
    folder
        Created if absent.
    name
        The robot's name in the campaign.
    proposal
        The test.
    """
    setups: dict[str, Any] = {}
    for pose, band in proposal.bands.items():
        taps = [tap for tap in proposal.taps if tap.pose == pose]
        used = {tap.hit.point for tap in taps} | {p for tap in taps for p in tap.listen}
        setups[pose] = {
            "file": f"{pose}.uff",
            **proposal.stands[pose],
            "averages": proposal.averages,
            "band": [f"{hertz:g} Hz" for hertz in band],
            "points": {
                point: {"body": body, "at": list(at)}
                for point, (body, at) in proposal.points.items()
                if point in used
            },
        }
    advice = "\n".join(
        f"{tap.pose}: hit {tap.hit}, triaxial accelerometers at {', '.join(tap.listen)}"
        for tap in proposal.taps
    )
    comment = f"""A planned hammer test: number the nodes of the files as the points here; directions: {{O}}.
{advice}
Save responses and coherences of each pose as the file below (.uff, or a table, guide "A hammer test"), then:
stiffscope campaign check FOLDER, and stiffscope diagnose FOLDER --out OUT."""
    write_campaign(folder, {"robot": name, "responses": setups}, {}, comment=comment)
