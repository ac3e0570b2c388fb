"""Damping of the modes: as stated, or as measured."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from stiffscope.errors import InputError
from stiffscope.gap.campaign.campaign_header import NAME, load_header
from stiffscope.gap.campaign.measured_responses import load_responses
from stiffscope.gap.campaign.readings import load_campaign
from stiffscope.gap.forward.response_model import predict_responses
from stiffscope.responses.fitting import fit_modes
from stiffscope.runtime.table import numbers, read_table

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from stiffscope.experiments.assembly import Assembled
    from stiffscope.gap.campaign.measured_responses import MeasuredResponses
    from stiffscope.lobes.model import LobesSection
    from stiffscope.path.job import Job
    from stiffscope.responses.fitting import FittedModes
    from stiffscope.runtime.types import Array
    from stiffscope.vjm.model.mechanism import Mechanism

    Rated = Callable[[Array], tuple[Array, Array]]

ALIKE = 0.6  # MAC, from which two shapes are the same mode


def lobes_section(job: Job) -> LobesSection:
    """Return the section [lobes] of a job. Raise InputError if it is missing."""
    section = getattr(job.section, "lobes", None)
    if section is None:
        expected = "expected a section with the damping of the modes"
        raise InputError(f"{job.file}: lobes: {expected}, got none")
    return section


def check_damping(job: Job) -> None:
    """Raise InputError if a job does not state the damping of its modes, or no measured ones."""
    section = lobes_section(job)
    if section.damping != "measured":
        if section.measured is not None:
            expected = 'expected damping = "measured" beside measured modes'
            raise InputError(f"{job.file}: lobes.measured: {expected}, got ratios")
        return
    if section.measured is None:
        expected = 'expected a table or a campaign: measured = "modes.csv"'
        raise InputError(f"{job.file}: lobes.damping: {expected}, got none")
    if not _measured_path(job).is_dir():
        _read_table(_measured_path(job))


def damping_of(job: Job, assembled: Assembled) -> Rated:
    """Return a function from frequencies (n, m), Hz, to damping ratios and relative bounds.

    Raises
    ------
    InputError
        The damping is neither stated nor measured, or the measured modes cannot be read.
    """
    check_damping(job)
    section = lobes_section(job)
    given = section.damping
    doubt = section.damping_error
    if given != "measured":
        stated = np.atleast_1d(np.array(given, dtype=float))
        return lambda hertz: (_by_order(stated, hertz), np.full(hertz.shape, doubt))
    path = _measured_path(job)
    if path.is_dir():
        paired = pair_damping(path, assembled)
        return lambda hertz: (_by_order(paired, hertz), np.full(hertz.shape, doubt))
    frequency, ratio = _read_table(path)

    def rate(hertz: Array) -> tuple[Array, Array]:
        apart = np.abs(np.log(hertz[..., None] / frequency))
        return ratio[apart.argmin(axis=-1)], np.full(hertz.shape, doubt)

    return rate


def _by_order(ratios: Array, hertz: Array) -> Array:
    """Return ratios of modes (n, m) by their order; further modes have the last."""
    order = np.minimum(np.arange(hertz.shape[1]), len(ratios) - 1)
    return np.broadcast_to(ratios[order], hertz.shape).copy()


def _measured_path(job: Job) -> Path:
    return job.file.parent / str(lobes_section(job).measured)


def list_measured(job: Job) -> list[Path]:
    """Return the files of a job's measured damping: a table, or a campaign's header and responses.

    Raises
    ------
    InputError
        The header of the campaign cannot be read.
    """
    if lobes_section(job).measured is None:
        return []
    path = _measured_path(job)
    if not path.is_dir():
        return [path]
    setups = load_header(path).responses
    return [path / NAME, *(path / setup.file for setup in setups)]


def _read_table(file: Path) -> tuple[Array, Array]:
    """Return frequencies, Hz, and damping ratios of a table of measured modes."""

    def check(name: str, columns: list[str]) -> None:
        for wanted in ("frequency", "zeta"):
            if wanted not in columns:
                got = ", ".join(columns)
                raise InputError(f"{name}:1: expected a column {wanted}, got {got}")

    table = read_table(file, check)
    hertz = numbers(table, "frequency")
    ratio = numbers(table, "zeta")
    table.refuse_where(hertz <= 0.0, "frequency", "a frequency above 0 Hz")
    table.refuse_where((ratio <= 0.0) | (ratio > 0.7), "zeta", "a ratio above 0")
    return hertz, ratio


def pair_damping(folder: Path, assembled: Assembled) -> Array:
    """Return the damping ratios (m,) of a robot's modes from a hammer campaign, by their order.

    The residues of a fitted mode are its shape at the hit and the measured points. They are compared
    with those of each computed mode at the campaign's pose (modal assurance criterion); without a
    shape alike, the fitted mode nearest in frequency counts.

    Parameters
    ----------
    folder
        Folder of the campaign, with [responses].
    assembled
        Robot with its parts' matrices.

    Raises
    ------
    InputError
        The campaign has no responses, or they show no resonance.

    References
    ----------
    R. J. Allemang, The modal assurance criterion, Sound and Vibration 37, 2003.
    """
    campaign = load_campaign(folder)
    every = load_responses(folder, campaign, assembled.robot, assembled.mechanism)
    if not every:
        expected = "expected [responses] of a hammer test"
        raise InputError(f"{folder / 'campaign.toml'}: {expected}, got none")
    measured = max(every, key=lambda each: len(each.responses))
    fitted = fit_modes(measured.responses)
    hertz, shapes = _computed_shapes(assembled.mechanism, measured)
    likeness = assurance(shapes, fitted.residues)
    nearest = np.abs(np.log(hertz[:, None] / fitted.frequency)).argmin(axis=1)
    alike = likeness.argmax(axis=1)
    chosen = np.where(likeness.max(axis=1) >= ALIKE, alike, nearest)
    return _without_window(fitted, measured)[chosen]


def _computed_shapes(
    mechanism: Mechanism, measured: MeasuredResponses
) -> tuple[Array, Array]:
    """Return frequencies (c,), Hz, and residues (r, c) of the computed modes, ascending."""
    modal = predict_responses(mechanism, measured, 0.01).modal
    ends = [end for each in measured.responses for end in (each.force, each.motion)]
    port = {end: k for k, end in enumerate(dict.fromkeys(ends))}
    force = [port[each.force] for each in measured.responses]
    motion = [port[each.motion] for each in measured.responses]
    hertz = modal.frequencies
    order = np.argsort(hertz, kind="stable")
    order = order[np.isfinite(hertz[order]) & (hertz[order] > 0.0)]
    shapes = modal.displacement[force] * modal.displacement[motion]
    return hertz[order], shapes[:, order] / modal.mass[order]


def assurance(first: Array, second: Array) -> Array:
    """Return the modal assurance criterion (c, k) of shapes (r, c) and (r, k)."""
    across = first.T @ second
    sizes = np.multiply.outer((first**2).sum(axis=0), (second**2).sum(axis=0))
    return across**2 / np.where(sizes > 0.0, sizes, np.inf)


def _without_window(fitted: FittedModes, measured: MeasuredResponses) -> Array:
    """Return damping ratios without that of an exponential window."""
    ratio = fitted.damping - measured.decay / (2.0 * np.pi * fitted.frequency)
    return ratio.clip(1e-5, 0.7)
