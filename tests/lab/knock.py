"""The bundled campaign `knock`, made anew: ``python -m tests.lab.knock FOLDER``."""

import sys
from pathlib import Path

import numpy as np

from stiffscope.lab.closure import locate
from stiffscope.lab.faults import inject
from stiffscope.lab.hammer import (
    MODES,
    HammerNoise,
    HammerPlan,
    record,
    space_lines,
    strike,
    triaxial,
    write_responses,
)
from stiffscope.lab.machine import machine_of
from stiffscope.lab.response import Spot
from stiffscope.responses.model import Direction
from stiffscope.robot.part_matrices import part_matrices
from stiffscope.robot.reader import load_robot

CAUSE = "actuator-stiffness", "limb1", {"factor": 0.7}
AWAY = ((0.09, 0.09, -0.06), (-0.09, 0.09, 0.06), (0.0, -0.095, 0.06))  # m, from M
COMMENT = """A hammer test of the Biglide at Q1: hits on the platform at point 1 along z and at point 2 against y,
triaxial accelerometers at three points of the platform and on the left slider. The machine is virtual, with mechanics
of its own (tests/lab/knock.py makes the file anew); its cause is withheld. Try: stiffscope diagnose knock --out DIR"""


def make(folder):
    """Write the campaign."""
    robot = load_robot("biglide")
    machine = machine_of(robot, part_matrices(robot, "published"))
    slider = machine.bodies["limb1.slider"]
    spots = [Spot("platform", machine.at + np.array(away)) for away in AWAY]
    spots.append(Spot("limb1.slider.tip", slider.places[1]))
    points = {
        str(k): Spot(spot.node, np.round(spot.at, 4)) for k, spot in enumerate(spots, 1)
    }
    plan = HammerPlan(
        poses=np.array([robot.poses["Q1"]]),
        points=points,
        hits=(Direction("1", 2), Direction("2", 1, -1)),
        motions=tuple(each for point in points for each in triaxial(point)),
        hertz=space_lines(10.0, 400.0, 781),
    )
    noise = HammerNoise()
    rng = np.random.default_rng(5)
    damping = noise.draw_damping(rng, MODES)
    true = strike(inject(machine, *CAUSE), plan, locate(machine, plan.poses), damping)
    write_responses(
        folder,
        plan,
        record(true, plan, noise, rng),
        robot="biglide",
        names={"tap": "Q1"},
        components="published",
        comment=COMMENT,
    )


if __name__ == "__main__":
    make(Path(sys.argv[1]))
