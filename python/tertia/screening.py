"""Screening: which measurements of a sample are anomalous.

Every function works along the last axis of an array of shape `(..., N)`; the leading axes are a
batch, processed in parallel where it is worth it. Results do not depend on the number of threads.

Sources: Manoilov, Pysarchuk, Pavliuk 2006, equations (M1)-(M4); Motylev 2010, equations (R1)-(R3);
Fisch, Eckley, Fearnhead 2022 for points and bursts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from tertia import _core
from tertia._arrays import (
    BoolArray,
    FloatArray,
    IntArray,
    NanPolicy,
    finite,
    flag,
    integer,
    omits,
    positive,
    real,
    samples,
    scalar_or_array,
    threads,
)

__all__ = [
    "ExtremeTest",
    "OutlierTest",
    "Screening",
    "TestName",
    "bursts",
    "cochran",
    "critical_value",
    "false_alarm_probability",
    "grubbs",
    "k_sigma",
    "leave_one_out",
    "leave_one_out_mask",
    "leave_one_out_statistics",
    "t_test",
    "thompson_tau",
    "unwrap_about_median",
    "z_test",
]

TestName: TypeAlias = Literal[
    "leave-one-out", "z-test", "t-test", "thompson-tau", "grubbs", "cochran"
]


@dataclass(frozen=True, slots=True, eq=False)
class Screening:
    """What a screening found in samples of shape `(..., N)`.

    Attributes
    ----------
    outlier : ndarray of bool, shape (..., N)
        Whether a measurement is anomalous.
    cleaned : ndarray of shape (..., N)
        The sample with the anomalous measurements replaced, or nan where they are excluded.
    mean, variance : float or ndarray of shape (...)
        Mean and variance (divisor n - 1) of the cleaned sample; unit of y and its square.
    threshold : float or ndarray of shape (...)
        Half width of the band about the mean outside which a measurement is anomalous; unit of y.
        In a sequential screening the band moves: this is the final one.
    """

    outlier: BoolArray
    cleaned: FloatArray
    mean: float | FloatArray
    variance: float | FloatArray
    threshold: float | FloatArray

    def __repr__(self) -> str:
        """Tell the counts and the numbers, not the arrays."""
        found = f"{np.count_nonzero(self.outlier)} of {self.outlier.size} anomalous"
        if self.outlier.ndim > 1:
            return f"Screening({found}, batch {self.outlier.shape[:-1]})"
        numbers = (
            f"mean {self.mean:.6g}, variance {self.variance:.6g}, threshold {self.threshold:.6g}"
        )
        return f"Screening({found}, {numbers})"


@dataclass(frozen=True, slots=True, eq=False)
class OutlierTest:
    """A test of single measurements.

    Attributes
    ----------
    statistic : float or ndarray
        The test statistic.
    pvalue : float or ndarray
        Probability of a statistic at least as large if the measurement is not anomalous.
    """

    statistic: float | FloatArray
    pvalue: float | FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class ExtremeTest:
    """A test of the most extreme of several values.

    Attributes
    ----------
    index : int or ndarray of int
        Which value along the last axis is the most extreme.
    statistic : float or ndarray
        The test statistic.
    pvalue : float or ndarray
        Probability of a statistic at least as large if no value is anomalous.
    critical_value : float
        The statistic above which the value is anomalous at the significance asked for.
    outlier : bool or ndarray of bool
        Whether the statistic is above the critical value.
    """

    index: int | IntArray
    statistic: float | FloatArray
    pvalue: float | FloatArray
    critical_value: float
    outlier: bool | BoolArray


def leave_one_out_statistics(
    y: npt.ArrayLike, *, n_threads: int | None = None
) -> tuple[FloatArray, FloatArray]:
    """Mean and variance of the others, for every measurement.

    Equations (M2) and (M3): `M'_i` is the mean and `D'_i` the variance (divisor N - 2) of the
    sample without `y_i`. The cost is O(N); where a value makes up more than half of the sum of
    squares, the others are summed anew, so nothing is lost to cancellation.

    Parameters
    ----------
    y : array_like of shape (..., N)
        Samples, N >= 3.
    n_threads : int, optional
        Threads to use; by default one for little work and all cores for much.

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
    """Whether each measurement is anomalous against the others: the fastest screening.

    The mask of `leave_one_out(y, k, statistics="frozen")` and nothing else: the rule
    `|y_i - M'_i| > k sqrt(D'_i)` is exactly `|y_i - M| > c sqrt(D)` with a constant
    `c(k, N) = k (N-1)^(3/2) / sqrt(N (N (N-2) + k^2 (N-1)))`, so two streaming reads are enough.

    Parameters
    ----------
    y : array_like of shape (..., N)
        Samples, N >= 3.
    k : float
        Threshold in standard deviations of the others; see `false_alarm_probability`.
    n_threads : int, optional
        Threads to use; by default one for little work and all cores for much.

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
    """Find anomalous measurements by comparing each with the mean and variance of the others.

    Equations (M2)-(M4): `y_i` is anomalous if `|M'_i - y_i| > k sqrt(D'_i)`.

    Parameters
    ----------
    y : array_like of shape (..., N)
        Samples, N >= 3.
    k : float
        Threshold in standard deviations of the others. A clean one is flagged with probability
        `false_alarm_probability(k, N)`; `critical_value(N, significance)` is the inverse.
    statistics : {"sequential", "frozen"}
        "sequential", as in the paper: a measurement found anomalous leaves the statistics at once,
        so later ones are compared with a cleaner sample. "frozen": all are compared with the sample
        as it came.
    direction : {"forward", "backward"}
        Direction of a sequential pass. Which measurements are found depends on it.
    replace : bool
        Replace an anomalous measurement by `M'_i`; if False, exclude it.
    passes : int
        Largest number of passes; they end early when nothing more is found.
    nan_policy : {"raise", "omit"}
        "omit": nan is 'no measurement'.
    n_threads : int, optional
        Threads to use; by default one for little work and all cores for much.

    Returns
    -------
    Screening

    Raises
    ------
    ValueError
        Fewer than 3 measurements, one that is not finite, deviations too large or too
        small to be squared, k <= 0, an unknown word, fewer than 2
        measurements left, or several passes with a k that lets them eat the whole sample (below 2.5
        with, 1.7321 without replacement).
    TypeError
        `y` does not hold real numbers.

    Examples
    --------
    >>> from tertia.screening import leave_one_out
    >>> y = [12.4, 11.8, 40.0, 12.1, 12.9, 11.5, 20.0, 12.2, 12.0, 11.9]
    >>> screening = leave_one_out(y)
    >>> screening
    Screening(2 of 10 anomalous, mean 12.1975, variance 0.213876, threshold 0.8457)
    >>> screening.outlier.nonzero()[0]
    array([2, 6])
    """
    return Screening(
        *_screened(
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
    )


def k_sigma(
    y: npt.ArrayLike,
    k: float = 3.0,
    *,
    replace: Literal["neighbours", "mean"] | None = "neighbours",
    nan_policy: NanPolicy = "raise",
    n_threads: int | None = None,
) -> Screening:
    """Find anomalous measurements by the classical rule `|y_i - M| > k sqrt(D)`.

    Equation (M1). In a sample of N nothing can deviate by more than `(N-1)/sqrt(N)` standard
    deviations, so with k = 3 nothing is ever found below N = 11; `leave_one_out` has no such limit.

    Parameters
    ----------
    y : array_like of shape (..., N)
        Samples, N >= 2.
    k : float
        Threshold in standard deviations of the whole sample, 2.1 to 3 in practice.
    replace : {"neighbours", "mean"} or None
        What takes the place of an anomalous measurement: the mean of the nearest measurements on
        both sides that are not anomalous, the mean of the whole sample, or nothing (excluded).
    nan_policy : {"raise", "omit"}
        "omit": nan is 'no measurement'.
    n_threads : int, optional
        Threads to use; by default one for little work and all cores for much.

    Returns
    -------
    Screening

    Raises
    ------
    ValueError
        Fewer than 2 measurements, one that is not finite, deviations too large or too
        small to be squared, k <= 0, an unknown word, or too few
        measurements left.
    TypeError
        `y` does not hold real numbers.

    Examples
    --------
    >>> from tertia.screening import k_sigma
    >>> k_sigma([9.8, 10.1, 10.0, 25.0, 10.2, 9.9], k=2).cleaned
    array([ 9.8, 10.1, 10. , 10.1, 10.2,  9.9])
    """
    return Screening(
        *_screened(
            _core.k_sigma(
                samples(y, "y"),
                real(k, "k"),
                None if replace is None else str(replace),
                omits(nan_policy),
                threads(n_threads),
            )
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
    """Find single anomalies and bursts of one polarity together.

    Starts from median and MAD, then finds by dynamic programming the points and segments whose
    removal explains most (collective and point anomaly detection), refits mean and standard
    deviation to the rest, and repeats. The cost is O(N max_burst).

    Parameters
    ----------
    y : array_like of shape (..., N)
        Samples, N >= 3; 30 or more are needed for the error rates of the documentation.
    point_penalty, burst_penalty : float
        What a single anomaly and a burst must explain, in units of `ln max(N, 30)`. Smaller is
        more sensitive: (2.0, 2.5) finds more and calls more of a clean sample anomalous.
    min_burst, max_burst : int
        Shortest (>= 2) and longest (at most 100 000) burst, in measurements.
    correlation : float
        Correlation of successive measurements in a quiet record, between -1 and 1. Correlated noise
        looks like bursts; with this it does not.
    rounding : float
        Step of the readings in the unit of y, 0: continuous or not known. A rounding variance of
        `rounding**2 / 12` is added to that of the noise. Where more than half of the readings
        are equal and it is not known, the nearest different reading tells it.
    nan_policy : {"raise", "omit"}
        "omit": nan is 'no measurement'.
    n_threads : int, optional
        Threads to use; by default one for little work and all cores for much.

    Returns
    -------
    Screening
        Anomalous measurements are excluded; `threshold` is that of a single anomaly. If fewer than
        5 measurements or a quarter of the sample would be left, nothing is flagged.

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
    return Screening(
        *_screened(
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
    )


def z_test(x: npt.ArrayLike, y: npt.ArrayLike, sigma: npt.ArrayLike) -> OutlierTest:
    """Test whether x is anomalous against the others y, the standard deviation being known.

    Equation (R1): `t = |x - mean(y)| / (sigma sqrt((n+1)/n))` is standard normal (two-sided) if x
    comes from the same distribution as the n measurements y.

    Parameters
    ----------
    x : array_like of shape (...)
        Measurements to test; they are not among y.
    y : array_like of shape (..., n)
        The others, n >= 1. `x` and `y[..., 0]` broadcast against each other.
    sigma : array_like of shape (...)
        Standard deviation of one measurement, in the unit of y; broadcasts likewise.

    Returns
    -------
    OutlierTest
        `statistic` t and `pvalue`, each of shape (...).

    Raises
    ------
    ValueError
        No others, a value that is not finite, sigma <= 0, or shapes that do not broadcast.
    TypeError
        An argument does not hold real numbers.

    Examples
    --------
    >>> from tertia.screening import z_test
    >>> test = z_test(12.6, [10.1, 9.8, 10.3, 10.0, 9.9], sigma=1.0)
    >>> round(test.statistic, 4), round(test.pvalue, 4)
    (2.3552, 0.0185)
    """
    x, y, sigma = finite(x, "x"), samples(y, "y"), positive(sigma, "sigma")
    batch = _batch({"x": x.shape, "y": y.shape[:-1], "sigma": sigma.shape})
    result = _core.z_test(_flat(x, batch), _rows(y, batch), y, _flat(sigma, batch))
    return _outlier_test(result, batch)


def t_test(x: npt.ArrayLike, y: npt.ArrayLike) -> OutlierTest:
    """Test whether x is anomalous against the others y, whose standard deviation is estimated.

    Equations (R2) and (R3): `t = |x - mean(y)| / s`, where s is the standard deviation of the n
    measurements y; `t sqrt(n/(n+1))` follows Student's distribution with n - 1 degrees of freedom.

    Parameters
    ----------
    x : array_like of shape (...)
        Measurements to test; they are not among y.
    y : array_like of shape (..., n)
        The others, n >= 2. `x` and `y[..., 0]` broadcast against each other.

    Returns
    -------
    OutlierTest
        `statistic` t and `pvalue`, each of shape (...).

    Raises
    ------
    ValueError
        Fewer than 2 others, a value that is not finite, or shapes that do not broadcast.
    TypeError
        An argument does not hold real numbers.

    Examples
    --------
    >>> from tertia.screening import t_test
    >>> round(t_test(10.8, [10.1, 9.8, 10.3, 10.0, 9.9]).pvalue, 4)
    0.0208
    """
    x, y = finite(x, "x"), samples(y, "y")
    batch = _batch({"x": x.shape, "y": y.shape[:-1]})
    return _outlier_test(_core.t_test(_flat(x, batch), _rows(y, batch), y), batch)


def thompson_tau(y: npt.ArrayLike) -> OutlierTest:
    """Test every measurement as if it had been chosen beforehand.

    The statistic is `|y_i - M| / sqrt(D)`; its p-value is exact for one measurement that was not
    chosen for its deviation. For the most deviating one use `grubbs`.

    Parameters
    ----------
    y : array_like of shape (..., N)
        Samples, N >= 3.

    Returns
    -------
    OutlierTest
        `statistic` and `pvalue`, each of shape (..., N).

    Raises
    ------
    ValueError
        Fewer than 3 measurements, or one that is not finite.
    TypeError
        `y` does not hold real numbers.

    Examples
    --------
    >>> from tertia.screening import thompson_tau
    >>> thompson_tau([9.8, 10.1, 10.0, 12.0]).pvalue < 0.05
    array([False, False, False,  True])
    """
    return OutlierTest(*_core.thompson_tau(samples(y, "y")))


def grubbs(y: npt.ArrayLike, significance: float = 0.05) -> ExtremeTest:
    """Test the most deviating measurement of a sample.

    Grubbs' statistic `G = max |y_i - M| / sqrt(D)`, two-sided. The p-value is Bonferroni's: exact
    while `G > sqrt((N-1)/2)`, otherwise an upper bound.

    Parameters
    ----------
    y : array_like of shape (..., N)
        Samples, N >= 3.
    significance : float
        Probability of calling a clean sample anomalous.

    Returns
    -------
    ExtremeTest
        Fields of shape (...).

    Raises
    ------
    ValueError
        Fewer than 3 measurements, one that is not finite, or a significance outside (0, 1).
    TypeError
        `y` does not hold real numbers.

    Examples
    --------
    >>> from tertia.screening import grubbs
    >>> test = grubbs([9.8, 10.1, 10.0, 25.0, 9.9])
    >>> test.index, test.outlier
    (3, True)
    """
    y = samples(y, "y")
    result = _core.grubbs(y)
    return _extreme_test(result, critical_value(y.shape[-1], significance, test="grubbs"))


def cochran(
    variances: npt.ArrayLike, degrees_of_freedom: float, significance: float = 0.05
) -> ExtremeTest:
    """Test the largest of several variances.

    Cochran's statistic `C = max d_j / sum d_j` for L variances with the same degrees of freedom.
    The p-value is Bonferroni's: exact while `C > 1/2`, otherwise an upper bound.

    Parameters
    ----------
    variances : array_like of shape (..., L)
        Sample variances, L >= 2.
    degrees_of_freedom : float
        Of each variance: the size of a group less one.
    significance : float
        Probability of calling equal variances different.

    Returns
    -------
    ExtremeTest
        Fields of shape (...).

    Raises
    ------
    ValueError
        Fewer than 2 variances, one that is negative or not finite, all zero, degrees of freedom
        not between 1 and 1e9, or a significance outside (0, 1).
    TypeError
        `variances` does not hold real numbers.

    Examples
    --------
    >>> from tertia.screening import cochran
    >>> test = cochran([0.18, 0.22, 7.9, 0.03, 0.09], degrees_of_freedom=3)
    >>> test.index, round(test.statistic, 3), test.outlier
    (2, 0.938, True)
    """
    variances = samples(variances, "variances")
    degrees = real(degrees_of_freedom, "degrees_of_freedom")
    result = _core.cochran(variances, degrees)
    count = variances.shape[-1]
    return _extreme_test(
        result, critical_value(count, significance, test="cochran", degrees_of_freedom=degrees)
    )


def critical_value(
    n: int,
    significance: float,
    *,
    test: TestName = "leave-one-out",
    degrees_of_freedom: float | None = None,
) -> float:
    """Threshold of a test at a significance significance; the inverse of `false_alarm_probability`.

    Parameters
    ----------
    n : int
        "z-test", "t-test": number of the others; "cochran": number of variances; else
        size of the sample.
    significance : float
        Probability of calling a clean measurement ("grubbs", "cochran": a clean sample) anomalous.
    test : str
        "leave-one-out": k of `leave_one_out`; "z-test": `z_test`; "t-test":
        `t_test`; "thompson-tau": `thompson_tau`; "grubbs": `grubbs`; "cochran": `cochran`.
    degrees_of_freedom : float
        Of each variance, 1 to 1e9, for "cochran" only.

    Returns
    -------
    float
        Exact for the first four. For "grubbs" and "cochran" exact as long as two values cannot be
        beyond it at once, else slightly large (the significance is not exceeded).

    Raises
    ------
    ValueError
        n too small for the test, a significance outside (0, 1), or an unknown test.
    TypeError
        A number of the wrong type.

    Examples
    --------
    >>> from tertia.screening import critical_value
    >>> round(critical_value(10, 0.05), 4)
    2.4307
    >>> round(critical_value(100, 0.05, test="grubbs"), 4)
    3.3841
    """
    n, significance = integer(n, "n", 1), real(significance, "significance")
    return _core.critical_value(n, significance, str(test), _optional(degrees_of_freedom))


def false_alarm_probability(
    k: float,
    n: int,
    *,
    test: TestName = "leave-one-out",
    degrees_of_freedom: float | None = None,
) -> float:
    """Probability that a test with threshold k calls a clean measurement anomalous.

    The inverse of `critical_value`. For the default test and frozen statistics it is
    `2 P(t_{n-2} > k sqrt((n-1)/n))` for every clean measurement.

    Parameters
    ----------
    k : float
        Threshold of the test.
    n : int
        As in `critical_value`.
    test : str
        As in `critical_value`.
    degrees_of_freedom : float
        Of each variance, 1 to 1e9, for "cochran" only.

    Returns
    -------
    float

    Raises
    ------
    ValueError
        n too small for the test, k <= 0, or an unknown test.
    TypeError
        A number of the wrong type.

    Examples
    --------
    >>> from tertia.screening import false_alarm_probability
    >>> round(false_alarm_probability(2.5, 10), 4), round(false_alarm_probability(2.5, 100), 4)
    (0.0451, 0.0146)
    """
    k, n = real(k, "k"), integer(n, "n", 1)
    return _core.false_alarm_probability(k, n, str(test), _optional(degrees_of_freedom))


def unwrap_about_median(
    theta: npt.ArrayLike, period: float = 360.0, *, n_threads: int | None = None
) -> FloatArray:
    """Unwrap angles about their circular median.

    The angles are turned by whole periods to within half a period of their circular mean, then of
    the median of the result, on the turn on which the first one lies. Up to nearly half of them may
    be wrong without moving the others.

    Parameters
    ----------
    theta : array_like of shape (..., N)
        Angles, N >= 1.
    period : float
        360.0 for degrees, 2*pi for radians.
    n_threads : int, optional
        Threads to use; by default one for little work and all cores for much.

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


def _screened(
    result: tuple[BoolArray, FloatArray, FloatArray, FloatArray, FloatArray],
) -> tuple[BoolArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    outlier, cleaned, mean, variance, threshold = result
    return (
        outlier,
        cleaned,
        scalar_or_array(mean),
        scalar_or_array(variance),
        scalar_or_array(threshold),
    )


def _outlier_test(result: tuple[FloatArray, FloatArray], batch: tuple[int, ...]) -> OutlierTest:
    statistic, pvalue = result
    return OutlierTest(
        scalar_or_array(statistic.reshape(batch)), scalar_or_array(pvalue.reshape(batch))
    )


def _extreme_test(result: tuple[IntArray, FloatArray, FloatArray], critical: float) -> ExtremeTest:
    index, statistic, pvalue = map(scalar_or_array, result)
    return ExtremeTest(index, statistic, pvalue, critical, statistic > critical)


def _batch(shapes: dict[str, tuple[int, ...]]) -> tuple[int, ...]:
    try:
        return np.broadcast_shapes(*shapes.values())
    except ValueError:
        text = ", ".join(f"{name} {shape}" for name, shape in shapes.items())
        raise ValueError(f"the batch shapes do not broadcast: {text}") from None


def _flat(array: FloatArray, batch: tuple[int, ...]) -> FloatArray:
    return np.broadcast_to(array, batch).ravel()


def _rows(y: FloatArray, batch: tuple[int, ...]) -> IntArray:
    """Which row of y each test of the batch is against."""
    own = y.shape[:-1]
    rows = np.arange(math.prod(own), dtype=np.int64).reshape(own)
    return np.broadcast_to(rows, batch).ravel()


def _optional(degrees_of_freedom: float | None) -> float | None:
    return None if degrees_of_freedom is None else real(degrees_of_freedom, "degrees_of_freedom")
