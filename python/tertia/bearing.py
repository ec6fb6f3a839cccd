"""Bearing: one angle with its standard deviation from a sample of measured angles.

Source: Manoilov, Pysarchuk, Pavliuk 2006, stages 1 to 3.2 and equations (M5)-(M7), as printed
(`method="paper"`) and corrected. The default is more accurate than both.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from tertia import _core
from tertia._arrays import (
    BoolArray,
    FloatArray,
    NanPolicy,
    integer,
    omits,
    real,
    samples,
    scalar_or_array,
    threads,
)

__all__ = ["BearingEstimate", "Method", "estimate_bearing"]

Method: TypeAlias = Literal["robust", "corrected", "paper", "k-sigma", "mean"]


@dataclass(frozen=True, slots=True, eq=False)
class BearingEstimate:
    """A bearing, its standard deviation, and the outliers found on the way.

    Attributes
    ----------
    value : float or ndarray of shape (...)
        The bearing, in [0, period) if there is a period.
    sigma : float or ndarray of shape (...)
        Its standard deviation.
    outlier : ndarray of bool, shape (..., N)
        Which measurements are outliers, including all those of a rejected block.
    polarity : float or ndarray of shape (...)
        `(N+ - N-) / N`: outliers above the bearing less those below.
    block_means, block_variances, block_weights : ndarray of shape (..., L) or None
        The blocks as they entered the estimate, with means in the unwrapped angle and weights that
        sum to one. The mean is nan in a block without measurements, and the variance in one with
        fewer than two. None where the method has no blocks.
    """

    value: float | FloatArray
    sigma: float | FloatArray
    outlier: BoolArray
    polarity: float | FloatArray
    block_means: FloatArray | None
    block_variances: FloatArray | None
    block_weights: FloatArray | None

    def __repr__(self) -> str:
        """Show numbers, not arrays."""
        found = f"outliers {np.count_nonzero(self.outlier)} of {self.outlier.size}"
        if self.outlier.ndim > 1:
            return f"BearingEstimate(batch {self.outlier.shape[:-1]}, {found})"
        return (
            f"BearingEstimate({self.value:.6g} ± {self.sigma:.3g}, {found}, "
            f"polarity {self.polarity:+.3g})"
        )


def estimate_bearing(
    theta: npt.ArrayLike,
    *,
    period: float | None = 360.0,
    method: Method = "robust",
    block_size: int = 10,
    k: float = 2.5,
    variance_test: Literal["cochran", "student"] | float | None = "cochran",
    significance: float = 0.05,
    point_penalty: float = 2.5,
    burst_penalty: float = 3.0,
    min_burst: int = 2,
    max_burst: int = 20,
    correlation: float = 0.0,
    rounding: float = 0.0,
    nan_policy: NanPolicy = "raise",
    n_threads: int | None = None,
) -> BearingEstimate:
    """Estimate a bearing and its standard deviation from measurements with outliers.

    The angles are unwrapped about their circular median first and the result is wrapped back, so
    north is a direction like any other.

    Parameters
    ----------
    theta : array_like of shape (..., N)
        Measured bearings in time order. N >= 5 for "robust" (30 or more for the error rates of the
        documentation), >= 3 for the others, >= 2 for "mean".
    period : float or None
        360.0 for degrees, 2*pi for radians, None for data that do not wrap.
    method : {"robust", "corrected", "paper", "k-sigma", "mean"}
        "robust": `tertia.screening.bursts` finds single outliers and bursts; the rest is averaged
        in blocks weighted by moderated variances.
        "paper": the algorithm as printed: leave-one-out screening, blocks with an outlying mean or
        variance replaced, blocks weighted by 1/d_j, sigma by (M7). This sigma is not that of the
        bearing: see the documentation.
        "corrected": the same with exclusion instead of replacement, Grubbs' test for the means of
        blocks, the exact test for their variances, and the right sigma.
        "k-sigma": mean of the measurements that satisfy `|y - M| <= k sqrt(D)`.
        "mean": mean of all.
    block_size : int
        Consecutive measurements per block, at least 2; the last block takes the remainder.
    k : float
        Threshold of the screening in "paper", "corrected" (k1 of the paper) and "k-sigma".
    variance_test : {"cochran", "student"}, float or None
        When the variance of a block is too large, in "paper" and "corrected". "cochran": by the
        exact F test at `significance`. A number: if `d_j > k2 / sum(1/d_j)` with this k2 >= 1.
        "student": with the k2 of the paper, for demonstration only, as it nearly always rejects
        some clean block. None: never.
    significance : float
        Significance of the tests among blocks.
    point_penalty, burst_penalty, min_burst, max_burst, rounding
        For "robust": see `tertia.screening.bursts`.
    correlation : float
        Correlation of successive measurements in a quiet record. Widens sigma by
        `sqrt((1 + correlation) / (1 - correlation))` in all methods but "paper".
    nan_policy : {"raise", "omit"}
        "omit": nan is 'no measurement'; blocks are formed of the measurements that remain.
    n_threads : int, optional
        Number of threads; by default one for small tasks and all cores for large ones.

    Returns
    -------
    BearingEstimate
        Angles in the unit of `theta`.

    Raises
    ------
    ValueError
        Too few measurements, one that is not finite, deviations too large or too small to be
        squared, a parameter of the method outside its domain (those of other methods are ignored),
        an unknown word, or too few measurements left.
    TypeError
        An argument of the wrong type.

    Examples
    --------
    >>> import tertia
    >>> record = tertia.simulate.direction_finder(100, bearing=359.0, rng=7)
    >>> tertia.estimate_bearing(record.theta)
    BearingEstimate(358.477 ± 0.305, outliers 2 of 100, polarity -0.02)
    """
    options = {
        "period": None if period is None else real(period, "period"),
        "method": str(method),
        "block_size": integer(block_size, "block_size", 2),
        "k": real(k, "k"),
        "variance_test": _variance_test(variance_test),
        "significance": real(significance, "significance"),
        "point_penalty": real(point_penalty, "point_penalty"),
        "burst_penalty": real(burst_penalty, "burst_penalty"),
        "min_burst": integer(min_burst, "min_burst", 2),
        "max_burst": integer(max_burst, "max_burst", 2),
        "correlation": real(correlation, "correlation"),
        "rounding": real(rounding, "rounding"),
    }
    value, sigma, outlier, polarity, blocks = _core.estimate_bearing(
        samples(theta, "theta"), options, omits(nan_policy), threads(n_threads)
    )
    return BearingEstimate(
        scalar_or_array(value),
        scalar_or_array(sigma),
        outlier,
        scalar_or_array(polarity),
        *(blocks or (None, None, None)),
    )


def _variance_test(value: str | float | None) -> str | float | None:
    return value if value is None or isinstance(value, str) else real(value, "variance_test")
