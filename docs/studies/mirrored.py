"""Paths that stations in a plane see together with their mirror images."""

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np

from studies.montecarlo import WITHIN_95, FloatArray, generator
from studies.pages import markdown, repetitions
from tertia.location import LIGHT, Station
from tertia.trajectory import reconstruct

RUNS = repetitions(20, 1)
TIMES = np.arange(float(repetitions(80, 40)))
SIGMA, REACH = 10.0, 4000.0


@dataclass(frozen=True)
class Scene:
    """Stations on a ring, what they measure, and the height at which the target passes."""

    title: str
    stations: int
    height: float
    relief: float = 0.0
    kind: str = "range"
    plane: bool = False


SCENES = (
    *(
        Scene(f"{count} ranges, {name}", count, height)
        for count in (3, 4, 6)
        for name, height in (
            ("boat, 0 m", 0.0),
            ("drone, 60 m", 60.0),
            ("aircraft, 300 m", 300.0),
            ("aircraft, 3 km", 3e3),
            ("aircraft, 10 km", 1e4),
        )
    ),
    Scene("4 ranges from heights ± 5 m, boat, 0 m", 4, 0.0, relief=5.0),
    Scene("4 ranges from heights ± 5 m, aircraft, 300 m", 4, 300.0, relief=5.0),
    Scene("4 ranges from heights ± 50 m, aircraft, 300 m", 4, 300.0, relief=50.0),
    Scene("6 ranges from heights ± 50 m, aircraft, 3 km", 6, 3e3, relief=50.0),
    Scene("6 arrival times, boat, 0 m", 6, 0.0, kind="arrival_time"),
    Scene("6 arrival times, aircraft, 3 km", 6, 3e3, kind="arrival_time"),
    Scene("6 range differences, aircraft, 3 km", 6, 3e3, kind="range_difference"),
    Scene("2 ranges and azimuths, aircraft, 3 km", 2, 3e3, kind="azimuth"),
    Scene("4 ranges from a line in the plane, `initial`", 4, 0.0, plane=True),
)


def places(scene: Scene, rng: np.random.Generator) -> FloatArray:
    """Draw the positions of the stations."""
    if scene.plane:
        along = np.sort(rng.uniform(-REACH, REACH, scene.stations))
        return np.column_stack([along, np.zeros(scene.stations)])
    turn = 2 * np.pi * (np.arange(scene.stations) + rng.uniform(-0.3, 0.3, scene.stations))
    angle = rng.uniform(0, 2 * np.pi) + turn / scene.stations
    distance = REACH * rng.uniform(0.5, 1.0, scene.stations)
    heights = scene.relief * rng.standard_normal(scene.stations)
    return np.column_stack([distance * np.sin(angle), distance * np.cos(angle), heights])


def path(scene: Scene, rng: np.random.Generator) -> FloatArray:
    """Draw a path that crosses the ring with a slow turn, or passes the line."""
    course, rate = rng.uniform(0, 2 * np.pi), rng.uniform(-0.01, 0.01)
    turning = course + rate * (TIMES - TIMES.mean())
    steps = 40.0 * np.column_stack([np.sin(turning), np.cos(turning)])
    level = np.cumsum(steps, axis=0)
    level += rng.uniform(-500, 500, 2) - level.mean(axis=0)
    if scene.plane:
        level[:, 1] += 2500.0
        return level
    return np.column_stack([level, np.full(len(TIMES), scene.height)])


def measured(
    scene: Scene, stations: FloatArray, way: FloatArray, rng: np.random.Generator
) -> dict[str, Any]:
    """Return what the stations measure."""
    offset = way[:, np.newaxis] - stations
    ranges = np.linalg.norm(offset, axis=-1)
    ranges += SIGMA * rng.standard_normal(ranges.shape)
    if scene.kind == "range":
        return {"range": ranges}
    if scene.kind == "range_difference":
        sigma = np.full(len(stations) - 1, SIGMA * np.sqrt(2))
        return {
            "range_difference": ranges[:, 1:] - ranges[:, :1],
            "range_difference_sigma": sigma,
        }
    if scene.kind == "arrival_time":
        sent = TIMES[:, np.newaxis] + rng.uniform(0, 0.3, (len(TIMES), 1))
        return {
            "arrival_time": sent + ranges / LIGHT,
            "arrival_time_sigma": np.full(len(stations), SIGMA / LIGHT),
        }
    azimuth = np.arctan2(offset[..., 0], offset[..., 1])
    return {
        "range": ranges,
        "azimuth": azimuth + 0.003 * rng.standard_normal(azimuth.shape),
        "azimuth_sigma": np.full(len(stations), 0.003),
    }


def run(scene: Scene, rng: np.random.Generator) -> tuple[FloatArray, FloatArray, bool]:
    """Return errors, their covariances, and whether the mirror image was said to be possible."""
    stations, way = places(scene, rng), path(scene, rng)
    options = {"initial": way[0]} if scene.plane else {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        track = reconstruct(
            [Station(place, range_sigma=SIGMA) for place in stations],
            TIMES,
            **measured(scene, stations, way, rng),
            **options,
        )
    d = way.shape[1]
    return track.position - way, track.covariance[:, :d, :d], track.mirror_image is not None


def mirrored() -> str:
    """Tabulate the side, the errors and the coverage of paths over stations in a plane."""
    rows = []
    for number, scene in enumerate(SCENES):
        found = [run(scene, generator(281, number, seed)) for seed in range(RUNS)]
        error = np.concatenate([one[0] for one in found])
        covariance = np.concatenate([one[1] for one in found])
        square = np.einsum("ni,ni->n", error, np.linalg.solve(covariance, error[..., None])[..., 0])
        across = error[:, -1]
        sigma = np.sqrt(covariance[:, -1, -1])
        level = np.sqrt(np.mean(np.sum(error[:, : 1 if scene.plane else 2] ** 2, axis=1)))
        rows.append(
            [
                scene.title,
                f"{level:.1f}",
                f"{np.sqrt(np.mean(across**2)):.1f}",
                f"{np.sqrt(np.mean(sigma**2)):.1f}",
                f"{np.mean(np.abs(across) < 1.96 * sigma):.0%}",
                f"{np.mean(square < WITHIN_95[error.shape[1]]):.0%}",
                f"{np.mean([one[2] for one in found]):.0%}",
            ]
        )
    head = [
        f"σ = {SIGMA:.0f} m",
        "RMSE in the plane, m",
        "RMSE across it, m",
        "stated σ across it, m",
        "across it inside 95 %",
        "inside 95 %",
        "mirror image reported",
    ]
    return markdown(head, rows)
