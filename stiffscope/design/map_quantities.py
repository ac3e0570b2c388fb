"""Scalar quantities for maps: principal stiffnesses, stiffness along a direction, error."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from stiffscope.runtime.types import Array

PRINCIPAL = {
    "worst": ("N m-1", "stiffness along the softest direction"),
    "best": ("N m-1", "stiffness along the stiffest direction"),
    "condition": ("1", "stiffest over softest direction"),
}


class Scalar(NamedTuple):
    """A quantity over poses, ``values`` of any shape, with its SI unit and name in words."""

    values: Array
    unit: str
    words: str


@dataclass(frozen=True)
class Wanted:
    """Quantities of a map besides the diagonal of K.

    Attributes
    ----------
    principal
        Keys of `PRINCIPAL`, for translations with free rotation of the tool.
    direction
        Direction (3,) in base axes for the stiffness against a force along it.
    wrench
        Wrench (6,) at M in base axes, N and N·m, for the size of the translation under it.
    """

    principal: tuple[str, ...] = ()
    direction: tuple[float, ...] | None = None
    wrench: tuple[float, ...] | None = None

    def evaluate(self, compliance: Array) -> dict[str, Scalar]:
        """Return the quantities (n,) of compliances (n, 6, 6); NaN if these are NaN."""
        translation = compliance[:, :3, :3]
        known = np.isfinite(translation).all(axis=(1, 2))
        yields = np.full((len(compliance), 3), np.nan)
        yields[known] = np.linalg.eigvalsh(translation[known])
        softest, stiffest = yields[:, 2], np.where(yields[:, 0] > 1e-12 * yields[:, 2], yields[:, 0], np.nan)
        each = {"worst": 1.0 / softest, "best": 1.0 / stiffest, "condition": softest / stiffest}
        out = {name: Scalar(each[name], *PRINCIPAL[name]) for name in self.principal}
        if self.direction is not None:
            unit = np.array(self.direction) / np.linalg.norm(self.direction)
            words = "stiffness along " + ", ".join(f"{x:.3g}" for x in self.direction)
            out["along"] = Scalar(1.0 / np.einsum("i,nij,j->n", unit, translation, unit), "N m-1", words)
        if self.wrench is not None:
            moved = compliance[:, :3] @ np.array(self.wrench)
            force, moment = (", ".join(f"{x:.4g}" for x in each) for each in (self.wrench[:3], self.wrench[3:]))
            words = f"error under ({force}) N" + (f", ({moment}) N·m" if any(self.wrench[3:]) else "")
            out["error"] = Scalar(np.linalg.norm(moved, axis=1), "m", words)
        return out
