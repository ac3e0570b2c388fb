"""STEP files: read as parts, whatever is in them, and written.

A file is read and checked in a process of its own with a time limit: the kernel can crash on rubbish, or never end.
"""

import signal
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from stiffscope.cad.materials import STEEL, AnyMaterial
from stiffscope.cad.part import Part
from stiffscope.cad.solid import GREATEST_X, LEAST_X, Frame, Selectors, Vector, chosen_part
from stiffscope.errors import InputError

if TYPE_CHECKING:
    from stiffscope.cad.kernel import Solid

START, END = b"ISO-10303-21", b"END-ISO-10303-21"
REFUSED = 2  # exit code of the reading process; its standard error then holds the one line that says why


def read_step(
    path: str | Path,
    *,
    name: str | None = None,
    material: AnyMaterial = STEEL,
    clamped: Selectors = LEAST_X,
    loaded: Selectors | Mapping[str, Selectors] = GREATEST_X,
    frame: Frame | None = None,
    reference_point: Vector | None = None,
    time_limit: float = 60.0,
) -> Part:
    """Return the one solid of a STEP file as a part; the rest is as in `stiffscope.cad.solid.part_of`.

    Without selectors it is held at its plane face of least x and loaded at that of greatest x. Lengths are
    converted from the file's unit. InputError names the file, what was found in it and what would be valid.
    """
    solid = read_solid(path, time_limit)
    return chosen_part(
        solid,
        name=name or Path(path).stem,
        material=material,
        clamped=clamped,
        loaded=loaded,
        frame=frame or Frame(),
        reference_point=reference_point,
    )


def read_solid(path: str | Path, time_limit: float = 60.0) -> "Solid":
    """Return the one solid of a STEP file, sound, in mm, in the file's coordinates; InputError when it is not."""
    _check_file(Path(path))
    with tempfile.TemporaryDirectory(prefix="stiffscope-") as folder:
        aside = Path(folder, "solid.brep")
        _check_apart(Path(path), aside, time_limit)
        from stiffscope.cad import kernel_files

        return kernel_files.read_binary(aside)


def _check_file(path: Path) -> None:
    try:
        with path.open("rb") as file:
            head = file.read(4096)
            file.seek(max(0, path.stat().st_size - 4096))
            tail = file.read()
    except OSError as error:
        raise InputError(f"{path}: expected a STEP file, got {error.strerror or error}") from error
    if not head.strip():
        raise InputError(f"{path}: expected a STEP file, found an empty one")
    if START not in head:
        raise InputError(f"{path}: expected a STEP file, which begins with {START.decode()}; found another kind")
    if END not in tail:
        raise InputError(f"{path}: expected a whole STEP file, found a torn one (no {END.decode()} at its end)")


def _check_apart(path: Path, aside: Path, time_limit: float) -> None:
    command = [sys.executable, "-P", "-m", "stiffscope.cad.step_reader", str(path.absolute()), str(path), str(aside)]
    try:
        done = subprocess.run(
            command,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=time_limit,
            check=False,
        )
    except subprocess.TimeoutExpired as error:
        raise InputError(
            f"{path}: expected a solid that is read and checked within {time_limit:g} s; "
            "a simpler one (no threads, logos, tiny fillets) would be"
        ) from error
    words = done.stderr.decode(errors="replace").strip().splitlines()
    if done.returncode == REFUSED and words:
        raise InputError(words[-1])
    if done.returncode or not aside.is_file():
        code = done.returncode
        why = signal.Signals(-code).name if code < 0 else (words[-1] if words else f"exit code {code}")
        raise InputError(f"{path}: expected a STEP file with one closed solid, found what the kernel fails on ({why})")


def write_step(part: Part, path: str | Path) -> None:
    """Write the part's solid as STEP (AP214), in mm, in the part's axes; OSError when it cannot be written."""
    from stiffscope.cad import kernel_files

    kernel_files.write_step(part.solid, Path(path))


def write_stl(part: Part, path: str | Path, deflection: float = 5e-5, angle: float = 0.2) -> None:
    """Write the part's surface as binary STL, in mm, in the part's axes; the tolerances are those of `surface`."""
    import numpy as np

    from stiffscope.cad.part import tessellated

    vertices, triangles, _ = tessellated(part.solid, deflection, angle)
    corners = vertices[triangles] * 1e3  # (nt, 3, 3)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    facets = np.zeros(len(triangles), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("end", "<u2")])
    facets["normal"], facets["corners"] = normals, corners
    header = f"{part.name}, mm".encode("ascii", "replace")[:80].ljust(80)
    Path(path).write_bytes(header + np.uint32(len(triangles)).astype("<u4").tobytes() + facets.tobytes())
