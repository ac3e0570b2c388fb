"""What an import prints, and its JSON."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from stiffscope.errors import say_count
from stiffscope.report.terminal import show_line
from stiffscope.statics.show.check import show_doubts, show_named

if TYPE_CHECKING:
    from pathlib import Path

    from stiffscope.imports.import_assembly import Imported
    from stiffscope.imports.simulator_model import SimulatorModel


def model_json(read: SimulatorModel, file: Path) -> dict[str, Any]:
    """Return the counts and notes of an imported model."""
    counts = {"bodies": len(read.bodies), "joints": len(read.joints)}
    return {"file": str(file), **counts, "notes": list(read.notes)}


def import_json(imported: Imported) -> dict[str, Any]:
    """Return the same for an assembly, with joints, hardware, doubts and changes."""
    joints = {j.name: {"type": j.kind, "reason": j.note} for j in imported.model.joints}
    return {
        **model_json(imported.model, imported.file),
        "joints_found": joints,
        "hardware": imported.hardware,
        "doubts": [asdict(doubt) for doubt in imported.doubts],
        "changes": imported.changes,
    }


def show_import(imported: Imported) -> None:
    """Print the joints with reasons, the findings to review and the changes."""
    for doubt in imported.doubts:
        if doubt.warning:
            show_line(f"Warning: {', '.join(doubt.solids)} is {doubt.text}.")
    rows = [(joint.name, joint.kind, joint.note) for joint in imported.model.joints]
    show_named("Joints", ("joint", "kind", "from"), rows, prose=("joint", "from"))
    show_doubts(imported.doubts)
    for change in imported.changes or ():
        show_line(f"Since the last import: {change}.")
    if imported.changes == ():
        show_line("Since the last import: nothing has changed.")
    model = imported.model
    driven = ", ".join(imported.driven) or "none"
    solids = say_count(imported.solids, "solid")
    contacts = say_count(imported.contacts, "contact")
    bought = say_count(
        len(imported.hardware), "piece of hardware", "pieces of hardware"
    )
    counts = f"{solids}, {contacts}; {count_model(model)}, {bought} (driven: {driven})"
    show_written(model, imported.file, counts)


def count_model(model: SimulatorModel) -> str:
    """Return how many bodies and joints a model has."""
    bodies = say_count(len(model.bodies), "body", "bodies")
    return f"{bodies}, {say_count(len(model.joints), 'joint')}"


def show_written(read: SimulatorModel, file: Path, counts: str) -> None:
    """Print the notes of an import and the next step."""
    for note in read.notes:
        show_line(f"Note: {note}.")
    show_line(f"Written: {file}, {counts}. Next: stiffscope check {file}")
