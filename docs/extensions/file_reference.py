"""Pages made from the code: every key of a robot file, every field of a JSON answer, every Python name."""

from __future__ import annotations

import inspect
import json
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

from docutils import nodes
from docutils.parsers.rst import Directive
from docutils.statemachine import StringList
from pydantic_core import PydanticUndefined

import stiffscope
from stiffscope.cli.main import _guarded
from stiffscope.robot import part_sections, sections
from stiffscope.robot.study_file import SECTIONS
from stiffscope.robot.values import Reads, Says

if TYPE_CHECKING:
    from sphinx.application import Sphinx

TABLES = (
    ('[parts.NAME], shape = "rod"', part_sections.RodPart),
    ('[parts.NAME], shape = "plate"', part_sections.PlatePart),
    ('[parts.NAME], shape = "step"', part_sections.StepPart),
    ('[parts.NAME], shape = "matrix"', part_sections.MatrixPart),
    ("[parts.NAME.mesh]", part_sections.Mesh),
    ("A choice of faces: clamped, loaded of a STEP part", part_sections.Face),
    ("[materials.NAME], isotropic", part_sections.Isotropic),
    ("[materials.NAME], of fibres along x", part_sections.Fibrous),
    ("[bodies.NAME], with a part", sections.ElasticBody),
    ("[bodies.NAME], rigid", sections.RigidBody),
    *((f'[joints.NAME], type = "{name}"', joint) for name, joint in sections.JOINTS.items()),
    ("drive of a slide", sections.LinearDrive),
    ("drive about an axis", sections.RotaryDrive),
    ("compliance of a joint", sections.Bearing),
    ("[[copies]]", sections.Copies),
    ("[tool]", sections.ToolSection),
    ("[gravity]", sections.GravitySection),
    ("[map]", sections.MapSection),
    ("[[effects]]", sections.Effect),
)
ANSWERS = {
    "stiffness": ["stiffness", "biglide", "--components", "published"],
    "modes": ["modes", "biglide", "--components", "published", "--at", "Q1"],
    "check": ["check", "biglide"],
}


class RobotFileKeys(Directive):
    """Tables of every key of a robot file."""

    tables = TABLES

    def run(self) -> list[nodes.Node]:
        """Return a section's paragraphs and tables."""
        lines: list[str] = []
        for title, model in self.tables:
            lines += [f"### {title}", "", inspect.cleandoc(model.__doc__ or ""), "", "| key | takes | default |"]
            lines += ["|---|---|---|"]
            for name, field in model.model_fields.items():
                default = "**needed**" if field.is_required() else _default(field)
                lines.append(f"| `{field.alias or name}` | {_takes(field)} | {default} |")
            lines.append("")
        return _parsed(self, lines)


class StudyFileKeys(RobotFileKeys):
    """Tables of every key of a study's file."""

    tables = SECTIONS


class AnswerFields(Directive):
    """A table of the fields of a command's JSON answer, as the command writes them now."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Run the command and return the table."""
        words = ANSWERS[self.arguments[0]]
        with tempfile.TemporaryDirectory() as folder:
            target = Path(folder) / "answer.json"
            if _guarded([*words, "--quiet", "--json", str(target)]) != 0:
                raise self.error(f"{' '.join(words)} failed")
            answer = json.loads(target.read_text(encoding="utf-8"))
        rows = [f"| `{name}` | {_shape(value)} |" for name, value in answer.items()]
        return _parsed(
            self, [f"`stiffscope {' '.join(words)} --json FILE`:", "", "| field | holds |", "|---|---|", *rows]
        )


class Facade(Directive):
    """The names of ``import stiffscope``, each with its own documentation."""

    def run(self) -> list[nodes.Node]:
        """Hand every name to autodoc."""
        lines: list[str] = []
        for name in stiffscope.__all__:
            found = getattr(stiffscope, name)
            kind, members = ("class", ["   :members:"]) if inspect.isclass(found) else ("function", [])
            lines += [f".. auto{kind}:: {found.__module__}.{name}", *members, ""]
        return _parsed(self, lines)


def _parsed(directive: Directive, lines: list[str]) -> list[nodes.Node]:
    node = nodes.Element()
    directive.state.nested_parse(StringList(lines, source="from the code"), directive.content_offset, node, True)
    return node.children


def _takes(field: Any) -> str:
    for each in (*field.metadata, *(m for a in get_args(field.annotation) for m in getattr(a, "__metadata__", ()))):
        said = each.says if isinstance(each, Reads) else each if isinstance(each, Says) else ""
        if said:
            return str(said)
    choices = [repr(c) for c in get_args(field.annotation) if isinstance(c, str)]
    return " or ".join(choices) if choices else _plain(field.annotation)


def _plain(annotation: Any) -> str:
    known = {str: "a text", int: "a whole number", float: "a number", bool: "true or false"}
    return known.get(annotation, "see its table" if inspect.isclass(annotation) else "see above")


def _default(field: Any) -> str:
    value = field.get_default(call_default_factory=True)
    if value is None or value is PydanticUndefined:
        return "–"
    return f"`{value}`" if isinstance(value, str | int | float | tuple) else "its own"


def _shape(value: Any) -> str:
    if isinstance(value, dict):
        first = next(iter(value.items()), None)
        return "an empty table" if first is None else f"by name, such as `{first[0]}`: {_shape(first[1])}"
    if isinstance(value, list):
        sizes, inner = [], value
        while isinstance(inner, list):
            sizes.append(len(inner))
            inner = inner[0] if inner else None
        return f"list {' × '.join(map(str, sizes))} of {_word(inner)}"
    return _word(value)


def _word(value: Any) -> str:
    names = {str: "texts", float: "numbers", int: "whole numbers", bool: "true or false", type(None): "nothing (null)"}
    return names.get(type(value), "tables")


def setup(app: Sphinx) -> dict[str, Any]:
    """Add the directives."""
    app.add_directive("robot-file-keys", RobotFileKeys)
    app.add_directive("study-file-keys", StudyFileKeys)
    app.add_directive("answer-fields", AnswerFields)
    app.add_directive("facade", Facade)
    return {"parallel_read_safe": True}
