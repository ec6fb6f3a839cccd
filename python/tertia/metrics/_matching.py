"""Matching of tracks with targets."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import numpy as np
import numpy.typing as npt

from tertia import _core
from tertia._arrays import (
    BoolArray,
    FloatArray,
    IntArray,
    instance,
    positive_number,
    samples,
)
from tertia._result import Result
from tertia.metrics._gospa import pairs_within
from tertia.metrics._truth import Truth, rows

_NONE = -1


def track_errors(
    error: npt.ArrayLike, course: npt.ArrayLike
) -> tuple[float | FloatArray, float | FloatArray]:
    """Resolve position errors along and across the courses of the targets.

    Parameters
    ----------
    error : array_like of shape (..., 2)
        Estimated minus true position, east and north; nan if one of the two is missing.
    course : array_like of shape (...)
        True courses in radians, clockwise from north.

    Returns
    -------
    along_track, cross_track : float or ndarray of shape (...)
        Errors along the course, positive forward, and across the course, positive to the right.

    Raises
    ------
    ValueError, TypeError
        If shapes do not fit, or an argument has the wrong type.

    Examples
    --------
    An aircraft flies east; its estimated position is 30 m behind it and 40 m to its left:

    >>> import numpy as np
    >>> from tertia import metrics
    >>> along_track, cross_track = metrics.track_errors([-30.0, 40.0], np.pi / 2)
    >>> round(along_track, 9), round(cross_track, 9)
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
class Matching(Result):
    """The target of each update of a track, and its error.

    Attributes
    ----------
    target : ndarray of int, shape (N,)
        Index into `targets`; -1 for an update without a target.
    error : ndarray of shape (N, m)
        Estimated minus true position; nan for an update without a target.
    targets : ndarray of shape (K,)
        The identifiers of the targets, as in `Truth`.
    switches : ndarray of int, shape (K,)
        Number of times that each target continued under the number of another track.
    """

    _rows: ClassVar = "target", 0
    _omitted: ClassVar = ("targets", "switches")

    target: IntArray
    error: FloatArray
    targets: npt.NDArray[Any]
    switches: IntArray

    @property
    def matched(self) -> BoolArray:
        """Whether an update belongs to a target, of shape (N,)."""
        return self.target >= 0

    def __repr__(self) -> str:
        """Return a text that states how many updates belong to a target."""
        count = np.count_nonzero(self.matched)
        return f"Matching({count} of {len(self.target)} updates, {len(self.targets)} targets)"


class Tracks(Protocol):
    """A type that has updates of tracks, such as `tertia.tracker.TrackTable`."""

    @property
    def time(self) -> npt.ArrayLike:
        """Times in seconds, of shape (N,), in any order."""

    @property
    def track(self) -> npt.ArrayLike:
        """Identifiers of the tracks, of shape (N,); they are integers or strings."""

    @property
    def position(self) -> npt.ArrayLike:
        """Positions in metres, of shape (N, m), where m is 2 or 3."""


def match_tracks(
    tracks: Tracks, truth: Truth, *, max_distance: float, update_interval: float | None = None
) -> Matching:
    """Find the target of each update of a track.

    Parameters
    ----------
    tracks : Tracks
        An object with `time` (N,), `track` (N,) and `position` (N, m), such as a `TrackTable`.
        Every row counts as an update; therefore remove rows without a plot and rows of tentative
        tracks first.
    truth : Truth
        The true positions of the targets.
    max_distance : float
        Largest distance in metres from a track to its target.
    update_interval : float, optional
        Time in seconds in which every track is updated about once; the updates within an interval
        of this length are matched together. By default, updates with equal times are matched
        together.

    Returns
    -------
    Matching
        The target of each update, and its error.

    Raises
    ------
    ValueError, TypeError
        If shapes do not fit, a number is not finite or outside its domain, or an argument has the
        wrong type.

    Notes
    -----
    As in CLEAR MOT (Bernardin, Stiefelhagen 2008), a track keeps its target while their distance is
    at most `max_distance`, even if another target is nearer, unless the target has been paired with
    another track in the meantime. The remaining tracks and targets are paired one to one, so that
    there are as many pairs as possible and, with that number of pairs, the sum of their distances
    is smallest. A second track of the same target is therefore not paired with a target. If a track
    is updated several times in an interval, the mean distance of these updates is used.

    Examples
    --------
    >>> from types import SimpleNamespace
    >>> from tertia import metrics
    >>> truth = metrics.Truth([0, 8], [7, 7], [[0, 0], [800, 0]])
    >>> place = [[0, 9], [90, 0], [400, 0]]
    >>> tracks = SimpleNamespace(time=[0, 0, 4], track=[1, 2, 1], position=place)
    >>> metrics.match_tracks(tracks, truth, max_distance=50).target
    array([ 0, -1,  0])
    """
    instance(truth, "truth", Truth)
    if not all(hasattr(tracks, name) for name in ("time", "track", "position")):
        raise TypeError(f"tracks is {tracks!r}; it must have time, track and position")
    times, labels, points = rows(tracks.time, tracks.track, tracks.position, "tracks.", "track")
    if points.shape[1] != truth.position.shape[1]:
        raise ValueError(
            f"tracks.position has shape {points.shape} and truth.position {truth.position.shape}"
        )
    limit = positive_number(max_distance, "max_distance")
    order, ends = _scans(times, update_interval)
    names, track = np.unique(labels, return_inverse=True)
    memory = _Memory(len(names), len(truth))
    found = np.full(len(times), _NONE, dtype=np.int64)
    error = np.full(points.shape, np.nan)
    for begin, end in itertools.pairwise(ends):
        scan = order[begin:end]
        row, shown, off = _candidates(truth, times[scan], points[scan], limit)
        kept = memory.match(track[scan][row], shown, np.linalg.norm(off, axis=-1), limit)
        found[scan[row[kept]]], error[scan[row[kept]]] = shown[kept], off[kept]
    return Matching(found, error, truth.targets, memory.switches)


def _scans(time: FloatArray, update_interval: float | None) -> tuple[IntArray, IntArray]:
    """Return the updates in time order, and the bounds of the scans."""
    order = np.argsort(time, kind="stable")
    number = time[order]
    if update_interval is not None:
        length = positive_number(update_interval, "update_interval")
        number = np.floor((number - number[:1]) / length)
    begins = np.flatnonzero(np.diff(number, prepend=np.nan) != 0)
    return order, np.append(begins, len(order))


def _candidates(
    truth: Truth, time: FloatArray, position: FloatArray, limit: float
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return pairs of an update of a scan and a target within the limit, and their errors."""
    low, high = time[0], time[-1]
    there = np.flatnonzero((truth.first <= high) & (truth.last >= low))

    def at(when: float) -> FloatArray:
        return truth.at(there, np.clip(when, truth.first[there], truth.last[there]))

    middle = at((low + high) / 2)
    ends = (low, high) if low < high else ()
    moved = max(
        (np.max(np.linalg.norm(at(t) - middle, axis=-1), initial=0.0) for t in ends), default=0.0
    )
    # twice, for a path that is not straight
    row, index, _ = pairs_within(position, middle, limit + 2 * moved)
    shown = there[index]
    alive = truth.present(shown, time[row])
    row, shown = row[alive], shown[alive]
    off = position[row] - truth.at(shown, time[row])
    near = np.linalg.norm(off, axis=-1) <= limit
    return row[near], shown[near], off[near]


class _Memory:
    """The most recent pairs of tracks and targets."""

    def __init__(self, tracks: int, targets: int) -> None:
        self.target_of = np.full(tracks, _NONE)
        self.track_of = np.full(targets, _NONE)
        self.switches = np.zeros(targets, dtype=np.int64)

    def match(
        self, track: IntArray, target: IntArray, distance: FloatArray, limit: float
    ) -> BoolArray:
        """Choose among the candidate pairs of a scan, and store the choice."""
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
        chosen = _core.assign_pairs(row, column, gain, len(row_names), len(names), "gnn")
        true = known.copy()
        true[free] = chosen[row] == column
        first, second = first[true], second[true]
        before = self.track_of[second]
        self.switches[second] += (before != _NONE) & (before != first)
        self.target_of[first], self.track_of[second] = second, first
        return np.asarray(true[inverse])
