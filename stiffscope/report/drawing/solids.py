"""Solids of a robot at home (parts, rigid bodies, joints, feet) and their motion with the nodes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pyvista as pv
from scipy.spatial import ConvexHull, Delaunay

from stiffscope.fea.experiment import load_experiment
from stiffscope.report.drawing.surfaces import bulge, surface

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Moves = Mapping[str, tuple[Floats, Floats]]
    Tables = list[dict[str, Any]]

PARTS = ("#3b7dbf", "#d9822b", "#5b9a68", "#8e6bb0", "#b5666a", "#4c9c9c")
BODIES = ("#8f9c70", "#9c7d92", "#6b97a3", "#a9926a", "#8288ad", "#a37a6f")
RIGID, GROUND, PASSIVE, DRIVEN, RAIL = "#76828f", "#b4bcc5", "#2c343c", "#c0392b", "#c3c8ce"
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
        ends = [home @ np.asarray(r).T + p for r, p in (moves[node] for node in self.nodes)]
        out = self.surface.copy()
        if len(ends) == 1:
            out.points = ends[0]
        else:
            out.points = self._bent(home, ends, moves) if self.length else self._blend_ends(home, ends)
        return out

    def _blend_ends(self, home: Floats, ends: list[Floats]) -> Floats:
        """Interpolate rigid displacements of all ends with inverse-distance weights (Shepard)."""
        away = np.linalg.norm(home[None] - np.asarray(self.places)[:, None], axis=2)
        share = (away.max() * 1e-3 + away) ** -3.0
        return np.einsum("kn,kni->ni", share / share.sum(axis=0), np.array(ends))

    def _bent(self, home: Floats, ends: list[Floats], moves: Moves) -> Floats:
        """Interpolate both ends' displacements with a cubic Hermite curve, axially linearly."""
        axes, base = np.asarray(self.axes), np.asarray(self.base)
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
    return {name: BODIES[k % len(BODIES)] for k, name in enumerate(rigid)} if len(rigid) > 1 else {}


def extent(bodies: Tables, joints: Tables, tool: dict[str, Any]) -> float:
    """Return the size of the robot at home, m."""
    points = [j["at"] for j in joints] + [tool["at"]]
    points += [b["base"] for b in bodies if b.get("base") is not None]
    return max(float(np.ptp(np.array(points, float), axis=0).max()), 1e-3)


def solids_of(bodies: Tables, joints: Tables, tool: dict[str, Any], up: Floats) -> list[Solid]:
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
            axes, base = np.array(body["axes"], float), np.array(body["base"], float)
            skin = _skin(body, reach)
            skin.points = np.asarray(skin.points, float) @ axes.T + base
            colour, length = colours[body["part"]], float(body["length"])
            places = np.array(body["places"], float)
            yield Solid(body["name"], skin, colour, tuple(body["nodes"]), axes, base, length, places, "points" in body)


def _place_ends(body: dict[str, Any], joints: Tables) -> dict[str, Any]:
    """Move the ends of a body with interfaces to its joints unless an experiment places them."""
    if len(body["nodes"]) < 2 or body["length"] or body.get("experiment"):
        return body
    at = {joint[end]: joint["at"] for joint in joints for end in ("first", "second")}
    places = [at.get(node, place) for node, place in zip(body["nodes"], body["places"], strict=True)]
    return body | {"places": np.array(places, float)}


def _skin(body: dict[str, Any], reach: float) -> pv.PolyData:
    """Return the surface of a part in its own axes, relative to its first end, m."""
    shape, length = body.get("shape") or {}, float(body["length"])
    if body.get("experiment"):
        tested = load_experiment(body["experiment"])
        curved = bulge(tested.mesh) > _FLAT * reach
        start = np.zeros(3) if length else tested.places[0]
        return _triangles(surface(tested.mesh, tested.mesh.points - start, split=curved).clean())
    if "points" in body:
        home = (np.array(body["origin"]) - body["base"]) @ np.array(body["axes"], float)
        corners = np.array(body["points"], float) + home
        return pv.PolyData.from_regular_faces(corners, np.array(body["triangles"]))
    if not length:
        return _star((np.array(body["places"], float) - body["base"]) @ np.array(body["axes"], float), reach)
    if "outline" in shape:
        return _extrude(shape["outline"], length)
    if "thickness" in shape:
        wide, thick = float(shape["width"]) / 2, float(shape["thickness"]) / 2
        return _triangles(pv.Box((0.0, length, -wide, wide, -thick, thick), level=8))  # level: it can bend
    return _rod(np.zeros(3), np.array([length, 0, 0]), _radius(body, reach), _STATIONS)


def _extrude(outline: list[list[tuple[float, float]]], length: float) -> pv.PolyData:
    """Return a beam along x whose section is bounded by loops of corners (y, z)."""
    loops = [[*loop, loop[0]] for loop in outline]
    points = np.array([(0.0, y, z) for loop in loops for y, z in loop])
    starts = np.cumsum([0, *map(len, loops)])
    lines = np.concatenate(
        [[len(loop), *range(start, start + len(loop))] for loop, start in zip(loops, starts, strict=False)]
    )
    border = pv.PolyData(points, lines=lines).clean()
    return _triangles(border.triangulate_contours().extrude((length, 0.0, 0.0), capping=True).clean())


def _radius(body: dict[str, Any], reach: float) -> float:
    """Return the radius of an elastic body drawn as a rod, m; arbitrary for a matrix part."""
    known = (body.get("shape") or {}).get("radius")
    return float(known) if known else min(0.03 * float(body["length"]), 0.014 * reach)


def _brackets(
    bodies: Tables, joints: Tables, tool: dict[str, Any], sizes: dict[str, tuple[float, float]], reach: float
) -> Iterable[Solid]:
    """Yield rigid rods between an elastic body's end and a distant joint or the tool."""
    elastic = [body for body in bodies if len(body["nodes"]) > 1]
    ends = {node: np.array(at, float) for b in elastic for node, at in zip(b["nodes"], b["places"], strict=True)}
    held = [(node, j["at"], 0.5 * sizes[j["name"]][0]) for j in joints for node in (j["first"], j["second"])]
    held.append((tool["node"], tool["at"], 0.5 * _SMALLEST * reach))
    for node, at, radius in held:
        if node in ends and np.linalg.norm(ends[node] - at) > 0.02 * reach:
            yield Solid(node, _rod(ends[node], np.array(at, float), radius), RIGID, (node,))


def _make_rigid(bodies: Tables, joints: Tables, tool: dict[str, Any], reach: float) -> Iterable[Solid]:
    """Yield rigid bodies as hulls of balls at their joints or as user surfaces, and a tool post.

    A star replaces a hull that would hide other joints or the tool.
    """
    colours = rigid_colours(bodies)
    for body in bodies:
        if len(body["nodes"]) > 1:
            continue
        name = body["name"]
        colour = colours.get(name, RIGID)
        points = [np.array(j["at"], float) for j in joints if name in (j["first"], j["second"])]
        others = [np.array(j["at"], float) for j in joints if name not in (j["first"], j["second"])]
        others += [np.array(tool["at"], float)] if tool["node"] != name else []
        if tool["node"] == name:
            at, middle = np.array(tool["at"], float), np.mean(points, axis=0)
            if len(points) < 3:
                points.append(at)
            elif np.linalg.norm(at - middle) > 2 * _PLATE * reach:
                yield Solid(name, _rod(middle, at, 0.7 * _PLATE * reach), colour, (name,))
        if body.get("mesh"):
            shape = _triangles(pv.read(body["mesh"]))
        else:
            ends = np.array(points)
            hides = _hides(ends, np.array(others).reshape(-1, 3), _PLATE * reach)
            shape = _star(ends, reach) if hides else _hull(ends, _PLATE * reach)
        yield Solid(name, shape, colour, (name,))


def _feet(
    joints: Tables, up: Floats, tool: Floats, sizes: dict[str, tuple[float, float]], reach: float
) -> Iterable[Solid]:
    """Yield a foot at each joint to the ground, on the side away from the tool."""
    ring = np.array([[np.cos(a), np.sin(a), 0.0] for a in np.linspace(0, 2 * np.pi, 25)[:-1]])
    for joint in joints:
        if "ground" not in (joint["first"], joint["second"]):
            continue
        at, (r, half) = np.array(joint["at"], float), sizes[joint["name"]]
        away = up if (at - tool) @ up > 0 else -up
        ends, drop = [at], half
        if joint["kind"] in {"prismatic", "cylindrical"}:
            axis = np.array(joint["axis"], float)
            ends, drop = [at + way * axis for way in _range(joint, reach)], r
        for end in ends:
            foot = end + (drop + 0.04 * reach) * away + max(0.035 * reach, r) * ring @ upright(up).T
            yield Solid("ground", _hull(np.vstack([end, foot]), 0.01 * reach), GROUND, ("ground",))


def _sizes(bodies: Tables, joints: Tables, reach: float) -> dict[str, tuple[float, float]]:
    """Return radius and half length of each joint, larger than its rods and coincident joints."""
    round_bars = [b for b in bodies if b.get("length") and not {"width", "outline"} & (b.get("shape") or {}).keys()]
    rods = {node: _radius(b, reach) for b in round_bars for node in b["nodes"]}
    out: dict[str, tuple[float, float]] = {}

    def thickness(joint: dict[str, Any]) -> float:
        return max((rods.get(node, 0.0) for node in (joint["first"], joint["second"])), default=0.0)

    for joint in sorted(joints, key=thickness, reverse=True):
        ends = [rods[node] for node in (joint["first"], joint["second"]) if node in rods]
        match joint["kind"]:
            case "spherical" | "prismatic" | "cylindrical":
                r = max(_SMALLEST * reach, 1.25 * min(ends, default=0.0))
                half = 1.6 * r
            case "universal":
                r = max(_SMALLEST * reach, 0.6 * max(ends, default=0.0))
                half = 1.9 * r
            case _:
                r = max(_SMALLEST * reach, 1.15 * max(ends, default=0.0))
                half = 1.2 * r if ends else 1.5 * r
        there = [
            out[j["name"]] for j in joints if j["name"] in out and np.linalg.norm(np.subtract(j["at"], joint["at"])) < r
        ]
        if there and joint["kind"] != "fixed":
            widest = max(radius for radius, _ in there)
            r, half = 0.75 * widest, max(half, 1.35 * widest)
        out[joint["name"]] = r, half
    return out


def _joints(joints: Tables, sizes: dict[str, tuple[float, float]], reach: float) -> Iterable[Solid]:
    """Yield the solids of the joints by type, in the colour for driven, passive or doubtful."""
    for joint in joints:
        name, at, (r, half) = joint["name"], np.array(joint["at"], float), sizes[joint["name"]]
        colour = DOUBTED if joint.get("doubted") else DRIVEN if joint["driven"] else PASSIVE
        axis = np.array(joint["axis"] if joint.get("axis") is not None else [0, 0, 1], float)
        match joint["kind"]:
            case "fixed":
                if joint.get("doubted"):
                    yield Solid(name, _cube(at, r), colour, (joint["first"],))
            case "doubt":
                yield Solid(name, _cube(at, r), colour, (joint["first"],))
            case "spherical":
                yield Solid(name, _ball(at, 1.1 * r), colour, (joint["first"],))
            case "universal":
                second = np.array(joint["axis2"], float)
                yield Solid(name, _rod(at - half * axis, at + half * axis, 0.6 * r), colour, (joint["first"],))
                yield Solid(name, _rod(at - half * second, at + half * second, 0.6 * r), colour, (joint["second"],))
            case "prismatic" | "cylindrical":
                low, high = _range(joint, reach)
                rail = _rod(at + (low - 2 * r) * axis, at + (high + 2 * r) * axis, 0.35 * r)
                yield Solid(name, rail, RAIL, (joint["first"],))
                yield Solid(name, _rod(at - half * axis, at + half * axis, 1.1 * r), colour, (joint["second"],))
            case "planar":
                yield Solid(name, _rod(at - 0.3 * r * axis, at + 0.3 * r * axis, 2.0 * r), colour, (joint["first"],))
            case _:
                yield Solid(name, _rod(at - half * axis, at + half * axis, r), colour, (joint["first"],))


def _range(joint: dict[str, Any], reach: float) -> tuple[float, float]:
    """Return the drawn range of a slide: its drive's, or a share of the robot's size."""
    low, high = (
        float(np.clip(default if joint.get(key) is None else joint[key], -reach, reach))
        for key, default in (("low", -0.2 * reach), ("high", 0.2 * reach))
    )
    return low, high


def _star(ends: Floats, reach: float) -> pv.PolyData:
    """Return bars from the mean of points (k, 3) to each of them."""
    hub = ends.mean(axis=0)
    apart = [end for end in ends if np.linalg.norm(end - hub) > 1e-3 * reach]
    bars = [_rod(hub, end, 0.01 * reach, _STATIONS) for end in apart]
    return _triangles(pv.merge([_ball(hub, 0.015 * reach), *bars]))


def _rod(start: Floats, end: Floats, radius: float, stations: int = 2) -> pv.PolyData:
    """Return a bar; a bending one needs several stations along it."""
    along = np.linspace(start, end, stations)
    return _triangles(pv.Spline(along, stations).tube(radius=radius, n_sides=32, capping=True))


def _cube(at: Floats, radius: float) -> pv.PolyData:
    return _triangles(pv.Cube(center=at, x_length=2 * radius, y_length=2 * radius, z_length=2 * radius))


def _ball(at: Floats, radius: float) -> pv.PolyData:
    return _triangles(pv.Sphere(radius=radius, center=at, theta_resolution=24, phi_resolution=16))


def _hull(points: Floats, radius: float) -> pv.PolyData:
    """Return the convex hull of balls about points."""
    ball = np.asarray(pv.Icosphere(radius=radius, nsub=2).points, float)
    cloud = (points[:, None] + ball[None]).reshape(-1, 3)
    hull = ConvexHull(cloud)
    faces = hull.simplices.copy()
    corners = cloud[faces]
    outward = np.einsum(
        "ij,ij->i", np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), hull.equations[:, :3]
    )
    faces[outward < 0] = faces[outward < 0][:, ::-1]
    return _triangles(pv.PolyData.from_regular_faces(cloud, faces).clean())


def _hides(points: Floats, others: Floats, radius: float) -> bool:
    """Return whether the hull of balls about points (k, 3) contains distant others (m, 3)."""
    away = np.linalg.norm(others[:, None] - points[None], axis=2).min(axis=1, initial=np.inf)
    ball = np.vstack([np.eye(3), -np.eye(3)]) * radius
    hull = Delaunay((points[:, None] + ball[None]).reshape(-1, 3))
    return bool((hull.find_simplex(others[away > 3 * radius]) >= 0).any())


def _triangles(shape: Any) -> pv.PolyData:
    """Return a closed surface as triangles; the cast helps type checkers."""
    return shape.triangulate()
