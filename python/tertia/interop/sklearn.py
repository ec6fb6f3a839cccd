"""Estimators for scikit-learn: outlier detectors, and a cleaner and a smoother for columns.

A matrix `(n_samples, n_features)` is a recording: rows are instants, columns are quantities, and
each column is screened or smoothed separately. nan is 'no measurement'.

`BandDetector` and `Cleaner` learn a band for each column and apply it to any rows. The results of
`BurstDetector` and `Smoother` for a row depend on the rows before and after it, so rows must be in
time order. Like `LocalOutlierFactor` and `TSNE` of scikit-learn, they process only the rows to
which they are fitted. Needs the extra `sklearn` (scikit-learn).
"""

from __future__ import annotations

import math
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from sklearn.base import BaseEstimator, OneToOneFeatureMixin, OutlierMixin, TransformerMixin
from sklearn.utils.validation import check_is_fitted, validate_data

from tertia import screening, smoothing
from tertia._arrays import FloatArray, IntArray, probability, real

__all__ = ["BandDetector", "BurstDetector", "Cleaner", "Smoother"]

# two measurements for a variance, and one to be compared with it
_FEWEST = 3
_MOST_PASSES = 10
# share of values that cleaning removes without outliers, and share of their variance that remains
_TAKEN = math.erfc(3.0 / math.sqrt(2.0))
_LEFT = 1.0 - 6.0 * math.exp(-4.5) / math.sqrt(2.0 * math.pi) / (1.0 - _TAKEN)


class _Columns(BaseEstimator):  # type: ignore[misc]
    """Base class of estimators for a matrix in which nan is 'no measurement'."""

    def _values(self, X: Any, **options: Any) -> FloatArray:  # noqa: N803  # as scikit-learn
        values: FloatArray = validate_data(
            self, X, dtype=np.float64, ensure_all_finite="allow-nan", **options
        )
        return values

    def __sklearn_tags__(self) -> Any:
        """Declare that nan is allowed."""
        tags = super().__sklearn_tags__()
        tags.input_tags.allow_nan = True
        return tags


class _Band(_Columns):
    """A band for each column, outside which a value is an outlier."""

    significance: float
    period: float | None
    center_: FloatArray
    half_width_: FloatArray

    def _fit_bands(self, X: Any, *, together: bool) -> None:  # noqa: N803  # as scikit-learn
        values = self._values(X, ensure_min_samples=_FEWEST)
        significance = probability(self.significance, "significance")
        if together:
            significance = -math.expm1(math.log1p(-significance) / values.shape[1])
        bands = [_band(column, significance, _period(self.period)) for column in values.T]
        self.center_, self.half_width_ = np.array(bands).T

    def _excess(self, X: Any) -> tuple[FloatArray, FloatArray]:  # noqa: N803  # as scikit-learn
        """Return the values, and their distances from the middle of the band in half widths."""
        check_is_fitted(self)
        values = self._values(X, reset=False)
        off = np.abs(_wrapped(values - self.center_, _period(self.period)))
        # if all values were equal, the half width of the band is 0
        with np.errstate(divide="ignore", invalid="ignore"):
            excess = np.where(off > 0, off / self.half_width_, 0.0)
        return values, np.where(np.isnan(values), 0.0, excess)


class BandDetector(OutlierMixin, _Band):  # type: ignore[misc]
    """Detector of rows with a value outside the band of its column.

    Each column is cleaned repeatedly by the leave-one-out rule, which removes 0.27 percent of a
    sample without outliers, until the rule finds no more outliers. The band is computed from the
    mean and standard deviation of the remaining values; a new measurement that is not an outlier
    lies outside it with a probability that depends on `significance`. Up to a tenth of the values
    may be outliers.

    Parameters
    ----------
    significance : float
        Probability of flagging a row without outliers, for all its columns together.
    period : float or None
        Period of angles, such as 360.0 for degrees, so that 359 and 1 are close to each other; None
        for values that do not wrap.

    Attributes
    ----------
    center_, half_width_ : ndarray of shape (n_features,)
        The bands.
    offset_ : float
        Threshold of `score_samples`, -1.
    n_features_in_ : int
        Number of columns.

    Notes
    -----
    The false-alarm rate is equal to `significance` for new rows, if the noise is normal and the
    columns are independent. With few rows, cleaning removes more values than intended: for a
    significance of 0.01, the false-alarm rate is 0.013 with 20 rows and 0.015 with 10.

    Examples
    --------
    >>> import numpy as np
    >>> from tertia.interop.sklearn import BandDetector
    >>> X = np.random.default_rng(1).normal(size=(200, 2))
    >>> X[7, 0] = 9.0
    >>> BandDetector().fit_predict(X).argmin()
    np.int64(7)
    """

    def __init__(self, significance: float = 0.01, period: float | None = None) -> None:
        self.significance = significance
        self.period = period

    def fit(self, X: Any, y: Any = None) -> BandDetector:  # noqa: N803  # as scikit-learn
        """Learn the bands of the columns of X, of shape (n_samples, n_features), n_samples >= 3."""
        self._fit_bands(X, together=True)
        self.offset_ = -1.0
        return self

    def score_samples(self, X: Any) -> FloatArray:  # noqa: N803  # as scikit-learn
        """Return the negative of the largest distance from the middle of a band, in half widths."""
        scores: FloatArray = -self._excess(X)[1].max(axis=1)
        return scores

    def decision_function(self, X: Any) -> FloatArray:  # noqa: N803  # as scikit-learn
        """Return `score_samples` minus `offset_`: negative for outliers."""
        return self.score_samples(X) - self.offset_

    def predict(self, X: Any) -> IntArray:  # noqa: N803  # as scikit-learn
        """Return -1 for rows with an outlier, 1 for others."""
        return np.where(self.decision_function(X) < 0, -1, 1)


class Cleaner(OneToOneFeatureMixin, TransformerMixin, _Band):  # type: ignore[misc]
    """Transformer that replaces values outside the band of their column by nan.

    Parameters
    ----------
    significance : float
        Probability that a value that is not an outlier is removed.
    period : float or None
        Period of angles, such as 360.0 for degrees; None for values that do not wrap.

    Attributes
    ----------
    center_, half_width_ : ndarray of shape (n_features,)
        The bands, as in `BandDetector`.
    n_features_in_ : int
        Number of columns.

    Examples
    --------
    >>> from tertia.interop.sklearn import Cleaner
    >>> Cleaner().fit_transform([[9.8], [10.1], [10.0], [25.0], [9.9]]).ravel()
    array([ 9.8, 10.1, 10. ,  nan,  9.9])
    """

    def __init__(self, significance: float = 0.005, period: float | None = None) -> None:
        self.significance = significance
        self.period = period

    def fit(self, X: Any, y: Any = None) -> Cleaner:  # noqa: N803  # as scikit-learn
        """Learn the bands of the columns of X, of shape (n_samples, n_features), n_samples >= 3."""
        self._fit_bands(X, together=False)
        return self

    def transform(self, X: Any) -> FloatArray:  # noqa: N803  # as scikit-learn
        """Return X with nan instead of the values outside the bands."""
        values, excess = self._excess(X)
        return np.where(excess > 1.0, np.nan, values)


class BurstDetector(OutlierMixin, _Columns):  # type: ignore[misc]
    """Detector of rows with a single outlier or a part of a burst in at least one column.

    Rows must be in time order. Like `LocalOutlierFactor`, the detector judges only the rows to
    which it is fitted.

    Parameters
    ----------
    point_penalty, burst_penalty : float
        Smallest improvements of the fit for which a single outlier and a burst are accepted, as for
        `tertia.screening.bursts`.
    min_burst, max_burst : int
        Numbers of rows of the shortest and the longest burst.
    correlation : float
        Correlation of successive measurements in a record without outliers.

    Attributes
    ----------
    outlier_ : ndarray of bool, shape (n_samples, n_features)
        True for outliers.
    n_features_in_ : int
        Number of columns.

    Examples
    --------
    >>> import numpy as np
    >>> from tertia.interop.sklearn import BurstDetector
    >>> X = np.random.default_rng(2).normal(10, 1, (100, 1))
    >>> X[40:46] += 4
    >>> np.flatnonzero(BurstDetector().fit_predict(X) == -1)
    array([40, 41, 42, 43, 44, 45])
    """

    outlier_: npt.NDArray[np.bool_]

    def __init__(
        self,
        point_penalty: float = 2.5,
        burst_penalty: float = 3.0,
        min_burst: int = 2,
        max_burst: int = 20,
        correlation: float = 0.0,
    ) -> None:
        self.point_penalty = point_penalty
        self.burst_penalty = burst_penalty
        self.min_burst = min_burst
        self.max_burst = max_burst
        self.correlation = correlation

    def fit(self, X: Any, y: Any = None) -> BurstDetector:  # noqa: N803  # as scikit-learn
        """Find the outliers of X, of shape (n_samples, n_features), n_samples >= 3."""
        values = self._values(X, ensure_min_samples=_FEWEST)
        found = screening.bursts(values.T, nan_policy="omit", **self.get_params())
        self.outlier_ = found.outlier.T
        return self

    def fit_predict(self, X: Any, y: Any = None) -> IntArray:  # noqa: N803  # as scikit-learn
        """Return -1 for rows with an outlier, 1 for others."""
        return np.where(self.fit(X).outlier_.any(axis=1), -1, 1)


class Smoother(_Columns):
    """Transformer that smooths columns by local polynomials.

    Rows must be in time order, at equal time steps. Like `TSNE`, the smoother transforms only the
    rows to which it is fitted.

    Parameters
    ----------
    window : int
        Number of rows in a window, odd.
    degree : int or "adaptive"
        Degree of the polynomials, as for `tertia.smoothing.local_polynomial`.
    derivative : int
        Order of the derivative: 0 for the values, 1 for their change from row to row, and so on.
    period : float or None
        Period of angles, such as 360.0 for degrees; None for values that do not wrap. Angles must
        change by less than half a period from row to row.

    Attributes
    ----------
    embedding_ : ndarray of shape (n_samples, n_features)
        The smoothed values; nan where a window has too few measurements.
    sigma_ : ndarray of shape (n_samples, n_features)
        Standard deviations of the smoothed values.
    n_features_in_ : int
        Number of columns.

    Examples
    --------
    >>> import numpy as np
    >>> from tertia.interop.sklearn import Smoother
    >>> t = np.arange(60)
    >>> X = (t + np.random.default_rng(1).normal(size=60))[:, np.newaxis]
    >>> bool(np.std(Smoother().fit_transform(X)[:, 0] - t) < 0.6)
    True
    """

    embedding_: FloatArray
    sigma_: FloatArray

    def __init__(
        self,
        window: int = 13,
        degree: int | Literal["adaptive"] = "adaptive",
        derivative: int = 0,
        period: float | None = None,
    ) -> None:
        self.window = window
        self.degree = degree
        self.derivative = derivative
        self.period = period

    def fit(self, X: Any, y: Any = None) -> Smoother:  # noqa: N803  # as scikit-learn
        """Smooth X, of shape (n_samples, n_features)."""
        values, period = self._values(X), _period(self.period)
        options = {name: one for name, one in self.get_params().items() if name != "period"}
        if period is not None:
            values = np.column_stack([_unwrapped(column, period) for column in values.T])
        found = smoothing.local_polynomial(values.T, **options)
        self.embedding_, self.sigma_ = found.value.T, found.sigma.T
        if period is not None and self.derivative == 0:
            self.embedding_ %= period
        return self

    def fit_transform(self, X: Any, y: Any = None) -> FloatArray:  # noqa: N803  # as scikit-learn
        """Return the smoothed columns of X."""
        return self.fit(X).embedding_


def _period(period: float | None) -> float | None:
    if period is None:
        return None
    number = real(period, "period")
    if not 0.0 < number < math.inf:
        raise ValueError(f"period is {number:g}; it must be positive and finite, or None")
    return number


def _wrapped(angles: FloatArray, period: float | None) -> FloatArray:
    """Return differences of angles between minus and plus half a period."""
    if period is None:
        return angles
    half = period / 2
    found: FloatArray = (angles + half) % period - half
    return found


def _unwrapped(column: FloatArray, period: float) -> FloatArray:
    """Return angles without jumps by a period; nan remains."""
    known = ~np.isnan(column)
    found: FloatArray = column.copy()
    found[known] = np.unwrap(column[known], period=period)
    return found


def _band(column: FloatArray, significance: float, period: float | None) -> tuple[float, float]:
    """Return the middle and the half width of the band of one column."""
    known = column[~np.isnan(column)]
    if len(known) < _FEWEST:
        raise ValueError(f"a column has {len(known)} measurements; at least {_FEWEST} are needed")
    if period is not None:
        known = screening.unwrap_about_median(known, period)
    k = screening.critical_value(len(known), _TAKEN)
    clean = screening.leave_one_out(known, k, replace=False, passes=_MOST_PASSES)
    left = len(known) - int(np.count_nonzero(clean.outlier))
    width = screening.critical_value(left, significance, test="t-test")
    return float(clean.mean), width * float(np.sqrt(clean.variance / _LEFT))
