"""Tail probabilities."""

from __future__ import annotations


def chi_square_tail(total: float, freedom: int) -> float:
    """Return the chance that a χ² variable with that many degrees of freedom exceeds `total`."""
    from scipy.special import gammaincc  # pyright: ignore[reportMissingTypeStubs, reportUnknownVariableType]

    return float(gammaincc(0.5 * max(freedom, 1), 0.5 * total))  # pyright: ignore[reportUnknownArgumentType]
