"""An MJCF model in MuJoCo: its frequencies, its time step, its coordinates at poses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.linalg import cholesky, eigh, solve_triangular

from stiffscope.errors import InputError, expecting
from stiffscope.exports.mjcf_tree import quaternion
from stiffscope.vjm.model.screws import rotation_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stiffscope.exports.mjcf_tree import Coordinate
    from stiffscope.vjm.kinematics.configurations import Configurations
    from stiffscope.vjm.model.screws import Array

OLDEST = (4, 0)
_SHIFT = (2.0 * np.pi * 30.0) ** 2  # rad²/s², of all squared frequencies


def load_mujoco() -> Any:
    """Import MuJoCo. Raise InputError if it is missing or too old."""
    cure = "none; install it by: python -m pip install mujoco"
    with expecting("export", "the package mujoco", ImportError, got=cure):
        import mujoco
    version = tuple(int(word) for word in mujoco.__version__.split(".")[:2])
    if version < OLDEST:
        expected = "expected mujoco 4.0 or later, which knows all that the model needs"
        cure = "update it by: python -m pip install -U mujoco"
        raise InputError(f"export: {expected}, got {mujoco.__version__}; {cure}")
    return mujoco


def key_positions(
    mujoco: Any,
    model: Any,
    coordinates: Sequence[Coordinate],
    configurations: Configurations,
) -> Array:
    """Return the positions (n, nq) of an unloaded robot at poses."""
    data = mujoco.MjData(model)
    mujoco.mj_resetData(model, data)
    out = np.tile(data.qpos, (len(configurations), 1))
    values = {c.joint: configurations.coordinates(c.joint) for c in coordinates}
    for coordinate in coordinates:
        joint = model.joint(coordinate.name)
        start = int(joint.qposadr[0])
        value = values[coordinate.joint]
        if coordinate.turn is None:
            out[:, start] = value[:, coordinate.motion]
            continue
        for row, vector in enumerate(value):
            turned = coordinate.turn.T @ vector
            ball = quaternion(rotation_of(coordinate.sign * turned))
            out[row, start : start + 4] = ball
    return out


@dataclass(frozen=True, eq=False)
class Spectrum:
    """Of a model at a position: natural frequencies and tool compliance.

    ``frequencies`` (c,) in Hz, ascending, without free motions; ``compliance`` (6, 6) at the tool's
    site in base axes.
    """

    frequencies: Array
    compliance: Array


def find_spectrum(mujoco: Any, model: Any, position: Array, still: float) -> Spectrum:
    """Return the spectrum of an unloaded model at a position (nq,).

    Slower motions than ``still``, Hz, are free.
    """
    data = mujoco.MjData(model)
    data.qpos[:] = position
    mujoco.mj_forward(model, data)
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    limited = model.actuator_forcelimited.astype(bool)
    gains = -model.actuator_biasprm[: model.nu, 1]
    stiffness = spring_stiffness(model, data, np.where(limited, 0.0, gains))
    # Lowest first: springs that close loops are up to 1e6 times as stiff as the others. The shift
    # keeps free motions apart from infinite ones.
    whole = stiffness + _SHIFT * mass
    scale = 1.0 / np.sqrt(np.diagonal(whole))
    half = cholesky(whole * np.outer(scale, scale), lower=True)
    inner = solve_triangular(half, mass * np.outer(scale, scale), lower=True)
    inner = solve_triangular(half, inner.T, lower=True)
    inverse, shapes = eigh(0.5 * (inner + inner.T))
    inverse = inverse[::-1]
    shapes = scale[:, None] * solve_triangular(half.T, shapes[:, ::-1])
    firm = inverse < 1.0 / (_SHIFT + (2.0 * np.pi * still) ** 2)
    both = np.zeros((6, model.nv))
    site = model.site("tool").id
    mujoco.mj_jacSite(model, data, both[:3], both[3:], site)
    seen = both @ shapes[:, firm]
    shifted = 1.0 - _SHIFT * inverse[firm]
    moving = firm & (inverse > 0.0)
    squares = 1.0 / inverse[moving] - _SHIFT
    return Spectrum(np.sqrt(squares) / (2.0 * np.pi), (seen / shifted) @ seen.T)


def spring_stiffness(model: Any, data: Any, gains: Array) -> Array:
    """Return the stiffness (nv, nv) of joints, tendons and actuators (nu,) at a position."""
    out = np.zeros((model.nv, model.nv))
    for joint in range(model.njnt):
        at = model.jnt_dofadr[joint]
        count = 3 if model.jnt_type[joint] == 1 else 1
        out[range(at, at + count), range(at, at + count)] = model.jnt_stiffness[joint]
    tendons = np.zeros((model.ntendon, model.nv))
    for row in range(model.ntendon):
        start = model.tendon_adr[row]
        for k in range(start, start + model.tendon_num[row]):
            column = model.jnt_dofadr[model.wrap_objid[k]]
            tendons[row, column] = model.wrap_prm[k]
    out += tendons.T @ (model.tendon_stiffness[:, None] * tendons)
    moments = np.zeros((model.nu, model.nv))
    for row in range(model.nu):
        start = data.moment_rowadr[row]
        entries = slice(start, start + data.moment_rownnz[row])
        moments[row, data.moment_colind[entries]] = data.actuator_moment[entries]
    out += moments.T @ (gains[:, None] * moments)
    return 0.5 * (out + out.T)
