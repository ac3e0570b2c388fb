"""Hammer tests of machines with withheld causes: written as universal files, diagnosed, and judged.

``python -m tests.benchmarks.knocks FOLDER [-r ROBOT]… [-c CAUSE]… [-s SEED]…`` simulates each robot with
each cause, hits it twice at two postures with four triaxial accelerometers, and writes 48 responses of 2,000 lines
with 2 % noise. The mechanics are the laboratory's dense model, ``stiffscope.lab.dense``, which shares with the
diagnosis the description of the robot alone.
"""

import argparse
import json
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from stiffscope.lab.closure import COORDINATES, locate
from stiffscope.lab.faults import inject
from stiffscope.lab.hammer import MODES as PRIVATE
from stiffscope.lab.hammer import (
    HammerNoise,
    HammerPlan,
    find_band,
    record,
    space_lines,
    strike,
    triaxial,
    write_responses,
)
from stiffscope.lab.machine import machine_of
from stiffscope.lab.response import Spot, respond, tool_spot
from stiffscope.responses.model import Direction
from stiffscope.robot.part_matrices import part_matrices
from stiffscope.robot.reader import load_robot

LINES = 2000
ALONG = 0.0, 0.25, 0.5, 0.75, 1.0  # static poses between the two postures
PUSH = 100.0  # N
SCATTER = 0.01  # of static readings, relative to their rms
MODES = 8  # within the band
CAUSES = (
    "nothing",
    "drive",
    "drives",
    "base",
    "mass",
    "accelerometer",
    "drive+mass",
    "hose",
    "gain",
    "sign",
)
ROBOTS = {
    "stewart": ("home", "tilted"),
    "delta": ("home", "side"),
    "five-bar": ("home", "side"),
    "orthoglide": ("home", "corner"),
    "serial-arm": ("home", "near"),
}
# body, offset from the tool or from the body's own end, m
OFFSETS = (
    (0.06, 0.03, 0.01),
    (-0.05, 0.05, 0.02),
    (-0.01, -0.07, 0.01),
    (0.02, 0.01, -0.03),
)
POINTS = {
    "five-bar": (
        ("left.outer.tip", (0.03, 0.02, 0.01)),
        ("left.inner.tip", (0.01, -0.02, 0.02)),
        ("right.inner.tip", (-0.02, 0.01, 0.01)),
        ("right.outer.tip", (-0.01, 0.02, -0.02)),
    ),
    "serial-arm": (
        ("flange", (0.03, 0.04, 0.02)),
        ("wrist1", (0.02, 0.03, 0.05)),
        ("fore.tip", (0.0, 0.05, 0.03)),
        ("upper.tip", (0.04, 0.0, 0.06)),
    ),
}
HITS = ((0, 2, 1), (1, 0, -1))  # point, axis, sign


def place_points(name, machine):
    """The four points by number."""
    if name in POINTS:
        ends = {
            node: at
            for body in machine.bodies.values()
            for node, at in zip(
                body.nodes,
                body.places if len(body.places) else [body.centre],
                strict=True,
            )
        }
        ends[machine.tool] = machine.at
        spots = [Spot(node, ends[node] + np.array(away)) for node, away in POINTS[name]]
    else:
        spots = [Spot(machine.tool, machine.at + np.array(away)) for away in OFFSETS]
    return {str(k): spot for k, spot in enumerate(spots, 1)}


def plant(cause, machine, pose, rng):
    """The changed machine, the truth as sets of names, and the planted sizes by name."""
    driven = [j.name for j in machine.joints.values() if j.drive is not None]
    rigid = [b for b in machine.bodies.values() if len(b.nodes) == 1 and b.mass]
    tool = (b for b in machine.bodies.values() if machine.tool in b.nodes)
    heavy = max(
        rigid, key=lambda b: (b.name == machine.tool, b.mass), default=None
    ) or next(tool)
    truth = []
    sizes = {}
    changed = machine
    spot = tool_spot(machine)
    response = respond(machine, np.array([pose]), [spot])
    c = np.diag(response.find_twists(spot)[0, :, :6])
    soft = c[:3].mean()
    for part in cause.split("+"):
        if part == "drive":
            chosen = str(rng.choice(driven))
            changed = inject(changed, "actuator-stiffness", chosen, {"factor": 0.6})
            truth.append([f"actuator-stiffness @ {chosen}"])
            sizes[truth[-1][0]] = {"factor": 0.6}
        elif part == "drives":
            changed = inject(changed, "actuator-stiffness", "drives", {"factor": 0.6})
            truth.append(["actuator-stiffness @ drives"])
            sizes[truth[-1][0]] = {"factor": 0.6}
        elif part == "base":
            size = rng.uniform(0.3, 1.0, 6)
            reach = np.linalg.norm(machine.at) + 0.1
            tilt = min(0.3 * c[3:].mean(), 0.3 * soft / reach**2)
            base = np.r_[0.3 * soft * size[:3], tilt * size[3:]]
            entries = dict(zip(COORDINATES, base.tolist(), strict=True))
            changed = inject(changed, "base-compliance", "base", entries)
            truth.append(["base-compliance @ base"])
            sizes[truth[-1][0]] = entries
        elif part == "mass":
            factor = float(rng.choice([0.7, 1.3]))
            own = replace(
                heavy,
                mass=factor * heavy.mass,
                inertia=factor * heavy.inertia,
                moving=factor * heavy.moving,
            )
            changed = changed.change({heavy.name: own})
            names = [f"mass @ {heavy.name}"]
            # a point mass at the body's centre changes the same
            if len(heavy.nodes) == 1 and not heavy.inertia.any():
                names.append(f"payload @ {heavy.name}")
            truth.append(names)
            sizes[names[0]] = {"factor": factor}
            sizes[f"payload @ {heavy.name}"] = {"mass": (factor - 1.0) * heavy.mass}
        elif part == "accelerometer":
            point = str(1 + int(rng.integers(4)))
            changed = replace(changed, sensor_masses={point: 0.06})
            truth.append([f"sensor-mass @ {point}"])
            sizes[truth[-1][0]] = {"mass": 0.06}
        elif part == "hose":
            size = rng.uniform(0.1, 0.4, 3) / soft
            entries = dict(zip("xyz", size.tolist(), strict=True))
            changed = inject(changed, "cable-chain", "tool", entries)
    return changed, truth, sizes


def write_readings(folder, robot, machine, poses, seed):
    """Write deflections of a machine under pushes from the first pose to the last, and list them."""
    rng = np.random.default_rng([seed, 78])
    spot = tool_spot(machine)
    along = np.array(ALONG)[:, None]
    between = (1.0 - along) * poses[0] + along * poses[-1]
    moved = PUSH * respond(machine, between, [spot]).find_twists(spot)[:, :3, :3]
    sigma = float(SCATTER * np.sqrt(np.mean(moved**2)))
    shown = moved + sigma * rng.standard_normal(moved.shape)
    rows = [
        ",".join([*robot.tool.pose, "fx", "fy", "fz", "quantity", "value", "sigma"])
    ]
    for pose, by_quantity in zip(between.tolist(), shown.tolist(), strict=True):
        for name, by_push in zip(("dx", "dy", "dz"), by_quantity, strict=True):
            for axis, value in enumerate(by_push):
                push = [PUSH * (k == axis) for k in range(3)]
                rows.append(",".join(map(str, [*pose, *push, name, value, sigma])))
    (folder / "readings.csv").write_text("\n".join(rows) + "\n")
    header = folder / "campaign.toml"
    header.write_text('readings = "readings.csv"\n' + header.read_text())


def write(folder, name, cause, seed, *, read=False):
    """Write a campaign, with static readings or without; return the truth."""
    rng = np.random.default_rng([seed, CAUSES.index(cause), list(ROBOTS).index(name)])
    robot = load_robot(name)
    machine = machine_of(robot, part_matrices(robot, "beam"))
    names = ROBOTS[name]
    poses = np.array([robot.poses[each] for each in names])
    points = place_points(name, machine)
    hits = tuple(Direction(str(point + 1), axis, sign) for point, axis, sign in HITS)
    motions = tuple(each for point in points for each in triaxial(point))
    plan = HammerPlan(poses, points, hits, motions, np.ones(1))
    located = locate(machine, poses)
    low, high, about = find_band(machine, plan, located, MODES)
    plan = replace(plan, hertz=space_lines(low, high, LINES), about=about)
    changed, truth, sizes = plant(cause, machine, poses[0], rng)
    noise = HammerNoise()
    damping = noise.draw_damping(rng, PRIVATE)
    true = strike(changed, plan, located, damping)
    if cause in {"gain", "sign"}:  # of one direction of an accelerometer
        channel = motions[int(rng.integers(len(motions)))].channel
        factor = -1.0 if cause == "sign" else float(rng.choice([0.1, 0.8, 1.25]))
        shown = [factor if each.channel == channel else 1.0 for each in motions]
        true = true * np.array(shown)[:, None]
        truth.append([f"response-gain @ {channel}"])
        sizes[truth[-1][0]] = {"factor": factor}
    measured = record(true, plan, noise, np.random.default_rng([seed, 77]))
    setups = dict(zip(names, names, strict=True))
    write_responses(folder, plan, measured, robot=name, names=setups, components="beam")
    if read:
        write_readings(folder, robot, changed, poses, seed)
    (folder / "truth.json").write_text(json.dumps(truth))
    (folder / "sizes.json").write_text(json.dumps(sizes))
    return truth


def names_of(robot, name):
    """The members of a place, as a set, so that groups of the same members are one place."""
    effect, _, place = name.partition(" @ ")
    drives = {j for j, joint in robot.joints.items() if getattr(joint, "drive", None)}
    members = drives if place == "drives" else set(robot.groups.get(place, [place]))
    return effect, frozenset(members)


def judge(robot, truth, answer):
    """Right, honest or false, with the reason."""
    wanted = [{names_of(robot, each) for each in group} for group in truth]
    named = [
        {
            names_of(robot, n)
            for n in (f"{e['effect']} @ {e['place']}", *e["confused_with"])
        }
        for e in answer["effects"]
    ]
    verdict = answer["verdict"]
    wrong = [group for group in named if not any(group & want for want in wanted)]
    found = [want for want in wanted if any(group & want for group in named)]
    if verdict in {"identified", "partly"} and wrong:
        return "FALSE"
    if not truth:
        calm = "no-gap" if not wanted_gap(answer) else "unexplained"
        return "right" if not named and verdict == calm else "honest"
    whole = len(found) == len(wanted) and not wrong
    return "right" if whole and verdict in {"identified", "ambiguous"} else "honest"


def wanted_gap(answer):
    """Whether the truth is a gap without a name: a hose."""
    return answer["cause"] == "hose"


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("-r", "--robot", action="append")
    parser.add_argument("-c", "--cause", action="append")
    parser.add_argument("-s", "--seed", action="append", type=int)
    parser.add_argument("--readings", action="store_true", help="static ones beside")
    chosen = parser.parse_args()
    from stiffscope.gap.campaigns import diagnose
    from stiffscope.gap.inference.diagnosis import to_json

    for seed in chosen.seed or [1]:
        for name in chosen.robot or ROBOTS:
            for cause in chosen.cause or CAUSES:
                folder = chosen.folder / f"{name}-{cause}-{seed}"
                if (folder / "answer.json").exists():
                    continue
                truth = write(folder, name, cause, seed, read=chosen.readings)
                start = time.process_time()
                answer = to_json(diagnose(folder))
                seconds = time.process_time() - start
                answer["seconds"] = seconds
                answer["cause"] = cause
                (folder / "answer.json").write_text(json.dumps(answer, default=str))
                robot = load_robot(name)
                what = "; ".join(
                    f"{e['effect']} @ {e['place']} {e['probability']:.2f} {e['confused_with']}"
                    for e in answer["effects"]
                )
                said = judge(robot, truth, answer)
                print(
                    f"{said:7s}{seconds:6.1f} s {name} {cause} {seed}: {answer['verdict']}; {what}; truth {truth}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
