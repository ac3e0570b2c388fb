"""Mode shapes as pictures and animations of the robot, and as JSON."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.report.kept_pictures import list_experiments
from stiffscope.report.pictures import draw, optional_pictures
from stiffscope.report.robot_scene import deform_nodes, exaggeration, moves, picture, scene
from stiffscope.report.run_report import GEOMETRY
from stiffscope.vjm.network import END, FOOT
from stiffscope.vjm.screws import CONVENTION

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from stiffscope.experiments.assembly import Assembled
    from stiffscope.vjm.modes import Modes

_STEPS = 16  # frames per period
_TOGETHER = 6  # pictures drawn by one process
_WITHIN = 0.2  # share of a mode's energy within parts above which the title mentions it


def modes_json(found: Modes) -> dict[str, Any]:
    """Return modes for JSON output; node twists at M in base axes are [pose][mode][component]."""
    names = {END: "tool", FOOT: "base"}
    shapes = {names.get(node, node): np.moveaxis(twist, 1, 2) for node, twist in found.shapes.items()}
    return {
        "poses": found.configurations.poses,
        "tool": found.configurations.tool,
        "frequencies": found.frequencies,
        "error": found.error,
        "shapes": shapes,
        "energy": found.energy,
        "internal": found.internal,
        "remarks": list(found.remarks),
        "convention": CONVENTION,
    }


def draw_modes(assembled: Assembled, names: Sequence[str], found: Modes, folder: Path) -> None:
    """Draw each mode at each pose, coloured by energy: ``mode_POSE_NUMBER.png`` and ``….gif``.

    Log a warning and omit them if this machine cannot draw.

    Parameters
    ----------
    assembled
        Robot with its parts' matrices.
    names
        Names of the poses (n,).
    found
        Modes to draw.
    folder
        Folder to write to.

    """
    robot, mechanism, configurations = assembled.robot, assembled.mechanism, found.configurations
    arguments = {**scene(robot, mechanism, list_experiments(assembled)), "scale": "share of the strain energy"}
    stills: list[dict[str, Any]] = []
    moving: list[dict[str, Any]] = []
    for k, name in enumerate(names):
        moved, at = moves(mechanism, configurations, k), configurations.tool[k, :3]
        for i, hertz in enumerate(found.frequencies[k]):
            if not np.isfinite(hertz):
                continue
            twists = {node: shape[k, :, i] for node, shape in found.shapes.items()}
            factor = exaggeration(mechanism, moved, twists, at)
            within = float(found.internal[k, i])
            title = f"{robot.name} at {name}: mode {i + 1}, {hertz:.4g} Hz"
            if within > _WITHIN:
                title += f"; {100 * within:.0f} % of the energy is in parts between their ends"
            energy = {element: float(share[k, i]) for element, share in found.energy.items()}
            stem = f"mode_{_name_file(name, k)}_{i + 1}"
            sines = np.sin(0.5 * np.pi * np.arange(-_STEPS // 4, _STEPS // 4 + 1) / (_STEPS // 4))
            frames = [deform_nodes(moved, twists, at, float(sine) * factor) for sine in sines]
            order = [*range(len(sines)), *range(len(sines) - 2, 0, -1)]
            coloured = {"shares": energy if hertz else None}
            stills.append(picture(f"{stem}.png", title, frames[-1], moved) | coloured)
            moving.append({"file": f"{stem}.gif", "title": title, "frames": frames, "order": order, **coloured})
    jobs = [(what, shown[k : k + _TOGETHER]) for what, shown in (("animation", moving), ("robot", stills))
            for k in range(0, len(shown), _TOGETHER)]  # fmt: skip
    first = next((k for k, (what, _) in enumerate(jobs) if what == "robot"), -1)
    with ThreadPoolExecutor(2) as pool:
        drawn = [
            pool.submit(
                draw, what, folder, pictures=shown, **arguments, **({"geometry": GEOMETRY} if k == first else {})
            )
            for k, (what, shown) in enumerate(jobs)
        ]
    with optional_pictures():
        for each in drawn:
            each.result()


def _name_file(name: str, number: int) -> str:
    """Return a pose's name if it is valid in a file name, else its number."""
    return name if name.replace("_", "").replace("-", "").isalnum() else str(number + 1)
