"""Pause of the garbage collection while large libraries are imported."""

from __future__ import annotations

import gc
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator


@contextmanager
def no_collection() -> Iterator[None]:
    """Pause the collection of cyclic garbage, and leave what is made meanwhile to later ones.

    The CAD kernel's import makes half a million objects, none of them garbage; to search them over
    and over takes a tenth to a third of its time, and some of any import's.
    """
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()
