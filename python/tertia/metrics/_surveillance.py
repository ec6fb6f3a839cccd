"""The figures by which air navigation services judge a picture of tracks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tertia._arrays import FloatArray, IntArray, positive, real
from tertia.metrics._consistency import rmse
from tertia.metrics._matching import Matching, Truth, match_tracks

# a gap is long beyond three update intervals and a tenth
LONG_GAP = 3.3
# share of an interval by which an update may be late
TOLERANCE = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class Surveillance:
    """How good a picture of tracks is.

    Attributes
    ----------
    probability_of_update : float
        Share of the expected updates that were there; nan where none was expected.
    long_gap_ratio : float
        Share of the expected updates that are missed in gaps longer than 3.3 periods.
    expected_updates, missed_updates : ndarray of int, shape (K,)
        Of each target.
    false_updates : int
        Updates that show no target.
    false_tracks : int
        Tracks of whose updates fewer than half show a target.
    missed_targets : int
        Targets that no track shows.
    switches : int
        How often a target went on under another track.
    latency : ndarray of shape (K,)
        Seconds from the first time of a target to its first update; nan where it has none.
    rmse : float
        Root mean square distance of the updates to their targets, in metres.
    matching : Matching
        Which update shows which target; the order of targets is that of `matching.targets`.
    """

    probability_of_update: float
    long_gap_ratio: float
    expected_updates: IntArray
    missed_updates: IntArray
    false_updates: int
    false_tracks: int
    missed_targets: int
    switches: int
    latency: FloatArray
    rmse: float
    matching: Matching

    def __repr__(self) -> str:
        """Tell the figures."""
        return (
            f"Surveillance(probability of update {self.probability_of_update:.4f}, "
            f"long gaps {self.long_gap_ratio:.4f}, {self.false_tracks} false tracks, "
            f"{self.missed_targets} of {len(self.latency)} targets missed, "
            f"{self.switches} switches, RMSE {self.rmse:.4g} m)"
        )


def surveillance(
    time: npt.ArrayLike,
    track: npt.ArrayLike,
    position: npt.ArrayLike,
    *,
    truth_time: npt.ArrayLike,
    target: npt.ArrayLike,
    truth_position: npt.ArrayLike,
    period: float,
    distance: float,
) -> Surveillance:
    """Judge tracks by the truth, as air navigation services do.

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
        True positions, as in `match_tracks`.
    period : float
        Seconds from update to update that are required.
    distance : float
        Metres; a track that is farther from a target does not show it.

    Returns
    -------
    Surveillance
        The figures.

    Raises
    ------
    ValueError
        Shapes that do not fit, a number that is not finite or outside its domain, a target with two
        positions at one time, no truth.
    TypeError
        An argument of the wrong type.

    Notes
    -----
    The probability of update and the ratio of long gaps are requirements of the EUROCONTROL
    Specification for ATM Surveillance System Performance (EUROCONTROL-SPEC-147, 2015); a gap is
    long beyond three update intervals and a tenth. They are found by time differences: a target
    counts from its first update to the end of its truth. A gap of `dt` between two updates has
    `round(dt / period)` expected updates, of which one was there. From the last update to the end
    of the truth `floor(dt / period + 0.1)` are missed. A target without any update misses all from
    its first time on. Sums are over all targets, so every expected update weighs the same. How long
    it takes until the first update is told by `latency`.

    Examples
    --------
    A target is seen every 4 s for 40 s, but not from 12 s to 28 s:

    >>> import numpy as np
    >>> from tertia import metrics
    >>> time = np.array([0, 4, 8, 32, 36, 40])
    >>> place = np.column_stack([200.0 * time, 0.0 * time])
    >>> truth = {"truth_time": [0, 40], "target": [7, 7], "truth_position": [[0, 0], [8000, 0]]}
    >>> metrics.surveillance(time, np.ones(6, int), place, **truth, period=4, distance=500)
    Surveillance(probability of update 0.5455, long gaps 0.4545, 0 false tracks, 0 of 1 targets \
missed, 0 switches, RMSE 0 m)
    """
    interval = float(positive(real(period, "period"), "period"))
    matching = match_tracks(
        time,
        track,
        position,
        truth_time=truth_time,
        target=target,
        truth_position=truth_position,
        distance=distance,
        period=interval,
    )
    truth = Truth(truth_time, target, truth_position)
    when = np.asarray(time, dtype=np.float64)
    expected, missed, long, first = _updates(truth, matching, when, interval)
    _, tracks = np.unique(np.asarray(track), return_inverse=True)
    shows = np.bincount(tracks, matching.matched)
    total = int(expected.sum())
    off = np.linalg.norm(matching.error, axis=-1)
    return Surveillance(
        1.0 - missed.sum() / total if total else float("nan"),
        long.sum() / total if total else float("nan"),
        expected,
        missed,
        int(np.count_nonzero(~matching.matched)),
        int(np.count_nonzero(2 * shows < np.bincount(tracks))),
        int(np.count_nonzero(np.isnan(first))),
        int(matching.switches.sum()),
        first - truth.first,
        float(rmse(off)),
        matching,
    )


def _updates(
    truth: Truth, matching: Matching, time: FloatArray, period: float
) -> tuple[IntArray, IntArray, IntArray, FloatArray]:
    """Return expected updates, missed ones, those missed in long gaps, and first times, (K,)."""
    count = len(truth)
    rows = np.flatnonzero(matching.matched)
    rows = rows[np.lexsort((time[rows], matching.target[rows]))]
    target, when = matching.target[rows], time[rows]
    first, last = np.full(count, np.nan), np.full(count, np.nan)
    last[target] = when
    first[target[::-1]] = when[::-1]
    expected, missed, long = (np.zeros(count, dtype=np.int64) for _ in range(3))
    same = np.flatnonzero(np.diff(target) == 0)
    gap = (when[same + 1] - when[same]) / period
    due = np.rint(gap).astype(np.int64)
    lost = np.maximum(due - 1, 0)
    for counts, values in ((expected, due), (missed, lost), (long, lost * (gap > LONG_GAP))):
        np.add.at(counts, target[same], values)
    seen = ~np.isnan(last)
    rest = (truth.last - np.where(seen, last, truth.first)) / period
    # one more is due at the first time, and was there if the target was seen at all
    lost = np.floor(rest + TOLERANCE).astype(np.int64) + ~seen
    expected += lost + seen
    missed += lost
    long += lost * (rest > LONG_GAP)
    return expected, missed, long, first
