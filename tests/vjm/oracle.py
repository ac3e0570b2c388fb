"""Direct stiffness of any mechanism in maximal coordinates, pose by pose: the oracle of the tests.

Loops are closed over the rotations and positions of all bodies (Newton's method with a pseudo-inverse), elastic bodies
rigid. Then every node has a twist of its own, every element a wrench as a multiplier, and one dense system is solved.
Nothing of the library's kinematics or condensation is used, only the description of the mechanism.
"""

import numpy as np

X, Y, Z = np.eye(3)


def skew(a):
    return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


def expm(r):
    a = np.linalg.norm(r)
    if a < 1e-12:
        return np.eye(3) + skew(r)
    k = skew(r / a)
    return np.eye(3) + np.sin(a) * k + (1 - np.cos(a)) * k @ k


def logm(m):
    s = np.array([m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]]) / 2
    a = np.arctan2(np.linalg.norm(s), (np.trace(m) - 1) / 2)
    return s if a < 1e-9 else s * a / np.sin(a)


class Bodies:
    """Every body's rotation and position, as displaced from home; the ground is the last."""

    def __init__(self, mechanism):
        self.m = mechanism
        self.index = {b.name: k for k, b in enumerate(mechanism.bodies)}
        self.index["ground"] = len(self.index)
        self.rotation = [np.eye(3) for _ in self.index]
        self.position = [np.zeros(3) for _ in self.index]

    def of(self, node):
        k = self.index[self.m.carrier(node)]
        return self.rotation[k], self.position[k]

    def errors(self, pose):  # noqa: C901
        """Constraint errors and their derivative by all bodies' twists (about the origin)."""
        n = 6 * (len(self.index) - 1)
        rows = []
        right = []

        def row(error, parts):
            line = np.zeros(n + 6)
            for node, wrench in parts:
                k = self.index[self.m.carrier(node)]
                line[6 * k : 6 * k + 6] += wrench
            rows.append(line[:n])
            right.append(error)

        for j in self.m.joints:
            (r1, p1) = self.of(j.first)
            (r2, p2) = self.of(j.second)
            x1 = r1 @ j.at + p1
            x2 = r2 @ j.at + p2
            axes1 = r1 @ j.axes
            axes2 = r2 @ j.axes
            held = {"prismatic": (1, 2), "cylindrical": (1, 2), "planar": (0,)}.get(
                j.kind, (0, 1, 2)
            )
            for k in held:
                d = axes1[:, k]
                w = np.concatenate([d, np.cross(x2, d)])
                row(d @ (x2 - x1), [(j.second, w), (j.first, -w)])
            if j.kind in ("fixed", "prismatic"):
                for e, d in zip(logm(axes2 @ axes1.T), np.eye(3), strict=True):
                    w = np.concatenate([np.zeros(3), d])
                    row(e, [(j.second, w), (j.first, -w)])
            elif j.kind in ("revolute", "cylindrical", "planar"):
                for k in (1, 2):
                    d = np.cross(axes2[:, 0], axes1[:, k])
                    w = np.concatenate([np.zeros(3), d])
                    row(axes2[:, 0] @ axes1[:, k], [(j.second, w), (j.first, -w)])
            elif j.kind == "universal":
                a = r1 @ j.axis
                b = r2 @ j.axis2
                w = np.concatenate([np.zeros(3), np.cross(b, a)])
                row(a @ b - j.axis @ j.axis2, [(j.second, w), (j.first, -w)])
        tool = self.m.tool
        r, p = self.of(tool.body)
        at = r @ tool.at + p
        turn = logm(r)
        for name, value in zip(tool.pose, pose, strict=True):
            k = ("x", "y", "z", "rx", "ry", "rz").index(name)
            if k < 3:
                w = np.concatenate([np.eye(3)[k], np.cross(at, np.eye(3)[k])])
                row(at[k] - value, [(tool.body, w)])
            else:
                # derivative of the rotation vector: inverse of the left Jacobian
                a = np.linalg.norm(turn)
                s = skew(turn)
                c = (
                    1 / 12
                    if a < 1e-4
                    else (1 / a**2 - (1 + np.cos(a)) / (2 * a * np.sin(a)))
                )
                w = np.concatenate(
                    [np.zeros(3), (np.eye(3) - s / 2 + c * s @ s)[k - 3]]
                )
                row(turn[k - 3] - value, [(tool.body, w)])
        return np.array(rows), np.array(right)

    def close(self, pose, steps=1):
        home = np.concatenate([self.m.tool.at, np.zeros(3)])[
            [("x", "y", "z", "rx", "ry", "rz").index(name) for name in self.m.tool.pose]
        ]
        for share in np.arange(1, steps + 1) / steps:
            target = home + share * (np.asarray(pose, dtype=float) - home)
            for _ in range(30):
                rows, right = self.errors(target)
                if np.abs(right).max() < 1e-13:
                    break
                step = -np.linalg.lstsq(rows, right, rcond=1e-9)[0].reshape(-1, 6)
                for k, (v, w) in enumerate(zip(step[:, :3], step[:, 3:], strict=True)):
                    turn = expm(w)
                    self.rotation[k], self.position[k] = (
                        turn @ self.rotation[k],
                        turn @ self.position[k] + v,
                    )
            assert np.abs(right).max() < 1e-11, np.abs(right).max()
        return self


def network(bodies):  # noqa: C901
    """Nodes, and elements as (name, first, second, adjoint to the origin, compliance, free directions, offset)."""
    m = bodies.m
    nodes = ["<base>", *(n for b in m.bodies for n in b.nodes), "<tool>"]
    elements = []

    def carry(r, p):
        return np.block([[r, skew(p) @ r], [np.zeros((3, 3)), r]])

    def none(c):
        return np.zeros((6, 6)) if c is None else c

    elements.append(
        (
            "<base>",
            "ground",
            "<base>",
            np.eye(6),
            none(m.base.compliance),
            np.zeros((6, 0)),
            m.base.offset,
        )
    )
    for b in m.bodies:
        if b.elastic is not None:
            r, p = bodies.of(b.nodes[0])
            e = b.elastic
            at = carry(r @ e.axes, r @ e.tip + p)
            elements.append(
                (b.name, *b.nodes, at, e.compliance, np.zeros((6, 0)), e.offset)
            )
    for j in m.joints:
        (r1, _) = bodies.of(j.first)
        (r2, p2) = bodies.of(j.second)
        axes = r1 @ j.axes
        c = none(j.compliance).copy()
        free = []
        for kind, d in j.motions:
            if kind == "S":
                free += list(np.eye(6)[3:])
                continue
            if j.kind == "universal":  # noqa: SIM108
                d = axes.T @ (r1 @ j.axis if not free else r2 @ j.axis2)  # noqa: PLW2901
            else:
                d = j.axes.T @ d  # noqa: PLW2901
            free.append(
                np.concatenate([d, np.zeros(3)] if kind == "P" else [np.zeros(3), d])
            )
        if j.drive is not None:
            c += np.outer(free[-1], free[-1]) / j.drive.stiffness
            free.pop()
        if j.spring is not None:
            c += sum(np.outer(f, f) for f in free) / j.spring
            free = []
        first = "<base>" if j.first == "ground" else j.first
        second = "<base>" if j.second == "ground" else j.second
        columns = np.array(free).T if free else np.zeros((6, 0))
        elements.append(
            (j.name, first, second, carry(axes, r2 @ j.at + p2), c, columns, j.offset)
        )
    r, p = bodies.of(m.tool.body)
    at = carry(r, r @ m.tool.at + p)
    elements.append(
        (
            "<tool>",
            m.tool.body,
            "<tool>",
            at,
            none(m.grip.compliance),
            np.zeros((6, 0)),
            m.grip.offset,
        )
    )
    return nodes, elements, r @ m.tool.at + p


def weights(bodies):
    """Wrench at the origin on every node that carries mass."""
    m = bodies.m
    out = {}
    for b in m.bodies:
        points = [(b.nodes[0], b.centre, b.mass)]
        if b.elastic is not None:
            points = [
                (n, p, b.mass / 2)
                for n, p in zip(b.nodes, (b.elastic.base, b.elastic.tip), strict=True)
            ]
        for node, at, mass in points:
            if mass:
                r, p = bodies.of(node)
                f = mass * m.gravity
                out[node] = out.get(node, 0.0) + np.concatenate(
                    [f, np.cross(r @ at + p, f)]
                )
    return out


def solve(bodies, loads=None, *, offsets=False):
    """Stiffness (6, 6) at M, and under ``loads`` by node (wrench at the origin) the twist (6,) of M and all wrenches.

    Twist and wrenches are NaN where something moves freely under the loads.
    """
    nodes, elements, tool = network(bodies)
    place = {n: 6 * k for k, n in enumerate(nodes)}
    size = 6 * len(nodes)
    total = size + sum(6 + e[5].shape[1] for e in elements)
    a = np.zeros((total, total))
    b = np.zeros(total)
    at = size
    spots = {}
    for name, first, second, ad, c, free, offset in elements:
        w = slice(at, at + 6)
        q = slice(at + 6, at + 6 + free.shape[1])
        spots[name] = w
        back = np.linalg.inv(ad)  # twist at the origin to the element's own
        for node, sign in ((second, 1.0), (first, -1.0)):
            if node in place:
                k = slice(place[node], place[node] + 6)
                a[w, k] = sign * back
                a[k, w] = sign * back.T
        a[w, w] = -c
        a[w, q] = -free
        a[q, w] = -free.T
        b[w] = offset if offsets and offset is not None else 0.0
        at += 6 + free.shape[1]
    for node, load in (loads or {}).items():
        if node in place:
            b[place[node] : place[node] + 6] += load
    t = slice(place["<tool>"], place["<tool>"] + 6)
    inner = np.setdiff1d(np.arange(total), np.arange(t.start, t.stop))
    force = _typical(elements)
    length = 0.5
    scale = np.ones(total)
    scale[:size] = np.tile([1.0] * 3 + [1 / length] * 3, len(nodes)) / np.sqrt(force)
    at = size
    for e in elements:
        scale[at : at + 6] = np.array([1.0] * 3 + [length] * 3) * np.sqrt(force)
        scale[at + 6 : at + 6 + e[5].shape[1]] = 1 / length / np.sqrt(force)
        at += 6 + e[5].shape[1]
    s = a * np.outer(scale, scale)
    pinv = np.linalg.pinv(s[np.ix_(inner, inner)], rcond=1e-11, hermitian=True)
    k = (s[t, t] - s[t, inner] @ pinv @ s[inner, t]) / np.outer(scale[t], scale[t])
    to_m = np.block(
        [[np.eye(3), -skew(tool)], [np.zeros((3, 3)), np.eye(3)]]
    )  # twist at the origin to M
    back = np.linalg.inv(to_m)
    found = np.linalg.pinv(s, rcond=1e-12, hermitian=True) @ (scale * b)
    moves = (
        np.abs(s @ found - scale * b).max() > 1e-8 * np.abs(scale * b).max()
    )  # no equilibrium
    x = np.full(total, np.nan) if moves else scale * found
    return back.T @ k @ back, to_m @ x[t], {n: x[w] for n, w in spots.items()}


def _typical(elements):
    sizes = [np.trace(e[4][:3, :3]) for e in elements if e[4].any()] + [
        np.trace(e[4]) for e in elements if e[4].any()
    ]
    return 1.0 / np.median([s for s in sizes if s > 0])
