"""Pictures of a part deformed by six unit wrenches, and of its mesh with its tagged faces."""

from __future__ import annotations

from itertools import chain, cycle, islice, product
from typing import TYPE_CHECKING

import numpy as np
import pyvista as pv
from matplotlib.patches import Patch

from stiffscope.fea.experiment import load_experiment
from stiffscope.report.drawing.camera import View, new_plotter, shot, snap, view_of
from stiffscope.report.drawing.sheet import fill, scale_bar, sheet_of
from stiffscope.report.drawing.surfaces import outline, sides, surface
from stiffscope.report.figures import save_figure
from stiffscope.report.numbers import power

if TYPE_CHECKING:
    from pathlib import Path

    from stiffscope.fea.experiment import Experiment
    from stiffscope.fea.mesh import TetMesh
    from stiffscope.runtime.types import Array

WRENCHES = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")
LOADS = ("1 N", "1 N", "1 N", "1 N·m", "1 N·m", "1 N·m")
INTERFACES = (
    "#1f5fa8",
    "#e08214",
    "#1b9e77",
    "#c51b7d",
    "#7570b3",
    "#a6761d",
)  # the one at rest first
FREE = "#d9dde2"
UP_Z = (0.0, 0.0, 1.0)
DEFORMATION = 0.12  # largest drawn displacement over the part's diagonal


def part_pictures(
    folder: Path,
    experiment: str,
    title: str,
    faces: dict[str, list[int]],
    sheet: str,
    mesh: str | None = None,
) -> None:
    """Draw a part's deformations and, if a file is given, its mesh.

    Parameters
    ----------
    folder, sheet, mesh
        Folder to write to, and names of the PNG files.
    experiment, title
        File of the experiment, and name of the part.
    faces
        Indices of the CAD faces of each interface, the one at rest first.
    """
    solved = load_experiment(experiment)
    above = _best_seen_from_above(solved.mesh, faces)
    _contact_sheet(folder / sheet, solved, title, above=above)
    if mesh:
        _tagged_mesh(folder / mesh, solved, title, faces, above=above)


def _best_seen_from_above(mesh: TetMesh, faces: dict[str, list[int]]) -> bool:
    """Return whether more of the interfaces' area faces up, along z, than down."""
    corners = mesh.points[
        mesh.facets[np.isin(mesh.facet_face, [*chain(*faces.values())]), :3]
    ]
    up = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2]
    return bool(up.clip(min=0.0).sum() > 1.01 * (-up).clip(min=0.0).sum())


def _view(points: Array, side: float, width: int, *, above: bool) -> View:
    """Return a view from a side along x, from above, or with z down."""
    if above:
        return view_of(points, towards=(side, -1.0, 0.75), width=width, up=UP_Z)
    return view_of(points, towards=(side, 1.0, -0.75), width=width)


def _contact_sheet(
    target: Path, experiment: Experiment, title: str, *, above: bool
) -> None:
    """Draw the part deformed by each unit wrench: displacement above, von Mises stress below."""
    mesh = experiment.mesh
    motion = experiment.displacement
    stress = experiment.von_mises
    size = np.linalg.norm(motion, axis=2)  # (6n, nodes)
    diagonal = float(np.linalg.norm(np.ptp(mesh.points, axis=0)))
    scales = DEFORMATION * diagonal / size.max(axis=1)
    shapes = [mesh.points + scale * u for scale, u in zip(scales, motion, strict=True)]
    view = _view(np.vstack([mesh.points, *shapes]), 0.55, 900, above=above)
    rest, *loaded = experiment.interfaces
    held = f", {rest} at rest" if len(loaded) > 1 else ""
    heading = f"{title} under unit wrenches{held}: displacement and von Mises stress"
    figure, cells = sheet_of(4 * len(loaded), 3, view.size, heading)
    kinds = (
        (size, "m", "displacement", "viridis"),
        (stress, "Pa", "von Mises stress", "inferno"),
    )
    plotter = _plot_still(mesh, view)
    for k, (name, (values, unit, word, colours), j) in enumerate(
        product(loaded, kinds, range(6))
    ):
        i = 6 * (k // 12) + j
        place = f" at {name}" if len(loaded) > 1 else ""
        limit, largest = _add_deformed(
            plotter, mesh, shapes[i], values[i], colours, view
        )
        image = snap(plotter)
        remark = f"deformation × {power(scales[i])}"
        fill(cells[k], image, f"{WRENCHES[j]} = {LOADS[j]}{place}   {word}", remark)
        scale_bar(cells[k], limit, largest, unit, colours)
    plotter.close()
    save_figure(figure, target, dpi=100)


def stressed_part(
    target: Path, experiment: str, field: str, node: int, title: str
) -> None:
    """Draw a part's von Mises stress under one load and mark its maximum.

    Parameters
    ----------
    target, title
        PNG file, and its title.
    experiment, field
        Files of the experiment, and of the nodal ``displacement`` and ``von_mises`` (VTU).
    node
        Node with the greatest stress.
    """
    import meshio

    mesh = load_experiment(experiment).mesh
    fields = meshio.read(field).point_data
    motion = fields["displacement"]
    stress = fields["von_mises"]
    size = np.ptp(mesh.points, axis=0)
    scale = (
        DEFORMATION * float(np.linalg.norm(size)) / np.linalg.norm(motion, axis=1).max()
    )
    bent = mesh.points + scale * motion
    beyond = mesh.points[node] > size / 2 + mesh.points.min(axis=0)
    _, y, z = np.where(beyond, 1.0, -1.0).tolist()
    view = view_of(
        np.vstack([mesh.points, bent]), towards=(0.55, y, 0.75 * z), width=1300
    )
    plotter = _plot_still(mesh, view)
    _add_deformed(plotter, mesh, bent, stress, "inferno", view, node)
    image = shot(plotter)
    figure, (cell,) = sheet_of(1, 1, view.size, title)
    remark = f"deformation × {power(scale)}"
    fill(cell, image, "von Mises stress, the ring is at its greatest", remark)
    scale_bar(cell, float(stress[node]), float(stress[node]), "Pa", "inferno")
    save_figure(figure, target, dpi=150)


def _plot_still(mesh: TetMesh, view: View) -> pv.Plotter:
    """Return a plotter with the undeformed part, pale."""
    plotter = new_plotter(view)
    still = surface(mesh, mesh.points)
    plotter.add_mesh(still, color="#9aa4b0", opacity=0.10, lighting=False)
    plotter.add_mesh(outline(mesh, mesh.points), color="#7a8594", line_width=1.5)
    plotter.add_silhouette(still, color="#7a8594", line_width=1.5)
    return plotter


def _add_deformed(
    plotter: pv.Plotter,
    mesh: TetMesh,
    points: Array,
    values: Array,
    colours: str,
    view: View,
    node: int | None = None,
) -> tuple[float, float]:
    """Add a deformed part in place of the last; return colour limit and largest value.

    ``node`` is marked with a ring.
    """
    largest = limit = float(values.max())
    if node is not None:
        limit = float(values[node])
    elif colours == "inferno":
        limit = float(np.quantile(values[np.unique(mesh.facets)], 0.995))
    skin = surface(mesh, points)
    skin["value"] = values
    plotter.add_mesh(
        skin,
        name="skin",
        scalars="value",
        cmap=colours,
        clim=(0.0, limit),
        smooth_shading=True,
        split_sharp_edges=True,
        feature_angle=40,
        show_scalar_bar=False,
        ambient=0.55,
        diffuse=0.5,
        render=False,  # else an open plotter draws at once
    )
    lines = outline(mesh, points + view.lift)
    plotter.add_mesh(lines, name="lines", color="#20252b", line_width=1.5, render=False)
    if node is not None:
        size = float(np.linalg.norm(np.ptp(mesh.points, axis=0)))
        towards = view.direction
        ring = pv.Disc(
            points[node] + size * towards, 0.017 * size, 0.02 * size, towards, c_res=48
        )
        plotter.add_mesh(ring, color="#00b4d8", lighting=False)
    return limit, largest


def _tagged_mesh(
    target: Path,
    experiment: Experiment,
    title: str,
    faces: dict[str, list[int]],
    *,
    above: bool,
) -> None:
    """Draw the mesh from both ends, its interfaces in colours."""
    mesh = experiment.mesh
    several = len(faces) > 2
    views = [_view(mesh.points, side, 1100, above=above) for side in (0.55, -0.9)]
    counts = f"{len(mesh.cells):,} quadratic tetrahedra, {len(mesh.points):,} nodes"
    figure, cells = sheet_of(1, 2, views[0].size, f"{title}: {counts}")
    along = (experiment.reference_points[0] - experiment.clamp_point)[0] > 0.0
    ends = ("seen from the loaded end", "seen from the clamped end")
    tagged = [np.isin(mesh.facet_face, face) for face in faces.values()]
    tagged.append(~np.any(tagged, axis=0))
    colours = [*islice(cycle(INTERFACES), len(faces)), FREE]
    for view, cell, heading in zip(
        views, cells, ends if along and not several else ("", ""), strict=True
    ):
        plotter = new_plotter(view)
        for chosen, colour in zip(tagged, colours, strict=True):
            if chosen.any():
                some = surface(mesh, mesh.points, chosen)
                plotter.add_mesh(some, color=colour, ambient=0.5, diffuse=0.55)
        plotter.add_mesh(
            sides(mesh, mesh.points + view.lift), color="#3c4650", line_width=0.9
        )
        edges = outline(mesh, mesh.points + 2 * view.lift)
        plotter.add_mesh(edges, color="#14181c", line_width=2.2)
        fill(cell, shot(plotter), heading)
    labels = [*faces] if several else ["clamped", f"loaded ({experiment.interface})"]
    meanings = zip(colours, (*labels, "free"), strict=True)
    handles = [
        Patch(facecolor=c, edgecolor="#3c4650", label=label) for c, label in meanings
    ]
    figure.legend(
        handles=handles,
        loc="lower left",
        ncols=len(handles),
        frameon=False,
        fontsize=11,
    )
    save_figure(figure, target, dpi=100)
