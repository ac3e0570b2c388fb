"""The virtual experiment: the compliance, with error bounds, of a part that is clamped and loaded by unit wrenches."""

from __future__ import annotations

import time
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.errors import InputError
from stiffscope.fea.mesh import TetMesh, check_lengths, default_size
from stiffscope.fea.settings import Settings
from stiffscope.fea.significance import largest_relative_bound
from stiffscope.listening import LISTENERS

if TYPE_CHECKING:
    from collections.abc import Callable

    from stiffscope.cad.part import Part
    from stiffscope.fea.mesh import Floats
    from stiffscope.fea.specimen import Specimen

    Progress = Callable[[str, float], None]

# A coarse tessellation suffices, since nodes are projected on the solid afterwards, and a fine one is expensive: a
# circle of 16 sides instead of 12 takes four times the elements and twice the time.
CHORD, TURN = 0.15, 1.1  # distance to the surface in element sizes, angle between adjacent triangles in rad


@dataclass(frozen=True, eq=False)
class Experiment:
    """The result: the response of a part to unit wrenches, in the part's axes; SI.

    Attributes
    ----------
    part, interface : names of the part and of the coupling of its loaded faces.
    flexibility : (6n, 6n) compliance of the n loaded interfaces together.
    flexibility_error : (6n, 6n) 95 % bounds of its distance to linear elasticity on the exact shape.
    reference_points : (n, 3) m.
    clamp_point : (3,) m, centre of the clamped area.
    mesh : the quadratic mesh.
    displacement : (6n, nodes, 3) m per unit wrench.
    von_mises : (6n, nodes) Pa per unit wrench.
    imbalance : residual of the equilibrium between clamp and wrenches, relative.
    volume, cad_volume : of the mesh and of the solid, m³.
    unknowns : degrees of freedom of the cubic solution behind the result.
    mass, centre, inertia : kg, (3,) m, and (3, 3) kg m² about the centre of mass, of the mesh.
    condensed_mass : (6(1+n)+k, 6(1+n)+k) mass on the twists of the clamped area as a rigid body at ``clamp_point``, of
        the n loaded interfaces, and on k mass-normalized fixed-interface modes.
    mode_squares, mode_squares_error : (k,) squares of these modes' angular frequencies, rad²/s², all their stiffness,
        and their 95 % bounds.
    self_weight, self_weight_error : (3, 6) twist of the first interface for 1 m/s² along x, y, z on the clamped part,
        and its 95 % bounds.
    frequencies, frequency_error : (6,) lowest natural frequencies of the clamped part, Hz, and their 95 % bounds.
    seconds : wall time of the stages cad, mesh, solve (refinement is in solve).
    note : one line on why the required tolerance was not met; empty if it was, or if none was required.
    """

    part: str
    interface: str
    flexibility: Floats
    flexibility_error: Floats
    reference_points: Floats
    clamp_point: Floats
    mesh: TetMesh
    displacement: Floats
    von_mises: Floats
    imbalance: float
    volume: float
    cad_volume: float
    unknowns: int
    mass: float
    centre: Floats
    inertia: Floats
    condensed_mass: Floats
    mode_squares: Floats
    mode_squares_error: Floats
    self_weight: Floats
    self_weight_error: Floats
    frequencies: Floats
    frequency_error: Floats
    seconds: dict[str, float] = field(default_factory=dict)
    note: str = ""

    @property
    def compliance(self) -> Floats:
        """(6, 6) twist component i per unit of wrench component j at the first interface's reference point."""
        return self.flexibility[:6, :6]

    @property
    def error(self) -> Floats:
        """(6, 6) 95 % bounds of ``compliance``."""
        return self.flexibility_error[:6, :6]

    @property
    def reference_point(self) -> Floats:
        """(3,) the first interface's reference point, m."""
        return self.reference_points[0]

    @property
    def superelement(self) -> Floats:
        """(6n, 6n) stiffness of the part condensed on its loaded interfaces."""
        return np.asarray(np.linalg.inv(self.flexibility), dtype=np.float64)

    @property
    def relative_bound(self) -> float:
        """Largest relative error bound of the significant entries (above 1 % of ``sqrt(C_ii C_jj)``)."""
        return largest_relative_bound(self.flexibility, self.flexibility_error)[0]

    def save(self, path: Path | str) -> None:
        """Write everything into one npz file, without pickle."""
        arrays: dict[str, Any] = {
            f.name: np.asarray(getattr(self, f.name)) for f in fields(self) if f.name not in ("mesh", "seconds")
        }
        mesh: dict[str, Any] = {f"mesh_{f.name}": np.asarray(getattr(self.mesh, f.name)) for f in fields(TetMesh)}
        names = np.array(list(self.seconds), dtype=np.str_)
        np.savez_compressed(
            Path(path), **arrays, **mesh, seconds_names=names, seconds_values=np.array(list(self.seconds.values()))
        )


def load_experiment(path: Path | str) -> Experiment:
    """Read an experiment that ``Experiment.save`` wrote.

    Raises
    ------
    InputError : the file is damaged or holds something else.
    """
    try:
        with np.load(Path(path), allow_pickle=False) as held:
            data = {name: held[name] for name in held.files}
        mesh = TetMesh(
            **{f.name: data[f"mesh_{f.name}"] for f in fields(TetMesh) if f.name != "pulled_back"},
            pulled_back=int(data["mesh_pulled_back"]),
        )
        seconds = dict(zip(data["seconds_names"].tolist(), data["seconds_values"].tolist(), strict=True))
        known = [f.name for f in fields(Experiment) if f.name not in ("mesh", "seconds")]
        plain = {name: data[name] for name in known}
        plain = {name: value if value.ndim else value.item() for name, value in plain.items()}
        return Experiment(**plain, mesh=mesh, seconds=seconds)
    except (OSError, KeyError, ValueError, TypeError, EOFError) as problem:
        raise InputError(f"{path}: not an experiment of this version ({problem})") from problem
    except Exception as problem:  # zipfile and zlib raise their own for damaged files
        if type(problem).__module__ in ("zipfile", "zlib"):
            raise InputError(f"{path}: the file is damaged ({problem})") from problem
        raise


def run_experiment(part: Part, settings: Settings | None = None, progress: Progress | None = None) -> Experiment:
    """Mesh a part, clamp it, load it by unit wrenches and return its compliance with error bounds.

    Parameters
    ----------
    part : a solid with a material, clamped faces and loaded interfaces.
    settings : how to mesh and solve.
    progress : called with a stage's name and the fraction done.

    Returns
    -------
    compliance (6n, 6n) of n loaded interfaces in m/N, rad/N, m/(N m), rad/(N m), its bounds, mesh and fields.

    Raises
    ------
    InputError : a length out of range, interfaces that overlap, or a foundation that is too soft.
    MeshError : the part cannot be meshed or solved.
    """
    started = time.perf_counter()
    progress = progress or LISTENERS.open_line(part.name)
    _report(progress, "cad", 0.0)
    settings = settings or Settings()
    specimen = specimen_of(part, settings)
    return examine(specimen, settings, progress, time.perf_counter() - started)


def specimen_of(part: Part, settings: Settings) -> Specimen:
    """Return the part as plain numbers, its surface triangulated for the element size of the settings.

    Raises
    ------
    MeshError : a length of the settings is out of range for this part.
    """
    from stiffscope.cad import kernel
    from stiffscope.cad.part import mass_properties, project, surface
    from stiffscope.fea.specimen import Specimen

    volume = mass_properties(part).volume
    check_lengths(part.name, (volume, kernel.diagonal(part.solid) * 1e-3), settings.size, settings.envelope)
    size = settings.size or default_size(volume, sum(face.area for face in part.faces))
    return Specimen(
        name=part.name,
        surface=surface(part, deflection=CHORD * size, angle=TURN),
        project=lambda place, points: project(part, place, points),
        elasticity=part.material.elasticity(),
        clamped=part.clamped,
        loaded=tuple((face.faces, np.asarray(face.reference_point, dtype=float)) for face in part.loaded),
        volume=float(volume),
        density=float(part.material.density),
    )


def examine(
    specimen: Specimen, settings: Settings, progress: Progress | None = None, cad_seconds: float = 0.0
) -> Experiment:
    """Run the experiment on a specimen, without the CAD kernel; see ``run_experiment``."""
    from stiffscope.fea.adapt import solve_within
    from stiffscope.fea.dynamics import dynamics
    from stiffscope.fea.geometry import centroid, volume
    from stiffscope.fea.specimen import mesh_specimen

    begun = time.perf_counter()
    _report(progress, "mesh", 0.05)
    mesh = mesh_specimen(
        specimen,
        size=settings.size,
        envelope=settings.envelope,
        layers=settings.layers,
        rigid=settings.interface == "rigid",
        time_limit=settings.time_limit,
        threads=settings.threads,
        tolerance=settings.tolerance,
    )
    meshed = time.perf_counter()
    _report(progress, "solve", 0.5)
    mesh, solution, note = solve_within(
        specimen, mesh, settings, lambda stage, fraction: _report(progress, stage, 0.5 + 0.35 * fraction)
    )
    _report(progress, "modes", 0.85)
    inert = dynamics(solution.levels, settings)
    experiment = Experiment(
        part=specimen.name,
        interface=settings.interface,
        reference_points=np.array([point for _, point in specimen.loaded]),
        clamp_point=centroid(mesh.points[mesh.facets_of(specimen.clamped)]),
        mesh=mesh,
        volume=volume(mesh.points, mesh.cells),
        cad_volume=specimen.volume,
        seconds={"cad": cad_seconds, "mesh": meshed - begun, "solve": time.perf_counter() - meshed},
        flexibility=solution.compliance,
        flexibility_error=solution.error,
        displacement=solution.displacement,
        von_mises=solution.von_mises,
        imbalance=solution.imbalance,
        unknowns=solution.unknowns,
        note=note,
        mass=inert.rigid.mass,
        centre=inert.rigid.centre,
        inertia=inert.rigid.inertia,
        condensed_mass=inert.condensed_mass,
        mode_squares=inert.mode_squares,
        mode_squares_error=inert.mode_squares_error,
        self_weight=inert.self_weight,
        self_weight_error=inert.self_weight_error,
        frequencies=inert.frequencies,
        frequency_error=inert.frequency_error,
    )
    _report(progress, "solve", 1.0)
    return experiment


def _report(progress: Progress | None, stage: str, fraction: float) -> None:
    if progress is not None:
        progress(stage, fraction)
