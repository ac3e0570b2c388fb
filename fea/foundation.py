"""An elastic foundation under the clamp: a bolted contact gives way, in every direction alike.

The clamped faces are then held by springs, k N/m³ per unit of area: their energy is half of ∫ k |u|² dA.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from stiffscope.fea.cubic import facet_cubics
from stiffscope.fea.shape import area_elements, facet_rule, facet_values

if TYPE_CHECKING:
    from scipy.sparse import csr_array

    from stiffscope.fea.cubic import Cubic
    from stiffscope.fea.mesh import Floats, Ints

ORDER = 6


def bed(points: Floats, facets: Ints, space: Cubic, modulus: float) -> csr_array:
    """Return the (count, count) stiffness (N/m) of the foundation for one direction, in the enlarged space.

    Parameters
    ----------
    facets : (k, 6) boundary triangles that rest on it.
    modulus : stiffness per unit of area, N/m³.
    """
    from scipy.sparse import csr_array

    at, _ = facet_rule(ORDER)
    area = area_elements(points[facets], ORDER)
    functions, values = facet_cubics(space, facets, at)
    nodal = np.broadcast_to(facet_values(at), (len(facets), len(at), 6))
    shape = np.concatenate([nodal, values], axis=2)  # (k, q, 10)
    names = np.hstack([facets, functions])
    blocks = modulus * np.einsum("kq,kqa,kqb->kab", area, shape, shape)
    rows, columns = np.broadcast_arrays(names[:, :, None], names[:, None, :])
    return csr_array((blocks.reshape(-1), (rows.reshape(-1), columns.reshape(-1))), shape=(space.count,) * 2)


def on_nodes(springs: csr_array, base: int) -> csr_array:
    """Return the (3 base, 3 base) part of the foundation's stiffness that the mesh's nodes feel."""
    from scipy.sparse import csr_array, eye_array, kron

    return csr_array(kron(springs[:base, :base], eye_array(3)))
