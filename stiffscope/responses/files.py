"""Reading of a file of measured responses, whatever its format."""

from __future__ import annotations

from typing import TYPE_CHECKING

from stiffscope.responses.tables import read_response_table
from stiffscope.responses.uff import read_uff

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from stiffscope.responses.model import Quantity, ResponseFile
    from stiffscope.responses.tables import Channel

_UNIVERSAL = {".uff", ".unv", ".uf", ".58"}


def is_universal(path: Path) -> bool:
    """Whether a file is a universal file, which states by itself what it holds."""
    return path.suffix.lower() in _UNIVERSAL


def read_responses(
    path: Path,
    channels: Mapping[str, Channel],
    quantity: Quantity = "receptance",
    factor: float = 1.0,
) -> ResponseFile:
    """Read a universal file, or a table whose channels, quantity and unit are stated.

    Parameters
    ----------
    path
        The file.
    channels, quantity, factor
        Of a table, as for `read_response_table`; not used for a universal file.

    Raises
    ------
    InputError
        The file cannot be read.
    """
    if is_universal(path):
        return read_uff(path)
    return read_response_table(path, channels, quantity, factor)
