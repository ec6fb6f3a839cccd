"""Runs of large errors, and heights and identities of tracks, versus truth."""

from __future__ import annotations

import statistics

import numpy as np

from tertia._arrays import BoolArray, FloatArray, IntArray
from tertia._units import FOOT
from tertia.metrics._indicator import Indicator
from tertia.metrics._matching import Matching, Tracks
from tertia.metrics._truth import Truth

# a height that is farther off is wrong; half a nautical mile is a large error
HEIGHT_TOLERANCE, LARGE_ERROR = 300.0 * FOOT, 926.0
# large errors one after the other that make a run
_RUN = 3


def in_runs(target: IntArray, time: FloatArray, error: FloatArray, large: float) -> BoolArray:
    """Return which updates are in runs of three or more large errors of one flight.

    Errors of a run point in directions less than 90 degrees from each one to the next.
    """
    order = np.lexsort((time, target))
    own, off = target[order], error[order]
    big = (own >= 0) & (np.linalg.norm(off, axis=-1) > large)
    linked = big[1:] & big[:-1] & (own[1:] == own[:-1])
    linked &= np.sum(off[1:] * off[:-1], axis=-1) > 0
    run = np.concatenate([np.zeros(1, dtype=np.int64), np.cumsum(~linked)])[: len(own)]
    found = np.zeros(len(target), dtype=bool)
    found[order] = big & (np.bincount(run)[run] >= _RUN) if len(run) else big
    return found


def heights(tracks: Tracks, truth: Truth, matching: Matching) -> tuple[BoolArray, BoolArray]:
    """Return which updates have a height that can be judged, and which of these are right."""
    true = truth.height_at(matching.target, tracks.time)
    own = getattr(tracks, "height", None)
    off = np.abs((np.nan if own is None else np.asarray(own, dtype=np.float64)) - true)
    return np.isfinite(off), off <= HEIGHT_TOLERANCE


def identities(tracks: Tracks, truth: Truth, matching: Matching) -> tuple[BoolArray, BoolArray]:
    """Return which updates have an identity that can be judged, and which of these are right."""
    true = truth.identity_at(matching.target, tracks.time)
    own = getattr(tracks, "identity", None)
    told = np.full(len(true), -1) if own is None else np.asarray(own)
    known = (told >= 0) & (true >= 0)
    return known, known & (told == true)


def with_any(truth: Truth, known: BoolArray | None) -> BoolArray:
    """Return which targets have a value that is known."""
    found = np.zeros(len(truth), dtype=bool)
    if known is not None:
        found[truth.target[known]] = True
    return found


def rate(count: int, hours: float, level: float, limit: float | None) -> Indicator:
    """Return a number per hour, with Byar's approximation of the exact Poisson interval."""
    z = statistics.NormalDist().inv_cdf(0.5 + 0.5 * level)
    ends = [
        n * (1.0 - 1.0 / (9.0 * n) + sign * z / (3.0 * n**0.5)) ** 3 if n else 0.0
        for n, sign in ((count, -1.0), (count + 1, 1.0))
    ]
    low, high = (end / hours if hours else np.nan for end in ends)
    verdict = ""
    if limit is not None and hours:
        verdict = "met" if high <= limit else "not met" if low > limit else "not shown"
    return Indicator(count / hours if hours else np.nan, low, high, count, float(count), verdict)
