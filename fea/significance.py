"""Which entries of a compliance matrix are significant, and the largest relative error bound among them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from stiffscope.fea.mesh import Floats

SIGNIFICANT = 0.01  # of sqrt(C_ii C_jj): smaller entries are zeros of a symmetry, or nearly so


def largest_relative_bound(compliance: Floats, error: Floats) -> tuple[float, tuple[int, int]]:
    """Return the largest error over |C_ij| of the significant entries of (k, k) matrices, and its indices."""
    scale = np.sqrt(compliance.diagonal())
    size = np.abs(compliance)
    ratio = np.where(size > SIGNIFICANT * np.outer(scale, scale), error / np.maximum(size, 1e-300), 0.0)
    i, j = np.unravel_index(ratio.argmax(), ratio.shape)
    return float(ratio[i, j]), (int(i), int(j))
