"""Paths of which one station is wrong for long."""

import numpy as np

from studies.montecarlo import FloatArray, generator
from studies.pages import markdown, repetitions
from tertia.location import Station
from tertia.trajectory import reconstruct

RUNS = repetitions(20)
TIMES = np.arange(60.0)
SIGMA, REACH = 10.0, 3000.0
INSIDE = 5.991
# error of the first station in metres, and the share of the record in which it has it
FAULTS = {
    "none": (0.0, 1.0),
    "20 m": (20.0, 1.0),
    "50 m": (50.0, 1.0),
    "50 m, second half": (50.0, 0.5),
    "200 m": (200.0, 1.0),
    "200 m, second half": (200.0, 0.5),
}


def healthy(count: int, rng: np.random.Generator) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return places of stations around a path, the path, and ranges with noise."""
    turn = 2 * np.pi * (np.arange(count) + rng.uniform(-0.3, 0.3, count)) / count
    distance = REACH * rng.uniform(0.6, 1.0, count)
    places = np.column_stack([distance * np.sin(turn), distance * np.cos(turn)])
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
    track = reconstruct(
        [Station(place, range_sigma=SIGMA) for place in places], TIMES, range=ranges
    )
    outlier = np.asarray(track.outlier.range)
    return track.position - way, track.covariance[:, :2, :2], outlier[is_faulty, 0], outlier[:, 1:]


def one_wrong() -> str:
    """Tabulate errors, coverage and what is left out by the error of one station."""
    rows = []
    for number, (title, fault) in enumerate(FAULTS.items()):
        row = [title]
        for count in (4, 5, 6, 8):
            found = [run(count, fault, generator(283, number, count, seed)) for seed in range(RUNS)]
            error, covariance = (np.concatenate([one[i] for one in found]) for i in range(2))
            square = np.einsum(
                "ni,ni->n", error, np.linalg.solve(covariance, error[..., None])[..., 0]
            )
            rmse = np.sqrt(np.mean(np.sum(error**2, axis=1)))
            wrong, others = (np.mean([np.mean(one[i]) for one in found]) for i in (2, 3))
            row.append(f"{rmse:.1f}; {np.mean(square < INSIDE):.0%}; {wrong:.0%}, {others:.0%}")
        rows.append(row)
    head = ["error of one station", *(f"{count} stations" for count in (4, 5, 6, 8))]
    return markdown(head, rows)
