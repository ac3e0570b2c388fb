"""A second laboratory: single effects whose sizes follow the robot over decades, by mechanics of their own.

Loops, joints and elements are those of ``tests.vjm.oracle`` (maximal coordinates, dense), nothing of the library but
the description of the robot; effects are built into the network's elements, exactly. Sizes are drawn log-uniformly: of
a drive and a link by their factors, of bearings, base and tool from 0.02 to 3 times the robot's own compliance; of a
tool point by its lever; of friction and of the load at which a preload is lost by the largest force of the drive. A
series twin is a bearing that yields along its drive alone: both fit, and either name without the other is false.
"""

import re
from dataclasses import dataclass
from functools import cache, cached_property
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
    "tool-offset",
    "friction",
    "preload-loss",
    "series",
    "",
)
LADDER = (1 / 3, 2 / 3, 1.0, 2 / 3, 1 / 3)  # loads of drives that stick or bend
OFFSET = (0.01, 0.15)  # of the lever by which the robot's rotations move the tool
FRICTION = (0.03, 0.5)  # of the largest force of a drive
KNEE = (0.2, 0.7)
BEYOND = (0.2, 0.7)  # factor on the stiffness beyond it, or its inverse
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
    offset: tuple = (0.0, 0.0, 0.0)
    """Of the tool point on its body, m, home axes."""
    drive: str = ""
    """A drive that sticks or bends."""
    friction: float = 0.0
    knee: float = np.inf
    growth: float = 0.0
    """Relative growth of the drive's compliance beyond the knee."""


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

    def compliances(self, added, offset=(0.0, 0.0, 0.0)):
        """Compliance (6, 6) at every pose at M, or at a point beside it on its body."""
        out = []
        for network in self.networks:
            compliance = np.linalg.inv(_stiffness(network, added))
            rotation = network[0].of(self.robot.mechanism.tool.body)[0]
            carry = np.eye(6)
            carry[:3, 3:] = -oracle.skew(rotation @ np.array(offset))
            out.append(carry @ compliance @ carry.T)
        return out

    def along_drive(self, name):
        """Return the pattern (6, 6) of a drive's compliance in its joint's axes."""
        joint = self.robot.driven[name]
        axis = np.eye(6)[3 if joint.kind == "revolute" else 0]
        return np.outer(axis, axis)

    def drive_forces(self, name):
        """Return a drive's force (6,) per wrench at every pose, and the force by which it resists a unit slip.

        An added compliance d changes C by d w wᵀ / (1 + s d): w and s by two sizes of it.
        """
        softness = 1.0 / self.robot.driven[name].drive.stiffness
        unit = self.along_drive(name)
        sizes = (1e-3 * softness, softness)
        sound = self.compliances({})
        soft = [self.compliances({name: size * unit}) for size in sizes]
        out = []
        for k, compliance in enumerate(sound):
            small, large = ((each[k] - compliance) for each in soft)
            trace = [np.trace(small) / sizes[0], np.trace(large) / sizes[1]]
            # t(d) = |w|² / (1 + s d) at two sizes
            stiff = (trace[0] / trace[1] - 1.0) / (
                sizes[1] - sizes[0] * trace[0] / trace[1]
            )
            values, vectors = np.linalg.eigh(
                large * (1.0 + stiff * sizes[1]) / sizes[1]
            )
            out.append((vectors[:, -1] * np.sqrt(max(values[-1], 0.0)), stiff))
        return out

    @cached_property
    def series_twins(self):
        """Bearings that yield along a drive at every pose, with the drive and the pattern (6, 6)."""
        sound = np.array(self.compliances({}))
        changes = {}
        for drive in self.robot.driven:
            softness = 1e-2 / self.robot.driven[drive].drive.stiffness
            soft = self.compliances({drive: softness * self.along_drive(drive)})
            changes[drive] = np.array(soft) - sound
        out = []
        for joint in self.robot.mechanism.joints:
            if joint.kind in ("revolute", "spherical", "universal") and not joint.drive:
                unit = _bearing(joint, "straight", 1.0, 0.0)
                soft = self.compliances({joint.name: 1e-2 * self.own[0] * unit})
                change = np.array(soft) - sound
                out += [
                    (joint.name, drive, unit)
                    for drive, other in changes.items()
                    if _cosine(change, other) > 1.0 - 1e-6
                ]
        return out

    def lose(self, planted, wrenches):
        """Return the motion (pose, load, step, 6) that a drive loses under ladders of wrenches."""
        name = planted.drive
        stiffness = self.robot.driven[name].drive.stiffness
        out = np.zeros_like(wrenches)
        for k, (force, back) in enumerate(self.drive_forces(name)):
            for load in range(wrenches.shape[1]):
                carried = 0.0
                for step, wrench in enumerate(wrenches[k, load]):
                    slip, carried = _find_slip(
                        planted, force @ wrench, stiffness, back, carried
                    )
                    out[k, load, step] = force * slip
        return out


def _cosine(a, b):
    size = np.linalg.norm(a) * np.linalg.norm(b)
    return np.sum(a * b) / size if size else 0.0


def _find_slip(planted, applied, stiffness, back, before):
    """Return a drive's slip beside its linear spring, and what the spring carries then."""
    slip = 0.0
    carried = before
    for _ in range(200):
        force = applied - back * slip
        carried = np.clip(before, force - planted.friction, force + planted.friction)
        beyond = np.sign(carried) * max(abs(carried) - planted.knee, 0.0)
        wanted = (carried - force + planted.growth * beyond) / stiffness
        if abs(wanted - slip) <= 1e-12 * max(abs(wanted), 1e-15):
            break
        slip = slip + 0.5 * (wanted - slip)
    return slip, carried


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


def _drawn_offset(lab, rng):
    length = np.sqrt(lab.own[0] / lab.own[1])
    size = _log_uniform(rng, *OFFSET) * length
    offset = rng.standard_normal(3)
    offset = offset * size / np.linalg.norm(offset)
    return Planted("tool-offset @ tool", f"{size:.2g} m", {}, tuple(offset))


def _drawn_law(lab, word, rng):
    names = list(lab.robot.driven)
    place = names[rng.integers(len(names))]
    force = 500.0 * max(np.abs(w[:3]).max() for w, _ in lab.drive_forces(place))
    name = f"{word} @ {place}"
    if word == "friction":
        held = _log_uniform(rng, *FRICTION) * force
        return Planted(name, f"{held:.3g}", {}, drive=place, friction=held)
    knee = _log_uniform(rng, *KNEE) * force
    factor = _log_uniform(rng, *BEYOND) ** rng.choice([-1.0, 1.0])
    size = f"{factor:.3g} beyond {knee:.3g}"
    growth = 1.0 / factor - 1.0
    return Planted(name, size, {}, drive=place, knee=knee, growth=growth)


def _drawn_twin(lab, rng):
    twins = lab.series_twins
    if not twins:
        return _drawn(lab, "actuator-stiffness", rng)
    name, drive, unit = twins[rng.integers(len(twins))]
    softness = 1.0 / lab.robot.driven[drive].drive.stiffness
    size = (1.0 / _log_uniform(rng, *DRIVE) - 1.0) * softness
    what = f"{size:.2g} along {drive}"
    return Planted(f"joint-compliance @ {name}", what, {name: size * unit})


OTHERWISE = {
    "tool-offset": _drawn_offset,
    "friction": lambda lab, rng: _drawn_law(lab, "friction", rng),
    "preload-loss": lambda lab, rng: _drawn_law(lab, "preload-loss", rng),
    "series": _drawn_twin,
}


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
    force = (
        500.0 * rng.uniform(0.3, 1.0, (POSES, 6)) * rng.choice([-1.0, 1.0], (POSES, 6))
    )
    word = CYCLE[number % len(CYCLE)]
    steps = LADDER if word in ("friction", "preload-loss") else (1.0,)
    whole = force[..., None] * np.diag(np.repeat([1.0, length], 3))
    wrenches = whole[:, :, None] * np.array(steps)[:, None]  # (pose, load, step, 6)
    sigma = np.tile(np.repeat(sigma, 3), 6 * POSES * len(steps))

    def read(planted):
        compliances = np.array(lab.compliances(planted.added, planted.offset))
        out = np.einsum("pij,plsj->plsi", compliances, wrenches)
        return (out + lab.lose(planted, wrenches) if planted.drive else out).ravel()

    planted = Planted("", "", {})
    base = read(planted)
    value = base
    while word:
        draw = OTHERWISE.get(word)
        planted = draw(lab, rng) if draw else _drawn(lab, word, rng)
        value = read(planted)
        if np.sum(((value - base) / sigma) ** 2) > SEEN:
            break
    pose, load, step, axis = (
        v.ravel()
        for v in np.meshgrid(
            range(POSES), range(6), range(len(steps)), range(6), indexing="ij"
        )
    )
    n = len(value)
    made = Campaign(
        name,
        ("gravity",),
        "beam",
        tuple(str(k) for k in range(POSES)),
        lab.poses,
        pose,
        wrenches[pose, load, step],
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
