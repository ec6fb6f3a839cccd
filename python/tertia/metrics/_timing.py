"""Times of updates: the age of the last update, and time offsets between close targets."""

from __future__ import annotations

import numpy as np

from tertia._arrays import BoolArray, FloatArray, IntArray
from tertia._units import NAUTICAL_MILE
from tertia.metrics._gospa import pairs_within
from tertia.metrics._matching import Matching
from tertia.metrics._truth import Truth

# two targets that are nearer than this are close
CLOSE = 10.0 * NAUTICAL_MILE


def ages(target: IntArray, time: FloatArray, longest: float) -> tuple[IntArray, FloatArray]:
    """Return the gaps between updates that are not too long, and the target of each gap.

    Updates without a target, -1, have no gaps.
    """
    rows = np.flatnonzero(target >= 0)
    rows = rows[np.lexsort((time[rows], target[rows]))]
    own, gap = target[rows], np.diff(time[rows])
    kept = (np.diff(own) == 0) & (gap <= longest)
    return own[1:][kept], gap[kept]


def offsets(
    matching: Matching, time: FloatArray, position: FloatArray, update_interval: float
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return pairs of close targets, and the seconds between their nearest updates.

    An update of one target is counted if the other target has an update within half an update
    interval.
    """
    half = update_interval / 2
    rows = np.flatnonzero(matching.matched)
    rows = rows[np.argsort(time[rows], kind="stable")]
    target, when = matching.target[rows], time[rows]
    place = (position[rows] - matching.error[rows])[:, :2]
    first, second = _candidates(when, place, half)
    kept = (target[first] != target[second]) & (when[second] - when[first] <= half)
    first, second = first[kept], second[kept]
    # from either side
    row, other = np.concatenate([first, second]), np.concatenate([second, first])
    off = np.abs(when[other] - when[row])
    order = np.lexsort((off, target[other], row))
    row, partner, off = row[order], target[other][order], off[order]
    nearest = np.append(True, (np.diff(row) != 0) | (np.diff(partner) != 0))[: len(row)]
    pair = np.sort(np.column_stack([target[row[nearest]], partner[nearest]]), axis=1)
    return pair[:, 0], pair[:, 1], off[nearest]


def near_any(truth: Truth, time: FloatArray, position: FloatArray) -> BoolArray:
    """Return which positions are close to a target."""
    found = np.zeros(len(time), dtype=bool)
    for target in range(len(truth)):
        off = position - truth.at(target, time)
        found |= np.linalg.norm(off[:, :2], axis=1) < CLOSE
    return found


def _candidates(time: FloatArray, place: FloatArray, half: float) -> tuple[IntArray, IntArray]:
    """Return pairs of rows that are close in space and in the same or successive half intervals."""
    if not len(time):
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    part = np.floor((time - time[0]) / half)
    _, starts = np.unique(part, return_index=True)
    ends = np.searchsorted(part, part[starts] + 1, side="right")
    found = []
    for begin, end in zip(starts.tolist(), ends.tolist(), strict=True):
        own = np.searchsorted(part, part[begin], side="right")
        row, column, _ = pairs_within(place[begin:own], place[begin:end], CLOSE)
        later = column > row
        found.append(begin + np.stack([row[later], column[later]]))
    first, second = np.concatenate(found, axis=1)
    return first, second
