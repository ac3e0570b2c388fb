"""STEP assemblies: named solids, their places and their materials.

A file is read in a subprocess with a time limit, as the kernel may crash or hang on it.
"""

import json
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope import cad
from stiffscope.cad.faces import FaceGeometry, face_geometries
from stiffscope.cad.step import check_file, check_unit, read_alone
from stiffscope.cad.turned import Turned, turned_form
from stiffscope.errors import InputError, say_count
from stiffscope.runtime.output import scratch_folder
from stiffscope.runtime.types import Array

if TYPE_CHECKING:
    from stiffscope.cad.kernel import Face, Solid
    from stiffscope.cad.kernel_files import PlacedProduct

TIME_LIMIT = 600.0  # s, for reading
_NAMELESS = (
    "SOLID",
    "COMPOUND",
    "PRODUCT",
    "NONE",
    "PART",
    "OPEN CASCADE",
    "=>[",
    "SHELL",
    "NAUO",
)
_SAME = 1e-7  # of the size: differences of solids that are one, moved
_TEXT, _USED, _DEFINED = (
    re.compile(rb"'[^']*'"),
    re.compile(rb"#(\d+)(?!\d*\s*=)"),
    re.compile(rb"#(\d+)\s*="),
)
_POINT = re.compile(
    rb"#(\d+)\s*=\s*(?:CARTESIAN_POINT|DIRECTION)\s*\(\s*''\s*,\s*\(([^()]*)\)"
)
_THREE = re.compile(
    rb"(?:\s*[+-]?\d+\.?\d*(?:[eE](?:-\d+|\+?0*\d\d?))?\s*(?:,|$)){3}(?<!,)"
)
_PLACED = re.compile(rb"\b(?:AXIS2_PLACEMENT_3D|VERTEX_POINT)\s*\(\s*''\s*,([^()]*)\)")
_HOLDS = re.compile(
    rb"\bNEXT_ASSEMBLY_USAGE_OCCURRENCE\s*\((?:\s*(?:''|\$)\s*,){3}\s*#(\d+)\s*,\s*#(\d+)"
)
_EXTERNAL = re.compile(
    rb"\bDOCUMENT_FILE\s*\(\s*'([^']+\.(?:stp|step|p21))'", re.IGNORECASE
)
_SOLID = re.compile(rb"=\s*(?:MANIFOLD_SOLID_BREP|BREP_WITH_VOIDS|FACETED_BREP)\b")


@dataclass(frozen=True, eq=False)
class Product:
    """A solid shared by one or more instances, in its own axes.

    Attributes
    ----------
    number : index in the file.
    solid : solid of the CAD kernel, mm.
    material : material name in the file, or "".
    volume, centre, inertia : volume, m³; centre (3,), m; inertia (3, 3) about the centre for a
        density of 1, m⁵.
    """

    number: int
    solid: "Solid"
    material: str
    volume: float
    centre: Array
    inertia: Array

    @cached_property
    def faces(self) -> tuple[FaceGeometry, ...]:
        """Faces in the product's own axes, SI."""
        return face_geometries(self.solid)

    @cached_property
    def form(self) -> Turned | None:
        """The solid as a turned part; None without round faces."""
        return turned_form(self.faces, cad.kernel.faces(self.solid))


@dataclass(frozen=True, eq=False)
class Instance:
    """A product at its place: unique name, rotation (3, 3) and position of its origin (3,), m."""

    name: str
    product: Product
    rotation: Array
    origin: Array

    @property
    def centre(self) -> Array:
        """Centroid of the volume (3,), m."""
        return self.rotation @ self.product.centre + self.origin

    @property
    def inertia(self) -> Array:
        """Inertia (3, 3) about the centre for a density of 1, m⁵, assembly axes."""
        return self.rotation @ self.product.inertia @ self.rotation.T

    def place_axis(self, form: Turned) -> tuple[Array, Array]:
        """Return point and axis (3,) of the form at the instance's place."""
        return self.rotation @ form.point + self.origin, self.rotation @ form.axis

    @cached_property
    def solid(self) -> "Solid":
        """The solid at its place, mm."""
        return cad.kernel.place_solid(
            self.product.solid, self.rotation, 1e3 * self.origin
        )

    @cached_property
    def box(self) -> Array:
        """Smallest and largest coordinates (2, 3), m."""
        return 1e-3 * cad.kernel.bounds(self.solid)

    @cached_property
    def faces(self) -> tuple[FaceGeometry, ...]:
        """Faces at the instance's place."""
        return tuple(
            face.move(self.rotation, self.origin) for face in self.product.faces
        )

    @cached_property
    def shapes(self) -> "list[Face]":
        """Faces of the CAD kernel at the instance's place, mm."""
        return cad.kernel.faces(self.solid)

    @cached_property
    def face_boxes(self) -> Array:
        """Smallest and largest coordinates of each face (n, 2, 3), m."""
        return 1e-3 * np.array([cad.kernel.bounds(face) for face in self.shapes])


def read_assembly(
    path: str | Path, left_out: list[str] | None = None
) -> tuple[Instance, ...]:
    """Return the solids of a STEP file, in its order, with their names and places.

    The file (AP203, AP214, AP242) contains one or more solids, in any unit of length; ``left_out``
    receives a line for each kind of content that was not read. Unnamed solids: "solid1", "solid2",
    …; equal names are numbered. Raises InputError, which states what was found and expected, if the
    file contains no closed solid.
    """
    path = Path(path)
    content = check_file(path)
    _check_references(path, content)
    with scratch_folder() as folder:
        read_alone(
            _write_solids, path, folder, TIME_LIMIT, "a STEP file of closed solids"
        )
        check_unit(path, content)
        told = json.loads((folder / "assembly.json").read_text())
        solids = cad.kernel.children(cad.kernel_files.read_any(folder / "solids.brep"))
    there = len(_SOLID.findall(content))
    lost = there - len(solids)
    if 0 < there < len(solids):
        why = "as edges or points of more than two faces part them"
        what = f"{there} that fall into {len(solids)}, {why}"
        raise InputError(f"{path}: expected manifold solids, got {what}")
    if left_out is not None:
        if lost > 0:
            left_out += [f"{lost} of its solids could not be read: left out"]
        left_out += told["left_out"]
    return place_solids(solids, told)


def place_solids(
    solids: "Sequence[Solid]", told: dict[str, Any]
) -> tuple[Instance, ...]:
    """Create instances of solids from the table made by `gather_solids`."""
    products = []
    instances = []
    for number, (solid, each) in enumerate(zip(solids, told["products"], strict=True)):
        properties = cad.kernel.volume_properties(solid)
        centre = 1e-3 * cad.kernel.xyz(properties.CentreOfMass())
        inertia = 1e-15 * cad.kernel.inertia(properties)
        volume = 1e-9 * properties.Mass()
        products.append(
            Product(
                number=number,
                solid=solid,
                material=each["material"],
                volume=volume,
                centre=centre,
                inertia=inertia,
            )
        )
    names = _name_distinct([instance["path"] for instance in told["instances"]])
    for name, each in zip(names, told["instances"], strict=True):
        place = np.array(each["place"])
        product = products[each["product"]]
        instances.append(Instance(name, product, place[:, :3], 1e-3 * place[:, 3]))
    return _share_products(instances)


def _share_products(instances: Sequence[Instance]) -> tuple[Instance, ...]:
    """Let solids that differ only by a translation share one product.

    Programs that write each part where it stands repeat the solid, and each would be tested.
    """
    first = dict[tuple[str, int, int], list[Product]]()
    taken = dict[int, Product]()
    shared = list[Instance]()
    for instance in instances:
        own = instance.product
        if own.number not in taken:
            size = round(
                3e3 * np.log(own.volume)
            )  # equal volumes share it, nearly always
            alike = first.setdefault((own.material, len(own.faces), size), [])
            same = next((one for one in alike if _is_translated(one, own)), own)
            taken[own.number] = same
            if same is own:
                alike.append(own)
        product = taken[own.number]
        origin = instance.origin + instance.rotation @ (own.centre - product.centre)
        shared.append(replace(instance, product=product, origin=origin))
    return tuple(shared)


def _is_translated(product: Product, other: Product) -> bool:
    """Return whether two products have the same faces, in order, about their centres."""
    size = product.volume ** (1 / 3)
    if not np.allclose(product.inertia, other.inertia, rtol=0.0, atol=_SAME * size**5):
        return False
    for one, two in zip(product.faces, other.faces, strict=True):
        gap = one.centroid - product.centre - (two.centroid - other.centre)
        if (
            one.kind != two.kind
            or one.hollow != two.hollow
            or abs(one.area - two.area) > _SAME * size**2
            or abs(one.radius - two.radius) > _SAME * size
            or np.abs(gap).max() > _SAME * size
        ):
            return False
    return True


def _check_references(path: Path, content: bytes) -> None:
    """Refuse a file with missing entities, missing coordinates, or a product within itself.

    The kernel silently omits or misplaces such products. Referenced STEP files must be beside it.
    """
    bare = _TEXT.sub(b"''", content)
    missing = {*_USED.findall(bare)} - {*_DEFINED.findall(bare)}
    if missing:
        first = min(missing, key=int).decode()
        what = f"{len(missing)} of its entities are missing (#{first})"
        raise InputError(f"{path}: expected a whole STEP file, got one of which {what}")
    odd = {
        name: numbers
        for name, numbers in _POINT.findall(bare)
        if not _THREE.fullmatch(numbers)
    }
    placed = (
        name for places in _PLACED.findall(bare) for name in _USED.findall(places)
    )
    for name in filter(odd.__contains__, placed):
        got = f"({odd[name].decode(errors='replace')})"
        raise InputError(
            f"{path}: #{name.decode()}: expected three coordinates in space, got {got}"
        )
    holds = dict[bytes, set[bytes]]()
    for whole, part in _HOLDS.findall(bare):
        holds.setdefault(whole, set()).add(part)
    try:
        TopologicalSorter(holds).prepare()
    except CycleError as error:
        chain = " in ".join(f"#{arg.decode()}" for arg in error.args[1])
        what = f"expected a tree of products, got one within itself ({chain})"
        raise InputError(f"{path}: {what}") from error
    for match in _EXTERNAL.finditer(content):
        name = match[1].decode(errors="replace")
        if not (path.parent / name.replace("\\", "/")).is_file():
            got = f'got none called "{name}"'
            raise InputError(
                f"{path}: expected the files that it refers to beside it, {got}"
            )


def _name_distinct(paths: Sequence[Sequence[str]]) -> list[str]:
    """Name instances from the names on their paths: last name, with its assembly's, or a number."""
    paths = [_cut_path(path) for path in paths]
    last_names = [("" if _is_nameless(path[-1]) else path[-1]) for path in paths]
    for depth in range(2, max(map(len, paths), default=0) + 1):
        doubled = {name for name in last_names if last_names.count(name) > 1 and name}
        named = (
            [part for part in path[-depth:] if not _is_nameless(part)] for path in paths
        )
        again = [
            ".".join(parts) if name in doubled and len(path) > depth else name
            for name, parts, path in zip(last_names, named, paths, strict=True)
        ]
        if len(set(again)) > len(set(last_names)):
            last_names = again
    distinct = []
    counted = dict[str, int]()
    for name in last_names:
        base = name or "solid"
        counted[base] = counted.get(base, 0) + 1
        distinct.append(
            base if last_names.count(name) == 1 and name else f"{base}{counted[base]}"
        )
    if len(set(distinct)) < len(distinct):
        distinct = [f"{name}_{number}" for number, name in enumerate(distinct, 1)]
    return distinct


def _cut_path(path: Sequence[str]) -> Sequence[str]:
    """Return a path up to its last name below the root: a nameless solid is its product."""
    ends = (end for end in range(len(path), 1, -1) if not _is_nameless(path[end - 1]))
    return path[: next(ends, 2)]


def _is_nameless(name: str) -> bool:
    return not name or name.upper().startswith(_NAMELESS)


def _write_solids(path: Path, shown: str, folder: Path) -> None:
    """Read an assembly, called `shown` in messages; write its solids and a table to a folder."""
    solids, told = gather_solids(cad.kernel_files.read_products(path), shown)
    cad.kernel_files.write_binary(cad.kernel.compound(*solids), folder / "solids.brep")
    (folder / "assembly.json").write_text(json.dumps(told))


def gather_solids(
    placed_products: "Sequence[PlacedProduct]", shown: str
) -> "tuple[list[Solid], dict[str, Any]]":
    """Collect distinct leaf solids, `shown` in messages, and a table of them and their places."""
    products = []
    instances = []
    numbers = dict[tuple[int, int], int]()
    solids: list[Any] = []
    loose = list[str]()
    whole = {
        (*_cut_path(each.path),)
        for each in placed_products
        if cad.kernel.solids(each.shape)
    }
    for each in placed_products:
        shapes = cad.kernel.solids(each.shape)
        name = _cut_path(each.path)
        if not shapes and (name == each.path or (*name,) not in whole):
            loose.append(name[-1] or "one without a name")
        for index, solid in enumerate(shapes):
            key = each.product, index
            if key not in numbers:
                if not cad.kernel.is_valid(solid):
                    got = f'"{each.path[-1]}" with faulty faces or edges'
                    raise InputError(f"{shown}: expected valid solids, got {got}")
                numbers[key] = len(solids)
                solids.append(cad.kernel.orient_solid(solid))
                products.append({"material": each.material})
            instances.append(
                {"path": each.path, "product": numbers[key], "place": each.place}
            )
    if not instances:
        what = f"{_count_loose(loose)} (surfaces, wires or points)"
        got = what if loose else "none"
        raise InputError(f"{shown}: expected at least one closed solid, got {got}")
    alike = [
        f"{name} ({n} times)" if n > 1 else name for name, n in Counter(loose).items()
    ]
    listed = ", ".join(alike[:8]) + (
        f" and {len(alike) - 8} more" if len(alike) > 8 else ""
    )
    left_out = [f"{_count_loose(loose)} ({listed}): left out"] if loose else []
    return solids, {"products": products, "instances": instances, "left_out": left_out}


def _count_loose(loose: list[str]) -> str:
    return say_count(
        len(loose), "shape that is no closed solid", "shapes that are no closed solid"
    )
