"""Sensitivity of a part's compliance to its boundary conditions.

Each choice changes one setting of the robot file, as `--set` would.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.linalg import block_diag

from stiffscope.errors import InputError
from stiffscope.experiments.experiments import solve_parts
from stiffscope.experiments.orders import order_part
from stiffscope.fea.experiment import SIGNIFICANT
from stiffscope.robot.file.part_sections import ParametricPart, SolidPart
from stiffscope.robot.part_matrices import entry_name
from stiffscope.vjm.model.screws import shift

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from stiffscope.experiments.experiments import PartResult
    from stiffscope.experiments.part_order import PartOrder
    from stiffscope.robot.file.description import RobotFile
    from stiffscope.runtime.workshop import Workshop

AT_ONCE = 2  # parallel experiments; each may need gigabytes
_COLUMNS = (
    "entry",
    "unit",
    "choice",
    "set",
    "value",
    "bound",
    "change",
    "change_bound",
)
OWN = "as in the robot file"
UNKNOWN = {
    "three pads": "the solid of a STEP file is as it is",
    "bolt holes": 'a STEP file does not say which; choose their washers beside the faces, washer = "18 mm"',
    "foundation": "the robot file gives no foundation of this part, and no thickness to take one from",
}
APART = "the pads are loaded together here, not apart, so that there is one matrix"


@dataclass(frozen=True)
class Choice:
    """A way to hold or load a part: name, description, and the part's keys with their values."""

    name: str
    words: str
    values: tuple[tuple[str, Any], ...] = ()
    part: str = ""

    @property
    def overrides(self) -> tuple[str, ...]:
        """Arguments of `--set` that select it."""
        return tuple(
            f"{self.part}.{key}={_format_value(key, value)}"
            for key, value in self.values
        )


@dataclass(frozen=True)
class Tested:
    """A part's compliance (6, 6) under a choice, 95 % bounds, SI, at the file's reference point."""

    choice: Choice
    result: PartResult
    compliance: np.ndarray
    error: np.ndarray


@dataclass(frozen=True)
class Entry:
    """An entry as in the robot file (SI, with bound), and its relative change by each choice."""

    name: str
    unit: str
    own: float
    error: float
    changes: tuple[float, ...]
    bars: tuple[float, ...]
    place: tuple[int, int]
    """Row and column in the compliance of all interfaces."""


@dataclass(frozen=True)
class Comparison:
    """A part as in the robot file and under other choices; one line for each omitted choice."""

    robot: str
    part: str
    own: Tested
    others: tuple[Tested, ...]
    entries: tuple[Entry, ...]
    left_out: tuple[str, ...]


def compare_interfaces(robot: RobotFile, part: str, shop: Workshop) -> Comparison:
    """Test a part under each choice of boundary conditions.

    Parameters
    ----------
    robot
        Robot from `load_robot`.
    part
        Name of its rod, plate or STEP solid.
    shop
        Runs the experiments.

    Raises
    ------
    InputError
        If the part does not exist or is not a testable solid.
    """
    apart = getattr(robot.parts.get(part), "pads", None) == "apart"
    base = _with(robot, part, {"pads": "together"}) if apart else robot
    base_order = order_part(base, part, label=OWN)
    orders, names, left_out = _orders(base, part, base_order)
    wanted = {Choice(", ".join(names) or OWN, OWN): base_order, **orders}
    results: list[PartResult] = []
    for start in range(0, len(wanted), AT_ONCE):
        results += solve_parts(
            list(wanted.values())[start : start + AT_ONCE], shop, whole=False
        )
    tested = dict(zip(wanted, results, strict=True))
    remarks = [APART, *left_out] if apart else left_out
    return _compare_choices(robot.name, part, tested, remarks)


def choices(robot: RobotFile, part: str) -> list[Choice]:
    """Return the loads and supports to test on a part, with default sizes from its dimensions.

    Default pads are a quarter of the thickness high, bolt holes four thicknesses apart (or as near
    as the ribs permit); the foundation is a layer of the part's material and thickness. A STEP
    solid is not modified, and tested on a foundation only if the file defines one.
    """
    section = robot.part(part)
    if not isinstance(section, SolidPart):
        message = f'expected a part that is a solid, got "{section.shape}"'
        raise robot.refuse(("parts", part, "shape"), message)
    bed = _bed(robot, part)

    def choice(name: str, words: str, **values: float | str | None) -> Choice:
        changed = (
            (k, value)
            for k, value in values.items()
            if getattr(section, k, value) != value
        )
        return Choice(name, words, tuple(changed), part)

    shape = section.parameters() if isinstance(section, ParametricPart) else None
    whole = shape.whole_load if shape else {}
    face = shape.whole_clamp if shape else {}
    even = "the loaded face carries the load evenly"
    loads = [
        choice(
            "rigid face",
            "the loaded face moves as one body",
            interface="rigid",
            **whole,
        ),
        choice("even traction", even, interface="distributed", **whole),
    ]
    still = "the clamped face does not move"
    clamps = [choice("rigid clamp", still, foundation=None, **face)]
    if shape is not None:
        loads += [choice(name, words, **keys) for name, words, keys in shape.loads]
        clamps += [choice(name, words, **keys) for name, words, keys in shape.clamps]
    if bed is not None:
        words = f"springs of {bed / 1e9:.12g} N/mm³ under the clamped face"
        clamps.append(choice("foundation", words, foundation=bed, **face))
    return loads + clamps


def _bed(robot: RobotFile, part: str) -> float | None:
    """Return the foundation stiffness to test, N/m³; None if the part's thickness is unknown."""
    section = robot.part(part)
    material = robot.material(part)
    given = getattr(section, "foundation", None)
    if given or material is None or not isinstance(section, ParametricPart):
        return given
    thickness = section.parameters().across[1]
    return float(f"{material.youngs_modulus / thickness:.3g}")


def _with(robot: RobotFile, part: str, values: Mapping[str, Any]) -> RobotFile:
    """Return the robot with changed values of a part, SI; its bodies are not updated."""
    changed = robot.part(part).model_copy(update=dict(values))
    return dataclasses.replace(robot, parts={**robot.parts, part: changed})


def _format_value(key: str, value: Any) -> str:
    """Format a value as in a robot file."""
    if key == "foundation":
        return "rigid" if value is None else f"{value / 1e9:.12g} N/mm^3"
    return f"{1e3 * value:.12g} mm" if key == "pad_height" else str(value)


def _orders(
    robot: RobotFile, part: str, base_order: PartOrder
) -> tuple[dict[Choice, PartOrder], list[str], list[str]]:
    """Return orders that differ from the file's, names of choices equal to it, and omissions."""
    orders: dict[Choice, PartOrder] = {}
    same: list[str] = []
    known = choices(robot, part)
    names = {choice.name for choice in known}
    unknown = {
        n: why for n, why in UNKNOWN.items() if base_order.step and n not in names
    }
    left_out = [f"{name}: left out, since {why}" for name, why in unknown.items()]
    for choice in known:
        try:
            order = order_part(
                _with(robot, part, dict(choice.values)), part, label=choice.name
            )
        except InputError as error:
            left_out.append(f"{choice.name}: left out; {error}")
            continue
        if order == base_order:
            same.append(choice.name)
        else:
            orders[choice] = order
    return orders, same, left_out


def _compare_choices(
    robot: str, part: str, results: Mapping[Choice, PartResult], left_out: Sequence[str]
) -> Comparison:
    points = next(iter(results.values())).experiment.reference_points
    tested: list[Tested] = []
    for (
        choice,
        result,
    ) in results.items():  # at the same reference points, since pads protrude
        carry = np.asarray(
            block_diag(*shift(points - result.experiment.reference_points))
        )
        error = np.abs(carry) @ result.error @ np.abs(carry.T)
        tested.append(
            Tested(choice, result, carry @ result.compliance @ carry.T, error)
        )
    base_result, *others = tested
    scale = np.sqrt(np.diag(base_result.compliance))
    notable = np.abs(base_result.compliance) > SIGNIFICANT * np.outer(scale, scale)
    shown = np.argwhere(
        np.triu(notable) if len(points) == 1 else np.diag(np.diag(notable))
    )
    entries = [_entry(base_result, others, i, j) for i, j in shown.tolist()]
    return Comparison(
        robot, part, base_result, tuple(others), tuple(entries), tuple(left_out)
    )


def _entry(base_result: Tested, others: Sequence[Tested], i: int, j: int) -> Entry:
    """Return an entry; bounds of its changes add both errors in the worst case."""
    value = float(base_result.compliance[i, j])
    error = float(base_result.error[i, j])
    ratios = np.array([t.compliance[i, j] for t in others]) / value
    bounds = np.array([t.error[i, j] for t in others])
    bars = (bounds + np.abs(ratios) * error) / abs(value)
    name, unit = entry_name(i % 6, j % 6)
    if len(base_result.compliance) > 6:
        name = f"{base_result.result.experiment.interfaces[i // 6 + 1]} {name}"
    changes = tuple((ratios - 1).tolist())
    return Entry(name, unit, value, error, changes, tuple(bars.tolist()), (i, j))


def interfaces_columns(compared: Comparison) -> dict[str, list[Any]]:
    """Return columns of a row for each entry and choice, SI; changes are relative to the file's."""
    columns: dict[str, list[Any]] = {name: [] for name in _COLUMNS}
    for entry in compared.entries:
        others = zip(compared.others, entry.changes, entry.bars, strict=True)
        for tested, change, bar in [(compared.own, 0.0, 0.0), *others]:
            words = "; ".join(tested.choice.overrides)
            texts = (entry.name, entry.unit, tested.choice.name, words)
            numbers = (tested.compliance[entry.place], tested.error[entry.place])
            row = (*texts, *numbers, change, bar)
            for column, value in zip(columns.values(), row, strict=True):
                column.append(value)
    return columns


def interfaces_json(compared: Comparison) -> dict[str, Any]:
    """Return the full matrices as JSON data."""
    return {
        "part": compared.part,
        "reference_point": compared.own.result.experiment.reference_point,
        "choices": [
            {
                "name": t.choice.name,
                "words": t.choice.words,
                "set": list(t.choice.overrides),
                "compliance": t.compliance,
                "error": t.error,
                **t.result.accuracy,
            }
            for t in (compared.own, *compared.others)
        ],
        "left_out": list(compared.left_out),
    }
