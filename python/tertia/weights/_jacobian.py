"""Derivatives of a weight matrix with respect to the covariances."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tertia import _core
from tertia._arrays import FloatArray, finite, integer, samples, threads


@dataclass(frozen=True, slots=True, eq=False)
class JacobianOperator:
    """The Jacobian of a weight matrix, as an operator that multiplies vectors.

    The Jacobian itself is not formed. `scipy.sparse.linalg.aslinearoperator` accepts the operator
    if there is no batch.

    Attributes
    ----------
    left, right : ndarray of shape (..., K, m, m)
        The factors of `dW = sum over j of left_j dS_j right_j`.
    """

    left: FloatArray
    right: FloatArray

    @property
    def shape(self) -> tuple[int, int]:
        """Shape of the Jacobian, (m², K m²)."""
        sensors, m = self.left.shape[-3:-1]
        return m * m, sensors * m * m

    @property
    def dtype(self) -> np.dtype[np.float64]:
        """Type of the elements, always float64."""
        return self.left.dtype

    def matvec(self, x: npt.ArrayLike) -> FloatArray:
        """Return the change of vec W, (..., m²), if all vec S_j change by (..., K m²), in O(K m³).

        vec stacks columns.
        """
        sensors, m = self.left.shape[-3:-1]
        change = _unvec(_vectors(x, self.shape[1]), (sensors, m, m))
        product: FloatArray = self.left @ change @ self.right
        return _vec(product.sum(axis=-3))

    def rmatvec(self, y: npt.ArrayLike) -> FloatArray:
        """Return the product, (..., K m²), of the transposed Jacobian and a vector y, (..., m²).

        This product converts the gradient of a function with respect to W into the gradient of the
        same function with respect to all S_j. The cost is O(K m³). vec stacks columns.
        """
        m = self.left.shape[-1]
        gradient = _unvec(_vectors(y, self.shape[0]), (1, m, m))
        left, right = (np.swapaxes(factor, -1, -2) for factor in (self.left, self.right))
        product: FloatArray = left @ gradient @ right
        return np.swapaxes(product, -1, -2).reshape(*product.shape[:-3], -1)


def jacobian(
    covariances: npt.ArrayLike, sensor: int = -1, *, n_threads: int | None = None
) -> FloatArray:
    """Return the derivatives of one weight matrix with respect to all covariances.

    Parameters
    ----------
    covariances : array_like of shape (..., K, m, m)
        As for `weight_matrices`.
    sensor : int
        Index of the sensor whose weight is differentiated; negative numbers count from the last.
    n_threads : int, optional
        Number of threads; by default one for small tasks and all cores for large ones.

    Returns
    -------
    ndarray of shape (..., K, m², m²)
        `d vec W_sensor / d vec S_j` for each j. vec stacks columns in both W and S_j, so that the
        element [j, b m + a, q m + p] is `d W[a, b] / d S_j[p, q]`. All elements of `S_j` count as
        independent, so a symmetric change of an off-diagonal element changes two of them.

    Raises
    ------
    numpy.linalg.LinAlgError, ValueError, TypeError
        As for `weight_matrices`; also if there is no such sensor.

    Notes
    -----
    These are equations (7), (8) and (12) to (14) of the source. For two sensors and the weight of
    the second, the result consists of the matrices P1 and P2 of the source. In general it is `P_j =
    [C_j (W - δ I)]' ⊗ W_j`, where δ is 1 if j is the sensor itself, and 0 otherwise. The cost is
    O(K m⁴), which is the size of the result.

    Examples
    --------
    >>> from tertia import weights
    >>> weights.jacobian([[[1.0]], [[3.0]]]).ravel()
    array([ 0.1875, -0.0625])
    """
    k = integer(sensor, "sensor", -(2**31))
    s = samples(covariances, "covariances")
    return _core.weigh("jacobian", s, threads(n_threads), sensor=k)


def jacobian_operator(
    covariances: npt.ArrayLike, sensor: int = -1, *, n_threads: int | None = None
) -> JacobianOperator:
    """Return the Jacobian as an operator that multiplies vectors in O(K m³), without forming it.

    Parameters
    ----------
    covariances, sensor, n_threads
        As for `jacobian`.

    Returns
    -------
    JacobianOperator
        The operator, with `matvec` and `rmatvec`; vec stacks columns.

    Raises
    ------
    numpy.linalg.LinAlgError, ValueError, TypeError
        As for `jacobian`.

    Examples
    --------
    The change of the second sensor's weight if the variance of the first sensor increases by 0.1:

    >>> from tertia import weights
    >>> operator = weights.jacobian_operator([[[1.0]], [[3.0]]])
    >>> operator.matvec([0.1, 0.0])
    array([0.01875])
    """
    k = integer(sensor, "sensor", -(2**31))
    s = samples(covariances, "covariances")
    factors = _core.weigh("jacobian_factors", s, threads(n_threads), sensor=k)
    return JacobianOperator(factors[..., 0, :, :, :], factors[..., 1, :, :, :])


def _vectors(x: npt.ArrayLike, size: int) -> FloatArray:
    """Return vectors of this size; a single column also counts as a vector."""
    array = finite(x, "x")
    if array.shape == (size, 1):
        array = array[:, 0]
    if array.shape[-1:] != (size,):
        raise ValueError(f"x has shape {array.shape}; it must be (..., {size})")
    return array


def _unvec(x: FloatArray, shape: tuple[int, int, int]) -> FloatArray:
    return np.swapaxes(x.reshape(*x.shape[:-1], *shape), -1, -2)


def _vec(matrix: FloatArray) -> FloatArray:
    return np.swapaxes(matrix, -1, -2).reshape(*matrix.shape[:-2], -1)
