"""A mechanism: rigid and elastic bodies, joints between them, and the tool.

Positions and directions are in the base axes {O} at one home configuration, with all loops closed.
A rigid body is one node, ``NAME``; an elastic one has a node ``NAME.END`` at each end; ``ground``
is fixed.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.errors import InputError, require
from stiffscope.runtime.brief import describe_briefly
from stiffscope.vjm.model.checks import (
    BASE,
    GROUND,
    TOOL,
    assign,
    check_compliance,
    check_vector,
    spell_name,
)
from stiffscope.vjm.model.joints import Joint

if TYPE_CHECKING:
    from collections.abc import Mapping
    from typing import Any

    from stiffscope.vjm.model.bodies import Body
    from stiffscope.vjm.model.screws import Array

COORDINATES = ("x", "y", "z", "rx", "ry", "rz")
DIAGONAL = ("K_tx", "K_ty", "K_tz", "K_rx", "K_ry", "K_rz")  # of a stiffness matrix


@dataclass(frozen=True, eq=False)
class Tool:
    """Tool point M, ``at`` (3,) in m, on a body or one of its ends, and the coordinates of a pose.

    ``pose``: some of x y z (m) and rx ry rz (rotation vector from home, rad); others follow. None
    of them is the one pose of a structure that cannot move.
    """

    body: str
    at: Array
    pose: tuple[str, ...]

    def __post_init__(self) -> None:
        assign(self, "at", check_vector(self.at, "tool.at", "a position in m"))
        pose = tuple(self.pose)
        require(
            len(set(pose)) >= len(pose) and set(pose) <= set(COORDINATES),
            "tool.pose",
            f"some of {', '.join(COORDINATES)}, each once",
            list(pose),
        )
        assign(self, "pose", pose)

    @cached_property
    def commanded_axes(self) -> list[int]:
        """Indices of the commanded coordinates in x y z rx ry rz."""
        return [COORDINATES.index(name) for name in self.pose]

    @cached_property
    def home(self) -> Array:
        """Commanded pose (k,) at home."""
        return np.concatenate([self.at, np.zeros(3)])[self.commanded_axes]


@dataclass(frozen=True, eq=False)
class Change:
    """Change of an element by an effect, in the element's axes.

    Additional compliance (6, 6), twist (6,) of the unloaded end, displacement (6,) of a joint's
    axis as a twist, and spring stiffness for each free motion of a passive joint. For a body with n
    ends, (6m, 6m) and (6m,) with m = n - 1: all ends except the first.
    """

    compliance: Array | None = None
    offset: Array | None = None
    misalignment: Array | None = None
    spring: float | None = None

    @property
    def displaces(self) -> bool:
        """Whether it is a geometric error."""
        return self.offset is not None or self.misalignment is not None


NO_CHANGE = Change()


@dataclass(frozen=True, eq=False)
class Mechanism:
    """Bodies, joints and tool; ``gravity`` (3,) is the free-fall acceleration, m/s², base axes.

    ``base``: change between ground and robot, at the origin; ``grip``: between tool body and M, at
    M; both in base axes at home. Raises InputError if the mechanism is inconsistent.
    """

    __repr__ = describe_briefly

    bodies: tuple[Body, ...]
    joints: tuple[Joint, ...]
    tool: Tool
    gravity: Array = field(default_factory=lambda: np.zeros(3))
    base: Change = NO_CHANGE
    grip: Change = NO_CHANGE

    def __post_init__(self) -> None:
        assign(self, "bodies", tuple(self.bodies))
        assign(self, "joints", tuple(self.joints))
        assign(
            self,
            "gravity",
            check_vector(self.gravity, "gravity", "an acceleration in m/s²"),
        )
        seen: dict[str, str] = {}
        for here, name in [
            *((spell_name("bodies", b.name), b.name) for b in self.bodies),
            *((spell_name("joints", j.name), j.name) for j in self.joints),
        ]:
            other = seen.setdefault(name, here)
            require(other is here, here, "a name of its own", f"that of {other}")
        for j in self.joints:
            for node in (j.first, j.second):
                self._check_node(node, f"{spell_name('joints', j.name)}.between")
            require(
                self.carrier(j.first) != self.carrier(j.second),
                f"{spell_name('joints', j.name)}.between",
                "two bodies",
                f"{j.first} and {j.second}",
            )
        require(self.tool.body != GROUND, "tool.body", "a body that moves", "ground")
        self._check_node(self.tool.body, "tool.body")
        self._check_connected()

    def _check_node(self, node: str, here: str) -> None:
        if node in self._carriers:
            return
        ends = next((" or ".join(b.nodes) for b in self.bodies if b.name == node), None)
        what = f"a body or an end of one ({', '.join(self._carriers)})"
        if ends is not None:
            what = f"an end of the elastic body, {ends}"
        raise InputError(f"{here}: expected {what}, got {node!r}")

    def _check_connected(self) -> None:
        reached = {GROUND}
        grown = True
        pairs = [(self.carrier(j.first), self.carrier(j.second)) for j in self.joints]
        while grown:
            more = {b for pair in pairs for b in pair if reached & set(pair)} - reached
            reached |= more
            grown = bool(more)
        for body in self.bodies:
            here = spell_name("bodies", body.name)
            what = "joints that connect it with the ground"
            require(body.name in reached, here, what, "none")

    @cached_property
    def _carriers(self) -> dict[str, str]:
        return {GROUND: GROUND} | {
            node: body.name for body in self.bodies for node in body.nodes
        }

    def carrier(self, node: str) -> str:
        """Return the name of a node's body."""
        return self._carriers[node]

    def rows(self, name: str) -> tuple[str, ...]:
        """Return its network elements: of a body of n > 2 ends, n - 1 from the first end."""
        return self._rows.get(name, (name,))

    @cached_property
    def _rows(self) -> dict[str, tuple[str, ...]]:
        return {
            body.name: body.nodes[1:] for body in self.bodies if len(body.nodes) > 2
        }

    def body(self, name: str) -> Body:
        """Return the body with this name."""
        return next(b for b in self.bodies if b.name == name)

    def joint(self, name: str) -> Joint:
        """Return the joint with this name."""
        return next(j for j in self.joints if j.name == name)

    @property
    def drives(self) -> tuple[Joint, ...]:
        """Joints with a drive."""
        return tuple(j for j in self.joints if j.drive is not None)

    @property
    def elements(self) -> tuple[str, ...]:
        """Names of all elements: ``BASE``, joints, elastic bodies, ``TOOL``."""
        elastic = (b.name for b in self.bodies if b.elastic is not None)
        return (BASE, *(j.name for j in self.joints), *elastic, TOOL)

    def change_elements(self, changes: Mapping[str, Change]) -> Mechanism:
        """Return the mechanism with compliances added and unloaded ends moved, by element name.

        Raises InputError for an unknown name or a compliance that becomes indefinite.
        """
        listed = ", ".join(self.elements)
        for name in changes:
            known = name in self.elements
            require(known, "elements", f"one of {listed}", repr(name))
        bodies = list(self.bodies)
        joints = list(self.joints)
        for k, body in enumerate(bodies):
            if body.name in changes and body.elastic is not None:
                bodies[k] = replace(
                    body, elastic=_apply_change(body.elastic, changes[body.name])
                )
        for k, joint in enumerate(joints):
            if joint.name in changes:
                joints[k] = _apply_change(joint, changes[joint.name])
        base, grip = (
            _apply_change(at, changes[name]) if name in changes else at
            for name, at in ((BASE, self.base), (TOOL, self.grip))
        )
        for name, change, before in (
            ("base", base, self.base),
            ("tool", grip, self.grip),
        ):
            if change is not before and change.compliance is not None:
                check_compliance(change.compliance, name, semidefinite=True)
        out = copy.copy(self)  # names and connections are already checked
        values = {
            "bodies": tuple(bodies),
            "joints": tuple(joints),
            "base": base,
            "grip": grip,
        }
        for name, value in values.items():
            assign(out, name, value)
        return out


def _apply_change(element: Any, change: Change) -> Any:
    new: dict[str, Any] = {}
    for key in ("compliance", "offset", "misalignment"):
        now = getattr(element, key, None)
        more = getattr(change, key)
        if more is not None:
            new[key] = more if now is None else now + more
    if change.spring:
        new["spring"] = (element.spring or 0.0) + change.spring
    if isinstance(element, Joint):
        return element.yield_otherwise(new)
    return replace(element, **new)
