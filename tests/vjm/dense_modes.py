"""Natural frequencies by a dense model in maximal coordinates, pose by pose: the oracle of the tests.

Every node has a twist of its own at the origin; joints constrain what they hold by rows whose null space is taken;
frame elements and drives are stiffnesses; directions without inertia are condensed by a Schur complement. Kinematics
and condensation are those of ``tests.vjm.oracle`` and of this file, nothing of the library but the description.
"""

import numpy as np
from scipy.linalg import block_diag, eigh, null_space

from tests.vjm.oracle import Bodies, skew


def at_origin(axes, point):
    """Twist at the origin in base axes to one at a point in other axes (6, 6)."""
    return np.block([[axes.T, -axes.T @ skew(point)], [np.zeros((3, 3)), axes.T]])


def joint_directions(j, r1, r2):
    """Columns of the twists that a joint leaves free, and that of its drive or None, at its point in base axes."""
    x, y, z = (r1 @ j.axes).T

    def turn(d):
        return np.r_[0.0, 0, 0, d]

    def slide(d):
        return np.r_[d, 0.0, 0, 0]

    free = {
        "fixed": [],
        "revolute": [turn(x)],
        "prismatic": [slide(x)],
        "cylindrical": [turn(x), slide(x)],
        "spherical": [turn(e) for e in np.eye(3)],
        "planar": [slide(y), slide(z), turn(x)],
        "universal": [turn(x), turn(r2 @ j.axis2)] if j.kind == "universal" else [],
    }[j.kind]
    return free, None if j.drive is None else (
        free[-1] if j.kind == "cylindrical" else free[0]
    )


def matrices(mechanism, pose, *, drives="held", steps=4):
    """Stiffness and mass of all nodes' twists at the origin, the null space of the constraints, places of the nodes."""
    bodies = Bodies(mechanism).close(pose, steps)
    nodes = [n for b in mechanism.bodies for n in b.nodes]
    place = {n: np.arange(6 * k, 6 * k + 6) for k, n in enumerate(nodes)}
    modal = [
        0
        if b.elastic is None or b.elastic.dynamics is None
        else len(b.elastic.dynamics.squares)
        for b in mechanism.bodies
    ]
    size = 6 * len(nodes) + sum(modal)
    k = np.zeros((size, size))
    m = np.zeros((size, size))
    rows = []
    after = 6 * len(nodes)
    for b, count in zip(mechanism.bodies, modal, strict=True):
        r, p = bodies.of(b.nodes[0])
        if b.elastic is None:
            inertia = np.zeros((3, 3)) if b.inertia is None else b.inertia
            if b.mass or inertia.any():
                t = at_origin(
                    r, r @ (np.zeros(3) if b.centre is None else b.centre) + p
                )
                i = place[b.name]
                m[np.ix_(i, i)] += t.T @ block_diag(b.mass * np.eye(3), inertia) @ t
            continue
        e = b.elastic
        axes = r @ e.axes
        base, tip = (at_origin(axes, r @ end + p) for end in (e.base, e.tip))
        i = np.concatenate([place[b.nodes[0]], place[b.nodes[1]]])
        stretch = np.hstack([-tip, tip])
        k[np.ix_(i, i)] += stretch.T @ np.linalg.inv(e.compliance) @ stretch
        ends = block_diag(base, tip)
        if e.dynamics is None:
            half = block_diag(*[0.5 * b.mass * np.eye(3), np.zeros((3, 3))] * 2)
            m[np.ix_(i, i)] += ends.T @ half @ ends
        else:
            i = np.concatenate([i, np.arange(after, after + count)])
            whole = block_diag(ends, np.eye(count))
            m[np.ix_(i, i)] += whole.T @ e.dynamics.mass @ whole
            k[np.ix_(i[12:], i[12:])] += np.diag(e.dynamics.squares)
        after += count
    for j in mechanism.joints:
        (r1, _) = bodies.of(j.first)
        (r2, p2) = bodies.of(j.second)
        at = r2 @ j.at + p2
        free, driven = joint_directions(j, r1, r2)
        across = np.zeros((6, size))
        for node, sign in ((j.second, 1.0), (j.first, -1.0)):
            if node in place:
                across[:, place[node]] += sign * at_origin(np.eye(3), at)
        held = null_space(np.array(free)).T if free else np.eye(6)
        rows.append(held @ across)
        if j.spring is not None:
            along = np.linalg.pinv(np.array(free).T) @ across
            k += j.spring * along.T @ along
        if driven is not None and drives == "held":
            along = (
                np.linalg.pinv(np.array(free).T)[
                    [np.allclose(f, driven) for f in free].index(True)
                ]
                @ across
            )
            k += j.drive.stiffness * np.outer(along, along)
    return k, m, null_space(np.vstack(rows), rcond=1e-10), place, bodies


def receptance(mechanism, pose, source, target, hertz):
    """Undamped displacement (f,) along one port for a unit force at another: node, point at home, direction (6,)."""
    k, m, basis, place, bodies = matrices(mechanism, pose)
    ends = []
    for node, at, direction in (source, target):
        r, p = bodies.of(node)
        row = np.zeros(len(k))
        row[place[node]] = direction @ at_origin(np.eye(3), r @ at + p)
        ends.append(basis.T @ row)
    k = basis.T @ k @ basis
    m = basis.T @ m @ basis
    return np.array(
        [
            ends[1] @ np.linalg.solve(k - (2 * np.pi * f) ** 2 * m, ends[0])
            for f in hertz
        ]
    )


def frequencies(mechanism, pose, *, drives="held", steps=4):
    """All natural frequencies in Hz, those of free motions as zeros."""
    k, m, basis, _, _ = matrices(mechanism, pose, drives=drives, steps=steps)
    k = basis.T @ k @ basis
    m = basis.T @ m @ basis
    unit = 1.0 / np.sqrt(np.diagonal(k) + 1e4 * np.diagonal(m))
    k = k * np.outer(unit, unit)
    m = m * np.outer(unit, unit)
    values, vectors = np.linalg.eigh(m)
    heavy = values > 1e-12 * values[-1]
    light = vectors[:, ~heavy]
    loaded = vectors[:, heavy]
    across = light.T @ k @ loaded
    inner = light.T @ k @ light
    k = (
        loaded.T @ k @ loaded
        - across.T @ np.linalg.pinv(inner, rcond=1e-12, hermitian=True) @ across
    )
    squares = eigh(k, loaded.T @ m @ loaded, eigvals_only=True)
    squares[squares < (2 * np.pi * 0.5) ** 2] = (
        0.0  # rounding: no robot of the tests has modes below 0.5 Hz
    )
    return np.sqrt(squares) / (2 * np.pi)


def frame_mass(length, area, second, density=7850.0):
    """Consistent mass (12, 12) of a round frame element, x along it: textbook form, no rotary inertia of bending."""
    out = np.zeros((12, 12))
    whole = density * area * length
    out[0, 0] = out[6, 6] = whole / 3
    out[0, 6] = whole / 6
    polar = 2 * density * second * length
    out[3, 3] = out[9, 9] = polar / 3
    out[3, 9] = polar / 6
    for v, t, s in ((1, 5, 1.0), (2, 4, -1.0)):
        unit = whole / 420
        out[v, v] = out[v + 6, v + 6] = 156 * unit
        out[t, t] = out[t + 6, t + 6] = 4 * length**2 * unit
        out[v, v + 6] = 54 * unit
        out[min(v, t), max(v, t)] = s * 22 * length * unit
        out[v + 6, t + 6] = -s * 22 * length * unit
        out[v, t + 6] = -s * 13 * length * unit
        out[t, v + 6] = s * 13 * length * unit
        out[t, t + 6] = -3 * length**2 * unit
    return np.triu(out) + np.triu(out, 1).T
