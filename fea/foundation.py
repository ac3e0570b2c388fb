"""Elastic (Winkler) foundation under the clamp, equally stiff in all directions: a bolted contact.

Springs of k N/m³ per area hold the clamped faces, with energy ½ ∫ k |u|² dA. Machined steel faces
pressed together by some MPa have 1e12 to 1e13 N/m³ (1,000 to 10,000 N/mm³; 3.5 to 8.8 MPa/µm were
measured at 6.3 MPa, rougher faces being softer). 20 mm of steel have 1.06e13 N/m³.

References
----------
L. Zhu, J. Chen, Z. Zhang, J. Hong, Normal contact stiffness model considering 3D surface topography
and actual contact status, Mech. Sci. 12 (2021) 41, doi:10.5194/ms-12-41-2021, for models and
measurements of such contacts.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from scipy.sparse import block_array, csr_array, eye_array, kron
from skfem import BilinearForm, ElementTetP2

from stiffscope.fea.spaces import ElementTetCubic, face_basis

if TYPE_CHECKING:
    from stiffscope.fea.mesh import TetMesh

ORDER = 6  # quadrature: exact for cubics on flat faces
_MASS = BilinearForm(lambda u, v, _: u * v)


def springs(mesh: TetMesh, faces: frozenset[int], modulus: float) -> csr_array:
    """Return the foundation stiffness (count, count), N/m, of one direction; nodes, then cubics.

    Parameters
    ----------
    faces : CAD faces on the foundation.
    modulus : stiffness per unit of area, N/m³.
    """
    elements = ElementTetP2(), ElementTetCubic()
    bases = [face_basis(mesh, element, faces, ORDER) for element in elements]
    return csr_array(
        modulus * block_array([[_MASS.assemble(u, v) for u in bases] for v in bases])
    )


def on_nodes(stiffness: csr_array, nodes: int) -> csr_array:
    """Return the part (3 nodes, 3 nodes) of a foundation's stiffness on the mesh's nodes."""
    return csr_array(kron(stiffness[:nodes, :nodes], eye_array(3)))
