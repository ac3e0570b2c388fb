"""Comparison of FEA, beam theory and published matrix entry by entry, with failing assumptions.

For any parametric part; "published" requires a published matrix in the robot file.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.fea.beam import euler_bernoulli, polar, restrained_torsion
from stiffscope.robot import part_matrices as parts_of
from stiffscope.robot.file.part_sections import ParametricPart

if TYPE_CHECKING:
    from stiffscope.cad.cross_sections import Section
    from stiffscope.cad.materials import AnyMaterial
    from stiffscope.experiments.experiments import PartResult
    from stiffscope.fea.experiment import Experiment
    from stiffscope.robot.file.description import RobotFile


@dataclass(frozen=True)
class Entry:
    """One entry of a part's compliance from every source, SI; None from a source without it."""

    name: str
    unit: str
    fea: float
    error: float
    euler_bernoulli: float | None
    timoshenko: float | None
    published: float | None


@dataclass(frozen=True)
class Comparison:
    """Entries that are nonzero in any source, and findings on their differences as sentences."""

    part: str
    entries: tuple[Entry, ...]
    findings: tuple[str, ...]


def compare(robot: RobotFile, name: str, result: PartResult | Experiment) -> Comparison:
    """Compare a parametric part's compliance by FEA, by beam theory and as published.

    Parameters
    ----------
    robot, name
        Robot, and name of a parametric part of it.
    result
        Result of the part's virtual experiment.

    Returns
    -------
    Comparison
        Entries side by side, and findings as sentences.
    """
    sources = _list_sources(robot, name)
    fea = result.compliance
    error = result.error
    scale = np.sqrt(np.outer(np.diag(fea), np.diag(fea)))
    shown = np.abs(fea) > np.maximum(error, 1e-4 * scale)
    for matrix in (sources["timoshenko"], sources["published"]):
        if matrix is not None:
            shown |= matrix != 0.0
    entries = []
    for i, j in np.argwhere(np.triu(shown)).tolist():
        others = {
            source: None if matrix is None else float(matrix[i, j])
            for source, matrix in sources.items()
        }
        value = (float(fea[i, j]), float(error[i, j]))
        entries.append(Entry(*parts_of.entry_name(i, j), *value, **others))
    findings = _findings(robot, name, fea, **sources)
    return Comparison(name, tuple(entries), tuple(findings))


def _list_sources(robot: RobotFile, name: str) -> dict[str, np.ndarray | None]:
    """Return the compliance (6, 6) of a part by each source but FEA; None if it has none."""
    simple = beam = printed = None
    part = robot.part(name)
    if "beam" in part.sources:
        simple = parts_of.beam_compliance(robot, name, euler_bernoulli)
        beam = parts_of.beam_compliance(robot, name)
    # a matrix that was published is not of a part of another shape or material
    is_published = parts_of.is_published_part(robot, name)
    known = {n for n, each in robot.parts.items() if getattr(each, "published", None)}
    by_formula = (
        isinstance(part, ParametricPart) and part.describes.published == "formula"
    )
    if is_published and (name in known or (known and by_formula)):
        printed = parts_of.published_compliance(robot, name)
    return {"euler_bernoulli": simple, "timoshenko": beam, "published": printed}


def _findings(
    robot: RobotFile,
    name: str,
    fea: np.ndarray,
    *,
    euler_bernoulli: np.ndarray | None,
    timoshenko: np.ndarray | None,
    published: np.ndarray | None,
) -> list[str]:
    """Return one sentence per assumption that fails."""
    part = robot.part(name)
    material = robot.material(name)
    simple = euler_bernoulli
    beam = timoshenko
    printed = published
    if not isinstance(part, ParametricPart) or material is None:
        return []
    if simple is None or beam is None:
        return [f"There is no beam theory of a {part.shape}: only the FEA stands here"]
    shape = part.parameters()
    segments = parts_of.beam_segments(robot, name)
    length = sum(length for length, _ in segments)
    section = segments[0][1]
    findings = []
    if shape.beyond_beam:
        present = " and ".join(shape.beyond_beam)
        findings.append(
            f"Beam theory models the bare {shape.shape}: the {present} are in the FEA only"
        )
    for i, axis in ((1, "y"), (2, "z")):
        share = 1 - simple[i, i] / beam[i, i]
        if share > 0.02:
            slender = length / shape.across[i - 1]
            findings.append(
                f"C{i + 1}{i + 1}: shear makes {100 * share:.0f} % of the deflection along {axis}, where the "
                f"part is only {slender:.2g} times as long as deep; Euler-Bernoulli neglects it"
            )
    narrowing = 1 - fea[4, 4] / beam[4, 4]
    if shape.is_plate and narrowing > 0.03 and not shape.beyond_beam:
        findings.append(
            f"C33, C35, C55: a wide plate bends {100 * narrowing:.0f} % less about y than a beam, whose "
            "section is free to contract and expand sideways"
        )
    findings += _torsion(section, material, length, fea[3, 3] / beam[3, 3])
    if printed is not None and printed[3, 3] < 0.5 * beam[3, 3]:
        over = polar(section).torsion / section.torsion
        findings.append(
            f"C44 as published is {fea[3, 3] / printed[3, 3]:.1f} times too stiff: its torsion constant "
            f"is I_y + I_z, {over:.1f} times Saint-Venant's; they are equal for round sections alone"
        )
    if printed is not None and printed[1, 1] < 0.5 * fea[1, 1]:
        over = fea[1, 1] / printed[1, 1]
        findings.append(
            f"C22 as published is {over:.1f} times too stiff: it has no shear"
        )
    if not findings:
        worst = np.max(np.abs(np.diag(fea) / np.diag(beam) - 1))
        findings.append(
            f"Beam theory holds: the diagonal is within {100 * worst:.2f} % of Timoshenko's; the clamped "
            "end, which cannot contract sideways, explains such a difference"
        )
    return findings


def _torsion(
    section: Section, material: AnyMaterial, length: float, torsion: float
) -> list[str]:
    """Return findings on torsion, given the ratio of FEA's compliance to Saint-Venant's."""
    rows = []
    if abs(torsion - 1) > 0.02:
        effect = "the part is too short for the end effect to decay (Saint-Venant)"
        if section.warping:
            modulus = material.shear_modulus
            twist = restrained_torsion(
                length, section, material.youngs_modulus, modulus
            )
            held = twist * modulus * section.torsion / length
            effect = f"Vlasov's theory gives {held:.2f} times with warping restrained at both ends"
        where = "in which the ends warp freely; here they cannot"
        rows.append(
            f"C44: {torsion:.2f} times Saint-Venant's torsion, {where}, and {effect}"
        )
    if section.shear_centre:
        rows.append(
            f"C34: the shear centre is {1e3 * abs(section.shear_centre):.3g} mm from the centroid, on the "
            "web's side: a force along z through the centroid twists the beam"
        )
    return rows
