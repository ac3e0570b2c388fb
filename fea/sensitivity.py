"""Derivatives of a part's compliance, self-weight and mass by dimensions, material and foundation.

With fixed solutions x in unconstrained coordinates, the compliance C = Fᵀ A⁻¹ F has the derivative
dC_ij = dF_iᵀ x_j + x_iᵀ dF_j − x_iᵀ dA x_j: no parameter requires a solution. For a dimension, dA
follows from the mesh's design velocity (``stiffscope.fea.configurational``), integrated once for
all parameters. The derivatives are exact for the discrete compliance; both solution levels
(``stiffscope.fea.solution``) are differentiated and extrapolated like the compliance.

References
----------
K. K. Choi and N. H. Kim, Structural Sensitivity Analysis and Optimization 1: Linear Systems,
Springer, 2005, chapter 6.
"""

from __future__ import annotations

import dataclasses
import time
from typing import TYPE_CHECKING

import numpy as np
from threadpoolctl import threadpool_limits

from stiffscope.cad.faces import centroid_of
from stiffscope.errors import InputError
from stiffscope.fea.derivative_forms import Forms, Move
from stiffscope.fea.derivatives import Derivative, PartSensitivity
from stiffscope.fea.design_velocity import DesignVelocity
from stiffscope.fea.run import specimen_of
from stiffscope.fea.solution import accelerate, solve_specimen

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from stiffscope.cad.materials import AnyMaterial
    from stiffscope.cad.part import Part
    from stiffscope.fea.experiment import Experiment
    from stiffscope.fea.mesh import Floats, TetMesh
    from stiffscope.fea.settings import Settings

    Build = Callable[[float], Part]

STEP = 3e-4  # of a dimension: its CAD step; CAD precision is about 1e-4 of the step or better
MATERIAL_STEP = (
    1e-5  # of a constant (absolute for ratios): central difference of elasticity
)
RATIOS = ("axial_poisson", "transverse_poisson")
CONSTANTS = {
    "youngs_modulus",
    "shear_modulus",
    "axial_modulus",
    "transverse_modulus",
    "axial_shear_modulus",
    *RATIOS,
}


def part_sensitivity(
    experiment: Experiment,
    part: Part,
    settings: Settings,
    dimensions: Mapping[str, tuple[float, Build]],
) -> PartSensitivity:
    """Return the derivatives of a part by its dimensions, material constants and foundation.

    Parameters
    ----------
    experiment : of this part with these settings; its mesh is reused and solved for the fields.
    dimensions : by name, the value in m and a function that builds the part with another value.

    Raises
    ------
    MeshError : see ``stiffscope.fea.solution.solve_specimen``.
    """
    began = time.perf_counter()
    with threadpool_limits(1):
        specimen = specimen_of(part, settings)
        chosen = (settings.solver, settings.foundation)
        levels = solve_specimen(specimen, experiment.mesh, settings.interface, *chosen)
        gravity = np.tile(
            np.eye(3), (len(experiment.mesh.points), 1)
        )  # self-weight along x, y, z
        levels = accelerate(levels, gravity)
        solved = time.perf_counter()
        moves, notes = _moves(experiment.mesh, part, dimensions)
        moved = time.perf_counter()
        forms = Forms(levels, experiment, settings, tuple(moves.values()))
        derivatives = {
            name: forms.of_dimension(k, dimensions[name][0])
            for k, name in enumerate(moves)
        }
        derivatives |= _of_material(forms, part.material)
        if settings.foundation is not None:
            derivatives["foundation"] = forms.of_foundation()
    seconds = {"solve": solved - began, "velocities": moved - solved}
    seconds["derivatives"] = time.perf_counter() - moved
    return PartSensitivity(part.name, derivatives, notes, seconds)


def _moves(
    mesh: TetMesh, part: Part, dimensions: Mapping[str, tuple[float, Build]]
) -> tuple[dict[str, Move], dict[str, str]]:
    """Return the part's motion with each dimension, and the reasons for missing ones."""
    moves = {}
    notes = {}
    if not dimensions:
        return moves, notes
    velocities = DesignVelocity(mesh, part)
    for name, (value, build) in dimensions.items():
        try:
            changed, step = _change_dimension(build, value)
            velocity = velocities.measure_velocity(changed, step)
            (points, centre) = _places(part)
            (moved, other) = _places(changed)
            moves[name] = Move(
                velocity, (moved - points) / step, (other - centre) / step
            )
        except InputError as error:
            notes[name] = str(error)
    return moves, notes


def _change_dimension(build: Build, value: float) -> tuple[Part, float]:
    """Return the part with a dimension a step larger (smaller at the range's end), and the step."""
    try:
        return build(value * (1 + STEP)), value * STEP
    except InputError:
        return build(value * (1 - STEP)), -value * STEP


def _places(part: Part) -> tuple[Floats, Floats]:
    """Return the reference points (n, 3), and the centroid (3,) of the clamped faces."""
    centre = centroid_of([part.faces[index] for index in sorted(part.clamped)])
    return np.array([face.reference_point for face in part.loaded]), centre


def _of_material(forms: Forms, material: AnyMaterial) -> dict[str, Derivative]:
    """Return derivatives by each elastic constant of the material, and by its density."""
    derivatives = {}
    for name in (
        field.name for field in dataclasses.fields(material) if field.name in CONSTANTS
    ):
        value = getattr(material, name)
        step = MATERIAL_STEP * (1.0 if name in RATIOS else value)
        near = (
            dataclasses.replace(material, **{name: value + change})
            for change in (step, -step)
        )
        above, below = (state.elasticity() for state in near)
        unit = "1" if name in RATIOS else "Pa"
        derivatives[name] = forms.of_elasticity(
            (above - below) / (2 * step), value, unit
        )
    return {**derivatives, "density": forms.of_density(material.density)}
