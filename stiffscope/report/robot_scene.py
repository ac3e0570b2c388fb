"""Robot data for `stiffscope.report.drawing.robot`: bodies, joints, tool, node displacements."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.cad.part import tessellate
from stiffscope.experiments.making import EXPERIMENT
from stiffscope.robot.file.part_sections import ParametricPart
from stiffscope.robot.file.quantities import shown_unit
from stiffscope.robot.file.sections import InterfaceBody
from stiffscope.vjm.model.screws import skew
from stiffscope.vjm.network.network import place_nodes

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from stiffscope.cad.part import Part
    from stiffscope.experiments.assembly import Assembled
    from stiffscope.experiments.experiments import PartResult
    from stiffscope.robot.file.description import RobotFile
    from stiffscope.robot.inspection import Inspection
    from stiffscope.vjm.kinematics.configurations import Configurations
    from stiffscope.vjm.model.bodies import Body
    from stiffscope.vjm.model.joints import Joint
    from stiffscope.vjm.model.mechanism import Mechanism
    from stiffscope.vjm.model.screws import Array

    Moves = dict[str, tuple[Array, Array]]

_COARSE = 5e-4, 0.5  # m, rad: tessellation tolerances of solids in pictures
_HERE = 1e-6  # m, tolerance for equal positions
DEFORMATION = 0.06  # greatest displacement shown, over the robot's size


@dataclass(frozen=True)
class PlacedRobot:
    """A robot at one configuration.

    ``moves``: R (3, 3) and p (3,) of each node, ``x = R x_home + p``. ``at`` (3,): the tool point M
    in base axes, m; twists (6,) of nodes, m and rad, are about it.
    """

    mechanism: Mechanism
    moves: Moves
    at: Array

    def deform(self, twists: Mapping[str, Array], factor: float) -> Moves:
        """Return the moves of nodes displaced by scaled twists (6,), m and rad.

        Displacements ``factor (v + ω × (x - at))`` are linear in the twists and keep their shape.
        """
        out = {}
        for node, (rotation, position) in self.moves.items():
            v, w = np.split(
                factor * np.asarray(twists.get(node, np.zeros(6)), dtype=float), 2
            )
            shift = v + np.cross(w, position - self.at)
            out[node] = (np.eye(3) + skew(w)) @ rotation, position + shift
        return out

    def exaggeration(self, twists: Mapping[str, Array]) -> float:
        """Return a factor, 1, 2 or 5 times 10ⁿ, for a visible displacement of joints and tool."""
        joints = self.mechanism.joints
        tool = self.mechanism.tool
        ends = [
            (node, joint.at) for joint in joints for node in (joint.first, joint.second)
        ]
        points = [(node, at) for node, at in ends if node in self.moves] + [
            (tool.body, tool.at)
        ]
        now = np.array(
            [self.moves[node][0] @ home + self.moves[node][1] for node, home in points]
        )
        motion = np.array([twists.get(node, np.zeros(6)) for node, _ in points])
        shift = motion[:, :3] + np.cross(motion[:, 3:], now - self.at)
        greatest = float(np.linalg.norm(shift, axis=1).max())
        if greatest == 0.0:
            return 1.0
        wanted = DEFORMATION * float(np.ptp(now, axis=0).max()) / greatest
        power = 10.0 ** np.floor(np.log10(wanted))
        return float(
            max(s for s in (1.0, 2.0, 5.0) if s * power <= wanted * (1 + 1e-9)) * power
        )


def place_robot(configurations: Configurations, index: int = 0) -> PlacedRobot:
    """Return the robot at one of the configurations."""
    where = place_nodes(configurations)
    moves = {}
    for node in (
        node for body in configurations.mechanism.bodies for node in body.nodes
    ):
        each = where.rotation[node], where.position[node]
        turn, position = (values[index if len(values) > 1 else 0] for values in each)
        moves[node] = turn, position
    return PlacedRobot(configurations.mechanism, moves, configurations.tool[index, :3])


def scene(
    robot: RobotFile | None,
    mechanism: Mechanism,
    results: Mapping[str, PartResult] | None = None,
) -> dict[str, Any]:
    """Return `bodies, joints, tool, up` of `drawing.robot`, common to all pictures.

    Parameters
    ----------
    robot, mechanism
        Robot file and its mechanism; without a file, parts are drawn as rods.
    results
        Virtual experiments by part; these parts are drawn as solids.
    """
    down = mechanism.gravity
    return {
        "bodies": [_body(robot, body, results or {}) for body in mechanism.bodies],
        "joints": [_joint(joint) for joint in mechanism.joints],
        "tool": {"node": mechanism.tool.body, "at": mechanism.tool.at},
        "up": -down / np.linalg.norm(down) if down.any() else np.array([0.0, 0.0, 1.0]),
    }


def scene_of(assembled: Assembled) -> dict[str, Any]:
    """Return the scene of an assembled robot, whose tested parts are drawn as solids."""
    return scene(assembled.robot, assembled.mechanism, assembled.results)


def pose_text(mechanism: Mechanism, pose: Sequence[float]) -> str:
    """Commanded coordinates in mm and degrees; rotations of zero are left out beside others.

    A frame that nothing moves has "its one pose".
    """
    shown = []
    still = []
    for name, value in zip(mechanism.tool.pose, pose, strict=True):
        factor, unit = shown_unit(name)
        text = f"{name} = {factor * value:.{4 if unit == 'deg' else 5}g} {unit}"
        (shown if value or unit != "deg" else still).append(text)
    return ", ".join(shown or still) or "its one pose"


def _body(
    robot: RobotFile | None, body: Body, results: Mapping[str, PartResult]
) -> dict[str, Any]:
    section = robot.bodies[body.name] if robot else None
    out: dict[str, Any] = {
        "name": body.name,
        "nodes": body.nodes,
        "centre": body.centre,
    }
    if body.elastic is None:
        mesh = getattr(section, "mesh", None)
        return (
            out
            if mesh is None or robot is None
            else out | {"mesh": robot.path.parent / mesh}
        )
    e = body.elastic
    name = getattr(section, "part", body.name)
    length = (
        0.0
        if isinstance(section, InterfaceBody)
        else float(np.linalg.norm(e.tip - e.base))
    )
    return out | {
        "part": name,
        "experiment": results[name].folder / EXPERIMENT if name in results else None,
        "shape": _shape(robot, name) if robot else {},
        "axes": e.axes,
        "base": e.base,
        "length": length,
        "places": e.places,
    }


def _shape(robot: RobotFile, name: str) -> dict[str, Any]:
    """Return the dimensions for drawing a part without an experiment."""
    part = robot.parts[name]
    if not isinstance(part, ParametricPart):
        return {}
    return part.parameters().sketch()


def _joint(joint: Joint) -> dict[str, Any]:
    low, high = (
        (joint.drive.low, joint.drive.high) if joint.drive else (-np.inf, np.inf)
    )
    return {
        "name": joint.name,
        "kind": joint.kind,
        "first": joint.first,
        "second": joint.second,
        "at": joint.at,
        "axis": joint.axis,
        "axis2": joint.axis2,
        "driven": joint.drive is not None,
        "low": low if np.isfinite(low) else None,
        "high": high if np.isfinite(high) else None,
    }


def add_solids(
    bodies: Iterable[dict[str, Any]], robot: RobotFile, parts: Mapping[str, Part]
) -> None:
    """Add the surfaces of the parts' solids, m, and their origins to the bodies of a scene."""
    surfaces = {
        name: tessellate(part.solid, *_COARSE)[:2] for name, part in parts.items()
    }
    for body in bodies:
        section = robot.bodies[body["name"]]
        if isinstance(section, InterfaceBody) and section.part in surfaces:
            points, triangles = surfaces[section.part]
            body |= {"points": points, "triangles": triangles, "origin": section.at}


def mark_doubts(
    joints: Sequence[dict[str, Any]], inspection: Inspection
) -> list[dict[str, Any]]:
    """Mark doubtful joints of a scene, and add marks for possible further joints."""
    bodies = {body.name: body.nodes[0] for body in inspection.mechanism.bodies}
    marked = [dict(joint) for joint in joints]
    for doubt in inspection.doubts:
        here = [
            joint
            for joint in marked
            if doubt.at is not None
            and np.linalg.norm(np.subtract(joint["at"], doubt.at)) < _HERE
        ]
        for joint in here:
            joint["doubted"] = True
        if doubt.at is not None and not here:
            node = next(
                (bodies[name] for name in doubt.solids if name in bodies), "ground"
            )
            marked.append(
                {
                    "name": ", ".join(doubt.solids),
                    "kind": "doubt",
                    "first": node,
                    "second": node,
                    "at": doubt.at,
                    "driven": False,
                    "doubted": True,
                }
            )
    return marked
