"""True machine of the virtual lab: the robot of a robot file with its faults."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.errors import InputError
from stiffscope.lab.rotations import axes_along, skew, turn
from stiffscope.robot.file.sections import ElasticBody, InterfaceBody

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from stiffscope.lab.rotations import Array
    from stiffscope.robot.file.description import RobotFile
    from stiffscope.robot.file.sections import JointSection, LinearDrive, RotaryDrive

GROUND = "ground"
BASE = "<base>"
TOOL = "<tool>"
"""Nodes above the base's compliance, and at M behind the tool's; also names of these elements."""
FREE: dict[str, tuple[int, ...]] = {
    "fixed": (),
    "revolute": (3,),
    "prismatic": (0,),
    "cylindrical": (0, 3),
    "universal": (3, 4),
    "spherical": (3, 4, 5),
    "planar": (1, 2, 3),
}
"""Free directions in a joint's axes (x along `axis`); a universal joint's second is `axis2`."""
DRIVEN = {"revolute": 3, "prismatic": 0, "cylindrical": 0}
"""Driven direction of joints that guide a body about or along one axis."""
_ALONG = 1e-9  # relative to a body's length: offset of its end from its x axis


class NoEquilibriumError(InputError):
    """The mechanics that measures a machine does not settle it."""


def _zeros(*shape: int) -> Array:
    return np.zeros(shape)


@dataclass(frozen=True)
class Body:
    """A body; elastic if it has two or more nodes, its ends."""

    name: str
    nodes: tuple[str, ...]
    mass: float = 0.0
    centre: Array = field(default_factory=lambda: _zeros(3))
    """Centre of mass of a rigid body, home coordinates."""
    places: Array = field(default_factory=lambda: _zeros(0, 3))
    """Positions (n, 3) of its ends at home."""
    axes: Array = field(default_factory=lambda: np.eye(3))
    """Part axes at home as columns."""
    compliance: Array = field(default_factory=lambda: _zeros(6, 6))
    """Compliance (6m, 6m), m = n - 1, of the other ends against the first, part axes."""
    ends: Array = field(default_factory=lambda: _zeros(2, 6, 3))
    """Wrenches (n, 6, 3) at its ends for unit accelerations of its mass, part axes."""
    expansion: float = 0.0
    part: str = ""
    offset: Array = field(default_factory=lambda: _zeros(6))
    """Twist (6m,) of the unloaded ends from their drawn positions, part axes."""
    inertia: Array = field(default_factory=lambda: _zeros(3, 3))
    """Inertia (3, 3) of a rigid body about its centre, base axes at home."""
    moving: Array = field(default_factory=lambda: _zeros(0, 0))
    """Mass matrix (6n + k, 6n + k) of its n ends' twists and k modes between them, part axes; (0, 0) if
    its mass is at its ends."""
    squares: Array = field(default_factory=lambda: _zeros(0))
    """Squared angular frequencies (k,) of these modes, whose amplitudes have a unit mass."""

    @property
    def away(self) -> Array:
        """Positions (m, 3) of the other ends relative to the first, part axes."""
        return (self.places[1:] - self.places[0]) @ self.axes

    @property
    def length(self) -> float:
        """Distance from its first end to its last, m."""
        return float(np.linalg.norm(self.places[-1] - self.places[0]))

    @property
    def is_link(self) -> bool:
        """Whether it has two ends, connected by its x axis."""
        aside = np.abs(self.away[:, 1:])
        return len(self.places) == 2 and bool((aside <= _ALONG * self.length).all())


@dataclass(frozen=True)
class Drive:
    """A drive: stiffness, N/m or N·m/rad, range of displacement from home, and zero error."""

    stiffness: float
    low: float = -np.inf
    high: float = np.inf
    offset: float = 0.0
    pitch: float = 0.0
    """Relative error of its displacement."""


@dataclass(frozen=True)
class Joint:
    """A joint from node `first` to node `second`; its axes move with the first."""

    name: str
    first: str
    second: str
    kind: str
    at: Array
    """Its drawn point, home coordinates."""
    at_first: Array
    at_second: Array
    """Its point on either node: the drawn one unless a body deviates."""
    axes: Array
    axis2: Array
    """Second axis of a universal joint at home; it moves with the second node."""
    bearing: Array
    """Compliance (6, 6) in its constrained directions, joint axes, without the drive."""
    drive: Drive | None = None
    spring: float = 0.0
    """Stiffness of each of its free motions, N/m or N·m/rad."""
    rest: float = 0.0
    directed: bool = True
    """Whether its file gives an axis; without one, all held directions are equally compliant."""
    misalignment: Array = field(default_factory=lambda: _zeros(6))
    """Twist of its real axis from the drawn one, own axes and point; bodies as drawn at home."""
    carried_by: str = "second"
    """The body that its bearing stays on while it slides: the first or the second."""

    @property
    def slides_in_first(self) -> bool:
        """Whether the second body slides through a bearing on the first."""
        return self.carried_by == "first" and any(i < 3 for i in FREE[self.kind])

    @property
    def real_joint(self) -> Joint:
        """The joint with its real axis."""
        off = self.axes @ self.misalignment[:3]
        return replace(
            self,
            at_first=self.at_first + off,
            at_second=self.at_second + off,
            axes=self.axes @ turn(self.misalignment[3:]),
        )

    @property
    def drawn_joint(self) -> Joint:
        """The joint with its drawn point."""
        return replace(self, at_first=self.at, at_second=self.at)

    @property
    def held_directions(self) -> tuple[int, ...]:
        """Constrained directions of its axes, including the driven one."""
        free = set(FREE[self.kind]) - ({DRIVEN[self.kind]} if self.drive else set())
        return tuple(i for i in range(6) if i not in free)

    @property
    def compliance(self) -> Array:
        """Compliance (6, 6) in its axes, with the drive."""
        out = self.bearing.copy()
        if self.drive is not None:
            out[DRIVEN[self.kind], DRIVEN[self.kind]] += 1.0 / self.drive.stiffness
        return out


@dataclass(frozen=True)
class Slot:
    """A nonlinear fault: lost motion in one direction of an element by a law of its force.

    Laws, with force f, deflection e and linear stiffness k (infinite if rigid): "play" shifts by
    `size` towards f; "hardening" has f = k e + size e³; "friction" takes up to `size` of f;
    "one-sided" gives e = size f in tension only; "curve" gives the deflection by `points`
    (deflection, force) less f / k; "stiffening" has f = e / size[compliance] (1 + (e / knee)²).
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
    """A mass, kg, on a node, with its centre in home coordinates, and a constant pull there, N, base axes."""

    node: str
    mass: float
    centre: Array
    force: Array = field(default_factory=lambda: _zeros(3))

    def wrench(self, gravity: Array) -> Array:
        """Return its wrench (6,) at its centre under gravity (3,), base axes."""
        return np.concatenate([self.mass * gravity + self.force, np.zeros(3)])


@dataclass(frozen=True)
class Instrument:
    """The measuring chain between the machine and a number in a file."""

    force: float = 1.0
    """Ratio of true to stated wrench."""
    crosstalk: tuple[tuple[str, str, float], ...] = ()
    """Tuples of channel, the channel that its signal leaks into, and share."""
    application: Array = field(default_factory=lambda: _zeros(3))
    """Offset of the wrench's actual point from the stated one, m."""
    drift: tuple[float, float] = (0.0, 0.0)
    """Drift of every channel by the end of the campaign, m and rad."""
    gain_drift: float = 0.0
    """Relative change of the gain over the campaign."""
    quantum: tuple[float, float] = (0.0, 0.0)
    """Resolution of the converter, m and rad."""
    bad_session: float = 0.0
    """Relative gain error of the last session."""
    rotations: Mapping[str, Array] = field(default_factory=dict[str, "Array"])
    scales: Mapping[str, float] = field(default_factory=dict[str, float])
    """Rotations (3,) and scales of channels, or of the whole "instrument"."""
    factors: Mapping[str, float] = field(default_factory=dict[str, float])
    """Factor on the recorded numbers of a channel, or of the "instrument"."""
    leak: Array = field(default_factory=lambda: _zeros(3, 3))
    """Shares of the true force's components that the force sensor adds to others."""
    weights: Mapping[str, float] = field(default_factory=dict[str, float])
    """Ratio of true to stated load, by the stated size, such as "20 N"."""
    swaps: tuple[tuple[str, str], ...] = ()
    """Pairs of channels, or of components of the force, that are exchanged in the table."""
    steps: Mapping[str, tuple[float, float]] = field(default_factory=dict[str, Any])
    """First row of the table after a slip, and its size, m or rad, by channel."""


@dataclass(frozen=True)
class Machine:
    """The real robot, SI, base axes {O}, home coordinates."""

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
    """Whether the robot's own weight acts."""
    base: Array = field(default_factory=lambda: _zeros(6, 6))
    platform: Array = field(default_factory=lambda: _zeros(6, 6))
    """Compliances at {O} and at M, base axes at home."""
    cable: Array = field(default_factory=lambda: _zeros(3))
    """Stiffness along x, y, z of a cable chain between frame and tool, unloaded at home, N/m."""
    shift: Array = field(default_factory=lambda: _zeros(6))
    """Where the tool point and its axes really are, against M: (x, y, z, rx, ry, rz) at home."""
    payloads: tuple[Payload, ...] = ()
    slots: tuple[Slot, ...] = ()
    instrument: Instrument = field(default_factory=Instrument)
    sensor_masses: Mapping[str, float] = field(default_factory=dict[str, float])
    """Mass, kg, of the sensors at points of a hammer test, beyond the stated one."""
    response_gains: Mapping[str, float] = field(default_factory=dict[str, float])
    """Factor on what `HAMMER`, a point or a channel such as `2.x` of a hammer test shows."""
    still: tuple[str, ...] = ()
    kept: tuple[str, ...] = ()
    """Drives and springs, and coordinates of M, that poses leave as at home."""

    def members(self, place: str) -> tuple[str, ...]:
        """Return the bodies and joints of a place; `robot` means all that expand thermally."""
        if place == "robot":
            elastic = [body for body in self.bodies.values() if len(body.nodes) > 1]
            return tuple(body.name for body in elastic if body.expansion)
        return self.robot.members(place)

    def carrier(self, node: str) -> str:
        """Return the name of a node's body; the ground's is its own."""
        return node if node in self.bodies or node == GROUND else node.rsplit(".", 1)[0]

    def change(self, changed: Mapping[str, Body] | Mapping[str, Joint]) -> Machine:
        """Return the machine with some bodies and joints replaced."""
        bodies: Any = {
            name: changed.get(name, body) for name, body in self.bodies.items()
        }
        joints: Any = {
            name: changed.get(name, joint) for name, joint in self.joints.items()
        }
        return replace(self, bodies=bodies, joints=joints)


def machine_of(robot: RobotFile, parts: Mapping[str, Any]) -> Machine:
    """Return the sound machine described by a robot file.

    Parameters
    ----------
    robot
        The robot file; its adopted effects are not applied.
    parts
        Compliance, mass, condensed mass and places of the ends of every part used, by name.
    """
    bodies: dict[str, Body] = {}
    for name, section in robot.bodies.items():
        if isinstance(section, ElasticBody | InterfaceBody):
            bodies[name] = _make_elastic(robot, name, section, parts[section.part])
        else:
            centre = np.array(section.centre or (0.0, 0.0, 0.0))
            inertia = _read_inertia(section.inertia)
            bodies[name] = Body(name, (name,), section.mass, centre, inertia=inertia)
    joints = {
        name: _joint(robot, name, section) for name, section in robot.joints.items()
    }
    gravity = np.zeros(3)
    if robot.gravity is not None:
        direction = np.array(robot.gravity.direction)
        gravity = robot.gravity.acceleration * direction / np.linalg.norm(direction)
    tool = robot.tool.body
    at = np.array(robot.tool.at)
    pose = tuple(robot.tool.pose)
    return Machine(
        robot=robot,
        bodies=bodies,
        joints=joints,
        tool=tool,
        at=at,
        pose=pose,
        gravity=gravity,
        slots=tuple(_find_slots(robot)),
    )


def _read_inertia(moments: Sequence[float] | None) -> Array:
    """Return the inertia (3, 3) with Ixx, Iyy, Izz, Ixy, Ixz, Iyz, as elements of the matrix."""
    xx, yy, zz, xy, xz, yz = moments or (0.0,) * 6
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def _find_slots(robot: RobotFile) -> Iterable[Slot]:
    """Yield the lost motion of nonlinear drives beyond their first slope, and their backlash."""
    for name, section in robot.joints.items():
        drive = getattr(section, "drive", None)
        if drive is None:
            continue
        first = _first_slope(drive)
        along = DRIVEN[section.type]
        if drive.points is not None and len(drive.points) > 1:
            yield Slot(name, along, "curve", 0.0, first, points=drive.points)
        if drive.backlash:
            yield Slot(name, along, "play", 0.5 * drive.backlash, first)


def _make_elastic(
    robot: RobotFile, name: str, section: ElasticBody | InterfaceBody, part: Any
) -> Body:
    y = None if section.y is None else np.array(section.y)
    if isinstance(section, ElasticBody):
        places = np.array([section.base, section.tip])
        axes = axes_along(places[1] - places[0], y)
    else:
        axes = axes_along(np.array(section.x), y)
        places = np.array(section.at) + np.asarray(part.places) @ axes.T
    material = robot.material(section.part)
    relative = (places - places[-1]) @ axes
    moving, squares = _find_motion(part, relative)
    return Body(
        name,
        tuple(f"{name}.{end}" for end in robot.ends(name)),
        part.mass,
        places=places,
        axes=axes,
        compliance=np.array(part.compliance),
        ends=_ends(part, relative),
        expansion=0.0 if material is None else material.expansion,
        part=section.part,
        offset=_zeros(6 * len(places) - 6),
        moving=moving,
        squares=squares,
    )


def _find_motion(part: Any, places: Array) -> tuple[Array, Array]:
    """Return the mass matrix (6n + k, 6n + k) and squared frequencies (k,) of a part's motions.

    places: positions (n, 3) of the body's ends relative to the last, part axes.
    """
    if part.dynamics is None:
        return _zeros(0, 0), _zeros(0)
    carry = np.eye(len(part.dynamics.mass))
    if part.places is not None:
        away = part.places - part.places[-1] - places
        for k, way in enumerate(away):  # v + ω × r at the part's own ends
            carry[6 * k : 6 * k + 3, 6 * k + 3 : 6 * k + 6] = -skew(way)
    return carry.T @ part.dynamics.mass @ carry, np.array(part.dynamics.squares)


def _ends(part: Any, places: Array) -> Array:
    """Return wrenches (n, 6, 3) at n ends for unit accelerations: equal shares or condensed mass.

    places: positions (n, 3) of the ends relative to the last, part axes.
    """
    n = len(places)
    out = np.zeros((n, 6, 3))
    if part.dynamics is None or part.places is None:
        out[:, :3] = part.mass / n * np.eye(3)
        return out
    mass = part.dynamics.mass[: 6 * n]
    out[:] = mass[:, : 6 * n].reshape(n, 6, n, 6)[..., :3].sum(axis=2)
    away = part.places - part.places[-1] - places  # from the body's ends to the forces
    out[:, 3:] += skew(away) @ out[:, :3]
    return out


def _joint(robot: RobotFile, name: str, section: JointSection) -> Joint:
    given = (getattr(section, key, None) for key in ("axis", "axis2"))
    axis, axis2 = (None if each is None else np.array(each) for each in given)
    at = np.array(section.at)
    drive = getattr(section, "drive", None)
    ends = (drive and drive.range) or (-np.inf, np.inf)
    spring = None if drive is None else Drive(_first_slope(drive), *ends)
    axes = _axes(axis, axis2, np.eye(3))
    second = np.zeros(3) if axis2 is None else axis2 / np.linalg.norm(axis2)
    rotation = (
        np.asarray(robot.copied[name].rotation) if name in robot.copied else np.eye(3)
    )
    written = _axes(axis, axis2, rotation.T)
    bearing = section.yielding(written)
    if name in robot.copied:  # copied from the original, rotated with it
        relative = np.kron(np.eye(2), axes.T @ rotation @ written)
        bearing = relative @ bearing @ relative.T
    return Joint(
        name,
        *section.between,
        section.type,
        at,
        at,
        at,
        axes,
        second,
        bearing,
        spring,
        getattr(section, "spring", None) or 0.0,
        getattr(section, "rest", 0.0),
        axis is not None,
        carried_by=section.carried_by,
    )


def _first_slope(drive: LinearDrive | RotaryDrive) -> float:
    if drive.points is None:
        return drive.stiffness
    deflection, force = drive.points[0]
    return force / deflection


def _axes(axis: Array | None, axis2: Array | None, rotation: Array) -> Array:
    if axis is None:
        return np.eye(3)
    return axes_along(rotation @ axis, None if axis2 is None else rotation @ axis2)
