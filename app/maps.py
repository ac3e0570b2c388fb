"""Principal stiffness over the workspace: numbers on a grid of tool points, and the figure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from vjm.analysis import Gravity
    from vjm.biglide import Biglide

NAMES = ("K_tx", "K_ty", "K_tz", "K_rx", "K_ry", "K_rz")
UNITS = ("N/µm",) * 3 + ("kN·m/rad",) * 3
FACTORS = (1e6,) * 3 + (1e3,) * 3


@dataclass(frozen=True)
class StiffnessMap:
    """Diagonal of K over tool points at y = 0; `values` (nz, nx, 6) SI, NaN where the tool cannot go."""

    x: np.ndarray
    z: np.ndarray
    values: np.ndarray


def stiffness_map(robot: Biglide, points: int, gravity: Gravity = "none", g: float = 9.81) -> StiffnessMap:
    """Principal stiffness at points × points tool points that span the reachable workspace at y = 0."""
    from vjm.analysis import stiffness
    from vjm.biglide import reachable

    dimensions = robot.geometry
    half = (dimensions.a_max - dimensions.a_min) / 2
    cosines = np.clip((np.array([dimensions.a_max, dimensions.a_min]) - dimensions.l) / dimensions.L, 0.0, 1.0)
    low, high = dimensions.l1 + dimensions.l2 + dimensions.L * np.sqrt(1 - cosines**2)
    x, z = np.linspace(-half, half, points), np.linspace(low, high, points)
    grid = np.array(np.meshgrid(x, [0.0], z, indexing="ij"))[:, :, 0].transpose(2, 1, 0).reshape(-1, 3)
    inside = reachable(dimensions, grid)
    values = np.full((len(grid), 6), np.nan)
    if inside.any():
        matrices = stiffness(robot, grid[inside], gravity=gravity, g=g)
        values[inside] = np.diagonal(matrices, axis1=1, axis2=2)
    return StiffnessMap(x, z, values.reshape(points, points, 6))


def draw_map(found: StiffnessMap, poses: Mapping[str, tuple[float, float, float]], title: str, *targets: Path) -> None:
    """One figure, six panels, with units and the named poses; the format follows the targets' suffixes."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(14, 7.4), layout="constrained", facecolor="white")
    figure.suptitle(title, fontsize=14, fontweight="bold", x=0.01, ha="left")
    shown = np.isfinite(found.values[..., 0])
    rows, columns = shown.any(axis=1), shown.any(axis=0)
    x, z = 1e3 * found.x[columns], 1e3 * found.z[rows]
    for k, axes in enumerate(figure.subplots(2, 3, sharex=True, sharey=True).flat):
        values = found.values[np.ix_(rows, columns, [k])][..., 0] / FACTORS[k]
        colours = axes.pcolormesh(x, z, values, cmap="viridis", shading="nearest", rasterized=True)
        if np.nanmax(values) > 1.001 * np.nanmin(values):
            lines = axes.contour(x, z, values, levels=8, colors="white", linewidths=0.6, alpha=0.8)
            axes.clabel(lines, fontsize=7, fmt="%.4g")
        figure.colorbar(colours, ax=axes, label=UNITS[k], pad=0.01)
        for name, (px, _, pz) in poses.items():
            axes.plot(1e3 * px, 1e3 * pz, "o", color="#e4572e", markersize=5, markeredgecolor="white")
            axes.annotate(
                name, (1e3 * px, 1e3 * pz), (6, 4), textcoords="offset points", color="#e4572e", weight="bold"
            )
        axes.set_title(NAMES[k].replace("_", "$_{") + "}$", fontsize=12)
        axes.set_aspect("equal")
    for axes in figure.axes[:6]:
        axes.set_xlabel("x (mm)")
        axes.set_ylabel("z (mm, down)")
        axes.label_outer()
    figure.axes[0].invert_yaxis()
    for target in targets:
        figure.savefig(target, dpi=110)


def write_map(found: StiffnessMap, folder: Path, name: str = "map") -> None:
    """The numbers as CSV (reachable points alone, SI) and npz."""
    nz, nx, _ = found.values.shape
    grid = np.column_stack([np.tile(found.x, nz), np.repeat(found.z, nx), found.values.reshape(-1, 6)])
    inside = grid[np.isfinite(grid[:, 2])]
    header = "x,z,ktx,kty,ktz,krx,kry,krz"
    np.savetxt(folder / f"{name}.csv", inside, delimiter=",", header=header, comments="", fmt="%.9g")
    np.savez_compressed(folder / f"{name}.npz", x=found.x, z=found.z, stiffness=found.values)
