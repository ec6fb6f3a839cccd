"""How aircraft fly routes. East and north are the real and imaginary part of complex numbers.

A factor of exp(-1j a) turns clockwise by a, one of -1j to the right.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from tertia._arrays import FloatArray, IntArray
from tertia.simulate._routes import DIRECT, FLY_BY, GRAVITY, NEVER, Route
from tertia.simulate._traffic import NOWHERE, parts

ComplexArray: TypeAlias = npt.NDArray[np.complex128]

# metres per second squared: of the speed; metres per second: of the height
_ACCELERATION, _CLIMB = 0.5, 15.0
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
# sine of turns too small to begin them early; radii before a waypoint where a turn begins at most
_SMALL_TURN, _LEAD_MAX = 0.02, 4.0
# radians off the course to a waypoint at which the turn to it has ended; radii from a waypoint
# within which it is not headed for: it might be circled for ever
_BESIDE, _TOO_NEAR = np.radians(2.0), 2.5


@dataclass(frozen=True, slots=True)
class Pilots:
    """What differs among flights: wind, error of the speed, bank and roll, limit of turn rates."""

    wind: ComplexArray
    error: FloatArray
    bank: FloatArray
    roll: FloatArray
    turn_rate: FloatArray
    navigation: float


class Table:
    """Routes of different lengths in arrays of shape (F, M); the last waypoint is repeated."""

    def __init__(self, routes: Sequence[Route]) -> None:
        sizes = np.array([len(route.waypoints) for route in routes])
        self.last = sizes - 1
        longest = int(np.max(sizes)) + 1
        # the sample that stands at each place
        index = np.minimum(np.arange(longest), self.last[:, np.newaxis])
        index += (np.cumsum(sizes) - sizes)[:, np.newaxis]
        points = np.concatenate([route.waypoints for route in routes])[index]
        self.waypoints = points @ [1.0, 1.0j]
        speeds = [np.append(route.speeds, route.speeds[-1]) for route in routes]
        self.speeds = np.concatenate(speeds)[index]
        self.heights = np.concatenate([route.heights for route in routes])[index]
        self.passing = np.concatenate([route.passing for route in routes])[index]
        self.leave = np.array([route.leave for route in routes])
        self.rejoin = np.array([route.rejoin for route in routes])
        # more than any flight takes: at half the speed, with a detour at every waypoint
        times = np.abs(np.diff(self.waypoints)) / self.speeds[:, :-1]
        self.longest = 2 * times.sum(axis=1) + 120.0 * (sizes + 1)


class _Wander:
    """A normal process with a correlation time whose rate is a process too (critically damped)."""

    def __init__(
        self, sigma: float, time: float, n: int, *, step: float, random: np.random.Generator
    ) -> None:
        a, decay = step / time, np.exp(-step / time)
        self._transition = decay * np.array([[1 + a, step], [-a / time, 1 - a]])
        variance = sigma**2 * np.diag([1.0, time**-2])
        noise = variance - self._transition @ variance @ self._transition.T
        # of hardly more than rank one for a short step
        values, vectors = np.linalg.eigh(noise)
        self._root = vectors * np.sqrt(np.maximum(values, 0.0))
        self._random = random
        self._state = np.array([[sigma], [sigma / time]]) * random.standard_normal((2, n))

    def advance(self) -> None:
        """Go on by a step."""
        push = self._random.standard_normal(self._state.shape)
        self._state = self._transition @ self._state + self._root @ push

    @property
    def value(self) -> FloatArray:
        """The process now."""
        value: FloatArray = self._state[0]
        return value


class Motion:
    """The state of all flights, and one step of it.

    `leg` is the waypoint behind; the leg is the line through `origin` in the direction `along`.
    Where `homing`, it begins where the aircraft is, until the turn to the waypoint ahead has ended.
    """

    def __init__(
        self, table: Table, pilots: Pilots, step: float, random: np.random.Generator
    ) -> None:
        n = len(pilots.error)
        self._table, self._pilots, self._step = table, pilots, step
        self._everyone = np.arange(n)
        self._offset = _Wander(pilots.navigation, _NAVIGATION_TIME, n, step=step, random=random)
        self._variation = _Wander(_SPEED_SIGMA, _SPEED_TIME, n, step=step, random=random)
        self._early = random.normal(0.0, pilots.navigation, table.passing.shape)
        self._time = 0.0
        self.flying = np.ones(n, dtype=bool)
        self._leg = np.zeros(n, dtype=np.int64)
        self._origin = table.waypoints[:, 0].copy()
        self._along = _unit(table.waypoints[:, 1] - self._origin)
        self._homing = np.zeros(n, dtype=bool)
        self._steady = table.speeds[:, 0] + pilots.error
        self._speed = self._steady + self._variation.value
        # the largest tangent of the bank: the pilot's, or that of the largest rate of turn
        self._limit = np.zeros(n)
        self._limit_bank()
        self.bank, self.turn_rate = np.zeros(n), np.zeros(n)
        self.height = table.heights[:, 0].copy()
        # navigation takes the aircraft to be on the leg
        self.position = self._origin + 1j * self._along * self._offset.value
        self._heading = self._crab(self._along)
        self.velocity = self._speed * self._heading + pilots.wind
        self.left, self.returned = np.full(n, np.nan), np.full(n, np.nan)

    def _limit_bank(self) -> None:
        rate = self._pilots.turn_rate * self._speed / GRAVITY
        self._limit = np.minimum(np.tan(self._pilots.bank), rate)

    def _crab(self, course: ComplexArray) -> ComplexArray:
        """Return the headings that hold courses in the wind."""
        across = (self._pilots.wind * course.conj()).imag
        along = np.sqrt(self._speed**2 - across**2)
        heading: ComplexArray = course * (along - 1j * across) / self._speed
        return heading

    def advance(self) -> None:
        """Go on by a step."""
        step = self._step
        self._pass_waypoints()
        wanted, reach = self._wanted_bank(), self._pilots.roll * step
        bank = self.bank + np.clip(wanted - self.bank, -reach, reach)
        half = np.exp(-0.5j * step * GRAVITY / self._speed * np.tan((bank + self.bank) / 2))
        # along the chord of the step's arc
        self.position = self.position + step * (
            self._speed * self._heading * half + self._pilots.wind
        )
        self._heading = self._heading * half**2
        self.bank = bank
        self._change_speed()
        self._offset.advance()
        self._climb()
        self._time += step
        self.velocity = self._speed * self._heading + self._pilots.wind
        # that of the course over the ground, not of the heading
        lift = GRAVITY * np.tan(bank) * (self._heading * self.velocity.conj()).real
        self.turn_rate = lift / np.abs(self.velocity) ** 2
        self.flying &= self._time < self._table.longest

    def _change_speed(self) -> None:
        """Approach the speed of the leg."""
        target = self._table.speeds[self._everyone, self._leg] + self._pilots.error
        reach = _ACCELERATION * self._step
        self._steady += np.clip(target - self._steady, -reach, reach)
        self._variation.advance()
        self._speed = self._steady + self._variation.value
        self._limit_bank()

    def _climb(self) -> None:
        """Approach the height of the route."""
        table, who = self._table, self._everyone
        first, way = table.waypoints[who, self._leg], table.waypoints[who, self._leg + 1]
        way = way - first
        share = ((self.position - first) * way.conj()).real / np.maximum(np.abs(way) ** 2, 1.0)
        low, high = table.heights[who, self._leg], table.heights[who, self._leg + 1]
        wanted = low + np.clip(share, 0.0, 1.0) * (high - low)
        reach = _CLIMB * self._step
        self.height = self.height + np.clip(wanted - self.height, -reach, reach)

    def _pass_waypoints(self) -> None:
        """Take the next leg where the turn to it is due, and end where there is none."""
        table, who, ahead = self._table, self._everyone, self._leg + 1
        corner = table.waypoints[who, ahead]
        following = _unit(table.waypoints[who, np.minimum(ahead + 1, table.last)] - corner)
        ends, passing = ahead >= table.last, table.passing[who, ahead]
        lead = np.where((passing == FLY_BY) & ~ends, self._lead(following, ahead), 0.0)
        # a turn begins with a step: half a step early or late on average
        lead += self._step / 2 * (self.velocity * self._along.conj()).real
        due = ((corner - self.position) * self._along.conj()).real <= lead
        due &= self.flying & ~self._homing
        # a flight has two samples at least
        self.flying &= ~(due & ends) | (self._time == 0.0)
        due &= ~ends
        self._leg = self._leg + due
        self.left[due & (self._leg == table.leave)] = self._time
        direct = passing == DIRECT
        self._homing |= due & direct
        self._origin = np.where(due & ~direct, corner, self._origin)
        self._along = np.where(due & ~direct, following, self._along)
        self._look_for_plan()

    def _lead(self, following: ComplexArray, ahead: IntArray) -> FloatArray:
        """Return how far before a waypoint the turn to the following leg begins.

        The air turns the aircraft along an arc, and the wind carries that: the turn's end has to
        lie on the following leg. Half of the roll is lost on each side of the arc.
        """
        first, second = self._crab(self._along), self._crab(following)
        turn = -np.angle(second * first.conj())
        rate = GRAVITY * self._limit / self._speed
        radius = self._speed / rate
        way = -1j * np.sign(turn) * radius * (first - second)
        way += self._pilots.wind * np.abs(turn) / rate
        sine = (self._along.conj() * following).imag
        sharp = np.abs(sine) > _SMALL_TURN
        lead = (way.conj() * following).imag / np.where(sharp, sine, 1.0)
        roll = np.arctan(self._limit) / self._pilots.roll
        lead += roll / 2 * (self.velocity * self._along.conj()).real
        lead += self._early[self._everyone, ahead]
        clipped: FloatArray = np.where(sharp, np.clip(lead, 0.0, _LEAD_MAX * radius), 0.0)
        return clipped

    def _look_for_plan(self) -> None:
        """Note when a flight is back on its plan."""
        back = (self._leg >= self._table.rejoin) & (self._table.rejoin != NEVER) & self.flying
        back &= np.isnan(self.returned)
        if back.any():
            across = ((self.position - self._origin) * self._along.conj()).imag
            course = np.angle(self.velocity * self._along.conj())
            back &= (np.abs(across) < _ON_LEG) & (np.abs(course) < _ON_COURSE)
            self.returned[back] = self._time

    def _wanted_bank(self) -> FloatArray:
        """Return the bank that brings the aircraft to its leg, and holds it there."""
        self._home()
        speed, limit = self._speed, self._limit
        # to the right of the leg, as navigation has it
        across = self._offset.value - ((self.position - self._origin) * self._along.conj()).imag
        distance, ground = np.abs(across), np.abs(self.velocity)
        # the angle at which to meet the leg: in proportion, and so that the turn to it fits
        angle = np.minimum(distance / (ground * _LEG_TIME), _INTERCEPT)
        sharpest = np.sqrt(2 * distance * GRAVITY * limit) / ground
        angle = np.minimum(angle, _CAPTURE * sharpest)
        course = self._along * np.exp(1j * np.sign(across) * angle)
        error = -np.angle(self._crab(course) * self._heading.conj())
        size = np.abs(error)
        self._homing &= size > _BESIDE
        bank = np.arctan(np.minimum(size * speed / (_COURSE_TIME * GRAVITY), limit))
        # rolling out takes the heading no farther: g / (V roll) ln(1 / cos(bank))
        out = np.arccos(np.exp(-size * speed * self._pilots.roll / GRAVITY))
        wanted: FloatArray = np.sign(error) * np.minimum(bank, out)
        return wanted

    def _home(self) -> None:
        """Let the legs of those that head for a waypoint begin where they believe to be."""
        if not self._homing.any():
            return
        begin = self.position - 1j * self._along * self._offset.value
        way = self._table.waypoints[self._everyone, self._leg + 1] - begin
        self._origin = np.where(self._homing, begin, self._origin)
        self._along = np.where(self._homing, _unit(way), self._along)
        radius = self._speed**2 / (GRAVITY * self._limit)
        self._homing &= np.abs(way) > _TOO_NEAR * radius


def fly(motion: Motion) -> dict[str, npt.NDArray[Any]]:
    """Return the samples of the flights from start to end, each of shape (F, S, ...)."""
    names = ("flying", "turning", "position", "velocity", "turn_rate", "height")
    samples: dict[str, list[npt.NDArray[Any]]] = {name: [] for name in names}
    while motion.flying.any():
        flying = motion.flying.copy()
        samples["flying"].append(flying)
        samples["turning"].append(flying & (np.abs(motion.bank) > _TURNING))
        for name in ("position", "velocity"):
            samples[name].append(np.where(flying, getattr(motion, name), NOWHERE))
        for name in ("turn_rate", "height"):
            samples[name].append(np.where(flying, getattr(motion, name), np.nan))
        motion.advance()
    # one list after the other is released
    stacked = {name: np.stack(samples.pop(name), axis=1) for name in names}
    for name in ("position", "velocity"):
        stacked[name] = parts(stacked[name])
    return stacked


def _unit(vector: ComplexArray) -> ComplexArray:
    # the last waypoint has no leg
    unit: ComplexArray = vector / np.maximum(np.abs(vector), 1e-9)
    return unit
