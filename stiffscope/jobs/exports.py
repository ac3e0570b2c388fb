"""Between cad and the cache: building the part that was ordered, its files, and the facts about it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from stiffscope.jobs.experiments import AXES, STEP_AXES

if TYPE_CHECKING:
    from pathlib import Path

    from stiffscope.cad.part import Part
    from stiffscope.fea.experiment import Experiment
    from stiffscope.jobs.experiments import PartOrder


def facts_of(order: PartOrder, part: Part, experiment: Experiment) -> dict[str, Any]:
    """What is told of a part besides its fields: plain numbers, SI."""
    from stiffscope.cad.part import mass_properties

    solid = mass_properties(part)
    return {
        "part": part.name,
        "compliance": experiment.compliance.tolist(),
        "error": experiment.error.tolist(),
        "reference_point": experiment.reference_point.tolist(),
        **({} if len(experiment.reference_points) == 1 else _apart(experiment)),
        "interface": experiment.interface,
        "foundation": order.settings.foundation,
        "tolerance": order.settings.tolerance,
        "relative_bound": experiment.relative_bound,
        "note": experiment.note,
        "axes": STEP_AXES if order.step else AXES[order.name],
        "solid": order.step.path.name if order.step else "parametric",
        "mesh": {"nodes": len(experiment.mesh.points), "tetrahedra": len(experiment.mesh.cells), "order": 2},
        "volume": experiment.volume,
        "cad_volume": experiment.cad_volume,
        "mass": solid.mass,
        "mass_centre": list(map(float, solid.centre)),
        "inertia": [list(map(float, row)) for row in solid.inertia],
        "imbalance": experiment.imbalance,
        "faces": {
            "clamped": sorted(int(face) for face in part.clamped),
            "loaded": sorted(int(face) for port in part.loaded for face in port.faces),
        },
        "seconds": dict(experiment.seconds),
    }


def _apart(experiment: Experiment) -> dict[str, Any]:
    """All n interfaces together, where there are several: (6n, 6n), in the order of the points."""
    return {
        "reference_points": experiment.reference_points.tolist(),
        "flexibility": experiment.flexibility.tolist(),
        "flexibility_error": experiment.flexibility_error.tolist(),
    }


def build_part(order: PartOrder) -> Part:
    """The part that was ordered: its own shape, or the solid of a STEP file."""
    from stiffscope.cad import link, slider
    from stiffscope.cad.step import read_step

    if order.step:
        return read_step(
            order.step.path, name=order.name, material=order.material, clamped=order.step.clamped,
            loaded=order.step.loaded, placement=order.step.placement, reference_point=order.step.reference_point,
        )  # fmt: skip
    if isinstance(order.shape, link.LinkParameters):
        return link.build(order.shape, order.material)
    return slider.build(order.shape, order.material)


def write_solid(part: Part, folder: Path) -> None:
    """The solid as STEP and STL, mm."""
    from stiffscope.cad.step import write_step, write_stl

    write_step(part, folder / f"{part.name}.step")
    write_stl(part, folder / f"{part.name}.stl")
