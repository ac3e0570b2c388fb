"""Validity of a solid for meshing: one closed solid of positive volume, not self-intersecting."""

from collections.abc import Callable

import numpy as np

from stiffscope.cad import kernel
from stiffscope.cad.kernel import Shape, Solid
from stiffscope.cad.part import open_edges, tessellate
from stiffscope.errors import InputError

SMALLEST = 1.0
LARGEST = 40e3  # mm: bounding box diagonal; outside, the unit is probably wrong
FARTHEST = 1e7  # mm: a coordinate; farther away, meshes lack digits
THINNEST = 0.01  # mm: twice the volume over the area, a sheet's thickness; thinner ones cannot be meshed


def valid_solid(shape: Shape, name: str) -> Solid:
    """Return the single solid of a shape, with outward normals.

    A valid shape is exactly one solid without loose faces, whose faces meet only at their borders,
    consistent, closed, of positive volume, of a size between `SMALLEST` and `LARGEST`, nowhere beyond
    `FARTHEST`, and of a mean thickness of at least `THINNEST`.
    Self-intersection of a face is detected if it is free-form, not if it is a whole spindle torus.

    Lengths in mm. Raises InputError, which names the part or file and what was found.
    """

    def refuse(found: str, valid: str = "one closed solid") -> InputError:
        return InputError(f"{name}: expected {valid}, found {found}")

    found, faces = kernel.solids(shape), kernel.faces(shape)
    if len(found) > 1:
        what = f"an assembly of {len(found)} solids"
        raise refuse(what, "one solid (fuse them or export one of them)")
    if not found:
        surface = f"a surface without volume ({len(faces)} face(s) that bound no solid)"
        raise refuse(surface if faces else "no solid and no face")
    solid = found[0]
    loose = len(faces) - len(kernel.faces(solid))
    if loose:
        raise refuse(
            f"{loose} loose face(s) beside the solid", "one solid and nothing else"
        )
    farthest = np.abs([kernel.position(each) for each in kernel.vertices(solid)]).max(
        initial=0.0
    )
    if not farthest <= FARTHEST:  # nor a number
        raise refuse(
            f"{farthest:.3g} mm",
            f"a solid whose coordinates are numbers of at most {FARTHEST:g} mm",
        )
    size = kernel.diagonal(solid)
    if not SMALLEST <= size <= LARGEST:
        valid = f"a solid {SMALLEST:g} to {LARGEST:g} mm large (check its units)"
        raise refuse(f"{size:.3g} mm", valid)
    if kernel.self_intersects(solid):
        raise refuse(
            "a self-intersecting solid", "a solid whose faces meet only at their edges"
        )
    _check_closed(solid, refuse)
    solid = kernel.orient_solid(solid)
    volume = kernel.volume_properties(solid).Mass()
    if not (np.isfinite(volume) and volume > 1e-9 * size**3):
        raise refuse(
            f"a solid without volume ({volume:.3g} mm3)", "a solid of positive volume"
        )
    thickness = 2.0 * volume / kernel.area_properties(solid).Mass()
    if thickness < THINNEST:
        raise refuse(
            f"{thickness:.2g} mm", f"a solid at least {THINNEST:g} mm thick on average"
        )
    return solid


def _check_closed(solid: Solid, refuse: Callable[[str], InputError]) -> None:
    if not kernel.is_valid(solid):
        raise refuse(
            "a solid that the CAD kernel finds invalid (repair it, or export it again)"
        )
    gaps = open_edges(tessellate(solid, 5e-4, 0.8)[1])
    if gaps:
        raise refuse(f"a solid that is not watertight ({gaps} open edges)")
