"""Paths from ranges of which many are too long: a table of the page on trajectories."""

import numpy as np

from studies.montecarlo import FloatArray, generator
from studies.one_wrong import SIGMA, TIMES, healthy
from studies.pages import markdown, repetitions
from tertia import metrics
from tertia.sensors import Station
from tertia.trajectory import reconstruct

RUNS = repetitions(40, 1)
SHARES = (0.0, 0.1, 0.3, 0.5)
# means of the exponential delays, in sigmas
DELAYS = (3.0, 20.0)
COUNTS = (5, 8)
INSIDE = 5.991


def late() -> str:
    """Tabulate errors, coverage and what is left out, by the share and size of late ranges."""
    rows = []
    for share in SHARES:
        for delay in DELAYS if share else DELAYS[:1]:
            row = [f"{share:.0%}", f"{delay * SIGMA:.0f} m" if share else "-"]
            for count in COUNTS:
                drawn = (
                    generator(331, round(100 * share), round(delay), count, run)
                    for run in range(RUNS)
                )
                found = np.array([_one(count, share, delay, rng) for rng in drawn])
                square, inside, left, others = found.mean(axis=0)
                out = f"{left:.0%}" if share else "-"
                row.append(f"{np.sqrt(square):.1f}; {inside:.0%}; {out}, {others:.1%}")
            rows.append(row)
    return markdown(["late", "mean delay", *(f"{count} stations" for count in COUNTS)], rows)


def _one(count: int, share: float, delay: float, rng: np.random.Generator) -> FloatArray:
    """Return the squared error, the share inside, and the shares of late and others left out."""
    places, way, ranges = healthy(count, rng)
    is_late = rng.random(ranges.shape) < share
    ranges += is_late * rng.exponential(delay * SIGMA, ranges.shape)
    track = reconstruct(
        [Station(place, range_sigma=SIGMA) for place in places], TIMES, range=ranges
    )
    error, outlier = track.position - way, np.asarray(track.outlier.range)
    inside = np.asarray(metrics.nees(error, track.covariance[:, :2, :2])) < INSIDE
    left = outlier[is_late].mean() if share else 0.0
    return np.array(
        [np.mean(np.sum(error**2, axis=1)), inside.mean(), left, outlier[~is_late].mean()]
    )
