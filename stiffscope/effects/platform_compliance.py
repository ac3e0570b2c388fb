"""What the robot carries at its tool yields."""

from __future__ import annotations

from dataclasses import dataclass

from stiffscope.effects.effect import Candidates, Place, Setting
from stiffscope.effects.support import Support
from stiffscope.vjm.checks import TOOL

_PLATFORM = "platform"  # the tool's place by the name of such a body


@dataclass(frozen=True)
class PlatformCompliance(Support):
    """Between the tool's body and M, at M."""

    word = "platform-compliance"
    precedence = 100

    @classmethod
    def candidates(cls, setting: Setting) -> Candidates:
        """At the tool."""
        others = (_PLATFORM,) if setting.robot.mechanism.tool.body == _PLATFORM else ()
        yield from cls.supports(setting, Place("tool", (TOOL,), others))
