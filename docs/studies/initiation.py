"""How soon targets are tracked where flights are due, and how many tracks are false."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2  # type: ignore[import-untyped]

from studies.montecarlo import FloatArray, generator
from studies.pages import markdown, repetitions
from tertia import simulate
from tertia.flightplan import FlightPlan
from tertia.tracker import PlanModel, Plots, TrackTable, track

RADAR = simulate.set_up("middle").radar
PERIOD, FAR = RADAR.scan_period, RADAR.max_range
# targets appear within this distance, as the waypoints of the routes lie, m
NEAR = 200e3
PLANS, TARGETS, SCANS, BEFORE = 40, 20, 60, 15
# how flights deviate from their plans: s, m, m/s
LATE, ASIDE, FASTER = 120.0, 300.0, 15.0
MODELS = (PlanModel(), PlanModel(initiation=True))


@dataclass(frozen=True)
class Scene:
    """Plans, plots, and the target of each plot: planned ones first, -1 for false plots."""

    plans: list[FlightPlan]
    plots: Plots
    target: FloatArray


def under_way(rng: np.random.Generator, duration: float) -> list[FlightPlan]:
    """Return plans that are somewhere on their way in the middle of a recording."""
    plans = []
    for plan in simulate.routes("middle", PLANS, rng=rng):
        flown = rng.uniform(0.1, 0.9) * (plan.times[-1] - plan.times[0])
        start = 0.5 * duration - flown
        plans.append(FlightPlan(plan.waypoints, plan.speeds, start_time=float(start)))
    return plans


def flown(
    plan: FlightPlan, begin: float, times: FloatArray, rng: np.random.Generator
) -> FloatArray:
    """Return where a flight is that is late, aside and faster than its plan."""
    late, aside, faster = rng.normal(0, (LATE, ASIDE, FASTER))
    due = float(np.interp(begin - late, plan.times, plan.distances))
    leg = np.searchsorted(plan.distances, due, side="right") - 1
    speed = plan.speeds[min(leg, len(plan.speeds) - 1)] + faster
    position, course = plan.path(due + speed * (times - begin))
    right = np.stack([np.cos(course), -np.sin(course)], axis=-1)
    return np.asarray(position + aside * right, dtype=np.float64)


def elsewhere(begin: float, times: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return where a target without a plan is."""
    course = rng.uniform(0, 2 * np.pi)
    velocity = rng.uniform(160.0, 200.0) * np.array([np.sin(course), np.cos(course)])
    return np.asarray(
        anywhere(1, NEAR, rng) + (times - begin)[:, np.newaxis] * velocity, dtype=np.float64
    )


def anywhere(count: int, far: float, rng: np.random.Generator) -> FloatArray:
    """Return places within a distance of the radar."""
    distance, azimuth = far * np.sqrt(rng.uniform(size=count)), rng.uniform(0, 2 * np.pi, count)
    away = np.stack([np.sin(azimuth), np.cos(azimuth)], axis=-1)
    return np.asarray(distance[:, np.newaxis] * away, dtype=np.float64)


def on_routes(plans: list[FlightPlan], count: int, rng: np.random.Generator) -> FloatArray:
    """Return places on routes, within 700 m or so."""
    lengths = np.array([plan.length for plan in plans])
    own = rng.choice(len(plans), size=count, p=lengths / lengths.sum())
    places = np.empty((count, 2))
    for number, plan in enumerate(plans):
        mine = np.flatnonzero(own == number)
        position, course = plan.path(rng.uniform(0, plan.length, mine.size))
        right = np.stack([np.cos(course), -np.sin(course)], axis=-1)
        places[mine] = position + rng.normal(0, 700.0, (mine.size, 1)) * right
    return places


def plots_of(time: FloatArray, position: FloatArray, rng: np.random.Generator) -> Plots:
    """Return plots in the scans that begin at such times, when the beam passes."""
    distance, azimuth = np.hypot(*position.T), np.arctan2(*position.T) % (2 * np.pi)
    time = time + PERIOD * azimuth / (2 * np.pi)
    n = len(time)
    distance = distance + RADAR.range_sigma * rng.standard_normal(n)
    azimuth = azimuth + RADAR.azimuth_sigma * rng.standard_normal(n)
    return Plots(time, np.abs(distance), azimuth)


def scene(false_plots: float, scans: int, targets: int, routed: bool, seed: list[int]) -> Scene:
    """Return a recording with targets that appear, half of them with a plan."""
    rng = generator(61, *seed)
    plans = under_way(rng, scans * PERIOD)
    times, places, of = [], [], []
    for target in range(2 * targets):
        first = int(rng.integers(BEFORE, scans - BEFORE))
        scan = PERIOD * np.arange(first, scans, dtype=np.float64)
        begin = float(scan[0])
        path = flown(plans[target], begin, scan, rng) if target < targets else None
        path = elsewhere(begin, scan, rng) if path is None else path
        seen = rng.uniform(size=scan.size) < RADAR.detection_probability
        seen &= np.hypot(*path.T) < FAR
        times.append(scan[seen])
        places.append(path[seen])
        of.append(np.full(seen.sum(), target))
    count = rng.poisson(false_plots * scans)
    times.append((PERIOD * rng.integers(0, scans, count)).astype(np.float64))
    clutter = on_routes(plans, count, rng) if routed else anywhere(count, FAR, rng)
    places.append(clutter)
    of.append(np.full(count, -1))
    position, target_of = np.concatenate(places), np.concatenate(of)
    inside = np.hypot(*position.T) < FAR
    plots = plots_of(np.concatenate(times)[inside], position[inside], rng)
    order = np.argsort(plots.time, kind="stable")
    return Scene(plans, plots[order], target_of[inside][order])


def delays(found: TrackTable, scene: Scene) -> Iterator[tuple[int, int, int]]:
    """Yield targets, and scans and plots from the first plot to confirmation, both counted."""
    confirmed = found.plot[found.confirmed & (found.plot >= 0)]
    for target in range(2 * TARGETS):
        own = np.flatnonzero(scene.target == target)
        tracked = own[np.isin(own, confirmed)]
        if own.size and tracked.size:
            wait = scene.plots.time[tracked[0]] - scene.plots.time[own[0]]
            plots = int(np.searchsorted(own, tracked[0]))
            yield target, 1 + round(wait / PERIOD), 1 + plots


def initiation() -> str:
    """Return scans to confirmation, of targets with plans and without."""
    rows = []
    for false_plots in (20, 100, 500):
        scans: list[list[list[int]]] = [[[], []], [[], []]]
        plots: list[int] = []
        for trial in range(repetitions(10, 1)):
            one = scene(false_plots, SCANS, TARGETS, False, [false_plots, trial])
            for model, own in zip(MODELS, scans, strict=True):
                found = track(one.plots, [RADAR], plans=one.plans, plan_model=model)
                for target, delay, count in delays(found, one):
                    own[int(target >= TARGETS)].append(delay)
                    if target < TARGETS and model.initiation:
                        plots.append(count)
        (planned, others), (soon, others_soon) = scans
        rows.append(
            [
                f"{false_plots}",
                f"{np.mean(planned):.2f} → {np.mean(soon):.2f}",
                f"{np.mean(np.array(plots) <= 2):.0%}",
                f"{np.mean(others):.2f} → {np.mean(others_soon):.2f}",
            ]
        )
    head = ["false plots per scan", "with a plan", "confirmed by the second plot"]
    return markdown([*head, "without a plan"], rows)


def false_tracks() -> str:
    """Return how many tracks of false plots alone are confirmed in a thousand scans."""
    rows = []
    scans = repetitions(200, 80)
    for routed in (False, True):
        for false_plots, full in ((20, 25), (100, 25)):
            count, runs = np.zeros(2, dtype=int), repetitions(full, 1)
            for trial in range(runs):
                one = scene(false_plots, scans, 0, routed, [7, int(routed), false_plots, trial])
                for k, model in enumerate(MODELS):
                    found = track(one.plots, [RADAR], plans=one.plans, plan_model=model)
                    count[k] += len(np.unique(found.track[found.confirmed]))
            share = 1000.0 / (runs * scans)
            most = 0.5 * float(chi2.ppf(0.95, 2 * (count[1] + 1)))
            rows.append(
                [
                    "on routes" if routed else "anywhere",
                    f"{false_plots}",
                    f"{runs * scans}",
                    f"{share * count[0]:.2f} → {share * count[1]:.2f}",
                    f"{share * most:.2f}",
                ]
            )
    head = ["false plots", "false plots per scan", "scans", "false tracks in 1000 scans"]
    return markdown([*head, "upper 95 % bound"], rows)
