"""The true machine of the virtual lab: the robot of a robot file, and whatever is wrong with it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Protocol

import numpy as np

from stiffscope.gap.lab.rotations import axes_along, skew, turn
from stiffscope.robot.file.sections import ElasticBody, InterfaceBody

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from stiffscope.gap.lab.rotations import Array
    from stiffscope.robot.file.description import RobotFile
    from stiffscope.robot.file.sections import JointSection, LinearDrive, RigidBody, RotaryDrive

GROUND = "ground"
BASE, TOOL = "<base>", "<tool>"
"""The nodes that stand on the base's compliance, and at M behind the tool's; also the names of these two elements."""
FREE: dict[str, tuple[int, ...]] = {
    "fixed": (), "revolute": (3,), "prismatic": (0,), "cylindrical": (0, 3), "universal": (3, 4),
    "spherical": (3, 4, 5), "planar": (1, 2, 3),
}  # fmt: skip
"""Directions of a joint's axes (x along `axis`) that it leaves free; a universal joint's second is its `axis2`."""
DRIVEN = {"revolute": 3, "prismatic": 0, "cylindrical": 0}
"""Direction along which a drive acts, of the kinds that lead a body about or along one axis."""
_ALONG = 1e-9  # of a body's length: what its end may be off its x axis


def _zeros(*shape: int) -> Array:
    return np.zeros(shape)


@dataclass(frozen=True)
class Body:
    """A body; elastic where it has two nodes or more, its ends."""

    name: str
    nodes: tuple[str, ...]
    mass: float = 0.0
    centre: Array = field(default_factory=lambda: _zeros(3))
    """Of mass of a rigid one, home coordinates."""
    places: Array = field(default_factory=lambda: _zeros(0, 3))
    """Of its n ends at home."""
    axes: Array = field(default_factory=lambda: np.eye(3))
    """Part axes at home as columns."""
    compliance: Array = field(default_factory=lambda: _zeros(6, 6))
    """(6m, 6m), m = n - 1, of all ends but the first against that, part axes, at each."""
    ends: Array = field(default_factory=lambda: _zeros(2, 6, 3))
    """Wrench (n, 6, 3) at every end for unit accelerations of its mass, part axes."""
    expansion: float = 0.0
    part: str = ""
    offset: Array = field(default_factory=lambda: _zeros(6))
    """Twist (6m,) of the unloaded ends away from where the drawing has them, part axes."""

    @property
    def away(self) -> Array:
        """Places (m, 3) of all ends but the first from that, part axes."""
        return (self.places[1:] - self.places[0]) @ self.axes

    @property
    def length(self) -> float:
        """From its first end to its last, m."""
        return float(np.linalg.norm(self.places[-1] - self.places[0]))

    @property
    def is_link(self) -> bool:
        """Whether it has two ends, its x axis from one to the other."""
        return len(self.places) == 2 and bool(np.allclose(self.away[0, 1:], 0.0, atol=_ALONG * self.length))


@dataclass(frozen=True)
class Drive:
    """The spring of a drive, N/m or N·m/rad, its range of displacement from home, and the error of its zero."""

    stiffness: float
    low: float = -np.inf
    high: float = np.inf
    offset: float = 0.0
    pitch: float = 0.0
    """Relative error of its displacement."""


@dataclass(frozen=True)
class Joint:
    """A joint from node `first` to node `second`; its axes ride on the first."""

    name: str
    first: str
    second: str
    kind: str
    at: Array
    """Its point as drawn, home coordinates."""
    at_first: Array
    at_second: Array
    """Its point on either node: as drawn unless a body is not."""
    axes: Array
    axis2: Array
    """Second axis of a universal joint at home, rides on the second node."""
    bearing: Array
    """(6, 6) compliance in the joint's axes along and about what it holds, without the drive."""
    drive: Drive | None = None
    spring: float = 0.0
    """Resists each of its free motions, N/m or N·m/rad."""
    rest: float = 0.0
    directed: bool = True
    """Whether its file gives an axis: what has none yields alike in all directions that it holds."""
    astray: Array = field(default_factory=lambda: _zeros(6))
    """Twist of its real axis away from the drawn one, in its axes and at its point; bodies are as drawn at home."""

    @property
    def real_joint(self) -> Joint:
        """The joint with its axis where it really is."""
        off = self.axes @ self.astray[:3]
        return replace(
            self, at_first=self.at_first + off, at_second=self.at_second + off, axes=self.axes @ turn(self.astray[3:])
        )

    @property
    def drawn_joint(self) -> Joint:
        """The joint with its point where it is drawn."""
        return replace(self, at_first=self.at, at_second=self.at)

    @property
    def held_directions(self) -> tuple[int, ...]:
        """Directions of its axes that it holds, the driven one too."""
        free = set(FREE[self.kind]) - ({DRIVEN[self.kind]} if self.drive else set())
        return tuple(i for i in range(6) if i not in free)

    @property
    def compliance(self) -> Array:
        """(6, 6) in its axes, with the drive."""
        out = self.bearing.copy()
        if self.drive is not None:
            out[DRIVEN[self.kind], DRIVEN[self.kind]] += 1.0 / self.drive.stiffness
        return out


@dataclass(frozen=True)
class Slot:
    """A nonlinear fault: motion lost along one direction of an element, by a law of the force that it carries.

    Laws, with f the force and k the linear stiffness there (infinite where it is rigid): "play" shifts by `size`
    towards f; "hardening" makes f = k e + size e³; "friction" keeps up to `size` of f; "one-sided" yields size f where
    f pulls; "curve" yields what `points` (deflection, force) say beyond f / k; "stiffening" yields e with
    f = e / size[compliance] (1 + (e / knee)²).
    """

    element: str
    direction: int
    law: str
    size: float
    stiffness: float = np.inf
    knee: float = np.inf
    points: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True)
class Payload:
    """A mass in kg on a node, its centre in home coordinates."""

    node: str
    mass: float
    centre: Array


@dataclass(frozen=True)
class Instrument:
    """What stands between the machine and a number in a file."""

    rotation: Array = field(default_factory=lambda: _zeros(3))
    scale: float = 1.0
    force: float = 1.0
    """True wrench / stated wrench."""
    crosstalk: tuple[tuple[str, str, float], ...] = ()
    """Channel, the channel that its signal leaks into, share."""
    application: Array = field(default_factory=lambda: _zeros(3))
    """Where the wrench acts relative to where it is said to, m."""
    drift: tuple[float, float] = (0.0, 0.0)
    """What every channel has wandered by the end of the campaign, m and rad."""
    gain_drift: float = 0.0
    """Relative change of its gain from the beginning to the end."""
    quantum: tuple[float, float] = (0.0, 0.0)
    """Least step of the converter, m and rad."""
    bad_session: float = 0.0
    """Relative gain error of the last session."""
    rotations: Mapping[str, Array] = field(default_factory=dict[str, "Array"])
    scales: Mapping[str, float] = field(default_factory=dict[str, float])
    """Of single sensors."""
    factors: Mapping[str, float] = field(default_factory=dict[str, float])
    """What the numbers of a channel, or of all, are multiplied with where they are written down."""
    steps: Mapping[str, tuple[float, float]] = field(default_factory=dict[str, "tuple[float, float]"])
    """By channel from which row of the table on it has slipped, and how far, m or rad."""


@dataclass(frozen=True)
class Machine:
    """A robot as it really is, SI, base axes {O}, home coordinates."""

    robot: RobotFile
    bodies: Mapping[str, Body]
    joints: Mapping[str, Joint]
    tool: str
    """Node that carries M."""
    at: Array
    """M at home."""
    pose: tuple[str, ...]
    gravity: Array
    """Acceleration of free fall (3,)."""
    weighted: bool = True
    """Whether its own weight acts."""
    base: Array = field(default_factory=lambda: _zeros(6, 6))
    platform: Array = field(default_factory=lambda: _zeros(6, 6))
    """Compliances at {O} and at M, base axes at home."""
    cable: Array = field(default_factory=lambda: _zeros(3))
    """Stiffness along x, y, z of a cable chain between frame and tool, slack at home, N/m."""
    payloads: tuple[Payload, ...] = ()
    slots: tuple[Slot, ...] = ()
    instrument: Instrument = field(default_factory=Instrument)

    def members(self, place: str) -> tuple[str, ...]:
        """Bodies and joints that a place means; `robot` is what grows as it gets warm."""
        if place == "robot":
            return tuple(name for name, body in self.bodies.items() if len(body.nodes) > 1 and body.expansion)
        return self.robot.members(place)

    def carrier(self, node: str) -> str:
        """Name of the body that a node belongs to; the ground's is its own."""
        return node if node in self.bodies or node == GROUND else node.rsplit(".", 1)[0]

    def with_bodies(self, changed: Mapping[str, Body]) -> Machine:
        """The machine with some bodies replaced."""
        return replace(self, bodies={**self.bodies, **changed})

    def with_joints(self, changed: Mapping[str, Joint]) -> Machine:
        """The machine with some joints replaced."""
        return replace(self, joints={**self.joints, **changed})

    def with_slots(self, more: Iterable[Slot]) -> Machine:
        """The machine with more nonlinear faults."""
        return replace(self, slots=(*self.slots, *more))


class PartData(Protocol):
    """What is known of a part: compliance in its own axes, mass, and its condensed mass where there is one."""

    @property
    def compliance(self) -> Array:
        """(6m, 6m) of all ends but the first."""
        ...

    @property
    def mass(self) -> float:
        """In kg."""
        ...

    @property
    def dynamics(self) -> CondensedMass | None:
        """Condensed on its ends."""
        ...

    @property
    def places(self) -> Array | None:
        """(n, 3) where the coordinates of its ends are taken."""
        ...


class CondensedMass(Protocol):
    """Mass of a part on the twists of its ends."""

    @property
    def mass(self) -> Array:
        """(6n + k, 6n + k)."""
        ...


def machine_of(robot: RobotFile, parts: Mapping[str, PartData]) -> Machine:
    """Return the sound machine that a robot file describes.

    Parameters
    ----------
    robot
        The robot file; effects that it has adopted are not in it.
    parts
        Compliance and mass of every part that is used, by name.

    """
    bodies: dict[str, Body] = {}
    for name, section in robot.bodies.items():
        if isinstance(section, ElasticBody | InterfaceBody):
            bodies[name] = _make_elastic(robot, name, section, parts[section.part])
        else:
            bodies[name] = _make_rigid(name, section)
    joints = {name: _joint(robot, name, section) for name, section in robot.joints.items()}
    gravity = np.zeros(3)
    if robot.gravity is not None:
        direction = np.array(robot.gravity.direction)
        gravity = robot.gravity.acceleration * direction / np.linalg.norm(direction)
    tool, slots = robot.tool, tuple(_find_slots(robot))
    return Machine(robot, bodies, joints, tool.body, np.array(tool.at), tuple(tool.pose), gravity, slots=slots)


def _find_slots(robot: RobotFile) -> Iterable[Slot]:
    """What drives that are not linear lose beside their first slope, and their backlash."""
    for name, section in robot.joints.items():
        drive = getattr(section, "drive", None)
        if drive is None:
            continue
        first, along = _first_slope(drive), DRIVEN[section.type]
        if drive.points is not None and len(drive.points) > 1:
            yield Slot(name, along, "curve", 0.0, first, points=drive.points)
        if drive.backlash:
            yield Slot(name, along, "play", 0.5 * drive.backlash, first)


def _make_rigid(name: str, section: RigidBody) -> Body:
    return Body(name, (name,), section.mass, np.array(section.centre or (0.0, 0.0, 0.0)))


def _make_elastic(robot: RobotFile, name: str, section: ElasticBody | InterfaceBody, part: PartData) -> Body:
    y = None if section.y is None else np.array(section.y)
    if isinstance(section, ElasticBody):
        places = np.array([section.base, section.tip])
        axes = axes_along(places[1] - places[0], y)
    else:
        axes = axes_along(np.array(section.x), y)
        places = np.array(section.at) + np.asarray(part.places) @ axes.T
    material = robot.material(section.part)
    return Body(
        name,
        tuple(f"{name}.{end}" for end in robot.ends(name)),
        part.mass,
        places=places,
        axes=axes,
        compliance=np.array(part.compliance),
        ends=_ends(part, (places - places[-1]) @ axes),
        expansion=0.0 if material is None else material.expansion,
        part=section.part,
        offset=_zeros(6 * len(places) - 6),
    )


def _ends(part: PartData, places: Array) -> Array:
    """Wrenches (n, 6, 3) at n ends for unit accelerations: its mass shared alike, or as its mass is spread.

    places: (n, 3) of the ends from the last one, part axes.
    """
    n = len(places)
    out = np.zeros((n, 6, 3))
    if part.dynamics is None or part.places is None:
        out[:, :3] = part.mass / n * np.eye(3)
        return out
    mass = part.dynamics.mass[: 6 * n]
    out[:] = mass[:, : 6 * n].reshape(n, 6, n, 6)[..., :3].sum(axis=2)
    away = part.places - part.places[-1] - places  # from the body's ends to where the forces act
    out[:, 3:] += skew(away) @ out[:, :3]
    return out


def _joint(robot: RobotFile, name: str, section: JointSection) -> Joint:
    axis, axis2 = (None if a is None else np.array(a) for a in (getattr(section, k, None) for k in ("axis", "axis2")))
    at = np.array(section.at)
    drive = getattr(section, "drive", None)
    spring = None if drive is None else Drive(_first_slope(drive), *(drive.range or (-np.inf, np.inf)))
    axes = _axes(axis, axis2, np.eye(3))
    second = np.zeros(3) if axis2 is None else axis2 / np.linalg.norm(axis2)
    rotation = np.asarray(robot.copied[name].rotation) if name in robot.copied else np.eye(3)
    written = _axes(axis, axis2, rotation.T)
    bearing = section.yielding(written)
    if name in robot.copied:  # it is that of the original and turns with it
        relative = np.kron(np.eye(2), axes.T @ rotation @ written)
        bearing = relative @ bearing @ relative.T
    return Joint(name, *section.between, section.type, at, at, at, axes, second, bearing, spring,
                 getattr(section, "spring", None) or 0.0, getattr(section, "rest", 0.0), axis is not None)  # fmt: skip


def _first_slope(drive: LinearDrive | RotaryDrive) -> float:
    if drive.points is None:
        return drive.stiffness
    deflection, force = drive.points[0]
    return force / deflection


def _axes(axis: Array | None, axis2: Array | None, rotation: Array) -> Array:
    if axis is None:
        return np.eye(3)
    return axes_along(rotation @ axis, None if axis2 is None else rotation @ axis2)
