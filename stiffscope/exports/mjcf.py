"""A robot as an MJCF model that loads in MuJoCo as it stands."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree as ET

import numpy as np

from stiffscope.errors import InputError
from stiffscope.exports.dynamics_checks import check_dynamics
from stiffscope.exports.mjcf_meshes import add_meshes
from stiffscope.exports.mjcf_tree import Tuning, Writer, numbers, write_tree
from stiffscope.exports.mujoco_model import (
    Spectrum,
    find_spectrum,
    key_positions,
    load_mujoco,
)
from stiffscope.exports.target import Exported, Order
from stiffscope.robot.file.tables import list_some
from stiffscope.vjm.network.network import list_elements
from stiffscope.vjm.statics.analysis import compliance, sag
from stiffscope.vjm.vibration.modes import frequencies

if TYPE_CHECKING:
    from stiffscope.vjm.model.joints import Joint
    from stiffscope.vjm.model.mechanism import Mechanism
    from stiffscope.vjm.model.screws import Array

COUNT = 6
"""Lowest frequencies that the model keeps."""
HIGHEST = 25.0
"""Default of `--highest`, times the highest of these: it becomes lower by 0.08 %."""
STEP = 0.8
"""Time step that is set, over the largest stable one."""
CLOSURES = ((1e4, 1e-4), (1e5, 1e-5), (1e6, 1e-6))
"""Stiffness of springs that close loops over that of the tool; moment of inertia of bodies without,
over mass times squared size. They are tried in turn until the model is accurate."""
LEAST = 1e10
"""N/m: least stiffness of springs that close loops, which open by 10 nm under 100 N."""
ENOUGH = 0.003
"""Deviation of compliance and frequencies with which the first of these is kept."""
_IDLE = 1e-3  # of all masses, for the inertia of joints of bodies without
_STILL = 0.05  # of the lowest frequency: slower motions are free
_STIFF = 1e-5  # of the tool's least compliance: what stands for none
_NAMED = 4  # bodies in a sentence
_UNIT = 1e-12  # of a compliance, squared, beside its largest: a rigid direction


@dataclass(frozen=True, eq=False)
class Trial:
    """A model with its spectra at the poses, and its deviation from what it stands for.

    ``deviation``: largest of the relative deviations of its ``compliance`` and ``frequency``.
    """

    writer: Writer
    model: Any
    positions: Array
    spectra: tuple[Spectrum, ...]
    compliance: float
    frequency: float

    @property
    def deviation(self) -> float:
        """Larger of both deviations."""
        return max(self.compliance, self.frequency)


@dataclass(frozen=True, eq=False)
class Wanted:
    """What the model stands for: lowest frequencies (n, c), Hz, and compliance (n, 6, 6) at M."""

    frequencies: Array
    compliance: Array


def export_robot(order: Order) -> Exported:
    """Return the model of a robot.

    The springs that close loops are stiffened until the model yields and vibrates as it should.
    """
    mujoco = load_mujoco()
    mechanism = order.assembled.mechanism
    check_dynamics(mechanism)
    configurations = order.asked.configurations
    straight = linear_drives(mechanism)
    wanted = Wanted(
        frequencies(straight, configurations, COUNT),
        compliance(straight, configurations),
    )
    free = ~np.isfinite(wanted.compliance).all(axis=(1, 2))
    if free.any():
        name = order.asked.names[int(np.flatnonzero(free)[0])]
        expected = "expected drives or springs that hold the tool"
        raise InputError(f"{name}: {expected}, got a tool that moves freely")
    best: Trial | None = None
    for choice in CLOSURES:
        tuning = tune(
            mechanism, wanted, order.highest, configurations.linkage.length, choice
        )
        trial = _try(mujoco, order, tuning, wanted)
        if best is None or trial.deviation < best.deviation:
            best = trial
        if trial.deviation < ENOUGH:
            break
    assert best is not None  # noqa: S101
    return _finish(mujoco, order, best, wanted)


def linear_drives(mechanism: Mechanism) -> Mechanism:
    """Return the mechanism with drives as stiff as at large deflections, without laws."""
    joints = tuple(map(_straighten, mechanism.joints))
    return replace(mechanism, joints=joints)


def _straighten(joint: Joint) -> Joint:
    if joint.drive is None or joint.drive.law is None:
        return joint
    last = float(joint.drive.law.slopes[-1])
    return replace(joint, drive=replace(joint.drive, stiffness=last, law=None))


def tune(
    mechanism: Mechanism,
    wanted: Wanted,
    highest: float | None,
    length: float,
    choice: tuple[float, float],
) -> Tuning:
    """Return how a robot is put into MuJoCo.

    Parameters
    ----------
    mechanism, wanted
        The robot, its compliance and frequencies.
    highest
        Frequency, Hz, above which vibrations are lumped; None: ``HIGHEST``.
    length
        Size of the robot, m.
    choice
        One of ``CLOSURES``.
    """
    firm, unknown = choice
    soft = wanted.compliance
    least = np.array([_least(soft[:, :3, :3]), _least(soft[:, 3:, 3:])])
    sixth = float(np.nanmax(wanted.frequencies))
    limit = 2.0 * np.pi * (highest or HIGHEST * sixth)
    bare = sum(body.mass == 0.0 for body in mechanism.bodies)
    idle = _IDLE * sum(body.mass for body in mechanism.bodies) / max(1, bare)
    closing = max(firm / least[0], LEAST)
    return Tuning(
        highest=limit,
        # a damping ratio of one half at the highest frequency
        damping=1.0 / limit,
        smallest=np.repeat(_STIFF * least, 3),
        closing=(closing, closing * length**2),
        unknown=unknown,
        idle=idle,
    )


def _least(blocks: Array) -> float:
    values = np.linalg.eigvalsh(blocks)
    seen = values[values > 1e-9 * values.max()]
    return float(seen.min()) if seen.size else 1e-9


def _try(mujoco: Any, order: Order, tuning: Tuning, wanted: Wanted) -> Trial:
    """Return the model for one choice of its closures."""
    mechanism = order.assembled.mechanism
    configurations = order.asked.configurations
    writer = write_tree(mechanism, order.assembled.robot.name, tuning)
    _add_options(writer.root, mechanism)
    model = mujoco.MjModel.from_xml_string(_text(writer.root))
    positions = key_positions(mujoco, model, writer.coordinates, configurations)
    known = wanted.frequencies
    still = _STILL * float(known[np.isfinite(known) & (known > 0.0)].min())
    spectra = tuple(
        find_spectrum(mujoco, model, position, still) for position in positions
    )
    soft = [
        _deviate(spectrum.compliance, right)
        for spectrum, right in zip(spectra, wanted.compliance, strict=True)
    ]
    slower = 2.0 * np.pi / tuning.highest
    off = [
        _compare(spectrum.frequencies, right, slower)
        for spectrum, right in zip(spectra, wanted.frequencies, strict=True)
    ]
    return Trial(writer, model, positions, spectra, max(soft), max(off))


def _deviate(given: Array, right: Array) -> float:
    """Return the largest deviation of a compliance, over the diagonal's geometric means."""
    diagonal = np.diagonal(right).copy()
    for block in (diagonal[:3], diagonal[3:]):
        block[:] = block.clip(min=max(np.sqrt(_UNIT) * float(block.max()), 1e-300))
    return float((np.abs(given - right) / np.sqrt(np.outer(diagonal, diagonal))).max())


def _compare(given: Array, right: Array, slower: float) -> float:
    """Return the largest relative deviation of frequencies from those with inertia added, s²."""
    known = right[np.isfinite(right) & (right > 0.0)]
    if len(given) < len(known):
        return np.inf
    expected = 1.0 / np.sqrt(known**-2 + slower**2)
    return float(np.abs(given[: len(known)] / expected - 1.0).max(initial=0.0))


def _finish(mujoco: Any, order: Order, trial: Trial, wanted: Wanted) -> Exported:
    """Return the model with its time step and its keyframes."""
    writer = trial.writer
    mechanism = order.assembled.mechanism
    # Springs with damping c = K/w_h that are integrated implicitly are stable up to 2/w_h, however
    # stiff they are: a step h multiplies what is stiff by 1 - h w_h.
    largest = 2.0 / writer.tuning.highest
    step = float(f"{STEP * largest:.1e}")
    _add_step(writer.root, step)
    add_meshes(writer, order.assembled)
    _add_keys(writer, order, trial)
    text = _text(writer.root)
    mujoco.MjModel.from_xml_string(text)
    name = re.sub(r"[^\w.-]+", "-", order.assembled.robot.name)
    file = f"{name}.xml"
    count = wanted.frequencies.shape[1]
    highest = writer.tuning.highest / (2.0 * np.pi)
    answer = {
        "files": [file],
        "timestep": step,
        "largest_timestep": largest,
        "highest": highest,
        "tool": order.asked.configurations.tool,
        "sag": sag(linear_drives(mechanism), order.asked.configurations),
        "frequencies": wanted.frequencies,
        "exported_frequencies": [
            spectrum.frequencies[:count] for spectrum in trial.spectra
        ],
        "deviation": {"compliance": trial.compliance, "frequency": trial.frequency},
    }
    rows = (
        ("time step, set", f"{1e6 * step:.3g} µs"),
        ("largest stable time step", f"{1e6 * largest:.3g} µs"),
        ("all vibrates below", f"{highest:.4g} Hz"),
        ("bodies, coordinates", f"{trial.model.nbody - 1}, {trial.model.nv}"),
        ("compliance at M, deviation", f"{100.0 * trial.compliance:.2g} %"),
        ("six frequencies, deviation", f"{100.0 * trial.frequency:.2g} %"),
    )
    remarks = tuple(_remark(order, trial))
    return Exported(
        lambda folder: (folder / file).write_text(text, encoding="utf-8"),
        answer,
        rows,
        remarks,
    )


def _remark(order: Order, trial: Trial) -> list[str]:
    """Return what to mind of a model."""
    out = []
    mechanism = order.assembled.mechanism
    bent = [
        j.name
        for j in mechanism.drives
        if j.drive is not None and j.drive.law is not None
    ]
    if bent:
        several = f"the servos {bent[0]}, {bent[0]}:law1, …"
        out.append(f"drives with a curve or backlash: give {several} the same control")
    if trial.deviation > 0.01:
        percent = f"{100.0 * trial.deviation:.2g} %"
        cause = ""
        if any(element.is_displaced for element in list_elements(mechanism)):
            cause = ": errors of geometry displace the model's axes, not those of `stiffness`"
        out.append(f"the model deviates by {percent} in compliance or frequency{cause}")
    bodies = (b for b in mechanism.bodies if b.elastic is None and b.mass)
    points = [body.name for body in bodies if body.inertia is None]
    if points and order.highest is None:
        out.append(
            f"{list_some(points, _NAMED)}: no `inertia` given, so that high frequencies and a small step come "
            "from masses at points; give them, or `--highest`"
        )
    return out


def _add_options(root: ET.Element, mechanism: Mechanism) -> None:
    compiler = ET.Element("compiler", angle="radian", autolimits="false")
    compiler.set("inertiafromgeom", "false")
    compiler.set("balanceinertia", "false")
    option = ET.Element("option", integrator="implicitfast")
    option.set("gravity", numbers(mechanism.gravity))
    flag = ET.SubElement(option, "flag")
    flag.set("contact", "disable")
    # without mass behind them, springs that close loops accelerate what they hold beyond the 1e10
    # m/s² that MuJoCo takes for a failure, for a step
    flag.set("autoreset", "disable")
    root.insert(0, compiler)
    root.insert(1, option)


def _add_step(root: ET.Element, step: float) -> None:
    for option in root.iter("option"):
        option.set("timestep", numbers(step))


def _add_keys(writer: Writer, order: Order, trial: Trial) -> None:
    """Add a keyframe for each pose: the unloaded robot, its drives at their commands."""
    configurations = order.asked.configurations
    mechanism = order.assembled.mechanism
    keys = ET.SubElement(writer.root, "keyframe")
    for index, name in enumerate(order.asked.names):
        control = np.zeros(trial.model.nu)
        for servo, joint in writer.commands:
            motion = mechanism.joint(joint).driven or 0
            value = configurations.coordinates(joint)[index, motion]
            control[trial.model.actuator(servo).id] = value
        key = ET.SubElement(keys, "key", name=name)
        key.set("qpos", numbers(trial.positions[index]))
        key.set("ctrl", numbers(control))


def _text(root: ET.Element) -> str:
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"
