"""Figures of docs/position-sensors.md: velocities that come with positions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from studies.pages import markdown, repetitions
from tertia import simulate
from tertia._arrays import FloatArray, IntArray
from tertia.metrics import nees
from tertia.sensors import PositionSensor
from tertia.tracker import Plots, SmoothedTracks, TrackTable, smooth_tracks, track

SCENES = repetitions(20)
FLIGHTS = 30
# m and m/s; share of reports that arrive
SIGMA, VELOCITY_SIGMA, SEEN = 30.0, 1.0, 0.95
# seconds
DURATION, SETTLED = 600.0, 60.0
_OFTEN = 10.0
SEED = 71


@dataclass(frozen=True)
class Scene:
    """Flights, their reports, and whose these are."""

    traffic: simulate.Traffic
    plots: Plots
    target: IntArray


def scene(seed: int, interval: float, *, wrong: float = 0.0) -> Scene:
    """Simulate flights, of which a third turn, that report positions and velocities.

    A share of the velocities is wrong: any up to 300 m/s.
    """
    random = np.random.default_rng([SEED, seed])
    traffic = simulate.dense_traffic(
        FLIGHTS, area=(150e3, 150e3), turning_share=1 / 3, duration=DURATION, rng=random
    )
    count = int(DURATION / interval)
    time = random.uniform(0.0, interval, (FLIGHTS, 1)) + interval * np.arange(count)
    seen = (time < DURATION) & (random.random(time.shape) < SEEN)
    times, target = time[seen], np.nonzero(seen)[0]
    position, velocity = traffic.at(target, times)
    there = np.isfinite(position).all(axis=1)
    times, target = np.asarray(times[there]), np.asarray(target[there])
    position, velocity = position[there], velocity[there]
    position = position + random.normal(0.0, SIGMA, position.shape)
    velocity = velocity + random.normal(0.0, VELOCITY_SIGMA, velocity.shape)
    odd = random.random(len(times)) < wrong
    speed, course = 300.0 * np.sqrt(random.random(len(times))), random.uniform(0, 7, len(times))
    velocity[odd] = (speed * [np.sin(course), np.cos(course)]).T[odd]
    return Scene(traffic, Plots(times, position=position, velocity=velocity), target)


def judged(one: Scene, table: TrackTable | SmoothedTracks) -> tuple[FloatArray, FloatArray]:
    """Return errors and normalised squares of tracks at their plots."""
    rows = (table.plot >= 0) & (table.time > SETTLED)
    truth = np.hstack(one.traffic.at(one.target[table.plot[rows]], table.time[rows]))
    known = np.isfinite(truth).all(axis=1)
    error = (np.hstack([table.position, table.velocity])[rows] - truth)[known]
    return error, np.asarray(nees(error, table.covariance[rows][known])) / 4.0


def row(name: str, scenes: list[Scene], sensor: PositionSensor) -> list[str]:
    """Return a row of the table, of tracks and, if turns have a few plots, smoothed tracks."""
    often = sensor.update_interval <= _OFTEN
    errors, squares, counts, smoothed = [], [], [], []
    for one in scenes:
        table = track(one.plots, [sensor])
        error, square = judged(one, table)
        errors.append(error)
        squares.append(square)
        counts.append(len(np.unique(table.track)))
        if often:
            smoothed.append(judged(one, smooth_tracks(one.plots, [sensor], table)))
    error = np.concatenate(errors)
    cells = ["", ""]
    if often:
        late = np.concatenate([own for own, _ in smoothed])
        cells = [
            f"{_rms(late[:, :2]):.1f} m, {_rms(late[:, 2:]):.2f} m/s",
            f"{np.mean(np.concatenate([own for _, own in smoothed])):.2f}",
        ]
    return [
        name,
        f"{_rms(error[:, :2]):.1f} m",
        f"{_rms(error[:, 2:]):.2f} m/s",
        f"{np.mean(np.concatenate(squares)):.2f}",
        f"{np.mean(counts):.1f}",
        *cells,
    ]


def _rms(error: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.sum(error**2, axis=1))))


def reported_velocities() -> str:
    """Return how good tracks are with velocities, without them, and if some are wrong."""
    rows = []
    for interval in (4.0, 10.0, 30.0):
        right = [scene(seed, interval) for seed in range(SCENES)]
        odd = [scene(seed, interval, wrong=0.05) for seed in range(SCENES)]
        for name, scenes, sigma in (
            ("positions alone", right, None),
            ("with velocities", right, VELOCITY_SIGMA),
            ("5 % of the velocities wrong", odd, VELOCITY_SIGMA),
        ):
            sensor = PositionSensor(
                position_sigma=SIGMA,
                velocity_sigma=sigma,
                update_interval=interval,
                detection_probability=SEEN,
            )
            rows.append(row(f"every {interval:g} s, {name}", scenes, sensor))
    head = ["reports", "position", "velocity", "NEES", f"tracks of {FLIGHTS}"]
    return markdown([*head, "smoothed tracks", "NEES of these"], rows)
