"""Inspection of robot files, without experiments: mobility, masses, reach, poses, remarks."""

from __future__ import annotations

from collections import Counter
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.cad.checks import mm
from stiffscope.errors import InputError
from stiffscope.registry import registered
from stiffscope.robot.file.description import HOME
from stiffscope.robot.file.part_sections import InterfacePart, MatrixPart
from stiffscope.robot.file.sections import RigidBody
from stiffscope.robot.mechanism_of import configured_poses, rigid_mechanism
from stiffscope.robot.part_matrices import known_mass, source_of, used_parts
from stiffscope.vjm.kinematics.configurations import configure, find_still, start_note
from stiffscope.vjm.kinematics.linkage import Linkage
from stiffscope.vjm.kinematics.mobility import NEAR, mobility
from stiffscope.vjm.kinematics.reach import reach
from stiffscope.vjm.model.checks import list_names

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    from stiffscope.robot.file.description import RobotFile
    from stiffscope.robot.file.sections import MapSection
    from stiffscope.runtime.types import Array
    from stiffscope.vjm.kinematics.configurations import Configurations
    from stiffscope.vjm.kinematics.mobility import Mobility
    from stiffscope.vjm.kinematics.reach import Reach
    from stiffscope.vjm.model.mechanism import Mechanism

ILL_CONDITIONED = 1e-2  # a pose is nearly singular below this inverse condition number
RANK_GAP = 1e-12  # singular values below this are rounding errors of double precision
_NEARBY = 0.01  # relative to the mechanism's characteristic length, and rad
_REVERSED = 0.5  # of a beam's coupling, with the other sign
_CONTRADICTED = (
    1.5,
    5.0,
)  # how many times a part may be longer, shorter than by its bending
_APART = 1e-5  # m
_TURNS = 12.6
_SIZES = 20.0  # rad (two turns) and robot sizes beyond which a drive's range is doubted
_GRID = 9  # points along each coordinate of the map
_SOLIDS = {
    "youngs_modulus": ("Young's modulus", 1e5, 1.3e12, " Pa"),
    "axial_modulus": ("axial modulus", 1e5, 1.3e12, " Pa"),
    "transverse_modulus": ("transverse modulus", 1e5, 1.3e12, " Pa"),
    "poisson": ("Poisson's ratio, E/2G - 1,", -0.8, 0.5, ""),
    "density": ("density", 20.0, 2.3e4, " kg/m³"),
    "expansion": ("expansion", -1e-3, 1e-3, " 1/K"),
}  # foam and rubber to diamond and osmium


@dataclass(frozen=True)
class Doubt:
    """Something for a person to check: solids, description, and place, m, or None.

    ``warning``: whether it may make numbers wrong by far, so that every command repeats it.
    """

    solids: tuple[str, ...]
    text: str
    at: tuple[float, ...] | None = None
    warning: bool = False


@dataclass(frozen=True)
class Part:
    """A part: source of its 6x6, length, m, and mass, kg (None if only its solid defines it)."""

    name: str
    shape: str
    source: str
    length: float | None
    mass: float | None
    bodies: tuple[str, ...]


@dataclass(frozen=True)
class Pose:
    """A named pose: reason if it is out of reach, and drive displacements from home, m and rad.

    ``conditioning``: see `stiffscope.vjm.kinematics.mobility.Mobility`; None also if out of reach.
    """

    name: str
    tool: tuple[float, ...]
    reason: str
    drives: tuple[float, ...]
    conditioning: float | None

    @property
    def is_reached(self) -> bool:
        """Whether the robot reaches the pose."""
        return not self.reason


@dataclass(frozen=True, eq=False)
class Inspection:
    """Result of an inspection; ``masses`` by body, kg, None if only the part's solid defines it.

    ``residual``: largest loop closure error at home, m; ``poses``: home first; ``configurations``:
    of the poses, None if the mechanism cannot follow them; ``mapped``: reachable fraction of the
    map; ``doubts``: from the import that wrote the file.
    """

    robot: RobotFile
    mechanism: Mechanism
    mobility: Mobility
    residual: float
    parts: tuple[Part, ...]
    masses: Mapping[str, float | None]
    doubts: tuple[Doubt, ...]
    reach: tuple[Reach, ...] = ()
    poses: tuple[Pose, ...] = ()
    configurations: Configurations | None = None
    mapped: float | None = None
    remarks: tuple[str, ...] = ()
    error: str = ""
    """Reason why the robot cannot be used; empty if it can."""


def inspect_robot(robot: RobotFile) -> Inspection:
    """Inspect a robot at home and at its named poses, with all bodies rigid."""
    mechanism = rigid_mechanism(robot)
    mobilities = mobility(mechanism)
    linkage = Linkage(mechanism, "tool")
    errors = linkage.find_link_frames(np.zeros((linkage.size, 1))).errors
    residual = linkage.length * float(np.abs(errors).max(initial=0.0))
    parts = tuple(_part(robot, name) for name in used_parts(robot))
    masses = {
        name: body.mass if isinstance(body, RigidBody) else known_mass(robot, body.part)
        for name, body in robot.bodies.items()
    }
    named = _named_poses(robot, mechanism)
    doubts = tuple(d for find in registered("doubts") for d in find(robot))
    inspection = Inspection(
        robot=robot,
        mechanism=mechanism,
        mobility=mobilities,
        residual=residual,
        parts=parts,
        masses=masses,
        doubts=doubts,
    )
    try:
        configurations = configured_poses(robot, mechanism, list(named.values()))
        locked = [k for k, state in mobilities.coordinates.items() if state == "locked"]
        ways = [w for w in reach(mechanism) if w.coordinate not in locked]
    except InputError as error:
        return replace(
            inspection, remarks=tuple(_of_mobility(mobilities)), error=str(error)
        )
    poses = tuple(
        _pose(configurations, k, *each) for k, each in enumerate(named.items())
    )
    mapped = None if robot.map is None else _map_reach(robot.map, mechanism)
    missed = mapped is not None and mapped < 1.0
    remarks = (
        *_of_mobility(mobilities, start_note(mechanism)),
        *_of_choice(mobilities, mechanism),
        *_of_home(mobilities, mechanism),
        *_of_poses(poses),
        *(
            [f"{100 * (mapped or 0.0):.0f} % of the map's points are reached"]
            if missed
            else []
        ),
        *doubt_parts(robot),
        *_of_ranges(robot, mechanism),
        *_of_places(robot, mechanism),
        *_of_masses(robot, masses),
    )
    facts = {"configurations": configurations, "mapped": mapped, "remarks": remarks}
    return replace(inspection, reach=tuple(ways), poses=poses, **facts)


def _named_poses(
    robot: RobotFile, mechanism: Mechanism
) -> dict[str, tuple[float, ...]]:
    """Return home, under its name in the file if it has one, and the file's poses."""
    home = mechanism.tool.home
    poses = dict(robot.poses)
    same = (
        name
        for name, pose in poses.items()
        if np.allclose(pose, home, rtol=0.0, atol=1e-9)
    )
    named = next(same, f"{HOME} of the mechanism" if HOME in poses else HOME)
    poses.pop(named, None)
    return {named: tuple(home), **poses}


def _part(robot: RobotFile, name: str) -> Part:
    part = robot.parts[name]
    bodies = robot.bodies_of(name)
    one = robot.bodies[bodies[0]]
    length = part.span or getattr(one, "length", None)
    return Part(
        name, part.shape, source_of(part), length, known_mass(robot, name), bodies
    )


def _pose(
    configurations: Configurations, k: int, name: str, tool: tuple[float, ...]
) -> Pose:
    drives = tuple(configurations.drives[k].tolist())
    reason = configurations.reason(k)
    mobility_here = (
        None if reason else mobility(configurations.mechanism, configurations, k)
    )
    return Pose(
        name,
        tuple(map(float, tool)),
        reason,
        drives,
        mobility_here and mobility_here.conditioning,
    )


def _map_reach(swept: MapSection, mechanism: Mechanism) -> float:
    """Return the reachable fraction of the map, on a coarse grid."""
    lines = [np.linspace(*ends, _GRID) for ends in swept.ranges().values()]
    grid = np.stack(np.meshgrid(*lines), axis=-1).reshape(-1, len(lines))
    at = mechanism.tool.home if swept.at is None else np.array(swept.at, dtype=float)
    points = np.tile(at, (len(grid), 1))
    points[:, [mechanism.tool.pose.index(name) for name in swept.ranges()]] = grid
    return float(configure(mechanism, points).valid.mean())


def _of_mobility(mobilities: Mobility, start: str | None = None) -> Iterator[str]:
    """Yield remarks on drives and coordinates; ``start``: where poses start, unless at home."""
    of = mobilities.coordinates.items()
    locked, free = (
        ", ".join(k for k, state in of if state == word) for word in ("locked", "free")
    )
    if start:
        yield start
    elif locked:
        able = ", ".join(map(str, mobilities.tool)) or "nothing"
        yield f"[tool] pose commands {locked}, which the mechanism locks; free: {able}"
    if free:
        yield f"the tool also moves in {free}, which [tool] pose does not command"
    if mobilities.loose:
        left = ", ".join(map(str, mobilities.loose))
        more = len(mobilities.loose)
        yield f"too few drives: with all held the tool still moves ({left}); {more} more needed"
    if mobilities.redundant_drives:
        names = list_names(mobilities.dependent_drives)
        yield f"drives determined by others or by loops: {names}; {mobilities.redundant_drives} too many"
    if mobilities.rounding > RANK_GAP or mobilities.constraint_margin < NEAR:
        size = (
            mobilities.rounding
            if mobilities.rounding > RANK_GAP
            else mobilities.constraint_margin
        )
        yield (
            f"a motion is almost free (to {size:.1g} of robot size): axes nearly parallel or "
            "intersecting; are coordinates rounded? Give them as expressions, or to 12 digits"
        )


def _of_choice(mobilities: Mobility, mechanism: Mechanism) -> Iterator[str]:
    """Yield a remark on what stays as at home if a pose leaves a continuum of configurations."""
    motions = mobilities.dof - mobilities.idle_count
    ways = motions - len(mechanism.tool.pose)
    joints, coordinates = find_still(mechanism)
    still = [*joints, *(f"{name} of the tool" for name in coordinates)]
    if ways > 0 and still:
        stay = (
            f"{list_names(still)} {'stays' if len(still) == 1 else 'stay'} as at home"
        )
        yield f"[tool] pose leaves {ways} of {motions} motions open: {stay}"


def _of_home(mobilities: Mobility, mechanism: Mechanism) -> Iterator[str]:
    """Yield a remark if home is singular: its mobility differs from that nearby."""
    size = Linkage(mechanism, "tool").length
    rng = np.random.default_rng(0)
    unit = np.array(
        [1.0 if name.startswith("r") else size for name in mechanism.tool.pose]
    )
    away = _NEARBY * unit * rng.uniform(-1.0, 1.0, (6, len(unit)))
    near = configure(mechanism, mechanism.tool.home + away)
    for k in np.flatnonzero(near.valid)[:2]:
        there = mobility(mechanism, near, int(k))
        if (there.dof, len(there.tool)) != (mobilities.dof, len(mobilities.tool)):
            yield (
                f"home is singular: of {mobilities.dof} degrees of freedom the tool has {len(mobilities.tool)} there, "
                f"of {there.dof} nearby {len(there.tool)}"
            )
            return


def _of_poses(poses: Iterable[Pose]) -> Iterator[str]:
    """Yield remarks on poses that are out of reach, singular or nearly singular."""
    for pose in poses:
        if not pose.is_reached:
            yield f"pose {pose.name} is not reached: {pose.reason}"
        elif pose.conditioning is not None and pose.conditioning < ILL_CONDITIONED:
            word = "singular" if pose.conditioning == 0.0 else "nearly singular"
            how = f"1/condition number of pose by drives is {pose.conditioning:.2g}"
            yield f"pose {pose.name} is {word}: {how}"


def doubt_parts(robot: RobotFile) -> Iterator[str]:
    """Yield remarks on materials and matrices that were likely given in another unit."""
    yield from _of_materials(robot)
    yield from _of_matrices(robot)


def _of_materials(robot: RobotFile) -> Iterator[str]:
    """Yield remarks on the file's materials that nothing uses, or that lie outside what solids have."""
    used = {getattr(part, "material", None) for part in robot.parts.values()}
    idle = [f"materials.{name}" for name in robot.materials if name not in used]
    if idle:
        yield f"nothing is made of {list_names(idle)}"
    for name, material in robot.materials.items():
        for key, (word, low, high, unit) in _SOLIDS.items():
            value = getattr(material, key, 0.0)
            if name in used and value and not low <= value <= high:
                usual = f"solids have {low:g} to {high:g}{unit}"
                yield f"material {name}: its {word} is {value:.3g}{unit}, {usual}; is its unit right?"


def _of_matrices(robot: RobotFile) -> Iterator[str]:
    """Yield remarks on matrices that contradict a beam of the body's length: √(3·C22/C66) = L, C26 = 3/(2L)·C22."""
    for name in used_parts(robot):
        part = robot.parts[name]
        if not isinstance(part, MatrixPart):
            continue
        given = np.array(part.matrix)
        length = robot.elastic_bodies()[robot.bodies_of(name)[0]].length
        doubt = "are its numbers SI, and of a compliance rather than a stiffness?"
        most = np.diag(given)[:3].max()
        if most > length:
            moved = f"one newton moves its tip by {most:.3g} m, more than its length {length:.3g} m"
            yield f"part {name}: {moved}; {doubt}"
            continue
        for lateral, turning, sign in ((1, 5, 1.0), (2, 4, -1.0)):
            if not (given[lateral, lateral] > 0.0 and given[turning, turning] > 0.0):
                continue
            slender = float(
                np.sqrt(3.0 * given[lateral, lateral] / given[turning, turning])
            )
            if not length / _CONTRADICTED[0] < slender < length * _CONTRADICTED[1]:
                entries = f"C{lateral + 1}{lateral + 1}/C{turning + 1}{turning + 1}"
                yield (
                    f"part {name}: √(3·{entries}) = {slender:.3g} m, the length of a slender part, "
                    f"contradicts its length {length:.3g} m; {doubt}"
                )
                break
            both = given[lateral, turning]
            beam = sign * 1.5 / length * given[lateral, lateral]
            if both / beam < -_REVERSED:
                entry = f"C{lateral + 1}{turning + 1} = {both:.3g} contradicts its length, by which it is {beam:.3g}"
                yield f"part {name}: {entry}; is it clamped at its base and loaded at its tip, x from base to tip?"
                break


def _of_ranges(robot: RobotFile, mechanism: Mechanism) -> Iterator[str]:
    """Yield remarks on drives whose range is far beyond the robot's size, or many turns."""
    size = Linkage(mechanism, "tool").length
    for joint in mechanism.drives:
        low, high = (joint.drive.low, joint.drive.high) if joint.drive else (0.0, 0.0)
        most, unit = (_TURNS, "rad") if joint.turns else (_SIZES * size, "m")
        if most < max(-low, high) < np.inf and joint.name not in robot.copied:
            yield f"drive {joint.name}: its range is {low:g} to {high:g} {unit}; is its unit right?"


def _of_places(robot: RobotFile, mechanism: Mechanism) -> Iterator[str]:
    """Yield remarks on rotary joints that are apart from an end that they alone hold."""
    held = Counter(
        node for joint in mechanism.joints for node in (joint.first, joint.second)
    )
    ends = dict[str, "Array"]()
    for body in mechanism.bodies:
        part = robot.parts.get(getattr(robot.bodies[body.name], "part", ""))
        if (
            part is not None
            and part.interface_names
            and not isinstance(part, InterfacePart)
        ):
            continue  # whose places only CAD knows
        places = body.elastic.places if body.elastic is not None else ()
        ends |= {
            node: at
            for node, at in zip(body.nodes, places, strict=False)
            if held[node] == 1
        }
    for joint in mechanism.joints:
        free = joint.type.free
        if joint.name in robot.copied or 3 not in free or 1 in free:
            continue  # a joint in a plane has no place across it
        for node in (joint.first, joint.second):
            away = ends.get(node, joint.at) - joint.at
            if joint.type.driven is not None and joint.axis is not None:
                axis = joint.axis / np.linalg.norm(joint.axis)
                away = away - (away @ axis) * axis
            distance = float(np.linalg.norm(away))
            if distance > _APART:
                yield f"joint {joint.name} is {mm(distance)} from {node}: a rigid arm is assumed"


def _of_masses(robot: RobotFile, masses: Mapping[str, float | None]) -> Iterator[str]:
    if robot.gravity is None:
        yield "no [gravity] in the file: weight is ignored"
        return
    without = [name for name, mass in masses.items() if mass == 0.0]
    if without:
        most = (
            without if len(without) <= 4 else [*without[:3], f"{len(without) - 3} more"]
        )
        yield f"no mass, hence no weight: {list_names(most)}"


def inspection_json(inspection: Inspection) -> dict[str, Any]:
    """Return an inspection as JSON data: m, rad, kg, base axes {O}."""
    m = inspection.mobility
    mechanism = inspection.mechanism
    masses = inspection.masses
    ends = ("low", "high", "at_low", "at_high")
    return {
        "robot": inspection.robot.name,
        "file": inspection.robot.path,
        "usable": not inspection.error,
        "error": inspection.error,
        "remarks": inspection.remarks,
        "doubts": [asdict(doubt) for doubt in inspection.doubts],
        "bodies": [
            {"name": name, "part": getattr(body, "part", None), "mass": masses[name]}
            for name, body in inspection.robot.bodies.items()
        ],
        "joints": [
            {
                "name": j.name,
                "type": j.kind,
                "between": [j.first, j.second],
                "at": j.at,
                "axis": j.axis,
                "driven": j.drive is not None,
            }
            for j in mechanism.joints
        ],
        "drives": [
            {
                "name": j.name,
                "stiffness": j.drive.stiffness,
                "unit": "rad" if j.turns else "m",
                "range": [j.drive.low, j.drive.high],
            }
            for j in mechanism.drives
            if j.drive is not None
        ],
        "degrees_of_freedom": {
            "mechanism": m.dof,
            "tool": len(m.tool),
            "tool_motions": [str(motion) for motion in m.tool],
            "coordinates": dict(m.coordinates),
            "joint_freedoms": m.freedoms,
            "loops": len(m.loops),
            "formula": m.count,
        },
        "redundant_constraints": [
            {
                "count": r.count,
                "loops": r.loops,
                "bodies": r.bodies,
                "joints": r.joints,
                "directions": [str(direction) for direction in r.directions],
            }
            for r in m.redundancies
        ],
        "idle_motions": [
            {"count": i.count, "bodies": i.bodies, "joints": i.joints, "motion": str(i)}
            for i in m.idle
        ],
        "undriven_motions": [str(motion) for motion in m.loose],
        "redundant_drives": {"count": m.redundant_drives, "names": m.dependent_drives},
        "conditioning": m.conditioning,
        "constraint_margin": m.constraint_margin,
        "residual": inspection.residual,
        "mass": None
        if None in masses.values()
        else sum(mass or 0.0 for mass in masses.values()),
        "parts": {
            p.name: {k: v for k, v in asdict(p).items() if k != "name"}
            for p in inspection.parts
        },
        "reach": {
            w.coordinate: {key: getattr(w, key) for key in ends}
            for w in inspection.reach
        },
        "poses": {
            p.name: {
                "pose": p.tool,
                "reached": p.is_reached,
                "reason": p.reason,
                "drives": p.drives,
                "conditioning": p.conditioning,
            }
            for p in inspection.poses
        },
        "map_reached": inspection.mapped,
    }
