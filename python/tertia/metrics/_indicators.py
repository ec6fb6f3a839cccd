"""Performance indicators of tracks, as used in air navigation services."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from tertia._arrays import (
    BoolArray,
    FloatArray,
    IntArray,
    instance,
    positive_number,
    probability,
    real,
)
from tertia._result import Result
from tertia.metrics._by_flight import (
    USUAL_EFFECT,
    mean_by_flight,
    rate,
    root_by_pair,
    share_by_flight,
)
from tertia.metrics._correctness import (
    LARGE_ERROR,
    clumping,
    heights,
    identified,
    identities,
    in_runs,
    squares_of,
    with_any,
)
from tertia.metrics._indicator import Indicator
from tertia.metrics._matching import Matching, Tracks, match_tracks
from tertia.metrics._timing import ages, near_any, offsets
from tertia.metrics._truth import Truth

# a gap is long beyond three update intervals and a tenth
LONG_GAP = 3.3
# figures that may have limits, and whether the limit is a smallest value
LIMITED = {
    "probability_of_update": True,
    "long_gap_ratio": False,
    "data_age": False,
    "pair_time_offset": False,
    "rmse": False,
    "large_error_ratio": False,
    "probability_of_height_update": True,
    "wrong_height_ratio": False,
    "probability_of_identity_update": True,
    "wrong_identity_ratio": False,
    "continuity": True,
    "false_tracks_per_hour": False,
    "near_false_tracks_per_hour": False,
    "false_update_density": False,
}
# intervals to which the density of false updates refers: an hour of 8 s each
_INTERVALS = 450
_NONE = -1
# share of an interval by which an update may be late
TOLERANCE = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class Indicators(Result):
    """Performance indicators of tracks, compared with the truth.

    Attributes
    ----------
    probability_of_update : Indicator
        Fraction of the expected updates that took place; nan if none were expected.
    long_gap_ratio : Indicator
        Fraction of the expected updates that are missing in gaps longer than 3.3 update intervals.
    expected_updates, missed_updates : ndarray of int, shape (K,)
        Numbers of expected and of missed updates of each target.
    false_updates : int
        Number of updates that do not belong to a target.
    false_tracks : int
        Number of tracks with fewer than half of their updates on a target.
    missed_targets : int
        Number of targets without a track.
    switches : int
        Number of track swaps: how often a target continues under the number of another track.
    latency : ndarray of shape (K,)
        Time in seconds from the first true position of each target to its first update; nan if it
        has no update.
    data_age : Indicator
        Mean time in seconds since the last update of a target, over the time during which it is
        tracked.
    pair_time_offset : Indicator
        Root mean square of the time in seconds between the updates of two targets close to each
        other.
    rmse : Indicator
        Root mean square of the distances of the updates from their targets, in metres.
    large_error_ratio : Indicator
        Fraction of the updates that belong to runs of three or more large errors in similar
        directions.
    probability_of_height_update, probability_of_identity_update : Indicator
        Fraction of the expected updates that took place with the correct height or identity; nan if
        the tracks or the truth have no heights or identities.
    wrong_height_ratio, wrong_identity_ratio : Indicator
        Fraction of the updates with a wrong height among those with a height, and with a wrong
        identity among those with an identity.
    continuity : Indicator
        Fraction of the tracked targets that kept the same track number throughout.
    false_tracks_per_hour : Indicator
        Number of false tracks per hour of the recording.
    near_false_tracks_per_hour : Indicator
        Number, per hour, of false tracks that are close to a target at one or more of their
        updates.
    false_update_density : Indicator
        Number of false updates per 900 square nautical miles and 450 update intervals.
    matching : Matching
        The target of each update. In the arrays of shape (K,), the targets have the order of
        `matching.targets`.
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
    data_age: Indicator
    pair_time_offset: Indicator
    rmse: Indicator
    large_error_ratio: Indicator
    probability_of_height_update: Indicator
    wrong_height_ratio: Indicator
    probability_of_identity_update: Indicator
    wrong_identity_ratio: Indicator
    continuity: Indicator
    false_tracks_per_hour: Indicator
    near_false_tracks_per_hour: Indicator
    false_update_density: Indicator
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
    """Compare tracks with the truth by the performance indicators of air navigation services.

    Parameters
    ----------
    tracks : Tracks
        Updates of tracks, as for `match_tracks`. They may also have a `height` and an `identity`,
        of shape (N,); if they have addresses or codes of their own, these are compared with the
        identities of the truth.
    truth : Truth
        The true positions of the targets.
    max_distance : float
        Largest distance in metres from a track to its target.
    update_interval : float
        Required time between updates, in seconds.
    limits : mapping of str to float, optional
        Limits of indicators, by the names of their attributes, as in the specification that
        applies; there are no default limits. Probabilities and `continuity` must be at least as
        large as their limits, and all other figures at most as large. The verdict is "met", "not
        met", or, if the interval contains the limit, "not shown". The additional name `large_error`
        sets the distance in metres beyond which an error is large; the default is 926, half a
        nautical mile.
    confidence_level : float
        Confidence level of the intervals.

    Returns
    -------
    Indicators
        The indicators with their intervals, and with verdicts where there are limits.

    Raises
    ------
    ValueError, TypeError
        As for `match_tracks`; also if `update_interval` is not positive, a limit has a name that is
        not that of a figure, or the confidence level is not between 0 and 1.

    Notes
    -----
    The probability of update and the ratio of long gaps are requirements of the EUROCONTROL
    Specification for ATM Surveillance System Performance (EUROCONTROL-SPEC-147, 2015). A target is
    evaluated from its first update to the end of its truth. A gap of `dt` between two updates has
    `round(dt / update_interval)` expected updates, one of which took place. From the last update to
    the end of the truth, `floor(dt / update_interval + 0.1)` updates are missed. A target without
    any update misses all updates from the first time of its truth on. Updates are summed over all
    targets, so every expected update has the same weight. The time before the first update is not
    evaluated; `latency` states it.

    A height is wrong if it is off by more than 300 ft. A run consists of at least three updates of
    a target, each farther off than `large_error`, whose directions change by less than 90 degrees
    from one to the next. Runs matter because they can make two targets that are not separated seem
    separated. The probabilities of update of height and identity are computed like the probability
    of update of the position, but from the first correct value on.

    The age of the data is zero at an update and grows until the next update. If updates are
    regular, its mean over time is therefore half the update interval. Gaps longer than 3.3
    intervals are not included, because they are counted as long gaps. Two targets are close to each
    other if they are within 10 nautical miles. Each update of one target is compared with the
    nearest update in time of the other, if there is one within half an update interval. For the
    density of false updates, the area is the total area of the squares with sides of 30 nautical
    miles that contain a target or an update.

    Updates of one flight are not independent, so intervals are computed by flight. The interval of
    a proportion is Wilson's (1927), with quantiles of Student's t distribution. In its computation,
    the number of updates is divided by the design effect, which is the ratio of the variance
    estimated from the flights to the variance of independent updates (Kish 1965). If all or no
    updates took place, or if there is only one flight, the design effect is assumed to be 4. The
    intervals of the root mean square and of the mean age are those of their logarithms by
    Student's distribution, with the variance estimated from the flights; with only one flight they
    are unbounded. The time offsets of pairs of targets that have
    a flight in common are correlated; their variance is estimated by a jackknife over flights. The
    interval of the rate of false tracks is Byar's approximation of the Poisson interval. The
    interval of the density is computed in the same way with a reduced number of updates, because
    the updates of one false track are not independent events.

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
    required, large = _limits(limits)
    matching = match_tracks(tracks, truth, max_distance=max_distance, update_interval=interval)
    times = np.asarray(tracks.time, dtype=np.float64)
    of = matching.target
    expected, missed, long, first = _updates(truth, of, times, interval)
    _, track = np.unique(np.asarray(tracks.track), return_inverse=True)
    is_false = 2 * np.bincount(track, matching.matched) < np.bincount(track)
    false_tracks = int(np.count_nonzero(is_false))
    squares = np.sum(matching.error[matching.matched] ** 2, axis=-1)
    flights = len(truth)

    def total(flight: IntArray, values: FloatArray | None = None) -> FloatArray:
        return np.bincount(flight, values, minlength=flights).astype(np.float64)

    def share(name: str, hits: IntArray | FloatArray, counts: IntArray | FloatArray) -> Indicator:
        values = hits.astype(np.float64), counts.astype(np.float64)
        return share_by_flight(*values, level, required.get(name), least=LIMITED[name])

    def ratio(name: str, hits: BoolArray, counts: BoolArray) -> Indicator:
        numbers = (np.bincount(of[one], minlength=flights) for one in (hits, counts))
        return share(name, *numbers)

    def updates(name: str, right: BoolArray, there: BoolArray) -> Indicator:
        due, lost, _, _ = _updates(truth, np.where(right, of, _NONE), times, interval)
        return share(name, np.where(there, due - lost, 0), np.where(there, due, 0))

    height, height_right = heights(tracks, truth, matching)
    identity, identity_right = identities(tracks, truth, matching)
    seen = ~np.isnan(first)
    runs = matching.matched & in_runs(of, times, matching.error, large)
    has_height = with_any(truth, np.isfinite(truth.height) if truth.height is not None else None)
    has_identity = with_any(truth, identified(truth))
    has_height &= bool(height.any())
    has_identity &= bool(identity.any())
    duration = float(np.ptp(truth.time))
    position = np.asarray(tracks.position, dtype=np.float64)
    aged, gap = ages(of, times, LONG_GAP * interval)
    one, other, off = offsets(matching, times, position, interval)
    area = squares_of(np.concatenate([truth.position, position]))
    idle = ~matching.matched
    of_false = is_false[track]
    close = near_any(truth, times[of_false], position[of_false])
    near_false = len(np.unique(track[of_false][close]))
    return Indicators(
        probability_of_update=share("probability_of_update", expected - missed, expected),
        long_gap_ratio=share("long_gap_ratio", long, expected),
        expected_updates=expected,
        missed_updates=missed,
        false_updates=int(np.count_nonzero(idle)),
        false_tracks=false_tracks,
        missed_targets=int(np.count_nonzero(~seen)),
        switches=int(matching.switches.sum()),
        latency=first - truth.first,
        data_age=mean_by_flight(
            total(aged, gap**2 / 2),
            total(aged, gap),
            level,
            required.get("data_age"),
            count=len(gap),
        ),
        pair_time_offset=root_by_pair(
            (one, other), off**2, level, required.get("pair_time_offset")
        ),
        rmse=mean_by_flight(
            total(of[matching.matched], squares),
            total(of[matching.matched]),
            level,
            required.get("rmse"),
            count=len(squares),
            root=True,
        ),
        large_error_ratio=ratio("large_error_ratio", runs, matching.matched),
        probability_of_height_update=updates(
            "probability_of_height_update", height_right, has_height
        ),
        wrong_height_ratio=ratio("wrong_height_ratio", height & ~height_right, height),
        probability_of_identity_update=updates(
            "probability_of_identity_update", identity_right, has_identity
        ),
        wrong_identity_ratio=ratio("wrong_identity_ratio", identity & ~identity_right, identity),
        continuity=share("continuity", seen & (matching.switches == 0), seen),
        false_tracks_per_hour=rate(
            false_tracks, duration / 3600.0, level, required.get("false_tracks_per_hour")
        ),
        near_false_tracks_per_hour=rate(
            near_false, duration / 3600.0, level, required.get("near_false_tracks_per_hour")
        ),
        false_update_density=rate(
            int(np.count_nonzero(idle)),
            area * duration / (_INTERVALS * interval),
            level,
            required.get("false_update_density"),
            effect=clumping(track[idle], USUAL_EFFECT),
        ),
        matching=matching,
    )


def _limits(given: Mapping[str, float] | None) -> tuple[dict[str, float], float]:
    """Return the limits of indicators, and the size of a large error."""
    limits = {} if given is None else given
    instance(limits, "limits", Mapping)
    required = {name: real(value, f"limits[{name!r}]") for name, value in limits.items()}
    large = positive_number(required.pop("large_error", LARGE_ERROR), "limits['large_error']")
    if unknown := required.keys() - LIMITED.keys():
        names = ", ".join(sorted([*LIMITED, "large_error"]))
        raise ValueError(f"limits has {min(unknown)!r}; it may have {names}")
    return required, large


def _updates(
    truth: Truth, of: IntArray, time: FloatArray, update_interval: float
) -> tuple[IntArray, IntArray, IntArray, FloatArray]:
    """Return numbers of expected, missed and long-gap updates, and times of first updates, (K,).

    `of` is the target of each update; updates without a target, -1, are not counted.
    """
    count = len(truth)
    rows = np.flatnonzero(of >= 0)
    rows = rows[np.lexsort((time[rows], of[rows]))]
    target, when = of[rows], time[rows]
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
