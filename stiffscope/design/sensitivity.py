"""Derivatives of a robot's stiffness, sag and first frequency with respect to numbers of its file.

Central differences: the robot is read, assembled and moved to the same commanded poses with a
slightly larger and smaller number. Matrices of virtual experiments change to first order with the
derivatives of their parts, those of beam theory in closed form. The differences include the effects
of a number on the geometry and through expressions.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, fields
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.design.responses import FREE, MOST_MODES
from stiffscope.errors import InputError, require
from stiffscope.experiments.masses import mass_of_solids
from stiffscope.robot.file.part_sections import ParametricPart
from stiffscope.robot.mechanism_of import mechanism_of
from stiffscope.robot.parameters import parameters
from stiffscope.robot.part_matrices import part_matrices, part_sources
from stiffscope.runtime.brief import describe_briefly
from stiffscope.vjm.kinematics.configurations import configure
from stiffscope.vjm.statics import analysis as statics
from stiffscope.vjm.vibration.modes import frequencies, modes

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

    from stiffscope.fea.derivatives import Derivative
    from stiffscope.robot.file.description import RobotFile
    from stiffscope.robot.parameters import Parameter
    from stiffscope.robot.part_matrices import Components, Experiment
    from stiffscope.vjm.kinematics.configurations import Configurations
    from stiffscope.vjm.model.mechanism import Mechanism

STEP = 1e-4  # relative step of the central difference
OWN_MODES = 0.01  # 95 % bound of the effect of fixed-interface modes, over a frequency's derivative


@dataclass(frozen=True, eq=False)
class Responses:
    """Stiffness (n, 6, 6) at M, sag (n, 6), first frequency (n,), Hz, and mass of solids, kg.

    ``push`` (n, 6): 1/C_ii, the stiffness that a push along each direction meets; NaN if rigid.
    If K is infinite, the diagonal contains 1/C_ii. The sag is NaN if the tool moves freely. The
    mass is that of the parts' solids and of rigid bodies; masses of parts in the file are ignored.
    """

    stiffness: np.ndarray
    sag: np.ndarray
    frequency: np.ndarray
    mass: float
    push: np.ndarray


@dataclass(frozen=True, eq=False)
class Row:
    """Derivatives of the responses per SI unit of a parameter, with 95 % bounds of all but the mass.

    The bounds come from the parts' derivatives; finite differences add about 1e-6 of the responses.
    """

    parameter: Parameter
    by: Responses
    error: Responses

    @property
    def per_kilogram(self) -> np.ndarray | None:
        """Change of the stiffness (n, 6, 6) per added kilogram; None if the mass is unchanged."""
        change = abs(self.by.mass * self.parameter.value)
        return self.by.stiffness / self.by.mass if change > 1e-9 else None


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """Responses of a robot at n poses, derivatives, and reasons for missing ones (``notes``)."""

    __repr__ = describe_briefly

    robot: RobotFile
    poses: np.ndarray
    at: Responses
    rows: tuple[Row, ...]
    notes: dict[str, str]

    def scatter(self) -> Responses | None:
        """Return 95 % bounds of the responses due to the file's tolerances; None without any.

        The bounds are root sums of squares: tolerances count as independent 95 % bounds, and all
        bodies of a part share its dimensions.
        """
        given = [row for row in self.rows if row.parameter.tolerance]
        if not given:
            return None
        names = [f.name for f in fields(Responses)]
        bounds = {}
        for name in names:
            shifts = [getattr(row.by, name) * row.parameter.tolerance for row in given]
            bounds[name] = np.sqrt(sum(shift**2 for shift in shifts))
        return Responses(**bounds)


def robot_sensitivity(
    robot: RobotFile,
    poses: np.ndarray,
    components: Components = None,
    experiments: Mapping[str, Experiment] | None = None,
    derivatives: Mapping[str, Mapping[str, Derivative]] | None = None,
    names: Collection[str] | None = None,
) -> Sensitivity:
    """Return the derivatives of a robot with respect to every number of its file.

    Parameters
    ----------
    robot
        Robot file from `load_robot`.
    poses : (n, k)
        Commanded poses, m and rad, the same for all changes.
    components
        Source of the parts' matrices, as in `part_matrices`.
    experiments, derivatives
        Experiments of the parts listed by `needed_experiments`; their derivatives, by parameter.
    names
        Names of the parameters; by default all.

    Raises
    ------
    InputError
        A pose is out of reach.
    """
    at = np.asarray(poses, dtype=float)
    model = _Model(robot, at, components, experiments or {}, derivatives or {})
    middle = model.responses(robot)
    rows = []
    notes = {}
    wanted = [
        candidate
        for candidate in parameters(robot, components)
        if names is None or candidate.name in names
    ]
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
        changed = [
            parameter.set_to(self.robot, parameter.value + sign * step)
            for sign in (1, -1)
        ]
        _check_lengths(self.robot, changed[0], self.components)
        above, below = (self.responses(each) for each in changed)
        names = [f.name for f in fields(Responses)]
        pairs = ((getattr(above, name), getattr(below, name)) for name in names)
        by = Responses(*((high - low) / (2 * step) for high, low in pairs))
        return Row(parameter, by, self._errors(changed[0], abs(step), middle, by))

    def responses(self, robot: RobotFile) -> Responses:
        varied = self._vary_parts(robot)
        mechanism, values = self._assemble(robot, varied)
        state = statics.analyse(mechanism, values)
        sag = np.full((len(values), 6), np.nan)
        firm = np.asarray(np.isfinite(state.compliance).all(axis=(1, 2)))
        if firm.any():
            sag[firm] = statics.sag(mechanism, values[firm])
        frequency = np.full(len(values), np.nan)
        with suppress(InputError):  # without masses
            frequency = _first(frequencies(mechanism, values, MOST_MODES))
        mass = mass_of_solids(robot, part_sources(robot, self.components), varied)
        return Responses(state.finite, sag, frequency, mass, state.alone)

    def _assemble(
        self, robot: RobotFile, varied: Mapping[str, Any]
    ) -> tuple[Mechanism, Configurations]:
        mechanism = mechanism_of(robot, part_matrices(robot, self.components, varied))
        return mechanism, configure(mechanism, self.poses).require_valid()

    def _errors(
        self, robot: RobotFile, step: float, middle: Responses, by: Responses
    ) -> Responses:
        """Return bounds from those of the parts' derivatives; zeros if no experiment changes."""
        varied = self._vary_parts(robot)
        if not any(variation.error.any() for variation in varied.values()):
            still = np.zeros_like(middle.stiffness)
            level = np.zeros_like(middle.sag)
            first = np.zeros_like(middle.frequency)
            return Responses(still, level, first, 0.0, np.zeros_like(middle.push))
        mechanism, errors = self._assemble(robot, varied)
        bars = statics.stiffness_error(mechanism, errors) / step
        soft = np.abs(statics.compliance(mechanism, errors))
        sag = (soft @ bars @ np.abs(middle.sag)[..., None])[..., 0]
        first = np.full(len(errors), np.nan)
        if np.isfinite(middle.frequency).any():
            shaken = modes(mechanism, errors, MOST_MODES)
            first = _first(shaken.frequencies, shaken.error) / step
        frequency = first + OWN_MODES * np.abs(by.frequency)
        yields = np.abs(statics.compliance_error(mechanism, errors)) / step
        push = middle.push**2 * np.einsum("nii->ni", yields)  # δ(1/C) = δC / C²
        return Responses(bars, sag, frequency, 0.0, push)

    def _vary_parts(self, robot: RobotFile) -> dict[str, Any]:
        """Return the experiments extrapolated to this robot, with bounds of the difference only."""
        return {name: self._vary_part(name, robot) for name in self.experiments}

    def _vary_part(self, name: str, robot: RobotFile) -> Any:
        held = self.experiments[name]
        changes = _changes(self.robot, robot, name)
        known = self.derivatives.get(name, {})
        what = "a parameter with a derivative of the part's matrix"
        for key in changes:
            require(key in known, f"{name}.{key}", what, "none")

        def change(field: str) -> Any:
            return sum(
                step * getattr(known[key], field) for key, step in changes.items()
            )

        bounds = sum(
            abs(change) * known[key].full_error for key, change in changes.items()
        )
        one = held.experiment
        condensed = np.array(one.condensed_mass)
        squares = np.array(one.mode_squares)
        now = robot.material(name)
        before = self.robot.material(name)
        denser = (
            now.density / before.density
            if "density" in changes and now and before
            else 1.0
        )
        ends = len(condensed) - len(squares)
        condensed[ends:, :ends] *= np.sqrt(denser)
        condensed[:ends, ends:] *= np.sqrt(denser)
        condensed[:ends, :ends] += change("condensed_mass")
        return SimpleNamespace(
            compliance=held.compliance + change("full_compliance"),
            error=np.zeros_like(held.compliance) + bounds,
            mass=held.mass + change("mass"),
            experiment=SimpleNamespace(
                condensed_mass=condensed,
                mode_squares=squares / denser,
                mode_squares_error=None,
                clamp_point=one.clamp_point + change("clamp_point"),
                reference_points=one.reference_points + change("reference_points"),
            ),
        )


def _check_lengths(before: RobotFile, after: RobotFile, components: Components) -> None:
    """Raise InputError if a change alters the length required of a STEP file's solid."""
    for name, source in part_sources(before, components).items():
        if source != "step" or before.parts[name].interface_names:
            continue
        for body in before.bodies_of(name):
            own, other = (
                robot.elastic_bodies()[body].length for robot in (before, after)
            )
            if abs(own - other) > 1e-9 * own:
                file = getattr(before.parts[name], "file", name)
                message = f"expected the length of {file}, got another"
                raise before.refuse(("bodies", body, "tip"), message)


def _changes(before: RobotFile, after: RobotFile, name: str) -> dict[str, float]:
    """Return the nonzero changes of a part's lengths, material constants and foundation."""

    def numbers(robot: RobotFile) -> dict[str, Any]:
        part = robot.parts[name]
        columns = dict[str, Any]()
        if isinstance(part, ParametricPart):
            columns |= vars(part.parameters().present())
        for key, value in vars(robot.material(name) or SimpleNamespace()).items():
            if key not in {"name", "source"} and not key.endswith("expansion"):
                columns[key] = value
        return columns | {"foundation": getattr(part, "foundation", None) or 0.0}

    one = numbers(before)
    two = numbers(after)
    changed = {key: value for key, value in two.items() if value != one.get(key)}
    return {
        k: v - one[k] if isinstance(v, float) else np.nan for k, v in changed.items()
    }


def _first(frequencies: np.ndarray, values: np.ndarray | None = None) -> np.ndarray:
    """Return the lowest nonzero frequency (n,), or the value that belongs to it; NaN if none."""
    values = frequencies if values is None else values
    real = frequencies > FREE
    first = real.argmax(axis=1)
    return np.where(real.any(axis=1), values[range(len(values)), first], np.nan)


def poses_of(robot: RobotFile, poses: Sequence[Sequence[float]] | None) -> np.ndarray:
    """Return the given poses (n, k), or else those of the file."""
    poses_given = list(robot.poses.values()) if poses is None else poses
    return np.atleast_2d(np.array(poses_given, dtype=float))
