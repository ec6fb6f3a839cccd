"""Weights: the matrices that combine estimates, and what not knowing them exactly costs.

Source: Kulyavets et al. 2005, equations (1) to (14), for any number of sensors. `S_k` is the
covariance of sensor k's estimate, `C_k` its inverse, `S_p` the inverse of the sum of all `C_k`, and
`W_k = S_p C_k` the weight of sensor k; vec stacks columns.

No covariance is inverted, only sums of two, so a sensor may be (almost) singular by itself.
Rounding leaves an error of about 1e-15 / p in the weights, in units of standard deviations, where p
is the smallest share of a component's variance that the other components leave unexplained, in the
covariance of a sensor added to that of the others; below 1e-13 the sum counts as singular.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from tertia import _core
from tertia._arrays import (
    FloatArray,
    IntArray,
    finite,
    flag,
    generator,
    integer,
    positive,
    real,
    samples,
    scalar_or_array,
    threads,
)
from tertia._wishart import standard_wishart

__all__ = [
    "Combination",
    "Convention",
    "Count",
    "FusionLoss",
    "JacobianOperator",
    "LossMethod",
    "blend",
    "combine",
    "combine_scalar",
    "covariance_factor",
    "covariance_of_covariance",
    "fused_covariance",
    "fusion_loss",
    "jacobian",
    "jacobian_operator",
    "required_samples",
    "sample_covariance",
    "scalar_information",
    "weight_bias",
    "weight_covariance",
    "weight_matrices",
]

Convention: TypeAlias = Literal["sample-mean", "known-mean", "paper", "differences"]
LossMethod: TypeAlias = Literal["auto", "first-order", "monte-carlo"]
Count: TypeAlias = float | Sequence[float] | npt.NDArray[Any]

# below this many degrees of freedom per (m + 1) the first-order loss may be off by more than a
# twentieth of itself: docs/weights.md
_FIRST_ORDER_FROM = 100
_TRIALS = 10_000
# measured losses must stay below the bound with this many of their standard errors
_STANDARD_ERRORS = 2.0
_LARGEST_N = 2**53
_LARGEST_FACTOR = 1e10
# squares of smaller ones, or of larger ones than its reciprocal, leave the range of doubles
_SMALLEST_SIGMA = 1e-70


@dataclass(frozen=True, slots=True, eq=False)
class Combination:
    """A fused estimate and whether what it was made of agrees.

    Attributes
    ----------
    value : ndarray of shape (..., m)
        The fused estimate.
    covariance : ndarray of shape (..., m, m)
        Its covariance, if those of the estimates are right and their errors independent.
    weights : ndarray of shape (..., K, m, m)
        The weight of each estimate; they sum to the identity. From `combine_scalar`: the gain of
        the scalar, of shape (..., m).
    statistic : float or ndarray of shape (...)
        Sum of the squared residuals in units of the covariances.
    degrees_of_freedom : int
        The chi-square distribution that `statistic` has where the covariances are right.
    p_value : float or ndarray of shape (...)
        Probability of a larger statistic then. A small one says that an estimate or a covariance
        is wrong.
    """

    value: FloatArray
    covariance: FloatArray
    weights: FloatArray
    statistic: float | FloatArray
    degrees_of_freedom: int
    p_value: float | FloatArray

    @property
    def sigma(self) -> FloatArray:
        """Standard deviations of `value`, of shape (..., m)."""
        return np.sqrt(np.diagonal(self.covariance, axis1=-2, axis2=-1))

    def __repr__(self) -> str:
        """Tell value and sigma where there is no batch."""
        if self.value.ndim > 1:
            return f"Combination(batch {self.value.shape[:-1]}, {self.value.shape[-1]} components)"
        pairs = zip(self.value, self.sigma, strict=True)
        listed = ", ".join(f"{value:.6g} ± {sigma:.3g}" for value, sigma in pairs)
        return f"Combination([{listed}], p-value {self.p_value:.3g})"


@dataclass(frozen=True, slots=True, eq=False)
class FusionLoss:
    """What fusing with estimated weights costs.

    Attributes
    ----------
    loss : float or ndarray of shape (...)
        `trace(mean_squared_error) / trace(fused_covariance) - 1`.
    component_loss : ndarray of shape (..., m)
        The same for each component alone, which does not depend on units.
    mean_squared_error : ndarray of shape (..., m, m)
        Of the estimate fused with estimated weights.
    fused_covariance : ndarray of shape (..., m, m)
        Of the estimate fused with the true weights.
    standard_error : float, ndarray of shape (...) or None
        Of `loss`, where it was simulated.
    method : {"first-order", "monte-carlo"}
        How it was computed.
    """

    loss: float | FloatArray
    component_loss: FloatArray
    mean_squared_error: FloatArray
    fused_covariance: FloatArray
    standard_error: float | FloatArray | None
    method: str

    def __repr__(self) -> str:
        """Tell the loss."""
        if isinstance(self.loss, np.ndarray):
            return f"FusionLoss(batch {self.loss.shape}, {self.method})"
        error = "" if self.standard_error is None else f" ± {self.standard_error:.1%}"
        return f"FusionLoss({self.loss:.2%}{error}, {self.method})"


@dataclass(frozen=True, slots=True, eq=False)
class JacobianOperator:
    """The Jacobian of a weight matrix, which multiplies vectors without being formed.

    `scipy.sparse.linalg.aslinearoperator` accepts it where there is no batch.

    Attributes
    ----------
    left, right : ndarray of shape (..., K, m, m)
        The factors of `dW = sum over j of left_j dS_j right_j`.
    """

    left: FloatArray
    right: FloatArray

    @property
    def shape(self) -> tuple[int, int]:
        """(m², K m²)."""
        sensors, m = self.left.shape[-3:-1]
        return m * m, sensors * m * m

    @property
    def dtype(self) -> np.dtype[np.float64]:
        """Always float64."""
        return self.left.dtype

    def matvec(self, x: npt.ArrayLike) -> FloatArray:
        """Return the change of vec W, (..., m²), for changes of vec S_j, (..., K m²), in O(K m³).

        vec stacks columns.
        """
        sensors, m = self.left.shape[-3:-1]
        change = _unvec(_vectors(x, self.shape[1]), (sensors, m, m))
        product: FloatArray = self.left @ change @ self.right
        return _vec(product.sum(axis=-3))

    def rmatvec(self, y: npt.ArrayLike) -> FloatArray:
        """Return the product of the transposed Jacobian and y, (..., m²), of shape (..., K m²).

        It turns the gradient of a function of W into that of the same function of all S_j, in
        O(K m³). vec stacks columns.
        """
        m = self.left.shape[-1]
        gradient = _unvec(_vectors(y, self.shape[0]), (1, m, m))
        product: FloatArray = _transposed(self.left) @ gradient @ _transposed(self.right)
        return _transposed(product).reshape(*product.shape[:-3], -1)


def weight_matrices(covariances: npt.ArrayLike, *, n_threads: int | None = None) -> FloatArray:
    """Return the weight matrices of several estimates of the same vector.

    The fused estimate is the sum of `W_k x_k`; for two sensors `x_1 + W_2 (x_2 - x_1)`.

    Parameters
    ----------
    covariances : array_like of shape (..., K, m, m)
        Covariance of each of K >= 2 estimates, with independent errors. A covariance may be
        singular if the others are not so in the same direction.
    n_threads : int, optional
        Threads to use; by default one for little work and all cores for much.

    Returns
    -------
    ndarray of shape (..., K, m, m)
        `W_k`. They sum to the identity; none is symmetric.

    Raises
    ------
    numpy.linalg.LinAlgError
        A covariance that is indefinite, or some that are singular in the same direction.
    ValueError
        A wrong shape, a matrix that is not symmetric, an element that is not finite, or a variance
        that is not positive.
    TypeError
        An argument of the wrong type.

    Notes
    -----
    (1), (2) and (6) of the source, for K sensors. Cost O(K m³).

    Examples
    --------
    >>> from tertia import weights
    >>> S = [[[4, 1], [1, 2]], [[1, -0.5], [-0.5, 3]]]
    >>> weights.weight_matrices(S)[1] * 99
    array([[78., 12.],
           [16., 38.]])
    """
    return _core.weight_matrices(samples(covariances, "covariances"), threads(n_threads))


def fused_covariance(covariances: npt.ArrayLike, *, n_threads: int | None = None) -> FloatArray:
    """Return the covariance of the fused estimate, `S_p = (C_1 + ... + C_K)^-1`.

    Parameters
    ----------
    covariances : array_like of shape (..., K, m, m)
        See `weight_matrices`.
    n_threads : int, optional
        Threads to use; by default one for little work and all cores for much.

    Returns
    -------
    ndarray of shape (..., m, m)
        `S_p`.

    Raises
    ------
    numpy.linalg.LinAlgError
        As for `weight_matrices`, and where covariances are (almost) singular in different
        directions, so that rounding would leave an error of more than 0.1 % in a fused variance.
    ValueError, TypeError
        As for `weight_matrices`.

    Examples
    --------
    >>> from tertia import weights
    >>> weights.fused_covariance([[[1.0]], [[3.0]]])
    array([[0.75]])
    """
    return _core.fused_covariance(samples(covariances, "covariances"), threads(n_threads))


def combine(
    estimates: npt.ArrayLike, covariances: npt.ArrayLike, *, n_threads: int | None = None
) -> Combination:
    """Fuse several estimates of the same vector and test whether they agree.

    Parameters
    ----------
    estimates : array_like of shape (..., K, m)
        K >= 2 estimates with independent errors.
    covariances : array_like of shape (..., K, m, m)
        Their covariances, see `weight_matrices`. Leading axes are broadcast against each other.
    n_threads : int, optional
        Threads to use; by default one for little work and all cores for much.

    Returns
    -------
    Combination
        Value, covariance, weights and the statistic of consistency with its p-value.

    Raises
    ------
    numpy.linalg.LinAlgError
        As for `fused_covariance`.
    ValueError
        As for `weight_matrices`, or an estimate that is not a number of at most 1e150 in size.
    TypeError
        An argument of the wrong type.

    Notes
    -----
    The statistic is `sum of (x_k - x)' C_k (x_k - x)`, chi-square with (K - 1) m degrees of freedom
    for normal errors. Estimates that share a measurement are not independent: their covariance
    comes out too small; see `combine_scalar`. Cost O(K m³).

    Examples
    --------
    >>> from tertia import weights
    >>> S = [[[4, 1], [1, 2]], [[1, -0.5], [-0.5, 3]]]
    >>> weights.combine([[10, 20], [13, 21]], S)
    Combination([12.4848 ± 0.853, 20.8687 ± 1.03], p-value 0.387)
    """
    x, s = samples(estimates, "estimates"), samples(covariances, "covariances")
    # what is wrong with covariances alone is found by the core
    if s.ndim >= 3:
        x, s = _matched(x, s)
    result = _core.combine(x, s, threads(n_threads))
    return _combination(result, (s.shape[-3] - 1) * s.shape[-1])


def combine_scalar(
    estimate: npt.ArrayLike,
    covariance: npt.ArrayLike,
    h: npt.ArrayLike,
    measured: npt.ArrayLike,
    sigma: npt.ArrayLike,
    *,
    n_threads: int | None = None,
) -> Combination:
    """Add one redundant measured scalar to an estimate.

    A scalar has no covariance matrix of its own, but it is information: `h h' / sigma²`, of rank
    one. This is the right way to add a measurement to an estimate that was made of others, where
    two estimates that share measurements would not be independent.

    Parameters
    ----------
    estimate : array_like of shape (..., m)
        The estimate without the scalar.
    covariance : array_like of shape (..., m, m)
        Its covariance.
    h : array_like of shape (..., m)
        Derivatives of the scalar with respect to the components.
    measured : array_like of shape (...)
        The measured scalar less the constant of its linear model `z = h . x`. For a nonlinear one
        `z = f(x)` it is `measured z - f(estimate) + h . estimate`.
    sigma : array_like of shape (...)
        Standard deviation of the scalar.
    n_threads : int, optional
        Threads to use; by default one for little work and all cores for much.

    Returns
    -------
    Combination
        `weights` is the gain of the scalar, of shape (..., m); the statistic is the squared
        innovation over its variance, with one degree of freedom.

    Raises
    ------
    numpy.linalg.LinAlgError
        A covariance that is indefinite.
    ValueError
        Shapes that do not fit, or a number that is not finite, too large, or not positive where it
        must be.
    TypeError
        An argument of the wrong type.

    Notes
    -----
    Leading axes are broadcast against each other. The covariance is computed in Joseph's form, so
    it stays positive. Cost O(m³).

    Examples
    --------
    A range of 5 ± 0.1 added to a position of (3 ± 1, 4 ± 1), of which `h` is the direction:

    >>> from tertia import weights
    >>> weights.combine_scalar([3, 4], [[1, 0], [0, 1]], [0.6, 0.8], 5.2, 0.1)
    Combination([3.11881 ± 0.802, 4.15842 ± 0.605], p-value 0.842)
    """
    x, s = finite(estimate, "estimate"), samples(covariance, "covariance")
    row = finite(h, "h")
    z, deviation = finite(measured, "measured"), _deviation(sigma)
    if s.ndim < 2 or x.shape[-1:] != s.shape[-1:] or row.shape[-1:] != s.shape[-1:]:
        raise ValueError(
            f"covariance has shape {s.shape}, estimate {x.shape} and h {row.shape}; they must be "
            "(..., m, m), (..., m) and (..., m)"
        )
    if s.shape[-2] != s.shape[-1] or s.shape[-1] == 0:
        raise ValueError(f"covariance has shape {s.shape}; it must be (..., m, m)")
    _require_moderate(h=row, measured=z)
    batch = _common_batch(
        estimate=x.shape[:-1],
        covariance=s.shape[:-2],
        h=row.shape[:-1],
        measured=z.shape,
        sigma=deviation.shape,
    )
    m = s.shape[-1]
    result = _core.combine_scalar(
        np.broadcast_to(x, (*batch, m)),
        np.broadcast_to(s, (*batch, m, m)),
        np.broadcast_to(row, (*batch, m)),
        np.stack(np.broadcast_arrays(z, deviation, np.empty(batch))[:2], axis=-1),
        threads(n_threads),
    )
    return _combination(result, 1)


def scalar_information(h: npt.ArrayLike, sigma: npt.ArrayLike) -> FloatArray:
    """Return the information matrix of a measured scalar, `h h' / sigma²`, of rank one.

    `combine_scalar` uses it without forming or inverting it.

    Parameters
    ----------
    h : array_like of shape (..., m)
        Derivatives of the scalar with respect to the components.
    sigma : array_like of shape (...)
        Standard deviation of the scalar.

    Returns
    -------
    ndarray of shape (..., m, m)
        The information: the inverse of a covariance, if it had one.

    Raises
    ------
    ValueError
        A number that is not finite, or a sigma that is not positive.
    TypeError
        An argument of the wrong type.

    Examples
    --------
    >>> from tertia import weights
    >>> weights.scalar_information([3, 4], 5)
    array([[0.36, 0.48],
           [0.48, 0.64]])
    """
    row, deviation = finite(h, "h"), _deviation(sigma)
    if row.ndim == 0:
        raise ValueError("h is a single number; it must be of shape (..., m)")
    _require_moderate(h=row)
    _common_batch(h=row.shape[:-1], sigma=deviation.shape)
    scaled = row / deviation[..., np.newaxis]
    return scaled[..., :, np.newaxis] * scaled[..., np.newaxis, :]


def jacobian(
    covariances: npt.ArrayLike, sensor: int = -1, *, n_threads: int | None = None
) -> FloatArray:
    """Return the derivatives of one weight matrix with respect to all covariances.

    Parameters
    ----------
    covariances : array_like of shape (..., K, m, m)
        See `weight_matrices`.
    sensor : int
        Whose weight; negative numbers count from the last.
    n_threads : int, optional
        Threads to use; by default one for little work and all cores for much.

    Returns
    -------
    ndarray of shape (..., K, m², m²)
        `d vec W_sensor / d vec S_j` for each j. vec stacks columns, on both sides: element
        [j, b m + a, q m + p] is `d W[a, b] / d S_j[p, q]`. All elements of `S_j` count as free: a
        change must change both halves.

    Raises
    ------
    numpy.linalg.LinAlgError, ValueError, TypeError
        As for `weight_matrices`, or a sensor that is not there.

    Notes
    -----
    (7), (8) and (12) to (14) of the source; for two sensors and the second's weight these are P1
    and P2. `P_j = [C_j (W - δ I)]' ⊗ W_j`, where δ is 1 for the sensor itself. Cost O(K m⁴), that
    of writing the result.

    Examples
    --------
    >>> from tertia import weights
    >>> weights.jacobian([[[1.0]], [[3.0]]]).ravel()
    array([ 0.1875, -0.0625])
    """
    k = integer(sensor, "sensor", -(2**31))
    return _core.jacobian(samples(covariances, "covariances"), k, threads(n_threads))


def jacobian_operator(
    covariances: npt.ArrayLike, sensor: int = -1, *, n_threads: int | None = None
) -> JacobianOperator:
    """Return the Jacobian as something that multiplies vectors in O(K m³), without forming it.

    Parameters
    ----------
    covariances : array_like of shape (..., K, m, m)
        See `weight_matrices`.
    sensor : int
        Whose weight; negative numbers count from the last.
    n_threads : int, optional
        Threads to use; by default one for little work and all cores for much.

    Returns
    -------
    JacobianOperator
        With `matvec` and `rmatvec`; vec stacks columns.

    Raises
    ------
    numpy.linalg.LinAlgError, ValueError, TypeError
        As for `jacobian`.

    Examples
    --------
    How the weight of the second sensor changes when the first one's variance grows by 0.1:

    >>> from tertia import weights
    >>> operator = weights.jacobian_operator([[[1.0]], [[3.0]]])
    >>> operator.matvec([0.1, 0.0])
    array([0.01875])
    """
    k = integer(sensor, "sensor", -(2**31))
    s = samples(covariances, "covariances")
    factors = _core.jacobian_factors(s, k, threads(n_threads))
    return JacobianOperator(factors[..., 0, :, :, :], factors[..., 1, :, :, :])


def sample_covariance(
    x: npt.ArrayLike, *, mean: npt.ArrayLike | None = None, differences: bool = False
) -> FloatArray:
    """Estimate a covariance from repeated measurements.

    Parameters
    ----------
    x : array_like of shape (..., n, m)
        n >= 2 measurements of a vector.
    mean : array_like of shape (..., m), optional
        The true value, where it is known.
    differences : bool
        Use differences of successive measurements, of a target that moves slowly.

    Returns
    -------
    ndarray of shape (..., m, m)
        Unbiased: deviations from the sample mean with divisor n - 1 (convention "sample-mean" of
        `covariance_factor`), from `mean` with divisor n ("known-mean"), or differences with
        divisor 2 (n - 1) ("differences"). The paper prints (3) with the true mean and divisor
        n - 1, which is `n / (n - 1)` times the second (convention "paper").

    Raises
    ------
    ValueError
        Fewer than two measurements, a number that is not finite, shapes that do not fit, or both
        `mean` and `differences`.
    TypeError
        An argument of the wrong type.

    Examples
    --------
    >>> from tertia import weights
    >>> weights.sample_covariance([[1, 0], [2, 1], [3, -1]])
    array([[ 1. , -0.5],
           [-0.5,  1. ]])
    """
    y = finite(x, "x")
    if y.ndim < 2 or y.shape[-2] < 2 or y.shape[-1] < 1:
        raise ValueError(f"x has shape {y.shape}; it must be (..., n, m) with n >= 2 measurements")
    n = y.shape[-2]
    _require_moderate(x=y)
    if flag(differences, "differences"):
        if mean is not None:
            raise ValueError("mean is given; with differences it must be None")
        deviations, divisor = np.diff(y, axis=-2), 2.0 * (n - 1)
    elif mean is not None:
        true = finite(mean, "mean")
        if true.shape[-1:] != y.shape[-1:]:
            raise ValueError(f"mean has shape {true.shape}; it must be (..., {y.shape[-1]})")
        _require_moderate(mean=true)
        _common_batch(x=y.shape[:-2], mean=true.shape[:-1])
        deviations, divisor = y - true[..., np.newaxis, :], float(n)
    else:
        # from the first measurement, so that a common offset costs nothing
        deviations, divisor = y - y[..., :1, :], n - 1.0
        deviations -= deviations.mean(axis=-2, keepdims=True)
    gram: FloatArray = _transposed(deviations) @ deviations / divisor
    return (gram + _transposed(gram)) / 2


def covariance_factor(n: float, convention: Convention = "sample-mean") -> float:
    """Return c of the covariance of a sample covariance, `c (S ⊗ S)(I + K)`.

    Parameters
    ----------
    n : int or inf
        Measurements, at least 2; inf for a covariance that is known.
    convention : {"sample-mean", "known-mean", "paper", "differences"}
        How the covariance is estimated, see `sample_covariance`.

    Returns
    -------
    float
        `1 / (n - 1)`, `1 / n`, `n / (n - 1)²` or `(3 n - 4) / (2 (n - 1)²)`.

    Raises
    ------
    ValueError
        n is not a whole number of at least 2, or an unknown word.
    TypeError
        An argument of the wrong type.

    Notes
    -----
    (4) and (5) of the source, for normal measurements.

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
        c, from `covariance_factor`.
    n_threads : int, optional
        Threads to use; by default one for little work and all cores for much.

    Returns
    -------
    ndarray of shape (..., m², m²)
        `c (S ⊗ S)(I + K)`: element [j m + i, l m + q] is `c (s_iq s_jl + s_il s_jq)`. vec stacks
        columns. It is singular, because S is symmetric.

    Raises
    ------
    numpy.linalg.LinAlgError
        A covariance that is indefinite.
    ValueError
        As for `weight_matrices`, or a factor that is negative.
    TypeError
        An argument of the wrong type.

    Notes
    -----
    (4) and (5) of the source. Cost O(m⁴).

    Examples
    --------
    >>> from tertia import weights
    >>> weights.covariance_of_covariance([[2.0]], 0.1)
    array([[0.8]])
    """
    c = real(factor, "factor")
    if not 0 <= c <= _LARGEST_FACTOR:
        raise ValueError(f"factor is {c}; it must be between 0 and {_LARGEST_FACTOR:g}")
    return _core.covariance_of_covariance(samples(covariance, "covariance"), c, threads(n_threads))


def weight_covariance(
    covariances: npt.ArrayLike,
    n: Count,
    sensor: int = -1,
    *,
    convention: Convention = "sample-mean",
    n_threads: int | None = None,
) -> FloatArray:
    """Return the covariance of a weight matrix that is computed from estimated covariances.

    Parameters
    ----------
    covariances : array_like of shape (..., K, m, m)
        The true covariances, or their estimates; see `weight_matrices`.
    n : int, inf or array_like of shape (K,)
        Measurements from which each covariance is estimated; inf where it is known.
    sensor : int
        Whose weight; negative numbers count from the last.
    convention : {"sample-mean", "known-mean", "paper", "differences"}
        How the covariances are estimated, see `sample_covariance`.
    n_threads : int, optional
        Threads to use; by default one for little work and all cores for much.

    Returns
    -------
    ndarray of shape (..., m², m²)
        Covariance of vec W to first order; vec stacks columns: element [b m + a, q m + p] is that
        of `W[a, b]` and `W[p, q]`. Reliable from about n = 30: below, where W is near 0 or I, the
        standard deviations come out too small (docs/weights.md says by how much).

    Raises
    ------
    numpy.linalg.LinAlgError, ValueError, TypeError
        As for `weight_matrices`, or a sensor that is not there, or an n that is not a whole number
        of at least 2 or too small: if m > 1, the variance is infinite for less than m + 2 degrees
        of freedom of two sensors together, or where all sensors together lack m - 1 or more of the
        m degrees of freedom that each should have.

    Notes
    -----
    (10) of the source in closed form. Cost O(K m⁴), where the printed product takes O(m⁶). In the
    convention "paper" it is as printed: too large by `n² / (n - 1)²`, because W does not change
    when all covariances are multiplied by n / (n - 1). `weight_bias` and `fusion_loss` allow for
    that.

    Examples
    --------
    For scalars it is `2 (c_1 + c_2) W² (1 - W)²`:

    >>> from tertia import weights
    >>> weights.weight_covariance([[[1.0]], [[1.0]]], 33)
    array([[0.0078125]])
    """
    return _core.weight_covariance(
        samples(covariances, "covariances"),
        _counts(n),
        integer(sensor, "sensor", -(2**31)),
        convention,
        None if n_threads is None else threads(n_threads),
    )


def weight_bias(
    covariances: npt.ArrayLike,
    n: Count,
    sensor: int = -1,
    *,
    convention: Convention = "sample-mean",
    n_threads: int | None = None,
) -> FloatArray:
    """Return the bias of a weight matrix that is computed from estimated covariances.

    Parameters
    ----------
    covariances, n, sensor, convention, n_threads
        See `weight_covariance`.

    Returns
    -------
    ndarray of shape (..., m, m)
        Expected estimate of `W_sensor` less `W_sensor`, to second order.

    Raises
    ------
    numpy.linalg.LinAlgError, ValueError, TypeError
        As for `weight_covariance`.

    Notes
    -----
    `-sum over j of c_j W_j [(I - W_j) + tr(I - W_j) I] (W - δ I)`, where δ is 1 for the sensor
    itself. In the convention "paper" the factors n/(n - 1) add to it where the n differ. Cost
    O(K m³).

    Examples
    --------
    >>> from tertia import weights
    >>> weights.weight_bias([[[1.0]], [[3.0]]], 31).round(5)
    array([[0.00625]])
    """
    k = integer(sensor, "sensor", -(2**31))
    return _core.weight_bias(
        samples(covariances, "covariances"), _counts(n), k, convention, threads(n_threads)
    )


def fusion_loss(
    covariances: npt.ArrayLike,
    n: Count,
    *,
    method: LossMethod = "auto",
    convention: Convention = "sample-mean",
    trials: int = _TRIALS,
    rng: np.random.Generator | int = 0,
    n_threads: int | None = None,
) -> FusionLoss:
    """Return how much worse the fused estimate is when its weights are estimated.

    Parameters
    ----------
    covariances : array_like of shape (..., K, m, m)
        The true covariances, or their estimates; see `weight_matrices`.
    n : int, inf or array_like of shape (K,)
        Measurements from which each covariance is estimated; inf where it is known.
    method : {"auto", "first-order", "monte-carlo"}
        "first-order": a closed form, too small where n is small or W is near 0 or I.
        "monte-carlo": the mean over simulated covariances, exact but for its standard error.
        "auto": the closed form from 100 (m + 1) degrees of freedom on, where it is off by a
        twentieth of the loss at most, and Monte Carlo below.
    convention : {"sample-mean", "known-mean", "paper", "differences"}
        How the covariances are estimated, see `sample_covariance`.
    trials : int
        Simulated sets of covariances, at least 2; the same for the whole batch.
    rng : numpy.random.Generator or int
        Source of randomness, or its seed; by default always the same.
    n_threads : int, optional
        Threads to use; by default one for little work and all cores for much.

    Returns
    -------
    FusionLoss
        The loss, the matrix of the mean squared error, and the standard error of the loss.

    Raises
    ------
    numpy.linalg.LinAlgError, ValueError, TypeError
        As for `weight_covariance` and `fused_covariance`.

    Notes
    -----
    To first order the mean squared error is
    `{I + sum over j of c_j [tr(I - W_j) W_j + W_j (I - W_j)]} S_p`; for equal sensors the loss is
    `(m + 1) / (2 (n - 1))`. Below m + 4 degrees of freedom of two sensors together the squared
    error has no variance, and the standard error means little.

    Examples
    --------
    >>> from tertia import weights
    >>> S = [[[4, 1], [1, 2]], [[1, -0.5], [-0.5, 3]]]
    >>> weights.fusion_loss(S, 10, method="first-order")
    FusionLoss(15.16%, first-order)
    """
    s = samples(covariances, "covariances")
    if method not in ("auto", "first-order", "monte-carlo"):
        choices = "'auto', 'first-order' or 'monte-carlo'"
        raise ValueError(f"method is {method!r}; it must be {choices}")
    trials = integer(trials, "trials", 2)
    # also where it is not used, for it checks everything
    first = _core.first_order_excess(s, _counts(n), convention, threads(n_threads))
    sensors, m = s.shape[-3:-1]
    laws = _core.wishart_law(_counts(n), convention, sensors)
    if method == "auto":
        enough = min(law[0] for law in laws) >= _FIRST_ORDER_FROM * (m + 1)
        method = "first-order" if enough else "monte-carlo"
    if method == "first-order":
        fused, excess, error = first[..., 0, :, :], first[..., 1, :, :], None
        loss = _trace(excess) / _trace(fused)
    else:
        draws = _draws(laws, m, trials, generator(rng))
        both, loss, error = _core.simulated_excess(s, draws, threads(n_threads))
        fused, excess = both[..., 0, :, :], both[..., 1, :, :]
        error = scalar_or_array(error)
    return FusionLoss(
        scalar_or_array(loss),
        _diagonal(excess) / _diagonal(fused),
        fused + excess,
        fused,
        error,
        method,
    )


def required_samples(
    covariances: npt.ArrayLike,
    loss: float = 0.05,
    *,
    method: Literal["first-order", "monte-carlo"] = "monte-carlo",
    convention: Convention = "sample-mean",
    trials: int = _TRIALS,
    rng: np.random.Generator | int = 0,
    n_threads: int | None = None,
) -> int | IntArray:
    """Return how many measurements per sensor keep the loss of the fused estimate under a bound.

    Parameters
    ----------
    covariances : array_like of shape (..., K, m, m)
        The true covariances, or what they may be; see `weight_matrices`.
    loss : float
        The bound on the loss as of `fusion_loss`.
    method : {"first-order", "monte-carlo"}
        "monte-carlo": the simulated loss plus two of its standard errors is under the bound.
        "first-order": closed form; promises too much where W is near 0 or I.
    convention : {"sample-mean", "known-mean", "paper", "differences"}
        How the covariances are estimated, see `sample_covariance`.
    trials : int
        Simulated sets of covariances for each n that is tried, at least 2.
    rng : numpy.random.Generator or int
        Source of randomness, or its seed; by default always the same.
    n_threads : int, optional
        Threads to use; by default one for little work and all cores for much.

    Returns
    -------
    int or ndarray of int, shape (...)
        The smallest n, the same for all sensors.

    Raises
    ------
    numpy.linalg.LinAlgError, ValueError, TypeError
        As for `fusion_loss`, or a bound that is not between 1e-6 and 1e6.

    Notes
    -----
    Without knowing the covariances of two sensors, n >= 15 m + 6 for m <= 3, and in general
    `1 + 22 max((m + 3)² / 16 [m <= 5], m - 1)`, kept the loss below 5 % in every case that was
    tried; for more sensors n >= 1 + 22 (m + 1) did (docs/weights.md).

    Examples
    --------
    >>> from tertia import weights
    >>> weights.required_samples([[[1.0]], [[1.0]]], 0.05, method="first-order")
    21
    """
    s = samples(covariances, "covariances")
    bound, trials = real(loss, "loss"), integer(trials, "trials", 2)
    if not 1e-6 <= bound <= 1e6:
        raise ValueError(f"loss is {bound}; it must be between 1e-6 and 1e6")
    if method not in ("first-order", "monte-carlo"):
        raise ValueError(f"method is {method!r}; it must be 'first-order' or 'monte-carlo'")
    seed = int(generator(rng).integers(2**63))
    both = _core.first_order_excess(s, _LARGEST_N, convention, threads(n_threads))
    per_factor = _trace(both[..., 1, :, :]) / _trace(both[..., 0, :, :])
    per_factor = np.atleast_1d(per_factor / _relative_factor(_LARGEST_N, convention)).ravel()
    sensors, m = s.shape[-3:-1]
    problems = s.reshape(-1, sensors, m, m)

    def first_order(problem: IntArray, n: int) -> npt.NDArray[np.bool_]:
        # a bound that is met exactly is kept, whatever rounding says
        return per_factor[problem] * _relative_factor(n, convention) <= bound * (1 + 1e-12)

    def simulated(problem: IntArray, n: int) -> npt.NDArray[np.bool_]:
        laws = _core.wishart_law(n, convention, sensors)
        draws = _draws(laws, m, trials, np.random.default_rng([seed, n]))
        _, mean, error = _core.simulated_excess(problems[problem], draws, threads(n_threads))
        return mean + _STANDARD_ERRORS * error <= bound

    least = _core.least_count(convention, sensors, m)
    found = _smallest(first_order, len(problems), least)
    if method == "monte-carlo":
        found = _smallest(simulated, len(problems), least, found)
    result: int | IntArray = scalar_or_array(found.reshape(s.shape[:-3]))
    return result


def blend(
    model: npt.ArrayLike, sample: npt.ArrayLike, n: npt.ArrayLike, n_model: float = 12.0
) -> FloatArray:
    """Blend a covariance that a model predicts with one that was estimated from few measurements.

    Parameters
    ----------
    model : array_like of shape (..., m, m)
        The covariance that the sensor's geometry and its nominal errors predict.
    sample : array_like of shape (..., m, m)
        The sample covariance.
    n : int, inf or array_like of shape (...)
        Measurements in the sample, at least 1.
    n_model : float
        How many degrees of freedom the model is worth.

    Returns
    -------
    ndarray of shape (..., m, m)
        `(n_model S_model + (n - 1) S) / (n_model + n - 1)`.

    Raises
    ------
    ValueError
        Shapes that do not fit, or a number that is not finite, too small, or not positive where it
        must be.
    TypeError
        An argument of the wrong type.

    Notes
    -----
    The mean of the inverse Wishart posterior, but for the m + 1 in its denominator. docs/weights.md
    compares it with the sample covariance alone and with general shrinkage.

    Examples
    --------
    >>> from tertia import weights
    >>> weights.blend([[1.0]], [[2.0]], 13)
    array([[1.5]])
    """
    predicted, measured = finite(model, "model"), finite(sample, "sample")
    for name, array in (("model", predicted), ("sample", measured)):
        if array.ndim < 2 or array.shape[-1] != array.shape[-2]:
            raise ValueError(f"{name} has shape {array.shape}; it must be (..., m, m)")
    if predicted.shape[-1] != measured.shape[-1]:
        raise ValueError(
            f"model has shape {predicted.shape} and sample {measured.shape}; their m must agree"
        )
    count, worth = samples(n, "n"), real(n_model, "n_model")
    if not 0 < worth < np.inf:
        raise ValueError(f"n_model is {worth}; it must be a positive number")
    if not np.all(count >= 1):
        raise ValueError("n must be at least 1 everywhere")
    _common_batch(model=predicted.shape[:-2], sample=measured.shape[:-2], n=count.shape)
    share = (worth / (worth + (count - 1.0)))[..., np.newaxis, np.newaxis]
    return share * predicted + (1.0 - share) * measured


def _smallest(
    holds: Callable[[IntArray, int], npt.NDArray[np.bool_]],
    count: int,
    least: int,
    guess: IntArray | None = None,
) -> IntArray:
    """Return for each of `count` problems the smallest n >= least for which `holds` says so.

    `holds` takes indices of problems and an n for all of them; it must not become false again.
    """
    low = np.full(count, least - 1)
    high = np.full(count, least) if guess is None else guess.copy()
    open_ended = np.ones(count, dtype=bool)
    while np.any(active := open_ended | (high - low > 1)):
        tried = np.where(open_ended, high, (low + high) // 2)
        for n in np.unique(tried[active]):
            problem = np.flatnonzero(active & (tried == n))
            held = holds(problem, int(n))
            high[problem[held]] = n
            low[problem[~held]] = n
            open_ended[problem[held]] = False
        doubled = open_ended & (low == high)
        high[doubled] *= 2
    return high


def _relative_factor(n: int, convention: Convention) -> float:
    """Return c of a sample covariance in units of its own mean."""
    [(degrees_of_freedom, _)] = _core.wishart_law(n, convention, 1)
    return 1 / degrees_of_freedom


def _draws(
    laws: list[tuple[float, float]], m: int, trials: int, rng: np.random.Generator
) -> FloatArray:
    """Draw the Wishart matrices of every sensor, (trials, K, m, m), for a true covariance I."""
    draws = []
    for degrees_of_freedom, mean in laws:
        whole = np.isinf(degrees_of_freedom) or degrees_of_freedom == int(degrees_of_freedom)
        if not (whole or degrees_of_freedom > m - 1):
            raise ValueError(
                f"n is too small: differences have {degrees_of_freedom:.2f} degrees of freedom, "
                f"and a simulation in {m} dimensions needs more than {m - 1}"
            )
        draws.append(mean * standard_wishart(m, degrees_of_freedom, (trials,), rng))
    return np.stack(draws, axis=1)


def _matched(x: FloatArray, s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return estimates and covariances of the same batch."""
    if x.shape[-2:] != s.shape[-3:-1]:
        raise ValueError(
            f"estimates has shape {x.shape}; for covariances of shape {s.shape} it must be "
            f"(..., {s.shape[-3]}, {s.shape[-2]})"
        )
    if x.shape[:-2] == s.shape[:-3]:
        return x, s
    batch = _common_batch(estimates=x.shape[:-2], covariances=s.shape[:-3])
    return np.broadcast_to(x, batch + x.shape[-2:]), np.broadcast_to(s, batch + s.shape[-3:])


def _combination(
    result: tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray],
    degrees_of_freedom: int,
) -> Combination:
    value, covariance, weights, statistic, p_value = result
    return Combination(
        value,
        covariance,
        weights,
        scalar_or_array(statistic),
        degrees_of_freedom,
        scalar_or_array(p_value),
    )


def _counts(n: Count) -> float | list[float]:
    """Return n as the core takes it."""
    if type(n) is int and n <= _LARGEST_N:
        return n
    array = samples(n, "n")
    if array.ndim > 1:
        raise ValueError(f"n has shape {array.shape}; it must be one number or one per sensor")
    counts: float | list[float] = array.tolist()
    return counts


def _deviation(sigma: npt.ArrayLike) -> FloatArray:
    """Return standard deviations that can be squared."""
    array = positive(sigma, "sigma")
    if np.any((array < _SMALLEST_SIGMA) | (array > 1 / _SMALLEST_SIGMA)):
        limits = f"between {_SMALLEST_SIGMA} and {1 / _SMALLEST_SIGMA}"
        raise ValueError(f"sigma must be {limits} everywhere; change the unit")
    return array


def _require_moderate(**arrays: FloatArray) -> None:
    for name, array in arrays.items():
        if np.any(np.abs(array) > 1 / _SMALLEST_SIGMA):
            raise ValueError(f"{name} has a number above {1 / _SMALLEST_SIGMA}; change the unit")


def _common_batch(**shapes: tuple[int, ...]) -> tuple[int, ...]:
    try:
        return np.broadcast_shapes(*shapes.values())
    except ValueError:
        told = ", ".join(f"{name} {shape}" for name, shape in shapes.items())
        raise ValueError(f"the batches do not fit together: {told}") from None


def _vectors(x: npt.ArrayLike, size: int) -> FloatArray:
    """Return vectors of this size; a single column is one, too."""
    array = finite(x, "x")
    if array.shape == (size, 1):
        array = array[:, 0]
    if array.shape[-1:] != (size,):
        raise ValueError(f"x has shape {array.shape}; it must be (..., {size})")
    return array


def _unvec(x: FloatArray, shape: tuple[int, int, int]) -> FloatArray:
    return _transposed(x.reshape(*x.shape[:-1], *shape))


def _vec(matrix: FloatArray) -> FloatArray:
    return _transposed(matrix).reshape(*matrix.shape[:-2], -1)


def _transposed(matrix: FloatArray) -> FloatArray:
    return np.swapaxes(matrix, -1, -2)


def _diagonal(matrix: FloatArray) -> FloatArray:
    return np.diagonal(matrix, axis1=-2, axis2=-1)


def _trace(matrix: FloatArray) -> FloatArray:
    trace: FloatArray = _diagonal(matrix).sum(axis=-1)
    return trace
