"""Convert data of a construction robot on seven grounds: tilt of base and column, prism positions.

The data belong to their authors (CC BY-NC-SA 3.0); this script converts your own copy. Download
`data` of https://github.com/Hilti-Research/construction_robot_stationing_datasets, then

    python -m examples.measured.hilti construction_robot_stationing_datasets/data --ground pallet --out hilti
    stiffscope campaign check hilti/pallet/fit
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit
import yaml

from examples.measured.arm import split_postures
from stiffscope.gap.campaign.writing import number_cells, write_campaign
from stiffscope.imports.import_model import import_model

SOURCE = """Geometry and masses: trailblazer.urdf of Hilti-Research/construction_robot_stationing_datasets, from CAD.
Drives: guesses, nothing is published. Standard uncertainties: the authors', from datasheets.
Converted from the authors' dataset, which is theirs."""
JOINTS = (
    "column_middle_joint",
    "column_top_joint",
    *(f"dsr_joint{k}" for k in range(1, 7)),
)
MASS = "± 2 %"
COLUMN = "20 N/um"
DRIVE = "100 kN*m/rad ± factor 5"  # CAD masses; guesses
LEVEL = {
    "rx": 1.03e-6,
    "ry": 1.12e-6,
}  # rad/(N·m): level ground, tilt per moment, other heights
PRISM = 0.75e-3
AT_PRISM = 5e-3
TILT = 4.3610059e-4 / 9.81  # m, m, rad
INERTIAL = {"measures": "rotation", "zero": "session"}


def read_postures(
    data: Path, ground: str, height: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return joint positions (n, 8) and readings (n, 7): base and column tilt, rad; prism, m."""
    heights = yaml.safe_load(
        (data / "datasets" / f"{ground}.yaml").read_text(encoding="utf-8")
    )["column_heights"]
    stations = heights[height]["solution_spaces"].values()
    rows = [
        m
        for s in stations
        for kind in ("stationing", "evaluation")
        for m in s[f"{kind}_measurements"]
    ]
    joints = np.array([row["joint_states"] for row in rows])
    column = 0.5 * joints[:, :1] - [0.706, 0.736]  # both segments extend equally
    up = np.array(
        [
            [row["tilt_sensor_base_accel"], row["tilt_sensor_column_accel"]]
            for row in rows
        ]
    )
    turns = np.stack([up[..., 1], -up[..., 0]], axis=2) / up[..., 2:]
    prism = np.array([row["prism_position"] for row in rows])
    return np.hstack([column, joints[:, 1:]]), np.hstack([turns.reshape(-1, 4), prism])


def write_robot(urdf: Path, height: float, home: np.ndarray, path: Path) -> list[float]:
    """Write the robot file at joint positions (8,) and a column height; return the prism, m."""
    path.unlink(missing_ok=True)
    drives = ("column_*_joint=20 N/um", "dsr_joint?=100 kN*m/rad")
    import_model(
        urdf,
        path,
        drives,
        "prism",
        [
            f"{n}={q:.17g}"
            for n, q in zip(
                ("column_prismatic_joint", *JOINTS), (height, *home), strict=True
            )
        ],
    )
    robot: Any = tomlkit.parse(path.read_text(encoding="utf-8"))
    del (
        robot["bodies"]["column_pseudo_tip"],
        robot["joints"]["column_prismatic_joint"],
    )  # the sum of its two segments
    for body in robot["bodies"].values():
        body["mass"] = f"{body['mass']} kg {MASS}"
    for name, joint in robot["joints"].items():
        joint["drive"] = {"stiffness": DRIVE if name.startswith("dsr") else COLUMN}
    robot["effects"] = [
        {"effect": "base-compliance", "place": "base", "parameters": LEVEL}
    ]
    path.write_text(
        "".join(f"# {line}\n" for line in SOURCE.splitlines()) + tomlkit.dumps(robot),
        encoding="utf-8",
    )
    return [float(v) for v in robot["tool"]["at"]]


def convert(data: Path, ground: str, height: float, folder: Path) -> int:
    """Write the campaigns `fit` and `held-out` (every fifth posture) of a ground and column height.

    Return the number of postures.
    """
    joints, seen = read_postures(data, ground, height)
    home = read_postures(data, "flat", height)[0][0]
    names = [
        *(f"{body}-{axis}" for body in ("base", "column") for axis in "xy"),
        *(f"prism.{axis}" for axis in "xyz"),
    ]
    for name, chosen in zip(
        ("fit", "held-out"), split_postures(len(joints)), strict=True
    ):
        (folder / name).mkdir(parents=True, exist_ok=True)
        at = write_robot(
            data / "trailblazer.urdf",
            home[0] + home[1] + 1.442,
            home,
            folder / name / "robot.toml",
        )
        sensors: dict[str, Any] = {
            f"{body}-{axis}": {
                **INERTIAL,
                "body": on,
                "direction": np.eye(3)["xy".index(axis)].tolist(),
            }
            for body, on in (("base", "ground"), ("column", "column_top"))
            for axis in "xy"
        }
        sensors["prism"] = {
            "measures": "position",
            "frame": "station",
            "body": "dsr_link6",
            "at": at,
            "at_sigma": AT_PRISM,
        }
        header = {
            "robot": "robot.toml",
            "modelled": ["gravity"],
            "frames": {"station": {"pose": "unknown"}},
            "sensors": sensors,
        }
        each = np.repeat((joints - home)[chosen], len(names), axis=0)
        columns = {
            f"q:{joint}": number_cells(each[:, k]) for k, joint in enumerate(JOINTS)
        }
        columns["sensor"] = names * len(chosen)
        columns["value"] = number_cells(seen[chosen].ravel())
        columns["sigma"] = number_cells([*[TILT] * 4, *[PRISM] * 3] * len(chosen))
        write_campaign(folder / name, header, columns, comment=SOURCE)
    return len(joints)


def main() -> None:
    """Convert one dataset."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("data", type=Path)
    parser.add_argument("--ground", default="flat")
    parser.add_argument(
        "--height",
        type=float,
        default=2.72,
        help="of the column, as the dataset names it, m",
    )
    parser.add_argument("--out", type=Path, required=True)
    chosen = parser.parse_args()
    grounds = sorted(file.stem for file in (chosen.data / "datasets").glob("*.yaml"))
    if not grounds:
        parser.error(
            f"{chosen.data}: expected the folder with datasets/GROUND.yaml, found none in it"
        )
    if chosen.ground not in grounds:
        parser.error(
            f"--ground: expected one of {', '.join(grounds)}, got {chosen.ground}"
        )
    count = convert(
        chosen.data, chosen.ground, chosen.height, chosen.out / chosen.ground
    )
    print(f"{count} postures at a column of {chosen.height} m")


if __name__ == "__main__":
    main()
