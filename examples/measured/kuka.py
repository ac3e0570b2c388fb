"""Convert static deflections of a small arm under load (KUKA KR10 R1100).

The data belong to their authors; this script converts your own copy. From
https://github.com/joeycsare/Matlab-Masterarbeit download
`Legacy/Parameteridentification/Parameteridentifikation_daten_17_05_2022.m`, then

    python -m examples.measured.kuka Parameteridentifikation_daten_17_05_2022.m --out kuka
    stiffscope diagnose kuka --out kuka/diagnosis
"""

from __future__ import annotations

import argparse
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import tomlkit

from stiffscope.gap.campaign.writing import number_cells, write_campaign
from stiffscope.vjm.model.screws import rotation_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

SOURCE = """Geometry: the maker's drawing. Drives: guesses, all alike; nothing is published.
Readings: load cases of joeycsare/Matlab-Masterarbeit, converted from the authors' data, which are theirs."""
HOME = np.array([0.0, -90.0, 90.0, 0.0, 0.0, 0.0])  # deg: upper arm upright
AXES = np.array(
    [
        [0.0, 0.0, -1.0],
        [0.0, 1.0, 0.0],
        [0.0, 1.0, 0.0],
        [-1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [-1.0, 0.0, 0.0],
    ]
)
POINTS = 1e-3 * np.array(
    [[0, 0, 0], [25, 0, 400], [25, 0, 960], [540, 0, 995], [540, 0, 995], [620, 0, 995]]
)  # m
TOOL = np.array([0.7, 0.0, 0.995])  # m: 80 mm ahead of the flange
DRIVE = "60 kN*m/rad ± factor 5"  # a guess, for all
UNSEEN = 1e-4  # rad/(N·m): a drive that moves the tool by less than the rest, so soft, is not seen
SENSOR = np.array(
    [[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]]
)  # axes of the force sensor at home, columns in base axes: flange axes turned by 180°
_ROW = re.compile(r"^\s*e(\d+)_(\w+)\s*=\s*\[([^\]]*)\]", re.MULTILINE)


def read_cases(text: str) -> tuple[Array, Array, Array]:
    """Return joint angles (n, 6), rad from home, wrenches (n, 6), own axes, and displacements (n, 3), m."""
    found: dict[str, dict[int, list[float]]] = {}
    plain = "\n".join(line for line in text.splitlines() if line.lstrip()[:1] != "%")
    for number, word, cells in _ROW.findall(plain):
        found.setdefault(word, {})[int(number)] = [float(v) for v in cells.split(",")]
    numbers = sorted(found["joint"])
    joint, wrench, moved = (
        np.array([found[word][k] for k in numbers])
        for word in ("joint", "Anregung", "Abweichung")
    )
    return np.deg2rad(joint - HOME), wrench, 1e-3 * moved


def turn_flange(angles: Array) -> Array:
    """Return the rotation (3, 3) of the flange from home at joint angles (6,) from home."""
    out = np.eye(3)
    for axis, angle in zip(AXES, angles, strict=True):
        out = out @ rotation_of(angle * axis)
    return out


def write_robot(path: Path) -> None:
    """Write the arm as a robot file: rigid links without mass, since only loads are read."""
    data: dict[str, Any] = {"name": "kuka-kr10", "bodies": {}, "joints": {}}
    for k, (axis, at) in enumerate(zip(AXES, POINTS, strict=True)):
        data["bodies"][f"link{k + 1}"] = {}
        data["joints"][f"J{k + 1}"] = {
            "between": [f"link{k}" if k else "ground", f"link{k + 1}"],
            "type": "revolute",
            "at": at.tolist(),
            "axis": axis.tolist(),
            "drive": {"stiffness": DRIVE},
        }
    pose = ["x", "y", "z", "rx", "ry", "rz"]
    data["tool"] = {"body": "link6", "at": TOOL.tolist(), "pose": pose}
    head = "".join(f"# {line}\n" for line in SOURCE.splitlines())
    path.write_text(head + tomlkit.dumps(data), encoding="utf-8")


def convert(source: Path, folder: Path) -> int:
    """Write the campaign with its robot file; return the number of load cases."""
    angles, wrench, moved = read_cases(source.read_text(encoding="utf-8"))
    folder.mkdir(parents=True, exist_ok=True)
    write_robot(folder / "robot.toml")
    applied = np.array(
        [
            np.concatenate([turn @ own[:3], turn @ own[3:]])
            for turn, own in (
                (turn_flange(q) @ SENSOR, w)
                for q, w in zip(angles, wrench, strict=True)
            )
        ]
    )
    names = ("fx", "fy", "fz", "mx", "my", "mz")
    columns = {
        f"q:J{k + 1}": number_cells(np.repeat(angles[:, k], 3)) for k in range(6)
    }
    columns |= {
        name: number_cells(np.repeat(applied[:, k], 3)) for k, name in enumerate(names)
    }
    columns["quantity"] = ["dx", "dy", "dz"] * len(angles)
    columns["value"] = number_cells(moved.ravel())
    columns["sigma"] = [""] * moved.size
    write_campaign(folder, {"robot": "robot.toml"}, columns, comment=SOURCE)
    return len(angles)


def fit_drives(source: Path) -> tuple[Array, float, float, float]:
    """Return plain least squares of six drives, links rigid, for comparison.

    Returns
    -------
    tuple
        Stiffnesses (6,), N·m/rad, NaN if not seen; rms of a coordinate, m: before, after, and with each load case
        left out in turn.
    """
    from scipy.optimize import nnls  # pyright: ignore[reportMissingTypeStubs]

    angles, wrench, moved = read_cases(source.read_text(encoding="utf-8"))
    columns = np.array([_columns(q, w) for q, w in zip(angles, wrench, strict=True)])

    def fit(chosen: NDArray[np.int64]) -> Array:
        return nnls(columns[chosen].reshape(-1, 6), moved[chosen].ravel())[0]

    every = np.arange(len(angles), dtype=np.int64)
    found = fit(every)
    left_out = [moved[k] - columns[k] @ fit(every[every != k]) for k in every]
    sizes = (moved, moved - columns @ found, np.array(left_out))
    before, after, out = (float(np.sqrt(np.mean(np.square(each)))) for each in sizes)
    seen = np.linalg.norm(columns, axis=(0, 1)) * UNSEEN > after
    stiffness = np.full(6, np.nan)
    seen &= found > 0.0  # nonnegative least squares may leave a drive rigid
    stiffness[seen] = 1.0 / found[seen]
    return stiffness, before, after, out


def _columns(angles: Array, wrench: Array) -> Array:
    """Return displacement (3, 6) of the tool per compliance of each drive."""
    turn = np.eye(3)
    place = np.zeros(3)
    arms = []
    axes = []
    for axis, at, angle in zip(AXES, POINTS, angles, strict=True):
        here = turn @ at + place
        axes.append(turn @ axis)
        arms.append(here)
        turn = turn @ rotation_of(angle * axis)
        place = here - turn @ at
    tool = turn @ TOOL + place
    own = turn @ SENSOR
    levers = np.cross(axes, tool - np.array(arms))
    torque = levers @ (own @ wrench[:3]) + np.array(axes) @ (own @ wrench[3:])
    return (levers * torque[:, None]).T


def main() -> None:
    """Convert the load cases, and show what plain least squares finds."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("source", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    chosen = parser.parse_args()
    count = convert(chosen.source, chosen.out)
    stiffness, *sizes = fit_drives(chosen.source)
    drives = ", ".join(
        f"J{k + 1} not seen" if np.isnan(v) else f"J{k + 1} {v / 1e3:.3g}"
        for k, v in enumerate(stiffness)
    )
    rms = ", ".join(f"{1e3 * size:.3f}" for size in sizes)
    print(f"{count} load cases; least squares, kN·m/rad: {drives}")
    print(f"rms a coordinate, mm: before, after, each left out: {rms}")


if __name__ == "__main__":
    main()
