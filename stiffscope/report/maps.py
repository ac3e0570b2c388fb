"""The workspace maps of `stiffscope.vjm.maps` as figures and as tables of numbers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from stiffscope.errors import InputError
from stiffscope.report.numbers import DIAGONAL

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from pathlib import Path

    import xarray as xr
    from matplotlib.axes import Axes

    from stiffscope.vjm.analysis import Gravity
    from stiffscope.vjm.biglide import Biglide
    from stiffscope.vjm.maps import WorkspaceMap

    Poses = Mapping[str, tuple[float, float, float]]

TITLES = tuple(f"$K_{{{name[2:]}}}$" for name in DIAGONAL)
UNITS = (("N/µm", 1e-6),) * 3 + (("kN·m/rad", 1e-3),) * 3
AXES = ("x", "y", "z", "rx", "ry", "rz")
SAGS = (*(f"sag along {axis} (µm)" for axis in "xyz"), *(f"sag about {axis} (µrad)" for axis in "xyz"))
MARK = "#14181c"
SHOWN = "rectangle: main workspace W1 to W4"
CHANGE = "coolwarm"  # colours about zero


def robot_maps(robot: Biglide, poses: Poses, points: int, gravity: Gravity, g: float) -> WorkspaceMap:
    """Evaluate the maps over all that the robot reaches at y = 0.

    Parameters
    ----------
    robot
        A Biglide.
    poses
        Named tool points, m; the main workspace lies between the heights of Q1 and Q2 where they are there.
    points
        Tool points along x and along z.
    gravity, g
        How weight acts on stiffness; gravitational acceleration in m/s².

    Raises
    ------
    InputError
        The robot is not a Biglide.

    """
    from stiffscope.vjm import biglide
    from stiffscope.vjm.maps import reachable_box, workspace_map

    if not isinstance(robot, biglide.Biglide):
        name = type(robot).__name__
        raise InputError(f"map: expected a Biglide, whose workspace is known, got {name}; evaluate it at poses instead")
    box = reachable_box(robot.geometry)
    middle = [box.z_min + share * (box.z_max - box.z_min) for share in (1 / 3, 2 / 3)]
    heights = [poses[name][2] if name in poses else z for name, z in zip(("Q1", "Q2"), middle, strict=True)]
    low = robot.geometry.l1 + robot.geometry.l2
    q1, q2 = np.arcsin(np.clip((np.sort(heights) - low) / robot.geometry.L, -1.0, 1.0))
    return workspace_map(robot, (q1, q2), size=(points, points), gravity=gravity, g=g)


def draw_stiffness(found: WorkspaceMap, poses: Poses, title: str, *targets: Path, loaded: bool = False) -> None:
    """Draw the diagonal of K without or with the robot's own weight."""
    _draw(found, _stiffness(found.loaded if loaded else found.stiffness), 3, poses, title, targets)


def draw_difference(found: WorkspaceMap, poses: Poses, title: str, *targets: Path) -> None:
    """Draw the change by the robot's own weight, in parts per million of the stiffness without it."""
    _draw(found, _change(found), 3, poses, title, targets)


def draw_sag(found: WorkspaceMap, poses: Poses, title: str, *targets: Path) -> None:
    """Draw the platform's sag and tilt under the robot's own weight: the components above rounding."""
    largest = np.nanmax(np.abs(found.sag), axis=(0, 1))
    shown = [k for k in range(6) if largest[k] > 1e-4 * largest.max()] or [2]
    _draw(found, [Panel(SAGS[k], 1e6 * found.sag[..., k], "magma_r") for k in shown], 3, poses, title, targets)


def draw_all(found: WorkspaceMap, poses: Poses, title: str, *targets: Path) -> None:
    """Draw the diagonal of K without weight, with it, and the change: the whole map on one sheet."""
    panels = [*_stiffness(found.stiffness, " without weight"), *_stiffness(found.loaded, " with weight")]
    _draw(found, [*panels, *_change(found)], 6, poses, title, targets)


class Panel(NamedTuple):
    """One quantity (nz, nx) over the workspace, in the unit of its title."""

    title: str
    values: np.ndarray
    colours: str = "viridis"


def _stiffness(values: np.ndarray, words: str = "") -> list[Panel]:
    return [Panel(f"{TITLES[k]}{words} ({unit})", factor * values[..., k]) for k, (unit, factor) in enumerate(UNITS)]


def _change(found: WorkspaceMap) -> list[Panel]:
    change = 1e6 * (found.loaded / found.stiffness - 1)
    return [Panel(f"{TITLES[k]} with − without weight (ppm)", change[..., k], CHANGE) for k in range(6)]


def _draw(
    found: WorkspaceMap, panels: Sequence[Panel], most: int, poses: Poses, title: str, targets: Iterable[Path]
) -> None:
    """Draw panels, at most so many in a row, and write the sheet to each target."""
    from matplotlib.figure import Figure

    columns = min(len(panels), most)
    rows = -(-len(panels) // columns)
    figure = Figure(figsize=(4.5 * columns, 0.8 + 3.7 * rows), layout="constrained", facecolor="white")
    gap, size = ("  ", 14) if columns > 1 else ("\n", 11)
    heading: Any = {"t": f"{title}{gap}({SHOWN})", "fontsize": size, "fontweight": "bold"}
    figure.suptitle(x=0.01, ha="left", parse_math=False, **heading)
    grid = list(figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).flat)
    for axes in grid[len(panels) :]:
        axes.remove()
    for axes, panel in zip(grid, panels, strict=False):
        _fill(axes, found, panel)
        _mark(axes, found, poses)
    grid[0].invert_yaxis()
    for target in targets:
        figure.savefig(target, dpi=110)
        figure.set_layout_engine("none")  # laid out once: half of the time of a second format


def _fill(axes: Axes, found: WorkspaceMap, panel: Panel) -> None:
    x, z, values, change = 1e3 * found.x, 1e3 * found.z, panel.values, panel.colours == CHANGE
    low, high = np.nanmin(values), np.nanmax(values)
    if change:
        low, high = -max(abs(low), abs(high)), max(abs(low), abs(high))
    if high - low < 1e-9 * max(abs(low), abs(high)) or high == low:  # constant, apart from rounding
        low, high = low - max(abs(low), 1e-6), high + max(abs(high), 1e-6)
    image = axes.pcolormesh(x, z, values, cmap=panel.colours, shading="nearest", vmin=low, vmax=high, rasterized=True)
    if np.nanmax(values) - np.nanmin(values) > 1e-6 * abs(high):
        ink = "#3c4650" if change and np.nanmedian(np.abs(values)) < 0.5 * high else "white"
        drawn = axes.contour(x, z, values, levels=6, colors=ink, linewidths=0.6, linestyles="solid", alpha=0.8)
        axes.clabel(drawn, fontsize=7, fmt="%.5g")
    figure: Any = axes.get_figure()
    figure.colorbar(image, ax=axes, pad=0.01)
    axes.set(aspect="equal", xlabel="x (mm)", ylabel="z (mm, down)")
    axes.set_title(panel.title, fontsize=12)
    axes.label_outer()


def _mark(axes: Axes, found: WorkspaceMap, poses: Poses) -> None:
    """The named poses and the main workspace."""
    from matplotlib.patches import Rectangle
    from matplotlib.patheffects import withStroke

    halo: Any = [withStroke(linewidth=2.5, foreground="white")]
    main = found.main
    corner, width, height = (main.x_min, main.z_min), main.x_max - main.x_min, main.z_max - main.z_min
    outline = Rectangle((1e3 * corner[0], 1e3 * corner[1]), 1e3 * width, 1e3 * height, fill=False, color=MARK, lw=1.0)
    axes.add_patch(outline)
    for name, (x, _, z) in poses.items():
        place: Any = (1e3 * x, 1e3 * z)
        axes.plot(*place, "o", color=MARK, markersize=5, markeredgecolor="white")
        offset: Any = {"xytext": (6, 5), "textcoords": "offset points"}
        axes.annotate(name, place, color=MARK, weight="bold", path_effects=halo, parse_math=False, **offset)


def write_map(found: WorkspaceMap, folder: Path, title: str = "") -> None:
    """Write the numbers, SI: map.csv, a line for each reachable tool point; map.npz, arrays (z, x, direction); map.nc.

    The netCDF file is the dataset of `as_dataset`.
    """
    nz, nx, _ = found.stiffness.shape
    at = np.column_stack([np.tile(found.x, nz), np.repeat(found.z, nx)])
    rows = np.column_stack([at, *(values.reshape(-1, 6) for values in (found.stiffness, found.loaded, found.sag))])
    words = [name.lower().replace("_", "") for name in DIAGONAL]
    header = ",".join(["x", "z", *words, *(f"{word}_loaded" for word in words), *(f"sag_{axis}" for axis in AXES)])
    inside = np.isfinite(rows[:, 2])
    np.savetxt(folder / "map.csv", rows[inside], delimiter=",", header=header, comments="", fmt="%.9g")
    arrays = {"x": found.x, "y": np.float64(found.y), "z": found.z, "direction": np.array(DIAGONAL)}
    fields = {"stiffness": found.stiffness, "stiffness_loaded": found.loaded, "sag": found.sag}
    with (folder / "map.npz").open("wb") as stream:
        np.savez_compressed(stream, **arrays, **fields)  # type: ignore[arg-type]
    as_dataset(found, title).to_netcdf(folder / "map.nc", engine="scipy", format="NETCDF3_64BIT")


def as_dataset(found: WorkspaceMap, title: str = "") -> xr.Dataset:
    """Return a map as a dataset over (z, x) with names and units, SI; NaN where the robot does not reach.

    Variables are `K_tx` to `K_rz`, the same with `_loaded` (under the robot's own weight), and `sag_x` to `sag_rz`.
    """
    import xarray as xr

    forces, lengths = ("N m-1",) * 3 + ("N m rad-1",) * 3, ("m",) * 3 + ("rad",) * 3
    sags = [f"sag_{axis}" for axis in AXES]
    kinds = (
        (DIAGONAL, found.stiffness, forces, "stiffness at M without gravity"),
        ([f"{name}_loaded" for name in DIAGONAL], found.loaded, forces, "stiffness at M with the robot's own weight"),
        (sags, found.sag, lengths, "twist of the platform under the robot's own weight"),
    )
    variables = {
        name: (("z", "x"), values[..., k], {"units": units[k], "long_name": f"{words}, {AXES[k]}"})
        for names, values, units, words in kinds
        for k, name in enumerate(names)
    }
    places: dict[str, Any] = {
        "x": ("x", found.x, {"units": "m", "long_name": "M along the rail"}),
        "y": ((), found.y, {"units": "m", "long_name": "M across the rail"}),
        "z": ("z", found.z, {"units": "m", "long_name": "depth of M below the rail", "positive": "down"}),
    }
    box = found.main
    about = {
        "title": title or "workspace map",
        "Conventions": "CF-1.8",
        "source": "stiffscope",
        "main_workspace": f"x {box.x_min:.9g} to {box.x_max:.9g} m, z {box.z_min:.9g} to {box.z_max:.9g} m",
    }
    return xr.Dataset(variables, places, about)
