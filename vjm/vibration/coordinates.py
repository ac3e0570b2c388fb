"""Coordinates of a vibrating mechanism, with its strain and kinetic energy, batched over poses.

Elements that are rigid in some direction form a forest: their coordinates (unit springs and free
motions, ``t = F y + N q``) place every node from the root of its tree, which is the ground or has
its own twist. Elements that close loops in a tree add their coordinates and six constraints each.
Others are springs between two nodes. Elastic bodies with dynamics add modal coordinates.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import reduce
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from scipy.cluster.hierarchy import DisjointSet  # pyright: ignore[reportMissingTypeStubs]

from stiffscope.errors import require
from stiffscope.vjm.model.checks import GROUND
from stiffscope.vjm.model.dynamics import factor_semidefinite
from stiffscope.vjm.model.screws import Frame, shift
from stiffscope.vjm.network.network import list_elements, list_nodes
from stiffscope.vjm.network.order import stack_columns, stack_rows

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    from stiffscope.vjm.model.bodies import Body
    from stiffscope.vjm.model.mechanism import Mechanism
    from stiffscope.vjm.model.screws import Array
    from stiffscope.vjm.network.network import Element, Places

_SPANNING = (
    1e9  # scaled condition number up to which an element's directions are independent
)


@dataclass(frozen=True, eq=False)
class Rows:
    """Linear functions: ``matrix`` (n or 1, r, c) times the coordinates in ``columns`` (c,)."""

    columns: NDArray[np.intp]
    matrix: Array

    def over(self, columns: NDArray[np.intp]) -> Array:
        """Return the matrix (n or 1, r, c) over more columns (c,), which include its own."""
        out = np.zeros((*self.matrix.shape[:2], len(columns)))
        out[..., np.searchsorted(columns, self.columns)] = self.matrix
        return out

    def plus(self, other: Rows, times: float = 1.0) -> Rows:
        """Return the sum with ``times`` other rows."""
        columns = np.union1d(self.columns, other.columns)
        return Rows(columns, self.over(columns) + times * other.over(columns))

    def below(self, other: Rows) -> Rows:
        """Stack both, one below the other."""
        columns = np.union1d(self.columns, other.columns)
        return Rows(columns, stack_rows([self.over(columns), other.over(columns)]))

    def after(self, matrix: Array) -> Rows:
        """Multiply by a matrix (n or 1, k, r) from the left."""
        return Rows(self.columns, matrix @ self.matrix)

    def apply_to(self, vectors: Array) -> Array:
        """Return values (n, r, c) for vectors (n, size, c) of all coordinates."""
        return self.matrix @ vectors[:, self.columns]


@dataclass(eq=False)
class Coordinates:
    """``size`` coordinates and linear functions of them.

    ``twists`` of every node at M in base axes. ``strains`` by element: half their squares is strain
    energy, J. ``springs`` by element: F⁺ᵀ (6, r), which maps its r spring strains to its wrench.
    ``inertias``: half the squares of their rates is kinetic energy; ``carriers`` of each: by node,
    the wrench (n or 1, 6, r) at M in base axes per unit of its r rows. ``rates`` of the driven
    motions. ``constraints`` (6 rows each) of the loops, relative to ``length``.
    """

    mechanism: Mechanism
    where: Places
    length: float
    size: int = 0
    twists: dict[str, Rows] = field(default_factory=dict[Any, Any])
    strains: dict[str, list[Rows]] = field(default_factory=dict[Any, Any])
    springs: dict[str, Array] = field(default_factory=dict[Any, Any])
    inertias: list[Rows] = field(default_factory=list[Any])
    carriers: list[dict[str, Array]] = field(default_factory=list[Any])
    rates: list[Rows] = field(default_factory=list[Any])
    constraints: list[Rows] = field(default_factory=list[Any])

    def more(self, count: int) -> NDArray[np.intp]:
        """Add coordinates; return their columns."""
        self.size += count
        return np.arange(self.size - count, self.size)

    def gram(self, rows: Iterable[Rows]) -> Array:
        """Return the sum of the squares of rows as a matrix (n, size, size)."""
        out = np.zeros((len(self.where.tool), self.size, self.size))
        for r in rows:
            out[:, r.columns[:, None], r.columns] += r.matrix.mT @ r.matrix
        return out

    @property
    def strain_rows(self) -> list[Rows]:
        """Strains of all elements."""
        return [r for rows in self.strains.values() for r in rows]

    @property
    def stiffness(self) -> Array:
        """Stiffness (n, size, size), before the constraints."""
        return self.gram(self.strain_rows)

    @property
    def mass(self) -> Array:
        """Mass (n, size, size), before the constraints."""
        return self.gram(self.inertias)

    def add_inertia(self, ends: dict[str, Array], factor: Array) -> Rows:
        """Add the kinetic energy of nodes, half the squares of rates of r rows, and return these.

        Parameters
        ----------
        ends
            By node, its twist (n or 1, 6, 6) at a point in axes of its own, per twist at M.
        factor
            Rows (r, 6 k), or wider for coordinates that follow, of the k twists.
        """
        parts = np.split(factor[:, : 6 * len(ends)], len(ends), axis=1)
        carried: dict[str, Array] = {
            node: (part @ back).mT
            for (node, back), part in zip(ends.items(), parts, strict=True)
        }
        moved = [self.twists[node].after(back.mT) for node, back in carried.items()]
        rows = reduce(Rows.plus, moved)
        self.carriers.append(carried)
        self.inertias.append(rows)
        return rows

    def some(self, index: NDArray[np.intp]) -> Coordinates:
        """Return the coordinates at some of the poses."""
        keys = ("twists", "strains", "inertias", "carriers", "rates", "constraints")
        picked = {key: _pick_rows(getattr(self, key), index) for key in keys}
        return replace(self, where=self.where.some(index), **picked)

    def jacobian(self) -> Array:
        """Return all constraints (n, 6 m, size)."""
        out = np.zeros((len(self.where.tool), 6 * len(self.constraints), self.size))
        for k, r in enumerate(self.constraints):
            out[:, 6 * k : 6 * k + 6, r.columns] = r.matrix
        return out


def sum_squares(rows: Iterable[Rows], vectors: Array) -> Array:
    """Return the sums of squares (n, c) of rows for vectors (n, size, c): twice an energy."""
    nothing = np.zeros((len(vectors), vectors.shape[2]))
    return sum((np.square(r.apply_to(vectors)).sum(axis=1) for r in rows), nothing)


@dataclass(frozen=True, eq=False)
class PointMass:
    """A mass without extent, in kg, fixed to a node at the home point ``at`` (3,), m."""

    node: str
    at: Array
    mass: float


def add_point_mass(system: Coordinates, point: PointMass) -> None:
    """Add the kinetic energy of a point mass. InputError if its node is unknown."""
    _check_node(system, point.node)
    where = system.where
    at = np.asarray(point.at, dtype=float)
    velocity = shift(where.point(point.node, at) - where.tool)
    system.add_inertia({point.node: velocity}, np.sqrt(point.mass) * np.eye(6)[:3])


def _check_node(system: Coordinates, node: str) -> None:
    require(
        node in system.twists,
        "",
        f"a body or an end of one, {', '.join(system.twists)}",
        f"{node!r}",
    )


def _pick_rows(rows: Any, index: NDArray[np.intp]) -> Any:
    """Select poses in rows and containers of rows."""
    if isinstance(rows, Rows):
        return (
            rows if len(rows.matrix) == 1 else replace(rows, matrix=rows.matrix[index])
        )
    if isinstance(rows, np.ndarray):
        array = cast("Array", rows)
        return array if len(array) == 1 else array[index]
    if isinstance(rows, list):
        return [_pick_rows(row, index) for row in cast("list[Any]", rows)]
    return {
        key: _pick_rows(each, index)
        for key, each in cast("dict[str, Any]", rows).items()
    }


def form_coordinates(
    mechanism: Mechanism, where: Places, length: float, drives: Iterable[str]
) -> Coordinates:
    """Form the coordinates of a mechanism whose bodies are not bent.

    Parameters
    ----------
    mechanism
        Mechanism in which joints with a drive have its spring, and those without move freely.
    where
        Places of the nodes at n configurations.
    length
        Characteristic length in m that scales rotations to translations.
    drives
        Joints without a drive whose rates are included: free drives.
    """
    out = Coordinates(mechanism, where, length)
    unit = np.repeat([1.0 / length, 1.0], 3)
    elements = list_elements(mechanism)
    inverses = {e.name: _invert_columns(e, unit) for e in elements}
    spanning = {
        name: inverse for name, inverse in inverses.items() if inverse is not None
    }
    tree, chords = _grow_forest([e for e in elements if e.name not in spanning])
    rows_of: dict[str, Rows] = {}  # by element, and by body for shared coordinates
    _place_nodes(out, tree, rows_of)
    for e in chords:
        rows_of[e.name] = _own_rows(out, e, rows_of)
        gap = _relate_ends(out, e).plus(
            rows_of[e.name].after(stack_columns(where.columns(e))), -1.0
        )
        out.constraints.append(gap.after(np.diag(unit)))
    for e in elements:
        r = e.factor.shape[1]
        if e.name in spanning:
            back = spanning[e.name] @ where.frame(e).inverse_adjoint()
            rows_of[e.name] = _relate_ends(out, e).after(back)
            out.springs[e.name] = spanning[e.name][:r].T
        elif r and not e.group:
            out.springs[e.name] = np.linalg.pinv(e.factor).T
        if e.group and e.group not in out.springs:
            whole = np.vstack(
                [other.factor for other in elements if other.group == e.group]
            )
            out.springs[e.group], out.strains[e.group] = (
                np.linalg.pinv(whole).T,
                [rows_of[e.group]],
            )
        elif r and not e.group:
            strain = rows_of[e.name]
            if e.name in spanning:
                out.strains[e.name] = [Rows(strain.columns, strain.matrix[:, :r])]
            else:
                out.strains[e.name] = [Rows(strain.columns[:r], np.eye(r)[None])]
        if e.joint is not None and e.name in drives:
            k = r + (e.joint.driven or 0)
            out.rates.append(
                Rows(rows_of[e.name].columns, rows_of[e.name].matrix[:, k : k + 1])
            )
    for body in mechanism.bodies:
        _add_inertia(out, body)
    return out


def _relate_ends(out: Coordinates, e: Element) -> Rows:
    """Return the twist of an element's second node relative to its first, at M in base axes."""
    return out.twists[e.second].plus(out.twists[e.first], -1.0)


def _invert_columns(e: Element, unit: Array) -> Array | None:
    """Return the inverse (6, 6) of ``[F N]``; None if not square and regular at every pose."""
    both = np.hstack([e.factor, e.free])
    if e.group or (e.joint is not None and e.joint.cross) or both.shape[1] != 6:
        return None
    scaled = both * unit[:, None]
    scaled = scaled / np.linalg.norm(scaled, axis=0)
    return np.linalg.inv(both) if np.linalg.cond(scaled) < _SPANNING else None


def _grow_forest(elements: list[Element]) -> tuple[list[Element], list[Element]]:
    """Return a spanning forest, elements with few coordinates first, and those that close loops."""
    joined: Any = DisjointSet({node for e in elements for node in (e.first, e.second)})
    tree: list[Element] = []
    chords: list[Element] = []
    for e in sorted(elements, key=lambda e: e.factor.shape[1] + e.free.shape[1]):
        (tree if joined.merge(e.first, e.second) else chords).append(e)
    return tree, chords


def _own_rows(out: Coordinates, e: Element, rows_of: dict[str, Rows]) -> Rows:
    """Return an element's coordinates, springs then free motions; its body's if shared."""
    if e.group in rows_of:
        return rows_of[e.group]
    count = e.factor.shape[1] + e.free.shape[1]
    rows = Rows(out.more(count), np.eye(count)[None])
    if e.group:
        rows_of[e.group] = rows
    return rows


def _place_nodes(
    out: Coordinates, tree: list[Element], rows_of: dict[str, Rows]
) -> None:
    """Set the twists of all nodes, outward from the ground and from free roots."""
    for start in list_nodes(out.mechanism):
        if start in out.twists:
            continue
        columns = out.more(0 if start == GROUND else 6)
        out.twists[start] = Rows(columns, np.eye(6)[None, :, : len(columns)])
        queue = [start]
        for here in queue:
            for e in tree:
                there = e.second if e.first == here else e.first
                if here not in {e.first, e.second} or there in out.twists:
                    continue
                rows_of[e.name] = _own_rows(out, e, rows_of)
                step = rows_of[e.name].after(stack_columns(out.where.columns(e)))
                sign = 1.0 if there == e.second else -1.0
                out.twists[there] = out.twists[here].plus(step, sign)
                queue.append(there)


def _add_inertia(out: Coordinates, body: Body) -> None:
    where = out.where
    elastic = body.elastic

    def find_back(node: str, home: Array, axes: Array) -> Array:
        """Return a node's twist (n or 1, 6, 6) at a point, in axes fixed to it, per twist at M."""
        frame = Frame(where.rotation[node] @ axes, where.point(node, home) - where.tool)
        return frame.inverse_adjoint()

    if elastic is None:
        centre = np.zeros(3) if body.centre is None else body.centre
        whole = np.zeros((6, 6))
        whole[:3, :3] = body.mass * np.eye(3)
        if body.inertia is not None:
            whole[3:, 3:] = 0.5 * (body.inertia + body.inertia.T)
        if whole.any():
            back = find_back(body.name, centre, np.eye(3))
            out.add_inertia({body.name: back}, factor_semidefinite(whole, body.name))
        return
    places = zip(body.nodes, elastic.places, strict=True)
    ends = {node: find_back(node, at, elastic.axes) for node, at in places}
    if elastic.dynamics is None:
        if body.mass:
            share = np.sqrt(body.mass / len(ends)) * np.eye(6)[:3]
            for node, back in ends.items():
                out.add_inertia({node: back}, share)
        return
    squares = elastic.dynamics.squares
    factor = elastic.dynamics.factor
    rows = out.add_inertia(ends, factor)
    if len(squares):
        modal = Rows(out.more(len(squares)), np.eye(len(squares))[None])
        inner = modal.after(factor[:, 6 * len(ends) :])
        out.inertias[-1] = rows.plus(inner)
        out.strains.setdefault(body.name, []).append(
            modal.after(np.diag(np.sqrt(squares)))
        )
