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
from tertia.kalman import SingerModel
from tertia.sensors import Radar

__all__ = [
    "CvModel",
    "ImmModel",
    "Motion",
    "MotionName",
    "PlanModel",
    "PlotStatus",
    "Plots",
    "Radar",
    "SingerModel",
    "TrackTable",
    "Tracker",
    "WindowModel",
    "track",
]

_State: TypeAlias = (
    "tuple[tuple[Radar, ...], tuple[FlightPlan, ...], float | None, int | None, bytes]"
)
_T = TypeVar("_T")
MotionName: TypeAlias = Literal["imm", "cv", "singer", "window"]
Motion: TypeAlias = "MotionName | ImmModel | CvModel | SingerModel | WindowModel"

# identity of a plot that has none
NO_IDENTITY = -1
# share of a scan for which a plot may be late
_PATIENCE = 0.25
# motions that follow flight plans
_WITH_PLANS = ("imm", "window")
# guard acceleration where scans take 4 s and where they take 10 s
_GUARDS = {"window": (12.0, 7.0)}
_GUARD = (5.0, 5.0)


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
    sensor : ndarray of int, shape (N,)
        Index of the sensor.
    height : ndarray of shape (N,)
        Metres; nan where it is not known.
    identity : ndarray of int, shape (N,)
        What the transponder answered, for example a code or an address; -1 where nothing.
    """

    time: FloatArray
    range: FloatArray
    azimuth: FloatArray
    sensor: IntArray
    height: FloatArray
    identity: IntArray

    def __init__(
        self,
        time: npt.ArrayLike,
        range: npt.ArrayLike,  # noqa: A002  # that is what it is
        azimuth: npt.ArrayLike,
        *,
        sensor: npt.ArrayLike = 0,
        height: npt.ArrayLike = np.nan,
        identity: npt.ArrayLike = NO_IDENTITY,
        degrees: bool = False,
    ) -> None:
        instants = samples(time, "time")
        if instants.ndim != 1:
            raise ValueError(f"time has shape {instants.shape}; it must be (N,)")
        columns = {
            "time": instants,
            "range": samples(range, "range"),
            "azimuth": _angles(azimuth, degrees),
            "sensor": _whole(sensor, "sensor"),
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
        for name in ("time", "range", "azimuth", "sensor", "height", "identity"):
            column = getattr(self, name)[index]
            if column.ndim != 1:
                raise ValueError(f"time has shape {column.shape}; it must be (N,)")
            object.__setattr__(some, name, np.ascontiguousarray(column))
        return some

    def to_cartesian(self, sensors: Sequence[Radar]) -> tuple[FloatArray, FloatArray]:
        """Return the plots as positions in the plane, as the tracker takes them.

        Parameters
        ----------
        sensors : sequence of Radar
            The radars that made the plots.

        Returns
        -------
        position : ndarray of shape (N, 2)
            East and north in metres; nan where the plot is invalid or straight above the radar. The
            mean of sine and cosine of a noisy azimuth is smaller by exp(-sigma^2 / 2), which is
            corrected.
        covariance : ndarray of shape (N, 2, 2)
            `J diag(range_sigma^2, azimuth_sigma^2) J'`.

        Raises
        ------
        ValueError
            A plot of a sensor that does not exist.
        TypeError
            Sensors that are no radars.

        Examples
        --------
        >>> import numpy as np
        >>> from tertia.tracker import Plots, Radar
        >>> radar = Radar(range_sigma=75.0, azimuth_sigma=np.radians(0.1), scan_period=10.0)
        >>> position, covariance = Plots([0.0], [150e3], 30.0, degrees=True).to_cartesian([radar])
        >>> position.round(1)
        array([[ 75000.1, 129904. ]])
        """
        radars = _each(sensors, Radar, "sensors")
        _require_sensors(self, len(radars))
        return _core.plots_to_cartesian(
            [_numbers(radar) for radar in radars],
            self.time,
            self.range,
            self.azimuth,
            self.height,
            self.sensor,
            self.identity,
        )


class PlotStatus(enum.IntEnum):
    """Why a plot was not used; `TrackTable.track_of_plot` has it in place of a track."""

    INVALID = -1
    LATE = -2
    AT_SENSOR = -3
    OUT_OF_RANGE = -4
    CLOCK_ERROR = -5
    DUPLICATE = -6

    @property
    def message(self) -> str:
        """What is wrong, as a sentence."""
        return _MESSAGES[self]


_MESSAGES = {
    PlotStatus.INVALID: (
        "time, range or azimuth is not a finite number, or enormous (over 1e11 s or 1e9 m), or the "
        "range is not positive"
    ),
    PlotStatus.LATE: "the plot is more than a scan older than those that came before",
    PlotStatus.AT_SENSOR: "the plot is straight above the radar",
    PlotStatus.OUT_OF_RANGE: "the plot is farther away than the radar sees",
    PlotStatus.CLOCK_ERROR: "the plot comes alone and long after the others, as with a wrong clock",
    PlotStatus.DUPLICATE: "the plot is the same as the one before it",
}


@dataclass(frozen=True, slots=True)
class ImmModel:
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


@dataclass(frozen=True, slots=True)
class CvModel:
    """Targets that fly straight on, disturbed by small accelerations: nearly constant velocity.

    Attributes
    ----------
    straight_sigma : float
        Standard deviation of the acceleration during a scan, in metres per second squared.
    """

    straight_sigma: float = 0.1

    def __post_init__(self) -> None:
        """Refuse what is not positive."""
        sigma = positive(real(self.straight_sigma, "straight_sigma"), "straight_sigma")
        object.__setattr__(self, "straight_sigma", float(sigma))


@dataclass(frozen=True, slots=True)
class WindowModel:
    """Least squares over a sliding window of plots, as in the source.

    Attributes
    ----------
    straight : int
        Plots in the window in straight flight.
    after_turn : int
        Plots that are kept when a manoeuvre is detected.
    planned_turn : int
        Plots in the window near a turn of the flight plan.
    """

    straight: int = 20
    after_turn: int = 3
    planned_turn: int = 5

    def __post_init__(self) -> None:
        """Refuse windows that no line can be fitted to."""
        for name in self.__slots__:
            object.__setattr__(self, name, integer(getattr(self, name), name, 2))


@dataclass(frozen=True, slots=True, init=False)
class PlanModel:
    """How closely targets follow their flight plans, and in which wind.

    Attributes
    ----------
    flown_probability : float
        Probability that a planned turn is flown, before any was seen; 0: plans have no influence.
        The motion "window" only distinguishes 0 from the rest.
    wind : (float, float)
        East and north velocity of the air in metres per second.
    wind_sigma : float
        Standard deviation of the wind in metres per second: 20 where it is not known, about 6
        where it is.
    """

    flown_probability: float
    wind: tuple[float, float]
    wind_sigma: float

    def __init__(
        self,
        flown_probability: float = 0.8,
        wind: npt.ArrayLike = (0.0, 0.0),
        wind_sigma: float = 20.0,
    ) -> None:
        probability = real(flown_probability, "flown_probability")
        if not 0.0 <= probability < 1.0:
            raise ValueError(
                f"flown_probability is {probability}; it must be 0 or more and less than 1"
            )
        air = finite(wind, "wind")
        if air.shape != (2,):
            raise ValueError(f"wind has shape {air.shape}; it must be (2,): east and north")
        sigma = finite(real(wind_sigma, "wind_sigma"), "wind_sigma")
        if sigma < 0.0:
            raise ValueError(f"wind_sigma is {sigma}; it must be 0 or positive")
        object.__setattr__(self, "flown_probability", probability)
        object.__setattr__(self, "wind", (float(air[0]), float(air[1])))
        object.__setattr__(self, "wind_sigma", float(sigma))


_MODELS: dict[str, ImmModel | CvModel | SingerModel | WindowModel] = {
    "imm": ImmModel(),
    "cv": CvModel(),
    # acceleration of 3 m/s2 that fades within a minute; the tracker takes the times of the plots
    "singer": SingerModel(1.0, 1 / 60, 3.0, exact=True),
    "window": WindowModel(),
}


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
    sensor : ndarray of int, shape (N,)
        Index of the sensor.
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
    turn_probability : ndarray of shape (N,)
        Probability that the target turns.
    height, vertical_rate : ndarray of shape (N,)
        Metres and metres per second; nan where no height was reported.
    identity : ndarray of int, shape (N,)
        What the transponder answers; -1 where it does not.
    plan : ndarray of int, shape (N,)
        Index of the flight plan of the target; -1 where it has none.
    confirmed : ndarray of bool, shape (N,)
        Whether the track was confirmed by then.
    conforms : ndarray of bool, shape (N,)
        Whether the target follows its plan; False where the plan is blocked.
    track_of_plot : ndarray of int, shape (P,)
        The track of each plot; a negative `PlotStatus` where it was not used.
    """

    time: FloatArray
    track: IntArray
    sensor: IntArray
    plot: IntArray
    position: FloatArray
    velocity: FloatArray
    covariance: FloatArray
    innovation: FloatArray
    innovation_covariance: FloatArray
    turn_probability: FloatArray
    height: FloatArray
    vertical_rate: FloatArray
    identity: IntArray
    plan: IntArray
    confirmed: BoolArray
    conforms: BoolArray
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

    def __getitem__(self, index: Any) -> TrackTable:
        """Return the rows of a slice, a mask or indices, with the tracks of all plots."""
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
    "turn_probability": ("numbers", 27, ()),
    "height": ("numbers", 28, ()),
    "vertical_rate": ("numbers", 29, ()),
    "track": ("integers", 0, ()),
    "sensor": ("integers", 1, ()),
    "plot": ("integers", 2, ()),
    "identity": ("integers", 3, ()),
    "plan": ("integers", 4, ()),
    "confirmed": ("flags", 0, ()),
    "conforms": ("flags", 1, ()),
}


class Tracker:
    """Tracks of the plots of one or more radars, scan after scan.

    It can be pickled and copied; the copy goes on to the last bit as the original does.

    Parameters
    ----------
    sensors : sequence of Radar
        The radars; plots refer to them by their index.
    motion : {"imm", "cv", "singer", "window"} or ImmModel, CvModel, SingerModel, WindowModel
        How confirmed targets move: interacting multiple models of straight flight, turns and what
        their flight plans say (default); straight flight; acceleration that fades; or least squares
        over a sliding window of plots, as in the source. A model has parameters of its own in place
        of the usual ones.
    plans : sequence of FlightPlan
        Where targets have said they will fly, for "imm" and "window". A track finds its plan by its
        identity, or by where and when it flies.
    plan_model : PlanModel, optional
        How closely plans are followed, and the wind.
    confirmation : (int, int)
        Plots that confirm a track, and scans in which they must come. More are asked for in
        clutter, so that false plots make one false track in a thousand scans.
    coasting : int
        Scans without a plot after which a track ends.
    clutter_density : float, optional
        False plots per square metre and scan; by default estimated from the plots.
    max_speed : float
        No target is faster, in metres per second.
    gate_probability : float
        Probability that a target's plot is within its gate.
    guard_acceleration : float, optional
        Acceleration that a target may have unnoticed where its gate is empty, in metres per second
        squared; by default 5, and for windows 12 where scans take 4 s to 7 where they take 10 s.
    identity_error_probability : float
        How often an identity is read wrongly: codes of four digits sometimes, addresses of 24 bits
        hardly ever (1e-9).
    emergency_codes : sequence of int
        Identities that tell of an emergency, as 0o7500, 0o7600, 0o7700 where identities are codes
        of mode 3/A. After two of them in a row the plan of a track is suspended (`suspend_plan`);
        they are no identity of their own.
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
    >>> radar = Radar(range_sigma=50.0, azimuth_sigma=np.radians(0.08), scan_period=4.0)
    >>> tracker = Tracker([radar])
    >>> for time in range(0, 40, 4):
    ...     found = tracker.update(Plots([time], [50e3 + 200 * time], [0.5]))
    >>> found
    TrackTable(1 tracks, 1 rows)
    >>> bool(190 < np.hypot(*found.velocity[0]) < 210)
    True
    """

    __slots__ = ("_core", "clock_period", "n_threads", "plans", "sensors")

    def __init__(
        self,
        sensors: Sequence[Radar],
        *,
        motion: Motion = "imm",
        plans: Sequence[FlightPlan] = (),
        plan_model: PlanModel | None = None,
        confirmation: tuple[int, int] = (3, 4),
        coasting: int = 5,
        clutter_density: float | None = None,
        max_speed: float = 350.0,
        gate_probability: float = GUARD,
        guard_acceleration: float | None = None,
        identity_error_probability: float = 1e-3,
        emergency_codes: Sequence[int] = (),
        clock_period: float | None = None,
        n_threads: int | None = None,
    ) -> None:
        self.n_threads = threads(n_threads)
        self.sensors = _each(sensors, Radar, "sensors")
        self.plans = _each(plans, FlightPlan, "plans")
        self.clock_period = None
        if clock_period is not None:
            self.clock_period = float(positive(real(clock_period, "clock_period"), "clock_period"))
        if not self.sensors:
            raise ValueError("sensors is empty; there must be at least one")
        probability = real(gate_probability, "gate_probability")
        if not 0.0 < probability < 1.0:
            raise ValueError(f"gate_probability is {probability}; it must be between 0 and 1")
        model = PlanModel() if plan_model is None else plan_model
        if not isinstance(model, PlanModel):
            raise TypeError(f"plan_model is {plan_model!r}; it must be a PlanModel")
        if not isinstance(confirmation, Sequence) or len(confirmation) != 2:
            raise TypeError(f"confirmation is {confirmation!r}; it must be a pair: plots, scans")
        plots, scans = (integer(count, "confirmation", 2) for count in confirmation)
        density = np.nan if clutter_density is None else real(clutter_density, "clutter_density")
        if clutter_density is not None:
            positive(density, "clutter_density")
        name, parameters = _motion(motion)
        if self.plans and name not in _WITH_PLANS:
            raise ValueError(f"motion {name!r} takes no plans; these do: {', '.join(_WITH_PLANS)}")
        unnoticed = _GUARDS.get(name, _GUARD)
        if guard_acceleration is not None:
            unnoticed = (real(guard_acceleration, "guard_acceleration"),) * 2
        self._core = _core.PlotTracker(
            [_numbers(radar) for radar in self.sensors],
            {
                "motion": name,
                "parameters": parameters,
                "guard": gate_threshold(probability),
                "guard_acceleration": unnoticed,
                "confirmation": (plots, scans),
                "coasting": integer(coasting, "coasting", 1),
                "max_speed": real(max_speed, "max_speed"),
                "clutter_density": density,
                "identity_error_probability": real(
                    identity_error_probability, "identity_error_probability"
                ),
                "emergency_codes": [
                    integer(code, "emergency_codes", 0) for code in emergency_codes
                ],
                "patience": _PATIENCE,
                "plans": [plan._route for plan in self.plans],
                "flown_probability": model.flown_probability,
                "wind": model.wind,
                "wind_sigma": model.wind_sigma,
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
            _require_sensors(plots, len(self.sensors))
            instants = self._since_the_first_day(instants, self.clock_period)
            if end is not None:
                end = float(self._since_the_first_day(np.array([end]), self.clock_period)[0])
        found = self._core.track(
            instants,
            plots.range,
            plots.azimuth,
            plots.height,
            plots.sensor,
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

    def extrapolate(self, seconds: float) -> tuple[IntArray, FloatArray]:
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
        tracks, positions = self._core.extrapolate(interval)
        return tracks, positions

    def suspend_plan(self, track: int) -> None:
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

    def resume_plan(self, track: int) -> None:
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
        if not self._core.suspend_plan(number, held):
            raise ValueError(f"track is {number}; there is no confirmed track of this number")

    @property
    def suspended_plans(self) -> IntArray:
        """Numbers of the confirmed tracks whose plans are held, by a controller or an emergency."""
        return self._core.suspended_plans()

    def __getstate__(self) -> _State:
        """Return all that the tracker knows."""
        return (
            self.sensors,
            self.plans,
            self.clock_period,
            self.n_threads,
            self._core.__getstate__(),
        )

    def __setstate__(self, state: _State) -> None:
        """Go on from there."""
        self.sensors, self.plans, self.clock_period, self.n_threads, saved = state
        self._core = _core.PlotTracker.from_state(saved)

    def __repr__(self) -> str:
        """Tell the number of radars and the time."""
        return f"Tracker({len(self.sensors)} sensors, time {self._core.time:.6g} s)"


def track(plots: Plots, sensors: Sequence[Radar], **options: Any) -> TrackTable:
    """Track a whole recording.

    Parameters
    ----------
    plots : Plots
        In any order.
    sensors : sequence of Radar
        The radars.
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
    >>> radar = Radar(range_sigma=50.0, azimuth_sigma=np.radians(0.08), scan_period=4.0)
    >>> time = np.arange(0.0, 100.0, 4.0)
    >>> track(Plots(time, 50e3 + 200 * time, 0.5), [radar])
    TrackTable(1 tracks, 25 rows)
    """
    return Tracker(sensors, **options)._track(plots, None, True)


def _each(values: Any, kind: type[_T], name: str) -> tuple[_T, ...]:
    """Return a sequence of objects of a kind."""
    if not isinstance(values, Sequence):
        raise TypeError(f"{name} is {values!r}; it must be a sequence of {kind.__name__}")
    for i, value in enumerate(values):
        if not isinstance(value, kind):
            raise TypeError(f"{name}[{i}] is {value!r}; it must be a {kind.__name__}")
    return tuple(values)


def _require_sensors(plots: Plots, count: int) -> None:
    if not isinstance(plots, Plots):
        raise TypeError(f"plots is {plots!r}; it must be Plots")
    wrong = np.flatnonzero((plots.sensor < 0) | (plots.sensor >= count))
    if len(wrong):
        raise ValueError(
            f"sensor[{wrong[0]}] is {plots.sensor[wrong[0]]}; it must be the index of one of the "
            f"{count} sensors"
        )


def _numbers(radar: Radar) -> list[float]:
    """Return a radar as the core takes it."""
    east, north, *up = radar.position.tolist()
    return [
        east,
        north,
        *(up or [0.0]),
        radar.range_sigma,
        radar.azimuth_sigma,
        radar.scan_period,
        radar.max_range,
        radar.detection_probability,
    ]


def _motion(motion: Motion) -> tuple[str, list[float]]:
    """Return the name of a motion and its parameters, as the core takes them."""
    names = get_args(MotionName)
    if isinstance(motion, str):
        if motion not in names:
            raise ValueError(f"motion is {motion!r}; it must be one of {', '.join(names)}")
        motion = _MODELS[motion]
    match motion:
        case ImmModel():
            return "imm", list(astuple(motion))
        case CvModel():
            return "cv", [motion.straight_sigma]
        case SingerModel():
            if not motion.exact:
                raise ValueError("motion is a SingerModel with exact=False; it must be exact")
            return "singer", [motion.alpha, motion.acceleration_sigma]
        case WindowModel():
            # the gates, and the sum of the distances of three plots
            gates = [gate_threshold(probability) for probability in (INNER, OUTER, GUARD)]
            return "window", [*map(float, astuple(motion)), *gates, gate_threshold(GUARD, 6)]
    raise TypeError(f"motion is {motion!r}; it must be a model, or one of {', '.join(names)}")


def _angles(azimuth: npt.ArrayLike, degrees: bool) -> FloatArray:
    """Return azimuths in radians."""
    angle = samples(azimuth, "azimuth")
    return np.radians(angle) if degrees else angle


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
