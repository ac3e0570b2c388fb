"""Reading parts from STEP files; writing parts as STEP and STL.

A file is read and checked in a subprocess with a time limit, as the kernel may crash or hang.
"""

import re
from codecs import BOM_UTF8
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from stiffscope import cad
from stiffscope.cad.materials import STEEL, AnyMaterial
from stiffscope.cad.part import Part, tessellate
from stiffscope.cad.solid import (
    GREATEST_X,
    LEAST_X,
    Placement,
    Selectors,
    Vector,
    part_of,
)
from stiffscope.errors import InputError, lacks_memory
from stiffscope.runtime.executor import KILLED, LateError, WorkerError, do_alone
from stiffscope.runtime.output import scratch_folder
from stiffscope.runtime.reading import read_bytes

if TYPE_CHECKING:
    from collections.abc import Callable

    from stiffscope.cad.kernel import Solid

START = b"ISO-10303-21"
END = b"END-ISO-10303-21"
_UNITS = 1e-9, 1e6  # smallest and largest unit, relative to its base unit
_NUMBER = re.compile(rb"[+-]?\d+\.?\d*([eE][+-]?\d+)?")
_UNIT, _NAME = re.compile(rb"\bLENGTH_UNIT\b"), re.compile(rb"(#\d+)\s*=")
_MEASURE = re.compile(
    rb"\bLENGTH_MEASURE_WITH_UNIT\s*\(\s*LENGTH_MEASURE\s*\(([^()]*)\)"
)
_CONTEXT = re.compile(rb"\bGLOBAL_UNIT_ASSIGNED_CONTEXT\s*\(\s*\(([^()]*)\)")


def read_step(
    path: str | Path,
    *,
    name: str | None = None,
    material: AnyMaterial = STEEL,
    clamped: Selectors = LEAST_X,
    loaded: Selectors | Mapping[str, Selectors] = GREATEST_X,
    interfaces: Mapping[str, Selectors] | None = None,
    couplings: Mapping[str, str] | None = None,
    placement: Placement | None = None,
    reference_point: Vector | None = None,
    time_limit: float = 60.0,
    chosen: int | str | None = None,
) -> Part:
    """Read the single solid of a STEP file, or the chosen one, in any unit of length, as a part.

    Parameters
    ----------
    path
        STEP file.
    name
        Name of the part; by default the file's name without its suffix.
    time_limit
        Time limit for reading and checking, s.
    chosen
        Of several solids, the number of one (the first is 1), or "all": fused, if they touch.
    material, clamped, loaded, interfaces, couplings, placement, reference_point
        As for `stiffscope.cad.solid.part_of`; by default the plane face
        with the smallest x is clamped, and the one with the largest x is loaded.

    Returns
    -------
    Part
        Solid with material, faces at rest and interfaces, in part axes.

    Raises
    ------
    InputError
        If the file contains no valid solid; the message states what was found and expected.
    """
    solid = read_solid(path, time_limit, chosen)
    return part_of(
        solid,
        name=name or Path(path).stem,
        material=material,
        clamped=clamped,
        loaded=loaded,
        interfaces=interfaces,
        couplings=couplings,
        placement=placement,
        reference_point=reference_point,
        valid=True,
    )


def read_solid(
    path: str | Path, time_limit: float = 60.0, chosen: int | str | None = None
) -> "Solid":
    """Return the single (or chosen) valid solid of a STEP file, mm, file coordinates.

    ``chosen`` as for `read_step`. Raises InputError.
    """
    content = check_file(Path(path))
    with scratch_folder() as folder:
        brep = folder / "solid.brep"
        read_alone(
            partial(_write_valid, chosen=chosen),
            Path(path),
            brep,
            time_limit,
            "a STEP file with one closed solid",
        )
        check_unit(Path(path), content)
        return cad.kernel_files.read_binary(brep)


def check_file(path: Path) -> bytes:
    """Return the content of a STEP file; refuse a truncated or other file."""
    content = read_bytes(path, "a STEP file")
    head = content[:4096]
    tail = content.rstrip()[-4096:]
    marked = head.startswith(BOM_UTF8)  # the kernel finds nothing behind it
    if marked or (START not in head and not START.startswith(head.strip())):
        begins = f"which begins with {START.decode()}"
        got = "a byte order mark" if marked else "another format"
        raise InputError(f"{path}: expected a STEP file, {begins}; found {got}")
    if END not in tail:
        found = (
            f"a truncated one ({len(content):,} bytes, no {END.decode()}; at its end)"
        )
        raise InputError(f"{path}: expected a whole STEP file, found {found}")
    _check_measures(path, content)
    return content


def _check_measures(path: Path, content: bytes) -> None:
    """Refuse invalid length units: the kernel would misinterpret them, or hang."""
    for measure in _MEASURE.finditer(content):
        size = (
            float(measure[1]) if _NUMBER.fullmatch(measure[1].strip()) else float("nan")
        )
        if not _UNITS[0] <= size <= _UNITS[1]:
            line = content.count(b"\n", 0, measure.start()) + 1
            got = measure[1].decode(errors="replace").strip()
            what = f"a number from {_UNITS[0]:g} to {_UNITS[1]:g} of its base unit, got {got}"
            raise InputError(
                f"{path}:{line}: LENGTH_MEASURE_WITH_UNIT: expected {what}"
            )


def check_unit(path: Path, content: bytes) -> None:
    """Refuse a file without a length unit: the kernel would silently assume millimetres."""
    ends = (match.start() for match in _UNIT.finditer(content))
    entities = (content[content.rfind(b";", 0, end) + 1 : end] for end in ends)
    lengths = {name[1] for name in map(_NAME.search, entities) if name}
    used = {
        name
        for match in _CONTEXT.finditer(content)
        for name in re.findall(rb"#\d+", match[1])
    }
    if not lengths & used:
        missing = (
            "LENGTH_UNIT" if not lengths else "GLOBAL_UNIT_ASSIGNED_CONTEXT with it"
        )
        valid = "a STEP file with a unit of length"
        raise InputError(
            f"{path}: expected {valid}, found no {missing}; export it again"
        )


def _write_valid(
    path: Path, shown: str, brep: Path, chosen: int | str | None = None
) -> None:
    """Read a file, `shown` in messages, check its solid and write it in the kernel's format."""
    shape = cad.kernel_files.read_step(path)
    cad.kernel_files.write_binary(cad.validity.valid_solid(shape, shown, chosen), brep)


def read_alone(
    read: "Callable[[Path, str, Path], None]",
    path: Path,
    goal: Path,
    time_limit: float,
    what: str,
) -> None:
    """Read a file in a separate process, as the kernel may crash or hang. Raises InputError."""
    try:
        do_alone(
            read, path.absolute(), str(path), goal, name=str(path), limit=time_limit
        )
    except LateError as error:
        late = f"got none within {time_limit:g} s; remove threads, engravings and tiny fillets"
        raise InputError(f"{path}: expected {what}, {late}") from error
    except WorkerError as error:
        if error.code in KILLED or lacks_memory(error):
            raise
        why = str(error).removeprefix(f"{path}: ")
        raise InputError(
            f"{path}: expected {what}, the CAD kernel failed ({why})"
        ) from error


def write_step(part: Part, path: str | Path) -> None:
    """Write the part's solid as STEP (AP214), in mm and part axes. Raises OSError."""
    cad.kernel_files.write_step(part.solid, Path(path))


def write_stl(part: Part, path: str | Path) -> None:
    """Write the part's surface as binary STL, in mm and part axes, to 0.05 mm and 0.2 rad."""
    vertices, triangles, _ = tessellate(part.solid, 5e-5, 0.2)
    import meshio

    mesh = meshio.Mesh(vertices * 1e3, [("triangle", triangles)])
    mesh.write(path, file_format="stl", binary=True)
