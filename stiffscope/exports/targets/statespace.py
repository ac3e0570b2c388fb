"""The target `statespace`: A, B, C, D at poses, for scipy.signal, python-control and MATLAB."""

from __future__ import annotations

import re
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from scipy.io import savemat  # pyright: ignore[reportMissingTypeStubs]

from stiffscope.exports.statespace import DAMPING, form_state_space
from stiffscope.exports.target import Exported, Order, Target

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path
    from typing import Any


def export_statespace(order: Order) -> Exported:
    """Return the robot's linear model at each pose."""
    mechanism = order.assembled.mechanism
    files = {}
    rows = []
    for k, name in enumerate(order.asked.names):
        configurations = order.asked.configurations[np.array([k])]
        model = form_state_space(mechanism, configurations, highest=order.highest)
        stem = name if re.fullmatch(r"[A-Za-z][\w-]*", name) else f"pose-{k + 1}"
        files[stem] = {
            "A": model.a,
            "B": model.b,
            "C": model.c,
            "D": model.d,
            "inputs": np.array(model.inputs),
            "outputs": np.array(model.outputs),
            "frequencies": model.frequencies,
            "damping": model.damping,
            "pose": configurations.poses[0],
        }
        vibrating = model.frequencies[model.frequencies > 0.0]
        band = f"{vibrating.min():.4g} to {vibrating.max():.4g} Hz"
        size = f"{len(model.a)} states, {len(model.inputs)} inputs"
        rows.append((stem, f"{size}, {band}"))
    names = [f"{stem}.{kind}" for stem in files for kind in ("npz", "mat")]
    remark = f"every mode has the damping ratio {DAMPING:g}; forces in N and N·m, motions in m, rad"
    return Exported(
        partial(_write, files),
        answer={"files": names, "damping": DAMPING},
        rows=tuple(rows),
        remarks=(remark,),
    )


def _write(files: Mapping[str, Mapping[str, Any]], folder: Path) -> None:
    for stem, arrays in files.items():
        np.savez(folder / f"{stem}.npz", **arrays)
        texts = {
            key: np.array(arrays[key], dtype=object) for key in ("inputs", "outputs")
        }
        savemat(folder / f"{stem}.mat", {**arrays, **texts})


TARGET = Target(
    name="statespace",
    help="Linear models A, B, C, D at poses, for scipy.signal, python-control and MATLAB.",
    files={
        "POSE.npz": "A, B, C, D, names of inputs and outputs, frequencies, damping",
        "POSE.mat": "the same for MATLAB",
    },
    export=export_statespace,
)
