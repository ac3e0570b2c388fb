# pyright: reportArgumentType=false, reportCallIssue=false, reportAssignmentType=false
# pyright: reportOptionalSubscript=false, reportMissingImports=false
# (EXUDYN is an extra, and its stubs are incomplete)
"""Robot in EXUDYN: rigid bodies, springs with full 6x6 stiffness, joints and superelements.

It needs numpy and EXUDYN alone: an exported model is this module behind a robot's tables.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable  # noqa: TC003 (a script's too)
from functools import partial
from typing import Any

import exudyn as exu
import numpy as np
import scipy.linalg
from exudyn import itemInterface as item  # noqa: N813 (a module)

# --- copied into exported models from here ---

AXES = ("x", "y", "z", "rx", "ry", "rz")
RANK = 1e-9  # relative singular value below which a direction has no compliance
STRAIGHT = (1.0, 0.5, 0.2, 0.05, 0.01, 1e-3, 1e-6)
"""Shares of a straight law in that of a drive with a curve, in turn: Newton's method does not
converge at once where a backlash has no stiffness. The last one remains."""
ROUNDING = 1e-14  # of a force: what is left of it when a solution has converged
SMALL = 1e-5  # of the robot's length: a displacement with which all is linear
POINTS = np.vstack([np.eye(3), -np.eye(3)])  # mesh nodes about an interface


def skew(r: Any) -> Any:
    """Return S(r) with S(r) a = r x a."""
    x, y, z = r
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def rotation_of(vector: Any) -> Any:
    """Return the rotation matrix of a rotation vector, rad."""
    angle = float(np.linalg.norm(vector))
    s = skew(np.asarray(vector) / angle if angle else np.zeros(3))
    return np.eye(3) + np.sin(angle) * s + (1.0 - np.cos(angle)) * s @ s


def vector_of(turn: Any) -> Any:
    """Return the rotation vector of a small rotation, rad."""
    sine = 0.5 * np.array(
        [turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]
    )
    size = float(np.linalg.norm(sine))
    angle = np.arctan2(size, 0.5 * (np.trace(turn) - 1.0))
    return sine * (angle / size if size else 1.0)


def null_space(matrix: Any) -> Any:
    """Return orthonormal columns x with matrix @ x = 0."""
    if not matrix.size:
        return np.eye(matrix.shape[1])
    _, values, rows = np.linalg.svd(matrix, full_matrices=True)
    rank = int((values > RANK * values.max()).sum()) if values.max() > 1e-12 else 0
    return rows[rank:].T


def factor_of(compliance: Any) -> Any:
    """Return F with F F^T the compliance, scaled so that units do not matter."""
    size = np.sqrt(np.diag(compliance).clip(min=0.0))
    unit = np.where(size > 0.0, size, 1.0)
    values, vectors = np.linalg.eigh(compliance / np.outer(unit, unit))
    keep = values > 1e-14 * max(values[-1], 1e-300)
    return unit[:, None] * vectors[:, keep] * np.sqrt(values[keep])


def split_element(compliance: Any, free: Any, rigid: float, length: float) -> Any:
    """Split an element with free motions (6, k) into a spring and what a joint must hold.

    Returns the stiffness (6, 6), and the directions (3, k) of translation and of rotation without
    compliance. A rigid direction that mixes both gets the stiffness ``rigid``, N/m.
    """
    unit = np.array([1.0, 1.0, 1.0, length, length, length])
    factor = factor_of(compliance)
    columns = np.hstack([factor, free]) * unit[:, None]
    columns = columns / np.linalg.norm(columns, axis=0)
    size = np.linalg.norm(np.hstack([factor, free]) * unit[:, None], axis=0)
    inverse = np.linalg.pinv(columns, RANK) / size[:, None]
    strains = inverse[: factor.shape[1]] * unit
    translation = null_space(columns[:3].T)
    rotation = null_space(columns[3:].T)
    held = np.zeros((6, translation.shape[1] + rotation.shape[1]))
    held[:3, : translation.shape[1]] = translation
    held[3:, translation.shape[1] :] = rotation
    mixed = null_space(np.hstack([columns, held]).T).T * unit
    return strains.T @ strains + rigid * mixed.T @ mixed, translation, rotation


def curve_force(starts: Any, slopes: Any, moved: float) -> float:
    """Return the force of a drive: no stiffness up to the first start, then a slope after each."""
    widths = np.diff(starts, append=np.inf)
    parts = slopes * np.clip(abs(moved) - starts, 0.0, widths)
    return float(np.copysign(parts.sum(), moved))


def frame_along(directions: Any) -> tuple[Any, list[int]]:
    """Return axes (3, 3) and flags of those along some directions; the unit axes if they will do."""
    projector = directions @ directions.T
    if np.abs(projector - np.diag(np.diag(projector))).max(initial=0.0) < 1e-9:
        return np.eye(3), [int(share > 0.5) for share in np.diag(projector)]
    axes = np.hstack([directions, null_space(directions.T)])
    if np.linalg.det(axes) < 0.0:
        axes[:, -1] *= -1.0
    return axes, [1] * directions.shape[1] + [0] * (3 - directions.shape[1])


End = tuple[str, Any, Any]
"""A frame on a node: its name, place (3,) and axes (3, 3) at the pose."""


class Robot:
    """The robot at one pose: the EXUDYN system ``mbs``, and item numbers by name.

    Every body, and every end of an elastic one, is a rigid body whose frame is parallel to the base
    axes at the pose. ``nodes``, ``bodies``, ``springs``, ``joints`` and ``loads``: their numbers in
    ``mbs``. ``linear``: for vibrations about the drawn pose, without curves of drives, lacks of fit
    and springs on idle motions.
    ``sign``: -1 reverses all lacks of fit, 0 leaves them out.
    """

    def __init__(
        self,
        model: dict[str, Any],
        pose: str,
        *,
        linear: bool = False,
        sign: float = 1.0,
    ) -> None:
        self.model = model
        self.linear = linear
        self.sign = 0.0 if linear else sign
        self.pose = model["poses"][pose]
        self.container = exu.SystemContainer()
        self.mbs = self.container.AddSystem()
        self.nodes: dict[str, Any] = {}
        self.bodies: dict[str, Any] = {}
        self.springs: dict[str, Any] = {}
        self.joints: dict[str, Any] = {}
        self.faces: dict[str, Any] = {}
        self.released: list[Any] = []
        self.stiffest = 0.0
        self.curved = False
        self.straight = 1.0
        self.loads: dict[str, Any] = {}
        self.weights: list[Any] = []
        self.places: dict[str, Any] = {}
        self.frames = {
            name: (rotation_of(frame["turned"]), np.array(frame["moved"]))
            for name, frame in self.pose["frames"].items()
        }
        self.frames["ground"] = (np.eye(3), np.zeros(3))
        self.carriers = {"ground": "ground"}
        self.nodes["ground"] = None
        self.bodies["ground"] = self.mbs.AddObject(item.ObjectGround(name="ground"))
        self.places["ground"] = np.zeros(3)
        for name, body in model["rigid_bodies"].items():
            self.add_rigid(name, body)
        for name, body in model["elastic_bodies"].items():
            self.add_elastic(name, body)
        for name, joint in model["joints"].items():
            self.add_joint(name, joint)
        self.add_tool()
        self.drop_redundant()

    def at(self, node: str, home: Any) -> Any:
        """Return where a point of a node, given at home, is at the pose."""
        turn, move = self.frames[self.carriers[node]]
        return turn @ np.asarray(home, dtype=float) + move

    def turn(self, node: str) -> Any:
        """Return a node's rotation from home."""
        return self.frames[self.carriers[node]][0]

    def add_body(
        self, node: str, place: Any, mass: float, first: Any, inertia: Any
    ) -> None:
        """Add a rigid body: first moment (3,) and inertia (3, 3) about its place."""
        self.places[node] = place
        self.nodes[node] = self.mbs.AddNode(
            item.NodeRigidBodyRxyz(
                name=node, referenceCoordinates=[*place, 0.0, 0.0, 0.0]
            )
        )
        xx, yy, zz = np.diag(inertia)
        six = [xx, yy, zz, inertia[1, 2], inertia[0, 2], inertia[0, 1]]
        self.bodies[node] = self.mbs.AddObject(
            item.ObjectRigidBody(
                name=node,
                mass=mass,
                inertia=six,
                centerOfMass=first / mass if mass else np.zeros(3),
                nodeNumber=self.nodes[node],
            )
        )
        if mass:
            self.add_weight(self.bodies[node])

    def add_weight(self, body: Any) -> None:
        """Let gravity act on a body."""
        marker = self.mbs.AddMarker(item.MarkerBodyMass(bodyNumber=body))
        load = item.LoadMassProportional(
            markerNumber=marker, loadVector=list(self.model["gravity"])
        )
        self.weights.append(self.mbs.AddLoad(load))

    def add_rigid(self, name: str, body: dict[str, Any]) -> None:
        """Add a rigid body of the robot."""
        self.carriers[name] = name
        turn = self.turn(name)
        place = self.at(name, body["centre"])
        inertia = turn @ np.array(body["inertia"]) @ turn.T
        self.add_body(name, place, body["mass"], np.zeros(3), inertia)

    def add_elastic(self, name: str, body: dict[str, Any]) -> None:
        """Add an elastic body: a spring between two ends with masses, or a superelement."""
        places = np.array(list(body["ends"].values()))
        nodes = [f"{name}.{end}" for end in body["ends"]]
        self.carriers.update(dict.fromkeys(nodes, name))
        modal = body["condensed_mass"] is not None
        share = 0.0 if modal else body["mass"] / len(nodes)
        for node, home in zip(nodes, places, strict=True):
            self.add_body(
                node, self.at(node, home), share, np.zeros(3), np.zeros((3, 3))
            )
        axes = self.turn(nodes[0]) @ np.array(body["axes"])
        if modal or len(nodes) > 2:
            self.add_superelement(name, nodes, body, axes)
            return
        tip = self.places[nodes[1]]
        start = self.shifted(name, nodes[0], tip, axes)
        compliance = np.array(body["compliance"])
        self.connect(name, start, (nodes[1], tip, axes), compliance, np.zeros((6, 0)))

    def add_superelement(
        self, name: str, nodes: list[str], body: dict[str, Any], axes: Any
    ) -> None:
        """Add a floating frame with the body's modes: unit motions of its ends, then its own modes."""
        compliance = np.array(body["compliance"])
        free = len(compliance)
        squares = np.array(body["mode_squares"])
        modes = free + len(squares)
        turn = np.kron(np.eye(2), axes)
        turns = np.eye(6 + modes)
        turns[: 6 + free, : 6 + free] = np.kron(np.eye(len(nodes)), turn)
        stiffness = np.zeros((modes, modes))
        big = turns[6 : 6 + free, 6 : 6 + free]
        stiffness[:free, :free] = big @ np.linalg.inv(compliance) @ big.T
        stiffness[free:, free:] = np.diag(squares)
        self.stiffest = max(self.stiffest, float(np.abs(stiffness[:3, :3]).max()))
        arms = [self.places[node] - self.places[nodes[0]] for node in nodes]
        carry = np.eye(6 + modes)
        for k, arm in enumerate(arms[1:], 1):
            carry[6 * k : 6 * k + 6, :6] = np.eye(6)
            carry[6 * k : 6 * k + 3, 3:6] = -skew(arm)
        mass = np.zeros((6 + modes, 6 + modes))
        if body["condensed_mass"] is not None:
            mass = carry.T @ turns @ np.array(body["condensed_mass"]) @ turns.T @ carry
        total = float(np.trace(mass[:3, :3])) / 3.0
        moment = mass[3:6, :3]  # S(m c)
        first = np.array([moment[2, 1], moment[0, 2], moment[1, 0]])
        reach = 0.05 * float(np.linalg.norm(arms, axis=1).max())
        mesh = np.vstack([arm + reach * POINTS for arm in arms])
        basis = np.zeros((3 * len(mesh), modes))
        for row, point in enumerate(mesh):
            end = row // len(POINTS)
            if end:
                at = slice(6 * end - 6, 6 * end)
                basis[3 * row : 3 * row + 3, at] = np.hstack(
                    [np.eye(3), -skew(point - arms[end])]
                )
        origin = self.mbs.AddNode(
            item.NodeRigidBodyRxyz(
                name=f"{name} frame",
                referenceCoordinates=[*self.places[nodes[0]], 0.0, 0.0, 0.0],
            )
        )
        at_rest = np.zeros(modes).tolist()
        modal = self.mbs.AddNode(
            item.NodeGenericODE2(
                name=f"{name} modes",
                numberOfODE2Coordinates=modes,
                referenceCoordinates=at_rest,
                initialCoordinates=at_rest,
                initialCoordinates_t=at_rest,
            )
        )
        dense = exu.MatrixContainer
        body_number = self.mbs.AddObject(
            item.ObjectFFRFreducedOrder(
                name=name,
                nodeNumbers=[origin, modal],
                massMatrixReduced=dense(mass[6:, 6:]),
                stiffnessMatrixReduced=dense(stiffness),
                dampingMatrixReduced=dense(),
                computeFFRFterms=True,
                modeBasis=basis,
                referencePositions=mesh.ravel(),
                mass=total,
                inertia=mass[3:6, 3:6],
                centerOfMass=first / total if total else np.zeros(3),
                # how deformation changes the inertia is of second order in it
                mPsiTildePsi=np.zeros((3 * modes, modes)),
                mPsiTildePsiTilde=np.zeros((3 * modes, 3 * modes)),
                mPhitTPsi=mass[:3, 6:],
                mPhitTPsiTilde=np.zeros((3, 3 * modes)),
                mXRefTildePsi=-mass[3:6, 6:],
                mXRefTildePsiTilde=np.zeros((3, 3 * modes)),
            )
        )
        self.bodies[name] = body_number
        if total:
            self.add_weight(body_number)
        for end, node in enumerate(nodes):
            numbers = [end * len(POINTS) + k for k in range(len(POINTS))]
            lack = (
                self.offset(name if len(nodes) == 2 else node) if end else np.zeros(6)
            )
            frame = np.eye(4)
            frame[:3, :3] = rotation_of(axes @ lack[3:])
            frame[:3, 3] = axes @ lack[:3]
            there = self.mbs.AddMarker(
                item.MarkerSuperElementRigid(
                    bodyNumber=body_number,
                    localHT=frame,
                    meshNodeNumbers=numbers,
                    weightingFactors=np.full(len(POINTS), 1.0 / len(POINTS)).tolist(),
                )
            )
            here = self.marker(node, self.places[node], np.eye(3))
            self.faces[node] = self.mbs.AddObject(
                item.ObjectJointGeneric(
                    name=f"{node} face",
                    markerNumbers=[there, here],
                    constrainedAxes=[1] * 6,
                )
            )

    def marker(self, node: str, place: Any, axes: Any) -> Any:
        """Add a frame to a node's body; place and axes at the pose."""
        frame = np.eye(4)
        frame[:3, :3] = axes
        frame[:3, 3] = place - self.places[node]
        return self.mbs.AddMarker(
            item.MarkerBodyRigid(bodyNumber=self.bodies[node], localHT=frame)
        )

    def add_joint(self, name: str, joint: dict[str, Any]) -> None:
        """Add a joint with its bearing, drive and springs."""
        first, second = joint["between"]
        home = np.array(joint["axes"])
        axes = self.turn(first) @ home
        free_axes = [AXES.index(word) for word in joint["free"]]
        motions = [np.eye(6)[k] for k in free_axes]
        if "axis2" in joint:
            second_axis = axes.T @ self.turn(second) @ np.array(joint["axis2"])
            motions[1] = np.concatenate([np.zeros(3), second_axis])
        compliance = np.zeros((6, 6))
        if joint["compliance"] is not None:
            compliance = np.array(joint["compliance"])
        curved = joint["law"] is not None and not self.linear
        resists = joint["drive"] or joint["spring"]
        free: list[Any] = []
        for word, motion in zip(joint["free"], motions, strict=True):
            driven = joint["drive"] and word == joint["driven"]
            if (joint["spring"] or driven) and not curved:
                compliance = compliance + np.outer(motion, motion) / resists
            else:
                free.append(motion)
        columns = np.array(free).T.reshape(6, -1)
        place = self.at(joint["bearer"], joint["at"])
        start = self.shifted(name, first, place, axes)
        end = (second, place, axes)
        self.connect(name, start, end, compliance, columns)
        if curved:
            along = AXES.index(joint["driven"])
            starts, slopes = (
                np.array(joint["law"][key]) for key in ("starts", "slopes")
            )
            law = partial(curve_force, starts, slopes)
            self.add_curve(f"{name} drive", start, end, along, law, slopes[0])

    def add_curve(
        self,
        name: str,
        start: End,
        end: End,
        along: int,
        law: Callable[[float], float],
        stiffness: float,
    ) -> None:
        """Add a spring along one axis of a frame: force as a function of deflection.

        stiffness: that of the straight law from which the equilibrium is approached.
        """

        def force(*state: Any) -> Any:
            moved = np.concatenate([state[3], state[4]])[along]
            out = np.zeros(6)
            out[along] = (
                law(moved) * (1.0 - self.straight) + self.straight * stiffness * moved
            )
            return out

        self.curved = True
        self.stiffest = max(self.stiffest, stiffness)
        self.add_spring(name, start, end, springForceTorqueUserFunction=force)

    def connect(
        self, name: str, start: End, end: End, compliance: Any, free: Any
    ) -> None:
        """Connect two frames, that coincide unloaded: a spring, and joints along what is rigid."""
        axes = start[2]
        rigid = self.model["rigid"]
        stiffness, *held = split_element(compliance, free, rigid, self.model["length"])
        if name in self.pose["idle"] and not self.linear:
            idle = axes.T @ np.array(self.pose["idle"][name])
            stiffness[3:, 3:] += self.model["idle"] * np.outer(idle, idle)
        self.stiffest = max(self.stiffest, float(np.abs(stiffness[:3, :3]).max()))
        if stiffness.any():
            self.add_spring(name, start, end, stiffness=stiffness)
        turns, flags = zip(*map(frame_along, held), strict=True)
        if np.array_equal(*turns):
            self.hold(name, start, end, turns[0], [*flags[0], *flags[1]])
            return
        self.hold(f"{name} translation", start, end, turns[0], [*flags[0], 0, 0, 0])
        self.hold(f"{name} rotation", start, end, turns[1], [0, 0, 0, *flags[1]])

    def add_spring(self, name: str, start: End, end: End, **given: Any) -> None:
        """Add a spring between two frames."""
        markers = [self.marker(*start), self.marker(*end)]
        self.springs[name] = self.mbs.AddObject(
            item.ObjectConnectorRigidBodySpringDamper(
                name=name, markerNumbers=markers, **given
            )
        )

    def shifted(self, name: str, node: str, place: Any, axes: Any) -> End:
        """Return a frame on an element's first end, moved by its lack of fit."""
        offset = self.offset(name)
        return node, place + axes @ offset[:3], axes @ rotation_of(offset[3:])

    def offset(self, name: str) -> Any:
        """Return the twist (6,) of an element's unloaded second end from its first, own axes."""
        return self.sign * np.array(self.pose["offsets"].get(name, np.zeros(6)))

    def hold(
        self, name: str, start: End, end: End, turn: Any, flags: list[int]
    ) -> None:
        """Add a joint that holds two frames together along some of their axes."""
        if any(flags):
            markers = [self.marker(n, at, axes @ turn) for n, at, axes in (start, end)]
            self.joints[name] = self.mbs.AddObject(
                item.ObjectJointGeneric(
                    name=f"{name} joint", markerNumbers=markers, constrainedAxes=flags
                )
            )

    def drop_redundant(self) -> None:
        """Release constraints that others imply: a solver must not meet them twice."""
        names = [*self.joints, *self.faces]
        numbers = [*self.joints.values(), *self.faces.values()]
        self.mbs.Assemble()
        if not numbers:
            return
        _, _, _, jacobian, *_ = self.mbs.ComputeLinearizedSystem(
            self.settings(), returnConstraintJacobian=True
        )
        jacobian = np.array(jacobian)
        rows = [self.mbs.systemData.GetObjectLTGAE(number) for number in numbers]
        flags = [
            np.array(self.mbs.GetObjectParameter(number, "constrainedAxes"))
            for number in numbers
        ]
        used = [
            (k, axis)
            for k in range(len(numbers))
            for axis in range(6)
            if flags[k][axis]
        ]
        columns = jacobian[:, [rows[k][axis] for k, axis in used]]
        columns = columns / np.linalg.norm(columns, axis=0)
        _, upper, order = scipy.linalg.qr(columns, mode="economic", pivoting=True)
        size = np.abs(np.diag(upper))
        rank = int((size > RANK * size[0]).sum())
        for dropped in order[rank:]:
            k, axis = used[dropped]
            flags[k][axis] = 0
            self.mbs.SetObjectParameter(numbers[k], "constrainedAxes", flags[k])
        self.released = [(names[used[d][0]], used[d][1]) for d in order[rank:]]
        if self.released:
            self.mbs.Assemble()

    def add_tool(self) -> None:
        """Mark the tool point M, and put a load of zero there."""
        tool = self.model["tool"]
        self.tool = self.at(tool["body"], tool["at"])
        marker = self.marker(tool["body"], self.tool, np.eye(3))
        self.loads["force"] = self.mbs.AddLoad(
            item.LoadForceVector(name="force at M", markerNumber=marker)
        )
        self.loads["torque"] = self.mbs.AddLoad(
            item.LoadTorqueVector(name="torque at M", markerNumber=marker)
        )

    def load_tool(self, wrench: Any) -> None:
        """Apply a wrench (6,) at M, base axes, N and N m."""
        wrench = np.asarray(wrench, dtype=float)
        self.mbs.SetLoadParameter(self.loads["force"], "loadVector", wrench[:3])
        self.mbs.SetLoadParameter(self.loads["torque"], "loadVector", wrench[3:])

    def set_gravity(self, share: float) -> None:
        """Let a share of the weight act."""
        gravity = share * np.array(self.model["gravity"])
        for load in self.weights:
            self.mbs.SetLoadParameter(load, "loadVector", gravity)

    def settings(self) -> Any:
        """Return settings of the solvers."""
        out = exu.SimulationSettings()
        out.solution.file.write = False
        out.linearSolver.solverType = exu.LinearSolverType.EigenDense
        out.staticSolver.verboseMode = 0
        newton = out.staticSolver.newton
        newton.relativeTolerance = 1e-10
        newton.absoluteTolerance = ROUNDING * self.stiffest * self.model["length"]
        newton.numericalDifferentiation.relativeEpsilon = 1e-7
        return out

    def settle(self) -> Any:
        """Find the equilibrium; return the tool's twist (6,) at M from the pose, m and rad."""
        initial = exu.ConfigurationType.Initial
        start = self.mbs.systemData.GetODE2Coordinates(initial)
        self.solve()
        twist = self.tool_twist()
        self.mbs.systemData.SetODE2Coordinates(start, initial)
        return twist

    def solve(self) -> None:
        """Find the equilibrium; it becomes the initial state."""
        for share in STRAIGHT if self.curved else STRAIGHT[-1:]:
            self.straight = share
            self.mbs.SolveStatic(self.settings(), updateInitialValues=True)

    def tool_twist(self) -> Any:
        """Return the tool's twist (6,) at M from the pose, base axes, m and rad."""
        body = self.model["tool"]["body"]
        kind = exu.OutputVariableType
        moved = self.mbs.GetNodeOutput(self.nodes[body], kind.Displacement)
        turn = np.reshape(
            self.mbs.GetNodeOutput(self.nodes[body], kind.RotationMatrix), (3, 3)
        )
        arm = self.tool - self.places[body]
        return np.concatenate([moved + turn @ arm - arm, vector_of(turn)])

    def frequencies(self, count: int = 6) -> Any:
        """Return the lowest natural frequencies above zero, Hz, about the unloaded pose."""
        mass, stiffness, _, *held = self.mbs.ComputeLinearizedSystem(
            self.settings(), returnConstraintJacobian=True
        )
        mass = np.array(mass)
        basis = np.eye(len(mass))
        if held:  # nothing where all joints yield in all directions
            basis = null_space(np.array(held[0]).reshape(len(mass), -1).T)
        mass = basis.T @ mass @ basis
        stiffness = basis.T @ np.array(stiffness) @ basis
        stiffness = 0.5 * (stiffness + stiffness.T)
        inert = np.diag(mass) > 1e-12 * np.diag(mass).max()
        # with this shift, massless and free motions need no decision on a rank
        shift = float((np.diag(stiffness)[inert] / np.diag(mass)[inert]).min())
        whole = stiffness + shift * mass
        unit = 1.0 / np.sqrt(np.diag(whole).clip(min=1e-300))
        values, vectors = np.linalg.eigh(whole * np.outer(unit, unit))
        keep = values > 1e-12 * values[-1]
        half = unit[:, None] * vectors[:, keep] / np.sqrt(values[keep])
        weights = np.linalg.eigvalsh(half.T @ mass @ half)[::-1]
        squares = 1.0 / weights[weights > 1e-12 * weights[0]] - shift
        return np.sqrt(squares[squares > 1e-7 * shift][:count]) / (2.0 * np.pi)


def find_sag(model: dict[str, Any], pose: str) -> Any:
    """Return the tool's small displacement (6,) under weight and lacks of fit, m and rad."""

    def move(share: float) -> Any:
        robot = Robot(model, pose, sign=share)
        robot.set_gravity(share)
        return robot.settle()

    return differentiate(model, move)


def find_deflection(model: dict[str, Any], pose: str, wrench: Any) -> Any:
    """Return the tool's small displacement (6,) by a wrench (6,) at M alone, N and N m."""
    robot = Robot(model, pose, sign=0.0)
    robot.set_gravity(0.0)

    def move(share: float) -> Any:
        robot.load_tool(share * np.asarray(wrench, dtype=float))
        return robot.settle()

    return differentiate(model, move)


def differentiate(model: dict[str, Any], move: Callable[[float], Any]) -> Any:
    """Return the small displacement (6,) by loads, of the displacement by shares of them.

    Half the difference of the equilibria under loads and their opposites: what finite displacements
    add is nearly even, and cancels. The rest is of the third order, and small for a share of the
    loads; all of them act where a drive's curve is to be followed.
    """
    twist = 0.5 * (move(1.0) - move(-1.0))
    unit = np.repeat([1.0, model["length"]], 3)
    size = float(np.abs(twist * unit).max()) / model["length"]
    curved = any(joint["law"] for joint in model["joints"].values())
    if curved or size < SMALL:
        return twist
    share = SMALL / size
    return 0.5 * (move(share) - move(-share)) / share


def report(model: dict[str, Any]) -> None:
    """Print sag and frequencies at a pose as JSON."""
    parser = argparse.ArgumentParser(
        description="Sag and natural frequencies of the robot."
    )
    names = list(model["poses"])
    parser.add_argument("pose", nargs="?", default="1", help="its name, or number")
    parser.add_argument(
        "--wrench", help="FX,FY,FZ,MX,MY,MZ at M, N and N m: its deflection too"
    )
    given = parser.parse_args()
    pose = given.pose
    if pose not in names:
        if not pose.isdigit() or not 1 <= int(pose) <= len(names):
            known = ", ".join(names)
            parser.error(f"expected a pose or its number, got {pose}; poses: {known}")
        pose = names[int(pose) - 1]
    out = {
        "pose": pose,
        "sag": find_sag(model, pose).tolist(),
        "frequencies": Robot(model, pose, linear=True).frequencies().tolist(),
    }
    if given.wrench:
        wrench = [float(word) for word in given.wrench.split(",")]
        out["deflection"] = find_deflection(model, pose, wrench).tolist()
    sys.stdout.write(json.dumps(out) + "\n")
