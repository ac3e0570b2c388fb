"""Factors of many small symmetric positive semidefinite matrices, which drop singular directions.

Any generalized inverse serves in a Schur complement of a semidefinite matrix, so no eigenvalues are
needed: LDLᵀ drops a pivot that is rounding relative to its diagonal entry, a unit-free ratio.
"""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from stiffscope.vjm.model.screws import Array

DROPPED = 1e-9  # relative pivot below which a direction is free
_FEW = 8  # matrices, up to which one library call for each is faster


def multiply_transposed(matrix: Array) -> Array:
    """Return AᵀA (n, m, m) of many small A (n, k, m), in a quarter of the time of ``A.mT @ A``."""
    return (
        matrix.mT @ matrix.copy()
    )  # of one array numpy calls a symmetric product, slow to start


def half_inverse(matrix: Array, tolerance: float = DROPPED) -> Array:
    """Return lower triangular W (n, m, m), ``WᵀW`` a generalized inverse of matrices (n, m, m)."""
    return pivot(matrix, tolerance)[0]


def pivot(matrix: Array, tolerance: float = DROPPED) -> tuple[Array, Array]:
    """Return ``half_inverse`` and its relative pivots (n, m)."""
    n = matrix.shape[0]
    m = matrix.shape[-1]
    if m and n <= _FEW:
        with suppress(np.linalg.LinAlgError):
            root = np.linalg.cholesky(matrix)
            ratio = root.diagonal(0, 1, 2) ** 2 / matrix.diagonal(0, 1, 2)
            if (ratio > tolerance).all():
                return np.linalg.inv(root), ratio
    a = matrix.transpose(1, 2, 0).copy(order="C")
    size = np.einsum("iin->in", a).copy()
    size[~(size > 0.0)] = 1.0
    w = np.zeros((m, m, n))
    pivots = np.empty((m, n))
    for j in range(m):
        pivots[j] = a[j, j] / size[j]
        keep = pivots[j] > tolerance
        root = keep / np.sqrt(np.where(keep, a[j, j], 1.0))
        if j + 1 < m:
            factor = a[j + 1 :, j] * (root * root)
            a[j + 1 :, j + 1 :] -= factor[:, None] * a[None, j, j + 1 :]
            if j:
                w[j + 1 :, :j] -= factor[:, None] * w[None, j, :j]
            w[j + 1 :, j] = -factor
        w[j, :j] *= root
        w[j, j] = root
    return np.ascontiguousarray(w.transpose(2, 0, 1)), pivots.T


def inverse(matrix: Array, tolerance: float = DROPPED) -> Array:
    """Return the generalized inverse (n, m, m) of semidefinite matrices (n, m, m)."""
    return multiply_transposed(half_inverse(matrix, tolerance))


def projector(directions: Array, tolerance: float = DROPPED) -> tuple[Array, Array]:
    """Return projectors (n, d, d) onto the complement of columns (n, d, k), and ranks (n,).

    Gram-Schmidt, each column twice; columns that depend on earlier ones are dropped.
    """
    n, d, k = directions.shape
    if n <= _FEW and k <= d:
        size = np.linalg.norm(directions, axis=1, keepdims=True)
        q, r = np.linalg.qr(directions / np.where(size > 0.0, size, 1.0))
        if (np.abs(np.einsum("nii->ni", r)) > tolerance).all():
            return np.eye(d) - q @ q.mT, np.zeros(n) + float(k)
    columns = np.ascontiguousarray(directions.transpose(2, 1, 0))
    basis: list[Array] = []
    rank = np.zeros(n)
    out = np.broadcast_to(np.eye(d)[:, :, None], (d, d, n)).copy()
    for j in range(k):
        v = columns[j]
        size = np.sqrt((v * v).sum(axis=0))
        v = v / np.where(size > 0.0, size, 1.0)
        for _ in range(2):
            for q in basis:
                v = v - q * (q * v).sum(axis=0)
        rest = np.sqrt((v * v).sum(axis=0))
        keep = rest > tolerance
        v = v * np.where(keep, 1.0 / np.where(keep, rest, 1.0), 0.0)
        basis.append(v)
        rank += keep
        out -= v[:, None] * v[None]
    return np.ascontiguousarray(out.transpose(2, 0, 1)), rank
