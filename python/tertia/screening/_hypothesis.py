"""Tests of a single measurement, of the most extreme one, and of the largest variance."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from tertia import _core
from tertia._arrays import (
    BoolArray,
    FloatArray,
    IntArray,
    common_batch,
    finite,
    integer,
    positive,
    real,
    samples,
    scalar_or_array,
)
from tertia._result import Result

TestName: TypeAlias = Literal[
    "leave-one-out", "z-test", "t-test", "thompson-tau", "grubbs", "cochran"
]


@dataclass(frozen=True, slots=True, eq=False)
class OutlierTest(Result):
    """A test of single measurements.

    Attributes
    ----------
    statistic : float or ndarray
        The test statistic.
    pvalue : float or ndarray
        Probability that the statistic is at least as large as this one if the measurement is not an
        outlier.
    """

    _rows: ClassVar = "statistic", 0

    statistic: float | FloatArray
    pvalue: float | FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class ExtremeTest(Result):
    """A test of the most extreme of several values.

    Attributes
    ----------
    index : int or ndarray of int
        Index, along the last axis, of the most extreme value.
    statistic : float or ndarray
        The test statistic.
    pvalue : float or ndarray
        Probability that the statistic is at least as large as this one if no value is an outlier.
    critical_value : float
        Threshold of the statistic at the chosen significance.
    outlier : bool or ndarray of bool
        Whether the statistic exceeds the threshold.
    """

    _rows: ClassVar = "index", 0
    _omitted: ClassVar = ("outlier",)

    index: int | IntArray
    statistic: float | FloatArray
    pvalue: float | FloatArray
    critical_value: float
    outlier: bool | BoolArray


def z_test(x: npt.ArrayLike, y: npt.ArrayLike, sigma: npt.ArrayLike) -> OutlierTest:
    """Test whether x is an outlier compared with measurements y of known standard deviation.

    By equation (R1), the statistic is `t = |x - mean(y)| / (sigma sqrt((n+1)/n))`. If x comes from
    the same distribution as the n measurements y, t is the absolute value of a standard normal
    variable.

    Parameters
    ----------
    x : array_like of shape (...)
        Measurements to test; they are not among y.
    y : array_like of shape (..., n)
        The other measurements, n >= 1. `x` and `y[..., 0]` broadcast against each other.
    sigma : array_like of shape (...)
        Standard deviation of one measurement, in the unit of y; broadcast in the same way.

    Returns
    -------
    OutlierTest
        `statistic` t and `pvalue`, each of shape (...).

    Raises
    ------
    ValueError, TypeError
        If y is empty, a value is not finite, sigma <= 0, shapes do not broadcast, or an argument
        does not hold real numbers.

    Examples
    --------
    >>> from tertia.screening import z_test
    >>> test = z_test(12.6, [10.1, 9.8, 10.3, 10.0, 9.9], sigma=1.0)
    >>> round(test.statistic, 4), round(test.pvalue, 4)
    (2.3552, 0.0185)
    """
    x, y, sigma = finite(x, "x"), samples(y, "y"), positive(sigma, "sigma")
    batch = common_batch(x=x.shape, y=y.shape[:-1], sigma=sigma.shape)
    result = _core.z_test(_flat(x, batch), _rows(y, batch), y, _flat(sigma, batch))
    return _outlier_test(result, batch)


def t_test(x: npt.ArrayLike, y: npt.ArrayLike) -> OutlierTest:
    """Test whether x is an outlier compared with other measurements y.

    The statistic of equations (R2) and (R3) is `t = |x - mean(y)| / s`, where s is the standard
    deviation of the n measurements y, which is estimated from them. If x comes from the same
    distribution as y, `t sqrt(n/(n+1))` is the absolute value of a variable that has Student's
    distribution with n - 1 degrees of freedom.

    Parameters
    ----------
    x : array_like of shape (...)
        Measurements to test; they are not among y.
    y : array_like of shape (..., n)
        The other measurements, n >= 2. `x` and `y[..., 0]` broadcast against each other.

    Returns
    -------
    OutlierTest
        `statistic` t and `pvalue`, each of shape (...).

    Raises
    ------
    ValueError, TypeError
        If y has fewer than 2 measurements, a value is not finite, shapes do not broadcast, or an
        argument does not hold real numbers.

    Examples
    --------
    >>> from tertia.screening import t_test
    >>> round(t_test(10.8, [10.1, 9.8, 10.3, 10.0, 9.9]).pvalue, 4)
    0.0208
    """
    x, y = finite(x, "x"), samples(y, "y")
    batch = common_batch(x=x.shape, y=y.shape[:-1])
    return _outlier_test(_core.t_test(_flat(x, batch), _rows(y, batch), y), batch)


def thompson_tau(y: npt.ArrayLike) -> OutlierTest:
    """Test every measurement of a sample as if it had been chosen beforehand.

    The statistic is `|y_i - M| / sqrt(D)`, with M and D the mean and the variance of the sample.
    The p-value is exact for a measurement that was not chosen because of its deviation. To test the
    measurement that deviates most, use `grubbs`.

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
    ValueError, TypeError
        If there are fewer than 3 measurements, one is not finite, or `y` does not hold real
        numbers.

    Examples
    --------
    >>> from tertia.screening import thompson_tau
    >>> thompson_tau([9.8, 10.1, 10.0, 12.0]).pvalue < 0.05
    array([False, False, False,  True])
    """
    return OutlierTest(*_core.thompson_tau(samples(y, "y")))


def grubbs(y: npt.ArrayLike, significance: float = 0.05) -> ExtremeTest:
    """Test the measurement of a sample that deviates most from the mean.

    Grubbs' statistic is `G = max |y_i - M| / sqrt(D)`, two-sided, with M and D the mean and the
    variance of the sample. The p-value is computed with Bonferroni's inequality: it is exact if `G
    > sqrt((N-1)/2)`, and an upper bound otherwise.

    Parameters
    ----------
    y : array_like of shape (..., N)
        Samples, N >= 3.
    significance : float
        Probability of an alarm in a sample without outliers.

    Returns
    -------
    ExtremeTest
        Fields of shape (...).

    Raises
    ------
    ValueError, TypeError
        If there are fewer than 3 measurements, one is not finite, or the significance is outside
        (0, 1), or `y` does not hold real numbers.

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

    Cochran's statistic is `C = max d_j / sum d_j` for L variances d_j with the same degrees of
    freedom. The p-value is computed with Bonferroni's inequality: it is exact if `C > 1/2`, and an
    upper bound otherwise.

    Parameters
    ----------
    variances : array_like of shape (..., L)
        Sample variances, L >= 2.
    degrees_of_freedom : float
        Number of measurements from which each variance was computed, minus one.
    significance : float
        Probability of an alarm if all variances are equal.

    Returns
    -------
    ExtremeTest
        Fields of shape (...).

    Raises
    ------
    ValueError, TypeError
        If there are fewer than 2 variances, one is negative or not finite, all are zero, the
        degrees of freedom are not between 1 and 1e9, the significance is outside (0, 1), or
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
    """Return the threshold of a test at a given significance; inverse of `false_alarm_probability`.

    Parameters
    ----------
    n : int
        Number of variances for "cochran"; number of measurements y for "z-test" and "t-test";
        number of measurements in the sample for the other tests.
    significance : float
        Probability of flagging a good measurement; for "grubbs" and "cochran", of an alarm in a
        sample without outliers.
    test : {"leave-one-out", "z-test", "t-test", "thompson-tau", "grubbs", "cochran"}
        The function whose threshold is returned; for "leave-one-out" it is the k of
        `leave_one_out`.
    degrees_of_freedom : float
        Degrees of freedom of each variance, 1 to 1e9, for "cochran" only.

    Returns
    -------
    float
        The threshold. It is exact for the first four tests. For "grubbs" and "cochran" it is exact
        if two values cannot both exceed it; otherwise it is slightly too large, and the false-alarm
        rate is below the significance.

    Raises
    ------
    ValueError, TypeError
        If n is too small for the test, the significance is outside (0, 1), the test is unknown, or
        a number has the wrong type.

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
    """Return the probability that a test with threshold k flags a good measurement.

    This is the inverse of `critical_value`. For "leave-one-out" with frozen statistics, every good
    measurement is flagged with the probability `2 P(t_{n-2} > k sqrt((n-1)/n))`, where t_{n-2} has
    Student's distribution with n - 2 degrees of freedom.

    Parameters
    ----------
    k : float
        Threshold of the test.
    n : int
        As for `critical_value`.
    test : {"leave-one-out", "z-test", "t-test", "thompson-tau", "grubbs", "cochran"}
        As for `critical_value`.
    degrees_of_freedom : float
        Degrees of freedom of each variance, 1 to 1e9, for "cochran" only.

    Returns
    -------
    float
        Probability of flagging a good measurement; for "grubbs" and "cochran", of an alarm in a
        sample without outliers.

    Raises
    ------
    ValueError, TypeError
        If n is too small for the test, k <= 0, the test is unknown, or a number has the wrong type.

    Examples
    --------
    >>> from tertia.screening import false_alarm_probability
    >>> round(false_alarm_probability(2.5, 10), 4), round(false_alarm_probability(2.5, 100), 4)
    (0.0451, 0.0146)
    """
    k, n = real(k, "k"), integer(n, "n", 1)
    return _core.false_alarm_probability(k, n, str(test), _optional(degrees_of_freedom))


def _optional(degrees_of_freedom: float | None) -> float | None:
    return None if degrees_of_freedom is None else real(degrees_of_freedom, "degrees_of_freedom")


def _outlier_test(result: tuple[FloatArray, FloatArray], batch: tuple[int, ...]) -> OutlierTest:
    return OutlierTest(*(scalar_or_array(field.reshape(batch)) for field in result))


def _extreme_test(result: tuple[IntArray, FloatArray, FloatArray], critical: float) -> ExtremeTest:
    index, statistic, pvalue = map(scalar_or_array, result)
    return ExtremeTest(index, statistic, pvalue, critical, statistic > critical)


def _flat(array: FloatArray, batch: tuple[int, ...]) -> FloatArray:
    return np.broadcast_to(array, batch).ravel()


def _rows(y: FloatArray, batch: tuple[int, ...]) -> IntArray:
    """Return the index of the row of y with which each element of the batch is compared."""
    own = y.shape[:-1]
    rows = np.arange(math.prod(own), dtype=np.int64).reshape(own)
    return np.broadcast_to(rows, batch).ravel()
