"""Mode shapes as pictures and animations of the robot, and as JSON."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.report.pictures import draw, optional_pictures
from stiffscope.report.robot_scene import place_robot, scene_of
from stiffscope.report.robot_view import mode_cases
from stiffscope.report.run_report import ENERGY, GEOMETRY
from stiffscope.runtime.progress import silence
from stiffscope.vjm.model.screws import CONVENTION
from stiffscope.vjm.network.network import END, FOOT

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from stiffscope.experiments.assembly import Assembled
    from stiffscope.runtime.types import Progress
    from stiffscope.vjm.vibration.modes import Modes

_STEPS = 16  # frames per period
_TOGETHER = 6  # pictures drawn by one process
_WITHIN = 0.2  # share of a mode's energy within parts above which the title mentions it


def modes_json(vibration_modes: Modes) -> dict[str, Any]:
    """Return modes for JSON output; node twists at M in base axes are [pose][mode][component]."""
    names = {END: "tool", FOOT: "base"}
    shapes = {
        names.get(node, node): each.swapaxes(1, 2)
        for node, each in vibration_modes.shapes.items()
    }
    return {
        "poses": vibration_modes.configurations.poses,
        "tool": vibration_modes.configurations.tool,
        "frequencies": vibration_modes.frequencies,
        "error": vibration_modes.error,
        "shapes": shapes,
        "energy": vibration_modes.energy,
        "internal": vibration_modes.internal,
        "remarks": list(vibration_modes.remarks),
        "convention": CONVENTION,
    }


def draw_modes(
    assembled: Assembled,
    names: Sequence[str],
    vibration_modes: Modes,
    folder: Path,
    progress: Progress = silence,
) -> None:
    """Draw each mode at each pose, coloured by energy: ``mode_POSE_NUMBER.png``.

    Those of the first pose move, too (``….gif``); the page moves all of them. Log a warning and
    omit them if this machine cannot draw.

    Parameters
    ----------
    assembled, folder
        Robot with its parts' matrices, and folder to write to.
    names, vibration_modes
        Names (n,) of the poses, and modes there.
    progress
        Told of the share of pictures drawn.
    """
    steps = np.arange(-_STEPS // 4, _STEPS // 4 + 1)
    sines = np.sin(0.5 * np.pi * steps / (_STEPS // 4))
    order = [*range(len(sines)), *range(len(sines) - 2, 0, -1)]
    stills: list[dict[str, Any]] = []
    moving: list[dict[str, Any]] = []
    for k, (name, cases) in enumerate(
        zip(names, mode_cases(vibration_modes), strict=True)
    ):
        here = place_robot(vibration_modes.configurations, k)
        pose = name if name.replace("_", "").replace("-", "").isalnum() else str(k + 1)
        known = np.flatnonzero(np.isfinite(vibration_modes.frequencies[k]))
        for i, case in zip(known, cases, strict=True):
            hertz = vibration_modes.frequencies[k, i]
            within = float(vibration_modes.internal[k, i])
            title = f"{assembled.robot.name} at {name}: mode {i + 1}, {hertz:.4g} Hz"
            if within > _WITHIN:
                title += f"; {100 * within:.0f} % of the energy is in parts between their ends"
            factor = here.exaggeration(case.twists)
            frames = [here.deform(case.twists, float(sine) * factor) for sine in sines]
            shown = {"title": title, "shares": case.shares or None}
            stem = f"mode_{pose}_{i + 1}"
            still = {"file": f"{stem}.png", "moves": frames[-1], "before": here.moves}
            stills.append(shown | still)
            if k == 0:
                film = {"file": f"{stem}.gif", "frames": frames, "order": order}
                moving.append(shown | film)
    starts = (
        (picture, k)
        for picture in (moving, stills)
        for k in range(0, len(picture), _TOGETHER)
    )
    jobs = [each[k : k + _TOGETHER] for each, k in starts]
    common: dict[str, Any] = {**scene_of(assembled), "scale": ENERGY}
    with ThreadPoolExecutor(2) as pool, optional_pictures():
        drawn = []
        for job in jobs:
            solids = {"geometry": GEOMETRY} if job is jobs[0] else {}
            drawn.append(
                pool.submit(draw, "robot", folder, pictures=job, **common, **solids)
            )
        for k, each in enumerate(drawn):
            each.result()
            progress("drawing", (k + 1) / len(drawn))
