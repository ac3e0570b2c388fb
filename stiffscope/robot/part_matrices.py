"""The 6x6 matrices and masses of a robot's parts from their sources: FEA, beam theory, published, given."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from stiffscope.data import FOLDER
from stiffscope.errors import InputError
from stiffscope.fea.beam import circle, euler_bernoulli, rectangle, timoshenko
from stiffscope.robot.part_sections import MatrixPart, ParametricPart, PartSection, SolidPart, StepPart
from stiffscope.vjm.screws import shift

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from stiffscope.fea.beam import Section
    from stiffscope.robot.description import RobotFile

    Theory = Callable[[float, Section, float, float], np.ndarray]


@dataclass(frozen=True)
class PartMatrix:
    """Compliance (6, 6) in the part's axes at its tip, bounds (6, 6) on its entries or None, and mass in kg."""

    compliance: np.ndarray
    error: np.ndarray | None = None
    mass: float = 0.0


class Experiment(Protocol):
    """What a virtual experiment knows of a part."""

    @property
    def compliance(self) -> np.ndarray:
        """(6, 6) in the part's axes at its reference point."""
        ...

    @property
    def error(self) -> np.ndarray:
        """(6, 6) 95 % bounds."""
        ...

    @property
    def mass(self) -> float:
        """Mass of the solid, kg."""
        ...


def source_of(part: PartSection, components: str | None = None) -> str:
    """Where a part's matrix comes from: its section, unless `components` names one source for all shapes."""
    if isinstance(part, SolidPart):
        return part.compliance if components is None or isinstance(part, StepPart) else components
    return "matrix"


def used_parts(robot: RobotFile) -> tuple[str, ...]:
    """Parts that bodies are made of, in the file's order."""
    used = {body.part for body in robot.elastic_bodies().values()}
    return tuple(name for name in robot.parts if name in used)


def needed_experiments(robot: RobotFile, components: str | None = None) -> tuple[str, ...]:
    """Parts of which a virtual experiment is needed: for the matrix, or for a mass that only CAD tells."""
    return tuple(
        name
        for name in used_parts(robot)
        if source_of(robot.parts[name], components) == "fea" or known_mass(robot, name) is None
    )


def part_matrices(
    robot: RobotFile, components: str | None = None, experiments: Mapping[str, Experiment] | None = None
) -> dict[str, PartMatrix]:
    """Matrix and mass of every part that is used.

    Parameters
    ----------
    robot
        The robot file.
    components
        "fea", "beam" or "published" for all rods and plates; None: as the file says.
    experiments
        Results of the virtual experiments that `needed_experiments` names.

    Raises
    ------
    InputError
        A part has no such matrix.

    """
    experiments = experiments or {}
    found = {}
    for name in used_parts(robot):
        part, source = robot.parts[name], source_of(robot.parts[name], components)
        mass = known_mass(robot, name)
        mass = experiments[name].mass if mass is None else mass
        if source == "fea":
            found[name] = PartMatrix(experiments[name].compliance, experiments[name].error, mass)
        elif isinstance(part, MatrixPart):
            error = None if part.error is None else np.array(part.error)
            found[name] = PartMatrix(np.array(part.matrix), error, mass)
        else:
            theory = beam_compliance if source == "beam" else published_compliance
            found[name] = PartMatrix(theory(robot, name), None, mass)
    return found


def known_mass(robot: RobotFile, name: str) -> float | None:
    """Mass of a part in kg where the file or its plain shape tells it; None where only CAD does."""
    part = robot.parts[name]
    if not isinstance(part.mass, str):
        return part.mass
    plain = isinstance(part, ParametricPart) and not any(
        part.dimensions().get(key, 0) for key in ("rib_count", "hole_count", "pad_height")
    )
    material = robot.material(name)
    if not plain or material is None:
        return None
    return material.density * sum(length * section.area for length, section in beam_segments(robot, name))


def beam_segments(robot: RobotFile, name: str) -> list[tuple[float, Section]]:
    """Lengths (m) and cross-sections of a rod or plate seen as a beam along its x, from the clamped end on.

    A rod with fittings is three round bars; a plate is without its ribs, holes and pads.
    """
    poisson = getattr(robot.material(name), "poisson", 0.3)
    part = robot.parts[name]
    if not isinstance(part, ParametricPart):
        raise InputError(f"parts.{name}: expected a rod or plate for beam theory, got a {part.shape}")
    size = part.lengths()
    if part.shape == "plate":
        return [(size["depth"], rectangle(size["width"], size["thickness"], poisson))]
    shank = circle(size["radius"], size["bore"] / 2, poisson)
    if not size["fitting_radius"]:
        return [(size["length"], shank)]
    end = size["fitting_length"], circle(size["fitting_radius"], size["bore"] / 2, poisson)
    return [end, (size["length"] - 2 * end[0], shank), end]


def beam_compliance(robot: RobotFile, name: str, theory: Theory = timoshenko) -> np.ndarray:
    """(6, 6) of a beam, by default Timoshenko's with Saint-Venant's torsion: the best that beam theory has."""
    material = robot.material(name)
    segments = beam_segments(robot, name)
    if material is None:
        raise InputError(f"parts.{name}.material: expected a material for beam theory, got none")
    total, beyond = np.zeros((6, 6)), 0.0
    for length, section in reversed(segments):
        piece = theory(length, section, material.youngs_modulus, material.shear_modulus)
        to_tip = shift([beyond, 0.0, 0.0])
        total += to_tip @ piece @ to_tip.T
        beyond += length
    return total


def published_compliance(robot: RobotFile, name: str) -> np.ndarray:
    """(6, 6) as published: Eq. (28) of the Biglide paper with the file's dimensions for a rod, a plate's as printed."""
    part = robot.parts[name]
    if part.shape == "rod":
        return beam_compliance(robot, name, euler_bernoulli)
    table = getattr(part, "published", None)
    if table is None:
        raise InputError(f"parts.{name}.published: expected the name of a matrix in data/published, got nothing")
    return published_matrix(table)


def published_matrix(name: str) -> np.ndarray:
    """(6, 6), SI, of `data/published/<name>.toml`, whose numbers are multiples of its `unit`."""
    import tomllib

    path = FOLDER / "published" / f"{name}.toml"
    known = sorted(each.stem for each in path.parent.glob("*.toml"))
    if name not in known:
        raise InputError(f"data/published: expected one of {', '.join(known)}, got {name!r}")
    content = tomllib.loads(path.read_text(encoding="utf-8"))
    if "compliance" not in content:
        raise InputError(f"data/published/{name}.toml: expected a table with a 6x6 `compliance`, got none")
    return np.array(content["compliance"], dtype=float) * content["unit"]
