"""A part as plain numbers, independent of the CAD kernel, and its mesh."""

from __future__ import annotations

import logging
import time
from dataclasses import dataclass
from functools import cached_property
from itertools import repeat
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.cad.faces import centroid_of
from stiffscope.fea.extrusion import (
    Extrusion,
    find_extrusion,
    has_thin_walls,
    mesh_extrusion,
)
from stiffscope.fea.geometry import area_elements, centroid, jacobian_range, volume
from stiffscope.fea.mesh import (
    ENERGY,
    Floats,
    MeshError,
    Project,
    TetMesh,
    check_time,
    default_envelope,
    default_size,
    diagonal,
    edge_length,
    expected_elements,
    face_area,
    flatness_of,
    tetrahedralize,
)
from stiffscope.fea.refine import grade
from stiffscope.fea.singular import singular_edges
from stiffscope.fea.snap import snap

if TYPE_CHECKING:
    from stiffscope.cad.part import Surface

logger = logging.getLogger(__name__)

ATTEMPTS = 3
PATIENCE = 5.0  # most meshes tried, and seconds after which no more are tried
CLOSER = 3.0  # ratio of successive envelopes; one larger than a step's height may lose the step
GOOD_SHAPE = 3e-5
LOST = 0.01  # of an interface's area: smaller faces of it may have no triangles

GRADING_RATIO = (
    0.25  # a cut at a quarter reduces the error three times as much as one at half
)
USUAL_BOUND = (
    4e-3  # relative; typical bound, about twice that of plain parts of usual size
)
COARSEST = 1.6  # times the usual size; beyond, meshes do not have fewer elements


@dataclass(frozen=True)
class Specimen:
    """Geometry, material, clamped and loaded faces of a part, as plain numbers.

    Attributes
    ----------
    project : ``project(place, points)``: closest points on a CAD face or, after these, a seam, m.
    elasticity : (6, 6) Pa, Voigt order xx, yy, zz, yz, xz, xy.
    clamped : CAD faces that are fixed.
    loaded : (CAD faces, reference point) of each loaded interface.
    volume, density : volume, m³; density, kg/m³.
    names : names of the clamp and of the loaded interfaces.
    couplings : "rigid" or "distributed" for each loaded interface; empty: that of the settings.
    """

    name: str
    surface: Surface
    project: Project
    elasticity: Floats
    clamped: frozenset[int]
    loaded: tuple[tuple[frozenset[int], Floats], ...]
    volume: float
    density: float
    names: tuple[str, ...] = ("base", "tip")
    couplings: tuple[str, ...] = ()

    @cached_property
    def extrusion(self) -> Extrusion | None:
        """The solid as a sheet, needle or thin-walled bar (``fea.extrusion``), or None."""
        return find_extrusion(self.surface, self.held_faces)

    @property
    def slender(self) -> bool:
        """Whether the solid is such an extrusion."""
        return self.extrusion is not None

    @property
    def area(self) -> float:
        """Area of the surface, m²."""
        return face_area(self.surface.faces)

    @property
    def flatness(self) -> float:
        """Above 1 for thin walls with flat elements; see ``stiffscope.fea.mesh.flatness_of``."""
        return flatness_of(self.volume, self.surface.faces)

    def flatness_on(self, mesh: TetMesh) -> float:
        """Return the aspect ratio of a mesh's elements, up to 2; 1 up to the wall thickness."""
        walled = self.extrusion is not None and has_thin_walls(
            self.surface, self.extrusion
        )
        most = 2.0 if walled else self.flatness
        return float(
            np.clip(edge_length(mesh) / default_size(self.volume, self.area), 1.0, most)
        )

    @property
    def slenderness(self) -> float:
        """Bounding box diagonal over twice volume per area (a plate's thickness)."""
        return diagonal(self.surface) * self.area / (2 * self.volume)

    @property
    def interfaces(self) -> tuple[frozenset[int], ...]:
        """Faces of the clamp and of each loaded interface."""
        return self.clamped, *(faces for faces, _ in self.loaded)

    @property
    def held_faces(self) -> frozenset[int]:
        """Faces of all interfaces."""
        return frozenset[int]().union(*self.interfaces)

    def list_fixed(self, *, rigid: bool) -> tuple[frozenset[int], ...]:
        """Return the undeformable interfaces: the clamp, and rigidly coupled loaded faces."""
        kinds = self.list_couplings("rigid" if rigid else "distributed")
        loaded = zip(self.interfaces[1:], kinds, strict=True)
        return self.clamped, *(faces for faces, kind in loaded if kind == "rigid")

    def list_couplings(self, usual: str) -> tuple[str, ...]:
        """Return the coupling of each loaded interface; ``usual`` if it has none of its own."""
        if not self.couplings:
            return tuple(repeat(usual, len(self.loaded)))
        return tuple(own or usual for own in self.couplings)


def mesh_specimen(
    specimen: Specimen,
    *,
    size: float | None = None,
    envelope: float | None = None,
    layers: int = 1,
    rigid: bool = True,
    time_limit: float = 300.0,
    threads: int = 0,
    patience: float = PATIENCE,
    tolerance: float | None = None,
) -> TetMesh:
    """Return a specimen's quadratic mesh, snapped to its CAD surface and graded at singular edges.

    Parameters
    ----------
    specimen
        Part with its clamped and loaded faces.
    size
        Edge length of the elements (m); None chooses it from the part and the tolerance.
    envelope
        Largest distance of the mesh from the surface (m); None chooses it from the surface.
    layers
        Layers of smaller elements along singular edges; more are finer.
    rigid
        Whether the loaded faces move rigidly, so that their borders are singular, too.
    time_limit
        Seconds after which the mesher is stopped.
    threads
        Threads of the mesher; 0 takes all cores.
    patience
        Seconds after which no further attempt at a better geometry starts.
    tolerance
        Allowed relative error of the solution; a larger one chooses larger elements.

    Raises
    ------
    MeshError : time limit exceeded, inverted elements, an empty interface, or a wrong volume.
    """

    def check(elements: float) -> None:
        check_time(elements, time_limit, cure_of(specimen, size), meshed=True)

    flat = None
    solid = (specimen.surface, specimen.project)
    if specimen.extrusion and not envelope:
        flat = mesh_extrusion(
            surface=solid[0],
            found=specimen.extrusion,
            interfaces=specimen.held_faces,
            project=solid[1],
            size=size,
            check=check,
        )
    if flat is not None:
        mesh = snap(flat.points, flat.cells, *solid, flat.size, flat.tags)
        _check(specimen, mesh)
    else:
        coarser = (
            (tolerance / USUAL_BOUND) ** 0.5 if tolerance else 1.0
        )  # the bound grows as size²
        usual = default_size(specimen.volume, specimen.area, specimen.flatness)
        size = size or usual * min(COARSEST, max(1.0, coarser))
        envelope = envelope or default_envelope(specimen.surface, size)
        elements = expected_elements(specimen.surface, specimen.volume, size)
        check_time(elements, time_limit, cure_of(specimen, size))
        mesh = _best_mesh(
            specimen=specimen,
            size=size,
            envelope=envelope,
            time_limit=time_limit,
            threads=threads,
            patience=patience,
        )
    edges, _ = singular_edges(mesh, specimen.list_fixed(rigid=rigid))
    graded = grade(mesh, edges, layers, GRADING_RATIO)
    logger.info(
        "%s: %d nodes, %d tetrahedra",
        specimen.name,
        len(graded.points),
        len(graded.cells),
    )
    return graded


def cure_of(specimen: Specimen, size: float | None = None) -> str:
    """Return advice for fewer elements: a larger size (m), or no small holes if they dominate."""
    size = size or default_size(specimen.volume, specimen.area, specimen.flatness)
    fewer, count = (
        expected_elements(specimen.surface, specimen.volume, length)
        for length in (COARSEST * size, size)
    )
    if fewer < 0.6 * count:
        larger = f"{1e3 * COARSEST * size:.2g} mm"
        return f"choose mesh.size = {larger} or more, or mesh.tolerance = '1 %'"
    return "remove small holes, fillets and threads from the part"


def _best_mesh(
    specimen: Specimen,
    size: float,
    envelope: float,
    time_limit: float,
    threads: int,
    patience: float,
) -> TetMesh:
    """Return the first mesh of good geometry, or the best of a few: fTetWild's results vary."""
    begun = time.perf_counter()
    tried: list[tuple[float, TetMesh]] = []
    for attempt in range(ATTEMPTS):
        left = max(time_limit - (time.perf_counter() - begun), 1.0)
        usable = any(np.isfinite(error) for error, _ in tried)
        limit = min(left, 4 * patience) if usable else left
        try:
            closer = envelope / CLOSER**attempt
            energy = ENERGY * specimen.flatness
            points, cells = tetrahedralize(
                surface=specimen.surface,
                size=size,
                envelope=closer,
                time_limit=limit,
                threads=threads,
                energy=energy,
            )
        except MeshError:
            if tried:
                break
            raise
        mesh = snap(points, cells, specimen.surface, specimen.project, size)
        tried.append((shape_error(specimen, mesh), mesh))
        late = time.perf_counter() - begun > patience
        if tried[-1][0] < GOOD_SHAPE or (late and np.isfinite(tried[-1][0])):
            break  # without a whole interface a mesh is of no use, however late
        logger.info(
            "%s: geometric error %.1e, meshing once more", specimen.name, tried[-1][0]
        )
    best = min(tried, key=lambda one: one[0])[1]
    _check(specimen, best)
    return best


def shape_error(specimen: Specimen, mesh: TetMesh) -> float:
    """Return the sum of relative errors of volume, area and interfaces of the mesh."""
    return geometric_error(specimen, mesh) + sum(interface_error(specimen, mesh))


def geometric_error(specimen: Specimen, mesh: TetMesh) -> float:
    """Return the sum of relative errors of volume and area of the mesh."""
    area = float(face_areas(mesh, len(specimen.surface.faces)).sum())
    solid = volume(mesh.points, mesh.cells)
    return abs(solid / specimen.volume - 1) + abs(area / specimen.area - 1)


def interface_error(specimen: Specimen, mesh: TetMesh) -> tuple[float, float]:
    """Return the largest relative error of interface area, and of centroid over interface size.

    Both are infinite if faces of more than ``LOST`` of an interface's area have no triangles.
    """
    areas = face_areas(mesh, len(specimen.surface.faces))
    worst = np.zeros(2)
    for interface in specimen.interfaces:
        numbers = sorted(interface)
        faces = [specimen.surface.faces[number] for number in numbers]
        wanted = face_area(faces)
        lost = face_area(
            [face for face, area in zip(faces, areas[numbers], strict=True) if not area]
        )
        if lost > LOST * wanted:
            return np.inf, np.inf
        centre = centroid(mesh.points[mesh.facets_of(interface)])
        shift = np.linalg.norm(centre - centroid_of(faces)) / np.sqrt(wanted)
        worst = np.maximum(worst, [abs(areas[numbers].sum() / wanted - 1), shift])
    return float(worst[0]), float(worst[1])


def face_areas(mesh: TetMesh, count: int) -> Floats:
    """Return the area (count,), m², of each CAD face on the mesh."""
    areas = area_elements(mesh.points[mesh.facets]).sum(axis=1)
    return np.bincount(mesh.facet_face, areas, count).astype(float)


def _check(specimen: Specimen, mesh: TetMesh) -> None:
    inverted = int((jacobian_range(mesh.points[mesh.cells]) <= 0).sum())
    if inverted:
        what = f"{inverted} elements of {specimen.name} are inverted"
        raise MeshError(f"mesh: {what}; choose a smaller size")
    if not np.isfinite(interface_error(specimen, mesh)).all():
        face = min(specimen.held_faces.difference(mesh.facet_face.tolist()))
        at = ", ".join(f"{1e3 * x:.4g}" for x in specimen.surface.faces[face].centroid)
        what = f"face {face} of {specimen.name}, at ({at}) mm, has no triangles"
        raise MeshError(f"mesh: {what}; choose a smaller size")
    off = volume(mesh.points, mesh.cells) / specimen.volume - 1
    if abs(off) > 0.01:
        what = f"the volume of {specimen.name} is {off:.1%} off"
        raise MeshError(f"mesh: {what}; choose a smaller size or envelope")
