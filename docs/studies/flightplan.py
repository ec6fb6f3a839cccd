"""The tables and the picture of the page on flight plans."""

from collections.abc import Iterator

import numpy as np
from matplotlib.figure import Figure

from studies.montecarlo import FloatArray, generator
from studies.pages import BLUE, GREEN, GREY, ORANGE, markdown, repetitions
from tertia.flightplan import FlightPlan, conformance, correlate, estimate_times_over

ROUTES, LEG = 10, 1e5
SCAN = 10.0
# where the zone of a turn begins and ends: leads, scans
ZONE = (0.7, 0.4, 2.0)


def along(courses: FloatArray, lengths: FloatArray) -> FloatArray:
    """Return waypoints of legs with such courses, from the origin."""
    steps = lengths[:, np.newaxis] * np.stack([np.sin(courses), np.cos(courses)], axis=-1)
    return np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])


def turns() -> str:
    """Compute turns by speed and angle."""
    rows = []
    for speed in (80.0, 130.0, 220.0, 250.0):
        for angle in (30.0, 60.0, 90.0, 120.0):
            courses = np.radians([0.0, angle])
            plan = FlightPlan(along(courses, np.array([1e5, 1e5])), speed)
            turn = plan.turns
            saved = 2 * turn.lead[0] - turn.arc[0]
            rows.append(
                [
                    f"{speed:.0f}",
                    f"{angle:.0f}",
                    f"{turn.radius[0] / 1e3:.2f}",
                    f"{turn.lead[0] / 1e3:.2f}",
                    f"{turn.arc[0] / 1e3:.2f}",
                    f"{turn.arc[0] / speed:.0f}",
                    f"{saved / speed:.1f}",
                ]
            )
    head = ["speed, m/s", "angle, °", "radius, km", "lead, km", "arc, km", "time on arc, s"]
    return markdown([*head, "time saved, s"], rows)


def shared_routes(live: int, rng: np.random.Generator) -> tuple[list[FlightPlan], list[FloatArray]]:
    """Return plans on ten routes of 700 km, and five scans of each flight, somewhere on its way."""
    routes = [
        rng.uniform(-2e5, 2e5, 2)
        + along(rng.uniform(0, 2 * np.pi) + np.cumsum(rng.uniform(-0.5, 0.5, 7)), np.full(7, LEG))
        for _ in range(ROUTES)
    ]
    times = SCAN * np.arange(5)
    plans, rows = [], []
    for _ in range(live):
        route, speed = routes[rng.integers(ROUTES)], rng.normal(220.0, 12.0)
        height = 300.0 * rng.integers(29, 42)
        flown = rng.uniform(0.05, 0.95) * 7 * LEG / speed
        plans.append(FlightPlan(route, speed, start_time=-flown, heights=height))
        true = speed + rng.normal(0, 5.0)
        actual = FlightPlan(route, true, start_time=-(flown - rng.normal(0, 30.0)) * speed / true)
        position, velocity = actual.at(times)
        right = np.stack([velocity[:, 1], -velocity[:, 0]], axis=-1) / true
        position = position + rng.normal(0, 300.0) * right + rng.normal(0, 100.0, (5, 2))
        velocity = velocity + rng.normal(0, 4.0, (5, 2))
        rows.append((position, velocity, height + rng.normal(0, 15.0, 5)))
    states = [np.stack(column) for column in zip(*rows, strict=True)]
    return plans, [np.tile(times, (live, 1)), *states]


def identification() -> str:
    """Shares of tracks whose plan is found, by the number of plans."""
    covariance = np.diag([1e4, 1e4, 16, 16])
    rows = []
    for live in (20, 40, 80):
        counts: dict[bool, FloatArray] = {True: np.zeros(2), False: np.zeros(2)}
        total = 0
        for trial in range(repetitions(1600 // live)):
            plans, (times, position, velocity, heights) = shared_routes(
                live, generator(50, live, trial)
            )
            total += live
            for known, count in counts.items():
                found = correlate(
                    plans,
                    times,
                    position,
                    velocity,
                    covariance=np.broadcast_to(covariance, (live, 5, 4, 4)),
                    height=heights if known else None,
                )
                plan = np.asarray(found.plan)
                right = plan == np.arange(live)
                count += [np.count_nonzero(right), np.count_nonzero((plan >= 0) & ~right)]
        for known, (right, wrong) in counts.items():
            rows.append(
                [
                    f"{live}",
                    "known" if known else "unknown",
                    f"{right / total:.2f}",
                    f"{wrong / total:.4f}",
                    f"{1 - (right + wrong) / total:.2f}",
                ]
            )
    return markdown(["plans", "heights", "identified", "wrong", "undecided"], rows)


def flights(
    count: int, rng: np.random.Generator, wind: float
) -> Iterator[tuple[FlightPlan, FlightPlan, FloatArray, FloatArray, FloatArray]]:
    """Yield plans, the routes that are flown, and times, distances and speeds along them.

    Airspeeds are off by a process of 10 m/s that forgets in five minutes, banks are 23 ± 2.2°.
    """
    step, sigma, memory = 6.0, 10.0, 300.0
    kept = np.exp(-step / memory)
    for _ in range(count):
        courses = rng.uniform(0, 2 * np.pi) + np.cumsum(rng.uniform(-1.2, 1.2, 6))
        waypoints = along(courses, rng.uniform(4e4, 8e4, 6))
        planned = rng.uniform(200, 230)
        flown = FlightPlan(waypoints, planned, bank=float(np.radians(rng.normal(23, 2.2))))
        whither = rng.uniform(0, 2 * np.pi)
        blowing = rng.uniform(0, wind)
        off, distance = rng.normal(0, sigma), 0.0
        distances, speeds = [], []
        while distance < flown.length:
            angle = float(flown.path(distance)[1]) - whither
            across, tail = blowing * np.sin(angle), blowing * np.cos(angle)
            speed = np.sqrt((planned + off) ** 2 - across**2) + tail
            distances.append(distance)
            speeds.append(speed)
            distance += speed * step
            off = kept * off + np.sqrt(1 - kept**2) * rng.normal(0, sigma)
        ways, rates = np.array([distances, speeds], dtype=np.float64)
        times = step * np.arange(len(speeds), dtype=np.float64)
        yield FlightPlan(waypoints, planned), flown, times, ways, rates


def tracked(
    flown: FlightPlan, distances: FloatArray, speeds: FloatArray, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return position, velocity and covariance of a track, aside of the route by some 200 m."""
    position, course = flown.path(distances)
    u = np.stack([np.sin(course), np.cos(course)], axis=-1)
    right = np.stack([u[:, 1], -u[:, 0]], axis=-1)
    position = position + rng.normal(0, 200.0) * right + rng.normal(0, 75.0, u.shape)
    velocity = speeds[:, np.newaxis] * u + rng.normal(0, 4.0, u.shape)
    covariance = np.diag([75.0**2, 75.0**2, 16.0, 16.0])
    return position, velocity, np.tile(covariance, (len(u), 1, 1))


def passing() -> str:
    """Errors of passing times some minutes ahead."""
    rows = []
    for wind in (15.0, 30.0, 50.0):
        for before in (120.0, 300.0):
            rng = generator(51, int(wind))
            errors: list[tuple[float, float, float]] = []
            for one, flown, times, distances, speeds in flights(repetitions(60, 10), rng, wind):
                position, velocity, covariances = tracked(flown, distances, speeds, rng)
                found = estimate_times_over(one, times, position, velocity, covariance=covariances)
                follows = conformance(one, times, position, velocity, covariance=covariances)
                passed = np.interp(flown.distances, distances, times)
                for waypoint in range(1, len(passed) - 1):
                    at = int(np.searchsorted(times, passed[waypoint] - before))
                    if times[at] > 60 and follows.conforms[at]:
                        here = np.interp(follows.along_track[at], one.distances, one.times)
                        alone = times[at] + one.times[waypoint] - here - passed[waypoint]
                        error = found.time[at, waypoint] - passed[waypoint]
                        errors.append((error, found.sigma[at, waypoint], alone))
            estimated, sigma, alone_ = np.sqrt(np.mean(np.square(errors), axis=0))
            rows.append(
                [
                    f"0 to {wind:.0f}",
                    f"{before:.0f}",
                    f"{alone_:.1f}",
                    f"{estimated:.1f}",
                    f"{sigma:.1f}",
                ]
            )
    head = [
        "wind, m/s",
        "ahead, s",
        "plan alone: rms error, s",
        "estimated: rms error, s",
        "sigma, s",
    ]
    return markdown(head, rows)


def blocking() -> str:
    """How soon a flight that leaves its plan is noticed."""
    rows = []
    for name, period in (("4 s", 4.0), ("6 s", 6.0), ("10 s", 10.0)):
        for kind in ("none", "turn not flown", "shortcut", "away by 90°"):
            rng = generator(52, int(period), len(kind))
            delays, total = [], 100
            for _ in range(total):
                courses = rng.uniform(0, 2 * np.pi) + np.cumsum(rng.uniform(0.5, 1.2, 4))
                waypoints = along(courses, rng.uniform(4e4, 8e4, 4))
                plan = FlightPlan(waypoints, 200.0)
                route, left = _deviation(kind, waypoints, plan)
                flown = FlightPlan(route, 200.0)
                times = np.arange(0.0, min(flown.times[-1], plan.times[-1]) - 60, period)
                position, velocity, covariances = tracked(
                    flown, 200.0 * times, np.full(times.shape, 200.0), rng
                )
                found = conformance(plan, times, position, velocity, covariance=covariances)
                blocked = np.flatnonzero(~found.conforms)
                if blocked.size:
                    delays.append(times[blocked[0]] - left)
            share = f"{len(delays) / total:.0%}"
            middle = f"{np.median(delays):.0f}" if delays else ""
            late = f"{np.quantile(delays, 0.9):.0f}" if delays else ""
            rows.append([name, kind, share, middle, late])
    head = ["scan period", "deviation", "blocked", "median delay, s", "90 % quantile, s"]
    return markdown(head, rows)


def _deviation(kind: str, waypoints: FloatArray, plan: FlightPlan) -> tuple[FloatArray, float]:
    """Return the route that is flown instead, and when it leaves that of the plan."""
    first, corner = waypoints[:2]
    course = (corner - first) / np.linalg.norm(corner - first)
    if kind == "turn not flown":
        return np.stack([first, corner + 1e5 * course]), plan.times[1]
    middle = first + 0.5 * (corner - first)
    reached = float(np.linalg.norm(middle - first)) / 200.0
    if kind == "none":
        return waypoints, 0.0
    aside = middle + 1e5 * np.array([-course[1], course[0]])
    after = waypoints[3:] if kind == "shortcut" else aside[np.newaxis]
    route = np.concatenate([[first, middle], after])
    return route, reached - float(FlightPlan(route, 200.0).turns.lead[0]) / 200.0


def turn_figure() -> Figure:
    """Draw a turn: legs, path, arc, and the zone where it may be flown."""
    figure = Figure(figsize=(8, 4.5), layout="constrained")
    ax = figure.subplots()
    speed, period = 220.0, 10.0
    plan = FlightPlan(along(np.radians([40.0, 100.0]), np.array([4e4, 4e4])), speed)
    turn = plan.turns
    begin = plan.distances[1] - turn.arc[0] / 2
    first = begin - ZONE[0] * turn.lead[0] - ZONE[2] * speed * period
    last = begin + turn.arc[0] + ZONE[1] * turn.lead[0] + ZONE[2] * speed * period
    ax.plot(*plan.waypoints.T / 1e3, "--", color=GREY, lw=1, label="legs")
    for (low, high), color, width, label in (
        ((0.0, plan.length), BLUE, 1.5, "path"),
        ((first, last), ORANGE, 6.0, "zone of the turn"),
        ((begin, begin + turn.arc[0]), GREEN, 3.0, "arc"),
    ):
        position, _ = plan.path(np.linspace(low, high, 300))
        under = 1 if width > 5 else 2
        ax.plot(*position.T / 1e3, color=color, lw=width, label=label, zorder=under)
    spokes = np.stack([turn.start[0], turn.centre[0], turn.end[0]]) / 1e3
    ax.plot(*spokes.T, ":", color=GREY, lw=1)
    ax.plot(*plan.waypoints.T / 1e3, "k^", label="waypoints")
    ax.set_aspect("equal")
    ax.set_xlabel("east (km)")
    ax.set_ylabel("north (km)")
    ax.legend(loc="lower right", fontsize="small")
    return figure
