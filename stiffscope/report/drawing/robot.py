"""Any robot at a pose: parts as their solids, rigid bodies as hulls of what they connect, joints by type.

Everything is given at home in base axes; a picture says how each node has moved since, ``x = R x_home + p``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.fea.experiment import load_experiment
from stiffscope.report.drawing.camera import View, new_plotter, shot, view_of
from stiffscope.report.drawing.sheet import write_title
from stiffscope.report.drawing.surfaces import surface

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping
    from pathlib import Path

    import pyvista as pv
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Moves = Mapping[str, tuple[Floats, Floats]]

PARTS = ("#3b7dbf", "#d9822b", "#5b9a68", "#8e6bb0", "#b5666a", "#4c9c9c")
RIGID, GROUND, PASSIVE, DRIVEN, SCREW = "#5f6b78", "#b4bcc5", "#2c343c", "#c0392b", "#c3c8ce"
SHARES = "YlOrRd"
TOWARDS = (0.42, -1.0, 0.5)  # the camera, in axes whose z points up


@dataclass(frozen=True)
class Solid:
    """A surface at home that belongs to an element, and the nodes it moves with; an elastic body bends between two."""

    element: str
    surface: pv.PolyData
    colour: str
    nodes: tuple[str, ...]
    axes: Floats | None = None  # part axes as columns, of an elastic body
    base: Floats | None = None
    length: float = 0.0

    def moved(self, moves: Moves) -> pv.PolyData:
        """The surface where its nodes have moved to."""
        home = np.asarray(self.surface.points, float)
        ends = [home @ np.asarray(r).T + p for r, p in (moves[node] for node in self.nodes)]
        out = self.surface.copy()
        out.points = ends[0] if len(ends) == 1 else self._bent(home, ends, moves)
        return out

    def _bent(self, home: Floats, ends: list[Floats], moves: Moves) -> Floats:
        """Between the rigid displacements of both ends: Hermite's cubic, as a beam bends; linear along its axis."""
        axes, base = np.asarray(self.axes), np.asarray(self.base)
        s = np.clip((home - base) @ axes[:, 0] / self.length, 0.0, 1.0)[:, None]
        share = s * s * (3.0 - 2.0 * s)
        out = (1.0 - share) * ends[0] + share * ends[1]
        turn = np.asarray(moves[self.nodes[0]][0])
        along = turn @ axes[:, 0]
        stretch = (ends[1] - ends[0]) @ along
        return out + ((s[:, 0] - share[:, 0]) * stretch)[:, None] * along


def robot(
    folder: Path,
    pictures: list[dict[str, Any]],
    bodies: list[dict[str, Any]],
    joints: list[dict[str, Any]],
    tool: dict[str, Any],
    up: list[float],
    shares: dict[str, float] | None = None,
    scale: str = "share",
) -> None:
    """The robot, one picture for each {file, title, moves}; ``moves``: node to [R (3, 3), p (3,)] since home.

    Parameters
    ----------
    folder
        Where the files go.
    pictures
        As above.
    bodies
        {name, nodes, part, experiment, shape, mesh, axes, base, length, centre}; a rigid body has one node. ``shape``:
        "rod" {radius} or "plate" {width, thickness}, for a part without an experiment; ``mesh``: an STL file in m.
    joints
        {name, kind, first, second, at, axis, axis2, driven, low, high}, m and rad.
    tool
        {node, at}.
    up
        (3,), against gravity.
    shares
        Colours of elements, by a share between 0 and 1; ``scale`` says of what.

    """
    reach = _extent(bodies, joints, tool)
    solids = [
        *_elastic(bodies, reach),
        *_rigid(bodies, joints, tool, reach),
        *_feet(joints, np.array(up, float), np.array(tool["at"], float), reach),
        *_joints(bodies, joints, reach),
    ]
    for picture in pictures:
        moves = {name: (np.array(r, float), np.array(p, float)) for name, (r, p) in picture["moves"].items()}
        moves["ground"] = (np.eye(3), np.zeros(3))
        rotation, position = moves[tool["node"]]
        point = rotation @ np.array(tool["at"], float) + position
        image, view = _scene([(s, s.moved(moves)) for s in solids], point, np.array(up, float), shares, reach)
        _frame(folder / picture["file"], image, view, picture["title"], None if shares is None else scale)


def _extent(bodies: list[dict[str, Any]], joints: list[dict[str, Any]], tool: dict[str, Any]) -> float:
    """Size of the robot at home in m."""
    points = [j["at"] for j in joints] + [tool["at"]]
    points += [b["base"] for b in bodies if b.get("base") is not None]
    return max(float(np.ptp(np.array(points, float), axis=0).max()), 1e-3)


def _elastic(bodies: list[dict[str, Any]], reach: float) -> Iterable[Solid]:
    """Parts as their solids: the experiment's surface, else the shape's."""
    parts = list(dict.fromkeys(b["part"] for b in bodies if len(b["nodes"]) == 2))
    for body in bodies:
        if len(body["nodes"]) == 2:
            axes, base = np.array(body["axes"], float), np.array(body["base"], float)
            skin = _skin(body, reach)
            skin.points = np.asarray(skin.points, float) @ axes.T + base
            colour = PARTS[parts.index(body["part"]) % len(PARTS)]
            yield Solid(body["name"], skin, colour, tuple(body["nodes"]), axes, base, float(body["length"]))


def _skin(body: dict[str, Any], reach: float) -> pv.PolyData:
    """Surface of a part in its own axes, clamped at x = 0, in m."""
    if body.get("experiment"):
        mesh = load_experiment(body["experiment"]).mesh
        return _triangles(surface(mesh, mesh.points).clean())
    shape, length = body.get("shape") or {}, float(body["length"])
    if "width" in shape:
        return _subdivided_box(length, float(shape["width"]), float(shape["thickness"]))
    return _rod(np.zeros(3), np.array([length, 0, 0]), float(shape.get("radius", min(0.04 * length, 0.02 * reach))))


def _rigid(
    bodies: list[dict[str, Any]], joints: list[dict[str, Any]], tool: dict[str, Any], reach: float
) -> Iterable[Solid]:
    """Rigid bodies as hulls of small balls where their joints are, or as the user's own surface."""
    for body in bodies:
        if len(body["nodes"]) == 2:
            continue
        name = body["name"]
        points = [j["at"] for j in joints if name in (j["first"], j["second"])]
        points += [tool["at"]] if tool["node"] == name else []
        if body.get("mesh"):
            import pyvista as pv

            yield Solid(name, _triangles(pv.read(body["mesh"])), RIGID, (name,))
        elif points:
            yield Solid(name, _hull(np.array(points, float), 0.016 * reach), RIGID, (name,))


def _feet(joints: list[dict[str, Any]], up: Floats, tool: Floats, reach: float) -> Iterable[Solid]:
    """What stands on the ground: a foot at each of its joints, on the side away from the tool."""
    ring = np.array([[np.cos(a), np.sin(a), 0.0] for a in np.linspace(0, 2 * np.pi, 25)[:-1]])
    for joint in joints:
        if "ground" not in (joint["first"], joint["second"]):
            continue
        at = np.array(joint["at"], float)
        away = up if (at - tool) @ up > 0 else -up
        ends = [at]
        if joint["kind"] in {"prismatic", "cylindrical"}:
            ends = [at + way * np.array(joint["axis"], float) for way in _range(joint, reach)]
        for end in ends:
            foot = end + 0.07 * reach * away + 0.045 * reach * ring @ _upright(up).T
            yield Solid("ground", _hull(np.vstack([end, foot]), 0.012 * reach), GROUND, ("ground",))


def _joints(bodies: list[dict[str, Any]], joints: list[dict[str, Any]], reach: float) -> Iterable[Solid]:
    """Joints by type, in the colour of their being driven or passive; they stand out from the rods that they join."""
    rods = {node: float((b.get("shape") or {}).get("radius", 0.0)) for b in bodies for node in b["nodes"]}
    for joint in joints:
        ends = [radius for node in (joint["first"], joint["second"]) if (radius := rods.get(node, 0.0))]
        smaller = joint["kind"] in {"spherical", "universal", "prismatic", "cylindrical"}
        r = max(0.02 * reach, 1.2 * (min if smaller else max)(ends, default=0.0))
        if joint["kind"] == "fixed":
            continue
        at = np.array(joint["at"], float)
        colour = DRIVEN if joint["driven"] else PASSIVE
        axis = np.array(joint["axis"] if joint.get("axis") is not None else [0, 0, 1], float)
        match joint["kind"]:
            case "spherical":
                yield Solid(joint["name"], _ball(at, 1.1 * r), colour, (joint["first"],))
            case "universal":
                second = np.array(joint["axis2"], float)
                yield Solid(
                    joint["name"], _rod(at - 1.5 * r * axis, at + 1.5 * r * axis, 0.6 * r), colour, (joint["first"],)
                )
                yield Solid(
                    joint["name"],
                    _rod(at - 1.5 * r * second, at + 1.5 * r * second, 0.6 * r),
                    colour,
                    (joint["second"],),
                )
            case "prismatic" | "cylindrical":
                yield from _slide(joint, at, axis, r, reach, colour)
            case _:
                yield Solid(joint["name"], _rod(at - 1.4 * r * axis, at + 1.4 * r * axis, r), colour, (joint["first"],))


def _slide(joint: dict[str, Any], at: Floats, axis: Floats, r: float, reach: float, colour: str) -> Iterable[Solid]:
    """A rail along the range of the slide, on the first body, and a carriage on the second."""
    low, high = _range(joint, reach)
    rail = _rod(at + (low - 2 * r) * axis, at + (high + 2 * r) * axis, 0.35 * r)
    yield Solid(joint["name"], rail, SCREW, (joint["first"],))
    yield Solid(joint["name"], _rod(at - 1.6 * r * axis, at + 1.6 * r * axis, 1.1 * r), colour, (joint["second"],))


def _range(joint: dict[str, Any], reach: float) -> tuple[float, float]:
    """Range of a slide as it is drawn: its drive's, or some of the robot's size."""
    low, high = (
        float(np.clip(default if joint.get(key) is None else joint[key], -reach, reach))
        for key, default in (("low", -0.2 * reach), ("high", 0.2 * reach))
    )
    return low, high


def _scene(
    solids: list[tuple[Solid, pv.PolyData]], point: Floats, up: Floats, shares: dict[str, float] | None, reach: float
) -> tuple[Floats, View]:
    seen = [*(shape.points for _, shape in solids), np.add([point], 0.12 * reach * np.eye(3))]
    view = view_of(np.vstack(seen), towards=tuple(_upright(up) @ TOWARDS), width=1500, up=tuple(up))
    plotter = new_plotter(view)
    for solid, shape in solids:
        plotter.add_mesh(
            shape, color=solid.colour if shares is None else _share_colour(shares.get(solid.element)),
            smooth_shading=True, split_sharp_edges=True, feature_angle=35, ambient=0.42, diffuse=0.6, specular=0.15,
        )  # fmt: skip
        edges = shape.extract_feature_edges(35, boundary_edges=False, manifold_edges=False, non_manifold_edges=False)
        if edges.n_points:
            edges.points += view.lift / 2
            plotter.add_mesh(edges, color="#20252b", line_width=1.2)
    _axes(plotter, point, view, reach)
    return shot(plotter), view


def _upright(up: Floats) -> Floats:
    """Axes (3, 3) as columns whose z is ``up``: where z is vertical the base's, or half a turn from them."""
    if abs(up[2]) > 0.99:
        return np.diag([1.0, 1.0, 1.0] if up[2] > 0 else [1.0, -1.0, -1.0])
    side = np.cross(up, [0.0, 0.0, 1.0])
    side /= np.linalg.norm(side)
    return np.column_stack([side, np.cross(up, side), up])


def _frame(target: Path, image: Floats, view: View, title: str, scale: str | None) -> None:
    from matplotlib.figure import Figure

    width, height = view.size
    figure = Figure(figsize=(width / 100, (height + 60) / 100), facecolor="white")
    axes = figure.add_axes((0, 0, 1, height / (height + 60)))
    axes.imshow(image)
    axes.set_axis_off()
    write_title(figure, title)
    key = "axes at M: x red, y green, z blue" + ("" if scale else "; joints: red driven, black passive")
    figure.text(12 / width, 14 / (height + 60), key, fontsize=10, color="#5a6570")
    if scale:
        _share_bar(figure, scale)
    figure.savefig(target, dpi=100)


def _share_bar(figure: Figure, scale: str) -> None:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    axes = figure.add_axes((0.70, 0.075, 0.27, 0.022))
    bar = figure.colorbar(ScalarMappable(Normalize(0, 100), SHARES), cax=axes, orientation="horizontal")
    bar.ax.tick_params(labelsize=9, length=2, pad=2)
    bar.ax.set_title(f"{scale}, %", fontsize=10, color="#5a6570")


def _subdivided_box(length: float, width: float, thickness: float) -> pv.PolyData:
    """A plate with enough points along x to bend."""
    import pyvista as pv

    sides = (0.0, length, -width / 2, width / 2, -thickness / 2, thickness / 2)
    return _triangles(pv.Box(sides, level=8))


def _rod(start: Floats, end: Floats, radius: float) -> pv.PolyData:
    """A bar along stations, so that it can bend."""
    import pyvista as pv

    stations = np.linspace(start, end, 13)
    return _triangles(pv.Spline(stations, 13).tube(radius=radius, n_sides=32, capping=True))


def _ball(at: Floats, radius: float) -> pv.PolyData:
    import pyvista as pv

    return _triangles(pv.Sphere(radius=radius, center=at, theta_resolution=24, phi_resolution=16))


def _hull(points: Floats, radius: float) -> pv.PolyData:
    """Convex hull of balls about points."""
    import pyvista as pv
    from scipy.spatial import ConvexHull

    ball = np.asarray(pv.Icosphere(radius=radius, nsub=1).points, float)
    cloud = (points[:, None] + ball[None]).reshape(-1, 3)
    hull = ConvexHull(cloud)
    faces = hull.simplices.copy()
    corners = cloud[faces]
    outward = np.einsum(
        "ij,ij->i", np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), hull.equations[:, :3]
    )
    faces[outward < 0] = faces[outward < 0][:, ::-1]
    return pv.PolyData.from_regular_faces(cloud, faces).clean()


def _triangles(shape: Any) -> pv.PolyData:
    """A closed surface as triangles, which is what filters promise to nobody's type checker."""
    return shape.triangulate()


def _axes(plotter: pv.Plotter, point: Floats, view: View, reach: float) -> None:
    import pyvista as pv

    for direction, colour in zip(np.eye(3), ("#d62728", "#2ca02c", "#1f4fd6"), strict=True):
        start = point + 0.5 * view.half_height * view.direction
        arrow = pv.Arrow(start=start, direction=direction, scale=0.11 * reach, shaft_radius=0.03, tip_radius=0.09)
        plotter.add_mesh(arrow, color=colour, ambient=0.5)


def _share_colour(share: float | None) -> str:
    from matplotlib import colormaps
    from matplotlib.colors import to_hex

    return "#d9dde2" if share is None else to_hex(colormaps[SHARES](float(np.clip(share, 0, 1))))
