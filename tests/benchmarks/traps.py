"""Thirty traps: what people measure, and what a diagnosis is tempted to call a cause.

The mechanics are this file's own: a serial arm at its exact equilibrium, by a fixed point over its
joints, and a hexapod by Newton's method on its legs. Of the library nothing is used but a
diagnosis of the folder written, so that any version can be tried::

    python -m tests.benchmarks.traps [--only TEXT] [--seed N]

prints a table of traps: what is answered with sigma stated and with it left empty, and whether that
is *right* (all certain causes are the planted ones, or none is certain where there is none to
name), *honest* (nothing is certain) or *false* (something else is certain).
"""

from __future__ import annotations

import argparse
import re
import tempfile
from collections import Counter
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

import stiffscope
from stiffscope.errors import InputError
from stiffscope.gap.inference.diagnosis import to_json
from tests.small_arm import describe_arm

GRAVITY = np.array([0.0, 0.0, -9.81])
NOISE = 3e-6  # m
COORDINATES = ("q:J1", "q:J2", "q:J3")
POINTS = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.45), (0.0, 0.0, 1.0))
CENTRES = ((0.0, 0.0, 0.25), (0.0, 0.0, 0.7), (0.25, 0.0, 1.0))
MASSES = (14.0, 9.0, 6.0)
STIFFNESS = (70e3, 60e3, 25e3)
TOOL = (0.5, 0.0, 1.0)
ARM = describe_arm("trap-arm", MASSES, CENTRES, POINTS, STIFFNESS, TOOL)


@dataclass(frozen=True)
class Drive:
    """A drive's spring with what is wrong with it; ``held`` is what the spring carries."""

    stiffness: float
    friction: float = 0.0
    knee: float = np.inf
    beyond: float = 1.0
    gap: float = 0.0

    def carry(self, torque, held):
        """Return what the spring carries: friction beside it holds the rest."""
        return float(np.clip(held, torque - self.friction, torque + self.friction))

    def deflect(self, carried):
        """Return the deflection, rad, under what the spring carries."""
        size = abs(carried)
        more = max(size - self.knee, 0.0) * (1.0 / self.beyond - 1.0)
        gap = self.gap * (size > 1e-9)
        return float(np.sign(carried) * ((size + more) / self.stiffness + gap))


@dataclass(frozen=True)
class Arm:
    """Three revolute joints about z, y and y, with masses and a tool point."""

    drives: tuple = tuple(map(Drive, STIFFNESS))
    at: tuple = POINTS
    tool: tuple = TOOL
    masses: tuple = tuple(zip(MASSES, CENTRES, strict=True))
    weight: float = 1.0
    base: float = 0.0
    """Rotation of the base, rad/(N·m)."""
    lift: float = 0.0
    """Rotation of the base about y beyond it, rad/(N·m), for moments of one sign only."""

    def chain(self, q):
        """Return rotations and displacements of the bodies, x = R x_home + p."""
        rotation = np.eye(3)
        shift = np.zeros(3)
        out = []
        for axis, at, angle in zip("zyy", np.array(self.at), q, strict=True):
            turn = rotate(axis, angle)
            shift = shift + rotation @ (at - turn @ at)
            rotation = rotation @ turn
            out.append((rotation, shift))
        return out

    def torques(self, q, force):
        """Return the torques of the joints (3,), and the moment on the base (3,)."""
        bodies = self.chain(q)
        tool = bodies[-1][0] @ self.tool + bodies[-1][1]
        pulls = [(2, tool, force)]
        for k, (mass, centre) in enumerate(self.masses):
            there = bodies[k][0] @ np.array(centre) + bodies[k][1]
            pulls.append((k, there, self.weight * mass * GRAVITY))
        out = np.zeros(3)
        moment = np.zeros(3)
        before = (np.eye(3), np.zeros(3)), *bodies[:-1]
        for joint, (rotation, shift) in enumerate(before):
            axis = rotation @ {"z": np.eye(3)[2], "y": np.eye(3)[1]}["zyy"[joint]]
            at = rotation @ np.array(self.at[joint]) + shift
            for body, there, pull in pulls:
                if body >= joint:
                    out[joint] += axis @ np.cross(there - at, pull)
        for _, there, pull in pulls:
            moment += np.cross(there, pull)
        return out, moment

    def settle(self, q, force, held):
        """Return the tool point at equilibrium and what the springs carry."""
        away = np.zeros(3)
        carried = held
        for _ in range(40):
            torque, moment = self.torques(q + away, force)
            carried = [
                d.carry(t, h) for d, t, h in zip(self.drives, torque, held, strict=True)
            ]
            now = np.array(
                [d.deflect(c) for d, c in zip(self.drives, carried, strict=True)]
            )
            if np.abs(now - away).max() < 1e-14:
                break
            away = now
        rotation, shift = self.chain(q + away)[-1]
        point = rotation @ np.array(self.tool) + shift
        turn = self.base * moment + self.lift * np.array(
            [0.0, max(moment[1], 0.0), 0.0]
        )
        size = np.linalg.norm(turn)
        return (rotate_about(turn) @ point if size else point), carried

    def ladder(self, q, forces):
        """Return the deflections (m, 3) of the tool under forces in sequence."""
        weight, _ = self.torques(q, np.zeros(3))
        start, held = self.settle(q, np.zeros(3), list(weight))
        out = []
        for force in forces:
            point, held = self.settle(q, np.array(force, dtype=float), held)
            out.append(point - start)
        return np.array(out)


def rotate(axis, angle):
    """Return the rotation about a base axis."""
    return rotate_about(angle * np.eye(3)["xyz".index(axis)])


def rotate_about(vector):
    """Return the rotation by a rotation vector (Rodrigues)."""
    angle = np.linalg.norm(vector)
    if angle == 0.0:
        return np.eye(3)
    x, y, z = vector / angle
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


@dataclass
class Table:
    """Rows of a campaign: coordinates, wrench or None, quantity, value; and its header."""

    rows: list = field(default_factory=list)
    names: tuple = COORDINATES
    robot: str = ARM
    modelled: str = '["gravity"]'
    sigma: float = NOISE
    session: list = field(default_factory=list)

    def add(self, pose, force, quantities, values):
        """Append readings of one pose and load."""
        for name, value in zip(quantities, values, strict=True):
            self.rows.append([tuple(pose), force, name, float(value)])


def draw_poses(rng, count):
    """Return postures (count, 3) within reach."""
    return rng.uniform([-1.2, -0.7, -1.2], [1.2, 0.7, 0.3], (count, 3)).round(4)


CROSS = [f * s for f in (40.0, 80.0) for s in np.vstack([np.eye(3), -np.eye(3)[2:]])]
UP = (20.0, 40.0, 60.0, 80.0, 100.0)


def measure_loads(rng, arm, poses=8, loads=CROSS, noise=NOISE, stated=None):
    """Return deflections under single loads, each from rest; ``stated`` changes what is written."""
    table = Table()
    for q in draw_poses(rng, poses):
        for force in loads:
            values = arm.ladder(q, [force])[0] + noise * rng.standard_normal(3)
            written = force if stated is None else stated(np.array(force))
            table.add(q, tuple(written), ("dx", "dy", "dz"), values)
    return table


def measure_ladders(rng, arm, poses=4, axes=(0, 1, 2), sizes=UP, noise=NOISE):
    """Return deflections under loads that rise and fall, along each axis at each posture."""
    table = Table()
    for q in draw_poses(rng, poses):
        for axis in axes:
            steps = [*sizes, *sizes[-2::-1], 0.0]
            forces = [
                size * np.eye(3)[axis] * (-1 if axis == 2 else 1) for size in steps
            ]
            for force, value in zip(forces, arm.ladder(q, forces), strict=True):
                table.add(
                    q,
                    tuple(force),
                    ("dx", "dy", "dz"),
                    value + noise * rng.standard_normal(3),
                )
    return table


def measure_rest(rng, arm, poses=30, noise=NOISE, drawn=None):
    """Return where the unloaded tool is, against where the drawn rigid arm has it."""
    table = Table()
    drawn = drawn or Arm()
    for q in draw_poses(rng, poses):
        rotation, shift = drawn.chain(q)[-1]
        rigid = rotation @ np.array(drawn.tool) + shift
        weight, _ = arm.torques(q, np.zeros(3))
        point, _ = arm.settle(q, np.zeros(3), list(weight))
        table.add(
            q, None, ("ex", "ey", "ez"), point - rigid + noise * rng.standard_normal(3)
        )
    return table


def with_drive(joint, **changes):
    """Return the arm with one drive changed; a stiffness is a factor."""
    drives = list(Arm().drives)
    changes = dict(changes)
    if "stiffness" in changes:
        changes["stiffness"] *= drives[joint].stiffness
    drives[joint] = replace(drives[joint], **changes)
    return Arm(drives=tuple(drives))


SOFT = with_drive(1, stiffness=0.8)


def change_values(table, change):
    """Return the table with its values (n,) changed."""
    values = change(np.array([row[3] for row in table.rows]))
    rows = [
        [*row[:3], float(value)] for row, value in zip(table.rows, values, strict=True)
    ]
    return replace(table, rows=rows)


def pink(rng, count):
    """Return 1/f noise (count,) of unit standard deviation."""
    frequency = np.fft.rfftfreq(count)
    size = np.where(frequency > 0, frequency, np.inf) ** -0.5
    phase = rng.standard_normal(len(size)) + 1j * rng.standard_normal(len(size))
    out = np.fft.irfft(size * phase, count)
    return out / out.std()


def swap_words(table, first, second):
    """Return the table with two quantities exchanged."""
    other = {first: second, second: first}
    rows = [[a, b, other.get(name, name), v] for a, b, name, v in table.rows]
    return replace(table, rows=rows)


def outliers(rng, table):
    """Return the table with three readings of a hundred far off."""
    wild = rng.random(len(table.rows)) < 0.03
    jumps = rng.uniform(30, 200, len(wild)) * rng.choice([-1, 1], len(wild)) * NOISE
    return change_values(table, lambda values: values + wild * jumps)


def curve(rng):
    """Return a spring from 0.4 to 1.6 of the nominal one along z at one posture."""
    table = measure_loads(
        rng, Arm(), 1, [(0, 0, -f) for f in np.linspace(8, 90, 12)], 0.0
    )
    share = np.array([0.4 + 1.2 * (row[1][2] / 90) ** 2 for row in table.rows])
    along = np.array([row[2] == "dz" for row in table.rows])
    bent = change_values(table, lambda v: np.where(along, v * share, v))
    noise = NOISE * rng.standard_normal(len(share))
    return change_values(bent, lambda v: v + noise)


HEXAPOD = Path(__file__).parents[2] / "data" / "robots" / "stewart.toml"


def hexapod_legs():
    """Return feet and heads (6, 3) of the cubic hexapod, from its published dimensions."""
    edge, margin, foot = 0.4, 0.1, 0.04
    radius = edge * np.sqrt(2 / 3)
    rise = edge / np.sqrt(3)
    top = np.array([radius / 2, radius * np.sqrt(3) / 2])
    along = np.array([(top[0] - radius) / edge, top[1] / edge, rise / edge])
    first = np.array(
        [radius + margin * edge * along[0], margin * edge * along[1], foot]
    )
    last = first + (1 - 2 * margin) * edge * along
    feet, heads = [], []
    for turn in (0.0, 2 * np.pi / 3, 4 * np.pi / 3):
        for sign in (1.0, -1.0):
            mirror = np.diag([1.0, sign, 1.0])
            feet.append(rotate("z", turn) @ mirror @ first)
            heads.append(rotate("z", turn) @ mirror @ last)
    return np.array(feet), np.array(heads)


def long_leg(rng):
    """Return deviations of a hexapod with its third leg 0.2 mm long."""
    feet, heads = hexapod_legs()
    tool = np.array([0.0, 0.0, heads[0, 2] + 0.06])
    local = heads - tool
    table = Table(
        names=("x", "y", "z", "rx", "ry", "rz"),
        robot=HEXAPOD.read_text(encoding="utf-8"),
        modelled="[]",
        sigma=2e-6,
    )

    def lengths(pose):
        at = pose[:3] + local @ rotate_about(pose[3:]).T
        return np.linalg.norm(at - feet, axis=1)

    for _ in range(14):
        pose = np.concatenate([tool, np.zeros(3)]) + rng.uniform(-1, 1, 6) * [
            0.02,
            0.02,
            0.02,
            0.06,
            0.06,
            0.06,
        ]
        wanted = lengths(pose) + 2e-4 * (np.arange(6) == 2)
        there = pose.copy()
        for _ in range(20):
            steps = 1e-7 * np.eye(6)
            slope = [(lengths(there + s) - lengths(there - s)) / 2e-7 for s in steps]
            there = there + np.linalg.solve(np.array(slope).T, wanted - lengths(there))
        back = rotate_about(there[3:]) @ rotate_about(pose[3:]).T
        spin = 0.5 * np.array(
            [back[2, 1] - back[1, 2], back[0, 2] - back[2, 0], back[1, 0] - back[0, 1]]
        )
        noise = 2e-6 * rng.standard_normal(6)
        table.add(pose, None, ("ex", "ey", "ez"), there[:3] - pose[:3] + noise[:3])
        table.add(pose, None, ("erx", "ery", "erz"), spin + noise[3:])
    return table


def drift(rng, arm):
    """Return loads measured with an instrument that drifts by 60 µm."""
    table = measure_loads(rng, arm)
    time = np.linspace(0.0, 1.0, len(table.rows))
    return change_values(table, lambda v: v + 6e-5 * time)


def slip(rng):
    """Return loads on a soft drive, with the gauge along x slipped half-way."""
    table = measure_loads(rng, SOFT)
    late = np.arange(len(table.rows)) > len(table.rows) // 2
    along = np.array([row[2] == "dx" for row in table.rows])
    return change_values(table, lambda v: v + 4e-5 * late * along)


def light_weight(rng):
    """Return loads by five weights, of which the third is a tenth too light."""
    sizes = (20.0, 40.0, 60.0, 80.0, 100.0)
    loads = [size * axis for size in sizes for axis in (np.eye(3)[1], -np.eye(3)[2])]

    def stated(force):
        return force / 0.9 if abs(np.linalg.norm(force) - 54.0) < 1e-9 else force

    real = [0.9 * f if abs(np.linalg.norm(f) - 60.0) < 1e-9 else f for f in loads]
    return measure_loads(rng, Arm(), 6, real, stated=stated)


def both_softer(rng):
    """Return sag of two soft drives: a set that seems soft as a whole, and its member."""
    drives = (Drive(70e3), Drive(30e3), Drive(16.7e3))
    return measure_rest(rng, Arm(drives=drives))


def cancelling(rng):
    """Return loads on a drive that is softer and one that is stiffer, and so nearly cancel."""
    drives = (Drive(70e3), Drive(48e3), Drive(28e3))
    return measure_loads(rng, Arm(drives=drives))


def repeat(table):
    """Return the table with every row four times."""
    return replace(table, rows=[row for row in table.rows for _ in range(4)])


def round_off(table):
    """Return the table as a gauge with steps of 10 µm shows it."""
    return change_values(table, lambda v: np.round(v / 1e-5) * 1e-5)


def mixed(force):
    """Return what a force sensor shows that mixes z into x and y."""
    return np.array([force[0] + 0.08 * force[2], force[1] - 0.05 * force[2], force[2]])


OFFSET = Arm(tool=(0.53, 0.0, 0.985))
DRIVES = (r"actuator-stiffness @ (J\d|drives)",)
NOTHING = ()


@dataclass(frozen=True)
class Trap:
    """A trap: how it is measured, and the causes that may be named, as patterns."""

    name: str
    make: object
    right: tuple
    said: str = ""
    """What a remark has to say where no cause is to be named."""


def soft(joint):
    """Return the pattern of a soft drive."""
    return (rf"actuator-stiffness @ J{joint}",)


def loads(arm, *args, **more):
    """Return how single loads on an arm are measured."""
    return lambda rng: measure_loads(rng, arm, *args, **more)


def ladders(arm, **more):
    """Return how rising and falling loads on an arm are measured."""
    return lambda rng: measure_ladders(rng, arm, **more)


def rest(arm):
    """Return how the unloaded tool of an arm is measured."""
    return lambda rng: measure_rest(rng, arm)


def stroll(rng):
    """Return loads read with an instrument of 1/f noise."""
    table = measure_loads(rng, Arm())
    return change_values(table, lambda v: v + 1e-5 * pink(rng, len(v)))


def crossed(force):
    """Return what a table states whose columns of x and y are exchanged."""
    return force[[1, 0, 2]]


KNEE = with_drive(1, knee=30.0, beyond=0.5)
GEAR = with_drive(2, stiffness=0.4, knee=15.0, beyond=2.5)
STICKY = with_drive(2, friction=4.0, stiffness=0.7)
SLIGHTLY_SOFT = with_drive(1, stiffness=0.9)
HEAVY = [4 * force for force in CROSS]
MASSES = ("mass @ .*", "gravity @ robot")
SWAP = ("column-swap @ .*",)
BASE = ("base-compliance @ base",)
KNEE_OF_J3 = ("preload-loss @ J3", *soft(3))
LEG = (r"(link-length|encoder-offset) @ strut3.*",)

TRAPS = (
    Trap("hysteresis of J2", ladders(with_drive(1, friction=8.0)), ("friction @ J2",)),
    Trap("hysteresis of a soft J3", ladders(STICKY), ("friction @ J3", *soft(3))),
    Trap("stick of J3", loads(with_drive(2, friction=4.0)), ("friction @ J3",)),
    Trap("drift of the instrument", lambda r: drift(r, Arm()), NOTHING, "drift"),
    Trap("drift beside a soft J2", lambda r: drift(r, SOFT), soft(2)),
    Trap("yielding base", loads(Arm(base=3e-6)), BASE),
    Trap("rocking base", loads(Arm(lift=6e-6)), BASE),
    Trap("lost preload of J2", ladders(KNEE), ("preload-loss @ J2",)),
    Trap("two-slope gear of J3", loads(GEAR), KNEE_OF_J3),
    Trap("dead zone of J2", loads(with_drive(1, gap=1.5e-4)), ("backlash @ J2",)),
    Trap(
        "cross-talk of the force",
        loads(Arm(), stated=mixed),
        ("force-cross-talk @ .*",),
    ),
    Trap("tool offset, loaded", loads(OFFSET), ("tool-offset @ tool",)),
    Trap("tool offset, unloaded", rest(OFFSET), ("tool-offset @ tool",)),
    Trap("gravity compensated wholly", rest(Arm(weight=0.0)), MASSES),
    Trap("gravity compensated partly", rest(Arm(weight=0.4)), MASSES),
    Trap("cancelling causes", cancelling, DRIVES),
    Trap("set and member", both_softer, DRIVES),
    Trap("1/f noise", stroll, NOTHING),
    Trap("rounding to 10 µm", lambda r: round_off(measure_loads(r, Arm())), NOTHING),
    Trap("rounding, J2 soft", lambda r: round_off(measure_loads(r, SOFT)), soft(2)),
    Trap(
        "dx and dy swapped",
        lambda r: swap_words(measure_loads(r, Arm()), "dx", "dy"),
        SWAP,
    ),
    Trap("fx and fy swapped", loads(Arm(), stated=crossed), SWAP),
    Trap("one light weight", light_weight, ("load-value @ 60 N",)),
    Trap("a leg 0.2 mm long", long_leg, LEG),
    Trap(
        "copies of rows",
        lambda r: repeat(measure_loads(r, SLIGHTLY_SOFT, 4, noise=2e-5)),
        soft(2),
    ),
    Trap("outliers", lambda r: outliers(r, measure_loads(r, SOFT)), soft(2)),
    Trap("sigma ten times too small", loads(Arm(), noise=10 * NOISE), NOTHING),
    Trap("slipped gauge, J2 soft", slip, ("sensor-step @ x", *soft(2))),
    Trap("curve at one posture", curve, NOTHING),
    Trap(
        "second-order sag",
        loads(with_drive(1, stiffness=0.3), loads=HEAVY),
        soft(2),
    ),
)


def write(folder, table, stated):
    """Write a campaign folder; without ``stated`` its sigma is empty."""
    folder.mkdir(parents=True)
    (folder / "robot.toml").write_text(table.robot, encoding="utf-8")
    header = f'robot = "robot.toml"\nmodelled = {table.modelled}\nreadings = "readings.csv"\n'
    (folder / "campaign.toml").write_text(header, encoding="utf-8")
    lines = [",".join([*table.names, "fx", "fy", "fz", "quantity", "value", "sigma"])]
    sigma = f"{table.sigma:g}" if stated else ""
    for pose, force, quantity, value in table.rows:
        pushed = ["", "", ""] if force is None else [f"{f:.9g}" for f in force]
        cells = [*(f"{p:.9g}" for p in pose), *pushed, quantity, f"{value:.9g}", sigma]
        lines.append(",".join(cells))
    (folder / "readings.csv").write_text("\n".join(lines), encoding="utf-8")


def diagnose(folder):
    """Return the diagnosis of a campaign folder as its JSON has it."""
    try:
        return to_json(stiffscope.diagnose(str(folder)))
    except InputError as error:
        return {"verdict": "failed", "effects": [], "remarks": [str(error)]}


def judge(trap, found):
    """Return `right`, `honest` or `false`, and the certain causes of a diagnosis."""
    certain = []
    wrong = False
    for effect in found["effects"]:
        name = f"{effect['effect']} @ {effect['place']}"
        group = (name, *effect.get("confused_with", ()))
        sure = found["verdict"] in {"identified", "partly"}
        hit = any(re.fullmatch(p, each) for p in trap.right for each in group)
        certain.append(name if sure else f"({name})")
        wrong |= sure and not hit
    if wrong:
        return "false", certain
    named = found["verdict"] in {"identified", "partly"} and bool(certain)
    if not trap.right:
        told = trap.said in " ".join(str(each) for each in found["remarks"])
        return ("right" if told and found["verdict"] != "failed" else "honest"), certain
    return ("right" if named else "honest"), certain


def answer(trap, stated, seed):
    """Return the score, verdict and causes of one trap."""
    rng = np.random.default_rng([seed, *trap.name.encode()])
    with tempfile.TemporaryDirectory() as folder:
        case = Path(folder) / "case"
        write(case, trap.make(rng), stated)
        found = diagnose(case)
    score, certain = judge(trap, found)
    return score, f"{found['verdict']}: {', '.join(certain) or 'nothing'}"


def main():
    """Print the table of traps."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", help="traps whose names contain this")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    chosen = [trap for trap in TRAPS if given.only in trap.name]
    counts = {stated: Counter() for stated in (True, False)}
    print("| trap | sigma stated | | sigma empty | |\n|---|---|---|---|---|")
    for trap in chosen:
        cells = []
        for stated, count in counts.items():
            score, words = answer(trap, stated, given.seed)
            count[score] += 1
            cells += [words, score]
        print(f"| {trap.name} | {' | '.join(cells)} |", flush=True)
    for stated, count in counts.items():
        print(
            f"sigma {'stated' if stated else 'empty'}: {dict(count)} of {len(chosen)}"
        )


if __name__ == "__main__":
    main()
