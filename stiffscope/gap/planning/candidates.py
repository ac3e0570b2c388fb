"""Planning of the fewest readings that distinguish named causes from each other and all others."""

from __future__ import annotations

from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from itertools import compress, product
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.errors import InputError, require
from stiffscope.gap.campaign.campaign import Campaign, LoadPoint, Sensor
from stiffscope.gap.campaign.readings import load_campaign
from stiffscope.gap.campaign.template import (
    Plan,
    cross_plan,
    example_sensors,
    place_gauges,
    planned_poses,
    write_plan,
)
from stiffscope.gap.forward.robot_model import RobotModel
from stiffscope.gap.inference.settings import VERDICT
from stiffscope.gap.planning.reading_choice import Pair, choose_readings, judge_pairs
from stiffscope.robot.file.sections import ElasticBody
from stiffscope.runtime.output import scratch_folder
from stiffscope.runtime.threads import in_one_thread
from stiffscope.vjm.statics.analysis import compliance

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from stiffscope.gap.campaign.campaign_header import Header
    from stiffscope.gap.forward.forward_model import Candidate, ForwardModel
    from stiffscope.robot.file.description import RobotFile
    from stiffscope.robot.nominal import NominalRobot
    from stiffscope.runtime.types import Array
    from stiffscope.vjm.model.joints import Joint

ENOUGH = 10.0
"""Required expected ln-odds of every pair."""
AMPLE = 4.0 * ENOUGH
"""Least ln-odds of a planned pair by all available readings; others would need nearly all."""
LARGER = (2.0, 5.0, 10.0, 30.0)
"""Larger pulls that are tried for what a plan leaves unresolved."""
USUAL = 0.3  # planned size of faults, in their units
NONE = "no effect"
_ALL = "all"
_FROM = " from "
_LARGEST = 500.0  # N
_DEFLECTION = 4e-4  # m: intended deflection of the tool
_SIZES = (1.0, -0.25)  # relative loads: lost motion is the same under a small load
_BODIES = 5  # most other bodies with gauges
_LEVER = 0.1  # distance of a second hook from the tool point over the robot's size
_NUMBERS = {"unit", "sensor-sign", "sensor-step"}


@dataclass(frozen=True)
class Answered:
    """A pair of causes with the expected ln-odds between them by a plan."""

    first: str
    second: str
    log_odds: float
    """Least over all observable parameters of the first."""
    hidden: tuple[str, ...] = ()
    """Parameters of the first that all available readings hardly distinguish from the second."""
    asked: bool = True
    """Whether both are part of the question."""
    larger: float = 1.0
    """Pulls this many times as large would tell the hidden parameters, too; infinite if none of `LARGER` would."""


@dataclass(frozen=True)
class Proposal:
    """A plan for a question."""

    plan: Plan
    pairs: tuple[Answered, ...]
    """Pairs by ascending ln-odds, those of the question first."""


@in_one_thread
def propose_plan(
    nominal: NominalRobot, question: str, given: Campaign | Header | None = None
) -> Proposal:
    """Find the fewest readings that answer a question.

    Parameters
    ----------
    nominal
        The robot with its parts' matrices.
    question
        `A from B`, or only causes, or `all`; each is an effect, a place or `effect @ place`, with
        shell-style patterns, separated by commas.
    given
        A campaign with the available sensors, loads and forces; by default gauges and hooks on the robot.

    Raises
    ------
    InputError
        The question names no possible and observable cause, or a given sensor reads no motion.
    """
    offer = offer_readings(nominal, given)
    campaign = plan_campaign(nominal, offer)
    model = RobotModel(campaign, nominal)
    simple = [c for c in model.library if c.simple and c.effect not in _NUMBERS]
    known = {
        c.name: c for c in simple if len(c.scale) == len(c.names)
    }  # no isotropic supports
    sides = read_question(question, known)
    pairs = pair_up(model, known, sides)
    told = list(compress(pairs, judge_pairs(pairs, range(len(campaign))) >= AMPLE))
    asked = [known[name] for name in dict.fromkeys([*sides[0], *sides[1]])]
    least = VERDICT.few * (1 + max(len(c.scale) for c in asked))
    rows = choose_readings(told, offer.settings, ENOUGH, min(least, len(campaign)))
    require(
        rows, "--ask", "causes that these instruments can distinguish", f"{question!r}"
    )
    names = {c.name for c in asked}
    answers = summarize(pairs, told, names, _find_larger(pairs, told, offer))
    return Proposal(offer.select(rows), tuple(answers))


def _find_larger(
    pairs: Sequence[Pair], told: Sequence[Pair], offer: Plan
) -> dict[int, float]:
    """Return how much larger pulls must be for each pair that is not told, by identity.

    Motions and derivatives grow with the pulls, the noise does not.
    """
    seen = {id(pair) for pair in told}
    left = [pair for pair in pairs if id(pair) not in seen]
    out = {id(pair): np.inf for pair in left}
    pulled = np.array([hook >= 0 for hook, _ in offer.pulls])[offer.settings[:, 1]]
    every = range(len(offer.settings))
    for factor in LARGER:
        scale = np.where(pulled, factor, 1.0)
        rivals = {id(pair.rival): pair.rival * scale[:, None] for pair in left}
        larger = [
            replace(pair, own=pair.own * scale, rival=rivals[id(pair.rival)])
            for pair in left
        ]
        enough = judge_pairs(larger, every) >= AMPLE
        out |= {id(pair): factor for pair in compress(left, enough)}
        left = list(compress(left, ~enough))
    return out


def offer_readings(
    nominal: NominalRobot, given: Campaign | Header | None = None
) -> Plan:
    """Return all available readings throughout the workspace.

    Instruments, hooks and the forces on them are those of a given campaign, where it has any.
    """
    robot = nominal.robot
    mechanism = nominal.mechanism
    points = np.array([*(joint.at for joint in mechanism.joints), mechanism.tool.at])
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    poses = planned_poses(robot)
    soft = np.diagonal(compliance(mechanism, poses[:1])[0])[:3]
    middle = (
        np.median(soft[soft > 0.0]) if (soft > 0.0).any() else _DEFLECTION / _LARGEST
    )
    force = min(_LARGEST, float(f"{_DEFLECTION / middle:.0e}"))
    sensors = (
        given.sensors
        if given and given.sensors
        else _place_sensors(robot, mechanism.joints)
    )
    strange = [sensor.name for sensor in sensors if sensor.absolute]
    if strange:
        field = f"sensors.{strange[0]}.measures"
        raise InputError(f"{field}: expected displacement or rotation in a plan")
    hooks = given.loads if given and given.loads else _place_hooks(robot, size)
    pulls = _pulls_of(given) if isinstance(given, Campaign) else []
    if not pulls:
        forces = [size * force * axis for axis in np.eye(3) for size in _SIZES]
        pulls = [*product(range(len(hooks)), forces)]
    return cross_plan(poses, sensors, hooks, [*pulls, (-1, np.zeros(3))])


def _pulls_of(campaign: Campaign) -> list[tuple[int, Array]]:
    """Return the forces on hooks that a campaign's readings have, each once: what the lab can apply."""
    force = campaign.wrench[:, :3]
    hooked = (campaign.load >= 0) & (np.nan_to_num(force) != 0.0).any(axis=1)
    found = {
        (int(hook), tuple(newtons.tolist()))
        for hook, newtons in zip(campaign.load[hooked], force[hooked], strict=True)
    }
    return [(hook, np.array(newtons)) for hook, newtons in sorted(found)]


def plan_campaign(nominal: NominalRobot, offer: Plan) -> Campaign:
    """Return the readings of a plan as a campaign without values."""
    with scratch_folder() as folder:
        write_plan(nominal.robot, nominal.robot.name, folder, offer)
        return load_campaign(folder, nominal.robot, planned=True)


def _place_hooks(robot: RobotFile, size: float) -> list[LoadPoint]:
    """Return two hooks, at the tool point and beside it."""
    at = np.array(robot.tool.at)
    side = np.round(at + _LEVER * size * np.array([1.0, 1.0, 0.0]), 3)
    places = {"hook": at, "hook_beside": side}
    return [
        LoadPoint(name, robot.tool.body, tuple(p.tolist()))
        for name, p in places.items()
    ]


def _place_sensors(robot: RobotFile, joints: Sequence[Joint]) -> list[Sensor]:
    """Return gauges and a level at the tool, and gauges at some other bodies."""
    sensors = [replace(sensor, zero="none") for sensor in example_sensors(robot)]
    for body, place in find_touched(robot, joints):
        sensors += place_gauges(f"gauge_{body.replace('.', '_')}", body, place)
    return sensors


def find_touched(
    robot: RobotFile, joints: Sequence[Joint], most: int = _BODIES
) -> list[tuple[str, Array]]:
    """Return some other bodies, evenly chosen, with gauge points: the tip, or the mean joint."""
    found: list[tuple[str, Array]] = []
    for name, section in robot.bodies.items():
        if isinstance(section, ElasticBody):
            found.append((f"{name}.tip", np.array(section.tip)))
        elif name != robot.tool.body:
            at = [j.at for j in joints if name in (j.first, j.second)]
            found += [(name, np.round(np.mean(at, axis=0), 4))] if at else []
    count = min(most, len(found))
    return [found[k * (len(found) - 1) // max(count - 1, 1)] for k in range(count)]


def read_question(
    question: str, known: Iterable[str]
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the causes on both sides of a question; see `propose_plan`."""
    known = tuple(known)
    (first, asked, second) = question.partition(_FROM)
    own = _find_causes(first, known)
    other = _find_causes(second if asked else first, known)
    require(
        not (asked and {*own} == {*other}),
        "--ask",
        "other causes after from than before",
        f"{question!r}",
    )
    return own, other


def _find_causes(patterns: str, known: tuple[str, ...]) -> tuple[str, ...]:
    found: dict[str, None] = {}
    for pattern in (each.strip() for each in patterns.split(",")):
        glob = "*" if pattern == _ALL else pattern
        matches = [
            n for n in known if any(fnmatchcase(w, glob) for w in (n, *n.split(" @ ")))
        ]
        if not matches:
            words = ", ".join(dict.fromkeys(w for n in known for w in n.split(" @ ")))
            got = repr(pattern) if pattern else f"none in {patterns!r}"
            raise InputError(
                f"--ask: expected causes that readings show of this robot, got {got} ({words})"
            )
        found |= dict.fromkeys(matches)
    return tuple(found)


def pair_up(
    model: ForwardModel,
    known: dict[str, Candidate],
    sides: tuple[tuple[str, ...], tuple[str, ...]],
    size: float = USUAL,
) -> list[Pair]:
    """Pair parameters of the question's causes with the other side, other causes and none.

    size: of faults, in their units.
    """
    prediction = model.predict()
    sigma = model.campaign.sigma[:, None]
    columns = {
        name: prediction.columns(c) * np.array(c.scale) / sigma
        for name, c in known.items()
    }
    columns[NONE] = np.zeros((len(sigma), 0))
    asked = {*sides[0], *sides[1]}
    out: list[Pair] = []
    for first in dict.fromkeys([*sides[0], *sides[1]]):
        changes = size * columns[first].T
        opposite = {
            name
            for own, other in (sides, sides[::-1])
            if first in own
            for name in other
        }
        for second in (NONE, *known):
            if second == first or (second in asked and second not in opposite):
                continue
            out += [
                Pair(first, second, parameter, column, columns[second])
                for parameter, column in zip(known[first].names, changes, strict=True)
            ]
    return out


def summarize(
    pairs: Sequence[Pair],
    told: Sequence[Pair],
    asked: set[str],
    larger: Mapping[int, float],
) -> list[Answered]:
    """Gather the parameters by pair of causes."""
    answers: dict[tuple[str, str], list[Pair]] = {}
    for pair in pairs:
        answers.setdefault((pair.first, pair.second), []).append(pair)
    seen = {id(pair) for pair in told}
    out = [
        Answered(
            first,
            second,
            min((p.log_odds for p in some if id(p) in seen), default=0.0),
            tuple(p.parameter for p in some if id(p) not in seen),
            second in asked,
            max(larger.get(id(p), 1.0) for p in some),
        )
        for (first, second), some in answers.items()
    ]
    return sorted(out, key=lambda answer: (not answer.asked, answer.log_odds))
