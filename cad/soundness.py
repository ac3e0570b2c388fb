"""Is a shape one solid that can be meshed? What is not is refused with what was found and what would be valid."""

from typing import TYPE_CHECKING

import numpy as np

from stiffscope.errors import InputError

if TYPE_CHECKING:
    from stiffscope.cad.kernel import Shape, Solid

SMALLEST, LARGEST = 1.0, 40e3  # mm: a bounding box's diagonal beyond them means mistaken units


def sound_solid(shape: "Shape", name: str) -> "Solid":
    """Return the one solid that the shape is, oriented outwards; InputError names `name` when it is not sound.

    Sound: exactly one solid with no loose faces beside it, none of its faces meet but at their borders, valid to
    the kernel, closed, of positive volume and of a machine part's size. A face that crosses itself is
    seen where it is free-form, not where it is a whole torus turned over its own axis.
    """
    solid = _only_solid(shape, name)
    _refuse_odd_numbers(solid, name)
    _refuse_self_intersection(solid, name)
    _refuse_open(solid, name)
    return _outward(solid, name)


def _refuse(name: str, found: str, valid: str = "one closed solid") -> InputError:
    return InputError(f"{name}: expected {valid}, found {found}")


def _only_solid(shape: "Shape", name: str) -> "Solid":
    from stiffscope.cad import kernel

    found, faces = kernel.solids(shape), kernel.faces(shape)
    if len(found) > 1:
        raise _refuse(name, f"an assembly of {len(found)} solids", "one solid (fuse the parts or export one alone)")
    if not found and faces:
        raise _refuse(name, f"a surface without volume ({len(faces)} face(s) that bound no solid)")
    if not found:
        raise _refuse(name, "no solid and no face")
    loose = len(faces) - len(kernel.faces(found[0]))
    if loose:
        raise _refuse(name, f"{loose} loose face(s) beside the solid", "one solid and nothing else")
    return found[0]


def _refuse_odd_numbers(solid: "Solid", name: str) -> None:
    from stiffscope.cad import kernel

    if not all(np.isfinite(kernel.position(vertex)).all() for vertex in kernel.vertices(solid)):
        raise _refuse(name, "coordinates that are not finite", "a solid whose coordinates are numbers")
    size = kernel.diagonal(solid)
    if not SMALLEST <= size <= LARGEST:
        raise _refuse(name, f"{size:.3g} mm", f"a solid {SMALLEST:g} to {LARGEST:g} mm large (check its units)")


def _refuse_self_intersection(solid: "Solid", name: str) -> None:
    from stiffscope.cad import kernel

    if kernel.self_intersects(solid):
        raise _refuse(name, "a self-intersecting solid", "a solid whose faces meet only at their edges")


def _refuse_open(solid: "Solid", name: str) -> None:
    from stiffscope.cad import kernel
    from stiffscope.cad.part import open_edges, tessellated

    if not kernel.is_valid(solid):
        raise _refuse(name, "a torn solid that the CAD kernel finds invalid (export it anew, or heal it)")
    gaps = open_edges(tessellated(solid, 5e-4, 0.8)[1])
    if gaps:
        raise _refuse(name, f"a solid that is not watertight ({gaps} open edges)")


def _outward(solid: "Solid", name: str) -> "Solid":
    from stiffscope.cad import kernel

    solid = kernel.oriented(solid)
    volume = kernel.volume_properties(solid).Mass()
    if not (np.isfinite(volume) and volume > 1e-9 * kernel.diagonal(solid) ** 3):
        raise _refuse(name, f"a solid without volume ({volume:.3g} mm3)", "a solid of positive volume")
    return solid
