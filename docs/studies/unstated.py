"""Figures of docs/position-sensors.md: noise and rounded times that a sensor does not state."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from studies.montecarlo import in_region
from studies.pages import markdown, repetitions
from tertia import simulate
from tertia._arrays import FloatArray, IntArray
from tertia.sensors import Bias, PositionSensor, Radar
from tertia.tracker import Plots, SmoothedTracks, TrackTable, smooth_tracks, track

SCENES = repetitions(5)
FLIGHTS, DURATION, SETTLED = 25, 300.0, 30.0
# factor of the noise of every third target; distance at which noise along the line of sight doubles
LARGER, FAR = 5.0, 40e3
# stated: m, m and rad
SIGMA, RANGE_SIGMA, AZIMUTH_SIGMA = 10.0, 50.0, 0.0014
SEED = 83


def scene(
    seed: int, interval: float, noise: float | str, step: float
) -> tuple[simulate.Traffic, Plots, list[PositionSensor] | list[Radar], IntArray]:
    """Simulate flights that report positions, or are seen by a radar if the interval is 4 s.

    The errors are `noise` times as large as stated, or differ between targets or places, and times
    are rounded to the step, if any.
    """
    random = np.random.default_rng([SEED, seed])
    traffic = simulate.dense_traffic(
        FLIGHTS, area=(150e3, 150e3), turning_share=0.5, duration=DURATION, rng=random
    )
    if interval == 4.0:
        sensors = [
            Radar(
                range_sigma=RANGE_SIGMA,
                azimuth_sigma=AZIMUTH_SIGMA,
                scan_period=interval,
                bias=Bias(),
            )
        ]
        record = simulate.radar_plots(traffic, sensors, rng=random)
        plots, target = record.plots, record.target
        return traffic, plots._replaced(time=rounded(plots.time, step)), sensors, target
    count = int(DURATION / interval)
    between = interval * random.uniform(0.8, 1.2, (FLIGHTS, count))
    time = np.cumsum(between, axis=1)
    target, _ = np.nonzero(time < DURATION)
    times = time[time < DURATION]
    position, _ = traffic.at(target, times)
    there = np.isfinite(position).all(axis=1)
    times, target, position = times[there], target[there], position[there]
    position = position + SIGMA * factors(noise, target, position, random)
    sensor = PositionSensor(position_sigma=SIGMA, update_interval=interval, bias=Bias())
    plots = Plots(rounded(times, step), position=position, icao_address=1 + target)
    return traffic, plots, [sensor], target


def factors(
    noise: float | str, target: IntArray, position: FloatArray, random: np.random.Generator
) -> FloatArray:
    """Draw errors east and north, in the stated sigmas."""
    errors: FloatArray = random.standard_normal(position.shape)
    if isinstance(noise, float):
        return noise * errors
    if noise == "targets":
        return np.where(target % 3 == 0, LARGER, 1.0)[:, np.newaxis] * errors
    # as of multilateration: less accurate far away, above all along the line of sight
    distance = np.hypot(*position.T)[:, np.newaxis]
    along = position / distance
    across = np.stack([along[:, 1], -along[:, 0]], axis=-1)
    sizes = np.hstack([1.0 + (distance / FAR) ** 2, 1.0 + distance / (3.0 * FAR)])
    own = sizes * errors
    drawn: FloatArray = own[:, :1] * along + own[:, 1:] * across
    return drawn


def rounded(time: FloatArray, step: float) -> FloatArray:
    """Round times to a step, if there is one."""
    return step * np.round(time / step) if step else time


def inside(
    table: TrackTable | SmoothedTracks, traffic: simulate.Traffic, target: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Return squared errors of positions, and whether the 95 % ellipses contain the targets."""
    rows = (table.plot >= 0) & (table.time > SETTLED)
    own = target[table.plot[rows]]
    truth, _ = traffic.at(np.maximum(own, 0), table.time[rows])
    known = (own >= 0) & np.isfinite(truth).all(axis=1)
    off = (table.position[rows] - truth)[known]
    covariance = table.covariance[rows][known][:, :2, :2]
    return np.sum(off**2, axis=1), in_region(off, covariance).astype(np.float64)


def cells(results: Sequence[tuple[FloatArray, FloatArray]]) -> list[str]:
    """Return the RMSE and the coverage of tracks."""
    squares, held = (np.concatenate(one) for one in zip(*results, strict=True))
    return [f"{np.sqrt(np.mean(squares)):.1f} m", f"{100 * np.mean(held):.0f}%"]


def unstated() -> str:
    """Return the accuracy and the coverage of tracks of sensors that state too little."""
    rows = []
    for name, interval, noise, step in (
        ("reports every second, as stated", 1.0, 1.0, 0.0),
        ("noise 2 times as large", 1.0, 2.0, 0.0),
        ("noise 3 times as large", 1.0, 3.0, 0.0),
        ("noise 5 times as large for every third target", 1.0, "targets", 0.0),
        ("noise that grows with the distance", 1.0, "places", 0.0),
        ("times in whole seconds", 1.0, 1.0, 1.0),
        ("times in tenths of a second", 1.0, 1.0, 0.1),
        ("reports every 5 s, times in whole seconds", 5.0, 1.0, 1.0),
        ("radar, as stated", 4.0, 1.0, 0.0),
        ("radar, times in whole seconds", 4.0, 1.0, 1.0),
    ):
        tracks, smoothed, counts = [], [], []
        for seed in range(SCENES):
            traffic, plots, sensors, target = scene(seed, interval, noise, step)
            table = track(plots, sensors)
            tracks.append(inside(table, traffic, target))
            smoothed.append(inside(smooth_tracks(plots, sensors, table), traffic, target))
            counts.append(len(np.unique(table.track)))
        rows.append([name, *cells(tracks), f"{np.mean(counts):.1f}", *cells(smoothed)])
    head = ["sensor", "RMSE", "inside the 95% ellipse", f"tracks of {FLIGHTS}"]
    return markdown([*head, "RMSE, smoothed", "inside"], rows)
