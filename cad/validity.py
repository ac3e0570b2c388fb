"""Validity of a solid for meshing: one closed solid of positive volume, not self-intersecting."""

import numpy as np

from stiffscope.cad import kernel
from stiffscope.cad.kernel import Shape, Solid
from stiffscope.cad.part import open_edges, tessellate
from stiffscope.errors import InputError

SMALLEST, LARGEST = 1.0, 40e3  # mm: bounding box diagonal; outside, the unit is probably wrong


def valid_solid(shape: Shape, name: str) -> Solid:
    """Return the single solid of a shape, with outward normals.

    A valid shape is exactly one solid without loose faces, whose faces meet only at their borders,
    consistent, closed, of positive volume and of a size between `SMALLEST` and `LARGEST`.
    Self-intersection of a face is detected if it is free-form, not if it is a whole spindle torus.

    Parameters
    ----------
    shape
        Kernel shape, mm.
    name
        Name of the part or file for messages.

    Raises
    ------
    InputError
        If the shape is not a valid solid; the message reports what was found.
    """
    solid = _only_solid(shape, name)
    _check_coordinates(solid, name)
    _check_self_intersection(solid, name)
    _check_closed(solid, name)
    return _outward(solid, name)


def _invalid(name: str, found: str, valid: str = "one closed solid") -> InputError:
    return InputError(f"{name}: expected {valid}, found {found}")


def _only_solid(shape: Shape, name: str) -> Solid:
    found, faces = kernel.solids(shape), kernel.faces(shape)
    if len(found) > 1:
        raise _invalid(name, f"an assembly of {len(found)} solids", "one solid (fuse them or export one of them)")
    if not found and faces:
        raise _invalid(name, f"a surface without volume ({len(faces)} face(s) that bound no solid)")
    if not found:
        raise _invalid(name, "no solid and no face")
    loose = len(faces) - len(kernel.faces(found[0]))
    if loose:
        raise _invalid(name, f"{loose} loose face(s) beside the solid", "one solid and nothing else")
    return found[0]


def _check_coordinates(solid: Solid, name: str) -> None:
    if not all(np.isfinite(kernel.position(vertex)).all() for vertex in kernel.vertices(solid)):
        raise _invalid(name, "coordinates that are not finite", "a solid whose coordinates are numbers")
    size = kernel.diagonal(solid)
    if not SMALLEST <= size <= LARGEST:
        raise _invalid(name, f"{size:.3g} mm", f"a solid {SMALLEST:g} to {LARGEST:g} mm large (check its units)")


def _check_self_intersection(solid: Solid, name: str) -> None:
    if kernel.self_intersects(solid):
        raise _invalid(name, "a self-intersecting solid", "a solid whose faces meet only at their edges")


def _check_closed(solid: Solid, name: str) -> None:
    if not kernel.is_valid(solid):
        raise _invalid(name, "a solid that the CAD kernel finds invalid (repair it, or export it again)")
    gaps = open_edges(tessellate(solid, 5e-4, 0.8)[1])
    if gaps:
        raise _invalid(name, f"a solid that is not watertight ({gaps} open edges)")


def _outward(solid: Solid, name: str) -> Solid:
    solid = kernel.orient_solid(solid)
    volume = kernel.volume_properties(solid).Mass()
    if not (np.isfinite(volume) and volume > 1e-9 * kernel.diagonal(solid) ** 3):
        raise _invalid(name, f"a solid without volume ({volume:.3g} mm3)", "a solid of positive volume")
    return solid
