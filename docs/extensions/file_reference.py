"""Pages generated from code: file keys, Python names, the gallery and rotatable robots."""

from __future__ import annotations

import base64
import contextlib
import inspect
import io
import re
import runpy
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from docutils import nodes
from docutils.parsers.rst import Directive, directives
from docutils.statemachine import StringList

import stiffscope
from stiffscope.files.keys import TABLES, all_keys
from stiffscope.gap.effects.vocabulary import EFFECTS
from stiffscope.notebook.objects import HEIGHT, as_html
from stiffscope.registry import load, slices
from stiffscope.report.pictures import open_drawing
from stiffscope.report.robot_scene import place_robot, scene
from stiffscope.robot.library import robot_names

if TYPE_CHECKING:
    from sphinx.application import Sphinx


class FileKeys(Directive):
    """Tables of every key of a kind of file, with a description of each section."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Return the paragraphs and tables of all sections."""
        kind = self.arguments[0]
        lines = []
        about = dict(TABLES) if kind == "robot" else _registered_sections(kind)
        for title, rows in all_keys()[kind].items():
            words = (
                inspect.cleandoc(about[title].__doc__ or "") if title in about else ""
            )
            lines += [f"### {title[0].upper()}{title[1:]}", "", words, ""]
            lines += ["| key | meaning | value | default |", "|---|---|---|---|"]
            lines += [
                f"| `{row.key}` | {row.means} | {row.takes} | {row.default} |"
                for row in rows
            ]
            lines.append("")
        return parsed(self, lines)


def _registered_sections(kind: str) -> dict[str, Any]:
    """Return the schemas of a kind of file by title."""
    return {
        title: model
        for each in slices().values()
        for of, tables in each.keys
        if of == kind
        for title, model in load(tables)
    }


class CampaignKeys(Directive):
    """Tables of all keys of campaign.toml, the quantities, and the effects with their parameters."""

    def run(self) -> list[nodes.Node]:
        """Return the tables."""
        *sections, quantities = list(all_keys()["campaign"].items())[:-1]
        lines: list[str] = []
        for title, rows in sections:
            lines += [f"### {title}", ""]
            lines += ["| key | meaning | value | default |", "|---|---|---|---|"]
            lines += [
                f"| `{row.key}` | {row.means} | {row.takes} | {row.default} |"
                for row in rows
            ]
            lines.append("")
        lines += [
            "### Quantities at M",
            "",
            "| quantity | meaning | unit |",
            "|---|---|---|",
        ]
        for row in quantities[1]:
            words, _, unit = row.means.rpartition(" (")
            lines.append(f"| `{row.key}` | {words} | {unit.rstrip(')')} |")
        lines += ["", "### Effects", "", "| effect | parameters |", "|---|---|"]
        for effect, parameters in EFFECTS.items():
            listed = ", ".join(f"`{name}` ({unit})" for name, unit in parameters[:9])
            lines.append(
                f"| `{effect}` | {listed + (' …' if len(parameters) > 9 else '') or 'none'} |"
            )
        return parsed(self, lines)


class Gallery(Directive):
    """Scripts of examples/: docstring, printed output, rotatable robot and code of each."""

    def run(self) -> list[nodes.Node]:
        """Run the scripts and return one section each."""
        folder = Path(__file__).parents[2] / "examples"
        return [self._shown(file) for file in sorted(folder.glob("*.py"))]

    def _shown(self, file: Path) -> nodes.Node:
        said = io.StringIO()
        with contextlib.redirect_stdout(said):
            names = runpy.run_path(str(file), run_name="__main__")
        head, _, words = inspect.cleandoc(names["__doc__"]).partition("\n\n")
        title = head.rstrip(".").partition(": ")[2]
        section = nodes.section(ids=[nodes.make_id(file.stem)])
        section += nodes.title("", title[0].upper() + title[1:])
        section += parsed(
            self,
            [*words.splitlines(), "", f"`python -m examples.{file.stem}` prints", ""],
        )
        section += nodes.literal_block("", said.getvalue().rstrip(), language="text")
        section += nodes.raw(
            "", stiffscope.view(names["robot"])._repr_html_(), format="html"
        )
        section += nodes.literal_block(
            "", file.read_text(encoding="utf-8"), language="python"
        )
        return section


class TurningRobot(Directive):
    """A rotatable, deforming robot of the library by beam theory; optional ``height`` in pixels."""

    required_arguments = 1
    option_spec: ClassVar[dict[str, Any]] = {"height": directives.nonnegative_int}

    def run(self) -> list[nodes.Node]:
        """Return the view shown by notebooks."""
        robot = stiffscope.load_robot(self.arguments[0])
        shown = stiffscope.view(stiffscope.assemble(robot, "beam"), robot)._repr_html_()
        height = self.options.get("height", HEIGHT)
        return [
            nodes.raw(
                "",
                shown.replace(f"height:{HEIGHT}px", f"height:{height}px"),
                format="html",
            )
        ]


class WaysIn(Directive):
    """Pictures drawn by the package, each with a link to its guide."""

    def run(self) -> list[nodes.Node]:
        """Return the cards."""
        robot = stiffscope.load_robot("biglide")
        machine = stiffscope.assemble(robot, "beam")
        part = stiffscope.deformed(
            stiffscope.run_experiment(stiffscope.build_part(robot, "slider"))
        )
        gap = as_html(stiffscope.diagnose("gauges"))
        measured = re.search(r'src="(data:image/svg[^"]*)"', gap)[1]
        return _cards(
            (
                "guides/robot",
                _png(stiffscope.stiffness_map(machine, robot.map.ranges()).png),
                "My design",
                "stiffness map of the workspace",
            ),
            ("guides/part", _png(part.png), "My part", "a part under unit loads"),
            (
                "guides/measurements",
                measured,
                "My measurements",
                "the gap before and after the diagnosis",
            ),
        )


class BundledRobots(Directive):
    """Pictures of the bundled robots at their first poses, with their descriptions."""

    def run(self) -> list[nodes.Node]:
        """Return the cards."""
        cards = []
        with tempfile.TemporaryDirectory() as folder, open_drawing() as draw:
            for name, words in robot_names().items():
                robot = stiffscope.load_robot(name)
                machine = stiffscope.assemble(robot, "beam")
                first = stiffscope.configure(machine, list(robot.poses.values())[:1])
                picture = {
                    "file": f"{name}.png",
                    "title": "",
                    "moves": place_robot(first).moves,
                }
                draw("robot", Path(folder), pictures=[picture], **scene(robot, machine))
                png = _png((Path(folder) / f"{name}.png").read_bytes())
                cards.append(("guides/robot", png, name, words))
        return _cards(*cards)


def _cards(*cards: tuple[str, str, str, str]) -> list[nodes.Node]:
    """Return cards made of page, picture, title and words."""
    shown = [
        f'<a href="{page}.html"><img src="{source}" alt=""><strong>{title}</strong><span>{words}</span></a>'
        for page, source, title, words in cards
    ]
    return [
        nodes.raw("", f'<div class="ways-in">{"".join(shown)}</div>', format="html")
    ]


def _png(png: bytes) -> str:
    return f"data:image/png;base64,{base64.b64encode(png).decode()}"


class Facade(Directive):
    """Documentation of the names of ``import stiffscope`` under the headings of its docstring."""

    def run(self) -> list[nodes.Node]:
        """Return the documentation by autodoc."""
        lines: list[str] = []
        for line in inspect.cleandoc(stiffscope.__doc__ or "").splitlines()[3:]:
            name = line.split()[0] if line.startswith("    ") else ""
            if name:
                kind, *members = (
                    ("class", "   :members:")
                    if inspect.isclass(getattr(stiffscope, name))
                    else ("function",)
                )
                lines += [
                    "```{eval-rst}",
                    f".. auto{kind}:: stiffscope.{name}",
                    *members,
                    "```",
                    "",
                ]
            elif line:
                lines += [f"### {line}", ""]
        return parsed(self, lines)


def parsed(directive: Directive, lines: list[str]) -> list[nodes.Node]:
    """Parse lines of Markdown and return their nodes."""
    node = nodes.Element()
    directive.state.nested_parse(
        StringList(lines, source="from the code"), directive.content_offset, node, True
    )
    return node.children


def setup(app: Sphinx) -> dict[str, Any]:
    """Add the directives."""
    app.add_directive("file-keys", FileKeys)
    app.add_directive("campaign-keys", CampaignKeys)
    app.add_directive("gallery", Gallery)
    app.add_directive("turning-robot", TurningRobot)
    app.add_directive("ways-in", WaysIn)
    app.add_directive("bundled-robots", BundledRobots)
    app.add_directive("facade", Facade)
    return {"parallel_read_safe": True}
