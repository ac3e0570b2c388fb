"""Maps of the stiffness over two or three tool coordinates: evaluation and files."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field
from itertools import chain
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from stiffscope.errors import InputError, require, require_given
from stiffscope.runtime.formats import round_off, write_netcdf, write_table
from stiffscope.vjm.kinematics.configurations import configure, find_still
from stiffscope.vjm.model.mechanism import COORDINATES, DIAGONAL
from stiffscope.vjm.statics.analysis import analyse
from stiffscope.vjm.vibration.modes import frequencies as frequencies_at

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    import xarray as xr

    from stiffscope.robot.file.description import RobotFile
    from stiffscope.robot.file.sections import MapSection
    from stiffscope.runtime.types import Array
    from stiffscope.vjm.model.mechanism import Mechanism
    from stiffscope.vjm.statics.analysis import Gravity

    Ranges = Mapping[str, tuple[float, float]]

MEMORY = 1.4e9
PER_POSE = 4e3
PER_ELEMENT = 100.0  # bytes: most of a map; of a pose, and of each element there
IN_PLANE = 1e-6  # m or rad; tolerance for marking a pose on the map
TABLES = (".csv",)  # formats of the table
_FORCES = ("N m-1",) * 3 + ("N m rad-1",) * 3
_LENGTHS = ("m",) * 3 + ("rad",) * 3
PRINCIPAL = {
    "worst": ("N m-1", "stiffness along the softest direction"),
    "best": ("N m-1", "stiffness along the stiffest direction"),
    "condition": ("1", "stiffest over softest direction"),
}


class Scalar(NamedTuple):
    """A quantity over poses, ``values`` of any shape, with its SI unit and name in words."""

    values: Array
    unit: str
    words: str


@dataclass(frozen=True)
class Wanted:
    """Quantities of a map besides the diagonal of K.

    Attributes
    ----------
    principal
        Keys of `PRINCIPAL`, for translations with free rotation of the tool.
    direction
        Direction (3,) in base axes for the stiffness against a force along it.
    wrench
        Wrench (6,) at M in base axes, N and N·m, for the size of the translation under it.
    """

    principal: tuple[str, ...] = ()
    direction: tuple[float, ...] | None = None
    wrench: tuple[float, ...] | None = None

    def evaluate(self, compliance: Array) -> dict[str, Scalar]:
        """Return the quantities (n,) of compliances (n, 6, 6); NaN if these are NaN or it is rigid."""
        translation = compliance[:, :3, :3]
        known = np.isfinite(translation).all(axis=(1, 2))
        yields = np.full((len(compliance), 3), np.nan)
        yields[known] = np.linalg.eigvalsh(translation[known])
        stiffest, softest = np.where(yields > 1e-12 * yields[:, 2:], yields, np.nan).T[
            [0, 2]
        ]
        each = {
            "worst": 1.0 / softest,
            "best": 1.0 / stiffest,
            "condition": softest / stiffest,
        }
        out = {name: Scalar(each[name], *PRINCIPAL[name]) for name in self.principal}
        if self.direction is not None:
            unit = np.array(self.direction) / np.linalg.norm(self.direction)
            words = "stiffness along " + ", ".join(f"{x:.3g}" for x in self.direction)
            soft = np.einsum("i,nij,j->n", unit, translation, unit)
            out["along"] = Scalar(
                1.0 / np.where(soft > 0.0, soft, np.nan), "N m-1", words
            )
        if self.wrench is not None:
            moved = compliance[:, :3] @ np.array(self.wrench)
            texts = [f"{x:.4g}" for x in self.wrench]
            words = f"error under ({', '.join(texts[:3])}) N"
            if any(self.wrench[3:]):
                words += f", ({', '.join(texts[3:])}) N·m"
            out["error"] = Scalar(np.linalg.norm(moved, axis=1), "m", words)
        return out


@dataclass(frozen=True, eq=False)
class StiffnessMap:
    """Maps over a grid of tool poses; NaN if a pose is out of reach, has no equilibrium or is rigid.

    ``across``, ``up``: swept coordinates; ``columns`` (na,), ``rows`` (nu,): their values; ``at``:
    values of the others, m and rad. ``stiffness``, ``loaded`` (nu, na, 6): diagonals of K at M
    without and with own weight, N/m and N·m/rad; ``push`` (nu, na, 6): 1/C_ii, a push along each
    direction with all others free, with own weight; ``sag`` (nu, na, 6), m and rad; ``rigid`` (nu,
    na): whether K is infinite in some direction, and replaced by 1/C_ii. ``down``: rows grow
    downwards. ``frequencies`` (nu, na, c): natural frequencies, Hz, drives held, or None; ``more``:
    other quantities (nu, na) of the loaded robot by column; ``still``: drives, springs and tool
    coordinates that stay as at home where poses leave a choice.
    """

    across: str
    up: str
    columns: np.ndarray
    rows: np.ndarray
    at: dict[str, float]
    stiffness: np.ndarray
    loaded: np.ndarray
    push: np.ndarray
    sag: np.ndarray
    rigid: np.ndarray
    down: bool = False
    frequencies: np.ndarray | None = None
    more: dict[str, Scalar] = field(default_factory=dict)
    still: tuple[str, ...] = ()

    @property
    def reached(self) -> np.ndarray:
        """Whether the poses are within reach (nu, na)."""
        return self.rigid | np.isfinite(self.stiffness[..., 0])

    def holds(self, coordinates: Mapping[str, float]) -> bool:
        """Return whether a pose lies in the swept plane."""
        return all(
            abs(coordinates[name] - value) < IN_PLANE for name, value in self.at.items()
        )


def map_robot(
    robot: RobotFile, mechanism: Mechanism, points: int, gravity: Gravity
) -> StiffnessMap:
    """Evaluate `[map]` of a robot file. Raise InputError if it is missing or nothing is reachable.

    Parameters
    ----------
    robot, mechanism
        Robot file, and mechanism of the robot.
    points, gravity
        Points along each side of the map, and whether the robot's own weight acts.
    """
    section = require_map(robot)
    return map_stiffness(
        mechanism, section.ranges(), points, gravity=gravity, at=section.at
    )


def require_map(robot: RobotFile) -> MapSection:
    """Return `[map]` of a robot file. Raise InputError if it is missing."""
    example = 'such as x = ["-150 mm", "150 mm"] and z = ["380 mm", "520 mm"]'
    what = f"a table of two coordinates to sweep, {example}"
    return require_given(robot.map, f"{robot.path}: map", what, "none")


def map_stiffness(
    mechanism: Mechanism,
    ranges: Ranges,
    points: int,
    *,
    gravity: Gravity = "none",
    at: Sequence[float] | None = None,
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

    Raises
    ------
    InputError
        The ranges are not two coordinates of the tool, or no pose is reachable.
    """
    if len(ranges) != 2:
        raise _refuse_ranges("two", mechanism, ranges)
    return map_volume(mechanism, ranges, points, gravity=gravity, at=at).maps[0]


def _refuse_ranges(count: str, mechanism: Mechanism, ranges: Ranges) -> InputError:
    names = ", ".join(mechanism.tool.pose)
    got = ", ".join(ranges) or "none"
    return InputError(f"map: expected {count} of {names}, got {got}")


@dataclass(frozen=True, eq=False)
class StiffnessVolume:
    """Maps over two coordinates at values (m,) of a third, ``through`` ("" if there is none)."""

    through: str
    values: np.ndarray
    maps: tuple[StiffnessMap, ...]


def check_points(mechanism: Mechanism, ranges: Ranges, points: int) -> None:
    """Raise InputError if a map of so many poses along each coordinate needs more memory than `MEMORY`."""
    most = int(
        (MEMORY / (PER_POSE + PER_ELEMENT * len(mechanism.elements)))
        ** (1 / len(ranges))
    )
    require(
        points <= most,
        "points",
        f"at most {most} poses along each of {' and '.join(ranges)}, which take {MEMORY / 1e9:g} GB",
        points,
    )


def map_volume(
    mechanism: Mechanism,
    ranges: Ranges,
    points: int,
    *,
    gravity: Gravity = "none",
    at: Sequence[float] | None = None,
    frequencies: int = 0,
    wanted: Wanted | None = None,
) -> StiffnessVolume:
    """Evaluate the stiffness over three coordinates of the tool as maps at values of the last one.

    Parameters
    ----------
    mechanism, points, gravity
        As in `map_stiffness`.
    frequencies
        Number of natural frequencies to add, drives held.
    wanted
        Further quantities.
    ranges
        Three coordinates of `mechanism.tool.pose` with their ends, m and rad; or two.
    at : (k,)
        Pose that fixes the other coordinates, by default home.

    Raises
    ------
    InputError
        The ranges are not such coordinates, or no pose is reachable.
    """
    pose = mechanism.tool.pose
    if len(ranges) not in {2, 3} or not set(ranges) <= set(pose):
        raise _refuse_ranges("two" if len(ranges) == 2 else "three", mechanism, ranges)
    check_points(mechanism, ranges, points)
    values = {name: np.linspace(*ends, points) for name, ends in ranges.items()}
    (across, columns), (up, rows), *third = values.items()
    through, heights = third[0] if third else ("", np.zeros(1))
    fixed = np.array(mechanism.tool.home if at is None else at, dtype=float)
    layers = np.tile(fixed, (len(heights), 1))
    layers[:, np.array(pose) == through] = heights[:, None]
    grids = np.repeat(layers[:, None], points * points, axis=1)
    grids[..., pose.index(across)] = np.tile(columns, points)
    grids[..., pose.index(up)] = np.repeat(rows, points)
    every = [configure(mechanism, grid) for grid in grids]
    if not any(found.valid.any() for found in every):
        raise InputError(
            f"map: no pose is within reach; the first is not: {every[0].reason(0)}"
        )
    weight = mechanism.gravity[COORDINATES.index(up)] if up in COORDINATES[:3] else 0.0
    size = (points, points)
    wanted = wanted or Wanted()
    still = tuple(chain(*find_still(mechanism)))
    maps: list[StiffnessMap] = []
    for found, layer in zip(every, layers, strict=True):
        state = analyse(mechanism, found)
        plain = loaded = state.finite
        sag = np.where(found.valid[:, None], np.zeros((len(found), 6)), np.nan)
        compliance = state.compliance
        push = state.alone
        if gravity != "none":
            state = analyse(mechanism, found, gravity="exact")
            sag = state.sag
            lost = np.isnan(sag)[:, :1, None]
            both = (state.finite, state.compliance)
            loaded, compliance = (np.where(lost, np.nan, each) for each in both)
            push = np.where(lost[..., 0], np.nan, state.alone)
        diagonals = (
            np.diagonal(matrix, axis1=1, axis2=2) for matrix in (plain, loaded)
        )
        more = wanted.evaluate(compliance).items()
        sounds = frequencies_at(mechanism, found, frequencies) if frequencies else None
        maps.append(
            StiffnessMap(
                across,
                up,
                columns,
                rows,
                {
                    n: float(v)
                    for n, v in zip(pose, layer, strict=True)
                    if n not in {across, up}
                },
                *(value.reshape(*size, 6) for value in (*diagonals, push, sag)),
                rigid=np.array([len(wrenches) > 0 for wrenches in state.rigid]).reshape(
                    size
                ),
                down=bool(weight > 0.0),
                frequencies=None
                if sounds is None
                else sounds.reshape(*size, frequencies),
                more={
                    n: scalar._replace(values=scalar.values.reshape(size))
                    for n, scalar in more
                },
                still=still,
            )
        )
    return StiffnessVolume(through, heights, tuple(maps))


@dataclass(frozen=True)
class Quantity:
    """A quantity of a map and its names in all files.

    Attributes
    ----------
    name : in datasets.
    column : in tables.
    array : array (nu, na, …) of map.npz along whose last axis it stands; empty if it is one itself.
    values, unit, words : (nu, na) in SI, the unit, and what it is.
    """

    name: str
    column: str
    array: str
    values: Array
    unit: str
    words: str


def list_quantities(stiffness_map: StiffnessMap) -> list[Quantity]:
    """Return all quantities of a map, in the order of its files."""
    where = "; 1/C_ii where a direction is rigid" if stiffness_map.rigid.any() else ""
    with_weight = "with the robot's own weight"
    out = []
    for mark, values, words in (
        ("", stiffness_map.stiffness, f"stiffness at M without gravity{where}"),
        ("_loaded", stiffness_map.loaded, f"stiffness at M {with_weight}{where}"),
    ):
        for k, (name, axis) in enumerate(zip(DIAGONAL, COORDINATES, strict=True)):
            column = name.lower().replace("_", "") + mark
            names = (name + mark, column, f"stiffness{mark}")
            about = (_FORCES[k], f"{words}, {axis}")
            out.append(Quantity(*names, values[..., k], *about))
    for k, axis in enumerate(COORDINATES):
        names = (f"push_{axis}", f"push_{axis}", "push")
        words = (
            f"1/C_ii at M {with_weight}, a push with all other directions free, {axis}"
        )
        out.append(Quantity(*names, stiffness_map.push[..., k], _FORCES[k], words))
    sag = round_off(*np.moveaxis(stiffness_map.sag, -1, 0))
    for k, axis in enumerate(COORDINATES):
        names = (f"sag_{axis}", f"sag_{axis}", "sag")
        words = f"twist of the tool under the robot's own weight, {axis}"
        out.append(Quantity(*names, sag[k], _LENGTHS[k], words))
    sounds = (
        np.zeros((0, 0, 0))
        if stiffness_map.frequencies is None
        else stiffness_map.frequencies
    )
    for k in range(sounds.shape[2]):
        names = (f"f{k + 1}", f"f{k + 1}", "frequencies")
        words = f"natural frequency {k + 1}, drives held"
        out.append(Quantity(*names, sounds[..., k], "Hz", words))
    more = stiffness_map.more.items()
    return out + [Quantity(name, name, "", *scalar) for name, scalar in more]


def write_map(
    stiffness_map: StiffnessMap | StiffnessVolume, folder: Path, title: str = ""
) -> None:
    """Write the table of a map or volume, its dataset (map.nc), and of a map its arrays; SI.

    The table has the columns of `map_columns`; map.npz has arrays (row, column, direction).
    """
    write_table(map_columns(stiffness_map), folder / "map", TABLES, digits=9)
    write_netcdf(volume_dataset(stiffness_map, title), folder / "map.nc")
    if isinstance(stiffness_map, StiffnessVolume):
        return
    arrays = {
        stiffness_map.across: stiffness_map.columns,
        stiffness_map.up: stiffness_map.rows,
        "direction": np.array(DIAGONAL),
    }
    arrays |= {name: np.float64(value) for name, value in stiffness_map.at.items()}
    together = defaultdict[str, list["Array"]](list)
    for each in list_quantities(stiffness_map):
        if each.array:
            together[each.array].append(each.values)
        else:
            arrays[each.name] = each.values
    arrays |= {name: np.stack(each, axis=-1) for name, each in together.items()}
    with (folder / "map.npz").open("wb") as stream:
        np.savez_compressed(stream, **arrays)  # type: ignore[arg-type]


def map_columns(stiffness_map: StiffnessMap | StiffnessVolume) -> dict[str, Array]:
    """Return columns (n,) of the reachable poses of a map or volume and all quantities there, SI."""
    if isinstance(stiffness_map, StiffnessMap):
        return _columns_of(stiffness_map)
    layers = [_columns_of(layer, stiffness_map.through) for layer in stiffness_map.maps]
    return {
        name: np.concatenate([layer[name] for layer in layers]) for name in layers[0]
    }


def _columns_of(stiffness_map: StiffnessMap, *third: str) -> dict[str, Array]:
    across, up = np.meshgrid(stiffness_map.columns, stiffness_map.rows)
    columns = {stiffness_map.across: across, stiffness_map.up: up}
    columns |= {name: np.full(across.shape, stiffness_map.at[name]) for name in third}
    columns |= {
        quantity.column: quantity.values for quantity in list_quantities(stiffness_map)
    }
    return {name: values[stiffness_map.reached] for name, values in columns.items()}


def to_dataset(stiffness_map: StiffnessMap, title: str = "") -> xr.Dataset:
    """Return a map as a dataset over its coordinates with names and units, SI; NaN if unreachable.

    Variables are `K_tx` to `K_rz`, the same with `_loaded` (under own weight), `push_x` to `push_rz`
    (1/C_ii), `sag_x` to `sag_rz`,
    and `f1` etc. if the map has frequencies.
    """
    import xarray as xr

    over = (stiffness_map.up, stiffness_map.across)
    variables = {
        quantity.name: (
            over,
            quantity.values,
            {"units": quantity.unit, "long_name": quantity.words},
        )
        for quantity in list_quantities(stiffness_map)
    }
    swept = {
        stiffness_map.across: (stiffness_map.across, stiffness_map.columns),
        stiffness_map.up: (stiffness_map.up, stiffness_map.rows),
    }
    places: dict[str, Any] = {}
    for name, value in (
        swept | {name: ((), value) for name, value in stiffness_map.at.items()}
    ).items():
        words = f"tool point M, {name}"
        if name.startswith("r"):
            words = f"rotation vector of the tool from home, {name[-1]}"
        about = {"units": _LENGTHS[COORDINATES.index(name)], "long_name": words}
        if stiffness_map.down and name == stiffness_map.up:
            about["positive"] = "down"
        places[name] = (*value, about)
    about = {
        "title": title or "stiffness map",
        "Conventions": "CF-1.8",
        "source": "stiffscope",
    }
    return xr.Dataset(variables, places, about)


def volume_dataset(
    stiffness_map: StiffnessMap | StiffnessVolume, title: str = ""
) -> xr.Dataset:
    """Return the dataset of a map, or of a volume over its three coordinates; see `to_dataset`."""
    if isinstance(stiffness_map, StiffnessMap):
        return to_dataset(stiffness_map, title)
    import xarray as xr

    maps = [to_dataset(layer, title) for layer in stiffness_map.maps]
    return xr.concat(maps, dim=stiffness_map.through, combine_attrs="override")
