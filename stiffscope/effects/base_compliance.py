"""Compliance of the robot's foundation."""

from __future__ import annotations

from dataclasses import dataclass

from stiffscope.effects.effect import Candidates, Place, Setting
from stiffscope.effects.support import Support
from stiffscope.vjm.checks import BASE


@dataclass(frozen=True)
class BaseCompliance(Support):
    """Elastic support between the ground and everything mounted on it, at the origin."""

    word = "base-compliance"
    precedence = 90

    @classmethod
    def candidates(cls, setting: Setting) -> Candidates:
        """Yield candidates at the base."""
        yield from cls.supports(setting, Place("base", (BASE,)))
