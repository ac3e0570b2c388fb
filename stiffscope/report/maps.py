"""The workspace maps of `stiffscope.vjm.maps` as figures and tables of numbers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from pathlib import Path

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from stiffscope.vjm.analysis import Gravity
    from stiffscope.vjm.biglide import Biglide
    from stiffscope.vjm.maps import WorkspaceMap

    Poses = Mapping[str, tuple[float, float, float]]

NAMES = ("K_tx", "K_ty", "K_tz", "K_rx", "K_ry", "K_rz")
TITLES = ("$K_{tx}$", "$K_{ty}$", "$K_{tz}$", "$K_{rx}$", "$K_{ry}$", "$K_{rz}$")
UNITS = (("N/µm", 1e-6),) * 3 + (("kN·m/rad", 1e-3),) * 3
SAGS = (*((f"sag along {axis}", "µm", 1e6) for axis in "xyz"), *((f"sag about {axis}", "µrad", 1e6) for axis in "xyz"))
MARK = "#14181c"
SHOWN = "rectangle: main workspace W1 to W4"


def robot_maps(robot: Biglide, poses: Poses, points: int, gravity: Gravity, g: float) -> WorkspaceMap:
    """Maps over all that the robot reaches; the main workspace lies between the heights of the poses Q1 and Q2."""
    from stiffscope.vjm.maps import reachable_box, workspace_map

    box = reachable_box(robot.geometry)
    middle = [box.z_min + share * (box.z_max - box.z_min) for share in (1 / 3, 2 / 3)]
    heights = [poses[name][2] if name in poses else z for name, z in zip(("Q1", "Q2"), middle, strict=True)]
    low = robot.geometry.l1 + robot.geometry.l2
    q1, q2 = np.arcsin(np.clip((np.sort(heights) - low) / robot.geometry.L, -1.0, 1.0))
    return workspace_map(robot, (q1, q2), size=(points, points), gravity=gravity, g=g)


def draw_stiffness(found: WorkspaceMap, poses: Poses, title: str, *targets: Path, loaded: bool = False) -> None:
    """Principal stiffness in six directions, without or with the robot's own weight."""
    values = found.loaded if loaded else found.stiffness
    panels = [(TITLES[k], UNITS[k][0], values[..., k] * UNITS[k][1]) for k in range(6)]
    _save(_panels(found, panels, poses, title, "viridis"), targets)


def draw_difference(found: WorkspaceMap, poses: Poses, title: str, *targets: Path) -> None:
    """What the robot's own weight changes, in parts per million of the stiffness without it."""
    change = 1e6 * (found.loaded / found.stiffness - 1)
    panels = [(f"{TITLES[k]}: with weight − without", "ppm", change[..., k]) for k in range(6)]
    _save(_panels(found, panels, poses, title, "coolwarm"), targets)


def draw_sag(found: WorkspaceMap, poses: Poses, title: str, *targets: Path) -> None:
    """How far the platform sinks and tilts under the robot's own weight: what of it is more than rounding."""
    most = np.nanmax(np.abs(found.sag), axis=(0, 1))
    told = [k for k in range(6) if most[k] > 1e-4 * most.max()] or [2]
    panels = [(SAGS[k][0], SAGS[k][1], found.sag[..., k] * SAGS[k][2]) for k in told]
    _save(_panels(found, panels, poses, title, "magma_r"), targets)


def draw_all(found: WorkspaceMap, poses: Poses, title: str, *targets: Path) -> None:
    """Every direction without weight, with it, and what it changes: the whole map on one sheet."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(25, 11.5), layout="constrained", facecolor="white")
    _head(figure, title)
    rows = (
        ("without weight", found.stiffness, "viridis"),
        ("with weight", found.loaded, "viridis"),
        ("with − without", 1e6 * (found.loaded / found.stiffness - 1), "coolwarm"),
    )
    grid = figure.subplots(3, 6, sharex=True, sharey=True)
    for line, (word, values, colours) in zip(grid, rows, strict=True):
        for k, axes in enumerate(line):
            unit, factor = ("ppm", 1.0) if colours == "coolwarm" else UNITS[k]
            _panel(axes, found, factor * values[..., k], unit, colours, lines=5)
            _mark(axes, found, poses)
            axes.set_title(f"{TITLES[k]} {word}", fontsize=12)
            axes.set_xlabel("x (mm)")
            axes.set_ylabel("z (mm, down)")
            axes.label_outer()
    grid[0, 0].invert_yaxis()
    _save(figure, targets)


def _head(figure: Figure, title: str) -> None:
    gap, size = ("  ", 14) if figure.get_figwidth() > 8 else ("\n", 11)
    figure.suptitle(f"{title}{gap}({SHOWN})", fontsize=size, fontweight="bold", x=0.01, ha="left")


def _panels(
    found: WorkspaceMap, panels: Sequence[tuple[str, str, np.ndarray]], poses: Poses, title: str, colours: str
) -> Figure:
    from matplotlib.figure import Figure

    columns = min(len(panels), 3)
    rows = -(-len(panels) // columns)
    figure = Figure(figsize=(14 * columns / 3, 0.8 + 3.7 * rows), layout="constrained", facecolor="white")
    _head(figure, title)
    grid = list(figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).flat)
    for axes in grid[len(panels) :]:
        axes.remove()
    for axes, (name, unit, values) in zip(grid, panels, strict=False):
        _panel(axes, found, values, unit, colours)
        _mark(axes, found, poses)
        axes.set_title(name, fontsize=12)
        axes.set_xlabel("x (mm)")
        axes.set_ylabel("z (mm, down)")
        axes.label_outer()
    grid[0].invert_yaxis()
    return figure


def _panel(axes: Axes, found: WorkspaceMap, values: np.ndarray, unit: str, colours: str, lines: int = 8) -> None:
    x, z = 1e3 * found.x, 1e3 * found.z
    low, high = np.nanmin(values), np.nanmax(values)
    if colours == "coolwarm":
        low, high = -max(abs(low), abs(high)), max(abs(low), abs(high))
    if high - low < 1e-9 * max(abs(low), abs(high)) or high == low:  # the same everywhere, but for rounding
        low, high = low - max(abs(low), 1e-6), high + max(abs(high), 1e-6)
    image = axes.pcolormesh(x, z, values, cmap=colours, shading="nearest", vmin=low, vmax=high, rasterized=True)
    if np.nanmax(values) - np.nanmin(values) > 1e-6 * abs(high):
        drawn = axes.contour(x, z, values, levels=lines, colors="white", linewidths=0.6, linestyles="solid", alpha=0.8)
        axes.clabel(drawn, fontsize=7, fmt="%.5g")
    axes.get_figure().colorbar(image, ax=axes, label=unit, pad=0.01)  # type: ignore[union-attr]
    axes.set_aspect("equal")


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
        axes.plot(1e3 * x, 1e3 * z, "o", color=MARK, markersize=5, markeredgecolor="white")
        label = axes.annotate(name, (1e3 * x, 1e3 * z), (6, 5), textcoords="offset points", color=MARK, weight="bold")
        label.set_path_effects(halo)


def _save(figure: Figure, targets: Iterable[Path]) -> None:
    for target in targets:
        figure.savefig(target, dpi=110)


def write_map(found: WorkspaceMap, folder: Path, title: str = "") -> None:
    """The numbers, SI: map.csv (a line for each reachable tool point), map.npz (arrays (z, x, direction)), map.nc."""
    nz, nx, _ = found.stiffness.shape
    at = np.column_stack([np.tile(found.x, nz), np.repeat(found.z, nx)])
    columns = {"": found.stiffness, "_loaded": found.loaded, "sag_": found.sag}
    rows = np.column_stack([at, *(values.reshape(-1, 6) for values in columns.values())])
    words = [name.lower().replace("_", "") for name in NAMES]
    sags = [f"sag_{axis}" for axis in ("x", "y", "z", "rx", "ry", "rz")]
    header = ",".join(["x", "z", *words, *(f"{word}_loaded" for word in words), *sags])
    inside = np.isfinite(rows[:, 2])
    np.savetxt(folder / "map.csv", rows[inside], delimiter=",", header=header, comments="", fmt="%.9g")
    arrays = {"x": found.x, "y": np.float64(found.y), "z": found.z, "direction": np.array(NAMES)}
    fields = {"stiffness": found.stiffness, "stiffness_loaded": found.loaded, "sag": found.sag}
    with (folder / "map.npz").open("wb") as stream:
        np.savez_compressed(stream, **arrays, **fields)  # type: ignore[arg-type]
    write_netcdf(found, folder / "map.nc", title)


def write_netcdf(found: WorkspaceMap, target: Path, title: str) -> None:
    """The map as netCDF with names and units on every variable, NaN where the robot does not reach."""
    from scipy.io import netcdf_file

    kinds = (
        ("", "stiffness at M without gravity", "{}", found.stiffness, ("N m-1", "N m rad-1")),
        ("_loaded", "stiffness at M with the robot's own weight", "{}", found.loaded, ("N m-1", "N m rad-1")),
        ("sag_", "twist of the platform under the robot's own weight", "sag_{}", found.sag, ("m", "rad")),
    )
    with netcdf_file(target, "w", version=2) as file:
        file.title, file.Conventions, file.source = title or "workspace map", "CF-1.8", "stiffscope"
        box = found.main
        file.main_workspace = f"x {box.x_min:.9g} to {box.x_max:.9g} m, z {box.z_min:.9g} to {box.z_max:.9g} m"
        for name, values, text in (("z", found.z, "height of M below the rail"), ("x", found.x, "M along the rail")):
            file.createDimension(name, len(values))
            _variable(file, name, (name,), values, "m", text)
        _variable(file, "y", (), np.float64(found.y), "m", "M across the rail")
        for suffix, text, form, values, units in kinds:
            for k, name in enumerate(NAMES):
                axis = name.removeprefix("K_").removeprefix("t")
                full = form.format(axis) if suffix == "sag_" else f"{name}{suffix}"
                _variable(file, full, ("z", "x"), values[..., k], units[k > 2], f"{text}, {axis}", fill=True)


def _variable(
    file: Any, name: str, dimensions: tuple[str, ...], values: Any, unit: str, text: str, *, fill: bool = False
) -> None:
    variable = file.createVariable(name, "d", dimensions)
    variable[...] = values
    variable.units, variable.long_name = unit, text
    if fill:
        variable._FillValue = np.float64(np.nan)  # noqa: SLF001 (the name that netCDF gives it)
