"""`stiffscope run`: parts, robot, pictures, files, tables; made only where what determines it was not seen before."""

from __future__ import annotations

import dataclasses
import logging
import shutil
import sys
import tempfile
import time
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope import files
from stiffscope.errors import InputError
from stiffscope.jobs.cache import code_version, default_cache, digest, file_digest, kept_files
from stiffscope.jobs.experiments import (
    EXPERIMENT,
    FIELDS,
    MESH,
    SHEET,
    PartResult,
    drawing_code,
    kept,
    order_part,
    solve_parts,
)
from stiffscope.jobs.manifest import Manifest
from stiffscope.report import tables
from stiffscope.report.compare import compare
from stiffscope.report.pictures import PictureError, draw
from stiffscope.report.progress import progress
from stiffscope.robot import components as parts_of
from stiffscope.robot.robot_file import load_robot
from stiffscope.robot.schema import PARTS

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from stiffscope.jobs.cache import Cache
    from stiffscope.jobs.experiments import PartOrder
    from stiffscope.robot.schema import PartName, RobotFile
    from stiffscope.vjm.analysis import Stiffness
    from stiffscope.vjm.biglide import Biglide

log = logging.getLogger(__name__)

MAP_POINTS = 81


@dataclass(frozen=True)
class Assembled:
    """A robot file with the matrices of its parts and the elastic robot made of them."""

    robot: RobotFile
    sources: dict[PartName, str]
    results: dict[PartName, PartResult]
    matrices: dict[PartName, np.ndarray]
    elastic: Biglide


@contextmanager
def workshop(*, quiet: bool) -> Iterator[tuple[Cache, Path, Any]]:
    """Cache, a folder for what it cannot hold, and the opener of progress lines."""
    with tempfile.TemporaryDirectory(prefix="stiffscope-") as spare, progress(quiet=quiet) as open_line:
        yield default_cache(), Path(spare), open_line


def needed_orders(
    robot: RobotFile, components: str | None, *, pictures: bool, suffix: str = ""
) -> dict[PartName, PartOrder]:
    """Virtual experiments that the robot's matrices and masses need."""
    sources = parts_of.sources(robot, components)
    if sources["slider"] == "fea":
        check_one_interface(robot, "slider")
    wanted = [name for name in PARTS if sources[name] == "fea" or (name == "link" and robot.link.mass == "cad")]
    return {name: order_part(robot, name, pictures=pictures, label=name + suffix) for name in wanted}


def check_reach(robot: RobotFile, points: Mapping[str, Sequence[float]]) -> None:
    """Raise InputError that names the tool point that is out of reach, before any experiment is made."""
    from stiffscope.vjm.biglide import link_angle

    geometry = parts_of.geometry(robot)
    for name, point in points.items():
        try:
            link_angle(geometry, point)
        except InputError as error:
            raise InputError(f"{name}: {error}") from error


def check_one_interface(robot: RobotFile, name: PartName) -> None:
    """Raise InputError where a part has more loaded interfaces, and so more matrices, than one."""
    if robot.part(name).shape().get("pads") == "apart":
        raise InputError(
            f'{robot.path}: {name}.pads: expected "together", which makes one matrix, got "apart" (whose three '
            "interfaces `stiffscope compliance` gives)"
        )


def assemble(robot: RobotFile, components: str | None, results: Mapping[PartName, PartResult]) -> Assembled:
    """The elastic robot from its parts."""
    sources = parts_of.sources(robot, components)
    matrices = {name: parts_of.component(robot, name, sources[name], results) for name in PARTS}
    mass = robot.link.mass
    link_mass = results["link"].mass if mass == "cad" else float(mass)
    elastic = parts_of.assemble(robot, matrices, link_mass)
    return Assembled(robot, dict(sources), dict(results), matrices, elastic)


def solve_robots(
    robots: Mapping[str, RobotFile],
    components: str | None,
    cache: Cache,
    spare: Path,
    open_line: Any,
    *,
    pictures: bool,
) -> dict[str, Assembled]:
    """Assemble robots, by label; the parts that several share are made once, and pictures are drawn of the first's."""
    orders: dict[tuple[str, PartName], PartOrder] = {}
    for i, (label, robot) in enumerate(robots.items()):
        suffix = "" if i == 0 else f" ({label})"
        for name, order in needed_orders(robot, components, pictures=pictures and i == 0, suffix=suffix).items():
            same = (other for other in orders.values() if dataclasses.replace(other, pictures=order.pictures) == order)
            orders[label, name] = next(same, order)
    reports = {order.label: open_line(order.label) for order in orders.values()}
    solved = dict(zip(orders, solve_parts(list(orders.values()), cache, spare, reports), strict=True))
    return {
        label: assemble(robot, components, {name: solved[at, name] for at, name in solved if at == label})
        for label, robot in robots.items()
    }


def warn_of(results: Iterable[PartResult]) -> None:
    """Say on standard error of each part whose tolerance was not met how far it came."""
    for result in results:
        if result.note:
            log.warning("%s: %s", result.name, result.note)


def run_robot(
    name: str,
    out: Path,
    *,
    overrides: Sequence[str] = (),
    components: str | None = None,
    tolerance: str | None = None,
    quiet: bool = False,
) -> None:
    """Run the whole chain and write a complete output folder. Raises InputError for anything a user can get wrong."""
    begun = time.perf_counter()
    robot = load_robot(name, overrides, tolerance)
    if not robot.poses:
        raise InputError(f'{robot.path}: has no poses; give one in [poses], such as Q1 = ["0 mm", "0 mm", "350 mm"]')
    check_reach(robot, robot.poses)
    files.check_output(out)
    robots = {"now": robot} | ({"before": load_robot(name, (), tolerance)} if overrides else {})
    manifest = Manifest(sys.argv[1:], str(robot.path), file_digest(robot.path), list(overrides))
    with workshop(quiet=quiet) as (cache, spare, open_line), files.staged_folder(out) as folder:
        solved = solve_robots(robots, components, cache, spare, open_line, pictures=True)
        now = solved["now"]
        manifest.seconds["parts"] = time.perf_counter() - begun
        report = open_line("robot")
        report("assembling", 0.2)
        states = {label: analyse(each, robot.poses) for label, each in solved.items()}
        write_parts(now, folder, manifest)
        write_robot(now, states["now"], folder)
        report("pictures", 0.5)
        write_pictures(now, folder, cache, spare, manifest)
        manifest.seconds["robot"] = time.perf_counter() - begun - manifest.seconds["parts"]
        manifest.write(folder)
        report("done", 1.0)
    if not quiet:
        show_run(now, states, overrides)
        tables.show_line(f"Written to {out} in {time.perf_counter() - begun:.1f} s")
    else:
        warn_of(now.results.values())


def analyse(assembled: Assembled, poses: Mapping[str, Sequence[float]]) -> Stiffness:
    """Stiffness without gravity and sag with it, at named poses."""
    from stiffscope.vjm.analysis import analyse as at_poses
    from stiffscope.vjm.analysis import sag

    points = np.array(list(poses.values()))
    found = at_poses(assembled.elastic, points)
    return dataclasses.replace(found, sag=sag(assembled.elastic, points, g=assembled.robot.gravity.acceleration))


def write_parts(assembled: Assembled, folder: Path, manifest: Manifest) -> None:
    """A folder for each part that was tested: facts, fields, solid, pictures."""
    for name, result in assembled.results.items():
        place = folder / name
        place.mkdir()
        files.write_json(place / "compliance.json", compliance_json(assembled.robot, result))
        for file in (EXPERIMENT, FIELDS, f"{name}.step", f"{name}.stl"):
            shutil.copyfile(result.folder / file, place / file)
        if result.pictures:
            for picture in (SHEET, MESH):
                shutil.copyfile(result.pictures / picture, place / picture)
        manifest.note(
            name, key=result.key, reused=result.reused, seconds=result.seconds, stages=result.facts["seconds"]
        )


def compliance_json(robot: RobotFile, result: PartResult) -> dict[str, Any]:
    """What scripts read of a part; beam theory knows the own shape alone, not a STEP file's solid."""
    beam = parts_of.beam_compliance(robot, result.name).tolist() if result.own_shape else None
    facts = {key: value for key, value in result.facts.items() if key not in {"faces", "imbalance"}}
    return {**facts, "beam": beam, "cached": result.reused}


def write_superelement(result: PartResult, out: Path, manifest: Manifest) -> None:
    """A folder with the part condensed on its interfaces, as npz and as Matrix Market: see `stiffscope.fea.export`."""
    from stiffscope.fea.experiment import load_experiment
    from stiffscope.fea.export import write_superelement as write

    with files.staged_folder(out) as folder:
        write(load_experiment(result.folder / EXPERIMENT), folder / result.name)
        manifest.note(result.name, key=result.key, reused=result.reused, seconds=result.seconds)
        manifest.write(folder)


def stiffness_bars(assembled: Assembled, poses: Any) -> np.ndarray | None:
    """95 % bounds (n, 6, 6) on the stiffness from those of the parts' experiments; None where no part has any."""
    from stiffscope.vjm.uncertainty import stiffness_error

    zero = np.zeros((6, 6))
    made = {name: source == "fea" for name, source in assembled.sources.items()}
    if not any(made.values()):
        return None
    link, slider = (assembled.results[name].error if made[name] else zero for name in ("link", "slider"))
    return stiffness_error(assembled.elastic, poses, link, slider)


def stiffness_json(state: Stiffness, error: np.ndarray | None = None) -> dict[str, Any]:
    """What scripts read of the robot."""
    bars = {} if error is None else {"error": error}
    return {"poses": state.poses, "stiffness": state.matrix, "sag": state.sag, "mobility": state.mobility, **bars}


def write_robot(assembled: Assembled, state: Stiffness, folder: Path) -> None:
    """Matrices as JSON and npz, and the robot file as it was used."""
    robot = assembled.robot
    names = {"names": list(robot.poses), "components": assembled.sources}
    files.write_json(
        folder / "stiffness.json", {**stiffness_json(state, stiffness_bars(assembled, state.poses)), **names}
    )
    matrices = {f"{name}_compliance": matrix for name, matrix in assembled.matrices.items()}
    matrices |= {"poses": state.poses, "stiffness": state.matrix, "sag": state.sag}
    np.savez_compressed(folder / "matrices.npz", **matrices)  # type: ignore[arg-type]
    files.write_json(folder / "robot.json", robot.model_dump(mode="json"))


def write_pictures(assembled: Assembled, folder: Path, cache: Cache, spare: Path, manifest: Manifest) -> None:
    """The small map, and the robot at its poses, from the cache where nothing changed."""
    robot = assembled.robot
    facts = {
        "robot": robot.model_dump(mode="json"),
        "matrices": {name: matrix.tolist() for name, matrix in assembled.matrices.items()},
    }
    mapping = code_version(("stiffscope.vjm", "stiffscope.report"), ("matplotlib", "numpy"))
    skins = {name: file_digest(result.folder / EXPERIMENT) for name, result in assembled.results.items()}
    orders = {
        "map": (digest({**facts, "code": mapping}), _draw_map),
        "robot": (digest({**facts, "skins": skins, "code": drawing_code()}), _draw_robot),
    }
    for kind, (key, write) in orders.items():
        begun = time.perf_counter()
        held = cache.get(kind, key)
        reused = held is not None
        try:
            held = held or kept(cache, kind, key, lambda aside, write=write: write(assembled, aside), spare)
        except PictureError as error:
            log.warning("%s", error)
            continue
        for file in kept_files(held):
            shutil.copyfile(held / file, folder / file)
        manifest.note(kind, key=key, reused=reused, seconds=time.perf_counter() - begun)


def _draw_map(assembled: Assembled, folder: Path) -> None:
    from stiffscope.report.maps import draw_stiffness, robot_maps, write_map

    robot = assembled.robot
    found = robot_maps(assembled.elastic, robot.poses, MAP_POINTS, "exact", robot.gravity.acceleration)
    write_map(found, folder)
    draw_stiffness(found, robot.poses, f"{robot.name}: principal stiffness at M, y = 0", folder / "map.png")


def _draw_robot(assembled: Assembled, folder: Path) -> None:
    robot = assembled.robot
    pictures: list[dict[str, Any]] = []
    for name, pose in robot.poses.items():
        place = ", ".join(f"{1e3 * c:.5g}" for c in pose)
        pictures.append(
            {"file": f"robot_{name}.png", "title": f"{robot.name} at {name}: M = ({place}) mm", "pose": pose}
        )
    draw_robot(assembled, folder, pictures)


def draw_robot(assembled: Assembled, folder: Path, pictures: Sequence[Mapping[str, Any]], **more: Any) -> None:
    """Pictures {file, title, pose} of the robot, its parts as they were tested; `more` goes to `drawing.robot`."""
    parts = {
        name: {**assembled.robot.part(name).shape(), "experiment": held.folder / EXPERIMENT if held else None}
        for name, held in ((name, assembled.results.get(name)) for name in PARTS)
    }
    geometry = dataclasses.asdict(assembled.elastic.geometry)
    draw("robot", folder, pictures=list(pictures), geometry=geometry, **parts, **more)


def show_compliance(robot: RobotFile, result: PartResult) -> None:
    """A part's compliance beside beam theory and the paper; a STEP file's solid has nothing beside it."""
    if result.own_shape:
        tables.show_comparison(compare(robot, result.name, result))
    else:
        tables.show_matrix(f"Compliance of the {result.name}, SI", result.compliance)
        tables.show_line("No beam theory beside it: it is a STEP file's solid, not the robot file's own shape\n")


def show_run(now: Assembled, states: Mapping[str, Stiffness], overrides: Sequence[str]) -> None:
    """The tables at the end of a run."""
    if now.results:
        tables.show_parts(list(now.results.values()))
    for name, result in now.results.items():
        if now.sources[name] == "fea":
            show_compliance(now.robot, result)
    names, state = list(now.robot.poses), states["now"]
    made_of = ", ".join(f"{name} {source}" for name, source in now.sources.items())
    tables.show_stiffness(names, state.poses, state.matrix, state.sag, title=f"Stiffness at M ({made_of})")
    if "before" in states:
        tables.show_change(names, states["before"].matrix, state.matrix, overrides)
