"""Sample covariances."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tertia._arrays import FloatArray, finite, generator
from tertia._wishart import standard_wishart
from tertia.simulate._parameters import _number, _require, _shape


def wishart(
    covariance: npt.ArrayLike,
    degrees_of_freedom: float,
    *,
    batch: int | tuple[int, ...] = (),
    rng: np.random.Generator | int | None = None,
) -> FloatArray:
    """Draw sample covariances: Wishart matrices divided by their degrees of freedom.

    Parameters
    ----------
    covariance : array_like of shape (m, m)
        Mean of the matrices.
    degrees_of_freedom : float
        n - 1 for the sample covariance of n measurements; a whole number, or any number above
        m - 1. If it is less than m, the matrices are singular.
    batch : int or tuple of int
        Shape of the batch of matrices.
    rng : numpy.random.Generator or int, optional
        Random generator or its seed.

    Returns
    -------
    ndarray of shape (*batch, m, m)
        Sample covariances.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the covariance is not positive definite.
    ValueError, TypeError
        If a shape is wrong, a number is outside its domain, or an argument has the wrong type.

    Examples
    --------
    >>> from tertia.simulate import wishart
    >>> wishart([[4.0, 1.0], [1.0, 2.0]], 29, batch=5, rng=1).shape
    (5, 2, 2)
    """
    mean = finite(covariance, "covariance")
    m = mean.shape[-1] if mean.ndim else 0
    _require(mean.shape == (m, m) and m > 0, "covariance", mean.shape, "of shape (m, m)")
    nu = _number(degrees_of_freedom, "degrees_of_freedom", 1)
    drawable = nu > m - 1 or nu == int(nu)
    _require(drawable, "degrees_of_freedom", nu, f"a whole number, or above {m - 1}")
    scale = np.sqrt(np.abs(np.diagonal(mean)))
    symmetric = np.all(np.abs(mean - mean.T) <= 1e-10 * scale * scale[:, np.newaxis])
    _require(bool(symmetric), "covariance", mean.tolist(), "symmetric")
    root = np.linalg.cholesky(mean)
    drawn = root @ standard_wishart(m, nu, _shape(batch), generator(rng)) @ root.T
    matrices: FloatArray = (drawn + np.swapaxes(drawn, -1, -2)) / 2
    return matrices
