"""The pictures of a run, kept in the cache by what they show and by the code that draws them."""

from __future__ import annotations

import dataclasses
import logging
import shutil
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.jobs.cache import code_version, digest, file_digest, kept_files
from stiffscope.jobs.results import EXPERIMENT
from stiffscope.report.pictures import PictureError, draw

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from stiffscope.gap.diagnosis import Diagnosis
    from stiffscope.jobs.assembly import Assembled
    from stiffscope.jobs.cache import Cache
    from stiffscope.jobs.manifest import Manifest
    from stiffscope.jobs.results import PartResult

log = logging.getLogger(__name__)

AT_ONCE = 2  # pictures; each is drawn in a process of its own
MAP_POINTS = 81
GROUPS = {
    "joints": tuple(f"limb{i}.link{j}.joint_{end}" for i in (1, 2) for j in (1, 2, 3) for end in "ab"),
    "links": tuple(f"limb{i}.link{j}" for i in (1, 2) for j in (1, 2, 3)),
    "carriages": ("limb1.carriage", "limb2.carriage"),
    "sliders": ("limb1.slider", "limb2.slider"),
    "limbs": ("limb1.actuator", "limb2.actuator"),
}


@dataclass(frozen=True)
class Order:
    """Pictures to draw: their name in the manifest, what determines them, how, and the folder that they go to."""

    name: str
    key: str
    write: Callable[[Path], None]
    target: Path


def write_run_pictures(assembled: Assembled, folder: Path, cache: Cache, manifest: Manifest) -> None:
    """Draw parts, robot and map of a run into its folder; where this machine cannot draw, say so and leave them out."""
    orders = [_part_order(result, folder / name) for name, result in assembled.results.items()]
    orders += _robot_orders(assembled, folder)
    with ThreadPoolExecutor(AT_ONCE) as pool:
        made = [pool.submit(_kept, order, cache) for order in orders]
        try:
            for order, each in zip(orders, made, strict=True):
                _place(order, *each.result(), manifest)
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def draw_shares(assembled: Assembled, diagnosis: Diagnosis, poses: np.ndarray, folder: Path) -> None:
    """The robot at the pose of the largest residual, its components coloured by their share of the gap."""
    where = diagnosis.where
    if not where.component:
        return
    worst = int(np.argmax([np.nansum(np.square(row)) for row in np.array(where.pose, dtype=float)]))
    place = ", ".join(f"{1e3 * c:.4g}" for c in poses[worst])
    title = f"Share of the gap by component, at the pose of the largest residual, M = ({place}) mm"
    picture = {"file": "robot.png", "title": title, "pose": poses[worst]}
    try:
        _draw_robot(assembled, folder, [picture], shares=shares(diagnosis), scale="share of the gap")
    except PictureError as error:
        log.warning("%s", error)


def shares(diagnosis: Diagnosis) -> dict[str, float]:
    """Share of the gap by body of the drawing: a group's share is shown on each of its members."""
    out: dict[str, float] = {}
    for component, share in diagnosis.where.component.items():
        for body in GROUPS.get(component, (component,)):
            out[body] = out.get(body, 0.0) + share
    return out


def _kept(order: Order, cache: Cache) -> tuple[Path | None, bool, float]:
    """Folder with the pictures, or None where they cannot be drawn; whether the cache had them; the seconds taken."""
    begun = time.perf_counter()
    held = cache.get("pictures", order.key)
    reused = held is not None
    try:
        held = held or cache.put("pictures", order.key, order.write)
    except PictureError as error:
        log.warning("%s", error)
    return held, reused, time.perf_counter() - begun


def _place(order: Order, held: Path | None, reused: bool, seconds: float, manifest: Manifest) -> None:
    if held is not None:
        for file in kept_files(held):
            shutil.copyfile(held / file, order.target / file)
        manifest.note(order.name, key=order.key, reused=reused, seconds=seconds)


def _part_order(result: PartResult, target: Path) -> Order:
    """A part under each unit wrench, and its mesh."""
    experiment = result.folder / EXPERIMENT
    key = digest({"experiment": file_digest(experiment), "code": _drawing_code()})

    def write(folder: Path) -> None:
        faces = {tag: result.solid["faces"][tag] for tag in ("clamped", "loaded")}
        files = {"sheet": "loads.png", "mesh": "mesh.png"}
        draw("part_pictures", folder, experiment=experiment, title=result.name, **files, **faces)

    return Order(f"{result.name} pictures", key, write, target)


def _robot_orders(assembled: Assembled, target: Path) -> list[Order]:
    """A small map, and the robot at its poses."""
    facts = {
        "robot": assembled.robot.model_dump(mode="json"),
        "matrices": {name: matrix.tolist() for name, matrix in assembled.matrices.items()},
    }
    mapping = code_version(("stiffscope.vjm", "stiffscope.report"), ("matplotlib", "numpy"))
    skins = {name: file_digest(result.folder / EXPERIMENT) for name, result in assembled.results.items()}
    map_key, robot_key = digest({**facts, "code": mapping}), digest({**facts, "skins": skins, "code": _drawing_code()})
    return [
        Order("robot", robot_key, lambda folder: _draw_poses(assembled, folder), target),
        Order("map", map_key, lambda folder: _draw_map(assembled, folder), target),
    ]


def _drawing_code() -> str:
    """Hash of what determines pictures besides their content."""
    return code_version(("stiffscope.report.drawing",), ("pyvista", "vtk", "matplotlib"))


def _draw_map(assembled: Assembled, folder: Path) -> None:
    from stiffscope.report.maps import draw_stiffness, robot_maps, write_map

    robot = assembled.robot
    found = robot_maps(assembled.elastic, robot.poses, MAP_POINTS, "exact", robot.gravity.acceleration)
    write_map(found, folder)
    draw_stiffness(found, robot.poses, f"{robot.name}: stiffness at M (diagonal of K), y = 0", folder / "map.png")


def _draw_poses(assembled: Assembled, folder: Path) -> None:
    robot = assembled.robot
    pictures: list[dict[str, Any]] = []
    for name, pose in robot.poses.items():
        place = ", ".join(f"{1e3 * c:.5g}" for c in pose)
        title = f"{robot.name} at {name}: M = ({place}) mm"
        pictures.append({"file": f"robot_{name}.png", "title": title, "pose": pose})
    _draw_robot(assembled, folder, pictures)


def _draw_robot(assembled: Assembled, folder: Path, pictures: Sequence[Mapping[str, Any]], **more: Any) -> None:
    """Pictures {file, title, pose} of the robot, its parts as they were tested; `more` goes to `drawing.robot`."""
    tested = {name: result.folder / EXPERIMENT for name, result in assembled.results.items()}
    parts = {
        name: {**assembled.robot.part(name).shape(), "experiment": tested.get(name)} for name in assembled.matrices
    }
    geometry = dataclasses.asdict(assembled.elastic.geometry)
    draw("robot", folder, pictures=list(pictures), geometry=geometry, **parts, **more)
