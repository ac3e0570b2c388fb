"""Run a virtual experiment: mesh a part, clamp it, load it by unit wrenches, condense it."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from threadpoolctl import threadpool_limits

from stiffscope import cad
from stiffscope.cad.part import Part, mass_properties, project, surface
from stiffscope.errors import check_kind
from stiffscope.fea.adapt import make_mesh, solve_on, solve_within
from stiffscope.fea.design_velocity import moved_along
from stiffscope.fea.dynamics import clamp_point, compute_dynamics, condense_mass
from stiffscope.fea.experiment import Experiment
from stiffscope.fea.geometry import volume
from stiffscope.fea.mass import rigid_mass
from stiffscope.fea.mesh import (
    TetMesh,
    check_lengths,
    check_time,
    default_size,
    face_area,
    flatness_of,
)
from stiffscope.fea.rigid import relative_twists
from stiffscope.fea.settings import Settings
from stiffscope.fea.specimen import GOOD_SHAPE, Specimen, cure_of, shape_error
from stiffscope.runtime.progress import LISTENERS

if TYPE_CHECKING:
    from collections.abc import Callable

    from stiffscope.fea.solution import Solution

    Progress = Callable[[str, float], None]

# A coarse tessellation suffices, as nodes are projected on the solid afterwards, and a fine one is
# expensive: 16 sides per circle instead of 12 take four times the elements and twice the time.
CHORD = 0.15
TURN = 1.1  # distance to the surface in element sizes, angle between triangles in rad


def run_experiment(
    part: Part | Specimen,
    settings: Settings | None = None,
    progress: Progress | None = None,
    *,
    former: Experiment | None = None,
    near: tuple[Part, TetMesh] | None = None,
    whole: bool = True,
) -> Experiment:
    """Mesh a part, clamp it, load it by unit wrenches and return its compliance with error bounds.

    Parameters
    ----------
    part
        A solid with a material, clamped faces and loaded interfaces.
    settings
        Mesh, interface and solver settings.
    progress
        Called with the stage name and the fraction done.
    former
        Experiment on the same part and settings, whose mesh is reused for an identical compliance.
    near
        Part of slightly other dimensions with its mesh for the same settings, moved if possible.
    whole
        Whether fields, self-weight, modes and frequencies are computed; without, it takes half the
        time for the same compliance.

    Returns
    -------
    Experiment
        Compliance (6n, 6n) of n loaded interfaces in m/N, rad/N, m/(N m), rad/(N m), bounds, mesh,
        fields.

    Raises
    ------
    InputError
        If a length is out of range, interfaces overlap, or the foundation is too soft.
    MeshError
        If the part cannot be meshed or solved.
    """
    check_kind("part", part, Part | Specimen, "build_part")
    started = time.perf_counter()
    settings = settings or Settings()
    report = progress or LISTENERS.open_line(part.name)
    report("cad", 0.0)
    specimen = part if isinstance(part, Specimen) else specimen_of(part, settings)
    moved = None
    if near and isinstance(part, Part):
        moved = moved_along(near[1], near[0], part)
        moved = moved if moved and shape_error(specimen, moved) < GOOD_SHAPE else None
    seconds = {"cad": time.perf_counter() - started}
    report("mesh", 0.05)
    if former:
        mesh = former.mesh
        seconds["mesh"] = former.seconds["mesh"]
    else:
        mesh = moved or make_mesh(
            specimen, settings, settings.time_limit - seconds["cad"]
        )
        seconds["mesh"] = time.perf_counter() - started - seconds["cad"]
    solving = time.perf_counter()
    report("solve", 0.5)
    if former:
        solution = solve_on(specimen, mesh, settings)
        note = former.note
    else:
        left = max(settings.time_limit - (solving - started), 1.0)
        check_time(len(mesh.cells), left, cure_of(specimen, settings.size), meshed=True)

        def refining(stage: str, done: float) -> None:
            report(stage, 0.5 + 0.35 * done)

        mesh, solution, note = solve_within(
            specimen, mesh, settings, refining, left, modes=whole
        )
    statics = _statics(specimen, settings, mesh, solution)
    experiment = replace(statics, note=note, moved=moved is not None)
    if whole:
        report("modes", 0.85)
        experiment = _with_fields(experiment, solution, settings)
    seconds["solve"] = time.perf_counter() - solving
    report("solve", 1.0)
    return replace(experiment, seconds=seconds)


def specimen_of(part: Part, settings: Settings) -> Specimen:
    """Return the part as plain numbers, its surface triangulated for the settings' element size.

    Raises
    ------
    MeshError : if a length of the settings is out of range for this part.
    """
    solid = mass_properties(part).volume
    bounds = solid, cad.kernel.diagonal(part.solid) * 1e-3
    check_lengths(part.name, bounds, settings.size, settings.envelope)
    area = face_area(part.faces)
    flatness = flatness_of(solid, part.faces)
    size = settings.size or default_size(solid, area, flatness)
    loaded = (
        (face.faces, np.asarray(face.reference_point, dtype=float))
        for face in part.loaded
    )
    return Specimen(
        name=part.name,
        names=part.names,
        surface=surface(part, deflection=CHORD * size, angle=TURN),
        project=lambda place, points: project(part, place, points),
        elasticity=part.material.elasticity(),
        clamped=part.clamped,
        loaded=tuple(loaded),
        couplings=tuple(face.coupling for face in part.loaded),
        volume=float(solid),
        density=float(part.material.density),
    )


@threadpool_limits.wrap(limits=1)
def _statics(
    specimen: Specimen, settings: Settings, mesh: TetMesh, solution: Solution
) -> Experiment:
    places = np.array([point for _, point in specimen.loaded])
    clamp = clamp_point(solution.system)
    return Experiment(
        part=specimen.name,
        interface=settings.interface,
        interfaces=specimen.names,
        full_compliance=solution.compliance,
        full_error=solution.error,
        reference_points=places,
        clamp_point=clamp,
        stiffness_error=solution.stiffness_error(relative_twists(places, clamp)),
        mesh=mesh,
        imbalance=solution.imbalance,
        volume=volume(mesh.points, mesh.cells),
        cad_volume=specimen.volume,
        unknowns=solution.unknowns,
        condensed_mass=condense_mass(solution),
        **vars(rigid_mass(mesh.points, solution.system.mass.nodes)),
    )


@threadpool_limits.wrap(limits=1)
def _with_fields(
    experiment: Experiment, solution: Solution, settings: Settings
) -> Experiment:
    return replace(
        experiment,
        **vars(compute_dynamics(solution, settings)),
        displacement=solution.displacement.T.reshape(len(solution.cubic), -1, 3),
        von_mises=solution.von_mises.T,
    )
