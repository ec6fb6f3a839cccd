"""The tables and pictures of the pages on location, its faults, and its regions."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from studies import honesty
from studies.honesty import BoolArray
from studies.montecarlo import WITHIN_95, FloatArray, generator, in_region
from studies.pages import markdown, repetitions
from tertia import metrics, plot
from tertia.location import Location, LocationMethod, Station, accuracy_map, locate
from tertia.sensors import Bias, Kind
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
SIGMAS = {"range": 10.0, "azimuth": np.radians(2.0), "elevation": np.radians(2.0)}
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
    """Compare the errors of bearings that cross at small angles with those that are claimed."""
    cases: list[tuple[str, list[list[float]], FloatArray]] = [
        (
            f"2 finders, {baseline:.0f} m apart",
            [[0, 0], [baseline, 0]],
            np.array([baseline / 2, 1000]),
        )
        for baseline in (2000.0, 500.0, 200.0, 100.0, 50.0, 20.0, 10.0)
    ]
    line = [[0.0, 0.0], [300.0, 0.0], [600.0, 0.0], [900.0, 0.0]]
    cases += [
        (f"4 finders in a line of 900 m, target {far / 1000:.0f} km away", line,
         np.array([450 + far / 2, far]))
        for far in (1000.0, 3000.0, 10_000.0, 30_000.0)
    ]  # fmt: skip
    rows = []
    for at, (name, sites, target) in enumerate(cases):
        places = [Station(site, azimuth_sigma=0.02) for site in sites]
        record = stations(places, target, batch=TRIALS, rng=generator(41, at))
        fix = locate(places, azimuth=record.measurements["azimuth"])
        linear = np.max(accuracy_map(places, target).sigma)
        located = np.asarray(fix.success)
        square = np.asarray(metrics.nees(fix.position - target, fix.covariance))[located]
        claimed = np.median(np.max(fix.sigma[located], axis=-1)) if located.any() else np.nan
        rows.append(
            [name, f"{linear:.0f}", f"{claimed:.0f}", f"{square.mean() / 2:.2f}",
             f"{np.mean(square < WITHIN_95[2]):.0%}", f"{1 - located.mean():.1%}"]
        )  # fmt: skip
    head = ["bearings of .02 rad", "linear σ, m", "claimed σ, m (median)", "NEES", "inside 95 %"]
    return markdown([*head, "no position"], rows)


def biases() -> str:
    """Tell what sigmas claim that are trusted, left to the contradictions, and given."""
    rows = []
    errors = {"none": 0.0, "2 σ, the same at all instants": 1, "2 σ, new at each of ten stops": 10}
    for at, (stops, name) in enumerate((int(stops), name) for name, stops in errors.items()):
        for count in (4, 8):
            places = np.array(FINDERS[:count], float)
            cells = np.zeros((3, 2))
            runs = repetitions(200)
            for run in range(runs):
                rng = generator(44, at, count, run)
                truth = path(200, 2)
                bias = 2 * rng.standard_normal((max(stops, 1), count)) * bool(stops)
                error = rng.standard_normal((200, count)) + np.repeat(
                    bias, 200 // len(bias), axis=0
                )
                sigma = SIGMAS["azimuth"]
                azimuth = directions(truth, places)["azimuth"] + sigma * error
                given = Bias(azimuth_sigma=2 * sigma * bool(stops))
                for column, known in enumerate((Bias(), None, given)):
                    fix = locate(places, azimuth=azimuth, azimuth_sigma=sigma, bias=known)
                    located = np.asarray(fix.success)
                    off = (fix.position - truth)[located]
                    inside = in_region(off, fix.covariance[located])
                    cells[column] += np.mean(inside), np.mean(np.sum(off**2, axis=-1))
            share, rmse = cells[:, 0] / runs, np.sqrt(cells[:, 1] / runs)
            rows.append(
                [name, str(count), *(f"{s:.0%}, {r:.0f}" for s, r in zip(share, rmse, strict=True))]
            )
    head = ["biases", "finders", "`bias=Bias()`: inside 95 %, RMSE in m", "`bias=None`", "given"]
    return markdown(head, rows)


def far_too_small() -> str:
    """Tell what becomes of positions if the stated sigmas are smaller by large factors."""
    factors, sigmas = (3, 10, 30, 100), {"azimuth": 5e-4, "range": 0.2}
    rows = []
    for at, (kind, count) in enumerate((("azimuth", 8), ("range", 5), ("range", 8))):
        places = np.array(FINDERS[:count] if count == 8 else FINDERS, float)[:count]
        cells = []
        for factor in factors:
            figures = []
            for run in range(repetitions(100)):
                rng = generator(49, at, factor, run)
                truth = path(100, 2)
                true, sigma = directions(truth, places)[kind], sigmas[kind]
                measured = true + factor * sigma * rng.standard_normal(true.shape)
                options: dict[str, Any] = {kind: measured, f"{kind}_sigma": sigma}
                fix = locate(places, **options)
                located = np.asarray(fix.success)
                off = (fix.position - truth)[located]
                square = np.asarray(metrics.nees(off, fix.covariance[located]))
                figures.append((np.mean(located), np.mean(square < WITHIN_95[2])))
            located_share, held = np.nanmean(figures, axis=0)
            cells.append(f"{located_share:.0%}, {held:.0%}")
        rows.append([f"{count} {kind}s", *cells])
    head = ["measurements", *(f"sigma × 1/{factor}" for factor in factors)]
    return markdown(head, rows)


def coverage() -> str:
    """Tell how often 95 % ellipses hold the target, with errors as they are in the field."""
    sights: tuple[Kind, ...] = ("azimuth",)
    polar: tuple[Kind, ...] = ("range", "azimuth", "elevation")
    batch, finders, radars = repetitions(100, 25), np.array(FINDERS, float), np.array(RADARS, float)
    few, more = finders[:4], finders[[0, 2, 4, 5, 7]]
    pooled = {"pooled": True}
    free = {"azimuth_sigma": None, **pooled}
    return honesty.coverage_table(
        {
            "4 bearings, each instant alone": inside(few, sights, 1),
            "4 bearings, 10 instants": inside(few, sights, 10),
            f"4 bearings, {batch} instants": inside(few, sights, batch),
            "4 bearings, the same, `pooled`": inside(few, sights, batch, **pooled),
            f"3 bearings, no sigma, `pooled`, {batch} instants": inside(
                finders[:3], sights, batch, **free
            ),
            "8 bearings, each instant alone": inside(finders, sights, 1),
            "8 bearings, 10 instants": inside(finders, sights, 10),
            f"8 bearings, {batch} instants": inside(finders, sights, batch),
            "8 bearings, the same, `pooled`": inside(finders, sights, batch, **pooled),
            "5 ranges, each instant alone": inside(more, ("range",), 1),
            f"5 ranges, {batch} instants": inside(more, ("range",), batch),
            "3 radars in space, each instant alone": inside(radars, polar, 1),
            f"3 radars in space, {batch} instants": inside(radars, polar, batch),
        },
        study=43,
    )


def single_instant() -> str:
    """Tell how often the ellipses of single instants hold the target, by degrees of freedom."""
    cases = {"as stated": "white", "twice as large": "sigma × ½"}
    rows = []
    for count in (3, 4, 8):
        cells = [f"{count} bearings", str(count - 2)]
        for case in cases.values():
            for options in ({}, {"bias": Bias()}):
                draw = honesty.Draw(case, generator(50, count, case == "white"))
                held = inside(np.array(FINDERS[:count], float), ("azimuth",), 1, **options)(draw)
                cells.append(f"{np.mean(held):.0%}")
        rows.append(cells)
    head = [f"errors {name}{said}" for name in cases for said in ("", ", `bias=Bias()`")]
    return markdown(["measurements", "degrees of freedom", *head], rows)


def inside(
    places: FloatArray, kinds: Sequence[Kind], batch: int, **options: Any
) -> Callable[[honesty.Draw], BoolArray]:
    """Return what locates a path in batches of so many instants; only located ones count."""

    def run(draw: honesty.Draw) -> BoolArray:
        found = []
        for _ in range(repetitions(600 // max(batch, 40), 1)):
            truth = path(max(batch, 40), places.shape[1])
            measured: dict[str, Any] = {}
            true = directions(truth, places)
            for kind in kinds:
                error = draw(true[kind].T.shape, true["azimuth"].T).T
                measured |= {kind: true[kind] + SIGMAS[kind] * error, f"{kind}_sigma": SIGMAS[kind]}
            measured |= options
            found.append(hits(places, kinds, measured, truth, batch))
        return np.concatenate(found)

    return run


def hits(
    places: FloatArray,
    kinds: Sequence[Kind],
    measured: dict[str, Any],
    truth: FloatArray,
    batch: int,
) -> BoolArray:
    """Return whether the ellipses of the located instants hold the truth."""
    rest = {name: value for name, value in measured.items() if name not in kinds}
    parts = [slice(at, at + batch) for at in range(0, len(truth), batch)]
    squares = []
    for part in parts:
        own: dict[str, Any] = {kind: measured[kind][part] for kind in kinds}
        fix = locate(places, **own, **rest)
        error = fix.position - truth[part]
        squares.append(np.asarray(metrics.nees(error, fix.covariance))[np.asarray(fix.success)])
    return np.concatenate(squares) < WITHIN_95[places.shape[1]]


def path(steps: int, dimension: int) -> FloatArray:
    """Return positions of a target that passes between the stations."""
    t = np.linspace(0.0, 1.0, steps)
    flat = np.stack([300 + 1200 * t, 700 + 600 * np.sin(3 * t)], axis=-1)
    return flat if dimension == 2 else np.column_stack([flat, 500 + 200 * t])


def directions(target: FloatArray, places: FloatArray) -> dict[str, FloatArray]:
    """Return ranges and angles of targets (N, D) from stations (K, D), each (N, K)."""
    d = target[:, np.newaxis] - places
    level = np.hypot(d[..., 0], d[..., 1])
    return {
        "range": np.linalg.norm(d, axis=-1),
        "azimuth": np.arctan2(d[..., 0], d[..., 1]),
        "elevation": np.arctan2(d[..., -1], level),
    }


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


def picture_stations() -> list[Station]:
    """Return direction finders with names."""
    sigma = np.radians(2.0)
    return [
        Station(place, azimuth_sigma=sigma, name=name)
        for place, name in zip(FINDERS, "ABCDEF", strict=False)
    ]


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
