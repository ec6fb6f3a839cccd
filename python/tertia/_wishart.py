"""Wishart matrices, drawn by Bartlett's decomposition."""

from __future__ import annotations

import numpy as np

from tertia._arrays import FloatArray


def standard_wishart(
    m: int, degrees_of_freedom: float, size: tuple[int, ...], rng: np.random.Generator
) -> FloatArray:
    """Draw Wishart matrices of order `m` whose mean is `I`; the result has the shape (*size, m, m).

    If the degrees of freedom are a whole number below `m`, the matrices are singular.
    """
    if np.isinf(degrees_of_freedom):
        return np.tile(np.eye(m), (*size, 1, 1))
    if degrees_of_freedom > m - 1:
        root = np.tril(rng.standard_normal((*size, m, m)), -1)
        diagonal = np.arange(m)
        root[..., diagonal, diagonal] = np.sqrt(
            rng.chisquare(degrees_of_freedom - diagonal, (*size, m))
        )
    else:
        root = rng.standard_normal((*size, m, int(degrees_of_freedom)))
    matrices: FloatArray = root @ np.swapaxes(root, -1, -2) / degrees_of_freedom
    return matrices
