"""Hammer tests of the virtual machine: hits, accelerations, noise with its coherence, and files."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.gap.campaign.writing import write_campaign
from stiffscope.lab.dense import DenseMachine
from stiffscope.lab.faults import HAMMER
from stiffscope.lab.rotations import lever
from stiffscope.responses.model import Direction, Response
from stiffscope.responses.uff_writing import write_uff

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from stiffscope.lab.closure import Frames, Located
    from stiffscope.lab.dense import DenseModes
    from stiffscope.lab.machine import Machine
    from stiffscope.lab.response import Spot
    from stiffscope.lab.rotations import Array

    Complex = NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class HammerPlan:
    """Hits and accelerometers at p poses.

    Attributes
    ----------
    poses
        Commanded poses (p, k), m and rad.
    points
        Numbered points of the machine.
    hits, motions
        Directions of forces and accelerations at these points, base axes.
    hertz
        Lines (f,), evenly spaced with few digits.
    averages
        Hits behind each line.
    about
        Frequency, Hz, of the size of the lowest mode.
    """

    poses: Array
    points: Mapping[str, Spot]
    hits: tuple[Direction, ...]
    motions: tuple[Direction, ...]
    hertz: Array
    averages: int = 5
    about: float = 100.0


@dataclass(frozen=True)
class HammerNoise:
    """Noise of the lines, and damping.

    Attributes
    ----------
    relative
        Standard deviation of a mean line over its size.
    floor
        Standard deviation of a mean accelerance over the rms of all at the pose.
    least_damping, most_damping
        Range of the modes' damping ratios, which are drawn log-uniformly.
    """

    relative: float = 0.02
    floor: float = 0.002
    least_damping: float = 0.005
    most_damping: float = 0.02

    def draw_damping(self, rng: np.random.Generator, count: int) -> Array:
        """Return damping ratios (count,)."""
        low = np.log(self.least_damping)
        high = np.log(self.most_damping)
        return np.exp(rng.uniform(low, high, count))


MODES = 400  # with a damping ratio of their own, more than any robot has in a band


@dataclass(frozen=True, eq=False)
class Ringing:
    """Modes (c,) of a machine at one pose, by frequency.

    Attributes
    ----------
    modes
        Their masses and stiffnesses.
    twists
        Twists (6, c) of its nodes about the origin.
    frames
        Where these are.
    """

    modes: DenseModes
    twists: Mapping[str, Array]
    frames: Frames

    def respond(self, plan: HammerPlan, damping: Array) -> Complex:
        """Return the receptances (hits, motions, f) of a plan; see `strike`."""
        omega = 2.0 * np.pi * plan.hertz
        mass = self.modes.mass
        stiffness = self.modes.stiffness
        ratios = np.concatenate([damping, np.full(len(mass), damping[-1])])
        critical = 2.0 * np.sqrt((mass * stiffness).clip(min=0.0))
        loss = (ratios[: len(mass)] * critical)[:, None] * omega
        rigidity = stiffness[:, None] - mass[:, None] * omega**2
        moved = {
            name: (lever(self.frames.point(spot.node, spot.at)[0]) @ twist)[:3]
            for name, spot in plan.points.items()
            for twist in [self.twists[spot.node]]
        }
        hits, motions = (
            np.array([each.sign * moved[each.point][each.axis] for each in ends])
            for ends in (plan.hits, plan.motions)
        )
        return np.einsum(
            "hc,mc,cf->hmf", hits, motions, 1.0 / (rigidity + 1j * loss), optimize=True
        )


def ring(
    machine: Machine,
    located: Located,
    nodes: Iterable[str],
    about: float,
    points: Mapping[str, Spot] | None = None,
) -> Ringing:
    """Return the modes of a machine at one pose.

    Parameters
    ----------
    machine, located, points
        As for `DenseMachine`.
    nodes
        Nodes whose motions are of interest.
    about
        Frequency, Hz, of the size of the lowest mode.
    """
    dense = DenseMachine(machine, located, points)
    modes = dense.solve(about)
    twists = {node: dense.find_twist(modes, node) for node in nodes}
    return Ringing(modes, twists, dense.frames)


def find_gains(machine: Machine, plan: HammerPlan) -> Array:
    """Return the gains (motions, 1) of the channels of a plan."""
    gains = machine.response_gains
    each = [
        gains.get(HAMMER, 1.0)
        * gains.get(motion.point, 1.0)
        * gains.get(motion.channel, 1.0)
        for motion in plan.motions
    ]
    return np.array(each)[:, None]


def strike(
    machine: Machine, plan: HammerPlan, located: Located, damping: Array
) -> Complex:
    """Return the receptances (p, hits, motions, f) of a machine as measured, without noise.

    Parameters
    ----------
    machine, plan
        The machine with its faults, and the test.
    located
        The sound machine's configuration at the plan's poses.
    damping
        Damping ratios (c,) of the modes by frequency; the last one is that of all above.
    """
    nodes = {spot.node for spot in plan.points.values()}
    each = (
        ring(machine, located.some([k]), nodes, plan.about, plan.points)
        for k in range(len(plan.poses))
    )
    true = np.array([ringing.respond(plan, damping) for ringing in each])
    return find_gains(machine, plan) * true


def record(
    true: Complex, plan: HammerPlan, noise: HammerNoise, rng: np.random.Generator
) -> list[list[Response]]:
    """Return the measured responses at each pose, and the coherence of the hits behind them.

    Of n hits with responses H_k an analyser shows the mean, and as coherence
    ``γ² = |Σ H_k|² / (n Σ |H_k|²)`` (Bendat and Piersol, Random Data, 4th ed., Wiley 2010, section
    6.1), here of equal forces.

    Parameters
    ----------
    true
        Receptances (p, hits, motions, f).
    plan, noise
        The test, and its noise.
    rng
        Random generator of the noise.
    """
    n = plan.averages
    squares = (2.0 * np.pi * plan.hertz) ** 2
    out: list[list[Response]] = []
    for k, pose in enumerate(true):
        floor = noise.floor * np.sqrt(np.mean(np.abs(squares * pose) ** 2))
        variance = (noise.relative * np.abs(squares * pose)) ** 2 + floor**2
        parts = rng.standard_normal((2, n, *pose.shape))
        # of real and imaginary part of one of n hits
        scatter = np.sqrt(0.5 * n * variance) / squares
        each = pose + scatter * (parts[0] + 1j * parts[1])
        mean = each.mean(axis=0)
        coherence = np.abs(mean) ** 2 / np.mean(np.abs(each) ** 2, axis=0)
        out.append(
            [
                Response(
                    force=hit,
                    motion=motion,
                    frequency=plan.hertz,
                    receptance=mean[i, j],
                    coherence=coherence[i, j],
                    quantity="accelerance",
                    source=f"pose {k + 1}",
                )
                for i, hit in enumerate(plan.hits)
                for j, motion in enumerate(plan.motions)
            ]
        )
    return out


def write_responses(
    folder: Path,
    plan: HammerPlan,
    measured: Sequence[Sequence[Response]],
    *,
    robot: str,
    names: Mapping[str, Any],
    components: str,
    comment: str = "",
) -> None:
    """Write a campaign folder with a universal file for each pose.

    Parameters
    ----------
    folder
        Created if absent.
    plan, measured
        The test, and its responses at each pose.
    robot, components
        Header fields: nominal robot, source of its parts' matrices.
    names
        Name of each set-up and of its file, and its pose: a name or coordinates.
    comment
        Text above the header (default: none).
    """
    places = {name: spot.at for name, spot in plan.points.items()}
    points = {
        name: {"body": spot.node, "at": np.asarray(spot.at).tolist()}
        for name, spot in plan.points.items()
    }
    setups: dict[str, Any] = {}
    folder.mkdir(parents=True, exist_ok=True)
    for (name, pose), rows in zip(names.items(), measured, strict=True):
        title = "simulated hammer test"
        write_uff(folder / f"{name}.uff", rows, places, title)
        setups[name] = {
            "file": f"{name}.uff",
            "pose": pose,
            "averages": plan.averages,
            "points": points,
        }
    header = {"robot": robot, "components": components, "responses": setups}
    write_campaign(folder, header, {}, comment=comment)


def space_lines(low: float, high: float, count: int) -> Array:
    """Return evenly spaced lines (count,) about a band, Hz, with few digits."""
    step = float(f"{(high - low) / (count - 1):.2g}")
    start = float(f"{low:.3g}")
    return start + step * np.arange(count, dtype=np.float64)


def find_band(
    machine: Machine, plan: HammerPlan, located: Located, modes: int
) -> tuple[float, float, float]:
    """Return a band, Hz, up to some of the modes at every pose, and the lowest mode."""
    found = [
        DenseMachine(machine, located.some([k])).solve(plan.about).hertz
        for k in range(len(plan.poses))
    ]
    moving = [
        hertz[(hertz > 1e-3 * plan.about) & np.isfinite(hertz)] for hertz in found
    ]
    lowest = min(float(hertz[0]) for hertz in moving)
    highest = max(float(hertz[min(modes, len(hertz)) - 1]) for hertz in moving)
    return 0.4 * lowest, 1.15 * highest, lowest


def triaxial(point: str) -> tuple[Direction, ...]:
    """Return the directions of a triaxial accelerometer along the base axes."""
    return tuple(Direction(point, axis) for axis in range(3))
