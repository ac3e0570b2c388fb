"""Kinematics of a mechanism: configurations from tool poses or from drive displacements.

The solution branch is the one connected to home without passing a singular pose.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from stiffscope.errors import InputError, check_kind, require
from stiffscope.runtime.brief import describe_briefly
from stiffscope.vjm.kinematics.closure import CLOSED
from stiffscope.vjm.kinematics.continuation import (
    OPEN,
    RANGE,
    REACHED,
    KnownConfigurations,
    find_ranges,
    find_solver,
    follow_paths,
)
from stiffscope.vjm.kinematics.linkage import rotation_vector
from stiffscope.vjm.kinematics.reach import reach_toward
from stiffscope.vjm.model.checks import spell_name
from stiffscope.vjm.model.mechanism import COORDINATES, Mechanism

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.typing import ArrayLike, NDArray

    from stiffscope.vjm.kinematics.continuation import Followed, Solver
    from stiffscope.vjm.kinematics.linkage import Given, Linkage, LinkFrames
    from stiffscope.vjm.model.joints import Joint
    from stiffscope.vjm.model.screws import Array

CHUNK = 1024  # poses; the working set fits the processor's cache
_SLACK = 1e-9  # rad or m; tolerance at the ends of a drive's range
Poses: TypeAlias = "ArrayLike | Configurations"
"""Tool poses (n, k), m and rad, or the configurations at them."""


@dataclass(frozen=True, eq=False)
class Configurations:
    """A mechanism at n configurations.

    ``poses`` (n, k): commanded tool coordinates; ``tool`` (n, 6): x y z in m, rotation vector from
    home in rad; ``valid`` (n,): whether every loop closes on the branch of home with all drives in
    range. If not, numbers are NaN and ``reason`` explains why.
    """

    __repr__ = describe_briefly

    mechanism: Mechanism
    poses: Array
    tool: Array
    valid: NDArray[np.bool_]
    q: Array
    linkage: Linkage
    failure: NDArray[np.int8]
    culprit: NDArray[np.intp]

    def __len__(self) -> int:
        return len(self.valid)

    def __getitem__(
        self, index: slice | NDArray[np.intp] | NDArray[np.bool_]
    ) -> Configurations:
        poses = self.poses[index]
        tool = self.tool[index]
        valid = self.valid[index]
        q = self.q[:, index]
        failure = self.failure[index]
        culprit = self.culprit[index]
        return Configurations(
            mechanism=self.mechanism,
            poses=poses,
            tool=tool,
            valid=valid,
            q=q,
            linkage=self.linkage,
            failure=failure,
            culprit=culprit,
        )

    @cached_property
    def link_frames(self) -> LinkFrames:
        """Links at their places."""
        return self.linkage.find_link_frames(self.q)

    def link_frame(self, link: int) -> tuple[Array, Array]:
        """Displacement of a rigid link from home: rotation (n or 1, 3, 3), position (n or 1, 3)."""
        look = self.link_frames.look
        if look is not None:
            return look.frames[:, link, :3, :3], look.frames[:, link, :3, 3]
        rotation = np.ascontiguousarray(
            self.link_frames.rotation[link].transpose(2, 0, 1)
        )
        return rotation, np.ascontiguousarray(self.link_frames.position[link].T)

    def frame(self, node: str) -> tuple[Array, Array]:
        """Return the rotation (n, 3, 3) and position (n, 3) of a node.

        A rigid body's displacement from home; an elastic body's part axes and the end's place.
        """
        link = self.linkage.frame[self.linkage.link_of[node]]
        rotation, position = self.link_frame(link)
        body = next((b for b in self.mechanism.bodies if node in b.nodes), None)
        if body is not None and body.elastic is not None:
            end = body.elastic.places[body.nodes.index(node)]
            position = rotation @ end + position
            rotation = rotation @ body.elastic.axes
        n = len(self)
        return np.broadcast_to(rotation, (n, 3, 3)), np.broadcast_to(position, (n, 3))

    def coordinates(self, joint: str) -> Array:
        """Return a joint's displacements (n, f) from home, rad and m, by free motion."""
        return self.linkage.coordinates(
            self.mechanism.joint(joint), self.q, self.link_frames
        )

    @property
    def drives(self) -> Array:
        """Displacements (n, d) of the drives from home, in the mechanism's order."""
        joints = self.mechanism.drives
        columns = [self.coordinates(j.name)[:, j.driven or 0] for j in joints]
        return np.stack(columns, axis=1) if columns else np.zeros((len(self), 0))

    def reason(self, index: int) -> str:
        """Return why a configuration is not valid; empty if it is valid."""
        if self.valid[index]:
            return ""
        if int(self.failure[index]) == RANGE:
            k = int(self.culprit[index])
            return _range_text(self.mechanism.drives[k], float(self.drives[index, k]))
        if int(self.failure[index]) == OPEN:
            solver = find_solver(self.mechanism, self.linkage.given)
            q = solver.start[:, None].copy()
            q[self.linkage.known] = self.q[self.linkage.known, index, None]
            solution = solver.closure.solve(q, 50, patient=True)
            if not (np.abs(solution.error[:, 0]) < CLOSED).all():
                if (
                    len(self.linkage.cuts) == 1
                ):  # an open chain, whose tool closes its only loop
                    home = self.mechanism.tool.home
                    names = self.mechanism.tool.pose
                    last = home + reach_toward(solver, self.poses[index] - home)
                    place = ", ".join(map(_place_text, names, last))
                    return f"out of reach: straight from home the tool gets no farther than {place}"
                name = spell_name(
                    "joints", self.linkage.name_worst(solution.error[:, 0])
                )
                return f"out of reach: the loop through {name} does not close"
        why = "no way leads there from home without passing a singular pose"
        return f"on another branch, or too close to one: {why}"

    def refusal(self, index: int) -> str:
        """Return what was expected in place of a configuration that is not valid, and why."""
        return (
            f"expected a pose that the robot reaches, got another: {self.reason(index)}"
        )

    def require_valid(self) -> Configurations:
        """Return itself if all are valid. Raises InputError with the first that is not."""
        bad = np.flatnonzero(~self.valid)
        if bad.size:
            i = int(bad[0])
            pairs = zip(self.mechanism.tool.pose, self.poses[i], strict=True)
            given = ", ".join(f"{name} = {value:.6g}" for name, value in pairs)
            raise InputError(f"pose {i} ({given}): {self.reason(i)}")
        return self


def configure(mechanism: Mechanism, poses: Poses) -> Configurations:
    """Find configurations at tool poses, on the branch reached from home.

    Parameters
    ----------
    mechanism
        Joint ranges limit its motion; paths start at home, or as ``start_note`` describes.
    poses
        (n, k), a column for each coordinate of ``tool.pose``, m and rad; or configurations: returned.

    Returns
    -------
    Configurations
        Places of all bodies; a pose out of reach is not valid, and its ``reason`` explains why.

    Raises
    ------
    InputError
        If the array is invalid, or the mechanism cannot move along its pose coordinates.

    Examples
    --------
    >>> import stiffscope as ss
    >>> machine = ss.assemble(ss.load_robot("biglide"), "beam")
    >>> ss.configure(machine, [[0, 0, 0.4], [0.5, 0, 0.4]]).valid
    array([ True, False])
    """
    if isinstance(poses, Configurations):
        return poses
    points = check_poses(mechanism, poses)
    return _join(configure_chunks(mechanism, points), len(points))


def start_note(mechanism: Mechanism) -> str | None:
    """Return the start configuration of tool poses if home is singular; None if it is home."""
    displaced = find_solver(mechanism, "tool").displaced
    if not displaced:
        return None
    joints = [
        (spell_name("joints", name), mechanism.joint(name), v)
        for name, v in displaced.items()
    ]
    where = ", ".join(
        f"{here} = {_value_text(joint, value)}" for here, joint, value in joints
    )
    return f"home is singular: tool poses start from {where}, the nearest regular configuration"


def find_still(mechanism: Mechanism) -> tuple[list[str], list[str]]:
    """Return the drives and springs, and the tool's coordinates, that stay as at home where poses leave a choice."""
    solver = find_solver(mechanism, "tool")
    columns = solver.linkage.columns
    held = set(solver.closure.held)
    able = (j for j in mechanism.joints if j.drive is not None or j.spring is not None)
    still = [joint.name for joint in able if solver.closure.holds(joint)]
    moved = zip(COORDINATES, columns.get("", ()), strict=False)
    return still, [name for name, column in moved if column in held]


def configure_chunks(
    mechanism: Mechanism, points: Array, size: int = CHUNK, given: Given = "tool"
) -> Iterator[Configurations]:
    """Yield configurations at checked tool poses (n, k) or drive displacements (n, d), in chunks.

    Parameters
    ----------
    mechanism
        Bodies, joints, tool and gravity of the robot.
    points
        Tool poses, or displacements of the drives from home, m and rad.
    size
        Configurations per chunk; more take more memory.
    given
        Whether the points are tool poses or drive displacements.
    """
    solver = find_solver(mechanism, given)
    if given == "drives":
        points = _without_welded(solver.linkage, points)
    home = mechanism.tool.home if given == "tool" else 0.0
    yield from (
        _configurations(solver, path)
        for path in follow_paths(solver, points - home, size)
    )


def learn_configurations(
    mechanism: Mechanism, poses: Array
) -> Callable[[Array], Configurations]:
    """Return a function like `configure` that is faster at poses among given ones (n, k)."""
    solver = find_solver(mechanism, "tool")
    home = mechanism.tool.home
    known = KnownConfigurations.sample(solver, check_poses(mechanism, poses) - home)

    def find(points: Array) -> Configurations:
        solution = known.solve(points - home)
        lost = np.flatnonzero(solution.failure)
        if not lost.size:
            return _configurations(solver, solution)
        again = configure(mechanism, points[lost])
        solution.q[:, lost] = again.q
        solution.failure[lost] = np.where(
            again.failure == RANGE, REACHED, again.failure
        )
        return _configurations(
            solver,
            replace(solution, placed=solver.linkage.find_link_frames(solution.q)),
        )

    return find


def configure_drives(mechanism: Mechanism, displacements: ArrayLike) -> Configurations:
    """Find configurations at displacements (n, d) of all drives from home, in order, m and rad.

    Raises InputError if the array has another shape or numbers that are not finite.
    """
    names = [j.name for j in mechanism.drives]
    rows = _check_rows(displacements, names, "drives")
    return _join(configure_chunks(mechanism, rows, given="drives"), len(rows))


def _without_welded(linkage: Linkage, displacements: Array) -> Array:
    """Return displacements (n, k) of the drives that can move. InputError if another does, or is held by drives."""
    movable = np.array(
        [j.name in linkage.columns for j in linkage.mechanism.drives], dtype=bool
    )
    for joint, column in zip(linkage.mechanism.drives, displacements.T, strict=True):
        require(
            joint.name in linkage.columns
            or (linkage.welds(joint) and not column.any()),
            spell_name("joints", joint.name),
            "a passive joint in its drive's loop",
            "none",
        )
    return displacements[:, movable]


def check_poses(mechanism: Mechanism, poses: ArrayLike) -> Array:
    """Return poses (n, k). Raises InputError if they have another shape or are not finite."""
    check_kind("mechanism", mechanism, Mechanism, "assemble")
    return _check_rows(poses, list(mechanism.tool.pose), "poses")


def _check_rows(values: ArrayLike, names: list[str], what: str) -> Array:
    array = np.atleast_2d(np.asarray(values, dtype=float))
    require(
        array.ndim == 2 and array.shape[1] == len(names),
        what,
        f"(n, {len(names)}) numbers {', '.join(names)}",
        f"shape {np.shape(values)}",
    )
    bad = np.flatnonzero(~np.isfinite(array).all(axis=1))
    if bad.size:
        got = array[bad[0]].tolist()
        raise InputError(f"{what}: row {bad[0]}: expected finite numbers, got {got}")
    return array


def _value_text(joint: Joint, value: float) -> str:
    return f"{np.degrees(value):.6g} deg" if joint.turns else f"{value:.6g} m"


def _place_text(coordinate: str, value: float) -> str:
    number, unit = (np.degrees(value), "deg") if coordinate[0] == "r" else (value, "m")
    return f"{coordinate} = {number:.4g} {unit}"


def _range_text(joint: Joint, value: float) -> str:
    ends = (joint.drive.low, joint.drive.high) if joint.drive else (-np.inf, np.inf)
    here, low, high = (_value_text(joint, end) for end in (value, *ends))
    range_ = f"{low.partition(' ')[0]} to {high}"
    return f"{spell_name('joints', joint.name)}: {here} is outside its range {range_}"


def _join(chunks: Iterator[Configurations], n: int) -> Configurations:
    """Join chunks of n configurations one by one: their placed links, most of the memory, go."""
    first = next(chunks)
    if len(first) == n:
        return first
    keys = ("poses", "tool", "valid", "failure", "culprit")
    parts = {key: getattr(first, key) for key in keys}
    joined = {
        key: np.empty((n, *part.shape[1:]), part.dtype) for key, part in parts.items()
    }
    q = np.empty((len(first.q), n))
    at = 0
    for chunk in chain([first], chunks):
        rows = slice(at, at + len(chunk))
        at += len(chunk)
        for key, whole in joined.items():
            whole[rows] = getattr(chunk, key)
        q[:, rows] = chunk.q
    return replace(first, **joined, q=q)


def _configurations(solver: Solver, followed: Followed) -> Configurations:
    linkage = solver.linkage
    mechanism = solver.mechanism
    q = followed.q
    placed = followed.placed
    failure = followed.failure
    culprit = np.zeros(len(followed.failure), dtype=np.intp)
    link = linkage.frame[linkage.link_of[mechanism.tool.body]]
    tool = np.empty((q.shape[1], 6))
    tool[:, :3] = placed.point(link, mechanism.tool.at).T
    if "" in linkage.columns:
        tool[:, 3:] = q[linkage.columns[""][3:]].T
    else:
        tool[:, 3:] = rotation_vector(placed.rotation[link].transpose(2, 0, 1))
    poses = tool[:, mechanism.tool.commanded_axes]
    if "" in linkage.columns:
        poses = mechanism.tool.home + q[linkage.known].T
    out = Configurations(
        mechanism=mechanism,
        poses=poses,
        tool=tool,
        valid=failure == 0,
        q=q,
        linkage=linkage,
        failure=failure,
        culprit=culprit,
    )
    out.__dict__["link_frames"] = placed
    _refuse_beyond(out, *solver.ranges, _SLACK)
    return out


def limit_drives(
    configurations: Configurations, mechanism: Mechanism, slack: float
) -> Configurations:
    """Return configurations, valid within the ranges of another mechanism's drives, ± slack, rad or m."""
    copies = {
        key: getattr(configurations, key).copy()
        for key in ("valid", "failure", "culprit")
    }
    out = replace(configurations, mechanism=mechanism, **copies)
    _refuse_beyond(out, *find_ranges(mechanism), slack)
    return out


def _refuse_beyond(
    configurations: Configurations, low: Array, high: Array, slack: float
) -> None:
    drives = configurations.drives
    failure = configurations.failure
    outside = ((drives < low - slack) | (drives > high + slack)) & (failure == REACHED)[
        :, None
    ]
    if outside.any():
        beyond = outside.any(axis=1)
        configurations.culprit[beyond] = outside[beyond].argmax(axis=1)
        failure[beyond] = RANGE
        np.equal(failure, 0, out=configurations.valid)
