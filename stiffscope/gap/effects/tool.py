"""The tool point elsewhere than the robot file states."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.gap.effects.effect import Array, Candidates, Parameter, Place, Setting
from stiffscope.gap.effects.elements import ElementEffect
from stiffscope.vjm.model.checks import TOOL
from stiffscope.vjm.model.mechanism import Change

if TYPE_CHECKING:
    from stiffscope.gap.effects.effect import Changes


@dataclass(frozen=True)
class ToolOffset(ElementEffect):
    """The tool point M, where loads act and motions are read, is elsewhere on its body.

    The tool may also be mounted at an angle, which only readings of rotations show.
    """

    word = "tool-offset"
    precedence = 105
    parameters = (
        *(Parameter(name, "m", 0.02, -0.5, 0.5) for name in "xyz"),
        *(Parameter(name, "rad", 0.01, -0.2, 0.2) for name in ("rx", "ry", "rz")),
    )

    @classmethod
    def candidates(cls, setting: Setting) -> Candidates:
        """Yield a shift of the tool point, and one with a rotation where rotations are read."""
        if not setting.tool_is_used:
            return
        known = setting.in_robots_units(cls.parameters)
        effect = cls(_shift_tool)
        place = Place("tool", (TOOL,))
        yield effect.make_candidate(place, known[:3])
        if setting.tool_turns:
            yield effect.make_candidate(place, known, groups=(3, 3))


def _shift_tool(values: Array) -> Changes:
    """Return the change for shifts (3,), and rotations (6,), in axes that ride on the tool."""
    twist = np.zeros(6)
    twist[: len(values)] = values
    return {TOOL: Change(offset=twist)}
