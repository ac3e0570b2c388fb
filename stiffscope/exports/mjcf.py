"""A robot as an MJCF model that loads in MuJoCo as it stands."""

from __future__ import annotations

from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

import numpy as np

from stiffscope.exports.mjcf_tree import Tuning, numbers, write_tree
from stiffscope.exports.mujoco_model import (
    key_positions,
    load_mujoco,
    natural_frequencies,
)
from stiffscope.exports.target import Exported, Order
from stiffscope.vjm.statics.analysis import compliance
from stiffscope.vjm.vibration.modes import frequencies

if TYPE_CHECKING:
    from stiffscope.vjm.kinematics.configurations import Configurations
    from stiffscope.vjm.model.mechanism import Mechanism
    from stiffscope.vjm.model.screws import Array

COUNT = 6  # lowest frequencies that the model has to keep
HIGHEST = 25.0  # times the sixth frequency: it becomes lower by 0.08 %
DAMPING = 0.02  # ratio at the sixth frequency
STEP = 0.8  # of the largest stable time step
RIGID = 1e9  # N/m: opens a loop by 0.1 µm under 100 N
_STIFF = 1e-5  # of the tool's least compliance: what stands for none


def export_robot(order: Order) -> Exported:
    """Return the model of a robot."""
    mujoco = load_mujoco()
    mechanism = order.assembled.mechanism
    found = order.asked.configurations
    lowest = frequencies(mechanism, found, COUNT)
    tuning = tune(mechanism, found, lowest, order.highest)
    robot = order.assembled.robot
    writer = write_tree(mechanism, robot.name, tuning)
    _add_options(writer.root, mechanism)
    model = mujoco.MjModel.from_xml_string(_text(writer.root))
    positions = key_positions(mujoco, model, writer.coordinates, found)
    spectra = [natural_frequencies(mujoco, model, each) for each in positions]
    largest = 1.0 / (np.pi * max(each[-1] for each in spectra))
    step = float(f"{STEP * largest:.1e}")
    option = writer.root.find("option")
    option.set("timestep", numbers(step))
    keys = ET.SubElement(writer.root, "keyframe")
    commands = {joint: found.coordinates(joint) for _, joint in writer.commands}
    for index, name in enumerate(order.asked.names):
        key = ET.SubElement(keys, "key", name=name)
        key.set("qpos", numbers(positions[index]))
        control = np.zeros(model.nu)
        for called, joint in writer.commands:
            driven = mechanism.joint(joint).driven or 0
            control[model.actuator(called).id] = commands[joint][index, driven]
        key.set("ctrl", numbers(control))
    text = _text(writer.root)
    mujoco.MjModel.from_xml_string(text)
    file = f"{robot.name}.xml"
    inside = [each[: lowest.shape[1]] for each in spectra]
    answer = {
        "file": file,
        "timestep": step,
        "largest_timestep": largest,
        "highest_frequency": tuning.highest / (2.0 * np.pi),
        "frequencies": inside,
        "model_frequencies": lowest,
    }
    return Exported(
        lambda folder: (folder / file).write_text(text, encoding="utf-8"), answer
    )


def tune(
    mechanism: Mechanism, found: Configurations, lowest: Array, highest: float | None
) -> Tuning:
    """Return how a robot is put into MuJoCo."""
    soft = compliance(mechanism, found)
    least = np.array([_least(soft[:, :3, :3]), _least(soft[:, 3:, 3:])])
    sixth = float(np.nanmax(lowest))
    limit = 2.0 * np.pi * (highest or HIGHEST * sixth)
    damping = 2.0 * DAMPING / (2.0 * np.pi * sixth)
    heavy = sum(body.mass for body in mechanism.bodies)
    idle = (1e-4 * heavy, 1e-4 * heavy * 1e-4)
    return Tuning(limit, damping, np.repeat(_STIFF * least, 3), RIGID, idle)


def _least(blocks: Array) -> float:
    values = np.linalg.eigvalsh(blocks)
    seen = values[values > 1e-9 * values.max()]
    return float(seen.min()) if seen.size else 1e-9


def _add_options(root: ET.Element, mechanism: Mechanism) -> None:
    compiler = ET.Element("compiler", angle="radian", autolimits="false")
    compiler.set("inertiafromgeom", "false")
    compiler.set("balanceinertia", "false")
    option = ET.Element("option", integrator="implicitfast")
    option.set("gravity", numbers(mechanism.gravity))
    flag = ET.SubElement(option, "flag")
    flag.set("contact", "disable")
    root.insert(0, compiler)
    root.insert(1, option)


def _text(root: ET.Element) -> str:
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"
