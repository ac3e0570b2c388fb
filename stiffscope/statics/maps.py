"""Maps of the stiffness over two or three tool coordinates: evaluation and files."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import chain
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from stiffscope.errors import InputError
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
    without and with own weight, N/m and N·m/rad; ``sag`` (nu, na, 6), m and rad; ``rigid`` (nu,
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
    if robot.map is None:
        example = 'such as x = ["-150 mm", "150 mm"] and z = ["380 mm", "520 mm"]'
        expected = f"expected a table of two coordinates to sweep, {example}"
        raise InputError(f"{robot.path}: map: {expected}, got none")
    return robot.map


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
    if points > most:
        expected = f"expected at most {most} poses along each of {' and '.join(ranges)}"
        raise InputError(
            f"points: {expected}, which take {MEMORY / 1e9:g} GB, got {points}"
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
    every = [configure(mechanism, each) for each in grids]
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
        if gravity != "none":
            state = analyse(mechanism, found, gravity="exact")
            sag = state.sag
            lost = np.isnan(sag)[:, :1, None]
            both = (state.finite, state.compliance)
            loaded, compliance = (np.where(lost, np.nan, each) for each in both)
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
                *(value.reshape(*size, 6) for value in (*diagonals, sag)),
                rigid=np.array([len(each) > 0 for each in state.rigid]).reshape(size),
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


def write_map(found: StiffnessMap, folder: Path, title: str = "") -> None:
    """Write map.csv by `write_rows`, map.npz with arrays (row, column, direction), and map.nc; SI.

    The netCDF file contains the dataset of `to_dataset`.
    """
    write_rows(found, folder / "map.csv")
    arrays = {
        found.across: found.columns,
        found.up: found.rows,
        "direction": np.array(DIAGONAL),
    }
    arrays |= {name: np.float64(value) for name, value in found.at.items()}
    with (folder / "map.npz").open("wb") as stream:
        np.savez_compressed(stream, **arrays, **_fields(found))  # type: ignore[arg-type]
    to_dataset(found, title).to_netcdf(
        folder / "map.nc", engine="scipy", format="NETCDF3_64BIT"
    )


def write_rows(found: StiffnessMap | StiffnessVolume, file: Path) -> None:
    """Write a CSV table, SI, with one line per reachable pose of a map or volume."""
    slices = [found] if isinstance(found, StiffnessMap) else found.maps
    third = [] if isinstance(found, StiffnessMap) else [found.through]
    words = [name.lower().replace("_", "") for name in DIAGONAL]
    first = slices[0]
    sags = [f"sag_{axis}" for axis in COORDINATES]
    count = 0 if first.frequencies is None else first.frequencies.shape[2]
    names = [
        first.across,
        first.up,
        *third,
        *words,
        *(f"{word}_loaded" for word in words),
        *sags,
    ]
    names += [*(f"f{k + 1}" for k in range(count)), *first.more]
    with file.open("w") as stream:
        stream.write(",".join(names) + "\n")
        for each in slices:
            n = len(each.rows) * len(each.columns)
            across, up = np.meshgrid(each.columns, each.rows)
            held = [np.full(n, each.at[name]) for name in third]
            fields = (values.reshape(n, -1) for values in _fields(each).values())
            rows = np.column_stack([across.ravel(), up.ravel(), *held, *fields])
            np.savetxt(stream, rows[each.reached.ravel()], delimiter=",", fmt="%.9g")


def _fields(found: StiffnessMap) -> dict[str, np.ndarray]:
    fields = {
        "stiffness": found.stiffness,
        "stiffness_loaded": found.loaded,
        "sag": found.sag,
    }
    fields |= {} if found.frequencies is None else {"frequencies": found.frequencies}
    return fields | {name: scalar.values for name, scalar in found.more.items()}


def to_dataset(found: StiffnessMap, title: str = "") -> xr.Dataset:
    """Return a map as a dataset over its coordinates with names and units, SI; NaN if unreachable.

    Variables are `K_tx` to `K_rz`, the same with `_loaded` (under own weight), `sag_x` to `sag_rz`,
    and `f1` etc. if the map has frequencies.
    """
    import xarray as xr

    where = "; 1/C_ii where a direction is rigid" if found.rigid.any() else ""
    forces = ("N m-1",) * 3 + ("N m rad-1",) * 3
    lengths = ("m",) * 3 + ("rad",) * 3
    kinds = (
        ("{0}", found.stiffness, forces, f"stiffness at M without gravity{where}"),
        (
            "{0}_loaded",
            found.loaded,
            forces,
            f"stiffness at M with the robot's own weight{where}",
        ),
        (
            "sag_{1}",
            found.sag,
            lengths,
            "twist of the tool under the robot's own weight",
        ),
    )
    scalars = {
        name.format(DIAGONAL[k], axis): Scalar(
            values[..., k], units[k], f"{words}, {axis}"
        )
        for name, values, units, words in kinds
        for k, axis in enumerate(COORDINATES)
    }
    sounds = np.zeros((0, 0, 0)) if found.frequencies is None else found.frequencies
    for k in range(1, sounds.shape[2] + 1):
        words = f"natural frequency {k}, drives held"
        scalars[f"f{k}"] = Scalar(sounds[..., k - 1], "Hz", words)
    variables = {
        name: ((found.up, found.across), values, {"units": unit, "long_name": words})
        for name, (values, unit, words) in (scalars | found.more).items()
    }
    swept = {
        found.across: (found.across, found.columns),
        found.up: (found.up, found.rows),
    }
    places: dict[str, Any] = {}
    for name, value in (
        swept | {name: ((), value) for name, value in found.at.items()}
    ).items():
        words = f"tool point M, {name}"
        if name.startswith("r"):
            words = f"rotation vector of the tool from home, {name[-1]}"
        about = {"units": lengths[COORDINATES.index(name)], "long_name": words}
        if found.down and name == found.up:
            about["positive"] = "down"
        places[name] = (*value, about)
    about = {
        "title": title or "stiffness map",
        "Conventions": "CF-1.8",
        "source": "stiffscope",
    }
    return xr.Dataset(variables, places, about)


def volume_dataset(
    found: StiffnessMap | StiffnessVolume, title: str = ""
) -> xr.Dataset:
    """Return the dataset of a map, or of a volume over its three coordinates; see `to_dataset`."""
    if isinstance(found, StiffnessMap):
        return to_dataset(found, title)
    import xarray as xr

    maps = [to_dataset(each, title) for each in found.maps]
    return xr.concat(maps, dim=found.through, combine_attrs="override")
