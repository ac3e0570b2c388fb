"""Assemblies of build123d: their solids, as those of STEP files, and their connected joints.

Slow to import, like `stiffscope.cad.kernel`. Lengths of build123d are in mm.
"""

# pyright: reportAttributeAccessIssue=false
from dataclasses import dataclass
from typing import Any

import numpy as np
from OCP.TopLoc import TopLoc_Location

from stiffscope.cad import kernel
from stiffscope.cad.assembly import Instance, gather_solids, place_solids
from stiffscope.cad.kernel_files import PlacedProduct
from stiffscope.errors import InputError
from stiffscope.runtime.types import Array

_KINDS = {
    "RigidJoint": "fixed",
    "RevoluteJoint": "revolute",
    "LinearJoint": "prismatic",
    "CylindricalJoint": "cylindrical",
    "BallJoint": "spherical",
}


@dataclass(frozen=True, eq=False)
class BuiltJoint:
    """Two connected joints: indices of their solids, and the free motion of each.

    ``motions``: for each joint its kind as in a robot file, place (3,) in m and axis (3,).
    """

    first: int
    second: int
    label: str
    motions: tuple[tuple[str, Array, Array], ...]


def read_built(
    assembly: Any, shown: str, left_out: list[str]
) -> tuple[tuple[Instance, ...], list[BuiltJoint]]:
    """Return the solids of a build123d assembly, named by their labels, and their connected joints.

    ``assembly``: Compound of solids and compounds, at any depth; ``shown``: its name in messages;
    ``left_out`` receives a line for each kind of content that was not read. Raises InputError if it
    is not an assembly, or contains no closed solid.
    """
    if getattr(assembly, "wrapped", None) is None or not hasattr(assembly, "leaves"):
        got = type(assembly).__name__
        raise InputError(f"{shown}: expected a build123d Compound of solids, got {got}")
    leaves = [leaf for leaf in assembly.leaves if leaf.wrapped]
    numbers = kernel.Numbering()
    products = [_read_leaf(leaf, numbers) for leaf in leaves]
    for each in products:
        if not np.isfinite(each.place).all():
            what = f'"{each.path[-1]}" at infinity; give connect_to of a LinearJoint a position'
            raise InputError(f"{shown}: expected solids at places, got {what}")
    solids, told = gather_solids(products, shown)
    instances = place_solids(solids, told)
    left_out += told["left_out"]
    owners = [
        leaf
        for leaf, each in zip(leaves, products, strict=True)
        for _ in kernel.solids(each.shape)
    ]
    return instances, _read_joints(assembly, instances, owners, left_out)


def _read_leaf(leaf: Any, numbers: kernel.Numbering) -> PlacedProduct:
    shape = leaf.wrapped.Located(TopLoc_Location())
    return PlacedProduct(
        path=[node.label for node in leaf.path],
        product=numbers.number_shape(shape),
        shape=shape,
        place=_place_of(leaf.global_location)[:3].tolist(),
        material=str(getattr(leaf.material, "name", "")),
    )


def _place_of(location: Any) -> Array:
    """Return the matrix (4, 4) of a build123d Location; translation in mm."""
    return np.vstack(
        [kernel.rows_of(location.wrapped.Transformation(), 4), [0.0, 0.0, 0.0, 1.0]]
    )


def _read_joints(
    assembly: Any,
    instances: tuple[Instance, ...],
    owners: list[Any],
    left_out: list[str],
) -> list[BuiltJoint]:
    """Return the connected joints with both ends in the assembly."""
    joints = []
    for node in (assembly, *assembly.descendants):
        for name, joint in node.joints.items():
            if joint.connected_to is None:
                continue
            other = joint.connected_to
            label = f'{type(joint).__name__} "{name}" of {node.label or "a solid"}'
            first = _nearest(joint, node, instances, owners)
            second = _nearest(other, other.parent, instances, owners)
            if first is None or second is None or first == second:
                left_out.append(
                    f"{label}: connected to nothing else of the assembly: left out"
                )
                continue
            frames = [(type(end).__name__, _placed(end)) for end in (joint, other)]
            motions = tuple(
                (_KINDS[kind], 1e-3 * frame[:3, 3], frame[:3, 2])
                for kind, frame in frames
            )
            joints.append(BuiltJoint(first, second, label, motions))
    return joints


def _placed(joint: Any) -> Array:
    """Return a joint's frame (4, 4) in assembly axes."""
    above = joint.parent.parent
    frame = _place_of(joint.location)
    return frame if above is None else _place_of(above.global_location) @ frame


def _nearest(
    joint: Any, node: Any, instances: tuple[Instance, ...], owners: list[Any]
) -> int | None:
    """Return the solid of a joint: the nearest one of its node; None outside the assembly."""
    inside = [
        n for n, owner in enumerate(owners) if any(step is node for step in owner.path)
    ]
    if len(inside) < 2:
        return inside[0] if inside else None
    at = np.asarray(_placed(joint)[:3, 3], dtype=np.float64)
    return min(inside, key=lambda n: kernel.distance(instances[n].solid, at))
