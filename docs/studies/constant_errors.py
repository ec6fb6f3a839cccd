"""Paths from ranges of which every station has a constant error."""

from contextlib import suppress

import numpy as np

from studies.montecarlo import FloatArray, around, generator, in_region
from studies.pages import markdown, repetitions
from tertia.sensors import Station
from tertia.trajectory import reconstruct

RUNS = repetitions(40, 1)
TIMES = np.arange(60.0)
SIGMA, RADIUS = 0.1, 10.0
COUNTS = (4, 5, 6, 8)
# standard deviations of the constant errors, in metres
ERRORS = (0.0, 0.1, 0.3, 1.0)


def table() -> str:
    """Tabulate errors and coverage of a tag at rest and of one that walks."""
    rows = []
    for name, speed in {"at rest": 0.0, "walks": 0.2}.items():
        for error in ERRORS:
            row = [name, f"{error:g} m" if error else "none"]
            for count in COUNTS:
                found = []
                for run in range(RUNS):
                    rng = generator(557, round(10 * speed), round(10 * error), count, run)
                    # two positions may explain all ranges equally well
                    with suppress(ValueError):
                        found.append(_one(count, speed, error, rng))
                square, inside = np.mean(found, axis=0)
                row.append(f"{np.sqrt(square):.2f}; {inside:.0%}")
            rows.append(row)
    return markdown(["tag", "constant errors", *(f"{k} stations" for k in COUNTS)], rows)


def _one(count: int, speed: float, error: float, rng: np.random.Generator) -> FloatArray:
    """Return the squared error and the share of positions inside the 95 % ellipse."""
    places = RADIUS * around(count, rng)
    course = rng.uniform(0.0, 2 * np.pi) + np.cumsum(rng.normal(0.0, 0.1, len(TIMES)))
    way = speed * np.cumsum(np.column_stack([np.sin(course), np.cos(course)]), axis=0)
    way += rng.uniform(-3.0, 3.0, 2) - way.mean(axis=0)
    ranges = np.linalg.norm(way[:, np.newaxis] - places, axis=-1)
    ranges += error * rng.standard_normal(count) + SIGMA * rng.standard_normal(ranges.shape)
    stations = [Station(place, range_sigma=SIGMA) for place in places]
    track = reconstruct(stations, TIMES, range=np.maximum(ranges, SIGMA))
    known = np.isfinite(track.position).all(axis=1)
    wrong = (track.position - way)[known]
    inside = in_region(wrong, track.covariance[known, :2, :2])
    return np.array([np.mean(np.sum(wrong**2, axis=1)), inside.mean()])
