"""Flight plans: where an aircraft has said it will fly, and what its track has to do with it.

A plan is a route of straight legs whose turns are flown by the waypoints, along arcs that are
tangent to both legs, and a ground speed on each leg. Positions are local east and north in metres,
courses are radians clockwise from north, and angles of turns and offsets are positive to the right.
`tertia.io.read_plans` reads plans from files.
"""

from __future__ import annotations

import enum
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from tertia import _core
from tertia._arrays import (
    BoolArray,
    FloatArray,
    IntArray,
    finite,
    positive,
    real,
    samples,
    scalar_or_array,
    threads,
)

__all__ = [
    "Conformance",
    "Correlation",
    "CorrelationStatus",
    "FlightPlan",
    "PassingTimes",
    "Projection",
    "Turns",
    "conformance",
    "correlate",
    "refine",
]

_GRAVITY = 9.80665
_BANK = float(np.radians(25.0))
_TURN_RATE = float(np.radians(3.0))
# a plan or track without identity
_NO_IDENTITY = -1


@dataclass(frozen=True, slots=True, eq=False)
class Turns:
    """The turns of a plan, one for each waypoint but the first and the last.

    Attributes
    ----------
    angle : ndarray of shape (N - 2,)
        By how much the course changes, radians, positive to the right.
    radius : ndarray of shape (N - 2,)
        Metres; smaller than bank and rate of turn ask for where the legs are too short.
    lead : ndarray of shape (N - 2,)
        Metres from the start of the arc to the waypoint, and from there to its end.
    arc : ndarray of shape (N - 2,)
        Length of the arc in metres.
    start, end, centre : ndarray of shape (N - 2, 2)
        Where the arc starts and ends, and its centre.
    """

    angle: FloatArray
    radius: FloatArray
    lead: FloatArray
    arc: FloatArray
    start: FloatArray
    end: FloatArray
    centre: FloatArray

    def __repr__(self) -> str:
        """Tell the angles."""
        degrees = ", ".join(f"{angle:+.1f}°" for angle in np.degrees(self.angle))
        return f"Turns({degrees})"


@dataclass(frozen=True, slots=True, eq=False)
class Projection:
    """The points of a plan's path nearest to some positions.

    Attributes
    ----------
    distance : float or ndarray of shape (...)
        Metres from the first waypoint along the path; negative before it.
    offset : float or ndarray of shape (...)
        Metres from there to the position, positive to the right.
    course : float or ndarray of shape (...)
        Course of the path there, radians in [0, 2 pi).
    leg : int or ndarray of int, shape (...)
        Which leg it is; the next one begins in the middle of the turn.
    """

    distance: float | FloatArray
    offset: float | FloatArray
    course: float | FloatArray
    leg: int | IntArray


@dataclass(frozen=True, slots=True, eq=False, init=False)
class FlightPlan:
    """A route of straight legs whose turns are flown by the waypoints, and its speeds.

    Parameters
    ----------
    waypoints : array_like of shape (N, 2)
        East and north in metres; none is where the one before it is.
    speeds : array_like of shape (N - 1,) or ()
        Ground speed on each leg in metres per second. The leg changes in the middle of a turn.
    times : array_like of shape (N,), optional
        Seconds at which the waypoints are passed, in place of the speeds and the start time.
    start_time : float, optional
        Seconds at the first waypoint; by default 0.
    heights : array_like of shape (N,) or (), optional
        Metres at the waypoints.
    bank : float
        Bank angle of its turns in radians.
    turn_radius : float, optional
        Metres, in place of `bank`: that of the turns at the highest speed of the plan; where it is
        slower they have the same bank.
    turn_rate : float
        Largest rate of turn in radians per second.
    identity : int, optional
        What the transponder answers, not negative.
    name : str, optional
        How pictures and reports call it.

    Attributes
    ----------
    waypoints : ndarray of shape (N, 2)
        East and north in metres.
    speeds : ndarray of shape (N - 1,)
        Ground speed on each leg in metres per second.
    start_time : float
        Seconds at the first waypoint.
    heights : ndarray of shape (N,) or None
        Metres at the waypoints; None where the plan has no levels.
    bank : float
        Bank angle of its turns in radians.
    turn_rate : float
        Largest rate of turn in radians per second.
    identity : int or None
        What the transponder answers.
    name : str or None
        How pictures and reports call it.

    Raises
    ------
    ValueError
        Fewer than two waypoints, equal ones in succession, times that do not increase, numbers
        outside their domains, shapes that do not fit.
    TypeError
        An argument of the wrong type.

    Notes
    -----
    A turn by the angle theta has the radius `R = max(V²/(g tan bank), V/turn_rate)`, V being the
    speed on the leg before it, and begins `R tan(|theta|/2)` before its waypoint. Where two turns
    need more than the leg between them, both get their share of it and smaller radii. The lead of
    turns beyond 150° is that of 150°; it has no bound otherwise. Heights are linear between
    waypoints.

    Examples
    --------
    >>> import numpy as np
    >>> from tertia.flightplan import FlightPlan
    >>> plan = FlightPlan([[0, 0], [0, 50e3], [40e3, 73e3]], 220.0)
    >>> plan
    FlightPlan(3 waypoints, 95.0 km, 432 s)
    >>> plan.turns
    Turns(+60.1°)
    >>> position, velocity = plan.at(200.0)
    >>> position.round(), velocity.round()
    (array([1.0e+00, 4.4e+04]), array([  3., 220.]))
    """

    waypoints: FloatArray
    speeds: FloatArray
    start_time: float
    heights: FloatArray | None
    bank: float
    turn_rate: float
    identity: int | None
    name: str | None

    def __init__(
        self,
        waypoints: npt.ArrayLike,
        speeds: npt.ArrayLike | None = None,
        *,
        times: npt.ArrayLike | None = None,
        start_time: float | None = None,
        heights: npt.ArrayLike | None = None,
        bank: float | None = None,
        turn_radius: float | None = None,
        turn_rate: float = _TURN_RATE,
        identity: int | None = None,
        name: str | None = None,
    ) -> None:
        places = np.ascontiguousarray(finite(waypoints, "waypoints")).copy()
        if places.ndim != 2 or places.shape[1] != 2 or len(places) < 2:
            raise ValueError(
                f"waypoints has shape {places.shape}; it must be (N, 2) with two or more waypoints"
            )
        rate = float(positive(real(turn_rate, "turn_rate"), "turn_rate"))
        if bank is not None and turn_radius is not None:
            raise ValueError("bank and turn_radius are both given; one of them tells the turns")
        angle = _bank(bank)
        start, legs = _schedule(places, speeds, times, start_time, bank=angle, rate=rate)
        if turn_radius is not None:
            # the speeds of given times depend on the radii, and these on the speeds
            for _ in range(_SUBSTITUTIONS if times is not None else 1):
                angle, rate = _turning(float(legs.max()), turn_radius, rate)
                start, legs = _schedule(places, speeds, times, start_time, bank=angle, rate=rate)
        if identity is not None and identity < 0:
            raise ValueError(f"identity is {identity}; it must not be negative")
        values: dict[str, Any] = {
            "waypoints": places,
            "speeds": legs,
            "start_time": start,
            "heights": None if heights is None else _each(finite, heights, "heights", len(places)),
            "bank": angle,
            "turn_rate": rate,
            "identity": identity,
            "name": name,
        }
        for key, value in values.items():
            object.__setattr__(self, key, value)
        _core.plan_geometry(_contents(self))

    @property
    def turns(self) -> Turns:
        """Its turns."""
        _, _, _, (angle, *numbers), points = _core.plan_geometry(_contents(self))
        return Turns(-angle, *numbers, *points)

    @property
    def length(self) -> float:
        """Metres along the path, arcs included."""
        return _core.plan_geometry(_contents(self))[0]

    @property
    def times(self) -> FloatArray:
        """Seconds at which the waypoints are passed, of shape (N,): in the middle of their arcs."""
        return _core.plan_geometry(_contents(self))[1]

    @property
    def distances(self) -> FloatArray:
        """Metres along the path at which the waypoints are passed, of shape (N,)."""
        return _core.plan_geometry(_contents(self))[2]

    def at(self, time: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return positions and velocities at some times.

        Parameters
        ----------
        time : array_like of shape (...)
            Seconds. Before the start and after the end the way goes straight on.

        Returns
        -------
        position, velocity : ndarray of shape (..., 2)
            Metres, and metres per second.

        Raises
        ------
        ValueError
            A time that is not finite.
        """
        position, velocity, _ = self._along(time, "time")
        return position, velocity

    def path(self, distance: npt.ArrayLike) -> tuple[FloatArray, float | FloatArray]:
        """Return positions and courses at some distances from the first waypoint along the path.

        Parameters
        ----------
        distance : array_like of shape (...)
            Metres.

        Returns
        -------
        position : ndarray of shape (..., 2)
            Metres.
        course : float or ndarray of shape (...)
            Radians in [0, 2 pi), clockwise from north.

        Raises
        ------
        ValueError
            A distance that is not finite.
        """
        position, direction, _ = self._along(distance, "distance")
        return position, _course(direction)

    def height(self, time: npt.ArrayLike) -> float | FloatArray:
        """Return heights at some times.

        Parameters
        ----------
        time : array_like of shape (...)
            Seconds.

        Returns
        -------
        float or ndarray of shape (...)
            Metres; nan where the plan has none.

        Raises
        ------
        ValueError
            A time that is not finite.
        """
        height: float | FloatArray = scalar_or_array(self._along(time, "time")[2])
        return height

    def project(self, position: npt.ArrayLike) -> Projection:
        """Return the points of the path nearest to some positions.

        Parameters
        ----------
        position : array_like of shape (..., 2)
            Metres.

        Returns
        -------
        Projection
            Distance along the path, offset, course and leg.

        Raises
        ------
        ValueError
            A position that is not finite, or a wrong shape.
        """
        places = finite(position, "position")
        if places.shape[-1:] != (2,):
            raise ValueError(f"position has shape {places.shape}; it must be (..., 2)")
        distance, offset, direction, leg = _core.plan_project(
            _contents(self), np.ascontiguousarray(places)
        )
        return Projection(
            scalar_or_array(distance),
            scalar_or_array(offset),
            _course(direction),
            scalar_or_array(leg),
        )

    def _along(self, value: npt.ArrayLike, name: str) -> tuple[FloatArray, FloatArray, FloatArray]:
        array = finite(value, name)
        flat = np.ascontiguousarray(array).reshape(-1)
        position, direction, height = _core.plan_path(_contents(self), flat, name == "time")
        shape = (*array.shape, 2)
        return position.reshape(shape), direction.reshape(shape), height.reshape(array.shape)

    def __repr__(self) -> str:
        """Tell name, waypoints, length and duration."""
        length, times, *_ = _core.plan_geometry(_contents(self))
        name = "" if self.name is None else f"{self.name}: "
        count = len(self.waypoints)
        lasting = times[-1] - times[0]
        return f"FlightPlan({name}{count} waypoints, {length / 1e3:.1f} km, {lasting:.0f} s)"


class CorrelationStatus(enum.IntEnum):
    """Why a track has a plan (accepted by its score, linked by its identity), or has none."""

    NONE = 0
    AMBIGUOUS = 1
    ACCEPTED = 2
    LINKED = 3


@dataclass(frozen=True, slots=True, eq=False)
class Correlation:
    """Which plans tracks belong to.

    Attributes
    ----------
    plan : int or ndarray of int, shape (...)
        Which plan; -1 where there is none or more than one could be meant.
    status : CorrelationStatus or ndarray of int, shape (...)
        Linked by identity, accepted by the score, ambiguous, or none.
    scores : ndarray of shape (..., M)
        Mean score of each plan, at most 0; nan without plots.
    """

    plan: int | IntArray
    status: CorrelationStatus | IntArray
    scores: FloatArray

    def __repr__(self) -> str:
        """Tell the decision, or how many there are of each."""
        if isinstance(self.status, CorrelationStatus):
            return f"Correlation({self.status.name.lower()}, plan {self.plan})"
        counts = [
            f"{np.count_nonzero(self.status == status)} {status.name.lower()}"
            for status in CorrelationStatus
        ]
        return f"Correlation({', '.join(counts)})"


@dataclass(frozen=True, slots=True, eq=False)
class Conformance:
    """Whether a track follows its plan, plot by plot.

    Attributes
    ----------
    conforming : ndarray of bool, shape (N,)
        Whether the plan can be believed: it is not blocked, and its end is ahead.
    level : ndarray of shape (N,)
        Cumulative sum of deviations; the plan is blocked where it exceeds 14.
    distance : ndarray of shape (N,)
        Metres along the path, on the leg that is flown.
    offset : ndarray of shape (N,)
        Metres from it, positive to the right.
    leg : ndarray of int, shape (N,)
        The leg that is flown, or was when the plan was blocked; -1 where there is no plot.
    in_zone : ndarray of bool, shape (N,)
        Whether the turn at the end of the leg may be flown now.
    """

    conforming: BoolArray
    level: FloatArray
    distance: FloatArray
    offset: FloatArray
    leg: IntArray
    in_zone: BoolArray

    def __repr__(self) -> str:
        """Tell how long it conforms."""
        count = np.count_nonzero(self.conforming)
        return f"Conformance({count} of {self.conforming.size} plots)"


@dataclass(frozen=True, slots=True, eq=False)
class PassingTimes:
    """When waypoints will be passed, as it is known after each plot of a track.

    Attributes
    ----------
    times : ndarray of shape (N, W)
        Seconds at each waypoint; nan where it has been passed, and before the first plot.
    sigma : ndarray of shape (N, W)
        Their standard deviations.
    speed : ndarray of shape (N,)
        Mean ground speed of the last minute on this leg in metres per second.
    speed_sigma : ndarray of shape (N,)
        Its standard deviation.
    """

    times: FloatArray
    sigma: FloatArray
    speed: FloatArray
    speed_sigma: FloatArray

    def __repr__(self) -> str:
        """Tell the last ones."""
        pairs = zip(self.times[-1], self.sigma[-1], strict=True)
        listed = ", ".join(
            "passed" if np.isnan(time) else f"{time:.0f} ± {sigma:.2g}" for time, sigma in pairs
        )
        return f"PassingTimes({listed})"


def correlate(
    plans: Sequence[FlightPlan],
    times: npt.ArrayLike,
    positions: npt.ArrayLike,
    velocities: npt.ArrayLike,
    *,
    covariances: npt.ArrayLike | None = None,
    heights: npt.ArrayLike | None = None,
    identities: npt.ArrayLike | None = None,
    n_threads: int | None = None,
) -> Correlation:
    """Find the plans to which tracks belong.

    Parameters
    ----------
    plans : sequence of M FlightPlan
        The plans.
    times : array_like of shape (..., N)
        Seconds of the last N plots of each track; nan where there is none.
    positions, velocities : array_like of shape (..., N, 2)
        Metres, and metres per second.
    covariances : array_like of shape (..., N, 4, 4), optional
        Of east, north, and their rates; by default without error.
    heights : array_like of shape (..., N), optional
        Metres; nan where they are not known.
    identities : array_like of int, shape (...), optional
        What the transponder answers; -1 where nothing.
    n_threads : int, optional
        Threads to use; by default one for little work and all cores for much.

    Returns
    -------
    Correlation
        Plan, status and scores of each track.

    Raises
    ------
    ValueError
        No plan, shapes that do not fit, or infinite numbers.
    TypeError
        An argument of the wrong type.

    Notes
    -----
    The score of a plot is `-1/2 [e²/(700² + P) + dpsi²/((3°)² + s_psi²) + dV²/(12² + s_V²) +
    dt²/120² + dh²/150²]` with its offset, and its differences of course, speed, time and height
    from the plan on the leg where it fits best. A plan of the same identity is linked if its mean
    score is above -25. Otherwise the best one is accepted if its mean score is above -8 and at
    least 3 above that of the next one, with five plots or more. Everything else is for people to
    decide. Cost O(legs) a plan and plot.

    Examples
    --------
    >>> import numpy as np
    >>> from tertia.flightplan import FlightPlan, correlate
    >>> plans = [FlightPlan([[0, y], [90e3, y]], 200.0) for y in (0.0, 20e3)]
    >>> times = np.arange(100.0, 150.0, 10.0)
    >>> position, velocity = plans[1].at(times)
    >>> correlate(plans, times, position + [300.0, -400.0], velocity)
    Correlation(accepted, plan 1)
    """
    if isinstance(plans, FlightPlan) or not all(isinstance(plan, FlightPlan) for plan in plans):
        raise TypeError("plans must be a sequence of FlightPlan")
    if not len(plans):
        raise ValueError("plans is empty; there must be one plan or more")
    tracks = _tracks(times, positions, velocities, covariances, heights)
    batch = tracks["times"].shape[:-1]
    names = np.asarray(_NO_IDENTITY if identities is None else identities)
    if names.dtype.kind not in "iu":
        raise TypeError(f"identities has dtype {names.dtype}; it must hold integers")
    if names.shape not in {(), batch}:
        raise ValueError(f"identities has shape {names.shape}; it must be {batch}")
    every = np.broadcast_to(names, batch).reshape(-1).tolist()
    scores, plan, status = _core.correlate(
        [_contents(plan) for plan in plans], tracks, every, threads(n_threads)
    )
    reason = status if batch else CorrelationStatus(int(status))
    return Correlation(scalar_or_array(plan), reason, scores)


def conformance(
    plan: FlightPlan,
    times: npt.ArrayLike,
    positions: npt.ArrayLike,
    velocities: npt.ArrayLike,
    *,
    covariances: npt.ArrayLike | None = None,
    period: float | None = None,
) -> Conformance:
    """Tell whether a track follows a plan.

    Parameters
    ----------
    plan : FlightPlan
        The plan.
    times : array_like of shape (N,)
        Seconds, increasing; nan where there is no plot.
    positions, velocities : array_like of shape (N, 2)
        Metres, and metres per second.
    covariances : array_like of shape (N, 4, 4), optional
        Of east, north, and their rates; by default without error.
    period : float, optional
        Seconds between plots; by default the median of the differences of the times.

    Returns
    -------
    Conformance
        For each plot leg, offset, level and whether the plan can be believed.

    Raises
    ------
    ValueError
        Shapes that do not fit, infinite numbers, times that do not increase.
    TypeError
        An argument of the wrong type.

    Notes
    -----
    The deviation of a plot is `q = max(|e| - room, 0)²/(350² + P) + course error²/(5°² + σψ²)`,
    with no room on straight legs, and `500 + 0.35 lead min(1, |angle|)` metres where a turn may be
    flown; there, from 0.3 leads and 600 m before the arc on, only courses outside those of both
    legs are in error. The level is the cumulative sum `B = max(0, B + min(q, 20) - 4)`; above 14
    the plan is blocked. It is believed again after five plots in succession within 1200 m and 6° of
    the same leg, this one or a later one.

    Examples
    --------
    An aircraft that does not turn:

    >>> import numpy as np
    >>> from tertia.flightplan import FlightPlan, conformance
    >>> plan = FlightPlan([[0, 0], [0, 50e3], [50e3, 50e3]], 200.0)
    >>> times = np.arange(0.0, 400.0, 10.0)
    >>> positions = np.column_stack([0 * times, 200 * times])
    >>> found = conformance(plan, times, positions, np.tile([0.0, 200.0], (40, 1)))
    >>> found, float(times[~found.conforming][0])
    (Conformance(26 of 40 plots), 260.0)
    """
    tracks = _tracks(times, positions, velocities, covariances, None)
    instants = _one_track(tracks)
    if period is None:
        steps = np.diff(instants[~np.isnan(instants)])
        scan = float(np.median(steps)) if steps.size else 0.0
    else:
        scan = float(positive(real(period, "period"), "period"))
    leg, numbers, marks = _core.conformance(_contents(plan), tracks, scan)
    distance, offset, level = numbers
    return Conformance(marks[0], level, distance, offset, leg, marks[1])


def refine(
    plan: FlightPlan,
    times: npt.ArrayLike,
    positions: npt.ArrayLike,
    velocities: npt.ArrayLike,
    *,
    covariances: npt.ArrayLike | None = None,
    period: float | None = None,
    drift: float = 0.04,
) -> PassingTimes:
    """Predict from a track when the waypoints of its plan will be passed.

    Parameters
    ----------
    plan : FlightPlan
        The plan.
    times : array_like of shape (N,)
        Seconds, increasing; nan where there is no plot.
    positions, velocities : array_like of shape (N, 2)
        Metres, and metres per second.
    covariances : array_like of shape (N, 4, 4), optional
        Of east, north, and their rates; by default without error.
    period : float, optional
        Seconds between plots; by default the median of the differences of the times.
    drift : float
        Standard deviation by which the ground speed changes in a minute, relative to that of the
        plan: wind, and what the crew does.

    Returns
    -------
    PassingTimes
        Times, speeds, and their standard deviations after each plot.

    Raises
    ------
    ValueError
        Shapes that do not fit, infinite numbers, times that do not increase.
    TypeError
        An argument of the wrong type.

    Notes
    -----
    The rest of the plan is flown at the mean ground speed of the last minute (weights fall by e in
    60 s), in proportion to the plan's speeds. Plots that do not conform to the plan change nothing.
    The variance of a time that is tau ahead is `s²/V² + tau² (r² + q tau/3)` with the variance s²
    of the position along the path, the relative variance r² of the mean speed, and a random walk of
    the speed with respect to the plan, q = drift²/60 s.

    Examples
    --------
    >>> import numpy as np
    >>> from tertia.flightplan import FlightPlan, refine
    >>> plan = FlightPlan([[0, 0], [60e3, 0], [90e3, 0]], 200.0)
    >>> times = np.arange(0.0, 200.0, 10.0)
    >>> slower = FlightPlan(plan.waypoints, 190.0)
    >>> plan.times, refine(plan, times, *slower.at(times))
    (array([  0., 300., 450.]), PassingTimes(passed, 316 ± 4.2, 474 ± 14))
    """
    follows = conformance(
        plan, times, positions, velocities, covariances=covariances, period=period
    )
    walk = real(drift, "drift")
    if not 0 <= walk < np.inf:
        raise ValueError(f"drift is {walk}; it must not be negative")
    tracks = _tracks(times, positions, velocities, covariances, None)
    legs = np.where(follows.conforming, follows.leg, -1).tolist()
    return PassingTimes(*_core.passing_times(_contents(plan), tracks, legs, walk))


# each takes the radius nearer by orders of magnitude
_SUBSTITUTIONS = 20


def _contents(plan: FlightPlan) -> dict[str, Any]:
    """Return what the core needs."""
    return {
        "waypoints": plan.waypoints,
        "speeds": plan.speeds,
        "start_time": plan.start_time,
        "heights": plan.heights,
        "bank": plan.bank,
        "turn_rate": plan.turn_rate,
        "identity": _NO_IDENTITY if plan.identity is None else int(plan.identity),
    }


def _bank(bank: float | None) -> float:
    angle = _BANK if bank is None else real(bank, "bank")
    if not 0.0 < angle < np.pi / 2:
        raise ValueError(f"bank is {angle}; it must be between 0 and pi/2")
    return angle


def _turning(speed: float, turn_radius: float, rate: float) -> tuple[float, float]:
    """Return bank and largest rate of turns of a radius at a speed."""
    radius = float(positive(real(turn_radius, "turn_radius"), "turn_radius"))
    return float(np.arctan2(speed**2, _GRAVITY * radius)), max(rate, speed / radius)


def _schedule(
    places: FloatArray,
    speeds: npt.ArrayLike | None,
    times: npt.ArrayLike | None,
    start_time: float | None,
    *,
    bank: float,
    rate: float,
) -> tuple[float, FloatArray]:
    """Return the time at the first waypoint and the speeds on the legs."""
    if (speeds is None) == (times is None):
        raise ValueError("either speeds or times must be given")
    if times is None:
        assert speeds is not None
        start = (
            0.0
            if start_time is None
            else float(finite(real(start_time, "start_time"), "start_time"))
        )
        return start, _each(positive, speeds, "speeds", len(places) - 1)
    if start_time is not None:
        raise ValueError("start_time and times are both given; the first of the times is the start")
    instants = finite(times, "times")
    if instants.shape != (len(places),):
        raise ValueError(f"times has shape {instants.shape}; it must be ({len(places)},)")
    instants = np.ascontiguousarray(instants)
    return float(instants[0]), _core.plan_speeds(places, instants, bank, rate)


def _each(check: Any, value: npt.ArrayLike, name: str, count: int) -> FloatArray:
    """Return one number for each of `count`, which may be the same for all."""
    array = check(value, name)
    if array.shape not in {(), (count,)}:
        raise ValueError(f"{name} has shape {array.shape}; it must be ({count},)")
    numbers: FloatArray = np.broadcast_to(array, count).copy()
    return numbers


def _course(direction: FloatArray) -> float | FloatArray:
    """Return courses of directions, in [0, 2 pi)."""
    turned = np.mod(np.arctan2(direction[..., 0], direction[..., 1]), 2 * np.pi)
    # a tiny negative angle is rounded to the whole turn
    course: float | FloatArray = scalar_or_array(np.where(turned < 2 * np.pi, turned, 0.0))
    return course


def _tracks(
    times: npt.ArrayLike,
    positions: npt.ArrayLike,
    velocities: npt.ArrayLike,
    covariances: npt.ArrayLike | None,
    heights: npt.ArrayLike | None,
) -> dict[str, Any]:
    """Return what the core needs of tracks, with shapes that fit."""
    instants = samples(times, "times")
    if instants.ndim < 1:
        raise ValueError("times is a single number; it must be (..., N)")
    given = {
        "times": (instants, ()),
        "positions": (samples(positions, "positions"), (2,)),
        "velocities": (samples(velocities, "velocities"), (2,)),
        "covariances": (
            None if covariances is None else samples(covariances, "covariances"),
            (4, 4),
        ),
        "heights": (None if heights is None else samples(heights, "heights"), ()),
    }
    tracks: dict[str, Any] = {}
    for name, (array, tail) in given.items():
        if array is None:
            tracks[name] = None
            continue
        shape = (*instants.shape, *tail)
        if array.shape != shape:
            raise ValueError(f"{name} has shape {array.shape}; it must be {shape}, as times")
        if np.isinf(array).any():
            place = tuple(np.argwhere(np.isinf(array))[0].tolist())
            raise ValueError(f"{name}{list(place)} is {array[place]}; it must be finite, or nan")
        tracks[name] = np.ascontiguousarray(array)
    return tracks


def _one_track(tracks: dict[str, Any]) -> FloatArray:
    """Return the times of a single track, which must increase."""
    instants: FloatArray = tracks["times"]
    if instants.ndim != 1:
        raise ValueError(f"times has shape {instants.shape}; it must be (N,)")
    present = instants[~np.isnan(instants)]
    bad = np.flatnonzero(np.diff(present) <= 0)
    if bad.size:
        at = bad[0]
        raise ValueError(f"times must increase; {present[at]} is followed by {present[at + 1]}")
    return instants
