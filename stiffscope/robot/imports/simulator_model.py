"""Models of simulators, URDF and MuJoCo's MJCF, read by MuJoCo's own parser: bodies, joints and closures at home.

Only geometry, masses, joints and their limits are taken. A simulator's damping, spring and contact numbers serve its
time integration and say nothing of a machine's stiffness.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.errors import InputError
from stiffscope.runtime.reading import open_file, read_bytes

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

log = logging.getLogger(__name__)

GROUND = "ground"
CLOSED = 1e-10  # m, rad: largest gap of a loop that counts as closed
_ROUNDS = 100
_SAME_POINT, _SQUARE = 1e-9, 1e-6
_TOOL_SITES = ("attachment_site", "tcp", "tool", "tool0", "ee", "ee_site", "end_effector", "pinch", "grip_site")


@dataclass(frozen=True)
class ModelBody:
    """A rigid body: mass in kg, centre (3,) in m, inertia (3, 3) about it in base axes; merged with what is welded."""

    name: str
    mass: float
    centre: np.ndarray
    inertia: np.ndarray


@dataclass(frozen=True)
class ModelJoint:
    """A joint as the robot file has it; `range` is the displacement from home, `note` what the source says besides."""

    name: str
    first: str
    second: str
    kind: str
    at: np.ndarray
    axis: np.ndarray | None = None
    axis2: np.ndarray | None = None
    range: tuple[float, float] | None = None
    note: str = ""


@dataclass
class SimulatorModel:
    """A model at its home configuration, base axes, SI."""

    name: str
    bodies: list[ModelBody] = field(default_factory=list)
    joints: list[ModelJoint] = field(default_factory=list)
    tool_body: str = ""
    tool_at: np.ndarray = field(default_factory=lambda: np.zeros(3))
    pose: tuple[str, ...] = ()
    gravity: np.ndarray = field(default_factory=lambda: np.zeros(3))
    notes: list[str] = field(default_factory=list)


def read_model(path: str | Path, tool: str | None = None, home: Mapping[str, float] | None = None) -> SimulatorModel:
    """Read a URDF or MJCF file.

    Parameters
    ----------
    path
        The file; meshes that it names need not be there.
    tool
        Name of the body or site that is the tool; by default a site of a usual name, else the last body of the
        longest chain.
    home
        Positions of hinges (rad) and slides (m) at home; the others are as the keyframe "home" or the zero pose has
        them, as far as loops leave them there.

    Raises
    ------
    InputError
        MuJoCo is not installed, the file is no model, its loops do not close, or it has no such tool.

    """
    try:
        import mujoco
    except ImportError as error:
        raise InputError(
            'import: expected the package mujoco, which reads URDF and MJCF, got none; install "stiffscope[import]"'
        ) from error
    open_file(path, "a model in URDF or MJCF").close()
    library: Any = mujoco
    said: list[str] = []
    library.set_mju_user_warning(said.append)  # else it writes them to MUJOCO_LOG.TXT in the working folder
    try:
        model = _Reader(library, Path(path), home or {}).read(tool)
    finally:
        library.set_mju_user_warning(None)
    if any("'NaN'" in each for each in said):
        raise InputError(f"{path}: expected a model in URDF or MJCF whose numbers are finite, got NaN")
    model.notes += dict.fromkeys(said)
    return model


class _Reader:
    """One model: MuJoCo's compiled form of it and its state at home."""

    def __init__(self, mujoco: Any, path: Path, home: Mapping[str, float]) -> None:
        self.mj, self.path = mujoco, path
        self.notes: list[str] = []
        self.model = self._compiled()
        self._check_finite()
        self.data = mujoco.MjData(self.model)
        self._go_home(home)
        self.names = self._body_names()

    def _check_finite(self) -> None:
        m = self.model
        bodies = m.body_pos, m.body_quat, m.body_ipos, m.body_iquat, m.body_mass, m.body_inertia
        if not all(np.isfinite(each).all() for each in (*bodies, m.jnt_pos, m.jnt_axis, m.opt.gravity)):
            raise InputError(f"{self.path}: expected a model in URDF or MJCF whose numbers are finite, got others")

    def read(self, tool: str | None) -> SimulatorModel:
        joints = _named([*self._tree_joints(), *self._closures()], set(self.names.values()))
        bodies = list(self._bodies())
        needed = {name for joint in joints for name in (joint.first, joint.second)}
        known = {body.name for body in bodies}
        between = sorted(needed - known - {GROUND})  # massless ones between two joints of one body
        bodies += [ModelBody(name, 0.0, np.zeros(3), np.zeros((3, 3))) for name in between]
        for name in sorted(known - _reached(joints)):
            joints.append(ModelJoint(f"{name}.held", GROUND, name, "fixed", self._of(name)))
            self.notes.append(f'"{name}" floats in the source; it is fixed to the ground here')
        body, at, where = self._tool(tool)
        model = SimulatorModel(self.model_name(), bodies, joints, self._root(body), at, self._pose(body, at))
        model.gravity = np.array(self.model.opt.gravity)
        if "<mimic" in read_bytes(self.path).decode(errors="replace"):
            self.notes.append("mimic joints of the source are not coupled here")
        self.notes.append(f"tool: {where}; check body and point")
        model.notes = self.notes
        return model

    def model_name(self) -> str:
        """The model's own name, or the file's."""
        name = self.model.names[: self.model.names.find(b"\0")].decode(errors="replace")
        return name if name and name != "MuJoCo Model" else self.path.stem

    def _compiled(self) -> Any:
        try:
            spec = self.mj.MjSpec.from_file(str(self.path))
            spec.compiler.fusestatic = 0
            try:
                return spec.copy().compile()
            except ValueError as error:
                first = str(error)
            for assets in (spec.geoms, spec.meshes, spec.textures, spec.materials, spec.hfields, spec.skins):
                for each in list(assets):
                    if assets is not spec.geoms or each.type in self._shapes_from_files():
                        spec.delete(each)
            spec.compiler.boundmass, spec.compiler.boundinertia = 1e-9, 1e-15
            spec.compiler.balanceinertia = 1
            model = spec.compile()
        except (ValueError, OSError, RuntimeError) as error:
            why = " ".join(str(error).removeprefix("Error: ").split())
            raise InputError(f"{self.path}: expected a model in URDF or MJCF, got: {why}") from error
        self.notes.append(f"read without its meshes ({' '.join(first.removeprefix('Error: ').split())})")
        self.notes.append("a body whose mass would come from a mesh has none here")
        return model

    def _shapes_from_files(self) -> tuple[Any, ...]:
        kinds = self.mj.mjtGeom
        return kinds.mjGEOM_MESH, kinds.mjGEOM_HFIELD, kinds.mjGEOM_SDF

    def _go_home(self, wanted: Mapping[str, float]) -> None:
        """Keyframe "home" or the zero pose and the joints wanted, with every loop closed by Gauss-Newton steps."""
        m, d, mj = self.model, self.data, self.mj
        key = mj.mj_name2id(m, mj.mjtObj.mjOBJ_KEY, "home")
        if key >= 0:
            mj.mj_resetDataKeyframe(m, d, key)
            self.notes.append('home is the keyframe "home" of the source')
        movable = {int(mj.mjtJoint.mjJNT_HINGE), int(mj.mjtJoint.mjJNT_SLIDE)}
        joints = {self._label("joint", each): each for each in range(m.njnt) if m.jnt_type[each] in movable}
        for name, value in wanted.items():
            if name not in joints:
                raise InputError(
                    f'--home {name}: expected a joint that turns or slides ({", ".join(joints)}), got "{name}"'
                )
            d.qpos[m.jnt_qposadr[joints[name]]] = value
        open_by = np.inf
        for _ in range(_ROUNDS):
            mj.mj_forward(m, d)
            gap, jacobian = self._equalities()
            open_by = float(np.abs(gap).max(initial=0.0))
            if open_by < CLOSED:
                return
            step = -np.linalg.lstsq(jacobian, gap, rcond=1e-9)[0]
            mj.mj_integratePos(m, d.qpos, step, 1.0)
        raise InputError(
            f"{self.path}: expected loops that close, got a gap of {open_by:.3g} (m or rad); "
            "choose another home with --home"
        )

    def _equalities(self) -> tuple[np.ndarray, np.ndarray]:
        """Gap (m,) and Jacobian (m, nv) of the model's active equality constraints."""
        m, d = self.model, self.data
        rows = np.flatnonzero(d.efc_type == self.mj.mjtConstraint.mjCNSTR_EQUALITY)
        if self.mj.mj_isSparse(m):
            dense = np.zeros((d.nefc, m.nv))
            self.mj.mju_sparse2dense(dense, d.efc_J, d.efc_J_rownnz, d.efc_J_rowadr, d.efc_J_colind)
        else:
            dense = d.efc_J.reshape(d.nefc, m.nv)
        return d.efc_pos[rows].copy(), dense[rows].copy()

    def _label(self, kind: str, number: int) -> str:
        """Name of an object of the model, or a made one."""
        name = self.mj.mj_id2name(self.model, getattr(self.mj.mjtObj, f"mjOBJ_{kind.upper()}"), number)
        return (name or f"{kind}{number}").replace('"', "'")

    def _body_names(self) -> dict[int, str]:
        """Names of the bodies that move; those of bodies welded to them are theirs."""
        taken: dict[str, int] = {}
        for body in range(1, self.model.nbody):
            if self.model.body_weldid[body] == body:
                name = self._label("body", body)
                taken[f"{name}_body" if name == GROUND or name in taken else name] = body
        return {0: GROUND} | {body: name for name, body in taken.items()}

    def _of(self, name: str) -> np.ndarray:
        """Origin (3,) of a body."""
        body = next(number for number, each in self.names.items() if each == name)
        return self.data.xpos[body].copy()

    def _root(self, body: int) -> str:
        """Name of the body that a body moves with."""
        return self.names[int(self.model.body_weldid[body])]

    def _bodies(self) -> Iterator[ModelBody]:
        m, d = self.model, self.data
        for root, name in self.names.items():
            if root == 0:
                continue
            members = [b for b in range(1, m.nbody) if m.body_weldid[b] == root and m.body_mass[b] > 1e-8]
            mass = float(sum(m.body_mass[b] for b in members))
            centre = sum((m.body_mass[b] * d.xipos[b] for b in members), np.zeros(3)) / (mass or 1.0)
            inertia = np.zeros((3, 3))
            for b in members:
                turn, r = d.ximat[b].reshape(3, 3), d.xipos[b] - centre
                inertia += turn @ np.diag(m.body_inertia[b]) @ turn.T
                inertia += m.body_mass[b] * (r @ r * np.eye(3) - np.outer(r, r))
            yield ModelBody(name, mass, centre, inertia)

    def _tree_joints(self) -> Iterator[ModelJoint]:
        """Joints of the tree; several of one body are put in a row, with massless bodies between them."""
        m = self.model
        for body, name in self.names.items():
            first, count = int(m.body_jntadr[body]), int(m.body_jntnum[body])
            joints = [self._tree_joint(number) for number in range(first, first + count)] if count > 0 else []
            joints = _universals([joint for joint in joints if joint is not None])
            parent = self._root(int(m.body_parentid[body])) if body else GROUND
            for place, joint in enumerate(joints):
                here = name if place == len(joints) - 1 else f"{name}.{place + 1}"
                yield replace(joint, first=parent, second=here)
                parent = here

    def _tree_joint(self, number: int) -> ModelJoint | None:
        """A hinge, slide or ball; None for a free joint, which holds nothing."""
        m, d, kinds = self.model, self.data, self.mj.mjtJoint
        kind = {kinds.mjJNT_HINGE: "revolute", kinds.mjJNT_SLIDE: "prismatic", kinds.mjJNT_BALL: "spherical"}
        if m.jnt_type[number] not in {int(each) for each in kind}:
            return None
        name = next(word for each, word in kind.items() if m.jnt_type[number] == int(each))
        axis, limits = None, None
        if name != "spherical":
            axis = d.xaxis[number].copy()
            if m.jnt_limited[number]:
                here = float(d.qpos[m.jnt_qposadr[number]])
                low, high = (float(each) - here for each in m.jnt_range[number])
                limits = (low, high) if low < high else None
        return ModelJoint(
            self._label("joint", number),
            "",
            "",
            name,
            d.xanchor[number].copy(),
            axis,
            None,
            limits,
            self._actuator(number),
        )

    def _actuator(self, joint: int) -> str:
        m, kinds = self.model, self.mj.mjtTrn
        for number in range(m.nu):
            on_joint = m.actuator_trntype[number] in {int(kinds.mjTRN_JOINT), int(kinds.mjTRN_JOINTINPARENT)}
            if on_joint and m.actuator_trnid[number, 0] == joint:
                return f'actuator "{self._label("actuator", number)}" of the source'
        return ""

    def _closures(self) -> Iterator[ModelJoint]:
        """Equality constraints as joints: connects by their number and place, welds as fixed joints."""
        m, kinds = self.model, self.mj.mjtEq
        connects: dict[tuple[str, str], list[tuple[str, np.ndarray]]] = {}
        for number in range(m.neq):
            name = self._label("equality", number)
            if not m.eq_active0[number]:
                self.notes.append(f'equality "{name}" is not active in the source and is left out')
            elif m.eq_type[number] in {int(kinds.mjEQ_CONNECT), int(kinds.mjEQ_WELD)}:
                first, second, at = self._closure_ends(number)
                if first == second:
                    continue
                if m.eq_type[number] == int(kinds.mjEQ_WELD):
                    yield ModelJoint(name, first, second, "fixed", at)
                else:
                    connects.setdefault((first, second), []).append((name, at))
            else:
                self.notes.append(f'equality "{name}" couples coordinates, which no joint does; it is left out')
        for (first, second), points in connects.items():
            yield _closing(first, second, points)

    def _closure_ends(self, number: int) -> tuple[str, str, np.ndarray]:
        m, d = self.model, self.data
        if m.eq_objtype[number] == int(self.mj.mjtObj.mjOBJ_SITE):
            sites = int(m.eq_obj1id[number]), int(m.eq_obj2id[number])
            bodies = [int(m.site_bodyid[site]) for site in sites]
            return self._root(bodies[0]), self._root(bodies[1]), d.site_xpos[sites[0]].copy()
        bodies = [int(m.eq_obj1id[number]), int(m.eq_obj2id[number])]
        is_weld = m.eq_type[number] == int(self.mj.mjtEq.mjEQ_WELD)
        anchor, body = (m.eq_data[number, :3], bodies[1] if is_weld else bodies[0])
        at = d.xpos[body] + d.xmat[body].reshape(3, 3) @ anchor
        return self._root(bodies[0]), self._root(bodies[1]), at

    def _tool(self, wanted: str | None) -> tuple[int, np.ndarray, str]:
        """Body, point and description of the tool."""
        m, d = self.model, self.data
        sites = {self._label("site", each): each for each in range(m.nsite)}
        bodies = {self._label("body", each): each for each in range(1, m.nbody)}
        if wanted is not None and wanted not in sites and wanted not in bodies:
            known = ", ".join([*sites, *bodies])
            raise InputError(f'--tool {wanted}: expected a body or site of {self.path} ({known}), got "{wanted}"')
        for name in (wanted,) if wanted else _TOOL_SITES:
            if name in sites and self._root(int(m.site_bodyid[sites[name]])) != GROUND:
                return int(m.site_bodyid[sites[name]]), d.site_xpos[sites[name]].copy(), f'site "{name}" of the source'
        body = bodies[wanted] if wanted else self._last_body()
        if self._root(body) == GROUND:
            raise InputError(
                f"{self.path}: expected a tool that moves, got {wanted or 'a model whose bodies are all fixed'}"
            )
        return body, d.xpos[body].copy(), f'body "{self._label("body", body)}" of the source'

    def _last_body(self) -> int:
        """Where most chains end: the body with most closures, else the deepest one."""
        m = self.model
        depth = np.zeros(m.nbody, dtype=int)
        for body in range(1, m.nbody):
            depth[body] = depth[m.body_parentid[body]] + 1
        ends = [each for number in range(m.neq) for each in self._closure_ends(number)[:2]] if m.neq else []
        bodies = range(1, m.nbody)
        return max(bodies, key=lambda body: (ends.count(self._root(body)) > 1, depth[body], -body), default=0)

    def _pose(self, body: int, at: np.ndarray) -> tuple[str, ...]:
        """Coordinates of the tool that the mechanism moves, translations first."""
        m, d = self.model, self.data
        jacobian = np.zeros((6, m.nv))
        self.mj.mj_jac(m, d, jacobian[:3], jacobian[3:], at, body)
        _, closures = self._equalities()
        basis = np.eye(m.nv)
        if closures.size:
            _, sizes, rows = np.linalg.svd(closures)
            basis = rows[(sizes > 1e-9 * sizes[0]).sum() :].T
        motions = jacobian @ basis
        chosen: list[int] = []
        for coordinate in range(6):
            rows = motions[[*chosen, coordinate]]
            if motions.size and np.linalg.svd(rows)[1].min(initial=np.inf) > 1e-6 and len(rows) <= motions.shape[1]:
                chosen.append(coordinate)
        if not closures.size and len(chosen) < min(6, m.nv):
            self._warn_of_singular_home(body, at, len(chosen))
        return tuple(("x", "y", "z", "rx", "ry", "rz")[each] for each in chosen)

    def _warn_of_singular_home(self, body: int, at: np.ndarray, rank: int) -> None:
        """Note it where the tool of an open chain moves in more directions at a pose nearby."""
        m, near = self.model, self.mj.MjData(self.model)
        near.qpos[:] = self.data.qpos
        self.mj.mj_integratePos(m, near.qpos, np.random.default_rng(0).normal(0.0, 0.1, m.nv), 1.0)
        self.mj.mj_forward(m, near)
        turn = near.xmat[body].reshape(3, 3) @ self.data.xmat[body].reshape(3, 3).T
        jacobian = np.zeros((6, m.nv))
        self.mj.mj_jac(m, near, jacobian[:3], jacobian[3:], near.xpos[body] + turn @ (at - self.data.xpos[body]), body)
        if np.linalg.matrix_rank(jacobian, tol=1e-6) > rank:
            self.notes.append(
                "home is singular: the tool moves in more directions elsewhere; choose another with --home"
            )


def _named(joints: Iterable[ModelJoint], taken: set[str]) -> list[ModelJoint]:
    """The joints with names that no other joint or body has."""
    found = []
    for joint in joints:
        name = joint.name
        while name in taken or name == GROUND:
            name += ".joint"
        taken.add(name)
        found.append(replace(joint, name=name))
    return found


def _reached(joints: Iterable[ModelJoint]) -> set[str]:
    """Bodies that hang on the ground by joints."""
    pairs = [{joint.first, joint.second} for joint in joints]
    reached, grown = {GROUND}, True
    while grown:
        more = set().union(*(pair for pair in pairs if pair & reached)) - reached
        reached |= more
        grown = bool(more)
    return reached


def _universals(joints: list[ModelJoint]) -> list[ModelJoint]:
    """Two crossing hinges of one body, square to one another and without a motor, as a universal joint."""
    if len(joints) != 2 or any(joint.kind != "revolute" or joint.note for joint in joints):
        return joints
    one, two = joints
    if np.linalg.norm(one.at - two.at) > _SAME_POINT or abs(float(np.dot(one.axis, two.axis))) > _SQUARE:  # type: ignore[arg-type]
        return joints
    return [replace(one, kind="universal", axis2=two.axis, range=None)]


def _closing(first: str, second: str, points: list[tuple[str, np.ndarray]]) -> ModelJoint:
    """What connects of two bodies make together: a ball, a hinge on the line of two, or no motion at all."""
    name, at = points[0]
    away = [point - at for _, point in points[1:]]
    if not away:
        return ModelJoint(name, first, second, "spherical", at)
    _, sizes, rows = np.linalg.svd(np.array(away))
    if sizes[0] < _SAME_POINT:
        return ModelJoint(name, first, second, "spherical", at)
    if len(sizes) < 2 or sizes[1] < 1e-6 * sizes[0]:
        note = f"{len(points)} connects of the source, on one line"
        return ModelJoint(name, first, second, "revolute", at, rows[0], note=note)
    return ModelJoint(name, first, second, "fixed", at, note=f"{len(points)} connects of the source")
