"""The conformance of a track to its plan, and its estimated times over the waypoints ahead."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from tertia import _core
from tertia._arrays import BoolArray, FloatArray, IntArray, instance, not_negative
from tertia._result import Result
from tertia.flightplan._plan import FlightPlan
from tertia.flightplan._tracks import one_track


@dataclass(frozen=True, slots=True, eq=False)
class Conformance(Result):
    """The conformance of a track to its plan, plot by plot.

    Attributes
    ----------
    conforms : ndarray of bool, shape (N,)
        Whether the plan is in use: it is not blocked, and its end is still ahead.
    cusum : ndarray of shape (N,)
        Cumulative sum of deviations from the plan; if it exceeds 14, the plan is blocked.
    along_track : ndarray of shape (N,)
        Distance along the path on the current leg, in metres.
    cross_track : ndarray of shape (N,)
        Distance from the path in metres, positive to the right.
    leg : ndarray of int, shape (N,)
        Index of the current leg, or of the leg on which the plan was blocked; -1 where there is no
        plot.
    in_zone : ndarray of bool, shape (N,)
        Whether the aircraft is in the zone in which the turn at the end of the leg may be flown.
    """

    _rows: ClassVar = "conforms", 0

    conforms: BoolArray
    cusum: FloatArray
    along_track: FloatArray
    cross_track: FloatArray
    leg: IntArray
    in_zone: BoolArray

    def __repr__(self) -> str:
        """Return the number of plots that conform."""
        return f"Conformance({np.count_nonzero(self.conforms)} of {self.conforms.size} plots)"


@dataclass(frozen=True, slots=True, eq=False)
class TimesOver(Result):
    """Estimated times over the waypoints (ETO) after each plot of a track.

    Attributes
    ----------
    time : ndarray of shape (N, W)
        Time over each waypoint in seconds; nan for passed waypoints, and before the first plot.
    sigma : ndarray of shape (N, W)
        Standard deviation of the time in seconds.
    speed : ndarray of shape (N,)
        Mean ground speed of the last minute in m/s, scaled to the planned speed of the current leg.
    speed_sigma : ndarray of shape (N,)
        Standard deviation of the speed in m/s.
    """

    _rows: ClassVar = "time", 0

    time: FloatArray
    sigma: FloatArray
    speed: FloatArray
    speed_sigma: FloatArray

    def __repr__(self) -> str:
        """Return the times after the last plot."""
        if len(self.time) == 0:
            return "TimesOver(0 plots)"
        pairs = zip(self.time[-1], self.sigma[-1], strict=True)
        listed = ", ".join(
            "passed" if np.isnan(time) else f"{time:.0f} ± {sigma:.2g}" for time, sigma in pairs
        )
        return f"TimesOver({listed})"


def conformance(
    plan: FlightPlan,
    time: npt.ArrayLike,
    position: npt.ArrayLike,
    velocity: npt.ArrayLike,
    *,
    covariance: npt.ArrayLike | None = None,
    update_interval: float | None = None,
) -> Conformance:
    """Monitor whether a track conforms to a plan.

    Parameters
    ----------
    plan : FlightPlan
        The plan.
    time : array_like of shape (N,)
        Times of the plots in seconds, increasing; nan where there is no plot.
    position, velocity : array_like of shape (N, 2)
        Positions and velocities that the track estimates: east and north in metres, and their rates
        in m/s.
    covariance : array_like of shape (N, 4, 4), optional
        Covariance of position and velocity; by default zero.
    update_interval : float, optional
        Time between plots in seconds; by default the median of the time differences.

    Returns
    -------
    Conformance
        For each plot, the leg, the position relative to the leg, the cumulative sum, and whether
        the plan is in use.

    Raises
    ------
    ValueError, TypeError
        If shapes do not match, a number is infinite, times do not increase, or an argument has the
        wrong type.

    Notes
    -----
    The deviation of a plot is `q = max(|e| - tolerance, 0)²/(350² + P) + course error²/(5°² +
    σψ²)`, where e is the cross-track distance, P its variance, and σψ² the variance of the course.
    The tolerance is 0 on straight legs, and `500 + 0.35 lead min(1, |angle|)` metres where a turn
    may be flown. Here lead is the distance from the start of the arc to the waypoint. In a zone
    that begins 0.3 leads plus 600 m before the arc, a course is an error only if it is not between
    the courses of the two legs. The plan is blocked when the cumulative sum `B = max(0, B + min(q,
    20) - 4)` exceeds 14. The plan is used again after five successive plots that lie within 1200 m
    of one leg and whose courses are within 6° of its course. This may be the same leg or a later
    one.

    Examples
    --------
    An aircraft that misses its turn:

    >>> import numpy as np
    >>> from tertia.flightplan import FlightPlan, conformance
    >>> plan = FlightPlan([[0, 0], [0, 50e3], [50e3, 50e3]], 200.0)
    >>> time = np.arange(0.0, 400.0, 10.0)
    >>> position = np.column_stack([0 * time, 200 * time])
    >>> found = conformance(plan, time, position, np.tile([0.0, 200.0], (40, 1)))
    >>> found, float(time[~found.conforms][0])
    (Conformance(26 of 40 plots), 260.0)
    """
    instance(plan, "plan", FlightPlan)
    track, interval = one_track(time, position, velocity, covariance, update_interval)
    leg, numbers, marks = _core.conformance(plan._route, track, interval)
    along_track, cross_track, cusum = numbers
    return Conformance(marks[0], cusum, along_track, cross_track, leg, marks[1])


def estimate_times_over(
    plan: FlightPlan,
    time: npt.ArrayLike,
    position: npt.ArrayLike,
    velocity: npt.ArrayLike,
    *,
    covariance: npt.ArrayLike | None = None,
    update_interval: float | None = None,
    speed_change_sigma: float = 0.04,
) -> TimesOver:
    """Estimate from a track the times over the waypoints of its plan.

    Parameters
    ----------
    plan, time, position, velocity, covariance, update_interval
        As for `conformance`.
    speed_change_sigma : float
        Standard deviation of the change of the ground speed within a minute, as a fraction of the
        planned speed. The changes are due to wind and to decisions of the crew.

    Returns
    -------
    TimesOver
        Times and speeds with their standard deviations, after each plot.

    Raises
    ------
    ValueError, TypeError
        If shapes do not match, a number is infinite, times do not increase, `speed_change_sigma` is
        negative, or an argument has the wrong type.

    Notes
    -----
    It is assumed that the rest of the plan is flown at the planned speeds, multiplied by the ratio
    of the mean ground speed of the last minute to the planned speed. The mean has exponential
    weights with a time constant of 60 s. Plots that do not conform to the plan are ignored. The
    variance of a time over a waypoint that is tau seconds ahead is `s²/V² + tau² (r² + q tau/3)`.
    Here s² is the variance of the along-track position, V is the speed, r² is the relative variance
    of the mean speed, and `q = speed_change_sigma²/60 s` is the intensity of the random walk of the
    relative speed.

    Examples
    --------
    >>> import numpy as np
    >>> from tertia.flightplan import FlightPlan, estimate_times_over
    >>> plan = FlightPlan([[0, 0], [60e3, 0], [90e3, 0]], 200.0)
    >>> time = np.arange(0.0, 200.0, 10.0)
    >>> slower = FlightPlan(plan.waypoints, 190.0)
    >>> plan.times, estimate_times_over(plan, time, *slower.at(time))
    (array([  0., 300., 450.]), TimesOver(passed, 316 ± 4.2, 474 ± 14))
    """
    instance(plan, "plan", FlightPlan)
    track, interval = one_track(time, position, velocity, covariance, update_interval)
    walk = not_negative(speed_change_sigma, "speed_change_sigma")
    return TimesOver(*_core.times_over(plan._route, track, interval, walk))
