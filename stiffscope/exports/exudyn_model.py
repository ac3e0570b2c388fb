"""Tables of a robot at poses for EXUDYN, and the script that holds them."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.transform import (  # pyright: ignore[reportMissingTypeStubs]
    Rotation,
)

from stiffscope.errors import InputError
from stiffscope.robot.file.tables import list_some
from stiffscope.vjm.elements.laws import without_laws
from stiffscope.vjm.kinematics.mobility import mobility
from stiffscope.vjm.model.checks import BASE, GROUND, TOOL
from stiffscope.vjm.model.mechanism import COORDINATES
from stiffscope.vjm.network.network import END, FOOT, list_elements, place_nodes
from stiffscope.vjm.network.order import find_order
from stiffscope.vjm.statics.analysis import compliance
from stiffscope.vjm.statics.prestress import own_loads

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stiffscope.vjm.kinematics.configurations import Configurations
    from stiffscope.vjm.model.bodies import Body
    from stiffscope.vjm.model.mechanism import Change, Mechanism
    from stiffscope.vjm.model.screws import Array
    from stiffscope.vjm.network.network import Element, Places

RIGID = 1e5  # of the tool's stiffness: for rigid directions that no joint of EXUDYN can hold
IDLE = 1e-4  # of the tool's stiffness: of a spring on motions that nothing resists
_NONE = np.zeros((6, 6))
_INDENT = "    "  # of the written script
_NAMED = 3  # poses in its head
MOUNTS = {BASE: "base mount", TOOL: "tool mount"}
"""Names, in a model, of the elements below the robot and behind its tool."""


def tabulate(
    mechanism: Mechanism, configurations: Configurations, names: Sequence[str]
) -> dict[str, Any]:
    """Return the tables of a robot: bodies and joints at home, and its poses.

    Parameters
    ----------
    mechanism
        The robot with its weight and effects.
    configurations
        Its configurations at the poses, all reachable.
    names
        A name for each pose.

    Returns
    -------
    dict
        ``gravity``, ``tool``, ``length``, ``rigid``, ``idle``, ``poses``, ``rigid_bodies``,
        ``elastic_bodies`` and ``joints``; SI, base axes at home, part axes for matrices of bodies
        and joint axes for those of joints.

    Raises
    ------
    InputError
        A joint's bearing couples the motion of its drive, which has a curve, with others.
    """
    elements = {e.name: e for e in list_elements(mechanism)}
    rigid_bodies = {}
    elastic_bodies = {}
    for body in mechanism.bodies:
        if body.elastic is None:
            rigid_bodies[body.name] = _tabulate_rigid(body)
        else:
            elastic_bodies[body.name] = _tabulate_elastic(body)
    joints = {}
    ground = GROUND
    tool = mechanism.tool.body
    if _acts(mechanism.base):
        ground = FOOT
        rigid_bodies[FOOT] = _massless(np.zeros(3))
        joints[MOUNTS[BASE]] = _mount(GROUND, FOOT, np.zeros(3), mechanism.base)
    for joint in mechanism.joints:
        ends = [ground if n == GROUND else n for n in (joint.first, joint.second)]
        joints[joint.name] = _tabulate_joint(elements[joint.name], ends)
    if _acts(mechanism.grip):
        at = mechanism.tool.at
        joints[MOUNTS[TOOL]] = _mount(tool, END, at, mechanism.grip)
        rigid_bodies[END] = _massless(at)
        tool = END
    yields = np.linalg.eigvalsh(_tool_compliance(mechanism, configurations))
    length = configurations.linkage.length
    return {
        "gravity": mechanism.gravity,
        "tool": {"body": tool, "at": mechanism.tool.at},
        "length": length,
        "rigid": RIGID / yields[yields > 1e-6 * yields.max()].min(),
        "idle": IDLE / yields.max() * length**2,
        "poses": _tabulate_poses(mechanism, configurations, names),
        "rigid_bodies": rigid_bodies,
        "elastic_bodies": elastic_bodies,
        "joints": joints,
    }


def _tool_compliance(mechanism: Mechanism, configurations: Configurations) -> Array:
    """Return the tool's translational compliance (n, 3, 3), m/N; InputError if it moves freely."""
    out = compliance(without_laws(mechanism), configurations)[:, :3, :3]
    if not np.isfinite(out).all():
        raise InputError(
            "joints: expected drives or springs that hold the tool, got one that moves freely; "
            "give the joints drives"
        )
    if not out.any():
        raise InputError(
            "expected a robot that yields, got a rigid one; give a drive a stiffness or a body a "
            "part"
        )
    return out


def _acts(change: Change) -> bool:
    return change.compliance is not None or change.offset is not None


def _massless(at: Array) -> dict[str, Any]:
    return {"mass": 0.0, "centre": at, "inertia": np.zeros((3, 3))}


def _mount(first: str, second: str, at: Array, change: Change) -> dict[str, Any]:
    """Return a joint that yields, below the robot or behind its tool."""
    return {
        "kind": "fixed",
        "free": [],
        "driven": None,
        "between": [first, second],
        "at": at,
        "bearer": second,
        "axes": np.eye(3),
        "compliance": change.compliance,
        "drive": None,
        "spring": None,
        "law": None,
    }


def _tabulate_rigid(body: Body) -> dict[str, Any]:
    out = _massless(np.zeros(3) if body.centre is None else body.centre)
    out["mass"] = body.mass
    if body.inertia is not None:
        out["inertia"] = 0.5 * (body.inertia + body.inertia.T)
    return out


def _tabulate_elastic(body: Body) -> dict[str, Any]:
    elastic = body.elastic
    assert elastic is not None  # noqa: S101 (for the type checker)
    dynamics = elastic.dynamics
    return {
        "ends": dict(zip(elastic.ends, elastic.places, strict=True)),
        "axes": elastic.axes,
        "compliance": elastic.compliance,
        "mass": body.mass,
        "condensed_mass": None if dynamics is None else dynamics.mass,
        "mode_squares": [] if dynamics is None else dynamics.squares,
    }


def _tabulate_joint(element: Element, ends: list[str]) -> dict[str, Any]:
    """Return a joint at its actual place, which errors of its axis have moved."""
    joint = element.joint
    assert joint is not None  # noqa: S101 (for the type checker)
    bearing = _NONE if joint.compliance is None else joint.compliance
    law = None if joint.drive is None else joint.drive.law
    along = joint.type.driven
    out = {
        "kind": joint.kind,
        "free": [COORDINATES[k] for k in joint.type.free],
        "driven": None if along is None else COORDINATES[along],
        "between": ends,
        "at": element.at,
        "bearer": ends[0] if joint.is_on_first else ends[1],
        "axes": element.axes,
        "compliance": bearing if bearing.any() else None,
        "drive": None if joint.drive is None else joint.drive.unloaded_stiffness,
        "spring": joint.spring,
        "law": None,
    }
    if joint.cross:
        out["axis2"] = joint.cross[1]
    if law is not None and along is not None:
        others = np.delete(bearing[along], along)
        if others.any():
            raise InputError(
                f"joints.{joint.name}: expected a bearing that does not couple the curved drive's "
                "motion with others, got one that does; leave out the curve or the coupling"
            )
        law = law.add_compliance(float(bearing[along, along]))
        out["law"] = {"starts": law.starts, "slopes": law.slopes}
    return out


def _tabulate_poses(
    mechanism: Mechanism, configurations: Configurations, names: Sequence[str]
) -> dict[str, Any]:
    """Return each pose: its command, displacements of bodies, lacks of fit, idle motions."""
    where = place_nodes(configurations)
    order = find_order(mechanism, configurations.linkage)
    offsets = own_loads(order, where).offsets
    nodes = {body.name: body.nodes[0] for body in mechanism.bodies}
    nodes[FOOT] = FOOT
    nodes[END] = END
    out = {}
    for k, name in enumerate(names):
        out[name] = {
            "commanded": dict(
                zip(mechanism.tool.pose, configurations.poses[k], strict=True)
            ),
            "frames": {n: _displacement(where, node, k) for n, node in nodes.items()},
            "offsets": {
                MOUNTS.get(n, n): twist[k if len(twist) > 1 else 0, :, 0]
                for n, twist in offsets.items()
            },
            "idle": _idle_axes(mechanism, configurations, k),
        }
    return out


def _displacement(where: Places, node: str, k: int) -> dict[str, Any]:
    """Return a node's displacement from home: x = R x_home + p, R as a rotation vector."""
    turn = where.rotation[node]
    move = where.position[node]
    vector = Rotation.from_matrix(turn[k if len(turn) > 1 else 0]).as_rotvec()
    return {"turned": vector, "moved": move[k if len(move) > 1 else 0]}


def _idle_axes(
    mechanism: Mechanism, configurations: Configurations, k: int
) -> dict[str, Array]:
    """Return, by joint, the axis about which a body spins idly there."""
    out = {}
    for idle in mobility(mechanism, configurations, k).idle:
        direction = idle.direction
        if direction is not None and direction.kind == "rotation":
            out[idle.joints[0]] = direction.axis
    return out


SCRIPT = '''"""{robot} as an EXUDYN model.

    python model.py                      sag and frequencies at the first pose, as JSON
    python model.py POSE                 at a pose, by name, or number from 1: {poses}
    python model.py POSE --wrench FX,FY,FZ,MX,MY,MZ    and the deflection under a wrench at M
    build(POSE).mbs                      the EXUDYN system, for statics, time integration or more

pip install exudyn

SI units; base axes at home. Wrench (f, m) and twist (v, omega) at the tool point M. `sag`: the
tool's small displacement under the robot's weight and lacks of fit, drives held at their commands.
A compliance is that of a body's later ends, its first clamped, in its axes at these ends, or of a
joint's second side in the joint's axes. A pose moves each body from home by x = R x_home + p
("turned": rotation vector of R, "moved": p). An "offset" is the twist of an element's unloaded
second end. A joint's "at" at home moves with its "bearer". "free": its free motions along and about
its axes; the second of a joint with "axis2" is about that axis of its second body. "driven": the
one that its drive holds. "compliance": None if the joint holds all others rigidly. "law":
deflections at which a drive's slope changes, and the slopes from there on, alike both ways.

"idle": axes of motions that nothing resists; a weak spring, N m/rad, holds them. "rigid": stiffness,
N/m, for rigid directions that no joint of EXUDYN holds. "length": the robot's size. Elastic bodies:
"condensed_mass" is the mass matrix of the ends, then of modes with all ends held, and "mode_squares"
(rad^2/s^2) are the squared angular frequencies of these (Craig-Bampton); without them, the body's
mass is shared by its ends.
"""

{imports}
MODEL = {model}

{runtime}

def build(pose: str = next(iter(MODEL["poses"])), *, linear: bool = False) -> Robot:
    """Return the robot at a pose; ``.mbs`` is its EXUDYN system, assembled."""
    return Robot(MODEL, pose, linear=linear)


if __name__ == "__main__":
    report(MODEL)
'''
_CUT = "# --- copied into exported models from here ---\n"


def write_script(robot: str, model: dict[str, Any]) -> str:
    """Return a script of tables and code that needs numpy, scipy and EXUDYN alone."""
    file = Path(__file__).with_name("exudyn_robot.py")
    source = re.sub(r" +# noqa.*", "", file.read_text(encoding="utf-8"))
    head, _, runtime = source.partition(_CUT)
    return SCRIPT.format(
        robot=robot,
        poses=list_some(list(model["poses"]), _NAMED),
        imports=head.partition('"""\n\n')[2],
        model=_show(model, 0),
        runtime=runtime.strip() + "\n",
    )


def _show(value: Any, depth: int) -> str:
    """Return a table as Python text: a line for each key, and for each row of a matrix."""
    inner = _INDENT * (depth + 1)
    outer = _INDENT * depth
    if isinstance(value, dict):
        if not value:
            return "{}"
        lines = [f"{inner}{k!r}: {_show(v, depth + 1)},\n" for k, v in value.items()]
        return "{\n" + "".join(lines) + outer + "}"
    if isinstance(value, np.ndarray) and value.ndim == 2:
        lines = [f"{inner}{_show(row, depth + 1)},\n" for row in value]
        return "[\n" + "".join(lines) + outer + "]"
    if isinstance(value, np.ndarray | list | tuple):
        return "[" + ", ".join(_show(row, depth) for row in value) + "]"
    if isinstance(value, np.floating | float):
        number = float(value)
        return repr(int(number)) + ".0" if number == 0.0 else repr(number)
    return repr(value)
