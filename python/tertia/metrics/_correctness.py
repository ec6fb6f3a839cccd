"""Checks of runs of large errors, of heights and identities, and of false updates of tracks."""

from __future__ import annotations

import numpy as np

from tertia._arrays import BoolArray, FloatArray, IntArray
from tertia._units import FOOT, NAUTICAL_MILE
from tertia.metrics._matching import Matching, Tracks
from tertia.metrics._truth import Truth
from tertia.sensors._identities import KINDS, NUMBERS, is_known, leading

# a height that is farther off is wrong; half a nautical mile is a large error
HEIGHT_TOLERANCE, LARGE_ERROR = 300.0 * FOOT, 926.0
# side of a square of 900 NM²
_SIDE = 30.0 * NAUTICAL_MILE
# large errors one after the other that make a run
_RUN = 3


def in_runs(target: IntArray, time: FloatArray, error: FloatArray, large: float) -> BoolArray:
    """Return which updates belong to runs of three or more successive large errors of one flight.

    In a run, the directions of successive errors differ by less than 90 degrees.
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
    """Return which updates have a height that can be checked, and which have a correct one."""
    true = truth.height_at(matching.target, tracks.time)
    own = getattr(tracks, "height", None)
    off = np.abs((np.nan if own is None else np.asarray(own, dtype=np.float64)) - true)
    return np.isfinite(off), off <= HEIGHT_TOLERANCE


def identities(tracks: Tracks, truth: Truth, matching: Matching) -> tuple[BoolArray, BoolArray]:
    """Return which updates have an identity that can be checked, and which only correct ones."""
    given = [kind for kind in KINDS if getattr(truth, kind) is not None]
    count = len(matching.target)
    known: BoolArray = np.zeros(count, dtype=np.bool_)
    right: BoolArray = np.ones(count, dtype=np.bool_)
    for kind in given:
        true = truth.identity_at(matching.target, tracks.time, kind)
        # numbers of no stated kind
        own = getattr(tracks, leading(tracks, NUMBERS) if given == ["identity"] else kind, None)
        if own is not None:
            reported = np.asarray(own)
            both = is_known(reported) & is_known(true)
            known = known | both
            right = right & (~both | (reported == true))
    return known, known & right


def identified(truth: Truth) -> BoolArray:
    """Return which rows of the truth have an identity."""
    found: BoolArray = np.zeros(len(truth.time), dtype=np.bool_)
    for column in (getattr(truth, kind) for kind in KINDS):
        if column is not None:
            found = found | is_known(column)
    return found


def with_any(truth: Truth, known: BoolArray | None) -> BoolArray:
    """Return which targets have a known value at one time at least."""
    found = np.zeros(len(truth), dtype=bool)
    if known is not None:
        found[truth.target[known]] = True
    return found


def squares_of(positions: FloatArray) -> int:
    """Return how many squares of 900 NM² contain a position; the grid begins in the south-west."""
    square = np.floor((positions[:, :2] - positions[:, :2].min(axis=0)) / _SIDE)
    return len(np.unique(square, axis=0))


def clumping(track: IntArray, usual: float) -> float:
    """Return the ratio of the variance of the number of false updates to the Poisson variance.

    The false updates of one track are not independent events. If the false tracks have n updates
    each, the variance is Σn² instead of Σn. If there are no false updates, the result is `usual`.
    """
    counts = np.unique(track, return_counts=True)[1]
    return float(np.sum(counts**2) / np.sum(counts)) if len(counts) else usual
