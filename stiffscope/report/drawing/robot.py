"""The robot at a pose, drawn from its parts; its components may carry shares of something as colours."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.fea.experiment import load_experiment
from stiffscope.report.drawing.camera import View, new_plotter, shot, view_of
from stiffscope.report.drawing.sheet import GREY
from stiffscope.report.drawing.surfaces import surface

if TYPE_CHECKING:
    from pathlib import Path

    import pyvista as pv
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

STEEL = "#c3c8ce"
SHARES = "YlOrRd"


def robot(
    folder: Path,
    pictures: list[dict[str, Any]],
    geometry: dict[str, float],
    link: dict[str, Any],
    slider: dict[str, Any],
    shares: dict[str, float] | None = None,
    scale: str = "share",
) -> None:
    """The robot drawn from its parts at tool points M: one picture for each {file, title, pose}.

    `link` and `slider` hold the part's experiment file, or None, and its shape. `shares` colours components
    ("limb1.link1", "limb2.slider", "stage.actuator", "platform") by a share between 0 and 1, `scale` says of what.
    """
    skins = {"link": _skin(link, _rod), "slider": _skin(slider, _plate)}
    for picture in pictures:
        bodies = _bodies(
            geometry, np.array(picture["pose"]), skins, float(slider["depth"]) + float(slider["pad_height"])
        )
        image, view = _assembly(bodies, np.array(picture["pose"]), shares)
        _frame(folder / picture["file"], image, view, picture["title"], None if shares is None else scale)


def _assembly(
    bodies: list[tuple[str, pv.PolyData, str]], pose: Floats, shares: dict[str, float] | None
) -> tuple[Floats, View]:
    seen = [*(body.points for _, body, _ in bodies), np.add([pose], [0.0, 0.0, 0.13])]
    view = view_of(np.vstack(seen), towards=(0.28, 1.0, -0.36), width=1500)
    plotter = new_plotter(view)
    for name, body, colour in bodies:
        plotter.add_mesh(
            body, color=colour if shares is None else _share_colour(shares.get(name)), smooth_shading=True,
            split_sharp_edges=True, feature_angle=35, ambient=0.42, diffuse=0.6, specular=0.15,
        )  # fmt: skip
        edges = body.extract_feature_edges(35, boundary_edges=False, manifold_edges=False, non_manifold_edges=False)
        if edges.n_points:
            edges.points += view.lift / 2
            plotter.add_mesh(edges, color="#20252b", line_width=1.4)
    _axes(plotter, pose, view)
    return shot(plotter), view


def _frame(target: Path, image: Floats, view: View, title: str, scale: str | None) -> None:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure

    width, height = view.size
    figure = Figure(figsize=(width / 100, (height + 60) / 100), facecolor="white")
    axes = figure.add_axes((0, 0, 1, height / (height + 60)))
    axes.imshow(image)
    axes.set_axis_off()
    figure.suptitle(title, x=12 / width, ha="left", fontsize=15, fontweight="bold", parse_math=False)
    figure.text(12 / width, 14 / height, "axes at M: x red, y green, z blue (down)", fontsize=10, color=GREY)
    if scale:
        bar = figure.colorbar(
            ScalarMappable(Normalize(0, 100), SHARES),
            cax=figure.add_axes((0.70, 0.075, 0.27, 0.022)),
            orientation="horizontal",
        )
        bar.ax.tick_params(labelsize=9, length=2, pad=2)
        bar.ax.set_title(f"{scale}, %", fontsize=10, color=GREY)
    figure.savefig(target, dpi=100)


def _skin(part: dict[str, Any], otherwise: Any) -> pv.PolyData:
    if part["experiment"] is None:
        return otherwise(part)
    mesh = load_experiment(part["experiment"]).mesh
    return _poly(surface(mesh, mesh.points).clean())


def _rod(part: dict[str, Any]) -> pv.PolyData:
    import pyvista as pv

    length = part["length"]
    middle, along = (length / 2, 0, 0), (1, 0, 0)
    return _poly(pv.Cylinder(center=middle, direction=along, radius=part["radius"], height=length, resolution=48))


def _plate(part: dict[str, Any]) -> pv.PolyData:
    return _box((part["depth"] / 2, 0, 0), (part["depth"], part["width"], part["thickness"]))


def _box(centre: Any, sides: Any) -> pv.PolyData:
    import pyvista as pv

    (x, y, z), (a, b, c) = centre, sides
    return _poly(pv.Box((x - a / 2, x + a / 2, y - b / 2, y + b / 2, z - c / 2, z + c / 2)))


def _poly(shape: Any) -> pv.PolyData:
    """A closed surface as triangles, which is what filters promise to nobody's type checker."""
    return shape.triangulate()


def _bodies(
    g: dict[str, float], m: Floats, skins: dict[str, pv.PolyData], depth: float
) -> list[tuple[str, pv.PolyData, str]]:
    """Every body as (component, surface in {O}, colour)."""
    import pyvista as pv

    sine = (m[2] - g["l1"] - g["l2"]) / g["L"]
    cosine = np.sqrt(1 - sine**2)
    reach = g["L"] * cosine + g["l"]
    rail = g["a_max"] + depth + 0.06
    low, high = float(skins["slider"].points[:, 2].min()), float(skins["slider"].points[:, 2].max())
    back = g["l1"] + low  # the guide's carriage fills the height between rail and slider
    bodies = [*_stage(rail), ("stage", _box((0, m[1], -0.035), (2 * rail, 0.10, 0.03)), "#8d99a6")]
    bodies.append(
        (
            "platform",
            _box((m[0], m[1], m[2] + 0.012), (2 * (g["l"] + g["h"]) + 0.03, 2 * g["d"] + 0.06, 0.030)),
            "#4b5560",
        )
    )
    for i, side in ((1, 1.0), (2, -1.0)):
        a = np.array([m[0] - side * reach, m[1], g["l1"]])
        turn = np.diag([side, side, 1.0])
        bodies.append((f"limb{i}.slider", _moved(skins["slider"], turn, a - turn @ [depth, 0, 0]), "#d9822b"))
        middle = a + np.array([-side * (depth + 0.03), 0, (high - back) / 2 - g["l1"] / 2 - 0.01])
        bodies.append((f"limb{i}.carriage", _box(middle, (0.06, 0.20, g["l1"] + high + 0.02)), "#5f6b78"))
        bodies.append(
            (f"limb{i}.actuator", _screw([-side * 0.03, m[1] + 0.08, -0.03], [middle[0], m[1] + 0.08, -0.03]), STEEL)
        )
        b = m + np.array([-side * g["l"], 0, -g["l2"]])
        axes = np.column_stack([[side * cosine, 0, sine], [0, 1, 0], np.cross([side * cosine, 0, sine], [0, 1, 0])])
        feet = ((-side * g["h"], 0.0), (side * g["h"], g["d"]), (side * g["h"], -g["d"]))
        for j, (dx, dy) in enumerate(feet, 1):
            end = b + np.array([dx, dy, 0])
            start = end - g["L"] * axes[:, 0]
            bodies.append((f"limb{i}.link{j}", _moved(skins["link"], axes, start), "#3b7dbf"))
            for name, point in (("a", start), ("b", end)):
                bearing = _poly(
                    pv.Cylinder(center=point, direction=(0, 1, 0), radius=0.017, height=0.044, resolution=40)
                )
                bodies.append((f"limb{i}.link{j}.joint_{name}", bearing, "#2c343c"))
    return bodies


def _stage(rail: float) -> list[tuple[str, pv.PolyData, str]]:
    """The frame that the rail travels on along y, and the screw that moves it."""
    beams = _joined(*(_box((x, 0, -0.065), (0.06, 0.44, 0.03)) for x in (0.06 - rail, rail - 0.06)))
    return [("base", beams, "#b4bcc5"), ("stage.actuator", _screw([0, -0.24, -0.065], [0, 0.16, -0.065]), STEEL)]


def _screw(motor: Any, end: Any) -> pv.PolyData:
    """A lead screw and, at its near end, the motor."""
    import pyvista as pv

    start, way = np.asarray(motor, float), np.subtract(end, motor)
    length = float(np.linalg.norm(way))
    screw = pv.Cylinder(center=start + way / 2, direction=way, radius=0.008, height=length, resolution=32)
    drive = pv.Cylinder(center=start + 0.03 * way / length, direction=way, radius=0.026, height=0.07, resolution=48)
    return _joined(_poly(screw), _poly(drive))


def _joined(*bodies: pv.PolyData) -> pv.PolyData:
    import pyvista as pv

    return _poly(pv.merge(bodies).extract_surface())


def _moved(skin: pv.PolyData, rotation: Floats, origin: Floats) -> pv.PolyData:
    moved = skin.copy()
    moved.points = skin.points @ np.asarray(rotation).T + origin
    return moved


def _axes(plotter: pv.Plotter, point: Floats, view: View) -> None:
    import pyvista as pv

    for direction, colour in zip(np.eye(3), ("#d62728", "#2ca02c", "#1f4fd6"), strict=True):
        start = point + 0.5 * view.half_height * view.direction
        arrow = pv.Arrow(start=start, direction=direction, scale=0.12, shaft_radius=0.03, tip_radius=0.09)
        plotter.add_mesh(arrow, color=colour, ambient=0.5)


def _share_colour(share: float | None) -> str:
    from matplotlib import colormaps
    from matplotlib.colors import to_hex

    return "#d9dde2" if share is None else to_hex(colormaps[SHARES](float(np.clip(share, 0, 1))))
