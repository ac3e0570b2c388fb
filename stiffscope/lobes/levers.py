"""Which element raises the stable depth most: first-order changes of the limit at any speed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from stiffscope.lobes.model import Lever
from stiffscope.vjm.vibration.modes import modes, strain_products

if TYPE_CHECKING:
    from stiffscope.lobes.engagement import Engagement
    from stiffscope.lobes.response import ToolResponse
    from stiffscope.lobes.zero_order import Critical
    from stiffscope.runtime.types import Array, Complex, Indices
    from stiffscope.vjm.kinematics.configurations import Configurations
    from stiffscope.vjm.model.mechanism import Mechanism

_EVERY = (
    60  # modes: their superposition has the static response, so that little is left out
)
_PER_CENT = 0.01


def find_levers(
    mechanism: Mechanism,
    found: Configurations,
    response: ToolResponse,
    cut: Engagement,
    axes: Array,
    critical: Critical,
) -> tuple[Lever, ...]:
    """Return the effect of each element's stiffness and of each elastic body's size.

    With ``E`` the products of an element's strains in the modes, a relative change e of its
    stiffness changes the receptance by ``-e Σ φ_k H_k E_kl H_l φ_lᵀ``, and the depth by the change
    of the eigenvalue, at the frequency of chatter, where the limit is stationary.

    Parameters
    ----------
    mechanism, found
        Mechanism, and one configuration.
    response
        Response of the tool there, of which damping is taken.
    cut, axes
        Engagement, and axes (3, 3) of the cut.
    critical
        Limit of the cut there.
    """
    shaken = modes(mechanism, found, _EVERY)
    known = np.isfinite(shaken.frequencies[0])
    rates = 2.0 * np.pi * shaken.frequencies[0][known]
    shapes = axes @ shaken.tool[0, :3][:, known]
    omega = float(critical.omega[0])
    last = response.damping.shape[1] - 1
    order = np.minimum(np.arange(len(rates)), last)
    ratio = response.damping[0][order]
    d = 2 if cut.planar else 3
    modal = 1.0 / (rates**2 - omega**2 + 2j * ratio * rates * omega)
    looped = response.receptance(critical.omega[:, None])[0, 0] @ cut.mean
    values: Complex
    values, right = np.linalg.eig(looped[:d, :d])
    best = int(values.real.argmax())
    left = np.linalg.inv(right)[best]
    seen = (left @ shapes[:d]) * modal
    loaded = (shapes.T @ (cut.mean[:, :d] @ right[:, best])) * modal
    value = values[best]
    friction = 1.0 + 1j * ratio * omega / rates  # damping ratios stay as they are
    products = strain_products(mechanism, found, _EVERY)
    moved = _moving_masses(mechanism, shaken.shapes, known)
    levers = list[Lever]()
    for name, product in products.items():
        strained = product[0][np.ix_(known, known)].astype(complex)
        strained[np.diag_indices(len(rates))] *= friction
        softer = -(seen @ strained @ loaded) / value
        stiffer = float(critical.relative_change(np.array([softer]))[0])
        heavier = np.nan
        if name in moved:
            mass, coupled = moved[name]
            inertia = np.array([omega**2 * (seen @ coupled @ loaded) / value])
            heavier = (stiffer + float(critical.relative_change(inertia)[0])) / mass
        levers.append(Lever(name, stiffer, heavier))
    levers.sort(key=lambda lever: -lever.per_cent)
    return tuple(levers)


def _moving_masses(
    mechanism: Mechanism, shapes: dict[str, Array], known: Indices
) -> dict[str, tuple[float, Array]]:
    """Return mass, kg, and products (m, m) of the inertia in the modes, of elastic bodies.

    The inertia is taken as half the mass at either end.
    """
    out: dict[str, tuple[float, Array]] = {}
    for body in mechanism.bodies:
        if body.elastic is None or not body.mass:
            continue
        ends = [shapes[node][0, :3][:, known] for node in body.nodes if node in shapes]
        if not ends:
            continue
        share = body.mass / len(body.nodes)
        product = np.sum([share * (end.T @ end) for end in ends], axis=0)
        out[body.name] = body.mass, product
    return out
