"""How a weight changes with the covariances."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tertia import _core
from tertia._arrays import FloatArray, finite, integer, samples, threads


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
        See `weight_matrices`.
    sensor : int
        The sensor whose weight it is; negative numbers count from the last.
    n_threads : int, optional
        Number of threads; by default one for small tasks and all cores for large ones.

    Returns
    -------
    ndarray of shape (..., K, m², m²)
        `d vec W_sensor / d vec S_j` for each j. vec stacks columns, on both sides: element
        [j, b m + a, q m + p] is `d W[a, b] / d S_j[p, q]`. All elements of `S_j` count as free, so
        a change must be made in both halves.

    Raises
    ------
    numpy.linalg.LinAlgError, ValueError, TypeError
        As for `weight_matrices`, or no such sensor.

    Notes
    -----
    (7), (8) and (12) to (14) of the source; for two sensors and the second one's weight these are
    P1 and P2. `P_j = [C_j (W - δ I)]' ⊗ W_j`, where δ is 1 for the sensor itself. Cost O(K m⁴),
    that of writing the result.

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
        See `jacobian`.

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
    factors = _core.weigh("jacobian_factors", s, threads(n_threads), sensor=k)
    return JacobianOperator(factors[..., 0, :, :, :], factors[..., 1, :, :, :])


def _vectors(x: npt.ArrayLike, size: int) -> FloatArray:
    """Return vectors of this size; a single column is one, too."""
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
