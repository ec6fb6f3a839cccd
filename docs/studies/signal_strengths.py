"""Paths from ranges that follow from signal strengths: errors that grow with the range."""

import numpy as np

from studies.montecarlo import FloatArray, around, autoregressive, generator, in_region
from studies.pages import markdown, repetitions
from studies.walkers import walk
from tertia.location import Station
from tertia.trajectory import reconstruct

RUNS = repetitions(20)
TIMES = np.arange(200.0)
ROOM = np.array([40.0, 30.0])
# decibels for a factor of e in range, with a path loss exponent of 2.5
PER_FACTOR = 25 / np.log(10)
# of strengths: standard deviation in decibels and correlation from second to second
STRENGTHS = {"1.5 dB": (1.5, 0.0), "3 dB": (3.0, 0.0), "4 dB, lasting": (4.0, 0.7)}
STATED = 3.0
COUNTS = (4, 6, 10)


def scene(
    count: int, strengths: tuple[float, float], rng: np.random.Generator
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return places of beacons, a path, and the ranges by the strengths of its signals."""
    decibels, correlation = strengths
    way = walk(rng, len(TIMES), 1.0, ROOM)
    directions = around(count, rng)
    places = ROOM / 2 * (1 + rng.uniform(0.5, 1.0, (count, 1)) * directions)
    ranges = np.linalg.norm(way[:, np.newaxis] - places, axis=-1)
    errors = autoregressive(rng.standard_normal((1, *ranges.shape)), correlation)[0]
    return places, way, ranges * np.exp(decibels / PER_FACTOR * errors)


def signal_strengths() -> str:
    """Tabulate errors, coverage and the relative sigmas that were found, by errors of strengths."""
    rows = []
    for number, (title, strengths) in enumerate(STRENGTHS.items()):
        row = [title, f"{strengths[0] / PER_FACTOR:.2f}"]
        for count in COUNTS:
            square, inside, relative = [], [], []
            for seed in range(RUNS):
                places, way, ranges = scene(count, strengths, generator(287, number, count, seed))
                stations = [Station(place, range_sigma=STATED) for place in places]
                track = reconstruct(stations, TIMES, range=ranges)
                error = track.position - way
                inside.append(in_region(error, track.covariance[:, :2, :2]))
                square.append(np.sum(error**2, axis=1))
                relative.append(track.relative_range_sigma or 0.0)
            row.append(
                f"{np.sqrt(np.mean(square)):.1f}; {np.mean(inside):.0%}; {np.median(relative):.2f}"
            )
        rows.append(row)
    header = ["error of a strength", "of a range", *(f"{count} beacons" for count in COUNTS)]
    return markdown(header, rows)
