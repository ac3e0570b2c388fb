"""MuJoCo on its own: settle an exported model and read the tool, without the code under test."""

import mujoco
import numpy as np
from scipy.linalg import eigh

STEP = 1e-7  # m, rad
IDLE = (2.0 * np.pi * 0.5) ** 2  # squared frequency of motions without stiffness


def forces(model, data, wrench=None):
    """Return the generalized forces (nv,) at rest, under a wrench on the tool at its site."""
    data.qvel[:] = 0.0
    mujoco.mj_forward(model, data)
    out = data.qfrc_passive + data.qfrc_actuator - data.qfrc_bias
    if wrench is not None:
        site = model.site("tool").id
        body = model.site_bodyid[site]
        at = data.site_xpos[site].copy()
        mujoco.mj_applyFT(model, data, wrench[:3], wrench[3:], at, body, out)
    return out


def stiffness(model, data, wrench=None):
    """Return K (nv, nv) by differences of MuJoCo's own forces."""
    base = data.qpos.copy()
    out = np.zeros((model.nv, model.nv))
    for column, step in enumerate(STEP * np.eye(model.nv)):
        both = []
        for sign in (1.0, -1.0):
            data.qpos[:] = base
            mujoco.mj_integratePos(model, data.qpos, step, sign)
            both.append(forces(model, data, wrench))
        out[:, column] = (both[1] - both[0]) / (2.0 * STEP)
    data.qpos[:] = base
    mujoco.mj_forward(model, data)
    return out


def mass_matrix(model, data):
    """Return M (nv, nv)."""
    out = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, out)
    return out


def frequencies(model, data):
    """Return the natural frequencies in Hz, ascending, without free motions and gravity."""
    gravity = model.opt.gravity.copy()
    model.opt.gravity[:] = 0.0
    k = stiffness(model, data)
    model.opt.gravity[:] = gravity
    squares = eigh(0.5 * (k + k.T), mass_matrix(model, data), eigvals_only=True)
    return np.sqrt(squares[squares > IDLE]) / (2.0 * np.pi)


def growth(model, data):
    """Return the spectral radius of a step at its own size about a position, by MuJoCo itself."""
    size = 2 * model.nv + model.na
    transition = np.zeros((size, size))
    mujoco.mj_forward(model, data)
    mujoco.mjd_transitionFD(model, data, 1e-7, True, transition, None, None, None)
    return np.abs(np.linalg.eigvals(transition)).max()


def place(data):
    """Return place and rotation of the tool."""
    site = data.site("tool")
    return site.xpos.copy(), site.xmat.reshape(3, 3).copy()


def balance(model, data, wrench=None, rounds=8):
    """Move a model to its static equilibrium by Newton's method; return the tool's place."""
    for _ in range(rounds):
        force = forces(model, data, wrench)
        k = stiffness(model, data, wrench)
        squares, shapes = eigh(0.5 * (k + k.T), mass_matrix(model, data))
        firm = squares > IDLE
        step = shapes[:, firm] @ ((shapes[:, firm].T @ force) / squares[firm])
        mujoco.mj_integratePos(model, data.qpos, step, 1.0)
        if np.abs(step).max() < 1e-10:
            break
    mujoco.mj_forward(model, data)
    return place(data)


def settle(model, data, wrench=None, most=100_000):
    """Step a model at its own time step, stopped at each peak of its kinetic energy, until it rests."""
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    site = model.site("tool").id
    body = model.site_bodyid[site]
    before = 0.0
    largest = 0.0
    for _ in range(most):
        data.qfrc_applied[:] = 0.0
        if wrench is not None:
            force = data.qfrc_applied
            at = data.site_xpos[site].copy()
            mujoco.mj_applyFT(model, data, wrench[:3], wrench[3:], at, body, force)
        mujoco.mj_step(model, data)
        now = data.energy[1]
        if now < before:
            largest = max(largest, before)
            data.qvel[:] = 0.0
            if before < 1e-10 * largest:
                break
            now = 0.0
        before = now
    mujoco.mj_forward(model, data)
    return place(data)


def twist(before, after):
    """Return the twist (6,) between two places, small."""
    turn = after[1] @ before[1].T
    axis = 0.5 * np.array(
        [turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]
    )
    return np.concatenate([after[0] - before[0], axis])
