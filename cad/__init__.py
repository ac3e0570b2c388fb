"""Parts: parametric solids (link, slider), solids from STEP files, materials, mass properties.

The modules below load the CAD kernel, which takes seconds; each is loaded on first use.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from stiffscope.runtime.collection import no_collection

if TYPE_CHECKING:
    from stiffscope.cad import drawing, kernel, kernel_files, validity

__all__ = ["drawing", "kernel", "kernel_files", "validity"]


def __getattr__(name: str) -> Any:
    """Load a module of the CAD kernel on first use."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    with no_collection():
        return import_module(f"{__name__}.{name}")
