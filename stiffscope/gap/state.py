"""What a robot with given effects would read, and how every reading changes with every effect's parameters."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.errors import InputError
from stiffscope.gap.effects import EXPANSION, Change, changed, nominal_of
from stiffscope.gap.vocabulary import DEFLECTION, DEVIATION, STIFFNESS
from stiffscope.vjm.gravity import STANDARD
from stiffscope.vjm.reduction import assembled
from stiffscope.vjm.response import respond

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from stiffscope.gap.effects import Changes, Effect, Nominal
    from stiffscope.gap.readings import Campaign
    from stiffscope.vjm.biglide import Biglide, Geometry
    from stiffscope.vjm.response import Response

    Array = NDArray[np.floating[Any]]

Setting = tuple[tuple["Effect", tuple[float, ...]], ...]
"""Effects with their inner parameters."""

DRIVES = {"stage": "stage.actuator", "limb1": "limb1.actuator", "limb2": "limb2.actuator"}
_PLACES = {"limb1": 0, "limb2": 1, "stage": 2}
_SLIGHT = 1e-3  # share of an error of geometry at which it acts linearly
_STEP = 1e-4  # of a parameter's prior size, for derivatives of what an effect does to an element
_NOTHING = 1e-6  # of the largest force: what rounding leaves in a drive that carries none


@dataclass(frozen=True)
class Bench:
    """A campaign on its nominal robot: all that does not change with the effects that are tried."""

    campaign: Campaign
    robot: Biglide

    @cached_property
    def unbounded(self) -> Biglide:
        """The robot without ends to its drives: an error of geometry may lead a little beyond them."""
        geometry = replace(self.robot.geometry, a_min=0.0, a_max=10.0 * self.robot.geometry.a_max)
        return replace(self.robot, geometry=geometry)

    @cached_property
    def nominal(self) -> Nominal:
        """Springs and lengths of the nominal robot."""
        return nominal_of(self.robot)

    @property
    def gravity(self) -> bool:
        """Whether the nominal model carries the robot's weight."""
        return "gravity" in self.campaign.modelled

    def state(self, setting: Setting = ()) -> State:
        """The robot with these effects at every pose of the campaign."""
        return State(self, setting)


@dataclass(frozen=True)
class State:
    """The robot with effects at the campaign's poses; everything is worked out where it is asked for."""

    bench: Bench
    setting: Setting

    @cached_property
    def values(self) -> dict[str, Array]:
        """Inner parameters by the effect's name."""
        return {effect.name: np.array(inner) for effect, inner in self.setting}

    @cached_property
    def gravity(self) -> float:
        """Gravity that acts on the robot, m/s²."""
        return STANDARD if self.bench.gravity or "gravity @ robot" in self.values else 0.0

    @cached_property
    def response(self) -> Response:
        """Six unit wrenches, then the robot's own loads without effects of the instrument."""
        tree = self.bench.unbounded.tree(self.bench.campaign.poses + self.astray)
        for effect, inner in self.setting:
            if effect.acts is not None:
                tree = changed(tree, effect.acts(np.array(inner), self.bench.nominal))
        count = len(self.bench.campaign.poses)
        unit = np.broadcast_to(np.eye(6), (count, 6, 6))
        own = np.broadcast_to(self.payload[:, None], (count, 6, 1))
        loads = np.concatenate([unit, np.zeros((count, 6, 1)), own], axis=-1)
        whole = assembled(tree, loads=True)
        return respond(whole, loads, gravity=np.array([0.0] * 6 + [1.0, 0.0]))

    @cached_property
    def geometry(self) -> Array:
        """Errors (5,) of the rigid mechanism in m: limb 1, limb 2, stage outward, mean links of limb 1, limb 2."""
        out = np.zeros(5)
        for effect, inner in self.setting:
            value = inner[0] if inner else 0.0
            if effect.effect == "encoder-offset":
                out[_PLACES[effect.place]] += value
            elif effect.effect == "thermal":
                out[3:] += EXPANSION * self.bench.nominal.length * value
            elif effect.effect == "link-length":
                share = value if effect.place == "links" else value / 3.0
                out[3:] += share * np.array([effect.place[:5] in {"links", f"limb{i}"} for i in (1, 2)])
        return out

    @cached_property
    def astray(self) -> Array:
        """Translation (p, 3) of the tool by errors of the rigid mechanism, exactly."""
        if not self.geometry.any():
            return np.zeros((len(self.bench.campaign.poses), 3))
        return _displaced(self.bench.robot.geometry, self.bench.campaign.poses, self.geometry)

    @cached_property
    def misfit(self) -> Array:
        """Twist (p, 6) of the unloaded tool by lack of fit, with its rigid part exact."""
        out = np.zeros((len(self.bench.campaign.poses), 6))
        if self.geometry.any():
            there = self.bench.campaign.poses + self.astray
            both = [
                _displaced(self.bench.robot.geometry, there, sign * _SLIGHT * self.geometry) for sign in (1.0, -1.0)
            ]
            out[:, :3] = self.astray - (both[0] - both[1]) / (2.0 * _SLIGHT)
        for effect, inner in self.setting:
            if effect.acts is not None:
                for name, change in effect.acts(np.array(inner), self.bench.nominal).items():
                    if change.offset is not None:
                        out = out + np.swapaxes(self.transmitted(name), -1, -2) @ change.offset
        return out

    @cached_property
    def payload(self) -> Array:
        """Wrench (6,) of a payload on the platform at M."""
        inner = self.values.get("payload @ platform", np.zeros(3))
        mass, about_x, about_y = np.pad(inner, (0, 3 - len(inner)))
        return STANDARD * np.array([0.0, 0.0, mass, about_y, -about_x, 0.0])

    @cached_property
    def compliance(self) -> Array:
        """True compliance (p, 6, 6) at M."""
        return self.response.twist[..., :6]

    def transmitted(self, name: str) -> Array:
        """Wrench (p, 6, 6) on an element for unit wrenches at M."""
        shape = (len(self.bench.campaign.poses), 6, 8)
        return np.broadcast_to(self.response.elements[name].wrench, shape)[..., :6]

    def dead_wrench(self, name: str) -> Array:
        """Wrench (p, 6) that an element carries under the robot's own loads."""
        shape = (len(self.bench.campaign.poses), 6, 8)
        wrench = np.broadcast_to(self.response.elements[name].wrench, shape)
        return self.gravity * wrench[..., 6] + wrench[..., 7]

    @cached_property
    def dead(self) -> Array:
        """True deviation (p, 6) of the unloaded tool."""
        weight = self.gravity * self.response.twist[..., 6]
        loaded = self.response.twist[..., 7] - self._platform_yield @ self.payload
        lost = np.zeros_like(weight)
        for place in DRIVES:
            lost += self.lost_motion(place)[1]
        return weight + loaded + self.misfit + lost

    @cached_property
    def _platform_yield(self) -> Array:
        """Compliance (6, 6) between platform and tool: it yields to the applied wrench alone."""
        return np.asarray(self.bench.nominal.springs["platform"].compliance) + sum(
            (
                np.asarray(effect.acts(np.array(inner), self.bench.nominal)["platform"].compliance)
                for effect, inner in self.setting
                if effect.effect == "platform-compliance" and effect.acts is not None
            ),
            np.zeros((6, 6)),
        )

    def drive_force(self, place: str) -> tuple[Array, Array]:
        """Force of a drive under every reading's applied wrench (n,), and under the dead loads at every pose (p,)."""
        axis = 1 if place == "stage" else 0
        campaign = self.bench.campaign
        per_wrench = self.transmitted(DRIVES[place])[:, axis]
        applied = np.einsum("nj,nj->n", per_wrench[campaign.pose], np.nan_to_num(campaign.wrench)) * self.force_scale
        return applied, self.dead_wrench(DRIVES[place])[:, axis]

    def by_drive(self, place: str) -> Array:
        """Twist (p, 6) of the tool for a shift of one metre in a drive."""
        return self.transmitted(DRIVES[place])[:, 1 if place == "stage" else 0]

    def lost_motion(self, place: str) -> tuple[Array, Array]:
        """Twist of the tool by backlash: at every reading (n, 6), and unloaded at every pose (p, 6)."""
        width = float(self.values.get(f"backlash @ {place}", np.zeros(1))[0])
        slide = self.by_drive(place)
        if width == 0.0:
            return np.zeros((len(self.bench.campaign), 6)), np.zeros_like(slide)
        applied, dead = (_sign(force) for force in self.drive_force(place))
        return width * applied[:, None] * slide[self.bench.campaign.pose], width * dead[:, None] * slide

    @cached_property
    def seen(self) -> Array:
        """Matrix (6, 6) from a true twist to what the instrument shows."""
        x, y, z = self.values.get("instrument-misalignment @ instrument", np.zeros(3))
        turn = np.eye(3) + np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        scale = 1.0 + float(self.values.get("displacement-scale @ instrument", np.zeros(1))[0])
        return scale * np.kron(np.eye(2), turn)

    @property
    def force_scale(self) -> float:
        """True wrench over stated wrench."""
        return 1.0 + float(self.values.get("force-scale @ instrument", np.zeros(1))[0])

    @cached_property
    def moved(self) -> Array:
        """True twist (n, 6) behind every deflection and deviation."""
        c = self.bench.campaign
        out = self.force_scale * np.einsum("nij,nj->ni", self.compliance[c.pose], np.nan_to_num(c.wrench))
        for place in DRIVES:
            out = out + self.lost_motion(place)[0]
        return np.where((c.kind == DEVIATION)[:, None], self.dead[c.pose], out)

    @cached_property
    def shown_stiffness(self) -> Array:
        """Stiffness (p, 6, 6) as stated wrench over what the instrument shows."""
        return np.linalg.inv(self.seen @ self.compliance) / self.force_scale

    @cached_property
    def prediction(self) -> Array:
        """What every reading (n,) would be."""
        patterns = [effect.reads(self) @ np.array(inner) for effect, inner in self.setting if effect.reads is not None]
        return sum(patterns, self.plain)

    @cached_property
    def plain(self) -> Array:
        """What every reading (n,) would be by the robot, its loads and its instrument."""
        c = self.bench.campaign
        shown = np.take_along_axis(self.moved @ self.seen.T, c.direction[:, None], axis=1)[:, 0]
        stiff = self.shown_stiffness[c.pose, c.direction, c.direction]
        return np.where(c.kind == STIFFNESS, stiff, shown)

    def reading(self, twist: Array, dead: Array, compliance: Array | None) -> Array:
        """Change (n,) of readings by small changes of true twists (n, 6), of dead ones (p, 6), of C (p, 6, 6)."""
        c = self.bench.campaign
        whole = np.where((c.kind == DEVIATION)[:, None], dead[c.pose], twist) @ self.seen.T
        out = np.take_along_axis(whole, c.direction[:, None], axis=1)[:, 0]
        if not (c.kind == STIFFNESS).any():
            return out
        stiff = np.zeros(len(c))
        if compliance is not None:
            shown = self.shown_stiffness
            change = -shown @ (self.seen @ compliance * self.force_scale) @ shown
            stiff = change[c.pose, c.direction, c.direction]
        return np.where(c.kind == STIFFNESS, stiff, out)

    def columns(self, effect: Effect) -> Array:
        """Derivative (n, k) of every reading by the effect's inner parameters, here."""
        if effect.acts is not None:
            here = self.values.get(effect.name, np.zeros(len(effect.scale)))
            return np.stack([self._mechanical(effect, here, k) for k in range(len(effect.scale))], axis=1)
        if effect.reads is not None:
            return effect.reads(self)
        match effect.effect:
            case "payload":
                return self._payload()[:, : len(effect.scale)]
            case "backlash":
                return self._backlash(effect.place)
            case _:
                return self._instrument(effect.effect)

    def weight_column(self) -> Array:
        """Change (n,) of the readings when the robot's own weight acts."""
        from stiffscope.vjm.analysis import stiffness

        c = self.bench.campaign
        out = self.reading(np.zeros((len(c), 6)), STANDARD * self.response.twist[..., 6], None)
        stiff = c.kind == STIFFNESS
        if stiff.any():
            change = stiffness(self.bench.robot, c.poses, gravity="exact") - stiffness(self.bench.robot, c.poses)
            out = np.where(stiff, change[c.pose, c.direction, c.direction], out)
        return out

    def _mechanical(self, effect: Effect, here: Array, k: int) -> Array:
        acts = effect.acts
        step = _STEP * effect.scale[k] * np.eye(len(here))[k]
        c = self.bench.campaign
        twist, dead = np.zeros((len(c), 6)), np.zeros((len(c.poses), 6))
        compliance = np.zeros((len(c.poses), 6, 6))
        if acts is None:
            return np.zeros(len(c))
        wrench = np.nan_to_num(c.wrench) * self.force_scale
        ahead, behind = acts(here + step, self.bench.nominal), acts(here - step, self.bench.nominal)
        for name, (softer, moved) in _slopes(ahead, behind, 2.0 * step[k]).items():
            at = self.transmitted(name)
            if softer is not None:
                inner = np.swapaxes(at, -1, -2) @ softer
                compliance += inner @ at
                if effect.effect != "platform-compliance":
                    dead += np.einsum("pij,pj->pi", inner, self.dead_wrench(name))
            if moved is not None:
                dead += np.einsum("pji,j->pi", at, moved)
        twist += np.einsum("nij,nj->ni", compliance[c.pose], wrench)
        return self.reading(twist, dead, compliance)

    def _payload(self) -> Array:
        nothing = np.zeros((len(self.bench.campaign), 6))
        yields = self.compliance - self._platform_yield
        unit = STANDARD * np.array([[0, 0, 1, 0, 0, 0], [0, 0, 0, 0, -1, 0], [0, 0, 0, 1, 0, 0]], dtype=np.float64)
        return np.stack([self.reading(nothing, yields @ wrench, None) for wrench in unit], axis=1)

    def _backlash(self, place: str) -> Array:
        applied, dead = (_sign(force) for force in self.drive_force(place))
        slide = self.by_drive(place)
        return self.reading(applied[:, None] * slide[self.bench.campaign.pose], dead[:, None] * slide, None)[:, None]

    def _instrument(self, effect: str) -> Array:
        c = self.bench.campaign
        stiff = c.kind == STIFFNESS
        shown = self.plain
        if effect == "displacement-scale":
            factor = self.seen[0, 0]
            return (np.where(stiff, -shown, shown) / factor)[:, None]
        if effect == "force-scale":
            loaded = np.where(c.kind == DEFLECTION, shown, np.where(stiff, -shown, 0.0))
            return (loaded / self.force_scale)[:, None]
        scale = float(np.cbrt(np.linalg.det(self.seen[:3, :3])))
        columns: list[Array] = []
        for axis in np.eye(3):
            turn = scale * np.kron(np.eye(2), np.cross(axis, np.eye(3)).T)
            moved = np.take_along_axis(self.moved @ turn.T, c.direction[:, None], axis=1)[:, 0]
            change = -self.shown_stiffness @ turn @ np.linalg.inv(self.seen)
            columns.append(np.where(stiff, change[c.pose, c.direction, c.direction], moved))
        return np.stack(columns, axis=1)


def _displaced(geometry: Geometry, poses: Array, errors: Array) -> Array:
    """Translation (p, 3) of M by errors (5,) of drives and of each limb's mean link, by the circles it runs on."""
    sine = (poses[:, 2] - geometry.l1 - geometry.l2) / geometry.L
    reach = geometry.L * np.sqrt(1.0 - sine**2) + geometry.l
    first, second = reach - poses[:, 0] + errors[0], reach + poses[:, 0] + errors[1]
    links = geometry.L + errors[3:]
    between = first + second - 2.0 * geometry.l
    along = (between**2 + links[0] ** 2 - links[1] ** 2) / (2.0 * between)
    if not (np.abs(along) < links[0]).all():
        raise InputError("errors of the geometry tear the mechanism apart")
    x = geometry.l - first + along
    z = geometry.l1 + geometry.l2 + np.sqrt(links[0] ** 2 - along**2)
    return np.column_stack([x - poses[:, 0], np.full(len(poses), errors[2]), z - poses[:, 2]])


def _sign(force: Array) -> Array:
    return np.where(np.abs(force) > _NOTHING * max(float(np.abs(force).max(initial=0.0)), 1e-6), np.sign(force), 0.0)


def _slopes(ahead: Changes, behind: Changes, step: float) -> dict[str, tuple[Array | None, Array | None]]:
    """Derivatives of what an effect does to each element."""

    def slope(a: Array | None, b: Array | None) -> Array | None:
        return None if a is None or b is None else (a - b) / step

    none = Change()
    return {
        name: (
            slope(ahead[name].compliance, behind.get(name, none).compliance),
            slope(ahead[name].offset, behind.get(name, none).offset),
        )
        for name in ahead
    }
