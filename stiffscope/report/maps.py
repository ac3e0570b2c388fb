"""Maps of the stiffness over two coordinates of the tool: evaluated, drawn, and written as tables of numbers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from stiffscope.errors import InputError
from stiffscope.report.figures import save_figure
from stiffscope.report.numbers import DIAGONAL

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from pathlib import Path

    import xarray as xr
    from matplotlib.axes import Axes

    from stiffscope.robot.file.description import RobotFile
    from stiffscope.robot.file.sections import MapSection
    from stiffscope.vjm.mechanism import Mechanism
    from stiffscope.vjm.statics import Gravity

    Poses = Mapping[str, Sequence[float]]
    Ranges = Mapping[str, tuple[float, float]]

TITLES = tuple(f"$K_{{{name[2:]}}}$" for name in DIAGONAL)
UNITS = (("N/µm", 1e-6),) * 3 + (("kN·m/rad", 1e-3),) * 3
AXES = ("x", "y", "z", "rx", "ry", "rz")
SAGS = (*(f"sag along {axis} (µm)" for axis in "xyz"), *(f"sag about {axis} (µrad)" for axis in "xyz"))
MARK = "#14181c"
CHANGE = "coolwarm"  # colours about zero
IN_PLANE = 1e-6  # m or rad that a pose may be off the map and is still marked on it
_FEW, _FAR = (
    2.0,
    0.35,
)  # percent at either end that is left beyond the colours where the rest spans less than this share


@dataclass(frozen=True, eq=False)
class StiffnessMap:
    """Maps over a grid of tool poses; NaN where the robot does not reach or weights find no equilibrium.

    ``across`` and ``up`` name the two coordinates swept, ``columns`` (na,) and ``rows`` (nu,) are their values, ``at``
    those of the others, m and rad. ``stiffness`` and ``loaded`` (nu, na, 6): diagonals of the stiffness at M without
    and with the robot's own weight, N/m and N·m/rad; ``sag`` (nu, na, 6) in m, rad. ``down``: rows grow downwards.
    ``frequencies`` (nu, na, c): the first natural frequencies in Hz, drives held, where they were asked for.
    """

    across: str
    up: str
    columns: np.ndarray
    rows: np.ndarray
    at: dict[str, float]
    stiffness: np.ndarray
    loaded: np.ndarray
    sag: np.ndarray
    down: bool = False
    frequencies: np.ndarray | None = None

    def holds(self, coordinates: Mapping[str, float]) -> bool:
        """Whether a pose lies in what is swept."""
        return all(abs(coordinates[name] - value) < IN_PLANE for name, value in self.at.items())


def robot_map(
    robot: RobotFile, mechanism: Mechanism, points: int, gravity: Gravity, frequencies: int = 0
) -> StiffnessMap:
    """Evaluate what `[map]` of a robot file sweeps. Raises InputError where it has none, or nothing is reached."""
    section = swept(robot)
    return stiffness_map(mechanism, section.ranges(), points, gravity=gravity, at=section.at, frequencies=frequencies)


def swept(robot: RobotFile) -> MapSection:
    """What `[map]` of a robot file says. Raises InputError where it has none."""
    if robot.map is None:
        example = 'such as x = ["-150 mm", "150 mm"] and z = ["380 mm", "520 mm"]'
        raise InputError(f"{robot.path}: map: expected a table of two coordinates to sweep, {example}, got none")
    return robot.map


def stiffness_map(
    mechanism: Mechanism,
    ranges: Ranges,
    points: int,
    *,
    gravity: Gravity = "none",
    at: Sequence[float] | None = None,
    frequencies: int = 0,
) -> StiffnessMap:
    """Evaluate the stiffness over two coordinates of the tool.

    Parameters
    ----------
    mechanism
        Any mechanism whose tool has at least two coordinates.
    ranges
        Two coordinates of `mechanism.tool.pose` and the ends of each, m and rad; the first is drawn across.
    points
        Poses along either.
    gravity
        "exact" for the stiffness under the mechanism's own weight and the sag, beside those without.
    at : (k,)
        Pose that gives the other coordinates, by default home.
    frequencies
        How many natural frequencies besides, drives held.

    Raises
    ------
    InputError
        Not two coordinates of the tool, or no pose is reached.

    """
    from stiffscope.vjm.kinematics import configure
    from stiffscope.vjm.modes import frequencies as natural
    from stiffscope.vjm.statics import analyse_weight, stiffness

    pose = mechanism.tool.pose
    if len(ranges) != 2 or not set(ranges) <= set(pose):
        raise InputError(f"map: expected two of {', '.join(pose)}, got {', '.join(ranges) or 'none'}")
    (across, columns), (up, rows) = ((name, np.linspace(*ends, points)) for name, ends in ranges.items())
    fixed = mechanism.tool.home if at is None else np.asarray(at, dtype=float)
    grid = np.tile(fixed, (points * points, 1))
    grid[:, pose.index(across)], grid[:, pose.index(up)] = np.tile(columns, points), np.repeat(rows, points)
    found = configure(mechanism, grid)
    if not found.valid.any():
        raise InputError(f"map: no pose is within reach; the first is not: {found.reason(0)}")
    plain = loaded = stiffness(mechanism, found)
    sag = np.where(found.valid[:, None], np.zeros((len(grid), 6)), np.nan)
    if gravity != "none":
        loaded, sag = analyse_weight(mechanism, found, plain)
    diagonals = (np.diagonal(matrix, axis1=1, axis2=2) for matrix in (plain, loaded))
    values = (value.reshape(points, points, 6) for value in (*diagonals, sag))
    others = {name: float(v) for name, v in zip(pose, fixed, strict=True) if name not in ranges}
    weight = mechanism.gravity[AXES.index(up)] if up in AXES[:3] else 0.0
    sounds = natural(mechanism, found, frequencies).reshape(points, points, frequencies) if frequencies else None
    return StiffnessMap(across, up, columns, rows, others, *values, down=bool(weight > 0.0), frequencies=sounds)


def draw_stiffness(found: StiffnessMap, poses: Poses, title: str, *targets: Path) -> None:
    """Draw the diagonal of K, under the robot's own weight where it acts; `poses` by name, in all coordinates."""
    panels = [Panel(f"{TITLES[k]} ({unit})", factor * found.loaded[..., k]) for k, (unit, factor) in enumerate(UNITS)]
    _draw(found, panels, poses, title, targets)


def draw_difference(found: StiffnessMap, poses: Poses, title: str, *targets: Path) -> None:
    """Draw the change by the robot's own weight, in parts per million of the stiffness without it."""
    change = 1e6 * (found.loaded / found.stiffness - 1)
    panels = [Panel(f"{TITLES[k]} with − without weight (ppm)", change[..., k], CHANGE) for k in range(6)]
    _draw(found, panels, poses, title, targets)


def draw_sag(found: StiffnessMap, poses: Poses, title: str, *targets: Path) -> None:
    """Draw the tool's sag and tilt under the robot's own weight: the components above rounding."""
    largest = np.nanmax(np.abs(found.sag), axis=(0, 1))
    shown = [k for k in range(6) if largest[k] > 1e-4 * largest.max()] or [2]
    _draw(found, [Panel(SAGS[k], 1e6 * found.sag[..., k], "magma_r") for k in shown], poses, title, targets)


def draw_frequencies(found: StiffnessMap, poses: Poses, title: str, *targets: Path) -> None:
    """Draw the first natural frequencies."""
    values = np.zeros((0, 0, 0)) if found.frequencies is None else found.frequencies
    panels = [Panel(f"$f_{{{k + 1}}}$ (Hz)", values[..., k]) for k in range(values.shape[2])]
    _draw(found, [p for p in panels if np.isfinite(p.values).any()], poses, title, targets)


class Panel(NamedTuple):
    """One quantity (nu, na) over the map, in the unit of its title."""

    title: str
    values: np.ndarray
    colours: str = "viridis"


def _draw(found: StiffnessMap, panels: Sequence[Panel], poses: Poses, title: str, targets: Iterable[Path]) -> None:
    """Draw panels, at most three in a row, and write the sheet to each target."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    columns = min(len(panels), 3)
    rows = -(-len(panels) // columns)
    across, up = (float(np.ptp(values)) for values in (found.columns, found.rows))
    slim = np.clip(up / across, 0.4, 1.6) if _alike(found) else 0.8
    figure = Figure(figsize=(4.5 * columns, 0.8 + (0.6 + 3.6 * slim) * rows), layout="constrained", facecolor="white")
    FigureCanvasAgg(figure)  # knows the extent of a text; without it every label of a contour would draw the sheet
    heading: Any = {"fontsize": 14 if columns > 1 else 11, "fontweight": "bold"}
    figure.suptitle(title, x=0.01, ha="left", parse_math=False, **heading)
    grid = list(figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).flat)
    for axes in grid[len(panels) :]:
        axes.remove()
    for axes, panel in zip(grid, panels, strict=False):
        _fill(axes, found, panel)
        _mark(axes, found, poses)
    if found.down:
        grid[0].invert_yaxis()
    save_figure(figure, *targets)


def _alike(found: StiffnessMap) -> bool:
    """Whether both coordinates are lengths, or both angles."""
    return found.across.startswith("r") == found.up.startswith("r")


def _fill(axes: Axes, found: StiffnessMap, panel: Panel) -> None:
    values, change = panel.values, panel.colours == CHANGE
    low, high, clipped = _limits(values)
    if change:
        low, high = -max(abs(low), abs(high)), max(abs(low), abs(high))
    if high - low < 1e-9 * max(abs(low), abs(high)) or high == low:  # constant, apart from rounding
        low, high = low - max(abs(low), 1e-6), high + max(abs(high), 1e-6)
    x, y = _factor(found.across) * found.columns, _factor(found.up) * found.rows
    image = axes.pcolormesh(x, y, values, cmap=panel.colours, shading="nearest", vmin=low, vmax=high, rasterized=True)
    if np.nanmax(values) - np.nanmin(values) > 1e-6 * abs(high):
        ink = "#3c4650" if change and np.nanmedian(np.abs(values)) < 0.5 * high else "white"
        drawn = axes.contour(
            x, y, values.clip(low, high), levels=6, colors=ink, linewidths=0.6, linestyles="solid", alpha=0.8
        )
        axes.clabel(drawn, fontsize=7, fmt="%.5g")
    figure: Any = axes.get_figure()
    bar = axes.inset_axes((1.03, 0.0, 0.045, 1.0))  # as high as the map, whatever its aspect
    figure.colorbar(image, cax=bar, extend="both" if clipped else "neither")
    down = ", down" if found.down else ""
    axes.set(xlabel=f"{found.across} ({_unit(found.across)})", ylabel=f"{found.up} ({_unit(found.up)}{down})")
    axes.set_aspect("equal" if _alike(found) else "auto")
    axes.set_title(panel.title, fontsize=12)
    axes.label_outer()


def _limits(values: np.ndarray) -> tuple[float, float, bool]:
    """Lowest and highest value in colours; whether a few far out, near singular poses, are left beyond them."""
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    inner, outer = np.nanpercentile(values, [_FEW, 100.0 - _FEW])
    if outer - inner < _FAR * (high - low):
        return float(inner), float(outer), True
    return low, high, False


def _factor(coordinate: str) -> float:
    """What a coordinate is multiplied by to be drawn."""
    return 180.0 / np.pi if coordinate.startswith("r") else 1e3


def _unit(coordinate: str) -> str:
    return "deg" if coordinate.startswith("r") else "mm"


def _mark(axes: Axes, found: StiffnessMap, poses: Poses) -> None:
    """The named poses that lie in what is swept."""
    from matplotlib.patheffects import withStroke

    halo: Any = [withStroke(linewidth=2.5, foreground="white")]
    swept = {found.across, found.up}
    names = [name for name in AXES if name in swept or name in found.at]
    for label, pose in poses.items():
        coordinates = dict(zip(names, pose, strict=True))
        if not found.holds(coordinates):
            continue
        place: Any = [_factor(name) * coordinates[name] for name in (found.across, found.up)]
        axes.plot(*place, "o", color=MARK, markersize=5, markeredgecolor="white")
        offset: Any = {"xytext": (6, 5), "textcoords": "offset points"}
        axes.annotate(label, place, color=MARK, weight="bold", path_effects=halo, parse_math=False, **offset)


def held_text(found: StiffnessMap) -> str:
    """The other coordinates as a title has them: "y = 0 mm"; angles of zero are left out."""
    said = {name: (_factor(name) * value, _unit(name)) for name, value in found.at.items()}
    shown = {name: each for name, each in said.items() if each[0] or not name.startswith("r")}
    return ", ".join(f"{name} = {value:z.5g} {unit}" for name, (value, unit) in shown.items())


def write_map(found: StiffnessMap, folder: Path, title: str = "") -> None:
    """Write the numbers, SI: map.csv, a line for each reachable pose; map.npz, arrays (row, column, direction); map.nc.

    The netCDF file is the dataset of `as_dataset`.
    """
    at = np.column_stack([np.tile(found.columns, len(found.rows)), np.repeat(found.rows, len(found.columns))])
    fields = {"stiffness": found.stiffness, "stiffness_loaded": found.loaded, "sag": found.sag}
    fields |= {} if found.frequencies is None else {"frequencies": found.frequencies}
    rows = np.column_stack([at, *(values.reshape(len(at), -1) for values in fields.values())])
    words = [name.lower().replace("_", "") for name in DIAGONAL]
    names = [found.across, found.up, *words, *(f"{word}_loaded" for word in words), *(f"sag_{axis}" for axis in AXES)]
    names += [] if found.frequencies is None else [f"f{k + 1}" for k in range(found.frequencies.shape[2])]
    reached = np.isfinite(rows[:, 2])
    np.savetxt(folder / "map.csv", rows[reached], delimiter=",", header=",".join(names), comments="", fmt="%.9g")
    arrays = {found.across: found.columns, found.up: found.rows, "direction": np.array(DIAGONAL)}
    arrays |= {name: np.float64(value) for name, value in found.at.items()}
    with (folder / "map.npz").open("wb") as stream:
        np.savez_compressed(stream, **arrays, **fields)  # type: ignore[arg-type]
    as_dataset(found, title).to_netcdf(folder / "map.nc", engine="scipy", format="NETCDF3_64BIT")


def as_dataset(found: StiffnessMap, title: str = "") -> xr.Dataset:
    """Return a map as a dataset over its two coordinates with names and units, SI; NaN where nothing is reached.

    Variables are `K_tx` to `K_rz`, the same with `_loaded` (under the robot's own weight), `sag_x` to `sag_rz`, and
    `f1` and so on where the map has frequencies.
    """
    import xarray as xr

    forces, lengths = ("N m-1",) * 3 + ("N m rad-1",) * 3, ("m",) * 3 + ("rad",) * 3
    sags = [f"sag_{axis}" for axis in AXES]
    kinds = (
        (DIAGONAL, found.stiffness, forces, "stiffness at M without gravity"),
        ([f"{name}_loaded" for name in DIAGONAL], found.loaded, forces, "stiffness at M with the robot's own weight"),
        (sags, found.sag, lengths, "twist of the tool under the robot's own weight"),
    )
    variables = {
        name: ((found.up, found.across), values[..., k], {"units": units[k], "long_name": f"{words}, {AXES[k]}"})
        for names, values, units, words in kinds
        for k, name in enumerate(names)
    }
    sounds = np.zeros((0, 0, 0)) if found.frequencies is None else found.frequencies
    for k in range(sounds.shape[2]):
        about = {"units": "Hz", "long_name": f"natural frequency {k + 1}, drives held"}
        variables[f"f{k + 1}"] = ((found.up, found.across), sounds[..., k], about)
    swept = {found.across: (found.across, found.columns), found.up: (found.up, found.rows)}
    places: dict[str, Any] = {
        name: (*value, {"units": lengths[AXES.index(name)], "long_name": _long_name(name)})
        for name, value in (swept | {name: ((), value) for name, value in found.at.items()}).items()
    }
    if found.down:
        places[found.up][2]["positive"] = "down"
    about = {"title": title or "stiffness map", "Conventions": "CF-1.8", "source": "stiffscope"}
    return xr.Dataset(variables, places, about)


def _long_name(coordinate: str) -> str:
    turned = f"rotation vector of the tool from home, {coordinate[-1]}"
    return turned if coordinate.startswith("r") else f"tool point M, {coordinate}"
