"""Pictures of any robot at a pose: parts as their solids, rigid bodies as hulls of what they connect, joints by type.

Everything is given at home in base axes; a picture says how each node has moved since, ``x = R x_home + p``.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pyvista as pv
from matplotlib import colormaps
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize, to_hex
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from PIL import Image

from stiffscope.report.drawing.camera import View, new_plotter, shot, view_of
from stiffscope.report.drawing.geometry import pack_solids
from stiffscope.report.drawing.solids import (
    DOUBTED,
    DRIVEN,
    GLASS,
    PASSIVE,
    RIGID,
    extent,
    part_colours,
    rigid_colours,
    solids_of,
    upright,
)
from stiffscope.report.figures import save_figure

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from stiffscope.report.drawing.solids import Moves, Solid

    Floats = NDArray[np.float64]

SHARES = "YlOrRd"
NO_SHARE, BEFORE, EDGES = "#d9dde2", "#9aa4b0", "#20252b"
TOWARDS = (0.42, -1.0, 0.4)  # the camera, in axes whose z points up
WIDTH, ABOVE, BELOW = 1200, 42, 34  # pixels: of the picture, of its title, of its key
MOVING, PERIOD = 720, 1280  # pixels across, and milliseconds of a vibration, of an animation
LONG = 1300  # characters times points of a title that has room
_DARK_DOUBT = "#9a6a00"
AXES = ("#d62728", "#2ca02c", "#1f4fd6")
MARKS = {"sensor": "#8e24aa", "load": "#ef6c00"}
CONTEXT = 1.7  # times what the arrows themselves take up, of a close picture of them
SHADES = 9  # of a scale, for a page's viewer
_NAMED = 5  # parts in the key, at most


def robot(
    folder: Path,
    pictures: list[dict[str, Any]],
    bodies: list[dict[str, Any]],
    joints: list[dict[str, Any]],
    tool: dict[str, Any],
    up: list[float],
    shares: dict[str, float] | None = None,
    scale: str = "share",
    marks: list[dict[str, Any]] | None = None,
    geometry: str | None = None,
) -> None:
    """The robot, one picture for each {file, title, moves, before}; `stiffscope.report.robot_scene` makes all of it.

    Parameters
    ----------
    folder
        Where the files go.
    pictures
        ``moves``: node to [R (3, 3), p (3,)] since home; ``before``, optional: the same, drawn in a light colour;
        ``ghost``, optional: another robot in that colour, {bodies, joints, tool, moves};
        ``close``, optional: true of a picture of the marks alone, with their names and what is near;
        ``kinds``, optional: true of a picture that names the kind of each joint.
    bodies
        {name, nodes, part, experiment, shape, mesh, axes, base, length, places}; a rigid body has one node. ``shape``:
        {radius} of a rod or {width, thickness} of a plate, for a part without an experiment; ``mesh``: a surface in m.
    joints
        {name, kind, first, second, at, axis, axis2, driven, low, high}, m and rad; ``doubted``, optional, and of the
        kind "doubt" where there may be one.
    tool
        {node, at}.
    up
        (3,), against gravity.
    shares
        Colours of elements, by a share between 0 and 1, up to the largest; ``scale`` says of what. A picture may have
        ``shares`` of its own.
    marks
        {kind, name, node, at, direction}: arrows at points (3,) of nodes at home, along directions (3,) in base axes,
        of the kinds "sensor" and "load".
    geometry
        JSON file to write the solids to, for a page's viewer.

    """
    upward, home = np.array(up, float), np.array(tool["at"], float)
    solids = solids_of(bodies, joints, tool, upward)
    reach = extent(bodies, joints, tool)
    if geometry is not None:
        shades = [share_colour(k / (SHADES - 1), 1.0) for k in range(SHADES)]
        colours = {"shades": shades, "no_share": NO_SHARE, "key": key_of(bodies, joints), "tool": tool}
        (folder / geometry).write_text(json.dumps({**pack_solids(solids, upward, reach), **colours}))
    for picture in pictures:
        moves, before = _moves(picture["moves"]), picture.get("before")
        rotation, position = moves[tool["node"]]
        coloured = picture.get("shares", shares)
        shapes = _by_colour(solids, moves, coloured)
        if before is not None:
            shapes["before"] = _join_shapes([solid.move(_moves(before)) for solid in solids])
        if ghost := picture.get("ghost"):
            others = solids_of(ghost["bodies"], ghost["joints"], ghost["tool"], upward)
            shapes["before"] = _join_shapes([solid.move(_moves(ghost["moves"])) for solid in others])
        close = picture.get("close", False)
        arrows = _arrows(marks or [], moves, reach, close)
        seen = _around(np.vstack([each.ends for each in arrows])) if close else None
        image, view = _scene(shapes, rotation @ home + position, upward, reach, seen, arrows=arrows)
        figure = frame_picture(image, view, picture["title"])
        if close:
            _name_arrows(figure, view, arrows)
        if picture.get("kinds", False):
            _name_joints(figure, view, joints, moves)
        _explain(figure, key_of(bodies, joints), coloured, scale, list(dict.fromkeys(each.kind for each in arrows)))
        save_figure(figure, folder / picture["file"], dpi=100)


def animation(
    folder: Path,
    pictures: list[dict[str, Any]],
    bodies: list[dict[str, Any]],
    joints: list[dict[str, Any]],
    tool: dict[str, Any],
    up: list[float],
    shares: dict[str, float] | None = None,
    scale: str = "share",
) -> None:
    """The robot moving, one GIF for each picture, seen by a camera that stands still.

    Parameters
    ----------
    folder
        Where to write.
    pictures
        Each {file, title, frames, order}; ``frames``: as ``moves`` of `robot`, ``order``: which of
        them follow one another, in a loop.
    bodies, joints, tool, up, shares, scale
        As for `robot`.

    """
    upward, home = np.array(up, float), np.array(tool["at"], float)
    solids, reach = solids_of(bodies, joints, tool, upward), extent(bodies, joints, tool)
    for picture in pictures:
        frames = [_moves(each) for each in picture["frames"]]
        coloured = picture.get("shares", shares)
        shapes = [_by_colour(solids, moves, coloured) for moves in frames]
        points = [r @ home + p for r, p in (moves[tool["node"]] for moves in frames)]
        solid = (shape.points for each in shapes for shape in each.values())
        seen = np.vstack([*solid, *(np.add([point], 0.12 * reach * np.eye(3)) for point in points)])
        images: list[Any] = []
        for point, each in zip(points, shapes, strict=True):
            figure = frame_picture(*_scene(each, point, upward, reach, seen, MOVING), picture["title"])
            _explain(figure, key_of(bodies, joints), coloured, scale)
            canvas = FigureCanvasAgg(figure)
            canvas.draw()
            images.append(Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB"))
        loop = [images[k].quantize(256, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE) for k in picture["order"]]
        loop[0].save(
            folder / picture["file"], save_all=True, append_images=loop[1:], duration=PERIOD // len(loop), loop=0
        )


def _moves(given: dict[str, Any]) -> Moves:
    moves = {name: (np.array(r, float), np.array(p, float)) for name, (r, p) in given.items()}
    return {**moves, "ground": (np.eye(3), np.zeros(3))}


def _by_colour(solids: list[Solid], moves: Moves, shares: dict[str, float] | None) -> dict[str, pv.PolyData]:
    """One surface for each colour: many small ones are slow to draw."""
    groups: dict[str, list[pv.PolyData]] = {}
    most = max((shares or {}).values(), default=1.0)
    for solid in solids:
        colour = solid.colour if shares is None else share_colour(shares.get(solid.element), most)
        colour += GLASS if solid.glass else ""
        groups.setdefault(colour, []).append(solid.move(moves))
    return {colour: _join_shapes(shapes) for colour, shapes in groups.items()}


@dataclass(frozen=True)
class Arrow:
    """A mark on the robot: from ``ends[0]`` to ``ends[1]``, (2, 3) in base axes, m."""

    kind: str
    name: str
    ends: Floats


def _arrows(marks: list[dict[str, Any]], moves: Moves, reach: float, close: bool) -> list[Arrow]:
    """Arrows that end where sensors touch, or start where loads act: as long as fits the robot, or the marks alone."""
    places = []
    for mark in marks:
        rotation, position = moves[mark["node"]]
        places.append(rotation @ np.array(mark["at"], float) + position)
    size = 0.14 * reach
    if close:
        size = float(np.clip(0.4 * np.ptp(places, axis=0).max(), 0.5 * size, size))
    out = []
    for mark, place in zip(marks, places, strict=True):
        along = size * np.array(mark["direction"], float)
        ends = (place - along, place) if mark["kind"] == "sensor" else (place, place + along)
        out.append(Arrow(mark["kind"], mark["name"], np.array(ends)))
    return out


def _around(points: Floats) -> Floats:
    """Points (k, 3), moved apart so that what lies around them is seen too."""
    middle = (points.max(axis=0) + points.min(axis=0)) / 2
    return middle + CONTEXT * (points - middle)


def _name_arrows(figure: Figure, view: View, arrows: list[Arrow]) -> None:
    """The name of each arrow at its free end."""
    free = ((each, each.ends[0 if each.kind == "sensor" else 1]) for each in arrows)
    _put_labels(figure, view, [(end, each.name, MARKS[each.kind]) for each, end in free], "bold")


def _name_joints(figure: Figure, view: View, joints: list[dict[str, Any]], moves: Moves) -> None:
    """The kind of each joint, above it; of what is no joint but may be one, whose."""
    labels = []
    for joint in joints:
        rotation, position = moves[joint["first"]]
        at = rotation @ np.array(joint["at"], float) + position
        text = f"{joint['name']}?" if joint["kind"] == "doubt" else joint["kind"]
        labels.append((at, text, _DARK_DOUBT if joint.get("doubted") else EDGES))
    _put_labels(figure, view, labels, raised=30.0)


def _put_labels(
    figure: Figure, view: View, labels: list[tuple[Floats, str, str]], weight: str = "normal", raised: float = 0.0
) -> None:
    """Texts some pixels above points (3,) in colours, each that would lie on another one above that."""
    width, height = view.size
    taken: list[tuple[float, float]] = []
    for point, text, colour in labels:
        across, above = view.pixel(point)
        across, above = float(np.clip(across, 60, width - 60)), float(np.clip(above + raised, 20, height - 20))
        while any(abs(across - x) < 120 and abs(above - y) < 22 for x, y in taken):
            above += 24
        taken.append((across, above))
        figure.text(
            across / width, (BELOW + above) / (height + ABOVE + BELOW), text, fontsize=11, ha="center",
            va="center", color=colour, fontweight=weight, parse_math=False,
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1.5},
        )  # fmt: skip


def _join_shapes(shapes: list[pv.PolyData]) -> pv.PolyData:
    first: Any = shapes[0]
    return first if len(shapes) == 1 else first.append_polydata(*shapes[1:])


def _scene(
    shapes: dict[str, pv.PolyData],
    point: Floats,
    up: Floats,
    reach: float,
    seen: Floats | None = None,
    width: int = WIDTH,
    arrows: Sequence[Arrow] = (),
) -> tuple[Floats, View]:
    """The picture, and its camera: it sees all, or points (k, 3) alone."""
    if seen is None:
        tips = np.add([point], 0.12 * reach * np.eye(3))
        seen = np.vstack([*(shape.points for shape in shapes.values()), *(each.ends for each in arrows), tips])
    view = view_of(seen, towards=tuple(upright(up) @ TOWARDS), width=width, up=tuple(up))
    plotter = new_plotter(view)
    for colour, shape in shapes.items():
        if colour == "before":
            plotter.add_mesh(shape, color=BEFORE, opacity=0.10, lighting=False)
            plotter.add_silhouette(shape, color=BEFORE, line_width=2.0)
            continue
        opacity = int(colour[7:] or "ff", 16) / 255
        plotter.add_mesh(
            shape, color=colour[:7], opacity=opacity, smooth_shading=True, split_sharp_edges=True, feature_angle=35,
            ambient=0.42, diffuse=0.6, specular=0.15,
        )  # fmt: skip
        edges = shape.extract_feature_edges(35, boundary_edges=False, manifold_edges=False, non_manifold_edges=False)
        if edges.n_points:
            edges.points += view.lift / 2
            plotter.add_mesh(edges, color=EDGES, line_width=1.2)
    size = min(0.11 * reach, 0.4 * view.half_height)
    for end, colour in zip(point + size * np.eye(3), AXES, strict=True):
        _draw_arrow(plotter, view, np.array([point, end]), colour)
    for each in arrows:
        _draw_arrow(plotter, view, each.ends, MARKS[each.kind])
    return shot(plotter), view


def _draw_arrow(plotter: pv.Plotter, view: View, ends: Floats, colour: str) -> None:
    """An arrow in front of all solids, as a parallel projection allows."""
    along = ends[1] - ends[0]
    arrow = pv.Arrow(
        start=ends[0] + 15.0 * view.half_height * view.direction, direction=along, scale=float(np.linalg.norm(along)),
        shaft_radius=0.03, tip_radius=0.085,
    )  # fmt: skip
    plotter.add_mesh(arrow, color=colour, ambient=0.5)


def frame_picture(image: Floats, view: View, title: str) -> Figure:
    """The picture under its title, with room below for what its colours mean."""
    width, height = view.size
    total = height + ABOVE + BELOW
    figure = Figure(figsize=(width / 100, total / 100), facecolor="white")
    axes = figure.add_axes((0, BELOW / total, 1, height / total))
    axes.imshow(image, interpolation="none")
    axes.set_axis_off()
    size = min(15.0, LONG / max(len(title), 1)) * min(1.0, 0.25 + 0.75 * width / WIDTH)
    figure.text(
        12 / width, 1 - 12 / total, title, fontsize=size, va="top", fontweight="bold", parse_math=False, color="#14181c"
    )
    figure.text(1 - 12 / width, 12 / total, "at M: x red, y green, z blue", fontsize=10, color="#5a6570", ha="right")
    return figure


def _explain(
    figure: Figure,
    meanings: dict[str, str],
    shares: dict[str, float] | None,
    scale: str,
    marks: list[str] | None = None,
) -> None:
    """What the colours mean."""
    if shares is None:
        _key(figure, {**meanings, **{kind: MARKS[kind] for kind in marks or []}})
    else:
        _share_bar(figure, scale, max(shares.values(), default=1.0))


def key_of(bodies: list[dict[str, Any]], joints: Sequence[dict[str, Any]] = ()) -> dict[str, str]:
    """Colours by what they mean: parts, rigid bodies where there are several, and what is doubtful."""
    doubted = {"doubtful": DOUBTED} if any(joint.get("doubted") for joint in joints) else {}
    colours = {**part_colours(bodies), **rigid_colours(bodies)}
    named = dict(list(colours.items())[:_NAMED])
    if len(colours) > _NAMED:
        named[f"{list(colours)[_NAMED]}, …"] = list(colours.values())[_NAMED]
    return {**named, "rigid": RIGID, "joint": PASSIVE, "drive": DRIVEN, **doubted}


def _key(figure: Figure, entries: dict[str, str]) -> None:
    handles = [Patch(facecolor=colour, label=name) for name, colour in entries.items()]
    key = figure.legend(
        handles=handles, loc="lower left", ncols=len(handles), frameon=False, fontsize=10, handlelength=1.0,
        handletextpad=0.4, columnspacing=1.2, borderaxespad=0.2,
    )  # fmt: skip
    for text in key.get_texts():
        text.set_parse_math(False)  # names of parts are as they are


def _share_bar(figure: Figure, scale: str, most: float) -> None:
    across, pixel = 1 / (100 * figure.get_size_inches()[0]), 1 / (100 * figure.get_size_inches()[1])
    left = 240 * across
    axes = figure.add_axes((left, 18 * pixel, min(0.30, 1 - left - 240 * across), 9 * pixel))
    bar = figure.colorbar(ScalarMappable(Normalize(0, 100 * most), SHARES), cax=axes, orientation="horizontal")
    bar.ax.tick_params(labelsize=8, length=2, pad=1)
    figure.text(left - 12 * across, 18 * pixel, f"{scale}, %", fontsize=10, color="#5a6570", ha="right")


def share_colour(share: float | None, most: float) -> str:
    """Colour of a share on a scale that ends at the largest; grey without one."""
    return NO_SHARE if share is None else to_hex(colormaps[SHARES](share / most if most > 0.0 else 0.0))


def warm_up() -> None:
    """Load what the first picture of solids loads: VTK's graphics, OpenGL, hulls."""
    plotter = new_plotter(View((1.0, 0.0, 0.0), np.zeros(3), 1.0, (16, 16), (0.0, 0.0, 1.0)))
    plotter.add_mesh(pv.Sphere(), smooth_shading=True, split_sharp_edges=True, feature_angle=35)
    shot(plotter)
