"""Blind cases by hammer: points and hits of a robot, and what its lines show of small faults."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.lab.blind.cases import Fault
from stiffscope.lab.blind.laboratory import OF_POINTS
from stiffscope.lab.faults import KNOWN, bearing_words
from stiffscope.lab.hammer import (
    MODES,
    HammerNoise,
    HammerPlan,
    Ringing,
    find_band,
    find_gains,
    record,
    ring,
    space_lines,
    strike,
    triaxial,
    write_responses,
)
from stiffscope.lab.response import Spot
from stiffscope.responses.model import Direction

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from stiffscope.lab.blind.cases import BlindCase
    from stiffscope.lab.blind.laboratory import Lab
    from stiffscope.lab.closure import Located
    from stiffscope.lab.hammer import Complex
    from stiffscope.lab.machine import Machine
    from stiffscope.lab.rotations import Array

WORDS = (
    "actuator-stiffness",
    "joint-compliance",
    "guide-compliance",
    "link-stiffness",
    "base-compliance",
    "mass",
    "payload",
    "sensor-mass",
    "response-gain",
)
"""Known effects that are drawn."""
_POSES = 2
_MODES = 8  # within the band
_LINES = 1200
_POINTS = 4
_NODES = 6  # of a robot, on which points are drawn
_AWAY = 0.3  # of the reach: distance of points from the tool, or an end
_SMALL = 1e-3  # share of a fault that tells its direction
_WIDTHS = (-2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0)  # damping ratios beside a mode: lines
_BETWEEN = 40  # lines throughout the band
_RATIO = 0.01
_GAIN = 0.015  # relative, or rad: of the calibration of a channel, as diagnosis assumes


class HammerBench:
    """Lines of a hammer test, of small faults.

    A fault moves resonances by many of their widths, where lines change by anything. Its direction
    is that of a small share of it, and its size in proportion.
    """

    def __init__(self, lab: Lab, plan: HammerPlan, located: Located) -> None:
        self._lab = lab
        self._plan = replace(plan, hertz=_choose_lines(lab, plan, located))
        self._located = located
        self._noise = HammerNoise()
        self.sensors = tuple(plan.points)
        known = {*lab.words(), *OF_POINTS}
        self.words = [word for word in WORDS if word in known]
        self._sound = self._respond(())
        level = np.abs(self._sound)
        squares = self._plan.hertz**2
        rms = np.sqrt(np.mean((squares * level) ** 2, axis=(1, 2, 3), keepdims=True))
        floor = self._noise.floor * rms / squares
        self._sigma = np.sqrt(0.5 * ((self._noise.relative * level) ** 2 + floor**2))

    def _respond(self, faults: Sequence[Fault]) -> Complex:
        """Return receptances (p, hits, motions, f)."""
        plan = self._plan
        damping = np.full(1, _RATIO)
        if any(fault.effect == "sensor-mass" for fault in faults):
            return strike(self._lab.with_faults(faults), plan, self._located, damping)
        inside = [fault for fault in faults if fault.effect != "response-gain"]
        found = (
            find_ringing(self._lab, inside, k, self._located, plan)
            for k in range(len(plan.poses))
        )
        true = np.array([each.respond(plan, damping) for each in found])
        return find_gains(self._lab.with_faults(faults), plan) * true

    def _scale(self, change: Complex) -> Array:
        """Return a change of lines over their noise, as reals (r,), and zeros of usual gains."""
        flat = (change / self._sigma).ravel()
        usual = np.zeros(2 * int(np.prod(change.shape[:3])))
        return np.concatenate([flat.real, flat.imag, usual])

    @property
    def frame(self) -> Array:
        """Columns (r, k) of gain and phase of each response, and of damping at each pose.

        Gain and phase are known by calibration, which is a reading of each.
        """
        sound = self._sound
        columns: list[Array] = []
        shape = sound.shape[:3]
        count = int(np.prod(shape))
        for k, index in enumerate(np.ndindex(*shape)):
            own = np.zeros_like(sound)
            own[index] = sound[index]
            for j, change in enumerate((own, 1j * own)):
                column = self._scale(change)
                column[2 * k + j - 2 * count] = 1.0 / _GAIN
                columns.append(column)
        for k in range(len(self._plan.poses)):
            ringing = find_ringing(self._lab, (), k, self._located, self._plan)
            for mode in range(2 * _MODES):
                ratios = np.full(MODES, _RATIO)
                ratios[mode] *= 1.0 + _SMALL
                change = np.zeros_like(sound)
                change[k] = ringing.respond(self._plan, ratios) - sound[k]
                columns.append(self._scale(change) / _SMALL)
        return np.stack(columns, axis=1)

    def find_change(self, fault: Fault) -> Array:
        """Return the change (r,) of lines by a fault, over their noise."""
        small = replace(fault, parameters=_shrink(fault.parameters))
        return self._scale(self._respond((small,)) - self._sound) / _SMALL

    def list_steps(self, effect: str, place: str) -> list[Fault]:
        """Return faults of a usual size, one for each parameter."""
        scale = self._lab.workspace.scale
        names: Sequence[str] = KNOWN[effect].names
        if effect == "joint-compliance":
            joints = self._lab.sound.joints
            members = self._lab.sound.members(place)
            names = bearing_words([joints[name] for name in members if name in joints])
        if effect == "payload":
            none = {"x": 0.0, "y": 0.0, "z": 0.0}
            aside: list[dict[str, float]] = [{}, {"x": 0.1}, {"y": 0.1}, {"z": 0.1}]
            sizes = [{"mass": 0.1, **none, **away} for away in aside]
            return [Fault(effect, place, size) for size in sizes]
        out: list[Fault] = []
        for name in names:
            if name in {"factor", "start"}:
                value = 0.9
            elif name == "mass":
                value = 0.02
            elif name in {"x", "y", "z", "radial", "axial", "lateral", "vertical"}:
                value = 0.1 * scale.linear
            else:
                value = 0.1 * scale.angular
            out.append(Fault(effect, place, {name: value}))
        return out

    def find_columns(self, effect: str, place: str) -> None:
        """Return nothing: steps show all."""


def _shrink(parameters: dict[str, float]) -> dict[str, float]:
    """Return parameters of a small share of a fault; a payload's centre stays."""
    if "mass" in parameters:
        return {**parameters, "mass": _SMALL * parameters["mass"]}
    return {
        name: value**_SMALL if name == "factor" else _SMALL * value
        for name, value in parameters.items()
    }


def find_ringing(
    lab: Lab, faults: Sequence[Fault], k: int, located: Located, plan: HammerPlan
) -> Ringing:
    """Return the modes of a lab's machine with faults at a pose of its hammer tests; cached."""
    key = repr(faults), k
    if key not in lab.ringing:
        nodes = _list_nodes(lab)
        machine = lab.with_faults(faults)
        lab.ringing[key] = ring(machine, located.some([k]), nodes, plan.about)
    return lab.ringing[key]


def _list_nodes(lab: Lab) -> list[str]:
    """Return the tool's body, and other nodes evenly chosen, on which sensors are glued."""
    bodies = lab.sound.bodies.values()
    others = [n for b in bodies for n in b.nodes[-1:] if n != lab.sound.tool]
    count = min(_NODES - 1, len(others))
    chosen = [others[k * (len(others) - 1) // max(count - 1, 1)] for k in range(count)]
    return [lab.sound.tool, *chosen]


def draw_hammer(lab: Lab, rng: np.random.Generator) -> tuple[HammerPlan, Located]:
    """Return a hammer test of a robot, at the same two poses each time.

    Two triaxial accelerometers are on the tool's body, two on other bodies; hits are at the first,
    and at one of the others.
    """
    where = lab.workspace
    machine = lab.sound
    reach = float(
        np.clip(np.sqrt(where.scale.linear / where.scale.angular), 0.03, 0.15)
    )
    tool, *others = _list_nodes(lab)
    some = rng.permutation(len(others))[: _POINTS - 2]
    nodes: list[str] = [tool, tool, *(others[int(k)] for k in some)]
    points: dict[str, Spot] = {}
    for k, node in enumerate(nodes, 1):
        away = reach * (1.0 if node == tool else _AWAY) * rng.uniform(-1.0, 1.0, 3)
        points[str(k)] = Spot(node, np.round(_place_node(machine, node) + away, 4))
    last = str(1 + int(rng.integers(1, len(points))))
    hits = tuple(
        Direction(point, int(rng.integers(3)), sign)
        for point, sign in (("1", 1), (last, -1))
    )
    motions = tuple(each for point in points for each in triaxial(point))
    chosen = list(range(_POSES))
    located = where.located.some(chosen)
    plan = HammerPlan(where.poses[chosen], points, hits, motions, np.ones(1))
    low, high, about = find_band(machine, plan, located, _MODES)
    hertz = space_lines(low, high, _LINES)
    return replace(plan, hertz=hertz, about=about), located


def _place_node(machine: Machine, node: str) -> Array:
    """Return where a node is at home: M, an end, or a body's centre."""
    if node == machine.tool:
        return machine.at
    body = machine.bodies[machine.carrier(node)]
    if len(body.nodes) == 1:
        return body.centre
    return body.places[body.nodes.index(node)]


def _choose_lines(lab: Lab, plan: HammerPlan, located: Located) -> Array:
    """Return lines about each mode of the sound machine, and some between."""
    low, *_, high = plan.hertz
    lines: list[Array] = [np.geomspace(low, high, _BETWEEN)]
    for k in range(len(plan.poses)):
        hertz = find_ringing(lab, (), k, located, plan).modes.hertz
        inside = hertz[(hertz > low) & (hertz < high)][: 2 * _MODES]
        lines += [inside * (1.0 + width * _RATIO) for width in _WIDTHS]
    return np.unique(np.concatenate(lines))


def write_hammer_case(
    folder: Path,
    case: BlindCase,
    lab: Lab,
    plan: HammerPlan,
    located: Located,
    rng: np.random.Generator,
) -> None:
    """Write the campaign of a case by hammer into a folder, without its faults."""
    noise = HammerNoise()
    damping = noise.draw_damping(rng, MODES)
    true = strike(lab.with_faults(case.faults), plan, located, damping)
    measured = record(true, plan, noise, rng)
    names = {f"tap{k + 1}": pose.tolist() for k, pose in enumerate(plan.poses)}
    write_responses(
        folder,
        plan,
        measured,
        robot=lab.robot.reference,
        names=names,
        components=lab.robot.components,
    )
