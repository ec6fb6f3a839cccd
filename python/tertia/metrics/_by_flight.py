"""Confidence intervals for figures of many flights whose values are correlated within a flight."""

from __future__ import annotations

import statistics
from typing import Any

import numpy as np

from tertia import _core
from tertia._arrays import FloatArray, IntArray
from tertia.metrics._indicator import Indicator

# how much less than independent values a record is worth where it shows nothing of that
USUAL_EFFECT = 4.0
_NO_VALUES = Indicator(np.nan, np.nan, np.nan, 0, 0.0, "")


def share_by_flight(
    hits: FloatArray, counts: FloatArray, level: float, limit: float | None, *, least: bool
) -> Indicator:
    """Return the proportion of hits, with Wilson's interval by quantiles of the t distribution.

    The number of values is divided by the design effect, which is the ratio of two variances of the
    proportion: that estimated from the flights, `g/(g−1) Σ (h − p n)²/N²`, and that of independent
    values, `p (1−p)/N`. `least` states whether `limit` is a lower limit.
    """
    hits, counts = hits[counts > 0], counts[counts > 0]
    total, flights = float(counts.sum()), len(counts)
    if not total:
        return _NO_VALUES
    share = float(hits.sum()) / total
    number, freedom = total / USUAL_EFFECT, np.inf
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
    """Return Wilson's interval or, if all or no values are hits, a bound at confidence `level`."""
    if share in {0.0, 1.0}:
        # 1 − 3/n at 95 %, exactly
        bound = (1.0 - level) ** (1.0 / number)
        return (bound, 1.0) if share else (0.0, 1.0 - bound)
    low, high = _core.share_interval(share, _worth(number, degrees_of_freedom), level)
    return low, high


def _worth(number: float, degrees_of_freedom: float) -> dict[str, Any]:
    """Return a number of independent values, and the degrees of freedom of their variance."""
    return {
        "number": np.array([number]),
        "probability": np.ones(1),
        "degrees_of_freedom": degrees_of_freedom,
    }


def mean_by_flight(
    totals: FloatArray,
    weights: FloatArray,
    level: float,
    limit: float | None,
    *,
    count: int,
    root: bool = False,
) -> Indicator:
    """Return the mean, or its root, with an interval of its logarithm by quantiles of Student's t.

    The variance of the mean is that estimated from the flights, `g/(g−1) Σ (x − m w)²/W²`, with the
    totals x and the weights w of g flights.
    """
    totals, weights = totals[weights > 0], weights[weights > 0]
    flights, of = len(weights), np.sqrt if root else np.positive
    if not flights:
        return _NO_VALUES
    value = float(of(totals.sum() / weights.sum()))
    low, high = 0.0, np.inf
    if flights > 1:
        mean = float(totals.sum() / weights.sum())
        spread = np.sum((totals - mean * weights) ** 2) / weights.sum() ** 2
        ratio = flights**2 / (flights - 1) * float(spread) / mean**2 if mean else 0.0
        worth = _worth(float(flights), flights - 1.0)
        bounds = _core.mean_interval(mean, ratio, worth, level) if ratio else [mean, mean]
        low, high = of(bounds).tolist()
    verdict = _verdict(low, high, limit, least=False)
    return Indicator(value, low, high, count, float(flights), verdict)


def root_by_pair(
    pairs: tuple[IntArray, IntArray], squares: FloatArray, level: float, limit: float | None
) -> Indicator:
    """Return the root mean square over pairs of flights; a flight may be part of many pairs.

    The variance is estimated by a jackknife, which leaves out one flight at a time with all of its
    pairs. The interval is computed for the logarithm; it is unbounded if one flight is part of all
    pairs.
    """
    number = len(squares)
    if not number:
        return _NO_VALUES
    base = int(pairs[1].max()) + 1
    both, pair = np.unique(pairs[0] * base + pairs[1], return_inverse=True)
    total, count = np.bincount(pair, squares), np.bincount(pair)
    flights, which = np.unique(np.stack(np.divmod(both, base), axis=1), return_inverse=True)
    left = number - np.bincount(which.ravel(), np.repeat(count, 2))
    root, low, high = float(np.sqrt(np.mean(squares))), 0.0, np.inf
    if np.all(left > 0):
        without = total.sum() - np.bincount(which.ravel(), np.repeat(total, 2))
        roots = np.sqrt(np.maximum(without, 0.0) / left)
        spread = float(np.sqrt((len(flights) - 1) * np.var(roots)))
        z = statistics.NormalDist().inv_cdf(0.5 + 0.5 * level)
        share = z * spread / root if root else 0.0
        low, high = (root * float(np.exp(sign * share)) for sign in (-1.0, 1.0))
    verdict = _verdict(low, high, limit, least=False)
    return Indicator(root, low, high, number, float(len(both)), verdict)


def rate(
    count: int, exposure: float, level: float, limit: float | None, *, effect: float = 1.0
) -> Indicator:
    """Return a number of events per unit of exposure, with Byar's approximate Poisson interval.

    `effect` is the variance of the number of events, divided by the variance that the number would
    have if the events were independent.
    """
    if not exposure:
        return Indicator(np.nan, np.nan, np.nan, count, count / effect, "")
    z, number = statistics.NormalDist().inv_cdf(0.5 + 0.5 * level), count / effect
    low, high = (
        effect / exposure * n * (1.0 - 1.0 / (9.0 * n) + sign * z / (3.0 * n**0.5)) ** 3
        if n
        else 0.0
        for n, sign in ((number, -1.0), (number + 1.0, 1.0))
    )
    verdict = _verdict(low, high, limit, least=False)
    return Indicator(count / exposure, low, high, count, number, verdict)


def _verdict(low: float, high: float, limit: float | None, *, least: bool) -> str:
    if limit is None:
        return ""
    if (low >= limit) if least else (high <= limit):
        return "met"
    return "not met" if (high < limit if least else low > limit) else "not shown"
