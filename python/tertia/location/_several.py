"""Systematic errors of several sensors, each at several places, estimated together."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from tertia._arrays import FloatArray

# of Tukey's biweight
TUKEY = 4.685
# factors of the sigmas in the rounds: at first, whole sensors must not look like outliers
_ROUNDS = (10.0, 3.0, 1.0, 1.0, 1.0, 1.0)
# change of an error with which derivatives are computed, in random standard deviations
_CHANGE = 0.3
# common sizes that are tried if none is stated, and their usual one, in random standard deviations
_SIZES, _USUAL = np.geomspace(0.05, 30.0, 25), 2.0

# positions (n, D), covariances (n, D, D) and residuals (n, kinds, K) without each of several rows
# of errors, with the sigmas times a factor
Solve = Callable[[FloatArray, float], Sequence[npt.NDArray[Any]] | None]


def several_errors(
    units: FloatArray, sizes: FloatArray, solve: Solve
) -> tuple[FloatArray, FloatArray, FloatArray] | None:
    """Return the errors of G groups, their variances, and the covariance of the position.

    `units` are the random standard deviations of the groups, `sizes` the stated ones of their
    errors, nan if unknown. None if there is no position. Position and errors are estimated
    together, in Gauss-Newton steps: the residuals are linear in the errors, and the position
    follows them. Errors of unknown size have one size, relative to the random errors, in common: it
    has half of Cauchy's distribution.
    """
    errors, whole = np.zeros(len(units)), None
    changes = _CHANGE * np.concatenate([np.zeros_like(errors)[np.newaxis], np.eye(len(units))])
    changes = np.concatenate([changes, -changes[1:]]) * units
    for factor in _ROUNDS:
        solved = solve(errors + changes, factor)
        if solved is None:
            continue
        position, covariance, residual = solved
        linear = _linear(factor * residual.reshape(len(changes), -1), factor, position.shape[-1])
        noise, information, gradient = linear
        mean, spread = _posterior(
            information, gradient + information @ (errors / units), sizes / units
        )
        errors, moves = mean * units, _slopes(position)
        whole = noise * covariance[0] + moves.T @ spread @ moves if factor == 1.0 else None
    return None if whole is None else (errors, np.diag(spread) * units**2, whole)


def _linear(
    residual: FloatArray, factor: float, unknown: int
) -> tuple[float, FloatArray, FloatArray]:
    """Return the noise factor², the information about the errors, and the gradient.

    `residual` are those without the errors, and without errors that are changed, in sigmas.
    """
    slope = _slopes(residual)
    weight = np.clip(1.0 - (residual[0] / (factor * TUKEY)) ** 2, 0.0, None) ** 2
    known = (weight > 0) & np.isfinite(slope).all(axis=0)
    rest, slope, weight = residual[0, known], slope[:, known], weight[known]
    free = max(len(rest) - len(slope) - unknown, 1)
    noise = max(1.0, float(weight @ rest**2) / free)
    return noise, (weight * slope) @ slope.T / noise, -(weight * slope) @ rest / noise


def _slopes(values: FloatArray) -> FloatArray:
    """Return the derivatives with respect to each error, in random standard deviations."""
    groups = len(values) // 2
    return (values[1 : groups + 1] - values[groups + 1 :]) / (2 * _CHANGE)


def _posterior(
    information: FloatArray, gradient: FloatArray, sizes: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return mean and covariance of the errors, averaged over the unknown size of some of them."""
    unknown = np.isnan(sizes)
    size = np.where(unknown, _SIZES[:, np.newaxis], sizes)
    # Cauchy's density, times the distances of the sizes
    share = _SIZES / (_USUAL**2 + _SIZES**2)
    if not unknown.any():
        size, share = size[:1], share[:1]
    identity = np.eye(len(sizes))
    # in units of the sizes, which may be small
    inner = identity + size[:, :, np.newaxis] * information * size[:, np.newaxis]
    scaled = size * gradient
    solved = np.linalg.solve(inner, scaled[..., np.newaxis])[..., 0]
    means = size * solved
    inverse = np.linalg.inv(inner)
    covariances = size[:, :, np.newaxis] * inverse * size[:, np.newaxis]
    log = 0.5 * np.sum(scaled * solved, axis=1) - 0.5 * np.linalg.slogdet(inner)[1]
    share = share * np.exp(log - log.max())
    share /= share.sum()
    mean = share @ means
    away = means - mean
    spread = covariances + away[:, :, np.newaxis] * away[:, np.newaxis]
    return mean, np.einsum("n,nij->ij", share, spread)
