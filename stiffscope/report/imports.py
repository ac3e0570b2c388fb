"""Result of importing a model or an assembly, as data and as terminal output."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from stiffscope.report.check_tables import show_doubts
from stiffscope.report.terminal import show_line, show_table

if TYPE_CHECKING:
    from pathlib import Path

    from stiffscope.robot.imports.import_assembly import Imported
    from stiffscope.robot.imports.simulator_model import SimulatorModel


def model_json(read: SimulatorModel, file: Path) -> dict[str, Any]:
    """Return the counts and notes of an imported model."""
    counts = {"bodies": len(read.bodies), "joints": len(read.joints)}
    return {"file": str(file), **counts, "notes": list(read.notes)}


def import_json(found: Imported) -> dict[str, Any]:
    """Return the same for an assembly, with joints, hardware, doubts and changes."""
    joints = {j.name: {"type": j.kind, "reason": j.note} for j in found.model.joints}
    return {
        **model_json(found.model, found.file), "joints_found": joints, "hardware": found.hardware,
        "doubts": [asdict(doubt) for doubt in found.doubts], "changes": found.changes,
    }  # fmt: skip


def show_import(found: Imported) -> None:
    """Print the joints with reasons, the findings to review and the changes."""
    rows = [(joint.name, joint.kind, joint.note) for joint in found.model.joints]
    columns = ("joint", "kind", "from")
    show_table("Joints", (columns[:1], columns[1:]), rows, prose=("joint", "from"))
    show_doubts(found.doubts)
    for change in found.changes or ():
        show_line(f"Since the last import: {change}.")
    if found.changes == ():
        show_line("Since the last import: nothing has changed.")
    counts = (
        f"{found.solids} solids, {found.contacts} contacts; {len(found.model.bodies)} bodies, "
        f"{len(found.model.joints)} joints, {len(found.hardware)} pieces of hardware "
        f"(driven: {', '.join(found.driven) or 'none'})"
    )
    show_written(found.model, found.file, counts)


def show_written(read: SimulatorModel, file: Path, counts: str) -> None:
    """Print the notes of an import and the next step."""
    for note in read.notes:
        show_line(f"Note: {note}.")
    show_line(f"Written: {file}, {counts}. Next: stiffscope check {file}")
