"""The elastic network of a mechanism: its nodes, elements and their places.

Each joint and elastic body, the base and the tool's grip is an element between two nodes. The twist
of its second node relative to its first is ``t = C w + N q + t₀`` with ``Nᵀ w = 0``, in the
element's axes at its point. A body of more ends has an element from the first end to each other,
``t_i = F_i y + t₀``; they share the coordinates ``y = Σ F_iᵀ w_i``.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.vjm.kinematics.linkage import rotation_vector
from stiffscope.vjm.model.checks import BASE, GROUND, TOOL
from stiffscope.vjm.model.screws import Frame, rotation, rotation_of, shift

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from stiffscope.vjm.kinematics.configurations import Configurations
    from stiffscope.vjm.kinematics.linkage import Linkage
    from stiffscope.vjm.model.bodies import Elastic
    from stiffscope.vjm.model.dynamics import Masses
    from stiffscope.vjm.model.joints import Joint
    from stiffscope.vjm.model.mechanism import Change, Mechanism
    from stiffscope.vjm.model.screws import Array

FOOT = "<base>"  # node on the base
END = "<tool>"  # node at M
_NOTHING = np.zeros((1, 6, 0))
_SEVERAL = 5  # elements from which it is faster to find their adjoints at once


def _none() -> Array:
    return np.zeros((6, 0))


@dataclass(frozen=True, eq=False)
class Element:
    """``factor`` F (6, r) of the compliance F Fᵀ, ``free`` directions N (6, k), ``offset`` t₀ (6,).

    The last ``sprung`` columns of F are motions of a universal or spherical joint with springs. At
    home, ``axes`` (3, 3) are fixed to the node ``carrier`` and the point ``at`` (3,) to ``bearer``.
    ``group``: the body whose elements share coordinates; empty if it has its own.
    """

    name: str
    first: str
    second: str
    axes: Array
    at: Array
    carrier: str
    factor: Array = field(default_factory=_none)
    free: Array = field(default_factory=_none)
    offset: Array | None = None
    joint: Joint | None = None
    group: str = ""
    sprung: int = 0
    drawn: Joint | None = None
    """The nominal joint, if it is displaced."""

    @property
    def bearer(self) -> str:
        """The node to which the point is fixed."""
        if self.joint is not None and self.joint.is_on_first:
            return self.first
        return self.second

    @property
    def is_mirrored(self) -> bool:
        """Whether the second body is the rail: motions are those of the first against it."""
        return self.carrier == self.second

    @property
    def compliance(self) -> Array:
        """Compliance C (6, 6), symmetric, possibly singular or zero."""
        return self.factor @ self.factor.T

    @property
    def is_ordered(self) -> bool:
        """Whether its rotations succeed each other; a ball joint rotates along one geodesic."""
        return self.joint is None or not self.joint.type.is_ball

    @property
    def is_split(self) -> bool:
        """Whether rotations of its spring, in three directions, and its joint's are successive."""
        moves = self.sprung + self.free.shape[1] > 0
        return moves and self.is_ordered and self.factor.shape[1] > self.sprung

    @property
    def is_displaced(self) -> bool:
        """True if its unloaded ends are not in their nominal places."""
        return self.offset is not None or self.drawn is not None


@dataclass(frozen=True, eq=False)
class Places:
    """Displacements of nodes, ``x = R x_home + p``, and tool point (n, 3) at n configurations."""

    rotation: dict[str, Array]
    position: dict[str, Array]
    tool: Array
    rigid: bool = True
    """True if nothing is bent: nodes of a rigid link keep their places relative to each other."""

    known: dict[str, Array] = field(default_factory=dict[Any, Any], init=False)
    """Cached adjoints of elements."""
    seen: dict[str, tuple[Element, Array, Array]] = field(
        default_factory=dict[Any, Any], init=False
    )
    """Elements with their cached columns."""

    def some(self, mask: NDArray[np.bool_] | NDArray[np.intp]) -> Places:
        """Return the places at some of the configurations."""
        rotation, position = (
            {node: a[mask] if len(a) > 1 else a for node, a in nodes.items()}
            for nodes in (self.rotation, self.position)
        )
        return Places(rotation, position, self.tool[mask], self.rigid)

    def replace_some(self, mask: NDArray[np.bool_], others: Places) -> Places:
        """Return the places with those of ``others`` at some of the configurations."""

        def put(a: Array, b: Array) -> Array:
            out = np.array(np.broadcast_to(a, (len(mask), *a.shape[1:])))
            out[mask] = b
            return out

        rotation = {
            node: put(r, others.rotation[node]) for node, r in self.rotation.items()
        }
        position = {
            node: put(p, others.position[node]) for node, p in self.position.items()
        }
        return Places(rotation, position, put(self.tool, others.tool), self.rigid)

    def frame(self, element: Element) -> Frame:
        """Return an element's frame relative to M: (n or 1, 3, 3) and (n or 1, 3)."""
        place = self.point(element.bearer, element.at) - self.tool
        return Frame(self.axes(element.carrier, element.axes), place)

    def axes(self, node: str, home: Array) -> Array:
        """Return axes (n or 1, 3, 3), as columns, that are fixed to a node's body."""
        return (self.rotation[node].reshape(-1, 3) @ home).reshape(
            -1, 3, 3
        )  # one product, not n

    def turn(self, element: Element, axes: Array) -> Array:
        """Rotation (n or 1, 3, 3) of an element's second node against its first, in given axes."""
        return self.axes(element.first, axes).mT @ self.axes(element.second, axes)

    def adjoint(self, element: Element) -> Array:
        """Return the twist transform (n or 1, 6, 6) of an element's frame to M in base axes."""
        if element.name not in self.known:
            self.known[element.name] = self.frame(element).adjoint()
        return self.known[element.name]

    def evaluate(self, elements: Sequence[Element]) -> None:
        """Find the adjoints of elements at once: for few poses call overhead dominates."""
        n = len(self.tool)
        new = [e for e in elements if e.name not in self.known]
        nodes = {node for e in new for node in (e.carrier, e.bearer)}
        if len(new) < _SEVERAL or any(len(self.rotation[node]) < n for node in nodes):
            return
        turns = {node: self.rotation[node] for node in nodes}
        axes = np.array([e.axes for e in new])
        at = np.array([e.at for e in new])
        rotation = np.array([turns[e.carrier] for e in new]) @ axes[:, None]
        ends = np.array([turns[e.bearer] for e in new]) @ at[:, None, :, None]
        place = ends[..., 0] + [self.position[e.bearer] for e in new] - self.tool
        self.known.update(
            zip((e.name for e in new), Frame(rotation, place).adjoint(), strict=True)
        )

    def columns(self, element: Element) -> tuple[Array, Array]:
        """Return factor (n or 1, 6, r) and free directions (n or 1, 6, k) at M in base axes."""
        known, factor, free = self.seen.get(element.name, (None, _NOTHING, _NOTHING))
        if (
            known is not element
        ):  # a robot of the same geometry has another element of this name
            factor = free = _NOTHING
            if element.factor.size:
                factor = self.adjoint(element) @ self.factor(element)
            if element.free.size:
                free = self.adjoint(element) @ free_directions(element, self)
            self.seen[element.name] = element, factor, free
        return factor, free

    def factor(self, element: Element) -> Array:
        """Return an element's compliance factor (n or 1, 6, r); bent bodies rotate by Rx, Ry, Rz.

        A spring's factor is along its joint's motions, for a rotated ball joint along geodesics.
        """
        if element.sprung and element.joint is not None:
            return self._spring_factor(element, element.joint)
        if self.rigid or element.joint is not None or not element.factor.shape[1]:
            return element.factor[None]
        axes = euler_axes(self.turn(element, element.axes))
        out = np.repeat(element.factor[None], len(axes), axis=0)
        out[:, 3:] = (axes.reshape(-1, 3) @ element.factor[3:]).reshape(
            len(axes), 3, -1
        )
        return out

    def _spring_factor(self, element: Element, joint: Joint) -> Array:
        if joint.cross:
            second = self.see_axis(element, joint.cross[1])
            out = np.repeat(element.factor[None], len(second), axis=0)
            out[:, 3:, -1] = second / np.sqrt(joint.resistance)
            return out
        if self.rigid:
            return element.factor[None]
        vector = rotation_vector(self.turn(element, element.axes))
        out = np.repeat(element.factor[None], len(vector), axis=0)
        out[:, 3:, -3:] = _soften_turned(vector) @ out[:, 3:, -3:]
        return out

    def see_axis(self, element: Element, axis: Array) -> Array:
        """Return an axis (3,) of an element's second node in the element's axes, (n or 1, 3)."""
        turned = (self.rotation[element.second].reshape(-1, 3) @ axis).reshape(-1, 3)
        return np.einsum("nji,nj->ni", self.axes(element.first, element.axes), turned)

    def point(self, node: str, home: Array) -> Array:
        """Return the base coordinates (n or 1, 3) of a point (3,) of a node's body."""
        return (self.rotation[node].reshape(-1, 3) @ home).reshape(
            -1, 3
        ) + self.position[node]

    def wrenches(self, node: str, home: Array) -> Array:
        """Wrenches (n or 1, 6, 6) at M for unit wrenches at a point of a node's body, base axes."""
        return shift(self.point(node, home) - self.tool).mT


def list_elements(mechanism: Mechanism) -> tuple[Element, ...]:
    """Return all elements of a mechanism."""
    origin = np.zeros(3)
    out = [_change(BASE, GROUND, FOOT, origin, mechanism.base)]
    for j in mechanism.joints:
        first, second = (
            FOOT if node == GROUND else node for node in (j.first, j.second)
        )
        out.append(_joint(j, first, second))
    for body in mechanism.bodies:
        if body.elastic is not None:
            out += _body(body.name, body.nodes, body.elastic)
    out.append(
        _change(TOOL, mechanism.tool.body, END, mechanism.tool.at, mechanism.grip)
    )
    return tuple(out)


def list_nodes(mechanism: Mechanism) -> tuple[str, ...]:
    """Return all nodes, the ground first and the tool last."""
    return (
        GROUND,
        FOOT,
        *(node for body in mechanism.bodies for node in body.nodes),
        END,
    )


def place_nodes(configurations: Configurations) -> Places:
    """Return the places of the unloaded mechanism's nodes; its links are rigid."""
    linkage = configurations.linkage
    link = map_links(linkage)
    known = {k: configurations.link_frame(linkage.frame[k]) for k in set(link.values())}
    rotation, position = (
        {node: known[k][i] for node, k in link.items()} for i in (0, 1)
    )
    return Places(rotation, position, configurations.tool[:, :3])


def map_links(linkage: Linkage) -> dict[str, int]:
    """Return the rigid link of every node of the network."""
    link = linkage.link_of
    return link | {FOOT: link[GROUND], END: link[linkage.mechanism.tool.body]}


def moves_with(element: Element, link: int, links: dict[str, int]) -> bool:
    """Return whether compliance and free directions of an element are constant in a link's axes.

    Parameters
    ----------
    element
        Element of the network.
    link
        Number of the rigid link, at one of the element's ends.
    links
        Number of the rigid link of each node.
    """
    joint = element.joint
    if joint is None or joint.kind == "fixed":
        return links[element.carrier] == link
    ends = {links[element.first], links[element.second]}
    if joint.cross or element.drawn is not None or link not in ends:
        return False
    c = joint.compliance
    if c is None or joint.kind not in {"revolute", "spherical"}:
        return c is None
    turn = np.kron(np.eye(2), rotation(np.eye(3)[0], 0.7))
    is_round = joint.kind == "revolute" and np.allclose(
        turn @ c @ turn.T, c, rtol=1e-12, atol=0.0
    )
    return links[element.first] == link or is_round


def _change(name: str, first: str, second: str, at: Array, change: Change) -> Element:
    factor = _none() if change.compliance is None else _factor(change.compliance)
    return Element(
        name, first, second, np.eye(3), at, first, factor, offset=change.offset
    )


def _body(name: str, nodes: tuple[str, ...], elastic: Elastic) -> Iterator[Element]:
    """Yield an element from the first end to each other; several share their coordinates."""
    factor = _factor(elastic.compliance)
    several = len(nodes) > 2
    for k, (node, at) in enumerate(zip(nodes[1:], elastic.places[1:], strict=True)):
        rows = slice(6 * k, 6 * k + 6)
        yield Element(
            node if several else name,
            nodes[0],
            node,
            elastic.axes,
            at,
            nodes[0],
            factor[rows],
            offset=None if elastic.offset is None else elastic.offset[rows],
            group=name if several and factor.shape[1] else "",
        )


def _joint(joint: Joint, first: str, second: str) -> Element:
    compliance = (
        np.zeros((6, 6)) if joint.compliance is None else joint.compliance.copy()
    )
    free: list[Array] = []
    sprung: list[Array] = []
    for k, (kind, direction) in enumerate(joint.motions):
        along = joint.axes.T @ direction
        screw = np.concatenate(
            [along, np.zeros(3)] if kind == "P" else [np.zeros(3), along]
        )
        screws = list(np.eye(6)[3:]) if kind == "S" else [screw]
        if not joint.resists(k):
            free += screws
        elif joint.type.driven is not None:
            compliance += np.outer(screw, screw) / joint.resistance
        else:
            sprung += [column / np.sqrt(joint.resistance) for column in screws]
    factor = np.hstack([_factor(compliance), _columns(sprung)])
    # a rail that slides through a bearing guides it along its own axes
    is_rail = joint.is_on_first and joint.type.is_steady
    out = Element(
        joint.name,
        first,
        second,
        joint.axes,
        joint.at,
        second if is_rail else first,
        factor,
        _columns(free),
        joint.offset,
        joint,
        sprung=len(sprung),
    )
    return (
        out if joint.misalignment is None else _mislay(out, joint, joint.misalignment)
    )


def _mislay(element: Element, drawn: Joint, misalignment: Array) -> Element:
    """Return a joint's element at the actual place of its axis."""
    away = np.kron(np.eye(2), drawn.axes) @ misalignment
    turn = rotation_of(away[None, 3:])[0]
    there = drawn.move_axis(turn, away[:3])
    return replace(
        element, axes=turn @ drawn.axes, at=there.at, joint=there, drawn=drawn
    )


def _columns(vectors: list[Array]) -> Array:
    return np.array(vectors).T if vectors else _none()


def _soften_turned(vector: Array) -> Array:
    """Return the gain (n, 3, 3) of a ball spring's factor, energy ``½ k φ²``, at rotation φ (n, 3).

    Along geodesics, the Hessian of φ² / 2 there is ``n nᵀ + (φ/2) cot(φ/2) (1 - n nᵀ)``.
    """
    angle = np.linalg.norm(vector, axis=1)[:, None, None]
    unit = vector[..., None] / np.where(angle > 0.0, angle, 1.0)
    half = np.maximum(0.5 * angle, 1e-9)
    along = unit @ unit.mT
    return np.sqrt(np.tan(half) / half) * (np.eye(3) - along) + along


def free_directions(element: Element, where: Places) -> Array:
    """Return free directions (n or 1, 6, k) in the element's axes."""
    joint = element.joint
    if joint is None or joint.type.is_steady or (where.rigid and not joint.cross):
        return element.free[None]
    axis = joint.cross[1] if joint.cross else joint.axis
    turn = np.flatnonzero(
        element.free[3:].any(axis=0)
    )  # its axis is on the second body
    if axis is None or not turn.size:
        return element.free[None]
    second = where.see_axis(element, axis)
    out = np.repeat(element.free[None], len(second), axis=0)
    out[:, 3:, turn[-1]] = second
    return out


def euler_axes(turn: Array) -> Array:
    """Return the axes (n, 3, 3), as columns, of successive small Rx, Ry, Rz at ``turn``."""
    first = np.arctan2(
        -turn[..., 1, 2], turn[..., 2, 2]
    )  # 0 where Ry is a quarter turn
    out = np.zeros(turn.shape)
    out[..., 0, 0] = 1.0
    out[..., 1, 1], out[..., 2, 1] = np.cos(first), np.sin(first)
    out[..., 2] = turn[..., 2]
    return out


def euler_angles(turn: Array) -> Array:
    """Return successive small rotations Rx, Ry, Rz (n, 3) in rad that give ``turn`` (n, 3, 3)."""
    a = np.arctan2(-turn[..., 1, 2], turn[..., 2, 2])
    c = np.arctan2(-turn[..., 0, 1], turn[..., 0, 0])
    return np.stack([a, np.arcsin(turn[..., 0, 2].clip(-1.0, 1.0)), c], axis=-1)


def _factor(compliance: Array) -> Array:
    """Return F (6m, r) of a compliance F Fᵀ of rank r, scaled so that units do not matter."""
    diagonal = np.sqrt(np.diagonal(compliance).clip(min=0.0))
    used = diagonal > 0.0
    if not used.any():
        return np.zeros((len(diagonal), 0))
    unit = compliance[np.ix_(used, used)] / np.outer(diagonal[used], diagonal[used])
    values, vectors = np.linalg.eigh(unit)
    keep = values > 1e-14 * values[-1]
    out = np.zeros((len(diagonal), int(keep.sum())))
    out[used] = diagonal[used, None] * (vectors[:, keep] * np.sqrt(values[keep]))
    return out


def lump_masses(mechanism: Mechanism, where: Places) -> dict[str, Masses]:
    """Masses of every node that has any, about M in base axes."""
    return {
        node: mass.place(where.rotation[node], where.position[node] - where.tool)
        for body in mechanism.bodies
        for node, mass in body.masses.items()
    }
