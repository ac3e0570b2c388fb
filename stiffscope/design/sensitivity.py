"""Derivatives of a robot's stiffness, sag and first natural frequency by every number of its file.

By central differences of the assembled robot: read, assembled and brought to the same commanded poses with a number a
little larger and smaller. Matrices of virtual experiments follow to first order by the derivatives of their parts,
those of beam theory in closed form; so a number's own effect on the geometry, and on all that expressions make of it,
is counted with that of the parts.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.design.responses import FREE, MOST_MODES, mass_of_solids
from stiffscope.errors import InputError
from stiffscope.robot.file.part_sections import ParametricPart
from stiffscope.robot.mechanism_of import mechanism_of
from stiffscope.robot.parameters import parameters
from stiffscope.robot.part_matrices import part_matrices, part_sources
from stiffscope.runtime.brief import describe_briefly
from stiffscope.vjm import statics
from stiffscope.vjm.kinematics import configure
from stiffscope.vjm.modes import frequencies, modes

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

    from stiffscope.fea.derivatives import Derivative
    from stiffscope.robot.file.description import RobotFile
    from stiffscope.robot.parameters import Parameter
    from stiffscope.robot.part_matrices import Components, Experiment
    from stiffscope.vjm.kinematics import Configurations
    from stiffscope.vjm.mechanism import Mechanism

STEP = 1e-4  # of a number: central difference of the robot
OWN_MODES = 0.01  # of a frequency's derivative: 95 % bound of what a part's modes between its held ends change of it


@dataclass(frozen=True, eq=False)
class Responses:
    """Stiffness (n, 6, 6) at M, sag (n, 6), first natural frequency (n,) in Hz, and mass of the robot's solids, kg.

    Where K is infinite, the stiffness has 1/C_ii on its diagonal. The sag is NaN where the tool moves freely. The
    mass is that of the parts' materials and of rigid bodies, whatever mass the file gives its parts.
    """

    stiffness: np.ndarray
    sag: np.ndarray
    frequency: np.ndarray
    mass: float


@dataclass(frozen=True, eq=False)
class Row:
    """Derivatives of the responses by one parameter, per SI unit of it, and the 95 % bounds of the first three.

    The bounds are those of the derivatives of the parts; differences of the robot add some 1e-6 of its responses.
    """

    parameter: Parameter
    by: Responses
    error: Responses

    @property
    def per_kilogram(self) -> np.ndarray | None:
        """(n, 6, 6) change of the stiffness for a kilogram that the parameter adds; None where it adds none."""
        change = abs(self.by.mass * self.parameter.value)
        return self.by.stiffness / self.by.mass if change > 1e-9 else None


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """Responses of a robot at n commanded poses, their derivatives, and why some numbers have none (``notes``)."""

    __repr__ = describe_briefly

    robot: RobotFile
    poses: np.ndarray
    at: Responses
    rows: tuple[Row, ...]
    notes: dict[str, str]

    def scatter(self) -> Responses | None:
        """95 % bounds of the responses by the file's tolerances, or None where it gives none.

        Root sum of squares, each tolerance taken as 95 % bounds of its number, independent of the others; all bodies
        of a part share its dimensions.
        """
        given = [row for row in self.rows if row.parameter.tolerance]
        if not given:
            return None
        squares = [
            sum((getattr(row.by, f.name) * row.parameter.tolerance) ** 2 for row in given) for f in fields(Responses)
        ]
        return Responses(*(np.sqrt(each) for each in squares))


def robot_sensitivity(
    robot: RobotFile,
    poses: np.ndarray,
    components: Components = None,
    experiments: Mapping[str, Experiment] | None = None,
    derivatives: Mapping[str, Mapping[str, Derivative]] | None = None,
    names: Collection[str] | None = None,
) -> Sensitivity:
    """Return the derivatives of a robot by every number of its file.

    Parameters
    ----------
    robot
        As `load_robot` gives it.
    poses : (n, k)
        Commanded poses, m and rad, which stay while numbers change.
    components
        As `part_matrices` takes them.
    experiments
        Those of the parts that `needed_experiments` names.
    derivatives
        Of these parts, by part and parameter.
    names
        Of the parameters wanted; by default all.

    Raises
    ------
    InputError
        A pose is out of reach.

    """
    model = _Model(robot, np.asarray(poses, dtype=float), components, experiments or {}, derivatives or {})
    middle = model.responses(robot)
    rows, notes = [], {}
    wanted = [each for each in parameters(robot, components) if names is None or each.name in names]
    for parameter in wanted:
        try:
            rows.append(model.row(parameter, middle))
        except InputError as error:
            notes[parameter.name] = str(error)
    return Sensitivity(robot, model.poses, middle, tuple(rows), notes)


@dataclass(frozen=True, eq=False)
class _Model:
    robot: RobotFile
    poses: np.ndarray
    components: Components
    experiments: Mapping[str, Experiment]
    derivatives: Mapping[str, Mapping[str, Derivative]]

    def row(self, parameter: Parameter, middle: Responses) -> Row:
        step = STEP * parameter.value
        changed = [parameter.set_to(self.robot, parameter.value + sign * step) for sign in (1, -1)]
        _check_lengths(self.robot, changed[0], self.components)
        above, below = (self.responses(each) for each in changed)
        names = [f.name for f in fields(Responses)]
        by = Responses(*((getattr(above, name) - getattr(below, name)) / (2 * step) for name in names))
        return Row(parameter, by, self._errors(changed[0], abs(step), middle, by))

    def responses(self, robot: RobotFile) -> Responses:
        varied = self._vary_parts(robot)
        mechanism, found = self._assemble(robot, varied)
        state = statics.analyse(mechanism, found)
        sag = np.full((len(found), 6), np.nan)
        firm = np.asarray(np.isfinite(state.compliance).all(axis=(1, 2)))
        if firm.any():
            sag[firm] = statics.sag(mechanism, found[firm])
        frequency = _first(frequencies(mechanism, found, MOST_MODES))
        return Responses(state.finite, sag, frequency, mass_of_solids(robot, self.components, varied))

    def _assemble(self, robot: RobotFile, varied: Mapping[str, Any]) -> tuple[Mechanism, Configurations]:
        mechanism = mechanism_of(robot, part_matrices(robot, self.components, varied))
        return mechanism, configure(mechanism, self.poses).require_valid()

    def _errors(self, robot: RobotFile, step: float, middle: Responses, by: Responses) -> Responses:
        """Bounds of the differences by those of the parts' derivatives; zeros where no part's experiment changes."""
        varied = self._vary_parts(robot)
        if not any(each.error.any() for each in varied.values()):
            none = [np.zeros_like(each) for each in (middle.stiffness, middle.sag, middle.frequency)]
            return Responses(none[0], none[1], none[2], 0.0)
        mechanism, found = self._assemble(robot, varied)
        bars = statics.stiffness_error(mechanism, found) / step
        sag = (np.abs(statics.compliance(mechanism, found)) @ bars @ np.abs(middle.sag)[..., None])[..., 0]
        shaken = modes(mechanism, found, MOST_MODES)
        frequency = _first(shaken.frequencies, shaken.error) / step + OWN_MODES * np.abs(by.frequency)
        return Responses(bars, sag, frequency, 0.0)

    def _vary_parts(self, robot: RobotFile) -> dict[str, Any]:
        """The experiments as they would be for this robot, with bounds of the difference only."""
        return {name: self._one(name, robot) for name in self.experiments}

    def _one(self, name: str, robot: RobotFile) -> Any:
        held, changes = self.experiments[name], _changes(self.robot, robot, name)
        known = self.derivatives.get(name, {})
        for key in changes:
            if key not in known:
                raise InputError(f"{name}.{key}: expected a parameter with a derivative of the part's matrix, got none")
        sums = {
            field: sum(change * getattr(known[key], field) for key, change in changes.items())
            for field in ("full_compliance", "mass", "condensed_mass", "reference_points", "clamp_point")
        }
        bounds = sum(abs(change) * known[key].full_error for key, change in changes.items())
        one = held.experiment
        condensed, squares = np.array(one.condensed_mass), np.array(one.mode_squares)
        now, before = robot.material(name), self.robot.material(name)
        denser = now.density / before.density if "density" in changes and now and before else 1.0
        ends = len(condensed) - len(squares)
        condensed[ends:, :ends] *= np.sqrt(denser)
        condensed[:ends, ends:] *= np.sqrt(denser)
        condensed[:ends, :ends] += sums["condensed_mass"]
        return SimpleNamespace(
            compliance=held.compliance + sums["full_compliance"],
            error=np.zeros_like(held.compliance) + bounds,
            mass=held.mass + sums["mass"],
            experiment=SimpleNamespace(
                condensed_mass=condensed,
                mode_squares=squares / denser,
                mode_squares_error=None,
                clamp_point=one.clamp_point + sums["clamp_point"],
                reference_points=one.reference_points + sums["reference_points"],
            ),
        )


def _check_lengths(before: RobotFile, after: RobotFile, components: Components) -> None:
    """Raise InputError for a number that changes how long a STEP file's solid would have to be."""
    for name, source in part_sources(before, components).items():
        for body in before.bodies_of(name) if source == "step" and not before.parts[name].interface_names else ():
            own, other = (
                np.linalg.norm(np.subtract(each.elastic_bodies()[body].tip, each.elastic_bodies()[body].base))
                for each in (before, after)
            )
            if abs(own - other) > 1e-9 * own:
                file = getattr(before.parts[name], "file", name)
                raise before.refuse(("bodies", body, "tip"), f"expected the length of {file}, got another")


def _changes(before: RobotFile, after: RobotFile, name: str) -> dict[str, float]:
    """Differences of a part's lengths, constants of its material and foundation that are not zero."""

    def numbers(robot: RobotFile) -> dict[str, Any]:
        part, material = robot.parts[name], robot.material(name)
        shape = robot.dimensions(name).present() if isinstance(part, ParametricPart) else None
        constants = {} if material is None else {k: v for k, v in vars(material).items() if k not in ("name", "source")}
        constants = {key: value for key, value in constants.items() if not key.endswith("expansion")}
        return {
            **({} if shape is None else vars(shape)),
            **constants,
            "foundation": getattr(part, "foundation", None) or 0.0,
        }

    one, two = numbers(before), numbers(after)
    changed = {key: value for key, value in two.items() if value != one.get(key)}
    return {key: value - one[key] if isinstance(value, float) else np.nan for key, value in changed.items()}


def _first(frequencies: np.ndarray, values: np.ndarray | None = None) -> np.ndarray:
    """(n,) the lowest frequency (n, c) that is no free motion, or the value that belongs to it; NaN for none."""
    values = frequencies if values is None else values
    real = frequencies > FREE
    first = real.argmax(axis=1)
    return np.where(real.any(axis=1), values[range(len(values)), first], np.nan)


def poses_of(robot: RobotFile, poses: Sequence[Sequence[float]] | None) -> np.ndarray:
    """Poses (n, k) to look at: those given, else those that the file names. Raises InputError for neither."""
    found = list(robot.poses.values()) if poses is None else poses
    if not len(found):
        raise InputError(f"{robot.path}: has no poses; give one")
    return np.atleast_2d(np.array(found, dtype=float))
