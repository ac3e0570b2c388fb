"""Cached pictures of a run; the key covers their content and the drawing code."""

from __future__ import annotations

import logging
import shutil
import time
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic_core import to_jsonable_python

from stiffscope.experiments.making import EXPERIMENT
from stiffscope.registry import registered
from stiffscope.report.pictures import (
    PictureError,
    draw,
    draw_by,
    open_drawing,
    optional_pictures,
)
from stiffscope.report.robot_scene import (
    add_solids,
    mark_doubts,
    place_robot,
    pose_text,
    scene,
    scene_of,
)
from stiffscope.report.run_report import ENERGY, GEOMETRY
from stiffscope.runtime.cache import PICTURES, code_version, digest, kept_files
from stiffscope.runtime.executor import Processes
from stiffscope.runtime.reading import file_digest
from stiffscope.vjm.kinematics.configurations import configure

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from contextlib import AbstractContextManager
    from pathlib import Path

    from stiffscope.cad.part import Part
    from stiffscope.experiments.assembly import Assembled
    from stiffscope.experiments.experiments import PartResult
    from stiffscope.experiments.manifest import Manifest
    from stiffscope.report.robot_view import Case
    from stiffscope.robot.file.description import RobotFile
    from stiffscope.robot.inspection import Inspection
    from stiffscope.runtime.cache import Cache
    from stiffscope.runtime.executor import Here
    from stiffscope.vjm.kinematics.configurations import Configurations

log = logging.getLogger(__name__)

AT_ONCE = 2  # pictures drawn concurrently, by processes of the workshop


@dataclass(frozen=True)
class Order:
    """Pictures to draw: name in the manifest, cache key, drawing function and target folder.

    ``write(folder, draw_now)`` draws into a folder; solids by ``draw_now``, which is called like
    `stiffscope.report.pictures.draw`.
    """

    name: str
    key: str
    write: Callable[[Path, Callable[..., None]], object]
    target: Path


def write_pictures(
    orders: Sequence[Order],
    cache: Cache,
    executor: Here | Processes,
    manifest: Manifest,
) -> None:
    """Draw pictures that are not cached, and copy all to their folders; warn if it is impossible.

    Parameters
    ----------
    orders, cache, executor
        Pictures to draw, cache of results, and processes that draw.
    manifest
        Record of how the results were made.
    """
    with _open_drawing(executor) as draw_now, ThreadPoolExecutor(AT_ONCE) as pool:
        tasks = [
            pool.submit(_keep_pictures, order, cache, draw_now) for order in orders
        ]
        try:
            for order, each in zip(orders, tasks, strict=True):
                held, reused, seconds = each.result()
                if held is not None:
                    for file in kept_files(held):
                        shutil.copyfile(held / file, order.target / file)
                    manifest.note(
                        order.name, key=order.key, reused=reused, seconds=seconds
                    )
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _open_drawing(
    executor: Here | Processes,
) -> AbstractContextManager[Callable[..., None]]:
    """Return what draws in an executor's processes, or in a process of its own: never in this one.

    Graphics libraries may crash, and are neither imported nor used by several threads safely.
    """
    if isinstance(executor, Processes):
        return nullcontext(draw_by(executor))
    return open_drawing()


def order_run(assembled: Assembled, target: Path) -> list[Order]:
    """Order a run's pictures: parts, robot at its poses and, with ``[map]``, a small map."""
    orders = [
        _order_part(result, target / name) for name, result in assembled.results.items()
    ]
    facts = robot_facts(assembled)
    key = digest({**facts, "skins": digest_solids(assembled), "code": _drawing_code()})

    def write(folder: Path, draw_now: Callable[..., None]) -> None:
        _draw_poses(assembled, folder, draw_now)

    orders.append(Order("robot", key, write, target))
    for order_more in registered("pictures"):
        orders += order_more(assembled, target)
    return orders


def draw_named_poses(assembled: Assembled, folder: Path) -> None:
    """Draw the robot at its named poses, or at home; warn if this machine cannot draw."""
    with optional_pictures():
        _draw_poses(assembled, folder, draw)


def draw_inspection(
    inspection: Inspection,
    folder: Path,
    parts: Mapping[str, Part],
    draw_now: Callable[..., None],
) -> None:
    """Draw the rigid robot at home and at every reachable named pose, if drawing is possible.

    ``parts``: parts from STEP files, drawn transparent; ``draw_now``: from `open_drawing`.
    """
    if inspection.configurations is None:
        return
    reached = np.array([pose.is_reached for pose in inspection.poses], dtype=bool)
    poses = {pose.name: pose.tool for pose in inspection.poses if pose.is_reached}
    pictures = _picture_poses(
        inspection.robot, inspection.configurations[reached], poses
    )
    if pictures:
        pictures = [picture | {"kinds": True} for picture in pictures]
        with optional_pictures():
            drawn = scene(inspection.robot, inspection.mechanism)
            add_solids(drawn["bodies"], inspection.robot, parts)
            drawn["joints"] = mark_doubts(drawn["joints"], inspection)
            draw_now("robot", folder, pictures=pictures, geometry=GEOMETRY, **drawn)


def draw_deflection(
    assembled: Assembled,
    names: Sequence[str],
    configurations: Configurations,
    cases: Sequence[Sequence[Case]],
    folder: Path,
) -> None:
    """Draw the robot deformed by the wrench of each pose, coloured by share of strain energy.

    Parameters
    ----------
    assembled, folder
        Robot with its parts' matrices, and folder to write to.
    names, configurations, cases
        Names (n,) of the poses, configurations there, and wrenches to show, by pose.
    """
    shown = []
    for k, (name, (case,)) in enumerate(zip(names, cases, strict=True)):
        here = place_robot(configurations, k)
        factor = here.exaggeration(case.twists)
        title = f"{assembled.robot.name} at {name} under {case.label}; deformed × {factor:g}"
        bent = {"moves": here.deform(case.twists, factor), "before": here.moves}
        file = f"deflection_{k + 1}.png"
        shown.append({"file": file, "title": title, **bent, "shares": case.shares})
    drawn = scene_of(assembled)
    with optional_pictures():
        draw("robot", folder, pictures=shown, scale=ENERGY, geometry=GEOMETRY, **drawn)


def plain_robot(robot: RobotFile) -> dict[str, Any]:
    """Return the robot file as plain SI data with copies expanded; it determines the pictures."""
    names = (
        field.name for field in fields(robot) if field.name not in {"source", "copied"}
    )
    content = {name: getattr(robot, name) for name in names}
    plain = {
        key: dict(v) if isinstance(v, Mapping) else v for key, v in content.items()
    }
    return to_jsonable_python(plain, by_alias=True, inf_nan_mode="constants")


def _keep_pictures(
    order: Order, cache: Cache, draw_now: Callable[..., None]
) -> tuple[Path | None, bool, float]:
    """Return the pictures' folder (None if drawing failed), whether it was cached, and seconds."""
    begun = time.perf_counter()
    held = cache.get(PICTURES, order.key)
    reused = held is not None
    try:
        held = held or cache.put(
            PICTURES, order.key, lambda folder: order.write(folder, draw_now)
        )
    except PictureError as error:
        log.warning("%s", error)
    return held, reused, time.perf_counter() - begun


def _order_part(result: PartResult, target: Path) -> Order:
    """Order pictures of a part under each unit wrench and of its mesh."""
    experiment = result.folder / EXPERIMENT
    key = digest({"experiment": file_digest(experiment), "code": _drawing_code()})

    def write(folder: Path, draw_now: Callable[..., None]) -> None:
        files = {"sheet": "loads.png", "mesh": "mesh.png"}
        draw_now(
            "part_pictures",
            folder,
            experiment=experiment,
            title=result.name,
            faces=result.solid["faces"],
            **files,
        )

    return Order(f"{result.name} pictures", key, write, target)


def robot_facts(assembled: Assembled) -> dict[str, Any]:
    """Return the data that determine a robot with its parts' matrices."""
    matrices = {
        name: [part.compliance, part.mass, part.dynamics and part.dynamics.load]
        for name, part in assembled.matrices.items()
    }
    return {"robot": plain_robot(assembled.robot), "matrices": matrices}


def digest_solids(assembled: Assembled) -> dict[str, str]:
    """Return checksums of the solids drawn: parts' experiments and the user's surface meshes."""
    surfaces = {
        name: getattr(body, "mesh", None)
        for name, body in assembled.robot.bodies.items()
    }
    folder = assembled.robot.path.parent
    files = {
        name: result.folder / EXPERIMENT for name, result in assembled.results.items()
    }
    files |= {f"{name}.mesh": folder / mesh for name, mesh in surfaces.items() if mesh}
    return {name: file_digest(file) for name, file in files.items()}


def _drawing_code() -> str:
    """Return the hash of the code and packages that draw pictures of solids."""
    return code_version(
        ("stiffscope.report", "stiffscope.vjm"), ("pyvista", "vtk", "matplotlib")
    )


def _draw_poses(
    assembled: Assembled, folder: Path, draw_now: Callable[..., None]
) -> None:
    mechanism = assembled.mechanism
    poses: dict[str, Any] = dict(assembled.robot.poses) or {"home": mechanism.tool.home}
    shown = _picture_poses(
        assembled.robot, configure(mechanism, list(poses.values())), poses
    )
    draw_now("robot", folder, pictures=shown, geometry=GEOMETRY, **scene_of(assembled))


def _picture_poses(
    robot: RobotFile,
    configurations: Configurations,
    poses: Mapping[str, Sequence[float]],
) -> list[dict[str, Any]]:
    """Return pictures of the robot at named poses."""
    pictures = []
    for k, (name, pose) in enumerate(poses.items()):
        title = f"{robot.name} at {name}: {pose_text(configurations.mechanism, pose)}"
        moves = place_robot(configurations, k).moves
        pictures.append({"file": f"robot_{name}.png", "title": title, "moves": moves})
    return pictures
