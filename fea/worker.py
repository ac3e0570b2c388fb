"""Work in a separate process: fTetWild may crash, hang, and writes a file to its working folder."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Ints = NDArray[np.int64]


def run_ftetwild(
    vertices: Floats, triangles: Ints, size: float, envelope: float, threads: int, energy: float
) -> tuple[Floats, Ints]:
    """Mesh a surface: points (n, 3) in units of its vertices, and cells (m, 4).

    Parameters
    ----------
    vertices, triangles
        (k, 3) and (l, 3) of a watertight surface.
    size
        Target edge length.
    envelope
        Allowed distance to the surface over its bounding box diagonal.
    threads
        Threads of the mesher.
    energy
        Largest distortion energy of an element.
    """
    import pytetwild

    points, cells = pytetwild.tetrahedralize(  # pyright: ignore[reportPrivateImportUsage]
        vertices, triangles.astype(np.int32), edge_length_abs=size, epsilon=envelope, num_threads=threads,
        stop_energy=energy, vtk_ordering=True,
    )  # fmt: skip
    return points, cells.astype(np.int64)
