"""A mechanism: rigid and elastic bodies, the joints between them, and the tool.

All positions and directions are given in the base axes {O} at one home configuration, where every loop is closed.
A rigid body is one node, ``NAME``; an elastic one has a node ``NAME.END`` at each of its ends; ``ground`` is the fixed
one.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.errors import InputError
from stiffscope.runtime.brief import describe_briefly
from stiffscope.vjm.checks import BASE, GROUND, TOOL, assign, check_compliance, check_vector, spell_name

if TYPE_CHECKING:
    from collections.abc import Mapping
    from typing import Any

    from stiffscope.vjm.bodies import Body
    from stiffscope.vjm.joints import Joint
    from stiffscope.vjm.screws import Array

COORDINATES = ("x", "y", "z", "rx", "ry", "rz")
DIAGONAL = ("K_tx", "K_ty", "K_tz", "K_rx", "K_ry", "K_rz")  # of a stiffness matrix


@dataclass(frozen=True, eq=False)
class Tool:
    """The tool point M on a body (or end of one), ``at`` (3,) in m, and the coordinates that command a pose.

    ``pose``: some of x y z (m) and rx ry rz (rotation vector from home, rad), base axes; the others follow.
    """

    body: str
    at: Array
    pose: tuple[str, ...]

    def __post_init__(self) -> None:
        assign(self, "at", check_vector(self.at, "tool.at", "a position in m"))
        pose = tuple(self.pose)
        if not pose or len(set(pose)) < len(pose) or not set(pose) <= set(COORDINATES):
            raise InputError(f"tool.pose: expected some of {', '.join(COORDINATES)}, each once, got {list(pose)}")
        assign(self, "pose", pose)

    @cached_property
    def commanded_axes(self) -> list[int]:
        """Places of the commanded coordinates among x y z rx ry rz."""
        return [COORDINATES.index(name) for name in self.pose]

    @cached_property
    def home(self) -> Array:
        """The commanded pose at home (k,)."""
        return np.concatenate([self.at, np.zeros(3)])[self.commanded_axes]


@dataclass(frozen=True, eq=False)
class Change:
    """What an effect does to an element, in its own axes.

    Compliance (6, 6) added, twist (6,) of its unloaded end, twist (6,) of a joint's axis away from where it is drawn,
    stiffness of a spring added to each free motion of a passive joint. Of a body with n ends (6m, 6m) and (6m,),
    m = n - 1: of all ends but the first.
    """

    compliance: Array | None = None
    offset: Array | None = None
    astray: Array | None = None
    spring: float | None = None

    @property
    def displaces(self) -> bool:
        """Whether it is an error of the geometry."""
        return self.offset is not None or self.astray is not None


NO_CHANGE = Change()


@dataclass(frozen=True, eq=False)
class Mechanism:
    """Bodies, joints and tool, and ``gravity`` (3,), the acceleration of free fall in m/s², base axes.

    ``base``: what yields between the ground and all that stands on it, at the origin; ``grip``: between the tool's body
    and M, at M; both in base axes at home. Raises InputError for what does not make a mechanism.
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
        assign(self, "gravity", check_vector(self.gravity, "gravity", "an acceleration in m/s²"))
        seen: dict[str, str] = {}
        for here, name in [
            *((spell_name("bodies", b.name), b.name) for b in self.bodies),
            *((spell_name("joints", j.name), j.name) for j in self.joints),
        ]:
            if name in seen:
                raise InputError(f"{here}: expected a name of its own, got that of {seen[name]}")
            seen[name] = here
        for j in self.joints:
            for node in (j.first, j.second):
                self._check_node(node, f"{spell_name('joints', j.name)}.between")
            if self.carrier(j.first) == self.carrier(j.second):
                here = f"{spell_name('joints', j.name)}.between"
                raise InputError(f"{here}: expected two bodies, got {j.first} and {j.second}")
        if self.tool.body == GROUND:
            raise InputError("tool.body: expected a body that moves, got ground")
        self._check_node(self.tool.body, "tool.body")
        self._check_connected()

    def _check_node(self, node: str, here: str) -> None:
        if node in self._carriers:
            return
        ends = next((b.nodes for b in self.bodies if b.name == node), None)
        if ends is not None:
            raise InputError(f"{here}: expected an end of the elastic body, {' or '.join(ends)}, got {node!r}")
        known = ", ".join(self._carriers)
        raise InputError(f"{here}: expected a body or an end of one ({known}), got {node!r}")

    def _check_connected(self) -> None:
        reached, grown = {GROUND}, True
        pairs = [(self.carrier(j.first), self.carrier(j.second)) for j in self.joints]
        while grown:
            more = {b for pair in pairs for b in pair if reached & set(pair)} - reached
            reached |= more
            grown = bool(more)
        for body in self.bodies:
            if body.name not in reached:
                here = spell_name("bodies", body.name)
                raise InputError(f"{here}: expected joints that connect it with the ground, got none")

    @cached_property
    def _carriers(self) -> dict[str, str]:
        return {GROUND: GROUND} | {node: body.name for body in self.bodies for node in body.nodes}

    def carrier(self, node: str) -> str:
        """Name of the body that a node belongs to."""
        return self._carriers[node]

    def rows(self, name: str) -> tuple[str, ...]:
        """Elements of the network that an element is: of a body with more than two ends one from the first to each."""
        return self._rows.get(name, (name,))

    @cached_property
    def _rows(self) -> dict[str, tuple[str, ...]]:
        return {body.name: body.nodes[1:] for body in self.bodies if len(body.nodes) > 2}

    def body(self, name: str) -> Body:
        """The body of this name."""
        return next(b for b in self.bodies if b.name == name)

    def joint(self, name: str) -> Joint:
        """The joint of this name."""
        return next(j for j in self.joints if j.name == name)

    @property
    def drives(self) -> tuple[Joint, ...]:
        """Joints with a drive."""
        return tuple(j for j in self.joints if j.drive is not None)

    @property
    def elements(self) -> tuple[str, ...]:
        """Names of all that can yield or be changed: ``BASE``, joints, elastic bodies, ``TOOL``."""
        elastic = (b.name for b in self.bodies if b.elastic is not None)
        return (BASE, *(j.name for j in self.joints), *elastic, TOOL)

    def change_elements(self, changes: Mapping[str, Change]) -> Mechanism:
        """The mechanism with compliances added and unloaded ends moved, by the name of the element.

        Raises InputError for a name that is no element's and for a compliance that becomes indefinite.
        """
        unknown = sorted(set(changes) - set(self.elements))
        if unknown:
            raise InputError(f"no element {unknown[0]!r}; it has {', '.join(self.elements)}")
        bodies, joints = list(self.bodies), list(self.joints)
        for k, body in enumerate(bodies):
            if body.name in changes and body.elastic is not None:
                bodies[k] = replace(body, elastic=_apply_change(body.elastic, changes[body.name]))
        for k, joint in enumerate(joints):
            if joint.name in changes:
                joints[k] = _apply_change(joint, changes[joint.name])
        base, grip = (
            _apply_change(at, changes[name]) if name in changes else at
            for name, at in ((BASE, self.base), (TOOL, self.grip))
        )
        for name, change in (("base", base), ("tool", grip)):
            if change.compliance is not None:
                check_compliance(change.compliance, name, semidefinite=True)
        out = copy.copy(self)  # whose names and connections are checked already
        for name, value in (("bodies", tuple(bodies)), ("joints", tuple(joints)), ("base", base), ("grip", grip)):
            assign(out, name, value)
        return out


def _apply_change(element: Any, change: Change) -> Any:
    compliance, offset = element.compliance, element.offset
    if change.compliance is not None:
        compliance = change.compliance if compliance is None else compliance + change.compliance
    if change.offset is not None:
        offset = change.offset if offset is None else offset + change.offset
    out = replace(element, compliance=compliance, offset=offset)
    if change.spring:
        out = replace(out, spring=(element.spring or 0.0) + change.spring)
    if change.astray is None:
        return out
    return replace(out, astray=change.astray if element.astray is None else element.astray + change.astray)
