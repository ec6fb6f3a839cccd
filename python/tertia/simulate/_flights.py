"""Flights along plans, or not, with the dynamics of aircraft."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, get_args

import numpy as np
import numpy.typing as npt

from tertia._arrays import BoolArray, FloatArray, IntArray, finite, generator
from tertia.flightplan import FlightPlan
from tertia.simulate._records import _number, _require
from tertia.simulate._routes import (
    DIRECT,
    FLY_BY,
    GRAVITY,
    NEVER,
    TURNS,
    FlightScenario,
    Route,
    build,
    right,
)
from tertia.simulate._traffic import Traffic, dense_traffic
from tertia.tracker import NO_IDENTITY

__all__ = ["flights"]

# radians per second: mean, standard deviation, and least of the rates of roll
_ROLL, _ROLL_SIGMA, _ROLL_MIN = np.radians([5.0, 1.0, 2.5])
_BANK_MIN, _BANK_MAX = np.radians([8.0, 45.0])
# of the speed: metres per second squared
_ACCELERATION = 0.5
_CLIMB = 15.0
# seconds and metres per second: the slow variation of the speed
_SPEED_TIME, _SPEED_SIGMA = 60.0, 0.7
# seconds in which the navigation error changes, a course is met, and a leg is met
_NAVIGATION_TIME, _COURSE_TIME, _LEG_TIME = 200.0, 3.0, 20.0
_INTERCEPT = np.radians(40.0)
# share of the sharpest course at which a leg can still be met without flying through it
_CAPTURE = 0.85
# radians: beyond, a bank is a turn
_TURNING = np.radians(5.0)
# back on the plan: metres and radians off it
_ON_LEG, _ON_COURSE = 500.0, np.radians(5.0)
# sine of turns too small to begin them early; radii at which a turn begins at the earliest
_SMALL_TURN, _LEAD_MAX = 0.02, 4.0
_BESIDE = np.radians(2.0)


def flights(
    plans: Sequence[FlightPlan],
    *,
    scenario: FlightScenario | Sequence[FlightScenario] = "conforming",
    wind: npt.ArrayLike = 0.0,
    bank: float = np.radians(23.0).item(),
    bank_sigma: float = np.radians(2.2).item(),
    navigation_sigma: float = 250.0,
    speed_error: float = 10.0,
    lasting: float = 300.0,
    step: float = 1.0,
    rng: np.random.Generator | int | None = None,
) -> Traffic:
    """Simulate aircraft that fly their plans, or leave them.

    Point masses that turn by banking, with a rate of roll, in a constant wind. Turns begin where
    the pilot estimates that they end on the next leg; legs are held against the wind and met again
    without oscillation. The wind is not planned: the airspeed is the plan's ground speed and an
    error.

    Parameters
    ----------
    plans : sequence of F FlightPlan
        The plans. A flight starts at the first waypoint at the plan's time.
    scenario : str or sequence of F str
        That of all flights, or of each.
        "conforming": the plan is flown.
        "speed": it is flown, from some place on 15 to 30 m/s faster or slower.
        "shortcut": from a place on a leg directly to a waypoint behind the next.
        "holding": one or two racetracks at a place on a leg, and on.
        "vectoring": 12 to 20 km off to one side, along the leg, and back to a waypoint.
        "hijack": at a place on a leg a turn by 45 to 150 degrees, and away.
        "straight-on": a turn is not flown.
        "wrong-turn": a turn to the other side, or by 30 to 60 degrees too much or too little.
        "fly-over": a turn begins at its waypoint, and not before.
    wind : array_like of shape (), (2,) or (F, 2)
        Velocity of the air to the east and to the north in metres per second, for all flights or
        each. A number: every flight has a wind of its own, its speed uniform between 0 and that
        number and its direction uniform.
    bank, bank_sigma : float
        Mean and standard deviation of the bank angle of turns in radians, normal among flights.
    navigation_sigma : float
        Standard deviation in metres of the slowly varying distance to the legs, and of where a turn
        begins against where it should.
    speed_error : float
        Largest error of the airspeed in metres per second, uniform among flights.
    lasting : float
        Seconds after which flights that never return to their plan end.
    step : float
        Seconds from sample to sample.
    rng : numpy.random.Generator or int, optional
        Source of randomness, or its seed.

    Returns
    -------
    Traffic
        A flight ends at the last waypoint of its route. In "conforming" and "speed" it never leaves
        its plan.

    Raises
    ------
    ValueError
        A scenario unknown, or about a turn where a plan has none; a plan with a leg shorter than a
        metre; a wind of more than half the speed; a parameter outside its domain.
    TypeError
        A parameter of the wrong type.

    Examples
    --------
    >>> import numpy as np
    >>> from tertia.flightplan import FlightPlan
    >>> from tertia.simulate import flights
    >>> plan = FlightPlan([[0, 0], [0, 50e3], [50e3, 50e3]], 200.0)
    >>> traffic = flights([plan], scenario="straight-on", wind=20.0, rng=1)
    >>> traffic
    Traffic(1 flights, 0 to 508 s)
    >>> bool(np.isnan(traffic.left[0])), bool(np.isnan(traffic.returned[0]))
    (False, True)
    """
    filed = _plans(plans)
    names = _scenarios(scenario, filed)
    random = generator(rng)
    h = _number(step, "step", 0.01, 5.0)
    period = _number(lasting, "lasting", 1.0, 1e6)
    routes = [build(p, s, period, random) for p, s in zip(filed, names, strict=True)]
    n = len(routes)
    error = _number(speed_error, "speed_error", 0.0, 50.0)
    mean = _number(bank, "bank", _BANK_MIN, _BANK_MAX)
    spread = _number(bank_sigma, "bank_sigma", 0.0, 1.0)
    pilots = _Pilots(
        wind=_winds(wind, filed, random),
        error=random.uniform(-error, error, n),
        bank=np.clip(random.normal(mean, spread, n), _BANK_MIN, _BANK_MAX),
        roll=np.maximum(random.normal(_ROLL, _ROLL_SIGMA, n), _ROLL_MIN),
        turn_rate=np.array([plan.turn_rate for plan in filed]),
        navigation=_number(navigation_sigma, "navigation_sigma", 0.0, 1e5),
    )
    if not n:
        return dense_traffic(0, duration=h, step=h)
    motion = _Motion(_Table(routes), pilots, h, random)
    samples, starts = _fly(motion), np.array([plan.start_time for plan in filed])
    return Traffic(
        start=starts,
        count=samples.pop("flying").sum(axis=1),
        step=h,
        **samples,
        identity=np.array([NO_IDENTITY if p.identity is None else p.identity for p in filed]),
        wind=pilots.wind,
        left=motion.left + starts,
        returned=motion.returned + starts,
        plans=filed,
    )


def _plans(plans: Sequence[FlightPlan]) -> tuple[FlightPlan, ...]:
    """Return the plans, all of them with legs."""
    filed = tuple(plans) if isinstance(plans, Sequence) else (plans,)
    for i, plan in enumerate(filed):
        if not isinstance(plan, FlightPlan):
            raise TypeError(f"plans[{i}] is {plan!r}; it must be a FlightPlan")
        short = np.flatnonzero(np.hypot(*np.diff(plan.waypoints, axis=0).T) < 1.0)
        if len(short):
            raise ValueError(
                f"plans[{i}] has waypoints {short[0]} and {short[0] + 1} at one place; "
                "legs must be longer than a metre"
            )
    return filed


def _scenarios(scenario: Any, plans: Sequence[FlightPlan]) -> list[FlightScenario]:
    """Return the scenario of each flight."""
    names = [scenario] * len(plans) if isinstance(scenario, str) else list(scenario)
    _require(len(names) == len(plans), "scenario", scenario, f"one, or one of {len(plans)} each")
    known = get_args(FlightScenario)
    for i, (name, plan) in enumerate(zip(names, plans, strict=True)):
        _require(name in known, "scenario", name, f"one of {', '.join(known)}")
        if name in TURNS and len(plan.waypoints) < 3:
            raise ValueError(f"plans[{i}] has no turn; the scenario {name!r} needs one")
    return names


def _winds(wind: Any, plans: Sequence[FlightPlan], random: np.random.Generator) -> FloatArray:
    """Return the wind of each flight."""
    n = len(plans)
    given = finite(wind, "wind")
    if given.shape == ():
        speed = random.uniform(0.0, _number(wind, "wind", 0.0), n)
        angle = random.uniform(0.0, 2 * np.pi, n)
        given = speed[:, np.newaxis] * np.stack([np.sin(angle), np.cos(angle)], axis=-1)
    _require(given.shape in {(2,), (n, 2)}, "wind", given.shape, f"of shape (), (2,) or ({n}, 2)")
    winds = np.broadcast_to(given, (n, 2)).copy()
    limits = np.array([np.min(plan.speeds) / 2 for plan in plans])
    for i in np.flatnonzero(np.hypot(*winds.T) > limits)[:1]:
        raise ValueError(
            f"wind of flight {i} is {np.hypot(*winds[i]):g} m/s; it must not be above half its "
            f"speed, {limits[i]:g} m/s"
        )
    return winds


@dataclass(frozen=True, slots=True)
class _Pilots:
    """What differs among flights: all of shape (F,), wind (F, 2)."""

    wind: FloatArray
    error: FloatArray
    bank: FloatArray
    roll: FloatArray
    turn_rate: FloatArray
    navigation: float


class _Table:
    """Routes of different lengths in arrays of shape (F, M); the last waypoint is repeated."""

    def __init__(self, routes: Sequence[Route]) -> None:
        n = len(routes)
        sizes = np.array([len(route.waypoints) for route in routes], dtype=np.int64)
        longest = int(np.max(sizes, initial=2)) + 1
        self.last = sizes - 1
        self.waypoints = np.zeros((n, longest, 2))
        self.speeds, self.heights = np.zeros((n, longest)), np.zeros((n, longest))
        self.passing = np.full((n, longest), FLY_BY)
        for i, route in enumerate(routes):
            m = len(route.waypoints)
            self.waypoints[i, :m], self.waypoints[i, m:] = route.waypoints, route.waypoints[-1]
            self.speeds[i, : m - 1], self.speeds[i, m - 1 :] = route.speeds, route.speeds[-1]
            self.heights[i, :m], self.heights[i, m:] = route.heights, route.heights[-1]
            self.passing[i, :m] = route.passing
        self.leave = np.array([route.leave for route in routes], dtype=np.int64)
        self.rejoin = np.array([route.rejoin for route in routes], dtype=np.int64)
        ways = np.hypot(*np.moveaxis(np.diff(self.waypoints, axis=1), -1, 0))
        # more than any flight takes: half the speed, and a detour at every waypoint
        self.longest = 2 * (ways / np.maximum(self.speeds[:, :-1], 1.0)).sum(axis=1) + 120.0 * (
            sizes + 1
        )


class _Wander:
    """A normal process with a correlation time whose rate is a process too (critically damped)."""

    def __init__(
        self, sigma: float, time: float, n: int, h: float, random: np.random.Generator
    ) -> None:
        a, decay = h / time, np.exp(-h / time)
        self._transition = decay * np.array([[1 + a, h], [-a / time, 1 - a]])
        variance = sigma**2 * np.diag([1.0, time**-2])
        noise = variance - self._transition @ variance @ self._transition.T
        # of the rank that the step leaves: tiny for short ones
        values, vectors = np.linalg.eigh(noise)
        self._root = vectors * np.sqrt(np.maximum(values, 0.0))
        self._random = random
        self._state = random.standard_normal((n, 2)) * [sigma, sigma / time]

    def advance(self) -> None:
        """Go on by a step."""
        push = self._random.standard_normal(self._state.shape) @ self._root.T
        self._state = self._state @ self._transition.T + push

    @property
    def value(self) -> FloatArray:
        """The process now."""
        return self._state[:, 0]

    @property
    def rate(self) -> FloatArray:
        """Its derivative."""
        return self._state[:, 1]


class _Motion:
    """The state of all flights, and one step of it.

    Headings and courses are clockwise from north. `leg` is the waypoint behind; its line goes
    through `origin` in the direction `along`. Where `homing`, the line is that from where the
    aircraft is to the waypoint ahead, until the turn to it ends.
    """

    def __init__(
        self, table: _Table, pilots: _Pilots, h: float, random: np.random.Generator
    ) -> None:
        n = len(pilots.error)
        self._table, self._pilots, self._h = table, pilots, h
        self._everyone = np.arange(n)
        self._offset = _Wander(pilots.navigation, _NAVIGATION_TIME, n, h, random)
        self._variation = _Wander(_SPEED_SIGMA, _SPEED_TIME, n, h, random)
        self._early = random.normal(0.0, pilots.navigation, table.passing.shape)
        self.time = 0.0
        self.flying = np.ones(n, dtype=bool)
        self.leg = np.zeros(n, dtype=np.int64)
        self.origin = table.waypoints[:, 0].copy()
        self.along = _unit(table.waypoints[:, 1] - self.origin)
        self._homing = np.zeros(n, dtype=bool)
        self._steady = table.speeds[:, 0] + pilots.error
        self.bank, self.turn_rate = np.zeros(n), np.zeros(n)
        self.height = table.heights[:, 0].copy()
        self.position = self.origin - self._offset.value[:, np.newaxis] * right(self.along)
        self.heading = self._crab(_compass(self.along))
        self.velocity = self._ground(self.heading)
        self.left, self.returned = np.full(n, np.nan), np.full(n, np.nan)

    @property
    def _speed(self) -> FloatArray:
        """Airspeed."""
        return self._steady + self._variation.value

    def _ground(self, heading: FloatArray) -> FloatArray:
        """Return velocities over the ground."""
        return self._speed[:, np.newaxis] * _vector(heading) + self._pilots.wind

    def _crab(self, course: FloatArray) -> FloatArray:
        """Return the headings that hold courses in the wind."""
        across = np.sum(self._pilots.wind * right(_vector(course)), axis=-1)
        return course - np.arcsin(across / self._speed)

    def _tangent(self) -> FloatArray:
        """Return the tangent of the bank in turns: that of the pilot, or of the rate limit."""
        limit = self._pilots.turn_rate * self._speed / GRAVITY
        return np.minimum(np.tan(self._pilots.bank), limit)

    def advance(self) -> None:
        """Go on by a step."""
        self._pass_waypoints()
        wanted = self._wanted_bank()
        reach = self._pilots.roll * self._h
        bank = self.bank + np.clip(wanted - self.bank, -reach, reach)
        turn = GRAVITY * np.tan((bank + self.bank) / 2) / self._speed * self._h
        # along the chord of the step's arc
        chord = self._ground(self.heading + turn / 2)
        self.position = self.position + self._h * chord
        self.heading = self.heading + turn
        self.bank = bank
        target = self._table.speeds[self._everyone, self.leg] + self._pilots.error
        self._steady += np.clip(
            target - self._steady, -_ACCELERATION * self._h, _ACCELERATION * self._h
        )
        self._offset.advance()
        self._variation.advance()
        self._climb()
        self.time += self._h
        self.velocity = self._ground(self.heading)
        # of the course over the ground
        rate = GRAVITY * np.tan(self.bank) / self._speed
        push = (self._speed * rate)[:, np.newaxis] * right(_vector(self.heading))
        lift = np.sum(push * right(self.velocity), axis=-1)
        self.turn_rate = lift / np.sum(self.velocity**2, axis=-1)
        self.flying &= self.time < self._table.longest

    def _pass_waypoints(self) -> None:
        """Take the next leg where the turn to it is due, and end where there is none."""
        table, who = self._table, self._everyone
        ahead = table.waypoints[who, self.leg + 1]
        following = table.waypoints[who, np.minimum(self.leg + 2, table.last)]
        togo = np.sum((ahead - self.position) * self.along, axis=-1)
        ends = self.leg + 1 >= table.last
        passing = table.passing[who, self.leg + 1]
        early = (passing == FLY_BY) & ~ends
        lead = np.where(early, self._lead(_unit(following - ahead)), 0.0)
        lead += np.where(early & (lead > 0.0), self._early[who, self.leg + 1], 0.0)
        due = self.flying & ~self._homing
        # the step in which it is due begins half a step early on average
        half = self._h / 2 * np.sum(self.velocity * self.along, axis=-1)
        due &= togo <= np.maximum(lead, 0.0) + half
        # a flight has two samples at least
        self.flying &= ~(due & ends) | (self.time == 0.0)
        self._take_leg(due & ~ends, ahead, following, passing)
        self._look_for_plan()

    def _take_leg(
        self, due: BoolArray, ahead: FloatArray, following: FloatArray, passing: IntArray
    ) -> None:
        self.leg = self.leg + due
        self.left[due & (self.leg == self._table.leave)] = self.time
        fixed = due & (passing != DIRECT)
        self.origin[fixed] = ahead[fixed]
        self.along[fixed] = _unit(following - ahead)[fixed]
        self._homing |= due & (passing == DIRECT)

    def _look_for_plan(self) -> None:
        """Note when a flight is back on its plan."""
        back = np.isnan(self.returned) & (self._table.rejoin != NEVER) & self.flying
        back &= (self.leg >= self._table.rejoin) & ~np.isnan(self.left)
        across = np.sum((self.position - self.origin) * right(self.along), axis=-1)
        off = _wrapped(_compass(self.velocity) - _compass(self.along))
        back &= (np.abs(across) < _ON_LEG) & (np.abs(off) < _ON_COURSE)
        self.returned[back] = self.time

    def _lead(self, following: FloatArray) -> FloatArray:
        """Return how far before a waypoint the turn to the following leg begins.

        The air turns the aircraft along an arc, the wind carries that: the turn's end lies on the
        following leg.
        """
        first = self._crab(_compass(self.along))
        second = self._crab(_compass(following))
        turn = _wrapped(second - first)
        speed = self._speed
        rate = GRAVITY * self._tangent() / speed
        radius = speed / rate
        arc = (np.sign(turn) * radius)[:, np.newaxis] * (
            right(_vector(first)) - right(_vector(second))
        )
        arc += self._pilots.wind * (np.abs(turn) / rate)[:, np.newaxis]
        sine = _cross(self.along, following)
        sharp = np.abs(sine) > _SMALL_TURN
        way = np.where(sharp, _cross(arc, following) / np.where(sharp, sine, 1.0), 0.0)
        # half of the roll is lost on each side of the arc
        roll = np.arctan(self._tangent()) / self._pilots.roll / 2
        way += np.where(sharp, roll * np.sum(self.velocity * self.along, axis=-1), 0.0)
        return np.clip(way, 0.0, _LEAD_MAX * radius)

    def _wanted_bank(self) -> FloatArray:
        """Return the bank that brings the aircraft to its leg, and holds it there."""
        offset = self._offset.value
        self._home(offset)
        speed, limit = self._speed, self._tangent()
        across = np.sum((self.position - self.origin) * right(self.along), axis=-1) + offset
        distance = np.abs(across)
        ground = np.hypot(*self.velocity.T)
        radius = ground**2 / (GRAVITY * limit)
        # the course that meets the leg: in proportion, and so that the turn to the leg fits
        angle = np.minimum(
            distance / (ground * _LEG_TIME), _CAPTURE * np.sqrt(2 * distance / radius)
        )
        course = _compass(self.along) - np.sign(across) * np.minimum(angle, _INTERCEPT)
        error = _wrapped(self._crab(course) - self.heading)
        self._homing &= np.abs(error) > _BESIDE
        size = np.abs(error)
        tangent = np.minimum(size * speed / (_COURSE_TIME * GRAVITY), limit)
        # rolling out must not take the heading beyond
        out = np.arccos(np.exp(-size * speed * self._pilots.roll / GRAVITY))
        return np.sign(error) * np.minimum(np.arctan(tangent), out)

    def _home(self, offset: FloatArray) -> None:
        """Draw the line of those that head for a waypoint from where they believe to be."""
        who = self._homing
        if not who.any():
            return
        ahead = self._table.waypoints[self._everyone, self.leg + 1][who]
        self.origin[who] = self.position[who] + offset[who, np.newaxis] * right(self.along[who])
        way = ahead - self.origin[who]
        self.along[who] = _unit(way)
        speed = self._speed[who]
        near = 2.5 * speed**2 / (GRAVITY * self._tangent()[who])
        # within the circle of its turn, a waypoint would be circled for ever
        self._homing[who] = np.hypot(*way.T) > near

    def _climb(self) -> None:
        """Follow the heights of the route."""
        table, who = self._table, self._everyone
        first, second = table.waypoints[who, self.leg], table.waypoints[who, self.leg + 1]
        way = second - first
        share = np.sum((self.position - first) * way, axis=-1) / np.maximum(
            np.sum(way**2, axis=-1), 1.0
        )
        low, high = table.heights[who, self.leg], table.heights[who, self.leg + 1]
        wanted = low + np.clip(share, 0.0, 1.0) * (high - low)
        reach = _CLIMB * self._h
        self.height = self.height + np.clip(wanted - self.height, -reach, reach)


def _fly(motion: _Motion) -> dict[str, npt.NDArray[Any]]:
    """Return the samples of the flights from start to end, each of shape (F, S, ...)."""
    samples: dict[str, list[npt.NDArray[Any]]] = {
        name: [] for name in ("flying", "turning", "position", "velocity", "turn_rate", "height")
    }
    while motion.flying.any():
        flying = motion.flying.copy()
        samples["flying"].append(flying)
        samples["turning"].append(flying & (np.abs(motion.bank) > _TURNING))
        for name in ("position", "velocity"):
            samples[name].append(np.where(flying[:, np.newaxis], getattr(motion, name), np.nan))
        for name in ("turn_rate", "height"):
            samples[name].append(np.where(flying, getattr(motion, name), np.nan))
        motion.advance()
    # one list after the other is released
    return {name: np.stack(samples.pop(name), axis=1) for name in tuple(samples)}


def _unit(vector: FloatArray) -> FloatArray:
    length = np.sqrt(np.sum(vector**2, axis=-1, keepdims=True))
    return vector / np.maximum(length, 1e-9)


def _vector(course: FloatArray) -> FloatArray:
    return np.stack([np.sin(course), np.cos(course)], axis=-1)


def _compass(vector: FloatArray) -> FloatArray:
    angle: FloatArray = np.arctan2(vector[..., 0], vector[..., 1])
    return angle


def _cross(first: FloatArray, second: FloatArray) -> FloatArray:
    cross: FloatArray = first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]
    return cross


def _wrapped(angle: FloatArray) -> FloatArray:
    return (angle + np.pi) % (2 * np.pi) - np.pi
