"""An elastic (Winkler) foundation under the clamp: the contact of a bolted joint, equally stiff in all directions.

The clamped faces are held by springs of k N/m³ per unit of area, whose energy is ½ ∫ k |u|² dA. Machined steel faces
pressed together by some MPa have 1e12 to 1e13 N/m³ (1,000 to 10,000 N/mm³; 3.5 to 8.8 MPa/µm were measured at 6.3 MPa,
the rougher face being the softer). A steel layer of 20 mm is as stiff as the upper end: 1.06e13 N/m³.

References
----------
L. Zhu, J. Chen, Z. Zhang, J. Hong, Normal contact stiffness model considering 3D surface topography and actual contact
status, Mech. Sci. 12 (2021) 41, doi:10.5194/ms-12-41-2021, for models and measurements of such contacts.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from scipy.sparse import block_array, csr_array, eye_array, kron
from skfem import BilinearForm, ElementTetP2

from stiffscope.fea.spaces import ElementTetCubic, face_basis

if TYPE_CHECKING:
    from stiffscope.fea.mesh import TetMesh

ORDER = 6  # of quadrature: exact for cubics on flat faces
_MASS = BilinearForm(lambda u, v, _: u * v)


def springs(mesh: TetMesh, faces: frozenset[int], modulus: float) -> csr_array:
    """Return the (count, count) stiffness (N/m) of a foundation for one direction, nodes first, then cubics.

    Parameters
    ----------
    faces : CAD faces that rest on it.
    modulus : stiffness per unit of area, N/m³.
    """
    bases = [face_basis(mesh, element, faces, ORDER) for element in (ElementTetP2(), ElementTetCubic())]
    return csr_array(modulus * block_array([[_MASS.assemble(u, v) for u in bases] for v in bases]))


def on_nodes(stiffness: csr_array, nodes: int) -> csr_array:
    """Return the (3 nodes, 3 nodes) part of a foundation's stiffness that acts on the mesh's nodes."""
    return csr_array(kron(stiffness[:nodes, :nodes], eye_array(3)))
