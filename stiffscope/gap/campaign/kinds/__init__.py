"""Kinds of readings: one object a kind with all its facts, and their tables by code.

A quantity's code is its index into `QUANTITY`; a kind's number is its index into `KINDS`. Whoever
wants a fact of many readings asks a table of `by_code` with their codes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from stiffscope.gap.campaign.kinds.frequencies import FREQUENCY
from stiffscope.gap.campaign.kinds.kind import AXES, Kind
from stiffscope.gap.campaign.kinds.motions import DEFLECTION, DEVIATION, POSITION
from stiffscope.gap.campaign.kinds.responses import RESPONSE
from stiffscope.gap.campaign.kinds.stiffnesses import PUSH, STIFFNESS

if TYPE_CHECKING:
    from collections.abc import Callable

    from stiffscope.runtime.types import Array, Flags, Indices

KINDS: tuple[Kind, ...] = (
    DEFLECTION,
    DEVIATION,
    STIFFNESS,
    PUSH,
    FREQUENCY,
    POSITION,
    RESPONSE,
)
"""All kinds. A new one is appended here, after a module of its own says what it is."""

QUANTITY = tuple(quantity for kind in KINDS for quantity in kind.quantities)
_LENGTHS = [len(kind.quantities) for kind in KINDS]
KIND_OF: Indices = np.repeat(np.arange(len(KINDS)), _LENGTHS)
"""Number of the kind by code."""
DIRECTION_OF: Indices = np.array([quantity.direction for quantity in QUANTITY])
MODE_OF: Indices = np.array([quantity.mode for quantity in QUANTITY])
SPARE_MODES_OF: Indices = np.array([kind.spare_modes for kind in KINDS])[KIND_OF]
"""Modes to compute above the highest one read, by code."""
NAMED: Indices = np.flatnonzero([quantity.name != "" for quantity in QUANTITY])
"""Codes of the quantities that have a name."""
INSTRUMENTS = tuple(dict.fromkeys(kind.instrument for kind in KINDS if kind.instrument))
"""Instruments that are neither sensors nor axes at M."""


def by_code(fact: Callable[[Kind], bool]) -> Flags:
    """Return the flags (codes,) of quantities whose kind has a fact."""
    return np.array([fact(kind) for kind in KINDS], dtype=np.bool_)[KIND_OF]


def numbers_by_code(fact: Callable[[Kind], float]) -> Array:
    """Return the numbers (codes,) that their kinds say of quantities."""
    return np.array([fact(kind) for kind in KINDS], dtype=np.float64)[KIND_OF]


def _number_channels() -> Indices:
    numbers = {name: len(AXES) + k for k, name in enumerate(INSTRUMENTS)}
    channels = [numbers.get(kind.instrument, -1) for kind in KINDS]
    plain = np.array(channels)[KIND_OF]
    return np.where(plain < 0, DIRECTION_OF, plain)


CHANNEL_OF = _number_channels()
"""Index into the axes at M and `INSTRUMENTS` by code."""


def _number_groups() -> Indices:
    groups = list(dict.fromkeys(kind.noise_group for kind in KINDS))
    return np.array([groups.index(kind.noise_group) for kind in KINDS])[KIND_OF]


NOISE_GROUP_OF = _number_groups()
"""Number of the group of noise by code."""


def _number_units() -> Indices:
    names = [
        "" if kind.is_relative else kind.unit(turns=quantity.direction >= 3)
        for kind in KINDS
        for quantity in kind.quantities
    ]
    known = list(dict.fromkeys(names))
    return np.array([known.index(name) for name in names])


UNIT_OF = _number_units()
"""Number of the unit of its noise by code; one for all whose errors are relative."""


def _find_codes() -> Indices:
    out = np.full((len(KINDS), len(AXES)), -1)
    for code in reversed(range(len(QUANTITY))):  # the first of a direction stays
        out[KIND_OF[code], DIRECTION_OF[code]] = code
    return out


CODE_ALONG = _find_codes()
"""Code (kinds, 6) of a kind's (first) quantity along an axis; -1 if there is none."""


def number_of(kind: Kind) -> int:
    """Return a kind's number."""
    return KINDS.index(kind)
