"""Paths of which one station is wrong for long, and paths from repeated measurements."""

from collections.abc import Callable

import numpy as np

from studies.montecarlo import WITHIN_95, FloatArray, around, generator
from studies.pages import markdown, repetitions
from tertia.location import Station
from tertia.trajectory import reconstruct

RUNS = repetitions(20)
TIMES = np.arange(60.0)
SIGMA, REACH = 10.0, 3000.0
# error of the first station in metres, and the share of the record in which it has it
FAULTS = {
    "none": (0.0, 1.0),
    "20 m": (20.0, 1.0),
    "50 m": (50.0, 1.0),
    "50 m, second half": (50.0, 0.5),
    "200 m": (200.0, 1.0),
    "200 m, second half": (200.0, 0.5),
}
COUNTS = (4, 5, 6, 8)
# of the first station: its ranges by what they should be, the path and its place
CHANGING: dict[str, Callable[[FloatArray, FloatArray, FloatArray], FloatArray]] = {
    "ranges in feet": lambda ranges, way, place: ranges / 0.3048,
    "ranges in kilometres": lambda ranges, way, place: ranges / 1e3,
    "ranges too long by 30 %": lambda ranges, way, place: 1.3 * ranges,
    "ranges too long by 5 %": lambda ranges, way, place: 1.05 * ranges,
    "position wrong by 1 km": lambda ranges, way, place: (
        ranges
        + np.linalg.norm(way - place - [1e3, 0], axis=1)
        - np.linalg.norm(way - place, axis=1)
    ),
    "stuck at the first range": lambda ranges, way, place: np.full_like(ranges, ranges[0]),
}
REPEATED = (0.2, 0.4, 0.6, 0.8)


def healthy(count: int, rng: np.random.Generator) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return places of stations around a path, the path, and ranges with noise."""
    ways = around(count, rng)
    places = REACH * rng.uniform(0.6, 1.0, (count, 1)) * ways
    course = rng.uniform(0, 2 * np.pi) + rng.uniform(-0.02, 0.02) * (TIMES - TIMES.mean())
    way = np.cumsum(20.0 * np.column_stack([np.sin(course), np.cos(course)]), axis=0)
    way += rng.uniform(-800, 800, 2) - way.mean(axis=0)
    ranges = np.linalg.norm(way[:, np.newaxis] - places, axis=-1)
    return places, way, ranges + SIGMA * rng.standard_normal(ranges.shape)


def run(count: int, fault: tuple[float, float], rng: np.random.Generator) -> tuple[FloatArray, ...]:
    """Return errors, covariances, and which ranges of the first and of the others are left out."""
    places, way, ranges = healthy(count, rng)
    size, share = fault
    is_faulty = len(TIMES) - share * len(TIMES) <= TIMES
    ranges[is_faulty, 0] += size
    error, covariance, outlier = judged(places, way, ranges)
    return error, covariance, outlier[is_faulty, 0], outlier[:, 1:]


def judged(places: FloatArray, way: FloatArray, ranges: FloatArray) -> tuple[FloatArray, ...]:
    """Return errors, covariances, and which ranges are left out."""
    track = reconstruct(
        [Station(place, range_sigma=SIGMA) for place in places], TIMES, range=ranges
    )
    return track.position - way, track.covariance[:, :2, :2], np.asarray(track.outlier.range)


def cell(found: list[tuple[FloatArray, ...]]) -> str:
    """Summarise errors, covariances, and which of the wrong and the other ranges are left out."""
    error, covariance = (np.concatenate([one[i] for one in found]) for i in range(2))
    square = np.einsum("ni,ni->n", error, np.linalg.solve(covariance, error[..., None])[..., 0])
    rmse = np.sqrt(np.mean(np.sum(error**2, axis=1)))
    wrong, others = (np.mean([np.mean(one[i]) for one in found]) for i in (2, 3))
    return f"{rmse:.1f}; {np.mean(square < WITHIN_95[2]):.0%}; {wrong:.0%}, {others:.0%}"


def one_wrong() -> str:
    """Tabulate errors, coverage and what is left out by the error of one station."""
    rows = []
    for number, (title, fault) in enumerate(FAULTS.items()):
        row = [title]
        for count in COUNTS:
            draws = (generator(283, number, count, seed) for seed in range(RUNS))
            row.append(cell([run(count, fault, draw) for draw in draws]))
        rows.append(row)
    return markdown(["error of one station", *(f"{count} stations" for count in COUNTS)], rows)


def changing() -> str:
    """Tabulate the same for errors that change along the path."""
    rows = []
    for number, (title, fault) in enumerate(CHANGING.items()):
        row = [title]
        for count in COUNTS:
            found = []
            for seed in range(RUNS):
                places, way, ranges = healthy(count, generator(284, number, count, seed))
                ranges[:, 0] = fault(ranges[:, 0], way, places[0])
                *of_path, outlier = judged(places, way, ranges)
                found.append((*of_path, outlier[:, 0], outlier[:, 1:]))
            row.append(cell(found))
        rows.append(row)
    return markdown(["one station", *(f"{count} stations" for count in COUNTS)], rows)


def repeated() -> str:
    """Tabulate the same for ranges that are reported again until there are new ones."""
    rows = []
    for share in REPEATED:
        row = [f"{share:.0%}"]
        for count in COUNTS:
            found = []
            for seed in range(RUNS):
                rng = generator(285, round(10 * share), count, seed)
                places, way, ranges = healthy(count, rng)
                is_old = rng.random(ranges.shape) < share
                is_old[0] = False
                for t in range(1, len(TIMES)):
                    ranges[t] = np.where(is_old[t], ranges[t - 1], ranges[t])
                *of_path, outlier = judged(places, way, ranges)
                found.append((*of_path, outlier[is_old], outlier[~is_old]))
            row.append(cell(found))
        rows.append(row)
    return markdown(["repeated", *(f"{count} stations" for count in COUNTS)], rows)
