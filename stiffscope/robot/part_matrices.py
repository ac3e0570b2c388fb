"""The 6x6 matrices and masses of a robot's parts by source: FEA, beam theory, published, given."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol, get_args

import numpy as np

from stiffscope.data import FOLDER
from stiffscope.errors import check_kind, require
from stiffscope.fea.beam import euler_bernoulli, timoshenko
from stiffscope.robot.beam_dynamics import beam_dynamics
from stiffscope.robot.file.description import RobotFile
from stiffscope.robot.file.part_sections import (
    InterfacePart,
    MatrixPart,
    ParametricPart,
    SolidPart,
    Source,
    StepPart,
)
from stiffscope.vjm.model.checks import check_compliance
from stiffscope.vjm.model.dynamics import Dynamics
from stiffscope.vjm.model.screws import shift

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike

    from stiffscope.cad.cross_sections import Section
    from stiffscope.robot.file.part_sections import PartSection

    Theory = Callable[[float, Section, float, float], np.ndarray]
    Components = str | Mapping[str, str | ArrayLike] | None


@dataclass(frozen=True)
class PartMatrix:
    """Elastic and mass properties of a part with n ends (base and tip if two), part axes.

    Compliance (6m, 6m), m = n - 1, with the first end clamped, bounds on its entries or None, mass
    in kg; ``dynamics``: condensed mass on the twists of all ends at ``places`` (n, 3), or None.
    """

    compliance: np.ndarray
    error: np.ndarray | None = None
    mass: float = 0.0
    dynamics: Dynamics | None = None
    places: np.ndarray | None = None


class Experiment(Protocol):
    """Results of a virtual experiment on a part."""

    @property
    def compliance(self) -> np.ndarray:
        """Compliance (6m, 6m) in the part's axes at the reference points."""
        ...

    @property
    def error(self) -> np.ndarray:
        """95 % bounds (6m, 6m) on the compliance."""
        ...

    @property
    def mass(self) -> float:
        """Mass of the solid, kg."""
        ...

    @property
    def experiment(self) -> Any:
        """Experiment with its condensed mass and reference points."""
        ...


def source_of(part: PartSection, components: str | None = None) -> str:
    """Return the source of a part's matrix: as in the file, or `components` for rods and plates.

    Sources: "fea", "beam", "published" for rods and plates, "step" (FEA of a STEP solid), "matrix".
    """
    if isinstance(part, StepPart):
        return "step"
    if not isinstance(part, SolidPart):
        return "matrix"
    return components if components in part.sources else part.compliance


def used_parts(robot: RobotFile) -> tuple[str, ...]:
    """Return the parts used by bodies, in the file's order."""
    return tuple(name for name in robot.parts if robot.bodies_of(name))


def rigid_part(robot: RobotFile, name: str) -> PartMatrix:
    """Return a rigid part of known mass; interfaces known only from CAD are at its origin."""
    part = robot.parts[name]
    two_ended = any(body.part == name for body in robot.elastic_bodies().values())
    ends = 2 if two_ended else max(2, len(part.interface_names))
    places = np.zeros((ends, 3))
    if isinstance(part, InterfacePart):
        places = np.array(list(part.interfaces.values()))
    none = np.zeros((6 * ends - 6, 6 * ends - 6))
    return PartMatrix(none, None, known_mass(robot, name) or 0.0, None, places)


def part_sources(
    robot: RobotFile, components: Components = None
) -> dict[str, str | np.ndarray]:
    """Return the matrix source of each used part: a name as in `source_of`, or the matrix (6, 6).

    Raises InputError if `components` has an invalid part, source or matrix.
    """
    check_kind("robot", robot, RobotFile, "load_robot")
    require(
        isinstance(components, Mapping | str | None),
        "components",
        "a source, or by part a source or a matrix",
        repr(components),
    )
    used = used_parts(robot)
    given = components if isinstance(components, Mapping) else {}
    word = components if isinstance(components, str) else None
    for name in given:
        require(
            name in used, "components", f"parts among {', '.join(used)}", f"{name!r}"
        )
    known = get_args(Source)
    for source in (word, *given.values()):
        require(
            not isinstance(source, str) or source in known,
            "components",
            f"{', '.join(known)} or a matrix",
            repr(source),
        )
    sources: dict[str, str | np.ndarray] = {}
    for name in used:
        part = robot.parts[name]
        given_source = given.get(name)
        if given_source is not None and not isinstance(given_source, str):
            sources[name] = check_compliance(
                given_source, f"components: {name}", semidefinite=True
            )
        else:
            valid = " or ".join([*part.sources, "a matrix"])
            require(
                not given_source or given_source in part.sources,
                "components",
                f"{valid} for {name}, a {part.shape} part",
                repr(given_source),
            )
            sources[name] = source_of(part, given_source or word)
    return sources


def needed_experiments(
    robot: RobotFile, components: Components = None
) -> tuple[str, ...]:
    """Return parts that need a virtual experiment, for the matrix or a mass known only from CAD."""
    return tuple(
        name
        for name, source in part_sources(robot, components).items()
        if _is_tested(source) or known_mass(robot, name) is None
    )


def _is_tested(source: str | np.ndarray) -> bool:
    return isinstance(source, str) and source in {"fea", "step"}


def part_matrices(
    robot: RobotFile,
    components: Components = None,
    experiments: Mapping[str, Experiment] | None = None,
) -> dict[str, PartMatrix]:
    """Return the matrix and mass of each used part.

    Parameters
    ----------
    robot
        Robot file.
    components
        "fea", "beam" or "published" for all rods and plates, or by part one of these or a matrix
        (6, 6) in SI and the part's axes; None: as in the file.
    experiments
        Results of the experiments in `needed_experiments`, or matrices in place of them.

    Raises
    ------
    InputError
        If a part has no such matrix.
    """
    experiments = experiments or {}
    sources = part_sources(robot, components)
    return {
        part: _matrix(robot, part, each, experiments.get(part))
        for part, each in sources.items()
    }


def _matrix(
    robot: RobotFile, name: str, source: str | np.ndarray, tested: Any
) -> PartMatrix:
    """Return a part's matrix from its source; ``tested``: its experiment, or a matrix instead."""
    part = robot.parts[name]
    if isinstance(part, InterfacePart):
        body = part.build("part")
        elastic: Any = body.elastic
        return PartMatrix(
            elastic.compliance, None, body.mass, elastic.dynamics, elastic.places
        )
    if _is_tested(source) and isinstance(tested, PartMatrix):
        return tested
    mass = known_mass(robot, name)
    mass = tested.mass if mass is None else mass
    if not isinstance(source, str):
        return PartMatrix(source, None, mass)
    if isinstance(part, MatrixPart):
        error = None if part.error is None else np.array(part.error)
        return PartMatrix(np.array(part.matrix), error, mass)
    if source == "published":
        return PartMatrix(published_compliance(robot, name), None, mass)
    if source == "beam":
        compliance = beam_compliance(robot, name)
        error = None
        segments = beam_segments(robot, name)
        material: Any = robot.material(name)
        length = sum(length for length, _ in segments)
        places = np.array([[-length, 0.0, 0.0], np.zeros(3)])
        constants = (material.youngs_modulus, material.shear_modulus, material.density)
        dynamics = beam_dynamics(segments, *constants) if mass else None
    else:
        compliance = tested.compliance
        error = tested.error
        result: Any = tested.experiment
        places = np.vstack([result.clamp_point, result.reference_points])
        modes = result.mode_squares, result.mode_squares_error
        dynamics = Dynamics(result.condensed_mass, *modes) if mass else None
    dynamics = dynamics and dynamics.scale_density(mass / dynamics.total)
    return PartMatrix(compliance, error, mass, dynamics, places)


def known_mass(robot: RobotFile, name: str) -> float | None:
    """Return a part's mass in kg from the file or its plain shape; None if it needs CAD."""
    part = robot.parts[name]
    if isinstance(part, InterfacePart):
        return part.build("part").mass
    if not isinstance(part.mass, str):
        return part.mass
    material = robot.material(name)
    if not isinstance(part, ParametricPart) or material is None:
        return None
    volume = part.parameters().volume
    return None if volume is None else material.density * volume


def beam_segments(robot: RobotFile, name: str) -> list[tuple[float, Section]]:
    """Return the beam segments of a parametric part: lengths (m) and sections from the clamped end.

    Features beyond beam theory are ignored. Raises InputError for a part without beam theory.
    """
    poisson = getattr(robot.material(name), "poisson", 0.3)
    part = robot.parts[name]
    segments = None
    if isinstance(part, ParametricPart):
        segments = part.parameters().segments(poisson)
    if segments is None:
        what = f'expected a shape with beam theory, such as "rod", got "{part.shape}"'
        raise robot.refuse(("parts", name, "shape"), what)
    return segments


def beam_compliance(
    robot: RobotFile, name: str, theory: Theory = timoshenko
) -> np.ndarray:
    """Return the compliance of a parametric part by beam theory.

    Parameters
    ----------
    robot
        Robot from `load_robot`.
    name
        Name of the part in the robot file.
    theory
        Function of `stiffscope.fea.beam`; default: Timoshenko beam with Saint-Venant torsion.

    Returns
    -------
    ndarray
        (6, 6), SI: twist at the loaded end by unit wrenches there, part axes, other end clamped.

    Raises
    ------
    InputError
        If the part has no dimensions or no material.
    """
    material = robot.material(name)
    segments = beam_segments(robot, name)
    if material is None:
        message = "expected a material for beam theory, got none"
        raise robot.refuse(("parts", name, "material"), message)
    total = np.zeros((6, 6))
    beyond = 0.0
    for length, section in reversed(segments):
        piece = theory(length, section, material.youngs_modulus, material.shear_modulus)
        to_tip = shift([beyond, 0.0, 0.0])
        total += to_tip @ piece @ to_tip.T
        beyond += length
    return total


def published_compliance(robot: RobotFile, name: str) -> np.ndarray:
    """Return the Biglide's published 6x6: a rod's by docs/theory.md (7.1), a plate's as printed."""
    part = robot.parts[name]
    if isinstance(part, ParametricPart) and part.describes.published == "formula":
        return beam_compliance(robot, name, euler_bernoulli)
    table = getattr(part, "published", None)
    if table is None:
        message = "expected the name of a matrix in data/published, got nothing"
        raise robot.refuse(("parts", name, "published"), message)
    return published_matrix(table)


def is_published_part(robot: RobotFile, name: str) -> bool:
    """Return whether a part has shape and material of the published one, whose matrix is its own."""
    part = robot.parts[name]
    material = robot.material(name)
    table = "link" if part.shape == "rod" else getattr(part, "published", None)
    if table is None or material is None or not isinstance(part, ParametricPart):
        return False
    values = part.dimensions() | {
        "shape": part.shape,
        "youngs_modulus": material.youngs_modulus,
        "shear_modulus": material.shear_modulus,
    }
    wanted = read_published(table).get("part", {})
    return all(_is_same(values.get(key), value) for key, value in wanted.items())


def _is_same(value: float | int | str | None, wanted: float | int | str) -> bool:
    if isinstance(value, str) or isinstance(wanted, str) or value is None:
        return value == wanted
    return abs(value - wanted) <= 1e-9 * abs(wanted)


def published_matrix(name: str) -> np.ndarray:
    """Return the 6x6 of `data/published/<name>.toml`, SI: its numbers times its `unit`."""
    content = read_published(name)
    require(
        "compliance" in content,
        f"data/published/{name}.toml",
        "a table with a 6x6 `compliance`",
        "none",
    )
    return np.array(content["compliance"], dtype=float) * content["unit"]


def read_published(name: str) -> dict[str, Any]:
    """Return the content of `data/published/<name>.toml`; raise InputError if it does not exist."""
    path = FOLDER / "published" / f"{name}.toml"
    known = sorted(file.stem for file in path.parent.glob("*.toml"))
    require(name in known, "data/published", f"one of {', '.join(known)}", f"{name!r}")
    return tomllib.loads(path.read_text(encoding="utf-8"))


def entry_name(i: int, j: int) -> tuple[str, str]:
    """Return name and unit of a compliance entry on or above the diagonal, indices from 0."""
    return f"C{i + 1}{j + 1}", "m/N" if j < 3 else "rad/(N·m)" if i >= 3 else "m/(N·m)"
