"""Consistency of errors with the stated covariances.

If the covariances are correct, the mean of the normalised squared errors divided by the number of
dimensions is 1 (Bar-Shalom, Li, Kirubarajan 2001, section 5.4). A larger mean shows that the errors
are larger than stated.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tertia import _core
from tertia._arrays import (
    FloatArray,
    common_batch,
    integer,
    real,
    samples,
    scalar_or_array,
    squarable,
)


def nees(error: npt.ArrayLike, covariance: npt.ArrayLike) -> float | FloatArray:
    """Return the normalised estimation errors squared, `e' P^-1 e`.

    Parameters
    ----------
    error : array_like of shape (..., m)
        Estimation errors, which are estimates minus true values; nan if one is missing.
    covariance : array_like of shape (..., m, m)
        Stated covariances.

    Returns
    -------
    float or ndarray of shape (...)
        Normalised errors squared, whose mean is m if the covariances are correct; nan if an error
        is nan or a variance is not finite.

    Raises
    ------
    ValueError
        If shapes do not fit.
    numpy.linalg.LinAlgError
        If a covariance is not positive definite.
    TypeError
        If an argument has the wrong type.

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
    batch = common_batch(error=e.shape[:-1], covariance=p.shape[:-2])
    e, p = np.broadcast_to(e, (*batch, e.shape[-1])), np.broadcast_to(p, (*batch, *p.shape[-2:]))
    known = np.isfinite(e).all(axis=-1) & np.isfinite(p).all(axis=(-2, -1))
    result = np.full(batch, np.nan)
    root = np.linalg.cholesky(p[known])
    result[known] = np.sum(np.linalg.solve(root, e[known][..., np.newaxis]) ** 2, axis=(-2, -1))
    value: float | FloatArray = scalar_or_array(result)
    return value


def nis(innovation: npt.ArrayLike, variance: npt.ArrayLike) -> float | FloatArray:
    """Return the normalised innovations squared, `innovation² / variance`.

    Parameters
    ----------
    innovation : array_like of shape (...)
        Innovations, which are plots minus predictions; nan if a plot is missing.
    variance : array_like of shape (...)
        Stated variances of the innovations.

    Returns
    -------
    float or ndarray of shape (...)
        Normalised innovations squared, whose mean is 1 if the model is correct.

    Raises
    ------
    ValueError, TypeError
        If shapes do not fit, a variance is not positive, or an argument has the wrong type.

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
    """Return bounds for the mean of normalised squared errors if the covariances are correct.

    Parameters
    ----------
    count : int
        Number of independent errors from which the mean is computed.
    dimension : int
        Number of components of each error.
    probability : float
        Probability that the mean lies within the bounds.

    Returns
    -------
    low, high : float
        Quantiles of chi-square with `count * dimension` degrees of freedom, divided by `count`.

    Raises
    ------
    ValueError, TypeError
        If a number is outside its domain, a product is above 1e8, or an argument has the wrong
        type.

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
    """Return the root mean square error, ignoring nan.

    Parameters
    ----------
    error : array_like
        Estimation errors.
    axis : int or tuple of int, optional
        Axes over which the squares are averaged; by default all axes.

    Returns
    -------
    float or ndarray
        The root mean square; nan if there is no error to average.

    Raises
    ------
    ValueError, TypeError
        If an axis is out of range, or errors are not real numbers.

    Examples
    --------
    >>> from tertia import metrics
    >>> metrics.rmse([3.0, float("nan"), 4.0]).__round__(3)
    3.536
    """
    e = samples(error, "error")
    known = ~np.isnan(e)
    try:
        squares = np.sum(np.where(known, e, 0.0) ** 2, axis=axis)
    except OverflowError:
        raise ValueError(f"axis is {axis}; error has {e.ndim} axes") from None
    count = np.asarray(np.sum(known, axis=axis), dtype=np.float64)
    mean = np.divide(squares, count, out=np.full(count.shape, np.nan), where=count > 0)
    value: float | FloatArray = scalar_or_array(np.sqrt(mean))
    return value


def autocorrelation(innovation: npt.ArrayLike, nlags: int = 20) -> FloatArray:
    """Return the autocorrelation of innovations; it is about 0 if the filter is correct.

    Parameters
    ----------
    innovation : array_like of shape (..., steps)
        Innovations divided by their standard deviations; nan if an innovation is missing.
    nlags : int
        The largest lag, less than the number of steps.

    Returns
    -------
    ndarray of shape (..., nlags + 1)
        Autocorrelation at lags 0, 1, ...; the first is 1. If the innovations are white, the
        standard deviation of the autocorrelation is about 1 divided by the square root of the
        number of pairs. The mean of the innovations, which should be 0 as well, is not subtracted.

    Raises
    ------
    ValueError, TypeError
        If the number of steps does not exceed `nlags`, or an argument has the wrong type.

    Examples
    --------
    >>> from tertia import metrics
    >>> metrics.autocorrelation([1.0, -1.0, 1.0, -1.0], nlags=1)
    array([ 1., -1.])
    """
    v, last = squarable(innovation, "innovation"), integer(nlags, "nlags", 0)
    if v.ndim == 0 or v.shape[-1] <= last:
        raise ValueError(f"innovation has shape {v.shape}; it must have more than {last} steps")
    known = ~np.isnan(v)
    # relative to the largest, whose fourth power is needed
    filled = np.where(known, v, 0.0) / (np.max(np.abs(v[known]), initial=0.0) or 1.0)
    n = v.shape[-1]
    result = np.full((*v.shape[:-1], last + 1), np.nan)
    for lag in range(last + 1):
        both = known[..., : n - lag] & known[..., lag:]
        early, late = (np.where(both, x, 0.0) for x in (filled[..., : n - lag], filled[..., lag:]))
        product = np.sum(early * late, axis=-1)
        norm = np.sqrt(np.sum(early**2, axis=-1) * np.sum(late**2, axis=-1))
        np.divide(product, norm, out=result[..., lag], where=norm > 0)
    return result
