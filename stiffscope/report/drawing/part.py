"""Pictures of a part deformed by six unit wrenches, and of its mesh with its tagged faces."""

from __future__ import annotations

from typing import TYPE_CHECKING

import meshio
import numpy as np
import pyvista as pv
from matplotlib.patches import Patch

from stiffscope.fea.experiment import load_experiment
from stiffscope.report.drawing.camera import View, new_plotter, shot, view_of
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
CLAMPED, LOADED, FREE = "#1f5fa8", "#e08214", "#d9dde2"
DEFORMATION = 0.12  # largest drawn displacement over the part's diagonal


def part_pictures(
    folder: Path,
    experiment: str,
    title: str,
    clamped: list[int],
    loaded: list[int],
    sheet: str,
    mesh: str | None = None,
) -> None:
    """Draw a part's deformations and, if a file is given, its mesh.

    Parameters
    ----------
    folder
        Folder to write to.
    experiment
        File of the experiment.
    title
        Name of the part.
    clamped, loaded
        Indices of the CAD faces.
    sheet, mesh
        Names of the PNG files.
    """
    solved = load_experiment(experiment)
    _contact_sheet(folder / sheet, solved, title)
    if mesh:
        _tagged_mesh(folder / mesh, solved, title, clamped, loaded)


def _contact_sheet(target: Path, experiment: Experiment, title: str) -> None:
    """Draw the part deformed by each unit wrench: displacement above, von Mises stress below."""
    mesh, motion, stress = experiment.mesh, experiment.displacement[:6], experiment.von_mises[:6]
    size = np.linalg.norm(motion, axis=2)  # (6, nodes)
    diagonal = float(np.linalg.norm(np.ptp(mesh.points, axis=0)))
    scales = DEFORMATION * diagonal / size.max(axis=1)
    shapes = [mesh.points + scale * u for scale, u in zip(scales, motion, strict=True)]
    view = view_of(np.vstack([mesh.points, *shapes]), towards=(0.55, 1.0, -0.75), width=900)
    figure, cells = sheet_of(4, 3, view.size, f"{title} under unit wrenches: displacement and von Mises stress")
    for row, (values, unit, word, colours) in enumerate(
        ((size, "m", "displacement", "viridis"), (stress, "Pa", "von Mises stress", "inferno"))
    ):
        for j in range(6):
            image, limit, largest = _draw_deformed(mesh, shapes[j], values[j], colours, view)
            cell = cells[6 * row + j]
            fill(cell, image, f"{WRENCHES[j]} = {LOADS[j]}   {word}", f"deformation × {power(scales[j])}")
            scale_bar(cell, limit, largest, unit, colours)
    save_figure(figure, target, dpi=100)


def stressed_part(target: Path, experiment: str, field: str, node: int, title: str) -> None:
    """Draw a part's von Mises stress under one load and mark its maximum.

    Parameters
    ----------
    target
        PNG file.
    experiment, field
        Files of the experiment, and of the nodal ``displacement`` and ``von_mises`` (VTU).
    node
        Node with the greatest stress.
    title
        Title.
    """
    mesh, fields = load_experiment(experiment).mesh, meshio.read(field).point_data
    motion, stress = fields["displacement"], fields["von_mises"]
    scale = DEFORMATION * float(np.linalg.norm(np.ptp(mesh.points, axis=0))) / np.linalg.norm(motion, axis=1).max()
    bent = mesh.points + scale * motion
    _, y, z = np.where(mesh.points[node] > np.ptp(mesh.points, axis=0) / 2 + mesh.points.min(axis=0), 1.0, -1.0)
    view = view_of(np.vstack([mesh.points, bent]), towards=(0.55, float(y), 0.75 * float(z)), width=1300)
    image, _, _ = _draw_deformed(mesh, bent, stress, "inferno", view, node)
    figure, (cell,) = sheet_of(1, 1, view.size, title)
    fill(cell, image, "von Mises stress, the ring is at its greatest", f"deformation × {power(scale)}")
    scale_bar(cell, float(stress[node]), float(stress[node]), "Pa", "inferno")
    save_figure(figure, target, dpi=150)


def _draw_deformed(
    mesh: TetMesh, points: Array, values: Array, colours: str, view: View, node: int | None = None
) -> tuple[Array, float, float]:
    """Return the image of a deformed part, colour limit and largest value; mark ``node``."""
    largest = float(values.max())
    limit = float(np.quantile(values[np.unique(mesh.facets)], 0.995)) if colours == "inferno" else largest
    limit = limit if node is None else float(values[node])
    plotter = new_plotter(view)
    still = surface(mesh, mesh.points)
    plotter.add_mesh(still, color="#9aa4b0", opacity=0.10, lighting=False)
    plotter.add_mesh(outline(mesh, mesh.points), color="#7a8594", line_width=1.5)
    plotter.add_silhouette(still, color="#7a8594", line_width=1.5)
    skin = surface(mesh, points)
    skin["value"] = values
    plotter.add_mesh(
        skin, scalars="value", cmap=colours, clim=(0.0, limit), smooth_shading=True, split_sharp_edges=True,
        feature_angle=40, show_scalar_bar=False, ambient=0.55, diffuse=0.5,
    )  # fmt: skip
    plotter.add_mesh(outline(mesh, points + view.lift), color="#20252b", line_width=1.5)
    if node is not None:
        size = float(np.linalg.norm(np.ptp(mesh.points, axis=0)))
        ring = pv.Disc(points[node] + size * view.direction, 0.017 * size, 0.02 * size, view.direction, c_res=48)
        plotter.add_mesh(ring, color="#00b4d8", lighting=False)
    return shot(plotter), limit, largest


def _tagged_mesh(target: Path, experiment: Experiment, title: str, clamped: list[int], loaded: list[int]) -> None:
    """Draw the mesh from both ends with coloured clamped and loaded faces."""
    mesh = experiment.mesh
    views = [view_of(mesh.points, towards=(side, 1.0, -0.75), width=1100) for side in (0.55, -0.9)]
    counts = f"{len(mesh.cells):,} quadratic tetrahedra, {len(mesh.points):,} nodes"
    figure, cells = sheet_of(1, 2, views[0].size, f"{title}: {counts}")
    for view, cell, heading in zip(
        views, cells, ("seen from the loaded end", "seen from the clamped end"), strict=True
    ):
        plotter = new_plotter(view)
        for faces, colour in ((clamped, CLAMPED), (loaded, LOADED), (None, FREE)):
            chosen = np.isin(mesh.facet_face, clamped + loaded if faces is None else faces, invert=faces is None)
            if chosen.any():
                plotter.add_mesh(surface(mesh, mesh.points, chosen), color=colour, ambient=0.5, diffuse=0.55)
        plotter.add_mesh(sides(mesh, mesh.points + view.lift), color="#3c4650", line_width=0.9)
        plotter.add_mesh(outline(mesh, mesh.points + 2 * view.lift), color="#14181c", line_width=2.2)
        fill(cell, shot(plotter), heading)
    meanings = (CLAMPED, "clamped"), (LOADED, f"loaded ({experiment.interface})"), (FREE, "free")
    handles = [Patch(facecolor=colour, edgecolor="#3c4650", label=label) for colour, label in meanings]
    figure.legend(handles=handles, loc="lower left", ncols=len(handles), frameon=False, fontsize=11)
    save_figure(figure, target, dpi=100)
