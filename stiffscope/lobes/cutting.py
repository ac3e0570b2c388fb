"""The cut of a job as its stability sees it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from stiffscope.errors import InputError
from stiffscope.lobes.engagement import milling, turning
from stiffscope.lobes.model import Cutting
from stiffscope.path.job import MillingSection

if TYPE_CHECKING:
    from stiffscope.path.job import Job, TurningSection


def cutting_of(job: Job) -> Cutting:
    """Return the cut of a job, milling or turning. Raise InputError unless there is just one.

    The force of a material is linearized at its mean chip: of ``kc1 h^(1 - mc)`` the derivative is
    ``(1 - mc) kc``. ``kt`` is taken as it stands.
    """
    process = job.section.process
    given = {"milling": process.milling, "turning": process.turning}
    cuts = {name: cut for name, cut in given.items() if cut is not None}
    if len(cuts) != 1:
        got = "both" if cuts else "neither"
        expected = "expected [process.milling] or [process.turning]"
        raise InputError(f"{job.file}: process: {expected}, got {got}")
    ((name, section),) = cuts.items()
    _, exponent = section.law()
    feed = _mean_feed(job, section)
    if feed is None and exponent:
        expected = "expected a feed of the path or of the cut, or kt"
        raise InputError(f"{job.file}: process.{name}: {expected}, got none")
    forces = section.forces(1e-3 if feed is None else feed)
    stiffness = section.kt
    if stiffness is None:
        # of the specific force at the mean chip
        stiffness = (1.0 - exponent) * section.specific_force(forces.chip)
    if isinstance(section, MillingSection):
        cut = milling(
            teeth=section.teeth,
            width=section.width,
            diameter=section.diameter,
            stiffness=stiffness,
            radial=section.radial_ratio,
            axial=section.axial,
            lead=section.lead,
            climb=section.climb,
        )
    else:
        cut = turning(
            stiffness=stiffness,
            radial=section.radial_ratio,
            lead=section.lead,
            side=section.side,
        )
    return Cutting(cut, section.speed, section.depth, forces.chip)


def _mean_feed(job: Job, section: MillingSection | TurningSection) -> float | None:
    """Return the mean feed of the moves that cut, m/s, or None if there is none."""
    feeds = job.path.feed
    if feeds is not None:
        known = feeds[job.path.acting & np.isfinite(feeds)]
        if known.size:
            return float(known.mean())
    return section.feed
