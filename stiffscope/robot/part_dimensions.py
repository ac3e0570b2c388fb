"""The 6x6 of a part as a function of its dimensions, material and foundation."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.errors import require
from stiffscope.robot.file.part_sections import ParametricPart
from stiffscope.robot.part_matrices import beam_compliance

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from stiffscope.robot.file.description import RobotFile
    from stiffscope.runtime.types import Array

FOUNDATION = "foundation"
_FAR = 4.0  # validity of a polynomial through three values, times the distance of the outermost
_NEAR = 1.5  # the same with more values: higher orders diverge sooner


@dataclass(frozen=True)
class PartDimension:
    """A parameter of a part, and the part's compliance (6, 6) at its tip, part axes, as a function.

    ``nominal`` is in ``unit``, SI; infinite for a rigid foundation. ``compliance`` takes a value of
    the parameter, and raises InputError if the part is infeasible.
    """

    part: str
    parameter: str
    nominal: float
    unit: str
    compliance: Callable[[float], Array]
    limit: float = 0.0
    """Value at which the part vanishes."""

    @property
    def place(self) -> str:
        """Place as named by effects: `PART.PARAMETER`."""
        return f"{self.part}.{self.parameter}"


def part_parameters(robot: RobotFile, name: str) -> dict[str, tuple[float, str]]:
    """Return nominal value and SI unit of each parameter of a parametric part; else nothing.

    Its length, zero dimensions and dimensions of absent features are omitted.
    """
    part = robot.parts[name]
    if not isinstance(part, ParametricPart):
        return {}
    lengths = part.parameters().lengths().items()
    out = {
        key: (value, "m") for key, value in lengths if key not in part.describes.along
    }
    material = robot.material(name)
    for field in fields(material) if material is not None else ():  # type: ignore[arg-type]
        if field.name.endswith("modulus"):
            out[field.name] = (float(getattr(material, field.name)), "Pa")
    return out


def find_vanishing(robot: RobotFile, name: str, parameter: str) -> float:
    """Return the value of a parameter at which its part vanishes (a tube without wall), else 0.

    Parameters
    ----------
    robot
        Robot file.
    name
        Name of the part.
    parameter
        Name of the parameter.
    """
    part = robot.parts[name]
    if not isinstance(part, ParametricPart):
        return 0.0
    return part.parameters().vanishing(parameter)


def with_parameter(
    robot: RobotFile, name: str, parameter: str, value: float
) -> RobotFile:
    """Return the robot with one part parameter changed: dimension, foundation or material constant.

    An infinite foundation is rigid. Raises InputError if the value makes the part infeasible.

    Parameters
    ----------
    robot
        Robot file.
    name
        Name of the part.
    parameter
        Name of the parameter.
    value
        New value, SI.
    """
    part = robot.parts[name]
    parametric = isinstance(part, ParametricPart)
    if parameter == FOUNDATION or (parametric and parameter in part.dimensions()):
        rigid = parameter == FOUNDATION and np.isinf(value)
        changed = part.model_copy(update={parameter: None if rigid else value})
        if isinstance(changed, ParametricPart):
            changed.parameters()
        return replace(robot, parts={**robot.parts, name: changed})
    material: Any = robot.material(name)
    new_name = f"{material.name} of {name}"
    changed = part.model_copy(update={"material": new_name})
    materials = {
        **robot.materials,
        new_name: replace(material, name=new_name, **{parameter: value}),
    }
    return replace(robot, parts={**robot.parts, name: changed}, materials=materials)


def beam_dimensions(robot: RobotFile, name: str) -> tuple[PartDimension, ...]:
    """Return the parameters that affect the matrix of a part by beam theory."""
    out: list[PartDimension] = []
    nominal = beam_compliance(robot, name)
    for key, (value, unit) in part_parameters(robot, name).items():
        compliance = partial(_beam, robot, name, key)
        limit = find_vanishing(robot, name, key)
        if not np.allclose(compliance(1.01 * value), nominal, rtol=1e-9, atol=0.0):
            out.append(
                PartDimension(
                    part=name,
                    parameter=key,
                    nominal=value,
                    unit=unit,
                    compliance=compliance,
                    limit=limit,
                )
            )
    return tuple(out)


def _beam(robot: RobotFile, name: str, parameter: str, value: float) -> Array:
    return beam_compliance(with_parameter(robot, name, parameter, value), name)


def interpolate_between(
    values: Sequence[float],
    matrices: Sequence[Array],
    limit: float = 0.0,
    legal: tuple[float, float] = (-np.inf, np.inf),
) -> Callable[[float], Array]:
    """Return the compliance as a function of a parameter, interpolated between experiments.

    It is a polynomial in the logarithm of the distance to the limit at which the part vanishes:
    exact for power laws, and a power law when extrapolated. The function raises InputError for a
    value beyond the limit or outside the ``legal`` range.

    Parameters
    ----------
    values
        Values of the parameter, the nominal one first.
    matrices
        Compliances (6, 6) at the values.
    limit
        Value at which the part vanishes (see `find_vanishing`).
    legal
        Lower and upper bound of admissible values.
    """
    at = np.array(values, dtype=float)
    return partial(_interpolate_near, at, np.array(matrices), limit, legal)


def _interpolate_near(
    values: Array,
    matrices: Array,
    limit: float,
    legal: tuple[float, float],
    value: float,
) -> Array:
    side = f"a value to the other side of {limit:g}, where nothing is left"
    require((value - limit) * (values[0] - limit) > 0.0, "", side, f"{value:g}")
    low, high = legal
    between = f"a value between {low:g} and {high:g}"
    require(low < value < high, "", between, f"{value:g}")
    return _polynomial(
        np.log(np.abs(values - limit)), matrices, float(np.log(abs(value - limit)))
    )


def on_foundation(
    rigid: Array, values: Sequence[float], matrices: Sequence[Array]
) -> Callable[[float], Array]:
    """Return the compliance on any foundation (N/m³), interpolated between elastic and rigid ones.

    The added compliance is a polynomial in the logarithm of the stiffness, and inversely
    proportional to the stiffness beyond the tested values.

    Parameters
    ----------
    rigid
        Compliance (6, 6) on a rigid foundation.
    values
        Stiffnesses of the foundations, N/m³.
    matrices
        Compliances (6, 6) at the values.
    """
    added = np.array(matrices) - rigid
    softer = (np.einsum("kii->ki", added) > 0.0).all(axis=1)
    return partial(_add_foundation, rigid, np.array(values)[softer], added[softer])


def _add_foundation(
    rigid: Array, stiffness: Array, added: Array, value: float
) -> Array:
    if not len(stiffness):  # practically rigid
        return rigid
    inside = float(np.clip(value, stiffness.min(), stiffness.max()))
    return rigid + _polynomial(np.log(stiffness), added, float(np.log(inside))) * (
        inside / value
    )


def _polynomial(at: Array, matrices: Array, x: float) -> Array:
    """Interpolate matrices (k, 6, 6) at abscissas (k,) by a polynomial; extrapolate by its tangent.

    Diagonal entries are interpolated by logarithm, others by their ratio to ``sqrt(C_ii C_jj)``.
    """
    reach = _FAR if len(at) <= 3 else _NEAR
    low, high = (float(at[0] + reach * (end - at[0])) for end in (at.min(), at.max()))
    inside = min(max(x, low), high)
    step = 1e-4 * max(high - low, 1e-12)
    weights, above, below = (
        np.array([np.prod([(place - b) / (a - b) for b in at if b != a]) for a in at])
        for place in (inside, inside + step, inside - step)
    )
    roots = np.sqrt(np.einsum("kii->ki", matrices))
    shares = np.einsum(
        "k,kij->ij", weights, matrices / (roots[:, :, None] * roots[:, None, :])
    )
    root = np.exp(
        (weights + (x - inside) * (above - below) / (2.0 * step)) @ np.log(roots)
    )
    return shares * np.outer(root, root)


def is_beam(robot: RobotFile, name: str, compliance: Array) -> bool:
    """Return whether a part's compliance (6, 6) equals that of beam theory.

    Parameters
    ----------
    robot
        Robot file.
    name
        Name of the part.
    compliance
        Compliance (6, 6), SI.
    """
    part = robot.parts.get(name)
    if part is None or "beam" not in part.sources or robot.material(name) is None:
        return False
    return bool(
        np.allclose(beam_compliance(robot, name), compliance, rtol=1e-9, atol=0.0)
    )
