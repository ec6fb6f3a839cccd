"""Correction of sigmas if covariances are estimated from few measurements."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tertia import _core
from tertia._arrays import FloatArray, diagonal
from tertia.weights._loss import _draws

_TRIALS = 2000
# of a simulated covariance over the estimated one, if some would otherwise be singular
_LEAST = 1e-3


def enlarged(
    covariances: FloatArray,
    statistic: float,
    laws: Sequence[tuple[float, float]],
) -> tuple[FloatArray, float]:
    """Return factors for the sigmas of a fused estimate, and the p-value of its statistic.

    `covariances` (K, m, m) are estimated; `laws` contains the degrees of freedom and the mean of
    the Wishart distribution of each. When the sigmas are multiplied by the factors, (m,), an
    interval of two sigmas contains a component with a probability of 95.45 %. For one estimate, the
    factor is half of the two-sided 95.45 % quantile of Student's distribution, because the interval
    of a normal error has a half-width of two sigmas. For several estimates, the factors are
    computed by a simulation in which the estimated covariances are treated as the true ones
    (parametric bootstrap). Given the simulated covariances the error is normal, so only covariances
    have to be drawn.
    """
    sensors, m = covariances.shape[:2]
    if sensors == 1:
        return np.full(m, _core.student_factor(laws[0][0])), 1.0
    rng = np.random.default_rng(0)
    root = _root(covariances)
    drawn = _draws(list(laws), m, _TRIALS, rng)
    errors = (root @ rng.standard_normal((_TRIALS, sensors, m, 1)))[..., 0]
    try:
        claimed, weights, drawn_statistic = _fused(errors, _between(root, drawn))
    except np.linalg.LinAlgError:
        regular = _between(root, drawn + _LEAST * np.eye(m))
        claimed, weights, drawn_statistic = _fused(errors, regular)
    actual = np.sum(weights @ covariances @ np.swapaxes(weights, -1, -2), axis=1)
    ratio = np.sqrt(diagonal(claimed) / diagonal(actual))
    factors = np.array(_core.simulated_factors(np.ascontiguousarray(ratio.T)))
    larger = np.count_nonzero(np.asarray(drawn_statistic) >= statistic)
    return factors, (larger + 1) / (_TRIALS + 1)


def _between(root: FloatArray, drawn: FloatArray) -> FloatArray:
    """Return symmetric products of matrices with roots on both sides."""
    product = root @ drawn @ np.swapaxes(root, -1, -2)
    symmetric: FloatArray = (product + np.swapaxes(product, -1, -2)) / 2
    return symmetric


def _fused(errors: FloatArray, covariances: FloatArray) -> tuple[FloatArray, ...]:
    """Return the covariances, weights and statistics of fused errors."""
    (_, claimed, weights, _, statistic, _), _ = _core.fuse(
        {
            "estimates": errors,
            "covariances": covariances,
            "cross_covariances": None,
            "corrections": None,
            "weights": None,
            "method": "matrix",
            "random_effects": False,
            "period": None,
        },
        None,
    )
    return claimed, weights, statistic


def _root(covariances: FloatArray) -> FloatArray:
    """Return the symmetric square roots of covariances, which may be singular."""
    values, vectors = np.linalg.eigh(covariances)
    root: FloatArray = vectors * np.sqrt(np.maximum(values, 0.0))[..., np.newaxis, :]
    symmetric: FloatArray = root @ np.swapaxes(vectors, -1, -2)
    return symmetric
