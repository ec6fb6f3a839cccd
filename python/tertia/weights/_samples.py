"""Estimation of covariances, and the uncertainty of the estimates."""

from __future__ import annotations

from typing import Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from tertia import _core
from tertia._arrays import FloatArray, common_batch, flag, integer, real, samples, threads
from tertia.weights._readers import moderate, squares

Convention: TypeAlias = Literal["sample-mean", "known-mean", "paper", "differences"]

_LARGEST_FACTOR = 1e10


def sample_covariance(
    x: npt.ArrayLike,
    *,
    mean: npt.ArrayLike | None = None,
    differences: bool = False,
    ddof: int = 1,
) -> FloatArray:
    """Estimate a covariance from repeated measurements.

    Parameters
    ----------
    x : array_like of shape (..., n, m)
        Measurements of a vector, n >= 2.
    mean : array_like of shape (..., m), optional
        The true value of the vector, if it is known.
    differences : bool
        Whether to use differences of successive measurements, for a target that moves slowly.
    ddof : int
        Number that is subtracted from n in the divisor if deviations are from the sample mean: 1
        gives an unbiased estimate, and 0 gives the maximum-likelihood estimate. It is ignored if
        `mean` or `differences` is given.

    Returns
    -------
    ndarray of shape (..., m, m)
        The covariance. It is computed from deviations from the sample mean with the divisor `n -
        ddof` (if `ddof` is 1, this is the convention "sample-mean" of `covariance_factor`), from
        deviations from `mean` with the divisor n (the convention "known-mean"), or from differences
        with the divisor 2 (n - 1) (the convention "differences"). In the convention "paper", which
        is equation (3) of the paper, deviations are from the true mean but the divisor is n - 1.
        This gives `n / (n - 1)` times the covariance of "known-mean".

    Raises
    ------
    ValueError, TypeError
        If there are fewer than two measurements, a number is not finite, shapes do not fit, both
        `mean` and `differences` are given, the divisor is not positive, or an argument has the
        wrong type.

    Examples
    --------
    >>> from tertia import weights
    >>> weights.sample_covariance([[1, 0], [2, 1], [3, -1]])
    array([[ 1. , -0.5],
           [-0.5,  1. ]])
    """
    y = moderate(x, "x")
    if y.ndim < 2 or y.shape[-2] < 2 or y.shape[-1] < 1:
        raise ValueError(f"x has shape {y.shape}; it must be (..., n, m) with n >= 2 measurements")
    n, removed = y.shape[-2], integer(ddof, "ddof", 0)
    if removed >= n:
        raise ValueError(f"ddof is {removed}; it must be below the {n} measurements")
    if flag(differences, "differences"):
        if mean is not None:
            raise ValueError("mean is given; with differences it must be None")
        deviations, divisor = np.diff(y, axis=-2), 2.0 * (n - 1)
    elif mean is not None:
        true = moderate(mean, "mean")
        if true.shape[-1:] != y.shape[-1:]:
            raise ValueError(f"mean has shape {true.shape}; it must be (..., {y.shape[-1]})")
        common_batch(x=y.shape[:-2], mean=true.shape[:-1])
        deviations, divisor = y - true[..., np.newaxis, :], float(n)
    else:
        # from the first measurement, so that a common offset costs nothing
        deviations, divisor = y - y[..., :1, :], float(n - removed)
        deviations -= deviations.mean(axis=-2, keepdims=True)
    gram: FloatArray = np.swapaxes(deviations, -1, -2) @ deviations / divisor
    return (gram + np.swapaxes(gram, -1, -2)) / 2


def covariance_factor(n: float, convention: Convention = "sample-mean") -> float:
    """Return the factor c in the covariance of a sample covariance, `c (S ⊗ S)(I + K)`.

    Parameters
    ----------
    n : int or inf
        Number of measurements, at least 2; inf for a covariance that is known.
    convention : {"sample-mean", "known-mean", "paper", "differences"}
        How the covariance is estimated (see `sample_covariance`).

    Returns
    -------
    float
        `1 / (n - 1)`, `1 / n`, `n / (n - 1)²` or `(3 n - 4) / (2 (n - 1)²)`, for the four
        conventions in the order in which `convention` lists them.

    Raises
    ------
    ValueError, TypeError
        If n is not a whole number of at least 2, the convention is unknown, or an argument has the
        wrong type.

    Notes
    -----
    These are equations (4) and (5) of the source, for normal measurements. K is the commutation
    matrix.

    Examples
    --------
    >>> from tertia import weights
    >>> weights.covariance_factor(11)
    0.1
    """
    [(degrees_of_freedom, mean)] = _core.wishart_law(real(n, "n"), convention, 1)
    return mean**2 / degrees_of_freedom


def covariance_of_covariance(
    covariance: npt.ArrayLike, factor: float, *, n_threads: int | None = None
) -> FloatArray:
    """Return the covariance of the elements of a sample covariance.

    Parameters
    ----------
    covariance : array_like of shape (..., m, m)
        The true covariance S, or its estimate.
    factor : float
        The factor c, from `covariance_factor`.
    n_threads : int, optional
        Number of threads; by default one for small tasks and all cores for large ones.

    Returns
    -------
    ndarray of shape (..., m², m²)
        `c (S ⊗ S)(I + K)`, where K is the commutation matrix. The element [j m + i, l m + q] is `c
        (s_iq s_jl + s_il s_jq)`, because vec stacks columns. The matrix is singular, because S is
        symmetric.

    Raises
    ------
    numpy.linalg.LinAlgError
        If a covariance is indefinite.
    ValueError
        As for `weight_matrices`; also if the factor is negative.
    TypeError
        If an argument has the wrong type.

    Notes
    -----
    These are equations (4) and (5) of the source. The cost is O(m⁴).

    Examples
    --------
    >>> from tertia import weights
    >>> weights.covariance_of_covariance([[2.0]], 0.1)
    array([[0.8]])
    """
    c = real(factor, "factor")
    if not 0 <= c <= _LARGEST_FACTOR:
        raise ValueError(f"factor is {c}; it must be between 0 and {_LARGEST_FACTOR:g}")
    s = samples(covariance, "covariance")
    return _core.weigh("covariance_of_covariance", s, threads(n_threads), factor=c)


def shrink_covariance(
    model: npt.ArrayLike, sample: npt.ArrayLike, n: npt.ArrayLike, n_model: float = 12.0
) -> FloatArray:
    """Shrink a covariance estimated from few measurements towards the covariance of a model.

    Parameters
    ----------
    model : array_like of shape (..., m, m)
        The covariance that is predicted from the geometry of the sensor and its nominal errors.
    sample : array_like of shape (..., m, m)
        The sample covariance.
    n : int, inf or array_like of shape (...)
        Number of measurements in the sample, at least 1.
    n_model : float
        Weight of the model, as an equivalent number of degrees of freedom.

    Returns
    -------
    ndarray of shape (..., m, m)
        The covariance `(n_model S_model + (n - 1) S) / (n_model + n - 1)`.

    Raises
    ------
    ValueError, TypeError
        If shapes do not fit, a number is not finite, too small or not positive where it must be, or
        an argument has the wrong type.

    Notes
    -----
    This is the mean of the inverse Wishart posterior, except that m + 1 is not subtracted in the
    denominator. docs/weights-accuracy.md compares it with the sample covariance alone and with
    general shrinkage.

    Examples
    --------
    >>> from tertia import weights
    >>> weights.shrink_covariance([[1.0]], [[2.0]], 13)
    array([[1.5]])
    """
    predicted, measured = squares(model, "model"), squares(sample, "sample")
    if predicted.shape[-1] != measured.shape[-1]:
        raise ValueError(
            f"model has shape {predicted.shape} and sample {measured.shape}; their m must agree"
        )
    count, worth = samples(n, "n"), real(n_model, "n_model")
    if not 0 < worth < np.inf:
        raise ValueError(f"n_model is {worth}; it must be a positive number")
    if not np.all(count >= 1):
        raise ValueError("n must be at least 1 everywhere")
    common_batch(model=predicted.shape[:-2], sample=measured.shape[:-2], n=count.shape)
    share = (worth / (worth + (count - 1.0)))[..., np.newaxis, np.newaxis]
    return share * predicted + (1.0 - share) * measured
