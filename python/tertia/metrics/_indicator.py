"""A figure with its confidence interval and verdict."""

from __future__ import annotations

import math
from dataclasses import dataclass

# of fewer independent values nothing good can be said
LEAST_NUMBER = 10.0
TOO_SHORT = "too short to tell"
HONEST = "honest"
_MOST_PLACES = 4
_MOST_RATIO = 1000.0


@dataclass(frozen=True, slots=True)
class Indicator:
    """A figure of a record, with its confidence interval.

    Attributes
    ----------
    value : float
        Value of the figure.
    low, high : float
        Bounds of its confidence interval.
    count : int
        Number of values from which it was computed.
    effective_number : float
        Number of independent values that would give a confidence interval of the same size.
    verdict : str
        Conclusion in words; empty if there is no claim with which the figure can be compared.
    """

    value: float
    low: float
    high: float
    count: int
    effective_number: float
    verdict: str

    def __str__(self) -> str:
        """Return the figure, its interval and the verdict as text."""
        value, interval = text(self.value, self.low, self.high)
        return f"{value} {interval}" + (f": {self.verdict}" if self.verdict else "")


def digits(value: float) -> str:
    """Return a number as text with two or three digits and without an exponent."""
    if not math.isfinite(value):
        return "unbounded" if value > 0 else "unknown"
    size = abs(value)
    return f"{value:.{0 if size >= 20 else 1 if size >= 2 else 2}f}"


def text(value: float, low: float, high: float) -> tuple[str, str]:
    """Return a figure and its interval as text, rounded to about a quarter of its length."""
    # a bound of such a size says nothing, unless nothing was found
    bounded = high <= _MOST_RATIO * max(abs(value), abs(low)) or (value == 0 and high < math.inf)
    length = high - low if bounded else abs(value)
    places = 2
    if 0 < length < math.inf:
        places = min(max(math.ceil(-math.log10(length / 4)), 0), _MOST_PLACES)
    if not bounded:
        interval = f"(at least {low:.{places}f})"
    else:
        interval = f"({low:.{places}f} to {high:.{places}f})"
    return (f"{value:.{places}f}" if math.isfinite(value) else digits(value)), interval


def factor_verdict(value: float, low: float, high: float, number: float) -> str:
    """Return the verdict about the sigmas, which follows from the factor for the covariances."""
    if low > 1.0:
        return "too small by a factor of {} {}".format(*text(*map(math.sqrt, (value, low, high))))
    if value == high == 0.0:
        return "all errors are 0: the estimates seem to be the truth itself"
    if high < 1.0:
        inverse = (math.sqrt(1.0 / x) if x > 0 else math.inf for x in (value, high, low))
        return "too large by a factor of {} {}".format(*text(*inverse))
    return honest_if(number)


def share_verdict(low: float, high: float, probability: float, number: float) -> str:
    """Return the verdict about regions, from the proportion of true values inside them."""
    if high < probability:
        return "too small"
    if low > probability:
        return "too large"
    return honest_if(number)


def honest_if(number: float) -> str:
    """Return the verdict for a record that does not contradict the stated sigmas."""
    return HONEST if number >= LEAST_NUMBER else TOO_SHORT


def share_text(share: Indicator) -> str:
    """Return a proportion and its interval in percent, as text."""
    value, interval = text(*(100 * x for x in (share.value, share.low, share.high)))
    return f"{value} % {interval}"
