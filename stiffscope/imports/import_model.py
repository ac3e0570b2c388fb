"""`stiffscope import`: conversion of a simulator's model, URDF or MJCF, to a robot file."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from stiffscope.errors import expecting, require
from stiffscope.imports.assembly_parts import part_lines, write_import
from stiffscope.imports.compiled_model import is_urdf, print_safely
from stiffscope.imports.import_record import parts_folder
from stiffscope.imports.model_loops import read_loops
from stiffscope.imports.model_solids import add_solids
from stiffscope.imports.robot_text import (
    check_text,
    driven,
    number_or_text,
    robot_text,
)
from stiffscope.imports.simulator_model import read_model
from stiffscope.robot.file.values import measured_quantity
from stiffscope.runtime.output import check_file, check_new, is_forced, write_bytes
from stiffscope.runtime.reading import read_bytes

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stiffscope.imports.simulator_model import SimulatorModel


def import_model(
    path: str | Path,
    out: str | Path,
    drives: Sequence[str] = (),
    tool: str | None = None,
    home: Sequence[str] = (),
    materials: Sequence[str] = (),
    loops: str | Path | None = None,
) -> SimulatorModel:
    """Write a robot file from a URDF or MJCF file; the model's notes list omissions and guesses.

    Raises InputError if the file is not a model, or an option matches nothing in it.

    Parameters
    ----------
    path, out
        URDF or MJCF file, and robot file to write, which must not exist unless `--force` is given.
    drives, home, materials
        As in the options `--drive`, `--home`, `--material`.
    tool
        Body or site that is the tool; by default a last one.
    loops
        YAML file with the loops of a URDF, as in the option `--loops`.
    """
    check = (
        check_file
        if is_forced()
        else partial(check_new, advice="--force writes over it")
    )
    out = Path(out)
    check(out)
    path, urdf = Path(path), is_urdf(read_bytes(path, "a model in URDF or MJCF"))
    fits = urdf or not materials
    require(fits, "--material", "a STEP assembly or a URDF", path.name)
    require(urdf or loops is None, "--loops", "a URDF", path.name)
    model = read_model(
        path,
        tool,
        _positions(home),
        [drive.partition("=")[0].strip() for drive in drives],
        None if loops is None else read_loops(Path(loops)),
    )
    model, parts = add_solids(path, model, materials) if urdf else (model, [])
    lines = part_lines(parts, out)
    text = robot_text(
        model, print_safely(path.name), driven(model, drives), parts=lines
    )
    if not parts:
        check_text(path, out, text, "the model")
        write_bytes(out, text.encode())
        return model
    for part in parts if parts_folder(out).exists() else ():
        check(parts_folder(out) / f"{part.name}.step")
    write_import(path, out, text, parts, "the model")
    return model


def _positions(texts: Sequence[str]) -> dict[str, float]:
    """Return joint positions, SI, from texts such as "elbow=90 deg" or "slide=20 mm"."""
    positions: dict[str, float] = {}
    for text in texts:
        name, equals, value = (piece.strip() for piece in text.partition("="))
        where = f"--home {text}"
        require(name not in positions, where, "each joint once", f"{name} twice")
        expected = 'JOINT=POSITION such as "elbow=90 deg"'
        with expecting(where, expected, ValueError, got=f'"{text}"'):
            positions[name] = measured_quantity(
                number_or_text(value) if equals else None
            )
    return positions
