"""The paper's model of the Biglide: reading R1 of its equations, and upper bounds on the stiffness.

It supports `data/robots/biglide.toml` only and finds elements and parameters by the names there.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.errors import require, require_given
from stiffscope.gap.effects.elements import without_ranges
from stiffscope.vjm.model.mechanism import Change
from stiffscope.vjm.model.screws import Frame, rotation, shift
from stiffscope.vjm.statics.analysis import stiffness

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import ArrayLike

    from stiffscope.runtime.types import Array
    from stiffscope.vjm.model.mechanism import Mechanism

SIDES = {1: 1.0, 2: -1.0}  # x₁ = +1, x₂ = -1; limb 1 is the left limb
_LENGTHS = ("l", "l1", "l2", "h", "d", "a_min", "a_max")
_X, _Y, _ = np.eye(3)
_NEAR_SINGULAR = 1e-6  # rad; links parallel or perpendicular to the rail


@dataclass(frozen=True)
class Dimensions:
    """Dimensions of Tables 1 to 3 in m, named as there, and the carriage range, a_i = |O O_i|."""

    L: float
    l: float
    l1: float
    l2: float
    h: float
    d: float
    a_min: float
    a_max: float

    def tool_point(self, q: ArrayLike) -> Array:
        """Return the tool points (n, 3) in m at x = y = 0 for link angles (n,) in rad."""
        angle = np.atleast_1d(np.asarray(q, dtype=float))
        height = self.l1 + self.l2 + self.L * np.sin(angle)
        return height[:, None] * np.eye(3)[2]


@dataclass(frozen=True)
class PublishedModel:
    """Mechanism of the Biglide, with unlimited drive ranges, and the dimensions in its file."""

    mechanism: Mechanism
    dimensions: Dimensions

    @property
    def link(self) -> Array:
        """Compliance (6, 6) of a link at B_ij in its own axes."""
        return _read_elastic(self.mechanism, "limb1.link1")

    @property
    def drive(self) -> float:
        """Stiffness of a drive, N/m."""
        drive = self.mechanism.joint("limb1.actuator").drive
        return np.inf if drive is None else drive.stiffness

    def reading_r1(self, q: float) -> Array:
        """Return the published stiffness (6, 6) at M at a link angle ``q`` in rad, without gravity.

        Reading R1 of docs/theory.md 10.3: ``K_C⁰`` in the first bracket, the printed Jacobians for
        both limbs, a pseudo-inverse of the singular K_Pl, no slider, correct sign of wrench shifts.
        """
        parallelogram = self._parallelogram(q)
        values, vectors = np.linalg.eigh(parallelogram)
        significant = values > 1e-9 * values[-1]
        compliance = (vectors[:, significant] / values[significant]) @ vectors[
            :, significant
        ].T
        whole = np.zeros((6, 6))
        along_x, along_y = np.eye(6)[:2]
        for i, side in SIDES.items():
            axes = rotation(_Y, -q if i == 1 else q - np.pi)
            to_limb = shift([0.0, 0.0, self.dimensions.l2]) @ Frame(axes).adjoint()
            limb = (
                np.outer(along_x, along_x) / self.drive
                + to_limb @ compliance @ to_limb.T
            )
            back = shift([-side * self.dimensions.l, 0.0, 0.0])
            whole = whole + back.T @ np.linalg.inv(limb) @ back
        return np.linalg.inv(
            np.linalg.inv(whole) + np.outer(along_y, along_y) / self.drive
        )

    def _parallelogram(self, q: float) -> Array:
        """Return K_Pl (6, 6) of three links with the printed Jacobians (docs/theory.md 10.3)."""
        g = self.dimensions
        spring = np.linalg.inv(self.link)
        total = np.zeros((6, 6))
        for arm, foot in ((g.h, 0.0), (-g.h, g.d), (-g.h, -g.d)):
            lever = np.array([arm * np.cos(q), -foot, arm * np.sin(q)])
            back = shift(-lever)  # inverse of J_θ
            passive = np.zeros((6, 2))
            passive[0] = lever[2]
            passive[4] = 1.0
            passive[2] = [-lever[0] - g.L, -lever[0]]
            fixed = back.T @ spring @ back
            pull = fixed @ passive
            total = total + fixed - pull @ np.linalg.inv(passive.T @ pull) @ pull.T
        return total

    def bounds(self, q: ArrayLike) -> Array:
        """Return upper bounds (n, 6), SI, on the stiffness diagonal at M; link angles q (n,), rad.

        Compliance only lowers a stiffness, so a bound keeps only what every load path crosses:
        drives along x and y, links axially and sideways. K_ry is bounded by its value with rigid
        sliders, K_rx and K_rz by the bound on their sum.
        """
        q = np.atleast_1d(np.asarray(q, dtype=float))
        link = self.link
        drive = self.drive
        axial = 3.0 / link[0, 0]
        # 12 E I / L³: the end held against rotation
        sideways = 1.0 / (link[1, 1] - link[1, 5] ** 2 / link[5, 5])
        out = np.empty((len(q), 6))
        out[:, 0] = 2.0 * drive
        out[:, 1] = 1.0 / (1.0 / (6.0 * sideways) + 1.0 / drive)
        out[:, 2] = 2.0 * np.sin(q) ** 2 / (1.0 / axial + np.cos(q) ** 2 / drive)
        out[:, 4] = self._with_rigid_sliders(q)[:, 4, 4]
        out[:, [3, 5]] = self.rotational_bound
        return out

    @cached_property
    def rotational_bound(self) -> float:
        """Upper bound on ``K_rx + K_rz``, N·m/rad: its maximum in reach with rigid sliders."""
        g = self.dimensions
        most, least = (min(max(a - g.l, 0.0) / g.L, 1.0) for a in (g.a_max, g.a_min))
        angles = np.arccos(np.linspace(most, least, 200))
        inside = angles.clip(_NEAR_SINGULAR, np.pi / 2.0 - _NEAR_SINGULAR)
        matrix = self._with_rigid_sliders(inside)
        return float((matrix[:, 3, 3] + matrix[:, 5, 5]).max())

    def _with_rigid_sliders(self, q: Array) -> Array:
        machine = self.mechanism
        sliders = [f"limb{i}.slider" for i in SIDES]
        rigid = {name: Change(-_read_elastic(machine, name)) for name in sliders}
        return stiffness(machine.change_elements(rigid), self.dimensions.tool_point(q))


def published_model(
    mechanism: Mechanism, parameters: Mapping[str, float]
) -> PublishedModel:
    """Return the published model of a Biglide mechanism; raise InputError for any other robot."""
    what = f"{', '.join(_LENGTHS)} of the Biglide"
    for name in _LENGTHS:
        require(name in parameters, "parameters", what, f"no {name}")
    link = mechanism.body("limb1.link1").elastic
    link = require_given(link, "bodies.limb1.link1", "an elastic body", "a rigid one")
    length = float(np.linalg.norm(link.tip - link.base))
    dimensions = Dimensions(L=length, **{name: parameters[name] for name in _LENGTHS})
    return PublishedModel(without_ranges(mechanism), dimensions)


def _read_elastic(mechanism: Mechanism, name: str) -> Array:
    """Return the compliance (6, 6) of a body; zero if it is rigid."""
    body = mechanism.body(name).elastic
    return np.zeros((6, 6)) if body is None else body.compliance
