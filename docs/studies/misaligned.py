"""Radars with systematic errors beside sensors of positions, for docs/position-sensors.md."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from studies.pages import markdown, repetitions
from tertia import simulate
from tertia._arrays import FloatArray, IntArray
from tertia.metrics import nees
from tertia.sensors import Bias, PositionSensor, Radar
from tertia.tracker import Plots, Tracker

SCENES = repetitions(20, 1)
TARGETS, DURATION = 20, 400.0
# seconds after which errors and covariances are looked at
SETTLED = 100.0
RADARS = [
    Radar((-60e3, 0.0), range_sigma=50.0, azimuth_sigma=0.08, scan_period=4.0, degrees=True),
    Radar((50e3, 30e3), range_sigma=60.0, azimuth_sigma=0.1, scan_period=6.0, degrees=True),
]
ERRORS = Bias(range=[200.0, -60.0], azimuth=[0.3, -0.1], degrees=True)
# share of the targets that have ADS-B, and the standard deviation of their reports
EQUIPPED, SIGMA = 0.7, 25.0
ADSB = PositionSensor(position_sigma=SIGMA, update_interval=1.0)


@dataclass(frozen=True)
class Scene:
    """Plots in order of time, and whose they are."""

    traffic: simulate.Traffic
    plots: Plots
    target: IntArray


def scene(seed: int, radars: int, *, errors: bool, lasting: float | None, late: float) -> Scene:
    """Simulate so many radars, with systematic errors or without, and ADS-B.

    Of the variance of its reports the share `lasting` is one error of a target for all the time.
    None: there is no ADS-B. Its times are `late` by so many seconds.
    """
    random = np.random.default_rng([57, seed])
    traffic = simulate.dense_traffic(
        TARGETS, area=(120e3, 120e3), turning_share=0.3, duration=DURATION, rng=random
    )
    bias = ERRORS if errors else Bias(range=[0.0, 0.0])
    record = simulate.radar_plots(
        traffic, RADARS[:radars], bias=bias if radars > 1 else bias[0], rng=random
    )
    if lasting is None:
        return Scene(traffic, record.plots, record.target)
    time = random.uniform(0.0, 1.0, (TARGETS, 1)) + np.arange(DURATION - 1.0)
    equipped = random.random(TARGETS) < EQUIPPED
    target = np.broadcast_to(np.arange(TARGETS)[:, np.newaxis], time.shape)[equipped].ravel()
    time = time[equipped].ravel()
    constant = random.normal(0.0, SIGMA * np.sqrt(lasting), (TARGETS, 2))
    noise = random.normal(0.0, SIGMA * np.sqrt(1.0 - lasting), (len(time), 2))
    position = traffic.at(target, time)[0] + constant[target] + noise
    here = np.isfinite(position).all(axis=1)
    time, target, position = time[here], target[here], position[here]
    return with_reports(traffic, record, (time + late, target, position), radars)


def with_reports(
    traffic: simulate.Traffic,
    record: simulate.RadarPlots,
    reports: tuple[FloatArray, IntArray, FloatArray],
    sensor: int,
) -> Scene:
    """Return the plots of radars and the reports: times, targets and positions of a sensor."""
    time, target, position = reports
    seen, none = record.plots, np.full(len(time), np.nan)
    plots = Plots(
        np.append(seen.time, time),
        np.append(seen.range, none),
        np.append(seen.azimuth, none),
        sensor=np.append(seen.sensor, np.full(len(time), sensor)),
        height=np.append(seen.height, none),
        position=np.concatenate([np.full((len(seen), 2), np.nan), position]),
    )
    order = np.argsort(plots.time)
    return Scene(traffic, plots[order], np.append(record.target, target)[order])


def followed(
    one: Scene, radars: int, registration: bool | None
) -> tuple[int, FloatArray, FloatArray, Bias]:
    """Track live; return the number of tracks, errors, their normalised squares, and the bias."""
    sensors: list[Radar | PositionSensor] = list(RADARS[:radars])
    if one.plots.position is not None:
        sensors.append(ADSB)
    tracker = Tracker(sensors, registration=registration)
    errors, squares, numbers = [], [], set()
    for begin in np.arange(0.0, DURATION, 4.0):
        now = (one.plots.time >= begin) & (one.plots.time < begin + 4.0)
        table = tracker.update(one.plots[now], time=begin + 4.0)
        if begin < SETTLED:
            continue
        numbers |= set(table.track.tolist())
        table = table[table.plot >= 0]
        own = one.target[table.plot]
        known = own >= 0
        truth = one.traffic.at(own[known], table.time[known])[0]
        # that of a flight may end before its last plot
        there = np.isfinite(truth).all(axis=1)
        error = (table.position[known] - truth)[there]
        errors.append(error)
        squares.append(np.asarray(nees(error, table.covariance[known, :2, :2][there])))
    return len(numbers), np.concatenate(errors), np.concatenate(squares), tracker.bias


def misaligned() -> str:
    """Return how many tracks there are, how good, and how far off the errors found are."""
    rows = []
    cases = [
        ("two radars", 2, None, True, 0.0),
        ("two radars, ADS-B", 2, 0.0, True, 0.0),
        ("one radar, ADS-B", 1, 0.0, True, 0.0),
        ("two radars without errors, ADS-B", 2, 0.0, False, 0.0),
        ("two radars, ADS-B .4 s late", 2, 0.0, True, 0.4),
        ("two radars, ADS-B with constant errors", 2, 1.0, True, 0.0),
    ]
    for (name, radars, lasting, errors, late), registration in product(cases, (None, False)):
        found = [
            followed(
                scene(seed, radars, errors=errors, lasting=lasting, late=late), radars, registration
            )
            for seed in range(SCENES)
        ]
        error = np.concatenate([one[1] for one in found])
        square = np.concatenate([one[2] for one in found])
        bias = [one[3] for one in found]
        off = ["", ""] if registration is False else _off(bias, radars, errors)
        rows.append(
            [
                name if registration is None else f"{name}, `registration=False`",
                f"{np.mean([one[0] for one in found]):.1f}",
                f"{np.sqrt(np.mean(np.sum(error**2, axis=1))):.1f} m",
                f"{np.mean(square) / 2.0:.2f}",
                *off,
            ]
        )
    head = ["", f"tracks of {TARGETS}", "RMSE", "NEES", "error of range bias"]
    return markdown([*head, "error of azimuth bias"], rows)


def _off(found: list[Bias], radars: int, errors: bool) -> list[str]:
    """Return rms errors of range and azimuth, and the same over their sigmas."""
    cells = []
    for kind, scale, unit in (("range", 1.0, " m"), ("azimuth", 180.0 / np.pi, "°")):
        truth = np.asarray(getattr(ERRORS, kind))[:radars] * errors
        value = np.array([np.asarray(getattr(one, kind))[:radars] for one in found])
        sigma = np.array([np.asarray(getattr(one, f"{kind}_sigma"))[:radars] for one in found])
        off = value - truth
        rms, normalised = (np.sqrt(np.mean(one**2)) for one in (scale * off, off / sigma))
        cells.append(f"± {rms:.2g}{unit}, {normalised:.2f} σ")
    return cells
