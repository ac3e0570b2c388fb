"""Models of simulators, URDF and MuJoCo's MJCF, at home: bodies, joints and closures.

Only geometry, masses, joints and limits are imported. Gains, springs, damping and contact
parameters serve control and time integration: they are reported for the user to judge.
"""

from __future__ import annotations

import fnmatch
from collections import defaultdict
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.errors import say_count
from stiffscope.imports.compiled_model import (
    GROUND,
    compile_at_home,
    print_safely,
)
from stiffscope.imports.model_inertia import EXCESS, describe_violations, violation
from stiffscope.imports.model_tool import find_tool, movable_coordinates
from stiffscope.robot.file.copies import SIX
from stiffscope.robot.file.tables import list_some

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from stiffscope.imports.compiled_model import CompiledModel
    from stiffscope.imports.model_loops import Loops
    from stiffscope.runtime.types import Array

_LEAST_MASS = 1e-8  # kg; less is the minimum that MuJoCo assigns to massless bodies
_SAME_POINT = 1e-9
_SQUARE = 1e-6
_DYNAMICS = "stiffness", "damping", "armature", "friction"
_WIDE = 10.0  # of the robot's size: radius of gyration beyond which an inertia is in another unit
_LISTED = 5  # joints of a note by name
_LARGE = 30.0  # m: hardly any arm is as large, unless its lengths are in mm


@dataclass(frozen=True)
class ModelBody:
    """A body and those welded to it: mass, kg, centre (3,), m, inertia (3, 3) about it, base axes.

    ``axes``: its own axes as columns. If elastic, it has a ``part`` with these, and its origin
    ``centre``.
    """

    name: str
    mass: float
    centre: Array
    inertia: Array
    part: str = ""
    axes: Array = field(default_factory=lambda: np.eye(3))
    note: str = ""


@dataclass(frozen=True)
class ModelJoint:
    """A joint as in a robot file; ``range``: displacements from home; ``note``: from the source.

    ``gain``: of a position servo, N·m/rad or N/m; ``dynamics``: stiffness, damping, armature, friction.
    """

    name: str
    first: str
    second: str
    kind: str
    at: Array
    axis: Array | None = None
    axis2: Array | None = None
    range: tuple[float, float] | None = None
    note: str = ""
    gain: float = 0.0
    dynamics: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class SimulatorModel:
    """A model at its home configuration, base axes, SI; ``notes``: omissions and guesses."""

    name: str
    bodies: tuple[ModelBody, ...]
    joints: tuple[ModelJoint, ...]
    tool_body: str
    tool_at: Array
    pose: tuple[str, ...]
    gravity: Array
    notes: tuple[str, ...]


def read_model(
    path: str | Path,
    tool: str | None = None,
    home: Mapping[str, float] | None = None,
    drives: Sequence[str] = (),
    loops: Loops | None = None,
) -> SimulatorModel:
    """Read a URDF or MJCF file, whose meshes need not exist, as a model at its home.

    ``tool``: body or site; by default a usually named site, else the last body of the longest
    chain. ``home``: positions of hinges (rad) and slides (m); by default those of the keyframe
    "home" or the zero pose, as far as loops permit. ``drives``: patterns of the driven joints.
    ``loops``: those of a URDF, which is a tree.
    Raises InputError if MuJoCo is missing, the file is not a model, loops do not close, or there is
    no such tool.
    """
    source = compile_at_home(Path(path), home or {}, loops)
    joints = _name_apart([*_tree_joints(source, drives), *_closing_joints(source)])
    beyond = [j.name for j in joints if j.range and not j.range[0] <= 0.0 <= j.range[1]]
    if beyond:
        other = "choose another with --home"
        source.notes.append(
            f"home of {_list_joints(beyond)} is beyond its range; {other}"
        )
    bodies = [
        _merge(source, number, name) for number, name in source.movers.items() if number
    ]
    bodies = _leave_out_impossible(source, bodies)
    bare = [body.name for body in bodies if not body.mass]
    if bare:
        source.notes.append(f"the source gives no mass of {list_some(bare)}")
    ends = {name for joint in joints for name in (joint.first, joint.second)}
    between = sorted(
        ends - {GROUND, *(body.name for body in bodies)}
    )  # two joints of one body
    held = list[int]()  # degrees of freedom of bodies that float
    for number, name in source.movers.items():  # a parent stands before its children
        if name not in find_distances(joints, GROUND):
            at = source.data.xpos[number].copy()
            joints.append(ModelJoint(f"{name}.held", GROUND, name, "fixed", at))
            held += np.flatnonzero(source.model.dof_bodyid == number).tolist()
            source.notes.append(
                f'"{name}" floats in the source; it is fixed to the ground here'
            )
    bodies += [ModelBody(name, 0.0, np.zeros(3), np.zeros((3, 3))) for name in between]
    _note_omissions(source, joints)
    source.notes += _doubt_units(joints, [body for body in bodies if body.mass])
    body, at, where = find_tool(source, tool)
    pose = movable_coordinates(source, body, at, held)
    source.notes.append(f"tool: {where}; check body and point")
    gravity = np.array(source.model.opt.gravity)
    notes = tuple(source.notes)
    model_name = source.model.names.partition(b"\0")[0].decode(errors="replace")
    name = print_safely(
        model_name
        if model_name.strip() and model_name != "MuJoCo Model"
        else source.path.stem
    )
    tool_of = source.mover(body), at, pose
    return SimulatorModel(name, tuple(bodies), tuple(joints), *tool_of, gravity, notes)


def _merge(source: CompiledModel, mover: int, name: str) -> ModelBody:
    """Merge a body with all bodies welded to it."""
    m = source.model
    d = source.data
    members = np.flatnonzero((m.body_weldid == mover) & (m.body_mass > _LEAST_MASS))
    mass = float(sum(m.body_mass[b] for b in members))
    centre = sum((m.body_mass[b] * d.xipos[b] for b in members), np.zeros(3)) / (
        mass or 1.0
    )
    inertia = np.zeros((3, 3))
    for b in members:
        r = d.xipos[b] - centre
        inertia += source.find_inertia(int(b))
        inertia += m.body_mass[b] * (r @ r * np.eye(3) - np.outer(r, r))
    return ModelBody(
        name, mass, centre, inertia, axes=d.xmat[mover].reshape(3, 3).copy()
    )


def _leave_out_impossible(
    source: CompiledModel, bodies: list[ModelBody]
) -> list[ModelBody]:
    """Return bodies without inertias that no body can have; add notes on all of these."""
    m = source.model
    beyond = "more than a body can have (A + B >= C)"
    fixed = [source.label("body", b) for b in source.aside if not m.body_weldid[b]]
    if fixed:
        source.notes.append(
            f"the inertia of {list_some(fixed)} is {beyond}; fixed to the ground, "
            "it is not used"
        )
    out = list[ModelBody]()
    left = list[ModelBody]()
    for body in bodies:
        if body.mass and violation(body.inertia) > EXCESS:
            left.append(body)
            given = ", ".join(f"{moment:.4g}" for moment in body.inertia[SIX])
            note = f"inertia [{given}] of the source is left out: no body has it"
            out.append(replace(body, inertia=np.zeros((3, 3)), note=note))
        else:
            out.append(body)
    names = [body.name for body in left]
    taken = [
        b
        for b in source.aside
        if m.body_weldid[b]
        and m.body_mass[b] > _LEAST_MASS
        and source.mover(b) not in names
    ]
    if taken:
        own = [source.label("body", b) for b in taken]
        told = describe_violations(own, (source.aside[b] for b in taken))
        source.notes.append(f"the inertia of {told} is {beyond}; taken as given")
    if left:
        told = describe_violations(names, (body.inertia for body in left))
        need = "stiffness and sag do not need it, natural frequencies do"
        source.notes.append(
            f"the inertia of {told} is {beyond}, all that is fixed to it included; "
            f"left out: {need}"
        )
    return out


def _note_omissions(source: CompiledModel, joints: Iterable[ModelJoint]) -> None:
    m = source.model
    fixed = [
        b
        for b in range(1, m.nbody)
        if not m.body_weldid[b] and m.body_mass[b] > _LEAST_MASS
    ]
    if fixed:
        listed = list_some(
            [f"{source.label('body', b)} {m.body_mass[b]:.4g} kg" for b in fixed]
        )
        source.notes.append(f"bodies fixed to the ground have no mass here: {listed}")
    source.notes += _note_dynamics(list(joints))
    others = [
        name
        for name, number in source.labels("actuator", m.nu).items()
        if not _moves_joint(source, number)
    ]
    for word, names in (
        ("tendons", source.labels("tendon", m.ntendon)),
        ("actuators of no joint", others),
    ):
        if names:
            source.notes.append(f"{word} are left out: {list_some([*names])}")
    lifted = [name for number, name in source.movers.items() if m.body_gravcomp[number]]
    if lifted:
        source.notes.append(
            f"gravity compensation (gravcomp) of {list_some(lifted)} is left out: the whole weight acts here"
        )
    if (
        m.opt.disableflags & int(source.mj.mjtDisableBit.mjDSBL_GRAVITY)
        and m.opt.gravity.any()
    ):
        source.notes.append("the source disables gravity; it acts here")


def _note_dynamics(joints: Sequence[ModelJoint]) -> Iterator[str]:
    """Yield notes on springs, damping and gains of the source, a note for words of alike joints."""
    told = defaultdict[tuple[str, ...], list[str]](list)  # words by joints
    for word in _DYNAMICS:
        names = [joint.name for joint in joints if joint.dynamics.get(word)]
        told[tuple(names)] += [word] if names else []
    for names, words in told.items():
        if words:
            of = f"the source's {' and '.join(words)} of {_list_joints(names)}"
            verb = "is" if len(words) == 1 else "are"
            yield f"{of} {verb} not taken, but written beside the joint"
    for sign, fate in (
        (1, "written beside the joint, not taken"),
        (-1, "below zero and left out"),
    ):
        names = [joint.name for joint in joints if joint.gain * sign > 0]
        if names:
            yield f"position gains (kp) of {_list_joints(names)} are {fate}"


def _list_joints(names: Sequence[str]) -> str:
    """Return the names of joints, of many the first and their number."""
    if len(names) <= _LISTED:
        return ", ".join(names)
    return f"{', '.join(names[:_LISTED])}, … ({len(names)} joints)"


def _doubt_units(joints: list[ModelJoint], bodies: list[ModelBody]) -> Iterator[str]:
    """Yield notes on lengths and inertias that are probably in another unit."""
    places = np.array([joint.at for joint in joints] or np.zeros((1, 3)))
    far = float(np.abs(places).max())
    if far > _LARGE:
        yield f"joints are up to {far:.3g} m from the origin: check that lengths of the source are in m"
    size = float(
        np.linalg.norm(np.ptp([*places, *(body.centre for body in bodies)], axis=0))
    )
    largest = (_WIDE * size) ** 2 or np.inf
    wide = ", ".join(
        b.name for b in bodies if np.linalg.eigvalsh(b.inertia)[-1] / b.mass > largest
    )
    if wide:
        larger = f"the inertia of {wide} is that of a body far larger than the robot ({size:.3g} m)"
        yield f"{larger}: check that it is in kg·m²"


def _tree_joints(source: CompiledModel, drives: Sequence[str]) -> Iterator[ModelJoint]:
    """Yield the tree's joints; several joints of a body form a chain of massless bodies."""
    m = source.model
    for body, name in source.movers.items():
        first = int(m.body_jntadr[body])
        count = int(m.body_jntnum[body])
        tree_joints = [_tree_joint(source, first + n) for n in range(count)]
        joints = [joint for joint in tree_joints if joint is not None]
        if _are_universal(joints, drives):
            one, two = joints
            joints = [replace(one, kind="universal", axis2=two.axis)]
            merged = f"{one.name} and {two.name} of {name} are one universal joint here, {one.name}"
            source.notes.append(f"{merged}; name one with --drive to have two")
        parent = source.mover(int(m.body_parentid[body])) if body else GROUND
        for place, joint in enumerate(joints):
            here = name if place == len(joints) - 1 else f"{name}.{place + 1}"
            yield replace(joint, first=parent, second=here)
            parent = here


def _tree_joint(source: CompiledModel, number: int) -> ModelJoint | None:
    """Return a hinge, slide or ball joint; None for a free joint, which constrains nothing."""
    m = source.model
    d = source.data
    words = {"HINGE": "revolute", "SLIDE": "prismatic", "BALL": "spherical"}
    of = m.jnt_type[number]
    kinds = (
        words[word] for word in words if source.is_a(of, "mjtJoint", f"mjJNT_{word}")
    )
    kind = next(kinds, None)
    if kind is None:
        return None
    axis = None
    limits = None
    name = source.label("joint", number)
    if kind != "spherical":
        axis = d.xaxis[number].copy()
        if m.jnt_limited[number]:
            here = float(d.qpos[m.jnt_qposadr[number]])
            low, high = (float(limit) - here for limit in m.jnt_range[number])
            limits = low, high
        elif m.jnt_range[number, 0] > m.jnt_range[number, 1]:
            source.notes.append(
                f"limits of {name} are left out: the lower is above the upper"
            )
    note, gain = _actuator(source, number)
    dof = int(m.jnt_dofadr[number])
    at = d.xanchor[number].copy()
    properties = (
        m.jnt_stiffness[number],
        m.dof_damping[dof],
        m.dof_armature[dof],
        m.dof_frictionloss[dof],
    )
    sizes = (float(np.ravel(values)[0]) for values in properties)
    pairs = zip(_DYNAMICS, sizes, strict=True)
    dynamics = {word: size for word, size in pairs if size}
    return ModelJoint(
        name=name,
        first="",
        second="",
        kind=kind,
        at=at,
        axis=axis,
        axis2=None,
        range=limits,
        note=note,
        gain=gain,
        dynamics=dynamics,
    )


def _actuator(source: CompiledModel, joint: int) -> tuple[str, float]:
    """Return a note on a joint's actuator, and its stiffness if it is a position servo."""
    m = source.model
    for number in np.flatnonzero(m.actuator_trnid[:, 0] == joint):
        if _moves_joint(source, int(number)):
            gain = (
                -float(m.actuator_biasprm[number, 1])
                * float(m.actuator_gear[number, 0]) ** 2
            )
            return (
                f'actuator "{source.label("actuator", int(number))}" of the source',
                gain,
            )
    return "", 0.0


def _moves_joint(source: CompiledModel, actuator: int) -> bool:
    return source.is_a(
        source.model.actuator_trntype[actuator],
        "mjtTrn",
        "mjTRN_JOINT",
        "mjTRN_JOINTINPARENT",
    )


def _closing_joints(source: CompiledModel) -> Iterator[ModelJoint]:
    """Yield equalities as joints: connects by their number and places, welds as fixed joints."""
    m = source.model
    closing = source.closures()
    connects: dict[tuple[str, str], list[tuple[str, Array]]] = {}
    for number in range(m.neq):
        name = source.label("equality", number)
        if not m.eq_active0[number]:
            source.notes.append(
                f'equality "{name}" is not active in the source and is left out'
            )
        elif number not in closing:
            coupled = _describe_coupling(source, number)
            source.notes.append(f'equality "{name}" couples {coupled}; it is left out')
        else:
            first, second, at = source.closure_ends(number)
            if first == second:
                continue
            if source.is_a(m.eq_type[number], "mjtEq", "mjEQ_WELD"):
                yield ModelJoint(name, first, second, "fixed", at)
            else:
                connects.setdefault((first, second), []).append((name, at))
    for (first, second), points in connects.items():
        yield _closing_joint(first, second, points)


def _describe_coupling(source: CompiledModel, number: int) -> str:
    m = source.model
    if not source.is_a(m.eq_type[number], "mjtEq", "mjEQ_JOINT"):
        return "coordinates, which no joint does"
    ends = int(m.eq_obj1id[number]), int(m.eq_obj2id[number])
    names = [source.label("joint", end) for end in ends if end >= 0]
    return (
        f"the coordinates of joints {' and '.join(names)} (mimic), which no joint does"
    )


def _closing_joint(
    first: str, second: str, points: list[tuple[str, Array]]
) -> ModelJoint:
    """Combine the connects of two bodies: spherical, revolute about their line, or fixed joint."""
    name, at = points[0]
    away = [point - at for _, point in points[1:]]
    _, sizes, rows = np.linalg.svd(np.array(away).reshape(-1, 3))
    if sizes.max(initial=0.0) < _SAME_POINT:
        return ModelJoint(name, first, second, "spherical", at)
    note = f"{say_count(len(points), 'connect')} of the source"
    if len(sizes) < 2 or sizes[1] < 1e-6 * sizes[0]:
        return ModelJoint(
            name=name,
            first=first,
            second=second,
            kind="revolute",
            at=at,
            axis=rows[0],
            note=f"{note}, on one line",
        )
    return ModelJoint(name, first, second, "fixed", at, note=note)


def _name_apart(joints: Iterable[ModelJoint]) -> list[ModelJoint]:
    """Return the joints with unique names."""
    by_name = dict[str, ModelJoint]()
    for joint in joints:
        name = joint.name
        while name in by_name or name == GROUND:
            name += ".joint"
        by_name[name] = replace(joint, name=name)
    return list(by_name.values())


def find_distances(joints: Iterable[Any], ground: Any) -> dict[Any, int]:
    """Return the distance from the ground, in joints, of everything that joints connect to it."""
    ends = [
        (a, b) for j in joints for a, b in ((j.first, j.second), (j.second, j.first))
    ]
    distances = {ground: 0}
    new = {ground}
    while new:
        new = {b for a, b in ends if a in new} - distances.keys()
        distances |= dict.fromkeys(new, max(distances.values()) + 1)
    return distances


def _are_universal(joints: list[ModelJoint], drives: Sequence[str]) -> bool:
    """Return whether these are two hinges without drives and ranges that cross at right angles."""
    if len(joints) != 2 or any(
        joint.kind != "revolute" or joint.note or joint.range for joint in joints
    ):
        return False
    if any(
        joint.name in drives
        or any(fnmatch.filter([joint.name], drive) for drive in drives)
        for joint in joints
    ):
        return False
    one, two = joints
    cosine = np.vdot(np.asarray(one.axis), np.asarray(two.axis))
    return bool(
        np.linalg.norm(one.at - two.at) <= _SAME_POINT and abs(cosine) <= _SQUARE
    )
