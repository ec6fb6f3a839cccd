"""Velocities of targets that manoeuvre more than airliners do, and of airliners."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from studies.montecarlo import WITHIN_95, FloatArray, generator
from studies.pages import markdown, repetitions
from studies.profiles import STEP, Scene, as_traffic, traffic
from tertia import metrics, simulate
from tertia.sensors import Bias
from tertia.tracker import Radar, track

SCENES, TARGETS = repetitions(4, least=1), repetitions(30, 8)
# rows of the first part of a track are left out, s
SETTLED = 40.0
# durations of the agile, s
LENGTHS = [float(repetitions(full, least)) for full, least in ((600, 240), (400, 200), (240, 120))]
# how fast and how sharply: with the noise and the scan period of an airport's radar, or a small one
AGILE: dict[str, Scene] = {
    "helicopters": Scene((5.0, 75.0), 2.0, 5.0, 12.0, 30.0, LENGTHS[0], 30e3, 50.0, 0.08, 4.0),
    "fighters": Scene((150.0, 330.0), 10.0, 8.0, 12.0, 40.0, LENGTHS[1], 50e3, 50.0, 0.08, 4.0),
    "small drones": Scene((0.0, 20.0), 2.5, 20.0, 4.0, 15.0, LENGTHS[2], 1500.0, 3.0, 0.5, 1.0),
}
AIRLINERS, HOLDING = "airliners on routes", "airliners in holdings"
GLIDERS = "gliders in thermals"
SETTINGS: dict[str, dict[str, Any]] = {
    "fighters": {"max_speed": 600.0},
    "small drones": {"profile": "drone"},
}
# of a holding: half a turn and a leg, s, and the rate of the turn, rad/s
LEG, RATE = 60.0, np.radians(3.0)
# of a glider: how long it climbs and then glides, s, and the wind, m/s
CLIMB, GLIDE, WIND = 240.0, 60.0, 4.0


def holdings(count: int, seed: int) -> simulate.Traffic:
    """Return aircraft in racetracks; turns begin within four seconds."""
    random = generator(13, 0, seed)
    steps = int(700.0 / STEP)
    time = STEP * np.arange(steps) - random.uniform(60.0, 150.0, (count, 1))
    turning = (time > 0.0) & (time % (2 * LEG) < LEG)
    rate = random.choice([-RATE, RATE], (count, 1)) * turning
    velocity = moving(rate, (90.0, 130.0), random)
    way = np.cumsum(velocity, axis=1) * STEP
    return as_traffic(random.uniform(-60e3, 60e3, (count, 1, 2)) + way)


def moving(
    rate: FloatArray, speeds: tuple[float, float], random: np.random.Generator
) -> FloatArray:
    """Return velocities at these rates of turn, which change within four seconds."""
    soft = np.ones(int(4.0 / STEP)) * STEP / 4.0
    rate = np.stack([np.convolve(own, soft)[: len(own)] for own in rate])
    course = random.uniform(0.0, 2 * np.pi, (len(rate), 1)) + np.cumsum(rate, axis=1) * STEP
    speed = random.uniform(*speeds, (len(rate), 1, 1))
    return np.asarray(speed * np.stack([np.sin(course), np.cos(course)], axis=-1))


def gliders(count: int, seed: int) -> simulate.Traffic:
    """Return gliders that circle in thermals, which drift with the wind, and glide to the next."""
    random = generator(13, 3, seed)
    time = STEP * np.arange(int(700.0 / STEP)) + random.uniform(0.0, CLIMB + GLIDE, (count, 1))
    circling = time % (CLIMB + GLIDE) < CLIMB
    rate = np.radians(random.uniform(13.0, 20.0, (count, 1))) * circling
    velocity = moving(rate * random.choice([-1.0, 1.0], (count, 1)), (22.0, 28.0), random)
    way = np.cumsum(velocity + random.normal(0.0, WIND, (count, 1, 2)), axis=1) * STEP
    return as_traffic(random.uniform(-25e3, 25e3, (count, 1, 2)) + way)


def flown(kind: str, seed: int) -> simulate.Traffic:
    """Return the targets of a scene."""
    if kind == HOLDING:
        return holdings(TARGETS, seed)
    if kind == GLIDERS:
        return gliders(TARGETS, seed)
    if kind == AIRLINERS:
        random, setting = generator(13, 1, seed), simulate.set_up("middle")
        routes = simulate.routes("middle", TARGETS, rng=random)
        return simulate.flights(routes, wind=setting.wind, rng=random)
    return traffic(AGILE[kind], TARGETS, seed + 100)


@cache
def errors(kind: str, seed: int) -> tuple[FloatArray, FloatArray]:
    """Return errors of positions and velocities at plots, and their covariances."""
    scene = AGILE.get(kind, AGILE["helicopters"])
    radar = Radar(
        range_sigma=scene.range_sigma,
        azimuth_sigma=np.radians(scene.azimuth_sigma),
        scan_period=scene.scan_period,
        max_range=4000.0 if kind == "small drones" else 300e3,
        detection_probability=0.9,
        bias=Bias(),
    )
    true = flown(kind, seed)
    record = simulate.radar_plots(true, [radar], clutter=3.0, rng=generator(13, 2, seed))
    found = track(record.plots, [radar], **SETTINGS.get(kind, {}))
    own = found[found.confirmed & (found.plot >= 0)]
    target = record.target[own.plot]
    truth = np.hstack(true.at(np.maximum(target, 0), own.time))
    settled = own.time - true.start[target] > SETTLED
    known = (target >= 0) & settled & np.isfinite(truth).all(axis=1)
    state = np.hstack([own.position, own.velocity])
    return (state - truth)[known], own.covariance[known]


def table() -> str:
    """Tabulate errors of velocities and how many are in their regions."""
    rows = []
    for kind in (AIRLINERS, HOLDING, GLIDERS, *AGILE):
        several = [errors(kind, seed) for seed in range(SCENES)]
        error, covariance = (np.concatenate(column) for column in zip(*several, strict=True))
        cells = []
        for part in (slice(0, 2), slice(2, 4)):
            off = error[:, part]
            squares = np.asarray(metrics.nees(off, covariance[:, part, part]))
            cells += [
                f"{np.sqrt(np.mean(np.sum(off**2, axis=1))):.3g}",
                f"{np.mean(squares < WITHIN_95[2]):.0%}",
            ]
        rows.append([kind, *cells])
    head = ["targets", "position, m", "positions inside 95 %", "velocity, m/s"]
    return markdown([*head, "velocities inside 95 %"], rows)
