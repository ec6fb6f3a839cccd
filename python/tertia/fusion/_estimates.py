"""Fusion of the estimates that several sensors make of the same vector."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from tertia import _core
from tertia._arrays import (
    FloatArray,
    IntArray,
    Systematic,
    finite,
    real,
    require_each,
    samples,
    scalar_or_array,
    threads,
)
from tertia._result import Result
from tertia.fusion._biases import deviations
from tertia.weights import Count
from tertia.weights._few import enlarged
from tertia.weights._readers import deviation, moderate, of_one_batch
from tertia.weights._spread import counts

InstantMethod: TypeAlias = Literal[
    "matrix", "posterior", "covariance-intersection", "static", "equal", "paper"
]


@dataclass(frozen=True, slots=True, eq=False)
class FusedEstimate(Result):
    """A fused estimate, and a test of whether the estimates of the sensors agree.

    Attributes
    ----------
    mean : ndarray of shape (..., m)
        The fused estimate; nan if no sensor has an estimate.
    covariance : ndarray of shape (..., m, m)
        Covariance of the fused estimate if the given covariances are correct; for
        "covariance-intersection" it is an upper bound of this covariance. Variances are infinite if
        no sensor has an estimate. If systematic errors are estimated, or `n` is given, the error is
        not normal; the covariance is then such that an interval of two sigmas contains the true
        value of a component with a probability of 95.45 %.
    weights : ndarray of shape (..., K, m, m)
        Weight matrices of the estimates; their sum is the identity, and they are 0 for sensors
        without an estimate. In a result of `fuse_scalar`, it is the gain of the scalar, of shape
        (..., m).
    bias_sigma : float or ndarray
        Standard deviation of the systematic error of an estimate, as given or as estimated; if it
        is estimated, it has the shape (..., m).
    systematic : {"given", "estimated", "not included"}
        How `covariance` treats systematic errors: it includes the given `bias_sigma`, it includes
        errors estimated from inconsistencies between the sensors, or it includes none, because
        there was nothing to compare.
    statistic : float or ndarray of shape (...)
        Sum of the squared differences between the estimates and the fused estimate, each weighted
        by the inverse covariance of the estimate; nan for methods other than "matrix".
    degrees_of_freedom : int or ndarray of shape (...)
        Degrees of freedom of the chi-square distribution that `statistic` has if the covariances
        are correct.
    pvalue : float or ndarray of shape (...)
        Probability that the statistic is larger than this one if the covariances are correct; nan
        if there is no statistic. A small p-value means that an estimate or a covariance is wrong.
    """

    _rows: ClassVar = "mean", 1

    mean: FloatArray
    covariance: FloatArray
    weights: FloatArray
    bias_sigma: float | FloatArray
    systematic: Systematic
    statistic: float | FloatArray
    degrees_of_freedom: int | IntArray
    pvalue: float | FloatArray

    @property
    def sigma(self) -> FloatArray:
        """Standard deviations of `mean`, of shape (..., m)."""
        return np.sqrt(np.diagonal(self.covariance, axis1=-2, axis2=-1))

    def __repr__(self) -> str:
        """Show the mean and its sigma, or the shape of a batch."""
        missing = self.systematic == "not included"
        note = ", systematic error not included" if missing else ""
        if self.mean.ndim > 1:
            shape = f"batch {self.mean.shape[:-1]}, {self.mean.shape[-1]} components"
            return f"FusedEstimate({shape}{note})"
        pairs = zip(self.mean, self.sigma, strict=True)
        listed = ", ".join(f"{mean:.6g} ± {sigma:.3g}" for mean, sigma in pairs)
        agreement = "" if np.isnan(self.pvalue) else f", p-value {self.pvalue:.3g}"
        return f"FusedEstimate([{listed}]{agreement}{note})"


def fuse(
    estimates: npt.ArrayLike,
    covariances: npt.ArrayLike | None = None,
    *,
    bias_sigma: npt.ArrayLike | None = 0.0,
    n: Count | None = None,
    method: InstantMethod = "matrix",
    cross_covariances: npt.ArrayLike | None = None,
    weights: npt.ArrayLike | None = None,
    corrections: npt.ArrayLike | None = None,
    period: float | None = None,
    n_threads: int | None = None,
) -> FusedEstimate:
    """Fuse estimates of the same vector by several sensors, and test whether they agree.

    Parameters
    ----------
    estimates : array_like of shape (..., K, m)
        Estimates of K >= 1 sensors. If all components are nan, the sensor has no estimate, and its
        covariance is ignored.
    covariances : array_like of shape (..., K, m, m), optional
        Covariances of the estimates. They may be omitted only for "paper"; the covariance of the
        result is then nan. Leading axes of all arrays are broadcast against each other. With
        "matrix", a covariance may be singular if the others are not singular in the same direction.
    bias_sigma : float, array_like of shape (K,), or None
        Standard deviation of the systematic error of each estimate and component, in the unit of
        the estimates; one number for all sensors or one for each. It must not be part of the
        covariances. 0: there is no systematic error. inf: nothing is known about the systematic
        error, and the sensor is not used. None: the standard deviation is estimated from the
        inconsistencies between the sensors; this is possible only for "matrix" without
        `cross_covariances`.
    n : int, inf or array_like of shape (K,), optional
        Number of measurements from which each estimate, as their mean, and its covariance were
        computed. The covariance and the p-value of the result then allow for the uncertainty of the
        given covariances. inf, which is also the default, means that a covariance is known. Only
        for "matrix" without `cross_covariances`.
    method : str
        "matrix": the linear unbiased combination with the smallest covariance.
        "posterior": each component is weighted by the inverses of its variances.
        "covariance-intersection": for errors whose correlation is unknown. All sensors are combined
        at once, with the upper bound of the covariance that has the smallest determinant.
        "static": the estimates are weighted by `weights`. "equal": all weights are equal.
        "paper": each component is weighted by the inverses of its squared `corrections`, as in the
        source.
    cross_covariances : array_like of shape (..., K, K, m, m), optional
        Covariances between the errors of two sensors. Block [i, j] is that of the errors of i
        (rows) and of j (columns), and is the transpose of block [j, i]. Blocks [i, i] are ignored.
        By default the errors are independent. "covariance-intersection" ignores them, because its
        bound holds for any correlation.
    weights : array_like of shape (K,), optional
        Weights for "static", up to a common factor; not allowed for other methods.
    corrections : array_like of shape (..., K, m), optional
        Amount by which the last measurement changed each estimate, for "paper"; not allowed for
        other methods. If the correction of a component is zero for one sensor, that sensor has all
        the weight in this component; if it is zero for all sensors, their weights are equal.
    period : float, optional
        Period of the first component if it is an angle: 360.0 for degrees, 2*pi for radians. The
        fused angle is in [0, period). By default nothing wraps.
    n_threads : int, optional
        Number of threads; by default one for small tasks and all cores for large ones.

    Returns
    -------
    FusedEstimate
        Mean, covariance and weights; for "matrix" also the statistic of the test of agreement.

    Raises
    ------
    numpy.linalg.LinAlgError
        If a covariance, or the joint covariance of all sensors, is indefinite. With "matrix" and
        "covariance-intersection" also if covariances are singular in such a way that the weights
        are undefined or are lost to rounding.
    ValueError
        If shapes do not fit; if `bias_sigma` is negative; if `bias_sigma=None` or `n` is given to a
        method that cannot use it; if a matrix is not symmetric; if an estimate is infinite, has an
        absolute value above 1e150, or is nan in some components only; if a variance is not
        positive; if the method is unknown; or if weights are missing, negative, all zero or not
        used by the method.
    TypeError
        If an argument has the wrong type.

    Notes
    -----
    For any weights W, the covariance of the combination is the sum of `W_i S_ij W_j'` over all i
    and j. "matrix" inverts only covariances of differences of estimates. Without
    `cross_covariances` the weights are those of `weights.weight_matrices`, and the statistic is the
    sum of `(x_k - x)' C_k (x_k - x)` with C_k the inverse covariances. For normal errors this sum
    has the chi-square distribution with (K - 1) m degrees of freedom. The cost is O(K m³), and O(K³
    m³) with `cross_covariances`.

    Estimates that share a measurement are not independent; without `cross_covariances` their
    fused covariance is then too small. It is better to add the shared measurement once, by
    `fuse_scalar`.

    "covariance-intersection": `(sum of ω_k C_k)^-1`, where C_k are the inverse covariances and ω_k
    are coefficients whose sum is 1, is an upper bound of the covariance for any correlation. The
    coefficients are chosen to minimise the determinant of this bound. If the trace were minimised
    instead, they would depend on the units. The problem is convex and treats all sensors alike.

    "paper" is based on the assumption that a small correction indicates a small error. This is not
    justified: if the model of a filter is correct, its correction says nothing about its remaining
    error.

    With a period, angles are first shifted to within half a period of the angle with the smallest
    variance.

    `bias_sigma=None` is a random-effects model: `x_k = x + u_k + e_k` with `e_k ~ N(0, S_k)` and
    `u_k ~ N(0, τ² M)`. M is the fused covariance, scaled so that the median sensor has
    `tr(inverse(M) S_k) = m`; the model therefore depends neither on units nor on axes. The prior of
    x is flat; that of τ is half-Cauchy with scale 1 (Gelman 2006), and τ is integrated out. From a
    single estimate, no systematic error can be estimated. With two estimates the result depends
    strongly on the prior, and an interval of two sigmas is at least 2.5 times as wide as if there
    were no systematic errors.

    If `n` is given, the covariance is such that an interval of two sigmas contains the true value
    of a component with a probability of 95.45 %. For one estimate, the interval is computed from
    Student's distribution. For several estimates, it is computed by a simulation with a fixed seed,
    in which the estimated covariances are treated as the true ones. The simulation takes some
    milliseconds per element of the batch.

    Examples
    --------
    Two tracks whose errors are partly common to both:

    >>> from tertia.fusion import fuse
    >>> S = [[[4, 1], [1, 2]], [[1, -0.5], [-0.5, 3]]]
    >>> common = [[0.5, 0.2], [0.2, 0.5]]
    >>> joint = [[S[0], common], [common, S[1]]]
    >>> fuse([[359, 20], [2, 21]], S, cross_covariances=joint, period=360)
    FusedEstimate([1.78987 ± 0.9, 20.9425 ± 1.14], p-value 0.292)
    >>> fuse([[359, 20], [2, 21]], S, method="covariance-intersection", period=360)
    FusedEstimate([1.93436 ± 1.02, 20.9903 ± 1.66])

    Four estimates that contradict each other, as the p-value shows:

    >>> x, S = [[10], [14], [9], [20]], [[[1]], [[2.25]], [[1.44]], [[4]]]
    >>> fuse(x, S)
    FusedEstimate([11.5 ± 0.647], p-value 4.78e-06)
    >>> fuse(x, S, bias_sigma=None)
    FusedEstimate([12.9594 ± 2.9], p-value 4.78e-06)
    """
    x = samples(estimates, "estimates")
    if x.ndim < 2 or 0 in x.shape[-2:]:
        raise ValueError(f"estimates has shape {x.shape}; it must be (..., K, m)")
    sensors, m = x.shape[-2:]
    _require_paper(method, corrections, covariances)
    # without covariances, any do: that of the result is not returned
    s = samples([np.eye(m)] * sensors if covariances is None else covariances, "covariances")
    given = {"estimates": (x, (sensors, m)), "covariances": (s, (sensors, m, m))}
    if corrections is not None:
        given["corrections"] = (samples(corrections, "corrections"), (sensors, m))
    if cross_covariances is not None:
        cross = samples(cross_covariances, "cross_covariances")
        given["cross_covariances"] = (cross, (sensors, sensors, m, m))
    free = method == "matrix" and cross_covariances is None
    for name, asked in {"bias_sigma=None": bias_sigma is None, "n": n is not None}.items():
        if asked and not free:
            raise ValueError(f"{name} is for method 'matrix' without cross_covariances")
    laws = None if n is None else _core.wishart_law(counts(n), "sample-mean", sensors)
    arrays = of_one_batch(**given)
    if corrections is not None:
        holds = np.isfinite(arrays["corrections"]) | np.isnan(arrays["estimates"])
        require_each(arrays["corrections"], holds, "corrections", "a finite number")
    if bias_sigma is not None:
        bias = deviations(bias_sigma, sensors)
        arrays |= _with_bias(arrays["estimates"], arrays["covariances"], bias)
    arguments: dict[str, object] = {
        "cross_covariances": None,
        "corrections": None,
        **arrays,
        "weights": _proportions(weights, method, sensors),
        "method": str(method),
        "random_effects": bias_sigma is None,
        "period": None if period is None else real(period, "period"),
    }
    found = _fused(_core.fuse(arguments, threads(n_threads)))
    if covariances is None:
        found = replace(found, covariance=np.full_like(found.covariance, np.nan))
    if bias_sigma is not None:
        found = replace(found, bias_sigma=scalar_or_array(bias))
    else:
        compared = np.count_nonzero(~np.isnan(arrays["estimates"][..., 0]), axis=-1) != 1
        systematic: Systematic = "estimated" if np.all(compared) else "not included"
        found = replace(found, systematic=systematic)
    if laws is None or all(np.isinf(degrees) for degrees, _ in laws):
        return found
    return allowing_for(found, arrays["estimates"], arrays["covariances"], laws)


def _require_paper(
    method: str, corrections: npt.ArrayLike | None, covariances: npt.ArrayLike | None
) -> None:
    """Raise an error if "paper" lacks its corrections, or another method its covariances."""
    if (corrections is None) == (method == "paper"):
        needed = "needs corrections" if corrections is None else "takes no corrections"
        raise ValueError(f"method {method!r} {needed}; they are for 'paper'")
    if covariances is None and method != "paper":
        raise ValueError(f"covariances is None; method {method!r} needs them")


def _with_bias(x: FloatArray, s: FloatArray, bias: FloatArray) -> dict[str, FloatArray]:
    """Return covariances that include systematic errors, and estimates; nan if the sigma is inf."""
    if not np.any(bias):
        return {}
    sensors, m = x.shape[-2:]
    each = np.broadcast_to(bias, (sensors,))[:, np.newaxis, np.newaxis]
    unknown = np.isinf(each)
    variance = np.where(unknown, 0.0, each) ** 2 * np.eye(m)
    return {"estimates": np.where(unknown[..., 0], np.nan, x), "covariances": s + variance}


def allowing_for(
    found: FusedEstimate,
    estimates: FloatArray,
    covariances: FloatArray,
    laws: Sequence[tuple[float, float]],
) -> FusedEstimate:
    """Return the estimate with a covariance and a p-value that allow for estimated covariances.

    `laws` are the degrees of freedom and the mean of the Wishart matrices of the sensors.
    """
    covariance = found.covariance.copy()
    pvalue = np.array(found.pvalue, dtype=np.float64)
    for place in np.ndindex(covariance.shape[:-2]):
        present = np.flatnonzero(~np.isnan(estimates[place][:, 0]))
        if not present.size:
            continue
        own = [laws[int(k)] for k in present]
        _require_enough(own, covariance.shape[-1])
        s = covariances[place][present]
        statistic = float(np.asarray(found.statistic)[place])
        factors, pvalue[place] = enlarged(s, statistic, own)
        covariance[place] *= np.outer(factors, factors)
    return replace(found, covariance=covariance, pvalue=scalar_or_array(pvalue))


def _require_enough(laws: Sequence[tuple[float, float]], components: int) -> None:
    """Raise an error if sensors may be exact in different directions by chance."""
    fewest = sorted(degrees for degrees, _ in laws)
    if len(fewest) > 1 and fewest[1] < components:
        raise ValueError(
            f"n is {fewest[1] + 1:g}; of estimates with {components} components, only one may have "
            f"fewer than {components + 1} measurements"
        )


def fuse_scalar(
    estimate: npt.ArrayLike,
    covariance: npt.ArrayLike,
    h: npt.ArrayLike,
    measured: npt.ArrayLike,
    sigma: npt.ArrayLike,
    *,
    n_threads: int | None = None,
) -> FusedEstimate:
    """Add one redundant measured scalar to an estimate, and test whether they agree.

    A scalar does not determine the whole vector: it has an information matrix of rank one, `h h' /
    sigma²`, but no covariance matrix. Use this function to add a measurement to an estimate from
    other measurements. The alternative, to fuse two estimates that share measurements, would treat
    these estimates as independent.

    Parameters
    ----------
    estimate : array_like of shape (..., m)
        The estimate without the scalar.
    covariance : array_like of shape (..., m, m)
        Covariance of the estimate.
    h : array_like of shape (..., m)
        Derivatives of the scalar with respect to the components of the estimate.
    measured : array_like of shape (...)
        The measured scalar z minus the constant of its model. For the linear model `z = h . x + c`,
        this is `z - c`; for a nonlinear model `z = f(x)`, it is `z - f(estimate) + h . estimate`.
    sigma : array_like of shape (...)
        Standard deviation of the scalar.
    n_threads : int, optional
        Number of threads; by default one for small tasks and all cores for large ones.

    Returns
    -------
    FusedEstimate
        The updated estimate. `weights` is the gain of the scalar, of shape (..., m); the statistic
        is the squared innovation divided by its variance, with one degree of freedom.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the covariance is indefinite.
    ValueError, TypeError
        If shapes do not fit, a number is not finite, too large or not positive where it must be, or
        an argument has the wrong type.

    Notes
    -----
    Leading axes are broadcast against each other. The covariance is computed in Joseph's form, so
    that rounding cannot make it indefinite. The cost is O(m³).

    Examples
    --------
    A range, measured as 5.2 ± 0.1, is added to a position of (3 ± 1, 4 ± 1); `h` is the unit vector
    from the origin to the position:

    >>> from tertia.fusion import fuse_scalar
    >>> fuse_scalar([3, 4], [[1, 0], [0, 1]], [0.6, 0.8], 5.2, 0.1)
    FusedEstimate([3.11881 ± 0.802, 4.15842 ± 0.605], p-value 0.842)
    """
    s, x = samples(covariance, "covariance"), finite(estimate, "estimate")
    if s.ndim < 2 or s.shape[-2] != s.shape[-1] or s.shape[-1] == 0:
        raise ValueError(f"covariance has shape {s.shape}; it must be (..., m, m)")
    m = s.shape[-1]
    given = of_one_batch(
        covariance=(s, (m, m)),
        estimate=(x, (m,)),
        h=(moderate(h, "h"), (m,)),
        measured=(moderate(measured, "measured"), ()),
        sigma=(deviation(sigma, "sigma"), ()),
    )
    scalars = np.stack([given["measured"], given["sigma"]], axis=-1)
    found = _core.fuse_scalar(
        given["estimate"], given["covariance"], given["h"], scalars, threads(n_threads)
    )
    return replace(_fused(found), bias_sigma=0.0)


def _fused(found: tuple[list[FloatArray], IntArray]) -> FusedEstimate:
    (mean, covariance, weights, bias_sigma, statistic, pvalue), degrees_of_freedom = found
    return FusedEstimate(
        mean,
        covariance,
        weights,
        bias_sigma,
        "given",
        scalar_or_array(statistic),
        scalar_or_array(degrees_of_freedom),
        scalar_or_array(pvalue),
    )


def _proportions(weights: npt.ArrayLike | None, method: str, sensors: int) -> list[float] | None:
    """Return the weights of method "static"."""
    if (weights is None) == (method == "static"):
        needed = "needs weights" if weights is None else "takes no weights"
        raise ValueError(f"method {method!r} {needed}; they are for 'static'")
    if weights is None:
        return None
    array = finite(weights, "weights")
    if array.shape != (sensors,):
        raise ValueError(f"weights has shape {array.shape}; it must be ({sensors},)")
    if np.any(array < 0) or not np.any(array > 0):
        raise ValueError(f"weights are {array}; they must not be negative, and not all zero")
    numbers: list[float] = array.tolist()
    return numbers
