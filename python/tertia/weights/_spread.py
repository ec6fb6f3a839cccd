"""Covariance and bias of weights that are computed from estimated covariances."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy.typing as npt

from tertia import _core
from tertia._arrays import FloatArray, integer, samples, threads
from tertia.weights._samples import Convention

Count: TypeAlias = float | Sequence[float] | npt.NDArray[Any]

LARGEST_N = 2**53


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
        The true covariances, or their estimates, as for `weight_matrices`.
    n : int, inf or array_like of shape (K,)
        Number of measurements from which each covariance is estimated; inf if it is known.
    sensor : int
        Index of the sensor whose weight is considered; negative numbers count from the last.
    convention : {"sample-mean", "known-mean", "paper", "differences"}
        How the covariances are estimated (see `sample_covariance`).
    n_threads : int, optional
        Number of threads; by default one for small tasks and all cores for large ones.

    Returns
    -------
    ndarray of shape (..., m², m²)
        Covariance of vec W to first order. vec stacks columns, so that the element [b m + a, q m +
        p] is the covariance of `W[a, b]` and `W[p, q]`. The result is reliable if n is about 30 or
        more. For smaller n, the standard deviations are too small if W is near 0 or I
        (docs/weights-accuracy.md says by how much).

    Raises
    ------
    numpy.linalg.LinAlgError, ValueError, TypeError
        As for `weight_matrices`; also if there is no such sensor, or if an n is not a whole number
        of at least 2 or is too small. For m > 1, an n is too small if the variance is infinite.
        This is the case if two sensors together have fewer than m + 2 degrees of freedom. It is
        also the case if each sensor with fewer than m degrees of freedom lacks some number of them,
        and these numbers add up to m - 1 or more.

    Notes
    -----
    This is equation (10) of the source in closed form. The cost is O(K m⁴), whereas that of the
    product as printed is O(m⁶). In the convention "paper", c is as printed, and the Jacobian is
    taken at the given covariances. The result is then too large by the factor `n² / (n - 1)²`,
    because W does not change if all covariances are multiplied by n / (n - 1). `weight_bias` and
    `fusion_loss` allow for this property of W.

    Examples
    --------
    For scalars the result is `2 (c_1 + c_2) W² (1 - W)²`:

    >>> from tertia import weights
    >>> weights.weight_covariance([[[1.0]], [[1.0]]], 33)
    array([[0.0078125]])
    """
    k, s = integer(sensor, "sensor", -(2**31)), samples(covariances, "covariances")
    return _core.weigh(
        "covariance", s, threads(n_threads), sensor=k, n=counts(n), convention=convention
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
        As for `weight_covariance`.

    Returns
    -------
    ndarray of shape (..., m, m)
        Expected value of the estimated `W_sensor` minus the true `W_sensor`, to second order.

    Raises
    ------
    numpy.linalg.LinAlgError, ValueError, TypeError
        As for `weight_covariance`.

    Notes
    -----
    The bias is `-sum over j of c_j W_j [(I - W_j) + tr(I - W_j) I] (W - δ I)`, where δ is 1 if j is
    the sensor itself, and 0 otherwise. In the convention "paper", the factors n/(n - 1) of the
    covariances contribute to the bias if n differs between sensors. The cost is O(K m³).

    Examples
    --------
    >>> from tertia import weights
    >>> weights.weight_bias([[[1.0]], [[3.0]]], 31).round(5)
    array([[0.00625]])
    """
    k, s = integer(sensor, "sensor", -(2**31)), samples(covariances, "covariances")
    return _core.weigh("bias", s, threads(n_threads), sensor=k, n=counts(n), convention=convention)


def counts(n: Count) -> float | list[float]:
    """Return n in the form that the core expects."""
    if type(n) is int and n <= LARGEST_N:
        return n
    array = samples(n, "n")
    if array.ndim > 1:
        raise ValueError(f"n has shape {array.shape}; it must be one number or one per sensor")
    numbers: float | list[float] = array.tolist()
    return numbers
