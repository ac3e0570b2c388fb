"""Nastran bulk data of a superelement: grid points, scalar points for modes, matrices (DMIG)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from stiffscope.fea.mesh import Floats

FIRST_SCALAR = 1001


def dmig_text(stiffness: Floats, mass: Floats, nodes: Floats, comment: str = "") -> str:
    """Return bulk data of KPART and MPART: real, double precision, symmetric, large fields.

    Parameters
    ----------
    stiffness, mass : (6m + k, 6m + k) for six components of m nodes, then for k modes.
    nodes : (m, 3) m; grid points 1 to m. Modes are scalar points from ``FIRST_SCALAR``.
    """
    lines = [f"$ {line}" for line in comment.splitlines()]
    for number, node in enumerate(nodes, start=1):
        x, y, z = (f"{value:16.9E}" for value in node)
        lines += [f"GRID*   {number:16d}{'':16}{x}{y}", f"*       {z}"]
    count = len(stiffness) - 6 * len(nodes)
    lines += [f"SPOINT  {FIRST_SCALAR + k:8d}" for k in range(count)]
    places = [(number, component) for number in range(1, len(nodes) + 1) for component in range(1, 7)]
    places += [(FIRST_SCALAR + k, 0) for k in range(count)]
    for name, matrix in (("KPART", stiffness), ("MPART", mass)):
        lines.append(f"DMIG    {name:8}{0:8d}{6:8d}{2:8d}{0:8d}")  # symmetric, double precision
        for column, (point, component) in enumerate(places):
            rows = [row for row in np.flatnonzero(matrix[:, column]) if row >= column]
            if not rows:
                continue
            lines.append(f"DMIG*   {name:16}{point:16d}{component:16d}")
            for row in rows:
                lines.append(f"*       {places[row][0]:16d}{places[row][1]:16d}{matrix[row, column]:16.9E}")
    return "\n".join(lines) + "\n"
