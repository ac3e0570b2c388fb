"""Output of `stiffscope campaign`: planned readings, and how a campaign was read, with its page."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.errors import say_count
from stiffscope.gap.campaign.copies import find_copies
from stiffscope.gap.campaign.kinds import KINDS
from stiffscope.gap.campaign.quantities import WRENCH
from stiffscope.gap.planning.candidates import ENOUGH, NONE
from stiffscope.gap.show.responses import (
    responses_json,
    show_responses,
    write_section,
)
from stiffscope.report.numbers import coordinates, pose_values
from stiffscope.report.page import Section
from stiffscope.report.pictures import optional_pictures
from stiffscope.report.robot_scene import place_robot, pose_text, scene
from stiffscope.report.terminal import show_line, show_table
from stiffscope.robot.file.quantities import shown_unit

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence
    from pathlib import Path

    from stiffscope.gap.campaign.campaign import Campaign
    from stiffscope.gap.campaign.sanity import ReadingRemark
    from stiffscope.gap.forward.response_model import ComparedResponses
    from stiffscope.gap.planning.candidates import Answered, Proposal
    from stiffscope.gap.planning.hits import HitProposal
    from stiffscope.report.run_report import Draft
    from stiffscope.robot.file.description import RobotFile
    from stiffscope.vjm.kinematics.configurations import Configurations
    from stiffscope.vjm.model.mechanism import Mechanism

PICTURES = {
    "sensors.png": "Sensors and loads with their names, at the first pose",
    "first_pose.png": "The robot at the first pose",
    "last_pose.png": "The robot at the last pose",
}
"""Files written by `draw_sensors`, with their captions."""
_PLURAL = {kind.name: kind.plural for kind in KINDS}
_SHOWN = 24
_PAIRS = 12  # rows shown in a table; further rows are only counted
_FEW = 6  # causes of a question whose pairs are listed; of more, causes are
_ALIKE = 3  # other causes listed that one looks like


def plan_json(proposal: Proposal) -> dict[str, Any]:
    """Return the plan with its expected evidence."""
    return {
        "sensors": [sensor.name for sensor in proposal.plan.sensors],
        "loads": [hook.name for hook in proposal.plan.hooks],
        "enough": ENOUGH,
        "pairs": _pairs_json(proposal.pairs),
    }


def _pairs_json(pairs: Iterable[Answered]) -> list[dict[str, Any]]:
    return [
        {
            "first": pair.first,
            "second": pair.second,
            "ln_odds": pair.log_odds,
            "hidden": list(pair.hidden),
            "larger_pulls": pair.larger if np.isfinite(pair.larger) else None,
            "asked": pair.asked,
        }
        for pair in pairs
    ]


def hits_json(proposal: HitProposal) -> dict[str, Any]:
    """Return a planned hammer test with its expected evidence, SI."""
    return {
        "points": {
            point: {"body": body, "at": list(at)}
            for point, (body, at) in proposal.points.items()
        },
        "hits": [
            {"pose": tap.pose, "force": str(tap.hit), "listen": list(tap.listen)}
            for tap in proposal.taps
        ],
        "bands": {pose: list(band) for pose, band in proposal.bands.items()},
        "enough": ENOUGH,
        "pairs": _pairs_json(proposal.pairs),
    }


def show_hits(proposal: HitProposal) -> None:
    """Print where to hit and listen, and the distinguished pairs."""
    points = [
        (point, body, ", ".join(f"{value:.4g}" for value in at))
        for point, (body, at) in proposal.points.items()
    ]
    show_table("Points", (("point",), ("body", "at, m")), points)
    rows = [
        (
            tap.pose,
            str(tap.hit),
            ", ".join(tap.listen),
            " to ".join(f"{hertz:g}" for hertz in proposal.bands[tap.pose]),
        )
        for tap in proposal.taps
    ]
    columns = (("pose", "hit"), ("triaxial accelerometers at", "band Hz"))
    show_table("Hits", columns, rows)
    if len({pair.first for pair in proposal.pairs}) > _FEW:
        _show_causes(proposal.pairs)
    else:
        _show_answers(proposal.pairs)


def show_plan(proposal: Proposal, names: Sequence[str]) -> None:
    """Print the readings and the distinguished pairs; ``names``: coordinates of a pose."""
    plan = proposal.plan
    rows: list[list[str]] = []
    for pose, values in enumerate(plan.poses):
        for pull, (hook, force) in enumerate(plan.pulls):
            here = (plan.settings[:, :2] == (pose, pull)).all(axis=1)
            read = ", ".join(plan.sensors[k].name for k in plan.settings[here, 2])
            newtons = ", ".join(f"{f:g}" for f in force)
            load = f"{plan.hooks[hook].name} {newtons}" if hook >= 0 else "none"
            rows += [[pose_values(values, names), load, read]] if here.any() else []
    show_table(
        "Readings",
        [[coordinates(names)], ["load, N", "sensors"]],
        rows,
        prose=("sensors",),
    )
    _show_answers(proposal.pairs)


def _show_causes(pairs: Sequence[Answered]) -> None:
    """Print, of each cause, whether it shows, and of how many others it is told apart.

    Of several parameters, it takes one that is told; those that do not show at all are listed.
    """
    by_cause: dict[str, list[Answered]] = {}
    for pair in pairs:
        by_cause.setdefault(pair.first, []).append(pair)
    rows: list[list[str]] = []
    alone: list[str] = []
    silent: list[str] = []
    for cause, own in by_cause.items():
        others = [pair for pair in own if pair.second != NONE]
        alike = [pair.second for pair in others if pair.hidden and not pair.log_odds]
        from_none = [pair for pair in own if pair.second == NONE]
        if any(pair.hidden and not pair.log_odds for pair in from_none):
            silent.append(cause)
            continue
        hidden = ", ".join(name for pair in from_none for name in pair.hidden)
        if not alike:
            alone.append(cause)
        told = f"{len(others) - len(alike)} of {len(others)}"
        listed = ", ".join(alike[:_ALIKE]) + (", …" if len(alike) > _ALIKE else "")
        rows.append([cause, told, listed, hidden])
    columns = (("cause",), ("told from", "not from", "not shown of it"))
    show_table("What shows", columns, rows, prose=("cause", "not from"))
    show_line(
        f"Of {say_count(len(by_cause), 'cause')}, {len(alone)} can be told from all others; "
        f"{len(rows) - len(alone)} show but look like others; {len(silent)} do not show."
    )
    if silent:
        more = f" and {len(silent) - _PAIRS} more" if len(silent) > _PAIRS else ""
        show_line(f"Not shown: {', '.join(silent[:_PAIRS])}{more}.")


def _show_answers(pairs: Sequence[Answered]) -> None:
    asked, others = (
        [p for p in pairs if p.asked == wanted] for wanted in (True, False)
    )
    _show_pairs("The question: expected ln-odds if the first is true", asked)
    _show_pairs("Against other causes: the smallest", others)
    for pair in [p for p in asked if p.hidden][:_PAIRS]:
        cure = _cure(pair)
        show_line(f"Not resolved: {pair.first} from {pair.second} ({cure})", "bold")


def _show_pairs(title: str, pairs: Sequence[Answered]) -> None:
    rows = [
        [p.first, p.second, f"{p.log_odds:.3g}", ", ".join(p.hidden), _cure(p)]
        for p in pairs[:_PAIRS]
    ]
    pair = "true", "instead"
    if rows:
        columns = ["ln-odds", "unresolved", "what would resolve it"]
        show_table(title, [pair, columns], rows, prose=pair)
    if len(pairs) > _PAIRS:
        show_line(f"and {len(pairs) - _PAIRS} more: see --json")


def _cure(pair: Answered) -> str:
    """Return what would resolve the hidden parameters of a pair."""
    if not pair.hidden:
        return ""
    if np.isinf(pair.larger):
        return "none of these readings"
    return f"pulls {pair.larger:g} times as large"


def campaign_json(
    campaign: Campaign,
    remarks: Iterable[ReadingRemark] = (),
    responses: Iterable[ComparedResponses] = (),
) -> dict[str, Any]:
    """Return the campaign as read, as plain data in SI units."""
    c = campaign
    largest = np.abs(np.nan_to_num(c.wrench)).max(axis=0, initial=0.0)
    counts = ((kind.name, int((c.kind == k).sum())) for k, kind in enumerate(KINDS))
    loads = {}
    for k, load in enumerate(c.loads):
        count = int((c.load == k).sum())
        loads[load.name] = {"body": load.body, "at": list(load.at), "readings": count}
    return {
        "robot": c.robot,
        "readings": len(c),
        "empty": int(np.isnan(c.value).sum()),
        "kinds": {name: n for name, n in counts if n},
        "coordinates": list(c.coordinates),
        "poses": {
            name: pose.tolist()
            for name, pose in zip(c.pose_names, c.poses, strict=True)
        },
        "sessions": dict(
            zip(c.session_names, np.bincount(c.session).tolist(), strict=True)
        ),
        "without_sigma": int(np.isnan(c.sigma).sum()),
        "copies": find_copies(c)[1] or None,
        "remarks": [asdict(remark) for remark in remarks],
        "channels": _channels(c),
        "sensors": {s.name: _sensor(c, k) for k, s in enumerate(c.sensors)},
        "loads": loads,
        "largest_wrench": dict(zip(WRENCH, largest.tolist(), strict=True)),
        "responses": {
            each.measured.setup.name: responses_json(each) for each in responses
        },
    }


def _sensor(c: Campaign, k: int) -> dict[str, Any]:
    s = c.sensors[k]
    at = {} if s.rotates else {"at": list(s.at)}
    frame = {"frame": s.frame, "at_sigma": s.at_sigma} if s.absolute else {}
    return {
        "measures": s.measures,
        "body": s.place,
        "direction": list(s.direction),
        "against": s.against,
        **frame,
        **at,
        "zero": s.zero,
        "readings": int((c.sensor == k).sum()),
    }


def _channels(c: Campaign) -> list[dict[str, Any]]:
    """Return count, range and median uncertainty of the readings by instrument and kind."""
    out: list[dict[str, Any]] = []
    rows: dict[tuple[str, int], list[int]] = {}
    for i, kind in enumerate(c.kind.tolist()):
        rows.setdefault((c.what(i), kind), []).append(i)
    for (reads, kind), mine in rows.items():
        value, sigma = (
            each[mine][~np.isnan(each[mine])] for each in (c.value, c.sigma)
        )
        low, high = (
            (float(value.min()), float(value.max())) if len(value) else (None, None)
        )
        out.append(
            {
                "reads": reads,
                "kind": KINDS[kind].name,
                "count": len(mine),
                "unit": _unit(c, mine[0]),
                "low": low,
                "high": high,
                "sigma": float(np.median(sigma)) if len(sigma) else None,
            }
        )
    return out


def _unit(c: Campaign, reading: int) -> str:
    turns = bool(c.direction[reading] >= 3)
    return KINDS[int(c.kind[reading])].unit(turns=turns)


def show_campaign(facts: Mapping[str, Any], name: str) -> None:
    """Print the facts of a campaign returned by `campaign_json`."""
    if facts["readings"] or not facts["responses"]:
        _show_readings(facts, name)
    else:
        show_line(f"{name}: frequency responses, no readings", "bold")
    for setup, responses in facts["responses"].items():
        show_responses(setup, responses)


def _show_readings(facts: Mapping[str, Any], name: str) -> None:
    counts = facts["kinds"].items()
    kinds = ", ".join(f"{count} {_PLURAL[kind]}" for kind, count in counts)
    readings = f"{say_count(facts['readings'], 'reading')} ({kinds})"
    show_line(f"{name}: {readings} at {say_count(len(facts['poses']), 'pose')}", "bold")
    if facts["empty"]:
        show_line(f"  {facts['empty']} of them have no value yet")
    if facts["copies"]:
        show_line(f"  {facts['copies']}")
    for remark in facts["remarks"]:
        show_line(f"  {remark['text']}", "yellow")
    if facts["without_sigma"]:
        show_line(
            f"  {facts['without_sigma']} have no uncertainty; it will be estimated"
        )
    counts = facts["sessions"].items()
    sessions = ", ".join(
        f"{label or 'without a name'} {count}" for label, count in counts
    )
    show_line(
        "  one session\n"
        if [*facts["sessions"]] == [""]
        else f"  sessions: {sessions}\n"
    )
    rows = []
    for row in facts["channels"]:
        numbers = (_number(row[key]) for key in ("low", "high", "sigma"))
        rows.append(
            [row["reads"], row["kind"], str(row["count"]), row["unit"], *numbers]
        )
    columns = ["kind", "count", "unit", "least", "greatest", "sigma"]
    show_table("Readings, SI", [["reads"], columns], rows)
    if facts["sensors"]:
        rows = [
            [
                key,
                s["measures"],
                s["body"],
                _three(s.get("at")),
                _three(s["direction"]),
                s.get("frame", s["against"]),
                s["zero"],
            ]
            for key, s in facts["sensors"].items()
        ]
        columns = ["measures", "body", "at, m", "direction", "against or frame", "zero"]
        show_table("Sensors", [["sensor"], columns], rows)
    if facts["loads"]:
        loads = facts["loads"].items()
        rows = [
            [key, at["body"], _three(at["at"]), str(at["readings"])]
            for key, at in loads
        ]
        show_table("Loads", [["load"], ["body", "at, m", "readings"]], rows)
    largest = (
        f"{key} {value:g}" for key, value in facts["largest_wrench"].items() if value
    )
    show_line(f"Largest wrench: {', '.join(largest) or 'none'} (N, N·m)")
    names = facts["coordinates"]
    if not np.isfinite([*facts["poses"].values()]).any():
        show_line(f"Poses: {', '.join(facts['poses'])}, given by name only")
        return
    poses = [
        [
            key,
            *(pose_values([v], [name], 6) for v, name in zip(pose, names, strict=True)),
        ]
        for key, pose in facts["poses"].items()
    ]
    columns = [f"{name} {shown_unit(name)[1]}" for name in names]
    show_table("Poses", [["pose"], columns], poses[:_SHOWN])
    if len(poses) > _SHOWN:
        show_line(f"and {len(poses) - _SHOWN} more: see --json")


def write_page(name: str, facts: Mapping[str, Any], report: Draft) -> None:
    """Write ``report.html`` of a campaign check: the shown tables and the folder's pictures."""
    words = "the robot, with arrows at sensors and loads"
    drawn = report.figures(
        {file: (caption, words) for file, caption in PICTURES.items()}
    )
    about = ["the campaign as read; its readings are not compared with the model"]
    sections = [
        Section("Readings", report.shown, drawn, files=("check.json",)),
        *write_section(report, facts["responses"]),
    ]
    report.write(f"{name}: its readings", about, sections)


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.4g}"


def _three(values: list[float] | None) -> str:
    return "" if values is None else ", ".join(f"{v:.4g}" for v in values)


def draw_sensors(
    draw: Callable[..., None],
    robot: RobotFile,
    found: Configurations,
    campaign: Campaign,
    folder: Path,
) -> None:
    """Draw `PICTURES`: the robot at its first and last pose, with arrows, if drawing is possible.

    Parameters
    ----------
    draw
        Drawing function from `stiffscope.report.pictures.open_drawing`.
    robot, found
        Robot file, and configurations at its poses.
    campaign, folder
        Campaign whose sensors and loads are marked, and folder to write to.
    """
    mechanism = found.mechanism
    shown = []
    arrows = marks(campaign, mechanism)
    for file, k in zip(PICTURES, (0, 0, len(found) - 1), strict=True):
        place = pose_text(
            mechanism, found.tool[k, mechanism.tool.commanded_axes].tolist()
        )
        title = f"{robot.name}, sensors and loads at {place}"
        shown.append(
            {"file": file, "title": title, "moves": place_robot(found, k).moves}
        )
    named, first, last = shown
    named["names"] = True
    pictures = [first]
    if arrows:
        pictures.insert(0, named)
    if len(found) > 1:
        pictures.append(last)
    with optional_pictures():
        draw(
            "robot", folder, pictures=pictures, marks=arrows, **scene(robot, mechanism)
        )


def marks(campaign: Campaign, mechanism: Mechanism) -> list[dict[str, Any]]:
    """Return arrows for `drawing.robot`: each sensor's direction and each load's largest force."""
    arrows: list[tuple[Any, ...]] = []
    for sensor in campaign.sensors:
        at = _place(mechanism, sensor.body) if sensor.rotates else np.array(sensor.at)
        arrows.append(
            ("sensor", sensor.name, sensor.body, at, np.array(sensor.direction))
        )
    places = [
        ("load at M", mechanism.tool.body, mechanism.tool.at),
        *((load.name, load.body, np.array(load.at)) for load in campaign.loads),
    ]
    for k, (name, node, at) in enumerate(places):
        forces = np.nan_to_num(campaign.wrench[campaign.load == k - 1, :3])
        size = np.linalg.norm(forces, axis=1)
        if size.any():
            best = int(np.argmax(size))
            arrows.append(("load", name, node, at, forces[best] / size[best]))
    keys = ("kind", "name", "node", "at", "direction")
    return [dict(zip(keys, arrow, strict=True)) for arrow in arrows]


def _place(mechanism: Mechanism, node: str) -> np.ndarray:
    """Return a point of a node's body at home, for quantities of the whole body."""
    body = next((b for b in mechanism.bodies if node in b.nodes), None)
    if body is not None and body.elastic is not None:
        return body.elastic.places[body.nodes.index(node)]
    if mechanism.tool.body == node or body is None or body.centre is None:
        return mechanism.tool.at
    return body.centre
