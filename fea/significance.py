"""Significant entries of a compliance matrix, and the largest relative error bound among them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from stiffscope.fea.mesh import Floats

SIGNIFICANT = 0.01  # of sqrt(C_ii C_jj): smaller entries vanish by symmetry, or nearly so


def largest_relative_bound(compliance: Floats, error: Floats) -> tuple[float, tuple[int, int]]:
    """Return the largest relative error of significant entries of (k, k) matrices, and indices."""
    scale = np.sqrt(compliance.diagonal())
    size = np.abs(compliance)
    ratio = np.where(size > SIGNIFICANT * np.outer(scale, scale), error / np.maximum(size, 1e-300), 0.0)
    i, j = np.unravel_index(ratio.argmax(), ratio.shape)
    return float(ratio[i, j]), (int(i), int(j))
