"""Every result is a table of pandas, Polars and pyarrow, and is shown by Jupyter."""

import builtins
import contextlib
import dataclasses
import importlib
import inspect
import pkgutil
from collections.abc import Callable, Iterator
from enum import IntEnum
from typing import Any, get_args, get_type_hints

import numpy as np
import polars as pl
import pytest

import tertia
from tertia import association, fusion, kalman, location, metrics, screening, smoothing, tracker
from tertia._result import Result
from tertia.sensors import Bias, Station
from tertia.trajectory import reconstruct

RNG = np.random.default_rng(5)
PLACES = np.array([[0.0, 0.0], [4e3, 0.0], [0.0, 3e3], [4e3, 3e3]])
STATIONS = [
    Station(place, name=name, range_sigma=3.0) for place, name in zip(PLACES, "ABCD", strict=True)
]
TIME = np.arange(30.0)
PATH = np.column_stack([500.0 + 20.0 * TIME, 1000.0 + 5.0 * TIME])
RANGES = np.linalg.norm(PATH[:, None] - PLACES, axis=-1) + RNG.normal(0, 3.0, (30, 4))
MODEL = kalman.SingerModel(1.0, 0.05, 0.1, exact=True)
ANGLES = 45.0 + RNG.normal(0, 0.1, (3, 40))
RADAR = tracker.Radar(range_sigma=50.0, azimuth_sigma=1e-3, scan_period=4.0)


def plots() -> tracker.Plots:
    time = 4.0 * np.arange(20)
    return tracker.Plots(time, 20e3 + 150.0 * time, np.full(20, 0.5))


# a result, the number of its rows, and columns that it must have
RESULTS: dict[str, tuple[Callable[[], Any], int, set[str]]] = {
    "bearing": (lambda: tertia.estimate_bearing(ANGLES[0]), 1, {"value", "sigma", "pvalue"}),
    "bearings": (lambda: tertia.estimate_bearing(ANGLES), 3, {"value", "systematic"}),
    "screening": (lambda: screening.k_sigma(ANGLES[0]), 40, {"outlier", "cleaned", "mean"}),
    "position": (
        lambda: location.locate(STATIONS, range=RANGES[0]),
        1,
        {"east_m", "east_sigma_m", "covariance_east_north_m2", "outlier_range_3", "status"},
    ),
    "positions": (
        lambda: location.locate(STATIONS, range=RANGES),
        30,
        {"east_m", "north_sigma_m", "residual_range_0", "pvalue"},
    ),
    "a batch of batches": (
        lambda: location.locate(STATIONS, range=RANGES.reshape(5, 6, 4)),
        30,
        {"index_0", "index_1", "east_m"},
    ),
    "region": (
        lambda: location.locate(STATIONS, range=RANGES).region(0.9),
        30,
        {"area", "semi_major", "orientation"},
    ),
    "path": (
        lambda: reconstruct(STATIONS, TIME, range=RANGES),
        30,
        {"time_s", "velocity_east_m_s", "velocity_north_sigma_m_s", "acceleration_east_m_s2"},
    ),
    "filtered": (
        lambda: kalman.filter_series(ANGLES[0], 0.01, MODEL, period=360.0),
        40,
        {"mean_0", "sigma_2", "innovation", "log_likelihood"},
    ),
    "smoothed": (
        lambda: smoothing.smooth(PATH, 9.0 * np.eye(2), time=TIME), 30, {"mean_0", "mean_5"}
    ),
    "fused": (
        lambda: fusion.fuse([[1.0], [2.0]], [[[1.0]], [[1.0]]]), 1, {"mean_0", "sigma_0", "pvalue"}
    ),
    "fused series": (
        lambda: fusion.fuse_series(ANGLES, 0.01, MODEL, period=360.0),
        40,
        {"mean_0", "sigma_0"},
    ),
    "bias": (
        lambda: Bias(range=[30.0, -20.0], azimuth_sigma=1e-3),
        2,
        {"range_m", "azimuth", "azimuth_sigma", "time_s"},
    ),
    "plots": (plots, 20, {"time_s", "range_m", "azimuth", "sensor"}),
    "tracks": (
        lambda: tracker.track(plots(), [RADAR]),
        20,
        {"time_s", "track", "east_m", "velocity_north_m_s", "covariance_east_velocity_east_m2_s"},
    ),
    "pairs": (
        lambda: association.gate([[0.0, 0.0]], [np.eye(2)], [[0.5, 0.0], [9e3, 0.0]]),
        1,
        {"track", "plot", "nis"},
    ),
    "audit": (
        lambda: tertia.audit(RNG.normal(size=(200, 2)), np.eye(2)),
        -1,
        {"part", "quantity", "value", "low", "high", "verdict"},
    ),
    "gospa": (
        lambda: metrics.gospa([[0.0, 0.0]], [[1.0, 0.0]], cutoff=10.0), 1, {"distance", "missed"}
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", RESULTS)
def test_a_result_is_a_table_of_each_kind(name: str) -> None:
    make, count, columns = RESULTS[name]
    result = make()
    frame = result.to_polars()
    assert columns <= set(frame.columns)
    assert frame.height == count or count < 0 < frame.height
    pandas, arrow = result.to_pandas(), result.to_arrow()
    assert list(pandas.columns) == arrow.column_names == frame.columns
    for column in frame.columns:
        values = frame[column].to_numpy()
        np.testing.assert_array_equal(pandas[column].to_numpy(), values)
        np.testing.assert_array_equal(arrow[column].to_numpy(), values)
    page = result._repr_html_()
    assert type(result).__name__ in page
    assert "<table" in page


def test_the_numbers_are_those_of_the_result() -> None:
    found = location.locate(STATIONS, range=RANGES)
    frame = found.to_polars()
    np.testing.assert_array_equal(frame.select("east_m", "north_m"), found.position)
    np.testing.assert_array_equal(frame.select("east_sigma_m", "north_sigma_m"), found.sigma)
    np.testing.assert_array_equal(frame["covariance_east_north_m2"], found.covariance[:, 0, 1])
    table = tracker.track(plots(), [RADAR])
    rows = table.to_polars()
    np.testing.assert_array_equal(
        rows["covariance_north_velocity_east_m2_s"], table.covariance[:, 1, 2]
    )
    grid = location.locate(STATIONS, range=RANGES.reshape(5, 6, 4)).to_polars()
    place = grid.filter((pl.col("index_0") == 3) & (pl.col("index_1") == 2))
    assert place["east_m"].item() == found.position[20, 0]


def test_without_polars_jupyter_shows_text(monkeypatch: pytest.MonkeyPatch) -> None:
    load = builtins.__import__

    def without(name: str, *more: Any) -> Any:
        if name == "polars":
            raise ModuleNotFoundError(name)
        return load(name, *more)

    monkeypatch.setattr(builtins, "__import__", without)
    assert tertia.estimate_bearing(ANGLES[0])._repr_html_().startswith("<pre>BearingEstimate(")


# what goes in, and what belongs to others
NO_RESULTS = {
    "Atmosphere", "ByKind", "ClockBias", "Column", "FiledPlan", "FlightPlan", "LocalFrame",
    "SystemPlane", "Station", "Radar", "ImmModel", "CvModel", "SingerModel", "WindowModel", "Mht",
    "PaperScore", "PlanModel", "Truth", "Turns", "JacobianOperator", "AsterixRecording",
    "Indicator",
    "BiasHistory", "NoiseHistory", "Traffic", "Scene", "SetUp", "RadarPlots", "StationRecord",
    "PassiveLocation", "PositionSensor", "Channel",
}  # fmt: skip


def public(*without: str) -> Iterator[Any]:
    """Yield what public modules export, without some of the modules."""
    for module in pkgutil.iter_modules(tertia.__path__):
        if module.name.startswith("_") or module.name in {"cli", "plot", "report", *without}:
            continue
        found = importlib.import_module(f"tertia.{module.name}")
        for name in getattr(found, "__all__", ()):
            yield getattr(found, name)


def returned(kind: Any) -> Iterator[type]:
    """Yield the classes of this library in an annotation."""
    if isinstance(kind, type) and kind.__module__.startswith("tertia."):
        yield kind
    for part in get_args(kind):
        yield from returned(part)


def test_every_function_returns_results() -> None:
    """Also where the class of a result is not public."""
    found = set()
    for one in public("interop"):
        # a name that type checkers alone know
        with contextlib.suppress(NameError):
            if inspect.isfunction(one):
                found |= set(returned(get_type_hints(one).get("return")))
    assert len(found) > 20
    missing = {one.__name__ for one in found if not issubclass(one, (Result, IntEnum))}
    assert missing <= NO_RESULTS


def test_every_result_is_one() -> None:
    classes = [one for one in public("tables") if isinstance(one, type)]
    missing = {
        one.__name__
        for one in classes
        if dataclasses.is_dataclass(one) and not issubclass(one, Result)
    }
    assert missing <= NO_RESULTS
