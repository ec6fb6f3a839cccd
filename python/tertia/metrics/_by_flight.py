"""Intervals of figures of many flights, each of which is alike within itself."""

from __future__ import annotations

import numpy as np

from tertia import _core
from tertia._arrays import FloatArray
from tertia.metrics._indicator import Indicator

# how much less than independent values a record is worth where it shows nothing of that
_USUAL_EFFECT = 4.0
_RESAMPLED, _AT_ONCE = 2000, 100


def share_by_flight(
    hits: FloatArray, counts: FloatArray, level: float, limit: float | None, *, least: bool
) -> Indicator:
    """Return the share of hits of flights, with Wilson's interval and Student's quantiles.

    The number of values is divided by the design effect: the variance by flight,
    `g/(g−1) Σ (h − p n)²/N²`, over that of independent values, `p (1−p)/N`. `least` says whether
    the limit is a smallest share.
    """
    hits, counts = hits[counts > 0], counts[counts > 0]
    total, flights = float(counts.sum()), len(counts)
    if not total:
        return Indicator(np.nan, np.nan, np.nan, 0, 0.0, "")
    share = float(hits.sum()) / total
    number, freedom = total / _USUAL_EFFECT, np.inf
    if flights > 1 and 0.0 < share < 1.0:
        by_flight = flights / (flights - 1) * np.sum((hits - share * counts) ** 2) / total**2
        effect = max(1.0, float(by_flight) / (share * (1.0 - share) / total))
        number, freedom = total / effect, float(flights - 1)
    low, high = share_interval(share, number, freedom, level)
    verdict = _verdict(low, high, limit, least=least)
    return Indicator(share, low, high, int(total), number, verdict)


def share_interval(
    share: float, number: float, degrees_of_freedom: float, level: float
) -> tuple[float, float]:
    """Return Wilson's interval; of none or all, the bound that they exceed with `1 − level`."""
    if share in {0.0, 1.0}:
        # 1 − 3/n at 95 %, exactly
        bound = (1.0 - level) ** (1.0 / number)
        return (bound, 1.0) if share else (0.0, 1.0 - bound)
    worth = {
        "number": np.array([number]),
        "probability": np.ones(1),
        "degrees_of_freedom": degrees_of_freedom,
    }
    low, high = _core.share_interval(share, worth, level)
    return low, high


def root_by_flight(
    squares: FloatArray, counts: FloatArray, level: float, limit: float | None
) -> Indicator:
    """Return the root of the mean square of flights, with percentiles of resampled flights."""
    squares, counts = squares[counts > 0], counts[counts > 0]
    total, flights = float(counts.sum()), len(counts)
    if not total:
        return Indicator(np.nan, np.nan, np.nan, 0, 0.0, "")
    root = float(np.sqrt(squares.sum() / total))
    low, high = 0.0, np.inf
    if flights > 1:
        rng = np.random.default_rng(0)
        roots = []
        for _ in range(_RESAMPLED // _AT_ONCE):
            chosen = rng.integers(flights, size=(_AT_ONCE, flights))
            roots.append(np.sqrt(squares[chosen].sum(axis=1) / counts[chosen].sum(axis=1)))
        outside = 0.5 * (1.0 - level)
        low, high = np.quantile(np.concatenate(roots), [outside, 1.0 - outside]).tolist()
    verdict = _verdict(low, high, limit, least=False)
    return Indicator(root, low, high, int(total), float(flights), verdict)


def _verdict(low: float, high: float, limit: float | None, *, least: bool) -> str:
    if limit is None:
        return ""
    if (low >= limit) if least else (high <= limit):
        return "met"
    return "not met" if (high < limit if least else low > limit) else "not shown"
