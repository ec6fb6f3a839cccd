"""Smoothed tracks: each state is estimated from all plots of its track, including later plots."""

from __future__ import annotations

import enum
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar, TypeAlias

import numpy as np
import numpy.typing as npt

from tertia import _core
from tertia._arrays import (
    BoolArray,
    FloatArray,
    IntArray,
    finite,
    instance,
    integer,
    positive_number,
    samples,
    threads,
)
from tertia._result import Result
from tertia.sensors import PositionSensor, Radar
from tertia.sensors._identities import COLUMNS as IDENTITIES
from tertia.sensors._identities import (
    NO_CALLSIGN,
    NO_IDENTITY,
    TextArray,
    is_known,
    leading,
)
from tertia.sensors._sensors import own_biases
from tertia.tracker._biases import whole_covariance
from tertia.tracker._errors import errors
from tertia.tracker._models import CvModel, ImmModel, Motion, core_motion
from tertia.tracker._placement import placed
from tertia.tracker._plots import Plots
from tertia.tracker._recording import track, tracked
from tertia.tracker._registrar import error_sigmas, is_default, is_registrable
from tertia.tracker._sensors import interval, refuse_deviations, velocities_of
from tertia.tracker._systematic import Placed, systematic
from tertia.tracker._table import TrackTable

_Sensor: TypeAlias = Radar | PositionSensor
# tracks of one identity are one target's if no more than this lies between them, in seconds, at
# speeds of aircraft, in metres per second, with an allowance for the errors of both ends, in metres
_PAUSE, _FASTEST, _ALLOWANCE = 300.0, 350.0, 3000.0
# plots wait less for others before they are given to tracks, in seconds
_WAITING = 60.0
# more states than these are asked for by mistake
_MOST_STATES = 100_000_000


class Transversal(enum.IntEnum):
    """How a target moves across its course, as in ASTERIX I062/200."""

    CONSTANT_COURSE = 0
    RIGHT_TURN = 1
    LEFT_TURN = 2
    UNDETERMINED = 3


class Longitudinal(enum.IntEnum):
    """How the speed of a target changes along its course, as in ASTERIX I062/200."""

    CONSTANT_SPEED = 0
    INCREASING_SPEED = 1
    DECREASING_SPEED = 2
    UNDETERMINED = 3


class Vertical(enum.IntEnum):
    """How a target moves vertically: level, climbing or descending, as in ASTERIX I062/200."""

    LEVEL = 0
    CLIMB = 1
    DESCENT = 2
    UNDETERMINED = 3


@dataclass(frozen=True, slots=True, eq=False)
class SmoothedTracks(Result):
    """States of tracks, estimated from all plots: one row for each plot and each requested time.

    The states of a track extend from its first plot to its last one.

    Attributes
    ----------
    time : ndarray of shape (N,)
        Time in seconds, in order within each track.
    track : ndarray of int, shape (N,)
        Number of the track; for tracks that are joined, the number of the first of them.
    sensor : ndarray of int, shape (N,)
        Index of the sensor that measured the plot; -1 if the row has no plot.
    plot : ndarray of int, shape (N,)
        Index of the plot; -1 if the row has no plot.
    position, velocity : ndarray of shape (N, 2)
        East and north, in metres and metres per second.
    covariance : ndarray of shape (N, 4, 4)
        Covariance of position and velocity.
    acceleration : ndarray of shape (N,)
        Acceleration along the course in m/s².
    turn_rate : ndarray of shape (N,)
        Turn rate in radians per second, positive to the right.
    innovation : ndarray of shape (N, 2)
        Plot minus the position estimated from all other plots, in metres; nan if the row has no
        plot.
    innovation_covariance : ndarray of shape (N, 2, 2)
        Covariance of the innovation.
    turn_probability, speed_change_probability : ndarray of shape (N,)
        Probability that the target turns, and probability that its speed changes.
    height, height_sigma, vertical_rate : ndarray of shape (N,)
        Height in metres, its standard deviation, and vertical rate in m/s, positive upwards; nan
        before the first height and after the last one.
    transversal, longitudinal, vertical : ndarray of int, shape (N,)
        How the target moves, as a value of `Transversal`, `Longitudinal` and `Vertical`. The value
        is `UNDETERMINED` if no movement has a probability of at least 0.7.
    icao_address, mode_3a, callsign, identity : ndarray, shape (N,)
        Identities as in `TrackTable`, at the last plot.
    gap : ndarray of shape (N,)
        Time in seconds to the nearest plot of the track that is used.
    outlier : ndarray of bool, shape (N,)
        Whether the plot contradicts the other plots of its track and was left out.
    final : ndarray of bool, shape (N,)
        Whether the state is at least 30 s older than the last plot, so that later plots would
        hardly change it.
    """

    _rows: ClassVar = "time", 0

    time: FloatArray
    track: IntArray
    sensor: IntArray
    plot: IntArray
    position: FloatArray
    velocity: FloatArray
    covariance: FloatArray
    acceleration: FloatArray
    turn_rate: FloatArray
    innovation: FloatArray
    innovation_covariance: FloatArray
    turn_probability: FloatArray
    speed_change_probability: FloatArray
    height: FloatArray
    height_sigma: FloatArray
    vertical_rate: FloatArray
    transversal: IntArray
    longitudinal: IntArray
    vertical: IntArray
    icao_address: IntArray
    mode_3a: IntArray
    callsign: TextArray
    identity: IntArray
    gap: FloatArray
    outlier: BoolArray
    final: BoolArray

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self.time)

    def __repr__(self) -> str:
        """Return a text that states the numbers of tracks and rows."""
        return f"SmoothedTracks({len(np.unique(self.track))} tracks, {len(self)} rows)"

    def __getitem__(self, index: Any) -> SmoothedTracks:
        """Return the rows that a slice, a mask or indices select."""
        return SmoothedTracks(*(getattr(self, one.name)[index] for one in fields(self)))


def smooth_tracks(
    plots: Plots,
    sensors: Sequence[_Sensor],
    tracks: TrackTable | None = None,
    *,
    motion: Motion = "imm",
    registration: Any = None,
    time: npt.ArrayLike = (),
    every: float | None = None,
    exclude: int | None = None,
    n_threads: int | None = None,
) -> SmoothedTracks:
    """Estimate the states of targets, each from all plots of its track.

    Two filters, one forwards and one backwards in time, are combined at each plot and at any time
    between plots. Each has three models: straight flight, turns and changes of speed.

    Parameters
    ----------
    plots : Plots
        Plots in any order.
    sensors : sequence of Radar or PositionSensor
        The sensors; plots refer to them by their index. Their biases are subtracted. Velocities of
        a `PositionSensor` are used, too.
    tracks : TrackTable, optional
        The assignment of plots to tracks; by default `track(plots, sensors)`. Tracks with the same
        identity are joined if the second begins within five minutes after the end of the first, at
        a place that an aircraft can reach, unless a radar sees both in one scan.
    motion : {"imm", "cv"} or ImmModel, CvModel
        Motion model of the targets. With "imm" or an `ImmModel`, targets fly straight or turn as
        described by the model, or change their speed. With "cv" or a `CvModel`, they only fly
        straight.
    registration : tertia.registration.Registration or False, optional
        A registration whose radars, with estimated noise, replace `sensors`, and whose biases over
        time are removed. By default, biases are estimated from the plots of the tracks as by
        `tertia.registration.register`. If it is False, biases are not estimated.
    time : array_like of shape (T,), optional
        Additional times in seconds at which states are returned.
    every : float, optional
        Interval in seconds: states are also returned at all its multiples.
    exclude : int, optional
        Index of a sensor whose plots are not used. These plots still have rows, so that they can be
        compared with the estimate from the plots of all other sensors.
    n_threads : int, optional
        Number of threads among which the tracks are divided; by default one per core if that is
        faster. It does not affect the results.

    Returns
    -------
    SmoothedTracks
        The states, by track and time.

    Raises
    ------
    ValueError
        If a plot belongs to a sensor that does not exist, if `tracks` was made from other plots, or
        if a parameter is outside its domain.
    TypeError
        If an argument has the wrong type.

    Notes
    -----
    A plot is left out, and the track smoothed again, if the plot is outside the guard gate
    (probability 0.998) about the estimate from all other plots, and farther from that estimate than
    the adjacent plots are. Reported velocities are left out by the same rule. If more plots are
    left out than by chance, sharper manoeuvres are tried, too. The cost is O(N) for
    N plots and times. States at the times of plots do not depend on additional times.

    Plots have the noise that they show, if it is larger than stated. A track without any height is
    at the height at which its radars agree. The covariances of positions include the uncertainty of
    biases and the part of the errors of reported positions that lasts. Systematic errors of a
    single sensor are included if their sigmas are stated. If no plot of the recording has a height,
    errors of heights are not.

    Source: Fraser, Potter 1969; Helmick, Blair, Hoffman 1995.

    Examples
    --------
    >>> import numpy as np
    >>> from tertia.tracker import Plots, Radar, smooth_tracks
    >>> radar = Radar(range_sigma=50.0, azimuth_sigma=np.radians(0.08), scan_period=4.0)
    >>> plots = Plots(np.arange(0.0, 100.0, 4.0), 50e3 + 200 * np.arange(0.0, 100.0, 4.0), 0.5)
    >>> smoothed = smooth_tracks(plots, [radar], every=1.0)
    >>> smoothed
    SmoothedTracks(1 tracks, 97 rows)
    >>> bool(np.all(np.abs(np.hypot(*smoothed.velocity.T) - 200) < 1))
    True
    """
    instance(plots, "plots", Plots)
    radars = _sensors_of(sensors, "sensors")
    if not isinstance(motion, str) and not isinstance(motion, ImmModel | CvModel):
        raise TypeError(f"motion is {motion!r}; it must be 'imm', 'cv', an ImmModel or a CvModel")
    moves = core_motion(motion)
    excluded = None if exclude is None else integer(exclude, "exclude", 0)
    if excluded is not None and excluded >= len(radars):
        raise ValueError(f"exclude is {excluded}; it must be less than {len(radars)}, the sensors")
    instants = np.unique(finite(samples(time, "time"), "time"))
    interval = None if every is None else positive_number(every, "every")
    sites: Sequence[_Sensor] = radars
    better, unknown = plots, None
    if registration is not None and registration is not False:
        sites = _sensors_of(getattr(registration, "sensors", None), "registration.sensors")
        if len(sites) != len(radars):
            raise ValueError(
                f"registration has {len(sites)} sensors; it must have {len(radars)}, as sensors"
            )
        better, sites = registration._removed(plots)
        unknown = whole_covariance(registration)
    updates = _updates(tracks, plots)
    if registration is None and is_registrable(sites):
        seen = tracked(plots, sites, motion=motion)[0] if tracks is None else tracks[updates]
        known = errors(plots, seen, sites)
        (better, sites), unknown = known.removed(plots, sites), whole_covariance(known)
    elif registration is None and is_default(sites):
        # nothing estimates these errors, but their size is stated
        unknown = np.diag(error_sigmas(sites).ravel() ** 2)
    if tracks is None:
        plots, radars = better, sites
        tracks = track(plots, radars, motion=motion, registration=False)
        updates = _updates(tracks, plots)
    rows = _Rows.of(tracks, updates, (plots, radars), (better, sites), (unknown, excluded))
    if interval is not None and np.sum(rows.spans) / interval > _MOST_STATES:
        raise ValueError(f"every is {interval}; that is more than {_MOST_STATES:,} states")
    used = np.ones(len(rows.plot), bool) if excluded is None else rows.sensor != excluded
    found = _core.smooth_tracks(
        moves,
        rows.first.tolist(),
        rows.columns,
        used,
        time=instants,
        every=interval,
        n_threads=threads(n_threads),
    )
    return _smoothed(rows, *found)


def _updates(tracks: TrackTable | None, plots: Plots) -> IntArray:
    """Return the rows with plots, after a check that these exist."""
    if tracks is None:
        return np.zeros(0, np.int64)
    instance(tracks, "tracks", TrackTable)
    updates = np.flatnonzero(tracks.plot >= 0)
    if len(updates) and np.max(tracks.plot[updates]) >= len(plots):
        raise ValueError(
            f"tracks has plot {np.max(tracks.plot[updates])}; there are {len(plots)} plots"
        )
    return updates


@dataclass(frozen=True, slots=True)
class _Rows:
    """Plots of tracks, sorted by track and time; `first` has the first plot of each track.

    `shared` is the covariance that all plots of a track have in common.
    """

    plot: IntArray
    sensor: IntArray
    identities: dict[str, npt.NDArray[Any]]
    number: IntArray
    first: IntArray
    columns: FloatArray
    shared: FloatArray

    @classmethod
    def of(
        cls,
        tracks: TrackTable,
        rows: IntArray,
        tracked: tuple[Plots, Sequence[_Sensor]],
        smoothed: tuple[Plots, Sequence[_Sensor]],
        left: tuple[FloatArray | None, int | None],
    ) -> _Rows:
        """Sort the plots of these rows, as they were tracked and as they are smoothed.

        `left` is the covariance of the systematic errors that are left, none if they are not
        included, and the sensor whose plots are not used.
        """
        (plots, radars), (better, sites) = tracked, smoothed
        own = plots[tracks.plot[rows]]
        corrected = own_biases(sites).correct(better[tracks.plot[rows]])
        # clocks are continuous in tracks, but plots that waited for others have rows of later times
        clock = tracks.time[rows] - own_biases(radars).correct(own).time
        time = corrected.time + np.where(np.abs(clock) > _WAITING, clock, 0.0)
        velocity, spread = velocities_of(corrected, sites)
        number = _joined(replace(tracks[rows], time=time), radars)
        position, covariance, shared = placed(corrected, sites, number, time, tracks.velocity[rows])
        known = np.isfinite(position[:, 0]) & np.isfinite(time)
        order = np.lexsort((tracks.plot[rows], time, number))
        order = order[known[order]]
        numbers, first = np.unique(number[order], return_index=True)
        unknown, excluded = left
        if unknown is not None:
            path = tracks.velocity[rows]
            parts = (own.sensor, number, time, position, covariance, path)
            seen = Placed(*(one[order] for one in parts))
            shared[order] += systematic(seen, sites, unknown, excluded)
        columns = np.column_stack(
            [
                time,
                position,
                covariance[:, 0, 0],
                covariance[:, 0, 1],
                covariance[:, 1, 1],
                velocity,
                spread[:, 0, 0],
                spread[:, 0, 1],
                spread[:, 1, 1],
                corrected.height,
                own.sensor,
            ]
        )
        return cls(
            tracks.plot[rows][order],
            own.sensor[order],
            {name: getattr(tracks, name)[rows][order] for name in IDENTITIES},
            numbers,
            np.append(first, len(order)),
            np.ascontiguousarray(columns[order]),
            shared[order],
        )

    @property
    def spans(self) -> FloatArray:
        """Durations of the tracks in seconds."""
        time = self.columns[:, 0]
        return time[self.first[1:] - 1] - time[self.first[:-1]]


def _sensors_of(values: Any, name: str) -> Sequence[_Sensor]:
    """Return radars and position sensors, after a check of their types."""
    if not isinstance(values, Sequence):
        raise TypeError(f"{name} is {values!r}; it must be a sequence of Radar or PositionSensor")
    for i, value in enumerate(values):
        instance(value, f"{name}[{i}]", Radar, PositionSensor)
        if value.target_extent > 0.0:
            raise ValueError(
                f"{name}[{i}].target_extent is {value.target_extent:g}; it must be 0, because "
                "plots of one target are not combined here"
            )
    refuse_deviations(values, name)
    return values


def _joined(tracks: TrackTable, radars: Sequence[_Sensor]) -> IntArray:
    """Return the number of the target of each row: the number of the target's first track."""
    if not len(tracks):
        return tracks.track
    seen = tracks[np.lexsort((tracks.time, tracks.track))]
    numbers, first = np.unique(seen.track, return_index=True)
    target = dict(zip(numbers.tolist(), numbers.tolist(), strict=True))
    kind = leading(seen)
    own_kind = getattr(seen, kind)
    if kind == "mode_3a":
        # equal codes of many targets say nothing
        own_kind = np.where(np.isin(own_kind, _core.CODES_OF_MANY), NO_IDENTITY, own_kind)
    identity = np.full_like(own_kind, NO_CALLSIGN if own_kind.dtype.kind == "U" else NO_IDENTITY)
    for rows in np.split(np.arange(len(seen)), first[1:]):
        replies = own_kind[rows]
        replies, counts = np.unique(replies[is_known(replies)], return_counts=True)
        if len(replies):
            identity[rows] = replies[np.argmax(counts)]
    several = np.unique(identity[first], return_counts=True)
    for reply in several[0][(several[1] > 1) & is_known(several[0])]:
        own = seen[identity == reply]
        for before, after in _changes(own[np.argsort(own.time, kind="stable")], radars):
            target[after] = target[before]
    found = np.array([target[number] for number in numbers.tolist()], dtype=np.int64)
    return found[np.searchsorted(numbers, tracks.track)]


def _changes(seen: TrackTable, radars: Sequence[_Sensor]) -> list[tuple[int, int]]:
    """Return pairs of tracks in which the second track continues the first.

    `seen` has rows of one identity. Two tracks belong to different targets if one radar has plots
    of both in the same scan. Two tracks of one target may receive its plots alternately for some
    scans.
    """
    for sensor in np.unique(seen.sensor):
        own = seen[seen.sensor == sensor]
        near = np.diff(own.time) < 0.5 * interval(radars[sensor])
        if np.any(near & (np.diff(own.track) != 0)):
            return []
    at = np.flatnonzero(np.diff(seen.track))
    pause = seen.time[at + 1] - seen.time[at]
    way = np.hypot(*(seen.position[at + 1] - seen.position[at]).T)
    near = (pause <= _PAUSE) & (way <= _FASTEST * pause + _ALLOWANCE)
    pairs = np.column_stack([seen.track[at], seen.track[at + 1]])
    far = set(map(frozenset, pairs[~near].tolist()))
    begun = np.isin(at + 1, np.unique(seen.track, return_index=True)[1])
    return [(a, b) for a, b in pairs[begun].tolist() if frozenset((a, b)) not in far]


def _smoothed(
    rows: _Rows, counts: IntArray, numbers: FloatArray, codes: IntArray, marks: BoolArray
) -> SmoothedTracks:
    """Return the output of the core as a table."""
    columns = iter(np.split(numbers, np.cumsum([1, 2, 2, 16, 2, 4, *[1] * 7]), axis=1))

    def one(*shape: int) -> FloatArray:
        return np.ascontiguousarray(next(columns)).reshape(len(numbers), *shape)

    at = codes[:, 0]
    between = at < 0
    # the last plot before; each track begins with one
    last = np.maximum.accumulate(at) if len(at) else at
    found: dict[str, Any] = {"time": one()}
    found |= {"position": one(2), "velocity": one(2), "covariance": one(4, 4)}
    found["covariance"][:, :2, :2] += rows.shared[last]
    found |= {"innovation": one(2), "innovation_covariance": one(2, 2)}
    for name in (
        "acceleration",
        "turn_rate",
        "turn_probability",
        "speed_change_probability",
        "height",
        "height_sigma",
        "vertical_rate",
        "gap",
    ):
        found[name] = one()
    for k, name in enumerate(("transversal", "longitudinal", "vertical"), start=1):
        found[name] = np.ascontiguousarray(codes[:, k])
    found |= {name: one[last] for name, one in rows.identities.items()}
    return SmoothedTracks(
        **found,
        track=np.repeat(rows.number, counts),
        sensor=np.where(between, -1, rows.sensor[at]) if len(at) else at,
        plot=np.where(between, -1, rows.plot[at]) if len(at) else at,
        outlier=np.ascontiguousarray(marks[:, 0]),
        final=np.ascontiguousarray(marks[:, 1]),
    )
