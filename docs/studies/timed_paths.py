"""Paths from times of arrival, some of them late: a table of the page on trajectories."""

import numpy as np

from studies.montecarlo import FloatArray, generator, in_region
from studies.pages import markdown, repetitions
from tertia.sensors import Station
from tertia.trajectory import reconstruct

LIGHT = 299_792_458.0
SIGMA = 30e-9
MISSING = 0.2
SHARES = (0.0, 0.05, 0.1, 0.2, 0.3)
PLACES = np.array(
    [[0.0, 0.0], [9000.0, 500.0], [8500.0, 8000.0], [-500.0, 7500.0], [4000.0, -3000.0]]
)
TIME = np.arange(80.0)
PATH = np.column_stack([1000 + 80 * TIME, 2000 + 1500 * np.sin(TIME / 25)])
RUNS = repetitions(100)


def late() -> str:
    """Return errors of paths, what their regions hold, and how many late arrivals are left out."""
    rows = []
    for share in SHARES:
        runs = [_one(share, generator(211, round(100 * share), run)) for run in range(RUNS)]
        rms, inside, out, wrong = np.array(runs).T
        left = f"{np.nanmean(out):.0%}" if share else "-"
        errors = [f"{np.median(rms):.1f}", f"{np.max(rms):.1f}"]
        shares = [f"{np.mean(inside):.1%}", left, f"{np.mean(wrong):.1%}"]
        rows.append([f"{share:.0%}", *errors, *shares])
    head = [
        "late",
        "RMSE in m, median",
        "largest",
        "inside 95 %",
        "late left out",
        "others left out",
    ]
    return markdown(head, rows)


def _one(share: float, rng: np.random.Generator) -> FloatArray:
    """Return the error of a path and the shares inside, of late and of good arrivals left out."""
    travel = np.linalg.norm(PATH[:, np.newaxis] - PLACES, axis=-1) / LIGHT
    emitted = TIME[:, np.newaxis] + rng.uniform(0, 0.3, (len(TIME), 1))
    arrival = emitted + travel + SIGMA * rng.standard_normal(travel.shape)
    is_late = rng.random(arrival.shape) < share
    arrival[is_late] += rng.uniform(10, 100, np.count_nonzero(is_late)) * SIGMA
    arrival[rng.random(arrival.shape) < MISSING] = np.nan
    stations = [Station(place, arrival_time_sigma=SIGMA) for place in PLACES]
    path = reconstruct(stations, TIME, arrival_time=arrival)
    error = path.position - PATH
    rms = np.sqrt(np.mean(np.sum(error**2, axis=1)))
    inside = np.mean(in_region(error, path.covariance[:, :2, :2]))
    known, outlier = ~np.isnan(arrival), np.asarray(path.outlier.arrival_time)
    out = np.mean(outlier[is_late & known]) if share else np.nan
    return np.array([rms, inside, out, np.mean(outlier[~is_late & known])])
