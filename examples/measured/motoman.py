"""Convert laser-tracker data of two welding arms on a torso (Motoman MA1400).

The data belong to their authors; this script converts your own copy. From
https://github.com/ctu-vras/multirobot-calibration download
`UserData/Robots/Motoman/Dataset/leica_dataset/leica_left_hand_6x6x6_dataset.mat` (or `leica_right_…`), then

    python -m examples.measured.motoman leica_left_hand_6x6x6_dataset.mat --arm left --out motoman
    stiffscope campaign check motoman/fit
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from scipy.io import loadmat

from examples.measured.arm import Arm, split_postures, write_positions
from examples.measured.ladder import fit_ladder
from stiffscope.gap.forward.placing import align_points

TURN = np.pi / 180.0
ROWS = (
    (0.15, 1.4159, -90 * TURN, 0.0),
    (0.614, 0.0, 180 * TURN, -90 * TURN),
    (0.2, 0.0, -90 * TURN, 0.0),
    (0.0, -0.64, 90 * TURN, 0.0),
    (0.03, 0.0, 90 * TURN, -90 * TURN),
    (0.0, 0.2, 0.0, 0.0),
)
SOURCE = """Geometry: loadMotomanLeica.m of ctu-vras/multirobot-calibration.
Masses and drives: guesses, nothing is published.
Converted from the authors' dataset, which is theirs."""
SIDES = {
    "left": (-15 * TURN, (0.05, 0.25, 0.0, 0.0)),
    "right": (15 * TURN, (0.045, 0.245, 0.0, -0.38)),
}
ARMS = {
    side: Arm(
        f"motoman-{side}",
        (0.0, -0.263, tilt, -90 * TURN),
        ROWS,
        target,
        (45.0, 30.0, 25.0, 12.0, 6.0, 4.0),
        (5e5, 5e5, 3e5, 6e4, 6e4, 3e4),
        SOURCE,
    )
    for side, (tilt, target) in SIDES.items()
}
JOINTS = {"right": slice(7, 13), "left": slice(13, 19)}
"""Columns of joint angles, rad; 19 to 21: reflector position, m; 22: tracker uncertainty."""
SIGMA = 3e-5
AT_SIGMA = 0.02  # m: tracker and repeatability; place of the reflector


def read_postures(dataset: Path, side: str) -> tuple[np.ndarray, np.ndarray]:
    """Return joint angles (p, 6), rad, and reflector positions (p, 3), m, of the postures seen.

    Parameters
    ----------
    dataset
        A .mat file with the variable `dataset`, 26 columns; the first row of each pose is used.
    side
        "left" or "right".
    """
    table = np.asarray(loadmat(dataset)["dataset"], dtype=float)
    table = table[np.unique(table[:, 0], return_index=True)[1]]
    seen = table[:, 19:22]
    is_seen = np.isfinite(seen).all(axis=1) & (seen != 0.0).any(axis=1)
    return table[is_seen, JOINTS[side]], seen[is_seen]


def convert(dataset: Path, side: str, folder: Path) -> dict[str, float]:
    """Write the campaigns `fit` and `held-out` from a dataset, each with its robot file.

    Returns
    -------
    dict
        Number of postures, and rms residual of the nominal arm per coordinate, m.

    """
    angles, seen = read_postures(dataset, side)
    arm = ARMS[side]
    home = angles.mean(axis=0).round(3)
    for name, chosen in zip(
        ("fit", "held-out"), split_postures(len(seen)), strict=True
    ):
        write_positions(
            arm,
            folder / name,
            home,
            angles[chosen],
            seen[chosen],
            sigma=SIGMA,
            at_sigma=AT_SIGMA,
        )
    nominal = np.array([arm.target_at(each) for each in angles])
    rotation, origin = align_points(seen, nominal)
    left = nominal - seen @ rotation.T - origin
    return {"postures": len(seen), "rms": float(np.sqrt(np.mean(left**2)))}


def main() -> None:
    """Convert one dataset."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("dataset", type=Path)
    parser.add_argument("--arm", choices=sorted(ARMS), default="left")
    parser.add_argument("--out", type=Path, help="folder of the two campaigns")
    parser.add_argument("--ladder", action="store_true", help="plain least squares")
    chosen = parser.parse_args()
    if chosen.ladder:
        postures = read_postures(chosen.dataset, chosen.arm)
        for name, fitted, held in fit_ladder(ARMS[chosen.arm], *postures):
            print(
                f"{name}: {1e3 * fitted:.4f} mm rms fitted, {1e3 * held:.4f} held out"
            )
    if chosen.out is None:
        return
    found = convert(chosen.dataset, chosen.arm, chosen.out)
    print(
        f"{found['postures']} postures; the nominal arm leaves {1e3 * found['rms']:.3f} mm rms a coordinate"
    )


if __name__ == "__main__":
    main()
