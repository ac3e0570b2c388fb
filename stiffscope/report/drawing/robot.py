"""Pictures of any robot at a pose: parts as solids, rigid bodies as hulls, joints by type.

Geometry is given at home in base axes; pictures give the motion of nodes, ``x = R x_home + p``.
"""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np
import pyvista as pv
from matplotlib import colormaps
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize, to_hex
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
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
from stiffscope.report.drawing.surfaces import SHARP, sharp_edges
from stiffscope.report.figures import save_figure

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from stiffscope.report.drawing.solids import Moves, Solid

    Floats = NDArray[np.float64]

SHARES = "YlOrRd"
NO_SHARE = "#d9dde2"
BEFORE = "#9aa4b0"
EDGES = "#20252b"
TOWARDS = (0.42, -1.0, 0.4)  # towards the camera, in axes with z up
WIDTH = 1200
ABOVE = 42
BELOW = 34  # pixels: width, height of the title, height of the key
MOVING = 720
PERIOD = 1280  # animation: width in pixels, period in ms
LONG = 1300  # longest title, in characters times points
_DARK_DOUBT = "#9a6a00"
AXES = ("#d62728", "#2ca02c", "#1f4fd6")
MARKS = {"sensor": "#8e24aa", "load": "#ef6c00"}
SHADES = 9  # shades of the colour scale in a page's viewer
_NAMED = 5  # most parts in the key
_ALIKE = 12.0  # pixels within which equal labels are one
_GRID = product(48.0 * np.arange(-8, 9), 24.0 * np.arange(-12, 13))
_STEPS = sorted(
    _GRID, key=lambda step: np.hypot(*step)
)  # pixels from a point to its label
TITLE: Any = {
    "va": "top",
    "fontweight": "bold",
    "parse_math": False,
    "color": "#14181c",
}
SMALL: Any = {"fontsize": 10, "color": "#5a6570", "ha": "right"}


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
    """Draw the robot, one picture per {file, title, moves, before}; see `report.robot_scene`.

    Parameters
    ----------
    folder
        Folder to write to.
    pictures
        ``moves``: node to [R (3, 3), p (3,)] from home. Optional: ``before``, former ``moves``, and
        ``ghost``, another robot {bodies, joints, tool, moves}, both drawn light; ``names``:
        label the marks; ``kinds``: label joints with their kind.
        A GIF has ``frames``, each like ``moves``, and their ``order`` in the loop instead.
    bodies
        {name, nodes, part, experiment, shape, mesh, axes, base, length, places}; a rigid body has
        one node. ``shape``, without an experiment: {radius} of a rod or {width, thickness} of a
        plate; ``mesh``: a surface in m.
    joints
        {name, kind, first, second, at, axis, axis2, driven, low, high}, m and rad; ``doubted`` is
        optional; a possible further joint has the kind "doubt".
    tool
        {node, at}.
    up
        (3,), opposite to gravity.
    shares
        Share of each element (0 to 1), shown in colours; ``scale`` is the quantity. A picture may
        have its own ``shares``.
    marks
        {kind, name, node, at, direction}: arrows of kind "sensor" or "load" at points (3,) of nodes
        at home, along directions (3,) in base axes.
    geometry
        JSON file for the solids of a page's viewer.
    """
    upward = np.array(up, float)
    key = key_of(bodies, joints)
    solids = solids_of(bodies, joints, tool, upward)
    reach = extent(bodies, joints, tool)
    if geometry is not None:
        shades = [share_colour(k / (SHADES - 1), 1.0) for k in range(SHADES)]
        colours = {"shades": shades, "no_share": NO_SHARE, "key": key, "tool": tool}
        packed = pack_solids(solids, upward, reach)
        (folder / geometry).write_text(json.dumps({**packed, **colours}))
    for picture in pictures:
        coloured = picture.get("shares", shares)
        if "frames" in picture:
            images = _draw_frames(
                picture=picture,
                solids=solids,
                reach=reach,
                up=upward,
                tool=tool,
                shares=coloured,
            )
            figures = [frame_picture(*image, picture["title"]) for image in images]
            for figure in figures:
                _explain(figure, key, coloured, scale)
            _save_loop(folder / picture["file"], figures, picture["order"])
            continue
        moves = _moves(picture["moves"])
        former = picture.get("before")
        shapes = _by_colour(solids, moves, coloured)
        others = solids
        ghost = picture.get("ghost")
        if ghost:
            others = solids_of(ghost["bodies"], ghost["joints"], ghost["tool"], upward)
            former = ghost["moves"]
        if former is not None:
            shapes["before"] = _join_shapes(
                [solid.move(_moves(former)) for solid in others]
            )
        arrows = _arrows(marks or [], moves, reach)
        point = _place(moves, tool["node"], tool["at"])
        image, view = _scene(shapes, point, upward, reach, arrows=arrows)
        figure = frame_picture(image, view, picture["title"])
        if picture.get("names", False):
            free = (
                (arrow, arrow.ends[0 if arrow.kind == "sensor" else 1])
                for arrow in arrows
            )
            labels = [(end, each.name, MARKS[each.kind]) for each, end in free]
            _put_labels(figure, view, labels, "bold")
        if picture.get("kinds", False):
            _name_joints(figure, view, joints, moves)
        marked = {arrow.kind: MARKS[arrow.kind] for arrow in arrows}
        _explain(figure, {**key, **marked}, coloured, scale)
        save_figure(figure, folder / picture["file"], dpi=100)


def _draw_frames(
    picture: dict[str, Any],
    solids: list[Solid],
    reach: float,
    up: Floats,
    tool: dict[str, Any],
    shares: dict[str, float] | None,
) -> Iterator[tuple[NDArray[Any], View]]:
    """Yield the frames of a moving robot, with a fixed camera."""
    frames = [_moves(frame) for frame in picture["frames"]]
    shapes = [_by_colour(solids, moves, shares) for moves in frames]
    points = [_place(moves, tool["node"], tool["at"]) for moves in frames]
    solid = (shape.points for body in shapes for shape in body.values())
    seen = np.vstack(
        [*solid, *(np.add([point], 0.12 * reach * np.eye(3)) for point in points)]
    )
    for point, each in zip(points, shapes, strict=True):
        yield _scene(
            shapes=each, point=point, up=up, reach=reach, seen=seen, width=MOVING
        )


def _save_loop(target: Path, figures: list[Figure], order: list[int]) -> None:
    """Write figures as a GIF that repeats them in this order."""
    images = []
    for figure in figures:
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        images.append(Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB"))
    octree = Image.Quantize.FASTOCTREE
    plain = Image.Dither.NONE
    first, *rest = (images[k].quantize(256, octree, dither=plain) for k in order)
    first.save(
        target, save_all=True, append_images=rest, duration=PERIOD // len(order), loop=0
    )


def _moves(given: dict[str, Any]) -> Moves:
    moves = {
        name: (np.array(r, float), np.array(p, float)) for name, (r, p) in given.items()
    }
    return {**moves, "ground": (np.eye(3), np.zeros(3))}


def _place(moves: Moves, node: str, home: Any) -> Floats:
    """Return where a point of a node has moved from home."""
    rotation, position = moves[node]
    return rotation @ np.array(home, float) + position


def _by_colour(
    solids: list[Solid], moves: Moves, shares: dict[str, float] | None
) -> dict[str, pv.PolyData]:
    """Merge solids into one surface per colour, since many small ones draw slowly."""
    groups: dict[str, list[pv.PolyData]] = {}
    most = max((shares or {}).values(), default=1.0)
    for solid in solids:
        colour = (
            solid.colour
            if shares is None
            else share_colour(shares.get(solid.element), most)
        )
        colour += GLASS if solid.glass else ""
        groups.setdefault(colour, []).append(solid.move(moves))
    return {colour: _join_shapes(shapes) for colour, shapes in groups.items()}


@dataclass(frozen=True)
class Arrow:
    """A mark on the robot, from ``ends[0]`` to ``ends[1]``, (2, 3) in base axes, m."""

    kind: str
    name: str
    ends: Floats


def _arrows(marks: list[dict[str, Any]], moves: Moves, reach: float) -> list[Arrow]:
    """Return arrows that end at sensors or start at loads."""
    places = [_place(moves, mark["node"], mark["at"]) for mark in marks]
    out = []
    for mark, place in zip(marks, places, strict=True):
        along = 0.14 * reach * np.array(mark["direction"], float)
        ends = (
            (place - along, place)
            if mark["kind"] == "sensor"
            else (place, place + along)
        )
        out.append(Arrow(mark["kind"], mark["name"], np.array(ends)))
    return out


def _name_joints(
    figure: Figure, view: View, joints: list[dict[str, Any]], moves: Moves
) -> None:
    """Label each joint with its kind, and each possible joint with its bodies."""
    labels = []
    for joint in joints:
        at = _place(moves, joint["first"], joint["at"])
        text = f"{joint['name']}?" if joint["kind"] == "doubt" else joint["kind"]
        labels.append((at, text, _DARK_DOUBT if joint.get("doubted") else EDGES))
    _put_labels(figure, view, labels, raised=30.0)


def _put_labels(
    figure: Figure,
    view: View,
    labels: list[tuple[Floats, str, str]],
    weight: str = "normal",
    raised: float = 0.0,
) -> None:
    """Write coloured labels above points (3,), or at the nearest free place, with lines to them.

    Equal labels of one point are one, with their number.
    """
    size = np.array(view.size)
    below = np.array((0, BELOW))
    pixels = [np.array(view.pixel(point)) for point, _, _ in labels]
    alike = [tuple(np.round(pixel / _ALIKE)) for pixel in pixels]
    texts = [(place, *rest) for place, (_, *rest) in zip(alike, labels, strict=True)]
    taken: list[tuple[Floats, Floats]] = []
    for key, number in Counter(texts).items():
        pixel = pixels[texts.index(key)]
        (_, text, colour) = key
        text = f"{number} x {text}" if number > 1 else text
        half = np.array((4.5 * len(text) + 4.0, 11.0))
        steps = np.add((0.0, raised), _STEPS)
        places = [np.clip(pixel + step, half, size - half) for step in steps]
        free = (
            p for p in places if all((np.abs(p - q) > half + r).any() for q, r in taken)
        )
        place = next(free, places[0])
        taken.append((place, half))
        x, y = np.transpose(
            (np.array([pixel, place]) + below) / np.add(size, (0, ABOVE + BELOW))
        )
        if np.linalg.norm(place - pixel) > half[1]:
            line = Line2D(
                x,
                y,
                color=colour,
                linewidth=0.8,
                marker="o",
                markersize=3,
                markevery=[0],
            )
            figure.add_artist(line)
        figure.text(
            x[1],
            y[1],
            text,
            fontsize=11,
            ha="center",
            va="center",
            color=colour,
            fontweight=weight,
            parse_math=False,
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1.5},
        )


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
) -> tuple[NDArray[Any], View]:
    """Return the picture and its camera, which fits everything or only points (k, 3)."""
    if seen is None:
        drawn = (shape.points for shape in shapes.values())
        tips = point + 0.12 * reach * np.eye(3)
        seen = np.vstack([*drawn, *(arrow.ends for arrow in arrows), tips])
    view = view_of(
        seen, towards=tuple(upright(up) @ TOWARDS), width=width, up=tuple(up)
    )
    plotter = new_plotter(view)
    for colour, shape in shapes.items():
        if colour == "before":
            plotter.add_mesh(shape, color=BEFORE, opacity=0.10, lighting=False)
            plotter.add_silhouette(shape, color=BEFORE, line_width=2.0)
            continue
        opacity = int(colour[7:] or "ff", 16) / 255
        plotter.add_mesh(
            shape,
            color=colour[:7],
            opacity=opacity,
            smooth_shading=True,
            split_sharp_edges=True,
            feature_angle=SHARP,
            ambient=0.42,
            diffuse=0.6,
            specular=0.15,
        )
        edges = sharp_edges(shape)
        if edges.n_points:
            edges.points += view.lift / 2
            plotter.add_mesh(edges, color=EDGES, line_width=1.2)
    size = min(0.11 * reach, 0.4 * view.half_height)
    for end, colour in zip(point + size * np.eye(3), AXES, strict=True):
        _draw_arrow(plotter, view, np.array([point, end]), colour)
    for arrow in arrows:
        _draw_arrow(plotter, view, arrow.ends, MARKS[arrow.kind])
    return shot(plotter), view


def _draw_arrow(plotter: pv.Plotter, view: View, ends: Floats, colour: str) -> None:
    """Draw an arrow in front of all solids; parallel projection keeps its place."""
    along = ends[1] - ends[0]
    start = ends[0] + 15.0 * view.half_height * view.direction
    scale = float(np.linalg.norm(along))
    arrow = pv.Arrow(
        start=start, direction=along, shaft_radius=0.03, tip_radius=0.085, scale=scale
    )
    plotter.add_mesh(arrow, color=colour, ambient=0.5)


def frame_picture(image: Floats, view: View, title: str) -> Figure:
    """Return a figure of the picture with its title above and space for the key below."""
    width, height = view.size
    total = height + ABOVE + BELOW
    figure = Figure(figsize=(width / 100, total / 100), facecolor="white")
    figure.figimage(image, 0, BELOW)  # pixel by pixel; axes would resample
    size = min(15.0, LONG / max(len(title), 1)) * min(1.0, 0.25 + 0.75 * width / WIDTH)
    figure.text(12 / width, 1 - 12 / total, title, fontsize=size, **TITLE)
    figure.text(1 - 12 / width, 12 / total, "at M: x red, y green, z blue", **SMALL)
    return figure


def _explain(
    figure: Figure,
    meanings: dict[str, str],
    shares: dict[str, float] | None,
    scale: str,
) -> None:
    """Draw the colour key or the scale of shares."""
    if shares is None:
        handles = [
            Patch(facecolor=colour, label=name) for name, colour in meanings.items()
        ]
        key = figure.legend(
            handles=handles,
            loc="lower left",
            ncols=len(handles),
            frameon=False,
            fontsize=10,
            handlelength=1.0,
            handletextpad=0.4,
            columnspacing=1.2,
            borderaxespad=0.2,
        )
        for text in key.get_texts():
            text.set_parse_math(False)  # names of parts are not math
        return
    most = max(shares.values(), default=1.0)
    across, pixel = 0.01 / figure.get_size_inches()
    left = 240 * across
    axes = figure.add_axes(
        (left, 18 * pixel, min(0.30, 1 - left - 240 * across), 9 * pixel)
    )
    shades = ScalarMappable(Normalize(0, 100 * most), SHARES)
    bar = figure.colorbar(shades, cax=axes, orientation="horizontal")
    bar.ax.tick_params(labelsize=8, length=2, pad=1)
    figure.text(left - 12 * across, 18 * pixel, f"{scale}, %", **SMALL)


def key_of(
    bodies: list[dict[str, Any]], joints: Sequence[dict[str, Any]] = ()
) -> dict[str, str]:
    """Return the colour key: parts, rigid bodies if several, joints, drives and doubtful joints."""
    doubted = (
        {"doubtful": DOUBTED} if any(joint.get("doubted") for joint in joints) else {}
    )
    colours = {**part_colours(bodies), **rigid_colours(bodies)}
    named = dict(list(colours.items())[:_NAMED])
    if len(colours) > _NAMED:
        named[f"{list(colours)[_NAMED]}, …"] = list(colours.values())[_NAMED]
    return {**named, "rigid": RIGID, "joint": PASSIVE, "drive": DRIVEN, **doubted}


def share_colour(share: float | None, most: float) -> str:
    """Return the colour of a share on a scale up to the largest share; grey for None."""
    if share is None:
        return NO_SHARE
    return to_hex(colormaps[SHARES](share / most if most > 0.0 else 0.0))


def warm_up() -> None:
    """Load VTK's graphics, OpenGL and hull routines before the first picture of solids."""
    plotter = new_plotter(
        View((1.0, 0.0, 0.0), np.zeros(3), 1.0, (16, 16), (0.0, 0.0, 1.0))
    )
    plotter.add_mesh(
        pv.Sphere(), smooth_shading=True, split_sharp_edges=True, feature_angle=35
    )
    shot(plotter)
