"""Tracker: scans of radar plots in, tracks out.

Plots are polar, of one radar or of several that turn at their own pace. Targets fly straight or
turn; which of both is found out from the plots (interacting multiple models). Azimuths are radians,
clockwise from north; positions are local east and north in metres.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Sequence
from dataclasses import astuple, dataclass
from typing import Any, Literal, TypeAlias, TypeVar, get_args

import numpy as np
import numpy.typing as npt

from tertia import _core
from tertia._arrays import (
    BoolArray,
    FloatArray,
    IntArray,
    finite,
    integer,
    positive,
    real,
    samples,
    threads,
)
from tertia.association import GUARD, INNER, OUTER, gate_threshold
from tertia.flightplan import FlightPlan

__all__ = [
    "Fate",
    "Manoeuvres",
    "Motion",
    "Plots",
    "Radar",
    "TrackTable",
    "Tracker",
    "cartesian",
    "track",
]

_State: TypeAlias = (
    "tuple[tuple[Radar, ...], tuple[FlightPlan, ...], float | None, int | None, bytes]"
)
_T = TypeVar("_T")
Motion: TypeAlias = Literal["imm-plan", "imm", "singer", "cv", "window", "window-plan"]

# identity of a plot that has none
NO_IDENTITY = -1
# share of a scan for which a plot may be late
_PATIENCE = 0.25
# manoeuvre frequency and acceleration
_SINGER = (1 / 60, 3.0)
# plots in straight flight, after a manoeuvre and near a planned turn
_WINDOW = (20, 3, 5)
# what a core is told that has no plans of its own
_CORES = {"imm-plan": "imm", "window-plan": "window"}
# guard acceleration where scans take 4 s and where they take 10 s
_GUARDS = {"window": (12.0, 7.0)}
_GUARD = (5.0, 5.0)


@dataclass(frozen=True, slots=True, eq=False, init=False)
class Radar:
    """Where a radar is, and how it measures.

    Attributes
    ----------
    position : ndarray of shape (2,) or (3,)
        East, north and, if known, up in metres.
    range_sigma : float
        Standard deviation of its ranges in metres.
    azimuth_sigma : float
        That of its azimuths in radians.
    period : float
        Seconds of a scan.
    range_max : float
        Metres; beyond, nothing is detected.
    detection_probability : float
        How often an aircraft within its range is seen in a scan.
    name : str or None
        How pictures and reports call it.
    """

    position: FloatArray
    range_sigma: float
    azimuth_sigma: float
    period: float
    range_max: float
    detection_probability: float
    name: str | None

    def __init__(
        self,
        position: npt.ArrayLike = (0.0, 0.0),
        *,
        range_sigma: float,
        azimuth_sigma: float,
        period: float,
        range_max: float = np.inf,
        detection_probability: float = 0.9,
        name: str | None = None,
    ) -> None:
        place = finite(position, "position")
        if place.shape not in {(2,), (3,)}:
            raise ValueError(f"position has shape {place.shape}; it must be (2,) or (3,)")
        probability = real(detection_probability, "detection_probability")
        if not 0.0 < probability < 1.0:
            raise ValueError(f"detection_probability is {probability}; it must be between 0 and 1")
        limit = real(range_max, "range_max")
        if not limit > 0.0:
            raise ValueError(f"range_max is {limit}; it must be positive")
        numbers = {"range_sigma": range_sigma, "azimuth_sigma": azimuth_sigma, "period": period}
        for key, number in numbers.items():
            object.__setattr__(self, key, float(positive(real(number, key), key)))
        object.__setattr__(self, "position", place)
        object.__setattr__(self, "range_max", limit)
        object.__setattr__(self, "detection_probability", probability)
        object.__setattr__(self, "name", name)


@dataclass(frozen=True, slots=True, eq=False, init=False)
class Plots:
    """What radars saw: polar plots, one element each, in any order.

    Attributes
    ----------
    time : ndarray of shape (N,)
        Seconds.
    range : ndarray of shape (N,)
        Metres from the radar: slant range where there is a height, horizontal otherwise.
    azimuth : ndarray of shape (N,)
        Radians, clockwise from north.
    radar : ndarray of int, shape (N,)
        Index of the radar.
    height : ndarray of shape (N,)
        Metres; nan where it is not known.
    identity : ndarray of int, shape (N,)
        What the transponder answered, for example a code or an address; -1 where nothing.
    """

    time: FloatArray
    range: FloatArray
    azimuth: FloatArray
    radar: IntArray
    height: FloatArray
    identity: IntArray

    def __init__(
        self,
        time: npt.ArrayLike,
        range: npt.ArrayLike,  # noqa: A002  # that is what it is
        azimuth: npt.ArrayLike,
        *,
        radar: npt.ArrayLike = 0,
        height: npt.ArrayLike = np.nan,
        identity: npt.ArrayLike = NO_IDENTITY,
    ) -> None:
        instants = samples(time, "time")
        if instants.ndim != 1:
            raise ValueError(f"time has shape {instants.shape}; it must be (N,)")
        columns = {
            "time": instants,
            "range": samples(range, "range"),
            "azimuth": samples(azimuth, "azimuth"),
            "radar": _whole(radar, "radar"),
            "height": samples(height, "height"),
            "identity": _whole(identity, "identity"),
        }
        for key, values in columns.items():
            try:
                same = values.shape == instants.shape
                column = values if same else np.broadcast_to(values, instants.shape)
                column = np.ascontiguousarray(column)
            except ValueError:
                raise ValueError(
                    f"{key} has shape {values.shape}; it must be {instants.shape}, as time"
                ) from None
            object.__setattr__(self, key, column)

    def __len__(self) -> int:
        """Return the number of plots."""
        return len(self.time)

    def __repr__(self) -> str:
        """Tell the number of plots."""
        return f"Plots({len(self)})"

    def __getitem__(self, index: Any) -> Plots:
        """Return some of the plots."""
        some = Plots.__new__(Plots)
        for name in ("time", "range", "azimuth", "radar", "height", "identity"):
            column = getattr(self, name)[index]
            if column.ndim != 1:
                raise ValueError(f"time has shape {column.shape}; it must be (N,)")
            object.__setattr__(some, name, np.ascontiguousarray(column))
        return some


class Fate(enum.IntEnum):
    """Why a plot was not used; `TrackTable.track_of_plot` has it in place of a track."""

    INVALID = -1
    LATE = -2
    AT_RADAR = -3
    OUT_OF_RANGE = -4
    STRAY = -5
    DUPLICATE = -6

    @property
    def reason(self) -> str:
        """What is wrong, as a sentence."""
        return _REASONS[self]


_REASONS = {
    Fate.INVALID: (
        "time, range or azimuth is not a finite number, or enormous (over 1e11 s or 1e9 m), or the "
        "range is not positive"
    ),
    Fate.LATE: "the plot is more than a scan older than those that came before",
    Fate.AT_RADAR: "the plot is straight above the radar",
    Fate.OUT_OF_RANGE: "the plot is farther away than the radar sees",
    Fate.STRAY: "the plot comes alone and long after the others, as with a wrong clock",
    Fate.DUPLICATE: "the plot is the same as the one before it",
}


@dataclass(frozen=True, slots=True)
class Manoeuvres:
    """How targets fly, where the motion is "imm"; "cv" uses `straight_sigma` alone.

    Attributes
    ----------
    straight_sigma, turn_sigma : float
        Standard deviation of the acceleration during a scan, in straight flight and in turns, in
        metres per second squared. Simulated legs are straighter (0.05) than recorded ones (0.2).
    turn_rate_sigma : float
        Standard deviation of the rate at which a turn begins, in radians per second.
    turn_rate_walk : float
        By how much it changes in a second: radians per second and root of a second.
    straight_time, turn_time : float
        Mean seconds of straight flight and of a turn.
    """

    straight_sigma: float = 0.1
    turn_sigma: float = 0.8
    turn_rate_walk: float = float(np.radians(0.03))
    turn_rate_sigma: float = float(np.radians(1.2))
    straight_time: float = 400.0
    turn_time: float = 35.0

    def __post_init__(self) -> None:
        """Refuse what is not positive."""
        for name in self.__slots__:
            object.__setattr__(self, name, float(positive(real(getattr(self, name), name), name)))


class _Columns:
    """Columns that lie one after the other in arrays, and are cut out when they are asked for."""

    __slots__ = ("_blocks", "_count")

    _blocks: dict[str, npt.NDArray[Any]]
    _count: int

    def __getattr__(self, name: str) -> Any:
        """Return a column; called where it has not been cut out yet."""
        try:
            kind, first, shape = _LAYOUT[name]
        except KeyError:
            raise AttributeError(f"{type(self).__name__!r} has no attribute {name!r}") from None
        block, count = self._blocks[kind], self._count
        width = math.prod(shape)
        column = block[first * count : (first + width) * count].reshape(count, *shape)
        object.__setattr__(self, name, column)
        return column


@dataclass(frozen=True, slots=True, eq=False)
class TrackTable(_Columns):
    """What is said of tracks, one row for every plot of theirs and for every scan that missed them.

    Attributes
    ----------
    time : ndarray of shape (N,)
        Seconds.
    track : ndarray of int, shape (N,)
        Number of the track, from 1 on.
    radar : ndarray of int, shape (N,)
        Index of the radar.
    plot : ndarray of int, shape (N,)
        Index of the plot among all plots that the tracker was ever given; -1 where it was missed.
    position, velocity : ndarray of shape (N, 2)
        East and north, in metres and metres per second.
    covariance : ndarray of shape (N, 4, 4)
        Of position and velocity.
    innovation : ndarray of shape (N, 2)
        Plot less prediction; nan where there was no plot.
    innovation_covariance : ndarray of shape (N, 2, 2)
        Its covariance.
    turning : ndarray of shape (N,)
        Probability that the target turns.
    height, climb : ndarray of shape (N,)
        Metres and metres per second; nan where no height was reported.
    identity : ndarray of int, shape (N,)
        What the transponder answers; -1 where it does not.
    plan : ndarray of int, shape (N,)
        Index of the flight plan of the target; -1 where it has none.
    confirmed : ndarray of bool, shape (N,)
        Whether the track was confirmed by then.
    conforming : ndarray of bool, shape (N,)
        Whether the target follows its plan; False where the plan is blocked.
    track_of_plot : ndarray of int, shape (P,)
        The track of each plot; a negative `Fate` where it was not used.
    """

    time: FloatArray
    track: IntArray
    radar: IntArray
    plot: IntArray
    position: FloatArray
    velocity: FloatArray
    covariance: FloatArray
    innovation: FloatArray
    innovation_covariance: FloatArray
    turning: FloatArray
    height: FloatArray
    climb: FloatArray
    identity: IntArray
    plan: IntArray
    confirmed: BoolArray
    conforming: BoolArray
    track_of_plot: IntArray

    @classmethod
    def _of(
        cls, numbers: FloatArray, integers: IntArray, flags: BoolArray, fates: IntArray
    ) -> TrackTable:
        """Return the table of what the core found."""
        table = cls.__new__(cls)
        blocks = {"numbers": numbers, "integers": integers, "flags": flags}
        object.__setattr__(table, "_blocks", blocks)
        object.__setattr__(table, "_count", len(flags) // 2)
        object.__setattr__(table, "track_of_plot", fates)
        return table

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self.time)

    def __repr__(self) -> str:
        """Tell the number of tracks and rows."""
        return f"TrackTable({len(np.unique(self.track))} tracks, {len(self)} rows)"

    @property
    def manoeuvre(self) -> BoolArray:
        """Whether the target turns more probably than not, of shape (N,)."""
        return self.turning > 0.5

    def rows(self, index: Any) -> TrackTable:
        """Return some of the rows, with all plots.

        Parameters
        ----------
        index : slice, ndarray of int or ndarray of bool
            Which rows.

        Returns
        -------
        TrackTable
        """
        columns = {name: getattr(self, name) for name in self.__slots__}
        kept = {name: column[index] for name, column in columns.items() if name != "track_of_plot"}
        return TrackTable(**kept, track_of_plot=self.track_of_plot)


# array, place and shape of a row, of each column
_LAYOUT: dict[str, tuple[str, int, tuple[int, ...]]] = {
    "time": ("numbers", 0, ()),
    "position": ("numbers", 1, (2,)),
    "velocity": ("numbers", 3, (2,)),
    "covariance": ("numbers", 5, (4, 4)),
    "innovation": ("numbers", 21, (2,)),
    "innovation_covariance": ("numbers", 23, (2, 2)),
    "turning": ("numbers", 27, ()),
    "height": ("numbers", 28, ()),
    "climb": ("numbers", 29, ()),
    "track": ("integers", 0, ()),
    "radar": ("integers", 1, ()),
    "plot": ("integers", 2, ()),
    "identity": ("integers", 3, ()),
    "plan": ("integers", 4, ()),
    "confirmed": ("flags", 0, ()),
    "conforming": ("flags", 1, ()),
}


class Tracker:
    """Tracks of the plots of one or more radars, scan after scan.

    It can be pickled and copied; the copy goes on to the last bit as the original does.

    Parameters
    ----------
    radars : sequence of Radar
        The radars; plots name them by their index.
    motion : {"imm-plan", "imm", "singer", "cv", "window", "window-plan"}
        How confirmed targets move: straight flight, turns and what flight plans say, by how likely
        they are (default); the same without plans; acceleration that fades (1/60 per second,
        3 m/s²); straight flight; least squares over the last 20 plots, 3 after a manoeuvre, as in
        the source; or the same with flight plans: near their turns 5 plots, along the arc.
    plans : sequence of FlightPlan
        Where targets have said they will fly, for "imm-plan" and "window-plan". A track finds its
        plan by its identity, or by where and when it flies.
    plan_prior : float
        Probability that a planned turn is flown, before any was seen; 0: plans have no say.
        To "window-plan" all others are alike.
    wind : (float, float)
        Velocity of the air to the east and to the north in metres per second: planned turns are
        flown in it.
    wind_sigma : float
        Standard deviation of the wind about that, in metres per second: 20 where it is not known,
        about 6 where it is.
    manoeuvres : Manoeuvres, optional
        Parameters of "imm-plan", "imm" and "cv".
    initiation : (int, int)
        Plots that confirm a track, and scans in which they must come. More are asked for in
        clutter, so that false plots make one false track in a thousand scans.
    coasting : int
        Scans without a plot after which a track ends.
    clutter_density : float, optional
        False plots per square metre and scan; by default estimated from the plots.
    speed_max : float
        No target is faster, in metres per second.
    gate_probability : float
        Probability that a target's plot is within its gate.
    guard_acceleration : float, optional
        Acceleration that a target may have unnoticed where its gate is empty, in metres per second
        squared; by default 5, and for windows 12 where scans take 4 s to 7 where they take 10 s.
    identity_error : float
        How often an identity is read wrongly: codes of four digits sometimes, addresses of 24 bits
        hardly ever (1e-9).
    emergency_codes : sequence of int
        Identities that tell of an emergency, as 0o7500, 0o7600, 0o7700 where identities are codes
        of mode 3/A. After two of them in a row the plan of a track is held, see `hold_plan`; they
        are no identity of their own.
    clock_period : float, optional
        Seconds after which the clock of the plots begins again, for example 86400 for the time of
        the day.
    n_threads : int, optional
        Threads to use for scans of more than a thousand plots a thread; by default all cores. The
        tracks are the same to the last bit.

    Raises
    ------
    ValueError
        A number outside its domain.
    TypeError
        An argument of the wrong type.

    Notes
    -----
    Confirmed tracks take their plots first, by the assignment with the largest likelihood ratio
    against false plots; then tentative ones; what is left begins tentative tracks. A plot outside
    the gate that no other track takes is taken within the guard gate, widened by an acceleration
    since the last plot. A scan of P plots costs O(P log P) with O(1) plots in a gate.

    Source: Glagovskii, Lavina, Rudelson 2014, sections on gates and manoeuvres; Bar-Shalom, Li,
    Kirubarajan 2001, section 11.6.

    Examples
    --------
    >>> import numpy as np
    >>> from tertia.tracker import Plots, Radar, Tracker
    >>> radar = Radar(range_sigma=50.0, azimuth_sigma=np.radians(0.08), period=4.0)
    >>> tracker = Tracker([radar])
    >>> for time in range(0, 40, 4):
    ...     found = tracker.update(Plots([time], [50e3 + 200 * time], [0.5]))
    >>> found
    TrackTable(1 tracks, 1 rows)
    >>> bool(190 < np.hypot(*found.velocity[0]) < 210)
    True
    """

    __slots__ = ("_core", "clock_period", "n_threads", "plans", "radars")

    def __init__(
        self,
        radars: Sequence[Radar],
        motion: Motion = "imm-plan",
        *,
        plans: Sequence[FlightPlan] = (),
        plan_prior: float = 0.8,
        wind: tuple[float, float] = (0.0, 0.0),
        wind_sigma: float = 20.0,
        manoeuvres: Manoeuvres | None = None,
        initiation: tuple[int, int] = (3, 4),
        coasting: int = 5,
        clutter_density: float | None = None,
        speed_max: float = 350.0,
        gate_probability: float = GUARD,
        guard_acceleration: float | None = None,
        identity_error: float = 1e-3,
        emergency_codes: Sequence[int] = (),
        clock_period: float | None = None,
        n_threads: int | None = None,
    ) -> None:
        self.n_threads = threads(n_threads)
        self.radars = _each(radars, Radar, "radars")
        self.plans = _each(plans, FlightPlan, "plans")
        self.clock_period = None
        if clock_period is not None:
            self.clock_period = float(positive(real(clock_period, "clock_period"), "clock_period"))
        if self.plans and motion not in _CORES:
            raise ValueError(f"motion {motion!r} takes no plans; they are for {[*_CORES]}")
        if not self.radars:
            raise ValueError("radars is empty; there must be at least one")
        probability = real(gate_probability, "gate_probability")
        if not 0.0 < probability < 1.0:
            raise ValueError(f"gate_probability is {probability}; it must be between 0 and 1")
        if manoeuvres is not None and not isinstance(manoeuvres, Manoeuvres):
            raise TypeError(f"manoeuvres is {manoeuvres!r}; it must be Manoeuvres")
        if not isinstance(initiation, Sequence) or len(initiation) != 2:
            raise TypeError(f"initiation is {initiation!r}; it must be a pair: plots, scans")
        plots, scans = (integer(count, "initiation", 2) for count in initiation)
        air = finite(wind, "wind")
        if air.shape != (2,):
            raise ValueError(f"wind has shape {air.shape}; it must be (2,): east and north")
        density = np.nan if clutter_density is None else real(clutter_density, "clutter_density")
        if clutter_density is not None:
            positive(density, "clutter_density")
        _require_motion(motion)
        core = _CORES.get(motion, motion)
        unnoticed = _GUARDS.get(core, _GUARD)
        if guard_acceleration is not None:
            unnoticed = (real(guard_acceleration, "guard_acceleration"),) * 2
        self._core = _core.PlotTracker(
            [_numbers(radar) for radar in self.radars],
            {
                "motion": core,
                "parameters": _parameters(core, manoeuvres or Manoeuvres()),
                "guard": gate_threshold(probability),
                "guard_acceleration": unnoticed,
                "initiation": (plots, scans),
                "coasting": integer(coasting, "coasting", 1),
                "speed_max": real(speed_max, "speed_max"),
                "clutter_density": density,
                "identity_error": real(identity_error, "identity_error"),
                "emergency_codes": [
                    integer(code, "emergency_codes", 0) for code in emergency_codes
                ],
                "patience": _PATIENCE,
                "plans": [plan._route for plan in self.plans],
                "plan_prior": real(plan_prior, "plan_prior"),
                "wind": (float(air[0]), float(air[1])),
                "wind_sigma": real(wind_sigma, "wind_sigma"),
            },
        )

    def update(self, plots: Plots, *, time: float | None = None) -> TrackTable:
        """Take the plots of a scan, or of any stretch of time.

        Parameters
        ----------
        plots : Plots
            In any order among themselves, not more than a scan older than those before.
        time : float, optional
            Until when plots would have come, in seconds; by default the time of the last plot. With
            it a scan without plots is seen as such.

        Returns
        -------
        TrackTable
            What became of the confirmed tracks.

        Raises
        ------
        ValueError
            A plot of a radar that does not exist, or a time that is not finite.
        """
        return self._track(plots, time, False)

    def _track(self, plots: Plots, time: float | None, recording: bool) -> TrackTable:
        """Return rows of confirmed tracks; of a recording also those from before they were."""
        if not isinstance(plots, Plots):
            raise TypeError(f"plots is {plots!r}; it must be Plots")
        instants, end = plots.time, None if time is None else real(time, "time")
        if self.clock_period is not None:
            _require_radars(plots, len(self.radars))
            instants = self._since_the_first_day(instants, self.clock_period)
            if end is not None:
                end = float(self._since_the_first_day(np.array([end]), self.clock_period)[0])
        found = self._core.track(
            instants,
            plots.range,
            plots.azimuth,
            plots.height,
            plots.radar,
            plots.identity,
            end,
            recording,
            self.n_threads,
        )
        return TrackTable._of(*found)

    def _since_the_first_day(self, time: FloatArray, period: float) -> FloatArray:
        """Return times of a clock that does not begin again, the first one next to those before."""
        known = np.flatnonzero(np.isfinite(time))
        if not len(known):
            return time
        going_on: FloatArray = time.copy()
        going_on[known] = np.unwrap(time[known], period=period)
        if np.isfinite(self._core.time):
            days = np.round((self._core.time - going_on[known[0]]) / period)
            going_on[known] += days * period
        return going_on

    def ahead(self, seconds: float) -> tuple[IntArray, FloatArray]:
        """Predict where the confirmed tracks will be.

        Parameters
        ----------
        seconds : float
            From now on, that is, from the time of the last update.

        Returns
        -------
        track : ndarray of int, shape (T,)
            Numbers of the tracks.
        position : ndarray of shape (T, 2)
            East and north in metres: along the plan where it is believed, straight on otherwise.

        Raises
        ------
        ValueError
            Seconds that are not finite.
        TypeError
            Seconds that are not a number.
        """
        interval = float(finite(real(seconds, "seconds"), "seconds"))
        tracks, positions = self._core.ahead(interval)
        return tracks, positions

    def hold_plan(self, track: int) -> None:
        """Block the flight plan of a track until it is released: it is wrong, or an emergency.

        A plan that the track finds later is held, too. What is held is pickled with the tracker.

        Parameters
        ----------
        track : int
            Number of a confirmed track.

        Raises
        ------
        ValueError
            There is no such track.
        TypeError
            A number that is no integer.
        """
        self._hold(track, held=True)

    def release_plan(self, track: int) -> None:
        """Release a flight plan that was held: it counts again once the track is back on it.

        That is after five scans in succession on one of its legs.

        Parameters
        ----------
        track : int
            Number of a confirmed track.

        Raises
        ------
        ValueError
            There is no such track.
        TypeError
            A number that is no integer.
        """
        self._hold(track, held=False)

    def _hold(self, track: int, *, held: bool) -> None:
        number = integer(track, "track", 1)
        if not self._core.hold_plan(number, held):
            raise ValueError(f"track is {number}; there is no confirmed track of this number")

    @property
    def held_plans(self) -> IntArray:
        """Numbers of the confirmed tracks whose plans are held, by a controller or an emergency."""
        return self._core.held_plans()

    def __getstate__(self) -> _State:
        """Return all that the tracker knows."""
        return self.radars, self.plans, self.clock_period, self.n_threads, self._core.__getstate__()

    def __setstate__(self, state: _State) -> None:
        """Go on from there."""
        self.radars, self.plans, self.clock_period, self.n_threads, saved = state
        self._core = _core.PlotTracker.from_state(saved)

    def __repr__(self) -> str:
        """Tell the number of radars and the time."""
        return f"Tracker({len(self.radars)} radars, time {self._core.time:.6g} s)"


def track(
    plots: Plots, radars: Sequence[Radar], motion: Motion = "imm-plan", **options: Any
) -> TrackTable:
    """Track a whole recording.

    Parameters
    ----------
    plots : Plots
        In any order.
    radars : sequence of Radar
        The radars.
    motion : {"imm-plan", "imm", "singer", "cv", "window", "window-plan"}
        See `Tracker`.
    **options
        As of `Tracker`.

    Returns
    -------
    TrackTable
        All tracks that were confirmed, from their first plot on.

    Raises
    ------
    ValueError, TypeError
        As `Tracker`.

    Examples
    --------
    >>> import numpy as np
    >>> from tertia.tracker import Plots, Radar, track
    >>> radar = Radar(range_sigma=50.0, azimuth_sigma=np.radians(0.08), period=4.0)
    >>> time = np.arange(0.0, 100.0, 4.0)
    >>> track(Plots(time, 50e3 + 200 * time, 0.5), [radar])
    TrackTable(1 tracks, 25 rows)
    """
    return Tracker(radars, motion, **options)._track(plots, None, True)


def _each(values: Any, kind: type[_T], name: str) -> tuple[_T, ...]:
    """Return a sequence of objects of a kind."""
    if not isinstance(values, Sequence):
        raise TypeError(f"{name} is {values!r}; it must be a sequence of {kind.__name__}")
    for i, value in enumerate(values):
        if not isinstance(value, kind):
            raise TypeError(f"{name}[{i}] is {value!r}; it must be a {kind.__name__}")
    return tuple(values)


def _require_radars(plots: Plots, count: int) -> None:
    if not isinstance(plots, Plots):
        raise TypeError(f"plots is {plots!r}; it must be Plots")
    wrong = np.flatnonzero((plots.radar < 0) | (plots.radar >= count))
    if len(wrong):
        raise ValueError(
            f"radar[{wrong[0]}] is {plots.radar[wrong[0]]}; it must be the index of one of the "
            f"{count} radars"
        )


def cartesian(plots: Plots, radars: Sequence[Radar]) -> tuple[FloatArray, FloatArray]:
    """Return the plots in the plane.

    Parameters
    ----------
    plots : Plots
        The plots.
    radars : sequence of Radar
        The radars.

    Returns
    -------
    position : ndarray of shape (N, 2)
        East and north in metres. The error of the azimuth makes the mean of its sine and cosine
        smaller by exp(-sigma^2 / 2); that is taken out.
    covariance : ndarray of shape (N, 2, 2)
        J diag(sigma_range^2, sigma_azimuth^2) J'.

    Raises
    ------
    ValueError
        A plot of a radar that does not exist.
    TypeError
        Plots that are none.

    Examples
    --------
    >>> import numpy as np
    >>> from tertia.tracker import Plots, Radar, cartesian
    >>> radar = Radar(range_sigma=75.0, azimuth_sigma=np.radians(0.1), period=10.0)
    >>> position, covariance = cartesian(Plots([0.0], [150e3], np.radians(30.0)), [radar])
    >>> position.round(1)
    array([[ 75000.1, 129904. ]])
    """
    _require_radars(plots, len(radars))
    places = np.array([_numbers(radar) for radar in radars])[plots.radar]
    east, north, up, range_sigma, azimuth_sigma = places.T[:5]
    above = np.where(np.isnan(plots.height), 0.0, plots.height - up)
    ground = np.sqrt(np.maximum(plots.range**2 - above**2, 0.0)) * np.exp(azimuth_sigma**2 / 2)
    sine, cosine = np.sin(plots.azimuth), np.cos(plots.azimuth)
    position: FloatArray = np.stack([east + ground * sine, north + ground * cosine], axis=-1)
    along = np.stack([sine, cosine], axis=-1) * range_sigma[:, np.newaxis]
    across = np.stack([cosine, -sine], axis=-1) * (ground * azimuth_sigma)[:, np.newaxis]
    root = np.stack([along, across], axis=-1)
    covariance: FloatArray = root @ np.swapaxes(root, -1, -2)
    return position, covariance


def _numbers(radar: Radar) -> list[float]:
    """Return a radar as the core takes it."""
    east, north, *up = radar.position.tolist()
    return [
        east,
        north,
        *(up or [0.0]),
        radar.range_sigma,
        radar.azimuth_sigma,
        radar.period,
        radar.range_max,
        radar.detection_probability,
    ]


def _require_motion(motion: str) -> None:
    if motion not in get_args(Motion):
        raise ValueError(f"motion is {motion!r}; it must be one of {get_args(Motion)}")


def _parameters(motion: str, manoeuvres: Manoeuvres) -> list[float]:
    """Return the parameters of a core's motion."""
    if motion == "imm":
        return list(astuple(manoeuvres))
    if motion == "cv":
        return [manoeuvres.straight_sigma]
    if motion == "singer":
        return list(_SINGER)
    # the gates, and the sum of the distances of three plots
    gates = [gate_threshold(probability) for probability in (INNER, OUTER, GUARD)]
    return [*_WINDOW, *gates, gate_threshold(GUARD, 6)]


def _whole(value: npt.ArrayLike, name: str) -> IntArray:
    """Return `value` as int64 numbers."""
    array = np.asarray(value)
    if array.dtype == np.int64:
        return array
    if array.dtype.kind == "O":
        # nullable columns of older pandas
        array = np.asarray(array.tolist())
    if array.dtype.kind not in "iu" and array.size:
        raise TypeError(f"{name} has dtype {array.dtype}; it must hold integers")
    large = np.flatnonzero(array > np.iinfo(np.int64).max)
    if len(large):
        raise ValueError(
            f"{name}[{large[0]}] is {array.flat[large[0]]}; it must be less than 2**63"
        )
    return array.astype(np.int64)
