"""The tool in its holder: its modes, clamped at the robot's flange, as felt at the tip."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.errors import InputError
from stiffscope.lobes.damping import lobes_section
from stiffscope.responses.files import is_universal, read_responses
from stiffscope.responses.fitting import fit_modes
from stiffscope.responses.tables import Channel, read_direction
from stiffscope.responses.units import read_unit

if TYPE_CHECKING:
    from pathlib import Path

    from stiffscope.lobes.model import ResponsesSection
    from stiffscope.path.job import Job
    from stiffscope.responses.model import Direction, Response, ResponseFile
    from stiffscope.runtime.types import Array

_WAYS = {"feed": (0,), "normal": (1,), "axial": (2,), "radial": (0, 1)}


@dataclass(frozen=True, eq=False)
class HolderModes:
    """Modes of a clamped holder.

    Attributes
    ----------
    squares, damping
        Squared angular frequencies (k,), (rad/s)², and damping ratios.
    stiffness
        Stiffness (k, 3) at the tip along feed, normal and spindle, N/m; infinite where the mode
        does not move the tip.
    remainder
        Static compliance (3,) of all other modes along them, m/N.
    """

    squares: Array
    damping: Array
    stiffness: Array
    remainder: Array


def find_holder_modes(job: Job) -> HolderModes | None:
    """Return the modes of a job's tool holder, stated and measured; None without one.

    Raises
    ------
    InputError
        A file of responses cannot be read, or shows no resonance of the tip that gives way to its
        force.
    """
    section = lobes_section(job)
    rows = list[tuple[float, float, float, int]]()
    remainder = np.zeros(3)
    for mode in section.holder:
        for way in _WAYS[mode.direction]:
            rows.append((mode.frequency, mode.damping, mode.stiffness, way))
    if section.responses is not None:
        for name, response in _tip_responses(job, section.responses).items():
            fitted = fit_modes([response])
            # motion along the force, however the sensor and the hammer point
            sign = response.force.sign * response.motion.sign
            residues = sign * fitted.residues[0]
            if not (residues > 0.0).any():
                raise InputError(
                    f"{job.file}: lobes.responses.{name}: expected motion along the force in at "
                    f"least one mode of {response.source}, got none; is a sign reversed?"
                )
            rate = (2.0 * np.pi * fitted.frequency) ** 2
            for k in np.flatnonzero(residues > 0.0):
                stiffness = rate[k] / residues[k]
                for way in _WAYS[name]:
                    rows.append(
                        (fitted.frequency[k], fitted.damping[k], stiffness, way)
                    )
            for way in _WAYS[name]:
                remainder[way] += max(float(sign * fitted.remainder[0]), 0.0)
    if not rows:
        return None
    table = np.array(rows)
    along = np.full((len(rows), 3), np.inf)
    along[np.arange(len(rows)), table[:, 3].astype(int)] = table[:, 2]
    squares = (2.0 * np.pi * table[:, 0]) ** 2
    return HolderModes(squares, table[:, 1], along, remainder)


def _tip_responses(job: Job, section: ResponsesSection) -> dict[str, Response]:
    """Return the driving-point responses of the tip by direction of the cut."""
    key = f"{job.file}: lobes.responses"
    file = job.file.parent / section.file
    read = _read_file(section, file, key)
    found = dict[str, "Response"]()
    for name in _WAYS:
        text = getattr(section, name)
        if text is None:
            continue
        wanted = _read_direction(text, f"{key}.{name}")
        for response in read.responses:
            ends = response.motion.point, response.motion.axis
            if response.is_driving_point and ends == (wanted.point, wanted.axis):
                found[name] = response
        if name not in found:
            known = [str(r.motion) for r in read.responses if r.is_driving_point]
            listed = ", ".join(known) or "none"
            expected = f"expected a point hit and measured along one axis ({listed})"
            raise InputError(f"{key}.{name}: {expected}, got {text}")
    if not found:
        expected = f"expected a direction of the tip ({', '.join(_WAYS)})"
        raise InputError(f"{key}: {expected}, got none")
    return found


def _read_file(section: ResponsesSection, file: Path, key: str) -> ResponseFile:
    if is_universal(file):
        return read_responses(file, {})
    if section.quantity is None:
        expected = "expected receptance, mobility or accelerance of a table"
        raise InputError(f"{key}.quantity: {expected}, got none")
    factor = 1.0
    if section.unit is not None:
        try:
            factor = read_unit(section.unit, section.quantity)
        except InputError as error:
            said = str(error).removeprefix("--unit: ")
            raise InputError(f"{key}.unit: {said}") from error
    channels = dict[str, Channel]()
    for name, text in section.channels.items():
        motion, _, force = text.partition("/")
        where = f"{key}.channels.{name}"
        channels[name] = Channel(
            _read_direction(force or motion, where), _read_direction(motion, where)
        )
    return read_responses(file, channels, section.quantity, factor)


def _read_direction(text: str, where: str) -> Direction:
    try:
        return read_direction(text)
    except ValueError as error:
        raise InputError(f"{where}: {error}") from error
