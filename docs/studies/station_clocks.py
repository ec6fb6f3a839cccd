"""Paths from stations whose clocks differ."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from studies.montecarlo import WITHIN_95, FloatArray, generator
from studies.pages import markdown, repetitions
from tertia.location import Station
from tertia.sensors import Bias
from tertia.trajectory import Trajectory, reconstruct

RUNS = repetitions(10, 1)
# standard deviations of the errors of the clocks in seconds
ERRORS = (0.0, 0.1, 0.5, 2.0)


@dataclass(frozen=True, slots=True)
class Scene:
    """Four stations round a target that turns: distance, speed and period, and what is measured."""

    distance: float
    speed: float
    period: float
    step: float
    sigmas: dict[str, float]


SCENES = {
    "ranges of a walker": Scene(30.0, 1.5, 40.0, 0.5, {"range": 0.15}),
    "cameras and a drone": Scene(200.0, 12.0, 30.0, 0.2, {"azimuth": 2e-3, "elevation": 2e-3}),
    "radars and an aircraft": Scene(5000.0, 150.0, 90.0, 1.0, {"range": 15.0, "azimuth": 3e-3}),
}


def way(scene: Scene, time: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return a path that turns, in space if elevations are measured."""
    rate = 2 * np.pi / scene.period
    course, phase = rng.uniform(0, 2 * np.pi, 2)
    along = 0.6 * scene.speed * time + 0.4 * scene.speed / rate * np.sin(rate * time + phase)
    across = 0.8 * scene.speed / rate * np.cos(rate * time + phase)
    east = along * np.sin(course) + across * np.cos(course)
    north = along * np.cos(course) - across * np.sin(course)
    up = 0.3 * scene.distance + 0.02 * along
    return np.stack([east, north, up][: 3 if "elevation" in scene.sigmas else 2], axis=-1)


def measured(kind: str, offset: FloatArray) -> FloatArray:
    """Return what a station measures of a target at an offset."""
    if kind == "range":
        return np.asarray(np.linalg.norm(offset, axis=-1))
    flat = np.hypot(offset[..., 0], offset[..., 1])
    return np.asarray(
        np.arctan2(offset[..., 0], offset[..., 1])
        if kind == "azimuth"
        else np.arctan2(offset[..., 2], flat)
    )


def run(
    scene: Scene, error: float, rng: np.random.Generator
) -> tuple[list[Trajectory], FloatArray]:
    """Return the paths by default and with unknown clocks except the first, and the true path."""
    time = scene.step * (np.arange(100) - 50.0)
    turn = np.pi / 2 * (np.arange(4) + rng.uniform(-0.3, 0.3, 4))
    places = scene.distance * np.stack([np.sin(turn), np.cos(turn), 0.02 * turn], axis=-1)
    clock = error * np.append(0.0, rng.standard_normal(3))
    start = rng.integers(2**32)
    true = [way(scene, time - late, np.random.default_rng(start)) for late in (0.0, *clock)]
    places = places[:, : true[0].shape[-1]]
    values = {
        kind: np.stack(
            [measured(kind, one - place) for one, place in zip(true[1:], places, strict=True)],
            axis=-1,
        )
        for kind in scene.sigmas
    }
    noisy: dict[str, Any] = {
        kind: np.abs(value) + scene.sigmas[kind] * rng.standard_normal(value.shape)
        if kind == "range"
        else value + scene.sigmas[kind] * rng.standard_normal(value.shape)
        for kind, value in values.items()
    }
    sigmas: dict[str, Any] = {f"{kind}_sigma": sigma for kind, sigma in scene.sigmas.items()}
    unknown: dict[str, Any] = dict.fromkeys(sigmas)
    paths = []
    for option in (0.0, error):
        biases = [Bias(**unknown, time_sigma=option if at else 0.0) for at in range(4)]
        stations = [
            Station(place, **sigmas, bias=bias) for place, bias in zip(places, biases, strict=True)
        ]
        paths.append(reconstruct(stations, time, **noisy))
    return paths, true[0]


def station_clocks() -> str:
    """Tabulate errors and coverage, by default and with unknown clocks."""
    rows = []
    for number, (title, scene) in enumerate(SCENES.items()):
        for error in ERRORS:
            found = [
                run(scene, error, generator(911, number, int(10 * error), seed))
                for seed in range(RUNS)
            ]
            row = [title, f"{error:g} s"]
            for option in range(2):
                errors = [judged(paths[option], true) for paths, true in found]
                rmse = np.sqrt(np.mean([square for square, _ in errors]))
                row.append(f"{rmse:.3g} m; {np.mean([inside for _, inside in errors]):.0%}")
            rows.append(row)
    return markdown(["scene", "clocks", "default", "`time_sigma`"], rows)


def judged(path: Trajectory, true: FloatArray) -> tuple[float, float]:
    """Return the mean square of the errors, and the share of the true positions in the regions."""
    d = true.shape[-1]
    error, covariance = path.position - true, path.covariance[:, :d, :d]
    square = np.einsum("ni,ni->n", error, np.linalg.solve(covariance, error[..., None])[..., 0])
    return float(np.mean(np.sum(error**2, axis=1))), float(np.mean(square < WITHIN_95[d]))
