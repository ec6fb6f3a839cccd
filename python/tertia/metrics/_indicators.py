"""Performance indicators of tracks, as used in air navigation services."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from tertia._arrays import FloatArray, IntArray, instance, positive_number, probability, real
from tertia._result import Result
from tertia.metrics._by_flight import root_by_flight, share_by_flight
from tertia.metrics._indicator import Indicator
from tertia.metrics._matching import Matching, Tracks, match_tracks
from tertia.metrics._truth import Truth

# a gap is long beyond three update intervals and a tenth
LONG_GAP = 3.3
# figures that may have limits
_LIMITED = frozenset({"probability_of_update", "long_gap_ratio", "rmse"})
# share of an interval by which an update may be late
TOLERANCE = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class Indicators(Result):
    """Performance indicators of tracks versus truth.

    Attributes
    ----------
    probability_of_update : Indicator
        Fraction of the expected updates that took place; nan if none was expected.
    long_gap_ratio : Indicator
        Fraction of the expected updates that are missing in gaps longer than 3.3 update intervals.
    expected_updates, missed_updates : ndarray of int, shape (K,)
        Number of updates for each target.
    false_updates : int
        Number of updates that do not belong to a target.
    false_tracks : int
        Number of tracks with fewer than half of their updates on a target.
    missed_targets : int
        Number of targets without a track.
    switches : int
        Number of track swaps: a target continues under another track.
    latency : ndarray of shape (K,)
        Seconds from the first time of a target to its first update; nan where it has none.
    rmse : Indicator
        Root mean square distance of the updates from their targets, in metres.
    matching : Matching
        Target of each update; the order of targets is that of `matching.targets`.
    """

    probability_of_update: Indicator
    long_gap_ratio: Indicator
    expected_updates: IntArray
    missed_updates: IntArray
    false_updates: int
    false_tracks: int
    missed_targets: int
    switches: int
    latency: FloatArray
    rmse: Indicator
    matching: Matching

    def __repr__(self) -> str:
        """Return the main figures."""
        return (
            f"Indicators(probability of update {self.probability_of_update.value:.4f}, "
            f"long gaps {self.long_gap_ratio.value:.4f}, {self.false_tracks} false tracks, "
            f"{self.missed_targets} of {len(self.latency)} targets missed, "
            f"{self.switches} switches, RMSE {self.rmse.value:.4g} m)"
        )


def indicators(
    tracks: Tracks,
    truth: Truth,
    *,
    max_distance: float,
    update_interval: float,
    limits: Mapping[str, float] | None = None,
    confidence_level: float = 0.95,
) -> Indicators:
    """Compare tracks with the truth, by the indicators of air navigation services.

    Parameters
    ----------
    tracks : Tracks
        Updates of tracks, as for `match_tracks`.
    truth : Truth
        The targets.
    max_distance : float
        Largest distance in metres from a track to its target.
    update_interval : float
        Required seconds between updates.
    limits : mapping of str to float, optional
        Limits of `probability_of_update` (at least), `long_gap_ratio` and `rmse` (at most), from
        the specification that is in force: none are built in. The verdicts then are "met", "not
        met", or "not shown" where the interval has the limit in it.
    confidence_level : float
        Probability of the confidence intervals.

    Returns
    -------
    Indicators
        The indicators.

    Raises
    ------
    ValueError, TypeError
        As `match_tracks`, an `update_interval` that is not positive, a limit of no such figure,
        a confidence level that is none.

    Notes
    -----
    The probability of update and the ratio of long gaps are requirements of the EUROCONTROL
    Specification for ATM Surveillance System Performance (EUROCONTROL-SPEC-147, 2015). A target is
    evaluated from its first update to the end of its truth. A gap of `dt` between two updates has
    `round(dt / update_interval)` expected updates, one of which took place. From the last update to
    the end of the truth, `floor(dt / update_interval + 0.1)` are missed. A target without any
    update misses all from its first time on. Sums are over all targets, so every expected update
    has the same weight. The time until the first update is not counted; it is given in `latency`.

    Updates of one flight are not independent, so intervals are by flight. Shares have Wilson's
    (1927), with the number of updates divided by the design effect, the variance by flight over
    that of independent updates (Kish 1965), and quantiles of Student's distribution. Where all or
    none took place, or there is one flight only, the design effect is taken to be 4. The root mean
    square has percentiles of 2000 samples of the flights; that of one flight is unbounded.

    Examples
    --------
    A target is updated every 4 s for 40 s, but not from 12 s to 28 s:

    >>> from types import SimpleNamespace
    >>> import numpy as np
    >>> from tertia import metrics
    >>> time = np.array([0, 4, 8, 32, 36, 40])
    >>> place = np.column_stack([200.0 * time, 0.0 * time])
    >>> tracks = SimpleNamespace(time=time, track=np.ones(6, int), position=place)
    >>> truth = metrics.Truth([0, 40], [7, 7], [[0, 0], [8000, 0]])
    >>> metrics.indicators(tracks, truth, max_distance=500, update_interval=4)
    Indicators(probability of update 0.5455, long gaps 0.4545, 0 false tracks, 0 of 1 targets \
missed, 0 switches, RMSE 0 m)
    """
    interval = positive_number(update_interval, "update_interval")
    level = probability(confidence_level, "confidence_level")
    limits = {} if limits is None else limits
    instance(limits, "limits", Mapping)
    required = {name: real(value, f"limits[{name!r}]") for name, value in limits.items()}
    if unknown := required.keys() - _LIMITED:
        raise ValueError(f"limits has {min(unknown)!r}; it may have {', '.join(sorted(_LIMITED))}")
    matching = match_tracks(tracks, truth, max_distance=max_distance, update_interval=interval)
    times = np.asarray(tracks.time, dtype=np.float64)
    expected, missed, long, first = _updates(truth, matching, times, interval)
    _, track = np.unique(np.asarray(tracks.track), return_inverse=True)
    shows = np.bincount(track, matching.matched)
    squares = np.sum(matching.error[matching.matched] ** 2, axis=-1)
    flight, flights = matching.target[matching.matched], len(truth)
    return Indicators(
        share_by_flight(
            (expected - missed).astype(float),
            expected.astype(float),
            level,
            required.get("probability_of_update"),
            least=True,
        ),
        share_by_flight(
            long.astype(float),
            expected.astype(float),
            level,
            required.get("long_gap_ratio"),
            least=False,
        ),
        expected,
        missed,
        int(np.count_nonzero(~matching.matched)),
        int(np.count_nonzero(2 * shows < np.bincount(track))),
        int(np.count_nonzero(np.isnan(first))),
        int(matching.switches.sum()),
        first - truth.first,
        root_by_flight(
            np.bincount(flight, squares, minlength=flights).astype(float),
            np.bincount(flight, minlength=flights).astype(float),
            level,
            required.get("rmse"),
        ),
        matching,
    )


def _updates(
    truth: Truth, matching: Matching, time: FloatArray, update_interval: float
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
    gap = (when[same + 1] - when[same]) / update_interval
    due = np.rint(gap).astype(np.int64)
    lost = np.maximum(due - 1, 0)
    for counts, values in ((expected, due), (missed, lost), (long, lost * (gap > LONG_GAP))):
        np.add.at(counts, target[same], values)
    seen = ~np.isnan(last)
    rest = (truth.last - np.where(seen, last, truth.first)) / update_interval
    # one more is due at the first time; it took place if the target was seen at all
    lost = np.floor(rest + TOLERANCE).astype(np.int64) + ~seen
    expected += lost + seen
    missed += lost
    long += lost * (rest > LONG_GAP)
    return expected, missed, long, first
