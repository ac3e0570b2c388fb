"""Solids of a robot at home (parts, rigid bodies, joints, feet) and their motion with the nodes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pyvista as pv
from scipy.spatial import ConvexHull, Delaunay

from stiffscope.fea.experiment import load_experiment
from stiffscope.report.drawing.surfaces import bulge, surface
from stiffscope.vjm.model.joints import JOINT_TYPES

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Moves = Mapping[str, tuple[Floats, Floats]]
    Sizes = dict[str, tuple[float, float]]  # radius and half length of each joint, m
    Tables = list[dict[str, Any]]

PARTS = ("#3b7dbf", "#d9822b", "#5b9a68", "#8e6bb0", "#b5666a", "#4c9c9c")
BODIES = ("#8f9c70", "#9c7d92", "#6b97a3", "#a9926a", "#8288ad", "#a37a6f")
RIGID = "#76828f"
GROUND = "#b4bcc5"
PASSIVE = "#2c343c"
DRIVEN = "#c0392b"
RAIL = "#c3c8ce"
DOUBTED = "#f2a900"
GLASS = "59"  # hexadecimal opacity of transparent solids
_SMALLEST = 0.018  # smallest radius of a joint over the robot's size
_PLATE = 0.014  # half the thickness of a rigid body over the robot's size
_FLAT = 1e-3  # height of an arc drawn as its chord, over the robot's size
_STATIONS = 13  # along a bending bar


@dataclass(frozen=True)
class Solid:
    """Surface of an element at home, moving with its nodes; elastic bodies bend between nodes.

    With a ``length`` it is a bar along its part's x axis; otherwise ``places`` (n, 3) are the home
    positions of its n nodes. ``glass``: whether it is transparent.
    """

    element: str
    surface: pv.PolyData
    colour: str
    nodes: tuple[str, ...]
    axes: Floats | None = None  # part axes as columns, of an elastic body
    base: Floats | None = None
    length: float = 0.0
    places: Floats | None = None
    glass: bool = False

    def move(self, moves: Moves) -> pv.PolyData:
        """Return the surface displaced with its nodes."""
        home = np.asarray(self.surface.points, float)
        ends = [
            home @ np.asarray(r).T + p for r, p in (moves[node] for node in self.nodes)
        ]
        out = self.surface.copy()
        if len(ends) == 1:
            out.points = ends[0]
        elif self.length:
            out.points = self._bent(home, ends, moves)
        else:
            out.points = self._blend_ends(home, ends)
        return out

    def _blend_ends(self, home: Floats, ends: list[Floats]) -> Floats:
        """Interpolate rigid displacements of all ends with inverse-distance weights (Shepard)."""
        away = np.linalg.norm(home[None] - np.asarray(self.places)[:, None], axis=2)
        share = (away.max() * 1e-3 + away) ** -3.0
        return np.einsum("kn,kni->ni", share / share.sum(axis=0), np.array(ends))

    def _bent(self, home: Floats, ends: list[Floats], moves: Moves) -> Floats:
        """Interpolate both ends' displacements with a cubic Hermite curve, axially linearly."""
        axes = np.asarray(self.axes)
        base = np.asarray(self.base)
        s = np.clip((home - base) @ axes[:, 0] / self.length, 0.0, 1.0)[:, None]
        share = s * s * (3.0 - 2.0 * s)
        out = (1.0 - share) * ends[0] + share * ends[1]
        along = np.asarray(moves[self.nodes[0]][0]) @ axes[:, 0]
        stretch = (ends[1] - ends[0]) @ along
        return out + ((s[:, 0] - share[:, 0]) * stretch)[:, None] * along


def part_colours(bodies: Tables) -> dict[str, str]:
    """Return the colour of each part in the order of the bodies."""
    parts = dict.fromkeys(b["part"] for b in bodies if len(b["nodes"]) > 1)
    return {part: PARTS[k % len(PARTS)] for k, part in enumerate(parts)}


def rigid_colours(bodies: Tables) -> dict[str, str]:
    """Return the colour of each rigid body, if there are several."""
    rigid = [b["name"] for b in bodies if len(b["nodes"]) == 1]
    return (
        {name: BODIES[k % len(BODIES)] for k, name in enumerate(rigid)}
        if len(rigid) > 1
        else {}
    )


def extent(bodies: Tables, joints: Tables, tool: dict[str, Any]) -> float:
    """Return the size of the robot at home, m."""
    points = [j["at"] for j in joints] + [tool["at"]]
    points += [b["base"] for b in bodies if b.get("base") is not None]
    return max(float(np.ptp(np.array(points, float), axis=0).max()), 1e-3)


def solids_of(
    bodies: Tables, joints: Tables, tool: dict[str, Any], up: Floats
) -> list[Solid]:
    """Return all solids at home; for the arguments see `stiffscope.report.drawing.robot.robot`."""
    bodies = [_place_ends(body, joints) for body in bodies]
    reach = extent(bodies, joints, tool)
    sizes = _sizes(bodies, joints, reach)
    return [
        *_make_elastic(bodies, reach),
        *_brackets(bodies, joints, tool, sizes, reach),
        *_make_rigid(bodies, joints, tool, reach),
        *_feet(joints, up, np.array(tool["at"], float), sizes, reach),
        *_joints(joints, sizes, reach),
    ]


def upright(up: Floats) -> Floats:
    """Return axes (3, 3) as columns with z along ``up``; the base's, maybe turned, if vertical."""
    if abs(up[2]) > 0.99:
        return np.diag([1.0, 1.0, 1.0] if up[2] > 0 else [1.0, -1.0, -1.0])
    side = np.cross(up, [0.0, 0.0, 1.0])
    side /= np.linalg.norm(side)
    return np.column_stack([side, np.cross(up, side), up])


def _make_elastic(bodies: Tables, reach: float) -> Iterable[Solid]:
    """Yield the solids of the parts: surface of the experiment, or else of the shape."""
    colours = part_colours(bodies)
    for body in bodies:
        if len(body["nodes"]) > 1:
            axes = np.array(body["axes"], float)
            base = np.array(body["base"], float)
            skin = _skin(body, reach)
            skin.points = np.asarray(skin.points, float) @ axes.T + base
            name = body["name"]
            colour = colours[body["part"]]
            nodes = tuple(body["nodes"])
            length = float(body["length"])
            places = np.array(body["places"], float)
            yield Solid(
                element=name,
                surface=skin,
                colour=colour,
                nodes=nodes,
                axes=axes,
                base=base,
                length=length,
                places=places,
                glass="points" in body,
            )


def _place_ends(body: dict[str, Any], joints: Tables) -> dict[str, Any]:
    """Move the ends of a body with interfaces to its joints unless an experiment places them."""
    if len(body["nodes"]) < 2 or body["length"] or body.get("experiment"):
        return body
    at = dict(zip(body["nodes"], body["places"], strict=True))
    at |= {joint[end]: joint["at"] for joint in joints for end in ("first", "second")}
    return body | {"places": np.array([at[node] for node in body["nodes"]], float)}


def _skin(body: dict[str, Any], reach: float) -> pv.PolyData:
    """Return the surface of a part in its own axes, relative to its first end, m."""
    shape = body.get("shape") or {}
    length = float(body["length"])
    base = np.array(body["base"], float)
    axes = np.array(body["axes"], float)
    if body.get("experiment"):
        tested = load_experiment(body["experiment"])
        curved = bulge(tested.mesh) > _FLAT * reach
        start = np.zeros(3) if length else tested.places[0]
        return _triangles(
            surface(tested.mesh, tested.mesh.points - start, split=curved).clean()
        )
    if "points" in body:
        corners = (
            np.array(body["points"], float) + (np.array(body["origin"]) - base) @ axes
        )
        return pv.PolyData.from_regular_faces(corners, np.array(body["triangles"]))
    if not length:
        return _star((np.array(body["places"], float) - base) @ axes, reach)
    if "outline" in shape:
        return _extrude(shape["outline"], length)
    if "thickness" in shape:
        wide = float(shape["width"]) / 2
        thick = float(shape["thickness"]) / 2
        box = pv.Box(
            (0.0, length, -wide, wide, -thick, thick), level=8
        )  # fine enough to bend
        return _triangles(box)
    return _rod(np.zeros(3), np.array([length, 0, 0]), _radius(body, reach), _STATIONS)


def _extrude(outline: list[list[tuple[float, float]]], length: float) -> pv.PolyData:
    """Return a beam along x whose section is bounded by loops of corners (y, z)."""
    points: list[tuple[float, float, float]] = []
    lines: list[int] = []
    for loop in outline:
        lines += [len(loop) + 1, *range(len(points), len(points) + len(loop) + 1)]
        points += [(0.0, y, z) for y, z in (*loop, loop[0])]
    border = pv.PolyData(np.array(points), lines=lines).clean().triangulate_contours()
    return _triangles(border.extrude((length, 0.0, 0.0), capping=True).clean())


def _radius(body: dict[str, Any], reach: float) -> float:
    """Return the radius of an elastic body drawn as a rod, m; arbitrary for a matrix part."""
    known = (body.get("shape") or {}).get("radius")
    return float(known) if known else min(0.03 * float(body["length"]), 0.014 * reach)


def _brackets(
    bodies: Tables, joints: Tables, tool: dict[str, Any], sizes: Sizes, reach: float
) -> Iterable[Solid]:
    """Yield rigid rods between an elastic body's end and a distant joint or the tool."""
    ends: dict[str, Floats] = {}
    for body in bodies:
        if len(body["nodes"]) > 1:
            ends |= zip(body["nodes"], np.array(body["places"], float), strict=True)
    pairs = ((joint, end) for joint in joints for end in ("first", "second"))
    held = [(j[end], j["at"], 0.5 * sizes[j["name"]][0]) for j, end in pairs]
    held.append((tool["node"], tool["at"], 0.5 * _SMALLEST * reach))
    for node, at, radius in held:
        if node in ends and np.linalg.norm(ends[node] - at) > 0.02 * reach:
            yield Solid(
                node, _rod(ends[node], np.array(at, float), radius), RIGID, (node,)
            )


def _make_rigid(
    bodies: Tables, joints: Tables, tool: dict[str, Any], reach: float
) -> Iterable[Solid]:
    """Yield rigid bodies as hulls of balls at their joints or as user surfaces, and a tool post.

    A star replaces a hull that would hide other joints or the tool.
    """
    colours = rigid_colours(bodies)
    for body in bodies:
        if len(body["nodes"]) > 1:
            continue
        name = body["name"]
        colour = colours.get(name, RIGID)
        points = [
            np.array(j["at"], float)
            for j in joints
            if name in (j["first"], j["second"])
        ]
        others = [
            np.array(j["at"], float)
            for j in joints
            if name not in (j["first"], j["second"])
        ]
        others += [np.array(tool["at"], float)] if tool["node"] != name else []
        if tool["node"] == name:
            at = np.array(tool["at"], float)
            middle = np.mean(points, axis=0)
            if len(points) < 3:
                points.append(at)
            elif np.linalg.norm(at - middle) > 2 * _PLATE * reach:
                yield Solid(
                    name, _rod(middle, at, 0.7 * _PLATE * reach), colour, (name,)
                )
        if body.get("mesh"):
            shape = _triangles(pv.read(body["mesh"]))
        else:
            ends = np.array(points)
            hides = _hides(ends, np.array(others).reshape(-1, 3), _PLATE * reach)
            shape = _star(ends, reach) if hides else _hull(ends, _PLATE * reach)
        yield Solid(name, shape, colour, (name,))


def _feet(
    joints: Tables, up: Floats, tool: Floats, sizes: Sizes, reach: float
) -> Iterable[Solid]:
    """Yield a foot at each joint to the ground, on the side away from the tool."""
    ring = np.array(
        [[np.cos(a), np.sin(a), 0.0] for a in np.linspace(0, 2 * np.pi, 25)[:-1]]
    )
    for joint in joints:
        if "ground" not in (joint["first"], joint["second"]):
            continue
        at = np.array(joint["at"], float)
        (r, half) = sizes[joint["name"]]
        away = up if (at - tool) @ up > 0 else -up
        ends = [at]
        drop = half
        if _symbol(joint) == "rail":
            axis = np.array(joint["axis"], float)
            ends = [at + way * axis for way in _range(joint, reach)]
            drop = r
        for end in ends:
            foot = (
                end
                + (drop + 0.04 * reach) * away
                + max(0.035 * reach, r) * ring @ upright(up).T
            )
            yield Solid(
                "ground",
                _hull(np.vstack([end, foot]), 0.01 * reach),
                GROUND,
                ("ground",),
            )


def _sizes(bodies: Tables, joints: Tables, reach: float) -> Sizes:
    """Return radius and half length of each joint, larger than its rods and coincident joints."""
    rods: dict[str, float] = {}
    for body in bodies:
        if (
            body.get("length")
            and not {"width", "outline"} & (body.get("shape") or {}).keys()
        ):
            rods |= dict.fromkeys(body["nodes"], _radius(body, reach))
    out: Sizes = {}

    def rods_of(joint: dict[str, Any]) -> list[float]:
        return [
            rods[node] for node in (joint["first"], joint["second"]) if node in rods
        ]

    for joint in sorted(
        joints, key=lambda joint: max(rods_of(joint), default=0.0), reverse=True
    ):
        ends = rods_of(joint) or [0.0]
        match _symbol(joint):
            case "ball" | "rail":
                r = 1.25 * min(ends)
                long = 1.6
            case "cross":
                r = 0.6 * max(ends)
                long = 1.9
            case _:
                r = 1.15 * max(ends)
                long = 1.2 if max(ends) else 1.5
        r = max(_SMALLEST * reach, r)
        half = long * r
        known = [j for j in joints if j["name"] in out]
        here = [
            j for j in known if np.linalg.norm(np.subtract(j["at"], joint["at"])) < r
        ]
        if here and joint["kind"] != "fixed":
            widest = max(out[j["name"]][0] for j in here)
            r = 0.75 * widest
            half = max(half, 1.35 * widest)
        out[joint["name"]] = r, half
    return out


def _symbol(joint: dict[str, Any]) -> str:
    """Return the symbol of a joint's type; none for a possible further joint."""
    joint_type = JOINT_TYPES.get(joint["kind"])
    return joint_type.symbol if joint_type else ""


def _joints(joints: Tables, sizes: Sizes, reach: float) -> Iterable[Solid]:
    """Yield the solids of the joints by type, in the colour for driven, passive or doubtful."""
    for joint in joints:
        at = np.array(joint["at"], float)
        (r, half) = sizes[joint["name"]]
        colour = (
            DOUBTED if joint.get("doubted") else DRIVEN if joint["driven"] else PASSIVE
        )
        axis = np.array(
            joint["axis"] if joint.get("axis") is not None else [0, 0, 1], float
        )
        first = joint["first"]
        second = joint["second"]
        match _symbol(joint):
            case "":
                cube = pv.Cube(
                    center=at, x_length=2 * r, y_length=2 * r, z_length=2 * r
                )
                shapes = (
                    [(_triangles(cube), colour, first)] if joint.get("doubted") else []
                )
            case "ball":
                shapes = [(_ball(at, 1.1 * r), colour, first)]
            case "cross":
                across = np.array(joint["axis2"], float)
                shapes = [(_bar(at, half * axis, 0.6 * r), colour, first)]
                shapes += [(_bar(at, half * across, 0.6 * r), colour, second)]
            case "rail":
                low, high = _range(joint, reach)
                rail = _rod(
                    at + (low - 2 * r) * axis, at + (high + 2 * r) * axis, 0.35 * r
                )
                shapes = [
                    (rail, RAIL, first),
                    (_bar(at, half * axis, 1.1 * r), colour, second),
                ]
            case "disc":
                shapes = [(_bar(at, 0.3 * r * axis, 2.0 * r), colour, first)]
            case _:
                shapes = [(_bar(at, half * axis, r), colour, first)]
        for shape, shade, node in shapes:
            yield Solid(joint["name"], shape, shade, (node,))


def _range(joint: dict[str, Any], reach: float) -> tuple[float, float]:
    """Return the drawn range of a slide: its drive's, or a share of the robot's size."""
    low = joint.get("low")
    high = joint.get("high")
    ends = -0.2 * reach if low is None else low, 0.2 * reach if high is None else high
    return float(np.clip(ends[0], -reach, reach)), float(
        np.clip(ends[1], -reach, reach)
    )


def _star(ends: Floats, reach: float) -> pv.PolyData:
    """Return bars from the mean of points (k, 3) to each of them."""
    hub = ends.mean(axis=0)
    apart = [end for end in ends if np.linalg.norm(end - hub) > 1e-3 * reach]
    bars = [_rod(hub, end, 0.01 * reach, _STATIONS) for end in apart]
    return _triangles(pv.merge([_ball(hub, 0.015 * reach), *bars]))


def _rod(start: Floats, end: Floats, radius: float, stations: int = 2) -> pv.PolyData:
    """Return a bar; a bending one needs several stations along it."""
    along = np.linspace(start, end, stations)
    return _triangles(
        pv.Spline(along, stations).tube(radius=radius, n_sides=32, capping=True)
    )


def _bar(middle: Floats, half: Floats, radius: float) -> pv.PolyData:
    return _rod(middle - half, middle + half, radius)


def _ball(at: Floats, radius: float) -> pv.PolyData:
    return _triangles(
        pv.Sphere(radius=radius, center=at, theta_resolution=24, phi_resolution=16)
    )


def _hull(points: Floats, radius: float) -> pv.PolyData:
    """Return the convex hull of balls about points."""
    ball = np.asarray(pv.Icosphere(radius=radius, nsub=2).points, float)
    cloud = (points[:, None] + ball[None]).reshape(-1, 3)
    hull = ConvexHull(cloud)
    faces = hull.simplices.copy()
    one, two, three = cloud[faces.T]
    inward = (
        np.einsum("ij,ij->i", np.cross(two - one, three - one), hull.equations[:, :3])
        < 0
    )
    faces[inward] = faces[inward][:, ::-1]
    return _triangles(pv.PolyData.from_regular_faces(cloud, faces).clean())


def _hides(points: Floats, others: Floats, radius: float) -> bool:
    """Return whether the hull of balls about points (k, 3) contains distant others (m, 3)."""
    away = np.linalg.norm(others[:, None] - points[None], axis=2).min(
        axis=1, initial=np.inf
    )
    ball = np.vstack([np.eye(3), -np.eye(3)]) * radius
    hull = Delaunay((points[:, None] + ball[None]).reshape(-1, 3))
    return bool((hull.find_simplex(others[away > 3 * radius]) >= 0).any())


def _triangles(shape: Any) -> pv.PolyData:
    """Return a closed surface as triangles; the cast helps type checkers."""
    return shape.triangulate()
