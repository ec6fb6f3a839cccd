"""Simulated flights that follow or leave their plans, with the dynamics of aircraft."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, get_args

import numpy as np
import numpy.typing as npt

from tertia._arrays import FloatArray, finite, generator, listed, sequence_of
from tertia.flightplan import FlightPlan
from tertia.simulate._motion import Pilots, fly
from tertia.simulate._parameters import _choice, _number, _require
from tertia.simulate._routes import TURNS, FlightScenario, build
from tertia.simulate._traffic import Traffic, dense_traffic
from tertia.tracker import NO_IDENTITY

# rate of roll in radians per second: mean, standard deviation, minimum
_ROLL, _ROLL_SIGMA, _ROLL_MIN = np.radians([5.0, 1.0, 2.5])
_BANK_MIN, _BANK_MAX = np.radians([8.0, 45.0])
# metres per second; share of the airspeed up to which legs can be held against the wind
_SPEED_MIN, _WIND_MAX = 30.0, 0.4


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
    """Simulate aircraft that follow or leave their plans.

    Aircraft are point masses that turn by banking, with a limited roll rate, in a constant wind. A
    pilot begins each turn at a point from which the turn is expected to end on the next leg. On a
    leg, the heading is corrected for the wind, and the leg is intercepted without oscillation.
    Plans do not account for the wind. The airspeed is the planned ground speed plus an error.

    Parameters
    ----------
    plans : sequence of F FlightPlan
        The plans, one for each flight. A flight starts at the first waypoint of its plan, at the
        start time of the plan.
    scenario : str or sequence of F str
        One scenario for all flights, or one for each.
        "conforming": the flight follows its plan.
        "speed": the flight follows its plan, but is 15 to 30 m/s faster or slower from some point
        on.
        "shortcut": from a point on a leg, the flight goes directly to a waypoint after the next.
        "holding": the flight makes one or two racetracks at a point on a leg, and then follows the
        plan again.
        "vectoring": the flight leaves a leg, flies parallel to it at a distance of 12 to 20 km, and
        returns to a waypoint.
        "hijack": the flight turns by 45 to 150 degrees at a point on a leg, and does not return.
        "straight-on": the flight continues straight on where the plan has a turn.
        "wrong-turn": the flight turns to the opposite side, or by 30 to 60 degrees too much or too
        little.
        "fly-over": the flight begins a turn at the waypoint instead of before it.
    wind : array_like of shape (), (2,) or (F, 2)
        Velocity of the air, east and north, in m/s, for all flights or for each. If it is a number,
        each flight has a wind of its own, whose direction is uniform and whose speed is uniform
        between 0 and that number.
    bank, bank_sigma : float
        Mean and standard deviation of the bank angle in turns, in radians. Each flight has one bank
        angle, drawn from a normal distribution.
    navigation_sigma : float
        Standard deviation in metres of the slowly varying cross-track error, and of the error of
        the point at which a turn begins.
    speed_error : float
        Largest error of the airspeed in m/s. Each flight has one error, drawn from a uniform
        distribution.
    lasting : float
        Time in seconds for which a flight that does not return to its plan continues after leaving
        it.
    step : float
        Time between samples in seconds.
    rng : numpy.random.Generator or int, optional
        Random generator or its seed.

    Returns
    -------
    Traffic
        The flights. Each flight ends at the last waypoint of its route. Flights in the scenarios
        "conforming" and "speed" never count as having left their plans.

    Raises
    ------
    ValueError, TypeError
        If a scenario is unknown, or needs a turn and the plan has none; if a leg is shorter than a
        metre; if a speed is below 30 m/s, if a speed error is above a quarter of the speed, or if a
        wind is above 0.4 of the airspeed; if a parameter is outside its domain or has the wrong
        type.

    Examples
    --------
    >>> import numpy as np
    >>> from tertia.flightplan import FlightPlan
    >>> from tertia.simulate import flights
    >>> plan = FlightPlan([[0, 0], [0, 50e3], [50e3, 50e3]], 200.0)
    >>> traffic = flights([plan], scenario="straight-on", wind=20.0, rng=1)
    >>> traffic
    Traffic(1 flights, 0 to 501 s)
    >>> bool(np.isnan(traffic.left[0])), bool(np.isnan(traffic.returned[0]))
    (False, True)
    """
    filed = _plans(plans)
    names, random = _scenarios(scenario, filed), generator(rng)
    h = _number(step, "step", 0.01, 5.0)
    period = _number(lasting, "lasting", 1.0, 1e6)
    slowest = np.array([np.min(plan.speeds) for plan in filed])
    error = _number(speed_error, "speed_error", 0.0)
    limit = float(np.min(slowest, initial=np.inf)) / 4
    _require(error <= limit, "speed_error", error, f"at most a quarter of the speed: {limit:g} m/s")
    winds = _winds(wind, _WIND_MAX * (slowest - error), random)
    routes = [build(p, s, period, random) for p, s in zip(filed, names, strict=True)]
    n = len(routes)
    if not n:
        return dense_traffic(0, duration=h, step=h)
    mean = _number(bank, "bank", _BANK_MIN, _BANK_MAX)
    spread = _number(bank_sigma, "bank_sigma", 0.0, 1.0)
    pilots = Pilots(
        wind=winds,
        speed_error=random.uniform(-error, error, n),
        bank=np.clip(random.normal(mean, spread, n), _BANK_MIN, _BANK_MAX),
        roll=np.maximum(random.normal(_ROLL, _ROLL_SIGMA, n), _ROLL_MIN),
        turn_rate=np.array([plan.turn_rate for plan in filed]),
        navigation=_number(navigation_sigma, "navigation_sigma", 0.0, 1e5),
    )
    columns, starts = fly(routes, pilots, h, random), np.array([plan.start_time for plan in filed])
    left, returned = (starts + columns.pop(name) for name in ("left", "returned"))
    return Traffic(
        start=starts,
        step=h,
        **columns,
        identity=np.array([NO_IDENTITY if p.identity is None else p.identity for p in filed]),
        wind=winds,
        left=left,
        returned=returned,
        plans=filed,
    )


def _plans(plans: Sequence[FlightPlan]) -> tuple[FlightPlan, ...]:
    """Return the plans, after checking their legs and speeds."""
    filed = sequence_of(plans, FlightPlan, "plans")
    for i, plan in enumerate(filed):
        short = np.flatnonzero(np.hypot(*np.diff(plan.waypoints, axis=0).T) < 1.0)
        if len(short):
            raise ValueError(
                f"plans[{i}] has waypoints {short[0]} and {short[0] + 1} at one place; "
                "legs must be longer than a metre"
            )
        if np.min(plan.speeds) < _SPEED_MIN:
            raise ValueError(
                f"plans[{i}] has a speed of {np.min(plan.speeds):g} m/s; aircraft fly at "
                f"{_SPEED_MIN:g} m/s or faster"
            )
    return filed


def _scenarios(scenario: Any, plans: Sequence[FlightPlan]) -> list[FlightScenario]:
    """Return the scenario of each flight."""
    each = [scenario] * len(plans) if isinstance(scenario, str) else scenario
    names: list[Any] = listed(each, "scenario")
    _require(len(names) == len(plans), "scenario", scenario, f"one, or one of {len(plans)} each")
    for i, (name, plan) in enumerate(zip(names, plans, strict=True)):
        _choice(name, "scenario", get_args(FlightScenario))
        if name in TURNS and len(plan.waypoints) < 3:
            raise ValueError(f"plans[{i}] has no turn; the scenario {name!r} needs one")
    return names


def _winds(wind: Any, limits: FloatArray, random: np.random.Generator) -> FloatArray:
    """Return the wind of each flight, after checking that no wind exceeds its limit."""
    n = len(limits)
    given = finite(wind, "wind")
    if given.shape == ():
        speed = random.uniform(0.0, _number(wind, "wind", 0.0), n)
        angle = random.uniform(0.0, 2 * np.pi, n)
        given = speed[:, np.newaxis] * np.stack([np.sin(angle), np.cos(angle)], axis=-1)
    _require(given.shape in {(2,), (n, 2)}, "wind", given.shape, f"of shape (), (2,) or ({n}, 2)")
    winds: FloatArray = np.broadcast_to(given, (n, 2)).copy()
    speeds = np.hypot(winds[:, 0], winds[:, 1])
    for i in np.flatnonzero(speeds > limits)[:1]:
        raise ValueError(
            f"wind of flight {i} is {speeds[i]:g} m/s; it must not be above {limits[i]:g} m/s, "
            f"{_WIND_MAX:g} of the least airspeed"
        )
    return winds
