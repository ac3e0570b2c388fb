"""Forward model of a nominal robot: every effect at every place with its prior, nuisance patterns, readings to come."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.errors import InputError
from stiffscope.gap.campaign.campaign import AT_TOOL
from stiffscope.gap.campaign.on_robot import match_robot
from stiffscope.gap.campaign.quantities import AXES, DEFLECTION, DEVIATION, PUSH, STIFFNESS
from stiffscope.gap.forward.forward_model import Candidate, Trial
from stiffscope.gap.forward.mechanics import RobotAtPoses, configured
from stiffscope.gap.forward.noise import noise_of
from stiffscope.gap.forward.nuisance import nuisance_patterns
from stiffscope.gap.forward.robot_prediction import INSTRUMENT, Laden, RobotPrediction
from stiffscope.robot.effects import MechanicalEffect, dimension_effects, factor_of, growth_of, mechanical_effects
from stiffscope.robot.vocabulary import COUPLED, EFFECTS

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from stiffscope.gap.campaign.campaign import Campaign
    from stiffscope.gap.forward.forward_model import Noise, Parameters
    from stiffscope.robot.effects import NominalRobot, Place

    Array = NDArray[np.floating[Any]]

FORCE, MOMENT = 500.0, 100.0  # N, N·m: the range of loads where the campaign shows none
DISPLACEMENT, ROTATION = 1e-6, 5e-6  # m, rad: the instrument where the campaign shows none
SIGNIFICANT = 3.0  # standard deviations
_FACTORS = (-0.8, 50.0)  # bounds of what is 1/factor - 1 or factor - 1: nothing becomes infinitely stiff
_RATIOS = (-1.2, 1.2)  # bounds of the logarithm of what is left of a dimension (of a tube's wall) over the nominal
_RIGID_FOUNDATION = 1e20  # N/m³
_SUSPECT = 0.2  # share of the squared gap beyond drives and noise that a part explains, to make experiments on it
_ADDED = (0.0, np.inf)  # bounds of an added compliance, a dead zone
_SOFT = (2e-7, 2e-6)  # m/N, rad/(N·m): of a tool above which added compliances are expected to be larger in proportion
_MODULUS = ".youngs_modulus"
_SAME = 1e-9  # 1 - |cosine| of signatures below which no reading tells two effects apart
_ROUNDING = 1e-10  # of the largest reading
_TRIALS = 128  # poses that are looked at for what to measure next
_PRIMES = tuple(p for p in range(2, 500) if all(p % q for q in range(2, p)))  # for coordinates of poses
_HALVINGS = 6  # between two such poses to the rim of what is within reach
_MARGIN = 0.15  # of what the campaign and the map sweep, on either side, for such poses
_OVERTAKES = 0.25  # share of the misfit below which stiffnesses are better taken for pushes, or the other way round
_EVIDENT = 25.0  # χ² that such a change has to gain


@dataclass(frozen=True)
class Prior:
    """Prior sizes of internal parameters, plausible ranges of physical ones, bounds."""

    scale: tuple[float, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    bounds: tuple[float, float] = (-np.inf, np.inf)


_SUPPORT = Prior((1e-8,) * 3 + (1e-7,) * 6, (0.0,) * 6 + (-1e-5,) * 3, (1e-6,) * 3 + (1e-5,) * 6, _ADDED)
PRIORS = {
    "actuator-stiffness": Prior((0.2,), (0.2,), (2.0,), _FACTORS),
    "joint-compliance": Prior((2e-9, 2e-9, 1e-6), (0.0,) * 3, (1e-6, 1e-6, 1e-3), _ADDED),
    "link-stiffness": Prior((0.2,), (0.2,), (2.0,), _FACTORS),
    "rigid-ends": Prior((0.02,), (0.0,), (0.15,), _ADDED),
    "part-compliance": Prior((0.5,), (0.2,), (20.0,), _FACTORS),
    "guide-compliance": Prior((5e-9, 5e-9, 1e-7), (0.0,) * 3, (1e-6, 1e-6, 1e-4), _ADDED),
    "base-compliance": _SUPPORT,
    "platform-compliance": _SUPPORT,
    "backlash": Prior((1e-5,), (0.0,), (1e-3,), _ADDED),
    "encoder-offset": Prior((2e-4,), (-5e-3,), (5e-3,)),
    "link-length": Prior((1e-4,), (-3e-3,), (3e-3,)),
    "thermal": Prior((10.0,), (-60.0,), (100.0,)),
    "instrument-misalignment": Prior((0.01,) * 3, (-0.1,) * 3, (0.1,) * 3),
    "displacement-scale": Prior((0.05,), (0.7,), (1.4,), _FACTORS),
    "force-scale": Prior((0.05,), (0.7,), (1.4,), _FACTORS),
}
PRIORS["slider-compliance"] = PRIORS["part-compliance"]
_IN_MATRIX = {"link-stiffness", "rigid-ends", "part-dimension", "part-compliance", "slider-compliance"}
_OF_DRIVES = {"backlash", "encoder-offset"}
_OF_ONE_SIZE = 30.0  # times what one of two twins usually does to the readings that the other may do
_MOST_COMPLIANT = 100.0  # times its nominal compliance that a part may yield


def robot_candidates(at: RobotAtPoses) -> tuple[Candidate, ...]:
    """Every effect at every place of a robot, with priors of its size, and of the campaign's instruments."""
    nominal = at.robot
    soft = _softness(at)
    return (
        Candidate("gravity", "robot"),
        *_payloads(at),
        *(_mechanical(effect, nominal, soft) for effect in mechanical_effects(nominal)),
        *(_backlash(place, nominal) for place in nominal.places(nominal.driven) if len(place.members) == 1),
        *_instruments(at.campaign),
    )


def _softness(at: RobotAtPoses) -> Array:
    """How many times softer than a machine tool's the robot is, in translation and rotation; at least 1, (2,)."""
    diagonal = np.einsum("pii->pi", at.state().compliance)
    found = np.array([np.median(diagonal[:, :3]), np.median(diagonal[:, 3:])])
    return np.maximum(1.0, np.nan_to_num(found) / np.array(_SOFT))


def _payloads(at: RobotAtPoses) -> Iterator[Candidate]:
    """A mass on each rigid body: with its first moments, and at a point alone."""
    names, units = zip(*EFFECTS["payload"], strict=True)
    gravity = at.mechanism.gravity
    if not gravity.any():
        return
    for body in at.mechanism.bodies:
        if body.elastic is not None:
            continue
        tool = at.mechanism.tool.body == body.name
        joints = [j.at for j in at.mechanism.joints if body.name in (j.first, j.second)]
        middle = np.mean(joints, axis=0) if joints else np.zeros(3)
        point = at.mechanism.tool.at if tool else middle if body.centre is None else body.centre
        rotation = at.configurations.frame(body.name)[0]
        level = np.sort(np.argsort(np.abs(gravity), kind="stable")[:2])
        turns = np.abs(rotation @ gravity - gravity).max() > 1e-9 * np.abs(gravity).max()
        axes = np.arange(3) if turns else level
        action = Laden(body.name, point, np.eye(3)[axes])
        mass, moments = (0.0, 50.0), ((-0.5, 0.5),) * 3
        sizes = (3.0, *(0.3,) * len(axes))
        centred = _Centred(tuple(int(a) for a in axes))
        yield Candidate("payload", body.name, names, units, sizes, (mass, *moments), physical=centred.physical,
                        internal=centred.internal, action=action)  # fmt: skip
        yield Candidate("payload", body.name, names[:1], units[:1], (3.0,), (mass,), action=action)


@dataclass(frozen=True)
class _Centred:
    """Mass and centre of mass of a payload; along other axes than these its centre is not in the readings."""

    axes: tuple[int, ...]

    def physical(self, values: Array) -> Array:
        """Mass and centre of mass (4,) of internal parameters."""
        mass = values[0] if abs(values[0]) > 1e-9 else 1e-9
        out = np.zeros(4)
        out[0] = values[0]
        out[[1 + a for a in self.axes]] = values[1:] / mass
        return out

    def internal(self, values: Array) -> Array:
        """Mass and first moments of physical parameters (4,)."""
        return np.array([values[0], *(values[0] * values[1 + a] for a in self.axes)])


def _backlash(place: Place, nominal: NominalRobot) -> Candidate:
    candidate = _by_name("backlash", place.name)
    (drive,) = place.members
    unit = "rad" if nominal.driven[drive].kind == "revolute" else "m"
    aliases = tuple(f"backlash @ {name}" for name in place.others)
    return replace(candidate, units=(unit,), aliases=aliases, action=drive, component=drive)


def _instruments(campaign: Campaign) -> Iterator[Candidate]:
    """Scales and misalignments of the instrument at M and of each sensor, scale of the applied force."""
    moving = campaign.kind <= DEVIATION
    at_tool = (campaign.sensor < 0) & (campaign.kind <= PUSH)
    several = len(campaign.sensors) > 1
    if at_tool.any() or several:
        for effect in ("instrument-misalignment", "displacement-scale"):
            yield replace(_by_name(effect, INSTRUMENT), component=INSTRUMENT)
    for k, sensor in enumerate(campaign.sensors):
        if (moving & (campaign.sensor == k)).any():
            for effect in ("instrument-misalignment", "displacement-scale"):
                yield replace(_by_name(effect, sensor.name), component=sensor.name)
    yield _by_name("force-scale", INSTRUMENT)


def _by_name(effect: str, place: str) -> Candidate:
    """A candidate that `RobotPrediction` knows by its name."""
    names, units = zip(*EFFECTS[effect], strict=True)
    prior = PRIORS[effect]
    plausible = tuple(zip(prior.low, prior.high, strict=True))
    candidate = Candidate(effect, place, names, units, prior.scale, plausible, prior.bounds)
    return replace(candidate, physical=factor_of, internal=growth_of) if names == ("factor",) else candidate


def _mechanical(effect: MechanicalEffect, nominal: NominalRobot, soft: Array) -> Candidate:
    entries = effect.names[0] == "c11"
    prior = _of_entries(effect, nominal) if entries else PRIORS[effect.effect]
    scale, low, high = np.array(prior.scale), np.array(prior.low), np.array(prior.high)
    units = effect.units
    known = [name for name, _ in EFFECTS[effect.effect]]
    if prior.bounds == _ADDED and len(prior.scale) > 1:
        pick = [known.index(name) for name in effect.names]
        times = np.array([soft[int(unit.startswith("rad"))] for unit in units])
        scale, low, high = (each[pick] * times for each in (scale, low, high))
    if effect.effect in _OF_DRIVES and all(nominal.driven[name].kind == "revolute" for name in effect.members):
        units = ("rad",)
    return Candidate(
        effect.effect,
        effect.place,
        effect.names,
        units,
        tuple(scale.tolist()),
        tuple(zip(low.tolist(), high.tolist(), strict=True)),
        prior.bounds,
        effect.physical,
        effect.internal,
        component=_component(effect),
        aliases=effect.others,
        couplings=sum(name in COUPLED for name in effect.names),
        flexible=entries,
        action=effect,
    )


def _of_entries(effect: MechanicalEffect, nominal: NominalRobot) -> Prior:
    """Entries of a part's compliance: those on the diagonal are not negative, none is many times the nominal."""
    rows, columns = np.array([(int(name[1]) - 1, int(name[2]) - 1) for name in effect.names]).T
    diagonal = np.diagonal(nominal.compliances[effect.members[0]])
    high = _MOST_COMPLIANT * np.sqrt(diagonal[rows] * diagonal[columns])
    low = np.where(rows == columns, 0.0, -high)
    return Prior((1.0,) * len(rows), tuple(low.tolist()), tuple(high.tolist()))


def dimension_candidates(nominal: NominalRobot, part: str) -> tuple[Candidate, ...]:
    """A part's dimensions, material constants and foundation; see `dimension_effects`."""
    return tuple(_of_dimension(effect) for effect in dimension_effects(nominal, part))


def _of_dimension(effect: MechanicalEffect) -> Candidate:
    """A part's parameter: a tenth of it (of a tube's wall) is usual; a rigid foundation may yield as a bolted joint."""
    nominal = float(effect.physical(np.zeros(1))[0])
    rigid = nominal > _RIGID_FOUNDATION
    plausible = (1e8, np.inf) if rigid else (0.5 * nominal, 2.0 * nominal)
    return Candidate(
        effect.effect, effect.place, effect.names, effect.units, (1.0,) if rigid else (0.1,), (plausible,),
        _ADDED if rigid else _RATIOS, effect.physical, effect.internal, action=effect,
    )  # fmt: skip


def _component(effect: MechanicalEffect) -> str:
    """The element that an effect on stiffness blames, where it blames a single one, or a place that is none."""
    if effect.effect in {"base-compliance", "platform-compliance"}:
        return effect.place
    by_stiffness = not effect.names[0].startswith("c") and effect.effect not in {"encoder-offset", "link-length"}
    single = len(effect.members) == 1 and by_stiffness and effect.effect not in {"thermal", "rigid-ends"}
    return effect.members[0] if single else ""


@dataclass(frozen=True)
class RobotModel:
    """A campaign on its nominal robot."""

    campaign: Campaign
    nominal: NominalRobot
    without: str = ""
    """An effect that is left out of the library."""
    most_effects: int = 5
    tried: tuple[tuple[Candidate, ...], ...] = ()
    prior_sizes: Array = field(default_factory=lambda: np.geomspace(0.03, 10.0, 6))

    def __post_init__(self) -> None:
        """Look up poses by name, and check poses, sensors and loads against the robot. Raises InputError."""
        object.__setattr__(self, "campaign", match_robot(self.campaign, self.nominal.robot))

    @property
    def library(self) -> tuple[Candidate, ...]:
        """Effects, without those that the nominal model carries, and nuisance patterns; twins are merged."""
        return self._library

    @cached_property
    def _library(self) -> tuple[Candidate, ...]:
        gone = {self.without, "gravity" if self._weighted else ""}
        known = tuple(c for c in robot_candidates(self._at) if c.effect not in gone)
        if "part-dimension" not in gone:
            known = (*known, *self._dimensions())
        merged = _merged(known, self.predict())
        return (*merged, *nuisance_patterns(self.predict()))

    def _dimensions(self) -> Iterator[Candidate]:
        """Dimensions of parts by beam theory, and of those by virtual experiments that are suspect: these take time."""
        for part in self.nominal.robot.parts:
            if part not in self.nominal.tested or self._suspect(part):
                yield from dimension_candidates(self.nominal, part)

    def _suspect(self, part: str) -> bool:
        """Whether the compliance of a part, entry by entry, explains a good share of the gap that drives leave."""
        members = self.nominal.robot.bodies_of(part)
        entries = [e for e in mechanical_effects(self.nominal) if e.names[0] == "c11" and e.members == members]
        if not entries:
            return False
        own, (beside, gap) = self._weighed([entries[0]]), self._beside_drives
        columns = own - beside @ (beside.T @ own)
        size = np.linalg.norm(own, axis=0).clip(min=1e-300)
        basis = np.linalg.qr(columns / size)[0]
        explained = float(np.sum((basis.T @ gap) ** 2))
        count = columns.shape[1]
        stated = ~np.isnan(self.campaign.sigma)
        least = count + SIGNIFICANT * np.sqrt(2.0 * count) if stated.all() else 0.0  # χ² of noise alone
        return explained > max(least, _SUSPECT * (float(gap @ gap) - float(stated.sum())))

    @cached_property
    def _beside_drives(self) -> tuple[Array, Array]:
        """An orthonormal basis (n, k) of what soft drives do to the readings, and the gap (n,) that they leave."""
        drives = [e for e in mechanical_effects(self.nominal) if e.effect == "actuator-stiffness"]
        columns = self._weighed([e for e in drives if len(e.members) == 1])
        left, size, _ = np.linalg.svd(columns, full_matrices=False)
        basis = left[:, size > _ROUNDING * size.max(initial=0.0)]
        gap = (self.campaign.value - self.predict().values) * self._weight
        return basis, gap - basis @ (basis.T @ gap)

    @cached_property
    def _weight(self) -> Array:
        """One over each reading's (n,) uncertainty, or its size where none is stated."""
        c = self.campaign
        return 1.0 / np.where(np.isnan(c.sigma), np.abs(c.value) + 1e-300, c.sigma)

    def _weighed(self, effects: Sequence[MechanicalEffect]) -> Array:
        """Derivatives (n, k) by effects, weighted."""
        prediction = self.predict()
        columns = [prediction.columns(_mechanical(e, self.nominal, np.ones(2))) for e in effects]
        return np.hstack([np.zeros((len(self.campaign), 0)), *columns]) * self._weight[:, None]

    @property
    def _weighted(self) -> bool:
        return "gravity" in self.campaign.modelled

    @cached_property
    def _at(self) -> RobotAtPoses:
        return RobotAtPoses(self.nominal, self.campaign)

    def admits(self, candidates: Sequence[Candidate]) -> bool:
        """One of each name, as some effects come with fewer or more parameters; with a matrix no part of it."""
        if len({c.name for c in candidates}) < len(candidates):
            return False
        matrices = [c.action.members for c in candidates if c.flexible and isinstance(c.action, MechanicalEffect)]
        return not matrices or not any(
            not c.flexible and c.effect in _IN_MATRIX and c.action.members in matrices
            for c in candidates
            if isinstance(c.action, MechanicalEffect)
        )

    def predict(self, parameters: Parameters = ()) -> RobotPrediction:
        """Readings with these effects. Raises InputError where the parameters leave what can be assembled."""
        return RobotPrediction(self.campaign, self._at, self._weighted, parameters) if parameters else self._nominal

    @cached_property
    def _nominal(self) -> RobotPrediction:
        return RobotPrediction(self.campaign, self._at, self._weighted, ())

    def noise(self) -> Noise:
        """Noise and gross outliers, as the joint fit of all effects shows them."""
        return noise_of(self)

    def trial(self, sigma: Array) -> Trial:
        """Every load and axis at its largest, and none, read by what the lab has, at poses all over the workspace."""
        c = self.campaign
        poses = self._trial_poses()
        cases = self._trial_loads()
        channels = np.unique(c.channel[c.kind <= DEVIATION])
        at_tool = channels >= len(c.sensors)
        if at_tool.any() or not len(channels):
            channels = np.concatenate([channels[~at_tool], len(c.sensors) + np.arange(6)])
        sensor = np.where(channels < len(c.sensors), channels, AT_TOOL)
        axes = np.array([s.axis for s in c.sensors] + list(range(6)))
        per, rows = len(channels), len(cases) * len(channels)
        n = len(poses) * rows
        load = np.tile(np.repeat([k for k, _ in cases], per), len(poses))
        wrench = np.tile(np.repeat([w for _, w in cases], per, axis=0), (len(poses), 1))
        still = ~wrench.any(axis=1)
        direction = np.tile(axes[channels], n // per)
        trial = replace(
            c,
            pose_names=tuple(f"({', '.join(f'{v:g}' for v in pose)})" for pose in poses),
            poses=poses,
            pose=np.repeat(np.arange(len(poses)), rows),
            wrench=wrench,
            quantity=6 * np.where(still, DEVIATION, DEFLECTION) + direction,
            value=np.zeros(n),
            sigma=np.ones(n),
            session=np.zeros(n),
            file=np.zeros(n),
            line=np.arange(n),
            sensors=tuple(replace(s, zero="none") for s in c.sensors),
            sensor=np.tile(sensor, n // per),
            load=load,
        )
        noise = self._displacement_noise(sigma)[np.tile(channels, n // per)]
        return Trial(replace(self, campaign=trial), noise, np.arange(n) // per)

    def _trial_poses(self) -> Array:
        """Poses (k, d) within reach, evenly over the campaign's own and what the robot's map sweeps."""
        c = self.campaign
        low, high = c.poses.min(axis=0), c.poses.max(axis=0)
        sweep = self.nominal.robot.map
        for k, name in enumerate(c.coordinates):
            span = getattr(sweep, name, None) if sweep is not None else None
            if span is not None and not isinstance(span, float):
                low[k], high[k] = min(low[k], *span), max(high[k], *span)
        margin = _MARGIN * (high - low)
        low, high = low - margin, high + margin
        free = np.flatnonzero(high > low)
        points = np.repeat(np.median(c.poses, axis=0)[None], _TRIALS, axis=0)
        points[:, free] = low[free] + _halton(_TRIALS, len(free)) * (high - low)[free]
        middle = np.median(c.poses, axis=0)
        home = self.nominal.mechanism.tool.home if c.coordinates == self.nominal.mechanism.tool.pose else 0.0 * middle
        lines = [_along(start, int(k), low[k], high[k]) for start in (home, middle) for k in free]
        reached = np.vstack([*lines, points, c.poses[: _TRIALS // 8]])
        valid = self._reaches(reached)
        pairs = [(i, i + 1) for k in range(len(lines)) for i in range(k * len(lines[0]), (k + 1) * len(lines[0]) - 1)]
        ends = [(i, j) if valid[i] else (j, i) for i, j in pairs if valid[i] != valid[j]]
        inside, outside = (reached[[end[side] for end in ends]] for side in (0, 1))
        for _ in range(_HALVINGS if ends else 0):
            half = 0.5 * (inside + outside)
            good = self._reaches(half)[:, None]
            inside, outside = np.where(good, half, inside), np.where(good, outside, half)
        found = np.vstack([inside, reached[valid]])
        while not (valid := self._reaches(found)).all():  # all but singular poses may be reached beside others alone
            found = found[valid]
        return found

    def _reaches(self, poses: Array) -> NDArray[np.bool_]:
        """Which poses (k, d) are within reach, (k,)."""
        return configured(self.nominal.mechanism, self.campaign.coordinates, poses).valid

    def _trial_loads(self) -> list[tuple[int, Array]]:
        """Loads and their wrenches (6,): none, and every axis that the campaign loads at its largest."""
        c = self.campaign
        out: list[tuple[int, Array]] = [(AT_TOOL, np.zeros(6))]
        for load in range(AT_TOOL, len(c.loads)):
            wrench = np.nan_to_num(c.wrench[(c.kind == DEFLECTION) & (c.load == load)])
            largest = np.abs(wrench).max(axis=0) if len(wrench) else np.zeros(6)
            out += [(load, row) for row in np.diag(largest) if row.any()]
        if len(out) == 1:
            out += [(AT_TOOL, row) for row in np.diag([FORCE] * 3 + [MOMENT] * 3)]
        return out

    def _displacement_noise(self, sigma: Array) -> Array:
        """Noise of a displacement by each channel, as the campaign's own readings have it."""
        c = self.campaign
        moving = c.kind <= DEVIATION
        out = np.array(
            [ROTATION if s.rotates else DISPLACEMENT for s in c.sensors] + [DISPLACEMENT] * 3 + [ROTATION] * 3
        )
        for channel in range(len(out)):
            mine = moving & (c.channel == channel)
            if channel >= len(c.sensors):
                mine = moving & (c.sensor < 0) & (c.direction // 3 == (channel - len(c.sensors)) // 3)
            if mine.any():
                out[channel] = np.median(sigma[mine])
        return out

    def remarks(self, noise: Noise, unexplained: Array) -> tuple[str, ...]:
        """Stiffness above the model's, taken for another kind; gravity where it cannot be the cause."""
        return (*self._beyond_bounds(noise), *self._mistaken(noise), *self._too_weak(noise, unexplained))

    def _beyond_bounds(self, noise: Noise) -> list[str]:
        """Readings of stiffness above the model's own, which more compliance only lowers."""
        c = self.campaign
        stiff = np.flatnonzero((c.kind == STIFFNESS) & noise.used)
        if not len(stiff):
            return []
        limit = self.predict().plain[stiff]
        over = (c.value[stiff] - limit) / noise.sigma[stiff] > SIGNIFICANT + np.sqrt(2.0 * np.log(len(stiff)))
        if not over.any():
            return []
        axes = ", ".join(sorted({f"k{AXES[d]}" for d in c.direction[stiff[over]]}))
        worst = float((c.value[stiff] / limit)[over].max())
        return [f"{axes} exceed what the model has, up to {worst:.3g} times: no added compliance cures that"]

    def _mistaken(self, noise: Noise) -> list[str]:
        """A word where stiffnesses with other motions held fit far better as pushes, or the other way round."""
        c = self.campaign
        out: list[str] = []
        for kind, other, told in ((STIFFNESS, PUSH, "k"), (PUSH, STIFFNESS, "p")):
            mine = np.flatnonzero((c.kind == kind) & noise.used)
            if not mine.size:
                continue
            swapped = self.predict_as(kind, other)
            now, then = (
                float(np.sum(((c.value - values)[mine] / noise.sigma[mine]) ** 2))
                for values in (self.predict().plain, swapped)
            )
            if then < _OVERTAKES * now and now - then > _EVIDENT:
                meant, held = ("p", "free") if told == "k" else ("k", "held")
                out.append(
                    f"the stiffnesses {told}.. fit far better as {meant}.., with all other motions {held}: "
                    f"χ² {then:.3g} instead of {now:.3g}"
                )
        return out

    def predict_as(self, kind: int, other: int) -> Array:
        """What the readings (n,) would be if those of one kind were of another."""
        c = self.campaign
        quantity = np.where(c.kind == kind, 6 * other + c.direction, c.quantity)
        return replace(self, campaign=replace(c, quantity=quantity)).predict().plain

    def _too_weak(self, noise: Noise, unexplained: Array) -> list[str]:
        """Gravity of known size that would have to be many times stronger than it is."""
        if self._weighted:
            return []
        step = self.predict().step(Candidate("gravity", "robot"))
        column = (step / noise.sigma)[noise.used]
        size = float(column @ column)
        if size <= 0.0:
            return []
        strength = float(column @ unexplained[noise.used]) / size
        if not abs(strength) > SIGNIFICANT * max(1.0, 1.0 / np.sqrt(size)):
            return []
        return [
            f"gravity would have to be {strength:.3g} times what it is to explain the gap best, so it is not the cause"
        ]


def _along(start: Array, axis: int, low: float, high: float) -> Array:
    """Poses (k, d) from a start along one coordinate, from end to end of its range."""
    out = np.repeat(start[None], _TRIALS // 4, axis=0)
    out[:, axis] = np.linspace(low, high, len(out))
    return out


def _halton(count: int, dimensions: int) -> Array:
    """Evenly spread points (count, d) in the unit cube: digits of 1, 2, ... in a prime base each, mirrored.

    Not by `scipy.stats.qmc`, whose import takes a good part of a diagnosis.
    """
    points = np.zeros((count, dimensions))
    for k, base in enumerate(_PRIMES[:dimensions]):
        left, size = np.arange(1, count + 1), 1.0 / base
        while left.any():
            left, digit = np.divmod(left, base)
            points[:, k] += size * digit
            size /= base
    return points


def _shows(columns: Array, candidate: Candidate, prediction: RobotPrediction) -> bool:
    """Whether any reading would change with parameters of their prior size, beyond rounding."""
    largest = float(np.abs(prediction.plain).max(initial=0.0))
    return bool((np.abs(columns) * np.array(candidate.scale) > _ROUNDING * largest).any())


def _is_factor(candidate: Candidate, known: Sequence[Candidate]) -> bool:
    """Whether a candidate is the modulus of a part with a plain factor on its stiffness: the same in other units."""
    same = [c.action.members for c in known if c.effect == "link-stiffness" and isinstance(c.action, MechanicalEffect)]
    action = candidate.action
    return candidate.place.endswith(_MODULUS) and isinstance(action, MechanicalEffect) and action.members in same


def _merged(candidates: Sequence[Candidate], prediction: RobotPrediction) -> tuple[Candidate, ...]:
    """Candidates of one parameter with the very same signature in the readings as twins of the first of them.

    Those of which one usually does many times as much are none: what is a usual offset of an encoder may be a mass that
    is not plausible. What no reading shows is left out.
    """
    candidates = [c for c in candidates if not c.scale or _shows(prediction.columns(c), c, prediction)]
    singles = [k for k, c in enumerate(candidates) if len(c.scale) == 1 and c.effect != "backlash"]
    columns = np.stack([prediction.columns(candidates[k])[:, 0] for k in singles], axis=1) if singles else None
    if columns is None:
        return tuple(candidates)
    if not np.isfinite(columns).all():
        raise InputError("the readings: expected finite derivatives by all effects at the nominal robot")
    weight = 1.0 / np.where(np.isnan(prediction.campaign.sigma), 1.0, prediction.campaign.sigma)
    columns = columns * weight[:, None]
    size = np.linalg.norm(columns, axis=0)
    unit = columns / np.where(size > 0.0, size, 1.0)
    cosine = unit.T @ unit
    usual = np.log(size.clip(min=1e-300)) + np.log([candidates[k].scale[0] for k in singles])
    out: dict[int, Candidate] = dict(enumerate(candidates))
    for i, k in enumerate(singles):
        if k not in out:
            continue
        for j in range(i + 1, len(singles)):
            other = candidates[singles[j]]
            same = cosine[i, j] if candidates[k].positive or other.positive else abs(cosine[i, j])
            if abs(usual[i] - usual[j]) > np.log(_OF_ONE_SIZE):
                continue
            if singles[j] in out and same > 1.0 - _SAME and candidates[k].positive == other.positive:
                if _is_factor(other, candidates):
                    out[k] = replace(out[k], aliases=(*out[k].aliases, other.name))
                else:
                    out[k] = replace(out[k], twins=(*out[k].twins, *other.signature_of))
                del out[singles[j]]
    return tuple(out.values())
