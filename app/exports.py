"""Between cad and the cache: building the part that was ordered, its files, and the facts about it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from app.parts import AXES

if TYPE_CHECKING:

    from app.parts import PartOrder
    from cad.part import Part
    from fea.experiment import Experiment


def facts_of(part: Part, experiment: Experiment) -> dict[str, Any]:
    """What is told of a part besides its fields: plain numbers, SI."""
    from cad.part import mass_properties

    solid = mass_properties(part)
    return {
        "part": part.name,
        "compliance": experiment.compliance.tolist(),
        "error": experiment.error.tolist(),
        "reference_point": experiment.reference_point.tolist(),
        "interface": experiment.interface,
        "axes": AXES[part.name],
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
        "seconds": experiment.seconds,
    }


def build_part(order: PartOrder) -> Part:
    """The part that was ordered."""
    from cad import link, slider

    if isinstance(order.shape, link.LinkParameters):
        return link.build(order.shape, order.material)
    return slider.build(order.shape, order.material)
