"""Common types."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating[Any]]
Complex = NDArray[np.complexfloating[Any, Any]]
Flags = NDArray[np.bool_]
Indices = NDArray[np.int64]
Progress = Callable[[str, float], None]
"""Progress callback, called with the name of a stage and its completed fraction."""
