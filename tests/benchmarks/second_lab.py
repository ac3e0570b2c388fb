"""A second laboratory: single effects whose sizes follow the robot over decades, by mechanics of their own.

Loops, joints and elements are those of ``tests.vjm.oracle`` (maximal coordinates, dense), nothing of the library but
the description of the robot; effects are built into the network's elements, exactly. Sizes are drawn log-uniformly: of
a drive and a link by their factors, of bearings, base and tool from 0.02 to 3 times the robot's own compliance.
"""

import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from stiffscope.gap.campaign.campaign import Campaign
from stiffscope.robot.mechanism_of import mechanism_of
from stiffscope.robot.nominal import NominalRobot
from stiffscope.robot.part_matrices import part_matrices
from stiffscope.robot.reader import load_robot
from tests.vjm import oracle

HERE = Path(__file__).parents[1] / "vjm" / "robots"
SPREAD = {  # of the poses about those of the robot's file, m and rad
    "biglide": (0.1, 0.2, 0.06),
    "delta": (0.2, 0.2, 0.1),
    "stewart": (0.03, 0.03, 0.03, 0.08, 0.08, 0.08),
    "five-bar": (0.08, 0.04),
    "serial-arm": (0.1, 0.1, 0.1, 0.4, 0.4, 0.4),
    str(HERE / "linear-delta.toml"): (0.1, 0.1, 0.1),
}
POSES = 5
NOISE = 0.003  # of the rms deflection
SEEN = 100.0  # χ² that an effect adds at least: less than that no readings name
CYCLE = (
    "actuator-stiffness",
    "joint-compliance",
    "link-stiffness",
    "platform-compliance",
    "joint-compliance",
    "base-compliance",
    "",
)
TOGETHER = 0.2  # of soft bearings, those of all passive joints alike
DRIVE = (0.1, 0.85)
LINK = (0.2, 0.85)
ADDED = (0.02, 3.0)


@dataclass(frozen=True)
class Planted:
    """An effect at a place: what each of its elements yields beside the nominal."""

    name: str
    """`effect @ place`; empty for a sound robot."""
    size: str
    added: dict


@dataclass(frozen=True)
class Bench:
    """A robot at poses, as the second laboratory has it."""

    robot: NominalRobot
    poses: np.ndarray
    networks: tuple

    @property
    def own(self):
        """The robot's own compliance at the tool, m/N and rad/(N·m)."""
        diagonal = np.array([np.diag(c) for c in self.compliances({})])
        return np.median(diagonal[:, :3]), np.median(diagonal[:, 3:])

    def compliances(self, added):
        """Compliance (6, 6) at M at every pose."""
        return [np.linalg.inv(_stiffness(network, added)) for network in self.networks]


def _stiffness(network, added):
    bodies, (nodes, elements, tool) = network
    changed = [(e[0], *e[1:4], e[4] + added.get(e[0], 0.0), *e[5:]) for e in elements]
    kept = oracle.network
    oracle.network = lambda _: (nodes, changed, tool)
    try:
        return oracle.solve(bodies)[0]
    finally:
        oracle.network = kept


@cache
def bench(name):
    """The bench of a robot by its name or file."""
    file = load_robot(name)
    robot = NominalRobot(
        mechanism_of(
            file, part_matrices(file, "published" if name == "biglide" else "beam")
        ),
        file,
    )
    rng = np.random.default_rng(11)
    spread = np.array(SPREAD[name])
    middle = (
        np.array(list(file.poses.values())).mean(axis=0)
        if file.poses
        else robot.mechanism.tool.at
    )
    poses = []
    networks = []
    while len(poses) < POSES:
        pose = middle + rng.uniform(-1.0, 1.0, len(spread)) * spread
        try:
            bodies = oracle.Bodies(robot.mechanism).close(pose, 6)
        except AssertionError:
            continue
        poses.append(pose)
        networks.append((bodies, oracle.network(bodies)))
    return Bench(robot, np.array(poses), tuple(networks))


def _log_uniform(rng, low, high):
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _bearing(joint, which, translation, rotation):
    """What a joint's bearing yields in the joint's axes: along what it holds, tilts, or both."""
    free = {
        d: kind
        for kind, d in (
            (kind, int(np.argmax(np.abs(joint.axes.T @ d))))
            for kind, d in joint.motions
            if kind != "S"
        )
    }
    held = np.array(
        [free.get(k) != "P" for k in range(3)] + [free.get(k) != "R" for k in range(3)]
    )
    if any(kind == "S" for kind, _ in joint.motions):
        held[3:] = False
    which = which if held[3:].any() else "straight"
    return np.diag(
        np.repeat(
            [translation * (which != "tilting"), rotation * (which != "straight")], 3
        )
        * held
    )


def _drawn(lab, word, rng):
    robot = lab.robot
    mechanism = lab.robot.mechanism
    joints = {j.name: j for j in mechanism.joints}
    elements = {e[0]: e[4] for e in lab.networks[0][1][1]}
    if word == "actuator-stiffness":
        places = {**{d: (d,) for d in robot.driven}, "drives": tuple(robot.driven)}
        place = list(places)[rng.integers(len(places))]
        factor = _log_uniform(rng, *DRIVE)
        added = {}
        for name in places[place]:
            axis = np.eye(6)[3 if joints[name].kind == "revolute" else 0]
            added[name] = (
                np.outer(axis, axis)
                * (1.0 / factor - 1.0)
                / joints[name].drive.stiffness
            )
        return Planted(f"{word} @ {place}", f"{factor:.3g}", added)
    if word == "link-stiffness":
        names = [
            b.name
            for b in mechanism.bodies
            if b.elastic is not None and elements[b.name].any()
        ]
        place = names[rng.integers(len(names))]
        factor = _log_uniform(rng, *LINK)
        return Planted(
            f"{word} @ {place}",
            f"{factor:.3g}",
            {place: elements[place] * (1.0 / factor - 1.0)},
        )
    if word == "joint-compliance":
        names = [
            j.name
            for j in mechanism.joints
            if j.kind in ("revolute", "spherical", "universal")
        ]
        places = {name: (name,) for name in names}
        passive = tuple(j.name for j in mechanism.joints if j.drive is None)
        if passive and rng.random() < TOGETHER:
            places = {"joints": passive}
        place = list(places)[rng.integers(len(places))]
        which = ["both", "straight", "tilting"][rng.integers(3)]
        sizes = [_log_uniform(rng, *ADDED) * size for size in lab.own]
        added = {name: _bearing(joints[name], which, *sizes) for name in places[place]}
        return Planted(
            f"{word} @ {place}",
            f"{which} {sizes[0]:.2g} m/N {sizes[1]:.2g} rad/(N m)",
            added,
        )
    place = "tool" if word == "platform-compliance" else "base"
    diagonal = np.repeat([_log_uniform(rng, *ADDED) * size for size in lab.own], 3)
    kept = [
        np.ones(6),
        np.repeat([1.0, 0.0], 3),
        np.repeat([0.0, 1.0], 3),
        np.eye(6)[rng.integers(6)],
    ]
    diagonal = diagonal * kept[rng.integers(len(kept))]
    return Planted(
        f"{word} @ {place}",
        np.array2string(diagonal, precision=2),
        {f"<{place}>": np.diag(diagonal)},
    )


def campaign_of(name, number, seed=1):
    """A campaign of a robot, what is planted in it, and the nominal robot: every seventh robot is sound."""
    lab, rng = bench(name), np.random.default_rng([seed, number, *name.encode()])
    nominal = lab.compliances({})
    rms = np.sqrt(
        [
            np.mean(np.square([c[:3, :3] for c in nominal])),
            np.mean(np.square([c[3:, 3:] for c in nominal])),
        ]
    )
    length = np.sqrt(rms[0] / rms[1])
    sigma = NOISE * 500.0 * rms * np.array([1.0, length])
    sigma = np.tile(np.repeat(sigma, 3), 6 * POSES)
    force = (
        500.0 * rng.uniform(0.3, 1.0, (POSES, 6)) * rng.choice([-1.0, 1.0], (POSES, 6))
    )
    wrenches = force[..., None] * np.diag(
        np.repeat([1.0, length], 3)
    )  # (pose, load, 6)

    def read(added):
        return np.concatenate(
            [
                (w @ c).ravel()
                for w, c in zip(wrenches, lab.compliances(added), strict=True)
            ]
        )

    word = CYCLE[number % len(CYCLE)]
    base = read({})
    planted = Planted("", "", {})
    value = base
    while word:
        planted = _drawn(lab, word, rng)
        value = read(planted.added)
        if np.sum(((value - base) / sigma) ** 2) > SEEN:
            break
    pose, load, axis = (
        v.ravel() for v in np.meshgrid(range(POSES), range(6), range(6), indexing="ij")
    )
    n = len(value)
    made = Campaign(
        name,
        ("gravity",),
        "beam",
        tuple(str(k) for k in range(POSES)),
        lab.poses,
        pose,
        wrenches[pose, load],
        axis,
        value + sigma * rng.standard_normal(n),
        sigma,
        ("",),
        np.zeros(n),
        ("readings.csv",),
        np.zeros(n),
        np.arange(2, n + 2),
        coordinates=lab.robot.mechanism.tool.pose,
    )
    return made, planted, lab.robot


def names_of(model, name):
    """All names of an effect at a place in a model's library, twins apart."""
    word = re.escape(name)
    for candidate in model.library:
        names = (candidate.name, *candidate.aliases)
        if any(re.fullmatch(word, each) for each in names):
            return {name, *names}
    return {name}


def scored(diagnosis, names):
    """`right`, `honest` (not certain, and the truth is named or possible), `false` (certain of another) or `missed`."""
    groups = [{f"{e.effect} @ {e.place}", *e.confused_with} for e in diagnosis.effects]
    hit = [bool(group & names) for group in groups]
    if not names:
        return (
            "right"
            if diagnosis.verdict == "no-gap"
            else "false"
            if groups
            else "missed"
        )
    if diagnosis.verdict in ("identified", "partly"):
        return "right" if all(hit) and hit else "false"
    possible = any(f"{p.effect} @ {p.place}" in names for p in diagnosis.possible)
    return (
        "honest"
        if diagnosis.verdict == "ambiguous" and (any(hit) or possible)
        else "missed"
    )
