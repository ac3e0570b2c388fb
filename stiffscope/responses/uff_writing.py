"""Writing of universal files: units (164), nodes (15), responses and coherences (58b).

References
----------
University of Cincinnati SDRL, Universal File Formats for Modal Analysis Testing, datasets 15, 58b
and 164.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from stiffscope.errors import require
from stiffscope.responses.blocks import ASCII_LINES
from stiffscope.responses.model import DERIVATIVES
from stiffscope.responses.uff import (
    COHERENCE,
    FREQUENCY,
    FREQUENCY_RESPONSE,
    QUANTITIES,
)
from stiffscope.responses.units import MOTIONS

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from stiffscope.responses.model import Direction, Response
    from stiffscope.runtime.types import Array

_CODES = {
    quantity: (code, MOTIONS[quantity][0]) for code, quantity in QUANTITIES.items()
}
_FORCE = 13, "N"
_HERTZ = FREQUENCY, "Hz"
_NOTHING = 0, "NONE"
_EVEN = 1e-6  # relative to the spacing, by which even lines may deviate
_DIGITS = 1e-5  # of the numbers in a header


def write_uff(
    path: Path,
    responses: Sequence[Response],
    points: Mapping[str, Array],
    title: str = "",
) -> None:
    """Write responses at evenly spaced lines, and their coherences, in single precision.

    Parameters
    ----------
    path
        File to write.
    responses
        Responses of forces and translations; each is written as the quantity that it was read in.
    points
        Place (3,) of each point, m; names are numbers of nodes.
    title
        First line of each dataset.

    Raises
    ------
    InputError
        Lines are not evenly spaced, or have more digits than the header of a dataset.
    """
    blocks = [_units(), _nodes(points)]
    for response in responses:
        blocks.append(_function(FREQUENCY_RESPONSE, response, title))
        if response.coherence is not None:
            blocks.append(_function(COHERENCE, response, title))
    path.write_bytes(b"".join(blocks))


def _frame(lines: Sequence[str], data: bytes = b"") -> bytes:
    """Return a dataset between its delimiters."""
    text = "".join(f"{line}\n" for line in ("    -1", *lines)).encode("ascii")
    return text + data + (b"\n" if data else b"") + b"    -1\n"


def _units() -> bytes:
    """Return dataset 164: SI, absolute temperatures."""
    factors = "".join(f"{1.0:25.17E}" for _ in range(3))
    return _frame(
        [
            "   164",
            f"{1:10d}{'SI: Meter (newton)':>20}{2:10d}",
            factors,
            f"{0.0:25.17E}",
        ]
    )


def _nodes(points: Mapping[str, Array]) -> bytes:
    rows = [
        f"{int(name):10d}{0:10d}{0:10d}{0:10d}" + "".join(f"{x:13.5E}" for x in place)
        for name, place in points.items()
    ]
    return _frame(["    15", *rows])


def _function(kind: int, response: Response, title: str) -> bytes:
    """Return a dataset 58b: a response in its own quantity, or its coherence."""
    is_response = kind == FREQUENCY_RESPONSE
    hertz = response.frequency
    start, step = _find_spacing(hertz, response.source)
    if is_response:
        rate = (2j * np.pi * hertz) ** DERIVATIVES[response.quantity]
        data = (rate * response.receptance).astype("<c8").tobytes()
        ordinate = _CODES[response.quantity], _FORCE
    else:
        data = np.asarray(response.coherence, dtype="<f4").tobytes()
        ordinate = _NOTHING, _NOTHING
    form = 5 if is_response else 2  # complex or real, single precision
    ends = f"{_end(response.motion)}{_end(response.force)}"
    axes = (_HERTZ, *ordinate, _NOTHING)
    header = [
        f"    58b{1:6d}{2:6d}{ASCII_LINES:12d}{len(data):12d}{0:6d}{0:6d}{0:12d}{0:12d}",
        title[:80] or "NONE",
        *["NONE"] * 4,
        f"{kind:5d}{0:10d}{0:5d}{0:10d}{ends}",
        f"{form:10d}{len(hertz):10d}{1:10d}{start:13.5E}{step:13.5E}{0.0:13.5E}",
        *(
            f"{code:10d}{0:5d}{0:5d}{0:5d} {'NONE':20} {label:20}"
            for code, label in axes
        ),
    ]
    return _frame(header, data)


def _end(direction: Direction) -> str:
    way = direction.sign * (direction.axis + 1)
    return f" {'NONE':10}{int(direction.point):10d}{way:4d}"


def _find_spacing(hertz: Array, source: str) -> tuple[float, float]:
    """Return the first line and the spacing, as a header prints them."""
    start = float(f"{hertz[0]:.5E}")
    step = float(f"{(hertz[-1] - hertz[0]) / max(len(hertz) - 1, 1):.5E}")
    even = start + step * np.arange(len(hertz))
    what = "evenly spaced lines whose first and spacing have six digits"
    off = float(np.abs(even - hertz).max())
    valid = off <= max(_EVEN * step, _DIGITS * _EVEN * hertz[-1])
    require(valid, source, what, f"one {off:.2g} Hz beside")
    return start, step
