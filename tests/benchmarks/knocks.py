"""Hammer tests of machines with withheld causes: written as universal files, diagnosed, and judged.

``python -m tests.benchmarks.knocks FOLDER [-r ROBOT]… [-c CAUSE]… [-s SEED]…`` simulates each robot with
each cause, hits it twice at two postures with four triaxial accelerometers, and writes 48 responses of 2,000 lines
with 2 % noise by pyuff. The mechanics are dense: a twist of every node, joints as constraints whose null
space is taken. Of the library they use the description of the robot alone.
"""

import argparse
import json
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyuff
from scipy.linalg import block_diag, eigh, null_space

from stiffscope.gap.campaigns import rough_mechanism
from stiffscope.robot.reader import load_robot
from stiffscope.vjm.model.joints import Drive
from tests.vjm.dense_modes import at_origin
from tests.vjm.oracle import Bodies, network

NOISE = 0.02
AVERAGES = 5
LINES = 2000
MODES = 8  # within the band
DAMPING = 0.005, 0.02  # range of ratios of modes
CAUSES = (
    "nothing",
    "drive",
    "drives",
    "base",
    "mass",
    "accelerometer",
    "drive+mass",
    "hose",
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
HITS = ((0, 2, 1.0), (1, 0, -1.0))  # point, axis, sign
ALONG = 0.0, 0.25, 0.5, 0.75, 1.0  # static poses between the two postures
PUSH = 100.0  # N
SCATTER = 0.01  # of static readings, relative to their rms


class Dense:
    """Stiffness and mass of the free motions of all nodes of a mechanism at a pose."""

    def __init__(self, mechanism, pose):
        bodies = Bodies(mechanism).close(pose, 4)
        nodes, elements, _ = network(bodies)
        self.bodies = bodies
        self.place = {n: np.arange(6 * k, 6 * k + 6) for k, n in enumerate(nodes)}
        count = 6 * len(nodes)
        modal = {
            b.name: len(b.elastic.dynamics.squares)
            for b in mechanism.bodies
            if b.elastic is not None and b.elastic.dynamics is not None
        }
        size = count + sum(modal.values())
        k = np.zeros((size, size))
        m = np.zeros((size, size))
        rows = []
        for _, first, second, ad, c, free, _ in elements:
            across = np.zeros((6, size))
            back = np.linalg.inv(ad)
            for node, sign in ((second, 1.0), (first, -1.0)):
                if node in self.place:
                    across[:, self.place[node]] += sign * back
            # relative twist = C w + F q; C may be singular
            unit = np.array([1.0] * 3 + [5.0] * 3)  # rad to m, for rank decisions
            scaled = c * np.outer(1 / unit, 1 / unit) if c.any() else c
            values, vectors = np.linalg.eigh(scaled)
            soft = values > 1e-10 * max(values.max(), 1e-300)
            stretch = unit[:, None] * vectors[:, soft]
            held = (
                null_space(np.hstack([stretch, free]).T).T
                if soft.any() or free.size
                else np.eye(6)
            )
            rows.append(held @ across)
            if soft.any():
                both = np.hstack([stretch, free])
                inverse = np.linalg.pinv(both)[: soft.sum()] @ across
                k += inverse.T @ (inverse / values[soft][:, None])
        after = count
        for b in mechanism.bodies:
            r, p = bodies.of(b.nodes[0])
            if b.elastic is None:
                inertia = np.zeros((3, 3)) if b.inertia is None else b.inertia
                if b.mass or inertia.any():
                    centre = np.zeros(3) if b.centre is None else b.centre
                    t = at_origin(r, r @ centre + p)
                    i = self.place[b.name]
                    m[np.ix_(i, i)] += t.T @ block_diag(b.mass * np.eye(3), inertia) @ t
                continue
            e = b.elastic
            axes = r @ e.axes
            ends = block_diag(
                *(at_origin(axes, r @ end + p) for end in (e.base, e.tip))
            )
            i = np.concatenate([self.place[n] for n in b.nodes])
            if e.dynamics is None:
                half = block_diag(*[0.5 * b.mass * np.eye(3), np.zeros((3, 3))] * 2)
                m[np.ix_(i, i)] += ends.T @ half @ ends
            else:
                own = modal[b.name]
                i = np.concatenate([i, np.arange(after, after + own)])
                after += own
                whole = block_diag(ends, np.eye(own))
                m[np.ix_(i, i)] += whole.T @ e.dynamics.mass @ whole
                k[np.ix_(i[12:], i[12:])] += np.diag(e.dynamics.squares)
        basis = null_space(np.vstack(rows), rcond=1e-10)
        self.size = size
        self.basis = basis
        self.k = basis.T @ k @ basis
        self.m = basis.T @ m @ basis

    def move(self, node, at):
        """Twist (6, free motions) of a node's home point."""
        r, p = self.bodies.of(node)
        rows = np.zeros((6, self.size))
        rows[:, self.place[node]] = at_origin(np.eye(3), r @ np.asarray(at) + p)
        return rows @ self.basis

    def solve(self, about):
        """Modes as columns, with their mass and stiffness; massless idle motions left out."""
        whole = self.k + (2 * np.pi * about) ** 2 * self.m
        unit = 1.0 / np.sqrt(np.diagonal(whole).clip(min=1e-12 * whole.max()))
        values, vectors = np.linalg.eigh(whole * np.outer(unit, unit))
        kept = values > 1e-13 * values[-1]
        root = unit[:, None] * vectors[:, kept] / np.sqrt(values[kept])
        mass, turned = eigh(root.T @ self.m @ root)
        shapes = root @ turned
        return shapes, mass, 1.0 - (2 * np.pi * about) ** 2 * mass


def place_points(name, mechanism):
    """Bodies and home places of the four points."""
    if name in POINTS:
        ends = {}
        for b in mechanism.bodies:
            if b.elastic is None:
                centre = np.zeros(3) if b.centre is None else b.centre
                ends[b.name] = centre
            else:
                ends[f"{b.name}.tip"] = b.elastic.tip
        ends[mechanism.tool.body] = mechanism.tool.at
        return [(body, ends[body] + np.array(away)) for body, away in POINTS[name]]
    tool = mechanism.tool
    return [(tool.body, tool.at + np.array(away)) for away in OFFSETS]


def change_drives(mechanism, factor, chosen):
    joints = tuple(
        replace(j, drive=Drive(factor * j.drive.stiffness)) if j.name in chosen else j
        for j in mechanism.joints
    )
    return replace(mechanism, joints=joints)


def change_mass(mechanism, body, factor):
    bodies = tuple(
        replace(b, mass=factor * b.mass) if b.name == body else b
        for b in mechanism.bodies
    )
    return replace(mechanism, bodies=bodies)


def stiffness_at_tool(dense, mechanism):
    """Compliance (6, 6) of the tool's body at the tool point."""
    rows = dense.move(mechanism.tool.body, mechanism.tool.at)
    return rows @ np.linalg.pinv(dense.k, rcond=1e-12, hermitian=True) @ rows.T


def plant(name, cause, mechanism, pose, rng):
    """The changed mechanism, sensors' masses by point, a spring, and the truth as sets of names."""
    driven = [j.name for j in mechanism.joints if j.drive is not None]
    heavy = max(
        (b for b in mechanism.bodies if b.elastic is None and b.mass),
        key=lambda b: (b.name == mechanism.tool.body, b.mass),
        default=None,
    )
    if heavy is None:  # only elastic bodies: the tool's
        heavy = next(b for b in mechanism.bodies if mechanism.tool.body in b.nodes)
    truth = []
    masses = {}
    spring = None
    parts = cause.split("+")
    changed = mechanism
    c = stiffness_at_tool(Dense(mechanism, pose), mechanism)
    soft = np.trace(c[:3, :3]) / 3
    turning = np.trace(c[3:, 3:]) / 3
    for part in parts:
        if part == "drive":
            chosen = str(rng.choice(driven))
            changed = change_drives(changed, 0.6, {chosen})
            truth.append([f"actuator-stiffness @ {chosen}"])
        elif part == "drives":
            changed = change_drives(changed, 0.6, set(driven))
            truth.append(["actuator-stiffness @ drives"])
        elif part == "base":
            size = rng.uniform(0.3, 1.0, 6)
            reach = np.linalg.norm(mechanism.tool.at) + 0.1
            tilt = min(0.3 * turning, 0.3 * soft / reach**2)
            base = np.diag(np.r_[0.3 * soft * size[:3], tilt * size[3:]])
            changed = replace(changed, base=replace(changed.base, compliance=base))
            truth.append(["base-compliance @ base"])
        elif part == "mass":
            changed = change_mass(changed, heavy.name, rng.choice([0.7, 1.3]))
            truth.append([f"mass @ {heavy.name}", f"payload @ {heavy.name}"])
        elif part == "accelerometer":
            point = int(rng.integers(4))
            masses[point] = 0.06
            truth.append([f"sensor-mass @ {point + 1}"])
        elif part == "hose":
            size = rng.uniform(0.1, 0.4, 3) / soft
            away = rng.uniform(-0.08, 0.08, 3)
            spring = mechanism.tool.at + away, size
    return changed, masses, spring, truth


def simulate(changed, masses, spring, points, pose, ends, hertz, rng):
    """Receptances (hits, points, 3, f), without noise."""
    dense = Dense(changed, pose)
    for index, mass in masses.items():
        rows = dense.move(*points[index])[:3]
        dense.m = dense.m + mass * rows.T @ rows
    if spring is not None:
        rows = dense.move(changed.tool.body, spring[0])[:3]
        dense.k = dense.k + rows.T @ (spring[1][:, None] * rows)
    shapes, mass, stiffness = dense.solve(ends)
    ratios = np.exp(rng.uniform(*np.log(DAMPING), len(mass)))[:, None]
    w = 2 * np.pi * hertz
    loss = 2j * ratios * np.sqrt((mass * stiffness).clip(min=0.0))[:, None] * w
    g = 1.0 / (stiffness[:, None] - mass[:, None] * w**2 + loss)
    moved = np.array([dense.move(*point)[:3] @ shapes for point in points])
    forces = np.array([sign * moved[point, axis] for point, axis, sign in HITS])
    return np.einsum("hc,pac,cf->hpaf", forces, moved, g)


def write_readings(folder, name, planted, seed, where=ALONG):
    """Write deflections of the same machine under pushes, by its dense model, and list them."""
    robot = load_robot(name)
    changed, _, spring, _ = planted
    ends = [np.array(robot.poses[each]) for each in ROBOTS[name]]
    rng = np.random.default_rng([seed, 78])
    names = robot.tool.pose
    rows = []
    for share in where:
        pose = tuple((1.0 - share) * ends[0] + share * ends[1])
        dense = Dense(changed, pose)
        if spring is not None:
            held = dense.move(changed.tool.body, spring[0])[:3]
            dense.k = dense.k + held.T @ (spring[1][:, None] * held)
        c = PUSH * stiffness_at_tool(dense, changed)[:3, :3]
        rows += [(pose, axis, c[:, axis]) for axis in range(3)]
    sigma = SCATTER * np.sqrt(np.mean([moved**2 for _, _, moved in rows]))
    lines = [",".join([*names, "fx", "fy", "fz", "quantity", "value", "sigma"])]
    for pose, axis, moved in rows:
        shown = moved + sigma * rng.standard_normal(3)
        push = ["0"] * 3
        push[axis] = repr(PUSH)
        for quantity, value in zip(("dx", "dy", "dz"), shown.tolist(), strict=True):
            words = [*map(repr, map(float, pose)), *push, quantity]
            lines.append(",".join([*words, repr(value), repr(float(sigma))]))
    (folder / "readings.csv").write_text("\n".join(lines) + "\n")


def find_band(mechanism, poses):
    """Lines of a test up to some of the modes."""
    found = []
    for pose in poses:
        dense = Dense(mechanism, pose)
        _, mass, stiffness = dense.solve(100.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            squares = np.where(mass > 1e-14, stiffness / mass, np.inf)
        hertz = np.sort(np.sqrt(squares[squares > 1.0])) / (2 * np.pi)
        found.append(hertz[np.isfinite(hertz)])
    low = 0.4 * min(each[0] for each in found)
    high = 1.15 * max(each[min(MODES, len(each)) - 1] for each in found)
    return np.linspace(low, high, LINES), found


def describe(kind, sensor, hit, values, hertz):
    return {
        "type": 58,
        "binary": 1,
        "func_type": kind,
        "id1": "simulated hammer test",
        "rsp_node": sensor[0],
        "rsp_dir": sensor[1],
        "ref_node": hit[0],
        "ref_dir": hit[1],
        "data": values,
        "x": hertz,
        "ord_data_type": 6 if kind == 4 else 4,
        "abscissa_spacing": 1,
        "abscissa_spec_data_type": 18,
        "ordinate_spec_data_type": 12 if kind == 4 else 0,
        "ordinate_axis_units_lab": "m/s^2" if kind == 4 else "NONE",
        "orddenom_spec_data_type": 13 if kind == 4 else 0,
        "orddenom_axis_units_lab": "N" if kind == 4 else "NONE",
    }


def write(folder, name, cause, seed, *, read=False):
    """Write a campaign, with static readings or without; return the truth."""
    rng = np.random.default_rng([seed, CAUSES.index(cause), list(ROBOTS).index(name)])
    robot = load_robot(name)
    mechanism = rough_mechanism(robot)
    names = ROBOTS[name]
    poses = [robot.poses[each] for each in names]
    points = place_points(name, mechanism)
    hertz, modes = find_band(mechanism, poses)
    planted = plant(name, cause, mechanism, poses[0], rng)
    changed, masses, spring, truth = planted
    folder.mkdir(parents=True, exist_ok=True)
    text = [f'robot = "{name}"', 'components = "beam"']
    if read:
        text.append('readings = "readings.csv"')
        write_readings(folder, name, planted, seed)
    state = rng.bit_generator.state
    for pose_name, pose in zip(names, poses, strict=True):
        rng.bit_generator.state = state  # the same damping at both postures
        about = modes[0][0]
        clean = simulate(changed, masses, spring, points, pose, about, hertz, rng)
        path = folder / f"{pose_name}.uff"
        path.unlink(missing_ok=True)
        text += [
            f"[responses.{pose_name}]",
            f'file = "{path.name}"',
            f'pose = "{pose_name}"',
        ]
        text += [f"averages = {AVERAGES}"]
        spots = (
            f'{k + 1} = {{ body = "{body}", at = {np.asarray(at).tolist()} }}'
            for k, (body, at) in enumerate(points)
        )
        text += [f"points = {{ {', '.join(spots)} }}"]
        noise_rng = np.random.default_rng([seed, 77, names.index(pose_name)])
        sets = []
        w = 2 * np.pi * hertz
        for h, (point, axis, sign) in enumerate(HITS):
            hit = point + 1, int(sign) * (axis + 1)
            for p in range(4):
                for a in range(3):
                    value = -(w**2) * clean[h, p, a]
                    size = NOISE * np.abs(value) / np.sqrt(2)
                    parts = noise_rng.standard_normal((2, LINES))
                    shown = value + size * (parts[0] + 1j * parts[1])
                    coherence = np.full(LINES, 1 / (1 + AVERAGES * NOISE**2))
                    sensor = p + 1, a + 1
                    sets.append(describe(4, sensor, hit, shown, hertz))
                    sets.append(describe(6, sensor, hit, coherence, hertz))
        pyuff.UFF(str(path)).write_sets(sets, mode="overwrite", force_double=False)
    (folder / "campaign.toml").write_text("\n".join(text) + "\n")
    (folder / "truth.json").write_text(json.dumps(truth))
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
