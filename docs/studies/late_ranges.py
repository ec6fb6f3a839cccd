"""Paths from ranges of which many are too long: a table of the page on trajectories."""

import numpy as np

from studies.honesty import BoolArray
from studies.montecarlo import FloatArray, generator, in_region
from studies.one_wrong import SIGMA, TIMES, healthy
from studies.pages import markdown, repetitions
from tertia.sensors import Station
from tertia.trajectory import reconstruct

RUNS = repetitions(40, 1)
SHARES = (0.0, 0.1, 0.3, 0.5)
# means of the exponential delays, in sigmas
DELAYS = (3.0, 20.0)
# share of ranges that are late in runs, and the mean number of instants of a run
IN_RUNS, LASTING = 1 / 3, 10
COUNTS = (5, 8)


def late() -> str:
    """Tabulate errors, coverage and what is left out, by the share and size of late ranges."""
    cases = [(share, delay, 1) for share in SHARES for delay in (DELAYS if share else DELAYS[:1])]
    cases += [(IN_RUNS, delay, LASTING) for delay in DELAYS]
    rows = []
    for share, delay, lasting in cases:
        name = f"{share:.0%}" if lasting == 1 else f"{share:.0%}, for {lasting} instants"
        row = [name, f"{delay * SIGMA:.0f} m" if share else "-"]
        for count in COUNTS:
            drawn = (
                generator(331, round(100 * share), round(delay), count, run) for run in range(RUNS)
            )
            found = np.array([_one(count, share, delay, lasting, rng) for rng in drawn])
            square, inside, left, others = found.mean(axis=0)
            out = f"{left:.0%}" if share else "-"
            row.append(f"{np.sqrt(square):.1f}; {inside:.0%}; {out}, {others:.1%}")
        rows.append(row)
    return markdown(["late", "mean delay", *(f"{count} stations" for count in COUNTS)], rows)


def _runs(
    shape: tuple[int, ...], share: float, lasting: int, rng: np.random.Generator
) -> BoolArray:
    """Return which ranges are late, each station for so many instants on average."""
    is_late = rng.random(shape) < share
    for at in range(1, len(is_late)):
        chance = np.where(is_late[at - 1], 1 - 1 / lasting, share / (1 - share) / lasting)
        is_late[at] = rng.random(shape[1:]) < chance
    return is_late


def _one(
    count: int, share: float, delay: float, lasting: int, rng: np.random.Generator
) -> FloatArray:
    """Return the squared error, the share inside, and the shares of late and others left out."""
    places, way, ranges = healthy(count, rng)
    if lasting == 1:
        is_late = rng.random(ranges.shape) < share
        delays = rng.exponential(delay * SIGMA, ranges.shape)
    else:
        is_late = _runs(ranges.shape, share, lasting, rng)
        # of every run its own
        run = np.cumsum(np.diff(is_late, axis=0, prepend=False), axis=0)
        own = rng.exponential(delay * SIGMA, (len(ranges) + 1, count))
        delays = np.take_along_axis(own, run, axis=0)
    ranges += is_late * delays
    track = reconstruct(
        [Station(place, range_sigma=SIGMA) for place in places], TIMES, range=ranges
    )
    error, outlier = track.position - way, np.asarray(track.outlier.range)
    inside = in_region(error, track.covariance[:, :2, :2])
    left = outlier[is_late].mean() if share else 0.0
    return np.array(
        [np.mean(np.sum(error**2, axis=1)), inside.mean(), left, outlier[~is_late].mean()]
    )
