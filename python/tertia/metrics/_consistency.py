"""Whether the errors are as large as they are said to be.

Normalised squared errors (Bar-Shalom, Li, Kirubarajan 2001, section 5.4) have the mean 1 per
dimension where the covariances are right; more means that the errors are larger than claimed.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tertia import _core
from tertia._arrays import FloatArray, integer, real, samples, scalar_or_array

__all__ = ["autocorrelation", "consistency_bounds", "nees", "nis", "rmse"]


def nees(error: npt.ArrayLike, covariance: npt.ArrayLike) -> float | FloatArray:
    """Return normalised estimation errors squared, `e' P^-1 e`.

    Parameters
    ----------
    error : array_like of shape (..., m)
        Estimates less the truth; nan where there is none.
    covariance : array_like of shape (..., m, m)
        The covariances that were claimed.

    Returns
    -------
    float or ndarray of shape (...)
        The mean of many is m where the covariances are right. nan where an error is nan, or a
        variance is not finite.

    Raises
    ------
    ValueError
        Shapes that do not fit.
    numpy.linalg.LinAlgError
        A covariance that is not positive definite.
    TypeError
        An argument of the wrong type.

    Examples
    --------
    >>> from tertia import metrics
    >>> metrics.nees([1.0, 2.0], [[1.0, 0.0], [0.0, 4.0]])
    2.0
    """
    e, p = samples(error, "error"), samples(covariance, "covariance")
    if e.ndim < 1 or p.ndim < 2 or p.shape[-2:] != e.shape[-1:] * 2:
        raise ValueError(
            f"error has shape {e.shape} and covariance {p.shape}; they must be (..., m) and "
            "(..., m, m)"
        )
    try:
        batch = np.broadcast_shapes(e.shape[:-1], p.shape[:-2])
    except ValueError:
        raise ValueError(
            f"error has shape {e.shape} and covariance {p.shape}; their batches do not fit"
        ) from None
    e, p = np.broadcast_to(e, (*batch, e.shape[-1])), np.broadcast_to(p, (*batch, *p.shape[-2:]))
    known = np.isfinite(e).all(axis=-1) & np.isfinite(p).all(axis=(-2, -1))
    result = np.full(batch, np.nan)
    root = np.linalg.cholesky(p[known])
    result[known] = np.sum(np.linalg.solve(root, e[known][..., np.newaxis]) ** 2, axis=(-2, -1))
    value: float | FloatArray = scalar_or_array(result)
    return value


def nis(innovation: npt.ArrayLike, variance: npt.ArrayLike) -> float | FloatArray:
    """Return normalised innovations squared, `innovation² / variance`.

    Parameters
    ----------
    innovation : array_like of shape (...)
        Plots less predictions; nan where there is none.
    variance : array_like of shape (...)
        The variances that were claimed.

    Returns
    -------
    float or ndarray of shape (...)
        The mean of many is 1 where the model is right.

    Raises
    ------
    ValueError
        Shapes that do not fit, or a variance that is not positive.
    TypeError
        An argument of the wrong type.

    Examples
    --------
    >>> from tertia import metrics
    >>> metrics.nis(3.0, 4.5)
    2.0
    """
    v, s = samples(innovation, "innovation"), samples(variance, "variance")
    if np.any(s <= 0):
        raise ValueError("variance must be positive everywhere")
    try:
        value: float | FloatArray = scalar_or_array(np.asarray(v**2 / s))
    except ValueError:
        raise ValueError(
            f"innovation has shape {v.shape} and variance {s.shape}; they do not fit together"
        ) from None
    return value


def consistency_bounds(
    count: int, dimension: int = 1, probability: float = 0.99
) -> tuple[float, float]:
    """Return the bounds of the mean of normalised squared errors where the covariances are right.

    Parameters
    ----------
    count : int
        How many independent errors the mean is taken over.
    dimension : int
        Components of each.
    probability : float
        That the mean lies within the bounds.

    Returns
    -------
    low, high : float
        Quantiles of chi-square with `count * dimension` degrees of freedom, over `count`.

    Raises
    ------
    ValueError
        A number outside its domain, or a product above 1e8.
    TypeError
        An argument of the wrong type.

    Examples
    --------
    >>> from tertia import metrics
    >>> low, high = metrics.consistency_bounds(100, 3)
    >>> round(low, 2), round(high, 2)
    (2.41, 3.67)
    """
    number, components = integer(count, "count", 1), integer(dimension, "dimension", 1)
    low, high = _core.consistency_bounds(real(probability, "probability"), number, components)
    return low, high


def rmse(error: npt.ArrayLike, axis: int | tuple[int, ...] | None = None) -> float | FloatArray:
    """Return the root of the mean squared error; nan is left out.

    Parameters
    ----------
    error : array_like
        Estimates less the truth.
    axis : int or tuple of int, optional
        The axes to average over; by default all.

    Returns
    -------
    float or ndarray
        nan where no error is known.

    Raises
    ------
    ValueError
        An axis that is not there.
    TypeError
        An argument of the wrong type.

    Examples
    --------
    >>> from tertia import metrics
    >>> metrics.rmse([3.0, float("nan"), 4.0]).__round__(3)
    3.536
    """
    e = samples(error, "error")
    known = ~np.isnan(e)
    squares = np.sum(np.where(known, e, 0.0) ** 2, axis=axis)
    count = np.asarray(np.sum(known, axis=axis), dtype=np.float64)
    mean = np.divide(squares, count, out=np.full(count.shape, np.nan), where=count > 0)
    value: float | FloatArray = scalar_or_array(np.sqrt(mean))
    return value


def autocorrelation(innovation: npt.ArrayLike, nlags: int = 20) -> FloatArray:
    """Return the autocorrelation of innovations, which is 0 where the filter fits.

    Parameters
    ----------
    innovation : array_like of shape (..., steps)
        Innovations over their standard deviations; nan where there is none.
    nlags : int
        The largest lag, less than steps.

    Returns
    -------
    ndarray of shape (..., nlags + 1)
        For lags 0, 1, ...; the first is 1. That of white innovations has a standard deviation of
        about 1 over the root of the number of pairs. Not centred: the mean should be 0 as well.

    Raises
    ------
    ValueError
        No more steps than `nlags`.
    TypeError
        An argument of the wrong type.

    Examples
    --------
    >>> from tertia import metrics
    >>> metrics.autocorrelation([1.0, -1.0, 1.0, -1.0], nlags=1)
    array([ 1., -1.])
    """
    v, last = samples(innovation, "innovation"), integer(nlags, "nlags", 0)
    if v.ndim == 0 or v.shape[-1] <= last:
        raise ValueError(f"innovation has shape {v.shape}; it must have more than {last} steps")
    known = ~np.isnan(v)
    filled = np.where(known, v, 0.0)
    n = v.shape[-1]
    result = np.full((*v.shape[:-1], last + 1), np.nan)
    for lag in range(last + 1):
        both = known[..., : n - lag] & known[..., lag:]
        early, late = (np.where(both, x, 0.0) for x in (filled[..., : n - lag], filled[..., lag:]))
        product = np.sum(early * late, axis=-1)
        norm = np.sqrt(np.sum(early**2, axis=-1) * np.sum(late**2, axis=-1))
        np.divide(product, norm, out=result[..., lag], where=norm > 0)
    return result
