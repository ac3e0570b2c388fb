"""How the 6x6 of a part changes with its dimensions, its material and its foundation."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.robot.part_matrices import beam_compliance
from stiffscope.robot.part_sections import ParametricPart

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from stiffscope.robot.description import RobotFile

    Array = NDArray[np.floating[Any]]

FOUNDATION = "foundation"
_FEATURES = {"rib": "rib_count", "fillet": "rib_count", "hole": "hole_count", "pad": "pad_height"}
_ALONG = {"length", "depth", "pad_height"}  # from the base to the tip, which the bodies' places say too


@dataclass(frozen=True)
class PartDimension:
    """A parameter of a part and the compliance (6, 6) that the part has with it, in the part's axes at its tip.

    ``nominal`` in ``unit``, SI; infinite for a rigid foundation. ``compliance`` of a value of the parameter; it raises
    InputError for one that makes no part.
    """

    part: str
    parameter: str
    nominal: float
    unit: str
    compliance: Callable[[float], Array]

    @property
    def place(self) -> str:
        """As effects have it: `PART.PARAMETER`."""
        return f"{self.part}.{self.parameter}"


def part_parameters(robot: RobotFile, name: str) -> dict[str, tuple[float, str]]:
    """Nominal value and SI unit of what may be otherwise about a rod or plate; nothing for other parts.

    Dimensions that are zero, and those of features that it does not have, are left out, and so is its length.
    """
    part = robot.parts[name]
    if not isinstance(part, ParametricPart):
        return {}
    size = part.dimensions()
    out = {
        key: (value, "m")
        for key, value in part.lengths().items()
        if value > 0.0 and key not in _ALONG and size.get(_FEATURES.get(key.split("_")[0], ""), 1)
    }
    if size.get("fitting_radius", 1.0) == 0.0:
        out.pop("fitting_length", None)
    material = robot.material(name)
    for field in fields(material) if material is not None else ():  # type: ignore[arg-type]
        if field.name.endswith("modulus"):
            out[field.name] = (float(getattr(material, field.name)), "Pa")
    return out


def with_parameter(robot: RobotFile, name: str, parameter: str, value: float) -> RobotFile:
    """The robot with one parameter of a part changed: a dimension, its foundation, or its own material's constant.

    Raises InputError for a value that makes no part.
    """
    part = robot.parts[name]
    if parameter == FOUNDATION or (isinstance(part, ParametricPart) and parameter in part.dimensions()):
        changed = part.model_copy(update={parameter: value})
        if isinstance(changed, ParametricPart):
            changed.parameters()
        return replace(robot, parts={**robot.parts, name: changed})
    material: Any = robot.material(name)
    own = f"{material.name} of {name}"
    changed = part.model_copy(update={"material": own})
    materials = {**robot.materials, own: replace(material, name=own, **{parameter: value})}
    return replace(robot, parts={**robot.parts, name: changed}, materials=materials)


def beam_dimensions(robot: RobotFile, name: str) -> tuple[PartDimension, ...]:
    """Parameters of a part whose matrix is that of beam theory: the ones that its matrix depends on."""
    out: list[PartDimension] = []
    nominal = beam_compliance(robot, name)
    for parameter, (value, unit) in part_parameters(robot, name).items():
        compliance = partial(_beam, robot, name, parameter)
        if not np.allclose(compliance(1.01 * value), nominal, rtol=1e-9, atol=0.0):
            out.append(PartDimension(name, parameter, value, unit, compliance))
    return tuple(out)


def _beam(robot: RobotFile, name: str, parameter: str, value: float) -> Array:
    return beam_compliance(with_parameter(robot, name, parameter, value), name)


def between(values: Sequence[float], matrices: Sequence[Array]) -> Callable[[float], Array]:
    """The compliance of any value near three, or two of a foundation and infinity, by what experiments say at these.

    Diagonal entries by their logarithms, the others by their share of ``sqrt(C_ii C_jj)``: quadratic in the logarithm
    of the value, of a foundation in its reciprocal; exact for powers of the value.
    """
    return partial(
        _interpolated, tuple(_abscissa(v, values) for v in values), tuple(matrices), not np.isfinite(values[0])
    )


def _abscissa(value: float, values: Sequence[float]) -> float:
    return 1.0 / value if not np.isfinite(values[0]) else float(np.log(value))


def _interpolated(at: tuple[float, ...], matrices: tuple[Array, ...], reciprocal: bool, value: float) -> Array:
    x = 1.0 / value if reciprocal else float(np.log(value))
    weights = [np.prod([(x - b) / (a - b) for b in at if b != a]) for a in at]
    roots = [np.sqrt(np.diagonal(m)) for m in matrices]
    shares = sum(w * (m / np.outer(r, r)) for w, m, r in zip(weights, matrices, roots, strict=True))
    if reciprocal:
        root = np.sqrt(sum(w * r**2 for w, r in zip(weights, roots, strict=True)))
    else:
        root = np.exp(sum(w * np.log(r) for w, r in zip(weights, roots, strict=True)))
    return shares * np.outer(root, root)


def is_beam(robot: RobotFile, name: str, compliance: Array) -> bool:
    """Whether a part's compliance (6, 6) is that of beam theory."""
    part = robot.parts.get(name)
    if not isinstance(part, ParametricPart) or robot.material(name) is None:
        return False
    return bool(np.allclose(beam_compliance(robot, name), compliance, rtol=1e-9, atol=0.0))
