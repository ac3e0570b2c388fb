"""Inertias that no body can have, which MuJoCo refuses or replaces: kept as given, and told.

Many models carry placeholders on roots and cameras, or rounded exports slightly beyond A + B >= C.
Stiffness and sag need no inertia, so such a model is read: MuJoCo compiles it with a stand-in.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.robot.file.tables import list_some

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from stiffscope.runtime.types import Array

_ROUNDED = 1e-9  # of the largest moment: a smaller negative moment is rounding
_GROSS = 10.0  # beyond, or with a negative moment, a percentage says nothing
EXCESS = 1e-3  # relative: a robot file tolerates so much beyond A + B >= C


def set_aside_inertias(mj: Any, spec: Any) -> dict[int, Array]:
    """Replace impossible inertias of a spec's bodies by stand-ins; return them as given.

    The spec's own repair (``balanceinertia``), which replaces an inertia by its mean, is turned off.

    Returns
    -------
    dict
        Inertia (3, 3), kg·m², in the axes of each body, by index in ``spec.bodies``.
    """
    spec.compiler.balanceinertia = False
    aside: dict[int, Array] = {}
    for index, body in enumerate(spec.bodies):
        if not body.explicitinertial:
            continue
        full = np.array(body.fullinertia, dtype=float)
        given = np.diag(np.array(body.inertia, dtype=float))
        if np.isfinite(full[0]):
            given = _tensor(full)
        if not np.isfinite(given).all() or violation(given) <= 0.0:
            continue
        turn = _inertial_axes(mj, spec, body)
        aside[index] = turn @ given @ turn.T
        size = float(np.abs(given).max())
        if np.isfinite(full[0]):
            body.fullinertia = [size, size, size, 0.0, 0.0, 0.0]
        else:
            body.inertia = [size, size, size]
    return aside


def _inertial_axes(mj: Any, spec: Any, body: Any) -> Array:
    """Return the axes (3, 3) of a spec's inertial frame, as columns, in those of the body."""
    quaternion = body.iquat
    if body.ialt.type != mj.mjtOrientation.mjORIENTATION_QUAT:
        compiler = spec.compiler
        quaternion = spec.resolve_orientation(
            degree=compiler.degree, sequence=compiler.eulerseq, orientation=body.ialt
        )
    matrix = np.zeros(9)
    mj.mju_quat2Mat(matrix, np.array(quaternion, dtype=float))
    return matrix.reshape(3, 3)


def violation(inertia: Array) -> float:
    """Return by how much, relative, an inertia (3, 3) is beyond A + B >= C; 0 for that of a body.

    Infinite if a principal moment is negative.
    """
    least, middle, most = np.linalg.eigvalsh(inertia).tolist()
    if least < -_ROUNDED * max(abs(least), abs(most)):
        return np.inf
    excess = most - least - middle
    if excess <= _ROUNDED * most:
        return 0.0
    return excess / max(least + middle, 1e-300)


def describe_violations(names: Sequence[str], inertias: Iterable[Array]) -> str:
    """Return names, each with the size of its violation."""
    texts = []
    for name, inertia in zip(names, inertias, strict=True):
        excess = violation(inertia)
        size = f"{100 * excess:.2g} %" if excess < _GROSS else "grossly"
        texts.append(f"{name} ({size})")
    return list_some(texts)


def _tensor(full: Array) -> Array:
    xx, yy, zz, xy, xz, yz = full
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
