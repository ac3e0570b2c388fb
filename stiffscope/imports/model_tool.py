"""The tool of a simulator's model: body, point, and the coordinates that the mechanism moves."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.errors import require
from stiffscope.imports.compiled_model import GROUND

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stiffscope.imports.compiled_model import CompiledModel
    from stiffscope.runtime.types import Array

_SITES = [
    "attachment_site",
    "tcp",
    "tool",
    "tool0",
    "ee",
    "ee_site",
    "end_effector",
    "pinch",
    "grip_site",
]


def find_tool(source: CompiledModel, wanted: str | None) -> tuple[int, Array, str]:
    """Return the tool's body, point (3,) and description: as wanted, a usual site or last body."""
    m = source.model
    d = source.data
    sites = source.labels("site", m.nsite)
    bodies = source.labels("body", m.nbody, 1)
    known = wanted is None or wanted in sites or wanted in bodies
    expected = f"a body or site of {source.path} ({', '.join([*sites, *bodies])})"
    require(known, f"--tool {wanted}", expected, f'"{wanted}"')
    for name in (wanted,) if wanted else _SITES:
        if name in sites and source.mover(int(m.site_bodyid[sites[name]])) != GROUND:
            body = int(m.site_bodyid[sites[name]])
            return body, d.site_xpos[sites[name]].copy(), f'site "{name}" of the source'
    body = bodies[wanted] if wanted in bodies else _last_body(source)
    got = wanted or "a model whose bodies are all fixed"
    moves = source.mover(body) != GROUND
    require(moves, source.path, "a tool that moves", got)
    return (
        body,
        d.xpos[body].copy(),
        f'body "{source.label("body", body)}" of the source',
    )


def _last_body(source: CompiledModel) -> int:
    """Return the body where most chains end: by number of closures, then by depth in the tree."""
    m = source.model
    depth = np.zeros(m.nbody, dtype=int)
    for body in range(1, m.nbody):
        depth[body] = depth[m.body_parentid[body]] + 1
    ends = [
        end for number in source.closures() for end in source.closure_ends(number)[:2]
    ]
    joined = [ends.count(source.mover(body)) > 1 for body in range(m.nbody)]
    return max(
        range(1, m.nbody),
        key=lambda body: (joined[body], depth[body], -body),
        default=0,
    )


def movable_coordinates(
    source: CompiledModel, body: int, at: Array, held: Sequence[int] = ()
) -> tuple[str, ...]:
    """Return the coordinates of a body's point (3,), m, that the mechanism moves, x y z first.

    ``held``: degrees of freedom of floating bodies, which are fixed to the ground.
    """
    m = source.model
    d = source.data
    jacobian = _jacobian(source, d, body, at)
    _, closures = source.equality_rows(closures_only=True)
    stopped = np.eye(m.nv)[list(held)]
    rows = np.vstack([closures.reshape(-1, m.nv), stopped])
    basis = np.eye(m.nv)
    if rows.size:
        _, sizes, rows = np.linalg.svd(rows)
        basis = rows[(sizes > 1e-9 * sizes[0]).sum() :].T
    chosen = choose_coordinates(jacobian @ basis)
    count = len(chosen)
    got = "one that joints and loops hold; choose another with --tool"
    require(count, source.path, "a tool that moves", got)
    if (
        not closures.size
        and count < min(6, m.nv - len(held))
        and _nearby_rank(source, body, at, held) > count
    ):
        why = "the tool moves in more directions elsewhere; choose another with --home"
        source.notes.append(f"home is singular: {why}")
    return chosen


def choose_coordinates(motions: Array) -> tuple[str, ...]:
    """Return the coordinates that twists (6, k) move independently, translations first."""
    chosen: list[int] = []
    for coordinate in range(6):
        rows = motions[[*chosen, coordinate]]
        if len(rows) <= motions.shape[1] and np.linalg.svd(rows)[1].min() > 1e-6:
            chosen.append(coordinate)
    return tuple(("x", "y", "z", "rx", "ry", "rz")[direction] for direction in chosen)


def _jacobian(source: CompiledModel, data: Any, body: int, at: Array) -> Array:
    jacobian = np.zeros((6, source.model.nv))
    source.mj.mj_jac(source.model, data, jacobian[:3], jacobian[3:], at, body)
    return jacobian


def _nearby_rank(
    source: CompiledModel, body: int, at: Array, held: Sequence[int]
) -> int:
    """Return the number of directions in which an open chain's tool moves at a pose near home."""
    m = source.model
    here = source.data
    near = source.mj.MjData(source.model)
    near.qpos[:] = here.qpos
    step = np.random.default_rng(0).normal(0.0, 0.1, m.nv)
    step[list(held)] = 0.0
    source.mj.mj_integratePos(m, near.qpos, step, 1.0)
    source.mj.mj_kinematics(m, near)
    source.mj.mj_comPos(m, near)
    turn = near.xmat[body].reshape(3, 3) @ here.xmat[body].reshape(3, 3).T
    point = near.xpos[body] + turn @ (at - here.xpos[body])
    jacobian = np.delete(_jacobian(source, near, body, point), list(held), axis=1)
    return int(np.linalg.matrix_rank(jacobian, tol=1e-6))
