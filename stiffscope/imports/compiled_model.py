"""A simulator's model, URDF or MJCF, compiled by MuJoCo, at its home with all loops closed."""

from __future__ import annotations

import contextlib
import re
import warnings
from dataclasses import dataclass, field
from functools import cached_property
from itertools import chain, repeat
from typing import TYPE_CHECKING, Any
from xml.parsers import expat

import numpy as np
from numpy.polynomial.polynomial import polyval

from stiffscope.errors import InputError, naming, require, suggest
from stiffscope.imports.model_inertia import set_aside_inertias
from stiffscope.imports.model_loops import close_loops
from stiffscope.robot.file.quantities import ANGLE, LENGTH, to_si
from stiffscope.robot.file.tables import list_some, unknown_key
from stiffscope.runtime.reading import MOST_BYTES, read_text

if TYPE_CHECKING:
    from collections.abc import Container, Iterator, Mapping
    from pathlib import Path

    from stiffscope.imports.model_loops import Loops
    from stiffscope.runtime.types import Array

GROUND = "ground"
CLOSED = 1e-10  # m, rad: largest error of a closed loop
_MOVED = 1e-6  # m, rad: less is not worth a note
_ROUNDS = 500
_INDEPENDENT = 1e-9  # of the largest: singular values of directions that loops hold
_LEAST_DAMPING = 1e-6  # of the square of the largest singular value
_MOST_DAMPING = 1e9
_MODEL = "a model in URDF or MJCF"
_TURN = 1.01 * 2.0 * np.pi  # rad: hardly any angle is larger, unless it is in degrees
_FARTHEST = 1e6  # m: of a place in a model
_URDF = {
    "origin": ("xyz", "rpy"),
    "axis": ("xyz",),
    "mass": ("value",),
    "limit": ("lower", "upper", "effort", "velocity"),
    "inertia": ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"),
}
"""Elements of URDF that hold a robot's numbers, and the attributes of each."""


@dataclass
class CompiledModel:
    """A model compiled by MuJoCo and its state at home; ``notes``: omissions and guesses so far."""

    mj: Any
    path: Path
    model: Any
    data: Any
    notes: list[str] = field(default_factory=list)
    aside: Mapping[int, Array] = field(default_factory=dict)
    """Impossible inertias (3, 3) as given, in the axes of each body, by its number."""

    def find_inertia(self, body: int) -> Array:
        """Return the inertia (3, 3) of a body about its centre of mass, base axes, as given."""
        inertia = self.aside.get(body)
        if inertia is not None:
            axes = self.data.xmat[body].reshape(3, 3)
            return axes @ inertia @ axes.T
        axes = self.data.ximat[body].reshape(3, 3)
        return axes @ np.diag(self.model.body_inertia[body]) @ axes.T

    @cached_property
    def movers(self) -> dict[int, str]:
        """Names of the ground and of moving bodies by number; bodies welded to one belong to it."""
        taken: dict[str, int] = {}
        for body in range(1, self.model.nbody):
            if self.model.body_weldid[body] == body:
                name = self.label("body", body)
                taken[f"{name}_body" if name == GROUND or name in taken else name] = (
                    body
                )
        return {0: GROUND} | {body: name for name, body in taken.items()}

    def label(self, kind: str, number: int) -> str:
        """Return an object's name, printable and on one line, or a generated name."""
        objects = getattr(self.mj.mjtObj, f"mjOBJ_{kind.upper()}")
        name = self.mj.mj_id2name(self.model, objects, number)
        return print_safely(name or f"{kind}{number}").replace('"', "'")

    def labels(self, kind: str, count: int, first: int = 0) -> dict[str, int]:
        """Return the numbers of all objects of a kind, by name."""
        return {self.label(kind, number): number for number in range(first, count)}

    def mover(self, body: int) -> str:
        """Return the name of the moving body to which a body is welded."""
        return self.movers[int(self.model.body_weldid[body])]

    def is_a(self, value: int, enum: str, *names: str) -> bool:
        """Return whether a value is one of the named members of a MuJoCo enumeration."""
        return value in {int(getattr(getattr(self.mj, enum), name)) for name in names}

    def closure_ends(self, number: int) -> tuple[str, str, Array]:
        """Return both bodies and the point (3,) of an equality that connects or welds."""
        m = self.model
        d = self.data
        ends = int(m.eq_obj1id[number]), int(m.eq_obj2id[number])
        if self.is_a(m.eq_objtype[number], "mjtObj", "mjOBJ_SITE"):
            first, second = (self.mover(int(m.site_bodyid[site])) for site in ends)
            return first, second, d.site_xpos[ends[0]].copy()
        body = ends[self.is_a(m.eq_type[number], "mjtEq", "mjEQ_WELD")]
        at = d.xpos[body] + d.xmat[body].reshape(3, 3) @ m.eq_data[number, :3]
        return self.mover(ends[0]), self.mover(ends[1]), at

    def closures(self) -> list[int]:
        """Return the numbers of the equalities that connect or weld bodies."""
        kinds = enumerate(self.model.eq_type)
        return [
            n
            for n, kind in kinds
            if self.is_a(kind, "mjtEq", "mjEQ_CONNECT", "mjEQ_WELD")
        ]

    def equality_rows(self, closures_only: bool = False) -> tuple[Array, Array]:
        """Return gap (m,) and Jacobian (m, nv) of all active equalities, or only of closures."""
        m = self.model
        d = self.data
        rows = d.efc_type == self.mj.mjtConstraint.mjCNSTR_EQUALITY
        if closures_only:
            rows &= np.isin(d.efc_id, self.closures())
        if self.mj.mj_isSparse(m):
            dense = np.zeros((d.nefc, m.nv))
            self.mj.mju_sparse2dense(
                dense, d.efc_J, d.efc_J_rownnz, d.efc_J_rowadr, d.efc_J_colind
            )
        else:
            dense = d.efc_J.reshape(d.nefc, m.nv)
        return d.efc_pos[rows].copy(), dense[rows].copy()


def print_safely(text: str) -> str:
    """Replace unprintable characters, so that a text is safe in a file or terminal, on one line."""
    return "".join(letter if letter.isprintable() else "_" for letter in text)


def compile_at_home(
    path: Path, home: Mapping[str, float], loops: Loops | None = None
) -> CompiledModel:
    """Compile a model, whose meshes need not exist, and evaluate its kinematics at home.

    ``home``: positions of hinges (rad) and slides (m); by default keyframe "home" or the zero pose.
    ``loops``: loops of a URDF.
    Raises InputError if MuJoCo is missing, the file is not a model, or its loops do not close.
    """
    try:
        import mujoco
    except ImportError as error:
        absent = isinstance(error, ModuleNotFoundError) and error.name == "mujoco"
        got = "none" if absent else f"one that does not load ({_reason(error)})"
        raise InputError(
            f"import: expected the package mujoco, which reads URDF and MJCF, got {got}; "
            "install it by: python -m pip install --upgrade mujoco"
        ) from error
    content = read_text(path, _MODEL, MOST_BYTES).encode()
    doubts = _check_urdf(path, content) if is_urdf(content) else []
    library: Any = mujoco
    said: list[str] = []
    library.set_mju_user_warning(said.append)  # default: MUJOCO_LOG.TXT
    try:
        with warnings.catch_warnings(record=True) as warned:
            warnings.simplefilter("always")
            model, notes, aside = _compile(library, path, content, loops)
        said += [str(warning.message) for warning in warned]
        _check_finite(path, model)
        model.opt.disableflags &= ~int(library.mjtDisableBit.mjDSBL_EQUALITY)
        compiled = CompiledModel(
            mj=library,
            path=path,
            model=model,
            data=library.MjData(model),
            notes=notes,
            aside=aside,
        )
        _go_home(compiled, home)
    finally:
        library.set_mju_user_warning(None)
    if any("'NaN'" in note for note in said):
        raise InputError(f"{path}: expected {_MODEL} whose numbers are finite, got NaN")
    compiled.notes += [print_safely(doubt) for doubt in [*doubts, *dict.fromkeys(said)]]
    return compiled


def is_urdf(content: bytes) -> bool:
    """Return whether a file's first element is that of URDF."""
    first = re.search(rb"<([A-Za-z]\w*)", re.sub(rb"(?s)<!--.*?(-->|\Z)", b"", content))
    return first is not None and first[1] == b"robot"


def _compile(
    mj: Any, path: Path, content: bytes, loops: Loops | None
) -> tuple[Any, list[str], dict[int, Array]]:
    """Return the compiled model, notes on omissions, and impossible inertias by body."""
    many = re.search(rb"<replicate\b[^>]*\bcount\s*=\s*.0*[1-9]\d{4}", content)
    if many:
        line = content[: many.end()].count(b"\n") + 1
        raise InputError(
            f"{path}:{line}: replicate.count: expected less than 10,000 copies, got 10,000 or more"
        )
    try:
        if path.suffix in {".urdf", ".xml"}:
            spec = mj.MjSpec.from_file(str(path))
        else:  # MuJoCo knows its files by their names
            spec = mj.MjSpec.from_string(content.decode(errors="replace"))
        spec.compiler.fusestatic = 0
        never, auto = (
            getattr(mj.mjtInertiaFromGeom, f"mjINERTIAFROMGEOM_{choice}")
            for choice in ("FALSE", "AUTO")
        )
        if is_urdf(content) and spec.compiler.inertiafromgeom == auto:
            spec.compiler.inertiafromgeom = (
                never  # a link without <inertial> has no mass, not that of water
            )
        _check_spec(path, spec)
        least = (
            spec.compiler
        )  # minimum mass and inertia, which moving bodies need to compile
        least.boundmass = max(least.boundmass, 1e-9)
        least.boundinertia = max(least.boundinertia, 1e-15)
        balanced = bool(least.balanceinertia)
        aside = set_aside_inertias(mj, spec)
        notes = [] if loops is None else close_loops(mj, spec, loops, content)
        if balanced and aside:
            mean = "which would replace an inertia by its mean"
            notes.append(f"balanceinertia of the source, {mean}, is not applied")
        trial = spec.copy()
        try:
            model = trial.compile()
        except ValueError as error:
            bare = "a body whose mass would come from a mesh has none here"
            notes += [f"read without its meshes ({_reason(error)})", bare]
            trial = spec
            _drop_meshes(mj, trial)
            model = trial.compile()
        by_body = {int(trial.bodies[index].id): each for index, each in aside.items()}
    except InputError:
        raise
    except (ValueError, OSError, RuntimeError) as error:
        reason = _reason(error)
        expected = f"{_MODEL}, or an assembly in a .step file"
        raise InputError(
            f"{_place(path, reason)}: expected {expected}, got: {reason}"
        ) from error
    return model, notes, by_body


def _drop_meshes(mj: Any, spec: Any) -> None:
    """Delete a spec's meshes and all that needs them; materials stay, without their textures."""
    kinds = mj.mjtGeom.mjGEOM_MESH, mj.mjtGeom.mjGEOM_HFIELD, mj.mjtGeom.mjGEOM_SDF
    shapes = [geom for geom in spec.geoms if geom.type in kinds]
    for material in spec.materials:
        material.textures = list(repeat("", len(material.textures)))
    others = spec.meshes, spec.textures, spec.hfields, spec.skins
    unused = (
        spec.pairs,
        spec.sensors,
    )  # may name a deleted geom; nothing here reads them
    for shape in [*shapes, *chain(*others), *chain(*unused)]:
        spec.delete(shape)


def _place(path: Path, reason: str) -> str:
    """Return the file and the line that MuJoCo names, if any."""
    line = re.search(r"\bline (?:number=)?(\d+)", reason, re.IGNORECASE)
    return f"{path}:{line[1]}" if line else str(path)


def _check_urdf(path: Path, content: bytes) -> list[str]:
    """Refuse misspelled words, numbers not finite and repeated names, which MuJoCo accepts; return notes."""
    parser, opened = expat.ParserCreate(), list[str]()
    doubts: dict[str, list[str]] = {}  # lines of each note
    named, joint = set[tuple[str, str]](), dict[str, str]()

    def look(element: str, attributes: Mapping[str, str]) -> None:
        place = f"{path}:{parser.CurrentLineNumber}: {print_safely(element)}"
        got = 'one to be converted ("xacro FILE.xacro > FILE.urdf")'
        is_macro = element.startswith("xacro:")
        require(not is_macro, place, "a URDF without xacro", got)
        known = element in {*_URDF, "inertial"}
        guess = "" if known else suggest(element, _URDF, cutoff=0.8)
        require(not guess, place, "an element of URDF", f'"{element}"{guess}')
        if len(opened) == 1 and element in {"link", "joint"}:
            name = attributes.get("name", "")
            got = f'{name and "another "}"{name}"'
            is_new = name and (element, name) not in named
            require(is_new, f"{place}.name", "a name of its own", got)
            named.add((element, name))
            joint.clear()
            joint.update(attributes)
        opened.append(element)
        line = str(parser.CurrentLineNumber)
        for doubt in _doubt(element, attributes, joint):
            doubts.setdefault(doubt, []).append(line)
        if element in _URDF:
            _check_attributes(place, element, attributes, joint)

    parser.EndElementHandler = lambda _: opened.pop()
    parser.StartElementHandler = look
    with contextlib.suppress(expat.ExpatError):  # MuJoCo says what is wrong
        parser.Parse(content, True)
    return [
        f"{'line' if len(lines) == 1 else 'lines'} {list_some(lines, 4)}: {text}"
        for text, lines in doubts.items()
    ]


def _check_attributes(
    place: str,
    element: str,
    attributes: Mapping[str, str],
    joint: Mapping[str, str],
) -> None:
    """Refuse unknown attributes of a URDF's element, and numbers that no robot has."""
    for name, text in attributes.items():
        if name not in _URDF[element]:
            if _is_drivers_word(element, name, attributes):
                continue
            raise InputError(f"{place}: {unknown_key(name, _URDF[element])}")
        words = {word.lower().lstrip("+-") for word in text.split()}
        endless = name in {"effort", "velocity"} or (
            element == "limit" and joint.get("type") == "continuous"
        )
        where = f"{place}.{name}"
        finite = endless or not words & {"inf", "nan", "infinity"}
        require(finite, where, "finite numbers", f'"{text}"')
        negative = element == "mass" and text.strip().startswith("-")
        require(not negative, where, "no mass below zero", f'"{text}"')


def _is_drivers_word(element: str, name: str, attributes: Mapping[str, str]) -> bool:
    """Return whether an unknown attribute is a driver's own limit, not a range misspelled."""
    ranges = [key for key in ("lower", "upper") if key not in attributes]
    return element == "limit" and not suggest(name, ranges, cutoff=0.65)


def _doubt(
    element: str, attributes: Mapping[str, str], joint: Mapping[str, str]
) -> Iterator[str]:
    """Yield notes on an element of a URDF, the last joint so far given by its attributes."""
    if element == "mimic" and attributes.get("joint") == joint.get("name"):
        yield f"joint {joint.get('name')} mimics itself, which is left out"
    words = attributes if element == "limit" else ()
    for name in (word for word in words if word not in _URDF["limit"]):
        yield f"{element}.{print_safely(name)}, which URDF does not know, is left out"
    turns = element == "origin" or (
        element == "limit" and joint.get("type") == "revolute"
    )
    for key in ("rpy", "lower", "upper") if turns else ():
        with contextlib.suppress(ValueError):  # MuJoCo says what is wrong
            if (
                max(
                    (abs(float(word)) for word in attributes.get(key, "").split()),
                    default=0.0,
                )
                > _TURN
            ):
                yield f'{element}.{key} = "{attributes[key]}" is beyond 2π rad: is it in degrees?'


def _check_spec(path: Path, spec: Any) -> None:
    for quantity, unit, what, things in (
        ("mass", "kg", "body", spec.bodies),
        ("mass", "kg", "geom", spec.geoms),
        ("inertia", "kg*m^2", "body", spec.bodies),
        ("density", "kg/m^3", "geom", spec.geoms),
    ):
        for thing in things:
            value = np.min(getattr(thing, quantity))
            got = f'{value:g} {unit} of {what} "{print_safely(thing.name)}"'
            where = _place(path, thing.info)
            require(not value < 0, where, f"no {quantity} below zero", got)


def _reason(error: Exception) -> str:
    return print_safely(" ".join(str(error).removeprefix("Error: ").split()))


def _check_finite(path: Path, m: Any) -> None:
    bodies = (
        m.body_pos,
        m.body_quat,
        m.body_ipos,
        m.body_iquat,
        m.body_mass,
        m.body_inertia,
    )
    numbers = *bodies, m.jnt_pos, m.jnt_axis, m.eq_data, m.opt.gravity
    finite = all(np.isfinite(number).all() for number in numbers)
    # the square of a farthest centre of mass is still a number
    far = (
        np.abs(m.body_pos).max() > _FARTHEST or np.abs(m.body_ipos).max() > _FARTHEST**2
    )
    what = f"whose numbers are finite, and its places within {_FARTHEST:g} m"
    require(finite and not far, path, f"{_MODEL} {what}", "others")


def _go_home(compiled: CompiledModel, wanted: Mapping[str, float]) -> None:
    """Set keyframe "home" or the zero pose, and given joints; close all loops."""
    m = compiled.model
    d = compiled.data
    mj = compiled.mj
    key = mj.mj_name2id(m, mj.mjtObj.mjOBJ_KEY, "home")
    if key >= 0:
        mj.mj_resetDataKeyframe(m, d, key)
        compiled.notes.append('home is the keyframe "home" of the source')
    expected = f"{_MODEL} whose home is finite numbers"
    require(np.isfinite(d.qpos).all(), compiled.path, expected, "others")
    joints = {
        name: each
        for name, each in compiled.labels("joint", m.njnt).items()
        if compiled.is_a(m.jnt_type[each], "mjtJoint", "mjJNT_HINGE", "mjJNT_SLIDE")
    }
    couplings = _couplings(compiled, {joints[n] for n in wanted if n in joints})
    free = {
        name: number
        for name, number in joints.items()
        if name not in wanted and number not in couplings
    }
    _enter_ranges(compiled, free)
    for name, value in wanted.items():
        where = f"--home {name}"
        expected = f"a joint that turns or slides ({', '.join(joints)})"
        require(name in joints, where, expected, f'"{name}"')
        number = joints[name]
        slides = compiled.is_a(m.jnt_type[number], "mjtJoint", "mjJNT_SLIDE")
        with naming(where):
            to_si(value, LENGTH if slides else ANGLE, sign="any")
        low, high = m.jnt_range[number]
        within = low <= value <= high or not m.jnt_limited[number]
        expected = f"a position within its range, {low:.4g} to {high:.4g}"
        require(within, where, expected, f"{value:.4g} (m or rad)")
        d.qpos[m.jnt_qposadr[number]] = value
    _lead(compiled, {joints[name] for name in wanted})
    _follow(compiled, couplings)
    _close_loops(compiled)
    _note_moved(compiled, {name: joints[name] for name in wanted}, wanted)


def _couplings(compiled: CompiledModel, wanted: Container[int]) -> dict[int, int]:
    """Return the joints, not of those wanted, that follow another (mimic), and their equalities."""
    m = compiled.model
    return {
        int(m.eq_obj1id[number]): number
        for number in np.flatnonzero(m.eq_active0).tolist()
        if compiled.is_a(m.eq_type[number], "mjtEq", "mjEQ_JOINT")
        and int(m.eq_obj1id[number]) not in wanted
    }


def _lead(compiled: CompiledModel, wanted: Container[int]) -> None:
    """Put leaders where their followers of a linear law want them, unless wanted themselves."""
    m = compiled.model
    d = compiled.data
    every = _couplings(compiled, ())
    chain = [joint for joint in every if joint in wanted]
    for joint in chain:  # grows by leaders that follow others themselves
        number = every[joint]
        leader = int(m.eq_obj2id[number])
        offset, slope, *higher = m.eq_data[number, :5]
        if (
            leader < 0
            or leader in wanted
            or leader in chain
            or not slope
            or any(higher)
        ):
            continue
        moved = d.qpos[m.jnt_qposadr[joint]] - m.qpos0[m.jnt_qposadr[joint]]
        there = m.jnt_qposadr[leader]
        d.qpos[there] = m.qpos0[there] + (moved - offset) / slope
        if leader in every:
            chain.append(leader)


def _note_moved(
    compiled: CompiledModel, joints: Mapping[str, int], wanted: Mapping[str, float]
) -> None:
    """Add a note on joints that do not stand where ``--home`` puts them, as loops would open."""
    m = compiled.model
    there = {
        name: float(compiled.data.qpos[m.jnt_qposadr[number]])
        for name, number in joints.items()
    }
    moved = [
        f"{name} at {at:.6g} instead of {wanted[name]:.6g}"
        for name, at in there.items()
        if abs(at - wanted[name]) > _MOVED
    ]
    if moved:
        compiled.notes.append(
            f"home has {list_some(moved, 5)} (m or rad), as loops and joints that follow "
            "others do not close otherwise"
        )


def _follow(compiled: CompiledModel, couplings: Mapping[int, int]) -> None:
    """Put joints that follow others where these have them; closing would move the leaders too."""
    m = compiled.model
    d = compiled.data
    leaders = {joint: int(m.eq_obj2id[number]) for joint, number in couplings.items()}
    while leaders:
        ready = [joint for joint, leader in leaders.items() if leader not in leaders]
        if not ready:  # they follow each other in a circle
            return
        for joint in ready:
            leader = leaders.pop(joint)
            moved = 0.0
            if leader >= 0:
                there = m.jnt_qposadr[leader]
                moved = d.qpos[there] - m.qpos0[there]
            at = m.jnt_qposadr[joint]
            law = m.eq_data[couplings[joint], :5]
            d.qpos[at] = m.qpos0[at] + polyval(moved, law)


def _enter_ranges(compiled: CompiledModel, joints: Mapping[str, int]) -> None:
    """Put joints that would stand beyond their ranges at the nearest limit; add a note."""
    m = compiled.model
    d = compiled.data
    beyond = list[str]()
    for name, number in joints.items():
        low, high = m.jnt_range[number]
        at = m.jnt_qposadr[number]
        if m.jnt_limited[number] and low <= high and not low <= d.qpos[at] <= high:
            d.qpos[at] = np.clip(d.qpos[at], low, high)
            beyond.append(name)
    if beyond:
        compiled.notes.append(
            f"home of {list_some(beyond, 5)} is beyond its range: it stands at the nearest "
            "limit instead; choose another with --home"
        )


def _close_loops(compiled: CompiledModel) -> None:
    """Close all loops by steps of least squares, damped where a full step opens them wider.

    References
    ----------
    D. W. Marquardt, An algorithm for least-squares estimation of nonlinear parameters, J. SIAM 11
    (1963) 431-441.
    """
    m = compiled.model
    d = compiled.data
    mj = compiled.mj
    mj.mj_forward(m, d)
    gap, jacobian = compiled.equality_rows()
    damping = 0.0
    for _ in range(_ROUNDS):
        if np.abs(gap).max(initial=0.0) < CLOSED:
            return
        before = d.qpos.copy()
        u, sizes, rows = np.linalg.svd(jacobian, full_matrices=False)
        largest = sizes[0]
        able = sizes > _INDEPENDENT * largest
        gain = np.zeros_like(sizes)
        gain[able] = sizes[able] / (sizes[able] ** 2 + damping * largest**2)
        mj.mj_integratePos(m, d.qpos, -rows.T @ (gain * (u.T @ gap)), 1.0)
        mj.mj_forward(m, d)
        new_gap, new_jacobian = compiled.equality_rows()
        if np.linalg.norm(new_gap) < np.linalg.norm(gap):
            gap = new_gap
            jacobian = new_jacobian
            damping = damping / 10.0 if damping > _LEAST_DAMPING else 0.0
        else:
            d.qpos[:] = before
            mj.mj_forward(m, d)
            damping = max(10.0 * damping, _LEAST_DAMPING)
            if damping > _MOST_DAMPING:
                break
    if np.abs(gap).max() < CLOSED:
        return
    number = _widest(compiled, gap)
    name = compiled.label("equality", number)
    ends = ""
    if number in compiled.closures():
        first, second, _ = compiled.closure_ends(number)
        ends = f" of {first} and {second}"
    raise InputError(
        f"{compiled.path}: expected loops that close, got a gap of {np.abs(gap).max():.3g} "
        f"(m or rad) at {name}{ends}; choose another home with --home"
    )


def _widest(compiled: CompiledModel, gap: Array) -> int:
    """Return the number of the equality with the largest gap (m,)."""
    d = compiled.data
    rows = d.efc_type == compiled.mj.mjtConstraint.mjCNSTR_EQUALITY
    return int(d.efc_id[rows][np.abs(gap).argmax()])
