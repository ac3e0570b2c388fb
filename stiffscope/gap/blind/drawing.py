"""Blind cases drawn: a series of campaigns with faults that readings can decide."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from stiffscope.gap.blind.cases import BlindCase
from stiffscope.gap.blind.judge import VISIBLE, Judge
from stiffscope.gap.blind.sizes import can_have, choose, draw_known, draw_outside
from stiffscope.gap.lab.faults import OUTSIDE
from stiffscope.gap.lab.measuring import Noise, measure
from stiffscope.gap.lab.plans import draw_plan
from stiffscope.gap.lab.writing import write_readings

if TYPE_CHECKING:
    from pathlib import Path

    from stiffscope.gap.blind.cases import Fault
    from stiffscope.gap.blind.laboratory import Lab
    from stiffscope.gap.lab.closure import Located
    from stiffscope.gap.lab.machine import Machine
    from stiffscope.gap.lab.measuring import Plan
    from stiffscope.gap.lab.plans import Style

KINDS = ("single", "single", "single", "pair", "pair", "triple", "triple", "none", "outside", "outside")
"""What is drawn in turn, so that a share of each is in every ten."""
STYLES: tuple[Style, ...] = ("tool", "gauges", "tool", "gauges", "tool", "sag")
"""What is measured, ten campaigns each in turn."""
_BY_COUNT = ("none", "single", "pair", "triple")
_ATTEMPTS = 24  # at one more fault
_SERIES = 6  # of up to so many faults


def draw_case(number: int, seed: int, lab: Lab) -> BlindCase:
    """The case of this number in a series: its kind in turn, its effects and their sizes by chance.

    What is drawn can be answered, if anything can: readings show every effect beside the others, whatever the
    parameters of these, and no more than two words of the vocabulary with as few parameters do the same to them.
    Where chance finds fewer such faults than wanted, the case is of the kind that these make, and nothing is planted
    where it finds none: in the sag of a hexapod no compliance shows, and six faults of a strut's length are alike.
    """
    rng = np.random.default_rng([seed, number])
    kind = KINDS[number % len(KINDS)]
    style = STYLES[number // len(KINDS) % len(STYLES)]
    if kind == "none":
        return BlindCase(kind, seed, (), style)
    if kind == "outside":
        effect = choose(rng, [name for name in OUTSIDE if can_have(lab, name)])
        return BlindCase(kind, seed, (draw_outside(effect, rng, lab, style),), style)
    judge = _judge_of(BlindCase(kind, seed, (), style), number, lab)
    turn = number // len(KINDS) * 3 + number % len(KINDS)  # singles take one word after the other
    wanted, faults = _BY_COUNT.index(kind), ()
    for _ in range(_SERIES):
        faults = max(faults, _draw_faults(wanted, turn, rng, judge), key=len)
        if len(faults) == wanted:
            break
    return BlindCase(_BY_COUNT[len(faults)], seed, faults, style)


def _draw_faults(count: int, turn: int, rng: np.random.Generator, judge: Judge) -> tuple[Fault, ...]:
    """So many faults of different words, or fewer, that can be told; a single one of the word whose turn it is."""
    lab = judge.lab
    words = lab.words()
    faults: tuple[Fault, ...] = ()
    for _ in range(count):
        left = [word for word in words if word not in {fault.effect for fault in faults}]
        for attempt in range(_ATTEMPTS if count > 1 else max(_ATTEMPTS, 3 * len(left))):
            word = left[(turn + attempt // 3) % len(left)] if count == 1 else choose(rng, left)
            tried = (*faults, draw_known(word, rng, lab, judge.sensors, alone=count == 1))
            if judge.can_decide(tried):
                faults = tried
                break
        else:
            break
    return faults


def is_imitated(case: BlindCase, number: int, lab: Lab) -> bool:
    """Whether a few effects of the vocabulary do to the readings what a case's fault outside of it does.

    What these leave of its signature is less than what a fault must stand out by to be drawn. Of a fault that only
    shows in noisy readings, as a coarse converter's, nothing is known here: it is not imitated.
    """
    size, left = _judge_of(case, number, lab).distance(case.faults[0])
    return left < VISIBLE <= size


def _judge_of(case: BlindCase, number: int, lab: Lab) -> Judge:
    _, plan, located, _ = prepare_case(case, number, lab)
    return Judge(lab, plan, located)


def prepare_case(case: BlindCase, number: int, lab: Lab) -> tuple[Machine, Plan, Located, np.random.Generator]:
    """The true machine of a case, what is measured on it, and the noise to come."""
    rng = np.random.default_rng([case.seed, number, 1])
    sessions = 3 if any(fault.effect == "bad-session" for fault in case.faults) else 1
    plan, located = draw_plan(lab.workspace, rng, case.style, sessions=sessions)
    return lab.with_faults(case.faults), plan, located, rng


def write_case(folder: Path, number: int, case: BlindCase, lab: Lab) -> None:
    """Write the campaign of a case into a folder, without a word of what is in it."""
    machine, plan, located, rng = prepare_case(case, number, lab)
    readings = measure(machine, plan, Noise(), rng, located)
    robot = lab.robot
    write_readings(readings, folder, robot=robot.reference, pose=machine.pose, components=robot.components)
