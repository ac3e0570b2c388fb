"""A synthetic humanoid whose axes, zeros and drives are not as stated, by mechanics of its own.

A tree of eighteen revolute drives with two hands. Products of rotations about its true axes, and in every drive the
moment of all that it carries over its true stiffness: nothing of the library.
"""

from dataclasses import dataclass

import numpy as np

GRAVITY = np.array([0.0, 0.0, -9.81])
GROUPS = {"torso": ("T1", "T2", "T3", "T4")} | {
    name: tuple(f"{side}{k}" for side in "LR" for k in places)
    for name, places in (
        ("shoulders", (1, 2, 3)),
        ("elbows", (4,)),
        ("wrists", (5, 6, 7)),
    )
}
X, Y, Z = np.eye(3)
NOISE = 2e-3


@dataclass(frozen=True)
class Link:
    """A drive and the body that it carries: axis and point, stiffness, mass and centre, home coordinates."""

    name: str
    parent: str
    axis: np.ndarray
    at: np.ndarray
    stiffness: float
    mass: float
    centre: np.ndarray
    reach: float


def links():
    """The tree, parents first."""
    torso = [
        ("T1", Z, 0.8, 20e3, 3.0, 0.3),
        ("T2", Y, 0.85, 20e3, 3.0, 0.5),
        ("T3", X, 0.9, 20e3, 8.0, 0.4),
        ("T4", Y, 1.1, 15e3, 15.0, 0.4),
    ]
    out = []
    parent = ""
    for name, axis, height, stiffness, mass, reach in torso:
        at = np.array([0.0, 0.0, height])
        out.append(
            Link(
                name,
                parent,
                axis,
                at,
                stiffness,
                mass,
                at + np.array([0.02, 0.0, 0.1]),
                reach,
            )
        )
        parent = name
    for side, y in (("L", 0.25), ("R", -0.25)):
        parent = "T4"
        rows = [
            (Y, 1.35, 3e3, 1.5, 1.5),
            (X, 1.35, 3e3, 1.5, 0.8),
            (Z, 1.2, 2e3, 2.0, 1.2),
            (Y, 1.05, 2e3, 1.2, 1.2),
            (Z, 0.9, 1e3, 1.0, 1.2),
            (Y, 0.78, 1e3, 0.5, 0.8),
            (X, 0.78, 1e3, 1.0, 0.8),
        ]
        for k, (axis, height, stiffness, mass, reach) in enumerate(rows, start=1):
            at = np.array([0.0, y, height])
            out.append(
                Link(
                    f"{side}{k}",
                    parent,
                    axis,
                    at,
                    stiffness,
                    mass,
                    at - [0.0, 0.0, 0.06],
                    reach,
                )
            )
            parent = out[-1].name
    return out


HANDS = {"L": np.array([0.05, 0.25, 0.65]), "R": np.array([0.05, -0.25, 0.65])}


def turn(axis, angle):
    """Rotations (n, 3, 3) about an axis (3,) by angles (n,)."""
    x, y, z = axis / np.linalg.norm(axis)
    s = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    angle = np.asarray(angle)[..., None, None]
    return np.eye(3) + np.sin(angle) * s + (1.0 - np.cos(angle)) * s @ s


def stand(tree, angles):
    """Where every body is at angles by name (n,): rotations and positions, ``x = R x_home + p``."""
    n = len(next(iter(angles.values())))
    rotation = {"": np.tile(np.eye(3), (n, 1, 1))}
    position = {"": np.zeros((n, 3))}
    for link in tree:
        r = rotation[link.parent]
        p = position[link.parent]
        own = turn(link.axis, angles[link.name])
        rotation[link.name] = r @ own
        position[link.name] = p + (r @ (link.at - own @ link.at)[..., None])[..., 0]
    return rotation, position


def moments(tree, rotation, position):
    """Moment of weight (n,) about every drive's axis."""
    carried = {link.name: (0.0, 0.0) for link in tree}
    for link in reversed(tree):
        mass, moment = carried[link.name]
        mass = mass + link.mass
        moment = moment + link.mass * (
            rotation[link.name] @ link.centre + position[link.name]
        )
        carried[link.name] = mass, moment
        if link.parent:
            above, before = carried[link.parent]
            carried[link.parent] = above + mass, before + moment
    out = {}
    for link in tree:
        mass, moment = carried[link.name]
        lever = moment - mass * (rotation[link.name] @ link.at + position[link.name])
        axis = rotation[link.name] @ link.axis
        out[link.name] = np.einsum("ni,ni->n", axis, np.cross(lever, GRAVITY))
    return out


def hands(tree, angles, *, heavy=True):
    """Points of both hands (n, 3) by name, in equilibrium."""
    sag = dict.fromkeys(angles, 0.0)
    for _ in range(8 if heavy else 0):
        there = stand(tree, {name: angles[name] + sag[name] for name in angles})
        carried = moments(tree, *there)
        sag = {link.name: carried[link.name] / link.stiffness for link in tree}
    rotation, position = stand(
        tree, {name: angles[name] + sag[name] for name in angles}
    )
    return {
        side: rotation[f"{side}7"] @ at + position[f"{side}7"]
        for side, at in HANDS.items()
    }


def draw(rng, *, soft, bent):
    """The true tree and its zeros, rad by name."""
    tree = []
    zeros = {}
    factors = {}
    for group, names in GROUPS.items():
        for name in names:
            factors[name] = (
                1.0 / rng.uniform(3.0, 5.0)
                if soft and group in {"torso", "shoulders"}
                else 1.0
            )
    for link in links():
        tilt = 3e-3 * rng.standard_normal(3)
        away = 1e-3 * rng.standard_normal(3)
        axis = link.axis + (np.cross(tilt, link.axis) if bent else 0.0)
        zeros[link.name] = 5e-3 * rng.standard_normal() if bent else 0.0
        at = link.at + (away if bent else 0.0)
        tree.append(
            Link(
                link.name,
                link.parent,
                axis,
                at,
                link.stiffness * factors[link.name],
                link.mass,
                link.centre,
                link.reach,
            )
        )
    return tree, zeros


def robot_text():
    """Its robot file, as its maker states it."""
    lines = ['name = "humanoid"', "", "[groups]"]
    lines += [
        f"{name} = {list(members)}".replace("'", '"')
        for name, members in GROUPS.items()
    ]
    bound = {name for group in ("torso", "shoulders") for name in GROUPS[group]}
    for link in links():
        lines += [
            "",
            f"[bodies.b{link.name}]",
            f"mass = {link.mass}",
            f"centre = {link.centre.tolist()}",
        ]
        before = f"b{link.parent}" if link.parent else "ground"
        lines += [
            "",
            f"[joints.{link.name}]",
            f'between = ["{before}", "b{link.name}"]',
            'type = "revolute"',
        ]
        more = " ± factor 5" if link.name in bound else ""
        lines += [f"at = {link.at.tolist()}", f"axis = {link.axis.tolist()}"]
        lines += [
            f'drive = {{ stiffness = "{link.stiffness:g} N*m/rad{more}", range = ["-170 deg", "170 deg"] }}'
        ]
    lines += [
        "",
        "[tool]",
        'body = "bL7"',
        f"at = {HANDS['L'].tolist()}",
        'pose = ["x", "y", "z", "rx", "ry", "rz"]',
    ]
    lines += ["", "[gravity]", "direction = [0, 0, -1]", "acceleration = 9.81"]
    lines += ["", "[poses]", f"home = [{', '.join(map(str, HANDS['L']))}, 0, 0, 0]"]
    return "\n".join(lines) + "\n"


def write_campaign(folder, seed, *, soft=True, bent=True, camera=True, poses=200):
    """Write robot file, header and readings of both hands, absolute by a camera that stands anywhere, or deviations."""
    rng = np.random.default_rng([seed, 18])
    nominal = links()
    (tree, zeros) = draw(rng, soft=soft, bent=bent)
    commanded = {
        link.name: link.reach * rng.uniform(-1.0, 1.0, poses) for link in nominal
    }
    true = hands(tree, {name: q + zeros[name] for name, q in commanded.items()})
    drawn = hands(nominal, commanded, heavy=False)
    seen = {side: true[side] - (0.0 if camera else drawn[side]) for side in HANDS}
    if camera:
        away = turn(rng.standard_normal(3), np.array(rng.uniform(1.0, 3.0)))
        place = rng.uniform(-3.0, 3.0, 3)
        seen = {side: (at - place) @ away for side, at in seen.items()}
    head = [
        'robot = "humanoid.toml"',
        'modelled = ["gravity"]',
        'readings = "readings.csv"',
    ]
    if camera:
        head += ["", "[frames.camera]", 'pose = "unknown"']
    for side, at in HANDS.items():
        for axis, name in enumerate("xyz") if not camera else ((0, ""),):
            head += [
                "",
                f"[sensors.{side}{name}]",
                f'body = "b{side}7"',
                f"at = {at.tolist()}",
            ]
            more = [
                f"direction = {np.eye(3)[axis].tolist()}",
                'measures = "displacement"',
            ]
            head += ['measures = "position"', 'frame = "camera"'] if camera else more
    rows = [
        ",".join([*(f"q:{link.name}" for link in nominal), "sensor", "value", "sigma"])
    ]
    for k in range(poses):
        posture = ",".join(f"{commanded[link.name][k]:.9g}" for link in nominal)
        for side in HANDS:
            for axis, name in enumerate("xyz"):
                value = seen[side][k, axis] + NOISE * rng.standard_normal()
                rows.append(
                    f"{posture},{side}{'.' if camera else ''}{name},{value:.9g},{NOISE}"
                )
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "humanoid.toml").write_text(robot_text())
    (folder / "campaign.toml").write_text("\n".join(head) + "\n")
    (folder / "readings.csv").write_text("\n".join(rows) + "\n")
    return folder
