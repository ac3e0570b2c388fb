"""Superelements for other codes: a part condensed on its interfaces, a robot on its tool."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from stiffscope.fea.export import (
    Superelement,
    node_lines,
    write_matrices,
    write_superelement,
)
from stiffscope.runtime import output
from stiffscope.vjm.vibration.superelement import superelement

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from stiffscope.experiments.assembly import Assembled
    from stiffscope.experiments.experiments import PartResult
    from stiffscope.experiments.manifest import Manifest
    from stiffscope.vjm.kinematics.configurations import Configurations

ROBOT_HELP = """\
Superelement of the robot {robot} at {pose}, standing on the ground, drives held; SI: N, m, kg, rad, s.
Order of rows and columns: the tool's six degrees of freedom at M (ux, uy, uz, rx, ry, rz), small rotations, base axes;
then {modes} modal coordinates with the tool held, which vanish in statics. M a + K u = f.
The stiffness of the modal coordinates is diagonal (squared angular frequencies, rad^2/s^2).
Nodes, x y z in m:
{nodes}"""


def write_part(result: PartResult, out: Path, manifest: Manifest) -> None:
    """Write a part condensed on its interfaces and modes (see `stiffscope.fea.export`)."""
    with output.staged_folder(out) as folder:
        write_superelement(result.experiment, folder / result.name)
        manifest.note(
            result.name, key=result.key, reused=result.reused, seconds=result.seconds
        )
        manifest.write(folder)


def write_robot(
    assembled: Assembled,
    names: Sequence[str],
    configurations: Configurations,
    out: Path,
    manifest: Manifest,
) -> None:
    """Write the robot at each configuration, condensed on its tool and modes, to a folder.

    Files are named after the robot file's poses, or ``pose1``, ``pose2``, ...

    Parameters
    ----------
    assembled
        Robot with its parts' matrices.
    names
        Names of the configurations; unnamed ones are numbered.
    configurations
        Configurations of the mechanism.
    out
        Output folder.
    manifest
        Record of the run.
    """
    mechanism = assembled.mechanism
    with output.staged_folder(out) as folder:
        for k, name in enumerate(names):
            held = superelement(mechanism, configurations[np.array([k])])
            arrays = (held.tool[None], held.stiffness, held.mass)
            nodes, stiffness, mass = (
                np.asarray(array, dtype=float) for array in arrays
            )
            place = zip(mechanism.tool.pose, configurations.poses[k], strict=True)
            squares = np.asarray(held.mode_squares, dtype=float)
            text = ROBOT_HELP.format(
                robot=assembled.robot.name,
                modes=len(squares),
                nodes=node_lines(nodes, ["tool"]),
                pose=", ".join(f"{name} {value:.9g}" for name, value in place),
            )
            path = folder / (name if name in assembled.robot.poses else f"pose{k + 1}")
            write_matrices(
                Superelement(stiffness, mass, nodes), path, text, mode_squares=squares
            )
        manifest.write(folder)
