"""What the drawing process does: pyvista renders the solids off-screen, matplotlib sets titles and scales around them.

Every public function writes one picture and is called by name through `app.pictures.draw`. Lengths in m.
"""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fea.experiment import load_experiment

if TYPE_CHECKING:
    import pyvista as pv
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from fea.experiment import Experiment
    from fea.mesh import TetMesh

    Floats = NDArray[np.float64]

WRENCHES = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")
LOADS = ("1 N", "1 N", "1 N", "1 N·m", "1 N·m", "1 N·m")
UP = (0.0, 0.0, -1.0)  # z points down, in the parts and in the robot
SPLIT = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]])  # a triangle with mid nodes as four flat ones
CLAMPED, LOADED, FREE = "#1f5fa8", "#e08214", "#d9dde2"
DEFORMATION = 0.12  # greatest displacement shown, in lengths of the part's diagonal
PREFIXES = ((1e9, "G"), (1e6, "M"), (1e3, "k"), (1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n"), (1e-12, "p"))


def main(order_file: str) -> None:
    """Draw what an order file of `app.pictures.draw` asks for."""
    order = json.loads(Path(order_file).read_text())
    pictures = {f.__name__: f for f in (part_pictures, robot)}
    pictures[order["picture"]](Path(order["target"]), **order["arguments"])
    os._exit(0)  # VTK's own end has been seen to crash after the picture was there


@dataclass(frozen=True)
class View:
    """A fixed camera: direction towards it, what it looks at, half the height of what it sees."""

    towards: tuple[float, float, float]
    focus: Floats
    half_height: float
    size: tuple[int, int]

    @property
    def direction(self) -> Floats:
        """Unit vector towards the camera."""
        return np.array(self.towards) / np.linalg.norm(self.towards)

    @property
    def lift(self) -> Floats:
        """Brings lines in front of the surface they lie on; a parallel projection does not show it."""
        return 4e-3 * self.half_height * self.direction


def part_pictures(
    folder: Path, experiment: str, title: str, clamped: list[int], loaded: list[int], sheet: str, mesh: str
) -> None:
    """Both pictures of a part: its deformations and its mesh."""
    held = load_experiment(experiment)
    contact_sheet(folder / sheet, held, title)
    tagged_mesh(folder / mesh, held, title, clamped, loaded)


# --- each part under six unit wrenches ---------------------------------------------------------------------------


def contact_sheet(target: Path, held: Experiment, title: str) -> None:
    """The part deformed by each unit wrench: displacement above, von Mises stress below."""
    mesh, motion, stress = held.mesh, held.displacement[:6], held.von_mises[:6]
    size = np.linalg.norm(motion, axis=2)  # (6, nodes)
    diagonal = float(np.linalg.norm(np.ptp(mesh.points, axis=0)))
    scales = DEFORMATION * diagonal / size.max(axis=1)
    shapes = [mesh.points + scale * u for scale, u in zip(scales, motion, strict=True)]
    view = _view(np.vstack([mesh.points, *shapes]), towards=(0.55, 1.0, -0.75), width=900)
    figure, cells = _sheet(4, 3, view)
    for row, (values, unit, word, colours) in enumerate(
        ((size, "m", "displacement", "viridis"), (stress, "Pa", "von Mises stress", "inferno"))
    ):
        for j in range(6):
            image, limit, greatest = _deformed(mesh, shapes[j], values[j], colours, view)
            cell = cells[2 * row + j // 3][j % 3]
            heading = f"{WRENCHES[j]} = {LOADS[j]}   {word}"
            _fill(figure, cell, image, heading, f"deformation × {_power(scales[j])}")
            _scale_bar(figure, cell, limit, greatest, unit, colours)
    _title(figure, title)
    figure.savefig(target, dpi=100)


def _deformed(mesh: TetMesh, points: Floats, values: Floats, colours: str, view: View) -> tuple[Floats, float, float]:
    """Picture of a deformed part, the colours' upper limit and the greatest value."""
    greatest = float(values.max())
    limit = float(np.quantile(values[np.unique(mesh.facets)], 0.995)) if colours == "inferno" else greatest
    plotter = _plotter(view)
    still = _surface(mesh, mesh.points)
    plotter.add_mesh(still, color="#9aa4b0", opacity=0.10, lighting=False)
    plotter.add_mesh(_outline(mesh, mesh.points), color="#7a8594", line_width=1.5)
    plotter.add_silhouette(still, color="#7a8594", line_width=1.5)
    skin = _surface(mesh, points)
    skin["value"] = values
    plotter.add_mesh(
        skin, scalars="value", cmap=colours, clim=(0.0, limit), smooth_shading=True, split_sharp_edges=True,
        feature_angle=40, show_scalar_bar=False, ambient=0.55, diffuse=0.5,
    )  # fmt: skip
    plotter.add_mesh(_outline(mesh, points + view.lift), color="#20252b", line_width=1.5)
    return _shot(plotter), limit, greatest


# --- the mesh with its tagged faces -------------------------------------------------------------------------------


def tagged_mesh(target: Path, held: Experiment, title: str, clamped: list[int], loaded: list[int]) -> None:
    """The mesh: clamped and loaded faces in colour, from both sides."""
    mesh = held.mesh
    views = [_view(mesh.points, towards=(side, 1.0, -0.75), width=1100) for side in (0.55, -0.9)]
    figure, cells = _sheet(1, 2, views[0])
    for view, cell, heading in zip(views, cells[0], ("towards the loaded end", "towards the clamped end"), strict=True):
        plotter = _plotter(view)
        for faces, colour in ((clamped, CLAMPED), (loaded, LOADED), (None, FREE)):
            chosen = np.isin(mesh.facet_face, clamped + loaded if faces is None else faces, invert=faces is None)
            if chosen.any():
                plotter.add_mesh(_surface(mesh, mesh.points, chosen), color=colour, ambient=0.5, diffuse=0.55)
        plotter.add_mesh(_sides(mesh, mesh.points + view.lift), color="#3c4650", line_width=0.9)
        plotter.add_mesh(_outline(mesh, mesh.points + 2 * view.lift), color="#14181c", line_width=2.2)
        _fill(figure, cell, _shot(plotter), heading, "")
    counts = f"{len(mesh.cells):,} quadratic tetrahedra, {len(mesh.points):,} nodes"
    _legend(figure, ((CLAMPED, "clamped"), (LOADED, f"loaded ({held.interface})"), (FREE, "free")))
    _title(figure, f"{title}: {counts}")
    figure.savefig(target, dpi=100)


# --- the robot at a pose ----------------------------------------------------------------------------------------------


def robot(
    folder: Path,
    pictures: list[dict[str, Any]],
    geometry: dict[str, float],
    link: dict[str, Any],
    slider: dict[str, Any],
    shares: dict[str, float] | None = None,
) -> None:
    """The robot drawn from its parts at tool points M: one picture for each {file, title, pose}.

    `link` and `slider` hold the part's experiment file, or None, and its shape. `shares` colours components
    ("limb1.link1", "limb2.slider", "stage.actuator", "platform") by a share between 0 and 1.
    """
    skins = {"link": _skin(link, _rod), "slider": _skin(slider, _plate)}
    for picture in pictures:
        bodies = _bodies(
            geometry, np.array(picture["pose"]), skins, float(slider["depth"]) + float(slider["pad_height"])
        )
        image, view = _assembly(bodies, np.array(picture["pose"]), shares)
        _frame(folder / picture["file"], image, view, picture["title"])


def _assembly(
    bodies: list[tuple[str, pv.PolyData, str]], pose: Floats, shares: dict[str, float] | None
) -> tuple[Floats, View]:
    seen = [*(body.points for _, body, _ in bodies), np.add([pose], [0.0, 0.0, 0.13])]
    view = _view(np.vstack(seen), towards=(0.28, 1.0, -0.36), width=1500)
    plotter = _plotter(view)
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
    return _shot(plotter), view


def _frame(target: Path, image: Floats, view: View, title: str) -> None:
    from matplotlib.figure import Figure

    width, height = view.size
    figure = Figure(figsize=(width / 100, (height + 60) / 100), facecolor="white")
    axes = figure.add_axes((0, 0, 1, height / (height + 60)))
    axes.imshow(image)
    axes.set_axis_off()
    _title(figure, title)
    figure.text(
        12 / width, 14 / (height + 60), "axes at M: x red, y green, z blue (down)", fontsize=10, color="#5a6570"
    )
    figure.savefig(target, dpi=100)


def _skin(part: dict[str, Any], otherwise: Any) -> pv.PolyData:
    if part["experiment"] is None:
        return otherwise(part)
    mesh = load_experiment(part["experiment"]).mesh
    return _poly(_surface(mesh, mesh.points).clean())


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
    bodies = [("stage.actuator", _box((0, m[1], -0.035), (2 * rail, 0.10, 0.03)), "#8d99a6")]
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

    return "#d9dde2" if share is None else to_hex(colormaps["YlOrRd"](float(np.clip(share, 0, 1))))


# --- meshes and cameras ---------------------------------------------------------------------------------------------


def _surface(mesh: TetMesh, points: Floats, chosen: Any = slice(None)) -> pv.PolyData:
    import pyvista as pv

    triangles = mesh.facets[chosen][:, SPLIT].reshape(-1, 3)
    return pv.PolyData.from_regular_faces(points, triangles)


def _sides(mesh: TetMesh, points: Floats) -> pv.PolyData:
    """The sides of the boundary's triangles, curved as they are."""
    import pyvista as pv

    halves = mesh.facets[:, [[0, 3], [3, 1], [1, 4], [4, 2], [2, 5], [5, 0]]].reshape(-1, 2)
    halves = np.unique(np.sort(halves, axis=1), axis=0)
    return pv.PolyData(points, lines=np.insert(halves, 0, 2, axis=1).ravel())


def _outline(mesh: TetMesh, points: Floats) -> pv.PolyData:
    """Edges between CAD faces that meet at an angle, carried along with the points."""
    import pyvista as pv

    halves = mesh.facets[:, [[0, 3], [3, 1], [1, 4], [4, 2], [2, 5], [5, 0]]].reshape(-1, 2)
    owner = np.repeat(np.arange(len(mesh.facets)), 6)
    order = np.lexsort(np.sort(halves, axis=1).T)
    first, second = order[0::2], order[1::2]  # a closed surface: every half side occurs twice
    corners = mesh.points[mesh.facets[:, :3]]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    cosine = np.einsum("ij,ij->i", normals[owner[first]], normals[owner[second]])
    between = mesh.facet_face[owner[first]] != mesh.facet_face[owner[second]]
    sharp = halves[first[between & (cosine < np.cos(np.radians(30)))]]
    return pv.PolyData(points, lines=np.insert(sharp, 0, 2, axis=1).ravel())


def _view(points: Floats, towards: tuple[float, float, float], width: int) -> View:
    """Camera that just holds all points; the picture is as flat as they are."""
    direction = np.array(towards) / np.linalg.norm(towards)
    right = np.cross(-direction, UP)
    right /= np.linalg.norm(right)
    up = np.cross(right, -direction)
    flat = points @ np.array([right, up]).T
    low, high = flat.min(axis=0), flat.max(axis=0)
    extent = 1.06 * (high - low)
    height = int(np.clip(width * extent[1] / extent[0], 0.34 * width, 0.8 * width))
    half_height = max(extent[1], extent[0] * height / width) / 2
    middle = (low + high) / 2
    depth = float((points @ direction).mean())
    return View(towards, middle @ np.array([right, up]) + depth * direction, half_height, (width, height))


def _plotter(view: View) -> pv.Plotter:
    import pyvista as pv

    plotter = pv.Plotter(off_screen=True, window_size=list(view.size), lighting="light kit")
    plotter.set_background("white")  # type: ignore[call-arg, arg-type]
    plotter.enable_anti_aliasing("ssaa")
    plotter.enable_parallel_projection()  # type: ignore[call-arg]
    plotter.camera.focal_point = view.focus
    plotter.camera.position = view.focus + 10.0 * view.direction
    plotter.camera.up = UP
    plotter.camera.parallel_scale = view.half_height
    plotter.camera.clipping_range = (0.1, 20.0)
    return plotter


def _shot(plotter: pv.Plotter) -> Floats:
    image = plotter.screenshot(return_img=True)
    plotter.close()
    if image is None:
        raise RuntimeError("the OpenGL window gave no picture")
    return image


# --- the sheet around the renderings ----------------------------------------------------------------------------------


def _sheet(rows: int, columns: int, view: View) -> tuple[Figure, list[list[tuple[float, float, float, float]]]]:
    """A figure at 100 dpi with room for rows × columns renderings; cells as (left, bottom, width, height) in pixels."""
    from matplotlib.figure import Figure

    width, height = 620, int(620 * view.size[1] / view.size[0]) + 78
    top = 52
    figure = Figure(figsize=(columns * width / 100, (rows * height + top) / 100), facecolor="white")
    cells = [[(c * width, (rows - 1 - r) * height, width, height) for c in range(columns)] for r in range(rows)]
    return figure, [[_relative(figure, cell) for cell in line] for line in cells]


def _relative(figure: Figure, cell: tuple[float, ...]) -> tuple[float, float, float, float]:
    w, h = figure.get_size_inches() * 100
    return cell[0] / w, cell[1] / h, cell[2] / w, cell[3] / h


def _fill(figure: Figure, cell: tuple[float, float, float, float], image: Floats, heading: str, remark: str) -> None:
    left, bottom, width, height = cell
    pixel = 1 / (figure.get_size_inches()[1] * 100)
    axes = figure.add_axes((left, bottom + 48 * pixel, width, height - 78 * pixel))
    axes.imshow(image, aspect="auto", interpolation="antialiased")
    axes.set_axis_off()
    top = bottom + height - 10 * pixel
    figure.text(left + 0.02 * width, top, heading, fontsize=11, va="top", color="#14181c")
    figure.text(left + 0.98 * width, top, remark, fontsize=10, va="top", ha="right", color="#5a6570")


def _scale_bar(
    figure: Figure, cell: tuple[float, float, float, float], limit: float, greatest: float, unit: str, colours: str
) -> None:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    left, bottom, width, _ = cell
    pixel = 1 / (figure.get_size_inches()[1] * 100)
    factor, prefix = next((f, p) for f, p in PREFIXES if limit >= f or f == PREFIXES[-1][0])
    axes = figure.add_axes((left + 0.06 * width, bottom + 34 * pixel, 0.6 * width, 9 * pixel))
    bar = figure.colorbar(
        ScalarMappable(Normalize(0, limit / factor), colours), cax=axes, orientation="horizontal",
        extend="max" if greatest > 1.001 * limit else "neither",
    )  # fmt: skip
    bar.ax.tick_params(labelsize=9, length=2, pad=2)
    bar.outline.set_linewidth(0.4)
    text = f"{prefix}{unit}, greatest {greatest / factor:.3g}"
    figure.text(left + 0.70 * width, bottom + 38 * pixel, text, fontsize=9, va="center", color="#14181c")


def _title(figure: Figure, title: str) -> None:
    height = figure.get_size_inches()[1] * 100
    figure.text(
        12 / (figure.get_size_inches()[0] * 100), 1 - 14 / height, title, fontsize=15, va="top", fontweight="bold"
    )


def _power(number: float) -> str:
    """2.3e6 as 2.3·10⁶, in matplotlib's notation; small numbers as they are."""
    mantissa, exponent = f"{number:.1e}".split("e")
    return f"{number:.3g}" if abs(int(exponent)) < 4 else rf"${mantissa}\cdot10^{{{int(exponent)}}}$"


def _legend(figure: Figure, entries: tuple[tuple[str, str], ...]) -> None:
    from matplotlib.patches import Patch

    handles = [Patch(facecolor=colour, edgecolor="#3c4650", label=label) for colour, label in entries]
    figure.legend(handles=handles, loc="lower left", ncols=len(handles), frameon=False, fontsize=11)
