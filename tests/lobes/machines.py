"""Machines for the stability of cuts: modes stated directly, without a robot."""

import numpy as np

from stiffscope.lobes.response import ToolResponse


def machine(frequencies, damping, shapes, *, frequency_error=0.0, damping_error=0.0):
    """Return a response of one pose from modes: Hz, ratios (m,), shapes (3, m), 1/√kg."""
    rates = 2.0 * np.pi * np.asarray(frequencies, dtype=float)[None]
    size = rates.shape
    return ToolResponse(
        squares=rates**2,
        damping=np.broadcast_to(np.asarray(damping, dtype=float), size).copy(),
        shapes=np.asarray(shapes, dtype=float)[None],
        remainder=np.zeros((1, 3, 3)),
        frequency_error=np.broadcast_to(frequency_error, size).astype(float),
        damping_error=np.broadcast_to(damping_error, size).astype(float),
    )


def spring_mass(stiffness, frequency, damping, direction=0):
    """Return one mode of a stiffness (N/m) along one axis."""
    shape = np.zeros((3, 1))
    shape[direction] = 2.0 * np.pi * frequency / np.sqrt(stiffness)
    return machine([frequency], damping, shape)


def flexible(rng, modes=3):
    """Return a random machine whose modes move the tool in all directions, between 80 and 700 Hz."""
    frequencies = np.sort(rng.uniform(80.0, 700.0, modes))
    stiffness = 10.0 ** rng.uniform(6.5, 7.5, modes)
    shapes = rng.normal(size=(3, modes))
    shapes[2] = 0.0
    shapes /= np.linalg.norm(shapes, axis=0)
    shapes *= 2.0 * np.pi * frequencies / np.sqrt(stiffness)
    return machine(frequencies, rng.uniform(0.01, 0.06, modes), shapes)
