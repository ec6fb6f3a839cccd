"""Scenarios, methods and errors of the studies behind the pages; see `docs/figures.py`."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from tertia import estimate_bearing, metrics, screening
from tertia.simulate import direction_finder

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

SEED = 2006
# 95 % quantiles of chi-square with so many degrees of freedom
WITHIN_95 = {1: 3.841458820694124, 2: 5.991464547107979, 3: 7.814727903251178}
K1 = 2.4
CLEAN = {"single_probability": 0.0, "bursts_per_100": 0.0}
SINGLES = {"single_probability": 0.05, "bursts_per_100": 0.0}
SENSITIVE: dict[str, Any] = {"point_penalty": 2.0, "burst_penalty": 2.5}


@dataclass(frozen=True)
class Errors:
    """Errors of a batch of estimates, and the standard deviations that were claimed for them."""

    error: FloatArray
    sigma: FloatArray | None = None

    @property
    def rmse(self) -> float:
        """Root mean square error."""
        return float(np.sqrt(np.mean(self.error**2)))

    @property
    def rmse_error(self) -> float:
        """Standard error of `rmse`."""
        return float(np.std(self.error**2) / np.sqrt(self.error.size) / (2 * self.rmse))

    @property
    def coverage(self) -> float:
        """Share of errors within two of the claimed standard deviations."""
        assert self.sigma is not None
        return float(np.mean(np.abs(self.error) <= 2 * self.sigma))


Estimator = Callable[[FloatArray], Errors]


def generator(*study: int) -> np.random.Generator:
    """Return the source of randomness of one part of one study."""
    return np.random.default_rng([SEED, *study])


def normalised_squares(error: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return `metrics.nees` of many errors."""
    return np.asarray(metrics.nees(error, covariance))


def in_region(error: FloatArray, covariance: FloatArray) -> BoolArray:
    """Return whether errors (..., m) lie in the 95 % regions of their covariances (..., m, m)."""
    return normalised_squares(error, covariance) < WITHIN_95[error.shape[-1]]


def around(count: int, rng: np.random.Generator) -> FloatArray:
    """Return directions, (count, 2), in which stations are around a place, not quite evenly."""
    turn = 2 * np.pi * (np.arange(count) + rng.uniform(-0.3, 0.3, count)) / count
    return np.column_stack([np.sin(turn), np.cos(turn)])


def autoregressive(errors: FloatArray, correlation: float) -> FloatArray:
    """Make white errors, (runs, steps, ...), last from step to step; their variance is kept."""
    for step in range(1, errors.shape[1]):
        errors[:, step] *= np.sqrt(1 - correlation**2)
        errors[:, step] += correlation * errors[:, step - 1]
    return errors


def records(n: int, count: int, rng: np.random.Generator, **scenario: Any) -> FloatArray:
    """Return `count` records of `n` errors of measurement: the true bearing is 0, no wrapping."""
    return direction_finder(n, batch=count, rng=rng, period=None, **scenario).theta


def k2(n: int, block_size: int, significance: float = 0.05) -> float:
    """Return k2 of (M5) from the F distribution: L F(significance / L; nu, (L-1) nu)."""
    blocks = max(n // block_size, 2)
    c = screening.critical_value(
        blocks, significance, test="cochran", degrees_of_freedom=block_size - 1
    )
    return blocks * c * (blocks - 1) / (1 - c)


def library(**options: Any) -> Estimator:
    """Return `estimate_bearing` with these options."""

    def estimate(theta: FloatArray) -> Errors:
        result = estimate_bearing(theta, period=None, **options)
        return Errors(np.asarray(result.value), np.asarray(result.sigma))

    return estimate


def paper(block_size: int, k: float = K1, **options: Any) -> Estimator:
    """Return the algorithm as printed, with k2 from the F distribution."""

    def estimate(theta: FloatArray) -> Errors:
        factor = k2(theta.shape[-1], block_size)
        run = library(method="paper", block_size=block_size, k=k, variance_test=factor, **options)
        return run(theta)

    return estimate


def classical(k: float = K1, in_place: bool = True) -> Estimator:
    """Return the k-sigma rule to the letter, in place, element after element.

    An outlier becomes the mean of its two neighbours, outliers or not: the left one as replaced so
    far, the right one as measured. Not in place: both as measured.
    """

    def estimate(theta: FloatArray) -> Errors:
        mean, sd = theta.mean(-1, keepdims=True), theta.std(-1, ddof=1, keepdims=True)
        flagged = (np.abs(theta - mean) > k * sd).T
        y, last = theta.T.copy(), theta.shape[-1] - 1
        source = y if in_place else theta.T
        for i in range(last + 1):
            left, right = source[i - 1 if i > 0 else 1], source[i + 1 if i < last else last - 1]
            y[i] = np.where(flagged[i], (left + right) / 2, y[i])
        return Errors(y.mean(axis=0))

    return estimate


def nearest_kept(theta: FloatArray) -> Errors:
    """Mean after `screening.k_sigma`, which replaces by the nearest values that are not flagged."""
    return Errors(np.asarray(screening.k_sigma(theta, K1).mean))


def median(theta: FloatArray) -> Errors:
    """Median."""
    return Errors(np.median(theta, axis=-1))


def hampel(theta: FloatArray) -> Errors:
    """Mean of what lies within three deviations (1.4826 MAD) of the median."""
    deviation = np.abs(theta - np.median(theta, axis=-1, keepdims=True))
    kept = deviation <= 3 * 1.4826 * np.median(deviation, axis=-1, keepdims=True)
    return Errors(np.mean(theta, axis=-1, where=kept))


METHODS: dict[str, Estimator] = {
    "mean": library(method="mean"),
    "k-sigma, to the letter": classical(),
    "k-sigma, both as measured": classical(in_place=False),
    "k-sigma, nearest kept": nearest_kept,
    "k-sigma, excluded": library(method="k-sigma", k=K1),
    "median": median,
    "Hampel (3 MAD), excluded": hampel,
    "paper, n_g=5": paper(5),
    "paper, n_g=10": paper(10),
    "paper, n_g=5, Cochran": library(method="paper", block_size=5, k=K1),
    "paper, n_g=10, Cochran": library(method="paper", k=K1),
    "corrected, n_g=5": library(method="corrected", block_size=5, k=K1),
    "corrected, n_g=10": library(method="corrected", k=K1),
    "default": library(),
}
WITH_SIGMA = ["mean", "k-sigma, excluded", *(name for name in METHODS if "n_g" in name), "default"]
