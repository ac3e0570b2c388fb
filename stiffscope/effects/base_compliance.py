"""What the robot stands on yields."""

from __future__ import annotations

from dataclasses import dataclass

from stiffscope.effects.effect import Candidates, Place, Setting
from stiffscope.effects.support import Support
from stiffscope.vjm.checks import BASE


@dataclass(frozen=True)
class BaseCompliance(Support):
    """Between the ground and all that stands on it, at the origin."""

    word = "base-compliance"
    precedence = 90

    @classmethod
    def candidates(cls, setting: Setting) -> Candidates:
        """At the base."""
        yield from cls.supports(setting, Place("base", (BASE,)))
