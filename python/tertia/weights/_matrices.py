"""Weight matrices, and the covariance of the fused estimate."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tertia import _core
from tertia._arrays import FloatArray, common_batch, samples, threads
from tertia.weights._readers import deviation, moderate


def weight_matrices(covariances: npt.ArrayLike, *, n_threads: int | None = None) -> FloatArray:
    """Return the weight matrices of several estimates of the same vector.

    The fused estimate is the sum of all `W_k x_k`; for two sensors, this is `x_1 + W_2 (x_2 -
    x_1)`.

    Parameters
    ----------
    covariances : array_like of shape (..., K, m, m)
        Covariance of each of K >= 2 estimates, whose errors must be independent. A covariance may
        be singular if the others are not singular in the same direction.
    n_threads : int, optional
        Number of threads; by default one for small tasks and all cores for large ones.

    Returns
    -------
    ndarray of shape (..., K, m, m)
        The weights `W_k`. Their sum is the identity; in general they are not symmetric.

    Raises
    ------
    numpy.linalg.LinAlgError
        If a covariance is indefinite, or some are singular in the same direction.
    ValueError, TypeError
        If a shape is wrong, a matrix is not symmetric, an element is not finite, a variance is not
        positive, or an argument has the wrong type.

    Notes
    -----
    These are equations (1), (2) and (6) of the source, generalised to K sensors. The cost is O(K
    m³).

    Examples
    --------
    >>> from tertia import weights
    >>> S = [[[4, 1], [1, 2]], [[1, -0.5], [-0.5, 3]]]
    >>> weights.weight_matrices(S)[1] * 99
    array([[78., 12.],
           [16., 38.]])
    """
    return _core.weigh("weights", samples(covariances, "covariances"), threads(n_threads))


def fused_covariance(covariances: npt.ArrayLike, *, n_threads: int | None = None) -> FloatArray:
    """Return the covariance of the fused estimate, `S_p = (C_1 + ... + C_K)^-1`.

    Parameters
    ----------
    covariances, n_threads
        As for `weight_matrices`.

    Returns
    -------
    ndarray of shape (..., m, m)
        The covariance `S_p`.

    Raises
    ------
    numpy.linalg.LinAlgError, ValueError, TypeError
        As for `weight_matrices`; also if covariances are (almost) singular in different directions,
        so that rounding would leave an error of more than 0.1 % in a fused variance.

    Examples
    --------
    >>> from tertia import weights
    >>> weights.fused_covariance([[[1.0]], [[3.0]]])
    array([[0.75]])
    """
    s = samples(covariances, "covariances")
    return _core.weigh("fused_covariance", s, threads(n_threads))


def scalar_information(h: npt.ArrayLike, sigma: npt.ArrayLike) -> FloatArray:
    """Return the information matrix of a measured scalar, `h h' / sigma²`, of rank one.

    `tertia.fusion.fuse_scalar` gives the same result without forming or inverting this matrix.

    Parameters
    ----------
    h : array_like of shape (..., m)
        Derivatives of the scalar with respect to the components of the estimate.
    sigma : array_like of shape (...)
        Standard deviation of the scalar.

    Returns
    -------
    ndarray of shape (..., m, m)
        The information matrix. It is singular for m > 1, so no covariance corresponds to it.

    Raises
    ------
    ValueError, TypeError
        If a number is not finite, a sigma is not positive, or an argument has the wrong type.

    Examples
    --------
    >>> from tertia import weights
    >>> weights.scalar_information([3, 4], 5)
    array([[0.36, 0.48],
           [0.48, 0.64]])
    """
    row, sigmas = moderate(h, "h"), deviation(sigma, "sigma")
    if row.ndim == 0:
        raise ValueError("h is a single number; it must be of shape (..., m)")
    common_batch(h=row.shape[:-1], sigma=sigmas.shape)
    scaled = row / sigmas[..., np.newaxis]
    return scaled[..., :, np.newaxis] * scaled[..., np.newaxis, :]
