"""Results of a part's virtual experiment, with its files and JSON data."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from stiffscope.robot.part_matrices import beam_compliance

if TYPE_CHECKING:
    from pathlib import Path

    import numpy as np

    from stiffscope.experiments.orders import PartOrder
    from stiffscope.fea.experiment import Experiment
    from stiffscope.robot.file.description import RobotFile

DYNAMICS = (
    "self_weight",
    "self_weight_error",
    "frequencies",
    "frequency_error",
    "mode_squares",
    "mode_squares_error",
    "condensed_mass",
)
EXPERIMENT, SOLID, FIELDS = "experiment.npz", "solid.json", "fields.vtu"
AXES = {
    "rod": "x along the rod from its clamped end; twist (v, omega) and wrench (f, m) at the centre of the loaded end",
    "plate": "x away from the clamped face, y across, z through the plate, to the side of its ribs; "
    "twist (v, omega) and wrench (f, m) at the centre of the loaded face",
    "step": "those of the STEP file, or of the frame chosen in it; "
    "twist (v, omega) and wrench (f, m) at the loaded faces' reference point",
}


@dataclass(frozen=True)
class PartResult:
    """A part's virtual experiment and its cached files.

    Attributes
    ----------
    order, key : order of the experiment, and its cache key.
    folder : its files: experiment (npz) and, if whole, fields (vtu) and solid (STEP, STL).
    experiment : response to unit wrenches; no fields and modes if only the compliance was computed.
    solid : CAD properties: mass in kg, mass_centre in m, inertia in kg·m², clamped_centre (of the
        clamped faces) in m, face numbers.
    reused, seconds : whether it was cached, and the time it took now.
    """

    order: PartOrder
    key: str
    folder: Path
    experiment: Experiment
    solid: dict[str, Any]
    reused: bool
    seconds: float

    @property
    def name(self) -> str:
        """Name of the part."""
        return self.order.name

    @property
    def compliance(self) -> np.ndarray:
        """Compliance (6m, 6m) of the m loaded ends at their reference points, part axes."""
        return self.experiment.full_compliance

    @property
    def error(self) -> np.ndarray:
        """95 % bounds (6m, 6m) on the compliance."""
        return self.experiment.full_error

    @property
    def note(self) -> str:
        """One line on why a requested tolerance was not met; empty if met or not requested."""
        return self.experiment.note

    @property
    def accuracy(self) -> dict[str, Any]:
        """Requested tolerance, largest bound, reason if it exceeds the tolerance, and mesh size."""
        mesh = self.experiment.mesh
        return {
            "tolerance": self.order.settings.tolerance,
            "relative_bound": self.experiment.relative_bound,
            "note": self.note,
            "mesh": {"nodes": len(mesh.points), "tetrahedra": len(mesh.cells), "order": 2},
        }

    @property
    def own_shape(self) -> bool:
        """Whether the solid is the robot file's parametric shape, not a STEP file's."""
        return self.order.step is None

    @property
    def mass(self) -> float:
        """Mass of the solid, kg."""
        return self.solid["mass"]

    @property
    def length(self) -> float:
        """Distance from the clamped faces to the reference point along the part's x, m."""
        return float(self.experiment.reference_point[0] - self.solid["clamped_centre"][0])

    @property
    def facts(self) -> dict[str, Any]:
        """Results of a whole experiment except its fields, as plain numbers, SI."""
        experiment, order = self.experiment, self.order
        together: dict[str, Any] = {}
        if len(experiment.reference_points) > 1:
            together = {
                "interfaces": list(experiment.interfaces),
                "places": experiment.places,
                "reference_points": experiment.reference_points,
                "flexibility": experiment.full_compliance,
                "flexibility_error": experiment.full_error,
                "stiffness": experiment.stiffness,
                "stiffness_error": experiment.stiffness_error,
            }
        return {
            "part": self.name,
            "compliance": experiment.compliance,
            "error": experiment.error,
            "reference_point": experiment.reference_point,
            **together,
            "interface": experiment.interface,
            "foundation": order.settings.foundation,
            **self.accuracy,
            "axes": AXES[order.shape],
            "solid": order.step.path.name if order.step else "parametric",
            "volume": experiment.volume,
            "cad_volume": experiment.cad_volume,
            **{name: self.solid[name] for name in ("mass", "mass_centre", "inertia")},
            **{name: getattr(experiment, name) for name in DYNAMICS},
            "seconds": experiment.seconds,
        }


def compliance_json(robot: RobotFile, result: PartResult) -> dict[str, Any]:
    """Return a part's results as JSON data; beam theory only applies to parametric shapes."""
    beam = beam_compliance(robot, result.name) if result.own_shape else None
    return {**result.facts, "beam": beam, "cached": result.reused}
