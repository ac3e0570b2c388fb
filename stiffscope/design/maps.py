"""Maps of the stiffness over two or three tool coordinates: evaluation and files."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.design.map_quantities import Scalar, Wanted
from stiffscope.errors import InputError
from stiffscope.vjm.kinematics import configure
from stiffscope.vjm.mechanism import COORDINATES, DIAGONAL
from stiffscope.vjm.modes import frequencies as frequencies_at
from stiffscope.vjm.statics import analyse

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    import xarray as xr

    from stiffscope.robot.file.description import RobotFile
    from stiffscope.robot.file.sections import MapSection
    from stiffscope.vjm.mechanism import Mechanism
    from stiffscope.vjm.statics import Gravity

    Ranges = Mapping[str, tuple[float, float]]

IN_PLANE = 1e-6  # m or rad; tolerance for marking a pose on the map


@dataclass(frozen=True, eq=False)
class StiffnessMap:
    """Maps over a grid of tool poses; NaN if a pose is out of reach or has no equilibrium.

    ``across``, ``up``: swept coordinates; ``columns`` (na,), ``rows`` (nu,): their values; ``at``:
    values of the others, m and rad. ``stiffness``, ``loaded`` (nu, na, 6): diagonals of K at M
    without and with own weight, N/m and N·m/rad; ``sag`` (nu, na, 6), m and rad. ``down``: rows
    grow downwards. ``frequencies`` (nu, na, c): natural frequencies, Hz, drives held, or None;
    ``more``: other quantities (nu, na) of the loaded robot by column.
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
    more: dict[str, Scalar] = field(default_factory=dict)

    def holds(self, coordinates: Mapping[str, float]) -> bool:
        """Return whether a pose lies in the swept plane."""
        return all(abs(coordinates[name] - value) < IN_PLANE for name, value in self.at.items())


def map_robot(robot: RobotFile, mechanism: Mechanism, points: int, gravity: Gravity) -> StiffnessMap:
    """Evaluate `[map]` of a robot file. Raise InputError if it is missing or nothing is reachable.

    Parameters
    ----------
    robot
        Robot file.
    mechanism
        Mechanism of the robot.
    points
        Points along each side of the map.
    gravity
        Whether the robot's own weight acts.

    """
    section = require_map(robot)
    return map_stiffness(mechanism, section.ranges(), points, gravity=gravity, at=section.at)


def require_map(robot: RobotFile) -> MapSection:
    """Return `[map]` of a robot file. Raise InputError if it is missing."""
    if robot.map is None:
        example = 'such as x = ["-150 mm", "150 mm"] and z = ["380 mm", "520 mm"]'
        raise InputError(f"{robot.path}: map: expected a table of two coordinates to sweep, {example}, got none")
    return robot.map


def map_stiffness(
    mechanism: Mechanism,
    ranges: Ranges,
    points: int,
    *,
    gravity: Gravity = "none",
    at: Sequence[float] | None = None,
    frequencies: int = 0,
    wanted: Wanted | None = None,
) -> StiffnessMap:
    """Evaluate the stiffness over two coordinates of the tool.

    Parameters
    ----------
    mechanism
        Any mechanism whose tool has at least two coordinates.
    ranges
        Two coordinates of `mechanism.tool.pose`, ends in m and rad; the first is drawn across.
    points
        Number of poses along each coordinate.
    gravity
        "exact" also evaluates the stiffness under own weight and the sag.
    at : (k,)
        Pose that fixes the other coordinates, by default home.
    frequencies
        Number of natural frequencies to add, drives held.
    wanted
        Further quantities.

    Raises
    ------
    InputError
        The ranges are not two coordinates of the tool, or no pose is reachable.

    """
    (found,) = _sweep(mechanism, ranges, points, gravity, at, frequencies, wanted or Wanted())
    return found


@dataclass(frozen=True, eq=False)
class StiffnessVolume:
    """Maps over two coordinates at values (m,) of a third, ``through``."""

    through: str
    values: np.ndarray
    maps: tuple[StiffnessMap, ...]


def map_volume(
    mechanism: Mechanism, ranges: Ranges, points: int, *, gravity: Gravity = "none", at: Sequence[float] | None = None,
    frequencies: int = 0, wanted: Wanted | None = None,
) -> StiffnessVolume:  # fmt: skip
    """Evaluate the stiffness over three coordinates of the tool as maps at values of the last one.

    Parameters
    ----------
    mechanism, points, gravity, frequencies, wanted
        As in `map_stiffness`.
    ranges
        Three coordinates of `mechanism.tool.pose` with their ends, m and rad.
    at : (k,)
        Pose that fixes the other coordinates, by default home.

    Raises
    ------
    InputError
        The ranges are not three coordinates of the tool, or no pose is reachable.

    """
    (through, ends), plane = list(ranges.items())[-1], dict(list(ranges.items())[:-1])
    maps = _sweep(mechanism, plane, points, gravity, at, frequencies, wanted or Wanted(), {through: ends})
    return StiffnessVolume(through, np.linspace(*ends, points), maps)


def _sweep(
    mechanism: Mechanism, ranges: Ranges, points: int, gravity: Gravity, at: Sequence[float] | None, frequencies: int,
    wanted: Wanted, through: Ranges | None = None,
) -> tuple[StiffnessMap, ...]:  # fmt: skip
    """Return maps over two coordinates, one per value of a third coordinate if given."""
    through = through or {}
    pose = mechanism.tool.pose
    count = 2 + len(through)
    if len(ranges) != 2 or not {*ranges, *through} <= set(pose):
        words = {2: "two", 3: "three"}[count]
        raise InputError(f"map: expected {words} of {', '.join(pose)}, got {', '.join([*ranges, *through]) or 'none'}")
    (across, columns), (up, rows) = ((name, np.linspace(*ends, points)) for name, ends in ranges.items())
    fixed = np.array(mechanism.tool.home if at is None else at, dtype=float)
    layers = [fixed]
    for name, ends in through.items():
        layers = [np.where(np.array(pose) == name, value, fixed) for value in np.linspace(*ends, points)]
    grids = np.repeat(np.array(layers)[:, None], points * points, axis=1)
    grids[..., pose.index(across)], grids[..., pose.index(up)] = np.tile(columns, points), np.repeat(rows, points)
    every = [configure(mechanism, each) for each in grids]
    if not any(found.valid.any() for found in every):
        raise InputError(f"map: no pose is within reach; the first is not: {every[0].reason(0)}")
    weight = mechanism.gravity[COORDINATES.index(up)] if up in COORDINATES[:3] else 0.0
    out: list[StiffnessMap] = []
    for found, layer in zip(every, layers, strict=True):
        state = analyse(mechanism, found)
        plain = loaded = state.finite
        sag = np.where(found.valid[:, None], np.zeros((len(found), 6)), np.nan)
        compliance = state.compliance
        if gravity != "none":
            state = analyse(mechanism, found, gravity="exact")
            sag = state.sag
            lost = np.isnan(sag)[:, :1, None]
            loaded, compliance = np.where(lost, np.nan, state.finite), np.where(lost, np.nan, state.compliance)
        diagonals = (np.diagonal(matrix, axis1=1, axis2=2) for matrix in (plain, loaded))
        values = (value.reshape(points, points, 6) for value in (*diagonals, sag))
        others = {name: float(v) for name, v in zip(pose, layer, strict=True) if name not in ranges}
        more = {
            name: scalar._replace(values=scalar.values.reshape(points, points))
            for name, scalar in wanted.evaluate(compliance).items()
        }
        sounds = None
        if frequencies:
            sounds = frequencies_at(mechanism, found, frequencies).reshape(points, points, frequencies)
        down = bool(weight > 0.0)
        about = StiffnessMap(across, up, columns, rows, others, *values, down=down, frequencies=sounds, more=more)
        out.append(about)
    return tuple(out)


def write_map(found: StiffnessMap, folder: Path, title: str = "") -> None:
    """Write map.csv by `write_rows`, map.npz with arrays (row, column, direction), and map.nc; SI.

    The netCDF file contains the dataset of `to_dataset`.
    """
    write_rows(found, folder / "map.csv")
    arrays = {found.across: found.columns, found.up: found.rows, "direction": np.array(DIAGONAL)}
    arrays |= {name: np.float64(value) for name, value in found.at.items()}
    with (folder / "map.npz").open("wb") as stream:
        np.savez_compressed(stream, **arrays, **_fields(found))  # type: ignore[arg-type]
    to_dataset(found, title).to_netcdf(folder / "map.nc", engine="scipy", format="NETCDF3_64BIT")


def write_rows(found: StiffnessMap | StiffnessVolume, file: Path) -> None:
    """Write a CSV table, SI, with one line per reachable pose of a map or volume."""
    slices = [found] if isinstance(found, StiffnessMap) else found.maps
    third = [] if isinstance(found, StiffnessMap) else [found.through]
    words = [name.lower().replace("_", "") for name in DIAGONAL]
    names = [slices[0].across, slices[0].up, *third, *words]
    names += [*(f"{word}_loaded" for word in words), *(f"sag_{axis}" for axis in COORDINATES)]
    sounds = slices[0].frequencies
    names += [] if sounds is None else [f"f{k + 1}" for k in range(sounds.shape[2])]
    names += slices[0].more
    with file.open("w") as stream:
        stream.write(",".join(names) + "\n")
        for each in slices:
            at = np.column_stack([np.tile(each.columns, len(each.rows)), np.repeat(each.rows, len(each.columns))])
            held = np.tile([each.at[name] for name in third], (len(at), 1))
            rows = np.column_stack([at, held, *(values.reshape(len(at), -1) for values in _fields(each).values())])
            np.savetxt(stream, rows[np.isfinite(each.stiffness[..., 0]).ravel()], delimiter=",", fmt="%.9g")


def _fields(found: StiffnessMap) -> dict[str, np.ndarray]:
    fields = {"stiffness": found.stiffness, "stiffness_loaded": found.loaded, "sag": found.sag}
    fields |= {} if found.frequencies is None else {"frequencies": found.frequencies}
    return fields | {name: scalar.values for name, scalar in found.more.items()}


def to_dataset(found: StiffnessMap, title: str = "") -> xr.Dataset:
    """Return a map as a dataset over its coordinates with names and units, SI; NaN if unreachable.

    Variables are `K_tx` to `K_rz`, the same with `_loaded` (under own weight), `sag_x` to `sag_rz`,
    and `f1` etc. if the map has frequencies.
    """
    import xarray as xr

    forces, lengths = ("N m-1",) * 3 + ("N m rad-1",) * 3, ("m",) * 3 + ("rad",) * 3
    sags = [f"sag_{axis}" for axis in COORDINATES]
    kinds = (
        (DIAGONAL, found.stiffness, forces, "stiffness at M without gravity"),
        ([f"{name}_loaded" for name in DIAGONAL], found.loaded, forces, "stiffness at M with the robot's own weight"),
        (sags, found.sag, lengths, "twist of the tool under the robot's own weight"),
    )
    variables = {
        name: ((found.up, found.across), values[..., k], {"units": units[k], "long_name": f"{words}, {COORDINATES[k]}"})
        for names, values, units, words in kinds
        for k, name in enumerate(names)
    }
    sounds = np.zeros((0, 0, 0)) if found.frequencies is None else found.frequencies
    for k in range(sounds.shape[2]):
        about = {"units": "Hz", "long_name": f"natural frequency {k + 1}, drives held"}
        variables[f"f{k + 1}"] = ((found.up, found.across), sounds[..., k], about)
    for name, (values, unit, words) in found.more.items():
        variables[name] = ((found.up, found.across), values, {"units": unit, "long_name": words})
    swept = {found.across: (found.across, found.columns), found.up: (found.up, found.rows)}
    places: dict[str, Any] = {
        name: (*value, {"units": lengths[COORDINATES.index(name)], "long_name": _long_name(name)})
        for name, value in (swept | {name: ((), value) for name, value in found.at.items()}).items()
    }
    if found.down:
        places[found.up][2]["positive"] = "down"
    about = {"title": title or "stiffness map", "Conventions": "CF-1.8", "source": "stiffscope"}
    return xr.Dataset(variables, places, about)


def volume_dataset(found: StiffnessMap | StiffnessVolume, title: str = "") -> xr.Dataset:
    """Return the dataset of a map, or of a volume over its three coordinates; see `to_dataset`."""
    if isinstance(found, StiffnessMap):
        return to_dataset(found, title)
    import xarray as xr

    return xr.concat([to_dataset(each, title) for each in found.maps], dim=found.through, combine_attrs="override")


def _long_name(coordinate: str) -> str:
    turned = f"rotation vector of the tool from home, {coordinate[-1]}"
    return turned if coordinate.startswith("r") else f"tool point M, {coordinate}"
