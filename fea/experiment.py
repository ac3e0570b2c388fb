"""A virtual experiment's result: the compliance, with error bounds, of a part clamped and loaded by unit wrenches."""

from __future__ import annotations

import zipfile
import zlib
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.errors import InputError
from stiffscope.fea.mesh import TetMesh
from stiffscope.fea.rigid import relative_twists
from stiffscope.fea.significance import largest_relative_bound
from stiffscope.runtime.brief import describe_briefly

if TYPE_CHECKING:
    from stiffscope.fea.mesh import Floats

FIELDS = ("displacement", "von_mises")  # what pictures need: nearly all of a file


def _make_empty() -> Floats:
    return np.zeros(0)


@dataclass(frozen=True, eq=False, kw_only=True)
class Experiment:
    """A part condensed on its clamp and its loaded interfaces, in the part's axes; SI.

    What follows ``moved`` is empty in an experiment for the compliance alone.

    Attributes
    ----------
    part, interface : names of the part and of the coupling of its loaded faces.
    interfaces : names of the interfaces, the one at rest (the clamp) first.
    full_compliance : (6n, 6n) of the n loaded interfaces together.
    full_error : (6n, 6n) 95 % bounds of its distance to linear elasticity on the exact shape.
    reference_points : (n, 3) m.
    clamp_point : (3,) m, centre of the clamped area.
    stiffness_error : (6(1+n), 6(1+n)) 95 % bounds of ``stiffness``.
    mesh : the quadratic mesh.
    imbalance : residual of the equilibrium between clamp and wrenches, relative.
    volume, cad_volume : of the mesh and of the solid, m³.
    unknowns : degrees of freedom of the cubic solution behind the result.
    mass, centre, inertia : kg, (3,) m, and (3, 3) kg m² about the centre of mass, of the mesh.
    condensed_mass : (6(1+n)+k, 6(1+n)+k) mass on the twists of the clamped area as a rigid body at
        ``clamp_point``, of the n loaded interfaces, and on k mass-normalized fixed-interface modes.
    seconds : wall time of the stages cad, mesh, solve (refinement is in solve).
    note : one line on why the required tolerance was not met; empty if it was, or if none was required.
    moved : whether the mesh was that of a part of other dimensions, moved along.
    mode_squares, mode_squares_error : (k,) squares of these modes' angular frequencies, rad²/s², all their
        stiffness, and their 95 % bounds.
    self_weight, self_weight_error : (3, 6) twist of the first interface for 1 m/s² along x, y, z on the
        clamped part, and its 95 % bounds.
    frequencies, frequency_error : (6,) lowest natural frequencies of the clamped part, Hz, and their 95 % bounds.
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
        """(6, 6) twist component i per unit of wrench component j at the first interface's reference point."""
        return self.full_compliance[:6, :6]

    @property
    def error(self) -> Floats:
        """(6, 6) 95 % bounds of ``compliance``."""
        return self.full_error[:6, :6]

    @property
    def reference_point(self) -> Floats:
        """(3,) the first interface's reference point, m."""
        return self.reference_points[0]

    @property
    def places(self) -> Floats:
        """(1 + n, 3) m, where the twists and wrenches of all ``interfaces`` act, the clamp's first."""
        return np.vstack([self.clamp_point, self.reference_points])

    @property
    def stiffness(self) -> Floats:
        """(6(1+n), 6(1+n)) stiffness of the unsupported part on all ``interfaces``: rigid motions cost nothing."""
        free = relative_twists(self.reference_points, self.clamp_point)
        found = free.T @ np.linalg.solve(self.full_compliance, free)
        return (found + found.T) / 2

    @property
    def mass_matrix(self) -> Floats:
        """(6(1+n), 6(1+n)) mass condensed on all ``interfaces``, in the order of ``stiffness``."""
        size = 6 * len(self.places)
        return self.condensed_mass[:size, :size]

    @property
    def superelement(self) -> Floats:
        """(6n, 6n) stiffness of the part condensed on its loaded interfaces."""
        return np.asarray(np.linalg.inv(self.full_compliance), dtype=np.float64)

    @property
    def relative_bound(self) -> float:
        """Largest relative error bound of the significant entries (above 1 % of ``sqrt(C_ii C_jj)``)."""
        return largest_relative_bound(self.full_compliance, self.full_error)[0]

    def save(self, path: Path | str) -> None:
        """Write everything into one npz file, without pickle."""
        arrays: dict[str, Any] = {name: np.asarray(getattr(self, name)) for name in _NAMES}
        arrays |= {f"mesh_{name}": np.asarray(getattr(self.mesh, name)) for name in _MESH_NAMES}
        names = np.array(list(self.seconds), dtype=np.str_)
        values = np.array(list(self.seconds.values()))
        np.savez_compressed(Path(path), **arrays, seconds_names=names, seconds_values=values)


_NAMES = tuple(f.name for f in fields(Experiment) if f.name not in ("mesh", "seconds"))
_MESH_NAMES = tuple(f.name for f in fields(TetMesh))


def load_experiment(path: Path | str, *, fields: bool = True) -> Experiment:
    """Read an experiment that ``Experiment.save`` wrote.

    Parameters
    ----------
    path
        The npz file.
    fields
        Whether displacement and stress are read, nearly all of the file; False leaves them empty.

    Returns
    -------
    Experiment
        As it was saved.

    Raises
    ------
    InputError
        The file is damaged or holds something else.

    """
    names = _NAMES if fields else tuple(name for name in _NAMES if name not in FIELDS)
    try:
        with np.load(Path(path), allow_pickle=False) as held:
            plain = {name: _read(held[name]) for name in names}
            mesh = TetMesh(**{name: _read(held[f"mesh_{name}"]) for name in _MESH_NAMES})
            keys, values = held["seconds_names"].tolist(), held["seconds_values"].tolist()
        plain["interfaces"] = tuple(plain["interfaces"].tolist())
        found = Experiment(**plain, mesh=mesh, seconds=dict(zip(keys, values, strict=True)))
        _check_sound(found)
        return found
    except (zipfile.BadZipFile, zlib.error) as problem:
        raise InputError(f"{path}: the file is damaged ({problem})") from problem
    except (OSError, KeyError, ValueError, TypeError, EOFError) as problem:
        raise InputError(f"{path}: not an experiment of this version ({problem})") from problem


def _check_sound(found: Experiment) -> None:
    """Raise ValueError for arrays of other shapes, numbers that are not finite, and a part that does not yield."""
    n = len(found.interfaces) - 1
    shapes = (6 * n, 6 * n), (n, 3), (3,), (3, 3)
    arrays = found.full_compliance, found.reference_points, found.clamp_point, found.inertia
    sound = all(each.shape == shape and np.isfinite(each).all() for each, shape in zip(arrays, shapes, strict=True))
    nodes = found.mesh.points
    if not (sound and np.isfinite(nodes).all() and found.mesh.cells.max() < len(nodes)):
        raise ValueError("expected finite numbers, as many as it has interfaces")
    if found.full_error.shape != shapes[0] or not (np.diag(found.full_compliance) > 0.0).all():
        raise ValueError("expected a part that yields, with bounds")


def _read(array: np.ndarray) -> Any:
    """Return a scalar as such."""
    return array if array.ndim else array.item()
