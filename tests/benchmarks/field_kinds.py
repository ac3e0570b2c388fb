"""Fresh variants of what failed in the field, on arms drawn at random.

The mechanics are those of `traps`, independent of the library. Every variant has another arm
(lengths, masses, drives), other postures and another size of its fault::

    python -m tests.benchmarks.field_kinds [--only TEXT] [--variants N] [--seed N]

prints how often each kind is *right*, *honest* (nothing is certain) or *false* (something else is
certain).
"""

from __future__ import annotations

import argparse
import tempfile
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tests.benchmarks.traps import (
    CROSS,
    GRAVITY,
    Arm,
    Drive,
    Trap,
    change_values,
    diagnose,
    judge,
    measure_loads,
    measure_rest,
    repeat,
    soft,
    write,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from tests.benchmarks.traps import Table

AXES = ((0, 0, 1), (0, 1, 0), (0, 1, 0))
DRIVES = (r"actuator-stiffness @ (J\d|drives)",)


def draw_arm(rng) -> Arm:
    """Return an arm of three joints with lengths, masses and drives of its own."""
    shoulder, elbow, reach = rng.uniform([0.25, 0.3, 0.3], [0.6, 0.7, 0.6]).round(3)
    top = shoulder + elbow
    masses = rng.uniform([8, 5, 3], [25, 14, 8]).round(2)
    centres = ((0, 0, shoulder / 2), (0, 0, shoulder + elbow / 2), (reach / 2, 0, top))
    scale = rng.uniform([5e4, 4e4, 1.5e4], [12e4, 9e4, 4e4]).round(-2)
    return Arm(
        drives=tuple(map(Drive, scale)),
        at=((0.0, 0.0, 0.0), (0.0, 0.0, shoulder), (0.0, 0.0, top)),
        tool=(reach, 0.0, top),
        masses=tuple(zip(masses, centres, strict=True)),
    )


def describe(arm: Arm) -> str:
    """Return the robot file of an arm."""
    lines = ['name = "field-arm"']
    for k, (mass, centre) in enumerate(arm.masses):
        place = ", ".join(f"{x:.9g}" for x in centre)
        lines += [
            f"[bodies.link{k + 1}]",
            f'mass = "{mass:g} kg"',
            f"centre = [{place}]",
        ]
    for k, (at, axis, drive) in enumerate(zip(arm.at, AXES, arm.drives, strict=True)):
        below = f"link{k}" if k else "ground"
        lines += [
            f"[joints.J{k + 1}]",
            f'between = ["{below}", "link{k + 1}"]',
            'type = "revolute"',
            f"at = [{', '.join(f'{x:.9g}' for x in at)}]",
            f"axis = {list(axis)}",
            f'drive = {{ stiffness = "{drive.stiffness:.9g} N*m/rad" }}',
        ]
    tool = ", ".join(f"{x:.9g}" for x in arm.tool)
    lines += ["[tool]", 'body = "link3"', f"at = [{tool}]", 'pose = ["x", "y", "z"]']
    weight = f"acceleration = {-GRAVITY[2]}"
    return "\n".join([*lines, "[gravity]", weight, "direction = [0, 0, -1]", ""])


def soften(arm: Arm, **factors: float) -> Arm:
    """Return an arm with factors on the stiffness of drives, by name."""
    drives = [
        replace(d, stiffness=d.stiffness * factors.get(f"J{k + 1}", 1.0))
        for k, d in enumerate(arm.drives)
    ]
    return replace(arm, drives=tuple(drives))


def sag(rng, arm: Arm) -> Table:
    """Measure where the unloaded tool of an arm with two soft drives is."""
    factors = rng.uniform(0.4, 0.75, 2)
    arm = soften(arm, J2=factors[0], J3=factors[1])
    return measure_sag(rng, arm)


def measure_sag(rng, arm: Arm) -> Table:
    """Return deviations of an unloaded arm from its rigid self."""
    return measure_rest(rng, arm, drawn=replace(arm, weight=0.0))


def unmodelled_sag(rng, arm: Arm) -> Table:
    """The same, with a header that says that the model has no weight."""
    return replace(sag(rng, arm), modelled="[]")


def curve(rng, arm: Arm) -> Table:
    """Measure a spring whose stiffness changes smoothly with the load, at one posture."""
    force = rng.uniform(60, 150)
    loads = [(0, 0, -f) for f in np.linspace(0.1 * force, force, 12)]
    table = measure_loads(rng, arm, 1, loads, 0.0)
    power = rng.uniform(0.5, 2.5)
    low = rng.uniform(0.3, 0.6)
    share = [low + 1.2 * abs(row[1][2] / force) ** power for row in table.rows]
    along = np.array([row[2] == "dz" for row in table.rows])
    bent = change_values(table, lambda v: np.where(along, v * share, v))
    noise = 3e-6 * rng.standard_normal(len(share))
    return change_values(bent, lambda v: v + noise)


def cross_talk(rng, arm: Arm) -> Table:
    """Measure loads with a force sensor that shows shares of fz in fx and fy."""
    a, b = rng.uniform(0.04, 0.12, 2) * rng.choice([-1, 1], 2)

    def stated(force):
        return np.array([force[0] + a * force[2], force[1] + b * force[2], force[2]])

    return measure_loads(rng, arm, stated=stated)


def draw_offset(rng) -> np.ndarray:
    """Return by how much a tool point is off, 10 to 40 mm along x, less along z; m."""
    return np.array([rng.uniform(0.01, 0.04), 0.0, rng.uniform(-0.02, 0.02)])


def offset_loaded(rng, arm: Arm) -> Table:
    """Measure loads at a tool point that is not where the file has it."""
    tool = tuple(np.array(arm.tool) + draw_offset(rng))
    return measure_loads(rng, replace(arm, tool=tool))


def offset_unloaded(rng, arm: Arm) -> Table:
    """Measure the unloaded tool at a point that is not where the file has it."""
    tool = tuple(np.array(arm.tool) + draw_offset(rng))
    rigid = replace(arm, weight=0.0)
    return measure_rest(rng, replace(arm, tool=tool), drawn=rigid)


def copies(rng, arm: Arm) -> Table:
    """Measure a slightly soft drive with a coarse instrument, every row pasted four times."""
    arm = soften(arm, J2=rng.uniform(0.6, 0.8))
    return repeat(measure_loads(rng, arm, 4, noise=2e-5))


def second_order(rng, arm: Arm) -> Table:
    """Measure a soft drive under loads that turn their own levers."""
    arm = soften(arm, J2=rng.uniform(0.25, 0.5))
    return measure_loads(rng, arm, loads=[rng.uniform(3, 5) * f for f in CROSS])


@dataclass(frozen=True)
class Kind:
    """A kind of case from the field: how it is measured, what may be named, which sigma is stated."""

    name: str
    measure: Callable
    right: tuple[str, ...]
    stated: tuple[bool, ...] = (True, False)


WEIGHT = ("gravity @ robot", *DRIVES)
TOOL = ("tool-offset @ tool",)
LEAK = (r"force-cross-talk @ .*",)
KINDS = (
    Kind("01 sag of soft drives, weight modelled", sag, DRIVES),
    Kind("01 sag of soft drives, no weight", unmodelled_sag, WEIGHT),
    Kind("03 curve at one posture", curve, (), (False,)),
    Kind("08 two soft drives", sag, DRIVES, (True,)),
    Kind("09 cross-talk of the force", cross_talk, LEAK),
    Kind("10 tool offset, loaded", offset_loaded, TOOL),
    Kind("10 tool offset, unloaded", offset_unloaded, TOOL),
    Kind("12 copies of rows", copies, soft(2), (False,)),
    Kind("14 second order", second_order, soft(2), (True,)),
)


def answer(kind: Kind, variant: int, stated: bool, seed: int = 0) -> tuple[str, str]:
    """Return the score of one variant, and what is answered."""
    rng = np.random.default_rng(
        [variant, *kind.name.encode(), *([seed] if seed else [])]
    )
    arm = draw_arm(rng)
    table = replace(kind.measure(rng, arm), robot=describe(arm))
    with tempfile.TemporaryDirectory() as folder:
        case = Path(folder) / "case"
        write(case, table, stated)
        found = diagnose(case)
    score, certain = judge(Trap(kind.name, kind.measure, kind.right), found)
    return score, f"{found['verdict']}: {', '.join(certain) or 'nothing'}"


def main() -> None:
    """Print how often each kind is right."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", help="kinds whose names contain this")
    parser.add_argument("--variants", type=int, default=10)
    parser.add_argument("--seed", type=int, default=0, help="of other variants")
    given = parser.parse_args()
    for kind in KINDS:
        for stated in kind.stated if given.only in kind.name else ():
            answers = [
                answer(kind, v, stated, given.seed) for v in range(given.variants)
            ]
            count = dict(Counter(score for score, _ in answers))
            print(f"{kind.name}, sigma {'stated' if stated else 'empty'}: {count}")
            for score, words in answers:
                if score != "right":
                    print(f"  {score}: {words}", flush=True)


if __name__ == "__main__":
    main()
