"""Output of `stiffscope check` and `import`: a robot file in plain words, and whence it comes."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.report.terminal import show_facts, show_line, show_list, show_table
from stiffscope.robot.file.quantities import shown_unit
from stiffscope.vjm.model.checks import list_names

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator, Sequence

    from stiffscope.robot.inspection import Doubt, Inspection
    from stiffscope.vjm.kinematics.mobility import Mobility

SOURCES = {
    "fea": "a virtual experiment (FEA)",
    "beam": "beam theory (Timoshenko)",
    "published": "the published table",
    "matrix": "the file",
    "step": "a virtual experiment (FEA) on a STEP file",
}
_SHOWN = 8  # lines shown of a list; further lines are only counted


def show_check(inspection: Inspection) -> None:
    """Show all tables of an inspection, then its remarks."""
    show_line(f"{inspection.robot.name} ({inspection.robot.path})", "bold")
    show_line("")
    show_facts("Mobility at home", list(_mobility(inspection)))
    _lines("Redundant constraints", map(str, inspection.mobility.redundancies))
    _lines(
        "Idle motions (neither tool nor drives move)",
        map(str, inspection.mobility.idle),
    )
    _parts(inspection)
    _masses(inspection)
    _drives(inspection)
    if inspection.configurations is not None:
        _reach(inspection)
        _poses(inspection)
    remarks = list(inspection.remarks)
    if inspection.error:
        remarks.append(f"refused: {inspection.error}")
    _lines("Remarks", remarks or ["none"])
    show_doubts(inspection.doubts)


def show_doubts(doubts: Sequence[Doubt]) -> None:
    """Show the ambiguous findings of an import with both interpretations."""
    rows = [(_some(doubt.solids), doubt.text) for doubt in doubts]
    if rows:
        columns = ("solids", "assumption, and alternatives")
        show_named(
            "Review these; other interpretations are possible",
            columns,
            rows,
            prose=columns,
        )


def show_named(
    title: str,
    columns: Sequence[str],
    rows: Sequence[Sequence[str]],
    prose: Collection[str] = (),
) -> None:
    """Print a table whose first column names the rows."""
    show_table(title, [columns[:1], columns[1:]], rows, prose=prose)


def _lines(title: str, lines: Iterable[str]) -> None:
    listed = list(lines)
    more = (
        [f"and {len(listed) - _SHOWN} more: see --json"] if len(listed) > _SHOWN else []
    )
    if listed:
        show_list(title, listed[:_SHOWN] + more)


def _mobility(inspection: Inspection) -> Iterator[tuple[str, str]]:
    m = inspection.mobility
    mechanism = inspection.mechanism
    count = len(mechanism.bodies)
    elastic = sum(b.elastic is not None for b in mechanism.bodies)
    yield "bodies", f"{count}: {elastic} elastic, {count - elastic} rigid"
    kinds = Counter(joint.kind for joint in mechanism.joints)
    listed = ", ".join(f"{count} {kind}" for kind, count in kinds.items())
    yield "joints", f"{len(mechanism.joints)}: {listed}"
    closed = f", closed at home to {inspection.residual:.1g} m" if m.loops else ""
    yield "independent loops", f"{len(m.loops)}{closed}"
    count = f"{m.freedoms} joint freedoms" + (
        f" - 6 × {len(m.loops)}" if m.loops else ""
    )
    redundant = f" + {m.redundant} redundant constraints" if m.redundant else ""
    idle = f", {m.idle_count} of them idle" if m.idle_count else ""
    yield "degrees of freedom", f"{m.dof} ({count}{redundant}){idle}"
    yield "tool", _tool(m)
    yield "drives", _actuation(inspection)


def _tool(m: Mobility) -> str:
    words = ("commanded", "follows", "free", "locked", "held")
    names = {
        w: [name for name, word in m.coordinates.items() if word == w] for w in words
    }
    lines = (f"{word}: {', '.join(each)}" for word, each in names.items() if each)
    return "; ".join([str(len(m.tool)), *lines])


def _actuation(inspection: Inspection) -> str:
    m = inspection.mobility
    drives = len(inspection.mechanism.drives)
    if m.loose:
        return f"{drives}: {len(m.loose)} too few for the tool"
    if m.redundant_drives:
        return f"{drives}: {m.redundant_drives} redundant ({list_names(m.dependent_drives)})"
    return f"{drives}: as many as needed"


def _parts(inspection: Inspection) -> None:
    rows = []
    for p in inspection.parts:
        length = f"{1e3 * p.length:.4g}" if p.length else ""
        rows.append(
            (p.name, SOURCES[p.source], length, _kg(p.mass), str(len(p.bodies)))
        )
    if rows:
        columns = ("part", "6×6 from", "length mm", "mass kg", "bodies")
        show_named("Parts", columns, rows, prose=("6×6 from",))


def _kg(mass: float | None) -> str:
    return "by CAD" if mass is None else f"{mass:.4g}"


def _masses(inspection: Inspection) -> None:
    """Show the masses, grouping bodies with the same part and mass."""
    alike: dict[tuple[str, float | None], list[str]] = {}
    for name, mass in inspection.masses.items():
        alike.setdefault(
            (getattr(inspection.robot.bodies[name], "part", ""), mass), []
        ).append(name)
    known = [mass for mass in inspection.masses.values() if mass is not None]
    rows = []
    for (part, mass), names in alike.items():
        total = "" if mass is None else f"{mass * len(names):.4g}"
        rows.append((_some(names), part or "rigid", _kg(mass), total))
    least = "" if len(known) == len(inspection.masses) else "at least "
    rows.append(("total", "", "", f"{least}{sum(known):.4g}"))
    show_named(
        "Masses", ("bodies", "part", "each kg", "kg"), rows, prose=("bodies", "part")
    )


def _some(names: Sequence[str], most: int = 3) -> str:
    if len(names) <= most:
        return ", ".join(names)
    return f"{', '.join(names[: most - 1])} and {len(names) - most + 1} more"


def _drives(inspection: Inspection) -> None:
    rows = []
    for joint in inspection.mechanism.drives:
        if joint.drive is not None:
            axis, unit = ("r", "N·m/rad") if joint.turns else ("x", "N/m")
            ends = (
                _show_limit(axis, limit)
                for limit in (joint.drive.low, joint.drive.high)
            )
            rows.append(
                (joint.name, joint.kind, f"{joint.drive.stiffness:.4g} {unit}", *ends)
            )
    if rows:
        columns = ("drive", "joint", "stiffness", "from", "to")
        show_named("Drives (range from home)", columns, rows, prose=("joint",))


def _show_limit(coordinate: str, value: float) -> str:
    factor, unit = shown_unit(coordinate)
    return f"{factor * value:.5g} {unit}" if np.isfinite(value) else "no limit"


def _reach(inspection: Inspection) -> None:
    rows = []
    for way in inspection.reach:
        ends = (_show_limit(way.coordinate, end) for end in (way.low, way.high))
        rows += [
            (way.coordinate, f"{word} {end}", why or "no limit up to here")
            for word, end, why in zip(
                ("from", "to"), ends, (way.at_low, way.at_high), strict=True
            )
        ]
    title = "Tool range along one coordinate, the others at home"
    if not rows:  # all are locked
        return
    show_named(
        title, ("along", "reach", "limited by"), rows, prose=("reach", "limited by")
    )


def _poses(inspection: Inspection) -> None:
    names = inspection.mechanism.tool.pose
    rows = []
    for pose in inspection.poses:
        conditioning = "-" if pose.conditioning is None else f"{pose.conditioning:.3g}"
        place = ", ".join(map(_show_limit, names, pose.tool))
        rows.append((pose.name, place, pose.reason or "yes", conditioning))
    columns = ("pose", ", ".join(names), "reached", "conditioning")
    title = "Named poses (conditioning: 1 best, 0 singular)"
    show_named(title, columns, rows, prose=columns[1:3])
