"""`stiffscope element`: the stiffness matrix of a single bearing, guide or screw."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from stiffscope.cli import options
from stiffscope.cli.options import takes
from stiffscope.cli.output import emit
from stiffscope.report.part_tables import show_element
from stiffscope.robot.file.element_sections import read_element
from stiffscope.runtime.reading import read_bytes

if TYPE_CHECKING:
    from stiffscope.cli.output import Output


@click.command()
@takes(click.argument("file", metavar="FILE.toml"), options.json)
def element(file: str, *, output: Output) -> None:
    """Stiffness of a bearing, guide or screw from its data sheet.

    FILE.toml has the keys that a joint's `bearing` has in a robot file, its `kind` first. Shown are
    the stiffness at the preload or load, x along the axis, what the rolling elements carry, the
    source, and what limits the result.
    """
    path = Path(file)
    section = read_element(
        path, read_bytes(path, "a file of an element").decode(errors="replace")
    )
    found = section.element()
    answer = {"kind": section.kind, **vars(found), "compliance": found.compliance}
    emit(output, answer, lambda: show_element(section.kind, found))
