"""Motion of aircraft along routes: the arguments of the core, and the random numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tertia import _core
from tertia._arrays import FloatArray
from tertia.simulate._parameters import _root
from tertia.simulate._routes import Route

# metres per second and seconds: the slow variation of the speed
_SPEED_SIGMA, _SPEED_TIME = 0.7, 60.0
# seconds in which the navigation error changes
_NAVIGATION_TIME = 200.0
# random numbers that are drawn at once, and steps
_NUMBERS, _STEPS = 1_000_000, 256


@dataclass(frozen=True, slots=True)
class Pilots:
    """Properties of each flight: wind, speed error, bank angle, roll rate and largest turn rate."""

    wind: FloatArray
    speed_error: FloatArray
    bank: FloatArray
    roll: FloatArray
    turn_rate: FloatArray
    navigation: float


def fly(
    routes: Sequence[Route], pilots: Pilots, step: float, random: np.random.Generator
) -> dict[str, Any]:
    """Simulate flights from start to end of their routes, and return the columns of `Traffic`."""
    n = len(routes)
    navigation = _Wander(pilots.navigation, _NAVIGATION_TIME, step)
    variation = _Wander(_SPEED_SIGMA, _SPEED_TIME, step)
    columns = _table(routes)
    columns |= {"offset": navigation.start(n, random), "variation": variation.start(n, random)}
    columns["early"] = random.normal(0.0, pilots.navigation, columns["passing"].shape)
    names = ("wind", "speed_error", "bank", "roll", "turn_rate")
    columns |= {name: np.ascontiguousarray(getattr(pilots, name)) for name in names}
    flights = _core.Flights(columns, navigation.matrices, variation.matrices, step)
    steps = max(1, min(_STEPS, _NUMBERS // (4 * n)))
    while flights.is_flying:
        before = random.bit_generator.state
        used = flights.advance(random.standard_normal((steps, 2, 2, n)), None)
        if used < steps:
            # as if each step had drawn its own
            random.bit_generator.state = before
            random.standard_normal((used, 2, 2, n))
    count, numbers, turning, departure = flights.samples()
    found = ("position", "velocity", "turn_rate", "height", "left", "returned")
    samples = dict(zip(found, (*numbers, *departure), strict=True))
    return samples | {"count": count, "turning": turning}


def _table(routes: Sequence[Route]) -> dict[str, Any]:
    """Return routes as arrays of shape (F, M), padded by repeating the last waypoint."""
    sizes = np.array([len(route.waypoints) for route in routes])
    last = sizes - 1
    # the waypoint that stands at each place
    index = np.minimum(np.arange(int(np.max(sizes)) + 1), last[:, np.newaxis])
    index += (np.cumsum(sizes) - sizes)[:, np.newaxis]
    waypoints = np.concatenate([route.waypoints for route in routes])[index]
    speeds = [np.append(route.speeds, route.speeds[-1]) for route in routes]
    columns: dict[str, Any] = {
        "waypoints": waypoints,
        "speeds": np.concatenate(speeds)[index],
        "heights": np.concatenate([route.heights for route in routes])[index],
        "passing": np.concatenate([route.passing for route in routes])[index],
        "last": last,
        "leave": np.array([route.leave for route in routes]),
        "rejoin": np.array([route.rejoin for route in routes]),
    }
    # more than any flight takes: at half the speed, with a detour at every waypoint
    lengths = np.hypot(*np.moveaxis(np.diff(waypoints, axis=1), -1, 0))
    times = lengths / columns["speeds"][:, :-1]
    columns["longest"] = 2 * times.sum(axis=1) + 120.0 * (sizes + 1)
    return columns


class _Wander:
    """A normal random process with a correlation time; it is critically damped and has a rate."""

    def __init__(self, sigma: float, time: float, step: float) -> None:
        a, decay = step / time, np.exp(-step / time)
        transition = decay * np.array([[1 + a, step], [-a / time, 1 - a]])
        variance = sigma**2 * np.diag([1.0, time**-2])
        noise = variance - transition @ variance @ transition.T
        # of hardly more than rank one for a short step
        self.matrices = transition.tolist(), _root(noise).tolist()
        self._scale = np.array([sigma, sigma / time])

    def start(self, n: int, random: np.random.Generator) -> FloatArray:
        """Return the initial values and rates of n processes, (n, 2)."""
        return np.ascontiguousarray((self._scale[:, np.newaxis] * random.standard_normal((2, n))).T)
