"""Force over deflection along a load path: table and figure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.report.figures import (
    AFTER,
    BEFORE,
    EFFECT,
    NOISE,
    new_figure,
    save_figures,
)
from stiffscope.report.terminal import show_table

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from matplotlib.figure import Figure

    from stiffscope.runtime.types import Array, Flags
    from stiffscope.vjm.statics.yielding import LoadCurve

_COLOURS = (AFTER, EFFECT, BEFORE, NOISE)


def show_load_curve(names: Sequence[str], curve: LoadCurve) -> None:
    """Show displacement and tangent stiffness along the wrench at each load up to the full one."""
    size, along, unit, stiff = _project_curve(curve)
    rows = []
    count = len(curve.load) // 4 + 1  # the way there; all others repeat it
    for i, name in enumerate(names):
        for k in range(count):
            tangent = f"{stiff[i, k]:.5g}".replace("nan", "–")
            load = f"{size * curve.load[k]:.4g}"
            moved = f"{1e6 * along[i, k]:.5g}"
            rows.append(("" if k else name, load, moved, tangent))
    force = "N" if unit == "m" else "N·m"
    groups = (("pose",), (force, f"µ{unit}", f"tangent {force}/{unit}"))
    show_table("Along the wrench; loading and unloading coincide", groups, rows)


def draw_load_curve(names: Sequence[str], curve: LoadCurve, folder: Path) -> None:
    """Write ``force_over_deflection`` as PNG and SVG.

    Parameters
    ----------
    names, curve
        Names of the poses (n,), and displacements there at each load.
    folder
        Folder to write to.
    """

    def draw() -> Figure:
        size, along, unit, _ = _project_curve(curve)
        title = "Force over deflection" if unit == "m" else "Moment over rotation"
        figure = new_figure(7.0, 4.6, title)
        axes = figure.subplots()
        for i, name in enumerate(names):
            style: Any = {"color": _COLOURS[i % 4], "ls": ("-", "--", ":")[i // 4 % 3]}
            axes.plot(1e6 * along[i], size * curve.load, label=name, **style)
        axes.axhline(0.0, color=NOISE, lw=0.6)
        axes.axvline(0.0, color=NOISE, lw=0.6)
        axes.set_xlabel(f"deflection at M along the wrench, µ{unit}")
        axes.set_ylabel("force, N" if unit == "m" else "moment, N·m")
        axes.legend(fontsize=8, frameon=False)
        return figure

    save_figures(folder, {"force_over_deflection": draw})


def _project_curve(curve: LoadCurve) -> tuple[float, Array, str, Array]:
    """Return size of the load, displacement (n, s) along it, unit, tangent stiffness (n, s)."""
    wrench = curve.wrench
    part = slice(0, 3) if wrench[:3].any() else slice(3, 6)
    size = float(np.linalg.norm(wrench[part])) or 1.0
    axis = wrench[part] / size
    along = np.einsum("nis,i->ns", curve.twist[:, part], axis)
    unit = np.zeros(6)
    unit[part] = axis
    matrices = np.moveaxis(curve.stiffness, 3, 1)
    known: Flags = np.asarray(np.isfinite(matrices).all(axis=(2, 3), keepdims=True))
    yielding = (
        np.linalg.pinv(np.where(known, matrices, 0.0), rcond=1e-9, hermitian=True)
        @ unit
    )
    held = np.abs((matrices @ yielding[..., None])[..., 0] - unit).max(axis=2) < 1e-6
    stiff = np.where(held, 1.0 / np.where(held, yielding @ unit, 1.0), 0.0)
    stiff[~known[..., 0, 0]] = np.nan
    return size, along, "m" if part.start == 0 else "rad", stiff
