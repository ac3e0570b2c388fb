"""Responses of a study: expressions over quantities of the robot and its parts at tool poses."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.errors import naming
from stiffscope.robot.part_matrices import part_sources
from stiffscope.vjm.model.mechanism import COORDINATES, DIAGONAL
from stiffscope.vjm.statics import analysis as statics
from stiffscope.vjm.vibration.modes import frequencies

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping

    from stiffscope.path.job import Job
    from stiffscope.robot.file.description import RobotFile
    from stiffscope.robot.file.expressions import Expression
    from stiffscope.robot.part_matrices import PartMatrix
    from stiffscope.vjm.kinematics.configurations import Configurations
    from stiffscope.vjm.model.mechanism import Mechanism

MOST_MODES = 12  # number of modes computed, including free motions
FREE = 1e-3  # Hz; lower modes are free motions
_ENTRY = {
    "K": (("N/m", "N"), ("N", "N*m/rad")),
    "C": (("m/N", "1/N"), ("1/N", "rad/(N*m)")),
}
_TAKE: dict[str, Callable[[np.ndarray], Any]] = {
    "least": np.min,
    "greatest": np.max,
    "mean": np.mean,
    "worst": lambda each: np.max(np.abs(each)),
    "rms": lambda each: np.sqrt(np.mean(each**2)),
}
CRITICAL = "critical_depth"
"""Depth of cut, m, that is stable at all speeds of the job's range."""
ALONG_PATH: tuple[str, ...] = ("error", "normal", "along", "binormal", CRITICAL)
"""Size of the error on a path and its parts, and stable depth of cut, m."""


@dataclass(frozen=True)
class Response:
    """An expression over quantities, reduced over some of the study's poses.

    ``take``: "least", "greatest", "mean", "worst" (largest absolute value) or "rms". With a
    ``job``, the quantities are those of `ALONG_PATH`, and the poses are points of its path.
    """

    name: str
    expression: Expression
    unit: str
    poses: tuple[int, ...]
    take: str
    job: Job | None = None

    @property
    def column(self) -> str:
        """Name with unit."""
        return f"{self.name} [{self.unit}]"

    def value(self, known: Mapping[str, np.ndarray]) -> float:
        """Return the value from quantities (n,) at all poses. Raise InputError if undefined."""
        names = self.expression.names
        rows = ({name: float(known[name][k]) for name in names} for k in self.poses)
        with naming(self.name):
            values = [self.expression.value(row) for row in rows]
        return float(_TAKE[self.take](np.array(values)))


def _entries() -> dict[str, tuple[str, int, int, str]]:
    """Return matrix, row, column and unit of the entries of K and C by name."""
    entries = {}
    for i, name in enumerate(DIAGONAL):
        entries[name] = ("K", i, i, _ENTRY["K"][i // 3][i // 3])
    for matrix, units in _ENTRY.items():
        for i in range(6):
            for j in range(6):
                entries[f"{matrix}{i + 1}{j + 1}"] = (
                    matrix,
                    i,
                    j,
                    units[i // 3][j // 3],
                )
    short = zip(COORDINATES, DIAGONAL, strict=True)
    return entries | {f"k{axis}": entries[name] for axis, name in short}


ENTRIES = _entries()


def known_units(robot: RobotFile) -> dict[str, str]:
    """Return the SI unit of every quantity that an expression may use.

    K_tx … K_rz (also kx … krz), K11 … K66, C11 … C66 of the robot at M; sag (its length), sag_x,
    sag_y, sag_z by own weight; f1 … f12, Hz, drives held; mass of solids; PART.C11 …, PART.mass.
    """
    parts = [name for name in part_sources(robot) if re.fullmatch(r"[^\W\d]\w*", name)]
    entries = {
        entry: unit for entry, (matrix, *_, unit) in ENTRIES.items() if matrix == "C"
    }
    return {
        "mass": "kg",
        **{name: unit for name, (*_, unit) in ENTRIES.items()},
        **dict.fromkeys(("sag", "sag_x", "sag_y", "sag_z"), "m"),
        **{f"f{k + 1}": "Hz" for k in range(MOST_MODES)},
        **{f"{name}.mass": "kg" for name in parts},
        **{
            f"{name}.{entry}": unit for name in parts for entry, unit in entries.items()
        },
    }


def worst_of(quantity: str) -> str:
    """Return the worst case over poses: "least" for stiffness, frequency and stable depth.

    Of other quantities it is "greatest".
    """
    name = quantity.rpartition(".")[2]
    least = name == CRITICAL or re.match(r"(K|k|f)", name)
    return "least" if least else "greatest"


def of_modes(quantity: str) -> bool:
    """Return whether a quantity is a natural frequency."""
    return re.fullmatch(r"f\d+", quantity) is not None


def quantities(
    names: Collection[str],
    mechanism: Mechanism,
    configurations: Configurations,
    parts: Mapping[str, PartMatrix],
    mass: float,
) -> dict[str, np.ndarray]:
    """Compute quantities (n,) at n configurations by their names in `known_units`.

    Parameters
    ----------
    names, mechanism, configurations
        Names of the quantities, and mechanism with its n configurations.
    parts, mass
        The parts' matrices by name, and mass of the robot's solids, kg.
    """
    n = len(configurations)
    out: dict[str, np.ndarray] = {}
    wanted = {ENTRIES[name][0] for name in names if name in ENTRIES}
    matrices = {"K": statics.stiffness, "C": statics.compliance}
    tool = {kind: matrices[kind](mechanism, configurations) for kind in wanted}
    sag = (
        statics.sag(mechanism, configurations)
        if any(name.startswith("sag") for name in names)
        else None
    )
    modes = None
    if any(map(of_modes, names)):
        each = frequencies(mechanism, configurations, MOST_MODES)
        modes = np.sort(np.where(each > FREE, each, np.nan), axis=1)  # NaN last
    for name in names:
        part, _, entry = name.rpartition(".")
        kind, i, j, _ = ENTRIES.get(entry, ("", 0, 0, ""))
        if entry == "mass":
            out[name] = np.full(n, parts[part].mass if part else mass)
        elif part:
            out[name] = np.full(n, parts[part].compliance[i, j])
        elif kind:
            out[name] = tool[kind][:, i, j]
        elif sag is not None and name.startswith("sag"):
            size = np.linalg.norm(sag[:, :3], axis=1)
            out[name] = size if name == "sag" else sag[:, "xyz".index(name[-1])]
        elif modes is not None:
            out[name] = modes[:, int(name[1:]) - 1]
    return out
