"""What `stiffscope check` prints: a robot file in plain words, 80 columns wide."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from stiffscope.vjm.mobility import joined

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from rich.console import Console

    from stiffscope.robot.inspection import Inspection
    from stiffscope.vjm.mechanism import Joint
    from stiffscope.vjm.mobility import Mobility

WIDTH = 80
_SHOWN = 8  # lines of a list, beyond which the rest is counted


def show_check(found: Inspection) -> None:
    """All tables of an inspection, then its remarks."""
    out = _console()
    out.print(f"[bold]{found.robot.name}[/bold]  ({found.robot.path})", soft_wrap=True)
    _facts(out, "Mobility at home", _mobility(found))
    _lines(out, "Redundant constraints", map(str, found.mobility.redundancies))
    _lines(out, "Idle motions (neither tool nor drives move)", map(str, found.mobility.idle))
    _parts(out, found)
    _masses(out, found)
    _drives(out, found)
    if not found.error:
        _reach(out, found)
        _poses(out, found)
    _lines(out, "Remarks", found.remarks or ["none"])
    out.print()


def _console() -> Console:
    from rich.console import Console

    return Console(width=WIDTH, highlight=False, soft_wrap=False)


def _table(out: Console, title: str, columns: Sequence[str], rows: Iterable[Sequence[str]], left: int = 1) -> None:
    """A table; the first ``left`` columns are words and may fold."""
    from rich import box
    from rich.table import Table

    table = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False, title_style="bold")
    table.min_width = min(WIDTH, len(title))
    for k, column in enumerate(columns):
        table.add_column(column, justify="left" if k < left else "right", overflow="fold", no_wrap=k >= left)
    for row in rows:
        table.add_row(*row)
    out.print()
    out.print(table)


def _facts(out: Console, title: str, facts: Iterable[tuple[str, str]]) -> None:
    """Names and what they are."""
    from rich.table import Table

    grid = Table.grid(padding=(0, 2))
    grid.add_column(no_wrap=True)
    grid.add_column(overflow="fold")
    for name, value in facts:
        grid.add_row(f"  {name}", value)
    out.print(f"\n[bold italic]{title}[/bold italic]")
    out.print(grid)


def _lines(out: Console, title: str, lines: Iterable[str]) -> None:
    listed = list(lines)
    if not listed:
        return
    _facts(out, title, ())
    from rich.padding import Padding

    for line in listed[:_SHOWN]:
        out.print(Padding(f"- {line}", (0, 0, 0, 2), expand=False), markup=False)
    if len(listed) > _SHOWN:
        out.print(f"  - and {len(listed) - _SHOWN} more: see --json")


def _mobility(found: Inspection) -> Iterator[tuple[str, str]]:
    m, mechanism = found.mobility, found.mechanism
    elastic = sum(b.elastic is not None for b in mechanism.bodies)
    yield "bodies", f"{len(mechanism.bodies)}: {elastic} elastic, {len(mechanism.bodies) - elastic} rigid"
    yield "joints", f"{len(mechanism.joints)}: {_kinds(mechanism.joints)}"
    yield "independent loops", f"{len(m.loops)}, closed at home to {found.residual:.1g} m"
    yield "degrees of freedom", _freedoms(m)
    yield "tool", _tool(m)
    yield "drives", _actuation(found)


def _kinds(joints: Sequence[Joint]) -> str:
    kinds = [j.kind for j in joints]
    return ", ".join(f"{kinds.count(kind)} {kind}" for kind in dict.fromkeys(kinds))


def _freedoms(m: Mobility) -> str:
    count = f"{m.freedoms} joint freedoms - 6 × {len(m.loops)}"
    redundant = f" + {m.redundant} redundant constraints" if m.redundant else ""
    idle = f", {m.idle_count} of them idle" if m.idle_count else ""
    return f"{m.dof} ({count}{redundant}){idle}"


def _tool(m: Mobility) -> str:
    by_word: dict[str, list[str]] = {}
    for name, word in m.coordinates.items():
        by_word.setdefault(word, []).append(name)
    words = ("commanded", "follows", "free", "locked", "held")
    return f"{len(m.tool)}; " + "; ".join(f"{word}: {', '.join(by_word[word])}" for word in words if word in by_word)


def _actuation(found: Inspection) -> str:
    m, drives = found.mobility, len(found.mechanism.drives)
    if m.loose:
        return f"{drives}: {len(m.loose)} too few for the tool"
    if m.redundant_drives:
        return f"{drives}: {m.redundant_drives} more than independent ({joined(m.dependent_drives)})"
    return f"{drives}: as many as needed"


def _parts(out: Console, found: Inspection) -> None:
    rows = (
        (p.name, _source(p.source), f"{1e3 * (p.length or 0):.4g}", _kg(p.mass), str(len(p.bodies)))
        for p in found.parts
    )
    if found.parts:
        _table(out, "Parts", ("part", "6×6 from", "length mm", "mass kg", "bodies"), rows, left=2)


def _source(source: str) -> str:
    return {
        "fea": "a virtual experiment (FEA)",
        "beam": "beam theory (Timoshenko)",
        "published": "the published table",
        "matrix": "the file",
    }[source]


def _kg(mass: float | None) -> str:
    return "by CAD" if mass is None else f"{mass:.4g}"


def _masses(out: Console, found: Inspection) -> None:
    """Bodies of one part or of one mass together."""
    alike: dict[tuple[str, float | None], list[str]] = {}
    for name, mass in found.masses.items():
        alike.setdefault((getattr(found.robot.bodies[name], "part", ""), mass), []).append(name)
    known = [mass for mass in found.masses.values() if mass is not None]
    rows = [
        (_some(names), part or "rigid", _kg(mass), "" if mass is None else f"{mass * len(names):.4g}")
        for (part, mass), names in alike.items()
    ]
    least = "" if len(known) == len(found.masses) else "at least "
    rows.append(("total", "", "", f"{least}{sum(known):.4g}"))
    _table(out, "Masses", ("bodies", "part", "each kg", "kg"), rows, left=2)


def _some(names: Sequence[str], most: int = 3) -> str:
    return (
        ", ".join(names) if len(names) <= most else f"{', '.join(names[: most - 1])} and {len(names) - most + 1} more"
    )


def _drives(out: Console, found: Inspection) -> None:
    rows = []
    for joint in found.mechanism.drives:
        if joint.drive is not None:
            low, high = (_shown(each, turns=joint.kind == "revolute") for each in (joint.drive.low, joint.drive.high))
            unit = "N·m/rad" if joint.kind == "revolute" else "N/m"
            rows.append((joint.name, joint.kind, f"{joint.drive.stiffness:.4g} {unit}", low, high))
    if rows:
        _table(out, "Drives (range from home)", ("drive", "joint", "stiffness", "from", "to"), rows, left=2)


def _shown(value: float, *, turns: bool) -> str:
    if not np.isfinite(value):
        return "no limit"
    return f"{np.degrees(value):.5g} deg" if turns else f"{1e3 * value:.5g} mm"


def _reach(out: Console, found: Inspection) -> None:
    rows = []
    for way in found.reach:
        turns = way.coordinate.startswith("r")
        ends = (_shown(way.low, turns=turns), _shown(way.high, turns=turns))
        rows += [
            (way.coordinate, f"{word} {end}", why or "no limit up to here")
            for word, end, why in zip(("from", "to"), ends, (way.at_low, way.at_high), strict=True)
        ]
    _table(
        out, "Reach of the tool along one coordinate, others as at home", ("", "reach", "what ends it"), rows, left=3
    )


def _poses(out: Console, found: Inspection) -> None:
    turning = [name.startswith("r") for name in found.mechanism.tool.pose]
    rows = [
        (
            pose.name,
            ", ".join(_shown(x, turns=t) for x, t in zip(pose.tool, turning, strict=True)),
            pose.reason or "yes",
            "-" if pose.conditioning is None else f"{pose.conditioning:.3g}",
        )
        for pose in found.poses
    ]
    columns = ("pose", ", ".join(found.mechanism.tool.pose), "reached", "conditioning")
    _table(out, "Named poses (conditioning: 1 best, 0 singular)", columns, rows, left=3)
