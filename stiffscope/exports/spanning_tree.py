"""A mechanism as a tree of bodies: which joints lead from the base outward, which close loops."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from stiffscope.vjm.model.checks import GROUND

if TYPE_CHECKING:
    from stiffscope.vjm.model.joints import Joint
    from stiffscope.vjm.model.mechanism import Mechanism

CUT_FIRST = (
    "spherical",
    "revolute",
    "fixed",
    "universal",
    "cylindrical",
    "planar",
    "prismatic",
)
"""Passive joints in the order in which they are cut: those that are closed by the fewest springs first."""


@dataclass(frozen=True, eq=False)
class Branch:
    """A joint from a parent's node to a body, which it enters at a node of its own.

    ``forward``: the joint's first body is the parent. Where the joint closes a loop, the body is
    already in the tree.
    """

    joint: Joint
    parent: str
    node: str
    body: str
    forward: bool


@dataclass(frozen=True, eq=False)
class SpanningTree:
    """Branches from the ground outward, and the joints that close loops."""

    branches: tuple[Branch, ...]
    cuts: tuple[Branch, ...]

    def leaving(self, mechanism: Mechanism, body: str) -> list[Branch]:
        """Return the branches that begin at a body."""
        return [b for b in self.branches if mechanism.carrier(b.parent) == body]


def is_loaded(joint: Joint) -> bool:
    """Return whether a joint has a drive or a spring along its free motions."""
    return joint.drive is not None or joint.spring is not None


def span_tree(mechanism: Mechanism) -> SpanningTree:
    """Return a spanning tree of a mechanism's bodies, with short branches.

    Joints with a drive or a spring are in the tree where loops allow it, then those between rigid
    bodies; see ``CUT_FIRST``.
    """
    joined = {GROUND: GROUND} | {body.name: body.name for body in mechanism.bodies}

    def group(body: str) -> str:
        while joined[body] != body:
            body = joined[body]
        return body

    tree = []
    cuts = []
    for joint in _order(mechanism):
        nodes = (joint.first, joint.second)
        carriers = [mechanism.carrier(node) for node in nodes]
        ends = [group(carrier) for carrier in carriers]
        if ends[0] == ends[1]:
            cuts.append(Branch(joint, *nodes, carriers[1], forward=True))
            continue
        joined[ends[1]] = ends[0]
        tree.append(joint)
    return SpanningTree(tuple(_grow(mechanism, tree)), tuple(cuts))


def span_deep_tree(mechanism: Mechanism) -> SpanningTree:
    """Return the spanning tree of a depth-first search.

    Every joint that closes a loop leads from a body back to one of its ancestors: the coordinates
    that move it are those of a single chain.
    """
    joints = _order(mechanism)
    branches: list[Branch] = []
    cuts: list[Branch] = []
    reached = {GROUND}
    used: set[str] = set()

    def visit(body: str) -> None:
        for joint in joints:
            nodes = (joint.first, joint.second)
            carriers = [mechanism.carrier(node) for node in nodes]
            if joint.name in used or body not in carriers:
                continue
            used.add(joint.name)
            forward = carriers[0] == body
            parent, node = nodes if forward else nodes[::-1]
            other = carriers[1] if forward else carriers[0]
            branch = Branch(joint, parent, node, other, forward)
            if other in reached:
                cuts.append(branch)
                continue
            reached.add(other)
            branches.append(branch)
            visit(other)

    visit(GROUND)
    return SpanningTree(tuple(branches), tuple(cuts))


def _order(mechanism: Mechanism) -> list[Joint]:
    """Return the joints; those that are rather cut come last."""
    elastic = {n for b in mechanism.bodies if b.elastic is not None for n in b.nodes}

    def last_cut(joint: Joint) -> tuple[bool, bool, int]:
        yields = joint.compliance is not None
        soft = yields or joint.first in elastic or joint.second in elastic
        return not is_loaded(joint), soft, -CUT_FIRST.index(joint.kind)

    return sorted(mechanism.joints, key=last_cut)


def _grow(mechanism: Mechanism, joints: list[Joint]) -> list[Branch]:
    """Return the joints of a tree as branches, outward from the ground."""
    out: list[Branch] = []
    left = list(joints)
    queue = [GROUND]
    for body in queue:
        here = []
        for joint in left:
            ends = (joint.first, joint.second)
            carriers = [mechanism.carrier(node) for node in ends]
            if body not in carriers:
                continue
            forward = carriers[0] == body
            parent, node = ends if forward else ends[::-1]
            child = carriers[1] if forward else carriers[0]
            here.append(Branch(joint, parent, node, child, forward))
            queue.append(child)
        taken = {branch.joint.name for branch in here}
        left = [joint for joint in left if joint.name not in taken]
        out += here
    return out
