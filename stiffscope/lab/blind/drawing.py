"""Drawing of blind cases: a series of campaigns with faults that readings can identify."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from stiffscope.lab.blind.cases import BlindCase
from stiffscope.lab.blind.hammering import (
    HammerBench,
    draw_hammer,
    write_hammer_case,
)
from stiffscope.lab.blind.judge import VISIBLE, Judge, ReadingBench
from stiffscope.lab.blind.sizes import can_have, choose, draw_known, draw_outside
from stiffscope.lab.faults import OUTSIDE
from stiffscope.lab.measuring import Noise, measure, write_readings
from stiffscope.lab.plans import draw_plan

if TYPE_CHECKING:
    from pathlib import Path

    from stiffscope.lab.blind.cases import Fault
    from stiffscope.lab.blind.judge import Bench
    from stiffscope.lab.blind.laboratory import Lab
    from stiffscope.lab.closure import Located
    from stiffscope.lab.machine import Machine
    from stiffscope.lab.measuring import Plan
    from stiffscope.lab.plans import Style

KINDS = (*["single"] * 3, *["pair"] * 2, *["triple"] * 2, "none", *["outside"] * 2)
"""Kinds of cases in turn, with a fixed share of each in every ten."""
STYLES: tuple[Style, ...] = (
    "tool",
    "gauges",
    "tool",
    "gauges",
    "tool",
    "sag",
    "tracker",
)
"""Styles of measurement in turn, ten campaigns each."""
_BY_COUNT = ("none", "single", "pair", "triple")
_ATTEMPTS = 24  # most attempts to add a fault
_SERIES = 6  # most series of attempts


def draw_case(number: int, seed: int, lab: Lab) -> BlindCase:
    """Draw the case of a number in a series: the kind in turn, effects and sizes at random.

    The case can be answered: every effect is identifiable without noise for any parameters of the
    others, and at most two known effects with as few parameters mimic it. If fewer such faults are
    found than wanted, the case is of their kind, and without faults if there are none: e.g. the sag
    of a hexapod shows no compliance, and six errors of a strut's length are indistinguishable.
    """
    rng = np.random.default_rng([seed, number])
    kind = KINDS[number % len(KINDS)]
    style = STYLES[number // len(KINDS) % len(STYLES)]
    if lab.robot.hammered:
        style = "hammer"
    if kind == "none":
        return BlindCase(kind, seed, (), style)
    if kind == "outside":
        effect = choose(rng, [name for name in OUTSIDE if can_have(lab, name, style)])
        return BlindCase(kind, seed, (draw_outside(effect, rng, lab, style),), style)
    judge = Judge(lab, _open_bench(BlindCase(kind, seed, (), style), number, lab))
    turn = number // len(KINDS) * 3 + number % len(
        KINDS
    )  # single effects are taken in turn
    wanted = _BY_COUNT.index(kind)
    faults = ()
    for _ in range(_SERIES):
        faults = max(faults, _draw_faults(wanted, turn, rng, judge), key=len)
        if len(faults) == wanted:
            break
    return BlindCase(_BY_COUNT[len(faults)], seed, faults, style)


def _draw_faults(
    count: int, turn: int, rng: np.random.Generator, judge: Judge
) -> tuple[Fault, ...]:
    """Draw up to `count` identifiable faults of different effects; a single one by its turn."""
    lab = judge.lab
    faults: tuple[Fault, ...] = ()
    for _ in range(count):
        left = [
            word
            for word in judge.words
            if word not in {fault.effect for fault in faults}
        ]
        for attempt in range(_ATTEMPTS if count > 1 else max(_ATTEMPTS, 3 * len(left))):
            word = (
                left[(turn + attempt // 3) % len(left)]
                if count == 1
                else choose(rng, left)
            )
            tried = (
                *faults,
                draw_known(
                    word,
                    rng,
                    lab,
                    judge.sensors,
                    alone=count == 1 and not lab.robot.hammered,
                ),
            )
            if judge.can_decide(tried):
                faults = tried
                break
        else:
            break
    return faults


def is_imitated(case: BlindCase, number: int, lab: Lab) -> bool:
    """Return whether a few known effects mimic a case's fault outside the vocabulary.

    They do if they leave less of its signature than a drawn fault must show. A fault that only
    shows in noisy readings, e.g. of a coarse converter, does not count as imitated.
    """
    size, left = Judge(lab, _open_bench(case, number, lab)).distance(case.faults[0])
    return left < VISIBLE <= size


def _open_bench(case: BlindCase, number: int, lab: Lab) -> Bench:
    """Return how the sound machine of a case is measured."""
    if case.style == "hammer":
        return HammerBench(lab, *draw_hammer(lab, _start_noise(case, number)))
    _, plan, located, _ = prepare_case(case, number, lab)
    return ReadingBench(lab, plan, located)


def _start_noise(case: BlindCase, number: int) -> np.random.Generator:
    """Return the random generator of a case's plan and noise."""
    return np.random.default_rng([case.seed, number, 1])


def prepare_case(
    case: BlindCase, number: int, lab: Lab
) -> tuple[Machine, Plan, Located, np.random.Generator]:
    """Return the true machine of a case, its plan and configuration, and the noise generator."""
    rng = _start_noise(case, number)
    sessions = 3 if any(fault.effect == "bad-session" for fault in case.faults) else 1
    plan, located = draw_plan(lab.workspace, rng, case.style, sessions=sessions)
    return lab.with_faults(case.faults), plan, located, rng


def write_case(folder: Path, number: int, case: BlindCase, lab: Lab) -> None:
    """Write the campaign of a case into a folder, without its faults."""
    if case.style == "hammer":
        rng = _start_noise(case, number)
        write_hammer_case(folder, case, lab, *draw_hammer(lab, rng), rng)
        return
    machine, plan, located, rng = prepare_case(case, number, lab)
    readings = measure(
        machine=machine,
        plan=plan,
        noise=Noise(),
        rng=rng,
        located=located,
        mechanics=lab.robot.mechanics,
    )
    robot = lab.robot.reference
    components = lab.robot.components
    write_readings(
        readings, folder, robot=robot, pose=machine.pose, components=components
    )
