"""Compliance of the platform at the tool."""

from __future__ import annotations

from dataclasses import dataclass

from stiffscope.effects.effect import Candidates, Place, Setting
from stiffscope.effects.support import Support
from stiffscope.vjm.checks import TOOL

_PLATFORM = "platform"  # alias of the tool's place if its body has this name


@dataclass(frozen=True)
class PlatformCompliance(Support):
    """Elastic support between the tool's body and M, at M."""

    word = "platform-compliance"
    precedence = 100

    @classmethod
    def candidates(cls, setting: Setting) -> Candidates:
        """Yield candidates at the tool."""
        others = (_PLATFORM,) if setting.robot.mechanism.tool.body == _PLATFORM else ()
        yield from cls.supports(setting, Place("tool", (TOOL,), others))
