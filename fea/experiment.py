"""The virtual experiment: the compliance, with error bounds, of a part that is clamped and loaded by unit wrenches."""

from __future__ import annotations

import time
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from stiffscope.errors import InputError
from stiffscope.fea.mesh import TetMesh, check_lengths, check_time, default_size, flatness_of
from stiffscope.fea.settings import Settings
from stiffscope.fea.significance import largest_relative_bound
from stiffscope.runtime.listening import LISTENERS

if TYPE_CHECKING:
    from collections.abc import Callable

    from stiffscope.cad.part import Part
    from stiffscope.fea.mesh import Floats
    from stiffscope.fea.solution import Solution
    from stiffscope.fea.specimen import Specimen

    Progress = Callable[[str, float], None]
    Kind = TypeVar("Kind", bound="Condensed")

# A coarse tessellation suffices, since nodes are projected on the solid afterwards, and a fine one is expensive: a
# circle of 16 sides instead of 12 takes four times the elements and twice the time.
CHORD, TURN = 0.15, 1.1  # distance to the surface in element sizes, angle between adjacent triangles in rad


@dataclass(frozen=True, eq=False, kw_only=True)
class Condensed:
    """A part condensed on its clamp and its loaded interfaces, in the part's axes; SI.

    Attributes
    ----------
    part, interface : names of the part and of the coupling of its loaded faces.
    flexibility : (6n, 6n) compliance of the n loaded interfaces together.
    flexibility_error : (6n, 6n) 95 % bounds of its distance to linear elasticity on the exact shape.
    reference_points : (n, 3) m.
    clamp_point : (3,) m, centre of the clamped area.
    mesh : the quadratic mesh.
    imbalance : residual of the equilibrium between clamp and wrenches, relative.
    volume, cad_volume : of the mesh and of the solid, m³.
    unknowns : degrees of freedom of the cubic solution behind the result.
    mass, centre, inertia : kg, (3,) m, and (3, 3) kg m² about the centre of mass, of the mesh.
    condensed_mass : (6(1+n)+k, 6(1+n)+k) mass on the twists of the clamped area as a rigid body at ``clamp_point``, of
        the n loaded interfaces, and on k mass-normalized fixed-interface modes, of which only an experiment has any.
    mode_squares, mode_squares_error : (k,) squares of these modes' angular frequencies, rad²/s², all their stiffness,
        and their 95 % bounds.
    seconds : wall time of the stages cad, mesh, solve (refinement is in solve).
    note : one line on why the required tolerance was not met; empty if it was, or if none was required.
    moved : whether the mesh was that of a part of other dimensions, moved along.
    """

    part: str
    interface: str
    flexibility: Floats
    flexibility_error: Floats
    reference_points: Floats
    clamp_point: Floats
    mesh: TetMesh
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
    seconds: dict[str, float] = field(default_factory=dict)
    note: str = ""
    moved: bool = False

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


@dataclass(frozen=True, eq=False, kw_only=True)
class Experiment(Condensed):
    """The whole result: what is condensed, and the part's fields, own weight and natural frequencies; SI.

    Attributes
    ----------
    displacement : (6n, nodes, 3) m per unit wrench.
    von_mises : (6n, nodes) Pa per unit wrench.
    self_weight, self_weight_error : (3, 6) twist of the first interface for 1 m/s² along x, y, z on the clamped part,
        and its 95 % bounds.
    frequencies, frequency_error : (6,) lowest natural frequencies of the clamped part, Hz, and their 95 % bounds.
    """

    displacement: Floats
    von_mises: Floats
    self_weight: Floats
    self_weight_error: Floats
    frequencies: Floats
    frequency_error: Floats


def load_experiment(path: Path | str) -> Experiment:
    """Read an experiment that ``Experiment.save`` wrote.

    Raises
    ------
    InputError : the file is damaged or holds something else.
    """
    return _load(Experiment, path)


def load_condensed(path: Path | str) -> Condensed:
    """Read what ``Condensed.save`` wrote, an experiment's too. See ``load_experiment``."""
    return _load(Condensed, path)


def _load(kind: type[Kind], path: Path | str) -> Kind:
    names = [f.name for f in fields(kind) if f.name not in ("mesh", "seconds")]
    mesh_names = [f.name for f in fields(TetMesh)]
    wanted = [*names, *(f"mesh_{name}" for name in mesh_names), "seconds_names", "seconds_values"]
    try:
        with np.load(Path(path), allow_pickle=False) as held:
            data = {name: held[name] for name in wanted}
        mesh = TetMesh(
            **{name: data[f"mesh_{name}"] for name in mesh_names if name != "pulled_back"},
            pulled_back=int(data["mesh_pulled_back"]),
        )
        seconds = dict(zip(data["seconds_names"].tolist(), data["seconds_values"].tolist(), strict=True))
        plain = {name: data[name] if data[name].ndim else data[name].item() for name in names}
        return kind(**plain, mesh=mesh, seconds=seconds)
    except (OSError, KeyError, ValueError, TypeError, EOFError) as problem:
        raise InputError(f"{path}: not an experiment of this version ({problem})") from problem
    except Exception as problem:  # zipfile and zlib raise their own for damaged files
        if type(problem).__module__ in ("zipfile", "zlib"):
            raise InputError(f"{path}: the file is damaged ({problem})") from problem
        raise


def run_experiment(
    part: Part, settings: Settings | None = None, progress: Progress | None = None, former: Condensed | None = None
) -> Experiment:
    """Mesh a part, clamp it, load it by unit wrenches and return its compliance with error bounds.

    Parameters
    ----------
    part : a solid with a material, clamped faces and loaded interfaces.
    settings : how to mesh and solve.
    progress : called with a stage's name and the fraction done.
    former : of the same part and settings; its mesh is taken, so that its compliance is the same.

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
    return examine(specimen, settings, progress, time.perf_counter() - started, former)


def condense(
    part: Part, settings: Settings, progress: Progress | None = None, near: tuple[Part, TetMesh] | None = None
) -> Condensed:
    """As ``run_experiment``, without fields, own weight and frequencies: enough for a robot, but for its modes.

    Parameters
    ----------
    near : a part of slightly other dimensions and its mesh for the same settings, which is moved along if it can be.
    """
    started = time.perf_counter()
    _report(progress, "cad", 0.0)
    specimen = specimen_of(part, settings)
    mesh = _moved(specimen, part, *near) if near else None
    return condense_specimen(specimen, settings, progress, time.perf_counter() - started, mesh)


def _moved(specimen: Specimen, part: Part, former: Part, mesh: TetMesh) -> TetMesh | None:
    """Return the mesh of a former part moved along, None where that has not the shape of this one."""
    from stiffscope.fea.design_velocity import moved_along
    from stiffscope.fea.specimen import GOOD_SHAPE, shape_error

    moved = moved_along(mesh, former, part)
    return moved if moved and shape_error(specimen, moved) < GOOD_SHAPE else None


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
    area, flatness = sum(face.area for face in part.faces), flatness_of(volume, part.faces)
    size = settings.size or default_size(volume, area, flatness)
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
    specimen: Specimen,
    settings: Settings,
    progress: Progress | None = None,
    cad_seconds: float = 0.0,
    former: Condensed | None = None,
) -> Experiment:
    """Run the experiment on a specimen, without the CAD kernel; see ``run_experiment``."""
    from stiffscope.fea.dynamics import dynamics

    statics, solution = _statics(specimen, settings, progress, cad_seconds, former)
    solved = time.perf_counter()
    _report(progress, "modes", 0.85)
    statics |= vars(dynamics(solution.levels, settings))
    statics["seconds"]["solve"] += time.perf_counter() - solved
    experiment = Experiment(**statics, displacement=solution.displacement, von_mises=solution.von_mises)
    _report(progress, "solve", 1.0)
    return experiment


def condense_specimen(
    specimen: Specimen,
    settings: Settings,
    progress: Progress | None = None,
    cad_seconds: float = 0.0,
    moved: TetMesh | None = None,
) -> Condensed:
    """Condense a specimen, without the CAD kernel, on its own mesh or one ``moved`` along; see ``condense``."""
    from stiffscope.fea.dynamics import condensed_mass

    statics, solution = _statics(specimen, settings, progress, cad_seconds, mesh=moved, modes=False)
    _report(progress, "solve", 1.0)
    mass, none = condensed_mass(solution.levels), np.zeros(0)
    return Condensed(
        **statics, condensed_mass=mass, mode_squares=none, mode_squares_error=none, moved=moved is not None
    )


def _statics(
    specimen: Specimen,
    settings: Settings,
    progress: Progress | None,
    cad_seconds: float,
    former: Condensed | None = None,
    mesh: TetMesh | None = None,
    *,
    modes: bool = True,
) -> tuple[dict[str, Any], Solution]:
    """Return the static fields of ``Condensed`` by name, and the solution behind them.

    Parameters
    ----------
    former : has the mesh, refined for the tolerance.
    mesh : where it is made already, but not refined.
    modes : whether natural frequencies follow.
    """
    from stiffscope.fea.adapt import solve_on, solve_within
    from stiffscope.fea.geometry import centroid, volume
    from stiffscope.fea.mass import rigid_mass
    from stiffscope.fea.specimen import cure_of, mesh_specimen

    begun = time.perf_counter()
    left = max(settings.time_limit - cad_seconds, 1.0)
    _report(progress, "mesh", 0.05)
    mesh = (
        former.mesh
        if former
        else mesh
        or mesh_specimen(
            specimen,
            size=settings.size,
            envelope=settings.envelope,
            layers=settings.layers,
            rigid=settings.interface == "rigid",
            time_limit=left,
            threads=settings.threads,
            tolerance=settings.tolerance,
        )
    )
    meshed = time.perf_counter()
    _report(progress, "solve", 0.5)
    left -= meshed - begun
    if former:
        solution, note = solve_on(specimen, mesh, settings), former.note
    else:
        check_time(len(mesh.cells), left, cure_of(specimen, settings.size), meshed=True)
        mesh, solution, note = solve_within(
            specimen,
            mesh,
            settings,
            lambda stage, fraction: _report(progress, stage, 0.5 + 0.35 * fraction),
            max(left, 1.0),
            modes=modes,
        )
    rigid = rigid_mass(mesh.points, solution.levels.system.mass.nodes)
    statics = {
        "part": specimen.name,
        "interface": settings.interface,
        "flexibility": solution.compliance,
        "flexibility_error": solution.error,
        "reference_points": np.array([point for _, point in specimen.loaded]),
        "clamp_point": centroid(mesh.points[mesh.facets_of(specimen.clamped)]),
        "mesh": mesh,
        "imbalance": solution.imbalance,
        "volume": volume(mesh.points, mesh.cells),
        "cad_volume": specimen.volume,
        "unknowns": solution.unknowns,
        "mass": rigid.mass,
        "centre": rigid.centre,
        "inertia": rigid.inertia,
        "seconds": {
            "cad": cad_seconds,
            "mesh": former.seconds["mesh"] if former else meshed - begun,
            "solve": time.perf_counter() - meshed,
        },
        "note": note,
    }
    return statics, solution


def _report(progress: Progress | None, stage: str, fraction: float) -> None:
    if progress is not None:
        progress(stage, fraction)
