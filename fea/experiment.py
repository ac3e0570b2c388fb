"""The virtual experiment: a part, clamped and loaded by unit wrenches, gives its compliance with an error bar."""

from __future__ import annotations

import time
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.errors import InputError
from stiffscope.fea.interfaces import KINDS
from stiffscope.fea.mesh import TetMesh, check_lengths, default_size

if TYPE_CHECKING:
    from collections.abc import Callable

    from stiffscope.cad.part import Part
    from stiffscope.fea.mesh import Floats
    from stiffscope.fea.specimen import Specimen

    Progress = Callable[[str, float], None]

MOST_LAYERS = 6  # of thin elements at singular edges; the thinnest has a 4000th of the size

# A coarse tessellation is enough, since nodes are put back on the solid, and a fine one costs: a circle of 16 sides
# instead of 12 takes four times the elements and twice the time.
CHORD, TURN = 0.15, 1.1  # distance to the surface in element sizes, radians from one triangle to the next


@dataclass(frozen=True)
class Settings:
    """How to mesh and solve; the defaults suit a part that is neither thin-walled nor full of tiny features.

    Attributes
    ----------
    size, envelope : element length and the mesher's allowance, m; None chooses them from the part.
    interface : "rigid" (the loaded face moves as one body) or "distributed" (a linear traction).
    layers : 1 to 6 thin layers of elements around the borders of held faces and re-entrant edges.
    tolerance : relative bound wanted of every significant entry, 1e-3 for 0.1 %; None takes what one mesh gives.
    foundation : stiffness of the clamp per unit of area, N/m³, for a bolted contact; None is a rigid clamp.
    time_limit : seconds allowed to the mesher, and to refinement.
    most_unknowns : degrees of freedom of the cubic solution beyond which refinement stops.
    solver : "direct" (a factorization), "multigrid", or "auto", the faster of the two.
    threads : the mesher's threads; 0 takes all.
    """

    size: float | None = None
    envelope: float | None = None
    interface: str = "rigid"
    layers: int = 1
    tolerance: float | None = None
    foundation: float | None = None
    time_limit: float = 300.0
    most_unknowns: int = 2_000_000
    solver: str = "auto"
    threads: int = 0

    def __post_init__(self) -> None:
        """Raise InputError for values that cannot be used."""
        for name in ("size", "envelope"):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value) and value > 0):
                raise InputError(f"mesh.{name}: expected a positive length, got {value!r} m")
        if self.interface not in KINDS:
            raise InputError(f"interface: expected {' or '.join(KINDS)}, got {self.interface!r}")
        if self.solver not in ("auto", "direct", "multigrid"):
            raise InputError(f"solver: expected auto, direct or multigrid, got {self.solver!r}")
        if not (np.isfinite(self.time_limit) and self.time_limit > 0):
            raise InputError(f"mesh.time_limit: expected positive seconds, got {self.time_limit!r}")
        if self.tolerance is not None and not 1e-6 <= self.tolerance < 1:
            raise InputError(
                f"tolerance: expected a fraction from 1e-6 to below 1 (0.1 % is 1e-3), got {self.tolerance!r}"
            )
        if self.foundation is not None and not (np.isfinite(self.foundation) and self.foundation > 0):
            raise InputError(f"foundation: expected a positive stiffness per area in N/m3, got {self.foundation!r}")
        if not self.most_unknowns >= 1:
            raise InputError(f"mesh.most_unknowns: expected a positive number, got {self.most_unknowns!r}")
        if not 1 <= self.layers <= MOST_LAYERS:
            raise InputError(f"mesh.layers: expected 1 to {MOST_LAYERS}, got {self.layers!r}")


@dataclass(frozen=True, eq=False)
class Experiment:
    """What unit wrenches do to a part, in the part's axes; SI.

    Attributes
    ----------
    part, interface : names of the part and of the way it is loaded.
    flexibility : (6n, 6n) compliance of the n loaded interfaces together.
    flexibility_error : (6n, 6n) 95 % bounds on the distance to the exact elastic solution on the exact shape.
    reference_points : (n, 3) m.
    clamp_point : (3,) m, centre of the clamped area.
    mesh : the quadratic mesh.
    displacement : (6n, nodes, 3) m per unit wrench.
    von_mises : (6n, nodes) Pa per unit wrench.
    imbalance : how far the clamp's reactions are from balancing the wrenches, relative.
    volume, cad_volume : of the mesh and of the solid, m³.
    unknowns : degrees of freedom of the cubic solution behind the result.
    seconds : wall time of the stages cad, mesh, solve (refinement is in solve).
    note : one line on why a wanted tolerance was not met; empty when it was, or when none was wanted.
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
    seconds: dict[str, float] = field(default_factory=dict)
    note: str = ""

    @property
    def compliance(self) -> Floats:
        """(6, 6) twist component i for a unit of wrench component j at the first interface's reference point."""
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
        """Largest bound of the significant entries (|C_ij| > 1 % of sqrt(C_ii C_jj)) over the entry."""
        from stiffscope.fea.adapt import relative_bound

        return relative_bound(self.flexibility, self.flexibility_error)[0]

    def _repr_html_(self) -> str:
        """Return the compliance with its bounds and units as a table, for notebooks."""
        from stiffscope.fea.tables import html_table

        return html_table(self)

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
    InputError : the file is torn or is something else.
    """
    try:
        with np.load(Path(path), allow_pickle=False) as held:
            data = {name: held[name] for name in held.files}
        mesh = TetMesh(
            **{f.name: data[f"mesh_{f.name}"] for f in fields(TetMesh) if f.name != "pulled_back"},
            pulled_back=int(data["mesh_pulled_back"]),
        )
        seconds = dict(zip(data["seconds_names"].tolist(), data["seconds_values"].tolist(), strict=True))
        known = [f.name for f in fields(Experiment) if f.name in data and f.name not in ("mesh", "seconds")]
        plain = {name: data[name] for name in known}
        plain = {name: value if value.ndim else value.item() for name, value in plain.items()}
        return Experiment(**plain, mesh=mesh, seconds=seconds)
    except (OSError, KeyError, ValueError, TypeError, EOFError) as problem:
        raise InputError(f"{path}: not an experiment of this version ({problem})") from problem
    except Exception as problem:  # zipfile and zlib raise their own for torn files
        if type(problem).__module__ in ("zipfile", "zlib"):
            raise InputError(f"{path}: the file is torn ({problem})") from problem
        raise


def run_experiment(part: Part, settings: Settings | None = None, progress: Progress | None = None) -> Experiment:
    """Mesh a part, clamp it, load it by unit wrenches and return its compliance with an error bar.

    Parameters
    ----------
    part : a solid with a material, clamped faces and loaded interfaces.
    settings : how to mesh and solve.
    progress : called with a stage's name and the fraction done.

    Raises
    ------
    InputError, MeshError : the part cannot be meshed or held as asked.
    """
    from stiffscope.cad import kernel
    from stiffscope.cad.part import mass_properties, project, surface
    from stiffscope.fea.specimen import Specimen

    started = time.perf_counter()
    _tell(progress, "cad", 0.0)
    settings = settings or Settings()
    volume = mass_properties(part).volume
    check_lengths(part.name, (volume, kernel.diagonal(part.solid) * 1e-3), settings.size, settings.envelope)
    size = settings.size or default_size(volume, sum(face.area for face in part.faces))
    skin = surface(part, deflection=CHORD * size, angle=TURN)
    specimen = Specimen(
        name=part.name,
        surface=skin,
        project=lambda place, points: project(part, place, points),
        elasticity=part.material.elasticity(),
        clamped=part.clamped,
        loaded=tuple((face.faces, np.asarray(face.reference_point, dtype=float)) for face in part.loaded),
        volume=float(volume),
    )
    return examine(specimen, settings, progress, time.perf_counter() - started)


def examine(
    specimen: Specimen, settings: Settings, progress: Progress | None = None, cad_seconds: float = 0.0
) -> Experiment:
    """Run the experiment on plain numbers; see ``run_experiment``."""
    from stiffscope.fea.adapt import solve_within
    from stiffscope.fea.shape import centroid, volume
    from stiffscope.fea.specimen import mesh_specimen

    begun = time.perf_counter()
    _tell(progress, "mesh", 0.05)
    mesh = mesh_specimen(
        specimen,
        size=settings.size,
        envelope=settings.envelope,
        layers=settings.layers,
        rigid=settings.interface == "rigid",
        time_limit=settings.time_limit,
        threads=settings.threads,
    )
    meshed = time.perf_counter()
    _tell(progress, "solve", 0.5)
    mesh, solution, note = solve_within(
        specimen, mesh, settings, lambda stage, fraction: _tell(progress, stage, 0.5 + 0.5 * fraction)
    )
    experiment = Experiment(
        part=specimen.name,
        interface=settings.interface,
        reference_points=np.array([point for _, point in specimen.loaded]),
        clamp_point=centroid(mesh.points[mesh.facets_of(specimen.clamped)]),
        mesh=mesh,
        volume=volume(mesh.points, mesh.cells),
        cad_volume=specimen.volume,
        seconds={"cad": cad_seconds, "mesh": meshed - begun, "solve": time.perf_counter() - meshed},
        flexibility=solution.flexibility,
        flexibility_error=solution.error,
        displacement=solution.displacement,
        von_mises=solution.von_mises,
        imbalance=solution.imbalance,
        unknowns=solution.unknowns,
        note=note,
    )
    _tell(progress, "solve", 1.0)
    return experiment


def _tell(progress: Progress | None, stage: str, fraction: float) -> None:
    if progress is not None:
        progress(stage, fraction)
