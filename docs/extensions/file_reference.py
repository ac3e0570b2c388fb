"""Pages made from the code: keys of robot files and campaigns, Python names, the gallery, robots that turn."""

from __future__ import annotations

import contextlib
import inspect
import io
import runpy
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

from docutils import nodes
from docutils.parsers.rst import Directive
from docutils.statemachine import StringList
from pydantic_core import PydanticUndefined

import stiffscope
from stiffscope.design.path import job
from stiffscope.design.study_sections import SECTIONS
from stiffscope.effects.vocabulary import EFFECTS
from stiffscope.gap.campaign.campaign_header import FRAME_KEYS, KEYS, LOAD_KEYS, SENSOR_KEYS
from stiffscope.gap.campaign.quantities import DEFLECTIONS, DEVIATIONS, FREQUENCIES, PUSHES, STIFFNESSES
from stiffscope.robot.file import element_sections, part_sections, sections
from stiffscope.robot.file.values import Reads, Says

if TYPE_CHECKING:
    from sphinx.application import Sphinx

TABLES = (
    ('[parts.NAME], shape = "rod"', part_sections.RodPart),
    ('[parts.NAME], shape = "plate"', part_sections.PlatePart),
    *((f'[parts.NAME], shape = "{name}"', part) for name, part in part_sections.BEAM_PARTS.items()),
    ('[parts.NAME], shape = "step"', part_sections.StepPart),
    ('[parts.NAME], shape = "matrix"', part_sections.MatrixPart),
    ('[parts.NAME], shape = "matrix", with `interfaces`', part_sections.InterfacePart),
    ("[parts.NAME.mesh]", part_sections.Mesh),
    ("interfaces.NAME of a STEP part", part_sections.NamedFaces),
    ("A choice of faces: clamped, loaded of a STEP part", part_sections.Face),
    ("[materials.NAME], isotropic", part_sections.Isotropic),
    ("[materials.NAME], of fibres along x", part_sections.Fibrous),
    ("[bodies.NAME], with a part", sections.ElasticBody),
    ("[bodies.NAME], with a part of named interfaces", sections.InterfaceBody),
    ("[bodies.NAME], rigid", sections.RigidBody),
    *((f'[joints.NAME], type = "{name}"', joint) for name, joint in sections.JOINTS.items()),
    ("drive of a slide", sections.LinearDrive),
    ("drive about an axis", sections.RotaryDrive),
    ("compliance of a joint", sections.Bearing),
    *(
        (
            f"bearing of a joint, kind = {' or '.join(k for k, m in element_sections.ELEMENTS.items() if m is model)}",
            model,
        )
        for model in dict.fromkeys(element_sections.ELEMENTS.values())
    ),
    ("[[copies]]", sections.Copies),
    ("[tool]", sections.ToolSection),
    ("[gravity]", sections.GravitySection),
    ("[map]", sections.MapSection),
    ("[[effects]]", sections.Effect),
)
CAMPAIGN = {
    "robot": "the name of a bundled robot, or the path of a robot file, seen from this folder",
    "predictions": "instead of `robot`: a table with the columns of the readings and `value`, the model under test; "
    "further columns are rival models",
    "modelled": 'effects that the model already carries, such as `["gravity"]`',
    "components": "source of the parts' matrices: `fea` (default), `beam` or `published`",
    "readings": "a file of readings or a list of such: .csv (comma or semicolon, decimal comma too), .tsv, .xlsx",
    "units": 'units by column, such as `{ value = "um", fx = "N" }`; SI without it',
    "ignore": "columns that are not read",
    "frames": "axes of instruments that stand anywhere, by name, see below",
    "sensors": "instruments by name, see below",
    "loads": "points where loads act, by name, see below",
}
SENSOR = {
    "measures": "`displacement` (m), `rotation` (rad), or of a target that an instrument sees `position` "
    "(three readings `NAME.x`, `NAME.y`, `NAME.z`, m) or `distance` (from the origin of its frame, m)",
    "body": "a body, or an end of an elastic one (`leg1.arm.tip`)",
    "at": 'where it touches, at home, base axes, such as `["75 mm", 0, "-15 mm"]`; not for a rotation',
    "at_sigma": 'of a target: how well its place is known, such as `"20 mm"`; without it: known',
    "direction": "sensitive direction, or axis of rotation, base axes; not of a target",
    "against": "the body that its foot stands on; `ground` by default; not of a target",
    "frame": "of a target: the frame in which it is seen, a name of `[frames]`",
    "zero": "`none` (default), or `session`: its zero is unknown, one constant for each session",
}
FRAME = {
    "pose": '`"unknown"`, found with everything else, or `[x, y, z, rx, ry, rz]` in {O}',
    "sigma": "standard uncertainties of a pose's six values; without it: exact",
    "per": "`campaign` (default), or `session`: set up anew with each session",
}
LOAD = {"body": "a body, or an end of an elastic one", "at": "where the load acts, at home, base axes"}
QUANTITIES_READ = {
    "dx … drz": ("deflection of the tool at M by the wrench applied (loaded minus unloaded)", "m, rad"),
    "ex … erz": ("deviation of the unloaded tool from the commanded rigid pose", "m, rad"),
    "kx … krz": ("diagonal K_ii of the stiffness at M: all other motions held", "N/m, N·m/rad"),
    "px … prz": ("force over deflection of a push along that axis, all other motions free: 1/C_ii", "N/m, N·m/rad"),
    "f1 …": ("natural frequencies at the pose, drives held, from below", "Hz"),
}

SECTIONS_READ = (
    ("campaign.toml", CAMPAIGN), ("[frames.NAME]", FRAME), ("[sensors.NAME]", SENSOR), ("[loads.NAME]", LOAD)
)  # fmt: skip


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
        return parsed(self, lines)


class StudyFileKeys(RobotFileKeys):
    """Tables of every key of a study's file."""

    tables = SECTIONS


class JobFileKeys(RobotFileKeys):
    """Tables of every key of a job's file."""

    tables = (
        ("the top level", job.JobSection),
        ("[process]", job.ProcessSection),
        ("[process.force]", job.ForceSection),
        ("[process.milling]", job.MillingSection),
        ("[process.drilling]", job.DrillingSection),
        ("[payload]", job.PayloadSection),
    )


class CampaignKeys(Directive):
    """Tables of every key of campaign.toml, of the quantities, and of the effects with their parameters."""

    def run(self) -> list[nodes.Node]:
        """Return the tables; what is described here and what the code reads must be the same."""
        described = [
            tuple(CAMPAIGN),
            tuple(FRAME),
            tuple(SENSOR),
            tuple(LOAD),
            tuple(k.split()[0] for k in QUANTITIES_READ),
        ]
        firsts = tuple(kind[0] for kind in (DEFLECTIONS, DEVIATIONS, STIFFNESSES, PUSHES, FREQUENCIES))
        if [set(each) for each in described] != [
            set(each) for each in (KEYS, FRAME_KEYS, SENSOR_KEYS, LOAD_KEYS, firsts)
        ]:
            raise self.error("campaign.toml has other keys than are described")
        lines: list[str] = []
        for title, keys in SECTIONS_READ:
            lines += [f"### {title}", "", "| key | takes |", "|---|---|"]
            lines += [f"| `{key}` | {takes} |" for key, takes in keys.items()] + [""]
        lines += ["### Quantities at M", "", "| quantity | is | unit |", "|---|---|---|"]
        lines += [f"| `{name}` | {words} | {unit} |" for name, (words, unit) in QUANTITIES_READ.items()]
        lines += ["", "### Effects", "", "| effect | parameters |", "|---|---|"]
        for effect, parameters in EFFECTS.items():
            listed = ", ".join(f"`{name}` ({unit})" for name, unit in parameters[:9])
            lines.append(f"| `{effect}` | {listed + (' …' if len(parameters) > 9 else '') or 'none'} |")
        return parsed(self, lines)


class Gallery(Directive):
    """Each script of examples/: what it says of itself, what it prints, its robot, which turns, and its code."""

    def run(self) -> list[nodes.Node]:
        """Run the scripts and return a section for each."""
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
        section += parsed(self, [*words.splitlines(), "", f"`python -m examples.{file.stem}` prints", ""])
        section += nodes.literal_block("", said.getvalue().rstrip(), language="text")
        section += nodes.raw("", stiffscope.view(names["robot"])._repr_html_(), format="html")
        section += nodes.literal_block("", file.read_text(encoding="utf-8"), language="python")
        return section


class TurningRobot(Directive):
    """A robot of the library, by beam theory, that turns and bends."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Return the view that a notebook shows."""
        robot = stiffscope.load_robot(self.arguments[0])
        shown = stiffscope.view(stiffscope.assemble(robot, "beam"), robot)
        return [nodes.raw("", shown._repr_html_(), format="html")]


class Facade(Directive):
    """The names of ``import stiffscope``, each with its own documentation."""

    def run(self) -> list[nodes.Node]:
        """Hand every name to autodoc."""
        lines: list[str] = []
        for name in stiffscope.__all__:
            found = getattr(stiffscope, name)
            kind, members = ("class", ["   :members:"]) if inspect.isclass(found) else ("function", [])
            lines += [f".. auto{kind}:: {found.__module__}.{name}", *members, ""]
        return parsed(self, lines)


def parsed(directive: Directive, lines: list[str]) -> list[nodes.Node]:
    """Return what lines of Markdown become."""
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


def setup(app: Sphinx) -> dict[str, Any]:
    """Add the directives."""
    app.add_directive("robot-file-keys", RobotFileKeys)
    app.add_directive("study-file-keys", StudyFileKeys)
    app.add_directive("job-file-keys", JobFileKeys)
    app.add_directive("campaign-keys", CampaignKeys)
    app.add_directive("gallery", Gallery)
    app.add_directive("turning-robot", TurningRobot)
    app.add_directive("facade", Facade)
    return {"parallel_read_safe": True}
