"""Natural frequencies, damping and residues that measured responses have in common.

``H(ω) = Σ r_k / (ω_k² - ω² + 2 i ζ_k ω_k ω) + s`` with real residues r and a static remainder s of
each response: linear in r and s, so that only frequencies and damping ratios are searched (variable
projection).

References
----------
G. H. Golub, V. Pereyra, The differentiation of pseudo-inverses and nonlinear least squares problems
whose variables separate, SIAM J. Numer. Anal. 10, 1973; D. J. Ewins, Modal Testing, 2nd ed., Research
Studies Press 2000, sect. 4.5.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import least_squares

from stiffscope.errors import InputError
from stiffscope.responses.checks import find_damping, find_resonances

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stiffscope.responses.model import Response
    from stiffscope.runtime.types import Array

_RATIO = 0.01  # damping where the half-power width of a resonance is not seen
_SAME = 0.03  # relative, between resonances of two responses that are one
_NEAR = 0.1  # relative range in which a frequency is searched
_LEAST, _MOST = 1e-4, 0.5  # damping ratios


@dataclass(frozen=True, eq=False)
class FittedModes:
    """Modes of k resonances in r responses.

    Attributes
    ----------
    frequency, damping
        Natural frequencies (k,), Hz, and damping ratios.
    residues
        r_k (r, k) of each response, 1/kg for a receptance in m/N.
    remainder
        Static remainder (r,), as the receptance.
    """

    frequency: Array
    damping: Array
    residues: Array
    remainder: Array


def fit_modes(responses: Sequence[Response]) -> FittedModes:
    """Fit the modes that some responses of one structure have in common.

    Parameters
    ----------
    responses
        Receptances; each resonance that one of them shows becomes a mode.

    Raises
    ------
    InputError
        No response shows a resonance.
    """
    begin, ratio = _find_start(responses)
    if not begin.size:
        source = responses[0].source
        raise InputError(f"{source}: expected a resonance, got none")
    count = len(begin)
    start = np.concatenate([np.zeros(count), np.log(ratio)])
    low = np.concatenate([np.full(count, -_NEAR), np.full(count, np.log(_LEAST))])
    high = np.concatenate([np.full(count, _NEAR), np.full(count, np.log(_MOST))])

    def miss(parameters: Array) -> Array:
        frequency = begin * np.exp(parameters[:count])
        damping = np.exp(parameters[count:])
        rest = [_project(each, frequency, damping)[1] for each in responses]
        return np.concatenate(rest)

    solved = least_squares(
        miss, start.clip(low + 1e-9, high - 1e-9), bounds=(low, high)
    )
    frequency = begin * np.exp(solved.x[:count])
    damping = np.exp(solved.x[count:])
    factors = np.array([_project(each, frequency, damping)[0] for each in responses])
    return FittedModes(frequency, damping, factors[:, :count], factors[:, count])


def _find_start(responses: Sequence[Response]) -> tuple[Array, Array]:
    """Return frequencies, Hz, and damping ratios of all resonances, each once."""
    seen = list[tuple[float, float]]()
    for response in responses:
        widths = dict(find_damping(response))
        for line in find_resonances(response):
            hertz = float(response.frequency[line])
            if all(abs(np.log(hertz / other)) > _SAME for other, _ in seen):
                seen.append((hertz, widths.get(hertz, _RATIO)))
    seen.sort()
    table = np.array(seen).reshape(-1, 2)
    return table[:, 0], table[:, 1].clip(2.0 * _LEAST, 0.5 * _MOST)


def _project(
    response: Response, frequency: Array, damping: Array
) -> tuple[Array, Array]:
    """Return residues and remainder (k + 1,) of least misfit, and the misfit, relative."""
    omega = 2.0 * np.pi * response.frequency[:, None]
    rates = 2.0 * np.pi * frequency
    basis = 1.0 / (rates**2 - omega**2 + 2j * damping * rates * omega)
    basis = np.concatenate([basis, np.ones((len(omega), 1))], axis=1)
    scale = np.sqrt(np.mean(np.abs(response.receptance) ** 2))
    matrix = np.concatenate([basis.real, basis.imag])
    wanted = np.concatenate([response.receptance.real, response.receptance.imag])
    size = np.linalg.norm(matrix, axis=0)
    factors = np.linalg.lstsq(matrix / size, wanted, rcond=None)[0] / size
    return factors, (matrix @ factors - wanted) / (scale * np.sqrt(len(wanted)))
