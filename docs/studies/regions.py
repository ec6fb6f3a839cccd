"""Regions of few bearings and of poor geometries, and protection levels: tables of two pages."""

import warnings
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from studies import honesty
from studies.honesty import BoolArray
from studies.montecarlo import WITHIN_95, FloatArray, generator
from studies.pages import markdown, repetitions
from tertia import metrics
from tertia.location import Location, locate
from tertia.sensors import Bias

# the simulations of Gerber et al. (2018): stations 200 to 500 m from the target, whole degrees
NEAR, FAR, MAX_RANGE, RECORD = 200.0, 500.0, 1000.0, repetitions(100, 20)
KAPPA = 50.0
STATED, SPREAD = np.radians(5.0), 0.7
RING = 5000.0
TARGET = np.array([700.0, -400.0])


def design(
    rng: np.random.Generator, count: int, n: int, sigma: float | FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return stations around a target at the origin, and bearings of it."""
    distance, way = rng.uniform(NEAR, FAR, (count, n)), rng.uniform(0, 2 * np.pi, (count, n))
    places = distance[..., np.newaxis] * np.stack([np.sin(way), np.cos(way)], axis=-1)
    kappa = np.broadcast_to(np.reshape(np.power(sigma, -2.0), (-1, 1)), (count, n))
    error = rng.vonmises(0.0, kappa)
    return places, np.radians(np.round(np.degrees(way + np.pi + error)))


def records(places: FloatArray, azimuth: FloatArray, *, pooled: bool) -> Iterator[Location]:
    """Locate record by record."""
    for at in range(0, len(places), RECORD):
        part = slice(at, at + RECORD)
        with warnings.catch_warnings():
            # some bearings hardly cross, whatever the limit of range
            warnings.simplefilter("ignore", UserWarning)
            yield locate(
                places[part],
                azimuth=azimuth[part],
                method="posterior",
                max_range=MAX_RANGE,
                pooled=pooled,
            )


def share(values: list[BoolArray], of: BoolArray) -> str:
    """Tell the share of instants."""
    return f"{np.mean(np.concatenate(values)[of]):.1%}"


def few_bearings() -> str:
    """Contents of the posterior's regions, of pooled records and of single fixes."""
    rows = []
    sigma = KAPPA**-0.5
    for name, n, pooled, pairs in (
        ("3, pooled", 3, True, 0.0),
        ("4, pooled", 4, True, 0.0),
        ("2, pooled with a third of instants with 3", 3, True, 2 / 3),
        ("2, alone", 2, False, 0.0),
        ("3, alone", 3, False, 0.0),
        ("4, alone", 4, False, 0.0),
    ):
        rng = generator(46, n, int(pooled), int(3 * pairs))
        count = repetitions(1000, 20)
        own = sigma if pooled else STATED * np.exp(SPREAD * rng.standard_normal(count))
        places, azimuth = design(rng, count, n, own)
        chosen = rng.uniform(size=count) < (pairs or 1.0)
        if pairs:
            azimuth[chosen, -1] = np.nan
        inside: dict[float, list[BoolArray]] = {0.5: [], 0.9: [], 0.95: []}
        for fixes in records(places, azimuth, pooled=pooled):
            for probability, found in inside.items():
                found.append(np.asarray(fixes.region(probability).contains([0.0, 0.0])))
        linear = region = "–"
        if n > 2 and not pairs:
            fixes = locate(places, azimuth=azimuth, method="least-squares", bias=Bias())
            located = np.asarray(fixes.success)
            nees = np.asarray(metrics.nees(fixes.position, fixes.covariance))
            linear = f"{np.mean(nees[located] <= WITHIN_95[2]):.1%}"
            region = share([np.asarray(fixes.region().contains([0.0, 0.0]))], located)
        cells = [share(found, chosen) for found in inside.values()]
        rows.append([name, *cells, linear, region, str(np.count_nonzero(chosen))])
    head = ["bearings", "50 %", "90 %", "95 %", "least squares: covariance", "`region()`", "fixes"]
    return markdown(head, rows)


def curved() -> str:
    """Contents of regions where the covariance is not small against the distances."""
    rows = []
    for name, places, target in (
        ("2 bearings, baseline 200 m", [[0, 0], [200, 0]], [100, 1000]),
        ("2 bearings, baseline 100 m", [[0, 0], [100, 0]], [50, 1000]),
        ("2 bearings, baseline 50 m", [[0, 0], [50, 0]], [25, 1000]),
        ("4 bearings along 300 m", [[0, 0], [100, 0], [200, 0], [300, 0]], [150, 1000]),
        ("4 bearings along 300 m, far", [[0, 0], [100, 0], [200, 0], [300, 0]], [150, 3000]),
        ("4 bearings, end-on", [[0, 0], [100, 0], [200, 0], [300, 0]], [1000, 200]),
    ):
        stations, truth = np.array(places, dtype=float), np.array(target, dtype=float)
        d = truth - stations
        rng = generator(47, len(places), int(stations[-1, 0]), target[1])
        noise = 0.02 * rng.standard_normal((repetitions(400, 20), len(places)))
        azimuth = np.arctan2(d[:, 0], d[:, 1]) + noise
        fixes = locate(
            stations, azimuth=azimuth, azimuth_sigma=0.02, method="least-squares", bias=Bias()
        )
        located = np.asarray(fixes.success)
        nees = np.asarray(metrics.nees(fixes.position - truth, fixes.covariance))
        region = fixes.region()
        inside, area = np.asarray(region.contains(truth))[located], np.asarray(region.area)[located]
        rows.append(
            [name, f"{np.mean(nees[located] <= WITHIN_95[2]):.1%}", f"{inside.mean():.1%}",
             f"{np.mean(np.isinf(area)):.1%}", f"{1 - located.mean():.1%}"]
        )  # fmt: skip
    head = ["σ = 0.02 rad", "covariance, 95 %", "`region(0.95)`", "unbounded", "no position"]
    return markdown(head, rows)


def measured(kind: str, places: FloatArray, errors: FloatArray) -> dict[str, Any]:
    """Return ranges, azimuths or times of arrival of the target."""
    d = TARGET - places
    if kind == "azimuth":
        return {"azimuth": np.arctan2(d[:, 0], d[:, 1]) + errors}
    distance = np.linalg.norm(d, axis=-1) + errors
    if kind == "range":
        return {"range": distance}
    return {"arrival_time": 1e-3 + distance / 299_792_458.0}


def protection() -> str:
    """Protection levels on a ring of 5 km, and how often the worst fault exceeds them."""
    rows = []
    for kind, n, sigma in (
        ("range", 6, 10.0),
        ("range", 8, 10.0),
        ("azimuth", 8, 0.005),
        ("arrival_time", 8, 10.0),
        ("arrival_time", 12, 10.0),
    ):
        way = 2 * np.pi * np.arange(n) / n + 0.1 * np.sin(np.arange(n))
        places = RING * np.stack([np.sin(way), np.cos(way)], axis=-1)
        scale = sigma / 299_792_458.0 if kind == "arrival_time" else sigma
        options: dict[str, Any] = {
            f"{kind}_sigma": scale,
            "bias": Bias(),
            "method": "least-squares",
        }
        fix = locate(places, **measured(kind, places, np.zeros(n)), **options)
        levels = [fix.cep(1 - 1e-5), fix.protection_level()]
        levels.append(fix.protection_level(faults=2, fault_probability=1e-3))
        rng, sizes = generator(48, n, len(kind)), np.arange(2.0, 14.0)
        total = 0.0
        for faulty in range(n):
            errors = rng.standard_normal((sizes.size, repetitions(500, 50), n))
            errors[..., faulty] += sizes[:, np.newaxis]
            fixes = locate(places, **measured(kind, places, sigma * errors), **options)
            far = np.linalg.norm(fixes.position - TARGET, axis=-1)
            total += 1e-4 * np.max(np.mean(far > fixes.protection_level(), axis=-1))
        name = kind.replace("_time", "")
        rows.append([f"{n} {name}s", *(f"{level:.1f}" for level in levels), f"{total:.1e}"])
    head = ["measurements", "no fault, m", "one fault of 1e-4, m", "two faults of 1e-3, m"]
    return markdown([*head, "worst single fault: risk"], rows)


def inside(*, pooled: bool, posterior: bool) -> Callable[[honesty.Draw], BoolArray]:
    """Return how to locate a target that passes four finders, with its regions."""
    places = np.array([[0.0, 0.0], [900.0, -200.0], [1100.0, 1000.0], [-150.0, 850.0]])

    def run(draw: honesty.Draw) -> BoolArray:
        target = np.stack([np.linspace(200, 800, RECORD), np.linspace(700, 300, RECORD)], axis=-1)
        d = target[:, np.newaxis] - places
        true = np.arctan2(d[..., 0], d[..., 1])
        found = []
        for _ in range(repetitions(1, 1)):
            errors = draw((len(places), RECORD), true.T)
            azimuth = true + STATED * errors.T
            options: dict[str, Any] = {
                "azimuth": azimuth,
                "azimuth_sigma": STATED,
                "pooled": pooled,
            }
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", UserWarning)
                if posterior:
                    fixes = locate(places, **options, method="posterior", max_range=MAX_RANGE)
                else:
                    fixes = locate(places, azimuth=azimuth, pooled=pooled, method="least-squares")
            found.append(np.asarray(fixes.region().contains(target)))
        return np.concatenate(found)

    return run


def coverage() -> str:
    """Contents of regions of four bearings, with errors as they are in the field."""
    return honesty.coverage_table(
        {
            '`method="posterior"`, one instant': inside(pooled=False, posterior=True),
            '`method="posterior"`, pooled': inside(pooled=True, posterior=True),
            "least squares, unknown sigma, one instant": inside(pooled=False, posterior=False),
            "least squares, unknown sigma, pooled": inside(pooled=True, posterior=False),
        },
        49,
    )
