"""Mechanisms for the tests: the checked robot files (a reader of what those three use, no more) and the Biglide."""

import json
import tomllib
from pathlib import Path

import numpy as np

from stiffscope.vjm.model.bodies import Body, Elastic, member
from stiffscope.vjm.model.joints import Drive, Joint
from stiffscope.vjm.model.mechanism import Mechanism, Tool
from stiffscope.vjm.model.screws import HALF_TURN, rotation
from tests.robots import DRIVE, GEOMETRY, euler_bernoulli, published_slider

FILES = Path(__file__).parent / "robots"
CHECKED = json.loads((FILES / "checked.json").read_text())


def read(name):
    """A mechanism from a checked robot file."""
    content = tomllib.loads((FILES / f"{name}.toml").read_text())
    sets = [("", "", np.eye(3))]
    for c in content.get("copies", []):
        turns = [rotation(np.array(c["axis"], dtype=float), a) for a in c["angles"]]
        sets += [(c["of"], new, turn) for new, turn in zip(c["as"], turns, strict=True)]
    bodies = []
    joints = []
    for of, new, turn in sets:

        def named(name, of=of, new=new):
            return (
                new + name.removeprefix(of) if of and name.split(".")[0] == of else name
            )

        for name, b in content["bodies"].items():  # noqa: PLR1704
            if not of or named(name) != name:
                if "part" in b:
                    part = content["parts"][b["part"]]
                    ends = turn @ b["base"], turn @ b["tip"], part["matrix"]
                    bodies.append(
                        member(
                            named(name),
                            *ends,
                            y=turn @ b["y"],
                            mass=part.get("mass", 0.0),
                        )
                    )
                else:
                    centre = turn @ b["centre"] if "centre" in b else None
                    bodies.append(Body(named(name), b.get("mass", 0.0), centre))
        for name, j in content["joints"].items():
            if not of or named(name) != name:
                axes = [
                    turn @ j[key] if key in j else None for key in ("axis", "axis2")
                ]
                drive = Drive(j["drive"]["stiffness"]) if "drive" in j else None
                ends = [named(node) for node in j["between"]]
                joints.append(
                    Joint(named(name), *ends, j["type"], turn @ j["at"], *axes, drive)
                )
    tool = Tool(
        content["tool"]["body"], content["tool"]["at"], tuple(content["tool"]["pose"])
    )
    gravity = content["gravity"]["acceleration"] * np.array(
        content["gravity"]["direction"], dtype=float
    )
    return Mechanism(tuple(bodies), tuple(joints), tool, gravity)


HOME_ANGLE = np.radians(35.8)


def biglide(
    link=None,
    slider=None,
    drive=DRIVE,
    link_mass=1.95,
    platform_mass=7.93,
    q=HOME_ANGLE,
    g=GEOMETRY,
):
    """The Biglide as a mechanism, home at the link angle q."""
    x, y, z = np.eye(3)
    link = euler_bernoulli() if link is None else link
    slider = published_slider() if slider is None else slider
    tool = np.array([0.0, 0.0, g.l1 + g.l2 + g.L * np.sin(q)])
    bodies = [Body("stage"), Body("platform", platform_mass, tool)]
    joints = [
        Joint(
            "stage.actuator",
            "ground",
            "stage",
            "prismatic",
            np.zeros(3),
            y,
            drive=Drive(drive),
        )
    ]
    for i, side in ((1, 1.0), (2, -1.0)):
        limb = f"limb{i}"
        corner = tool - side * g.l * x - g.l2 * z
        along = side * np.cos(q) * x + np.sin(q) * z
        a = corner - g.L * along
        axes = np.eye(3) if i == 1 else HALF_TURN[:3, :3]
        slide = 0.5 * (g.a_min + g.a_max)
        here = g.l + g.L * np.cos(q)
        ends = (
            (g.a_min - here, g.a_max - here)
            if i == 2
            else (here - g.a_max, here - g.a_min)
        )
        assert ends[0] < 0 < ends[1] or slide
        bodies += [
            Body(f"{limb}.carriage"),
            Body(f"{limb}.slider", elastic=Elastic(slider, np.array([a, a]), axes)),
        ]
        joints += [
            Joint(
                f"{limb}.actuator",
                "stage",
                f"{limb}.carriage",
                "prismatic",
                a - g.l1 * z,
                x,
                drive=Drive(drive, *ends),
            ),
            Joint(
                f"{limb}.bolts", f"{limb}.carriage", f"{limb}.slider.base", "fixed", a
            ),
        ]
        for j, foot in enumerate(
            (-side * g.h * x, side * g.h * x + g.d * y, side * g.h * x - g.d * y),
            start=1,
        ):
            name = f"{limb}.link{j}"
            bodies.append(
                member(name, a + foot, corner + foot, link, y=y, mass=link_mass)
            )
            joints += [
                Joint(
                    f"{name}.a",
                    f"{limb}.slider.tip",
                    f"{name}.base",
                    "revolute",
                    a + foot,
                    y,
                ),
                Joint(
                    f"{name}.b", f"{name}.tip", "platform", "revolute", corner + foot, y
                ),
            ]
    return Mechanism(
        tuple(bodies),
        tuple(joints),
        Tool("platform", tool, ("x", "y", "z")),
        np.array([0, 0, 9.81]),
    )


def serial_arm(elastic=True, drive=2e5):
    """Six driven revolutes, elastic or rigid links between them, tilted."""
    points = np.array(
        [
            [0, 0, 0.3],
            [0.1, 0, 0.6],
            [0.15, 0.05, 1.1],
            [0.3, 0, 1.2],
            [0.7, 0.02, 1.25],
            [0.8, 0, 1.2],
        ]
    )
    axes = np.array(
        [[0, 0, 1], [0, 1, 0], [0, 1, 0.1], [1, 0, 0], [0, 1, 0], [1, 0, 0.2]]
    )
    tool = np.array([0.9, 0.05, 1.15])
    bodies = []
    joints = []
    before = "ground"
    for k, (at, axis) in enumerate(zip(points, axes, strict=True), start=1):
        name = f"link{k}"
        end = points[k] if k < 6 else tool
        if elastic:
            length = np.linalg.norm(end - at)
            bodies.append(
                member(name, at, end, euler_bernoulli(length, 0.04), mass=10.0 * length)
            )
        else:
            bodies.append(Body(name, 2.0, 0.5 * (at + end)))
        first = bodies[-1].nodes[0]
        last = bodies[-1].nodes[-1]
        joints.append(
            Joint(
                f"joint{k}", before, first, "revolute", at, axis, drive=Drive(drive * k)
            )
        )
        before = last
    tool = Tool(before, tool, ("x", "y", "z", "rx", "ry", "rz"))
    return Mechanism(tuple(bodies), tuple(joints), tool, np.array([0.5, 0.2, -9.7]))
