"""Routes that are flown instead of the planned route, one kind for each scenario."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from tertia._arrays import FloatArray, IntArray
from tertia.flightplan import FlightPlan

FlightScenario: TypeAlias = Literal[
    "conforming",
    "speed",
    "shortcut",
    "holding",
    "vectoring",
    "hijack",
    "straight-on",
    "wrong-turn",
    "fly-over",
]

GRAVITY = 9.80665

# how a waypoint is passed: the turn ends on the next leg; it begins at the waypoint and the leg is
# met later; or the next waypoint is headed for from where the turn ends
FLY_BY, FLY_OVER, DIRECT = 0, 1, 2
NEVER = -1

# seconds of straight flight between a turn and a deviation
_SETTLED = 20.0
# metres per second; radians; metres; seconds
_SPEED_CHANGE = (15.0, 30.0)
_VECTOR_ANGLE = np.radians([30.0, 50.0])
_VECTOR_OFFSET = (12e3, 20e3)
_VECTOR_TIME = 60.0
_HIJACK_ANGLE = np.radians([45.0, 150.0])
_WRONG_ANGLE = np.radians([30.0, 60.0])
_HOLDING_TIME = 60.0
# where there is a choice, a waypoint is headed for that needs a turn below this
_DIRECT_ANGLE = np.radians(110.0)


@dataclass(frozen=True, slots=True)
class Route:
    """The waypoints of a flown route, the speed after each of them, and how each is passed.

    The flight leaves its plan when it passes the waypoint `leave`, and follows it again from the
    waypoint `rejoin` on. The value NEVER means that the flight does not leave or rejoin its plan.
    """

    waypoints: FloatArray
    speeds: FloatArray
    heights: FloatArray
    passing: IntArray
    leave: int = NEVER
    rejoin: int = NEVER


def heights(plan: FlightPlan) -> FloatArray:
    """Return the heights of a plan; nan if it has none."""
    return np.full(len(plan.waypoints), np.nan) if plan.heights is None else plan.heights


def build(
    plan: FlightPlan, scenario: FlightScenario, lasting: float, random: np.random.Generator
) -> Route:
    """Return the route of a scenario; without a return it ends `lasting` s after the deviation."""
    return _BUILDERS[scenario](_Planned(plan), lasting, random)


class _Planned:
    """Geometry of a plan: directions and lengths of legs, and the parts of legs that turns need."""

    def __init__(self, plan: FlightPlan) -> None:
        self.waypoints, self.speeds, self.heights = plan.waypoints, plan.speeds, heights(plan)
        legs = np.diff(plan.waypoints, axis=0)
        self.lengths = np.hypot(*legs.T)
        self.along = legs / self.lengths[:, np.newaxis]
        pairs = zip(self.along[:-1], self.along[1:], strict=True)
        self.angles = np.array([signed_angle(a, b) for a, b in pairs])
        speed = plan.speeds
        self.radii = np.maximum(speed**2 / (GRAVITY * np.tan(plan.bank)), speed / plan.turn_rate)
        # metres of a leg before its last waypoint at which its turn begins; none at the end
        self.leads = np.zeros(len(self.lengths))
        half = np.minimum(np.abs(self.angles) / 2, np.radians(75.0))
        self.leads[:-1] = self.radii[:-1] * np.tan(half)

    def __len__(self) -> int:
        return len(self.waypoints)

    def spot(self, leg: int, random: np.random.Generator) -> tuple[FloatArray, float]:
        """Return a random point on the straight part of a leg, and its fraction of the leg."""
        settled = _SETTLED * self.speeds[leg]
        first = settled + (self.leads[leg - 1] if leg else 0.0)
        last = self.lengths[leg] - self.leads[leg] - settled
        if leg == 0:
            first = (first + last) / 2
        where = random.uniform(first, last) if first < last else (first + last) / 2
        share = float(np.clip(where / self.lengths[leg], 0.1, 0.9))
        return self.waypoints[leg] + share * self.lengths[leg] * self.along[leg], share

    def height(self, leg: int, share: float) -> float:
        """Return the height at a given fraction of a leg."""
        return float((1 - share) * self.heights[leg] + share * self.heights[leg + 1])

    def route(
        self,
        between: tuple[int, int],
        places: list[FloatArray],
        passing: list[int],
        *,
        height: float,
        leave: int,
        rejoin: int = NEVER,
    ) -> Route:
        """Return the planned route with other points, at one height, between two of its waypoints.

        `leave` and `rejoin` are indices of waypoints of the new route.
        """
        before, after = between
        n = len(places)
        tail = len(self) - after
        points = [*self.waypoints[: before + 1], *places, *self.waypoints[after:]]
        kinds = [FLY_BY] * (before + 1) + passing + [FLY_BY] * tail
        speeds = [*self.speeds[: before + 1], *[self.speeds[before]] * n, *self.speeds[after:]]
        levels = [*self.heights[: before + 1], *[height] * n, *self.heights[after:]]
        return Route(
            np.array(points),
            np.array(speeds[: len(points) - 1]),
            np.array(levels),
            np.array(kinds),
            leave,
            rejoin,
        )


def _conforming(plan: _Planned, lasting: float, random: np.random.Generator) -> Route:
    passing = np.full(len(plan), FLY_BY)
    return Route(plan.waypoints, plan.speeds, plan.heights, passing)


def _speed(plan: _Planned, lasting: float, random: np.random.Generator) -> Route:
    """Return the planned route with a higher or lower speed from a random point on."""
    leg = int(random.integers(len(plan) - 1))
    place, share = plan.spot(leg, random)
    route = plan.route(
        (leg, leg + 1), [place], [FLY_OVER], height=plan.height(leg, share), leave=NEVER
    )
    change = random.uniform(*_SPEED_CHANGE) * random.choice([-1.0, 1.0])
    speeds = route.speeds.copy()
    speeds[leg + 1 :] = np.maximum(speeds[leg + 1 :] + change, 0.7 * speeds[leg + 1 :])
    return Route(route.waypoints, speeds, route.heights, route.passing)


def _shortcut(plan: _Planned, lasting: float, random: np.random.Generator) -> Route:
    """Return a route from a point on a leg directly to a waypoint after the next."""
    leg = int(random.integers(len(plan) - 2))
    place, share = plan.spot(leg, random)
    target = min(_ahead(plan, place, plan.along[leg], leg, leg + 2), len(plan) - 1)
    height = plan.height(leg, share)
    return plan.route(
        (leg, target), [place], [DIRECT], height=height, leave=leg + 1, rejoin=leg + 2
    )


def _holding(plan: _Planned, lasting: float, random: np.random.Generator) -> Route:
    """Return a route with one or two racetracks at a point on a leg."""
    leg = int(random.integers(len(plan) - 1))
    fix, share = plan.spot(leg, random)
    along, speed = plan.along[leg], plan.speeds[leg]
    side = random.choice([-1.0, 1.0]) * right(along)
    width = 2.2 * plan.radii[leg] * side
    length = (_HOLDING_TIME * speed + 2 * plan.radii[leg]) * along
    lap = [fix, fix + width, fix + width - length, fix - length]
    places = [*lap * int(random.integers(1, 3)), fix]
    passing = [FLY_BY] * (len(places) - 1) + [FLY_OVER]
    height = plan.height(leg, share)
    return plan.route(
        (leg, leg + 1), places, passing, height=height, leave=leg + 1, rejoin=leg + len(places)
    )


def _vectoring(plan: _Planned, lasting: float, random: np.random.Generator) -> Route:
    """Return a route to one side, parallel to a leg, and back to a waypoint if one is ahead."""
    leg = int(random.integers(len(plan) // 2))
    place, share = plan.spot(leg, random)
    along = plan.along[leg]
    side = random.choice([-1.0, 1.0]) * right(along)
    offset, angle = random.uniform(*_VECTOR_OFFSET), random.uniform(*_VECTOR_ANGLE)
    off = place + offset * (side + along / np.tan(angle))
    abeam = off + (_VECTOR_TIME * plan.speeds[leg] + 2 * plan.radii[leg]) * along
    target = _ahead(plan, abeam, along, leg, leg + 1)
    if target == len(plan):
        abeam = off + lasting * plan.speeds[leg] * along
    places, height = [place, off, abeam], plan.height(leg, share)
    passing = [DIRECT, FLY_BY, FLY_BY]
    return plan.route((leg, target), places, passing, height=height, leave=leg + 1, rejoin=leg + 4)


def _hijack(plan: _Planned, lasting: float, random: np.random.Generator) -> Route:
    """Return a route that turns away at a point on a leg and does not return."""
    leg = int(random.integers(len(plan) - 1))
    place, share = plan.spot(leg, random)
    angle = random.uniform(*_HIJACK_ANGLE) * random.choice([-1.0, 1.0])
    along, side = plan.along[leg], np.sign(angle) * right(plan.along[leg])
    # after the arc of the turn, so that its course is as drawn
    arc = plan.radii[leg] * (np.sin(abs(angle)) * along + (1 - np.cos(angle)) * side)
    away = place + arc + lasting * plan.speeds[leg] * rotate(along, angle)
    return plan.route(
        (leg, len(plan)),
        [place, away],
        [DIRECT, FLY_BY],
        height=plan.height(leg, share),
        leave=leg + 1,
    )


def _straight_on(plan: _Planned, lasting: float, random: np.random.Generator) -> Route:
    """Return a route without one of the turns; it leaves the plan where that turn should begin."""
    turn = int(random.integers(1, len(plan) - 1))
    along = plan.along[turn - 1]
    begin = plan.waypoints[turn] - plan.leads[turn - 1] * along
    away = begin + lasting * plan.speeds[turn - 1] * along
    height = float(plan.heights[turn])
    return plan.route(
        (turn - 1, len(plan)), [begin, away], [FLY_OVER, FLY_BY], height=height, leave=turn
    )


def _wrong_turn(plan: _Planned, lasting: float, random: np.random.Generator) -> Route:
    """Return a route with a turn to the opposite side, or 30 to 60 degrees too large or small."""
    turn = int(random.integers(1, len(plan) - 1))
    angle = plan.angles[turn - 1]
    error = random.uniform(*_WRONG_ANGLE) * random.choice([-1.0, 1.0])
    flown = -angle if random.uniform() < 0.5 else angle + error
    place = plan.waypoints[turn]
    away = place + lasting * plan.speeds[turn] * rotate(plan.along[turn - 1], flown)
    height = float(plan.heights[turn])
    return plan.route(
        (turn - 1, len(plan)), [place, away], [FLY_BY, FLY_BY], height=height, leave=turn
    )


def _fly_over(plan: _Planned, lasting: float, random: np.random.Generator) -> Route:
    """Return a route that turns only at its waypoint; it leaves the plan where the turn is due."""
    turn = int(random.integers(1, len(plan) - 1))
    place = plan.waypoints[turn]
    begin = place - plan.leads[turn - 1] * plan.along[turn - 1]
    return plan.route(
        (turn - 1, turn + 1),
        [begin, place],
        [FLY_OVER, FLY_OVER],
        height=float(plan.heights[turn]),
        leave=turn,
        rejoin=turn + 1,
    )


_BUILDERS: dict[str, Callable[[_Planned, float, np.random.Generator], Route]] = {
    "conforming": _conforming,
    "speed": _speed,
    "shortcut": _shortcut,
    "holding": _holding,
    "vectoring": _vectoring,
    "hijack": _hijack,
    "straight-on": _straight_on,
    "wrong-turn": _wrong_turn,
    "fly-over": _fly_over,
}
# scenarios that need a turn
TURNS = frozenset({"shortcut", "straight-on", "wrong-turn", "fly-over"})


def _ahead(plan: _Planned, place: FloatArray, along: FloatArray, leg: int, first: int) -> int:
    """Return the first waypoint from `first` on that is ahead and far enough away for a turn.

    If there is none, return the number of waypoints.
    """
    for target in range(first, len(plan)):
        way = plan.waypoints[target] - place
        far = np.hypot(*way) > 3 * plan.radii[leg]
        if far and abs(signed_angle(along, way)) < _DIRECT_ANGLE:
            return target
    return len(plan)


def right(along: FloatArray) -> FloatArray:
    """Return unit vectors rotated by 90 degrees to the right."""
    return np.stack([along[..., 1], -along[..., 0]], axis=-1)


def rotate(vector: FloatArray, angle: float) -> FloatArray:
    """Return a vector rotated clockwise."""
    turned: FloatArray = np.cos(angle) * vector + np.sin(angle) * right(vector)
    return turned


def signed_angle(first: FloatArray, second: FloatArray) -> float:
    """Return the angle from one vector to another, positive clockwise."""
    across = first[1] * second[0] - first[0] * second[1]
    return float(np.arctan2(across, first @ second))
