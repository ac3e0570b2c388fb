"""HTML from the templates beside this file, which escape all text: the page of a diagnosis, tables for notebooks."""

from __future__ import annotations

import base64
import functools
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.report import text
from stiffscope.report.numbers import (
    DIAGONAL,
    TWIST,
    WRENCH,
    ZERO,
    ZERO_NOTE,
    coordinates,
    percent,
    point,
    pose_values,
    resolved,
    with_bound,
)

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from jinja2 import Environment

    from stiffscope.fea.experiment import Experiment
    from stiffscope.gap.diagnosis import Diagnosis
    from stiffscope.vjm.statics import Stiffness

UNITS = (("m/N", "m/(N·m)"), ("rad/N", "rad/(N·m)"))
KINDS = {".svg": "image/svg+xml", ".png": "image/png"}
POSES = 20  # that a notebook shows of a stack


@functools.cache
def _templates() -> Environment:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    found = Environment(
        loader=PackageLoader("stiffscope.report"), autoescape=True, undefined=StrictUndefined, trim_blocks=True
    )
    functions = (
        percent,
        text.sentence,
        text.label,
        text.located,
        text.probability,
        text.what_next,
        text.possible,
        text.checks,
    )
    found.filters |= {function.__name__: function for function in functions}
    return found


def experiment_html(experiment: Experiment) -> str:
    """Return the compliance (6, 6) at the first interface's reference point, with bounds and units, as a table."""
    matrix, error = experiment.compliance, experiment.error
    clear = resolved(matrix, error)
    rows = [
        (
            name,
            [(with_bound(matrix[i, j], error[i, j]) if clear[i, j] else ZERO, UNITS[i // 3][j // 3]) for j in range(6)],
        )
        for i, name in enumerate(TWIST)
    ]
    caption = (
        f"{experiment.part}, {experiment.interface}: "
        f"twist per unit wrench at ({point(experiment.reference_point)}) mm; "
        f"m/N, m/(N·m) and rad/N, rad/(N·m); largest relative bound {experiment.relative_bound:.2%}"
    )
    notes = [experiment.note, "" if clear.all() else ZERO_NOTE]
    return _macro("compliance", caption, rows, "; ".join(filter(None, notes)))


def stiffness_html(state: Stiffness) -> str:
    """Return the diagonals of the stiffness and the sag at the first poses as a table."""
    rows = [
        (
            pose_values(pose),
            *(f"{v:.5g}" for v in np.diagonal(matrix)),
            f"{1e6 * np.linalg.norm(sag[:3]):.3g}",
        )
        for pose, matrix, sag in zip(state.poses[:POSES], state.matrix[:POSES], state.sag[:POSES], strict=True)
    ]
    place = coordinates(state.configurations.mechanism.tool.pose)
    return _macro("stiffness", place, DIAGONAL, rows, max(0, len(state.poses) - POSES))


def _macro(name: str, *arguments: object) -> str:
    module = _templates().get_template("notebook.html").make_module({"wrench": WRENCH})
    return str(getattr(module, name)(*arguments))
