"""Tracks and the targets that they follow."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tertia import _core
from tertia._arrays import BoolArray, FloatArray, IntArray, finite, positive, real, samples
from tertia.metrics._gospa import pairs_within

_NONE = -1


def track_errors(
    error: npt.ArrayLike, course: npt.ArrayLike
) -> tuple[float | FloatArray, float | FloatArray]:
    """Turn position errors along and across the track of their targets.

    Parameters
    ----------
    error : array_like of shape (..., 2)
        Estimates less the truth, east and north; nan where there is none.
    course : array_like of shape (...)
        True courses in radians, clockwise from north.

    Returns
    -------
    along, across : float or ndarray of shape (...)
        Positive ahead, and positive to the right.

    Raises
    ------
    ValueError
        Shapes that do not fit.
    TypeError
        An argument of the wrong type.

    Examples
    --------
    An aircraft flies to the east and is shown 30 m behind and 40 m to its left:

    >>> import numpy as np
    >>> from tertia import metrics
    >>> along, across = metrics.track_errors([-30.0, 40.0], np.pi / 2)
    >>> round(along, 9), round(across, 9)
    (-30.0, -40.0)
    """
    e, angle = samples(error, "error"), samples(course, "course")
    if e.shape[-1:] != (2,):
        raise ValueError(f"error has shape {e.shape}; it must be (..., 2)")
    sine, cosine = np.sin(angle), np.cos(angle)
    try:
        along = e[..., 0] * sine + e[..., 1] * cosine
        across = e[..., 0] * cosine - e[..., 1] * sine
    except ValueError:
        raise ValueError(
            f"error has shape {e.shape} and course {angle.shape}; they do not fit together"
        ) from None
    return (
        along if np.ndim(along) else float(along),
        across if np.ndim(across) else float(across),
    )


@dataclass(frozen=True, slots=True, eq=False)
class Matching:
    """Which target each update of a track shows.

    Attributes
    ----------
    target : ndarray of int, shape (N,)
        Index into `targets`; -1 where an update shows none.
    error : ndarray of shape (N, m)
        Position less the truth; nan where an update shows no target.
    targets : ndarray of int, shape (K,)
        The identifiers of the targets, in increasing order.
    switches : ndarray of int, shape (K,)
        How often each target went on under another track.
    """

    target: IntArray
    error: FloatArray
    targets: IntArray
    switches: IntArray

    @property
    def matched(self) -> BoolArray:
        """Whether an update shows a target, of shape (N,)."""
        return self.target >= 0

    def __repr__(self) -> str:
        """Tell how many updates show a target."""
        count = np.count_nonzero(self.matched)
        return f"Matching({count} of {len(self.target)} updates, {len(self.targets)} targets)"


class Truth:
    """Where targets are at any time, by linear interpolation."""

    def __init__(self, time: npt.ArrayLike, target: npt.ArrayLike, position: npt.ArrayLike) -> None:
        instants, target, points = table(time, target, position, "truth_", "target")
        if len(instants) == 0:
            raise ValueError("truth_time is empty; there must be a target")
        self.identifiers, index = np.unique(target, return_inverse=True)
        order = np.lexsort((instants, index))
        index, self.time, self.position = index[order], instants[order], points[order]
        again = np.flatnonzero((np.diff(index) == 0) & (np.diff(self.time) == 0))
        if len(again):
            name = self.identifiers[index[again[0]]]
            raise ValueError(
                f"target {name} has two positions at {self.time[again[0]]}; it must have one"
            )
        # a time is its rank among all, so that a target and a time are one whole number
        self.ranks = np.unique(self.time)
        self.keys = index * (len(self.ranks) + 1) + np.searchsorted(self.ranks, self.time) + 1
        starts = np.flatnonzero(np.diff(index, prepend=-1))
        self.first = self.time[starts]
        self.last = self.time[np.append(starts[1:], len(index)) - 1]

    def __len__(self) -> int:
        """Return the number of targets."""
        return len(self.identifiers)

    def at(self, target: IntArray, time: FloatArray) -> FloatArray:
        """Return where targets are, (..., m), while they are there."""
        rank = np.searchsorted(self.ranks, time, side="right")
        before = np.searchsorted(self.keys, target * (len(self.ranks) + 1) + rank, "right") - 1
        after = np.where(self.time[before] < time, before + 1, before)
        span = np.where(after > before, self.time[after] - self.time[before], 1.0)
        share = ((time - self.time[before]) / span)[..., np.newaxis]
        step = self.position[after] - self.position[before]
        return np.asarray(self.position[before] + share * step)


def table(
    time: npt.ArrayLike,
    identifier: npt.ArrayLike,
    position: npt.ArrayLike,
    prefix: str,
    noun: str,
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Return the columns of a table of positions."""
    instants, points = finite(time, f"{prefix}time"), finite(position, f"{prefix}position")
    names = np.asarray(identifier)
    if names.dtype.kind not in "iu":
        raise TypeError(f"{noun} has dtype {names.dtype}; it must hold integers")
    if instants.ndim != 1:
        raise ValueError(f"{prefix}time has shape {instants.shape}; it must be (N,)")
    n = len(instants)
    if names.shape != (n,):
        raise ValueError(f"{noun} has shape {names.shape}; it must be ({n},), as {prefix}time")
    if points.ndim != 2 or len(points) != n or points.shape[1] not in (2, 3):
        raise ValueError(
            f"{prefix}position has shape {points.shape}; it must be ({n}, 2) or ({n}, 3)"
        )
    return instants, names.astype(np.int64), points


def match_tracks(
    time: npt.ArrayLike,
    track: npt.ArrayLike,
    position: npt.ArrayLike,
    *,
    truth_time: npt.ArrayLike,
    target: npt.ArrayLike,
    truth_position: npt.ArrayLike,
    distance: float,
    period: float | None = None,
) -> Matching:
    """Find out which target each update of a track shows.

    Parameters
    ----------
    time : array_like of shape (N,)
        Times of the updates in seconds, in any order.
    track : array_like of int, shape (N,)
        Identifiers of their tracks.
    position : array_like of shape (N, m)
        Positions in metres, m = 2 or 3.
    truth_time : array_like of shape (L,)
        Times at which the truth is known, in any order.
    target : array_like of int, shape (L,)
        Identifiers of the targets.
    truth_position : array_like of shape (L, m)
        True positions. Between them a target flies straight; before its first and after its last
        time it is not there.
    distance : float
        Metres; a track that is farther from a target does not show it.
    period : float, optional
        Seconds of a scan, in which every track is updated about once. By default the updates of
        each time are a scan.

    Returns
    -------
    Matching
        The target of each update, and its error.

    Raises
    ------
    ValueError
        Shapes that do not fit, a number that is not finite or outside its domain, a target with two
        positions at one time, no truth.
    TypeError
        An argument of the wrong type.

    Notes
    -----
    As in CLEAR MOT (Bernardin, Stiefelhagen 2008): in each scan a track keeps its target while it
    is within `distance`, even where another one is nearer, unless the target has gone on under
    another track meanwhile. What remains is paired one to one: as many as possible, and then with
    the least sum of distances. So a second track of the same target shows none. A track that is
    updated more than once in a scan is as far away as on the average.

    Examples
    --------
    >>> from tertia import metrics
    >>> truth = {"truth_time": [0, 8], "target": [7, 7], "truth_position": [[0, 0], [800, 0]]}
    >>> place = [[0, 9], [90, 0], [400, 0]]
    >>> metrics.match_tracks([0, 0, 4], [1, 2, 1], place, **truth, distance=50).target
    array([ 0, -1,  0])
    """
    instants, names, points = table(time, track, position, "", "track")
    truth = Truth(truth_time, target, truth_position)
    if points.shape[1] != truth.position.shape[1]:
        raise ValueError(
            f"position has shape {points.shape} and truth_position {truth.position.shape}"
        )
    limit = float(positive(real(distance, "distance"), "distance"))
    order, ends = _scans(instants, period)
    _, tracks = np.unique(names, return_inverse=True)
    memory = _Memory(int(tracks.max(initial=-1)) + 1, len(truth))
    found = np.full(len(instants), _NONE, dtype=np.int64)
    error = np.full(points.shape, np.nan)
    for begin, end in itertools.pairwise(ends):
        rows = order[begin:end]
        row, shown, off = _candidates(truth, instants[rows], points[rows], limit)
        kept = memory.match(tracks[rows][row], shown, np.linalg.norm(off, axis=-1), limit)
        found[rows[row[kept]]], error[rows[row[kept]]] = shown[kept], off[kept]
    return Matching(found, error, truth.identifiers, memory.switches)


def _scans(time: FloatArray, period: float | None) -> tuple[IntArray, IntArray]:
    """Return the updates in order of time, and where scans begin and end."""
    order = np.argsort(time, kind="stable")
    number = time[order]
    if period is not None:
        length = float(positive(real(period, "period"), "period"))
        number = np.floor((number - number[:1]) / length)
    begins = np.flatnonzero(np.diff(number, prepend=np.nan) != 0)
    return order, np.append(begins, len(order))


def _candidates(
    truth: Truth, time: FloatArray, position: FloatArray, limit: float
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return updates of a scan and targets within the limit, and the errors."""
    low, high = time[0], time[-1]
    there = np.flatnonzero((truth.first <= high) & (truth.last >= low))

    def at(when: float) -> FloatArray:
        return truth.at(there, np.clip(when, truth.first[there], truth.last[there]))

    middle = at((low + high) / 2)
    moved = max(
        np.max(np.linalg.norm(at(when) - middle, axis=-1), initial=0.0) for when in (low, high)
    )
    # twice, for a path that is not straight
    row, index, _ = pairs_within(position, middle, limit + 2 * moved)
    shown = there[index]
    when = time[row]
    alive = (when >= truth.first[shown]) & (when <= truth.last[shown])
    row, shown = row[alive], shown[alive]
    off = position[row] - truth.at(shown, time[row])
    near = np.linalg.norm(off, axis=-1) <= limit
    return row[near], shown[near], off[near]


class _Memory:
    """Which tracks and targets went together last."""

    def __init__(self, tracks: int, targets: int) -> None:
        self.target_of = np.full(tracks, _NONE)
        self.track_of = np.full(targets, _NONE)
        self.switches = np.zeros(targets, dtype=np.int64)

    def match(
        self, track: IntArray, target: IntArray, distance: FloatArray, limit: float
    ) -> BoolArray:
        """Return which of the pairs of a scan are true, and remember them."""
        key = track * len(self.track_of) + target
        pairs, inverse = np.unique(key, return_inverse=True)
        mean = np.bincount(inverse, distance) / np.bincount(inverse)
        first, second = np.divmod(pairs, len(self.track_of))
        known = (self.target_of[first] == second) & (self.track_of[second] == first)
        taken = np.isin(first, first[known]) | np.isin(second, second[known])
        free = np.flatnonzero(~taken)
        # as many pairs as possible, then the least sum of distances
        most = 1.0 + min(len(self.target_of), len(self.track_of))
        gain = most - mean[free] / limit
        row_names, row = np.unique(first[free], return_inverse=True)
        names, column = np.unique(second[free], return_inverse=True)
        chosen = _core.assign_pairs(row, column, gain, len(row_names), len(names), "global")
        true = known.copy()
        true[free] = chosen[row] == column
        first, second = first[true], second[true]
        before = self.track_of[second]
        self.switches[second] += (before != _NONE) & (before != first)
        self.target_of[first], self.track_of[second] = second, first
        return np.asarray(true[inverse])
