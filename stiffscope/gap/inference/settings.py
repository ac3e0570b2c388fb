"""Constants of the verdict: value, unit and reason of each."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class VerdictSettings:
    """When an effect is certain, and when a search identifies one."""

    majority: float = 0.5
    """Probability: least of no gap, and of known effects in a group."""
    few: int = 3
    """Readings per parameter: fewer identify nothing."""
    possible: float = 0.02
    """Probability: least of an effect listed as possible."""
    mentioned: int = 3
    """Patterns: most mentioned as substitutes of an effect."""
    explains: float = 0.05
    """Part of the gap beyond the noise: an effect whose share of what all explain is less is not
    certain, whatever its probability. Errors of a model are of this size."""
    unlisted: float = 0.5
    """Probability: of a cause outside the vocabulary once no known effect explains the gap."""
    alike: float = 4.0
    """χ²: two standard deviations, within which two causes fit the readings alike."""
    listed: int = 6
    """Effects: most of a group that readings cannot tell apart; beyond, the group says nothing."""


VERDICT = VerdictSettings()
