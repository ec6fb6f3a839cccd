"""The fusion centre, which combines the tracks of several sensors into one picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, TypeAlias

import numpy as np

from tertia import _core
from tertia._arrays import (
    BoolArray,
    FloatArray,
    IntArray,
    finite,
    instance,
    integer,
    positive_number,
    real,
    sequence_of,
    threads,
)
from tertia._result import Result
from tertia.sensors import Bias, Radar
from tertia.sensors._bias import KINDS
from tertia.sensors._identities import COLUMNS as IDENTITIES
from tertia.sensors._identities import TextArray, identities_of
from tertia.sensors._sensors import drift_rates, own_biases
from tertia.tertiary._tracks import SensorTracks
from tertia.tracker._earth import plane_of
from tertia.tracker._models import core_radar

TrackMethod: TypeAlias = Literal[
    "tracklets", "matrix", "covariance-intersection", "static", "equal", "paper"
]
# a week at the default interval; more are errors of times
_CYCLES = 100_000
_State: TypeAlias = "tuple[tuple[Radar, ...], float, int | None, float, bytes]"


@dataclass(frozen=True, slots=True, eq=False)
class SystemTracks(Result):
    """Targets in the picture of a fusion centre, with one row for each target at each instant.

    Attributes
    ----------
    time : ndarray of shape (N,)
        Time in seconds.
    track : ndarray of int, shape (N,)
        Number of the target. Numbers start at 1, and the number of a target does not change.
    position, velocity : ndarray of shape (N, 2)
        East and north, in metres and metres per second.
    covariance : ndarray of shape (N, 4, 4)
        Covariance of position and velocity.
    members : ndarray of int, shape (N, K)
        Number of the target's track at each sensor; -1 if the sensor has none.
    pvalue : ndarray of shape (N,)
        Probability that tracks of one target differ at least as much as the members do; nan if
        there is only one member.
    confirmed : ndarray of bool, shape (N,)
        Whether the target has existed for three cycles.
    doubtful : ndarray of bool, shape (N,)
        Whether only one sensor has seen the target for ten cycles although another sensor should
        see it. Another sensor should see a target that is within its `max_range` if its detection
        probability is above 0.8.
    height : ndarray of shape (N,)
        Height in metres; nan if it is not known.
    icao_address, mode_3a, callsign, identity : ndarray, shape (N,)
        Identities as in `SensorTracks`, those of the newest member that has one.
    """

    _rows: ClassVar = "time", 0

    time: FloatArray
    track: IntArray
    position: FloatArray
    velocity: FloatArray
    covariance: FloatArray
    members: IntArray
    pvalue: FloatArray
    confirmed: BoolArray
    doubtful: BoolArray
    height: FloatArray
    icao_address: IntArray
    mode_3a: IntArray
    callsign: TextArray
    identity: IntArray

    @property
    def count(self) -> int:
        """Number of targets that are confirmed and not doubtful."""
        return len(np.unique(self.track[self.confirmed & ~self.doubtful]))

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self.time)

    def __getitem__(self, index: slice | BoolArray | IntArray) -> SystemTracks:
        """Return the rows that a slice, a mask or indices select."""
        return SystemTracks(**{name: getattr(self, name)[index] for name in self.__slots__})

    def __repr__(self) -> str:
        """Return a text that states the numbers of targets and rows."""
        return f"SystemTracks({len(np.unique(self.track))} tracks, {len(self)} rows)"


class FusionCentre:
    """A centre that fuses the tracks of several sensors into one picture, cycle by cycle.

    In each cycle it extrapolates the tracks to one instant, subtracts the systematic errors of the
    sensors, which it also estimates, decides which tracks belong to one target, and fuses them. A
    centre can be pickled and copied; the copy gives exactly the same results.

    Parameters
    ----------
    sensors : sequence of Radar
        The sensors; tracks refer to them by their index. Their `bias` states what is known
        beforehand of their systematic errors.
    method : str
        "tracklets" (default): the plot behind each row is reconstructed from the track, and the
        reconstructed plots are filtered as in the tracker. `range_sigma` and `azimuth_sigma` should
        be those of the sensor's plots; stated covariances may be wrong by a factor. "matrix": the
        states are combined so that the covariance is smallest if the errors of two tracks of one
        target have the given `cross_correlation`. "covariance-intersection": the states are
        combined so that the covariance is valid whatever the correlation of their errors is.
        "static": the states have fixed weights, which follow from the accuracy of the sensors at
        100 km. "equal": the states have equal weights. "paper": each component of a state is
        weighted by the inverse square of its last correction.
    cross_correlation : (float, float)
        Correlation of the errors of two tracks of one target, in position and in velocity. Its
        cause is that the manoeuvres of the target affect both tracks. Only "matrix" uses it; (0, 0)
        means that the errors are independent.
    registration : bool, optional
        Whether to estimate the systematic errors of the sensors. By default they are estimated if
        there are two or more sensors.
    update_interval : float
        Time between cycles in seconds; only `fuse_tracks` uses it.
    n_threads : int, optional
        Number of threads; by default one per core if that is faster. It does not affect the
        results.

    Raises
    ------
    ValueError
        If a number is outside its domain.
    TypeError
        If an argument has the wrong type.

    Notes
    -----
    Two tracks are compared by `D² = d' T⁻¹ d` and by the mean of D² over the last cycles. Here d is
    the difference of the tracks, and T is the sum of their covariances and of the covariance of the
    biases. A new pair is accepted if both D² and its mean are below the 99.9 % quantiles of their
    distributions; an existing pair is kept if one of the two is below its 99.9999 % quantile. The
    sensors are processed in turn: the tracks of each sensor are assigned to the groups that the
    tracks of the previous sensors have formed. A group is given the number of the target with which
    it has the most members in common.

    Errors of positions that last from row to row, as those of inertial navigation, are recognised
    by innovations that are smaller than the stated covariances explain. They are included in the
    covariances, and the biases are then less certain.

    Source: Panasyuk, Pudovkin, Rogachev 2018; Bar-Shalom, Fortmann 1988, chapter 10; Bar-Shalom,
    Campo 1986; Kalata 1984 (gains of filters).

    Examples
    --------
    >>> from tertia.tertiary import FusionCentre, SensorTracks
    >>> from tertia.tracker import Radar
    >>> radars = [
    ...     Radar(range_sigma=50.0, azimuth_sigma=0.0014, scan_period=4.0),
    ...     Radar([60e3, 0.0], range_sigma=75.0, azimuth_sigma=0.0017, scan_period=6.0),
    ... ]
    >>> centre = FusionCentre(radars)
    >>> tracks = SensorTracks(
    ...     [0.0, 1.0], [0, 1], [17, 4], [[30e3, 40e3], [30.2e3, 40e3]], [[200.0, 0.0]] * 2
    ... )
    >>> centre.update(tracks, time=2.0).members
    array([[17,  4]])
    """

    __slots__ = ("_core", "_time", "n_threads", "sensors", "update_interval")

    def __init__(
        self,
        sensors: Sequence[Radar],
        *,
        method: TrackMethod = "tracklets",
        cross_correlation: tuple[float, float] = (0.1, 0.3),
        registration: bool | None = None,
        update_interval: float = 5.0,
        n_threads: int | None = None,
    ) -> None:
        self.n_threads = threads(n_threads)
        self.sensors = sequence_of(sensors, Radar, "sensors")
        if not self.sensors:
            raise ValueError("sensors is empty; there must be at least one")
        plane_of(self.sensors)
        options = core_settings(
            method=method,
            cross_correlation=cross_correlation,
            registration=registration,
            update_interval=update_interval,
        )
        self.update_interval = options.pop("update_interval")
        if options["registers"] is None:
            options["registers"] = len(self.sensors) > 1
        prior = own_biases(self.sensors)
        mean, sigma = (
            np.stack([np.asarray(getattr(prior, kind + suffix)) for kind in KINDS], axis=-1)
            for suffix in ("", "_sigma")
        )
        radars = [core_radar(radar) for radar in self.sensors]
        drift = drift_rates(self.sensors)
        self._core = _core.FusionCentre(radars, **options, mean=mean, sigma=sigma, drift=drift)
        self._time = -np.inf

    @property
    def bias(self) -> Bias:
        """Systematic errors of the sensors as known at present, (K,)."""
        columns: dict[str, Any] = {}
        for suffix, table in zip(("", "_sigma"), self._core.known(), strict=True):
            columns |= {kind + suffix: table[:, at] for at, kind in enumerate(KINDS)}
        return Bias(**columns)

    def update(self, tracks: SensorTracks, *, time: float) -> SystemTracks:
        """Process messages about tracks, and return the picture at a given time.

        Parameters
        ----------
        tracks : SensorTracks
            Messages since the last cycle, in any order. Messages later than `time` are kept for the
            next cycle; messages that are not newer than the state of their track are dropped.
        time : float
            Time of the picture in seconds; it must be later than that of the previous update.

        Returns
        -------
        SystemTracks
            One row for each target.

        Raises
        ------
        ValueError
            If a sensor does not exist, or `time` is not later than that of the previous update.
        TypeError
            If an argument has the wrong type.
        """
        instance(tracks, "tracks", SensorTracks)
        instant = float(finite(real(time, "time"), "time"))
        if instant <= self._time:
            raise ValueError(f"time is {instant}; it must be later than {self._time}")
        unknown = np.flatnonzero(tracks.sensor >= len(self.sensors))
        if len(unknown):
            first = tracks.sensor[unknown[0]]
            raise ValueError(
                f"tracks.sensor[{unknown[0]}] is {first}; there are {len(self.sensors)} sensors"
            )
        columns: dict[str, Any] = {
            name: getattr(tracks, name) for name in SensorTracks.__slots__ if name not in IDENTITIES
        }
        columns["identities"] = identities_of(tracks)
        columns["state"] = np.hstack([columns.pop("position"), columns.pop("velocity")])
        track, numbers, members, codes, callsign, marks = self._core.update(
            columns, instant, self.n_threads
        )
        self._time = instant
        state, covariance, pvalue, height = numbers
        return SystemTracks(
            time=np.full(len(track), instant),
            track=track,
            position=state[:, :2].copy(),
            velocity=state[:, 2:].copy(),
            covariance=covariance,
            members=members,
            pvalue=pvalue,
            confirmed=marks[0],
            doubtful=marks[1],
            height=height,
            icao_address=codes[1],
            mode_3a=codes[2],
            callsign=callsign,
            identity=codes[0],
        )

    def join(self, a: int, b: int) -> None:
        """Treat the tracks of two targets as tracks of one target, until `release` is called.

        Parameters
        ----------
        a, b : int
            Numbers of two targets. No sensor may have a track of each of them.

        Raises
        ------
        ValueError
            If there is no such target, or a sensor has a track of each.
        TypeError
            If a number is not an integer.
        """
        self._decide(a, b, joined=True)

    def separate(self, a: int, b: int) -> None:
        """Treat the tracks of two targets as tracks of different targets, until `release` is used.

        Parameters
        ----------
        a, b : int
            Numbers of two targets.

        Raises
        ------
        ValueError
            If there is no such target.
        TypeError
            If a number is not an integer.
        """
        self._decide(a, b, joined=False)

    def _decide(self, a: int, b: int, *, joined: bool) -> None:
        first, second = integer(a, "a", 1), integer(b, "b", 1)
        if not self._core.decide(first, second, joined):
            clash = ", or a sensor has a track of each" if joined else ""
            raise ValueError(f"a is {first}, b is {second}; these are not two targets{clash}")

    def release(self, a: int) -> None:
        """Cancel all decisions made by `join` and `separate` about the tracks of a target.

        Parameters
        ----------
        a : int
            Number of the target.

        Raises
        ------
        ValueError
            If there is no such target.
        TypeError
            If the number is not an integer.
        """
        number = integer(a, "a", 1)
        if not self._core.release(number):
            raise ValueError(f"a is {number}; there is no such target")

    def __getstate__(self) -> _State:
        """Return the complete state of the centre."""
        own = self.sensors, self.update_interval, self.n_threads, self._time
        return *own, self._core.__getstate__()

    def __setstate__(self, state: _State) -> None:
        """Restore the state of the centre."""
        self.sensors, self.update_interval, self.n_threads, self._time, saved = state
        self._core = _core.FusionCentre.from_state(saved)

    def __repr__(self) -> str:
        """Return a text that states the number of sensors and the time."""
        return f"FusionCentre({len(self.sensors)} sensors, time {self._time:.6g} s)"


def core_settings(
    *,
    method: TrackMethod = "tracklets",
    cross_correlation: tuple[float, float] = (0.1, 0.3),
    registration: bool | None = None,
    update_interval: float = 5.0,
) -> dict[str, Any]:
    """Check the options of `FusionCentre` that can be checked without sensors and tracks.

    Commands call this to refuse wrong options before they read files.
    """
    if registration is not None:
        instance(registration, "registration", bool)
    if not isinstance(cross_correlation, Sequence) or len(cross_correlation) != 2:
        raise TypeError(f"cross_correlation is {cross_correlation!r}; it must be a pair")
    pair = [float(real(one, "cross_correlation")) for one in cross_correlation]
    if not all(0.0 <= one < 1.0 for one in pair):
        raise ValueError(
            f"cross_correlation is {cross_correlation!r}; it must be from 0 to below 1"
        )
    return {
        "method": str(method),
        "cross_correlation": pair,
        "registers": registration,
        "update_interval": positive_number(update_interval, "update_interval"),
    }


def fuse_tracks(tracks: SensorTracks, sensors: Sequence[Radar], **options: Any) -> SystemTracks:
    """Fuse the tracks of several sensors from a whole recording.

    Parameters
    ----------
    tracks : SensorTracks
        Tracks in any order.
    sensors : sequence of Radar
        The sensors.
    **options
        Options of `FusionCentre`.

    Returns
    -------
    SystemTracks
        All targets at all cycles; the first cycle is `update_interval` after the first row.

    Raises
    ------
    ValueError, TypeError
        As for `FusionCentre`.

    Examples
    --------
    >>> import numpy as np
    >>> from tertia.tertiary import SensorTracks, fuse_tracks
    >>> from tertia.tracker import Plots, Radar, track
    >>> radars = [Radar([east, 0.0], range_sigma=50.0, azimuth_sigma=1e-3, scan_period=4.0)
    ...           for east in (0.0, 40e3)]
    >>> time = np.arange(0.0, 100.0, 4.0)
    >>> north = 50e3 + 200.0 * time
    >>> plots = [Plots(time, np.hypot(20e3, north), np.arctan2(side * 20e3, north))
    ...          for side in (1, -1)]
    >>> tracks = [SensorTracks.of(track(one, [radar]), sensor=k)
    ...           for k, (one, radar) in enumerate(zip(plots, radars))]
    >>> fuse_tracks(SensorTracks.concatenate(tracks), radars)
    SystemTracks(1 tracks, 18 rows)
    """
    instance(tracks, "tracks", SensorTracks)
    centre = FusionCentre(sensors, **options)
    pictures = []
    if len(tracks):
        ordered = tracks[np.argsort(tracks.time, kind="stable")]
        first, last = ordered.time[0], ordered.time[-1]
        cycles = np.ceil((last - first) / centre.update_interval) or 1.0
        if cycles > _CYCLES:
            raise ValueError(
                f"update_interval is {centre.update_interval}; that makes {cycles:.3g} cycles of "
                f"{last - first:.6g} s, {_CYCLES} are allowed"
            )
        ends = first + centre.update_interval * np.arange(1, cycles + 1)
        # rounding may put the last cycle before the last row
        ends[-1] = max(ends[-1], last)
        edges = np.searchsorted(ordered.time, ends, side="right")
        begin = 0
        for end, time in zip(edges, ends, strict=True):
            pictures.append(centre.update(ordered[begin:end], time=time))
            begin = end
    else:
        pictures.append(centre.update(tracks, time=0.0))
    columns = {
        name: np.concatenate([getattr(one, name) for one in pictures])
        for name in SystemTracks.__slots__
    }
    return SystemTracks(**columns)
