"""Joints of an assembly as a user says them, over those that its contacts make."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from stiffscope.errors import InputError
from stiffscope.robot.imports.contact_joints import Freedom, measure_size
from stiffscope.vjm.joints import FREE
from stiffscope.vjm.subspaces import null_space

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stiffscope.cad.assembly import Instance
    from stiffscope.cad.contacts import Contact
    from stiffscope.runtime.types import Array


def as_said(
    joints: Sequence[Freedom], said: Sequence[str], solids: Sequence[Instance], contacts: Sequence[Contact]
) -> list[Freedom]:
    """Joints with those that a user names as "A/B=KIND" or "A/B=none" in place of what was found.

    Raises InputError for what names no two solids in contact, or no kind of joint.
    """
    found = list(joints)
    scale = measure_size(solids)
    names = {solid.name: number for number, solid in enumerate(solids)}
    for text in said:
        pair, _, kind = (each.strip() for each in text.rpartition("="))
        first, _, second = (each.strip() for each in pair.partition("/"))
        if kind not in {*FREE, "none"} or first not in names or second not in names:
            kinds = ", ".join((*FREE, "none"))
            raise InputError(f'--joint {text}: expected A/B=KIND, two solids and one of {kinds}, got "{text}"')
        i, j = names[first], names[second]
        here = [joint for joint in found if {joint.first, joint.second} == {i, j}]
        found = [joint for joint in found if joint not in here]
        if kind == "none":
            continue
        touching = [c for c in contacts if {c.first, c.second} == {i, j}]
        if not here and not touching:
            raise InputError(
                f'--joint {text}: expected two solids that touch, got "{first}" and "{second}", which do not'
            )
        found.append(_as_kind(kind, i, j, here, touching, scale))
    return found


def _as_kind(kind: str, i: int, j: int, here: Sequence[Freedom], touching: Sequence[Contact], scale: float) -> Freedom:
    """A joint of a kind, where the one found is, else at the largest contact."""
    best = max(touching, key=lambda c: (c.kind != "plane", c.size), default=None)
    if here:
        at, axis, axis2, faces = here[0].at, here[0].axis, here[0].axis2, here[0].faces
        first, second = here[0].first, here[0].second
    else:
        at, axis, axis2, first, second = np.zeros(3), None, None, i, j
        faces = tuple(tuple(sorted({c.face_of(n) for c in touching})) for n in (i, j))
    if best is not None and (axis is None or not here):
        at, axis = best.point, best.axis
    return Freedom(
        first,
        second,
        kind,
        at,
        axis,
        axis2,
        "as said",
        (faces[0], faces[1]),
        _freedom_of(kind, at / scale, axis, axis2),
    )


def _freedom_of(kind: str, at: Array, axis: Array | None, axis2: Array | None) -> Array:
    """Twists (6, k) at the base origin that a joint leaves free."""
    x = np.array([1.0, 0.0, 0.0]) if axis is None else axis
    across = null_space(x[None, :])
    axes = np.column_stack((x, across if axis2 is None else np.column_stack((axis2, across[:, :1]))))
    columns = []
    for component in FREE[kind]:
        direction = axes[:, component % 3]
        line, turn = (direction, np.zeros(3)) if component < 3 else (np.cross(at, direction), direction)
        columns.append(np.concatenate((line, turn)))
    return np.column_stack(columns) if columns else np.zeros((6, 0))
