"""Pictures of stiffness maps, and files of those over three coordinates."""

from __future__ import annotations

from textwrap import fill
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from stiffscope.report.figures import save_figure
from stiffscope.report.kept_pictures import Order, robot_facts
from stiffscope.robot.file.quantities import shown_unit
from stiffscope.runtime.cache import code_version, digest
from stiffscope.statics.maps import StiffnessVolume, map_robot, write_map
from stiffscope.vjm.model.mechanism import COORDINATES, DIAGONAL

MAP_POINTS = 31

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    import xarray as xr
    from matplotlib.axes import Axes

    from stiffscope.experiments.assembly import Assembled
    from stiffscope.statics.maps import StiffnessMap

    Poses = Mapping[str, Sequence[float]]

TITLES = tuple(f"$K_{{{name[2:]}}}$" for name in DIAGONAL)
UNITS = (("N/µm", 1e-6),) * 3 + (("kN·m/rad", 1e-3),) * 3
SAGS = [f"sag along {axis} (µm)" for axis in "xyz"] + [
    f"sag about {axis} (µrad)" for axis in "xyz"
]
MARK = "#14181c"
CHANGE = "coolwarm"  # diverging colours, centred at zero
_FEW = 2.0  # percent of the values clipped at either end,
_CONSTANT = 1e-3  # of a quantity: what varies less over a map is constant
_ZERO = 1e-6  # in the unit of a panel's title: rounding
_FAR = 0.35  # if the remaining range is less than this share of the whole range


class Panel(NamedTuple):
    """One quantity (nu, na) over the map, in the unit of its title."""

    title: str
    values: np.ndarray
    colours: str = "viridis"


def stiffness_panels(stiffness_map: StiffnessMap) -> list[Panel]:
    """Return panels of the diagonal of K, including the robot's own weight if it acts."""
    each = zip(TITLES, UNITS, np.moveaxis(stiffness_map.loaded, -1, 0), strict=True)
    return [
        Panel(f"{title} ({unit})", factor * values)
        for title, (unit, factor), values in each
    ]


def push_panels(stiffness_map: StiffnessMap) -> list[Panel]:
    """Return panels of 1/C_ii, the stiffness that a push along each direction meets."""
    each = zip(COORDINATES, UNITS, np.moveaxis(stiffness_map.push, -1, 0), strict=True)
    return [
        Panel(
            f"$1/C$ along {axis} ({unit})"
            if k < 3
            else f"$1/C$ about {axis[1]} ({unit})",
            factor * values,
        )
        for k, (axis, (unit, factor), values) in enumerate(each)
    ]


def difference_panels(
    stiffness_map: StiffnessMap,
    words: str = "with − without weight (ppm)",
    factor: float = 1e6,
) -> list[Panel]:
    """Return the change due to the robot's own weight, in ppm of the stiffness without it."""
    change = factor * (stiffness_map.loaded / stiffness_map.stiffness - 1)
    return [
        Panel(f"{title} {words}", change[..., k], CHANGE)
        for k, title in enumerate(TITLES)
    ]


def scalar_panels(stiffness_map: StiffnessMap) -> list[Panel]:
    """Return panels of the additional quantities requested."""
    units = {"N m-1": (" (N/µm)", 1e-6), "m": (" (µm)", 1e6), "1": ("", 1.0)}
    each = [(scalar, *units[scalar.unit]) for scalar in stiffness_map.more.values()]
    return [
        Panel(fill(s.words, 34) + unit, factor * s.values) for s, unit, factor in each
    ]


def pick_slices(stiffness_map: StiffnessMap | StiffnessVolume) -> list[StiffnessMap]:
    """Return a map itself, or the first, middle and last reachable maps of a volume."""
    if not isinstance(stiffness_map, StiffnessVolume):
        return [stiffness_map]
    reached = [layer for layer in stiffness_map.maps if layer.reached.any()]
    return [reached[k] for k in sorted({0, len(reached) // 2, len(reached) - 1})]


def sag_panels(stiffness_map: StiffnessMap) -> list[Panel]:
    """Return panels of the tool's sag and tilt under the robot's own weight, above rounding."""
    largest = np.nanmax(np.abs(stiffness_map.sag), axis=(0, 1))
    shown = [k for k in range(6) if largest[k] > 1e-4 * largest.max()] or [2]
    return [Panel(SAGS[k], 1e6 * stiffness_map.sag[..., k], "magma_r") for k in shown]


def frequency_panels(stiffness_map: StiffnessMap) -> list[Panel]:
    """Return panels of the first natural frequencies."""
    values = (
        np.zeros((0, 0, 0))
        if stiffness_map.frequencies is None
        else stiffness_map.frequencies
    )
    panels = [
        Panel(f"$f_{{{k + 1}}}$ (Hz)", values[..., k]) for k in range(values.shape[2])
    ]
    return [panel for panel in panels if np.isfinite(panel.values).any()]


def draw_map(
    stiffness_map: StiffnessMap,
    panels: Sequence[Panel],
    poses: Poses,
    title: str,
    *targets: Path,
) -> None:
    """Draw panels, at most three per row, and write the sheet to each target.

    Parameters
    ----------
    stiffness_map, panels
        Map of the robot, and the quantities to draw.
    poses
        Named poses to mark, in all coordinates.
    title, *targets
        Title, and files, PNG or SVG according to their suffix.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    columns = min(len(panels), 3)
    rows = -(-len(panels) // columns)
    across, up = (
        float(np.ptp(values)) for values in (stiffness_map.columns, stiffness_map.rows)
    )
    alike = shown_unit(stiffness_map.across) == shown_unit(stiffness_map.up)
    slim = np.clip(up / across, 0.4, 1.6) if alike else 0.8
    size = 4.5 * columns, 0.8 + (0.6 + 3.6 * slim) * rows
    figure = Figure(figsize=size, layout="constrained", facecolor="white")
    FigureCanvasAgg(
        figure
    )  # without a canvas, each contour label would redraw the whole sheet
    heading: Any = {"fontsize": 14 if columns > 1 else 11, "fontweight": "bold"}
    figure.suptitle(title, x=0.01, ha="left", parse_math=False, **heading)
    grid = list(
        figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).flat
    )
    for axes in grid[len(panels) :]:
        axes.remove()
    for axes, panel in zip(grid, panels, strict=False):
        _fill(axes, stiffness_map, panel)
        _mark(axes, stiffness_map, poses)
    if stiffness_map.down:
        grid[0].invert_yaxis()
    save_figure(figure, *targets)


def _fill(axes: Axes, stiffness_map: StiffnessMap, panel: Panel) -> None:
    (across, wide) = shown_unit(stiffness_map.across)
    (up, tall) = shown_unit(stiffness_map.up)
    grid = across * stiffness_map.columns, up * stiffness_map.rows
    if np.isfinite(panel.values).any():
        _colour(axes, grid, panel)
    else:
        axes.pcolormesh(
            *grid, panel.values, shading="nearest", rasterized=True, vmin=0.0, vmax=1.0
        )
        text = "rigid" if stiffness_map.rigid.any() else "no value"
        axes.text(
            0.5,
            0.85,
            text,
            transform=axes.transAxes,
            ha="center",
            va="center",
            fontsize=14,
            color=MARK,
        )
    down = ", down" if stiffness_map.down else ""
    axes.set(
        xlabel=f"{stiffness_map.across} ({wide})",
        ylabel=f"{stiffness_map.up} ({tall}{down})",
    )
    axes.set_aspect("equal" if wide == tall else "auto")
    axes.set_title(panel.title, fontsize=12)
    axes.label_outer()


def _colour(axes: Axes, grid: tuple[np.ndarray, np.ndarray], panel: Panel) -> None:
    values = panel.values
    change = panel.colours == CHANGE
    if is_constant(values):
        _paint_constant(axes, grid, panel)
        return
    low, high, clipped = _limits(values)
    largest = max(abs(low), abs(high))
    if change:
        low = -largest
        high = largest
    colours: Any = {"cmap": panel.colours, "vmin": low, "vmax": high}
    image = axes.pcolormesh(
        *grid, values, shading="nearest", rasterized=True, **colours
    )
    pale = change and np.nanmedian(np.abs(values)) < 0.5 * high
    lines: Any = {
        "colors": "#3c4650" if pale else "white",
        "linewidths": 0.6,
        "linestyles": "solid",
        "alpha": 0.8,
    }
    drawn = axes.contour(*grid, values.clip(low, high), levels=6, **lines)
    axes.clabel(drawn, fontsize=7, fmt="%.5g")
    figure: Any = axes.get_figure()
    bar = axes.inset_axes(
        (1.03, 0.0, 0.045, 1.0)
    )  # as high as the map for any aspect ratio
    figure.colorbar(image, cax=bar, extend="both" if clipped else "neither")


def is_constant(values: np.ndarray) -> bool:
    """Return whether a quantity varies by less than a thousandth, or is zero, over a map."""
    low = float(np.nanmin(values))
    high = float(np.nanmax(values))
    return high - low <= _CONSTANT * max(abs(low), abs(high), _ZERO)


def _paint_constant(
    axes: Axes, grid: tuple[np.ndarray, np.ndarray], panel: Panel
) -> None:
    """Fill the map with one colour, and print the value and by how much it varies."""
    middle = 0.5 * (np.nanmin(panel.values) + np.nanmax(panel.values))
    spread = 0.5 * np.ptp(panel.values[np.isfinite(panel.values)])
    even = np.where(np.isfinite(panel.values), 0.5, np.nan)
    axes.pcolormesh(
        *grid,
        even,
        shading="nearest",
        rasterized=True,
        cmap=panel.colours,
        vmin=0.0,
        vmax=1.0,
    )
    text = f"constant: {middle:.5g}"
    if abs(middle) > _ZERO and spread > 1e-9 * abs(middle):
        text += f"\n± {100 * spread / abs(middle):.2g} %"
    paper: Any = {"facecolor": "white", "alpha": 0.8, "edgecolor": "none"}
    axes.text(
        0.5,
        0.85,
        text,
        transform=axes.transAxes,
        ha="center",
        va="center",
        fontsize=12,
        color=MARK,
        bbox=paper,
    )


def _limits(values: np.ndarray) -> tuple[float, float, bool]:
    """Return the limits of the colours, and whether outliers near singular poses are clipped."""
    low = float(np.nanmin(values))
    high = float(np.nanmax(values))
    inner, outer = np.nanpercentile(values, [_FEW, 100.0 - _FEW])
    if outer - inner < _FAR * (high - low):
        return float(inner), float(outer), True
    return low, high, False


def _mark(axes: Axes, stiffness_map: StiffnessMap, poses: Poses) -> None:
    """Mark the named poses that lie in the map."""
    from matplotlib.patheffects import withStroke

    halo: Any = [withStroke(linewidth=2.5, foreground="white")]
    swept = {stiffness_map.across, stiffness_map.up}
    names = [name for name in COORDINATES if name in swept or name in stiffness_map.at]
    for label, pose in poses.items():
        coordinates = dict(zip(names, pose, strict=True))
        if not stiffness_map.holds(coordinates):
            continue
        place: Any = [
            shown_unit(name)[0] * coordinates[name]
            for name in (stiffness_map.across, stiffness_map.up)
        ]
        axes.plot(*place, "o", color=MARK, markersize=5, markeredgecolor="white")
        style: Any = {"weight": "bold", "path_effects": halo, "parse_math": False}
        left = 2.0 * place[0] > sum(axes.get_xlim())  # the colour bar is on the right
        style |= {
            "ha": "right" if left else "left",
            "textcoords": "offset points",
            "color": MARK,
        }
        axes.annotate(label, place, (-6 if left else 6, 5), **style)


def write_volume(dataset: xr.Dataset, folder: Path) -> None:
    """Write map.vti with point data by variable; m and rad, NaN if out of reach."""
    import pyvista as pv

    order = next(iter(dataset.data_vars.values())).dims[::-1]
    places = [dataset[name].to_numpy() for name in order]
    starts, nexts = np.array([place[:2] for place in places]).T
    sizes: Any = {"spacing": (nexts - starts).tolist(), "origin": starts.tolist()}
    image = pv.ImageData(dimensions=tuple(map(len, places)), **sizes)
    for name, values in dataset.data_vars.items():
        image.point_data[str(name)] = np.ascontiguousarray(values.to_numpy()).ravel()
    image.save(folder / "map.vti")


def held_text(stiffness_map: StiffnessMap) -> str:
    """Return what is held for the end of a title: ", y = 0 mm, turntable as at home"; "" if there is nothing."""
    text = ""
    for name, value in stiffness_map.at.items():
        factor, unit = shown_unit(name)
        text += f", {name} = {factor * value:z.5g} {unit}"
    return text + "".join(f", {name} as at home" for name in stiffness_map.still)


def stiffness_title(stiffness_map: StiffnessMap) -> str:
    """Return the title of a map's `stiffness_panels`."""
    what = "diagonal of K"
    if stiffness_map.rigid.any():
        what += "; 1/C_ii where a direction is rigid"
    return f"stiffness at M ({what}){held_text(stiffness_map)}"


def order_map(assembled: Assembled, target: Path) -> list[Order]:
    """Order the small map of a run, if its robot file has `[map]`."""
    if assembled.robot.map is None:
        return []
    rooms = (
        "stiffscope.vjm",
        "stiffscope.robot",
        "stiffscope.report",
        "stiffscope.statics",
    )
    code = code_version(rooms, ("matplotlib", "numpy"))
    key = digest({**robot_facts(assembled), "code": code})
    return [Order("map", key, lambda to, _: _draw_map(assembled, to), target)]


def _draw_map(assembled: Assembled, folder: Path) -> None:
    robot = assembled.robot
    stiffness_map = map_robot(robot, assembled.mechanism, MAP_POINTS, "exact")
    write_map(stiffness_map, folder)
    title = f"{robot.name}: {stiffness_title(stiffness_map)}, gravity exact"
    draw_map(
        stiffness_map,
        stiffness_panels(stiffness_map),
        robot.poses,
        title,
        folder / "map.png",
    )
