"""Stress in the parts at the greatest path error, from displacements under unit wrenches."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.fea.elasticity import nodal_stresses, von_mises

if TYPE_CHECKING:
    from stiffscope.experiments.assembly import Assembled
    from stiffscope.experiments.experiments import PartResult
    from stiffscope.path.along import Along
    from stiffscope.runtime.types import Array
    from stiffscope.vjm.network.loading import Response


@dataclass(frozen=True, eq=False)
class PartStress:
    """Greatest von Mises stress of a body, Pa, and its position ``at`` (3,), m, part axes.

    ``factor``: yield strength over stress; None if the job does not state the strength.
    ``displacement`` (k, 3), m, and ``stress`` (k,), Pa, at all nodes of the ``tested`` part.
    """

    body: str
    part: str
    material: str
    von_mises: float
    at: Array
    factor: float | None
    tested: PartResult
    displacement: Array
    stress: Array


def find_stresses(
    state: Along, assembled: Assembled, response: Response
) -> tuple[PartStress, ...]:
    """Return stresses at the greatest error for bodies with FEA parts, the greatest first.

    Elements touching a clamped or loaded face are excluded, since the stress at its edges diverges
    with mesh refinement. A part's own weight acts only at its ends.

    Parameters
    ----------
    state, assembled
        Prediction along the path, and assembled robot of the job.
    response
        Response of the robot at the greatest error.
    """
    out: list[PartStress] = []
    for body, section in assembled.robot.bodies.items():
        part = getattr(section, "part", None)
        result = assembled.results.get(part) if part is not None else None
        if result is None or not result.experiment.displacement.size:
            continue
        mesh = result.experiment.mesh
        material = result.order.material
        wrench = response.find_wrench(assembled.mechanism.rows(body))[0, :, 0]
        motion = np.tensordot(wrench, result.experiment.displacement, axes=1).reshape(
            -1, 1
        )
        stress = von_mises(nodal_stresses(mesh, motion, material.elasticity())[:, 0])
        away = np.ones(len(mesh.points), dtype=bool)
        nodes = mesh.nodes_of(frozenset(chain(*result.solid["faces"].values())))
        away[mesh.cells[np.isin(mesh.cells, nodes).any(axis=1)]] = False
        node = int(np.argmax(np.where(away | ~away.any(), stress, -1.0)))
        greatest = float(stress[node])
        names = (body, result.name, material.name)
        strength = state.job.section.yield_strength.get(material.name)
        factor = None if strength is None or greatest == 0.0 else strength / greatest
        place = mesh.points[node]
        moved = motion.reshape(-1, 3)
        out.append(PartStress(*names, greatest, place, factor, result, moved, stress))
    return tuple(sorted(out, key=lambda each: -each.von_mises))
