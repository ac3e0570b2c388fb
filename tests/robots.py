"""The paper's robot with published matrices, and random components."""

import tomllib
from pathlib import Path

import numpy as np

from stiffscope.vjm.biglide import Biglide, Geometry, reachable

DATA = Path(__file__).parents[1] / "data" / "published"
GEOMETRY = Geometry(L=0.5, l=0.075, l1=0.04, l2=0.015, h=0.0175, d=0.07)
DRIVE = 1.27e7


def euler_bernoulli(length=0.5, radius=0.0125, e=211e9, g=81e9):
    """Eq. (28)."""
    area, inertia = np.pi * radius**2, np.pi * radius**4 / 4
    c = np.diag([length / (e * area), *[length**3 / (3 * e * inertia)] * 2, length / (2 * g * inertia)] + [0.0] * 2)
    c[4, 4] = c[5, 5] = length / (e * inertia)
    c[1, 5] = c[5, 1] = length**2 / (2 * e * inertia)
    c[2, 4] = c[4, 2] = -c[1, 5]
    return c


def published_slider():
    content = tomllib.loads((DATA / "slider.toml").read_text())
    return np.array(content["compliance"]) * content["unit"]


def random_compliance(rng, like):
    """A full symmetric positive definite matrix of the size of ``like``."""
    a = rng.normal(size=(6, 6))
    scale = np.sqrt(np.diagonal(like))
    return (a @ a.T / 6 + 0.1 * np.eye(6)) * np.outer(scale, scale)


def random_poses(rng, n, geometry=GEOMETRY):
    points = np.column_stack(
        [rng.uniform(-0.17, 0.17, 20 * n), rng.uniform(-0.3, 0.3, 20 * n), rng.uniform(0.21, 0.54, 20 * n)]
    )
    return points[reachable(geometry, points)][:n]


def published_robot():
    return Biglide(GEOMETRY, euler_bernoulli(), published_slider(), DRIVE, link_mass=1.95, platform_mass=7.93)
