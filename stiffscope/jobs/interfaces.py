"""What a comparison of interfaces consists of: choices, what each gives, and what it changes entry by entry."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np

    from stiffscope.jobs.experiments import PartOrder


@dataclass(frozen=True)
class Choice:
    """A way to hold or load a part: its name, what it is in words, and the values of `--set` that choose it."""

    name: str
    words: str
    overrides: tuple[str, ...]


@dataclass(frozen=True)
class Tested:
    """A part's compliance (6, 6) under a choice, and its 95 % bounds; SI, at the own choice's reference point."""

    choice: Choice
    order: PartOrder
    compliance: np.ndarray
    error: np.ndarray


@dataclass(frozen=True)
class Entry:
    """An entry under the own choice (SI, with its bound), and what each other choice makes of it, relative."""

    name: str
    unit: str
    own: float
    error: float
    changes: tuple[float, ...]
    bars: tuple[float, ...]


@dataclass(frozen=True)
class Comparison:
    """A part under the choice of the robot file and under the others; why some are left out, a line each."""

    part: str
    own: Tested
    others: tuple[Tested, ...]
    entries: tuple[Entry, ...]
    left_out: tuple[str, ...]
