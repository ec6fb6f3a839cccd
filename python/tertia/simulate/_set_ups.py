"""Radars of three kinds of airspace, with suitable routes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from tertia._arrays import BoolArray, FloatArray, IntArray, generator, integer
from tertia.flightplan import FlightPlan
from tertia.sensors import Radar
from tertia.simulate._parameters import _choice
from tertia.simulate._routes import GRAVITY

SetUpName: TypeAlias = Literal["tma", "middle", "en-route"]

# turns of a route, and their angles in radians
_TURNS = (2, 4)
_ANGLES = (np.radians(20.0), np.radians(110.0))
# scans of straight flight on every leg
_STRAIGHT = (15.0, 30.0)
# flight levels of a thousand feet
_LEVEL = 304.8
# the bank of a plan's turns
_BANK = np.radians(25.0)


@dataclass(frozen=True, slots=True, eq=False)
class SetUp:
    """A radar, and the properties of the traffic around it.

    Attributes
    ----------
    radar : Radar
        The radar, at the origin.
    distance : (float, float)
        Smallest and largest distance of routes from the radar in metres.
    speed : (float, float)
        Lowest and highest ground speed of plans in m/s.
    height : (float, float)
        Lowest and highest height of plans in metres.
    wind : float
        Largest wind speed in m/s, as for `flights`.
    """

    radar: Radar
    distance: tuple[float, float]
    speed: tuple[float, float]
    height: tuple[float, float]
    wind: float


def set_up(name: SetUpName) -> SetUp:
    """Return a radar and the properties of its traffic for one of three kinds of airspace.

    Parameters
    ----------
    name : str
        "tma": a terminal area, with a scan period of 4 s. "middle": a scan period of 6 s.
        "en-route": a scan period of 10 s.

    Returns
    -------
    SetUp
        The radar, and the distances, speeds, heights and wind of its traffic.

    Raises
    ------
    ValueError
        If the name is unknown.

    Examples
    --------
    >>> from tertia.simulate import set_up
    >>> set_up("tma").radar.scan_period, set_up("en-route").speed
    (4.0, (200.0, 250.0))
    """
    _choice(name, "name", tuple(_SET_UPS))
    return _SET_UPS[name]


def _radar(
    name: str, period: float, noise: tuple[float, float], seen: float, limit: float
) -> Radar:
    """Return the radar at the origin, with its noise given in metres and degrees."""
    return Radar(
        (0.0, 0.0),
        range_sigma=noise[0],
        azimuth_sigma=np.radians(noise[1]).item(),
        scan_period=period,
        max_range=limit,
        detection_probability=seen,
        name=name,
    )


# a radar sees farther than its routes reach: flights that leave them stay in view
_SET_UPS: dict[str, SetUp] = {
    "tma": SetUp(
        _radar("tma", 4.0, (50.0, 0.08), 0.95, 150e3),
        (15e3, 90e3),
        (110.0, 160.0),
        (1500.0, 4500.0),
        15.0,
    ),
    "middle": SetUp(
        _radar("middle", 6.0, (75.0, 0.10), 0.94, 280e3),
        (30e3, 200e3),
        (160.0, 200.0),
        (4000.0, 9000.0),
        30.0,
    ),
    "en-route": SetUp(
        _radar("en-route", 10.0, (100.0, 0.12), 0.92, 400e3),
        (60e3, 300e3),
        (200.0, 250.0),
        (8500.0, 12_500.0),
        50.0,
    ),
}


_find = set_up


def routes(
    set_up: SetUpName | SetUp, n: int, rng: np.random.Generator | int | None = None
) -> list[FlightPlan]:
    """Generate plans of random routes around a radar.

    Each route has two to four turns by 20 to 110 degrees to either side. Every leg is long enough
    for the arcs of its turns and for 15 to 30 scans of straight flight between these arcs. All
    points of the legs are within the distances of the set-up from the radar. Each route has one
    speed and one height; the identity is the number of the plan.

    Parameters
    ----------
    set_up : str or SetUp
        The name "tma", "middle" or "en-route", or a `SetUp` of your own.
    n : int
        Number of plans.
    rng : numpy.random.Generator or int, optional
        Random generator or its seed.

    Returns
    -------
    list of n FlightPlan
        The plans, all of which start at time 0.

    Raises
    ------
    ValueError, TypeError
        If the set-up is unknown, its distances leave no room for routes, or a parameter has the
        wrong type.

    Examples
    --------
    >>> from tertia.simulate import routes
    >>> plans = routes("middle", 3, rng=1)
    >>> [len(plan.waypoints) for plan in plans]
    [5, 5, 6]
    """
    scene = set_up if isinstance(set_up, SetUp) else _find(set_up)
    n, random = integer(n, "n", 0), generator(rng)
    plans: list[FlightPlan] = []
    for _ in range(_TRIES):
        points, sizes, speed = _draw(scene, _BATCH, random)
        inside = np.flatnonzero(_inside(scene, points, sizes))[: n - len(plans)]
        low, high = np.ceil(scene.height[0] / _LEVEL), np.floor(scene.height[1] / _LEVEL)
        levels = _LEVEL * random.integers(int(low), int(high) + 1, len(inside))
        for i, level in zip(inside, levels, strict=True):
            plans.append(
                FlightPlan(
                    points[i, : sizes[i]],
                    float(speed[i]),
                    heights=float(level),
                    bank=float(_BANK),
                    identity=len(plans),
                )
            )
        if len(plans) == n:
            return plans
    raise ValueError(
        f"set_up has distances {scene.distance} m; they leave no room for routes at "
        f"{scene.speed[0]:g} to {scene.speed[1]:g} m/s"
    )


# candidates drawn at once, and how often
_BATCH, _TRIES = 2000, 500


def _draw(
    scene: SetUp, n: int, random: np.random.Generator
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Return candidates for routes: waypoints (n, M, 2), how many each route has, and speeds."""
    turns = random.integers(_TURNS[0], _TURNS[1] + 1, n)
    legs = _TURNS[1] + 1
    speed = random.uniform(*scene.speed, n)
    angle = random.uniform(*_ANGLES, (n, legs - 1))
    radius = speed**2 / (GRAVITY * np.tan(_BANK))
    # metres that a turn takes of the legs before and behind it
    arc = radius[:, np.newaxis] * np.tan(angle / 2)
    arc[np.arange(1, legs) > turns[:, np.newaxis]] = 0.0
    scans = random.uniform(*_STRAIGHT, (n, legs))
    length = scans * scene.radar.scan_period * speed[:, np.newaxis]
    length[:, :-1] += arc
    length[:, 1:] += arc
    angle *= np.where(random.uniform(size=angle.shape) < 0.5, -1.0, 1.0)
    course = random.uniform(0.0, 2 * np.pi, (n, 1)) + np.cumsum(
        np.concatenate([np.zeros((n, 1)), angle], axis=1), axis=1
    )
    ways = length[..., np.newaxis] * np.stack([np.sin(course), np.cos(course)], axis=-1)
    near, far = scene.distance
    # uniform over the area
    distance = np.sqrt(random.uniform(near**2, far**2, n))
    azimuth = random.uniform(0.0, 2 * np.pi, n)
    start = distance[:, np.newaxis] * np.stack([np.sin(azimuth), np.cos(azimuth)], axis=-1)
    points = start[:, np.newaxis] + np.concatenate(
        [np.zeros((n, 1, 2)), np.cumsum(ways, axis=1)], axis=1
    )
    return points, turns + 2, speed


def _inside(scene: SetUp, points: FloatArray, sizes: IntArray) -> BoolArray:
    """Return whether all legs of a route are within the distances of the set-up."""
    first, way = points[:, :-1], np.diff(points, axis=1)
    share = -np.sum(first * way, axis=-1) / np.sum(way**2, axis=-1)
    nearest = first + np.clip(share, 0.0, 1.0)[..., np.newaxis] * way
    near, far = scene.distance
    good = np.hypot(*np.moveaxis(nearest, -1, 0)) >= near
    good &= np.hypot(*np.moveaxis(points[:, 1:], -1, 0)) <= far
    used = np.arange(points.shape[1] - 1) < sizes[:, np.newaxis] - 1
    keeps: BoolArray = np.all(good | ~used, axis=1)
    return keeps
