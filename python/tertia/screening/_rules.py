"""Rules that mark outliers, and the preparation of angles for them."""

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
        The sample with each outlier replaced, or nan where it is excluded.
    mean, variance : float or ndarray of shape (...)
        Mean and variance (divisor n - 1) of the cleaned sample; unit of y and its square.
    threshold : float or ndarray of shape (...)
        Half width of the band about the mean outside which a measurement is an outlier; unit of y.
        A sequential screening moves the band: this is the last one. `moving_polynomial` says what
        these three are for a series that moves.
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
    """Mean and variance of the others, for every measurement.

    Equations (M2) and (M3): `M'_i` is the mean and `D'_i` the variance (divisor N - 2) of the
    sample without `y_i`. The cost is O(N). Where one value makes up more than half of the sum of
    squares, the others are summed anew, so that no digits are lost to cancellation.

    Parameters
    ----------
    y : array_like of shape (..., N)
        Samples, N >= 3.
    n_threads : int, optional
        Number of threads; by default one for small tasks and all cores for large ones.

    Returns
    -------
    mean, variance : ndarray of shape (..., N)
        M' in the unit of y, D' in its square.

    Raises
    ------
    ValueError
        Fewer than 3 measurements, or one that is not finite.
    TypeError
        `y` does not hold real numbers.

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
    """Whether each measurement is an outlier against the others: the fastest screening.

    Returns the mask of `leave_one_out(y, k, statistics="frozen")` and nothing else. The rule
    `|y_i - M'_i| > k sqrt(D'_i)` is exactly `|y_i - M| > c sqrt(D)` with a constant
    `c(k, N) = k (N-1)^(3/2) / sqrt(N (N (N-2) + k^2 (N-1)))`, so two reads of the sample suffice.

    Parameters
    ----------
    y : array_like of shape (..., N)
        Samples, N >= 3.
    k : float
        Threshold in standard deviations of the others; see `false_alarm_probability`.
    n_threads : int, optional
        Number of threads; by default one for small tasks and all cores for large ones.

    Returns
    -------
    outlier : ndarray of bool, shape (..., N)

    Raises
    ------
    ValueError
        Fewer than 3 measurements, one that is not finite, or k <= 0.
    TypeError
        `y` does not hold real numbers.

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

    Equations (M2)-(M4): `y_i` is an outlier if `|M'_i - y_i| > k sqrt(D'_i)`.

    Parameters
    ----------
    y : array_like of shape (..., N)
        Samples, N >= 3.
    k : float
        Threshold in standard deviations of the others. A good measurement is flagged with
        probability `false_alarm_probability(k, N)`; `critical_value(N, significance)` is the
        inverse.
    statistics : {"sequential", "frozen"}
        "sequential", as in the paper: an outlier leaves the statistics as soon as it is found, so
        later measurements are compared with a cleaner sample. "frozen": all measurements are
        compared with the sample as it was.
    direction : {"forward", "backward"}
        Direction of a sequential pass. It affects which measurements are flagged.
    replace : bool
        Replace an outlier by `M'_i`; if False, exclude it.
    passes : int
        Largest number of passes; screening ends early when a pass finds nothing.
    nan_policy : {"raise", "omit"}
        "omit": nan is 'no measurement'.
    n_threads : int, optional
        Number of threads; by default one for small tasks and all cores for large ones.

    Returns
    -------
    Screening

    Raises
    ------
    ValueError
        Fewer than 3 measurements, one that is not finite, deviations too large or too small to be
        squared, k <= 0, an unknown word, fewer than 2 measurements left, or several passes with a k
        so small that they would consume the whole sample (below 2.5 with replacement, 1.7321
        without).
    TypeError
        `y` does not hold real numbers.

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

    Equation (M1). In a sample of N nothing can deviate by more than `(N-1)/sqrt(N)` standard
    deviations, so with k = 3 nothing is ever found below N = 11; `leave_one_out` has no such limit.

    Parameters
    ----------
    y : array_like of shape (..., N)
        Samples, N >= 2.
    k : float
        Threshold in standard deviations of the whole sample, 2.1 to 3 in practice.
    replace : {"neighbours", "mean"} or None
        What replaces an outlier: the mean of the nearest good measurements on both sides, the mean
        of the whole sample, or nothing (it is excluded).
    nan_policy : {"raise", "omit"}
        "omit": nan is 'no measurement'.
    n_threads : int, optional
        Number of threads; by default one for small tasks and all cores for large ones.

    Returns
    -------
    Screening

    Raises
    ------
    ValueError
        Fewer than 2 measurements, one that is not finite, deviations too large or too small to be
        squared, k <= 0, an unknown word, or too few measurements left.
    TypeError
        `y` does not hold real numbers.

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
    """Find single outliers and bursts (runs of outliers on one side) together.

    Starts from median and MAD, finds by dynamic programming the points and segments whose removal
    explains most (collective and point anomaly detection), refits mean and standard deviation to
    the rest, and repeats. The cost is O(N max_burst).

    Parameters
    ----------
    y : array_like of shape (..., N)
        Samples, N >= 3; 30 or more for the error rates of the documentation.
    point_penalty, burst_penalty : float
        How much a single outlier and a burst must explain, in units of `ln max(N, 30)`. Smaller
        penalties are more sensitive: (2.0, 2.5) finds more, and flags more of a clean sample.
    min_burst, max_burst : int
        Shortest (>= 2) and longest (at most 100 000) burst, in measurements.
    correlation : float
        Correlation of successive measurements in a quiet record, between -1 and 1. Correlated noise
        looks like bursts unless its correlation is given.
    rounding : float
        Step to which the measurements were rounded, in the unit of y; 0: none, or unknown. The
        variance of rounding, `rounding**2 / 12`, is added to that of the noise. If it is unknown
        and more than half of the measurements are equal, the distance to the nearest different one
        is taken as the step.
    nan_policy : {"raise", "omit"}
        "omit": nan is 'no measurement'.
    n_threads : int, optional
        Number of threads; by default one for small tasks and all cores for large ones.

    Returns
    -------
    Screening
        Outliers are excluded; `threshold` is that of a single outlier. Nothing is flagged if fewer
        than 5 measurements or less than a quarter of the sample would be left.

    Raises
    ------
    ValueError
        Fewer than 3 measurements, one that is not finite, or a parameter outside its domain.
    TypeError
        `y` does not hold real numbers.

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
    """Find outliers of a series that moves, by comparing each measurement with its neighbours.

    The others in its window determine a least-squares polynomial, from which the measurement
    deviates by e. The variance of that polynomial is h times that of the noise, and
    `z = e / sqrt(1 + h)`. An outlier has `|z| > k s` with `s = 1.4826 median |z|`, and the largest
    `|z|` within two places. It leaves, and all are judged again, up to three times; outliers that
    agree with what is left return.

    Parameters
    ----------
    y : array_like of shape (..., N)
        Measurements in the order of time; nan where there is none.
    window : int
        Number of instants in a window, odd. Each instant is in the middle of its window; near the
        ends, the first and the last window are used.
    degree : int
        Degree of the polynomials, at most 9 and less than `window` - 3.
    k : float
        Threshold in standard deviations.
    time : array_like of shape (N,) or (..., N), optional
        Times of the measurements, in non-decreasing order; by default 0, 1, 2, ...
    period : float, optional
        360.0 or 2*pi for angles, which must move by less than half a period in half a window.
    n_threads : int, optional
        Number of threads; by default one for small tasks and all cores for large ones.

    Returns
    -------
    Screening
        Outliers are replaced by the polynomials; `variance` is that of the noise about these, s²,
        and `threshold` is k s. A measurement with fewer than `degree` + 3 good ones in its window
        is not judged. Where no measurement is judged, `variance` and `threshold` are nan, and so is
        `mean` where there is none.

    Raises
    ------
    ValueError
        An infinite measurement, decreasing times, shapes that do not fit, or a parameter outside
        its domain.
    TypeError
        `y` or `time` does not hold real numbers.

    Notes
    -----
    Outliers that follow each other for more than a quarter of a window determine the polynomials:
    for a value that stays, `bursts` finds these. The cost is O(N window degree).

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

    Whole periods are added until every angle is within half a period of the circular mean, then of
    the median of the result; the first angle decides on which turn the result lies. Nearly half of
    the angles may be wrong without moving the others. (`numpy.unwrap` compares neighbours, so one
    wrong angle moves all that follow.)

    Parameters
    ----------
    theta : array_like of shape (..., N)
        Angles, N >= 1.
    period : float
        360.0 for degrees, 2*pi for radians.
    n_threads : int, optional
        Number of threads; by default one for small tasks and all cores for large ones.

    Returns
    -------
    ndarray of shape (..., N)
        Angles that can be averaged, in the unit of `theta`.

    Raises
    ------
    ValueError
        No angles, one that is not finite, or period <= 0.
    TypeError
        `theta` does not hold real numbers.

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
