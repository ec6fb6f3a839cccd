"""Flight plans: routes of straight legs with fly-by turns, and a ground speed on each leg."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from tertia import _core
from tertia._arrays import (
    FloatArray,
    IntArray,
    finite,
    integer,
    positive,
    positive_number,
    real,
    require_each,
    samples,
    scalar_or_array,
)
from tertia._result import Result
from tertia.sensors._identities import of_target

_GRAVITY = 9.80665
_BANK = float(np.radians(25.0))
_TURN_RATE = float(np.radians(3.0))
# each brings the radius closer by orders of magnitude
_SUBSTITUTIONS = 20


@dataclass(frozen=True, slots=True, eq=False)
class Turns:
    """The turns of a plan, one at each inner waypoint.

    Attributes
    ----------
    angle : ndarray of shape (N - 2,)
        Change of course in radians, positive to the right.
    radius : ndarray of shape (N - 2,)
        Radius in metres. If the legs are too short, it is smaller than the radius that follows from
        the bank angle and the largest turn rate.
    lead : ndarray of shape (N - 2,)
        Distance in metres from the start of the arc to the waypoint. It equals the distance from
        the waypoint to the end of the arc.
    arc : ndarray of shape (N - 2,)
        Length of the arc in metres.
    start, end, centre : ndarray of shape (N - 2, 2)
        Start, end and centre of each arc, east and north in metres.
    """

    angle: FloatArray
    radius: FloatArray
    lead: FloatArray
    arc: FloatArray
    start: FloatArray
    end: FloatArray
    centre: FloatArray

    def __repr__(self) -> str:
        """Return the angles in degrees."""
        degrees = ", ".join(f"{angle:+.1f}°" for angle in np.degrees(self.angle))
        return f"Turns({degrees})"


@dataclass(frozen=True, slots=True, eq=False)
class Projection(Result):
    """The points of a plan's path that are nearest to given positions.

    Attributes
    ----------
    along_track : float or ndarray of shape (...)
        Distance from the first waypoint along the path in metres; negative before the first
        waypoint.
    cross_track : float or ndarray of shape (...)
        Distance from the path to the position in metres, positive to the right.
    course : float or ndarray of shape (...)
        Course of the path at this point in radians, in [0, 2 pi).
    leg : int or ndarray of int, shape (...)
        Index of the leg at this point; the next leg begins in the middle of the turn.
    """

    _rows: ClassVar = "along_track", 0

    along_track: float | FloatArray
    cross_track: float | FloatArray
    course: float | FloatArray
    leg: int | IntArray


@dataclass(frozen=True, slots=True, eq=False, init=False)
class FlightPlan:
    """A route of straight legs with fly-by turns, and a ground speed on each leg.

    Parameters
    ----------
    waypoints : array_like of shape (N, 2)
        East and north in metres; successive waypoints must differ.
    speeds : array_like of shape (N - 1,) or ()
        Ground speed on each leg in m/s; the speed changes in the middle of a turn.
    times : array_like of shape (N,), optional
        Times over the waypoints in seconds. They may be given instead of `speeds` and `start_time`.
    start_time : float, optional
        Time at the first waypoint in seconds; by default 0.
    heights : array_like of shape (N,) or (), optional
        Heights at the waypoints in metres; nan where unknown.
    bank : float
        Bank angle in turns in radians.
    turn_radius : float, optional
        Radius in metres, at the highest speed of the plan, from which the bank angle is computed.
        It may be given instead of `bank`. Turns at lower speeds have the same bank angle.
    turn_rate : float
        Largest turn rate in radians per second.
    icao_address, mode_3a : int, optional
        Address of 24 bits, and mode 3/A code that is assigned to the flight, for example 0o4204.
    callsign : str, optional
        Aircraft identification.
    identity : int, optional
        Any other number by which the target is known, not negative.
    name : str, optional
        Label of the plan in pictures and reports.

    Attributes
    ----------
    waypoints : ndarray of shape (N, 2)
        East and north in metres.
    speeds : ndarray of shape (N - 1,)
        Ground speed on each leg in m/s.
    start_time : float
        Time at the first waypoint in seconds.
    heights : ndarray of shape (N,) or None
        Heights at the waypoints in metres; None if the plan has none.
    bank : float
        Bank angle in turns in radians.
    turn_rate : float
        Largest turn rate in radians per second.
    icao_address, mode_3a : int or None
        Address of 24 bits and mode 3/A code.
    callsign : str or None
        Aircraft identification.
    identity : int or None
        Any other number by which the target is known.
    name : str or None
        Label of the plan in pictures and reports.

    Raises
    ------
    ValueError, TypeError
        If there are fewer than two waypoints, successive waypoints are equal, times do not
        increase, a number is outside its domain, shapes do not match, or an argument has the wrong
        type.

    Notes
    -----
    A turn by the angle theta has the radius `R = max(V²/(g tan bank), V/turn_rate)`, where V is the
    speed on the leg before the turn. The turn begins `R tan(|theta|/2)` before its waypoint. If two
    turns together need more than the length of the leg between them, the leg is divided between
    them in proportion to what they need, and their radii are reduced. Turns by more than 150° begin
    as early as turns by 150°. Heights are interpolated linearly between waypoints.

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
    icao_address: int | None
    mode_3a: int | None
    callsign: str | None
    identity: int | None
    name: str | None
    _route: _core.Route

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
        icao_address: int | None = None,
        mode_3a: int | None = None,
        callsign: str | None = None,
        identity: int | None = None,
        name: str | None = None,
    ) -> None:
        places = np.ascontiguousarray(finite(waypoints, "waypoints")).copy()
        if places.ndim != 2 or places.shape[1] != 2 or len(places) < 2:
            raise ValueError(
                f"waypoints has shape {places.shape}; it must be (N, 2) with two or more waypoints"
            )
        rate = positive_number(turn_rate, "turn_rate")
        if bank is not None and turn_radius is not None:
            raise ValueError("bank and turn_radius are both given; give one of them")
        angle = _bank(bank)
        start, legs = _schedule(places, speeds, times, start_time, bank=angle, rate=rate)
        if turn_radius is not None:
            # the speeds of given times depend on the radii, and these on the speeds
            for _ in range(_SUBSTITUTIONS if times is not None else 1):
                angle, rate = _turning(float(legs.max()), turn_radius, rate)
                start, legs = _schedule(places, speeds, times, start_time, bank=angle, rate=rate)
        if identity is not None:
            identity = integer(identity, "identity", 0)
        named, numbers = of_target(icao_address, mode_3a, callsign, identity)
        levels = None if heights is None else _each(_levels, heights, "heights", len(places))
        values: dict[str, Any] = {
            "waypoints": places,
            "speeds": legs,
            "start_time": start,
            "heights": levels,
            "bank": angle,
            "turn_rate": rate,
            **named,
            "name": name,
            "_route": _core.Route(
                places,
                legs,
                np.empty(0) if levels is None else levels,
                start,
                angle,
                rate,
                numbers,
            ),
        }
        for key, value in values.items():
            object.__setattr__(self, key, value)

    @property
    def turns(self) -> Turns:
        """The turns at the inner waypoints."""
        (angle, *numbers), points = self._route.turns()
        return Turns(-angle, *numbers, *points)

    @property
    def length(self) -> float:
        """Length of the path in metres, measured along the arcs of the turns."""
        return self._route.length

    @property
    def times(self) -> FloatArray:
        """Times over the waypoints in seconds, (N,); in a turn, at the middle of the arc."""
        return self._route.times

    @property
    def distances(self) -> FloatArray:
        """Distances along the path to the waypoints in metres, (N,), or to the middle of arcs."""
        return self._route.distances

    def at(self, time: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return positions and velocities at the given times.

        Parameters
        ----------
        time : array_like of shape (...)
            Times in seconds. Before the start and after the end, the path continues straight.

        Returns
        -------
        position, velocity : ndarray of shape (..., 2)
            East and north in metres, and their rates in m/s.

        Raises
        ------
        ValueError
            If a time is not finite.
        """
        position, velocity, _ = self._along(time, "time")
        return position, velocity

    def path(self, along_track: npt.ArrayLike) -> tuple[FloatArray, float | FloatArray]:
        """Return positions and courses at the given distances along the path.

        Parameters
        ----------
        along_track : array_like of shape (...)
            Distances from the first waypoint along the path in metres.

        Returns
        -------
        position : ndarray of shape (..., 2)
            East and north in metres.
        course : float or ndarray of shape (...)
            Course in radians, in [0, 2 pi), clockwise from north.

        Raises
        ------
        ValueError
            If a distance is not finite.
        """
        position, direction, _ = self._along(along_track, "along_track")
        return position, _course(direction)

    def height(self, time: npt.ArrayLike) -> float | FloatArray:
        """Return heights at the given times.

        Parameters
        ----------
        time : array_like of shape (...)
            Times in seconds.

        Returns
        -------
        float or ndarray of shape (...)
            Heights in metres; nan if the plan has no height there.

        Raises
        ------
        ValueError
            If a time is not finite.
        """
        height: float | FloatArray = scalar_or_array(self._along(time, "time")[2])
        return height

    def project(self, position: npt.ArrayLike) -> Projection:
        """Return the points of the path that are nearest to the given positions.

        Parameters
        ----------
        position : array_like of shape (..., 2)
            East and north in metres.

        Returns
        -------
        Projection
            Along-track and cross-track distance, course and leg.

        Raises
        ------
        ValueError
            If a position is not finite, or the shape is not (..., 2).
        """
        places = finite(position, "position")
        if places.shape[-1:] != (2,):
            raise ValueError(f"position has shape {places.shape}; it must be (..., 2)")
        along_track, cross_track, direction, leg = self._route.project(np.ascontiguousarray(places))
        return Projection(
            scalar_or_array(along_track),
            scalar_or_array(cross_track),
            _course(direction),
            scalar_or_array(leg),
        )

    def _along(self, value: npt.ArrayLike, name: str) -> tuple[FloatArray, FloatArray, FloatArray]:
        array = finite(value, name)
        flat = np.ascontiguousarray(array).reshape(-1)
        position, direction, height = self._route.path(flat, name == "time")
        shape = (*array.shape, 2)
        return position.reshape(shape), direction.reshape(shape), height.reshape(array.shape)

    def __repr__(self) -> str:
        """Return the name, the number of waypoints, the length and the duration, as text."""
        times = self.times
        name = "" if self.name is None else f"{self.name}: "
        size, duration = f"{self.length / 1e3:.1f} km", times[-1] - times[0]
        return f"FlightPlan({name}{len(self.waypoints)} waypoints, {size}, {duration:.0f} s)"


def _bank(bank: float | None) -> float:
    angle = _BANK if bank is None else real(bank, "bank")
    if not 0.0 < angle < np.pi / 2:
        raise ValueError(f"bank is {angle}; it must be between 0 and pi/2")
    return angle


def _turning(speed: float, turn_radius: float, rate: float) -> tuple[float, float]:
    """Return the bank angle and largest turn rate of turns with a given radius at a given speed."""
    radius = positive_number(turn_radius, "turn_radius")
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
        raise ValueError("start_time and times are both given; the first of times is the start")
    instants = finite(times, "times")
    if instants.shape != (len(places),):
        raise ValueError(f"times has shape {instants.shape}; it must be ({len(places)},)")
    instants = np.ascontiguousarray(instants)
    return float(instants[0]), _core.plan_speeds(places, instants, bank, rate)


def _levels(value: npt.ArrayLike, name: str) -> FloatArray:
    """Return heights, after checking them; nan where they are unknown."""
    array = samples(value, name)
    require_each(array, ~np.isinf(array), name, "a finite number, or nan")
    return array


def _each(check: Any, value: npt.ArrayLike, name: str, count: int) -> FloatArray:
    """Return `count` numbers, given as one number for all or as an array."""
    array = check(value, name)
    if array.shape not in {(), (count,)}:
        raise ValueError(f"{name} has shape {array.shape}; it must be ({count},)")
    numbers: FloatArray = np.broadcast_to(array, count).copy()
    return numbers


def _course(direction: FloatArray) -> float | FloatArray:
    """Return the courses of direction vectors, in [0, 2 pi)."""
    turned = np.mod(np.arctan2(direction[..., 0], direction[..., 1]), 2 * np.pi)
    # the modulus of a tiny negative angle rounds to 2 pi
    course: float | FloatArray = scalar_or_array(np.where(turned < 2 * np.pi, turned, 0.0))
    return course
