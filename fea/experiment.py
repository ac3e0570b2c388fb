"""Result of a virtual experiment: the bounded compliance of a clamped part under unit wrenches."""

from __future__ import annotations

import zipfile
import zlib
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np

from stiffscope.errors import InputError
from stiffscope.fea.mesh import Floats, TetMesh
from stiffscope.fea.rigid import relative_twists
from stiffscope.runtime.brief import describe_briefly

FIELDS = ("displacement", "von_mises")  # used for pictures only: nearly all of a file

SIGNIFICANT = (
    0.01  # of sqrt(C_ii C_jj): smaller entries vanish by symmetry, or nearly so
)


def largest_relative_bound(
    compliance: Floats, error: Floats
) -> tuple[float, tuple[int, int]]:
    """Return the largest relative error of significant entries of (k, k) matrices, and indices."""
    scale = np.sqrt(compliance.diagonal())
    size = np.abs(compliance)
    significant = size > SIGNIFICANT * np.outer(scale, scale)
    ratio = np.where(significant, error / np.maximum(size, 1e-300), 0.0)
    i, j = np.unravel_index(ratio.argmax(), ratio.shape)
    return float(ratio[i, j]), (int(i), int(j))


def _make_empty() -> Floats:
    return np.zeros(0)


@dataclass(frozen=True, eq=False, kw_only=True)
class Experiment:
    """A part condensed on its clamp and loaded interfaces, in part axes; SI.

    The fields after ``moved`` are empty in an experiment for the compliance alone.

    Attributes
    ----------
    part, interface : names of the part and of the coupling of its loaded faces.
    interfaces : names of the interfaces, the clamp first.
    full_compliance : (6n, 6n) of the n loaded interfaces together.
    full_error : (6n, 6n) 95 % bounds of the difference to linear elasticity on the exact shape.
    reference_points : (n, 3) m.
    clamp_point : (3,) m, centroid of the clamped area.
    stiffness_error : (6(1+n), 6(1+n)) 95 % bounds of ``stiffness``.
    mesh : quadratic mesh.
    imbalance : relative residual of the equilibrium between clamp and wrenches.
    volume, cad_volume : volume of the mesh and of the solid, m³.
    unknowns : degrees of freedom of the cubic solution.
    mass, centre, inertia : kg, (3,) m, and (3, 3) kg m² about the centre of mass, of the mesh.
    condensed_mass : (6(1+n)+k, 6(1+n)+k) mass on the twists of the clamped area, rigid, at
        ``clamp_point``, of the n loaded interfaces, and on k mass-normalized fixed-interface modes.
    seconds : wall time of the stages cad, mesh and solve (with refinement).
    note : one line on why the tolerance was not met; empty if it was met or not required.
    moved : whether the mesh was moved from a part of other dimensions.
    mode_squares, mode_squares_error : (k,) squared angular frequencies of these modes, rad²/s²,
        their only stiffness, and their 95 % bounds.
    self_weight, self_weight_error : (3, 6) first interface's twist for 1 m/s² along x, y, z on the
        clamped part, and its 95 % bounds.
    frequencies, frequency_error : (6,) lowest natural frequencies of the clamped part, Hz, and
        their 95 % bounds.
    displacement : (6n, nodes, 3) m per unit wrench.
    von_mises : (6n, nodes) Pa per unit wrench.
    """

    __repr__ = describe_briefly

    part: str
    interface: str
    interfaces: tuple[str, ...]
    full_compliance: Floats
    full_error: Floats
    reference_points: Floats
    clamp_point: Floats
    stiffness_error: Floats
    mesh: TetMesh
    imbalance: float
    volume: float
    cad_volume: float
    unknowns: int
    mass: float
    centre: Floats
    inertia: Floats
    condensed_mass: Floats
    seconds: dict[str, float] = field(default_factory=dict)
    note: str = ""
    moved: bool = False
    mode_squares: Floats = field(default_factory=_make_empty)
    mode_squares_error: Floats = field(default_factory=_make_empty)
    self_weight: Floats = field(default_factory=_make_empty)
    self_weight_error: Floats = field(default_factory=_make_empty)
    frequencies: Floats = field(default_factory=_make_empty)
    frequency_error: Floats = field(default_factory=_make_empty)
    displacement: Floats = field(default_factory=_make_empty)
    von_mises: Floats = field(default_factory=_make_empty)

    @property
    def compliance(self) -> Floats:
        """First interface's compliance (6, 6): twist i per wrench j at its reference point."""
        return self.full_compliance[:6, :6]

    @property
    def error(self) -> Floats:
        """95 % bounds (6, 6) of ``compliance``."""
        return self.full_error[:6, :6]

    @property
    def reference_point(self) -> Floats:
        """First interface's reference point (3,), m."""
        return self.reference_points[0]

    @property
    def places(self) -> Floats:
        """Reference points (1 + n, 3), m, of all ``interfaces``, the clamp's first."""
        return np.vstack([self.clamp_point, self.reference_points])

    @property
    def stiffness(self) -> Floats:
        """Stiffness (6(1+n), 6(1+n)) of the unsupported part on all ``interfaces``."""
        free = relative_twists(self.reference_points, self.clamp_point)
        condensed = free.T @ np.linalg.solve(self.full_compliance, free)
        return (condensed + condensed.T) / 2

    @property
    def mass_matrix(self) -> Floats:
        """Mass (6(1+n), 6(1+n)) condensed on all ``interfaces``, in the order of ``stiffness``."""
        size = 6 * len(self.places)
        return self.condensed_mass[:size, :size]

    @property
    def superelement(self) -> Floats:
        """Stiffness (6n, 6n) of the part condensed on its loaded interfaces."""
        return np.asarray(np.linalg.inv(self.full_compliance), dtype=np.float64)

    @property
    def relative_bound(self) -> float:
        """Largest relative bound of the significant entries (above 1 % of ``sqrt(C_ii C_jj)``)."""
        return largest_relative_bound(self.full_compliance, self.full_error)[0]

    def save(self, path: Path | str) -> None:
        """Write the experiment to one npz file, without pickle."""
        arrays: dict[str, Any] = {
            name: np.asarray(getattr(self, name)) for name in _NAMES
        }
        arrays |= {
            f"mesh_{name}": np.asarray(getattr(self.mesh, name)) for name in _MESH_NAMES
        }
        names = np.array(list(self.seconds), dtype=np.str_)
        values = np.array(list(self.seconds.values()))
        np.savez_compressed(
            Path(path), **arrays, seconds_names=names, seconds_values=values
        )


_NAMES = tuple(f.name for f in fields(Experiment) if f.name not in ("mesh", "seconds"))
_MESH_NAMES = tuple(f.name for f in fields(TetMesh))


def load_experiment(path: Path | str, *, fields: bool = True) -> Experiment:
    """Read an experiment written by ``Experiment.save``.

    Without ``fields``, displacement and stress, nearly all of the file, stay empty.

    Raises
    ------
    InputError : if the file is damaged or is not an experiment.
    """
    names = _NAMES if fields else tuple(name for name in _NAMES if name not in FIELDS)
    try:
        with np.load(Path(path), allow_pickle=False) as held:
            plain = {name: _read(held[name]) for name in names}
            mesh = TetMesh(
                **{name: _read(held[f"mesh_{name}"]) for name in _MESH_NAMES}
            )
            keys = held["seconds_names"].tolist()
            values = held["seconds_values"].tolist()
        plain["interfaces"] = tuple(plain["interfaces"].tolist())
        experiment = Experiment(
            **plain, mesh=mesh, seconds=dict(zip(keys, values, strict=True))
        )
        _check_sound(experiment)
        return experiment
    except (zipfile.BadZipFile, zlib.error) as problem:
        raise InputError(f"{path}: the file is damaged ({problem})") from problem
    except (OSError, KeyError, ValueError, TypeError, EOFError) as problem:
        raise InputError(
            f"{path}: not an experiment of this version ({problem})"
        ) from problem


def _check_sound(experiment: Experiment) -> None:
    """Raise ValueError for wrong shapes, infinite numbers, and a part that does not yield."""
    n = len(experiment.interfaces) - 1
    shapes = (6 * n, 6 * n), (n, 3), (3,), (3, 3)
    arrays = (
        experiment.full_compliance,
        experiment.reference_points,
        experiment.clamp_point,
        experiment.inertia,
    )
    sound = all(
        a.shape == b and np.isfinite(a).all()
        for a, b in zip(arrays, shapes, strict=True)
    )
    nodes = experiment.mesh.points
    if not (
        sound and np.isfinite(nodes).all() and experiment.mesh.cells.max() < len(nodes)
    ):
        raise ValueError("expected finite numbers, as many as it has interfaces")
    if (
        experiment.full_error.shape != shapes[0]
        or not (np.diag(experiment.full_compliance) > 0.0).all()
    ):
        raise ValueError("expected a part that yields, with bounds")


def _read(array: np.ndarray) -> Any:
    """Return the array, or its value if it is a scalar."""
    return array if array.ndim else array.item()
