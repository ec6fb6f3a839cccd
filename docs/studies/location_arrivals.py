"""Times of arrival at one instant: docs/location-arrivals.md, and coverage of error bars."""

from typing import Any

import numpy as np

from studies.honesty import OUTLIERS, Draw, coverage_table
from studies.montecarlo import WITHIN_95, FloatArray, generator
from studies.pages import markdown, repetitions
from tertia import metrics
from tertia.location import Location, locate
from tertia.sensors import Bias

SIGMA = 10.0
SIDE = 10_000.0
# a target of a net is left out where the error would be more than 2.4 sigma
MOST = 24.0
COUNTS = (4, 5, 6, 8, 12, 20, 30)
LATE = ((6, 0.1), (8, 0.1), (12, 0.0), (12, 0.1), (12, 0.2), (20, 0.2), (30, 0.2))
FAULTY = ((5, 30.0), (5, 100.0), (6, 20.0), (6, 100.0), (8, 10.0), (8, 20.0), (12, 10.0))
ALIKE: dict[str, Any] = {"arrival_time_sigma": SIGMA, "propagation_speed": 1.0, "bias": Bias()}


def nets(
    receivers: int, count: int, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return receivers and targets, anywhere in a square, and the bounds of the covariances."""
    places: list[FloatArray] = []
    targets: list[FloatArray] = []
    bounds: list[FloatArray] = []
    while sum(len(part) for part in targets) < count:
        s = rng.uniform(0.0, SIDE, (count, receivers, 2))
        p = rng.uniform(0.0, SIDE, (count, 2))
        offset = p[:, np.newaxis] - s
        slope = offset / np.linalg.norm(offset, axis=-1, keepdims=True) / SIGMA
        slope -= slope.mean(axis=1, keepdims=True)
        bound = np.linalg.inv(np.swapaxes(slope, -1, -2) @ slope)
        good = np.trace(bound, axis1=-2, axis2=-1) < MOST**2
        places.append(s[good])
        targets.append(p[good])
        bounds.append(bound[good])
    one, two, three = (np.concatenate(part)[:count] for part in (places, targets, bounds))
    return one, two, three


def measured(places: FloatArray, targets: FloatArray, noise: FloatArray) -> FloatArray:
    """Return times of arrival, in metres."""
    distance = np.linalg.norm(targets[:, np.newaxis] - places, axis=-1)
    return np.asarray(distance + SIGMA * noise)


def cells(fix: Location, target: FloatArray, bound: FloatArray) -> list[str]:
    """Tell error over the bound, normalised error, share inside 95 % and without a position."""
    located = np.asarray(fix.success)
    error = (fix.position - target)[located]
    own = np.asarray(metrics.nees(error, fix.covariance[located]))
    best = np.asarray(metrics.nees(error, bound[located]))
    # one wrong minimum in thousands would be all of the mean
    ratio = np.sqrt(np.mean(np.minimum(best, 100.0)) / 2)
    return [
        f"{ratio:.2f}",
        f"{np.mean(np.minimum(own, 100.0)) / 2:.2f}",
        f"{np.mean(own < WITHIN_95[2]):.1%}",
        f"{1 - located.mean():.1%}",
    ]


def counts() -> str:
    """Errors by the number of receivers, of arrivals and of differences."""
    rows = []
    for receivers in COUNTS:
        rng = generator(43, receivers)
        places, target, bound = nets(receivers, repetitions(8000), rng)
        z = measured(places, target, rng.standard_normal(places.shape[:2]))
        shared: dict[str, Any] = {
            "range_difference": z[:, 1:] - z[:, :1],
            "range_difference_sigma": SIGMA * 2**0.5,
            "bias": Bias(),
        }
        arrivals = locate(places, arrival_time=z, **ALIKE)
        independent = locate(places, **shared, range_difference_correlation=0.0)
        rows.append(
            [
                str(receivers),
                *cells(arrivals, target, bound),
                *cells(independent, target, bound)[:3],
            ]
        )
    head = ["receivers", "RMSE / bound", "NEES", "inside 95 %", "no position"]
    other = ["as independent differences: RMSE / bound", "NEES", "inside 95 %"]
    return markdown([*head, *other], rows)


def late() -> str:
    """Arrivals by detours of 20 sigma on average."""
    rows = []
    for receivers, share in LATE:
        rng = generator(44, receivers, int(100 * share))
        places, target, bound = nets(receivers, repetitions(8000), rng)
        noise = rng.standard_normal(places.shape[:2])
        noise += np.where(
            rng.uniform(size=noise.shape) < share, rng.exponential(20, noise.shape), 0
        )
        z = measured(places, target, noise)
        row = [str(receivers), f"{share:.0%}"]
        for options in ({"method": "least-squares"}, {"multipath": False}, {}):
            row += cells(locate(places, arrival_time=z, **ALIKE | options), target, bound)[:3]
        rows.append(row)
    head = ["receivers", "late"]
    for name in ("least squares", "either side", "late"):
        head += [f"{name}: RMSE / bound", "NEES", "inside 95 %"]
    return markdown(head, rows)


def faulty() -> str:
    """Tell how often one faulty receiver is found, and nothing else taken for it."""
    rows = []
    for receivers, size in FAULTY:
        row = [str(receivers), f"{size:.0f} σ"]
        for sign, options in ((1.0, {}), (1.0, {"multipath": False}), (-1.0, {"multipath": False})):
            rng = generator(45, receivers, int(size))
            places, target, bound = nets(receivers, repetitions(8000), rng)
            noise = rng.standard_normal(places.shape[:2])
            noise[:, 0] += sign * size
            fix = locate(places, arrival_time=measured(places, target, noise), **ALIKE | options)
            marks, located = fix.outlier.arrival_time, np.asarray(fix.success)
            assert marks is not None
            found = (marks[:, 0] & ~marks[:, 1:].any(axis=1))[located]
            row_of_fix = cells(fix, target, bound)
            row += [f"{found.mean():.1%}", row_of_fix[2], row_of_fix[3]]
        rows.append(row)
    head = ["receivers", "fault"]
    for name in ("late", "late, either side expected", "early, either side expected"):
        head += [f"{name}: found", "inside 95 %", "no position"]
    return markdown(head, rows)


def passing(receivers: int, runs: int = 40, steps: int = 25, **options: Any) -> Any:
    """Return how to locate a source on its way through a ring: squared errors, nan for none."""
    turn = 2 * np.pi * np.arange(receivers) / receivers
    places = 5000.0 * np.stack([np.sin(turn), np.cos(turn)], axis=-1)
    way = np.linspace([-2500.0, -1500.0], [2000.0, 2800.0], steps)
    offset = way[:, np.newaxis] - places
    distance = np.linalg.norm(offset, axis=-1)
    azimuth = np.arctan2(offset[..., 0], offset[..., 1])

    def run(draw: Draw) -> Any:
        squares = []
        for _ in range(repetitions(runs)):
            error = np.swapaxes(draw((receivers, steps), azimuth.T), -1, -2)
            fix = locate(
                places,
                arrival_time=distance + SIGMA * error,
                arrival_time_sigma=SIGMA,
                propagation_speed=1.0,
                **options,
            )
            squares.append(np.asarray(metrics.nees(fix.position - way, fix.covariance)))
        return np.concatenate(squares)

    return run


def inside(run: Any) -> Any:
    """Return an estimator for the table of coverage, of the instants with a position."""

    def held(draw: Draw) -> Any:
        square = run(draw)
        return square[np.isfinite(square)] < WITHIN_95[2]

    return held


def passages() -> dict[str, Any]:
    """Return the cases of the table of coverage."""
    return {
        f"{receivers} receivers{label}": passing(receivers, **options)
        for receivers in (6, 8, 10)
        for label, options in ((", late outliers", {}), (", either side", {"multipath": False}))
    }


def coverage() -> str:
    """Share of the truth inside the regions, with errors as they are in the field."""
    return coverage_table({name: inside(run) for name, run in passages().items()}, 46)


def given_up() -> str:
    """Share of the instants without a position."""
    cases = ["white", *OUTLIERS]
    rows = []
    for name, run in passages().items():
        shares = [np.mean(np.isnan(run(Draw(case, generator(46, 1))))) for case in cases]
        rows.append([name, *(f"{share:.0%}" for share in shares)])
    return markdown(["no position", *cases], rows)
