"""Job files: a robot, a path, and the process that loads the tool along it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import Field, create_model
from scipy.spatial.transform import Rotation

from stiffscope.cad.materials import MATERIALS
from stiffscope.errors import require, require_given
from stiffscope.path.cutting import (
    cutting_materials,
    drill,
    mill,
    specific_force,
    turn,
)
from stiffscope.path.toolpath import ToolPath, read_toolpath
from stiffscope.path.values import (
    Cut,
    EnteringAngle,
    Feed,
    Force,
    PointAngle,
    Ratio,
    Share,
    Strength,
    Stress,
    Turns,
)
from stiffscope.registry import sections_of
from stiffscope.robot.file import values as v
from stiffscope.robot.file.description import RobotFile
from stiffscope.robot.file.parse import Source, naming_key, parse_text
from stiffscope.robot.file.tables import one_of, read_table
from stiffscope.robot.file.values import (
    Direction,
    Length,
    Point,
    Positive,
    Says,
    Section,
)
from stiffscope.robot.reader import load_robot, load_robot_of
from stiffscope.runtime import reading

if TYPE_CHECKING:
    from stiffscope.path.cutting import CuttingForces
    from stiffscope.runtime.types import Array

MOST_EXPONENT = 1.0  # above it, thicker chips would need less force
FASTEST = 200.0  # m/s, of a cutting edge: twice what any cutter does


class ForceSection(Section):
    """A constant force on the tool: along the path, to its left seen from the spindle, axial."""

    feed: Force = 0.0
    across: Force = 0.0
    axial: Force = 0.0


class _Cut(Section):
    """Common keys of all cuts: a material by name, or kc1 and mc."""

    excludes = {"material": ("kc1", "mc")}  # noqa: RUF012 (not a field)

    material: Cut | None = None
    kc1: Stress | None = None
    mc: Share | None = None
    diameter: Length
    speed: Turns
    feed: Annotated[Feed | None, Says("feed where the path has none")] = None

    def law(self) -> tuple[float, float]:
        """Return specific cutting force, Pa, and exponent. Raise ValueError if inconsistent."""
        edge = np.pi * self.diameter * self.speed
        require(
            edge <= FASTEST,
            "",
            f"pi * diameter * speed of at most {FASTEST:g} m/s",
            f"{edge:.4g} m/s",
        )
        if self.kc1 is not None and self.mc is not None:
            require(
                self.mc < MOST_EXPONENT,
                "cut.mc",
                f"less than {MOST_EXPONENT:g}",
                f"{self.mc:g}",
            )
            return self.kc1, self.mc
        given_keys = "kc1" if self.kc1 else "mc" if self.mc else "neither"
        material = require_given(
            self.material, "", "a material, or kc1 and mc", given_keys
        )
        return cutting_materials()[material]


class _EdgeCut(_Cut):
    """Common keys of cuts by an edge: ``kt`` instead of a material, and ratios of forces."""

    excludes = {  # noqa: RUF012 (not a field)
        **_Cut.excludes,
        "kt": ("material", "kc1", "mc"),
        "kr": ("radial",),
    }

    kt: Annotated[
        Stress | None,
        Says('a specific tangential force such as "700 N/mm^2", instead of a material'),
    ] = None
    kr: Annotated[Ratio | None, Says("the same as `radial`")] = None
    depth: Length
    lead: EnteringAngle = 0.5 * np.pi
    radial: Ratio = 0.3

    def law(self) -> tuple[float, float]:
        """Return specific cutting force, Pa, and exponent; ``kt`` does not depend on the chip."""
        return super().law() if self.kt is None else (self.kt, 0.0)

    def specific_force(self, chip: float) -> float:
        """Return the specific cutting force, Pa, at a chip thickness, m."""
        return specific_force(*self.law(), chip)

    @property
    def radial_ratio(self) -> float:
        """Radial over tangential force."""
        return self.radial if self.kr is None else self.kr

    @property
    def geometry(self) -> dict[str, Any]:
        """Keys of the cut itself, without those of force and feed."""
        forces = {"material", "kc1", "mc", "kt", "kr", "radial", "feed"}
        return self.model_dump(exclude=forces)


class MillingSection(_EdgeCut):
    """A milling cutter that turns clockwise: engagement, radial and axial over tangential force."""

    teeth: v.Some
    width: Length
    climb: v.Flag = True
    axial: Ratio = 0.0

    def forces(self, feed: float) -> CuttingForces:
        """Return the mean forces at a feed in m/s."""
        require(
            self.width <= self.diameter,
            "cut.width",
            f"at most the diameter, {1e3 * self.diameter:g} mm",
            f"{1e3 * self.width:g} mm",
        )
        ratio = self.radial_ratio
        return mill(*self.law(), feed=feed, radial=ratio, **self.geometry)


class TurningSection(_EdgeCut):
    """A turning or boring tool: speed and diameter of the workpiece, thrust over tangential force."""

    towards: Annotated[
        Literal["left", "right"],
        Says(
            "where the workpiece passes the tool, along the feed seen from the holder"
        ),
    ] = "left"

    @property
    def side(self) -> float:
        """1 if the workpiece passes the tool to the left of the feed, -1 to its right."""
        return 1.0 if self.towards == "left" else -1.0

    def forces(self, feed: float) -> CuttingForces:
        """Return the forces at a feed in m/s."""
        require(
            self.depth <= 0.5 * self.diameter,
            "cut.depth",
            "at most half the diameter",
        )
        geometry = self.geometry
        del geometry["towards"]
        ratio = self.radial_ratio
        return turn(*self.law(), feed=feed, radial=ratio, side=self.side, **geometry)


class DrillingSection(_Cut):
    """A twist drill."""

    point: PointAngle = float(np.deg2rad(118.0))

    def forces(self, feed: float) -> CuttingForces:
        """Return thrust and torque at a feed in m/s."""
        geometry = self.model_dump(exclude={"material", "kc1", "mc", "feed"})
        return drill(*self.law(), feed=feed, **geometry)


class ProcessSection(Section):
    """Loads of the process; all that are given, and the path's wrench columns, are added."""

    force: ForceSection | None = None
    milling: MillingSection | None = None
    turning: TurningSection | None = None
    drilling: DrillingSection | None = None

    @property
    def cuts(self) -> tuple[MillingSection | TurningSection | DrillingSection, ...]:
        """The given cuts: milling, turning and drilling."""
        every = (self.milling, self.turning, self.drilling)
        return tuple(cut for cut in every if cut is not None)


class PayloadSection(Section):
    """A mass on the tool's body at a point in home coordinates (default: M)."""

    mass: v.Mass
    centre: Point | None = None


@dataclass(frozen=True)
class Motion:
    """A free coordinate, rad or m.

    Attributes
    ----------
    axis
        Axis in base axes, for a spindle at home.
    at
        Point of a turntable's axis, m.
    ends
        Smallest and largest value.
    rate
        Largest change per metre of path.
    """

    name: Literal["spindle", "table", "slide"]
    axis: tuple[float, ...]
    at: tuple[float, ...]
    ends: tuple[float, float]
    rate: float

    @property
    def start(self) -> float:
        """Allowed value nearest to 0."""
        return float(np.clip(0.0, *self.ends))

    def grid(self, turns: int) -> Array:
        """Return values over the range: ``turns`` per full turn, or for a slide in total."""
        low, high = self.ends
        share = 1.0 if self.name == "slide" else min(1.0, (high - low) / (2.0 * np.pi))
        whole = self.name != "slide" and high - low >= 2.0 * np.pi - 1e-9
        return np.linspace(low, high, max(2, round(share * turns) + 1))[
            : -1 if whole else None
        ]

    def place(self, tool: Array, values: Array) -> tuple[Array, Array]:
        """Return tool poses (n, 6) and workpiece rotations (n, 3, 3) for values (n,)."""
        axis = np.array(self.axis) / np.linalg.norm(self.axis)
        out = tool.copy()
        still = np.broadcast_to(np.eye(3), (len(tool), 3, 3))
        if self.name == "slide":
            out[:, :3] += values[:, None] * axis
            return out, still
        turn = Rotation.from_rotvec(values[:, None] * axis)
        turned = Rotation.from_rotvec(tool[:, 3:])
        if self.name == "spindle":
            out[:, 3:] = (turned * turn).as_rotvec()
            return out, still
        out[:, :3] = self.at + turn.apply(tool[:, :3] - self.at)
        out[:, 3:] = (turn * turned).as_rotvec()
        return out, turn.as_matrix()


class SlideSection(Section):
    """A slide under the workpiece; for a robot on a rail at d, the workpiece moves by -d."""

    axis: Direction
    range: v.Lengths


class TableSection(Section):
    """A turntable under the workpiece: its axis passes through a point, base axes."""

    axis: Direction = (0.0, 0.0, 1.0)
    at: Point
    range: v.Angles


class FreeSection(Section):
    """Coordinates that the process leaves free; they are chosen along the path for least error."""

    spindle: Annotated[
        v.Angles | None, Says("turns about the tool's axis that are allowed")
    ] = None
    table: TableSection | None = None
    slide: SlideSection | None = None
    least: Annotated[
        Literal["normal", "along", "binormal", "size"], Says("which error")
    ] = "normal"
    turn: Annotated[
        Positive, Says("turns: at most so many degrees a millimetre of path")
    ] = 2

    def motions(self, axis: tuple[float, ...]) -> tuple[Motion, ...]:
        """Return the free motions; ``axis``: axis of the tool."""
        rate = np.deg2rad(self.turn) * 1e3
        origin = (0.0, 0.0, 0.0)
        motions_of = list[Motion]()
        if self.table is not None:
            motions_of.append(
                Motion("table", self.table.axis, self.table.at, self.table.range, rate)
            )
        if self.slide is not None:
            motions_of.append(
                Motion("slide", self.slide.axis, origin, self.slide.range, 1.0)
            )
        if self.spindle is not None:
            motions_of.append(Motion("spindle", axis, origin, self.spindle, rate))
        return tuple(motions_of)


class JobSection(Section):
    """The top level of the file."""

    robot: Annotated[
        str,
        Says(
            "a robot file, seen from the job's folder, or the name of a bundled robot"
        ),
    ]
    components: Literal["fea", "beam", "published"] | None = None
    set: tuple[str, ...] = ()
    path: Annotated[
        str,
        Says("a table (.csv, .tsv, .xlsx) or a program in G-code (.nc, .ngc, .gcode)"),
    ]
    units: dict[str, str] = Field(default_factory=dict)
    step: Annotated[Length, Says("of a program: a point at least so often")] = 1e-3
    at: Annotated[Point, Says("of a program: where its zero is, {O}")] = (0.0, 0.0, 0.0)
    x: Annotated[Direction, Says("of a program: its x axis")] = (1.0, 0.0, 0.0)
    y: Annotated[Direction, Says("of a program: its y axis")] = (0.0, 1.0, 0.0)
    axis: Annotated[
        Direction, Says("the tool's axis at home, from the workpiece to the spindle")
    ] = (0.0, 0.0, 1.0)
    gravity: Literal["weight", "none"] = "weight"
    process: ProcessSection = ProcessSection()
    payload: PayloadSection | None = None
    yield_strength: Annotated[
        dict[str, Strength], Says("by the name of a material")
    ] = Field(default_factory=dict)
    free: FreeSection | None = None


_ADDED: Any = {
    name: (schema | None, None) for name, schema in sections_of("job").items()
}
# The top level with the sections that slices add, e.g. [lobes]
WholeJob: Any = create_model(
    "WholeJob",
    __base__=JobSection,
    __module__=__name__,
    __doc__=JobSection.__doc__,
    **_ADDED,
)
SECTIONS = (
    ("the top level of a job", WholeJob),
    ("[process]", ProcessSection),
    ("[process.force]", ForceSection),
    ("[process.milling]", MillingSection),
    ("[process.turning]", TurningSection),
    ("[process.drilling]", DrillingSection),
    ("[payload]", PayloadSection),
    ("[free]", FreeSection),
    ("table of [free]", TableSection),
    ("slide of [free]", SlideSection),
)


@dataclass(frozen=True, eq=False)
class Job:
    """A robot, its path and its loads; ``file`` is the job's file, ``path_file`` the path's."""

    file: Path
    path_file: Path
    section: JobSection
    robot: RobotFile
    path: ToolPath


def load_job(path: str | Path, instead: str | Path | RobotFile | None = None) -> Job:
    """Load and check a job's file.

    Parameters
    ----------
    path
        TOML file; paths of robot and tool path are relative to its folder.
    instead
        Robot or robot file that replaces the job's, e.g. from a diagnosis or a study.

    Raises
    ------
    InputError
        The file is invalid; the message names file, line, field, expected and found value.
    """
    path = Path(path)
    source = Source(path, reading.read_text(path, "a job's file in TOML"))
    with source.refusing():
        written = parse_text(path, source.text, "a job's file")
        top = read_table(WholeJob, written, ())
        for name in ("milling", "turning", "drilling"):
            cut = getattr(top.process, name)
            with naming_key("process", name, inner=True):
                _ = cut and cut.forces(1e-3)
        if isinstance(instead, RobotFile):
            robot = instead
        elif instead is None:
            robot = load_robot_of(path, top.robot, top.set)
            for name in top.yield_strength:
                with naming_key("yield_strength", name):
                    one_of(name, MATERIALS | dict(robot.materials), "a material")
        else:
            robot = load_robot(instead, top.set)
        file = path.parent / top.path
        with naming_key("path"):
            reading.open_file(file, "a table in CSV or a program in G-code").close()
        toolpath = read_toolpath(
            file, robot, top.units, step=top.step, at=top.at, axes=_axes(top)
        )
        given = top.model_fields_set & (
            set() if toolpath.program else {"step", "at", "x", "y"}
        )
        require(
            not given,
            tuple(sorted(given)[:1]),
            f"none beside a table ({file.name}), whose poses are in base axes",
        )
    return Job(path, file, top, robot, toolpath)


def _axes(top: JobSection) -> np.ndarray:
    """Return the axes (3, 3) of a program as columns."""
    x = np.array(top.x)
    y = np.array(top.y)
    x = x / np.linalg.norm(x)
    y = y - x * (x @ y)
    require(np.linalg.norm(y) >= 1e-9, ("y",), "a direction across x", "one along it")
    y = y / np.linalg.norm(y)
    return np.column_stack((x, y, np.cross(x, y)))
