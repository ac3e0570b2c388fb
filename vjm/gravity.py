"""Stiffness of a robot that carries its own weight.

Two effects: the platform sags, and the tangent stiffness changes because the structure carries load. The exact
answer is the Hessian of the total potential energy at the loaded equilibrium; the literal one is the ``K_θ - K_G`` of
Eqs. (1) to (3), with K_G the Hessian of the work of the weights behind each spring.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property, partial, reduce
from operator import add
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.errors import InputError
from stiffscope.vjm.biglide import LINKS, SIDES
from stiffscope.vjm.elastic import Node, Parallel, Passive, Series, Spring, Weight, edited, leaves
from stiffscope.vjm.reduction import Stiff, assembled
from stiffscope.vjm.response import respond
from stiffscope.vjm.screws import Frame, rotation, rotation_of, skew

if TYPE_CHECKING:
    from stiffscope.vjm.biglide import Biglide
    from stiffscope.vjm.response import Element, Response
    from stiffscope.vjm.screws import Array

STANDARD = 9.81  # m/s²; the paper's weights follow from it


def load_hessian(force: Array, lever: Array) -> Array:
    """Hessian of the work of a force (..., 3) at a lever (..., 3) behind a spring with coordinates Tx Ty Tz Rx Ry Rz.

    ``H_ab = f_b r_a - (f·r) δ_ab`` for a ≤ b in the rotational block, symmetric, zero elsewhere; (..., 6, 6).
    """
    block = lever[..., :, None] * force[..., None, :]
    block = block - np.einsum("...i,...i", force, lever)[..., None, None] * np.eye(3)
    upper = np.triu(block)
    shape = block.shape[:-2]
    hessian = np.zeros((*shape, 6, 6))
    hessian[..., 3:, 3:] = upper + np.swapaxes(np.triu(block, 1), -1, -2)
    return hessian


def literal_tree(robot: Biglide, poses: Array, gravity: float = STANDARD) -> Node:
    """The robot with ``K_θ - K_G`` for ``K_θ``, as Eqs. (1) to (3) have it.

    Each link carries a sixth of the platform's weight at M; each slider half of it, and its three links' weights.
    """
    tree = robot.tree(poses)
    frames = _frames(tree)
    down = np.array([0.0, 0.0, gravity])
    for i in SIDES:
        slider = frames[f"limb{i}.slider"]
        hessian = _hessian_behind(slider, 0.5 * robot.platform_mass * down, np.zeros(3))
        for j in LINKS:
            name = f"limb{i}.link{j}"
            centre = frames[f"{name}.weight"].origin()
            hessian = hessian + _hessian_behind(slider, robot.link_mass * down, centre)
            share = _hessian_behind(frames[name], robot.platform_mass / 6.0 * down, np.zeros(3))
            tree = edited(tree, name, partial(_softened, hessian=share))
        tree = edited(tree, f"limb{i}.slider", partial(_softened, hessian=hessian))
    return tree


def exact_stiffness(tree: Node, gravity: float = STANDARD) -> Array:
    """Stiffness (..., 6, 6) at M in axes {O}: Hessian of the potential energy at the equilibrium under all weights,
    and under what misfits strain.

    The linear algebra is repeated on the robot as the weights have bent it; the second-order work of the loads and of
    the forces that close the loops is added (it is stationary in the internal motions, so theirs need no correction).
    """
    sagged = respond(tree, np.zeros((6, 1)), gravity=gravity, misfit=True)
    bent = assembled(_bent(tree, sagged), loads=True)
    if not isinstance(bent.form, Stiff):
        msg = "a robot without a parallel group: ask for its stiffness without gravity"
        raise InputError(msg)
    first = np.eye(7)[0]  # of the cases: weights and misfits; unit twists of the tool in the others
    unit = np.concatenate([np.zeros((*bent.form.stiffness.shape[:-1], 1)), bent.form.stiffness], axis=-1)
    loaded = respond(bent, unit, gravity=gravity * first, misfit=first)
    work = _SecondOrder(loaded.elements, np.array([0.0, 0.0, gravity]))
    work.behind(bent.node, _NO_LOAD)
    half = sum(work.halves)
    return bent.form.stiffness - half - np.swapaxes(half, -1, -2)


def _frames(tree: Node) -> dict[str, Frame]:
    """Place of every leaf, seen from the root."""
    found: dict[str, Frame] = {}

    def visit(node: Node, outer: Frame) -> None:
        frame = outer.then(node.frame)
        if isinstance(node, Series | Parallel):
            for member in node.members:
                visit(member, frame)
        else:
            found[node.name] = frame

    visit(tree, Frame())
    return found


def _hessian_behind(spring: Frame, force: Array, point: Array) -> Array:
    """Hessian, in a spring's own axes, of a force (3,) at a point (..., 3), both seen from M."""
    to_spring = np.swapaxes(spring.matrix(), -1, -2)
    lever = np.einsum("...ij,...j->...i", to_spring, point - spring.origin())
    return load_hessian(to_spring @ force, lever)


def _softened(node: Node, hessian: Array) -> Node:
    if not isinstance(node, Spring):
        msg = f"{node.name}: expected a spring"
        raise InputError(msg)
    softer = np.linalg.solve(np.eye(6) - node.compliance @ hessian, node.compliance)
    return replace(node, compliance=0.5 * (softer + np.swapaxes(softer, -1, -2)))


def _bent(tree: Node, sagged: Response) -> Node:
    """The tree as its loads have bent it: every leaf carried along by its body, seen from M where it now is."""
    home = Frame(translation=-sagged.twist[..., :3, 0])

    def visit(node: Node) -> Node:
        if isinstance(node, Series | Parallel):
            return replace(node, members=tuple(visit(m) for m in node.members), frame=Frame())
        if isinstance(node, Spring) and node.rigid:
            return node
        element = sagged.elements[node.name]
        frame = home.then(element.frame.moved(element.base[..., 0]))
        if isinstance(node, Spring):
            screws = _ordered_screws(element.twist[..., 0])
            return replace(
                node,
                compliance=screws @ node.compliance @ np.swapaxes(screws, -1, -2),
                offset=None if node.offset is None else np.einsum("...ij,...j->...i", screws, node.offset),
                frame=frame,
            )
        if isinstance(node, Passive) and node.directions.shape[-1] > 1:
            return replace(node, directions=_ordered_directions(node.directions, element.twist[..., 0]), frame=frame)
        return replace(node, frame=frame)

    return visit(tree)


def _ordered_directions(directions: Array, twist: Array) -> Array:
    """Free directions (..., 6, k) of a joint as its own ``twist`` leaves them: each is carried by those before it."""
    rates = (np.linalg.pinv(directions) @ twist[..., None])[..., 0]
    frame = Frame()
    columns: list[Array] = []
    for k in range(directions.shape[-1]):
        column = directions[..., k]
        columns.append((frame.adjoint() @ column[..., None])[..., 0])
        step = column * rates[..., k, None]
        frame = frame.then(Frame(rotation_of(step[..., 3:]), step[..., :3]))
    return np.stack(np.broadcast_arrays(*columns), axis=-1)


def _ordered_screws(coordinates: Array) -> Array:
    """Twists (..., 6, 6) that a spring's coordinates Tx Ty Tz Rx Ry Rz give where they stand at ``coordinates``."""
    x, y, _ = np.eye(3)
    first = rotation(x, coordinates[..., 3])
    second = first @ rotation(y, coordinates[..., 4])
    axes = np.stack([np.broadcast_to(x, first.shape[:-1]), first[..., 1], second[..., 2]], axis=-1)
    screws = np.zeros((*axes.shape[:-2], 6, 6))
    screws[..., :3, :3] = np.eye(3)
    screws[..., 3:, 3:] = axes
    screws[..., :3, 3:] = skew(coordinates[..., :3]) @ axes  # rotations act about the displaced origin
    return screws


@dataclass(frozen=True)
class _Load:
    """Forces with their points: the resultant (..., 3) and the dyad Σ f pᵀ (..., 3, 3) about M."""

    force: Array
    dyad: Array

    def __add__(self, other: _Load) -> _Load:
        return _Load(self.force + other.force, self.dyad + other.dyad)

    def work(self, before: Array, after: Array) -> Array:
        """Work ``Σ f·(ω_a × v_b)`` of rotations (..., 3, a) followed by twists (..., 6, b); (..., a, b)."""
        return np.swapaxes(before, -1, -2) @ (self._moment @ after)

    @cached_property
    def _moment(self) -> Array:
        """Moment (..., 3, 6) about M that unit twists of the points give the forces, to first order."""
        dyad = np.swapaxes(self.dyad, -1, -2)
        trace = dyad[..., 0, 0] + dyad[..., 1, 1] + dyad[..., 2, 2]
        arm = np.broadcast_to(-skew(self.force), dyad.shape)
        return np.concatenate([arm, dyad - trace[..., None, None] * np.eye(3)], axis=-1)


_NO_LOAD = _Load(np.zeros(3), np.zeros((3, 3)))


@dataclass(frozen=True)
class _SecondOrder:
    """Second-order work of the loads along every chain, as half Hessians (..., 6, 6) over unit twists of the tool.

    ``elements`` are under the weights in the first case, under unit twists of the tool in the others; all groups of a
    bent robot stand at M, so that what they know of their members is seen from there. A chain that closes a loop
    carries at its tip the wrench of its closure; the body there moves by a rotation vector about M.
    """

    elements: dict[str, Element]
    gravity: Array
    halves: list[Array] = field(default_factory=list[Any])

    def behind(self, node: Node, load: _Load) -> _Load:
        """Add the work done behind ``node`` by ``load`` at its end; returns the load at its base."""
        match node:
            case Series():
                return self._series(node, load)
            case Parallel():
                return reduce(add, (self.behind(member, self._closure(member)) for member in node.members))
            case Weight():
                force = node.mass * self.gravity
                centre = self.elements[node.name].frame.origin()
                return load + _Load(force, force[:, None] * centre[..., None, :])
            case Spring() if node.rigid:
                return load
            case _:
                self._element(node.name, load)
                return load

    def _series(self, series: Series, load: _Load) -> _Load:
        body: Array | None = None  # twist of the body that the member at hand ends at
        for member in reversed(series.members):
            if isinstance(member, Parallel) and body is not None:
                spin = np.concatenate([np.zeros_like(body[..., :3, :]), body[..., 3:, :]], axis=-2)
                self.halves.append(0.5 * load.work(body[..., 3:, :], spin))
            load = self.behind(member, load)
            body = self.elements[next(iter(leaves(member))).name].base[..., 1:]
        return load

    def _element(self, name: str, load: _Load) -> None:
        """Rotations of the body before an element, then its own motion; and its own coordinates in their order."""
        element = self.elements[name]
        across = element.group.twist[..., 1:]
        self.halves.append(load.work(element.base[..., 3:, 1:], across))
        if isinstance(element.node, Passive):
            screws = element.frame.adjoint() @ element.node.directions
            rates = np.linalg.pinv(element.node.directions) @ (element.frame.inverse_adjoint() @ across)
        else:  # translations come first in a spring's order: only its rotations turn anything
            screws = element.frame.adjoint()[..., 3:]
            rates = np.swapaxes(element.frame.matrix(), -1, -2) @ across[..., 3:, :]
        pairs = load.work(screws[..., 3:, :], screws)
        k = pairs.shape[-1]
        pairs = pairs * (np.triu(np.ones((k, k))) - 0.5 * np.eye(k))
        self.halves.append(np.swapaxes(rates, -1, -2) @ pairs @ rates)

    def _closure(self, member: Node) -> _Load:
        """Wrench at the tip of a parallel member; one that ends in a parallel group closes there instead."""
        last = member
        while isinstance(last, Series):
            last = next(m for m in reversed(last.members) if not (isinstance(m, Spring) and m.rigid))
        if isinstance(last, Parallel):
            return _NO_LOAD
        wrench = self.elements[last.name].group.wrench[..., 0]
        return _Load(wrench[..., :3], 0.5 * skew(wrench[..., 3:]))
