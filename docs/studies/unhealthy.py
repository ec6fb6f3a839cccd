"""Tracks of radars whose plots are not what they state: docs/tracker-false-tracks.md."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from studies.montecarlo import normalised_squares
from studies.pages import markdown, repetitions
from tertia import simulate
from tertia._arrays import FloatArray, IntArray
from tertia.tracker import Plots, PlotStatus, Radar, Tracker, TrackTable, track

RUNS = repetitions(5, 1)
AIRCRAFT, CLUTTER, END = repetitions(30, 15), 20.0, float(repetitions(600, 300))
SEED = 7300
# seconds between calls of a live tracker
SCAN = 4.0
RADARS = (
    Radar((0.0, 0.0), range_sigma=50.0, azimuth_sigma=np.radians(0.08), scan_period=4.0),
    Radar((40e3, -30e3), range_sigma=70.0, azimuth_sigma=np.radians(0.1), scan_period=5.0),
)
REACH = 150e3
# seconds without plots after which an aircraft has left, and plots of one that is to be found
AWAY, FEWEST = 35.0, 6
# correlation of the errors of one aircraft from scan to scan
CORRELATION = 0.7


@dataclass(frozen=True)
class Scene:
    """Plots of several radars, and where the targets are."""

    plots: Plots
    target: IntArray
    truth: FloatArray
    aircraft: int


def scaled(radar: Radar, factor: float) -> Radar:
    """Return a radar whose noise is so many times as large."""
    distance, azimuth = factor * radar.range_sigma, factor * radar.azimuth_sigma
    return replace(radar, range_sigma=distance, azimuth_sigma=azimuth)


def seen(
    seed: int, count: int, noise: float = 1.0, correlation: float = 0.0, **options: Any
) -> Scene:
    """Simulate aircraft on routes and what so many radars see of them."""
    plans = simulate.routes("middle", AIRCRAFT, rng=seed)
    traffic = simulate.flights(plans, wind=15.0, rng=seed + 1)
    stated = [replace(radar, max_range=REACH) for radar in RADARS[:count]]
    real = [scaled(radar, noise if not correlation else 1e-6) for radar in stated]
    found = simulate.radar_plots(
        traffic,
        real,
        clutter=CLUTTER,
        identity_missing_probability=1.0,
        rng=seed + 2,
        **options,
    )
    early = found.plots.time < END
    plots, target = found.plots[early], found.target[early]
    if correlation:
        plots = lasting(plots, target, stated, correlation, seed + 3)
    return Scene(plots, target, places(traffic, plots.time, target), stays(plots, target))


def stays(plots: Plots, target: IntArray) -> int:
    """Count how often aircraft come into sight, for a few plots at least."""
    count = 0
    for one in np.unique(target[target >= 0]):
        time = np.sort(plots.time[target == one])
        parts = np.split(time, np.flatnonzero(np.diff(time) > AWAY) + 1)
        count += sum(len(part) >= FEWEST for part in parts)
    return count


def lasting(
    plots: Plots, target: IntArray, radars: list[Radar], correlation: float, seed: int
) -> Plots:
    """Add errors that are alike from scan to scan."""
    rng = np.random.default_rng(seed)
    distance, azimuth = plots.range.copy(), plots.azimuth.copy()
    for k, radar in enumerate(radars):
        for one in np.unique(target[target >= 0]):
            own = np.flatnonzero((plots.sensor == k) & (target == one))
            error = rng.standard_normal((2, len(own)))
            scans = np.diff(plots.time[own]) / radar.scan_period
            for i, kept in enumerate(correlation**scans, start=1):
                error[:, i] = kept * error[:, i - 1] + np.sqrt(1 - kept**2) * error[:, i]
            distance[own] += radar.range_sigma * error[0]
            azimuth[own] += radar.azimuth_sigma * error[1]
    return replace(plots, range=distance, azimuth=azimuth % (2 * np.pi))


def places(traffic: simulate.Traffic, time: FloatArray, target: IntArray) -> FloatArray:
    """Return where the targets of plots are; false ones are nowhere."""
    found = np.full((len(time), 2), np.nan)
    true = target >= 0
    place = (time[true] - traffic.start[target[true]]) / traffic.step
    low = np.clip(place.astype(int), 0, traffic.count[target[true]] - 2)
    share = (place - low)[:, np.newaxis]
    position = traffic.position
    flown = (1 - share) * position[target[true], low] + share * position[target[true], low + 1]
    found[true] = flown
    return found


def turns(seed: int, count: int) -> Scene:
    """Simulate twelve fighters that turn with 3 g for 20 s."""
    rng = np.random.default_rng(seed)
    step, end = 0.05, 180.0
    fine = np.arange(0.0, end, step)
    rate = np.where((fine > 60.0) & (fine < 80.0), 29.4 / 200.0, 0.0)
    parts = []
    for one in range(12):
        course = rng.uniform(0, 2 * np.pi) + rng.choice([-1, 1]) * np.cumsum(rate) * step
        velocity = 200.0 * np.stack([np.sin(course), np.cos(course)], axis=-1)
        start = np.array([20e3 + 15e3 * (one % 4), 20e3 + 20e3 * (one // 4)])
        flown = start + np.cumsum(velocity, axis=0) * step
        for k, radar in enumerate(RADARS[:count]):
            time = np.arange(rng.uniform(0.0, radar.scan_period), end - 1, radar.scan_period)
            time = time[rng.random(len(time)) < 0.95]
            truth = flown[(time / step).astype(int)]
            apart = truth - radar.position[:2]
            distance = np.hypot(*apart.T) + radar.range_sigma * rng.standard_normal(len(time))
            noise = radar.azimuth_sigma * rng.standard_normal(len(time))
            azimuth = np.arctan2(*apart.T) + noise
            parts.append((time, distance, azimuth, np.full(len(time), k), truth, 0 * time + one))
    time, distance, azimuth, sensor, truth, target = (
        np.concatenate(one) for one in zip(*parts, strict=True)
    )
    order = np.argsort(time)
    plots = Plots(time, distance, azimuth % (2 * np.pi), sensor=sensor)[order]
    return Scene(plots, target[order].astype(int), truth[order], 12)


GUARDED = "20 % outliers, `guard_acceleration=2`"
SCENES: dict[str, Callable[[int, int], Scene]] = {
    "as stated": seen,
    "noise twice as stated": lambda seed, n: seen(seed, n, noise=2.0),
    "noise half as stated": lambda seed, n: seen(seed, n, noise=0.5),
    "correlation .7": lambda seed, n: seen(seed, n, correlation=CORRELATION),
    "20 % duplicates": lambda seed, n: seen(seed, n, duplicate_probability=0.2),
    "20 % outliers": lambda seed, n: seen(seed, n, outlier_probability=0.2),
    GUARDED: lambda seed, n: seen(seed, n, outlier_probability=0.2),
    "3 g for 20 s": turns,
    "10 % without height": lambda seed, n: seen(seed, n, height_missing_probability=0.1),
    "30 % without height": lambda seed, n: seen(seed, n, height_missing_probability=0.3),
    "all without height": lambda seed, n: seen(seed, n, height_missing_probability=1.0),
}


@dataclass(frozen=True)
class Outcome:
    """Tracks of a scene, recorded and live, and the errors of the former where they have plots."""

    aircraft: int
    tracks: int
    nees: FloatArray
    error: FloatArray
    live: int = 0


def live(scene: Scene, radars: list[Radar], guard: float | None) -> int:
    """Count the tracks that are confirmed if the plots come scan by scan."""
    tracker = Tracker(radars, guard_acceleration=guard)
    ends = np.arange(SCAN, scene.plots.time[-1] + SCAN, SCAN)
    numbers: set[int] = set()
    given = 0
    for end, until in zip(ends, np.searchsorted(scene.plots.time, ends), strict=True):
        rows = tracker.update(scene.plots[given:until], time=float(end))
        numbers.update(rows.track[rows.confirmed].tolist())
        given = until
    return len(numbers)


def outcome(scene: Scene, found: TrackTable) -> Outcome:
    """Compare the tracks of a scene with the targets that most of their plots are of."""
    rows = found[found.confirmed & (found.plot >= 0)]
    error, nees = [], []
    for number in np.unique(rows.track):
        own = rows[rows.track == number]
        of = scene.target[own.plot]
        if not np.any(of >= 0):
            continue
        most = np.bincount(of[of >= 0]).argmax()
        own = own[of == most]
        off = own.position - scene.truth[own.plot]
        nees.append(normalised_squares(off, own.covariance[:, :2, :2]) / 2)
        error.append(np.hypot(*off.T))
    tracks = len(np.unique(found.track[found.confirmed]))
    return Outcome(scene.aircraft, tracks, np.concatenate(nees), np.concatenate(error))


def outcomes(kind: str, count: int, seed: int = SEED, runs: int = RUNS) -> list[Outcome]:
    """Track several scenes of a kind."""
    found = []
    for run in range(runs):
        scene = SCENES[kind](seed + 10 * run, count)
        # with a height of its own a radar measures slant ranges, whether heights are known or not
        higher = np.zeros(int(kind.endswith("without height")))
        radars = [
            replace(radar, position=np.append(radar.position, higher), max_range=REACH)
            for radar in RADARS[:count]
        ]
        guard = 2.0 if kind == GUARDED else None
        recorded = outcome(scene, track(scene.plots, radars, guard_acceleration=guard))
        found.append(replace(recorded, live=live(scene, radars, guard)))
    return found


def late(seed: int = SEED, runs: int = repetitions(3, 1)) -> str:
    """Tabulate what late plots leave of rows: 30 % up to 8 s late, and calls every 2 s."""
    rows = []
    for count in (1, 2):
        radars = [replace(radar, max_range=REACH) for radar in RADARS[:count]]
        same, final, refused, ratio = 0, 0, 0, []
        for run in range(runs):
            scene = seen(seed + 10 * run, count)
            rng = np.random.default_rng(seed + run)
            many = rng.random(len(scene.plots)) < 0.3
            came = scene.plots.time + many * rng.uniform(0.0, 8.0, len(scene.plots))
            own = [arrived(scene, radars, times) for times in (scene.plots.time, came)]
            (kept, shown, _), (again, shown_late, lost) = own
            refused += lost
            final += len(kept)
            same += sum(np.array_equal(a, b) for a, b in zip(kept, again, strict=False))
            ratio.append(shown_late / shown)
        rows.append(
            [
                f"{count} radar{'s' * (count > 1)}",
                f"{same / final:.2%}",
                str(refused),
                f"{np.mean(ratio):.3f}",
            ]
        )
    head = ["", "final rows identical to the last bit", "plots refused"]
    return markdown([*head, "RMSE of first rows, late / in order"], rows)


def arrived(
    scene: Scene, radars: list[Radar], came: FloatArray
) -> tuple[list[FloatArray], float, int]:
    """Return final rows, the RMSE of new rows as first shown, and how many plots were late."""
    tracker = Tracker(radars, lag=10.0)
    order = np.argsort(came, kind="stable")
    now, given, final, off, refused = 0.0, 0, [], [], 0
    while now < END + 10.0:
        now += 2.0
        until = int(np.searchsorted(came[order], now))
        found = tracker.update(scene.plots[order[given:until]], time=now)
        refused += int(np.sum(found.track_of_plot == PlotStatus.LATE))
        given = until
        final += rows_of(found[found.final], order)
        fresh = found[~found.final & found.confirmed & (found.plot >= 0)]
        fresh = fresh[fresh.time > now - 2.0]
        error = fresh.position - scene.truth[order[fresh.plot]]
        off.append(np.sum(error**2, axis=1))
    final += rows_of(tracker.finish(), order)
    squares = np.concatenate(off)
    squares = squares[np.isfinite(squares) & (squares < 1e6)]
    return final, float(np.sqrt(np.mean(squares))), refused


def rows_of(found: TrackTable, order: IntArray) -> list[FloatArray]:
    """Return what rows say, with plots by their place in the scene."""
    plot = np.where(found.plot >= 0, order[found.plot], -1)
    columns = [found.time, found.track, found.sensor, plot, *found.position.T, *found.velocity.T]
    return list(np.column_stack(columns))


def unhealthy(seed: int = SEED, runs: int = RUNS) -> str:
    """Tabulate tracks of plots that are not what their radars state."""
    rows = []
    for kind in SCENES:
        for count in (1, 2):
            found = outcomes(kind, count, seed, runs)
            more = [one.tracks - one.aircraft for one in found]
            more_live = [one.live - one.aircraft for one in found]
            error = np.concatenate([one.error for one in found])
            nees = np.concatenate([one.nees for one in found])
            rows.append(
                [
                    f"{kind}, {count} radar{'s' * (count > 1)}",
                    f"{np.mean(more):+.1f}",
                    f"{min(more):+d} to {max(more):+d}",
                    f"{np.mean(more_live):+.1f}",
                    f"{np.sqrt(np.mean(error**2)):.0f}",
                    f"{np.mean(nees):.2f}",
                    f"{np.mean(nees < 2.9957):.0%}",
                ]
            )
    head = ["", "surplus tracks, mean", "surplus tracks, range", "live, mean", "RMSE, m"]
    return markdown([*head, "NEES per axis", "within the 95 % ellipse"], rows)
