"""Time-domain simulation of milling: delay differential equations, written from the forces.

Nothing of the package is used. Each mode is integrated exactly for a force that varies linearly
over a step; the tooth before left the surface that the tool had one tooth period earlier.
"""

import numpy as np


def grows(rates, damping, shapes, cuts, *, steps=160, periods=260, seed=3, waves=True):
    """Return whether vibrations grow (n,) in n cuts on one machine.

    Parameters
    ----------
    rates, damping, shapes
        Modes: rad/s (m,), ratios (m,), and shapes (2, m) along feed and normal, 1/√kg.
    cuts
        Arrays (n,) by name: teeth, start, end (rad), kt (Pa), kr, speed (rev/s), depth (m). A tool
        that does not rotate has its chip's ``normal`` and its ``force`` over kt (n, 2) instead.
    waves
        Whether the tooth before left its vibration on the surface.
    """
    n = len(cuts["speed"])
    delay = 1.0 / (cuts["teeth"] * cuts["speed"])
    step = delay / steps
    # exact propagation of q'' + 2 ζ ω q' + ω² q = f, f linear over a step
    free, held, ramp = propagators(rates, damping, step)
    rng = np.random.default_rng(seed)
    state = rng.normal(size=(n, len(rates), 2)) * np.array([1.0, 0.0])
    past = np.zeros((steps, n, 2))
    size = []
    place = state[..., 0] @ shapes.T
    force = np.zeros((n, 2))
    most = np.zeros(n)
    for period in range(periods):
        for k in range(steps):
            past[k] = place
            left = past[(k + 1) % steps] if waves else 0.0
            now = force @ shapes  # (n, m)
            angle = 2.0 * np.pi * cuts["speed"] * (k + 1) * step
            drift = np.einsum("nmab,nmb->nma", free, state) + held * now[..., None]
            guess = drift
            for _ in range(2):
                moved = guess[..., 0] @ shapes.T
                force_after = cutting(cuts, angle, moved - left)
                rise = (force_after - force) @ shapes
                guess = drift + ramp * rise[..., None]
            state = guess
            force = force_after
            place = state[..., 0] @ shapes.T
            most = np.maximum(most, np.abs(place).max(axis=1))
        size.append(most)
        scale = np.maximum(most, 1e-300)
        if period % 10 == 9:  # linear: rescale against overflow
            size = [each / scale for each in size]
            state = state / scale[:, None, None]
            past = past / scale[None, :, None]
            force = force / scale[:, None]
            place = place / scale[:, None]
        most = np.zeros(n)
    size = np.log(np.array(size))
    third = periods // 3
    return size[-third // 2 :].mean(axis=0) > size[third : third + third // 2].mean(
        axis=0
    )


def cutting(cuts, angle, apart):
    """Return the force (n, 2) of all teeth for displacements (n, 2) against the surface left."""
    if "normal" in cuts:
        chip = (apart * cuts["normal"]).sum(axis=1)
        return (cuts["kt"] * cuts["depth"] * chip)[:, None] * cuts["force"]
    out = np.zeros_like(apart)
    for tooth in range(int(cuts["teeth"].max())):
        turned = np.mod(angle + 2.0 * np.pi * tooth / cuts["teeth"], 2.0 * np.pi)
        inside = (turned > cuts["start"]) & (turned < cuts["end"])
        inside &= tooth < cuts["teeth"]
        chip = apart[:, 0] * np.sin(turned) + apart[:, 1] * np.cos(turned)
        tangential = np.where(inside, cuts["kt"] * cuts["depth"] * chip, 0.0)
        radial = cuts["kr"] * tangential
        out[:, 0] += -tangential * np.cos(turned) - radial * np.sin(turned)
        out[:, 1] += tangential * np.sin(turned) - radial * np.cos(turned)
    return out


def propagators(rates, damping, step):
    """Return exponentials (n, m, 2, 2), and responses (n, m, 2) to a held and a rising force."""
    from scipy.linalg import expm

    n = len(step)
    m = len(rates)
    free = np.zeros((n, m, 2, 2))
    held = np.zeros((n, m, 2))
    ramp = np.zeros((n, m, 2))
    for j in range(n):
        for k in range(m):
            matrix = np.zeros((4, 4))
            matrix[0, 1] = 1.0
            matrix[1, :3] = [-(rates[k] ** 2), -2.0 * damping[k] * rates[k], 1.0]
            matrix[2, 3] = 1.0 / step[j]
            whole = expm(matrix * step[j])
            free[j, k] = whole[:2, :2]
            held[j, k] = whole[:2, 2]
            ramp[j, k] = whole[:2, 3]
    return free, held, ramp
