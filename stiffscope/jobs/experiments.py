"""Parts as orders: what determines a virtual experiment, its cache key, and making it where the cache has no answer."""

from __future__ import annotations

import dataclasses
import json
import logging
import shutil
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.cad.solid import GREATEST_X, LEAST_X
from stiffscope.errors import InputError
from stiffscope.jobs.cache import Cache, code_version, digest, file_digest

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from stiffscope.cad.faces import FaceSelector
    from stiffscope.cad.link import LinkParameters
    from stiffscope.cad.materials import AnyMaterial
    from stiffscope.cad.slider import SliderParameters
    from stiffscope.cad.solid import Placement
    from stiffscope.fea.experiment import Settings
    from stiffscope.robot.part_schema import Step
    from stiffscope.robot.schema import PartName, RobotFile

    Report = Callable[[str, float], None]

log = logging.getLogger(__name__)

LIBRARIES = ("build123d", "cadquery-ocp-novtk", "pytetwild", "scikit-fem", "numpy", "scipy")
AXES = {
    "link": "x along the link from its clamped end; twist (v, omega) and wrench (f, m) at the centre of the loaded end",
    "slider": "x away from the clamped face, y across, z down; "
    "twist (v, omega) and wrench (f, m) at the centre of the loaded face",
}
STEP_AXES = (
    "those of the STEP file, or of the frame chosen in it; twist and wrench at the loaded faces' reference point"
)
FORM = 3  # of the files below; other code reads other forms
EXPERIMENT, FACTS, FIELDS = "experiment.npz", "facts.json", "fields.vtu"
SHEET, MESH = "loads.png", "mesh.png"


@dataclass(frozen=True)
class StepOrder:
    """A solid of a STEP file as a part: content, chosen faces (by default those of least and greatest x), axes."""

    path: Path
    sha256: str
    clamped: tuple[FaceSelector, ...] = LEAST_X
    loaded: tuple[FaceSelector, ...] = GREATEST_X
    placement: Placement | None = None
    reference_point: tuple[float, float, float] | None = None


@dataclass(frozen=True)
class PartOrder:
    """Everything that determines a part's virtual experiment, and whether pictures of it are wanted."""

    name: PartName
    shape: LinkParameters | SliderParameters
    material: AnyMaterial
    settings: Settings
    step: StepOrder | None = None
    pictures: bool = True
    label: str = field(default="", compare=False)

    def key(self) -> str:
        """Cache key: shape, material, settings, a STEP file's content, and the code that works on them."""
        step = dataclasses.replace(self.step, path=Path()) if self.step else None
        return digest(
            {
                "name": self.name,
                "shape": dataclasses.asdict(step or self.shape),
                "material": dataclasses.asdict(self.material),
                "settings": dataclasses.asdict(self.settings),
                "code": code_version(("stiffscope.cad", "stiffscope.fea"), LIBRARIES),
                "form": FORM,
            }
        )


@dataclass(frozen=True)
class PartResult:
    """A virtual experiment as the cache holds it: files in `folder`, numbers in `facts`."""

    name: PartName
    key: str
    folder: Path
    facts: dict[str, Any]
    pictures: Path | None
    reused: bool
    seconds: float

    @property
    def compliance(self) -> np.ndarray:
        """(6, 6) in the part's axes at its reference point."""
        return np.array(self.facts["compliance"])

    @property
    def error(self) -> np.ndarray:
        """(6, 6) 95 % bounds."""
        return np.array(self.facts["error"])

    @property
    def note(self) -> str:
        """One line on why a wanted tolerance was not met; empty when it was, or when none was wanted."""
        return self.facts["note"]

    @property
    def own_shape(self) -> bool:
        """Whether the solid is the robot file's own shape, not a STEP file's."""
        return self.facts["solid"] == "parametric"

    @property
    def mass(self) -> float:
        """Mass of the solid, kg."""
        return self.facts["mass"]


def order_part(
    robot: RobotFile, name: PartName, step: str | Path | None = None, *, pictures: bool = True, label: str = ""
) -> PartOrder:
    """The experiment that a robot file asks for, on its own shape or on a STEP file's."""
    from stiffscope.fea.experiment import Settings

    section = robot.part(name)
    settings = Settings(interface=section.interface, foundation=section.foundation, **section.mesh.model_dump())
    solid = _step_order(robot, section.step, step)
    shape = robot.parameters(name).present()
    return PartOrder(name, shape, robot.material(name), settings, solid, pictures, label or name)


def _step_order(robot: RobotFile, section: Step | None, given: str | Path | None) -> StepOrder | None:
    """A STEP file given on the command line, with the robot file's choice of faces, or the robot file's own."""
    if given is None and section is None:
        return None
    shown = Path(given or section.file)  # type: ignore[union-attr]
    path = shown if given or shown.is_absolute() else robot.path.parent / shown
    try:
        content = file_digest(path)
    except OSError as error:
        raise InputError(f"{shown}: no STEP file can be read there ({error.strerror})") from error
    if section is None:
        return StepOrder(path.absolute(), content)
    tagged = ("clamped", section.clamped), ("loaded", section.loaded)
    chosen = {tag: tuple(face.selector() for face in faces) for tag, faces in tagged if faces is not None}
    return StepOrder(
        path.absolute(), content, **chosen, placement=section.placement(), reference_point=section.reference_point
    )


def solve_parts(
    orders: Sequence[PartOrder], cache: Cache, spare: Path, reports: Mapping[str, Report] | None = None
) -> list[PartResult]:
    """Results of virtual experiments in the order given, from the cache or made now, side by side in processes.

    Equal orders are made once. `spare` holds results where the cache cannot be written. Neither CAD nor mesher is
    imported for what the cache has. `reports` takes progress, by the orders' labels.
    """
    found = {order: held for order in orders if (held := _held(order, cache)) is not None}
    missing = [order for order in dict.fromkeys(orders) if order not in found]
    if missing:
        from stiffscope.jobs.workers import work_together

        jobs = {order.label: (order, cache.root, spare) for order in missing}
        made = work_together(make_part, jobs, reports or {})
        found |= {order: made[order.label] for order in missing}
    return [found[order] for order in orders]


def _held(order: PartOrder, cache: Cache) -> PartResult | None:
    begun = time.perf_counter()
    key = order.key()
    folder = cache.get("experiment", key)
    if folder is None:
        return None
    drawn = cache.get("pictures", _picture_key(folder)) if order.pictures else None
    if order.pictures and drawn is None:
        return None
    facts = json.loads((folder / FACTS).read_text())
    return PartResult(order.name, key, folder, facts, drawn, reused=True, seconds=time.perf_counter() - begun)


def make_part(order: PartOrder, root: Path, spare: Path, report: Report) -> PartResult:
    """Make what the cache lacks of a part: experiment, exports, pictures. Runs in a child process."""
    begun = time.perf_counter()
    cache, key = Cache(root), order.key()
    folder = cache.get("experiment", key)
    reused = folder is not None
    if folder is None:
        folder = kept(cache, "experiment", key, lambda aside: _experiment(order, aside, report), spare)
    drawn = None
    if order.pictures:
        drawn = cache.get("pictures", _picture_key(folder))
        if drawn is None:
            report("pictures", 0.8)
            drawn = _drawn(cache, order.name, folder, spare)
    report("done", 1.0)
    facts = json.loads((folder / FACTS).read_text())
    return PartResult(order.name, key, folder, facts, drawn, reused=reused, seconds=time.perf_counter() - begun)


def kept(cache: Cache, kind: str, key: str, write: Callable[[Path], object], spare: Path) -> Path:
    """The cache's folder of a result, or one in `spare` where the cache cannot hold it."""
    made = Path(tempfile.mkdtemp(prefix=f"{kind}-", dir=spare))
    write(made)
    kept = cache.put(kind, key, lambda aside: shutil.copytree(made, aside, dirs_exist_ok=True))
    if kept is None:
        return made
    shutil.rmtree(made, ignore_errors=True)
    return kept


def _experiment(order: PartOrder, folder: Path, report: Report) -> None:
    from stiffscope.fea.experiment import run_experiment
    from stiffscope.fea.export import write_vtu
    from stiffscope.jobs import exports

    begun = time.perf_counter()
    report("cad", 0.02)
    part = exports.build_part(order)
    built = time.perf_counter() - begun
    experiment = run_experiment(part, order.settings, lambda stage, fraction: report(stage, 0.1 + 0.65 * fraction))
    report("files", 0.77)
    experiment.save(folder / EXPERIMENT)
    exports.write_solid(part, folder)
    write_vtu(experiment, folder / FIELDS)
    facts = exports.facts_of(order, part, experiment)
    facts["seconds"]["cad"] += built
    (folder / FACTS).write_text(json.dumps(facts))


def _picture_key(folder: Path) -> str:
    return digest({"experiment": file_digest(folder / EXPERIMENT), "code": drawing_code()})


def drawing_code() -> str:
    """Hash of what determines pictures besides their content."""
    return code_version(("stiffscope.report.drawing",), ("pyvista", "vtk", "matplotlib"))


def _drawn(cache: Cache, name: str, folder: Path, spare: Path) -> Path | None:
    """Folder with the part's pictures; None, and one warning, where this machine cannot draw."""
    from stiffscope.report.pictures import PictureError, draw

    facts = json.loads((folder / FACTS).read_text())

    def write(aside: Path) -> None:
        faces = {tag: facts["faces"][tag] for tag in ("clamped", "loaded")}
        draw("part_pictures", aside, experiment=folder / EXPERIMENT, title=name, sheet=SHEET, mesh=MESH, **faces)

    try:
        return kept(cache, "pictures", _picture_key(folder), write, spare)
    except PictureError as error:
        log.warning("%s", error)
        return None
