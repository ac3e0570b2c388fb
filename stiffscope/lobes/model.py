"""Section [lobes] of a job, and the stability of its cut."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import Field, field_validator

from stiffscope.path.values import Turns
from stiffscope.robot.file import quantities as q
from stiffscope.robot.file import values as v
from stiffscope.robot.file.values import Reads, Says, Section

if TYPE_CHECKING:
    from stiffscope.lobes.engagement import Engagement
    from stiffscope.lobes.limits import Limits
    from stiffscope.path.job import Job
    from stiffscope.runtime.types import Array, Flags, Indices
    from stiffscope.vjm.kinematics.configurations import Configurations

_DAMPING = q.Dimension("a damping ratio", "", "0.03", 1e-5, 0.7)
_DOUBT = q.Dimension("a share", "", "30 %", 0.0, 0.99)
_SAYS = 'a ratio such as 0.03, a list of one a mode, or "measured"'
_TIP = 'the tip\'s point and axis in the file, such as "1:+x"'
_TWO = 'two rotational speeds such as ["2000 rpm", "9000 rpm"]'


def _read_damping(value: Any) -> Any:
    if value == "measured":
        return value
    try:
        if isinstance(value, list) and value:
            return tuple(q.to_si(each, _DAMPING) for each in value)
        return q.to_si(value, _DAMPING)
    except ValueError as error:
        raise ValueError(f"{error}; {_SAYS}") from error


Damping = Annotated[
    float | tuple[float, ...] | Literal["measured"], Reads(_read_damping, says=_SAYS)
]
Ratio = Annotated[
    float, Reads(lambda value: q.to_si(value, _DAMPING), says="a ratio such as 0.02")
]
Doubt = Annotated[
    float,
    Reads(
        lambda value: q.to_si(value, _DOUBT, sign="non-negative"),
        says='a share such as "30 %"',
    ),
]


class HolderSection(Section):
    """A mode of the tool in its holder, clamped at the robot's flange, as felt at the tip."""

    frequency: v.Frequency
    stiffness: v.Stiffness
    damping: Ratio
    direction: Annotated[
        Literal["radial", "feed", "normal", "axial"],
        Says("radial: the same along feed and normal"),
    ] = "radial"


class ResponsesSection(Section):
    """Responses of the tool in its holder, clamped at the robot's flange, to forces at its tip."""

    file: Annotated[str, Says("a universal file, or a table of responses")]
    feed: Annotated[str | None, Says(_TIP)] = None
    normal: Annotated[str | None, Says(_TIP)] = None
    axial: Annotated[str | None, Says(_TIP)] = None
    radial: Annotated[str | None, Says(f"{_TIP}; the same along feed and normal")] = (
        None
    )
    channels: Annotated[
        dict[str, str], Says('of a table: H = "1:+x", or motion and force "1:+x/1:+x"')
    ] = Field(default_factory=dict)
    quantity: Literal["receptance", "mobility", "accelerance"] | None = None
    unit: Annotated[str | None, Says('of a table: "um/N"; by default SI')] = None


class LobesSection(Section):
    """What the stability of a cut needs besides the job's process."""

    damping: Damping
    damping_error: Annotated[Doubt, Says("95 % bound of the damping ratios")] = 0.3
    kt_error: Annotated[Doubt, Says("95 % bound of the cutting force")] = 0.0
    measured: Annotated[
        str | None,
        Says(
            'with damping = "measured": a table with the columns frequency (Hz), zeta, '
            "or the folder of a hammer campaign, whose modes are paired by shape"
        ),
    ] = None
    speeds: Annotated[tuple[Turns, Turns] | None, Says(_TWO)] = None
    points: Annotated[v.Positive, Says("how many speeds")] = 400
    poses: Annotated[tuple[str, ...], Says("names; else along the path")] = ()
    method: Literal["auto", "zero-order", "all-harmonics"] = "auto"
    holder: tuple[HolderSection, ...] = ()
    responses: ResponsesSection | None = None

    @field_validator("speeds")
    @classmethod
    def _rising(cls, value: tuple[float, float] | None) -> tuple[float, float] | None:
        if value is not None and not value[0] < value[1]:
            raise ValueError(f"expected a lower and a higher speed: {_TWO}")
        return value

    @field_validator("points")
    @classmethod
    def _several(cls, value: int) -> int:
        if not 2 <= value <= 20_000:
            raise ValueError(f"expected 2 to 20000 speeds, got {value}")
        return value


SECTIONS = (
    ("[lobes]", LobesSection),
    ("[[lobes.holder]]", HolderSection),
    ("[lobes.responses]", ResponsesSection),
)


@dataclass(frozen=True, eq=False)
class Cutting:
    """A job's cut as the stability sees it.

    Attributes
    ----------
    cut
        Engagement of the cutter.
    speed, depth
        Spindle speed, rev/s, and depth of cut, m, of the job.
    chip
        Mean chip thickness, m, at which the cutting force is linearized.
    """

    cut: Engagement
    speed: float
    depth: float
    chip: float


@dataclass(frozen=True, eq=False)
class Stability:
    """Limits of the depth of cut at n poses, for any speed and for the job's.

    Attributes
    ----------
    tool
        Tool poses (n, 6), m and rotation vectors.
    critical
        Limits at the worst speed of the range.
    critical_error
        95 % half width (n,) of ln(critical depth).
    limit, limit_error
        Depth (n,), m, that is stable at the job's speed, and 95 % half width of its logarithm.
    coupling
        Depth (n,), m, from which the modes alone are unstable, without a wave left by the tooth
        before; infinite without such.
    mode
        Frequency (n,), Hz, of the mode that limits.
    shares
        Share (n,) of each element in the strain energy of that mode, by name.
    """

    tool: Array
    critical: Limits
    critical_error: Array
    limit: Array
    limit_error: Array
    coupling: Array
    mode: Array
    shares: dict[str, Array]

    @property
    def chatter(self) -> Array:
        """Frequency (n,) of chatter at the critical depth, Hz."""
        return self.critical.omega / (2.0 * np.pi)

    @property
    def critical_low(self) -> Array:
        """Lower end (n,) of the critical depth's 95 % band, m."""
        return self.critical.depth * np.exp(-self.critical_error)

    @property
    def critical_high(self) -> Array:
        """Upper end (n,) of the critical depth's 95 % band, m."""
        return self.critical.depth * np.exp(self.critical_error)


@dataclass(frozen=True, eq=False)
class Lever:
    """Effect of a stiffer or lighter element on the limit that holds at any speed.

    Attributes
    ----------
    element
        Name of a drive's joint, a bearing's joint or a body.
    per_cent
        Change of the limit, in per cent, for 1 % more stiffness.
    per_kilogram
        Relative change of the limit for a kilogram more of an elastic body, whose stiffness grows
        with its mass; NaN for others.
    """

    element: str
    per_cent: float
    per_kilogram: float


@dataclass(frozen=True, eq=False)
class Lobes:
    """Stability of a job's cut.

    Attributes
    ----------
    job, cutting
        Job, and its cut.
    method
        "zero-order" or "all-harmonics".
    names, found
        Names (n,) of the poses of the lobes, and configurations.
    at
        Limits at these poses.
    speeds
        Spindle speeds (s,), rev/s.
    depth, low, high
        Stable depth (n, s), m, with its 95 % band; infinite without a limit.
    levers
        Elements in order of their effect at the worst pose.
    advised
        Speeds (k,), rev/s, at which the lower ends over all poses are highest.
    advised_depth
        Depth (k,), m, that is stable there at all poses with the lower ends.
    along
        Limits at points of the path.
    points, length
        Their indices in the path, and lengths (p,) from its start, m.
    """

    job: Job
    cutting: Cutting
    method: str
    names: tuple[str, ...]
    found: Configurations
    at: Stability
    speeds: Array
    depth: Array
    low: Array
    high: Array
    levers: tuple[Lever, ...]
    advised: Array
    advised_depth: Array
    along: Stability
    points: Indices
    length: Array

    @property
    def worst(self) -> int:
        """Index of the pose with the least critical depth."""
        return int(np.argmin(self.at.critical.depth))

    @property
    def worst_point(self) -> int:
        """Index among the path's points of the least depth at the job's speed."""
        return int(np.argmin(self.along.limit))

    @property
    def margin(self) -> Array:
        """Stable depth over the job's depth (p,), along the path."""
        return self.along.limit / self.cutting.depth

    @property
    def stable(self) -> Flags:
        """Whether the job's cut is stable (p,) along the path."""
        return self.margin > 1.0
