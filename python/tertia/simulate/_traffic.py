"""Simulated air traffic: the motion of aircraft over time."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
import numpy.typing as npt

from tertia import _core
from tertia._arrays import BoolArray, FloatArray, IntArray, finite, generator, integer, samples
from tertia.flightplan import FlightPlan
from tertia.simulate._parameters import _choice, _number, _pair, _require

EncounterName: TypeAlias = Literal["crossing", "formation", "in-trail"]

# five nautical miles
_SPACING = 9260.0
# rates of turn of airliners, radians per second
_TURN_RATES = (np.radians(0.75), np.radians(3.0))
_HEIGHTS = (3000.0, 12_000.0)


@dataclass(frozen=True, slots=True, eq=False)
class Traffic:
    """The motion of aircraft over time, sampled at equal steps.

    Sample k of flight i is at time `start[i] + k * step`. Flights end at different times; samples
    after the end of a flight are nan, or False in `turning`.

    Attributes
    ----------
    start : ndarray of shape (F,)
        Time of the first sample in seconds.
    count : ndarray of int, shape (F,)
        Number of samples, at least two.
    step : float
        Seconds between samples.
    position : ndarray of shape (F, S, 2)
        East and north in metres.
    velocity : ndarray of shape (F, S, 2)
        Velocity over the ground, east and north, in m/s.
    turn_rate : ndarray of shape (F, S)
        Rate of change of the course over the ground in radians per second, positive clockwise.
    turning : ndarray of bool, shape (F, S)
        Whether the aircraft is turning, which means that its bank angle exceeds 5 degrees.
    height : ndarray of shape (F, S)
        Height in metres; nan if flights have no heights.
    identity : ndarray of int, shape (F,)
        Reply of the transponder; -1 if there is none.
    wind : ndarray of shape (F, 2)
        Velocity of the air, east and north, in m/s.
    left, returned : ndarray of shape (F,)
        Times in seconds at which the flight leaves its plan and at which it returns to it; nan if
        it never does.
    plans : tuple of FlightPlan
        The plans; empty if aircraft fly without plans.
    """

    start: FloatArray
    count: IntArray
    step: float
    position: FloatArray
    velocity: FloatArray
    turn_rate: FloatArray
    turning: BoolArray
    height: FloatArray
    identity: IntArray
    wind: FloatArray
    left: FloatArray
    returned: FloatArray
    plans: tuple[FlightPlan, ...] = ()

    def __len__(self) -> int:
        """Return the number of flights."""
        return len(self.start)

    def __repr__(self) -> str:
        """Return the number of flights, and when the first starts and the last ends, as text."""
        if not len(self):
            return "Traffic(0 flights)"
        return f"Traffic({len(self)} flights, {np.min(self.start):g} to {np.max(self.end):g} s)"

    def __getitem__(self, index: slice | IntArray | BoolArray) -> Traffic:
        """Return the flights of a slice, a mask or indices."""
        chosen = np.arange(len(self))[index]
        if chosen.ndim != 1:
            raise TypeError(f"index is {index!r}; it must be a slice or an array of flights")
        plans = tuple(self.plans[i] for i in chosen) if self.plans else ()
        columns = (name for name in self.__slots__ if name not in ("step", "plans"))
        return replace(self, plans=plans, **{name: getattr(self, name)[chosen] for name in columns})

    @property
    def end(self) -> FloatArray:
        """Time of the last sample of each flight in seconds."""
        return self.start + (self.count - 1) * self.step

    @property
    def time(self) -> FloatArray:
        """Time of every sample in seconds, of shape (F, S); nan after the end of a flight."""
        sample = np.arange(self.position.shape[1])
        time = self.start[:, np.newaxis] + self.step * sample
        return np.where(sample < self.count[:, np.newaxis], time, np.nan)

    def at(self, flight: npt.ArrayLike, time: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return the positions and velocities of flights at given times.

        The result is a cubic interpolation between the positions and velocities of the samples.

        Parameters
        ----------
        flight : array_like of int, shape (...)
            Indices of the flights.
        time : array_like of shape (...)
            Times in seconds.

        Returns
        -------
        position, velocity : ndarray of shape (..., 2)
            East and north, in metres and m/s; nan before the start and after the end of a flight.

        Raises
        ------
        IndexError
            If there is no such flight.
        ValueError
            If shapes do not fit.
        TypeError
            If indices of flights are not integers.

        Examples
        --------
        >>> from tertia.simulate import encounter
        >>> crossing = encounter("crossing", rng=1)
        >>> position, velocity = crossing.at([0, 1], crossing.start + 300.0)
        >>> (position[1] - position[0]).round(3)
        array([0., 0.])
        """
        flights, times = self._flights(flight), samples(time, "time")
        try:
            who, when = np.broadcast_arrays(flights, times)
        except ValueError:
            raise ValueError(
                f"time has shape {times.shape}; it must fit flight, {flights.shape}"
            ) from None
        inside = (when >= self.start[who]) & (when <= self.end[who])
        position, velocity, _ = self._state(who.reshape(-1), when.reshape(-1))
        shape = (*when.shape, 2)
        position, velocity = (
            np.where(inside.reshape(-1, 1), values, np.nan).reshape(shape)
            for values in (position, velocity)
        )
        return position, velocity

    def _state(
        self, flight: IntArray, time: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return position, velocity and height at given times, even outside the flights."""
        if not len(flight):
            return np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0)
        flight, time = np.ascontiguousarray(flight), np.ascontiguousarray(time)
        position, velocity, height = _core.traffic_states(self._columns(), flight, time)
        return position, velocity, height

    def _columns(self) -> dict[str, Any]:
        """Return the columns in the form that the core requires."""
        names = ("start", "count", "position", "velocity", "height")
        columns = {name: np.ascontiguousarray(getattr(self, name)) for name in names}
        return columns | {"step": self.step}

    def _flights(self, flight: npt.ArrayLike) -> IntArray:
        """Return indices of flights; negative indices count from the end."""
        who = np.asarray(flight)
        if who.dtype.kind not in "iu":
            raise TypeError(f"flight has dtype {who.dtype}; it must hold integers")
        n = len(self)
        if np.any((who < -n) | (who >= n)):
            raise IndexError(f"flight must be between {-n} and {n - 1}")
        return np.where(who < 0, who + n, who).astype(np.int64)


def dense_traffic(
    n: int,
    *,
    area: tuple[float, float] = (400e3, 400e3),
    speed: tuple[float, float] = (100.0, 250.0),
    turning_share: float = 0.2,
    duration: float = 300.0,
    step: float = 2.0,
    rng: np.random.Generator | int | None = None,
) -> Traffic:
    """Simulate many aircraft quickly; some make one turn, and the others fly straight.

    At half of the duration, positions are uniformly distributed over a rectangle about the origin.
    Courses, speeds and heights (3 to 12 km) are uniformly distributed, too. A turn has a constant
    rate of 0.75 to 3 degrees per second, changes the course by 20 to 110 degrees, and begins at a
    uniformly distributed time.

    Parameters
    ----------
    n : int
        Number of aircraft.
    area : (float, float)
        Extents of the rectangle in the directions east and north, in metres.
    speed : (float, float)
        Lowest and highest speed in m/s.
    turning_share : float
        Probability that an aircraft turns.
    duration, step : float
        Time in seconds from the first to the last sample, and between successive samples.
    rng : numpy.random.Generator or int, optional
        Random generator or its seed.

    Returns
    -------
    Traffic
        The flights, all of which start at time 0. The identity is the index of the aircraft.

    Raises
    ------
    ValueError, TypeError
        If a parameter is outside its domain or has the wrong type, or the lowest speed is above the
        highest.

    Examples
    --------
    >>> from tertia.simulate import dense_traffic
    >>> dense_traffic(1000, rng=1)
    Traffic(1000 flights, 0 to 300 s)
    """
    n, random = integer(n, "n", 0), generator(rng)
    extent = np.array([_number(v, "area", 0.0) for v in _pair(area, "area")])
    low, high = (_number(v, "speed", 1.0) for v in _pair(speed, "speed"))
    _require(low <= high, "speed", speed, "a pair (lowest, highest)")
    share = _number(turning_share, "turning_share", 0.0, 1.0)
    time = _grid(duration, step)
    velocity = random.uniform(low, high, n) * np.exp(2j * np.pi * random.uniform(size=n))
    rate = random.uniform(*_TURN_RATES, n) * np.where(random.uniform(size=n) < 0.5, -1.0, 1.0)
    length = np.radians(random.uniform(20.0, 110.0, n)) / np.abs(rate)
    turns = random.uniform(size=n) < share
    begin = np.where(turns, random.uniform(0.0, time[-1], n), np.inf)
    middle = (random.uniform(-0.5, 0.5, (n, 2)) * extent) @ [1.0, 1.0j]
    height = random.uniform(*_HEIGHTS, n)
    turn = (rate, begin, begin + length)
    return _smooth_flights(middle, velocity, time, turn=turn, height=height)


def encounter(
    name: EncounterName,
    *,
    n: int = 2,
    speed: float = 200.0,
    spacing: float = _SPACING,
    angle: float = np.radians(15.0).item(),
    middle: npt.ArrayLike = (0.0, 100e3),
    course: float = np.radians(90.0).item(),
    height: float = 10_000.0,
    duration: float = 600.0,
    step: float = 2.0,
    rng: np.random.Generator | int | None = None,
) -> Traffic:
    """Simulate straight flights that are difficult to distinguish.

    Parameters
    ----------
    name : str
        "crossing": all aircraft are at the same position at half of the duration, and the courses
        of neighbours differ by `angle`.
        "formation": the aircraft fly side by side, `spacing` apart.
        "in-trail": the aircraft fly one behind the other, `spacing` apart.
    n : int
        Number of aircraft.
    speed : float
        Speed in m/s.
    spacing : float
        Distance between neighbouring aircraft in metres; by default five nautical miles.
    angle : float
        Angle between the courses of neighbouring aircraft in "crossing", in radians.
    middle : array_like of shape (2,)
        Mean position of the aircraft at half of the duration, east and north in metres.
    course : float
        Mean course in radians, clockwise from north.
    height : float
        Height in metres, the same for all aircraft.
    duration, step : float
        As for `dense_traffic`.
    rng : numpy.random.Generator or int, optional
        Random generator or its seed; aircraft are numbered in random order.

    Returns
    -------
    Traffic
        The flights, as for `dense_traffic`.

    Raises
    ------
    ValueError, TypeError
        If the encounter is unknown, or a parameter is outside its domain or has the wrong type.

    Examples
    --------
    >>> from tertia.simulate import encounter
    >>> formation = encounter("formation", n=3, rng=1)
    >>> formation
    Traffic(3 flights, 0 to 600 s)
    """
    _choice(name, "name", get_args(EncounterName))
    n, random = integer(n, "n", 0), generator(rng)
    centre = finite(middle, "middle")
    _require(centre.shape == (2,), "middle", centre.shape, "of shape (2,)")
    place = random.permutation(n) - (n - 1) / 2
    direction = _number(course, "course") + np.zeros(n)
    if name == "crossing":
        direction += _number(angle, "angle") * place
    along = 1j * np.exp(-1j * direction)
    side = {"crossing": 0.0, "formation": -1.0j, "in-trail": -1.0}[name]
    spots = centre @ [1.0, 1.0j] + _number(spacing, "spacing", 0.0) * side * place * along
    never = np.full(n, np.inf)
    velocity = _number(speed, "speed", 1.0) * along
    levels = np.full(n, _number(height, "height"))
    time = _grid(duration, step)
    return _smooth_flights(spots, velocity, time, turn=(np.zeros(n), never, never), height=levels)


def _grid(duration: float, step: float) -> FloatArray:
    """Return the times of the samples from 0 to at least the duration."""
    h = _number(step, "step", 1e-3)
    length = _number(duration, "duration", 1e-3)
    _require(length / h < 1e7, "duration", duration, "below ten million steps")
    _require(length / h >= 1e-6, "step", step, "at most a million times the duration")
    return h * np.arange(np.ceil(length / h - 1e-9) + 1, dtype=np.float64)


def _smooth_flights(
    middle: npt.NDArray[np.complex128],
    velocity: npt.NDArray[np.complex128],
    time: FloatArray,
    *,
    turn: tuple[FloatArray, FloatArray, FloatArray],
    height: FloatArray,
) -> Traffic:
    """Return flights with at most one turn each; east and north are real and imaginary parts.

    `velocity` is the velocity before the turn, and `middle` is the position at half of the
    duration. A turn has a clockwise rate, a beginning and an end. For a flight without a turn, the
    beginning is infinite.
    """
    rate, begin, end = turn
    end_time = time[-1]
    # the last one is the middle
    time = np.append(time, end_time / 2)
    start = np.minimum(begin, end_time)[:, np.newaxis]
    length = np.minimum(end, end_time)[:, np.newaxis] - start
    # of the course, clockwise: the argument of a velocity falls
    w = np.where(rate == 0.0, 1.0, rate)[:, np.newaxis]
    turned = np.clip(time - start, 0.0, length)
    now = velocity[:, np.newaxis] * np.exp(-1j * w * turned)
    # where it is, from its place at the beginning of the turn
    way = (velocity[:, np.newaxis] - now) / (1j * w) + now * (time - start - turned)
    place = middle[:, np.newaxis] + way[:, :-1] - way[:, -1:]
    now, time, turned = now[:, :-1], time[:-1], turned[:, :-1]
    turning = (turned > 0.0) & (turned < length)
    n = len(middle)
    never = np.full(n, np.nan)
    return Traffic(
        np.zeros(n),
        np.full(n, len(time)),
        float(time[1] - time[0]),
        parts(place),
        parts(now),
        np.where(turning, w, 0.0),
        turning,
        np.repeat(height[:, np.newaxis], len(time), axis=1),
        np.arange(n),
        np.zeros((n, 2)),
        never,
        never.copy(),
    )


def parts(array: npt.NDArray[np.complex128]) -> FloatArray:
    """Return real and imaginary parts on a new last axis."""
    return np.ascontiguousarray(array)[..., np.newaxis].view(np.float64)
