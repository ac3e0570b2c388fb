"""What a robot file says at home, worked out without `stiffscope.vjm`: all bodies' twists at the origin, joints as
constraints, one saddle-point system."""

from dataclasses import dataclass

import numpy as np

from stiffscope.robot.file.description import RobotFile

FREE = {
    "fixed": [],
    "revolute": [3],
    "prismatic": [0],
    "cylindrical": [0, 3],
    "universal": [3, 4],
    "spherical": [3, 4, 5],
    "planar": [1, 2, 3],
}


def to_point(p):
    """(6, 6): twist at the origin to twist at p."""
    s = np.array([[0, -p[2], p[1]], [p[2], 0, -p[0]], [-p[1], p[0], 0]])
    return np.block([[np.eye(3), -s], [np.zeros((3, 3)), np.eye(3)]])


def frame(x, y=None):
    """Rows: axes along x, y as near to y as can be."""
    x = np.array(x) / np.linalg.norm(x)
    y = np.eye(3)[np.argmin(np.abs(x))] if y is None else np.array(y)
    y = y - x * (x @ y)
    y /= np.linalg.norm(y)
    return np.array([x, y, np.cross(x, y)])


def double(r):
    return np.kron(np.eye(2), r)


@dataclass
class Connector:
    first: str
    second: str
    rows: np.ndarray  # (m, 6): relative twist at the origin to what is held
    compliance: np.ndarray  # (m, m)


def connectors(robot: RobotFile, matrices, *, driven=True, rigid=False):
    for name, body in robot.elastic_bodies().items():
        axes = frame(np.subtract(body.tip, body.base), body.y)
        c = np.zeros((6, 6)) if rigid else matrices[body.part]
        yield Connector(
            f"{name}.base",
            f"{name}.tip",
            double(axes) @ to_point(np.array(body.tip)),
            c,
        )
    for joint in robot.joints.values():
        axis = getattr(joint, "axis", None)
        axis2 = getattr(joint, "axis2", None)
        drive = getattr(joint, "drive", None) if driven else None
        rows = double(np.eye(3) if axis is None else frame(axis, axis2)) @ to_point(
            np.array(joint.at)
        )
        c = joint.yielding(np.eye(3))
        held = [i for i in range(6) if i not in FREE[joint.type]]
        if drive is not None:
            along = FREE[joint.type][0]
            held = sorted([*held, along])
            c[along, along] = 0.0 if rigid else 1 / drive.stiffness
        yield Connector(*joint.between, rows[held], c[np.ix_(held, held)])


def system(robot, matrices, **how):
    links = list(connectors(robot, matrices, **how))
    names = sorted(
        {n for link in links for n in (link.first, link.second)} - {"ground"}
    )
    blocks = []
    c = []
    for link in links:
        a = np.zeros((len(link.rows), 6 * len(names)))
        for node, sign in ((link.first, -1), (link.second, 1)):
            if node != "ground":
                a[:, 6 * names.index(node) :][:, :6] += sign * link.rows
        blocks.append(a)
        c.append(link.compliance)
    return names, np.vstack(blocks), c


def tool_rows(robot, names):
    rows = np.zeros((6, 6 * len(names)))
    rows[:, 6 * names.index(robot.tool.body) :][:, :6] = to_point(
        np.array(robot.tool.at)
    )
    return rows


def compliance(robot: RobotFile, matrices) -> np.ndarray:
    """(6, 6) of the tool at home, base axes, unloaded; `matrices`: part to (6, 6)."""
    names, a, c = system(robot, matrices)
    tool = tool_rows(robot, names)
    m, n = a.shape
    whole = np.zeros((n + m, n + m))
    whole[:n, n:] = a.T
    whole[n:, :n] = a
    at = n
    for block in c:
        whole[at : at + len(block), at : at + len(block)] = -block
        at += len(block)
    scale = np.concatenate([np.full(n, 1e-3), np.full(m, 1e3)])  # metres beside newtons
    scaled = whole * np.outer(scale, scale)
    right = np.vstack([tool.T, np.zeros((m, 6))]) * scale[:, None]
    found = np.linalg.lstsq(scaled, right, rcond=1e-13)[0]
    assert np.abs(scaled @ found - right).max() < 1e-6 * np.abs(right).max(), (
        "the tool moves freely"
    )
    return tool @ (found * scale[:, None])[:n]


def motions(robot: RobotFile, *, driven: bool) -> np.ndarray:
    """(6, k): an orthonormal basis of the tool's rigid motions at home, drives held or free."""
    names, a, _ = system(robot, {}, driven=driven, rigid=True)
    _, s, vt = np.linalg.svd(a)
    null = vt[(s > 1e-9 * s[0]).sum() :].T
    q, r, _ = np.linalg.svd(tool_rows(robot, names) @ null)
    return q[:, : (r > 1e-7).sum()]
