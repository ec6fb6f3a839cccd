"""What the profiles of the tracker are worth on vessels, road users and drones."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, lru_cache
from typing import get_args

import numpy as np

from studies.montecarlo import WITHIN_95, FloatArray, generator
from studies.pages import markdown, repetitions
from tertia import metrics, simulate
from tertia.tracker import ProfileName, Radar, track

TARGETS, STEP = repetitions(40, least=4), 0.05
# durations of two scenes, seconds
VESSEL, DRONE = float(repetitions(1200, 500)), float(repetitions(240, 120))


@dataclass(frozen=True)
class Scene:
    """How targets move, and the radar that sees them.

    Speeds in m/s, accelerations in m/s², turn rates in degrees per second, durations of a manoeuvre
    and of the stretches between two in seconds; sigmas in metres and degrees.
    """

    speed: tuple[float, float]
    acceleration: float
    turn_rate: float
    manoeuvre: float
    between: float
    duration: float
    area: float
    range_sigma: float
    azimuth_sigma: float
    scan_period: float


SCENES: dict[ProfileName, Scene] = {
    "vessel": Scene((2.0, 12.0), 0.05, 1.5, 40.0, 180.0, VESSEL, 8000.0, 8.0, 0.25, 2.4),
    "road": Scene((0.0, 33.0), 2.5, 12.0, 5.0, 12.0, 120.0, 400.0, 0.6, 0.4, 0.5),
    "drone": Scene((0.0, 20.0), 2.5, 30.0, 4.0, 15.0, DRONE, 1500.0, 3.0, 0.5, 1.0),
}


def paths(scene: Scene, count: int, seed: int) -> FloatArray:
    """Return positions (count, S, 2) of targets that turn, speed up and slow down at random."""
    random = generator(12, 0, seed)
    steps = int(scene.duration / STEP)
    low, high = scene.speed
    course = random.uniform(0.0, 2 * np.pi, count)
    speed = random.uniform(low, high, count)
    place = random.uniform(-scene.area, scene.area, (count, 2))
    turn, push, until = np.zeros(count), np.zeros(count), np.zeros(count)
    busy = np.ones(count, dtype=bool)
    found = np.empty((count, steps, 2))
    for k in range(steps):
        due = k * STEP >= until
        busy ^= due
        chosen = random.integers(3, size=count)
        rate = np.radians(scene.turn_rate) * random.uniform(0.3, 1.0, count)
        sign = random.choice([-1.0, 1.0], count)
        turn = np.where(due, np.where(busy & (chosen != 1), sign * rate, 0.0), turn)
        change = sign * scene.acceleration * random.uniform(0.3, 1.0, count)
        push = np.where(due, np.where(busy & (chosen != 0), change, 0.0), push)
        mean = np.where(busy, scene.manoeuvre, scene.between)
        until = np.where(due, k * STEP + mean * random.uniform(0.5, 1.5, count), until)
        course += turn * STEP
        speed = np.clip(speed + push * STEP, low, high)
        place = place + STEP * speed[:, np.newaxis] * np.stack([np.sin(course), np.cos(course)], 1)
        found[:, k] = place
    return found


@lru_cache(maxsize=1)
def traffic(scene: Scene, count: int, seed: int) -> simulate.Traffic:
    """Return these targets as traffic without identities and heights."""
    return as_traffic(paths(scene, count, seed))


def as_traffic(position: FloatArray) -> simulate.Traffic:
    """Return paths, sampled every `STEP`, as traffic without identities and heights."""
    count = len(position)
    velocity = np.gradient(position, STEP, axis=1)
    nothing, none = np.zeros(position.shape[:2]), np.full(count, np.nan)
    return simulate.Traffic(
        start=np.zeros(count),
        count=np.full(count, position.shape[1]),
        step=STEP,
        position=position,
        velocity=velocity,
        turn_rate=nothing,
        turning=nothing.astype(bool),
        height=nothing + np.nan,
        identity=np.full(count, -1),
        wind=np.zeros((count, 2)),
        left=none,
        returned=none,
        plans=(),
    )


@cache
def judged(kind: ProfileName, profile: ProfileName, seed: int = 1) -> list[str]:
    """Return tracks, RMSE, coverage and NEES of a profile on a scene."""
    scene = SCENES[kind]
    radar = Radar(
        range_sigma=scene.range_sigma,
        azimuth_sigma=np.radians(scene.azimuth_sigma),
        scan_period=scene.scan_period,
        max_range=2 * scene.area,
        detection_probability=0.9,
    )
    true = traffic(scene, TARGETS, seed)
    record = simulate.radar_plots(true, [radar], clutter=5.0, rng=generator(12, 1, seed))
    found = track(record.plots, [radar], profile=profile)
    own = found[found.confirmed & (found.plot >= 0)]
    target = record.target[own.plot]
    numbers, index = np.unique(own.track, return_inverse=True)
    votes = np.zeros((len(numbers), TARGETS))
    np.add.at(votes, (index[target >= 0], target[target >= 0]), 1.0)
    followed = np.where(votes.any(axis=1), votes.argmax(axis=1), -1)
    rows, known = followed[index], followed[index] >= 0
    instant = np.minimum(np.rint(own.time / STEP).astype(int), true.position.shape[1] - 1)
    error = (own.position - true.position[rows, instant])[known]
    spread = own.covariance[known][:, :2, :2]
    squares = np.asarray(metrics.nees(error, spread))
    return [
        f"{len(numbers)}",
        f"{np.sqrt(np.mean(np.sum(error**2, axis=1))):.3g}",
        f"{np.mean(squares) / 2:.2f}",
        f"{np.mean(squares < WITHIN_95[2]):.0%}",
    ]


def table() -> str:
    """Tabulate each scene with the default profile and with its own."""
    rows = [
        [kind, profile, *judged(kind, profile)]
        for kind in SCENES
        for profile in dict.fromkeys((get_args(ProfileName)[0], kind))
    ]
    head = ["targets", "profile", f"tracks of {TARGETS} targets", "RMSE, m", "NEES per axis"]
    return markdown([*head, "within the 95 % ellipse"], rows)
