"""The command `import`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from stiffscope.cli import options
from stiffscope.cli.options import Texts, takes
from stiffscope.cli.output import emit
from stiffscope.errors import require
from stiffscope.imports.import_assembly import import_assembly
from stiffscope.imports.import_model import import_model
from stiffscope.imports.show import (
    count_model,
    import_json,
    model_json,
    show_import,
    show_written,
)
from stiffscope.imports.user_settings import ImportSettings
from stiffscope.report.progress import progress

if TYPE_CHECKING:
    from pathlib import Path

    from stiffscope.cli.output import Output


def _option_of_names(name: str, metavar: str, text: str) -> Any:
    text = f"Of an assembly, {text}. May be repeated."
    return click.option(f"--{name}", multiple=True, metavar=metavar, help=text)


@click.command("import")
@takes(
    click.argument("model", metavar="FILE.urdf|FILE.xml|FILE.step", type=options.PATH),
    click.option(
        "--out",
        "goal",
        required=True,
        metavar="ROBOT.toml",
        type=options.PATH,
        help="File to write.",
    ),
    click.option(
        "--drive",
        "drives",
        multiple=True,
        metavar="PATTERN=STIFFNESS",
        help='Drive joints: "joint1=25 kN*m/rad", "slide=20 N/um". Repeatable; others are passive.',
    ),
    click.option(
        "--tool",
        metavar="NAME",
        help="Body, site or part that is the tool, or a last one.",
    ),
    click.option(
        "--home",
        multiple=True,
        metavar="JOINT=POSITION",
        help='Of URDF and MJCF, another home than the model\'s: "elbow=90 deg". May be repeated.',
    ),
    click.option(
        "--loops",
        metavar="FILE.yaml",
        type=options.PATH,
        help="Of a URDF, its loops: pairs of frames in YAML (closed_loop, type).",
    ),
    click.option(
        "--ground", metavar="NAME", help="Of an assembly, the part that stands still."
    ),
    _option_of_names(
        "joint",
        '"A/B=KIND"',
        'the joint of two parts: "arm/base=revolute", "arm/cover=none"',
    ),
    _option_of_names(
        "weld",
        "PATTERN",
        'solids that hold together what they touch, as screws do: "clamp?"',
    ),
    _option_of_names(
        "part",
        "PATTERN",
        'solids that are parts, though they look like hardware: "shaft?"',
    ),
    _option_of_names("rigid", "PATTERN", 'parts that do not bend: "motor?"'),
    _option_of_names(
        "material",
        '"PATTERN=NAME"',
        'materials of parts or URDF links: "arm?=aluminium-7075"',
    ),
    options.json,
)
def import_(
    model: Path,
    goal: Path,
    *,
    drives: Texts,
    tool: str | None,
    home: Texts,
    loops: Path | None,
    output: Output,
    **names: Any,
) -> None:
    """Convert a URDF or MJCF model, or a STEP assembly, to a robot file.

    Of a simulator's model: bodies, masses, joints and ranges. Of an assembly: parts with their
    solids, joints from where they touch, and doubts. Drives are not in either; comments in the file
    mark where to add them. An assembly.toml beside the assembly may hold the same settings.
    """
    if model.suffix.lower() in {".step", ".stp", ".p21"}:
        expected = "none for an assembly, whose home is as it stands"
        require(not home, "--home", expected, "some")
        require(loops is None, "--loops", "a URDF", "an assembly")
        given = ImportSettings(tool=tool, drive=drives, **names)
        with progress(quiet=output.quiet) as open_line:
            imported = import_assembly(model, goal, given, open_line(model.name))
        emit(output, import_json(imported), lambda: show_import(imported))
        return
    for name, value in names.items():
        fits = not value or name == "material"
        require(fits, f"--{name}", "a STEP assembly", model.name)
    read = import_model(
        path=model,
        out=goal,
        drives=drives,
        tool=tool,
        home=home,
        materials=names["material"],
        loops=loops,
    )
    driven = ", ".join(drive.partition("=")[0].strip() for drive in drives) or "none"
    counts = f"{count_model(read)} (driven: {driven})"
    emit(output, model_json(read, goal), lambda: show_written(read, goal, counts))
