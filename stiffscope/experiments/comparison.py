"""Comparison of FEA, beam theory and published matrix entry by entry, with failing assumptions.

For a rod, plate or section of any robot; "published" requires a published matrix in the robot file.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.fea.beam import euler_bernoulli, polar, restrained_torsion
from stiffscope.robot import part_matrices as parts_of
from stiffscope.robot.file.part_sections import ParametricPart

if TYPE_CHECKING:
    from stiffscope.cad.materials import AnyMaterial
    from stiffscope.experiments.experiments import PartResult
    from stiffscope.fea.beam import Section
    from stiffscope.fea.experiment import Experiment
    from stiffscope.robot.file.description import RobotFile


@dataclass(frozen=True)
class Entry:
    """One entry of a part's compliance from every source, SI."""

    name: str
    unit: str
    fea: float
    error: float
    euler_bernoulli: float
    timoshenko: float
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
    simple = parts_of.beam_compliance(robot, name, euler_bernoulli)
    beam = parts_of.beam_compliance(robot, name)
    printed = _find_printed(robot, name)
    fea = result.compliance
    error = result.error
    scale = np.sqrt(np.outer(np.diag(fea), np.diag(fea)))
    entries = []
    for i, j in np.transpose(np.triu_indices(6)).tolist():
        at: tuple[int, int] = (i, j)
        known = beam[at] or (printed is not None and printed[at])
        if known or abs(fea[at]) > max(error[at], 1e-4 * scale[at]):
            published = None if printed is None else float(printed[at])
            sources = (fea[at], error[at], simple[at], beam[at], published)
            entries.append(Entry(*parts_of.entry_name(*at), *sources))
    findings = _findings(robot, name, fea, simple, beam, printed)
    return Comparison(name, tuple(entries), tuple(findings))


def _find_printed(robot: RobotFile, name: str) -> np.ndarray | None:
    """Return the published compliance (6, 6) that applies to the part, or None.

    None also if the part has another shape or material than the published one.
    """
    known = {n for n, part in robot.parts.items() if getattr(part, "published", None)}
    if not parts_of.is_published_part(robot, name):
        return None
    if name in known or (known and robot.part(name).shape == "rod"):
        return parts_of.published_compliance(robot, name)
    return None


def _findings(
    robot: RobotFile,
    name: str,
    fea: np.ndarray,
    simple: np.ndarray,
    beam: np.ndarray,
    printed: np.ndarray | None,
) -> list[str]:
    """Return one sentence per assumption that fails."""
    part = robot.part(name)
    material = robot.material(name)
    if not isinstance(part, ParametricPart) or material is None:
        return []
    plate = part.shape == "plate"
    segments = parts_of.beam_segments(robot, name)
    length = sum(length for length, _ in segments)
    section = segments[0][1]
    found = _not_in_beam_theory(robot, name)
    for i, axis in ((1, "y"), (2, "z")):
        share = 1 - simple[i, i] / beam[i, i]
        if share > 0.02:
            slender = length / part.measure_across(axis)
            found.append(
                f"C{i + 1}{i + 1}: shear makes {100 * share:.0f} % of the deflection along {axis}, where the "
                f"part is only {slender:.2g} times as long as deep; Euler-Bernoulli neglects it"
            )
    narrowing = 1 - fea[4, 4] / beam[4, 4]
    if plate and narrowing > 0.03 and not _not_in_beam_theory(robot, name):
        found.append(
            f"C33, C35, C55: a wide plate bends {100 * narrowing:.0f} % less about y than a beam, whose "
            "section is free to contract and expand sideways"
        )
    found += _torsion(section, material, length, fea[3, 3] / beam[3, 3])
    if printed is not None and printed[3, 3] < 0.5 * beam[3, 3]:
        over = polar(section).torsion / section.torsion
        found.append(
            f"C44 as published is {fea[3, 3] / printed[3, 3]:.1f} times too stiff: its torsion constant "
            f"is I_y + I_z, {over:.1f} times Saint-Venant's; they are equal for round sections alone"
        )
    if printed is not None and printed[1, 1] < 0.5 * fea[1, 1]:
        over = fea[1, 1] / printed[1, 1]
        found.append(f"C22 as published is {over:.1f} times too stiff: it has no shear")
    if not found:
        worst = np.max(np.abs(np.diag(fea) / np.diag(beam) - 1))
        found.append(
            f"Beam theory holds: the diagonal is within {100 * worst:.2f} % of Timoshenko's; the clamped "
            "end, which cannot contract sideways, explains such a difference"
        )
    return found


def _torsion(
    section: Section, material: AnyMaterial, length: float, torsion: float
) -> list[str]:
    """Return findings on torsion, given the ratio of FEA's compliance to Saint-Venant's."""
    found = []
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
        found.append(
            f"C44: {torsion:.2f} times Saint-Venant's torsion, {where}, and {effect}"
        )
    if section.shear_centre:
        found.append(
            f"C34: the shear centre is {1e3 * abs(section.shear_centre):.3g} mm from the centroid, on the "
            "web's side: a force along z through the centroid twists the beam"
        )
    return found


def _not_in_beam_theory(robot: RobotFile, name: str) -> list[str]:
    part = robot.part(name)
    extras = {
        "ribs": "rib_count",
        "bolt holes": "hole_count",
        "joint pads": "pad_height",
    }
    present = " and ".join(
        word for word, key in extras.items() if getattr(part, key, 0)
    )
    return (
        [f"Beam theory models the bare plate: the {present} are in the FEA only"]
        if present
        else []
    )
