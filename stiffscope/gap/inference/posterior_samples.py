"""Posterior samples of a diagnosis, and their file for ArviZ."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, cast

import h5netcdf  # pyright: ignore[reportMissingTypeStubs]  # not xarray, which imports slowly
import h5py  # pyright: ignore[reportMissingTypeStubs]
import numpy as np

from stiffscope.gap.inference.hypothesis import positive_of
from stiffscope.gap.inference.residuals import split_by_kind

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from numpy.random import Generator

    from stiffscope.gap.forward.forward_model import Candidate
    from stiffscope.gap.inference.findings import Findings
    from stiffscope.gap.inference.hypothesis import Hypothesis
    from stiffscope.runtime.types import Array, Flags


CHAINS = 4
DRAWS = 500
PREDICTED = 400_000  # most values of predictive draws in each chain
DISCREPANCY = "discrepancy"
_REDRAWN = 100  # most repetitions of draws with an impossible sign


@dataclass(frozen=True)
class Samples:
    """Posterior draws of the parameters, and predictive draws of the readings."""

    parameters: dict[str, Array]
    """(chain, draw) by `effect @ place: parameter`, SI; `discrepancy` relative to the readings."""
    units: dict[str, str]
    predicted: Array
    """Predictive draws (chain, fewer draws, n)."""
    observed: Array
    """Readings (n,)."""
    sigma: Array
    """Standard deviations (n,) of the readings."""
    used: Flags
    """(n,) False for outliers and copies."""
    pose: tuple[str, ...]
    """Pose name (n,) of each reading."""
    quantity: tuple[str, ...]
    """Sensor or quantity (n,) of each reading."""
    held_out: Array
    """Residuals (n,) of held-out poses in predictive standard deviations; NaN if not used."""
    before: Array
    """Readings (n,) predicted by the nominal model."""
    after: Array
    """Readings (n,) predicted with the reported effects."""
    kinds: dict[str, tuple[str, Flags]]
    """Unit and flags (n,) by kind of reading."""
    where: tuple[str, ...]
    """File and line (n,) of each reading."""


def draw_samples(
    found: Findings,
    averaged: Sequence[tuple[Hypothesis, float]],
    named: tuple[Candidate, ...],
    held_out: Array,
    reported: Hypothesis | None = None,
    seed: int = 0,
) -> Samples:
    """Draw from the posteriors of fitted hypotheses, keeping parameters of the named effects.

    Each is Laplace's approximation, truncated at zero for non-negative parameters.

    Parameters
    ----------
    found, averaged
        The search, and hypotheses that share the named effects, with weights that sum to 1.
    named
        Effects whose parameters are kept.
    held_out : (n,)
        Residuals of held-out poses, in predictive standard deviations.
    reported
        Hypothesis whose predictions are shown (default: the first).
    seed
        Seed of the random numbers.
    """
    rng = np.random.default_rng(seed)
    c = found.campaign
    total = CHAINS * DRAWS
    few = int(np.clip(PREDICTED // max(len(c), 1), 10, DRAWS))
    pick = (np.arange(CHAINS)[:, None] * DRAWS + np.arange(few)).ravel()
    source = rng.choice(len(averaged), total, p=[weight for _, weight in averaged])
    size = np.empty(total)
    predicted = np.empty((len(pick), len(c)), dtype=np.float32)
    parameters: dict[str, Array] = {}
    units: dict[str, str] = {}
    kept = {candidate.name for candidate in named}
    for number, (hypothesis, _) in enumerate(averaged):
        here = np.flatnonzero(source == number)
        positive = positive_of(hypothesis.candidates)
        u = draw_internal(
            hypothesis.values, hypothesis.covariance, positive, len(here), rng
        )
        setting = rng.choice(
            len(hypothesis.known.settings), len(here), p=hypothesis.known.settings
        )
        size[here] = found.problem.errors.sizes[setting]
        for name, unit, values in _physical_draws(hypothesis, kept, u):
            parameters.setdefault(name, np.empty(total))[here] = values
            units[name] = unit
        shown = here[np.isin(here, pick)]
        drawn = _predict(found, hypothesis, u[np.isin(here, pick)], size[shown], rng)
        predicted[np.searchsorted(pick, shown)] = drawn
    parameters[DISCREPANCY] = size
    units[DISCREPANCY] = "1"
    return Samples(
        parameters={
            name: draws.reshape(CHAINS, DRAWS) for name, draws in parameters.items()
        },
        units=units,
        predicted=predicted.reshape(CHAINS, few, len(c)),
        observed=np.array(c.value),
        sigma=found.sigma,
        used=found.used_readings,
        pose=tuple(c.pose_names[int(k)] for k in c.pose),
        quantity=tuple(c.what(k) for k in range(len(c))),
        held_out=held_out,
        before=found.predict_readings(found.none),
        after=found.predict_readings(reported or averaged[0][0]),
        kinds=split_by_kind(c),
        where=tuple(c.where(k) for k in range(len(c))),
    )


def _physical_draws(
    hypothesis: Hypothesis, kept: set[str], u: Array
) -> Iterator[tuple[str, str, Array]]:
    """Yield name, unit and draws (d,) of each parameter of the kept effects, from internal draws (d, k)."""
    for candidate in hypothesis.candidates:
        own = hypothesis.mark(lambda other, candidate=candidate: other is candidate)
        if candidate.name in kept and own.any():
            rows = [candidate.physical(row) for row in u[:, own]]
            columns = np.reshape(rows, (len(u), len(candidate.names))).T
            for name, unit, values in zip(
                candidate.names, candidate.units, columns, strict=True
            ):
                yield f"{candidate.name}: {name}", unit, values


def draw_internal(
    mean: Array, covariance: Array, positive: Flags, count: int, rng: Generator
) -> Array:
    """Return normal draws (count, k) of internal parameters, truncated at zero where they are positive."""
    if not len(mean):
        return np.zeros((count, 0))
    deviation = np.sqrt(np.diagonal(covariance).clip(min=1e-300))
    scaled = covariance / np.outer(deviation, deviation)  # units differ widely
    values, vectors = np.linalg.eigh(scaled)
    root = deviation[:, None] * vectors * np.sqrt(values.clip(min=0.0))
    out = mean + rng.standard_normal((count, len(mean))) @ root.T
    for _ in range(_REDRAWN):
        wrong = np.flatnonzero((out < 0.0)[:, positive].any(axis=1))
        if not len(wrong):
            break
        out[wrong] = mean + rng.standard_normal((len(wrong), len(mean))) @ root.T
    return np.where(positive, np.abs(out), out)


def _predict(
    found: Findings, joint: Hypothesis, u: Array, size: Array, rng: Generator
) -> Array:
    """Return predictive draws (draw, n) from linearized effects, discrepancy and noise."""
    errors = found.problem.errors
    noise = rng.standard_normal((len(u), len(found.sigma)))
    out = (u - joint.values) @ found.slopes(joint).T + noise
    if len(errors.norms) and size.any():
        pairs = rng.standard_normal((len(u), 2, len(errors.norms) // 2))
        out += size[:, None] * np.einsum(
            "djn,nj->dn", pairs[:, :, errors.group], errors.shape
        )
    return (found.predict_readings(joint) + out * found.sigma).astype(np.float32)


def write_readings(path: Path, samples: Samples) -> None:
    """Write all readings with their predictions as a table (CSV, SI)."""
    kind, unit = np.empty((2, len(samples.observed)), dtype=object)
    for name, (of, mine) in samples.kinds.items():
        kind[mine] = name
        unit[mine] = of
    columns = {
        "reading": samples.where,
        "pose": samples.pose,
        "quantity": samples.quantity,
        "kind": kind,
        "unit": unit,
        "measured": samples.observed,
        "sigma": samples.sigma,
        "predicted_before": samples.before,
        "predicted_after": samples.after,
        "used": samples.used,
    }
    with path.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([columns, *zip(*columns.values(), strict=True)])


def write_posterior(path: Path, samples: Samples) -> None:
    """Write draws for ArviZ: netCDF groups posterior, posterior_predictive and observed_data.

    References
    ----------
    ArviZ, InferenceData schema specification.
    """
    opened: Any = h5netcdf.File  # pyright: ignore[reportUnknownMemberType]
    draws = {"chain": CHAINS, "draw": DRAWS}
    rows = {"reading": len(samples.observed)}
    fewer = {"chain": CHAINS, "draw": samples.predicted.shape[1], **rows}
    words = {"pose": samples.pose, "quantity": samples.quantity}
    observed = {"value": samples.observed, "sigma": samples.sigma}
    whole = io.BytesIO()  # HDF5 aborts the process if the disk is full
    with opened(whole, "w") as file:
        group = file.create_group
        _write_group(group("posterior"), draws, samples.parameters, samples.units)
        predicted = {"value": samples.predicted}
        _write_group(group("posterior_predictive"), fewer, predicted, words=words)
        _write_group(group("observed_data"), rows, observed, words=words)
    path.write_bytes(whole.getvalue())


def _write_group(
    group: Any,
    lengths: Mapping[str, int],
    values: Mapping[str, Array],
    units: Mapping[str, str] | None = None,
    words: Mapping[str, Sequence[str]] | None = None,
) -> None:
    """Write arrays over dimensions of some lengths; ``words`` label the last dimension."""
    text = cast("Any", h5py).string_dtype()  # h5py has no types
    group.dimensions = dict(lengths)
    for name, length in lengths.items():
        group.create_variable(name, (name,), data=np.arange(length))
    for name, said in (words or {}).items():
        group.create_variable(
            name, (list(lengths)[-1],), data=np.array(said, dtype=text)
        )
    for name, array in values.items():
        variable = group.create_variable(name, tuple(lengths), data=array)
        if units:
            variable.attrs["units"] = units[name]
        if words:
            variable.attrs["coordinates"] = " ".join(words)
