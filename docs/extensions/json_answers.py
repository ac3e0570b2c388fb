"""Fields of every command's JSON: `json_fields`, checked against the commands' output."""

from __future__ import annotations

import contextlib
import json
import shutil
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any
from unittest import mock

import click
from docutils.parsers.rst import Directive
from file_reference import parsed
from json_fields import ANSWERS

from stiffscope.cad.solid import build
from stiffscope.cad.step import write_step
from stiffscope.cli.main import _guarded, cli
from stiffscope.lab.blind.scores import Outcome, score
from stiffscope.lab.show import scores_json
from stiffscope.robot.reader import load_robot
from stiffscope.runtime.executor import Here
from stiffscope.runtime.json_text import to_json

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from docutils import nodes
    from sphinx.application import Sphinx

MADE_UP = Outcome(
    1,
    "single",
    ("backlash @ motor",),
    "identified",
    ("backlash @ motor",),
    ((),),
    20.0,
    (9.0, 1.0, 1.0, 1.0),
    (True,),
    robot="serial-arm",
    stated=((0.99, True),),
)
EXAMPLES = Path(__file__).parents[2] / "examples"
CAPITALS = (
    "DIR",
    "PART.",
    "TAP.",
    "ARM.",
    "STUDY.",
    "JOB.",
    "LOBES.",
    "BEARING.",
    "ROBOT",
    "CAMPAIGN",
)
"""Prefixes of words that stand for a file or folder."""
URDF = """<robot name="arm">
  <link name="stand"/>
  <link name="arm"><inertial>
    <mass value="2"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="shoulder" type="revolute"><parent link="stand"/><child link="arm"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" effort="0" velocity="0"/></joint>
</robot>
"""
STUDY = """robot = "five-bar"
method = "grid"
minimize = "mass"
parameters = { "inner.radius" = { values = ["14 mm", "16 mm"] } }
responses = { mass = "mass" }
"""
BEARING = """kind = "angular-contact"
balls = 18
ball = "9.525 mm"
pitch = "75 mm"
angle = "25 deg"
osculation = [0.52, 0.53]
preload = "400 N"
"""
JOB = """robot = "serial-arm"
components = "beam"
path = "path.csv"
process = { milling = { material = "C45E", diameter = 0.01, teeth = 4, speed = "50 1/s", depth = 1e-3, width = 3e-3 } }
"""
LOBES = JOB + "lobes = { damping = 0.03, points = 9 }\n"


class Answers(Directive):
    """Tables of the fields of each command's JSON: meaning, unit and form in a run."""

    def run(self) -> list[nodes.Node]:
        """Run the commands and return the tables. Raise an error if fields are not as described."""
        left = set(_commands(cli)) - set(ANSWERS)
        if left:
            raise self.error(f"no fields are described of {', '.join(sorted(left))}")
        lines: list[str] = []
        with _place() as place:
            for name, (words, fields) in ANSWERS.items():
                forms = self._forms(name, self._answer(words, place), fields)
                shown = " ".join(f'"{word}"' if " " in word else word for word in words)
                lines += [f"## {name}", "", f"`stiffscope {shown} --json FILE`:", ""]
                lines += ["| field | meaning | unit | form |", "|---|---|---|---|"]
                lines += [
                    f"| `{path.rstrip('?') or ' '}` | {words} | {unit} | {forms.get(path.rstrip('?'), 'absent')} |"
                    for path, (words, unit) in fields.items()
                ] + [""]
        return parsed(self, lines)

    def _forms(
        self, name: str, answer: Any, fields: Mapping[str, tuple[str, str]]
    ) -> dict[str, str]:
        """Return the form of each field. Raise an error if answer and description disagree."""
        described = {path.rstrip("?"): path.endswith("?") for path in fields}
        forms: dict[str, str] = {}
        for path, value in _leaves(answer, "", set(described)):
            forms.setdefault(path, _form(value))
        unknown = set(forms) - set(described)
        missing = {p for p, rare in described.items() if not rare} - set(forms)
        if unknown or missing:
            raise self.error(
                f"{name} --json: not described {sorted(unknown)}; described and not there {sorted(missing)}"
            )
        return forms

    def _answer(self, words: list[str], place: Path) -> Any:
        """Return a command's JSON; words in capitals are files and folders in ``place``."""
        if words[0] == "blind":  # takes minutes: use its writer with a made-up outcome
            about = {"campaigns": 1, "seed": 1, "machine": "own", "seconds": 0.0}
            return json.loads(to_json(about | scores_json(score([MADE_UP]))))
        target = place / "answer.json"
        filled = [
            str(place / word) if word.startswith(CAPITALS) else word for word in words
        ]
        if "DIR" in words:
            shutil.rmtree(place / "DIR", ignore_errors=True)
        if _guarded([*filled, "--quiet", "--json", str(target)]) != 0:
            raise self.error(f"{' '.join(words)} failed")
        answer = json.loads(target.read_text(encoding="utf-8"))
        (answer[0] if isinstance(answer, list) else answer).pop("made_by")
        return answer


@contextlib.contextmanager
def _place() -> Iterator[Path]:
    """Yield a folder with the commands' inputs; experiments run here, to import CAD only once."""
    robot = load_robot("biglide")
    with (
        tempfile.TemporaryDirectory() as folder,
        mock.patch("stiffscope.runtime.workshop.Processes", Here),
    ):
        place = Path(folder)
        write_step(
            build(robot.parts["slider"].parameters(), robot.material("slider")),
            place / "PART.step",
        )
        (place / "ARM.urdf").write_text(URDF)
        shutil.copyfile(EXAMPLES / "hammer" / "tap.uff", place / "TAP.uff")
        (place / "STUDY.toml").write_text(STUDY)
        (place / "JOB.toml").write_text(JOB)
        (place / "LOBES.toml").write_text(LOBES)
        (place / "BEARING.toml").write_text(BEARING)
        tool = load_robot("serial-arm").tool.at
        rows = [
            f"{tool[0] + 1e-3 * k},{tool[1]},{tool[2]},0,0,0,0.01" for k in range(5)
        ]
        (place / "path.csv").write_text("\n".join(["x,y,z,rx,ry,rz,feed", *rows]))
        yield place


def _commands(group: click.Group, before: str = "") -> Iterator[str]:
    """Yield the words of every command with `--json`."""
    context = click.Context(group)
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        if any(option.opts == ["--json"] for option in getattr(command, "params", ())):
            yield before + name
        if isinstance(command, click.Group):
            yield from _commands(command, f"{before}{name} ")


def _leaves(value: Any, path: str, described: set[str]) -> Iterator[tuple[str, Any]]:
    """Yield paths in the notation of `json_fields`, and the value at each."""
    below = f"{path}." if path else ""
    if isinstance(value, dict) and any(
        each.startswith(below) and each != path for each in described
    ):
        for name, inner in value.items():
            plain = f"{below}{name}"
            known = plain in described or any(
                each.startswith((f"{plain}.", f"{plain}[]")) for each in described
            )
            yield from _leaves(
                inner,
                plain
                if known
                else f"{below}*"
                if _any_name(below, described)
                else plain,
                described,
            )
    elif isinstance(value, list) and any(
        each.startswith(f"{path}[]") for each in described
    ):
        for inner in value:
            yield from _leaves(inner, f"{path}[]", described)
    else:
        yield path, value


def _any_name(below: str, described: set[str]) -> bool:
    return any(
        each == f"{below}*" or each.startswith(f"{below}*.") for each in described
    )


def _form(value: Any) -> str:
    """Return a value's form, e.g. 2 × 6 × 6 numbers."""
    if isinstance(value, list):
        sizes = []
        inner = value
        while isinstance(inner, list):
            sizes.append(len(inner))
            inner = inner[0] if inner else None
        return (
            f"{' × '.join(map(str, sizes))} {_word(inner, 's')}"
            if sizes[-1]
            else "empty list"
        )
    return _word(value, "")


def _word(value: Any, several: str) -> str:
    names = {str: "text", float: "number", int: "whole number", dict: "table"}
    return {bool: "true or false", type(None): "null"}.get(type(value)) or names[
        type(value)
    ] + several


def setup(app: Sphinx) -> dict[str, Any]:
    """Add the directive."""
    app.add_directive("answers", Answers)
    return {"parallel_read_safe": True}
