"""A part's finished experiment with its files, and what scripts read of it."""

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
    """A part's virtual experiment, and the files of it that the cache holds.

    Attributes
    ----------
    order, key : what was asked for, and its cache key.
    folder : where its files are: the experiment (npz); of a whole one the fields (vtu) and the solid (STEP, STL).
    experiment : what the unit wrenches did; without fields and modes where only the compliance was wanted.
    solid : of the solid in CAD: mass in kg, mass_centre in m, inertia in kg·m², clamped_centre (of the clamped
        faces) in m, numbers of its faces.
    reused, seconds : whether the cache had it, and the time that it took now.
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
        """The part's name."""
        return self.order.name

    @property
    def compliance(self) -> np.ndarray:
        """(6m, 6m) in the part's axes: of its m ends but the first, each at its reference point."""
        return self.experiment.full_compliance

    @property
    def error(self) -> np.ndarray:
        """(6m, 6m) 95 % bounds."""
        return self.experiment.full_error

    @property
    def note(self) -> str:
        """One line on why a wanted tolerance was not met; empty when it was, or when none was wanted."""
        return self.experiment.note

    @property
    def accuracy(self) -> dict[str, Any]:
        """The wanted tolerance, the largest bound, why it is more, and the mesh: plain numbers."""
        mesh = self.experiment.mesh
        return {
            "tolerance": self.order.settings.tolerance,
            "relative_bound": self.experiment.relative_bound,
            "note": self.note,
            "mesh": {"nodes": len(mesh.points), "tetrahedra": len(mesh.cells), "order": 2},
        }

    @property
    def own_shape(self) -> bool:
        """Whether the solid is the robot file's own shape, not a STEP file's."""
        return self.order.step is None

    @property
    def mass(self) -> float:
        """Mass of the solid, kg."""
        return self.solid["mass"]

    @property
    def length(self) -> float:
        """From the clamped faces to the reference point along the part's x, m."""
        return float(self.experiment.reference_point[0] - self.solid["clamped_centre"][0])

    @property
    def facts(self) -> dict[str, Any]:
        """What is told of a part of a whole experiment besides its fields: plain numbers, SI."""
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
    """What scripts read of a part; beam theory knows the own shape alone, not a STEP file's solid."""
    beam = beam_compliance(robot, result.name) if result.own_shape else None
    return {**result.facts, "beam": beam, "cached": result.reused}
