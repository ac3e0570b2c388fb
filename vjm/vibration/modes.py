"""Natural frequencies and mode shapes of a mechanism at many poses.

For many poses, subspace iteration from the first pose's modes finds the lowest ones.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.errors import InputError, say_count
from stiffscope.runtime.threads import in_one_thread
from stiffscope.vjm.kinematics.configurations import configure
from stiffscope.vjm.kinematics.datasets import Labelled, make_dataset
from stiffscope.vjm.kinematics.mobility import mobility
from stiffscope.vjm.model.checks import GROUND, list_names, spell_name
from stiffscope.vjm.model.semidefinite import half_inverse
from stiffscope.vjm.network.network import END
from stiffscope.vjm.vibration.coordinates import sum_squares
from stiffscope.vjm.vibration.pencil import NOTHING, form_pencils

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from typing import TypeAlias

    import xarray as xr
    from numpy.typing import NDArray

    from stiffscope.vjm.kinematics.configurations import Configurations, Poses
    from stiffscope.vjm.kinematics.datasets import Variables
    from stiffscope.vjm.model.mechanism import Mechanism
    from stiffscope.vjm.model.screws import Array
    from stiffscope.vjm.vibration.coordinates import Coordinates, Rows
    from stiffscope.vjm.vibration.pencil import Drives, Pencil

    _Solved: TypeAlias = (
        "tuple[_Part, NDArray[np.intp]]"  # with the indices of its poses
    )

_CHUNK = 256  # poses
_FEW = 4  # poses, up to which each is solved in full
_FREE = (
    1e-9  # of the shift: squared angular frequency of a free motion, beyond rounding
)
_IDLE = 1e-6  # of a free motion's size: motion of tool and drives taken as zero
_GUARDS = 6  # additional iteration vectors, from modes and random
_ROUNDS = 20
_POWERS = 4
_CONVERGED = (
    1e-11  # change of μ relative to the largest; frequencies are far more accurate
)


@dataclass(frozen=True, eq=False, repr=False)
class Modes(Labelled):
    """Lowest modes of a mechanism at n poses, ascending; NaN if out of reach or if there are fewer.

    ``frequencies`` (n, c) in Hz, 0 if tool or drives move freely; ``error`` (n, c): 95 % bounds
    from those of the parts' compliances, zero without any. ``shapes``: twists (n, 6, c) of every
    node at M in base axes, for a modal mass of 1 kg (``tool``: the tool's). ``energy``: share (n,
    c) of each element in the strain energy; ``internal`` (n, c): share of the parts' internal
    modes, which node twists do not show. ``remarks``: omitted free motions.
    """

    configurations: Configurations
    frequencies: Array
    error: Array
    shapes: dict[str, Array]
    energy: dict[str, Array]
    internal: Array
    remarks: tuple[str, ...]

    @property
    def tool(self) -> Array:
        """Twist (n, 6, c) of the tool at M in base axes."""
        return self.shapes[END]

    def to_xarray(self) -> xr.Dataset:
        """Return frequencies, bounds, tool shape and energies by pose, mode, twist and element."""
        variables: Variables = {
            "frequency": (("pose", "mode"), self.frequencies, "Hz"),
            "error": (("pose", "mode"), self.error, "Hz"),
            "tool": (("pose", "twist", "mode"), self.tool, "m/√kg, rad/√kg"),
            "share": (
                ("element", "pose", "mode"),
                np.array(list(self.energy.values())),
                "1",
            ),
        }
        modes = range(1, self.frequencies.shape[1] + 1)
        return make_dataset(
            self.configurations, variables, element=list(self.energy), mode=modes
        )


@in_one_thread
def modes(
    mechanism: Mechanism, poses: Poses, count: int = 6, *, drives: Drives = "held"
) -> Modes:
    """Compute the lowest modes at tool poses (n, k) or configurations: bounds, shapes, energies.

    Parameters
    ----------
    mechanism
        Rigid bodies have masses and inertias, elastic ones a mass or ``dynamics``. Massless parts
        follow statically.
    poses
        Tool poses (n, k) in m and rad, or configurations.
    count
        Number of modes, including free motions of tool or drives at 0 Hz.
    drives
        Drives are springs ("held") or move freely ("free").

    Returns
    -------
    Modes
        Ascending frequencies (n, count) in Hz with bounds, shapes and energy; NaN without a mode.

    Raises
    ------
    InputError
        If poses have another shape, the count is below 1, or a named massless body moves freely.

    References
    ----------
    K.-J. Bathe, Finite Element Procedures, 2nd ed., 2014, ch. 11 (subspace iteration, shifting).

    Examples
    --------
    >>> import stiffscope as ss
    >>> machine = ss.assemble(ss.load_robot("biglide"), "published")
    >>> ss.modes(machine, [[0, 0, 0.34748]], 3).frequencies.round(1)  # Hz
    array([[ 58.8, 138. , 143.6]])
    """
    configurations = _configure(mechanism, poses, count)
    n = len(configurations)
    empty: Array = np.full((n, count), np.nan)
    out = Modes(configurations, empty, empty.copy(), {}, {}, empty.copy(), ())
    remarks: dict[str, None] = {}
    for part, some in _solve_chunks(mechanism, configurations, count, drives, remarks):
        c = part.squares.shape[1]
        out.frequencies[some, :c] = part.frequencies
        out.error[some, :c] = part.error
        out.internal[some, :c] = part.internal
        for into, each in ((out.shapes, part.shapes), (out.energy, part.energy)):
            for name, values in each.items():
                whole = into.setdefault(
                    name, np.full((n, *values.shape[1:-1], count), np.nan)
                )
                whole[some, ..., :c] = values
    return replace(out, remarks=tuple(remarks))


@in_one_thread
def frequencies(
    mechanism: Mechanism, poses: Poses, count: int = 6, *, drives: Drives = "held"
) -> Array:
    """Return only the natural frequencies (n, c) of ``modes`` in Hz, for maps and forward models.

    Parameters
    ----------
    mechanism, poses, count, drives
        As for ``modes``.
    """
    configurations = _configure(mechanism, poses, count)
    out = np.full((len(configurations), count), np.nan)
    for part, some in _solve_chunks(mechanism, configurations, count, drives, {}):
        out[some, : part.squares.shape[1]] = part.frequencies
    return out


@in_one_thread
def strain_products(
    mechanism: Mechanism, poses: Poses, count: int = 6, *, drives: Drives = "held"
) -> dict[str, Array]:
    """Return ``E_kl = φ_kᵀ K_e φ_l`` (n, c, c) of each element e in the modes of `modes`, (rad/s)².

    They sum up to ω_k² on the diagonal, and tell how a mode's shape and frequency change with the
    stiffness of an element; NaN where there is no mode.

    Parameters
    ----------
    mechanism, poses, count, drives
        As for ``modes``.

    References
    ----------
    R. L. Fox, M. P. Kapoor, Rates of change of eigenvalues and eigenvectors, AIAA Journal 6, 1968.
    """
    configurations = _configure(mechanism, poses, count)
    out: dict[str, Array] = {}
    for part, some in _solve_chunks(mechanism, configurations, count, drives, {}):
        c = part.squares.shape[1]
        for name, rows in part.pencil.system.strains.items():
            whole = out.setdefault(
                name, np.full((len(configurations), count, count), np.nan)
            )
            strains = [row.apply_to(part.vectors) for row in rows]
            whole[some, :c, :c] = sum(
                (strain.mT @ strain for strain in strains), np.zeros((1, c, c))
            )
    return out


def _configure(mechanism: Mechanism, poses: Poses, count: object) -> Configurations:
    if not (isinstance(count, int | np.integer) and count >= 1):
        raise InputError(
            f"count: expected at least 1 mode, a whole number, got {count!r}"
        )
    return configure(mechanism, poses)


@dataclass(eq=False)
class _Part:
    """Modes of a pencil: ``squares`` ω² (n, c), and ``vectors`` (n, size, c) of modal mass 1 kg."""

    pencil: Pencil
    squares: Array
    vectors: Array

    @property
    def frequencies(self) -> Array:
        """Frequencies (n, c), Hz."""
        return np.sqrt(self.squares) / (2.0 * np.pi)

    @cached_property
    def shapes(self) -> dict[str, Array]:
        """Node twists (n, 6, c)."""
        twists = self.pencil.system.twists
        return {
            node: twists[node].apply_to(self.vectors)
            for node in twists
            if node != GROUND
        }

    @cached_property
    def energy(self) -> dict[str, Array]:
        """Share (n, c) of each element in the strain energy; zero for a free motion."""
        return {
            name: self._share(rows) for name, rows in self.pencil.system.strains.items()
        }

    @cached_property
    def internal(self) -> Array:
        """Share (n, c) of the parts' internal modes in the strain energy."""
        bodies = [
            b.name for b in self.pencil.system.mechanism.bodies if b.elastic is not None
        ]
        inner = [
            rows[1:]
            for name, rows in self.pencil.system.strains.items()
            if name in bodies
        ]
        return sum(map(self._share, inner), np.zeros(self.squares.shape))

    def _share(self, rows: Iterable[Rows]) -> Array:
        return sum_squares(rows, self.vectors) / np.where(
            self.squares > 0.0, self.squares, np.inf
        )

    @cached_property
    def error(self) -> Array:
        """Bounds (n, c) in Hz, from those of elastic bodies' compliances and internal modes.

        ``δω² = -wᵀ δC w + δλ q²`` with w the wrench on a body, λ the square of its internal mode
        and q the motion of that mode. Modes closer than their bounds mix; the bounds of their mixed
        terms are added.
        """
        mixed: Array = np.zeros((*self.squares.shape, self.squares.shape[1]))
        system = self.pencil.system
        for body in system.mechanism.bodies:
            if body.elastic is None:
                continue
            if body.elastic.error is not None and body.name in system.springs:
                strained = system.strains[body.name][0].apply_to(self.vectors)
                carried = np.abs(system.springs[body.name] @ strained)
                mixed = mixed + carried.mT @ body.elastic.error @ carried
            inner = body.elastic.dynamics
            if inner is not None and inner.error is not None and len(inner.squares):
                strained = np.abs(system.strains[body.name][-1].apply_to(self.vectors))
                mixed = mixed + strained.mT @ (
                    (inner.error / inner.squares)[:, None] * strained
                )
        diagonal = np.einsum("nii->ni", mixed)
        apart = np.abs(self.squares[:, :, None] - self.squares[:, None])
        bound = np.where(
            apart <= diagonal[:, :, None] + diagonal[:, None], mixed, 0.0
        ).sum(axis=2)
        lowest = np.sqrt(np.maximum(self.squares - bound, 0.0)) / (
            2.0 * np.pi
        )  # the larger side
        return np.where(self.squares > 0.0, self.frequencies - lowest, 0.0)


def _solve_chunks(
    mechanism: Mechanism,
    configurations: Configurations,
    count: int,
    drives: Drives,
    remarks: dict[str, None],
) -> Iterator[_Solved]:
    """Yield the modes of all reachable poses in chunks; add ``remarks`` on what is left out."""
    reached = np.flatnonzero(configurations.valid)
    most = 0
    massless = False
    for start in range(0, len(reached), _CHUNK):
        chunk = reached[start : start + _CHUNK]
        for pencil, some in form_pencils(mechanism, configurations[chunk], drives):
            idle = _check_empty(pencil)
            for solved, which in _solve(pencil, count):
                massless = massless or solved.squares.shape[1] < len(pencil.scale)
                part, more = _drop_idle(solved, count)
                idle = idle or more
                most = max(most, part.squares.shape[1])
                yield part, chunk[some[which]]
            if idle and not remarks:
                remarks[_idle_text(mechanism, configurations, int(chunk[some[0]]))] = (
                    None
                )
    if reached.size and most < count:
        _say_few(mechanism, most, count, remarks, massless=massless)


def _check_empty(pencil: Pencil) -> bool:
    """Return whether a massless idle motion exists. InputError if it moves tool or drives."""
    empty = pencil.empty_motions
    if not empty.shape[1]:
        return False
    system = pencil.system.some(np.array([0]))
    vectors = (pencil.basis[0] @ (pencil.scale[:, None] * empty))[None]
    vectors = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    _, values, turned = np.linalg.svd(_move_tool_and_drives(system, vectors)[0])
    seen = turned[: (values > _IDLE).sum()].T
    if seen.shape[1]:
        free = vectors @ seen
        bodies = system.mechanism.bodies
        size = {
            b.name: np.abs(system.twists[b.nodes[-1]].apply_to(free)).max()
            for b in bodies
        }
        least = _IDLE * max(size.values())
        moving = list_names(
            [spell_name("bodies", name) for name in size if size[name] > least]
        )
        raise InputError(
            f"{moving}: expected a mass and inertia to move freely, got none"
        )
    return True


def _move_tool_and_drives(system: Coordinates, vectors: Array) -> Array:
    """Return the motion (n, 6 + drives, c) of tool and free drives, in relative lengths."""
    tool = (
        system.twists[END].apply_to(vectors)
        / np.repeat([system.length, 1.0], 3)[:, None]
    )
    return np.concatenate([tool, *(r.apply_to(vectors) for r in system.rates)], axis=1)


def _drop_idle(part: _Part, count: int) -> tuple[_Part, bool]:
    """Remove free motions that move neither tool nor drives; return whether there were any."""
    free = (part.squares == 0.0).sum(axis=1)
    if not free.any():
        return _Part(
            part.pencil, part.squares[:, :count], part.vectors[..., :count]
        ), False
    squares = np.full_like(part.squares, np.nan)
    vectors = np.full_like(part.vectors, np.nan)
    most = 0
    idle = False
    useful = _move_tool_and_drives(part.pencil.system, part.vectors)
    for k, zeros in enumerate(free):
        _, values, turned = np.linalg.svd(useful[k, :, :zeros])
        moving = int((values > _IDLE * np.abs(useful[k]).max()).sum())
        all_of = [
            part.vectors[k, :, :zeros] @ turned[:moving].T,
            part.vectors[k, :, zeros:],
        ]
        c = moving + part.squares.shape[1] - zeros
        squares[k, :c] = np.concatenate([np.zeros(moving), part.squares[k, zeros:]])
        vectors[k, :, :c] = np.hstack(all_of)
        most = max(most, c)
        idle = idle or moving < zeros
    most = min(most, count)
    return _Part(part.pencil, squares[:, :most], vectors[..., :most]), idle


def _idle_text(mechanism: Mechanism, configurations: Configurations, index: int) -> str:
    """Describe idle motions by name."""
    known = "; ".join(map(str, mobility(mechanism, configurations, index).idle))
    return f"left out, as without stiffness: {known or 'a free motion'}"


def _say_few(
    mechanism: Mechanism,
    most: int,
    count: int,
    remarks: dict[str, None],
    *,
    massless: bool,
) -> None:
    """Add a remark on why there are fewer modes than requested. InputError if there is none."""
    few = f"{say_count(most, 'mode')}, not {count}: all else is rigid"
    if most and not massless:
        remarks[few] = None
        return
    lacking: dict[str, list[str]] = {"mass": [], "inertia": []}
    for b in mechanism.bodies:
        if b.inertia is None and (b.elastic is None or b.elastic.dynamics is None):
            lacking["inertia" if b.mass else "mass"].append(
                spell_name("bodies", b.name)
            )
    if most == 0:
        bare = list_names(lacking["mass"] or ["bodies"])
        raise InputError(f"{bare}: expected a mass on a body that can move, got none")
    why = "; ".join(
        f"without {what}: {list_names(who)}" for what, who in lacking.items() if who
    )
    remarks[f"{few} or has no inertia{why and f' ({why})'}"] = None


def _solve(pencil: Pencil, count: int) -> Iterator[_Solved]:
    """Yield the modes of a pencil, at least ``count`` besides free ones, by groups of poses."""
    n = len(pencil.stiffness)
    everything = np.arange(n)
    if n <= _FEW or len(pencil.scale) <= 2 * (count + _GUARDS):
        yield from _solve_densely(pencil, everything)
        return
    first = pencil.some(everything[:1])
    (start, _), *_ = _solve_densely(first, everything[:1])
    free = int((start.squares[0] == 0.0).sum())
    matrix = pencil.regular()
    if not _find_definite(matrix).all():
        for k in everything:
            one = everything[k : k + 1]
            yield from _solve_densely(pencil.some(one), one)
        return
    wanted = min(free + count, start.squares.shape[1])
    back = start.pencil.basis[0] * pencil.scale
    inverse: Array = np.asarray(np.linalg.pinv(back))  # pyright: ignore[reportUnknownArgumentType]
    begin = inverse @ start.vectors[0, :, : wanted + _GUARDS // 2]
    vectors, good = _iterate_subspace(pencil, matrix, begin, wanted)
    if good.any():
        solved = everything[good]
        yield (
            _normalize(
                pencil if good.all() else pencil.some(solved), vectors[good], pencil
            ),
            solved,
        )
    if not good.all():
        yield from _solve_densely(pencil.some(everything[~good]), everything[~good])


def _iterate_subspace(
    pencil: Pencil, matrix: Array, begin: Array, wanted: int
) -> tuple[Array, NDArray[np.bool_]]:
    """Iterate a subspace to the lowest modes (n, d, wanted), scaled units; return convergence."""
    n = len(matrix)
    d = matrix.shape[-1]
    mass = pencil.mass * np.outer(pencil.scale, pencil.scale)
    step = np.linalg.inv(matrix) @ mass
    chance = np.random.default_rng(0).normal(
        size=(d, wanted + _GUARDS - begin.shape[1])
    )
    x = np.broadcast_to(np.hstack([begin, chance]), (n, d, wanted + _GUARDS))
    now: Array = np.zeros((n, wanted))
    done: NDArray[np.bool_] = np.zeros(n, dtype=bool)
    for _ in range(_ROUNDS):
        for _ in range(_POWERS):
            x = step @ x
        x = x / np.linalg.norm(x, axis=1, keepdims=True).clip(min=1e-300)
        half = half_inverse(x.mT @ matrix @ x, 1e-13)
        values, turned = np.linalg.eigh(half @ (x.mT @ mass @ x) @ half.mT)
        x = x @ (half.mT @ turned[..., ::-1])
        before = now
        now = values[:, ::-1][:, :wanted]
        done = np.all(
            (np.abs(now - before) <= _CONVERGED * now[:, :1]) & (now > 0.0), axis=1
        )
        if done.all():
            break
    return x[..., :wanted], done


def _find_definite(matrix: Array) -> NDArray[np.bool_]:
    """Return which (n,) matrices (n, d, d) are positive definite beyond rounding."""
    try:
        lower: Array = np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        return np.zeros(len(matrix), dtype=bool)
    pivots = np.square(np.einsum("nii->ni", lower))
    return (pivots > NOTHING * np.einsum("nii->ni", matrix)).all(axis=1)


def _solve_densely(pencil: Pencil, index: NDArray[np.intp]) -> Iterator[_Solved]:
    """Yield all modes with inertia, pose by pose."""
    for k in range(len(index)):
        one = pencil.some(np.array([k]))
        values, vectors = one.all_vectors()
        inert = values > NOTHING * values.max(initial=1e-300)
        yield _normalize(one, vectors[None][..., inert], one), index[k : k + 1]


def _normalize(pencil: Pencil, vectors: Array, scaled: Pencil) -> _Part:
    """Normalize vectors (n, d, c) in scaled units; frequencies follow from Rayleigh's quotient."""
    full = pencil.basis @ (scaled.scale[:, None] * vectors)
    system = pencil.system
    full = full / np.sqrt(sum_squares(system.inertias, full))[:, None]
    squares = sum_squares(system.strain_rows, full)
    squares = np.where(squares > _FREE * scaled.shift, squares, 0.0)
    order = np.argsort(squares, axis=1, kind="stable")
    squares = np.take_along_axis(squares, order, axis=1)
    full = np.take_along_axis(full, order[:, None], axis=2)
    moved = system.twists[END].apply_to(full)
    size = np.abs(moved) * np.repeat([1.0, system.length], 3)[:, None]
    largest = np.take_along_axis(moved, size.argmax(axis=1)[:, None], axis=1)
    return _Part(pencil, squares, full * np.where(largest < 0.0, -1.0, 1.0))
