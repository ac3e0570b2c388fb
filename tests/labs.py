"""Virtual lab for tests: healthy machines by name, and campaigns written to and read from files."""

import tempfile
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from stiffscope.gap.campaign.readings import load_campaign
from stiffscope.lab import measuring
from stiffscope.lab.closure import locate
from stiffscope.lab.machine import machine_of
from stiffscope.lab.measuring import write_readings
from stiffscope.lab.plans import draw_plan, workspace
from stiffscope.lab.response import respond, tool_spot
from stiffscope.robot.part_matrices import part_matrices
from stiffscope.robot.reader import load_robot

FEA_SLIDER = np.diag(
    [5.7974e-11, 1.92533e-10, 4.33624e-9, 1.29600e-7, 1.72818e-6, 6.99798e-9]
)
"""Plate 85 x 320 x 20 mm, rigid end face: structured quadratic mesh, 457k dofs."""
FEA_SLIDER[1, 5] = FEA_SLIDER[5, 1] = 2.97414e-10
FEA_SLIDER[2, 4] = FEA_SLIDER[4, 2] = -7.34478e-8
ARM = """
name = "arm"
[bodies.upper]
[bodies.fore]
[joints.shoulder]
between = ["ground", "upper"]
type = "{kind}"
at = [0, 0, 0]
axis = {axis}
drive = {{ stiffness = 1e5 }}
[joints.elbow]
between = ["upper", "fore"]
type = "{kind}"
at = [0.3, 0, 0]
axis = [0, 0, 1]
drive = {{ stiffness = 2e5 }}
[tool]
body = "fore"
at = {at}
pose = {pose}
"""
"""Two rigid bodies, two drives."""
GUIDES = """
name = "guides"
[gravity]
acceleration = 9.81
direction = [0, 0.3, -1]
[bodies.table]
mass = "40 kg"
centre = [0.1, 0.05, 0.1]
[bodies.head]
mass = "20 kg"
centre = [0.2, 0.1, 0.2]
[joints.way]
between = [{ends}]
type = "prismatic"
at = [0.02, 0, 0.05]
axis = [1, 0.2, 0.1]
drive = {{ stiffness = 2e7 }}
carried_by = "{carrier}"
compliance = {{ radial = "0.02 um/N", tilting = "1 urad/(N*m)" }}
[joints.up]
between = ["table", "head"]
type = "prismatic"
at = [0.1, 0, 0.1]
axis = [0.1, 0, 1]
drive = {{ stiffness = 2e7 }}
compliance = {{ radial = "0.02 um/N", tilting = "1 urad/(N*m)" }}
[tool]
body = "head"
at = [0.25, 0.1, 0.3]
pose = ["x", "z"]
[poses]
home = [0.25, 0.3]
far = [0.65, 0.4]
"""
"""Two guides across each other, the first carried by either body."""


def machine(name="biglide", *overrides, components=None):
    """Return the healthy machine of a bundled robot; the Biglide has its published matrices."""
    robot = load_robot(name, overrides)
    return machine_of(
        robot,
        part_matrices(
            robot, components or ("published" if name == "biglide" else "beam")
        ),
    )


def stiffness(machine, poses):
    """Return the stiffness (n, 6, 6) at M, base axes, without loads or instrument."""
    tool = tool_spot(machine)
    return np.linalg.inv(respond(machine, poses, [tool]).find_twists(tool)[:, :, :6])


def sag(machine, poses):
    """Return the twist (n, 6) of M under the weights."""
    tool = tool_spot(machine)
    response = respond(machine, poses, [tool])
    return response.find_twists(tool)[:, :, response.dead]


def biglide(*overrides):
    """Return the paper's machine."""
    return machine("biglide", *overrides)


def with_slider(machine, compliance):
    """Return the Biglide with another compliance of its sliders."""
    return machine.change(
        {
            n: replace(machine.bodies[n], compliance=compliance)
            for n in ("limb1.slider", "limb2.slider")
        }
    )


@cache
def _workspace(name):
    return workspace(machine(name), 36, np.random.default_rng(2))


def default_plan(machine, rng, **options):
    """Return a plan for the machine's robot."""
    return draw_plan(_workspace(machine.robot.name), rng, **options)[0]


_known = {}


def located(machine, plan):
    """Return the cached configurations of a machine's robot at the poses of a plan."""
    key = machine.robot.name, plan.poses.tobytes()
    if key not in _known:
        _known[key] = locate(machine, plan.poses)
    return _known[key]


def measure(machine, plan, noise, rng, **header):
    """Return the campaign of a machine, written to and read from files."""
    readings = measuring.measure(machine, plan, noise, rng, located(machine, plan))
    with tempfile.TemporaryDirectory() as folder:
        write_readings(
            readings,
            Path(folder),
            robot=machine.robot.name,
            pose=machine.pose,
            **header,
        )
        return load_campaign(Path(folder))


LINKS = tuple(f"limb{i}.link{j}" for i in (1, 2) for j in (1, 2, 3))
_DRIVES = ("stage", "limb1", "limb2")
PLACES = {
    "gravity": ("robot",),
    "payload": ("platform",),
    "actuator-stiffness": (*_DRIVES, "limbs"),
    "joint-compliance": ("joints",),
    "link-stiffness": ("links", *LINKS),
    "rigid-ends": ("links",),
    "part-compliance": ("sliders",),
    "guide-compliance": ("carriages",),
    "base-compliance": ("base",),
    "platform-compliance": ("platform",),
    "backlash": _DRIVES,
    "encoder-offset": ("limb1", "limb2", "stage"),
    "link-length": ("links", *LINKS),
    "thermal": ("links",),
    "instrument-misalignment": ("instrument",),
    "displacement-scale": ("instrument",),
    "force-scale": ("instrument",),
}
"""Effects of the first campaign format, with the places in the Biglide's file."""
