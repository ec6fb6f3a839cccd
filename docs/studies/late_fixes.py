"""Positions from ranges of which many are too long: a table of docs/location-errors.md."""

import numpy as np

from studies.montecarlo import around, generator, in_region
from studies.pages import markdown, repetitions
from tertia._arrays import BoolArray, FloatArray
from tertia.location import locate

RUNS, INSTANTS, SIGMA = repetitions(4, 1), repetitions(200, 25), 0.1
# shares of late ranges, and means of their exponential delays in metres
LATE = ((0.0, 1.0), (0.1, 1.0), (0.2, 3.0), (0.4, 1.0), (0.4, 5.0))
COUNTS = (5, 6, 8, 10)


def anchors(count: int, rng: np.random.Generator) -> FloatArray:
    """Return anchors on the walls of a hall of 20 m by 15 m, alternately high and low."""
    way = around(count, rng)
    way /= np.max(np.abs(way) / [10.0, 7.5], axis=1, keepdims=True)
    heights = rng.uniform(0.3, 1.5, count), rng.uniform(2.5, 4.0, count)
    up = np.where(np.arange(count) % 2, *heights)
    return np.column_stack([way * rng.uniform(0.8, 1.0, (count, 1)), up])


def late() -> str:
    """Errors and coverage by the share and size of late ranges, in the hall and beside it."""
    rows = []
    for beside in (False, True):
        for share, delay in LATE:
            where = "beside the hall" if beside else "in the hall"
            row = [where, f"{share:.0%}", f"{delay:.0f} m" if share else "-"]
            for count in COUNTS:
                drawn = [
                    generator(341, beside, round(100 * share), round(delay), count, run)
                    for run in range(RUNS)
                ]
                square, inside, located = zip(
                    *(_one(count, beside, share, delay, rng) for rng in drawn), strict=True
                )
                median = np.median(np.concatenate(square)) ** 0.5
                held, found = np.mean(np.concatenate(inside)), np.mean(located)
                row.append(f"{median:.2f}; {held:.0%}; {1 - found:.0%}")
            rows.append(row)
    head = ["tag", "late", "mean delay", *(f"{count} anchors" for count in COUNTS)]
    return markdown(head, rows)


def _one(
    count: int, beside: bool, share: float, delay: float, rng: np.random.Generator
) -> tuple[FloatArray, BoolArray, float]:
    """Return squared errors, whether regions hold, and the share with a position."""
    places = anchors(count, rng)
    truth = rng.uniform([-8.0, -6.0, 0.5], [8.0, 6.0, 2.0], (INSTANTS, 3))
    truth[:, 0] += 18.0 * beside
    ranges = np.linalg.norm(truth[:, np.newaxis] - places, axis=-1)
    ranges += SIGMA * rng.standard_normal(ranges.shape)
    ranges += (rng.random(ranges.shape) < share) * rng.exponential(delay, ranges.shape)
    fix = locate(places, range=ranges, range_sigma=SIGMA)
    located = np.asarray(fix.success)
    error = (fix.position - truth)[located]
    inside = in_region(error, fix.covariance[located])
    return np.sum(error**2, axis=1), inside, float(located.mean())
