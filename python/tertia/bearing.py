"""Bearing: estimation of one angle and its standard deviation from a sample of measured angles.

The source is Manoilov, Pysarchuk, Pavliuk 2006, stages 1 to 3.2 and equations (M5)-(M7). Its
algorithm is available as printed (`method="paper"`) and with corrections (`method="corrected"`).
The default method, "robust", is more accurate than both and remains reliable if up to 40 percent of
the measurements are outliers; its sigma allows for time-correlated noise. If the sigma of the
measurements is stated, one measurement is enough.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from tertia import _core
from tertia._arrays import (
    SMALLEST,
    BoolArray,
    FloatArray,
    NanPolicy,
    Systematic,
    array_of,
    integer,
    lies_between,
    omits,
    real,
    require_between,
    samples,
    scalar_or_array,
    threads,
)
from tertia._repeats import repeated
from tertia._result import Result

__all__ = ["BearingEstimate", "Method", "estimate_bearing"]

# fewest measurements without a stated sigma
_FEWEST = 5
# fewer independent measurements, and a larger correlation, are a drift
_FEW_INDEPENDENT, _LEAST_CORRELATION = 3.0, 0.3

Method: TypeAlias = Literal["robust", "corrected", "paper", "k-sigma", "mean"]


@dataclass(frozen=True, slots=True, eq=False)
class BearingEstimate(Result):
    """A bearing, its standard deviation, and the outliers of the sample.

    Attributes
    ----------
    value : float or ndarray of shape (...)
        The bearing, in [0, period) if there is a period.
    sigma : float or ndarray of shape (...)
        Standard deviation of the bearing. If all measurements are equal, the size of their errors
        cannot be estimated from the sample: with the method "robust", `sigma` is then inf unless
        `rounding` or the sigma of the measurements is given; with the other methods, it is 0.
    systematic : {"given", "estimated", "not included"}
        How `sigma` treats systematic errors: it includes the given `bias_sigma`, it includes one
        that was estimated from the differences between groups, or it includes none because there
        were no groups to compare.
    bias_sigma : float or ndarray of shape (...)
        Standard deviation of the systematic error of a group; nan if it is not included in `sigma`.
    outlier : ndarray of bool, shape (..., N)
        True for outliers, including all measurements of a rejected block. With method "robust", a
        measurement is an outlier if it is more probably bad than good, or if it repeats the one
        before it and such repetitions are too many to be due to rounding.
    polarity : float or ndarray of shape (...)
        `(N+ - N-) / N`, where N+ is the number of outliers above the bearing and N- the number of
        outliers below it.
    pvalue : float or ndarray of shape (...)
        P-value of the test that the blocks agree or, with groups and a given `bias_sigma`,
        whether the groups agree. With a stated sigma and no groups, p-value of the chi-square test
        whether the scatter agrees with it. If it is below 0.05, `sigma` has been increased
        accordingly. It is nan if there is nothing to compare, and for all methods except "robust".
    correlation : float or ndarray of shape (...)
        Correlation of successive measurements, given or estimated; nan if all measurements are
        equal.
    effective_number : float or ndarray of shape (...)
        Number of independent measurements that would give the same variance as this sample if there
        were no systematic errors. If it is small, the measurements change slowly; see `drifts`.
    noise_factor : float or ndarray of shape (...)
        Standard deviation of the noise divided by the stated one, at least 1; nan if none is
        stated.
    block_means, block_variances, block_weights : ndarray of shape (..., L) or None
        Mean, variance and weight of each block as used in the estimate. The means are unwrapped
        angles, and the sum of the weights is one. The mean of a block is nan if it has no
        measurements, and its variance is nan if it has fewer than two. These attributes are None if
        the method does not use blocks.
    """

    _rows: ClassVar = "value", 0
    _omitted: ClassVar = ("outlier", "block_means", "block_variances", "block_weights")

    value: float | FloatArray
    sigma: float | FloatArray
    systematic: Systematic
    bias_sigma: float | FloatArray
    outlier: BoolArray
    polarity: float | FloatArray
    pvalue: float | FloatArray
    correlation: float | FloatArray
    effective_number: float | FloatArray
    noise_factor: float | FloatArray
    block_means: FloatArray | None
    block_variances: FloatArray | None
    block_weights: FloatArray | None

    @property
    def drifts(self) -> BoolArray:
        """Whether the measurements change so slowly that they are worth fewer than three.

        The finder drifts, the target moves, or the noise is correlated over the whole sample. The
        error of the mean may then be larger than `sigma` implies.
        """
        few = np.asarray(self.effective_number) < _FEW_INDEPENDENT
        return np.asarray(few & (np.asarray(self.correlation) > _LEAST_CORRELATION))

    def __repr__(self) -> str:
        """Show numbers, not arrays."""
        found = f"outliers {np.count_nonzero(self.outlier)} of {self.outlier.size}"
        note = ", values drift" if self.drifts.any() else ""
        note += ", systematic error not included" if self.systematic == "not included" else ""
        if self.outlier.ndim > 1:
            return f"BearingEstimate(batch {self.outlier.shape[:-1]}, {found}{note})"
        return (
            f"BearingEstimate({self.value:.6g} ± {self.sigma:.3g}, {found}, "
            f"polarity {self.polarity:+.3g}{note})"
        )


def estimate_bearing(
    theta: npt.ArrayLike,
    *,
    sigma: npt.ArrayLike | None = None,
    period: float | None = 360.0,
    bias_sigma: float | None = None,
    groups: npt.ArrayLike | None = None,
    method: Method = "robust",
    block_size: int = 10,
    k: float = 2.5,
    variance_test: Literal["cochran", "student"] | float | None = "cochran",
    significance: float = 0.05,
    correlation: float | None = None,
    rounding: float = 0.0,
    nan_policy: NanPolicy = "raise",
    n_threads: int | None = None,
) -> BearingEstimate:
    """Estimate a bearing and its standard deviation from measurements with outliers.

    The angles are first unwrapped about their circular median, and the result is wrapped back.
    Bearings near north therefore need no special treatment.

    Parameters
    ----------
    theta : array_like of shape (..., N)
        Measured bearings in time order. N must be at least 5 for the method "robust" (1 if `sigma`
        is given), 2 for "mean", and 3 for the other methods.
    sigma : float or array_like of shape (N,) or (..., N), optional
        Standard deviation of the random error of each measurement, in the unit of `theta`, as the
        maker or a calibration states it; only with the method "robust". The measurements are
        weighted with it. The sigma of the bearing is then never smaller than the stated sigma
        allows, however well a few measurements agree. It is larger if their scatter contradicts the
        stated sigma, if they are correlated, or if it is doubtful which of them are outliers. By
        default, the noise is estimated from the scatter.
    period : float or None
        Period of the angles: 360.0 for degrees, 2*pi for radians, None for data that do not wrap.
    bias_sigma : float or None
        Standard deviation of the systematic error that all measurements of a group share, in the
        unit of `theta`; without `groups`, all measurements share one error. 0 means that there is
        no systematic error, and inf means that nothing is known about it. If it is None, the
        standard deviation is estimated from the differences between the groups. If there are no
        groups, no systematic error is then included.
    groups : array_like of shape (N,) or (..., N), optional
        Labels of the measurements. Measurements that share a systematic error have the same label,
        for example those taken at one stop, in one hour, or in one sector of directions. The
        estimated bearing is then the mean of the means of the groups. `sigma` allows for errors
        that are correlated between successive groups, in the order in which the groups first
        appear. An error that all groups share, such as a misaligned north, has no effect on their
        differences. Groups are allowed only with the method "robust".
    method : {"robust", "corrected", "paper", "k-sigma", "mean"}
        "robust": the mean of the results under several hypotheses, weighted by their likelihoods:
        no outliers; outliers on one side; outliers on both sides; outliers with a wide distribution
        about the good measurements. Outliers may be isolated or in bursts.
        "paper": the algorithm as printed. It screens the measurements by leaving one out at a time,
        replaces blocks with an outlying mean or variance, weights block j by 1/d_j, where d_j is
        its variance, and computes sigma by (M7). This sigma is not the standard deviation of the
        bearing; see the documentation.
        "corrected": like "paper", but bad blocks are excluded, not replaced. The means of the
        blocks are checked by Grubbs' test and their variances by an exact test, and sigma is
        correct.
        "k-sigma": the mean of the measurements y with `|y - M| <= k sqrt(D)`, where M and D are the
        mean and the variance of all measurements.
        "mean": the mean of all measurements.
    block_size : int
        Number of consecutive measurements per block, at least 2. If the number of measurements is
        not a multiple of it, the last block also contains the remaining measurements.
    k : float
        Threshold of the screening, in standard deviations, in the methods "paper", "corrected" (k1
        of the paper) and "k-sigma".
    variance_test : {"cochran", "student"}, float or None
        How the methods "paper" and "corrected" decide whether the variance d_j of a block is too
        large. With "cochran", the exact F test at `significance` decides. With a number k2 >= 1,
        the variance is too large if `d_j > k2 / sum(1/d_j)`. With "student", the same rule is
        applied with the k2 of the paper; this nearly always rejects a block without outliers, and
        is for demonstration only. With None, no block is rejected because of its variance.
    significance : float
        False-alarm rate of the tests that compare the blocks.
    correlation : float or None
        Correlation of successive measurements in a record without outliers; a positive correlation
        increases `sigma`. 0 means no correlation. If it is None, the method "robust" estimates the
        correlation, and the other methods assume 0. The method "paper" ignores this parameter.
    rounding : float
        Step to which the measurements were rounded, in their unit. If it is 0, the step is unknown,
        and the method "robust" estimates it from equal measurements. If `sigma` is given, steps of
        more than four sigmas are recognised only if three to five measurements or more show that
        they are powers of ten, or the smallest difference, up to ten sigmas. If the noise
        is smaller than the step, the sigma of the bearing is at least the standard deviation of the
        rounding error.
    nan_policy : {"raise", "omit"}
        How to treat nan. With "raise", nan is an error. With "omit", nan means 'no measurement',
        and the blocks are formed from the remaining measurements.
    n_threads : int, optional
        Number of threads; by default one for small tasks and all cores for large ones.

    Returns
    -------
    BearingEstimate
        The bearing and its standard deviation, in the unit of `theta`.

    Raises
    ------
    ValueError
        If there are too few measurements, before or after the rejection of outliers; if one is not
        finite; if deviations are too large or too small to be squared; if a parameter of the chosen
        method is outside its domain (those of other methods are ignored); or if a string is not
        one of the allowed values.
    TypeError
        If an argument has the wrong type.

    Notes
    -----
    **Hypotheses.** Each hypothesis is a mixture `(1 - e) N(mu, s^2) + sum e_j N(mu + d_j, t_j^2)`
    of good measurements and one or two kinds of bad measurements. The mixture is fitted by the EM
    algorithm [1]_, which starts from the shortest interval that contains half of the sample. For
    bursts, the same mixture is fitted as a Markov chain whose states persist [2]_. The weights are
    `exp(l - 0.4 k ln N)`, where l is the log-likelihood and k the number of parameters; this
    penalty is weaker than Schwarz's [3]_. The variance of the bearing is the weighted mean of the
    variances under the hypotheses, which are computed from the outer products of the scores, plus
    the variance of the results between the hypotheses. For the latter, the weights have half that
    penalty, because hypotheses that are too doubtful to contribute to the mean may still be true.
    If bad measurements beside the good ones form no peak of their own, all of them may be good,
    with skewed noise: sigma then includes the distance to their mean.

    **Repeated values.** A stuck instrument, or rows that were recorded several times, give the same
    number again and again. If all changes are a multiple of r > 1 measurements apart, only one of r
    counts. Otherwise let m be the median difference of successive different measurements, in units
    of `rounding` or of the smallest difference of any two. A measurement is equal to the one before
    it by chance in at most one of 2 m cases; if m is below 4, the chance is that of normal
    differences, of which the numbers of those by one and by two steps are known. If there are
    significantly more repetitions, also of rare values, only the first of equal successive
    measurements counts, or if m is below 4, as many as the EM algorithm finds not to be copies.

    **Correlation.** For each hypothesis, the posterior of the lag-one correlation of the good
    measurements is computed exactly. In the prior, the correlation is zero with a probability of
    one half, and otherwise uniform between -0.5 and 0.99. For sigma, the noise may also be
    white noise with slow noise in addition: 1/f noise [6]_ with a prior probability of 0.1, or a
    Gauss-Markov process (AR(1) with a time of 2, 4, 8 ... steps) with one of 0.2.

    **Slow changes.** If the good measurements are correlated and `correlation` is None, the same
    hypotheses are also fitted to the deviations from a level that changes slowly, in straight lines
    between the levels of blocks. These are treated as an AR(1) process, and count by their
    likelihood. A drift is therefore not mistaken for outliers. The bearing is the mean over the
    whole sample, and its variance is that of the mean of such a process: it is assumed that the
    true bearing is constant and that the finder drifts.

    **Stated sigma.** With the noise factor f, a measurement of the sigma s is normal with the
    standard deviation f s, or with a probability of 0.1 an outlier anywhere within 20 f m, where m
    is the median of the stated sigmas. For each maximum of this likelihood, the EM algorithm gives
    the bearing, and the observed information [5]_ its variance. The bearing is the mean over the
    maxima, weighted with the likelihood and the root of the variance; their differences are part of
    the variance. With n degrees of freedom and the sum Q of the squared residuals of good
    measurements, in stated sigmas, ``f**2 = max(1, (5 + Q) / (5 + n))``: the stated variance counts
    as much as five degrees of freedom. If `correlation` is None, it is estimated from five or more
    good measurements, and only increases the variance.

    **Groups.** The systematic errors of the groups are random effects. Their standard deviation has
    a half-Cauchy prior [4]_, whose scale is the standard deviation of one measurement. The
    correlation of successive groups is treated as unknown, too, and is described by its posterior.

    References
    ----------
    .. [1] A. P. Dempster, N. M. Laird, D. B. Rubin. Maximum likelihood from incomplete data via the
       EM algorithm. J. R. Stat. Soc. B 39 (1977) 1-38.
    .. [2] L. E. Baum, T. Petrie, G. Soules, N. Weiss. A maximization technique occurring in the
       statistical analysis of probabilistic functions of Markov chains. Ann. Math. Stat. 41 (1970)
       164-171.
    .. [3] G. Schwarz. Estimating the dimension of a model. Ann. Stat. 6 (1978) 461-464.
    .. [4] A. Gelman. Prior distributions for variance parameters in hierarchical models. Bayesian
       Analysis 1 (2006) 515-534.
    .. [5] T. A. Louis. Finding the observed information matrix when using the EM algorithm. J. R.
       Stat. Soc. B 44 (1982) 226-233.
    .. [6] A. van der Ziel. On the noise spectra of semi-conductor noise and of flicker effect.
       Physica 16 (1950) 359-372.

    Examples
    --------
    >>> import tertia
    >>> record = tertia.simulate.direction_finder(100, bearing=359.0, rng=7)
    >>> tertia.estimate_bearing(record.theta, bias_sigma=1.0)
    BearingEstimate(358.476 ± 1.06, outliers 2 of 100, polarity -0.02)

    Three bearings with a stated sigma of 2 degrees, one of them wrong:

    >>> tertia.estimate_bearing([44.0, 46.5, 80.0], sigma=2.0)
    BearingEstimate(45.25 ± 1.42, outliers 1 of 3, polarity +0.333, systematic error not included)
    """
    theta = samples(theta, "theta")
    labels = None if groups is None else _numbered(groups, theta.shape)
    stated = None if sigma is None else _of_each(sigma, theta.shape)
    for name, given in (("groups", labels), ("sigma", stated)):
        if given is not None and method != "robust":
            verb = "need" if name == "groups" else "needs"
            raise ValueError(f"{name} {verb} method='robust'; method is {method!r}")
    options: dict[str, Any] = {
        "period": None if period is None else real(period, "period"),
        "method": str(method),
        "block_size": integer(block_size, "block_size", 2),
        "k": real(k, "k"),
        "variance_test": _variance_test(variance_test),
        "significance": real(significance, "significance"),
        "correlation": None if correlation is None else real(correlation, "correlation"),
        "rounding": real(rounding, "rounding"),
        "bias_sigma": None if bias_sigma is None else _bias(bias_sigma),
    }
    omitted, again = omits(nan_policy), None
    if method == "robust":
        fewest = _FEWEST if stated is None else 1
        again = repeated(theta, options["period"], options["rounding"], fewest)
    if again is not None and (omitted or not np.isnan(theta).any()):
        theta, omitted = np.where(again, np.nan, theta), True
    numbers, outlier, blocks = _core.estimate_bearing(
        theta, stated, labels, options, omitted, threads(n_threads)
    )
    if again is not None:
        outlier |= again
    value, width, polarity, pvalue, correlations, effective, bias, factor = map(
        scalar_or_array, numbers
    )
    systematic: Systematic = "given"
    if bias_sigma is None:
        known = np.size(bias) > 0 and lies_between(bias, -np.inf, np.inf)
        systematic = "estimated" if known else "not included"
    return BearingEstimate(
        value,
        width,
        systematic,
        bias,
        outlier,
        polarity,
        pvalue,
        correlations,
        effective,
        factor,
        *(blocks or (None, None, None)),
    )


def _of_each(sigma: npt.ArrayLike, shape: tuple[int, ...]) -> FloatArray:
    """Return the sigma of each measurement: one row for each record, or one for all records."""
    stated = samples(sigma, "sigma")
    if stated.ndim == 0 or not shape:
        require_between(stated, "sigma", "a positive number", SMALLEST)
    if shape and stated.ndim == 0:
        return np.full(shape[-1:], stated)
    if not shape or stated.shape not in {shape, shape[-1:]}:
        raise ValueError(
            f"sigma has shape {stated.shape}; it must be a number, or have the shape of theta, "
            f"{shape}, or of its last axis"
        )
    return stated


def _numbered(groups: npt.ArrayLike, shape: tuple[int, ...]) -> FloatArray:
    """Return the groups as numbers from 0: one row for each record, or one for all records."""
    labels = array_of(groups, "groups")
    if not shape or labels.shape not in {shape, shape[-1:]}:
        raise ValueError(
            f"groups has shape {labels.shape}; it must be that of theta, {shape}, or of its last "
            "axis"
        )
    rows = labels.reshape(-1, labels.shape[-1])
    try:
        numbers = [np.unique(row, return_inverse=True)[1] for row in rows]
    except TypeError:
        raise TypeError("groups has labels of several types; all must have the same type") from None
    return np.asarray(numbers, dtype=np.float64).reshape(labels.shape)


def _bias(bias_sigma: float) -> float:
    number = real(bias_sigma, "bias_sigma")
    if not number >= 0:
        raise ValueError(f"bias_sigma is {number}; it must be 0, a positive number or inf")
    return number


def _variance_test(value: str | float | None) -> str | float | None:
    return value if value is None or isinstance(value, str) else real(value, "variance_test")
