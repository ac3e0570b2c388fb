"""Figures of computed and known results, drawn when the pages are built; tests assert the same."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from docutils import nodes
from docutils.parsers.rst import Directive
from inline_pictures import embed_svg

from stiffscope.cad.cross_sections import circle
from stiffscope.fea.beam import timoshenko
from stiffscope.fea.run import run_experiment
from stiffscope.report.figures import AFTER, BEFORE, EFFECT, STYLE, new_figure
from stiffscope.robot.beam_dynamics import beam_dynamics
from stiffscope.vjm.model.bodies import member
from stiffscope.vjm.model.joints import Drive, Joint
from stiffscope.vjm.model.mechanism import Mechanism, Tool
from stiffscope.vjm.statics.analysis import stiffness
from stiffscope.vjm.vibration.modes import modes

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))  # for the tests' exact solutions and independent models
from tests.robots import cubic_hexapod, robot_of  # noqa: E402
from tests.validation.parts import STEEL, bar, plate  # noqa: E402

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from sphinx.application import Sphinx


def parts() -> tuple[Figure, str]:
    """Compare computed compliances of bars and plates with exact ones, with error bars."""
    solids = {
        "bar": bar(),
        "tube": bar(bore=0.015, length=0.1),
        "steel bar": bar(material=STEEL),
        "plate": plate(),
    }
    labels = []
    off = []
    bounds = []
    for name, (part, exact) in solids.items():
        found = run_experiment(part)
        for (i, j), value in exact.items():
            labels.append(f"{name}, C{i + 1}{j + 1}")
            off.append(1e6 * (found.compliance[i, j] / value - 1))
            bounds.append(1e6 * found.error[i, j] / abs(value))
    figure = new_figure(
        8.6,
        0.8 + 0.26 * len(labels),
        "Compliance beside the exact solution, with its 95 % bound",
    )
    axes = figure.subplots()
    axes.errorbar(
        off,
        range(len(labels)),
        xerr=bounds,
        fmt="o",
        color=AFTER,
        ecolor=EFFECT,
        capsize=3,
    )
    axes.axvline(0.0, color=BEFORE, lw=0.8)
    axes.set_yticks(range(len(labels)), labels, fontsize=8)
    axes.invert_yaxis()
    axes.set_xlabel("difference from the exact value, parts per million")
    return (
        figure,
        f"{len(labels)} entries; the largest difference is {max(map(abs, off)):.0f} parts per million",
    )


def hexapod() -> tuple[Figure, str]:
    """Compare a cubic Gough-Stewart platform with its closed form over the tool point's height."""
    k = 2.5e6
    size = 0.3
    heights = np.linspace(0.0, 0.4, 41)
    ours = []
    for height in heights:
        robot = cubic_hexapod(size, k, height)
        ours.append(stiffness(robot, robot.tool.home)[0])
    figure = new_figure(
        8.6, 3.2, "Cubic hexapod: stiffness at a point above its centre"
    )
    axes = figure.subplots()
    worst = 0.0
    for i, closed in (
        (0, 2 * k + 0 * heights),
        (3, 1.5 * k * size**2 + 2 * k * heights**2),
        (5, 6 * k * size**2 + 0 * heights),
    ):
        values = np.array([matrix[i, i] for matrix in ours])
        worst = max(worst, float(np.abs(values / closed - 1).max()))
        axes.semilogy(heights, closed, color=BEFORE, lw=3, alpha=0.4)
        axes.semilogy(
            heights[::4],
            values[::4],
            "o",
            ms=4,
            label=("K_tx", "", "", "K_rx", "", "K_rz")[i],
        )
    axes.set(xlabel="height of M above the centre (m)", ylabel="N/m, N·m/rad")
    axes.legend(frameon=False, ncols=3)
    return (
        figure,
        f"grey: closed form; points: computed; the largest relative difference is {worst:.0e}",
    )


def former() -> tuple[Figure, str]:
    """Compare the Biglide with its former closed-form assembler over the workspace."""
    held = np.load(ROOT / "tests" / "validation" / "former_assembler.npz")
    ours = stiffness(
        robot_of(held["published_link"], held["published_slider"]), held["poses"]
    )
    theirs = held["published_K"]
    size = np.sqrt(np.einsum("nii,njj->nij", theirs, theirs))
    off = np.abs((ours - theirs) / size).max(axis=(1, 2))
    figure = new_figure(
        8.6,
        2.6,
        "Biglide: all 36 entries beside a tree of springs in series and parallel",
    )
    axes = figure.subplots()
    axes.semilogy(np.maximum(off, 1e-17), "o", color=AFTER, ms=4)
    axes.set(xlabel="pose", ylabel="largest difference, relative")
    return (
        figure,
        f"{len(off)} poses over the workspace; the largest relative difference is {off.max():.0e}",
    )


def frequencies() -> tuple[Figure, str]:
    """Compare a clamped slender rod with its textbook frequencies."""
    e = 211e9
    g = 81e9
    density = 7850.0
    section = circle(0.002)
    dynamics = beam_dynamics([(0.4, section), (0.6, section)], e, g, density, 14)
    rod = member(
        "rod", [0, 0, 0], [1, 0, 0], timoshenko(1.0, section, e, g), dynamics=dynamics
    )
    slide = Joint(
        "slide",
        "ground",
        "rod.base",
        "prismatic",
        [0, 0, 0],
        [1, 0, 0],
        drive=Drive(1e15),
    )
    found = modes(
        Mechanism((rod,), (slide,), Tool("rod.tip", [1, 0, 0], ("x",))), [[1.0]], 20
    ).frequencies[0, :6:2]
    known = np.array([1.875104, 4.694091, 7.854757]) ** 2
    known *= np.sqrt(e * section.bending_y / (density * section.area)) / (2 * np.pi)
    figure = new_figure(
        8.6, 2.6, "Bending frequencies of a clamped rod, 1 m long, 4 mm thick"
    )
    axes = figure.subplots()
    axes.bar(
        np.arange(3) - 0.2, known, 0.38, color=BEFORE, label="(β L)² √(EI / ρ A L⁴)"
    )
    axes.bar(np.arange(3) + 0.2, found, 0.38, color=EFFECT, label="computed")
    axes.set_xticks(range(3), ["first", "second", "third"])
    axes.set_ylabel("Hz")
    axes.legend(frameon=False)
    return (
        figure,
        f"the largest relative difference is {np.abs(found / known - 1).max():.0e}",
    )


SHOWN = {
    "Parts: exact solutions of elasticity": (parts, "tests/validation/test_parts.py"),
    "A hexapod: closed form": (hexapod, "tests/validation/test_second_robots.py"),
    "The Biglide: another assembler": (
        former,
        "tests/validation/test_former_assembler.py",
    ),
    "Natural frequencies: a textbook beam": (frequencies, "tests/vjm/test_modes.py"),
}


class KnownAnswers(Directive):
    """Sections with a figure, its statement, and the command that asserts it."""

    def run(self) -> list[nodes.Node]:
        """Draw the figures and return their sections."""
        import matplotlib as mpl

        found: list[nodes.Node] = []
        for title, (draw, test) in SHOWN.items():
            section = nodes.section(ids=[nodes.make_id(title)])
            with mpl.rc_context(STYLE):
                figure, words = draw()
                picture = embed_svg(figure, f"{title}: {words}")
            said = nodes.paragraph(
                "",
                f"{words[0].upper()}{words[1:]}. ",
                nodes.literal("", f"python -m pytest {test}"),
            )
            section += [nodes.title("", title), picture, said]
            found.append(section)
        return found


def setup(app: Sphinx) -> dict[str, Any]:
    """Add the directive."""
    app.add_directive("known-answers", KnownAnswers)
    return {"parallel_read_safe": True}
