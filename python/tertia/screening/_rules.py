"""Rules that mark outliers, and a function that unwraps angles."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
import numpy.typing as npt

from tertia import _core
from tertia._arrays import (
    BoolArray,
    FloatArray,
    NanPolicy,
    flag,
    integer,
    omits,
    real,
    samples,
    scalar_or_array,
    threads,
)
from tertia._result import Result


@dataclass(frozen=True, slots=True, eq=False)
class Screening(Result):
    """Outliers of samples of shape `(..., N)`, and the samples without them.

    Attributes
    ----------
    outlier : ndarray of bool, shape (..., N)
        Whether a measurement is an outlier.
    cleaned : ndarray of shape (..., N)
        The sample with each outlier replaced, or set to nan if outliers are excluded.
    mean, variance : float or ndarray of shape (...)
        Mean and variance (divisor n - 1) of the cleaned sample, in the unit of y and the square of
        that unit.
    threshold : float or ndarray of shape (...)
        Half width of the band about the mean outside which a measurement is an outlier, in the unit
        of y. In a sequential screening the band changes during the pass, and the last one is
        reported. For the meaning of `mean`, `variance` and `threshold` in a series whose value
        changes, see `moving_polynomial`.
    """

    _rows: ClassVar = "outlier", 0

    outlier: BoolArray
    cleaned: FloatArray
    mean: float | FloatArray
    variance: float | FloatArray
    threshold: float | FloatArray

    def __repr__(self) -> str:
        """Show counts and numbers, not arrays."""
        found = f"outliers {np.count_nonzero(self.outlier)} of {self.outlier.size}"
        if self.outlier.ndim > 1:
            return f"Screening({found}, batch {self.outlier.shape[:-1]})"
        return (
            f"Screening({found}, mean {self.mean:.6g}, variance {self.variance:.6g}, "
            f"threshold {self.threshold:.6g})"
        )


def leave_one_out_statistics(
    y: npt.ArrayLike, *, n_threads: int | None = None
) -> tuple[FloatArray, FloatArray]:
    """Return, for every measurement, the mean and variance of all other measurements.

    In equations (M2) and (M3), `M'_i` is the mean and `D'_i` the variance (divisor N - 2) of the
    sample without `y_i`. The cost is O(N). If one value contributes more than half of the sum of
    squares, the squares of the other values are summed again without it, so that no digits are lost
    by cancellation.

    Parameters
    ----------
    y : array_like of shape (..., N)
        Samples, N >= 3.
    n_threads : int, optional
        Number of threads; by default one for small tasks and all cores for large ones.

    Returns
    -------
    mean, variance : ndarray of shape (..., N)
        M' in the unit of y, and D' in the square of that unit.

    Raises
    ------
    ValueError, TypeError
        If there are fewer than 3 measurements, one is not finite, or `y` does not hold real
        numbers.

    Examples
    --------
    >>> from tertia.screening import leave_one_out_statistics
    >>> mean, variance = leave_one_out_statistics([9.0, 11.0, 10.0, 40.0])
    >>> mean.round(1)
    array([20.3, 19.7, 20. , 10. ])
    >>> variance.round(1)
    array([290.3, 310.3, 301. ,   1. ])
    """
    return _core.leave_one_out_statistics(samples(y, "y"), threads(n_threads))


def leave_one_out_mask(
    y: npt.ArrayLike, k: float = 2.5, *, n_threads: int | None = None
) -> BoolArray:
    """Return which measurements are outliers compared with the others, by the fastest rule.

    The result is the mask that `leave_one_out(y, k, statistics="frozen")` returns as `outlier`. The
    rule `|y_i - M'_i| > k sqrt(D'_i)` is equivalent to `|y_i - M| > c sqrt(D)` with the constant
    `c(k, N) = k (N-1)^(3/2) / sqrt(N (N (N-2) + k^2 (N-1)))`, so that it is sufficient to pass
    through the sample twice.

    Parameters
    ----------
    y : array_like of shape (..., N)
        Samples, N >= 3.
    k : float
        Threshold in standard deviations of the other measurements; see `false_alarm_probability`.
    n_threads : int, optional
        Number of threads; by default one for small tasks and all cores for large ones.

    Returns
    -------
    outlier : ndarray of bool, shape (..., N)
        True for outliers.

    Raises
    ------
    ValueError, TypeError
        If there are fewer than 3 measurements, one is not finite, k <= 0, or `y` does not hold real
        numbers.

    Examples
    --------
    >>> from tertia.screening import leave_one_out_mask
    >>> leave_one_out_mask([9.8, 10.1, 10.0, 25.0])
    array([False, False, False,  True])
    """
    return _core.leave_one_out_mask(samples(y, "y"), real(k, "k"), threads(n_threads))


def leave_one_out(
    y: npt.ArrayLike,
    k: float = 2.5,
    *,
    statistics: Literal["sequential", "frozen"] = "sequential",
    direction: Literal["forward", "backward"] = "forward",
    replace: bool = True,
    passes: int = 1,
    nan_policy: NanPolicy = "raise",
    n_threads: int | None = None,
) -> Screening:
    """Find outliers by comparing each measurement with the mean and variance of the others.

    By equations (M2)-(M4), `y_i` is an outlier if `|M'_i - y_i| > k sqrt(D'_i)`, where `M'_i` and
    `D'_i` are the mean and the variance of the other measurements.

    Parameters
    ----------
    y : array_like of shape (..., N)
        Samples, N >= 3.
    k : float
        Threshold in standard deviations of the other measurements. A good measurement is flagged
        with probability `false_alarm_probability(k, N)`; `critical_value(N, significance)` is the
        inverse.
    statistics : {"sequential", "frozen"}
        "sequential", as in the paper: an outlier is removed as soon as it is found, so that later
        measurements are compared with a cleaner sample. "frozen": all measurements are compared
        with the original sample.
    direction : {"forward", "backward"}
        Direction of a sequential pass. It affects which measurements are flagged.
    replace : bool
        Whether to replace an outlier by the mean `M'_i` of the other measurements; if False, it is
        excluded.
    passes : int
        Largest number of passes; screening ends when a pass finds no outlier.
    nan_policy : {"raise", "omit"}
        How to treat nan. "raise" makes it an error; "omit" takes it as 'no measurement'.
    n_threads : int, optional
        Number of threads; by default one for small tasks and all cores for large ones.

    Returns
    -------
    Screening
        The outliers, and the sample without them.

    Raises
    ------
    ValueError, TypeError
        If there are fewer than 3 measurements, one is not finite, deviations are too large or too
        small to be squared, k <= 0, a string is not one of the allowed values, fewer than 2
        measurements are left, `y` does not hold real numbers, or several passes are requested with
        a k so small that they would flag the whole sample (below 2.5 if outliers are replaced,
        below 1.7321 if they are excluded).

    Examples
    --------
    >>> from tertia.screening import leave_one_out
    >>> y = [12.4, 11.8, 40.0, 12.1, 12.9, 11.5, 20.0, 12.2, 12.0, 11.9]
    >>> screening = leave_one_out(y)
    >>> screening
    Screening(outliers 2 of 10, mean 12.1975, variance 0.213876, threshold 0.8457)
    >>> screening.outlier.nonzero()[0]
    array([2, 6])
    """
    return _screening(
        _core.leave_one_out(
            samples(y, "y"),
            real(k, "k"),
            str(statistics),
            str(direction),
            flag(replace, "replace"),
            integer(passes, "passes", 1),
            omits(nan_policy),
            threads(n_threads),
        )
    )


def k_sigma(
    y: npt.ArrayLike,
    k: float = 3.0,
    *,
    replace: Literal["neighbours", "mean"] | None = "neighbours",
    nan_policy: NanPolicy = "raise",
    n_threads: int | None = None,
) -> Screening:
    """Find outliers by the classical rule `|y_i - M| > k sqrt(D)`.

    This is equation (M1), where M and D are the mean and the variance of the sample. In a sample of
    N measurements, none can deviate from the mean by more than `(N-1)/sqrt(N)` standard deviations.
    With k = 3, therefore, no outlier can be found if N < 11; `leave_one_out` has no such limit.

    Parameters
    ----------
    y : array_like of shape (..., N)
        Samples, N >= 2.
    k : float
        Threshold in standard deviations of the whole sample, usually 2.1 to 3.
    replace : {"neighbours", "mean"} or None
        What replaces an outlier. With "neighbours", it is the mean of the nearest good measurements
        on both sides; with "mean", it is the mean of the whole sample; with None, the outlier is
        excluded.
    nan_policy, n_threads
        As for `leave_one_out`.

    Returns
    -------
    Screening
        The outliers, and the sample without them.

    Raises
    ------
    ValueError, TypeError
        If there are fewer than 2 measurements, one is not finite, deviations are too large or too
        small to be squared, k <= 0, a string is not one of the allowed values, too few measurements
        are left, or `y` does not hold real numbers.

    Examples
    --------
    >>> from tertia.screening import k_sigma
    >>> k_sigma([9.8, 10.1, 10.0, 25.0, 10.2, 9.9], k=2).cleaned
    array([ 9.8, 10.1, 10. , 10.1, 10.2,  9.9])
    """
    return _screening(
        _core.k_sigma(
            samples(y, "y"),
            real(k, "k"),
            None if replace is None else str(replace),
            omits(nan_policy),
            threads(n_threads),
        )
    )


def bursts(
    y: npt.ArrayLike,
    *,
    point_penalty: float = 2.5,
    burst_penalty: float = 3.0,
    min_burst: int = 2,
    max_burst: int = 20,
    correlation: float = 0.0,
    rounding: float = 0.0,
    nan_policy: NanPolicy = "raise",
    n_threads: int | None = None,
) -> Screening:
    """Find single outliers and bursts, which are runs of outliers on one side.

    The algorithm starts from the median and the MAD (median absolute deviation). By dynamic
    programming it finds the points and segments whose removal improves the fit most (collective and
    point anomaly detection). It then computes the mean and the standard deviation of the remaining
    measurements, and repeats the search with them. The cost is O(N max_burst).

    Parameters
    ----------
    y : array_like of shape (..., N)
        Samples, N >= 3. The error rates in the documentation hold for N >= 30.
    point_penalty, burst_penalty : float
        Smallest improvement of the fit for which a single outlier, or a burst, is removed, in units
        of `ln max(N, 30)`. With smaller penalties, such as 2.0 and 2.5, more outliers are found,
        but more good measurements are flagged in samples without outliers.
    min_burst, max_burst : int
        Shortest (>= 2) and longest (at most 100 000) burst, in measurements.
    correlation : float
        Correlation of successive measurements in a record without outliers, between -1 and 1.
        Correlated noise looks like bursts unless its correlation is given.
    rounding : float
        Step to which the measurements were rounded, in the unit of y; 0 means that they were not
        rounded or that the step is unknown. The variance of rounding, `rounding**2 / 12`, is added
        to the variance of the noise. If `rounding` is 0 and more than half of the measurements are
        equal, the distance from these to the nearest different measurement is used as the step.
    nan_policy, n_threads
        As for `leave_one_out`.

    Returns
    -------
    Screening
        Outliers are excluded, and `threshold` is the threshold for a single outlier. Nothing is
        flagged if fewer than 5 measurements, or less than a quarter of the sample, would be left.

    Raises
    ------
    ValueError, TypeError
        If there are fewer than 3 measurements, one is not finite, a parameter is outside its
        domain, or `y` does not hold real numbers.

    Examples
    --------
    >>> import numpy as np
    >>> from tertia.screening import bursts
    >>> y = np.random.default_rng(2).normal(10, 1, 100)
    >>> y[40:46] += 4
    >>> y[80] -= 6
    >>> bursts(y).outlier.nonzero()[0]
    array([40, 41, 42, 43, 44, 45, 80])
    """
    return _screening(
        _core.bursts(
            samples(y, "y"),
            real(point_penalty, "point_penalty"),
            real(burst_penalty, "burst_penalty"),
            integer(min_burst, "min_burst", 2),
            integer(max_burst, "max_burst", 2),
            real(correlation, "correlation"),
            real(rounding, "rounding"),
            omits(nan_policy),
            threads(n_threads),
        )
    )


def moving_polynomial(
    y: npt.ArrayLike,
    window: int = 13,
    degree: int = 2,
    *,
    k: float = 4.0,
    time: npt.ArrayLike | None = None,
    period: float | None = None,
    n_threads: int | None = None,
) -> Screening:
    """Find outliers of a series whose value changes, by comparison with neighbouring measurements.

    A least-squares polynomial is fitted to the other measurements in the window of a measurement.
    The measurement deviates from this polynomial by e. The variance of the polynomial at this
    instant is h times the variance of the noise, and `z = e / sqrt(1 + h)`. A measurement is an
    outlier if `|z| > k s`, with `s = 1.4826 median |z|`, and if its `|z|` is larger than that of
    the two measurements before it and the two after it. Outliers are removed, and all measurements
    are tested again, up to three times. Outliers that agree with the remaining measurements are
    restored.

    Parameters
    ----------
    y : array_like of shape (..., N)
        Measurements in time order; nan where one is missing.
    window : int
        Number of instants in a window; it must be odd. Each instant is in the middle of its window,
        except near the ends of the series, where the first or the last full window is used.
    degree : int
        Degree of the polynomials, at most 9 and less than `window` - 3.
    k : float
        Threshold in standard deviations.
    time : array_like of shape (N,) or (..., N), optional
        Times of the measurements, in non-decreasing order; by default 0, 1, 2, ...
    period : float, optional
        Period of the values: 360.0 or 2*pi for angles. The values must change by less than half a
        period in half a window. By default, values do not wrap.
    n_threads : int, optional
        Number of threads; by default one for small tasks and all cores for large ones.

    Returns
    -------
    Screening
        Outliers are replaced by the values of the polynomials. `variance` is s², the variance of
        the noise about the polynomials, and `threshold` is k s. A measurement is not tested if
        there are fewer than `degree` + 3 good measurements in its window. If no measurement is
        tested, `variance` and `threshold` are nan; `mean` is nan if there are no measurements.

    Raises
    ------
    ValueError
        If a measurement is infinite, times decrease, shapes do not fit, or a parameter is outside
        its domain.
    TypeError
        If `y` or `time` does not hold real numbers.

    Notes
    -----
    A run of outliers that is longer than a quarter of a window distorts the polynomials and is not
    found. If the true value is constant, `bursts` finds such runs. The cost is O(N window degree).

    Examples
    --------
    >>> import numpy as np
    >>> from tertia.screening import moving_polynomial
    >>> t = np.arange(100)
    >>> y = 50 * np.sin(t / 20) + np.random.default_rng(1).normal(size=100)
    >>> y[[20, 60, 61]] += [9, -12, 8]
    >>> moving_polynomial(y).outlier.nonzero()[0]
    array([20, 60, 61])
    """
    series = samples(y, "y")
    n = series.shape[-1] if series.ndim else 0
    instants = np.arange(n, dtype=np.float64) if time is None else samples(time, "time")
    if series.ndim and instants.shape != (n,):
        try:
            instants = np.broadcast_to(instants, series.shape)
        except ValueError:
            raise ValueError(
                f"time has shape {instants.shape}; for y of shape {series.shape} it must be ({n},) "
                f"or {series.shape}"
            ) from None
    return _screening(
        _core.moving_polynomial(
            series,
            instants,
            integer(window, "window", 1),
            integer(degree, "degree", 0),
            real(k, "k"),
            None if period is None else real(period, "period"),
            threads(n_threads),
        )
    )


def unwrap_about_median(
    theta: npt.ArrayLike, period: float = 360.0, *, n_threads: int | None = None
) -> FloatArray:
    """Unwrap angles about their circular median.

    First, whole periods are added to the angles so that every angle is within half a period of the
    circular mean. Then the same is done with the median of the resulting angles instead of the
    mean. The results could still be shifted together by whole periods; this common shift follows
    from the first angle. Even if nearly half of the angles are wrong, the others are unwrapped
    correctly. By contrast, `numpy.unwrap` compares neighbours, so that one wrong angle shifts all
    later angles.

    Parameters
    ----------
    theta : array_like of shape (..., N)
        Angles, N >= 1.
    period : float
        Period of the angles: 360.0 for degrees, 2*pi for radians.
    n_threads : int, optional
        Number of threads; by default one for small tasks and all cores for large ones.

    Returns
    -------
    ndarray of shape (..., N)
        Unwrapped angles, which can be averaged, in the unit of `theta`.

    Raises
    ------
    ValueError, TypeError
        If there are no angles, one is not finite, period <= 0, or `theta` does not hold real
        numbers.

    Examples
    --------
    >>> from tertia.screening import unwrap_about_median
    >>> unwrap_about_median([359.0, 1.0, 2.0, 358.0, 0.5])
    array([359. , 361. , 362. , 358. , 360.5])
    """
    return _core.unwrap_about_median(
        samples(theta, "theta"), real(period, "period"), threads(n_threads)
    )


def _screening(
    result: tuple[BoolArray, FloatArray, FloatArray, FloatArray, FloatArray],
) -> Screening:
    outlier, cleaned, *numbers = result
    return Screening(outlier, cleaned, *map(scalar_or_array, numbers))
