"""The tables and pictures of the page on location."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from studies.montecarlo import FloatArray, generator
from studies.pages import markdown, repetitions
from tertia import metrics, plot
from tertia.location import Location, LocationMethod, Station, accuracy_map, locate
from tertia.simulate import stations

TRIALS = repetitions(20_000)
RADARS = [[1, 1000, 2], [2000, 300, 5], [400, 2600, 0]]
TARGET = [1000.0, 1500.0, 500.0]
FINDERS = [
    [0, 0], [2000, 0], [2000, 2000], [0, 2000], [1000, -1500], [-1500, 800], [3500, 1200],
    [800, 3600],
]  # fmt: skip
CASES: dict[str, tuple[list[Station], list[float]]] = {
    "3 radars (9 measurements, in space)": (
        [
            Station(p, range_sigma=10.0, azimuth_sigma=np.radians(0.3), elevation_sigma=0.0052)
            for p in RADARS
        ],
        TARGET,
    ),
    "8 direction finders": (
        [Station(p, azimuth_sigma=np.radians(2.0)) for p in FINDERS],
        [700.0, 1100.0],
    ),
    "8 ranges": ([Station(p, range_sigma=10.0) for p in FINDERS], [700.0, 1100.0]),
}
# Lenth (1981), as published: bearings, estimator, position, standard deviations
METHODS: tuple[LocationMethod, ...] = ("lenth-mle", "lenth-huber", "lenth-andrews", "robust")
LENTH = np.array(
    [
        [9, 3.2, 234], [9.4, 5.5, 215], [9.95, 9.05, 196], [8.7, 8.7, 193], [8.07, 9.7, 188],
        [5.6, 9, 250], [4.4, 8.9, 160], [1.85, 5.25, 118],
    ]
)  # fmt: skip
PUBLISHED = {
    (7, "lenth-mle"): "7.23, 1.98 ± .156, .156",
    (7, "lenth-huber"): "7.21, 1.98 ± .152, .152",
    (7, "lenth-andrews"): "7.21, 1.97 ± .156, .155",
    (8, "lenth-mle"): "5.87, 1.13 ± 1.490, 1.733",
    (8, "lenth-huber"): "6.78, 1.66 ± .883, .945",
    (8, "lenth-andrews"): "7.21, 1.97 ± .156, .155",
}


def drawn(name: str, faults: int, size: float, *study: int) -> tuple[Any, FloatArray]:
    """Return stations and measurements with exactly so many faults in each instant."""
    places, target = CASES[name]
    rng = generator(40, *study)
    record = stations(places, target, batch=TRIALS, rng=rng)
    kinds = list(record.measurements)
    k = len(places)
    order = np.argsort(rng.uniform(size=(TRIALS, k * len(kinds))), axis=-1)
    sign = rng.choice([-1.0, 1.0], size=order.shape)
    offset = np.where(order < faults, size * sign, 0.0)
    for at, kind in enumerate(kinds):
        sigma = np.array([getattr(place, f"{kind}_sigma") for place in places])
        record.measurements[kind] += sigma * offset[:, at * k : (at + 1) * k]
    return record.measurements, np.array(target)


def cells(fix: Location, target: FloatArray) -> list[str]:
    """Tell root mean square error, normalised error and share of instants without a position."""
    located = np.asarray(fix.success)
    error = fix.position - target
    nees = np.asarray(metrics.nees(error, fix.covariance))[located]
    rmse = np.sqrt(np.mean(np.sum(error[located] ** 2, axis=-1)))
    return [f"{rmse:.1f}", f"{nees.mean() / target.size:.2f}", f"{1 - located.mean():.2%}"]


def faults() -> str:
    """Errors of least squares and of the default, by number and size of the faults."""
    rows = []
    for at, name in enumerate(CASES):
        for number, size in ((0, 0.0), (1, 5.0), (1, 20.0), (2, 20.0), (3, 20.0)):
            measured, target = drawn(name, number, size, at, number, int(size))
            plain = locate(CASES[name][0], **measured, method="least-squares")
            robust = locate(CASES[name][0], **measured)
            wrong = f"{number} of {size:.0f} σ" if number else "none"
            rows.append([name, wrong, *cells(plain, target)[:2], *cells(robust, target)])
    head = ["stations", "faults", "least squares: RMSE, m", "NEES", "robust: RMSE, m", "NEES"]
    return markdown([*head, "no position"], rows)


def poor_geometry() -> str:
    """Compare the error of two bearings that cross at a small angle with the linear one."""
    rows = []
    for baseline in (2000.0, 500.0, 200.0, 100.0):
        places = [
            Station([0.0, 0.0], azimuth_sigma=0.02),
            Station([baseline, 0.0], azimuth_sigma=0.02),
        ]
        target = np.array([baseline / 2, 1000.0])
        record = stations(places, target, batch=TRIALS, rng=generator(41, int(baseline)))
        fix = locate(places, azimuth=record.measurements["azimuth"])
        linear = accuracy_map(places, target).sigma
        located = np.asarray(fix.success)
        nees = np.asarray(metrics.nees(fix.position - target, fix.covariance))[located]
        bias = np.median(fix.position[located, 1]) - target[1]
        rows.append(
            [f"{baseline:.0f}", f"{linear[1]:.0f}", f"{bias:+.0f}", f"{nees.mean() / 2:.2f}",
             f"{1 - located.mean():.1%}"]
        )  # fmt: skip
    head = ["baseline, m", "linear σ north, m", "median error north, m", "NEES", "no position"]
    return markdown(head, rows)


def lenth() -> str:
    """Tell the published and the found fixes of the example of Lenth (1981)."""
    rows = []
    for count in (7, 8):
        data = LENTH if count == 8 else np.delete(LENTH, 5, axis=0)
        for method in METHODS:
            fix = locate(data[:, :2], azimuth=np.radians(data[:, 2]), method=method)
            found = ", ".join(f"{v:.2f}" for v in fix.position)
            sigma = ", ".join(f"{v:.3f}" for v in fix.sigma)
            printed = PUBLISHED.get((count, method), "")
            rows.append([str(count), method, printed, f"{found} ± {sigma}", str(fix.outlier.count)])
    return markdown(["bearings", "method", "published", "found", "faults"], rows)


def picture_stations(names: Sequence[str] = "ABCDEF") -> list[Station]:
    """Return direction finders with names."""
    sigma = np.radians(2.0)
    return [Station(p, azimuth_sigma=sigma, name=n) for p, n in zip(FINDERS, names, strict=False)]


def fix_figure() -> Figure:
    """Draw a fix of six direction finders, one of them wrong."""
    places = picture_stations()
    record = stations(places, [700.0, 1100.0], rng=3)
    azimuth = record.measurements["azimuth"]
    azimuth[2] += np.radians(40.0)
    figure = Figure(figsize=(7, 5), layout="constrained")
    plot.location(places, locate(places, azimuth=azimuth), azimuth=azimuth, ax=figure.subplots())
    return figure


def map_figure() -> Figure:
    """Draw the accuracy of four direction finders over an area."""
    places = picture_stations()[:4]
    axis = np.linspace(-3000.0, 5000.0, 161)
    grid = np.stack(np.meshgrid(axis, axis), axis=-1)
    figure = Figure(figsize=(7, 5.5), layout="constrained")
    plot.accuracy_map(places, grid, accuracy_map(places, grid), ax=figure.subplots())
    return figure
