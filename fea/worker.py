"""What is done in a process of its own: fTetWild can crash or never end, and drops a file into its working folder."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytetwild

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Ints = NDArray[np.int64]


def run_ftetwild(
    vertices: Floats, triangles: Ints, size: float, envelope: float, threads: int, energy: float
) -> tuple[Floats, Ints]:
    """Mesh a surface: points (n, 3) in the unit of its vertices and cells (m, 4).

    Parameters
    ----------
    vertices, triangles
        (k, 3) and (l, 3) of a watertight surface.
    size
        Target edge length.
    envelope
        Allowed distance to the surface, over the diagonal of its bounding box.
    threads
        Of the mesher.
    energy
        Of the most distorted element that may remain.

    """
    points, cells = pytetwild.tetrahedralize(  # pyright: ignore[reportPrivateImportUsage]
        vertices, triangles.astype(np.int32), edge_length_abs=size, epsilon=envelope, num_threads=threads,
        stop_energy=energy, vtk_ordering=True,
    )  # fmt: skip
    return points, cells.astype(np.int64)
