"""The meshing subprocess: read a surface, run fTetWild, write tetrahedra.

Run as ``python -m stiffscope.fea.worker surface.npz tets.npz``. It stands alone because fTetWild can crash or
never end, and because it drops a file into the working folder: its parent gives it a folder and a time limit.
"""

import sys

import numpy as np

from stiffscope.runtime.children import end_with_parent, leave_out


def main(source: str, target: str) -> None:
    """Mesh the surface in ``source`` (keys: vertices, triangles, size, envelope, threads, energy) into ``target``."""
    leave_out("pytetwild._accessor")  # brings all of PyVista, twice the time of a small mesh
    from pytetwild.pytetwild import tetrahedralize

    with np.load(source, allow_pickle=False) as given:
        points, cells = tetrahedralize(
            given["vertices"],
            given["triangles"],
            edge_length_abs=float(given["size"]),
            epsilon=float(given["envelope"]),
            num_threads=int(given["threads"]),
            stop_energy=float(given["energy"]),
            vtk_ordering=True,
        )
    np.savez(target, points=points, cells=cells)


if __name__ == "__main__":
    end_with_parent()
    main(sys.argv[1], sys.argv[2])
